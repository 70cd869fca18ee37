"""The closed-form binaural renderer: image sources of a box, a diffuse tail, a spherical head. Numpy and scipy only.

- Direct sound and the image sources of the room's box (Allen and Berkley 1979), all of them up to the mixing distance:
  delay r/c by windowed-sinc interpolation, amplitude 1/r, a factor √(1 − α) per reflection and octave.
- From there on the arrivals are too dense to count: Gaussian noise with the power that the image sources would have
  had, 4πc/V per second, decaying with Eyring's time in each octave (Moorer 1979; Lehmann and Johansson 2010).
- Each arrival reaches both ears through `hrtf`: Woodworth's delay, Brown and Duda's head shadow.
- A source with a directivity is as loud in each image as in the direction, mirrored, in which the sound left it; the
  diffuse tail has the mean power of all directions.
- If something is between source and listener, the direct sound is attenuated like behind a thin screen (Maekawa
  1968, 10·lg(3 + 20·N) with the Fresnel number N of a detour of 10 cm).

The box is the room that holds source and listener. If the listener is in another room or between rooms, the box grows
until it holds both rooms (or the point): coarse, but continuous in level and right in direction. The absorption of a
wall is the room's equivalent absorption area (furniture included) over the area of the box.

Responses depend on the pose alone, not on the calls before.

References:
    J. B. Allen, D. A. Berkley, JASA 65 (1979) 943–950. E. A. Lehmann, A. M. Johansson, IEEE TASLP 18 (2010) 1429–1439.
    Z. Maekawa, Applied Acoustics 1 (1968) 157–173.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import eyring
from generators.acoustics import hrtf
from generators.acoustics.base import Place, point_of, pose_of
from generators.acoustics.directivity import Directivity, emission_of
from generators.acoustics.geometry import (
    SPEED_OF_SOUND,
    AcousticMesh,
    acoustic_mesh,
    blocked,
    checked_position,
    checked_scale,
    faces_of_room,
)
from generators.acoustics.materials import DEFAULT_MATERIAL, OCTAVE_BANDS, mean_absorption, triangle_areas
from generators.core.scene import Room, Scene

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

Array = NDArray[np.float64]

#: Half length of the windowed sinc in samples; arrivals nearer than this are cut at time 0.
_SINC_REACH = 16
#: Nothing is louder than at this distance.
NEAREST = 0.1
#: Detour round an obstacle, for Maekawa's screen.
_DETOUR = 0.1
_LONGEST = 3.0
_TAIL_SEED = 0x7A11
_BANDS = np.array(OCTAVE_BANDS)
#: The octaves of a directivity that the materials have.
_OCTAVES = slice(1, 7)


@dataclass(frozen=True)
class Box:
    """A shoebox room.

    Attributes:
        low: lowest corner, metres.
        high: highest corner.
        absorption: energy absorption coefficient of its walls per octave of `OCTAVE_BANDS`.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    absorption: tuple[float, ...]

    @property
    def size(self) -> Array:
        """(3,) metres."""
        return np.array(self.high, dtype=np.float64) - np.array(self.low, dtype=np.float64)

    @property
    def volume(self) -> float:
        """m³."""
        return float(self.size.prod())

    @property
    def surface(self) -> float:
        """m²."""
        x, y, z = self.size
        return float(2 * (x * y + y * z + z * x))

    def reverberation_times(self) -> Array:
        """(6,) Eyring's time per octave in s."""
        alpha = np.clip(self.absorption, 1e-3, 0.999)
        return np.array([eyring(self.volume, self.surface, float(a)) for a in alpha])


def image_sources(box: Box, source: Array, centre: Array, reach: float) -> tuple[Array, NDArray[np.int64]]:
    """Image sources of a box within ``reach`` metres of ``centre``.

    Args:
        box: the room.
        source: (3,) the source, inside the box.
        centre: (3,) usually the listener.
        reach: metres.

    Returns:
        positions (N, 3) and reflections (N,), the source itself (0 reflections) included.
    """
    positions, reflections = _image_lattice(box, source, centre, reach)
    return positions, reflections.sum(axis=1)


