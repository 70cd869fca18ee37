"""Questions with exact answers: who hears nothing is at chance, and nothing but the sound tells the answer."""

from __future__ import annotations

import json
import shutil
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract.questions import QUESTION_KINDS, QuestionLine, by_set, count_kinds
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.cli import export
from avs3d_bench.exports.qa.moments import QaMoment, QaObject, QaSibling, QaSource
from avs3d_bench.exports.qa.sets import QaClip, QuestionSet, mirrored, question_sets
from avs3d_bench.exports.qa.templates import NOTHING, templates
from avs3d_bench.exports.qa.write import NumberedLine, QaOptions, ambisonic, binaural, numbered, write_qa
from avs3d_bench.formats import media
from avs3d_bench.formats.questions import read_questions
from tests.support import tiny, tiny_receivers, tiny_scenes
from tests.support.shared import SharedDataset

ALL = QaOptions(split="all")
#: Groups of synthetic moments.
GROUPS = 80


def moment(group: int, frame: int) -> QaMoment:
    """Two or three equal objects ahead, each of which sounds in two siblings; several sources, one off-screen, silence.

    What a deaf rule could use is lopsided: the nearest object is the left one more often than not.
    """
    rng = np.random.default_rng([group, frame])
    count = 2 + group % 2
    azimuths = np.sort(rng.choice(np.arange(-80, 81, 12), count, replace=False)).astype(float)
    distances = np.sort(rng.uniform(0.7, 5.0, count))
    objects = tuple(
        QaObject(n + 1, "microwave", azimuth, -5.0, distance, 0.01, (10 + n, 5))
        for n, (azimuth, distance) in enumerate(zip(azimuths, distances, strict=True))
    )
    sources = [QaSource(o.instance, o.category, o.azimuth, o.azimuth, o.distance, -30.0, None) for o in objects]
    away = QaSource(None, "microwave", 60.0, 60.0, 6.0, -40.0, None)
    sounds: list[tuple[QaSource, ...]] = [(one,) for one in sources * 2]
    sounds += [(away,), tuple(sources[:2]), *([()] if group % 3 else [])]
    siblings = tuple(
        QaSibling(f"part_3/home_{group}/kitchen/{n}", some, not some)
        for n, some in enumerate((sounds[i] for i in rng.permutation(len(sounds))), start=1)
    )
    return QaMoment(f"part_3/home_{group}/kitchen/1", f"frame_{frame:03d}", objects, siblings)


MOMENTS = {(m.group, m.frame): m for g in range(GROUPS) for m in (moment(g, f) for f in (0, 8, 16))}


@pytest.fixture(scope="module")
def sets() -> list[QuestionSet]:
    return question_sets(MOMENTS.values(), templates(), per_group=2, seed=0)


def line_of(line: NumberedLine) -> QuestionLine:
    """A line as it is written, without files."""
    one, clips = line.question, line.question.answers[line.answer]
    audio = tuple(f"audio/{line.id}_{n}.wav" for n in range(len(clips)))
    return QuestionLine(
        id=line.id, set=line.set, kind=one.kind, group=one.group, frame=one.frame, question=one.question,
        options=one.options, answer=line.answer, observation=clips[0].key, played=clips[0].played,
        pictures=(line.picture,), audio=audio,
    )  # fmt: skip


@pytest.fixture(scope="module")
def lines(sets: list[QuestionSet]) -> tuple[QuestionLine, ...]:
    return tuple(map(line_of, numbered(sets)))


def source_of(one: QuestionSet, clip: QaClip) -> tuple[QaSource, ...]:
    return next(s.sources for s in MOMENTS[one.group, one.frame].siblings if s.key == clip.key)


# Balance


def test_all_kinds_are_asked_and_no_prior_exceeds_chance(lines: tuple[QuestionLine, ...]) -> None:
    counts = count_kinds(lines)
    assert tuple(counts) == QUESTION_KINDS
    for kind, found in counts.items():
        assert found.sets > 50, kind
        assert found.prior_excess == pytest.approx(0, abs=1e-12), kind


