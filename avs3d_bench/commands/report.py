"""The findings of a check: problems by file, with a count at the end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from avs3d_bench.commands.outputs import Signature
from avs3d_bench.text.printable import printable as printable

if TYPE_CHECKING:
    from rich.console import Console

#: What the file of ``--json`` says about itself.
REPORT_JSON = Signature(keys=("root", "deep", "valid", "observations", "files", "counts", "problems"))
Severity = Literal["error", "warning", "note"]
_RANK: dict[Severity, int] = {"error": 0, "warning": 1, "note": 2}
_STYLE: dict[Severity, str] = {"error": "bold red", "warning": "yellow", "note": "dim"}
#: Number of problems shown on the screen; `--json` has all.
SHOWN = 200


@dataclass(frozen=True)
class Problem:
    """One finding.

    Attributes:
        severity: ``error`` makes the dataset invalid, ``warning`` does not, ``note`` names what could not be checked.
        path: file or folder relative to the dataset's root.
        message: what was found, what was expected.

    Examples:
        >>> import shutil
        >>> from pathlib import Path
        >>> damaged = Path(shutil.copytree("data/demo", "damaged", dirs_exist_ok=True))
        >>> (damaged / "part_1/apartment_1/bathroom/1/audio_clips_mono/frame_3.wav").unlink(missing_ok=True)
        >>> problem = validate("damaged").problems[0]
        >>> problem.severity, problem.path
        ('error', 'part_1/apartment_1/bathroom/1/audio_clips_mono/frame_3.wav')
        >>> print(problem.message)
        listed in observation.json, but missing
    """

    severity: Severity
    path: str
    message: str


@dataclass(frozen=True, repr=False)
class Report:
    """All findings of a check.

    Attributes:
        root: the dataset.
        deep: whether contents were checked too.
        observations: how many were looked at.
        files: how many files were looked at.
        problems: sorted by path, then severity.

    Examples:
        >>> report = validate("data/demo")
        >>> report.valid, report.count("warning"), report.problems
        (True, 0, ())
        >>> print(report.summary)
        0 errors, 0 warnings, 0 notes in 2 observations (121 files, shallow): valid
    """

    root: Path
    deep: bool
    observations: int
    files: int
    problems: tuple[Problem, ...] = field(default=())

    def __repr__(self) -> str:
        found = ", ".join(f"{count} {name}s" for name in _RANK if (count := self.count(name))) or "no problem"
        return f"Report({printable(str(self.root))}: {found}, {self.observations} observations, {self.files} files)"

    def count(self, severity: Severity) -> int:
        """How many findings of one severity."""
        return sum(problem.severity == severity for problem in self.problems)

    @property
    def valid(self) -> bool:
        """Whether there is no error."""
        return self.count("error") == 0

    @property
    def summary(self) -> str:
        """The last line: ``2 errors, 1 warning, 0 notes in 34 observations (28,662 files, deep): not valid``."""
        counts = ", ".join(
            f"{self.count(s)} {s}{'' if self.count(s) == 1 else 's'}" for s in ("error", "warning", "note")
        )
        where = f"{self.observations} observation{'' if self.observations == 1 else 's'}"
        verdict = "valid" if self.valid else "not valid"
        return f"{counts} in {where} ({self.files:,} files, {'deep' if self.deep else 'shallow'}): {verdict}"

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "root": str(self.root),
            "deep": self.deep,
            "valid": self.valid,
            "observations": self.observations,
            "files": self.files,
            "counts": {severity: self.count(severity) for severity in _RANK},
            "problems": [{"severity": p.severity, "path": p.path, "message": p.message} for p in self.problems],
        }


def shorten(problems: Sequence[Problem], most: int) -> tuple[tuple[Problem, ...], str]:
    """The first findings of a list, the graver first, and what is said of the rest.

    A submission can have 50,000 surplus names: what prints findings shows a part of them.

    Args:
        problems: all findings.
        most: number of findings that are shown.

    Returns:
        the findings that are shown, and ``29,980 more errors``, or an empty text if there are no more.

    Examples:
        >>> shown, rest = shorten([Problem("error", str(n), "surplus") for n in range(1_200)], 100)
        >>> len(shown), rest
        (100, '1,100 more errors')
    """
    first = sorted(problems, key=lambda p: _RANK[p.severity])[:most]
    left = Counter(p.severity for p in problems) - Counter(p.severity for p in first)
    counts = [f"{left[s]:,} more {s}{'' if left[s] == 1 else 's'}" for s in _RANK if left[s]]
    return tuple(first), " and ".join(counts)


def ordered(problems: list[Problem]) -> tuple[Problem, ...]:
    """By path, then severity, each once."""
    return tuple(sorted(dict.fromkeys(problems), key=lambda p: (p.path, _RANK[p.severity], p.message)))


def _group(path: str) -> tuple[str, str]:
    """(observation, file within) of a path, or ("", path) above the observations."""
    pieces = path.split("/")
    return ("/".join(pieces[:4]), "/".join(pieces[4:])) if len(pieces) >= 4 else ("", path)


def screen() -> Console:
    """Standard output; when its reader goes away (`| head`) the rest is dropped and the exit status stays."""
    from rich.console import Console as RichConsole

    class Screen(RichConsole):
        def on_broken_pipe(self) -> None:
            with suppress(SystemExit):  # 1, which would say that the problems found are the reason
                super().on_broken_pipe()

    return Screen(highlight=False)


def print_report(report: Report, console: Console | None = None, *, shown: int = SHOWN) -> None:
    """Print the findings grouped by observation, one line each, the graver first, and the count at the end.

    More than ``shown`` findings are counted, not shown.
    """
    from rich.text import Text

    out = console or screen()
    first, rest = shorten(report.problems, shown)
    heading: str | None = None
    for problem in sorted(first, key=lambda p: (_group(p.path)[0], _RANK[p.severity], p.path)):
        group, inside = _group(problem.path)
        if group != heading:
            heading = group
            out.print(Text(printable(group or str(report.root)), style="bold"), soft_wrap=True)
        line = Text("  ").append(f"{problem.severity:<8}", style=_STYLE[problem.severity])
        out.print(line.append(printable(f"{inside or '.'}: {problem.message}")), soft_wrap=True)
    if rest:
        out.print(Text(f"  … and {rest} (--json FILE holds all)"), soft_wrap=True)
    style = "bold green" if report.valid else "bold red"
    out.print(Text(printable(f"{report.root}: ")).append(report.summary, style=style), soft_wrap=True)
