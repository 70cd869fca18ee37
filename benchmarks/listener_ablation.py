"""What each random change of the training is worth, and more homes and voices: small networks, equal steps.

    python -m benchmarks.listener_ablation decode DATA train tune     # the shards in DATA/train: DATA/train-cache, …
    python -m benchmarks.listener_ablation train DATA/train DATA/train-cache -o WORK --test NAME=CACHE … --minutes 13
    python -m benchmarks.listener_ablation collect WORK -o docs/results/listener-ablation.json

``train`` uses every n-th frame of the training data. It trains each of `ARMS` with some seeds, several networks at a
time on one device, seed by seed. It measures how fast they are and chooses so many steps, the same for all, that all
end in time. Each result is a file at once, and what is there is not trained again. Arms that see the same pictures
share the steps that learn from pictures alone.

Arms of voices learn from the observations all of whose sounds are among a share of the voices of each category, drawn
anew for each seed; beside each is one of as many observations of each kind with all voices.

`benchmarks.ablation_tables` has the tables of the docs and the picture of the learning curves.

Scored are the homes that training keeps, half of which choose the threshold, and the sets of ``--test``. Figures are
means over frames, see `figures_of`.
"""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import shutil
import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.observation_tar import read_head
from avs3d_bench.exports.shard_files import list_shards
from avs3d_bench.formats.files import read_json, write_json
from avs3d_bench.runtime.parallel import process_each
from baselines.listener.batches import split_homes
from baselines.listener.shards import SIDE, ShardStore, ShardTable, open_store, read_store

#: Figures of a set, see `figures_of`.
FIGURES = {"strict_IoU": "strict IoU", "FP_rate": "FP rate", "direction": "direction", "category": "category"}
#: The set of the homes that training keeps.
KEPT = "other homes"
#: In the work folder: figures of each training; what they have in common; sounds of each observation; all results.
RESULTS, PLAN, VOICES, COLLECTED = "results", "trainings.json", "voices.json", "listener-ablation.json"
#: How far from what sounds the surest pixel may lie (degrees).
NEAR_DEGREES = 5.0
#: Most frames of a set that are scored, and how many go through a network at a time.
MOST_FRAMES, _BATCH = 512, 32
#: Steps with pictures alone for each with sounds.
PICTURE_SHARE = 1.5
#: Steps before the rate is measured, and over which it is.
TIMED = (20, 60)
#: Share of the time that is planned for, and what a training takes besides its steps (s).
PLANNED, BESIDES = 0.8, 10.0


@dataclass(frozen=True)
class Arm:
    """How a training differs from the usual one.

    Attributes:
        without: random changes that are left out.
        homes: share of the training homes.
        voices: share of the voices of each category.
        every_voice: learn from as many observations as with that share of the voices, but with all voices.
    """

    without: tuple[str, ...] = ()
    homes: float = 1.0
    voices: float = 1.0
    every_voice: bool = False


_SOUNDS = ("disguise", "eq", "band", "gain", "noise", "codec", "decay", "ears", "timing")
_PICTURES = ("clutter", "blur", "colour", "grain", "jpeg")
#: Title in the docs → arm, in the order in which they are trained.
ARMS = {
    "nothing": Arm(),
    "all changes": Arm(without=tuple(sorted((*_SOUNDS, *_PICTURES)))),
    "half of the homes": Arm(homes=0.5),
    "three quarters of the homes": Arm(homes=0.25),
    "half of the voices": Arm(voices=0.5),
    "as many sounds as with half of the voices": Arm(voices=0.5, every_voice=True),
    "three quarters of the voices": Arm(voices=0.25),
    "as many sounds as with a quarter of the voices": Arm(voices=0.25, every_voice=True),
    **{name: Arm(without=(name,)) for name in (*_SOUNDS, *_PICTURES)},
}


def beginning_of(title: str) -> str:
    """The first arm that sees the same pictures as another: both share the steps that learn from pictures alone."""

    def seen(arm: Arm) -> Any:
        return arm.homes, set(arm.without) & set(_PICTURES)

    return next(each for each in ARMS if seen(ARMS[each]) == seen(ARMS[title]))


