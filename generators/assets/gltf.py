"""Parts of glTF files that common readers cannot handle: compressed meshes, and KTX2 (Basis Universal) textures.

Geometry that is compressed with Draco or meshopt is refused: pip offers no reliable decoder of both. Textures in KTX2
(``KHR_texture_basisu``: HM3D's ``.basis.glb``) are decoded by `opengl_basisu
<https://pypi.org/project/opengl-basisu/>`_ if that is installed (extra ``basis``); else only the geometry is read.
"""

from __future__ import annotations

import importlib
import io
import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import has_package

BASISU = "KHR_texture_basisu"
KTX2 = "image/ktx2"
#: Extensions that compress the geometry, and the names of their compressors.
COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
#: Lists of the document that are read here, and those of them that contain names.
_OF_NAMES = ("extensionsUsed", "extensionsRequired")
_LISTS = (*_OF_NAMES, "buffers", "bufferViews", "images", "textures", "materials")
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def read_tree(file: Path) -> dict[str, Any]:
    """The JSON of a .glb or .gltf file; of a GLB only that chunk is read.

    Raises:
        Avs3dError: if the file is not glTF, or truncated.
    """
    if file.suffix.lower() == ".glb":
        with file.open("rb") as stream:
            head = stream.read(20)
            if len(head) < 20 or head[:4] != b"glTF":
                raise Avs3dError(
                    f"{file}: is not a binary glTF (no 'glTF' at its start); check that the file is complete"
                )
            length, size = struct.unpack_from("<I", head, 8)[0], struct.unpack_from("<I", head, 12)[0]
            there = file.stat().st_size
            if length > there:
                raise Avs3dError(f"{file}: is truncated ({there} bytes of {length}); fetch it again")
            data = stream.read(size)
    else:
        data = file.read_bytes()
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise Avs3dError(
            f"{file}: cannot be read as {file.suffix[1:]} (its JSON is broken); check that it is complete"
        ) from error
    if not isinstance(tree, dict):
        raise Avs3dError(
            f"{file}: cannot be read as {file.suffix[1:]} (its JSON is not an object); check that it is complete"
        )
    for key in _LISTS:
        items = tree.get(key, [])
        kind = str if key in _OF_NAMES else dict
        if not isinstance(items, list) or not all(isinstance(item, kind) for item in items):
            raise Avs3dError(
                f"{file}: cannot be read as {file.suffix[1:]} (its {key} are {items!r:.40}); check that it is complete"
            )
    return tree


def refuse_compressed(file: Path, tree: dict[str, Any]) -> None:
    """Refuse geometry in a compression that cannot be read.

    Raises:
        Avs3dError: with the command that unpacks it.
    """
    used = {*tree.get("extensionsUsed", []), *tree.get("extensionsRequired", [])}
    for extension, name in COMPRESSED.items():
        if extension in used:
            raise Avs3dError(
                f"{file}: its meshes are compressed with {name} ({extension}), which cannot be read; unpack them: "
                f"npx @gltf-transform/cli copy {file.name} {file.stem}.plain.glb"
            )


def has_basis(file: Path) -> bool:
    """Whether a texture of a mesh file is in KTX2."""
    if file.suffix.lower() not in (".glb", ".gltf"):
        return False
    return bool(_basis_images(read_tree(file)))


def can_decode_basis() -> bool:
    """Whether the decoder of KTX2 textures is installed."""
    return has_package("opengl_basisu")


def basis_error(file: Path) -> Avs3dError:
    """The message about textures in KTX2 without a decoder."""
    stem = file.name.removesuffix(".glb")
    plain = f"{stem.removesuffix('.basis') if stem.endswith('.basis') else stem + '.plain'}.glb"
    return Avs3dError(
        f"{file}: its textures are KTX2 (Basis Universal) and no decoder is installed: pip install "
        f"'avs3d-bench[basis]', or convert it (npx @gltf-transform/cli ktxdecompress {file.name} {plain}), or render "
        "with --vision habitat"
    )


