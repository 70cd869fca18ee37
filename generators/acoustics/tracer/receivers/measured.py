"""Two ears of a measured head: any SOFA file of head-related impulse responses.

All arrivals, early and late, are heard with the response of their own direction. From the measurement are taken, once
for every sample rate:

1. the delay of each response: the lag of its maximum correlation with its own minimum-phase version (Nam, Abel and
   Smith, AES convention paper 7612, 2008), near that of a sphere;
2. the principal components of the responses without their delays (`basis`);
3. delays and component weights on a grid of directions, interpolated between the nearest three measurements.

The measurement's gain and time zero are arbitrary. They are set so that the diffuse-field level in the 500 Hz and 1 kHz
octaves and the mean delay of both ears over all directions are those of the rigid sphere of `spherical`: levels and
distances do not depend on the file. Frequencies below the measurement's range stay as they were measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import CZT

from avs3d_bench.errors import Avs3dError
from avs3d_bench.text.printable import readable
from generators.acoustics import hrtf
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.device.ears import GRID, Ears
from generators.acoustics.tracer.receivers.basis import Components, DirectionalBasis, directional_basis
from generators.acoustics.tracer.receivers.near_field import NearField
from generators.acoustics.tracer.receivers.sofa import HrirSet, read_hrirs
from generators.acoustics.tracer.receivers.sphere import sphere_coefficients
from generators.acoustics.tracer.receivers.sphere_mesh import SphereMesh
from generators.acoustics.tracer.receivers.synthesis import (
    ReceiverPort,
    checked,
    grids_of_length,
    response_length,
    synthesise,
)
from generators.core.blas import one_blas_thread

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
C128 = NDArray[np.complex128]

#: Step of the grid of directions (degrees of azimuth and elevation). The nearest of them is used.
STEP = 2
_AZIMUTHS, _ELEVATIONS = 360 // STEP, 180 // STEP + 1
#: 6 %, which is near the repeatability of a measurement; up to the limit, which an octave with the notches of the pinna
#: needs. With KEMAR the third-octave levels of single directions are then off by 0.2 dB in the mean above 1 kHz;
#: ambisonics of order 3 with a magnitude-least-squares decoder (Schörkhuber, Zaunschirm, Höldrich, DAGA 2018) have as
#: many channels and 1.4 dB (measured on the 710 directions of the MIT data).
_COMPONENTS = Components(accuracy=0.06, timing=1e-5, most=16)
#: Largest deviation of a measured delay from the sphere's (s): heads differ by less; echoes of a set-up come later.
_MOST_DEVIATION = 0.0004
#: Distance of the ears in `plane_delay`, in head radii: between the 1.5 of low frequencies and the 1.3 of high ones.
PLANE_WIDTH = 1.4
#: Band of the level that is set to the sphere's (Hz).
_LEVEL_BAND = (353.6, 1414.2)
#: Time before and after the responses that the table's spectra resolve (s).
_MARGIN = 0.006
#: Start of the roll-off at the file's own Nyquist frequency, if that is the lower one, as a fraction of it.
_ROLL_OFF = 0.92
#: Measurements whose delays are found at once: bounds the memory.
_CHUNK = 1024
#: Least magnitude for the cepstrum, relative to the largest (−100 dB).
_FLOOR = 1e-5


@dataclass(frozen=True, eq=False)
class _Table:
    """The grid of directions.

    Attributes:
        residual: (2, K) s, delays at both ears beyond `plane_delay`.
        basis: its rows are those of the left ear, then of the right.
    """

    residual: F64
    basis: DirectionalBasis


class HrirHead:
    """The head that a set of responses describes, at any sample rate.

    Args:
        hrirs: the responses.
        where: what they come from, for messages.
        near: what near sources add; None: responses of all distances are those of the set.

    Raises:
        Avs3dError: one line; see `SphereMesh.of`.
    """

    channels = 2
    channel_names = ("left", "right")

    def __init__(self, hrirs: HrirSet, where: object, near: NearField | None = None) -> None:
        self._hrirs, self._near = hrirs, near
        self._mesh = SphereMesh.of(hrirs.directions, where)
        self._calibration = _calibrated(hrirs, self._mesh, where)
        self._tables: dict[int, _Table] = {}

    @property
    def hrirs(self) -> HrirSet:
        """The responses of the file."""
        return self._hrirs

    def response(self, arrivals: Arrivals, rotation: NDArray[np.float64], sample_rate: int) -> NDArray[np.float32]:
        """Binaural response (2, m) float32, channel 0 is left; see `Receiver`."""
        directions = checked(arrivals, rotation, sample_rate)
        table = self._table(sample_rate)
        samples = response_length(arrivals, sample_rate, _reach())
        grids = grids_of_length(samples, sample_rate)
        filters = table.basis.filters(grids)
        ears = []
        for ear in (0, 1):
            heard, towards = arrivals, directions
            if self._near is not None:
                heard, towards = self._near.heard(arrivals, directions, ear)
            nodes = nearest_node(towards)
            delay = plane_delay(towards, ear) + table.residual[ear, nodes]
            index = nodes + np.int32(ear * table.residual.shape[1])
            port = ReceiverPort(delay, index, table.basis.rows, table.basis.columns, filters)
            ears.append(synthesise(heard, [port], grids, samples))
        return np.concatenate(ears)

    def ears(self, sample_rate: int) -> Ears:
        """See `BinauralReceiver`."""
        table = self._table(sample_rate)
        return Ears(GRID, table.basis, table.residual.shape[1], table.residual, _reach(), self._near)

    def _table(self, sample_rate: int) -> _Table:
        if sample_rate not in self._tables:
            self._tables[sample_rate] = self._make_table(sample_rate)
        return self._tables[sample_rate]

    def _make_table(self, sample_rate: int) -> _Table:
        hrirs = self._hrirs
        spectra = _aligned_spectra(hrirs, self._calibration, sample_rate)
        angles = np.tile(self._mesh.solid_angles(), 2)
        measured = directional_basis(spectra, angles, sample_rate, _COMPONENTS)
        corners, weights = self._mesh.interpolation(grid_directions())
        plane = np.stack([plane_delay(hrirs.directions, ear) for ear in (0, 1)], axis=1)
        residual = self._calibration.delays - plane
        count = len(hrirs.directions)
        ears = [
            _interpolated(measured.rows[ear * count : (ear + 1) * count], measured, corners, weights) for ear in (0, 1)
        ]
        basis = DirectionalBasis(
            sample_rate, np.concatenate(ears), measured.columns, measured.impulses, measured.error_db
        )
        return _Table(np.einsum("kc,kce->ek", weights, residual[corners]), basis)


class SofaHead(HrirHead):
    """The head of a SOFA file (SimpleFreeFieldHRIR), at any sample rate.

    Args:
        path: of the file.

    Raises:
        Avs3dError: one line; see `read_hrirs` and `SphereMesh.of`.

    Examples:
        >>> head = SofaHead("head.sofa")
        >>> head.channel_names, head.describe()["hrtf_directions"]
        (('left', 'right'), 64)
        >>> room = Room.shoebox((6, 2.7, 4), "plaster")
        >>> rir = Tracer(seed=1).response(room, source=(1, 1.5, 2), listener=(4, 1.5, 2), receiver=head)
        >>> rir.samples.shape[0], rir.samples.dtype.name
        (2, 'float32')
    """

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        super().__init__(read_hrirs(path), path)

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        hrirs = self._hrirs
        return {
            "receiver": "binaural",
            "head": hrirs.name,
            "hrtf_file": readable(self._path.name),
            "hrtf_sha256": hrirs.sha256,
            "hrtf_licence": hrirs.licence or "not stated in the file",
            "hrtf_directions": len(hrirs.directions),
            "hrtf_sample_rate_hz": hrirs.sample_rate,
            "hrtf_resampling": "by its Fourier transform, where the sample rates differ",
            "hrtf_gain_db": round(20 * float(np.log10(self._calibration.gain)), 2),
        }


def _reach() -> float:
    """Largest delay at an ear relative to the head's centre (s)."""
    return float(hrtf.ear_delay(np.pi)) + _MOST_DEVIATION


