"""Kitchen: counter, wall cabinets, fridge, oven, hood, table, chair, stool, open shelf, waste bin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avs3d_bench.errors import UsageError
from generators.assets.furniture.common import LIE_DOWN, Kit, rounded_rectangle
from generators.assets.furniture.parts import (
    book_row,
    bowl,
    carcass,
    front,
    fruit_bowl,
    handle,
    is_shaker,
    pull_style,
    ring_stack,
    tap,
    vase,
)

#: Height of the worktop, depth of base cabinets, plinth.
TOP, DEPTH, PLINTH = 0.90, 0.60, 0.10
FEATURES = ("sink", "hob", "oven", "dishwasher", "drawers")


def kitchen_counter(
    kit: Kit, *, length: float | None = None, features: Sequence[str] | None = None, splash: bool = True, decor: bool = True
) -> None:
    """A run of base cabinets under one worktop.

    Args:
        kit: what to build with.
        length: metres (0.4 … 6); modules of about 60 cm divide it evenly.
        features: of `FEATURES`; ``oven`` goes under the hob. Default: sink, hob, oven, drawers as far as they fit.
        splash: whether a tiled splash-back stands behind it.
        decor: whether small things stand on it (never on its supports).
    """
    width = float(length or 2.4)
    if not 0.4 <= width <= 6.0:
        raise UsageError(f"kitchen_counter: length is {width} m, expected 0.4 to 6")
    count = max(1, round(width / 0.6))
    wanted = tuple(features) if features is not None else (("sink", "hob", "oven", "drawers") if count > 2 else ("drawers",))
    unknown = [f for f in wanted if f not in FEATURES]
    if unknown:
        raise UsageError(f"kitchen_counter: unknown feature {unknown[0]!r}, expected some of {', '.join(FEATURES)}")
    if sum(f in wanted for f in ("sink", "hob")) > count:
        raise UsageError(f"kitchen_counter: {width} m is too short for a sink and a hob")
    step = width / count
    order = list(range(count))
    hob_at = (count - 2 if count >= 4 else count - 1) if "hob" in wanted else -1
    sink_at = 0 if "sink" in wanted else -1
    if kit.rng.random() < 0.5:
        hob_at, sink_at = (count - 1 - hob_at if hob_at >= 0 else -1), (count - 1 - sink_at if sink_at >= 0 else -1)
    free = [k for k in order if k not in (hob_at, sink_at)]
    wash_at = (sink_at + 1 if sink_at + 1 in free else sink_at - 1) if "dishwasher" in wanted and sink_at >= 0 else -1
    drawer_at = next((k for k in free if k != wash_at), -1) if "drawers" in wanted else -1
    box, top, shaker = kit.m("front"), kit.m("worktop"), is_shaker(kit)
    left = -width / 2
    kit.panel((left, PLINTH, 0.0), (-left, TOP - 0.04, DEPTH - 0.022), box, bevel=0.0)
    kit.panel((left, 0.0, 0.02), (-left, PLINTH, DEPTH - 0.07), kit.m("plastic_black"), bevel=0.0)
    back = DEPTH - 0.022
    for k in order:
        x = (left + k * step, left + (k + 1) * step)
        if k == hob_at and "oven" in wanted:
            _oven_front(kit, x, (PLINTH + 0.14, TOP - 0.045), back)
            front(kit, x, (PLINTH, PLINTH + 0.14), back, box)
        elif k == drawer_at or (k == hob_at):
            cuts = (PLINTH, PLINTH + 0.31, PLINTH + 0.62, TOP - 0.042)
            for y0, y1 in zip(cuts[:-1], cuts[1:], strict=True):
                front(kit, x, (y0, y1), back, box, shaker=shaker, pull=pull_style(kit, "top"), grain="x")
        elif k == wash_at:
            front(kit, x, (PLINTH, TOP - 0.042), back, box, shaker=shaker, pull=pull_style(kit, "top"))
        elif k == sink_at or step > 0.62 or k % 2:
            place = "right" if k % 2 else "left"
            front(kit, x, (PLINTH, TOP - 0.042), back, box, shaker=shaker, pull=pull_style(kit, place))
        else:
            front(kit, x, (TOP - 0.2, TOP - 0.042), back, box, shaker=shaker, pull=pull_style(kit, "top"), grain="x")
            front(kit, x, (PLINTH, TOP - 0.2), back, box, shaker=shaker, pull=pull_style(kit, "left"))
    edge = DEPTH + 0.02
    sink = _sink(kit, left + (sink_at + 0.5) * step, step) if sink_at >= 0 else None
    with kit.one_slab(), kit.grained("x"):
        if sink is None:
            kit.panel((left, TOP - 0.04, 0.0), (-left, TOP, edge), top, bevel=0.003)
        else:
            (x0, x1), (z0, z1) = sink
            outline = [(left, 0.0), (-left, 0.0), (-left, -edge), (left, -edge)]
            hole = rounded_rectangle(x1 - x0, z1 - z0, 0.02, per_corner=4) + [(x0 + x1) / 2, -(z0 + z1) / 2]
            kit.extrude(outline, 0.04, top, holes=[hole], centre=(0.0, TOP - 0.04, 0.0), rotate=LIE_DOWN)
    if hob_at >= 0:
        x = left + (hob_at + 0.5) * step
        half = min(0.29, step / 2 - 0.01)
        kit.panel((x - half, TOP, 0.06), (x + half, TOP + 0.006, 0.57), kit.m("black_glass"), bevel=0.002)
        inner = half - 0.004
        corners = [(x - inner, TOP + 0.0063, 0.566), (x + inner, TOP + 0.0063, 0.566), (x + inner, TOP + 0.0063, 0.064), (x - inner, TOP + 0.0063, 0.064)]
        kit.cloth_quad(corners, kit.m("hob"))
        if decor and kit.rng.random() < 0.6:
            _pot(kit, (x - 0.45 * half, TOP + 0.0065, 0.22))
    height = 0.52
    if splash:
        with kit.one_slab():
            kit.panel((left, TOP, 0.0), (-left, TOP + height, 0.008), kit.m("tiles_kitchen"), bevel=0.0)
    _free_tops(kit, left, step, [k for k in (hob_at, sink_at) if k >= 0], count, decor)
    kit.sound((left, 0.0, 0.0), (-left, TOP - 0.04, DEPTH), box)
    kit.sound((left, TOP - 0.04, 0.0), (-left, TOP, edge), top)
    if splash:
        kit.sound((left, TOP, 0.0), (-left, TOP + height, 0.008), kit.m("tiles_kitchen"))


def _sink(kit: Kit, x: float, step: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """A steel or ceramic basin below the worktop with a tap behind it; returns its cut-out (x, z)."""
    material = kit.m(kit.pick("steel", "steel", "ceramic"))
    w, d, z = min(0.5, step - 0.08), 0.38, 0.33
    kit.loft(
        ring_stack(
            [
                (w + 0.03, d + 0.03, 0.03, TOP - 0.045), (w + 0.03, d + 0.03, 0.03, TOP + 0.0015),
                (w - 0.004, d - 0.004, 0.03, TOP + 0.0015), (w - 0.012, d - 0.012, 0.03, TOP - 0.008),
                (w - 0.03, d - 0.03, 0.045, TOP - 0.15), (w - 0.09, d - 0.09, 0.04, TOP - 0.175),
            ],
            centre=(x, z),
        ),
        material,
    )
    kit.cylinder(0.04, 0.004, (x, TOP - 0.173, z), kit.m("chrome"), segments=16)
    tap(kit, (x, TOP, 0.075), kit.m("tap"), style="arc", height=0.34, reach=0.2)
    return (x - w / 2, x + w / 2), (z - d / 2, z + d / 2)


def _free_tops(kit: Kit, left: float, step: float, taken: list[int], count: int, decor: bool) -> None:
    """Declare the free stretches of the worktop as supports, after giving up to two ends to small things."""
    runs: list[list[float]] = []
    for k in range(count):
        if k in taken:
            continue
        x0, x1 = left + k * step, left + (k + 1) * step
        if runs and abs(runs[-1][1] - x0) < 1e-6:
            runs[-1][1] = x1
        else:
            runs.append([x0, x1])
    things = [_jar, fruit_bowl_small, _board_and_bottle]
    for run in runs:
        lo, hi = run[0] + 0.04, run[1] - 0.04
        if decor and hi - lo > 0.85 and kit.rng.random() < 0.85:
            thing = things.pop(int(kit.rng.integers(len(things)))) if things else _jar
            if kit.rng.random() < 0.5:
                thing(kit, lo + 0.13)
                lo += 0.29
            else:
                thing(kit, hi - 0.13)
                hi -= 0.29
        if hi - lo >= 0.25:
            kit.support("worktop", (lo, hi), (0.04, DEPTH - 0.02), TOP, clearance=0.5)


def _jar(kit: Kit, x: float) -> None:
    """A jar of wooden spoons."""
    kit.lathe([(0.0, 0.0), (0.055, 0.0), (0.06, 0.14), (0.054, 0.14), (0.05, 0.02), (0.0, 0.02)], kit.m("pot_white"), centre=(x, TOP, 0.14), segments=16)
    for k in range(4):
        a = 2 * np.pi * k / 4 + 0.4
        foot = np.array([x + 0.02 * np.cos(a), TOP + 0.03, 0.14 + 0.02 * np.sin(a)])
        head = np.array([x + 0.06 * np.cos(a), TOP + 0.27 + 0.02 * (k % 2), 0.14 + 0.05 * np.sin(a)])
        kit.rod(foot, head, 0.005, kit.m("wood"), sides=6)
        kit.sphere((0.022, 0.032, 0.008), tuple(head), kit.m("wood" if k % 2 else "wood_alt"), rings=6, segments=8)


def fruit_bowl_small(kit: Kit, x: float) -> None:
    """A bowl of fruit on the worktop."""
    fruit_bowl(kit, (x, TOP, 0.3))


def _board_and_bottle(kit: Kit, x: float) -> None:
    """A chopping board leaning on the splash-back and a bottle of oil."""
    from generators.assets.shapes import rotation

    turn = rotation("x", -9)
    kit.panel((x - 0.11, TOP, 0.035), (x + 0.11, TOP + 0.33, 0.055), kit.m("butcher"), bevel=0.006, rotate=turn)
    profile = [(0.0, 0.0), (0.032, 0.0), (0.033, 0.15), (0.012, 0.2), (0.012, 0.25), (0.0, 0.25)]
    kit.lathe(profile, kit.m("fruit_green"), centre=(x + 0.05, TOP, 0.15), segments=14)
    kit.lathe([(0.0, 0.0), (0.026, 0.0), (0.028, 0.07), (0.018, 0.1), (0.018, 0.115), (0.0, 0.115)], kit.m("wood_alt"), centre=(x - 0.04, TOP, 0.14), segments=14)


def _pot(kit: Kit, at: tuple[float, float, float]) -> None:
    """A saucepan with a lid."""
    x, y, z = at
    metal = kit.m(kit.pick("steel", "ceramic_accent", "black_metal"))
    kit.lathe([(0.0, 0.0), (0.088, 0.0), (0.092, 0.01), (0.092, 0.11), (0.095, 0.113), (0.06, 0.128), (0.0, 0.133)], metal, centre=at, segments=24)
    kit.sphere((0.014, 0.011, 0.014), (x, y + 0.142, z), kit.m("plastic_black"), rings=6, segments=8)
    for side in (-1, 1):
        kit.tube([(x + side * 0.09, y + 0.085, z - 0.03), (x + side * 0.122, y + 0.09, z - 0.02), (x + side * 0.122, y + 0.09, z + 0.02), (x + side * 0.09, y + 0.085, z + 0.03)], 0.006, kit.m("plastic_black"), segments=6)


def _oven_front(kit: Kit, x: tuple[float, float], y: tuple[float, float], z: float) -> None:
    """A built-in oven's face: control strip with knobs and display, door with a window, bar handle."""
    x0, x1 = x[0] + 0.003, x[1] - 0.003
    split = y[1] - 0.11
    steel, dark = kit.m("steel"), kit.m("black_glass")
    with kit.grained("x"):
        kit.panel((x0, split + 0.003, z), (x1, y[1], z + 0.022), steel, bevel=0.002)
        kit.panel((x0, y[0], z), (x1, split, z + 0.02), steel, bevel=0.002)
    strip_w = min(0.36, 0.6 * (x1 - x0))
    mid = (x0 + x1) / 2
    h = 0.045
    kit.cloth_quad([(mid - strip_w / 2, split + 0.057 - h, z + 0.0223), (mid + strip_w / 2, split + 0.057 - h, z + 0.0223), (mid + strip_w / 2, split + 0.057 + h, z + 0.0223), (mid - strip_w / 2, split + 0.057 + h, z + 0.0223)], kit.m("oven_panel"))
    for side in (-1, 1):
        kit.cylinder(0.021, 0.02, (mid + side * (x1 - x0) * 0.39, split + 0.057, z + 0.032), kit.m("black_metal"), axis="z", segments=16, bevel=0.004)
    kit.panel((x0 + 0.05, y[0] + 0.06, z + 0.02), (x1 - 0.05, split - 0.085, z + 0.024), dark, bevel=0.001)
    handle(kit, (mid, split - 0.04, z + 0.02), steel, style="bar", length=(x1 - x0) * 0.8, axis="x")


