"""The sound that arrives at one listener, before any receiver: times, directions and amplitudes in eight octaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Centre frequencies of the octaves (Hz). Materials have 125 Hz to 4 kHz: the outer octaves repeat the nearest.
BANDS = (63, 125, 250, 500, 1000, 2000, 4000, 8000)


@dataclass(frozen=True, eq=False)
class Arrivals:
    """All arrivals at one listener (the centre of its head), whatever the receiver.

    Early arrivals (direct sound, specular reflections, transmission) add up coherently: their sign is positive.
    Late arrivals are single detected rays: the sign is random, the amplitude is the square root of the energy, so that
    the expected energy of their sum is the sum of their energies.

    Attributes:
        time: (n,) float64, seconds after emission.
        direction: (n, 3) float32 unit vectors in the world's axes, from the listener towards where the sound comes
            from.
        pressure: (n, 8) float32, signed amplitude in each octave of `BANDS` relative to a point source with amplitude 1
            at 1 m: the direct sound at r metres has 1/r in all octaves, times the absorption of the air.
        spherical: (n,) whether the wave front is a sphere about a point that is as far away as the sound has travelled
            (the source or an image of it), so that a receiver that is not small hears it differently from near by;
            the others count as plane. None: all are plane.

    Examples:
        >>> from generators.acoustics import Omni, Room, Tracer
        >>> free = Tracer().response(Room.free_field(), (0, 0, -3.43), (0, 0, 0), Omni(), sample_rate=8000)
        >>> free.arrivals.time.tolist(), free.arrivals.direction.tolist()
        ([0.01], [[0.0, 0.0, -1.0]])
    """

    time: NDArray[np.float64]
    direction: NDArray[np.float32]
    pressure: NDArray[np.float32]
    spherical: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Check that the three arrays belong together.

        Raises:
            ValueError: if their shapes do not fit.
        """
        count = len(self.time)
        if self.time.ndim != 1 or self.direction.shape != (count, 3) or self.pressure.shape != (count, len(BANDS)):
            raise ValueError(
                f"arrivals: time {self.time.shape}, direction {self.direction.shape}, pressure {self.pressure.shape}; "
                f"expected (n,), (n, 3), (n, {len(BANDS)})"
            )
        if self.spherical is not None and self.spherical.shape != (count,):
            raise ValueError(f"arrivals: spherical {self.spherical.shape}, expected ({count},)")

    def __len__(self) -> int:
        """Number of arrivals."""
        return len(self.time)

    @property
    def energy(self) -> NDArray[np.float64]:
        """(8,) sum of squared pressures per octave; 1/r² for the direct sound alone."""
        return np.asarray(np.sum(np.square(self.pressure, dtype=np.float64), axis=0))

    @property
    def is_spherical(self) -> NDArray[np.bool_]:
        """(n,) `spherical`, false where it is missing."""
        return np.zeros(len(self), dtype=np.bool_) if self.spherical is None else self.spherical

    @classmethod
    def none(cls) -> Arrivals:
        """No arrival at all."""
        return cls(np.zeros(0), np.zeros((0, 3), dtype=np.float32), np.zeros((0, len(BANDS)), dtype=np.float32))

    @classmethod
    def joined(cls, parts: Sequence[Arrivals]) -> Arrivals:
        """The arrivals of all ``parts``, one part after the other."""
        if not parts:
            return cls.none()
        return cls(
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.direction for part in parts]),
            np.concatenate([part.pressure for part in parts]),
            np.concatenate([part.is_spherical for part in parts]),
        )
