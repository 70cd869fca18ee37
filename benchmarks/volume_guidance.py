"""`python -m benchmarks.volume_guidance ROOT`: 3D figures of clouds of known quality, for docs/protocol-strict.md.

Points are drawn uniformly on the true mesh, one per square centimetre, and then changed: by noise, by a shift, or by
removing the points that no camera of a split sees. A point is seen if no other part of its own object hides it (tested
with a ray) and the pixel into which it projects is marked in the true mask.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.ply import Ply
from evaluators.volume import TrueVolume, score_points, true_volume

#: Points per square metre: one per square centimetre.
DENSITY = 1e4
#: Tolerance (m): a ray that ends at most this far before a point still reaches it.
_SLACK = 0.005


def sample(mesh: Ply, density: float, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) random points with a uniform distribution over the surface."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    face = rng.choice(len(area), size=round(density * area.sum()), p=area / area.sum())
    root, second = np.sqrt(rng.random(len(face)))[:, None], rng.random(len(face))[:, None]
    points: np.ndarray = (1 - root) * a[face] + root * (1 - second) * b[face] + root * second * c[face]
    return points


def seen(observation: Observation, frames: tuple[Frame, ...], mesh: Ply, points: np.ndarray) -> np.ndarray:
    """(N,) bool: which points a frame shows."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    rays = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    found = np.zeros(len(points), dtype=bool)
    for frame in frames:
        mask = frame.mask()
        pixels, depth = observation.intrinsics.project(frame.pose, points)
        column, row = np.floor(np.nan_to_num(pixels, nan=-1.0)).clip(-1, 1e6).astype(int).T
        ahead = (depth > 0.01) & (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
        candidates = np.flatnonzero(ahead & ~found)
        candidates = candidates[mask[row[candidates], column[candidates]]]
        if len(candidates) == 0:
            continue
        eye = np.asarray(frame.pose.position)
        to = points[candidates] - eye
        length = np.linalg.norm(to, axis=1)
        starts = np.broadcast_to(eye, to.shape)
        hits, ray, _ = rays.intersects_location(starts, to / length[:, None], multiple_hits=False)
        reached = np.linalg.norm(hits - eye, axis=1) > length[ray] - _SLACK
        found[candidates[ray[reached]]] = True
    return found


def filled(truth: TrueVolume) -> np.ndarray:
    """(N, 3) centres of the voxels of the solid."""
    points: np.ndarray = (np.argwhere(truth.surface | truth.interior) + np.array(truth.origin) + 0.5) * truth.size
    return points


def figures(observation: Observation, rng: np.random.Generator) -> dict[str, tuple[float, float | None]]:
    """Prediction → IoU_3D and centroid_error."""
    mesh = observation.mesh()
    truth = true_volume(mesh.vertices, mesh.faces)
    points = sample(mesh, DENSITY, rng)
    noise = rng.standard_normal(points.shape)
    push = rng.standard_normal(3)
    push /= np.linalg.norm(push)
    train, test = (seen(observation, frames, mesh, points) for frames in (observation.train, observation.test))
    clouds: dict[str, Callable[[], np.ndarray]] = {
        "whole surface": lambda: points,
        "  noise 1 cm": lambda: points + 0.01 * noise,
        "  noise 2 cm": lambda: points + 0.02 * noise,
        "  noise 3 cm": lambda: points + 0.03 * noise,
        "  shifted by 2 cm": lambda: points + 0.02 * push,
        "  shifted by 5 cm": lambda: points + 0.05 * push,
        "  shifted by 10 cm": lambda: points + 0.1 * push,
        "  one point in ten": lambda: points[::10],
        "solid, filled": lambda: filled(truth),
        "seen from the train poses": lambda: points[train],
        "seen from the train poses, noise 1 cm": lambda: (points + 0.01 * noise)[train],
        "seen from the train poses, noise 2 cm": lambda: (points + 0.02 * noise)[train],
        "seen from the test poses": lambda: points[test],
    }
    out = {}
    for name, make in clouds.items():
        score = score_points(make(), truth)
        out[name] = (score.iou, score.centroid_error)
    return out


@click.command()
@click.argument("root", type=click.Path(path_type=Path))
@click.option("--only", multiple=True, help="Only these observations (shell patterns).")
def main(root: Path, only: tuple[str, ...]) -> None:
    """Print the figures over the dataset ROOT."""
    rows: dict[str, list[tuple[float, float | None]]] = {}
    observations = Dataset(root).select(*only)
    for number, observation in enumerate(observations):
        for name, pair in figures(observation, np.random.default_rng([0, number])).items():
            rows.setdefault(name, []).append(pair)
    table = Table("prediction", "3D IoU", "lowest", "highest", "centroid error (m)", "highest")
    for name, pairs in rows.items():
        iou = np.array([pair[0] for pair in pairs])
        errors = [pair[1] for pair in pairs if pair[1] is not None]
        shares = (f"{value:.2f}" for value in (iou.mean(), iou.min(), iou.max()))
        table.add_row(name, *shares, f"{np.mean(errors):.3f}", f"{np.max(errors):.3f}")
    console = Console(width=120)
    console.print(table)
    console.print(f"means over {len(observations)} observations of {root.name}")


if __name__ == "__main__":
    main()
