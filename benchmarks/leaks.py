"""`python -m benchmarks.leaks --seed N [--seed M …] --json FILE`: do the pictures reveal which object sounds?

Observations in homes that no manifest uses are arranged by the generator (placement, ids, walk, points, then the draw
of the sounding object) and rendered as small pictures of instance ids. Rules without access to the sound choose one of
the candidates in each: the instances of the sounding category in part_2, all instances of the seven categories in
part_1.
Each rule should be right as often as chance, the mean of 1 / (number of candidates).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_json
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.runtime.parallel import process_each
from benchmarks.unseen_homes import ROOMS, home_of, plans_of, sample_manifest
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from generators.observation.arrangement import arrange, draw_sounding, place_objects
from generators.observation.surface_points import SurfaceSampler
from generators.paths.trajectory import WalkTask, plan_walk
from generators.placement.placement import Placement
from generators.placement.site import Site
from generators.plan import ObservationPlan
from generators.vision.base import RenderedView

Array = NDArray[np.float64]

#: Standard errors beyond which a rule counts as better than chance.
LIMIT = 2.5
#: Share of the frames in which a candidate should be in view.
IN_VIEW = (0.20, 0.70)
#: Rules without access to the sound: each chooses the candidate with the largest value.
RULES = (
    "share of frames in view",
    "mean area",
    "largest area",
    "mean area where in view",
    "centrality where in view",
    "time in the middle third of the picture",
    "longest look",
    "number of looks",
    "early first view",
    "late last view",
    "share of test frames in view",
    "nearness to the path, mean",
    "nearness to the path, least",
    "nearness to the first position",
    "path length within 1.5 m",
    "height above the floor",
    "low instance id",
    "sparse points per visible pixel",
    "sparse points",
    "right–left balance",
    "distance from the other objects",
)
TRAINED = "trained (logistic regression over all)"


@dataclass(frozen=True, eq=False)
class Seen:
    """The inputs of the rules for one observation.

    Attributes:
        part, home, key: identify the observation.
        features: (K, len(RULES)) one row per candidate.
        truth: index of the candidate that sounds.
        in_view: (M,) share of frames in which each placed object is in view.
    """

    part: str
    home: str
    key: str
    features: Array
    truth: int
    in_view: Array


@lru_cache(maxsize=1)
def caster_of(home: Scene) -> RayCaster:
    """Rays against a home, whose surfaces are sorted once for all of its observations."""
    return RayCaster(home)


@lru_cache(maxsize=len(ROOMS))
def site_of(home: Scene, room: str) -> Site:
    """A room of a home, measured once for all of its observations."""
    return Site.of(home, room)


def observe(plan: ObservationPlan, size: int, *, biased: bool = False) -> Seen | None:
    """Arrange and render one observation; None if its room is too small.

    Args:
        plan: of the observation.
        size: of the pictures, pixels.
        biased: plan the walk only for the sounding object, as a positive control of this experiment.
    """
    home = home_of(plan, plain=True)
    try:
        site = site_of(home, plan.spec.room)
        if biased:
            placements, _ = place_objects(plan, site)
            watched = [draw_sounding(plan, placements) - 1]
            task = WalkTask(site, placements, frames=plan.camera.frames, watched=watched)
            poses: Sequence[Pose] = plan_walk(task, plan.rng("path")).poses
        else:
            seen = arrange(plan, home, site=site)
            placements, poses = seen.placements, seen.poses
    except Avs3dError:
        return None
    ids, points = _pictures(plan, home, placements, poses, size)
    everyone, sounding = range(1, len(placements) + 1), draw_sounding(plan, placements)
    if plan.spec.part == "part_2":
        candidates = [n for n in everyone if placements[n - 1].model.category == plan.spec.category]
    else:
        able = class_ids(plan.own_categories or ())
        candidates = [n for n in everyone if placements[n - 1].model.category in able]
    features = np.array([_features(n, ids, poses, placements, points) for n in candidates])
    in_view = np.array([(ids == n).any(axis=(1, 2)).mean() for n in everyone])
    return Seen(plan.spec.part, plan.spec.scan, plan.key, features, candidates.index(sounding), in_view)


def _pictures(
    plan: ObservationPlan, home: Scene, placements: Sequence[Placement], poses: Sequence[Pose], size: int
) -> tuple[NDArray[np.uint16], Array]:
    """(n, size, size) instance ids and (P, 3) sparse points, which are drawn as the generator draws them."""
    parts = [placement.part(number) for number, placement in enumerate(placements, start=1)]
    room, objects = caster_of(home), RayCaster(np.concatenate([part.mesh.positions for part in parts]))
    number = np.repeat([part.instance_id for part in parts], [len(part.mesh.positions) for part in parts])
    camera = Intrinsics.from_fov(size, plan.camera.hfov)
    u, v = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = np.stack([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -np.ones_like(u)], axis=-1)
    sampler = SurfaceSampler(camera, plan.rng("points"))
    ids = np.zeros((len(poses), size, size), dtype=np.uint16)
    for index, pose in enumerate(poses):
        ways = rays.reshape(-1, 3) @ pose.rotation_matrix.T
        behind, _ = room.closest(pose.position, ways)
        depth, face = objects.closest(pose.position, ways)
        ids[index] = np.where(depth < behind, number[face], 0).reshape(size, size)
        nearest = np.minimum(depth, behind)
        shown = np.where(np.isfinite(nearest), nearest, 0.0).astype(np.float32).reshape(size, size)
        sampler.add(RenderedView(np.zeros((size, size, 3), dtype=np.uint8), shown, ids[index]), pose)

    def hidden(_: int, origins: Array, ways: Array, distance: Array) -> NDArray[np.bool_]:
        found = objects.occluded(origins, ways, distance)
        found[~found] = room.occluded(origins[~found], ways[~found], distance[~found])
        return found

    return ids, sampler.link(poses, hidden).positions


def _features(
    number: int, ids: NDArray[np.uint16], poses: Sequence[Pose], placements: Sequence[Placement], points: Array
) -> list[float]:
    """The values of `RULES` for one candidate."""
    mask, size = ids == number, ids.shape[1]
    area = mask.mean(axis=(1, 2))
    shown = area > 0
    times = np.flatnonzero(shown)
    offset = np.abs(np.arange(size) + 0.5 - size / 2)
    off_centre = np.hypot(offset[:, None], offset[None])
    where = mask[shown]
    centrality = -(where * off_centre).sum() / max(int(where.sum()), 1)
    third = slice(size // 3, size - size // 3)
    middle = mask[:, third, third].any(axis=(1, 2)).mean()
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], shown.astype(int), [0]]))))[::2]
    place = placements[number - 1]
    box, track = place.box, np.array([pose.position for pose in poses])
    distance = np.linalg.norm((track - box.centre)[:, [0, 2]], axis=1)
    steps = np.linalg.norm(np.diff(track, axis=0), axis=1)
    near = float(steps[distance[1:] < 1.5].sum())
    local = np.array([(np.asarray(pose.rotation_matrix).T @ (box.centre - pose.position)) for pose in poses])
    azimuth = np.degrees(np.arctan2(local[:, 0], -local[:, 2]))
    on_it = float((box.distance(points) < 0.01).sum()) if len(points) else 0.0
    others = [np.linalg.norm(box.centre - o.box.centre) for k, o in enumerate(placements, start=1) if k != number]
    return [
        float(shown.mean()), float(area.mean()), float(area.max()), float(area[shown].mean()) if shown.any() else 0.0,
        float(centrality), float(middle), float(runs.max(initial=0)), float(len(runs)),
        -float(times.min(initial=len(poses))), float(times.max(initial=-1)), float(shown[::8].mean()),
        -float(distance.mean()), -float(distance.min()), -float(distance[0]), near, float(box.centre[1]),
        -float(number), on_it / max(float(mask.sum()), 1.0), on_it,
        float((azimuth > 20).mean() - (azimuth < -20).mean()), float(np.mean(others)) if others else 0.0,
    ]  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """How often a rule is right, compared with chance.

    Attributes:
        part, rule: the part and the rule.
        observations: number of observations.
        accuracy, chance: shares.
        error: standard error of the share that random guessing gets right.
    """

    part: str
    rule: str
    observations: int
    accuracy: float
    chance: float
    error: float

    @property
    def deviation(self) -> float:
        """Difference between accuracy and chance, in standard errors."""
        return (self.accuracy - self.chance) / self.error

    @property
    def leaks(self) -> bool:
        """Whether the rule is better than chance."""
        return self.deviation > LIMIT


def judge(seen: Sequence[Seen]) -> list[Verdict]:
    """The verdicts on all rules, part by part; observations with one candidate are left out."""
    out = []
    for part in sorted({each.part for each in seen}):
        cases = [each for each in seen if each.part == part and len(each.features) > 1]
        if not cases:
            continue
        p = np.array([1 / len(case.features) for case in cases])
        error = math.sqrt(float((p * (1 - p)).sum())) / len(cases)
        scores = [[case.features[:, k] for case in cases] for k in range(len(RULES))]
        for rule, values in (*zip(RULES, scores, strict=True), (TRAINED, _trained(cases))):
            right = float(np.mean([_credit(v, case.truth) for v, case in zip(values, cases, strict=True)]))
            out.append(Verdict(part, rule, len(cases), right, float(p.mean()), error))
    return out


def pool(samples: Sequence[Sequence[Verdict]]) -> list[Verdict]:
    """The verdicts on the same rules over several samples together."""
    out = []
    for of_rule in zip(*samples, strict=True):
        count = np.array([v.observations for v in of_rule])
        accuracy, chance = (np.array([getattr(v, name) for v in of_rule]) for name in ("accuracy", "chance"))
        # The standard errors of the samples, each as `judge` found it, add up as those of independent guesses.
        error = math.sqrt(float(((count * np.array([v.error for v in of_rule])) ** 2).sum())) / count.sum()
        right, guessed = float(np.average(accuracy, weights=count)), float(np.average(chance, weights=count))
        first = of_rule[0]
        out.append(Verdict(first.part, first.rule, int(count.sum()), right, guessed, error))
    return out


def _credit(values: Array, truth: int) -> float:
    """1 if the right candidate has the largest value; a share if several have it."""
    best = values >= values.max() - 1e-12
    return float(best[truth] / best.sum())


def _trained(cases: Sequence[Seen]) -> list[Array]:
    """Scores of the candidates by a logistic regression that was trained on other homes."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import GroupKFold

    # Normalised within an observation, where rules compare; unit variance if the candidates differ.
    rows = [(c.features - c.features.mean(axis=0)) / np.maximum(c.features.std(axis=0), 1e-9) for c in cases]
    homes = np.array([case.home for case in cases])
    scores: list[Array] = [np.zeros(len(row)) for row in rows]
    for train, test in GroupKFold(min(5, len(set(homes)))).split(homes, groups=homes):
        x = np.concatenate([rows[k] for k in train])
        y = np.concatenate([np.arange(len(rows[k])) == cases[k].truth for k in train])
        model = LogisticRegression(C=0.1, max_iter=2000).fit(x, y)
        for k in test:
            scores[k] = model.decision_function(rows[k])
    return scores


