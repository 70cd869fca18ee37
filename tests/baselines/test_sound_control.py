"""What a method hears under each control: the sound changes and nothing else, and what is missing is one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import UsageError
from baselines import cli
from baselines.sound_control import NO_CLASS, SAID, SOUND_CONTROLS, other_frame, sound_of, sounding_categories
from tests.support import tiny, tiny_scenes
from tests.support.shared import SharedDataset

KEYS = tuple(f"part_1/{scan}/kitchen/{index}" for scan in ("one", "two") for index in (1, 2))
CATEGORIES = ("microwave", "clock", "telephone", "microwave")


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """Two homes with two observations each: a microwave in both, and a category of its own in each."""
    categories = dict(zip(KEYS, CATEGORIES, strict=True))
    monkeypatch.setattr(
        "baselines.sound_control.sounding_categories", lambda observation: frozenset({categories[observation.key]})
    )
    made = tiny.write_dataset(tmp_path / "made", frames=9, keys=(tiny.SINGLE,))
    for key in KEYS:
        shutil.copytree(made / tiny.SINGLE, tmp_path / "data" / key)
    return Dataset(tmp_path / "data")


def test_the_commands_have_all_controls() -> None:
    assert cli._SOUND_CONTROLS == SOUND_CONTROLS
    assert SAID.keys() == set(SOUND_CONTROLS)


def test_ears_and_silence(shared_dataset: SharedDataset) -> None:
    frame = Dataset(shared_dataset(frames=9))[tiny.SINGLE].frames[3]
    left, right = own = sound_of(frame)
    np.testing.assert_array_equal(own, frame.audio())
    assert np.abs(left - right).max() > 0, "ears that hear the same would make the controls equal"
    np.testing.assert_array_equal(sound_of(frame, "swapped-ears"), [right, left])
    np.testing.assert_allclose(sound_of(frame, "both-ears-mean"), [(left + right) / 2] * 2)
    assert not sound_of(frame, "none").any()
    assert all(sound_of(frame, control).shape == own.shape for control in ("none", "swapped-ears", "both-ears-mean"))


def test_the_same_category_is_of_another_home_and_another_category_of_any(dataset: Dataset) -> None:
    frame = dataset[KEYS[0]].frames[4]
    same, other = (other_frame(frame, same_category=same) for same in (True, False))
    assert (same.observation.key, same.index) == (KEYS[3], 4)
    assert (other.observation.key, other.index) == (KEYS[1], 4)
    np.testing.assert_array_equal(sound_of(frame, "same-category"), same.audio())
    np.testing.assert_array_equal(sound_of(frame, "other-category"), other.audio())


def test_of_several_categories_the_most_alike_set_is_heard(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    sets = dict(zip(KEYS, (("microwave", "clock"), (), ("microwave", "telephone"), ("microwave",)), strict=True))
    monkeypatch.setattr(
        "baselines.sound_control.sounding_categories", lambda observation: frozenset(sets[observation.key])
    )
    frame = dataset[KEYS[0]].frames[4]
    assert other_frame(frame, same_category=True).observation.key == KEYS[3]
    silent = dataset[KEYS[1]].frames[4]
    assert other_frame(silent, same_category=True) == silent


def test_sounds_of_no_class_are_one_category() -> None:
    """A dog that is heard in one home alone has another sound of no class, in another home, for its counterpart."""

    def told(category: str) -> frozenset[str]:
        source = SimpleNamespace(category=category)
        record = SimpleNamespace(class_ids=class_ids(), sound_sources=(source,))
        return sounding_categories(SimpleNamespace(record=record))  # type: ignore[arg-type]

    assert told("dog") == told("street") == {NO_CLASS}
    assert told("clock") == {"clock"}


@pytest.fixture
def two_homes(tmp_path: Path) -> Dataset:
    """The group of `tiny_scenes` in two homes; from the next room, a dog is heard in one, the street in the other."""
    tiny_scenes.write_part_3(tmp_path / "made", frames=9)
    for scan, heard in (("one", "dog"), ("two", "street")):
        home = tmp_path / "data" / "part_3" / scan
        shutil.copytree(tmp_path / "made" / "part_3" / "tiny", home)
        for file in home.rglob(layout.OBSERVATION_JSON):
            document = json.loads(file.read_text().replace("part_3/tiny/", f"part_3/{scan}/"))
            document["scan"] = scan
            if document["key"].endswith(tiny_scenes.AWAY.rpartition("/")[2]):
                document["sources"][0]["category"] = document["category"] = heard
            file.write_text(json.dumps(document))
    return Dataset(tmp_path / "data")


def test_every_frame_of_a_group_has_a_counterpart_in_the_other_home(two_homes: Dataset) -> None:
    for observation in two_homes:
        mine = sounding_categories(observation)
        for frame in observation.frames:
            other = other_frame(frame, same_category=True)
            assert other.index == frame.index
            assert sounding_categories(other.observation) == mine
            assert (other.observation.place.scan != observation.place.scan) is bool(mine)
            if mine:
                another = other_frame(frame, same_category=False).observation
                assert not sounding_categories(another) & mine
                assert another.group_key != observation.group_key


def test_what_the_dataset_lacks_is_one_line(dataset: Dataset) -> None:
    with pytest.raises(UsageError, match=r"no observation of the same category in another home for .*one/kitchen/2"):
        sound_of(dataset[KEYS[1]].frames[0], "same-category")


def test_siblings_are_no_other_sound(tmp_path: Path) -> None:
    tiny_scenes.write_part_3(tmp_path / "scenes", frames=9, keys=(tiny_scenes.FIRST, tiny_scenes.SECOND))
    scenes = Dataset(tmp_path / "scenes")
    sounding = [sounding_categories(observation) for observation in scenes]
    assert any(sounding)
    for observation in scenes:
        with pytest.raises(UsageError, match="--sound other-category needs one"):
            sound_of(observation.frames[0], "other-category")


def test_nothing_is_known_of_a_release(tmp_path: Path) -> None:
    release = tiny.write_release(tmp_path / "release")
    assert sounding_categories(Observation(release, tiny.SINGLE)) == frozenset()
