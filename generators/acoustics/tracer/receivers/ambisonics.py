"""Ambisonics of order 1 to 3 in the AmbiX convention: channels in ACN order, SN3D normalisation.

The axes are those of the listener's head, as in AmbiX: x forward, y left, z up. The response turns with the head; for a
sound field that stays with the world give the rotation of a listener that faces that way.

Reference:
    C. Nachbar, F. Zotter, E. Deleflie, A. Sontacchi, "AmbiX: a suggested ambisonics format", Ambisonics Symposium 2011.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import UsageError
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.synthesis import (
    ReceiverPort,
    checked,
    grids_of_length,
    response_length,
    synthesise,
)

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

F64 = NDArray[np.float64]

MOST_ORDER = 3


def ambisonic_axes(directions: ArrayLike) -> F64:
    """Directions (..., 3) in the head's frame (x right, y up, z backward) in the axes of AmbiX (forward, left, up)."""
    d = np.asarray(directions, dtype=np.float64)
    return np.stack([-d[..., 2], -d[..., 0], d[..., 1]], axis=-1)


def spherical_harmonics(directions: ArrayLike, order: int) -> F64:
    """(n, (order + 1)²) real spherical harmonics, ACN order and SN3D, of unit vectors (n, 3) in AmbiX axes.

    The squares of the 2l + 1 harmonics of a degree l add up to 1 in every direction. There is no Condon–Shortley phase.
    """
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    terms = [np.ones_like(x), y, z, x]
    if order >= 2:
        r3 = np.sqrt(3.0)
        terms += [r3 * x * y, r3 * y * z, (3 * z * z - 1) / 2, r3 * x * z, r3 / 2 * (x * x - y * y)]
    if order >= 3:
        r58, r38, r15 = np.sqrt(5 / 8), np.sqrt(3 / 8), np.sqrt(15.0)
        terms += [
            r58 * y * (3 * x * x - y * y),
            r15 * x * y * z,
            r38 * y * (5 * z * z - 1),
            z * (5 * z * z - 3) / 2,
            r38 * x * (5 * z * z - 1),
            r15 / 2 * z * (x * x - y * y),
            r58 * x * (x * x - 3 * y * y),
        ]
    return np.stack(terms, axis=-1)


class Ambisonics:
    """Coincident channels at the centre of the head, which is not there.

    Args:
        order: 1 to 3.

    Raises:
        UsageError: for another order.

    Examples:
        >>> Ambisonics(1).channel_names
        ('W', 'Y', 'Z', 'X')
    """

    def __init__(self, order: int) -> None:
        if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= MOST_ORDER:
            raise UsageError(f"ambisonics: order is {order!r}, expected 1 to {MOST_ORDER}")
        self.order = order

    @property
    def channels(self) -> int:
        """(order + 1)²."""
        return (self.order + 1) ** 2

    @property
    def channel_names(self) -> tuple[str, ...]:
        """W, Y, Z, X, … in ACN order."""
        from avs3d_bench.contract.schema import AmbisonicsRecord

        return AmbisonicsRecord(order=self.order).channel_names

    def response(self, arrivals: Arrivals, rotation: NDArray[np.float64], sample_rate: int) -> NDArray[np.float32]:
        """Ambisonic response ((order + 1)², m) float32; see `Receiver`. W is the pressure in the free field."""
        directions = checked(arrivals, rotation, sample_rate)
        samples = response_length(arrivals, sample_rate, 0.0)
        rows = spherical_harmonics(ambisonic_axes(directions), self.order).astype(np.float32)
        index = np.arange(len(arrivals), dtype=np.int32)
        port = ReceiverPort(0.0, index, rows, ((0, self.channels),) * len(BANDS))
        return synthesise(arrivals, [port], grids_of_length(samples, sample_rate), samples)

    def diffuse_covariance(self, frequency: NDArray[np.floating]) -> F64:
        """See `FreeFieldReceiver`: the 2l + 1 channels of degree l are uncorrelated and share the power 1."""
        degree = np.sqrt(np.arange(self.channels)).astype(int)
        powers = np.diag(1.0 / (2 * degree + 1))
        return np.broadcast_to(powers, (len(frequency), *powers.shape))

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        return {
            "receiver": "ambisonics",
            "ambisonics_order": self.order,
            "channel_order": "ACN",
            "normalisation": "SN3D",
            "axes": "of the head: x forward, y left, z up",
        }
