"""`avs3d qa-score`."""

from __future__ import annotations

from pathlib import Path

import click

from avs3d_bench.commands.click_options import HELP, PATH
from avs3d_bench.commands.outputs import OutputFile, Signature
from avs3d_bench.contract.questions import KindScore

QA_SCORES = Signature(values=(("format", "avs3d qa scores 1"),))


@click.command("qa-score", context_settings=HELP)
@click.argument("answers", type=PATH)
@click.option("--questions", type=PATH, metavar="DIR", required=True, help="What `avs3d export qa` wrote.")
@click.option("--method", default=None, metavar="NAME", help="Name of the method [the file's, the log's model].")
@click.option("--json", "json_file", type=OutputFile(QA_SCORES), metavar="FILE", help="Write the scores to this file.")
def qa_score(answers: Path, questions: Path, method: str | None, json_file: Path | None) -> None:
    """Score the ANSWERS to questions: JSON lines with id and answer, or a log of `inspect eval`."""
    from avs3d_bench.formats.files import write_json
    from evaluators.questions.answers import score_file

    scores = score_file(answers, questions, method)
    click.echo(f"{scores.method} on questions about {scores.questions.dataset} {scores.questions.dataset_version}")
    click.echo(f"{'kind':<10}{'lines':>7}{'accuracy':>10}{'chance':>8}{'pairs':>7}  95 % of accuracy")
    for kind, found in [*scores.kinds.items(), ("all", scores.overall)]:
        click.echo(_row(kind, found))
    outside = scores.overall.outside
    if outside:
        click.echo(f"{outside:,} of {scores.overall.lines:,} answers are none of the options, and wrong")
    if json_file is not None:
        write_json(json_file, scores)
        click.echo(str(json_file))


def _row(name: str, found: KindScore) -> str:
    low_high = found.accuracy_interval
    interval = f"{low_high[0]:.3f} to {low_high[1]:.3f}" if low_high else "fewer than six groups"
    return (
        f"{name:<10}{found.lines:>7,}{found.accuracy:>10.3f}{found.chance:>8.3f}{found.pair_accuracy:>7.3f}  {interval}"
    )
