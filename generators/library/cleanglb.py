"""Writes a clean object as one GLB (glTF 2.0): one named node per material, embedded textures, reproducible bytes."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from generators.assets.gltf_materials import emission_and_coat
from generators.library.rawmesh import RawPart

_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963


def write_clean_glb(parts: Sequence[RawPart], generator: str) -> bytes:
    """The bytes of a GLB; the parts must have normals, and texture coordinates if they have a texture.

    Corners with the same position, normal and coordinates become one vertex. The same parts give the same bytes with
    the same version of Pillow (which encodes the textures).
    """
    glb = _Glb()
    for part in parts:
        glb.add(part)
    return glb.encode(generator)


class _Glb:
    """The lists of a glTF document and its one buffer, while parts are added."""

    def __init__(self) -> None:
        self._blob = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._textures: list[dict[str, Any]] = []
        self._images: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._pictures: dict[bytes, int] = {}
        self._extensions: set[str] = set()

    def add(self, part: RawPart) -> None:
        """Append a part: its material, its texture, its mesh of one primitive."""
        surface = part.surface
        physical: dict[str, Any] = {
            "baseColorFactor": [*(round(float(v), 6) for v in surface.colour), 1.0],
            "metallicFactor": round(float(surface.metallic or 0.0), 6),
            "roughnessFactor": round(float(1.0 if surface.roughness is None else surface.roughness), 6),
        }
        material: dict[str, Any] = {"name": surface.name, "pbrMetallicRoughness": physical}
        if surface.pixels is not None:
            physical["baseColorTexture"] = {"index": self._picture(surface.pixels)}
        if surface.rough is not None:
            physical["metallicRoughnessTexture"] = {"index": self._picture(surface.rough)}
        if surface.normals is not None:
            material["normalTexture"] = {"index": self._picture(surface.normals)}
        material |= emission_and_coat(surface.emission, surface.clearcoat)
        self._extensions |= set(material.get("extensions", {}))
        self._materials.append(material)
        vertices, index = _indexed(part)
        attributes = {
            "POSITION": self._accessor(vertices[:, :3], "VEC3", _FLOAT, bounds=True),
            "NORMAL": self._accessor(vertices[:, 3:6], "VEC3", _FLOAT),
        }
        if surface.pixels is not None:
            attributes["TEXCOORD_0"] = self._accessor(vertices[:, 6:8], "VEC2", _FLOAT)
        primitive = {
            "attributes": attributes,
            "indices": self._accessor(index, "SCALAR", _UINT),
            "material": len(self._materials) - 1,
        }
        self._meshes.append({"name": f"part_{len(self._meshes):03d}", "primitives": [primitive]})

    def encode(self, generator: str) -> bytes:
        """The file: header, JSON chunk, binary chunk."""
        tree: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": generator},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self._meshes)))}],
            "nodes": [{"mesh": number, "name": mesh["name"]} for number, mesh in enumerate(self._meshes)],
            "meshes": self._meshes,
            "materials": self._materials,
            "accessors": self._accessors,
            "bufferViews": self._views,
        }
        if self._extensions:
            tree["extensionsUsed"] = sorted(self._extensions)
        if self._textures:
            repeat = {"wrapS": 10497, "wrapT": 10497, "magFilter": 9729, "minFilter": 9987}
            tree |= {"textures": self._textures, "images": self._images, "samplers": [repeat]}
        blob = self._blob + b"\0" * (-len(self._blob) % 4)
        tree["buffers"] = [{"byteLength": len(blob)}]
        text = json.dumps(tree, separators=(",", ":"), sort_keys=True).encode()
        text += b" " * (-len(text) % 4)
        size = 12 + 8 + len(text) + 8 + len(blob)
        return b"".join(
            (
                struct.pack("<4sII", b"glTF", 2, size),
                struct.pack("<II", len(text), 0x4E4F534A),
                text,
                struct.pack("<II", len(blob), 0x004E4942),
                bytes(blob),
            )
        )

    def _view(self, data: bytes, target: int | None = None) -> int:
        self._blob.extend(b"\0" * (-len(self._blob) % 4))
        entry: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._blob), "byteLength": len(data)}
        if target:
            entry["target"] = target
        self._blob.extend(data)
        self._views.append(entry)
        return len(self._views) - 1

    def _accessor(self, values: NDArray[Any], kind: str, component: int, *, bounds: bool = False) -> int:
        target = _ELEMENTS if component == _UINT else _ARRAY
        entry: dict[str, Any] = {
            "bufferView": self._view(np.ascontiguousarray(values).tobytes(), target),
            "componentType": component,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self._accessors.append(entry)
        return len(self._accessors) - 1

    def _picture(self, pixels: NDArray[np.uint8]) -> int:
        buffer = io.BytesIO()
        Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "PNG", compress_level=6)
        data = buffer.getvalue()
        if data not in self._pictures:
            self._pictures[data] = len(self._textures)
            self._images.append({"bufferView": self._view(data), "mimeType": "image/png"})
            self._textures.append({"source": len(self._images) - 1, "sampler": 0})
        return self._pictures[data]


def _indexed(part: RawPart) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices (V, 8): position, normal, texture coordinates in glTF's convention (v down); and (3F,) indices."""
    count = len(part.triangles)
    if part.normals is None:
        raise ValueError("a part without normals; expected (F, 3, 3)")
    uv = np.zeros((count, 3, 2)) if part.uv is None else part.uv.copy()
    uv[..., 1] = 1 - uv[..., 1]
    rows = np.concatenate([part.triangles, part.normals, uv], axis=2).reshape(-1, 8).astype(np.float32) + np.float32(0)
    unique, inverse = np.unique(rows, axis=0, return_inverse=True)
    return unique, inverse.reshape(-1).astype(np.uint32)
