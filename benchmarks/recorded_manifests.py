"""Write the manifests that have recordings in place of synthesised sounds, each from the manifest of its name.

``python -m benchmarks.recorded_manifests`` writes ``NAME-recorded.yaml`` beside each of `SOURCES`: the same lines, but
for the name, the version, the notes on sounds, and with ``sounds`` and ``voices``. A category sounds by the recordings
in the lock file that are for tests; one that has none there, by its voices for tests.
"""

from __future__ import annotations

import re
from pathlib import Path

import click
import yaml

from avs3d_bench.contract.taxonomy import CATEGORIES
from generators.assets.sounds import voices
from generators.library.lock import LOCK_NAME, Lock, read_lock

MANIFESTS = Path(__file__).parents[1] / "scenes_manifest"
#: Manifests that have a recorded counterpart.
SOURCES = ("open-s34-o7", "listen")
#: Version of the recorded counterparts.
VERSION = "4.0.0"
_HEADER = """\
# The observations of {name}.yaml with recordings instead of synthesised sounds, where the lock file has some
# for tests; the other categories have their voices for tests. Written by `python -m benchmarks.recorded_manifests`.
# Before the first run:
#   avs3d assets fetch --manifest scenes_manifest/{name}-recorded.yaml
"""


def recorded(text: str, lock: Lock) -> str:
    """The recorded counterpart of a manifest.

    Args:
        text: the manifest.
        lock: the lock file beside it.

    Raises:
        KeyError: if the manifest has no name or no observations.
    """
    document = yaml.safe_load(text)
    heard = _heard(document)
    sounds: dict[str, list[dict[str, str]]] = {}
    for entry in lock.assets:
        if entry.kind == "sound" and entry.split == "test" and entry.category in heard:
            sounds.setdefault(entry.category, []).append({"asset": entry.id})
    played = {name: [voice.name for voice in voices(name) if voice.split == "test"] for name in CATEGORIES}
    spoken = (played | document.get("voices", {})).items()
    left = {name: names for name, names in spoken if name in heard and name not in sounds}
    name = document["name"]
    body = re.sub(r"(?m)^(voices|sounds):.*\n(?:[ \t]+.*\n)*", "", re.sub(r"\A(#.*\n)+", "", text))
    body = re.sub(r"(?m)^name:.*$", f"name: {name}-recorded", body)
    body = re.sub(r"(?m)^version:.*$", f"version: {VERSION}", body)
    body = body.replace("synthesised sounds", "recorded and synthesised sounds")
    head, observations = re.split(r"(?m)^(?=observations:)", body)
    lines = ["sounds:"]
    for category in sorted(sounds):
        lines += [f"  {category}:", *(f"    - {{asset: {item['asset']}}}" for item in sounds[category])]
    if left:
        lines += ["voices:", *(f"  {category}: [{', '.join(left[category])}]" for category in sorted(left))]
    return _HEADER.format(name=name) + head + "\n".join(lines) + "\n" + observations


def _heard(document: dict[str, object]) -> set[str]:
    """Every category that sounds in some observation."""
    found: set[str] = set()
    observations = document["observations"]
    assert isinstance(observations, list)
    for entry in observations:
        sources = entry.get("sources")
        found |= {entry["category"]} if "category" in entry else set()
        found |= {source["category"] for source in sources or ()}
    return found


@click.command()
def main() -> None:
    """Write the recorded counterparts."""
    lock = read_lock(MANIFESTS / LOCK_NAME)
    for name in SOURCES:
        target = MANIFESTS / f"{name}-recorded.yaml"
        target.write_text(recorded((MANIFESTS / f"{name}.yaml").read_text(encoding="utf-8"), lock), encoding="utf-8")
        click.echo(f"scenes_manifest/{target.name}")


if __name__ == "__main__":
    main()
