"""The CPU renderer: Embree finds what each ray meets, numba kernels shade it.

One ray through each pixel's centre gives depth, instance ids and, with a texture filtered over the pixel's footprint,
the colour inside surfaces. What reflects sends further rays (`generators.vision.reflections`). Only pixels at edges are
shot again, with several rays in fixed places, and averaged.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.rays import CHUNK, Tracer, repeated
from generators.core.scene import Scene
from generators.core.tone import WHITE, srgb_table, tone_table
from generators.vision.base import RenderedView
from generators.vision.sampling import FEW_SUB_PIXELS, SUB_PIXELS, thin_faces
from generators.vision.views import check_camera, trial_scene, view_of

if TYPE_CHECKING:
    from generators.core.freespace import Navigable
    from generators.vision.kernels import PinholeView


class EmbreeBackend:
    """Renders on the CPU, with nothing but packages from PyPI."""

    name = "embree"

    @property
    def version(self) -> str:
        """Version of embreex, which carries Embree itself."""
        try:
            return version("embreex")
        except PackageNotFoundError:
            return "missing"

    def warm_up(self) -> None:
        """Compile the kernels, or wait for another process that does."""
        warm_up()

    def open(self, scene: Scene, intrinsics: Intrinsics) -> EmbreeSession:
        """Load ``scene`` for a camera with ``intrinsics``.

        Raises:
            Avs3dError: for a scene or camera that cannot be rendered, or a missing package of ``[generate]``.
        """
        return EmbreeSession(scene, intrinsics)

    def navigable(self, home: Scene) -> Navigable | None:
        """None: there is no navigation mesh besides the free space that generators/core/freespace.py measures."""
        return None


class EmbreeSession:
    """An open scene. For one thread at a time, since frames share working memory; `share` serves another thread."""

    #: Whether `_keep` does anything: hits are then held until the whole frame is shaded, 32 bytes a pixel.
    _keeps = False

    def __init__(self, scene: Scene, intrinsics: Intrinsics) -> None:
        check_camera(intrinsics)
        from generators.vision import kernels
        from generators.vision.reflections import Reflections
        from generators.vision.tables import MATTE, build_tables

        self._kernels = kernels
        self._intrinsics = intrinsics
        tables, triangles = build_tables(scene.shown)
        self._tables = tables
        self._tracer: Tracer | None = Tracer(triangles)
        self._thin = triangles[thin_faces(triangles, tables.normal, self._tracer)]
        self._tone = tone_table()
        self._srgb = srgb_table()
        self._rows = max(1, CHUNK // intrinsics.width)
        self._reflections = Reflections(tables, self._tracer) if (tables.shine != MATTE).any() else None
        self._allocate()

    def _allocate(self) -> None:
        """Make the working memory of a frame."""
        width, height = self._intrinsics.width, self._intrinsics.height
        self._face = np.empty(width * height, dtype=np.int32)
        self._directions = np.empty((max(CHUNK, width), 3), dtype=np.float32)
        self._light = np.empty((max(CHUNK, width), 3), dtype=np.float32)
        self._radiance = np.empty((width * height, 3), dtype=np.float32)

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes.

        Raises:
            Avs3dError: if the session has been closed.
        """
        return self._render(pose, None)

    def labels(self, pose: Pose, coloured: np.ndarray) -> RenderedView:
        """Depth and ids as `render` gives them, and the colours of some faces alone: most of the time goes to colours.

        Args:
            pose: of the camera.
            coloured: (faces + 1,) bool, whose colours are wanted, all of a material or none; the last one: no face.

        Returns:
            The view. ``rgb`` has the bytes of `render` where a pixel and its eight neighbours show coloured faces, and
            no meaning elsewhere.

        Raises:
            Avs3dError: if the session has been closed.
        """
        return self._render(pose, coloured)

    def _render(self, pose: Pose, coloured: np.ndarray | None) -> RenderedView:
        if self._tracer is None:
            raise Avs3dError("the renderer's session is closed; open the scene again")
        width, height = self._intrinsics.width, self._intrinsics.height
        view = view_of(self._intrinsics, pose)
        rgb = np.empty((height * width, 3), dtype=np.uint8)
        depth = np.empty(height * width, dtype=np.float32)
        ids = np.empty(height * width, dtype=np.uint16)
        self._shoot_centres(self._tracer, view, (rgb, depth, ids), coloured)
        if coloured is None or coloured[self._face].any():
            self._refine_edges(self._tracer, view, rgb, depth, coloured)
        return RenderedView(
            rgb=rgb.reshape(height, width, 3),
            depth=depth.reshape(height, width),
            instance_ids=ids.reshape(height, width),
        )

    def radiance(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Radiance before the tone curve, with one ray through each pixel's centre; to compare light, not to look at.

        Args:
            pose: of the camera.

        Returns:
            (H, W, 3) float32 radiance times the scene's exposure, and (H, W) int32 the face that each pixel shows,
            counted through all parts, −1 for none. The pictures of a scan are not radiance: they are given as they are
            displayed.

        Raises:
            Avs3dError: if the session has been closed.
        """
        if self._tracer is None:
            raise Avs3dError("the renderer's session is closed; open the scene again")
        view = view_of(self._intrinsics, pose)
        for _ in self._trace_centres(self._tracer, view):
            pass
        self._add_reflections()
        shape = view.height, view.width
        return self._radiance.reshape(*shape, 3).copy(), self._face.reshape(shape).copy()

    @property
    def faces(self) -> np.ndarray:
        """(H, W) int32 the face that each pixel of the last picture shows at its centre; −1 for none. A view."""
        return self._face.reshape(self._intrinsics.height, self._intrinsics.width)

    def share(self) -> EmbreeSession:
        """The same scene and tables with working memory of its own: Embree and the kernels only read them."""
        other = copy.copy(self)
        other._allocate()
        if self._reflections is not None:
            other._reflections = self._reflections.share()
        return other

    def close(self) -> None:
        """Free the resources of the session; closing twice is allowed."""
        if self._tracer is not None:
            self._tracer = self._reflections = None
            del self._tables, self._thin

    def _trace_centres(
        self, tracer: Tracer, view: PinholeView, coloured: np.ndarray | None = None
    ) -> Iterator[tuple[slice, dict[str, np.ndarray]]]:
        """One ray through the centre of each pixel, some rows at a time.

        Fills ``self._face``, and ``self._radiance`` without the lobes of what reflects (0 of what is not ``coloured``).

        Yields:
            The pixels and what their rays meet.
        """
        kernels = self._kernels
        if self._reflections is not None:
            self._reflections.begin(view.width, view.height)
        for first in range(0, view.height, self._rows):
            rows = min(self._rows, view.height - first)
            count = rows * view.width
            block = slice(first * view.width, first * view.width + count)
            directions, light = self._directions[:count], self._radiance[block]
            kernels.centre_directions(view, first, rows, directions)
            hit = tracer.intersect(repeated(view.origin, count), directions)
            face = self._face[block] = hit["primID"]
            if coloured is None:
                lit = hit
            elif (wanted := coloured[face]).any():
                lit = hit | {"primID": np.where(wanted, face, np.int32(-1))}
            else:
                light.fill(0.0)
                yield block, hit
                continue
            self._shade(lit, directions, view, 1.0, light)
            if self._reflections is not None:
                self._reflections.trace(lit, directions, view, block, light)
            yield block, hit

    def _add_reflections(self) -> None:
        if self._reflections is not None:
            self._reflections.add(self._face, self._radiance)

    def _shoot_centres(
        self,
        tracer: Tracer,
        view: PinholeView,
        frame: tuple[np.ndarray, np.ndarray, np.ndarray],
        coloured: np.ndarray | None,
    ) -> None:
        """One ray through the centre of each pixel; fills a frame's colours, depths and ids, and ``self._face``."""
        kernels, tables, (rgb, depth, ids) = self._kernels, self._tables, frame
        hits = []
        for block, hit in self._trace_centres(tracer, view, coloured):
            kernels.write_geometry(hit["primID"], hit["tfar"], tables, depth[block], ids[block])
            if self._keeps:
                hits.append((block, hit))
        self._add_reflections()
        kernels.picture(self._face, tables, self._tone, WHITE, self._srgb, self._radiance, rgb)
        for block, hit in hits:
            light = self._radiance[block]
            kernels.develop(hit["primID"], tables, self._tone, WHITE, light)
            directions = self._directions[: len(light)]
            kernels.centre_directions(view, block.start // view.width, len(light) // view.width, directions)
            self._keep(hit, directions, view, 1.0, light, block)

    def _refine_edges(
        self, tracer: Tracer, view: PinholeView, rgb: np.ndarray, depth: np.ndarray, coloured: np.ndarray | None
    ) -> None:
        """Shoot the pixels at edges again and average, of those that show what is ``coloured``."""
        kernels, tables = self._kernels, self._tables
        marks = np.zeros((2, len(rgb)), dtype=np.uint8)
        kernels.mark_edges(self._face, depth, rgb, view, tables.surface, tables.normal, marks, 0, len(rgb))
        faint, strong = marks
        kernels.mark_thin(self._thin, depth, view, strong, *np.empty((3, 3)))
        if self._reflections is not None:
            self._reflections.mark(rgb, view.width, strong)
        if coloured is not None:
            marks &= coloured[self._face]
        faint[strong != 0] = 0
        self._shoot_again(tracer, view, np.flatnonzero(strong), SUB_PIXELS, rgb)
        self._shoot_again(tracer, view, np.flatnonzero(faint), FEW_SUB_PIXELS, rgb)

    def _shoot_again(
        self, tracer: Tracer, view: PinholeView, pixels: np.ndarray, offsets: np.ndarray, rgb: np.ndarray
    ) -> None:
        """Average rays at ``offsets`` (S, 2) within each of the ``pixels``."""
        kernels, tables = self._kernels, self._tables
        samples = len(offsets)
        step = CHUNK // samples
        for first in range(0, len(pixels), step):
            chunk = pixels[first : first + step].astype(np.int32)
            count = len(chunk) * samples
            directions, light = self._directions[:count], self._light[:count]
            kernels.sub_pixel_directions(view, chunk, offsets, directions)
            hit = tracer.intersect(repeated(view.origin, count), directions)
            self._shade(hit, directions, view, 0.5, light)
            if self._reflections is not None:
                self._reflections.refine(hit, directions, view, chunk, self._face, light)
            kernels.develop(hit["primID"], tables, self._tone, WHITE, light)
            if self._keeps:
                self._keep(hit, directions, view, 0.5, light, chunk)
            kernels.average(light, samples, self._srgb, chunk, rgb)

    def _keep(
        self,
        hit: dict[str, np.ndarray],
        directions: np.ndarray,
        view: PinholeView,
        spread: float,
        light: np.ndarray,
        pixels: slice | np.ndarray,
    ) -> None:
        """For renderers built on this one, if `_keeps`: what the rays of some pixels, as many for each, brought."""

    def _shade(
        self, hit: dict[str, np.ndarray], directions: np.ndarray, view: PinholeView, spread: float, light: np.ndarray
    ) -> None:
        face, distance, u, v = hit["primID"], hit["tfar"], hit["u"], hit["v"]
        self._kernels.shade(face, distance, u, v, directions, view, spread, self._tables, light)


def warm_up() -> None:
    """Compile all kernels, or load them from the cache, once, before workers start.

    Renders a box on a few pixels. Processes that come at the same time wait for the first one and load its work.

    Raises:
        Avs3dError: if a package of ``[generate]`` is missing or no folder for compiled code can be written.
    """
    from generators.core.jit import compile_lock

    scene, camera, pose = trial_scene()
    with compile_lock("pictures"):
        session = EmbreeBackend().open(scene, camera)
        session.render(pose)
        session.close()
