"""The protocol of an acoustic backend: open a scene and a source once, ask for an impulse response per pose."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Pose
from generators.core.scene import Scene

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar
    from generators.acoustics.directivity import Directivity
    from generators.acoustics.tracer.arrivals import Arrivals

#: Where a source is, and how it is turned: a point (world, metres) is one that is not.
Place = tuple[float, float, float] | Pose


def point_of(place: Place) -> tuple[float, float, float]:
    """Where a source is, which nobody may have checked yet."""
    return place.position if isinstance(place, Pose) else place


def pose_of(place: Place) -> Pose:
    """The pose of a source: that of a point has its front towards +Z (see `generators.acoustics.directivity`)."""
    return place if isinstance(place, Pose) else Pose(place, (1.0, 0.0, 0.0, 0.0))


class AcousticSession(Protocol):
    """An open scene with one source."""

    sample_rate: int

    def impulse_response(self, pose: Pose) -> NDArray[np.float32]:
        """Binaural room impulse response (2, n) float32 at the session's sample rate; channel 0 is left.

        Responses are deterministic for the same *sequence* of calls in a fresh session.
        """
        ...

    def move_source(self, source: Place) -> None:
        """Put the source elsewhere, or turn it, for the responses that follow; the scene stays as it was opened.

        The body of the sounding object is no part of what sound meets, so that nothing else moves with it.
        """
        ...

    def close(self) -> None:
        """Free the resources of the session."""
        ...


@runtime_checkable
class BatchSession(AcousticSession, Protocol):
    """A session whose responses are cheaper if it knows the poses beforehand; they are the same without."""

    def prepare(self, poses: Iterable[Pose], together: int = ...) -> None:
        """Announce the poses whose responses will be asked for, in this order.

        Args:
            poses: of the listener.
            together: how many consecutive poses to compute at a time: few if the source moves, or memory is scarce.
        """
        ...


@runtime_checkable
class ReceiverSession(AcousticSession, Protocol):
    """A session with more receivers than the head."""

    def other_responses(self, pose: Pose) -> dict[str, NDArray[np.float32]]:
        """Name of each receiver beside the head → its response (channels, n) float32, from the head's own sound.

        They do not change what `impulse_response` gives.
        """
        ...


@runtime_checkable
class ArrivalSession(AcousticSession, Protocol):
    """A session that tells single arrivals, before any receiver."""

    @property
    def late_step(self) -> float:
        """Way (m) of source or listener between two responses that late sound is cross-faded of."""
        ...

    def arrivals(self, pose: Pose) -> Arrivals:
        """All that arrives at a pose; it does not depend on the pose's rotation."""
        ...

    def early(self, pose: Pose) -> Arrivals:
        """The direct sound and the specular reflections alone; far cheaper than `arrivals`."""
        ...


class AcousticBackend(Protocol):
    """An acoustic engine.

    Every backend scales the absorption of all surfaces alike: α' = 1 − (1 − α)^``absorption_scale``.
    """

    name: str
    version: str

    def open(
        self,
        scene: Scene,
        source: Place,
        *,
        room: str,
        sample_rate: int = 44_100,
        directivity: Directivity | None = None,
    ) -> AcousticSession:
        """Load ``scene`` with a source at ``source`` (world, metres) standing in ``room``.

        Without a directivity it is alike in all directions, however it is turned.
        """
        ...

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        ...


@runtime_checkable
class CompiledBackend(Protocol):
    """An acoustic engine that compiles its kernels."""

    def warm_up(self) -> None:
        """Compile all kernels, or load them from the cache, once, before workers start."""
        ...
