"""Sunlight that a shiny floor throws on walls: how much there is of it, and where it goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from generators.assets.shapes import MeshBuilder
from generators.core.albedos import COSINES, DIELECTRIC, ROUGHNESSES, albedo_table
from generators.core.rays import Tracer
from generators.core.scene import Material, Part
from generators.lighting.blocks import make_blocks
from generators.lighting.glints import glints
from generators.lighting.sun import Sun
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, Texels, rasterise
from generators.lighting.unwrap import unwrap

#: Cosine of the sun's angle to the zenith: the middle of an entry of `albedo_table`.
COSINE = 15.5 / COSINES
TEXEL = 0.05


def thrown(roughness: float, metallic: float = 0.0) -> tuple[Texels, NDArray[np.float32], NDArray[np.bool_]]:
    """What a floor of 1 m in the sun, which comes from +X, throws on the inside of a box of 4 m round it."""
    tile = Material("tile", "tile", (0.0, 0.0, 0.0), roughness=roughness, metallic=metallic)
    floor = MeshBuilder().quad([(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, -0.5), (-0.5, 0, -0.5)], tile).build()
    box = MeshBuilder().box((4.0, 4.0, 4.0), (0, 1.9, 0), Material("plaster", "plaster", (0.5,) * 3)).build()
    room = replace(box, positions=np.ascontiguousarray(box.positions[:, ::-1]), normals=-box.normals)
    surfaces = LitSurfaces.of([Part("floor", floor), Part("room", room)])
    sheet = Sheet.of([unwrap(mesh.positions, TEXEL, normals=mesh.normals) for mesh in (floor, room)])
    texels = rasterise(surfaces, sheet)
    on_floor = surfaces.part[texels.face] == 0
    direction = np.array([np.sqrt(1 - COSINE**2), COSINE, 0.0])
    sun = Sun(direction, np.ones(3, dtype=np.float32), np.zeros(len(surfaces.triangles), dtype=bool))
    sunlight = np.where(on_floor[:, None], np.float32(1.0), np.float32(0.0)).repeat(3, axis=1)
    blocks = make_blocks(surfaces, sheet, texels)
    light, _, sends = glints(surfaces, sheet, texels, blocks, sunlight, sun, Tracer(surfaces.triangles))
    return texels, light[:, 0], sends & on_floor


@pytest.mark.parametrize("row", [3, 12])
def test_a_floor_throws_the_part_of_sunlight_that_its_surface_reflects_at_this_angle(row: int) -> None:
    texels, light, sends = thrown(row / (ROUGHNESSES - 1))
    albedo = float(albedo_table()[row, 15] @ np.array([DIELECTRIC, 1.0]))
    assert (light * texels.area).sum() == pytest.approx(albedo * texels.area[sends].sum(), rel=0.03)


def test_it_goes_where_a_mirror_would_send_it() -> None:
    """From the floor's middle, 2 m from the wall, it arrives at a height of 2 m / tan θ."""
    texels, light, _ = thrown(0.1)
    middle = np.average(texels.position, axis=0, weights=light * texels.area)
    assert middle == pytest.approx([-2.0, 2.0 * COSINE / np.sqrt(1 - COSINE**2), 0.0], abs=0.06)
    assert light[texels.position[:, 0] > 0.5].max() < 1e-3 * light.max()


def test_neither_rough_nor_metal_surfaces_throw_light() -> None:
    for roughness, metallic in ((0.9, 0.0), (0.1, 1.0)):
        _, light, sends = thrown(roughness, metallic)
        assert not sends.any()
        assert light.max() == 0.0
