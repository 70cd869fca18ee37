"""The pages and commands for newcomers name only files, commands and versions that exist."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from avs3d_bench.exports.citation import ARXIV, AUTHORS, BIBTEX, PAPER

ROOT = Path(__file__).parents[2]
PAGES = ["CONTRIBUTING.md", ".github/PULL_REQUEST_TEMPLATE.md"]


def load(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version_and_of_the_paper() -> None:
    citation = load("CITATION.cff")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]
    assert citation["authors"] == project["authors"]
    (paper,) = citation["references"]
    assert paper["title"] == PAPER
    assert tuple(f"{author['given-names']} {author['family-names']}" for author in paper["authors"]) == AUTHORS
    assert ARXIV in paper["url"]
    assert BIBTEX in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("form", sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem)
def test_issue_forms_have_what_github_requires(form: Path) -> None:
    document = yaml.safe_load(form.read_text(encoding="utf-8"))
    if form.stem == "config":
        assert isinstance(document["blank_issues_enabled"], bool)
        return
    assert {"name", "description", "body"} <= document.keys()
    ids = [field["id"] for field in document["body"] if field["type"] != "markdown"]
    assert len(ids) == len(set(ids)) > 0
    for field in document["body"]:
        assert field["type"] in {"markdown", "textarea", "input", "dropdown", "checkboxes"}
        assert field["attributes"].get("label" if field["type"] != "markdown" else "value")
        # GitHub refuses a form with an option that YAML reads as a boolean.
        assert all(isinstance(option, str) for option in field["attributes"].get("options", []))


def test_the_workflow_runs_what_ci_runs_on_the_oldest_python() -> None:
    document = load(".github/workflows/ci.yml")
    steps = document["jobs"]["test"]["steps"]
    assert ".ci/run" in [step.get("run") for step in steps]
    versions = [step["with"]["python-version"] for step in steps if "setup-python" in step.get("uses", "")]
    requires = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert [f">={version}" for version in versions] == [requires]


def test_pre_commit_runs_the_linters_of_make_lint() -> None:
    hooks = [hook for repository in load(".pre-commit-config.yaml")["repos"] for hook in repository["hooks"]]
    recipe = re.search(r"^lint:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.M)
    assert recipe
    linters = set(re.findall(r"\$\(BIN\)/((?:ruff format|ruff check|mypy))", recipe[1]))
    entries = [hook["entry"].removeprefix(".venv/bin/") for hook in hooks]
    assert linters == {linter for linter in linters if any(entry.startswith(linter) for entry in entries)}
    assert len(entries) == len(linters) == 3
    assert all(hook["language"] == "system" for hook in hooks)  # nothing is downloaded


@pytest.mark.parametrize("page", PAGES)
def test_links_and_named_files_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    named = re.findall(r"\]\(([^)#:]+)\)", text)
    named += re.findall(r"`((?:tests|docs|avs3d_bench|scenes_manifest|\.ci)/[\w./-]+)`", text)
    assert named or "TEMPLATE" in page
    for name in named:
        assert (ROOT / name).exists(), f"{page} names {name}"


@pytest.mark.parametrize("page", PAGES)
def test_targets_of_make_exist(page: str) -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.M))
    for target in re.findall(r"\bmake ([a-z-]+)", (ROOT / page).read_text(encoding="utf-8")):
        assert target in targets, f"{page} names make {target}"
