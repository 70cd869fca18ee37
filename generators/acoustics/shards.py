"""Many responses as WebDataset shards: tar files that training code streams."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from avs3d_bench.errors import UsageError
from avs3d_bench.formats.atomic import atomic_path
from generators.acoustics.rir import Rir


def write_webdataset(responses: Iterable[Rir], folder: str | Path, *, per_shard: int = 1000) -> list[Path]:
    """Write responses as they come; one is in memory at a time.

    A sample has ``NUMBER.npy``, its samples (channels, n) float32, and ``NUMBER.json``, `Rir.metadata`. The same
    responses give the same bytes. A shard is there as a whole or not at all.

    Args:
        responses: of `Engine.responses`, or any.
        folder: made if it is missing; must not have shards.
        per_shard: responses of a shard.

    Returns:
        the shards, ``rir-000000.tar`` and so on.

    Raises:
        UsageError: if the folder has shards already, or ``per_shard`` is below 1.
        Avs3dError: if a file cannot be written.

    Examples:
        >>> import tempfile
        >>> from generators.acoustics import Analytic, Room
        >>> room, listeners = Room.shoebox((6, 2.7, 4), 0.2), [(4, 1.5, 2), (4, 1.5, 3)]
        >>> responses = Analytic().responses(room, [(1, 1.5, 2)], listeners, sample_rate=8000)
        >>> [shard.name for shard in write_webdataset(responses, tempfile.mkdtemp())]
        ['rir-000000.tar']
    """
    folder = Path(folder)
    if per_shard < 1:
        raise UsageError(f"per_shard is {per_shard!r}, expected at least 1")
    if folder.is_dir() and next(folder.glob("rir-*.tar"), None) is not None:
        raise UsageError(f"{folder}: has shards already; give an empty folder")
    shards: list[Path] = []
    for number, some in enumerate(_grouped(responses, per_shard)):
        shard = folder / f"rir-{number:06d}.tar"
        with atomic_path(shard) as temporary, tarfile.open(temporary, "w", format=tarfile.PAX_FORMAT) as tar:
            for index, rir in some:
                _add(tar, index, rir)
        shards.append(shard)
    return shards


def _grouped(responses: Iterable[Rir], size: int) -> Iterator[Iterator[tuple[int, Rir]]]:
    """Numbered responses in groups that are read as they come."""
    numbered = enumerate(responses)
    for first in numbered:
        yield _some(first, numbered, size)


def _some(first: tuple[int, Rir], more: Iterator[tuple[int, Rir]], size: int) -> Iterator[tuple[int, Rir]]:
    yield first
    for _ in range(size - 1):
        following = next(more, None)
        if following is None:
            return
        yield following


def _add(tar: tarfile.TarFile, index: int, rir: Rir) -> None:
    samples = io.BytesIO()
    np.save(samples, rir.samples)
    for ending, data in (("npy", samples.getvalue()), ("json", json.dumps(rir.metadata()).encode())):
        entry = tarfile.TarInfo(f"{index:08d}.{ending}")
        entry.size = len(data)
        tar.addfile(entry, io.BytesIO(data))
