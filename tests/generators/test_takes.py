"""Siblings of part_3 never share a take: what they draw, and the attacks that compare their clips."""

from __future__ import annotations

import shutil
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import yaml
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import fftconvolve

from avs3d_bench.contract import layout
from avs3d_bench.errors import UsageError
from avs3d_bench.formats import media
from benchmarks.sealed_attacks import DIRECTIONS, Verdict, judge
from benchmarks.sealed_cases import Case
from benchmarks.sealed_plants import TAKE_PLANTS
from benchmarks.sealed_takes import TAKE_ATTACKS, Sibling, take_cases
from benchmarks.sibling_clips import arranged_unlit, compare, hear_siblings
from generators.assets.sounds import enough, stretches, synthesise
from generators.backends import vision_backend
from generators.observation.hearing import HEAD, responses_at
from generators.observation.prepare import prepare_sources
from generators.observation.record import describe_signal, describe_source
from generators.observation.sources import check_takes, choose_sources
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest
from generators.sealing.cli import seal
from tests.support.homes import write_manifest

FIRST = "part_3/box/kitchen/1"
RATE = layout.SAMPLE_RATE
FRAMES = 3
WHO = {"category": "microwave"}
#: Index → the sources of each sibling: a microwave alone, its twin, both in turn, a microwave and a clock.
SOURCES: dict[int, list[dict[str, Any]]] = {
    1: [WHO | {"instance": 1}],
    2: [WHO | {"instance": 2}],
    3: [
        WHO | {"instance": 1, "programme": [[0, 1.5]]},
        WHO | {"instance": 2, "programme": [[1.5, 3]]},
    ],
    4: [WHO | {"instance": 1}, {"category": "clock", "programme": [[1, 2]]}],
}
#: A variant of the second: the same sources under another background.
VARIANT = {"variant_of": "part_3/box/kitchen/2", "index": 7, "background": {"kind": "noise", "snr_db": 10}}


