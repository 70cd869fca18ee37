"""Masks and depth: against the mesh of the sounding object and the record."""

from __future__ import annotations

import numpy as np

from avs3d_bench import layout
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.ply import Ply
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.silhouette import silhouette
from avs3d_bench.validation.findings import Findings, read

#: Pixels by which the projected mesh is widened before the mask must lie inside it.
SILHOUETTE_MARGIN = 2
#: gt_3d against the bounds of the record, and depth/ against gt_3d: metres.
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


def check_pictures(
    frame: Frame, record: ObservationRecord | None, mesh: Ply | None, files: set[str], findings: Findings
) -> None:
    """Decode the pictures of one frame, and hold its masks and depth to each other, the record and the mesh."""
    paths = {
        folder: f"{folder}/{frame.name}.png"
        for folder in (layout.INPUT, layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS, layout.DEPTH)
    }
    rgb = read(findings, files, paths[layout.INPUT], frame.rgb)
    if rgb is not None and int(rgb.max()) == int(rgb.min()):
        findings.add(paths[layout.INPUT], f"every value is {int(rgb.min())}: an empty picture", "warning")
    mask = read(findings, files, paths[layout.SEMANTIC_MASKS], frame.mask)
    ids = read(findings, files, paths[layout.INSTANCE_MASKS], frame.instance_ids)
    depth = read(findings, files, paths[layout.DEPTH], frame.depth)
    if record is None:
        return
    size = (record.intrinsics.height, record.intrinsics.width)
    if ids is not None:
        strange = sorted(set(np.unique(ids).tolist()) - {0} - {instance.id for instance in record.instances})
        if strange:
            text = f"ids {strange} are no instances of {layout.OBSERVATION_JSON}"
            findings.add(paths[layout.INSTANCE_MASKS], text)
    if mask is None or mask.shape != size:
        return
    if ids is not None and ids.shape == size:
        differ = int((mask != (ids == record.sounding.id)).sum())
        if differ:
            text = f"{differ} pixels differ from id {record.sounding.id} in {paths[layout.INSTANCE_MASKS]}"
            findings.add(paths[layout.SEMANTIC_MASKS], text)
    area, entry = int(mask.sum()), frame.record
    if entry and entry.visible_pixels != area:
        text = f"{area} pixels are marked, visible_pixels of {frame.name} is {entry.visible_pixels}"
        findings.add(paths[layout.SEMANTIC_MASKS], text)
    if entry and mesh is not None and area:
        vertices = record.to_frame(entry, mesh.vertices).astype(np.float32)
        reach = silhouette(frame.observation.intrinsics, entry.pose, vertices, mesh.faces, SILHOUETTE_MARGIN)
        outside = int((mask & ~reach).sum())
        if outside:
            text = f"{outside} of {area} marked pixels lie outside the projected sounding object"
            findings.add(paths[layout.SEMANTIC_MASKS], text)
        elif depth is not None and depth.shape == size:
            z = -entry.pose.to_camera(vertices)[:, 2]
            seen = depth[mask]
            wrong = int(((seen < z.min() - BOUNDS_TOLERANCE) | (seen > z.max() + BOUNDS_TOLERANCE)).sum())
            if wrong:
                text = f"{wrong} of {area} pixels of the sounding object are nearer or farther than its mesh"
                findings.add(paths[layout.DEPTH], text)


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
