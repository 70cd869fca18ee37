"""`python -m benchmarks.resampling A.json B.json…`: which differences between methods are significant?

For every figure and part, it prints the mean of each method and the difference of each pair, with 95 % intervals by
resampling the observations (`evaluators.bootstrap`: 10,000 times, percentiles). Differences are paired: the same
observations are drawn for both methods. A difference is stated only if its interval excludes 0 and there are enough
observations.

`strict.wrong_observation` is the share of observations in which the wrong object was chosen: a silent twin is marked in
some test frame, and the sounding object is missed (IoU below 0.1).

    python -m benchmarks.resampling docs/results/ambiguous-*.json --part part_2
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import click
import numpy as np

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.files import write_json
from avs3d_bench.media import read_record
from avs3d_bench.scores import METRICS, ObservationScores, Scores
from avs3d_bench.taxonomy import PARTS
from evaluators.bootstrap import FEWEST, interval

Verdict = Literal["higher", "lower", "equal", "undecided"]

WRONG_OBSERVATION = "strict.wrong_observation"
#: Figures that are compared by default.
FIGURES = ("strict.IoU", "strict.wrong_instance_rate", WRONG_OBSERVATION, "official.mIoU", "official.F")
#: Without those of part_3, whose observations come in groups and are not independent.
_KNOWN = frozenset((metric.protocol, metric.name) for metric in METRICS if metric.protocol != "listen")
#: IoU below which the sounding object counts as missed.
MISSED = 0.1


@dataclass(frozen=True)
class Estimate:
    """A mean over observations.

    Attributes:
        mean: mean of the values.
        low: lower end of its 95 % interval; None for fewer than six observations.
        high: upper end of the interval; None likewise.
        observations: number of observations.
    """

    mean: float
    low: float | None
    high: float | None
    observations: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Estimate:
        """The estimate from one value per observation; at least one value is needed."""
        low, high = interval(values) or (None, None)
        return cls(float(np.mean(values)), low, high, len(values))

    def text(self, sign: Literal["", "+"] = "") -> str:
        """The estimate in one line; ``sign``: show the sign of positive numbers, too."""
        known = self.low is not None and self.high is not None
        spread = f"{self.low:{sign}.3f} to {self.high:{sign}.3f}" if known else "no interval"
        return f"{self.mean:{sign}.3f} ({spread}; n = {self.observations})"


@dataclass(frozen=True)
class Difference:
    """Difference of one figure between two methods, over the observations for which both have it.

    Attributes:
        figure: e.g. ``strict.IoU``.
        part: ``part_1``, ``part_2`` or ``overall``.
        first: name of the first method.
        second: name of the second method.
        estimate: first − second.
        verdict: result for the first method: ``higher``, ``lower``, ``equal`` in every observation, or ``undecided``.
    """

    figure: str
    part: str
    first: str
    second: str
    estimate: Estimate
    verdict: Verdict

    def __str__(self) -> str:
        words = {
            "higher": "holds: the first is higher", "lower": "holds: the first is lower",
            "equal": "equal in every observation", "undecided": "undecided: state no difference",
        }  # fmt: skip
        return f"{self.first} − {self.second}: {self.estimate.text('+')}; {words[self.verdict]}"


def figure_of(observation: ObservationScores, figure: str) -> float | None:
    """A figure of an observation; None if it is not available.

    Raises:
        UsageError: if there is no such figure.
    """
    protocol, _, name = figure.partition(".")
    if figure == WRONG_OBSERVATION:
        rate, iou = (figure_of(observation, f"strict.{known}") for known in ("wrong_instance_rate", "IoU"))
        return None if rate is None or iou is None else float(rate > 0 and iou < MISSED)
    if protocol not in ("official", "strict") or (protocol, name) not in _KNOWN:
        raise UsageError(f"figure {figure!r}: expected one of {', '.join(sorted({*map('.'.join, _KNOWN), *FIGURES}))}")
    value: float | None = getattr(getattr(observation, protocol), name, None)
    return value


def values_of(scores: Scores, figure: str, part: str) -> dict[str, float]:
    """Key → figure, of the observations of a part (or ``overall``) that have it."""
    found = ((o.key, figure_of(o, figure)) for o in scores.observations if part in ("overall", o.part))
    return {key: value for key, value in found if value is not None}


def difference(figure: str, part: str, first: tuple[str, Scores], second: tuple[str, Scores]) -> Difference | None:
    """First minus second over the observations that both have; None without common observations."""
    (name, scores), (other, others) = first, second
    mine, theirs = values_of(scores, figure, part), values_of(others, figure, part)
    paired = [mine[key] - theirs[key] for key in sorted(mine.keys() & theirs.keys())]
    if not paired:
        return None
    estimate = Estimate.of(paired)
    return Difference(figure, part, name, other, estimate, _verdict(paired, estimate))


def _verdict(paired: Sequence[float], estimate: Estimate) -> Verdict:
    if not any(paired):
        return "equal"
    if estimate.low is None or estimate.high is None or estimate.observations < FEWEST:
        return "undecided"
    return "higher" if estimate.low > 0 else "lower" if estimate.high < 0 else "undecided"


def read_scores(paths: Iterable[Path]) -> dict[str, Scores]:
    """Name of the file without its suffix → scores.

    Raises:
        UsageError: if two files have one name.
        Avs3dError: if a file is broken, or they are not of one dataset.
    """
    found: dict[str, Scores] = {}
    first: tuple[Path, tuple[object, ...]] | None = None
    for path in paths:
        if path.stem in found:
            raise UsageError(f"{path}: another file has the name {path.stem}, too; rename one of them")
        scores = found[path.stem] = read_record(path, Scores)
        data = scores.dataset
        same = (data.name, data.version, data.sha256)
        if first is not None and same != first[1]:
            raise Avs3dError(
                f"{path}: scored on {_named(same)}, {first[0]} on {_named(first[1])}; expected one dataset"
            )
        first = first or (path, same)
    return found


def _named(dataset: tuple[object, ...]) -> str:
    name, version, digest = dataset
    return f"{name} {version or '(official release)'}" + (f" ({str(digest)[:12]})" if digest else "")


def differences(methods: Mapping[str, Scores], figures: Sequence[str], parts: Sequence[str]) -> list[Difference]:
    """Every pair of methods, in the order given, for every part and figure that both have."""
    return [
        found
        for part in parts
        for figure in figures
        for first, second in itertools.combinations(methods.items(), 2)
        if (found := difference(figure, part, first, second)) is not None
    ]


def _means(methods: Mapping[str, Scores], figure: str, part: str) -> dict[str, Estimate]:
    values = {name: list(values_of(scores, figure, part).values()) for name, scores in methods.items()}
    return {name: Estimate.of(found) for name, found in values.items() if found}


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="SCORES.json…")
@click.option("--part", "parts", multiple=True, type=click.Choice([*PARTS, "overall"]), help="Repeatable [every].")
@click.option("--figure", "figures", multiple=True, default=FIGURES, show_default=True, help="Repeatable.")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Also write the figures to this file.")
def main(files: tuple[Path, ...], parts: tuple[str, ...], figures: tuple[str, ...], output: Path | None) -> None:
    """Print means and paired differences of files of scores, with intervals over resampled observations."""
    try:
        methods = read_scores(files)
        wanted = parts or (*PARTS, "overall")
        means = {part: {figure: _means(methods, figure, part) for figure in figures} for part in wanted}
        found = differences(methods, figures, wanted)
        if output is not None:
            plain = {p: {f: {n: asdict(e) for n, e in m.items()} for f, m in fs.items()} for p, fs in means.items()}
            write_json(output, {"means": plain, "differences": [asdict(each) for each in found]})
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    for part in wanted:
        for figure in figures:
            if means[part][figure]:
                click.echo(f"{part}, {figure}")
            for name, estimate in means[part][figure].items():
                click.echo(f"  {name}: {estimate.text()}")
            for each in found:
                if (each.part, each.figure) == (part, figure):
                    click.echo(f"  {each}")


if __name__ == "__main__":
    main()
