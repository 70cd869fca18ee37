"""The command `avs3d baseline`: one subcommand for each baseline, imported when it is called."""

from __future__ import annotations

import sys
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from avs3d_bench.errors import UsageError

if TYPE_CHECKING:
    from avs3d_bench.submission import SubmissionWriter

_HELP = {"help_option_names": ["-h", "--help"]}
_PATH: Any = click.Path(path_type=Path)
_RATE = click.FloatRange(0.0, 1.0)
_F = TypeVar("_F", bound=Callable[..., Any])


class _Group(click.Group):
    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does it, with the baselines there are and a hint at the nearest name."""
        known = self.list_commands(ctx)
        if args and not args[0].startswith("-") and args[0] not in known:
            near = get_close_matches(args[0], known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise UsageError(f"no baseline {args[0]!r}: expected one of {', '.join(known)}{hint}")
        return super().resolve_command(ctx, args)


@click.group(cls=_Group, context_settings=_HELP)
def baseline() -> None:
    """Run a baseline on a dataset and write its submission.

    The same dataset and options give the same bytes.
    """


def _common(command: _F) -> _F:
    """The options that every baseline has."""
    for option in (
        click.option("--overwrite", is_flag=True, help="Take the place of a submission that stands there."),
        click.option("--only", multiple=True, metavar="KEY_GLOB", help="Only these observations; repeatable."),
        click.option("-o", "--output", "path", type=_PATH, required=True, help="Folder of the submission."),
        click.option("--dataset", "root", type=_PATH, required=True, help="Root of the dataset."),
    ):
        command = option(command)
    return command


def _done(writer: SubmissionWriter) -> None:
    count = len(writer.observations)
    masks = sum(len(observation.test) for observation in writer.observations)
    plural = "" if count == 1 else "s"
    click.echo(f"{writer.path}: {masks} masks of {count} observation{plural}: {writer.record.method}")


def _trivial(name: str, root: Path, path: Path, only: tuple[str, ...], overwrite: bool) -> None:
    from avs3d_bench.dataset import Dataset
    from baselines.trivial import write_trivial

    progress = sys.stderr.isatty()
    _done(write_trivial(name, Dataset(root), path, only=only, overwrite=overwrite, progress=progress))


@baseline.command("all-black", context_settings=_HELP, short_help="Nothing sounds: every mask is black.")
@_common
def all_black(**options: Any) -> None:
    """Write black masks, of the size of the input pictures. No truth is read."""
    _trivial("all-black", **options)


@baseline.command("all-white", context_settings=_HELP, short_help="Everything sounds: every mask is white.")
@_common
def all_white(**options: Any) -> None:
    """Write white masks, of the size of the input pictures. No truth is read."""
    _trivial("all-white", **options)


@baseline.command("centre-box", context_settings=_HELP, short_help="The central quarter of every picture.")
@_common
def centre_box(**options: Any) -> None:
    """Write masks whose middle half of rows and columns is white. No truth is read."""
    _trivial("centre-box", **options)


@baseline.command(context_settings=_HELP, short_help="The ground truth of test frames, perfect or with errors.")
@_common
@click.option(
    "--instance",
    type=click.Choice(["category", "sounding"]),
    default="category",
    show_default=True,
    help="The visible pixels of every instance of the sounding category, or of the sounding one alone.",
)
@click.option("--drop", type=_RATE, default=0.0, metavar="P", help="Probability that a frame's mask is all black.")
@click.option(
    "--swap", type=_RATE, default=0.0, metavar="P",
    help="Probability that in an observation a silent twin is marked instead (with --instance sounding).",
)  # fmt: skip
@click.option(
    "--dilate", type=float, default=0.0, metavar="PX",
    help="Grow masks by a disc of this radius in pixels at 1008 pixels; below 0: shrink them.",
)  # fmt: skip
@click.option(
    "--confuse", type=_RATE, default=0.0, metavar="P",
    help="Probability that in an observation a similar object is marked as well.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of every random decision.")
@click.option("--points", is_flag=True, help="Write points on the true mesh as well (with --instance sounding).")
@click.option("--workers", type=click.IntRange(1, 256), default=None, help="Processes [one per core].")
def oracle(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    instance: Any,
    drop: float,
    swap: float,
    dilate: float,
    confuse: float,
    seed: int,
    points: bool,
    workers: int | None,
) -> None:
    """Write the ground truth of the test frames as a submission, perfect or with errors.

    This USES THE GROUND TRUTH OF TEST FRAMES: its scores are bounds, not results; submission.json says so. With
    --instance category it is what a perfect detector reaches that cannot hear which of several objects sounds.
    --instance sounding also works on the official release.
    """
    from avs3d_bench.dataset import Dataset
    from baselines.errors import ErrorModel
    from baselines.oracle import write_oracle

    writer = write_oracle(
        Dataset(root),
        path,
        instance=instance,
        errors=ErrorModel(drop=drop, swap=swap, dilate=dilate, confuse=confuse, seed=seed),
        points=points,
        only=only,
        overwrite=overwrite,
        workers=workers,
        progress=sys.stderr.isatty(),
    )
    _done(writer)
