"""A scene as a binary glTF file with the final colours that the camera shows.

Renderers that take a file know no light maps, exposure or tone curve. So all of that is in the textures: faces with a
light map get an atlas (generators/vision/atlas.py), all others keep their texture and its coordinates, each texel of
it developed. Materials are unlit (KHR_materials_unlit), seen from both sides and named after how they sound, which is
what `load_mesh` goes by; so a page of the atlas holds faces of one acoustic material only.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 4.4 (GLB). Y up, metres, as here.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import atomic_path
from generators.assets.gltf_materials import UNLIT
from generators.core.scene import F32, Part, Scene
from generators.core.tone import decode_table, srgb_encode, tone_curve
from generators.vision.atlas import bake_atlas
from generators.vision.tables import SceneTables, build_tables
from generators.vision.textures_pool import TexturePool

U8 = NDArray[np.uint8]
I64 = NDArray[np.int64]

#: glTF's numbers for what a buffer holds, for types, and for how a texture is read beyond its border and when small.
_VERTICES, _INDICES, _FLOAT, _UINT = 34962, 34963, 5126, 5125
_CLAMP, _REPEAT, _LINEAR, _TRILINEAR = 33071, 10497, 9729, 9987
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
#: Fast, and hardly larger than the default (avs3d_bench/formats/media.py); the order matters to OpenCV.
_PNG_FLAGS = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
if hasattr(cv2, "IMWRITE_PNG_FILTER"):
    _PNG_FLAGS += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG]
#: Distance (m) from a window pane at which a file, which knows no view behind a pane, shows it as it is seen.
_VIEWER = 2.0
#: Sides of the picture of a plain colour.
_PLAIN = 4


def write_glb(
    scene: Scene,
    path: Path,
    *,
    parts: Sequence[Part] | None = None,
    texel: float = 0.005,
    both_sides: bool = False,
) -> None:
    """Write ``scene`` as it is displayed: exposed, through the tone curve, sRGB.

    Args:
        scene: its exposure counts (`Scene.for_room`).
        path: the file; written whole or not at all. The same scene gives the same bytes.
        parts: which of its parts (or others, to be shown as its parts are); all if missing.
        texel: the finest texel wanted where there is a light map, metres; coarser textures are not made finer.
        both_sides: write each face twice, the second time from behind, for renderers that ignore ``doubleSided``.

    Raises:
        Avs3dError: for a scene that cannot be rendered, a ``texel`` that is no length, a file that cannot be written.
    """
    if not (np.isfinite(texel) and texel > 0):
        raise Avs3dError(f"{path}: texel {texel} m; expected a number > 0")
    chosen = replace(scene, parts=tuple(scene.parts if parts is None else parts)).shown
    tables, triangles = build_tables(chosen)
    labels = [material.acoustic for part in chosen.parts for material in part.mesh.materials]
    normals = np.concatenate([part.mesh.normals for part in chosen.parts])
    uv = tables.uv.copy()
    uv[:, 1:] += uv[:, :1]
    further = 1 + tables.view_distance[tables.surface] / _VIEWER
    middle = np.array([0.0, 0.5])
    uv = np.where(further[:, None, None] > 1, middle + (uv - middle) * further[:, None, None], uv).astype(np.float32)
    uv[..., 1] = 1 - uv[..., 1]  # glTF counts v downwards
    file = GltfFile(both_sides)
    for label in sorted(set(labels)):
        kind = np.array([own == label for own in labels])[tables.surface]
        lit = tables.light[tables.surface] >= 0
        for number, (faces, pixels) in enumerate(_textured(tables, np.flatnonzero(kind & ~lit))):
            file.add(f"{label}.{number}", pixels, triangles[faces], normals[faces], uv[faces], repeats=True)
        faces = np.flatnonzero(kind & lit)
        if len(faces):
            atlas = bake_atlas(tables, triangles, faces, texel=texel)
            for number, pixels in enumerate(atlas.pages):
                own = atlas.page == number
                page = faces[own]
                file.add(f"{label}.lit.{number}", pixels, triangles[page], normals[page], atlas.uv[own], repeats=False)
    with atomic_path(path) as temporary:
        temporary.write_bytes(file.content())


def _textured(tables: SceneTables, faces: I64) -> Iterator[tuple[I64, U8]]:
    """Faces without a light map by what they show, each with that as a picture (H, W, 3)."""
    known: dict[tuple[float, ...], list[int]] = {}
    for surface in np.unique(tables.surface[faces]).tolist():
        colours = (*tables.albedo[surface].tolist(), *tables.emission[surface].tolist())
        known.setdefault((tables.texture[surface], tables.developed[surface], *colours), []).append(surface)
    for surfaces in known.values():
        first = surfaces[0]
        pixels = _picture(tables.textures, int(tables.texture[first]))
        shown = _develop(pixels, tables.albedo[first], tables.emission[first], bool(tables.developed[first]))
        yield faces[np.isin(tables.surface[faces], surfaces)], shown


def _picture(pool: TexturePool, texture: int) -> U8:
    """The texture with that number, or a few white texels for −1."""
    if texture < 0:
        return np.full((_PLAIN, _PLAIN, 3), 255, dtype=np.uint8)
    level = pool.first[texture]
    height, width = pool.size[level].tolist()
    first = int(pool.offset[level])
    return pool.texels[first : first + height * width * 3].reshape(height, width, 3)


def _develop(pixels: U8, colour: F32, glow: F32, done: bool) -> U8:
    """Develop a texture with that colour and emission for display; ``done``: its light is developed already."""
    light = decode_table().astype(np.float64)[:, None] * colour + (0.0 if done else glow)
    shown = np.rint(255.0 * srgb_encode(light if done else tone_curve(light))).astype(np.uint8)
    return np.stack([shown[pixels[..., channel], channel] for channel in range(3)], axis=2)


def _png(pixels: U8) -> bytes:
    done, data = cv2.imencode(".png", np.ascontiguousarray(pixels[..., ::-1]), _PNG_FLAGS)
    if not done:
        raise Avs3dError(f"a texture of {pixels.shape[1]}×{pixels.shape[0]} pixels cannot be encoded as PNG")
    return data.tobytes()


@dataclass(eq=False)
class GltfFile:
    """A glTF document and its binary chunk, as they grow."""

    both_sides: bool = False
    blocks: list[bytes] = field(default_factory=list)
    length: int = 0
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    wraps: list[bool] = field(default_factory=list)

    def add(self, name: str, pixels: U8, positions: F32, normals: F32, uv: F32, *, repeats: bool) -> None:
        """A mesh of face corners (n, 3, …) that shows a picture (H, W, 3) whatever the light."""
        surface: dict[str, Any] = {"baseColorTexture": {"index": self.texture(pixels, repeats=repeats)}}
        surface |= {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        material = {"doubleSided": True, "extensions": {UNLIT: {}}, "pbrMetallicRoughness": surface}
        self.add_mesh(name, material, positions, normals, uv)

    def texture(self, pixels: U8, *, repeats: bool) -> int:
        """The number of a new texture with a picture (H, W, 3)."""
        self.images.append({"mimeType": "image/png", "bufferView": self._view(_png(pixels))})
        self.wraps.append(repeats)
        return len(self.images) - 1

    def add_mesh(self, name: str, material: dict[str, Any], positions: F32, normals: F32, uv: F32) -> None:
        """A mesh of face corners (n, 3, …), v down, of a glTF material that gets its name."""
        corners = np.concatenate([positions, normals, uv], axis=2).reshape(-1, 8) + np.float32(0)  # no −0
        rows = np.ascontiguousarray(corners).view(np.dtype((np.void, corners.shape[1] * 4))).reshape(-1)
        _, first, index = np.unique(rows, return_index=True, return_inverse=True)
        vertices = corners[first]
        spans = {"POSITION": slice(0, 3), "NORMAL": slice(3, 6), "TEXCOORD_0": slice(6, 8)}
        attributes = {kind: self._numbers(vertices[:, span], _VERTICES) for kind, span in spans.items()}
        faces = index.reshape(-1, 3)
        if self.both_sides:
            faces = np.concatenate([faces, faces[:, ::-1]])
        indices = self._numbers(faces.reshape(-1, 1).astype(np.uint32), _INDICES)
        primitive = {"attributes": attributes, "indices": indices, "material": len(self.materials)}
        self.meshes.append({"name": name, "primitives": [primitive]})
        self.materials.append({"name": name, **material})

    def content(self) -> bytes:
        """The whole file."""
        count = len(self.meshes)
        tree = {
            "asset": {"version": "2.0", "generator": "avs3d-bench"},
            "extensionsUsed": sorted({name for each in self.materials for name in each.get("extensions", {})}),
            "scene": 0,
            "scenes": [{"nodes": list(range(count))}],
            "nodes": [{"name": mesh["name"], "mesh": number} for number, mesh in enumerate(self.meshes)],
            "meshes": self.meshes,
            "materials": self.materials,
            "textures": [{"source": number, "sampler": int(wrap)} for number, wrap in enumerate(self.wraps)],
            "images": self.images,
            "samplers": [
                {"magFilter": _LINEAR, "minFilter": _TRILINEAR, "wrapS": wrap, "wrapT": wrap}
                for wrap in (_CLAMP, _REPEAT)
            ],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.length}],
        }
        if not self.images:
            tree = {key: value for key, value in tree.items() if key not in ("textures", "images", "samplers")}
        if not tree["extensionsUsed"]:
            del tree["extensionsUsed"]
        text = json.dumps(tree, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        whole = 12 + 8 + len(text) + 8 + self.length
        head = struct.pack("<4sII", b"glTF", 2, whole) + struct.pack("<II", len(text), _JSON)
        return b"".join([head, text, struct.pack("<II", self.length, _BINARY), *self.blocks])

    def _view(self, data: bytes, target: int | None = None) -> int:
        self.views.append({"buffer": 0, "byteOffset": self.length, "byteLength": len(data)})
        if target is not None:
            self.views[-1]["target"] = target
        padded = data + bytes(-len(data) % 4)
        self.blocks.append(padded)
        self.length += len(padded)
        return len(self.views) - 1

    def _numbers(self, rows: NDArray[Any], target: int) -> int:
        """An accessor of (n, k) float32 vertices or (n, 1) uint32 indices."""
        floats = target == _VERTICES
        self.accessors.append(
            {
                "bufferView": self._view(np.ascontiguousarray(rows).tobytes(), target),
                "componentType": _FLOAT if floats else _UINT,
                "count": len(rows),
                "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[rows.shape[1]],
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1
