"""The agent's gaze: smooth turns that bring each candidate into view, out of view, and into view from the other side.

A candidate is any placed object: the gaze must not reveal which of them sounds, so all are treated alike. A gaze is
drawn in phases. In each phase the head keeps one candidate at a wanted azimuth, inside or outside the image. The
candidate and the azimuth are chosen among random options such that all candidates get similar numbers of frames in
view, on the left and on the right. The head follows at a limited rate. Many gazes are drawn at once; `penalty` ranks
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Limits of one planned step (degrees); their sum is below the 30° per step that the dataset's format allows.
YAW_RATE, PITCH_RATE = 25.0, 10.0
#: Largest tilt of the camera (degrees).
MOST_PITCH = 25.0
#: Share of frames in which each candidate is in view: the range aimed at, and the range without a note.
VIEW_WANTED, VIEW_ALLOWED = (0.28, 0.62), (0.20, 0.70)
#: Azimuth (degrees) from which a candidate is clearly on one side, and the wanted share of such frames per side.
SIDE_AZIMUTH, SIDE_SHARE = 20.0, 0.20
#: Wanted numbers of test frames (index % 8 == 0) with and without each candidate, and the number of test frames.
FILLED_TESTS, EMPTY_TESTS, TEST_FRAMES = 3, 3, 15
#: An object's middle counts as inside the image if it is within this share of the image's half width.
INSIDE = 0.97
#: Least share of an object's surface samples that must be in sight (about half of them face away from any viewer).
SEEN_SHARE = 0.06
#: Number of gazes with the same phase lengths, and number of options per gaze and phase.
_BATCH, _OPTIONS = 16, 12
#: Shares of frames in view, and on each side, that the choice of phases aims at.
_AIM_VIEW, _AIM_SIDE = 0.45, 0.30
#: Penalty per missing share of frames: below the wanted range; below the allowed range (large enough to outweigh all
#: other terms); and per missing test frame.
_WANTED_COST, _ALLOWED_COST, _TEST_COST = 5, 50, 1
#: The wanted share of frames on each side is this much above the least allowed share.
_SIDE_RESERVE = 0.05
#: Number of sectors of heading in which the gaze should see the room.
_SECTORS = 12
#: While phases are chosen, a candidate counts as in view within this share of half the field of view, so that its
#: middle stays inside the image in spite of the wobble.
_IN_VIEW = 0.93
#: Length of a phase (frames) in a walk of at least `_FULL_WALK` frames. In a shorter walk the phases shrink in
#: proportion, but not below `_LEAST_PACE` of this length, nor below `_LEAST_PHASE` frames. Each gaze draws a factor
#: from `_PACES`.
_PHASE, _FULL_WALK, _LEAST_PACE, _LEAST_PHASE, _PACES = (5, 14), 60.0, 0.4, 2, (0.8, 1.25)
#: Range of log10 of the noise that is added to an option's cost, so that gazes differ. The cost is a squared share of
#: frames.
_PATIENCE = (-4.5, -2.5)
#: Share of the remaining turn that the head makes in one frame, so that turns end slowly.
_EASE = 0.6
#: Share of phases that keep a candidate in view; the others keep it out of view.
_LOOKED = 0.6
#: Azimuth (degrees) at the start of a phase in view: off centre, so that its frames also count for their side. The
#: azimuth at the end is between −`_END` and `_END`.
_BEGIN, _END = (20, 34), 30
#: Azimuth (degrees) in a phase out of view.
_AWAY = (60, 150)
#: Amplitude (degrees) of the head's wobble, and its period divided by 2π (frames).
_WOBBLE, _WOBBLE_PERIOD = 3.0, (1.5, 3.5)
#: The camera tilts towards candidates below this azimuth (degrees), and fully `_FACING_WIDTH` degrees further in. Of
#: several candidates, those within about `_NEAREST` degrees have the largest weights.
_FACING, _FACING_WIDTH, _NEAREST = 85.0, 30.0, 15.0
#: Tilt (degrees) if no candidate is ahead: slightly downwards in most cases.
_REST_PITCH = (-8.0, 2.0)
#: Tilt as a share of a candidate's elevation, and the share of the remaining tilt that is made in one frame.
_TILT, _TILT_EASE = 0.85, 0.5


@dataclass(frozen=True, eq=False)
class Sight:
    """Visibility of one candidate from each position of a path.

    Attributes:
        eyes: (n, 3) positions of the camera, metres.
        centre: (3,) middle of the object, metres; (n, 3) if it moves: one at the time of each position.
        source: (3,) or (n, 3) position of its sound source, if it sounded.
        points: (S, 3) or (n, S, 3) samples of its surface.
        clear: (n, S) bool, whether nothing is between the eye and the sample.
        extent: tangent of half the field of view.
    """

    eyes: Array
    centre: Array
    source: Array
    points: Array
    clear: Mask
    extent: float = 1.0

    @property
    def bearing(self) -> Array:
        """(n,) yaw at which the camera faces the candidate, radians, unwrapped."""
        delta = self.source - self.eyes
        return np.unwrap(np.arctan2(-delta[:, 0], -delta[:, 2]))

    @property
    def elevation(self) -> Array:
        """(n,) elevation of the object's middle, radians."""
        delta = self.centre - self.eyes
        return np.arctan2(delta[:, 1], np.hypot(delta[:, 0], delta[:, 2]))

    @property
    def visible(self) -> Mask:
        """(n,) whether enough of its surface is in sight for a camera that is turned to it."""
        return np.asarray(self.clear.mean(axis=1) >= SEEN_SHARE)

    def in_camera(self, points: Array, yaw: Array, pitch: Array) -> tuple[Array, Array, Array]:
        """Transform points (S, 3), or (n, S, 3) if they move, to the camera of gazes yaw, pitch (P, n).

        Returns:
            metres to the right, up and ahead, (P, n, S) each.
        """
        delta = (points if points.ndim == 3 else points[None]) - self.eyes[:, None]
        sin, cos = np.sin(yaw)[..., None], np.cos(yaw)[..., None]
        right = cos * delta[..., 0] - sin * delta[..., 2]
        level = -sin * delta[..., 0] - cos * delta[..., 2]
        sin, cos = np.sin(pitch)[..., None], np.cos(pitch)[..., None]
        return right, cos * delta[..., 1] - sin * level, cos * level + sin * delta[..., 1]

    def in_image(self, points: Array, yaw: Array, pitch: Array, margin: float = 1.0) -> Mask:
        """(P, n, S) whether points (S, 3) or (n, S, 3) are inside the images of gazes yaw, pitch (P, n)."""
        right, up, ahead = self.in_camera(points, yaw, pitch)
        reach = np.maximum(ahead, 1e-9) * self.extent * margin
        return np.asarray((ahead > 0.05) & (np.abs(right) <= reach) & (np.abs(up) <= reach))


