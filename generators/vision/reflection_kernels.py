"""The compiled inner loops of reflections, for the CPU and CUDA renderers (see `generators.vision.kernels`).

`reflect` turns hits of the camera's rays on surfaces that reflect into further rays, one for each hit: mirrored about a
normal drawn from the surface's lobe, by a point that depends on the pixel's place alone. `follow` adds what such rays
meet, and sends those on that meet a mirror or a clear pane. The radiance of one ray is a sample of the lobe's; `smooth`
averages those of pixels around that show the same surface, over less than the lobe's own width. Mirrors are not
averaged. Here colours are radiance times exposure.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.core.albedos import DIELECTRIC
from generators.core.jit import inline, njit
from generators.core.scene import F32, I32
from generators.vision.kernels import MISS, VIEW_EDGE, PinholeView, _bilinear, _light
from generators.vision.microfacet import BLOCK, directional_albedo, lobe_normal, schlick
from generators.vision.tables import CLEAR, GLOSSY, SATIN, TRACED, TRACING_LIMIT, SceneTables

U8 = NDArray[np.uint8]
Triple = tuple[np.float32, np.float32, np.float32]

#: Roughness below which a surface is a mirror: its lobe is narrower than a pixel.
MIRROR = np.float32(0.06)
#: Mirrors and panes that a ray may meet before it ends on what it meets next.
BOUNCES = 4
#: Metals below this roughness send on the rays that meet them.
BRIGHT = np.float32(0.2)
#: Rays start this far off the surface (m).
LIFT = np.float32(2e-4)
#: The most radiance that one ray of a lobe brings from a lamp much smaller than the lobe, and how far it may be
#: exceeded: see `_most`.
FIREFLY, STRATIFIED = np.float32(8.0), np.float32(4.0)
#: How many times the mean of the others the brightest ray counts in an average.
LONE = np.float32(6.0)
#: Half-width of a lobe that a ray stands for in a look-up of textures, in units of α: rays of pixels around are near.
PART = np.float32(0.5)
#: Radius of the average over a lobe, in units of the lobe's radius on the screen, and its least and most (pixels).
SHARE, LEAST, WIDEST = np.float32(0.8), np.float32(2.0), np.float32(6.0)
#: From this roughness on every other pixel of a flat face has a ray, like the black squares of a chessboard.
HALVED = np.float32(0.11)
#: Width of a lobe's mirrored directions (radians) in units of α.
WIDTH = np.float32(1.4)

_ZERO, _ONE, _TWO, _HALF = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(0.5)
_TINY, _ROOT = np.float32(1e-12), np.float32(math.sqrt(2.0))


@inline
def _texel(
    texels: U8,
    decode: F32,
    offset: NDArray[np.int64],
    size: I32,
    first: int,
    last: int,
    s: np.float32,
    t: np.float32,
    width: np.float32,
) -> Triple:
    """A texture (levels ``first`` to ``last``) at (s, t), at the level where ``width`` repeats are about one texel."""
    wide = width * np.float32(max(size[first, 0], size[first, 1]))
    level = first
    while wide > _ROOT and level < last:
        wide *= _HALF
        level += 1
    return _bilinear(texels, decode, offset[level], size[level, 0], size[level, 1], s, t)


@inline
def _at(uv: F32, f: int, u: np.float32, v: np.float32) -> tuple[np.float32, np.float32]:
    """Coordinates at a point of face f."""
    return (
        uv[f, 0, 0] + u * uv[f, 1, 0] + v * uv[f, 2, 0],
        uv[f, 0, 1] + u * uv[f, 1, 1] + v * uv[f, 2, 1],
    )


@inline
def _repeats(gradient: F32, f: int, width: np.float32) -> np.float32:
    """Texture coordinates that ``width`` metres on face f span, along the axis of the greater change."""
    gx, gy, gz = gradient[f, 0, 0], gradient[f, 0, 1], gradient[f, 0, 2]
    hx, hy, hz = gradient[f, 1, 0], gradient[f, 1, 1], gradient[f, 1, 2]
    return width * np.float32(math.sqrt(max(gx * gx + gy * gy + gz * gz, hx * hx + hy * hy + hz * hz)))


@inline
def _mapped(
    texels: U8,
    decode: F32,
    offset: NDArray[np.int64],
    size: I32,
    first: I32,
    number: int,
    uv: F32,
    gradient: F32,
    f: int,
    u: np.float32,
    v: np.float32,
    width: np.float32,
) -> Triple:
    """Texture ``number`` of a `TexturePool` at a point of face f, filtered over ``width`` metres."""
    s, t = _at(uv, f, u, v)
    return _texel(
        texels, decode, offset, size, first[number], first[number + 1] - 1, s, t, _repeats(gradient, f, width)
    )


@inline
def _baked(
    texels: F32,
    offset: NDArray[np.int64],
    size: I32,
    uv: F32,
    number: int,
    f: int,
    u: np.float32,
    v: np.float32,
) -> Triple:
    """Light map ``number`` at a point of face f; 1 where there is none (−1)."""
    if number < 0:
        return _ONE, _ONE, _ONE
    x, y = _at(uv, f, u, v)
    return _light(texels, offset[number], size[number, 0], size[number, 1], x, y)


@inline
def _beyond(
    gradient: F32,
    f: int,
    s: np.float32,
    t: np.float32,
    dx: np.float32,
    dy: np.float32,
    dz: np.float32,
    further: np.float32,
    width: np.float32,
) -> Triple:
    """Coordinates in the view behind face f, and repeats that ``width`` spans, ``further`` along d; see `shade`."""
    s += further * (gradient[f, 0, 0] * dx + gradient[f, 0, 1] * dy + gradient[f, 0, 2] * dz)
    t += further * (gradient[f, 1, 0] * dx + gradient[f, 1, 1] * dy + gradient[f, 1, 2] * dz)
    return s, min(max(t, VIEW_EDGE), _ONE - VIEW_EDGE), _repeats(gradient, f, width)


@inline
def _normalised(x: np.float32, y: np.float32, z: np.float32) -> Triple:
    scale = _ONE / np.float32(math.sqrt(max(x * x + y * y + z * z, _TINY)))
    return x * scale, y * scale, z * scale


@inline
def _corner_mean(normal: F32, plane: F32, f: int, u: np.float32, v: np.float32) -> Triple:
    """Unit shading normal at a point of face f, from those of its corners."""
    x = normal[f, 0, 0] + u * normal[f, 1, 0] + v * normal[f, 2, 0]
    y = normal[f, 0, 1] + u * normal[f, 1, 1] + v * normal[f, 2, 1]
    z = normal[f, 0, 2] + u * normal[f, 1, 2] + v * normal[f, 2, 2]
    x, y, z = _normalised(x, y, z)
    gx, gy, gz = plane[f, 0], plane[f, 1], plane[f, 2]
    if x * gx + y * gy + z * gz < np.float32(0.1):
        x, y, z = gx, gy, gz
    return x, y, z


@inline
def _is_flat(normal: F32, f: int) -> bool:
    """Whether the shading normals at a face's corners are alike."""
    change = _ZERO
    for k in range(3):
        change += abs(normal[f, 1, k]) + abs(normal[f, 2, k])
    return bool(change < np.float32(1e-3))


