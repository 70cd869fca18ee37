"""Contact sheet of the training families: a row is a family, its pictures are generator seeds.

`python -m benchmarks.training_objects -o sheet.jpg [--category CATEGORY]… [--seeds N] [--side PIXELS] [--columns N]`

Each model fills its picture, seen from its front left and a little above, with one distant light, its shadow, and light
from all around; no light is baked, so that a sheet of hundreds of models takes seconds.
"""

from __future__ import annotations

import argparse
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS
from generators.assets.catalogue import Model, build_model, training_variants, variants
from generators.core.rays import RayCaster

Array = NDArray[np.float64]
#: Direction of the camera: degrees to the object's left, and above it.
VIEW = (-28.0, 18.0)
#: Direction towards the distant light.
LIGHT = np.array([-0.45, 0.75, 0.6]) / np.linalg.norm([-0.45, 0.75, 0.6])
#: Radiance of the background, and width of a row's label (pixels).
GROUND, LABEL = 0.5, 112


def linear(pixels: NDArray[np.uint8]) -> Array:
    value = pixels.astype(np.float64) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def albedo(model: Model, face: NDArray[np.int32], weights: Array) -> Array:
    """(N, 3) linear colours at barycentric ``weights`` (N, 3) of the faces (N,)."""
    mesh = model.mesh
    out = np.zeros((len(face), 3))
    uv = (mesh.uv[face].astype(np.float64) * weights[:, :, None]).sum(axis=1)
    for index, material in enumerate(mesh.materials):
        here = mesh.face_material[face] == index
        if not here.any():
            continue
        colour = np.broadcast_to(np.array(material.colour), (int(here.sum()), 3)).copy()
        if material.texture is not None:
            pixels = material.texture.pixels
            height, width = pixels.shape[:2]
            x = np.floor(uv[here, 0] * width).astype(int) % width
            y = np.floor((1 - uv[here, 1]) * height).astype(int) % height
            colour *= linear(pixels[y, x])
        out[here] = colour + np.array(material.emission)
    return out


def rays(model: Model, side: int) -> tuple[Array, Array]:
    """Origins and the direction of parallel rays that frame the model; top row first."""
    yaw, pitch = np.radians(VIEW)
    back = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    corners = model.mesh.positions.reshape(-1, 3).astype(np.float64)
    flat = corners @ np.stack([right, up], axis=1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    half = 0.55 * float((high - low).max())
    middle = (low + high) / 2
    step = ((np.arange(side) + 0.5) / side * 2 - 1) * half
    x, y = np.meshgrid(middle[0] + step, middle[1] - step)
    origins = x.reshape(-1, 1) * right + y.reshape(-1, 1) * up + 10 * back
    return origins, -back


def picture(model: Model, side: int, supersampling: int = 2) -> NDArray[np.uint8]:
    """(side, side, 3) picture of a model."""
    origins, direction = rays(model, side * supersampling)
    triangles = model.mesh.positions.astype(np.float64)
    caster = RayCaster(model.mesh.positions)
    distance, face = caster.closest(origins, np.broadcast_to(direction, origins.shape))
    light = np.full((len(origins), 3), GROUND)
    hit = face >= 0
    points = origins[hit] + distance[hit, None] * direction
    a, b, c = (triangles[face[hit], k] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = (normal**2).sum(axis=1)
    area = np.where(area > 0, area, 1.0)
    w1 = (np.cross(points - a, c - a) * normal).sum(axis=1) / area
    w2 = (np.cross(b - a, points - a) * normal).sum(axis=1) / area
    weights = np.stack([1 - w1 - w2, w1, w2], axis=1)
    shading = (model.mesh.normals[face[hit]].astype(np.float64) * weights[:, :, None]).sum(axis=1)
    shading /= np.maximum(np.linalg.norm(shading, axis=1, keepdims=True), 1e-9)
    unit = normal / np.sqrt(area)[:, None]
    lit = ~caster.occluded(points + 1e-4 * unit, np.broadcast_to(LIGHT, points.shape))
    strength = 0.55 * np.clip(shading @ LIGHT, 0, None) * lit + 0.45 + 0.12 * shading[:, 1]
    light[hit] = albedo(model, face[hit], weights) * strength[:, None]
    grid = light.reshape(side, supersampling, side, supersampling, 3).mean(axis=(1, 3))
    value = np.clip(grid, 0, 1)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.asarray(np.round(255 * encoded), dtype=np.uint8)


def generator(category: str, variant: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(f"{category}/{variant}".encode()), seed])


def row(category: str, variant: str, seeds: int, side: int) -> NDArray[np.uint8]:
    """(side, LABEL + seeds * side, 3): the name of a family and its models."""
    label = Image.new("RGB", (LABEL, side), (250, 250, 250))
    pen = ImageDraw.Draw(label)
    for line, text in enumerate((category.replace("_", " "), variant)):
        pen.text((6, side / 2 + 14 * (line - 1)), text, fill=(30, 30, 30), font=ImageFont.load_default(size=12))
    models = (build_model(category, variant, generator(category, variant, seed)) for seed in range(seeds))
    return np.concatenate([np.asarray(label), *(picture(model, side) for model in models)], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="picture to write (.png or .jpg)")
    parser.add_argument("--category", action="append", choices=CATEGORIES + DISTRACTORS, help="only this; repeatable")
    parser.add_argument("--seeds", type=int, default=12, help="models of each family")
    parser.add_argument("--side", type=int, default=64, help="side of a picture (pixels)")
    parser.add_argument("--columns", type=int, default=1, help="families side by side")
    parser.add_argument("--benchmark", action="store_true", help="the variants of the benchmarks instead")
    options = parser.parse_args()
    names = variants if options.benchmark else training_variants
    categories = options.category or CATEGORIES + DISTRACTORS
    rows = [row(c, v, options.seeds, options.side) for c in categories for v in names(c)]
    rows += [np.full_like(rows[0], 250)] * (-len(rows) % options.columns)
    high = len(rows) // options.columns
    columns = [np.concatenate(rows[k * high : (k + 1) * high]) for k in range(options.columns)]
    Image.fromarray(np.concatenate(columns, axis=1)).save(options.output, quality=72, optimize=True)
    print(
        f"{options.output}: {len(rows)} families x {options.seeds} seeds, {options.output.stat().st_size / 1000:.0f} kB"
    )


if __name__ == "__main__":
    main()
