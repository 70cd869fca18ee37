"""Tables of a pair of ears on a CUDA device: for every direction a delay and a row of weights, and the filters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.receivers.basis import DirectionalBasis
from generators.acoustics.tracer.receivers.near_field import NearField

#: How directions are tabulated: over the angle of incidence on a sphere, or on a grid of azimuth and elevation.
SPHERE, GRID = 0, 1


@dataclass(frozen=True, eq=False)
class Ears:
    """Both ears of a head at one sample rate.

    Attributes:
        kind: `SPHERE` or `GRID`.
        basis: weights and filters.
        first_row: row of the weights at which those of the right ear begin; those of the left begin at 0.
        residual: (2, K) s, delays of a `GRID` beyond those of a plane wave; (2, 1), unused, of a `SPHERE`.
        reach: largest delay relative to the head's centre, s.
        near: what a near source adds, which the host applies; None: nothing.
    """

    kind: int
    basis: DirectionalBasis
    first_row: int
    residual: NDArray[np.float64]
    reach: float
    near: NearField | None = None


@runtime_checkable
class BinauralReceiver(Protocol):
    """A receiver whose responses can be made on a CUDA device."""

    def ears(self, sample_rate: int) -> Ears:
        """Its ears at ``sample_rate``, always the same object."""
        ...
