"""`avs3d view`: look at a dataset and listen to it."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from avs3d_bench.commands.click_options import HELP, PATH, WORKERS, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER

if TYPE_CHECKING:
    from avs3d_bench.dataset import Dataset
    from avs3d_bench.inspector.submissions import ShownSubmission

#: Time that requests in progress get after Ctrl-C or SIGTERM (s).
GRACE_SECONDS = 0.7


@click.command(context_settings=HELP, short_help="Look at a dataset and listen to it.")
@click.argument("root", type=PATH)
@click.option(
    "-o",
    "--output",
    "folder",
    type=OUTPUT_FOLDER,
    metavar="DIR",
    help="Write a static site into this folder instead of serving.",
)
@click.option("--submission", "submissions", type=PATH, multiple=True, help="Show its masks with the truth; up to 9.")
@click.option("--port", type=click.IntRange(0, 65535), help="Port on 127.0.0.1 [8737, or any that is free].")
@click.option("--no-browser", is_flag=True, help="Do not open a browser.")
@only_option
@click.option("--workers", type=WORKERS, default=None, help="Processes of -o [one per core].")
def view(
    root: Path,
    folder: Path | None,
    submissions: tuple[Path, ...],
    port: int | None,
    no_browser: bool,
    only: tuple[str, ...],
    workers: int | None,
) -> None:
    """Look at the dataset at ROOT and listen to it in a browser.

    A gallery, and for each observation a player with masks, binaural sound, a map and plots. Served on this computer
    alone until Ctrl-C; with -o written to a folder that needs no server.

    Exit status: 0 shown, 1 something could not be read (each named), 2 usage.
    """
    from avs3d_bench.contract.layout import DATASET_JSON
    from avs3d_bench.dataset import Dataset
    from avs3d_bench.errors import UsageError
    from avs3d_bench.inspector.links import check_link
    from avs3d_bench.inspector.submissions import open_submissions

    dataset = Dataset(root)
    keys = [observation.key for observation in dataset.select(*only)]
    if not keys:
        what = f"no observation matches {' '.join(only)}" if only else "no observation to show"
        raise UsageError(f"{root}: {what}; expected some of {', '.join(dataset.keys[:3]) or 'part_1/…'}")
    check_link(root / DATASET_JSON, root)
    _ = dataset.record  # report a damaged dataset.json before any page is made
    shown = open_submissions(dataset, submissions)
    if folder is not None:
        if port is not None:
            raise UsageError("--port is for serving; it has no meaning with -o")
        _build(dataset, keys, shown, folder, workers)
        return
    _serve(dataset, keys, shown, port, not no_browser)


def _build(
    dataset: Dataset, keys: Sequence[str], shown: tuple[ShownSubmission, ...], folder: Path, workers: int | None
) -> None:
    from avs3d_bench.inspector.build import build_site

    built = build_site(dataset, keys, shown, folder, workers=workers, progress=sys.stderr.isatty())
    for line in built.problems:
        click.echo(line, err=True)
    click.echo(str(folder / "index.html"))
    if built.problems:
        raise SystemExit(1)


def _serve(
    dataset: Dataset, keys: Sequence[str], shown: tuple[ShownSubmission, ...], port: int | None, browse: bool
) -> None:
    import threading
    import webbrowser

    from avs3d_bench.inspector.server import ViewServer

    with ViewServer(dataset, keys, shown, port=port) as server, _signals(server.stop) as received:
        click.echo(f"{dataset.name}: {len(keys)} observations at {server.url} (Ctrl-C ends)")
        if browse:
            # A text browser, or the first start of another one, blocks its caller: the server could not answer it then.
            threading.Thread(target=webbrowser.open, args=[server.url], daemon=True).start()
        server.serve()
        status = 128 + signal.SIGTERM if signal.SIGTERM in received else 0
        if signal.SIGINT in received:
            click.echo("", err=True)
        if not server.close(GRACE_SECONDS):
            # An answer is still being made (a slow disk): leave without the interpreter's tidying up, which would wait
            # for it, and abort beneath OpenCV's C++ if it did not. There is nothing to tidy: see `live.KeptFiles`.
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            os._exit(status)
    if status:
        raise SystemExit(status)


@contextmanager
def _signals(stop: Callable[[], None]) -> Iterator[set[int]]:
    """Call ``stop`` at Ctrl-C and at SIGTERM, instead of raising from wherever the program is; yields which came."""
    received: set[int] = set()

    def note(number: int, _: object) -> None:
        received.add(number)
        stop()

    former = {}
    with suppress(ValueError):  # only the main thread may ask for signals
        for number in (signal.SIGINT, signal.SIGTERM):
            former[number] = signal.signal(number, note)
    try:
        yield received
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
