"""The compiled loops that draw splats: projection, tiles, compositing.

The model of the picture is that of 3D-GS (Kerbl et al. 2023) and gsplat: EWA splatting (Zwicker, Pfister, van Baar,
Gross, "EWA volume splatting", IEEE Visualization 2001, eq. 24 to 31) with the local affine approximation of the
perspective, its centre clamped to 1.3 times the field of view; 0.3 px² are added to the variances; α = min(0.999,
opacity · exp(−σ)) at pixel centres; an α below 1/255 is skipped; Gaussians are sorted by the depth of their centres,
equal ones by their number; a pixel ends before its transmittance would fall to 1e-4.

Beside the whole picture, each pixel with an object in it gets the sums of what is in front of the object. Whether a
Gaussian is in front is decided in each pixel, by the depth at which its density along the pixel's ray is greatest: with
covariance Σ of (column, row, depth) in the affine approximation, z + Σ_zu Σ_uu⁻¹ (u − μ), the conditional mean. (Tables
are made of discs as large as a hand. By the depth of their centres, those that reach behind an object would cover it
there.) 1/z is taken to be linear instead of z, which is exact for discs.
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

#: Variance that is added in the image (px²).
BLUR = 0.3
#: No α is above this, none below that counts, and a pixel ends at this transmittance.
MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE = 0.999, 1.0 / 255.0, 1e-4
#: Centres nearer than this (m along the optical axis) are not drawn: floaters before the lens.
NEAR = 0.05
#: The affine approximation is taken no further out than this many half fields of view beyond the image's edge.
MARGIN = 0.3
#: Side of a tile (pixels).
TILE = 16
#: Linear display light of the mesh below which its shade is not measured, and the most that objects brighten it.
DARKEST, BRIGHTENED = 1e-3, 2.0
#: Columns of `project`'s rows: centre, inverse covariance, α, colour, 1/depth and its slopes, 2·ln(α/MIN_ALPHA).
ROW = 13


class SplatCamera(NamedTuple):
    """A pinhole camera for the kernels, in OpenCV's axes.

    Attributes:
        right: (3,) world unit vector; also down, ahead.
        origin: (3,) world position, metres.
        fx: focal length in pixels; also fy, cx, cy.
        width: pixels.
        height: pixels.
    """

    right: tuple[float, float, float]
    down: tuple[float, float, float]
    ahead: tuple[float, float, float]
    origin: tuple[float, float, float]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


@inline
def _basis(x: float, y: float, z: float, bands: int, out: F64) -> None:
    """Real spherical harmonics of a unit vector in the order and signs of 3D-GS (Sloan 2013, with Condon–Shortley)."""
    out[0] = 0.28209479177387814
    if bands > 1:
        out[1] = -0.4886025119029199 * y
        out[2] = 0.4886025119029199 * z
        out[3] = -0.4886025119029199 * x
    if bands > 4:
        out[4] = 1.0925484305920792 * x * y
        out[5] = -1.0925484305920792 * y * z
        out[6] = 0.31539156525252005 * (3.0 * z * z - 1.0)
        out[7] = -1.0925484305920792 * x * z
        out[8] = 0.5462742152960396 * (x * x - y * y)
    if bands > 9:
        out[9] = -0.5900435899266435 * y * (3.0 * x * x - y * y)
        out[10] = 2.890611442640554 * x * y * z
        out[11] = -0.4570457994644658 * y * (5.0 * z * z - 1.0)
        out[12] = 0.3731763325901154 * z * (5.0 * z * z - 3.0)
        out[13] = -0.4570457994644658 * x * (5.0 * z * z - 1.0)
        out[14] = 1.445305721320277 * z * (x * x - y * y)
        out[15] = -0.5900435899266435 * x * (x * x - 3.0 * y * y)


@njit
def harmonics(directions: F64, out: F64) -> None:
    """Real spherical harmonics (D, K) of unit vectors (D, 3)."""
    for i in range(directions.shape[0]):
        _basis(directions[i, 0], directions[i, 1], directions[i, 2], out.shape[1], out[i])


@inline
def _dot(a: tuple[float, float, float], x: float, y: float, z: float) -> float:
    return a[0] * x + a[1] * y + a[2] * z


@inline
def _slanted(
    axis: tuple[float, float, float], ahead: tuple[float, float, float], slope: float
) -> tuple[float, float, float]:
    return axis[0] - slope * ahead[0], axis[1] - slope * ahead[1], axis[2] - slope * ahead[2]


@njit
def project(
    means: F32, covariances: F32, opacities: F32, sh: F32, camera: SplatCamera, rows: F32, boxes: I32, depths: F32
) -> int:
    """Project the Gaussians that reach α ≥ 1/255 in the image; returns their number V.

    Args:
        means: (N, 3) metres.
        covariances: (N, 6) xx, xy, xz, yy, yz, zz in m².
        opacities: (N,) 0 to 1.
        sh: (N, K, 3).
        camera: from where.
        rows: (N, ROW), of which V are written.
        boxes: (N, 4) first and last column, first and last row that they reach, of which V are written.
        depths: (N,) along the optical axis, of which V are written.
    """
    count = 0
    bands = sh.shape[1]
    basis = np.empty(16)
    fx, fy, cx, cy, width, height = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    least_u = -cx / fx - MARGIN * 0.5 * width / fx
    most_u = (width - cx) / fx + MARGIN * 0.5 * width / fx
    least_v = -cy / fy - MARGIN * 0.5 * height / fy
    most_v = (height - cy) / fy + MARGIN * 0.5 * height / fy
    for i in range(means.shape[0]):
        px, py, pz = means[i, 0] - camera.origin[0], means[i, 1] - camera.origin[1], means[i, 2] - camera.origin[2]
        z = _dot(camera.ahead, px, py, pz)
        alpha = float(opacities[i])
        if not (z > NEAR and alpha >= MIN_ALPHA):
            continue
        u, v = _dot(camera.right, px, py, pz) / z, _dot(camera.down, px, py, pz) / z
        eu, ev = min(max(u, least_u), most_u), min(max(v, least_v), most_v)
        # Rows of the Jacobian times world-to-camera.
        ux, uy, uz = _slanted(camera.right, camera.ahead, eu)
        vx, vy, vz = _slanted(camera.down, camera.ahead, ev)
        sxx, sxy, sxz = float(covariances[i, 0]), float(covariances[i, 1]), float(covariances[i, 2])
        syy, syz, szz = float(covariances[i, 3]), float(covariances[i, 4]), float(covariances[i, 5])
        # Σ·u and Σ·v.
        ax, ay, az = sxx * ux + sxy * uy + sxz * uz, sxy * ux + syy * uy + syz * uz, sxz * ux + syz * uy + szz * uz
        bx, by, bz = sxx * vx + sxy * vy + sxz * vz, sxy * vx + syy * vy + syz * vz, sxz * vx + syz * vy + szz * vz
        kx, ky = fx / z, fy / z
        uu = kx * kx * (ux * ax + uy * ay + uz * az) + BLUR
        uv = kx * ky * (vx * ax + vy * ay + vz * az)
        vv = ky * ky * (vx * bx + vy * by + vz * bz) + BLUR
        determinant = uu * vv - uv * uv
        if not determinant > 1e-10:
            continue
        reach = 2.0 * math.log(alpha / MIN_ALPHA)
        mu, mv = fx * u + cx, fy * v + cy
        wide, tall = math.sqrt(reach * uu), math.sqrt(reach * vv)
        left, right = max(0.0, math.ceil(mu - wide - 0.5)), min(width - 1.0, math.floor(mu + wide - 0.5))
        top, bottom = max(0.0, math.ceil(mv - tall - 0.5)), min(height - 1.0, math.floor(mv + tall - 0.5))
        if not (left <= right and top <= bottom):
            continue
        a, b, c = vv / determinant, -uv / determinant, uu / determinant
        zu, zv = kx * _dot(camera.ahead, ax, ay, az), ky * _dot(camera.ahead, bx, by, bz)
        distance = math.sqrt(px * px + py * py + pz * pz)
        _basis(px / distance, py / distance, pz / distance, bands, basis)
        rows[count, 0], rows[count, 1] = mu, mv
        rows[count, 2], rows[count, 3], rows[count, 4] = a, b, c
        rows[count, 5] = alpha
        for channel in range(3):
            colour = 0.5
            for k in range(bands):
                colour += basis[k] * sh[i, k, channel]
            rows[count, 6 + channel] = max(colour, 0.0)
        rows[count, 9] = 1.0 / z
        rows[count, 10] = -(zu * a + zv * b) / (z * z)
        rows[count, 11] = -(zu * b + zv * c) / (z * z)
        rows[count, 12] = reach
        boxes[count, 0], boxes[count, 1] = int(left), int(right)
        boxes[count, 2], boxes[count, 3] = int(top), int(bottom)
        depths[count] = z
        count += 1
    return count


@njit
def count_tiles(boxes: I32, wide: int, wanted: U8, counts: NDArray[np.int64]) -> None:
    """Add to ``counts`` (tiles,) how many of the boxes meet each of the ``wanted`` tiles; ``wide`` tiles make a row."""
    for i in range(boxes.shape[0]):
        for row in range(boxes[i, 2] // TILE, boxes[i, 3] // TILE + 1):
            for column in range(boxes[i, 0] // TILE, boxes[i, 1] // TILE + 1):
                counts[row * wide + column] += wanted[row * wide + column]


@njit
def fill_tiles(boxes: I32, wide: int, wanted: U8, following: NDArray[np.int64], entries: I32) -> None:
    """Write the numbers of the boxes to the places of their tiles, in order; ``following`` are the first places."""
    for i in range(boxes.shape[0]):
        for row in range(boxes[i, 2] // TILE, boxes[i, 3] // TILE + 1):
            for column in range(boxes[i, 0] // TILE, boxes[i, 1] // TILE + 1):
                tile = row * wide + column
                if wanted[tile]:
                    entries[following[tile]] = i
                    following[tile] += 1


@njit
def composite(
    rows: F32, boxes: I32, starts: NDArray[np.int64], entries: I32, wide: int, cut: F32, whole: F32, front: F32
) -> None:
    """Composite front to back.

    Args:
        rows: (V, ROW) of `project`, nearest first; ``boxes`` (V, 4) likewise.
        boxes: see ``rows``.
        starts: (tiles + 1,) where each tile's entries begin.
        entries: rows of each tile, nearest first.
        wide: tiles in a row.
        cut: (H, W) 1/depth of the object in a pixel, 0 where there is none.
        whole: (H, W, 5) Σ T·α·colour, transmittance, Σ T·α/z; must be (0, 0, 0, 1, 0) at first.
        front: (H, W, 4) the first four of what is in front of the object; must be (0, 0, 0, 1) at first.
    """
    height, width = cut.shape
    is_open = np.empty((TILE, TILE), dtype=np.uint8)  # 1: the whole, 2: what is in front
    for tile in range(starts.shape[0] - 1):
        x0, y0 = tile % wide * TILE, tile // wide * TILE
        x1, y1 = min(x0 + TILE, width), min(y0 + TILE, height)
        left_open = 0
        for y in range(y0, y1):
            for x in range(x0, x1):
                is_open[y - y0, x - x0] = 3 if cut[y, x] > 0 else 1
                left_open += 1
        for entry in range(starts[tile], starts[tile + 1]):
            if left_open == 0:
                break
            i = entries[entry]
            mu, mv, a, b, c = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4]
            opacity, red, green, blue, nearness = rows[i, 5], rows[i, 6], rows[i, 7], rows[i, 8], rows[i, 9]
            slope_x, slope_y, reach = rows[i, 10], rows[i, 11], rows[i, 12]
            inverse = np.float32(1.0) / a
            for y in range(max(y0, boxes[i, 2]), min(y1, boxes[i, 3] + 1)):
                # The columns at which a dx² + 2 b dx dy + c dy² ≤ reach.
                dy = np.float32(y + 0.5) - mv
                half = (b * dy) ** 2 - a * (c * dy * dy - reach)
                if half < 0:
                    continue
                half = math.sqrt(half) * inverse
                middle = mu - b * dy * inverse - np.float32(0.5)
                first, last = max(x0, math.ceil(middle - half)), min(x1 - 1, math.floor(middle + half))
                for x in range(first, last + 1):
                    state = is_open[y - y0, x - x0]
                    if state == 0:
                        continue
                    dx = np.float32(x + 0.5) - mu
                    power = np.float32(-0.5) * (a * dx * dx + c * dy * dy) - b * dx * dy
                    alpha = min(np.float32(MAX_ALPHA), opacity * math.exp(power))
                    if alpha < np.float32(MIN_ALPHA):
                        continue
                    near = nearness + slope_x * dx + slope_y * dy
                    if state & 1:
                        left = whole[y, x, 3] * (np.float32(1.0) - alpha)
                        if left <= np.float32(MIN_TRANSMITTANCE):
                            state &= 2
                        else:
                            weight = whole[y, x, 3] * alpha
                            whole[y, x, 0] += weight * red
                            whole[y, x, 1] += weight * green
                            whole[y, x, 2] += weight * blue
                            whole[y, x, 3] = left
                            whole[y, x, 4] += weight * near
                    if state & 2 and near > cut[y, x]:
                        left = front[y, x, 3] * (np.float32(1.0) - alpha)
                        if left <= np.float32(MIN_TRANSMITTANCE):
                            state &= 1
                        else:
                            weight = front[y, x, 3] * alpha
                            front[y, x, 0] += weight * red
                            front[y, x, 1] += weight * green
                            front[y, x, 2] += weight * blue
                            front[y, x, 3] = left
                    if state != is_open[y - y0, x - x0]:
                        is_open[y - y0, x - x0] = state
                        left_open -= state == 0


@inline
def _encoded(light: float) -> float:
    """SRGB value of linear light (IEC 61966-2-1), both 0 to 1."""
    light = min(max(light, 0.0), 1.0)
    return 12.92 * light if light <= 0.0031308 else 1.055 * light ** (1.0 / 2.4) - 0.055


@inline
def _decoded(value: float) -> float:
    """Linear light of an sRGB value."""
    value = min(max(value, 0.0), 1.0)
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


@njit
def develop(whole: F32, front: F32, inserted: F32, cover: F32, behind: F32, plain: F32, out: U8) -> None:
    """The picture of P pixels, from what splats, objects and mesh show in them.

    Splats were fitted to pictures, so light is attenuated in sRGB values, as they are composited; the shares of a pixel
    are mixed in linear light, as in other pictures.

    Args:
        whole: (P, 5) of `composite`.
        front: (P, 4) of `composite`.
        inserted: (P, 3) linear display light of the objects times the share ``cover``.
        cover: (P,) share of the pixel in which an object is visible.
        behind: (P, 3) linear display light of the mesh times 1 − ``cover``: it is seen where splats are transparent.
        plain: (P, 3) ``behind`` without the shade of the objects: what is seen of the splats is dimmed as the mesh is.
        out: (P, 3) 8-bit sRGB.
    """
    for i in range(out.shape[0]):
        share = float(cover[i])
        for k in range(3):
            light = 0.0
            if share < 1.0:
                value = whole[i, k] + whole[i, 3] * _encoded(plain[i, k] / (1.0 - share))
                shade = behind[i, k] / plain[i, k] if plain[i, k] > DARKEST else 1.0
                if share == 0.0 and shade == 1.0:
                    out[i, k] = int(255.0 * min(max(value, 0.0), 1.0) + 0.5)
                    continue
                light = (1.0 - share) * min(shade, BRIGHTENED) * _decoded(value)
            if share > 0.0:
                light += share * _decoded(front[i, k] + front[i, 3] * _encoded(inserted[i, k] / share))
            out[i, k] = int(255.0 * _encoded(light) + 0.5)


@njit
def part_light(
    face: I32, light: F32, samples: int, pixels: I32, tables: SceneTables, inserted: F32, behind: F32
) -> None:
    """Sum up the light of P pixels by what gives it: objects, or the mesh.

    Args:
        face: (P·samples,) what each ray meets, −1 for nothing.
        light: (P·samples, 3) linear display light.
        samples: rays per pixel.
        pixels: (P,) which rows of the following arrays.
        tables: of the scene.
        inserted: (H·W, 3) is set to the mean light of the rays, those counting 0 that meet no object.
        behind: (H·W, 3) is set to that of the others.
    """
    weight = np.float32(1.0 / samples)
    for i in range(pixels.shape[0]):
        pixel = pixels[i]
        for k in range(3):
            inserted[pixel, k] = behind[pixel, k] = np.float32(0.0)
        for j in range(i * samples, (i + 1) * samples):
            is_object = face[j] >= 0 and tables.instance[tables.surface[face[j]]] > 0
            for k in range(3):
                if is_object:
                    inserted[pixel, k] += weight * light[j, k]
                else:
                    behind[pixel, k] += weight * light[j, k]


@njit
def part_cover(
    face: I32, distance: F32, samples: int, pixels: I32, tables: SceneTables, cover: F32, nearest: F32
) -> None:
    """Find the share of P pixels in which objects are visible, and how near these are.

    Args:
        face: (P·samples,) what each ray meets, −1 for nothing.
        distance: (P·samples,) depth along the optical axis, metres.
        samples: rays per pixel.
        pixels: (P,) which rows of the following arrays.
        tables: of the scene.
        cover: (H·W,) is set to the share of the rays that meet objects.
        nearest: (H·W,) is set to the least depth of an object; infinite where there is none.
    """
    for i in range(pixels.shape[0]):
        pixel = pixels[i]
        met, nearest[pixel] = 0, np.float32(np.inf)
        for j in range(i * samples, (i + 1) * samples):
            if face[j] >= 0 and tables.instance[tables.surface[face[j]]] > 0:
                met += 1
                nearest[pixel] = min(nearest[pixel], distance[j])
        cover[pixel] = np.float32(met / samples)
