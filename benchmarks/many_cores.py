"""Measures how much simultaneous observations slow one another down on a machine with many cores.

    python -m benchmarks.many_cores [--workers 1 --workers 8 …] [--frames 24] [--json FILE]

For every number of workers, that many processes make the same observation at the same time, without pinning to cores,
and measure CPU and wall seconds of every engine per frame. There are also three controls without code of this project:
hashing within a core's cache (arithmetic), copying 64 MB (memory bandwidth) and touching new memory (page faults). An
engine that slows down as much as the arithmetic is limited by the cores (hyper-threads, clock); one that slows down as
much as the copy is limited by memory bandwidth.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import resource
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import click

from avs3d_bench.runtime.one_thread import ONE_THREAD

for _variable, _value in ONE_THREAD.items():
    os.environ.setdefault(_variable, _value)

#: Number of bytes that fit into a core's own cache, and number of bytes that fit into no cache.
_CACHED, _STREAMED = 1 << 15, 64 << 20
#: Duration of each control (s).
_CONTROL = 2.0
#: Figures that are also given for the slowest process: virtual cores of one machine may differ in speed.
_UNEVEN = ("frame (wall s)", "control: hash 2 MB in cache", "control: copy 64 MB")


def _rate(step: Callable[[], object]) -> float:
    """Milliseconds (wall) per step, measured over `_CONTROL` seconds."""
    count, start = 0, time.perf_counter()
    while (now := time.perf_counter()) - start < _CONTROL:
        step()
        count += 1
    return 1000 * (now - start) / count


def controls() -> dict[str, float]:
    """Milliseconds of each control."""
    import numpy as np

    block = os.urandom(_CACHED)
    source, target = np.ones(_STREAMED, np.uint8), np.ones(_STREAMED, np.uint8)

    def hashing() -> None:
        for _ in range(64):
            hashlib.sha256(block).digest()

    return {
        "control: hash 2 MB in cache": _rate(hashing),
        "control: copy 64 MB": _rate(lambda: np.copyto(target, source)),
        "control: touch 64 MB of fresh memory": _rate(lambda: np.ones(_STREAMED, np.uint8)),
    }


def _work(plan: Any, cache: str, barrier: Any, results: Any) -> None:
    from benchmarks.bench_pipeline import timed_engines
    from generators.observation.generate import generate_observation

    def once() -> dict[str, float]:
        cpu: dict[str, float] = defaultdict(float)
        wall: dict[str, float] = defaultdict(float)
        stamps: list[float] = []
        usage = resource.getrusage(resource.RUSAGE_SELF)
        with tempfile.TemporaryDirectory() as folder, timed_engines(cpu, wall):
            start = time.perf_counter()
            generate_observation(plan, Path(folder), Path(cache), lambda _: stamps.append(time.perf_counter()))
            whole = time.perf_counter() - start
        after = resource.getrusage(resource.RUSAGE_SELF)
        frames = plan.camera.frames
        return {
            "frame (wall s)": (stamps[-1] - stamps[0]) / (frames - 1),
            "before the first frame (wall s)": stamps[0] - start,
            "whole (wall s)": whole,
            "whole, user (CPU s)": after.ru_utime - usage.ru_utime,
            "whole, system (CPU s)": after.ru_stime - usage.ru_stime,
            "minor page faults a frame": (after.ru_minflt - usage.ru_minflt) / frames,
            **{f"{name} (CPU s)": value / frames for name, value in cpu.items()},
            **{f"{name} (wall s)": value / frames for name, value in wall.items()},
        }

    once()  # loads and compiles
    barrier.wait()
    made = once()
    barrier.wait()
    results.put(made | controls())


def measure(plan: Any, cache: Path, workers: int) -> dict[str, float]:
    """Medians over ``workers`` simultaneous processes, and the slowest process for some of the figures."""
    context = multiprocessing.get_context("spawn")
    barrier, results = context.Barrier(workers), context.Queue()
    processes = [context.Process(target=_work, args=(plan, str(cache), barrier, results)) for _ in range(workers)]
    for process in processes:
        process.start()
    found = [results.get(timeout=1200) for _ in processes]
    for process in processes:
        process.join()
    medians = {name: statistics.median(each[name] for each in found) for name in found[0]}
    slowest = {f"{name}, slowest process": max(each[name] for each in found) for name in _UNEVEN}
    return medians | slowest


@click.command()
@click.option("--workers", type=click.IntRange(1), multiple=True, default=(1,))
@click.option("--frames", type=click.IntRange(2), default=24, show_default=True)
@click.option("--audio", default="soundspaces", show_default=True)
@click.option("--json", "output", type=click.Path(path_type=Path), default=None)
def main(workers: tuple[int, ...], frames: int, audio: str, output: Path | None) -> None:
    """Measure, and print a table."""
    from benchmarks.bench_pipeline import MANIFEST
    from generators.core.folders import default_cache
    from generators.homes.store import prepare_home
    from generators.options import Audio, GenerateOptions
    from generators.plan import make_plans, read_manifest

    plan = make_plans(read_manifest(MANIFEST), GenerateOptions(frames=frames, size=1008, audio=cast(Audio, audio)))[0]
    cache = default_cache()
    prepare_home(plan, cache, workers=os.cpu_count() or 1)
    figures = {str(count): measure(plan, cache, count) for count in workers}
    first = figures[str(workers[0])]
    for name, value in first.items():
        cells = "  ".join(
            f"{figures[str(n)][name]:9.4f} ({figures[str(n)][name] / value if value else 0:4.2f})" for n in workers
        )
        print(f"{name:45} {cells}", flush=True)
    if output is not None:
        output.write_text(json.dumps({"cores": os.cpu_count(), "frames": frames, "figures": figures}, indent=1) + "\n")


if __name__ == "__main__":
    main()
