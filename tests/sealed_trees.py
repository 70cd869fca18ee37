"""A sealed test over the hand-made trees of tests/tiny.py and tests/tiny_scenes.py; nothing is generated."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import tiny
import tiny_scenes

from avs3d_bench import files
from avs3d_bench.dataset import Dataset
from avs3d_bench.provenance import provenance
from avs3d_bench.schema import ProvenanceRecord
from generators.manifest import Manifest, ManifestFile
from generators.sealing.draw import draw_document
from generators.sealing.publish import Sealing, write_private, write_public
from generators.sealing.texts import sealed_text, template_text

SECRET = bytes(range(32))
#: What the hand-made tree is said to come from.
TEMPLATE: dict[str, Any] = {
    "name": "tiny",
    "version": "1",
    "seed": 1,
    "scans": {"flat": {"seed": 5}},
    "observations": [
        {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "microwave", "silent": ["oven"]},
        {"part": "part_2", "scan": "flat", "room": "kitchen", "index": 1, "category": "microwave"},
    ],
}


def write_seal(
    folder: Path, secret: bytes = SECRET, *, train_truth: bool = False, scenes: bool = False, frames: int = 9
) -> Path:
    """Write ``public/``, ``private/`` and ``secret`` into a folder; ``scenes``: of the tree of part_3."""
    work = folder / "generated"
    if scenes:
        tiny_scenes.write_sound_scenes(work, stems=True)
    else:
        tiny.write_dataset(work, frames=frames, extras=True)
    data = files.read_json(work / "dataset.json")
    data["provenance"] = ProvenanceRecord.of(provenance("avs3d_bench.layout")).model_dump()
    tiny.write_sealed(work, data)
    document, _ = draw_document(TEMPLATE, secret, {})
    text = sealed_text(document)
    drawn = ManifestFile(
        Manifest.model_validate(document), folder / "template.yaml", text, hashlib.sha256(text.encode()).hexdigest()
    )
    sealing = Sealing(template_text(TEMPLATE), drawn, {}, secret, train_truth, {"audio": "tiny"})
    for name in ("public", "private"):
        (folder / name).mkdir()
    write_public(Dataset(work), folder / "public", sealing)
    write_private(Dataset(work), folder / "public", folder / "private", sealing)
    (folder / "secret").write_text(f"{secret.hex()}\n")
    return folder
