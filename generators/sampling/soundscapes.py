"""Scenes for sound event localisation and detection: `avs3d manifest sample --for seld`.

Each observation has pictures and sounds of its own, is a minute long, and has several events. Three of four are of
part_3: every object of the room sounds now and then, by itself or with others, and in a third of them something is
heard from another room as well, which is no event (an *interferer*). In kitchens, and in living rooms where the agent
walks, several sources move at once, and silent distractors with them; others stand still. The rest are of part_1: an
object that moves sounds all the time. In every home the agent stands, turns slowly or walks, each as often as the
others.
"""

from __future__ import annotations

from numpy.random import Generator

from generators.sampling.rooms import MOST
from generators.sampling.siblings import Sibling, Source

#: Length of a scene (s).
SCENE_SECONDS = 60
#: Parts of such a manifest, and their shares.
SCENE_SHARES = {"part_1": 1, "part_3": 3}
#: What the agent does.
AGENTS = ("standing", "turning", "walking")
#: Room → what moves there: over the floor, or along a worktop. Bathrooms have too little floor.
MOVING = {"kitchen": ("coffee_machine", "microwave"), "living_room": ("vacuum_cleaner",)}
#: Room → the distractors that move where several sources do: they are silent, so that moving is not sounding.
MOVING_BESIDE = {"kitchen": ("kettle", "radio"), "living_room": ("radio",)}
#: Rooms in which several move over the floor, and only where the agent walks.
OVER_FLOOR = ("living_room",)
#: Lengths of events and of the pauses between them (s).
EVENTS, PAUSES = (2, 8), (2, 10)
#: One in so many scenes has an interferer.
INTERFERER_IN = 3
#: Range of the level of each source (dB re the common loudness).
SCENE_LEVELS = (-6.0, 6.0)


def soundscape(
    room: str, instances: dict[str, int], number: int, frames: int, rng: Generator, no_class: str | None = None
) -> list[Sibling]:
    """The sources of a scene; see `generators.sampling.siblings.siblings`.

    Every object sounds in bursts of its own, which begin within the first half of a short scene.
    """
    pauses = [min(PAUSES[0], frames // 4), min(PAUSES[1], frames // 2)]
    heard: list[Source] = [
        {"category": name, "instance": one} for name, count in instances.items() if name in _SOUNDING
        for one in range(1, count + 1)
    ]  # fmt: skip
    if number % INTERFERER_IN == 0:
        away = str(rng.choice([name for name in MOST if name != room]))
        heard.append({"category": no_class or str(rng.choice(list(MOST[away]))), "room": away})
    sources = [
        source
        | {"programme": {"bursts": {"sound": list(EVENTS), "pause": [*pauses], "seed": int(rng.integers(1000))}}}
        | {"gain_db": round(float(rng.uniform(*SCENE_LEVELS)), 1)}
        for source in heard
    ]
    return [("several events", sources)]


_SOUNDING = frozenset(name for room in MOST.values() for name in room)
