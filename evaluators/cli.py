"""The commands `avs3d-eval` and `avs3d` `check`, `compare`, `verify`, `leaderboard`, `tables` and `metrics`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from avs3d_bench import __version__
from avs3d_bench.cli import run
from avs3d_bench.commands.click_options import HELP, PATH, WORKERS, dataset_option, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER, OutputFile
from avs3d_bench.commands.report import REPORT_JSON, Report
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.errors import UsageError
from evaluators.reading.convention_names import CONVENTIONS
from evaluators.reporting.signatures import (  # fmt: skip
    BOARD,
    COMPARISON,
    FACTORS,
    FACTORS_CSV,
    FRAMES_CSV,
    FRAMES_PARQUET,
    MASK_METRICS,
    REPORT,
    SCORES,
    VERIFICATION,
)

if TYPE_CHECKING:
    from avs3d_bench.commands.report import Problem
    from avs3d_bench.dataset import Dataset
    from evaluators.reading.records import Evaluation, Submission

#: Problems that `check` prints before it only counts.
_SCREENFUL = 40

_official_folder = click.option(
    "--official-folder",
    type=click.Choice(["True", "False"], case_sensitive=False),
    help="Of the released pipeline's output: 3d_segmentation_use_aisrm_True or …_False [True where it is there].",
)
_workers = click.option("--workers", type=WORKERS, default=None, help="Processes [one per core].")
_truth = click.option("--truth", type=PATH, metavar="PRIVATE", help="Of a sealed test: the folder with its truth.")


@click.command(context_settings=HELP)
@click.argument("submission", type=PATH)
@dataset_option
@_truth
@click.option(
    "--protocol", type=click.Choice(["official", "strict", "listen", "all"]), default="all", show_default=True,
    help="official and strict score part_1 and part_2, listen scores part_3; all: those that fit the dataset.",
)  # fmt: skip
@click.option("--json", "json_file", type=OutputFile(SCORES), metavar="FILE", help="Write the scores to this file.")
@click.option("--html", "html_file", type=OutputFile(REPORT), metavar="FILE", help="Write a report to this file.")
@click.option("--frames", "frames_file", type=OutputFile(FRAMES_CSV, FRAMES_PARQUET), metavar="FILE",
              help="Write a row per frame: .csv or .parquet.")  # fmt: skip
@click.option("--soft-masks", type=PATH, metavar="FOLDER",
              help="Add the average precision of soft masks, FOLDER/KEY/masks/frame_000.png, grey levels.")  # fmt: skip
@_official_folder
@only_option
@_workers
@click.version_option(__version__, prog_name="avs3d-eval")
def evaluate(
    submission: Path,
    root: Path,
    truth: Path | None,
    protocol: str,
    soft_masks: Path | None,
    official_folder: str | None,
    only: tuple[str, ...],
    workers: int | None,
    **files: Path | None,
) -> None:
    """Score SUBMISSION, a folder or a .zip, against a dataset.

    SUBMISSION has the layout of docs/score.md, or that of the released pipeline's masks. Exit status: 0 scored,
    1 submission invalid (every bad file named), 2 usage.
    """
    from evaluators.reading.records import InvalidSubmission
    from evaluators.reading.submission import open_submission
    from evaluators.reporting.terminal_table import print_scores
    from evaluators.score import open_dataset, score, with_soft_masks

    wanted: Any = None if protocol == "all" else (protocol,)
    data = open_dataset(root, truth, only)
    _check_frames(files["frames_file"], protocol)
    with open_submission(submission, aisrm=_aisrm(official_folder)) as opened:
        try:
            evaluation = score(opened, data, protocols=wanted, only=only, workers=workers, progress=sys.stderr.isatty())
        except InvalidSubmission as error:
            _print_problems(error.report, submission, root)
            raise SystemExit(1) from None
        if soft_masks is not None:
            evaluation = with_soft_masks(evaluation, data, soft_masks, workers=workers, progress=sys.stderr.isatty())
        try:
            _write_files(evaluation, data, opened, **files)
        finally:
            # A full disk must not cost the scores as well.
            print_scores(evaluation.scores)
            _print_warnings([one for one in evaluation.warnings if one.severity == "warning"])
    for path in files.values():
        if path is not None:
            click.echo(str(path))


def _write_files(
    evaluation: Evaluation,
    data: Dataset,
    submission: Submission,
    json_file: Path | None,
    html_file: Path | None,
    frames_file: Path | None,
) -> None:
    """Write the report, the file of scores and the table of frames that were asked for.

    Raises:
        Avs3dError: if a file cannot be written, or the dataset is damaged.
    """
    from avs3d_bench.formats.files import write_json

    if html_file is not None:
        from evaluators.reporting.report import write_report

        write_report(html_file, evaluation, data, submission)
    if json_file is not None:
        write_json(json_file, evaluation.scores.model_copy(update={"report": _beside(html_file, json_file)}))
    if frames_file is not None:
        from evaluators.statistics.frame_rows import frame_rows, write_rows

        write_rows(frames_file, frame_rows(evaluation, data))


def _check_frames(path: Path | None, protocol: str) -> None:
    """Refuse, before any work is done, a table of frames that cannot be written.

    Raises:
        UsageError: if its name has another suffix, or the protocol has no figures of frames.
        Avs3dError: if it is Parquet and pyarrow is missing.
    """
    if path is None:
        return
    from evaluators.statistics.frame_rows import check_suffix

    check_suffix(path)
    if protocol == "official":
        raise UsageError(
            f"{path}: --frames has the figures of strict and listen; expected --protocol strict, listen or all"
        )


def _aisrm(official_folder: str | None) -> bool | None:
    return None if official_folder is None else official_folder == "True"


def _beside(html_file: Path | None, json_file: Path) -> str | None:
    """The report's path relative to the file of scores, where it lies at or below it."""
    from avs3d_bench.commands.report import printable

    if html_file is None or not html_file.is_file():  # a device, for one
        return None
    relative = Path(os.path.relpath(html_file.resolve(), json_file.resolve().parent)).as_posix()
    # A file of scores cannot hold a name that is not UTF-8.
    return None if relative.startswith("..") or printable(relative) != relative else relative


