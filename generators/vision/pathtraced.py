"""Path-traced pictures: Mitsuba 3 follows light, our own kernels say what is seen.

Depth and instance ids are those of `generators.vision.embree`, so that masks do not depend on the renderer. Radiance is
the mean of `SAMPLES` paths a pixel; each path has its own random numbers, and a pixel's paths are added by blocks in a
fixed order, so that one kind of device gives the same bytes on every run (Mitsuba's own film adds by atomics, whose
order changes). What a path brings is limited to `MOST_LIGHT` times what is shown as white: rarer, brighter paths would
be single bright pixels. Noise is then removed by Intel's Open Image Denoise (https://www.openimagedenoise.org), which
reads radiance, albedo and normals, if ``pyoidn`` is installed. What shines by itself (lamps, windows, the photographs
of a scan) has no noise, and stays as it was traced.

Materials are the microfacet model of glTF (see `generators.vision.mitsuba_scene`): metal, enamel, tiles and screens
reflect the room. What windows and the pictures of a scan show is taken from `generators.vision.embree`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.freespace import Navigable
from generators.core.scene import F32, Material, Part, Scene
from generators.core.tone import WHITE, develop
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend
from generators.vision.mitsuba_scene import MAX_DEPTH, ROULETTE_DEPTH, MitsubaScene, load_mitsuba
from generators.vision.views import check_camera, pose_number, trial_scene, view_of

#: Paths a pixel, for each of the two scenes (lamps and sky; the sun).
SAMPLES = 64
#: Paths that are followed at once on each kind of device: a picture depends on it, since they share random numbers.
_PATHS = {"cuda": 1 << 24, "llvm": 1 << 21}
#: The most that one path brings, over the radiance that is shown as white.
MOST_LIGHT = 8.0


class PathtracedBackend:
    """Renders with Mitsuba 3: on an NVIDIA GPU, else with LLVM on the CPU."""

    name = "pathtraced"

    @property
    def version(self) -> str:
        """Versions of Mitsuba, its variant and the denoiser: a frame's bytes depend on all three.

        Raises:
            Avs3dError: if Mitsuba is missing, or none of its variants works.
        """
        mi = _mitsuba()
        return f"{mi.__version__} {mi.variant()}, denoiser {_denoiser_version() or 'none'}"

    def warm_up(self) -> None:
        """Compile the kernels.

        Raises:
            Avs3dError: if Mitsuba or a package of ``[generate]`` is missing.
        """
        EmbreeBackend().warm_up()
        scene, camera, pose = trial_scene()
        session = self.open(scene, camera)
        session.render(pose)
        session.close()

    def open(self, scene: Scene, intrinsics: Intrinsics) -> PathtracedSession:
        """Load ``scene`` for a camera with ``intrinsics``.

        Raises:
            Avs3dError: for a scene or camera that cannot be rendered, or if Mitsuba is missing.
        """
        return PathtracedSession(_mitsuba(), scene, intrinsics)

    def navigable(self, home: Scene) -> Navigable | None:
        """None: there is no navigation mesh besides the free space that generators/core/freespace.py measures."""
        return None


@cache
def _mitsuba() -> Any:
    """Mitsuba with the variant of this machine.

    Raises:
        Avs3dError: if it is not installed, or its variants need an LLVM or a driver that is not there.
    """
    return load_mitsuba("cuda_ad_rgb", "llvm_ad_rgb")


@cache
def _denoiser_version() -> str | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("pyoidn")
    except PackageNotFoundError:
        return None


class PathtracedSession:
    """An open scene, for one thread at a time."""

    def __init__(self, mi: Any, scene: Scene, intrinsics: Intrinsics) -> None:
        check_camera(intrinsics)
        scene = scene.shown
        self._mi, self._intrinsics, self._gains, self._black = mi, intrinsics, scene.gains, scene.black
        self._labels = EmbreeBackend().open(scene, intrinsics)
        self._scenes = MitsubaScene(mi, scene).scenes
        # The last one of each stands for no face.
        self._is_picture = _of_faces(scene, lambda part, material: scene.is_scan(part) or material.shown is not None)
        self._shines = self._is_picture | _of_faces(scene, lambda part, material: max(material.emission) > 0)
        self._path = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": ROULETTE_DEPTH})
        self._guide = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes on one kind of device.

        Raises:
            Avs3dError: if the session has been closed.
        """
        labels = self._labels.render(pose)
        radiance, albedo, normal = self._trace(pose)
        face = self._labels.faces
        if _denoiser_version() is not None:
            shines = self._shines[face]
            albedo = np.where(shines[..., None], np.minimum(radiance, 1.0), albedo)
            radiance = np.where(_inside(shines), radiance, _denoised(radiance, albedo, normal))
        # Photographs, with the shadows that objects cast on them, and what windows show come from the other renderer.
        rgb = np.where(_inside(self._is_picture[face]), labels.rgb, develop(radiance + self._black))
        return RenderedView(rgb=rgb, depth=labels.depth, instance_ids=labels.instance_ids)

    def share(self) -> None:
        """None: Mitsuba uses all of a device for one picture."""
        return

    def close(self) -> None:
        """Free the resources of the session; closing twice is allowed."""
        self._labels.close()
        self._scenes = []

    def _trace(self, pose: Pose) -> tuple[F32, F32, F32]:
        """Exposed radiance, albedo and normal (H, W, 3) of each pixel, the mean over its square."""
        import drjit as dr

        camera, most = self._intrinsics, MOST_LIGHT * WHITE
        rows = max(1, _PATHS[self._mi.variant().split("_")[0]] // (SAMPLES * camera.width))
        # Each pose has random numbers of its own: with the same ones, noise would stand still before a moving camera.
        seed = pose_number(pose)
        total = np.zeros((3, camera.height * camera.width, 3), dtype=np.float32)
        for first in range(0, camera.height, rows):
            count = min(rows, camera.height - first) * camera.width
            block = slice(first * camera.width, first * camera.width + count)
            for number, scene in enumerate(self._scenes):
                rays, sampler = self._rays(pose, block.start, count, seed + number)
                found = self._path.sample(scene, sampler, rays)[0]
                light = [self._mi.Float(found[channel] * float(self._gains[channel])) for channel in range(3)]
                # Once for all that follows; and one scene at a time, since OptiX cannot trace two in one kernel.
                dr.eval(light)
                total[0, block] += self._means(light, most)
                if number == 0:
                    guides = self._guide.sample(scene, sampler, rays)[2]
                    dr.eval(guides)
                    total[1, block], total[2, block] = self._means(guides[0:3], 1.0), self._means(guides[3:6], 1.0)
        radiance, albedo, normal = total.reshape(3, camera.height, camera.width, 3)
        return radiance, albedo, normal

    def _rays(self, pose: Pose, first: int, count: int, seed: int) -> tuple[Any, Any]:
        """`SAMPLES` rays through each of ``count`` pixels from ``first`` on, and their random numbers."""
        import drjit as dr

        mi, view = self._mi, view_of(self._intrinsics, pose)
        sampler = mi.load_dict({"type": "independent"})
        # Opaque: else each pose would be compiled into a kernel of its own.
        start, number = dr.opaque(mi.UInt32, first), dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        origin, corner, right, down = (mi.Vector3f(v) for v in (view.origin, view.corner, view.right, view.down))
        dr.make_opaque(origin, corner, right, down)
        sampler.seed(number, count * SAMPLES)
        pixel = dr.arange(mi.UInt32, count * SAMPLES) // SAMPLES + start
        inside = sampler.next_2d()
        x = mi.Float(pixel % view.width) + inside.x
        y = mi.Float(pixel // view.width) + inside.y
        direction = corner + right * x + down * y
        return mi.RayDifferential3f(mi.Point3f(origin), dr.normalize(direction)), sampler

    def _means(self, values: Any, most: float) -> F32:
        """(pixels, 3) means of `SAMPLES` consecutive values of each channel, none above ``most``."""
        import drjit as dr

        sums = [np.array(dr.block_sum(dr.minimum(values[channel], most), SAMPLES)) for channel in range(3)]
        return np.asarray(np.stack(sums, axis=1) / SAMPLES, dtype=np.float32)


def _of_faces(scene: Scene, is_so: Callable[[Part, Material], bool]) -> NDArray[np.bool_]:
    """(faces + 1,) whether it is so for each face; False at the end."""
    table = [np.array([is_so(part, m) for m in part.mesh.materials])[part.mesh.face_material] for part in scene.parts]
    return np.append(np.concatenate(table), False)


def _inside(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W, 1) the pixels of ``mask`` (H, W) whose eight neighbours belong to it, too."""
    return ndimage.binary_erosion(mask, np.ones((3, 3), dtype=bool), border_value=1)[..., None]


def _denoised(radiance: F32, albedo: F32, normal: F32) -> F32:
    import pyoidn

    return np.asarray(pyoidn.denoise(radiance, albedo=albedo, normal=normal, hdr=True), dtype=np.float32)
