"""Opening a submission: a folder or a .zip, in our layout or as the released pipeline leaves it."""

from __future__ import annotations

import os
import signal
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path

from pydantic import ValidationError

from avs3d_bench.commands.report import Problem, Report, ordered, printable
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import SubmissionRecord, describe
from avs3d_bench.contract.taxonomy import PARTS, ROOMS
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_bytes
from avs3d_bench.formats.predictions import MAX_JSON_BYTES, check_file
from evaluators.reading.archive import check_directory, top_folder, unpack, vet
from evaluators.reading.records import InvalidSubmission, Submission

_EXPECTED = (
    f"expected {layout.SUBMISSION_JSON} and {'|'.join(PARTS)}/<scan>/<room>/<index>/{layout.SUBMISSION_MASKS}/ with "
    f"one PNG per test frame (or {layout.RELEASED_MASKS[0]}/ in place of {layout.SUBMISSION_MASKS}/)"
)
_JSON = '{"method": …, "dataset": …, "dataset_version": …}'
#: Folder entries that are read to determine the layout, and the depth of the search for a misplaced submission.
_LOOKED_AT = 100_000
_NEAR = 200


@contextmanager
def open_submission(path: str | Path, *, aisrm: bool | None = None) -> Iterator[Submission]:
    """Open the submission at ``path``; an archive is unpacked to a temporary folder that is removed afterwards.

    `evaluators.reading.checks` reports what is wrong with the files inside; only an archive that cannot be unpacked
    safely ends here.

    Args:
        path: the folder or archive.
        aisrm: which folder to read of the two that the released pipeline always writes, with (True) or without its
            refinement; None: with it where it is there. Not for submissions in our layout.

    Raises:
        UsageError: if there is nothing at ``path``, it is no submission, or it has not the folder asked for.
        InvalidSubmission: if an archive holds what must not be unpacked; its report names every such member.

    Examples:
        >>> with open_submission("data/demo-submissions/oracle") as submission:  # or a .zip
        ...     print(submission.layout, submission.record.method, submission.masks)
        avs3d oracle (category) masks
    """
    source = Path(path)
    if source.is_dir():
        yield _opened(source, None, aisrm)
        return
    if not source.exists():
        raise UsageError(f"{source}: no such folder or archive; expected a submission")
    if not source.is_file() or not zipfile.is_zipfile(source):  # which looks for the closing record only
        raise UsageError(f"{source}: neither a folder nor a .zip; expected a submission")
    check_directory(source)
    with ExitStack() as stack:
        with _undisturbed():
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="avs3d-submission-"))
        try:
            with zipfile.ZipFile(source) as archive:
                problems = list(vet(archive)) or list(unpack(archive, Path(folder)))
                members = len(archive.infolist())
        except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
            raise UsageError(f"{source}: a damaged archive ({error}); pack it again") from None
        if problems:
            raise InvalidSubmission(Report(source, False, 0, members, ordered(problems)))
        yield _opened(top_folder(Path(folder)), source, aisrm)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """A block that no signal interrupts between making a folder and knowing that it must go again."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _opened(root: Path, source: Path | None, aisrm: bool | None) -> Submission:
    json_file = root / layout.SUBMISSION_JSON
    named = source or root
    has_json = os.path.lexists(json_file)
    keys = () if has_json and aisrm is None else tuple(_keys(root, _LOOKED_AT))
    if aisrm is not None:
        return _released(root, source, keys, layout.RELEASED_MASKS[0 if aisrm else 1])
    if has_json or any(os.path.lexists(root / key / layout.SUBMISSION_MASKS) for key in keys):
        record, problems = _record(json_file, named)
        return Submission(root, "avs3d", layout.SUBMISSION_MASKS, record, source, problems)
    found = [masks for masks in layout.RELEASED_MASKS if any((root / key / masks).is_dir() for key in keys)]
    if not found:
        raise UsageError(f"{named}: no submission; {_EXPECTED}{_hint(root, source)}")
    return _released(root, source, keys, found[0])


def _released(root: Path, source: Path | None, keys: Sequence[str], masks: str) -> Submission:
    """The released pipeline's own output, of which one folder of masks is read."""
    named = source or root
    there = [folder for folder in layout.RELEASED_MASKS if any((root / key / folder).is_dir() for key in keys)]
    if masks not in there:
        found = f"found {', '.join(there)}" if there else "found no folder of the released pipeline"
        raise UsageError(
            f"{named}: no {masks}/ in any observation; {found}: leave out --official-folder, or name another"
        )
    notes = tuple(
        Problem("note", other, f"not looked at: {masks} is scored; --official-folder chooses")
        for other in there
        if other != masks
    )
    return Submission(root, "official", masks, _made_up(named), source, notes)


def _keys(root: Path, most: int) -> Iterator[str]:
    """Keys of the observation folders below ``root``; ``most`` entries are looked at, for links may go in circles."""
    budget = iter(range(most))
    for part in PARTS:
        for scan in _folders(root / part, budget):
            for room in ROOMS:
                for index in _folders(root / part / scan / room, budget):
                    key = f"{part}/{scan}/{room}/{index}"
                    with suppress(UsageError):
                        yield str(layout.parse_key(key))


def _folders(path: Path, budget: Iterator[int]) -> list[str]:
    """Names of the folders in a folder, as far as the budget of entries reaches."""
    with suppress(OSError), os.scandir(path) as entries:
        # isdir and not DirEntry.is_dir, which raises at a link that leads to itself
        return sorted(entry.name for _, entry in zip(budget, entries, strict=False) if os.path.isdir(entry))
    return []


def _made_up(named: Path) -> SubmissionRecord:
    method = printable(named.resolve().stem or "unnamed")
    return SubmissionRecord(method=method, dataset="unknown", dataset_version="unknown")


def _record(path: Path, named: Path) -> tuple[SubmissionRecord, tuple[Problem, ...]]:
    if not os.path.lexists(path):
        return _made_up(named), (Problem("error", path.name, f"missing; expected {_JSON}"),)
    try:
        check_file(path, MAX_JSON_BYTES)
        if not path.resolve().is_relative_to(path.parent.resolve()):
            raise Avs3dError(f"{path}: a link out of the submission; expected a file")
        return SubmissionRecord.model_validate_json(read_bytes(path)), ()
    except ValidationError as error:
        return _made_up(named), tuple(
            Problem("error", path.name, f"{line}; expected {_JSON}") for line in describe(error)
        )
    except (Avs3dError, RecursionError) as error:
        message = str(error).removeprefix(f"{path}: ")
        return _made_up(named), (Problem("error", path.name, message),)


def _hint(root: Path, source: Path | None) -> str:
    """Where the submission lies, if it is a folder further down."""
    if source is not None:
        return ""  # paths inside an archive are of no use to the user
    try:
        for path in sorted(islice(root.iterdir(), _NEAR)):
            if not path.is_dir() or path.is_symlink():
                continue
            if os.path.lexists(path / layout.SUBMISSION_JSON) or any(_keys(path, _NEAR)):
                return f"; it lies one folder further down: point at {path}"
    except OSError:
        pass
    return ""
