"""docs/official.md: every named test exists, every "same" names a test, and the paper's numbers are correct."""

from __future__ import annotations

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest
import tiny
from markdown_code import blocks, section

from avs3d_bench import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.scores import Scores
from evaluators.reporting import paper

TESTS = Path(__file__).parent
DOCUMENT = TESTS.parent / "docs" / "official.md"
TEXT = DOCUMENT.read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(test_\w+)::(test_\w+)`", TEXT)))


def rows(text: str) -> list[dict[str, str]]:
    """Heading → cell, for every row of every table; a bar in code is escaped."""
    out: list[dict[str, str]] = []
    heads: list[str] = []
    for line in text.splitlines():
        if not line.startswith("|"):
            heads = []
            continue
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if not heads:
            heads = cells
        elif set("".join(cells)) - set("-:"):
            out.append(dict(zip(heads, cells, strict=True)))
    return out


@cache
def functions(module: str) -> set[str]:
    """Names of the test functions of every module of that name below tests/."""
    files = [*TESTS.rglob(f"{module}.py")]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    return {node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize(("module", "function"), NAMED)
def test_every_test_on_the_page_exists(module: str, function: str) -> None:
    assert function in functions(module), f"docs/official.md names {module}::{function}, and there is no such test"


def test_every_same_has_its_test_and_every_other_verdict_a_reason() -> None:
    found = [row for row in rows(TEXT) if "verdict" in row]
    same = [row for row in found if row["verdict"].startswith("same")]
    assert len(same) > 20
    for row in same:
        assert "::" in row["test"], f"no test beside 'same': {row}"
    for row in found:
        if row not in same:
            assert row["verdict"].startswith(("not the same: ", "not measured: ", "a note")), f"no reason: {row}"


def test_the_numbers_of_the_paper_are_those_of_the_code() -> None:
    table = {
        row["method"]: [row["single-instance (part_1)"], row["multi-instance (part_2)"]]
        for row in rows(section(TEXT, "## Table 2"))
    }
    assert table == {
        method: [f"{figures['mIoU']:.3f} / {figures['F']:.3f}".replace("0.", ".") for figures in parts.values()]
        for method, parts in paper.TABLE_2.items()
    }
    swept = {
        float(row["voting threshold"]): {"mIoU": float(row["mIoU"]), "F": float(row["F"])}
        for row in rows(section(TEXT, "## Table 3"))
    }
    assert swept == paper.TABLE_3


def test_our_numbers_are_those_of_the_files_of_scores() -> None:
    """Beside the paper's stand what docs/results/ holds, to three digits."""

    def scores(name: str) -> Scores:
        return Scores.model_validate_json((DOCUMENT.parent / "results" / f"{name}.json").read_text(encoding="utf-8"))

    def figures(name: str, part: str) -> str:
        group = scores(name).parts[part].official
        assert group is not None
        return f"{group.mIoU:.3f} / {group.F:.3f}".replace("0.", ".")

    table = {row["method"]: row for row in rows(section(TEXT, "## Table 2"))}
    for method, run in (("EchoSegnet without AISRM", "no-aisrm"), ("EchoSegnet with AISRM", "official")):
        for part in ("part_1", "part_2"):
            expected = [figures(f"{masks}-{run}", part) for masks in ("ambiguous", "sounding")]
            assert table[method][f"ours, {part}"].split("; ") == expected
    for row in rows(section(TEXT, "## Table 3")):
        group = scores(f"voting-threshold-0{row['voting threshold']}").overall.official
        assert group is not None
        assert [row["ours: mIoU"], row["ours: F"]] == [f"{v:.3f}"[1:] for v in (group.mIoU, group.F)]


def test_the_folders_on_the_page_are_those_of_the_code() -> None:
    for pattern in layout.RELEASED_BYPRODUCTS:
        name = pattern.removeprefix("sparse/0/").replace("3d_segmentation_*", "3d_segmentation_use_aisrm_True")
        assert f"`{name}`" in section(TEXT, "## Folders"), name
    for folder in layout.RELEASED_MASKS:
        assert folder in section(TEXT, "## Folders")


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