def wall_cabinet(kit: Kit, *, length: float | None = None, height: float | None = None) -> None:
    """Wall cabinets of equal doors, now and then with one open compartment."""
    kit.mount = "wall"
    width, h, d = float(length or 1.8), height or 0.7, 0.33
    if not 0.3 <= width <= 6.0:
        raise UsageError(f"wall_cabinet: length is {width} m, expected 0.3 to 6")
    count = max(1, round(width / 0.6))
    step, box, shaker = width / count, kit.m("front_upper"), is_shaker(kit)
    opened = int(kit.rng.integers(count)) if count > 1 and kit.rng.random() < 0.5 else -1
    for k in range(count):
        x0, x1 = -width / 2 + k * step, -width / 2 + (k + 1) * step
        if k == opened:
            carcass(kit, (x0, 0.0, 0.0), (x1, h, d), box)
            kit.panel((x0 + 0.018, h * 0.5, 0.008), (x1 - 0.018, h * 0.5 + 0.018, d - 0.02), box, bevel=0.001)
            _crockery(kit, (x0 + 0.02, x1 - 0.02), 0.018, d)
            _crockery(kit, (x0 + 0.02, x1 - 0.02), h * 0.5 + 0.018, d)
        else:
            kit.panel((x0, 0.0, 0.0), (x1, h, d), box, bevel=0.0)
            front(kit, (x0, x1), (0.0, h), d, box, shaker=shaker, pull=pull_style(kit, "right_low" if k % 2 == 0 else "left_low"))
    kit.sound((-width / 2, 0.0, 0.0), (width / 2, h, d + 0.019), box)


