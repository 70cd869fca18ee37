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
from generators.vision import reflection_kernels as mirrors
from generators.vision.kernels import STRONG, PinholeView, ray_direction
from generators.vision.reflection_kernels import BOUNCES
from generators.vision.tables import CLEAR, GLOSSY, SceneTables

cuda: Any = numba.cuda

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

#: Pixels of a tile, whose rays the threads of one warp follow: they meet much the same boxes.
TILE_WIDTH, TILE_HEIGHT = 8, 4
TILE = TILE_WIDTH * TILE_HEIGHT

# Functions that kernels call are names of their own: numba resolves them when it compiles.
_shade, _develop, _picture, _average = cpu.shade, cpu.develop, cpu.picture, cpu.average
_mark_edges, _mark_thin = cpu.mark_edges, cpu.mark_thin
_write_geometry = cpu.write_geometry
_add_mean, _reflect, _see_through = mirrors.add_mean, mirrors.reflect, mirrors.see_through
_go_on, _keep_lobes, _smooth = mirrors.follow, mirrors.keep_lobes, mirrors.smooth
_add_lobes, _reuse, _mark_mirrored = mirrors.add_lobes, mirrors.reuse, mirrors.mark_mirrored


class RayArrays(NamedTuple):
    """Rays and what they meet.

    Attributes:
        direction: (N, 3) float32.
        face: (N,) int32, −1 without a hit.
        distance: (N,) float32 in direction lengths.
        u: (N,) float32 weight of the face's corner 1.
        v: (N,) float32 weight of its corner 2.
        light: (N, 3) float32 radiance, and linear display light once it is developed.
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
        marks: (2, P) uint8, 1 where a pixel is shot again: at faint edges, at others.
        pixels: (P,) int32, the first ``number[0]`` are the pixels that are shot again, in any order.
        number: (1,) int32.
        light: (P, 3) float32 radiance times exposure.
        lobe: (P, 3) float32 see `reflection_kernels.keep_lobes`; so are the following but for ``between``.
        between: (P, 3) float32 lobes that are averaged along the rows.
        factor: (P, 3) float32.
        radius: (P,) float32.
        alpha: (P,) float32.
        second: (P,) int32.
    """

    face: I32
    depth: F32
    ids: NDArray[np.uint16]
    rgb: U8
    marks: U8
    pixels: I32
    number: I32
    light: F32
    lobe: F32
    between: F32
    factor: F32
    radius: F32
    alpha: F32
    second: I32


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
def shade(view: PinholeView, spread: float, count: int, rays: RayArrays, tables: SceneTables) -> None:
    """Diffuse radiance of ``count`` rays, each of which stands for an area ``spread`` pixels wide."""
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
        rays.light[i : i + 1],
    )


@inline
def _walk(
    tree: RayTree,
    tables: SceneTables,
    origins: F32,
    directions: F32,
    cone: F32,
    first: I32,
    reach: F32,
    seen: F32,
    stack: I32,
    entries: F32,
) -> None:
    """Add to ``seen`` (1, 3) what one ray brings, 0 without a direction; see `reflections.Reflections`."""
    face, distance = cuda.local.array(1, np.int32), cuda.local.array(1, np.float32)
    u, v = cuda.local.array(1, np.float32), cuda.local.array(1, np.float32)
    owner, throughput = cuda.local.array(1, np.int32), cuda.local.array((1, 3), np.float32)
    owner[0], first[0], reach[0] = 0, -1, np.float32(0.0)
    for c in range(3):
        throughput[0, c] = np.float32(1.0)
    bounce = 0
    while bounce <= BOUNCES:
        if directions[0, 0] == 0.0 and directions[0, 1] == 0.0 and directions[0, 2] == 0.0:
            break
        found, t, b1, b2 = first_hit(
            tree.boxes,
            tree.children,
            tree.corners,
            origins[0, 0],
            origins[0, 1],
            origins[0, 2],
            directions[0, 0],
            directions[0, 1],
            directions[0, 2],
            FAR,
            False,
            stack,
            entries,
        )
        face[0] = tree.face[found] if found >= 0 else -1
        distance[0], u[0], v[0] = t, b1, b2
        if bounce == 0:
            first[0], reach[0] = face[0], distance[0]
        last = bounce == BOUNCES
        if _go_on(face, distance, u, v, owner, throughput, origins, directions, cone, tables, last, seen) == 0:
            break
        bounce += 1


