"""Verifying a file of scores: the submission is scored again, and every value is compared.

    read the file → score the same observations under the same protocols → compare value by value

The software and the machine may be others than those of the file: they become notes. Everything else must be the same:
the figures, the digests of the submission and of the dataset, the versions of the protocols and the settings.
"""

from __future__ import annotations

import glob
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from avs3d_bench import __version__
from avs3d_bench.commands.report import printable
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ProvenanceRecord
from avs3d_bench.contract.scores import (
    PAIR_KINDS,
    PROTOCOL_PARTS,
    Scores,
    UnconfirmedValue,
    VerificationRecord,
    VerifiedDataset,
    VerifiedScores,
)
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.formats.files import JSON_DIGITS, dump_json, sha256_file
from avs3d_bench.runtime.provenance import Provenance, provenance
from evaluators.reading.submission import open_submission
from evaluators.reporting.score_file import contents_digest, read_scores
from evaluators.score import open_dataset, score

#: Two figures are the same if they differ by no more than this share, or by `_NOISE`: a file keeps nine digits.
TOLERANCE = 1e-8
_NOISE = 1e-12
#: Values that may differ: the place of the report, soft masks, which are not given, and the software and machine. All
#: but the first become notes.
_NOT_COMPARED = ("report", "soft", "avs3d_eval.version", "avs3d_eval.provenance", "avs3d_eval.machine")
#: Values that files of older versions lack.
_ADDED_LATER = ("submission.digest", "dataset.truth_digest", "digests", "avs3d_eval.bootstrap_unit")
#: Stands for a value that one side lacks.
_ABSENT = object()
_SHORT_DIGEST = 12


@dataclass(frozen=True)
class Difference:
    """A value of the file that scoring again did not confirm.

    Attributes:
        where: e.g. ``observations[part_1/apartment_1/kitchen/1].strict.IoU``.
        recorded: the value in the file, as text.
        found: the value of scoring again, as text.
    """

    where: str
    recorded: str
    found: str

    def __str__(self) -> str:
        return f"{self.where}: {self.recorded} in the file, {self.found} when scored again"


@dataclass(frozen=True, repr=False)
class Verification:
    """The outcome of verifying a file of scores.

    Attributes:
        scores: the file's.
        differences: values that are not the same.
        notes: what could not be compared, or may be different: software, machine, digests that the file lacks.
        values: number of values that were compared.
        dataset: with which the submission was scored again.
    """

    scores: Scores
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]
    values: int
    dataset: VerifiedDataset

    def __repr__(self) -> str:
        return f"Verification({printable(repr(self.scores.submission.method))}: {self.summary})"

    @property
    def same(self) -> bool:
        """Whether every value that was compared is the same."""
        return not self.differences

    @property
    def summary(self) -> str:
        """The verdict in one line."""
        if self.same:
            count = len(self.scores.observations)
            return f"same: {self.values:,} values of {count:,} observation{'' if count == 1 else 's'} confirmed"
        count = len(self.differences)
        return f"differs: {count:,} of {self.values:,} values {'is' if count == 1 else 'are'} not confirmed"

    def record(self) -> VerificationRecord:
        """For ``--json``, and for ``avs3d leaderboard --verified``."""
        return VerificationRecord(
            same=self.same,
            values=self.values,
            differences=tuple(
                UnconfirmedValue(where=one.where, recorded=one.recorded, found=one.found) for one in self.differences
            ),
            notes=self.notes,
            scores=VerifiedScores(method=self.scores.submission.method, digest=contents_digest(self.scores)),
            dataset=self.dataset,
            evaluator=__version__,
        )


def verify(
    score_file: str | Path,
    submission: str | Path,
    dataset: str | Path | Dataset,
    truth: str | Path | None = None,
    *,
    workers: int | None = 1,
    progress: bool = False,
) -> Verification:
    """Score a submission again and compare the result with a file of scores.

    Args:
        score_file: written by ``avs3d-eval --json``.
        submission: the folder or .zip that it claims to be about.
        dataset: its root, or the opened dataset.
        truth: of a sealed test, the folder with its truth.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if a path is no file of scores, no submission or no dataset.
        InvalidSubmission: if a file of the submission is bad; the report names every one.
        Avs3dError: if the dataset is damaged.

    Examples:
        >>> verify("data/demo-scores/oracle.json", "data/demo-submissions/oracle", "data/demo").same
        True
        >>> other = verify("data/demo-scores/oracle.json", "data/demo-submissions/centre-box", "data/demo")
        >>> other.same, [difference.where for difference in other.differences[:2]]
        (False, ['submission.digest', 'submission.method'])
    """
    try:
        recorded = read_scores(Path(score_file), check=False)
    except Avs3dError as error:
        raise UsageError(str(error)) from None
    data = open_dataset(dataset, truth)
    kept, missing = _without_unknown(recorded, data)
    if not kept.observations:
        record = data.record
        nothing = VerifiedDataset(
            name=data.name,
            version=data.version,
            sha256=sha256_file(data.root / layout.DATASET_JSON) if record else None,
            truth_digest=None,
        )
        return Verification(recorded, missing, (), len(missing), nothing)
    with open_submission(submission, aisrm=_aisrm(recorded)) as opened:
        again = score(
            opened,
            data,
            protocols=tuple(kept.avs3d_eval.protocols),
            only=_only(kept, data),
            workers=workers,
            progress=progress,
        ).scores
    found = compare_scores(kept, again)
    return replace(
        found, scores=recorded, differences=(*missing, *found.differences), values=found.values + len(missing)
    )


