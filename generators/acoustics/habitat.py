"""habitat-sim's audio sensor on our engines, for code that was written for SoundSpaces 2.0.

::

    spec = habitat.AudioSensorSpec()
    spec.channelLayout.channelType, spec.channelLayout.channelCount = habitat.ChannelLayoutType.Binaural, 2
    spec.acousticsConfig.sampleRate = 48000
    sensor = habitat.AudioSensor(spec, room)
    sensor.setAudioSourceTransform([3.1, 1.5, -4.2])
    sensor.setAudioListenerTransform([1.0, 1.5, -2.0], [1, 0, 0, 0])
    sensor.runSimulation(sim)                        # sim: of habitat-sim, or None
    response = np.array(sensor.getIR())              # (channels, n)

Names, axes (Y up, facing −Z, quaternions (w, x, y, z)) and the shape of the response are those of habitat-sim 0.2.2
(docs/AUDIO.md there, `Simulator._get_audio_observation`); its audio needs a build of its own, this does not. Of the
configuration, ``sampleRate``, ``globalVolume``, ``unitScale``, ``direct``, ``indirect`` and ``diffraction`` act; what
counts rays or bands is the engine's business and has no effect.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.geometry import Pose
from generators.acoustics.engines import Engine, Tracer
from generators.acoustics.rir import Rir
from generators.acoustics.rooms import Room
from generators.acoustics.tracks import as_pose

if TYPE_CHECKING:
    from generators.acoustics.tracer.receivers.base import Receiver


class ChannelLayoutType(Enum):
    """habitat-sim's ``RLRAudioPropagationChannelLayoutType``, those that name a receiver of ours.

    Examples:
        >>> ChannelLayoutType.Ambisonics.value
        'ambisonics'
    """

    Mono = "mono"
    Binaural = "binaural"
    Ambisonics = "ambisonics"


@dataclass
class ChannelLayout:
    """habitat-sim's ``RLRAudioPropagationChannelLayout``: 1 channel, 2 ears, or (order + 1)² of Ambisonics.

    Attributes:
        channelType: what hears.
        channelCount: number of channels.

    Examples:
        >>> layout = ChannelLayout(ChannelLayoutType.Ambisonics, 4)  # first order
        >>> AudioSensorSpec(channelLayout=layout).channelLayout.channelCount
        4
    """

    channelType: ChannelLayoutType = ChannelLayoutType.Binaural  # noqa: N815
    channelCount: int = 2  # noqa: N815


@dataclass
class AcousticsConfiguration:
    """habitat-sim's ``RLRAudioPropagationConfiguration`` with its defaults, those settings that act here.

    Attributes:
        sampleRate: Hz.
        globalVolume: factor of the samples.
        unitScale: metres in a unit of the mesh and of the poses.
        direct, indirect, diffraction: whether these paths are heard.

    Examples:
        >>> config = AcousticsConfiguration(sampleRate=48_000)
        >>> config.threadCount = 4  # habitat-sim's code runs; this engine has no such setting
        >>> config.sampleRate, config.ignored
        (48000, {'threadCount': 4})
    """

    sampleRate: int = 44_100  # noqa: N815
    globalVolume: float = 0.25  # noqa: N815
    unitScale: float = 1.0  # noqa: N815
    direct: bool = True
    indirect: bool = True
    diffraction: bool = True
    #: Settings of the other engine, which may be set and have no effect.
    ignored: dict[str, Any] = field(default_factory=dict, repr=False)

    def __setattr__(self, name: str, value: Any) -> None:
        """Keep what habitat-sim has and this has not, so that its code runs."""
        if name in _IGNORED:
            self.ignored[name] = value
        elif name in self.__dataclass_fields__:
            super().__setattr__(name, value)
        else:
            raise AttributeError(f"acousticsConfig has no {name!r}; see habitat-sim's docs/AUDIO.md")


_IGNORED = {
    *("frequencyBands", "directSHOrder", "indirectSHOrder", "threadCount", "updateDt", "irTime", "indirectRayCount"),
    *("indirectRayDepth", "sourceRayCount", "sourceRayDepth", "maxDiffractionOrder", "transmission", "dumpWaveFiles"),
    *("meshSimplification", "temporalCoherence", "enableMaterials", "writeIrToFile"),
}


@dataclass
class AudioSensorSpec:
    """habitat-sim's ``AudioSensorSpec``.

    Attributes:
        uuid, position, outputDirectory, enableMaterials: habitat-sim's code sets them; they have no effect here.
        acousticsConfig: settings of the simulation.
        channelLayout: what hears.

    Examples:
        >>> spec = AudioSensorSpec(uuid="ears", position=(0.0, 1.5, 0.0))
        >>> spec.acousticsConfig.sampleRate = 48_000
        >>> spec.channelLayout.channelCount
        2
    """

    uuid: str = "audio"
    position: ArrayLike = (0.0, 0.0, 0.0)
    outputDirectory: str = ""  # noqa: N815
    enableMaterials: bool = True  # noqa: N815
    acousticsConfig: AcousticsConfiguration = field(default_factory=AcousticsConfiguration)  # noqa: N815
    channelLayout: ChannelLayout = field(default_factory=ChannelLayout)  # noqa: N815


class AudioSensor:
    """Calls and results of habitat-sim's audio sensor.

    Args:
        spec: what to hear.
        stage: the room, or the file of the mesh, which then needs `setAudioMaterialsJSON` or is plaster all over.
        engine: None: `Tracer`.

    Raises:
        UsageError: if the channels have no receiver.

    Examples:
        >>> from generators.acoustics import Analytic
        >>> sensor = AudioSensor(AudioSensorSpec(), Room.shoebox((6, 2.7, 4)), Analytic())
        >>> sensor.setAudioSourceTransform([1, 1.5, 2])
        >>> sensor.setAudioListenerTransform([4, 1.5, 2], [1, 0, 0, 0])
        >>> sensor.runSimulation()
        >>> len(sensor.getIR())
        2
    """

    def __init__(self, spec: AudioSensorSpec, stage: Room | str | Path, engine: Engine | None = None) -> None:
        self.spec, self._stage, self._given = spec, stage, engine
        self._receiver = _receiver(spec.channelLayout)
        self._room: Room | None = None
        self._materials: Any = "plaster"
        self._source: Pose | None = None
        self._listener: Pose | None = None
        self._rir: Rir | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the last response."""
        self._rir = None

    def setAudioSourceTransform(self, source: ArrayLike) -> None:
        """Put the source at ``source`` (3,), metres."""
        self._source = as_pose(source, "source")

    def setAudioListenerTransform(self, position: ArrayLike, rotation: ArrayLike) -> None:
        """Put the listener at ``position`` (3,), metres, turned by the quaternion ``rotation`` (w, x, y, z)."""
        x, y, z = as_pose(position).position
        numbers = np.asarray(rotation, dtype=np.float64).reshape(-1)
        if numbers.shape != (4,):
            raise UsageError(f"listener: rotation is {excerpt(rotation)}, expected a quaternion (w, x, y, z)")
        a, b, c, d = (float(number) for number in numbers)
        self._listener = Pose((x, y, z), (a, b, c, d))

    def setAudioMaterialsJSON(self, path: str | Path) -> None:
        """Take the materials of SoundSpaces' file for a mesh given by its file; a `Room` keeps its own."""
        self._materials, self._room = Path(path), None

    def runSimulation(self, sim: Any = None) -> None:
        """Make the response; ``sim`` is there for code that passes it, and may be None.

        Raises:
            Avs3dError: as `Engine.response`, and if there is no source or listener yet.
        """
        if self._source is None or self._listener is None:
            raise Avs3dError("audio sensor: call setAudioSourceTransform and setAudioListenerTransform first")
        config, scale = self.spec.acousticsConfig, self.spec.acousticsConfig.unitScale
        source = replace(self._source, position=_scaled(self._source, scale))
        pose = replace(self._listener, position=_scaled(self._listener, scale))
        receiver = self._receiver if self._engine_hears_all() else None
        found = self._engine().response(self._opened(), source, pose, receiver, sample_rate=config.sampleRate)
        if not (config.direct and config.indirect):
            found = _parted(found, self._receiver, config)
        self._rir = replace(found, samples=(config.globalVolume * found.samples).astype(np.float32))

    def getIR(self) -> list[list[float]]:
        """The response, as habitat-sim gives it: one list of samples per channel.

        Raises:
            Avs3dError: if no simulation was run.
        """
        return [list(map(float, channel)) for channel in self.rir.samples]

    def get_observation(self) -> NDArray[np.float32]:
        """Run the simulation: (channels, n) float32, what ``np.array(sim.get_sensor_observations()[uuid])`` gives."""
        self.runSimulation()
        return self.rir.samples

    @property
    def rir(self) -> Rir:
        """The last response.

        Raises:
            Avs3dError: if no simulation was run.
        """
        if self._rir is None:
            raise Avs3dError("audio sensor: no response yet; call runSimulation first")
        return self._rir

    def sourceIsVisible(self) -> bool:
        """Whether nothing is between the source and the listener.

        Raises:
            Avs3dError: if there is no source or listener yet.
        """
        from generators.acoustics.geometry import blocked

        if self._source is None or self._listener is None:
            raise Avs3dError("audio sensor: call setAudioSourceTransform and setAudioListenerTransform first")
        ends = (np.array(self._listener.position), np.array(self._source.position))
        return not blocked(self._opened().triangles, *(self.spec.acousticsConfig.unitScale * end for end in ends))

    def _opened(self) -> Room:
        if isinstance(self._stage, Room):
            return self._stage
        if self._room is None:
            self._room = Room.from_mesh(self._stage, self._materials, scale=self.spec.acousticsConfig.unitScale)
        return self._room

    def _engine(self) -> Engine:
        if self._given is not None:
            return self._given
        from generators.acoustics.tracer.settings import TraceSettings

        return Tracer(settings=TraceSettings(diffraction=self.spec.acousticsConfig.diffraction))

    def _engine_hears_all(self) -> bool:
        """Whether the engine takes any receiver; the others have their own head."""
        return self._given is None or isinstance(self._given, Tracer) or self.spec.channelLayout.channelCount != 2