def compared_with(title: str) -> str:
    """The arm that another is compared with: with nothing left out; of few voices, that of as many sounds."""
    arm = ARMS[title]
    few = arm.voices < 1 and not arm.every_voice
    return next(each for each in ARMS if ARMS[each] == replace(arm, every_voice=True)) if few else "nothing"


@dataclass(frozen=True)
class Trainings:
    """What all trainings have in common.

    Attributes:
        cache: decoded frames to train on.
        tests: name → decoded frames to score.
        work: where results go.
        frames: most sounds of the training data that are used.
        batch: sounds of a batch.
        size: of the network.
        accelerator: cpu or cuda.
        picture_steps: that learn from pictures alone, the first ones.
        sound_steps: that follow.
        arms: titles of `ARMS` that are trained.
    """

    cache: Path
    tests: dict[str, Path]
    work: Path
    frames: int
    batch: int
    size: str
    accelerator: str
    picture_steps: int = 0
    sound_steps: int = 0
    arms: tuple[str, ...] = tuple(ARMS)

    def result(self, title: str, seed: int) -> Path:
        """The file of an arm's figures with a seed."""
        return self.work / RESULTS / f"{_name(title, seed)}.json"

    def beginning(self, title: str, seed: int) -> Path:
        """The folder of the steps of an arm that learn from pictures alone."""
        return self.work / "pictures" / _name(beginning_of(title), seed)


def _name(title: str, seed: int) -> str:
    return f"{title.replace(' ', '-')}-{seed}"


# ---- data


def voices_of(shards: Path) -> dict[str, list[tuple[str, str]]]:
    """Key of an observation → category and voice of each of its sources, from shards of `avs3d generate`."""
    paths = [shard.path for shard in list_shards(shards) if shard.path.name.startswith("test-")]  # each has one
    heads = (head for _, (head, _) in process_each(read_head, paths))
    return {head.key: [(source.category, source.asset) for source in head.sound_sources] for head in heads}


def thinned(table: ShardTable, most: int) -> NDArray[np.int64]:
    """Sounds of every n-th frame of all observations, at most so many; siblings have the same frames."""
    frames = np.asarray([int(key.rpartition("_")[2]) for key in table.keys])
    every = next(n for n in range(1, len(frames) + 2) if (frames % n == 0).sum() <= most or n > frames.max())
    return np.flatnonzero(frames % every == 0)


def part_of(store: ShardStore, sounds: Iterable[int]) -> ShardStore:
    """Some of the sounds of a store, with their pictures, in memory; its digest is that of the whole store."""
    kept = np.asarray(list(sounds), np.int64)
    views, view = np.unique(np.asarray(store.table.view, np.int64)[kept], return_inverse=True)
    of_sounds, of_views = (
        ("keys", "audible", "others", "lateral", "has_response"),
        ("groups", "homes", "cameras", "present"),
    )
    chosen: dict[str, Any] = {name: [getattr(store.table, name)[n] for n in kept] for name in of_sounds}
    chosen |= {name: [getattr(store.table, name)[n] for n in views] for name in of_views}
    table = replace(store.table, view=view.tolist(), **chosen)
    arrays = {name: getattr(store, name)[kept] for name in ("sounds", "coded", "masks", "marked")}
    arrays["responses"] = store.responses[kept] if len(store.responses) else store.responses
    arrays |= {name: getattr(store, name)[views] for name in ("pictures", "classes", "extents")}
    return ShardStore(table, **arrays, dry=store.dry)


def with_voices(played: Mapping[str, Sequence[tuple[str, str]]], arm: Arm, seed: int) -> set[str]:
    """The observations that an arm of voices learns from.

    Voices of no class are not what is learnt: all of them are taken.

    Args:
        played: of `voices_of`.
        arm: which share of the voices.
        seed: of the choice.
    """

    def place(*names: str) -> str:
        return hashlib.sha256("/".join((str(seed), *names)).encode()).hexdigest()

    named: dict[str, set[str]] = defaultdict(set)
    for category, voice in (each for sounds in played.values() for each in sounds):
        named[category].add(voice)
    chosen: set[str] = set()
    for category, voices in named.items():
        ranked = sorted(voices, key=lambda voice: place(category, voice))
        chosen |= set(ranked[: max(1, round(arm.voices * len(ranked)))] if category in CATEGORIES else ranked)
    inside = {key for key, sounds in played.items() if all(voice in chosen for _, voice in sounds)}
    if not arm.every_voice:
        return inside
    # As many of each combination of categories.
    kinds: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for key, sounds in played.items():
        kinds[tuple(sorted(category for category, _ in sounds))].append(key)
    ranked_keys = (sorted(keys, key=place)[: len(inside.intersection(keys))] for keys in kinds.values())
    return {key for keys in ranked_keys for key in keys}


