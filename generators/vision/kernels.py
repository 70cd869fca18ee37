"""The compiled inner loops of the renderers: rays, shading, edges, encoding.

The CPU renderer calls the loops. A thread of the CUDA renderer calls the same functions for its own pixel: each loop
takes slices of arrays, or the first and the last element. They take scalars and arrays only and allocate nothing. (A
function of one element that the CPU's loop calls would cost it a third of a frame's time: numba counts references to
arrays in every call.)

A ray's direction is (x, y, −1) in camera space, not normalised, so that Embree's ``tfar`` is the depth along the
optical axis. Colours in here are radiance times exposure until `develop` makes them linear display light (after the
tone curve, before sRGB encoding).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.scene import F32, I32
from generators.vision.tables import SceneTables

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]
Vector = tuple[float, float, float]

#: Most texture samples along the long axis of a pixel's footprint.
MAX_TAPS = 16
#: Long over short axis, squared, up to which a footprint counts as round.
ISOTROPIC = np.float32(2.0)
#: Linear display light where a ray leaves the scene: a bright neutral, as an overexposed window.
MISS = np.float32(0.82)
#: Faces that meet at less than about 14° belong to one smooth surface (cosine).
SMOOTH = np.float32(0.97)
#: Relative difference in depth, beyond a face's own plane, that is a step.
STEP = np.float32(0.01)
#: Triangles narrower than this many pixels can fall between the rays.
NARROW = 1.0
#: Metres ahead of the camera from which triangles are projected.
NEAREST = 0.02
#: Contrast of neighbours, in 8-bit levels, up to which an edge is not worth more rays.
VISIBLE = 8
#: Contrast beyond which neighbours on different faces are an edge even if the surface goes on smoothly.
STRONG = 16
#: Contrast up to which an edge is faint: half of the rays will do.
FAINT = 24

_1, _2 = np.uint64(1), np.uint64(2)
_ZERO, _ONE, _HALF, _FOUR, _QUARTER = (np.float32(x) for x in (0.0, 1.0, 0.5, 4.0, 0.25))
#: Footprints of a level of a texture have 1 to 4 texels; from the first of these on, up to the second, the next level
#: is mixed in.
_FINE, _COARSE = np.float32(4**0.25), np.float32(4**0.75)
#: Share of the view's height at either edge that is left out: texels there mix with those of the other edge.
VIEW_EDGE = np.float32(0.004)


class PinholeView(NamedTuple):
    """A pinhole camera in the world, for kernels.

    Attributes:
        origin: world position, metres.
        right: world vector of one pixel to the right at depth 1 (the camera's +X / fx).
        down: world vector of one pixel down at depth 1 (the camera's −Y / fy).
        ahead: world unit vector along the optical axis.
        corner: world vector, at depth 1, of the upper left corner of pixel (0, 0).
        width: pixels.
        height: pixels.
    """

    origin: Vector
    right: Vector
    down: Vector
    ahead: Vector
    corner: Vector
    width: int
    height: int


@inline
def ray_direction(view: PinholeView, x: float, y: float, out: F32, i: int) -> None:
    """World direction of the ray through (x, y), in pixels right and down from the corner, as row ``i`` of ``out``."""
    for k in range(3):
        out[i, k] = view.corner[k] + x * view.right[k] + y * view.down[k]


@njit
def centre_directions(view: PinholeView, first_row: int, rows: int, out: F32) -> None:
    """World directions (rows·width, 3) of the rays through the pixel centres of some rows."""
    for row in range(rows):
        y = first_row + row + 0.5
        for column in range(view.width):
            ray_direction(view, column + 0.5, y, out, row * view.width + column)


@njit
def sub_pixel_directions(view: PinholeView, pixels: I32, offsets: F64, out: F32) -> None:
    """World directions of ``offsets`` (N, 2: right, down, in pixels from the corner) within each of ``pixels``."""
    count = offsets.shape[0]
    for i in range(pixels.shape[0]):
        row = pixels[i] // view.width
        column = pixels[i] - row * view.width
        for j in range(count):
            ray_direction(view, column + offsets[j, 0], row + offsets[j, 1], out, i * count + j)


@njit
def write_geometry(face: I32, distance: F32, tables: SceneTables, depth: F32, ids: NDArray[np.uint16]) -> None:
    """Depth (0 for a miss) and instance ids of a run of pixels from Embree's answer."""
    for i in range(face.shape[0]):
        if face[i] < 0:
            depth[i] = 0.0
            ids[i] = 0
        else:
            depth[i] = distance[i]
            ids[i] = tables.instance[tables.surface[face[i]]]


@inline
def _floor(x: np.float32) -> np.float32:
    """The integer below ``x``: exact below 2^63. numba's CUDA has no ``np.floor`` of scalars."""
    near = np.float32(np.int64(x))
    return near - _ONE if near > x else near


@inline
def _bilinear(
    texels: U8, decode: F32, base: int, height: int, width: int, s: np.float32, t: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """Linear light of one mip level, which begins at ``base``, at (s, t) repeats, wrapped."""
    x = (s - _floor(s)) * np.float32(width) - _HALF
    y = (_ONE - (t - _floor(t))) * np.float32(height) - _HALF
    # Both are ≥ −½, so that truncation after adding 1 rounds down; and one step wraps them.
    x0, y0 = np.int32(x + _ONE) - np.int32(1), np.int32(y + _ONE) - np.int32(1)
    ax, ay = x - np.float32(x0), y - np.float32(y0)
    x1 = x0 + 1 if x0 + 1 < width else 0
    y1 = y0 + 1 if y0 + 1 < height else 0
    x0 = x0 + width if x0 < 0 else x0
    y0 = y0 + height if y0 < 0 else y0
    upper, lower = base + y0 * width * 3, base + y1 * width * 3
    # Unsigned, which spares numba's check for negative indices.
    a, b, c, d = (
        np.uint64(upper + x0 * 3),
        np.uint64(upper + x1 * 3),
        np.uint64(lower + x0 * 3),
        np.uint64(lower + x1 * 3),
    )
    wd = ax * ay
    wb, wc = ax - wd, ay - wd
    wa = _ONE - ax - wc
    return (
        wa * decode[texels[a]] + wb * decode[texels[b]] + wc * decode[texels[c]] + wd * decode[texels[d]],
        wa * decode[texels[a + _1]]
        + wb * decode[texels[b + _1]]
        + wc * decode[texels[c + _1]]
        + wd * decode[texels[d + _1]],
        wa * decode[texels[a + _2]]
        + wb * decode[texels[b + _2]]
        + wc * decode[texels[c + _2]]
        + wd * decode[texels[d + _2]],
    )


@inline
def _filtered(
    texels: U8,
    decode: F32,
    offset: NDArray[np.int64],
    size: I32,
    level0: int,
    last: int,
    s: np.float32,
    t: np.float32,
    sx: np.float32,
    tx: np.float32,
    sy: np.float32,
    ty: np.float32,
) -> tuple[np.float32, np.float32, np.float32]:
    """Linear light of a texture (levels ``level0`` to ``last``) averaged over a pixel's footprint.

    (sx, tx) and (sy, ty) are the changes of the coordinates per pixel to the right and down. The footprint is the
    ellipse with the semi-axes of that 2×2 matrix: samples are spread along its long axis, at the level that suits its
    short one (after J. McCormack et al., "Feline: Fast Elliptical Lines for Anisotropic Texture Mapping", SIGGRAPH
    1999). Levels are blended over the middle half of the way from one to the next: half of all pixels need only one.
    """
    high, wide = size[level0, 0], size[level0, 1]
    height, width = np.float32(high), np.float32(wide)
    ax, ay, bx, by = sx * width, tx * height, sy * width, ty * height
    xx, xy, yy = ax * ax + bx * bx, ax * ay + bx * by, ay * ay + by * by
    mean, half = _HALF * (xx + yy), _HALF * (xx - yy)
    root = np.float32(math.sqrt(half * half + xy * xy))
    major2 = mean + root
    if not major2 > _ONE:  # magnified
        return _bilinear(texels, decode, offset[level0], high, wide, s, t)
    determinant = ax * by - ay * bx
    minor2 = max(determinant * determinant / major2, _ONE)
    taps = 1
    du = dv = _ZERO
    if minor2 * ISOTROPIC < major2:
        taps = min(MAX_TAPS, math.ceil(math.sqrt(major2 / minor2) - _HALF))
        minor2 = max(minor2, major2 / np.float32(taps * taps))
        if taps > 1:
            # The long axis, in repeats: the eigenvector of the larger eigenvalue.
            ux, uy = (root + half, xy) if half >= _ZERO else (xy, root - half)
            scale = np.float32(math.sqrt(major2 / (ux * ux + uy * uy)))
            du, dv = ux * scale / width, uy * scale / height
    level = level0
    while minor2 >= _FOUR and level < last:
        minor2 *= _QUARTER
        level += 1
    blend = min(max((minor2 - _FINE) / (_COARSE - _FINE), _ZERO), _ONE) if level < last else _ZERO
    if blend == _ONE:
        level, blend = level + 1, _ZERO
    base, high, wide = offset[level], size[level, 0], size[level, 1]
    upper = min(level + 1, last)
    base2, high2, wide2 = offset[upper], size[upper, 0], size[upper, 1]
    red = green = blue = _ZERO
    weight = _ONE / np.float32(taps)
    for k in range(taps):
        along = (np.float32(k) + _HALF) * weight - _HALF
        x, y = s + along * du, t + along * dv
        r, g, b = _bilinear(texels, decode, base, high, wide, x, y)
        if blend > _ZERO:
            r2, g2, b2 = _bilinear(texels, decode, base2, high2, wide2, x, y)
            r, g, b = r + blend * (r2 - r), g + blend * (g2 - g), b + blend * (b2 - b)
        red, green, blue = red + r, green + g, blue + b
    return red * weight, green * weight, blue * weight


@inline
def _light(
    texels: F32, base: int, height: int, width: int, x: np.float32, y: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """A light map, which begins at ``base``, at (x, y) texels from its corner, bilinear, clamped at its rim."""
    x = min(max(x - _HALF, _ZERO), np.float32(width - 1))
    y = min(max(y - _HALF, _ZERO), np.float32(height - 1))
    x0, y0 = int(x), int(y)
    x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
    ax, ay = x - np.float32(x0), y - np.float32(y0)
    upper, lower = base + y0 * width * 3, base + y1 * width * 3
    a, b, c, d = (
        np.uint64(upper + x0 * 3),
        np.uint64(upper + x1 * 3),
        np.uint64(lower + x0 * 3),
        np.uint64(lower + x1 * 3),
    )
    wd = ax * ay
    wb, wc = ax - wd, ay - wd
    wa = _ONE - ax - wc
    return (
        wa * texels[a] + wb * texels[b] + wc * texels[c] + wd * texels[d],
        wa * texels[a + _1] + wb * texels[b + _1] + wc * texels[c + _1] + wd * texels[d + _1],
        wa * texels[a + _2] + wb * texels[b + _2] + wc * texels[c + _2] + wd * texels[d + _2],
    )


@inline
def _tone(table: F32, scale: np.float32, radiance: np.float32) -> np.float32:
    """The tone curve, interpolated in a table over the square root of radiance · ``scale``."""
    last = table.shape[0] - 1
    if not radiance > _ZERO:
        return np.float32(table[0])
    x = np.float32(math.sqrt(radiance * scale)) * np.float32(last)
    if x >= np.float32(last):
        return np.float32(table[last])
    i = int(x)
    f = x - np.float32(i)
    return np.float32(table[i] + f * (table[i + 1] - table[i]))


@njit
def shade(
    face: I32,
    distance: F32,
    u: F32,
    v: F32,
    direction: F32,
    view: PinholeView,
    spread: float,
    tables: SceneTables,
    out: F32,
) -> None:
    """Diffuse radiance of hits: exposure · (albedo · light + emission), whichever side of the face is seen.

    Where nothing is hit, and of colours that already include light and tone curve (the textures of a scan), it is
    display light; see `develop`.

    Args:
        face: (N,) face, −1 where the ray missed.
        distance: (N,) depth.
        u: (N,) barycentric weight of corner 1.
        v: (N,) barycentric weight of corner 2.
        direction: (N, 3) of the rays.
        view: the camera.
        spread: width in pixels of the area that one ray represents.
        tables: the scene.
        out: (N, 3), written.
    """
    rx, ry, rz = (
        np.float32(view.right[0] * spread),
        np.float32(view.right[1] * spread),
        np.float32(view.right[2] * spread),
    )
    qx, qy, qz = (
        np.float32(view.down[0] * spread),
        np.float32(view.down[1] * spread),
        np.float32(view.down[2] * spread),
    )
    # Arrays are taken out of the named tuples once: numba counts references whenever it does so.
    surfaces, albedo, emission = tables.surface, tables.albedo, tables.emission
    texture_of, light_of, view_distance = tables.texture, tables.light, tables.view_distance
    normal, gradient, uv, light_uv = tables.normal, tables.gradient, tables.uv, tables.light_uv
    light_texels, light_offset, light_size = tables.light_texels, tables.light_offset, tables.light_size
    pool = tables.textures
    texels, decode, offset, size, first = pool.texels, pool.decode, pool.offset, pool.size, pool.first
    for i in range(face.shape[0]):
        if face[i] < 0:
            out[i, 0] = out[i, 1] = out[i, 2] = MISS
            continue
        f = np.uint64(face[i])
        surface = np.uint64(surfaces[f])
        b1, b2 = u[i], v[i]
        red, green, blue = albedo[surface, 0], albedo[surface, 1], albedo[surface, 2]
        texture = texture_of[surface]
        if texture >= 0:
            s = uv[f, 0, 0] + b1 * uv[f, 1, 0] + b2 * uv[f, 2, 0]
            t = uv[f, 0, 1] + b1 * uv[f, 1, 1] + b2 * uv[f, 2, 1]
            # Ray differentials (H. Igehy, SIGGRAPH 1999): moving the ray by one pixel moves the hit within the face
            # by dP = depth · (step − direction · (n·step) / (n·direction)).
            dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
            nx, ny, nz = normal[f, 0], normal[f, 1], normal[f, 2]
            facing = nx * dx + ny * dy + nz * dz
            inverse = _ONE / facing if abs(facing) > np.float32(1e-6) else np.float32(1e6)
            kr, kq = (nx * rx + ny * ry + nz * rz) * inverse, (nx * qx + ny * qy + nz * qz) * inverse
            gx, gy, gz = gradient[f, 0, 0], gradient[f, 0, 1], gradient[f, 0, 2]
            hx, hy, hz = gradient[f, 1, 0], gradient[f, 1, 1], gradient[f, 1, 2]
            gd, hd = gx * dx + gy * dy + gz * dz, hx * dx + hy * dy + hz * dz
            depth = distance[i]
            if view_distance[surface] > _ZERO:
                # The ray goes on to the plane of the view, which is parallel to the face.
                further = view_distance[surface] * abs(inverse)
                depth += further
                s += gd * further
                t = min(max(t + hd * further, VIEW_EDGE), _ONE - VIEW_EDGE)
            r, g, b = _filtered(
                texels,
                decode,
                offset,
                size,
                first[texture],
                first[texture + 1] - 1,
                s,
                t,
                depth * (gx * rx + gy * ry + gz * rz - gd * kr),
                depth * (hx * rx + hy * ry + hz * rz - hd * kr),
                depth * (gx * qx + gy * qy + gz * qz - gd * kq),
                depth * (hx * qx + hy * qy + hz * qz - hd * kq),
            )
            red, green, blue = red * r, green * g, blue * b
        light = light_of[surface]
        if light >= 0:
            x = light_uv[f, 0, 0] + b1 * light_uv[f, 1, 0] + b2 * light_uv[f, 2, 0]
            y = light_uv[f, 0, 1] + b1 * light_uv[f, 1, 1] + b2 * light_uv[f, 2, 1]
            r, g, b = _light(light_texels, light_offset[light], light_size[light, 0], light_size[light, 1], x, y)
            red, green, blue = red * r, green * g, blue * b
        out[i, 0] = red + emission[surface, 0]
        out[i, 1] = green + emission[surface, 1]
        out[i, 2] = blue + emission[surface, 2]


@njit
def develop(face: I32, tables: SceneTables, tone: F32, white: float, out: F32) -> None:
    """Turn the radiance (N, 3) of hits into display light, in place, where it is not display light already.

    Args:
        face: (N,) face, −1 where the ray missed.
        tables: the scene.
        tone: table of the tone curve, over the square root of radiance / ``white``.
        white: radiance at the end of that table.
        out: (N, 3).
    """
    scale = np.float32(1.0 / white)
    surfaces, developed = tables.surface, tables.developed
    for i in range(face.shape[0]):
        if face[i] >= 0 and not developed[surfaces[face[i]]]:
            for k in range(3):
                out[i, k] = _tone(tone, scale, out[i, k])


@njit
def shade_texels(
    face: I32,
    inside: F32,
    footprint: F32,
    tables: SceneTables,
    tone: F32,
    white: float,
    out: F32,
) -> None:
    """Display light of points on faces with a light map, for a map of displayed colours; see `shade`.

    Args:
        face: (N,) face, −1 where there is none.
        inside: (N, 2) barycentric weights of corners 1 and 2.
        footprint: (F, 2, 2) change of the texture coordinates (s, t) per texel of the map along its columns and rows.
        tables: the scene.
        tone: see `develop`.
        white: see `develop`.
        out: (N, 3), written where there is a face.
    """
    scale = np.float32(1.0 / white)
    surfaces, albedo, emission, developed = tables.surface, tables.albedo, tables.emission, tables.developed
    texture_of, light_of, uv, light_uv = tables.texture, tables.light, tables.uv, tables.light_uv
    light_texels, light_offset, light_size = tables.light_texels, tables.light_offset, tables.light_size
    pool = tables.textures
    texels, decode, offset, size, first = pool.texels, pool.decode, pool.offset, pool.size, pool.first
    for i in range(face.shape[0]):
        if face[i] < 0:
            continue
        f = np.uint64(face[i])
        surface = np.uint64(surfaces[f])
        b1, b2 = inside[i, 0], inside[i, 1]
        red, green, blue = albedo[surface, 0], albedo[surface, 1], albedo[surface, 2]
        texture = texture_of[surface]
        if texture >= 0:
            s = uv[f, 0, 0] + b1 * uv[f, 1, 0] + b2 * uv[f, 2, 0]
            t = uv[f, 0, 1] + b1 * uv[f, 1, 1] + b2 * uv[f, 2, 1]
            sx, tx = footprint[f, 0, 0], footprint[f, 0, 1]
            sy, ty = footprint[f, 1, 0], footprint[f, 1, 1]
            level0, last = first[texture], first[texture + 1] - 1
            r, g, b = _filtered(texels, decode, offset, size, level0, last, s, t, sx, tx, sy, ty)
            red, green, blue = red * r, green * g, blue * b
        light = light_of[surface]
        x = light_uv[f, 0, 0] + b1 * light_uv[f, 1, 0] + b2 * light_uv[f, 2, 0]
        y = light_uv[f, 0, 1] + b1 * light_uv[f, 1, 1] + b2 * light_uv[f, 2, 1]
        r, g, b = _light(light_texels, light_offset[light], light_size[light, 0], light_size[light, 1], x, y)
        if developed[surface]:
            out[i, 0], out[i, 1], out[i, 2] = red * r, green * g, blue * b
            continue
        out[i, 0] = _tone(tone, scale, red * r + emission[surface, 0])
        out[i, 1] = _tone(tone, scale, green * g + emission[surface, 1])
        out[i, 2] = _tone(tone, scale, blue * b + emission[surface, 2])


@inline
def _level(srgb: U8, light: np.float32) -> int:
    last = srgb.shape[0] - 1
    return int(srgb[min(last, max(0, int(light * np.float32(last) + _HALF)))])


@njit
def encode(light: F32, srgb: U8, out: U8) -> None:
    """8-bit sRGB (N,) of linear display light (N,)."""
    for i in range(light.shape[0]):
        out[i] = _level(srgb, light[i])


@njit
def picture(face: I32, tables: SceneTables, tone: F32, white: float, srgb: U8, radiance: F32, out: U8) -> None:
    """8-bit sRGB (N, 3) of the radiance (N, 3) of hits, which is left as it is; see `develop` and `encode`."""
    scale = np.float32(1.0 / white)
    surfaces, developed = tables.surface, tables.developed
    for i in range(face.shape[0]):
        if face[i] >= 0 and not developed[surfaces[face[i]]]:
            for k in range(3):
                out[i, k] = _level(srgb, _tone(tone, scale, radiance[i, k]))
        else:
            for k in range(3):
                out[i, k] = _level(srgb, radiance[i, k])


@inline
def _contrast(rgb: U8, i: int, j: int) -> int:
    """Largest difference of two pixels in a channel, in 8-bit levels."""
    red = abs(np.int32(rgb[i, 0]) - np.int32(rgb[j, 0]))
    green = abs(np.int32(rgb[i, 1]) - np.int32(rgb[j, 1]))
    blue = abs(np.int32(rgb[i, 2]) - np.int32(rgb[j, 2]))
    return int(max(red, green, blue))


@inline
def _breaks(surface: I32, normal: F32, depth: F32, view: PinholeView, a: int, b: int, i: int, j: int) -> bool:
    """Whether the surface breaks between pixel ``i`` showing face ``a`` and its neighbour ``j`` showing face ``b``."""
    if a < 0 or b < 0:
        return True
    if surface[a] != surface[b]:
        return True
    if abs(normal[a, 0] * normal[b, 0] + normal[a, 1] * normal[b, 1] + normal[a, 2] * normal[b, 2]) < SMOOTH:
        return True
    # n·(depth · direction) is the same all over a plane: does the neighbour lie in face a's?
    ix, iy = i % view.width + 0.5, i // view.width + 0.5
    jx, jy = j % view.width + 0.5, j // view.width + 0.5
    here = there = 0.0
    for k in range(3):
        here += normal[a, k] * (view.corner[k] + ix * view.right[k] + iy * view.down[k])
        there += normal[a, k] * (view.corner[k] + jx * view.right[k] + jy * view.down[k])
    return bool(abs(depth[i] * here - depth[j] * there) > STEP * depth[j] * max(abs(there), 0.1))


@njit
def mark_edges(
    face: I32, depth: F32, rgb: U8, view: PinholeView, surface: I32, normal: F32, marks: U8, first: int, last: int
) -> None:
    """Set ``marks`` (2, H·W) at both pixels of each visible edge of the pixels from number ``first`` to ``last``.

    An edge is where neighbours, on the right or below, show different surfaces, directions or depths, in colours that
    differ visibly; and where the texture or the light of two faces does not fit together at their seam. Row 0 has
    `FAINT` edges, row 1 the others; a pixel may have both.
    """
    width, height = view.width, view.height
    y = first // width
    x = first - y * width - 1
    for i in range(first, last):
        x += 1
        if x == width:
            x, y = 0, y + 1
        for j, inside in ((i + 1, x + 1 < width), (i + width, y + 1 < height)):
            if not inside or face[i] == face[j]:
                continue
            contrast = _contrast(rgb, i, j)
            if contrast > STRONG or (
                contrast > VISIBLE and _breaks(surface, normal, depth, view, face[i], face[j], i, j)
            ):
                row = 1 if contrast > FAINT else 0
                marks[row, i] = marks[row, j] = 1


@njit
def mark_thin(triangles: F32, depth: F32, view: PinholeView, marks: U8, px: F64, py: F64, pz: F64) -> None:
    """Set ``marks`` (H·W,) along triangles (K, 3, 3) that are narrower than a pixel and may be seen.

    The rays through the centres can miss a wire for a stretch and would draw it dashed. Each triangle is projected;
    one that faces the camera and is narrow on the screen is followed along its longest side, wherever the depth behind
    the pixel's centre leaves it in sight. ``px``, ``py``, ``pz`` (3,) are scratch.
    """
    fx2 = view.right[0] ** 2 + view.right[1] ** 2 + view.right[2] ** 2
    fy2 = view.down[0] ** 2 + view.down[1] ** 2 + view.down[2] ** 2
    # The pixel of the optical axis: corner = ahead − cx·right − cy·down.
    cx = cy = 0.0
    for k in range(3):
        cx -= view.corner[k] * view.right[k] / fx2
        cy -= view.corner[k] * view.down[k] / fy2
    for f in range(triangles.shape[0]):
        hidden = False
        for c in range(3):
            x = triangles[f, c, 0] - view.origin[0]
            y = triangles[f, c, 1] - view.origin[1]
            z = triangles[f, c, 2] - view.origin[2]
            away = x * view.ahead[0] + y * view.ahead[1] + z * view.ahead[2]
            if away < NEAREST:
                hidden = True
                break
            px[c] = (x * view.right[0] + y * view.right[1] + z * view.right[2]) / (fx2 * away) + cx
            py[c] = (x * view.down[0] + y * view.down[1] + z * view.down[2]) / (fy2 * away) + cy
            pz[c] = 1.0 / away
        if hidden or max(px[0], px[1], px[2]) < 0 or min(px[0], px[1], px[2]) > view.width:
            continue
        if max(py[0], py[1], py[2]) < 0 or min(py[0], py[1], py[2]) > view.height:
            continue
        # Rows grow downwards: counter-clockwise from its front is a negative area here.
        area = (px[1] - px[0]) * (py[2] - py[0]) - (px[2] - px[0]) * (py[1] - py[0])
        if area >= 0:
            continue
        first, longest = 0, 0.0
        for c in range(3):
            d = (c + 1) % 3
            length = math.hypot(px[d] - px[c], py[d] - py[c])
            if length > longest:
                first, longest = c, length
        if -area > NARROW * longest:
            continue
        second, third = (first + 1) % 3, (first + 2) % 3
        steps = 1 + int(2.0 * longest)
        for k in range(steps):
            w = (k + 0.5) / steps
            # Half-way into the triangle at the middle of the side, on the side at its ends.
            inward = 0.5 * min(w, 1.0 - w)
            a, b = (1.0 - w) * (1.0 - inward), w * (1.0 - inward)
            x = a * px[first] + b * px[second] + inward * px[third]
            y = a * py[first] + b * py[second] + inward * py[third]
            if not (0.0 <= x < view.width and 0.0 <= y < view.height):
                continue
            i = int(y) * view.width + int(x)
            near = a * pz[first] + b * pz[second] + inward * pz[third]
            if depth[i] == 0.0 or depth[i] * near > 1.0 - STEP:
                marks[i] = 1


@njit
def average(samples: F32, count: int, srgb: U8, pixels: I32, out: U8) -> None:
    """Write the mean of each ``count`` samples (P·count, 3), encoded, to ``out`` (H·W, 3) at ``pixels`` (P,)."""
    weight = _ONE / np.float32(count)
    for i in range(pixels.shape[0]):
        for k in range(3):
            total = _ZERO
            for j in range(count):
                total += samples[i * count + j, k]
            out[pixels[i], k] = _level(srgb, total * weight)
