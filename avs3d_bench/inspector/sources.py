"""The sound of an observation in the viewer: its sources, its background, and the siblings of its group.

In part_1 and part_2 that is one source that always sounds. In part_3 colours belong to instances: an instance that
sounds in one sibling and is silent in the next keeps its colour, so that siblings can be compared.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AudibleRecord, BackgroundRecord, ObservationRecord, SourceRecord
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import direction_to
from avs3d_bench.inspector import pictures
from avs3d_bench.inspector.links import check_link
from avs3d_bench.inspector.pictures import SOUNDING
from avs3d_bench.text.templates import words

Colour = tuple[int, int, int]
#: RGB of sources, after Okabe & Ito (2008) and IBM's palette; without the blues of predictions and of the agent.
SOURCE_COLOURS: tuple[Colour, ...] = (
    SOUNDING, (0, 158, 115), (204, 121, 167), (230, 159, 0), (150, 96, 48), (120, 94, 240)
)  # fmt: skip
#: RGB of objects that never sound.
SILENT_COLOUR: Colour = (120, 126, 134)
SILENCE = "silence"
#: What the sound of an observation is made of; it can be several of these.
SEVERAL, ONE, OFF_SCREEN, NO_SOURCE, BACKGROUND = "several", "one", "off-screen", "silence", "background"
SOUND_KINDS = {
    ONE: "one source",
    SEVERAL: "several sources",
    OFF_SCREEN: "off-screen",
    NO_SOURCE: "no source",
    BACKGROUND: "background",
}


@dataclass(frozen=True)
class ShownSource:
    """One source, as it is shown.

    Attributes:
        record: its entry in observation.json.
        name: ``microwave``, with its instance's id where the room has several, or its room where it is off-screen.
        colour: RGB in lanes, masks and maps.
        spans: [start, end) in seconds in which it sounds, within the observation's time.
        heard: for each frame its entry in `audible`; None where it has none: not audible, or in part_1 and part_2.
        places: where it is in each frame, (x, y, z) metres.
        azimuth: of the source in each frame, degrees, 0 ahead, positive right; None without a pose.
        distance: to the source in each frame, metres; None without a pose.
    """

    record: SourceRecord
    name: str
    colour: Colour
    spans: tuple[tuple[float, float], ...]
    heard: tuple[AudibleRecord | None, ...]
    places: tuple[tuple[float, float, float], ...]
    azimuth: tuple[float | None, ...]
    distance: tuple[float | None, ...]

    @property
    def off_screen(self) -> bool:
        """Whether it is in another room."""
        return self.record.instance is None

    @property
    def always(self) -> bool:
        """Whether it has sounded since before the first frame and never stops."""
        return len(self.record.programme) == 1 and self.record.programme[0][0] < 0 and self.spans != ()

    @property
    def programme(self) -> str:
        """``always``, or its intervals in seconds."""
        if self.always:
            return "always"
        return (
            ", ".join(f"{round(start, 2):g}–{round(end, 2):g} s" for start, end in self.spans)
            or "never within the frames"
        )

    @property
    def audible(self) -> int:
        """In how many frames it is audible."""
        return sum(entry is not None for entry in self.heard)


@dataclass(frozen=True)
class ShownSound:
    """The sound of an observation.

    Attributes:
        always: whether it is one source that always sounds, as in part_1 and part_2: then it is shown by its place and
            its mask; else each source has a lane, a colour and a name of its own.
        title: what sounds, see `sound_title`.
        kinds: those of `SOUND_KINDS` that it is.
        sources: in the order of their ids.
        background: diffuse sound without a source, or None.
        stems: whether the clips of the sources are in the dataset.
        colours: instance id → RGB.
        names: instance id → name.
    """

    always: bool
    title: str
    kinds: tuple[str, ...]
    sources: tuple[ShownSource, ...]
    background: BackgroundRecord | None
    stems: bool
    colours: dict[int, Colour]
    names: dict[int, str]

    @property
    def stem_names(self) -> tuple[str, ...]:
        """Folders below `stems/`, in the order of the lanes; none without stems."""
        if not self.stems:
            return ()
        return (*(s.record.id for s in self.sources), *((layout.BACKGROUND,) if self.background else ()))

    @property
    def nothing(self) -> str:
        """Words for frames without an audible source."""
        return without_source(self.background)

    def audible(self, number: int) -> tuple[ShownSource, ...]:
        """The sources that are audible in frame ``number``."""
        return tuple(source for source in self.sources if source.heard[number] is not None)


@dataclass(frozen=True)
class SiblingLink:
    """An observation of the same group.

    Attributes:
        key: of it.
        index: last part of the key.
        title: what sounds.
        kinds: those of `SOUND_KINDS` that it is.
    """

    key: str
    index: int
    title: str
    kinds: tuple[str, ...]


def instance_colours(record: ObservationRecord) -> dict[int, Colour]:
    """Instance id → RGB; the same in all siblings of a group."""
    if record.sources is None:
        return pictures.instance_colours([instance.id for instance in record.instances], record.sounding.id)
    could_sound = sorted(i.id for i in record.instances if i.category in record.class_ids)
    ranked = {number: SOURCE_COLOURS[rank % len(SOURCE_COLOURS)] for rank, number in enumerate(could_sound)}
    return {instance.id: ranked.get(instance.id, SILENT_COLOUR) for instance in record.instances}


def source_colours(record: ObservationRecord) -> dict[str, Colour]:
    """Source id → RGB: that of its instance; sources of other rooms take what is left, from the end of the palette."""
    of_instances = instance_colours(record)
    found: dict[str, Colour] = {}
    for source in record.sound_sources:
        if source.instance is not None:
            found[source.id] = of_instances[source.instance]
    free = [colour for colour in reversed(SOURCE_COLOURS) if colour not in found.values()] or [*SOURCE_COLOURS]
    away = [source.id for source in record.sound_sources if source.instance is None]
    return found | {name: free[number % len(free)] for number, name in enumerate(away)}


def source_names(record: ObservationRecord) -> dict[str, str]:
    """Source id → name: the category, with the instance's id where the room has several of it.

    A source of another room has that room's name.
    """
    of_instances = instance_names(record)
    return {
        source.id: f"{words(source.category)}, {words(source.room)}"
        if source.instance is None
        else of_instances[source.instance]
        for source in record.sound_sources
    }


def instance_names(record: ObservationRecord) -> dict[int, str]:
    """Instance id → its category; in part_3 with the id where the room has several of that category."""
    if record.sources is None:
        return {instance.id: words(instance.category) for instance in record.instances}
    count = Counter(instance.category for instance in record.instances)
    return {
        i.id: f"{words(i.category)} #{i.id}" if count[i.category] > 1 else words(i.category) for i in record.instances
    }


def sound_title(record: ObservationRecord) -> str:
    """The sounding sources in a few words: ``microwave #3``, ``telephone, off-screen``, ``2 sources``, ``silence``."""
    sources = record.sound_sources
    if len(sources) > 1:
        return f"{len(sources)} sources"
    if sources:
        alone = sources[0]
        return source_names(record)[alone.id] if alone.instance is not None else f"{words(alone.category)}, off-screen"
    nothing = without_source(record.background)
    return f"{nothing}, room tone" if record.background and nothing == SILENCE else nothing


