"""Parts that many pieces share: cabinet fronts, handles, carcasses, taps, legs, books, vases and bowls."""

from __future__ import annotations

import numpy as np

from generators.assets.forms import rounded_rectangle
from generators.assets.furniture.common import Kit
from generators.assets.shapes import rotation
from generators.assets.styles import STYLES
from generators.assets.textures.pictures import SPINES
from generators.core.scene import Material

#: Profile of a turned leg: radius and height, in units of its own.
TURNED_LEG = np.array(
    [
        (0, 0),
        (0.55, 0),
        (0.7, 0.06),
        (0.5, 0.12),
        (0.62, 0.3),
        (1.0, 0.66),
        (0.72, 0.74),
        (1.05, 0.8),
        (1.05, 1),
        (0, 1),
    ]
)
HANDLES = ("bar", "knob", "cup", "groove")


def handle(
    kit: Kit, at: tuple[float, float, float], material: Material, *, style: str, length: float, axis: str
) -> None:
    """A handle centred ``at`` a point of a front that faces +Z; ``axis`` ``"x"`` or ``"y"`` is its direction."""
    x, y, z = at
    if style == "knob":
        profile = [
            (0.0, 0.0),
            (0.007, 0.0),
            (0.006, 0.012),
            (0.015, 0.017),
            (0.016, 0.023),
            (0.011, 0.027),
            (0.0, 0.028),
        ]
        kit.lathe(profile, material, centre=at, segments=12, rotate=rotation("x", 90))
        return
    if style == "cup" and axis == "x":
        t = np.linspace(0, np.pi, 7)
        rows = [
            np.stack([x + 0.045 * np.cos(t) * w, np.full(7, y + 0.012 - drop), z + 0.026 * np.sin(t) * w], axis=1)
            for drop, w in ((0.0, 0.55), (0.006, 0.9), (0.03, 1.0))
        ]
        kit.shell(np.array(rows), 0.002, material)
        return
    half = length / 2
    along = np.array([1.0, 0.0, 0.0]) if axis == "x" else np.array([0.0, 1.0, 0.0])
    centre = np.array([x, y, z + 0.03])
    kit.rod(centre - along * half, centre + along * half, 0.0055, material)
    for side in (-1, 1):
        foot = np.array(at) + along * side * half * 0.8
        kit.rod(foot, foot + np.array([0.0, 0.0, 0.028]), 0.0045, material, sides=6)


#: Half of the joint between two doors or drawers (m).
GAP = 0.002


def front(
    kit: Kit,
    x: tuple[float, float],
    y: tuple[float, float],
    z: float,
    material: Material,
    *,
    shaker: bool = False,
    pull: tuple[str, str, Material] | None = None,
    grain: str | None = None,
) -> None:
    """A door or drawer front with its back at ``z``, a gap all round, and a handle.

    ``pull`` is (style, place, material); the place is ``top``, ``middle``, ``left``, ``right`` (of a door, at
    its upper end), ``left_low`` or ``right_low`` (of wall cabinets).
    """
    x0, x1, y0, y1 = x[0] + GAP, x[1] - GAP, y[0] + GAP, y[1] - GAP
    face = z + 0.019
    with kit.grained(grain or ("y" if y1 - y0 > x1 - x0 else "x")):
        if shaker and min(x1 - x0, y1 - y0) > 0.2:
            rail = 0.062
            kit.panel((x0 + 0.01, y0 + 0.01, z), (x1 - 0.01, y1 - 0.01, face - 0.009), material, bevel=0.0)
            kit.panel((x0, y0, z), (x0 + rail, y1, face), material, bevel=0.0025)
            kit.panel((x1 - rail, y0, z), (x1, y1, face), material, bevel=0.0025)
            with kit.grained("x"):
                kit.panel((x0 + rail, y0, z), (x1 - rail, y0 + rail, face), material, bevel=0.0025)
                kit.panel((x0 + rail, y1 - rail, z), (x1 - rail, y1, face), material, bevel=0.0025)
        else:
            kit.panel((x0, y0, z), (x1, y1, face), material, bevel=0.002)
    if pull is None or pull[0] == "groove":
        return
    style, place, metal = pull
    width, height = x1 - x0, y1 - y0
    if place in ("top", "middle"):
        rise = y1 - min(0.05, height / 2) if place == "top" else (y0 + y1) / 2
        handle(kit, ((x0 + x1) / 2, rise, face), metal, style=style, length=min(0.3 * width + 0.05, 0.32), axis="x")
    else:
        side = x0 + 0.035 if place.startswith("left") else x1 - 0.035
        reach = min(0.16, 0.35 * height)
        rise = y0 + 0.05 + reach / 2 if place.endswith("low") else y1 - 0.05 - reach / 2
        handle(kit, (side, rise, face), metal, style="bar" if style == "cup" else style, length=reach, axis="y")


