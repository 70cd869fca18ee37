"""The HTML of the gallery and of an observation's page.

Pages trust no input: text is escaped, and a content security policy lets them load from their own site alone. They are
plain files: opened from disk they work as they do from the server. The same input gives the same bytes.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from avs3d_bench.contract.layout import BACKGROUND
from avs3d_bench.contract.taxonomy import PARTS, ROOMS
from avs3d_bench.dataset import Dataset
from avs3d_bench.inspector.cards import GalleryCard
from avs3d_bench.inspector.facts import few
from avs3d_bench.inspector.floor_map import FloorMap, path_colour
from avs3d_bench.inspector.moments import Moment
from avs3d_bench.inspector.pictures import hexadecimal
from avs3d_bench.inspector.site import ObservationSite
from avs3d_bench.inspector.sources import SOUND_KINDS, ShownSource
from avs3d_bench.text.templates import MISSING, keep_units, template_environment, words

if TYPE_CHECKING:
    from jinja2 import Environment

PART_TITLES = {
    "part_1": "Part 1, single-instance",
    "part_2": "Part 2, multi-instance",
    "part_3": "Part 3, several sources",
}
MINUS = "\N{MINUS SIGN}"
#: Value of the facet "Sounding object" for what has none; no category may start with "_".
_NOTHING = "_nothing"


@dataclass(frozen=True)
class PageOf:
    """An observation's page.

    Attributes:
        site: its files.
        before: key of the observation before it in the gallery.
        after: key of the one after it.
        linked: whether the dataset's own pictures are served at ``full/``.
        problems: one line for each file that could not be read or made.
    """

    site: ObservationSite
    before: str | None
    after: str | None
    linked: bool
    problems: tuple[str, ...]


def title(name: str | None) -> str:
    """``Washing machine`` of ``washing_machine``."""
    text = words(name)
    return text[:1].upper() + text[1:]


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = template_environment("avs3d_bench.inspector")
    environment.filters |= {
        "words": words, "title_case": title, "units": keep_units, "minus": lambda text: text.replace("-", MINUS),
    }  # fmt: skip
    environment.globals |= {"PART_TITLES": PART_TITLES, "MISSING": MISSING}
    return environment


def gallery_page(dataset: Dataset, cards: Sequence[GalleryCard], submissions: Sequence[str]) -> bytes:
    """The gallery; observations that cannot be shown are listed below it.

    Args:
        dataset: what is shown.
        cards: its observations, sorted by key.
        submissions: names of the submissions that the players hold.
    """
    shown = [card for card in cards if card.problem is None]
    titles = {"": "not known", _NOTHING: "none"}
    facets = [
        ("part", "Part", _facet((card.place.part for card in shown), PARTS, PART_TITLES)),
        ("room", "Room", _facet((card.place.room for card in shown), ROOMS, {})),
        ("category", "Sounding object", _facet((c for card in shown for c in _categories(card)), (), titles)),
    ]
    kinds = _facet((kind for card in shown for kind in card.kinds), tuple(SOUND_KINDS), SOUND_KINDS)
    if kinds:
        facets.append(("scene", "Sound", kinds))
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
        categories_of=_categories,
        group_sizes=Counter(card.group for card in shown if card.group),
    )


def _categories(card: GalleryCard) -> tuple[str, ...]:
    """Values of the facet "Sounding object" that a card has."""
    if card.scene is None:
        return (card.category or "",)
    return card.categories or (_NOTHING,)


def _facet(values: Iterable[str], order: Sequence[str], titles: dict[str, str]) -> list[tuple[str, str, int]]:
    """(value, label, count) of the values that occur, in ``order`` where given, else by name."""
    counts = Counter(values)
    ordered = [value for value in order if value in counts] or sorted(counts)
    return [(value, titles.get(value, words(value)), counts[value]) for value in ordered]


def observation_page(page: PageOf) -> bytes:
    """The page of an observation."""
    site = page.site
    return _render(
        "observation.html.j2",
        **_common(page),
        submissions=site.submissions,
        siblings=site.siblings,
        data=_script_json(_player_data(site, page.linked)),
    )


def sibling_script(page: PageOf) -> bytes:
    """The script by which the page of a sibling shows this observation in its place."""
    values = _common(page)
    payload = {
        "data": _player_data(page.site, page.linked),
        "heading": values["heading"],
        "facts": _render("facts.html.j2", **values).decode(),
        "map": _render("map.html.j2", **values).decode(),
        "nav": _render("neighbours.html.j2", **values).decode(),
    }
    return f"window.AVS3D.sibling({_script_json(payload)});\n".encode()


def _common(page: PageOf) -> dict[str, Any]:
    """Values for the templates that change from sibling to sibling."""
    site, facts = page.site, page.site.facts
    lines = [*page.problems, *site.mask_problems, *site.stem_problems]
    hidden = [site.without_paths(line) for line in few(site.observation, lines)]
    return {
        "root": "../../../../",
        "facts": facts,
        "drawing": FloorMap.of(facts),
        "before": page.before,
        "after": page.after,
        "linked": page.linked,
        "missing": [*facts.missing, *hidden],
        "swatches": {number: hexadecimal(colour) for number, colour in site.colours.items()},
        "colour_of": hexadecimal,
        "track": site.track if facts.has_sound else None,
        "heading": title(facts.sound.title) if facts.sound else facts.key,
    }


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
    """Data for the scripts; the names are short because every frame has them."""
    facts, drawing = site.facts, FloorMap.of(site.facts)
    width, height = site.size
    more: dict[str, Any] = {} if facts.lanes is None else {"scene": _scene_data(site)}
    if facts.has_ambisonics:
        more["head"] = {"gain": _round(site.track.gain, 3) if facts.has_sound else 0.0}
    return more | {
        "key": facts.key,
        "size": [width, height],
        "frames": [
            _frame_data(moment) | {"colour": hexadecimal(path_colour(number, len(facts.moments)))}
            for number, moment in enumerate(facts.moments)
        ],
        "instances": [
            {
                "id": i.id,
                "name": facts.sound.names[i.id] if facts.sound else words(i.category),
                "sounding": i.sounding,
                "twin": facts.is_twin(i),
                "colour": hexadecimal(site.colours[i.id]),
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
        "map": [drawing.bounds.left, drawing.bounds.top, drawing.scale] if drawing else None,
        "moves": facts.moves,
        "open": site.opening,
        "hfov": _round(facts.hfov, 2),
        "has": {"masks": facts.has_masks, "instances": facts.has_instances and bool(site.colours),
                "sound": facts.has_sound, "full": linked},
    }  # fmt: skip


def _scene_data(site: ObservationSite) -> dict[str, Any]:
    """Data for the lanes, the map and the plots in part_3; every list has one value for each frame."""
    sound = site.facts.lanes
    assert sound is not None
    background = None
    if sound.background is not None:
        background = {
            "id": BACKGROUND,
            "name": words(sound.background.kind),
            "snr": _round(sound.background.snr_db, 1),
            "level": _round(sound.background.level_db, 1),
            "levels": _rounded(site.stem_levels.get(BACKGROUND, ()), 1),
        }
    return {
        "sources": [_source_data(source, site.stem_levels.get(source.record.id)) for source in sound.sources],
        "background": background,
        "nothing": sound.nothing,
        "stems": sound.stems,
        "gain": _round(site.track.gain, 3) if site.facts.has_sound else 0.0,
        "siblings": [{"key": sibling.key, "folder": f"../{sibling.index}/"} for sibling in site.siblings],
    }


def _source_data(source: ShownSource, levels: Sequence[float | None] | None) -> dict[str, Any]:
    record = source.record
    heard = [entry.level_db if entry else None for entry in source.heard]
    return {
        "id": record.id,
        "name": source.name,
        "room": words(record.room) if source.off_screen else None,
        "colour": hexadecimal(source.colour),
        "instance": record.instance,
        "spans": [[_round(start, 3), _round(end, 3)] for start, end in source.spans],
        "programme": source.programme,
        "gain": _round(record.gain_db, 1),
        # Without stems, the level of a frame in which the source is not audible is not known.
        "levels": _rounded(heard if levels is None else levels, 1),
        "audible": [int(entry is not None) for entry in source.heard],
        "snr": _rounded([entry.snr_db if entry else None for entry in source.heard], 1),
        "drr": _rounded([entry.drr_db if entry else None for entry in source.heard], 1),
        "azimuth": _rounded(source.azimuth, 1),
        "distance": _rounded(source.distance, 2),
        # Where it is on the map, if it moves.
        "at": [[_round(x, 3), _round(z, 3)] for x, _, z in source.places] if len({*source.places}) > 1 else None,
    }


def _rounded(values: Iterable[float | None], digits: int) -> list[float | None]:
    return [_round(value, digits) for value in values]


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


def _script_json(value: object) -> str:
    """JSON that is safe inside a script element: nothing in it can end the element."""
    text = json.dumps(value, ensure_ascii=True, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _render(template: str, **values: object) -> bytes:
    return _environment().get_template(template).render(values).encode("utf-8", "replace")
