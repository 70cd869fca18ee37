"""Masks and depth: against the mesh of the sounding object and the record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.formats import media
from avs3d_bench.formats.ply import Ply
from avs3d_bench.validation.findings import Findings, read

#: gt_3d against the bounds of the record (m).
BOUNDS_TOLERANCE = 5e-3


def check_mesh(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings
) -> Ply | None:
    """Read the mesh of the sounding object; None if it is missing or cannot be the reference of the masks.

    In part_3 it is that of all sounding instances of the room.
    """
    mesh = read(findings, files, layout.SOUNDING_OBJECT, observation.mesh)
    if mesh is None:
        return None
    if len(mesh.faces) == 0:
        findings.add(layout.SOUNDING_OBJECT, "no faces; expected a triangle mesh")
        return None
    if record:
        found = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
        sounding = record.sounding_instances
        if not sounding:
            return None  # a surplus file: already named
        boxes = np.asarray([instance.bounds for instance in sounding])
        off = float(np.abs(found - np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])).max())
        if off > BOUNDS_TOLERANCE:
            which = ", ".join(str(instance.id) for instance in sounding)
            what = "instance" if len(sounding) == 1 else "instances"
            text = f"bounds differ from those of {what} {which} in the record by {off:.3f} m"
            findings.add(layout.SOUNDING_OBJECT, text)
            return None  # one wrong mesh would make every mask look wrong
        if record.is_part_3 and record.moves:
            named = set() if mesh.instances is None else set(mesh.instances.tolist())
            if named != {instance.id for instance in sounding}:
                text = f"vertices name the instances {sorted(named)}, where things move expected those that sound"
                findings.add(layout.SOUNDING_OBJECT, text)
                return None
    return mesh


@dataclass(frozen=True, eq=False)
class Contents:
    """Decoded files of one frame; None where a file is missing, damaged or of another size than the record says.

    Attributes:
        rgb: (H, W, 3) uint8.
        mask: (H, W) bool, the sounding instance; in part_3 every audible one.
        ids: (H, W) uint16 instance ids.
        depth: (H, W) float32, metres.
        categories: (H, W) uint8 class ids; only in part_3.
    """

    rgb: NDArray[np.uint8] | None
    mask: NDArray[np.bool_] | None
    ids: NDArray[np.uint16] | None
    depth: NDArray[np.float32] | None
    categories: NDArray[np.uint8] | None = None

    @cached_property
    def instances(self) -> tuple[int, ...]:
        """The values of ``ids``, 0 among them; none without ids."""
        return () if self.ids is None else tuple(np.unique(self.ids).tolist())


def frame_paths(frame: Frame) -> dict[str, str]:
    """The paths of a frame's pictures by folder, relative to the observation."""
    folders = (layout.INPUT, layout.SEMANTIC_MASKS, layout.CATEGORY_MASKS, layout.INSTANCE_MASKS, layout.DEPTH)
    return {folder: f"{folder}/{frame.name}.png" for folder in folders}


def read_contents(
    frame: Frame,
    record: ObservationRecord | None,
    files: set[str],
    findings: Findings,
    known: frozenset[str] = frozenset(),
) -> Contents:
    """Decode the pictures of one frame, naming what cannot be read.

    Args:
        frame: the frame.
        record: observation.json, for the size of the pictures.
        files: the files found, relative.
        findings: where problems go.
        known: files that were looked at with another observation: their RGB is not decoded again.
    """
    paths = frame_paths(frame)
    for path in paths.values():
        if path not in known:
            read(findings, files, path, partial(media.check_png, frame.observation.path / path))
    rgb = None if paths[layout.INPUT] in known else read(findings, files, paths[layout.INPUT], frame.rgb)
    if rgb is not None and int(rgb.max()) == int(rgb.min()):
        findings.add(paths[layout.INPUT], f"every value is {int(rgb.min())}: an empty picture", "warning")
    mask = read(findings, files, paths[layout.SEMANTIC_MASKS], frame.mask)
    ids = read(findings, files, paths[layout.INSTANCE_MASKS], frame.instance_ids)
    depth = read(findings, files, paths[layout.DEPTH], frame.depth)
    categories = read(findings, files, paths[layout.CATEGORY_MASKS], frame.category_mask)
    if record is None:
        return Contents(rgb, mask, ids, depth, categories)
    size = (record.intrinsics.height, record.intrinsics.width)

    def fits(picture: NDArray[Any] | None) -> bool:
        return picture is not None and picture.shape[:2] == size

    return Contents(
        rgb if fits(rgb) else None,
        mask if fits(mask) else None,
        ids if fits(ids) else None,
        depth if fits(depth) else None,
        categories if fits(categories) else None,
    )


