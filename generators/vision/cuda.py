"""The GPU renderer: rays, shading and edges on a CUDA device, by the functions of the CPU renderer.

The steps are those of `generators.vision.embree`, and so are the functions that a thread calls for its pixel
(`generators.vision.kernels`); `generators.core.device_rays` finds what a ray meets. Frames have the same bytes on every
run on one kind of device. They differ from the CPU's by rounding: a ray that passes an edge within 1e-6 m may meet the
other face, and a level of a colour may be off by one.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.cuda import (
    OutOfDeviceMemoryError,
    allocate,
    cuda_version,
    in_batches,
    launch,
    pinned,
    require_device,
    upload,
)
from generators.core.freespace import Navigable
from generators.core.scene import Scene
from generators.core.tone import WHITE, srgb_table, tone_table
from generators.vision.base import RenderedView
from generators.vision.sampling import FEW_SUB_PIXELS, SUB_PIXELS, thin_faces
from generators.vision.tables import build_tables
from generators.vision.views import check_camera, trial_scene, view_of

if TYPE_CHECKING:
    from generators.vision.kernels import PinholeView

#: Rays that are followed at once: 48 bytes each on the device. A frame of 1008² and its edges take one launch each.
RAYS = 1 << 22
#: Fewest rays that are tried when memory runs out.
LEAST_RAYS = 1 << 16


class CudaBackend:
    """Renders on an NVIDIA GPU, with numba-cuda."""

    name = "cuda"

    @property
    def version(self) -> str:
        """Version of numba-cuda and kind of device: a frame's bytes depend on both.

        Raises:
            Avs3dError: if CUDA cannot be used.
        """
        return cuda_version()

    def warm_up(self) -> None:
        """Compile the kernels, or wait for another process that does.

        Raises:
            Avs3dError: if CUDA cannot be used, or a package of ``[generate]`` is missing.
        """
        from generators.core.jit import compile_lock

        require_device()
        scene, camera, pose = trial_scene()
        with compile_lock("pictures-cuda"):
            session = self.open(scene, camera)
            session.render(pose)
            session.close()

    def open(self, scene: Scene, intrinsics: Intrinsics) -> CudaSession:
        """Load ``scene`` for a camera with ``intrinsics``.

        Raises:
            Avs3dError: for a scene or camera that cannot be rendered, or if CUDA cannot be used.
            OutOfDeviceMemoryError: if the scene does not fit on the device.
        """
        require_device()
        return CudaSession(scene, intrinsics)

    def navigable(self, home: Scene) -> Navigable | None:
        """None: there is no navigation mesh besides the free space that generators/core/freespace.py measures."""
        return None


class CudaSession:
    """An open scene. For one thread at a time, since frames share working memory; `share` serves another thread."""

    def __init__(self, scene: Scene, intrinsics: Intrinsics) -> None:
        check_camera(intrinsics)
        from generators.core.device_rays import DeviceTracer
        from generators.vision import device_kernels, kernels
        from generators.vision.microfacet import block_points

        self._kernels, self._device = kernels, device_kernels
        self._intrinsics = intrinsics
        tables, triangles = build_tables(scene.shown)
        tracer: Any = DeviceTracer(triangles)
        self._tree = tracer.tree
        self._thin = upload(triangles[thin_faces(triangles, tables.normal, tracer)], "thin triangles")
        self._tables: Any = upload(tables, f"{scene.name}: textures and light maps")
        self._curves = upload((tone_table(), srgb_table()), "tables")
        self._offsets = upload(SUB_PIXELS, "tables"), upload(FEW_SUB_PIXELS, "tables")
        self._points = upload(block_points(), "tables")
        self._allocate()

    def _allocate(self) -> None:
        """Make the working memory of a frame."""
        width, height = self._intrinsics.width, self._intrinsics.height
        self._frame = _Frame(width, height)
        self._rays = _Rays.most(min(RAYS, max(width * height * 2, LEAST_RAYS)))

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes on one kind of device.

        Raises:
            Avs3dError: if the session has been closed.
            OutOfDeviceMemoryError: if the device's memory does not even suffice for a small part of the picture.
        """
        if self._tables is None:
            raise Avs3dError("the renderer's session is closed; open the scene again")
        view = view_of(self._intrinsics, pose)
        self._shoot_centres(view)
        self._refine_edges(view)
        return self._frame.fetched()

    def share(self) -> CudaSession | None:
        """The same scene with working memory of its own, so that a picture is drawn while others are encoded.

        None if the device has no room for it.
        """
        other = copy.copy(self)
        try:
            other._allocate()
        except OutOfDeviceMemoryError:
            return None
        return other

    def close(self) -> None:
        """Free the device's memory; closing twice is allowed."""
        if self._tables is not None:
            self._tables = None
            del self._tree, self._thin, self._frame, self._rays, self._curves, self._offsets, self._points

    def _shoot_centres(self, view: PinholeView) -> None:
        """One ray through the centre of each pixel; fills the whole frame."""
        frame, rays, device = self._frame, self._rays, self._device
        step = max(1, rays.count // view.width)
        for first in range(0, view.height, step):
            rows = min(step, view.height - first)
            count = rows * view.width
            # Threads are numbered by tiles, some of which stand out over the block's rim.
            threads = device.tiles(view.width, rows) * device.TILE
            launch(device.trace_centres, threads, view, first, rows, self._tree, rays.arrays)
            launch(device.write_geometry, count, first * view.width, count, rays.arrays, self._tables, frame.arrays)
            launch(device.shade, count, view, 1.0, count, rays.arrays, self._tables)
            own = first * view.width, count, self._tree, rays.arrays, self._tables, self._points, frame.arrays
            launch(device.reflect_centres, count, view, *own)
        pixels = view.width * view.height
        for down in (False, True):
            launch(device.smooth, pixels, down, view, self._tables, frame.arrays)
        launch(device.finish, pixels, self._tables, self._curves[0], WHITE, self._curves[1], frame.arrays)

    def _refine_edges(self, view: PinholeView) -> None:
        """Shoot the pixels at edges again and average."""
        frame, device = self._frame, self._device
        pixels = view.width * view.height
        launch(device.clear, pixels, frame.arrays)
        launch(device.mark_edges, pixels, view, self._tables.surface, self._tables.normal, frame.arrays)
        launch(device.mark_thin, len(self._thin), self._thin, view, frame.arrays)
        launch(device.mark_mirrored, pixels, view, frame.arrays)
        frame.fetch_geometry()
        for faint, offsets in enumerate(self._offsets):
            self._shoot_again(view, bool(faint), offsets)

    def _shoot_again(self, view: PinholeView, faint: bool, offsets: Any) -> None:
        """Average rays at ``offsets`` (S, 2) within each of the pixels at faint or at other edges."""
        frame, rays, device = self._frame, self._rays, self._device
        launch(device.begin_list, 1, frame.arrays)
        launch(device.collect, view.width * view.height, faint, frame.arrays)
        edges = int(frame.arrays.number.copy_to_host()[0])
        samples = len(offsets)

        def refine(first: int, last: int) -> None:
            count = (last - first) * samples
            launch(device.trace_edges, count, view, first, offsets, count, self._tree, rays.arrays, frame.arrays)
            launch(device.shade, count, view, 0.5, count, rays.arrays, self._tables)
            scene = self._tree, rays.arrays, self._tables, self._points, self._curves[0], WHITE, frame.arrays
            launch(device.reflect_edges, count, view, first, samples, count, *scene)
            launch(device.average, last - first, first, last, samples, rays.arrays, self._curves[1], frame.arrays)

        in_batches(refine, edges, rays.count // samples)


class _Frame:
    """A frame on the device, and where it arrives on the host."""

    def __init__(self, width: int, height: int) -> None:
        from generators.vision.device_kernels import FrameArrays

        pixels = width * height
        self._shape = height, width
        what = f"a frame of {width}×{height}"
        self.arrays: Any = FrameArrays(
            face=allocate(pixels, np.int32, what),
            depth=allocate(pixels, np.float32, what),
            ids=allocate(pixels, np.uint16, what),
            rgb=allocate((pixels, 3), np.uint8, what),
            marks=allocate((2, pixels), np.uint8, what),
            pixels=allocate(pixels, np.int32, what),
            number=allocate(1, np.int32, what),
            light=allocate((pixels, 3), np.float32, what),
            lobe=allocate((pixels, 3), np.float32, what),
            between=allocate((pixels, 3), np.float32, what),
            factor=allocate((pixels, 3), np.float32, what),
            radius=allocate(pixels, np.float32, what),
            alpha=allocate(pixels, np.float32, what),
            second=allocate(pixels, np.int32, what),
        )
        self._rgb = pinned((pixels, 3), np.uint8)
        self._depth = pinned(pixels, np.float32)
        self._ids = pinned(pixels, np.uint16)

    def fetch_geometry(self) -> None:
        """Fetch depth and ids, which edges do not change; `fetched` then copies them while the device works on."""
        self.arrays.depth.copy_to_host(self._depth)
        self.arrays.ids.copy_to_host(self._ids)

    def fetched(self) -> RenderedView:
        """The frame, in memory of its own."""
        height, width = self._shape
        depth, ids = self._depth.reshape(height, width).copy(), self._ids.reshape(height, width).copy()
        self.arrays.rgb.copy_to_host(self._rgb)
        return RenderedView(rgb=self._rgb.reshape(height, width, 3).copy(), depth=depth, instance_ids=ids)


class _Rays:
    """Working memory for ``count`` rays on the device."""

    def __init__(self, count: int) -> None:
        from generators.vision.device_kernels import RayArrays

        what = f"{count:,} rays"
        self.count = count
        self.arrays = RayArrays(
            direction=allocate((count, 3), np.float32, what),
            face=allocate(count, np.int32, what),
            distance=allocate(count, np.float32, what),
            u=allocate(count, np.float32, what),
            v=allocate(count, np.float32, what),
            light=allocate((count, 3), np.float32, what),
        )

    @staticmethod
    def most(count: int) -> _Rays:
        """Room for ``count`` rays, or for as many halvings of it as fit.

        Raises:
            OutOfDeviceMemoryError: if `LEAST_RAYS` do not fit.
        """
        while True:
            try:
                return _Rays(count)
            except OutOfDeviceMemoryError:
                if count <= LEAST_RAYS:
                    raise
                count = max(count // 2, LEAST_RAYS)


def agreement(one: RenderedView, other: RenderedView) -> tuple[float, float, float]:
    """How far two frames agree: share of equal ids, 99.99 % quantile of the difference in depth (m), PSNR (dB).

    Examples:
        >>> frame = Frame(np.zeros((1, 2, 3), np.uint8), np.ones((1, 2), np.float32), np.zeros((1, 2), np.uint16))
        >>> agreement(frame, frame)
        (1.0, 0.0, inf)
    """
    equal = float((one.instance_ids == other.instance_ids).mean())
    apart: NDArray[np.float32] = np.abs(one.depth - other.depth)
    square = float(((one.rgb.astype(np.float64) - other.rgb) ** 2).mean())
    psnr = float("inf") if square == 0.0 else float(10.0 * np.log10(255.0**2 / square))
    return equal, float(np.quantile(apart, 0.9999)), psnr
