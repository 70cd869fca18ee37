"""Sweeps: a manifest whose observations are those of another one, with every combination of some acoustic parameters.

Of each observation, one variant is its original: it has the observation's key and renders the pictures. The others take
over its pictures, its path and its source signals, and differ in the swept parameters alone. Scores of variants can
therefore be compared observation by observation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from avs3d_bench.errors import UsageError, did_you_mean
from generators.core.limits import MOST_INDEX
from generators.manifest.reading import ManifestFile, select
from generators.manifest.schema import ABSORPTION_SCALE, SNR_DB, BackgroundSpec, Manifest, ObservationSpec

#: Largest number of observations of a sweep.
MOST_VARIANTS = 5_000
#: Value of ``background.snr_db`` that stands for no background.
NONE = "none"
#: Kind of background where neither the sweep nor the observation names one.
USUAL_KIND = "noise"

#: A value of a parameter; None: no background.
Value = float | str | None
#: Field → value, in the order of the options.
Point = dict[str, Value]

SCALE, SNR, KIND = "acoustics.absorption_scale", "background.snr_db", "background.kind"


@dataclass(frozen=True)
class Axis:
    """A parameter of a sweep and its values.

    Attributes:
        field: its name in the manifest, e.g. ``background.snr_db``.
        values: at least one.
    """

    field: str
    values: tuple[Value, ...]


def _number(text: str, low: float, high: float, also: str = "") -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        what = "out of range" if math.isfinite(value) else "not a number"
        raise UsageError(f"{text!r} is {what}; expected {low:g} to {high:g}{also}")
    return value


def _scale(text: str) -> Value:
    return _number(text, *ABSORPTION_SCALE)


def _snr(text: str) -> Value:
    return None if text == NONE else _number(text, *SNR_DB, also=f" (dB), or {NONE}")


def _kind(text: str) -> Value:
    kinds = ("room_tone", "noise")
    if text not in kinds:
        raise UsageError(f"{text!r} is no background; expected {' or '.join(kinds)}{did_you_mean(text, kinds)}")
    return text


#: Field that a sweep can vary → reads one of its values.
FIELDS: dict[str, Callable[[str], Value]] = {SCALE: _scale, SNR: _snr, KIND: _kind}


def parse_axis(text: str) -> Axis:
    """Read ``acoustics.absorption_scale=0.5,1,2``.

    Raises:
        UsageError: if the field is unknown, or a value is missing, wrong, out of range or listed twice.

    Examples:
        >>> parse_axis("background.snr_db=none,20")
        Axis(field='background.snr_db', values=(None, 20.0))
    """
    field, equals, listed = (piece.strip() for piece in text.partition("="))
    where = f"--over {text}"
    if field not in FIELDS:
        raise UsageError(
            f"{where}: unknown field {field!r}; expected one of {', '.join(FIELDS)}{did_you_mean(field, FIELDS)}"
        )
    words = [word.strip() for word in listed.split(",")]
    if not equals or not all(words):
        raise UsageError(
            f"{where}: a value is missing; expected values separated by commas, e.g. {field}={_example(field)}"
        )
    values: list[Value] = []
    for word in words:
        try:
            value = FIELDS[field](word)
        except UsageError as error:
            raise UsageError(f"{where}: {error}") from None
        if value in values:
            raise UsageError(f"{where}: {word} is listed twice; give each value once")
        values.append(value)
    return Axis(field, tuple(values))


def _example(field: str) -> str:
    return {SCALE: "0.5,1,2", SNR: f"{NONE},20,10,0", KIND: "noise"}[field]


def grid_of(axes: Sequence[Axis]) -> tuple[Point, ...]:
    """All combinations of the values, the last parameter fastest.

    Raises:
        UsageError: if there is no parameter, or one is given twice.
    """
    fields = [axis.field for axis in axes]
    if not fields:
        raise UsageError("no parameter to sweep; give --over FIELD=VALUE,… with one of " + ", ".join(FIELDS))
    twice = next((field for field in fields if fields.count(field) > 1), None)
    if twice is not None:
        raise UsageError(f"--over {twice} is given twice; list all its values in one")
    return tuple(dict(zip(fields, values, strict=True)) for values in product(*(axis.values for axis in axes)))


def sweep(
    source: ManifestFile, document: dict[str, Any], axes: Sequence[Axis], only: Sequence[str] = ()
) -> dict[str, Any]:
    """The manifest of a sweep, as `generators.sampling.document.manifest_text` writes it.

    Args:
        source: the manifest whose observations are varied.
        document: its fields as they are in the file.
        axes: the parameters.
        only: shell patterns of observation keys; the others are left out.

    Raises:
        UsageError: if the parameters do not fit the observations, or there are too many variants.
    """
    manifest, grid = source.manifest, grid_of(axes)
    chosen = select(manifest, only)
    _check(chosen, grid)
    raw = {spec.key: entry for spec, entry in zip(manifest.observations, document["observations"], strict=True)}
    last: dict[str, int] = {}
    for spec in manifest.observations:
        last[_place(spec.key)] = max(spec.index, last.get(_place(spec.key), 0))
    entries: list[dict[str, Any]] = []
    for spec in chosen:
        first, *others = variants_of(spec, grid)
        entries.append(raw[spec.key] | first)
        for other in others:
            last[_place(spec.key)] += 1
            entries.append(_variant(spec, last[_place(spec.key)], other))
    if max(last.values()) > MOST_INDEX:
        raise UsageError(
            f"{max(last.values())} observations of one room; expected at most {MOST_INDEX}: use fewer values"
        )
    used = {spec.scan for spec in chosen}
    scans = {name: scan for name, scan in document["scans"].items() if name in used}
    swept = document | {"name": f"{manifest.name}-sweep", "scans": scans}
    swept.pop("observations")
    swept["observations"] = entries
    Manifest.model_validate(swept)
    return swept


def variants_of(spec: ObservationSpec, grid: Sequence[Point]) -> list[dict[str, Any]]:
    """The fields in which the variants of an observation differ; its own values first, if the grid has them.

    Combinations that sound the same (no background, of either kind) are one variant.
    """
    found: list[dict[str, Any]] = []
    for point in grid:
        fields: dict[str, Any] = {}
        if SCALE in point:
            fields["acoustics"] = {"absorption_scale": point[SCALE]}
        if SNR in point or KIND in point:
            fields["background"] = _background(spec, point)
        if fields not in found:
            found.append(fields)
    background = spec.background.model_dump() if spec.background else None
    own: dict[str, Any] = {"acoustics": spec.acoustics.model_dump(), "background": background}
    at = next((n for n, fields in enumerate(found) if fields.items() <= own.items()), 0)
    return [found[at], *found[:at], *found[at + 1 :]]


def _background(spec: ObservationSpec, point: Point) -> dict[str, Any] | None:
    snr = point.get(SNR, spec.background and spec.background.snr_db)
    if snr is None:
        return None
    kind = point.get(KIND) or (spec.background.kind if spec.background else USUAL_KIND)
    return BackgroundSpec.model_validate({"kind": kind, "snr_db": snr}).model_dump()


def _variant(spec: ObservationSpec, index: int, fields: dict[str, Any]) -> dict[str, Any]:
    return {"variant_of" if spec.is_part_3 else "like": spec.key, "index": index} | fields


def _place(key: str) -> str:
    return key.rpartition("/")[0]


def _check(chosen: Sequence[ObservationSpec], grid: Sequence[Point]) -> None:
    """Refuse observations that cannot be varied like this, and too many variants.

    Raises:
        UsageError: naming the first observation.
    """
    count = len(chosen) * len(grid)
    if count > MOST_VARIANTS:
        raise UsageError(
            f"{len(chosen):,} observations with {len(grid):,} variants each are {count:,}; expected at most "
            f"{MOST_VARIANTS:,}: use fewer values, or choose observations with --only"
        )
    keys = {spec.key for spec in chosen}
    for spec in chosen:
        original = spec.variant_of or (None if spec.is_part_3 else spec.like)
        if original is not None:
            raise UsageError(f"{spec.key} is itself a variant of {original}; choose the originals with --only")
        if spec.like is not None and spec.like not in keys:
            raise UsageError(f"{spec.key} has the pictures of {spec.like}, which --only leaves out; choose both")
        if {SNR, KIND} & set(grid[0]) and not spec.is_part_3:
            raise UsageError(
                f"{spec.key}: background belongs to part_3; sweep {SCALE} alone, or choose observations of part_3 with "
                "--only"
            )
        if KIND in grid[0] and SNR not in grid[0] and spec.background is None:
            raise UsageError(f"{spec.key} has no background whose kind could be swept; give --over {SNR}=… as well")


def check_place(source: ManifestFile, output: Path) -> None:
    """Refuse to write a manifest elsewhere if it names files relative to its folder.

    Args:
        source: the manifest whose observations are varied.
        output: path of the sweep.

    Raises:
        UsageError: with the folder where it can be written.
    """
    manifest = source.manifest
    named = [*manifest.objects.values(), *manifest.sounds.values()]
    relative = any(named) or any(scan.file or scan.asset or scan.materials for scan in manifest.scans.values())
    if relative and output.resolve().parent != source.base:
        raise UsageError(
            f"{output}: {source.path.name} names files or assets relative to its folder; write the sweep to "
            f"{source.base} with -o"
        )
