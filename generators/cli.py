"""The command `avs3d generate`."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import click

from avs3d_bench.commands.click_options import HELP, PATH, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER
from avs3d_bench.contract import layout
from avs3d_bench.runtime.one_thread import ONE_THREAD
from avs3d_bench.scheduling.options import Options, scheduling_options
from generators.core.limits import FRAMES, SIZE, WORKERS
from generators.options import Audio, CameraName, Device, EngineOptions, Extra, Form, GenerateOptions, Vision

#: Folders and receivers that `--with` takes; a receiver has a value of its own.
_FOLDERS: tuple[Extra, ...] = get_args(Extra)
_RECEIVERS = ("ambisonics", "array")


@dataclass(frozen=True)
class ExtraOutputs:
    """Outputs that `--with` adds.

    Attributes:
        folders: optional folders.
        ambisonics: order; None: no ambisonic clips.
        array: file of the microphones; None: no array.
        more: further words of a command.
    """

    folders: tuple[Extra, ...] = ()
    ambisonics: int | None = None
    array: Path | None = None
    more: tuple[str, ...] = ()


def _beside(_: click.Context, __: click.Parameter, values: tuple[str, ...], more: tuple[str, ...] = ()) -> ExtraOutputs:
    """Values of `--with`: a folder, ``ambisonics``, ``ambisonics=ORDER``, ``array=FILE``, a word of ``more``."""
    found = ExtraOutputs()
    for value in values:
        name, given, text = value.partition("=")
        folders = [folder for folder in _FOLDERS if folder == value]
        if folders:
            found = replace(found, folders=(*found.folders, *folders))
        elif value in more:
            found = replace(found, more=(*found.more, value))
        elif name == "ambisonics":
            if given and text not in ("1", "2", "3"):
                raise click.BadParameter(f"the order of ambisonics is {text!r}, expected 1, 2 or 3: ambisonics=2")
            found = replace(found, ambisonics=int(text or 1))
        elif name == "array":
            if not text:
                raise click.BadParameter("array needs a file that lists its microphones: --with array FILE")
            found = replace(found, array=Path(text))
        else:
            known = ", ".join(map(repr, (*_FOLDERS, *more, *_RECEIVERS)))
            raise click.BadParameter(f"{value!r} is not one of {known}.")
    return found


class MakingCommand(click.Command):
    """A command in which ``--with array`` takes the word after it, too."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Write ``--with array FILE`` as ``--with array=FILE`` before click takes it apart."""
        joined: list[str] = []
        for word in args:
            if joined[-2:] == ["--with", "array"] or joined[-1:] == ["--with=array"]:
                joined[-1] += f"={word}"
            else:
                joined.append(word)
        return super().parse_args(ctx, joined)


#: What `avs3d generate` and `avs3d seal` have in common.
_OPTIONS = (
    click.option(
        "--workers", type=click.IntRange(*WORKERS), default=None, help="Worker processes (default: one per core)."
    ),
    click.option(
        "--device",
        type=click.Choice(get_args(Device)),
        default="cpu",
        show_default=True,
        help="What draws the pictures, bakes the light and, with --audio tracer, traces the sound.",
    ),
    click.option(
        "--vision",
        type=click.Choice(get_args(Vision)),
        default=None,
        help="Renderer (default: embree; cuda on cuda).",
    ),
    click.option(
        "--camera",
        type=click.Choice(get_args(CameraName)),
        default=EngineOptions.camera,
        show_default=True,
        help="Exposure, vignette, noise and sharpening of a camera: mild, or a phone's; ideal: none.",
    ),
    click.option(
        "--habitat-python",
        type=PATH,
        default=None,
        metavar="FILE",
        help="Interpreter with habitat-sim (default: $AVS3D_HABITAT_PYTHON).",
    ),
    click.option(
        "--audio",
        type=click.Choice(get_args(Audio)),
        default=None,
        help="Acoustic engine (default: the manifest's, or tracer).",
    ),
    click.option(
        "--frames", type=click.IntRange(*FRAMES), default=None, help="Frames per observation (manifest: 120)."
    ),
    click.option("--size", type=click.IntRange(*SIZE), default=None, help="Pixels per side (manifest: 1008)."),
    click.option(
        "--hrtf",
        type=PATH,
        metavar="HEAD",
        help="Head that hears (--audio tracer only): sphere, family, family-test, kemar or a SOFA file.",
    ),
    click.option(
        "--scans",
        type=PATH,
        default=None,
        metavar="ROOT",
        help="Folder with HM3D, Matterport3D or other scans (default: $AVS3D_SCANS).",
    ),
    click.option(
        "--cache", type=PATH, metavar="DIR", default=None, help="Folder of baked homes (default: $AVS3D_CACHE)."
    ),
)


