"""`avs3d doctor`: what is installed and works on this machine, and for each gap the command that fixes it.

Every package of the project brings its own checks through an entry point in the group ``avs3d.doctor`` that names a
function returning `Check` records; this module has those of the core install. A check is a small program that runs in
a process of its own under a time limit: engines that crash, hang or end their process when a part of them is missing
are reported like everything else.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.text import Text

from avs3d_bench import __version__
from avs3d_bench.runtime.imports import has_package
from avs3d_bench.runtime.parallel import available_cores

GROUP = "avs3d.doctor"
#: ``ok``: there and works; ``missing``: not there, and something cannot be done without it; ``broken``: there, but it
#: does not work; ``note``: worth knowing.
State = Literal["ok", "missing", "broken", "note"]
#: Seconds that one check may take.
TIME_LIMIT = 120.0
_MARK: dict[State, tuple[str, str]] = {
    "ok": ("ok", "green"),
    "missing": ("missing", "yellow"),
    "broken": ("broken", "red"),
    "note": ("note", "cyan"),
}
#: The order in which people need things.
_ORDER = ("core", "generate", "habitat", "scans", "assets", "baselines", "checkpoints")
#: Disk that one observation of 120 frames of 1008² takes, and a baked home, GB.
_OBSERVATION_GB, _LEAST_FREE_GB = 0.25, 5.0
#: The versions that the tests run with, a line ``name==version`` each; `make lock` writes it.
TESTED_VERSIONS = Path(__file__).parent / "tested_versions.txt"
#: Number of packages with another version that are named.
_MOST_VERSIONS = 5


@dataclass(frozen=True)
class CheckResult:
    """The result of a check.

    Attributes:
        group: what it is needed for, e.g. ``generate``.
        name: what was looked for.
        state: see `State`.
        found: one line: a version, a device, what went wrong.
        fix: the command that fixes it; empty if nothing is wrong.
    """

    group: str
    name: str
    state: State
    found: str
    fix: str = ""


@dataclass(frozen=True)
class Check:
    """One check; ``run`` returns its finding, and may be called from a thread."""

    group: str
    name: str
    run: Callable[[], Iterable[CheckResult]]


def examine(checks: Iterable[Check], listen: Callable[[CheckResult], None] = lambda _: None) -> tuple[CheckResult, ...]:
    """Run all checks side by side; the findings in the order of the checks.

    A check that raises is itself a finding: nothing here ends the doctor.
    """
    found: list[CheckResult] = []
    checks = list(checks)
    with ThreadPoolExecutor(max(2, available_cores())) as pool:
        for result in pool.map(_run, checks):
            for finding in result:
                listen(finding)
                found.append(finding)
    return tuple(found)


def _run(check: Check) -> tuple[CheckResult, ...]:
    try:
        return tuple(check.run())
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return (CheckResult(check.group, check.name, "broken", text, "please report it"),)


def all_checks() -> tuple[Check, ...]:
    """The core's checks and those of every installed package of the project."""
    checks = list(core_checks())
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name):
        try:
            checks += point.load()()
        except Exception as error:  # a package that cannot even list its checks
            text = " ".join(f"{type(error).__name__}: {error}".split())
            checks.append(constant(point.name, point.value, "broken", text, "reinstall avs3d-bench"))
    return tuple(sorted(checks, key=lambda check: (*_ORDER, check.group).index(check.group)))


def constant(group: str, name: str, state: State, found: str, fix: str = "") -> Check:
    """A check whose finding is known already."""
    return Check(group, name, lambda: (CheckResult(group, name, state, found, fix),))


# What checks are made of


