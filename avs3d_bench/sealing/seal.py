"""Sealed tests: what `seal.json` commits to, and whether a secret and a truth are those that it commits to.

    public/seal.json      commitments to the secret, the manifest and every private file; the sha256 of dataset.json,
                          which has those of all poses.json, which have those of all published files
    private/opening.hex   the key that opens the commitments to private files; it follows from the secret
    commitment.json       the commitment to the secret, to be published before the template

A truth file is committed to by sha256(salt ‖ 1 ‖ bytes), one that does not exist by sha256(salt ‖ 0). Without a salt,
the digest of a mask would tell where nothing is visible, since there is only one black picture of each size. The salt
of a file is HMAC-SHA256(opening key, its path); the opening key is HMAC-SHA256(working key, `OPENING`), where the
working key follows from the secret (`avs3d_bench.sealing.secret`). So the opening key shows nothing of the secret: the
evaluator needs no secret.

`generators.sealing` makes a sealed test. This module needs the core install only.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import PosesRecord, SealRecord, parse_record
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.sealing.secret import derive, read_hex, working_key

#: Folders of a sealed test, and the file of its secret.
PUBLIC, PRIVATE, SECRET = "public", "private", "secret"
#: File of the commitment to the secret, beside them.
COMMITMENT = "commitment.json"
#: Files of `private/`: the manifest with its seeds, the manifest before, the draws of homes, the opening key.
MANIFEST, TEMPLATE, DRAWS, OPENING_KEY = "manifest.yaml", "template.yaml", "draws.json", "opening.hex"
#: Private files beside the observations that `seal.json` commits to in the same way as to truth files.
COMMITTED = (layout.DATASET_JSON, TEMPLATE, DRAWS)
#: What the working key is used for; part of each derivation, so that no two uses share a value.
OPENING = "avs3d-bench sealed test 1.0: opening key"
#: Largest `seal.json` (bytes).
_MOST_SEAL = 2**30


def commitment(opening: bytes, path: str, data: bytes | None) -> str:
    """The commitment to a private file.

    Args:
        opening: the opening key, ``derive(working key, OPENING)``.
        path: its path in the private folder: key of the observation, a slash, the file's path in it.
        data: its bytes; None: there is no such file.

    Examples:
        >>> commitment(bytes(32), "part_1/a/kitchen/1/observation.json", b"") == commitment(bytes(32), "b", b"")
        False
    """
    salt = derive(opening, path)
    return hashlib.sha256(salt + (b"\0" if data is None else b"\1" + data)).hexdigest()


def truth_files(frames: int, *, part_3: bool) -> tuple[str, ...]:
    """The truth files of an observation to which `seal.json` commits.

    The list depends on nothing but the part and the number of frames. ``gt_3d/sounding_object.ply`` is always in it,
    also where no object of the room sounds. Stems and impulse responses are not: their number would tell that of the
    sources. observation.json, to which there is a commitment, has their sha256.
    """
    folders = [layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS, *([layout.CATEGORY_MASKS] if part_3 else [])]
    masks = (layout.image_path(folder, index) for folder in folders for index in range(frames))
    return (layout.OBSERVATION_JSON, layout.SOUNDING_OBJECT, *masks)


def read_seal(public: str | Path) -> SealRecord:
    """The commitments of a sealed test.

    Raises:
        UsageError: if there are none.
        Avs3dError: if the file is damaged.
    """
    path = Path(public) / layout.SEAL_JSON
    if not path.exists():
        raise UsageError(f"{path}: missing; expected the public folder that `avs3d seal` wrote")
    return parse_record(files.read_bytes(path, _MOST_SEAL), SealRecord, path)


def open_sealed(public: str | Path, truth: str | Path, *, only: Sequence[str] = ()) -> Dataset:
    """The dataset of a sealed test with its truth, for whoever scores.

    Checks that the truth is the one that ``public`` commits to: the manifest, and of the chosen observations every
    truth file that scoring reads.

    Args:
        public: the public folder.
        truth: the private folder.
        only: shell patterns of observation keys; none: all observations.

    Raises:
        UsageError: if one of the folders is none of a sealed test, or both are of different seals.
        Avs3dError: naming the first file that is not what was committed to.
    """
    seal = read_seal(public)
    found = list(check_belonging(Path(public), Path(truth), seal))
    dataset = Dataset(public, truth)
    if not found:
        keys = [key for key in dataset.keys if not only or any(fnmatchcase(key, p) for p in only)]
        strange = [key for key in keys if key not in seal.commitments.truth]
        found = [Problem("error", key, f"{layout.SEAL_JSON} has no commitments to this observation") for key in strange]
    if not found:
        found = list(check_truth(truth, seal, keys, wanted=_scored(Dataset(public), keys)))
    if found:
        first, *rest = found
        more = f" (and {len(rest)} more)" if rest else ""
        raise Avs3dError(f"{Path(truth) / first.path}: {first.message}{more}")
    return dataset


def check_belonging(public: Path, truth: Path, seal: SealRecord) -> Iterator[Problem]:
    """Whether a private folder is of the same seal.

    Raises:
        UsageError: if it is no private folder, or of another seal.
    """
    ours, theirs = public / layout.SEAL_JSON, truth / layout.SEAL_JSON
    if not theirs.exists():
        raise UsageError(f"{theirs}: missing; expected the private folder that `avs3d seal` wrote beside {public}")
    if files.sha256_file(ours) != files.sha256_file(theirs):
        raise UsageError(
            f"{truth}: the truth of another seal: its {layout.SEAL_JSON} is not that of {public}; "
            "expected the private folder that was written with it"
        )
    if not (truth / MANIFEST).exists() and not (truth / OPENING_KEY).exists():
        raise UsageError(
            f"{truth}: a public folder: no {MANIFEST}; "
            f"expected the private folder that `avs3d seal` wrote beside {public}"
        )
    if files.sha256_file(truth / MANIFEST) != seal.commitments.manifest:
        yield Problem("error", MANIFEST, "not the manifest that seal.json commits to; restore it")


def _scored(dataset: Dataset, keys: Iterable[str]) -> Callable[[str, str], bool]:
    """Whether scoring reads a truth file: all but the masks of train frames."""
    splits = {key: dataset.open(key).splits for key in keys}

    def is_scored(key: str, path: str) -> bool:
        name = PurePosixPath(path)
        return name.suffix != ".png" or splits[key].get(name.stem) == "test"

    return is_scored


def opening_key(truth: str | Path) -> bytes:
    """The opening key of a private folder.

    Raises:
        UsageError: if it is missing or damaged.
    """
    return read_hex(Path(truth) / OPENING_KEY, "opening key", "as `avs3d seal` writes it")


def check_truth(
    truth: str | Path,
    seal: SealRecord,
    keys: Iterable[str] | None = None,
    *,
    opening: bytes | None = None,
    wanted: Callable[[str, str], bool] = lambda key, path: True,
) -> Iterator[Problem]:
    """The truth files, and the other private ones, that are not what `seal.json` commits to, by sha256.

    Args:
        truth: the private folder.
        seal: the commitments.
        keys: observations to look at; None: all.
        opening: the opening key; None: that of the private folder.
        wanted: whether a file (key, path in the observation) is looked at.
    """
    key_of_all = opening_key(truth) if opening is None else opening
    chosen = [
        (f"{key}/{path}", digest)
        for key in (seal.commitments.truth if keys is None else keys)
        for path, digest in seal.commitments.truth[key].items()
        if wanted(key, path)
    ]
    chosen += (seal.commitments.private or {}).items()

    def look(one: tuple[str, str]) -> Problem | None:
        return _compare(Path(truth), *one, key_of_all)

    with ThreadPoolExecutor(available_cores()) as pool:
        yield from (found for found in pool.map(look, chosen) if found is not None)


def _compare(truth: Path, path: str, digest: str, opening: bytes) -> Problem | None:
    file = truth / path
    try:
        data = files.read_bytes(file) if file.exists() else None
    except Avs3dError as error:
        return Problem("error", path, str(error).removeprefix(f"{file}: "))
    if commitment(opening, path, data) == digest:
        return None
    if data is None:
        return Problem("error", path, "missing; seal.json commits to such a file")
    return Problem("error", path, "not what seal.json commits to: this file or its commitment was changed")


def check_public(public: str | Path, seal: SealRecord) -> Iterator[Problem]:
    """The published files that are not those that `seal.json` and the records below it name, by sha256.

    ``seal.json`` names `dataset.json`, which names every `poses.json`, which name all other files.
    """
    root = Path(public)
    dataset = Dataset(root)
    if dataset.record is None or files.sha256_file(root / layout.DATASET_JSON) != seal.dataset_sha256:
        yield Problem("error", layout.DATASET_JSON, "missing, or not the file that seal.json names: it was changed")
        return
    listed = {entry.key: entry.digest for entry in dataset.record.observations}
    for key in sorted({*dataset.keys, *seal.commitments.truth} - set(listed)):
        yield Problem("error", key, f"not listed in the public {layout.DATASET_JSON}")
    for key in sorted(set(listed) - set(seal.commitments.truth)):
        yield Problem("error", key, f"listed in {layout.DATASET_JSON}, but {layout.SEAL_JSON} has no commitments to it")
    with ThreadPoolExecutor(available_cores()) as pool:
        # Hashing leaves other threads free: observations are read side by side.
        for found in pool.map(lambda one: list(_check_published(root, *one)), listed.items()):
            yield from found


def _check_published(root: Path, key: str, digest: str) -> Iterator[Problem]:
    """The published files of an observation that are not those that poses.json names; ``digest``: of poses.json."""
    path = root / key / layout.POSES_JSON
    if not path.exists() or files.sha256_file(path) != digest:
        text = "missing, or not the file that dataset.json names: it was changed"
        yield Problem("error", f"{key}/{layout.POSES_JSON}", text)
        return
    record = files.read_record(root / key / layout.POSES_JSON, PosesRecord)
    expected = layout.expected_files(
        len(record.frames), depth=(root / key / layout.DEPTH).is_dir(), receivers=record.receivers
    )
    for name in sorted({name for name in expected if layout.is_public(name)} - set(record.files)):
        yield Problem("error", f"{key}/{layout.POSES_JSON}", f"does not name {name}, which every observation has")
    there = {path.relative_to(root / key).as_posix() for path in (root / key).rglob("*") if not path.is_dir()}
    for name in sorted(there - set(record.files) - {layout.POSES_JSON}):
        yield Problem("error", f"{key}/{name}", "surplus file: poses.json does not name it")
    for name, digest in record.files.items():
        path = root / key / name
        if not path.exists():
            yield Problem("error", f"{key}/{name}", "missing; poses.json names it")
        elif files.sha256_file(path) != digest:
            yield Problem("error", f"{key}/{name}", "not the file that poses.json names: it was changed")


def check_secret(secret: bytes, seal: SealRecord, truth: str | Path) -> tuple[bytes | None, tuple[Problem, ...]]:
    """The working key of a secret, and what is wrong with the secret or with the opening key of ``truth``.

    Returns:
        The key, None if ``secret`` is not the one that was committed to; and the problems.
    """
    key = working_key(secret, seal.commitments.secret)
    if key is None:
        return None, (Problem("error", SECRET, "not the secret that seal.json commits to"),)
    if opening_key(truth) != derive(key, OPENING):
        return key, (Problem("error", OPENING_KEY, "does not follow from the secret: it was changed"),)
    return key, ()
