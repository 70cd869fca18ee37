"""The store of asset files: outside the repository, by id and hash, original and cleaned.

    <store>/<id>/<first 16 digits of the sha256>/<original file>
                                                 clean-<key>.glb, clean-<key>.json    objects only
    <store>/<id>/incoming/                                                            during the download

An object's cleaned GLB (metres, Y up, front +Z) is made from the original file on first use. Its key is the hash of all
its inputs: the original bytes, the entry's orientation, the cleaning code and its libraries. After a change of any of
them it is regenerated, so that lock files need no version of the cleaning.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean
from avs3d_bench.formats import files
from avs3d_bench.runtime.provenance import provenance
from avs3d_bench.runtime.user_path import user_path
from generators.library.archive import read_zip
from generators.library.lock import AssetEntry, Lock, read_lock

#: Suffixes that the cleaning reads.
MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae")
#: Suffixes of scans: one file with geometry and colour.
SCAN_SUFFIXES = (".glb", ".ply")
#: Suffixes that libsndfile ≥ 1.1 decodes.
SOUND_SUFFIXES = (".wav", ".flac", ".ogg", ".oga", ".mp3", ".aif", ".aiff")


def default_store() -> Path:
    """``$AVS3D_ASSETS``, else ``assets`` in ``$AVS3D_CACHE`` or the user's cache folder."""
    named = os.environ.get("AVS3D_ASSETS")
    if named:
        return user_path(named)
    from generators.core.folders import default_cache

    return default_cache() / "assets"


@dataclass(frozen=True)
class Store:
    """The files below ``root``."""

    root: Path

    @classmethod
    def default(cls) -> Store:
        """The store of `default_store`."""
        return cls(default_store())

    def folder(self, entry: AssetEntry) -> Path:
        """The folder of an asset's pinned version."""
        return self.root / entry.id / entry.sha256[:16]

    def path(self, entry: AssetEntry) -> Path:
        """The path of the original file; the file may be missing."""
        return self.folder(entry) / entry.file

    def incoming(self, asset: str, file: str) -> Path:
        """The folder for a download, until its hash is known."""
        return self.root / asset / "incoming" / file

    def problem(self, entry: AssetEntry) -> str:
        """The fault of the original file; empty if its size and hash are right."""
        path = self.path(entry)
        if not path.is_file():
            return f"not in the store ({path})"
        size = path.stat().st_size
        if size != entry.bytes:
            return f"{path} has {size} bytes, the lock file says {entry.bytes}"
        found = files.sha256_file(path)
        if found != entry.sha256:
            return f"{path} has the sha256 {found[:12]}…, the lock file says {entry.sha256[:12]}…"
        return ""

    def recordings(self, lock: Lock, split: str) -> list[AssetEntry]:
        """The undamaged recordings of a split that are here, in the order of the lock file."""
        return [each for each in lock.assets if each.kind == "sound" and each.split == split and not self.problem(each)]

    def adopt(self, asset: str, staged: Path, sha256: str) -> Path:
        """Move a complete download (see `incoming`) to its final place; a damaged file there is replaced."""
        target = self.root / asset / sha256[:16] / staged.name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(staged, target)
            self.tidy(asset)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, target, "write")) from error
        return target

    def put(self, asset: str, file: str, data: bytes) -> tuple[str, int]:
        """Store the bytes of a local file, and return its sha256 and size."""
        sha256 = files.sha256_bytes(data)
        files.write_bytes(self.root / asset / sha256[:16] / file, data)
        return sha256, len(data)

    def drop(self, entry: AssetEntry) -> None:
        """Delete a version that cannot be used."""
        shutil.rmtree(self.folder(entry), ignore_errors=True)
        self.tidy(entry.id)

    def tidy(self, asset: str) -> None:
        """Remove the empty folders of an asset."""
        folder = self.root / asset / "incoming"
        while folder != self.root:
            with contextlib.suppress(OSError):  # missing, or not empty
                folder.rmdir()
            folder = folder.parent

    def mesh(self, entry: AssetEntry) -> Path:
        """The cleaned GLB of an object, made if it is missing or damaged.

        Raises:
            Avs3dError: if the original file is not a usable mesh.
        """
        key = clean_key(entry)
        path, report = (self.folder(entry) / f"clean-{key}{suffix}" for suffix in (".glb", ".json"))
        with contextlib.suppress(Avs3dError, OSError, ValueError, KeyError, TypeError):
            if json.loads(report.read_text())["sha256"] == files.sha256_file(path):
                return path
        data, findings = clean(entry, self.path(entry))
        files.write_bytes(path, data)
        document = {
            "asset": entry.id,
            "made_from": entry.sha256,
            "key": key,
            "sha256": files.sha256_bytes(data),
            "findings": list(findings),
        }
        files.write_json(report, document)
        return path

    def findings(self, entry: AssetEntry) -> tuple[str, ...]:
        """The cleaning's findings and repairs, one line each."""
        self.mesh(entry)
        report = files.read_json(self.folder(entry) / f"clean-{clean_key(entry)}.json")
        return tuple(str(line) for line in report["findings"])


