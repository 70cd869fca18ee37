"""Question sets: one question under several sounds, each of its options right under exactly one of them.

Balance is not reached by dropping lines from a large pool, but set by set: a set has as many lines as options, and each
option is the answer of one. Whoever answers from the text, the pictures or habit gives the same answer to all lines of
a set and is right in one: every prior over texts, positions or pictures is at chance exactly, in every kind and group.

The sounds of a set are those of siblings, the same with left and right exchanged, and silence (that of a silent
sibling where there is one). The letters of marked objects are dealt so that every order from left to right is as
frequent as any other: who hears the direction and does not see the picture cannot tell which letter it is.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from avs3d_bench.contract.questions import Played, QuestionKind
from avs3d_bench.exports.qa.moments import QaMoment, QaObject, QaSibling, QaSource
from avs3d_bench.exports.qa.templates import NOTHING, Templates

LETTERS = "ABCDEFGH"


@dataclass(frozen=True)
class QaClip:
    """What is played: the clip of a sibling, as it is or with left and right exchanged, or nothing at all.

    Attributes:
        key: the sibling's.
        played: own, swapped or silence.
        digital: silence that is made, as no sibling is silent.
    """

    key: str
    played: Played = "own"
    digital: bool = False


@dataclass(frozen=True)
class QuestionSet:
    """One question and its sounds.

    Attributes:
        kind: of the question.
        group: of the siblings.
        frame: its name.
        question: text.
        options: texts, in the order in which they are shown.
        answers: text of an option → the clips that make it right, one after the other.
        marks: letter → instance that the picture marks with it.
    """

    kind: QuestionKind
    group: str
    frame: str
    question: str
    options: tuple[str, ...]
    answers: Mapping[str, tuple[QaClip, ...]]
    marks: Mapping[str, int]


#: Meaning of an option → clips; before texts are chosen. Marked objects are named by their instances.
Draft = Mapping[str, tuple[QaClip, ...]]


def question_sets(
    moments: Iterable[QaMoment], texts: Templates, *, per_group: int, seed: int, kinds: Sequence[QuestionKind] = ()
) -> list[QuestionSet]:
    """The question sets of a dataset, in the order of groups and kinds; the same for the same arguments.

    Args:
        moments: what is seen and heard; the order makes no difference.
        texts: wordings, options, bins and margins.
        per_group: most sets of a kind in a group, each of another frame.
        seed: of all choices.
        kinds: which ones; all if empty.
    """
    by_group: dict[str, list[QaMoment]] = {}
    for moment in sorted(moments, key=lambda one: (one.group, one.frame)):
        by_group.setdefault(moment.group, []).append(moment)
    found = []
    for group, mine in by_group.items():
        for kind in dict.fromkeys(kinds or _DRAFTS):
            rng = np.random.default_rng(_words(seed, group, kind))
            drafts = [(moment, some) for moment in mine if (some := list(_DRAFTS[kind](moment, texts)))]
            for place in rng.permutation(len(drafts))[:per_group]:
                moment, some = drafts[place]
                found.append(_worded(kind, moment, some[rng.integers(len(some))], texts, rng))
    return _lettered(found, np.random.default_rng(_words(seed, "letters")))


def _words(*parts: object) -> list[int]:
    """Seed words that do not depend on the machine."""
    digest = hashlib.sha256("\0".join(map(str, parts)).encode()).digest()
    return [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]


def _worded(
    kind: QuestionKind, moment: QaMoment, draft: Draft, texts: Templates, rng: np.random.Generator
) -> QuestionSet:
    """A draft in words; letters of marked objects are dealt later, until when they are named by their instance."""
    form = texts.kinds[kind]
    answers = {form.options.get(meaning, meaning): clips for meaning, clips in draft.items()}
    options = list(answers)
    return QuestionSet(
        kind, moment.group, moment.frame, form.wordings[rng.integers(len(form.wordings))],
        tuple(options[place] for place in rng.permutation(len(options))), answers,
        {meaning: int(meaning) for meaning in draft if kind == "which" and meaning != NOTHING},
    )  # fmt: skip


def _lettered(sets: Sequence[QuestionSet], rng: np.random.Generator) -> list[QuestionSet]:
    """Deal the letters: each order of the marked objects, from left to right, as often as any other."""
    dealt: dict[int, Iterator[tuple[int, ...]]] = {}
    for count in sorted({len(one.marks) for one in sets} - {0}):
        orders = list(permutations(range(count)))
        number = sum(len(one.marks) == count for one in sets)
        dealt[count] = iter([orders[place % len(orders)] for place in rng.permutation(number)])
    return [_with_letters(one, next(dealt[len(one.marks)])) if one.marks else one for one in sets]


def _with_letters(one: QuestionSet, order: tuple[int, ...]) -> QuestionSet:
    letters = {name: LETTERS[place] for name, place in zip(one.marks, order, strict=True)}
    answers = {letters.get(name, name): clips for name, clips in one.answers.items()}
    return replace(
        one, answers=answers, marks={letters[name]: number for name, number in one.marks.items()},
        # Letters in their order; where "nothing" stands among them was drawn.
        options=_options(one.options, sorted(letters.values()), letters),
    )  # fmt: skip


def _options(drawn: tuple[str, ...], sorted_letters: Sequence[str], letters: Mapping[str, str]) -> tuple[str, ...]:
    following = iter(sorted_letters)
    return tuple(next(following) if name in letters else name for name in drawn)


# --- Drafts of each kind ----------------------------------------------------------------------------------------------


def _is_heard(source: QaSource, texts: Templates) -> bool:
    margins = texts.margins
    return source.level_db >= margins.level_db and (source.snr_db is None or source.snr_db >= margins.snr_db)


def _singles(moment: QaMoment, texts: Templates) -> list[tuple[QaSibling, QaSource]]:
    """Siblings in which one source is audible, clearly so, and the source."""
    return [
        (one, one.sources[0])
        for one in moment.siblings
        if len(one.sources) == 1 and _is_heard(one.sources[0], texts)
    ]  # fmt: skip


def _here(moment: QaMoment, texts: Templates) -> list[tuple[QaSibling, QaSource]]:
    """The single sources in the room."""
    return [(one, source) for one, source in _singles(moment, texts) if source.instance is not None]


def _silence(moment: QaMoment, beside: QaSibling) -> QaClip:
    """Silence: of the first sibling without sources, else made."""
    silent = next((one for one in moment.siblings if one.silent), None)
    return QaClip(silent.key, "silence") if silent else QaClip(beside.key, "silence", digital=True)


def mirrored(meaning: str) -> str:
    """The meaning of an option under swapped ears."""
    if "left" in meaning:
        return meaning.replace("left", "right")
    return meaning.replace("right", "left")


def _which(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """Identical objects in view, each of which sounds alone in some sibling."""
    heard: dict[int, list[QaSibling]] = {}
    for one, source in _here(moment, texts):
        if source.instance is not None:
            heard.setdefault(source.instance, []).append(one)
    for category in sorted({one.category for one in moment.objects}):
        seen = [
            one for one in moment.objects
            if one.category == category and one.share >= texts.margins.visible and one.instance in heard
        ][: len(LETTERS)]  # fmt: skip
        if len(seen) < 2 or any(
            abs(_lateral(a) - _lateral(b)) < texts.margins.apart_deg for a, b in combinations(seen, 2)
        ):
            continue
        for turn in range(max(len(heard[one.instance]) for one in seen)):
            chosen = [(one, heard[one.instance][turn % len(heard[one.instance])]) for one in seen]
            yield {
                **{str(one.instance): (QaClip(sibling.key),) for one, sibling in chosen},
                NOTHING: (_silence(moment, chosen[0][1]),),
            }


def _lateral(one: QaObject) -> float:
    return math.degrees(math.asin(math.cos(math.radians(one.elevation)) * math.sin(math.radians(one.azimuth))))


def _side(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """A source on the left and one on the right; and a source, and the same with swapped ears."""
    sides: dict[str, list[QaSibling]] = {"left": [], "right": []}
    for one, source in _here(moment, texts):
        if abs(source.lateral) >= texts.margins.side_deg:
            sides["left" if source.lateral < 0 else "right"].append(one)
    for left in sides["left"]:
        for right in sides["right"]:
            yield {"left": (QaClip(left.key),), "right": (QaClip(right.key),), NOTHING: (_silence(moment, left),)}
    for side, siblings in sides.items():
        for one in siblings:
            yield {
                side: (QaClip(one.key),),
                mirrored(side): (QaClip(one.key, "swapped"),),
                NOTHING: (_silence(moment, one),),
            }


def _azimuth(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """Sources in different bins in front, with their mirror images where these are in yet another bin."""
    form = texts.kinds["azimuth"]
    placed = [
        (one, place) for one, source in _here(moment, texts)
        if (place := form.bin(source.azimuth, texts.margins.bin_deg)) is not None
    ]  # fmt: skip
    pairs = [pair for pair in combinations(placed, 2) if pair[0][1] != pair[1][1]]
    alone = [(each,) for each in placed]
    choices: Sequence[tuple[tuple[QaSibling, str], ...]] = pairs or alone
    for some in choices:
        answers: dict[str, tuple[QaClip, ...]] = {place: (QaClip(one.key),) for one, place in some}
        for one, place in some:
            answers.setdefault(mirrored(place), (QaClip(one.key, "swapped"),))
        if len(answers) > 1:
            yield {**answers, NOTHING: (_silence(moment, some[0][0]),)}


def _distance(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """Sources at different distances."""
    form = texts.kinds["distance"]
    placed = [
        (one, place) for one, source in _here(moment, texts)
        if (place := form.bin(source.distance, texts.margins.bin_m)) is not None
    ]  # fmt: skip
    yield from _apart(moment, placed)


def _count(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """One source, several, none."""
    placed = [
        (one, str(len(one.sources))) for one in moment.siblings
        if one.sources and str(len(one.sources)) in texts.kinds["count"].options
        and all(_distinct(source, texts) for source in one.sources)
    ]  # fmt: skip
    for draft in _apart(moment, placed):
        yield {"0" if meaning == NOTHING else meaning: clips for meaning, clips in draft.items()}


def _distinct(source: QaSource, texts: Templates) -> bool:
    """Whether a source among several can be told: as loud as the others together, within 10 dB."""
    return source.level_db >= texts.margins.level_db and (source.snr_db is None or source.snr_db >= -10)


def _apart(moment: QaMoment, placed: Sequence[tuple[QaSibling, str]]) -> Iterator[Draft]:
    """A sibling for each answer that some sibling has, in turns; of at least two answers."""
    by_answer: dict[str, list[QaSibling]] = {}
    for one, place in placed:
        by_answer.setdefault(place, []).append(one)
    if len(by_answer) < 2:
        return
    for turn in range(max(map(len, by_answer.values()))):
        chosen = {place: some[turn % len(some)] for place, some in sorted(by_answer.items())}
        answers = {place: (QaClip(one.key),) for place, one in chosen.items()}
        yield {**answers, NOTHING: (_silence(moment, next(iter(chosen.values()))),)}


def _anything(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """A single source, of any room, and silence."""
    for one, _ in _singles(moment, texts):
        yield {"yes": (QaClip(one.key),), "no": (_silence(moment, one),)}


def _room(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """A source in the room and one in another room."""
    singles = _singles(moment, texts)
    placed = [(one, "elsewhere" if source.instance is None else "here") for one, source in singles]
    yield from _apart(moment, placed)


def _moved(moment: QaMoment, texts: Templates) -> Iterator[Draft]:
    """Two sources of a category, one after the other; a source in two takes; and the mirror images."""
    front = [
        (one, source) for one, source in _here(moment, texts) if abs(source.azimuth) < 90
    ]  # fmt: skip
    for (a, first), (b, second) in permutations(front, 2):
        if first.category != second.category or second.lateral - first.lateral < texts.margins.moved_deg:
            continue
        again = [c for c, third in front if c is not a and third.instance == first.instance]
        silence = _silence(moment, a)
        base: dict[str, tuple[QaClip, ...]] = {"right": (QaClip(a.key), QaClip(b.key)), NOTHING: (silence, silence)}
        if again:
            base["stayed"] = (QaClip(a.key), QaClip(again[0].key))
        yield {**base, "left": (QaClip(b.key), QaClip(a.key))}
        yield {**base, "left": (QaClip(a.key, "swapped"), QaClip(b.key, "swapped"))}


_DRAFTS: Mapping[QuestionKind, Callable[[QaMoment, Templates], Iterator[Draft]]] = {
    "which": _which,
    "side": _side,
    "azimuth": _azimuth,
    "distance": _distance,
    "count": _count,
    "anything": _anything,
    "room": _room,
    "moved": _moved,
}
