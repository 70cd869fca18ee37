"""Categories that a manifest adds to the seven of the paper: what their field says, and which names are valid.

A manifest's `categories` maps a name to a `CategorySpec`. While a manifest is validated, `declared` makes the names
known to `check_name`, which every field that holds a category uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from avs3d_bench.contract.taxonomy import CATEGORIES, OVEN, check_category, check_category_name
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from generators.core.scene import SupportKind

#: What ``stands_on`` may name → the kind of support. Every table is a side table to the scenes.
SUPPORTS: dict[str, SupportKind] = {kind: kind for kind in get_args(SupportKind)} | {"table": "side_table"}
#: Range of an object's height (m), as for the `height` of a mesh file.
HEIGHTS = (0.02, 5.0)
#: Largest distance between an object's back and the wall behind it (m); farther away, it no longer stands at the wall.
WIDEST_GAP = 0.5
#: Range of the middle of an object on a wall above the floor (m): walls are measured up to 2.1 m.
HANGING = (0.3, 2.1)

Mount = Literal["floor", "surface", "wall", "wall_or_surface"]

_declared: ContextVar[tuple[str, ...]] = ContextVar("declared_categories", default=())


@contextmanager
def declared(names: Iterable[str]) -> Iterator[None]:
    """Let `check_name` accept ``names`` beside the seven categories while the block runs."""
    token = _declared.set(tuple(names))
    try:
        yield
    finally:
        _declared.reset(token)


def check_name(value: Any, *, silent: bool = False, off_screen: bool = False) -> str:
    """As `check_category`, with the categories that the manifest being read declares.

    Raises:
        ValueError: with the names that exist and the nearest of them; pydantic adds the field's name.
    """
    try:
        return check_category(value, silent=silent, off_screen=off_screen, own=_declared.get())
    except UsageError as error:
        raise ValueError(str(error)) from None


def missing_files(name: str, field: str) -> str:
    """The message that a category of the manifest's own has no ``objects`` or ``sounds``, and what to add."""
    file = f"{name}.glb" if field == "objects" else f"{name}.wav"
    return (
        f"category {name} has no {field}, and nothing procedural replaces them; add {field}: {{{name}: "
        f"[{{file: {file}, licence: {{name: …, author: …}}}}]}}, or [{{asset: ID}}]"
    )


def _new_name(value: Any) -> str:
    try:
        check_category_name(value)
    except UsageError as error:
        raise ValueError(str(error)) from None
    if value in CATEGORIES:
        raise ValueError(f"{value} is a category of the benchmark already; leave it out, or give it another name")
    if value == OVEN:
        raise ValueError(f"{value} is always silent in the benchmark; give a category that sounds another name")
    return str(value)


def _support(value: object) -> SupportKind:
    if not isinstance(value, str) or value not in SUPPORTS:
        raise ValueError(
            f"unknown support {excerpt(value)}: expected one of {', '.join(SUPPORTS)}{did_you_mean(value, SUPPORTS)}"
        )
    return SUPPORTS[value]


def _supports(value: object) -> object:
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"expected a list of supports like [table, worktop], found {excerpt(value)}")
    return value


def _range(value: object) -> object:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError(f"expected [lowest, highest] in metres, found {excerpt(value)}")
    return value


def check_number(value: object) -> object:
    """Refuse true and false, which pydantic takes for 1 and 0.

    Raises:
        ValueError: pydantic adds the field's name.
    """
    if isinstance(value, bool):
        raise ValueError(f"expected a number, found {str(value).lower()}")
    return value


Number = Annotated[float, BeforeValidator(check_number), Field(allow_inf_nan=False)]
Height = Annotated[Number, Field(gt=HEIGHTS[0], lt=HEIGHTS[1])]
Gap = Annotated[Number, Field(ge=0.0, le=WIDEST_GAP)]
Hanging = Annotated[Number, Field(ge=HANGING[0], le=HANGING[1])]
Range = BeforeValidator(_range)
CategoryName = Annotated[str, BeforeValidator(_new_name)]
Supports = Annotated[
    tuple[Annotated[SupportKind, BeforeValidator(_support)], ...], Field(max_length=16), BeforeValidator(_supports)
]


class CategorySpec(BaseModel):
    """A category that the manifest adds: where its objects stand, and how tall they are.

    Attributes:
        stands_on: kinds of support in the order of preference (``table`` is another word for ``side_table``).
        height: range from which the height of a model is drawn (m), unless its file or asset has one of its own.
        free: whether objects on the floor stand in the open instead of with their back to a wall.
        wall_gap: range of the distance between the back of an object on the floor and the wall (m).
        wall_height: range of the middle of an object on a wall above the floor (m).
        turn: largest deviation of its direction from that of the support (degrees).
        source_height: height of the sound source, as a share of the object's height.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    stands_on: Supports
    height: Annotated[tuple[Height, Height], Range]
    free: Annotated[bool, Field(strict=True)] = False
    wall_gap: Annotated[tuple[Gap, Gap], Range] = (0.01, 0.03)
    wall_height: Annotated[tuple[Hanging, Hanging], Range] = (1.5, 1.9)
    turn: Annotated[Number, Field(ge=0.0, le=180.0)] = 5.0
    source_height: Annotated[Number, Field(ge=0.0, le=1.0)] = 0.5

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for kind in self.stands_on:
            if self.stands_on.count(kind) > 1:
                raise ValueError(f"stands_on: {kind} is listed twice (table is another word for side_table)")
        for name in ("height", "wall_gap", "wall_height"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name}: expected [lowest, highest], found [{low:g}, {high:g}]")
        for name, kind in (("free", "floor"), ("wall_gap", "floor"), ("wall_height", "wall")):
            if name in self.model_fields_set and kind not in self.stands_on:
                raise ValueError(f"{name} is for objects on the {kind}; add {kind} to stands_on, or leave it out")
        if self.free and "wall_gap" in self.model_fields_set:
            raise ValueError("wall_gap is for objects with their back to a wall; leave it out, or leave out free")
        return self

    @property
    def mount(self) -> Mount:
        """The mount of its models, which decides where a model has its origin."""
        kinds = set(self.stands_on)
        if kinds == {"floor"}:
            return "floor"
        if "wall" in kinds:
            return "wall" if len(kinds) == 1 else "wall_or_surface"
        return "surface"

    def identity(self) -> dict[str, Any]:
        """Content for digests: options that later versions added count only where they are set."""
        return self.model_dump(exclude_defaults=True)
