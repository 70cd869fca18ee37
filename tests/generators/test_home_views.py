"""Views of homes for the documentation's sheet: what is chosen, and how the sheet is put together."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from benchmarks.home_views import GAP, choose_view, entropy, home_plans, sheet, write_jpeg
from benchmarks.unseen_homes import used_seeds
from generators.assets.shapes import MeshBuilder
from generators.core.scene import LightMap, Part, Room, Scene
from tests.generators.test_light import SIZE, box_room, matte


def room_with_a_block() -> Scene:
    room = Part("shell", box_room(matte(0.5)).build())
    block = Part("block", MeshBuilder().box((0.6, 1.2, 0.6), (3.4, 0.6, 0.5), matte(0.4)).build())
    light = LightMap(np.zeros((1, 3, 2), np.float32), np.ones((2, 2, 3), np.float16))
    parts = [
        Part(part.name, part.mesh, light=LightMap(np.zeros_like(part.mesh.uv), light.texels)) for part in (room, block)
    ]
    return Scene("t", tuple(parts), (Room("hall", (0.0, 0.0, 0.0), SIZE),), ())


def test_entropy_of_equal_shares_is_their_logarithm() -> None:
    scene = room_with_a_block()
    shell, block = 0, len(scene.parts[0].mesh.positions)
    face = np.array([[shell, shell + 1, block, block + 1], [-1, -1, -1, -1]], np.int32)
    assert entropy(scene, face) == pytest.approx(1.0)
    assert entropy(scene, face[:, :2]) == 0.0


def test_a_view_shows_what_there_is_to_see_and_is_the_same_for_the_same_seed() -> None:
    scene = room_with_a_block()
    views = [choose_view(scene, 1, "hall", np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert views[0] == views[1] != views[2]
    for view in views:
        way = np.array([3.4, 0.6, 0.5]) - view.position
        ahead = -view.pose.rotation_matrix[:, 2]
        assert way @ ahead / np.linalg.norm(way) > np.cos(np.radians(55)), "the block is out of view"


def test_no_manifest_uses_the_homes() -> None:
    seeds = {plan.scan.seed for plan in home_plans()}
    assert len(seeds) == 5
    assert not seeds & used_seeds()


def test_a_sheet_has_a_block_for_each_home_and_a_row_for_each_folder(tmp_path: Path) -> None:
    for value, folder in ((40, "before"), (200, "now")):
        (tmp_path / folder).mkdir()
        for home in (1, 2):
            for view in (1, 2, 3):
                picture = np.full((60, 60, 3), value + home + 10 * view, np.uint8)
                cv2.imwrite(str(tmp_path / folder / f"home_{home}-{view}.png"), picture)
    folders = [tmp_path / "before", tmp_path / "now"]
    picture = sheet(folders, side=20)
    assert picture.shape == (4 * (20 + GAP) + 2 * GAP, 3 * (20 + GAP), 3)
    rows = [10, 10 + 20 + GAP, 10 + 2 * (20 + GAP) + 2 * GAP]
    assert [int(picture[row, 10 + 20 + GAP, 0]) for row in rows] == [61, 221, 62]
    (tmp_path / "now" / "home_2-1.png").unlink()
    with pytest.raises(Avs3dError, match="render the same views"):
        sheet(folders, side=20)


def test_a_jpeg_has_the_best_quality_that_fits(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (128, 128, 3), dtype=np.uint8)
    sizes = []
    for largest in (60_000, 10_000):
        write_jpeg(tmp_path / "sheet.jpg", noise, largest)
        sizes.append((tmp_path / "sheet.jpg").stat().st_size)
        assert sizes[-1] <= largest
    assert sizes[0] > sizes[1]
    with pytest.raises(Avs3dError, match="larger than 100 bytes"):
        write_jpeg(tmp_path / "sheet.jpg", noise, 100)
