"""The blocks of docs/recipes.md that need more than the small dataset of the other pages."""

from __future__ import annotations

from pathlib import Path

import pytest

from avs3d_bench.exports.qa.write import QaOptions, write_qa
from tests.support import tiny
from tests.support.markdown_code import ROOT, Block, blocks, run
from tests.support.shared import SharedDataset

#: Longest recipe (lines).
MOST_LINES = 15


def block(language: str, part: str) -> Block:
    """The block of the page with a text in it."""
    return next(b for b in blocks(ROOT / "docs/recipes.md") if b.language == language and part in b.code)


def test_recipes_are_short() -> None:
    page = (ROOT / "docs/recipes.md").read_text(encoding="utf-8")
    for recipe in page.split("\n## ")[1:]:
        code = [line for text in recipe.split("```")[1::2] for line in text.splitlines()[1:] if line.strip()]
        assert len(code) <= MOST_LINES, recipe.splitlines()[0]


@pytest.mark.slow
def test_a_competition_from_a_sealed_test_to_a_leaderboard(tmp_path: Path) -> None:
    from tests.support import sealed_trees  # needs the [generate] extra

    sealed_trees.write_seal(tmp_path / "sealed")
    tiny.write_dataset(tmp_path / "data/demo", frames=9, size=48)
    said = run(block("bash", "export codabench"), tmp_path)
    assert "to 2099-12-24 23:59:59 UTC" in said
    assert "0 errors" in said
    assert (tmp_path / "leaderboard/index.html").is_file()


@pytest.mark.slow
def test_a_mock_model_is_asked(tmp_path: Path, shared_part_3: SharedDataset, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("inspect_ai", reason="inspect_ai is in the [qa] extra, which the tested set leaves out")
    write_qa(shared_part_3(frames=9), tmp_path / "qa", QaOptions(split="all", per_group=1))
    monkeypatch.setenv("INSPECT_DISPLAY", "none")
    said = run(block("python", "sound_questions"), tmp_path)
    assert "'evaluators/pair_accuracy': 0.0" in said or "'pair_accuracy': 0.0" in said
