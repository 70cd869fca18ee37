"""`avs3d release` and `avs3d get`: a dataset as files to be hosted, and back."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from avs3d_bench.commands.click_options import HELP, PATH, WORKERS
from avs3d_bench.commands.outputs import OUTPUT_FOLDER
from avs3d_bench.exports.release.record import ARCHIVE_MB, RELEASE_JSON


@click.command(context_settings=HELP)
@click.argument("root", type=PATH)
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="The folder.")
@click.option(
    "--archive-size", "archive_mb", type=float, default=ARCHIVE_MB, show_default=True, metavar="MB",
    help="Most size of an archive (10⁶ bytes).",
)  # fmt: skip
@click.option("--doi", default=None, help="Its DOI, e.g. 10.5281/zenodo.1234567 [a placeholder].")
@click.option("--url", default=None, help="Address of the folder that will hold the files, for the README.")
@click.option("--home", default=None, metavar="URL", help="The dataset's page, for Croissant.")
@click.option("--date", "published", default=None, metavar="YYYY-MM-DD", help="When it is published, for Croissant.")
@click.option("--workers", type=WORKERS, default=None, help="Processes [one per core].")
def release(root: Path, folder: Path, workers: int | None, **options: Any) -> None:
    """Cut the dataset at ROOT into archives for a host of data, with checksums, card, licences and Croissant.

    Of a sealed test, ROOT is its public side. The same dataset gives the same archives, byte for byte. docs/release.md
    says how to host them.
    """
    from avs3d_bench.exports.release.write import ReleaseSettings, write_release
    from avs3d_bench.formats.files import sha256_file

    settings = ReleaseSettings(**options)
    written = write_release(root, folder, settings, workers=workers, progress=sys.stderr.isatty())
    for archive in written.archives:
        click.echo(f"{archive.file}: {archive.files:,} files, {archive.bytes / 1e6:,.1f} MB")
    click.echo(f"{written.observations} observations, {written.bytes / 1e6:,.1f} MB")
    click.echo(f"sha256 of {RELEASE_JSON}, for avs3d get --sha256: {sha256_file(folder / RELEASE_JSON)}")
    click.echo(str(folder))


@click.command(context_settings=HELP)
@click.argument("name")
@click.option("--from", "url", default=None, metavar="URL", help="Address of the release's folder, or a folder.")
@click.option("--sha256", default=None, metavar="HEX", help="Of its release.json, as its publisher says.")
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", help="The dataset's folder [data/NAME].")
def get(name: str, url: str | None, sha256: str | None, folder: Path | None) -> None:
    """Download the released dataset NAME, check it and unpack it into a new folder.

    Every archive is compared with its sha256. The same command continues an interrupted download.
    """
    from avs3d_bench.exports.release.get import find_release, get_release

    hosted = find_release(name, url, sha256)
    target = folder if folder is not None else Path("data") / name
    release = get_release(name, hosted, target, progress=sys.stderr.isatty())
    click.echo(
        f"{release.dataset} {release.version}: {release.observations} observations, {release.unpacked / 1e6:,.1f} MB"
    )
    click.echo(f"licence: {release.licence}")
    click.echo(str(target))
