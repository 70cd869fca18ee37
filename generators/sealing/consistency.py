"""Do the parts of an opened sealed test say the same, and is in them what the secret draws? Nothing is generated.

An organiser who forges a test before it is sealed computes every commitment again, so hashes find nothing. What is
found here: observations that the manifest has and the test has not, or the reverse; files that nothing names; records
that contradict the files, the poses or the manifest; masks that contradict ids, visible pixels or sparse points; sparse
points and sounding objects other than the secret draws.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import CameraSplits, DatasetRecord, ObservationRecord, PosesRecord, SealRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.sealing.seal import COMMITTED, MANIFEST, OPENING_KEY
from avs3d_bench.validation.catalogue import check_catalogue
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.masks import Contents, check_masks
from avs3d_bench.validation.sightings import Labels, Sightings, check_labels, sightings_by_frame
from generators.manifest.schema import Manifest, ObservationSpec
from generators.observation.arrangement import draw_instances
from generators.observation.sources import drawn_level
from generators.observation.surface_points import draw_pixels
from generators.plan import ObservationPlan

#: Share of the sparse points that must be pixels that the secret draws. Of another seed's or observation's, few are.
_LEAST_DRAWN = 0.9
#: Fewest sparse points with which that is asked.
_FEWEST_POINTS = 10

_D = TypeVar("_D", bound=np.generic)
#: Category, room and level (dB) of a source.
_SourceFacts = tuple[str, str, float]


@dataclass(frozen=True)
class Opened:
    """An opened sealed test, its hashes checked.

    Attributes:
        public, private: its folders.
        seal: the commitments.
        manifest: that of the private folder.
        plans: key → plan, for the draws of the secret; empty if other software made the test, whose draws may differ.
        digests: key → digest of the plan with the options of the seal; empty if it cannot be computed here.
    """

    public: Path
    private: Path
    seal: SealRecord
    manifest: Manifest
    plans: Mapping[str, ObservationPlan]
    digests: Mapping[str, str]


def check_consistency(opened: Opened) -> Iterator[Problem]:
    """All contradictions in an opened test."""
    yield from _check_keys(opened)
    keys = [key for key in opened.seal.commitments.truth if (opened.private / key / layout.OBSERVATION_JSON).is_file()]
    records: dict[str, ObservationRecord] = {}
    for key in keys:
        try:
            records[key] = files.read_record(opened.private / key / layout.OBSERVATION_JSON, ObservationRecord)
        except Avs3dError as error:
            yield Problem("error", f"{key}/{layout.OBSERVATION_JSON}", str(error).partition(": ")[2])
    yield from _check_catalogue(opened, records)
    yield from _check_surplus(
        opened.private, _private_files(opened, records), "private", unread=set(keys) - set(records)
    )
    dataset = Dataset(opened.public, opened.private)
    known = {*dataset.keys, *opened.seal.commitments.truth}
    yield from _check_surplus(opened.public, {layout.DATASET_JSON, layout.SEAL_JSON, *known}, "public", unread=known)
    specs = {spec.key: spec for spec in opened.manifest.observations}
    with ThreadPoolExecutor(available_cores()) as pool:
        # Hashing and decoding leave other threads free: observations are read side by side.
        yield from (
            found
            for problems in pool.map(
                lambda key: list(_check_observation(opened, dataset, records[key], key, specs.get(key))), records
            )
            for found in problems
        )


def _check_keys(opened: Opened) -> Iterator[Problem]:
    """The manifest, which the secret draws from the template, has the observations that are committed to."""
    wanted, found = {spec.key for spec in opened.manifest.observations}, set(opened.seal.commitments.truth)
    for key in sorted(wanted - found):
        yield Problem("error", key, f"dropped: {MANIFEST} has this observation, but seal.json has no commitments to it")
    for key in sorted(found - wanted):
        yield Problem("error", key, f"added: seal.json commits to this observation, but {MANIFEST} does not have it")


def _check_catalogue(opened: Opened, records: Mapping[str, ObservationRecord]) -> Iterator[Problem]:
    """The private dataset.json against the manifest and the observations."""
    path = opened.private / layout.DATASET_JSON
    try:
        record = files.read_record(path, DatasetRecord)
    except Avs3dError as error:
        yield Problem("error", layout.DATASET_JSON, f"private: {str(error).removeprefix(f'{path}: ')}")
        return
    for problem in check_catalogue(record, records):
        if problem.severity == "error":
            yield Problem("error", problem.path, f"private: {problem.message}")
    if record.manifest.encode() != files.read_bytes(opened.private / MANIFEST):
        yield Problem("error", layout.DATASET_JSON, f"private: the manifest in it is not {MANIFEST}")
    listed = {entry.key: entry.digest for entry in record.observations}
    for key in sorted({*listed, *records}):
        if key not in listed:
            yield Problem("error", key, f"not listed in the private {layout.DATASET_JSON}")
        elif not (opened.private / key / layout.OBSERVATION_JSON).is_file():
            yield Problem("error", key, f"listed in the private {layout.DATASET_JSON}, but not there")
        elif files.sha256_file(opened.private / key / layout.OBSERVATION_JSON) != listed[key]:
            text = f"sha256 differs from the digest in the private {layout.DATASET_JSON}"
            yield Problem("error", f"{key}/{layout.OBSERVATION_JSON}", text)


# Files


def _private_files(opened: Opened, records: Mapping[str, ObservationRecord]) -> set[str]:
    """Paths of all files that the private folder may have."""
    seal = opened.seal.commitments
    named = {MANIFEST, OPENING_KEY, layout.SEAL_JSON, *COMMITTED}
    for key, committed in seal.truth.items():
        named.update(f"{key}/{name}" for name in committed)
        if key in records:
            named.update(f"{key}/{name}" for name in records[key].files if not layout.is_public(name))
    return named


def _check_surplus(root: Path, named: Collection[str], what: str, unread: Collection[str]) -> Iterator[Problem]:
    """Files and folders that nothing names; a folder is one problem. ``unread``: keys whose record cannot be read."""
    folders = {str(parent) for name in named for parent in Path(name).parents}
    for place, inside, names in os.walk(root):
        here = Path(place).relative_to(root)
        if here.as_posix() in unread:
            inside.clear()
            continue
        for name in sorted(inside):
            path = (here / name).as_posix()
            if path not in folders and path not in unread:
                count = sum(len(each) for _, _, each in os.walk(root / path))
                yield Problem("error", path, f"surplus folder in {what}/ with {count:,} files: nothing commits to it")
        inside[:] = [name for name in inside if (here / name).as_posix() in {*folders, *unread}]
        for name in sorted(names):
            path = (here / name).as_posix()
            if path not in named:
                yield Problem("error", path, f"surplus file in {what}/: nothing commits to it")


def _check_files(opened: Opened, key: str, record: ObservationRecord, poses: PosesRecord) -> Iterator[Problem]:
    """The sha256 and sizes in observation.json are those of the files, of which poses.json has the public ones."""
    where = f"{key}/{layout.OBSERVATION_JSON}"
    for name, digest in sorted(poses.files.items()):
        said = record.files.get(name)
        if said != digest:
            text = "has no sha256" if said is None else "has another sha256"
            yield Problem("error", where, f"{text} of {name} than {layout.POSES_JSON}")
    for name in sorted(opened.seal.commitments.truth[key]):
        if name != layout.OBSERVATION_JSON and name not in record.files and (opened.private / key / name).exists():
            yield Problem("error", where, f"does not name {name}, which is there")
    for name, digest in sorted(record.files.items()):
        path = opened.private / key / name
        if layout.is_public(name):
            path = opened.public / key / name
            if name not in poses.files:
                yield Problem("error", where, f"names {name}, which {layout.POSES_JSON} does not name")
        elif not path.exists():
            yield Problem("error", f"{key}/{name}", "missing; observation.json names it")
        elif files.sha256_file(path) != digest:
            text = "not the file that observation.json names: its sha256 is another one"
            yield Problem("error", f"{key}/{name}", text)
        size = (record.sizes or {}).get(name)
        if size is not None and path.exists() and path.stat().st_size != size:
            yield Problem("error", where, f"has another size of {name} than the file")


# Records


def _check_observation(
    opened: Opened, dataset: Dataset, record: ObservationRecord, key: str, spec: ObservationSpec | None
) -> Iterator[Problem]:
    path = opened.public / key / layout.POSES_JSON
    if not path.is_file():
        return  # named already
    poses = files.read_record(path, PosesRecord)
    where = f"{key}/{layout.OBSERVATION_JSON}"
    if record.key != key:
        yield Problem("error", where, f"is that of {record.key}: observations were exchanged")
        return
    yield from _check_files(opened, key, record, poses)
    if PosesRecord.of(record, poses.files) != poses:
        yield Problem("error", where, f"has other poses, intrinsics or receivers than {layout.POSES_JSON}")
    for text in _against_manifest(record, spec, opened) if spec else ():
        yield Problem("error", where, f"{text}: not the observation that {MANIFEST} describes")
    observation = dataset.open(key)
    try:
        yield from _check_pictures(opened, observation, record)
    except Avs3dError as error:
        yield Problem("error", key, str(error))


def _wanted_sources(spec: ObservationSpec, plan: ObservationPlan | None) -> list[_SourceFacts]:
    """(category, room, level) of the sources that the manifest names, with the levels that the secret draws."""
    of_category: Counter[str] = Counter()
    found: list[_SourceFacts] = []
    for source in spec.sources or ():
        of_category[source.category] += 1
        drawn = drawn_level(plan, source.category, of_category[source.category]) if plan else 0.0
        found.append((source.category, source.room or spec.room, source.gain_db + drawn))
    return found


def _against_manifest(record: ObservationRecord, spec: ObservationSpec, opened: Opened) -> Iterator[str]:
    """Contradictions between an observation's record and the manifest with the draws of the secret."""
    manifest = opened.manifest
    found: list[tuple[str, object, object]] = [
        ("seed", record.seed, manifest.seed),
        ("frames", len(record.frames), manifest.camera.frames),
        ("objects", _counts(i.category for i in record.instances), spec.objects),
    ]
    plan = opened.plans.get(record.key)
    if spec.sources is None:
        found += [("category", record.category, spec.category), ("original", record.variant_of, spec.like)]
        if manifest.levels is None or plan is not None:
            level = drawn_level(plan, str(spec.category)) if plan else 0.0
            found.append(("level", (record.sound and record.sound.gain_db) or 0.0, level))
    else:
        sources: list[_SourceFacts] = [(s.category, s.room, s.gain_db) for s in record.sources or ()]
        wanted = _wanted_sources(spec, plan)
        if manifest.levels is not None and plan is None:  # what other software draws is not known
            sources, wanted = ([(category, room, 0.0) for category, room, _ in some] for some in (sources, wanted))
        background = record.background and (record.background.kind, record.background.snr_db)
        found += [
            ("sources", sources, wanted),
            ("background", background, spec.background and (spec.background.kind, spec.background.snr_db)),
            ("group", record.group, spec.like or spec.key),
        ]
    wrong = [f"{name} {mine!r}, expected {theirs!r}" for name, mine, theirs in found if mine != theirs]
    yield from wrong
    digest = opened.digests.get(record.key)
    if digest is not None and record.plan_sha256 != digest:
        yield "plan_sha256 is not that of the manifest and the options of the seal"
    if plan is not None and not wrong:
        drawn, sounding = _drawn(plan, record), _sounding(record)
        if drawn != sounding:
            yield f"the sounding instances are {sounding}, the secret draws {drawn}"


