"""The catalogue of small things: one table, put together from the modules that build them."""

from __future__ import annotations

from generators.assets.clutter import bath, entry, fittings, kitchen
from generators.assets.clutter.record import ClutterKind

#: All kinds; things are placed in this order, so that what needs most space comes first within a module.
CLUTTER: tuple[ClutterKind, ...] = (*fittings.KINDS, *kitchen.KINDS, *bath.KINDS, *entry.KINDS)


def kinds_for(room: str) -> tuple[ClutterKind, ...]:
    """The kinds that a type of room has."""
    return tuple(kind for kind in CLUTTER if room in kind.rooms)