def _interpolated(
    rows: NDArray[np.float32], basis: DirectionalBasis, corners: NDArray[np.int64], weights: F64
) -> NDArray[np.float32]:
    """Component weights between measurements; in every octave the energy is interpolated, too.

    Responses that differ in phase partly cancel in their mean: without that, directions between measurements would be
    quieter at high frequencies.
    """
    mixed = np.einsum("kc,kcj->kj", weights, rows[corners])
    for first, count in basis.columns:
        columns = slice(first, first + count)
        energy = np.sum(np.square(rows[:, columns], dtype=np.float64), axis=1)
        wanted = np.einsum("kc,kc->k", weights, energy[corners])
        found = np.sum(mixed[:, columns] ** 2, axis=1)
        mixed[:, columns] *= np.sqrt(wanted / np.where(found > 0, found, 1.0))[:, None]
    return np.asarray(mixed, dtype=np.float32)


@lru_cache(maxsize=1)
def grid_directions() -> F64:
    """(K, 3) unit vectors of the grid in the head's frame; elevation by elevation, from below."""
    elevation = np.radians(np.arange(_ELEVATIONS) * STEP - 90.0)[:, None]
    azimuth = np.radians(np.arange(_AZIMUTHS) * STEP)[None, :]
    flat = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), (_ELEVATIONS, _AZIMUTHS))
    return np.stack([flat * np.sin(azimuth), up, -flat * np.cos(azimuth)], axis=-1).reshape(-1, 3)