# ---- one process


class Trainer:
    """A process that trains one network after the other; the data stay on its device.

    Args:
        plan: of all trainings; without steps it can be timed alone.
    """

    def __init__(self, plan: Trainings) -> None:
        import torch

        from baselines.listener.augment import Bank
        from baselines.listener.job import make_fabric

        torch.set_num_threads(1)
        torch.set_float32_matmul_precision("high")
        torch.backends.cudnn.benchmark = True
        self.plan = plan
        self.fabric = make_fabric(plan.accelerator, "bf16-mixed" if plan.accelerator == "cuda" else "32-true")
        store = _opened(plan.cache)
        self.store = part_of(store, thinned(store.table, plan.frames))
        self.bank = Bank(self.store, self.fabric.device)
        self.training = len(split_homes(self.store.table.homes)[0])
        table, homes = self.store.table, sorted(split_homes(self.store.table.homes)[1])
        choosing, scored = ([n for n, v in enumerate(table.view) if table.homes[v] in half]
                            for half in (homes[::2], homes[1::2] or homes))  # fmt: skip
        self.choosing = self.bank, table, _spread(choosing)
        self.tests: dict[str, tuple[Any, ShardTable, NDArray[np.int64]]] = {KEPT: (self.bank, table, _spread(scored))}
        for name, folder in plan.tests.items():
            test = _opened(folder)
            test = part_of(test, _spread(range(len(test.table.keys))))
            self.tests[name] = Bank(test, self.fabric.device), test.table, np.arange(len(test.table.keys))

    def seconds(self) -> tuple[float, float]:
        """Seconds of a step with pictures alone, and of one with sounds."""
        warm, timed = TIMED
        settings = replace(self._settings("nothing", 0), picture_steps=warm + timed, steps=3 * (warm + timed))
        folder = self.plan.work / "runs" / f"timed-{multiprocessing.current_process().pid}"
        found = []
        for start in (0, warm + timed):
            self._train(folder, settings, stop_at=start + warm)
            began = time.monotonic()
            self._train(folder, settings, stop_at=start + warm + timed)
            found.append((time.monotonic() - began) / timed)
        shutil.rmtree(folder)
        return found[0], found[1]

    def look(self, title: str, seed: int) -> None:
        """Take the steps of an arm that learn from pictures alone."""
        settings = replace(self._settings(title, seed), without=tuple(sorted({*ARMS[title].without} & {*_PICTURES})))
        self._train(self.plan.beginning(title, seed), settings, stop_at=settings.picture_steps)

    def listen(self, title: str, seed: int) -> None:
        """Take the other steps of an arm, score the network and write the file of its figures."""
        from baselines.listener.augment import Bank
        from baselines.listener.checkpoint import CHECKPOINT

        began, arm = time.monotonic(), ARMS[title]
        folder = self.plan.work / "runs" / _name(title, seed)
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.plan.beginning(title, seed) / CHECKPOINT, folder / CHECKPOINT)
        store, bank = self.store, self.bank
        if arm.voices < 1:
            keys = with_voices(read_json(self.plan.work / VOICES), arm, seed)
            store = part_of(store, self._of(keys))
            bank = Bank(store, self.fabric.device)
        settings = self._settings(title, seed)
        result = self._train(folder, settings, store=store, bank=bank)
        shutil.rmtree(folder)
        network = result.network.eval()
        rule = rule_for(self._looked(network, *self.choosing))
        found = {name: figures_of(self._looked(network, *test), *rule) for name, test in self.tests.items()}
        homes = split_homes(store.table.homes, settings.homes)[0]
        views = {number for number, home in enumerate(store.table.homes) if home in homes}
        data = {"homes": len(homes), "pictures": len(views), "sounds": sum(view in views for view in store.table.view)}
        write_json(self.plan.result(title, seed), {
            "figures": found, "data": data, "rule": rule, "seconds": round(time.monotonic() - began, 1),
        })  # fmt: skip

    def _of(self, keys: set[str]) -> list[int]:
        """The sounds of observations in the training homes; of fewer homes, others would be kept."""
        table, training = self.store.table, split_homes(self.store.table.homes)[0]
        every = enumerate(zip(table.keys, table.view, strict=True))
        return [n for n, (key, view) in every if key.rpartition("/")[0] in keys and table.homes[view] in training]

    def _settings(self, title: str, seed: int) -> Any:
        from baselines.listener.checkpoint import Settings
        from baselines.listener.model import SIZES

        plan, arm = self.plan, ARMS[title]
        return Settings(
            steps=plan.picture_steps + max(1, plan.sound_steps), picture_steps=plan.picture_steps, batch=plan.batch,
            seed=seed, widths=SIZES[plan.size], without=arm.without,
            homes=None if arm.homes == 1 else max(1, round(arm.homes * self.training)),
        )  # fmt: skip

    def _train(
        self, folder: Path, settings: Any, stop_at: int | None = None, store: Any = None, bank: Any = None
    ) -> Any:
        from baselines.listener.job import flushed
        from baselines.listener.steps import Schedule
        from baselines.listener.training import train

        schedule = Schedule(stop_at=stop_at, validate_every=0, checkpoint_minutes=math.inf)
        with flushed():
            return train(store or self.store, folder, settings, fabric=self.fabric, schedule=schedule,
                         bank=bank or self.bank)  # fmt: skip

    def _looked(self, network: Any, bank: Any, table: ShardTable, numbers: NDArray[np.int64]) -> ScoredFrames:
        return look_at(network, bank, table, numbers, self.fabric)


