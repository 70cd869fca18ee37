"""`python -m benchmarks.listen_choice ROOT -o DIR`: what EchoSegnet's choice by sound is worth under ``listen``.

The choice alone, with perfect candidates: every instance of the room that can sound, with points on the faces of its
true box that the walk sees. The prediction for a test frame is the union of the visible pixels of the candidates that
are said to sound in it. Three submissions are written below DIR and scored:

- ``official``: the published refinement, one cluster for all frames (all of them where it keeps none);
- ``centre``: the candidate nearest to the published audio centre, for all frames: the refinement without its size rule;
- ``spatial``: `baselines.echosegnet.activity`, per frame.

Beside the scores it prints, for ``spatial``: how often the set of sounding candidates is right, how often two twins
that sound at once are both found, false positives by what sounds, and the reliability of the posterior: candidates and
test frames by probability, with the share that really sounds, and the expected calibration error (M. P. Naeini,
G. Cooper, M. Hauskrecht, AAAI 2015).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.deaf_oracles import can_sound
from avs3d_bench.files import write_json
from avs3d_bench.geometry import flip_world
from avs3d_bench.method import Method, write_submission
from avs3d_bench.parallel import process_each
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.submission import Prediction
from baselines.echosegnet import activity, aisrm, clusters
from baselines.echosegnet.activity import Activity, ActivityWeights
from baselines.echosegnet.pipeline import clips_of
from baselines.echosegnet.views import RegisteredView, load_points, load_views, train_views
from baselines.oracle import paint
from benchmarks.instance_selection import visible_faces
from evaluators import evaluate

Array = NDArray[np.float64]

#: Edges of the bins of the posterior.
BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0 + 1e-9)
#: DBSCAN's radius (m): the points of the boxes are sparser than splats.
EPS = 0.3


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen in one observation.

    Attributes:
        key: of the observation.
        kind: ``silence``, ``off-screen``, ``one source`` or ``several``.
        test: (T,) whether a frame is a test frame.
        truth: (T, K) whether a candidate is audible.
        posterior: (T, K) of `spatial`.
        official: (K,) the candidates that the published refinement keeps.
        centre: (K,) the candidate nearest to the published audio centre.
        twins: pairs of candidates of one category.
    """

    key: str
    kind: str
    test: NDArray[np.bool_]
    truth: NDArray[np.bool_]
    posterior: Array
    official: NDArray[np.bool_]
    centre: NDArray[np.bool_]
    twins: tuple[tuple[int, int], ...]


def kind_of(record: ObservationRecord) -> str:
    """What sounds in an observation."""
    sources = record.sources or ()
    if not sources:
        return "silence"
    if all(source.instance is None for source in sources):
        return "off-screen"
    return "one source" if len(sources) == 1 else "several"


def candidate_points(record: ObservationRecord, views: Sequence[RegisteredView]) -> list[Array]:
    """Points (N, 3) on the visible faces of every instance that can sound, in the views' world."""
    cameras = flip_world(np.stack([view.position for view in views]))
    rng = np.random.default_rng
    return [visible_faces(np.array(one.bounds), cameras, rng(0)) for one in can_sound(record)]


def spatial_choice(
    points: Sequence[Array], views: Sequence[RegisteredView], weights: ActivityWeights | None = None
) -> Activity:
    """`activity.infer` on all frames."""
    places = [clusters.representatives(each) for each in points]
    rotation, position = (np.stack([getattr(view, name) for view in views]) for name in ("rotation", "position"))
    return activity.infer(places, rotation, position, clips_of(views), weights=weights)


def published_centre(observation: Observation, views: Sequence[RegisteredView]) -> Array | None:
    """(3,) the published audio centre, in the views' world; None if nothing was heard."""
    seen = train_views(views)
    scene, _ = load_points(observation)
    return aisrm.audio_centre(scene, aisrm.audio_intensity_map(seen, clips_of(seen), scene))


def centre_choice(points: Sequence[Array], centre: Array | None) -> NDArray[np.bool_]:
    """(K,) the candidate nearest to the centre on the floor plan: all, if nothing was heard."""
    if centre is None:
        return np.ones(len(points), np.bool_)
    gaps = [float(np.linalg.norm((each.mean(axis=0) - centre)[[0, 2]])) for each in points]
    return np.asarray(np.arange(len(points)) == int(np.argmin(gaps)))


def official_choice(points: Sequence[Array], centre: Array | None) -> NDArray[np.bool_]:
    """(K,) which candidates the published refinement keeps: all, if it keeps no cluster or nothing was heard."""
    if centre is None:
        return np.ones(len(points), np.bool_)
    labels = np.repeat(np.arange(len(points)), [len(each) for each in points])
    staying = aisrm.refine(np.concatenate(points), centre, eps=EPS).staying
    return np.array([staying[labels == k].mean() > 0.5 for k in range(len(points))])


def choose(root: Path, key: str) -> Choice:
    """Choose in one observation; only the figures look at the truth."""
    observation = Observation(root, key)
    record, views = observation.record, load_views(observation)
    assert record is not None
    points = candidate_points(record, views)
    found, centre = spatial_choice(points, views), published_centre(observation, views)
    number = {one.id: k for k, one in enumerate(can_sound(record))}
    truth = np.zeros(found.posterior.shape, np.bool_)
    for t, frame in enumerate(record.frames):
        truth[t, [number[i] for i in record.audible_instances(frame)]] = True
    category = [one.category for one in can_sound(record)]
    twins = tuple((a, b) for b in range(len(category)) for a in range(b) if category[a] == category[b])
    return Choice(
        key, kind_of(record), np.array([view.split == "test" for view in views]), truth, found.posterior,
        official_choice(points, centre), centre_choice(points, centre), twins,
    )  # fmt: skip