def _crockery(kit: Kit, x: tuple[float, float], y: float, depth: float) -> None:
    """Plates, mugs or bowls on a shelf between ``x``."""
    kind = kit.pick("plates", "mugs", "bowls")
    white = kit.m(kit.pick("pot_white", "ceramic_accent"))
    z = depth * 0.5
    if kind == "plates":
        at = x[0] + 0.13
        for k in range(6):
            kit.cylinder(0.105, 0.009, (at, y + 0.005 + 0.012 * k, z), white, segments=20)
        bowl(kit, (x[1] - 0.12, y, z), kit.m("pot_white"), 0.085, 0.08)
    elif kind == "mugs":
        for at in np.arange(x[0] + 0.07, x[1] - 0.06, 0.105):
            kit.lathe([(0.0, 0.0), (0.037, 0.0), (0.04, 0.09), (0.036, 0.09), (0.033, 0.01), (0.0, 0.01)], white, centre=(at, y, z), segments=12)
    else:
        for at in np.arange(x[0] + 0.1, x[1] - 0.09, 0.19):
            for k in range(3):
                bowl(kit, (at, y + 0.022 * k, z), white, 0.075, 0.06)


def fridge(kit: Kit) -> None:
    """A fridge-freezer: steel or white with two doors, or a rounded retro one in the flat's accent colour."""
    form = kit.pick("steel", "white", "retro")
    w, d, tall = 0.6, 0.62, kit.near(1.85, 0.03)
    skin = kit.m({"steel": "steel", "white": "enamel", "retro": "ceramic_accent"}[form])
    chrome = kit.m("chrome" if form != "white" else "steel")
    kit.panel((-w / 2 + 0.02, 0.0, 0.03), (w / 2 - 0.02, 0.05, d - 0.06), kit.m("plastic_black"), bevel=0.0)
    round_ = 0.05 if form == "retro" else 0.006
    split = tall * (0.72 if form == "retro" else 0.36)
    with kit.grained("y"):
        if form == "retro":
            kit.soft((w, tall - 0.03, d - 0.06), (0.0, 0.03 + (tall - 0.03) / 2, (d - 0.06) / 2), skin, radius=0.05, cells=6)
        else:
            kit.panel((-w / 2, 0.04, 0.0), (w / 2, tall, d - 0.055), skin, bevel=0.004)
        for y0, y1 in ((0.045, split - 0.004), (split + 0.004, tall)):
            centre = (0.0, (y0 + y1) / 2, d - 0.02)
            if form == "retro":
                kit.soft((w, y1 - y0, 0.075), centre, skin, radius=round_ * 0.7, puff=(0.0, 0.0, 0.008), cells=6)
            else:
                kit.panel((-w / 2, y0, d - 0.05), (w / 2, y1, d + 0.005), skin, bevel=0.006)
    face = d + (0.018 if form == "retro" else 0.005)
    for y0, y1 in ((split - 0.35, split - 0.06), (split + 0.06, split + 0.42)):
        low, high = max(y0, 0.15), min(y1, tall - 0.1)
        handle(kit, (-w / 2 + 0.055, (low + high) / 2, face), chrome, style="bar", length=high - low, axis="y")
    if form != "retro":
        kit.panel((-0.045, tall - 0.14, d + 0.005), (0.045, tall - 0.12, d + 0.007), kit.m("chrome"), bevel=0.0)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), kit.m("enamel"))


