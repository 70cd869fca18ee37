"""Our scenes in Mitsuba 3: the same triangles, textures, lamps, windows and sun.

Mitsuba (BSD-3, ``pip install mitsuba``) traces paths and knows nothing of light maps, so that its pictures test ours
(benchmarks/light_reference.py) and are pictures of their own (generators/vision/pathtraced.py). A scene is handed over
in memory:

- A matte material becomes Mitsuba's ``diffuse``, its colour times its texture as a bitmap of linear values.
- A material with `Material.gloss` reflects, as ``lobe``, a lobe about the normal whatever the direction it is seen from
  (generators/lighting/form_factors.py); `NormalLobe` is this model, and needs a vectorised variant (``llvm_ad_rgb``).
  As ``physical`` it is the microfacet model of glTF, with its maps (generators/vision/mitsuba_materials.py).
- A face that emits becomes an area light that shines from its front.
- The texture of a scan is light already: as ``physical`` its faces emit the colour of their middle, in steps of a
  `STEPS`-th of a stop, and reflect nothing. Nothing emits a texture, because Mitsuba then traces rays inside of each
  mesh, which its OptiX code cannot do for several in one kernel.
- The sun of our model shines through large panes, which are opaque for everything else. A path tracer has no such
  panes, but light adds up: the sun is rendered apart, as a far disc, in a scene whose sunny panes are taken out.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.rays import Tracer
from generators.core.scene import Material, Mesh, Room, Scene
from generators.core.tone import decode_table, inverse_tone_curve
from generators.lighting.form_factors import LOBE
from generators.lighting.sun import SUN_RADIUS, Sun, find_sun
from generators.lighting.surfaces import LitSurfaces
from generators.vision.mitsuba_materials import MitsubaMaterials, is_mirrored, look_of

F32 = NDArray[np.float32]

#: In order of preference: vectorised on the LLVM library of the system; slow, and only for matte materials.
VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
#: How materials reflect: without gloss, with our lobe, or by a microfacet model.
Look = Literal["matte", "lobe", "physical"]
#: Distance of the disc that stands for the sun (m): across a home its direction turns by 10⁻⁴.
_SUN_DISTANCE = 1e5
#: How often lamps of other rooms are sampled, over those of the room in the picture, for equal power.
_ELSEWHERE = 0.05
#: Lamps this far outside of a room's box belong to it (m): the panes of its windows lie in the wall.
_WALL = 0.4
#: A path ends after this many reflections; at a mean albedo of 0.7 it then carries 10⁻⁵ of its light.
MAX_DEPTH = 32
#: Steps in a stop in which the light of photographs is told apart, and the least light that counts.
STEPS, LEAST_LIGHT = 2, 2.0**-8
#: From this reflection on a path ends by chance, with the probability that its light is absorbed.
ROULETTE_DEPTH = 3


def load_mitsuba(*variants: str) -> Any:
    """The module ``mitsuba`` with a variant set: the first of ``variants`` (default: `VARIANTS`) that works.

    Raises:
        Avs3dError: if Mitsuba is not installed, or has no such variant, or none works.
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
        if name.startswith("scalar") or _works(name):
            mi.set_variant(name)
            mi.set_log_level(mi.LogLevel.Error)
            return mi
    raise Avs3dError(
        f"mitsuba: none of its variants {', '.join(wanted)} works here; expected an NVIDIA GPU with its driver, or an "
        "LLVM library of version 16 or newer (Debian and Ubuntu: apt install libllvm19), which $DRJIT_LIBLLVM_PATH "
        "names if it is not found by itself"
    )


def _works(variant: str) -> bool:
    """Whether a variant can compute anything: with too old an LLVM it ends the process, hence one of its own."""
    program = (
        f"import mitsuba as mi; mi.set_variant({variant!r}); mi.render(mi.load_dict(mi.cornell_box()), spp=1).numpy()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    return done.returncode == 0


@dataclass(frozen=True, eq=False)
class _Group:
    """Faces of one material: corners, shading normals and texture coordinates (F, 3, …), and the faces' area (m²).

    ``mirrored``: whether the texture coordinates are.
    """

    material: Material
    positions: F32
    normals: F32
    uv: F32
    mirrored: bool = False

    @property
    def area(self) -> float:
        edges = self.positions.astype(np.float64)
        return float(np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1).sum() / 2)


