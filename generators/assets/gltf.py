"""Parts of glTF files that common readers cannot handle: compressed meshes, and KTX2 (Basis Universal) textures.

Geometry that is compressed with Draco is read if `DracoPy <https://pypi.org/project/DracoPy/>`_ is installed (extra
``draco``). With meshopt it is refused: pip offers no built decoder. Textures in KTX2 (``KHR_texture_basisu``: HM3D's
``.basis.glb``) are decoded by `opengl_basisu <https://pypi.org/project/opengl-basisu/>`_ if that is installed (extra
``basis``); else only the geometry is read.
"""

from __future__ import annotations

import base64
import importlib
import io
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import numpy as np
from PIL import Image

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import has_package
from generators.assets.gltf_attributes import DRACO, plain_attributes
from generators.assets.gltf_materials import mark_materials

BASISU = "KHR_texture_basisu"
KTX2 = "image/ktx2"
#: Extensions that compress the geometry and cannot be decoded, and the names of their compressors.
COMPRESSED = {"EXT_meshopt_compression": "meshopt", "KHR_meshopt_compression": "meshopt"}
#: Largest side of a texture (texels): three bytes of memory per texel, twelve while it is loaded.
LARGEST_TEXTURE = 16_384
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
    unpack = f"unpack them: npx @gltf-transform/cli copy {file.name} {file.stem}.plain.glb"
    for extension, name in COMPRESSED.items():
        if extension in used:
            raise Avs3dError(
                f"{file}: its meshes are compressed with {name} ({extension}), which is not read; {unpack}"
            )
    if DRACO in used and not can_decode_draco():
        raise Avs3dError(
            f"{file}: its meshes are compressed with Draco ({DRACO}) and no decoder is installed: pip install "
            f"'avs3d-bench[draco]', or {unpack}"
        )


def can_decode_draco() -> bool:
    """Whether the decoder of meshes compressed with Draco is installed."""
    return has_package("DracoPy")


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
    """Refuse a file with a broken or huge image inside: readers ignore such an image and use a plain colour.

    Raises:
        Avs3dError: naming the image.
    """
    tree, binary = load_gltf(file)
    compressed = _basis_images(tree)
    for index, image in enumerate(tree.get("images", [])):
        if index in compressed or "bufferView" not in image:
            continue
        name = image.get("name") or index
        try:
            with Image.open(io.BytesIO(_image_bytes(file, tree, binary, image))) as picture:
                size = picture.size
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            raise Avs3dError(f"{file}: its image {name!r} cannot be decoded; fetch the file again") from error
        if max(size) > LARGEST_TEXTURE:
            raise Avs3dError(
                f"{file}: its image {name!r} has {size[0]} × {size[1]} texels; expected at most {LARGEST_TEXTURE} to a "
                f"side; reduce it: npx @gltf-transform/cli resize --width 8192 --height 8192 {file.name} small.glb"
            )


def rewritten(file: Path, *, textures: bool = True) -> bytes | None:
    """The file as one GLB that the reader understands, or None if it does as it is.

    KTX2 images are decoded to PNG, normalised integers to floats, and texture coordinates are transformed;
    materials are numbered in their names if that is needed (`mark_materials`).

    Args:
        file: .glb or .gltf.
        textures: whether they are wanted; else only geometry, names of materials and their factors are kept.

    Raises:
        Avs3dError: if KTX2 images are wanted and there is no decoder, or one is broken.
    """
    tree, binary = load_gltf(file)
    before, marked = binary, mark_materials(tree)
    if textures and _basis_images(tree):
        binary = _decode_basis(file, tree, binary)
    elif not textures:
        _drop_textures(tree)
    binary = plain_attributes(tree, binary)
    return None if textures and binary is before and not marked else pack_glb(tree, binary)


def _decode_basis(file: Path, tree: dict[str, Any], binary: bytes) -> bytes:
    """The buffer with the KTX2 images of ``tree`` appended as PNG."""
    if not can_decode_basis():
        raise basis_error(file)
    decoder = importlib.import_module("opengl_basisu")
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
    return bytes(out)


def _drop_textures(tree: dict[str, Any]) -> None:
    """Keep only geometry, material names and factors."""
    for key in ("images", "textures", "samplers"):
        tree.pop(key, None)
    for material in tree.get("materials", []):
        for key in ("normalTexture", "occlusionTexture", "emissiveTexture", "extensions"):
            material.pop(key, None)
        surface = material.get("pbrMetallicRoughness", {})
        for key in ("baseColorTexture", "metallicRoughnessTexture"):
            surface.pop(key, None)


# ---- bytes --------------------------------------------------------------------------------------------------------


def _basis_images(tree: dict[str, Any]) -> list[int]:
    images = tree.get("images", [])
    named = {t.get("extensions", {}).get(BASISU, {}).get("source") for t in tree.get("textures", [])}
    return [i for i, image in enumerate(images) if i in named or image.get("mimeType") == KTX2]


def load_gltf(file: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a GLB; the buffers and images of a .gltf are gathered in one."""
    tree = read_tree(file)
    if file.suffix.lower() != ".glb":
        return tree, _gathered(file, tree)
    data = file.read_bytes()
    at, binary = 12, b""
    while at + 8 <= len(data) and not binary:
        size, kind = struct.unpack_from("<II", data, at)
        if kind == _BIN:
            binary = data[at + 8 : at + 8 + size]
        at += 8 + size
    return tree, _with_images(file, tree, binary)


def _gathered(file: Path, tree: dict[str, Any]) -> bytes:
    """The buffers of a .gltf one after the other, then its images, with ``tree`` changed to match."""
    out = bytearray()
    starts = []
    for buffer in tree.get("buffers", []):
        out += b"\0" * (-len(out) % 4)
        starts.append(len(out))
        out += _referred_bytes(file, buffer["uri"])
    views = tree.setdefault("bufferViews", [])
    for view in views:
        view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        view["buffer"] = 0
    tree["buffers"] = [{}]
    return _with_images(file, tree, bytes(out))


def _with_images(file: Path, tree: dict[str, Any], binary: bytes) -> bytes:
    """The buffer with the images that are files beside ``file`` appended."""
    outside = [image for image in tree.get("images", []) if "uri" in image]
    if not outside:
        return binary
    out, views = bytearray(binary), tree.setdefault("bufferViews", [])
    for image in outside:
        data = _referred_bytes(file, image.pop("uri"))
        out += b"\0" * (-len(out) % 4)
        image["bufferView"] = len(views)
        views.append({"buffer": 0, "byteOffset": len(out), "byteLength": len(data)})
        out += data
    return bytes(out)


def _referred_bytes(file: Path, uri: str) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return (file.parent / unquote(uri)).read_bytes()


def _image_bytes(file: Path, tree: dict[str, Any], binary: bytes, image: dict[str, Any]) -> bytes:
    if "bufferView" not in image:
        raise ValueError(f"{file}: it is not inside the file")
    view = tree["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    return binary[start : start + view["byteLength"]]


def pack_glb(tree: dict[str, Any], binary: bytes) -> bytes:
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
