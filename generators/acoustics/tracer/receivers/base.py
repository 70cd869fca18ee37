"""The protocol of a receiver: from the arrivals at one listener to a response with one or more channels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.arrivals import Arrivals

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar


class Receiver(Protocol):
    """Ears, microphones or ambisonic channels at a listener's position."""

    @property
    def channels(self) -> int:
        """Number of channels."""
        ...

    @property
    def channel_names(self) -> tuple[str, ...]:
        """One name per channel, in their order."""
        ...

    def response(self, arrivals: Arrivals, rotation: NDArray[np.float64], sample_rate: int) -> NDArray[np.float32]:
        """The impulse response (channels, m) float32.

        The free field of a source with amplitude 1 at 1 m has amplitude 1. The length m follows from the last arrival.
        The same arrivals give the same bytes.

        Args:
            arrivals: at the centre of the listener's head.
            rotation: (3, 3) listener-to-world; its columns are the listener's right, up and backward axes.
            sample_rate: Hz.

        Raises:
            Avs3dError: if a number is not finite or out of range.
        """
        ...

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        ...


class FreeFieldReceiver(Receiver, Protocol):
    """Channels without a head in the sound field, at or near the listener's position."""

    def diffuse_covariance(self, frequency: NDArray[np.floating]) -> NDArray[np.float64]:
        """Covariance of the channels in a diffuse field whose sound pressure has the power 1.

        It does not depend on the listener's rotation.

        Args:
            frequency: (n,) Hz.

        Returns:
            (n, channels, channels) real, symmetric.
        """
        ...
