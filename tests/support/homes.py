"""A tiny home for pipeline tests: a box room with a table and a cupboard, written as a GLB scan, and its manifest."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import trimesh
import yaml

ROOM = ((0.0, 0.0, 0.0), (4.0, 2.6, 3.6))


def write_room(path: Path) -> Path:
    """A room of 4 × 2.6 × 3.6 m, walls facing inwards, with a side table and a worktop along a wall."""
    shell = trimesh.creation.box(extents=np.subtract(*ROOM[::-1]))
    shell.apply_translation(np.mean(ROOM, axis=0))
    shell.invert()
    palette = np.array(
        [[196, 178, 150], [150, 160, 172], [210, 205, 196], [120, 96, 74], [180, 150, 140], [164, 176, 150]]
    )
    shell.visual.face_colors = np.column_stack([palette.repeat(2, axis=0), np.full(12, 255)])
    pieces = [shell]
    for low, high, colour in (
        ((1.0, 0.0, 0.0), (3.2, 0.9, 0.6), (90, 70, 60, 255)),
        ((0.0, 0.0, 2.2), (0.55, 0.55, 3.2), (70, 90, 110, 255)),
    ):
        box = trimesh.creation.box(extents=np.subtract(high, low))
        box.apply_translation(np.mean([low, high], axis=0))
        box.visual.face_colors = np.tile(colour, (12, 1))
        pieces.append(box)
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Scene(pieces).export(path)  # type: ignore[no-untyped-call]
    return path


def write_manifest(folder: Path, **changes: object) -> Path:
    """The manifest of two small observations in that room: a microwave (part_1), three clocks (part_2)."""
    write_room(folder / "room.glb")
    licence = {"name": "CC0-1.0", "author": "avs3d-bench", "source": "tests"}
    document = {
        "name": "tiny",
        "seed": 5,
        "camera": {"size": 96, "frames": 12},
        "scans": {
            "box": {
                "source": "scan",
                "file": "room.glb",
                "rooms": {"kitchen": [list(corner) for corner in ROOM]},
                "licence": licence,
            }
        },
        "observations": [
            {
                "part": "part_1",
                "scan": "box",
                "room": "kitchen",
                "index": 1,
                "category": "microwave",
                "silent": ["oven"],
            },
            {
                "part": "part_2",
                "scan": "box",
                "room": "kitchen",
                "index": 1,
                "category": "clock",
                "variant": "station",
                "instances": 3,
            },
        ],
    } | changes
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def tree_digest(root: Path) -> dict[str, str]:
    """Relative path → sha256 of every file below ``root``."""
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }
