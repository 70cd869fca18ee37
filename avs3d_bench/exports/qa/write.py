"""Writes a folder of questions: lines, pictures, clips, and what each picture shows.

What a method must not know is in no name and no order: lines, ids and file names are numbered in an order that is drawn
from all of the answers together, so that only who has these can repeat the draw; every line has clips of its own, of
the same form and length, so that none is seen to occur twice (made silence would).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__
from avs3d_bench.commands.outputs import Signature, check_apart
from avs3d_bench.contract import layout
from avs3d_bench.contract.questions import (
    QA_JSON,
    QUESTION_KINDS,
    QUESTIONS_JSONL,
    SCENES_JSON,
    QuestionKind,
    QuestionLine,
    QuestionsRecord,
    ScenesRecord,
    ShownObject,
    count_kinds,
)
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.qa.moments import QaMoment, groups_of, moment_of
from avs3d_bench.exports.qa.sets import QaClip, QuestionSet, question_sets
from avs3d_bench.exports.qa.templates import templates
from avs3d_bench.exports.samples import SplitChoice, frames_of, select
from avs3d_bench.formats import media
from avs3d_bench.formats.files import write_bytes, write_json
from avs3d_bench.formats.staging import refuse_strange, staged_folder
from avs3d_bench.runtime.parallel import advance, process_each

_SIGNATURE = Signature(values=(("format", "avs3d qa 1"),), exactly=False)
PICTURES, AUDIO, AMBISONICS = "pictures", "audio", "ambisonics"
_CLIPS = (f"{AUDIO}/q*.wav", f"{AMBISONICS}/q*.wav")


@dataclass(frozen=True)
class QaOptions:
    """Choices of an export.

    Attributes:
        only: shell patterns of observation keys.
        split: frames that are asked about.
        kinds: of questions; all if empty.
        per_group: most questions of a kind in a group.
        seed: of all choices.

    Examples:
        >>> QaOptions(only=("part_3/*",), kinds=("side",), per_group=2, seed=1)
        QaOptions(only=('part_3/*',), split='test', kinds=('side',), per_group=2, seed=1)
    """

    only: tuple[str, ...] = ()
    split: SplitChoice = "test"
    kinds: tuple[QuestionKind, ...] = ()
    per_group: int = 4
    seed: int = 0


def write_qa(
    root: str | Path, folder: str | Path, options: QaOptions | None = None, *, progress: bool = False
) -> QuestionsRecord:
    """Write questions about the groups of part_3, whole or not at all; the same bytes for the same data and options.

    Args:
        root: the dataset, with its truth.
        folder: replaced if it is an export of questions with no other file in it.
        options: None: `QaOptions()`.
        progress: show bars on stderr.

    Raises:
        UsageError: if the dataset has no group with its truth, a choice makes no sense, or ``folder`` is not free.
        Avs3dError: if a file is missing or damaged, nothing can be asked, or the system refuses.

    Examples:
        >>> record = write_qa("data/listen", "qa", QaOptions(split="all", kinds=("side",), seed=1))
        >>> record.kinds["side"].lines, record.kinds["side"].answers
        (12, {'left': 4, 'nothing sounds': 4, 'right': 4})
        >>> from avs3d_bench.formats.questions import read_questions
        >>> line = read_questions("qa")[0]
        >>> line.question, line.options
        ('Going by the sound alone, on which side of you is its source?', ('nothing sounds', 'right', 'left'))
    """
    chosen = options or QaOptions()
    dataset, groups = _groups(root, chosen)
    check_apart(Path(folder), (dataset.root,), folder=True)
    with staged_folder(folder, partial(_refuse_others, Path(folder), dataset.root)) as fresh:
        moments = _moments(groups, chosen.split, progress)
        sets = question_sets(
            moments, templates(), per_group=chosen.per_group, seed=chosen.seed, kinds=chosen.kinds
        )  # fmt: skip
        if not sets:
            raise Avs3dError(
                f"{dataset.root}: nothing can be asked: no frame of split {chosen.split} has siblings that differ in "
                "what is clearly heard; expected groups such as those of `avs3d manifest sample --groups listen`"
            )
        writer = _Writer(dataset, fresh, _receivers(groups))
        lines = writer.write(sets, {(one.group, one.frame): one for one in moments}, progress)
        text = "".join(f"{line.model_dump_json(exclude_none=True)}\n" for line in lines).encode()
        write_bytes(fresh / QUESTIONS_JSONL, text)
        write_json(fresh / SCENES_JSON, ScenesRecord(scenes=writer.scenes))
        record = dataset.record
        found = QuestionsRecord(
            toolkit_version=__version__, dataset=dataset.name, dataset_version=record.version if record else "unknown",
            dataset_sha256=media.sha256_file(dataset.root / layout.DATASET_JSON) if record else None,
            licence=record.licence if record else None, seed=chosen.seed, split=chosen.split,
            questions_sha256=media.sha256_bytes(text), kinds=count_kinds(lines),
        )  # fmt: skip
        write_json(fresh / QA_JSON, found)
    return found


def _groups(root: str | Path, options: QaOptions) -> tuple[Dataset, Mapping[str, tuple[Observation, ...]]]:
    """The groups that are asked about."""
    dataset, keys = select(root, options.only)
    unknown = [kind for kind in options.kinds if kind not in QUESTION_KINDS]
    if unknown or options.per_group < 1:
        raise UsageError(
            f"kind {unknown[0]!r}: expected one of {', '.join(QUESTION_KINDS)}" if unknown
            else f"{options.per_group} questions of a kind in a group; expected at least 1"
        )  # fmt: skip
    observations = [dataset[key] for key in keys]
    for one in observations:
        if one.is_part_3 and one.record is None:
            raise UsageError(
                f"{one.path}: no {layout.OBSERVATION_JSON}; questions need the truth of a dataset (a sealed test does "
                "not publish it)"
            )
    groups = groups_of(observations)
    if not groups:
        raise UsageError(f"{dataset.root}: no group of siblings in part_3; expected some: questions compare siblings")
    return dataset, groups


def _refuse_others(named: Path, root: Path, final: Path) -> None:
    """A folder is replaced if it is empty, or an export of questions with no other file in it."""
    if final.is_relative_to(root.resolve()):
        raise UsageError(f"{named}: lies inside the dataset; choose a folder outside of {root}")
    if not final.exists():
        return
    marker = final / QA_JSON
    if not final.is_dir() or (any(final.iterdir()) and not (marker.is_file() and _SIGNATURE.matches(marker))):
        raise UsageError(f"{named}: exists, and `avs3d export qa` has not written it; choose another name")
    refuse_strange(final, (QUESTIONS_JSONL, QA_JSON, SCENES_JSON, f"{PICTURES}/p*.png", *_CLIPS))


def _moments(groups: Mapping[str, tuple[Observation, ...]], split: SplitChoice, progress: bool) -> tuple[QaMoment, ...]:
    work = partial(_moments_of, split)
    found = process_each(work, list(groups.values()), workers=1, label="look", progress=progress)
    return tuple(moment for _, mine in found for moment in mine)


def _moments_of(split: SplitChoice, siblings: tuple[Observation, ...]) -> list[QaMoment]:
    frames = frames_of(siblings[0], split)
    found = []
    for number, frame in enumerate(frames, start=1):
        found.append(moment_of(frame, siblings))
        advance(number, len(frames))
    return found


def _receivers(groups: Mapping[str, tuple[Observation, ...]]) -> bool:
    """Whether every sibling has ambisonics."""
    records = [one.record for siblings in groups.values() for one in siblings]
    return all(record is not None and layout.AMBISONICS in record.acoustics.receivers for record in records)


class _Writer:
    """Writes the files of lines, and keeps what their pictures show."""

    def __init__(self, dataset: Dataset, folder: Path, ambisonics: bool) -> None:
        self.dataset, self.folder, self.ambisonics = dataset, folder, ambisonics
        self.scenes: dict[str, tuple[ShownObject, ...]] = {}

    def write(
        self, sets: Sequence[QuestionSet], moments: Mapping[tuple[str, str], QaMoment], progress: bool
    ) -> tuple[QuestionLine, ...]:
        """Write the pictures and clips of all sets; their lines in the order of ids."""
        lines = numbered(sets)
        for one in {each.picture: each for each in lines}.values():
            self._picture(one.picture, one.question, moments)
        done = process_each(self._line, lines, workers=1, label="write", progress=progress)
        return tuple(line for _, line in done)

    def _line(self, task: NumberedLine) -> QuestionLine:
        one, clips = task.question, task.question.answers[task.answer]
        audio, ambisonics = [], []
        for number, clip in enumerate(clips, start=1):
            file = f"{task.id}.wav" if len(clips) == 1 else f"{task.id}_{number}.wav"
            frame = self._frame(clip.key, one.frame)
            write_bytes(self.folder / AUDIO / file, media.encode_wav(file, binaural(frame, clip), subtype="pcm16"))
            audio.append(f"{AUDIO}/{file}")
            if self.ambisonics:
                media.write_wav(self.folder / AMBISONICS / file, ambisonic(frame, clip))
                ambisonics.append(f"{AMBISONICS}/{file}")
        return QuestionLine(
            id=task.id, set=task.set, kind=one.kind, group=one.group, frame=one.frame, question=one.question,
            options=one.options, answer=task.answer, observation=clips[0].key, played=clips[0].played,
            pictures=(task.picture,), audio=tuple(audio), ambisonics=tuple(ambisonics) if self.ambisonics else None,
        )  # fmt: skip

    def _picture(self, name: str, one: QuestionSet, moments: Mapping[tuple[str, str], QaMoment]) -> None:
        moment = moments[one.group, one.frame]
        # Of any sibling: all have the same pictures, and the first of the group may not be among them.
        frame = self._frame(moment.siblings[0].key, one.frame)
        letters = {number: letter for letter, number in one.marks.items()}
        rgb = frame.rgb()
        for each in moment.objects:
            if each.instance in letters:
                draw_mark(rgb, each.pixel, letters[each.instance])
        media.write_png_rgb(self.folder / name, rgb)
        self.scenes[name] = tuple(
            ShownObject(mark=letters.get(each.instance), category=each.category, azimuth=each.azimuth,
                        elevation=each.elevation, distance=each.distance)
            for each in moment.objects
        )  # fmt: skip

    def _frame(self, key: str, name: str) -> Frame:
        observation = self.dataset[key]
        return observation.frames[observation.frame_names.index(name)]


@dataclass(frozen=True)
class NumberedLine:
    """A line before its files are written.

    Attributes:
        id: q00001, …
        set: s00001, …
        picture: its file.
        question: the set.
        answer: the option that is right.
    """

    id: str
    set: str
    picture: str
    question: QuestionSet
    answer: str


def numbered(sets: Sequence[QuestionSet]) -> tuple[NumberedLine, ...]:
    """The lines of all sets in an order that cannot be drawn again without their answers, numbered in it.

    A set is numbered as the first of its lines.
    """
    told = json.dumps([asdict(one) for one in sets], sort_keys=True).encode()
    rng = np.random.default_rng(np.frombuffer(hashlib.sha256(told).digest(), "<u4"))
    lines = [(place, answer) for place, one in enumerate(sets) for answer in one.answers]
    order = [lines[place] for place in rng.permutation(len(lines))]
    titles: dict[int, int] = {}
    for place, _ in order:
        titles.setdefault(place, len(titles) + 1)
    return tuple(
        NumberedLine(f"q{number:05d}", f"s{titles[place]:05d}", f"{PICTURES}/p{titles[place]:05d}.png", sets[place],
                     answer)
        for number, (place, answer) in enumerate(order, start=1)
    )  # fmt: skip


def binaural(frame: Frame, clip: QaClip) -> NDArray[np.float32]:
    """(2, n) what is played of a frame's two ears, float32, full scale ±1.

    Raises:
        Avs3dError: if the file is missing or damaged.
    """
    sound = frame.audio()
    if clip.digital:
        return np.zeros_like(sound)
    return np.ascontiguousarray(sound[::-1]) if clip.played == "swapped" else sound


def ambisonic(frame: Frame, clip: QaClip) -> NDArray[np.float32]:
    """(channels, n) the same of a frame's ambisonics (ACN, SN3D).

    Left and right are exchanged by the sign of the components that are odd in y, those of negative order m: channel
    n = l² + l + m (Zotter & Frank, *Ambisonics*, Springer 2019, §4.2).

    Raises:
        Avs3dError: if the file is missing or damaged.
    """
    sound = frame.ambisonics()
    if clip.digital:
        return np.zeros_like(sound)
    if clip.played != "swapped":
        return sound + np.float32(0)
    channels = np.arange(len(sound))
    degree = np.sqrt(channels).astype(int)
    order = channels - degree * (degree + 1)
    # + 0 makes 0 of −0, which would tell that a clip was mirrored.
    return np.asarray(sound * np.where(order < 0, -1, 1)[:, None] + 0, dtype=np.float32)


def draw_mark(rgb: NDArray[np.uint8], pixel: tuple[int, int], letter: str) -> None:
    """Draw a letter on a disc into a picture (H, W, 3), in place, around a pixel (column, row)."""
    radius = max(9, rgb.shape[0] // 36)
    column, row = (
        min(max(place, radius), size - 1 - radius) for place, size in zip(pixel, rgb.shape[1::-1], strict=True)
    )
    cv2.circle(rgb, (column, row), radius, (255, 255, 255), -1, cv2.LINE_AA)
    cv2.circle(rgb, (column, row), radius, (0, 0, 0), max(1, radius // 8), cv2.LINE_AA)
    scale = radius / 15
    (width, height), _ = cv2.getTextSize(letter, cv2.FONT_HERSHEY_SIMPLEX, scale, max(1, radius // 6))
    place = (column - width // 2, row + height // 2)
    cv2.putText(rgb, letter, place, cv2.FONT_HERSHEY_SIMPLEX, scale, (0, 0, 0), max(1, radius // 6), cv2.LINE_AA)
