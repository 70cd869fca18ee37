"""An environment for tests that call make."""

from __future__ import annotations

import os
import re
from pathlib import Path

MAKEFILE = Path(__file__).parents[2] / "Makefile"


def environment() -> dict[str, str]:
    """This process's, without what a make above it hands to its children: its flags, and variables of the Makefile.

    The tests themselves run below make, also with variables (`make test-latest`).
    """
    names = set(re.findall(r"^(\w+) *[?:]?=", MAKEFILE.read_text(encoding="utf-8"), re.M))
    return {name: value for name, value in os.environ.items() if name not in names and not name.startswith("MAKE")}
