"""Where the agent looks: smooth turns that find the source, lose it, and find it again on the other side.

A gaze is planned in the source's azimuth, which is what hearing and seeing depend on: phases that hold the source in
view, off centre to one side, alternate with phases that look away to that side. The head then follows with a limited
rate. Many plans are drawn at once; `Score` says which is best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Limits of one step of the plan, degrees; together they stay below the contract's 30° a step.
YAW_RATE, PITCH_RATE = 25.0, 10.0
#: The camera tilts at most this far, degrees.
MOST_PITCH = 25.0
#: What a walk should have: share of frames that look at the source, and share with it clearly on either side.
LOOK_WANTED, LOOK_ALLOWED = (0.50, 0.70), (0.40, 0.80)
SIDE_AZIMUTH, SIDE_SHARE = 20.0, 0.20
#: Test frames (index % 8 == 0) of 15 with an empty and with a filled mask.
EMPTY_TESTS, FILLED_TESTS, TEST_FRAMES = 2, 6, 15
#: The source's centre counts as inside the image within this share of its half width.
INSIDE = 0.97
#: At least this share of the source's surface samples must be in sight (half of them face away from any viewer).
SEEN_SHARE = 0.06


@dataclass(frozen=True, eq=False)
class Sight:
    """What can be seen of the source from each position of a path.

    Attributes:
        eyes: (n, 3) positions.
        centre: (3,) middle of the source object; (n, 3) of one that moves, at each position's time.
        source: (3,) or (n, 3) where the sound comes from.
        points: (S, 3) or (n, S, 3) samples of its surface.
        clear: (n, S) bool, nothing stands between the eye and the sample.
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
        """(n,) yaw at which the camera faces the source, radians, without jumps."""
        delta = self.source - self.eyes
        return np.unwrap(np.arctan2(-delta[:, 0], -delta[:, 2]))

    @property
    def elevation(self) -> Array:
        """(n,) elevation of the object's middle, radians."""
        delta = self.centre - self.eyes
        return np.arctan2(delta[:, 1], np.hypot(delta[:, 0], delta[:, 2]))

    def in_camera(self, points: Array, yaw: Array, pitch: Array) -> tuple[Array, Array, Array]:
        """Points (S, 3), or (n, S, 3) if they move, as gazes yaw, pitch (P, n) have them.

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
        """(P, n, S) whether points (S, 3) or (n, S, 3) fall inside the images of gazes yaw, pitch (P, n)."""
        right, up, ahead = self.in_camera(points, yaw, pitch)
        reach = np.maximum(ahead, 1e-9) * self.extent * margin
        return np.asarray((ahead > 0.05) & (np.abs(right) <= reach) & (np.abs(up) <= reach))


@dataclass(frozen=True, eq=False)
class Views:
    """What P gazes over n frames show.

    Attributes:
        azimuth: (P, n) of the source in the tilted head's own frame, degrees, as observation.json records it.
        looking: (P, n) the source is looked at: its middle is inside the image and its surface in sight.
        filled: (P, n) something of it is in the image.
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
        """(P,) share of frames that look at the source."""
        return np.asarray(self.looking.mean(axis=1))

    @property
    def right_share(self) -> Array:
        """(P,) share of frames with the source clearly to the right."""
        return np.asarray((self.azimuth >= SIDE_AZIMUTH).mean(axis=1))

    @property
    def left_share(self) -> Array:
        """(P,) share of frames with the source clearly to the left."""
        return np.asarray((self.azimuth <= -SIDE_AZIMUTH).mean(axis=1))

    @property
    def tests(self) -> tuple[Array, Array]:
        """(P,) numbers of test frames with a filled and with an empty mask."""
        test = self.filled[:, ::8]
        return test.sum(axis=1).astype(float), (~test).sum(axis=1).astype(float)

    def penalty(self, yaw: Array) -> Array:
        """(P,) how far each gaze is from what is wanted; 0 is perfect."""
        look, left, right = self.look_share, self.left_share, self.right_share
        filled, empty = self.tests
        scale = min(1.0, self.filled[:, ::8].shape[1] / TEST_FRAMES)

        def short(value: Array, wanted: float) -> Array:
            return np.maximum(wanted - value, 0.0)

        out = 5 * (short(look, LOOK_WANTED[0]) + short(-look, -LOOK_WANTED[1]))
        out += 50 * (short(look, LOOK_ALLOWED[0]) + short(-look, -LOOK_ALLOWED[1]))
        for share in (left, right):
            out += 5 * short(share, SIDE_SHARE + 0.08) + 50 * short(share, SIDE_SHARE)
        out += 2 * short(empty, np.floor(EMPTY_TESTS * scale)) + 0.5 * short(empty, np.round(4 * scale))
        out += 2 * short(filled, np.ceil(FILLED_TESTS * scale))
        # The room is to be seen all round: 12 sectors of heading.
        sectors = np.floor((yaw % (2 * np.pi)) / (np.pi / 6)).astype(int) % 12
        seen = np.stack([(sectors == k).any(axis=1) for k in range(12)]).mean(axis=0)
        return np.asarray(out + 1.0 - seen)