def masks(choices: dict[str, Choice], name: str, frames: tuple[Frame, ...]) -> list[Prediction]:
    """The predictions of the method ``name`` for test frames of one observation."""
    out = []
    for frame in frames:
        choice, record = choices[frame.observation.key], frame.observation.record
        assert record is not None
        fixed = {"official": choice.official, "centre": choice.centre}
        active = fixed[name] if name in fixed else choice.posterior[frame.index] > activity.DECIDED
        marked = [one for one, on in zip(can_sound(record), active, strict=True) if on]
        ids = paint(frame.instance_ids(), {one.id: record.class_ids[one.category] for one in marked})
        out.append(Prediction(ids > 0, ids))
    return out


def figures_of(choices: Sequence[Choice]) -> dict[str, Any]:
    """Accuracy of the sets, twins found, and reliability, over test frames."""
    right: dict[str, list[float]] = defaultdict(list)
    both: list[float] = []
    probability, sounds = [], []
    for choice in choices:
        posterior, truth = choice.posterior[choice.test], choice.truth[choice.test]
        active = posterior > activity.DECIDED
        right[choice.kind].append(float((active == truth).all(axis=1).mean()))
        for a, b in choice.twins:
            together = truth[:, a] & truth[:, b]
            if together.any():
                both.append(float((active[together, a] & active[together, b]).mean()))
        probability.append(posterior.ravel())
        sounds.append(truth.ravel())
    p, y = np.concatenate(probability), np.concatenate(sounds)
    where = np.digitize(p, BINS) - 1
    bins = [
        {
            "from": low, "to": min(high, 1.0), "cases": int((where == n).sum()),
            "posterior": float(p[where == n].mean()), "sounds": float(y[where == n].mean()),
        }
        for n, (low, high) in enumerate(pairwise(BINS)) if (where == n).any()
    ]  # fmt: skip
    return {
        "observations": len(choices),
        "set_right": {kind: float(np.mean(values)) for kind, values in sorted(right.items())},
        "twins_both": {"observations": len(both), "frames_right": float(np.mean(both)) if both else None},
        "ece": float(sum(one["cases"] * abs(one["posterior"] - one["sounds"]) for one in bins) / len(p)),
        "brier": float(np.mean(np.square(p - y))),
        "reliability": bins,
    }


def score(path: Path, dataset: Dataset, choices: Sequence[Choice]) -> dict[str, Any]:
    """Figures of a submission under ``listen``: of all observations, and of siblings with at most one source."""
    single = [choice.key for choice in choices if choice.kind != "several"]
    every = evaluate(path, dataset.root, only=[choice.key for choice in choices], workers=None).scores
    ones = evaluate(path, dataset.root, only=single, workers=None).scores
    kinds = {choice.key: choice.kind for choice in choices}
    false: dict[str, list[float]] = defaultdict(list)
    for one in every.observations:
        if one.listen is not None and one.listen.FP_rate is not None:
            false[kinds[one.key]].append(one.listen.FP_rate)
    listen, alone = every.overall.listen, ones.overall.listen
    assert listen is not None
    assert alone is not None
    return {
        "pair_accuracy": listen.pair_accuracy, "IoU": listen.IoU, "FP_rate": listen.FP_rate,
        "class_mIoU": listen.class_mIoU, "pair_accuracy_one_source": alone.pair_accuracy,
        "FP_rate_by_kind": {kind: float(np.mean(values)) for kind, values in sorted(false.items())},
    }  # fmt: skip


@click.command()
@click.argument("root", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Folder of the submissions.")
@click.option("--only", multiple=True, help="Shell pattern of observation keys.")
@click.option("--workers", type=int, default=None, help="Processes [one per core].")
@click.option("--json", "report", type=click.Path(path_type=Path), default=None, help="Also write the figures here.")
def main(root: Path, output: Path, only: tuple[str, ...], workers: int | None, report: Path | None) -> None:
    """Choose in all observations of part_3 of ROOT, write and score the submissions, print the figures."""
    dataset = Dataset(root)
    keys = [one.key for one in dataset.select(*only) if one.is_sound_scene]
    found = dict(process_each(partial(choose, root), keys, workers=workers, label="choice", progress=True))
    choices = {key: found[key] for key in keys}
    table = Table("", "pair_accuracy", "one source", "IoU", "FP_rate", "by kind", title="choice alone, listen")
    document: dict[str, Any] = {"choice": figures_of(list(choices.values()))}
    for name in ("official", "centre", "spatial"):
        method = Method(f"EchoSegnet's choice, {name}", partial(masks, choices, name), truth="instance masks")
        write_submission(dataset, output / name, method, only=keys, overwrite=True)
        row = document[name] = score(output / name, dataset, list(choices.values()))
        cells = [row[key] for key in ("pair_accuracy", "pair_accuracy_one_source", "IoU", "FP_rate")]
        kinds = ", ".join(f"{kind} {value:.3f}" for kind, value in row["FP_rate_by_kind"].items())
        table.add_row(name, *("–" if cell is None else f"{cell:.3f}" for cell in cells), kinds)
    console = Console(width=140)
    console.print(table)
    console.print_json(data=document["choice"])
    for choice in choices.values():
        active, truth = choice.posterior[choice.test] > activity.DECIDED, choice.truth[choice.test]
        if (share := float((active == truth).all(axis=1).mean())) < 0.9:
            console.print(f"{choice.key} ({choice.kind}): the set is right in {share:.0%} of the test frames")
    if report is not None:
        write_json(report, document)


if __name__ == "__main__":
    main()
