"""The tables of `evaluators.reporting.tables` as Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from avs3d_bench.contract.scores import Metric, metrics_of
from avs3d_bench.contract.taxonomy import PART_3
from avs3d_bench.text.templates import MISSING
from evaluators.reporting import paper
from evaluators.reporting.pages import PART_NOTES, PART_TITLES, clean, figure, interval, number, span
from evaluators.reporting.table_contents import PaperRow, PaperSection, PaperTable

_TITLES = {"table2": "Table 2: methods and parts", "table3": "Table 3: voting thresholds"}
#: Characters that Markdown would take for markup in a method's name.
_MARKUP = re.compile(r"([\\`*_\[\]<>|~#&$])")
#: Observations of a partial run that are named one by one.
_NAMED = 12


def markdown(table: PaperTable, *, pictures: bool = True) -> str:
    """The whole file.

    Args:
        table: what to write.
        pictures: refer to the pictures beside the file.
    """
    blocks = [f"# {_TITLES[table.name]}"]
    if len(table.sections) > 1:
        blocks.append(
            f"{len(table.sections)} sections: what stands in different ones was scored on other data, other "
            "observations or with other protocols, and does not compare."
        )
    for section in table.sections:
        blocks += _section(table, section, pictures)
    if table.elsewhere:
        blocks.append(f"Series of voting thresholds are in Table 3 alone: {'; '.join(map(plain, table.elsewhere))}.")
    return "\n\n".join(blocks) + "\n"


def plain(text: str) -> str:
    """Text of one line with Markdown's special characters escaped."""
    return _MARKUP.sub(r"\\\1", clean(" ".join(text.split())))


def _section(table: PaperTable, section: PaperSection, pictures: bool) -> Iterable[str]:
    data = section.scores.dataset
    yield f"## {plain(section.heading)}"
    rulers = " and ".join(f"{ruler.protocol} {ruler.version}" for ruler in section.rulers)
    digest = f" dataset.json has the sha256 `{data.sha256[:12]}…`." if data.sha256 else ""
    yield f"Protocol{'s' if len(section.rulers) > 1 else ''} {rulers}.{digest}"
    if data.scored < data.observations:
        keys = [observation.key for observation in section.scores.observations]
        named = ": " + ", ".join(f"`{key}`" for key in keys) if len(keys) <= _NAMED else ""
        yield f"A part of the dataset, so no score of the benchmark{named}."
    if pictures:
        yield f"![{_TITLES[table.name]}]({table.picture(section)}.svg)"
    notes: list[tuple[str, ...]] = []
    if table.name == "table2":
        for part in dict.fromkeys(row.part for row in section.rows):
            rows = [row for row in section.rows if row.part == part]
            count = rows[0].group.observations
            yield f"### {PART_TITLES[part]}, {PART_NOTES[part]} (n = {count})"
            yield _grid("method", [plain(row.title) for row in rows], rows, section.columns, notes)
            yield from _absent(rows, part)
    else:
        references = [row for row in section.rows if row.entry is None]
        for title in dict.fromkeys(row.title for row in section.rows if row.entry):
            rows = [row for row in section.rows if row.entry and row.title == title]
            yield f"### {plain(title)} (n = {rows[0].group.observations})"
            names = [f"{row.threshold:g}" for row in rows] + [plain(row.title) for row in references]
            yield _grid("threshold", names, rows + references, section.columns, notes)
    yield "\n".join(_legend(table, section, notes))


def _grid(
    first: str, names: Sequence[str], rows: Sequence[PaperRow], columns: Sequence[Metric], notes: list[tuple[str, ...]]
) -> str:
    """One table; adds its footnotes to ``notes``."""
    beside = {m.name for m in columns if m.protocol == "official" and any(m.name in row.paper for row in rows)}
    head = [first]
    for metric in columns:
        head.append(f"{metric.protocol} {metric.title}")
        if metric.protocol == "official" and metric.name in beside:
            head.append("paper")
    lines = [head, [":--"] + ["--:"] * (len(head) - 1)]
    for name, row in zip(names, rows, strict=True):
        cells = [name if row.entry else f"*{name}*"]
        for metric in columns:
            cells.append(_cell(row, metric))
            if metric.protocol == "official" and metric.name in beside:
                cells.append(_paper(row, metric, notes))
        lines.append(cells)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _cell(row: PaperRow, metric: Metric) -> str:
    spread = span(interval(row.group, metric))
    return number(figure(row.group, metric)) + (f" ({spread})" if spread else "")


def _paper(row: PaperRow, metric: Metric, notes: list[tuple[str, ...]]) -> str:
    value = row.paper.get(metric.name)
    if value is None or row.match is None:
        return MISSING
    if not row.match.differs:
        return number(value)
    if row.match.differs not in notes:
        notes.append(row.match.differs)
    return f"{number(value)} <sup>{notes.index(row.match.differs) + 1}</sup>"


def _absent(rows: Sequence[PaperRow], part: str) -> Iterable[str]:
    """The paper's methods that no file is of."""
    known = any(figure(row.group, metric) is not None for row in rows for metric in metrics_of("official"))
    if part not in ("part_1", "part_2") or not known:
        return
    present = {row.match.row for row in rows if row.match}
    absent = [
        f"{name} {number(figures[part]['mIoU'])} / {number(figures[part]['F'])}"
        for name, figures in paper.TABLE_2.items()
        if name not in present
    ]
    if absent:
        yield f"In the paper, and not among these files (mIoU / F): {', '.join(absent)}."


def _listens(section: PaperSection) -> bool:
    return any(ruler.protocol == "listen" for ruler in section.rulers)


def _legend(table: PaperTable, section: PaperSection, notes: Sequence[tuple[str, ...]]) -> Iterable[str]:
    lower = [f"{m.protocol} {m.title}" for m in section.columns if not m.higher_is_better]
    better = f"Higher is better, except {' and '.join(lower)}." if lower else "Higher is better."
    slanted = "*Slanted*: reference rows; deaf: true masks chosen without sound."
    over = "observations (listen: over groups of siblings)" if _listens(section) else "observations"
    if all(row.entry.scores.avs3d_eval.bootstrap_unit for row in section.rows if row.entry):
        over = f"homes, then {over.replace('over ', '')}"
    yield f"- {better} In brackets: 95 % interval, bootstrap over {over}. {slanted}"
    if any(row.paper for row in section.rows):
        scene = f" ({paper.TABLE_3_SCENE} alone)" if table.name == "table3" else ""
        yield f"- paper: {paper.CITATION}; measured on {paper.DATASET}{scene}."
    for index, differs in enumerate(notes, start=1):
        yield f"- <sup>{index}</sup> {plain('; '.join(differs))}."
    rows = [row for row in section.rows if row.part != PART_3]  # which the paper does not have
    without = {row.title: row.match.why for row in rows if row.match and row.match.row is None}
    for title, why in without.items():
        yield f"- No row of the paper for {plain(title)}: {plain(why)}."
    if section.swept:
        yield (
            f"- Of a series of voting thresholds only the run at {paper.VOTING_THRESHOLD:g} is listed; "
            f"the rest ({section.swept}) in Table 3."
        )
