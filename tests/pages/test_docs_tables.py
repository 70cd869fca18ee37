"""Tables of recorded figures: those of the pages are current, and a changed figure is found."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.errors import Avs3dError
from benchmarks import docs_tables, leaderboard_page, separability
from evaluators.reporting.score_file import contents_digest, read_scores

ROOT = Path(__file__).parents[2]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The pages and the results, to be changed."""
    shutil.copy(ROOT / "README.md", tmp_path)
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    return tmp_path


@pytest.mark.slow
def test_the_tables_are_current() -> None:
    done = CliRunner().invoke(docs_tables.main, ["--check"], catch_exceptions=False)
    assert done.exit_code == 0, done.output


@pytest.mark.slow
def test_a_figure_that_was_changed_or_typed_is_found_and_written(copy: Path) -> None:
    recorded, page, typed = (
        copy / "docs" / name for name in ("results/listen-chance.json", "protocol-listen.md", "results.md")
    )
    document = json.loads(recorded.read_text())
    row = "| nothing | one instance at random | {} | {} |"
    was, rest = (docs_tables.share(document["guesses"]["instance"][name]) for name in ("twins", "pair_accuracy"))
    document["guesses"]["instance"]["twins"] = 0.9876
    recorded.write_text(json.dumps(document))
    (copy / "docs/results/table3.md").unlink()
    text = typed.read_text()
    assert "| 760,189 |" in text
    typed.write_text(text.replace("| 760,189 |", "| 760,190 |"))
    found = docs_tables.outdated(copy)
    assert found.keys() == {page, typed, copy / "docs/results/table3.md"}
    before, after = page.read_text(), found[page]
    assert row.format(".988", rest) in after
    assert after == before.replace(row.format(was, rest), row.format(".988", rest))
    assert found[typed] == text


@pytest.mark.slow
def test_the_leaderboard_has_every_file_of_scores(copy: Path) -> None:
    results = copy / "docs/results"
    board = json.loads((results / "leaderboard.json").read_text())
    scored = [path for path in results.glob("*.json") if "avs3d_eval" in json.loads(path.read_text())]
    assert {entry["file"] for entry in board["entries"]} == {path.name for path in scored}
    for entry in board["entries"]:
        assert entry["digest"] == contents_digest(read_scores(results / entry["file"]))
    (results / "listener-open-s34-o7-2d.json").unlink()
    page = copy / "docs/leaderboard.md"
    row = "(results/listener-open-s34-o7-2d.json)"
    assert row in page.read_text()
    assert row not in leaderboard_page.pages(copy / "docs")[page]


@pytest.mark.slow
def test_a_page_without_its_place_is_one_line(copy: Path) -> None:
    (copy / "docs/comparing.md").write_text("nothing")
    with pytest.raises(Avs3dError, match=r"comparing\.md: expected the lines <!-- power --> and <!-- end of power -->"):
        docs_tables.outdated(copy)


def test_shares_of_recognisers_stand_below_their_own_filter() -> None:
    """A file of results has its keys sorted: 16 kHz, 4 kHz, 8 kHz, whole."""
    changes = {"whole": 0.9, "below 16 kHz": 0.8, "below 8 kHz": 0.7, "below 4 kHz": 0.6}
    report = {
        "network": {"test": {name: {"seconds": changes[name], "takes": 1.0} for name in sorted(changes)}},
        "top": {"test": {"whole": {"seconds": 0.2, "takes": 0.1}}},
    }
    head, shares = list(separability.CHANGES), separability.shares_table(report)
    assert dict(zip(head, shares[0][2:], strict=True)) == {name: f"{one:.2f} (1.00)" for name, one in changes.items()}
    assert dict(zip(head, shares[1][2:], strict=True)) == {"whole": "0.20 (0.10)"} | dict.fromkeys(head[1:], "")


def test_a_voice_that_is_left_out_is_not_its_own_neighbour() -> None:
    """Each voice lies beside one of the other category: only what it was trained on itself would be right."""
    names = [f"{voice}/0/dry" for voice in ("clock/a", "clock/b", "toilet/a", "toilet/b") for _ in range(3)]
    clips = separability.Clips(np.zeros((12, 1)), np.repeat([5, 1], 6), names)
    known = np.repeat([0.0, 10.0, 9.0, 1.0], 3)[:, None] + np.tile([0.0, 0.1, 0.2], 4)[:, None]
    answers = separability.left_out(clips, known, workers=1)
    assert answers.argmax(axis=1).tolist() == [1] * 6 + [5] * 6
