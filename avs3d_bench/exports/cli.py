"""`avs3d export`: a dataset in the forms that other tools read."""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeVar

import click

from avs3d_bench import __version__
from avs3d_bench.commands.click_options import PATH, WORKERS, Group, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER, OutputFile
from avs3d_bench.contract.questions import QUESTION_KINDS
from avs3d_bench.exports.acoustics import RECEIVERS
from avs3d_bench.exports.samples import EXTRA_KINDS, SPLIT_CHOICES
from avs3d_bench.exports.seld.recordings import FORMATS
from avs3d_bench.exports.shards import ShardIndex
from avs3d_bench.exports.signatures import BUNDLE, CARD, CROISSANT

_C = TypeVar("_C", bound=Callable[..., Any])
_ROOT = click.argument("root", type=PATH)


class _Moment(click.DateTime):
    """A moment in UTC: a date, with a time and an offset (Z, +01:00) if they are given.

    Args:
        ends: of a date without a time, take its last second instead of its first.
    """

    def __init__(self, *, ends: bool = False) -> None:
        super().__init__(["%Y-%m-%d", "%Y-%m-%d %H:%M:%S", "%Y-%m-%d %H:%M:%S%z"])
        self.ends = ends

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> datetime:
        """The moment, without a time zone."""
        moment = super().convert(value, param, ctx)
        if moment.tzinfo is not None:
            return moment.astimezone(UTC).replace(tzinfo=None)
        if self.ends and isinstance(value, str) and ":" not in value:
            return moment + timedelta(days=1, seconds=-1)
        return moment


_START, _END = _Moment(), _Moment(ends=True)


@click.group(cls=Group, noun="form")
def export() -> None:
    """Export a dataset in forms that other tools read."""


def _shard_options(command: _C) -> _C:
    size = "A shard's size in megabytes (10⁶ bytes)."
    for option in (
        click.option("--workers", type=WORKERS, default=None, help="Processes [one per core]."),
        click.option("--with", "extras", type=click.Choice(list(EXTRA_KINDS)), multiple=True, help="More files."),
        only_option,
        click.option("--shard-size", "shard_mb", type=float, default=256.0, show_default=True, metavar="MB", help=size),
        click.option("--split", type=click.Choice(SPLIT_CHOICES), default="all", show_default=True),
        click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="The folder."),
        _ROOT,
    ):
        command = option(command)
    return command


def _say(folder: Path, index: ShardIndex) -> None:
    for name, split in index.splits.items():
        click.echo(
            f"{name}: {split.samples:,} samples of {split.observations} observations, {split.shards} shards, "
            f"{split.bytes / 1e6:,.1f} MB"
        )
    click.echo(str(folder))


@export.command(short_help="Tar shards of frames.")
@_shard_options
def webdataset(root: Path, folder: Path, **options: Any) -> None:
    """Write the dataset at ROOT as WebDataset shards.

    The same dataset and options give the same bytes. The same command continues an interrupted export; `shards.json` is
    written last and holds the sha256 of every shard.
    """
    from avs3d_bench.exports.webdataset import write_webdataset

    _say(folder, write_webdataset(root, folder, progress=sys.stderr.isatty(), **options))


@export.command(short_help="A folder for `datasets.load_dataset`.")
@_shard_options
def huggingface(root: Path, folder: Path, **options: Any) -> None:
    """Write the dataset at ROOT as Parquet files with a dataset card: `datasets.load_dataset(DIR)` reads them.

    The same dataset and options give the same bytes. An interrupted export goes on where it stopped.
    """
    from avs3d_bench.exports.huggingface import write_huggingface

    _say(folder, write_huggingface(root, folder, progress=sys.stderr.isatty(), **options))


