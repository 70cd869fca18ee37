"""Data that `avs3d view-3d` shows, gathered from disk: nothing here needs viser.

World coordinates: metres, Y up. What the official release does not have (mesh, instances, source) is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import InstanceRecord, ObservationRecord, SubmissionRecord
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_record
from avs3d_bench.formats.ply import Ply
from avs3d_bench.formats.predictions import read_points
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.inspector.floorplan import EYES, HEAD
from avs3d_bench.inspector.sources import ShownSound, read_sound
from avs3d_bench.inspector.view3d_surfaces import VisibleSurface, floor_picture, room_surfaces

#: Points from depth: this many frames, and about this many points of each.
DEPTH_FRAMES, DEPTH_POINTS = 12, 25_000
#: A predicted cloud that is larger is thinned for showing.
MOST_PREDICTED = 200_000


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (N, 3) float32, metres, and their colours (N, 3) uint8."""

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]

    def where(self, chosen: NDArray[np.bool_]) -> Cloud:
        """The chosen ones."""
        return Cloud(self.points[chosen], self.colours[chosen])


@dataclass(frozen=True)
class Moment3D:
    """One frame with a pose.

    Attributes:
        frame: where its picture is.
        pose: of the camera, camera-to-world.
        sources: id of a source → where it is at this time; none if that is unknown.
        moved: id of an instance that moves → what takes it from where it is at the first frame to where it is now.
        audible: ids and names of the audible sources of a part_3 observation; None if it is none.
        nothing: what is heard where there are none.
    """

    frame: Frame
    pose: Pose
    sources: Mapping[str, tuple[float, float, float]]
    moved: Mapping[int, Pose]
    audible: dict[str, str] | None = None
    nothing: str = "silence"

    @property
    def caption(self) -> str:
        """Name, split, azimuth and distance, as far as they are known; in a part_3 observation what is audible."""
        pieces = [self.frame.name, *([self.frame.split] if self.frame.split else [])]
        record = self.frame.record
        if self.audible is not None:
            pieces.append(", ".join(self.audible.values()) or self.nothing)
        elif record is not None:
            pieces.append(f"{record.azimuth:+.0f}°, {record.distance:.2f} m")
            pieces += [] if record.line_of_sight else ["hidden"]
        return " · ".join(pieces)


@dataclass(frozen=True, eq=False)
class PredictedPoints:
    """The points (N, 3) that a submission predicts, and its method's name."""

    method: str
    points: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Scene3D:
    """Everything that is shown of an observation.

    Attributes:
        key: of the observation.
        category: of the sounding object; None in the official release.
        camera: its intrinsics.
        frames: those with a pose, in the order of time.
        surfaces: pictures of the room on patches around its sparse points, and a scan's from above on its floor;
            without the ceiling.
        room: the sparse points below the ceiling.
        ceiling: those above, which hide the room from outside.
        dense: from a few frames' depth; None without depth.
        mesh: of the sounding object at the first frame; None in the official release.
        instances: placed objects.
        moving: ids of those that move.
        predictions: in the order of the submissions.
        lanes: the sound, where each source is shown for itself; None where one always sounds, or nothing is known.
    """

    key: str
    category: str | None
    camera: Intrinsics
    frames: tuple[Moment3D, ...]
    surfaces: tuple[VisibleSurface, ...]
    room: Cloud
    ceiling: Cloud
    dense: Cloud | None
    mesh: Ply | None
    instances: tuple[InstanceRecord, ...]
    moving: tuple[int, ...]
    predictions: tuple[PredictedPoints, ...]
    lanes: ShownSound | None = None

    @property
    def vertical_fov(self) -> float:
        """Radians."""
        return 2 * math.atan(self.camera.height / 2 / self.camera.fy)