def oven_unit(kit: Kit, *, height: float | None = None) -> None:
    """A built-in oven: in a tall cabinet at working height, or (``height`` below 1 m) in a base cabinet."""
    tall = float(height or 2.1)
    w, d = 0.6, DEPTH
    box, shaker = kit.m("front"), is_shaker(kit)
    back = d - 0.022
    kit.panel((-w / 2, PLINTH, 0.0), (w / 2, tall - (0.04 if tall < 1 else 0.0), back), box, bevel=0.001)
    kit.panel((-w / 2, 0.0, 0.02), (w / 2, PLINTH, d - 0.07), kit.m("plastic_black"), bevel=0.0)
    if tall < 1.0:
        with kit.grained("x"):
            kit.panel((-w / 2, tall - 0.04, 0.0), (w / 2, tall, d + 0.02), kit.m("worktop"), bevel=0.003)
        front(kit, (-w / 2, w / 2), (PLINTH, PLINTH + 0.14), back, box)
        _oven_front(kit, (-w / 2, w / 2), (PLINTH + 0.14, tall - 0.045), back)
        kit.support("worktop", (-w / 2 + 0.03, w / 2 - 0.03), (0.03, d - 0.02), tall, clearance=0.5)
        kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), box)
        return
    low = 0.68
    half = (low - PLINTH) / 2
    for k in range(2):
        front(kit, (-w / 2, w / 2), (PLINTH + k * half, PLINTH + (k + 1) * half), back, box, shaker=shaker, pull=pull_style(kit, "top"), grain="x")
    _oven_front(kit, (-w / 2, w / 2), (low, low + 0.6), back)
    front(kit, (-w / 2, w / 2), (low + 0.6, tall), back, box, shaker=shaker, pull=pull_style(kit, "left_low"))
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), box)
    kit.sound((-w / 2 + 0.05, low + 0.05, d - 0.02), (w / 2 - 0.05, low + 0.45, d + 0.003), kit.m("black_glass"))