@dataclass(frozen=True, eq=False)
class Views:
    """Views of one candidate in P gazes over n frames.

    Attributes:
        azimuth: (P, n) azimuth of its source in the frame of the tilted head, degrees, as in observation.json.
        looking: (P, n) bool, whether its middle is inside the image and its surface in sight.
        filled: (P, n) bool, whether any part of it is in the image.
    """

    azimuth: Array
    looking: Mask
    filled: Mask

    @classmethod
    def of(cls, sight: Sight, yaw: Array, pitch: Array) -> Views:
        """Evaluate gazes yaw, pitch (P, n) in radians."""
        right, _, ahead = sight.in_camera(sight.source[..., None, :], yaw, pitch)
        azimuth = np.degrees(np.arctan2(right, ahead))[..., 0]
        seen = sight.in_image(sight.points, yaw, pitch) & sight.clear
        enough = seen.sum(axis=-1) >= max(1.0, SEEN_SHARE * len(sight.points))
        centred = sight.in_image(sight.centre[..., None, :], yaw, pitch, INSIDE)[..., 0]
        return cls(azimuth, np.asarray(enough & centred), np.asarray(seen.any(axis=-1)))

    @property
    def look_share(self) -> Array:
        """(P,) share of frames in which it is looked at."""
        return np.asarray(self.looking.mean(axis=1))

    @property
    def view_share(self) -> Array:
        """(P,) share of frames with any part of it in the image."""
        return np.asarray(self.filled.mean(axis=1))

    @property
    def right_share(self) -> Array:
        """(P,) share of frames in which it is clearly on the right."""
        return np.asarray((self.azimuth >= SIDE_AZIMUTH).mean(axis=1))

    @property
    def left_share(self) -> Array:
        """(P,) share of frames in which it is clearly on the left."""
        return np.asarray((self.azimuth <= -SIDE_AZIMUTH).mean(axis=1))

    @property
    def tests(self) -> tuple[Array, Array]:
        """(P,) numbers of test frames with and without it."""
        test = self.filled[:, ::8]
        return test.sum(axis=1).astype(float), (~test).sum(axis=1).astype(float)

    def shortfall(self) -> Array:
        """(P,) penalty of each gaze for missing the wanted shares of this candidate; 0 is perfect."""
        look, view = self.look_share, self.view_share
        filled, empty = self.tests
        scale = min(1.0, self.filled[:, ::8].shape[1] / TEST_FRAMES)

        def short(value: Array, wanted: float) -> Array:
            return np.maximum(wanted - value, 0.0)

        out = _WANTED_COST * (short(look, VIEW_WANTED[0]) + short(-view, -VIEW_WANTED[1]))
        out += _ALLOWED_COST * (short(look, VIEW_ALLOWED[0]) + short(-view, -VIEW_ALLOWED[1]))
        for share in (self.left_share, self.right_share):
            out += _WANTED_COST * short(share, SIDE_SHARE + _SIDE_RESERVE) + _ALLOWED_COST * short(share, SIDE_SHARE)
        out += _TEST_COST * short(empty, np.floor(EMPTY_TESTS * scale))
        out += _TEST_COST * short(filled, np.ceil(FILLED_TESTS * scale))
        return np.asarray(out)


