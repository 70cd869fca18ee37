"""Masks, depth and sparse points against the solid things: the sounding mesh, the bounds of the others."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.dataset import Frame
from avs3d_bench.formats.ply import Ply
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.silhouette import silhouette
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.masks import Contents, frame_paths
from avs3d_bench.validation.rays import first_hits
from avs3d_bench.validation.sightings import Sightings, sample

#: Pixels by which the projected mesh is widened before the mask must lie inside it.
MARGIN = 2
#: depth/ against the nearest and farthest vertex of the mesh (m).
DEPTH_TOLERANCE = 5e-3
#: A point lies on the mesh within this distance along the ray: m, and share of the distance.
ON_MESH = (1e-3, 2e-4)
#: A point that the mesh hides lies this far behind it: m, and share of the distance. Tracks end at half of it.
HIDDEN = (4e-3, 2e-3)
#: Pixels of the mask's edge, beside it and elsewhere on the projected mesh whose rays are followed.
EDGE_RAYS, BESIDE_RAYS, OTHER_RAYS = 64, 64, 32
#: "Beside" is within so many pixels of the mask.
BESIDE = 3
#: Of each kind, so many contradictions are allowed: a number, and a share.
ALLOWED = (2, 0.05)
#: Pairs of a ray and a triangle per frame: large meshes get fewer rays.
BUDGET = 3_000_000
#: Points of an instance lie in its bounds, widened by this (m) …
BOUNDS_MARGIN = 0.02
#: … and of this many points within the bounds of an instance, at least this share is on it in some mask.
BOUNDS_POINTS, BOUNDS_SHARE = 12, 0.05


def _too_many(wrong: int, total: int) -> bool:
    least, share = ALLOWED
    return wrong > max(least, share * total)


@dataclass
class Tally:
    """Counts, over all frames, of points that were taken from a frame: what one frame has too few of to judge by.

    Attributes:
        masks: the folder of the masks that are judged (see `sounding_mask`).
        on_mesh: lie on the sounding mesh.
        lacking: of these, outside the mask.
        marked: lie inside the mask.
        surplus: of these, not on the mesh.
    """

    masks: str = layout.SEMANTIC_MASKS
    on_mesh: int = 0
    lacking: int = 0
    marked: int = 0
    surplus: int = 0

    def finish(self, findings: Findings) -> None:
        """Name masks or a mesh that do not fit over the observation."""
        if _too_many(self.lacking, self.on_mesh):
            text = f"{self.lacking} of {self.on_mesh} sparse points on the sounding mesh lie outside the masks"
            findings.add(self.masks, text)
        if _too_many(self.surplus, self.marked):
            text = f"{self.surplus} of {self.marked} sparse points inside the masks do not lie on it"
            findings.add(layout.SOUNDING_OBJECT, f"{text}: thinned, or masks too wide")


@dataclass(frozen=True, eq=False)
class _MeshView:
    """The mesh as one frame sees it; ``path`` is that of the mask which is held against it."""

    pose: Pose
    path: str
    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    reach: NDArray[np.bool_]

    def hits(self, ends: NDArray[np.float64]) -> NDArray[np.float64]:
        """`first_hits` of rays from the camera."""
        return first_hits(self.vertices, self.faces, np.asarray(self.pose.position), ends)


def sounding_mask(record: ObservationRecord, found: Contents) -> NDArray[np.bool_] | None:
    """(H, W) where a frame shows what the mesh holds; None if that cannot be read.

    In part_3 the semantic mask has the audible instances alone: the instance mask shows all that sound at some time.
    """
    if not record.is_part_3:
        return found.mask
    ids = found.ids
    return None if ids is None else np.isin(ids, [instance.id for instance in record.sounding_instances])


def check_solid(
    frame: Frame,
    entry: FrameRecord,
    record: ObservationRecord,
    found: Contents,
    mesh: Ply,
    sightings: Sightings | None,
    tally: Tally,
    findings: Findings,
) -> None:
    """Hold one frame to the mesh of the sounding object.

    The mask lies inside the projected mesh, to the pixel at its edge; points of `sparse/0` are on the mesh where the
    mask says so, and nowhere seen through it; where there is depth, the mask ends where something stands before the
    mesh or the mesh ends.
    """
    paths, mask = frame_paths(frame), sounding_mask(record, found)
    placed = record.to_frame(entry, mesh.vertices, mesh.instances) if record.moves else mesh.vertices
    vertices = placed.astype(np.float32)
    reach = silhouette(frame.observation.intrinsics, entry.pose, vertices, mesh.faces, MARGIN)
    path = paths[layout.INSTANCE_MASKS if record.is_part_3 else layout.SEMANTIC_MASKS]
    view = _MeshView(entry.pose, path, vertices, mesh.faces, reach)
    if mask is not None:
        area, outside = int(mask.sum()), int((mask & ~reach).sum())
        if outside:
            text = f"{outside} of {area} marked pixels lie outside the projected sounding object"
            findings.add(path, text)
            return
        _check_rays(frame, view, mask, found.depth, findings)
        if found.depth is not None and area:
            z = -entry.pose.to_camera(vertices)[:, 2]
            seen = found.depth[mask]
            wrong = int(((seen < z.min() - DEPTH_TOLERANCE) | (seen > z.max() + DEPTH_TOLERANCE)).sum())
            if wrong:
                text = f"{wrong} of {area} pixels of the sounding object are nearer or farther than its mesh"
                findings.add(paths[layout.DEPTH], text)
    if sightings is not None:
        _check_points(frame, view, mask, sightings, tally, findings)


def _check_rays(
    frame: Frame, view: _MeshView, mask: NDArray[np.bool_], depth: NDArray[np.float32] | None, findings: Findings
) -> None:
    """Rays through pixel centres: of the mask's edge, and (where there is depth) of what is beside it."""
    camera, path = frame.observation.intrinsics, view.path
    small, kernel = mask.astype(np.uint8), np.ones((2 * BESIDE + 1, 2 * BESIDE + 1), dtype=np.uint8)
    inner = cv2.erode(small, np.ones((3, 3), dtype=np.uint8), borderValue=1) > 0
    near = cv2.dilate(small, kernel) > 0
    groups = [(mask & ~inner, EDGE_RAYS)]
    if depth is not None:
        groups += [(near & ~mask & view.reach, BESIDE_RAYS), (view.reach & ~near, OTHER_RAYS), (inner, OTHER_RAYS)]
    budget = BUDGET / max(1, len(view.faces)) / sum(count for _, count in groups)
    for number, (region, count) in enumerate(groups):
        chosen = sample((frame.index, number), np.flatnonzero(region), max(4, int(count * min(1.0, budget))))
        if not len(chosen):
            continue
        row, column = np.divmod(chosen, camera.width)
        centres = np.stack([column, row], axis=1) + 0.5
        ends = camera.unproject(view.pose, centres, np.ones(len(chosen)))
        z = view.hits(ends)  # at depth 1, multiples of the ray are metres along the optical axis
        if number == 0:
            missed = int(np.isinf(z).sum())
            if _too_many(missed, len(chosen)):
                findings.add(path, f"{missed} of {len(chosen)} pixels at the edge of the mask miss the sounding mesh")
        if depth is None:
            continue
        seen = depth[row, column].astype(np.float64)
        near_it = np.isfinite(z) & (np.abs(seen - z) <= 2e-3 + ON_MESH[1] * np.minimum(z, 1e6))
        if number in (0, 3):
            off = int((np.isfinite(z) & ~near_it).sum())
            if _too_many(off, len(chosen)):
                text = f"{off} of {len(chosen)} pixels of the sounding object have another depth than its mesh"
                findings.add(frame_paths(frame)[layout.DEPTH], text)
        else:
            lacking = int(near_it.sum())
            if _too_many(lacking, len(chosen)):
                where = "beside the mask" if number == 1 else "outside the mask"
                text = f"{lacking} of {len(chosen)} pixels {where} show the surface of the sounding object: eroded?"
                findings.add(path, text)