def plans_of(folder: Path, audio: str = "analytic", **changes: Any) -> dict[int, ObservationPlan]:
    """Index → plan of each sibling and of the variant."""
    first = {"part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 2, "clock": 1}}
    entries = [first | {"sources": SOURCES[1]}]
    entries += [{"like": FIRST, "index": index, "sources": SOURCES[index]} for index in list(SOURCES)[1:]]
    camera = {"size": 64, "frames": FRAMES}
    path = write_manifest(folder, observations=[*entries, VARIANT], camera=camera, **changes)
    plans = make_plans(read_manifest(path), GenerateOptions(audio=audio))
    return {plan.spec.index: plan for plan in plans}


def with_recordings(folder: Path, *seconds: float) -> dict[int, ObservationPlan]:
    """The same with recordings of noise for the microwaves."""
    for number, length in enumerate(seconds):
        noise = np.random.default_rng(number).normal(0, 0.1, round(length * RATE))
        soundfile.write(folder / f"hum_{number}.wav", noise, RATE, subtype="FLOAT")
    licence = {"name": "CC0-1.0", "author": "avs3d-bench"}
    files = [{"file": f"hum_{number}.wav", "licence": licence} for number in range(len(seconds))]
    return plans_of(folder, sounds={"microwave": files})


def takes(plan: ObservationPlan) -> list[np.ndarray]:
    """What the microwaves of an observation play, as long as its frames."""

    home, seen = arranged_unlit(plan)
    sources = choose_sources(plan, home, seen)
    return [source.signal.samples for source in sources if source.category == "microwave"]


@pytest.mark.slow
def test_the_level_of_a_source_is_drawn_with_its_take(tmp_path: Path) -> None:
    for name in ("plain", "drawn", "twice"):
        (tmp_path / name).mkdir()
    plain, drawn = plans_of(tmp_path / "plain"), plans_of(tmp_path / "drawn", levels=[-9, -3])
    levels = {}
    for index, plan in drawn.items():
        home, arrangement = arranged_unlit(plan)
        loud = choose_sources(plain[index], home, arrangement)
        quiet = choose_sources(plan, home, arrangement)
        levels[index] = [source.gain_db for source in quiet]
        for before, after in zip(loud, quiet, strict=True):
            assert before.gain_db == 0
            assert -9 <= after.gain_db <= -3
            scaled = before.samples * 10 ** (after.gain_db / 20)
            np.testing.assert_allclose(after.samples, scaled, rtol=1e-5, atol=1e-9)
            assert describe_source(after).gain_db == describe_signal(after).gain_db == after.gain_db
            assert describe_signal(before).gain_db is None
    assert levels[7] == levels[2], "a variant plays the take of its original"
    assert len({level for some in levels.values() for level in some}) >= 5, "siblings draw levels of their own"
    assert plain[1].digest != drawn[1].digest == plans_of(tmp_path / "twice", levels=[-9, -3])[1].digest
    with pytest.raises(UsageError, match=r"levels: expected \[lowest, highest\] in dB, found \[0, -9\]"):
        plans_of(tmp_path / "twice", levels=[0, -9])


def alike(one: np.ndarray, other: np.ndarray) -> float:
    """The largest normalised correlation over all lags."""
    found = np.abs(fftconvolve(one, other[::-1]))
    return float(found.max() / np.sqrt((one.astype(float) ** 2).sum() * (other.astype(float) ** 2).sum()))


# --- what is drawn --------------------------------------------------------------------------------------------------


def test_siblings_hear_other_takes_and_variants_the_same(tmp_path: Path) -> None:
    plans = plans_of(tmp_path)
    played = {index: takes(plan) for index, plan in plans.items()}
    for one, other in combinations(SOURCES, 2):
        for mine in played[one]:
            for theirs in played[other]:
                assert not np.any((mine == theirs) & (mine != 0)), (one, other)
    # Twins in one observation do not play in step either.
    assert not np.any((played[3][0] == played[3][1]) & (played[3][0] != 0))
    np.testing.assert_array_equal(played[7][0], played[2][0])


def test_the_random_numbers_of_the_acoustics_are_a_siblings_own(tmp_path: Path) -> None:
    """As are those of the noise; the pictures have those of the group, and parts 1 and 2 the engine's usual seed."""
    plans = plans_of(tmp_path)
    seeds = {index: plan.acoustic_seed for index, plan in plans.items()}
    assert len({seeds[index] for index in SOURCES}) == len(SOURCES)
    assert seeds[7] == seeds[2]
    assert len({plan.pictures_digest for plan in plans.values()}) == 1
    noise = {index: plan.own_rng("background").integers(1 << 60) for index, plan in plans.items()}
    assert len({noise[index] for index in SOURCES}) == len(SOURCES)
    others = make_plans(read_manifest(write_manifest(tmp_path)), GenerateOptions(audio="analytic"))
    assert [plan.acoustic_seed for plan in others] == [None, None]


@pytest.mark.parametrize("audio", ["analytic", pytest.param("tracer", marks=pytest.mark.slow)])
def test_late_reverberation_differs_between_siblings(audio: str, tmp_path: Path) -> None:
    """The same object at the same place: what is random in a response is a sibling's own."""

    plans, found = plans_of(tmp_path, audio), {}
    for index in (1, 4, 2, 7):
        plan = plans[index]
        ready = prepare_sources(plan, *arranged_unlit(plan), vision_backend(plan.options.renderer))
        (job, *_) = ready.acoustic_jobs
        session = job.engine().open(job.scene, job.path[0], room=job.room)
        found[index] = responses_at(session, job.poses[0])[HEAD].astype(float)
        session.close()
        assert ready.engine.describe()["seed"] == plan.acoustic_seed

    def likeness(start: int, end: int) -> float:
        a, b = (found[index][:, start:end] for index in (1, 4))
        return float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum()))

    direct = int(np.abs(found[1]).max(axis=0).argmax())
    assert likeness(max(direct - 20, 0), direct + 20) > 0.85  # the object is where it is
    assert likeness(round(0.1 * RATE), min(found[1].shape[1], found[4].shape[1])) < 0.7
    np.testing.assert_array_equal(found[7], found[2])


# --- recordings -----------------------------------------------------------------------------------------------------


