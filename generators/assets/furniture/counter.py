"""The kitchen counter: base cabinets under one worktop, with sink, hob, built-in oven and small things on top."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avs3d_bench.errors import UsageError
from generators.assets.forms import rounded_rectangle
from generators.assets.furniture.common import LIE_DOWN, Kit
from generators.assets.furniture.parts import (
    front,
    fruit_bowl,
    handle,
    is_shaker,
    pull_style,
    ring_stack,
    tap,
)
from generators.assets.shapes import rotation

#: Height of the worktop, depth of base cabinets, plinth.
TOP, DEPTH, PLINTH = 0.90, 0.60, 0.10
FEATURES = ("sink", "hob", "oven", "dishwasher", "drawers")


def kitchen_counter(
    kit: Kit,
    *,
    length: float | None = None,
    features: Sequence[str] | None = None,
    splash: bool = True,
    decor: bool = True,
) -> None:
    """A run of base cabinets under one worktop.

    Args:
        kit: what to build with.
        length: metres (0.4 … 6); modules of about 60 cm divide it evenly.
        features: a subset of `FEATURES`; ``oven`` is under the hob. Default: sink, hob, oven, drawers if they fit.
        splash: whether it has a tiled splash-back.
        decor: whether small things are on it (never on its supports).
    """
    width = float(length or 2.4)
    if not 0.4 <= width <= 6.0:
        raise UsageError(f"kitchen_counter: length is {width} m, expected 0.4 to 6")
    run = _arrange(kit, width, features)
    left, edge = run.left, DEPTH + 0.02
    box, top = kit.m("front"), kit.m("worktop")
    _carcasses(kit, run)
    _fronts(kit, run)
    sink = _sink(kit, run.middle(run.sink), run.step) if run.sink >= 0 else None
    with kit.one_slab(), kit.grained("x"):
        if sink is None:
            kit.panel((left, TOP - 0.04, 0.0), (-left, TOP, edge), top, bevel=0.003)
        else:
            (x0, x1), (z0, z1) = sink
            outline = [(left, 0.0), (-left, 0.0), (-left, -edge), (left, -edge)]
            hole = rounded_rectangle(x1 - x0, z1 - z0, 0.02, steps=3) + np.array([(x0 + x1) / 2, -(z0 + z1) / 2])
            kit.extrude(outline, 0.04, top, holes=[hole], centre=(0.0, TOP - 0.04, 0.0), rotate=LIE_DOWN)
    if run.hob >= 0:
        _hob(kit, run.middle(run.hob), min(0.29, run.step / 2 - 0.01), decor)
    height = 0.52
    if splash:
        with kit.one_slab():
            kit.panel((left, TOP, 0.0), (-left, TOP + height, 0.008), kit.m("tiles_kitchen"), bevel=0.0)
    _free_tops(kit, left, run.step, [k for k in (run.hob, run.sink) if k >= 0], run.count, decor)
    kit.sound((left, 0.0, 0.0), (-left, TOP - 0.04, DEPTH), box)
    kit.sound((left, TOP - 0.04, 0.0), (-left, TOP, edge), top)
    if splash:
        kit.sound((left, TOP, 0.0), (-left, TOP + height, 0.008), kit.m("tiles_kitchen"))


@dataclass(frozen=True)
class _ModuleRun:
    """Modules of equal width side by side, and the module of each feature (from the left; -1: none).

    Attributes:
        left: x of the left end; the right end is at -left (m).
        step: width of a module (m).
        count: number of modules.
        hob, sink, dishwasher, drawers: their modules.
        oven: whether an oven is built in below the hob.
    """

    left: float
    step: float
    count: int
    hob: int
    sink: int
    dishwasher: int
    drawers: int
    oven: bool

    def span(self, module: int) -> tuple[float, float]:
        """Left and right side of a module (m)."""
        return self.left + module * self.step, self.left + (module + 1) * self.step

    def middle(self, module: int) -> float:
        """The middle of a module (m)."""
        return self.left + (module + 0.5) * self.step


def _arrange(kit: Kit, width: float, features: Sequence[str] | None) -> _ModuleRun:
    """Distribute the features over modules of about 60 cm: the sink at one end, the hob towards the other.

    Raises:
        UsageError: if a feature is unknown, or there is no room for all.
    """
    count = max(1, round(width / 0.6))
    wanted = (
        tuple(features) if features is not None else (("sink", "hob", "oven", "drawers") if count > 2 else ("drawers",))
    )
    unknown = [f for f in wanted if f not in FEATURES]
    if unknown:
        raise UsageError(f"kitchen_counter: unknown feature {unknown[0]!r}, expected some of {', '.join(FEATURES)}")
    if sum(f in wanted for f in ("sink", "hob")) > count:
        raise UsageError(f"kitchen_counter: {width} m is too short for a sink and a hob")
    hob = (count - 2 if count >= 4 else count - 1) if "hob" in wanted else -1
    sink = 0 if "sink" in wanted else -1
    if kit.rng.random() < 0.5:
        hob, sink = (count - 1 - hob if hob >= 0 else -1), (count - 1 - sink if sink >= 0 else -1)
    free = [k for k in range(count) if k not in (hob, sink)]
    washer = (sink + 1 if sink + 1 in free else sink - 1) if "dishwasher" in wanted and sink >= 0 else -1
    drawers = next((k for k in free if k != washer), -1) if "drawers" in wanted else -1
    return _ModuleRun(-width / 2, width / count, count, hob, sink, washer, drawers, "oven" in wanted)


def _carcasses(kit: Kit, run: _ModuleRun) -> None:
    """The bodies of the cabinets and the plinth."""
    box = kit.m("front")
    for k in range(run.count):
        # The basin hangs into its cabinet, which is therefore lower.
        top_y = TOP - 0.2 if k == run.sink else TOP - 0.04
        x0, x1 = run.span(k)
        kit.panel((x0, PLINTH, 0.0), (x1, top_y, DEPTH - 0.022), box, bevel=0.0)
    if run.sink >= 0:
        x0 = run.left + run.sink * run.step
        for a, b in ((x0, x0 + 0.018), (x0 + run.step - 0.018, x0 + run.step)):
            kit.panel((a, TOP - 0.2, 0.0), (b, TOP - 0.04, DEPTH - 0.022), box, bevel=0.0)
    kit.panel((run.left, 0.0, 0.02), (-run.left, PLINTH, DEPTH - 0.07), kit.m("plastic_black"), bevel=0.0)


def _fronts(kit: Kit, run: _ModuleRun) -> None:
    """Doors, drawers and the face of the oven."""
    box, shaker, back = kit.m("front"), is_shaker(kit), DEPTH - 0.022
    for k in range(run.count):
        span = run.span(k)
        if k == run.hob and run.oven:
            oven_front(kit, span, (PLINTH + 0.14, TOP - 0.045), back)
            front(kit, span, (PLINTH, PLINTH + 0.14), back, box)
        elif k in (run.drawers, run.hob):
            cuts = (PLINTH, PLINTH + 0.31, PLINTH + 0.62, TOP - 0.042)
            for y0, y1 in itertools.pairwise(cuts):
                front(kit, span, (y0, y1), back, box, shaker=shaker, pull=pull_style(kit, "top"), grain="x")
        elif k == run.dishwasher:
            front(kit, span, (PLINTH, TOP - 0.042), back, box, shaker=shaker, pull=pull_style(kit, "top"))
        elif k == run.sink or run.step > 0.62 or k % 2:
            place = "right" if k % 2 else "left"
            front(kit, span, (PLINTH, TOP - 0.042), back, box, shaker=shaker, pull=pull_style(kit, place))
        else:
            front(kit, span, (TOP - 0.2, TOP - 0.042), back, box, shaker=shaker, pull=pull_style(kit, "top"), grain="x")
            front(kit, span, (PLINTH, TOP - 0.2), back, box, shaker=shaker, pull=pull_style(kit, "left"))


def _hob(kit: Kit, x: float, half: float, decor: bool) -> None:
    """A glass-ceramic hob, ``half`` its width (m), sometimes with a pot on it."""
    kit.panel((x - half, TOP, 0.06), (x + half, TOP + 0.006, 0.57), kit.m("black_glass"), bevel=0.002)
    inner = half - 0.004
    corners = [
        (x - inner, TOP + 0.0063, 0.566),
        (x + inner, TOP + 0.0063, 0.566),
        (x + inner, TOP + 0.0063, 0.064),
        (x - inner, TOP + 0.0063, 0.064),
    ]
    kit.cloth_quad(corners, kit.m("hob"))
    if decor and kit.rng.random() < 0.6:
        _pot(kit, (x - 0.45 * half, TOP + 0.0065, 0.22))


def _sink(kit: Kit, x: float, step: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """A steel or ceramic basin below the worktop with a tap behind it; returns its cut-out (x, z)."""
    material = kit.m(kit.pick("steel", "steel", "ceramic"))
    w, d, z = min(0.5, step - 0.08), 0.38, 0.33
    kit.loft(
        ring_stack(
            [
                (w - 0.002, d - 0.002, 0.03, TOP - 0.19),
                (w - 0.002, d - 0.002, 0.03, TOP - 0.05),
                (w - 0.002, d - 0.002, 0.03, TOP + 0.0002),
                (w + 0.03, d + 0.03, 0.03, TOP + 0.0002),
                (w + 0.03, d + 0.03, 0.03, TOP + 0.0015),
                (w - 0.004, d - 0.004, 0.03, TOP + 0.0015),
                (w - 0.012, d - 0.012, 0.03, TOP - 0.008),
                (w - 0.03, d - 0.03, 0.045, TOP - 0.15),
                (w - 0.09, d - 0.09, 0.04, TOP - 0.175),
            ],
            centre=(x, z),
        ),
        material,
        crease=45.0,
    )
    kit.cylinder(0.04, 0.004, (x, TOP - 0.173, z), kit.m("chrome"), segments=16)
    tap(kit, (x, TOP, 0.075), kit.m("tap"), style="arc", height=0.34, reach=0.2)
    return (x - w / 2, x + w / 2), (z - d / 2, z + d / 2)


def _free_tops(kit: Kit, left: float, step: float, taken: list[int], count: int, decor: bool) -> None:
    """Declare the free parts of the worktop as supports, after small things have been put on up to two ends."""
    runs: list[list[float]] = []
    for k in range(count):
        if k in taken:
            continue
        x0, x1 = left + k * step, left + (k + 1) * step
        if runs and abs(runs[-1][1] - x0) < 1e-6:
            runs[-1][1] = x1
        else:
            runs.append([x0, x1])
    things = [_jar, _fruit, _board_and_bottle]
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
    kit.lathe(
        [(0.0, 0.0), (0.055, 0.0), (0.06, 0.14), (0.054, 0.14), (0.05, 0.02), (0.0, 0.02)],
        kit.m("pot_white"),
        centre=(x, TOP, 0.14),
        segments=16,
    )
    for k in range(4):
        a = 2 * np.pi * k / 4 + 0.4
        foot = np.array([x + 0.02 * np.cos(a), TOP + 0.03, 0.14 + 0.02 * np.sin(a)])
        head = np.array([x + 0.06 * np.cos(a), TOP + 0.27 + 0.02 * (k % 2), 0.14 + 0.05 * np.sin(a)])
        kit.rod(foot, head, 0.005, kit.m("wood"), sides=6)
        kit.sphere((0.022, 0.032, 0.008), tuple(head), kit.m("wood" if k % 2 else "wood_alt"), rings=6, segments=8)


def _fruit(kit: Kit, x: float) -> None:
    """A bowl of fruit on the worktop."""
    fruit_bowl(kit, (x, TOP, 0.3))


def _board_and_bottle(kit: Kit, x: float) -> None:
    """A chopping board leaning on the splash-back and a bottle of oil."""
    turn = rotation("x", -9)
    kit.panel((x - 0.11, TOP, 0.035), (x + 0.11, TOP + 0.33, 0.055), kit.m("butcher"), bevel=0.006, rotate=turn)
    profile = [(0.0, 0.0), (0.032, 0.0), (0.033, 0.15), (0.012, 0.2), (0.012, 0.25), (0.0, 0.25)]
    kit.lathe(profile, kit.m("fruit_green"), centre=(x + 0.05, TOP, 0.15), segments=14)
    kit.lathe(
        [(0.0, 0.0), (0.026, 0.0), (0.028, 0.07), (0.018, 0.1), (0.018, 0.115), (0.0, 0.115)],
        kit.m("wood_alt"),
        centre=(x - 0.04, TOP, 0.14),
        segments=14,
    )


def _pot(kit: Kit, at: tuple[float, float, float]) -> None:
    """A saucepan with a lid."""
    x, y, z = at
    metal = kit.m(kit.pick("steel", "ceramic_accent", "black_metal"))
    kit.lathe(
        [(0.0, 0.0), (0.088, 0.0), (0.092, 0.01), (0.092, 0.11), (0.095, 0.113), (0.06, 0.128), (0.0, 0.133)],
        metal,
        centre=at,
        segments=24,
    )
    kit.sphere((0.014, 0.011, 0.014), (x, y + 0.142, z), kit.m("plastic_black"), rings=6, segments=8)
    for side in (-1, 1):
        kit.tube(
            [
                (x + side * 0.09, y + 0.085, z - 0.03),
                (x + side * 0.122, y + 0.09, z - 0.02),
                (x + side * 0.122, y + 0.09, z + 0.02),
                (x + side * 0.09, y + 0.085, z + 0.03),
            ],
            0.006,
            kit.m("plastic_black"),
            segments=6,
        )


def oven_front(kit: Kit, x: tuple[float, float], y: tuple[float, float], z: float) -> None:
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
    kit.cloth_quad(
        [
            (mid - strip_w / 2, split + 0.057 - h, z + 0.0223),
            (mid + strip_w / 2, split + 0.057 - h, z + 0.0223),
            (mid + strip_w / 2, split + 0.057 + h, z + 0.0223),
            (mid - strip_w / 2, split + 0.057 + h, z + 0.0223),
        ],
        kit.m("oven_panel"),
    )
    for side in (-1, 1):
        kit.cylinder(
            0.021,
            0.02,
            (mid + side * (x1 - x0) * 0.39, split + 0.057, z + 0.032),
            kit.m("black_metal"),
            axis="z",
            segments=16,
            bevel=0.004,
        )
    kit.panel((x0 + 0.05, y[0] + 0.06, z + 0.02), (x1 - 0.05, split - 0.085, z + 0.024), dark, bevel=0.001)
    handle(kit, (mid, split - 0.04, z + 0.02), steel, style="bar", length=(x1 - x0) * 0.8, axis="x")
