"""The documentation site: every page is in the navigation, every referenced name exists, links work on GitHub too."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from tests.support.browser import launch, visit

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md"))
#: Longest page (lines).
MOST_LINES = 400
_LINK = re.compile(r"\]\(([^)\s]+)\)")


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    pytest.importorskip("mkdocs", reason="the site needs the [docs] extra")
    spec = importlib.util.spec_from_file_location("hooks", DOCS / "_site/hooks.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def navigation() -> list[str]:
    class Loader(yaml.SafeLoader):
        """The one tag of the file names a function of an extension."""

    Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, suffix, node: suffix)
    document = yaml.load((ROOT / "mkdocs.yml").read_text(), Loader)

    def leaves(entry: Any) -> list[str]:
        if isinstance(entry, str):
            return [entry]
        children = entry.values() if isinstance(entry, dict) else entry
        return [leaf for child in children for leaf in leaves(child)]

    return leaves(document["nav"])


def test_every_page_is_in_the_navigation_once(hooks: ModuleType) -> None:
    pages = [path.relative_to(DOCS).as_posix() for path in PAGES]
    assert sorted(navigation()) == sorted([*pages, *hooks.ROOT_PAGES.values()])


@pytest.mark.parametrize("path", [ROOT / "README.md", *PAGES], ids=lambda path: path.stem)
def test_each_row_of_a_table_has_the_cells_of_its_head(path: Path) -> None:
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    for rows in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        bars = [len(re.findall(r"(?<!\\)\|", re.sub(r"`[^`]*`", "", row))) for row in rows.splitlines()]
        assert bars == bars[:1] * len(bars), rows


def test_no_page_is_long() -> None:
    lines = {path.name: len(path.read_text(encoding="utf-8").splitlines()) for path in [*PAGES, ROOT / "README.md"]}
    assert [name for name, count in lines.items() if count > MOST_LINES] == []


def test_every_name_of_the_reference_exists() -> None:
    names = [name for page in PAGES for name in re.findall(r"^::: (\S+)$", page.read_text(encoding="utf-8"), re.M)]
    assert len(names) > 30
    for name in names:
        module, _, last = name.rpartition(".")
        try:
            import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                continue  # a module of ours whose library is not installed here
            assert hasattr(import_module(module), last), f"{name} does not exist"


@pytest.mark.parametrize("page", [*PAGES, *ROOT.glob("*.md"), ROOT / "examples/README.md"], ids=str)
def test_links_lead_to_files_on_github(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in _LINK.findall(text):
        if "://" not in target and not target.startswith("#"):
            assert (page.parent / target.partition("#")[0]).exists(), f"{page.name} links to {target}"


def site(hooks: ModuleType, name: str, text: str) -> str:
    return hooks.on_page_markdown(text, SimpleNamespace(file=SimpleNamespace(src_uri=name)))


def test_links_are_pointed_at_pages_of_the_site(hooks: ModuleType) -> None:
    assert site(hooks, "index.md", "[a](docs/a.md#b) ![c](docs/images/c.png)") == "[a](a.md#b) ![c](images/c.png)"
    assert site(hooks, "index.md", "[a](CONTRIBUTING.md)") == "[a](contributing.md)"
    assert site(hooks, "a.md", "[a](../CONTRIBUTING.md#lint) [b](b.md)") == "[a](contributing.md#lint) [b](b.md)"
    assert site(hooks, "results/a.md", "[a](../../README.md)") == "[a](../index.md)"
    assert site(hooks, "a.md", "[run](../scenes_manifest/demo.yaml), [all](results/) [x](https://x.org/y.json)") == (
        "run, all [x](https://x.org/y.json)"
    )


def test_lists_and_fences_are_what_github_shows(hooks: ModuleType) -> None:
    assert site(hooks, "a.md", "Two:\n- one\n- two\n") == "Two:\n\n- one\n- two\n"
    assert site(hooks, "a.md", "- one\n- two\n") == "- one\n- two\n"
    assert site(hooks, "a.md", "```figures twins\nTwo:\n- [a](docs/x)\n```\n") == "```text\nTwo:\n- [a](docs/x)\n```\n"
    assert site(hooks, "a.md", '```python title="a.py"\n```\n') == '```python title="a.py"\n```\n'


# --- The theme -------------------------------------------------------------------------------------------------------

#: Code whose lines are cut off: they go on beyond their box, which neither wraps nor shows a bar to scroll with.
_CUT_OFF = """
[...document.querySelectorAll('.md-content pre > code')].filter((e) => {
  const style = getComputedStyle(e);
  const bar = style.overflowX === 'auto' && style.scrollbarWidth !== 'none' && !style.scrollbarColor.includes('rgba(0, 0, 0, 0) rgba');
  return e.scrollWidth > e.clientWidth + 1 && !(bar && style.whiteSpace === 'pre');
}).map((e) => e.textContent.slice(0, 60))
"""  # noqa: E501
_COLOURS = """
(() => {
  const shown = (selector) => [...document.querySelectorAll(selector)].filter((e) => e.textContent.trim() && e.getBoundingClientRect().width);
  const of = (e, name) => getComputedStyle(e)[name].match(/[\\d.]+/g).map(Number);
  const ground = (e) => { for (let up = e; up; up = up.parentElement) { const c = of(up, 'backgroundColor'); if ((c[3] ?? 1) > 0.99) return c; } return [255, 255, 255]; };
  return shown('.md-content p, .md-content a:not(.headerlink), .md-content h1, .md-content h2, .md-content code, .md-content code span, .md-nav__link, .md-header__title')
    .map((e) => [of(e, 'color'), ground(e), e.textContent.trim().slice(0, 30)]);
})()
"""  # noqa: E501


@pytest.fixture(scope="module")
def built(hooks: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("material", reason="the site needs the [docs] extra")
    folder = tmp_path_factory.mktemp("site") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    return folder


def luminance(colour: list[float]) -> float:
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in colour[:3])]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.slow
def test_the_site_has_a_switch_of_themes_legible_colours_and_no_code_that_is_cut_off(built: Path) -> None:
    with launch() as browser:
        for name in ("index.html", "metrics.html", "exports.html", "reference/evaluators.html"):
            for width in (1280, 390):
                with visit(browser, built / name, width=width) as opened:
                    assert opened.overflow <= 0, name
                    assert opened.page.evaluate(_CUT_OFF) == [], name
                    assert not [a for a in opened.asked if not a.startswith("file:")], "all is of the site"
        for dark in (False, True):
            with visit(browser, built / "index.html", dark=dark) as opened:
                page = opened.page
                scheme = "document.body.getAttribute('data-md-color-scheme')"
                paper = "getComputedStyle(document.body).backgroundColor"
                assert page.evaluate(paper) == ("rgb(20, 21, 24)" if dark else "rgb(251, 250, 247)"), (
                    "as the system has it"
                )
                found = page.evaluate(_COLOURS)
                assert len(found) > 50
                for ink, ground, text in found:
                    high, low = sorted((luminance(ink), luminance(ground)), reverse=True)
                    assert (high + 0.05) / (low + 0.05) >= 4.5, (text, ink, ground)
                seen = set()
                for _ in range(3):
                    page.click(".md-header__option label:not([hidden])")
                    seen.add(page.evaluate(scheme))
                assert seen == {"default", "slate"}
