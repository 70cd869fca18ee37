"""One product, procedural or from a file, in the model frame.

Model frame: metres, Y up, front towards +Z. ``floor`` and ``surface`` models have their origin at the centre of their
footprint on the bottom (y = 0 is the support); ``wall`` models at the centre of the back face (z = 0 is the wall);
``wall_or_surface`` models at the middle of the lower edge of the back face, so that either contact is at 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from generators.assets.objects.design import Design, Mount, Point
from generators.core.scene import Licence, Mesh


@dataclass(frozen=True, eq=False)
class Model:
    """One product, in the model frame; the identical instances of an observation share one.

    Attributes:
        name: ``category/variant``, or the file it was loaded from.
        category: see `avs3d_bench.contract.taxonomy`.
        mesh: metres, Y up, front towards +Z.
        mount: kind of surface on which it stands or hangs.
        licence: licence of the mesh and its textures.
        source_point: position of the sound source in the model frame, on its surface or a little in front of it.

    Examples:
        >>> from generators import objects
        >>> microwave = objects.build("microwave", seed=3)
        >>> microwave.name, microwave.mount, microwave.mesh.positions.shape[1:]
        ('microwave/black', 'surface', (3, 3))
        >>> [round(side, 2) for side in microwave.size]  # width, height, depth (m)
        [0.5, 0.29, 0.4]
        >>> [round(c, 3) for c in microwave.source_point]  # on its front, which faces +Z
        [-0.06, 0.145, 0.212]
    """

    name: str
    category: str
    mesh: Mesh
    mount: Mount
    licence: Licence = field(default_factory=Licence)
    source_point: Point = (0.0, 0.0, 0.0)

    @property
    def size(self) -> tuple[float, float, float]:
        """Width (x), height (y) and depth (z) of the bounding box, metres."""
        x, y, z = (float(v) for v in np.diff(self.mesh.bounds, axis=0)[0])
        return x, y, z


def framed(design: Design) -> Design:
    """``design`` moved into the model frame of its mount (see the module)."""
    low, high = design.mesh.bounds.astype(np.float64)
    middle = (low + high) / 2
    anchor = {
        "floor": (middle[0], low[1], middle[2]),
        "surface": (middle[0], low[1], middle[2]),
        "wall": (middle[0], middle[1], low[2]),
        "wall_or_surface": (middle[0], low[1], low[2]),
    }[design.mount]
    shift = -np.asarray(anchor, dtype=np.float64)
    x, y, z = (float(v) for v in np.asarray(design.source_point) + shift)
    return Design(design.mesh.transformed(np.eye(3), shift), design.mount, (x, y, z))
