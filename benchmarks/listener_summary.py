"""What the tables of the listener say besides the figures: how each row was made, and pairs of twins by themselves.

Under ``listen`` most pairs of siblings can be told apart by the category that sounds. In a pair of twins, one object
sounds alone in each sibling, and both are of one category: direction and distance alone tell them apart.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from avs3d_bench.contract.scores import Scores
from avs3d_bench.formats.files import read_json
from avs3d_bench.formats.media import read_record
from benchmarks.listener_tables import ROWS, RUN_JSON
from evaluators.metrics.masks import mean
from generators.manifest.reading import read_manifest

#: Manifests of datasets whose scores by `listen` 1.0 are published: NAME-1.0.0.yaml, beside the scores.
MANIFESTS = Path(__file__).parent.parent / "docs" / "results"
#: Datasets and their parts whose strict IoU is in the summary, with short headings; the dataset whose part_3 is.
SUMMARY = {
    ("open-s34-o7", "part_1"): "open part_1", ("open-s34-o7", "part_2"): "open part_2",
    ("open-s34-o7-sh3d", "part_1"): "sh3d part_1", ("open-s34-o7-sh3d", "part_2"): "sh3d part_2",
}  # fmt: skip
SCENES = "listen"
SUMMARY_ROWS = ("category", "2d", "wrong-sound", "official", "spatial")
#: Text of a figure that is not there.
MISSING = "–"

Pair = frozenset[str]


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a Markdown table."""
    names = list(head)
    return [f"| {' | '.join(names)} |", f"|{'---|' * len(names)}", *(f"| {' | '.join(row)} |" for row in rows), ""]


def twin_pairs(dataset: str) -> frozenset[Pair]:
    """Keys of the pairs of twins of version 1.0.0 of a dataset; empty where its manifest is not kept.

    Raises:
        Avs3dError: if the manifest is broken.
    """
    path = MANIFESTS / f"{dataset}-1.0.0.yaml"
    if not path.exists():
        return frozenset()
    alone: dict[tuple[str, str], list[str]] = {}
    for spec in read_manifest(path).manifest.observations:
        sources = spec.sources or ()
        if len(sources) == 1 and sources[0].room is None:
            # Siblings share part, scan and room; pairs of other groups are in no file of scores.
            place = str(spec.key).rpartition("/")[0]
            alone.setdefault((place, sources[0].category), []).append(str(spec.key))
    return frozenset(frozenset((a, b)) for keys in alone.values() for a in keys for b in keys if a != b)


def twin_accuracy(scores: Scores, twins: Collection[Pair]) -> float | None:
    """Pair accuracy over pairs of twins: mean over the groups that have a pair-frame of them; None without one.

    Args:
        scores: those of `listen` 1.1 name the kind of each pair.
        twins: the pairs of twins, for scores of `listen` 1.0.
    """
    shares = []
    for group in scores.siblings or ():
        chosen = [
            pair
            for pair in group.pairs
            if (pair.kind == "twins" if pair.kind else frozenset((pair.first, pair.second)) in twins)
        ]
        if frames := sum(pair.frames for pair in chosen):
            shares.append(sum(pair.right for pair in chosen) / frames)
    return mean(shares)


def looks_text(settings: Mapping[str, Any]) -> str:
    """How often the network looked at a picture."""
    return "one look" if settings["looks"] == "one" else f"{settings['looks']} looks"


def settings_text(settings: Mapping[str, Any]) -> str:
    """How a row was made, from the record of its run; empty for one with nothing to set."""
    said = []
    if "looks" in settings:
        said.append(looks_text(settings))
    if iterations := settings.get("iterations"):
        said.append(f"{iterations:,} iterations")
    if most := settings.get("max_gaussians"):
        said.append(f"at most {most:,} Gaussians")
    if (threshold := settings.get("voting_threshold")) is not None:
        said.append(f"votes above {share(threshold, 1)} of {settings.get('voting_threshold_of', 'all votes')}")
    return ", ".join(said)


def settings_lines(rows: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> list[str]:
    """A list of how rows were made, where there is anything to say.

    Args:
        rows: row → label of a dataset → its settings.
    """
    made: dict[tuple[str, str], list[str]] = {}
    for name, labels in rows.items():
        for label, settings in labels.items():
            if text := settings_text(settings):
                made.setdefault((name, text), []).append(label)
    lines = []
    for (name, text), where in made.items():
        which = "" if len(where) == len(rows[name]) else f" ({', '.join(where)})"
        lines.append(f"- {ROWS[name].title}{which}: {text}")
    return ["How the rows were made:", "", *lines, ""] if lines else []


def summary(output: Path) -> str:
    """The headline figures as Markdown: a table, the versions of its datasets, and how its rows were made.

    Args:
        output: folder of the scores.

    Raises:
        Avs3dError: if a file is missing or broken.
    """
    document = read_json(output / RUN_JSON)
    twins = twin_pairs(document["datasets"][SCENES]["name"])
    rows = []
    for name in SUMMARY_ROWS:
        values = [_strict_iou(_scores(output, dataset, name), part) for dataset, part in SUMMARY]
        scenes = _scores(output, SCENES, name)
        every = scenes.overall.listen.pair_accuracy if scenes.overall.listen else None
        rows.append([ROWS[name].title, *map(share, [*values, every, twin_accuracy(scenes, twins)])])
    head = ["method", *SUMMARY.values(), f"{SCENES}, all pairs", f"{SCENES}, twins"]
    labels = [*dict.fromkeys(dataset for dataset, _ in SUMMARY), SCENES]
    made = {name: {label: document["rows"][f"{label}-{name}"]["settings"] for label in labels} for name in SUMMARY_ROWS}
    versions = [_version(_scores(output, label, SUMMARY_ROWS[0])) for label in labels]
    return "\n".join([*table(head, rows), f"Measured on {', '.join(versions)}.", "", *settings_lines(made)]).rstrip()


def _version(scores: Scores) -> str:
    return f"`{scores.submission.dataset}` {scores.submission.dataset_version}"


def _scores(output: Path, label: str, name: str) -> Scores:
    return read_record(output / f"listener-{label}-{name}.json", Scores)


def _strict_iou(scores: Scores, part: str) -> float | None:
    group = scores.parts.get(part)  # type: ignore[call-overload]
    return group.strict.IoU if group is not None and group.strict is not None else None


def share(value: float | None, digits: int = 3) -> str:
    """``.812``, ``1.000``; `MISSING` for None."""
    return MISSING if value is None else f"{value:.{digits}f}".removeprefix("0")
