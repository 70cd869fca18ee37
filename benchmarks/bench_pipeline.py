"""Cost per frame of the whole generation and of its engines, scaling with workers, and memory of a worker."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.scheduling.tasks import Event
from generators import backends
from generators.acoustics.clips import receiver_clip
from generators.core.folders import default_cache
from generators.homes.store import prepare_home
from generators.manifest.reading import ManifestFile
from generators.observation import hearing, prepare
from generators.observation.generate import generate_observation
from generators.observation.writer import ObservationWriter
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest
from generators.run.runner import RunSettings, run

MANIFEST = Path(__file__).parent.parent / "scenes_manifest" / "demo.yaml"
#: Number of frames, fewer than in an observation: the cost per frame does not depend on it.
FRAMES = 24
#: Pixels per side, those of the benchmark.
SIZE = 1008
REPEATS = 5


@contextmanager
def timed_engines(spent: dict[str, float], wall: dict[str, float] | None = None) -> Iterator[None]:
    """Add the CPU seconds inside each engine to ``spent``: rendering, impulse responses, convolution, encoding.

    Args:
        spent: CPU seconds of this process are added here, by engine.
        wall: wall seconds are added here, by engine.
    """

    def timed(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            start, begun = time.process_time(), time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                spent[name] += time.process_time() - start
                if wall is not None:
                    wall[name] += time.perf_counter() - begun

        return wrapper

    def session(open_session: Callable[..., Any], method: str, name: str) -> Callable[..., Any]:
        def opened(*args: Any, **kwargs: Any) -> Any:
            made = open_session(*args, **kwargs)
            setattr(made, method, timed(name, getattr(made, method)))
            return made

        return opened

    def backend(make: Callable[..., Any], method: str, name: str) -> Callable[..., Any]:
        def made(*args: Any, **kwargs: Any) -> Any:
            engine = make(*args, **kwargs)
            engine_open = session(engine.open, method, name)
            return _Proxy(engine, engine_open)

        return made

    with (
        patch.object(prepare, "vision_backend", backend(backends.vision_backend, "render", "render")),
        patch.object(
            hearing, "acoustic_backend", backend(backends.acoustic_backend, "impulse_response", "impulse response")
        ),
        patch.object(hearing, "receiver_clip", timed("convolve", receiver_clip)),
        patch.object(ObservationWriter, "add_pictures", timed("encode", ObservationWriter.add_pictures)),
        patch.object(ObservationWriter, "add_masks", timed("encode", ObservationWriter.add_masks)),
        patch.object(ObservationWriter, "add_clip", timed("encode", ObservationWriter.add_clip)),
        patch.object(ObservationWriter, "add_mono", timed("encode", ObservationWriter.add_mono)),
    ):
        yield


def _stamp(stamps: list[float], _: int) -> None:
    stamps.append(time.process_time())


class _Proxy:
    """An engine whose ``open`` is replaced."""

    def __init__(self, engine: Any, opener: Callable[..., Any]) -> None:
        self._engine = engine
        self.open = opener

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)


def per_frame(plan: ObservationPlan, cache: Path, repeats: int = REPEATS) -> dict[str, float]:
    """Medians of the CPU seconds per frame, for the loop over frames and for each engine in it."""
    loops: list[float] = []
    engines: dict[str, list[float]] = defaultdict(list)
    overheads: list[float] = []
    wholes: list[float] = []
    for _ in range(repeats):
        spent: dict[str, float] = defaultdict(float)
        stamps: list[float] = []
        with tempfile.TemporaryDirectory() as folder, timed_engines(spent):
            start = time.process_time()
            generate_observation(plan, Path(folder), cache, partial(_stamp, stamps))
            wholes.append(time.process_time() - start)
        loops.extend(b - a for a, b in pairwise(stamps))
        loop = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
        inside = {name: seconds / plan.camera.frames for name, seconds in spent.items()}
        overheads.append(loop / sum(inside.values()) - 1)
        for name, seconds in inside.items():
            engines[name].append(seconds)
    fixed = statistics.median(wholes) - statistics.median(loops) * plan.camera.frames
    all_in = statistics.median(loops) + fixed / 120
    pure = sum(statistics.median(values) for values in engines.values())
    return {
        "frame, encoded and on disk (CPU s)": statistics.median(loops),
        **{f"of it {name} (CPU s)": statistics.median(values) for name, values in sorted(engines.items())},
        "overhead of the loop over the sum of the engines (%)": 100 * statistics.median(overheads),
        "overhead over the sum of the engines (%)": 100 * (all_in / pure - 1),
        "once per observation (CPU s)": fixed,
        "frame of a 120-frame observation, all in (CPU s)": all_in,
    }


def scaling(
    source: ManifestFile, plans: tuple[ObservationPlan, ...], cache: Path, repeats: int = REPEATS
) -> dict[str, float]:
    """Frames per second (wall) of one and of two workers in their steady state, alternately, and their ratio."""
    ratios, one, two = [], [], []
    for _ in range(repeats):
        rates = []
        for workers in (1, 2):
            stamps: dict[str, list[float]] = defaultdict(list)
            with tempfile.TemporaryDirectory() as folder:

                def listen(event: Event, seen: dict[str, list[float]] = stamps) -> None:
                    if event.kind == "frame":
                        seen[event.name].append(time.perf_counter())

                run(source, plans, Path(folder) / "data", RunSettings(cache, workers), listen)
            # Measured only while all workers are rendering: start and end have little weight in a long run.
            if workers == 1:
                rates.append(statistics.median((len(s) - 1) / (s[-1] - s[0]) for s in stamps.values()))
            else:
                first, last = max(s[0] for s in stamps.values()), min(s[-1] for s in stamps.values())
                rates.append(sum(sum(first < t <= last for t in s) for s in stamps.values()) / (last - first))
        one.append(rates[0])
        two.append(rates[1])
        ratios.append(rates[1] / rates[0])
    return {
        "one worker (frames/s)": statistics.median(one),
        "two workers (frames/s)": statistics.median(two),
        "two workers over one": statistics.median(ratios),
    }


def peak_memory(frames: int = 8, repeats: int = REPEATS) -> dict[str, float]:
    """Peak resident memory of a process that makes one full-size observation, with ``frames`` frames."""
    code = (
        "from benchmarks.bench_pipeline import one_observation; from benchmarks.bench_scoring import peak_mb;"
        f"one_observation({frames}); print(peak_mb())"
    )
    peaks = [
        float(
            subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()[-1]
        )
        for _ in range(repeats)
    ]
    return {"peak memory of a worker (MB)": statistics.median(peaks)}


def one_observation(frames: int) -> None:
    """Make the demo's first observation at full size, and discard it."""
    plan = make_plans(read_manifest(MANIFEST), GenerateOptions(frames=frames, size=SIZE))[0]
    with tempfile.TemporaryDirectory() as folder:
        generate_observation(plan, Path(folder), default_cache())


def run_all(repeats: int = REPEATS) -> dict[str, float]:
    """Every figure of this file."""
    source = read_manifest(MANIFEST)
    plans = make_plans(source, GenerateOptions(frames=FRAMES, size=SIZE))
    cache = default_cache()
    prepare_home(plans[0], cache, workers=available_cores())
    per_frame(plans[0], cache, repeats=1)  # compiles and warms up
    return {
        **per_frame(plans[0], cache, repeats),
        **scaling(source, plans, cache, repeats),
        **peak_memory(repeats=repeats),
    }


__all__ = ["one_observation", "peak_memory", "per_frame", "run_all", "scaling"]
