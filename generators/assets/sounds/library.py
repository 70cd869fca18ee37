"""The synthesised voices of all categories, and a source by one of them."""

from __future__ import annotations

from importlib import import_module

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES, check_category
from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.sounds.capture import captured
from generators.assets.sounds.classic import speak
from generators.assets.sounds.loudness import CEILING_DB, TARGET_LUFS, normalised
from generators.assets.sounds.voice import Voice

#: Least level of every second of a source (dBFS, RMS).
SECOND_FLOOR_DB = -45.0


def voices(category: str) -> tuple[Voice, ...]:
    """The synthesised voices of a category, one of the seven or of those that are heard off-screen, in a fixed order.

    Raises:
        UsageError: for an unknown category.
    """
    check_category(category, off_screen=True)
    name = f"generators.assets.sounds.devices.{category if category in CATEGORIES else 'off_screen'}"
    try:
        module = import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        return ()  # it has no voices yet
    return tuple(voice for voice in module.VOICES if voice.category == category)


def usual_voices(category: str) -> tuple[str, ...]:
    """The names of the voices among which one is drawn where nobody names any.

    None for the seven, each of which has the one sound of versions 1 and 2 of the datasets then; those for training
    for the others, so that nobody trains on a voice for tests who has not asked for it.

    Raises:
        UsageError: for an unknown category.
    """
    if category in CATEGORIES:
        return ()
    return tuple(voice.name for voice in voices(category) if voice.split == "train")


def find_voice(category: str, name: str) -> Voice:
    """The voice of that name.

    Raises:
        UsageError: for an unknown category or name.
    """
    known = {voice.name: voice for voice in voices(category)}
    if name not in known:
        raise UsageError(f"{category} has no voice {name!r}; expected one of {', '.join(known)}")
    return known[name]


def synthesise(category: str, seconds: float, rng: Generator, voice: Voice | str | None = None) -> NDArray[np.float32]:
    """A source of ``category``: a unit of a voice, a take by it, and a recording of that, all drawn from ``rng``.

    Args:
        category: one of `voices`.
        seconds: length, at least 1.
        rng: the only source of randomness.
        voice: one of `voices`, or its name; None: one of `usual_voices`, or the one sound that each of the seven had in
            versions 1 and 2 of the datasets.

    Returns:
        (seconds · 44100,) float32 mono at `TARGET_LUFS`, true peak below `CEILING_DB`; every second of it above
        `SECOND_FLOOR_DB`.

    Raises:
        UsageError: for an unknown category or voice.
        Avs3dError: for a length below one second or above an hour.
    """
    check_category(category, off_screen=True)
    if not 1.0 <= seconds <= 3600.0:
        raise Avs3dError(f"sound of {category}: length {seconds} s, expected 1 to 3600 s")
    count = round(seconds * SAMPLE_RATE)
    usual = usual_voices(category) if voice is None else ()
    if usual:
        voice = usual[int(rng.integers(len(usual)))]
    if voice is None:
        raw = speak(category, count, rng)
    else:
        chosen = find_voice(category, voice) if isinstance(voice, str) else voice
        raw = captured(chosen.play(count, rng), rng)
    return normalised(raw, SAMPLE_RATE, TARGET_LUFS, CEILING_DB)