def pull_style(kit: Kit, place: str, role: str = "metal") -> tuple[str, str, Material]:
    """The kind of handle that this flat uses."""
    return str(kit.palette.choose("handles", HANDLES)), place, kit.m(role)


def is_shaker(kit: Kit) -> bool:
    """Whether the flat's cabinet fronts are framed."""
    return bool(kit.palette.stream("shaker").random() < STYLES[kit.palette.style].shaker)


def carcass(
    kit: Kit,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    material: Material,
    board: float = 0.018,
) -> None:
    """An open box of boards (sides, bottom, top, back) without a front."""
    x0, y0, z0 = low
    x1, y1, z1 = high
    kit.panel((x0, y0, z0), (x0 + board, y1, z1), material, bevel=0.0015)
    kit.panel((x1 - board, y0, z0), (x1, y1, z1), material, bevel=0.0015)
    kit.panel((x0 + board, y0, z0), (x1 - board, y0 + board, z1), material, bevel=0.0)
    kit.panel((x0 + board, y1 - board, z0), (x1 - board, y1, z1), material, bevel=0.0)
    kit.panel((x0 + board, y0 + board, z0), (x1 - board, y1 - board, z0 + 0.008), material, bevel=0.0)


def tap(
    kit: Kit, at: tuple[float, float, float], material: Material, *, style: str, height: float, reach: float
) -> None:
    """A mixer tap whose spout leaves its foot ``at`` towards +Z: ``arc`` (gooseneck) or ``block``."""
    x, y, z = at
    if style == "arc":
        kit.cylinder(0.024, 0.05, (x, y + 0.025, z), material, segments=14, bevel=0.004)
        r = reach / 2
        t = np.linspace(np.pi, 0.12 * np.pi, 9)
        bow = np.stack([np.full(9, x), y + height - r + r * np.sin(t), z + r + r * np.cos(t)], axis=1)
        path = np.concatenate([[[x, y + 0.04, z]], bow, bow[-1:] - [[0.0, 0.025, 0.0]]])
        kit.tube(path, 0.0115, material, segments=9)
        kit.rod((x + 0.02, y + 0.035, z), (x + 0.075, y + 0.065, z), 0.006, material, end_radius=0.005)
    else:
        kit.panel((x - 0.022, y, z - 0.022), (x + 0.022, y + height, z + 0.022), material, bevel=0.006)
        spout = ((x - 0.018, y + height * 0.62, z), (x + 0.018, y + height * 0.62 + 0.022, z + reach))
        kit.panel(*spout, material, bevel=0.005)
        kit.panel((x - 0.011, y + height + 0.004, z - 0.03), (x + 0.011, y + height + 0.012, z + 0.05), material)