def extractor_hood(kit: Kit) -> None:
    """A chimney hood: pyramid or box canopy with a duct, lit below."""
    kit.mount = "wall"
    form = kit.pick("pyramid", "box")
    w, d, duct = 0.6, 0.48, kit.near(0.5, 0.1)
    steel = kit.m(kit.pick("steel", "steel", "black_metal"))
    with kit.grained("x"):
        kit.panel((-w / 2, 0.0, 0.0), (w / 2, 0.05, d), steel, bevel=0.003)
    if form == "pyramid":
        rings = []
        for s, y in ((1.0, 0.05), (0.97, 0.055), (0.5, 0.2), (0.46, 0.22)):
            ww, dd = w * s if s > 0.6 else 0.29 * s / 0.46, d * s if s > 0.6 else 0.26 * s / 0.46
            rings.append([(-ww / 2, y, 0.0), (-ww / 2, y, dd), (ww / 2, y, dd), (ww / 2, y, 0.0)])
        kit.loft(rings, steel, crease=30.0)
        base = 0.21
    else:
        base = 0.05
    with kit.grained("y"):
        kit.panel((-0.14, base, 0.0), (0.14, base + duct, 0.25), steel, bevel=0.003)
    for x in (-0.17, 0.17):
        kit.cylinder(0.03, 0.004, (x, -0.001, d * 0.62), kit.m("hood_light"), segments=14)
    kit.panel((-0.22, -0.004, 0.08), (0.22, 0.0, d * 0.48), kit.m("black_metal"), bevel=0.0)
    for k in range(4):
        kit.cylinder(0.007, 0.006, (-0.05 + 0.033 * k, 0.025, d + 0.002), kit.m("chrome"), axis="z", segments=10)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, 0.12, d), steel)
    kit.sound((-0.14, 0.12, 0.0), (0.14, base + duct, 0.25), steel)


