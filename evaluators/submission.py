"""Opening a submission: a folder or a .zip, in our layout or as the released pipeline leaves it."""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from pydantic import ValidationError

from avs3d_bench import layout
from avs3d_bench.dataset import find_keys
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.files import read_bytes
from avs3d_bench.report import Problem, Report, ordered
from avs3d_bench.schema import SubmissionRecord, describe
from evaluators.archive import printable, top_folder, unpack, vet
from evaluators.masks import check_file
from evaluators.records import InvalidSubmission, Submission

_EXPECTED = (
    f"expected {layout.SUBMISSION_JSON} and part_1|part_2/<scan>/<room>/<index>/{layout.SUBMISSION_MASKS}/ with one "
    f"PNG per test frame (or {layout.RELEASED_MASKS[0]}/ in place of {layout.SUBMISSION_MASKS}/)"
)
_JSON = '{"method": …, "dataset": …, "dataset_version": …}'
#: submission.json holds a few lines.
_MAX_JSON_BYTES = 2**20
#: How far a misplaced submission is looked for.
_LOOKED_AT = 200


@contextmanager
def open_submission(path: str | Path) -> Iterator[Submission]:
    """Open the submission at ``path``; an archive is unpacked to a temporary folder that is removed afterwards.

    What is wrong with the files inside is for `evaluators.checks` to say; only an archive that cannot be unpacked
    safely ends here.

    Raises:
        UsageError: if there is nothing at ``path``, or it is no submission.
        InvalidSubmission: if an archive holds what must not be unpacked; its report names every such member.
    """
    source = Path(path)
    if source.is_dir():
        yield _opened(source, None)
        return
    if not source.exists():
        raise UsageError(f"{source}: no such folder or archive; expected a submission")
    if not source.is_file() or not zipfile.is_zipfile(source):
        raise UsageError(f"{source}: neither a folder nor a .zip; expected a submission")
    with tempfile.TemporaryDirectory(prefix="avs3d-submission-") as folder:
        try:
            with zipfile.ZipFile(source) as archive:
                problems = list(vet(archive)) or list(unpack(archive, Path(folder)))
                members = len(archive.infolist())
        except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
            raise UsageError(f"{source}: a damaged archive ({error}); pack it anew") from None
        if problems:
            raise InvalidSubmission(Report(source, False, 0, members, ordered(problems)))
        yield _opened(top_folder(Path(folder)), source)


def _opened(root: Path, source: Path | None) -> Submission:
    keys = find_keys(root)
    json_file = root / layout.SUBMISSION_JSON
    ours = os.path.lexists(json_file) or any(os.path.lexists(root / k / layout.SUBMISSION_MASKS) for k in keys)
    named = source or root
    if ours:
        record, problems = _record(json_file, named)
        return Submission(root, "avs3d", layout.SUBMISSION_MASKS, record, source, problems)
    found = [masks for masks in layout.RELEASED_MASKS if any((root / key / masks).is_dir() for key in keys)]
    if not found:
        raise UsageError(f"{named}: no submission; {_EXPECTED}{_hint(root, source)}")
    notes = tuple(Problem("note", other, f"not looked at: {found[0]} is there as well") for other in found[1:])
    return Submission(root, "official", found[0], _made_up(named), source, notes)


def _made_up(named: Path) -> SubmissionRecord:
    method = printable(named.resolve().stem or "unnamed")
    return SubmissionRecord(method=method, dataset="unknown", dataset_version="unknown")


def _record(path: Path, named: Path) -> tuple[SubmissionRecord, tuple[Problem, ...]]:
    if not os.path.lexists(path):
        return _made_up(named), (Problem("error", path.name, f"missing; expected {_JSON}"),)
    try:
        check_file(path, _MAX_JSON_BYTES)
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
    try:
        for path in sorted(islice(root.iterdir(), _LOOKED_AT)):
            if path.is_dir() and not path.is_symlink():
                inside = source is not None or (not (path / layout.SUBMISSION_JSON).exists() and not find_keys(path))
                if not inside:
                    return f"; it lies one folder further down: point at {path}"
    except OSError:
        pass
    return ""
