"""Controls: what a method hears in place of a frame's own sound, to see what it takes from the sound.

A method that listens loses without sound; one that hears *what* sounds loses with another category; one that hears
*where* loses with swapped ears, with the same signal at both ears, and with the same category in another home. Every
other setting stays as it is, so that a row with a control differs from the plain row by the sound alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError

SoundControl = Literal["own", "none", "swapped-ears", "both-ears-mean", "same-category", "other-category"]
SOUND_CONTROLS: tuple[SoundControl, ...] = get_args(SoundControl)
#: What `sounding_categories` calls a sound of no class.
NO_CLASS = "sound of no class"
#: Control → what a submission says of it; nothing about a method that hears its own sound.
SAID: dict[SoundControl, str] = {
    "own": "",
    "none": "heard nothing",
    "swapped-ears": "heard with swapped ears",
    "both-ears-mean": "heard the mean of both ears at both",
    "same-category": "heard the same category in another home",
    "other-category": "heard another category",
}


def sound_of(frame: Frame, control: SoundControl = "own") -> NDArray[np.float32]:
    """(2, n) what is heard in a frame under a control, float32.

    Raises:
        UsageError: if the dataset has no other observation that the control asks for.
        Avs3dError: if the file is missing or damaged.
    """
    if control in ("same-category", "other-category"):
        return other_frame(frame, same_category=control == "same-category").audio()
    sound = frame.audio()
    if control == "none":
        return np.zeros_like(sound)
    if control == "swapped-ears":
        return np.ascontiguousarray(sound[::-1])
    if control == "both-ears-mean":
        return np.broadcast_to(sound.mean(axis=0, keepdims=True), sound.shape).copy()
    return sound


def mono_of(frame: Frame, control: SoundControl = "own") -> NDArray[np.float32]:
    """(n,) the mono clip of a frame under a control, float32, for methods with one ear, which ears cannot change.

    Raises:
        UsageError: if the dataset has no other observation that the control asks for.
        Avs3dError: if the file is missing or damaged.
    """
    if control in ("same-category", "other-category"):
        return other_frame(frame, same_category=control == "same-category").mono()
    sound = frame.mono()
    return np.zeros_like(sound) if control == "none" else sound


def named(method: str, control: SoundControl) -> str:
    """The name of a method with what it hears in place of a frame's own sound, if anything."""
    return ", ".join(filter(None, (method, SAID[control])))


def noted(notes: str, control: SoundControl) -> str:
    """The notes of a submission with what is heard in place of a frame's own sound, if anything."""
    return "; ".join(filter(None, (notes, SAID[control])))


def sounds_of(frames: Sequence[Frame], control: SoundControl = "own") -> NDArray[np.float32]:
    """(T, 2, n) float32: the clips of T frames, or what a control puts in their place.

    Raises:
        UsageError: if the dataset lacks what the control asks for.
        Avs3dError: if a frame has no clip, or another length than the first.
    """
    clips = [sound_of(frame, control) for frame in frames]
    for frame, clip in zip(frames, clips, strict=True):
        if clip.shape != clips[0].shape or clip.shape[0] != 2:
            where = f"{frame.observation.key}/{frame.name}"
            raise Avs3dError(f"{where}: a clip of shape {clip.shape}, expected {clips[0].shape}, two ears")
    return np.stack(clips)


def other_frame(frame: Frame, *, same_category: bool) -> Frame:
    """The frame of the same place in time of another observation with the same, or another, sounding category.

    The next one fits that has other pictures and no category in common; or, with the same category, the one in another
    home whose sources have the most categories in common and the fewest others (the next of equals). What sounds in
    observations of part_3 is the set of categories of their sources; under silence it is nothing, in any home.

    Raises:
        UsageError: if the dataset has no such observation.
    """
    mine = frame.observation
    if same_category and mine.record is not None and not sounding_categories(mine):
        return frame
    chosen = _other_observation(mine.root, mine.key, same_category)
    return chosen.frames[min(frame.index, len(chosen) - 1)]


@lru_cache(maxsize=8)  # a walk asks for each of its frames
def _other_observation(root: Path, key: str, same_category: bool) -> Observation:
    """The observation of `other_frame`."""
    dataset = _dataset(root)
    mine, start = dataset[key], dataset.keys.index(key)
    sounding = sounding_categories(mine)
    best: tuple[int, int] | None = None
    chosen: Observation | None = None
    for step in range(1, len(dataset)):
        other = dataset[(start + step) % len(dataset)]
        found = sounding_categories(other)
        common, rest = len(found & sounding), len(found ^ sounding)
        if not found or not len(other):
            continue
        if same_category:
            fits = common > 0 and other.place.scan != mine.place.scan
        else:  # siblings would be right by chance
            fits = common == 0 and other.group_key != mine.group_key
        if fits and (best is None or (same_category and (common, -rest) > best)):
            best, chosen = (common, -rest), other
            if not same_category or rest == 0:
                break
    if chosen is not None:
        return chosen
    wanted = "the same category in another home" if same_category else "another category"
    name = "same-category" if same_category else "other-category"
    raise UsageError(f"{root}: no observation of {wanted} for {key}; --sound {name} needs one")


def sounding_categories(observation: Observation) -> frozenset[str]:
    """The categories that sound in an observation; empty in silence, and where the truth is not known.

    All sounds of no class are one, `NO_CLASS`: nothing of them is marked, and few of each are in a dataset.
    """
    record = observation.record
    if record is None:
        return frozenset()
    ids = record.class_ids
    return frozenset(one.category if one.category in ids else NO_CLASS for one in record.sound_sources)


@lru_cache(maxsize=4)
def _dataset(root: Path) -> Dataset:
    return Dataset(root)