def _scaled(pose: Pose, scale: float) -> tuple[float, float, float]:
    x, y, z = pose.position
    return scale * x, scale * y, scale * z


def _receiver(layout: ChannelLayout) -> Receiver:
    """The receiver of a channel layout."""
    kind, count = layout.channelType, layout.channelCount
    if kind is ChannelLayoutType.Mono and count == 1:
        from generators.acoustics.tracer.receivers.microphones import Omni

        return Omni()
    if kind is ChannelLayoutType.Binaural and count == 2:
        from generators.acoustics.tracer.receivers.spherical import SphericalHead

        return SphericalHead()
    if kind is ChannelLayoutType.Ambisonics and count in (4, 9, 16):
        from generators.acoustics.tracer.receivers.ambisonics import Ambisonics

        return Ambisonics(round(count**0.5) - 1)
    raise UsageError(
        f"channelLayout: {getattr(kind, 'name', kind)} with {count} channels; expected Mono with 1, Binaural with 2, "
        "or Ambisonics with 4, 9 or 16"
    )


def _parted(rir: Rir, receiver: Receiver, config: AcousticsConfiguration) -> Rir:
    """The response with its direct sound alone, or without it.

    Raises:
        UsageError: if the engine does not tell single arrivals.
    """
    from generators.acoustics.geometry import SPEED_OF_SOUND
    from generators.acoustics.tracer.arrivals import Arrivals

    if rir.arrivals is None:
        raise UsageError("acousticsConfig: direct and indirect need the engine Tracer")
    found = rir.arrivals
    is_direct = found.is_spherical & (np.abs(found.time - rir.distance / SPEED_OF_SOUND) < 1e-6)
    keep = is_direct if config.direct else ~is_direct if config.indirect else np.zeros(len(found), dtype=bool)
    some = Arrivals(found.time[keep], found.direction[keep], found.pressure[keep], found.is_spherical[keep])
    samples = receiver.response(some, rir.listener.rotation_matrix, rir.sample_rate)
    return replace(rir, samples=samples, arrivals=some)
