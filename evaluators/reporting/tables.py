"""The paper's Table 2 (methods × parts) and Table 3 (voting thresholds) from files of scores.

A section of a table holds comparable rows only: one dataset (name, version, sha256 of dataset.json), one set of
protocols and versions, one set of scored observations, one truth (`evaluators.reporting.ranking`). Files that differ
in any of it get a section of their own, which says what it holds.

A series (Table 3) is two or more files of one section that have the same method and settings (`series.SETTINGS`) and
differ in ``runtime.voting_threshold`` of submission.json. Of a series, Table 2 shows the run at the paper's threshold.

    table2.md   table2.csv   table2.png   table2.svg        and likewise table3; the pictures of the second section
    and on are called table2-2 …
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from avs3d_bench.commands.outputs import Signature, check_apart, write_outputs
from avs3d_bench.errors import UsageError
from avs3d_bench.runtime.imports import require_package
from evaluators.reporting.leaderboard import read_entries
from evaluators.reporting.series import THRESHOLD
from evaluators.reporting.signatures import TABLES
from evaluators.reporting.table_contents import csv, table_2, table_3

Which = Literal["2", "3", "all"]


def write_tables(folder: Path, score_files: Sequence[Path], *, which: Which = "all", plot: bool = True) -> list[Path]:
    """Write the tables as Markdown, CSV and, with ``plot``, PNG and SVG; the same bytes for the same scores.

    Args:
        folder: made if missing; files of other names in it stay.
        score_files: written by ``avs3d-eval --json``, in any order; a file given twice counts once.
        which: with ``all``, Table 3 is left out where there is no series.
        plot: draw as well; needs matplotlib.

    Returns:
        The files, in the order of the tables.

    Raises:
        UsageError: if there is no score file, one would be overwritten, or there is no series though ``which`` is 3.
        Avs3dError: if a file is broken, matplotlib is missing, or nothing can be written.

    Examples:
        >>> from pathlib import Path
        >>> files = sorted(Path("data/demo-scores").glob("*.json"))
        >>> [path.name for path in write_tables(Path("tables"), files, which="2", plot=False)]
        ['table2.md', 'table2.csv']
        >>> import csv
        >>> rows = list(csv.DictReader(Path("tables/table2.csv").read_text("utf-8").splitlines()))
        >>> [(row["method"], row["strict_IoU"]) for row in rows if row["part"] == "part_1"][:2]
        [('oracle (category)', '1.0'), ('centre-box', '0.0')]
    """
    from evaluators.reporting.tables_markdown import markdown

    if plot:
        need_matplotlib()
    entries = read_entries(score_files, reports=False)
    tables = []
    if which in ("2", "all"):
        tables.append(table_2(entries))
    if which in ("3", "all"):
        third = table_3(entries)
        if third is not None:
            tables.append(third)
        elif which == "3":
            raise UsageError(
                f"{score_files[0]}{' and the others' if len(score_files) > 1 else ''}: no series for Table 3; expected "
                f"two or more files that differ in runtime.{THRESHOLD} of submission.json alone "
                "(avs3d baseline echosegnet --sweep voting-threshold)"
            )
    files: dict[Path, bytes] = {}
    for table in tables:
        files[folder / f"{table.name}.md"] = markdown(table, pictures=plot).encode("utf-8", "replace")
        files[folder / f"{table.name}.csv"] = csv(table).encode("utf-8", "replace")
        if plot:
            from evaluators.reporting.tables_plot import draw

            for section in table.sections:
                for suffix, data in draw(table, section).items():
                    files[folder / f"{table.picture(section)}.{suffix}"] = data
    return write_beside(files, score_files, TABLES)


def write_beside(
    files: Mapping[Path, bytes], score_files: Sequence[Path], signatures: Mapping[str, Sequence[Signature]]
) -> list[Path]:
    """Write files that were made from files of scores.

    Args:
        files: path → contents.
        score_files: what they were made from; none of them may be among ``files``.
        signatures: see `avs3d_bench.commands.outputs.write_outputs`.

    Returns:
        The paths that were written.

    Raises:
        UsageError: if a file of scores would be overwritten, or one that has no such signature; then nothing is
            written.
        Avs3dError: if a file cannot be written.
    """
    for path in files:
        check_apart(path, score_files)
    return write_outputs(files, signatures)


def need_matplotlib() -> None:
    """Refuse to draw without matplotlib.

    Raises:
        Avs3dError: if it is not installed.
    """
    how = "pip install 'avs3d-bench[plot]'; --no-plot writes the tables without them"
    require_package("matplotlib", user="plotting", how=how)
