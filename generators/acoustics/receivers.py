"""The receivers of a run beside the engine's own head: chosen, read and checked before anything is rendered.

A choice travels inside the plans to whoever makes the observations. Of a SOFA file only the path travels, since it may
be large: every process reads it again, and refuses another file than the one that was checked.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.runtime.imports import import_by_name
from avs3d_bench.runtime.user_path import user_path
from generators.acoustics.heads import FAMILIES, draw_head
from generators.core.limits import HeadName

if TYPE_CHECKING:
    import numpy as np

    from avs3d_bench.contract.schema import ArrayRecord, HeadRecord
    from generators.acoustics.tracer.receivers.base import FreeFieldReceiver
    from generators.acoustics.tracer.receivers.measured import HrirHead, SofaHead

#: The engine whose sound other receivers than its own head can hear.
ENGINE = "tracer"
#: What reads and makes the receivers. Texts: the sound of the other engines does not depend on their sources.
PARTS = {
    "head": "generators.acoustics.tracer.receivers.measured:SofaHead",
    "ambisonics": "generators.acoustics.tracer.receivers.ambisonics:Ambisonics",
    "array": "generators.acoustics.tracer.receivers.microphones:Array",
    "array file": "generators.acoustics.tracer.receivers.array_file:read_array",
    "drawn head": "generators.acoustics.tracer.receivers.parametric:parametric_head",
}
#: Words of ``hrtf`` that are no file: the engine's own head, heads of the family, a measured mannequin.
SPHERE, KEMAR = "sphere", "kemar"
WORDS = get_args(HeadName)
#: Where packages put the responses of KEMAR (those of Debian and Ubuntu).
_KEMAR_FILES = ("/usr/share/libmysofa/MIT_KEMAR_normal_pinna.sofa", "/usr/share/libmysofa/default.sofa")


@dataclass(frozen=True)
class Receivers:
    """The receivers of an observation.

    Attributes:
        hrtf: SOFA file of the head that hears the binaural clips, absolute; None: the engine's own head.
        hrtf_sha256: of its contents; empty without one.
        ambisonics: order of the ambisonic clips; 0: there are none.
        array: the microphones of the array; None: there is none.
        family: of `FAMILIES`, if the binaural clips are heard by a head of the parametric family; else empty.
        drawn: that head; `for_observation` draws it.
        chosen: whether the head was asked for, so that the manifest's does not count.
    """

    hrtf: Path | None = None
    hrtf_sha256: str = ""
    ambisonics: int = 0
    array: ArrayRecord | None = None
    family: str = ""
    drawn: HeadRecord | None = None
    chosen: bool = field(default=False, compare=False)

    def __bool__(self) -> bool:
        """Whether there is anything but the engine's own head."""
        return self.hrtf is not None or bool(self.family) or bool(self.channels)

    def for_observation(self, rng: np.random.Generator) -> Receivers:
        """The receivers of one observation: with a head of the family, if there is to be one, drawn from ``rng``."""
        return replace(self, drawn=draw_head(FAMILIES[self.family], rng)) if self.family else self

    @property
    def channels(self) -> dict[str, int]:
        """Those beside the two ears, of `layout.RECEIVERS`, in that order → number of their channels."""
        found = {}
        if self.ambisonics:
            found[layout.AMBISONICS] = (self.ambisonics + 1) ** 2
        if self.array is not None:
            found[layout.ARRAY] = self.array.channels
        return found

    def identity(self) -> dict[str, Any]:
        """Content for digests; the place and the name of the SOFA file are no part of it.

        observation.json records the name that the file had (``asset`` of `HrtfRecord`, the setting ``hrtf_file``).
        A rerun and a regeneration compare the sha256 of its contents alone.
        """
        array = None if self.array is None else self.array.model_dump(mode="json")
        found = {"hrtf": self.hrtf_sha256, "ambisonics": self.ambisonics, "array": array}
        if self.family:
            found["head"] = [self.family, None if self.drawn is None else self.drawn.model_dump(mode="json")]
        return found

    def head(self) -> HrirHead | None:
        """The measured head, or that of the family; None: the engine's own.

        Raises:
            Avs3dError: if the file cannot be read, or is no longer the one that was chosen.
        """
        if self.drawn is not None:
            head: HrirHead = import_by_name(PARTS["drawn head"])(self.drawn)
            return head
        return self.measured()

    def measured(self) -> SofaHead | None:
        """The head of the SOFA file; None without one.

        Raises:
            Avs3dError: if the file cannot be read, or is no longer the one that was chosen.
        """
        if self.hrtf is None:
            return None
        status = os.stat(self.hrtf) if self.hrtf.is_file() else None
        found = _head(self.hrtf, (status.st_size, status.st_mtime_ns) if status else None)
        if found.hrirs.sha256 != self.hrtf_sha256:
            raise Avs3dError(
                f"{self.hrtf}: its sha256 is {found.hrirs.sha256[:12]}…, expected {self.hrtf_sha256[:12]}…; "
                "the file must not change while a dataset is generated"
            )
        return found

    def others(self) -> dict[str, FreeFieldReceiver]:
        """Name → receiver, in the order of `channels`."""
        found: dict[str, FreeFieldReceiver] = {}
        if self.ambisonics:
            found[layout.AMBISONICS] = import_by_name(PARTS["ambisonics"])(self.ambisonics)
        if self.array is not None:
            found[layout.ARRAY] = import_by_name(PARTS["array"])(self.array)
        return found


