"""`python -m benchmarks.home_coverage`: how often a 95 % interval holds the true mean, if homes differ.

Values of groups (or observations) are drawn with a known variance between homes and within a home, and the interval of
their mean is computed as the evaluator does, homes first, and as if all groups were of one home.

    python -m benchmarks.home_coverage -o docs/results/home-coverage.json

Minutes on one core. docs/comparing.md has the table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from avs3d_bench.formats.files import write_json
from evaluators.statistics.bootstrap import clustered_interval

#: Homes, and groups in each.
SIZES = ((2, 12), (4, 6), (8, 3), (24, 3))
#: Standard deviation of the homes' means, and of the groups in a home.
SPREADS = ((0.0, 0.2), (0.05, 0.2), (0.1, 0.15), (0.15, 0.15), (0.15, 0.1), (0.2, 0.0))
TRIALS, RESAMPLES, SEED = 1000, 1000, 0
_MEAN = 0.5


def coverage(
    homes: int, groups: int, between: float, within: float, *, trials: int = TRIALS, seed: int = SEED
) -> tuple[float, float]:
    """Share of the intervals that hold the true mean: with homes resampled first, and with groups alone.

    Args:
        homes: how many.
        groups: in each home.
        between: standard deviation of the homes' means.
        within: standard deviation of the groups in a home.
        trials: intervals of each kind.
        seed: of the values.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, homes, groups]))
    names = np.repeat(np.arange(homes), groups).tolist()
    held = np.zeros(2)
    for _ in range(trials):
        values = _MEAN + np.repeat(rng.normal(0, between, homes), groups) + rng.normal(0, within, homes * groups)
        clusters = [[value] for value in values.tolist()]
        for place, labels in enumerate((names, None)):
            found = clustered_interval(clusters, homes=labels, resamples=RESAMPLES)
            assert found is not None
            held[place] += found[0] <= _MEAN <= found[1]
    nested, alone = held / trials
    return float(nested), float(alone)


def table(document: dict[str, Any]) -> str:
    """The Markdown table of a document that `main` wrote."""
    sizes = list(dict.fromkeys((one["homes"], one["groups"]) for one in document["entries"]))
    head = [f"{homes} homes of {groups}" for homes, groups in sizes]
    lines = [f"| σ of homes | σ within | resampled | {' | '.join(head)} |", "|---" * (3 + len(head)) + "|"]
    for between, within in dict.fromkeys((one["between"], one["within"]) for one in document["entries"]):
        found = [one for one in document["entries"] if (one["between"], one["within"]) == (between, within)]
        for kind, title in (("nested", "homes, groups"), ("groups_alone", "groups alone")):
            cells = " | ".join(f"{100 * one[kind]:.0f}" for one in found)
            lines.append(f"| {between:g} | {within:g} | {title} | {cells} |")
    return "\n".join(lines)


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="The JSON file.")
@click.option("--trials", type=int, default=TRIALS, show_default=True)
def main(output: Path, trials: int) -> None:
    """Write the coverage of every number of homes and every spread."""
    entries = []
    for between, within in SPREADS:
        for homes, groups in SIZES:
            nested, alone = coverage(homes, groups, between, within, trials=trials)
            entries.append({"homes": homes, "groups": groups, "between": between, "within": within,
                            "nested": nested, "groups_alone": alone})  # fmt: skip
    document = {"trials": trials, "resamples": RESAMPLES, "entries": entries}
    write_json(output, document)
    click.echo(table(document))


if __name__ == "__main__":
    main()