@inline
def _reflected(
    view: PinholeView,
    spread: float,
    samples: int,
    i: int,
    pixel: I32,
    tree: RayTree,
    rays: RayArrays,
    tables: SceneTables,
    points: F32,
    frame: FrameArrays,
    stack: I32,
    entries: F32,
) -> None:
    """What ray ``i``, one of the ``samples`` of a ``pixel``, reflects and what it sees through what it meets."""
    begin = i - i % samples
    face, distance, u, v = (
        rays.face[begin : i + 1],
        rays.distance[begin : i + 1],
        rays.u[begin : i + 1],
        rays.v[begin : i + 1],
    )
    direction, light = rays.direction[begin : i + 1], rays.light[begin : i + 1]
    own = slice(i, i + 1)
    _add_mean(rays.face[own], rays.u[own], rays.v[own], rays.direction[own], tables, rays.light[own])
    if rays.face[i] < 0:
        return
    shine = tables.shine[tables.surface[rays.face[i]]]
    if shine < GLOSSY:
        return
    rows, first = cuda.local.array(1, np.int32), cuda.local.array(1, np.int32)
    reach, seen = cuda.local.array(1, np.float32), cuda.local.array((1, 3), np.float32)
    weight, origins = cuda.local.array((1, 3), np.float32), cuda.local.array((1, 3), np.float32)
    directions, cone = cuda.local.array((1, 3), np.float32), cuda.local.array((1, 3), np.float32)
    start = cuda.local.array((1, 3), np.float32)
    rows[0] = i - begin
    _reflect(
        rows,
        face,
        distance,
        u,
        v,
        direction,
        view,
        spread,
        pixel,
        samples,
        tables,
        points,
        light,
        weight,
        origins,
        directions,
        cone,
    )
    if samples > 1:
        _reuse(
            rows,
            face,
            pixel,
            samples,
            frame.face,
            tables,
            frame.radius,
            frame.lobe,
            view.width,
            view.height,
            weight,
            directions,
            light,
        )
    for c in range(3):
        start[0, c], seen[0, c] = cone[0, c], np.float32(0.0)
    _walk(tree, tables, origins, directions, cone, first, reach, seen, stack, entries)
    if samples > 1:
        for c in range(3):
            rays.light[i, c] += weight[0, c] * seen[0, c]
    else:
        p = pixel[0]
        at = slice(p, p + 1)
        _keep_lobes(
            rows,
            rays.distance[own],
            first,
            reach,
            start,
            weight,
            seen,
            frame.lobe[at],
            frame.factor[at],
            frame.radius[at],
            frame.alpha[at],
            frame.second[at],
        )
    if shine != CLEAR:
        return
    if _see_through(rows, face, distance, u, v, direction, view, spread, tables, weight, origins, directions, cone):
        for c in range(3):
            seen[0, c] = np.float32(0.0)
        _walk(tree, tables, origins, directions, cone, first, reach, seen, stack, entries)
        for c in range(3):
            rays.light[i, c] += weight[0, c] * seen[0, c]


@kernel
def reflect_centres(
    view: PinholeView,
    begin: int,
    count: int,
    tree: RayTree,
    rays: RayArrays,
    tables: SceneTables,
    points: F32,
    frame: FrameArrays,
) -> None:
    """Radiance of ``count`` pixels from number ``begin`` on, and the lobes of those that reflect."""
    i = cuda.grid(1)
    if i >= count:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float32)
    pixel = cuda.local.array(1, np.int32)
    p = begin + i
    pixel[0], frame.radius[p], frame.second[p] = p, np.float32(-1.0), -1
    _reflected(view, 1.0, 1, i, pixel, tree, rays, tables, points, frame, stack, entries)
    for c in range(3):
        frame.light[p, c] = rays.light[i, c]


