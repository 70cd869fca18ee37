"""Does picture quality change which method wins? The same observations with baked and with path-traced pictures.

    python -m benchmarks.pictures_who_wins -o build/who-wins --json docs/results/pictures-who-wins.json

Makes both datasets (walks, sounds and masks are the same), runs the listener in 2D and, if ``--iterations`` is above 0,
EchoSegnet `official` and `spatial` on the listener's masks (`benchmarks.listener_tables`), and compares the strict IoU
of each observation: path traced less baked for each method, and method less method on each kind of picture. The last
rows answer the question: by how much the lead of one method over another changes with the pictures. What is there
already is kept. On a CPU: few frames, 252², few paths (`--samples`); with GPUs, all of which train: ``--device cuda
--size 504 --frames 60 --samples 128 --iterations 1500 --max-gaussians 300000``.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import click
import numpy as np

from avs3d_bench.contract.layout import parse_key
from avs3d_bench.contract.scores import Scores
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.formats.media import read_record
from evaluators.statistics.bootstrap import difference_interval, homes_note
from evaluators.statistics.sign_flips import sign_flip_p_values

MANIFEST = Path(__file__).parents[1] / "scenes_manifest" / "open-s34-o7.yaml"
#: Three observations of each home, of all categories; half of them have twins.
OBSERVATIONS = (
    "part_1/apartment_1/bathroom/1", "part_2/apartment_1/kitchen/1", "part_2/apartment_1/living_room/1",
    "part_1/apartment_2/living_room/1", "part_2/apartment_2/kitchen/1", "part_2/apartment_2/living_room/1",
    "part_1/apartment_3/kitchen/2", "part_2/apartment_3/bathroom/1", "part_1/apartment_3/living_room/2",
    "part_1/apartment_4/bathroom/1", "part_1/apartment_4/kitchen/2", "part_2/apartment_4/kitchen/1",
)  # fmt: skip
#: Label of a dataset → its renderer; None: that of the device.
PICTURES = {"baked": None, "pathtraced": "pathtraced"}
METHODS = {"2d": "listener, 2D", "official": "EchoSegnet official", "spatial": "EchoSegnet spatial"}
#: Method → observation → strict IoU.
Table = Mapping[str, Mapping[str, float]]


def generate_here(root: Path, vision: Any, samples: int, **options: Any) -> None:
    """Generate observations in this process, so that the number of paths can be chosen; finished ones are kept."""
    from generators.core.folders import default_cache
    from generators.observation.generate import generate_observation
    from generators.options import GenerateOptions
    from generators.plan import make_plans, read_manifest
    from generators.vision import pathtraced

    chosen = GenerateOptions(vision=vision, audio="tracer", **options)
    for plan in make_plans(read_manifest(MANIFEST), chosen):
        if (root / plan.key / "observation.json").exists():
            continue
        started = time.process_time()
        with patch.object(pathtraced, "SAMPLES", samples):
            generate_observation(plan, root, default_cache())
        click.echo(f"{root.name}/{plan.key}: {time.process_time() - started:.0f} s CPU", err=True)


def generate_all(roots: Sequence[Path], samples: int, only: Sequence[str], workers: int, **options: Any) -> None:
    """Generate the observations ``only`` of all datasets, ``workers`` of them at the same time.

    Raises:
        Avs3dError: if one of them fails.
    """
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = [
            pool.submit(generate_here, root, PICTURES[root.name], samples, only=(key,), device="cpu", **options)
            for root in roots
            for key in only
        ]
        for job in jobs:
            job.result()


def score(
    roots: Sequence[Path], scores: Path, *, device: str, trainings: int, iterations: int, most: int | None
) -> None:
    """Run and score the methods on the datasets, with at most ``most`` Gaussians, ``trainings`` at a time on a GPU.

    Raises:
        Avs3dError: if one of them fails.
    """
    command = [sys.executable, "-m", "benchmarks.listener_tables", *map(str, roots), "-o", str(scores), "--rows", "2d"]
    command += ["--work", str(scores / "work"), "--iterations", str(max(iterations, 1))]
    from baselines.echosegnet.jobs import all_devices

    for name in ("cpu",) if device == "cpu" else all_devices() * trainings:
        command += ["--device", name]
    command += ["--max-gaussians", str(most)] if most else []
    command += ["--rows", "official", "--rows", "spatial"] if iterations else []
    if subprocess.run(command, check=False).returncode:
        raise Avs3dError(f"{' '.join(command[1:3])}: failed; see the lines above")


def read_iou(path: Path) -> dict[str, float]:
    """Observation → strict IoU, of a file of scores; those without one are left out."""
    found = {one.key: one.strict.IoU for one in read_record(path, Scores).observations if one.strict is not None}
    return {key: value for key, value in found.items() if value is not None}


def difference(values: Mapping[str, float]) -> dict[str, Any]:
    """Mean of paired differences, its 95 % interval (homes resampled, then observations), and the sign-flip p-value."""
    keys = sorted(values)
    homes = [parse_key(key).scan for key in keys]
    found = difference_interval([[values[key]] for key in keys], homes=homes)
    return {
        "mean": float(np.mean([values[key] for key in keys])),
        "interval": None if found is None else [found.low, found.high],
        "p": float(sign_flip_p_values(np.array([[values[key]] for key in keys]))[0]),
        "observations": len(keys),
    }


def less(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """First less second, of the observations that both have."""
    return {key: first[key] - second[key] for key in first if key in second}


def comparisons(tables: Mapping[str, Table]) -> dict[str, dict[str, Any]]:
    """Title → `difference`: of pictures for each method, of methods for each kind of pictures, and of these leads.

    Args:
        tables: kind of pictures (`PICTURES`) → its scores, of the same methods.
    """
    baked, traced = (tables[name] for name in PICTURES)
    found = {f"{METHODS[name]}: path traced less baked": less(traced[name], baked[name]) for name in baked}
    for one, other in itertools.combinations(baked, 2):
        leads = {kind: less(table[other], table[one]) for kind, table in tables.items()}
        title = f"{METHODS[other]} less {METHODS[one]}"
        found |= {f"{title}, {kind}": values for kind, values in leads.items()}
        found[f"change of ({title})"] = less(leads["pathtraced"], leads["baked"])
    return {title: difference(values) for title, values in found.items()}


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of datasets and scores.")
@click.option("--json", "record", type=click.Path(path_type=Path), required=True, help="File of the figures.")
@click.option("--size", default=252, show_default=True, help="Side of the pictures (pixels).")
@click.option("--frames", default=17, show_default=True, help="Of each observation; every eighth is a test frame.")
@click.option("--samples", default=8, show_default=True, help="Paths per pixel.")
@click.option("--iterations", default=0, show_default=True, help="Of EchoSegnet's training; 0: without EchoSegnet.")
@click.option("--max-gaussians", "most", type=int, default=None, help="Cap on the number of Gaussians [none].")
@click.option("--device", type=click.Choice(["cpu", "cuda"]), default="cpu", show_default=True)
@click.option("--workers", default=1, show_default=True, help="Observations that are generated at the same time.")
@click.option("--trainings", default=1, show_default=True, help="Of EchoSegnet at the same time on each GPU.")
@click.option("--only", multiple=True, default=OBSERVATIONS, help="Keys of other observations; repeatable [twelve].")
def main(
    output: Path,
    record: Path,
    size: int,
    frames: int,
    samples: int,
    iterations: int,
    most: int | None,
    device: Any,
    workers: int,
    trainings: int,
    only: Any,
) -> None:
    """Generate, score and compare."""
    roots = [output / name for name in PICTURES]
    try:
        generate_all(roots, samples, only, workers, size=size, frames=frames)
        score(roots, output / "scores", device=device, trainings=trainings, iterations=iterations, most=most)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    methods = list(METHODS) if iterations else ["2d"]
    tables = {
        kind: {name: read_iou(output / "scores" / f"listener-{kind}-{name}.json") for name in methods}
        for kind in PICTURES
    }
    found = comparisons(tables)
    figures = {
        "settings": {
            "size": size, "frames": frames, "samples": samples, "iterations": iterations, "max_gaussians": most,
            "device": device,
            "note": homes_note([parse_key(key).scan for key in tables["baked"]["2d"]]),
        },
        "strict IoU": tables,
        "differences": found,
    }  # fmt: skip
    write_bytes(record, (json.dumps(figures, indent=1) + "\n").encode())
    for title, one in found.items():
        span = "–" if one["interval"] is None else "{:+.3f} to {:+.3f}".format(*one["interval"])
        click.echo(f"| {title} | {one['mean']:+.3f} | {span} | {one['p']:.3f} | {one['observations']} |")


if __name__ == "__main__":
    main()
