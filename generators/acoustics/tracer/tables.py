"""The arrays that the kernels read and write, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]


class MeshTables(NamedTuple):
    """Triangles in the order of the tree's leaves.

    Attributes:
        bounds: (N, 6) boxes of the tree (`Bvh.bounds`).
        links: (N, 2) int32 (`Bvh.links`).
        corners: (T, 9) first corner and the edges to the two others.
        normals: (T, 3) unit normals, of either side.
        material: (T,) int32.
        plane: (T,) int32, the mirror plane that the triangle lies in, or −1.
        reflection: (M, 8) 1 − α per material and octave.
        scattering: (M, 8) scattering coefficient.
        mean_scattering: (M,) its mean over the octaves.
    """

    bounds: F64
    links: I32
    corners: F64
    normals: F64
    material: I32
    plane: I32
    reflection: F64
    scattering: F64
    mean_scattering: F64


class Rims(NamedTuple):
    """The outlines of the mirror planes.

    Attributes:
        first: (P + 1,) int32, where the outline of each plane begins in what follows.
        ends: (E, 6) both ends of an edge, m; counterclockwise about the plane's normal.
        ends_surface: (E, 3) bool, whether the surface ends there, seen from the normal's side, from the other side,
            and from any of them; it does not where it meets another one in a corner.
        normal: (P, 3) unit normals of the planes.
        bounds: (P, 6) lowest and highest corner of each plane's triangles, m.
        is_open: (P,) bool, whether an edge ends the plane.
        open_planes: int32, the numbers of those.
    """

    first: I32
    ends: F64
    ends_surface: NDArray[np.bool_]
    normal: F64
    bounds: F64
    is_open: NDArray[np.bool_]
    open_planes: I32


class TraceLimits(NamedTuple):
    """Where a ray ends, and how it is reflected.

    Attributes:
        depth: most reflections of a ray.
        range: most metres that a ray travels.
        floor: share of what it had at first, in its loudest octave, at which a ray ends.
        exact: number of reflections whose scattering is right in each octave; later ones use the mean over the octaves.
        rain: number of the first reflections whose scattered sound is detected by diffuse rain, not by this trace.
        planes: number of mirror planes, for the keys of sequences.
        early: most reflections of an image source.
    """

    depth: int
    range: float
    floor: float
    exact: int
    rain: int
    planes: int
    early: int


class Listeners(NamedTuple):
    """Discs that face every ray, one about each listener.

    Attributes:
        x: (L,) metres.
        y: (L,) metres.
        z: (L,) metres.
        radius2: (L,) squared radius of the disc.
        bounds: (6,) lowest and highest corner of all discs.
    """

    x: F64
    y: F64
    z: F64
    radius2: F64
    bounds: F64


class Records(NamedTuple):
    """Detected rays, in the order of (ray, reflections, listener).

    Attributes:
        listener: (C,) int32.
        path: (C,) float64 metres from the source.
        direction: (C, 3) float32 towards where the sound comes from.
        pressure: (C, 8) float32 signed amplitude.
    """

    listener: I32
    path: F64
    direction: F32
    pressure: F32