@export.command(short_help="Recordings and labels for sound event localisation and detection.")
@_ROOT
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="A new folder.")
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default="foa",
    show_default=True,
    help="foa: as STARSS23; stereo: as DCASE 2025; binaural: as stereo, but the two ears.",
)
@only_option
@click.option("--test-home", "test", multiple=True, metavar="GLOB", help="Homes for testing; repeatable [a fifth].")
@click.option("--gain-db", type=click.FloatRange(-60, 60), default=0.0, show_default=True, help="Raises all sound.")
@click.option("--maps", is_flag=True, help="Acoustic energy maps as well: maps_dev/.")
@click.option("--video", is_flag=True, help="Films as well: panoramas of 360° × 180°, or what a stereo clip looks at.")
@click.option("--video-width", type=int, default=None, metavar="PX", help="Of a film [foa 360, else 640].")
@click.option("--manifest", type=PATH, default=None, help="--video: the manifest's file, if it names files beside it.")
@click.option("--hrtf", type=PATH, default=None, help="--video: the SOFA file with which the dataset was made, if any.")
@click.option("--workers", type=WORKERS, default=None, help="Processes [one per core].")
def seld(root: Path, folder: Path, workers: int | None, **options: Any) -> None:
    """Write the dataset at ROOT for sound event localisation and detection: WAV at 24 kHz, labels every 100 ms.

    The folders, names and columns are those that the baselines of the DCASE challenge read. Azimuth is positive to the
    left there. The same dataset and options give the same bytes; DIR is written whole or not at all.
    """
    from avs3d_bench.exports.seld.write import SeldSettings, write_seld

    index = write_seld(root, folder, SeldSettings(**options), workers=workers, progress=sys.stderr.isatty())
    for split in sorted({record.split for record in index.recordings}):
        chosen = [record for record in index.recordings if record.split == split]
        seconds = sum(record.label_frames for record in chosen) / 10
        click.echo(f"{split}: {len(chosen):,} recordings, {seconds:,.0f} s, {sum(r.events for r in chosen):,} labels")
    click.echo(str(folder))


@export.command(short_help="A Croissant description (JSON-LD).")
@_ROOT
@click.option(
    "-o", "--output", type=OutputFile(CROISSANT), metavar="FILE", required=True, help="The file: ROOT/croissant.json."
)
@click.option("--url", default=None, help="The dataset's home page.")
@click.option("--date", "published", default=None, metavar="YYYY-MM-DD", help="When it was published.")
def croissant(root: Path, output: Path, url: str | None, published: str | None) -> None:
    """Describe the dataset at ROOT in Croissant: files, records, licence, citation, responsible-AI fields.

    Paths in it are relative to ROOT: the file must be in ROOT, because readers look for the others beside it.
    """
    from avs3d_bench.exports.croissant import write_croissant

    write_croissant(root, output, url=url, published=published)
    click.echo(str(output))


@export.command(short_help="A dataset card.")
@_ROOT
@click.option("-o", "--output", type=OutputFile(CARD), metavar="FILE", required=True, help="The file, e.g. README.md.")
def card(root: Path, output: Path) -> None:
    """Write the card of the dataset at ROOT: contents, sizes, rooms, sound, licences, limits, how to load it."""
    from avs3d_bench.exports.card import write_card

    write_card(root, output)
    click.echo(str(output))


@export.command(short_help="Impulse responses, positions, meshes and pictures of rooms.")
@click.argument("source", type=PATH, metavar="ROOT|MANIFEST")
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="The folder.")
@only_option
@click.option("--spacing", type=float, default=0.5, show_default=True, metavar="M", help="Of the grid of listeners.")
@click.option("--sources", type=int, default=4, show_default=True, metavar="N", help="Sources in each room.")
@click.option(
    "--absorption",
    type=float,
    multiple=True,
    default=(1.0, 2.0),
    show_default=True,
    metavar="FACTOR",
    help="Of every material's Eyring exponent: a room of other materials for each; repeatable.",
)
@click.option("--receiver", type=click.Choice(RECEIVERS), default="omni", show_default=True)
@click.option("--sample-rate", type=int, default=16_000, show_default=True, metavar="HZ")
@click.option("--pictures", type=int, default=12, show_default=True, metavar="N", help="Pictures in each room.")
@click.option("--size", type=int, default=512, show_default=True, metavar="PX", help="Side of a picture.")
@click.option("--device", type=click.Choice(["cpu", "cuda"]), default="cpu", show_default=True)
@click.option("--manifest", type=PATH, default=None, help="Of ROOT, if its manifest names files beside it.")
@click.option("--workers", type=WORKERS, default=None, help="Processes [one per core].")
def acoustics(source: Path, folder: Path, **options: Any) -> None:
    """Write the impulse responses of the rooms of a dataset or a manifest, to learn acoustic fields from.

    Every room is heard from a grid of its walkable floor, with splits by position, home and material. The same rooms
    and options give the same bytes; DIR is written whole or not at all (docs/export-acoustics.md).
    """
    from avs3d_bench.exports.acoustics import AcousticsSettings, describe, write_acoustics

    record = write_acoustics(source, folder, AcousticsSettings(progress=sys.stderr.isatty(), **options))
    for space in record.spaces:
        count = f"{len(space.sources)} sources × {len(space.listeners)} listeners"
        click.echo(f"{space.home}/{space.room}/{space.material}: {count}")
    click.echo(f"{record.count:,} responses")
    click.echo(describe(record))
    click.echo(str(folder))