def _print_warnings(warnings: Sequence[Problem]) -> None:
    from avs3d_bench.commands.report import shorten

    first, rest = shorten(warnings, _SCREENFUL)
    for warning in first:
        click.echo(f"avs3d-eval: note: {warning.path}: {warning.message}", err=True)
    if rest:
        click.echo(f"avs3d-eval: note: … and {rest}; `avs3d check` names all", err=True)


def _print_problems(report: Report, submission: Path, dataset: Path) -> None:
    from avs3d_bench.commands.report import print_report

    print_report(report, shown=_SCREENFUL)
    if len(report.problems) > _SCREENFUL:
        click.echo(f"all of them: avs3d check {submission} --dataset {dataset} --json FILE")


@click.command(context_settings=HELP, short_help="Check a submission; name every bad file.")
@click.argument("submission", type=PATH)
@dataset_option
@click.option(
    "--json", "json_file", type=OutputFile(REPORT_JSON), metavar="FILE", help="Write the findings to this file as well."
)
@_official_folder
@only_option
@_workers
def check(
    submission: Path,
    root: Path,
    json_file: Path | None,
    official_folder: str | None,
    only: tuple[str, ...],
    workers: int | None,
) -> None:
    """Check SUBMISSION, a folder or a .zip, before anyone scores it.

    Exit status: 0 fit to be scored, 1 problems found (every bad file named), 2 usage.
    """
    from avs3d_bench.commands.report import print_report
    from avs3d_bench.formats.files import write_json
    from evaluators.reading.checks import check_submission

    report = check_submission(
        submission,
        root,
        only=only,
        aisrm=_aisrm(official_folder),
        workers=workers,
        progress=sys.stderr.isatty(),
    )
    try:
        if json_file is not None:
            write_json(json_file, report.as_dict())
    finally:
        print_report(report, shown=_SCREENFUL)
    if not report.valid:
        raise SystemExit(1)


@click.command(context_settings=HELP, short_help="Score a submission again and compare with a file of scores.")
@click.argument("score_file", type=PATH, metavar="SCORES.json")
@click.option(
    "--submission", type=PATH, metavar="SUBMISSION", required=True, help="The folder or .zip that was scored."
)
@dataset_option
@_truth
@click.option("--json", "json_file", type=OutputFile(VERIFICATION), metavar="FILE",
              help="Write the outcome to this file as well; avs3d leaderboard --verified reads it.")  # fmt: skip
