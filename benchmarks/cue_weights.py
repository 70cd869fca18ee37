"""Weights of the cues of the `spatial` variant: chosen on some homes, tested on others.

    python -m benchmarks.cue_weights collect ROOT… -o FILE.npz    # cues and candidates, from datasets
    python -m benchmarks.cue_weights fit FILE.npz                 # choose the weights
    python -m benchmarks.cue_weights score FILE.npz [--json OUT]  # accuracy and calibration of the weights in use

Weights are judged by their cross-entropy: the mean, over observations, of −log(posterior of the instance that sounds).
This measures both right choices and calibrated posteriors. Among the weights within one standard error (over homes) of
the best, the smallest are chosen. Every observation has the same weight, for any number of cases; cases are the twins
and invented twins of `benchmarks.instance_selection`, with all train frames and with a quarter of them.
"""

from __future__ import annotations

import itertools
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from avs3d_bench.dataset import Dataset
from avs3d_bench.parallel import process_each
from baselines.echosegnet.spatial import CueEvidence, CueWeights, gather
from benchmarks.instance_selection import cases_of, observed, room_of

GRID = {
    "phase": (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0),
    "ild": (0.0, 0.03, 0.1, 0.3, 1.0),
    "level": (0.0, 0.05, 0.1, 0.2, 0.4, 0.8),
}
#: Shares of the train frames, and number of random subsets of the smaller share.
SHARES, SUBSETS = (1.0, 0.25), 4
#: Largest number of trials per observation, experiment and share in the choice of weights.
PER_KIND = 2
#: Edges of the bins in which the posterior is compared with the share of right choices.
BINS = (0.0, 0.5, 0.7, 0.9, 0.99, 1.0 + 1e-9)


@dataclass(frozen=True, eq=False)
class Trial:
    """One choice among candidates, of which the first is right."""

    key: str
    experiment: str
    share: float
    evidence: CueEvidence


def collect_one(item: tuple[Path, str]) -> list[Trial]:
    """The trials of one observation."""
    root, key = item
    dataset = Dataset(root)
    observation = dataset[key]
    heard = observed(observation)
    trials = []
    for share in SHARES:
        for seed in range(1 if share == 1.0 else SUBSETS):
            index = heard.subset(share, seed)
            cues = heard.cues.select(index)
            for case in cases_of(observation, heard, room_of(dataset, observation)):
                labels = np.repeat(np.arange(len(case.candidates)), [len(c) for c in case.candidates])
                evidence = gather(
                    np.concatenate(case.candidates), labels, heard.rotation[index], heard.position[index], cues
                )
                trials.append(Trial(f"{dataset.name}/{key}", case.experiment, share, evidence))
    return trials


def save(trials: Sequence[Trial], path: Path) -> None:
    """Write trials as one .npz without pickles."""
    arrays: dict[str, np.ndarray] = {}
    about = []
    for number, trial in enumerate(trials):
        e = trial.evidence
        about.append([trial.key, trial.experiment, trial.share, e.concentration])
        arrays |= {
            f"{number}.count": e.count, f"{number}.start": e.start, f"{number}.resultant": e.resultant.astype("f4"),
            f"{number}.ild": e.ild.astype("f4"), f"{number}.level": e.level.astype("f4"),
        }  # fmt: skip
    np.savez_compressed(path, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]


def load(path: Path) -> list[Trial]:
    """Read a file that `save` has written."""
    with np.load(path) as stored:
        about = json.loads(str(stored["about"]))
        return [
            Trial(
                key, experiment, share,
                CueEvidence(
                    np.arange(len(stored[f"{n}.count"])), stored[f"{n}.count"], stored[f"{n}.start"],
                    stored[f"{n}.resultant"].astype(np.float64), kappa, stored[f"{n}.ild"].astype(np.float64),
                    stored[f"{n}.level"].astype(np.float64), np.zeros(0),
                ),
            )
            for n, (key, experiment, share, kappa) in enumerate(about)
        ]  # fmt: skip


def losses(trials: Sequence[Trial], weights: CueWeights) -> dict[str, float]:
    """Observation → mean of −ln(posterior of the right candidate) over its trials, nats."""
    found: dict[str, list[float]] = defaultdict(list)
    for trial in trials:
        _, posterior = trial.evidence.weigh(weights)
        found[trial.key].append(-float(np.log(max(posterior[0], 1e-12))))
    return {key: float(np.mean(values)) for key, values in found.items()}


def cross_entropy(trials: Sequence[Trial], weights: CueWeights) -> float:
    """Mean of `losses` over the observations."""
    return float(np.mean(list(losses(trials, weights).values())))


