"""Generate a dataset with your own room, object and sound.

    python examples/generate_own.py data/own

The room is a mesh, here made with trimesh; a scan of a flat works the same way. The object replaces the procedural
washing machines, and the recording replaces their synthesised sound. The run takes about half a minute.
"""

import sys
from pathlib import Path

import numpy as np
import soundfile
import trimesh
import yaml

from avs3d_bench.validate import validate
from generators.cli import generate

ROOM = [[0.0, 0.0, 0.0], [3.6, 2.5, 3.0]]  # lowest and highest corner of the inside (m), Y up
LICENCE = {"name": "CC0-1.0", "author": "Jane Doe"}


def write_room(path: Path) -> None:
    """A bare bathroom with a bath along one wall; the walls face inwards."""
    shell = trimesh.creation.box(bounds=ROOM)
    shell.invert()
    shell.visual.face_colors = [205, 212, 214, 255]
    bath = trimesh.creation.box(bounds=[[2.9, 0.0, 0.6], [3.6, 0.55, 2.3]])
    bath.visual.face_colors = [240, 240, 236, 255]
    trimesh.Scene([shell, bath]).export(path)


def write_object(path: Path) -> None:
    """A washing machine: a white box with a dark door in its front (+Z)."""
    body = trimesh.creation.box(bounds=[[-0.3, 0.0, -0.28], [0.3, 0.85, 0.28]])
    body.visual.face_colors = [232, 232, 230, 255]
    door = trimesh.creation.cylinder(radius=0.17, height=0.03)
    door.apply_translation([0.0, 0.45, 0.295])
    door.visual.face_colors = [40, 44, 52, 255]
    trimesh.Scene([body, door]).export(path)


def write_sound(path: Path) -> None:
    """Six seconds of a turning drum: noise that is louder once per turn."""
    time = np.arange(6 * 44_100) / 44_100
    noise = np.random.default_rng(3).normal(0.0, 0.1, len(time))
    soundfile.write(path, noise * (0.5 + 0.5 * np.cos(2 * np.pi * 1.5 * time) ** 4), 44_100)


def write_manifest(folder: Path) -> Path:
    """Write the files and the manifest that names them."""
    folder.mkdir(parents=True, exist_ok=True)
    write_room(folder / "bathroom.glb")
    write_object(folder / "machine.glb")
    write_sound(folder / "drum.flac")
    manifest = {
        "name": "own",
        "seed": 2,
        "light": "preview",
        "camera": {"size": 128, "frames": 12},
        "scans": {
            "my_flat": {"source": "scan", "file": "bathroom.glb", "rooms": {"bathroom": ROOM}, "licence": LICENCE}
        },
        "objects": {"washing_machine": [{"file": "machine.glb", "height": 0.85, "licence": LICENCE}]},
        "sounds": {"washing_machine": [{"file": "drum.flac", "licence": LICENCE}]},
        "observations": [
            {"part": "part_1", "scan": "my_flat", "room": "bathroom", "index": 1, "category": "washing_machine"}
        ],
    }
    path = folder / "own.yaml"
    path.write_text(yaml.safe_dump(manifest, sort_keys=False))
    return path


def main(root: str) -> None:
    """Generate into ``root``; the files of the manifest go beside it."""
    manifest = write_manifest(Path(f"{root}-files"))
    generate.main([str(manifest), "-o", root, "--audio", "analytic", "--workers", "1"], standalone_mode=False)
    report = validate(root, deep=True)
    print(f"{root}: {'valid' if report.valid else 'not valid'}")


if __name__ == "__main__":
    main(sys.argv[1])
