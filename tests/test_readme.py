"""README.md: every block of Python or shell runs, on a small dataset where `make demo` leaves its own."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import tiny
from markdown_code import ROOT, RUN, Block, blocks, calls, indented, run, unknown

from avs3d_bench.dataset import Dataset
from baselines.oracle import write_oracle
from baselines.trivial import write_trivial
from generators.manifest import read_manifest

PAGES = [ROOT / "README.md"]
#: Info strings of blocks that are neither run nor calls of commands.
SHOWN = ("text", "yaml")
BLOCKS = [block for page in PAGES for block in blocks(page)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `make demo` writes into data/, small."""
    folder = tmp_path_factory.mktemp("readme")
    tiny.write_dataset(folder / "data/demo", frames=11, keys=tiny.DEMO)
    dataset = Dataset(folder / "data/demo")
    write_oracle(dataset, folder / "data/demo-submissions/oracle")
    write_trivial("centre-box", dataset, folder / "data/demo-submissions/centre-box")
    return folder


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language in RUN], ids=lambda block: block.name)
def test_code_runs(block: Block, folder: Path) -> None:
    if block.reason:
        pytest.skip(f"not run: {block.reason}")
    output = run(block, folder)
    if "SubmissionWriter" in block.code and "evaluate(" in block.code:
        assert float(output.split()[0]) > 0, "the method of the example finds nothing"


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "usage"], ids=lambda block: block.name)
def test_usage_names_commands_and_options_that_exist(block: Block) -> None:
    assert calls(block)
    for call in calls(block):
        assert not unknown(call), f"{block.name}: {' '.join(call)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_says_what_it_is(page: Path) -> None:
    assert not indented(page), "indented blocks: fence them, so that a test knows what they are"
    assert {block.language for block in blocks(page)} <= {*RUN, "usage", *SHOWN}


def test_the_submission_json_of_the_example_fits_the_open_benchmark() -> None:
    (shown,) = re.findall(r"^submission\.json +(\{.*\})$", (ROOT / "README.md").read_text(encoding="utf-8"), re.M)
    said, manifest = json.loads(shown), read_manifest(ROOT / "scenes_manifest/open-s34-o7.yaml").manifest
    assert (said["dataset"], said["dataset_version"]) == (manifest.name, manifest.version)


# The tools of this test


def page_of(folder: Path, text: str) -> Path:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return page


def test_a_usage_block_with_a_wrong_name_is_found() -> None:
    assert unknown(["avs3d", "generate", "MANIFEST", "-o", "ROOT", "--wrokers", "N"]) == ["--wrokers"]
    assert unknown(["avs3d", "baseline", "all-black|all-withe", "-o", "DIR"]) == ["all-withe"]
    assert unknown(["avs3d-eval", "SUBMISSION", "--dataset", "ROOT", "--deep"]) == ["--deep"]
    assert not unknown(["avs3d", "export", "croissant|card", "ROOT", "-o", "FILE"])


def test_indented_code_is_found_and_lists_are_not_taken_for_it(tmp_path: Path) -> None:
    assert indented(page_of(tmp_path, "text\n\n    avs3d doctor\n")) == [3]
    assert not indented(page_of(tmp_path, "- point\n\n    more of it\n\n```text\n\n    inside\n```\n"))


def test_the_reason_stands_right_before_the_block(tmp_path: Path) -> None:
    page = page_of(tmp_path, "<!-- not run: network -->\n```bash\nfalse\n```\n\n```bash\nfalse\n```\n")
    assert [block.reason for block in blocks(page)] == ["network", None]


def test_a_failing_block_fails(tmp_path: Path) -> None:
    for language, code in (("bash", "false\ntrue\n"), ("python", "raise KeyError('IoU')\n")):
        with pytest.raises(AssertionError, match="ended with 1"):
            run(Block(ROOT / "README.md", 1, language, code, None), tmp_path)