def kitchen_shelf(kit: Kit, *, length: float | None = None) -> None:
    """Two boards on brackets with jars, mugs and a cookery book or two; one end of the lower board is free."""
    kit.mount = "wall"
    w, d = float(length or 0.9), 0.24
    board, metal = kit.m("wood"), kit.m("metal")
    levels = (0.0, 0.36)
    for y in levels:
        kit.panel((-w / 2, y, 0.0), (w / 2, y + 0.028, d), board, bevel=0.003)
        for x in (-w / 2 + 0.12, w / 2 - 0.12):
            kit.panel((x - 0.012, y - 0.14, 0.0), (x + 0.012, y, 0.006), metal, bevel=0.0)
            kit.rod((x, y - 0.125, 0.004), (x, y - 0.006, d - 0.05), 0.006, metal, sides=6)
    top = levels[1] + 0.028
    _crockery(kit, (-w / 2 + 0.02, -w / 2 + 0.34), top, d)
    end = book_row(kit, (w / 2 - 0.3, w / 2 - 0.06), top, d - 0.02, 0.26, most=5)
    vase(kit, (0.02, top, d / 2), kit.m("ceramic_accent"), 0.17)
    low = levels[0] + 0.028
    for k in range(3):
        x = -w / 2 + 0.08 + 0.11 * k
        kit.cylinder(0.043, 0.13, (x, low + 0.065, d / 2), kit.m(("glass", "fruit_orange", "paper")[k]), segments=16, bevel=0.006)
        kit.cylinder(0.044, 0.022, (x, low + 0.141, d / 2), kit.m("wood_alt"), segments=16, bevel=0.003)
    free = -w / 2 + 0.38
    if w / 2 - free > 0.2:
        kit.support("shelf", (free, w / 2 - 0.03), (0.01, d - 0.01), low, clearance=levels[1] - low - 0.15)
    del end
    for y in levels:
        kit.sound((-w / 2, y, 0.0), (w / 2, y + 0.028, d), board)


