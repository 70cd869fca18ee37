"""Where the files of assets lie: outside the repository, by id and hash, as delivered and cleaned.

    <store>/<id>/<first 16 digits of the sha256>/<file as delivered>
                                                 clean-<key>.glb, clean-<key>.json    objects only
    <store>/<id>/incoming/                                                            while it is fetched

An object's cleaned GLB (metres, Y up, front +Z) is made from the delivered file on first use. Its key is the hash of
everything it is made from: the delivered bytes, the entry's orientation, the code that cleans and its libraries. After
a change it is made again, and a lock file never has to say which version it was.
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

from avs3d_bench import files
from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean
from avs3d_bench.provenance import provenance
from avs3d_bench.user_path import user_path
from generators.library.archive import read_zip
from generators.library.lock import AssetEntry, read_lock

#: What makes a cleaned GLB of a file as delivered (see `avs3d_bench.provenance`).
CLEANING = "generators.library.store:clean"
#: What the cleaning reads.
MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae")
#: What libsndfile ≥ 1.1 decodes.
SOUND_SUFFIXES = (".wav", ".flac", ".ogg", ".mp3", ".aif", ".aiff")


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
        """The file as delivered; it may be missing."""
        return self.folder(entry) / entry.file

    def incoming(self, asset: str, file: str) -> Path:
        """Where a file of the asset is fetched to before its hash is known."""
        return self.root / asset / "incoming" / file

    def problem(self, entry: AssetEntry) -> str:
        """What is wrong with the file as delivered: empty if its size and hash are right."""
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

    def adopt(self, asset: str, staged: Path, sha256: str) -> Path:
        """Give a file that came whole (see `incoming`) its place; a damaged one there is replaced."""
        target = self.root / asset / sha256[:16] / staged.name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(staged, target)
            self.tidy(asset)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, target, "write")) from error
        return target

    def put(self, asset: str, file: str, data: bytes) -> tuple[str, int]:
        """Store the bytes of a file that is here already; its sha256 and size."""
        sha256 = files.sha256_bytes(data)
        files.write_bytes(self.root / asset / sha256[:16] / file, data)
        return sha256, len(data)

    def drop(self, entry: AssetEntry) -> None:
        """Forget a version that turned out to be useless."""
        shutil.rmtree(self.folder(entry), ignore_errors=True)
        self.tidy(entry.id)

    def tidy(self, asset: str) -> None:
        """Remove the folders of an asset that hold nothing."""
        folder = self.root / asset / "incoming"
        while folder != self.root:
            with contextlib.suppress(OSError):  # missing, or not empty
                folder.rmdir()
            folder = folder.parent

    def mesh(self, entry: AssetEntry) -> Path:
        """The cleaned GLB of an object, made if it is missing or damaged.

        Raises:
            Avs3dError: if the delivered file is no mesh that can be used.
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
        """What the cleaning found and mended, one line each."""
        self.mesh(entry)
        report = files.read_json(self.folder(entry) / f"clean-{clean_key(entry)}.json")
        return tuple(str(line) for line in report["findings"])


def clean_key(entry: AssetEntry) -> str:
    """16 hex digits over everything that decides the bytes of an object's cleaned GLB."""
    code = provenance(CLEANING).digest
    inputs = [entry.sha256, entry.file, entry.up, entry.front, entry.height, entry.yaw, code]
    return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()[:16]


def clean(entry: AssetEntry, path: Path) -> tuple[bytes, tuple[str, ...]]:
    """The cleaned GLB of an object and what was found, from the file as delivered (a mesh, or an archive with one).

    Raises:
        Avs3dError: naming the asset, if there is no usable mesh in it.
    """
    from generators.library import mesh_cleaning as hygiene

    with tempfile.TemporaryDirectory(prefix="avs3d-asset-") as scratch:
        source = path
        if path.suffix.lower() == ".zip":
            members = read_zip(path, entry.id)
            for name, data in members.items():
                files.write_bytes(Path(scratch) / name, data)
            source = Path(scratch) / main_mesh(tuple(members), entry.id)
        try:
            data, findings = hygiene.clean(
                source, up=entry.up or "y", front=entry.front or "+z", height=entry.height, yaw=entry.yaw or 0.0
            )
        except RecursionError:
            raise Avs3dError(f"{entry.id}: {path.name} is nested without end; it is broken or hostile") from None
        except Avs3dError as error:
            # The reader speaks of a scratch file that is gone by now.
            text = str(error).replace(f"{scratch}/", "").replace(str(path), path.name)
            raise Avs3dError(f"{entry.id}: {text}") from None
        except Exception as error:  # a file that no reader foresaw ends itself, not all that come after it
            text = " ".join(str(error).replace(f"{scratch}/", "").split())[:200]
            raise Avs3dError(
                f"{entry.id}: {path.name} cannot be made a clean mesh ({type(error).__name__}: {text}); repair it"
            ) from error
    return data, tuple(str(finding) for finding in findings)


def main_mesh(names: tuple[str, ...], what: str) -> str:
    """The mesh among the members of an archive: the only one at the least depth (``scene.gltf`` of Sketchfab).

    Raises:
        Avs3dError: if there is none, or which one is not clear.
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
    """The entry of ``asset`` in the lock file.

    Raises:
        UsageError: if it is not there, with the nearest id.
    """
    table = read_lock(lock)
    entry = table.find(asset)
    if entry is None:
        added = "; `avs3d assets fetch` or `import` adds it"
        hint = did_you_mean(asset, [one.id for one in table.assets], otherwise=added)
        raise UsageError(f"{lock}: no asset {asset!r}{hint}")
    return entry


def open_asset(lock: Path, asset: str, store: Store | None = None) -> tuple[Path, AssetEntry]:
    """The file that generation reads for an asset: a sound as delivered, an object's cleaned GLB.

    Args:
        lock: the lock file, beside the manifest.
        asset: its id.
        store: where the files lie; the user's by default.

    Returns:
        The path, and the entry with licence and provenance.

    Raises:
        UsageError: if the lock file does not name it.
        Avs3dError: if its file is missing or not the pinned one, with the command that fetches it.
    """
    entry = find_entry(lock, asset)
    store = store or Store.default()
    problem = store.problem(entry)
    if problem:
        raise Avs3dError(f"{asset}: {problem}; run: avs3d assets fetch --lock {lock} --id {asset}")
    return (store.mesh(entry) if entry.kind == "object" else store.path(entry)), entry
