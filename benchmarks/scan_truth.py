"""`python -m benchmarks.scan_truth DIR -o FILE`: how well a scan is read, on scans whose truth is known.

DIR holds what `benchmarks.phone_scans` writes. For each room: the error of its box, precision and recall of its
supports, T30 of the scan beside that of the furnished home, and the light on a white cube beside the true light.
Everything is as `avs3d scan` and the generator find it, but for the names of rooms, which are the true ones.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_json
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import reverberation_time
from benchmarks.phone_scans import SHARES
from generators.acoustics.tracer.backend import TracerBackend
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.boxes import yaw_matrix
from generators.core.scene import Material, Part, Scene
from generators.lighting.bake import insert
from generators.placement.site import Site
from generators.scans.files import scan_files_of
from generators.scans.scan import Axes, load_scan
from generators.scans.sound import DEFAULT_LABEL
from generators.surveying.survey import survey

Array = NDArray[np.float64]

#: A support that was found is true if its height (or plane) is this near to a true one's (m), and this share of its
#: area lies within that of true ones. A true one is found if this share of it lies within found ones.
NEAR, COVERED = 0.05, 0.6
#: Points along each side of a support at which that is asked.
GRID = 8
#: Kinds of supports that carry things.
TOPS = ("worktop", "shelf", "side_table")
#: A room is found if a box covers more than this share of its floor.
OVERLAP = 0.5
#: Side of the cubes that show the light (m).
CUBE = 0.1


@dataclass(frozen=True, eq=False)
class SurveyedScan:
    """A scan as `avs3d scan` reads it.

    Attributes:
        scene: the home, with the rooms that have a truth.
        boxes: room → (2, 3) box that the survey found, metres; a room that was not found is missing.
        found: number of rooms that the survey found.
        to_world: (3, 3) rotation from the aligned frame of the truth to that of the scene.
    """

    scene: Scene
    boxes: dict[str, Array]
    found: int
    to_world: Array

    def moved(self, points: Any) -> Array:
        """Points or vectors (..., 3) of the truth in the frame of the scene."""
        return np.asarray(points, dtype=np.float64) @ self.to_world.T

    def box(self, box: Any) -> Array:
        """A box (2, 3) of the truth, as a box in the frame of the scene."""
        corners = self.moved(list(product(*zip(*box, strict=True))))
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


def surveyed(path: Path, truth: dict[str, Any]) -> SurveyedScan:
    """Survey a scan and load it with the boxes that were found; a true room is the box that overlaps it most.

    Rooms have their true names, as after `avs3d scan --rooms`: geometry does not tell what a room is used for.
    """
    mesh = load_mesh(path, acoustic=DEFAULT_LABEL, twin="surface", max_acoustic_faces=sys.maxsize, textures=False)
    found = survey(path.name, mesh.positions, gltf=True)
    axes = Axes(found.up, found.front, found.turn, found.scale)
    files = scan_files_of(path)
    to_world = axes.rotation(files) @ yaw_matrix(np.radians(truth["turn"])).T
    out = SurveyedScan(Scene(path.stem, (), (), ()), {}, len(found.boxes), to_world)
    for name, room in truth["rooms"].items():
        true = out.box(room["box"])[:, [0, 2]]
        boxes = [np.array([box.low, box.high]) for box in found.boxes]
        common = [np.minimum(box[1, [0, 2]], true[1]) - np.maximum(box[0, [0, 2]], true[0]) for box in boxes]
        areas = [float(np.prod(np.maximum(sides, 0))) for sides in common]
        if areas and max(areas) > OVERLAP * np.prod(true[1] - true[0]):
            out.boxes[name] = boxes[int(np.argmax(areas))]
    return replace(out, scene=load_scan(path.parent.name, files, out.boxes, axes=axes))


def measure(folder: Path) -> dict[str, Any]:
    """The figures of one scan."""
    truth = read_json(folder / "truth.json")
    scan = surveyed(folder / "scan.glb", truth)
    out: dict[str, Any] = {"faces": len(scan.scene.parts[0].mesh.positions), "rooms found": scan.found, "rooms": {}}
    for name, room in truth["rooms"].items():
        if name not in scan.boxes:
            out["rooms"][name] = None
            continue
        error = float(np.abs(scan.boxes[name] - scan.box(room["box"])).max())
        supports = [s for s in truth["supports"] if s["room"] == name and s["kind"] in TOPS]
        true = [s | {key: scan.moved(s[key]) for key in ("origin", "u", "v")} for s in supports]
        mine = [vars(s) for s in scan.scene.supports if s.room == name and s.kind in TOPS]
        probes = [probe for probe in truth["probes"] if probe["room"] == name]
        out["rooms"][name] = {
            "largest error of the box (m)": round(error, 3),
            "tops": {
                "true": len(true),
                "found": len(mine),
                "precision": _share_covered(mine, true),
                "recall": _share_covered(true, mine),
            },
            "T30 (s)": {"true": room["t30"], "scan": t30(scan.scene, name)},
            "light": _light_errors(scan, probes),
        }
    return out


def t30(scene: Scene, name: str) -> float | None:
    """T30 by the tracer between a few walkable points of a room; None where nothing is walkable or measurable."""
    try:
        points = Site.of(scene, name).space.points
        responses = []
        for source, listener in SHARES:
            (x, z), (u, w) = (points[int(share * (len(points) - 1))] for share in (source, listener))
            floor = scene.room(name).low[1]
            session = TracerBackend().open(scene, (float(x), floor + 1.0, float(z)), room=name)
            responses.append(session.impulse_response(Pose.from_yaw((float(u), floor + 1.5, float(w)), 0.7)))
            session.close()
    except (Avs3dError, IndexError):
        return None
    found = reverberation_time(responses, SAMPLE_RATE)
    return None if found is None else round(found, 3)


def _points(support: dict[str, Any]) -> Array:
    """(GRID², 3) points on a support."""
    share = (np.arange(GRID) + 0.5) / GRID
    a, b = (g.reshape(-1, 1) for g in np.meshgrid(share, share))
    return np.asarray(np.asarray(support["origin"]) + a * np.asarray(support["u"]) + b * np.asarray(support["v"]))


def _share_covered(supports: list[dict[str, Any]], by: list[dict[str, Any]]) -> float | None:
    """The share of ``supports`` of whose points enough lie on one of ``by``; None for none."""
    if not supports:
        return None
    hits = 0
    for support in supports:
        points, covered = _points(support), np.zeros(GRID**2, dtype=bool)
        for other in by:
            corners = _points(other)
            low, high = corners.min(axis=0) - NEAR, corners.max(axis=0) + NEAR
            covered |= ((points >= low) & (points <= high)).all(axis=1)
        hits += bool(covered.mean() >= COVERED)
    return round(hits / len(supports), 3)


def cube_light(scene: Scene, places: Array) -> Array:
    """(N, 6, 3) mean radiance of the faces (+x, −x, +y, −y, +z, −z) of white cubes inserted at ``places`` (N, 3)."""
    grey = Material("cube", "plastic", colour=(0.5, 0.5, 0.5))
    cubes = [
        Part(f"cube{k}", MeshBuilder().box((CUBE, CUBE, CUBE), place, grey).build(), instance_id=k + 1)
        for k, place in enumerate(places)
    ]
    lit = [part for part in insert(scene, tuple(cubes)).parts if part.name.startswith("cube")]
    sides = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
    shares = np.random.default_rng(0).dirichlet((1, 1, 1), 100)
    out = []
    for part in lit:
        assert part.light is not None
        height, width = part.light.texels.shape[:2]
        at = np.clip(np.einsum("kc,fcx->fkx", shares, part.light.uv) * [width, height], 0, [width - 1, height - 1])
        light = part.light.texels[at[..., 1].astype(int), at[..., 0].astype(int)].mean(axis=1)
        out.append([light[part.mesh.normals.mean(axis=1) @ side > 0.9].mean(axis=0) for side in sides])
    return np.array(out)


def _light_errors(scan: SurveyedScan, probes: list[dict[str, Any]]) -> dict[str, float]:
    """Light on inserted white cubes beside the true one.

    Returns:
        over the places: the mean error of the light on a cube (mean of its faces), in stops; the mean with its sign;
        the median angle between the directions from which most light comes (the difference of opposite faces).
    """
    weights = np.array([0.2126, 0.7152, 0.0722])
    found = cube_light(scan.scene, scan.moved([probe["at"] for probe in probes])) @ weights
    true = np.array([probe["radiance"] for probe in probes]) @ weights
    a, b = (light[:, [0, 2, 4]] - light[:, [1, 3, 5]] for light in (true, found))
    a = scan.moved(a)
    cosine = (a * b).sum(axis=1) / np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1), 1e-12)
    stops = np.log2(found.mean(axis=1) / true.mean(axis=1))
    return {
        "error (stops)": round(float(np.abs(stops).mean()), 2),
        "bias (stops)": round(float(stops.mean()), 2),
        "angle (degrees)": round(float(np.median(np.degrees(np.arccos(np.clip(cosine, -1, 1))))), 1),
    }


@click.command()
@click.argument("directory", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(directory: Path, output: Path) -> None:
    """Measure every scan below DIRECTORY and write OUTPUT."""
    figures = {path.parent.name: measure(path.parent) for path in sorted(directory.glob("*/truth.json"))}
    write_json(output, figures)
    for scan, found in figures.items():
        for name, room in found["rooms"].items():
            print(scan, name, room or "not found", flush=True)


if __name__ == "__main__":
    main()
