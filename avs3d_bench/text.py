"""Text from anywhere, made fit for one line."""

from __future__ import annotations


def printable(text: str) -> str:
    """Text that stays on one line and cannot steer a terminal, whatever bytes a file name or a field holds."""
    utf8 = text.encode("utf-8", "backslashreplace").decode()
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in utf8)
