"""Paths as users write them."""

from __future__ import annotations

import os
from pathlib import Path

from avs3d_bench.errors import UsageError, excerpt


def user_path(name: str | os.PathLike[str]) -> Path:
    """A path as users write it: ``~`` and ``~user`` at its beginning stand for home folders.

    Raises:
        UsageError: if the name is empty, or nothing is known of that home folder.
    """
    text = os.fspath(name)
    if not text:
        raise UsageError("the name of a file or folder is empty; write its path")
    expanded = os.path.expanduser(text)
    if text.startswith("~") and expanded == text:
        home = text.partition("/")[0]
        raise UsageError(f"{text}: no home folder is known for {excerpt(home)}; write the whole path")
    return Path(expanded)
