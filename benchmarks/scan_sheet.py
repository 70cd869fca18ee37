"""`python -m benchmarks.scan_sheet SCAN -o SHEET.png`: 24 objects in a scan, where the generator puts them, at 100 %.

Boxes and frame are those of `avs3d scan`. Each picture is a cut of 224² around the object from a frame of 504²; the
camera stands at a random walkable place 0.9 to 2.2 m away that sees it. For judging by eye what would pass as a part of
the scan. Deterministic.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.catalogue import build_model, variants
from generators.assets.meshfile import load_mesh
from generators.core.freespace import SENSOR_HEIGHT
from generators.core.scene import Part, Scene
from generators.lighting.bake import insert
from generators.placement.placement import place
from generators.placement.site import Site
from generators.scans.files import scan_files_of
from generators.scans.scan import Axes, load_scan
from generators.scans.sound import DEFAULT_LABEL
from generators.surveying.survey import survey
from generators.vision.embree import EmbreeBackend

Picture = NDArray[np.uint8]

COUNT, COLUMNS, TRIES = 24, 6, 72
#: Side of a frame and of a cut (pixels); distances of the camera (m); places that are tried.
SIDE, CUT, NEAR, FAR, PLACES = 504, 224, 0.9, 2.2, 60
#: Pixels that an object has at least.
LEAST = 300
CATEGORIES = ("telephone", "clock", "vacuum_cleaner", "coffee_machine", "clock", "telephone")


def read(path: Path) -> Scene:
    """The scan with the rooms that `avs3d scan` finds."""
    mesh = load_mesh(path, acoustic=DEFAULT_LABEL, twin="surface", max_acoustic_faces=sys.maxsize, textures=False)
    found = survey(path.name, mesh.positions, gltf=path.suffix in (".glb", ".gltf"))
    boxes = {name: np.array([found.boxes[n].low, found.boxes[n].high]) for name, n in found.rooms.items()}
    axes = Axes(found.up, found.front, found.turn, found.scale)
    return load_scan(path.stem, scan_files_of(path.resolve()), boxes, axes=axes)


def picture(site: Site, part: Part, rng: np.random.Generator) -> Picture | None:
    """A cut (CUT, CUT, 3) around an object; None if no place sees enough of it."""
    middle = part.mesh.bounds.mean(axis=0)
    cells = site.space.points
    for x, z in cells[rng.permutation(len(cells))[:PLACES]]:
        eye = np.array([x, site.room.low[1] + SENSOR_HEIGHT, z])
        way = middle - eye
        distance = float(np.linalg.norm(way))
        free, _ = site.caster.closest(eye[None], way[None] / distance)
        if not NEAR < distance < FAR or free[0] < distance - 0.3:
            continue
        session = EmbreeBackend().open(insert(site.scene, (part,)), Intrinsics.from_fov(SIDE, 90.0))
        try:
            yaw, pitch = np.arctan2(-way[0], -way[2]), np.arcsin(way[1] / distance)
            frame = session.render(Pose.from_yaw(eye, yaw, pitch))
        finally:
            session.close()
        first = (SIDE - CUT) // 2
        if (frame.instance_ids > 0).sum() >= LEAST:
            return frame.rgb[first : first + CUT, first : first + CUT]
    return None


def sheet(home: Scene) -> Picture:
    """`COUNT` pictures, or as many as there are places for, in rows of `COLUMNS`."""
    sites = [Site.of(home, room.name) for room in home.rooms]
    cuts: list[Picture] = []
    for number in range(TRIES):
        site, category = sites[number % len(sites)], CATEGORIES[number % len(CATEGORIES)]
        rng = np.random.default_rng(number)
        names = variants(category)
        try:
            (placed,) = place(site, [build_model(category, names[int(rng.integers(len(names)))], rng)], rng=rng)
        except Avs3dError as error:
            print(error)
            continue
        cut = picture(site, placed.part(1), rng)
        if cut is not None:
            cuts.append(cut)
            print(len(cuts), category, np.round(placed.part(1).mesh.bounds.mean(axis=0), 2), flush=True)
        if len(cuts) == COUNT:
            break
    cuts += [np.zeros((CUT, CUT, 3), dtype=np.uint8)] * (-len(cuts) % COLUMNS)
    return np.vstack([np.hstack(cuts[first : first + COLUMNS]) for first in range(0, len(cuts), COLUMNS)])


@click.command()
@click.argument("scan", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(scan: Path, output: Path) -> None:
    """Write the sheet of SCAN as OUTPUT (PNG)."""
    cv2.imwrite(str(output), sheet(read(scan))[..., ::-1])


if __name__ == "__main__":
    main()
