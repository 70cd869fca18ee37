"""Annotations of a scan, whatever data set it comes from: which surface is which object, in which region.

Coordinates are those of the scan after its axes were turned: metres, Y up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from generators.core.scene import F32, I32

Array = NDArray[np.float64]

#: An unannotated point this near to an annotated one belongs to the same object, metres.
NEAR = 0.25
#: Oriented boxes hold what lies this far outside them, metres.
BOX_MARGIN = 0.08


@dataclass(frozen=True, eq=False)
class AnnotatedObject:
    """One object (a wall and a floor are objects, too).

    Attributes:
        category: the annotators' word, lower case (``kitchen cabinet``).
        region: index of its region, or −1.
        group: coarse category where the data set has one (Matterport3D: mpcat40), else "".
        centre: (3,) of its oriented box.
        axes: (3, 3) unit axes of the box, one a row.
        radii: (3,) half sizes along them; not finite where the object has no geometry.
    """

    category: str
    region: int
    group: str = ""
    centre: Array = field(default_factory=lambda: np.full(3, np.nan))
    axes: Array = field(default_factory=lambda: np.eye(3))
    radii: Array = field(default_factory=lambda: np.full(3, np.nan))

    @property
    def words(self) -> frozenset[str]:
        """All that it is called."""
        return frozenset(word for word in (self.category, self.group) if word)

    @property
    def placed(self) -> bool:
        """Whether it is known where it is."""
        return bool(np.isfinite(self.centre).all() and np.isfinite(self.radii).all())

    @property
    def bounds(self) -> Array:
        """(2, 3) of its box along the world's axes."""
        reach = np.abs(self.axes).T @ self.radii
        return np.stack([self.centre - reach, self.centre + reach])

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """(N,) whether points (N, 3) lie in its box, or just outside."""
        along = np.abs((points - self.centre) @ self.axes.T)
        return np.asarray((along <= self.radii + BOX_MARGIN).all(axis=1))

    def turned(self, rotation: Array) -> AnnotatedObject:
        """The same after p → rotation · p."""
        return replace(self, centre=rotation @ self.centre, axes=self.axes @ rotation.T)


@dataclass(frozen=True, eq=False)
class Region:
    """A room-like part of a scan: ``label`` as the data set has it ("" = none), ``box`` (2, 3) of its inside."""

    index: int
    label: str
    box: Array


@dataclass(frozen=True, eq=False)
class Annotations:
    """Objects, regions, and points of the surface with the object that each belongs to.

    Attributes:
        source: the file that names them, for messages.
        objects: all objects.
        regions: all regions.
        points: (P, 3) float32 on annotated surfaces; none where the data set gives boxes alone.
        owner: (P,) int32 index into ``objects``.
    """

    source: Path
    objects: tuple[AnnotatedObject, ...]
    regions: tuple[Region, ...]
    points: F32 = field(default_factory=lambda: np.zeros((0, 3), dtype=np.float32))
    owner: I32 = field(default_factory=lambda: np.zeros(0, dtype=np.int32))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def owners(self, points: Array) -> I32:
        """(N,) the object that each of (N, 3) points belongs to, −1 where none is near.

        The nearest annotated point decides; where there are none, the smallest box around the point.
        """
        out = np.full(len(points), -1, dtype=np.int32)
        if not len(points):
            return out
        if len(self.points):
            found = self._tree.query(points, distance_upper_bound=NEAR)
            near = np.isfinite(found[0])
            out[near] = self.owner[np.asarray(found[1])[near]]
            return out
        placed = [number for number, item in enumerate(self.objects) if item.placed]
        volume = [float(np.prod(2 * self.objects[number].radii + 2 * BOX_MARGIN)) for number in placed]
        for k in np.argsort(volume, kind="stable")[::-1]:
            out[self.objects[placed[k]].holds(points)] = placed[k]
        return out

    def in_region(self, region: int) -> list[AnnotatedObject]:
        """The objects of a region."""
        return [item for item in self.objects if item.region == region]


def spread_over(triangles: Array, spacing: float, most: int) -> tuple[Array, NDArray[np.int64], Array]:
    """Points on triangles, about ``spacing`` metres apart, at least one and at most ``most`` on each.

    Returns:
        weights (P, 3) of the corners, face (P,), and points (P, 3).
    """
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    side = np.clip(np.ceil(np.sqrt(area) / spacing), 1, int(np.sqrt(most))).astype(np.int64)
    weights, faces = [], []
    for n in np.unique(side):
        own = np.flatnonzero(side == n)
        grid = _lattice(int(n))
        weights.append(np.tile(grid, (len(own), 1)))
        faces.append(np.repeat(own, len(grid)))
    if not faces:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    weight, face = np.concatenate(weights), np.concatenate(faces)
    return weight, face, np.einsum("pk,pkc->pc", weight, triangles[face])


def _lattice(n: int) -> Array:
    """Corner weights (n², 3) of the centres of the n² triangles that a triangle is cut into."""
    out = [((3 * i + 1) / (3 * n), (3 * j + 1) / (3 * n)) for i in range(n) for j in range(n - i)]
    out += [((3 * i + 2) / (3 * n), (3 * j + 2) / (3 * n)) for i in range(n - 1) for j in range(n - 1 - i)]
    ab = np.array(out)
    return np.column_stack([1 - ab.sum(axis=1), ab])


def boxed(category: str, region: int, points: Sequence[Array] | Array) -> AnnotatedObject:
    """An object with the upright box around its points, the outermost half per cent left out (stray texels)."""
    cloud = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if not len(cloud):
        return AnnotatedObject(category, region)
    low, high = np.percentile(cloud, [0.5, 99.5], axis=0)
    return AnnotatedObject(category, region, centre=(low + high) / 2, radii=(high - low) / 2)