def dining_table(kit: Kit, *, length: float | None = None) -> None:
    """A table: straight or tapered legs under a rectangle, a trestle, or a round top on a column."""
    form = kit.pick("tapered", "square", "round") if length is None else kit.pick("tapered", "square")
    h = 0.75
    top = kit.m("wood")
    if form == "round":
        r = kit.near(0.55, 0.08)
        kit.cylinder(r, 0.032, (0.0, h - 0.016, 0.0), top, segments=48, bevel=0.008)
        leg = kit.m(kit.pick("wood", "metal", "white"))
        profile = [(0.0, 0.0), (0.29, 0.0), (0.3, 0.012), (0.2, 0.03), (0.06, 0.1), (0.045, 0.3), (0.05, h - 0.1), (0.16, h - 0.035), (0.0, h - 0.034)]
        kit.lathe(profile, leg, segments=24)
        half = 0.68 * r
        kit.support("side_table", (-half, half), (-half, half), h, clearance=0.9)
        kit.sound((-0.85 * r, h - 0.032, -0.85 * r), (0.85 * r, h, 0.85 * r), top)
        return
    w, d = float(length or kit.rng.choice([1.4, 1.6, 1.8])), kit.near(0.85, 0.05)
    with kit.one_slab(), kit.grained("x"):
        kit.panel((-w / 2, h - 0.032, -d / 2), (w / 2, h, d / 2), top, bevel=0.006)
    apron = kit.m(kit.pick("wood", "white")) if form == "square" else top
    inset = 0.06 if form == "square" else 0.1
    x, z = w / 2 - inset, d / 2 - inset
    for side in (-1, 1):
        kit.panel((-x, h - 0.115, side * z - 0.011), (x, h - 0.032, side * z + 0.011), apron, bevel=0.0)
        kit.panel((side * x - 0.011, h - 0.115, -z), (side * x + 0.011, h - 0.032, z), apron, bevel=0.0)
        for front_ in (-1, 1):
            if form == "square":
                kit.panel((side * x - 0.033, 0.0, front_ * z - 0.033), (side * x + 0.033, h - 0.033, front_ * z + 0.033), apron, bevel=0.004)
            else:
                kit.rod((side * (x + 0.05), 0.0, front_ * (z + 0.04)), (side * x, h - 0.033, front_ * z), 0.017, apron, end_radius=0.032, sides=12)
    kit.support("side_table", (-w / 2 + 0.05, w / 2 - 0.05), (-d / 2 + 0.05, d / 2 - 0.05), h, clearance=0.9)
    kit.sound((-w / 2, h - 0.06, -d / 2), (w / 2, h, d / 2), top)


def chair(kit: Kit) -> None:
    """A chair: spindle-backed, upholstered shell, or bentwood with a curved back rest."""
    form = str(kit.palette.choose("chair", ("spindle", "shell", "bent")))
    wood = kit.m(str(kit.palette.choose("chair wood", ("wood", "wood_alt", "black_metal", "accent_paint"))))
    seat, w, d = 0.455, 0.43, 0.42
    x, z = w / 2 - 0.045, d / 2 - 0.045
    if form == "shell":
        fabric = kit.m("chair_fabric")
        rows = []
        line = [(0.47, 0.23), (0.478, 0.16), (0.465, 0.02), (0.462, -0.1), (0.49, -0.175), (0.58, -0.21), (0.7, -0.23), (0.8, -0.245), (0.835, -0.25)]
        u = np.linspace(-1, 1, 11)
        for k, (y, depth) in enumerate(line):
            s = k / (len(line) - 1)
            half = 0.235 * (1 - 0.35 * max(0.0, s - 0.8) / 0.2 * 0.6) * (1 - 0.1 * max(0.0, 0.15 - s) / 0.15)
            curl = 0.035 * np.abs(u) ** 3
            rows.append(np.stack([u * half, y + curl * (1 if s < 0.5 else 0.2), depth + curl * (1.6 if s >= 0.5 else 0.0)], axis=1))
        kit.shell(np.array(rows), 0.035, fabric)
        for sx in (-1, 1):
            for sz in (-1, 1):
                kit.rod((sx * 0.22, 0.0, sz * 0.2), (sx * 0.13, 0.455, sz * 0.11), 0.009, wood, end_radius=0.015, sides=9)
        kit.sound((-0.22, 0.43, -0.2), (0.22, 0.48, 0.22), fabric)
        kit.sound((-0.22, 0.5, -0.27), (0.22, 0.83, -0.21), fabric)
        return
    if form == "spindle":
        kit.soft((w, 0.035, d), (0.0, seat - 0.0175, 0.0), wood, radius=0.017, puff=(0.004, 0.0, 0.006), cells=6)
        for sx in (-1, 1):
            kit.rod((sx * (x + 0.04), 0.0, z + 0.035), (sx * x, seat - 0.02, z), 0.012, wood, end_radius=0.018, sides=9)
            kit.rod((sx * (x + 0.03), 0.0, -z - 0.06), (sx * x, seat - 0.02, -z), 0.012, wood, end_radius=0.018, sides=9)
            kit.rod((sx * (x - 0.0), seat - 0.01, -z), (sx * (x + 0.01), 0.87, -z - 0.09), 0.014, wood, end_radius=0.011, sides=9)
            kit.rod((sx * (x + 0.02), 0.2, z + 0.02), (sx * (x + 0.016), 0.2, -z - 0.03), 0.009, wood, sides=7)
        kit.rod((-x - 0.02, 0.2, 0.0), (x + 0.02, 0.2, 0.0), 0.009, wood, sides=7)
        for px in np.linspace(-0.11, 0.11, 5):
            kit.rod((px, seat - 0.01, -z), (px * 1.1, 0.84, -z - 0.085), 0.0075, wood, sides=6)
        t = np.linspace(-1, 1, 7)
        rail = np.stack([t * (x + 0.035), np.full(7, 0.865), -z - 0.088 - 0.03 * (1 - t**2)], axis=1)
        kit.tube(rail, np.where(np.abs(t) > 0.9, 0.02, 0.026), wood, segments=9)
        back = 0.09
    else:
        kit.soft((w, 0.05, d), (0.0, seat - 0.02, 0.0), kit.m("chair_fabric"), radius=0.024, puff=(0.004, 0.008, 0.004), cells=6)
        kit.panel((-w / 2 + 0.015, seat - 0.075, -d / 2 + 0.015), (w / 2 - 0.015, seat - 0.035, d / 2 - 0.015), wood, bevel=0.004)
        for sx in (-1, 1):
            kit.rod((sx * (x + 0.015), 0.0, z + 0.01), (sx * x, seat - 0.04, z), 0.013, wood, end_radius=0.019, sides=9)
            kit.tube([(sx * (x + 0.015), 0.0, -z - 0.05), (sx * x, seat - 0.04, -z), (sx * x, 0.62, -z - 0.03), (sx * x, 0.82, -z - 0.085)], [0.012, 0.019, 0.017, 0.012], wood, segments=9)
        t = np.linspace(-1, 1, 9)
        rows = [np.stack([t * (x + 0.03), np.full(9, y), -z - 0.03 - lean - 0.045 * (1 - t**2)], axis=1) for y, lean in ((0.83, 0.055), (0.79, 0.05), (0.73, 0.036), (0.69, 0.028))]
        kit.shell(np.array(rows), 0.02, wood)
        back = 0.07
    kit.sound((-w / 2, seat - 0.05, -d / 2), (w / 2, seat, d / 2), wood)
    kit.sound((-w / 2, 0.68, -z - back), (w / 2, 0.86, -z - 0.05), wood)


