"""Kinds of pairs of siblings: case by case from the sources, and the pair accuracy by kind up to the file of scores."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import pytest

from avs3d_bench.contract.schema import ObservationRecord, SourceRecord
from avs3d_bench.contract.scores import PAIR_FIGURES, PAIR_KINDS, PairKind, PairScores, Scores, SiblingScores
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.formats import media
from avs3d_bench.formats.files import dump_json
from avs3d_bench.measures.pair_kinds import pair_kind
from evaluators.metrics.pairs import group_accuracies
from evaluators.protocols.listen import NO_KINDS, NO_SUCH_PAIR, listen_observation, listen_summary
from evaluators.reporting.leaderboard import read_entries
from evaluators.reporting.ranking import leaderboard_values
from evaluators.reporting.score_file import read_scores
from evaluators.reporting.terminal_table import print_scores
from evaluators.score import evaluate
from evaluators.summary import summarise
from evaluators.verify import verify
from tests.evaluators.test_score import submit, true_mask
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, GROUP, SECOND, SILENT


@pytest.fixture(scope="module")
def data(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=17)


@pytest.fixture(scope="module")
def example(data: Path) -> ObservationRecord:
    record = Dataset(data)[FIRST].record
    assert record is not None
    return record


def having(example: ObservationRecord, *sources: tuple[int | None, str] | SourceRecord) -> ObservationRecord:
    """A sibling with sources (instance, category); no instance: in another room."""
    (first,) = example.sources or ()
    made = tuple(
        one
        if isinstance(one, SourceRecord)
        else first.model_copy(update={"id": f"source_{number}", "instance": one[0], "category": one[1]})
        for number, one in enumerate(sources, start=1)
    )
    return example.model_copy(update={"sources": made})


MICROWAVE, TWIN, TELEPHONE = (1, "microwave"), (3, "microwave"), (2, "telephone")
NEXT_ROOM, NEXT_MICROWAVE = (None, "telephone"), (None, "microwave")


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((MICROWAVE,), (TWIN,), "twins"),
        ((MICROWAVE,), (TELEPHONE,), "category"),
        ((MICROWAVE,), (NEXT_ROOM,), "off_screen"),
        ((MICROWAVE,), (NEXT_MICROWAVE,), "off_screen"),
        ((NEXT_ROOM,), (NEXT_MICROWAVE,), "off_screen"),
        ((MICROWAVE,), (), "silence"),
        ((NEXT_ROOM,), (), "silence"),
        ((), (), "silence"),
        ((MICROWAVE, TELEPHONE), (MICROWAVE,), "several"),
        ((MICROWAVE, TWIN), (), "several"),
        ((MICROWAVE, NEXT_ROOM), (NEXT_ROOM,), "several"),
        ((MICROWAVE, TELEPHONE), (TWIN, TELEPHONE), "several"),
    ],
)
def test_the_kind_of_a_pair(
    example: ObservationRecord,
    first: tuple[tuple[int | None, str], ...],
    second: tuple[tuple[int | None, str], ...],
    expected: PairKind,
):
    one, other = having(example, *first), having(example, *second)
    assert pair_kind(one, other) == pair_kind(other, one) == expected


def test_the_same_instance_at_other_times_is_a_question_of_presence(example: ObservationRecord):
    (source,) = example.sources or ()
    later = source.model_copy(update={"programme": ((4.0, 6.0),)})
    assert pair_kind(having(example, source), having(example, later)) == "silence"


def test_the_kinds_of_a_group(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, true_mask), data).scores
    (siblings,) = scores.siblings or ()
    found = {frozenset((pair.first, pair.second)): pair.kind for pair in siblings.pairs}
    assert found == {
        frozenset(pair): "several" if BOTH in pair else "silence" if SILENT in pair else "off_screen" if AWAY in pair
        else "twins" for pair in combinations(GROUP, 2)
    }  # fmt: skip
    assert found[frozenset((FIRST, SECOND))] == "twins"


def category_of(frame: Frame):
    """Marks every microwave where one sounds: a recogniser that does not locate."""
    ids = frame.instance_ids()
    return (ids == 1) | (ids == 3) if frame.observation.key in (FIRST, SECOND) else frame.mask()


def test_a_recogniser_of_categories_has_everything_but_twins(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, category_of), data).scores
    listen = scores.overall.listen
    assert listen is not None
    assert listen.twins == 0
    assert listen.category is None
    assert listen.unavailable["category"] == NO_SUCH_PAIR
    # Right where the one that sounds covers more than half of both microwaves, or the other is out of sight.
    frames = [[frame.instance_ids() for frame in Dataset(data)[FIRST].test]] * 2
    right = [
        2 * (ids == own).sum() > ((ids == 1) | (ids == 3)).sum()
        for own, pictures in zip((1, 3), frames, strict=True)
        for ids in pictures
        if (ids == own).any()
    ]
    assert 0 < sum(right) < len(right)
    assert listen.off_screen == listen.silence == sum(right) / len(right)
    assert 0 < (listen.several or 0) < 1
    assert listen.counts["twins"] == 1
    assert listen.counts["category"] == 0
    first = next(one for one in scores.observations if one.key == FIRST).listen
    assert first is not None
    assert first.twins == 0
    away = next(one for one in scores.observations if one.key == AWAY).listen
    assert away is not None
    assert away.twins is None


def pairs(*given: tuple[PairKind | None, int, int]) -> tuple[PairScores, ...]:
    return tuple(
        PairScores(first=f"a{n}", second=f"b{n}", kind=kind, right=right, frames=frames)
        for n, (kind, right, frames) in enumerate(given)
    )


def test_a_kind_is_the_mean_over_the_groups_that_have_it():
    groups = [
        SiblingScores(
            group="g", observations=("a0",), pairs=pairs(("twins", 1, 2), ("twins", 2, 2), ("silence", 0, 4))
        ),
        SiblingScores(group="h", observations=("a0",), pairs=pairs(("twins", 0, 1), ("several", 0, 0))),
        SiblingScores(group="i", observations=("a0",), pairs=pairs(("silence", 3, 3))),
    ]
    keys = [f"a{n}" for n in range(3)]
    assert group_accuracies(groups, keys, "twins") == {"g": 3 / 4, "h": 0}
    assert group_accuracies(groups, keys, "silence") == {"g": 0, "i": 1}
    assert group_accuracies(groups, keys, "several") == {}, "no frame"
    assert group_accuracies(groups, keys) == {"g": 3 / 8, "h": 0, "i": 1}


def test_all_pairs_are_the_pairs_of_all_kinds(data: Path, tmp_path: Path):
    """Over one group, weighed by pair-frames, the kinds give the figure over all pairs."""
    scores = evaluate(submit(tmp_path / "s", data, category_of), data).scores
    (siblings,) = scores.siblings or ()
    assert scores.overall.listen is not None
    frames = {kind: sum(pair.frames for pair in siblings.pairs if pair.kind == kind) for kind in PAIR_KINDS}
    total = sum((getattr(scores.overall.listen, kind) or 0) * count for kind, count in frames.items())
    assert scores.overall.listen.pair_accuracy == pytest.approx(total / sum(frames.values()))


def test_without_sources_no_kind_is_guessed():
    siblings = SiblingScores(group="g", observations=("a0", "b0"), pairs=pairs((None, 1, 2)))
    found = listen_observation("a0", [], siblings)
    assert found.pair_accuracy == 1 / 2
    assert {getattr(found, kind) for kind in PAIR_KINDS} == {None}
    assert {found.unavailable[kind] for kind in PAIR_KINDS} == {NO_KINDS}


# --- Files of listen 1.0 ----------------------------------------------------------------------------------------------


def as_1_0(scores: Scores) -> dict[str, object]:
    """What an evaluator of listen 1.0 would have written."""

    def without(value: object) -> object:
        if isinstance(value, dict):
            lists_figures = "pair_accuracy" in value
            drop = {"kind", "bootstrap_unit"} | ({*PAIR_KINDS} if lists_figures else set())
            kept = {name: without(inner) for name, inner in value.items() if name not in drop}
            if isinstance(value.get("unavailable"), dict):
                kept["unavailable"] = {n: why for n, why in value["unavailable"].items() if n not in PAIR_KINDS}
            return kept
        return [without(inner) for inner in value] if isinstance(value, list) else value

    document = without(json.loads(dump_json(scores)))
    assert isinstance(document, dict)
    document["avs3d_eval"]["protocols"] = {"listen": "1.0"}
    return document


def test_a_file_of_1_0_is_read_and_shows_dashes(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    now = evaluate(submit(tmp_path / "s", data, category_of), data).scores
    path = tmp_path / "old.json"
    path.write_text(json.dumps(as_1_0(now)))
    old = read_scores(path)
    assert old.overall.listen is not None
    assert now.overall.listen is not None
    assert old.overall.listen.twins is None
    assert old.overall.listen.pair_accuracy == pytest.approx(now.overall.listen.pair_accuracy, abs=1e-8)
    assert json.loads(dump_json(old)) == json.loads(path.read_text()), "it is written again as it was"
    print_scores(old)
    assert "twins" not in capsys.readouterr().out.split("deaf:")[0], "a column that nothing is known of"
    (section,) = leaderboard_values(read_entries([path]))["sections"]
    (table,) = next(view.tables for view in section.views if view.part == "part_3")
    assert table.ranking.name == "pair_accuracy"


def test_a_file_of_1_0_is_verified_without_its_kinds(data: Path, tmp_path: Path):
    submit(tmp_path / "s", data, true_mask)
    document = as_1_0(evaluate(tmp_path / "s", data).scores)
    media.write_json(tmp_path / "old.json", document)
    found = verify(tmp_path / "old.json", tmp_path / "s", data)
    assert found.same, found.differences
    assert any("listen 1.0, which has no kinds of pairs" in note for note in found.notes)
    document["overall"]["listen"]["IoU"] = 0.5  # type: ignore[index]
    media.write_json(tmp_path / "old.json", document)
    found = verify(tmp_path / "old.json", tmp_path / "s", data)
    assert [one.where for one in found.differences] == ["overall.listen.IoU"]


def test_a_file_whose_kinds_do_not_follow_from_its_pairs_is_refused(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, category_of), data).scores
    document = json.loads(dump_json(scores))
    document["overall"]["listen"]["twins"] = 1.0
    (tmp_path / "edited.json").write_text(json.dumps(document))
    with pytest.raises(Exception, match=r"overall.listen.twins: 1, but its observations give 0"):
        read_scores(tmp_path / "edited.json")


def test_a_null_kind_of_1_1_is_written_with_its_reason(data: Path, tmp_path: Path):
    scores = evaluate(submit(tmp_path / "s", data, true_mask), data).scores
    media.write_json(tmp_path / "s.json", scores)
    found = json.loads((tmp_path / "s.json").read_text())["overall"]["listen"]
    assert found["category"] is None
    assert found["unavailable"]["category"] == NO_SUCH_PAIR
    assert {name for name in PAIR_FIGURES if name in found} == {*PAIR_FIGURES}


# --- Intervals --------------------------------------------------------------------------------------------------------


def test_intervals_of_part_3_resample_homes(data: Path, tmp_path: Path):
    """Three groups in each of six homes; all of a home are alike, so that only homes vary."""
    scores = evaluate(submit(tmp_path / "s", data, true_mask), data).scores
    rows, groups = [], []
    for home in range(6):
        for room in range(3):
            name = f"part_3/home_{home}/kitchen/{room + 1}"
            row = scores.observations[0].model_copy(update={"key": name, "scan": f"home_{home}", "group": name})
            rows.append(row)
            both = (name, f"{name}0")
            pair = PairScores(first=both[0], second=both[1], kind="twins", frames=10, right=10 * (home % 2))
            groups.append(SiblingScores(group=name, observations=both, pairs=(pair,)))
    found = listen_summary(rows, groups)
    assert found is not None
    assert found.twins == pytest.approx(1 / 2)
    # A resample of six homes with k right ones: binomial; .025 lies at k = 1 (P(0) = 1/64 = .016), .975 at k = 5.
    assert found.intervals["twins"] == pytest.approx((1 / 6, 5 / 6))
    alone = [row.model_copy(update={"scan": "one"}) for row in rows]
    other = summarise(alone, groups).listen
    assert other is not None
    low, high = other.intervals["twins"]
    assert 1 / 6 < low < high < 5 / 6, "18 groups of one home pretend to know more"