@_workers
def verify(
    score_file: Path, submission: Path, root: Path, truth: Path | None, json_file: Path | None, workers: int | None
) -> None:
    """Score SUBMISSION again and say whether SCORES.json has the same figures and digests.

    Exit status: 0 the same, 1 not confirmed (each figure and digest that differs is named, or each bad file of the
    submission), 2 usage.
    """
    from avs3d_bench.commands.report import printable
    from avs3d_bench.formats.files import write_json
    from evaluators.reading.records import InvalidSubmission
    from evaluators.score import open_dataset
    from evaluators.verify import verify as verify_scores

    try:
        data = open_dataset(root, truth)
        found = verify_scores(score_file, submission, data, workers=workers, progress=sys.stderr.isatty())
    except InvalidSubmission as error:
        _print_problems(error.report, submission, root)
        raise SystemExit(1) from None
    try:
        if json_file is not None:
            write_json(json_file, found.record())
    finally:
        for difference in found.differences[:_SCREENFUL]:
            click.echo(printable(str(difference)))
        if len(found.differences) > _SCREENFUL:
            click.echo(f"{len(found.differences) - _SCREENFUL:,} more; --json FILE writes all of them")
        for note in found.notes:
            click.echo(f"note: {printable(note)}")
        click.echo(f"{score_file}: {found.summary}")
    if not found.same:
        raise SystemExit(1)


