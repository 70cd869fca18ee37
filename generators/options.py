"""Options of a run of the generator; imports nothing heavy, for the command line."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from avs3d_bench.runtime.user_path import user_path
from generators.acoustics.receivers import ENGINE, OWN_HEAD, Receivers, choose_receivers, with_head
from generators.acoustics.receivers import WORDS as WORDS
from generators.acoustics.receivers import head_identity as head_identity
from generators.core.limits import FRAMES, SIZE, WORKERS

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

#: Renderers, acoustic engines, devices, and optional folders of an observation.
Vision = Literal["embree", "cuda", "habitat", "pathtraced", "splats"]
Audio = Literal["soundspaces", "tracer", "analytic"]
Device = Literal["cpu", "cuda"]
CameraName = Literal["ideal", "mild", "phone"]
Extra = Literal["depth", "rirs", "stems"]
#: Forms of a dataset: a folder of files for each observation, or shards of samples.
Form = Literal["folders", "webdataset"]
#: Acoustic engine of a manifest that names none.
DEFAULT_AUDIO: Audio = "tracer"
#: The renderer of each device, where none is named.
RENDERERS: dict[Device, Vision] = {"cpu": "embree", "cuda": "cuda"}
#: Least and greatest order of ambisonic clips.
ORDERS = (1, 3)


#: Metadata of a field that is no part of `EngineOptions.identity`.
_NO_BYTES = {"decides_bytes": False}
#: Options that observation.json and seal.json record in fields of their own.
_NAMED_IN_RECORDS = frozenset({"vision", "audio", "device", "receivers"})


@dataclass(frozen=True, kw_only=True)
class EngineOptions:
    """Options of whoever computes pictures and sound; every plan carries them, and its digest covers them.

    To add an option: its field here (with a default that changes nothing), its line in `generators.cli`, its use,
    ``plan.options.NAME``. Records, ``--regenerate`` and ``avs3d unseal`` follow. See docs/extending-generator.md.

    Attributes:
        vision: renderer; None: that of the device, embree or cuda. habitat needs ``$AVS3D_HABITAT_PYTHON``, splats a
            scan with splats.
        audio: acoustic engine; soundspaces needs rlr-audio-propagation (CC-BY-NC 4.0). None: the manifest's, else the
            tracer.
        device: draws the pictures, bakes the light and, with the tracer, traces the sound; cuda needs ``[cuda]``.
        camera: mild: exposure, vignette, noise and sharpening of a good camera; phone: more of them (see
            `generators.vision.camera`); ideal: pictures as they are rendered.
        receivers: what hears the sound; see `generators.acoustics.receivers.choose_receivers`.
        extras: optional folders: depth pictures, impulse responses, stems (of part_3).
        scans: folder with scans; None: ``$AVS3D_SCANS``, else that of the manifest.
    """

    vision: Vision | None = None
    audio: Audio | None = None
    device: Device = "cpu"
    camera: CameraName = "mild"
    receivers: Receivers = OWN_HEAD
    extras: Sequence[Extra] = field(default=(), metadata=_NO_BYTES)
    scans: Path | None = field(default=None, metadata=_NO_BYTES)

    @property
    def renderer(self) -> Vision:
        """Name of the renderer."""
        return self.vision or RENDERERS[self.device]

    @property
    def engine(self) -> Audio:
        """Name of the acoustic engine; `GenerateOptions.engine_options` has asked the manifest."""
        return self.audio or DEFAULT_AUDIO

    def identity(self) -> dict[str, Any]:
        """Content for digests: renderer, engine, camera, and what else decides bytes and is not the default.

        Of ``extras``, a plan knows which ones its observation has.
        """
        found = {
            one.name: getattr(self, one.name)
            for one in fields(EngineOptions)
            if one.metadata.get("decides_bytes", True) and getattr(self, one.name) != one.default
        }
        # Records of versions before 4.0.0 lack the camera: it was ideal.
        found |= {"vision": self.renderer, "audio": self.engine, "camera": self.camera}
        if self.receivers:
            found["receivers"] = self.receivers.identity()
        return found

    def further(self) -> dict[str, Scalar]:
        """The options for the records that have no field of their own there; `further_options` reads them."""
        return {name: value for name, value in self.identity().items() if name not in _NAMED_IN_RECORDS}


@dataclass(frozen=True, kw_only=True)
class GenerateOptions(EngineOptions):
    """Options of `generate` and `avs3d generate`.

    Attributes:
        only: shell patterns of observation keys, e.g. ``("part_2/*",)``; none: all observations.
        workers: number of processes of this machine; None: one per core.
        frames: frames per observation; None: the manifest's.
        size: side of the pictures (pixels); None: the manifest's.
        cache: folder of baked homes; None: ``$AVS3D_CACHE``, or the user's cache folder.
        hrtf: the head that hears the binaural clips: ``sphere``, ``family``, ``family-test``, ``kemar`` or a SOFA
            file; only with the tracer, as the next two. None: the manifest's, else the engine's own head.
        ambisonics: order of ambisonic clips, 1 to 3, beside the binaural ones; None: there are none.
        array: file that lists the microphones of an array; None: there is none.
        format: ``folders``, a dataset as `avs3d_bench.Dataset` reads it; or ``webdataset``, tar files of
            samples and ``shards.json``: see `avs3d_bench.exports.observation_tar`.
        remake: shell patterns of the keys of observations that are regenerated even if they are there, from whatever
            manifest or version. Each stays until the new one is whole.
        progress: of `generate`: show a bar on stderr, and a line per finished observation.
    """

    only: Sequence[str] = ()
    workers: int | None = None
    frames: int | None = None
    size: int | None = None
    cache: str | Path | None = None
    hrtf: str | Path | None = None
    ambisonics: int | None = None
    array: str | Path | None = None
    format: Form = "folders"
    remake: Sequence[str] = ()
    progress: bool = False

    def engine_options(self, audio: str, hrtf: str | None = None) -> EngineOptions:
        """The part that plans carry, with the receivers read and checked.

        Args:
            audio: name of the acoustic engine that the manifest names, or `DEFAULT_AUDIO`.
            hrtf: the head that the manifest names; another engine than the tracer has its own.

        Raises:
            UsageError: if the engine has no such receivers.
            Avs3dError: if a file of a receiver is missing or wrong.
        """
        chosen = {one.name: getattr(self, one.name) for one in fields(EngineOptions)}
        chosen |= {"audio": self.audio or audio, "extras": tuple(self.extras)}
        if self.scans is not None:
            chosen["scans"] = user_path(self.scans).absolute()
        if any(value is not None for value in (self.hrtf, self.ambisonics, self.array)):
            chosen["receivers"] = choose_receivers(
                chosen["audio"], hrtf=self.hrtf, ambisonics=self.ambisonics, array=self.array
            )
        if hrtf is not None and chosen["audio"] == ENGINE and not chosen["receivers"].chosen:
            chosen["receivers"] = with_head(chosen["receivers"], hrtf)
        return EngineOptions(**chosen)

    def __post_init__(self) -> None:
        """Refuse what is out of range.

        Raises:
            UsageError: one line.
        """
        for name, limits in (("frames", FRAMES), ("size", SIZE), ("workers", WORKERS), ("ambisonics", ORDERS)):
            _check_whole(name, getattr(self, name), *limits)
        words = {"vision": Vision, "audio": Audio, "device": Device, "camera": CameraName, "format": Form}
        for name, known in words.items():
            _check_word(name, getattr(self, name), get_args(known), optional=name in ("vision", "audio"))
        for name, what in (("only", "patterns"), ("remake", "patterns"), ("extras", "names")):
            _check_texts(name, getattr(self, name), what)
        for name in ("cache", "hrtf", "array", "scans"):
            if getattr(self, name) is not None:
                check_path(name, getattr(self, name))
        known_extras = get_args(Extra)
        for extra in self.extras:
            if extra not in known_extras:
                hint = did_you_mean(extra, known_extras)
                raise UsageError(f"extras: unknown folder {extra!r}: expected some of {', '.join(known_extras)}{hint}")


def further_options(recorded: Mapping[str, Scalar]) -> dict[str, Any]:
    """Arguments for `GenerateOptions`: those of the recorded options that `EngineOptions.further` writes."""
    known = {one.name for one in fields(EngineOptions) if one.metadata.get("decides_bytes", True)} - _NAMED_IN_RECORDS
    return {name: value for name, value in recorded.items() if name in known}


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
