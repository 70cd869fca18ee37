"""Which lamps a path tracer tries in a room: those whose light arrives there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from generators.assets.shapes import MeshBuilder
from generators.core.rays import Tracer
from generators.core.scene import Mesh, Room
from generators.vision.lamps import LEAST, Lamp, lamp_weights
from tests.generators.test_light import LAMP, SIZE, box_room, ceiling_lamp, matte

HERE = Room("here", (0.0, 0.0, 0.0), SIZE)


def lamp(mesh: Mesh, strength: float = 1.0) -> Lamp:
    return Lamp(mesh.positions, mesh.normals, [strength * value for value in LAMP.emission])


def weights(meshes: Sequence[Mesh], lamps: Sequence[Mesh], strength: Sequence[float], room: Room | None) -> np.ndarray:
    tracer = Tracer(np.concatenate([mesh.positions for mesh in (*meshes, *lamps)]))
    return lamp_weights([lamp(*pair) for pair in zip(lamps, strength, strict=True)], tracer, room)


@pytest.fixture(scope="module")
def rooms() -> tuple[Mesh, Mesh]:
    """A closed room, and another one beside it, 10 cm away."""
    return box_room(matte(0.5)).build(), box_room(matte(0.5), shift=SIZE[0] + 0.1).build()


@pytest.fixture(scope="module")
def lamps() -> tuple[Mesh, Mesh, Mesh]:
    """Two of the room, near its ends, and one of the other room."""
    one, two, other = (ceiling_lamp(x, 1.5, 0.4, SIZE[1] - 0.01) for x in (1.0, 3.0, SIZE[0] + 2.0))
    return one, two, other


def test_lamps_behind_a_wall_keep_the_least_share_and_those_of_the_room_share_the_rest(
    rooms: tuple[Mesh, Mesh], lamps: tuple[Mesh, Mesh, Mesh]
) -> None:
    found = weights(rooms, lamps, (1.0, 2.0, 7.0), HERE)
    assert found.sum() == pytest.approx(1.0)
    assert found[2] == pytest.approx(LEAST * 0.7)
    # By symmetry they light the room in proportion to their power.
    assert found[1] / found[0] == pytest.approx(2.0, rel=0.15)
    assert np.array_equal(found, weights(rooms, lamps, (1.0, 2.0, 7.0), HERE))


def test_a_lamp_that_shines_through_a_doorway_is_tried_more_often(lamps: tuple[Mesh, Mesh, Mesh]) -> None:
    x, y, z = SIZE
    open_room = MeshBuilder()
    for corners in (
        [(0, 0, z), (x, 0, z), (x, 0, 0), (0, 0, 0)],
        [(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)],
        [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)],
        [(x, 0, z), (0, 0, z), (0, y, z), (x, y, z)],
        [(0, 0, z), (0, 0, 0), (0, y, 0), (0, y, z)],
        [(x, 0, 0), (x, 0, z - 0.9), (x, y, z - 0.9), (x, y, 0)],  # the rest of the wall is open
    ):
        open_room.quad(np.array(corners), matte(0.5))
    found = weights([open_room.build()], lamps, (1.0, 1.0, 1.0), HERE)
    assert LEAST / 3 * 1.2 < found[2] < 0.5 * found[:2].min()


def test_without_a_room_or_any_light_in_it_power_alone_counts(
    rooms: tuple[Mesh, Mesh], lamps: tuple[Mesh, Mesh, Mesh]
) -> None:
    assert weights(rooms, lamps, (1.0, 2.0, 7.0), None) == pytest.approx([0.1, 0.2, 0.7])
    assert weights(rooms, lamps[2:], (1.0,), HERE) == pytest.approx([1.0])
    dark = weights(rooms, [lamps[2], ceiling_lamp(SIZE[0] + 1.0, 1.5, 0.4, SIZE[1] - 0.01)], (1.0, 3.0), HERE)
    assert dark == pytest.approx([0.25, 0.75])
    assert len(lamp_weights([], Tracer(rooms[0].positions), HERE)) == 0