def book_row(
    kit: Kit, x: tuple[float, float], y: float, z_front: float, tallest: float, *, depth: float = 0.17, most: int = 14
) -> float:
    """Books side by side from ``x[0]``, spines at ``z_front``; returns where the row ends.

    The last book leans sometimes. Spines come from the atlas of the role ``books``; pages and covers are plain.
    """
    columns, rows = SPINES
    at = x[0]
    for _ in range(most):
        thick, tall = float(kit.rng.uniform(0.018, 0.05)), float(min(tallest, kit.rng.uniform(0.19, 0.29)))
        if at + thick > x[1]:
            break
        z1 = z_front - float(kit.rng.uniform(0.0, 0.02))
        z0 = z1 - depth * float(kit.rng.uniform(0.85, 1.0))
        cell = int(kit.rng.integers(columns * rows))
        book(kit, (at + 0.0005, y, z0), (at + thick - 0.0005, y + tall, z1), cell)
        at += thick
    return at


def book(
    kit: Kit, low: tuple[float, float, float], high: tuple[float, float, float], cell: int, *, lying: bool = False
) -> None:
    """One book: the spine to the front from a cell of the atlas, covers of its colour at its sides, pages on top.

    ``lying``: the covers are above and below, and the pages at its sides.
    """
    books, paper = kit.m("books"), kit.m("paper")
    columns, rows = SPINES
    r, c = divmod(cell, columns)
    u0, u1, v0, v1 = c / columns, (c + 1) / columns, 1 - (r + 1) / rows, 1 - r / rows
    (x0, y0, z0), (x1, y1, z1) = low, high

    def face(corners: list[tuple[float, float, float]], material: Material, window: tuple[float, ...]) -> None:
        a, b, s, t = window
        chart = np.array([[a, s], [b, s], [b, t], [a, t]])
        index = np.array([[0, 1, 2], [0, 2, 3]])
        kit.add(np.array(corners), index, material, uv=chart[index])

    spine = (u0, u1, v0, v1)
    cover = (u0 + 0.12 * (u1 - u0), u0 + 0.18 * (u1 - u0), v0 + 0.01, v0 + 0.03)
    pages = (0.0, 1.0, 0.0, 1.0)
    side, level = ((paper, pages), (books, cover)) if lying else ((books, cover), (paper, pages))
    face([(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)], books, spine)
    face([(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)], *side)
    face([(x1, y0, z1), (x1, y0, z0), (x1, y1, z0), (x1, y1, z1)], *side)
    face([(x0, y1, z1), (x1, y1, z1), (x1, y1, z0), (x0, y1, z0)], *level)
    face([(x1, y0, z0), (x0, y0, z0), (x0, y1, z0), (x1, y1, z0)], paper, pages)
    face([(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)], *level)


def book_pile(kit: Kit, x: float, y: float, z: float, count: int) -> float:
    """Books lying flat about (x, z), each turned a little; returns the height of their top."""
    for _ in range(count):
        w, d = float(kit.rng.uniform(0.15, 0.21)), float(kit.rng.uniform(0.21, 0.28))
        t = float(kit.rng.uniform(0.016, 0.034))
        turn = rotation("y", float(kit.rng.uniform(-14, 14)))
        lying = Kit(kit.palette, kit.rng)
        cell = int(kit.rng.integers(SPINES[0] * SPINES[1]))
        book(lying, (-d / 2, 0.0, -w / 2), (d / 2, t, w / 2), cell, lying=True)
        kit.merge(lying.build(), centre=(x, y, z), rotate=turn)
        y += t
    return y


def vase(kit: Kit, at: tuple[float, float, float], material: Material, height: float) -> None:
    """A turned vase with an opening."""
    form = kit.pick("bottle", "belly", "cone")
    outer = {
        "bottle": [(0.30, 0.0), (0.36, 0.1), (0.38, 0.35), (0.30, 0.55), (0.13, 0.7), (0.11, 0.92), (0.15, 1.0)],
        "belly": [(0.22, 0.0), (0.40, 0.2), (0.46, 0.45), (0.36, 0.72), (0.2, 0.88), (0.24, 1.0)],
        "cone": [(0.18, 0.0), (0.22, 0.3), (0.28, 0.7), (0.34, 1.0)],
    }[form]
    lip = outer[-1]
    inner = [(lip[0] - 0.035, 1.0), (lip[0] - 0.05, 0.8), (0.0, 0.75)]
    profile = np.array([(0.0, 0.0), *outer, *inner]) * height
    kit.lathe(profile, material, centre=at, segments=14)


