"""Our scenes in Mitsuba 3: the same triangles, textures, lamps, windows and sun.

Mitsuba (BSD-3, ``pip install mitsuba``) traces paths and knows nothing of light maps, so that its pictures test ours
(benchmarks/light_reference.py) and are pictures of their own (generators/vision/pathtraced.py). A scene is handed over
in memory:

- A matte material becomes Mitsuba's ``diffuse``, its colour times its texture as a bitmap of linear values.
- Any other is the microfacet model of glTF and of Burley, "Physically-based shading at Disney" (SIGGRAPH 2012
  courses), with its maps: Mitsuba's ``principled`` (generators/vision/mitsuba_materials.py).
- A face that emits becomes an area light that shines from its front.
- The texture of a scan is light already: its faces emit the colour of their middle, in steps of a
  `STEPS`-th of a stop, and reflect nothing. Nothing emits a texture, because Mitsuba then traces rays inside of each
  mesh, which its OptiX code cannot do for several in one kernel.
- The sun of our model shines through large panes, which are opaque for everything else. A path tracer has no such
  panes, but light adds up: the sun is rendered apart, as a far disc, in a scene whose sunny panes are taken out.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.cuda import OutOfDeviceMemoryError
from generators.core.rays import Tracer
from generators.core.scene import Material, Mesh, Room, Scene
from generators.core.tone import decode_table, inverse_tone_curve
from generators.lighting.sun import SUN_RADIUS, Sun, find_sun
from generators.lighting.surfaces import LitSurfaces
from generators.vision.lamps import Lamp, lamp_weights
from generators.vision.mitsuba_materials import MitsubaMaterials, is_mirrored, look_of

F32 = NDArray[np.float32]

#: In order of preference: vectorised on the LLVM library of the system; slow.
VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
#: Distance of the disc that stands for the sun (m): across a home its direction turns by 10⁻⁴.
_SUN_DISTANCE = 1e5
#: A path ends after this many reflections; at a mean albedo of 0.7 it then carries 10⁻⁵ of its light.
MAX_DEPTH = 32
#: Steps in a stop in which the light of photographs is told apart, and the least light that counts.
STEPS, LEAST_LIGHT = 2, 2.0**-8
_FULL = (
    "path tracing: the GPU has too little free memory; expected up to 4 GB for each process with pictures of 1008²; "
    "use fewer --workers or a smaller --size, end other programs on it, or name another GPU in $CUDA_VISIBLE_DEVICES"
)
#: From this reflection on a path ends by chance, with the probability that its light is absorbed.
ROULETTE_DEPTH = 3


def load_mitsuba(*variants: str) -> Any:
    """The module ``mitsuba`` with a variant set: the first of ``variants`` (default: `VARIANTS`) that works.

    Raises:
        Avs3dError: if Mitsuba is not installed, or has no such variant, or none works.
        OutOfDeviceMemoryError: if a variant that comes before all that work has no memory on its GPU.
    """
    try:
        import mitsuba as mi
    except ImportError as error:
        raise Avs3dError(
            f"Mitsuba cannot be imported ({error}); install it: pip install 'avs3d-bench[pathtraced]'"
        ) from error
    wanted = variants or VARIANTS
    for name in wanted:
        if name not in mi.variants():
            raise Avs3dError(f"mitsuba: no variant {name!r}; expected some of {', '.join(mi.variants())}")
        if name.startswith("scalar") or (failure := _failure(name)) is None:
            mi.set_variant(name)
            mi.set_log_level(mi.LogLevel.Error)
            return mi
        if _says_out_of_memory(failure):
            raise OutOfDeviceMemoryError(_FULL)  # not the next variant: it would take a hundred times as long
    raise Avs3dError(
        f"mitsuba: none of its variants {', '.join(wanted)} works here; expected an NVIDIA GPU with its driver, or an "
        "LLVM library of version 16 or newer (Debian and Ubuntu: apt install libllvm19), which $DRJIT_LIBLLVM_PATH "
        "names if it is not found by itself"
    )


@contextmanager
def device_memory() -> Iterator[None]:
    """What Dr.Jit says where a GPU is full becomes one line.

    Raises:
        OutOfDeviceMemoryError: in its place.
    """
    try:
        yield
    except RuntimeError as error:
        if _says_out_of_memory(str(error)):
            raise OutOfDeviceMemoryError(_FULL) from error
        raise


def _says_out_of_memory(text: str) -> bool:
    """Whether a message of Dr.Jit or of CUDA (``CUDA_ERROR_OUT_OF_MEMORY``) is about memory."""
    return "out of memory" in text.lower().replace("_", " ")


def _failure(variant: str) -> str | None:
    """What a variant says that cannot compute: with too old an LLVM it ends the process, hence one of its own."""
    program = (
        f"import mitsuba as mi; mi.set_variant({variant!r}); mi.render(mi.load_dict(mi.cornell_box()), spp=1).numpy()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    return None if done.returncode == 0 else done.stderr.decode(errors="replace")


@dataclass(frozen=True, eq=False)
class _Group:
    """Faces of one material: corners, shading normals and texture coordinates (F, 3, …).

    ``mirrored``: whether the texture coordinates are.
    """

    material: Material
    positions: F32
    normals: F32
    uv: F32
    mirrored: bool = False


class MitsubaScene:
    """A scene as Mitsuba sees it.

    Args:
        mi: from `load_mitsuba`.
        scene: the scene; its light maps are not read.
        room: the room whose pictures are rendered: lamps that light it are tried more often than others
            (`generators.vision.lamps`), which changes the noise alone.

    Attributes:
        scenes: Mitsuba's scenes, whose radiance adds up.
    """

    def __init__(self, mi: Any, scene: Scene, room: Room | None = None) -> None:
        self._mi = mi
        self._materials = MitsubaMaterials(mi)
        surfaces = LitSurfaces.of(scene.parts)
        tracer = Tracer(surfaces.triangles)
        sun = find_sun(scene.name, surfaces, tracer)
        pane = np.zeros(len(surfaces.triangles), dtype=bool) if sun is None else sun.pane
        self.scenes = [self._lit_by_lamps(self._groups(scene, np.ones(len(pane), dtype=bool)), tracer, room)]
        if sun is not None and not pane.all():
            self.scenes.append(self._lit_by(sun, self._groups(scene, ~pane)))

    def render(self, pose: Pose, camera: Intrinsics, samples: int, seed: int = 0) -> F32:
        """Radiance (H, W, 3) float32, the mean over each pixel's square.

        Args:
            pose: of the camera.
            camera: its intrinsics, with the principal point in the middle.
            samples: paths per pixel.
            seed: of the random numbers.
        """
        mi = self._mi
        right, up, backward = np.asarray(pose.rotation_matrix).T
        matrix = np.eye(4)
        # Mitsuba's camera looks along +Z with +X to the left.
        matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = -right, up, -backward, pose.position
        sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
                "fov_axis": "x",
                "near_clip": 1e-3,
                "to_world": mi.ScalarTransform4f(matrix),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width,
                    "height": camera.height,
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent", "sample_count": samples},
            }
        )
        integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": ROULETTE_DEPTH})
        total = np.zeros((camera.height, camera.width, 3), dtype=np.float32)
        for number, scene in enumerate(self.scenes):
            total += np.array(
                mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=2 * seed + number)
            )
        return total

    def _lit_by_lamps(self, groups: list[_Group], tracer: Tracer, room: Room | None) -> Any:
        """A scene lit by all that emits."""
        lamps = {
            number: Lamp(group.positions, group.normals, group.material.emission)
            for number, group in enumerate(groups)
            if max(group.material.emission) > 0
        }
        weights = dict(zip(lamps, lamp_weights(list(lamps.values()), tracer, room).tolist(), strict=True))
        shapes = {f"mesh_{number}": self._mesh(group, weights.get(number)) for number, group in enumerate(groups)}
        return self._mi.load_dict({"type": "scene", **shapes})

    def _lit_by(self, sun: Sun, groups: list[_Group]) -> Any:
        """A scene lit by the sun alone."""
        mi = self._mi
        corners = np.concatenate([group.positions.reshape(-1, 3) for group in groups]).astype(np.float64)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        away = middle + _SUN_DISTANCE * sun.direction
        radiance = np.asarray(sun.radiance, dtype=np.float64) / SUN_RADIUS**2
        disc = {
            "type": "disk",
            "to_world": mi.ScalarTransform4f().look_at(origin=away.tolist(), target=middle.tolist(), up=[0.0, 1.0, 0.0])
            @ mi.ScalarTransform4f().scale(SUN_RADIUS * _SUN_DISTANCE),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}},
        }
        shapes = {f"mesh_{number}": self._mesh(group, None) for number, group in enumerate(groups)}
        return mi.load_dict({"type": "scene", **shapes, "sun": disc})

    def _mesh(self, group: _Group, tried: float | None) -> Any:
        """Faces, which emit if they are ``tried`` as lamps: so often."""
        mi = self._mi
        properties = mi.Properties()
        properties["mesh_bsdf"] = self._materials.bsdf(group.material, mirrored=group.mirrored)
        if tried is not None:
            properties["mesh_emitter"] = mi.load_dict(
                {
                    "type": "area",
                    "radiance": {"type": "rgb", "value": list(group.material.emission)},
                    "sampling_weight": tried,
                }
            )
        count = len(group.positions)
        mesh = mi.Mesh(
            group.material.name, 3 * count, count, props=properties, has_vertex_normals=True, has_vertex_texcoords=True
        )
        arrays = mi.traverse(mesh)
        # Row 0 of a bitmap lies at v = 0, that of our textures at v = 1.
        uv = np.stack([group.uv[..., 0], 1.0 - group.uv[..., 1]], axis=-1)
        arrays["vertex_positions"] = group.positions.ravel()
        arrays["vertex_normals"] = group.normals.ravel()
        arrays["vertex_texcoords"] = uv.astype(np.float32).ravel()
        arrays["faces"] = np.arange(3 * count, dtype=np.uint32)
        arrays.update()
        return mesh

    def _groups(self, scene: Scene, wanted: NDArray[np.bool_]) -> list[_Group]:
        """The ``wanted`` faces (F,) of a scene by material; lamps by part too, so that each is sampled for itself."""
        found: dict[tuple[Any, ...], tuple[Material, list[tuple[F32, F32, F32]]]] = {}
        first = 0
        for number, part in enumerate(scene.parts):
            mesh, is_picture = part.mesh, scene.is_scan(part)
            edges = mesh.positions.astype(np.float64)
            solid = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) > 1e-12
            solid &= wanted[first : first + len(edges)]
            first += len(edges)
            for index, material in enumerate(mesh.materials):
                faces = np.flatnonzero((mesh.face_material == index) & solid)
                kinds = [(material, faces)]
                if is_picture:
                    light = inverse_tone_curve(middle_colours(material, mesh.uv[faces])) / scene.gains
                    black = Material(material.name, material.acoustic, (0.0, 0.0, 0.0))
                    kinds = [(replace(black, emission=radiance), faces[own]) for radiance, own in _alike(light)]
                for kind, own in kinds:
                    is_lamp = not is_picture and max(kind.emission) > 0
                    for mirrored, faces in sides(kind, mesh, own):
                        piece = mesh.positions[faces], mesh.normals[faces], mesh.uv[faces]
                        key = (*look_of(kind), mirrored, number if is_lamp else -1)
                        found.setdefault(key, (kind, []))[1].append(piece)
        out = []
        for key, (material, pieces) in found.items():
            positions, normals, uv = (np.concatenate([piece[k] for piece in pieces]) for k in range(3))
            out.append(_Group(material, positions, normals, uv, mirrored=key[-2]))
        return out


def sides(material: Material, mesh: Mesh, faces: NDArray[np.int64]) -> Iterator[tuple[bool, NDArray[np.int64]]]:
    """The indices ``faces`` of a mesh, for a material with a normal map those of mirrored uv apart."""
    mirrored = np.zeros(len(faces), dtype=bool)
    if material.normal_map is not None:
        mirrored = is_mirrored(mesh.positions[faces], mesh.uv[faces], mesh.normals[faces])
    for side in (False, True):
        if (mirrored == side).any():
            yield side, faces[mirrored == side]


def middle_colours(material: Material, uv: F32) -> NDArray[np.float64]:
    """(F, 3) linear colour in the middle of faces with the texture coordinates ``uv`` (F, 3, 2)."""
    colour = np.asarray(material.colour, dtype=np.float64)
    if material.texture is None:
        return np.broadcast_to(colour, (len(uv), 3))
    pixels = material.texture.pixels
    u, v = np.mod(uv.mean(axis=1), 1.0).T
    rows = np.clip((1.0 - v) * pixels.shape[0], 0, pixels.shape[0] - 1).astype(int)
    columns = np.clip(u * pixels.shape[1], 0, pixels.shape[1] - 1).astype(int)
    return np.asarray(decode_table()[pixels[rows, columns, :3]] * colour)


def _alike(light: NDArray[np.float64]) -> Iterator[tuple[tuple[float, float, float], NDArray[np.int64]]]:
    """Radiances and the indices of the values (F, 3) within half a step of each."""
    steps = np.round(STEPS * np.log2(np.maximum(light, LEAST_LIGHT))).astype(int)
    kinds, kind = np.unique(steps, axis=0, return_inverse=True)
    for number, step in enumerate(kinds):
        red, green, blue = (2.0 ** (step / STEPS)).tolist()
        yield (red, green, blue), np.flatnonzero(kind.ravel() == number)