def package_check(
    group: str, name: str, module: str, fix: str, *, program: str = "", limit: float = TIME_LIMIT, needed: str = ""
) -> Check:
    """A check that a Python package is there and that a small program with it ends well.

    Args:
        group: see `CheckResult`.
        name: of the distribution, for its version.
        module: that it is imported by.
        fix: the line that installs it.
        program: Python code that uses it; its last printed line, if any, is shown beside the version.
        limit: seconds it may take.
        needed: what for, shown where it is missing.
    """

    def run() -> tuple[CheckResult, ...]:
        if not has_package(module):
            why = f"not installed; {needed}" if needed else "not installed"
            return (CheckResult(group, name, "missing", why, fix),)
        return (package_finding(group, name, fix, run_python(program or f"import {module}", limit=limit)),)

    return Check(group, name, run)


def package_finding(group: str, name: str, fix: str, result: tuple[bool, str]) -> CheckResult:
    """The finding on an installed package with which a program was run; see `package_check` and `run_python`."""
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        version = "of unknown version"
    works, said = result
    if not works:
        mend = f"{fix} --force-reinstall" if fix.endswith(("'", name)) else fix  # what follows a remark is no option
        return CheckResult(group, name, "broken", f"{version}: {said}", mend)
    return CheckResult(group, name, "ok", f"{version}, {said}" if said else version)


def run_in_turn(programs: Sequence[str], *, limit: float = TIME_LIMIT) -> list[tuple[bool, str]]:
    """Run programs that import the same large package in one process, so that it is imported once.

    Where one of them does not end well, it and those after it are run again, each in a process of its own.

    Returns:
        What `run_python` gives, for each program.
    """
    begin = "-- program"
    # Each has names of its own.
    steps = [f"print({begin!r}, flush=True)\nexec({program!r}, {{'__name__': '__main__'}})" for program in programs]
    ended = _end_of("\n".join(steps), limit, sys.executable)
    parts = [] if isinstance(ended, str) else ended.stdout.split(f"{begin}\n")[1:]
    whole = parts if not isinstance(ended, str) and ended.returncode == 0 else parts[:-1]
    found = [(True, _last_line(part)) for part in whole]
    return found + [run_python(program, limit=limit) for program in programs[len(found) :]]


def run_python(program: str, *, limit: float = TIME_LIMIT, python: str = sys.executable) -> tuple[bool, str]:
    """Run Python code in a process of its own.

    Returns:
        Whether it ended well, and the last line it printed (of its errors, where it did not).
    """
    ended = _end_of(program, limit, python)
    if isinstance(ended, str):
        return False, ended
    if ended.returncode < 0:
        return False, f"ended by signal {-ended.returncode}"
    works = ended.returncode == 0
    return works, _last_line(ended.stdout if works else ended.stderr or ended.stdout)


def _end_of(program: str, limit: float, python: str) -> subprocess.CompletedProcess[str] | str:
    """How a process ended that ran Python code; one line if it did not begin or end."""
    try:
        # -P: modules in the current folder are not the installed ones.
        return subprocess.run(
            [python, "-c", program],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=limit,
            env={**os.environ, "PYTHONSAFEPATH": "1"} if python == sys.executable else None,
        )
    except subprocess.TimeoutExpired:
        return f"did not answer within {limit:g} s"
    except OSError as error:
        return (error.strerror or str(error)).lower()


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:300] if lines else ""


# The core's own checks


def core_checks() -> tuple[Check, ...]:
    """Python, the core install, the machine."""
    return (
        Check("core", "avs3d-bench", _core),
        Check("core", "versions", _versions),
        Check("core", "machine", _machine),
        Check("core", "disk", _disk),
    )


def _core() -> tuple[CheckResult, ...]:
    version = ".".join(map(str, sys.version_info[:3]))
    lacking = []
    for requirement in metadata.requires("avs3d-bench") or ():
        if "extra ==" not in requirement:
            name = requirement.split(";")[0].split(">")[0].split("=")[0].split("<")[0].strip()
            try:
                metadata.version(name)
            except metadata.PackageNotFoundError:
                lacking.append(name)
    found = f"{__version__}, Python {version} ({sys.executable})"
    if lacking:
        fix = "pip install --upgrade avs3d-bench"
        return (CheckResult("core", "avs3d-bench", "broken", f"{found}: lacks {', '.join(lacking)}", fix),)
    return (CheckResult("core", "avs3d-bench", "ok", found),)


