"""The `avs3d` command: `validate`, `schema` and `doctor` are defined here, the rest is found through entry points.

A package adds a subcommand with an entry point in the group ``avs3d.commands`` that names a click command. It is
imported only when it is called or asked for its own help, so that ``avs3d --help`` stays fast.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click
from click.exceptions import NoArgsIsHelpError

from avs3d_bench import __version__
from avs3d_bench.commands.click_options import PATH, WORKERS, Group, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER, OutputFile, Signature
from avs3d_bench.commands.report import REPORT_JSON
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime.imports import missing_extra, package_asking
from avs3d_bench.runtime.memory_limit import check_address_space, out_of_memory
from avs3d_bench.runtime.one_thread import ONE_THREAD
from avs3d_bench.text.printable import printable

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from avs3d_bench.commands.report import Problem

GROUP = "avs3d.commands"
#: One line per command of this project, so that the list of commands needs no import.
SUMMARIES = {
    "generate": "Generate a dataset from a manifest.",
    "scan": "Turn a scan of your own room into a manifest.",
    "seal": "Generate a dataset whose truth stays secret.",
    "unseal": "Prove that a sealed truth is what was committed to.",
    "manifest": "Sample a manifest of plausible observations, for training.",
    "sweep": "Vary the acoustics of a manifest's observations over a grid.",
    "contact-sheet": "Draw frames, masks, map and sound of every observation.",
    "view": "Look at a dataset and listen to it, in the browser.",
    "video": "Write an observation as an MP4 with its sound.",
    "view-3d": "Open an observation's scene, path, source and predictions in 3D.",
    "export": "Export to Croissant, WebDataset, Hugging Face; write a dataset card.",
    "release": "Cut a dataset into archives to be hosted, with checksums.",
    "get": "Download a released dataset, check it, unpack it.",
    "assets": "Find, fetch, import and verify objects and sounds.",
    "doctor": "Report what is installed and works, and how to get the rest.",
    "list": "List the observations of a dataset.",
    "validate": "Check a dataset; name every problem by file.",
    "schema": "Write the JSON Schema of every file of the contract.",
    "eval": "Score a submission; the same as avs3d-eval.",
    "check": "Check a submission; name every bad file.",
    "compare": "Compare methods: differences, intervals, p-values.",
    "factors": "Show figures by distance, direction, reverberation and others.",
    "verify": "Score a submission again and compare with a file of scores.",
    "leaderboard": "Rank files of scores on one static page.",
    "tables": "Turn files of scores into the paper's tables.",
    "qa-score": "Score answers to questions about sound.",
    "sweep-curve": "Draw scores against a parameter of a sweep.",
    "metrics": "Score folders of PNG masks by the convention of a benchmark.",
    "baseline": "Run a baseline on a dataset and write its submission.",
    "train": "Train the network that looks and listens.",
}
#: Greatest length of a message of click (characters).
_LONGEST = 600


@lru_cache(maxsize=1)
def _entry_points() -> dict[str, metadata.EntryPoint]:
    return {point.name: point for point in metadata.entry_points(group=GROUP)}


def _load(point: metadata.EntryPoint) -> click.Command:
    try:
        command = point.load()
    except ModuleNotFoundError as error:
        package = point.module.split(".")[0]
        raise Avs3dError(missing_extra(error, package)) from error
    except AttributeError:
        raise Avs3dError(f"avs3d {point.name}: {point.value} does not exist; reinstall avs3d-bench") from None
    if not isinstance(command, click.Command):
        raise Avs3dError(f"avs3d {point.name}: {point.value} is no click command; fix the entry point")
    return command


class LazyGroup(Group):
    """A group whose foreign subcommands are imported when they are used, not when they are listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names, sorted."""
        return sorted({*super().list_commands(ctx), *_entry_points()})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Our own command, or the entry point's, imported now."""
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        point = _entry_points().get(cmd_name)
        return _load(point) if point else None

    def summaries(self, ctx: click.Context) -> dict[str, str]:
        """Name → one line of every command, without importing any."""
        rows = {}
        for name in self.list_commands(ctx):
            own = super().get_command(ctx, name)
            rows[name] = own.get_short_help_str(limit=90) if own else SUMMARIES.get(name, "")
        return rows

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self.summaries(ctx).items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names of commands or, after a dash, of options."""
        from click.shell_completion import CompletionItem

        names = self.summaries(ctx).items()
        items = [CompletionItem(name, help=line) for name, line in names if name.startswith(incomplete)]
        return [*items, *click.Command.shell_complete(self, ctx, incomplete)]


@click.group(cls=LazyGroup)
@click.version_option(__version__, prog_name="avs3d")
def avs3d() -> None:
    """The benchmark toolkit for 3D audio-visual segmentation."""


@avs3d.command(short_help=SUMMARIES["validate"])
@click.argument("root", type=PATH)
@click.option("--deep", is_flag=True, help="Decode every file: contents, hashes, sound against geometry.")
@click.option(
    "--json", "json_file", type=OutputFile(REPORT_JSON), metavar="FILE", help="Write the findings to this file as well."
)
@click.option("--workers", type=WORKERS, default=None, help="Processes of --deep [one per core].")
@click.option("--regenerate", type=click.IntRange(1, 100_000), metavar="N", help="Regenerate N random frames, compare.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=None, help="Which frames --regenerate takes.")
@click.option("--manifest", type=PATH, metavar="FILE", help="Of --regenerate, if the manifest names files.")
@click.option("--hrtf", type=PATH, metavar="FILE", help="Of --regenerate, if the dataset was made with a SOFA file.")
def validate(
    root: Path,
    deep: bool,
    json_file: Path | None,
    workers: int | None,
    regenerate: int | None,
    seed: int | None,
    manifest: Path | None,
    hrtf: Path | None,
) -> None:
    """Check the dataset at ROOT and name every problem by file.

    Exit status: 0 valid, 1 problems found, 2 usage (also: made by other versions than --regenerate finds here). The
    official release is checked as what it is. Of WebDataset shards, the index and the tars are checked.
    """
    from avs3d_bench.commands.report import print_report
    from avs3d_bench.exports.shard_check import check_shards, holds_shards
    from avs3d_bench.formats.files import write_json
    from avs3d_bench.validate import validate as check

    again = _regenerate(root, regenerate, seed, manifest, hrtf) if regenerate else ()
    look = check_shards if holds_shards(root) else check
    report = look(root, deep=deep, workers=workers, progress=sys.stderr.isatty())
    if again:
        from dataclasses import replace

        from avs3d_bench.commands.report import ordered

        report = replace(report, problems=ordered([*report.problems, *again]))
    try:
        if json_file is not None:
            write_json(json_file, report.as_dict())
    finally:
        print_report(report)
    if not report.valid:
        raise SystemExit(1)


def _regenerate(
    root: Path, count: int, seed: int | None, manifest: Path | None, hrtf: Path | None
) -> tuple[Problem, ...]:
    """Regenerate frames, saying which; threads are bounded before numpy starts them, as the generator does."""
    os.environ.update(ONE_THREAD)
    import secrets

    from avs3d_bench.validation.regenerate import regenerate

    number = secrets.randbelow(2**32) if seed is None else seed
    click.echo(f"regenerating {count} random frames (--seed {number})")
    return regenerate(root, count, seed=number, manifest=manifest, say=click.echo, hrtf=hrtf)


@avs3d.command("list", short_help=SUMMARIES["list"])
@click.argument("root", type=PATH)
@only_option
@click.option("--json", "json_file", type=OutputFile(Signature(keys=("dataset", "observations"))), metavar="FILE",
              help="Write the table to this file as well.")  # fmt: skip
def list_observations(root: Path, only: tuple[str, ...], json_file: Path | None) -> None:
    """List the observations of the dataset at ROOT: key, category, frames, sound, T30 and instances.

    Sound is in seconds; T30 is the room's reverberation time in seconds; instances are the placed objects. What the
    official release does not say is a dash.
    """
    from avs3d_bench.dataset import Dataset
    from avs3d_bench.formats.files import write_json
    from avs3d_bench.inspector.listing import list_dataset, print_listing

    listing = list_dataset(Dataset(root), only)
    try:
        if json_file is not None:
            write_json(json_file, listing.as_dict())
    finally:
        print_listing(listing)


@avs3d.command(short_help=SUMMARIES["schema"])
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="The folder.")
def schema(folder: Path) -> None:
    """Write the JSON Schema of every JSON file of a dataset and of a submission."""
    from avs3d_bench.exports.schema_files import write_schemas

    for path in write_schemas(folder):
        click.echo(str(path))


@avs3d.command(short_help=SUMMARIES["doctor"])
@click.option("--json", "json_file", type=OutputFile(Signature(keys=("toolkit_version", "findings"))), metavar="FILE",
              help="Write the findings to this file as well.")  # fmt: skip
def doctor(json_file: Path | None) -> None:
    """Report what is installed and works here, and for each gap the command that fixes it.

    Looks at the core install, the generator's engines (Habitat too), scans, assets and their tokens, PyTorch, the GPU,
    checkpoints and the disk. Nothing is downloaded or changed. Exit status: 0, whatever is missing.
    """
    from rich.console import Console

    from avs3d_bench.formats.files import write_json
    from avs3d_bench.runtime.doctor import CheckResult, all_checks, as_dict, examine, print_finding, print_summary

    console = Console(highlight=False)
    group = ""

    def show(finding: CheckResult) -> None:
        nonlocal group
        if finding.group != group:
            group = finding.group
            console.print(group, style="bold")
        print_finding(finding, console)

    with console.status("looking at what is installed …"):
        findings = examine(all_checks(), show)
    print_summary(findings, console)
    if json_file is not None:
        write_json(json_file, as_dict(findings))


def _fail(code: int, program: str, *messages: object) -> NoReturn:
    for message in messages:
        click.echo(f"{program}: error: {printable(' '.join(str(message).split()))}", err=True)
    raise SystemExit(code)


def _terminate(number: int, _: object) -> NoReturn:
    raise SystemExit(128 + number)


def run(command: click.Command, arguments: Sequence[str] | None = None, *, program: str = "avs3d") -> NoReturn:
    """Run a click command as a program of this project and exit.

    An `Avs3dError` becomes the one line ``<program>: error: …`` on stderr and the process ends with its exit code; so
    do errors of the operating system (full disk, read-only folder; 1), too little memory (1), a missing extra (1) and
    click's own usage errors (2). An interrupt ends with 130; SIGTERM (`timeout`, job schedulers) unwinds the program as
    Ctrl-C does, so that nothing temporary is left, and ends with 143. Anything else is a bug and keeps its traceback.

    Args:
        command: e.g. the group of `avs3d`, or the command of another entry point of the project.
        arguments: instead of the process's own.
        program: its name in messages.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # an ASCII terminal, a file name that is no UTF-8
    with suppress(ValueError):  # only the main thread may ask for signals
        signal.signal(signal.SIGTERM, _terminate)
    try:
        check_address_space(sys.argv[1:] if arguments is None else arguments)
        code = command.main(
            args=None if arguments is None else list(arguments), prog_name=program, standalone_mode=False
        )
    except Avs3dError as error:
        _fail(error.exit_code, program, *error.args)
    except NoArgsIsHelpError as error:
        error.show()  # a bare group: its help, on stderr
        raise SystemExit(error.exit_code) from None
    except click.ClickException as error:
        code = UsageError.exit_code if isinstance(error, click.UsageError) else 1
        text = error.format_message()  # repeats what was given, however long that is
        _fail(code, program, text if len(text) <= _LONGEST else f"{text[:_LONGEST]} …")
    except (KeyboardInterrupt, click.Abort):
        _fail(130, program, "interrupted")
    except BrokenPipeError:
        # The reader of our output has gone (`| head`): not an error; keep Python from complaining at exit.
        sys.stderr.close()
        raise SystemExit(0) from None
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # rich makes of it an exit with 1
            raise SystemExit(0) from None
        raise
    except ModuleNotFoundError as error:
        package = (error.name or "").split(".")[0]
        if package in ("avs3d_bench", "generators", "evaluators", "baselines", ""):
            raise
        _fail(1, program, missing_extra(error, package_asking(error)))
    except (MemoryError, ImportError) as error:
        line = out_of_memory(error)
        if line is None:
            raise
        _fail(1, program, line)
    except OSError as error:
        from avs3d_bench.formats.files import os_error_line

        _fail(1, program, os_error_line(error))
    raise SystemExit(code if isinstance(code, int) else 0)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """The `avs3d` program."""
    run(avs3d, arguments)
