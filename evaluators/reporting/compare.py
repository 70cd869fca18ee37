"""`avs3d compare`: from files of scores to the record of their paired differences.

Only what was measured alike is compared: one dataset, one truth, one version of a protocol. Anything else is a usage
error in one line that names the two files.
"""

from __future__ import annotations

import functools
import operator
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from avs3d_bench import __version__
from avs3d_bench.commands.report import printable
from avs3d_bench.contract.comparisons import (
    ComparedDataset,
    ComparedFile,
    Comparer,
    Comparison,
    FigureComparison,
    PairedDifference,
    PartOrOverall,
)
from avs3d_bench.contract.layout import parse_key
from avs3d_bench.contract.scores import PROTOCOL_PARTS, PROTOCOLS, Metric, Protocol, metrics_of
from avs3d_bench.errors import UsageError
from evaluators.reporting.leaderboard import read_entry
from evaluators.reporting.ranking import ScoresEntry, ScoringRule, dataset_identity, rulers_of, truth_figures
from evaluators.statistics.bootstrap import RESAMPLES, SEED, homes_note
from evaluators.statistics.comparison import WARN_BELOW, compare_figure, metric_of
from evaluators.statistics.sign_flips import LEVEL, flips_for

#: Characters of a list of names in a message.
_NAMED = 300


