"""The commands `avs3d assets list`, `fetch` and `verify`; `import` is in `cli_import`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from avs3d_bench.commands.click_options import PATH, Group
from avs3d_bench.commands.outputs import OUTPUT_FOLDER
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import os_error_line
from generators.library.cli_common import (
    CATEGORY,
    licence_option,
    limit_options,
    lock_option,
    lock_path,
    make_session,
    stance_of,
    stance_options,
    take_each,
    tell,
)
from generators.library.cli_import import import_

if TYPE_CHECKING:
    from generators.library.lock import AssetEntry
    from generators.library.session import Session


@click.group(cls=Group)
def assets() -> None:
    """List, fetch, import and verify objects, sounds and scans made by others.

    Every asset is pinned in a lock file (assets.lock.yaml) with source, author, licence and sha256. The files are in
    $AVS3D_ASSETS (default: the user's cache folder). Manifests name assets by id: `objects: {clock: [{asset: ID}]}`.
    """


@assets.command("list")
@lock_option
@click.option("--html", type=OUTPUT_FOLDER, default=None, metavar="DIR",
              help="Write a page with a picture of every asset.")  # fmt: skip
@click.option("--kind", type=click.Choice(["object", "sound", "scan"]), default=None, help="Only these.")
@click.option("--category", type=CATEGORY, metavar="NAME", default=None, help="Only these.")
def list_assets(lock: Path | None, html: Path | None, kind: str | None, category: str | None) -> None:
    """List the assets of the lock file, and whether their files are in the store."""
    from generators.library.lock import read_lock
    from generators.library.store import Store

    path, store = lock_path(lock), Store.default()
    if not path.is_file():
        where = (
            "name another with --lock"
            if lock is not None
            else (f"looked in {Path.cwd()}; run it beside scenes_manifest/, or name a lock file with --lock FILE")
        )
        raise UsageError(f"{path}: no such lock file; {where}")
    entries = [
        entry for entry in read_lock(path).assets if kind in (None, entry.kind) and category in (None, entry.category)
    ]
    if html is not None:
        from generators.library.listing import write_listing

        click.echo(write_listing(tuple(entries), store, html))
        return
    width = max((len(entry.id) for entry in entries), default=0)
    for entry in entries:
        there = store.path(entry)
        state = "here" if there.is_file() and there.stat().st_size == entry.bytes else "missing"
        click.echo(
            f"{entry.id:<{width}}  {entry.kind:<6}  {entry.category:<15}  {state:<7}  {entry.licence:<14}  "
            f"{entry.author}: {entry.title}"
        )
    click.echo(f"{path}: {len(entries)} assets, store {store.root}", err=True)


@assets.command()
@click.argument(
    "source", required=False, type=click.Choice(["sketchfab", "freesound", "bbc", "github"]), metavar="[SOURCE]"
)
@click.argument("refs", nargs=-1, metavar="[ID]...")
@click.option("--category", type=CATEGORY, metavar="NAME", default=None, help="Category of the new assets.")
@click.option("--format", "form", default=None, metavar="NAME", help="glb, gltf | preview, original | wav, mp3")
@click.option("--manifest", type=PATH, default=None, metavar="FILE", help="Fetch the assets that this manifest names.")
@click.option("--id", "ids", multiple=True, metavar="ID", help="Fetch only this asset of the lock file; repeatable.")
@click.option(
    "--from", "folder", type=PATH, default=None, metavar="FOLDER", help="Take pinned files that are here from here."
)
@click.option("--licence", default="", metavar="NAME", help="github: licence of the files, an SPDX identifier.")
@click.option("--author", default="", metavar="NAME", help="github: author of the files.")
@click.option("--url", default="", metavar="ADDRESS", help="github: where the files are from, if not the repository.")
@lock_option
@licence_option
@stance_options
@limit_options
def fetch(
    source: str | None,
    refs: tuple[str, ...],
    category: str | None,
    manifest: Path | None,
    ids: tuple[str, ...],
    folder: Path | None,
    lock: Path | None,
    allowed: tuple[str, ...],
    **options: Any,
) -> None:
    """Fetch the assets of the lock file that are missing from the store, or new assets by their id at SOURCE.

    \b
    avs3d assets fetch --manifest scenes_manifest/mine.yaml
    avs3d assets fetch sketchfab UID --category toilet --height 0.78
    avs3d assets fetch freesound 1234 5678 --category clock
    avs3d assets fetch github OWNER/NAME@COMMIT:PATH --category clock --licence CC0-1.0 --author NAME
    avs3d assets fetch github OWNER/NAME@COMMIT:room.glb --licence CC0-1.0 --author NAME    (a scan)

    SOURCE is sketchfab, freesound, bbc or github. Tokens are read from SKETCHFAB_TOKEN and FREESOUND_TOKEN (originals:
    FREESOUND_OAUTH_TOKEN). Exit status: 0 if all files are in the store, 1 if some are missing (each is named).
    """  # noqa: D301  # click's mark for lines that stay apart
    from generators.library.folder import Told
    from generators.library.github import is_scan
    from generators.library.licences import spdx
    from generators.library.lock import LOCK_NAME, update_lock
    from generators.library.session import Stance
    from generators.library.sources import fetch_new

    form, stance = options["form"], stance_of(options)
    session = make_session(allowed, options)
    path = lock or (manifest.parent / LOCK_NAME if manifest is not None else lock_path(None))
    credit = {name: options[name] for name in ("licence", "author", "url")}
    if source is None:
        if category or form or stance is not None or any(credit.values()):
            raise UsageError(
                "--category, --format, --licence, --author, --url and the options of an object's size and orientation "
                "are for new assets: name a SOURCE and an ID"
            )
        _fetch_pinned(path, _wanted(path, manifest, ids), session, folder)
        return
    scans = source == "github" and all(is_scan(ref) for ref in refs)
    if refs and scans and category is not None:
        raise UsageError("a scan has no category: leave --category out")
    if not refs or (category is None and not scans):
        raise UsageError(
            f"fetch {source}: expected an ID and --category, e.g. avs3d assets fetch {source} ID --category clock"
        )
    if stance is not None and source != "sketchfab":
        raise UsageError(f"{source} has sounds: --height, --up, --front, --mount and --yaw are for objects")
    if any(credit.values()) and source != "github":
        raise UsageError(f"{source} tells licence and author itself: --licence, --author and --url are for github")
    if manifest is not None or ids or folder is not None:
        raise UsageError("--manifest, --id and --from are for assets in the lock file; leave them out for new assets")
    told = Told(category or "", spdx(credit["licence"]), credit["author"], credit["url"])

    def take(ref: str) -> AssetEntry:
        assert source is not None
        entry = fetch_new(source, ref, told, stance or Stance(), session, form)
        update_lock(path, (entry,))
        return entry

    take_each(refs, take, path)


@assets.command()
@lock_option
def verify(lock: Path | None) -> None:
    """Compare every file in the store with its sha256 in the lock file; exit 1 if one is damaged or missing."""
    from generators.library.lock import read_lock
    from generators.library.store import Store

    path, store = lock_path(lock), Store.default()
    if not path.is_file():
        raise UsageError(f"{path}: no such lock file; name one with --lock")
    entries = read_lock(path).assets
    bad = [(entry, problem) for entry in entries if (problem := store.problem(entry))]
    for entry, problem in bad:
        click.echo(f"avs3d: error: {entry.id}: {problem}", err=True)
    click.echo(f"{path}: {len(entries) - len(bad)} of {len(entries)} assets are in {store.root} and undamaged")
    if bad:
        click.echo(f"run: avs3d assets fetch --lock {path}", err=True)
        raise SystemExit(1)


def _wanted(path: Path, manifest: Path | None, ids: tuple[str, ...]) -> tuple[AssetEntry, ...]:
    from generators.library.lock import read_lock
    from generators.library.store import find_entry

    if manifest is not None:
        from generators.library.references import named_assets
        from generators.manifest.reading import read_manifest

        source = read_manifest(manifest).manifest
        ids = (*named_assets(source.objects, source.sounds, source.scans.values()), *ids)
        return tuple(find_entry(path, name) for name in dict.fromkeys(ids))
    if not path.is_file():
        raise UsageError(f"{path}: no such lock file; name one with --lock, or a manifest with --manifest")
    return tuple(find_entry(path, name) for name in ids) if ids else read_lock(path).assets


def _fetch_pinned(path: Path, entries: tuple[AssetEntry, ...], session: Session, folder: Path | None) -> None:
    from generators.library.folder import nearby
    from generators.library.sources import fetch_pinned

    here = nearby(folder, entries) if folder is not None else {}
    fetched = 0
    failed: list[str] = []
    for entry in entries:
        try:
            if fetch_pinned(entry, session, here):
                fetched += 1
                click.echo(f"{entry.id}: {entry.bytes / 1e6:.2f} MB, {entry.licence}")
        except (Avs3dError, OSError) as error:
            failed.append(str(error) if isinstance(error, Avs3dError) else os_error_line(error))
            tell(f"avs3d: error: {failed[-1]}")
    click.echo(
        f"{path}: {fetched} fetched, {len(entries) - fetched - len(failed)} already in the store, {len(failed)} failed"
    )
    if failed:
        raise SystemExit(1)


assets.add_command(import_)
