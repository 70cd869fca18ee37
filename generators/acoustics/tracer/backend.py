"""The tracer behind the `AcousticBackend` protocol."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__
from avs3d_bench.errors import Avs3dError
from generators.acoustics.base import Place
from generators.acoustics.directivity import Directivity
from generators.acoustics.geometry import SPEED_OF_SOUND, AcousticMesh, checked_scale
from generators.acoustics.materials import RESIDUAL
from generators.acoustics.tracer import air, transmission
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.diffraction import diffracted, lit_edges
from generators.acoustics.tracer.early import Images, early_arrivals, images_of
from generators.acoustics.tracer.late import trace
from generators.acoustics.tracer.session import TracerSession
from generators.acoustics.tracer.settings import TraceSettings
from generators.acoustics.tracer.surfaces import AcousticSurfaces, surfaces_of
from generators.core.cuda import cuda_version, require_device
from generators.core.scene import Scene

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar
    from generators.acoustics.tracer.receivers.base import Receiver

#: What traces and makes responses.
DEVICES = ("cpu", "cuda")
#: Threads that a trace may use.
_MOST_THREADS = 256


class TracerBackend:
    """Impulse responses by geometric acoustics; responses of other receivers from the same trace.

    Args:
        receiver: of `AcousticSession.impulse_response`; a spherical head if missing.
        settings: how much work a trace is worth.
        absorption_scale: factor of every surface's Eyring exponent, −ln(1 − α).
        threads: of a trace on the CPU; the responses do not depend on it.
        others: name → receiver of `TracerSession.other_responses`.
        device: ``cpu`` or ``cuda``. Arrivals agree to rounding; a response has other bytes on another kind of device.
        seed: of the rays; None: that of ``settings``.
    """

    name = "tracer"
    version = __version__

    def __init__(
        self,
        receiver: Receiver | None = None,
        settings: TraceSettings | None = None,
        *,
        absorption_scale: float = 1.0,
        threads: int = 1,
        others: Mapping[str, Receiver] | None = None,
        device: str = "cpu",
        seed: int | None = None,
    ) -> None:
        """Check the arguments.

        Raises:
            Avs3dError: if one is out of range, or the device cannot be used.
        """
        if receiver is None:
            from generators.acoustics.tracer.receivers.spherical import SphericalHead

            receiver = SphericalHead()
        if not 1 <= threads <= _MOST_THREADS:
            raise Avs3dError(f"tracer: threads is {threads}, expected 1 to {_MOST_THREADS}")
        self.receiver: Receiver = receiver
        self.others = dict(others or {})
        self.settings = settings or TraceSettings()
        if seed is not None:
            self.settings = replace(self.settings, seed=seed)
        self.absorption_scale = checked_scale(absorption_scale)
        self.threads = threads
        if device not in DEVICES:
            raise Avs3dError(f"tracer: device is {device!r}, expected {' or '.join(DEVICES)}")
        if device == "cuda":
            if self.settings.fixed_carriers:
                raise Avs3dError("tracer: fixed_carriers is for device='cpu'; on cuda the rays are heard one by one")
            require_device()
        self.device = device

    def open(
        self,
        scene: Scene,
        source: Place,
        *,
        room: str,
        sample_rate: int = 44_100,
        directivity: Directivity | None = None,
    ) -> TracerSession:
        """Load ``scene`` with a source at ``source`` (world, metres) standing in ``room``.

        A scene without acoustic faces is a free field. A mesh may be open: what leaves it is gone.

        Raises:
            Avs3dError: if a coordinate is not finite, the source lies outside the scene or is walled in, there is no
                such room, or the sample rate is out of range.
        """
        if not 8000 <= sample_rate <= 192_000:
            raise Avs3dError(f"{scene.name}: sample rate {sample_rate!r} Hz, expected 8000 to 192000")
        kind = TracerSession
        if self.device == "cuda":
            from generators.acoustics.tracer.device.session import DeviceSession

            kind = DeviceSession
        return kind(
            scene,
            source,
            room,
            sample_rate,
            receiver=self.receiver,
            others=self.others,
            settings=self.settings,
            absorption_scale=self.absorption_scale,
            threads=self.threads,
            directivity=directivity,
        )

    def describe(self) -> dict[str, Scalar]:
        """The settings that go into observation.json."""
        return {
            "backend": self.name,
            "version": self.version,
            "licence": "Apache-2.0",
            **self.receiver.describe(),
            **self.settings.described(),
            "speed_of_sound_m_s": SPEED_OF_SOUND,
            "air_temperature_c": air.TEMPERATURE,
            "air_humidity_percent": air.HUMIDITY,
            "residual_absorption": RESIDUAL,
            "wall_mass_kg_m2": transmission.SURFACE_MASS,
            "transmitting_walls": transmission.MOST_WALLS,
            **({} if self.absorption_scale == 1 else {"absorption_scale": self.absorption_scale}),
            **({} if self.device == "cpu" else {"device": f"{self.device}: {cuda_version()}"}),
        }

    def warm_up(self) -> None:
        """Compile all kernels, or load them from the cache, once, before workers start.

        Traces one ray. Processes that come at the same time wait for the first one and load its work.

        Raises:
            Avs3dError: if a package of ``[generate]`` is missing or no folder for compiled code can be written.
        """
        from generators.core.jit import compile_lock

        # A sheet between source and listener: reflected, diffracted and transmitted sound.
        corners = np.array([[0.0, 0.0, -3.0], [0.0, 0.0, 3.0], [0.0, -4.0, 0.0]])
        source, listener = np.array([-1.0, -0.5, 0.0]), np.array([1.0, -0.5, 0.0])
        few = TraceSettings(rain_rays=1, most_reflections=1)
        with compile_lock(f"sound-{self.device}"):
            surfaces = surfaces_of(AcousticMesh(corners, {"wood": np.array([[0, 1, 2]])}))
            surfaces.first_hits(source[None], np.array([[1.0, 0.0, 0.0]]))
            images = images_of(surfaces, source, few.early_order, few.seed)
            bent = diffracted(surfaces, lit_edges(surfaces.edges, source), listener)
            if self.device == "cuda":
                self._warm_up_device(surfaces, images, listener, few, bent)
            else:
                found = [
                    early_arrivals(surfaces, images, listener),
                    bent,
                    *trace(surfaces, images, listener[None], few, 1),
                ]
                for receiver in (self.receiver, *self.others.values()):
                    receiver.response(Arrivals.joined(found), np.eye(3), 44_100)

    def _warm_up_device(
        self,
        surfaces: AcousticSurfaces,
        images: Images,
        listener: NDArray[np.float64],
        few: TraceSettings,
        bent: Arrivals,
    ) -> None:
        from generators.acoustics.tracer.device.binaural import DeviceEars
        from generators.acoustics.tracer.device.ears import BinauralReceiver
        from generators.acoustics.tracer.device.trace import DeviceScene

        scene = DeviceScene(surfaces, few, 1)
        images_of(surfaces, images.source, few.early_order, few.seed, scene.search)
        found = scene.trace(images, listener[None], lambda _: [bent])
        on_host = list(self.others.values())
        if isinstance(self.receiver, BinauralReceiver):
            found.responses(DeviceEars(self.receiver.ears(44_100), 44_100), [0], [np.eye(3)])
        else:
            on_host.append(self.receiver)
        for receiver in on_host:
            receiver.response(found.arrivals()[0], np.eye(3), 44_100)
