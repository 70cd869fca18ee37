"""Where a source or a listener is over time: a point, a pose, or a path of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError, excerpt
from avs3d_bench.geometry import Pose as Pose

F64 = NDArray[np.float64]

_EXPECTED = "expected (x, y, z) in metres, a Pose, or a path [(seconds, point or Pose), …]"


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Positions and rotations at some times; between them positions are linear and rotations the shortest turn.

    Attributes:
        times: (k,) s, ascending.
        positions: (k, 3) metres.
        rotations: (k, 4) unit quaternions (w, x, y, z).
    """

    times: F64
    positions: F64
    rotations: F64

    @property
    def moves(self) -> bool:
        """Whether the position changes."""
        return bool(np.ptp(self.positions, axis=0).any())

    @property
    def turns(self) -> bool:
        """Whether the rotation changes."""
        return bool(np.ptp(self.rotations, axis=0).any())

    def position_at(self, seconds: F64) -> F64:
        """(n, 3) metres at ``seconds`` (n,); before the first time as then, and after the last."""
        return np.stack([np.interp(seconds, self.times, axis) for axis in self.positions.T], axis=-1)

    def pose_at(self, seconds: float) -> Pose:
        """The pose at a time."""
        x, y, z = (float(c) for c in self.position_at(np.array([seconds]))[0])
        if not self.turns:
            a, b, c, d = (float(value) for value in self.rotations[0])
            return Pose((x, y, z), (a, b, c, d))
        from scipy.spatial.transform import Rotation, Slerp

        turn = Slerp(self.times, Rotation.from_quat(self.rotations[:, [1, 2, 3, 0]]))
        b, c, d, a = (float(v) for v in turn(np.clip(seconds, self.times[0], self.times[-1])).as_quat())
        return Pose((x, y, z), (a, b, c, d))

    def knots(self, seconds: float, step: float, turn: float | None = None) -> F64:
        """Times (k,) from 0 to ``seconds``, between which it moves by ``step`` metres (and ``turn`` radians) at most.

        One knot, at 0, for what stays where it is.
        """
        if not self.moves and not (self.turns and turn):
            return np.zeros(1)
        times = np.unique(np.concatenate([[0.0, seconds], self.times[(self.times > 0) & (self.times < seconds)]]))
        way = np.linalg.norm(np.diff(self.position_at(times), axis=0), axis=1) / step
        if turn:
            poses = [self.pose_at(t) for t in times]
            rotations = np.array([pose.rotation for pose in poses])
            cosine = np.abs(np.einsum("ij,ij->i", rotations[1:], rotations[:-1]))
            way = np.maximum(way, 2 * np.arccos(np.clip(cosine, 0.0, 1.0)) / turn)
        # Even along the way: vertices of the path that are nearer to each other than a step are no knots.
        along = np.concatenate([[0.0], np.cumsum(way)])
        count = max(int(np.ceil(along[-1])), 1)
        keep = np.concatenate([[True], np.diff(along) > 0])
        return np.asarray(np.interp(np.linspace(0.0, along[-1], count + 1), along[keep], times[keep]))


def as_pose(value: Any, what: str = "listener") -> Pose:
    """A point or a pose as a pose; a point faces −Z.

    Raises:
        UsageError: one line, if it is neither.
    """
    if isinstance(value, Pose):
        return value
    try:
        point = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,):
        raise UsageError(f"{what}: {excerpt(value)}; {_EXPECTED}")
    if not np.isfinite(point).all():
        raise UsageError(f"{what}: {excerpt(value)} is NaN or infinite; {_EXPECTED}")
    x, y, z = (float(c) for c in point)
    return Pose((x, y, z), (1.0, 0.0, 0.0, 0.0))


def is_path(value: Any) -> bool:
    """Whether a value is a path, and not a point or a pose."""
    if isinstance(value, Pose | str) or not isinstance(value, Sequence) or not len(value):
        return False
    return all(isinstance(entry, Sequence) and len(entry) == 2 and not isinstance(entry, str) for entry in value)


def as_track(value: Any, what: str) -> PoseTrack:
    """A point, a pose or a path as a track.

    Raises:
        UsageError: one line: times that do not ascend, NaN, another form.
    """
    if not is_path(value):
        pose = as_pose(value, what)
        return PoseTrack(np.zeros(1), np.array([pose.position]), np.array([pose.rotation]))
    poses = [as_pose(entry[1], f"{what}, entry {number} of its path") for number, entry in enumerate(value)]
    try:
        times = np.array([float(entry[0]) for entry in value])
    except (TypeError, ValueError):
        raise UsageError(f"{what}: a time of its path is no number; {_EXPECTED}") from None
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise UsageError(f"{what}: the times of its path must be finite and ascend, found {excerpt(times.tolist())}")
    rotations = np.array([pose.rotation for pose in poses])
    return PoseTrack(times, np.array([pose.position for pose in poses]), rotations)
