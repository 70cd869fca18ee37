"""`Palette`: the materials of one flat, chosen by a style and a seed, and made on first use.

A material is requested by its role (`ROLES`), e.g. ``palette.material("worktop")``; the walls and floor of a room by
``palette.finish("kitchen")``. Each role has its own random stream, derived from the palette's seed and the role's name,
so that the result does not depend on the order of requests. Each role has one material object, named after the role;
`TILES` gives `MeshBuilder` the size of its texture.
"""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError
from generators.assets import finishes
from generators.assets.styles import STYLES, Style
from generators.assets.textures import cloth, labels, outdoors, pictures, prints, surfaces, wear, wood
from generators.assets.textures.maps import Surface, roughness_map, surfaced
from generators.assets.textures.noise import Image, hex_colour, shift_colour, to_linear
from generators.core.scene import Material, Texture

T = TypeVar("T")

ROOM_KINDS = ("bathroom", "kitchen", "living_room", "hall", "bedroom")
#: Numbers of variants of the roles that have several.
RUGS, PICTURES, PRINTS, TOWELS, CUSHIONS, TONES = 3, 6, 3, 3, 4, 4

#: Metres per repeat of each material's texture; 1 for materials that are not listed (fitted or plain).
TILES: dict[str, float] = {
    **{f"floor_{room}": finishes.FLOOR for room in ROOM_KINDS},
    **{f"wall_{room}": finishes.WALL for room in ROOM_KINDS},
    **{f"accent_{room}": finishes.WALL for room in ROOM_KINDS},
    **{f"tiles_{room}": finishes.WALL_TILES for room in ("bathroom", "kitchen")},
    **dict.fromkeys(("ceiling", "skirting", "door", "door_frame", "window_frame", "window_sill", "white"), 1.0),
    **dict.fromkeys(("wood", "wood_alt", "front", "front_upper", "bath_front"), 0.8),
    **dict.fromkeys(("worktop", "butcher"), finishes.WORKTOP),
    **dict.fromkeys(("sofa", "armchair", "curtain", "sheer", "throw", "bedding", "sheet", "chair_fabric"), 0.5),
    **{f"{kind}_{k}": 0.4 for kind, n in (("towel", TOWELS), ("cushion", CUSHIONS)) for k in range(n)},
    **{f"print_{k}": 0.45 for k in range(PRINTS)},
    **dict.fromkeys(("bath_mat", "leather", "steel", "wicker"), 0.4),
    "lamp_shade": 0.5,
    "soil": 0.2,
    "cardboard": 0.3,
}

#: Width of a rug (m), over which its texture is fitted; rugs of other sizes have a coarser or finer pile.
_RUG_WIDTH = 2.4
#: Linear RGB by which the light of lamps is multiplied; all have about the luminance of warm light.
_LAMP_TINTS = {"warm": (1.0, 1.0, 1.0), "neutral": (0.93, 1.01, 1.2), "cool": (0.87, 1.02, 1.4)}
#: Bare metal reflects at least this share of red, green or blue.
_DARKEST_METAL = 0.2


@dataclass(frozen=True)
class RoomFinish:
    """The surfaces of one room.

    Attributes:
        floor, wall, ceiling, skirting: materials of these surfaces.
        accent_wall: a feature wall (another paint, wallpaper or brick); the same as ``wall`` in wet rooms.
        wall_tiles: tiles of a bathroom's walls or a kitchen's splash-back, else None.
        tile_height: height of the tiles on the walls, metres; 0 if only a splash-back is tiled.
    """

    floor: Material
    wall: Material
    accent_wall: Material
    ceiling: Material
    skirting: Material
    wall_tiles: Material | None
    tile_height: float


def _linear(code: str | NDArray[np.float64]) -> tuple[float, float, float]:
    r, g, b = to_linear(hex_colour(code) if isinstance(code, str) else code)
    return float(r), float(g), float(b)