def test_a_prior_that_exceeds_chance_is_seen(lines: tuple[QuestionLine, ...]) -> None:
    lopsided = [line for line in lines if line.kind == "side" and (line.played != "silence" or line.id[-1] == "1")]
    assert count_kinds(tuple(lopsided))["side"].prior_excess > 0.1
    first = [line.model_copy(update={"answer": line.options[0]}) for line in lines if line.kind == "count"]
    assert count_kinds(tuple(first))["count"].prior_excess > 0.5


def test_a_deaf_solver_is_at_chance_in_every_set(sets: list[QuestionSet], lines: tuple[QuestionLine, ...]) -> None:
    """It sees all texts, the picture and its truth: whatever it makes of them is the same for all lines of a set."""
    shown = {(one.group, one.frame, one.question, one.options): one for one in sets}

    def deaf(line: QuestionLine) -> str:
        one = shown[line.group, line.frame, line.question, line.options]
        objects = MOMENTS[line.group, line.frame].objects
        nearest = min(objects, key=lambda each: each.distance)
        marked = [letter for letter, number in one.marks.items() if number == nearest.instance]
        return marked[0] if marked else line.options[len(line.question) % len(line.options)]

    for some in by_set(lines):
        assert sum(deaf(line) == line.answer for line in some) == 1
        assert len(some) == len(some[0].options)


def test_a_blind_solver_cannot_tell_which_letter_is_where(sets: list[QuestionSet]) -> None:
    """It hears the direction perfectly; the best rule from direction to letter is at chance on lines that sound."""
    for count in (2, 3):
        hits: dict[int, Counter[str]] = defaultdict(Counter)
        for one in sets:
            if len(one.marks) == count:
                order = sorted(one.marks.values())  # instances are numbered from left to right
                for letter, number in one.marks.items():
                    hits[order.index(number)][letter] += 1
        asked = sum(map(Counter.total, hits.values()))
        assert asked > 100
        assert sum(max(letters.values()) for letters in hits.values()) / asked == pytest.approx(1 / count, abs=0.01)


def test_sibling_swapped_ears_and_silence_have_the_answers_that_they_must_have(sets: list[QuestionSet]) -> None:
    texts, seen = templates(), Counter[str]()
    for one in sets:
        for text, clips in one.answers.items():
            meaning = texts.meaning(one.kind, text)
            if clips[0].played == "silence":
                assert meaning in (NOTHING, "0", "no")
                assert clips[0].digital == bool(source_of(one, clips[0]))
                seen["silence"] += 1
                continue
            sources = [source_of(one, clip) for clip in clips]
            swapped = clips[0].played == "swapped"
            told = truth(one, sources)
            assert meaning == (mirrored(told) if swapped else told), (one.kind, clips)
            seen["swapped" if swapped else "own"] += 1
        answers = {text for text, clips in one.answers.items() if clips[0].played == "own"}
        seen["siblings"] += len(answers) > 1
    assert min(seen[name] for name in ("silence", "swapped", "own", "siblings")) > 100


def truth(one: QuestionSet, sources: Sequence[tuple[QaSource, ...]]) -> str:
    """The meaning of the right answer, written once more, by another hand."""
    first = sources[0][0]
    if one.kind == "which":
        return next(letter for letter, number in one.marks.items() if number == first.instance)
    if one.kind == "side":
        return "left" if first.azimuth < 0 else "right"
    if one.kind == "azimuth":
        size, side = abs(first.azimuth), "left" if first.azimuth < 0 else "right"
        return "ahead" if size < 20 else side if size < 50 else f"far_{side}"
    if one.kind == "distance":
        return "near" if first.distance < 1.5 else "middle" if first.distance < 3 else "far"
    if one.kind == "moved":
        change = sources[1][0].azimuth - first.azimuth
        return "stayed" if change == 0 else "right" if change > 0 else "left"
    return {"count": str(len(sources[0])), "anything": "yes"}.get(
        one.kind, "elsewhere" if first.instance is None else "here"
    )


def test_a_sound_that_stayed_is_another_take(sets: list[QuestionSet]) -> None:
    stayed = [clips for one in sets for text, clips in one.answers.items() if text == "it has not moved"]
    assert stayed
    assert all(first.key != second.key for first, second in stayed)


# What names and orders tell


def index_of(line: QuestionLine) -> int:
    return int(line.observation.rpartition("/")[2])