def clean_key(entry: AssetEntry) -> str:
    """16 hex digits of a hash of all that the bytes of an object's cleaned GLB depend on."""
    code = provenance("asset").digest
    inputs = [entry.sha256, entry.file, entry.up, entry.front, entry.height, entry.yaw, code]
    return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()[:16]


def clean(entry: AssetEntry, path: Path) -> tuple[bytes, tuple[str, ...]]:
    """The cleaned GLB of an object and its findings, from the original file (a mesh, or an archive with one).

    Raises:
        Avs3dError: naming the asset, if there is no usable mesh in it.
    """
    from generators.library import mesh_cleaning

    with tempfile.TemporaryDirectory(prefix="avs3d-asset-") as scratch:
        source = path
        if path.suffix.lower() == ".zip":
            members = read_zip(path, entry.id)
            for name, data in members.items():
                files.write_bytes(Path(scratch) / name, data)
            source = Path(scratch) / main_mesh(tuple(members), entry.id)
        try:
            data, findings = mesh_cleaning.clean(
                source, up=entry.up or "y", front=entry.front or "+z", height=entry.height, yaw=entry.yaw or 0.0
            )
        except RecursionError:
            raise Avs3dError(f"{entry.id}: {path.name} is nested too deeply; it is broken or malicious") from None
        except Avs3dError as error:
            # The reader's message names a temporary file that is deleted by now.
            text = str(error).replace(f"{scratch}/", "").replace(str(path), path.name)
            raise Avs3dError(f"{entry.id}: {text}") from None
        except Exception as error:  # an unforeseen fault of one file must not stop the following ones
            text = " ".join(str(error).replace(f"{scratch}/", "").split())[:200]
            raise Avs3dError(
                f"{entry.id}: {path.name} cannot be cleaned ({type(error).__name__}: {text}); repair it"
            ) from error
    return data, tuple(str(finding) for finding in findings)


def main_mesh(names: tuple[str, ...], what: str) -> str:
    """The mesh among the members of an archive: the only one at the least depth (``scene.gltf`` of Sketchfab).

    Raises:
        Avs3dError: if there is none, or more than one.
    """
    meshes = [name for name in names if Path(name).suffix.lower() in MESH_SUFFIXES]
    if not meshes:
        raise Avs3dError(f"{what}: no mesh in its archive; expected one of {', '.join(MESH_SUFFIXES)}")
    depth = min(name.count("/") for name in meshes)
    shallow = sorted(name for name in meshes if name.count("/") == depth)
    if len(shallow) > 1:
        raise Avs3dError(f"{what}: {len(shallow)} meshes in its archive ({', '.join(shallow[:3])}…); expected one")
    return shallow[0]


def find_entry(lock: Path, asset: str) -> AssetEntry:
    """Find the entry of ``asset`` in the lock file.

    Raises:
        UsageError: if it is not there, with the most similar id.
    """
    table = read_lock(lock)
    entry = table.find(asset)
    if entry is None:
        added = "; `avs3d assets fetch` or `import` adds it"
        hint = did_you_mean(asset, [one.id for one in table.assets], otherwise=added)
        raise UsageError(f"{lock}: no asset {asset!r}{hint}")
    return entry


def check_asset(lock: Path, asset: str, store: Store | None = None) -> AssetEntry:
    """The entry of an asset whose file in the store is the pinned one.

    Raises:
        UsageError: if the lock file does not contain it.
        Avs3dError: if its file is missing or differs from the pinned one, with the command that fetches it.
    """
    entry = find_entry(lock, asset)
    problem = (store or Store.default()).problem(entry)
    if problem:
        raise Avs3dError(f"{asset}: {problem}; run: avs3d assets fetch --lock {lock} --id {asset}")
    return entry


def open_asset(lock: Path, asset: str, store: Store | None = None) -> tuple[Path, AssetEntry]:
    """The file that generation reads for an asset: a sound or a scan as delivered, an object's cleaned GLB.

    Args:
        lock: the lock file, beside the manifest.
        asset: its id.
        store: the store with the files; default: the user's.

    Returns:
        The path, and the entry with licence and provenance.

    Raises:
        UsageError, Avs3dError: see `check_asset`.
    """
    store = store or Store.default()
    entry = check_asset(lock, asset, store)
    return (store.mesh(entry) if entry.kind == "object" else store.path(entry)), entry