def _opened(folder: Path) -> ShardStore:
    store = open_store(folder)
    if store is None:
        raise Avs3dError(f"{folder}: no decoded frames; expected a folder of `avs3d train listener --cache`")
    return store


def _spread(numbers: Sequence[int]) -> NDArray[np.int64]:
    """At most `MOST_FRAMES` of them, evenly."""
    from baselines.listener.validation import spread

    return np.asarray(spread(numbers, MOST_FRAMES), np.int64)


# ---- scores


@dataclass(frozen=True)
class ScoredFrames:
    """Of N frames, what `figures_of` needs.

    Attributes:
        peak: (N,) of `calibration.peaks_and_ious`.
        iou: (N, shares) of the same.
        shown: (N,) whether something that sounds is in view.
        near: (N,) whether the surest pixel is near it.
        single: (N,) whether a single category is audible, and nothing of no class.
        named: (N,) whether the loudest category is an audible one.
    """

    peak: NDArray[np.float64]
    iou: NDArray[np.float64]
    shown: NDArray[np.bool_]
    near: NDArray[np.bool_]
    single: NDArray[np.bool_]
    named: NDArray[np.bool_]


def look_at(network: Any, bank: Any, table: ShardTable, numbers: NDArray[np.int64], fabric: Any) -> ScoredFrames:
    """One look of a network at frames, as they are.

    Args:
        network: a `Listener` that does not learn.
        bank: of decoded frames.
        table: of the same.
        numbers: of the sounds.
        fabric: a launched `lightning.fabric.Fabric`.
    """
    import torch

    from baselines.listener.calibration import peaks_and_ious
    from baselines.listener.losses import full_size
    from baselines.listener.model import hear
    from baselines.listener.validation import own_plan

    found = []
    with torch.inference_mode():
        for start in range(0, len(numbers), _BATCH):
            these = numbers[start : start + _BATCH]
            batch = bank.gather(own_plan(table, [table.view[n] for n in these], these.tolist()), None)
            with fabric.autocast():
                output = network(batch.pictures, hear(batch.sounds, batch.cameras, (SIDE, SIDE)))
            truth, odds = batch.masks, full_size(output.mask[:, None], (SIDE, SIDE))[:, 0]
            heard = batch.audible[:, : len(CATEGORIES)]
            loudest = output.audible[:, : len(CATEGORIES)].argmax(dim=1, keepdim=True)
            flags = (
                truth.flatten(1).any(dim=1), surest_is_near(odds, batch),
                batch.audible.sum(dim=1).eq(1) & heard.any(dim=1), heard.gather(1, loudest)[:, 0] > 0,
            )  # fmt: skip
            masks = peaks_and_ious(odds.float().cpu().numpy(), truth.cpu().numpy())
            found.append((*masks, *(each.cpu().numpy() for each in flags)))
    return ScoredFrames(*map(np.concatenate, zip(*found, strict=True)))


