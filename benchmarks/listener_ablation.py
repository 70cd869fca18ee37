"""What each random change of the training is worth, and more homes and voices: small networks, equal steps.

    python -m benchmarks.listener_ablation manifests DIR --recordings FOLDER
    avs3d generate DIR/NAME.yaml -o DATA/NAME --format webdataset …      # each of the manifests
    python -m benchmarks.listener_ablation decode DATA NAME …
    python -m benchmarks.listener_ablation train DATA -o WORK --picture-steps N --steps N
    python -m benchmarks.listener_ablation collect WORK -o docs/results/listener-ablation.json

``manifests`` writes ``all`` (the first homes of train.yaml), ``half`` and ``quarter`` (half of these homes, with so
many of the voices of each category, else alike), ``validation`` (marks-tune.yaml: other homes, voices for validation)
and ``recordings`` (the same with recordings in place of voices; only the categories of which FOLDER has some).
``train`` trains each of `ARMS` with three seeds, several networks at a time, and scores them on the last two sets. Each
result is a file, and what is there is not trained again. Runs that differ in changes of sounds alone share the steps
that learn from pictures alone: these are the same for all of them.

Of a network, over the frames of all walks (`scores`): strict IoU and false marks, whether the pixel that it is surest
of lies within 5° of what sounds, and whether the loudest category is right. Threshold and temperatures are chosen on
homes that the run keeps (`baselines.listener.calibration`).
"""

from __future__ import annotations

import json
import math
import multiprocessing
import shutil
import time
from collections.abc import Collection, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import numpy as np
import yaml

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_json
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.runtime.file_lock import wait_for_lock
from baselines.listener.batches import split_homes
from benchmarks.listener_seeds import cell
from benchmarks.listener_summary import MISSING

MANIFESTS = Path(__file__).parent.parent / "scenes_manifest"
#: Share of the voices of each category, by the name of the set of training data; all but the first have half the homes.
VOICES = {"all": 1.0, "half": 0.5, "quarter": 0.25}
#: Sets that networks are scored on.
TESTS = {"validation": "validation voices", "recordings": "other recordings"}
#: Figures of a set, see `scores`.
FIGURES = {"strict_IoU": "strict IoU", "direction": "direction", "category": "category"}
#: Of a folder of trainings: figures of each, and what they have in common.
RESULTS, PLAN = "results", "trainings.json"
#: How far from what sounds the surest pixel may lie (degrees).
NEAR_DEGREES = 5.0
#: Frames that go through a network at a time.
_BATCH = 16


@dataclass(frozen=True)
class Arm:
    """How a training differs from the usual one.

    Attributes:
        without: random changes that are left out.
        homes: share of the training homes.
        voices: name in `VOICES`.
    """

    without: tuple[str, ...] = ()
    homes: float = 1.0
    voices: str = "all"


_SOUNDS = {
    "disguise": ("disguise",), "eq": ("eq",), "band": ("band",), "gain, noise": ("gain", "noise"), "codec": ("codec",),
    "decay": ("decay",), "ears": ("ears",),
}  # fmt: skip
_PICTURES = ("blur", "colour", "grain", "jpeg")
#: Title in the docs → arm; in the order in which they are trained, as far as their data is there.
ARMS = {
    "nothing": Arm(),
    "all changes": Arm(without=tuple(sorted(sum(_SOUNDS.values(), _PICTURES)))),
    "colour, blur, grain, jpeg": Arm(without=_PICTURES),
    "half of the homes": Arm(homes=0.5),
    "half of the homes, half of the voices": Arm(voices="half"),
    "half of the homes, three quarters of the voices": Arm(voices="quarter"),
    "three quarters of the homes": Arm(homes=0.25),
    **{title: Arm(without=names) for title, names in _SOUNDS.items()},
}


@dataclass(frozen=True)
class Trainings:
    """What all trainings have in common.

    Attributes:
        data: folder with decoded sets, ``NAME-cache``.
        work: where results go.
        steps: of all, with the next.
        picture_steps: how many of them learn from pictures alone.
        batch: sounds of a batch.
        size: of the network.
        accelerator: cpu or cuda.
        precision: of the computation.
    """

    data: Path
    work: Path
    steps: int
    picture_steps: int
    batch: int
    size: str
    accelerator: str
    precision: str

    def result(self, title: str, seed: int) -> Path:
        """The file of an arm's figures with a seed."""
        return self.work / RESULTS / result_name(title, seed)


