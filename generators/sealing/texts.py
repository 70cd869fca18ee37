"""The texts of `manifest.yaml` and `template.yaml` of a sealed test."""

from __future__ import annotations

from typing import Any

from generators.sampling.document import manifest_text


def sealed_text(document: dict[str, Any]) -> str:
    """The manifest with its seeds; the same document always has the same text."""
    return manifest_text(document, "A manifest of avs3d seal: its seeds come from a secret.")


def template_text(document: dict[str, Any]) -> str:
    """The manifest before."""
    return manifest_text(document, "What avs3d seal was asked for; the seeds of manifest.yaml come from a secret.")