def _image_lattice(box: Box, source: Array, centre: Array, reach: float) -> tuple[Array, NDArray[np.int64]]:
    """As `image_sources`, with the reflections (N, 3) by axis."""
    low, size = np.asarray(box.low), box.size
    lines, counts = [], []
    for axis in range(3):
        extent = math.ceil(reach / float(size[axis])) + 2
        m = np.arange(-extent, extent + 1)
        inside = source[axis] - low[axis]
        # Every odd cell is mirrored.
        lines.append(low[axis] + m * size[axis] + np.where(m % 2 == 0, inside, size[axis] - inside))
        counts.append(np.abs(m))
    offset = [np.square(line - c) for line, c in zip(lines, centre, strict=True)]
    distance = offset[0][:, None, None] + offset[1][None, :, None] + offset[2][None, None, :]
    i, j, k = np.nonzero(distance <= reach * reach)
    positions = np.stack([lines[0][i], lines[1][j], lines[2][k]], axis=1)
    return positions, np.stack([counts[0][i], counts[1][j], counts[2][k]], axis=1)


def band_weights(frequencies: Array) -> Array:
    """(6, K) share of each octave at ``frequencies``: raised cosines over the logarithm of frequency that add up to 1.

    The lowest and the highest band reach to 0 Hz and to the Nyquist frequency.
    """
    octave = np.log2(np.maximum(frequencies, 1.0) / _BANDS[0])
    place = np.clip(octave, 0.0, len(_BANDS) - 1.0)
    distance = np.abs(place[None, :] - np.arange(len(_BANDS))[:, None])
    return np.where(distance < 1.0, 0.5 + 0.5 * np.cos(np.pi * distance), 0.0)


def screen_gain() -> Array:
    """(6,) amplitude factor per octave of the direct sound behind an obstacle."""
    fresnel = 2 * _DETOUR * _BANDS / SPEED_OF_SOUND
    return 10 ** (-10 * np.log10(3 + 20 * fresnel) / 20)


class AnalyticBackend:
    """Closed-form impulse responses.

    Args:
        absorption: wall absorption for every room instead of the scene's own, in [0, 1).
        images: image sources up to the mixing time (about).
        tail: whether the diffuse tail follows them.
        absorption_scale: factor of every surface's Eyring exponent, −ln(1 − α).
        seed: of the noise of the tail; None: the same tail in all observations.
    """

    name = "analytic"
    version = "1.0"

    def __init__(
        self,
        *,
        absorption: float | None = None,
        images: int = 2000,
        tail: bool = True,
        absorption_scale: float = 1.0,
        seed: int | None = None,
    ) -> None:
        """Check the numbers.

        Raises:
            Avs3dError: if one is out of range.
        """
        if absorption is not None and not 0.0 <= absorption < 1.0:
            raise Avs3dError(f"analytic acoustics: absorption is {absorption}, expected at least 0 and below 1")
        if not 1 <= images <= 1_000_000:
            raise Avs3dError(f"analytic acoustics: images is {images}, expected 1 to 1000000")
        self.absorption, self.images, self.tail, self.seed = absorption, images, tail, seed
        self.absorption_scale = checked_scale(absorption_scale)

    def open(
        self,
        scene: Scene,
        source: Place,
        *,
        room: str,
        sample_rate: int = 44_100,
        directivity: Directivity | None = None,
    ) -> AnalyticSession:
        """Load ``scene`` with a source at ``source`` (world, metres) standing in ``room``.

        Raises:
            Avs3dError: if the source is not finite or not in the room's box, or the sample rate is out of range.
        """
        if not 8000 <= sample_rate <= 192_000:
            raise Avs3dError(f"{scene.name}: sample rate {sample_rate!r} Hz, expected 8000 to 192000")
        return AnalyticSession(self, scene, source, room, sample_rate, directivity)

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        return {
            "backend": self.name,
            "version": self.version,
            "licence": "Apache-2.0",
            "head_radius_m": hrtf.HEAD_RADIUS,
            "speed_of_sound_m_s": SPEED_OF_SOUND,
            "absorption": self.absorption if self.absorption is not None else "from the scene's materials",
            "image_sources": self.images,
            "diffuse_tail": self.tail,
            **({} if self.absorption_scale == 1 else {"absorption_scale": self.absorption_scale}),
            **({} if self.seed is None else {"seed": self.seed}),
        }


