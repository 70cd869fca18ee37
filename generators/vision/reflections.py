"""What surfaces in the CPU renderer's pictures reflect and let through: Embree traces the rays that numba kernels find.

Whether a surface reflects, and how, is its material's: see `generators.vision.tables` for the kinds and
`generators.vision.reflection_kernels` for the model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from generators.core.rays import CHUNK, Tracer
from generators.core.scene import F32, I32
from generators.vision import reflection_kernels as kernels
from generators.vision.kernels import STRONG, PinholeView
from generators.vision.microfacet import block_points
from generators.vision.tables import CLEAR, SceneTables


class Reflections:
    """The reflections in one picture after another; for one thread at a time.

    `begin`, `trace` for all pixels, `add`; then `refine` for further rays of some of them.

    Args:
        tables: the scene.
        tracer: over its triangles.
    """

    def __init__(self, tables: SceneTables, tracer: Tracer) -> None:
        self._tables, self._tracer = tables, tracer
        self._points = block_points()
        self._is_clear = bool((tables.shine == CLEAR).any())
        self._rows = np.empty(CHUNK, dtype=np.int32)
        self._size = (0, 0)

    def share(self) -> Reflections:
        """The same for another thread at the same time."""
        return Reflections(self._tables, self._tracer)

    def begin(self, width: int, height: int) -> None:
        """Start a picture."""
        pixels = width * height
        if self._size != (width, height):
            self._size = width, height
            self._pixels = np.arange(pixels, dtype=np.int32)
            self._lobe, self._between, self._factor = (np.empty((pixels, 3), dtype=np.float32) for _ in range(3))
            self._alpha, self._radius = np.empty(pixels, dtype=np.float32), np.empty(pixels, dtype=np.float32)
            self._second = np.empty(pixels, dtype=np.int32)
            if len(self._rows) < width:
                self._rows = np.empty(width, dtype=np.int32)
        self._radius.fill(-1.0)
        self._second.fill(-1)

    def trace(self, hit: dict[str, np.ndarray], directions: F32, view: PinholeView, block: slice, light: F32) -> None:
        """Trace what the pixels ``block`` reflect, and finish their radiance ``light`` (N, 3) but for the lobes."""
        found = self._reflect(hit, directions, view, 1.0, self._pixels[block], 1, light)
        if found is None:
            return
        rows, weight, rays = found
        first, reach = np.full(len(rows), -1, dtype=np.int32), np.zeros(len(rows), dtype=np.float32)
        cone = rays[2].copy()
        seen = self._walk(*rays, first, reach)
        kernels.keep_lobes(
            rows,
            hit["tfar"],
            first,
            reach,
            cone,
            weight,
            seen,
            self._lobe[block],
            self._factor[block],
            self._radius[block],
            self._alpha[block],
            self._second[block],
        )

    def add(self, face: I32, light: F32) -> None:
        """Average the lobes of all pixels and add them to their radiance ``light`` (P, 3)."""
        pixels = len(face)
        for down, before, after in ((False, self._lobe, self._between), (True, self._between, self._lobe)):
            kernels.smooth(face, self._tables, before, self._radius, self._alpha, *self._size, down, 0, pixels, after)
        kernels.add_lobes(self._factor, self._radius, self._lobe, light)

    def mark(self, rgb: np.ndarray, width: int, marks: np.ndarray) -> None:
        """Mark the pixels at edges in mirrors."""
        kernels.mark_mirrored(self._second, rgb, width, STRONG, marks, 0, len(marks))

    def refine(
        self, hit: dict[str, np.ndarray], directions: F32, view: PinholeView, pixels: I32, face: I32, light: F32
    ) -> None:
        """Add what further rays of ``pixels`` reflect to their radiance; ``face`` (P,) is at the pixels' centres."""
        samples = len(directions) // len(pixels)
        found = self._reflect(hit, directions, view, 0.5, pixels, samples, light)
        if found is None:
            return
        rows, weight, rays = found
        kernels.reuse(
            rows,
            hit["primID"],
            pixels,
            samples,
            face,
            self._tables,
            self._radius,
            self._lobe,
            view.width,
            view.height,
            weight,
            rays[1],
            light,
        )
        first, reach = np.empty(len(rows), dtype=np.int32), np.empty(len(rows), dtype=np.float32)
        light[rows] += weight * self._walk(*rays, first, reach)

    def _reflect(
        self,
        hit: dict[str, np.ndarray],
        directions: F32,
        view: PinholeView,
        spread: float,
        pixels: I32,
        samples: int,
        light: F32,
    ) -> tuple[I32, F32, tuple[F32, F32, F32]] | None:
        """The hits that reflect, the weight of their rays, and the rays: origins, directions, cones."""
        face, geometry = hit["primID"], (hit["primID"], hit["tfar"], hit["u"], hit["v"], directions, view, spread)
        kernels.add_mean(face, hit["u"], hit["v"], directions, self._tables, light)
        count = kernels.select(face, self._tables, self._rows)
        if not count:
            return None
        rows = self._rows[:count].copy()
        weight, rays = np.empty((count, 3), dtype=np.float32), _rays(count)
        kernels.reflect(rows, *geometry, pixels, samples, self._tables, self._points, light, weight, *rays)
        if self._is_clear:
            self._see_through(rows.copy(), geometry, light)
        return rows, weight, rays

    def _see_through(self, rows: I32, geometry: tuple[Any, ...], light: F32) -> None:
        """Add what lies behind clear hits to their radiance."""
        weight, rays = np.empty((len(rows), 3), dtype=np.float32), _rays(len(rows))
        face, distance, u, v, towards, view, spread = geometry
        count = kernels.see_through(
            rows, face, distance, u, v, towards, view, spread, self._tables, weight, rays[0], rays[1], rays[2]
        )
        if count:
            first, reach = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.float32)
            origins, directions, cone = (each[:count] for each in rays)
            light[rows[:count]] += weight[:count] * self._walk(origins, directions, cone, first, reach)

    def _walk(self, origins: F32, directions: F32, cone: F32, first: I32, reach: F32) -> F32:
        """Radiance (M, 3) of M rays, 0 without a direction; writes the first face that each met, and its distance."""
        count = len(origins)
        seen, throughput = np.zeros((count, 3), dtype=np.float32), np.empty((count, 3), dtype=np.float32)
        owner = np.empty(count, dtype=np.int32)
        count = kernels.gather(owner, throughput, origins, directions, cone)
        for bounce in range(kernels.BOUNCES + 1):
            if not count:
                break
            rays = owner[:count], throughput[:count], origins[:count], directions[:count], cone[:count]
            hit = self._tracer.intersect(rays[2], rays[3])
            if bounce == 0:
                first[rays[0]], reach[rays[0]] = hit["primID"], hit["tfar"]
            count = kernels.follow(
                hit["primID"], hit["tfar"], hit["u"], hit["v"], *rays, self._tables, bounce == kernels.BOUNCES, seen
            )
        return seen


def _rays(count: int) -> tuple[F32, F32, F32]:
    """Room for origins, directions and cones."""
    origins, directions, cone = (np.empty((count, 3), dtype=np.float32) for _ in range(3))
    return origins, directions, cone
