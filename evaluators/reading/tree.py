"""Walking a submission's folder: names and kinds, within limits, links not followed."""

from __future__ import annotations

import os
import stat
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from avs3d_bench.commands.report import Problem, Severity, printable

#: Names in the longest path that is looked at; a mask of the released pipeline has eight.
_DEEPEST = 12


@dataclass
class SubmissionTree:
    """The contents of a submission's folder, links not followed.

    Attributes:
        root: the submission's folder.
        left: entries that may still be looked at.
        surplus: how many of these are surplus, for the message.
        found: path relative to the root → file, folder, link or other.
        problems: what kept the walk from going on.
    """

    root: Path
    left: int
    surplus: int
    found: dict[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def walk(self, top: str, severity: Severity, skip: Collection[str] = ()) -> bool:
        """Look at everything below the folder ``top`` but ``skip``; False if there is absurdly much.

        What cannot be looked at becomes a finding of that severity.
        """
        folders = [top]
        while folders:
            folder = folders.pop()
            below = []
            try:
                with os.scandir(self.root / folder) as entries:
                    for entry in entries:
                        path = f"{folder}/{entry.name}" if folder else entry.name
                        if path in skip:
                            continue
                        self.left -= 1
                        if self.left < 0:
                            message = f"more than {self.surplus:,} surplus files and folders; the rest is not looked at"
                            self.problems.append(Problem(severity, printable(top) or ".", message))
                            return False
                        self.found[path] = kind = _kind(os.lstat(entry))
                        if kind == "folder":
                            below.append(path)
            except OSError as error:
                message = f"cannot be looked into ({error.strerror}); change its permissions"
                self.problems.append(Problem(severity, printable(folder) or ".", message))
            for path in below:
                if path.count("/") + 1 < _DEEPEST:
                    folders.append(path)
                elif severity == "error":
                    message = f"a folder nested {_DEEPEST} deep, not looked into; expected masks four folders down"
                    self.problems.append(Problem(severity, printable(path), message))
        return True

    def look_up(self, path: str) -> None:
        """Note the file or folder at one relative path, if it exists and no link leads there."""
        place = self.root
        *folders, name = path.split("/")
        try:
            for folder in folders:
                place /= folder
                if not stat.S_ISDIR(os.lstat(place).st_mode):
                    return
            self.found[path] = _kind(os.lstat(place / name))
        except OSError:
            return


def _kind(found: os.stat_result) -> str:
    if stat.S_ISLNK(found.st_mode):
        return "link"
    if stat.S_ISDIR(found.st_mode):
        return "folder"
    return "file" if stat.S_ISREG(found.st_mode) else "other"
