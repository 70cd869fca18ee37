"""The commands `avs3d manifest …`."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any, get_args

import click

from avs3d_bench.commands.click_options import PATH, WORKERS, Group
from avs3d_bench.commands.outputs import OutputFile
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from generators.core.limits import FRAMES, SIZE, SOURCE_LEVEL, HeadName, SoundSplit
from generators.sampling.document import SAMPLED
from generators.sampling.name_option import name_option

#: Compositions of groups, the usual one first (checked by tests/generators/test_sampling.py); splits of the sounds.
GROUPS, SPLITS = ("training", "listen"), get_args(SoundSplit)
#: What a manifest may be sampled for besides, with a composition of its own; and its frames and its parts, usually.
PURPOSES = {"seld": (60, ("part_1", "part_3"))}
#: Frames, usually.
USUAL_FRAMES = 24
#: Least number of frames: the programmes of several sources must fit.
LEAST_FRAMES = 8
#: Largest numbers of homes and observations; a manifest of 100,000 observations has 13 MB.
MOST_HOMES, MOST_OBSERVATIONS = 10_000, 100_000
#: Largest seed; beyond 64 bits a seed is a secret (`generators.plan.SECRET_SEEDS`), which no command line should show.
MOST_SEED = 2**64 - 1


def _parts(_: click.Context, __: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Read ``part_1,part_3``; None is up to what the manifest is for."""
    if value is None:
        return None
    names = tuple(name.strip() for name in value.split(",") if name.strip())
    for name in names:
        if name not in PARTS:
            raise UsageError(
                f"--parts {value}: unknown part {name!r}; expected some of {','.join(PARTS)}{did_you_mean(name, PARTS)}"
            )
    if not names:
        raise UsageError(f"--parts {value!r}: expected some of {','.join(PARTS)}")
    return tuple(part for part in PARTS if part in names)


def _version(_: click.Context, __: click.Parameter, value: str) -> str:
    """Check a version such as ``3.0.0``."""
    if not re.fullmatch(r"\d{1,6}\.\d{1,6}\.\d{1,6}", value):
        raise UsageError(f"--version {excerpt(value)} is no version; expected three numbers, such as 3.0.0")
    return value


def _levels(_: click.Context, __: click.Parameter, value: tuple[float, float] | None) -> tuple[float, float] | None:
    """Check a range of levels as a manifest does."""
    least, most = SOURCE_LEVEL
    if value is not None and not least <= value[0] <= value[1] <= most:
        raise UsageError(
            f"--levels {value[0]:g} {value[1]:g}: expected the lower level first, both from {least:g} to {most:g} dB"
        )
    return value


@click.group(cls=Group)
def manifest() -> None:
    """Make manifests."""


