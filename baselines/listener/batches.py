"""The pictures and sounds of a batch: sets of one picture with several sounds, so that the mask must follow the sound.

A set has `SOUNDS` sounds for one picture. Siblings of a group are taken first: the same picture while something else
sounds. Where a picture has too few siblings, sounds are made for it:

- *silence*: nothing, or noise of no source; nothing is marked;
- *foreign*: the sound of a category that is not in the room, or of no class, from another observation; nothing is
  marked;
- *elsewhere*: the sound of a category that is in view, from a lateral angle at which none of it is; nothing is marked;
- *mixed*: two sounds at once; what is marked is marked in either.

Where the store has dry sounds, half of the sounds of one source whose impulse response is stored are *dubbed*: another
sound of the category is heard through it, at the same level. A third of the others were a file of Ogg Vorbis or MP3.

A plan depends on (seed, step, rank) alone: a run that goes on after an interruption gets the same batches.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import UsageError
from baselines.listener.shards import ShardStore

#: Sounds of one picture in a batch.
SOUNDS = 4
#: Of pictures in which none of the categories is visible, one in this many is used in an epoch.
EMPTY_PICTURES = 3
#: Share of homes that are kept for validation.
VALIDATION_SHARE = 0.08
#: How far a made sound's lateral angle is from what is in view (rad): more than the blur of the cues.
CLEARANCE = math.radians(30.0)
#: Share of sounds of no class among those of categories that are not in the room.
NO_CLASS = 0.2
#: Share of the sounds with an impulse response that are dubbed.
DUBBED = 0.5
#: Share of the sounds that are not dubbed which come from a file of a lossy codec.
CODED = 0.35
#: Draws before a kind of sound that needs luck is given up for this picture.
_DRAWS = 8
_NUMBER = {name: number for number, name in enumerate(CATEGORIES)}
#: Column of ``audible`` for what has no name.
UNKNOWN = len(CATEGORIES)


class SoundKind(IntEnum):
    """Relation of a sound to its picture."""

    OWN = 0
    SWAPPED = 1
    SILENT = 2
    OFF_SCREEN = 3
    FOREIGN = 4
    ELSEWHERE = 5
    MIXED = 6


#: The kinds that answer the question "does the mask follow the sound?"; at least a third of each batch.
COUNTERFACTUAL = (SoundKind.SWAPPED, SoundKind.SILENT, SoundKind.OFF_SCREEN, SoundKind.FOREIGN, SoundKind.ELSEWHERE)


@dataclass
class BatchPlan:
    """The contents of a batch of B pictures; one without sounds is of parts of pictures.

    Attributes:
        views: (B,) pictures.
        sounds: (B·SOUNDS, 2) sounds that are added; −1: none.
        dubs: (B·SOUNDS, 2) dry sounds that are heard in their place; −1: none.
        coded: (B·SOUNDS, 2) bool: which of the others come from a file of a lossy codec.
        truths: (B·SOUNDS, 2) sounds whose masks are united; −1: none.
        audible: (B·SOUNDS, categories + 1) bool; the last one: a sound of no class.
        kinds: (B·SOUNDS,) of `SoundKind`.
    """

    views: NDArray[np.int64]
    sounds: NDArray[np.int64]
    dubs: NDArray[np.int64]
    coded: NDArray[np.bool_]
    truths: NDArray[np.int64]
    audible: NDArray[np.bool_]
    kinds: NDArray[np.int64]

    @property
    def counterfactual(self) -> float | None:
        """Share of sounds that are silent, off-screen, swapped, foreign or from elsewhere; None without sounds."""
        return round(float(np.isin(self.kinds, COUNTERFACTUAL).mean()), 3) if len(self.kinds) else None

    def shares(self) -> Counter[str]:
        """How many sounds there are of each kind."""
        return Counter(SoundKind(number).name.lower() for number in self.kinds.tolist())


@dataclass
class Slot:
    """One sound of a picture, see `BatchPlan`."""

    sounds: list[int]
    truths: list[int]
    audible: set[int]
    kind: SoundKind


def split_homes(homes: Sequence[str], most: int | None = None) -> tuple[set[str], set[str]]:
    """(training, validation): by a hash of their names, so that the same home is always on the same side.

    With one home alone there is no validation.

    Args:
        homes: names, in any order, repeated or not.
        most: number of training homes; None: all. Fewer ones are always among more.
    """
    ranked = sorted(set(homes), key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    kept = max(1, round(VALIDATION_SHARE * len(ranked))) if len(ranked) > 1 else 0
    return set(ranked[kept:][:most]), set(ranked[:kept])


@dataclass
class Sampler:
    """Plans batches.

    Attributes:
        store: what there is.
        batch: pictures of a batch of one device.
        seed: of all choices.
        ranks: devices.
        homes: number of training homes; None: all.
    """

    store: ShardStore
    batch: int
    seed: int = 0
    ranks: int = 1
    homes: int | None = None
    visible: NDArray[np.int64] = field(init=False)
    empty: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        table = self.store.table
        training, _ = split_homes(table.homes, self.homes)
        views = np.asarray([number for number, home in enumerate(table.homes) if home in training], np.int64)
        seen: NDArray[np.bool_] = np.asarray(np.isfinite(self.store.extents[:, :, 0]).any(axis=1), np.bool_)
        self.visible, self.empty = views[seen[views]], views[~seen[views]]
        if not len(self.visible):
            raise UsageError("no category is visible in any picture of the training homes; there is nothing to learn")
        self._of_view: dict[int, list[int]] = {}
        self._of_category: list[list[int]] = [[] for _ in CATEGORIES]
        self._of_no_class: list[int] = []
        for sound, view in enumerate(table.view):
            if table.homes[view] in training:
                self._of_view.setdefault(view, []).append(sound)
                if len(table.audible[sound]) == 1 and table.audible[sound][0] in _NUMBER and not table.others[sound]:
                    self._of_category[_NUMBER[table.audible[sound][0]]].append(sound)
                elif table.others[sound] and not table.audible[sound]:
                    self._of_no_class.append(sound)
        self._present = [{_NUMBER[name] for name in names} for names in table.present]
        # Sounds of no class share a number behind those of the categories.
        self._audible = [
            {_NUMBER[name] for name in names if name in _NUMBER} | ({UNKNOWN} if other else set())
            for names, other in zip(table.audible, table.others, strict=True)
        ]
        self._order: tuple[tuple[int, int], NDArray[np.int64]] = ((-1, 0), np.zeros(0, np.int64))

    @property
    def epoch(self) -> int:
        """Pictures of an epoch."""
        return len(self.visible) + len(self.empty) // EMPTY_PICTURES

    @property
    def steps(self) -> int:
        """Steps of an epoch."""
        return self._steps(self.batch)

    def _steps(self, count: int) -> int:
        return max(1, self.epoch // (count * self.ranks))

    def plan(self, step: int, rank: int = 0) -> BatchPlan:
        """The batch of a step on one of the devices."""
        views = self._views(step, rank, self.batch)
        rng = np.random.default_rng((self.seed, 1, step, rank))
        slots = [slot for view in views for slot in self._set(int(view), rng)]
        audible = np.zeros((len(slots), UNKNOWN + 1), np.bool_)
        for row, slot in enumerate(slots):
            audible[row, list(slot.audible)] = True
        sounds = np.asarray([(*slot.sounds, -1, -1)[:2] for slot in slots], np.int64)
        dubs = self._dubs(sounds, rng)
        return BatchPlan(
            views=views,
            sounds=sounds,
            dubs=dubs,
            coded=(sounds >= 0) & (dubs < 0) & (rng.random(sounds.shape) < CODED),
            truths=np.asarray([(*slot.truths, -1, -1)[:2] for slot in slots], np.int64),
            audible=audible,
            kinds=np.asarray([slot.kind for slot in slots], np.int64),
        )

    def picture_plan(self, step: int, rank: int = 0) -> BatchPlan:
        """Pictures without sound: `SOUNDS` times as many as in a batch with sound, of each of which a part is seen."""
        views = self._views(step, rank, SOUNDS * self.batch)
        pairs = np.zeros((0, 2), np.int64)
        return BatchPlan(
            views, pairs, pairs, pairs >= 0, pairs, np.zeros((0, UNKNOWN + 1), np.bool_), np.zeros(0, np.int64)
        )

    def _views(self, step: int, rank: int, count: int) -> NDArray[np.int64]:
        """The pictures of a batch: the next ones of an order that changes from epoch to epoch."""
        epoch, within = divmod(step, self._steps(count))
        if self._order[0] != (epoch, count):
            self._order = ((epoch, count), self._shuffled(epoch, count))
        start = (within * self.ranks + rank) * count
        return self._order[1][start : start + count]

    def _shuffled(self, epoch: int, count: int) -> NDArray[np.int64]:
        rng = np.random.default_rng((self.seed, 0, epoch))
        few = rng.permutation(self.empty)[: len(self.empty) // EMPTY_PICTURES]
        order = rng.permutation(np.concatenate([self.visible, few]))
        return np.resize(order, max(len(order), count * self.ranks))

    def _dubs(self, sounds: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
        """A dry sound of its category for some of the sounds (n, 2), −1 for the others."""
        out = np.full_like(sounds, -1)
        if self.store.dry is None:
            return out
        for place, sound in np.ndenumerate(sounds):
            named = self._audible[sound] if sound >= 0 and self.store.table.has_response[sound] else set()
            if len(named) == 1 and UNKNOWN not in named and rng.random() < DUBBED:
                known = self.store.dry.of_category[next(iter(named))]
                if len(known):
                    out[place] = known[rng.integers(len(known))]
        return out

    def _set(self, view: int, rng: np.random.Generator) -> list[Slot]:
        """The sounds of a picture: two or three siblings where there are some, the rest made."""
        siblings = rng.permutation(self._of_view[view]).tolist()
        # One that shows something comes first, so that most sets have a mask to find.
        siblings.sort(key=lambda sound: self.store.marked[sound] == 0)
        slots = [self._real(siblings[0], siblings[0])]
        # A real sibling of another truth before one of the same.
        rest = sorted(siblings[1:], key=lambda sound: self._same(siblings[0], sound))
        slots += [self._real(sound, siblings[0]) for sound in rest[:2]]
        if len(slots) == 1:
            slots.append(self._mixed(view, siblings, rng))
        while len(slots) < SOUNDS - 1:
            slots.append(self._negative(view, rng))
        several = len(siblings) > 1 and rng.random() < 0.25
        slots.append(self._mixed(view, siblings, rng) if several else self._negative(view, rng))
        return slots

    def _same(self, first: int, other: int) -> bool:
        return bool((self.store.masks[first] == self.store.masks[other]).all())

    def _real(self, sound: int, first: int) -> Slot:
        """A sound of the picture itself; ``first`` is the first of the set."""
        if not self._audible[sound]:
            kind = SoundKind.SILENT
        elif not self.store.marked[sound]:
            kind = SoundKind.OFF_SCREEN
        else:
            kind = SoundKind.OWN if sound == first or self._same(first, sound) else SoundKind.SWAPPED
        return Slot([sound], [sound], self._audible[sound], kind)

    def _mixed(self, view: int, siblings: list[int], rng: np.random.Generator) -> Slot:
        """The first sibling's sound with that of another one, or with a foreign one."""
        first = siblings[0]
        others = [sound for sound in siblings[1:] if self._audible[sound]]
        if not self._audible[first]:
            return self._negative(view, rng)
        if others:
            other = others[int(rng.integers(len(others)))]
            return Slot([first, other], [first, other], self._audible[first] | self._audible[other], SoundKind.MIXED)
        foreign = self._foreign(view, rng)
        if foreign is None:
            return self._real(first, first)
        return Slot([first, *foreign.sounds], [first], self._audible[first] | foreign.audible, SoundKind.MIXED)

    def _negative(self, view: int, rng: np.random.Generator) -> Slot:
        """A made sound with which nothing is marked."""
        luck = rng.random()
        made = None
        if luck < 0.4:
            made = self._foreign(view, rng)
        elif luck < 0.7:
            made = self._elsewhere(view, rng)
        return made or Slot([], [], set(), SoundKind.SILENT)

    def _foreign(self, view: int, rng: np.random.Generator) -> Slot | None:
        if self._of_no_class and rng.random() < NO_CLASS:
            sound = self._of_no_class[int(rng.integers(len(self._of_no_class)))]
            return Slot([sound], [], {UNKNOWN}, SoundKind.FOREIGN)
        absent = [c for c in range(len(CATEGORIES)) if c not in self._present[view] and self._of_category[c]]
        if not absent:
            return None
        category = absent[int(rng.integers(len(absent)))]
        sound = self._of_category[category][int(rng.integers(len(self._of_category[category])))]
        return Slot([sound], [], {category}, SoundKind.FOREIGN)

    def _elsewhere(self, view: int, rng: np.random.Generator) -> Slot | None:
        low, high = np.asarray(self.store.extents[view]).T
        seen = [c for c in range(len(CATEGORIES)) if np.isfinite(low[c]) and self._of_category[c]]
        for _ in range(_DRAWS if seen else 0):
            category = seen[int(rng.integers(len(seen)))]
            sound = self._of_category[category][int(rng.integers(len(self._of_category[category])))]
            lateral = self.store.table.lateral[sound]
            if lateral is not None and not low[category] - CLEARANCE < lateral < high[category] + CLEARANCE:
                return Slot([sound], [], {category}, SoundKind.ELSEWHERE)
        return None