def _check_points(
    frame: Frame,
    view: _MeshView,
    mask: NDArray[np.bool_] | None,
    sightings: Sightings,
    tally: Tally,
    findings: Findings,
) -> None:
    chosen = np.flatnonzero(view.reach[sightings.row, sightings.column])
    most = max(16, int(BUDGET / max(1, len(view.faces))))
    # The points that were taken from this frame say most.
    own = sample((frame.index, 7), chosen[sightings.origin[chosen]], most)
    chosen = np.union1d(own, sample((frame.index, 8), chosen, max(0, most - len(own))))
    if not len(chosen):
        return
    points = sightings.position[chosen]
    distance = np.linalg.norm(points - np.asarray(view.pose.position), axis=1)
    hit = view.hits(points)
    gap = np.where(np.isfinite(hit), (np.where(np.isfinite(hit), hit, 0.0) - 1.0) * distance, np.inf)
    hidden = int((gap < -(HIDDEN[0] + HIDDEN[1] * distance)).sum())
    if _too_many(hidden, len(chosen)):
        text = f"{frame.name} sees {hidden} of {len(chosen)} sparse points through the mesh"
        findings.add(layout.SOUNDING_OBJECT, f"{text}: it, its pose or sparse/0 is wrong")
    if mask is None:
        return
    origin = sightings.origin[chosen]
    marked = mask[sightings.row[chosen], sightings.column[chosen]]
    on = np.abs(gap) <= ON_MESH[0] + ON_MESH[1] * distance
    lacking, surplus = int((origin & on & ~marked).sum()), int((origin & ~on & marked).sum())
    tally.on_mesh += int((origin & on).sum())
    tally.marked += int((origin & marked).sum())
    tally.lacking += lacking
    tally.surplus += surplus
    if lacking > max(1, ALLOWED[1] * int((origin & on).sum())):
        text = f"{lacking} sparse points taken from the frame lie on the sounding mesh, but outside the mask"
        findings.add(view.path, text)
    if surplus > max(1, ALLOWED[1] * int((origin & marked).sum())):
        text = f"{surplus} sparse points taken from the frame lie inside the mask, but not on the sounding mesh"
        findings.add(view.path, text)


