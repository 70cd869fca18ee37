"""Options of a run of the generator; imports nothing heavy, for the command line."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from generators.core.limits import FRAMES, SIZE, WORKERS

#: Renderers, acoustic engines, devices, and optional folders of an observation.
Vision = Literal["embree", "cuda", "habitat"]
Audio = Literal["soundspaces", "tracer", "analytic"]
Device = Literal["cpu", "cuda"]
Extra = Literal["depth", "rirs", "stems"]
#: Forms of a dataset: a folder of files for each observation, or shards of samples.
Form = Literal["folders", "webdataset"]
#: Least and greatest order of ambisonic clips.
ORDERS = (1, 3)


@dataclass(frozen=True)
class GenerateOptions:
    """Options of `generate`.

    Attributes:
        only: shell patterns of observation keys; none: all observations.
        workers: number of processes of this machine; None: one per core.
        vision: renderer; None: that of the device, embree or cuda.
        audio: acoustic engine; None: the manifest's, else the tracer.
        frames: frames per observation; None: the manifest's.
        size: side of the pictures (pixels); None: the manifest's.
        extras: optional folders.
        cache: folder of baked homes; None: ``$AVS3D_CACHE``, or the user's cache folder.
        hrtf: SOFA file of the head that hears the binaural clips; None: the engine's own head.
        ambisonics: order of ambisonic clips; None: there are none.
        array: file with the microphones of an array; None: there is none.
        device: what draws the pictures, bakes the light and, with the tracer, traces the sound.
        format: form of the dataset.
        remake: shell patterns of the keys of observations that are made again even if they are there.
    """

    only: Sequence[str] = ()
    workers: int | None = None
    vision: Vision | None = None
    audio: Audio | None = None
    frames: int | None = None
    size: int | None = None
    extras: Sequence[Extra] = ()
    cache: Path | None = None
    hrtf: Path | None = None
    ambisonics: int | None = None
    array: Path | None = None
    device: Device = "cpu"
    format: Form = "folders"
    remake: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Refuse what is out of range.

        Raises:
            UsageError: one line.
        """
        for name, limits in (("frames", FRAMES), ("size", SIZE), ("workers", WORKERS), ("ambisonics", ORDERS)):
            _check_whole(name, getattr(self, name), *limits)
        for name, known in (("vision", Vision), ("audio", Audio), ("device", Device), ("format", Form)):
            _check_word(name, getattr(self, name), get_args(known), optional=name in ("vision", "audio"))
        for name, what in (("only", "patterns"), ("remake", "patterns"), ("extras", "names")):
            _check_texts(name, getattr(self, name), what)
        for name in ("cache", "hrtf", "array"):
            if getattr(self, name) is not None:
                check_path(name, getattr(self, name))
        known_extras = get_args(Extra)
        for extra in self.extras:
            if extra not in known_extras:
                hint = did_you_mean(extra, known_extras)
                raise UsageError(f"extras: unknown folder {extra!r}: expected some of {', '.join(known_extras)}{hint}")


def check_path(name: str, value: object) -> None:
    """Refuse what is no path; the name of the argument is for the message.

    Raises:
        UsageError: one line.
    """
    if not isinstance(value, str | os.PathLike):
        raise UsageError(f"{name}: found {excerpt(value)}; expected the path of a file or folder")


def _check_whole(name: str, value: object, low: int, high: int) -> None:
    if value is None:
        return
    whole = not isinstance(value, bool) and hasattr(value, "__index__")
    if not whole or not low <= value <= high:  # type: ignore[operator]  # it is a whole number there
        raise UsageError(f"{name}: found {excerpt(value)}; expected a whole number from {low} to {high}")


def _check_word(name: str, value: object, known: Sequence[str], *, optional: bool) -> None:
    if (value is None and optional) or (isinstance(value, str) and value in known):
        return
    raise UsageError(f"{name}: found {excerpt(value)}; expected one of {', '.join(known)}{did_you_mean(value, known)}")


def _check_texts(name: str, value: object, what: str) -> None:
    if isinstance(value, str) or not isinstance(value, Collection) or not all(isinstance(one, str) for one in value):
        raise UsageError(f"{name}: found {excerpt(value)}; expected a list of {what}")
