"""What one may choose when a manifest is generated; imports nothing heavy, for the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from avs3d_bench.errors import UsageError, did_you_mean
from generators.core.limits import FRAMES, SIZE, WORKERS

#: Renderers, acoustic engines, devices, and optional folders of an observation.
Vision = Literal["embree", "cuda", "habitat"]
Audio = Literal["soundspaces", "tracer", "analytic"]
Device = Literal["cpu", "cuda"]
Extra = Literal["depth", "rirs", "stems"]
#: Forms of a dataset: a folder of files for each observation, or a tar file of samples.
Form = Literal["folders", "tar"]


@dataclass(frozen=True)
class GenerateOptions:
    """What is made of a manifest, and with how many processes.

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
        numbers = (("frames", self.frames, FRAMES), ("size", self.size, SIZE), ("workers", self.workers, WORKERS))
        for name, number, (low, high) in numbers:
            if number is not None and not low <= number <= high:
                raise UsageError(f"{name} {number}: expected {low} to {high}")
        for name, texts, what in (
            ("only", self.only, "patterns"),
            ("extras", self.extras, "names"),
            ("remake", self.remake, "patterns"),
        ):
            if isinstance(texts, str):
                raise UsageError(f"{name}: {texts!r}: expected a list of {what}")
        if self.format not in get_args(Form):
            raise UsageError(f"format: {self.format!r}: expected one of {', '.join(get_args(Form))}")
        known = get_args(Extra)
        for extra in self.extras:
            if extra not in known:
                hint = did_you_mean(extra, known)
                raise UsageError(f"extras: unknown folder {extra!r}: expected some of {', '.join(known)}{hint}")