def compare_scores(recorded: Scores, again: Scores) -> Verification:
    """Compare two records of scores of the same observations, value by value.

    Args:
        recorded: the file's.
        again: what scoring again gave.
    """
    skipped = list(_NOT_COMPARED)
    if again.submission.layout == "official":
        skipped.append("submission.method")  # The name of the folder.
    if again.dataset.sha256 is None:
        skipped.append("dataset.name")  # Likewise.
    older = recorded.avs3d_eval.bootstrap_unit is None
    mine, theirs = (_document(one, intervals=not older, kinds=not _lacks_kinds(recorded)) for one in (recorded, again))
    if _lacks_kinds(recorded):
        skipped.append("avs3d_eval.protocols.listen")
    lines = list(compare_values(mine, theirs, skipped))
    differences = sorted((line for line in lines if line is not None), key=_rank)
    data = again.dataset
    dataset = VerifiedDataset(name=data.name, version=data.version, sha256=data.sha256, truth_digest=data.truth_digest)
    return Verification(recorded, tuple(differences), tuple(_notes(recorded, again)), len(lines), dataset)


def _lacks_kinds(scores: Scores) -> bool:
    """Whether a file is of ``listen`` 1.0: its figures are those of 1.1 without the kinds of pairs."""
    return scores.avs3d_eval.protocols.get("listen") == "1.0"


def _document(scores: Scores, *, intervals: bool, kinds: bool) -> object:
    """A record of scores as JSON has it, with its intervals and kinds of pairs or without them."""

    def without(value: object, of_listen: bool = False) -> object:
        if isinstance(value, list):
            return [without(inner, of_listen) for inner in value]
        if not isinstance(value, Mapping):
            return value
        here = of_listen or "pair_accuracy" in value
        dropped = {*(() if intervals else ("intervals",))}
        if not kinds:
            dropped |= {*PAIR_KINDS} if here else {"kind"}  # only a pair has a kind
        return {name: without(inner, here) for name, inner in value.items() if name not in dropped}

    document: object = json.loads(dump_json(scores))
    return document if intervals and kinds else without(document)


def _without_unknown(recorded: Scores, dataset: Dataset) -> tuple[Scores, tuple[Difference, ...]]:
    """The scores of observations that the dataset has, and a difference for each other one."""
    known = [scores for scores in recorded.observations if scores.key in dataset]
    missing = [
        Difference(f"observations[{scores.key}]", "scored", "no such observation")
        for scores in recorded.observations
        if scores.key not in dataset
    ]
    return recorded.model_copy(update={"observations": tuple(known)}), tuple(missing)


def _only(recorded: Scores, dataset: Dataset) -> tuple[str, ...]:
    """Patterns of the keys that the file has; none if it has all that its protocols score."""
    parts = {part for protocol in recorded.avs3d_eval.protocols for part in PROTOCOL_PARTS[protocol]}
    keys = {scores.key for scores in recorded.observations}
    if keys == {key for key in dataset.keys if layout.parse_key(key).part in parts}:
        return ()
    return tuple(glob.escape(key) for key in sorted(keys))


def _aisrm(recorded: Scores) -> bool | None:
    """Which folder of the released pipeline's masks was scored; None: that of our layout."""
    if recorded.submission.layout != "official" or recorded.submission.masks not in layout.RELEASED_MASKS:
        return None
    return recorded.submission.masks == layout.RELEASED_MASKS[0]


def compare_values(
    recorded: object, found: object, skipped: Sequence[str], where: str = ""
) -> Iterator[Difference | None]:
    """A difference, or None, for each value of two JSON documents; what one of them lacks as a whole counts once.

    Args:
        recorded: the file's.
        found: of scoring again.
        skipped: places that are not compared.
        where: the place of the two in the file.
    """
    if where in skipped or (recorded is _ABSENT and where.endswith(_ADDED_LATER)):
        return
    one, other = _named(recorded), _named(found)
    if one is None or other is None:
        yield None if _same(recorded, found) else Difference(where, _text(recorded), _text(found))
        return
    for name in (*one, *(name for name in other if name not in one)):
        inner = f"{where}{name}" if name.startswith("[") else f"{where}.{name}".removeprefix(".")
        yield from compare_values(one.get(name, _ABSENT), other.get(name, _ABSENT), skipped, inner)


