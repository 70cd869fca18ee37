"""The tables of docs/listener.md, from the scores that `benchmarks.listener_tables` wrote.

    python -m benchmarks.listener_page docs/results --page docs/listener.md

Replaces what is between the lines ``<!-- tables -->`` and ``<!-- end of tables -->`` of the page. With the datasets and
``--work`` it draws ``listener-<dataset>-failures.jpg`` as well (`benchmarks.listener_failures`).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from avs3d_bench.comparisons import PartOrOverall
from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import read_json, write_bytes
from avs3d_bench.media import read_record
from avs3d_bench.scores import METRICS, GroupScores, Scores
from benchmarks.listener_failures import draw_failures
from benchmarks.listener_tables import ROWS, RUN_JSON, labelled
from evaluators.comparison import compare_figure, metric_of
from evaluators.reporting.compare import estimate_text, p_text
from evaluators.reporting.paper import CITATION, DATASET, TABLE_2

BEGIN, END = "<!-- tables -->", "<!-- end of tables -->"
#: Figures of the tables of parts 1 and 2, and of part_3.
FIGURES = {
    "part_1": ("official.mIoU", "official.F", "strict.IoU", "strict.boundary_F", "strict.FP_rate"),
    "part_2": ("official.mIoU", "official.F", "strict.IoU", "strict.boundary_F", "strict.FP_rate",
               "strict.wrong_instance_rate"),
    "part_3": ("listen.pair_accuracy", "listen.IoU", "listen.FP_rate", "listen.class_mIoU"),
}  # fmt: skip
#: Rows that are compared, first minus second.
PAIRS = (
    ("2d", "no-sound"), ("2d", "wrong-sound"), ("2d", "category"), ("2d", "deaf-all"), ("2d", "deaf-single"),
    ("official", "2d"), ("official", "no-aisrm"), ("spatial", "2d"), ("spatial", "official"), ("spatial", "category"),
)  # fmt: skip
#: Figures of the comparisons.
COMPARED: dict[PartOrOverall, tuple[str, ...]] = {
    "part_1": ("strict.IoU", "official.mIoU"),
    "part_2": ("strict.IoU", "official.mIoU", "strict.wrong_instance_rate"),
    "part_3": ("listen.pair_accuracy", "listen.IoU", "listen.FP_rate"),
}
PART_TITLES = {"part_1": "one instance of the category", "part_2": "several instances", "part_3": "sound scenes"}
_TITLES = {f"{metric.protocol}.{metric.name}": f"{metric.protocol} {metric.title}" for metric in METRICS}


def value_of(group: GroupScores | None, figure: str) -> str:
    """``.812 (.770–.850)``; without an interval where there are too few observations; – where it is not available."""
    protocol, _, name = figure.partition(".")
    summary: Any = getattr(group, protocol, None)
    if summary is None or (value := getattr(summary, name)) is None:
        return "–"
    spread = summary.intervals.get(name)
    return f"{value:.3f}" + (f" ({spread[0]:.3f}–{spread[1]:.3f})" if spread else "")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a Markdown table."""
    names = list(head)
    return [f"| {' | '.join(names)} |", f"|{'---|' * len(names)}", *(f"| {' | '.join(row)} |" for row in rows), ""]


def part_table(part: str, found: Mapping[str, Scores]) -> list[str]:
    """The methods of one part, the reference rows, and the paper's own figures."""
    figures = FIGURES[part]
    rows = []
    for name, scores in found.items():
        group = scores.parts.get(part)  # type: ignore[call-overload]
        if group is not None:
            title = f"{ROWS[name].title} (n = {group.observations})"
            rows.append([title, *(value_of(group, figure) for figure in figures)])
    if not rows:
        return []
    # Reference rows are those of the observations that were scored: of the file with most of them.
    widest = max(found.values(), key=lambda scores: scores.overall.observations)
    for name, groups in widest.references.items():
        values = [value_of(groups.get(part), figure) for figure in figures]
        if any(value != "–" for value in values):
            rows.append([f"*{name.replace('_', ' ')}*", *values])
    if part in next(iter(TABLE_2.values())):
        for name, parts in TABLE_2.items():
            known = {f"official.{figure}": f"{value:.3f}" for figure, value in parts[part].items()}
            rows.append([f"paper: {name}", *(known.get(figure, "–") for figure in figures)])
    head = ["method", *(_TITLES[figure] for figure in figures)]
    return [f"**{part}**, {PART_TITLES[part]}:", "", *table(head, rows)]


