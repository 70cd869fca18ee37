"""Solvers of questions: ears find directions, the deaf one is at chance, the blind one cannot tell letters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract.questions import QuestionLine, ShownObject
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.qa.templates import templates
from avs3d_bench.exports.qa.write import QaOptions, write_qa
from avs3d_bench.formats import media
from baselines.cli import baseline
from baselines.questions import LEAST_COHERENCE, answer_one, blind_answer, coherence, spatial_answer, write_answers
from evaluators.questions.answers import score_file
from tests.support import tiny_scenes
from tests.support.shared import SharedDataset

RATE = 44_100


def plane_wave(azimuth: float, seed: int = 0) -> np.ndarray:
    """(2, n) noise from a direction (degrees, positive right) at a sphere: delay after Woodworth, no shadow."""
    noise = np.random.default_rng(seed).normal(0, 0.05, RATE)
    angle = np.radians(azimuth)
    delay = 0.0875 / 343 * (angle + np.sin(angle))
    phase = np.exp(-2j * np.pi * np.fft.rfftfreq(RATE, 1 / RATE) * delay)
    spectrum = np.fft.rfft(noise)
    return np.stack([np.fft.irfft(spectrum * phase, RATE), noise]).astype(np.float32)


def ask(folder: Path, kind: str, meanings: list[str], *clips: np.ndarray) -> QuestionLine:
    """A line about clips; its right answer is not looked at."""
    for number, clip in enumerate(clips):
        media.write_wav(folder / f"{number}.wav", clip, subtype="pcm16")
    texts = templates().kinds[kind].options  # type: ignore[index]
    options = tuple(texts.get(name, name) for name in meanings)
    return QuestionLine(
        id="q1", set="s1", kind=kind, group="part_3/a/kitchen/1", frame="frame_000", question="?", options=options,
        answer=options[0], observation="part_3/a/kitchen/1", played="own", pictures=("p.png",),
        audio=tuple(f"{n}.wav" for n in range(len(clips))),
    )  # type: ignore[arg-type]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "meanings", "azimuths", "expected"),
    [
        ("side", ["nothing", "left", "right"], [-40], "left"),
        ("side", ["nothing", "left", "right"], [15], "right"),
        ("azimuth", ["far_right", "right", "left", "far_left", "nothing"], [35], "right"),
        ("azimuth", ["far_right", "ahead", "left", "nothing"], [-5], "ahead"),
        ("moved", ["left", "right", "stayed", "nothing"], [-30, 10], "right"),
        ("moved", ["left", "right", "stayed", "nothing"], [30, 28], "stayed"),
        ("moved", ["left", "right", "nothing"], [30, 28], "left"),
        ("anything", ["no", "yes"], [0], "yes"),
    ],
)
def test_ears_find_directions(
    tmp_path: Path, kind: str, meanings: list[str], azimuths: list[float], expected: str
) -> None:
    clips = [plane_wave(azimuth, seed) for seed, azimuth in enumerate(azimuths)]
    line = ask(tmp_path, kind, meanings, *clips)
    assert templates().meaning(line.kind, spatial_answer(line, tmp_path, ())) == expected


def test_ears_find_the_marked_object_and_need_to_know_where_it_is(tmp_path: Path) -> None:
    shown = [ShownObject(mark=letter, category="clock", azimuth=azimuth, elevation=0, distance=2)
             for letter, azimuth in (("B", -35.0), ("C", 0.0), ("A", 40.0))]  # fmt: skip
    for one in shown:
        line = ask(tmp_path, "which", ["A", "nothing", "B", "C"], plane_wave(one.azimuth))
        assert spatial_answer(line, tmp_path, shown) == one.mark
    line = ask(tmp_path, "which", ["A", "nothing", "B", "C"], plane_wave(-35))
    assert blind_answer(line, tmp_path, shown) == "A"


def test_diffuse_noise_and_silence_are_nothing(tmp_path: Path) -> None:
    noise = tiny_scenes.diffuse_noise(1)[0]
    diffuse = (noise * (0.05 / noise.std())).astype(np.float32)
    assert coherence(diffuse) < LEAST_COHERENCE < coherence(plane_wave(30) + diffuse)
    for clip in (diffuse, np.zeros((2, RATE), np.float32)):
        assert spatial_answer(ask(tmp_path, "count", ["1", "2", "0"], clip), tmp_path, ()) == "none"
        assert spatial_answer(ask(tmp_path, "room", ["here", "nothing"], clip), tmp_path, ()) == "nothing sounds"


@pytest.mark.slow
def test_the_deaf_solver_is_at_chance_and_the_listening_one_is_not(
    shared_part_3: SharedDataset, tmp_path: Path
) -> None:
    folder = tmp_path / "qa"
    write_qa(shared_part_3(frames=9), folder, QaOptions(split="all"))
    for solver in ("deaf", "spatial"):
        arguments = [
            "questions",
            "--questions",
            str(folder),
            "-o",
            str(tmp_path / f"{solver}.jsonl"),
            "--solver",
            solver,
        ]
        result = CliRunner().invoke(baseline, arguments, catch_exceptions=False)
        assert result.exit_code == 0, result.output
    deaf = score_file(tmp_path / "deaf.jsonl", folder)
    assert deaf.overall.pair_accuracy == 0
    for found in deaf.kinds.values():
        assert found.accuracy == pytest.approx(found.chance)
    heard = score_file(tmp_path / "spatial.jsonl", folder)
    assert heard.kinds["anything"].pair_accuracy > 0.9, "no sibling has noise without a source"


def test_bad_input_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="solver 'mute': expected one of spatial, blind, deaf"):
        write_answers("mute", tmp_path, tmp_path / "x.jsonl")
    with pytest.raises(UsageError, match=r"no questions\.jsonl"):
        write_answers("spatial", tmp_path, tmp_path / "x.jsonl")
    line = ask(tmp_path, "side", ["left", "right"], plane_wave(0))
    with pytest.raises(Exception, match=r"scenes\.json: missing"):
        answer_one("spatial", line, tmp_path)
