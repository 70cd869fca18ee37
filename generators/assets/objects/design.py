"""What a category's module hands to the catalogue: a mesh, how it is mounted and where it sounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from numpy.random import Generator

from generators.core.scene import Mesh

Mount = Literal["floor", "surface", "wall", "wall_or_surface"]
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Design:
    """A model as drawn: Y up, front towards +Z, metres; the catalogue moves it into the model frame.

    Attributes:
        mesh: the object.
        mount: what it stands on or hangs from.
        source_point: where the sound leaves it, on or a little in front of its surface.
    """

    mesh: Mesh
    mount: Mount
    source_point: Point


#: Builds one variant; the generator chooses what may differ between two copies of the same product (a colour, a time).
Build = Callable[[Generator], Design]