def draw_gazes(sight: Sight, count: int, rng: Generator) -> tuple[Array, Array]:
    """Draw ``count`` gazes along the path of ``sight``: yaw and pitch (count, n), radians."""
    n = len(sight.eyes)
    azimuth = np.radians(np.stack([_azimuth_plan(n, rng) for _ in range(count)]))
    bearing, elevation = sight.bearing, sight.elevation
    most = np.radians(MOST_PITCH)
    rest = np.radians(rng.uniform(-8.0, 2.0, size=(count, 1)))
    facing = np.clip((np.radians(85.0) - np.abs(azimuth)) / np.radians(30.0), 0.0, 1.0)
    tilt = np.clip(facing * 0.85 * elevation + (1 - facing) * rest, -most, most)
    yaw, pitch = np.empty((count, n)), np.empty((count, n))
    yaw[:, 0], pitch[:, 0] = bearing[0] + azimuth[:, 0], tilt[:, 0]
    fast, nod = np.radians(YAW_RATE), np.radians(PITCH_RATE)
    for i in range(1, n):
        # The head eases into a turn's end; what the source's bearing moves by is followed at once.
        drift = bearing[i] - bearing[i - 1]
        error = bearing[i] + azimuth[:, i] - yaw[:, i - 1] - drift
        yaw[:, i] = yaw[:, i - 1] + np.clip(drift + 0.6 * error, -fast, fast)
        pitch[:, i] = pitch[:, i - 1] + np.clip(0.5 * (tilt[:, i] - pitch[:, i - 1]), -nod, nod)
    return yaw, pitch


def _azimuth_plan(n: int, rng: Generator) -> Array:
    """(n,) wanted azimuth of the source, degrees: held in view on one side, lost on that side, then the other side."""
    out = np.zeros(n)
    pace = float(np.clip(n / 60.0, 0.4, 1.0)) * rng.uniform(0.8, 1.25)
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    i = 0
    if rng.uniform() < 0.35:
        i = round(rng.uniform(2, 6) * pace)
        out[:i] = side * rng.uniform(60, 120)
    while i < n:
        look = max(2, round(rng.uniform(9, 17) * pace))
        away = max(2, round(rng.uniform(6, 11) * pace))
        # Off centre, so that these frames count for their side too, then through the middle.
        off = rng.uniform(22, 34)
        half = round(look * rng.uniform(0.5, 0.9))
        out[i : i + half] = side * off
        out[i + half : i + look] = side * rng.uniform(0, off)
        i += look
        out[i : i + away] = side * rng.uniform(65, 150)
        i += away
        side = -side if rng.uniform() < 0.85 else side
    phase, period = rng.uniform(0, 2 * np.pi), rng.uniform(9, 23)
    return np.asarray(out + 3.0 * np.sin(2 * np.pi * np.arange(n) / period + phase))