def error_over_homes(by_observation: Mapping[str, float]) -> float:
    """Standard error over homes of a mean of `losses`, because observations of one home share its rooms."""
    homes: dict[str, list[float]] = defaultdict(list)
    for key, value in by_observation.items():
        homes[key.rsplit("/", 2)[0]].append(value)
    means = [float(np.mean(values)) for values in homes.values()]
    return float(np.std(means, ddof=1) / np.sqrt(len(means)))


def thinned(trials: Sequence[Trial], most: int) -> list[Trial]:
    """At most ``most`` trials of every observation, experiment and share, evenly spread."""
    kinds: dict[tuple[str, str, float], list[Trial]] = defaultdict(list)
    for trial in trials:
        kinds[trial.key, trial.experiment, trial.share].append(trial)
    return [
        group[len(group) * n // min(most, len(group))] for group in kinds.values() for n in range(min(most, len(group)))
    ]


@click.group()
def main() -> None:
    """Choose and measure the weights of the spatial variant's cues."""


@main.command()
@click.argument("roots", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path))
@click.option("--only", multiple=True)
def collect(roots: tuple[Path, ...], output: Path, only: tuple[str, ...]) -> None:
    """Write the cues and the candidates of the datasets ROOTS."""
    items = [(root, observation.key) for root in roots for observation in Dataset(root).select(*only)]
    found = dict(process_each(collect_one, items))
    save([trial for item in items for trial in found[item]], output)


@main.command()
@click.argument("path", type=click.Path(path_type=Path, exists=True))
def fit(path: Path) -> None:
    """Print the weights with the least cross-entropy, and the recommended ones: the smallest within one standard error.

    The rule of one standard error (Breiman, Friedman, Olshen, Stone, *Classification and Regression Trees*, 1984,
    section 3.4.3), with the phase's weight compared first, because it determines how peaked the posterior is.
    """
    trials = thinned(load(path), PER_KIND)
    tried = [CueWeights(*weights) for weights in itertools.product(*GRID.values())]
    found = {weights: losses(trials, weights) for weights in tried}
    mean = {weights: float(np.mean(list(values.values()))) for weights, values in found.items()}
    best = min(tried, key=mean.__getitem__)
    limit = mean[best] + error_over_homes(found[best])
    chosen = next(weights for weights in tried if mean[weights] <= limit)
    table = Table("", "phase", "ild", "level", "cross-entropy (nats)")
    for name, weights in (("least", best), ("chosen", chosen), ("in use", CueWeights())):
        loss = mean[weights] if weights in mean else cross_entropy(trials, weights)
        table.add_row(name, *(f"{value:g}" for value in vars(weights).values()), f"{loss:.4f}")
    Console(width=100).print(table)
    print(f"within one standard error of the least: up to {limit:.4f}")


@main.command()
@click.argument("path", type=click.Path(path_type=Path, exists=True))
@click.option("--json", "output", type=click.Path(path_type=Path), default=None)
def score(path: Path, output: Path | None) -> None:
    """Print how often the current weights are right, in all and by the posterior of the choice."""
    trials, weights = load(path), CueWeights()
    rates: dict[tuple[str, float], list[tuple[str, bool]]] = defaultdict(list)
    posteriors: list[tuple[float, bool]] = []
    for trial in trials:
        _, posterior = trial.evidence.weigh(weights)
        right = bool(posterior.argmax() == 0)
        rates[trial.experiment, trial.share].append((trial.key, right))
        posteriors.append((float(posterior.max()), right))
    table = Table("experiment", "train frames", "observations", "cases", "right (%)")
    for (experiment, share), found in sorted(rates.items(), key=lambda item: (item[0][0], -item[0][1])):
        percent = f"{100 * np.mean([r for _, r in found]):.1f}"
        table.add_row(experiment, f"{share:.0%}", str(len({key for key, _ in found})), str(len(found)), percent)
    Console(width=100).print(table)
    sure = Table("posterior of the choice", "cases", "mean posterior (%)", "right (%)")
    bins = []
    for low, high in itertools.pairwise(BINS):
        part = [(p, r) for p, r in posteriors if low <= p < high]
        if part:
            mean, share = (100 * float(np.mean(column)) for column in zip(*part, strict=True))
            bins.append({"from": low, "to": min(high, 1.0), "cases": len(part), "posterior": mean, "right": share})
            sure.add_row(f"{low:g}–{min(high, 1.0):g}", str(len(part)), f"{mean:.1f}", f"{share:.1f}")
    Console(width=100).print(sure)
    if output is not None:
        document = {
            "weights": vars(weights),
            "cross_entropy": cross_entropy(trials, weights),
            "rates": {
                f"{experiment} | {share:.0%}": {"cases": len(found), "right": float(np.mean([r for _, r in found]))}
                for (experiment, share), found in sorted(rates.items())
            },
            "calibration": bins,
            "wrong_twins": sorted({key for key, right in rates["twins", 1.0] if not right}),
        }
        output.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
