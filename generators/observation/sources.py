"""The sources of an observation: which objects sound, where, when, and what they play."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.schema import Room
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose
from generators.acoustics.directivity import Directivity
from generators.acoustics.radiators import modelled
from generators.assets.sounds import (
    enough,
    load_sound,
    recorded_seconds,
    stretches,
    stretches_in,
    synthesise,
    usual_voices,
)
from generators.core.freespace import FreeSpace
from generators.core.scene import Licence, Scene
from generators.library import open_asset
from generators.manifest.schema import SoundSpec, SourceSpec
from generators.observation.arrangement import Arrangement, draw_instances, file_licence
from generators.observation.hearing import PRE_ROLL
from generators.observation.parts import rules_of
from generators.observation.programme import Interval, gated, intervals_of
from generators.plan import ObservationPlan, derive_rng, resolve_file

Vector = tuple[float, float, float]

#: Height of an off-screen source above the floor (m), about that of a table top or a person's mouth.
OFF_SCREEN_HEIGHT = 1.2
#: Signals that are kept for variants; one of 120 s takes 21 MB.
MOST_SIGNALS = 3


@dataclass(frozen=True, eq=False)
class SourceSignal:
    """The signal of a source: mono samples at the benchmark's sample rate, and their origin."""

    samples: NDArray[np.float32]
    asset: str
    licence: Licence


