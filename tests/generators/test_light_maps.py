"""How fine light maps are, and what their texels stand for: rounded edges, surfaces that carry objects, small parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from generators.assets.shapes import MeshBuilder
from generators.core.rays import Tracer
from generators.core.scene import Part, Room, Scene, Support
from generators.lighting import resolution
from generators.lighting.bake import QUALITIES, bake, insert
from generators.lighting.resolution import lay_out
from generators.lighting.smoothing import despeckle
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, rasterise
from tests.generators.test_light import LAMP, area_of, box_room, ceiling_lamp, matte, samples, scene_of

SIDE = 2.0
FINENESS = QUALITIES["standard"].fineness


def room_with(*builders: MeshBuilder, quality: str = "standard") -> Scene:
    """A grey room of 2 m with a lamp, and meshes in it, baked; they come first."""
    meshes = [builder.build() for builder in builders]
    shell = box_room(matte(0.6), (SIDE, SIDE, SIDE)).build()
    return bake(scene_of(*meshes, shell, ceiling_lamp(1.0, 1.0, 0.6, 1.95)), quality=quality, workers=1)


def texel_sides(mesh_part: Part, supports: Sequence[Support]) -> tuple[np.ndarray, np.ndarray]:
    """For each face of a part: the side of its texels (m), and whether it faces up."""
    own = lay_out(mesh_part, (), supports, FINENESS)
    p, uv = mesh_part.mesh.positions.astype(np.float64), own.uv.astype(np.float64)
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    layout = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    world = np.linalg.norm(cross, axis=1)
    large = world > 1e-3
    return np.sqrt(world / np.maximum(layout, 1e-12))[large], (cross[:, 1] > 0.99 * world)[large]


def test_light_of_a_door_is_even_up_to_its_rounded_edge() -> None:
    """The narrow gap between two doors is dark, and the doors beside it are not: nothing stands before them."""
    doors = MeshBuilder()
    for x in (0.748, 1.252):
        doors.box((0.5, 0.7, 0.02), (x, 1.0, 0.3), matte(0.5), bevel=0.003)
    doors.box((1.0, 0.7, 0.2), (1.0, 1.0, 0.185), matte(0.5))
    points, normals, light = samples(room_with(doors).parts[0], 60000)
    front = (normals[:, 2] > 0.9) & (points[:, 2] > 0.309) & (np.abs(points[:, 1] - 1.0) < 0.2)
    away = np.abs(points[:, 0] - 1.0) - 0.002
    rim = light[front & (away > 0.004) & (away < 0.015)].mean()
    inner = light[front & (away > 0.06) & (away < 0.1)].mean()
    assert rim == pytest.approx(inner, rel=0.05)


def test_surfaces_that_carry_objects_have_the_finest_texels() -> None:
    table = MeshBuilder().box((3.0, 0.04, 2.0), (1.5, 0.73, 1.0), matte(0.5)).build()
    top = Support("worktop", "kitchen", (0.1, 0.75, 0.1), (2.8, 0, 0), (0, 0, 1.8), (0, 1, 0), (0, 0, 1))
    sides, up = texel_sides(Part("table", table), (top,))
    assert sides[up] == pytest.approx(FINENESS.finest, rel=0.02)
    assert (sides[~up] > 1.5 * FINENESS.finest).all()
    bare, _ = texel_sides(Part("table", table), ())
    assert (bare > 1.5 * FINENESS.finest).all()


def test_light_of_small_parts_is_that_of_finer_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A box and a jug on the floor: the same light as from light maps with several times as many measured texels."""
    box = MeshBuilder().box((0.12, 0.1, 0.08), (0.7, 0.05, 0.9), matte(0.6), bevel=0.004)
    jug = MeshBuilder().lathe([(0, 0), (0.05, 0), (0.06, 0.1), (0.03, 0.18), (0, 0.18)], matte(0.6), centre=(1.2, 0, 1))
    baked = room_with(box, jug)
    monkeypatch.setattr(resolution, "SMALL", 0.0)
    finer = room_with(box, jug)
    for number in range(2):
        light, reference = (samples(scene.parts[number])[2].mean(axis=1) for scene in (baked, finer))
        cells = [np.prod(scene.parts[number].light.texels.shape) for scene in (baked, finer)]  # type: ignore[union-attr]
        assert cells[0] < 0.7 * cells[1]
        visible = samples(baked.parts[number])[1][:, 1] > -0.5
        error = np.abs(light - reference)[visible] / reference[visible].mean()
        assert np.median(error) < 0.05
        assert np.mean(error) < 0.08
    assert area_of(baked.parts[0].mesh) < 0.07


def lamp_light(points: np.ndarray, tracer: Tracer, side: float, height: float, radiance: float) -> np.ndarray:
    """(N,) light of a square ceiling lamp on a floor's points past what stands there, summed over 64 × 64 points."""
    along = ((np.arange(64) + 0.5) / 64 - 0.5) * side + SIDE / 2
    lamp = np.stack([each.ravel() for each in np.meshgrid(along, [height], along)], axis=1)
    out = []
    for point in points:
        way = lamp - point
        square = (way**2).sum(axis=1)
        origins = np.tile(point + (0.0, 1e-4, 0.0), (len(lamp), 1)).astype(np.float32)
        hidden = tracer.occluded(origins, way.astype(np.float32), np.full(len(lamp), 0.999, dtype=np.float32))
        out.append(radiance / np.pi * (side / 64) ** 2 * (way[:, 1] ** 2 / square**2)[~hidden].sum())
    return np.array(out)


