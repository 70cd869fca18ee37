"""A manifest of plausible observations in homes that no excluded manifest uses: read `sample` top to bottom.

    seeds of the homes → units (an observation of part_1 or part_2, or a group of part_3), spread over homes and rooms
    → those that do not fit into their room are drawn again → entries of the manifest

All draws follow from the seed of the manifest. Each unit has a random stream of its own, and what is to be balanced
(rooms, categories, numbers of objects) is taken from what is rarest so far, so that no share is left to chance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import observation_key
from avs3d_bench.contract.taxonomy import OFF_SCREEN_CATEGORIES as _NO_CLASS
from avs3d_bench.errors import Avs3dError, UsageError
from generators.core.limits import SoundSplit
from generators.manifest.schema import Manifest
from generators.sampling.compositions import COMPOSITIONS, SHARES
from generators.sampling.excluded import Excluded
from generators.sampling.rooms import DISTRACTORS_IN, LOOK_ALIKE_SHARE, LOOK_ALIKES, MADE_BY, MOST, MOST_BESIDE

_T = TypeVar("_T")

#: Range of the seeds of homes; hand-written manifests and the surveys of benchmarks/ have smaller ones.
SEEDS = (1_000_000, 10_000_000)
#: Largest index of an observation in its room.
MOST_INDEX = 99
#: Index of the first sibling of a group: 1, 11, 21, … as in scenes_manifest/listen.yaml.
GROUP_STEP = 10
#: Share of the groups with a background, its kinds, and its level below the sources (dB).
BACKGROUND_SHARE, BACKGROUNDS, SNR_DB = 0.5, ("room_tone", "noise"), (10, 35)
#: How often a unit that does not fit into its room is drawn again.
MOST_DRAWS = 20


@dataclass(frozen=True)
class Wanted:
    """Options of `sample`.

    Attributes:
        homes, observations: numbers of them.
        seed: of the manifest, and of all draws.
        parts: which parts.
        groups: how the groups of part_3 are composed, a name in `COMPOSITIONS`.
        camera: fields of the manifest's camera.
        extra: other fields of the manifest, such as light and audio.
        hold_out_models: whether only training variants are drawn.
        sounds: the split whose voices are drawn; None: the manifest names no voices, unless some are held out.
        hold_out_sounds: whether the voices that an excluded manifest draws are left out of the split, by default train.
        version: of the manifest.
    """

    homes: int
    observations: int
    seed: int
    parts: tuple[str, ...] = tuple(SHARES)
    groups: str = "training"
    camera: dict[str, Any] = field(default_factory=lambda: {"size": 252, "frames": 24})
    extra: dict[str, Any] = field(default_factory=dict)
    hold_out_models: bool = False
    sounds: SoundSplit | None = None
    hold_out_sounds: bool = False
    version: str = "1.0.0"


@dataclass(frozen=True)
class SampledGroup:
    """Observations with the same pictures.

    Attributes:
        entries: of the manifest; the first gives the objects.
        kinds: of the entries, for the statistics.
    """

    entries: tuple[dict[str, Any], ...]
    kinds: tuple[str, ...]


def sample(
    wanted: Wanted, excluded: Excluded, misfits: Callable[[Manifest], Iterable[int]] = lambda _: ()
) -> tuple[dict[str, Any], tuple[SampledGroup, ...]]:
    """Draw a manifest.

    Args:
        wanted: what to sample.
        excluded: what other manifests use.
        misfits: the numbers of the units of a manifest that do not fit into their rooms; each unit is given to it as
            its first entry.

    Returns:
        The manifest as a document, checked, and its units in the same order.

    Raises:
        UsageError: if there are too few seeds, or more observations than the rooms take.
        Avs3dError: if a unit does not fit, however often it is drawn.
    """
    excluded.check_seed(wanted.seed)
    document: dict[str, Any] = {
        "name": f"sampled-{wanted.seed}",
        "version": wanted.version,
        "seed": wanted.seed,
        **wanted.extra,
        "camera": wanted.camera,
        "scans": draw_homes(wanted, excluded),
    }
    if wanted.hold_out_models:
        document["models"] = excluded.held_out_models()
    if wanted.sounds or wanted.hold_out_sounds:
        users = excluded if wanted.hold_out_sounds else Excluded({}, {}, {})
        document["voices"] = users.held_out_voices(wanted.sounds or "train")
    drawer = _Drawer(wanted, list(document["scans"]))
    units = [drawer.unit(number, *place) for number, place in enumerate(drawer.places())]
    waiting = list(range(len(units)))
    for draw in range(MOST_DRAWS):
        firsts = [units[number].entries[0] for number in waiting]
        waiting = [waiting[index] for index in misfits(Manifest.model_validate(document | {"observations": firsts}))]
        if not waiting:
            break
        if draw == MOST_DRAWS - 1:
            raise Avs3dError(
                f"{_key(units[waiting[0]].entries[0])}: no place in {MOST_DRAWS} draws; use another --seed"
            )
        for number in waiting:
            units[number] = drawer.again(number, units[number], draw)
    document["observations"] = [entry for unit in units for entry in unit.entries]
    Manifest.model_validate(document)
    return document, tuple(units)


def draw_homes(wanted: Wanted, excluded: Excluded) -> dict[str, dict[str, Any]]:
    """``scans`` of the manifest; the name of a home tells its seed, so that two samples never share a name.

    Raises:
        UsageError: if there are fewer free seeds than homes.
    """
    free = SEEDS[1] - SEEDS[0] - sum(SEEDS[0] <= seed < SEEDS[1] for seed in excluded.homes)
    if wanted.homes > free:
        raise UsageError(
            f"--homes {wanted.homes}: only {free} seeds are not used by the excluded manifests; ask for fewer"
        )
    rng, taken = _stream(wanted.seed, "homes"), set(excluded.homes)
    scans: dict[str, dict[str, Any]] = {}
    while len(scans) < wanted.homes:
        drawn = int(rng.integers(*SEEDS))
        if drawn not in taken:
            taken.add(drawn)
            scans[f"home_{drawn}"] = {"source": "apartment", "seed": drawn}
    return scans


def shares(observations: int, parts: Sequence[str], of: Mapping[str, int] = SHARES) -> dict[str, int]:
    """Part → number of its observations, in proportion to its share; what is left by rounding goes to the last part.

    Examples:
        >>> shares(1504, ("part_1", "part_2", "part_3"))
        {'part_1': 150, 'part_2': 150, 'part_3': 1204}
    """
    whole = sum(of[part] for part in parts)
    counts = {part: observations * of[part] // whole for part in parts}
    counts[parts[-1]] += observations - sum(counts.values())
    return counts


class _Drawer:
    """Draws units, and counts what there is already."""

    def __init__(self, wanted: Wanted, homes: Sequence[str]) -> None:
        self._wanted = wanted
        self._homes = homes
        self._frames = int(wanted.camera["frames"])
        self._composition = COMPOSITIONS[wanted.groups]
        #: Units of a part in a room of a home; the index of a new one follows from it.
        self._in_room: Counter[tuple[str, str, str]] = Counter()
        self._rooms: Counter[Any] = Counter()
        self._focus: Counter[Any] = Counter()

    def places(self) -> list[tuple[str, str, int]]:
        """(part, home, number of observations) of each unit: every home has as many units as any other, or one more.

        Raises:
            UsageError: if a room would have more observations than it can take.
        """
        units: list[tuple[str, int]] = []
        for part, count in self._counts().items():
            size = self._composition.size if part == "part_3" else 1
            units += [(part, min(size, count - start)) for start in range(0, count, size)]
            most = size * self._most(part) * len(self._rooms_of(part)) * len(self._homes)
            if count > most:
                raise UsageError(
                    f"--observations {self._wanted.observations}: {len(self._homes)} homes take at most {most} "
                    f"observations of {part}, found {count}; ask for more homes"
                )
        order = _stream(self._wanted.seed, "homes/order").permutation(len(self._homes)).tolist()
        return [(part, self._homes[order[n % len(order)]], size) for n, (part, size) in enumerate(units)]

    def _counts(self) -> dict[str, int]:
        """Part → number of its observations.

        Raises:
            UsageError: if the composition has no share for a part.
        """
        of = self._composition.shares
        surplus = sorted(set(self._wanted.parts) - set(of))
        if surplus:
            raise UsageError(
                f"--parts {','.join(self._wanted.parts)}: {self._wanted.groups} has no {surplus[0]}; expected some of "
                f"{','.join(of)}"
            )
        return shares(self._wanted.observations, sorted(self._wanted.parts), of)

    def _rooms_of(self, part: str) -> list[str]:
        """The rooms in which a part takes place."""
        moving = self._composition.moving if part == "part_1" else {}
        return [room for room in MOST if not moving or room in moving]

    def unit(self, number: int, part: str, home: str, size: int) -> SampledGroup:
        """Draw a unit in the room of its home that has the fewest."""
        rng = _stream(self._wanted.seed, f"unit/{number}")
        usable = [room for room in self._rooms_of(part) if self._in_room[part, home, room] < self._most(part)]
        counts = [(self._rooms[home, room], self._rooms[part, room]) for room in usable]
        room = _rarest(usable, counts, rng)
        self._rooms[home, room] += 1
        self._rooms[part, room] += 1
        return self._fill(self._next(part, home, room), size, number, rng)

    def _next(self, part: str, home: str, room: str) -> dict[str, Any]:
        """The next place in a room."""
        self._in_room[part, home, room] += 1
        step = GROUP_STEP if part == "part_3" else 1
        index = 1 + step * (self._in_room[part, home, room] - 1)
        return {"part": part, "scan": home, "room": room, "index": index}

    def again(self, number: int, unit: SampledGroup, draw: int) -> SampledGroup:
        """Draw the objects of a unit once more, in the same room, or first some times their places alone.

        Places and walk are drawn by the key: for other places, the unit gets another index.
        """
        where = {name: unit.entries[0][name] for name in ("part", "scan", "room", "index")}
        part, home, room = where["part"], where["scan"], where["room"]
        if draw < self._composition.same_again and self._in_room[part, home, room] < self._most(part):
            where = self._next(part, home, room)
            first = {name: value for name, value in unit.entries[0].items() if name != "index"}
            rest = (
                sibling | {"like": _key(where), "index": where["index"] + n}
                for n, sibling in enumerate(unit.entries[1:], start=1)
            )
            return SampledGroup((where | first, *rest), unit.kinds)
        rng = _stream(self._wanted.seed, f"unit/{number}/{draw}")
        self._take_back(room, unit)
        return self._fill(where, len(unit.entries), number, rng)

    def _take_back(self, room: str, unit: SampledGroup) -> None:
        """Count no more what a unit had that is drawn again, agent included, so that all still take turns."""
        first = unit.entries[0]
        if "agent" in first:
            self._focus["agent", first["scan"], first["agent"]] -= 1
            self._focus["agent", first["agent"]] -= 1
        for name in (*first.get("silent", ()), *first.get("instances", ())):
            self._focus["distractor", room, name] -= name in DISTRACTORS_IN[room]
        heard = {one["category"] for entry in unit.entries for one in entry.get("sources", ())}
        for name in heard & set(_NO_CLASS):
            self._focus["no class", name] -= 1

    def _most(self, part: str) -> int:
        """The largest number of units of a part in a room."""
        last = MOST_INDEX - self._composition.size + 1
        return len(range(1, last + 1, GROUP_STEP)) if part == "part_3" else MOST_INDEX

    def _fill(self, where: dict[str, Any], size: int, number: int, rng: Generator) -> SampledGroup:
        part, room = where["part"], where["room"]
        agents = self._composition.agents
        if agents:
            home = where["scan"]
            used = [(self._focus["agent", home, name], self._focus["agent", name]) for name in agents]
            one = _rarest(agents, used, rng)
            self._focus["agent", home, one] += 1
            self._focus["agent", one] += 1
            where = where | {"agent": one}
        moving = self._moving(part, room, where.get("agent", ""))
        known = list(moving or MOST[room])
        focus = _rarest(known, [self._focus[name] for name in known], rng)
        self._focus[focus] += size
        # Several move where a category that moves has twins.
        single = part == "part_1" or (
            part == "part_3" and not moving and rng.uniform() < self._composition.single_share
        )
        # A third one that moves seldom finds room.
        most = 2 if moving else MOST[room][focus]
        numbers = [1] if single else list(range(2, most + 1))
        count = _rarest(numbers, [self._focus[focus, n] for n in numbers], rng)
        self._focus[focus, count] += 1
        beside = self._beside(room, focus, single, rng)
        if part == "part_3":
            instances = {focus: count} | dict.fromkeys(beside, 1)
            if moving:
                also = self._composition.moving_beside.get(room, ())
                where = where | {"moving": [name for name in instances if name in (*moving, *also)]}
            return self._group(where, instances, size, number, rng)
        entry = where | {"category": focus} | ({"source_motion": "path"} if moving else {})
        if part == "part_2":
            entry["instances"] = count
        if beside:
            entry["silent"] = beside
        return SampledGroup((entry,), ("one object",))

    def _moving(self, part: str, room: str, agent: str) -> tuple[str, ...]:
        """The categories that sound and move in a unit."""
        # Several that go about the floor leave no place to an agent that stays.
        if part == "part_2" or (part == "part_3" and room in self._composition.over_floor and agent != "walking"):
            return ()
        return self._composition.moving.get(room, ())

    def _beside(self, room: str, focus: str, single: bool, rng: Generator) -> list[str]:
        """Categories of the other objects: those that are rarest beside others come first."""
        most = MOST_BESIDE[room][single]
        least = 1 if single else self._composition.least_beside
        names = [name for name in MOST[room] if name != focus]
        chosen: list[str] = []
        for _ in range(int(rng.integers(least, most + 1))):
            left = [name for name in names if name not in chosen]
            if not left:
                break
            one = _rarest(left, [self._focus["beside", name] for name in left], rng)
            self._focus["beside", one] += 1
            chosen.append(one)
        # Drawn before anything is known about sound: what stands there tells nothing of what is heard.
        if room in LOOK_ALIKES and len(chosen) < most + 1 and rng.uniform() < LOOK_ALIKE_SHARE:
            chosen.append(LOOK_ALIKES[room])
        if rng.uniform() < self._composition.distractors:
            known = DISTRACTORS_IN[room]
            one = _rarest(known, [self._focus["distractor", room, name] for name in known], rng)
            self._focus["distractor", room, one] += 1
            chosen.append(one)
        return chosen

    def _no_class(self, unit: int, instances: dict[str, int], rng: Generator) -> str | None:
        """The sound of no class that is heard in a group, if any: one of those that are the rarest so far.

        In every second of these groups it is one that a distractor of the room could make, if one of them is; in the
        others it is one whose maker fits into the fewest rooms.
        """
        turns = self._composition.no_class
        if unit % 4 not in turns:
            return None
        makers = {name: sum(MADE_BY.get(name) in there for there in DISTRACTORS_IN.values()) for name in _NO_CLASS}
        if (unit // 4 + turns.index(unit % 4)) % 2:
            makers = {name: MADE_BY.get(name) not in instances for name in _NO_CLASS}
        one = _rarest(_NO_CLASS, [(self._focus["no class", name], makers[name]) for name in _NO_CLASS], rng)
        self._focus["no class", one] += 1
        return one

    def _group(
        self, where: dict[str, Any], instances: dict[str, int], size: int, unit: int, rng: Generator
    ) -> SampledGroup:
        """The first ``size`` siblings of a group."""
        background = {}
        if unit % 2 if self._composition.in_turn else rng.uniform() < BACKGROUND_SHARE:
            kind = BACKGROUNDS[int(rng.integers(len(BACKGROUNDS)))]
            background = {"background": {"kind": kind, "snr_db": int(rng.integers(SNR_DB[0], SNR_DB[1] + 1))}}
        no_class = self._no_class(unit, instances, rng)
        drawn = self._composition.siblings(where["room"], instances, unit, self._frames, rng, no_class)[:size]
        kinds, sources = zip(*drawn, strict=True)
        twins = {} if self._composition.twins == "apart" else {"twins": self._composition.twins}
        first = where | {"instances": instances} | twins | {"sources": sources[0]} | background
        rest = [
            {"like": _key(where), "index": where["index"] + number, "sources": sounding} | background
            for number, sounding in enumerate(sources[1:], start=1)
        ]
        return SampledGroup((first, *rest), tuple(kinds))


def _key(entry: dict[str, Any]) -> str:
    return observation_key(entry["part"], entry["scan"], entry["room"], entry["index"])


def _rarest(options: Sequence[_T], counts: Sequence[Any], rng: Generator) -> _T:
    """One of the options whose count is the smallest."""
    least = min(counts)
    best = [option for option, count in zip(options, counts, strict=True) if count == least]
    return best[int(rng.integers(len(best)))]


def _stream(seed: int, purpose: str) -> Generator:
    """A random stream for one purpose; the same for any number of homes and observations."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *purpose.encode()])))