class _Once:
    """Things that are made once each; several threads may ask for one at the same time."""

    def __init__(self) -> None:
        self._made: dict[str, Future[Any]] = {}
        self._lock = threading.Lock()

    def get(self, name: str, make: Callable[[], T]) -> T:
        """The value that ``make`` returned on the first call with this name; other callers wait for it."""
        with self._lock:
            known = self._made.get(name)
            own = self._made[name] = Future() if known is None else known
        if known is None:
            try:
                own.set_result(make())
            except BaseException as error:
                own.set_exception(error)
        made: T = own.result()
        return made


class Palette:
    """The materials of one flat; safe to use from several threads at once.

    Args:
        style: a key of `STYLES`.
        entropy: the seed from which all its random streams are derived.

    Raises:
        UsageError: if there is no such style.
    """

    def __init__(self, style: str, entropy: int) -> None:
        if style not in STYLES:
            raise UsageError(f"unknown style {style!r}: expected one of {', '.join(STYLES)}")
        self.style = style
        self.entropy = entropy
        self._made, self._shared = _Once(), _Once()

    @classmethod
    def from_seed(cls, rng: np.random.Generator, style: str | None = None) -> Palette:
        """A palette drawn from ``rng`` (in the given style, or any)."""
        chosen = tuple(STYLES)[int(rng.integers(len(STYLES)))]
        return cls(style or chosen, int(rng.integers(2**62)))

    def stream(self, purpose: str) -> np.random.Generator:
        """The palette's random number generator for one purpose; the same on every call."""
        key = (zlib.crc32(purpose.encode()),)
        return np.random.default_rng(np.random.SeedSequence(self.entropy, spawn_key=key))

    def material(self, role: str) -> Material:
        """The material of a role (`ROLES`), made on first use.

        Raises:
            UsageError: if there is no such role.
        """
        recipe = _RECIPES.get(role)
        if recipe is None:
            raise UsageError(f"unknown material role {role!r}: expected one of {', '.join(_RECIPES)}")
        return self._made.get(role, lambda: recipe(self, STYLES[self.style], role, self.stream(role)))

    def tinted(self, role: str, code: str) -> Material:
        """The plain material of a role in another colour (``"#rrggbb"``), one object per role and colour."""
        name = f"{role} {code}"
        return self._made.get(name, lambda: replace(self.material(role), name=name, colour=_linear(code)))

    def prepare(self, pool: Executor) -> None:
        """Let ``pool`` make all materials, those first that take longest and that most flats have.

        Whoever asks for one meanwhile waits for it, or makes it if nobody has begun. Each material has a random stream
        of its own, so that its bytes do not depend on when it is made. About a seventh of the work is for materials
        that a flat turns out not to have; cancel what is left when the flat is built.
        """
        for role in (*_LONGEST, *(role for role in ROLES if role not in _LONGEST)):
            pool.submit(self.material, role)

    def shared(self, purpose: str, make: Callable[[np.random.Generator], T]) -> T:
        """Textures that several roles share, made once."""
        return self._shared.get(purpose, lambda: make(self.stream(purpose)))

    def finish(self, room: str) -> RoomFinish:
        """The surfaces of a room of ``ROOM_KINDS``.

        Raises:
            UsageError: if there is no such kind of room.
        """
        if room not in ROOM_KINDS:
            raise UsageError(f"unknown room {room!r}: expected one of {', '.join(ROOM_KINDS)}")
        wet = room in ("bathroom", "kitchen")
        height = float(self.stream("tile_height").choice([1.2, 1.44, 2.1])) if room == "bathroom" else 0.0
        return RoomFinish(
            floor=self.material(f"floor_{room}"),
            wall=self.material(f"wall_{room}"),
            accent_wall=self.material(f"wall_{room}" if wet else f"accent_{room}"),
            ceiling=self.material("ceiling"),
            skirting=self.material("skirting"),
            wall_tiles=self.material(f"tiles_{room}") if wet else None,
            tile_height=height,
        )

    def choose(self, purpose: str, options: tuple) -> object:  # type: ignore[type-arg]
        """One of ``options``, the palette's choice for ``purpose``."""
        return options[int(self.stream(f"choose {purpose}").integers(len(options)))]