def stool(kit: Kit) -> None:
    """A low stool or a bar stool with a foot ring."""
    tall = kit.pick("low", "bar") == "bar"
    h = 0.68 if tall else 0.45
    wood = kit.m("wood")
    leg = kit.m(kit.pick("wood", "metal"))
    kit.cylinder(0.165, 0.035, (0.0, h - 0.0175, 0.0), wood, segments=28, bevel=0.01)
    for k in range(4):
        a = np.pi / 4 + k * np.pi / 2
        c, s = float(np.cos(a)), float(np.sin(a))
        kit.rod((0.19 * c, 0.0, 0.19 * s), (0.11 * c, h - 0.034, 0.11 * s), 0.011, leg, end_radius=0.016, sides=9)
    ring = 0.28 if tall else 0.16
    kit.torus(0.19 - 0.08 * ring / h, 0.008, (0.0, ring, 0.0), leg, segments=24, minor_segments=6)
    kit.sound((-0.15, h - 0.035, -0.15), (0.15, h, 0.15), wood)


def waste_bin(kit: Kit) -> None:
    """A pedal bin or an open paper basket."""
    if kit.rng.random() < 0.6:
        skin = kit.m(kit.pick("steel", "enamel", "black_metal"))
        h = kit.near(0.42, 0.1)
        kit.lathe([(0.0, 0.0), (0.128, 0.0), (0.13, 0.02), (0.13, h - 0.06), (0.0, h - 0.06)], skin, segments=28)
        kit.lathe([(0.0, h - 0.058), (0.133, h - 0.058), (0.133, h - 0.035), (0.1, h - 0.01), (0.0, h)], kit.m("plastic_black"), segments=28)
        kit.panel((-0.04, 0.006, 0.11), (0.04, 0.022, 0.175), kit.m("chrome"), bevel=0.004)
    else:
        h = 0.32
        kit.lathe([(0.0, 0.0), (0.11, 0.0), (0.145, h), (0.138, h), (0.105, 0.012), (0.0, 0.012)], kit.m(kit.pick("wicker", "accent_paint", "black_metal")), segments=28)
    kit.sound((-0.12, 0.0, -0.12), (0.12, h, 0.12), kit.m("plastic_black"))
