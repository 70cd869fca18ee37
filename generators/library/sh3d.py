"""Objects of the Sweet Home 3D furniture libraries as entries of the lock file; `sh3f` reads the libraries."""

from __future__ import annotations

import os
import re
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from generators.library.download import Delivered
from generators.library.lock import AssetEntry, slug
from generators.library.session import Offer, Session, Stance, keep
from generators.library.sh3f import DEBIAN_FOLDER, Library, Piece, deliver, libraries, read_library

PAGE = "https://www.sweethome3d.com/freeModels.jsp"
#: Patterns in the names of pieces that determine a category; for all others the user must name it.
_NAMES = {
    "washing_machine": r"(clothes )?washing machine",
    "toilet": r"toilets?( unit)?",
    "vacuum_cleaner": r"vacuum cleaner",
    "microwave": r"microwave( oven)?",
    "coffee_machine": r"(coffee|espresso) (machine|maker|brewer)",
    "clock": r"(\w+ )?clock",
    "telephone": r"(wireless |mobile |tele)?phone|telephone",
    "oven": r"(small )?oven",
}


def library_folder() -> Path:
    """``$AVS3D_SH3F``, else the folder of Debian's package sweethome3d-furniture."""
    return Path(os.environ.get("AVS3D_SH3F") or DEBIAN_FOLDER)


def open_libraries(path: Path) -> tuple[Library, ...]:
    """The library at ``path``, or all those in a folder.

    Raises:
        Avs3dError: if there is none, or one is broken.
    """
    found = libraries(path) if path.is_dir() else (path,)
    if not found:
        raise UsageError(f"{path}: no *.sh3f there; expected a Sweet Home 3D furniture library or a folder of them")
    return tuple(read_library(file) for file in found)


def guess(piece: Piece) -> str | None:
    """The category according to a piece's name."""
    return next((kind for kind, names in _NAMES.items() if re.fullmatch(names, piece.name.strip().lower())), None)


def choose(
    table: tuple[Library, ...], names: tuple[str, ...], category: str | None
) -> tuple[tuple[Library, Piece, str], ...]:
    """Pieces by id (``phone``, ``Scopia#phone``), or without ids all whose name determines their category.

    Raises:
        UsageError: if an id is in no library or in several, or its category is neither given nor found in its name.
    """
    pairs = [(library, piece) for library in table for piece in library.pieces]
    chosen = []
    for name in names:
        found = [pair for pair in pairs if name in (pair[1].id, pair[1].id.partition("#")[2], asset_id(*pair))]
        if len(found) != 1:
            where = ", ".join(asset_id(*pair) for pair in found) or f"none of {len(pairs)} models"
            raise UsageError(f"{name!r}: found {where}; expected one model's id")
        kind = category or guess(found[0][1])
        if kind is None:
            raise UsageError(
                f"{name!r} ({found[0][1].name}): its name does not determine a category; name it with --category"
            )
        chosen.append((*found[0], kind))
    if not names:
        told = [(*pair, kind) for pair in pairs if (kind := guess(pair[1])) is not None]
        chosen = [item for item in told if category in (None, item[2])]
        if not chosen:
            raise UsageError(f"no model has a name of a {category or 'sounding object'}; name one with --id")
    return tuple(chosen)


def asset_id(library: Library, piece: Piece) -> str:
    """``sh3d/scopia/phone``."""
    return f"sh3d/{slug(library.path.stem.lower())}/{slug(piece.id.partition('#')[2] or piece.id)}"


def take_piece(
    library: Library, piece: Piece, category: str, session: Session, stance: Stance | None = None
) -> AssetEntry:
    """Copy a model with its materials and textures into the store.

    Args:
        library: the library that contains it.
        piece: the model.
        category: its category.
        session: options of this call of `avs3d assets`.
        stance: orientation, height and mount; default: those in the catalogue.

    Raises:
        Avs3dError: for a licence that forbids the use, or a mesh that cannot be used.
    """
    if stance is None:
        up, front, yaw = piece.axes
        # In the catalogue an object that hangs has an elevation; a clock without one is an alarm clock.
        mount = "surface" if category == "clock" and piece.elevation == 0 else None
        stance = Stance(up, front, round(piece.size[1], 4), mount, yaw or None)
    offer = Offer(
        id=asset_id(library, piece), kind="object", category=category, source="sh3d", ref=piece.id,
        url=piece.url or PAGE, title=piece.name, author=piece.author, licence=piece.licence or "unknown",
        file="model.zip",
    )  # fmt: skip
    return keep(offer, session, deliver(library.path, piece), stance)


def fetch_pinned(entry: AssetEntry, target: Path) -> Delivered:
    """Extract the pinned model from the installed library to ``target``.

    Raises:
        Avs3dError: if the library is not installed or holds another version of the model.
    """
    stem = entry.id.split("/")[1]
    folder = library_folder()
    path = next((file for file in libraries(folder) if slug(file.stem.lower()) == stem), None)
    if path is None:
        raise Avs3dError(
            f"{entry.id}: no library {stem!r} in {folder}; apt install sweethome3d-furniture, or name the folder with "
            "its .sh3f files in AVS3D_SH3F"
        )
    data = deliver(path, read_library(path).find(entry.ref))
    found = files.sha256_bytes(data)
    if found != entry.sha256:
        raise Avs3dError(
            f"{entry.id}: {path} holds another version of it (sha256 {found[:12]}…, the lock file says "
            f"{entry.sha256[:12]}…); pin that one with: avs3d assets import sh3f {path} --id {entry.ref!r}"
        )
    files.write_bytes(target, data)
    return Delivered(found, len(data))
