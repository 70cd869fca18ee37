"""An open scene with one source whose traces and binaural responses are made by a CUDA device."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from contextlib import suppress
from functools import partial
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Pose
from generators.acoustics.directivity import Emission
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.device.binaural import DeviceEars
from generators.acoustics.tracer.device.ears import BinauralReceiver, Ears
from generators.acoustics.tracer.device.trace import DeviceScene, DeviceTrace
from generators.acoustics.tracer.diffraction import diffracted_at
from generators.acoustics.tracer.early import Images, images_of
from generators.acoustics.tracer.session import Position, TracerSession, _Source
from generators.core.cuda import OutOfDeviceMemoryError, require_device

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
#: Where the source and the listener are, and how the head is turned.
_Asked = tuple[Pose, tuple[float, float, float], tuple[float, float, float, float]]

#: Responses that are kept, about 0.3 MB each.
_KEPT = 512
#: Heads whose tables are kept on the device.
_HEADS = 4
#: The last heads of each thread, by their tables on the host and the sample rate.
_heads: OrderedDict[tuple[int, int, int], tuple[Ears, DeviceEars]] = OrderedDict()


def _on_device(ears: Ears, sample_rate: int) -> DeviceEars:
    key = (id(ears.basis), sample_rate, get_ident())
    # Taken out while it is looked at: another thread may drop the oldest one at any time.
    found = _heads.pop(key, None)
    if found is None:
        # The tables on the host are kept as well, so that their id is not given to others.
        found = ears, DeviceEars(ears, sample_rate)
    _heads[key] = found
    with suppress(KeyError):
        while len(_heads) > _HEADS:
            _heads.popitem(last=False)
    return found[1]


class DeviceSession(TracerSession):
    """See `TracerSession`; responses of announced poses are made together.

    Arrivals leave the device only if they are asked for, or for a receiver that is not binaural. When the device runs
    out of memory, fewer listeners share a trace and fewer responses are made at a time.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """The arguments are those of `TracerSession`.

        Raises:
            Avs3dError: if CUDA cannot be used, or the scene does not fit into the device's memory.
        """
        require_device()
        self._on_device: DeviceScene | None = None
        #: The last trace: its source, its listeners, what it found.
        self._last: tuple[Pose, list[Position], DeviceTrace] | None = None
        #: None where no sound arrives.
        self._responses: dict[_Asked, F32 | None] = {}
        #: The announced poses with their positions.
        self._poses: list[tuple[Position, Pose]] = []
        super().__init__(*args, **kwargs)

    def prepare(self, poses: Iterable[Pose], together: int | None = None) -> None:
        """See `TracerSession.prepare`."""
        announced = list(poses)
        super().prepare(announced, *([] if together is None else [together]))
        self._poses = [(self._position(pose), pose) for pose in announced]

    def impulse_response(self, pose: Pose) -> F32:
        """See `TracerSession.impulse_response`."""
        if not isinstance(self._receiver, BinauralReceiver):
            return super().impulse_response(pose)
        self._check_open()
        asked = self._asked(pose)
        if asked not in self._responses:
            self._respond(pose)
        response = self._responses[asked]
        if response is None:
            raise self._nothing_heard(self._position(pose))
        return response

    def close(self) -> None:
        """Free the arrivals and the scene."""
        super().close()
        self._last, self._on_device = None, None
        self._responses.clear()

    def _asked(self, pose: Pose) -> _Asked:
        return self._source, pose.position, pose.rotation

    def _respond(self, pose: Pose) -> None:
        """Make the response of ``pose``, and those of the announced poses that were traced with it."""
        trace, listeners = self._traced(self._position(pose))
        number = {position: j for j, position in enumerate(listeners)}
        wanted = {number[self._position(pose)]: pose}
        for position, other in self._poses:
            j = number.get(position)
            if j is not None and self._asked(other) not in self._responses:
                wanted.setdefault(j, other)
        assert isinstance(self._receiver, BinauralReceiver)
        ears = _on_device(self._receiver.ears(self.sample_rate), self.sample_rate)
        some = list(wanted.items())
        made = trace.responses(ears, [j for j, _ in some], [each.rotation_matrix for _, each in some])
        while len(self._responses) + len(made) > _KEPT and self._responses:
            self._responses.pop(next(iter(self._responses)))
        for (j, each), response in zip(some, made, strict=True):
            self._responses[self._asked(each)] = None if trace.is_silent(j) else response

    def _traced(self, position: Position) -> tuple[DeviceTrace, list[Position]]:
        """The last trace if it was from this source to ``position``, or a new one."""
        if self._last is not None and self._last[0] == self._source and position in self._last[1]:
            return self._last[2], self._last[1]
        self._last = None  # its memory is free for the next one
        source = self._heard[self._source]
        others = partial(diffracted_at, self._surfaces, source.edges)
        while True:
            batch = self._batch(position)
            try:
                found = self._scene_on_device().trace(
                    source.images, np.array(batch), others if self._settings.diffraction else _nothing
                )
            except OutOfDeviceMemoryError:
                if len(batch) == 1:
                    raise
                self._together = (len(batch) + 1) // 2
                continue
            self._last = (self._source, batch, found)
            return found, batch

    def _trace(self, source: _Source, position: Position) -> dict[Position, Arrivals]:
        trace, listeners = self._traced(position)
        return dict(zip(listeners, trace.arrivals(), strict=True))

    def _images(self, source: F64, emission: Emission) -> Images:
        settings = self._settings
        search = self._scene_on_device().search
        return images_of(self._surfaces, source, settings.early_order, settings.seed, search, emission)

    def _scene_on_device(self) -> DeviceScene:
        if self._on_device is None:
            self._on_device = DeviceScene(self._surfaces, self._settings, self.rays)
        return self._on_device


def _nothing(listeners: F64) -> list[Arrivals]:
    return [Arrivals.none()] * len(listeners)