@kernel
def reflect_edges(
    view: PinholeView,
    begin: int,
    samples: int,
    count: int,
    tree: RayTree,
    rays: RayArrays,
    tables: SceneTables,
    points: F32,
    tone: F32,
    white: float,
    frame: FrameArrays,
) -> None:
    """Display light of the ``count`` rays of the pixels from number ``begin`` on that are shot again."""
    i = cuda.grid(1)
    if i >= count:
        return
    stack, entries = cuda.local.array(STACK, np.int32), cuda.local.array(STACK, np.float32)
    pixel = cuda.local.array(1, np.int32)
    pixel[0] = frame.pixels[begin + i // samples]
    _reflected(view, 0.5, samples, i, pixel, tree, rays, tables, points, frame, stack, entries)
    _develop(rays.face[i : i + 1], tables, tone, white, rays.light[i : i + 1])


@kernel
def smooth(down: bool, view: PinholeView, tables: SceneTables, frame: FrameArrays) -> None:
    """Average the lobes of all pixels along the rows, into ``between``, then ``down`` the columns."""
    i = cuda.grid(1)
    if i < frame.face.shape[0]:
        before, after = (frame.between, frame.lobe) if down else (frame.lobe, frame.between)
        _smooth(frame.face, tables, before, frame.radius, frame.alpha, view.width, view.height, down, i, i + 1, after)


@kernel
def finish(tables: SceneTables, tone: F32, white: float, srgb: U8, frame: FrameArrays) -> None:
    """Colours of all pixels from their radiance and their lobes."""
    i = cuda.grid(1)
    if i < frame.face.shape[0]:
        own = slice(i, i + 1)
        _add_lobes(frame.factor[own], frame.radius[own], frame.lobe[own], frame.light[own])
        _picture(frame.face[own], tables, tone, white, srgb, frame.light[own], frame.rgb[own])


@kernel
def mark_mirrored(view: PinholeView, frame: FrameArrays) -> None:
    """Mark the pixels at edges in mirrors."""
    i = cuda.grid(1)
    if i < frame.face.shape[0]:
        _mark_mirrored(frame.second, frame.rgb, view.width, STRONG, frame.marks[1], i, i + 1)


@kernel
def clear(frame: FrameArrays) -> None:
    """No pixel is marked."""
    i = cuda.grid(1)
    if i < frame.face.shape[0]:
        frame.marks[0, i] = frame.marks[1, i] = 0


@kernel
def mark_edges(view: PinholeView, surface: I32, normal: F32, frame: FrameArrays) -> None:
    """Mark the pixels at visible edges."""
    i = cuda.grid(1)
    if i < frame.face.shape[0]:
        _mark_edges(frame.face, frame.depth, frame.rgb, view, surface, normal, frame.marks, i, i + 1)


@kernel
def mark_thin(triangles: F32, view: PinholeView, frame: FrameArrays) -> None:
    """Mark the pixels along triangles that are narrower than a pixel."""
    i = cuda.grid(1)
    if i < triangles.shape[0]:
        px, py, pz = cuda.local.array(3, np.float64), cuda.local.array(3, np.float64), cuda.local.array(3, np.float64)
        _mark_thin(triangles[i : i + 1], frame.depth, view, frame.marks[1], px, py, pz)


@kernel
def begin_list(frame: FrameArrays) -> None:
    """The list of pixels is empty."""
    frame.number[0] = 0


@kernel
def collect(faint: bool, frame: FrameArrays) -> None:
    """List the pixels at ``faint`` edges alone, or at others. Their order varies; each is refined by itself."""
    i = cuda.grid(1)
    if i >= frame.face.shape[0]:
        return
    if (frame.marks[1, i] == 0 and frame.marks[0, i] != 0) if faint else frame.marks[1, i] != 0:
        frame.pixels[cuda.atomic.add(frame.number, 0, 1)] = i


@kernel
def average(first: int, last: int, samples: int, rays: RayArrays, srgb: U8, frame: FrameArrays) -> None:
    """Colours of the pixels that are shot again, from number ``first`` to ``last``."""
    i = cuda.grid(1)
    if i < last - first:
        begin = i * samples
        _average(rays.light[begin : begin + samples], samples, srgb, frame.pixels[first + i : first + i + 1], frame.rgb)