@given(
    lengths=st.lists(st.floats(0.5, 200.0), min_size=1, max_size=5),
    seconds=st.integers(3, 40),
    count=st.integers(1, 12),
    seed=st.integers(0, 1000),
)
def test_stretches_of_recordings_are_disjoint_if_they_reach(
    lengths: list[float], seconds: int, count: int, seed: int
) -> None:
    found = stretches(lengths, seconds, count, np.random.default_rng(seed))
    assert len(found) == count
    assert all(0 <= start < 1 for _, start in found)
    if not enough(lengths, seconds, count):
        # As many takes of each recording as of any other, at equal distances.
        for number in range(len(lengths)):
            own = sorted(start for one, start in found if one == number)
            assert count // len(lengths) <= len(own) <= -(-count // len(lengths))
            assert np.diff([*own, own[0] + 1]) == pytest.approx(1 / len(own)) if own else True
        return
    for number, length in enumerate(lengths):
        own = sorted(start * length for one, start in found if one == number)
        assert all(later - earlier >= seconds - 1e-6 for earlier, later in pairwise(own))
        assert not own or own[-1] + seconds <= length + 1e-6


@pytest.mark.slow
def test_siblings_play_other_stretches_of_a_recording(tmp_path: Path) -> None:
    """Five takes of 5 s from recordings of 21 and 6 s; each that is made alone plays what it plays among the others."""
    plans = with_recordings(tmp_path, 21.0, 6.0)
    played = {index: takes(plan) for index, plan in plans.items()}
    every = [take for index in SOURCES for take in played[index]]
    assert len(every) == 5
    assert max(alike(one, other) for one, other in combinations(every, 2)) < 0.05
    np.testing.assert_array_equal(played[7][0], played[2][0])
    (alone,) = make_plans(
        read_manifest(tmp_path / "tiny.yaml"), GenerateOptions(only=("part_3/box/kitchen/3",), audio="analytic")
    )
    assert alone.digest == plans[3].digest
    np.testing.assert_array_equal(takes(alone), played[3])


