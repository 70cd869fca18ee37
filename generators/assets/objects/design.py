"""`Design`: the mesh, mount and source point of a model, from its category's module to the catalogue."""

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
        mount: kind of surface on which it stands or hangs.
        source_point: position of the sound source, on its surface or a little in front of it.
    """

    mesh: Mesh
    mount: Mount
    source_point: Point


#: Builds one variant; the generator chooses the differences between two copies of a product (a colour, a time).
Build = Callable[[Generator], Design]
