"""Periodic noise and colour arithmetic, from which all procedural textures are made.

Images are float64 (H, W) fields or (H, W, 3) sRGB colours in [0, 1], row 0 at the top; every field wraps round in both
directions, so that a texture repeats without a seam.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

Field = NDArray[np.float64]
Image = NDArray[np.uint8]


def hex_colour(code: str) -> Field:
    """(3,) sRGB in [0, 1] of ``"#rrggbb"``."""
    return np.array([int(code[k : k + 2], 16) / 255 for k in (1, 3, 5)])


def to_linear(srgb: ArrayLike) -> Field:
    """Linear light of sRGB values in [0, 1] (IEC 61966-2-1)."""
    s = np.asarray(srgb, dtype=np.float64)
    return np.asarray(np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4))


def to_srgb(linear: ArrayLike) -> Field:
    """SRGB values in [0, 1] of linear light in [0, 1]."""
    c = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(c <= 0.0031308, c * 12.92, 1.055 * c ** (1 / 2.4) - 0.055)


def to_image(colour: Field) -> Image:
    """(H, W, 3) uint8 of sRGB values in [0, 1]."""
    return np.asarray(np.clip(np.rint(colour * 255), 0, 255), dtype=np.uint8)


def shift_colour(colour: Field, *, value: float = 0.0, saturation: float = 0.0, hue: float = 0.0) -> Field:
    """A changed sRGB colour (3,): ``value`` and ``saturation`` are factors, ``hue`` is a shift in degrees."""
    h, s, v = cv2.cvtColor(np.asarray(colour, dtype=np.float32).reshape(1, 1, 3), cv2.COLOR_RGB2HSV)[0, 0]
    hsv = np.array([(h + hue) % 360, np.clip(s * (1 + saturation), 0, 1), np.clip(v * (1 + value), 0, 1)], np.float32)
    return np.asarray(cv2.cvtColor(hsv.reshape(1, 1, 3), cv2.COLOR_HSV2RGB)[0, 0], dtype=np.float64)


def grid(height: int, width: int) -> tuple[Field, Field]:
    """Pixel centres (x, y), each (H, W), in [0, 1) of the image; y grows downwards."""
    y, x = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij")
    return x, y


def smoothstep(low: float, high: float, value: Field) -> Field:
    """Cubic step from 0 at ``low`` to 1 at ``high``."""
    t = np.asarray(value - low)
    t /= high - low
    np.clip(t, 0.0, 1.0, out=t)
    slow = -2 * t
    slow += 3
    t *= t
    t *= slow
    return t


def mix(a: ArrayLike, b: ArrayLike, t: Field) -> Field:
    """A + t·(b − a) per pixel; ``a`` and ``b`` are colours (3,) or images (H, W, 3), ``t`` (H, W)."""
    first = np.asarray(a, dtype=np.float64)
    change = np.asarray(b, dtype=np.float64) - first
    if change.ndim > 1:
        out = change * t[..., None]
        out += first
        return out
    out = np.empty((*t.shape, 3))
    for channel in range(3):  # long rows instead of one of three for every pixel: half the time
        plane = change[channel] * t
        plane += first[channel]
        out[..., channel] = plane
    return out


def spectral(
    rng: np.random.Generator,
    shape: tuple[int, int],
    slope: float,
    *,
    stretch: tuple[float, float] = (1.0, 1.0),
    finest: float = 0.0,
    coarsest: float = 0.0,
) -> Field:
    """Gaussian noise (H, W) with amplitude ∝ frequency^−slope, zero mean, unit variance, periodic.

    Args:
        rng: source of randomness.
        shape: (H, W).
        slope: 0 is white, 1 pink, 2 brown.
        stretch: how many times longer than isotropic the features are along (rows, columns).
        finest: features smaller than this many pixels fade out (0: none).
        coarsest: features larger than this many pixels are left out (0: none).
    """
    spectrum = fft.rfft2(rng.standard_normal(shape, dtype=np.float32))
    half = shape[0] // 2 + 1  # rows of frequencies that differ; the others are theirs in reverse
    fy = np.abs(fft.fftfreq(shape[0])[:half, None]) * stretch[0]
    fx = fft.rfftfreq(shape[1])[None, :] * stretch[1]
    f = np.hypot(fy, fx).astype(np.float32)
    f[0, 0] = 1.0
    gain = f ** np.float32(-slope)
    if finest:
        gain *= np.exp(-((f * finest / 2) ** 2))
    if coarsest:
        gain *= 1 - np.exp(-((f * coarsest) ** 2))
    gain[0, 0] = 0.0
    spectrum[:half] *= gain
    spectrum[half:] *= gain[1 : shape[0] - half + 1][::-1]
    out = fft.irfft2(spectrum, s=shape, overwrite_x=True).astype(np.float64)
    out /= max(float(out.std()), 1e-12)
    return out


def blur(image: Field, sigma: float | tuple[float, float]) -> Field:
    """Gaussian blur that wraps round; ``sigma`` in pixels along (rows, columns)."""
    sy, sx = (sigma, sigma) if isinstance(sigma, float | int) else sigma
    pad = int(3 * max(sx, sy)) + 1
    wide = np.pad(image, [(pad, pad), (pad, pad)] + [(0, 0)] * (image.ndim - 2), mode="wrap")
    out = cv2.GaussianBlur(wide, (0, 0), sigmaX=max(sx, 1e-3), sigmaY=max(sy, 1e-3))
    return np.asarray(out[pad:-pad, pad:-pad], dtype=np.float64)


def relief(height: Field, strength: float) -> Field:
    """Shading (H, W) about 0 of a height field lit from the upper left."""
    dx = np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)
    dy = np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)
    return np.clip(strength * (dx + dy), -0.5, 0.5)


def cells(rng: np.random.Generator, shape: tuple[int, int], count: int) -> tuple[NDArray[np.int64], Field]:
    """Periodic Voronoi cells: id and distance to the cell's border in pixels; each (H, W).

    Two distance transforms on a wrapped margin, to the seeds and to the borders: exact to a pixel, and twenty times
    faster than a search for the two nearest seeds.
    """
    height, width = shape
    pad = int(4 * np.sqrt(height * width / count)) + 2
    seeds = np.ones(shape, dtype=np.uint8)
    seeds[rng.integers(0, height, count), rng.integers(0, width, count)] = 0
    wide = np.pad(seeds, pad, mode="wrap")
    _, label = cv2.distanceTransformWithLabels(wide, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    # Labels count the seeds in raster order; the copy of a seed in the margin stands for the seed itself.
    rows, columns = np.nonzero(wide == 0)
    owner = np.zeros(int(label.max()) + 1, dtype=np.int64)
    owner[label[rows, columns]] = (rows - pad) % height * width + (columns - pad) % width
    whole = owner[label]
    border = (whole != np.roll(whole, 1, axis=0)) | (whole != np.roll(whole, 1, axis=1))
    edge = cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_L2, 5)
    inner = slice(pad, -pad)
    _, ids = np.unique(whole[inner, inner], return_inverse=True)
    return ids.reshape(shape), edge[inner, inner].astype(np.float64)


def cells_of(seeds: Field, shape: tuple[int, int]) -> tuple[NDArray[np.int64], Field, Field]:
    """Voronoi cells of given seeds (N, 2: x, y in pixels): id, and distance to the nearest and second nearest seed."""
    from scipy.spatial import cKDTree

    height, width = shape
    tree = cKDTree(np.mod(seeds, (width, height)), boxsize=np.array([width, height]))
    y, x = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    found = tree.query(np.stack([x.ravel(), y.ravel()], axis=1), k=2)
    distance, index = np.asarray(found[0]), np.asarray(found[1])
    return index[:, 0].reshape(shape), distance[:, 0].reshape(shape), distance[:, 1].reshape(shape)


def pick(sheet: Field, x: Field, y: Field) -> Field:
    """Values of a periodic ``sheet`` (H, W) or (H, W, 3) at pixel coordinates, which wrap round."""
    height, width = sheet.shape[:2]
    return np.asarray(sheet[np.floor(y).astype(np.int64) % height, np.floor(x).astype(np.int64) % width])
