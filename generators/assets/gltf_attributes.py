"""Vertex attributes of glTF as plain numbers: normalised integers become floats, texture coordinates are transformed.

The reader of `generators.assets.meshfile` ignores ``normalized`` (glTF 2.0, 3.6.2.2; scanners and optimisers use it
through ``KHR_mesh_quantization``), ``KHR_texture_transform`` and the number of a texture's set of coordinates.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

TRANSFORM, DRACO = "KHR_texture_transform", "KHR_draco_mesh_compression"
_FLOAT, _UBYTE = 5126, 5121
_DTYPES = {5120: "i1", _UBYTE: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", _FLOAT: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_FLOATS = ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0")


def plain_attributes(tree: dict[str, Any], binary: bytes) -> bytes:
    """Rewrite the attributes that need it, in place in ``tree``; their values are appended to the buffer.

    Args:
        tree: a glTF document with one buffer.
        binary: the buffer.

    Returns:
        The buffer; the same object if nothing had to be done.
    """
    out, changed = bytearray(binary), False
    known: dict[tuple[Any, ...], int] = {}
    for primitive in (p for mesh in tree.get("meshes", []) for p in mesh.get("primitives", [])):
        if DRACO in primitive.get("extensions", {}):
            continue
        attributes = primitive["attributes"]
        chosen, matrix = _coordinates(tree, primitive)
        if chosen is not None and chosen in attributes and chosen != "TEXCOORD_0":
            attributes["TEXCOORD_0"], changed = attributes[chosen], True
        for name in _FLOATS:
            if name not in attributes:
                continue
            turn = matrix if name == "TEXCOORD_0" else None
            accessor = tree["accessors"][attributes[name]]
            integers = accessor.get("normalized", False) and accessor["componentType"] != _FLOAT
            # The reader takes colours of one byte as they are.
            if turn is None and not (integers and (name, accessor["componentType"]) != ("COLOR_0", _UBYTE)):
                continue
            key = (attributes[name], None if turn is None else turn.tobytes())
            if key not in known:
                values = _values(tree, binary, accessor)
                if turn is not None:
                    values = values @ turn[:, :2].T + turn[:, 2]
                known[key] = _append(tree, out, values.astype("<f4"), accessor["type"])
            attributes[name] = known[key]
    return bytes(out) if known or changed else binary


def _coordinates(tree: dict[str, Any], primitive: dict[str, Any]) -> tuple[str | None, NDArray[np.float64] | None]:
    """The set of coordinates of the base colour's texture or the first map, and their (2, 3) transform, or None."""
    if "material" not in primitive:
        return None, None
    material = tree["materials"][primitive["material"]]
    surface = material.get("pbrMetallicRoughness", {})
    found = (surface.get("baseColorTexture"), surface.get("metallicRoughnessTexture"), material.get("normalTexture"))
    texture = next((each for each in (*found, material.get("emissiveTexture")) if each is not None), None)
    if texture is None:
        return None, None
    own = texture.get("extensions", {}).get(TRANSFORM)
    number = texture.get("texCoord", 0)
    if own is None:
        return f"TEXCOORD_{number}", None
    (x, y), (across, down), angle = own.get("offset", (0, 0)), own.get("scale", (1, 1)), own.get("rotation", 0.0)
    # Counter-clockwise as seen in the picture, whose v points down.
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.array([[c * across, s * down, x], [-s * across, c * down, y]], dtype=np.float64)
    return f"TEXCOORD_{own.get('texCoord', number)}", matrix


def _values(tree: dict[str, Any], binary: bytes, accessor: dict[str, Any]) -> NDArray[np.float64]:
    """(N, K) values of an accessor, normalised integers as numbers in [−1, 1]."""
    dtype, columns = np.dtype(_DTYPES[accessor["componentType"]]), _COLUMNS[accessor["type"]]
    count = accessor["count"]
    if "bufferView" not in accessor:
        return np.zeros((count, columns))
    view = tree["bufferViews"][accessor["bufferView"]]
    row = columns * dtype.itemsize
    stride = view.get("byteStride", row)
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    data = np.frombuffer(binary, dtype=np.uint8, count=(count - 1) * stride + row, offset=start)
    rows = np.lib.stride_tricks.as_strided(data, (count, row), (stride, 1))
    values = np.ascontiguousarray(rows).view(dtype).astype(np.float64)
    if accessor.get("normalized", False) and dtype.kind in "iu":
        values = np.maximum(values / np.iinfo(dtype).max, -1.0)
    return values


def _append(tree: dict[str, Any], out: bytearray, values: NDArray[np.float32], kind: str) -> int:
    """A new accessor with ``values``."""
    out += b"\0" * (-len(out) % 4)
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(out), "byteLength": values.nbytes})
    out += values.tobytes()
    tree["accessors"].append(
        {"bufferView": len(tree["bufferViews"]) - 1, "componentType": _FLOAT, "count": len(values), "type": kind}
    )
    return len(tree["accessors"]) - 1
