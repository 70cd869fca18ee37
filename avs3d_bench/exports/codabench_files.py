"""The files of a competition bundle: what scoring reads of a dataset, the scoring program, an example submission."""

from __future__ import annotations

import io
import shutil
import zipfile
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml

from avs3d_bench.contract import layout
from avs3d_bench.contract.competition import REFERENCE_PRIVATE, REFERENCE_PUBLIC, TASK_JSON, CompetitionTask
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.codabench_format import INPUT, METADATA_YAML, OUTPUT, PROGRAM
from avs3d_bench.formats import media
from avs3d_bench.formats.files import dump_json
from avs3d_bench.measures.centre_box import centre_box
from avs3d_bench.sealing.seal import open_sealed

#: Folders with a file for each frame that hold truth …
TRUTH_FOLDERS = (layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS, layout.CATEGORY_MASKS)
#: … and what tells it in another way.
TELLTALES = (layout.OBSERVATION_JSON, layout.GT_3D, layout.STEMS, layout.RIRS)
#: Members that are compressed already.
_STORED = (".png", ".wav", ".zip", ".jpg", ".npz")
_SCORING = '''\
"""Scoring program: runs the evaluator of the container image. It starts no work on import: processes import it."""

import sys

if __name__ == "__main__":
    try:
        from evaluators.competition import main
    except ImportError as error:
        sys.exit(f"scoring: error: {{error}}; expected avs3d-bench {version} in the container image")
    main(sys.argv[1:])
'''


def require_no_truth(public: Dataset) -> None:
    """Refuse a public tree that tells the truth of a test frame; masks of train frames may be published.

    Raises:
        Avs3dError: naming the first file.
    """
    for observation in public:
        for name in TELLTALES:
            if (observation.path / name).exists():
                raise Avs3dError(f"{observation.path / name}: tells the truth; expected none in the public tree")
        test = {frame.name for frame in observation.test}
        for folder in TRUTH_FOLDERS:
            for path in sorted((observation.path / folder).glob("*")):
                if path.stem in test:
                    raise Avs3dError(f"{path}: the truth of a test frame; expected none in the public tree")


def check_truth(public: Dataset, private: Dataset) -> None:
    """Every test frame of the public tree has its truth, and the trees belong together.

    The trees of a sealed test are held against its commitments.

    Raises:
        UsageError: if ``public`` has no observation, or ``private`` belongs to another sealed test.
        Avs3dError: naming the first file that is missing or not what was committed to.
    """
    if not public.keys:
        raise UsageError(f"{public.root}: no observation; expected the public tree of a competition")
    if public.is_sealed:
        open_sealed(public.root, private.root)
    if public.record and private.record:
        ours, theirs = ((r.name, r.version) for r in (public.record, private.record))
        if ours != theirs:
            raise Avs3dError(f"{private.root}: truth of {' '.join(theirs)}, expected that of {' '.join(ours)}")
    for observation in public:
        if not observation.test:
            raise Avs3dError(f"{observation.path}: no test frame; expected some in {layout.SPLITS_JSON}")
        for frame in observation.test:
            path = private.root / observation.key / layout.SEMANTIC_MASKS / f"{frame.name}.png"
            if not path.is_file():
                raise Avs3dError(f"{path}: missing; expected the truth of every test frame of {public.root}")


def scoring_program(task: CompetitionTask) -> bytes:
    """The zip of a scoring program: the command, a short script, and the task's record."""
    buffer = io.BytesIO()
    with Archive(buffer) as program:
        command = f"python3 {PROGRAM}/scoring.py {INPUT} {OUTPUT}"
        program.add(METADATA_YAML, yaml.safe_dump({"command": command}).encode())
        program.add("scoring.py", _SCORING.format(version=task.toolkit_version).encode())
        program.add(TASK_JSON, dump_json(task).encode())
    return buffer.getvalue()


def public_files(public: Dataset) -> Iterator[tuple[str, Path]]:
    """(member, file) of what participants get, in the order of names; without hidden files and notes of a run."""
    for path in sorted(path for path in public.root.rglob("*") if path.is_file()):
        relative = path.relative_to(public.root)
        if not any(piece.startswith(".") for piece in relative.parts) and relative.name != layout.FAILURES_JSONL:
            yield relative.as_posix(), path


