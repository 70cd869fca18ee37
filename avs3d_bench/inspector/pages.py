"""The HTML of the gallery and of an observation's page.

Pages trust no input: text is escaped, and a content security policy lets them load from their own site alone. They are
plain files: opened from disk they work as they do from the server. The same input gives the same bytes.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from avs3d_bench.dataset import Dataset
from avs3d_bench.inspector.facts import Moment, few
from avs3d_bench.inspector.floorplan import map_bounds
from avs3d_bench.inspector.site import Card, ObservationSite
from avs3d_bench.taxonomy import PARTS, ROOMS
from avs3d_bench.templates import MISSING, template_environment, words

if TYPE_CHECKING:
    from jinja2 import Environment

PART_TITLES = {"part_1": "Part 1, single-instance", "part_2": "Part 2, multi-instance"}


def title(name: str | None) -> str:
    """``Washing machine`` of ``washing_machine``."""
    text = words(name)
    return text[:1].upper() + text[1:]


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = template_environment("avs3d_bench.inspector")
    environment.filters |= {"words": words, "title_case": title}
    environment.globals |= {"PART_TITLES": PART_TITLES, "MISSING": MISSING}
    return environment


def gallery_page(dataset: Dataset, cards: Sequence[Card], submissions: Sequence[str]) -> bytes:
    """The gallery; observations that cannot be shown are listed below it.

    Args:
        dataset: what is shown.
        cards: its observations, sorted by key.
        submissions: names of the submissions that the players hold.
    """
    shown = [card for card in cards if card.problem is None]
    facets = [
        ("part", "Part", _facet([card.place.part for card in shown], PARTS, PART_TITLES)),
        ("room", "Room", _facet([card.place.room for card in shown], ROOMS, {})),
        ("category", "Sounding object", _facet([card.category or "" for card in shown], (), {"": "not known"})),
    ]
    record = dataset.record
    return _render(
        "gallery.html.j2",
        root="",
        dataset=dataset,
        record=record,
        cards=cards,
        shown=shown,
        facets=facets,
        submissions=submissions,
        frames=sum(card.frames for card in shown),
    )


def _facet(values: list[str], order: Sequence[str], titles: dict[str, str]) -> list[tuple[str, str, int]]:
    """(value, label, count) of the values that occur, in ``order`` where given, else by name."""
    counts = Counter(values)
    ordered = [value for value in order if value in counts] or sorted(counts)
    return [(value, titles.get(value, words(value)), counts[value]) for value in ordered]


def observation_page(
    site: ObservationSite,
    *,
    before: str | None,
    after: str | None,
    linked: bool,
    problems: Sequence[str],
) -> bytes:
    """The page of an observation.

    Args:
        site: its files.
        before: key of the observation before it in the gallery.
        after: key of the one after it.
        linked: whether the dataset's own pictures are served at ``full/``.
        problems: one line for each file that could not be read or made.
    """
    facts = site.facts
    hidden = [site.without_paths(line) for line in few(site.observation, [*problems, *site.mask_problems])]
    return _render(
        "observation.html.j2",
        root="../../../../",
        facts=facts,
        before=before,
        after=after,
        linked=linked,
        missing=[*facts.missing, *hidden],
        submissions=site.submissions,
        dataset_name=site.dataset.name,
        swatches={number: hexadecimal(colour) for number, colour in site.colours.items()},
        data=_script_json(_player_data(site, linked)),
        track=site.track if facts.has_sound else None,
        heading=title(facts.category) if facts.category else facts.key,
    )


def problem_page(key: str, problem: str, *, before: str | None, after: str | None) -> bytes:
    """The page of an observation that cannot be shown.

    Args:
        key: of the observation.
        problem: what is wrong with which file.
        before: key of the observation before it in the gallery.
        after: key of the one after it.
    """
    file, found, what = problem.partition(": ")
    if not found:
        file, what = key, problem
    return _render("problem.html.j2", root="../../../../", key=key, file=file, what=what, before=before, after=after)


def _player_data(site: ObservationSite, linked: bool) -> dict[str, Any]:
    """What the scripts need; the names are short because every frame has them."""
    facts, bounds = site.facts, map_bounds(site.facts)
    width, height = site.size
    return {
        "key": facts.key,
        "size": [width, height],
        "frames": [_frame_data(moment) for moment in facts.moments],
        "instances": [
            {
                "id": i.id,
                "name": words(i.category),
                "sounding": i.sounding,
                "twin": not i.sounding and i.category == facts.category,
                "colour": hexadecimal(site.colours[i.id]),
                "box": [_round(v, 3) for v in (i.bounds[0][0], i.bounds[0][2], i.bounds[1][0], i.bounds[1][2])],
            }
            for i in facts.instances
        ],
        "submissions": [
            {
                "number": submission.number,
                "name": submission.name,
                "frames": [f.name for f in site.observation.test if submission.mask_path(f) is not None],
                "iou": {
                    name: _round(agreement.iou, 4) for name, agreement in site.agreements[submission.number].items()
                },
            }
            for submission in site.submissions
        ],
        "map": [bounds.left, bounds.top, bounds.width, bounds.height] if bounds else None,
        "moves": facts.moves,
        "hfov": _round(facts.hfov, 2),
        "has": {"masks": facts.has_masks, "instances": facts.has_instances and bool(site.colours),
                "sound": facts.has_sound, "full": linked},
    }  # fmt: skip


def _frame_data(moment: Moment) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": moment.name, "split": moment.split}
    if moment.position and moment.heading:
        x, _, z = moment.position
        entry["at"] = [_round(v, 3) for v in (x, z, *moment.heading)]
    if moment.source:
        entry["source"] = [_round(moment.source[0], 3), _round(moment.source[2], 3)]
    values = {
        "azimuth": _round(moment.azimuth, 1),
        "distance": _round(moment.distance, 2),
        "ild": _round(moment.ild, 2),
        "level": _round(moment.level, 1),
        "pixels": moment.visible,
        "sight": moment.line_of_sight,
    }
    return entry | {name: value for name, value in values.items() if value is not None}


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(float(value), digits) + 0.0


def hexadecimal(colour: tuple[int, int, int]) -> str:
    """``#e4572e``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _script_json(value: Any) -> str:
    """JSON that is safe inside a script element: nothing in it can end the element."""
    text = json.dumps(value, ensure_ascii=True, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _render(template: str, **values: Any) -> bytes:
    return _environment().get_template(template).render(values).encode("utf-8", "replace")
