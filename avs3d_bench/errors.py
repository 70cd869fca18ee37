"""The one exception family of the toolkit.

Every message is a single line that names the file or the field, what was found, what was expected and what to do.
The command line prints it and exits with ``exit_code``; nobody sees a traceback for bad input.
"""

from __future__ import annotations

import reprlib


class Avs3dError(Exception):
    """Something the user can mend: bad data, a missing asset, a full disk (exit code 1)."""

    exit_code = 1


class UsageError(Avs3dError):
    """The command or the manifest asks for something that does not exist (exit code 2)."""

    exit_code = 2


class _Excerpt(reprlib.Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxdict, self.maxlist, self.maxtuple = 2, 3, 4, 4
        self.maxstring = self.maxlong = self.maxother = 60

    def repr_int(self, x: int, level: int) -> str:
        # Python refuses to print integers of several thousand digits.
        if x.bit_length() > 400:
            return f"a number of about {int(x.bit_length() * 0.30103):,} digits"
        return super().repr_int(x, level)


_EXCERPT = _Excerpt()


def excerpt(value: object) -> str:
    """A value that came from a user, as messages quote it: one printable line, however large or strange it is.

    Examples:
        >>> excerpt(["bell", 7])
        "['bell', 7]"
        >>> excerpt(list(range(1000)))
        '[0, 1, 2, 3, ...]'
    """
    return _EXCERPT.repr(value)
