"""Direction alone from a dataset to masks: of all objects that are seen, the one from whose place the sound comes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from avs3d_bench.contract.taxonomy import CATEGORIES  # noqa: E402
from avs3d_bench.dataset import Dataset, Frame, Observation  # noqa: E402
from baselines.direction_alone import DirectionMethod  # noqa: E402
from baselines.listener.predict import ListenerMethod  # noqa: E402
from tests.support import tiny  # noqa: E402
from tests.support.delays import delayed  # noqa: E402
from tests.support.shared import SharedDataset  # noqa: E402
from tests.support.tiers import some  # noqa: E402
from tests.support.tiny_scenes import FIRST, SILENT  # noqa: E402


@dataclass(frozen=True)
class Sees(ListenerMethod):
    """A network that sees what is there and names nothing that it hears; ``network`` is the observation."""

    def class_maps(self, frames: Sequence[Frame]) -> list[NDArray[np.float32]]:
        found = []
        for frame in frames:
            ids = frame.instance_ids()
            classes = np.full((1 + len(CATEGORIES), *ids.shape), 0.01, np.float32)
            classes[0] = 0.9
            for one in self.network.record.instances:
                if one.category in CATEGORIES:
                    classes[:, ids == one.id] = 0.01
                    classes[1 + CATEGORIES.index(one.category), ids == one.id] = 0.9
            found.append(classes)
        return found

    def heard(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        return np.zeros((len(frames), len(CATEGORIES)), np.float32)


def method_of(observation: Observation) -> DirectionMethod:
    return DirectionMethod(Sees(observation, torch.device("cpu"), "0" * 64, refine="none"))


def middle(observation: Observation, instance: int) -> Any:
    assert observation.record is not None
    return next(np.mean(one.bounds, axis=0) for one in observation.record.instances if one.id == instance)


@pytest.mark.parametrize("sounding", some([1, 2], every=2))
def test_of_twins_the_one_is_marked_whose_place_is_heard_along_the_walk(
    shared_dataset: SharedDataset, monkeypatch: pytest.MonkeyPatch, sounding: int
) -> None:
    observation = Dataset(shared_dataset(frames=17))[tiny.MULTI]
    place = middle(observation, sounding)
    monkeypatch.setattr(Frame, "audio", lambda frame: delayed(place, frame))
    found = method_of(observation).predictions(observation.test)
    truth = [frame.instance_ids() == sounding for frame in observation.test]
    assert any(mask.any() for mask in truth)
    for prediction, mask in zip(found, truth, strict=True):
        assert (np.asarray(prediction.mask) == mask).all()


@pytest.mark.slow
def test_in_part_3_a_frame_marks_the_object_at_the_angle_of_its_second_and_no_other(
    shared_part_3: SharedDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    observation = Dataset(shared_part_3(frames=17))[FIRST]
    marked = {}
    for sounding in (1, 3):
        place = middle(observation, sounding)
        monkeypatch.setattr(Frame, "audio", lambda frame, place=place: delayed(place, frame))
        found = method_of(observation).predictions(observation.test)
        pairs = [(np.asarray(one.mask), np.asarray(one.categories)) for one in found]
        marked[sounding] = sum(mask.any() for mask, _ in pairs)
        for frame, (mask, categories) in zip(observation.test, pairs, strict=True):
            assert not mask.any() or (mask == (frame.instance_ids() == sounding)).all()
            assert (categories == mask * (1 + CATEGORIES.index("microwave"))).all()
    assert marked[1] == 2  # in view in two of the three test frames


def test_silence_marks_nothing(shared_part_3: SharedDataset, monkeypatch: pytest.MonkeyPatch) -> None:
    observation = Dataset(shared_part_3(frames=17))[SILENT]
    monkeypatch.setattr(Frame, "audio", lambda _: np.zeros((2, 44_100), np.float32))
    found = method_of(observation).predictions(observation.test)
    assert not any(np.asarray(one.mask).any() or np.asarray(one.categories).any() for one in found)