def surest_is_near(odds: Any, batch: Any) -> Any:
    """(B,) whether the pixel with the largest of the (B, H, W) log-odds lies within `NEAR_DEGREES` of what sounds."""
    import torch

    height, width = odds.shape[1:]
    fx, fy, cx, cy = batch.cameras.T[..., None, None]
    across = ((torch.arange(width, device=odds.device) + 0.5) / width - cx) / fx
    down = ((torch.arange(height, device=odds.device)[:, None] + 0.5) / height - cy) / fy
    each = (across.expand_as(odds), down.expand_as(odds), torch.ones_like(odds))
    rays = torch.stack(each, dim=-1).flatten(1, 2)
    rays = rays / rays.norm(dim=-1, keepdim=True)
    surest = rays.gather(1, odds.flatten(1).argmax(dim=1)[:, None, None].expand(-1, -1, 3))
    cosine = (rays * surest).sum(dim=-1).masked_fill(~batch.masks.flatten(1), -1.0).amax(dim=1)
    return cosine >= math.cos(math.radians(NEAR_DEGREES))


def rule_for(found: ScoredFrames) -> tuple[float, float]:
    """The rule of masks that is best for these frames, as at the end of a training of its own: threshold and share."""
    from baselines.listener.calibration import best_rule, figures_of_rules

    return best_rule(figures_of_rules(found.peak, found.iou, found.shown))


def figures_of(found: ScoredFrames, threshold: float, share: float) -> dict[str, float | None]:
    """Figures of a network, means over frames; None where there is none of the kind.

    Args:
        found: of `look_at`.
        threshold, share: of `rule_for`.

    Returns:
        ``strict_IoU`` of frames that show what sounds; ``FP_rate``, the share of the others with something marked;
        ``direction``, the share of the former whose surest pixel is near; ``category``, the share of frames with one
        audible category in which it is the most probable one.
    """
    from baselines.listener.calibration import SHARES

    marked = found.peak > threshold
    values = {
        "strict_IoU": (found.iou[:, SHARES.index(share)] * marked)[found.shown], "FP_rate": marked[~found.shown],
        "direction": found.near[found.shown], "category": found.named[found.single],
    }  # fmt: skip
    return {name: round(float(each.mean()), 4) if len(each) else None for name, each in values.items()}


# ---- all of them


_trainer: Trainer | None = None
_together: Any = None


def _begin(plan: Trainings, together: Any) -> None:
    """Make this process a trainer."""
    global _trainer, _together
    _trainer, _together = Trainer(plan), together


def _seconds(_: int) -> tuple[float, float]:
    """Of a step while all processes are at work."""
    assert _trainer is not None
    _together.wait()
    return _trainer.seconds()


def _work(plan: Trainings, kind: str, title: str, seed: int) -> None:
    assert _trainer is not None
    _trainer.plan = plan
    {"pictures": _trainer.look, "sounds": _trainer.listen}[kind](title, seed)


