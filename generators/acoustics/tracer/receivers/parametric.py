"""Two ears of a parametric head: a rigid sphere with ears off its diameter, and pinnae as filters.

The responses are computed on directions all around and then treated as measured ones are (`measured.HrirHead`): the
sphere's exact response at each ear, times the magnitude and minimum phase of the pinna's notches and resonances. A
pinna's filter depends on the direction about the interaural axis: notches rise in frequency from below to above, are
deepest ahead and low, and fade overhead and at the side; behind, they are shallower and elsewhere, and the flange of
the ear takes from the high frequencies. See `generators.acoustics.heads` for the sources.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.schema import HeadRecord, Scalar
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.receivers.measured import HrirHead
from generators.acoustics.tracer.receivers.near_field import near_field
from generators.acoustics.tracer.receivers.sofa import HrirSet
from generators.acoustics.tracer.receivers.sphere import sphere_response
from generators.core.low_discrepancy import fibonacci_directions

F64 = NDArray[np.float64]
C128 = NDArray[np.complex128]

#: Directions of the responses (about 7° apart), their rate (Hz), their length and that of the transforms (samples).
_DIRECTIONS, _RATE, _LENGTH, _TRANSFORM = 800, 48_000, 384, 1024
#: Time of a sound that passes the head's centre in the responses (s).
_ZERO = 0.0015
#: Start of the roll-off to the Nyquist frequency, as a fraction of it.
_ROLL_OFF = 0.8
#: Corner of the loss behind (Hz).
_BACK_CORNER = 4000.0
#: Share of a notch's depth that is left behind the head; that it loses overhead; that it has at the far ear.
_BEHIND, _OVERHEAD, _FAR = 0.4, 0.6, 0.6


class ParametricHead(HrirHead):
    """The head of a `HeadRecord`, at any sample rate; sources at a finite distance have the sphere's near field."""

    def __init__(self, head: HeadRecord) -> None:
        where = f"head of the family ({head.family})"
        super().__init__(_responses(head), where, near_field(head.radius, ear_axes(head)))
        self._head = head

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json; `AcousticsRecord.head` has the head."""
        return {"receiver": "binaural", "head": f"parametric family, {self._head.family}"}


def ear_axes(head: HeadRecord) -> F64:
    """(2, 3) unit vectors from the centre to both ears in the head's frame (x right, y up, z backward), left first."""
    azimuth, elevation = np.radians(head.ear_azimuth), np.radians(head.ear_elevation)
    right = np.array(
        [np.cos(elevation) * np.sin(azimuth), np.sin(elevation), -np.cos(elevation) * np.cos(azimuth)], dtype=np.float64
    )
    return np.stack([right * [-1.0, 1.0, 1.0], right])


def pinna(head: HeadRecord, directions: F64, frequency: F64) -> C128:
    """(n, F) response of the right ear's pinna.

    Args:
        head: its parameters.
        directions: (n, 3) in the head's frame; of the left ear, mirrored.
        frequency: (F,) Hz.
    """
    side = directions[:, 0]
    about = np.sqrt(np.maximum(1 - side**2, 1e-12))
    up, ahead = directions[:, 1] / about, -directions[:, 2] / about
    behind = (1 - ahead) / 2
    # Every term ends at the side with `about`, where up and ahead have no meaning.
    fade = (_FAR + (1 - _FAR) * (1 + side) / 2) * about**2
    depth = fade * (1 - (1 - _BEHIND) * behind) * (1 - _OVERHEAD * ((1 + up) / 2) ** 2)
    s: C128 = np.asarray(1j * frequency[None, :], dtype=np.complex128)
    loss = 10 ** (-head.back_loss_db * behind * about**2 / 20)[:, None]
    found = (s * loss + _BACK_CORNER) / (s + _BACK_CORNER)
    for notch in head.notches:
        middle = notch.frequency * (1 + notch.rise * up * about) * (1 + head.back_shift * behind * about)
        found = found * _section(middle, notch.width * middle, notch.gain_db * depth, s)
    for peak in head.peaks:
        middle = np.full(len(directions), peak.frequency)
        found = found * _section(middle, peak.width * middle, np.full(len(directions), peak.gain_db), s)
    return np.asarray(found)


def _section(middle: F64, width: F64, gain_db: F64, s: C128) -> C128:
    """(n, F) response of minimum phase: the gain (n,) at ``middle`` (n,) Hz, 1 far from it; ``s`` (1, F) is i·f."""
    gain = 10 ** (gain_db / 20)[:, None]
    square, wide = (middle**2)[:, None], width[:, None]
    return np.asarray((s * s + gain * wide * s + square) / (s * s + wide * s + square))


def _responses(head: HeadRecord) -> HrirSet:
    """The head's impulse responses in directions all around."""
    directions = fibonacci_directions(_DIRECTIONS)
    frequency: F64 = np.asarray(np.fft.rfftfreq(_TRANSFORM, 1 / _RATE), dtype=np.float64)
    place = np.clip((frequency / (_RATE / 2) - _ROLL_OFF) / (1 - _ROLL_OFF), 0.0, 1.0)
    shape = (0.5 + 0.5 * np.cos(np.pi * place)) * np.exp(-2j * np.pi * frequency * _ZERO)
    wave_number = 2 * np.pi * frequency * head.radius / SPEED_OF_SOUND
    ears = []
    for ear, axis in enumerate(ear_axes(head)):
        cosine = np.clip(np.einsum("ij,j->i", directions, axis), -1.0, 1.0)
        towards = directions * ([-1.0, 1.0, 1.0] if ear == 0 else [1.0, 1.0, 1.0])
        spectra = sphere_response(np.arccos(cosine), wave_number) * pinna(head, towards, frequency) * shape
        ears.append(np.fft.irfft(spectra, _TRANSFORM, axis=1)[:, :_LENGTH])
    text = head.model_dump_json()
    return HrirSet(
        directions=directions,
        impulses=np.stack(ears, axis=1),
        delays=np.zeros((len(directions), 2)),
        sample_rate=float(_RATE),
        name=f"parametric head, {head.family}",
        licence="Apache-2.0",
        author="",
        origin="procedural",
        sha256=hashlib.sha256(text.encode()).hexdigest(),
    )


@lru_cache(maxsize=4)
def parametric_head(head: HeadRecord) -> ParametricHead:
    """The head of a record: the same object for the same parameters, since its tables take a second to make."""
    return ParametricHead(head)
