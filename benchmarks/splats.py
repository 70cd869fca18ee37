"""Splats: how much they look like the mesh, how long they take, and what objects lose to those that they stand on.

    python -m benchmarks.splats SCAN.glb --eye X Y Z

The splats are discs that are sampled on the scan's surface, with the colours of its texels. Prints, for several numbers
of them, the PSNR to the pictures of the mesh and the seconds of one core per frame; then the share of a box's light
that rough floors of discs take from it.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from avs3d_bench.formats.gaussian_ply import GaussianTable
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Mesh, Part, Scene, StageFile
from generators.vision.embree import EmbreeBackend
from generators.vision.splats.backend import SplatsBackend, SplatsSession
from generators.vision.splats.cloud import SplatCloud, transformed
from generators.vision.splats.kernels import SplatCamera
from generators.vision.splats.painter import NumbaPainter, SplatLayers
from tests.support.captured import captured, gaussians

#: Numbers of Gaussians and sides of pictures.
CASES = ((300_000, 504), (1_000_000, 504), (1_000_000, 1008))
#: Where the camera looks (radians to the left), and how far down.
YAWS, PITCH = (0.0, 1.6, 3.1, 4.6), -0.3
#: Sizes and roughness (m) of the floor's discs, and distances of the camera from the box.
SIZES, ROUGHNESS, DISTANCES = (0.01, 0.03, 0.08), (0.0, 0.005, 0.01), (1.0, 2.0, 3.5)


class RecordingPainter(NumbaPainter):
    """Keeps the last layers that it has painted."""

    layers: SplatLayers

    def paint(self, camera: SplatCamera, cut: np.ndarray) -> SplatLayers:
        """As `NumbaPainter.paint`."""
        self.layers = super().paint(camera, cut)
        return self.layers


def cloud_of(table: GaussianTable) -> SplatCloud:
    """The Gaussians in their own frame."""
    alpha = 1.0 / (1.0 + np.exp(-table.opacities.astype(np.float64)))
    return transformed(table, alpha.astype(np.float32), np.eye(4))


def likeness(mesh: Mesh, path: Path, count: int, size: int, eye: tuple[float, float, float]) -> None:
    """Print PSNR and time of some views of a scan."""
    table = captured(mesh, count, np.random.default_rng(7))
    # Room for harmonics of degree 3, as captured scenes have: they take time, zero or not.
    table = replace(table, sh=np.concatenate([table.sh, np.zeros((count, 15, 3), dtype=np.float32)], axis=1))
    cloud, scene = cloud_of(table), Scene(path.stem, (Part("scan", mesh),), (), (), stage=StageFile(path))
    camera = Intrinsics.from_fov(size)
    ours, theirs = SplatsSession(scene, camera, cloud, NumbaPainter(cloud)), EmbreeBackend().open(scene, camera)
    rows = []
    for yaw in YAWS:
        pose = Pose.from_yaw(eye, yaw, PITCH)
        start = time.thread_time()
        one = ours.render(pose).rgb
        middle = time.thread_time()
        other = theirs.render(pose).rgb
        error = np.mean((one.astype(float) - other) ** 2)
        rows.append((10 * np.log10(255**2 / error), middle - start, time.thread_time() - middle))
    decibels, seconds, mesh_seconds = np.array(rows).T
    print(
        f"{count:,} Gaussians at {size}²: PSNR {decibels.min():.1f} to {decibels.max():.1f} dB, "
        f"{seconds.mean():.2f} s, of which the mesh {mesh_seconds.mean():.2f} s"
    )


def floor(sigma: float, roughness: float) -> GaussianTable:
    """Discs on the plane y = 0, 8 m wide."""
    rng = np.random.default_rng(1)
    count = min(int(64 / (1.2 * sigma) ** 2), 400_000)
    turn = rng.uniform(0, np.pi / 2, count)
    scales = sigma * np.exp(rng.normal(0, 0.4, (count, 3)))
    scales[:, 1] = 0.003
    place = rng.uniform(-4, 4, (count, 3))
    place[:, 1] = rng.normal(0, roughness, count)
    zero = np.zeros(count)
    return gaussians(place, scales, 0.95, rotations=np.stack([np.cos(turn), zero, np.sin(turn), zero], axis=1))


def loss(sigma: float, roughness: float) -> float:
    """Share of the light of a box on such a floor that its discs take."""
    material = Material("grey", "plaster")
    ground = MeshBuilder().box((8, 0.1, 8), (0, -0.05, 0), material).build()
    box = MeshBuilder().box((0.4, 0.4, 0.4), (0, 0.2, 0), material).build()
    scene = Scene("floor", (Part("ground", ground), Part("box", box, instance_id=1)), (), ())
    cloud = cloud_of(floor(sigma, roughness))
    painter = RecordingPainter(cloud)
    session = SplatsSession(scene, Intrinsics.from_fov(252), cloud, painter)
    lost = []
    for distance in DISTANCES:
        view = session.render(Pose.from_yaw((0.3, 1.5, distance), 0.05, -float(np.arctan(1.3 / distance))))
        lost.append(1.0 - painter.layers.front[..., 3][view.instance_ids == 1].mean())
    return float(np.mean(lost))


@click.command()
@click.argument("scan", type=click.Path(exists=True, path_type=Path))
@click.option("--eye", type=float, nargs=3, required=True, help="Where the camera stands: x, y, z of the file, Y up.")
def main(scan: Path, eye: tuple[float, float, float]) -> None:
    """Compare splats that are sampled on SCAN with its mesh."""
    SplatsBackend().warm_up()
    mesh = load_mesh(scan, acoustic="plaster", twin="surface", max_acoustic_faces=10**9)
    for count, size in CASES:
        likeness(mesh, scan, count, size, eye)
    for sigma in SIZES:
        row = ", ".join(f"{1000 * roughness:.0f} mm rough {loss(sigma, roughness):.2%}" for roughness in ROUGHNESS)
        print(f"a box on discs of σ = {100 * sigma:.0f} cm loses: {row}")


if __name__ == "__main__":
    main()