def result_name(title: str, seed: int) -> str:
    """Name of the file of an arm's figures with a seed."""
    return f"{title.replace(', ', '-').replace(' ', '-')}-{seed}.json"


def _decoded(name: str) -> str:
    return f"{name}-cache"


# ---- data


def half_of(homes: Sequence[str]) -> set[str]:
    """Homes of which a run learns from the same half as one that has all of them and takes half: ``Arm(homes=0.5)``."""
    kept = split_homes(homes)[1]
    half = split_homes(homes, _share(homes, 0.5))[0]
    with_some = (half.union(sorted(kept)[:count]) for count in range(1, len(kept) + 1))
    return next(each for each in with_some if split_homes(sorted(each))[0] == half)


def _share(homes: Sequence[str], share: float) -> int:
    """How many training homes are a share of all."""
    return max(1, round(share * len(split_homes(homes)[0])))


def training_manifest(document: dict[str, Any], homes: Collection[str], share: float) -> dict[str, Any]:
    """A manifest of some homes of another, with a share of the voices of each of the seven categories.

    Args:
        document: of `train.yaml`.
        homes: their names.
        share: of the voices, the first ones; at least one.
    """
    kept = {name: scan for name, scan in document["scans"].items() if name in homes}
    voices = {
        name: names[: max(1, round(share * len(names)))] if name in CATEGORIES else names
        for name, names in document["voices"].items()
    }
    chosen = [each for each in document["observations"] if _scan(each) in kept]
    return document | {"light": "preview", "scans": kept, "voices": voices, "observations": chosen}


