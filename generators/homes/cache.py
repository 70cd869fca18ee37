"""Cache of built and baked scenes on disk: an apartment is made once per key and then mapped into memory.

    <directory>/<key>-<digest>/   index.json: all except the arrays, and the size and SHA-256 of each array file
                                  positions.npy … textures.npy: the arrays of all parts, concatenated

Array files are opened with ``mmap_mode="r"``, so that worker processes share their pages. The digest in the folder's
name covers the key and the software that builds scenes: after a change of either, scenes are built again.
A folder is written under a temporary name and renamed when complete, so a folder with a final name is complete.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.provenance import provenance
from generators.core.rays import TRACERS
from generators.core.scene import Licence, LightMap, Material, Mesh, Part, Room, Scene, Support, Texture

#: Version of the file layout; increase it when the layout changes.
FORMAT = 4
INDEX = "index.json"
#: Attributes of a material that are textures; the others are numbers, triples of them, words, or None.
_MAPS = ("texture", "normal_map", "roughness_map")
_PLAIN = tuple(field.name for field in fields(Material) if field.name not in _MAPS)
#: Age (s) after which unfinished folders of dead processes are deleted.
_STALE = 86400.0
#: Array files: dtype and shape of one row.
_ARRAYS: dict[str, tuple[str, tuple[int, ...]]] = {
    "positions": ("<f4", (3, 3)),
    "normals": ("<f4", (3, 3)),
    "uv": ("<f4", (3, 2)),
    "face_material": ("<i4", ()),
    "acoustic_positions": ("<f4", (3, 3)),
    "acoustic_labels": ("<i4", ()),
    "light_uv": ("<f4", (3, 2)),
    "light_texels": ("<f2", (3,)),
    "textures": ("|u1", (3,)),
}


class _BrokenError(Exception):
    """The files of a stored scene do not match its index."""


def builder_version(device: str = "cpu") -> str:
    """Digest of the software that builds, lights and stores apartments, with rays on ``device``."""
    without = tuple(entry for name, entry in TRACERS.items() if name not in ("cpu", device))
    return provenance("home", without=without).digest


def cached_scene(directory: Path, key: str, build: Callable[[], Scene], device: str = "cpu") -> Scene:
    """The scene stored under ``key``, built and stored first if it is missing or damaged.

    Several processes may call this at the same time: a missing scene may then be built more than once, and all
    processes use the one that was stored first.

    Args:
        directory: the cache; made if it is missing.
        key: identifies the scene, with all that ``build`` depends on besides the code (seed, quality).
        build: makes the scene, deterministically.
        device: on which ``build`` casts rays.

    Returns:
        The scene with read-only arrays mapped from the files.

    Raises:
        Avs3dError: if the cache cannot be written or read back.
    """
    folder = directory / _folder_name(key, device)
    found = _try_load(folder)
    if found is not None:
        return found
    check_writable(directory, repr(key))  # building takes minutes
    scene = build()
    try:
        _sweep(directory)
        _store(scene, folder)
    except OSError as error:
        raise _unwritable(directory, repr(key), error) from error
    found = _try_load(folder)
    if found is None:
        raise Avs3dError(f"scene cache {folder}: the scene that was just written cannot be read back; check the disk")
    return found


def is_stored(directory: Path, key: str, device: str = "cpu") -> bool:
    """Whether a scene is stored under ``key``; the scene is not checked for damage."""
    return (directory / _folder_name(key, device)).is_dir()


def check_writable(directory: Path, what: str = "homes") -> None:
    """Check that the cache folder can be written, before ``what`` is built: make it and write a byte into it.

    Raises:
        Avs3dError: if that fails.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=directory, prefix=".probe-", suffix=".tmp") as probe:
            probe.write(b"?")
            probe.flush()
    except OSError as error:
        raise _unwritable(directory, what, error) from error


def _unwritable(directory: Path, what: str, error: OSError) -> Avs3dError:
    return Avs3dError(
        f"scene cache {directory}: cannot store {what} ({error.strerror or error}); free space or choose another "
        "folder with --cache"
    )


def _folder_name(key: str, device: str) -> str:
    digest = hashlib.sha256(f"{builder_version(device)} {key}".encode()).hexdigest()[:16]
    return f"{re.sub(r'[^A-Za-z0-9_.-]+', '_', key).lstrip('.')[:60]}-{digest}"


