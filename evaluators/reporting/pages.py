"""Shared by the report and the leaderboard: one self-contained HTML page, and the format of numbers and untrusted text.

A page needs no network and trusts no text: it is escaped, a link is http(s) or no link, and a content security policy
lets run the one script whose hash it names and loads nothing. The same input gives the same bytes.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from avs3d_bench.contract.questions import QUESTION_KINDS
from avs3d_bench.contract.scores import GroupScores, Metric
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.text.templates import MISSING, template_environment, words
from evaluators.reporting.signatures import GENERATORS
from evaluators.reporting.standings import MOST_METHODS
from evaluators.statistics.bootstrap import FEWEST
from evaluators.statistics.comparison import WARN_BELOW

if TYPE_CHECKING:
    from jinja2 import Environment

#: Decimals of every figure, so that a column of them lines up.
DECIMALS = 3
#: Text in place of a missing figure.
PART_TITLES = {"overall": "Overall", "part_1": "Part 1", "part_2": "Part 2", "part_3": "Part 3"}
PART_NOTES = {
    "overall": "all observations", "part_1": "single-instance", "part_2": "multi-instance", "part_3": "several sources",
}  # fmt: skip
REFERENCE_TITLES = {
    "all_black": "all black", "all_white": "all white", "centre_box": "centre box",
    "deaf_category": "deaf: every instance", "deaf_most_seen": "deaf: most seen",
    "deaf_all": "deaf oracle: all", "deaf_single": "deaf oracle: best one",
}  # fmt: skip
_UNSEEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")


def number(value: float | None) -> str:
    """``0.812``; a dash where there is none."""
    return MISSING if value is None else f"{value:.{DECIMALS}f}"


def span(pair: tuple[float, float] | None) -> str:
    """``0.790–0.830``; nothing where there is none."""
    return "" if pair is None else f"{pair[0]:.{DECIMALS}f}–{pair[1]:.{DECIMALS}f}"


def clean(text: object) -> str:
    """Text without the control characters that HTML cannot hold."""
    return _UNSEEN.sub("\N{REPLACEMENT CHARACTER}", str(text))


def shorten(text: object, length: int) -> str:
    """At most ``length`` characters, the last an ellipsis where some are left out."""
    whole = clean(text)
    return whole if len(whole) <= length else whole[: length - 1].rstrip() + "…"


def web_address(url: str | None) -> str | None:
    """The address if a link may lead to it: http or https with a host; None of anything else (``javascript:`` …)."""
    if not url:
        return None
    try:
        parts = urlsplit(url)
        host = parts.hostname
    except ValueError:
        return None
    return url if parts.scheme in ("http", "https") and host else None


def figure(group: GroupScores | None, metric: Metric) -> float | None:
    """A figure of a group; None where it is not known."""
    scores = getattr(group, metric.protocol, None)
    value: float | None = getattr(scores, metric.name, None)
    return value


def interval(group: GroupScores | None, metric: Metric) -> tuple[float, float] | None:
    """Its 95 % interval; None where it is not known.

    Files of scores of earlier versions hold intervals of two to five observations: those are left out.
    """
    scores = getattr(group, metric.protocol, None)
    if group is None or scores is None:
        return None
    pair: tuple[float, float] | None = scores.intervals.get(metric.name)
    if metric.protocol == "listen":  # resampled by group
        return pair
    count = scores.counts.get(metric.name, 0) if metric.protocol == "strict" else group.observations
    return pair if count >= FEWEST else None


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = template_environment("evaluators.reporting")
    environment.filters |= {
        "number": number, "span": span, "words": words, "clean": clean, "shorten": shorten,
        "web_address": web_address, "figure": figure, "interval": interval,
    }  # fmt: skip
    environment.globals |= {
        "FEWEST": FEWEST, "MISSING": MISSING, "WARN_BELOW": WARN_BELOW, "MOST_METHODS": MOST_METHODS,
        "PART_TITLES": PART_TITLES, "PART_NOTES": PART_NOTES, "REFERENCE_TITLES": REFERENCE_TITLES,
        "QUESTION_KINDS": QUESTION_KINDS,
    }  # fmt: skip
    return environment


def render(template: str, values: Mapping[str, Any]) -> str:
    """The page that a template in `evaluators/reporting/templates` makes of ``values``."""
    from markupsafe import Markup

    style, script = Markup(_asset("page.css") + _shared("tables.css")), Markup(page_script())
    generator = GENERATORS.get(template, "avs3d-bench")
    page = _environment().get_template(template)
    return page.render(values, style=style, script=script, script_hash=_script_hash(), generator=generator)


def report_head() -> str:
    """How every report begins: up to its title, with the policy that allows only `page_script` to run."""
    page = _environment().get_template("head.html.j2")
    return page.render(script_hash=_script_hash(), generator=GENERATORS["report.html.j2"])


def page_script() -> str:
    """The one script of every page."""
    return _asset("page.js") + _shared("tables.js")


def _shared(name: str) -> str:
    """A style or script that the viewer's pages have, too."""
    return (files("avs3d_bench.inspector") / "templates" / name).read_text(encoding="utf-8")


@lru_cache(maxsize=2)
def _asset(name: str) -> str:
    return (files("evaluators.reporting") / "templates" / name).read_text(encoding="utf-8")


def _script_hash() -> str:
    return base64.b64encode(hashlib.sha256(page_script().encode()).digest()).decode()


def write_page(path: Path, template: str, values: Mapping[str, Any]) -> None:
    """Render and write atomically.

    Raises:
        Avs3dError: if the file cannot be written.
    """
    write_bytes(path, render(template, values).encode("utf-8", "replace"))