def penalty(views: Sequence[Views], yaw: Array) -> Array:
    """(P,) penalty of each gaze, symmetric in the candidates; 0 is perfect."""
    each = np.stack([view.shortfall() for view in views])
    # The gaze should see the room in all directions.
    sectors = np.floor((yaw % (2 * np.pi)) / (2 * np.pi / _SECTORS)).astype(int) % _SECTORS
    seen = np.stack([(sectors == k).any(axis=1) for k in range(_SECTORS)]).mean(axis=0)
    return np.asarray(each.max(axis=0) + each.mean(axis=0) + 1.0 - seen)


def draw_gazes(sights: Sequence[Sight], count: int, rng: Generator) -> tuple[Array, Array]:
    """Draw ``count`` gazes along the path of ``sights`` (one per candidate): yaw and pitch (count, n), radians."""
    extent = float(np.arctan(sights[0].extent))
    around = _Around(
        np.stack([sight.bearing for sight in sights], axis=1),
        np.stack([sight.visible for sight in sights], axis=1),
        _IN_VIEW * extent,
    )
    yaw = np.concatenate([_draw_yaw(around, min(_BATCH, count - k), rng) for k in range(0, count, _BATCH)])
    elevation = np.stack([sight.elevation for sight in sights], axis=1)
    return yaw, _pitch(around, elevation, yaw, rng)


