"""docs/comparison.md: every statement about a project has a link to its source, and every table has every project."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parent.parent / "docs" / "comparison.md"
PROJECTS = [
    "avs3d-bench",
    "SoundSpaces 2.0",
    "AudibleLight",
    "SonicSim",
    "Kubric",
    "JAEGER",
    "SAVVY",
    "DCASE 3",
    "DCASE 4",
]
LINK = re.compile(r"\[[^\]]+\]\(([^)\s]+)\)")
UNKNOWN = "not stated"


def tables(text: str) -> list[list[list[str]]]:
    """The cells of every table, row by row, without its headings."""
    found = re.findall(r"(?:^\|.*\n)+", text, re.M)
    return [[[cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines()[2:]] for table in found]


TABLES = tables(PAGE.read_text(encoding="utf-8"))


def unsupported(cell: str) -> list[str]:
    """Statements of a cell, split at semicolons, that have neither a link nor the words that the source is silent."""
    return [part for part in cell.split("; ") if not LINK.search(part) and not part.endswith(UNKNOWN)]


def test_every_table_has_every_project_once() -> None:
    assert len(TABLES) == 4
    for table in TABLES:
        assert [row[0] for row in table] == PROJECTS
        assert len({len(row) for row in table}) == 1


@pytest.mark.parametrize("project", PROJECTS)
def test_every_statement_has_a_source(project: str) -> None:
    for cell in (cell for table in TABLES for row in table if row[0] == project for cell in row[1:]):
        # Statements joined by a semicolon may share the link at the end of the cell.
        assert LINK.search(cell.rpartition("; ")[2]) or cell.endswith(UNKNOWN), cell
        if UNKNOWN in cell:
            assert unsupported(cell) == [], cell


def test_sources_of_other_projects_are_theirs_and_own_ones_exist() -> None:
    for table in TABLES:
        for row in table:
            for target in LINK.findall(" ".join(row[1:])):
                if row[0] == PROJECTS[0]:
                    assert (PAGE.parent / target.partition("#")[0]).is_file(), target
                else:
                    assert target.startswith("https://"), target


def test_a_statement_without_a_source_is_found() -> None:
    assert unsupported("many ([paper](https://x.org)); masks: not stated") == []
    assert unsupported("many; masks: not stated") == ["many"]
    assert tables("| | a |\n|---|---|\n| b | c |\n") == [[["b", "c"]]]
