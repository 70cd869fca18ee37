"""Reading a file of scores that anybody may have written, and refusing one that contradicts itself.

Whatever follows from the scores of the observations is computed again: a page never shows an edited mean. Who edits the
scores of observations as well is found only by scoring the submission again (`evaluators.verify`).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from avs3d_bench.commands.report import printable
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import parse_record
from avs3d_bench.contract.scores import (
    PAIR_FIGURES,
    PAIR_KINDS,
    PROTOCOL_PARTS,
    GroupScores,
    ListenObservation,
    ObservationScores,
    Scores,
    VerificationRecord,
    metrics_of,
)
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes
from evaluators.metrics.masks import mean
from evaluators.metrics.pairs import ALL_PAIRS, pair_accuracy, pairs_of
from evaluators.reading.origin import totals
from evaluators.summary import summarise

#: Largest file of scores (bytes): an observation takes about one KB.
MAX_SCORES_BYTES = 64 * 2**20
#: Largest difference of a mean from that of the file's own observations: values are kept to nine digits.
_ROUNDING = 1e-8
_NAMED = 100
#: Field that tells a record → its fields that came later: with `listen` 1.1, and soft masks.
_ADDED: Mapping[str, Collection[str]] = {
    "bootstrap_seed": ("bootstrap_unit",), "right": ("kind",), "pair_accuracy": PAIR_KINDS,
    "submission": ("soft",),
}  # fmt: skip
_SCORE_AGAIN = "score the submission again"


def read_scores(path: Path, *, check: bool = True) -> Scores:
    """Read what ``avs3d-eval --json`` wrote.

    Args:
        path: the file.
        check: refuse figures that do not follow from those of the observations as well.

    Raises:
        Avs3dError: if it is missing, too large, no file of scores, or contradicts itself; the field is named.
    """
    data = read_bytes(path, MAX_SCORES_BYTES)
    if data.lstrip()[:1] != b"{" and Path(path).suffix.lower() in (".csv", ".parquet", ".html", ".zip"):
        raise Avs3dError(
            f"{path}: no JSON; expected a file of scores, which avs3d-eval --json writes "
            "(avs3d factors reads the tables of --frames)"
        )
    scores = parse_record(data, Scores, path, strict=True)
    if len(scores.observations) != scores.dataset.scored:
        raise Avs3dError(
            f"{path}: observations: {len(scores.observations)} in the list, but dataset.scored is "
            f"{scores.dataset.scored}; {_SCORE_AGAIN}"
        )
    if not scores.avs3d_eval.protocols:
        raise Avs3dError(f"{path}: avs3d_eval.protocols: empty, expected official, strict or listen; score it again")
    for protocol in scores.avs3d_eval.protocols:
        if getattr(scores.overall, protocol) is None:
            raise Avs3dError(f"{path}: overall.{protocol}: null, though avs3d_eval.protocols lists it; {_SCORE_AGAIN}")
    for fault in chain(_repetitions(scores), _contradictions(scores) if check else ()):
        raise Avs3dError(f"{path}: {printable(fault)}; {_SCORE_AGAIN}")
    return scores


def contents_digest(scores: Scores) -> str:
    """Hexadecimal sha256 of the contents of a file of scores: the order of keys and the report's place do not count.

    Nor do fields without a value that earlier versions did not have: a file keeps its digest.
    """
    contents = _without_added(scores.model_dump(mode="json", exclude={"report"}))
    return hashlib.sha256(json.dumps(contents, sort_keys=True).encode()).hexdigest()


def _without_added(value: Any) -> Any:
    """A JSON document without the null fields that came later: unit of intervals, kinds of pairs, soft masks."""
    if isinstance(value, list):
        return [_without_added(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    added = {name for mark, names in _ADDED.items() if mark in value for name in names}
    return {name: _without_added(inner) for name, inner in value.items() if not (inner is None and name in added)}


def read_verification(path: Path) -> VerificationRecord:
    """Read what ``avs3d verify --json`` wrote.

    Raises:
        Avs3dError: if it is missing, too large or no such record; the field is named.
    """
    return parse_record(read_bytes(path, MAX_SCORES_BYTES), VerificationRecord, path, strict=True)


def _repetitions(scores: Scores) -> Iterator[str]:
    """Yield the entries that are listed twice, or under a name that is not their own."""
    for row in scores.observations:
        try:
            place = layout.parse_key(row.key)
        except Avs3dError:
            yield f"observations[{row.key[:_NAMED]}]: no key of an observation; expected part_N/scan/room/number"
            continue
        for name in ("part", "scan", "room"):
            if getattr(row, name) != getattr(place, name):
                yield (f"observations[{row.key[:_NAMED]}].{name}: {getattr(row, name)[:_NAMED]!r} contradicts the key")
    yield from _twice("observations", (row.key for row in scores.observations))
    yield from _twice("siblings", (one.group for one in scores.siblings or ()))
    for one in scores.siblings or ():
        where = f"siblings[{one.group[:_NAMED]}]"
        yield from _twice(f"{where}.observations", one.observations)
        yield from _twice(f"{where}.pairs", (tuple(sorted((p.first, p.second))) for p in one.pairs))


def _twice(where: str, names: Iterable[Hashable]) -> Iterator[str]:
    for name, count in Counter(names).items():
        if count > 1:
            yield f"{where}: {str(name)[:_NAMED]} is listed {count} times; expected once"


def _contradictions(scores: Scores) -> Iterator[str]:
    """The figures that do not follow from the scores of the observations, each in a line.

    After the first fault nothing more may be asked for: means assume sound observations.
    """
    rows, siblings = scores.observations, scores.siblings or ()
    for one in siblings:
        for pair in one.pairs:
            if pair.right > pair.frames:
                yield f"siblings[{one.group[:_NAMED]}]: {pair.right} right frames of {pair.frames}"
    for row in rows:
        yield from _row_faults(row, scores)

    def means(chosen: Callable[[ObservationScores], bool]) -> GroupScores:
        return summarise([row for row in rows if chosen(row)], siblings, intervals=False)

    yield from _group_faults("overall", scores.overall, means(lambda row: True))
    groupings: tuple[tuple[str, Mapping[Any, GroupScores]], ...] = (
        ("part", scores.parts), ("category", scores.categories), ("room", scores.rooms)
    )  # fmt: skip
    for field, groups in groupings:
        where = {"part": "parts", "category": "categories", "room": "rooms"}[field]
        names = {getattr(row, field) for row in rows} - {None}
        for name in sorted(names ^ groups.keys()):
            state = "has no observation" if name in groups else "is missing"
            yield f"{where}: {name[:_NAMED]} {state}"
        for name, group in groups.items():
            if name in names:
                found = means(lambda row, field=field, name=name: getattr(row, field) == name)  # type: ignore[misc]
                yield from _group_faults(f"{where}[{name[:_NAMED]}]", group, found)
    for name, parts in scores.references.items():
        yield from _reference_faults(f"references.{name[:_NAMED]}", parts)
    yield from _digest_faults(scores)


def _row_faults(row: ObservationScores, scores: Scores) -> Iterator[str]:
    where = f"observations[{row.key[:_NAMED]}]"
    for protocol, parts in PROTOCOL_PARTS.items():
        expected = protocol in scores.avs3d_eval.protocols and row.part in parts
        if (getattr(row, protocol) is not None) != expected:
            yield f"{where}.{protocol}: {'null' if expected else 'present'}, expected the contrary"
    for protocol in ("strict", "listen"):
        found = getattr(row, protocol)
        if found is not None and found.visible_frames + found.absent_frames != row.frames:
            yield (
                f"{where}.{protocol}: {found.visible_frames} frames with the object and {found.absent_frames} without, "
                f"of {row.frames}"
            )
    if isinstance(row.listen, ListenObservation):
        siblings = [one for one in scores.siblings or () if row.key in one.observations]
        for name in PAIR_FIGURES:
            accuracy, frames = pair_accuracy(pair for one in siblings for pair in pairs_of(one, [row.key], name))
            counted = row.listen.pair_frames == frames or name != ALL_PAIRS
            if not _same(getattr(row.listen, name), accuracy) or not counted:
                yield f"{where}.listen.{name}: does not follow from the pairs in siblings"
        if not _same(row.listen.class_mIoU, mean(row.listen.class_IoU.values())):
            yield f"{where}.listen.class_mIoU: is not the mean of class_IoU"


def _group_faults(where: str, group: GroupScores, found: GroupScores) -> Iterator[str]:
    """Yield the figures of a group that its observations do not give."""
    for name in ("observations", "frames"):
        if getattr(group, name) != getattr(found, name):
            yield f"{where}.{name}: {getattr(group, name)}, but the list of observations has {getattr(found, name)}"
    for protocol in PROTOCOL_PARTS:
        mine, expected = getattr(group, protocol), getattr(found, protocol)
        if (mine is None) != (expected is None):
            yield f"{where}.{protocol}: {'null' if mine is None else 'present'}, expected the contrary"
        if mine is None or expected is None:
            continue
        for metric in metrics_of(protocol):
            value, true = getattr(mine, metric.name), getattr(expected, metric.name)
            if not _same(value, true):
                yield f"{where}.{protocol}.{metric.name}: {_text(value)}, but its observations give {_text(true)}"
            interval = mine.intervals.get(metric.name)
            if interval is not None and (interval[0] > interval[1] or true is None):
                yield f"{where}.{protocol}.intervals.{metric.name}: {list(interval)} is no interval of {_text(true)}"
        for name in ("counts", "groups"):
            value, true = getattr(mine, name, None), getattr(expected, name, None)
            if value is not None and true is not None and name == "counts":
                value = dict.fromkeys(true, 0) | value  # a figure that a file of an older version lacks has no value
            if value != true:
                yield f"{where}.{protocol}.{name}: {getattr(mine, name)}, but the observations give {true}"


def _reference_faults(where: str, parts: Mapping[str, GroupScores]) -> Iterator[str]:
    """The file does not hold the observations of a reference: its overall means must follow from those of its parts."""
    overall = parts.get("overall")
    rest = [group for name, group in parts.items() if name != "overall"]
    if overall is None or not rest:
        yield f"{where}: expected overall and each part"
        return
    for name in ("observations", "frames"):
        count = sum(getattr(group, name) for group in rest)
        if getattr(overall, name) != count:
            yield f"{where}.overall.{name}: {getattr(overall, name)}, but its parts have {count}"
    for protocol in PROTOCOL_PARTS:
        whole = getattr(overall, protocol)
        pieces = [(group, found) for group in rest if (found := getattr(group, protocol)) is not None]
        if (whole is None) != (not pieces):
            yield f"{where}.overall.{protocol}: {'null' if whole is None else 'present'}, expected the contrary"
        for metric in metrics_of(protocol) if whole is not None and pieces else ():
            weighed = [
                (found.counts[metric.name] if protocol != "official" else group.observations, value)
                for group, found in pieces
                if (value := getattr(found, metric.name)) is not None
            ]
            total = sum(weight for weight, _ in weighed)
            expected = math.fsum(weight * value for weight, value in weighed) / total if total else None
            value = getattr(whole, metric.name)
            if not _same(value, expected):
                yield f"{where}.overall.{protocol}.{metric.name}: {_text(value)}, but its parts give {_text(expected)}"


def _digest_faults(scores: Scores) -> Iterator[str]:
    predictions, truth = totals(scores.observations)
    recorded = (("submission.digest", scores.submission.digest, predictions),
                ("dataset.truth_digest", scores.dataset.truth_digest, truth))  # fmt: skip
    for where, digest, expected in recorded:
        if digest != expected:
            yield f"{where}: does not follow from the digests of the observations"


def _same(value: float | None, expected: float | None) -> bool:
    if value is None or expected is None:
        return value is expected
    return math.isclose(value, expected, rel_tol=_ROUNDING, abs_tol=_ROUNDING)


def _text(value: float | None) -> str:
    return "null" if value is None else f"{value:.9g}"
