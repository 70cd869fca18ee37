"""Ambisonics of order 1 to 3 in the AmbiX convention: channels in ACN order, SN3D normalisation.

The axes are those of the listener's head, as in AmbiX: x forward, y left, z up. The response turns with the head; for a
sound field that stays with the world give the rotation of a listener that faces that way.

Reference:
    C. Nachbar, F. Zotter, E. Deleflie, A. Sontacchi, "AmbiX: a suggested ambisonics format", Ambisonics Symposium 2011.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError
from avs3d_bench.geometry import ambisonic_axes, spherical_harmonics
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
