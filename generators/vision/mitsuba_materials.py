"""Our materials as Mitsuba's: matte ones are ``diffuse``, all others the microfacet model that glTF and Mitsuba share.

The model is that of Burley, "Physically-based shading at Disney" (SIGGRAPH 2012 courses): Mitsuba's ``principled``,
with the roughness, metallic, clearcoat and maps of `Material`; a material with transmission is ``principledthin``, a
pane without thickness. Maps are not sRGB, and are looked up raw. Nothing that emits has a texture (see
`generators.vision.mitsuba_scene`).

Mitsuba's ``normalmap`` takes x along ∂p/∂u and y to the left of it, seen from outside, which is glTF's tangent space
where u and v have the usual handedness. Where they are mirrored, glTF's bitangent is the other way round (the w of a
tangent, glTF 2.0, 3.7.2.1), so that green is inverted there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.scene import F32, Material, Texture
from generators.core.tone import decode_table

#: Least roughness of ``principled``: below it, highlights of small lamps are found by chance alone.
SMOOTHEST = 0.05
#: ``clearcoat_gloss`` of a layer whose roughness is 0.
_POLISHED = 1.0


class MitsubaMaterials:
    """Materials and textures of one scene; each is loaded once.

    Args:
        mi: the module ``mitsuba`` with a variant set.
    """

    def __init__(self, mi: Any) -> None:
        self._mi = mi
        self._bitmaps: dict[tuple[Any, ...], Any] = {}
        self._bsdfs: dict[tuple[Any, ...], Any] = {}

    def bsdf(self, material: Material, *, mirrored: bool = False) -> Any:
        """The material as Mitsuba's.

        Args:
            material: ours.
            mirrored: whether it is for faces whose uv are mirrored (`is_mirrored`).
        """
        mirrored = mirrored and material.normal_map is not None
        key = (*look_of(material), mirrored)
        if key not in self._bsdfs:
            self._bsdfs[key] = self._mi.load_dict(self._described(material, mirrored))
        return self._bsdfs[key]

    def _described(self, material: Material, mirrored: bool) -> dict[str, Any]:
        matte = material.roughness >= 1.0 and material.roughness_map is None
        plain = matte and not (material.metallic or material.transmission or material.clearcoat)
        colour = self.colour(material)
        inner: dict[str, Any] = {"type": "diffuse", "reflectance": colour}
        if not plain:
            inner = {"type": "principled", "base_color": colour, "roughness": self._roughness(material)}
            if material.transmission > 0:
                inner |= {"type": "principledthin", "spec_trans": material.transmission}
            else:
                inner |= {"metallic": self._metallic(material), "clearcoat": material.clearcoat}
                inner["clearcoat_gloss"] = _POLISHED
        if material.normal_map is not None:
            inner = {"type": "normalmap", "normalmap": self._normals(material.normal_map, mirrored), "bsdf": inner}
        # A pane has two sides already.
        return inner if material.transmission > 0 else {"type": "twosided", "bsdf": inner}

    def colour(self, material: Material) -> Any:
        """Base colour × texture."""
        texture = material.texture
        if texture is None:
            return {"type": "rgb", "value": list(material.colour)}
        return self._bitmap(
            ("colour", id(texture), material.colour),
            lambda: decode_table()[texture.pixels[..., :3]] * np.asarray(material.colour),
        )

    def _roughness(self, material: Material) -> Any:
        texture, factor = material.roughness_map, material.roughness
        if texture is None:
            return max(factor, SMOOTHEST)
        return self._bitmap(
            ("roughness", id(texture), factor),
            lambda: np.maximum(texture.pixels[..., 1:2] * (factor / 255), SMOOTHEST),
        )

    def _metallic(self, material: Material) -> Any:
        texture, factor = material.roughness_map, material.metallic
        if texture is None or factor == 0:
            return factor
        return self._bitmap(("metallic", id(texture), factor), lambda: texture.pixels[..., 2:3] * (factor / 255))

    def _normals(self, texture: Texture, mirrored: bool) -> Any:
        sign = np.array([1, -1 if mirrored else 1, 1])
        return self._bitmap(
            ("normal", id(texture), mirrored), lambda: 0.5 + 0.5 * sign * (texture.pixels[..., :3] / 127.5 - 1)
        )

    def _bitmap(self, key: tuple[Any, ...], make: Any) -> Any:
        """A texture of linear values (H, W, 1 or 3)."""
        if key not in self._bitmaps:
            self._bitmaps[key] = self._mi.load_dict(
                {
                    "type": "bitmap",
                    "bitmap": self._mi.Bitmap(np.ascontiguousarray(make(), dtype=np.float32)),
                    "raw": True,
                    "filter_type": "bilinear",
                    "wrap_mode": "repeat",
                }
            )
        return self._bitmaps[key]


def look_of(material: Material) -> tuple[Any, ...]:
    """What determines how a material reflects and shines: materials for which it is equal look the same."""
    maps = (id(material.texture), id(material.normal_map), id(material.roughness_map))
    numbers = (material.roughness, material.metallic, material.transmission, material.clearcoat)
    return (*maps, material.colour, material.emission, *numbers)


def is_mirrored(positions: F32, uv: F32, normals: F32) -> NDArray[np.bool_]:
    """(F,) whether u × v of faces (F, 3, …) points into the surface, so that a picture on them is mirrored."""
    edge, side = positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0]
    du, dv = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    turn = np.sign(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
    outward = np.sign((np.cross(edge, side) * normals.sum(axis=1)).sum(axis=1))
    return np.asarray(turn * outward < 0)