def _try_load(folder: Path) -> Scene | None:
    """The stored scene, or None; a damaged one is renamed."""
    if not folder.is_dir():
        return None
    try:
        return _load(folder)
    except (_BrokenError, OSError, ValueError, KeyError, TypeError, IndexError):
        if not folder.is_dir():
            return None
        broken = _temporary(folder)
        try:
            folder.rename(broken)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise Avs3dError(
                f"scene cache {folder}: damaged, and it cannot be replaced ({error.strerror}); delete it"
            ) from error
        shutil.rmtree(broken, ignore_errors=True)
        return None


def _temporary(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.{os.getpid()}.{secrets.token_hex(4)}.tmp")


def _sweep(directory: Path) -> None:
    """Delete unfinished folders of processes that died more than `_STALE` seconds ago."""
    for leftover in directory.glob(".*.tmp"):
        try:
            old = time.time() - leftover.stat().st_mtime > _STALE
        except OSError:
            continue
        if old:
            shutil.rmtree(leftover, ignore_errors=True)


def _store(scene: Scene, folder: Path) -> None:
    """Write ``scene`` under a temporary name and rename it; an existing folder of that name is kept instead."""
    arrays, index = _pack(scene)
    temporary = _temporary(folder)
    try:
        temporary.mkdir()
        files = {}
        for name, (kind, row) in _ARRAYS.items():
            pieces = [np.asarray(piece).astype(kind, casting="safe").reshape(-1, *row) for piece in arrays[name]]
            joined = np.concatenate(pieces) if pieces else np.zeros((0, *row), dtype=kind)
            path = temporary / f"{name}.npy"
            np.save(path, np.ascontiguousarray(joined), allow_pickle=False)
            files[name] = {"bytes": path.stat().st_size, "sha256": _digest(path)}
        text = json.dumps({"format": FORMAT, "files": files, "scene": index}, sort_keys=True)
        document = {"sha256": hashlib.sha256(text.encode()).hexdigest(), "body": text}
        (temporary / INDEX).write_text(json.dumps(document))
        try:
            temporary.rename(folder)
        except OSError:
            if not folder.is_dir():
                raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _digest(path: Path) -> str:
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _pack(scene: Scene) -> tuple[dict[str, list[NDArray[Any]]], dict[str, Any]]:
    """The arrays of a scene, and the rest of it as JSON values."""
    arrays: dict[str, list[NDArray[Any]]] = {name: [] for name in _ARRAYS}
    materials, material_index, texture_index, arrays["textures"] = _pack_materials(scene)
    labels: dict[str, int] = {}
    part_index = []
    for part in scene.parts:
        mesh = part.mesh
        for name in ("positions", "normals", "uv", "face_material", "acoustic_positions"):
            arrays[name].append(getattr(mesh, name))
        own = [labels.setdefault(label, len(labels)) for label in mesh.acoustic_labels]
        arrays["acoustic_labels"].append(np.array(own, dtype=np.int32))
        light = None
        if part.light is not None:
            arrays["light_uv"].append(part.light.uv)
            arrays["light_texels"].append(part.light.texels)
            light = list(part.light.texels.shape[:2])
        part_index.append(
            {
                "name": part.name,
                "instance_id": int(part.instance_id),
                "category": part.category,
                "licence": [part.licence.name, part.licence.author, part.licence.source],
                "faces": len(mesh.positions),
                "acoustic_faces": len(mesh.acoustic_positions),
                "materials": [materials[id(material)] for material in mesh.materials],
                "light": light,
            }
        )
    index = {
        "name": scene.name,
        "exposure": float(scene.exposure),
        "rooms": [[r.name, _floats(r.low), _floats(r.high), float(r.exposure), _floats(r.white)] for r in scene.rooms],
        "supports": [
            [s.kind, s.room, *(_floats(v) for v in (s.origin, s.u, s.v, s.normal, s.front)), float(s.clearance)]
            for s in scene.supports
        ],
        "textures": texture_index,
        "materials": material_index,
        "labels": list(labels),
        "parts": part_index,
    }
    return arrays, index


def _pack_materials(
    scene: Scene,
) -> tuple[dict[int, int], list[dict[str, Any]], list[dict[str, Any]], list[NDArray[Any]]]:
    """Number each material of a scene: ``id`` → number; their fields; the fields and the pixels of their textures."""
    numbers: dict[int, int] = {}
    materials: list[dict[str, Any]] = []
    textures: dict[int, int] = {}
    described: list[dict[str, Any]] = []
    pixels: list[NDArray[Any]] = []
    for material in (each for part in scene.parts for each in part.mesh.materials):
        if id(material) in numbers:
            continue
        for texture in (getattr(material, name) for name in _MAPS):
            if texture is not None and id(texture) not in textures:
                textures[id(texture)] = len(described)
                described.append({"name": texture.name, "shape": list(texture.pixels.shape[:2])})
                pixels.append(texture.pixels)
        numbers[id(material)] = len(materials)
        materials.append(
            {
                **{name: _plain(getattr(material, name)) for name in _PLAIN},
                **{name: None if (map_ := getattr(material, name)) is None else textures[id(map_)] for name in _MAPS},
            }
        )
    return numbers, materials, described, pixels


def _plain(value: Any) -> Any:
    """A plain attribute of a material for JSON."""
    if value is None or isinstance(value, str):
        return value
    return _floats(value) if isinstance(value, tuple) else float(value)


def _floats(values: Any) -> list[float]:
    return [float(value) for value in values]


def _load(folder: Path) -> Scene:
    """Read a stored scene.

    Raises:
        _BrokenError: if a file is missing, cut off or changed.
    """
    document = json.loads((folder / INDEX).read_text())
    if hashlib.sha256(document["body"].encode()).hexdigest() != document["sha256"]:
        raise _BrokenError(INDEX)
    body = json.loads(document["body"])
    if body["format"] != FORMAT:
        raise _BrokenError(f"format {body['format']}")
    arrays: dict[str, NDArray[Any]] = {}
    for name, (kind, row) in _ARRAYS.items():
        path, expected = folder / f"{name}.npy", body["files"][name]
        if path.stat().st_size != expected["bytes"] or _digest(path) != expected["sha256"]:
            raise _BrokenError(path.name)
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        if array.dtype != np.dtype(kind) or array.shape[1:] != row:
            raise _BrokenError(path.name)
        arrays[name] = np.asarray(array)
    return _unpack(arrays, body["scene"])


class _ArrayReader:
    """Returns consecutive rows of the array files."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self._arrays = arrays
        self._next = dict.fromkeys(arrays, 0)

    def take(self, name: str, count: int) -> NDArray[Any]:
        first = self._next[name]
        rows = self._arrays[name][first : first + count]
        if len(rows) != count:
            raise _BrokenError(name)
        self._next[name] = first + count
        return rows


def _unpack(arrays: dict[str, NDArray[Any]], index: dict[str, Any]) -> Scene:
    reader = _ArrayReader(arrays)
    textures = []
    for entry in index["textures"]:
        height, width = entry["shape"]
        textures.append(Texture(entry["name"], reader.take("textures", height * width).reshape(height, width, 3)))
    materials = []
    for m in index["materials"]:
        attributes: dict[str, Any] = {name: tuple(m[name]) if isinstance(m[name], list) else m[name] for name in _PLAIN}
        attributes |= {name: None if m[name] is None else textures[m[name]] for name in _MAPS}
        materials.append(Material(**attributes))
    parts = []
    for entry in index["parts"]:
        faces, labels = entry["faces"], reader.take("acoustic_labels", entry["acoustic_faces"])
        mesh = Mesh(
            positions=reader.take("positions", faces),
            normals=reader.take("normals", faces),
            uv=reader.take("uv", faces),
            face_material=reader.take("face_material", faces),
            materials=tuple(materials[number] for number in entry["materials"]),
            acoustic_positions=reader.take("acoustic_positions", entry["acoustic_faces"]),
            acoustic_labels=tuple(index["labels"][number] for number in labels.tolist()),
        )
        light = None
        if entry["light"] is not None:
            height, width = entry["light"]
            texels = reader.take("light_texels", height * width).reshape(height, width, 3)
            light = LightMap(uv=reader.take("light_uv", faces), texels=texels)
        licence = Licence(*entry["licence"])
        parts.append(Part(entry["name"], mesh, entry["instance_id"], entry["category"], light, licence))
    rooms = tuple(
        Room(name, tuple(low), tuple(high), exposure, tuple(white))
        for name, low, high, exposure, white in index["rooms"]
    )
    supports = tuple(
        Support(kind, room, tuple(origin), tuple(u), tuple(v), tuple(normal), tuple(front), clearance)
        for kind, room, origin, u, v, normal, front, clearance in index["supports"]
    )
    return Scene(index["name"], tuple(parts), rooms, supports, index["exposure"])