def _named(value: object) -> Mapping[str, object] | None:
    """The members of an object or a list by name: those of a list by key, group, pair or place; None of a value."""
    if isinstance(value, Mapping):
        return {name if "/" not in name else f"[{name}]": inner for name, inner in value.items()}
    if not isinstance(value, list):
        return None
    named: dict[str, Any] = {}
    for place, inner in enumerate(value):
        name = f"[{_name(inner, place)}]"
        named[f"{name[:-1]}, entry {place}]" if name in named else name] = inner
    return named


def _name(value: object, place: int) -> str:
    if isinstance(value, Mapping):
        for names in (("key",), ("group",), ("first", "second")):
            if all(name in value for name in names):
                return " and ".join(str(value[name]) for name in names)
    return str(place)


def _same(recorded: object, found: object) -> bool:
    if isinstance(recorded, float) and isinstance(found, float | int):
        return math.isclose(recorded, found, rel_tol=TOLERANCE, abs_tol=_NOISE)
    if isinstance(found, float) and isinstance(recorded, int):
        return math.isclose(recorded, found, rel_tol=TOLERANCE, abs_tol=_NOISE)
    return bool(recorded == found)


def _text(value: object) -> str:
    if value is _ABSENT:
        return "missing"
    if isinstance(value, float):
        return f"{value:.{JSON_DIGITS}g}"
    if isinstance(value, Mapping | list):
        return "present"
    # A digest is shown as a whole.
    return value if isinstance(value, str) and value.isalnum() and value.isascii() else excerpt(value)


def _rank(difference: Difference) -> tuple[int, str]:
    """Causes before effects: software, dataset, submission, then digests of observations, figures, means."""
    where = difference.where
    order = ("avs3d_eval", "dataset", "submission", "observations", "siblings")
    first = next((place for place, name in enumerate(order) if where.startswith(name)), len(order))
    key = where.partition("]")[0]
    return first, f"{key} {'0' if '.digests.' in where else '1'} {where}"


def _notes(recorded: Scores, again: Scores) -> Iterator[str]:
    if recorded.submission.digest is None or recorded.dataset.truth_digest is None:
        yield "the file has no digests of submission and truth: an older version wrote it; its figures are compared"
    if recorded.avs3d_eval.bootstrap_unit is None:
        yield "the intervals of the file, of an older version, do not resample homes: they are not compared"
    if recorded.soft is not None:
        yield "the average precision of soft masks is not compared: they are no part of the submission"
    if _lacks_kinds(recorded):
        yield "the file is of listen 1.0, which has no kinds of pairs: all other figures are compared"
    if recorded.dataset.scored < recorded.dataset.observations:
        yield f"{recorded.dataset.scored:,} of the {recorded.dataset.observations:,} observations were scored"
    then, now = recorded.avs3d_eval, again.avs3d_eval
    if then.provenance is None:
        yield "the file does not name the software that wrote it"
    else:
        yield from _software_notes(then.provenance)
    if then.machine is not None and now.machine is not None and then.machine != now.machine:
        one, other = then.machine, now.machine
        yield (
            f"scored on {one.platform}, {one.python}, {_cores(one.cores)}; "
            f"again on {other.platform}, {other.python}, {_cores(other.cores)}"
        )


def _cores(count: int) -> str:
    return f"{count} core{'' if count == 1 else 's'}"


def _software_notes(then: ProvenanceRecord) -> Iterator[str]:
    """How the software that wrote a file differs from this one."""
    now = provenance("scores")
    if then.digest == now.digest:
        return
    # With the versions that the file names, this evaluator has the file's digest if its sources are the same.
    if Provenance(now.sources, then.libraries, then.python).digest != then.digest:
        yield (
            f"the evaluator has other sources: digest {then.digest[:_SHORT_DIGEST]} (version {then.toolkit_version}) "
            f"in the file, {now.digest[:_SHORT_DIGEST]} here"
        )
    changed = [
        f"{name} {then.libraries.get(name, 'none')} in the file, {now.libraries.get(name, 'none')} here"
        for name in sorted({*then.libraries, *now.libraries})
        if then.libraries.get(name) != now.libraries.get(name)
    ]
    if then.python != now.python:
        changed.insert(0, f"Python {then.python} in the file, {now.python} here")
    if changed:
        yield "other versions: " + "; ".join(changed)
