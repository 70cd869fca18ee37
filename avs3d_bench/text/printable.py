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


#: First characters of a formula in spreadsheets, in their full width too; white space before them is skipped.
_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")


def no_formula(text: str) -> str:
    r"""Text for a cell of a CSV file: an apostrophe precedes what a spreadsheet would read as a formula (OWASP).

    Examples:
        >>> no_formula("@SUM(1)"), no_formula("a@b"), no_formula("\tx")
        ("'@SUM(1)", 'a@b', "'\tx")
    """
    return f"'{text}" if text.startswith(("\t", "\r", "\n")) or text.lstrip().startswith(_FORMULA) else text
