"""Messages about a manifest: one line for each problem, with the field and the line of the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from avs3d_bench.errors import excerpt
from avs3d_bench.formats.yamlfile import lines_of, step

#: Names of fields and indices of lists, from the top of the manifest.
Place = tuple[str | int, ...]
Fault = tuple[Place, str]

#: Number of problems that are named.
MOST_FAULTS = 10
#: Number of records that are named as those that have a field.
_MOST_RECORDS = 3
#: Parts of pydantic's locations that are no fields of the file: a key that is wrong, the tags of `Instances`.
_NO_STEPS = ("[key]", "[number]", "[objects]", "[rooms]", "[seconds]")
#: Steps of a record's place that stand for any index, and for any key.
_INDEX, _KEY = "N", "NAME"
#: Type of an error of pydantic → what a YAML file calls the type that was expected.
_EXPECTED = {"dict_type": "a mapping", "model_type": "a mapping", "tuple_type": "a list", "list_type": "a list"}


class FieldError(ValueError):
    """Problems that a validator found, each with its field below the record that is validated."""

    def __init__(self, *faults: Fault) -> None:
        super().__init__("; ".join(f"{place_name(place)}: {text}" for place, text in faults))
        self.faults = faults


def listed(names: Sequence[str], most: int = 8) -> str:
    """``a, b, c and 4 more``."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def place_name(place: Sequence[str | int]) -> str:
    """``observations.3.category``."""
    return ".".join(map(step, place)) or "manifest"


def in_lines(faults: Sequence[Fault], path: object, text: str) -> tuple[str, ...]:
    """A message for each problem: ``mine.yaml, line 17: observations.3.category: …``.

    Args:
        faults: the problems.
        path: of the manifest.
        text: of the manifest.
    """
    lines = lines_of(text, [place for place, _ in faults])
    return tuple(
        f"{path}" + (f", line {line}" if line is not None else "") + f": {place_name(place)}: {said}"
        for (place, said), line in zip(faults, lines, strict=True)
    )


def messages(error: ValidationError, path: object, text: str, record: type[BaseModel]) -> tuple[str, ...]:
    """A message for each problem, at most `MOST_FAULTS` and the number of those that are left out.

    Args:
        error: of the validation.
        path: of the manifest.
        text: of the manifest.
        record: the class that was validated.
    """
    found = error.errors(include_url=False)
    # A list counts only its valid entries: it is not too short where one of them is wrong.
    found = [one for one in found if one["type"] != "too_short"] or found
    faults = list(dict.fromkeys(fault for one in found for fault in _faults(one, record)))
    left = len(faults) - MOST_FAULTS
    more = [f"{path}: {left:,} more problem{'s' * (left > 1)}"] if left > 0 else []
    return (*in_lines(faults[:MOST_FAULTS], path, text), *more)


def _faults(one: Any, record: type[BaseModel]) -> Iterator[Fault]:
    """The problems that an error of pydantic stands for."""
    place = tuple(key for key in one["loc"] if str(key) not in _NO_STEPS)
    cause = one.get("ctx", {}).get("error")
    if isinstance(cause, FieldError):
        yield from ((place + below, said) for below, said in cause.faults)
    else:
        yield place, _describe(one, place, record)


def _describe(one: Any, place: Place, record: type[BaseModel]) -> str:
    kind, message = one["type"], str(one["msg"]).removeprefix("Value error, ")
    if kind == "extra_forbidden":
        return f"unknown field; {_hint(place, record)}"
    if kind == "missing":
        return "is missing"
    if kind in _EXPECTED:
        return f"expected {_EXPECTED[kind]}, found {excerpt(one['input'])}"
    if kind == "too_short":
        return f"too few entries; expected at least {one['ctx']['min_length']}"
    if kind == "too_long":
        return f"too many entries; expected at most {one['ctx']['max_length']}"
    if kind == "value_error":  # the project's own messages already contain the value found
        return message
    return f"{message} (found {excerpt(one['input'])})"


# ---- unknown fields -------------------------------------------------------------------------------------------------


def _hint(place: Place, record: type[BaseModel]) -> str:
    """Advice about a field that its record does not have: another name, or another record."""
    name, records = str(place[-1]), _records(record)
    own = next((found for at, found in records.items() if _matches(at, place[:-1])), None)
    # Its own name in another record comes before a similar one in this one.
    homes = [at for at, found in records.items() if name in found.model_fields]
    if homes:
        named = " or ".join(_home(at) for at in homes[:_MOST_RECORDS])
        return f"{name} belongs in {named}"
    if own is not None and (near := get_close_matches(name, own.model_fields, n=1)):
        return f"did you mean {near[0]!r}?"
    others = {field: at for at, found in reversed(list(records.items())) for field in found.model_fields}
    if near := get_close_matches(name, others, n=1):
        return f"did you mean {near[0]!r}, which belongs in {_home(others[near[0]])}?"
    return "correct its name, or leave it out"


def _home(at: tuple[str, ...]) -> str:
    return place_name(at) if at else "the top level"


def _matches(at: tuple[str, ...], place: Place) -> bool:
    return len(at) == len(place) and all(
        isinstance(there, int) if one == _INDEX else one in (_KEY, there) for one, there in zip(at, place, strict=True)
    )


@lru_cache(maxsize=4)
def _records(record: type[BaseModel]) -> Mapping[tuple[str, ...], type[BaseModel]]:
    """Place → class of every record below ``record``, itself included."""
    return dict(_walk(record, ()))


def _walk(record: type[BaseModel], at: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    yield at, record
    for name, field in record.model_fields.items():
        yield from _below(field.annotation, (*at, name))


def _below(annotation: Any, at: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    """The records in the type of a field."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from _walk(annotation, at)
        return
    more = {tuple: (_INDEX,), list: (_INDEX,), dict: (_KEY,)}.get(get_origin(annotation), ())
    for part in get_args(annotation):
        yield from _below(part, (*at, *more))