@click.command(context_settings=HELP, short_help="Rank files of scores on one static page.")
@click.argument("scores", nargs=-1, required=True, type=PATH, metavar="SCORES.json…")
@click.option("-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="Folder for the page.")
@click.option(
    "--verified", multiple=True, type=PATH, metavar="RECORD.json",
    help="A record of avs3d verify --json that you made: marks the file of scores that it confirms. Repeatable.",
)  # fmt: skip
@click.option("--json", "json_file", type=OutputFile(BOARD), metavar="FILE",
              help="Write the tables to this file as well.")  # fmt: skip
def leaderboard(scores: tuple[Path, ...], folder: Path, verified: tuple[Path, ...], json_file: Path | None) -> None:
    """Rank any number of files of scores (avs3d-eval --json) on one static page, with links to their reports.

    Scores of questions (avs3d qa-score --json) are shown in a table of their own.
    """
    from evaluators.reporting.leaderboard import write_leaderboard

    for note in write_leaderboard(folder, scores, verified, json_file):
        click.echo(f"avs3d leaderboard: note: {note}", err=True)
    click.echo(str(folder / "index.html"))


@click.command(context_settings=HELP, short_help="Compare methods: differences, intervals, p-values.")
@click.argument("scores", nargs=-1, required=True, type=PATH, metavar="A.json B.json…")
@click.option(
    "--protocol", "protocols", multiple=True, type=click.Choice(["official", "strict", "listen"]),
    help="Repeatable [all that the files have in common].",
)  # fmt: skip
@click.option(
    "--part", "parts", multiple=True, type=click.Choice([*PARTS, "overall"]), help="Repeatable [every part, overall]."
)
@click.option("--figure", "figures", multiple=True, metavar="PROTOCOL.FIGURE",
              help="Such as strict.IoU; repeatable [every figure].")  # fmt: skip
@click.option("--json", "json_file", type=OutputFile(COMPARISON), metavar="FILE",
              help="Write the comparison to this file as well.")  # fmt: skip
def compare(
    scores: tuple[Path, ...],
    protocols: tuple[Any, ...],
    parts: tuple[Any, ...],
    figures: tuple[str, ...],
    json_file: Path | None,
) -> None:
    """Compare methods by their files of scores (avs3d-eval --json), each with each.

    For every figure and part: the paired difference over the observations that both have, its 95 % bootstrap interval,
    the p-value of a permutation test, corrected for the number of pairs (Holm), and places, shared where nothing
    separates. docs/comparing.md has the formulas.
    """
    from avs3d_bench.formats.files import write_json
    from evaluators.reporting.compare import compare as compare_files
    from evaluators.reporting.compare import comparison_lines

    found = compare_files(scores, protocols=protocols, parts=parts, figures=figures)
    try:
        if json_file is not None:
            write_json(json_file, found)
    finally:
        click.echo("\n".join(comparison_lines(found)))
        for warning in found.warnings:
            click.echo(f"avs3d compare: warning: {warning}", err=True)
    if json_file is not None:
        click.echo(str(json_file))


@click.command(context_settings=HELP, short_help="Show figures by distance, direction, reverberation and others.")
@click.argument("tables", nargs=-1, required=True, type=PATH, metavar="FRAMES…")
@click.option("--html", "html_file", type=OutputFile(FACTORS), metavar="FILE",
              help="Write a page with charts to this file.")  # fmt: skip
@click.option("--csv", "csv_file", type=OutputFile(FACTORS_CSV), metavar="FILE",
              help="Write the figures of all bins to this file.")  # fmt: skip
def factors(tables: tuple[Path, ...], html_file: Path | None, csv_file: Path | None) -> None:
    """Show the figures of one to four methods by factor, side by side.

    FRAMES are tables of frames (avs3d-eval --frames) of the same frames of one dataset.
    """
    from avs3d_bench.commands.report import printable
    from evaluators.reporting.factors import write_factors

    targets = [path for path in (html_file, csv_file) if path is not None]
    if not targets:
        raise UsageError(
            "nothing to write: name the page or the table, or both: "
            f"avs3d factors {printable(str(tables[0]))} --html factors.html --csv factors.csv"
        )
    write_factors(tables, html=html_file, table=csv_file)
    for path in targets:
        click.echo(str(path))


@click.command(context_settings=HELP, short_help="Turn files of scores into the paper's tables.")
@click.argument("scores", nargs=-1, required=True, type=PATH, metavar="SCORES.json…")
@click.option(
    "-o", "--output", "folder", type=OUTPUT_FOLDER, metavar="DIR", required=True, help="Folder for the tables."
)
@click.option("--table", "which", type=click.Choice(["2", "3", "all"]), default="all", show_default=True)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw PNG and SVG too; needs matplotlib.")
def tables(scores: tuple[Path, ...], folder: Path, which: Any, plot: bool) -> None:
    """Turn files of scores (avs3d-eval --json) into the paper's tables: Markdown, CSV and a plot.

    Table 2 is methods × parts, Table 3 a sweep of the voting threshold (avs3d baseline echosegnet --sweep
    voting-threshold); the paper's own figures stand beside.
    """
    from evaluators.reporting.tables import write_tables

    for path in write_tables(folder, scores, which=which, plot=plot):
        click.echo(str(path))


@click.command(context_settings=HELP, short_help="Score folders of PNG masks by the convention of a benchmark.")
@click.argument("truth", type=PATH, metavar="TRUTH_DIR")
@click.argument("prediction", type=PATH, metavar="PREDICTION_DIR")
@click.option("--convention", type=click.Choice(CONVENTIONS), default=CONVENTIONS[0], show_default=True,
              help="Whose figures.")  # fmt: skip
@click.option("--soft", is_flag=True, help="Grey levels of predictions are probabilities: white is 1.")
@click.option("--by-order", is_flag=True, help="Pair the files of each subfolder by their order, not by name.")
@click.option("--frames-per-clip", type=click.IntRange(1), metavar="N",
              help="Frames of a clip [those of a subfolder; as released].")  # fmt: skip
@click.option("--clips-per-batch", type=click.IntRange(1), metavar="N",
              help="Batch size, on which released figures depend [as released].")  # fmt: skip
@click.option("--classes", type=click.IntRange(2, 256), metavar="C", help="Of avss: number of class ids.")
@click.option("--json", "json_file", type=OutputFile(MASK_METRICS), metavar="FILE",
              help="Write the figures to this file as well.")  # fmt: skip
def metrics(truth: Path, prediction: Path, json_file: Path | None, **options: Any) -> None:
    """Score PNG masks in PREDICTION_DIR against those of the same names in TRUTH_DIR.

    A subfolder is a clip. Masks are grey, 0 and 255 (or 0 and 1); of avss, class ids. Without --convention, the figures
    are this toolkit's; docs/which-number.md describes the others. Exit status: 0 scored, 1 bad files, 2 usage.
    """
    from avs3d_bench.formats.files import write_json
    from evaluators.reading.mask_folders import FolderOptions, score_folders

    found = score_folders(truth, prediction, FolderOptions(**options))
    about = {"clips": found.clips, "frames": found.frames}
    both = {"figures": found.figures, "order_free": found.order_free}
    try:
        if json_file is not None:
            write_json(json_file, {"avs3d_metrics": __version__, "convention": options["convention"], **about, **both})
    finally:
        if found.surplus:
            count = len(found.surplus)
            note = f"{count} files without a truth are not looked at ({found.surplus[0]}, …)"
            click.echo(f"avs3d metrics: note: {note}", err=True)
        counts = (
            f"{count} {noun}{'' if count == 1 else 's'}"
            for noun, count in (("frame", found.frames), ("clip", found.clips))
        )
        click.echo(f"{options['convention']}: {', '.join(counts)}")
        for name, value in found.figures.items():
            beside = found.order_free.get(name)
            shown = "–" if value is None else f"{value}" if isinstance(value, int) else f"{value:.4f}"
            click.echo(f"  {name:<22}{shown:>8}" + ("" if beside is None else f"   order-free {beside:.4f}"))
    if json_file is not None:
        click.echo(str(json_file))


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """The `avs3d-eval` program."""
    run(evaluate, arguments, program="avs3d-eval")