#: What a method could make of a line without its sound.
FEATURES: dict[str, Callable[[QuestionLine], Hashable]] = {
    "last digit of the id": lambda line: line.id[-1],
    "id modulo 3": lambda line: int(line.id[1:]) % 3,
    "id modulo 4": lambda line: int(line.id[1:]) % 4,
    "set": lambda line: int(line.set[1:]) % 5,
    "id less set": lambda line: int(line.id[1:]) - int(line.set[1:]) > 400,
    "number of the sibling": index_of,
    "whether it is the first": lambda line: line.observation == line.group,
    "frame": lambda line: line.frame,
    "wording": lambda line: line.question,
    "length of the name of the clip": lambda line: len(line.audio[0]),
}


@pytest.mark.parametrize("feature", FEATURES)
def test_no_field_tells_the_answer(lines: tuple[QuestionLine, ...], feature: str) -> None:
    """A table from the feature to the place, and to the text, of the answer, learnt on half of the groups."""
    half = {group: number % 2 for number, group in enumerate(sorted({line.group for line in lines}))}
    for what in (lambda line: line.options.index(line.answer), lambda line: line.answer):
        table: dict[tuple[str, int, Hashable], Counter[Hashable]] = defaultdict(Counter)
        for line in lines:
            if half[line.group] == 0:
                table[line.kind, len(line.options), FEATURES[feature](line)][what(line)] += 1
        right, chance = [], []
        for line in lines:
            known = table.get((line.kind, len(line.options), FEATURES[feature](line)))
            if half[line.group] == 1 and known:
                right.append(what(line) == max(known, key=lambda name: (known[name], str(name))))
                chance.append(1 / len(line.options))
        spread = np.sqrt(np.mean(np.multiply(chance, np.subtract(1, chance))) / len(right))
        assert len(right) > 500
        assert np.mean(right) - np.mean(chance) < 4 * spread, (np.mean(right), np.mean(chance))


def test_the_order_can_not_be_drawn_again_without_the_answers(sets: list[QuestionSet]) -> None:
    """Another truth of one set changes the order of all lines."""
    first = sets[0]
    (a, one), (b, other), *rest = first.answers.items()
    changed = QuestionSet(**{**vars(first), "answers": {a: other, b: one, **dict(rest)}})
    before, after = numbered(sets), numbered([changed, *sets[1:]])
    same = sum(x.question.frame == y.question.frame and x.question.group == y.question.group
               for x, y in zip(before, after, strict=True))  # fmt: skip
    assert same < len(before) / 10


def test_the_same_moments_give_the_same_questions_in_any_order(sets: list[QuestionSet]) -> None:
    again = question_sets(reversed(MOMENTS.values()), templates(), per_group=2, seed=0)
    assert again == sets
    assert question_sets(MOMENTS.values(), templates(), per_group=2, seed=1) != sets


def test_nothing_is_asked_that_margins_forbid() -> None:
    def alone(**changes: float) -> list[QuestionSet]:
        base = {"azimuth": -30.0, "lateral": -30.0, "distance": 2.0, "level_db": -30.0, "snr_db": None}
        source = QaSource(1, "clock", **{**base, **changes})  # type: ignore[arg-type]
        siblings = (QaSibling("part_3/a/kitchen/1", (source,), False), QaSibling("part_3/a/kitchen/2", (), True))
        return question_sets([QaMoment("part_3/a/kitchen/1", "frame_000", (), siblings)], templates(), per_group=1,
                             seed=0)  # fmt: skip

    assert {one.kind for one in alone()} == {"side", "azimuth", "anything"}
    assert {one.kind for one in alone(azimuth=-19.0, lateral=-19.0)} == {"side", "anything"}, "near the edge of a bin"
    assert {one.kind for one in alone(azimuth=-5.0, lateral=-5.0)} == {"anything"}, "neither left nor right"
    assert alone(level_db=-55.0) == []
    assert alone(snr_db=-3.0) == []


# The export


