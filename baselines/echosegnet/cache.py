"""Stages whose result is kept on disk, under a name made of everything that decides it."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import atomic_path, sha256_file
from avs3d_bench.runtime.provenance import provenance
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.views import picture_folder

#: Pictures that are read at a time.
_READERS = 8


def software_digest(rasteriser: Rasteriser) -> str:
    """Digest of the software behind a stage, and of the rasteriser in use."""
    kind = type(rasteriser)
    named = f"{kind.__module__}:{kind.__qualname__}"
    return digest([provenance("baselines.echosegnet").digest, named, rasteriser.device.type])


def inputs_digest(observation: Observation) -> str:
    """sha256 over the content of what training reads: the sparse model, the split and the train pictures."""
    said: dict[str, Any] = {"splits": dict(sorted(observation.splits.items()))}
    for name in layout.COLMAP_FILES:
        path = observation.path / name
        if not path.exists():
            raise Avs3dError(f"{path}: missing; EchoSegnet needs the sparse model (run COLMAP, or generate it again)")
        said[name] = sha256_file(path)
    train = sorted(name for name, split in observation.splits.items() if split == "train")
    folder = observation.path / picture_folder(observation)
    pictures = [path for name in train if (path := folder / f"{name}.png").exists()]
    with ThreadPoolExecutor(_READERS) as readers:
        said["pictures"] = dict(zip((p.name for p in pictures), readers.map(sha256_file, pictures), strict=True))
    return digest(said)


def arrays_digest(arrays: Iterable[NDArray[np.bool_]]) -> str:
    """sha256 over the content of masks."""
    out = hashlib.sha256()
    for array in arrays:
        out.update(repr(array.shape).encode() + np.packbits(array).tobytes())
    return out.hexdigest()


def digest(values: object) -> str:
    """16 hexadecimal digits of the sha256 of values as JSON."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Stages:
    """The folder of one observation's intermediate results."""

    folder: Path

    def path(self, stage: str, key: str, suffix: str) -> Path:
        """Where a stage's result lies."""
        return self.folder / f"{stage}-{key}{suffix}"

    def load_arrays(self, stage: str, key: str) -> dict[str, NDArray[Any]] | None:
        """Arrays kept earlier; None if there are none, or the file is damaged (then they are regenerated)."""
        path = self.path(stage, key, ".npz")
        try:
            with np.load(path) as file:
                return dict(file)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def save_arrays(self, stage: str, key: str, arrays: dict[str, NDArray[Any]]) -> None:
        """Keep arrays, atomically."""
        path = self.path(stage, key, ".npz")
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary, open(temporary, "wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
