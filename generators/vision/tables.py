"""A scene laid out for the kernels: flat arrays by face, by surface (part × material) and by light map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.albedos import albedo_table
from generators.core.scene import F32, I32, LightMap, Material, Part, Scene
from generators.core.tone import inverse_tone_curve
from generators.vision.textures_pool import TexturePool, build_plain_pool, build_pool, distinct

F64 = NDArray[np.float64]

#: Kinds of surfaces: without specular reflection; reflecting as much light as arrives in the mean; reflecting what rays
#: meet; the same, and light goes through.
MATTE, SATIN, GLOSSY, CLEAR = 0, 1, 2, 3
#: From this roughness on no rays are traced, and from `TRACED` on what they meet counts wholly.
TRACING_LIMIT, TRACED = 0.55, 0.45


class SceneTables(NamedTuple):
    """Arrays for shading (named tuples go into kernels as they are).

    Attributes:
        normal: (F, 3) float32 unit geometric normal, by the corners' order; 0 for a face without area.
        gradient: (F, 2, 3) float32, how the texture coordinates change per metre along x, y, z within the face.
        uv: (F, 3, 2) float32: texture coordinate of corner 0, and the differences to it of corners 1 and 2.
        light_uv: (F, 3, 2) float32, the same for the light map, in texels of that map.
        surface: (F,) int32, the row of the following tables.
        texture: (S,) int32 texture of the pool, −1 for none.
        light: (S,) int32 light map, −1 for none.
        instance: (S,) uint16 instance id.
        albedo: (S, 3) float32 material colour, or radiance of what is shown instead, times `Scene.gains`.
        emission: (S, 3) float32 emission times `Scene.gains`; 0 where something is shown in its place.
        view_distance: (S,) float32 `Material.view_distance`.
        shine: (S,) uint8, what the surface reflects besides diffuse light: see `MATTE`, `SATIN`, `GLOSSY`, `CLEAR`.
        finish: (S, 4) float32 roughness, metallic, transmission, clearcoat.
        colour: (S, 3) float32 material colour.
        glow: (S, 3) float32 emission times `Scene.gains`, where something is shown in its place too.
        lamp_area: (S,) float32 area of all that shines in the part (m²); 0 of what does not shine.
        gains: (3,) float32 `Scene.gains`.
        corner_normal: (F, 3, 3) float32: shading normal of corner 0, and the differences to it of corners 1 and 2.
        bumps: (S,) int32 normal map of ``maps``, −1 for none.
        roughening: (S,) int32 roughness map of ``maps``, −1 for none.
        maps: textures of plain numbers.
        developed: (S,) uint8, 1 where colour × texture × light is display light already: the pictures of a scan.
        albedos: directional albedos, see `generators.core.albedos.albedo_table`.
        undeveloped: (1024,) float32 radiance times exposure that is shown as i / (n − 1) of linear display light.
        light_texels: flat float32; a map is (height, width, 3), row 0 at v = 0.
        light_offset: (M,) int64, where each map begins.
        light_size: (M, 2) int32 height and width.
        textures: the texture pool.
    """

    normal: F32
    gradient: F32
    uv: F32
    light_uv: F32
    surface: I32
    texture: I32
    light: I32
    instance: NDArray[np.uint16]
    albedo: F32
    emission: F32
    view_distance: F32
    shine: NDArray[np.uint8]
    finish: F32
    colour: F32
    glow: F32
    lamp_area: F32
    gains: F32
    corner_normal: F32
    bumps: I32
    roughening: I32
    maps: TexturePool
    developed: NDArray[np.uint8]
    albedos: F32
    undeveloped: F32
    light_texels: F32
    light_offset: NDArray[np.int64]
    light_size: I32
    textures: TexturePool


def build_tables(scene: Scene) -> tuple[SceneTables, F32]:
    """Check ``scene`` and lay it out; also returns all its triangles (F, 3, 3) float32, in the tables' order.

    Raises:
        Avs3dError: for a scene without parts, a mesh, light map or texture that is malformed or not finite, an
            instance id that does not fit 16 bits, or an exposure that is not a positive number.
    """
    _check(scene)
    meshes = [part.mesh for part in scene.parts]
    unique, texture_index = distinct([material.texture for mesh in meshes for material in mesh.materials])
    materials = [material for mesh in meshes for material in mesh.materials]
    part_of = np.repeat(np.arange(len(meshes)), [len(mesh.materials) for mesh in meshes])
    first_surface = np.concatenate([[0], np.cumsum([len(mesh.materials) for mesh in meshes])])
    lit = [index for index, part in enumerate(scene.parts) if part.light is not None]
    light_of_part = np.full(len(meshes), -1, dtype=np.int32)
    light_of_part[lit] = np.arange(len(lit), dtype=np.int32)
    maps = [part.light for part in scene.parts if part.light is not None]
    sizes = [light.texels.shape[:2] for light in maps] or [(1, 1)]
    texels = [light.texels.astype(np.float32).reshape(-1) for light in maps] or [np.ones(3, dtype=np.float32)]
    offsets = np.concatenate([[0], np.cumsum([block.size for block in texels])[:-1]])
    shown = np.array([material.shown is not None for material in materials])
    developed = np.array([scene.is_scan(part) for part in scene.parts], dtype=np.uint8)[part_of]
    albedo = [
        (1.0 if done else scene.gains) * np.array(material.shown or material.colour)
        for material, done in zip(materials, developed, strict=True)
    ]
    bump_maps, bump_index = distinct([material.normal_map for material in materials])
    rough_maps, rough_index = distinct([material.roughness_map for material in materials])
    glow = (np.array([material.emission for material in materials]) * scene.gains).astype(np.float32)
    triangles = np.concatenate([mesh.positions for mesh in meshes])
    uv = np.concatenate([mesh.uv for mesh in meshes])
    normal, gradient = _frames(triangles, uv)
    tables = SceneTables(
        normal=normal,
        gradient=gradient,
        uv=_relative(uv),
        light_uv=_light_uv(scene.parts),
        surface=np.concatenate(
            [mesh.face_material + np.int32(first_surface[i]) for i, mesh in enumerate(meshes)], dtype=np.int32
        ),
        texture=np.array(texture_index, dtype=np.int32),
        light=np.where(shown, np.int32(-1), light_of_part[part_of]),
        instance=np.array([part.instance_id for part in scene.parts], dtype=np.uint16)[part_of],
        albedo=np.array(albedo, dtype=np.float32),
        emission=np.where((shown | (developed > 0))[:, None], np.float32(0), glow + scene.black),
        shine=np.array([_shine(m, bool(done)) for m, done in zip(materials, developed, strict=True)], dtype=np.uint8),
        finish=np.array([(m.roughness, m.metallic, m.transmission, m.clearcoat) for m in materials], dtype=np.float32),
        colour=np.array([material.colour for material in materials], dtype=np.float32),
        glow=glow,
        lamp_area=np.concatenate([_lamp_area(part) for part in scene.parts]),
        gains=scene.gains.astype(np.float32),
        corner_normal=_relative(np.concatenate([mesh.normals for mesh in meshes])),
        bumps=np.array(bump_index, dtype=np.int32),
        roughening=np.array([i if i < 0 else i + len(bump_maps) for i in rough_index], dtype=np.int32),
        maps=build_plain_pool([*bump_maps, *rough_maps]),
        view_distance=np.array([material.view_distance for material in materials], dtype=np.float32),
        developed=developed,
        albedos=albedo_table(),
        undeveloped=inverse_tone_curve(np.linspace(0.0, 1.0, 1024)).astype(np.float32),
        light_texels=np.concatenate(texels),
        light_offset=offsets.astype(np.int64),
        light_size=np.array(sizes, dtype=np.int32),
        textures=build_pool(unique),
    )
    return tables, triangles


def _lamp_area(part: Part) -> F32:
    """`SceneTables.lamp_area` of a part's materials: a window's panes are many materials, and one lamp."""
    mesh = part.mesh
    shines = np.array([max(material.emission) > 0.0 for material in mesh.materials])
    corners = mesh.positions[shines[mesh.face_material]].astype(np.float64)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(shines * (np.linalg.norm(crosses, axis=1).sum() / 2.0), dtype=np.float32)


def _shine(material: Material, developed: bool) -> int:
    """The kind of a surface (see `SceneTables.shine`); lamps outshine what they reflect."""
    if developed or (material.shown is None and max(material.emission) > 0.0):
        return MATTE
    if material.transmission > 0.0:
        return CLEAR
    smoothest = 1.0 if material.roughness_map is None else float(material.roughness_map.pixels[..., 1].min()) / 255.0
    varies = material.roughness_map is not None and material.metallic > 0.0
    if material.roughness * smoothest < TRACING_LIMIT or material.clearcoat > 0.0 or varies:
        return GLOSSY
    return SATIN if material.roughness < 1.0 or material.metallic > 0.0 else MATTE


def _check(scene: Scene) -> None:
    if not scene.parts:
        raise Avs3dError(f"{scene.name}: the scene has no parts; expected at least one mesh to render")
    if not (np.isfinite(scene.gains).all() and scene.gains.min() > 0):
        raise Avs3dError(
            f"{scene.name}: exposure {scene.exposure} and white balance {scene.white}; expected finite numbers > 0"
        )
    for part in scene.parts:
        name = f"{scene.name}/{part.name}"
        part.mesh.check(name)
        if not 0 <= part.instance_id < 1 << 16:
            raise Avs3dError(f"{name}: instance id {part.instance_id} does not fit 16 bits (0 to 65535)")
        for material in part.mesh.materials:
            numbers = (*material.colour, *material.emission, *(material.shown or (0.0, 0.0, 0.0)))
            shares = (material.roughness, material.metallic, material.transmission, material.clearcoat)
            if not all(0.0 <= share <= 1.0 for share in shares):
                raise Avs3dError(
                    f"{name}: material {material.name!r} has roughness, metallic, transmission, clearcoat {shares}; "
                    "expected numbers from 0 to 1"
                )
            if len(numbers) != 9 or not np.isfinite(numbers).all():
                raise Avs3dError(
                    f"{name}: material {material.name!r} has colour or emission {numbers}; expected r, g, b"
                )
        if part.light is not None:
            _check_light(part.light, len(part.mesh.positions), name)


def _check_light(light: LightMap, faces: int, name: str) -> None:
    if light.uv.shape != (faces, 3, 2):
        raise Avs3dError(f"{name}: the light map's uv has shape {light.uv.shape}, expected {(faces, 3, 2)}; bake again")
    if light.texels.ndim != 3 or light.texels.shape[2] != 3 or 0 in light.texels.shape:
        raise Avs3dError(f"{name}: the light map has shape {light.texels.shape}, expected (H, W, 3); bake again")
    if not (np.isfinite(light.uv).all() and np.isfinite(light.texels).all()):
        raise Avs3dError(f"{name}: the light map holds numbers that are NaN or infinite; bake again")


def _relative(corners: F32) -> F32:
    """Corner 0 and the differences of corners 1 and 2 to it, in place: what barycentric coordinates multiply."""
    corners[:, 1:] -= corners[:, :1]
    return corners


def _light_uv(parts: Sequence[Part]) -> F32:
    """(F, 3, 2) `SceneTables.light_uv`; memory that stays zero is not touched."""
    out = np.zeros((sum(len(part.mesh.positions) for part in parts), 3, 2), dtype=np.float32)
    first = 0
    for part in parts:
        last = first + len(part.mesh.positions)
        if part.light is not None:
            height, width = part.light.texels.shape[:2]
            out[first:last] = _relative(part.light.uv * np.array([width, height], dtype=np.float32))
        first = last
    return out


def _frames(triangles: F32, uv: F32) -> tuple[F32, F32]:
    """Unit normals (F, 3) and texture gradients (F, 2, 3) of triangles.

    Within a face the coordinates are linear: their gradient g lies in its plane and fulfils g · e = Δ for both edges
    e1, e2 at corner 0, so that g = (Δ1 (e2 × n) + Δ2 (n × e1)) / |n|² with n = e1 × e2.
    """
    count = len(triangles)
    normal = np.zeros((count, 3), dtype=np.float32)
    gradient = np.zeros((count, 2, 3), dtype=np.float32)
    step = 1 << 16  # float64 for the cross products, without a float64 copy of a whole flat
    for first in range(0, count, step):
        block = slice(first, first + step)
        corner: F64 = triangles[block].astype(np.float64)
        e1, e2 = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        n = np.cross(e1, e2)
        square = np.einsum("fk,fk->f", n, n)
        inverse = np.where(square > 1e-24, 1.0 / np.maximum(square, 1e-24), 0.0)[:, None]
        normal[block] = n * np.sqrt(inverse)
        across, along = np.cross(e2, n) * inverse, np.cross(n, e1) * inverse
        delta = uv[block, 1:].astype(np.float64) - uv[block, :1]
        gradient[block] = delta[:, 0, :, None] * across[:, None, :] + delta[:, 1, :, None] * along[:, None, :]
    return normal, gradient
