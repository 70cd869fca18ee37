"""Materials of glTF files: what of them is read, and what it means here.

- The metallic–roughness model of glTF 2.0 (3.9) as it is, with its defaults: without factors it is rough metal.
- Emission: factor × texture × ``KHR_materials_emissive_strength`` is radiance in the scene's light unit, in which a
  white wall in daylight is about 1: a display with factor 1 is as bright as it, and a lamp needs the strength. An
  emissive texture is read as its mean over each face.
- ``KHR_materials_transmission``, ``KHR_materials_clearcoat``: their factors; the textures of both are not read.
- ``KHR_materials_unlit``: matte; renderers show a scan's colours unchanged anyway.
- ``KHR_materials_pbrSpecularGlossiness``: the reader turns it into metallic and roughness.
- ``KHR_materials_ior``, ``KHR_materials_specular`` and all others change nothing: dielectrics have an index of 1.5. A
  file that *requires* one that is not read is refused, as the format demands (3.12).
- Maps use the texture coordinates of the base colour. A map with other coordinates, or another
  ``KHR_texture_transform``, is not read. A map may have any size up to the largest of a texture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.scene import Texture

UNLIT, STRENGTH = "KHR_materials_unlit", "KHR_materials_emissive_strength"
TRANSMISSION, CLEARCOAT = "KHR_materials_transmission", "KHR_materials_clearcoat"
#: Extensions of materials that are read.
READ = frozenset({UNLIT, STRENGTH, TRANSMISSION, CLEARCOAT, "KHR_materials_pbrSpecularGlossiness"})
_EXTENSION = "KHR_materials_"
#: Attribute of the reader's materials that holds their `GltfExtras`, and what parts their name from their number.
_ATTRIBUTE, _MARK = "gltf_extras", "\x1f"
#: The base colour's texture and the others of a material, in the reader's names.
_TEXTURES = ("baseColorTexture", "metallicRoughnessTexture", "normalTexture", "emissiveTexture")


@dataclass(frozen=True)
class GltfExtras:
    """What the mesh reader does not tell of a material.

    Attributes:
        unlit: whether it is shown without light.
        normal_scale: factor of the normal map's x and y.
        strength: factor of the emission.
        transmission: see `Material`.
        clearcoat: see `Material`.
        foreign: textures that are not read because of their coordinates.
        ignored: extensions that change nothing here.
    """

    unlit: bool = False
    normal_scale: float = 1.0
    strength: float = 1.0
    transmission: float = 0.0
    clearcoat: float = 0.0
    foreign: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()


def check_materials(file: Path, tree: dict[str, Any]) -> None:
    """Refuse factors that are no numbers or out of range, and required extensions that are not read.

    Raises:
        Avs3dError: naming the material and the factor, or the extension.
    """
    for name in tree.get("extensionsRequired", []):
        if name.startswith(_EXTENSION) and name not in READ:
            raise Avs3dError(
                f"{file}: requires the extension {name}, which is not read; expected some of "
                f"{', '.join(sorted(READ))}; remove it from extensionsRequired to do without it"
            )
    for index, material in enumerate(tree.get("materials", [])):
        where = f"{file}: material {material.get('name', index)!r}"
        surface, extensions = material.get("pbrMetallicRoughness", {}), material.get("extensions", {})
        _check(where, "baseColorFactor", surface.get("baseColorFactor", [1] * 4), 4)
        _check(where, "metallicFactor", surface.get("metallicFactor", 1))
        _check(where, "roughnessFactor", surface.get("roughnessFactor", 1))
        _check(where, "emissiveFactor", material.get("emissiveFactor", [0] * 3), 3)
        _check(where, "scale of normalTexture", material.get("normalTexture", {}).get("scale", 1), most=math.inf)
        _check(where, "transmissionFactor", extensions.get(TRANSMISSION, {}).get("transmissionFactor", 0))
        _check(where, "clearcoatFactor", extensions.get(CLEARCOAT, {}).get("clearcoatFactor", 0))
        _check(where, "emissiveStrength", extensions.get(STRENGTH, {}).get("emissiveStrength", 1), most=math.inf)


def _check(where: str, name: str, value: Any, count: int = 0, most: float = 1.0) -> None:
    """Check a number, or ``count`` numbers, to lie in [0, ``most``]; a normal map's scale may be negative."""
    values = value if count else [value]
    least = -math.inf if name.startswith("scale") else 0.0
    good = isinstance(values, list) and len(values) == max(count, 1)
    if not good or not all(isinstance(v, int | float) and math.isfinite(v) and least <= v <= most for v in values):
        what = f"{count} numbers" if count else "a number"
        bound = f"from 0 to {most:g}" if most < math.inf else "that is finite" if least < 0 else "≥ 0"
        raise Avs3dError(f"{where}: its {name} is {value}; expected {what} {bound}; correct it in the file")


def extras_of(material: dict[str, Any]) -> GltfExtras:
    """The extras of one material of a glTF document."""
    extensions = material.get("extensions", {})
    surface = material.get("pbrMetallicRoughness", {})
    found = {name: {**material, **surface}.get(name) for name in _TEXTURES}
    there = {name: _coordinates(texture) for name, texture in found.items() if texture is not None}
    used = there.get("baseColorTexture", next(iter(there.values()), None))
    return GltfExtras(
        unlit=UNLIT in extensions,
        normal_scale=float((found["normalTexture"] or {}).get("scale", 1.0)),
        strength=float(extensions.get(STRENGTH, {}).get("emissiveStrength", 1.0)),
        transmission=float(extensions.get(TRANSMISSION, {}).get("transmissionFactor", 0.0)),
        clearcoat=float(extensions.get(CLEARCOAT, {}).get("clearcoatFactor", 0.0)),
        foreign=tuple(name for name, own in there.items() if own != used),
        ignored=tuple(sorted(name for name in extensions if name.startswith(_EXTENSION) and name not in READ)),
    )


