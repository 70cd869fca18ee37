"""Groups of commands: one-line messages on unknown names, and options that several commands have."""

from __future__ import annotations

from typing import Any

import click

from avs3d_bench.commands.outputs import PATH as PATH
from avs3d_bench.errors import UsageError, did_you_mean

#: Settings of every command.
HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
#: Type of the option of the number of processes.
WORKERS = click.IntRange(1, 256)


#: ``--only KEY_GLOB``, repeatable; the command gets ``only``.
only_option = click.option(
    "--only", multiple=True, metavar="KEY_GLOB", help="Only observations whose key matches; repeatable."
)
#: ``--dataset ROOT``; the command gets ``root``.
dataset_option = click.option(
    "--dataset", "root", type=PATH, metavar="ROOT", required=True, help="Root of the dataset."
)


class Group(click.Group):
    """A group that answers an unknown name with the names that exist and the nearest one.

    click's own message (since 8.4) names the nearest command alone, and knows no commands of entry points.

    Args:
        noun: what its commands are called in messages.
    """

    def __init__(self, *args: Any, noun: str = "command", **options: Any) -> None:
        # click keeps the help option that a command first had: one that is called on its own has to know `-h` itself.
        super().__init__(*args, **{"context_settings": HELP, **options})
        self.noun = noun

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        """As click does it, with `HELP`."""
        cmd.context_settings = {**HELP, **cmd.context_settings}
        super().add_command(cmd, name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does it, with a hint at the nearest name."""
        known = self.list_commands(ctx)
        if args and not args[0].startswith("-") and args[0] not in known:
            hint = did_you_mean(args[0], known)
            raise UsageError(f"no {self.noun} {args[0]!r}: expected one of {', '.join(known)}{hint}")
        return super().resolve_command(ctx, args)