def _counts(names: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


def _sounding(record: ObservationRecord) -> list[int | None]:
    """Instance of each source, None off-screen."""
    return [record.sounding.id] if record.sources is None else [source.instance for source in record.sources]


def _drawn(plan: ObservationPlan, record: ObservationRecord) -> list[int | None]:
    """The instance of each source that the secret draws, given the placed objects."""
    categories = [each.category for each in sorted(record.instances, key=lambda each: each.id)]
    return list(draw_instances(plan, categories))


# Pictures


def _check_pictures(opened: Opened, observation: Observation, record: ObservationRecord) -> Iterator[Problem]:
    """Masks against ids, visible pixels and sparse points; sparse points against the draws of the secret."""
    findings = Findings(observation)
    if files.read_record(observation.where(layout.SPLITS_JSON), CameraSplits) != CameraSplits.of(len(record.frames)):
        findings.add(layout.SPLITS_JSON, "another split than every eighth frame")
    try:
        seen = sightings_by_frame(observation.colmap, observation.intrinsics)
    except Avs3dError as error:
        findings.take(layout.COLMAP, error)
        seen = {}
    plan = opened.plans.get(record.key)
    if plan is not None and not _are_drawn(plan, record, seen):
        text = "its points are not the pixels that the secret draws: of another observation, or of another seed"
        findings.add(layout.COLMAP, text)
    labels = Labels()
    for frame in observation.frames:
        entry = frame.record
        contents = _read(frame, record, findings)
        if entry is None:
            continue
        check_masks(frame, entry, record, contents, findings)
        if contents.ids is not None and frame.name in seen:
            labels.add(frame.name, seen[frame.name], contents.ids)
    check_labels(labels, findings)
    yield from (problem for problem in findings.problems if problem.severity == "error")


def _read(frame: Frame, record: ObservationRecord, findings: Findings) -> Contents:
    """The masks of a frame; those that are missing or cannot be read are named by their commitments already."""
    size = record.intrinsics.height, record.intrinsics.width

    def read(folder: str, reader: Callable[[], NDArray[_D]]) -> NDArray[_D] | None:
        path = f"{folder}/{frame.name}.png"
        if not frame.observation.where(path).is_file():
            return None
        try:
            picture = reader()
        except Avs3dError as error:
            findings.add(path, str(error).rpartition(": ")[2])
            return None
        if picture.shape == size:
            return picture
        findings.add(path, f"{picture.shape[1]} × {picture.shape[0]} pixels, expected {size[1]} × {size[0]}")
        return None

    return Contents(
        rgb=None,
        mask=read(layout.SEMANTIC_MASKS, frame.mask),
        ids=read(layout.INSTANCE_MASKS, frame.instance_ids),
        depth=None,
        categories=read(layout.CATEGORY_MASKS, frame.category_mask) if record.is_part_3 else None,
    )


def _are_drawn(plan: ObservationPlan, record: ObservationRecord, seen: Mapping[str, Sightings]) -> bool:
    """Whether the sparse points were taken from the pixels that the secret draws."""
    camera, rng = record.intrinsics, plan.rng("points")
    right = total = 0
    for entry in record.frames:
        rows, columns = draw_pixels(rng, camera.height, camera.width)
        sightings = seen.get(entry.name)
        if sightings is None:
            continue
        drawn = np.zeros((camera.height, camera.width), dtype=np.bool_)
        drawn[rows, columns] = True
        taken = drawn[sightings.row[sightings.origin], sightings.column[sightings.origin]]
        right, total = right + int(taken.sum()), total + len(taken)
    return total < _FEWEST_POINTS or right >= _LEAST_DRAWN * total
