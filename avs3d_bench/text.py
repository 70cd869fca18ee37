"""Text from anywhere, made fit for one line."""

from __future__ import annotations

import re

_SURROGATES = re.compile("[\ud800-\udfff]")


def readable(text: str) -> str:
    """Text that can be written as UTF-8.

    Python keeps the bytes of a file name that are no UTF-8 as lone surrogates. Here each becomes the replacement
    character.
    """
    return _SURROGATES.sub("\N{REPLACEMENT CHARACTER}", text)


def printable(text: str) -> str:
    """Text that stays on one line and cannot steer a terminal, whatever bytes a file name or a field holds."""
    utf8 = text.encode("utf-8", "backslashreplace").decode()
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in utf8)
