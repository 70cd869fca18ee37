"""``--name`` of the commands that write a manifest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from avs3d_bench.errors import UsageError


def name_option(default: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option, as a decorator; the command gets ``name``.

    Args:
        default: the name that is taken without it, for the help.
    """
    text = f"Name of the manifest (default: {default})."
    return click.option("--name", default=None, metavar="NAME", callback=_checked, help=text)


def _checked(_: click.Context, __: click.Parameter, name: str | None) -> str | None:
    """The name, if a manifest may have it.

    Raises:
        UsageError: in words.
    """
    if name is None:
        return None
    from generators.manifest.schema import check_slug

    try:
        return check_slug(name)
    except ValueError as error:
        raise UsageError(f"--name: {error}") from None
