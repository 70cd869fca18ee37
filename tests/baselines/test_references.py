"""The reference rows of listen: each rule finds what its one property of the sound tells, in scenes made by hand."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.scores import PAIR_FIGURES, PAIR_KINDS
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import UsageError
from avs3d_bench.formats import media
from baselines.cli import baseline
from baselines.echosegnet.binaural import woodworth_itd
from baselines.oracle import oracle_prediction
from baselines.references import (
    REFERENCES,
    correlation,
    delay_angle,
    lateral_angles,
    level_difference,
    mono_level,
    reference_masks,
    write_references,
)
from tests.support import tiny
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, SECOND, SILENT


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=17)


def arriving(lateral: float, *, noise: float = 0.0, seed: int = 0) -> NDArray[np.float64]:
    """A second of white noise (2, n) whose left ear lags by Woodworth's delay, exactly (in the spectrum)."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft(rng.standard_normal(SAMPLE_RATE))
    frequencies = np.fft.rfftfreq(SAMPLE_RATE, 1 / SAMPLE_RATE)
    late = spectrum * np.exp(-2j * np.pi * frequencies * woodworth_itd(lateral))
    both = np.stack([np.fft.irfft(late), np.fft.irfft(spectrum)])
    return both + noise * rng.standard_normal(both.shape)


# --- What is heard ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [-80, -30, -5, 0, 12, 45, 80])
def test_the_delay_gives_the_angle(degrees: float):
    found = delay_angle(arriving(np.radians(degrees)))
    assert found is not None
    assert np.degrees(found) == pytest.approx(degrees, abs=1)


def test_the_delay_is_found_in_noise():
    found = delay_angle(arriving(np.radians(30), noise=1.0))
    assert found is not None
    assert np.degrees(found) == pytest.approx(30, abs=3)


def test_silence_has_no_delay():
    assert delay_angle(np.zeros((2, SAMPLE_RATE))) is None
    assert delay_angle(np.stack([np.zeros(SAMPLE_RATE), np.ones(SAMPLE_RATE)])) is None, "a deaf ear"
    assert mono_level(np.zeros((2, 10))) == -np.inf


def test_the_louder_ear_is_that_of_the_source():
    clip = arriving(0.5)
    assert level_difference(clip * [[0.5], [1]]) > 0
    assert level_difference(clip * [[1], [0.5]]) < 0


def test_the_level_of_the_sum_of_both_ears():
    assert mono_level(np.array([[0.5, -0.5], [0.5, -0.5]])) == pytest.approx(20 * np.log10(0.5))
    assert mono_level(np.array([[0.5, -0.5], [-0.5, 0.5]])) == -np.inf, "ears of opposite sign cancel"


def test_a_profile_is_explained_by_its_own_law_whatever_the_gain():
    distances = np.array([1.0, 2.0, 4.0, 3.0])
    law = -20 * np.log10(distances)
    assert correlation(law - 31, law) == pytest.approx(1)
    assert correlation(0.4 * law, law) == pytest.approx(1), "reverberation flattens the profile"
    assert correlation(law, np.ones(4)) == correlation(law[:2], law[:2]) == 0


# --- Which instance is marked -----------------------------------------------------------------------------------------


def marked(name: str, frames: tuple[Frame, ...]) -> list[set[int]]:
    """Ids of the instances that a reference marks in each frame, of those in view."""
    return [
        set(np.unique(frame.instance_ids()[np.asarray(found.mask, bool)]).tolist())
        for frame, found in zip(frames, reference_masks(name, frames), strict=True)
    ]


def in_view(frame: Frame) -> set[int]:
    return set(np.unique(frame.instance_ids()).tolist()) - {0}


def test_the_louder_ear_finds_the_source_on_its_side(data: Path):
    """Frames 4 to 12 have one microwave on either side: the left one sounds in FIRST, the right one in SECOND."""
    dataset = Dataset(data)
    for key, own in ((FIRST, 1), (SECOND, 3)):
        frames = dataset[key].frames[4:13]
        twins = [one for one in dataset[key].record.instances if one.category == "microwave"]  # type: ignore[union-attr]
        assert all(np.prod(np.sign(lateral_angles(frame, twins))) < 0 for frame in frames)
        assert marked("ild", frames) == [{own} & in_view(frame) for frame in frames]


def test_the_level_over_the_walk_finds_the_source(data: Path):
    dataset = Dataset(data)
    for key, own in ((FIRST, 1), (SECOND, 3)):
        assert marked("level", dataset[key].frames) == [{own} & in_view(frame) for frame in dataset[key].frames]


