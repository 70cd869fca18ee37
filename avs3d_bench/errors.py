"""The one exception family of the toolkit.

Every message is a single line that names the file or the field, what was found, what was expected and what to do; an
error with several problems has a message for each. The command line prints them and exits with ``exit_code``; bad input
never causes a traceback.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable

#: Longer texts are no misspelt name, and slow to compare (characters).
_LONGEST_NAME = 100


class Avs3dError(Exception):
    """Something the user can fix: bad data, a missing asset, a full disk (exit code 1).

    Its arguments are the message; or several, one for each problem of one input. Its text has each in a line of its
    own.

    Examples:
        >>> print(UsageError("mine.yaml: seed is missing", "mine.yaml: scans is missing"))
        mine.yaml: seed is missing
        mine.yaml: scans is missing
    """

    exit_code = 1

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))


class UsageError(Avs3dError):
    """The command or the manifest asks for something that does not exist (exit code 2).

    Examples:
        >>> try:
        ...     Dataset("data/nowhere")
        ... except UsageError as error:
        ...     print(error, error.exit_code)
        data/nowhere: no such folder; expected the root of a dataset 2
    """

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


def near_names(value: object, known: Iterable[str], count: int = 1) -> list[str]:
    """The names most like ``value``, best first.

    If no name is similar as a whole, the names that have ``value`` between slashes, as a key has its room; else those
    that begin with it, and those that it abbreviates: the first letter and others in order.

    Args:
        value: the name that was given; anything but a short text is similar to no name.
        known: the names that exist.
        count: return at most so many.

    Examples:
        >>> near_names("microwve", ["clock", "microwave"])
        ['microwave']
        >>> near_names("kitchen", ["part_1/a/bathroom/1", "part_1/a/kitchen/1"])
        ['part_1/a/kitchen/1']
        >>> near_names("hf", ["webdataset", "huggingface"])
        ['huggingface']
    """
    from difflib import get_close_matches

    if not isinstance(value, str) or not 0 < len(value) < _LONGEST_NAME:
        return []
    names = list(known)
    # What begins alike is an abbreviation, even where a shorter name differs in fewer letters.
    found = [name for name in names if name.startswith(value)] if len(value) > 1 else []
    found = found or get_close_matches(value, names, n=count)
    found = found or [name for name in names if f"/{value.strip('/')}/" in f"/{name}/"]
    if not found and len(value) > 1:
        found = [name for name in names if _stands_for(value, name)]
    return found[:count]


def _stands_for(short: str, name: str) -> bool:
    """Whether a name begins with the first letter of ``short`` and has the others in the same order."""
    letters = iter(name)
    return name[:1] == short[0] and all(letter in letters for letter in short)


def did_you_mean(value: object, known: Iterable[str], *, otherwise: str = "", count: int = 1) -> str:
    """The end of a message on an unknown name: ``; did you mean 'microwave'?``.

    Args:
        value: what was asked for.
        known: the names that exist.
        otherwise: the text to return if nothing is similar.
        count: name at most so many.

    Examples:
        >>> did_you_mean("microwve", ["clock", "microwave"])
        "; did you mean 'microwave'?"
        >>> did_you_mean("x", ["clock", "microwave"])
        ''
    """
    near = near_names(value, known, count)
    return f"; did you mean {' or '.join(map(repr, near))}?" if near else otherwise
