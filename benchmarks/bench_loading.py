"""How fast frames are loaded: from a dataset's folders, and from WebDataset shards.

python -m benchmarks.run --only loading            two workers, compared with decoding the same files alone
python -m benchmarks.bench_loading DIR --workers 16     tars, or a dataset: frames per second, and where the time goes
"""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from avs3d_bench.exports import AVS3DDataset, decode_sample
from avs3d_bench.exports.samples import KINDS
from avs3d_bench.exports.shard_files import read_samples

WORKERS = 2
BATCH = 8
#: Largest number of items per measurement, so that filling and draining the queue takes a small part of the time.
ITEMS = 192
_KINDS = ("rgb", "binaural", "mask")

#: Members that training reads, in the order in which their times are printed.
MEMBERS = ("rgb.png", "binaural.wav", "mask.png", "instances.png", "categories.png", "json")

Triple = tuple[str, str, str]
Sample = dict[str, Any]


def make_example(root: Path, frames: int = 48) -> None:
    """The demo's observations at full size, for machines without a dataset."""
    from generators.core.folders import default_cache
    from generators.options import GenerateOptions
    from generators.plan import make_plans, read_manifest
    from generators.run.runner import RunSettings, run

    source = read_manifest(Path(__file__).parent.parent / "scenes_manifest" / "demo.yaml")
    plans = make_plans(source, GenerateOptions(frames=frames, size=1008, audio="analytic"))
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


def milliseconds(work: Callable[[], object], frames: int, repeats: int) -> float:
    """CPU time of one core per frame, the best of some repeats."""
    taken = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return 1000 * min(taken) / frames


def where_time_goes(tars: list[Path], repeats: int) -> dict[str, float]:
    """Milliseconds of one core per frame, of the whole path of a frame and of its parts."""
    import webdataset

    cv2.setNumThreads(1)
    samples = [sample for path in tars for sample in read_samples(path)]

    def decode(*members: str) -> None:
        for sample in samples:
            decode_sample({name: sample[name] for name in ("__key__", *members) if name in sample})

    def read() -> None:
        for _ in webdataset.WebDataset(list(map(str, tars)), shardshuffle=False):
            pass

    works: dict[str, Callable[[], object]] = {f"decode {name}": partial(decode, name) for name in MEMBERS}
    works |= {
        "decode all of it": partial(decode, *MEMBERS),
        "read the tar": read,
        "read, decode and collate": partial(_drain, tar_loader(tars, 0)),
    }
    return {name: milliseconds(work, len(samples), repeats) for name, work in works.items()}


def _drain(frames: Iterable[object]) -> None:
    for _ in frames:
        pass


def tensors(sample: Sample) -> Sample:
    """What a batch holds of a frame."""
    return {name: sample[name] for name in ("rgb", "binaural", "mask", "instance_ids")}


def tar_loader(tars: list[Path], workers: int) -> Iterable[Sample]:
    """A DataLoader over tars: each worker streams its share of them."""
    import webdataset
    from torch.utils.data import DataLoader

    frames = webdataset.WebDataset(list(map(str, tars)), shardshuffle=False).map(decode_sample).map(tensors)
    return DataLoader(frames, batch_size=32, **_loader_options(workers))


def _loader_options(workers: int) -> dict[str, Any]:
    return {"num_workers": workers, "persistent_workers": True, "prefetch_factor": 4} if workers else {}


def folder_loader(root: Path, workers: int) -> tuple[Iterable[Sample], int]:
    """A shuffled DataLoader over a dataset's folders, and the number of its frames."""
    from torch.utils.data import DataLoader

    frames = AVS3DDataset(root, "all", instances=True)
    return DataLoader(frames, batch_size=32, shuffle=True, **_loader_options(workers)), len(frames)


def measure_stream(root: Path, workers: int, repeats: int) -> dict[str, float]:
    """Frames per second of whole epochs, from tars or from folders, with the workers running already."""
    import torch

    torch.set_num_threads(1)  # as in a worker
    tars = sorted(root.glob("*.tar"))
    out: dict[str, float] = {}
    if tars:
        parts = where_time_goes(tars[:4], repeats)
        out |= {f"{name} (ms of a core per frame)": value for name, value in parts.items()}
        # Every worker has as many tars as the others; a tar may be listed several times.
        rounds = max(1, -(-4 * workers // len(tars)))
        loader: Iterable[Sample] = tar_loader(tars * rounds, workers)
        frames = None
    else:
        alone, frames = folder_loader(root, 0)
        out["read, decode and collate (ms of a core per frame)"] = milliseconds(partial(_drain, alone), frames, repeats)
        loader, frames = folder_loader(root, workers)
    for _ in range(2):  # the first epoch starts the workers
        start = time.perf_counter()
        seen = sum(len(batch["rgb"]) for batch in loader)
        rate = seen / (time.perf_counter() - start)
        assert frames is None or seen == frames
    kind = "tars" if tars else "folders"
    return out | {f"DataLoader over {kind}, {workers} workers (frames/s)": rate}


@click.command()
@click.argument("root", type=click.Path(path_type=Path, exists=True))
@click.option("--workers", type=int, default=WORKERS, show_default=True, help="Worker processes of the DataLoader.")
@click.option("--repeats", type=int, default=5, show_default=True, help="Of the times per frame; the best counts.")
def main(root: Path, workers: int, repeats: int) -> None:
    """Measure how fast the frames at ROOT are loaded: WebDataset shards, or a dataset."""
    for name, value in measure_stream(root, workers, repeats).items():
        click.echo(f"{name}: {value:,.3g}" if value < 100 else f"{name}: {value:,.0f}")


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


if __name__ == "__main__":
    main()
