"""SoundSpaces' own material files: absorption and scattering by the categories of annotated objects.

::

    {"materials": [{"name": "carpet", "labels": ["rug", "carpet"], "absorption": [125, 0.02, 250, 0.06, …],
                    "scattering": [f, v, …], "transmission": [f, v, …], "damping": …, "density": …, "speed": …}, …]}

Spectra are pairs of frequency (Hz) and coefficient; they are resampled to our octaves, linearly over the logarithm of
the frequency and constant beyond their ends. The file's values are used as they are, without the absorption of small
things that the table of `generators.acoustics.materials` adds. Transmission, damping, density and speed are not used.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes
from generators.acoustics.materials import OCTAVE_BANDS, Spectrum, spectral_label

#: Scattering where a material gives none.
_SCATTERING: Spectrum = (0.1,) * 6
#: No frequency is as high, and it is less than a float holds.
_MOST = 1e300
_MOST_BYTES = 20_000_000


@dataclass(frozen=True)
class MaterialFile:
    """Category (lower case) → acoustic label that carries the coefficients (see `spectral_label`).

    Attributes:
        path: where it was read.
        labels: by category.
        default: of the material whose labels hold ``default``, if there is one.
    """

    path: Path
    labels: dict[str, str]
    default: str | None = None

    def label_for(self, words: Sequence[str]) -> str | None:
        """The label for an object called ``words``: the whole name, else the longest label that it contains.

        None where the file has neither; its default, if it has one, for names that it does not know.
        """
        if not words:
            return None
        for word in words:
            if word in self.labels:
                return self.labels[word]
        for word in words:
            parts = [label for label in self.labels if f" {label} " in f" {word} "]
            if parts:
                return self.labels[max(parts, key=lambda label: (len(label), label))]
        return self.default


def read_material_file(path: Path) -> MaterialFile:
    """Read a material file.

    Raises:
        Avs3dError: one line with the material and the field.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise Avs3dError(f"{path}: {path.stat().st_size} bytes; expected a small JSON file of materials")
        document = json.loads(read_bytes(path).decode("utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise Avs3dError(f"{path}: cannot be read as JSON ({reason}); expected SoundSpaces' material file") from error
    entries = document.get("materials") if isinstance(document, dict) else None
    if not isinstance(entries, list) or not entries:
        raise Avs3dError(f'{path}: has no materials; expected {{"materials": [{{"name", "labels", "absorption", …}}]}}')
    labels: dict[str, str] = {}
    default = None
    for number, entry in enumerate(entries):
        where = f"{path}: materials[{number}]"
        if not isinstance(entry, dict):
            raise Avs3dError(f"{where}: is {entry!r:.60}; expected an object with name, labels and absorption")
        name = entry.get("name")
        where += f" ({name})" if isinstance(name, str) else ""
        given = entry.get("labels")
        if not isinstance(given, list) or not all(isinstance(label, str) for label in given):
            raise Avs3dError(f"{where}: labels is {given!r:.60}; expected a list of category names")
        if "absorption" not in entry:
            raise Avs3dError(f"{where}: has no absorption; expected [f0, a0, f1, a1, …]")
        absorption = _octaves(entry["absorption"], f"{where}: absorption")
        scattering = _octaves(entry["scattering"], f"{where}: scattering") if "scattering" in entry else _SCATTERING
        label = spectral_label(absorption, scattering)
        for category in given:
            key = " ".join(category.replace("_", " ").lower().split())
            if key == "default":
                default = label
            elif key:
                labels.setdefault(key, label)
    return MaterialFile(path, labels, default)


def _octaves(values: Any, where: str) -> Spectrum:
    """A spectrum [f0, v0, f1, v1, …] at `OCTAVE_BANDS`."""
    numbers = isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < _MOST and math.isfinite(v) for v in values
    )
    if not numbers or not values or len(values) % 2:
        raise Avs3dError(f"{where} is {values!r:.60}; expected pairs of frequency (Hz) and coefficient")
    frequency, value = np.array(values[0::2], dtype=np.float64), np.array(values[1::2], dtype=np.float64)
    if (frequency <= 0).any() or (np.diff(frequency) <= 0).any():
        raise Avs3dError(f"{where}: its frequencies are {frequency.tolist()}; expected positive ones that ascend")
    if (value < 0).any() or (value > 1).any():
        raise Avs3dError(f"{where}: its coefficients are {value.tolist()}; expected values in [0, 1]")
    a, b, c, d, e, f = (float(v) for v in np.interp(np.log(OCTAVE_BANDS), np.log(frequency), value))
    return a, b, c, d, e, f
