"""The pages of datasets in docs/results, from the scores that `benchmarks.listener_tables` wrote.

    python -m benchmarks.listener_page SCORES [LABEL=]ROOT… --work DIR --page PAGE

Writes a page for each dataset, ``results/listener-<dataset>.md`` beside PAGE, and replaces what is between the lines
``<!-- tables -->`` and ``<!-- end of tables -->`` of PAGE: links to them. With the datasets and ``--work`` it draws
``listener-<dataset>-failures.jpg`` as well (`benchmarks.listener_failures`). The pages of docs/ are written by
`benchmarks.docs_tables`, which uses `pages`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from avs3d_bench.contract.comparisons import PartOrOverall
from avs3d_bench.contract.scores import METRICS, GroupScores, Scores
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_bytes
from avs3d_bench.formats.media import read_record
from benchmarks.listener_failures import draw_failures
from benchmarks.listener_summary import (
    looks_text,
    settings_lines,
    table,
)
from benchmarks.listener_tables import ROWS, RUN_JSON, labelled
from evaluators.reporting.compare import estimate_text, p_text
from evaluators.reporting.paper import CITATION, DATASET, TABLE_2
from evaluators.statistics.comparison import compare_figure, metric_of

#: Name of the block of the overview (`insert`).
TABLES = "tables"
#: Figures of the tables of parts 1 and 2, and of part_3.
FIGURES = {
    "part_1": ("official.mIoU", "official.F", "strict.IoU", "strict.boundary_F", "strict.FP_rate"),
    "part_2": ("official.mIoU", "official.F", "strict.IoU", "strict.boundary_F", "strict.FP_rate",
               "strict.wrong_instance_rate"),
    "part_3": ("listen.pair_accuracy", "listen.twins", "listen.IoU", "listen.FP_rate", "listen.class_mIoU"),
}  # fmt: skip
#: Rows that are compared, first minus second.
PAIRS = (
    ("2d", "no-sound"), ("2d", "wrong-sound"), ("2d", "swapped-ears"), ("2d", "category"), ("2d", "deaf-all"),
    ("2d", "deaf-single"), ("direction", "2d"), ("both", "direction"), ("spatial", "direction"),
    ("official", "2d"), ("official", "no-aisrm"), ("spatial", "2d"), ("spatial", "official"), ("spatial", "category"),
    ("spatial-direction", "direction"), ("spatial-direction", "spatial"),
)  # fmt: skip
#: Figures of the comparisons.
COMPARED: dict[PartOrOverall, tuple[str, ...]] = {
    "part_1": ("strict.IoU", "official.mIoU"),
    "part_2": ("strict.IoU", "official.mIoU", "strict.wrong_instance_rate"),
    "part_3": ("listen.pair_accuracy", "listen.IoU", "listen.FP_rate"),
}
PART_TITLES = {
    "part_1": "one instance of the category", "part_2": "several instances", "part_3": "several sources, or none",
}  # fmt: skip
_TITLES = {f"{metric.protocol}.{metric.name}": f"{metric.protocol} {metric.title}" for metric in METRICS}


def value_of(group: GroupScores | None, figure: str) -> str:
    """``.812 (.770–.850)``; without an interval where there are too few observations; – where it is not available."""
    protocol, _, name = figure.partition(".")
    summary: Any = getattr(group, protocol, None)
    if summary is None or (value := getattr(summary, name)) is None:
        return "–"
    spread = summary.intervals.get(name)
    return f"{value:.3f}" + (f" ({spread[0]:.3f}–{spread[1]:.3f})" if spread else "")


def part_table(
    part: str,
    found: Mapping[str, Scores],
    *,
    looks: Mapping[str, str] | None = None,
) -> list[str]:
    """The methods of one part, the reference rows, and the paper's own figures.

    Args:
        part: ``part_1``, ``part_2`` or ``part_3``.
        found: row → its scores.
        looks: row → how often the network looked at a picture, e.g. ``several looks``, where it did.
    """
    figures = FIGURES[part]
    rows = []
    for name, scores in found.items():
        group = scores.parts.get(part)  # type: ignore[call-overload]
        if group is not None:
            how = f"{looks[name]}, " if looks and name in looks else ""
            title = f"{ROWS[name].title} ({how}n = {group.observations})"
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
    """IoU per category: strict, or listen of part_3."""
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


def _is_current(document: Mapping[str, Any], name: str) -> bool:
    """Whether a row was made with the weights of the run, or with none: scores of former weights may lie beside it."""
    made = document["rows"].get(name, {}).get("settings", {})
    return bool(made.get("weights", document["weights"]) == document["weights"])


def time_table(document: Mapping[str, Any], label: str, rows: Iterable[str]) -> list[str]:
    """Minutes and hardware of rows of one dataset; Gaussians count where they were trained."""
    lines = []
    for row in rows:
        entry = document["rows"].get(f"{label}-{row}")
        if entry is None:
            continue
        per_frame = f"{1000 * entry['seconds'] / max(1, entry['frames']):.0f} ms"
        lines.append([ROWS[row].title, f"{entry['seconds'] / 60:.1f}", per_frame, entry["hardware"]])
    return ["Time of each row; rows of EchoSegnet share what the first of them trained:", "",
            *table(("row", "minutes", "per test frame", "hardware"), lines)]  # fmt: skip


def dataset_page(label: str, document: Mapping[str, Any], output: Path, picture: str | None, home: str) -> str | None:
    """All tables of one dataset as a page, of rows with the weights of the run; None if there are no scores of it.

    Args:
        label: of the dataset.
        document: the record of the run.
        output: folder of the scores.
        picture: path of the picture of failures, from the page.
        home: path of the overview, from the page.

    Raises:
        Avs3dError: if a file is missing or broken.
    """
    files = {name: output / f"listener-{label}-{name}.json" for name in ROWS}
    there = {name: path for name, path in files.items() if path.exists()}
    found = {
        name: read_record(path, Scores) for name, path in there.items() if _is_current(document, f"{label}-{name}")
    }
    if not found:
        return None
    data = document["datasets"][label]
    settings = {name: document["rows"].get(f"{label}-{name}", {}).get("settings", {}) for name in found}
    looks = {name: looks_text(made) for name, made in settings.items() if "looks" in made}
    lines = [f"# The listener on {label}", "",
             f"{data['name']} {data['version'] or '(official release)'}, weights with the sha256 "
             f"`{document['weights'][:12]}…`. Written by `make docs-tables`; "
             f"[the listener]({home}) says what the rows are.", ""]  # fmt: skip
    lines += settings_lines(settings)
    if former := [ROWS[name].title for name in there if name not in found]:
        lines += [f"Measured with former weights alone, and left out here: {', '.join(former)}.", ""]
    for part in FIGURES:
        lines += part_table(part, found, looks=looks)
    lines += difference_table(found)
    lines += category_table(found)
    lines += time_table(document, label, found)
    if picture is not None:
        lines += [f"![Worst and median observations of {label}]({picture})", ""]
    lines += [f"paper: {CITATION}; measured on {DATASET}. *Slanted*: reference rows. In brackets: 95 % intervals,",
              "bootstrap over homes. p: sign-flip permutation test, corrected for the compared pairs of a part and",
              "figure (Holm)."]  # fmt: skip
    return "\n".join(lines) + "\n"


def pages(output: Path, target: Path, images: Path) -> dict[Path, str]:
    """The overview and the pages of the datasets, as they are to be.

    Args:
        output: folder of the scores.
        target: the overview, which has the block `TABLES`; the others lie in results/ beside it.
        images: folder of the pictures of failures.

    Returns:
        File → its text.

    Raises:
        Avs3dError: if a file is missing or broken, or the overview has no block.
    """
    folder, document = target.parent / "results", read_json(output / RUN_JSON)
    texts: dict[Path, str] = {}
    for label in document["datasets"]:
        picture = images / f"listener-{label}-failures.jpg"
        shown = os.path.relpath(picture, folder) if picture.exists() else None
        text = dataset_page(label, document, output, shown, os.path.relpath(target, folder))
        if text is not None:
            texts[folder / f"listener-{label}.md"] = text
    links = "\n".join(f"- [{path.stem.removeprefix('listener-')}](results/{path.name})" for path in texts)
    return {**texts, target: insert(target, target.read_text(encoding="utf-8"), TABLES, links)}


def insert(path: Path, page: str, name: str, text: str) -> str:
    """Put a text between ``<!-- NAME -->`` and ``<!-- end of NAME -->`` of a page.

    Args:
        path: of the page, for messages.
        page: its text.
        name: of the block.
        text: goes in.

    Returns:
        The new text of the page.

    Raises:
        Avs3dError: if the marks are not there.
    """
    begin_mark, end_mark = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, begin, rest = page.partition(begin_mark)
    _, end, after = rest.partition(end_mark)
    if not begin or not end:
        raise Avs3dError(f"{path}: expected the lines {begin_mark} and {end_mark}")
    return f"{before}{begin_mark}\n\n{text}\n\n{end_mark}{after}"


@click.command()
@click.argument("output", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("datasets", nargs=-1, metavar="[LABEL=]ROOT…")
@click.option("--page", "target", type=click.Path(path_type=Path, dir_okay=False), required=True)
@click.option("--work", type=click.Path(path_type=Path), help="Folder of the run, for the pictures.")
def main(output: Path, datasets: tuple[str, ...], target: Path, work: Path | None) -> None:
    """Write the tables of the scores in OUTPUT into a page; pictures of what fails on the datasets go into images/."""
    images = target.parent / "images"
    try:
        for label, root in labelled(datasets).items():
            if work is None:
                raise click.UsageError("pictures need --work, the folder of the run of benchmarks.listener_tables")
            for path in draw_failures(label, root, output, work / "submissions" / label, images):
                click.echo(path)
        for path, text in pages(output, target, images).items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, text.encode())
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    click.echo(target)


if __name__ == "__main__":
    main()
