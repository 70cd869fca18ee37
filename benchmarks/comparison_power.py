"""`python -m benchmarks.comparison_power`: how often `avs3d compare` is wrong, and how small a difference it can show.

It draws scores of methods whose true difference is known, and counts:

- type I errors: how often two methods that are equally good are separated (two methods, and any pair of five);
- power: how often a true difference is found;
- coverage: how often the 95 % interval holds the true difference.

    python -m benchmarks.comparison_power -o docs/results/comparison-power.json

Minutes on one core. docs/comparing.md has the tables (`--markdown` prints them).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.formats.files import read_json, write_json
from evaluators.statistics.bootstrap import CONFIDENCE, FEWEST, difference_interval
from evaluators.statistics.sign_flips import FLIPS, LEVEL, holm, sign_flip_p_values

Scores = NDArray[np.float64]
#: Numbers of observations: the fewest with an interval, part_2 of open-s34-o7, the fewest with a corrected interval,
#: the whole of open-s34-o7, and of listen.
COUNTS = (6, 9, 20, 34, 94)
#: True differences of the mean IoU whose detection is counted.
EFFECTS = (0.02, 0.05, 0.1, 0.2)
#: Methods of the test of many pairs.
METHODS = 5
#: Resamples of the intervals: fewer than `avs3d compare` draws, to save time.
RESAMPLES = 2000
#: Kind of an interval → fewest values from which it is BCa.
KINDS = {"percentile": max(COUNTS) + 1, "BCa": FEWEST}


def ious(rng: np.random.Generator, shape: tuple[int, ...], methods: int) -> Scores:
    """IoU of equally good methods: alike in easy and hard observations, with a tenth of the objects missed by each.

    Args:
        rng: the generator.
        shape: of the simulations and observations.
        methods: how many.

    Returns:
        (*shape, methods) in [0, 1].
    """
    ease = rng.normal(1.2, 1.2, (*shape, 1))
    found = 1 / (1 + np.exp(-(ease + rng.normal(0, 0.7, (*shape, methods)))))
    return np.where(rng.random((*shape, methods)) < 0.1, 0.0, found)


def rare(rng: np.random.Generator, shape: tuple[int, ...], methods: int) -> Scores:
    """Methods that are right but for one observation in ten, as a rate of wrong instances is."""
    return (rng.random((*shape, methods)) < 0.1).astype(np.float64)


def skewed(rng: np.random.Generator, shape: tuple[int, ...], methods: int) -> Scores:
    """Methods of one mean that differ in kind: the first is steady, the others rarely much better, else a bit worse."""
    steady = np.full((*shape, 1), 0.5) + rng.normal(0, 0.02, (*shape, 1))
    others = 0.4 + rng.gamma(0.5, 0.2, (*shape, methods - 1))
    return np.concatenate([steady, others], axis=-1)


#: Name → how scores are drawn; the means of all methods are equal.
WORLDS: dict[str, Callable[[np.random.Generator, tuple[int, ...], int], Scores]] = {
    "IoU": ious, "rare errors": rare, "skewed": skewed,
}  # fmt: skip


def share(hits: int, trials: int) -> dict[str, float]:
    """A share and its standard error."""
    value = hits / trials
    return {"share": round(value, 4), "error": round(math.sqrt(value * (1 - value) / trials), 4)}


def type_1(world: str, count: int, trials: int, seed: int) -> dict[str, Any]:
    """Separations of two equally good methods, and of any of the pairs of several."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, count, list(WORLDS).index(world)]))
    two = WORLDS[world](rng, (count, trials), 2)
    wrong = int((sign_flip_p_values(two[..., 0] - two[..., 1]) < LEVEL).sum())
    several = max(1, trials // 4)
    scores = WORLDS[world](rng, (count, several), METHODS)
    pairs = [scores[..., a] - scores[..., b] for a, b in itertools.combinations(range(METHODS), 2)]
    p_values = np.stack([sign_flip_p_values(pair) for pair in pairs], axis=1)
    any_wrong = sum(min(holm(row.tolist())) < LEVEL for row in p_values)
    return {"two methods": share(wrong, trials), f"any pair of {METHODS}": share(any_wrong, several)}


def coverage(world: str, count: int, trials: int, seed: int) -> dict[str, Any]:
    """Intervals of either kind that hold the true difference, 0."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, count, 7, list(WORLDS).index(world)]))
    scores = WORLDS[world](rng, (trials, count), 2)
    hits = dict.fromkeys(KINDS, 0)
    for row in scores[..., 0] - scores[..., 1]:
        for kind, fewest in KINDS.items():
            found = difference_interval([[float(value)] for value in row], resamples=RESAMPLES, bca_fewest=fewest)
            assert found is not None  # no count is below FEWEST
            hits[kind] += found.low <= 0 <= found.high
    return {kind: share(number, trials) for kind, number in hits.items()}


def power(effect: float, count: int, trials: int, seed: int) -> dict[str, float]:
    """Separations of two methods of which one has an IoU that is higher by ``effect`` wherever it finds the object."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, count, 11, round(1000 * effect)]))
    scores = ious(rng, (count, trials), 2)
    gain = effect / 0.9  # a tenth of the objects is missed
    better = np.where(scores[..., 0] > 0, scores[..., 0] + gain, 0.0)
    return share(int((sign_flip_p_values(better - scores[..., 1]) < LEVEL).sum()), trials)


def simulate(counts: Sequence[int], trials: int, seed: int) -> dict[str, Any]:
    """Everything, by world, number of observations and effect."""
    few = max(1, trials // 4)  # intervals take longer
    return {
        "trials": trials, "trials of several methods and of intervals": few, "seed": seed, "level": LEVEL,
        "sign_flips": FLIPS, "resamples": RESAMPLES, "confidence": CONFIDENCE,
        "type I": {w: {str(n): type_1(w, n, trials, seed) for n in counts} for w in WORLDS},
        "coverage": {w: {str(n): coverage(w, n, few, seed) for n in counts if n >= FEWEST} for w in WORLDS},
        "power": {str(e): {str(n): power(e, n, trials, seed) for n in counts} for e in EFFECTS},
    }  # fmt: skip


def tables(found: Mapping[str, Any]) -> list[str]:
    """The tables of docs/comparing.md: in per cent."""
    counts = sorted(next(iter(found["power"].values())), key=int)
    worlds = [world for world in WORLDS if world in found["coverage"]]
    head = [f"| | {' | '.join(f'n = {count}' for count in counts)} |", f"|---|{'---|' * len(counts)}"]

    def row(title: str, values: Sequence[Mapping[str, float]]) -> str:
        shares = [f"{100 * value['share']:.1f}" for value in values]
        return f"| {title} | {' | '.join(shares)} |"

    several = f"any pair of {METHODS}"
    lines = ["Type I errors, per cent:", "", *head]
    for world, case in itertools.product(worlds, ("two methods", several)):
        lines.append(row(f"{world}, {case}", [found["type I"][world][count][case] for count in counts]))
    lines += ["", "Coverage of the 95 % interval, per cent:", "", *head]
    for world, kind in itertools.product(worlds, KINDS):
        lines.append(row(f"{world}, {kind}", [found["coverage"][world][count][kind] for count in counts]))
    lines += ["", "Power, per cent, of two methods:", "", *head]
    for effect in sorted(found["power"], key=float):
        lines.append(row(f"+{effect} IoU", [found["power"][effect][count] for count in counts]))
    return lines


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write the figures to this file.")
@click.option("--trials", type=click.IntRange(20), default=8000, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--markdown", type=click.Path(path_type=Path, exists=True), help="Print the tables of this file instead.")
def main(output: Path | None, trials: int, seed: int, markdown: Path | None) -> None:
    """Simulate comparisons of methods whose true difference is known."""
    found = read_json(markdown) if markdown else simulate(COUNTS, trials, seed)
    if output is not None and markdown is None:
        write_json(output, found)
    click.echo("\n".join(tables(found)))


if __name__ == "__main__":
    main()
