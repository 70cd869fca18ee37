"""A scene as a binary glTF file with its materials, for viewers and modellers that light it themselves.

`generators.vision.glb` writes what our camera sees, with the light in the textures. This file has none of the light:
base colours, roughness, metallic, maps, emission, clear layers and transmission as `Material` has them, so that
Blender, three.js or another path tracer shows the same surfaces. The pictures of a scan contain their light: they are
unlit. What glTF lacks is left out: the view behind a window (`Material.shown`; the pane shines with its mean), and the
sun.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import atomic_path
from generators.assets.gltf_materials import UNLIT, emission_and_coat
from generators.core.scene import Material, Part, Scene, Texture
from generators.vision.glb import GltfFile


def write_materials_glb(scene: Scene, path: Path, *, parts: Sequence[Part] | None = None) -> None:
    """Write a scene with its materials; the same scene gives the same bytes.

    Args:
        scene: the scene; its light maps and exposure are not read.
        path: the file; written whole or not at all.
        parts: which of its parts; all if missing.

    Raises:
        Avs3dError: if there is nothing to write, or the file cannot be written.
    """
    chosen = scene.parts if parts is None else tuple(parts)
    groups: dict[tuple[int, bool], tuple[Material, list[Part]]] = {}
    for part in chosen:
        for material in dict.fromkeys(part.mesh.materials):
            groups.setdefault((id(material), scene.is_scan(part)), (material, []))[1].append(part)
    file, textures = GltfFile(), dict[int, int]()
    for (_, unlit), (material, users) in groups.items():
        faces = [_faces_of(part, material) for part in users]
        positions, normals, uv = (np.concatenate([own[k] for own in faces]) for k in range(3))
        if len(positions):
            uv = np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1)
            file.add_mesh(material.name, _described(file, textures, material, unlit), positions, normals, uv)
    if not file.meshes:
        raise Avs3dError(f"{path}: the scene has no faces; expected at least one part with triangles")
    with atomic_path(path) as temporary:
        temporary.write_bytes(file.content())


def _faces_of(part: Part, material: Material) -> tuple[Any, Any, Any]:
    mesh = part.mesh
    own = np.array([each is material for each in mesh.materials])[mesh.face_material]
    return mesh.positions[own], mesh.normals[own], mesh.uv[own]


def _described(file: GltfFile, textures: dict[int, int], material: Material, unlit: bool) -> dict[str, Any]:
    """A material in glTF's terms; ``textures`` has the numbers of those that are written already."""

    def index(texture: Texture) -> dict[str, int]:
        if id(texture) not in textures:
            textures[id(texture)] = file.texture(texture.pixels[..., :3], repeats=True)
        return {"index": textures[id(texture)]}

    surface: dict[str, Any] = {
        "baseColorFactor": [*(round(float(value), 6) for value in material.colour), 1.0],
        "metallicFactor": round(float(material.metallic), 6),
        "roughnessFactor": round(float(material.roughness), 6),
    }
    out: dict[str, Any] = {"doubleSided": True, "pbrMetallicRoughness": surface}
    if material.texture is not None and material.shown is None:
        surface["baseColorTexture"] = index(material.texture)
    if unlit:
        return out | {"extensions": {UNLIT: {}}}
    if material.roughness_map is not None:
        surface["metallicRoughnessTexture"] = index(material.roughness_map)
    if material.normal_map is not None:
        out["normalTexture"] = index(material.normal_map)
    return out | emission_and_coat(material.emission, material.clearcoat, material.transmission)
