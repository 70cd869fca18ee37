"""Shared by the HTML pages of this project: reading their templates, and writing names in them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

MISSING = "–"


def words(name: str | None) -> str:
    """``washing machine`` of ``washing_machine``; a dash of nothing."""
    return name.replace("_", " ") if name else MISSING


_UNIT = re.compile(r"(?<=\d) (?=%|(?:dB|k?Hz|ms?|s|cm|px|pixels|bits|frames)\b)")


def keep_units(text: str) -> str:
    r"""Text whose numbers stay on one line with their units.

    Examples:
        >>> keep_units("0.8 to 3.5 m, 95 %") == "0.8 to 3.5\N{NO-BREAK SPACE}m, 95\N{NO-BREAK SPACE}%"
        True
    """
    return _UNIT.sub("\N{NO-BREAK SPACE}", text)


def template_environment(package: str) -> Environment:
    """The templates in the folder ``templates`` of a package.

    Escaping is on for every template (the usual choice by file name does not know .html.j2), and a name that is not
    defined is an error.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
