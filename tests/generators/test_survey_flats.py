"""The survey of whole procedural flats, fused into one noisy mesh with holes: every room within 10 cm."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from generators.core.boxes import yaw_matrix
from generators.core.scene import Room
from generators.surveying.survey import KnownFrame, RoomChoice, Survey, survey
from tests.support import scan_like
from tests.support.flats import plain_flat

Array = NDArray[np.float64]
#: Seeds of flats of five and of four rooms.
SEEDS = (11, 22)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=SEEDS)
def fused(request: pytest.FixtureRequest) -> tuple[Array, tuple[Room, ...]]:
    """(F, 3, 3) triangles of a flat, and its rooms."""
    home = plain_flat(request.param)
    mesh = scan_like.fuse(home, np.random.default_rng(0), noise=0.004, edge=0.3, texel=0.1)
    return mesh.vertices[mesh.faces], home.rooms


def worst(found: Survey, rooms: tuple[Room, ...], rotation: Array) -> float:
    """The largest error of a side of the best box for each room (m)."""
    world = yaw_matrix(np.radians(found.turn)) @ rotation
    out = 0.0
    for room in rooms:
        corners = np.array(list(product(*zip(room.low, room.high, strict=True)))) @ world.T
        truth = np.stack([corners.min(axis=0), corners.max(axis=0)])
        out = max(out, min(float(np.abs(np.array([box.low, box.high]) - truth).max()) for box in found.boxes))
    return out


def without_ceiling(triangles: Array, height: float) -> Array:
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    level = np.abs(normal[:, 1]) > 0.7 * np.linalg.norm(normal, axis=1)
    return triangles[~(level & (triangles[:, :, 1].mean(axis=1) > height - 0.25))]


@pytest.mark.parametrize(("yaw", "unit", "ceiling"), [(0.0, 1.0, True), (23.0, 0.001, True), (-37.5, 0.3048, False)])
def test_every_room_of_a_flat_is_found(
    fused: tuple[Array, tuple[Room, ...]], yaw: float, unit: float, ceiling: bool
) -> None:
    triangles, rooms = fused
    rotation = yaw_matrix(np.radians(yaw))
    triangles = triangles if ceiling else without_ceiling(triangles, rooms[0].high[1])
    found = survey("flat.glb", (triangles @ rotation.T / unit).astype(np.float32), gltf=True)
    assert (found.up, found.scale, len(found.boxes)) == ("y", unit, len(rooms))
    assert min(abs(found.turn + yaw - 90 * k) for k in (-1, 0, 1)) < 1.0
    assert worst(found, rooms, rotation) < 0.1


def test_the_user_names_the_rooms(fused: tuple[Array, tuple[Room, ...]]) -> None:
    triangles, _ = fused
    known = KnownFrame(rooms=RoomChoice((("bathroom", 4), ("kitchen", 1))))
    found = survey("flat.glb", triangles.astype(np.float32), known, gltf=True)
    assert found.rooms == {"bathroom": 3, "kitchen": 0}
    assert found.boxes[0].area >= found.boxes[3].area
