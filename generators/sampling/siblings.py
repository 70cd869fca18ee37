"""Sources of a group of part_3: six siblings with the same pictures.

Every group has two objects that sound alone, silence and a source in another room. What is off-screen has the category
of an object that stands silent in the room in half of the groups: the sound is the same, and nothing may be marked. In
some of the other groups it is a sound of no class.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.random import Generator

from generators.sampling.rooms import MOST

Source = dict[str, Any]
Sibling = tuple[str, list[Source]]

#: Number of siblings of a whole group.
GROUP = 6
#: Probability that a single source has a programme, and that one of several sources is quieter than the others.
PROGRAMME_SHARE, QUIET_SHARE = 0.2, 0.25
#: Levels of a quieter source re the common loudness (dB).
QUIET = (-6, -3)
#: Lengths of the sound and of the pauses of random bursts, in shares of the observation.
BURSTS = {"sound": (0.1, 0.25), "pause": (0.1, 0.3)}
#: Kinds of siblings with several sources, taken in turn.
TOGETHER = ("at once", "in turn", "with off-screen", "overlapping")


def siblings(
    room: str, instances: dict[str, int], number: int, frames: int, rng: Generator, no_class: str | None = None
) -> list[Sibling]:
    """The kind and the sources of each of the `GROUP` siblings.

    Args:
        room: the room of the group.
        instances: category → number of its objects in the room; the first is the category that the group is about.
        number: of the group in the manifest: kinds that take turns do so over the groups.
        frames: length of an observation (s).
        rng: the only source of randomness.
        no_class: the sound of no class that is heard off-screen in place of a category that is not in the room.
    """
    objects = _heard_objects(instances, rng)
    first, second = objects[0], objects[1 % len(objects)]
    out: list[Sibling] = [("one object", _alone(first, frames, rng))]
    if len(objects) > 1:
        out.append(("its twin" if _is_twin(first, second) else "another category", _alone(second, frames, rng)))
    others = [one for one in objects if one["category"] != first["category"] and one != second]
    if others:
        out.append(("another category", _alone(others[0], frames, rng)))
    out.append(("silence", []))
    hard = number % 2 == 0
    out.append(_elsewhere(room, instances, hard, frames, rng, no_class))
    if len(objects) > 1:
        turn = number // 2 % len(TOGETHER)
        out.append(_together(TOGETHER[turn], room, instances, objects, frames, rng, no_class))
    # Few objects: what is still missing is heard from another room, or from the same object at other times.
    while len(out) < GROUP:
        hard = not hard
        extra = [_elsewhere(room, instances, hard, frames, rng, no_class), _with_pauses(objects, frames, rng)]
        out += extra[: GROUP - len(out)]
    return out


def _heard_objects(instances: dict[str, int], rng: Generator) -> list[Source]:
    """The objects that may sound, in random order: two of the first category, if there are, then one of each other."""
    names = [name for name in instances if name in _SOUNDING]
    numbers = {name: [int(n) + 1 for n in rng.permutation(instances[name])] for name in names}
    twins = [{"category": names[0], "instance": number} for number in numbers[names[0]][:2]]
    return [*twins, *({"category": name, "instance": numbers[name][0]} for name in names[1:])]


_SOUNDING = frozenset(name for room in MOST.values() for name in room)


def _is_twin(first: Source, second: Source) -> bool:
    return bool(first["category"] == second["category"])


def _alone(source: Source, frames: int, rng: Generator) -> list[Source]:
    """One source, in some of the siblings with a programme."""
    if rng.uniform() < PROGRAMME_SHARE:
        return [source | {"programme": _programme(frames, rng)}]
    return [dict(source)]


def _with_pauses(objects: Sequence[Source], frames: int, rng: Generator) -> Sibling:
    return "one object with pauses", [objects[-1] | {"programme": _programme(frames, rng)}]


def _elsewhere(
    room: str, instances: dict[str, int], hard: bool, frames: int, rng: Generator, no_class: str | None
) -> Sibling:
    """A source in another room; ``hard``: of a category that stands silent in this room, else ``no_class`` if given."""
    rooms = [name for name in MOST if name != room]
    there = str(rng.choice(rooms))
    present = [name for name in instances if name in _SOUNDING]
    if hard:
        category, kind = str(rng.choice(present)), "off-screen, its category in the room"
    elif no_class is not None:
        category, kind = no_class, "off-screen, of no class"
    else:
        absent = [name for name in MOST[there] if name not in present]
        category, kind = str(rng.choice(absent)), "off-screen, its category not in the room"
    return kind, _alone({"category": category, "room": there}, frames, rng)


def _together(
    how: str,
    room: str,
    instances: dict[str, int],
    objects: Sequence[Source],
    frames: int,
    rng: Generator,
    no_class: str | None,
) -> Sibling:
    """Several sources; which of the objects they are is random."""
    chosen = [dict(objects[int(index)]) for index in rng.permutation(len(objects))[:2]]
    if how == "in turn":
        seconds = max(1, round(frames / 4))
        turns = [{"turn": {"number": n, "of": 2, "seconds": seconds, "pause": 1}} for n in (1, 2)]
        return "several, in turn", [one | {"programme": turn} for one, turn in zip(chosen, turns, strict=True)]
    if how == "overlapping":
        first, second = (round(frames * share) for share in (0.35, 0.65))
        spans = [[[0, second]], [[first, frames]]]
        return "several, overlapping", [one | {"programme": span} for one, span in zip(chosen, spans, strict=True)]
    if how == "with off-screen":
        hard = bool(rng.integers(2)) and no_class is None
        _, (source,) = _elsewhere(room, instances, hard, frames, rng, no_class)
        return "several, one off-screen", [chosen[0], source]
    if rng.uniform() < QUIET_SHARE:
        chosen[1]["gain_db"] = int(rng.choice(QUIET))
    return "several at once", chosen


def _programme(frames: int, rng: Generator) -> Any:
    """One or two intervals, or random bursts."""
    if frames < 6:
        return [[0, frames]]
    if rng.integers(2):
        ranges = {name: [round(frames * share) for share in shares] for name, shares in BURSTS.items()}
        return {"bursts": {name: [max(1, low), max(2, high)] for name, (low, high) in ranges.items()}}
    cuts = sorted(int(cut) for cut in rng.choice(frames - 1, size=3, replace=False) + 1)
    return [[0, cuts[0]], [cuts[1], cuts[2]]] if rng.integers(2) else [[cuts[0], cuts[2]]]
