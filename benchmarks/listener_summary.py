"""What the tables of the listener say besides the figures: how each row was made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from benchmarks.listener_tables import ROWS

#: Text of a figure that is not there.
MISSING = "–"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a Markdown table."""
    names = list(head)
    return [f"| {' | '.join(names)} |", f"|{'---|' * len(names)}", *(f"| {' | '.join(row)} |" for row in rows), ""]


def looks_text(settings: Mapping[str, Any]) -> str:
    """How often the network looked at a picture."""
    return "one look" if settings["looks"] == "one" else f"{settings['looks']} looks"


def settings_text(settings: Mapping[str, Any]) -> str:
    """How a row was made, from the record of its run; empty for one with nothing to set."""
    said = []
    if "looks" in settings:
        said.append(looks_text(settings))
    if iterations := settings.get("iterations"):
        said.append(f"{iterations:,} iterations")
    if most := settings.get("max_gaussians"):
        said.append(f"at most {most:,} Gaussians")
    if (threshold := settings.get("voting_threshold")) is not None:
        said.append(f"votes above {share(threshold, 1)} of {settings.get('voting_threshold_of', 'all votes')}")
    return ", ".join(said)


def settings_lines(rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """A list of how rows were made, where there is anything to say.

    Args:
        rows: row → its settings.
    """
    lines = [f"- {ROWS[name].title}: {text}" for name, made in rows.items() if (text := settings_text(made))]
    return ["How the rows were made:", "", *lines, ""] if lines else []


def share(value: float | None, digits: int = 3) -> str:
    """``.812``, ``-.006``, ``1.000``; `MISSING` for None."""
    return MISSING if value is None else f"{value:z.{digits}f}".replace("-0.", "-.").removeprefix("0")
