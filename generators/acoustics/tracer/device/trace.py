"""A scene on a CUDA device, and traces of it whose records stay there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.device import kernels
from generators.acoustics.tracer.device.binaural import DeviceEars, DeviceRecords
from generators.acoustics.tracer.early import MOST_CROSSINGS, Images, heard_images
from generators.acoustics.tracer.kernels import LATE, RAIN
from generators.acoustics.tracer.late import by_listener, discs, emitted_energy, limits_of
from generators.acoustics.tracer.rays import key_of, ray_directions
from generators.acoustics.tracer.settings import TraceSettings
from generators.acoustics.tracer.surfaces import AcousticSurfaces
from generators.acoustics.tracer.tables import Records
from generators.core.cuda import allocate, launch, upload

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

#: Room for records at first, in expected ones: a trace that needs more is made again, with what it needs.
_ROOM = 1.25


class DeviceScene:
    """The surfaces of a scene on the device.

    Args:
        surfaces: of the scene.
        settings: of all traces.
        rays: of a trace.

    Raises:
        OutOfDeviceMemoryError: if they do not fit.
    """

    def __init__(self, surfaces: AcousticSurfaces, settings: TraceSettings, rays: int) -> None:
        self._surfaces, self._settings = surfaces, settings
        self._mesh = upload(surfaces.mesh, "the surfaces of the scene")
        self._equation = upload(surfaces.plane_equation, "the surfaces of the scene")
        self._rims = upload(surfaces.rims, "the surfaces of the scene")
        self._rained = settings.rain_rays if settings.rain_order else 0
        #: Directions of the rays, and of those of diffuse rain.
        self._host = (
            ray_directions(rays, settings.seed, LATE),
            ray_directions(max(self._rained, 1), settings.seed, RAIN),
        )
        self._directions, self._rain_directions = (upload(each, "the rays") for each in self._host)
        self._key, self._air = upload(key_of(settings.seed)), upload(energy_exponents())
        self._limits = limits_of(settings, surfaces.planes)
        #: Records per listener, as many as the trace before had.
        self._expected = float(settings.arrivals + self._rained * settings.rain_order)

    def search(self, source: F64, directions: F64, order: int) -> I32:
        """`generators.acoustics.tracer.early.Search`."""
        planes = allocate((len(directions), order), np.int32)
        launch(kernels.search, len(directions), self._mesh, upload(source), upload(directions), planes)
        found: I32 = planes.copy_to_host()
        return found

    def trace(self, images: Images, listeners: F64, others: Callable[[F64], list[Arrivals]]) -> DeviceTrace:
        """Trace from the source of ``images`` to ``listeners`` (L, 3).

        Args:
            images: candidates for image sources.
            listeners: metres.
            others: further arrivals at listeners (L, 3): made by the host while the device works.

        Raises:
            OutOfDeviceMemoryError: if the records do not fit.
        """
        heads, source = len(listeners), upload(images.source)
        places = upload(np.ascontiguousarray(listeners))
        visible = np.zeros((heads, len(images.sequences)), dtype=np.bool_)
        weight = np.zeros((*visible.shape, 8), dtype=np.float32)
        seen = allocate(visible.shape if visible.size else (1, 1), np.bool_, "visible images")
        carried = allocate(weight.shape if visible.size else (1, 1, 8), np.float32, "visible images")
        launch(
            kernels.visibility, visible.size, self._mesh, self._rims, self._equation, places, source,
            upload(images.sequences), upload(images.positions), seen, carried,
        )  # fmt: skip
        between, hidden = allocate(heads, np.int64), allocate((heads, 8), np.float64)
        launch(
            kernels.walls_between, heads, self._mesh, self._rims, places, source, MOST_CROSSINGS, between, hidden
        )  # fmt: skip
        if visible.size:
            visible, weight = seen.copy_to_host(), carried.copy_to_host()
        walls, depth = between.copy_to_host(), hidden.copy_to_host()
        around = upload(discs(self._surfaces, listeners, self._settings.radius))
        known = upload(images.keys)
        emitted, rain_emitted = (upload(emitted_energy(images.emission, each), "the rays") for each in self._host)

        def start(room: int) -> tuple[Records, Any, Any, Any]:
            records = Records(
                allocate(room, np.int32, "arrivals"),
                allocate(room, np.float64, "arrivals"),
                allocate((room, 3), np.float32, "arrivals"),
                allocate((room, 8), np.float32, "arrivals"),
            )
            ranks, latest = allocate(room, np.int64, "arrivals"), upload(np.zeros(heads))
            count = upload(np.zeros(1, dtype=np.int64))
            launch(
                kernels.rain, self._rained * heads, self._mesh, source, self._rain_directions, rain_emitted, self._key,
                around, self._air, self._limits, records, ranks, latest, count,
            )  # fmt: skip
            launch(
                kernels.late, len(self._directions), self._mesh, source, self._directions, emitted, self._key, around,
                known, self._air, self._limits, records, ranks, self._rained * self._limits.rain, latest, count,
                block=kernels.LATE_BLOCK,
            )  # fmt: skip
            return records, ranks, latest, count

        room = max(int(_ROOM * self._expected * heads), 1024)
        records, ranks, latest, count = start(room)
        early = heard_images(images, listeners, visible, weight, walls, depth)
        early = [Arrivals.joined(pair) for pair in zip(early, others(listeners), strict=True)]
        found = int(count.copy_to_host()[0])
        if found > room:
            del records, ranks, latest, count  # their memory is free for the next ones
            records, ranks, latest, count = start(found)
        self._expected = max(found / heads, 1.0)
        last = latest.copy_to_host() / SPEED_OF_SOUND
        return DeviceTrace(records, ranks, found, last, early)


@dataclass(frozen=True, eq=False)
class DeviceTrace:
    """The result of a trace.

    Attributes:
        records: `Records` on the device, in any order.
        ranks: (C,) int64 on the device: the CPU's order up to the listener.
        count: number of records; the arrays may be longer.
        last: (L,) s, the last record of each listener; 0 without one.
        early: the other arrivals of each listener.
    """

    records: Any
    ranks: Any
    count: int
    last: F64
    early: list[Arrivals]

    def is_silent(self, listener: int) -> bool:
        """Whether nothing arrives at a listener."""
        return not self.last[listener] and not self.early[listener].pressure.any()

    def arrivals(self) -> list[Arrivals]:
        """All arrivals of each listener, in the CPU's order."""
        ranks = self.ranks[: self.count].copy_to_host()
        order = np.argsort(ranks, kind="stable")
        host = Records(*(np.ascontiguousarray(each[: self.count].copy_to_host()[order]) for each in self.records))
        # Threads of one rank come in any order: listeners are told apart by `by_listener`.
        late = by_listener([host], len(self.early))
        return [Arrivals.joined([early, tail]) for early, tail in zip(self.early, late, strict=True)]

    def responses(self, ears: DeviceEars, listeners: list[int], rotations: list[F64]) -> list[F32]:
        """See `DeviceEars.responses`."""
        own = self.records
        heard = [DeviceRecords(own.listener, own.path, own.direction, own.pressure, self.count, SPEED_OF_SOUND)]
        if ears.near is None:
            heard += _uploaded({j: self.early[j] for j in listeners}, 0, 2)
        else:
            for ear in (0, 1):
                parts = {}
                for j, rotation in zip(listeners, rotations, strict=True):
                    turned = np.einsum("ij,jk->ik", self.early[j].direction.astype(np.float64), rotation)
                    parts[j] = ears.near.heard(self.early[j], turned, ear)[0]
                heard += _uploaded(parts, ear, ear + 1)
        last = np.maximum(self.last, [part.time.max(initial=0.0) for part in self.early])
        return ears.responses(heard, last, listeners, rotations)


def _uploaded(arrivals: dict[int, Arrivals], first_ear: int, last_ear: int) -> list[DeviceRecords]:
    """The arrivals of listeners on the device; no record without any arrival."""
    owner = np.repeat(np.array(list(arrivals), dtype=np.int32), [len(part) for part in arrivals.values()])
    joined = Arrivals.joined(list(arrivals.values()))
    if not len(joined):
        return []
    columns: list[Any] = [upload(each) for each in (owner, joined.time, joined.direction, joined.pressure)]
    listener, time, direction, pressure = columns
    return [DeviceRecords(listener, time, direction, pressure, len(joined), 1.0, first_ear, last_ear)]