def steps_for(
    seconds: float, each: tuple[float, float], seeds: int, at_once: int, arms: Sequence[str] = tuple(ARMS)
) -> tuple[int, int]:
    """Steps with pictures alone, and with sounds, that all trainings can take in some time.

    Args:
        seconds: time.
        each: seconds of a step of both kinds.
        seeds: how many.
        at_once: processes.
        arms: titles of what is trained.
    """
    beginnings = len({beginning_of(title) for title in arms})
    left = PLANNED * at_once * seconds - seeds * len(arms) * BESIDES
    steps = left / (seeds * (beginnings * PICTURE_SHARE * each[0] + len(arms) * each[1]))
    if steps < 1:
        raise Avs3dError(
            f"{seconds:.0f} s do not suffice for {seeds} seeds of {len(arms)} trainings; allow more minutes"
        )
    return math.ceil(PICTURE_SHARE * int(steps)), int(steps)


def train_all(plan: Trainings, seeds: int, at_once: int, minutes: float) -> list[str]:
    """Train what has no result yet; says what failed.

    Args:
        plan: of all trainings; where it has no steps, as many as the minutes allow.
        seeds: how many.
        at_once: networks that are trained at a time.
        minutes: no training begins that is not expected to end by then.
    """
    began, failed = time.monotonic(), []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(at_once, context, _begin, (plan, context.Barrier(at_once))) as pool:
        if not plan.sound_steps:
            timed = list(pool.map(_seconds, range(at_once)))
            each = fmean(one[0] for one in timed), fmean(one[1] for one in timed)
            pictures, sounds = steps_for(60 * minutes - (time.monotonic() - began), each, seeds, at_once, plan.arms)
            plan = replace(plan, picture_steps=pictures, sound_steps=sounds)
            click.echo(f"{each[0]:.4f} and {each[1]:.4f} s a step, {at_once} at a time: {pictures} and {sounds} steps")
        write_json(plan.work / PLAN, {name: value for name, value in asdict(plan).items() if name in _SHARED})
        left = [each for seed in range(seeds) for each in _jobs(plan, seed)]
        running: dict[Future[None], tuple[tuple[str, str, int], float]] = {}
        longest = {"pictures": 0.0, "sounds": 0.0}
        while left or running:
            now = time.monotonic()
            left = [job for job in left if now - began + longest[job[0]] < 60 * minutes]
            ready = [job for job in left if job[0] == "pictures" or _begun(plan, *job[1:])]
            for job in ready[: at_once - len(running)]:
                left.remove(job)
                running[pool.submit(_work, plan, *job)] = (job, now)
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED)[0]:
                job, since = running.pop(future)
                longest[job[0]] = max(longest[job[0]], time.monotonic() - since)
                if error := future.exception():
                    failed.append(f"{job}: {type(error).__name__}: {error}")
                elif job[0] == "sounds":
                    click.echo(f"{now - began:.0f} s {job[1:]} {json.dumps(read_json(plan.result(*job[1:])))}")
                    write_json(plan.work / COLLECTED, collected(plan.work))
    return failed


#: What a file of results says of all trainings.
_SHARED = ("picture_steps", "sound_steps", "batch", "size", "frames")


def _jobs(plan: Trainings, seed: int) -> list[tuple[str, str, int]]:
    """What is left of a seed: its beginnings come first."""
    titles = [title for title in plan.arms if not plan.result(title, seed).exists()]
    firsts = [title for title in dict.fromkeys(map(beginning_of, titles)) if not _begun(plan, title, seed)]
    return [*(("pictures", title, seed) for title in firsts), *(("sounds", title, seed) for title in titles)]


def _begun(plan: Trainings, title: str, seed: int) -> bool:
    return (plan.beginning(title, seed) / "checkpoint.pt").exists()


def collected(work: Path) -> dict[str, Any]:
    """The figures of all arms: set → figure → mean and values of the seeds.

    ``change`` is that of strict IoU against the same seeds of the arm that `compared_with` names.

    Args:
        work: folder of trainings.
    """
    read = {
        title: {n: read_json(path) for n in range(100) if (path := work / RESULTS / f"{_name(title, n)}.json").exists()}
        for title in ARMS
    }
    arms: dict[str, Any] = {}
    for title, runs in read.items():
        usual = {seed: run["figures"] for seed, run in read[compared_with(title)].items()}
        for name in next(iter(runs.values()))["figures"] if runs else ():
            found = {seed: run["figures"][name] for seed, run in runs.items()}
            row = {figure: _over([one[figure] for one in found.values()]) for figure in FIGURES}
            pairs = [(found[seed]["strict_IoU"], usual[seed][name]["strict_IoU"]) for seed in found if seed in usual]
            row["change"] = _over([one - other for one, other in pairs if None not in (one, other)])
            data = {
                figure: round(fmean(run["data"][figure] for run in runs.values())) for figure in ("homes", "sounds")
            }
            arms.setdefault(title, {"data": data, "seeds": list(runs)})[name] = row
    return {"trainings": read_json(work / PLAN), "arms": arms}