#: The two ears of the engine's own head, and nothing else.
OWN_HEAD = Receivers()


@lru_cache(maxsize=1)
def _head(path: Path, _state: tuple[int, int] | None) -> SofaHead:
    """The head of a file, read once in a process as long as the file's size and time stay the same."""
    head: SofaHead = import_by_name(PARTS["head"])(path)
    return head


def choose_receivers(
    audio: str,
    *,
    hrtf: str | Path | None = None,
    ambisonics: int | None = None,
    array: str | Path | ArrayRecord | None = None,
) -> Receivers:
    """Read and check all that the receivers of a run need.

    Args:
        audio: name of the acoustic engine.
        hrtf: a word of `WORDS`, or the SOFA file of a head (SimpleFreeFieldHRIR).
        ambisonics: order, 1 to 3.
        array: the microphones, or the file that lists them.

    Raises:
        UsageError: if the engine has no such receivers, or the order is out of range.
        Avs3dError: if a file is missing or wrong, or h5py is not installed.
    """
    check_engine(audio, hrtf=hrtf, ambisonics=ambisonics, array=array)
    microphones: ArrayRecord | None = (
        import_by_name(PARTS["array file"])(user_path(array)) if isinstance(array, str | os.PathLike) else array
    )
    if ambisonics is not None:
        import_by_name(PARTS["ambisonics"])(ambisonics)  # checks the order
    found = Receivers(ambisonics=ambisonics or 0, array=microphones)
    return found if hrtf is None else with_head(found, hrtf)


def with_head(receivers: Receivers, hrtf: str | Path) -> Receivers:
    """The receivers with the head that ``hrtf`` names: a word of `WORDS`, or a SOFA file.

    Raises:
        Avs3dError: if the file is missing or wrong, KEMAR is not installed, or h5py is not.
    """
    word = str(hrtf)
    if word == SPHERE:
        return replace(receivers, chosen=True)
    if word in FAMILIES:
        return replace(receivers, family=word, chosen=True)
    path = _kemar() if word == KEMAR else user_path(hrtf).absolute()
    head: SofaHead = import_by_name(PARTS["head"])(path)
    return replace(receivers, hrtf=path, hrtf_sha256=head.hrirs.sha256, chosen=True)


def head_identity(hrtf: str | Path | None) -> str | None:
    """What tells one ``hrtf`` from another: its word, or the sha256 of its file.

    Raises:
        Avs3dError: if the file cannot be read, or KEMAR is not installed.
    """
    if hrtf is None:
        return None
    word = str(hrtf)
    if word in (SPHERE, *FAMILIES):
        return word
    return files.sha256_file(_kemar() if word == KEMAR else hrtf)


def _kemar() -> Path:
    found = next((Path(name) for name in _KEMAR_FILES if Path(name).is_file()), None)
    if found is None:
        raise Avs3dError(
            f"--hrtf {KEMAR}: no file {_KEMAR_FILES[0]}; install it (Debian, Ubuntu: apt-get install libmysofa1), "
            "or name a SOFA file with --hrtf FILE"
        )
    return found


def check_engine(audio: str, **chosen: object) -> None:
    """Refuse receivers that the engine called ``audio`` does not have.

    Raises:
        UsageError: naming the first of them that is given.
    """
    for name, value in chosen.items():
        if value is not None and audio != ENGINE:
            option = f"--{name}" if name == "hrtf" else f"--with {name}"
            raise UsageError(f"{option} needs the engine {ENGINE}, found {audio}: add --audio {ENGINE}")