@inline
def _bumped(gradient: F32, f: int, x: np.float32, y: np.float32, z: np.float32, bump: Triple) -> Triple:
    """A normal (x, y, z) of face f turned as a normal map's texel says.

    The map is in the frame of the face's own texture gradients, made orthogonal to the normal: tangent along s,
    bitangent along t (which for a texture without shear is that of MikkTSpace up to its smoothing over vertices).
    """
    a, b, c = _TWO * bump[0] - _ONE, _TWO * bump[1] - _ONE, max(_TWO * bump[2] - _ONE, np.float32(0.05))
    tx, ty, tz = gradient[f, 0, 0], gradient[f, 0, 1], gradient[f, 0, 2]
    along = tx * x + ty * y + tz * z
    tx, ty, tz = _normalised(tx - along * x, ty - along * y, tz - along * z)
    bx, by, bz = y * tz - z * ty, z * tx - x * tz, x * ty - y * tx
    if bx * gradient[f, 1, 0] + by * gradient[f, 1, 1] + bz * gradient[f, 1, 2] < _ZERO:
        bx, by, bz = -bx, -by, -bz
    return _normalised(a * tx + b * bx + c * x, a * ty + b * by + c * y, a * tz + b * bz + c * z)


@inline
def _facing(
    nx: np.float32, ny: np.float32, nz: np.float32, vx: np.float32, vy: np.float32, vz: np.float32
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """A normal turned towards the eye as far as needed, and its cosine to the direction v to the eye."""
    cosine = nx * vx + ny * vy + nz * vz
    least = np.float32(0.02)
    if cosine < least:
        nx, ny, nz = _normalised(nx + (least - cosine) * vx, ny + (least - cosine) * vy, nz + (least - cosine) * vz)
        cosine = max(nx * vx + ny * vy + nz * vz, np.float32(1e-3))
    return nx, ny, nz, cosine


@inline
def _mirrored(
    dx: np.float32,
    dy: np.float32,
    dz: np.float32,
    hx: np.float32,
    hy: np.float32,
    hz: np.float32,
    gx: np.float32,
    gy: np.float32,
    gz: np.float32,
) -> Triple:
    """Direction d mirrored at the plane of h, and out of the surface with the geometric normal g if it enters it."""
    along = _TWO * (dx * hx + dy * hy + dz * hz)
    x, y, z = dx - along * hx, dy - along * hy, dz - along * hz
    below = x * gx + y * gy + z * gz
    if below < np.float32(1e-3):
        twice = _TWO * min(below, _ZERO) - np.float32(1e-3)
        x, y, z = _normalised(x - twice * gx, y - twice * gy, z - twice * gz)
    return x, y, z


@njit
def select(face: I32, tables: SceneTables, rows: I32) -> int:
    """Write the numbers of the hits on surfaces that send rays into ``rows``; returns how many they are."""
    surfaces, shine = tables.surface, tables.shine
    count = 0
    for i in range(face.shape[0]):
        if face[i] >= 0 and shine[surfaces[face[i]]] >= GLOSSY:
            rows[count] = i
            count += 1
    return count


@njit
def add_mean(face: I32, u: F32, v: F32, direction: F32, tables: SceneTables, light: F32) -> None:
    """Add to the radiance of hits what rough surfaces reflect of the mean light that arrives; see `reflect`."""
    surfaces, shine, finish, base = tables.surface, tables.shine, tables.finish, tables.colour
    plane, gradient, uv, light_uv = tables.normal, tables.gradient, tables.uv, tables.light_uv
    texture_of, light_of = tables.texture, tables.light
    light_texels, light_offset, light_size = tables.light_texels, tables.light_offset, tables.light_size
    texels, offset, size, first, decode = tables.textures
    gains, albedo, emission = tables.gains, tables.albedos, tables.emission
    width = _ZERO
    for i in range(face.shape[0]):
        f = face[i]
        if f < 0:
            continue
        surface = surfaces[f]
        if shine[surface] != SATIN:
            continue
        b1, b2 = u[i], v[i]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        cosine = abs(dx * plane[f, 0] + dy * plane[f, 1] + dz * plane[f, 2])
        cosine /= np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
        one, other = directional_albedo(albedo, finish[surface, 0], cosine)
        metallic = finish[surface, 1]
        red = green = blue = _ZERO
        if metallic > _ZERO:
            red, green, blue = base[surface, 0], base[surface, 1], base[surface, 2]
            texture = texture_of[surface]
            if texture >= 0:
                r, g, b = _mapped(texels, decode, offset, size, first, texture, uv, gradient, f, b1, b2, width)
                red, green, blue = red * r, green * g, blue * b
            rest = _ONE - metallic
            for k in range(3):
                light[i, k] = emission[surface, k] + rest * (light[i, k] - emission[surface, k])
        rest = (_ONE - metallic) * DIELECTRIC
        r, g, b = _baked(light_texels, light_offset, light_size, light_uv, light_of[surface], f, b1, b2)
        r, g, b = gains[0] * r, gains[1] * g, gains[2] * b
        light[i, 0] += ((rest + metallic * red) * one + other) * r
        light[i, 1] += ((rest + metallic * green) * one + other) * g
        light[i, 2] += ((rest + metallic * blue) * one + other) * b


@njit
def reflect(
    rows: I32,
    face: I32,
    distance: F32,
    u: F32,
    v: F32,
    direction: F32,
    view: PinholeView,
    spread: float,
    pixels: I32,
    samples: int,
    tables: SceneTables,
    points: F32,
    light: F32,
    weight: F32,
    origins: F32,
    directions: F32,
    cone: F32,
) -> None:
    """Finish the diffuse radiance of hits and find their rays.

    Args:
        rows: (M,) the hits that count.
        face: (N,) see `kernels.shade`; so are distance, u, v, direction, view, spread.
        distance: (N,).
        u: (N,).
        v: (N,).
        direction: (N, 3).
        view: the camera.
        spread: see `kernels.shade`.
        pixels: number of the pixel of each ``samples`` hits.
        samples: rays of a pixel.
        tables: the scene.
        points: `microfacet.block_points`.
        light: (N, 3) radiance from `kernels.shade`: changed to what is reflected without a ray.
        weight: (M, 3) factor of the radiance that the ray brings; 0 for hits without one.
        origins: (M, 3).
        directions: (M, 3) unit vectors, and 0 without a ray.
        cone: (M, 3) width of the footprint at the start (m), its growth per metre, and the lobe's α: 0 for a mirror,
            and negative where rays of pixels around are to stand in for a ray.
    """
    step = np.float32(
        spread
        * math.sqrt(view.right[0] * view.right[0] + view.right[1] * view.right[1] + view.right[2] * view.right[2])
    )
    surfaces, finish, base = tables.surface, tables.finish, tables.colour
    plane, corner, gradient, uv, light_uv = (
        tables.normal,
        tables.corner_normal,
        tables.gradient,
        tables.uv,
        tables.light_uv,
    )
    texture_of, light_of, bumps, roughening = tables.texture, tables.light, tables.bumps, tables.roughening
    light_texels, light_offset, light_size = tables.light_texels, tables.light_offset, tables.light_size
    texels, offset, size, first, decode = tables.textures
    map_texels, map_offset, map_size, map_first, map_decode = tables.maps
    gains = tables.gains
    albedo, emission = tables.albedos, tables.emission
    for k in range(rows.shape[0]):
        i = rows[k]
        f = face[i]
        surface = surfaces[f]
        b1, b2 = u[i], v[i]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        length = np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
        dx, dy, dz = dx / length, dy / length, dz / length
        gx, gy, gz = plane[f, 0], plane[f, 1], plane[f, 2]
        side = -_ONE if gx * dx + gy * dy + gz * dz > _ZERO else _ONE
        width = distance[i] * step
        nx, ny, nz = _corner_mean(corner, plane, f, b1, b2)
        number = bumps[surface]
        if number >= 0:
            bump = _mapped(
                map_texels, map_decode, map_offset, map_size, map_first, number, uv, gradient, f, b1, b2, width
            )
            nx, ny, nz = _bumped(gradient, f, nx, ny, nz, bump)
        nx, ny, nz = side * nx, side * ny, side * nz
        gx, gy, gz = side * gx, side * gy, side * gz
        nx, ny, nz, cosine = _facing(nx, ny, nz, -dx, -dy, -dz)
        roughness, metallic = finish[surface, 0], finish[surface, 1]
        number = roughening[surface]
        if number >= 0:
            _, g, b = _mapped(
                map_texels, map_decode, map_offset, map_size, map_first, number, uv, gradient, f, b1, b2, width
            )
            roughness, metallic = roughness * g, metallic * b
        clear, coat = finish[surface, 2], finish[surface, 3]
        red = green = blue = _ZERO
        if metallic > _ZERO:
            red, green, blue = base[surface, 0], base[surface, 1], base[surface, 2]
            texture = texture_of[surface]
            if texture >= 0:
                r, g, b = _mapped(texels, decode, offset, size, first, texture, uv, gradient, f, b1, b2, width)
                red, green, blue = red * r, green * g, blue * b
        rest = (_ONE - metallic) * DIELECTRIC
        a, b = directional_albedo(albedo, roughness, cosine)
        red = (rest + metallic * red) * a + b
        green = (rest + metallic * green) * a + b
        blue = (rest + metallic * blue) * a + b
        traced = min(max((np.float32(TRACING_LIMIT) - roughness) / np.float32(TRACING_LIMIT - TRACED), _ZERO), _ONE)
        through = _ONE
        if coat > _ZERO:  # the rays are the coat's, the base reflects the mean
            a, b = directional_albedo(albedo, _ZERO, cosine)
            covered = coat * (DIELECTRIC * a + b)
            through, traced, roughness = _ONE - covered, _ZERO, _ZERO
            weight[k, 0] = weight[k, 1] = weight[k, 2] = covered
        else:
            weight[k, 0], weight[k, 1], weight[k, 2] = traced * red, traced * green, traced * blue
        kept = (_ONE - metallic) * (_ONE - clear) * through
        r = g = b = _ZERO
        if traced < _ONE:
            r, g, b = _baked(light_texels, light_offset, light_size, light_uv, light_of[surface], f, b1, b2)
            r, g, b = gains[0] * r, gains[1] * g, gains[2] * b
        mean = (_ONE - traced) * through
        for c, add in ((0, red * r), (1, green * g), (2, blue * b)):
            glow = emission[surface, c]
            light[i, c] = glow + kept * (light[i, c] - glow) + mean * add
        if weight[k, 0] + weight[k, 1] + weight[k, 2] <= _ZERO:
            for c in range(3):
                directions[k, c] = cone[k, c] = _ZERO
            continue
        alpha = roughness * roughness
        hx, hy, hz = nx, ny, nz
        if roughness < MIRROR:
            alpha = _ZERO
        else:
            pixel = pixels[i] if samples == 1 else pixels[i // samples]
            y = pixel // view.width
            x = pixel - y * view.width
            sparse = 1 if samples == 1 and roughness > HALVED and _is_flat(corner, f) else 0
            if sparse == 1 and (x + y) % 2 == 1:
                directions[k, 0] = directions[k, 1] = directions[k, 2] = _ZERO
                cone[k, 0], cone[k, 1], cone[k, 2] = width, step, -alpha
                continue
            x += 3 * (i % samples)
            one, other = points[sparse, y % BLOCK, x % BLOCK, 0], points[sparse, y % BLOCK, x % BLOCK, 1]
            hx, hy, hz = lobe_normal(-dx, -dy, -dz, nx, ny, nz, alpha, one, other)
        directions[k, 0], directions[k, 1], directions[k, 2] = _mirrored(dx, dy, dz, hx, hy, hz, gx, gy, gz)
        far = distance[i]
        for c in range(3):
            origins[k, c] = np.float32(view.origin[c]) + far * direction[i, c]
        origins[k, 0] += LIFT * gx
        origins[k, 1] += LIFT * gy
        origins[k, 2] += LIFT * gz
        cone[k, 0], cone[k, 1], cone[k, 2] = width, step + PART * alpha, alpha


@njit
def gather(owner: I32, throughput: F32, origins: F32, directions: F32, cone: F32) -> int:
    """Move rays that have a direction to the beginning of the arrays; returns how many they are, see `follow`."""
    count = 0
    for k in range(owner.shape[0]):
        if directions[k, 0] == _ZERO and directions[k, 1] == _ZERO and directions[k, 2] == _ZERO:
            continue
        for c in range(3):
            origins[count, c], directions[count, c], cone[count, c] = origins[k, c], directions[k, c], cone[k, c]
            throughput[count, c] = _ONE
        owner[count] = k
        count += 1
    return count


@njit
def see_through(
    rows: I32,
    face: I32,
    distance: F32,
    u: F32,
    v: F32,
    direction: F32,
    view: PinholeView,
    spread: float,
    tables: SceneTables,
    weight: F32,
    origins: F32,
    directions: F32,
    cone: F32,
) -> int:
    """Rays that go on straight through the clear ones of the hits ``rows``; see `reflect`.

    Returns:
        How many they are; ``rows`` then begins with their hits, and ``weight`` and the other arrays with their rays.
    """
    step = np.float32(
        spread
        * math.sqrt(view.right[0] * view.right[0] + view.right[1] * view.right[1] + view.right[2] * view.right[2])
    )
    surfaces, shine, finish, base = tables.surface, tables.shine, tables.finish, tables.colour
    plane, gradient, uv, texture_of = tables.normal, tables.gradient, tables.uv, tables.texture
    texels, offset, size, first, decode = tables.textures
    count = 0
    for k in range(rows.shape[0]):
        i = rows[k]
        f = face[i]
        surface = surfaces[f]
        if shine[surface] != CLEAR:
            continue
        dx, dy, dz = _normalised(direction[i, 0], direction[i, 1], direction[i, 2])
        cosine = abs(plane[f, 0] * dx + plane[f, 1] * dy + plane[f, 2] * dz)
        width = distance[i] * step
        b1, b2 = u[i], v[i]
        red, green, blue = base[surface, 0], base[surface, 1], base[surface, 2]
        texture = texture_of[surface]
        if texture >= 0:
            r, g, b = _mapped(texels, decode, offset, size, first, texture, uv, gradient, f, b1, b2, width)
            red, green, blue = red * r, green * g, blue * b
        enters = finish[surface, 2] * (_ONE - schlick(DIELECTRIC, cosine))
        weight[count, 0], weight[count, 1], weight[count, 2] = enters * red, enters * green, enters * blue
        far = distance[i]
        for c in range(3):
            origins[count, c] = np.float32(view.origin[c]) + far * direction[i, c]
        origins[count, 0] += LIFT * dx
        origins[count, 1] += LIFT * dy
        origins[count, 2] += LIFT * dz
        directions[count, 0], directions[count, 1], directions[count, 2] = dx, dy, dz
        cone[count, 0], cone[count, 1], cone[count, 2] = width, step, _ZERO
        rows[count] = i
        count += 1
    return count


@inline
def _radiance_of(table: F32, display: np.float32) -> np.float32:
    """Radiance times exposure that the tone curve shows as ``display``, from `SceneTables.undeveloped`."""
    last = table.shape[0] - 1
    x = min(max(display, _ZERO), _ONE) * np.float32(last)
    i = min(int(x), last - 1)
    return np.float32(table[i] + (x - np.float32(i)) * (table[i + 1] - table[i]))


@inline
def _most(area: np.float32, alpha: np.float32, distance: np.float32) -> np.float32:
    """The most radiance that a ray of a lobe of width ``alpha`` (0: a mirror) brings from a lamp of ``area`` (m²).

    Of the lobe's rays the share p meets the lamp, which is about its area over that of the lobe there. The mean over
    few rays varies by √(1/p − 1) of itself: with a small lamp, rays that meet it by chance would be seen as dots.
    Pixels' rays are stratified, which counts as `STRATIFIED` times as many.
    """
    across = WIDTH * alpha * distance
    return FIREFLY * (_ONE + STRATIFIED * area / max(np.float32(math.pi) * across * across, _TINY))


@njit
def follow(
    face: I32,
    distance: F32,
    u: F32,
    v: F32,
    owner: I32,
    throughput: F32,
    origins: F32,
    directions: F32,
    cone: F32,
    tables: SceneTables,
    is_last: bool,
    seen: F32,
) -> int:
    """Add what rays meet to ``seen``, and send on those that meet a mirror or a clear pane.

    Metals that are no mirrors count as matte surfaces of their colour, and so does what the ``is_last`` rays meet.

    Args:
        face: (N,) face that each ray meets, −1 for none; so for distance (m), u, v.
        distance: (N,).
        u: (N,).
        v: (N,).
        owner: (N,) row of ``seen``.
        throughput: (N, 3) factor of what is met.
        origins: (N, 3).
        directions: (N, 3) unit vectors.
        cone: (N, 3) see `reflect`.
        tables: the scene.
        is_last: no ray goes on.
        seen: (M, 3) is added to.

    Returns:
        How many rays go on: the first of the arrays that describe rays are then theirs.
    """
    surfaces, shine, finish, base = tables.surface, tables.shine, tables.finish, tables.colour
    plane, corner, gradient, uv, light_uv = (
        tables.normal,
        tables.corner_normal,
        tables.gradient,
        tables.uv,
        tables.light_uv,
    )
    texture_of, light_of, bumps, roughening = tables.texture, tables.light, tables.bumps, tables.roughening
    light_texels, light_offset, light_size = tables.light_texels, tables.light_offset, tables.light_size
    texels, offset, size, first, decode = tables.textures
    map_texels, map_offset, map_size, map_first, map_decode = tables.maps
    gains = tables.gains
    developed, glow, undeveloped = tables.developed, tables.glow, tables.undeveloped
    view_distance, shown, lamp_area = tables.view_distance, tables.albedo, tables.lamp_area
    count = 0
    for i in range(face.shape[0]):
        f, row = face[i], owner[i]
        tr, tg, tb = throughput[i, 0], throughput[i, 1], throughput[i, 2]
        if f < 0:
            miss = _radiance_of(undeveloped, MISS)
            seen[row, 0] += tr * miss
            seen[row, 1] += tg * miss
            seen[row, 2] += tb * miss
            continue
        surface = surfaces[f]
        b1, b2 = u[i], v[i]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        gx, gy, gz = plane[f, 0], plane[f, 1], plane[f, 2]
        facing = gx * dx + gy * dy + gz * dz
        side = -_ONE if facing > _ZERO else _ONE
        width = cone[i, 0] + cone[i, 1] * distance[i]
        texture = texture_of[surface]
        if view_distance[surface] > _ZERO and texture >= 0 and side > _ZERO and cone[i, 2] == _ZERO:
            # What a mirror shows through a window; lobes meet its mean light, strip by strip.
            s, t = _at(uv, f, b1, b2)
            further = view_distance[surface] / max(-facing, np.float32(1e-6))
            s, t, width = _beyond(gradient, f, s, t, dx, dy, dz, further, width + cone[i, 1] * further)
            last = first[texture + 1] - 1
            r, g, b = _texel(texels, decode, offset, size, first[texture], last, s, t, width)
            seen[row, 0] += tr * shown[surface, 0] * r
            seen[row, 1] += tg * shown[surface, 1] * g
            seen[row, 2] += tb * shown[surface, 2] * b
            continue
        red, green, blue = base[surface, 0], base[surface, 1], base[surface, 2]
        if texture >= 0:
            r, g, b = _mapped(texels, decode, offset, size, first, texture, uv, gradient, f, b1, b2, width)
            red, green, blue = red * r, green * g, blue * b
        kept, goes_on = _ONE, False
        nr = ng = nb = _ZERO
        if not is_last and shine[surface] >= GLOSSY:
            roughness, metallic = finish[surface, 0], finish[surface, 1]
            number = roughening[surface]
            if number >= 0:
                _, g, b = _mapped(
                    map_texels, map_decode, map_offset, map_size, map_first, number, uv, gradient, f, b1, b2, width
                )
                roughness, metallic = roughness * g, metallic * b
            clear = finish[surface, 2]
            if clear > _ZERO:
                enters = clear * (_ONE - schlick(DIELECTRIC, abs(facing)))
                nr, ng, nb = enters * red, enters * green, enters * blue
                kept, goes_on = _ONE - clear, True
            elif metallic > _HALF and roughness < BRIGHT:
                nx, ny, nz = _corner_mean(corner, plane, f, b1, b2)
                number = bumps[surface]
                if number >= 0:
                    bump = _mapped(
                        map_texels, map_decode, map_offset, map_size, map_first, number, uv, gradient, f, b1, b2, width
                    )
                    nx, ny, nz = _bumped(gradient, f, nx, ny, nz, bump)
                nx, ny, nz = side * nx, side * ny, side * nz
                nx, ny, nz, cosine = _facing(nx, ny, nz, -dx, -dy, -dz)
                nr, ng, nb = schlick(red, cosine), schlick(green, cosine), schlick(blue, cosine)
                kept, goes_on = _ZERO, True
        if developed[surface]:
            r, g, b = _baked(light_texels, light_offset, light_size, light_uv, light_of[surface], f, b1, b2)
            lr, lg, lb = red * r, green * g, blue * b
            lr, lg, lb = _radiance_of(undeveloped, lr), _radiance_of(undeveloped, lg), _radiance_of(undeveloped, lb)
        else:
            lr = lg = lb = _ZERO
            if kept > _ZERO:
                r, g, b = _baked(light_texels, light_offset, light_size, light_uv, light_of[surface], f, b1, b2)
                r, g, b = gains[0] * r, gains[1] * g, gains[2] * b
                lr, lg, lb = kept * red * r, kept * green * g, kept * blue * b
            if side > _ZERO:
                most = _most(lamp_area[surface], cone[i, 2], distance[i])
                lr += min(glow[surface, 0], most)
                lg += min(glow[surface, 1], most)
                lb += min(glow[surface, 2], most)
        seen[row, 0] += tr * lr
        seen[row, 1] += tg * lg
        seen[row, 2] += tb * lb
        if not goes_on:
            continue
        far = distance[i]
        px, py, pz = origins[i, 0] + far * dx, origins[i, 1] + far * dy, origins[i, 2] + far * dz
        if kept > _ZERO or finish[surface, 2] > _ZERO:
            origins[count, 0], origins[count, 1], origins[count, 2] = px + LIFT * dx, py + LIFT * dy, pz + LIFT * dz
        else:
            gx, gy, gz = side * gx, side * gy, side * gz
            dx, dy, dz = _mirrored(dx, dy, dz, nx, ny, nz, gx, gy, gz)
            origins[count, 0], origins[count, 1], origins[count, 2] = px + LIFT * gx, py + LIFT * gy, pz + LIFT * gz
        directions[count, 0], directions[count, 1], directions[count, 2] = dx, dy, dz
        cone[count, 0], cone[count, 1], cone[count, 2] = width, cone[i, 1], cone[i, 2]
        throughput[count, 0], throughput[count, 1], throughput[count, 2] = tr * nr, tg * ng, tb * nb
        owner[count] = row
        count += 1
    return count


@njit
def keep_lobes(
    rows: I32,
    distance: F32,
    first: I32,
    reach: F32,
    cone: F32,
    weight: F32,
    seen: F32,
    lobe: F32,
    factor: F32,
    radius: F32,
    alpha: F32,
    second: I32,
) -> None:
    """Write what rays of the hits ``rows`` (M,) have brought into the arrays of a frame's pixels.

    Args:
        rows: the pixels.
        distance: (N,) depth of the hits.
        first: (M,) face that each ray met.
        reach: (M,) how far away it was (m).
        cone: (M, 3) see `reflect`, as it was at the start.
        weight: (M, 3).
        seen: (M, 3).
        lobe: (N, 3) radiance.
        factor: (N, 3) what it is multiplied by.
        radius: (N,) of the average (pixels): 0 for none, −1 where there is no lobe.
        alpha: (N,) of the lobe, negative where it has no ray.
        second: (N,) face that a mirror shows, −1 elsewhere.
    """
    for k in range(rows.shape[0]):
        i = rows[k]
        for c in range(3):
            lobe[i, c], factor[i, c] = seen[k, c], weight[k, c]
        alpha[i] = cone[k, 2]
        radius[i] = _ZERO
        if weight[k, 0] + weight[k, 1] + weight[k, 2] <= _ZERO:
            radius[i] = -_ONE
        elif cone[k, 2] < _ZERO:
            radius[i] = WIDEST
        elif cone[k, 2] > _ZERO:
            far = distance[i]
            pixel = cone[k, 0] / max(far, np.float32(1e-6))
            ratio = reach[k] / (reach[k] + far)
            radius[i] = min(max(SHARE * WIDTH * cone[k, 2] * ratio / pixel, LEAST), WIDEST)
        else:
            second[i] = first[k]


@njit
def smooth(
    face: I32,
    tables: SceneTables,
    lobe: F32,
    radius: F32,
    alpha: F32,
    width: int,
    height: int,
    down: bool,
    first: int,
    last: int,
    out: F32,
) -> None:
    """Average the radiance of lobes along the rows, then ``down`` the columns, of a picture's pixels first to last.

    Only pixels of one surface count whose normals differ by less than the lobe is wide. On what is no metal the
    brightest of them counts at most `LONE` times the mean of the others.
    """
    surfaces, normal, finish = tables.surface, tables.normal, tables.finish
    stride, length = (width, height) if down else (1, width)
    row = first // width
    column = first - row * width - 1
    for i in range(first, last):
        column += 1  # a division for each pixel would take a tenth of the time
        if column == width:
            column, row = 0, row + 1
        around = radius[i]
        if around < _ZERO:  # nobody reads it
            continue
        if around <= _HALF:
            for c in range(3):
                out[i, c] = lobe[i, c]
            continue
        if alpha[i] < _ZERO:  # without a ray: those on the left and right have one
            if column > 0 and radius[i - 1] > _ZERO and alpha[i - 1] > _ZERO:
                around = min(around, radius[i - 1])
            if column + 1 < width and radius[i + 1] > _ZERO and alpha[i + 1] > _ZERO:
                around = min(around, radius[i + 1])
        place = row if down else column
        f = face[i]
        surface = surfaces[f]
        nx, ny, nz = normal[f, 0], normal[f, 1], normal[f, 2]
        lean = alpha[i] * alpha[i] + np.float32(1e-6)
        reach, fall = int(around), _ONE / (around + _ONE)
        red = green = blue = total = _ZERO
        top = share = _ZERO
        brightest = i
        for away in range(max(-reach, -place), min(reach, length - 1 - place) + 1):
            j = i + away * stride
            if radius[j] < _ZERO or (alpha[j] < _ZERO and not down):
                continue
            h = face[j]
            if h != f:
                if surfaces[h] != surface:
                    continue
                turn = _ONE - (nx * normal[h, 0] + ny * normal[h, 1] + nz * normal[h, 2])
                if turn > lean:
                    continue
            w = _ONE - np.float32(abs(away)) * fall
            red += w * lobe[j, 0]
            green += w * lobe[j, 1]
            blue += w * lobe[j, 2]
            total += w
            if lobe[j, 1] > top:
                top, share, brightest = lobe[j, 1], w, j
        total = max(total, _TINY)
        rest = total - share
        most = LONE * (green - share * top) / max(rest, _TINY)
        # A ray that met a small lamp by chance would be seen as a dot; on metals, which are dark but for what they
        # reflect, as the lamp's highlight.
        if rest > _TINY and top > most and finish[surface, 1] < _HALF:
            less = share * (_ONE - most / top)
            red -= less * lobe[brightest, 0]
            green -= less * lobe[brightest, 1]
            blue -= less * lobe[brightest, 2]
        out[i, 0], out[i, 1], out[i, 2] = red / total, green / total, blue / total


@njit
def add_lobes(factor: F32, radius: F32, lobe: F32, light: F32) -> None:
    """Add ``factor`` · ``lobe`` to the radiance of the pixels that have one."""
    for i in range(light.shape[0]):
        if radius[i] >= _ZERO:
            for c in range(3):
                light[i, c] += factor[i, c] * lobe[i, c]


@njit
def reuse(
    rows: I32,
    face: I32,
    pixels: I32,
    samples: int,
    shown: I32,
    tables: SceneTables,
    radius: F32,
    lobe: F32,
    width: int,
    height: int,
    weight: F32,
    directions: F32,
    light: F32,
) -> None:
    """Add the averaged radiance of pixels around to further rays of a pixel that meet the same rough surface.

    Args:
        rows: (M,) the hits that count.
        face: (N,) of all hits.
        pixels: number of the pixel of each ``samples`` hits.
        samples: rays of a pixel.
        shown: (P,) face at each pixel's centre.
        tables: the scene.
        radius: (P,) see `keep_lobes`.
        lobe: (P, 3) averaged.
        width: of the picture.
        height: of the picture.
        weight: (M, 3) factor of the lobe's radiance; set to 0 where it has been added.
        directions: (M, 3) of the rays; the same.
        light: (N, 3) radiance of the hits.
    """
    surfaces, plane, corner, finish = tables.surface, tables.normal, tables.corner_normal, tables.finish
    for k in range(rows.shape[0]):
        if weight[k, 0] + weight[k, 1] + weight[k, 2] <= _ZERO:
            continue
        i = rows[k]
        f = face[i]
        surface = surfaces[f]
        if finish[surface, 1] > _HALF and not _is_flat(corner, f):  # what a thin rod shows changes within a pixel
            continue
        pixel = pixels[i // samples]
        y = pixel // width
        x = pixel - y * width
        found = -1
        for n in range(9):
            m = (n + 4) % 9  # the pixel itself first
            column, row = x + m % 3 - 1, y + m // 3 - 1
            if column < 0 or row < 0 or column >= width or row >= height:
                continue
            j = row * width + column
            h = shown[j]
            if h < 0 or radius[j] <= _ZERO or surfaces[h] != surface:
                continue
            turn = _ZERO
            for c in range(3):
                turn += plane[f, c] * plane[h, c]
            if turn > np.float32(0.98):
                found = j
                break
        if found >= 0:
            for c in range(3):
                light[i, c] += weight[k, c] * lobe[found, c]
                weight[k, c] = directions[k, c] = _ZERO


@njit
def mark_mirrored(second: I32, rgb: U8, width: int, contrast: int, marks: U8, first: int, last: int) -> None:
    """Set ``marks`` at neighbours in which a mirror shows different faces in colours that differ by ``contrast``."""
    for i in range(first, last):
        if second[i] < 0:
            continue
        for j, inside in ((i + 1, (i + 1) % width != 0), (i + width, i + width < second.shape[0])):
            if not inside or second[j] < 0 or second[i] == second[j]:
                continue
            for c in range(3):
                if abs(np.int32(rgb[i, c]) - np.int32(rgb[j, c])) > contrast:
                    marks[i] = marks[j] = 1