def without_source(background: BackgroundRecord | None) -> str:
    """Words for seconds without an audible source: ``silence``, of which room tone is a part, or ``noise alone``."""
    return "noise alone" if background is not None and background.kind == "noise" else SILENCE


def sound_kinds(record: ObservationRecord) -> tuple[str, ...]:
    """Those of `SOUND_KINDS` that the sound of an observation is."""
    sources = record.sound_sources
    found = [NO_SOURCE if not sources else ONE if len(sources) == 1 else SEVERAL]
    found += [OFF_SCREEN] if any(source.instance is None for source in sources) else []
    return (*found, *((BACKGROUND,) if record.background else ()))


def read_sound(observation: Observation) -> ShownSound | None:
    """Read the sources of an observation; None in the official release, which does not tell them.

    Raises:
        Avs3dError: if observation.json is damaged.
    """
    record = observation.record
    if record is None:
        return None
    return ShownSound(
        always=record.sources is None,
        title=sound_title(record),
        kinds=sound_kinds(record),
        sources=_shown_sources(observation, record),
        background=record.background,
        stems=record.sources is not None and (observation.path / layout.STEMS).is_dir(),
        colours=instance_colours(record),
        names=instance_names(record),
    )


def _shown_sources(observation: Observation, record: ObservationRecord) -> tuple[ShownSource, ...]:
    colours, names = source_colours(record), source_names(record)
    length = float(len(observation.frames))
    records = [frame.record for frame in observation.frames]
    entries = [{entry.source: entry for entry in r.audible or ()} if r else {} for r in records]
    sources = []
    for source in record.sound_sources:
        places = [record.source_at(r, source) if r else source.position for r in records]
        directions = [
            direction_to(frame.pose, place) if frame.has_pose else None
            for frame, place in zip(observation.frames, places, strict=True)
        ]
        spans = ((max(0.0, start), min(length, end)) for start, end in source.programme)
        sources.append(
            ShownSource(
                record=source,
                name=names[source.id],
                colour=colours[source.id],
                spans=tuple((start, end) for start, end in spans if start < end),
                heard=tuple(frame.get(source.id) for frame in entries),
                places=tuple(places),
                azimuth=tuple(d.azimuth if d else None for d in directions),
                distance=tuple(d.distance if d else None for d in directions),
            )
        )
    return tuple(sources)


def stem_levels(observation: Observation, sound: ShownSound) -> tuple[dict[str, list[float | None]], list[str]]:
    """The level of every stem in every frame, dB re full scale, as `audible` defines it.

    Returns:
        name of the stem → level of each frame (None for silence, and for a clip that cannot be read); and one line for
        each clip that cannot be read.
    """
    levels: dict[str, list[float | None]] = {}
    problems: list[str] = []
    for name in sound.stem_names:
        levels[name] = []
        for frame in observation.frames:
            power = 0.0
            try:
                power = float(np.mean(np.square(frame.stem(name), dtype=np.float64)))
            except Avs3dError as error:
                problems.append(str(error))
            levels[name].append(10 * math.log10(power) if power > 0 else None)
    return levels, problems


def find_siblings(dataset: Dataset, keys: Sequence[str], observation: Observation) -> tuple[SiblingLink, ...]:
    """All siblings among ``keys``, the observation itself included, by index; none if it is alone.

    Those whose observation.json is damaged are left out: the gallery names them.
    """
    record = observation.record
    if record is None or record.group is None:
        return ()
    room = observation.key.rpartition("/")[0]
    found = []
    for key in keys:
        if key.rpartition("/")[0] != room:
            continue
        with suppress(Avs3dError):
            check_link(dataset.root / key / layout.OBSERVATION_JSON, dataset.root)
            other = observation if key == observation.key else dataset[key]
            if other.record is not None and other.record.group == record.group:
                found.append(SiblingLink(key, other.record.index, sound_title(other.record), sound_kinds(other.record)))
    return tuple(sorted(found, key=lambda sibling: sibling.index)) if len(found) > 1 else ()
