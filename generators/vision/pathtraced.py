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

import copy
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.freespace import Navigable
from generators.core.scene import F32, Material, Part, Scene
from generators.core.tone import WHITE, develop
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend
from generators.vision.mitsuba_scene import MAX_DEPTH, ROULETTE_DEPTH, MitsubaScene, device_memory, load_mitsuba
from generators.vision.views import check_camera, pose_number, room_at, trial_scene, view_of

#: Paths a pixel, for each of the two scenes (lamps and sky; the sun).
SAMPLES = 64
#: Paths that are followed at once on each kind of device: a picture depends on it, since they share random numbers.
_PATHS = {"cuda": 1 << 24, "llvm": 1 << 21}
#: Blocks of so many paths that wait on each kind of device, each with its memory (up to 1 GB on a GPU).
_AHEAD = {"cuda": 4, "llvm": 1}
#: Frames in work at a time on each kind of device: on a GPU, one that it draws, and others that the CPU finishes. LLVM
#: uses all cores for one.
_AT_ONCE = {"cuda": 3, "llvm": 1}
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

    @property
    def frames_at_once(self) -> int:
        """See `generators.vision.base.frames_at_once`.

        Raises:
            Avs3dError: if Mitsuba is missing, or none of its variants works.
        """
        return _AT_ONCE[_mitsuba().variant().split("_")[0]]

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
    """An open scene, for one thread at a time.

    `share` serves other threads: the device follows the paths of one frame after another, and each thread finishes its
    frame (labels, denoising, tone curve) while the device is at work on the next.
    """

    def __init__(self, mi: Any, scene: Scene, intrinsics: Intrinsics) -> None:
        check_camera(intrinsics)
        self._intrinsics = intrinsics
        self._scene: Scene | None = scene.shown
        self._labels = EmbreeBackend().open(self._scene, intrinsics)
        # The last one of each stands for no face.
        self._is_picture = _of_faces(scene, lambda part, material: scene.is_scan(part) or material.shown is not None)
        self._shines = self._is_picture | _of_faces(scene, lambda part, material: max(material.emission) > 0)
        self._paths = _Paths(mi, self._scene, intrinsics)

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes on one kind of device.

        Raises:
            Avs3dError: if the session has been closed.
        """
        traced = self.begin(pose)
        labels = self.labels(pose)  # while the device follows the paths
        return replace(labels, rgb=self.finish(traced.result(), labels))

    def begin(self, pose: Pose) -> Future[F32]:
        """Have the device follow the paths of a frame after those that have begun before.

        Returns:
            The sums over the paths of each pixel: (3, H, W, 3) exposed radiance, albedo and normal.

        Raises:
            Avs3dError: if the session has been closed.
        """
        if self._scene is None:
            raise Avs3dError("the renderer's session is closed; open the scene again")
        return _device_thread().submit(self._paths.trace, pose)

    def labels(self, pose: Pose) -> RenderedView:
        """Depth and ids, and the colours of what is a picture already: photographs and what windows show."""
        return self._labels.labels(pose, self._is_picture)

    def finish(self, sums: F32, labels: RenderedView, *, denoise: bool = True) -> NDArray[np.uint8]:
        """The picture (H, W, 3) of what `begin` gives; ``labels`` are the last that `labels` gave, of the same pose."""
        assert self._scene is not None
        face = self._labels.faces
        radiance, albedo, normal = sums / np.float32(SAMPLES)
        if denoise and _denoiser_version() is not None:
            shines = self._shines[face]
            albedo = np.where(shines[..., None], np.minimum(radiance, 1.0), albedo)
            radiance = np.where(_inside(shines), radiance, _denoised(radiance, albedo, normal))
        # Photographs, with the shadows that objects cast on them, and what windows show come from the other renderer.
        return np.where(_inside(self._is_picture[face]), labels.rgb, develop(radiance + self._scene.black))

    def share(self) -> PathtracedSession:
        """The same scene and device with working memory of its own."""
        other = copy.copy(self)
        other._labels = self._labels.share()
        return other

    def close(self) -> None:
        """Free the resources of the session; closing twice is allowed."""
        self._labels.close()
        _device_thread().submit(self._paths.clear).result()
        self._scene = None


@cache
def _device_thread() -> ThreadPoolExecutor:
    """The one thread that speaks with Dr.Jit, whose recorded programs and streams are not for several at a time."""
    return ThreadPoolExecutor(1, "paths")


# A fork has no threads.
os.register_at_fork(after_in_child=_device_thread.cache_clear)


class _Paths:
    """The paths through a scene's pictures; its methods are for `_device_thread` alone."""

    def __init__(self, mi: Any, scene: Scene, intrinsics: Intrinsics) -> None:
        self._mi, self._scene, self._intrinsics = mi, scene, intrinsics
        kind = mi.variant().split("_")[0]
        self._ahead, most = _AHEAD[kind], max(1, _PATHS[kind] // (SAMPLES * intrinsics.width))
        #: Rows of a block; all have as many, so that one recorded program serves them all.
        self._rows = ceil(intrinsics.height / ceil(intrinsics.height / most))
        self._room: str | None = None
        self._programs: list[tuple[Any, Callable[..., list[Any]]]] = []

    def clear(self) -> None:
        """Free what lies on the device."""
        self._programs, self._room = [], None

    def trace(self, pose: Pose) -> F32:
        """Exposed radiance, albedo and normal (3, H, W, 3), summed over the paths of each pixel.

        Raises:
            OutOfDeviceMemoryError: if the scene or the paths do not fit on the GPU.
        """
        with device_memory():
            return self._traced(pose)

    def _traced(self, pose: Pose) -> F32:
        blocks = self._begun(pose)
        height, width = self._intrinsics.height, self._intrinsics.width
        sums = np.empty((3, len(blocks) * self._rows * width, 3), dtype=np.float32)
        for number, block in enumerate(blocks):
            place = slice(number * self._rows * width, (number + 1) * self._rows * width)
            for kind, values in enumerate(block):
                sums[kind, place] = np.array(values).reshape(-1, 3)
        return sums[:, : height * width].reshape(3, height, width, 3)

    def _programs_for(self, room: str) -> list[tuple[Any, Callable[..., list[Any]]]]:
        """Each of Mitsuba's scenes, and the program that follows its paths, with lamps tried as suits ``room``.

        What Python says about hundreds of materials and lamps takes seconds; Dr.Jit records it with the first block,
        and repeats the kernels alone for all others. It records the lamps' shares, too.
        """
        import drjit as dr

        if room != self._room:
            self._programs = []  # first, for the memory
            scenes = MitsubaScene(self._mi, self._scene, self._scene.room(room) if room else None).scenes
            width, rows = self._intrinsics.width, self._rows
            self._programs = [
                (one, dr.freeze(_program(self._mi, width, rows, guides=number == 0)))
                for number, one in enumerate(scenes)
            ]
            self._room = room
        return self._programs

    def _begun(self, pose: Pose) -> list[list[Any]]:
        """Of each block radiance, albedo and normal, summed, in the order of the pixels; the device may be at work."""
        import drjit as dr

        mi, view, programs = self._mi, view_of(self._intrinsics, pose), self._programs_for(room_at(self._scene, pose))
        given = (view.origin, view.corner, view.right, view.down, self._scene.gains)
        vectors = [mi.Vector3f(*(float(each) for each in one)) for one in given]
        # Opaque: else each pose would be compiled into a kernel of its own.
        dr.make_opaque(vectors)
        # Each pose has random numbers of its own: with the same ones, noise would stand still before a moving camera.
        seed = pose_number(pose)
        done: list[list[Any]] = []
        for first in range(0, view.height, self._rows):
            if done and len(done) % self._ahead == 0:
                dr.sync_thread()
            start = dr.opaque(mi.UInt32, first * view.width)
            seeds = [dr.opaque(mi.UInt32, (seed + 2 * first + number) & 0xFFFFFFFF) for number in range(len(programs))]
            # One scene at a time, since OptiX cannot trace two in one kernel.
            lamps, *suns = [run(one, start, own, vectors) for (one, run), own in zip(programs, seeds, strict=True)]
            for sun in suns:
                lamps[:3] = [light + more for light, more in zip(lamps[:3], sun, strict=True)]
            block = [dr.ravel(mi.Vector3f(*lamps[kind : kind + 3])) for kind in (0, 3, 6)]
            dr.eval(block)
            done.append(block)
        return done


def _program(mi: Any, width: int, rows: int, *, guides: bool) -> Callable[..., list[Any]]:
    """What follows `SAMPLES` paths through each pixel of some rows.

    Args:
        mi: Mitsuba.
        width: of the picture.
        rows: how many.
        guides: whether albedo and normals are wanted, too.

    Returns:
        A function of a scene, the number of the first pixel, the seed of the random numbers, and the vectors of the
        view (origin, corner, right, down) and of the gains; it returns sums over the paths of each pixel: of the light
        of three channels, none above `MOST_LIGHT` times white, of albedo and of the normal.
    """
    import drjit as dr

    path = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": ROULETTE_DEPTH})
    guide = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
    count = width * rows * SAMPLES

    def follow(scene: Any, start: Any, seed: Any, vectors: list[Any]) -> list[Any]:
        origin, corner, right, down, gains = vectors
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count)
        pixel = dr.arange(mi.UInt32, count) // SAMPLES + start
        inside = sampler.next_2d()
        x = mi.Float(pixel % width) + inside.x
        y = mi.Float(pixel // width) + inside.y
        rays = mi.RayDifferential3f(mi.Point3f(origin), dr.normalize(corner + right * x + down * y))
        found = path.sample(scene, sampler, rays)[0]
        values = [dr.minimum(found[channel] * gains[channel], MOST_LIGHT * WHITE) for channel in range(3)]
        dr.eval(values)  # once for all that follows
        if guides:
            values += [dr.minimum(value, 1.0) for value in guide.sample(scene, sampler, rays)[2][:6]]
            dr.eval(values)
        return [dr.block_sum(value, SAMPLES) for value in values]

    return follow


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
