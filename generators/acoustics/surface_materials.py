"""Which material each surface of a room has: globs over names → a material of the table, or coefficients of one's own.

::

    {"*": "plaster", "floor*": "parquet", "Curtain_??": {"absorption": {125: 0.1, 1000: 0.6}, "scattering": 0.5}}

A file (YAML or JSON) has the same lines, or names its own materials first::

    materials:
      my_carpet: {absorption: [0.02, 0.06, 0.14, 0.37, 0.6, 0.65], scattering: 0.3, transmission: 0.001}
    surfaces:
      "*": plaster
      "floor*": my_carpet

Labels of faces count before names of meshes, and those before names of their materials. Of the patterns that match one
name, the most specific counts: the one with the most characters that are no wildcard, of equal ones the later.
Names of the table (`generators.acoustics.materials.MATERIALS`) are materials in an inhabited room, whose small things
absorb 6 % more; coefficients are used as they are. SoundSpaces' own material files are read too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import translate
from pathlib import Path
from typing import Any

import numpy as np

from avs3d_bench.errors import Avs3dError, did_you_mean, excerpt, near_names
from generators.acoustics.materials import MATERIALS, OCTAVE_BANDS, Spectrum, spectral_label

#: Scattering where a material gives none.
_SCATTERING = 0.1
_KEYS = ("absorption", "scattering", "transmission")
_EXPECTED = f"expected a name of the table, coefficients in [0, 1] (one, six of 125 Hz … 4 kHz, or {{Hz: value}}), or a dict of {', '.join(_KEYS)}"  # noqa: E501


@dataclass(frozen=True)
class SurfaceMaterials:
    """The lines of a room's materials.

    Attributes:
        lines: pattern, acoustic label and the material's name, in the order given.
    """

    lines: tuple[tuple[str, str, str], ...]

    @property
    def patterns(self) -> list[str]:
        """The globs."""
        return [pattern for pattern, _, _ in self.lines]

    def match(self, names: Sequence[str]) -> tuple[int, str] | None:
        """The number of the line that one of ``names`` matches, and that name; None without one."""
        order = sorted(range(len(self.lines)), key=lambda n: (_literal(self.lines[n][0]), n), reverse=True)
        patterns = [(number, re.compile(translate(self.lines[number][0].lower()))) for number in order]
        for name in names:
            for number, pattern in patterns:
                if _literal(self.lines[number][0]) and pattern.match(name.lower()):
                    return number, name
        for number, pattern in patterns:  # wildcards alone
            if pattern.match(names[0].lower() if names else ""):
                return number, names[0] if names else ""
        return None


def _literal(pattern: str) -> int:
    """Number of characters of a glob that are no wildcard."""
    return len(re.sub(r"\[[^]]*\]|[*?]", "", pattern))


def nearest_names(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Patterns like one of the names, best first."""
    plain = {re.sub(r"[*?]", "", pattern).lower(): pattern for pattern in patterns}
    found = [plain[near] for name in names for near in near_names(name.lower(), plain)]
    return list(dict.fromkeys(found))


def surface_materials(given: Any) -> SurfaceMaterials:
    """The materials of a room, checked.

    Args:
        given: a name, coefficients, a dict as in the module's docstring, or the path of a file.

    Raises:
        Avs3dError: one line: an unknown name with the nearest ones, a coefficient out of range, a wrong shape.

    Examples:
        >>> surface_materials({"floor*": "parquet", "*": 0.1}).patterns
        ['floor*', '*']
    """
    if isinstance(given, SurfaceMaterials):
        return given
    if isinstance(given, Path) or (isinstance(given, str) and re.search(r"\.(ya?ml|json)$", given, re.IGNORECASE)):
        return _from_file(Path(given))
    if isinstance(given, Mapping) and not _is_material(given):
        return _from_lines(given, "materials")
    return _from_lines({"*": given}, "materials")


def _from_file(path: Path) -> SurfaceMaterials:
    from avs3d_bench.formats.yamlfile import read_yaml

    document, _ = read_yaml(path)
    if not isinstance(document, Mapping) or not document:
        raise Avs3dError(f"{path}: is {excerpt(document)}, expected lines of GLOB: MATERIAL")
    if isinstance(document.get("materials"), list):
        return _from_soundspaces(path)
    return _from_lines(document, str(path))