Recipe = Callable[[Palette, Style, str, np.random.Generator], Material]


def _textured(role: str, acoustic: str, surface: Surface | Image, roughness: float = 1, **more: Any) -> Material:
    return surfaced(role, acoustic, surface, roughness, TILES.get(role, 1.0), **more)


def _touched(recipe: Recipe) -> Recipe:
    """A polished material on which hands and cloths have left traces."""

    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        clean = recipe(palette, style, role, rng)
        matte = palette.shared("smudges", surfaces.smudges)

        def traces(_: np.random.Generator) -> tuple[float, Texture]:
            factor, pixels = roughness_map(matte, clean.roughness)
            return factor, Texture("smudges", pixels)

        factor, texture = palette.shared(f"smudges {clean.roughness}", traces)
        return replace(clean, roughness=factor, roughness_map=texture)

    return make


def _board(role: str, spec: str, rng: np.random.Generator, roughness: float = 0.72, use: float = 0.0) -> Material:
    """A wooden or lacquered board: ``wood:<species>`` or a paint's hex, which yellows with ``use`` (0 to 1)."""
    if spec.startswith("wood:"):
        return _textured(role, "wood", wood.veneer(rng, spec[5:]), roughness)
    return _textured(role, "wood", wood.painted(rng, wear.yellowed(hex_colour(spec), use)), roughness)