@pytest.mark.parametrize("inserted", [False, True])
def test_contact_shadow_agrees_with_a_sum_over_the_lamp(inserted: bool) -> None:
    """Under a lamp as large as the ceiling, in a black room: the light within 5 cm of a box, of home or inserted."""
    shell, lamp = box_room(matte(0.0), (SIDE, SIDE, SIDE)).build(), ceiling_lamp(1.0, 1.0, 1.9, 1.98)
    box = Part("box", MeshBuilder().box((0.2, 0.3, 0.2), (1.05, 0.15, 1.02), matte(0.0), bevel=0.004).build(), 1)
    room = Room("room", (0.0, 0.0, 0.0), (SIDE, SIDE, SIDE))
    if inserted:
        placed = insert(bake(scene_of(shell, lamp, rooms=(room,)), workers=1), (box,))
    else:
        placed = bake(scene_of(shell, lamp, box.mesh, rooms=(room,)), workers=1)
    points, normals, light = samples(placed.parts[0], 60000)
    gap = np.linalg.norm(np.maximum(np.abs(points[:, [0, 2]] - (1.05, 1.02)) - 0.1, 0.0), axis=1)
    tracer = Tracer(box.mesh.positions)
    for low, high, limit in ((0.002, 0.01, 0.1), (0.01, 0.05, 0.04)):
        near = np.flatnonzero((normals[:, 1] > 0.9) & (gap > low) & (gap < high))[:200]
        truth = lamp_light(points[near], tracer, 1.9, 1.98, LAMP.emission[0])
        assert np.abs(light[near, 0] - truth).mean() < limit * truth.mean()


def test_a_lone_bright_texel_is_no_brighter_than_those_around_it_and_an_edge_of_light_stays() -> None:
    """Two walls side by side in one map, the second one in the light; a beam one texel wide on the first."""
    builder = MeshBuilder()
    for x in (0.0, 1.0):
        builder.quad([(x, 0, 0), (x + 0.6, 0, 0), (x + 0.6, 0.6, 0), (x, 0.6, 0)], matte(0.5))
    part = Part("walls", builder.build())
    surfaces = LitSurfaces.of((part,))
    sheet = Sheet.of([lay_out(part, (), (), FINENESS)])
    texels = rasterise(surfaces, sheet)
    chart = sheet.chart[texels.face]
    assert len(np.unique(chart)) == 2
    true = np.where(texels.position[:, 0] > 0.8, 3.0, 1.0).astype(np.float32)
    beam = (texels.position[:, 0] < 0.6) & (
        np.abs(texels.position[:, 1] - 0.3) < 0.6 * np.linalg.norm(texels.across[0, 1])
    )
    true[beam] = 2.0
    light = np.repeat(true[:, None], 3, axis=1)
    first = texels.position[:, 0] < 0.6
    lone = int(
        np.argmin(np.where(first, np.abs(texels.position[:, 1] - 0.57) + np.abs(texels.position[:, 0] - 0.2), 9))
    )
    speckled = light.copy()
    speckled[lone] = 1.3
    known = np.ones(len(light), dtype=bool)
    np.testing.assert_array_equal(despeckle(surfaces, sheet, texels, light, known), light)
    np.testing.assert_array_equal(despeckle(surfaces, sheet, texels, speckled, known), light)


def lamp_at_ceiling(height: float, side: float) -> MeshBuilder:
    """A frame below the ceiling, open above, and in it a pane that shines to both sides."""
    builder, (x, z), thick, drop = MeshBuilder(), (1.01, 0.99), 0.006, 0.03
    half, y = side / 2, height - drop / 2
    for sign in (-1, 1):
        builder.box((side + thick, drop, thick), (x, y, z + sign * half), matte(0.5))
        builder.box((thick, drop, side - thick), (x + sign * half, y, z), matte(0.5))
    inner, low = half - thick / 2, height - drop
    corners = [(x - inner, low, z - inner), (x + inner, low, z - inner), (x + inner, low, z + inner)]
    corners.append((x - inner, low, z + inner))
    builder.quad(corners, LAMP)
    return builder.quad(np.add(corners, (0.0, 0.004, 0.0))[::-1], LAMP)


def test_the_inside_of_a_lamp_does_not_light_the_ceiling_beside_it() -> None:
    """All of the frame's outside is in its shadow: the ceiling is lit by the floor and the walls alone."""
    side = 0.34
    shell = room_of_a_lamp(side)
    points, normals, light = samples(shell, 200000)
    away = np.abs(points[:, [0, 2]] - (1.01, 0.99)).max(axis=1) - side / 2 - 0.003
    ceiling = normals[:, 1] < -0.9
    beside, farther = (light[ceiling & (away > low) & (away < high)] for low, high in ((0.002, 0.04), (0.2, 0.3)))
    assert len(beside) > 300
    assert beside.max() < 1.5 * farther.mean()


def room_of_a_lamp(side: float) -> Part:
    shell = box_room(matte(0.6), (SIDE, SIDE, SIDE)).build()
    return bake(scene_of(shell, lamp_at_ceiling(SIDE, side).build()), quality="standard", workers=1).parts[0]