def read_scene(observation: Observation, submissions: Sequence[str | Path] = ()) -> Scene3D:
    """Gather what is shown.

    Raises:
        UsageError: if a submission has no points of the observation.
        Avs3dError: if no frame has a pose, or a file is missing or damaged.
    """
    # Submissions first: a wrong name is reported before anything large is read.
    predictions = tuple(read_prediction(folder, observation.key) for folder in submissions)
    record = observation.record
    sound = read_sound(observation)
    lanes = None if sound is None or sound.always else sound
    frames = tuple(
        _moment(frame, record, lanes, number) for number, frame in enumerate(observation.frames) if frame.has_pose
    )
    if not frames:
        raise Avs3dError(f"{observation.path / layout.COLMAP}: no frame has a pose; expected a sparse model of them")
    points = observation.colmap.points
    sparse = Cloud(points.positions.astype(np.float32), points.colours)
    dense = fused_depth(observation) if (observation.path / layout.DEPTH).is_dir() else None
    top = min(moment.pose.position[1] for moment in frames) + HEAD
    above = sparse.points[:, 1] > top
    ground = floor_picture(observation, top - HEAD - EYES)
    return Scene3D(
        key=observation.key,
        category=observation.category,
        camera=observation.intrinsics,
        frames=frames,
        surfaces=(*room_surfaces(observation, top), *([ground] if ground else [])),
        room=sparse.where(~above),
        ceiling=sparse.where(above),
        dense=dense.where(dense.points[:, 1] <= top) if dense else None,
        mesh=observation.mesh() if (observation.path / layout.SOUNDING_OBJECT).exists() else None,
        instances=record.instances if record else (),
        moving=record.moving_instances if record else (),
        predictions=predictions,
        lanes=lanes,
    )


def _moment(frame: Frame, record: ObservationRecord | None, lanes: ShownSound | None, number: int) -> Moment3D:
    entry = frame.record
    if record is None or entry is None:
        return Moment3D(frame, frame.pose, {}, {})
    sources = {source.id: record.source_at(entry, source) for source in record.sound_sources}
    moved = {}
    for instance in record.instances:
        if instance.id in record.moving_instances:
            first = Pose(instance.position, instance.rotation)
            moved[instance.id] = moved_from(first, record.pose_at(entry, instance.id))
    if lanes is None:
        return Moment3D(frame, frame.pose, sources, moved)
    audible = {source.record.id: source.name for source in lanes.audible(number)}
    return Moment3D(frame, frame.pose, sources, moved, audible, lanes.nothing)


def moved_from(first: Pose, now: Pose) -> Pose:
    """The transform that takes points of an object from its place at pose ``first`` to that at pose ``now``."""
    rotation = now.rotation_matrix @ first.rotation_matrix.T
    x, y, z, w = (float(c) for c in Rotation.from_matrix(rotation).as_quat())
    px, py, pz = (float(c) for c in np.asarray(now.position) - rotation @ np.asarray(first.position))
    return Pose((px, py, pz), (w, x, y, z))


def fused_depth(observation: Observation) -> Cloud:
    """Points of a few frames' depth, in the colours of their pixels; every k-th row and column.

    Raises:
        Avs3dError: if a picture is missing or damaged, or sizes differ.
    """
    posed = [frame for frame in observation.frames if frame.has_pose]
    chosen = np.unique(np.linspace(0, len(posed) - 1, min(DEPTH_FRAMES, len(posed))).round().astype(int))
    points, colours = [], []
    for frame in (posed[number] for number in chosen):
        depth, rgb = frame.depth(), frame.rgb()
        if depth.shape != rgb.shape[:2]:
            raise Avs3dError(
                f"{frame.path(layout.DEPTH)}: {depth.shape}, expected {rgb.shape[:2]} as the picture; regenerate it"
            )
        step = max(1, math.ceil(math.sqrt(depth.size / DEPTH_POINTS)))
        rows, columns = np.mgrid[step // 2 : depth.shape[0] : step, step // 2 : depth.shape[1] : step].reshape(2, -1)
        met = depth[rows, columns] > 0
        rows, columns = rows[met], columns[met]
        centres = np.stack([columns, rows], axis=1) + 0.5
        world = observation.intrinsics.unproject(frame.pose, centres, depth[rows, columns])
        points.append(world.astype(np.float32))
        colours.append(rgb[rows, columns])
    return Cloud(np.concatenate(points), np.concatenate(colours))


def read_prediction(submission: str | Path, key: str) -> PredictedPoints:
    """The points that a submission predicts for an observation.

    Raises:
        UsageError: if there is no such folder or it holds no points of the observation.
        Avs3dError: if a file is damaged, or one that `avs3d check` would refuse.
    """
    root = Path(submission)
    if not root.is_dir():
        raise UsageError(f"{root}: no such folder; expected a submission")
    path = root / key / layout.SUBMISSION_POINTS
    if not path.exists():
        raise UsageError(f"{path}: missing; expected a submission with 3D points of {key}")
    points = read_points(path)
    points = points[:: max(1, math.ceil(len(points) / MOST_PREDICTED))]
    about = root / layout.SUBMISSION_JSON
    return PredictedPoints(
        read_record(about, SubmissionRecord).method if about.exists() else root.resolve().name, points
    )
