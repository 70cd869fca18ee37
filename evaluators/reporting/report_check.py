"""Whether a file is a report that this toolkit wrote, so that a leaderboard may publish a copy of it.

A file of scores may come from anybody and name anything as its report: a file of secrets, a page with scripts. Three
properties of the file are checked, which text inside it cannot circumvent:

1. it begins, byte for byte, as `evaluators.reporting.pages` begins every report. So the content security policy is in
   force before anything else: the browser runs no script but the one with that hash, and loads nothing;
2. it holds exactly one script, that one, and one style sheet;
3. all other elements and attributes are of the kinds that the report's templates use: no frames, forms, further
   ``meta``, handlers of events; links lead to http(s) or into the page, pictures are data.
"""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes
from evaluators.reporting.pages import page_script, report_head, web_address

#: Largest report (bytes): 24 rows of three pictures take a few MB.
MAX_REPORT_BYTES = 64 * 2**20
#: Elements of a report, from its title on, and their attributes.
_ELEMENTS = frozenset({
    "a", "article", "b", "bdi", "body", "button", "code", "dd", "div", "dl", "dt", "fieldset", "figcaption", "figure",
    "h1", "h2", "h3", "h4", "header", "i", "img", "input", "label", "legend", "li", "main", "nav", "output", "p",
    "script", "section", "small", "span", "strong", "style", "table", "tbody", "td", "th", "thead", "title", "tr", "ul",
})  # fmt: skip
_ATTRIBUTES = frozenset({
    "alt", "autocomplete", "checked", "class", "colspan", "height", "id", "lang", "name", "placeholder", "rel", "role",
    "scope", "spellcheck", "style", "tabindex", "title", "type", "value", "width",
})  # fmt: skip
_OPEN_ATTRIBUTES = re.compile(r"(?:aria|data)-[a-z-]+")
_PICTURE = re.compile(r"data:image/(?:png|jpeg|webp);base64,[A-Za-z0-9+/=]*")


def read_report(path: Path) -> bytes:
    """The bytes of a report that this toolkit wrote.

    Raises:
        Avs3dError: if it is missing, no regular file, or not such a report, with the reason.
    """
    data = read_bytes(path, MAX_REPORT_BYTES)
    head = report_head()
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        text = ""
    if not text.startswith(head):
        raise Avs3dError(f"{path}: not a report that this version of avs3d-eval wrote; write it again with --html")
    parser = _Elements()
    parser.feed(text[len(head) - len("<title>") :])
    parser.close()
    if parser.scripts != [page_script()] or parser.styles != 1:
        parser.faults.append("a script or style sheet of its own")
    if parser.faults:
        raise Avs3dError(f"{path}: holds {parser.faults[0]}, which no report of avs3d-eval does; write it again")
    return data


class _Elements(HTMLParser):
    """Collects the scripts of a page and what no report holds."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.scripts: list[str] = []
        self.styles = 0
        self.faults: list[str] = []
        self._inside = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag
        if tag == "script":
            self.scripts.append("")
        self.styles += tag == "style"
        if tag not in _ELEMENTS:
            self.faults.append(f"the element {tag[:40]!r}")
        if tag in ("script", "style") and attrs:
            self.faults.append(f"a {tag} with attributes")
        for name, value in attrs:
            if not _is_harmless(tag, name, value or ""):
                self.faults.append(f"the attribute {name[:40]!r} of {tag[:40]!r}")

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts[-1] += data

    def handle_comment(self, data: str) -> None:
        self.faults.append("a comment")  # browsers and this parser may differ about where it ends

    def handle_decl(self, decl: str) -> None:
        self.faults.append("a declaration")

    def unknown_decl(self, data: str) -> None:
        self.faults.append("a declaration")

    def handle_pi(self, data: str) -> None:
        self.faults.append("a processing instruction")


def _is_harmless(tag: str, name: str, value: str) -> bool:
    if name == "href":
        return tag == "a" and (value.startswith("#") or web_address(value) is not None)
    if name == "src":
        return tag == "img" and _PICTURE.fullmatch(value) is not None
    return name in _ATTRIBUTES or _OPEN_ATTRIBUTES.fullmatch(name) is not None
