"""`validate`: does a folder keep the contract? Every problem is named by its file.

Shallow: structure, counts, sizes and formats from headers, splits, schema. Deep: every file is decoded and held
against its hash, its record, its twin files and the geometry. The official release is checked as what it is: what
this toolkit adds to it is not missed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from avs3d_bench.commands.report import Problem, Report, ordered
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DatasetRecord, ObservationRecord, describe
from avs3d_bench.contract.taxonomy import PARTS, ROOMS
from avs3d_bench.dataset import Dataset, Observation, find_keys
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_bytes, sha256_file
from avs3d_bench.runtime.parallel import process_each
from avs3d_bench.sealing.seal import MANIFEST, OPENING_KEY, PUBLIC, check_public, read_seal
from avs3d_bench.validation.catalogue import check_catalogue
from avs3d_bench.validation.siblings import check_groups
from avs3d_bench.validation.structure import check_structure

#: Files that may stand beside dataset.json.
_COMPANIONS = ("README", "LICENCE", "LICENSE", "CITATION", "CHANGELOG", "CROISSANT")


@dataclass(frozen=True)
class _Outcome:
    problems: tuple[Problem, ...]
    files: int
    record: ObservationRecord | None


def validate(root: str | Path, *, deep: bool = False, workers: int | None = 1, progress: bool = False) -> Report:
    """Check a dataset.

    Args:
        root: its folder.
        deep: decode every file as well.
        workers: processes for the deep check; None: one per core.
        progress: show a bar on stderr.

    Returns:
        the report; ``report.valid`` says whether there is no error.

    Raises:
        UsageError: if ``root`` is no folder or holds no dataset, or is the private side of a sealed test or its parent.

    Examples:
        >>> validate("data/demo").valid  # names, counts, sizes
        True
        >>> print(validate("data/demo", deep=True).summary)  # every file is decoded
        0 errors, 0 warnings, 0 notes in 2 observations (121 files, deep): valid
    """
    base = Path(root)
    _refuse_other_sides(base)
    dataset = Dataset(base)
    if dataset.is_sealed:
        return _validate_sealed(dataset, deep=deep)
    ours = (base / layout.DATASET_JSON).exists() or any(
        (base / key / layout.OBSERVATION_JSON).exists() for key in dataset.keys
    )
    problems = list(_check_tree(base))
    record: DatasetRecord | None = None
    if ours:
        record, found = _read_dataset_record(base)
        problems += found
    else:
        problems.append(Problem("note", layout.DATASET_JSON, "absent: read as the official release"))
    look = partial(_look, base, ours=ours, deep=deep, with_group=True)
    count = workers if deep else workers or 1
    sizes = [len(dataset[key]) for key in dataset.keys]
    looked = process_each(look, dataset.keys, workers=count, label="checking frames", progress=progress, sizes=sizes)
    outcomes = dict(looked)
    for key in dataset.keys:
        problems += outcomes[key].problems
    if record:
        problems += _check_entries(base, record, outcomes)
    problems += check_groups({key: one.record for key, one in outcomes.items() if one.record}, frozenset(outcomes))
    files = sum(outcome.files for outcome in outcomes.values()) + int((base / layout.DATASET_JSON).exists())
    return Report(base, deep, len(dataset.keys), files, ordered(problems))


def _refuse_other_sides(root: Path) -> None:
    """Refuse the folders of a sealed test that are no dataset, with what checks them.

    Raises:
        UsageError: for the folder of a sealed test, and for its private side, which holds no pictures and no sound.
    """
    if (root / MANIFEST).is_file() and (root / OPENING_KEY).is_file():
        raise UsageError(
            f"{root}: the private side of a sealed test (it has {OPENING_KEY}): use `avs3d unseal`, which checks both "
            "sides, or validate the public one"
        )
    if (root / PUBLIC / layout.SEAL_JSON).is_file() and not (root / layout.DATASET_JSON).exists():
        raise UsageError(
            f"{root}: the folder of a sealed test, no dataset: validate {root / PUBLIC} checks what is published, "
            f"`avs3d unseal {root} --secret FILE` checks both sides"
        )


def _validate_sealed(dataset: Dataset, *, deep: bool) -> Report:
    """Check the public part of a sealed test: every file against the digests of seal.json, dataset.json, poses.json."""
    record, found = _read_dataset_record(dataset.root)
    if record is not None:
        found += check_public(dataset.root, read_seal(dataset.root))
    count = sum(1 for path in dataset.root.rglob("*") if path.is_file())
    return Report(dataset.root, deep, len(dataset), count, ordered([*_check_tree(dataset.root), *found]))


def check_observation(root: str | Path, key: str, *, ours: bool = True, deep: bool = False) -> tuple[Problem, ...]:
    """The problems of a single observation of the dataset at ``root``.

    Raises:
        UsageError: if ``key`` is no observation key.
        Avs3dError: if there is no such folder.
    """
    return ordered(list(_look(root, key, ours, deep).problems))


def _look(root: str | Path, key: str, ours: bool, deep: bool, with_group: bool = False) -> _Outcome:
    observation = Observation(root, key)
    findings, record, files = check_structure(observation, ours=ours)
    if deep:
        from avs3d_bench.validation.deep import check_contents

        if ours and record is None:
            observation = Observation(root, key, use_record=False)  # broken: check the files for themselves
        check_contents(observation, record, files, findings, ours=ours, with_group=with_group)
    return _Outcome(tuple(findings.problems), len(files), record)


def _check_tree(root: Path) -> Iterator[Problem]:
    """Files and folders between the root and the observations that are not part of the layout."""
    known = set(find_keys(root))
    for path in sorted(root.iterdir()):
        name = path.name
        if name in PARTS and path.is_dir():
            continue
        if name in (layout.LOCK, layout.FAILURES_JSONL):
            continue
        if name not in (layout.DATASET_JSON, layout.SEAL_JSON) and not name.upper().startswith(_COMPANIONS):
            yield Problem("warning", name, f"not part of a dataset; expected {layout.DATASET_JSON}, {', '.join(PARTS)}")
    for part in PARTS:
        for depth in ("*", "*/*", "*/*/*"):
            for path in sorted((root / part).glob(depth)):
                key = path.relative_to(root).as_posix()
                problem = _odd_name(path, key, known)
                if problem:
                    yield problem


def _odd_name(path: Path, key: str, known: set[str]) -> Problem | None:
    if path.name.startswith("."):
        return Problem("error", key, "left over from an interrupted run; generate again, or remove it")
    pieces = key.split("/")
    if not path.is_dir():
        return Problem("error", key, "surplus file; expected folders only")
    if len(pieces) == 3 and pieces[2] not in ROOMS:
        return Problem("error", key, f"unknown room {pieces[2]!r}: expected one of {', '.join(ROOMS)}")
    if len(pieces) == 4 and key not in known and pieces[2] in ROOMS:
        return Problem("error", key, f"no observation key: expected {'|'.join(PARTS)}/<scan>/<room>/<index>")
    if len(pieces) < 4 and not any(path.iterdir()):
        return Problem("error", key, "empty folder")
    return None


def _read_dataset_record(root: Path) -> tuple[DatasetRecord | None, list[Problem]]:
    name = layout.DATASET_JSON
    try:
        return DatasetRecord.model_validate_json(read_bytes(root / name)), []
    except ValidationError as error:
        return None, [Problem("error", name, line) for line in describe(error)]
    except Avs3dError as error:
        text = str(error).removeprefix(f"{root / name}: ")
        return None, [Problem("error", name, f"{text}; `avs3d generate` writes it last: let it finish")]


def _check_entries(root: Path, record: DatasetRecord, outcomes: dict[str, _Outcome]) -> Iterable[Problem]:
    """dataset.json against itself, its manifest and the observations on disk."""
    records = {key: one.record for key, one in outcomes.items() if one.record}
    yield from check_catalogue(record, records)
    listed = {entry.key: entry for entry in record.observations}
    for key in sorted(set(listed) - set(outcomes)):
        yield Problem("error", key, f"listed in {layout.DATASET_JSON}, but missing")
    for key in sorted(set(outcomes) - set(listed)):
        yield Problem("error", key, f"not listed in {layout.DATASET_JSON}")
    for key in sorted(set(outcomes) & set(listed)):
        path = f"{key}/{layout.OBSERVATION_JSON}"
        if not (root / path).is_file():
            continue  # already named as missing
        if sha256_file(root / path) != listed[key].digest:
            yield Problem("error", path, f"sha256 differs from the digest in {layout.DATASET_JSON}: file changed")
        found = outcomes[key].record
        if found and found.category != listed[key].category:
            text = f"category of {key} is {listed[key].category}, observation.json says {found.category}"
            yield Problem("error", layout.DATASET_JSON, text)


__all__ = ["Problem", "Report", "UsageError", "check_observation", "validate"]