def check_images(file: Path) -> None:
    """Refuse a GLB with a broken image: readers ignore such an image and use a plain colour.

    Raises:
        Avs3dError: naming the image.
    """
    tree, binary = _load(file)
    compressed = _basis_images(tree)
    for index, image in enumerate(tree.get("images", [])):
        if index in compressed or "bufferView" not in image:
            continue
        try:
            Image.open(io.BytesIO(_image_bytes(file, tree, binary, image))).close()
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            name = image.get("name") or index
            raise Avs3dError(f"{file}: its image {name!r} cannot be decoded; fetch the file again") from error


def without_basis(file: Path) -> bytes:
    """The GLB with its KTX2 images decoded to PNG.

    Raises:
        Avs3dError: if there is no decoder, or an image is broken.
    """
    if not can_decode_basis():
        raise basis_error(file)
    decoder = importlib.import_module("opengl_basisu")
    tree, binary = _load(file)
    views = tree.setdefault("bufferViews", [])
    out = bytearray(binary)
    for index in _basis_images(tree):
        image = tree["images"][index]
        try:
            pixels = decoder.open(_image_bytes(file, tree, binary, image)).transcode("rgba8").data
        except Exception as error:  # the decoder raises its own exceptions
            reason = " ".join(str(error).split()) or type(error).__name__
            raise Avs3dError(
                f"{file}: KTX2 image {index} cannot be decoded ({reason}); fetch the file again"
            ) from error
        encoded = cv2.imencode(".png", np.asarray(pixels)[..., [2, 1, 0]], [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
        out += b"\0" * (-len(out) % 4)
        views.append({"buffer": 0, "byteOffset": len(out), "byteLength": len(encoded)})
        out += encoded.tobytes()
        tree["images"][index] = {"bufferView": len(views) - 1, "mimeType": "image/png"}
    for texture in tree.get("textures", []):
        found = texture.get("extensions", {}).pop(BASISU, None)
        if found is not None:
            texture["source"] = found["source"]
    return _pack(tree, bytes(out))


def without_textures(file: Path) -> bytes:
    """The GLB with only its geometry, material names and factors."""
    tree, binary = _load(file)
    for key in ("images", "textures", "samplers"):
        tree.pop(key, None)
    for material in tree.get("materials", []):
        for key in ("normalTexture", "occlusionTexture", "emissiveTexture", "extensions"):
            material.pop(key, None)
        surface = material.get("pbrMetallicRoughness", {})
        for key in ("baseColorTexture", "metallicRoughnessTexture"):
            surface.pop(key, None)
    return _pack(tree, binary)


# ---- bytes --------------------------------------------------------------------------------------------------------


def _basis_images(tree: dict[str, Any]) -> list[int]:
    images = tree.get("images", [])
    named = {t.get("extensions", {}).get(BASISU, {}).get("source") for t in tree.get("textures", [])}
    return [i for i, image in enumerate(images) if i in named or image.get("mimeType") == KTX2]


def _load(file: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a GLB."""
    tree = read_tree(file)
    if file.suffix.lower() != ".glb":
        raise Avs3dError(f"{file}: KTX2 textures are read from .glb only; pack it: npx @gltf-transform/cli copy")
    data = file.read_bytes()
    at = 12
    while at + 8 <= len(data):
        size, kind = struct.unpack_from("<II", data, at)
        if kind == _BIN:
            return tree, data[at + 8 : at + 8 + size]
        at += 8 + size
    return tree, b""


def _image_bytes(file: Path, tree: dict[str, Any], binary: bytes, image: dict[str, Any]) -> bytes:
    if "bufferView" not in image:
        raise ValueError(f"{file}: it is not inside the file")
    view = tree["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    return binary[start : start + view["byteLength"]]


def _pack(tree: dict[str, Any], binary: bytes) -> bytes:
    """A GLB of a JSON tree and one buffer."""
    for key in ("extensionsUsed", "extensionsRequired"):
        if key in tree:
            tree[key] = [name for name in tree[key] if name != BASISU]
    binary += b"\0" * (-len(binary) % 4)
    if tree.get("buffers"):
        tree["buffers"][0]["byteLength"] = len(binary)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), _JSON) + text + struct.pack("<II", len(binary), _BIN) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
