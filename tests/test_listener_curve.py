"""The learning curve of the listener: one real run of one step, its scores, the table and the picture."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports import write_webdataset
from avs3d_bench.files import read_json

pytest.importorskip("torch", reason="torch is not installed: the listener cannot be trained")

from benchmarks import listener_curve
from tests import tiny_scenes

OPTIONS = ("--steps", "1", "--size", "small", "--batch-size", "4", "--accelerator", "cpu", "--precision", "fp32")


def point(homes: int, pair_accuracy: float | None, **tests: Any) -> dict[str, Any]:
    validation = {"class_iou": 0.5, "category_iou": 0.25, "iou": 0.125, "pair_accuracy": pair_accuracy}
    return {"homes": homes, "validation": validation, "tests": tests}


@pytest.mark.slow
def test_a_run_is_made_once_and_scored(tmp_path: Path) -> None:
    keys = (tiny_scenes.FIRST, tiny_scenes.SECOND)
    tiny_scenes.write_sound_scenes(tmp_path / "scenes", frames=9, size=32, keys=keys)
    write_webdataset(tmp_path / "scenes", tmp_path / "shards", workers=1)
    arguments = [str(tmp_path / "shards"), "-o", str(tmp_path / "curve"), "--homes", "1"]
    arguments += ["--test", f"here={tmp_path / 'scenes'}", "--picture", str(tmp_path / "curve.png"), "--", *OPTIONS]
    first = CliRunner().invoke(listener_curve.main, arguments, catch_exceptions=False)
    assert first.exit_code == 0, first.output
    document = read_json(tmp_path / "curve" / listener_curve.CURVE_JSON)
    assert document["options"] == list(OPTIONS)
    (one,) = document["points"]
    assert (one["homes"], one["steps"]) == (1, 1)
    assert set(listener_curve.DRAWN) <= set(one["validation"])
    assert 0 <= one["tests"]["here"]["part_3"]["listen.IoU"] <= 1
    assert "| homes |" in first.output
    weights = tmp_path / "curve/homes-1/listener.safetensors"
    made = weights.stat().st_mtime_ns
    again = CliRunner().invoke(listener_curve.main, arguments, catch_exceptions=False)
    assert again.output == first.output
    assert weights.stat().st_mtime_ns == made


def test_a_run_that_fails_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"homes-2: the training ended without weights \(exit code 2\)"):
        listener_curve.make_run(tmp_path / "none", tmp_path / "homes-2", 2, ["--steps", "0"])


def test_a_row_for_each_number_of_homes_and_a_dash_where_nothing_was_measured() -> None:
    points = [point(12, None), point(47, 0.5, open={"part_1": {"strict.IoU": 0.75}})]
    head, _, few, many = listener_curve.table(points)
    assert head.endswith("| pair accuracy | open, part_1: strict IoU |")
    assert few == "| 12 | 0.500 | 0.250 | 0.125 | – | – |"
    assert many == "| 47 | 0.500 | 0.250 | 0.125 | 0.500 | 0.750 |"


def test_the_curve_is_a_picture_with_the_same_bytes_each_time() -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed: pip install 'avs3d-bench[plot]'")
    drawn = listener_curve.draw([point(12, None), point(47, 0.5)])
    assert drawn == listener_curve.draw([point(12, None), point(47, 0.5)])
    pixels = np.asarray(Image.open(io.BytesIO(drawn)).convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
