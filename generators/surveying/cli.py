"""The command `avs3d scan`."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from avs3d_bench.commands.click_options import HELP, PATH
from avs3d_bench.commands.outputs import OutputFile, check_replaceable
from avs3d_bench.contract.taxonomy import check_room
from avs3d_bench.errors import UsageError
from avs3d_bench.runtime.one_thread import ONE_THREAD
from generators.sampling.document import SCANNED
from generators.sampling.name_option import name_option

if TYPE_CHECKING:
    from generators.surveying.run import ScanRequest
    from generators.surveying.survey import RoomChoice

#: Largest number of rooms that `--rooms` takes.
MOST_ROOMS = 50
_AXIS = click.Choice(["x", "y", "z", "-x", "-y", "-z"])


def _rooms(_: click.Context, __: click.Parameter, value: str | None) -> RoomChoice:
    """Read ``3``, ``kitchen,bathroom`` or ``kitchen=2,bathroom=3``."""
    from generators.surveying.survey import RoomChoice

    if value is None:
        return RoomChoice()
    if re.fullmatch(r"-?\d+", value):
        if not 1 <= int(value) <= MOST_ROOMS:
            raise UsageError(f"--rooms {value}: expected 1 to {MOST_ROOMS} rooms")
        return RoomChoice(count=int(value), text=value)
    names: dict[str, int] = {}
    for order, text in enumerate(value.split(","), start=1):
        name, given, number = text.strip().partition("=")
        try:
            check_room(name)
        except UsageError as error:
            raise UsageError(f"--rooms {value}: {error}; or how many rooms there are, e.g. 3") from None
        if given and not re.fullmatch(r"[1-9]\d?", number):
            raise UsageError(f"--rooms {value}: {name}={number} names no room; expected its number on the plan, from 1")
        if name in names:
            raise UsageError(f"--rooms {value}: {name} is listed twice")
        names[name] = int(number) if given else order
    twice = [number for number in names.values() if list(names.values()).count(number) > 1]
    if twice:
        raise UsageError(f"--rooms {value}: room {twice[0]} has two names; expected one")
    return RoomChoice(tuple(names.items()), text=value)


def _surfaces(_: click.Context, __: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """Read ``wall=brick`` of each ``--material``."""
    found: dict[str, str] = {}
    for value in values:
        place, sign, material = value.partition("=")
        if not sign:
            raise UsageError(f"--material {value}: expected PLACE=NAME, such as wall=brick")
        found[place] = material
    if found:
        from generators.scans.sound import check_surfaces

        check_surfaces(found, "--material")
    return found


@click.command(context_settings=HELP, short_help="Turn a scan of a room into a manifest.")
@click.argument("file", type=PATH)
@click.option("-o", "--output", type=OutputFile(SCANNED), required=True, metavar="FILE", help="The manifest to write.")
@click.option(
    "--rooms",
    callback=_rooms,
    default=None,
    metavar="ROOMS",
    help="How many rooms there are (3), their names by size (living_room,kitchen) or by their numbers on the plan "
    "(kitchen=2,bathroom=3).",
)
@click.option(
    "--scale", type=click.FloatRange(1e-4, 100.0), default=None, metavar="S", help="Metres in a unit of the file."
)
@click.option("--up", type=_AXIS, default=None, help="The file's axis that points up.")
@click.option("--front", type=_AXIS, default=None, help="The file's axis that becomes +Z; with --up.")
@click.option(
    "--material",
    "surfaces",
    multiple=True,
    callback=_surfaces,
    metavar="PLACE=NAME",
    help="Acoustic material of a place, e.g. wall=brick; repeatable.",
)
@click.option(
    "--splats",
    type=PATH,
    default=None,
    metavar="PLY",
    help="The same place in 3D Gaussians, in the frame of FILE, for avs3d generate --vision splats.",
)
@name_option("that of the output")
@click.option(
    "--licence", nargs=2, default=None, metavar="NAME AUTHOR", help="Licence and author of the scan (default: unknown)."
)
@click.option("--replace", is_flag=True, help="Replace a manifest that this command wrote; changes by hand are lost.")
def scan(
    file: Path,
    output: Path,
    name: str | None,
    licence: tuple[str, str] | None,
    surfaces: dict[str, str],
    splats: Path | None,
    replace: bool,
    **known: Any,
) -> None:
    """Turn the scan of a room or flat in FILE (GLB, glTF, OBJ, PLY or a ZIP) into a manifest that avs3d generate takes.

    Finds which way is up, the turn of the walls, the unit, the rooms, and what fits into them; says what it guessed and
    draws it on a page beside the manifest. A ZIP is unpacked beside it; otherwise nothing of the scan
    is copied or changed.
    """
    os.environ.update(ONE_THREAD)
    from generators.surveying.run import ScanRequest, survey_scan
    from generators.surveying.survey import KnownFrame

    if known["front"] is not None and known["up"] is None:
        raise UsageError("--front needs --up: expected both axes, or --up alone")
    request = ScanRequest(file, output, KnownFrame(**known), name, licence, surfaces, splats)
    _check_outputs(request, replace)
    outcome = survey_scan(request, shlex.join(["avs3d", "scan", str(file), *_given(click.get_current_context())]))
    for guess in outcome.survey.guesses:
        click.echo(f"{guess.name}: {guess.value} ({guess.how})")
    for each in outcome.measures:
        click.echo(
            f"{each.room.name}: floor to walk on {each.area:.1f} m², tables and other tops {len(each.tops())}, "
            f"doorways {len(each.doors)}, holes {each.hole_share:.0%}"
        )
    for decay in outcome.sound.rooms:
        time = f"{decay.t30:.2f} s" if decay.t30 else "unknown"
        usual = "; furnished rooms of its size: {:.2f} to {:.2f} s".format(*decay.usual) if decay.usual else ""
        click.echo(f"{decay.room}: reverberation time {time} (from the guessed materials{usual})")
    sounding = ", ".join(outcome.found.categories)
    click.echo(f"{output}: {len(outcome.found.entries)} observations ({sounding}); look at {request.page}")
    for warning in outcome.survey.warnings:
        click.echo(f"avs3d scan: warning: {warning}", err=True)
    for word, line in zip(("next", "then"), request.next_commands, strict=True):
        click.echo(f"{word}: {line}")


def _check_outputs(request: ScanRequest, replace: bool) -> None:
    """Refuse to replace a manifest without being told so, and a page that this command has not written.

    Raises:
        UsageError: in one line.
    """
    from avs3d_bench.formats.files import check_writable
    from generators.surveying.page import SCAN_PAGE

    output = request.output
    if output.suffix not in (".yaml", ".yml"):
        raise UsageError(f"{output}: expected the name of a manifest, which ends in .yaml")
    check_replaceable(request.page, [SCAN_PAGE])
    check_writable(output)
    if not replace and output.exists() and output.stat().st_size:
        raise UsageError(f"{output}: exists; add --replace to write it again (changes by hand are lost)")


def _given(context: click.Context) -> list[str]:
    """The options of this call that decide what the manifest says."""
    words: list[str] = []
    for name in ("rooms", "scale", "up", "front", "licence", "splats"):
        if context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            value = context.params[name]
            values = value if isinstance(value, tuple) else (getattr(value, "text", value),)
            words += [f"--{name}", *(f"{one:g}" if isinstance(one, float) else str(one) for one in values)]
    for place, material in context.params["surfaces"].items():
        words += ["--material", f"{place}={material}"]
    return words
