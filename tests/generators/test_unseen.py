"""`generate` warns where no test frame shows what sounds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset
from generators import cli
from generators.run import generation
from generators.run.runner import Outcome, never_in_a_test_frame
from tests.support import tiny, tiny_scenes


def without(record: ObservationRecord, names: set[str]) -> ObservationRecord:
    """The record with no visible pixel in some frames."""
    frames = tuple(
        frame.model_copy(update={"visible_pixels": 0 if frame.name in names else 5}) for frame in record.frames
    )
    return record.model_copy(update={"frames": frames})


def test_only_test_frames_count(tmp_path: Path) -> None:
    tiny.write_dataset(tmp_path / "data", frames=11)
    observation = Dataset(tmp_path / "data")[0]
    assert observation.record is not None
    test, train = ({frame.name for frame in frames} for frames in (observation.test, observation.train))
    assert len(test) == 2
    assert never_in_a_test_frame(without(observation.record, test))
    assert not never_in_a_test_frame(without(observation.record, train))
    assert not never_in_a_test_frame(without(observation.record, {min(test)}))


def test_silence_and_sound_from_elsewhere_are_the_task(tmp_path: Path) -> None:
    tiny_scenes.write_part_3(tmp_path / "data")
    records = [observation.record for observation in Dataset(tmp_path / "data")]
    scenes = [record for record in records if record is not None and record.sources is not None]
    assert {any(source.instance is not None for source in record.sources or ()) for record in scenes} == {True, False}
    for record in scenes:
        hidden = without(record, {frame.name for frame in record.frames})
        assert never_in_a_test_frame(hidden) == any(source.instance is not None for source in record.sources or ())


def test_the_warning_says_how_many_and_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = Outcome(("a", "b", "c", "d"), (), (), present=4)
    assert outcome.warning is None
    one, two = replace(outcome, unseen=("a",)), replace(outcome, unseen=("a", "b", "c", "d"))
    assert one.warning is not None
    assert one.warning.startswith("1 of 4 observations never shows the object in a test frame (a);")
    assert two.warning is not None
    assert two.warning.startswith("4 of 4 observations never show the object in a test frame (a, b, c, …);")
    assert "--frames" in two.warning
    monkeypatch.setattr(generation, "generate_plans", lambda *_, **__: two)
    manifest = Path(__file__).parents[2] / "scenes_manifest/demo.yaml"
    found = CliRunner().invoke(cli.generate, [str(manifest), "-o", str(tmp_path / "out"), "--audio", "analytic"])
    assert found.exit_code == 0, found.output
    assert f"avs3d generate: warning: {two.warning}" in found.stderr
