"""The commands `avs3d seal` and `avs3d unseal`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from avs3d_bench.commands.click_options import HELP, PATH, WORKERS, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER
from avs3d_bench.scheduling.options import Options, scheduling_options
from generators.cli import ExtraOutputs, MakingCommand, choose_tools, making_options, with_option

#: The word of `--with` that publishes the masks of train frames.
TRAIN_TRUTH = "train-truth"


@click.command(cls=MakingCommand, context_settings=HELP)
@click.argument("manifest", type=PATH, required=False)
@click.option("-o", "--output", "folder", required=True, type=OUTPUT_FOLDER, metavar="DIR",
              help="Gets public/ and private/.")  # fmt: skip
@click.option(
    "--commit",
    "only_commit",
    is_flag=True,
    help="Without MANIFEST: write DIR/commitment.json, which binds to the secret, and stop. Publish it first.",
)
@click.option(
    "--secret",
    "secret_file",
    type=PATH,
    metavar="FILE",
    help="File of the secret, 64 hexadecimal digits (default: 32 random bytes, written to DIR/secret).",
)
@click.option(
    "--exclude",
    type=PATH,
    multiple=True,
    metavar="MANIFEST",
    help="Use no home of this manifest, or of those in this folder, either; repeatable.",
)
@making_options
@with_option(TRAIN_TRUTH)
@scheduling_options
def seal(
    manifest: Path | None,
    folder: Path,
    only_commit: bool,
    secret_file: Path | None,
    exclude: tuple[Path, ...],
    scheduling: Options,
    beside: ExtraOutputs,
    **chosen: Any,
) -> None:
    """Make a sealed test of MANIFEST: a dataset whose truth nobody can generate without a secret.

    DIR/public/ is what participants get: pictures, sound, poses, and commitments to the truth (seal.json). DIR/private/
    has the truth, for scoring: avs3d-eval SUBMISSION --dataset DIR/public --truth DIR/private. The seeds of MANIFEST
    are not used. --with train-truth publishes the masks of train frames; --with depth publishes depth pictures; stems
    and impulse responses stay private.
    """
    choose_tools(chosen.pop("habitat_python"))
    from avs3d_bench.errors import UsageError
    from generators.manifest.reading import read_manifest
    from generators.options import GenerateOptions
    from generators.sealing.seal import bind_secret
    from generators.sealing.seal import seal as make

    if only_commit == (manifest is not None):
        raise UsageError("expected MANIFEST, the test to seal, or --commit to bind to a secret before it is written")
    if manifest is None:
        bound = bind_secret(folder, secret_file)
        click.echo(f"{bound.file}: the secret, to be kept until the end")
        click.echo(f"{bound.commitment_file}: the commitment to it, to be published now, before the template")
        return

    options = GenerateOptions(extras=beside.folders, ambisonics=beside.ambisonics, array=beside.array, **chosen)
    made = make(
        read_manifest(manifest),
        folder,
        secret_file=secret_file,
        options=options,
        train_truth=TRAIN_TRUTH in beside.more,
        exclude=exclude,
        scheduling=scheduling,
        progress=True,
    )
    click.echo(f"{made.public}: {len(made.record.commitments.truth)} observations, to be published")
    click.echo(f"{made.private}: their truth, to be kept until the end")
    click.echo(f"{made.secret}: the secret, to be kept until the end")
    click.echo(f"sha256 of seal.json, to be published now: {made.digest}")


@click.command(context_settings=HELP, short_help="Prove that the truth of a sealed test is the committed one.")
@click.argument("folder", type=PATH, metavar="DIR")
@click.option("--secret", "secret_file", type=PATH, required=True, metavar="FILE", help="File of the secret.")
@click.option("--regenerate", is_flag=True, help="Generate the observations again as well, and compare every file.")
@only_option
@click.option("--files", type=PATH, metavar="DIR", help="Folder with the files that the manifest names.")
@click.option("--workers", type=WORKERS, default=None, help="Worker processes of --regenerate (default: one per core).")
@click.option("--cache", type=PATH, metavar="DIR", default=None, help="Folder of baked homes (default: $AVS3D_CACHE).")
@click.option("--hrtf", type=PATH, metavar="FILE", help="SOFA file of the head that the test was made with.")
@click.option("--array", type=PATH, metavar="FILE", help="File of the array that the test was made with.")
def unseal(
    folder: Path,
    secret_file: Path,
    regenerate: bool,
    only: tuple[str, ...],
    files: Path | None,
    **options: Any,
) -> None:
    """Check the sealed test in DIR, which has public/ and private/, against its commitments.

    In seconds: every file by its hash; the manifest, the observations that there are, the sparse points and what sounds
    from the secret; records, masks and files against one another. --regenerate generates the observations, or those of
    --only, from the manifest again. Exit status: 0 all as committed to, 1 not (the files are named), 2 usage.
    """
    choose_tools(None)
    from avs3d_bench.commands.report import SHOWN, printable, shorten
    from avs3d_bench.errors import UsageError
    from avs3d_bench.sealing.secret import read_secret
    from generators.sealing.unseal import Again
    from generators.sealing.unseal import unseal as check

    if only and not regenerate:
        raise UsageError("--only chooses what --regenerate generates; expected both")
    opened = check(folder, read_secret(secret_file), Again(only, files, options) if regenerate else None)
    first, rest = shorten(opened.problems, SHOWN)
    for problem in first:
        click.echo(printable(f"error: {problem.path}: {problem.message}"))
    if rest:
        click.echo(f"… and {rest}")
    for note in opened.notes:
        click.echo(f"avs3d unseal: note: {note}", err=True)
    seal = opened.seal
    count = sum(map(len, seal.commitments.truth.values()))
    what = f"{len(seal.commitments.truth)} observations, {count:,} commitments to truth files"
    if opened.made_again:
        what += f", {len(opened.made_again)} generated again"
    verdict = "all as committed to" if not opened.problems else f"{len(opened.problems)} not as committed to"
    click.echo(f"{folder}: {what}: {verdict}")
    if opened.problems:
        raise SystemExit(1)
