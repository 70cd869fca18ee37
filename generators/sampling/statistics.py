"""Tables about a sampled manifest: what stands where, what sounds, how the homes are used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from generators.manifest.schema import Manifest
from generators.sampling.rooms import MOST
from generators.sampling.sample import SampledGroup


def tables(manifest: Manifest, units: Sequence[SampledGroup]) -> list[Table]:
    """The tables that `avs3d manifest sample` prints."""
    return [_sounding(manifest), _identical(manifest, units), _kinds(units), _totals(manifest, units)]


def sounding(manifest: Manifest) -> Counter[tuple[str, str]]:
    """(category, room or ``off-screen``) → number of sources."""
    counts: Counter[tuple[str, str]] = Counter()
    for spec in manifest.observations:
        if spec.category is not None:
            counts[spec.category, spec.room] += 1
        for source in spec.sources or ():
            counts[source.category, "off-screen" if source.room else spec.room] += 1
    return counts


def _sounding(manifest: Manifest) -> Table:
    counts, places = sounding(manifest), (*MOST, "off-screen")
    names = sorted({category for category, _ in counts})
    rows = [[name, *(counts[name, place] for place in places)] for name in names]
    return _table("Sources by category and room", ["category", *places, "all"], [[*row, sum(row[1:])] for row in rows])


def _identical(manifest: Manifest, units: Sequence[SampledGroup]) -> Table:
    """How many rooms have how many objects of a category; siblings count once."""
    specs = {spec.key: spec for spec in manifest.observations}
    counts: Counter[tuple[str, int]] = Counter()
    for unit in units:
        first = unit.entries[0]
        objects = specs["/".join(str(first[name]) for name in ("part", "scan", "room", "index"))].objects
        counts.update(objects.items())
    numbers = range(1, max(number for _, number in counts) + 1)
    names = sorted({category for category, _ in counts})
    rows = [[name, *(counts[name, number] for number in numbers)] for name in names]
    return _table("Rooms with so many objects of a category", ["category", *map(str, numbers)], rows)


def _kinds(units: Sequence[SampledGroup]) -> Table:
    counts: Counter[tuple[str, str]] = Counter()
    for unit in units:
        counts.update((kind, unit.entries[0]["part"]) for kind in unit.kinds)
    parts = sorted({part for _, part in counts})
    rows = [[kind, *(counts[kind, part] for part in parts)] for kind in dict.fromkeys(k for k, _ in sorted(counts))]
    return _table("Observations by what sounds", ["what sounds", *parts], rows)


def _totals(manifest: Manifest, units: Sequence[SampledGroup]) -> Table:
    per_home = Counter(spec.scan for spec in manifest.observations)
    background = Counter(spec.background.kind if spec.background else "none" for spec in manifest.observations)
    snr = [spec.background.snr_db for spec in manifest.observations if spec.background]
    programmes = sum(s.programme is not None for spec in manifest.observations for s in spec.sources or ())
    rows: list[list[Any]] = [
        ["homes", len(manifest.scans)],
        ["observations", len(manifest.observations)],
        ["observations of a home", _range(list(per_home.values()))],
        ["pictures (groups and observations of part_1 and part_2)", len(units)],
        ["groups", sum(unit.entries[0]["part"] == "part_3" for unit in units)],
        ["background", ", ".join(f"{name} {count}" for name, count in sorted(background.items()))],
        ["SNR of the background (dB)", _range(snr)],
        ["sources with a programme", programmes],
        ["frames", len(manifest.observations) * manifest.camera.frames],
    ]
    return _table("Totals", ["", ""], rows)


def _range(values: Sequence[float]) -> str:
    return f"{min(values):g} to {max(values):g}" if values else "–"


def _table(title: str, header: Sequence[str], rows: Sequence[Sequence[Any]]) -> Table:
    table = Table(title=title, title_justify="left")
    for number, name in enumerate(header):
        table.add_column(name, justify="right" if number else "left")
    for row in rows:
        table.add_row(*(str(value) for value in row))
    return table
