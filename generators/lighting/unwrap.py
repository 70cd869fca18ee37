"""From a mesh to a light-map layout: charts without overlap, packed with a margin, at a given texel size."""

from __future__ import annotations

import ctypes
import os
import threading
import time
from dataclasses import dataclass

import numpy as np
import xatlas
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.core.arrays import distinct_rows
from generators.core.scene import F32, I32

#: Empty texels between charts: bilinear look-up reaches one texel beyond a chart on either side.
PADDING = 1
#: Corners are welded if their coordinates, multiplied by this (1/m), round to the same integers.
_WELD = 1e5
#: The same of their shading normals.
_NORMAL_WELD = 50.0
#: From this weight on xatlas cuts at every edge where the shading normals of the two faces differ.
_CUT_ALL = 1000.0
_TASKS = "/proc/self/task"
_NEW = threading.Lock()


def _threads() -> set[str]:
    """The ids of this process's threads; none where the system does not list them."""
    return set(os.listdir(_TASKS)) if os.path.isdir(_TASKS) else set()


def _new_atlas() -> tuple[xatlas.Atlas, set[str]]:
    """An atlas, and the ids of its worker threads; one at a time, to tell them from those of another."""
    with _NEW:
        before = _threads()
        atlas = xatlas.Atlas()
        mine = {str(thread.native_id) for thread in threading.enumerate()}
        return atlas, _threads() - before - mine


def _asleep(thread: str) -> bool:
    try:
        with open(f"{_TASKS}/{thread}/stat", encoding="ascii", errors="replace") as stat:
            return stat.read().rpartition(")")[2].split()[0] == "S"
    except OSError:
        return True  # it has ended


def _let_go(atlas: xatlas.Atlas, threads: set[str]) -> None:
    """Make it safe to drop ``atlas``, whose worker threads are ``threads``.

    xatlas ends its workers with a notification that is lost on one that is just about to wait for it; joining that
    one then takes for ever. So its workers must be seen waiting first; where they cannot be, the atlas is never freed.
    """
    quiet = 0
    for _ in range(1000):
        quiet = quiet + 1 if threads and all(_asleep(thread) for thread in threads) else 0
        if quiet == 3:
            return
        time.sleep(0.001)
        if not threads:
            break
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(atlas))


@dataclass(frozen=True, eq=False)
class LightMapLayout:
    """Where the faces of a mesh lie in its light map.

    Attributes:
        uv: (F, 3, 2) float32 in texels; the centre of texel [row, column] lies at (column + 0.5, row + 0.5).
        chart: (F,) int32, the chart of each face: connected faces of one flat piece of the layout.
        width: texels per row.
        height: rows.
    """

    uv: F32
    chart: I32
    width: int
    height: int


def unwrap(
    positions: F32, texel: float, finer: NDArray[np.float32] | None = None, normals: F32 | None = None
) -> LightMapLayout:
    """Cut a mesh into charts and pack them (xatlas).

    Args:
        positions: (F, 3, 3) face corners, metres; equal corners are welded.
        texel: side of a texel on the surface, metres.
        finer: (F,) factor ≥ 1 by which a face gets smaller texels; faces of different factors never share a chart.
        normals: (F, 3, 3) shading normals: charts end at edges where they differ. Light jumps there, and within a chart
            the texels would show the jump as a saw-toothed line.

    Returns:
        The layout, at least 4 × 4 texels.
    """
    count = len(positions)
    factors = np.ones(count, dtype=np.float32) if finer is None else finer
    atlas, own_threads = _new_atlas()
    groups = [np.flatnonzero(factors == factor) for factor in np.unique(factors)]
    for group in groups:
        factor = np.float32(factors[group[0]])
        corners = positions[group].reshape(-1, 3)
        keys = np.round(corners.astype(np.float64) * _WELD).astype(np.int64)
        leaning = None if normals is None else normals[group].reshape(-1, 3)
        if leaning is not None:
            keys = np.hstack([keys, np.round(leaning.astype(np.float64) * _NORMAL_WELD).astype(np.int64)])
        first, inverse = distinct_rows(keys)
        of_vertices = None if leaning is None else leaning[first]
        atlas.add_mesh(corners[first] * factor, inverse.reshape(-1, 3).astype(np.uint32), of_vertices)
    charts = xatlas.ChartOptions()
    charts.normal_seam_weight = _CUT_ALL
    charts.max_iterations = 1
    packing = xatlas.PackOptions()
    packing.texels_per_unit = 1.0 / texel
    packing.padding = PADDING
    packing.bilinear = True
    packing.bruteForce = False
    packing.create_image = False
    atlas.generate(charts, packing)
    width, height = max(int(atlas.width), 4), max(int(atlas.height), 4)
    uv = np.zeros((count, 3, 2), dtype=np.float32)
    chart = np.zeros(count, dtype=np.int32)
    offset = 0
    for number, group in enumerate(groups):
        mapping, indices, coordinates = atlas[number]
        faces = indices.reshape(-1, 3).astype(np.int64)
        uv[group] = coordinates[faces] * np.array([atlas.width, atlas.height], dtype=np.float32)
        # xatlas doubles the vertices along cuts, so that charts are what stays connected.
        edges = np.concatenate([faces[:, :2], faces[:, 1:]])
        graph = coo_matrix((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(len(mapping),) * 2)
        pieces, label = connected_components(graph, directed=False)
        chart[group] = label[faces[:, 0]] + offset
        offset += pieces
    uv = np.clip(np.nan_to_num(uv), 0.0, np.array([width, height], dtype=np.float32))
    _let_go(atlas, own_threads)
    return LightMapLayout(uv=uv, chart=chart, width=width, height=height)
