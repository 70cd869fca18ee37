"""`avs3d metrics`: folders of PNG masks, by convention, and what is wrong with them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.errors import Avs3dError, UsageError
from evaluators import metrics
from evaluators.cli import metrics as command
from evaluators.reading.convention_names import CONVENTIONS
from evaluators.reading.mask_folders import FolderOptions, _natural, score_folders

GOLDEN = Path(__file__).parents[1] / "golden"
CLIPS = 2


def write(folder: Path, name: str, pixels: np.ndarray) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), pixels)


@pytest.fixture(scope="module")
def arrays() -> dict[str, np.ndarray]:
    with np.load(GOLDEN / "avs_metrics.npz") as found:
        return {name: found[name][: 5 * CLIPS] for name in found}


@pytest.fixture(scope="module")
def folders(arrays: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """truth/, hard/ and soft/ (16 bits) with a subfolder for each clip; ids/ and named/ with class ids."""
    root = tmp_path_factory.mktemp("masks")
    for number in range(5 * CLIPS):
        name = f"clip_{number // 5}/{number % 5 + 8}.png"  # 8, 9, 10: not in the order of text
        probability = 1 / (1 + np.exp(-arrays["logits"][number].astype(np.float64)))
        write(root / "truth", name, arrays["truth"][number] * np.uint8(255))
        write(root / "hard", name, (probability > 0.5) * np.uint8(255))
        write(root / "soft", name, np.round(probability * 65_535).astype(np.uint16))
        write(root / "ids", f"{number}.png", arrays["semantic_truth"][number])
        write(root / "named", f"{number}.png", arrays["semantic_logits"][number].argmax(axis=0).astype(np.uint8))
    return root


@pytest.fixture
def copy(folders: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folders, tmp_path / "copy"))


def score(root: Path, truth: str = "truth", prediction: str = "hard", **options: object):
    return score_folders(root / truth, root / prediction, FolderOptions(**options))  # type: ignore[arg-type]


def test_ours_are_those_of_the_arrays_clip_by_clip(folders: Path, arrays: dict[str, np.ndarray]):
    truth, marked = (a.reshape(CLIPS, 5, *a.shape[1:]) for a in (arrays["truth"], arrays["logits"] > 0))
    found = score(folders)
    assert found.figures == metrics.evaluate(truth, marked)
    assert (found.clips, found.frames, found.order_free) == (CLIPS, 5 * CLIPS, {})
    assert score(folders, prediction="soft", soft=True).figures["AP"] is not None


def test_released_figures_are_those_of_the_arrays(folders: Path, arrays: dict[str, np.ndarray]):
    truth, logits = arrays["truth"], arrays["logits"]
    # 16 bits move a probability by 1e-5 at most, past a threshold or not.
    for name in ("avsbench-s4", "avsbench-ms3"):
        found = score(folders, prediction="soft", soft=True, convention=name)
        assert found.figures == pytest.approx(metrics.avsbench.evaluate(truth, logits), abs=1e-3)
        assert found.order_free == pytest.approx(metrics.avsbench.order_free(truth, logits), abs=1e-3)
    found = score(folders, prediction="soft", soft=True, convention="ref-avs", clips_per_batch=1)
    expected = metrics.ref_avs.evaluate(truth, logits, clips_per_batch=1, frames_per_clip=5)
    assert found.figures == pytest.approx(expected, abs=1e-3)
    found = score(folders, prediction="soft", soft=True, convention="combo")
    probability = 1 / (1 + np.exp(-logits.astype(np.float64)))
    assert found.figures == pytest.approx(metrics.combo.evaluate(truth, probability), abs=1e-3)


def test_masks_of_the_3d_benchmark_are_its_logits(folders: Path, arrays: dict[str, np.ndarray]):
    found = score(folders, convention="3d-avs").figures
    assert found == metrics.avsbench.evaluate(arrays["truth"], arrays["logits"] > 0)
    # A pixel of a mask is certain: its F is not below the all-white one either, but mIoU is the same.
    assert score(folders, convention="avsbench-ms3").figures["mIoU"] == found["mIoU"]


def test_class_ids(folders: Path, arrays: dict[str, np.ndarray]):
    found = score(folders, "ids", "named", convention="avss", classes=6)
    given = arrays["semantic_truth"], arrays["semantic_logits"]
    assert found.figures == metrics.avss.evaluate(*given)
    assert found.order_free == metrics.avss.order_free(*given)
    assert found.figures["mIoU"] < 0.9


def test_names_are_read_with_their_numbers():
    names = ["b/1.png", "a/frame_10.png", "a/frame_9.png", "a10/1.png", "a9/2.png", "a/x.png"]
    assert sorted(names, key=_natural) == [
        "a/frame_9.png", "a/frame_10.png", "a/x.png", "a9/2.png", "a10/1.png", "b/1.png",
    ]  # fmt: skip


def test_files_of_one_folder_are_clips_of_a_given_length(folders: Path, tmp_path: Path):
    for kind in ("truth", "hard"):
        for path in (folders / kind).rglob("*.png"):
            write(tmp_path / kind, f"{path.parent.name}_{path.name}", cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    assert score(tmp_path, frames_per_clip=5).figures == score(folders).figures
    assert score(tmp_path, convention="avsbench-ms3").figures == score(folders, convention="avsbench-ms3").figures
    with pytest.raises(UsageError, match=r"10 frames are no whole clips of 3; --frames-per-clip"):
        score(tmp_path, frames_per_clip=3)


def test_three_equal_channels_and_zero_and_one_are_masks(copy: Path):
    before = score(copy).figures
    for number, path in enumerate(sorted((copy / "hard").rglob("*.png"))):
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), cv2.merge([pixels] * 3) if number % 2 else pixels // 255)
    assert score(copy).figures == before


def test_missing_files_are_named_and_surplus_ones_are_not_looked_at(copy: Path):
    write(copy / "hard", "clip_9/8.png", np.zeros((3, 3), np.uint8))
    assert score(copy).surplus == ("clip_9/8.png",)
    (copy / "hard/clip_1/10.png").unlink()
    with pytest.raises(Avs3dError, match=r"hard: 1 of 10 masks are missing: clip_1/10.png; expected the names of"):
        score(copy)


def test_files_of_other_names_are_paired_by_their_order(copy: Path):
    before = score(copy)
    for path in sorted((copy / "hard").rglob("*.png")):
        path.rename(path.with_name(f"clip_{int(path.stem) - 8}.png"))
    with pytest.raises(Avs3dError, match=r"10 of 10 masks are missing: .*, or --by-order"):
        score(copy)
    assert score(copy, by_order=True) == before
    (copy / "hard/clip_1/clip_0.png").unlink()
    with pytest.raises(Avs3dError, match=r"hard/clip_1: 4 masks, expected 5, as in .*truth/clip_1"):
        score(copy, by_order=True)


def bad_size(root: Path) -> None:
    write(root / "hard", "clip_1/9.png", np.zeros((8, 7), np.uint8))


def bad_values(root: Path) -> None:
    write(root / "hard", "clip_1/9.png", np.full((36, 48), 7, np.uint8))


def bad_colours(root: Path) -> None:
    write(root / "hard", "clip_1/9.png", np.arange(36 * 48 * 3, dtype=np.uint8).reshape(36, 48, 3))


def damaged(root: Path) -> None:
    (root / "hard/clip_1/9.png").write_bytes((root / "hard/clip_1/9.png").read_bytes()[:60])


def no_picture(root: Path) -> None:
    (root / "hard/clip_1/9.png").write_text("nan")


def uneven(root: Path) -> None:
    write(root / "truth", "clip_1/99.png", np.zeros((36, 48), np.uint8))
    write(root / "hard", "clip_1/99.png", np.zeros((36, 48), np.uint8))


@pytest.mark.parametrize(
    ("spoil", "options", "code", "line"),
    [
        (bad_size, [], 1, r"clip_1/9.png: 7×8 pixels, expected 48×36, those of its truth"),
        (bad_values, [], 1, r"clip_1/9.png: the mask holds 7 .*--soft reads the grey levels"),
        (bad_colours, [], 1, r"clip_1/9.png: a coloured picture, expected a grey one"),
        (damaged, [], 1, r"clip_1/9.png: "),
        (no_picture, [], 1, r"clip_1/9.png: "),
        (uneven, ["--convention", "avsbench-ms3"], 2, r"clips of 5 and 6 frames; avsbench-ms3 needs one length"),
        (None, ["--convention", "avss"], 2, "expected --classes 71 of AVSBench-semantic"),
        (None, ["--convention", "ref-avs", "--classes", "4"], 2, "leave out --classes"),
        (None, ["--convention", "3d-avs", "--soft"], 2, "leave out --soft"),
        (None, ["--clips-per-batch", "2"], 2, "has no batches"),
    ],
)
def test_bad_input_is_one_line_with_its_exit_code(copy: Path, spoil, options: list[str], code: int, line: str):
    if spoil is not None:
        spoil(copy)
    result = CliRunner().invoke(command, [str(copy / "truth"), str(copy / "hard"), *options])
    assert isinstance(result.exception, Avs3dError)
    assert result.exception.exit_code == code
    with pytest.raises(Avs3dError, match=line):
        raise result.exception
    assert "\n" not in str(result.exception)


def test_a_folder_without_masks_is_a_usage_error(folders: Path, tmp_path: Path):
    for root, line in ((tmp_path / "nowhere", "no such folder"), (tmp_path, "no PNG file")):
        with pytest.raises(UsageError, match=line):
            score_folders(folders / "truth", root, FolderOptions())


def test_the_command_prints_and_writes_the_figures(folders: Path, tmp_path: Path):
    file = tmp_path / "figures.json"
    given = [
        str(folders / "truth"),
        str(folders / "soft"),
        "--soft",
        "--convention",
        "avsbench-ms3",
        "--json",
        str(file),
    ]
    result = CliRunner().invoke(command, given, catch_exceptions=False)
    written = json.loads(file.read_text())
    assert written["convention"] == "avsbench-ms3"
    assert f"avsbench-ms3: {5 * CLIPS} frames, {CLIPS} clips" in result.output
    assert f"{written['figures']['F']:.4f}   order-free {written['order_free']['F']:.4f}" in result.output
    assert CliRunner().invoke(command, given, catch_exceptions=False).exit_code == 0  # its own file is replaced
    assert set(CONVENTIONS) >= {"avs3d", "avsbench-ms3", "ref-avs", "avss", "combo"}
