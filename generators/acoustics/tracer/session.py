"""An open scene with one source: traces on demand, in batches of listeners."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators.acoustics.base import Place, point_of, pose_of
from generators.acoustics.directivity import Directivity, Emission, emission_of
from generators.acoustics.geometry import (
    SPEED_OF_SOUND,
    acoustic_mesh,
    checked_position,
    faces_of_room,
    reflections_to_decay,
)
from generators.acoustics.materials import triangle_areas
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.carriers import on_carriers
from generators.acoustics.tracer.diffraction import LitEdges, diffracted, lit_edges
from generators.acoustics.tracer.early import Images, early_arrivals, images_of
from generators.acoustics.tracer.enclosure import Enclosure
from generators.acoustics.tracer.late import rays_for, trace
from generators.acoustics.tracer.settings import LONGEST, MOST_REFLECTIONS, TraceSettings
from generators.acoustics.tracer.surfaces import surfaces_of
from generators.core.scene import Scene

if TYPE_CHECKING:
    from generators.acoustics.tracer.receivers.base import Receiver

Position = tuple[float, float, float]

#: Listeners of one trace; their arrivals are in memory together, about 1 MB each.
_BATCH = 128
#: Sources whose traces are kept: a clip of a moving source needs three, and the next clip two of these again.
_SOURCES = 4
#: Way (m) between two traces of a moving source or listener: of rays, whose late sound is another one after a few
#: centimetres, and of fixed carriers, whose amplitudes are almost linear in between.
_LATE_STEP, _SMOOTH_STEP = 0.3, 0.04


@dataclass(frozen=True, eq=False)
class _Source:
    """State of a source: candidates for its images, the edges as it sees them, its space, its traced energy."""

    images: Images
    edges: LitEdges
    enclosure: Enclosure
    traced: dict[Position, Arrivals]


class TracerSession:
    """An open scene with one source; see `AcousticSession`.

    Responses depend on the scene, the source and the pose alone: not on the calls before, the poses that were
    announced, or the number of threads. `prepare` makes them cheaper: announced poses share a trace. A source that
    comes back to one of its last places finds its traces again.
    """

    def __init__(
        self,
        scene: Scene,
        source: Place,
        room: str,
        sample_rate: int,
        *,
        receiver: Receiver,
        settings: TraceSettings,
        absorption_scale: float = 1.0,
        threads: int = 1,
        others: Mapping[str, Receiver] | None = None,
        directivity: Directivity | None = None,
    ) -> None:
        """Prepare the scene; the arguments are those of `TracerBackend`, which checks them, and of its ``open``."""
        self.sample_rate = sample_rate
        # A room that is made more live rings on for longer.
        livelier = min(absorption_scale, 1.0)
        settings = replace(
            settings,
            most_reflections=min(math.ceil(settings.most_reflections / livelier), MOST_REFLECTIONS),
            seconds=min(settings.seconds / livelier, LONGEST),
        )
        self._receiver, self._settings, self._threads = receiver, settings, threads
        self._others = dict(others or {})
        self._scene, self._directivity = scene.name, directivity
        box = scene.room(room)
        mesh = acoustic_mesh(scene, point_of(source), absorption_scale=absorption_scale)
        self._bounds = mesh.bounds
        self._surfaces = surfaces_of(mesh)
        self._room = box
        depth = reflections_to_decay(mesh, box, settings.decay_db, settings.most_reflections)
        area = float(triangle_areas(faces_of_room(mesh, box)[0]).sum())
        #: Rays of a trace.
        self.rays = rays_for(area, depth, settings) if area > 0 else settings.least_rays
        self._announced: list[Position] = []
        self._together = _BATCH
        #: The last sources.
        self._heard: OrderedDict[Pose, _Source] = OrderedDict()
        self._closed = False
        self.move_source(source)

    def move_source(self, source: Place) -> None:
        """Put the source elsewhere, or turn it, for the responses that follow.

        Raises:
            Avs3dError: if the session is closed, or the source is outside the scene.
        """
        self._check_open()
        x, y, z = checked_position(self._scene, "source", point_of(source), self._bounds)
        # A source that is alike in all directions is the same one, however it is turned.
        pose = pose_of((x, y, z)) if self._directivity is None else replace(pose_of(source), position=(x, y, z))
        if pose in self._heard:
            self._source = pose
            self._heard.move_to_end(pose)
            return
        position = np.array((x, y, z))
        emission = emission_of(self._directivity, pose)
        images = self._images(position, emission)
        self._source = pose
        edges = lit_edges(self._surfaces.edges, position, emission)
        enclosure = Enclosure.of(self._scene, self._room, self._surfaces, position)
        self._heard[pose] = _Source(images, edges, enclosure, {})
        if len(self._heard) > _SOURCES:
            self._heard.popitem(last=False)

    @property
    def late_step(self) -> float:
        """See `ArrivalSession.late_step`."""
        return _SMOOTH_STEP if self._settings.fixed_carriers else _LATE_STEP

    def prepare(self, poses: Iterable[Pose], together: int = _BATCH) -> None:
        """Announce the poses whose responses will be asked for, in this order; they will share traces.

        Args:
            poses: of the listener.
            together: how many poses share a trace; the few that hear a source at one place, if it moves.

        Raises:
            Avs3dError: if the session is closed or a listener is outside the scene.
        """
        self._check_open()
        self._announced = list(dict.fromkeys(self._position(pose) for pose in poses))
        self._together = max(1, min(together, _BATCH))

    def arrivals(self, pose: Pose) -> Arrivals:
        """All that arrives at the head's centre, early part first; it does not depend on the head's rotation.

        Raises:
            Avs3dError: if the session is closed, the listener is outside the scene, it or the source is in a closed
                body that the other is not in (`Enclosure`), or no sound reaches it.
        """
        self._check_open()
        position = self._position(pose)
        source = self._heard[self._source]
        if position not in source.traced:
            source = replace(source, traced=self._trace(source, position))
            self._heard[self._source] = source
        found = source.traced[position]
        if not found.pressure.any():
            raise self._nothing_heard(position)
        return found

    def early(self, pose: Pose) -> Arrivals:
        """The direct sound and the specular reflections at a pose, without a trace; those of `arrivals`.

        Raises:
            Avs3dError: if the session is closed, or the listener is outside the scene.
        """
        self._check_open()
        return early_arrivals(self._surfaces, self._heard[self._source].images, np.array(self._position(pose)))

    def impulse_response(self, pose: Pose) -> NDArray[np.float32]:
        """Response (channels, n) float32 of the receiver at the session's sample rate.

        Raises:
            Avs3dError: as `arrivals`.
        """
        response: NDArray[np.float32] = self._receiver.response(
            self.arrivals(pose), pose.rotation_matrix, self.sample_rate
        )
        return response

    def other_responses(self, pose: Pose) -> dict[str, NDArray[np.float32]]:
        """Name of each receiver beside the first → its response (channels, n) float32, from the same arrivals.

        Raises:
            Avs3dError: as `arrivals`.
        """
        if not self._others:
            return {}
        arrivals, rotation = self.arrivals(pose), pose.rotation_matrix
        return {name: one.response(arrivals, rotation, self.sample_rate) for name, one in self._others.items()}

    def close(self) -> None:
        """Free the arrivals and the scene."""
        self._heard.clear()
        self._announced, self._closed = [], True

    def _check_open(self) -> None:
        if self._closed:
            raise Avs3dError(f"{self._scene}: the acoustic session is closed; open a new one")

    def _position(self, pose: Pose) -> Position:
        x, y, z = checked_position(self._scene, "listener", pose.position, self._bounds)
        return x, y, z

    def _images(self, source: NDArray[np.float64], emission: Emission) -> Images:
        settings = self._settings
        return images_of(self._surfaces, source, settings.early_order, settings.seed, emission=emission)

    def _nothing_heard(self, position: Position) -> Avs3dError:
        return Avs3dError(
            f"{self._scene}: no sound reaches listener {position} from source "
            f"{self._source.position}; the listener is enclosed by faces without an opening"
        )

    def _batch(self, position: Position) -> list[Position]:
        """``position`` and, if it was announced, those announced after it.

        Raises:
            Avs3dError: if one of them, or the source, is in a closed body that the other is not in.
        """
        batch = [position]
        if position in self._announced:
            first = self._announced.index(position)
            batch = self._announced[first : first + self._together]
        for each in batch:
            self._heard[self._source].enclosure.check_listener(np.array(each))
        return batch

    def _trace(self, source: _Source, position: Position) -> dict[Position, Arrivals]:
        """Trace the arrivals at ``position`` and at the others of its batch."""
        batch = self._batch(position)
        listeners = np.array(batch)
        late = trace(self._surfaces, source.images, listeners, self._settings, self.rays, self._threads)
        found = {}
        for key, listener, tail in zip(batch, listeners, late, strict=True):
            if self._settings.fixed_carriers:
                far = float(np.linalg.norm(listener - source.images.source))
                tail = on_carriers(tail, far / SPEED_OF_SOUND, self._settings.seed)
            parts = [early_arrivals(self._surfaces, source.images, listener), tail]
            if self._settings.diffraction:
                parts.insert(1, diffracted(self._surfaces, source.edges, listener))
            found[key] = Arrivals.joined(parts)
        return found