def test_a_short_recording_begins_elsewhere_in_each_sibling(tmp_path: Path) -> None:
    """It does not reach for stretches of their own: no two takes are in step, but a comparison finds the recording."""
    plans = with_recordings(tmp_path, 4.0)
    every = [take for index in SOURCES for take in takes(plans[index])]
    for one, other in combinations(every, 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.05
        assert alike(one, other) > 0.3


def test_a_sealed_test_refuses_recordings_that_are_too_short(tmp_path: Path) -> None:
    with_recordings(tmp_path, 21.0, 4.0)  # five takes of 5 s
    arguments = [str(tmp_path / "tiny.yaml"), "-o", str(tmp_path / "test"), "--audio", "analytic"]
    message = f"{FIRST}: 5 sources of microwave in the siblings, but its recordings have 4 stretches of 5 s"
    with pytest.raises(UsageError, match=message):
        CliRunner().invoke(seal, arguments, catch_exceptions=False)
    assert not (tmp_path / "test").exists()
    check_takes(make_plans(read_manifest(tmp_path / "tiny.yaml"), GenerateOptions(audio="analytic", frames=2)))


def test_another_sibling_with_the_recording_changes_the_plans(tmp_path: Path) -> None:
    """Its take is one of the group's: what exists is not reused, and silence plays none."""
    before = with_recordings(tmp_path, 60.0)
    document = yaml.safe_load((tmp_path / "tiny.yaml").read_text())
    for sources, changes in (([], False), ([WHO | {"instance": 2}], True)):
        more = {"like": FIRST, "index": 9, "sources": sources}
        path = tmp_path / "more.yaml"
        path.write_text(yaml.safe_dump(document | {"observations": [*document["observations"], more]}))
        after = {plan.spec.index: plan for plan in make_plans(read_manifest(path), GenerateOptions(audio="analytic"))}
        assert (after[1].digest != before[1].digest) == changes


# --- attacks --------------------------------------------------------------------------------------------------------


def test_clips_of_siblings_have_nothing_in_common(tmp_path: Path) -> None:
    """The twin, and the same microwave with and without other sounds."""
    plans = [plan for index, plan in plans_of(tmp_path).items() if index in SOURCES]
    siblings = hear_siblings(plans, tmp_path / "tree")
    pairs = list(compare(tmp_path / "tree", siblings))
    assert [pair.same for pair in pairs].count(True) == 4
    assert [pair.equal for pair in pairs] == [0.0] * len(pairs)
    (case,) = take_cases(tmp_path / "tree", siblings)
    sources = {one.key: set(one.sources) for one in siblings}
    right, wrong = (sources[case.keys[place]] for place in (case.truth, 1 - case.truth))
    assert sources[case.reference] & right
    assert not sources[case.reference] & wrong
    scores = TAKE_ATTACKS["clips: correlation in step"]([case])[0]
    assert scores is not None
    assert scores.max() < 0.05  # 1 for the same clips


#: Number of questions of the controls.
CASES = 10


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Groups of three siblings in made-up rooms: two with one microwave, one with its twin; takes of their own."""
    root = tmp_path_factory.mktemp("rooms")
    rng = np.random.default_rng(4)
    for group in range(CASES):
        places = rng.normal(size=(2, 2, 2000)) * np.exp(-np.arange(2000) / 300)
        places[..., 20] = 8.0
        for index, place in enumerate((places[0], places[0], places[1]), start=1):
            take = synthesise("microwave", FRAMES, rng).astype(np.float64)
            heard = np.stack([fftconvolve(take, ear)[: FRAMES * RATE] for ear in place]) / 100
            for frame, clip in enumerate(np.split(heard, FRAMES, axis=1)):
                path = root / f"part_3/box/kitchen/{10 * group + index}" / layout.audio_path(layout.BINAURAL, frame)
                media.write_wav(path, clip.astype(np.float32))
    return root


def cases_of(root: Path) -> list[Case]:
    siblings = [
        Sibling(f"part_3/box/kitchen/{10 * group + index}", f"part_3/box/kitchen/{10 * group + 1}", sources)
        for group in range(CASES)
        for index, sources in ((1, (("microwave", 1),)), (2, (("microwave", 1),)), (3, (("microwave", 2),)))
    ]
    return take_cases(root, siblings)


def verdicts_on(root: Path, name: str | None = None) -> list[Verdict]:
    return judge(cases_of(root), names=None if name is None else [name])


@pytest.mark.slow
def test_takes_of_their_own_say_nothing(rooms: Path) -> None:
    verdicts = verdicts_on(rooms)
    assert {v.attack for v in verdicts} == set(TAKE_ATTACKS)
    assert {v.cases for v in verdicts} == {CASES}
    assert [(v.attack, v.direction, v.right) for v in verdicts if v.p < 0.01] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", TAKE_PLANTS)
def test_a_shared_take_is_found(name: str, rooms: Path, tmp_path: Path) -> None:

    shutil.copytree(rooms, tmp_path / "rooms")
    TAKE_PLANTS[name](cases_of(tmp_path / "rooms"))
    found = {v.direction: v for v in verdicts_on(tmp_path / "rooms", name)}
    assert found[DIRECTIONS[0]].right == CASES, found
    assert found[DIRECTIONS[0]].p < 0.01


def test_a_case_has_one_object_in_two_siblings_and_another_source_of_its_category() -> None:
    def question(*sources: tuple[tuple[str, int | None], ...]) -> list[Case]:
        keys = [f"part_3/box/kitchen/{number}" for number in range(1, len(sources) + 1)]
        return take_cases(Path(), [Sibling(key, keys[0], one) for key, one in zip(keys, sources, strict=True)])

    (twin,) = question((("clock", 1),), (("clock", 1), ("telephone", 1)), (("clock", 2),), ())
    assert twin.keys[1 - twin.truth].endswith("/3")
    (away,) = question((("clock", 1),), (("clock", 1),), (("clock", None),))
    assert away.keys[1 - away.truth].endswith("/3")
    assert question((("clock", 1),), (("clock", 2),), (("clock", 1), ("clock", 2))) != []
    assert question((("clock", 1),), (("clock", 1),), (("telephone", 1),)) == []
    assert question((("clock", None),), (("clock", None),), (("clock", 1),)) == []