def _coordinates(texture: dict[str, Any]) -> str:
    return repr((texture.get("texCoord", 0), texture.get("extensions", {}).get("KHR_texture_transform")))


def mark_materials(tree: dict[str, Any]) -> bool:
    """Number the materials in their names, which is all that the mesh reader keeps; False if all have equal extras."""
    materials = tree.get("materials", [])
    if len({extras_of(material) for material in materials}) < 2:
        return False
    for index, material in enumerate(materials):
        material["name"] = f"{material.get('name', '')}{_MARK}{index}"
    return True


def attach_extras(tree: dict[str, Any], scene: Any) -> None:
    """Give the materials of the reader's ``scene`` their extras, and their own names back.

    Args:
        tree: the document as it is in the file.
        scene: read from it, or from what `mark_materials` marked.
    """
    materials = tree.get("materials", [])
    for part in scene.geometry.values():
        source = getattr(part.visual, "material", None)
        if source is None or not materials or hasattr(source, _ATTRIBUTE):
            continue
        name, marked, index = str(getattr(source, "name", None) or "").rpartition(_MARK)
        if marked:
            source.name = name or None
        setattr(source, _ATTRIBUTE, extras_of(materials[int(index) if marked else 0]))


def known_extras(source: Any) -> GltfExtras:
    """The extras of one of the reader's materials."""
    found: GltfExtras = getattr(source, _ATTRIBUTE, GltfExtras())
    return found


def gltf_look(file: Path, source: Any, title: str) -> dict[str, Any]:
    """Attributes of a `Material`, besides the base colour, of one of the reader's materials.

    Raises:
        Avs3dError: if a texture cannot be decoded.
    """
    extras = known_extras(source)
    if extras.unlit:
        return {}
    return {
        "roughness": _or(source.roughnessFactor, 1.0),
        "metallic": _or(source.metallicFactor, 1.0),
        "emission": (0.0, 0.0, 0.0) if source.emissiveTexture is not None else emission_of(source),
        "transmission": extras.transmission,
        "clearcoat": extras.clearcoat,
        "normal_map": normals_of(file, source, title),
        "roughness_map": map_of(file, source, "metallicRoughnessTexture", title),
    }


def emission_of(source: Any) -> tuple[float, float, float]:
    """Emissive factor × strength."""
    factor = source.emissiveFactor if source.emissiveFactor is not None else np.zeros(3)
    red, green, blue = (np.asarray(factor, dtype=np.float64)[:3] * known_extras(source).strength).tolist()
    return red, green, blue


def normals_of(file: Path, source: Any, title: str) -> Texture | None:
    """The normal map with its scale: normalize((2c − 1) · (scale, scale, 1)), glTF 2.0, 3.9.3."""
    texture, scale = map_of(file, source, "normalTexture", title), known_extras(source).normal_scale
    if texture is None or scale == 1.0:
        return texture
    normal = (texture.pixels.astype(np.float32) / 127.5 - 1) * np.array([scale, scale, 1], dtype=np.float32)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-6)
    return Texture(texture.name, np.asarray(np.rint((normal + 1) * 127.5), dtype=np.uint8))


def map_of(file: Path, source: Any, kind: str, title: str) -> Texture | None:
    """One of the textures of a material, None if it has none or in other coordinates.

    Raises:
        Avs3dError: if it cannot be decoded.
    """
    image = getattr(source, kind, None)
    if image is None or kind in known_extras(source).foreign:
        return None
    return Texture(f"{title}_{kind.removesuffix('Texture')}", decoded(file, image, title))


def decoded(file: Path, image: Any, title: str) -> NDArray[np.uint8]:
    """(H, W, 3) pixels of an image.

    Raises:
        Avs3dError: if it cannot be decoded.
    """
    try:
        return np.asarray(image.convert("RGB")).copy()
    except (OSError, SyntaxError, ValueError) as error:
        raise Avs3dError(f"{file}: the texture of material {title!r} cannot be decoded ({error})") from error


def _or(value: Any, default: float) -> float:
    return default if value is None else float(value)


def emission_and_coat(
    emission: tuple[float, float, float], clearcoat: float = 0.0, transmission: float = 0.0
) -> dict[str, Any]:
    """What to add to a glTF material that shines, has a clear layer or lets light through (its extensions' JSON)."""
    out: dict[str, Any] = {}
    extensions: dict[str, Any] = {}
    strength = max(*emission, 1.0)
    if max(emission) > 0:
        out["emissiveFactor"] = [round(value / strength, 6) for value in emission]
    if strength > 1:
        extensions[STRENGTH] = {"emissiveStrength": round(strength, 6)}
    if clearcoat > 0:
        extensions[CLEARCOAT] = {"clearcoatFactor": round(clearcoat, 6)}
    if transmission > 0:
        extensions[TRANSMISSION] = {"transmissionFactor": round(transmission, 6)}
    return out | ({"extensions": extensions} if extensions else {})