def _versions() -> tuple[CheckResult, ...]:
    """Whether what is installed is the tested set; a package that is not installed does not count."""
    tested = dict(re.findall(r"^([^#\s=]+)==(\S+)$", TESTED_VERSIONS.read_text(encoding="utf-8"), re.MULTILINE))
    installed = {}
    for name in tested:
        with contextlib.suppress(metadata.PackageNotFoundError):
            installed[name] = metadata.version(name)
    differ = {name: version for name, version in installed.items() if version != tested[name]}
    others = [f"{name} {version} ({tested[name]})" for name, version in differ.items()]
    if not others:
        found = f"{len(installed)} packages as in the tested set"
        return (CheckResult("core", "versions", "ok", found),)
    more = f" and {len(others) - _MOST_VERSIONS} more" if len(others) > _MOST_VERSIONS else ""
    found = (
        f"{len(others)} of {len(installed)} packages differ from the tested set, whose version is in brackets: "
        f"{', '.join(others[:_MOST_VERSIONS])}{more}"
    )
    if len(others) <= _MOST_VERSIONS:
        fix = "pip install " + " ".join(f"{name}=={tested[name]}" for name in differ)
    else:
        fix = f"make setup, or in a new environment: pip install --constraint {TESTED_VERSIONS} avs3d-bench"
    return (CheckResult("core", "versions", "note", found, fix),)


def _machine() -> tuple[CheckResult, ...]:
    cores = available_cores()
    found = f"{cores} core{'s' if cores != 1 else ''}"
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, ValueError, OSError):
        return (CheckResult("core", "machine", "ok", found),)
    found += f", {memory:.0f} GiB of memory"
    if memory < 2 * cores:
        fix = f"avs3d generate --workers {max(1, int(memory // 2))}"
        return (CheckResult("core", "machine", "note", f"{found}; a worker takes up to 1.5 GB", fix),)
    return (CheckResult("core", "machine", "ok", found),)


def _disk() -> tuple[CheckResult, ...]:
    try:
        free = shutil.disk_usage(Path.cwd()).free / 1e9
    except OSError as error:
        return (
            CheckResult("core", "disk", "broken", (error.strerror or str(error)).lower(), "work in another folder"),
        )
    found = f"{free:.0f} GB free in {Path.cwd()}: about {int(free / _OBSERVATION_GB)} observations of 120 frames"
    if free < _LEAST_FREE_GB:
        return (
            CheckResult("core", "disk", "note", found, "free some space, or name a folder on another disk with -o"),
        )
    return (CheckResult("core", "disk", "ok", found),)


# What the user sees


def as_dict(findings: Iterable[CheckResult]) -> dict[str, Any]:
    """The findings as ``--json`` writes them."""
    return {"toolkit_version": __version__, "findings": [asdict(finding) for finding in findings]}


def print_finding(finding: CheckResult, console: Console) -> None:
    """One line, and below it the command that fixes it."""
    word, colour = _MARK[finding.state]
    line = Text("  ").append(f"{word:<8}", style=colour).append(f"{finding.name}: ").append(finding.found)
    console.print(line, soft_wrap=True)
    if finding.fix:
        console.print(Text(f"          → {finding.fix}", style="bold"), soft_wrap=True)


def print_summary(findings: Iterable[CheckResult], console: Console) -> None:
    """Print which groups of checks are complete, and what the others lack."""
    bad: dict[str, list[str]] = {}
    groups = dict.fromkeys(finding.group for finding in findings)
    for finding in findings:
        if finding.state in ("missing", "broken"):
            bad.setdefault(finding.group, []).append(finding.name)
    whole = [group for group in groups if group not in bad]
    console.print(Text(f"complete: {', '.join(whole) or 'nothing'}", style="bold green"), soft_wrap=True)
    for group, names in bad.items():
        console.print(Text(f"{group} lacks: {', '.join(names)}", style="bold"), soft_wrap=True)