def recorded_manifest(document: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A manifest's observations of the categories of which a folder has recordings, which are played there.

    Args:
        document: of a manifest with one source in each observation.
        folder: has a folder of sound files for each category.
    """
    licence = {"name": "none stated", "author": "see docs/sounds.md"}
    files = {name: sorted(path for path in (folder / name).glob("*") if path.is_file()) for name in CATEGORIES}
    sounds = {name: [{"file": str(path.resolve()), "licence": licence} for path in files[name]] for name in CATEGORIES}
    sounds = {name: found for name, found in sounds.items() if found}
    chosen = [each for each in document["observations"] if each["category"] in sounds]
    voices = {name: names for name, names in document["voices"].items() if name not in sounds}
    return document | {"sounds": sounds, "voices": voices, "observations": chosen}


def _scan(observation: dict[str, Any]) -> str:
    return str(observation["like"].split("/")[1] if "like" in observation else observation["scan"])


# ---- one training


def train_one(plan: Trainings, title: str, seed: int) -> None:
    """Train an arm with a seed, score it and write the file of its figures."""
    import torch

    from baselines.listener.batches import Sampler
    from baselines.listener.checkpoint import CHECKPOINT
    from baselines.listener.job import TrainingOptions, calibration_of, flushed, make_fabric
    from baselines.listener.steps import Schedule
    from baselines.listener.training import train

    began = time.monotonic()
    torch.set_float32_matmul_precision("high")
    torch.backends.cudnn.benchmark = True
    options = TrainingOptions(plan.data, plan.work, epochs=1, accelerator=plan.accelerator)
    fabric = make_fabric(options, plan.precision)
    fabric.launch()
    arm, store = ARMS[title], _store(plan.data, ARMS[title].voices)
    settings = _settings(plan, arm, seed, store.table.homes)
    schedule = Schedule(validate_every=10**9, checkpoint_minutes=math.inf)
    folder = plan.work / "runs" / plan.result(title, seed).stem
    # What decides the steps that learn from pictures alone.
    early = (arm.voices, arm.homes, *(name for name in arm.without if name in _PICTURES), seed)
    seen = plan.work / "pictures" / "-".join(map(str, early))
    with flushed():
        if settings.picture_steps:
            with wait_for_lock(seen / "lock"):
                if not (seen / CHECKPOINT).exists():
                    stopping = replace(schedule, stop_at=settings.picture_steps)
                    train(store, seen, settings, fabric=fabric, schedule=stopping)
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copy(seen / CHECKPOINT, folder / CHECKPOINT)
        result = train(store, folder, settings, fabric=fabric, schedule=schedule)
        calibration, _ = calibration_of(result, None, fabric)
    trained = time.monotonic() - began
    network = result.network.eval()
    torch.backends.cudnn.benchmark = False
    found = {name: scores(network, calibration, _store(plan.data, name), fabric.device) for name in TESTS}
    sampler = Sampler(store, 1, seed, homes=settings.homes)
    views = {*sampler.visible.tolist(), *sampler.empty.tolist()}
    count = sum(view in views for view in store.table.view)
    data = {"homes": len({store.table.homes[view] for view in views}), "pictures": len(views), "sounds": count}
    shutil.rmtree(folder)
    write_json(plan.result(title, seed), {
        "figures": found, "data": data, "threshold": calibration.threshold, "validation": result.validation,
        "seconds": [round(trained, 1), round(time.monotonic() - began - trained, 1)],
    })  # fmt: skip


def _settings(plan: Trainings, arm: Arm, seed: int, homes: list[str]) -> Any:
    from baselines.listener.checkpoint import Settings
    from baselines.listener.model import SIZES

    return Settings(
        steps=plan.steps, picture_steps=plan.picture_steps, batch=plan.batch, seed=seed, widths=SIZES[plan.size],
        without=arm.without, homes=None if arm.homes == 1 else _share(homes, arm.homes),
    )  # fmt: skip


def _store(data: Path, name: str) -> Any:
    from baselines.listener.shards import open_store

    store = open_store(data / _decoded(name))
    if store is None:
        raise Avs3dError(
            f"{data / _decoded(name)}: no decoded frames; run `listener_ablation decode {data} {name}` first"
        )
    return store


def scores(network: Any, calibration: Any, store: Any, device: Any) -> dict[str, float | None]:
    """Figures of a network on all frames of part_1 and part_2, one look at each, by the rules of prediction.

    Args:
        network: that predicts.
        calibration: its temperatures and threshold.
        store: decoded frames, one sound a picture.
        device: where the network is.

    Returns:
        ``strict_IoU`` and ``FP_rate``: of protocol ``strict``, means over observations; ``direction``: share of the
        frames that show what sounds in which the most probable pixel lies within `NEAR_DEGREES` of it; ``category``:
        share of the frames with one audible category in which it is the most probable one. None where there is no
        such frame.
    """
    import torch

    from baselines.listener.predict import ListenerMethod
    from evaluators.metrics.masks import frame_counts, mask_figures, mean

    method = ListenerMethod(
        network, device, "", calibration.threshold, looks="one", calibration=calibration, share=calibration.share
    )
    counts: dict[str, list[Any]] = {}
    near: list[float] = []
    named: list[float] = []
    numbers = np.arange(len(store.table.keys))
    for start in range(0, len(numbers), _BATCH):
        part = numbers[start : start + _BATCH]
        views = [store.table.view[sound] for sound in part]
        pictures = [store.pictures[view] for view in views]
        cameras = np.asarray([store.table.cameras[view] for view in views], np.float32)
        with torch.inference_mode():
            answers = method.answers(pictures, np.asarray(store.sounds[part], np.float32), cameras)
        for sound, picture, camera, answer in zip(part, pictures, cameras, answers, strict=True):
            truth = np.unpackbits(store.masks[sound], axis=-1)[:, : picture.shape[1]].astype(bool)
            key = store.table.keys[sound].rpartition("/")[0]
            counts.setdefault(key, []).append(frame_counts(truth, method.mask(answer, picture)))
            if truth.any():
                near.append(_error(truth, answer.mask, camera) <= NEAR_DEGREES)
            if len(store.table.audible[sound]) == 1:
                named.append(CATEGORIES[int(answer.audible.argmax())] == store.table.audible[sound][0])
    strict = [mask_figures(frames) for frames in counts.values()]

    def over(figure: str) -> float | None:
        return mean(value for each in strict if (value := each[figure]) is not None)

    found = {"strict_IoU": over("IoU"), "FP_rate": over("FP_rate"), "direction": mean(near), "category": mean(named)}
    return {name: None if value is None else round(value, 4) for name, value in found.items()}


def _error(truth: Any, odds: Any, camera: Any) -> float:
    """Degrees from the pixel with the largest log-odds to what sounds."""
    from evaluators.metrics import pointing

    height, width = truth.shape
    row, column = np.unravel_index(int(odds.argmax()), odds.shape)
    fx, fy, cx, cy = (float(share) for share in camera)
    view = Intrinsics(width, height, fx * width, fy * height, cx * width, cy * height)
    place = [[(column + 0.5) * width / odds.shape[1], (row + 0.5) * height / odds.shape[0]]]
    return pointing.error_to_mask(truth, pointing.from_pixels(place, view)[0], view)


# ---- all of them


def train_all(plan: Trainings, seeds: int, at_once: int, minutes: float) -> list[str]:
    """Train what has no result yet, as soon as its data is there; says what failed.

    Args:
        plan: of all trainings.
        seeds: how many.
        at_once: networks that are trained at a time.
        minutes: no training begins that is not expected to end by then.
    """
    began, longest, failed = time.monotonic(), 0.0, []
    (plan.work / RESULTS).mkdir(parents=True, exist_ok=True)
    write_json(plan.work / PLAN, {
        "steps": plan.steps, "picture_steps": plan.picture_steps, "batch": plan.batch, "size": plan.size,
    })  # fmt: skip
    left = [(title, seed) for title in ARMS for seed in range(seeds) if not plan.result(title, seed).exists()]
    running: dict[Future[None], tuple[str, int, float]] = {}
    with ProcessPoolExecutor(at_once, mp_context=multiprocessing.get_context("spawn")) as pool:
        while left or running:
            now = time.monotonic()
            if now - began + longest > 60 * minutes:
                left = []
            ready = [each for each in left if (plan.data / _decoded(ARMS[each[0]].voices)).exists()]
            for title, seed in ready[: at_once - len(running)]:
                left.remove((title, seed))
                running[pool.submit(train_one, plan, title, seed)] = (title, seed, now)
            done, _ = wait(running, timeout=1.0, return_when=FIRST_COMPLETED) if running else (set(), None)
            if not running:
                time.sleep(1.0)
            for future in done:
                title, seed, since = running.pop(future)
                longest = max(longest, time.monotonic() - since)
                if error := future.exception():
                    failed.append(f"{title}, seed {seed}: {type(error).__name__}: {error}")
                click.echo(f"{title}, seed {seed}: {error or json.dumps(read_json(plan.result(title, seed)))}")
    return failed


def collected(results: Path, seeds: int = 100) -> dict[str, Any]:
    """The figures of all arms: set → figure → mean and values of the seeds.

    ``change`` is that of strict IoU, against the same seeds with nothing left out.

    Args:
        results: folder with a file for each training.
        seeds: that may be there.
    """
    read = {
        title: {seed: read_json(path) for seed in range(seeds) if (path := results / result_name(title, seed)).exists()}
        for title in ARMS
    }
    usual = {seed: run["figures"] for seed, run in read["nothing"].items()}
    out: dict[str, Any] = {}
    for title, runs in read.items():
        for name in TESTS if runs else ():
            found = {seed: run["figures"][name] for seed, run in runs.items()}
            row = {figure: _over([one[figure] for one in found.values()]) for figure in (*FIGURES, "FP_rate")}
            pairs = [(found[seed]["strict_IoU"], usual[seed][name]["strict_IoU"]) for seed in found if seed in usual]
            row["change"] = _over([one - other for one, other in pairs if None not in (one, other)])
            out.setdefault(title, {"data": next(iter(runs.values()))["data"]})[name] = row
    return out


def _over(values: list[float | None]) -> dict[str, Any] | None:
    """As `benchmarks.listener_seeds.cell` takes it, without an interval; None without values."""
    known = [round(value, 4) for value in values if value is not None]
    return {"mean": round(fmean(known), 4), "values": known, "interval": None} if known else None


def table_rows(arms: dict[str, Any]) -> list[list[str]]:
    """Rows of the docs: what is left out, homes and sounds, and of each of `TESTS` the figures; homes and voices last.

    Args:
        arms: of `collected`.
    """
    known = [title for title in ARMS if title in arms]
    titles = sorted(known, key=lambda title: not ARMS[title].without and title != "nothing")
    return [
        [
            title,
            f"{arms[title]['data']['homes']}, {arms[title]['data']['sounds']:,}",
            *(text for name in TESTS for text in _cells(arms[title][name])),
        ]
        for title in titles
    ]


def _cells(row: dict[str, Any]) -> list[str]:
    """Strict IoU, its change, direction and category: mean, and the range over the seeds."""
    change = row.get("change")
    bounds = [change["mean"], min(change["values"]), max(change["values"])] if change else []
    signed = [f"{value:+.3f}".replace("0.", ".", 1).replace("-", "−") for value in bounds]
    moved = f"{signed[0]} ({signed[1]} to {signed[2]})" if signed else MISSING
    figures = [cell(row[name]) if row.get(name) else MISSING for name in FIGURES]
    return [figures[0], moved, *figures[1:]]


# ---- commands


@click.group()
def main() -> None:
    """What random changes, homes and voices are worth to the listener."""


@main.command("manifests")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--homes", type=click.IntRange(2), default=48, show_default=True, help="To train on and to choose thresholds by."
)
@click.option(
    "--recordings", type=click.Path(exists=True, path_type=Path), help="A folder of sounds for each category."
)
def write_manifests(folder: Path, homes: int, recordings: Path | None) -> None:
    """Write the manifests of the data."""
    folder.mkdir(parents=True, exist_ok=True)
    train = yaml.safe_load((MANIFESTS / "train.yaml").read_text())
    test = yaml.safe_load((MANIFESTS / "marks-tune.yaml").read_text())
    names = list(train["scans"])[:homes]
    made = {
        name: training_manifest(train, names if name == "all" else half_of(names), share)
        for name, share in VOICES.items()
    } | {"validation": test}
    if recordings is not None:
        made["recordings"] = recorded_manifest(test, recordings)
    for name, document in made.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(document, sort_keys=False))


@main.command()
@click.argument("data", type=click.Path(exists=True, path_type=Path))
@click.argument("names", nargs=-1, required=True)
@click.option("--workers", type=click.IntRange(1), help="Processes [one per core].")
def decode(data: Path, names: tuple[str, ...], workers: int | None) -> None:
    """Decode sets of shards in DATA, which all trainings share."""
    from baselines.listener.shards import read_store

    for name in names:
        table = read_store(data / name, data / _decoded(name), workers=workers).table
        click.echo(f"{name}: {len(set(table.homes))} homes, {len(table.groups)} pictures, {len(table.keys)} sounds")


@main.command("train")
@click.argument("data", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", "work", type=click.Path(path_type=Path), required=True)
@click.option("--steps", type=click.IntRange(1), required=True, help="Of all, with those of --picture-steps.")
@click.option("--picture-steps", type=click.IntRange(0), default=0, show_default=True)
@click.option("--batch-size", "batch", type=click.IntRange(4), default=128, show_default=True, help="Sounds.")
@click.option("--size", default="small", show_default=True, help="Of the network.")
@click.option("--accelerator", type=click.Choice(["cpu", "cuda"]), default="cuda", show_default=True)
@click.option("--seeds", type=click.IntRange(1), default=3, show_default=True)
@click.option("--at-once", type=click.IntRange(1), default=6, show_default=True, help="Networks at a time.")
@click.option("--minutes", type=float, default=60.0, show_default=True, help="Begin nothing that would end later.")
def train_command(seeds: int, at_once: int, minutes: float, **chosen: Any) -> None:
    """Train and score what has no result yet."""
    precision = "bf16-mixed" if chosen["accelerator"] == "cuda" else "32-true"
    if failed := train_all(Trainings(**chosen, precision=precision), seeds, at_once, minutes):
        raise Avs3dError("; ".join(failed))


@main.command()
@click.argument("work", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def collect(work: Path, output: Path) -> None:
    """Write the figures of all trainings that have a result, and print them as a table."""
    plan = read_json(work / PLAN)
    arms = collected(work / RESULTS)
    write_json(output, {"trainings": plan, "arms": arms})
    for cells in table_rows(arms):
        click.echo(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