def reference_files(public: Dataset, private: Dataset) -> Iterator[tuple[str, bytes | Path]]:
    """(member, contents) of the reference data, in the order of names: what scoring reads of both trees."""
    for name in (layout.DATASET_JSON, layout.SEAL_JSON):
        roots = [root for root in (public.root, private.root) if (root / name).is_file()]
        if roots:
            yield f"{REFERENCE_PUBLIC}/{name}", roots[0] / name
    for observation in public:
        folder = f"{REFERENCE_PUBLIC}/{observation.key}"
        for name in (layout.SPLITS_JSON, layout.POSES_JSON):
            if (observation.path / name).is_file():
                yield f"{folder}/{name}", observation.path / name
        for frame in observation.test:
            header = media.png_header(private.root / observation.key / layout.SEMANTIC_MASKS / f"{frame.name}.png")
            yield f"{folder}/{layout.INPUT}/{frame.name}.png", _black(header.height, header.width)
    for observation in public:
        folder, truth = f"{REFERENCE_PRIVATE}/{observation.key}", private.root / observation.key
        names = [layout.OBSERVATION_JSON, layout.SOUNDING_OBJECT]
        names += [f"{kind}/{frame.name}.png" for kind in TRUTH_FOLDERS for frame in observation.test]
        yield from ((f"{folder}/{name}", truth / name) for name in names if (truth / name).is_file())


def example_submission(public: Dataset) -> dict[str, bytes]:
    """Member → contents of a submission that marks the middle of every picture, in the layout to be filled in."""
    record = public.record
    said = SubmissionRecord(
        method="example: a box in the middle",
        dataset=public.name,
        dataset_version=record.version if record else "unversioned",
    )
    files = {layout.SUBMISSION_JSON: dump_json(said).encode()}
    for observation in public:
        folder = layout.INPUT if (observation.path / layout.INPUT).is_dir() else layout.IMAGES
        for frame in observation.test:
            header = media.png_header(frame.path(folder))
            name = f"{observation.key}/{layout.SUBMISSION_MASKS}/{frame.name}.png"
            files[name] = _box(header.height, header.width)
    return files


def check_practice(practice: Dataset, public: Dataset) -> None:
    """A practice dataset has its truth, and no picture in common with the test.

    Raises:
        Avs3dError: naming the first file.
    """
    tested = {media.sha256_file(frame.path(layout.INPUT)) for one in public for frame in one.frames}
    for observation in practice:
        for frame in observation.test:
            path = observation.path / layout.SEMANTIC_MASKS / f"{frame.name}.png"
            if not path.is_file():
                raise Avs3dError(f"{path}: missing; expected a practice dataset with the truth of its test frames")
        for frame in observation.frames:
            if media.sha256_file(frame.path(layout.INPUT)) in tested:
                raise Avs3dError(
                    f"{frame.path(layout.INPUT)}: also a picture of the test; practice on other homes: "
                    "`avs3d manifest sample --exclude`"
                )


@lru_cache(maxsize=8)
def _box(height: int, width: int) -> bytes:
    """A mask of the middle as PNG."""
    mask = np.zeros((height, width), dtype=bool)
    mask[centre_box(height, width)] = True
    return media.encode_png_mask("mask", mask)


@lru_cache(maxsize=8)
def _black(height: int, width: int) -> bytes:
    """A black mask as PNG."""
    return media.encode_png_mask("mask", np.zeros((height, width), dtype=bool))


class Archive:
    """A zip archive with fixed times and permissions, so that the same members give the same bytes."""

    def __init__(self, target: Path | io.BytesIO) -> None:
        self.archive = zipfile.ZipFile(target, "w")

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *_: object) -> None:
        self.archive.close()

    @staticmethod
    def _info(name: str) -> zipfile.ZipInfo:
        info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
        info.external_attr = 0o644 << 16
        info.create_system = 3  # Unix, on every machine
        info.compress_type = zipfile.ZIP_STORED if name.lower().endswith(_STORED) else zipfile.ZIP_DEFLATED
        return info

    def add(self, name: str, contents: bytes | Path) -> None:
        """Add a member from bytes, or from a file that need not fit into memory."""
        info = self._info(name)
        if isinstance(contents, bytes):
            self.archive.writestr(info, contents)
            return
        info.file_size = contents.stat().st_size
        with contents.open("rb") as source, self.archive.open(info, "w", force_zip64=info.file_size > 2**31) as out:
            shutil.copyfileobj(source, out, 1 << 20)

    def nested(self, name: str) -> _Nested:
        """A zip archive as a member: a context manager of the inner archive."""
        return _Nested(self, name)


class _Nested:
    """An archive that is written beside the outer one and becomes its member."""

    def __init__(self, outer: Archive, name: str) -> None:
        self.outer, self.name = outer, name
        # Beside the bundle, for a temporary folder may be too small for it.
        self.path = Path(f"{outer.archive.filename}.{name}")

    def __enter__(self) -> Archive:
        self.inner = Archive(self.path)
        return self.inner

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            self.inner.archive.close()
            if kind is None:
                self.outer.add(self.name, self.path)
        finally:
            self.path.unlink(missing_ok=True)