@export.command(short_help="Questions about what is heard, with exact answers.")
@_ROOT
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="The folder.")
@click.option(
    "--split", type=click.Choice(SPLIT_CHOICES), default="test", show_default=True, help="Frames asked about."
)
@click.option(
    "--kind", "kinds", type=click.Choice(QUESTION_KINDS), multiple=True, help="Of questions; repeatable [all]."
)
@click.option(
    "--per-group", type=click.IntRange(1), default=4, show_default=True, help="Questions of a kind in a group."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of all choices.")
@only_option
def qa(root: Path, folder: Path, **options: Any) -> None:
    """Write questions about the groups of part_3 of the dataset at ROOT, as JSON lines with pictures and clips.

    Every question is asked under several sounds, and each of its options is right under one of them: no answer that
    ignores the sound is right more often than chance. The same data and options give the same bytes.
    """
    from avs3d_bench.exports.qa.write import QaOptions, write_qa

    written = write_qa(root, folder, QaOptions(**options), progress=sys.stderr.isatty())
    for kind, counts in written.kinds.items():
        click.echo(
            f"{kind}: {counts.lines:,} lines in {counts.sets:,} sets of {counts.groups} groups, chance "
            f"{counts.chance:.3f}, best answer without sound {counts.chance + counts.prior_excess:.3f}"
        )
    for kind in options["kinds"] or QUESTION_KINDS:
        if kind not in written.kinds:
            click.echo(f"{kind}: nothing to ask: no group has siblings that differ in it")
    click.echo(str(folder))


@export.command(short_help="A competition bundle for Codabench.")
@click.argument("public", type=PATH)
@click.argument("private", type=PATH)
@click.option(
    "-o", "--output", type=OutputFile(BUNDLE), metavar="FILE", required=True, help="The bundle, e.g. bundle.zip."
)
@click.option("--title", default=None, help="Title of the competition [the dataset's name].")
@click.option(
    "--docker-image",
    default=f"avs3d-evaluator:{__version__}",
    show_default=True,
    metavar="NAME:TAG",
    help="The evaluator's image, as the platform's workers pull it.",
)
@click.option("--start", type=_START, default=None, metavar="DATE", help="Start, UTC: YYYY-MM-DD[ HH:MM:SS] [today].")
@click.option(
    "--end", type=_END, default=None, metavar="DATE", help="End, UTC; without a time, the end of that day [never]."
)
@click.option("--development", multiple=True, metavar="KEY_GLOB", help="Observations of a first phase. Repeatable.")
@click.option("--final-start", type=_START, default=None, metavar="DATE", help="Start of the final phase, UTC.")
@click.option("--data-url", default=None, help="Where participants get PUBLIC [it is put into the bundle].")
@click.option("--contact", default=None, metavar="EMAIL", help="The organisers' address.")
@click.option("--max-per-day", type=click.IntRange(1), default=5, show_default=True, help="Submissions a day.")
@click.option("--max-submissions", type=click.IntRange(1), default=100, show_default=True, help="In the last phase.")
@click.option("--image", type=PATH, default=None, metavar="FILE", help="Picture of the competition [one is drawn].")
@click.option("--terms", type=PATH, default=None, metavar="FILE", help="Terms, Markdown [a general text].")
@click.option("--approval", is_flag=True, help="Admit each participant by hand; without it, all who register.")
@click.option("--practice", type=PATH, default=None, metavar="ROOT", help="A dataset with its truth, for the kit.")
@click.option("--install", default=None, metavar="COMMAND", help="How participants install this [pip, this version].")
def codabench(
    public: Path,
    private: Path,
    output: Path,
    title: str | None,
    start: datetime | None,
    install: str | None,
    **options: Any,
) -> None:
    """Write a competition for Codabench: participants get PUBLIC, the platform scores with the truth in PRIVATE.

    Both are trees of one dataset, such as `avs3d seal` writes. The bundle is checked against the platform's rules
    (docs/competition.md).
    """
    from avs3d_bench.dataset import Dataset
    from avs3d_bench.exports.codabench import CompetitionSettings, write_codabench

    today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0, tzinfo=None)
    if install is not None:
        options["install"] = install
    settings = CompetitionSettings(title=title or Dataset(public).name, start=start or today, **options)
    written = write_codabench(public, private, output, settings)
    for phase in written.phases:
        click.echo(f"{phase.name}: {len(phase.observations)} observations, {phase.masks:,} masks")
        click.echo(f"  from {phase.start} UTC " + (f"to {phase.end} UTC" if phase.end else "on, without an end"))
    click.echo(f"ranked by {written.columns[0].title}; {written.size / 1e6:,.1f} MB")
    click.echo(f"image: {settings.docker_image}, which the platform's workers must be able to pull")
    click.echo(str(output))
