"""A headless Chromium for tests of pages; its log messages and network requests are recorded."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from benchmarks.pictures import BROWSERS

_ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


@contextmanager
def launch() -> Iterator[Any]:
    """A playwright browser; the test is skipped, with the reason, where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the package playwright is not installed")
    executable = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if executable is None:
        pytest.skip(f"no Chromium on this computer (looked for {', '.join(BROWSERS)})")
    with playwright.sync_playwright() as session:
        browser = session.chromium.launch(executable_path=executable, args=list(_ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


@dataclass
class Visit:
    """A page opened from disk.

    Attributes:
        page: playwright's.
        said: messages of the console and errors of scripts.
        asked: addresses other than the file itself and data URIs.
    """

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    @property
    def overflow(self) -> int:
        """By how many pixels the page scrolls sideways."""
        return int(self.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth"))


@contextmanager
def visit(browser: Any, path: Path, *, width: int = 1280, dark: bool = False, scripts: bool = True) -> Iterator[Visit]:
    """Open a page from disk."""
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light", java_script_enabled=scripts
    )
    page = context.new_page()
    opened = Visit(page)
    address = path.resolve().as_uri()
    page.on("console", lambda message: opened.said.append(message.text))
    page.on("pageerror", lambda error: opened.said.append(str(error)))

    def asked(request: Any) -> None:
        if request.url.split("#")[0] != address and not request.url.startswith("data:"):
            opened.asked.append(request.url)

    page.on("request", asked)
    try:
        page.goto(address, wait_until="load")
        yield opened
    finally:
        context.close()


def column(page: Any, table: str, heading: str) -> list[str]:
    """Texts of a column, top to bottom, of the rows that are shown."""
    found: list[str] = page.eval_on_selector(
        table,
        """(table, heading) => {
          const heads = [...table.tHead.rows[table.tHead.rows.length - 1].cells];
          const name = (cell) => cell.querySelector('button')?.ariaLabel ?? cell.textContent.trim();
          const at = heads.findIndex((cell) => name(cell) === heading);
          if (at < 0) throw new Error(`no column ${heading}`);
          return [...table.tBodies].flatMap((body) => [...body.rows]).filter((row) => !row.hidden && !row.dataset.fixed)
            .map((row) => row.cells[at].firstChild ? row.cells[at].textContent.trim() : '');
        }""",
        heading,
    )
    return found
