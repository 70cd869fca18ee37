"""The scene as sound meets it: one welded mesh, grouped by material, and the statistics of a room."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.measures.decay import SPEED_OF_SOUND as SPEED_OF_SOUND
from generators.acoustics.materials import material_for, mean_absorption, triangle_areas
from generators.core.scene import Part, Room, Scene

#: Corners nearer than this are one vertex.
_WELD = 1e-4
#: Farthest coordinate of a mesh (m): beyond, its single-precision positions are coarser than 1 mm.
FARTHEST = 10_000.0
#: A source this near to a placed object's bounds belongs to that object.
_OWN_BODY = 0.03
#: A position may lie this far outside the scene's faces (a door step, a coarse twin).
_MARGIN = 0.5


@dataclass(frozen=True, eq=False)
class AcousticMesh:
    """Welded triangles.

    Attributes:
        vertices: (V, 3) float64, metres.
        groups: material label → (F, 3) int64 vertex indices; sorted by label.
        absorption_scale: factor of every material's Eyring exponent (`AcousticMaterial.scaled`).
    """

    vertices: NDArray[np.float64]
    groups: dict[str, NDArray[np.int64]]
    absorption_scale: float = 1.0

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """(2, 3) lowest and highest corner; None for a free field."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]) if len(self.vertices) else None

    @property
    def triangles(self) -> NDArray[np.float64]:
        """(A, 3, 3) corners in the order of `labels`."""
        faces = [self.vertices[index] for index in self.groups.values()]
        return np.concatenate(faces) if faces else np.zeros((0, 3, 3))

    @property
    def labels(self) -> tuple[str, ...]:
        """(A,) one label per triangle."""
        return tuple(label for label, faces in self.groups.items() for _ in range(len(faces)))


def _is_own_body(part: Part, source: NDArray[np.float64]) -> bool:
    if part.instance_id == 0:
        return False
    low, high = part.mesh.bounds
    return bool(np.all(low - _OWN_BODY <= source) and np.all(source <= high + _OWN_BODY))


#: Range of `AcousticMesh.absorption_scale`.
LEAST_SCALE, MOST_SCALE = 0.05, 20.0


def checked_scale(scale: float) -> float:
    """``scale`` if it is an absorption scale that rooms can have.

    Raises:
        Avs3dError: if it is out of range or no number.
    """
    if not LEAST_SCALE <= scale <= MOST_SCALE:
        raise Avs3dError(f"acoustics: absorption_scale is {scale}, expected {LEAST_SCALE:g} to {MOST_SCALE:g}")
    return float(scale)


