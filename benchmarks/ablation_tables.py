"""`python -m benchmarks.ablation_tables RESULTS.json -o FILE.png`: draws the learning curves of `listener_ablation`.

`summary` and `curves` are the tables of the docs, which `benchmarks.docs_tables` writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from avs3d_bench.commands.outputs import PNG_METADATA
from avs3d_bench.formats.files import read_json, write_bytes
from benchmarks.listener_ablation import ARMS
from benchmarks.listener_seeds import cell
from benchmarks.listener_summary import MISSING, table

#: Arm → what it is called among the others with fewer homes or voices.
HOMES = {"three quarters of the homes": "a quarter of the homes", "half of the homes": "half of the homes"}
VOICES = {
    "three quarters of the voices": "a quarter of the voices",
    "as many sounds as with a quarter of the voices": "… all voices, as many sounds",
    "half of the voices": "half of the voices",
    "as many sounds as with half of the voices": "… all voices, as many sounds",
}
#: The arm with everything.
ALL = "nothing"
#: Share of the homes or voices → arms: of homes; of voices; of as many sounds with all voices.
CURVES = {
    "homes": (*HOMES, ALL),
    "voices": ("three quarters of the voices", "half of the voices", ALL),
    "all voices, as many sounds": (
        "as many sounds as with a quarter of the voices", "as many sounds as with half of the voices", ALL,
    ),
}  # fmt: skip
_SHARES = (25, 50, 100)
_COLUMNS = ("strict IoU", "change", "direction", "category")


def sets_of(arms: Mapping[str, Any]) -> list[str]:
    """The sets that were scored."""
    return [name for name in next(iter(arms.values())) if name not in ("data", "seeds")]


def table_rows(arms: Mapping[str, Any], titles: Mapping[str, str]) -> list[list[str]]:
    """Rows of the docs: the arm, homes and sounds, seeds, and of each set the figures.

    Args:
        arms: of `listener_ablation.collected`.
        titles: arm → what it is called, in the order of the rows.
    """
    return [
        [
            title,
            f"{arms[name]['data']['homes']}, {arms[name]['data']['sounds']:,}",
            str(len(arms[name]["seeds"])),
            *(text for data in sets_of(arms) for text in _cells(arms[name][data])),
        ]
        for name, title in titles.items()
        if name in arms
    ]


def _table(document: Mapping[str, Any], first: str, titles: Mapping[str, str]) -> str:
    arms = document["arms"]
    columns = (f"{name}: {column}" for name in sets_of(arms) for column in _COLUMNS)
    return "\n".join(table([first, "homes, sounds", "seeds", *columns], table_rows(arms, titles))).rstrip()


def summary(document: Mapping[str, Any]) -> str:
    """The table of what is left out, and the steps of all trainings.

    Args:
        document: of `listener_ablation.collected`.
    """
    plan = document["trainings"]
    changes = {name: name for name, arm in ARMS.items() if arm.homes == arm.voices == 1}
    said = (
        f"{plan['picture_steps']:,} steps with {plan['batch']} parts of pictures, then {plan['sound_steps']:,} with "
        f"{plan['batch']} sounds."
    )
    return f"{_table(document, 'left out', changes)}\n\n{said}"


def curves(document: Mapping[str, Any]) -> str:
    """The table of fewer homes and voices."""
    return _table(document, "learns from", {**HOMES, **VOICES, ALL: "all homes and voices"})


def _cells(row: Mapping[str, Any]) -> list[str]:
    """Strict IoU, its change, direction and category: mean, and the range over the seeds."""
    change = row.get("change")
    bounds = [change["mean"], min(change["values"]), max(change["values"])] if change else []
    signed = [f"{value:+.3f}".replace("0.", ".", 1).replace("-", "−") for value in bounds]
    moved = f"{signed[0]} ({signed[1]} to {signed[2]})" if signed else MISSING
    figures = [cell(row[name]) if row.get(name) else MISSING for name in ("strict_IoU", "direction", "category")]
    return [figures[0], moved, *figures[1:]]


def draw(document: Mapping[str, Any]) -> bytes:
    """The PNG of the learning curves: a panel for each set, a curve for each of `CURVES`, a point for each seed.

    Raises:
        ModuleNotFoundError: without matplotlib.
    """
    from evaluators.reporting.tables_plot import COLOURS, encode, new_figure, style

    arms = document["arms"]
    with style():
        names = sets_of(arms)
        drawn = new_figure(1.2 + 3.4 * len(names), 3.4)
        for axes, data in zip(drawn.subplots(1, len(names), sharey=True, squeeze=False)[0], names, strict=True):
            for colour, (title, each) in zip(COLOURS, CURVES.items(), strict=False):
                found = [
                    (x, arms[name][data]["strict_IoU"]) for x, name in zip(_SHARES, each, strict=True) if name in arms
                ]
                points = [(x, figure) for x, figure in found if figure]
                axes.plot([x for x, _ in points], [figure["mean"] for _, figure in points], color=colour, label=title)
                seeds = [(x, value) for x, figure in points for value in figure["values"]]
                axes.plot([x for x, _ in seeds], [y for _, y in seeds], ".", color=colour)
            axes.set_xscale("log")
            axes.set_xticks(_SHARES, [f"{share} %" for share in _SHARES])
            axes.minorticks_off()
            axes.set_xlabel("of the homes, or of the voices")
            axes.set_title(data)
            axes.grid(axis="y")
        drawn.axes[0].set_ylabel("strict IoU")
        drawn.axes[0].legend(frameon=False)
        return encode(drawn, "png", PNG_METADATA)


@click.command()
@click.argument("results", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(results: Path, output: Path) -> None:
    """Draw the learning curves over homes and over voices."""
    write_bytes(output, draw(read_json(results)))


if __name__ == "__main__":
    main()
