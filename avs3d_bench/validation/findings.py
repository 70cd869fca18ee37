"""Collects the problems of one observation while it is checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from avs3d_bench.commands.report import Problem, Severity
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError

_T = TypeVar("_T")


class Findings:
    """Collects problems of one observation; paths are given relative to it."""

    def __init__(self, observation: Observation) -> None:
        self.key = observation.key
        self.base = str(observation.path)
        self.problems: list[Problem] = []
        self._known: set[Problem] = set()

    def add(self, path: str, message: str, severity: Severity = "error") -> None:
        """Add a problem of the file or folder ``path``; the same problem again changes nothing."""
        where = f"{self.key}/{path}" if path else self.key
        problem = Problem(severity, where, message)
        if problem not in self._known:
            self._known.add(problem)
            self.problems.append(problem)

    def take(self, path: str, error: Avs3dError, severity: Severity = "error") -> None:
        """Add what a reader said; if it names a file of the observation first, that file has the problem."""
        text = str(error)
        if text.startswith(f"{self.base}/"):
            path, _, text = text[len(self.base) + 1 :].partition(": ")
        self.add(path, text, severity)


def read(findings: Findings, files: set[str], path: str, reader: Callable[[], _T]) -> _T | None:
    """Read a file that is there with ``reader``; its error becomes a problem."""
    if path not in files:
        return None  # already named as missing
    try:
        return reader()
    except Avs3dError as error:
        findings.take(path, error)
        return None