class AnalyticSession:
    """An open scene with one source; see `AcousticSession`. Responses do not depend on the calls before."""

    def __init__(
        self,
        backend: AnalyticBackend,
        scene: Scene,
        source: Place,
        room: str,
        sample_rate: int,
        directivity: Directivity | None = None,
    ) -> None:
        self.sample_rate = sample_rate
        self._directivity = directivity
        self._backend = backend
        self._scene = scene
        self._mesh = acoustic_mesh(scene, point_of(source), absorption_scale=backend.absorption_scale)
        self._triangles = self._mesh.triangles
        self._room = scene.room(room)
        self.move_source(source)
        self._tails: dict[Box, Array] = {}
        self._boxes: dict[tuple[str, ...], Box] = {}

    def move_source(self, source: Place) -> None:
        """Put the source elsewhere, or turn it, for the responses that follow.

        Raises:
            Avs3dError: if the source is not finite or not in the room's box.
        """
        within = _room_bounds(self._room, self._mesh)
        self._source = np.asarray(checked_position(self._scene.name, "source", point_of(source), within))
        self._emission = emission_of(self._directivity, pose_of(source))

    def box_for(self, position: tuple[float, float, float]) -> Box:
        """The box in which the images of the source are heard at ``position``."""
        rooms = [self._room]
        if not _inside(self._room, position):
            rooms += [r for r in self._scene.rooms if r is not self._room and _inside(r, position)][:1]
        key = tuple(r.name for r in rooms)
        if key not in self._boxes:
            self._boxes[key] = _box_of(rooms, self._mesh, self._backend.absorption)
        # A doorway belongs to no room; a source may touch its wall.
        points = np.stack([np.asarray(position, dtype=np.float64), self._source])
        return _grown(self._boxes[key], points)

    def impulse_response(self, pose: Pose) -> NDArray[np.float32]:
        """Binaural room impulse response (2, n) float32, channel 0 left; amplitude 1 at 1 m without a head.

        Raises:
            Avs3dError: if the listener lies outside the scene.
        """
        position = np.asarray(checked_position(self._scene.name, "listener", pose.position, self._mesh.bounds))
        box = self.box_for(pose.position)
        reach = max((3 * box.volume * self._backend.images / (4 * math.pi)) ** (1 / 3), 1.5 * float(box.size.max()))
        images, reflections = _image_lattice(box, self._source, position, reach)
        bounces = reflections.sum(axis=1)
        distance = np.maximum(np.linalg.norm(images - position, axis=1), 1e-9)
        directions = pose.to_camera(images) / distance[:, None]
        gains = np.sqrt(1 - np.clip(box.absorption, 0.0, 1.0))[None, :] ** bounces[:, None]
        gains = gains / np.maximum(distance, NEAREST)[:, None]
        if self._emission is not None:
            # The room's mirrors turn the direction that leaves the image back into that which left the source.
            mirrored = np.where(reflections % 2 == 0, 1.0, -1.0)
            gains = gains * self._emission(mirrored * (position - images) / distance[:, None])[:, _OCTAVES]
        if blocked(self._triangles, position, self._source):
            gains[bounces == 0] *= screen_gain()
        tail = self._tail(box, reach) if self._backend.tail else np.zeros((2, 0))
        reached = math.ceil((reach / SPEED_OF_SOUND + 1e-3) * self.sample_rate) + 2 * _SINC_REACH
        count = max(reached, tail.shape[1])
        ears = [self._ear(ear, distance, directions, gains, count) for ear in (0, 1)]
        response = np.stack(ears)
        response[:, : tail.shape[1]] += tail
        return response.astype(np.float32)

    def close(self) -> None:
        """Nothing to free."""

    def _ear(self, ear: int, distance: Array, directions: Array, gains: Array, count: int) -> Array:
        theta = hrtf.incidence(directions, ear)
        delay = (distance / SPEED_OF_SOUND + hrtf.ear_delay(theta)) * self.sample_rate
        alpha = hrtf.shadow_coefficient(theta)
        start = np.floor(delay).astype(np.int64)
        taps = np.arange(-_SINC_REACH + 1, _SINC_REACH + 1)
        offset = taps[None, :] - (delay - start)[:, None]
        kernel = np.sinc(offset) * np.cos(np.pi * offset / (2 * (_SINC_REACH + 1))) ** 2
        index = start[:, None] + taps[None, :]
        keep = ((index >= 0) & (index < count)).reshape(-1)
        index = index.reshape(-1)[keep]
        length = next_fast_len(count + 512, real=True)
        frequencies = rfftfreq(length, 1 / self.sample_rate)
        low_pass, high_pass = hrtf.shadow_bases(frequencies, self.sample_rate)
        weights = band_weights(frequencies)
        spectrum = np.zeros(len(frequencies), dtype=np.complex128)
        flat = bool(np.ptp(gains, axis=1).max() <= 1e-12)  # one band does for all where absorption is the same in all
        for band in range(1 if flat else len(_BANDS)):
            amplitude = gains[:, band, None] * kernel
            plain = np.bincount(index, amplitude.reshape(-1)[keep], count)
            shaded = np.bincount(index, (alpha[:, None] * amplitude).reshape(-1)[keep], count)
            weight = 1.0 if flat else weights[band]
            spectrum += weight * (low_pass * rfft(plain, length) + high_pass * rfft(shaded, length))
        return np.asarray(irfft(spectrum, length)[:count], dtype=np.float64)

    def _tail(self, box: Box, reach: float) -> Array:
        """(2, n) the diffuse field after the last image source; it is the same for all poses in a box."""
        if box in self._tails:
            return self._tails[box]
        times = box.reverberation_times()
        start = reach / SPEED_OF_SOUND
        # A room that is made more live rings on for longer.
        longest = _LONGEST / min(self._backend.absorption_scale, 1.0)
        seconds = min(max(float(times.max()), start + 0.02), longest)
        count = math.ceil(seconds * self.sample_rate)
        length = next_fast_len(count, real=True)
        frequencies = rfftfreq(length, 1 / self.sample_rate)
        low_pass, high_pass = hrtf.shadow_bases(frequencies, self.sample_rate)
        head = low_pass + hrtf.diffuse_shadow_coefficient() * high_pass
        t = np.arange(count) / self.sample_rate
        # Images arrive at 4πc³t²/V per second with energy 1/(ct)² each: their power does not depend on t.
        level = math.sqrt(4 * math.pi * SPEED_OF_SOUND / (box.volume * self.sample_rate))
        power = np.ones(len(_BANDS)) if self._directivity is None else self._directivity.power[_OCTAVES]
        seed = self._backend.seed
        rng = np.random.default_rng(np.random.SeedSequence(_TAIL_SEED if seed is None else [_TAIL_SEED, seed]))
        out = np.zeros((2, count))
        for ear in (0, 1):
            noise = rfft(rng.standard_normal(length)) * head
            for weight, time in zip(np.sqrt(band_weights(frequencies) * power[:, None]), times, strict=True):
                out[ear] += irfft(noise * weight, length)[:count] * np.exp(-3 * math.log(10) * t / time)
        out *= level
        out[:, t < start] = 0.0
        if len(self._tails) > 8:
            self._tails.clear()
        self._tails[box] = out
        return out