class MitsubaScene:
    """A scene as Mitsuba sees it.

    Args:
        mi: from `load_mitsuba`.
        scene: the scene; its light maps are not read.
        room: the room whose pictures are rendered: its lamps are sampled more often, which changes the noise alone.
        look: how materials reflect.

    Attributes:
        scenes: Mitsuba's scenes, whose radiance adds up.

    Raises:
        Avs3dError: if a material has gloss and the variant has no ``lobe``.
    """

    def __init__(self, mi: Any, scene: Scene, room: Room | None = None, *, look: Look = "lobe") -> None:
        self._mi, self._look, self._room = mi, look, room
        if look == "lobe" and mi.variant().startswith("scalar"):
            glossy = [m.name for part in scene.parts for m in part.mesh.materials if m.gloss > 0]
            if glossy:
                raise Avs3dError(
                    f"mitsuba: {glossy[0]} has gloss, which needs the variant llvm_ad_rgb, found {mi.variant()}; "
                    "set DRJIT_LIBLLVM_PATH to an LLVM library of version 16 or newer, or compare matte materials"
                )
        self._materials = MitsubaMaterials(mi)
        self._bsdfs: dict[tuple[Any, ...], Any] = {}
        self._lobe = normal_lobe(mi) if look == "lobe" and not mi.variant().startswith("scalar") else None
        surfaces = LitSurfaces.of(scene.parts)
        sun = find_sun(scene.name, surfaces, Tracer(surfaces.triangles))
        pane = np.zeros(len(surfaces.triangles), dtype=bool) if sun is None else sun.pane
        self.scenes = [self._load(self._groups(scene, np.ones(len(pane), dtype=bool)), None)]
        if sun is not None and not pane.all():
            self.scenes.append(self._load(self._groups(scene, ~pane), sun))

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

    def _load(self, groups: list[_Group], sun: Sun | None) -> Any:
        """A scene lit by the sun alone, or, without it, by all that emits."""
        mi = self._mi
        shapes: dict[str, Any] = {"type": "scene"}
        for number, group in enumerate(groups):
            shapes[f"mesh_{number}"] = self._mesh(group, emits=sun is None and max(group.material.emission) > 0)
        if sun is not None:
            corners = np.concatenate([group.positions.reshape(-1, 3) for group in groups]).astype(np.float64)
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
            away = middle + _SUN_DISTANCE * sun.direction
            radiance = np.asarray(sun.radiance, dtype=np.float64) / SUN_RADIUS**2
            shapes["sun"] = {
                "type": "disk",
                "to_world": mi.ScalarTransform4f().look_at(
                    origin=away.tolist(), target=middle.tolist(), up=[0.0, 1.0, 0.0]
                )
                @ mi.ScalarTransform4f().scale(SUN_RADIUS * _SUN_DISTANCE),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}},
            }
        return mi.load_dict(shapes)

    def _mesh(self, group: _Group, *, emits: bool) -> Any:
        mi = self._mi
        properties = mi.Properties()
        properties["mesh_bsdf"] = self._bsdf(group.material, group.mirrored)
        if emits:
            properties["mesh_emitter"] = mi.load_dict(
                {
                    "type": "area",
                    "radiance": {"type": "rgb", "value": list(group.material.emission)},
                    "sampling_weight": self._weight(group),
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

    def _weight(self, group: _Group) -> float:
        """How often an emitter is sampled: by its power, less if it is outside of the room."""
        power = group.area * sum(group.material.emission)
        if self._room is None:
            return power
        low, high = np.array(self._room.low) - _WALL, np.array(self._room.high) + _WALL
        centre = group.positions.reshape(-1, 3)
        inside = bool(np.all((centre >= low) & (centre <= high), axis=1).any())
        return power * (1.0 if inside else _ELSEWHERE)

    def _bsdf(self, material: Material, mirrored: bool) -> Any:
        if self._look == "physical":
            return self._materials.bsdf(material, mirrored=mirrored)
        key = (id(material.texture), material.colour, gloss := 0.0 if self._look == "matte" else material.gloss)
        if key not in self._bsdfs:
            plain = Material(material.name, material.acoustic, material.colour, material.texture)
            inner = self._materials.bsdf(plain)
            if gloss > 0:
                inner = {"type": self._lobe, "gloss": gloss, "reflectance": self._materials.colour(material)}
                inner = self._mi.load_dict({"type": "twosided", "bsdf": inner})
            self._bsdfs[key] = inner
        return self._bsdfs[key]

    def _groups(self, scene: Scene, wanted: NDArray[np.bool_]) -> list[_Group]:
        """The ``wanted`` faces (F,) of a scene by material; lamps by part too, so that each is sampled for itself."""
        found: dict[tuple[Any, ...], tuple[Material, list[tuple[F32, F32, F32]]]] = {}
        first = 0
        for number, part in enumerate(scene.parts):
            mesh, is_picture = part.mesh, self._look == "physical" and scene.is_scan(part)
            edges = mesh.positions.astype(np.float64)
            solid = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) > 1e-12
            solid &= wanted[first : first + len(edges)]
            first += len(edges)
            for index, material in enumerate(mesh.materials):
                faces = np.flatnonzero((mesh.face_material == index) & solid)
                kinds = [(material, faces)]
                if is_picture:
                    light = inverse_tone_curve(middle_colours(material, mesh.uv[faces])) / scene.exposure
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


def normal_lobe(mi: Any) -> str:
    """Register our model of glossy reflection with Mitsuba; returns the plugin's name.

    A surface of gloss g reflects ρ·((1 − g)·E/π + g·∫ L (n + 1)/2π · cosⁿθ dω) into every direction, n = `LOBE`.
    """
    import drjit as dr

    name = "avs3d_normal_lobe"

    class NormalLobe(mi.BSDF):  # type: ignore[misc]
        """See `normal_lobe`."""

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.reflectance = props.get_texture("reflectance")
            self.gloss = mi.Float(props["gloss"])
            dr.make_opaque(self.gloss)
            flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags]
            self.m_flags = flags

        def _density(self, cosine: Any) -> Any:
            """Of the sampled direction, which is what is reflected over the albedo too."""
            lobe = dr.power(cosine, LOBE) * ((LOBE + 1.0) / (2.0 * np.pi))
            return dr.lerp(cosine * (1.0 / np.pi), lobe, self.gloss)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any) -> Any:
            bs = mi.BSDFSample3f()
            exponent = dr.select(sample1 < self.gloss, 1.0 / (LOBE + 1.0), 0.5)
            cosine = dr.power(dr.maximum(sample2.x, 1e-12), exponent)
            sine, (s, c) = dr.safe_sqrt(1.0 - cosine * cosine), dr.sincos(2.0 * np.pi * sample2.y)
            bs.wo = mi.Vector3f(sine * c, sine * s, cosine)
            bs.pdf = self._density(cosine)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+self.m_flags)
            bs.sampled_component = mi.UInt32(0)
            valid = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (bs.pdf > 0)
            return bs, self.reflectance.eval(si, valid) & valid

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            cosine = mi.Frame3f.cos_theta(wo)
            valid = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (cosine > 0)
            density = dr.select(valid, self._density(dr.maximum(cosine, 0.0)), 0.0)
            return self.reflectance.eval(si, valid) * density, density

        def to_string(self) -> str:
            return f"NormalLobe[gloss={self.gloss}]"

    with contextlib.suppress(RuntimeError):  # registered already
        mi.register_bsdf(name, NormalLobe)
    return name
