"""How the groups of part_3 are composed: `COMPOSITIONS`, a table that `avs3d manifest sample --groups` chooses from.

``training`` has many kinds of siblings in few observations. ``listen`` is for a benchmark of hearing where a sound
comes from: most of its siblings are twins that sound alone, and no level, no category and no distance tells them apart.

In some groups (`Composition.no_class`) a sound of no class is heard from another room: alone, where nothing may be
marked, and in ``listen`` also together with what sounds in the room, so that it does not tell that nothing does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle, islice

from numpy.random import Generator

from generators.manifest.schema import Twins
from generators.sampling.rooms import MOST
from generators.sampling.siblings import GROUP, Sibling, Source, siblings
from generators.sampling.soundscapes import AGENTS, MOVING, MOVING_BESIDE, OVER_FLOOR, SCENE_SHARES, soundscape

#: Shares of the parts in the observations. A group of part_3 has six observations with the same pictures, so that the
#: three parts have about as many pictures each.
SHARES = {"part_1": 1, "part_2": 1, "part_3": 8}
#: Range of the level of each source (dB re the common loudness), so that loudness tells no distance: 18 dB are three
#: doublings of it in the free field, more than the walk through a room has.
LEVELS = (-9.0, 9.0)
#: Siblings of a group beside those in which a twin sounds alone; see `listening`.
OFF_SCREEN, SILENCE, OTHER = "off-screen", "silence", "another category"
OFF_SCREEN_OF_NO_CLASS = "off-screen, of no class"
SEVERAL, WITH_OTHER = "several of a category", "a twin and another category"
TWIN, WITH_NO_CLASS = "a twin", "{}, and a sound of no class"


@dataclass(frozen=True)
class Pattern:
    """The siblings of a group: in so many of them a twin sounds ``alone``; and the ``others``."""

    alone: int
    others: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of siblings."""
        return self.alone + len(self.others)


#: Patterns of groups with two twins, which take them in turn, and with more, of which two can sound at once while
#: others are silent. All have the same number of siblings; in so many of them a twin sounds alone that more than two
#: fifths of the pair-frames are of twins (docs/sampling.md).
OF_TWO = (
    Pattern(6, (OFF_SCREEN, SILENCE)),
    Pattern(6, (OFF_SCREEN, OTHER)),
    Pattern(6, (OFF_SCREEN, SILENCE)),
    Pattern(6, (OFF_SCREEN, WITH_OTHER)),
)
OF_MORE = (Pattern(6, (OFF_SCREEN, SEVERAL)), Pattern(6, (OFF_SCREEN, SILENCE)))
#: What sounds in the room in the last sibling of a group with a sound of no class, with it; in turn.
IN_THE_ROOM = (TWIN, OTHER, WITH_OTHER), (SEVERAL, TWIN)


def listening(
    room: str, instances: dict[str, int], number: int, frames: int, rng: Generator, no_class: str | None = None
) -> list[Sibling]:
    """The siblings of a group of ``listen``, in random order; see `generators.sampling.siblings.siblings`.

    Every source has a level of its own. What is off-screen is ``no_class``, or else of a category of which objects
    stand silent in the room: that of the twins, or in every third group that of another object.
    """
    del frames  # all of them sound all the time
    focus, *others = (name for name in instances if name in _SOUNDING)
    twins = [{"category": focus, "instance": int(n) + 1} for n in rng.permutation(instances[focus])]
    patterns = OF_TWO if len(twins) == 2 else OF_MORE
    pattern = patterns[number // 4 % len(patterns)]
    category = no_class or (focus if number % 3 else str(rng.choice(others)))
    away = {"category": category, "room": str(rng.choice([name for name in MOST if name != room]))}
    found: list[Sibling] = [(TWIN, [twin]) for twin in islice(cycle(twins), pattern.alone)]
    if no_class is None:
        found += [(kind, [away] if kind == OFF_SCREEN else _in_the_room(kind, twins, others, rng))
                  for kind in pattern.others]  # fmt: skip
    else:
        turns = IN_THE_ROOM[len(twins) > 2]
        kind = turns[number // 4 % len(turns)]
        found += [(OFF_SCREEN_OF_NO_CLASS, [away])]
        found += [(WITH_NO_CLASS.format(kind), [*_in_the_room(kind, twins, others, rng), away])]
    order = rng.permutation(len(found))
    return [(kind, [_levelled(one, rng) for one in sources]) for kind, sources in (found[index] for index in order)]


def _in_the_room(kind: str, twins: Sequence[Source], others: Sequence[str], rng: Generator) -> list[Source]:
    """The objects of the room that sound in a sibling."""
    if kind == SEVERAL:
        return [twins[int(index)] for index in rng.permutation(len(twins))[:2]]
    found: list[Source] = []
    if kind in (OTHER, WITH_OTHER):
        found.append({"category": str(rng.choice(others)), "instance": 1})
    if kind in (TWIN, WITH_OTHER):
        found.append(twins[int(rng.integers(len(twins)))])
    return found


_SOUNDING = frozenset(name for room in MOST.values() for name in room)


def _levelled(source: Source, rng: Generator) -> Source:
    return source | {"gain_db": round(float(rng.uniform(*LEVELS)), 1)}


@dataclass(frozen=True)
class Composition:
    """How the groups of part_3 are composed.

    Attributes:
        siblings: draws what sounds in the siblings of a group.
        size: number of siblings of a whole group.
        single_share: share of the groups in which no category has twins.
        least_beside: least number of objects beside twins.
        distractors: share of the units in which a distractor stands.
        no_class: which groups have a sound of no class: their numbers modulo 4.
        twins: how twins are placed (see `generators.manifest.schema.ObservationSpec`).
        same_again: how often objects that do not fit are placed anew before others are drawn.
        in_turn: whether every second group has a background; else that is drawn.
        shares: part → its share of the observations.
        agents: what the agent does, in every home one as often as the other; the manifest's default if there are none.
        moving: room → the categories that sound there, and move: one object in part_1, in part_3 several at once;
            nothing moves if there are none.
        moving_beside: room → the distractors that move with those of part_3.
        over_floor: rooms in which those of part_3 move over the floor; they do where the agent walks.
    """

    siblings: Callable[[str, dict[str, int], int, int, Generator, str | None], list[Sibling]]
    size: int
    single_share: float = 0.0
    least_beside: int = 0
    distractors: float = 0.5
    no_class: tuple[int, ...] = ()
    twins: Twins = "apart"
    same_again: int = 0
    in_turn: bool = False
    shares: Mapping[str, int] = field(default_factory=lambda: SHARES)
    agents: tuple[str, ...] = ()
    moving: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    moving_beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    over_floor: tuple[str, ...] = ()


COMPOSITIONS = {
    "training": Composition(siblings, GROUP, single_share=0.25, no_class=(1,)),
    "listen": Composition(
        listening,
        OF_TWO[0].size,
        least_beside=1,
        distractors=1.0,
        no_class=(2, 3),
        twins="alike",
        same_again=6,
        in_turn=True,
    ),
    "seld": Composition(
        soundscape,
        1,
        single_share=0.5,
        least_beside=1,
        shares=SCENE_SHARES,
        agents=AGENTS,
        moving=MOVING,
        moving_beside=MOVING_BESIDE,
        over_floor=OVER_FLOOR,
    ),
}
