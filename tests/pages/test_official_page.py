"""docs/official.md: every named test exists, its code runs, and the defaults are the settings of the paper."""

from __future__ import annotations

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

from avs3d_bench.dataset import Dataset
from evaluators.reporting import paper
from tests.support import tiny
from tests.support.markdown_code import blocks, section

TESTS = Path(__file__).parents[1]
DOCUMENT = TESTS.parent / "docs" / "official.md"
TEXT = DOCUMENT.read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(test_\w+)::(test_\w+)`", TEXT)))


@cache
def functions(module: str) -> set[str]:
    """Names of the test functions of every module of that name below tests/."""
    files = [*TESTS.rglob(f"{module}.py")]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    return {node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize(("module", "function"), NAMED)
def test_every_test_on_the_page_exists(module: str, function: str) -> None:
    assert function in functions(module), f"docs/official.md names {module}::{function}, and there is no such test"


def test_the_defaults_are_the_settings_of_the_paper() -> None:
    pytest.importorskip("torch", reason="torch comes with the extra 'baselines'")
    from baselines.echosegnet.pipeline import Settings
    from baselines.owod_bind.select import THRESHOLD

    settings = Settings()
    assert settings.variant == "official"
    assert settings.refine
    assert settings.voting_threshold == paper.VOTING_THRESHOLD == 0.3
    assert settings.decompose_every == 4
    assert settings.training.iterations == paper.ITERATIONS == 30_000
    assert THRESHOLD == 0.2


def test_the_lines_that_replace_the_fixed_scan_ids_walk_our_scans(tmp_path: Path) -> None:
    root = tiny.write_dataset(tmp_path / "data with a space", frames=1)
    (root / tiny.SINGLE).parents[1].rename(root / "part_1/apartment_2")
    expected = sorted({observation.place.scan for observation in Dataset(root)})
    assert expected == ["apartment_2", "tiny"]
    (shell,) = (block.code for block in blocks(DOCUMENT) if block.language == "bash")
    said = subprocess.run(
        ["sh", "-c", f"{shell}\nprintf '%s\\n' $SCANS"], env={"ROOT": str(root), "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert said.stdout.split() == expected
    part = section(TEXT, "## Running the released scripts on our data")
    (python,) = (block.code for block in blocks(DOCUMENT, part) if block.language == "python")
    values: dict[str, object] = {"Path": Path, "root": str(root)}
    exec(python, values)
    assert values["scans"] == expected