def nearest_node(directions: F64) -> I32:
    """(n,) index into `grid_directions`."""
    azimuth = np.degrees(np.arctan2(directions[:, 0], -directions[:, 2]))
    elevation = np.degrees(np.arcsin(np.clip(directions[:, 1], -1.0, 1.0)))
    column = np.rint(azimuth / STEP).astype(np.int32) % _AZIMUTHS
    row = np.rint((elevation + 90.0) / STEP).astype(np.int32)
    return np.asarray(row * np.int32(_AZIMUTHS) + column, dtype=np.int32)


def plane_delay(directions: F64, ear: int) -> F64:
    """(n,) s: a plane wave's delay at an ear that is farther out than the head's, linear in the direction.

    It takes most of the slope out of the delays that are tabulated, so that the nearest direction of the table is near
    enough, and unlike Woodworth's it is smooth where creeping waves meet.
    """
    return np.asarray(directions[:, 0] * (-hrtf.EAR_AXES[ear] * PLANE_WIDTH * hrtf.HEAD_RADIUS / SPEED_OF_SOUND))


def _sphere_delays(directions: F64) -> F64:
    """(M, 2) Woodworth's delays at both ears, s."""
    return np.stack([hrtf.ear_delay(hrtf.incidence(directions, ear)) for ear in (0, 1)], axis=1)


@dataclass(frozen=True, eq=False)
class _Calibration:
    """Delay and gain that set a measurement's time and level to those of the sphere.

    Attributes:
        zero: s, when a sound that passes the head's centre is in the file's responses.
        delays: (M, 2) s relative to that, taken out of the responses before they are interpolated.
        gain: factor of the responses.
    """

    zero: float
    delays: F64
    gain: float