def _plain(
    acoustic: str, colour: str, roughness: float = 1, emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Recipe:
    return lambda palette, style, role, rng: Material(
        role, acoustic, _linear(colour), None, emission, roughness=roughness
    )


def _boards(field: str, roughness: float = 0.72) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        spec = str(palette.choose(field, getattr(style, field)))
        if field in ("wood", "wood_alt"):
            spec = f"wood:{spec}"
        return _board(role, spec, rng, roughness, style.wear)

    return make


def _metal(field: str) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        colour = _linear(str(palette.choose(field, getattr(style, field))))
        # Dark handles and taps are lacquered.
        return Material(role, "metal", colour, roughness=0.16, metallic=float(max(colour) > _DARKEST_METAL))

    return make


def _bare_metal(colour: str, roughness: float, make: Callable[..., Surface] | None = None) -> Recipe:
    def recipe(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        if make is None:
            return Material(role, "metal", _linear(colour), roughness=roughness, metallic=1.0)
        return _textured(role, "metal", make(rng, hex_colour(colour)), roughness, metallic=1.0)

    return recipe


def _upholstery(index: int) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        order = palette.stream("upholstery").permutation(len(style.upholstery))
        kind, code = style.upholstery[int(order[index % len(order)])]
        colour = hex_colour(code)
        if kind == "leather":
            return _textured(role, "upholstery", surfaces.leather(rng, colour), 0.64)
        if kind == "weave":
            other = shift_colour(colour, value=0.14, saturation=-0.2)
            return _textured(role, "upholstery", cloth.weave(rng, colour, second=other))
        return _textured(role, "upholstery", {"boucle": cloth.boucle, "velvet": cloth.velvet}[kind](rng, colour))

    return make


def _cushion(index: int) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        order = palette.stream("cushions").permutation(len(style.cushions))
        colour = hex_colour(style.cushions[int(order[index % len(order)])])
        made = (cloth.weave, cloth.velvet, cloth.knit)[int(rng.integers(3))]
        return _textured(role, "upholstery", made(rng, colour))

    return make


def _print(index: int) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        order = palette.stream("cushions").permutation(len(style.cushions))
        ink = hex_colour(style.cushions[int(order[(index + 1) % len(order)])])
        motif = ("stripes", "checks", "zigzag", "dots")[int(rng.integers(4))]
        return _textured(role, "fabric", cloth.printed(rng, hex_colour("#dfd9cb"), ink, motif=motif))

    return make


def _textile(field: str, make: Callable[..., Surface], label: str, index: int = 0) -> Recipe:
    def recipe(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        options = getattr(style, field)
        order = palette.stream(field).permutation(len(options))
        return _textured(role, label, make(rng, hex_colour(options[int(order[index % len(order)])])))

    return recipe


def _rug(index: int) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        pattern, codes = style.rugs[index % len(style.rugs)]
        colours = tuple(hex_colour(c if len(c) == 7 else "#dcd6ca") for c in codes)
        return surfaced(role, "carpet", cloth.rug(rng, colours, pattern=pattern), 1, _RUG_WIDTH)

    return make


def _picture(index: int) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        colours = tuple(hex_colour(style.art[int(k)]) for k in rng.permutation(len(style.art)))
        motif = pictures.PAINTINGS[index % len(pictures.PAINTINGS)]
        return _textured(role, "paper", pictures.painting(rng, colours, motif=motif), clearcoat=1.0)

    return make


def _tone(index: int) -> Recipe:
    """Plain colours of small things: covers, boxes, toys."""

    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        colours = (*style.cushions, *style.art)
        order = palette.stream("tones").permutation(len(colours))
        return Material(role, "plastic", _linear(colours[int(order[index])]), roughness=0.6)

    return make


def _paint(field: str) -> Recipe:
    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        return Material(role, "wood", _linear(str(palette.choose(field, getattr(style, field)))), roughness=0.64)

    return make


def _drawn(acoustic: str, make: Callable[[np.random.Generator], Surface | Image], roughness: float = 1) -> Recipe:
    return lambda palette, style, role, rng: _textured(role, acoustic, make(rng), roughness)


def _tinted(acoustic: str, make: Callable[..., Surface | Image], colour: str, roughness: float = 1) -> Recipe:
    return lambda palette, style, role, rng: _textured(role, acoustic, make(rng, hex_colour(colour)), roughness)


def _lamp_tint(palette: Palette, style: Style) -> NDArray[np.float64]:
    return np.array(_LAMP_TINTS[str(palette.choose("lamps", style.lamps))])


def _lamp_shade(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    r, g, b = (float(c) for c in np.array((15.0, 11.5, 7.6)) * _lamp_tint(palette, style))
    return _textured(role, "fabric", cloth.curtain(rng, hex_colour("#efe2c8")), emission=(r, g, b))


def _glowing(colour: str, radiance: tuple[float, float, float]) -> Recipe:
    """Glass of a lamp, in the tint of the home's lamps."""

    def make(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
        r, g, b = (float(c) for c in np.array(radiance) * _lamp_tint(palette, style))
        return Material(role, "glass", _linear(colour), None, (r, g, b), roughness=0.49)

    return make


def _worktop(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    return finishes.worktop(role, str(palette.choose("worktops", style.worktops)), rng)


def _floor(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    room = role.removeprefix("floor_")
    if room in ("bathroom", "kitchen"):
        # In a third of the flats the kitchen has the dry floor, too.
        order = palette.stream("wet_floors").permutation(len(style.wet_floors))
        if room == "bathroom" or palette.stream("kitchen floor").random() < 0.66:
            kind, colours = style.wet_floors[int(order[0 if room == "bathroom" else 1])]
            return _used(
                finishes.wet_floor(role, kind, tuple(hex_colour(c) for c in colours), rng), wear.trodden, style, rng
            )
    kind, spec = style.floors[int(palette.stream("floors").integers(len(style.floors)))]
    label, roughness = finishes.DRY_FLOORS[kind]

    def lay(stream: np.random.Generator) -> Material:
        new = surfaced("dry_floor", label, finishes.dry_floor(kind, spec, stream), roughness, finishes.FLOOR)
        return _used(new, wear.trodden, style, stream)

    return replace(palette.shared("dry floor", lay), name=role)


def _wall(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    colour = hex_colour(style.walls[int(rng.integers(len(style.walls)))])
    rough = 3.0 if "lime" in style.wall_finish else 1.0
    paint = surfaces.wall_paint(rng, wear.yellowed(colour, style.wear), rough=rough)
    stained = wear.stained(rng, paint.pixels, 0.35 * style.wear)
    return _textured(role, "plaster", paint._replace(pixels=stained))


def _accent(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    finish = style.wall_finish[int(rng.integers(len(style.wall_finish)))]
    return finishes.accent_wall(role, finish, style, rng)


def _wall_tiles(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    order = palette.stream("wall_tiles").permutation(len(style.wall_tiles))
    kind, colour, grout = style.wall_tiles[int(order[0 if role == "tiles_bathroom" else 1])]
    return _used(finishes.wall_tiles(role, kind, hex_colour(colour), hex_colour(grout), rng), wear.stained, style, rng)


def _used(
    new: Material, use: Callable[[np.random.Generator, Image, float], Image], style: Style, rng: np.random.Generator
) -> Material:
    """A material with the traces of use that its style has."""
    assert new.texture is not None
    return replace(new, texture=Texture(new.name, use(rng, new.texture.pixels, style.wear)))


def _skirting(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    return _used(_boards("skirting")(palette, style, role, rng), wear.scuffed, style, rng)


def _books(palette: Palette, style: Style, role: str, rng: np.random.Generator) -> Material:
    codes = (*style.art, *style.cushions, "#e0d9c8", "#2f3336", "#7a2e2a")
    return _textured(role, "paper", pictures.book_spines(rng, tuple(hex_colour(c) for c in codes)))


_RECIPES: dict[str, Recipe] = {
    **{f"floor_{room}": _floor for room in ROOM_KINDS},
    **{f"wall_{room}": _wall for room in ROOM_KINDS},
    **{f"accent_{room}": _accent for room in ROOM_KINDS},
    "tiles_bathroom": _wall_tiles,
    "tiles_kitchen": _wall_tiles,
    "ceiling": _tinted("plaster", surfaces.wall_paint, "#edebe6"),
    "skirting": _skirting,
    "door_frame": _boards("skirting"),
    "door": _boards("doors"),
    "window_frame": _boards("frames", 0.45),
    "window_sill": _tinted("wood", wood.painted, "#e8e6e0", 0.4),
    "window_view": _drawn("glass", outdoors.outdoors, 0.49),
    "wood": _boards("wood", 0.5),
    "wood_alt": _boards("wood_alt", 0.5),
    "butcher": lambda palette, style, role, rng: finishes.worktop(role, "wood:oak", rng),
    "front": _boards("fronts", 0.4),
    "front_upper": _boards("fronts_upper", 0.4),
    "bath_front": _boards("fronts", 0.36),
    "white": _tinted("wood", wood.painted, "#e6e4df", 0.4),
    "accent_paint": _paint("accent_paint"),
    "worktop": _worktop,
    "metal": _metal("metal"),
    "tap": _metal("tap"),
    "chrome": _bare_metal("#dcdee0", 0.05),
    "mirror": _bare_metal("#ebeeee", 0.0),
    "black_metal": _plain("metal", "#3a3a3b", 0.42),
    "steel": _bare_metal("#c3c5c7", 0.28, surfaces.brushed),
    "enamel": _plain("metal", "#e6e6e3", 0.2),
    "radiator": _plain("metal", "#e7e6e2", 0.35),
    "ceramic": _plain("ceramic", "#e9e8e4", 0.1),
    "ceramic_accent": _paint("accent_paint"),
    "glass": _plain("glass", "#b9c8ca", 0.05),
    "clear_glass": lambda palette, style, role, rng: Material(
        role, "glass", _linear("#e6ede9"), roughness=0.02, transmission=0.95
    ),
    "black_glass": _touched(_plain("glass", "#303134", 0.04)),
    "screen": _touched(_drawn("glass", pictures.tv_screen, 0.12)),
    "hob": _touched(_drawn("glass", pictures.hob, 0.04)),
    "oven_panel": lambda palette, style, role, rng: _textured(
        role, "metal", pictures.oven_panel(rng, hex_colour("#b6b9bb")), 0.36
    ),
    "plastic_white": _plain("plastic", "#e2e1dc", 0.72),
    "plastic_black": _plain("plastic", "#333334", 0.72),
    "wicker": _tinted("wood", surfaces.wicker, "#c49c68"),
    "leather": _tinted("upholstery", surfaces.leather, "#6f462e", 0.64),
    "sofa": _upholstery(0),
    "armchair": _upholstery(1),
    "chair_fabric": _upholstery(2),
    **{f"cushion_{k}": _cushion(k) for k in range(CUSHIONS)},
    **{f"print_{k}": _print(k) for k in range(PRINTS)},
    "throw": _textile("cushions", cloth.knit, "fabric", 1),
    "curtain": _textile("textiles", cloth.curtain, "curtain"),
    "sheer": _tinted("curtain", cloth.curtain, "#e9e6df"),
    "bedding": _textile("bedding", cloth.weave, "fabric"),
    "sheet": _tinted("fabric", cloth.curtain, "#e6e4de"),
    **{f"towel_{k}": _textile("towels", cloth.terry, "fabric", k) for k in range(TOWELS)},
    "bath_mat": _textile("towels", cloth.carpet, "carpet", 1),
    **{f"rug_{k}": _rug(k) for k in range(RUGS)},
    **{f"picture_{k}": _picture(k) for k in range(PICTURES)},
    "mount_board": lambda palette, style, role, rng: Material(role, "paper", _linear("#e9e6dd"), clearcoat=1.0),
    "books": _books,
    "paper": _plain("paper", "#e2dccb"),
    "leaf": _tinted("foliage", pictures.leaf, "#4b7440"),
    "leaf_alt": _tinted("foliage", pictures.leaf, "#6b8a4a"),
    "stem": _plain("wood", "#6d5a3c"),
    "soil": _tinted("plaster", surfaces.soil, "#55432f"),
    "pot": _plain("ceramic", "#b5714d"),
    "pot_white": _plain("ceramic", "#dedbd3", 0.49),
    "labels": _drawn("paper", labels.label_sheet, 0.7),
    "fruit_orange": _plain("foliage", "#dd8a35", 0.81),
    "fruit_green": _plain("foliage", "#8aa843", 0.81),
    "fruit_red": _plain("foliage", "#b23a32", 0.81),
    "lamp_shade": _lamp_shade,
    "lamp_glass": _glowing("#f2ead8", (19.0, 15.5, 11.0)),
    "bulb": _glowing("#fff1d6", (60.0, 46.0, 30.0)),
    "hood_light": _plain("glass", "#efe6d6", 0.49, (22.0, 19.0, 14.5)),
    **{f"tone_{k}": _tone(k) for k in range(TONES)},
    "toy_red": _plain("plastic", "#b8402f", 0.5),
    "toy_yellow": _plain("plastic", "#d9ae3c", 0.5),
    "toy_blue": _plain("plastic", "#3d6c97", 0.5),
    "toy_green": _plain("plastic", "#5a8a4b", 0.5),
    "page": _drawn("paper", prints.page),
    "keyboard": _drawn("plastic", prints.keyboard, 0.6),
    "cardboard": _tinted("paper", prints.cardboard, "#b48c5f"),
}

#: All roles for which a palette has a material.
ROLES = tuple(_RECIPES)
#: The roles whose textures take longest, longest first (see `Palette.prepare`).
_LONGEST = (
    "floor_bathroom",
    "floor_kitchen",
    "tiles_bathroom",
    "tiles_kitchen",
    "floor_living_room",
    *(f"picture_{k}" for k in reversed(range(PICTURES))),
    "hob",
    "window_view",
    *(f"wall_{room}" for room in ROOM_KINDS),
    *(f"accent_{room}" for room in ROOM_KINDS),
)