def check_masks(
    frame: Frame,
    entry: FrameRecord,
    record: ObservationRecord,
    found: Contents,
    findings: Findings,
) -> None:
    """Hold the masks of one frame to each other and to the record."""
    paths = frame_paths(frame)
    mask, ids = found.mask, found.ids
    if ids is not None:
        strange = sorted(set(found.instances) - {0} - {instance.id for instance in record.instances})
        if strange:
            text = f"ids {strange} are no instances of {layout.OBSERVATION_JSON}"
            findings.add(paths[layout.INSTANCE_MASKS], text)
        _check_line_of_sight(frame, entry, record, ids, findings)
        if found.categories is not None:
            for text in _category_problems(record, record.audible_instances(entry), found):
                findings.add(paths[layout.CATEGORY_MASKS], text)
    if mask is None:
        return
    if ids is not None and record.is_part_3:
        for text in _audible_problems(frame.name, record.audible_instances(entry), ids, mask):
            findings.add(paths[layout.SEMANTIC_MASKS], text)
    elif ids is not None:
        differ = int((mask != (ids == record.sounding.id)).sum())
        if differ:
            text = f"{differ} pixels differ from id {record.sounding.id} in {paths[layout.INSTANCE_MASKS]}"
            findings.add(paths[layout.SEMANTIC_MASKS], text)
    area = int(mask.sum())
    if entry.visible_pixels != area:
        text = f"{area} pixels are marked, visible_pixels of {frame.name} is {entry.visible_pixels}"
        findings.add(paths[layout.SEMANTIC_MASKS], text)


def _audible_problems(
    name: str, audible: tuple[int, ...], ids: NDArray[np.uint16], mask: NDArray[np.bool_]
) -> Iterator[str]:
    """The mask of a frame of part_3 marks the visible pixels of its audible instances, and no others."""
    sounding = np.isin(ids, audible)
    if np.array_equal(mask, sounding):
        return
    surplus = ids[mask & ~sounding]
    for number, count in zip(*np.unique(surplus, return_counts=True), strict=True):
        what = f"instance {number}, which is not audible in {name}" if number else "no instance"
        yield f"{count} marked pixels are on {what}"
    lacking = ids[~mask & sounding]
    for number, count in zip(*np.unique(lacking, return_counts=True), strict=True):
        yield f"{count} pixels of instance {number}, which is audible in {name}, are not marked"


def _category_problems(record: ObservationRecord, audible: tuple[int, ...], found: Contents) -> Iterator[str]:
    """The category mask has the class id of each audible instance on its pixels, and 0 elsewhere."""
    ids, categories = found.ids, found.categories
    if ids is None or categories is None:
        return
    classes = record.class_ids
    known = {instance.id: classes.get(instance.category, 0) for instance in record.instances}
    table = np.zeros(max(*found.instances, *known, 0) + 1, dtype=np.uint8)
    for number in {*audible} & {*known}:
        table[number] = known[number]
    if np.array_equal(table[ids], categories):
        return
    strange = sorted(set(np.unique(categories).tolist()) - {0, *classes.values()})
    if strange:
        yield f"values {strange} are no class ids; expected 0 to {max(classes.values())}"
    for number in sorted({0, *known} & set(found.instances)):
        expected = known.get(number, 0) if number in audible else 0
        wrong = categories[(ids == number) & (categories != expected)]
        if len(wrong):
            where = f"instance {number}" if number else "no instance"
            values = ", ".join(str(value) for value in np.unique(wrong)[:4])
            yield f"{len(wrong)} pixels on {where} have the class id {values}, expected {expected}"


def _check_line_of_sight(
    frame: Frame, entry: FrameRecord, record: ObservationRecord, ids: NDArray[np.uint16], findings: Findings
) -> None:
    """Where the pixel that shows the source, and all around it, belong to the sounding object, the line is free.

    The opposite may be: an object close before the source hides its pixel but does not count.
    """
    shown = record.first_instance
    if entry.line_of_sight or shown is None:
        return
    camera = frame.observation.intrinsics
    (pixel,), (z,) = camera.project(entry.pose, np.asarray([record.source_at(entry)]))
    if not (z > 0 and 1 <= pixel[0] < camera.width - 1 and 1 <= pixel[1] < camera.height - 1):
        return
    column, row = np.floor(pixel).astype(int)
    if (ids[row - 1 : row + 2, column - 1 : column + 2] == shown.id).all():
        text = f"line_of_sight of {frame.name} is false, but the pixel of the source shows the sounding object"
        findings.add(layout.OBSERVATION_JSON, text)


def check_visibility(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings
) -> None:
    """Where the line to the source is free and ends well inside the picture, something of the object should show."""
    shown = record.first_instance if record else None
    if record is None or shown is None:
        return
    camera, cases, empty = observation.intrinsics, 0, list[str]()
    for frame in record.frames:
        if shown.id not in record.audible_instances(frame):
            continue  # its pixels are not marked
        (pixel,), (depth,) = camera.project(frame.pose, np.asarray([record.source_at(frame)]))
        border = 0.02 * camera.width
        inside = depth > 0 and border <= pixel[0] <= camera.width - border
        if inside and border <= pixel[1] <= camera.height - border and frame.line_of_sight:
            cases += 1
            if frame.visible_pixels == 0:
                empty.append(frame.name)
    if len(empty) > max(1, 0.1 * cases):
        text = f"the source is in view and in line of sight in {cases} frames, but the mask is empty in {len(empty)}"
        findings.add(layout.SEMANTIC_MASKS, f"{text} of them: {', '.join(empty[:5])}", "warning")
