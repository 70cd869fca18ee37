"""`make bench`: measures all figures of speed and memory that this project states, as a table and as JSON."""

from __future__ import annotations

import json
import os
import platform
from importlib import import_module
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from avs3d_bench.runtime.one_thread import ONE_THREAD

for _variable, _value in ONE_THREAD.items():
    os.environ.setdefault(_variable, _value)

#: Figure → (at most, at least): the project's targets on a core of about 2.1 GHz.
TARGETS: dict[str, tuple[float | None, float | None]] = {
    "RGB + ids + depth, 1008² (CPU s)": (0.58, None),  # 1.6 times that of 3.1.0, 0.36 s on such a core
    "RGB + ids + depth, 1008², on CUDA (s)": (0.01, None),
    "impulse response (CPU s)": (0.15, None),
    "broadband level, SD over draws (dB)": (0.2, None),
    "frame of a 120-frame observation, all in (CPU s)": (0.8, None),
    "overhead over the sum of the engines (%)": (15.0, None),
    "two workers over one": (None, 1.8),
    "peak memory of a worker (MB)": (1536.0, None),
    "pictures of a sibling over rendering them (%)": (5.0, None),
    "scoring over decoding, 1 process": (1.75, None),  # 0.24 of it: the submission's masks are inflated once more
    "scoring over decoding, 2 processes": (1.75, None),
    "scoring with --frames over decoding, 1 process": (1.75, None),
    "scoring with --frames over decoding, 2 processes": (1.75, None),
    "table of frames over scoring (% of CPU time)": (5.0, None),
    "peak memory of scoring, 34 observations (MB)": (300.0, None),
    "lifting + decomposition + AISRM, 300k × 105 (s)": (90.0, None),
    "listener, frame of 1008² (CPU s)": (2.0, None),  # 1 s on two cores
    "client and Dask's scheduler per no-op observation, of 10⁴ (CPU ms)": (5.0, None),
    "two Dask workers over one": (None, 1.8),
    "DataLoader over bare decoding, 2 workers": (None, 0.8),
    "avs3d --help (CPU s)": (0.5, None),
    "avs3d-eval --help (CPU s)": (0.5, None),
    "import generators.acoustics, over Python alone (CPU s)": (0.3, None),
}
#: Each is `bench_<name>.py`.
SUITES = (
    "vision", "acoustics", "pipeline", "siblings", "scoring", "lifting", "listener", "cluster", "loading", "start",
)  # fmt: skip


@click.command()
@click.option("--json", "output", type=click.Path(path_type=Path), default=Path("build/bench.json"), show_default=True)
@click.option("--repeats", type=click.IntRange(5), default=5, show_default=True, help="Number of runs for each median.")
@click.option("--only", type=click.Choice(SUITES), default=None)
def main(output: Path, repeats: int, only: str | None) -> None:
    """Measure, print medians, and write them as JSON."""
    table = Table(
        "what", "median", "target", title=f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    )
    figures: dict[str, dict[str, float]] = {}
    for name in SUITES:
        if only in (None, name):
            figures[name] = import_module(f"benchmarks.bench_{name}").run_all(repeats=repeats)
            table.add_section()
            for what, value in figures[name].items():
                most, least = TARGETS.get(what, (None, None))
                met = (most is None or value <= most) and (least is None or value >= least)
                target = f"≤ {most:g}" if most is not None else f"≥ {least:g}" if least is not None else ""
                table.add_row(what, f"{value:.3g}", f"{target} {'met' if met else 'MISSED'}" if target else "")
    Console(width=110).print(table)
    from avs3d_bench.formats.files import write_bytes  # numpy must not be imported before the settings above

    write_bytes(output, (json.dumps({"repeats": repeats, "figures": figures}, indent=1) + "\n").encode())
    print(output)


if __name__ == "__main__":
    main()