@one_blas_thread
def _calibrated(hrirs: HrirSet, mesh: SphereMesh, where: object) -> _Calibration:
    share = mesh.solid_angles() / (4 * np.pi)
    deviation = _lags(hrirs.impulses) / hrirs.sample_rate + hrirs.delays - _sphere_delays(hrirs.directions)
    # The median first: single lags may be wrong, above all at the averted ear.
    zero = float(np.median(deviation))
    zero += float(np.sum(share[:, None] * np.clip(deviation - zero, -_MOST_DEVIATION, _MOST_DEVIATION)) / 2)
    near = np.clip(deviation - zero, -_MOST_DEVIATION, _MOST_DEVIATION)
    frequencies = np.linspace(*_LEVEL_BAND, 64)
    kernel = np.exp(-2j * np.pi * np.arange(hrirs.impulses.shape[2])[:, None] * frequencies / hrirs.sample_rate)
    measured = float(np.einsum("m,mef->", share, np.abs(hrirs.impulses @ kernel) ** 2)) / (2 * len(frequencies))
    coefficients = np.abs(sphere_coefficients(2 * np.pi * frequencies * hrtf.HEAD_RADIUS / SPEED_OF_SOUND)) ** 2
    wanted = float(((2 * np.arange(len(coefficients)) + 1) @ coefficients).mean())
    if not measured > 0:
        raise Avs3dError(f"{where}: its responses have no sound between 350 and 1400 Hz, expected those of two ears")
    return _Calibration(zero, _sphere_delays(hrirs.directions) + near, float(np.sqrt(wanted / measured)))


def _lags(impulses: F64) -> F64:
    """(M, 2) samples by which responses lag behind their minimum-phase versions."""
    length = next_fast_len(4 * impulses.shape[2], real=True)
    half = length // 2
    lags = np.empty(impulses.shape[:2])
    for first in range(0, len(impulses), _CHUNK):
        spectra = rfft(impulses[first : first + _CHUNK], length)
        magnitude = np.abs(spectra)
        cepstrum = irfft(np.log(np.maximum(magnitude, _FLOOR * magnitude.max(axis=-1, keepdims=True))), length)
        cepstrum[..., 1:half] *= 2
        cepstrum[..., half + 1 :] = 0.0
        correlation = irfft(spectra * np.conj(np.exp(rfft(cepstrum, length))), length)[..., : impulses.shape[2]]
        peak = np.clip(correlation.argmax(axis=-1), 1, correlation.shape[-1] - 2)
        before, at, after = (
            np.take_along_axis(correlation, (peak + step)[..., None], axis=-1)[..., 0] for step in (-1, 0, 1)
        )
        # The top of the parabola through three samples.
        bend = before - 2 * at + after
        top = np.where(bend < 0, (before - after) / (2 * np.where(bend < 0, bend, 1.0)), 0.0)
        lags[first : first + _CHUNK] = peak + np.clip(top, -0.5, 0.5)
    return lags


def _aligned_spectra(hrirs: HrirSet, calibration: _Calibration, sample_rate: int) -> C128:
    """(2 M, F) responses without their delays at F frequencies up to half of ``sample_rate``, left ear first."""
    seconds = hrirs.impulses.shape[2] / hrirs.sample_rate + 2 * _MARGIN
    half = 1 << int(np.ceil(np.log2(seconds * sample_rate))) - 1
    frequencies = np.linspace(0.0, sample_rate / 2, half + 1)
    # The Fourier transform of the file's samples at these very frequencies: resampling without a filter.
    step = np.exp(-1j * np.pi * sample_rate / (half * hrirs.sample_rate))
    transform = CZT(hrirs.impulses.shape[2], half + 1, w=step)
    place = frequencies / (hrirs.sample_rate / 2)
    fade = 0.5 + 0.5 * np.cos(np.pi * np.clip((place - _ROLL_OFF) / (1 - _ROLL_OFF), 0.0, 1.0))
    delays = calibration.delays + calibration.zero - hrirs.delays
    count = len(delays)
    aligned = np.empty((2 * count, half + 1), dtype=np.complex128)
    for ear in (0, 1):
        for first in range(0, count, _CHUNK):
            some = slice(first, min(first + _CHUNK, count))
            turn = np.exp(2j * np.pi * frequencies * delays[some, ear, None])
            spectra = transform(hrirs.impulses[some, ear]) * turn * (calibration.gain * fade)
            aligned[ear * count + some.start : ear * count + some.stop] = spectra
    return aligned
