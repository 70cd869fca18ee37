"""Hooks of MkDocs: pages outside of docs/ become pages of the site, and links work on GitHub and here."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

#: Files outside of docs/ → pages of the site.
ROOT_PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "examples/README.md": "examples.md",
}
#: Other folders and files that pages link to; they are not part of the site: such a link becomes plain text.
OUTSIDE = ("scenes_manifest/", "tests/")
OUTSIDE_SUFFIXES = (".json", ".csv", ".cff", ".py", ".ipynb", "/")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)")
_FENCE = re.compile(r"^(```|~~~).*?^\1[ ]*$", re.M | re.S)
#: A fence with several words that are no options, which the tests read: Python-Markdown takes it for a paragraph.
_WORDS = re.compile(r"^(```|~~~)\w+ [^=\n]+$", re.M)
#: A list right below a paragraph: GitHub starts a list there, Python-Markdown wants an empty line between them.
_LIST = re.compile(r"^((?![-*+] |\d+\. |\s|#|\|).+\n)(?=(?:[-*+]|\d+\.) )", re.M)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that lie elsewhere."""
    root = Path(config.config_file_path).parent
    for source, target in ROOT_PAGES.items():
        text = (root / source).read_text(encoding="utf-8")
        if target == "examples.md":
            scripts = sorted((root / "examples").glob("*.py"))
            text += "".join(f"\n## {path.name}\n\n```python\n{path.read_text('utf-8')}```\n" for path in scripts)
        files.append(File.generated(config, target, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links at the pages of the site, outside of fenced blocks."""
    at_root = page.file.src_uri in ROOT_PAGES.values()
    prefix = "../" * page.file.src_uri.count("/")
    out, last = [], 0
    for fence in _FENCE.finditer(markdown):
        out += [_prose(markdown[last : fence.start()], at_root, prefix), _WORDS.sub(r"\1text", fence[0], count=1)]
        last = fence.end()
    return "".join([*out, _prose(markdown[last:], at_root, prefix)])


def _prose(text: str, at_root: bool, prefix: str) -> str:
    if at_root:
        text = re.sub(r"\]\(docs/", "](", text)
    return _LIST.sub(r"\1\n", _LINK.sub(lambda link: _linked(link, prefix), text))


def _linked(link: re.Match[str], prefix: str) -> str:
    """The link as the site needs it, or its text where the target is not part of the site."""
    text, target = link.groups()
    file, hash_, anchor = target.partition("#")
    name = re.sub(r"^(\.\./)+", "", file)
    if name in ROOT_PAGES:
        return f"[{text}]({prefix}{ROOT_PAGES[name]}{hash_}{anchor})"
    if name.startswith(OUTSIDE) or (file.endswith(OUTSIDE_SUFFIXES) and "://" not in file):
        return text
    return link[0]