def _from_soundspaces(path: Path) -> SurfaceMaterials:
    from generators.acoustics.materialfile import read_material_file

    file = read_material_file(path)
    lines = [(f"*{category}*", label, category) for category, label in file.labels.items()]
    return SurfaceMaterials(tuple(lines) + ((("*", file.default, "default"),) if file.default else ()))


def _from_lines(document: Mapping[Any, Any], where: str) -> SurfaceMaterials:
    own: dict[str, str] = {}
    lines: Any = document
    if isinstance(document.get("surfaces"), Mapping):
        wrong = next((key for key in document if key not in ("materials", "surfaces")), None)
        if wrong is not None:
            raise Avs3dError(f"{where}: has {wrong!r} beside materials and surfaces; move it into one of them")
        lines = document["surfaces"]
        defined = document.get("materials", {})
        if not isinstance(defined, Mapping):
            raise Avs3dError(f"{where}: materials is {excerpt(defined)}, expected names with their coefficients")
        own = {str(name): _label_of(value, f"{where}: materials.{name}", {})[0] for name, value in defined.items()}
    if not lines:
        raise Avs3dError(f"{where}: no line; expected GLOB: MATERIAL, for example '*': plaster")
    return SurfaceMaterials(
        tuple((str(glob), *_label_of(value, f"{where}: {glob!r}", own)) for glob, value in lines.items())
    )


def _is_material(given: Mapping[Any, Any]) -> bool:
    """Whether a dict is one material, and not lines of globs."""
    return bool(given) and (set(given) <= set(_KEYS) or all(isinstance(key, int | float) for key in given))


def _label_of(value: Any, where: str, own: Mapping[str, str]) -> tuple[str, str]:
    """The acoustic label of a material, and its name."""
    if isinstance(value, str):
        name = value.strip().lower()
        if value in own:
            return own[value], value
        if name in MATERIALS:
            return name, name
        known = [*own, *MATERIALS]
        guess = did_you_mean(value, known, otherwise=f"; the table has {', '.join(MATERIALS)}")
        raise Avs3dError(f"{where}: unknown material {excerpt(value)}{guess}")
    if isinstance(value, Mapping) and set(map(str, value)) & set(_KEYS):
        wrong = next((key for key in value if key not in _KEYS), None)
        if wrong is not None or "absorption" not in value:
            found = f"has {wrong!r}" if wrong is not None else "has no absorption"
            raise Avs3dError(f"{where}: {found}; {_EXPECTED}")
        scattering = _octaves(value.get("scattering", _SCATTERING), f"{where}: scattering")
        passing = value.get("transmission")
        transmission = None if passing is None else _octaves(passing, f"{where}: transmission")
        return spectral_label(_octaves(value["absorption"], f"{where}: absorption"), scattering, transmission), "given"
    return spectral_label(_octaves(value, where), (_SCATTERING,) * 6), "given"


def _octaves(value: Any, where: str) -> Spectrum:
    """Six coefficients from one, six, or a dict of some octaves (between them linear over the logarithm)."""
    try:
        if isinstance(value, Mapping):
            pairs = sorted((float(key), float(entry)) for key, entry in value.items())
            keys, values = np.array(pairs).T
            six = np.interp(np.log(OCTAVE_BANDS), np.log(keys), values) if (keys > 0).all() else np.full(6, np.nan)
            given = values
        else:
            given = np.array(value, dtype=np.float64)
            six = np.broadcast_to(given, (6,)) if given.size in (1, 6) else np.full(6, np.nan)
    except (TypeError, ValueError):
        raise Avs3dError(f"{where} is {excerpt(value)}; {_EXPECTED}") from None
    if not (np.isfinite(six).all() and (given >= 0).all() and (given <= 1).all()):
        raise Avs3dError(f"{where} is {excerpt(value)}; {_EXPECTED}")
    a, b, c, d, e, f = (float(entry) for entry in six)
    return a, b, c, d, e, f