def _observe_home(task: tuple[list[ObservationPlan], int, bool]) -> list[Seen | None]:
    plans, size, biased = task
    return [observe(plan, size, biased=biased) for plan in plans]


def survey(
    observations: int,
    *,
    homes: int,
    seed: int,
    frames: int = 60,
    size: int = 48,
    workers: int = 2,
    parts: Sequence[str] = ("part_1", "part_2"),
    biased: bool = False,
) -> list[Seen]:
    """Arrange and render ``observations`` observations in ``homes`` homes, without those whose room is too small."""
    plans = plans_of(sample_manifest(homes, observations, seed, parts=parts, frames=frames, size=size))
    tasks = [
        ([plan for plan in plans if plan.spec.scan == home], size, biased)
        for home in dict.fromkeys(plan.spec.scan for plan in plans)
    ]
    found = {task[0][0].spec.scan: seen for task, seen in process_each(_observe_home, tasks, workers=workers)}
    return [each for task in tasks for each in found[task[0][0].spec.scan] if each is not None]


def summary(seen: Sequence[Seen], verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """The contents of the JSON file."""
    share = np.concatenate([each.in_view for each in seen])
    low, high = IN_VIEW
    return {
        "observations": len(seen),
        "homes": len({each.home for each in seen}),
        "objects": len(share),
        "in view": {
            "least": float(share.min()),
            "quartiles": np.percentile(share, [25, 50, 75]).tolist(),
            "most": float(share.max()),
            f"share of objects in view in {low:.0%}–{high:.0%} of the frames": float(
                ((share >= low) & (share <= high)).mean()
            ),
        },
        "rules": [_verdict(v) for v in verdicts],
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {**vars(verdict), "deviation": verdict.deviation, "leaks": verdict.leaks}


def table(document: Mapping[str, Any], control: Mapping[str, Any], part: str) -> tuple[list[str], list[list[str]]]:
    """Head and rows: rule, its share over all samples, its least and most deviation of a sample, the control.

    Args:
        document: contents of the JSON file of some samples.
        control: the same with ``--biased``.
        part: part_1 or part_2.
    """

    def of_part(rules: Sequence[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
        return {one["rule"]: one for one in rules if one["part"] == part}

    def size(rules: Mapping[str, Mapping[str, Any]]) -> str:
        one = next(iter(rules.values()))
        return f"{one['observations']} observations, chance {one['chance']:.3f}"

    def signed(value: float) -> str:
        return f"{value:+.2f}".replace("-", "−")

    pooled, biased = of_part(document["pooled"]), of_part(control["pooled"])
    samples = [of_part(sample["rules"]) for sample in document["samples"]]
    head = ["rule", size(pooled), f"least and most of the {len(samples)} samples", f"control (biased): {size(biased)}"]
    rows = []
    for rule, one in pooled.items():
        apart = sorted(sample[rule]["deviation"] for sample in samples)
        shares = [f"{each['accuracy']:.3f} ({signed(each['deviation'])})" for each in (one, biased[rule])]
        rows.append([rule, shares[0], f"{signed(apart[0])}, {signed(apart[-1])}", shares[1]])
    return head, rows


@click.command()
@click.option("--observations", default=216, show_default=True, type=click.IntRange(1))
@click.option("--homes", default=18, show_default=True, type=click.IntRange(2))
@click.option("--seed", "seeds", multiple=True, type=int, default=(1,), help="Repeat for several samples [1].")
@click.option("--frames", default=60, show_default=True, type=click.IntRange(2))
@click.option("--size", default=48, show_default=True, type=click.IntRange(16), help="Side of the pictures, pixels.")
@click.option("--workers", default=2, show_default=True, type=click.IntRange(1))
@click.option("--biased", is_flag=True, help="Positive control: plan each walk only for the sounding object.")
@click.option("--json", "output", type=click.Path(path_type=Path), default=None, help="Also write the figures here.")
def main(
    observations: int,
    homes: int,
    seeds: tuple[int, ...],
    frames: int,
    size: int,
    workers: int,
    biased: bool,
    output: Path | None,
) -> None:
    """Print how often rules without access to the sound find the sounding object, in all samples together."""
    samples, verdicts = [], []
    for seed in seeds:
        seen = survey(
            observations, homes=homes, seed=seed, frames=frames, size=size, workers=workers, biased=biased
        )  # fmt: skip
        verdicts.append(judge(seen))
        samples.append({"seed": seed, **summary(seen, verdicts[-1])})
        print(f"seed {seed}:", json.dumps(samples[-1]["in view"]))
    pooled = pool(verdicts)
    table = Table("part", "rule", "observations", "right", "chance", "standard errors", "least and most of a sample")
    for v, *each in zip(pooled, *verdicts, strict=True):
        mark = " leaks" if v.leaks else ""
        apart = sorted(single.deviation for single in each)
        table.add_row(
            v.part, v.rule, str(v.observations), f"{v.accuracy:.3f}", f"{v.chance:.3f}", f"{v.deviation:+.2f}{mark}",
            f"{apart[0]:+.2f} {apart[-1]:+.2f}",
        )  # fmt: skip
    Console(width=150).print(table)
    if output:
        write_json(output, {"samples": samples, "pooled": [_verdict(v) for v in pooled]})


if __name__ == "__main__":
    main()
