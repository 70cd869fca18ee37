"""CPU time of a frame in this version of the project over that of another checkout, on one machine at one time.

    git worktree add /tmp/before 0f2adc6
    python -m benchmarks.frame_time --against /tmp/before --json docs/results/frame-time.json

Each round measures both with their own `benchmarks.bench_vision`, one after the other, each in its own process; the
figures are medians over the rounds. CPU time also depends on what else the processor does; rounds in turn share that.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

import click

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_bytes

HERE = Path(__file__).resolve().parents[1]
#: Largest ratio of the CPU time of a frame that is aimed at.
AIM = 1.6
#: The figure that is aimed at, as `benchmarks.bench_vision.run_all` names it.
FRAME = "RGB + ids + depth, 1008² (CPU s)"
_PROGRAM = "import json; from benchmarks.bench_vision import run_all; print(json.dumps(run_all({repeats})))"


def _search_path(checkout: Path) -> str:
    """``PYTHONPATH`` of a checkout: its root, then what this process has of packages, but for its own checkout."""
    others = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    return os.pathsep.join([str(checkout), *(entry for entry in others if Path(entry).resolve() != HERE)])


def measure(checkout: Path, repeats: int) -> dict[str, float]:
    """The figures of one checkout, with the packages of this process.

    Raises:
        Avs3dError: if it cannot be measured.
    """
    environment = os.environ | {"PYTHONPATH": _search_path(checkout), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM.format(repeats=repeats)],
        cwd=checkout, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip() or "no message").splitlines()[-1]
        raise Avs3dError(f"{checkout}: {last}; expected a checkout of this project whose benchmarks run")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def compared(before: list[dict[str, float]], now: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Figure → its median before and now, and their ratio; of the figures that both versions have."""
    found = {}
    for name in [name for name in now[0] if name in before[0]]:
        old, new = median(one[name] for one in before), median(one[name] for one in now)
        found[name] = {"before": old, "now": new, "ratio": new / old}
    return found


@click.command()
@click.option("--against", type=click.Path(exists=True, path_type=Path), required=True, help="The other checkout.")
@click.option("--rounds", type=click.IntRange(1), default=3, show_default=True)
@click.option("--repeats", type=click.IntRange(1), default=5, show_default=True, help="Frames of each view.")
@click.option("--json", "record", type=click.Path(path_type=Path), help="Also write the figures here.")
def main(against: Path, rounds: int, repeats: int, record: Path | None) -> None:
    """Measure this checkout and the one at AGAINST in turn."""
    try:
        pairs = [(measure(against.resolve(), repeats), measure(HERE, repeats)) for _ in range(rounds)]
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    found = compared([before for before, _ in pairs], [now for _, now in pairs])
    for name, one in found.items():
        click.echo(f"{name}: {one['before']:.4g} → {one['now']:.4g}, × {one['ratio']:.2f}")
    click.echo(f"aim: × {AIM} of the frame: {'met' if found[FRAME]['ratio'] <= AIM else 'MISSED'}")
    if record is not None:
        write_bytes(record, (json.dumps({"rounds": rounds, "figures": found}, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