def compare(
    score_files: Sequence[Path],
    *,
    protocols: Sequence[Protocol] = (),
    parts: Sequence[PartOrOverall] = (),
    figures: Sequence[str] = (),
) -> Comparison:
    """Compare methods by their files of scores, each with each.

    Args:
        score_files: two or more, written by ``avs3d-eval --json``; a file given twice counts once.
        protocols: those to compare; none: those that all files have.
        parts: those to compare; none: every part, and ``overall`` if there are several.
        figures: those to compare, such as ``strict.IoU``; none: all of the protocols.

    Raises:
        UsageError: if the files cannot be compared, or have fewer than two observations in common.
        Avs3dError: if a file is broken.

    Examples:
        >>> from pathlib import Path
        >>> files = [Path("data/demo-scores/oracle.json"), Path("data/demo-scores/centre-box.json")]
        >>> comparison = compare(files, figures=["official.mIoU"])
        >>> comparison
        Comparison(oracle, centre-box on demo: 1 figures)
        >>> difference = comparison.figures[-1].differences[0]
        >>> difference.first, difference.second, round(difference.mean, 3), difference.verdict
        ('oracle', 'centre-box', 0.434, 'undecided')
    """
    metrics = [metric_of(figure) for figure in figures]
    entries = _read(score_files)
    _check_dataset(entries)
    rulers = _rulers(entries, protocols or tuple(dict.fromkeys(metric.protocol for metric in metrics)))
    metrics = metrics or [metric for ruler in rulers for metric in metrics_of(ruler.protocol)]
    for ruler in rulers:
        _check_truth(entries, ruler)
    common = _common(entries)
    if len(common) < 2:
        raise UsageError(
            f"{_files(entries)}: {len(common)} observation{'' if len(common) == 1 else 's'} in common; a comparison "
            "needs at least 2: score more observations"
        )
    found = _figures(entries, metrics, parts or _parts(common))
    enough = [figure for figure in found if any(one.units > 1 for one in figure.differences)]
    if not enough:
        raise UsageError(
            f"{_files(entries)}: no figure of {', '.join(parts) or 'any part'} has at least 2 observations in common "
            f"under {', '.join(dict.fromkeys(metric.protocol for metric in metrics))}; choose another --part, "
            "--protocol or --figure, or score more observations"
        )
    return Comparison(
        avs3d_compare=Comparer(
            version=__version__,
            protocols={ruler.protocol: ruler.version for ruler in rulers},  # type: ignore[misc]
            bootstrap_resamples=RESAMPLES,
            sign_flips=flips_for(len(entries) * (len(entries) - 1) // 2),
            seed=SEED,
            level=LEVEL,
        ),
        dataset=_dataset(next(iter(entries.values()))),
        files=tuple(_file(name, entry) for name, entry in entries.items()),
        figures=tuple(enough),
        warnings=(*_oracles(entries), *_uncommon(entries, common), *_few(found), *_homes(found, common)),
    )


def _read(score_files: Sequence[Path]) -> dict[str, ScoresEntry]:
    """Name → entry, in the order given."""
    found: dict[str, ScoresEntry] = {}
    for path in dict.fromkeys(map(Path, score_files)):
        entry = read_entry(path, reports=False)
        found.setdefault(entry.digest, entry)
    if len(found) < 2:
        given = printable(str(score_files[0])) if score_files else "no file of scores"
        raise UsageError(f"{given}: nothing to compare with; expected two or more files with different scores")
    stems = Counter(entry.source.stem for entry in found.values())
    named = {}
    for entry in found.values():
        name = printable(entry.source.stem if stems[entry.source.stem] == 1 else str(entry.source))
        named[name] = replace(entry, name=name)
    return named


def _files(entries: Mapping[str, ScoresEntry]) -> str:
    text = ", ".join(printable(str(entry.source)) for entry in entries.values())
    return text if len(text) <= _NAMED else text[:_NAMED] + "…"


def _check_dataset(entries: Mapping[str, ScoresEntry]) -> None:
    first, *others = entries.values()
    for entry in others:
        if dataset_identity(entry) != dataset_identity(first):
            raise UsageError(
                f"{printable(str(entry.source))}: scored on {_dataset_text(entry)}, {printable(str(first.source))} on "
                f"{_dataset_text(first)}; expected one dataset: score both submissions on the same"
            )


def _dataset_text(entry: ScoresEntry) -> str:
    data = entry.scores.dataset
    version = data.version or "(official release)"
    digest = f", sha256 {data.sha256[:12]}" if data.sha256 else ""
    return printable(f"{data.name} {version} ({data.observations} observations{digest})")


def _rulers(entries: Mapping[str, ScoresEntry], wanted: Iterable[Protocol]) -> tuple[ScoringRule, ...]:
    """The protocols to compare, which all files have in one version.

    Raises:
        UsageError: naming the first file that differs.
    """
    known = [{ruler.protocol: ruler for ruler in rulers_of(entry)} for entry in entries.values()]
    chosen = tuple(wanted) or tuple(name for name in PROTOCOLS if all(name in rulers for rulers in known))
    first, *others = zip(entries.values(), known, strict=True)
    if not chosen:
        entry, rulers = next(each for each in others if not each[1].keys() & first[1].keys()) if others else first
        raise UsageError(
            f"{printable(str(entry.source))}: protocol {', '.join(rulers)}; {printable(str(first[0].source))}: "
            f"{', '.join(first[1])}; expected one in common: score both submissions with it (avs3d-eval --protocol)"
        )
    for name in chosen:
        for entry, rulers in (first, *others):
            where = printable(str(entry.source))
            if name not in rulers:
                raise UsageError(
                    f"{where}: not scored under protocol {name}, only {', '.join(rulers)}; score the submission with "
                    "it (avs3d-eval --protocol) or choose another"
                )
            if rulers[name] != first[1][name]:
                raise UsageError(
                    f"{where}: {_ruler_text(rulers[name])}, {printable(str(first[0].source))}: "
                    f"{_ruler_text(first[1][name])}; expected one version: score both with one evaluator"
                )
    return tuple(first[1][name] for name in chosen)


def _ruler_text(ruler: ScoringRule) -> str:
    voxels = "" if ruler.voxel_size is None else f" with voxels of {ruler.voxel_size:g} m"
    return f"protocol {ruler.protocol} {ruler.version}{voxels}"


def _check_truth(entries: Mapping[str, ScoresEntry], ruler: ScoringRule) -> None:
    """The reference rows depend on the truth alone: those of files with the same observations must be equal."""
    first: dict[object, tuple[ScoresEntry, object]] = {}
    for entry in entries.values():
        observations, rows = truth_figures(entry, ruler)
        known, expected = first.setdefault(observations, (entry, rows))
        if rows != expected:
            raise UsageError(
                f"{printable(str(entry.source))}: its reference rows differ from those of "
                f"{printable(str(known.source))}: {_why(entry, known)}"
            )
    frames: dict[str, tuple[ScoresEntry, int]] = {}
    for entry in entries.values():
        for row in entry.scores.observations:
            known, count = frames.setdefault(row.key, (entry, row.frames))
            if row.frames != count:
                raise UsageError(
                    f"{printable(str(entry.source))}: {printable(row.key)}: {row.frames} test frames, in "
                    f"{printable(str(known.source))} {count}: they were not scored against the same ground truth"
                )


def _why(entry: ScoresEntry, known: ScoresEntry) -> str:
    """Why the reference rows of two files with the same observations differ, as far as the files tell."""
    mine, theirs = entry.scores, known.scores
    truth = mine.dataset.truth_digest
    versions = [scores.avs3d_eval.version for scores in (mine, theirs)]
    if truth is not None and truth == theirs.dataset.truth_digest:
        return (
            f"the ground truth is the same (dataset.truth_digest), so the figures were computed otherwise, by versions "
            f"{versions[0]} and {versions[1]} of the evaluator: score both submissions again with one"
        )
    if truth is None or theirs.dataset.truth_digest is None:
        return (
            "they were not scored against the same ground truth, or by evaluators of which a metric changed (versions "
            f"{versions[0]} and {versions[1]}): score both submissions again with one"
        )
    return "they were not scored against the same ground truth (dataset.truth_digest): score both on one dataset"


def _common(entries: Mapping[str, ScoresEntry]) -> list[str]:
    """Keys of the observations that all files have, sorted."""
    return sorted(
        functools.reduce(operator.and_, ({row.key for row in one.scores.observations} for one in entries.values()))
    )


def _parts(keys: Iterable[str]) -> tuple[PartOrOverall, ...]:
    known = {key.split("/")[0] for key in keys}
    parts: tuple[PartOrOverall, ...] = ("part_1", "part_2", "part_3")
    found = tuple(part for part in parts if part in known)
    return found if len(found) == 1 else (*found, "overall")


def _figures(
    entries: Mapping[str, ScoresEntry], metrics: Iterable[Metric], parts: Iterable[PartOrOverall]
) -> list[FigureComparison]:
    methods = {name: entry.scores for name, entry in entries.items()}
    return [
        found
        for part in parts
        for metric in metrics
        if part == "overall" or part in PROTOCOL_PARTS[metric.protocol]
        if (found := compare_figure(methods, metric, part)) is not None
    ]


def _oracles(entries: Mapping[str, ScoresEntry]) -> list[str]:
    """A line for each file whose masks were made from the ground truth: a leaderboard does not rank it."""
    return [
        printable(f"{name}: made from the ground truth ({entry.truth}): no result of a method")
        for name, entry in entries.items()
        if entry.truth is not None
    ]


def _uncommon(entries: Mapping[str, ScoresEntry], common: Sequence[str]) -> list[str]:
    """A line if the files do not hold the same observations."""
    counts = {name: len(entry.scores.observations) for name, entry in entries.items()}
    if all(count == len(common) for count in counts.values()):
        return []
    text = ", ".join(f"{name} {count}" for name, count in counts.items())
    return [f"observations differ ({text}): each pair of methods is compared over those that both have"]


def _homes(found: Iterable[FigureComparison], keys: Iterable[str]) -> list[str]:
    """A line if there are intervals, and the observations lie in few homes."""
    intervals = any(one.interval for figure in found for one in figure.differences)
    note = homes_note([parse_key(key).scan for key in keys]) if intervals else None
    return [note] if note else []


def _few(found: Iterable[FigureComparison]) -> list[str]:
    """A line for each part and number of units below `WARN_BELOW`."""
    figures: dict[tuple[str, int, str], list[str]] = {}
    pairs: Counter[tuple[str, int, str]] = Counter()
    for figure in found:
        if not figure.differences:
            continue
        unit = "group of siblings" if figure.protocol == "listen" else "observation"
        least = min(one.units for one in figure.differences)
        if least < WARN_BELOW:
            case = (figure.part, least, unit)
            figures.setdefault(case, []).append(f"{figure.protocol}.{figure.figure}")
            pairs[case] = max(pairs[case], len(figure.differences))
    return [_few_text(case, names, pairs[case]) for case, names in figures.items()]


def _few_text(case: tuple[str, int, str], names: Sequence[str], pairs: int) -> str:
    part, count, unit = case
    text = f"{part}: {count} {unit if count == 1 else unit.replace(unit.split()[0], unit.split()[0] + 's', 1)} of "
    text += ", ".join(names)
    if count == 1:
        return f"{text}: not compared; a comparison needs at least 2"
    least = 2 / 2**count
    corrected = f", {min(1.0, pairs * least):.2g} after correction for {pairs} pairs" if pairs > 1 else ""
    return f"{text}, fewer than {WARN_BELOW}: no p-value is below {least:.2g}{corrected}; intervals are too narrow"


def _dataset(entry: ScoresEntry) -> ComparedDataset:
    data = entry.scores.dataset
    return ComparedDataset(name=data.name, version=data.version, sha256=data.sha256, observations=data.observations)


def _file(name: str, entry: ScoresEntry) -> ComparedFile:
    return ComparedFile(
        name=name,
        method=entry.scores.submission.method,
        sha256=entry.digest,
        scored=len(entry.scores.observations),
    )


def comparison_lines(comparison: Comparison) -> list[str]:
    """The comparison as text for a terminal: methods with their places, then every pair."""
    data = comparison.dataset
    versions = ", ".join(f"{name} {version}" for name, version in comparison.avs3d_compare.protocols.items())
    lines = [printable(f"{data.name} {data.version or '(official release)'}; protocols {versions}")]
    for figure in comparison.figures:
        metric = metric_of(f"{figure.protocol}.{figure.figure}")
        unit = f" ({metric.unit})" if metric.unit else ""
        better = "higher is better" if figure.higher_is_better else "lower is better"
        lines += ["", f"{figure.part}, {figure.protocol} {metric.title}{unit}, {better}"]
        width = max(len(method.name) for method in figure.methods)
        lines += [f"  {one.place:>3}. {one.name:<{width}}  {one.mean:.3f}" for one in figure.methods]
        lines += [f"  {difference_text(one)}" for one in figure.differences]
    return lines


def difference_text(one: PairedDifference) -> str:
    """One pair in a line: difference, interval, number of values, p-values, and what follows from them."""
    return f"{one.first} − {one.second}: {estimate_text(one)}, p = {p_text(one)}; {verdict_text(one)}"


def estimate_text(one: PairedDifference) -> str:
    """``+0.195 (+0.078 to +0.395; n = 9)``."""
    spread = "no interval" if one.interval is None else " to ".join(map(_signed, one.interval))
    groups = f" in {one.units} groups" if one.units != one.observations else ""
    return f"{_signed(one.mean)} ({spread}; n = {one.observations}{groups})"


def _signed(value: float) -> str:
    """Three decimals, or two digits of a smaller number."""
    text = f"{value:+.3f}"
    return f"{value:+.1e}" if value and float(text) == 0 else text.replace("+0.000", "0").replace("-0.000", "0")


def p_text(one: PairedDifference) -> str:
    """``0.0039``, and the corrected one if it differs: ``0.0039, corrected 0.012``."""
    corrected = f", corrected {one.p_holm:.2g}" if one.p_holm != one.p else ""
    return f"{one.p:.2g}{corrected}"


def verdict_text(one: PairedDifference) -> str:
    """The conclusion about the two methods."""
    return {
        "better": f"{one.first} is better", "worse": f"{one.second} is better",
        "equal": "equal in every observation", "undecided": "not separated",
    }[one.verdict]  # fmt: skip
