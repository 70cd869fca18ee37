"""The renderer of captured scenes: splats give the picture, the mesh beside them everything else.

Depth and instance ids are those of `generators.vision.embree` on the scan's mesh and the objects, so that masks do not
depend on the renderer. The colour of a pixel is composited from three layers: the splats in front of the object in it,
the object (shaded as on the scan's mesh), and where no object is visible all splats, before the picture of the mesh.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.freespace import Navigable
from generators.core.scene import Scene, SplatFile
from generators.core.tone import WHITE
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend, EmbreeSession
from generators.vision.splats.cloud import SplatCloud, load_cloud
from generators.vision.tables import SceneTables
from generators.vision.views import trial_scene

if TYPE_CHECKING:
    from generators.vision.kernels import PinholeView
    from generators.vision.splats.kernels import SplatCamera
    from generators.vision.splats.painter import Painter

#: Splats nearer to an object's surface than this (m) belong to what it stands on, not to what is before it: half the
#: thickness of a surface of captured splats.
TOLERANCE = 0.03


class SplatsBackend:
    """Draws a scan's splats: with gsplat on CUDA, else with our own rasteriser.

    Args:
        device: ``cpu`` or ``cuda``; on ``cuda`` gsplat draws what no object is in front of.
    """

    name = "splats"

    def __init__(self, device: str = "cpu") -> None:
        self._device = device

    @property
    def version(self) -> str:
        """Versions of what computes the pixels.

        Raises:
            Avs3dError: on CUDA, if gsplat is missing or does not work.
        """
        return f"embreex {EmbreeBackend().version}, {_painter_version(self._device)}"

    def warm_up(self) -> None:
        """Compile the kernels, or wait for another process that does.

        Raises:
            Avs3dError: if a package of ``[generate]`` is missing, or on CUDA, gsplat.
        """
        from generators.core.jit import compile_lock
        from generators.vision.embree import warm_up

        warm_up()
        scene, camera, pose = trial_scene()
        cloud = SplatCloud(
            means=np.zeros((1, 3), dtype=np.float32),
            covariances=np.full((1, 6), 0.01, dtype=np.float32),
            opacities=np.ones(1, dtype=np.float32),
            sh=np.zeros((1, 1, 3), dtype=np.float32),
        )
        with compile_lock("splats"):
            session = SplatsSession(scene, camera, cloud, _painter(cloud, self._device))
            session.render(pose)
            session.close()

    def open(self, scene: Scene, intrinsics: Intrinsics) -> SplatsSession:
        """Load ``scene`` for a camera with ``intrinsics``.

        Raises:
            Avs3dError: for a scene or camera that cannot be rendered, a scene without splats, a file of splats that is
                broken or of another place, or a missing package.
        """
        cloud = read_cloud(scene)
        return SplatsSession(scene, intrinsics, cloud, _painter(cloud, self._device))

    def navigable(self, home: Scene) -> Navigable | None:
        """None: there is no navigation mesh besides the free space that generators/core/freespace.py measures."""
        return None


@lru_cache(maxsize=1)
def _painter(cloud: SplatCloud, device: str) -> Painter:
    """What draws ``cloud`` on a device; it stays while an object moves and the scene is opened every second.

    Raises:
        Avs3dError: on CUDA, if gsplat is missing or does not work.
    """
    if device == "cpu":
        from generators.vision.splats.painter import NumbaPainter

        return NumbaPainter(cloud)
    from generators.vision.splats.gsplat_painter import GsplatPainter

    return GsplatPainter(cloud, device)


@lru_cache(maxsize=4)
def _painter_version(device: str) -> str:
    """What draws on a device, with its version.

    Raises:
        Avs3dError: on CUDA, if gsplat is missing or does not work.
    """
    if device == "cpu":
        import numba

        return f"numba {numba.__version__}"
    from generators.vision.splats.gsplat_painter import gsplat_version

    return gsplat_version()


def read_cloud(scene: Scene) -> SplatCloud:
    """The splats of a scene, once per process for all observations in it.

    Raises:
        Avs3dError: if it has none, or their file is missing, broken or of another place.
    """
    file = scene.splats
    if file is None:
        raise Avs3dError(
            f"{scene.name}: has no splats to draw; give the scan `splats: FILE.ply` in the manifest, or choose "
            "another --vision"
        )
    try:
        status = file.path.stat()
    except OSError as error:
        raise Avs3dError(f"{file.path}: the splats of {scene.name} cannot be read ({error.strerror})") from None
    cloud = _cloud(file.path, status.st_size, status.st_mtime_ns, np.ascontiguousarray(file.to_world).tobytes())
    _check_place(cloud, scene, file.path)
    return cloud


@lru_cache(maxsize=1)
def _cloud(path: Path, size: int, changed: int, to_world: bytes) -> SplatCloud:
    """The splats of a file of this ``size`` that was last ``changed`` at that time (ns)."""
    return load_cloud(SplatFile(path, np.frombuffer(to_world).reshape(4, 4)))


def _check_place(cloud: SplatCloud, scene: Scene, path: Path) -> None:
    """Refuse splats that lie beside the mesh.

    Raises:
        Avs3dError: if their boxes do not overlap by half of the smaller one in each direction.
    """
    parts = [part.mesh.bounds for part in scene.parts if part.instance_id == 0]
    if not parts:
        return
    mesh = np.stack([np.min([b[0] for b in parts], axis=0), np.max([b[1] for b in parts], axis=0)]).astype(np.float64)
    splats = cloud.inner_box
    overlap = np.minimum(mesh[1], splats[1]) - np.maximum(mesh[0], splats[0])
    least = 0.5 * np.minimum(mesh[1] - mesh[0], splats[1] - splats[0])
    if (overlap < least).any():
        here, there = (np.round(box, 2).tolist() for box in (splats, mesh))
        raise Avs3dError(
            f"{path}: its splats span {here}, the mesh of {scene.name} {there} (m, Y up); expected both in one frame; "
            "export mesh and splats from the same capture, in the same orientation and scale"
        )


class SplatsSession(EmbreeSession):
    """An open scene. For one thread at a time; `share` serves another thread."""

    _keeps = True

    def __init__(self, scene: Scene, intrinsics: Intrinsics, cloud: SplatCloud, painter: Painter) -> None:
        from generators.vision.splats import kernels

        self._splats, self._cloud, self._painter = kernels, cloud, painter
        super().__init__(scene, intrinsics)
        self._unshaded = self._without_shade()

    def _without_shade(self) -> SceneTables | None:
        """The tables without the shade that objects cast on the scan's pictures; None if they cast none."""
        shaded = (self._tables.developed > 0) & (self._tables.light >= 0)
        if not shaded.any():
            return None
        return self._tables._replace(light=np.where(shaded, np.int32(-1), self._tables.light))

    def _allocate(self) -> None:
        super()._allocate()
        pixels = self._intrinsics.width * self._intrinsics.height
        self._inserted = np.empty((pixels, 3), dtype=np.float32)
        self._behind = np.empty((pixels, 3), dtype=np.float32)
        self._plain = np.empty((pixels, 3), dtype=np.float32)
        self._cover = np.empty(pixels, dtype=np.float32)
        self._nearest = np.empty(pixels, dtype=np.float32)

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes.

        Raises:
            Avs3dError: if the session has been closed.
        """
        view = super().render(pose)
        height, width = view.depth.shape
        # 1/depth of what a splat must be nearer than to be in front of the object; 0 where there is no object.
        with np.errstate(divide="ignore"):
            cut = np.where(self._cover > 0, 1.0 / np.maximum(self._nearest - TOLERANCE, self._splats.NEAR), 0.0).astype(
                np.float32
            )
        layers = self._painter.paint(camera_of(self._intrinsics, pose), cut.reshape(height, width))
        rgb = np.empty_like(view.rgb)
        self._splats.develop(
            layers.whole.reshape(-1, 5),
            layers.front.reshape(-1, 4),
            self._inserted,
            self._cover,
            self._behind,
            self._behind if self._unshaded is None else self._plain,
            rgb.reshape(-1, 3),
        )
        return RenderedView(rgb=rgb, depth=view.depth, instance_ids=view.instance_ids)

    def _keep(
        self,
        hit: dict[str, np.ndarray],
        directions: np.ndarray,
        view: PinholeView,
        spread: float,
        light: np.ndarray,
        pixels: slice | np.ndarray,
    ) -> None:
        """Sum up what the rays of some pixels have brought, by what they met."""
        chosen = np.arange(pixels.start, pixels.stop, dtype=np.int32) if isinstance(pixels, slice) else pixels
        faces, samples, tables = hit["primID"], len(light) // len(chosen), self._tables
        self._splats.part_light(faces, light, samples, chosen, tables, self._inserted, self._behind)
        self._splats.part_cover(faces, hit["tfar"], samples, chosen, tables, self._cover, self._nearest)
        if self._unshaded is not None:
            bright = np.empty_like(light)
            distance, u, v = hit["tfar"], hit["u"], hit["v"]
            self._kernels.shade(faces, distance, u, v, directions, view, spread, self._unshaded, bright)
            self._kernels.develop(faces, self._unshaded, self._tone, WHITE, bright)
            self._splats.part_light(faces, bright, samples, chosen, tables, np.empty_like(self._plain), self._plain)


def camera_of(intrinsics: Intrinsics, pose: Pose) -> SplatCamera:
    """A camera at a pose, for the kernels."""
    from generators.vision.splats.kernels import SplatCamera

    right, up, backward = ((float(x), float(y), float(z)) for x, y, z in pose.rotation_matrix.T)
    return SplatCamera(
        right=right,
        down=(-up[0], -up[1], -up[2]),
        ahead=(-backward[0], -backward[1], -backward[2]),
        origin=pose.position,
        fx=float(intrinsics.fx),
        fy=float(intrinsics.fy),
        cx=float(intrinsics.cx),
        cy=float(intrinsics.cy),
        width=intrinsics.width,
        height=intrinsics.height,
    )
