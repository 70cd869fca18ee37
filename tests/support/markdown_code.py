"""Code blocks of Markdown pages, for tests that run them.

Every block of a page is fenced and its first info word says what it is: ``python`` and ``bash`` are run; ``usage``
shows how commands are called (placeholders in capitals), and is checked against the commands' options. A block with
``title="FILE"`` behind that word is that file. A comment
``<!-- not run: REASON -->`` on the line before a ``python`` or ``bash`` block keeps it from being run.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click

from avs3d_bench.cli import avs3d
from evaluators.cli import evaluate
from tests.support import warm
from tests.support.one_core import keep_to_one_core

ROOT = Path(__file__).parents[2]
RUN = ("python", "bash")
#: Longest time that a block may take (s).
TIMEOUT = 240
_NOT_RUN = re.compile(r"<!-- not run: (.+) -->")
_TITLE = re.compile(r'title="([^"]+)"')
_FENCE = re.compile(r"(`{3,})(.*)")


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        page: its file.
        line: of the opening fence, from 1.
        info: what follows the fence.
        code: the lines between the fences.
        reason: why it is not run; None: it is.
    """

    page: Path
    line: int
    info: str
    code: str
    reason: str | None

    @property
    def language(self) -> str:
        """The first word after the fence; empty where there is none."""
        return self.info.split(" ")[0]

    @property
    def file(self) -> str | None:
        """The file that the block is; None: it is none."""
        title = _TITLE.search(self.info)
        return title[1] if title else None

    @property
    def name(self) -> str:
        return f"{self.page.relative_to(ROOT).as_posix()}:{self.line}"


def section(text: str, heading: str) -> str:
    """The part of a page from a heading to the next one of the same level."""
    level = heading.split(" ", 1)[0]
    rest = text.partition(f"\n{heading}\n")[2]
    assert rest, f"no heading {heading!r}"
    return rest.partition(f"\n{level} ")[0]


def blocks(page: Path, text: str | None = None) -> list[Block]:
    """The fenced blocks of a page, or of ``text``, a part of it, in order."""
    found: list[Block] = []
    lines = (page.read_text(encoding="utf-8") if text is None else text).splitlines()
    opened: tuple[int, str, str] | None = None
    for number, line in enumerate(lines, start=1):
        fence = _FENCE.fullmatch(line.strip())
        if fence and opened is None:
            opened = number, fence[1], fence[2].strip()
        elif fence and opened is not None and fence[1] == opened[1] and not fence[2]:
            start, _, info = opened
            before = _NOT_RUN.fullmatch(lines[start - 2].strip()) if start > 1 else None
            code = "\n".join(lines[start : number - 1]) + "\n"
            found.append(Block(page, start, info, code, before[1] if before else None))
            opened = None
    assert opened is None, f"{page}: the block of line {opened and opened[0]} has no end"
    return found


def indented(page: Path) -> list[int]:
    """Line numbers of code blocks by indentation: a test cannot know what they are."""
    found, fenced, blank, listed = [], False, True, False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if _FENCE.fullmatch(line.strip()):
            fenced = not fenced
        elif not fenced and line.startswith("    ") and blank and not listed:
            found.append(number)
        if line.strip() and not line.startswith(" "):
            listed = bool(re.match(r"([-*]|\d+\.) ", line))
        blank = not line.strip()
    return found


def install_commands(folder: Path) -> None:
    """Write the commands of the project into a new folder; they use the packages that PYTHONPATH finds first."""
    programs = folder / "programs"
    programs.mkdir(parents=True)
    start = shlex.join(warm.python())
    for name, module in (("avs3d", "avs3d_bench.cli"), ("avs3d-eval", "evaluators.cli")):
        (programs / name).write_text(f"from {module} import main\n\nif __name__ == '__main__':\n    main()\n")
        (folder / name).write_text(f'#!/bin/sh\nexec {start} {shlex.quote(str(programs / name))} "$@"\n')
    (folder / "python").write_text(f'#!/bin/sh\nexec {start} "$@"\n')
    for name in ("avs3d", "avs3d-eval", "python"):
        (folder / name).chmod(0o755)


def run(block: Block, folder: Path) -> str:
    """Run a block in ``folder``, in an interpreter or shell of its own; its output.

    Raises:
        AssertionError: if it fails, with its output.
    """
    shims = folder / ".bin"
    if not shims.is_dir():
        install_commands(shims)
    command = ["bash", "-euo", "pipefail", "-c", block.code]
    if block.language == "python":
        script = folder / ".block.py"
        script.write_text(block.code, encoding="utf-8")
        command = [*warm.python(), str(script)]
    path = os.pathsep.join([str(shims), str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        command, cwd=folder, env=os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}, text=True, timeout=TIMEOUT,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, check=False,
        preexec_fn=keep_to_one_core,
    )  # fmt: skip
    assert done.returncode == 0, f"{block.name} ended with {done.returncode}:\n{block.code}\n{done.stdout}"
    return done.stdout


def calls(block: Block) -> list[list[str]]:
    """The commands of a ``usage`` block in words, brackets and comments dropped, alternatives (a|b) as one word."""
    joined = re.sub(r"\\?\n +", " ", re.sub(r"  +#.*", "", block.code))
    return [re.sub(r"[\[\]…]", " ", line).split() for line in joined.splitlines() if line.startswith("avs3d")]


def unknown(call: list[str]) -> list[str]:
    """What a call of a ``usage`` block names that the program does not know: subcommands and options."""
    context = click.Context(avs3d)
    commands: list[click.Command] = [evaluate if call[0] == "avs3d-eval" else avs3d]
    rest = call[1:]
    while isinstance(commands[0], click.Group) and rest and not rest[0].startswith("-"):
        names = rest.pop(0).split("|")
        groups = [command for command in commands if isinstance(command, click.Group)]
        found = [
            (name, group.commands.get(name) or _command(group, context, name)) for name in names for group in groups
        ]
        missing = [name for name, command in found if command is None]
        if missing:
            return missing
        commands = [command for _, command in found if command is not None]
    options = [{o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"} for command in commands]
    asked = [word.split("=")[0] for word in rest if re.match(r"--?[a-z]", word)]
    return [word for word in asked if not all(word in known for known in options)]


def _command(group: click.Group, context: click.Context, name: str) -> click.Command | None:
    return group.get_command(context, name) if name in group.list_commands(context) else None