@pytest.fixture(scope="module")
def written(shared_part_3: SharedDataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """(dataset, questions) of a group made by hand."""
    root = shared_part_3(frames=9)
    folder = tmp_path_factory.mktemp("qa") / "qa"
    write_qa(root, folder, ALL)
    return root, folder


def test_clips_are_those_of_the_observations_in_one_form(written: tuple[Path, Path]) -> None:
    root, folder = written
    dataset, sizes = Dataset(root), set()
    lines = read_questions(folder)
    assert {"which", "side", "count", "anything", "room"} <= {line.kind for line in lines}
    for line in lines:
        frame = next(each for each in dataset[line.observation].frames if each.name == line.frame)
        own, played = frame.audio(), media.read_wav(folder / line.audio[0]).samples
        if line.played == "silence":
            assert not dataset[line.observation].record.sound_sources or not played.any()  # type: ignore[union-attr]
        else:
            assert np.abs(played - (own[::-1] if line.played == "swapped" else own)).max() < 1e-4
        sizes |= {(folder / name).stat().st_size for name in line.audio}
        assert all((folder / name).is_file() for name in line.pictures)
    assert len(sizes) == 1, "the length of a file tells nothing"
    names = [name for line in lines for name in line.audio]
    assert len({*names}) == len(names), "no clip is seen to occur twice"


def test_marks_are_on_the_objects_that_scenes_name(written: tuple[Path, Path]) -> None:
    root, folder = written
    scenes = json.loads((folder / "scenes.json").read_text())["scenes"]
    asked = [line for line in read_questions(folder) if line.kind == "which"]
    assert asked
    for line in asked:
        shown = {each["mark"]: each for each in scenes[line.pictures[0]]}
        assert {*line.options} <= {*shown, "nothing sounds"}
        frame = next(each for each in Dataset(root)[line.group].frames if each.name == line.frame)
        changed = (media.read_png_rgb(folder / line.pictures[0]) != frame.rgb()).any(axis=2)
        assert 0 < changed.mean() < 0.7
        if line.played == "own":
            truth = next(each for each in Dataset(root)[line.observation].record.frames if each.name == line.frame)  # type: ignore[union-attr]
            assert shown[line.answer]["azimuth"] == pytest.approx(truth.azimuth, abs=6)


def test_the_same_data_give_the_same_bytes_and_a_rerun_replaces_its_own(
    written: tuple[Path, Path], tmp_path: Path
) -> None:
    root, folder = written
    again = tmp_path / "qa"
    write_qa(root, again, QaOptions(per_group=1))
    for mine in ("answers.jsonl", "audio/notes.txt"):
        (again / mine).write_text("mine")
        with pytest.raises(UsageError, match=rf"qa/{mine}: no file that this command writes; move it away"):
            write_qa(root, again, ALL)
        (again / mine).unlink()
    write_qa(root, again, ALL)
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(again) for path in again.rglob("*") if path.is_file())
    assert all((folder / name).read_bytes() == (again / name).read_bytes() for name in files)


def test_a_group_without_its_first_observation_has_the_same_pictures(
    shared_part_3: SharedDataset, tmp_path: Path
) -> None:
    root = tiny.clone(shared_part_3(frames=9), tmp_path / "data")
    shutil.rmtree(root / tiny_scenes.FIRST)
    write_qa(root, tmp_path / "qa", QaOptions(split="all", kinds=("side",)))
    for line in read_questions(tmp_path / "qa"):
        frame = next(one for one in Dataset(root)[tiny_scenes.SECOND].frames if one.name == line.frame)
        assert (media.read_png_rgb(tmp_path / "qa" / line.pictures[0]) == frame.rgb()).all()


def test_swapping_ambisonics_mirrors_the_direction(tmp_path: Path) -> None:
    root = tiny_scenes.write_part_3(tmp_path / "data", frames=1, keys=tiny_scenes.GROUP[:2])
    tiny_receivers.add_waves(root)
    frame = Dataset(root)[tiny_scenes.FIRST].frames[0]
    path = frame.observation.path / "audio_clips_ambisonics/frame_0.wav"
    samples = np.random.default_rng(0).normal(0, 0.1, 44_100)
    media.write_wav(path, tiny_receivers.plane_wave(samples, 40.0, 20.0))
    swapped = ambisonic(frame, QaClip(tiny_scenes.FIRST, "swapped"))
    assert np.allclose(swapped, tiny_receivers.plane_wave(samples, -40.0, 20.0), atol=1e-6)
    media.write_wav(path, np.zeros((4, 44_100), dtype=np.float32))
    for played in ("own", "swapped"):
        assert not np.signbit(ambisonic(frame, QaClip(tiny_scenes.FIRST, played))).any()  # −0 would tell
    write_qa(root, tmp_path / "qa", QaOptions(split="all"))
    for line in read_questions(tmp_path / "qa"):
        assert line.ambisonics is not None
        assert [name.partition("/")[2] for name in line.ambisonics] == [n.partition("/")[2] for n in line.audio]
        assert media.read_wav(tmp_path / "qa" / line.ambisonics[0]).samples.shape == (4, 44_100)
    assert not binaural(frame, QaClip(tiny_scenes.FIRST, "silence", digital=True)).any()