@dataclass(frozen=True, eq=False)
class _Around:
    """The candidates relative to the head: bearing (n, K), visible (n, K), and half the field of view, radians."""

    bearing: Array
    visible: Mask
    half: float

    def azimuth(self, yaw: Array, frame: int) -> Array:
        """(…, K) azimuth of each candidate at one frame for yaws (…), radians, positive to the right."""
        return _wrapped(yaw[..., None] - self.bearing[frame])


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def _draw_yaw(around: _Around, count: int, rng: Generator) -> Array:
    """(count, n) headings, radians, drawn phase by phase."""
    n, candidates = around.bearing.shape
    pace = float(np.clip(n / _FULL_WALK, _LEAST_PACE, 1.0)) * rng.uniform(*_PACES)
    patience = 10 ** rng.uniform(*_PATIENCE, size=(count, 1))
    side_from = np.radians(SIDE_AZIMUTH)
    had = np.zeros((3, count, candidates))  # frames in view, clearly left, clearly right
    yaw = np.zeros((count, n))
    current: Array | None = None
    i, rows = 0, np.arange(count)
    while i < n:
        length = min(max(_LEAST_PHASE, round(rng.uniform(*_PHASE) * pace)), n - i)
        target = rng.integers(candidates, size=(count, _OPTIONS))
        wanted = np.radians(_wanted_azimuth(count, length, rng))
        head = np.empty((count, _OPTIONS, length))
        got = np.zeros((3, count, _OPTIONS, candidates))
        at = np.empty(0) if current is None else np.repeat(current[:, None], _OPTIONS, axis=1)
        for step in range(length):
            bearing = around.bearing[i + step][target]
            if current is None and step == 0:
                at = bearing + wanted[..., 0]
            else:
                # What the target's bearing moves by is followed at once.
                drift = bearing - around.bearing[i + step - 1][target]
                error = _wrapped(bearing + wanted[..., step] - at - drift)
                at = at + np.clip(drift + _EASE * error, -np.radians(YAW_RATE), np.radians(YAW_RATE))
            head[..., step] = at
            azimuth = around.azimuth(at, i + step)
            got[0] += (np.abs(azimuth) < around.half) & around.visible[i + step]
            got[1] += azimuth <= -side_from
            got[2] += azimuth >= side_from
        total = had[:, :, None] + got
        done = i + length
        off = (total[0] - _AIM_VIEW * done) / n
        cost = (off**2 + np.minimum(total[1:] - _AIM_SIDE * done, 0.0).sum(axis=0) ** 2 / n**2).sum(axis=-1)
        chosen = np.argmin(cost + patience * rng.uniform(size=cost.shape), axis=1)
        had = total[:, rows, chosen]
        yaw[:, i:done] = head[rows, chosen]
        current = yaw[:, done - 1]
        i = done
    return yaw


def _wanted_azimuth(count: int, length: int, rng: Generator) -> Array:
    """(count, options, length) azimuths at which a candidate is kept, degrees: in view, off centre, or out of view."""
    shape = (count, _OPTIONS, 1)
    side = np.where(rng.uniform(size=shape) < 0.5, -1.0, 1.0)
    near = rng.uniform(*_BEGIN, size=shape)
    looked = near + (rng.uniform(-_END, _END, size=shape) - near) * np.linspace(0, 1, length) ** 2
    away = rng.uniform(*_AWAY, size=shape) + np.zeros(length)
    phase = rng.uniform(0, 2 * np.pi, size=shape)
    wobble = _WOBBLE * np.sin(phase + np.arange(length) / rng.uniform(*_WOBBLE_PERIOD, size=shape))
    return np.asarray(side * np.where(rng.uniform(size=shape) < _LOOKED, looked, away) + wobble)


def _pitch(around: _Around, elevation: Array, yaw: Array, rng: Generator) -> Array:
    """(count, n) slow tilt towards the candidates ahead (elevations (n, K)); slightly downwards if there is none."""
    count, n = yaw.shape
    azimuth = np.abs(_wrapped(yaw[..., None] - around.bearing))
    facing = np.clip((np.radians(_FACING) - azimuth) / np.radians(_FACING_WIDTH), 0.0, 1.0) * around.visible
    weight = facing * np.exp(-azimuth / np.radians(_NEAREST))
    aim = (weight * elevation).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-12)
    share = facing.max(axis=-1)
    rest = np.radians(rng.uniform(*_REST_PITCH, size=(count, 1)))
    most, nod = np.radians(MOST_PITCH), np.radians(PITCH_RATE)
    tilt = np.clip(share * _TILT * aim + (1 - share) * rest, -most, most)
    pitch = np.empty((count, n))
    pitch[:, 0] = tilt[:, 0]
    for i in range(1, n):
        pitch[:, i] = pitch[:, i - 1] + np.clip(_TILT_EASE * (tilt[:, i] - pitch[:, i - 1]), -nod, nod)
    return pitch
