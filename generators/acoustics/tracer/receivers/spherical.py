"""Two ears on a rigid sphere: interaural time and level differences exact at all frequencies, no measured data."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.acoustics import hrtf
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.device.ears import SPHERE, Ears
from generators.acoustics.tracer.receivers.basis import Components, DirectionalBasis, directional_basis
from generators.acoustics.tracer.receivers.near_field import diametral_near_field
from generators.acoustics.tracer.receivers.sphere import sphere_response
from generators.acoustics.tracer.receivers.synthesis import (
    ReceiverPort,
    checked,
    grids_of_length,
    response_length,
    synthesise,
)

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

#: Tabulated incidence angles per half turn; the nearest one is used (at most a quarter of a degree away).
STEPS = 360
#: 5 µs is half of the least interaural delay that is heard. The 8 kHz octave has an error of 5 % in the mean: behind
#: the head, creeping waves from all sides interfere.
_COMPONENTS = Components(accuracy=0.01, timing=5e-6, most=6)
#: Range of the sphere's radius (m): from a small animal's to a large dummy's; the nearest sources stay outside of it.
LEAST_RADIUS, MOST_RADIUS = 0.03, 0.12
#: Time that the table's spectra resolve (s); the sphere's response has faded by 80 dB within 3 ms.
_RESOLVED = 0.016


class SphericalHead:
    """Ears at both ends of a diameter of a rigid sphere, after Duda and Martens (1998).

    The delay of each direction is Woodworth's; what the exact sphere adds to it, above all the greater delay at low
    frequencies (3/2 times Woodworth's below 500 Hz, Kuhn 1977), is in the filters. What a source at a finite distance
    adds to that is in `near_field`.

    Args:
        radius: of the sphere, m; see `LEAST_RADIUS` and `MOST_RADIUS`.

    Raises:
        Avs3dError: if the radius is out of range.

    Examples:
        >>> SphericalHead(radius=0.09).channel_names
        ('left', 'right')
    """

    channels = 2
    channel_names = ("left", "right")

    def __init__(self, radius: float = hrtf.HEAD_RADIUS) -> None:
        if not LEAST_RADIUS <= radius <= MOST_RADIUS:
            raise Avs3dError(f"spherical head: radius is {radius!r} m, expected {LEAST_RADIUS:g} to {MOST_RADIUS:g}")
        self.radius = float(radius)

    def response(self, arrivals: Arrivals, rotation: NDArray[np.float64], sample_rate: int) -> NDArray[np.float32]:
        """Binaural response (2, m) float32, channel 0 is left; see `Receiver`."""
        directions = checked(arrivals, rotation, sample_rate)
        samples = response_length(arrivals, sample_rate, self._reach())
        grids = grids_of_length(samples, sample_rate)
        basis = sphere_basis(sample_rate, self.radius)
        ears = []
        for ear in (0, 1):
            heard, towards = diametral_near_field(self.radius).heard(arrivals, directions, ear)
            theta = hrtf.incidence(towards, ear)
            index = np.rint(theta * (STEPS / np.pi)).astype(np.int32)
            delay = hrtf.ear_delay(theta, self.radius)
            port = ReceiverPort(delay, index, basis.rows, basis.columns, basis.filters(grids))
            ears.append(synthesise(heard, [port], grids, samples))
        return np.concatenate(ears)

    def ears(self, sample_rate: int) -> Ears:
        """See `BinauralReceiver`; the device's kernels know the usual radius alone.

        Raises:
            Avs3dError: for another radius.
        """
        if self.radius != hrtf.HEAD_RADIUS:
            raise Avs3dError(
                f"spherical head: radius {self.radius:g} m is heard on the CPU only, CUDA has {hrtf.HEAD_RADIUS:g}; "
                "use device='cpu'"
            )
        near = diametral_near_field(self.radius)
        return Ears(SPHERE, sphere_basis(sample_rate, self.radius), 0, np.zeros((2, 1)), self._reach(), near)

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        return {"receiver": "binaural", "head": "rigid sphere", "head_radius_m": self.radius}

    def _reach(self) -> float:
        """Largest delay at an ear relative to the head's centre (s)."""
        return float(hrtf.ear_delay(np.pi, self.radius))


@lru_cache(maxsize=4)
def sphere_basis(sample_rate: int, radius: float = hrtf.HEAD_RADIUS) -> DirectionalBasis:
    """The rigid sphere's directivity with Woodworth's delay taken out, tabulated over the angle of incidence."""
    theta = np.linspace(0.0, np.pi, STEPS + 1)
    length = 1 << int(np.ceil(np.log2(_RESOLVED * sample_rate)))
    omega = 2 * np.pi * np.linspace(0.0, sample_rate / 2, length // 2 + 1)
    exact = sphere_response(theta, omega * radius / SPEED_OF_SOUND)
    aligned = exact * np.exp(1j * omega * hrtf.ear_delay(theta, radius)[:, None])
    # Both poles stand for a cap of half a step.
    half = np.pi / STEPS / 2
    caps = np.cos(np.maximum(theta - half, 0.0)) - np.cos(np.minimum(theta + half, np.pi))
    return directional_basis(aligned, caps, sample_rate, _COMPONENTS)