def difference_table(found: Mapping[str, Scores]) -> list[str]:
    """Paired differences with intervals and p-values, which are corrected for the pairs of a part and figure."""
    rows = []
    pairs = [pair for pair in PAIRS if found.keys() >= set(pair)]
    for part, figures in COMPARED.items():
        for figure in figures:
            compared = compare_figure(found, metric_of(figure), part, pairs=pairs)
            for one in compared.differences if compared else ():
                names = f"{ROWS[one.first].title} − {ROWS[one.second].title}"
                rows.append([part, names, _TITLES[figure], estimate_text(one), p_text(one), one.verdict])
    if not rows:
        return []
    head = ("part", "rows", "figure", "difference (95 % interval)", "p", "first is")
    return ["Paired differences over the observations that both have:", "", *table(head, rows)]


def category_table(found: Mapping[str, Scores]) -> list[str]:
    """IoU per category: strict, or listen of sound scenes."""
    names = sorted({name for scores in found.values() for name in scores.categories})
    rows = []
    for name, scores in found.items():
        scenes = "part_3" in scores.parts
        values = []
        for category in names:
            group = scores.categories.get(category)
            summary = group and (group.listen if scenes else group.strict)
            value = summary.IoU if summary else None
            values.append("–" if value is None or group is None else f"{value:.3f} ({group.observations})")
        rows.append([ROWS[name].title, *values])
    if not names or not rows:
        return []
    head = ("method", *(name.replace("_", " ") for name in names))
    return ["IoU per category, and its number of observations:", "", *table(head, rows)]


def time_table(document: Mapping[str, Any]) -> list[str]:
    """Seconds and hardware of every row."""
    rows = []
    for name, entry in document["rows"].items():
        per_frame = f"{1000 * entry['seconds'] / max(1, entry['frames']):.0f} ms"
        rows.append([name, str(entry["observations"]), str(entry["frames"]), f"{entry['seconds'] / 60:.1f}", per_frame,
                     entry["hardware"]])  # fmt: skip
    return table(("row", "observations", "test frames", "minutes", "per test frame", "hardware"), rows)


def page(output: Path, pictures: Mapping[str, str]) -> str:
    """The tables as Markdown.

    Args:
        output: folder of the scores.
        pictures: label → path of the picture of failures, from the page.

    Raises:
        Avs3dError: if a file is missing or broken.
    """
    document = read_json(output / RUN_JSON)
    lines = [f"Weights with the sha256 `{document['weights'][:12]}…`.", ""]
    for label, data in document["datasets"].items():
        files = {name: output / f"listener-{label}-{name}.json" for name in ROWS}
        found = {name: read_record(path, Scores) for name, path in files.items() if path.exists()}
        if not found:
            continue
        lines += [f"### {label}", "", f"{data['name']} {data['version'] or '(official release)'}", ""]
        for part in FIGURES:
            lines += part_table(part, found)
        lines += difference_table(found)
        lines += category_table(found)
        if label in pictures:
            lines += [f"![Worst and median observations of {label}]({pictures[label]})", ""]
    lines += ["### Time", "", *time_table(document)]
    lines += [f"paper: {CITATION}; measured on {DATASET}. *Slanted*: reference rows. In brackets: 95 % intervals,",
              "bootstrap over observations, in sound scenes over groups of siblings. p: sign-flip permutation test,",
              "corrected for the compared pairs of a part and figure (Holm)."]  # fmt: skip
    return "\n".join(lines)


def insert(path: Path, text: str) -> None:
    """Put a text between the marks of a page.

    Raises:
        Avs3dError: if the marks are not there.
    """
    old = path.read_text(encoding="utf-8")
    before, begin, rest = old.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise Avs3dError(f"{path}: expected the lines {BEGIN} and {END}")
    write_bytes(path, f"{before}{BEGIN}\n\n{text}\n\n{END}{after}".encode())


@click.command()
@click.argument("output", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("datasets", nargs=-1, metavar="[LABEL=]ROOT…")
@click.option("--page", "target", type=click.Path(path_type=Path, dir_okay=False), required=True)
@click.option("--work", type=click.Path(path_type=Path), help="Folder of the run, for the pictures.")
@click.option("--images", type=click.Path(path_type=Path), help="Where the pictures go [images/ beside the page].")
def main(output: Path, datasets: tuple[str, ...], target: Path, work: Path | None, images: Path | None) -> None:
    """Write the tables of the scores in OUTPUT into a page, and draw what fails on the datasets."""
    images = images or target.parent / "images"
    try:
        for label, root in labelled(datasets).items():
            if work is None:
                raise click.UsageError("pictures need --work, the folder of the run of benchmarks.listener_tables")
            for path in draw_failures(label, root, output, work / "submissions" / label, images):
                click.echo(path)
        where = {
            path.stem.removeprefix("listener-").removesuffix("-failures"): os.path.relpath(path, target.parent)
            for path in sorted(images.glob("listener-*-failures.jpg"))
        }
        insert(target, page(output, where))
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    click.echo(target)


if __name__ == "__main__":
    main()