def making_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options that `avs3d generate` and `avs3d seal` have in common, as a decorator."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def with_option(*more: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``--with``, as a decorator; the command gets ``beside``. ``more``: further words that it takes."""
    return click.option(
        "--with",
        "beside",
        multiple=True,
        callback=_beside if not more else partial(_beside, more=more),
        metavar=f"[{'|'.join((*_FOLDERS, *more))}|ambisonics[=ORDER]|array FILE]",
        help="Also write this folder, or the clips of this receiver (--audio tracer only); repeatable.",
    )


def choose_tools(habitat_python: Path | None) -> None:
    """Set the variables that worker processes read, before numpy is imported."""
    os.environ.update(ONE_THREAD)
    from avs3d_bench.runtime.user_path import user_path

    if habitat_python is not None:
        os.environ["AVS3D_HABITAT_PYTHON"] = str(user_path(habitat_python).absolute())


class _FormChoice(click.Choice[str]):
    """The forms of a dataset; ``webdataset`` was called ``tar`` for a time, with one file per observation."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "tar":
            click.echo(
                "avs3d generate: note: --format tar is called --format webdataset: shards by split, as those of avs3d "
                "export webdataset",
                err=True,
            )
            value = "webdataset"
        return super().convert(value, param, ctx)


@click.command(cls=MakingCommand, context_settings=HELP)
@click.argument("manifest", type=PATH)
@click.option("-o", "--output", "root", required=True, type=OUTPUT_FOLDER, metavar="ROOT", help="The dataset's folder.")
@only_option
@making_options
@with_option()
@click.option(
    "--format",
    type=_FormChoice(get_args(Form)),
    default="folders",
    show_default=True,
    help="A folder of files for each observation, or tar shards of samples for training.",
)
@click.option(
    "--remake",
    multiple=True,
    metavar="KEY_GLOB",
    help="Regenerate these observations even if they are there; repeatable.",
)
@scheduling_options
def generate(
    manifest: Path,
    root: Path,
    habitat_python: Path | None,
    scheduling: Options,
    beside: ExtraOutputs,
    **chosen: Any,
) -> None:
    """Generate the dataset that MANIFEST describes into a folder; run it again to continue after an interruption.

    The same manifest and the same versions give the same bytes, whatever the number of workers. Sound from the
    SoundSpaces engine (RLRAudioPropagation, CC-BY-NC 4.0) is for non-commercial research; that of the tracer, the
    default, and of --audio analytic is free.
    """
    choose_tools(habitat_python)
    from generators.manifest.reading import read_manifest
    from generators.plan import make_plans
    from generators.run.generation import generate_plans

    options = GenerateOptions(extras=beside.folders, ambisonics=beside.ambisonics, array=beside.array, **chosen)
    source = read_manifest(manifest)
    plans = make_plans(source, options)
    outcome = generate_plans(source, plans, root, options, scheduling)
    said = f" (see the messages above, and {root / layout.FAILURES_JSONL})" if outcome.failed else ""
    click.echo(f"{root}: {len(outcome.made)} made, {len(outcome.kept)} kept, {len(outcome.failed)} failed{said}")
    if outcome.warning:
        click.echo(f"avs3d generate: warning: {outcome.warning}", err=True)
    if outcome.stopped:
        left = len(plans) - len(outcome.made) - len(outcome.kept) - len(outcome.failed)
        click.echo(
            f"avs3d: stopped by --max-failures {scheduling.max_failures}; {left} observations were not tried", err=True
        )
    if outcome.failed:
        raise SystemExit(1)
