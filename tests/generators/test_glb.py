"""The exported file agrees with the camera's view: same shape, same displayed colours, no other rooms."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.scene import LightMap, Material, Mesh, Part, Scene, StageFile, Texture
from generators.core.tone import develop, srgb_decode
from generators.vision.atlas import MARGIN, bake_atlas
from generators.vision.embree import EmbreeBackend, warm_up
from generators.vision.glb import write_glb
from generators.vision.tables import build_tables
from tests.support.flats import furnish, looks, psnr, render, small_flat, without_reflections

CAMERA = Intrinsics.from_fov(252)


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


def as_scan(path: Path, rooms: Scene) -> Scene:
    """The file read back as a scan, whose textures are display light."""
    return replace(rooms, parts=(Part("scan", load_mesh(path)),), stage=StageFile(path))


def document(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk of a GLB, its frame checked on the way."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    rest, binary = struct.unpack_from("<I4s", data, 20 + size)
    assert binary == b"BIN\0"
    assert 20 + size + 8 + rest == len(data)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def pictures(path: Path) -> list[NDArray[np.uint8]]:
    """The embedded pictures, RGB."""
    tree, binary = document(path)
    views = [tree["bufferViews"][image["bufferView"]] for image in tree["images"]]
    blocks = [binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]] for view in views]
    return [cv2.imdecode(np.frombuffer(block, dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1] for block in blocks]


def quad(material: Material, x: float = 0.0, side: float = 2.0) -> Mesh:
    """A square facing +Z with its lower left corner at (x, 0, 0), its texture fitted to it."""
    corners = [[x, 0, 0], [x + side, 0, 0], [x + side, side, 0], [x, side, 0]]
    return MeshBuilder().quad(corners, material, fit=True).build()


def lit(mesh: Mesh, texels: NDArray[np.float64]) -> Part:
    return Part("quad", mesh, light=LightMap(mesh.uv, texels.astype(np.float16)))


# --- a whole home ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_furnished_flat_looks_the_same_from_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, placements = furnish(small_flat())
    path = tmp_path / "flat.glb"
    scene = without_reflections(scene)
    write_glb(scene, path)
    poses = looks(scene, np.array(placements[0].source_position))
    there = render(EmbreeBackend(), scene, poses, CAMERA)
    back = render(EmbreeBackend(), as_scan(path, scene), poses, CAMERA)
    quality = [psnr(a.rgb, b.rgb) for a, b in zip(there, back, strict=True)]
    with capsys.disabled():
        print(
            f"\n  exported flat, {path.stat().st_size / 1e6:.1f} MB: PSNR {min(quality):.1f} to {max(quality):.1f} dB"
        )
    assert min(quality) > 40
    for a, b in zip(there, back, strict=True):
        np.testing.assert_array_equal(a.depth, b.depth)


@pytest.mark.slow
def test_shape_and_acoustic_materials_survive(tmp_path: Path) -> None:
    scene, path = small_flat(), tmp_path / "flat.glb"
    write_glb(scene, path, texel=0.05)
    mesh = load_mesh(path)
    triangles = np.concatenate([part.mesh.positions for part in scene.parts]).reshape(-1, 9)
    found = mesh.positions.reshape(-1, 9)
    assert np.array_equal(found[np.lexsort(found.T)], triangles[np.lexsort(triangles.T)])
    area: dict[str, float] = {}
    for part in scene.parts:
        for label, size in areas(part.mesh).items():
            area[label] = area.get(label, 0.0) + size
    # A file's reader has fewer words: parquet is wood to it.
    area["wood"] += area.pop("parquet", 0.0)
    assert areas(mesh) == pytest.approx(area, rel=1e-4)
    assert len(mesh.materials) < 40, "one material per picture"


def areas(mesh: Mesh) -> dict[str, float]:
    """Square metres by acoustic label."""
    edges = np.diff(mesh.positions.astype(np.float64), axis=1)
    size = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    labels = np.array([material.acoustic for material in mesh.materials])[mesh.face_material]
    return {str(label): float(size[labels == label].sum()) for label in np.unique(labels)}


@pytest.mark.slow
def test_the_same_scene_gives_the_same_bytes(tmp_path: Path) -> None:
    scene = small_flat()
    for name in ("one.glb", "two.glb"):
        write_glb(scene, tmp_path / name, texel=0.05)
    assert (tmp_path / "one.glb").read_bytes() == (tmp_path / "two.glb").read_bytes()


@pytest.mark.slow
def test_the_document_is_gltf_with_unlit_materials_seen_from_both_sides(tmp_path: Path) -> None:
    path = tmp_path / "flat.glb"
    write_glb(small_flat(), path, texel=0.05)
    tree, binary = document(path)
    assert tree["asset"]["version"] == "2.0"
    assert tree["extensionsUsed"] == ["KHR_materials_unlit"]
    assert tree["buffers"] == [{"byteLength": len(binary)}]
    for material in tree["materials"]:
        assert material["doubleSided"]
        assert "KHR_materials_unlit" in material["extensions"]
    for view in tree["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= len(binary)
    for mesh in tree["meshes"]:
        (primitive,) = mesh["primitives"]
        accessors = {name: tree["accessors"][number] for name, number in primitive["attributes"].items()}
        count = {accessor["count"] for accessor in accessors.values()}
        assert set(accessors) == {"POSITION", "NORMAL", "TEXCOORD_0"}
        assert len(count) == 1
        indices = tree["accessors"][primitive["indices"]]
        assert indices["max"][0] == count.pop() - 1
        assert indices["count"] % 3 == 0
    assert max(max(picture.shape) for picture in pictures(path)) <= 4096


# --- colours in closed form -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_texels_hold_exposed_toned_light_times_colour_plus_emission(tmp_path: Path) -> None:
    colour, emission, level = np.array([0.8, 0.5, 0.9]), np.array([0.0, 0.03, 0.2]), 170
    texture = Texture("flat", np.full((256, 256, 3), level, dtype=np.uint8))
    material = Material("paint", "plaster", colour=tuple(colour), texture=texture, emission=tuple(emission))
    ramp = np.array([0.1, 0.4, 1.6, 0.6])[None, :, None] * np.array([1.0, 0.7, 0.5])
    ramp = ramp.repeat(4, axis=0)
    scene = Scene("ramp", (lit(quad(material), ramp),), (), (), exposure=1.7)
    path = tmp_path / "ramp.glb"
    write_glb(scene, path, texel=0.01)
    (page,) = pictures(path)
    row = page[MARGIN + 100, MARGIN : MARGIN + 200].astype(int)
    at = (np.arange(200) + 0.5) / 200 * 4 - 0.5
    light = np.stack([np.interp(at, np.arange(4), ramp[0, :, channel].astype(np.float16)) for channel in range(3)], 1)
    expected = develop(1.7 * (colour * srgb_decode(level / 255) * light + emission)).astype(int)
    assert np.abs(row - expected).max() <= 1
    margin = page[MARGIN + 100, [0, MARGIN + 200 + MARGIN - 1]].astype(int)
    assert np.abs(margin - expected[[0, -1]]).max() <= 1, "beyond the rim its colour goes on"


@pytest.mark.parametrize("staged", [False, True])
def test_what_has_no_light_keeps_its_texture_and_coordinates(tmp_path: Path, staged: bool) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (16, 24, 3), dtype=np.uint8)
    mesh = quad(Material("photo", "paper", texture=Texture("photo", pixels)))
    mesh = replace(mesh, uv=(mesh.uv * 3.5 - 0.7).astype(np.float32))
    path = tmp_path / "photo.glb"
    stage = StageFile(tmp_path / "scan.glb") if staged else None
    write_glb(Scene("photo", (Part("photo", mesh),), (), (), stage=stage), path)
    back = load_mesh(path)
    assert back.materials[0].texture is not None
    # A scan's own picture is display light already; anything else goes through the tone curve.
    expected = pixels if staged else develop(srgb_decode(pixels / 255.0))
    np.testing.assert_array_equal(back.materials[0].texture.pixels, expected)
    order, again = np.argsort(mesh.positions[:, :, 0].sum(axis=1)), np.argsort(back.positions[:, :, 0].sum(axis=1))
    np.testing.assert_allclose(back.uv[again], mesh.uv[order], atol=1e-6)
    assert back.materials[0].acoustic == "paper"


def test_what_is_shown_in_place_of_a_lamp_is_radiance_whatever_lights_it(tmp_path: Path) -> None:
    view = Material("view", "glass", emission=(50, 50, 50), shown=(0.6, 0.5, 0.4))
    path = tmp_path / "view.glb"
    write_glb(Scene("view", (lit(quad(view), np.full((4, 4, 3), 0.2)),), (), (), exposure=3.0), path)
    (picture,) = pictures(path)
    assert np.array_equal(np.unique(picture.reshape(-1, 3), axis=0), [develop([1.8, 1.5, 1.2])])


def test_the_view_behind_a_pane_is_as_large_in_a_file_as_it_is_seen_from_two_metres(tmp_path: Path) -> None:
    stripes = np.zeros((64, 64, 3), dtype=np.uint8)
    stripes[:, ::8] = stripes[::8] = 255
    view = Material("view", "glass", texture=Texture("view", stripes), shown=(1.0, 1.0, 1.0), view_distance=30.0)
    pane = quad(view)
    # The middle of the picture's height is level with the eye; it is 40 m wide and high.
    uv = (pane.positions[..., :2] - pane.positions[..., :2].mean(axis=(0, 1))) / 40 + np.array([0.0, 0.5])
    scene = Scene("view", (Part("pane", replace(pane, uv=uv.astype(np.float32))),), (), ())
    path = tmp_path / "view.glb"
    write_glb(scene, path)
    middle = scene.parts[0].mesh.positions.mean(axis=(0, 1))
    pose = Pose.from_yaw((float(middle[0]), float(middle[1]), float(middle[2]) + 2.0), 0.0)
    there, back = (render(EmbreeBackend(), each, [pose], CAMERA)[0].rgb for each in (scene, as_scan(path, scene)))
    assert there.std() > 20
    assert psnr(there, back) > 30, "another scale gives about 10 dB"


# --- charts ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=25)
@given(st.integers(1, 40), st.sampled_from([0.004, 0.011, 0.05]), st.integers(0, 1 << 16))
def test_no_chart_takes_colour_from_its_neighbours(count: int, texel: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    colours = rng.uniform(0.1, 0.9, (count, 3))
    parts = []
    for index, colour in enumerate(colours):
        side = float(rng.uniform(0.01, 0.5))
        material = Material(f"m{index}", "plaster", colour=tuple(float(c) for c in colour))
        parts.append(lit(quad(material, x=float(index), side=side), np.full((3, 3, 3), 0.5)))
    tables, triangles = build_tables(Scene("many", tuple(parts), (), ()))
    atlas = bake_atlas(tables, triangles, np.arange(2 * count), texel=texel, side=256)
    assert max(max(page.shape) for page in atlas.pages) <= 256
    expected = develop(0.5 * colours)
    for face in range(2 * count):
        page = atlas.pages[atlas.page[face]]
        corners = atlas.uv[face] * np.array(page.shape[1::-1])
        weights = rng.dirichlet(np.ones(3), 30)
        at = weights @ corners
        # All that bilinear look-up there touches, and one texel further for a mip level.
        for step in np.ndindex(4, 4):
            column, row = (np.floor(at - 0.5).astype(int) + np.array(step) - 1).T
            seen = page[np.clip(row, 0, page.shape[0] - 1), np.clip(column, 0, page.shape[1] - 1)]
            assert np.abs(seen.astype(int) - expected[face // 2].astype(int)).max() <= 1


def test_sides_that_share_a_place_in_the_light_map_do_not_share_texels(tmp_path: Path) -> None:
    # A closed leaf flattened onto itself: front and back have the same corners there, the other way round.
    front, back = Material("front", "paper", colour=(0.8, 0.1, 0.1)), Material("back", "paper", colour=(0.1, 0.1, 0.8))
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    mesh = MeshBuilder().quad(corners, front, fit=True).quad(corners[::-1] - [0, 0, 0.01], back, fit=True).build()
    uv = mesh.positions[..., :2].astype(np.float32)
    scene = Scene("leaf", (Part("leaf", mesh, light=LightMap(uv, np.ones((4, 4, 3), dtype=np.float16))),), (), ())
    path = tmp_path / "leaf.glb"
    write_glb(scene, path)
    both = as_scan(path, scene)
    for z, yaw in ((2.0, 0.0), (-2.0, np.pi)):
        pose = Pose.from_yaw((0.5, 0.5, z), yaw)
        (there,), (again,) = (render(EmbreeBackend(), s, [pose], CAMERA) for s in (scene, both))
        assert psnr(there.rgb, again.rgb) > 50


def test_only_the_chosen_parts_are_written(tmp_path: Path) -> None:
    parts = tuple(Part(f"q{n}", quad(Material("m", "wood"), x=3.0 * n), instance_id=n) for n in range(3))
    scene = Scene("three", parts, (), ())
    write_glb(scene, tmp_path / "one.glb", parts=parts[1:2])
    np.testing.assert_allclose(load_mesh(tmp_path / "one.glb").bounds, parts[1].mesh.bounds)


@pytest.mark.parametrize("texel", [0.0, -1.0, float("nan"), float("inf")])
def test_a_texel_that_is_no_length_is_refused(tmp_path: Path, texel: float) -> None:
    scene = Scene("one", (Part("q", quad(Material("m", "wood"))),), (), ())
    with pytest.raises(Avs3dError, match=r"texel .* expected"):
        write_glb(scene, tmp_path / "one.glb", texel=texel)
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    scene = Scene("one", (Part("q", quad(Material("m", "wood"))),), (), ())
    with pytest.raises(Avs3dError) as caught:
        write_glb(scene, tmp_path / "file" / "one.glb")
    assert "\n" not in str(caught.value)
    assert "one.glb" in str(caught.value)