def acoustic_mesh(scene: Scene, source: tuple[float, float, float], *, absorption_scale: float = 1.0) -> AcousticMesh:
    """All acoustic faces of ``scene``, welded and grouped, without the body of the sounding object.

    An appliance radiates with its whole body, which a point source stands for; its own box, closed round that point,
    would wall it in. So the placed instance (``instance_id`` > 0) whose bounds hold the source is left out.

    Raises:
        Avs3dError: if a coordinate is not finite or beyond `FARTHEST`, or labels and faces do not fit together.
    """
    point = np.asarray(source, dtype=np.float64)
    triangles: list[NDArray[np.float64]] = []
    labels: list[str] = []
    for part in scene.parts:
        corners = np.asarray(part.mesh.acoustic_positions, dtype=np.float64)
        if not np.isfinite(corners).all():
            raise Avs3dError(
                f"{scene.name}: part {part.name!r} has acoustic vertices that are NaN or infinite; repair it"
            )
        farthest = float(np.abs(corners).max(initial=0.0))
        if farthest > FARTHEST:
            raise Avs3dError(
                f"{scene.name}: part {part.name!r} has acoustic vertices {farthest:g} m from the origin, expected at "
                f"most {FARTHEST:g} m; check its unit and its origin"
            )
        if len(corners) != len(part.mesh.acoustic_labels):
            raise Avs3dError(
                f"{scene.name}: part {part.name!r} has {len(corners)} acoustic faces and "
                f"{len(part.mesh.acoustic_labels)} labels; expected one label per face"
            )
        if len(corners) and not _is_own_body(part, point):
            triangles.append(corners)
            labels.extend(material_for(label).label for label in part.mesh.acoustic_labels)
    if not triangles:
        return AcousticMesh(np.zeros((0, 3)), {}, absorption_scale)
    corners = np.concatenate(triangles)
    _, first, index = np.unique(
        np.round(corners.reshape(-1, 3) / _WELD).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    vertices = corners.reshape(-1, 3)[first]
    faces = index.reshape(-1, 3).astype(np.int64)
    keep = triangle_areas(vertices[faces]) > 1e-8
    tags = np.array(labels)
    groups = {label: faces[keep & (tags == label)] for label in sorted(set(labels))}
    return AcousticMesh(vertices, {label: group for label, group in groups.items() if len(group)}, absorption_scale)


def faces_of_room(mesh: AcousticMesh, room: Room, margin: float = 0.15) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Triangles (A, 3, 3) and labels (A,) whose centre lies in the room's box, ``margin`` metres of wall included."""
    triangles, labels = mesh.triangles, mesh.labels
    centre = triangles.mean(axis=1)
    inside = np.all((centre >= np.array(room.low) - margin) & (centre <= np.array(room.high) + margin), axis=1)
    return triangles[inside], tuple(label for label, keep in zip(labels, inside, strict=True) if keep)


def reflections_to_decay(mesh: AcousticMesh, room: Room, decay_db: float, limit: int) -> int:
    """Reflections after which the sound of ``room`` has fallen by ``decay_db``.

    A ray loses 10·lg(1 − ᾱ) dB at each reflection on average (Eyring's assumption), whatever the room's size; the
    octave with the lowest mean absorption counts.
    """
    alpha = mean_absorption(*faces_of_room(mesh, room), mesh.absorption_scale)
    loss = -10.0 * math.log10(1.0 - min(max(float(alpha.min()), 1e-3), 0.999))
    return int(min(max(math.ceil(decay_db / loss), 10), limit))


def crossed(triangles: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(A,) share of the way from ``a`` to ``b`` (3,) at which each triangle of (A, 3, 3) cuts it; infinite: it doesn't.

    The ends do not count. Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", J. Graphics Tools 2
    (1997) 21–28.
    """
    ray = b - a
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(ray, edge2)
    determinant = np.einsum("ij,ij->i", edge1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        s = a - triangles[:, 0]
        u = np.einsum("ij,ij->i", s, p) * inverse
        q = np.cross(s, edge1)
        v = q @ ray * inverse
        t = np.einsum("ij,ij->i", edge2, q) * inverse
        end = 1e-3 / max(float(np.linalg.norm(ray)), 1e-9)
        hit = (np.abs(determinant) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > end) & (t < 1 - end)
    return np.where(hit, t, np.inf)


def blocked(triangles: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether a triangle of (A, 3, 3) cuts the segment from ``a`` to ``b`` (3,), its ends excepted."""
    return bool(len(triangles)) and bool(np.isfinite(crossed(triangles, a, b)).any())


def checked_position(
    scene: str, what: str, position: tuple[float, float, float], bounds: NDArray[np.float64] | None
) -> list[float]:
    """``position`` as three floats, if it is finite and inside ``bounds`` (2, 3) with half a metre of margin.

    Raises:
        Avs3dError: naming the scene, the object, its position and the scene's extent.
    """
    numbers = [float(c) for c in position]
    if len(numbers) != 3 or not all(math.isfinite(c) for c in numbers):
        raise Avs3dError(f"{scene}: {what} position {tuple(numbers)} is not finite; expected (x, y, z) in metres")
    if bounds is not None:
        low, high = bounds[0] - _MARGIN, bounds[1] + _MARGIN
        if not (np.all(low <= numbers) and np.all(numbers <= high)):
            raise Avs3dError(
                f"{scene}: {what} position {tuple(round(c, 3) for c in numbers)} lies outside the scene, "
                f"which spans {np.round(bounds[0], 2).tolist()} to {np.round(bounds[1], 2).tolist()}"
            )
    return numbers