@dataclass(frozen=True, eq=False)
class SoundSource:
    """A source of an observation.

    Attributes:
        id: ``source_1``, …
        category: what it is.
        instance: id of the instance that sounds; None: off-screen.
        room: where it is.
        path: (x, y, z) metres, at the beginning of each second and at the end; of one that stands still, one position.
        intervals: when it sounds, seconds from the first frame.
        gain_db: level re the common loudness.
        signal: what it plays while it sounds.
        yaws: how its object is turned about +Y at the times of ``path`` (radians).
        directivity: in the object's frame; None: alike in all directions.
        directivity_licence: of the file that it is from, if it is from one.
    """

    id: str
    category: str
    instance: int | None
    room: Room
    path: tuple[Vector, ...]
    intervals: tuple[Interval, ...]
    gain_db: float
    signal: SourceSignal
    yaws: tuple[float, ...] = (0.0,)
    directivity: Directivity | None = None
    directivity_licence: Licence | None = None

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Where it is and how its object is turned, at the times of ``path``."""
        return tuple(Pose.from_yaw(place, yaw) for place, yaw in zip(self.path, self.yaws, strict=True))

    @property
    def position(self) -> Vector:
        """Where it is at time 0 (m)."""
        return self.path[0]

    def position_at(self, second: int) -> Vector:
        """Where it is at the beginning of a second (m)."""
        return self.path[second] if len(self.path) > 1 else self.path[0]

    @property
    def samples(self) -> NDArray[np.float32]:
        """(n,) its signal from `PRE_ROLL` seconds before the first frame on: 0 where it does not sound."""
        scale = np.float32(10 ** (self.gain_db / 20))
        return gated(self.signal.samples * scale, self.intervals, PRE_ROLL)


def choose_sources(plan: ObservationPlan, home: Scene, arrangement: Arrangement) -> tuple[SoundSource, ...]:
    """The sources of a plan.

    In all siblings the n-th off-screen source of a room is at the same place; what a source plays is its own in each of
    them. Instances that the manifest does not name are drawn among those that no other source takes.

    Raises:
        Avs3dError: if a room does not exist or has no free floor, or a recording is missing or broken.
    """
    placements = arrangement.placements
    moving = {motion.index + 1: motion.seconds for motion in arrangement.motions}
    instances = draw_instances(plan, [placement.model.category for placement in placements])
    of_category: Counter[str] = Counter()
    of_room: Counter[str] = Counter()
    sources = []
    for number, (spec, instance) in enumerate(zip(plan.spec.sounding, instances, strict=True), start=1):
        of_category[spec.category] += 1
        path: tuple[Vector, ...]
        yaws: tuple[float, ...] = (0.0,)
        if instance is None:
            assert spec.room is not None
            room = spec.room
            of_room[room] += 1
            path = (_off_screen(plan, home, room, of_room[room]),)
        else:
            room = plan.spec.room
            places = moving.get(instance, (placements[instance - 1],))
            path = tuple(place.source_position for place in places)
            yaws = tuple(float(place.yaw) for place in places)
        seconds = float(plan.camera.frames)
        bursts = spec.programme.bursts if spec.programme else None
        rng = plan.rng(f"programme/{number}/{bursts.seed if bursts else 0}")
        sources.append(
            SoundSource(
                id=f"source_{number}",
                category=spec.category,
                instance=instance,
                room=room,
                path=path,
                intervals=intervals_of(spec.programme, seconds, PRE_ROLL, rng),
                gain_db=spec.gain_db + drawn_level(plan, spec.category, of_category[spec.category]),
                signal=choose_signal(plan, spec.category, of_category[spec.category]),
                yaws=yaws,
                directivity=choose_directivity(plan, spec),
                directivity_licence=_licence_of_directivity(plan, spec),
            )
        )
    return tuple(sources)


def choose_directivity(plan: ObservationPlan, source: SourceSpec) -> Directivity | None:
    """The directivity of a source in its object's frame; None: it is alike in all directions.

    Raises:
        Avs3dError: if its file is missing or wrong.
    """
    chosen = plan.spec.directivity_of(source)
    if chosen.file is not None:
        return _directivity_file(resolve_file(plan.base, chosen.file, f"directivity of {source.category}"))
    if chosen.cardioid is not None:
        return Directivity.cardioid(chosen.cardioid, chosen.axis, omni_share=chosen.omni_share)
    return modelled(source.category) if chosen.word == "auto" else None


def _licence_of_directivity(plan: ObservationPlan, source: SourceSpec) -> Licence | None:
    chosen = plan.spec.directivity_of(source)
    if chosen.file is None or chosen.licence is None:
        return None
    return Licence(chosen.licence.name, chosen.licence.author, chosen.licence.source or chosen.file)


@lru_cache(maxsize=4)
def _directivity_file(path: Path) -> Directivity:
    return Directivity.file(path)


def drawn_level(plan: ObservationPlan, category: str, nth: int = 1) -> float:
    """The level (dB) that is drawn from the manifest's ``levels`` for the ``nth`` source of a category; 0 without them.

    A constant loudness would tell how far away a source is; the level belongs to a take, as what it plays does.
    """
    if plan.levels is None:
        return 0.0
    stream = rules_of(plan.spec.part).signal_stream.format(category=category, nth=nth)
    return round(float(plan.own_rng(f"{stream}/level").uniform(*plan.levels)), 1)


def choose_signal(plan: ObservationPlan, category: str, nth: int = 1) -> SourceSignal:
    """The signal of the ``nth`` source of a category, as long as the observation and the pre-roll before it.

    Siblings never share a take, and nor do twins in one observation: who finds the same samples in two clips knows
    what sounds without listening, and two sources in step would be one coherent source with two places.

    Raises:
        Avs3dError: if a recording is missing or broken.
    """
    rules, seconds = rules_of(plan.spec.part), plan.camera.frames + PRE_ROLL
    stream = rules.signal_stream.format(category=category, nth=nth)
    entries = plan.sounds.get(category, ())
    if not entries:
        names = plan.voices.get(category) or usual_voices(category)
        voice = names[int(plan.own_rng(f"{stream}/voice").integers(len(names)))] if names else None
        return _synthesised(plan.seed, plan.own_key, stream, category, seconds, voice)
    if not rules.in_takes:
        return sound_file(plan, category, entries[int(plan.own_rng(stream).integers(len(entries)))]).signal(seconds)
    files, lengths = _recordings(plan, category)
    takes = plan.takes[category]
    number, start = stretches(lengths, seconds, takes.of, plan.rng(f"takes/{category}"))[takes.first + nth - 1]
    return files[number].signal(seconds, start)


@dataclass(frozen=True)
class SoundFile:
    """A recording that the manifest names: its file, and its origin."""

    path: Path
    asset: str
    licence: Licence
    trim: tuple[float, float] | None = None

    @property
    def seconds(self) -> float:
        """Length of what is used of it (s)."""
        return recorded_seconds(self.path, self.trim)

    def signal(self, seconds: float, start: float = 0.0) -> SourceSignal:
        """The recording as a signal of so many seconds; ``start``: see `load_sound`."""
        samples = load_sound(self.path, seconds, start=start, trim=self.trim)
        return SourceSignal(samples, self.asset, self.licence)


def sound_file(plan: ObservationPlan, category: str, spec: SoundSpec) -> SoundFile:
    """The file of an entry of the manifest's ``sounds``.

    Raises:
        Avs3dError: if it is missing.
    """
    if spec.asset is not None:
        path, entry = open_asset(plan.lock, spec.asset)
        licence = entry.terms
        return SoundFile(path, entry.id, licence, entry.trim)
    path = resolve_file(plan.base, str(spec.file), f"sound for {category}")
    return SoundFile(path, str(spec.file), file_licence(spec))


def _recordings(plan: ObservationPlan, category: str) -> tuple[list[SoundFile], list[float]]:
    """The recordings of a category, each once, and their lengths (s)."""
    files = [sound_file(plan, category, spec) for spec in plan.sounds.get(category, ())]
    files = list({file.path: file for file in files}.values())
    return files, [file.seconds for file in files]


def check_takes(plans: Iterable[ObservationPlan]) -> None:
    """Refuse recordings that do not reach for a stretch for each take of a group.

    Raises:
        UsageError: one line: siblings would share samples, and a comparison of their clips would tell what sounds.
        Avs3dError: if a recording is missing or broken.
    """
    for plan in plans:
        seconds = plan.camera.frames + PRE_ROLL
        for category, takes in plan.takes.items():
            lengths = _recordings(plan, category)[1]
            if not enough(lengths, seconds, takes.of):
                raise UsageError(
                    f"{plan.spec.like or plan.key}: {takes.of} sources of {category} in the siblings, but its "
                    f"recordings have {stretches_in(lengths, seconds)} stretches of {seconds} s: comparing clips would "
                    "tell what sounds; name more or longer recordings, or make shorter observations (--frames)"
                )


@lru_cache(maxsize=MOST_SIGNALS)
def _synthesised(
    seed: int, key: str, stream: str, category: str, seconds: int, voice: str | None = None
) -> SourceSignal:
    """A procedural signal: variants play the same ones, and often follow one another in a process."""
    samples = synthesise(category, seconds, derive_rng(seed, key, stream), voice)
    samples.setflags(write=False)
    asset = f"procedural:{category}" + (f"/{voice}" if voice else "")
    return SourceSignal(samples, asset, Licence(source="synthesised"))


def _off_screen(plan: ObservationPlan, home: Scene, room: str, nth: int) -> Vector:
    """A point above the free floor of another room, for the ``nth`` source in it.

    Raises:
        Avs3dError: if the room does not exist, or has no free floor.
    """
    space = FreeSpace.of(home, room)
    points = space.points
    if not len(points):
        raise Avs3dError(f"{home.name}/{room}: no free floor for an off-screen source; name another room")
    x, z = points[int(plan.rng(f"off-screen/{room}/{nth}").integers(len(points)))].tolist()
    return x, space.floor + OFF_SCREEN_HEIGHT, z
