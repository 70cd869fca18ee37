"""Options, session and reporting that the commands of `avs3d assets` share."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from avs3d_bench.commands.click_options import PATH
from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS, OFF_SCREEN_CATEGORIES, check_category_name
from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean
from avs3d_bench.formats.files import os_error_line

if TYPE_CHECKING:
    from generators.library.lock import AssetEntry
    from generators.library.session import Session, Stance

AXES = click.Choice(["x", "y", "z", "+x", "+y", "+z", "-x", "-y", "-z"])
MOUNTS = click.Choice(["floor", "surface", "wall", "wall_or_surface"])

Command = Callable[..., Any]


class _Category(click.types.StringParamType):
    """A category of the benchmark, or any name that a manifest may add; a note says so where it looks like a slip."""

    name = "category"
    known = tuple(dict.fromkeys((*CATEGORIES, *DISTRACTORS, *OFF_SCREEN_CATEGORIES)))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        try:
            check_category_name(value)
        except UsageError as error:
            self.fail(str(error), param, ctx)
        hint = "" if value in self.known else did_you_mean(value, self.known)
        if hint:
            tell(f"note: {value} is no category of the benchmark, so manifests must declare it in categories{hint}")
        return str(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(name) for name in self.known if name.startswith(incomplete)]


CATEGORY = _Category()


def _options(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Several click options as one decorator, in the order given."""
    return lambda command: functools.reduce(lambda inner, option: option(inner), reversed(options), command)


class _Number(click.FloatRange):
    """A number in a range; ``nan`` is never accepted."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if number is not None and number != number:
            self.fail(f"{value!r} is not a number in the range {self._describe_range()}.", param, ctx)
        return number


def _number(name: str, unit: str, low: float, high: float, default: float, text: str) -> Callable[[Command], Command]:
    kind = _Number(low, high)
    return click.option(name, type=kind, metavar=unit, default=default, help=f"{text} (default: {default:g}).")


lock_option = click.option(
    "--lock",
    type=PATH,
    default=None,
    metavar="FILE",
    help="Lock file (default: in scenes_manifest/ if that exists, else in the current folder).",
)
licence_option = click.option(
    "--allow-licence",
    "allowed",
    multiple=True,
    metavar="NAME",
    help="Accept assets under this licence, too; repeatable.",
)
stance_options = _options(
    click.option(
        "--height",
        type=_Number(0.01, 5, min_open=True),
        default=None,
        metavar="METRES",
        help="Scale an object to this height.",
    ),
    click.option("--up", type=AXES, default=None, help="An object's axis that points up (y)."),
    click.option("--front", type=AXES, default=None, help="An object's axis that points to the front (+z)."),
    click.option("--mount", type=MOUNTS, default=None, help="Kind of surface on which an object stands or hangs."),
    click.option(
        "--yaw", type=_Number(-360, 360), default=None, metavar="DEGREES", help="Turn an object about its up axis."
    ),
)
limit_options = _options(
    _number("--timeout", "SECONDS", 0.1, 3600, 30, "Longest time without a byte"),
    _number("--max-time", "SECONDS", 1, 86400, 3600, "Longest time for one file"),
    _number("--max-wait", "SECONDS", 0, 86400, 120, "Longest pause that a server may ask for"),
    _number("--max-size", "MB", 0.001, 100_000, 500, "Largest file"),
)


def lock_path(lock: Path | None) -> Path:
    """The lock file: the named one, else the one in scenes_manifest/ if that exists, else in the current folder."""
    from generators.library.lock import LOCK_NAME

    if lock is not None:
        return lock
    return Path("scenes_manifest", LOCK_NAME) if Path("scenes_manifest").is_dir() else Path(LOCK_NAME)


def make_session(allowed: tuple[str, ...], options: dict[str, Any] | None = None) -> Session:
    """The session with the options of a command."""
    from generators.library.http import MEGABYTE, FetchLimits
    from generators.library.licences import spdx
    from generators.library.session import Session
    from generators.library.store import Store

    limits = FetchLimits()
    if options:
        limits = FetchLimits(
            timeout=options["timeout"],
            total=options["max_time"],
            max_bytes=round(options["max_size"] * MEGABYTE),
            max_wait=options["max_wait"],
        )
    names = tuple(dict.fromkeys(name for one in allowed for name in (one, spdx(one))))
    return Session(Store.default(), limits, names, tell, _progress())


def tell(line: str) -> None:
    """Print a line on stderr; it replaces the progress line."""
    click.echo(f"\r\x1b[K{line}" if sys.stderr.isatty() else line, err=True)


def _progress() -> Callable[[str, int, int | None], None]:
    """Show the progress line in megabytes, on a terminal only; it is erased when the file is complete."""
    if not sys.stderr.isatty():
        return lambda _what, _done, _total: None

    def show(what: str, done: int, total: int | None) -> None:
        of = f" of {total / 1e6:.1f}" if total else ""
        text = "" if total is not None and done >= total else f"{what}: {done / 1e6:.1f}{of} MB"
        click.echo(f"\r\x1b[K{text}", nl=False, err=True)

    return show


def stance_of(options: dict[str, Any]) -> Stance | None:
    """The object's orientation, height and mount from the options; unset fields are left to the collection."""
    from generators.library.session import Stance

    names = ("up", "front", "height", "mount", "yaw")
    given = {name: options[name] for name in names if options.get(name) is not None}
    up, front = given.get("up", "y"), given.get("front", "+z")
    if up[-1] == front[-1]:
        raise UsageError(f"--up {up} --front {front}: the two axes must be perpendicular; name others")
    return Stance(**given) if given else None


def take_each(items: Iterable[Any], take: Callable[[Any], AssetEntry], path: Path) -> None:
    """Process one item after the other; a failure is reported and does not stop the rest."""
    failed: list[Avs3dError] = []
    count = 0
    for item in items:
        try:
            entry = take(item)
        except (Avs3dError, OSError) as error:
            told = error if isinstance(error, Avs3dError) else Avs3dError(os_error_line(error))
            failed.append(told)
            tell(f"avs3d: error: {told}")
        else:
            count += 1
            click.echo(f"{entry.id}: {entry.attribution}")
    click.echo(f"{path}: {count} assets added or updated, {len(failed)} failed")
    if failed:
        raise SystemExit(max(error.exit_code for error in failed) if not count else 1)
