"""A sampled manifest as text: one line per home and per observation."""

from __future__ import annotations

from typing import Any

import yaml

from avs3d_bench.commands.outputs import Signature

#: What the manifests of `avs3d manifest sample` and `avs3d sweep` say about themselves in their first line.
SAMPLED, SWEPT = Signature(start=b"# avs3d manifest sample "), Signature(start=b"# avs3d sweep ")
#: The same of `avs3d scan`.
SCANNED = Signature(start=b"# avs3d scan ")


def manifest_text(document: dict[str, Any], command: str) -> str:
    """The manifest as YAML, with the command that makes it in its first line.

    Examples:
        >>> print(manifest_text({"name": "a", "scans": {"home_1": {"seed": 1}}, "observations": [{"index": 1}]}, "x"))
        # x
        name: a
        scans:
          home_1: {seed: 1}
        observations:
          - {index: 1}
        <BLANKLINE>
    """
    lines = [f"# {command}"]
    for name, value in document.items():
        if name in ("scans", "models", "voices"):
            lines += [f"{name}:", *(f"  {key}: {one_line(entry)}" for key, entry in value.items())]
        elif name == "observations":
            lines += [f"{name}:", *(f"  - {one_line(entry)}" for entry in value)]
        else:
            lines.append(f"{name}: {one_line(value)}")
    return "\n".join(lines) + "\n"


def one_line(value: object) -> str:
    """A value as YAML in one line."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=1_000_000, allow_unicode=True)
    return str(text).removesuffix("...\n").strip()
