"""The one exception family of the toolkit.

Every message is a single line that names the file or the field, what was found, what was expected and what to do.
The command line prints it and exits with ``exit_code``; nobody sees a traceback for bad input.
"""

from __future__ import annotations


class Avs3dError(Exception):
    """Something the user can mend: bad data, a missing asset, a full disk (exit code 1)."""

    exit_code = 1


class UsageError(Avs3dError):
    """The command or the manifest asks for something that does not exist (exit code 2)."""

    exit_code = 2