def test_the_command_says_what_it_wrote(shared_part_3: SharedDataset, tmp_path: Path) -> None:
    out = tmp_path / "qa"
    arguments = [
        "qa",
        str(shared_part_3(frames=9)),
        "-o",
        str(out),
        "--kind",
        "side",
        "--kind",
        "distance",
        "--kind",
        "side",
    ]
    result = CliRunner().invoke(export, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    first, *rest = result.output.splitlines()
    assert first.startswith("side: 6 lines in 2 sets of 1 groups, chance 0.333, best answer without sound 0.333")
    assert rest[-1] == str(out)
    assert {line.kind for line in read_questions(out)} <= {"side", "distance"}


def test_bad_input_is_named(shared_dataset: SharedDataset, shared_part_3: SharedDataset, tmp_path: Path) -> None:
    scenes = shared_part_3(frames=9)
    out = tmp_path / "qa"

    def fails(root: Path, message: str, options: QaOptions | None = None, folder: Path = out) -> None:
        with pytest.raises(Avs3dError, match=message):
            write_qa(root, folder, options)
        assert not out.exists()

    fails(shared_dataset(frames=9), "no group of siblings in part_3")
    fails(scenes, "none of 5 observations matches part_9", QaOptions(only=("part_9/*",)))
    fails(scenes, "no group of siblings", QaOptions(only=(tiny_scenes.FIRST,)))
    fails(scenes, "kind 'colour': expected one of which", QaOptions(kinds=("colour",)))  # type: ignore[arg-type]
    fails(scenes, "0 questions of a kind", QaOptions(per_group=0))
    fails(scenes, "would change .*, which is read|lies inside the dataset", folder=scenes / "part_3/qa")
    only_silence = QaOptions(only=(tiny_scenes.SILENT, tiny_scenes.BOTH), kinds=("which",))
    fails(scenes, "nothing can be asked", only_silence)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    fails(scenes, "exists, and `avs3d export qa` has not written it", folder=tmp_path / "mine")
    assert (tmp_path / "mine/notes.txt").read_text() == "mine"
    damaged = tiny.clone(scenes, tmp_path / "damaged")
    tiny.replace(damaged / tiny_scenes.SECOND / "audio_clips_binaural/frame_8.wav", b"no sound")
    fails(damaged, r"audio_clips_binaural/frame_8\.wav")


def test_lines_that_are_damaged_are_named(written: tuple[Path, Path], tmp_path: Path) -> None:
    text = (written[1] / "questions.jsonl").read_text().splitlines()
    (tmp_path / "questions.jsonl").write_text("\n".join([text[0], text[1].replace('"options":[', '"options":["x",'),
                                                         text[2][:50]]))  # fmt: skip
    with pytest.raises(Avs3dError, match=r"questions\.jsonl:3: Invalid JSON"):
        read_questions(tmp_path)
    (tmp_path / "questions.jsonl").write_text(f"{text[0]}\n{text[0]}\n")
    with pytest.raises(Avs3dError, match="an id is listed twice"):
        read_questions(tmp_path)
    with pytest.raises(UsageError, match=r"no questions\.jsonl; expected a folder that `avs3d export qa` wrote"):
        read_questions(tmp_path / "nowhere")


def test_a_group_without_its_truth_is_refused(shared_part_3: SharedDataset, tmp_path: Path) -> None:
    root = tiny.clone(shared_part_3(frames=9), tmp_path / "data")
    (root / tiny_scenes.SECOND / "observation.json").unlink()
    with pytest.raises(UsageError, match=r"kitchen/2: no observation\.json; questions need the truth of a dataset"):
        write_qa(root, tmp_path / "qa")