def test_the_delay_finds_the_source(data: Path, tmp_path: Path):
    """The clips of `tiny` have no delay: here they get that of their source, and equal levels."""
    root = tiny.clone(data, tmp_path / "data")
    for key, own in ((FIRST, 1), (SECOND, 3)):
        observation = Dataset(root)[key]
        assert observation.record is not None
        (source,) = (one for one in observation.record.instances if one.id == own)
        for frame in observation.frames:
            clip = arriving(float(lateral_angles(frame, [source])[0]), seed=frame.index).astype(np.float32) * 0.1
            path = observation.path / layout.audio_path(layout.BINAURAL, frame.index)
            path.unlink()
            media.write_wav(path, clip)
        assert marked("gcc-phat", observation.frames) == [{own} & in_view(frame) for frame in observation.frames]


@pytest.mark.parametrize("name", REFERENCES)
def test_silence_is_black_and_nothing_is_marked_that_is_not_heard(data: Path, name: str):
    dataset = Dataset(data)
    assert marked(name, dataset[SILENT].test) == [set()] * 3
    telephone = marked(name, dataset[AWAY].frames)
    assert telephone == [{2} & in_view(frame) for frame in dataset[AWAY].frames], "that of the next room is heard, too"


@pytest.mark.parametrize("name", REFERENCES)
def test_a_distractor_is_not_marked_while_one_sounds_in_another_room(data: Path, tmp_path: Path, name: str):
    """The telephones of AWAY become kettles: one is heard from the next room, one stands silent in this one."""

    def change(document: dict[str, Any]) -> None:
        for one in (document, *document["sources"], *document["instances"]):
            one["category"] = "kettle" if one["category"] == "telephone" else one["category"]

    root = tiny.clone(data, tmp_path / "data")
    tiny.edit_record(root, AWAY, change)
    assert marked(name, Dataset(root)[AWAY].frames) == [set()] * 17


@pytest.mark.parametrize("name", ["level", "ild", "gcc-phat"])
def test_as_many_are_marked_as_are_heard(data: Path, name: str):
    """In BOTH two microwaves take turns: one at a time, and the telephone all the time."""
    frames = Dataset(data)[BOTH].frames
    for frame, found in zip(frames, marked(name, frames), strict=True):
        assert frame.record is not None
        heard = Dataset(data)[BOTH].record.audible_instances(frame.record)  # type: ignore[union-attr]
        assert len(found) <= len(heard)
        assert found <= in_view(frame)


def test_the_category_row_is_the_oracle(data: Path):
    for frames in (Dataset(data)[key].test for key in (FIRST, BOTH)):
        for frame, found in zip(frames, reference_masks("category", frames), strict=True):
            expected = oracle_prediction(frame, instance="category")
            assert np.array_equal(found.mask, expected.mask)
            assert np.array_equal(found.categories, expected.categories)  # type: ignore[arg-type]


# --- The command ------------------------------------------------------------------------------------------------------


def test_one_command_writes_scores_and_prints_all(data: Path, tmp_path: Path):
    options = ["--dataset", str(data), "-o", str(tmp_path / "r"), "--workers", "1", "--json", str(tmp_path / "t.json")]
    done = CliRunner().invoke(baseline, ["references", *options], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.output.splitlines()]
    rows = {line[0]: line[1:] for line in lines if line and line[0] in REFERENCES}
    assert list(rows) == list(REFERENCES)
    assert rows["category"][0] == "0.000", "twins are beyond a recogniser of categories"
    assert rows["level"][0] == "1.000"
    for name in REFERENCES:
        scores = media.read_json(tmp_path / "r" / f"{name}.json")
        assert {*PAIR_KINDS} <= scores["overall"]["listen"].keys()
        assert scores["submission"]["truth"], "a leaderboard gives it no rank"
        table = media.read_json(tmp_path / "t.json")["references"]
        assert table[name] == {one: scores["overall"]["listen"][one] for one in table[name]}
        assert {*PAIR_FIGURES, "IoU"} == table[name].keys()


def test_masks_that_are_missing_are_said_in_one_line(data: Path, tmp_path: Path):
    root = tiny.clone(data, tmp_path / "data")
    shutil.rmtree(root / SECOND / layout.INSTANCE_MASKS)
    with pytest.raises(UsageError, match=rf"{SECOND}: the references need observation.json and instance_masks/"):
        write_references(Dataset(root), tmp_path / "r")
    assert not (tmp_path / "r").exists()


def test_other_parts_have_no_references(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=9)
    with pytest.raises(UsageError, match="no observation of part_3; expected some"):
        write_references(Dataset(root), tmp_path / "r")
