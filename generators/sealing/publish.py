"""Splits a generated dataset into what a sealed test publishes and what it keeps, and writes the commitments.

Nothing of a published file depends on the truth. Every one is written anew, in the order of keys and names, without
a link to a private file; all files and folders have the same times and permissions. Pictures, clips and sparse models
have the bytes that the generator wrote: its encoders have no setting that depends on contents, and pictures and points
are drawn before it is drawn what sounds.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    CommitmentsRecord,
    DatasetEntry,
    DatasetRecord,
    DrawsRecord,
    ObservationRecord,
    PosesRecord,
    Scalar,
    SealRecord,
    unique_attributions,
)
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from avs3d_bench.sealing.seal import COMMITTED, MANIFEST, OPENING, OPENING_KEY, commitment, truth_files
from avs3d_bench.sealing.secret import CommittedSecret, derive
from generators.manifest.reading import ManifestFile
from generators.run.dataset_record import licence_of, manifest_attributions

#: Time of every published file and folder: 1980-01-01 00:00:00 UTC, the first that a zip archive can hold (s).
PUBLISHED_TIME = 315_532_800


@dataclass(frozen=True)
class Sealing:
    """Inputs of a sealed test.

    Attributes:
        template: the text of the manifest before.
        drawn: the manifest with its seeds.
        draws: home of the template → how often its seed was drawn.
        secret: its working key and the commitment to it.
        train_truth: whether the masks of train frames are published.
        settings: options on which the bytes depend.
    """

    template: str
    drawn: ManifestFile
    draws: Mapping[str, int]
    secret: CommittedSecret
    train_truth: bool
    settings: Mapping[str, Scalar]


def write_public(generated: Dataset, public: Path, sealing: Sealing) -> SealRecord:
    """Write the public folder.

    Args:
        generated: the whole dataset.
        public: an empty folder.
        sealing: what it was made from.

    Returns:
        The commitments, which are in seal.json.

    Raises:
        Avs3dError: if the generated dataset is damaged, or the system refuses.
    """
    opening = derive(sealing.secret.key, OPENING)
    entries, truth = [], {}
    for key in generated.keys:
        record = files.read_record(generated.root / key / layout.OBSERVATION_JSON, ObservationRecord)
        entries.append(_publish(generated, record, public / key, sealing.train_truth))
        truth[key] = _commit(generated.root, record, opening)
    whole = generated.record
    assert whole is not None
    assert whole.provenance is not None
    files.write_json(public / layout.DATASET_JSON, _describe(whole, entries, sealing))
    seal = SealRecord(
        name=whole.name,
        version=whole.version,
        train_truth=sealing.train_truth,
        settings=dict(sealing.settings),
        backends=whole.backends,
        provenance=whole.provenance,
        dataset_sha256=files.sha256_file(public / layout.DATASET_JSON),
        commitments=CommitmentsRecord(
            secret=sealing.secret.commitment,
            manifest=sealing.drawn.sha256,
            truth=truth,
            private={name: commitment(opening, name, data) for name, data in _describing(generated, sealing).items()},
        ),
    )
    files.write_json(public / layout.SEAL_JSON, seal)
    _even_out(public)
    return seal


def write_private(generated: Dataset, public: Path, private: Path, sealing: Sealing) -> None:
    """Write the private folder: all that ``public`` does not have.

    Args:
        generated: the whole dataset; truth files are hard links to its own, or copies.
        public: the public folder.
        private: an empty folder.
        sealing: what the test was made from.
    """
    for key in generated.keys:
        folder = generated.root / key
        names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        for name in names:
            if not layout.is_public(name):
                files.link_or_copy(folder / name, _with_parent(private / key / name))
    for name, data in {
        **_describing(generated, sealing),
        layout.SEAL_JSON: files.read_bytes(public / layout.SEAL_JSON),
        MANIFEST: sealing.drawn.text.encode(),
        OPENING_KEY: derive(sealing.secret.key, OPENING).hex().encode() + b"\n",
    }.items():
        files.write_bytes(private / name, data)


def _describing(generated: Dataset, sealing: Sealing) -> dict[str, bytes]:
    """Name → bytes of the private files beside the observations to which there are commitments."""
    contents = (
        files.read_bytes(generated.root / layout.DATASET_JSON),
        sealing.template.encode(),
        files.dump_json(DrawsRecord(draws=dict(sealing.draws))).encode(),
    )
    return dict(zip(COMMITTED, contents, strict=True))


def _publish(generated: Dataset, record: ObservationRecord, folder: Path, train_truth: bool) -> DatasetEntry:
    """Write the published files of an observation; returns its entry in dataset.json."""
    source = generated.root / record.key
    names = [name for name in record.files if layout.is_public(name)]
    if train_truth:
        names += [name for name in record.files if _is_train_mask(name, generated, record.key)]
    digests = {}
    for name in sorted(names):
        data = files.read_bytes(source / name)
        digests[name] = files.sha256_bytes(data)
        if digests[name] != record.files[name]:
            raise Avs3dError(f"{source / name}: damaged; delete {source} to have it generated again")
        if not name.startswith(f"{layout.IMAGES}/"):
            files.write_bytes(_with_parent(folder / name), data)
    for name in digests:
        if name.startswith(f"{layout.IMAGES}/"):
            # A second name of the same picture.
            picture = folder / name.replace(layout.IMAGES, layout.INPUT, 1)
            files.link_or_copy(picture, _with_parent(folder / name))
    files.write_json(folder / layout.POSES_JSON, PosesRecord.of(record, digests))
    digest = files.sha256_file(folder / layout.POSES_JSON)
    return DatasetEntry.of(record, digest).model_copy(update={"category": None, "sounds": None})


def _is_train_mask(name: str, generated: Dataset, key: str) -> bool:
    folder, _, file = name.rpartition("/")
    if folder not in (layout.SEMANTIC_MASKS, layout.CATEGORY_MASKS):
        return False
    return not layout.is_test(layout.frame_index(file.removesuffix(".png")))


def _commit(root: Path, record: ObservationRecord, opening: bytes) -> dict[str, str]:
    found = {}
    for name in truth_files(len(record.frames), part_3=record.is_part_3):
        path = root / record.key / name
        data = files.read_bytes(path) if path.exists() else None
        found[name] = commitment(opening, f"{record.key}/{name}", data)
    return found


def _describe(whole: DatasetRecord, entries: Iterable[DatasetEntry], sealing: Sealing) -> DatasetRecord:
    """The published dataset.json: licence and attributions are those of all that the manifest may use."""
    scans = {f"scan:{name}": scan for name, scan in sealing.drawn.manifest.scans.items() if scan.source == "scan"}
    attributions = [entry for entry in whole.attributions if entry.asset.startswith("hrtf:")]
    for entry in manifest_attributions(sealing.drawn):
        scan = scans.get(entry.asset)
        if scan is not None and not (scan.licence and scan.licence.source):
            # Else it would be the scan's file, whose name the test hides.
            entry = entry.model_copy(update={"source": "not published"})
        attributions.append(entry)
    return whole.model_copy(
        update={
            "sealed_test": True,
            "manifest": "",
            "manifest_sha256": hashlib.sha256(b"").hexdigest(),
            "licence": licence_of(whole.backends, attributions),
            "attributions": unique_attributions(attributions),
            "observations": tuple(entries),
        }
    ).sealed()


def _with_parent(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _even_out(root: Path) -> None:
    """Give every file and folder the same times and permissions, folders after what is in them."""
    for folder, _, names in os.walk(root, topdown=False):
        for name in sorted(names):
            _stamp(Path(folder, name), 0o644)
        _stamp(Path(folder), 0o755)


def _stamp(path: Path, mode: int) -> None:
    path.chmod(mode)
    os.utime(path, (PUBLISHED_TIME, PUBLISHED_TIME))
