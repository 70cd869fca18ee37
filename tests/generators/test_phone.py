"""The simulated phone: its scan lies near the truth, shows what was there and lacks what was not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from generators.assets.shapes import rotation
from generators.core.scene import Scene
from tests.support.acoustic_rooms import box_scene, solid
from tests.support.phone import PhoneScan, PhoneWalk, scan_by_phone

SIZE = (4.0, 2.6, 3.4)
#: A red block in the middle, lowest and highest corner.
BLOCK = np.array([[1.7, 0.0, 1.4], [2.3, 0.8, 2.0]])
HEADING = 30.0

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def home() -> Scene:
    shell = box_scene(SIZE).parts[0]
    inside = replace(shell.mesh, positions=shell.mesh.positions[:, ::-1], normals=-shell.mesh.normals[:, ::-1])
    block = solid("block", BLOCK[1] - BLOCK[0], BLOCK.mean(axis=0))
    red = replace(block.mesh, materials=(replace(block.mesh.materials[0], colour=(0.5, 0.03, 0.03)),))
    return replace(box_scene(SIZE), parts=(replace(shell, mesh=inside), replace(block, mesh=red)))


def scanned(home: Scene, **changes: object) -> PhoneScan:
    walk = PhoneWalk(("kitchen",), faces=20_000, heading=HEADING, holes=0, fragments=0)
    return scan_by_phone(home, replace(walk, **changes), np.random.default_rng(3))


@pytest.fixture(scope="module")
def scan(home: Scene) -> PhoneScan:
    return scanned(home)


def at_home(scan: PhoneScan) -> np.ndarray:
    return scan.mesh.vertices @ rotation("y", scan.heading) + scan.origin


def test_its_surface_lies_near_the_true_one(scan: PhoneScan) -> None:
    points = at_home(scan)
    walls = np.concatenate([np.abs(points), np.abs(points - SIZE)], axis=1).min(axis=1)
    outside = np.maximum(BLOCK[0] - points, points - BLOCK[1])
    block = np.where(
        (outside <= 0).all(axis=1), np.abs(outside.max(axis=1)), np.linalg.norm(np.maximum(outside, 0), axis=1)
    )
    distance = np.minimum(walls, block)
    assert len(scan.mesh.faces) <= 20_000
    assert np.median(distance) > 0.001, "no noise: the scan proves nothing"
    assert np.percentile(distance, 95) < 0.05


def test_what_nothing_looked_at_is_missing(home: Scene, scan: PhoneScan) -> None:
    hidden = np.array([2.0, 0.0, 1.7])  # the floor under the block
    assert np.linalg.norm(at_home(scan) - hidden, axis=1).min() > 0.15
    ceiling = [
        (at_home(one)[one.mesh.faces].mean(axis=1)[:, 1] > 2.5).sum() for one in (scan, scanned(home, ceiling=False))
    ]
    assert ceiling[1] < 0.5 * ceiling[0]


def test_faces_show_what_was_there(scan: PhoneScan) -> None:
    middle = at_home(scan)[scan.mesh.faces].mean(axis=1)
    uv = scan.mesh.uv[scan.mesh.faces].mean(axis=1)
    height, width = scan.mesh.atlas.shape[:2]
    pixels = scan.mesh.atlas[((1 - uv[:, 1]) * height).astype(int), (uv[:, 0] * width).astype(int)].astype(int)
    is_red = pixels[:, 0] > 1.5 * pixels[:, 1]
    on_block = ((middle > BLOCK[0] - 0.02) & (middle < BLOCK[1] + 0.02)).all(axis=1) & (middle[:, 1] > 0.1)
    assert is_red[on_block].mean() > 0.9
    assert is_red[middle[:, 1] > 1.2].mean() < 0.01
    assert {scan.mesh.names[k] for k in np.unique(scan.mesh.owner[on_block])} == {"block"}


def test_the_same_seed_gives_the_same_scan(home: Scene, scan: PhoneScan) -> None:
    again = scanned(home)
    assert again.mesh.vertices.tobytes() == scan.mesh.vertices.tobytes()
    assert again.mesh.atlas.tobytes() == scan.mesh.atlas.tobytes()
