"""The sun in a scan: found from the patch that it makes on the floor, and shining on what is placed in it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Room, ScanLight
from generators.lighting.lit_scene import LitScene
from generators.lighting.scan_light import estimate
from generators.lighting.scan_sun import beam_of
from generators.lighting.sun import sun_light

Array = NDArray[np.float64]

#: The room and the window, a hole in the wall x = 0: lowest and highest y and z (m).
ROOM = Room("living_room", (0.0, 0.0, 0.0), (4.0, 2.5, 3.5))
HOLE = ((0.9, 2.1), (1.0, 2.2))
SUN = np.array([-0.7, 0.6, 0.25]) / np.linalg.norm([-0.7, 0.6, 0.25])
#: Side of the pieces of the surface (m).
CELL = 0.1


def in_sun(points: Array, direction: Array = SUN) -> NDArray[np.bool_]:
    """Whether points (N, 3) see the sun through the hole."""
    at = points - points[:, :1] / direction[0] * direction
    (y0, y1), (z0, z1) = HOLE
    return (at[:, 1] > y0) & (at[:, 1] < y1) & (at[:, 2] > z0) & (at[:, 2] < z1)


def room(bright: NDArray[np.bool_], *, ceiling: bool = True) -> Part:
    """The scan of the room; ``bright``: which pieces of its floor (40 × 35) look like in the sun."""
    dark, white, wall = (Material(f"{g}", "plaster", (g, g, g)) for g in (0.12, 0.995, 0.4))
    builder = MeshBuilder()
    x1, y1, z1 = ROOM.high
    for i, x in enumerate(np.arange(0, x1 - 1e-6, CELL)):
        for j, z in enumerate(np.arange(0, z1 - 1e-6, CELL)):
            corners = [(x, 0, z + CELL), (x + CELL, 0, z + CELL), (x + CELL, 0, z), (x, 0, z)]
            builder.quad(corners, white if bright[i, j] else dark)
    if ceiling:
        builder.quad([(0, y1, 0), (x1, y1, 0), (x1, y1, z1), (0, y1, z1)], wall)
    builder.quad([(0, 0, 0), (x1, 0, 0), (x1, y1, 0), (0, y1, 0)], wall)
    builder.quad([(x1, 0, z1), (0, 0, z1), (0, y1, z1), (x1, y1, z1)], wall)
    builder.quad([(x1, 0, 0), (x1, 0, z1), (x1, y1, z1), (x1, y1, 0)], wall)
    (a, b), (c, d) = HOLE
    for low, high in (((0, 0), (a, z1)), ((b, 0), (y1, z1)), ((a, 0), (b, c)), ((a, d), (b, z1))):
        (p, q), (r, s) = low, high
        builder.quad([(0, p, s), (0, p, q), (0, r, q), (0, r, s)], wall)
    return Part("room", builder.build())


def floor() -> Array:
    """(40, 35, 3) middles of the floor's pieces."""
    x, z = np.meshgrid((np.arange(40) + 0.5) * CELL, (np.arange(35) + 0.5) * CELL, indexing="ij")
    return np.stack([x, np.zeros_like(x), z], axis=-1)


def look(bright: NDArray[np.bool_], *, ceiling: bool = True) -> tuple[LitScene, ScanLight]:
    lit = LitScene.of((room(bright, ceiling=ceiling),), [True])
    return lit, estimate(lit, (ROOM,))


@pytest.mark.parametrize("ceiling", [True, False])
def test_the_sun_is_where_its_patch_says_and_shines_there_alone(ceiling: bool) -> None:
    places = floor()
    lit, light = look(in_sun(places.reshape(-1, 3)).reshape(40, 35), ceiling=ceiling)
    assert light.sun is not None
    assert np.degrees(np.arccos(light.sun.direction @ SUN)) < 3.0
    sun = beam_of(light, (ROOM,), lit.surfaces, np.ones(len(lit.surfaces.triangles), dtype=bool))
    assert sun is not None
    points = (places[2:-2:3, 2:-2:3].reshape(-1, 3) + [0.0, 0.1, 0.0]).astype(np.float32)
    up = np.tile(np.array([0.0, 1.0, 0.0], dtype=np.float32), (len(points), 1))
    across = np.zeros((len(points), 2, 3), dtype=np.float32)
    found = sun_light(sun, np.zeros(len(points), dtype=np.int32), points, up, across, lit.tracer, 16).max(axis=1)
    expected = light.sun.radiance.max() * light.sun.direction[1]
    true = in_sun(points.astype(np.float64))
    # A direction that is off by some degrees moves the edge by some centimetres.
    assert np.mean((found > expected / 2) == true) > 0.9
    assert found[true].max() == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_bright_things_that_no_window_explains_are_no_sun() -> None:
    """A long white carpet, stripes, and a floor that is all white."""
    carpet, stripes, white = (np.zeros((40, 35), dtype=bool) for _ in range(3))
    carpet[20:24, 2:33] = True
    stripes[:, ::5] = True
    white[:] = True
    for bright in (carpet, stripes, white):
        assert look(bright)[1].sun is None
