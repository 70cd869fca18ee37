"""Acoustic twins: coarse copies of a mesh without the details that are too small to matter for sound."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from generators.assets.shapes import ACOUSTIC_DETAIL, BOX_FACES
from generators.core.arrays import distinct_rows

Array = NDArray[np.float64]
Labels = tuple[str, ...]

#: A mesh with more parts than this gets a single box: hundreds of boxes cost time and are no more accurate.
MAX_BOXES = 64
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)


def box_faces(low: Array, high: Array) -> Array:
    """(12, 3, 3) triangles of an axis-aligned box, counter-clockwise from outside."""
    return np.asarray((low + _CORNERS * (high - low))[BOX_FACES])


def weld(triangles: Array, grid: float = 1e-5) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 3) and faces (F, 3) of a triangle soup; corners within ``grid`` metres are one vertex."""
    keys = np.round(triangles.reshape(-1, 3) / grid).astype(np.int64)
    first, inverse = distinct_rows(keys)
    return triangles.reshape(-1, 3)[first], inverse.reshape(-1, 3)


def component_boxes(triangles: Array, labels: NDArray[np.str_]) -> tuple[Array, Labels]:
    """A bounding box per connected part of at least 10 cm, with the label of most of the part's area.

    Args:
        triangles: (F, 3, 3), metres.
        labels: (F,) acoustic labels.

    Returns:
        (A, 3, 3) triangles and one label each. If all parts are small, or there are too many, one box around all.
    """
    _, faces = weld(triangles)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    count = int(faces.max()) + 1
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    owner = part[faces[:, 0]]
    order = np.argsort(owner, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)
    large = [g for g in groups if np.ptp(triangles[g].reshape(-1, 3), axis=0).max() >= ACOUSTIC_DETAIL]
    if not large or len(large) > MAX_BOXES:
        large = [np.arange(len(triangles))]
    out, names = [], []
    for group in large:
        corners = triangles[group].reshape(-1, 3)
        out.append(box_faces(corners.min(axis=0), corners.max(axis=0)))
        kinds, index = np.unique(labels[group], return_inverse=True)
        names += [str(kinds[np.argmax(np.bincount(index, weights=area[group]))])] * 12
    return np.concatenate(out), tuple(names)


def clustered(triangles: Array, labels: NDArray[np.str_], max_faces: int) -> tuple[Array, Labels]:
    """The surface itself with at most ``max_faces`` faces, by vertex clustering (Rossignac & Borrel 1993).

    Vertices in one cell of a grid become their mean, faces that collapse are dropped; the grid starts at 5 cm and is
    widened until few enough faces remain. A mesh that has few enough faces already is returned unchanged.
    """
    if len(triangles) <= max_faces:
        return triangles, tuple(str(x) for x in labels)
    vertices, faces = weld(triangles)
    origin = vertices.min(axis=0)
    cell = 0.05
    while True:
        keys = np.floor((vertices - origin) / cell).astype(np.int64)
        inverse = distinct_rows(keys)[1]
        counts = np.bincount(inverse)
        means = np.stack([np.bincount(inverse, weights=vertices[:, k]) / counts for k in range(3)], axis=1)
        moved = inverse[faces]
        alive = (moved[:, 0] != moved[:, 1]) & (moved[:, 1] != moved[:, 2]) & (moved[:, 0] != moved[:, 2])
        first = distinct_rows(np.sort(moved[alive], axis=1))[0]
        keep = np.flatnonzero(alive)[np.sort(first)]
        if len(keep) <= max_faces:
            return means[moved[keep]], tuple(str(x) for x in labels[keep])
        cell *= 1.25