def bowl(kit: Kit, at: tuple[float, float, float], material: Material, radius: float, height: float) -> None:
    """An open bowl."""
    outer = [(0.0, 0.0), (0.45, 0.0), (0.72, 0.22), (0.92, 0.62), (1.0, 1.0)]
    inner = [(0.95, 1.0), (0.85, 0.6), (0.62, 0.26), (0.3, 0.14), (0.0, 0.12)]
    kit.lathe(np.array(outer + inner) * (radius, height), material, centre=at, segments=15)


def fruit_bowl(kit: Kit, at: tuple[float, float, float]) -> None:
    """A bowl of fruit in the colours of oranges, apples and pears."""
    x, y, z = at
    bowl(kit, at, kit.m(kit.pick("pot_white", "wood", "ceramic_accent")), 0.13, 0.075)
    for k in range(6):
        a = k * 2 * np.pi / 5
        role = kit.pick("fruit_orange", "fruit_green", "fruit_red")
        place = (x, y + 0.105, z) if k == 5 else (x + 0.062 * np.cos(a), y + 0.064, z + 0.062 * np.sin(a))
        kit.sphere((0.036, 0.034, 0.036), place, kit.m(role), rings=7, segments=10)


def wooden_legs(
    kit: Kit,
    x: tuple[float, float],
    z: tuple[float, float],
    height: float,
    material: Material,
    *,
    splay: float = 0.0,
    radius: float = 0.018,
) -> None:
    """Four legs at the corners: tapered round ones, their feet ``splay`` metres further out, square or turned ones."""
    form = str(kit.palette.choose("legs", STYLES[kit.palette.style].legs))
    for px in x:
        for pz in z:
            sx, sz = np.sign(px - sum(x) / 2), np.sign(pz - sum(z) / 2)
            if form == "square":
                r = 0.95 * radius
                kit.panel((px - r, 0.0, pz - r), (px + r, height, pz + r), material, bevel=0.002)
                continue
            if form == "turned" and height > 0.1:
                kit.lathe(TURNED_LEG * (radius, height), material, centre=(px, 0.0, pz), segments=10)
                continue
            kit.rod(
                (px + sx * splay, 0.0, pz + sz * splay), (px, height, pz), radius * 0.62, material, end_radius=radius
            )


def ring_stack(
    sizes: list[tuple[float, float, float, float]], *, centre: tuple[float, float] = (0.0, 0.0), per_corner: int = 6
) -> np.ndarray:
    """(R, N, 3) rounded-rectangle rings of (width, depth, corner radius, height) for `Kit.loft`."""
    rings = []
    for width, depth, radius, height in sizes:
        flat = rounded_rectangle(width, depth, radius, steps=per_corner - 1)
        rings.append(np.stack([flat[:, 0] + centre[0], np.full(len(flat), height), flat[:, 1] + centre[1]], axis=1))
    return np.array(rings)


def picture_frame(kit: Kit, w: float, h: float, band: float, depth: float, material: Material) -> None:
    """Four mitre-less strips round a rectangle about the origin, back at z = 0."""
    with kit.grained("y"):
        for side in (-1, 1):
            x0, x1 = sorted((side * w / 2, side * (w / 2 - band)))
            kit.panel((x0, -h / 2, 0.0), (x1, h / 2, depth), material, bevel=0.004)
    with kit.grained("x"):
        for side in (-1, 1):
            y0, y1 = sorted((side * h / 2, side * (h / 2 - band)))
            kit.panel((-w / 2 + band, y0, 0.0), (w / 2 - band, y1, depth), material, bevel=0.004)