@manifest.command("sample")
@click.option("-o", "--output", type=OutputFile(SAMPLED), required=True, metavar="FILE", help="The manifest to write.")
@click.option("--homes", type=click.IntRange(1, MOST_HOMES), required=True, metavar="N", help="Number of homes.")
@click.option(
    "--observations", type=click.IntRange(1, MOST_OBSERVATIONS), required=True, metavar="M", help="Number of them."
)
@click.option(
    "--seed", type=click.IntRange(0, MOST_SEED), required=True, metavar="S", help="Seed of the draws and the manifest."
)
@click.option(
    "--parts", callback=_parts, default=None, metavar="PARTS", help="Parts to sample [all; for seld part_1,part_3]."
)
@click.option(
    "--for",
    "purpose",
    type=click.Choice(list(PURPOSES)),
    default=None,
    help="seld: minutes with several events, some moving at once; the agent stands, turns or walks (`export seld`).",
)
@click.option(
    "--groups",
    type=click.Choice(GROUPS),
    default=GROUPS[0],
    show_default=True,
    help="How groups of part_3 are composed: many kinds of siblings, or mostly twins that only direction tells apart.",
)
@click.option(
    "--exclude",
    type=PATH,
    multiple=True,
    metavar="MANIFEST",
    help="Use no home and no seed of this manifest, or of those in this folder; repeatable.",
)
@click.option(
    "--hold-out-models",
    is_flag=True,
    help="Draw only training variants of the objects, and none that an excluded manifest draws.",
)
@click.option("--sounds", type=click.Choice(SPLITS), default=None, help="Draw only voices of this split of the sounds.")
@click.option(
    "--hold-out-sounds",
    is_flag=True,
    help="Draw no voice that an excluded manifest draws, and only training voices unless --sounds says otherwise.",
)
@name_option("sampled-S")
@click.option(
    "--version",
    callback=_version,
    default="1.0.0",
    show_default=True,
    metavar="VERSION",
    help="Version of the manifest.",
)
@click.option("--size", type=click.IntRange(*SIZE), default=252, show_default=True, help="Pixels per side.")
@click.option(
    "--frames",
    type=click.IntRange(LEAST_FRAMES, FRAMES[1]),
    default=None,
    help=f"Frames per observation [{USUAL_FRAMES}; for seld {PURPOSES['seld'][0]}].",
)
@click.option(
    "--light",
    type=click.Choice(["preview", "standard", "high"]),
    default="standard",
    show_default=True,
    help="Quality of the baked light.",
)
@click.option(
    "--audio",
    type=click.Choice(["tracer", "soundspaces", "analytic"]),
    default="tracer",
    show_default=True,
    help="Acoustic engine.",
)
@click.option(
    "--hrtf",
    type=click.Choice(get_args(HeadName)),
    default="sphere",
    show_default=True,
    help="Head of the tracer's ears; a family draws one for each group.",
)
@click.option(
    "--levels",
    callback=_levels,
    type=(float, float),
    default=None,
    metavar="LOW HIGH",
    help="Range from which the level of each source re the common loudness is drawn (dB).",
)
@click.option(
    "--check", is_flag=True, help="Place all objects, and draw again what does not fit into its room (seconds each)."
)
@click.option("--workers", type=WORKERS, default=1, show_default=True, help="Processes that --check uses.")
def sample_command(
    output: Path, exclude: tuple[Path, ...], name: str | None, check: bool, workers: int, **chosen: Any
) -> None:
    """Sample plausible observations in procedural homes, for training; print what they are.

    Same options, same file, to the byte. Homes have seeds that no excluded manifest uses. part_3 comes in groups of
    six siblings (eight with --groups listen): the same pictures with one object sounding, another one, silence, a
    source in another room, several sources at once.
    """
    from rich.console import Console

    from avs3d_bench.formats import files
    from generators.manifest.schema import Manifest
    from generators.sampling.document import manifest_text
    from generators.sampling.excluded import what_they_use
    from generators.sampling.sample import Wanted, sample
    from generators.sampling.statistics import tables

    _fill_in(chosen)
    extra = {"light": chosen.pop("light"), "audio": chosen.pop("audio")}
    head = chosen.pop("hrtf")
    extra |= {} if head == "sphere" else {"hrtf": head}
    if (levels := chosen.pop("levels")) is not None:
        extra["levels"] = list(levels)
    camera = {"size": chosen.pop("size"), "frames": chosen.pop("frames")}
    wanted = Wanted(**chosen, camera=camera, extra=extra)
    excluded = what_they_use(exclude, output)
    if check:
        from generators.sampling.fitting import SampleFitting

        document, units = sample(wanted, excluded, SampleFitting(workers))
    else:
        document, units = sample(wanted, excluded)
    if name is not None:
        document["name"] = name
    command = _command_line(wanted, document["name"], exclude, check)
    files.write_bytes(output, manifest_text(document, command).encode())
    console = Console()
    for table in tables(Manifest.model_validate(document), units):
        console.print(table)
    click.echo(f"{output}: {len(document['observations'])} observations in {len(document['scans'])} homes")


def _fill_in(chosen: dict[str, Any]) -> None:
    """Replace the purpose by the composition that it stands for, and fill in what depends on it.

    Raises:
        UsageError: if another composition is asked for as well.
    """
    purpose = chosen.pop("purpose")
    frames, parts = PURPOSES.get(purpose, (USUAL_FRAMES, PARTS))
    if purpose is not None:
        if chosen["groups"] != GROUPS[0]:
            raise UsageError(f"--groups {chosen['groups']}: --for {purpose} has a composition of its own; leave it out")
        chosen["groups"] = purpose
    chosen["frames"] = chosen["frames"] or frames
    chosen["parts"] = chosen["parts"] or parts


def _command_line(wanted: Any, name: str, exclude: tuple[Path, ...], check: bool) -> str:
    """The command that makes the same file, without the name of the file."""
    words = ["avs3d", "manifest", "sample", "--name", name]
    words += ["--homes", str(wanted.homes), "--observations", str(wanted.observations), "--seed", str(wanted.seed)]
    words += ["--parts", ",".join(wanted.parts)]
    if wanted.groups != GROUPS[0]:
        words += ["--for" if wanted.groups in PURPOSES else "--groups", wanted.groups]
    for path in exclude:
        words += ["--exclude", str(path)]
    words += ["--hold-out-models"] if wanted.hold_out_models else []
    words += ["--sounds", wanted.sounds] if wanted.sounds else []
    words += ["--hold-out-sounds"] if wanted.hold_out_sounds else []
    words += ["--version", wanted.version] if wanted.version != "1.0.0" else []
    for option, value in (wanted.camera | wanted.extra).items():
        words += [f"--{option}", *(f"{one:g}" if isinstance(one, float) else str(one) for one in _values(value))]
    words += ["--check"] if check else []
    return shlex.join(words)


def _values(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]
