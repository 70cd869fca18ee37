"""The command `avs3d assets import`, for assets that are already on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from avs3d_bench.commands.click_options import PATH, Group
from avs3d_bench.errors import Avs3dError, UsageError
from generators.library.cli_common import (
    CATEGORY,
    licence_option,
    lock_option,
    lock_path,
    make_session,
    stance_of,
    stance_options,
    take_each,
)

if TYPE_CHECKING:
    from generators.library.lock import AssetEntry


@click.group("import", cls=Group, noun="source")
def import_() -> None:
    """Copy assets that are on this machine into the store, and add them to the lock file."""


@import_.command()
@click.argument("path", type=PATH, metavar="FILE_OR_FOLDER")
@click.option("--id", "ids", multiple=True, metavar="ID", help="These models only (phone, Scopia#phone); repeatable.")
@click.option(
    "--category",
    type=CATEGORY,
    metavar="NAME",
    default=None,
    help="Category of the models (default: from their names).",
)
@lock_option
@licence_option
@stance_options
def sh3f(
    path: Path, ids: tuple[str, ...], category: str | None, lock: Path | None, allowed: tuple[str, ...], **options: Any
) -> None:
    """Import models of Sweet Home 3D furniture libraries (*.sh3f; on Debian in /usr/share/sweethome3d/furniture)."""
    from generators.library import sh3d
    from generators.library.lock import update_lock

    session, stance, target = make_session(allowed), stance_of(options), lock_path(lock)

    def take(item: Any) -> AssetEntry:
        library, piece, told = item
        entry = sh3d.take_piece(library, piece, told, session, stance)
        update_lock(target, (entry,))
        return entry

    take_each(sh3d.choose(sh3d.open_libraries(path), ids, category), take, target)


@import_.command()
@click.argument("path", type=PATH, metavar="FOLDER")
@click.option("--licence", default="", metavar="NAME", help="Licence of all files: an SPDX identifier or its address.")
@click.option("--author", default="", metavar="NAME", help="Author of the files.")
@click.option("--category", type=CATEGORY, metavar="NAME", default=None, help="Category of the files.")
@click.option(
    "--index",
    type=PATH,
    default=None,
    metavar="FILE",
    help="Instead of these three: a table (CSV) with file, category, licence and author of each.",
)
@click.option("--kind", type=click.Choice(["object", "sound"]), default=None, help="Only meshes, or only sounds.")
@click.option("--url", default="", metavar="ADDRESS", help="Address of their source.")
@click.option("--name", default=None, metavar="NAME", help="Name used in their ids (default: the folder's name).")
@lock_option
@licence_option
@stance_options
def folder(
    path: Path, kind: str | None, name: str | None, lock: Path | None, allowed: tuple[str, ...], **options: Any
) -> None:
    """Import every mesh (GLB, glTF, OBJ) and sound (WAV, FLAC, OGG, MP3) of a folder, or those of an index."""
    from generators.library.folder import Told, asset_ids, candidates, read_index, take_file
    from generators.library.licences import spdx
    from generators.library.lock import update_lock
    from generators.library.session import Stance

    session, stance, target = make_session(allowed), stance_of(options) or Stance(), lock_path(lock)
    index, credit = options["index"], [options[name] for name in ("category", "licence", "author")]
    if (index is None) != all(credit) or (index is not None and any(credit)):
        raise UsageError("import folder: expected either --category, --licence and --author of all files, or --index")
    found = candidates(path, kind)  # type: ignore[arg-type]  # click has checked the kind
    every = Told(credit[0] or "", spdx(credit[1]), credit[2], options["url"])
    told = {file: every for _, file in found} if index is None else read_index(index, path)
    for category in sorted({one.category for one in told.values()} if index is not None else ()):
        CATEGORY.convert(category, None, None)  # as --category
    found = tuple(item for item in found if item[1] in told)
    unknown = sorted({file.name for file in told} - {file.name for _, file in found})
    if unknown and kind is None:
        raise UsageError(f"{index}: {unknown[0]} is neither a mesh nor a sound that can be read; leave it out")
    ids = asset_ids(path, [file for _, file in found], name)

    def take(item: Any) -> AssetEntry:
        entry = take_file(path, item[1], item[0], session, asset=ids[item[1]], told=told[item[1]], stance=stance)
        update_lock(target, (entry,))
        return entry

    take_each(found, take, target)


@import_.command()
@click.argument("path", type=PATH, metavar="CLONE")
@click.option(
    "--category",
    default=None,
    metavar="NAME",
    help="A category of the benchmark, or a class of ESC-50 (clock_tick, crying_baby, …).",
)
@click.option("--limit", type=click.IntRange(1, 2000), default=2000, help="At most this many clips of each category.")
@lock_option
@licence_option
def esc50(path: Path, category: str | None, limit: int, lock: Path | None, allowed: tuple[str, ...]) -> None:
    """Import clips of ESC-50 from a clone of github.com/karolpiczak/ESC-50; most clips are CC-BY-NC-3.0."""
    from generators.library.esc50 import offers, take_clip
    from generators.library.licences import terms
    from generators.library.lock import update_lock

    session, target = make_session(allowed), lock_path(lock)
    known = {name.lower() for name in session.allowed}
    taken: list[Any] = []
    refused: dict[str, int] = {}
    for offer, file in offers(path, category):
        if terms(offer.licence).verdict == "refused" and offer.licence.lower() not in known:
            refused[offer.licence] = refused.get(offer.licence, 0) + 1
        elif sum(other.category == offer.category for other, _ in taken) < limit:
            taken.append((offer, file))
    for name, count in sorted(refused.items()):
        click.echo(
            f"{count} clips left out: {name} {terms(name).reason}; if you may use them, add --allow-licence {name}",
            err=True,
        )
    if not taken:
        raise Avs3dError(f"{path}: no clip has a licence that allows the use; see --allow-licence")

    def take(item: Any) -> AssetEntry:
        offer, file = item
        entry = take_clip(offer, file, session)
        update_lock(target, (entry,))
        return entry

    take_each(taken, take, target)