def _over(values: list[float | None]) -> dict[str, Any] | None:
    """As `benchmarks.listener_seeds.cell` takes it, without an interval; None without values."""
    known = [round(value, 4) for value in values if value is not None]
    return {"mean": round(fmean(known), 4), "values": known, "interval": None} if known else None


# ---- commands


@click.group()
def main() -> None:
    """What random changes, homes and voices are worth to the listener."""


@main.command()
@click.argument("data", type=click.Path(exists=True, path_type=Path))
@click.argument("names", nargs=-1, required=True)
@click.option("--workers", type=click.IntRange(1), help="Processes [one per core].")
def decode(data: Path, names: tuple[str, ...], workers: int | None) -> None:
    """Decode sets of shards in DATA, which all trainings share."""
    for name in names:
        table = read_store(data / name, data / f"{name}-cache", workers=workers).table
        click.echo(f"{name}: {len(set(table.homes))} homes, {len(table.groups)} pictures, {len(table.keys)} sounds")


@main.command("train")
@click.argument("shards", type=click.Path(exists=True, path_type=Path))
@click.argument("cache", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", "work", type=click.Path(path_type=Path), required=True)
@click.option("--test", "tests", multiple=True, metavar="NAME=CACHE", help="Decoded frames that are scored as well.")
@click.option("--minutes", type=float, default=13.0, show_default=True, help="Begin nothing that would end later.")
@click.option("--picture-steps", type=click.IntRange(1), help="Learning from pictures alone [as time allows].")
@click.option("--sound-steps", type=click.IntRange(1), help="Those that follow [as time allows].")
@click.option("--frames", type=click.IntRange(1), default=12_000, show_default=True, help="Most sounds to learn from.")
@click.option("--batch-size", "batch", type=click.IntRange(4), default=64, show_default=True, help="Sounds.")
@click.option("--size", default="small", show_default=True, help="Of the network.")
@click.option("--accelerator", type=click.Choice(["cpu", "cuda"]), default="cuda", show_default=True)
@click.option("--seeds", type=click.IntRange(1), default=3, show_default=True)
@click.option(
    "--arm",
    "arms",
    type=click.Choice(list(ARMS)),
    multiple=True,
    default=list(ARMS),
    help="Train those named [all]; nothing: what the others are compared with.",
)
@click.option("--at-once", type=click.IntRange(1), default=8, show_default=True, help="Networks at a time.")
def train_command(
    shards: Path, work: Path, tests: tuple[str, ...], seeds: int, at_once: int, minutes: float, **chosen: Any
) -> None:
    """Train and score what has no result yet."""
    (work / RESULTS).mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    if not (work / VOICES).exists():
        write_json(work / VOICES, voices_of(shards))
    if (work / PLAN).exists():
        known = read_json(work / PLAN)
        chosen |= {name: known[name] for name in _SHARED}
    folders = {name: Path(folder) for name, _, folder in (each.partition("=") for each in tests)}
    chosen |= {name: chosen[name] or 0 for name in ("picture_steps", "sound_steps")}
    plan = Trainings(work=work, tests=folders, **chosen)
    if failed := train_all(plan, seeds, at_once, minutes - (time.monotonic() - began) / 60):
        raise Avs3dError("; ".join(failed))


@main.command()
@click.argument("work", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def collect(work: Path, output: Path) -> None:
    """Write the figures of all trainings that have a result, and print them as tables."""
    from benchmarks.ablation_tables import curves, summary

    found = collected(work)
    write_json(output, found)
    click.echo(f"{summary(found)}\n\n{curves(found)}")


if __name__ == "__main__":
    main()