def _inside(room: Room, position: tuple[float, float, float]) -> bool:
    return all(low <= c <= high for low, c, high in zip(room.low, position, room.high, strict=True))


def _room_bounds(room: Room, mesh: AcousticMesh) -> Array:
    """(2, 3) bounds of possible sources: the room's box and all acoustic surfaces."""
    corners = [np.array([room.low, room.high], dtype=np.float64)]
    if mesh.bounds is not None:
        corners.append(mesh.bounds)
    every = np.concatenate(corners)
    return np.stack([every.min(axis=0), every.max(axis=0)])


def _grown(box: Box, points: Array) -> Box:
    low, high = np.minimum(box.low, points.min(axis=0)), np.maximum(box.high, points.max(axis=0))
    if np.all(low == box.low) and np.all(high == box.high):
        return box
    return Box(
        (float(low[0]), float(low[1]), float(low[2])), (float(high[0]), float(high[1]), float(high[2])), box.absorption
    )


def _box_of(rooms: list[Room], mesh: AcousticMesh, absorption: float | None) -> Box:
    scale = mesh.absorption_scale
    low = np.min([r.low for r in rooms], axis=0)
    high = np.max([r.high for r in rooms], axis=0)
    if absorption is not None:
        alpha = np.full(len(_BANDS), 1 - (1 - absorption) ** scale)
    else:
        found = [faces_of_room(mesh, room) for room in rooms]
        triangles = np.concatenate([t for t, _ in found])
        labels = tuple(label for _, part in found for label in part)
        area = float(triangle_areas(triangles).sum()) if len(triangles) else 0.0
        alpha = np.array(DEFAULT_MATERIAL.scaled(scale).in_situ)
        if area > 0:
            hull = Box((low[0], low[1], low[2]), (high[0], high[1], high[2]), ()).surface
            # Furniture adds its area; a missing wall (an opening) absorbs sound.
            covered = min(area / hull, 1.0)
            alpha = mean_absorption(triangles, labels, scale) * area / hull + 0.5 * (1 - covered)
        alpha = np.clip(alpha, 0.005 * min(scale, 1.0), 0.95)
    return Box(
        (float(low[0]), float(low[1]), float(low[2])),
        (float(high[0]), float(high[1]), float(high[2])),
        tuple(float(a) for a in alpha),
    )
