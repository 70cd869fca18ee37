"""`python -m benchmarks.resampling A.json B.json…`: which differences between methods are significant?

For every figure and part, it prints the mean of each method and the difference of each pair, with 95 % intervals by
resampling the observations (`evaluators.bootstrap`: 10,000 times, percentiles). Differences are paired: the same
observations are drawn for both methods. A difference is stated only if its interval excludes 0 and there are enough
observations. Under ``listen`` whole groups of siblings are drawn, and `listen.pair_accuracy` has one value per group.

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
from evaluators.bootstrap import FEWEST, clustered_interval, interval
from evaluators.pairs import group_accuracies

Verdict = Literal["higher", "lower", "equal", "undecided"]

WRONG_OBSERVATION = "strict.wrong_observation"
#: Figures that are compared by default.
FIGURES = ("strict.IoU", "strict.wrong_instance_rate", WRONG_OBSERVATION, "official.mIoU", "official.F")
#: As above, of files that have scores of part_3.
LISTEN_FIGURES = ("listen.pair_accuracy", "listen.IoU", "listen.FP_rate", "listen.class_mIoU")
_PAIRS = "listen.pair_accuracy"
_KNOWN = frozenset((metric.protocol, metric.name) for metric in METRICS)
#: IoU below which the sounding object counts as missed.
MISSED = 0.1


@dataclass(frozen=True)
class Estimate:
    """A mean over observations.

    Attributes:
        mean: mean of the values.
        low: lower end of its 95 % interval; None for fewer than six observations (under ``listen``: groups).
        high: upper end of the interval; None likewise.
        observations: number of values: observations, or groups for the pair accuracy.
    """

    mean: float
    low: float | None
    high: float | None
    observations: int

    @classmethod
    def of(cls, values: Sequence[float], groups: Sequence[str] | None = None) -> Estimate:
        """The estimate from at least one value.

        Args:
            values: one per observation.
            groups: of each value, the group that is drawn as a whole; None: the values are independent.
        """
        if groups is None:
            found = interval(values)
        else:
            clusters: dict[str, list[float]] = {}
            for value, group in zip(values, groups, strict=True):
                clusters.setdefault(group, []).append(value)
            found = clustered_interval(list(clusters.values()))
        low, high = found or (None, None)
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
        part: ``part_1``, ``part_2``, ``part_3`` or ``overall``.
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
    if (protocol, name) not in _KNOWN:
        raise UsageError(f"figure {figure!r}: expected one of {', '.join(sorted({*map('.'.join, _KNOWN), *FIGURES}))}")
    value: float | None = getattr(getattr(observation, protocol), name, None)
    return value


def values_of(scores: Scores, figure: str, part: str) -> dict[str, float]:
    """Key → figure, of the observations of a part (or ``overall``) that have it.

    For the pair accuracy: of the groups, whose keys are those of all siblings that were scored.
    """
    if figure == _PAIRS:
        keys = [o.key for o in scores.observations if part in ("overall", o.part)]
        names = {one.group: " ".join(one.observations) for one in scores.siblings or ()}
        return {names[group]: value for group, value in group_accuracies(scores.siblings or (), keys).items()}
    found = ((o.key, figure_of(o, figure)) for o in scores.observations if part in ("overall", o.part))
    return {key: value for key, value in found if value is not None}


def _estimate(scores: Scores, figure: str, values: Mapping[str, float]) -> Estimate:
    """The estimate from values by key, as `values_of` returns them."""
    if not figure.startswith("listen."):
        return Estimate.of(list(values.values()))
    groups = {o.key: o.group or o.key for o in scores.observations}
    return Estimate.of(list(values.values()), [groups.get(key, key) for key in values])


def difference(figure: str, part: str, first: tuple[str, Scores], second: tuple[str, Scores]) -> Difference | None:
    """First minus second over the observations that both have; None without common observations."""
    (name, scores), (other, others) = first, second
    mine, theirs = values_of(scores, figure, part), values_of(others, figure, part)
    paired = {key: mine[key] - theirs[key] for key in sorted(mine.keys() & theirs.keys())}
    if not paired:
        return None
    estimate = _estimate(scores, figure, paired)
    return Difference(figure, part, name, other, estimate, _verdict(list(paired.values()), estimate))


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
    values = {name: values_of(scores, figure, part) for name, scores in methods.items()}
    return {name: _estimate(methods[name], figure, found) for name, found in values.items() if found}


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="SCORES.json…")
@click.option("--part", "parts", multiple=True, type=click.Choice([*PARTS, "overall"]), help="Repeatable [every].")
@click.option(
    "--figure", "figures", multiple=True,
    help=f"Repeatable [{', '.join(FIGURES)}; with part_3 also {', '.join(LISTEN_FIGURES)}].",
)  # fmt: skip
@click.option("--json", "output", type=click.Path(path_type=Path), help="Also write the figures to this file.")
def main(files: tuple[Path, ...], parts: tuple[str, ...], figures: tuple[str, ...], output: Path | None) -> None:
    """Print means and paired differences of files of scores, with intervals over resampled observations."""
    try:
        methods = read_scores(files)
        wanted = parts or (*PARTS, "overall")
        scenes = any(scores.siblings is not None for scores in methods.values())
        figures = figures or (*FIGURES, *(LISTEN_FIGURES if scenes else ()))
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
