"""The command `avs3d sweep`."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from avs3d_bench.commands.click_options import HELP, PATH, only_option
from avs3d_bench.commands.outputs import OutputFile
from generators.sampling.document import SWEPT
from generators.sampling.name_option import name_option


@click.command(context_settings=HELP, short_help="Vary the acoustics of a manifest's observations over a grid.")
@click.argument("manifest", type=PATH)
@click.option(
    "--over",
    multiple=True,
    metavar="FIELD=VALUE,…",
    help="A parameter and its values: acoustics.absorption_scale, background.snr_db (or none), background.kind; "
    "repeatable: every combination is made.",
)
@click.option("-o", "--output", type=OutputFile(SWEPT), required=True, metavar="FILE", help="The manifest to write.")
@only_option
@name_option("NAME-sweep")
def sweep(manifest: Path, over: tuple[str, ...], output: Path, only: tuple[str, ...], name: str | None) -> None:
    """Write a manifest with variants of the observations of MANIFEST that share their pictures.

    Generate it with avs3d generate, score submissions to it, and draw the scores against a parameter with
    avs3d sweep-curve.
    """
    from avs3d_bench.formats import files
    from avs3d_bench.formats.yamlfile import read_yaml
    from generators.manifest.reading import read_manifest
    from generators.sampling.document import manifest_text
    from generators.sampling.sweep import check_place, grid_of, parse_axis
    from generators.sampling.sweep import sweep as make

    axes = [parse_axis(text) for text in over]
    grid_of(axes)
    source = read_manifest(manifest)
    check_place(source, output)
    document = make(source, read_yaml(manifest)[0], axes, only)
    if name is not None:
        document["name"] = name
    words = ["avs3d", "sweep", manifest.name]
    words += [word for text in over for word in ("--over", text)] + [word for text in only for word in ("--only", text)]
    files.write_bytes(output, manifest_text(document, shlex.join(words)).encode())
    entries = document["observations"]
    originals = sum("variant_of" not in one and not _is_variant(one) for one in entries)
    count = len(entries)
    click.echo(f"{output}: {count} observations (originals: {originals}, variants: {count - originals})")


def _is_variant(entry: dict[str, object]) -> bool:
    """Whether an entry with ``like`` is a variant; in part_3 it is a sibling."""
    return "like" in entry and not str(entry["like"]).startswith("part_3/")
