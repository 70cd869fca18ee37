"""`avs3d video`, `avs3d view-3d` and `avs3d contact-sheet`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import click

from avs3d_bench.commands.click_options import HELP, PATH, dataset_option, only_option
from avs3d_bench.commands.outputs import DRAWN_BY, OUTPUT_FOLDER, OutputFile, Signature
from avs3d_bench.errors import UsageError

#: What a film and a saved scene (the HTML; a recording of viser has no room for it) say about themselves.
_FILM = Signature(marks=(b"ftyp", DRAWN_BY.encode()))
_SCENE = Signature(marks=(b"<html", f'<meta name="generator" content="{DRAWN_BY} view-3d">'.encode()))


@click.command(context_settings=HELP, short_help="Write an observation as a film with its binaural sound.")
@click.argument("key")
@dataset_option
@click.option(
    "-o", "--output", "path", type=OutputFile(_FILM), metavar="FILE", required=True, help="The film: FILE.mp4."
)
@click.option("--submission", type=PATH, help="Outline the masks of this submission as well.")
@click.option("--size", type=int, default=720, show_default=True, help="Longer side of the picture, pixels.")
@click.option(
    "--overlay",
    type=click.Choice(["outline", "tint", "none"]),
    default="tint",
    show_default=True,
    help="How the sounding object is marked; a tint has its outline too.",
)
@click.option("--map", "with_map", is_flag=True, help="Draw path, heading and source from above in a corner.")
def video(
    key: str,
    root: Path,
    path: Path,
    submission: Path | None,
    size: int,
    overlay: Literal["outline", "tint", "none"],
    with_map: bool,
) -> None:
    """Write the observation KEY (part_1/<scan>/<room>/<index>) as an MP4 with its binaural sound: use headphones.

    A frame lasts a second, while its clip is heard. Needs PyAV: pip install 'avs3d-bench[inspect]'.
    """
    from rich.console import Console
    from rich.progress import Progress

    from avs3d_bench.dataset import Dataset
    from avs3d_bench.inspector.video import describe_film, write_video

    dataset = Dataset(root)
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("frames", total=len(dataset[key]))
        film = write_video(
            dataset,
            key,
            path,
            size=size,
            overlay=overlay,
            submission=submission,
            with_map=with_map,
            advance=lambda done: progress.update(task, completed=done),
        )
    click.echo(describe_film(film))


@click.command(
    "view-3d",
    context_settings=HELP,
    short_help="Show an observation in 3D in the browser, or save it as one HTML file.",
)
@click.argument("key")
@dataset_option
@click.option(
    "--submission",
    "submissions",
    type=PATH,
    multiple=True,
    help="Show the predicted points of this submission; may be given several times.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True, help="0: any free one.")
@click.option(
    "--save",
    "path",
    type=OutputFile(_SCENE),
    help="Write FILE.html, which any browser opens without a network (or FILE.viser), and serve nothing.",
)
def view_3d(key: str, root: Path, submissions: tuple[Path, ...], port: int, path: Path | None) -> None:
    """Show the room, the path, the sounding object and predicted points of the observation KEY.

    Served on the loopback address until Ctrl-C. Exit status: 0 shown, 1 something could not be read, 2 usage, a port
    that is taken included. Needs viser: pip install 'avs3d-bench[inspect]'.
    """
    from rich.console import Console

    from avs3d_bench.dataset import Dataset

    terminal = Console(stderr=True)
    with terminal.status("loading the viewer …") as status:
        from avs3d_bench.inspector.view3d import save_view, serve_view

        dataset = Dataset(root)
        if path is not None:
            saved = save_view(dataset, key, path, submissions, tell=lambda what: status.update(f"{what} …"))
    if path is not None:
        click.echo(str(saved))
        return
    try:
        serve_view(dataset, key, submissions, port=port, ready=lambda url: click.echo(f"{url}  (Ctrl-C ends)"))
    except KeyboardInterrupt:
        click.echo("", err=True)


@click.command("contact-sheet", context_settings=HELP)
@click.argument("root", type=PATH)
@click.option("-o", "--output", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="Folder for one PNG each.")
@only_option
@click.option("--frames", "columns", type=click.IntRange(2, 24), default=8, show_default=True, help="Frames shown.")
def contact_sheet(root: Path, output: Path, only: tuple[str, ...], columns: int) -> None:
    """Draw every observation of the dataset ROOT: frames with their masks, a map of path, source and heading, sound."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("contact sheets", total=None)
        from avs3d_bench.inspector.contact_sheet import draw_contact_sheets

        drawn = draw_contact_sheets(
            root,
            output,
            only=only,
            columns=columns,
            advance=lambda done, total: progress.update(task, completed=done, total=total),
        )
    if not drawn:
        raise UsageError(f"{root}: no observation to draw" + (f" matches {', '.join(only)}" if only else ""))
    for path in drawn:
        click.echo(path)
