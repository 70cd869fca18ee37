"""Masks and depth: against the mesh of the sounding object and the record."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.ply import Ply
from avs3d_bench.schema import FrameRecord, ObservationRecord
from avs3d_bench.validation.findings import Findings, read

#: gt_3d against the bounds of the record (m).
BOUNDS_TOLERANCE = 5e-3


def check_mesh(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings
) -> Ply | None:
    """Read the mesh of the sounding object; None if it is missing or cannot be the reference of the masks."""
    mesh = read(findings, files, layout.SOUNDING_OBJECT, observation.mesh)
    if mesh is None:
        return None
    if len(mesh.faces) == 0:
        findings.add(layout.SOUNDING_OBJECT, "no faces; expected a triangle mesh")
        return None
    if record:
        found = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
        off = float(np.abs(found - np.asarray(record.sounding.bounds)).max())
        if off > BOUNDS_TOLERANCE:
            text = f"bounds differ from those of instance {record.sounding.id} in the record by {off:.3f} m"
            findings.add(layout.SOUNDING_OBJECT, text)
            return None  # one wrong mesh would make every mask look wrong
    return mesh


@dataclass(frozen=True, eq=False)
class Contents:
    """What was decoded of one frame; None where a file is missing, damaged or of another size than the record says.

    Attributes:
        rgb: (H, W, 3) uint8.
        mask: (H, W) bool, the sounding instance.
        ids: (H, W) uint16 instance ids.
        depth: (H, W) float32, metres.
    """

    rgb: NDArray[np.uint8] | None
    mask: NDArray[np.bool_] | None
    ids: NDArray[np.uint16] | None
    depth: NDArray[np.float32] | None


def frame_paths(frame: Frame) -> dict[str, str]:
    """The paths of a frame's pictures by folder, relative to the observation."""
    folders = (layout.INPUT, layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS, layout.DEPTH)
    return {folder: f"{folder}/{frame.name}.png" for folder in folders}


def read_contents(frame: Frame, record: ObservationRecord | None, files: set[str], findings: Findings) -> Contents:
    """Decode the pictures of one frame, naming what cannot be read."""
    paths = frame_paths(frame)
    for path in paths.values():
        read(findings, files, path, partial(media.check_png, frame.observation.path / path))
    rgb = read(findings, files, paths[layout.INPUT], frame.rgb)
    if rgb is not None and int(rgb.max()) == int(rgb.min()):
        findings.add(paths[layout.INPUT], f"every value is {int(rgb.min())}: an empty picture", "warning")
    mask = read(findings, files, paths[layout.SEMANTIC_MASKS], frame.mask)
    ids = read(findings, files, paths[layout.INSTANCE_MASKS], frame.instance_ids)
    depth = read(findings, files, paths[layout.DEPTH], frame.depth)
    if record is None:
        return Contents(rgb, mask, ids, depth)
    size = (record.intrinsics.height, record.intrinsics.width)

    def fits(picture: NDArray[Any] | None) -> bool:
        return picture is not None and picture.shape[:2] == size

    return Contents(
        rgb if fits(rgb) else None,
        mask if fits(mask) else None,
        ids if fits(ids) else None,
        depth if fits(depth) else None,
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
        strange = sorted(set(np.unique(ids).tolist()) - {0} - {instance.id for instance in record.instances})
        if strange:
            text = f"ids {strange} are no instances of {layout.OBSERVATION_JSON}"
            findings.add(paths[layout.INSTANCE_MASKS], text)
        _check_line_of_sight(frame, entry, record, ids, findings)
    if mask is None:
        return
    if ids is not None:
        differ = int((mask != (ids == record.sounding.id)).sum())
        if differ:
            text = f"{differ} pixels differ from id {record.sounding.id} in {paths[layout.INSTANCE_MASKS]}"
            findings.add(paths[layout.SEMANTIC_MASKS], text)
    area = int(mask.sum())
    if entry.visible_pixels != area:
        text = f"{area} pixels are marked, visible_pixels of {frame.name} is {entry.visible_pixels}"
        findings.add(paths[layout.SEMANTIC_MASKS], text)


def _check_line_of_sight(
    frame: Frame, entry: FrameRecord, record: ObservationRecord, ids: NDArray[np.uint16], findings: Findings
) -> None:
    """Where the pixel that shows the source, and all around it, belong to the sounding object, the line is free.

    The opposite may be: an object close before the source hides its pixel but does not count.
    """
    if entry.line_of_sight:
        return
    camera = frame.observation.intrinsics
    (pixel,), (z,) = camera.project(entry.pose, np.asarray([record.source_at(entry)]))
    if not (z > 0 and 1 <= pixel[0] < camera.width - 1 and 1 <= pixel[1] < camera.height - 1):
        return
    column, row = np.floor(pixel).astype(int)
    if (ids[row - 1 : row + 2, column - 1 : column + 2] == record.sounding.id).all():
        text = f"line_of_sight of {frame.name} is false, but the pixel of the source shows the sounding object"
        findings.add(layout.OBSERVATION_JSON, text)


def check_visibility(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings
) -> None:
    """Where the line to the source is free and ends well inside the picture, something of the object should show."""
    if record is None:
        return
    camera, cases, empty = observation.intrinsics, 0, list[str]()
    for frame in record.frames:
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