class Boxes:
    """Holds the instance masks to the bounds of the record, with the points that were taken from each frame."""

    def __init__(self, record: ObservationRecord) -> None:
        # Where something moves, `sparse/0` has no point on any placed object, so that those within the bounds of one
        # lie on what it stands on or against.
        self._on_objects = not record.moves
        self._boxes = {
            instance.id: np.asarray(instance.bounds)
            for instance in record.instances
            if instance.id not in record.moving_instances
        }
        self._inside = dict.fromkeys(self._boxes, 0)
        self._marked = dict.fromkeys(self._boxes, 0)

    def add(self, frame: Frame, sightings: Sightings, ids: NDArray[np.uint16], findings: Findings) -> None:
        """Look at one frame."""
        own = sightings.origin
        points, shown = sightings.position[own], ids[sightings.row[own], sightings.column[own]]
        for number, (low, high) in self._boxes.items():
            within = ((points >= low - BOUNDS_MARGIN) & (points <= high + BOUNDS_MARGIN)).all(axis=1)
            self._inside[number] += int(within.sum())
            self._marked[number] += int((within & (shown == number)).sum())
            outside, total = int((~within & (shown == number)).sum()), int((shown == number).sum())
            if outside > max(1, ALLOWED[1] * total):
                text = f"{outside} of {total} sparse points on instance {number} lie outside its bounds in the record"
                findings.add(frame_paths(frame)[layout.INSTANCE_MASKS], text)

    def finish(self, findings: Findings) -> None:
        """Name instances that fill their bounds with points and are in no mask."""
        if not self._on_objects:
            return
        for number, inside in self._inside.items():
            if inside >= BOUNDS_POINTS and self._marked[number] < BOUNDS_SHARE * inside:
                text = f"of {inside} sparse points within the bounds of instance {number}, masks show it in "
                findings.add(layout.INSTANCE_MASKS, text + f"{self._marked[number]}: missing, or its bounds are wrong")
