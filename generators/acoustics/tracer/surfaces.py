"""The surfaces of a scene as the tracer reads them: the tree of triangles, their materials, the planes that mirror."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.geometry import AcousticMesh
from generators.acoustics.materials import material_for, triangle_areas
from generators.acoustics.tracer.edges import Edges, edges_of
from generators.acoustics.tracer.kernels import FAR, closest_hits
from generators.acoustics.tracer.rims import rims_of
from generators.acoustics.tracer.tables import MeshTables, Rims
from generators.acoustics.tracer.transmission import WallTable
from generators.core.bvh import STACK, build

F64 = NDArray[np.float64]

#: Triangles of one material whose normals and offsets agree this closely lie in one plane (1, m).
_SAME_NORMAL, _SAME_OFFSET = 1 / 256, 2e-3
#: Least area of a plane that mirrors sound (m²). A panel of area A at the distance d mirrors the frequencies above
#: about c·d/(2·A) (J. H. Rindel, Applied Acoustics 19 (1986) 7–17): 1.4 kHz for 0.25 m² at 2 m. What smaller ones and
#: curved surfaces reflect is left to the rays, whose expectation is right for them too.
LEAST_MIRROR = 0.25


@dataclass(frozen=True, eq=False)
class AcousticSurfaces:
    """The surfaces of a scene.

    Attributes:
        mesh: the tree and its triangles.
        plane_equation: (P, 4) unit normal n and offset o of the mirror planes, n·x = o.
        plane_material: (P,) int32.
        plane_area: (P,) m².
        rims: of the mirror planes.
        edges: that diffract.
        walls: transmission coefficients, if a material gives its own.
        transmits: (M,) bool, which materials do.
    """

    mesh: MeshTables
    plane_equation: F64
    plane_material: NDArray[np.int32]
    plane_area: F64
    rims: Rims
    edges: Edges
    walls: WallTable | None
    transmits: NDArray[np.bool_]

    @property
    def planes(self) -> int:
        """Number of mirror planes."""
        return len(self.plane_equation)

    def closest(self, origins: F64, directions: F64) -> tuple[F64, NDArray[np.int32]]:
        """First hits along unit vectors (R, 3).

        Returns:
            (R,) distance in m, infinite without a hit; (R,) int32 triangle in the order of the tree, −1 without a hit.
        """
        distance, triangle = np.empty(len(directions)), np.empty(len(directions), dtype=np.int32)
        closest_hits(
            self.mesh, np.ascontiguousarray(origins), np.ascontiguousarray(directions), distance, triangle, *scratch()
        )
        return np.where(distance < FAR, distance, np.inf), triangle

    def first_hits(self, origins: F64, directions: F64) -> F64:
        """(R,) distance in m from ``origins`` (R, 3) to the first surface along unit vectors; infinite without one."""
        return self.closest(origins, directions)[0]


def scratch() -> tuple[NDArray[np.int32], F64]:
    """The traversal's stacks of nodes and of distances; one pair per thread."""
    return np.empty(STACK, dtype=np.int32), np.empty(STACK)


def octaves(values: tuple[float, ...]) -> F64:
    """(8,) values for `BANDS` from six of 125 Hz to 4 kHz: the outer octaves repeat the nearest."""
    return np.array([values[0], *values, values[-1]])


def surfaces_of(mesh: AcousticMesh) -> AcousticSurfaces:
    """Prepare ``mesh`` for tracing.

    Raises:
        Avs3dError: if a coordinate is not finite.
    """
    labels = list(mesh.groups)
    known = [material_for(label).scaled(mesh.absorption_scale) for label in labels]
    material = np.repeat(np.arange(len(labels), dtype=np.int32), [len(faces) for faces in mesh.groups.values()])
    tree = build(mesh.triangles, "acoustic mesh")
    triangles, material = mesh.triangles[tree.order], material[tree.order]
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    plane, planes, equation, bounds = _mirror_planes(triangles, normals, material)
    scattering = np.array([octaves(m.scattering) for m in known]).reshape(-1, 8)
    tables = MeshTables(
        tree.bounds,
        tree.links,
        np.ascontiguousarray(np.concatenate([triangles[:, :1], edges], axis=1).reshape(-1, 9)),
        np.ascontiguousarray(normals),
        material,
        plane,
        1.0 - np.array([octaves(m.in_situ) for m in known]).reshape(-1, 8),
        scattering,
        scattering.mean(axis=1),
    )
    _, first = np.unique(plane[plane >= 0], return_index=True)
    area = np.bincount(plane[plane >= 0], triangle_areas(triangles)[plane >= 0], planes).astype(np.float64)
    return AcousticSurfaces(
        tables,
        equation,
        material[plane >= 0][first],
        area,
        rims_of(tables, equation, bounds),
        edges_of(mesh),
        WallTable.of(triangles, material, known),
        np.array([one.transmission is not None for one in known], dtype=np.bool_),
    )


def _mirror_planes(
    triangles: F64, normals: F64, material: NDArray[np.int32]
) -> tuple[NDArray[np.int32], int, F64, F64]:
    """The plane of each triangle (−1 without), the number of planes, their equations (P, 4) and bounds (P, 6)."""
    count = len(triangles)
    if not count:
        return np.zeros(0, dtype=np.int32), 0, np.zeros((0, 4)), np.zeros((0, 6))
    # Both sides of a sheet are one plane: the largest component of the normal is made positive.
    axis = np.argmax(np.abs(normals) > np.abs(normals).max(axis=1, keepdims=True) - 1e-6, axis=1)
    facing = normals * np.sign(normals[np.arange(count), axis])[:, None]
    centre = triangles.reshape(-1, 3).mean(axis=0)  # keeps the offsets small, and with them the effect of the normals
    offset = np.einsum("ij,ij->i", facing, triangles.mean(axis=1) - centre)
    area = triangle_areas(triangles)
    cell = np.column_stack([np.round(facing / _SAME_NORMAL), np.round(offset / _SAME_OFFSET), material])
    _, group = np.unique(cell.astype(np.int64), axis=0, return_inverse=True)
    group = group.reshape(-1)
    kept = np.flatnonzero(np.bincount(group, area) >= LEAST_MIRROR)
    number = np.full(group.max() + 1, -1, dtype=np.int32)
    number[kept] = np.arange(len(kept))
    plane = number[group]
    equation, bounds = np.empty((len(kept), 4)), np.empty((len(kept), 6))
    used = np.flatnonzero(plane >= 0)
    used = used[np.argsort(plane[used], kind="stable")]
    for p, members in enumerate(np.split(used, np.flatnonzero(np.diff(plane[used])) + 1) if len(used) else []):
        # Not products of BLAS, whose last bits depend on the processor.
        weight = area[members, None]
        normal = (weight * facing[members]).sum(axis=0)
        normal /= math.sqrt((normal**2).sum())
        at = (weight * triangles[members].mean(axis=1)).sum(axis=0) / weight.sum()
        equation[p] = [*normal, (normal * at).sum()]
        corners = triangles[members].reshape(-1, 3)
        bounds[p] = [*corners.min(axis=0), *corners.max(axis=0)]
    return plane, len(kept), equation, bounds
