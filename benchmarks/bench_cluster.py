"""Cost of the scheduling: speed-up of two Dask worker processes over one, and overhead per task with 10⁴ tasks."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections import defaultdict
from functools import partial
from pathlib import Path

from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.scheduling.dask_backend import DaskScheduler
from avs3d_bench.scheduling.local import LocalScheduler
from avs3d_bench.scheduling.options import Options
from avs3d_bench.scheduling.tasks import Context, Event, Policy, Scheduler, Task
from benchmarks.bench_pipeline import MANIFEST
from generators.core.folders import default_cache
from generators.homes.store import prepare_home
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from generators.run.runner import RunSettings, run

#: Observations that do nothing.
COUNT = 10_000
#: Frames of each measured observation; with small pictures, so that the rate becomes steady soon.
FRAMES, SIZE = 40, 504


def nothing(context: Context, index: int) -> int:
    """An empty task in place of an observation."""
    return index


def overhead(scheduler: Scheduler, count: int = COUNT) -> dict[str, float]:
    """CPU and wall time (ms) of this process per empty task.

    The scheduler of a Dask cluster that this process has started runs in this process and is counted.
    """
    tasks = [Task(f"part_1/scan-{n}/kitchen/1", nothing, (n,), after=f"home {n % 50}") for n in range(count)]
    tasks += [Task(f"home {n}", nothing, (n,)) for n in range(min(50, count))]
    with scheduler as pool:
        wall, cpu = time.perf_counter(), time.process_time()
        results = list(pool.run(tasks, Policy(), lambda _: None))
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    assert len(results) == len(tasks)
    return {"cpu": 1000 * cpu / len(tasks), "wall": 1000 * wall / len(tasks)}


def scaling(repeats: int) -> dict[str, float]:
    """Frames per second (wall) of one and of two Dask worker processes while all are rendering, and their ratio."""
    source = read_manifest(MANIFEST)
    plans = make_plans(source, GenerateOptions(frames=FRAMES, size=SIZE))
    cache = default_cache()
    prepare_home(plans[0], cache, workers=available_cores())
    rates: dict[int, list[float]] = defaultdict(list)
    for _ in range(repeats):
        for workers in (1, 2):
            seen: dict[str, list[tuple[float, int]]] = defaultdict(list)
            with tempfile.TemporaryDirectory() as folder:

                def listen(event: Event, seen: dict[str, list[tuple[float, int]]] = seen) -> None:
                    if event.kind == "frame":
                        seen[event.name].append((time.perf_counter(), int(event.text)))

                settings = RunSettings(
                    cache, workers, scheduler=partial(DaskScheduler, workers), shared=True,
                    policy=Options(scheduler="dask").policy(one_thread=True),
                )  # fmt: skip
                run(source, plans, Path(folder) / "data", settings, listen)
            # Events come about once a second, with the number of the newest frame.
            each = [(s[-1][1] - s[0][1]) / (s[-1][0] - s[0][0]) for s in seen.values()]
            rates[workers].append(statistics.mean(each) if workers == 1 else sum(each))
    return {
        "one Dask worker (frames/s)": statistics.median(rates[1]),
        "two Dask workers (frames/s)": statistics.median(rates[2]),
        "two Dask workers over one": statistics.median(b / a for a, b in zip(rates[1], rates[2], strict=True)),
    }


def run_all(repeats: int = 5) -> dict[str, float]:
    """Every figure of this file."""
    dask, local = overhead(DaskScheduler(2)), overhead(LocalScheduler(2))
    return {
        "client and Dask's scheduler per no-op observation, of 10⁴ (CPU ms)": dask["cpu"],
        "no-op observation on two Dask workers (wall ms)": dask["wall"],
        "client per no-op observation, local, of 10⁴ (CPU ms)": local["cpu"],
        **scaling(repeats),
    }
