"""`python -m benchmarks.scan_truth DIR -o FILE`: how well a scan is read, on scans whose truth is known.

DIR holds what `benchmarks.phone_scans` writes. For each room: the error of its box, precision and recall of its
supports, T30 of the scan beside that of the furnished home, and the light on a white cube beside the true light.
Scans that are not parallel to the axes are turned before; everything else is what `load_scan` finds.
"""

from __future__ import annotations

import tempfile
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
from benchmarks.phone_scans import SHARES, white_cube
from generators.acoustics.tracer.backend import TracerBackend
from generators.assets.shapes import rotation
from generators.core.scene import Scene
from generators.lighting.lit_scene import LitScene
from generators.placement.site import Site
from generators.scans.scan import load_scan

Array = NDArray[np.float64]

#: A support that was found is true if its height (or plane) is this near to a true one's (m), and this share of its
#: area lies within that of true ones. A true one is found if this share of it lies within found ones.
NEAR, COVERED = 0.05, 0.6
#: Points along each side of a support at which that is asked.
GRID = 8
#: Kinds of supports that carry things.
TOPS = ("worktop", "shelf", "side_table")


def turned(path: Path, degrees: float) -> bytes:
    """The bytes of a GLB turned about +Y: a node above its roots."""
    from generators.assets.gltf import load_gltf, pack_glb

    tree, binary = load_gltf(path)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation("y", degrees)
    scene = tree["scenes"][tree.get("scene", 0)]
    tree["nodes"].append({"children": scene["nodes"], "matrix": matrix.T.reshape(-1).tolist()})
    scene["nodes"] = [len(tree["nodes"]) - 1]
    return pack_glb(tree, binary)


def measure(folder: Path) -> dict[str, Any]:
    """The figures of one scan."""
    truth = read_json(folder / "truth.json")
    boxes = {name: np.array(room["box"]) for name, room in truth["rooms"].items()}
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / "scan.glb"
        path.write_bytes(turned(folder / "scan.glb", truth["turn"]))
        scan = load_scan(folder.name, path, boxes)
    lit = LitScene.of(scan.parts)
    out: dict[str, Any] = {"faces": len(scan.parts[0].mesh.positions), "rooms": {}}
    for name, box in boxes.items():
        found = np.array([scan.room(name).low, scan.room(name).high])
        true = [s for s in truth["supports"] if s["room"] == name and s["kind"] in TOPS]
        mine = [vars(s) for s in scan.supports if s.room == name and s.kind in TOPS]
        probes = [probe for probe in truth["probes"] if probe["room"] == name]
        out["rooms"][name] = {
            "largest error of the box (m)": round(float(np.abs(found - box).max()), 3),
            "tops": {
                "true": len(true),
                "found": len(mine),
                "precision": _share_covered(mine, true),
                "recall": _share_covered(true, mine),
            },
            "T30 (s)": {"true": truth["rooms"][name]["t30"], "scan": t30(scan, name)},
            "light": _light_error(lit, probes),
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


def _light_error(lit: LitScene, probes: list[dict[str, Any]]) -> dict[str, float]:
    """Light on a white cube in the scan beside the true one.

    Returns:
        ratio of luminance (geometric mean over points) and the spread of its logarithm; median angle in degrees between
        the directions from which most light comes (the difference of opposite faces).
    """
    weights = np.array([0.2126, 0.7152, 0.0722])
    ratios, angles = [], []
    for probe in probes:
        true, found = np.array(probe["radiance"]) @ weights, white_cube(lit, np.array(probe["at"])) @ weights
        ratios.append(np.log(max(found.mean(), 1e-6) / true.mean()))
        a, b = (values[[0, 2, 4]] - values[[1, 3, 5]] for values in (true, found))
        cosine = a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return {
        "ratio": round(float(np.exp(np.mean(ratios))), 3),
        "spread": round(float(np.std(ratios)), 3),
        "angle (degrees)": round(float(np.median(angles)), 1),
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
            print(scan, name, room, flush=True)


if __name__ == "__main__":
    main()
