"""The kernels of the GPU renderer: one thread per pixel, ray or triangle, which calls the CPU renderer's functions.

Rays of a step lie in `RayArrays`, the picture in `FrameArrays`. No thread adds to what another one writes, so that the
order of threads does not change a byte.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba.cuda
import numpy as np
from numpy.typing import NDArray

from generators.core.bvh import STACK
from generators.core.cuda import kernel
from generators.core.device_rays import FAR, RayTree, first_hit
from generators.core.jit import inline
from generators.core.scene import F32, I32
from generators.vision import kernels as cpu
from generators.vision.kernels import PinholeView, ray_direction
from generators.vision.tables import SceneTables

cuda: Any = numba.cuda

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

#: Pixels of a tile, whose rays the threads of one warp follow: they meet much the same boxes.
TILE_WIDTH, TILE_HEIGHT = 8, 4
TILE = TILE_WIDTH * TILE_HEIGHT

# Functions that kernels call are names of their own: numba resolves them when it compiles.
_shade, _encode, _average = cpu.shade, cpu.encode, cpu.average
_mark_edges, _mark_thin = cpu.mark_edges, cpu.mark_thin
_write_geometry = cpu.write_geometry


class RayArrays(NamedTuple):
    """Rays and what they meet.

    Attributes:
        direction: (N, 3) float32.
        face: (N,) int32, −1 without a hit.
        distance: (N,) float32 in direction lengths.
        u: (N,) float32 weight of the face's corner 1.
        v: (N,) float32 weight of its corner 2.
        light: (N, 3) float32 linear display light.
    """

    direction: F32
    face: I32
    distance: F32
    u: F32
    v: F32
    light: F32


class FrameArrays(NamedTuple):
    """A picture of P = width · height pixels, row by row.

    Attributes:
        face: (P,) int32 face at the pixel's centre, −1 for none.
        depth: (P,) float32 metres, 0 for none.
        ids: (P,) uint16 instance ids.
        rgb: (P, 3) uint8.
        marks: (P,) uint8, 1 where a pixel is shot again.
        pixels: (P,) int32, the first ``number[0]`` are the pixels that are shot again, in any order.
        number: (1,) int32.
    """

    face: I32
    depth: F32
    ids: NDArray[np.uint16]
    rgb: U8
    marks: U8
    pixels: I32
    number: I32


def tiles(width: int, rows: int) -> int:
    """Tiles that cover a block of pixels."""
    return -(-width // TILE_WIDTH) * -(-rows // TILE_HEIGHT)


@inline
def _follow(view: PinholeView, tree: RayTree, rays: RayArrays, i: int, stack: I32, entries: F32) -> None:
    """Find what ray ``i`` meets; its direction is written already."""
    found, t, u, v = first_hit(
        tree.boxes,
        tree.children,
        tree.corners,
        np.float32(view.origin[0]),
        np.float32(view.origin[1]),
        np.float32(view.origin[2]),
        rays.direction[i, 0],
        rays.direction[i, 1],
        rays.direction[i, 2],
        FAR,
        False,
        stack,
        entries,
    )
    rays.face[i] = tree.face[found] if found >= 0 else -1
    rays.distance[i], rays.u[i], rays.v[i] = t, u, v


@kernel
def trace_centres(view: PinholeView, first_row: int, rows: int, tree: RayTree, rays: RayArrays) -> None:
    """Rays through the pixel centres of some rows; ray i is pixel i of the block."""
    thread = cuda.grid(1)
    tile, lane = thread // TILE, thread % TILE
    across = (view.width + TILE_WIDTH - 1) // TILE_WIDTH
    x = tile % across * TILE_WIDTH + lane % TILE_WIDTH
    y = tile // across * TILE_HEIGHT + lane // TILE_WIDTH
    if x >= view.width or y >= rows:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float32)
    i = y * view.width + x
    ray_direction(view, x + 0.5, first_row + y + 0.5, rays.direction, i)
    _follow(view, tree, rays, i, stack, entries)


@kernel
def trace_edges(
    view: PinholeView, first: int, offsets: F64, count: int, tree: RayTree, rays: RayArrays, frame: FrameArrays
) -> None:
    """The ``count`` rays of the pixels from number ``first`` on that are shot again, one for each of ``offsets``."""
    i = cuda.grid(1)
    if i >= count:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float32)
    samples = offsets.shape[0]
    pixel, j = frame.pixels[first + i // samples], i % samples
    row = pixel // view.width
    ray_direction(view, pixel - row * view.width + offsets[j, 0], row + offsets[j, 1], rays.direction, i)
    _follow(view, tree, rays, i, stack, entries)


@kernel
def write_geometry(first: int, count: int, rays: RayArrays, tables: SceneTables, frame: FrameArrays) -> None:
    """Face, depth and id of ``count`` pixels from number ``first`` on."""
    i = cuda.grid(1)
    if i >= count:
        return
    p = first + i
    frame.face[p] = rays.face[i]
    _write_geometry(
        rays.face[i : i + 1], rays.distance[i : i + 1], tables, frame.depth[p : p + 1], frame.ids[p : p + 1]
    )


@kernel
def shade(
    view: PinholeView, spread: float, count: int, rays: RayArrays, tables: SceneTables, tone: F32, white: float
) -> None:
    """Display light of ``count`` rays, each of which stands for an area ``spread`` pixels wide."""
    i = cuda.grid(1)
    if i >= count:
        return
    _shade(
        rays.face[i : i + 1],
        rays.distance[i : i + 1],
        rays.u[i : i + 1],
        rays.v[i : i + 1],
        rays.direction[i : i + 1],
        view,
        spread,
        tables,
        tone,
        white,
        rays.light[i : i + 1],
    )


@kernel
def encode(first: int, count: int, rays: RayArrays, srgb: U8, frame: FrameArrays) -> None:
    """Colours of ``count`` pixels from number ``first`` on."""
    i = cuda.grid(1)
    if i < count:
        _encode(rays.light[i], srgb, frame.rgb[first + i])


@kernel
def clear(frame: FrameArrays) -> None:
    """No pixel is marked."""
    i = cuda.grid(1)
    if i < frame.marks.shape[0]:
        frame.marks[i] = 0
    if i == 0:
        frame.number[0] = 0


@kernel
def mark_edges(view: PinholeView, surface: I32, normal: F32, frame: FrameArrays) -> None:
    """Mark the pixels at visible edges."""
    i = cuda.grid(1)
    if i < frame.marks.shape[0]:
        _mark_edges(frame.face, frame.depth, frame.rgb, view, surface, normal, frame.marks, i, i + 1)


@kernel
def mark_thin(triangles: F32, view: PinholeView, frame: FrameArrays) -> None:
    """Mark the pixels along triangles that are narrower than a pixel."""
    i = cuda.grid(1)
    if i < triangles.shape[0]:
        px, py, pz = cuda.local.array(3, np.float64), cuda.local.array(3, np.float64), cuda.local.array(3, np.float64)
        _mark_thin(triangles[i : i + 1], frame.depth, view, frame.marks, px, py, pz)


@kernel
def collect(frame: FrameArrays) -> None:
    """List the marked pixels. Their order varies; each is refined by itself."""
    i = cuda.grid(1)
    if i < frame.marks.shape[0] and frame.marks[i] != 0:
        frame.pixels[cuda.atomic.add(frame.number, 0, 1)] = i


@kernel
def average(first: int, last: int, samples: int, rays: RayArrays, srgb: U8, frame: FrameArrays) -> None:
    """Colours of the pixels that are shot again, from number ``first`` to ``last``."""
    i = cuda.grid(1)
    if i < last - first:
        begin = i * samples
        _average(rays.light[begin : begin + samples], samples, srgb, frame.pixels[first + i : first + i + 1], frame.rgb)
