"""Statistics of pictures against pictures whose statistics are known, and the colour of a grey card."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json
from benchmarks.picture_statistics import (
    card_colours,
    is_neutral,
    main,
    noise,
    spectral_slope,
    statistics,
    summary,
    views_of,
)
from generators.assets.shapes import MeshBuilder
from generators.core.scene import NEUTRAL, Material, Room
from generators.lighting.bake import bake
from tests.generators.test_light import box_room, matte, scene_of


def cloud(slope: float, side: int, rng: np.random.Generator) -> np.ndarray:
    """A picture whose power falls with the frequency to the power ``slope``."""
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side))
    frequency[0, 0] = 1.0
    picture = np.fft.ifft2(np.fft.fft2(rng.standard_normal((side, side))) * frequency ** (slope / 2)).real
    return np.asarray(0.5 + 0.1 * picture / picture.std())


@pytest.mark.parametrize("side", [126, 252, 504])
@pytest.mark.parametrize("slope", [0.0, -1.0, -2.0, -3.0])
def test_slope_of_pictures_whose_slope_is_known(slope: float, side: int) -> None:
    rng = np.random.default_rng(3)
    found = np.mean([spectral_slope(cloud(slope, side, rng)) for _ in range(12)])
    assert found == pytest.approx(slope, abs=0.12)


def test_slope_depends_neither_on_brightness_and_contrast_nor_on_what_lies_outside_of_the_square() -> None:
    picture = cloud(-2.0, 128, np.random.default_rng(4))
    slope = spectral_slope(picture)
    assert spectral_slope(0.3 * picture + 0.2) == pytest.approx(slope, abs=1e-6)
    wide = np.pad(picture, ((0, 0), (40, 40)))
    assert spectral_slope(wide) == pytest.approx(slope, abs=1e-9)
    with pytest.raises(Avs3dError, match="expected 64 or more"):
        spectral_slope(picture[:50])


@pytest.mark.parametrize("sigma", [1.0, 3.0, 8.0])
def test_noise_on_a_ramp_is_that_which_was_added(sigma: float) -> None:
    rng = np.random.default_rng(5)
    ramp = np.linspace(60.0, 180.0, 256) + sigma * rng.standard_normal((256, 256))
    assert noise(np.rint(ramp) / 255) == pytest.approx(sigma, rel=0.2)


def test_noise_is_not_measured_where_the_picture_is_clipped() -> None:
    rng = np.random.default_rng(6)
    picture = np.clip(np.rint(128 + 4 * rng.standard_normal((128, 128))), 0, 255)
    picture[:, :96] = 255
    assert noise(picture / 255) == pytest.approx(4.0, rel=0.2)
    assert np.isnan(noise(np.ones((64, 64))))


def test_colour_saturation_and_shares_of_a_picture_of_four_fields() -> None:
    picture = np.zeros((128, 128, 3), np.uint8)
    picture[:64, :64] = (255, 255, 255)
    picture[:64, 64:] = (255, 0, 0)
    picture[64:, :64] = (100, 50, 50)
    found = statistics(picture)
    assert (found["red"], found["green"], found["blue"]) == ((255 + 255 + 100) / 4, 305 / 4, 305 / 4)
    assert found["clipped"] == 0.5
    assert found["white"] == found["black"] == 0.25
    assert found["saturation"] == pytest.approx((0 + 1 + 0.5 + 0) / 4)
    levels = np.array([1.0, 0.2126, (100 * 0.2126 + 50 * 0.7874) / 255, 0.0])
    assert found["contrast"] == pytest.approx(levels.std())


def test_figures_of_a_folder_are_added_to_those_of_other_names(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    rng = np.random.default_rng(7)
    for number in range(3):
        grey = np.clip(255 * cloud(-2.0, 96, rng), 0, 255).astype(np.uint8)
        cv2.imwrite(str(tmp_path / "pictures" / f"{number}.png"), np.repeat(grey[..., None], 3, axis=2))
    record = tmp_path / "figures.json"
    for name in ("one", "other"):
        command = ["--pictures", str(tmp_path / "pictures"), "--name", name, "--json", str(record)]
        done = CliRunner().invoke(main, command, catch_exceptions=False)
        assert done.exit_code == 0
    figures = read_json(record)
    assert figures["one"] == figures["other"]
    assert figures["one"]["pictures"] == 3
    assert figures["one"]["slope"] == pytest.approx(-2.0, abs=0.3)
    assert "| other | 3 |" in done.output
    unknown = CliRunner().invoke(main, ["--homes", "1", "--name", "third", "--json", str(record)])
    assert unknown.exit_code == 2
    assert "to add --homes to the figures of --name" in unknown.output
    with pytest.raises(Avs3dError, match="no pictures"):
        summary([])


def test_pictures_that_are_measured_again_leave_the_rows_cards(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "one.png"), np.full((64, 64, 3), 90, np.uint8))
    record, card = tmp_path / "record.json", {"home_1": {"all rooms": {"encoded": [1.0, 1.0]}}}
    record.write_text(json.dumps({"mine": {"pictures": 3, "grey card": card}}))
    command = ["--pictures", str(tmp_path), "--name", "mine", "--json", str(record)]
    assert CliRunner().invoke(main, command, catch_exceptions=False).exit_code == 0
    found = read_json(record)["mine"]
    assert found["pictures"] == 1
    assert found["grey card"] == card


def test_views_of_a_panorama_look_where_they_should(tmp_path: Path) -> None:
    # Columns tell the direction, rows the elevation.
    column = np.repeat(np.arange(512)[None] // 2, 256, axis=0)
    row = np.repeat(np.arange(256)[:, None], 512, axis=1)
    cv2.imwrite(str(tmp_path / "sky.png"), np.stack([column, row, row], axis=2).astype(np.uint8))
    views = list(views_of(tmp_path / "sky.png"))
    assert len(views) == 8
    middle = views[2][125:127, 125:127].reshape(-1, 3).mean(axis=0)  # 90° to the right, 10° down; channels are RGB
    assert middle == pytest.approx([128 + 256 / 18, 128 + 256 / 18, 64], abs=1.5)
    left = views[2][125:127, :2].reshape(-1, 3).mean(axis=0)
    assert left[2] == pytest.approx(32, abs=2.0)
    with pytest.raises(Avs3dError, match="twice as wide as high"):
        list(views_of(Path(__file__)))


@pytest.mark.parametrize("lamp", [(6.0, 6.0, 6.0), (8.0, 6.0, 4.0)])
def test_a_grey_card_has_the_colour_of_the_light(lamp: tuple[float, float, float]) -> None:
    shade = Material("lamp", "plastic", (0.0, 0.0, 0.0), emission=lamp)
    down = MeshBuilder().quad([(1.5, 2.4, 1), (2.5, 2.4, 1), (2.5, 2.4, 2), (1.5, 2.4, 2)], shade).build()
    room = scene_of(box_room(matte(0.3)).build(), down, rooms=(Room("hall", (0, 0, 0), (4, 2.5, 3)),))
    lit = bake(room, quality="preview", workers=1)
    balanced = card_colours(lit, "hall").mean(axis=0)
    assert is_neutral({"encoded": [balanced[0] / balanced[1], balanced[2] / balanced[1]]})
    colours = card_colours(replace(lit, rooms=(replace(lit.rooms[0], white=NEUTRAL),)), "hall")
    assert len(colours) == 5
    red, green, blue = colours.mean(axis=0)
    neutral = lamp[0] == lamp[2]
    assert is_neutral({"encoded": [red / green, blue / green]}) == neutral
    assert (red > 1.15 * green > 1.3 * blue) != neutral
