"""Tables of recorded figures: those of the pages are current, and a changed figure is found."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from avs3d_bench.errors import Avs3dError
from benchmarks import docs_tables

ROOT = Path(__file__).parents[2]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The pages and the results, to be changed."""
    shutil.copy(ROOT / "README.md", tmp_path)
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    return tmp_path


def test_the_tables_are_current() -> None:
    done = CliRunner().invoke(docs_tables.main, ["--check"], catch_exceptions=False)
    assert done.exit_code == 0, done.output


def test_a_changed_figure_is_found_and_written(copy: Path) -> None:
    assert docs_tables.outdated(copy) == {}
    recorded, page = copy / "docs/results/listen-chance.json", copy / "docs/protocol-listen.md"
    document = json.loads(recorded.read_text())
    document["guesses"]["instance"]["twins"] = 0.9876
    recorded.write_text(json.dumps(document))
    (copy / "docs/results/table3.md").unlink()
    found = docs_tables.outdated(copy)
    assert found.keys() == {page, copy / "docs/results/table3.md"}
    before, after = page.read_text(), found[page]
    assert "| nothing | one instance at random | .988 | .095 |" in after
    assert after == before.replace("| nothing | one instance at random | .095 | .095 |", "| nothing | one instance at random | .988 | .095 |")  # fmt: skip # noqa: E501


def test_a_typed_figure_is_found(copy: Path) -> None:
    page = copy / "docs/results.md"
    text = page.read_text()
    assert "| 760,189 |" in text
    page.write_text(text.replace("| 760,189 |", "| 760,190 |"))
    assert docs_tables.outdated(copy) == {page: text}


def test_a_page_without_its_place_is_one_line(copy: Path) -> None:
    (copy / "docs/comparing.md").write_text("nothing")
    with pytest.raises(Avs3dError, match=r"comparing\.md: expected the lines <!-- power --> and <!-- end of power -->"):
        docs_tables.outdated(copy)
