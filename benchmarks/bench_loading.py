"""Speed of a DataLoader with two workers, compared with decoding the same files in two processes."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from avs3d_bench.exports import AVS3DDataset
from avs3d_bench.exports.samples import KINDS

WORKERS = 2
BATCH = 8
#: Largest number of items per measurement, so that filling and draining the queue takes a small part of the time.
ITEMS = 192
_KINDS = ("rgb", "binaural", "mask")

Triple = tuple[str, str, str]


def make_example(root: Path, frames: int = 48) -> None:
    """The demo's observations at full size, for machines without a dataset."""
    from generators.core.folders import default_cache
    from generators.plan import make_plans, read_manifest
    from generators.run.runner import RunSettings, run

    source = read_manifest(Path(__file__).parent.parent / "scenes_manifest" / "demo.yaml")
    plans = make_plans(source, frames=frames, audio="analytic")
    run(source, plans, root, RunSettings(default_cache(), WORKERS), lambda _: None)


def files_of(dataset: AVS3DDataset) -> list[Triple]:
    """The three files of every item."""
    out = []
    for item in range(len(dataset)):
        key, frame, index = dataset.locate(item)[0]
        rgb, clip, mask = (str(KINDS[kind].file(dataset.root / key, frame, index)) for kind in _KINDS)
        out.append((rgb, clip, mask))
    return out


def _decode(files: list[Triple]) -> int:
    """The least possible work: open and decode the files with OpenCV and libsndfile, and discard the result."""
    import soundfile

    cv2.setNumThreads(1)
    total = 0
    for rgb, clip, mask in files:
        for path, flag in ((rgb, cv2.IMREAD_COLOR), (mask, cv2.IMREAD_UNCHANGED)):
            pixels = cv2.imread(path, flag)
            assert pixels is not None, path
            total += pixels.size
        total += soundfile.read(clip, dtype="float32")[0].size
    return total


def bare_rate(files: list[Triple], pool: ProcessPoolExecutor) -> float:
    """Items per second of decoding only, in processes that are already running, batch by batch."""
    start = time.perf_counter()
    list(pool.map(_decode, [files[at : at + BATCH] for at in range(0, len(files), BATCH)]))
    return len(files) / (time.perf_counter() - start)


def loader_rate(loader: Iterable[dict[str, Any]], items: int) -> float:
    """Items per second of one epoch of a loader whose workers are already running."""
    start = time.perf_counter()
    seen = sum(len(batch["rgb"]) for batch in loader)
    assert seen == items
    return items / (time.perf_counter() - start)


def measure(root: Path, repeats: int) -> dict[str, float]:
    """Alternate both measurements, so that other load on the machine affects both."""
    from torch.utils.data import DataLoader, Subset

    dataset = AVS3DDataset(root, "all")
    chosen = list(range(min(ITEMS, len(dataset)) // BATCH * BATCH))
    files = [files_of(dataset)[item] for item in chosen]
    loader = DataLoader(
        Subset(dataset, chosen), batch_size=BATCH, num_workers=WORKERS, persistent_workers=True, prefetch_factor=4
    )
    with ProcessPoolExecutor(WORKERS, mp_context=multiprocessing.get_context("spawn")) as pool:
        bare_rate(files, pool)
        loader_rate(loader, len(chosen))
        pairs = [(bare_rate(files, pool), loader_rate(loader, len(chosen))) for _ in range(repeats)]
    bare, loaded = (float(np.median(column)) for column in zip(*pairs, strict=True))
    return {
        f"bare decoding, {WORKERS} processes (frames/s)": bare,
        f"DataLoader, {WORKERS} workers (frames/s)": loaded,
        f"DataLoader over bare decoding, {WORKERS} workers": float(np.median([b / a for a, b in pairs])),
    }


def run_all(repeats: int = 5) -> dict[str, float]:
    """Figures for `make bench`, on the dataset in AVS3D_BENCH_DATASET, else on frames generated for this benchmark."""
    given = os.environ.get("AVS3D_BENCH_DATASET")
    if given:
        return measure(Path(given), repeats)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "data"
        make_example(root)
        return measure(root, repeats)
