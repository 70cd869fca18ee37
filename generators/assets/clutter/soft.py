"""Small things of cloth and leather: cushions, blankets, clothes, shoes and bags.

Each builder adds one thing to an empty `Kit`: lying or standing on y = 0 about the origin, its front towards +Z; what
hangs has its back at z = 0 and its hook at the top.
"""

from __future__ import annotations

import numpy as np

from generators.assets.forms import Array
from generators.assets.furniture.common import Kit
from generators.assets.shapes import rotation
from generators.core.scene import Material

#: Roles of plain and patterned cloth.
CLOTHS = ("cushion_0", "cushion_1", "cushion_2", "cushion_3", "print_0", "print_1", "throw")


def _cloth(kit: Kit) -> Material:
    return kit.m(kit.pick(*CLOTHS))


def cushion(kit: Kit) -> None:
    """A cushion lying flat, its middle dented, with creases towards its corners."""
    size = float(kit.rng.uniform(0.38, 0.48))
    turn = rotation("x", -90)
    kit.pillow((size, size, 0.15), (float(kit.rng.random()), 0.07, 0.0), _cloth(kit), rotate=turn)


def floor_cushion(kit: Kit) -> None:
    """A thick round seat cushion for the floor."""
    r, h = float(kit.rng.uniform(0.24, 0.3)), float(kit.rng.uniform(0.18, 0.3))
    outer = [(0.0, 0.0), (0.8 * r, 0.0), (0.97 * r, 0.2 * h), (r, 0.5 * h), (0.96 * r, 0.82 * h), (0.8 * r, h)]
    kit.lathe([*outer, (0.2 * r, 0.97 * h), (0.0, 0.94 * h)], _cloth(kit), segments=18, crease=70.0)
    kit.sound((-0.8 * r, 0.0, -0.8 * r), (0.8 * r, h, 0.8 * r), kit.m("sofa"))


def folded_blanket(kit: Kit) -> None:
    """A blanket folded three times."""
    folded(kit, (0.4, 0.3), 3, 0.028, ("throw", "cushion_0", "bedding", "cushion_3"), same=True)


def folded_clothes(kit: Kit) -> None:
    """A pile of folded clothes."""
    roles = ("cushion_0", "cushion_1", "throw", "sheet", "print_0", "tone_0", "curtain", "cushion_3")
    folded(kit, (0.27, 0.22), int(kit.rng.integers(3, 6)), 0.026, roles, same=False)


def folded(
    kit: Kit, size: tuple[float, float], count: int, thick: float, roles: tuple[str, ...], *, same: bool
) -> None:
    """Layers of folded cloth on each other, each a little askew."""
    y, cloth = 0.0, kit.m(kit.pick(*roles))
    for _ in range(count):
        if not same:
            cloth = kit.m(kit.pick(*roles))
        wide, deep = (s * float(kit.rng.uniform(0.93, 1.0)) for s in size)
        high = thick * float(kit.rng.uniform(0.85, 1.2))
        turn = rotation("y", float(kit.rng.uniform(-4, 4)))
        at = (float(kit.rng.uniform(-0.008, 0.008)), y + high / 2, float(kit.rng.uniform(-0.008, 0.008)))
        kit.soft((wide, high, deep), at, cloth, radius=0.5 * high, cells=2, rotate=turn)
        y += high


def laundry_pile(kit: Kit) -> None:
    """Clothes thrown on a heap."""
    heap(kit, 0.2, 0.12, _cloth(kit))
    for k in range(2):
        a = 2.6 * k + float(kit.rng.uniform(0, 2))
        inner = Kit(kit.palette, kit.rng)
        heap(inner, 0.11, 0.16, inner.m(inner.pick("sheet", "tone_0", "cushion_1", "bedding")))
        kit.merge(inner.build(), centre=(0.08 * np.cos(a), 0.0, 0.08 * np.sin(a)))


def heap(kit: Kit, radius: float, height: float, material: Material) -> None:
    """Crumpled cloth: a mound with folds that run down to an uneven rim on y = 0."""
    rings, points = 6, 18
    phase = kit.rng.uniform(0, 2 * np.pi, 4)
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    loops = []
    for k in range(rings):
        s = k / (rings - 1)
        r = (
            radius
            * (1 - 0.93 * s**1.3)
            * (1 + 0.16 * np.sin(3 * angle + phase[0]) + 0.09 * np.sin(7 * angle + phase[1]))
        )
        y = height * (s**0.75) * (1 + (0.22 * np.sin(5 * angle + phase[2] + 2 * s)) * (1 - s))
        loops.append(np.stack([r * np.sin(angle), np.maximum(y, 0.0) if k else 0 * angle, r * np.cos(angle)], axis=1))
    kit.loft(np.array(loops), material, crease=55.0)


def dropped_garment(kit: Kit) -> None:
    """A jumper or a pair of trousers dropped on the floor, a chair or a bed."""
    heap(kit, float(kit.rng.uniform(0.16, 0.22)), 0.07, kit.m(kit.pick("tone_0", "cushion_1", "throw", "cushion_2")))


def throw_blanket(kit: Kit) -> None:
    """A blanket spread loosely on a flat place: folds across, uneven hems."""
    w, d = kit.near(0.62, 0.12), kit.near(0.46, 0.12)
    u, v = np.linspace(-1, 1, 11), np.linspace(-1, 1, 8)
    s, t = np.meshgrid(u, v)
    phase = kit.rng.uniform(0, 2 * np.pi, 4)
    lift = 0.02 * np.clip(np.sin(5.2 * s + 1.1 * t + phase[0]), 0, 1) ** 2
    lift += 0.012 * np.clip(np.sin(3.1 * s - 2.3 * t + phase[1]), 0, 1)
    x = w / 2 * s + 0.02 * np.sin(2.4 * t + phase[2])
    z = -d / 2 * t + 0.018 * np.sin(3 * s + phase[3])
    kit.shell(np.stack([x, 0.006 + lift, z], axis=2), 0.01, kit.m(kit.pick("throw", "cushion_0", "bedding")))


def slippers(kit: Kit) -> None:
    """A pair of slippers, left as they were stepped out of."""
    felt, sole = kit.m(kit.pick("cushion_0", "throw", "leather", "tone_1")), kit.m("plastic_black")
    for side in (-1, 1):
        one = Kit(kit.palette, kit.rng)
        outline = _sole(0.26, 0.095)
        one.loft(np.stack([np.insert(outline, 1, y, axis=1) for y in (0.0, 0.014)]), sole)
        s, t = np.linspace(-1, 1, 7), np.linspace(0.0, 1.0, 4)
        rows = []
        for v in t:
            half = 0.047 * np.cos(0.75 * v)
            z = 0.005 + 0.105 * v
            rise = (0.05 - 0.028 * v**2) * np.sqrt(np.clip(1 - 0.97 * s**2, 0, 1))
            rows.append(np.stack([half * s, 0.012 + rise, np.full(7, z)], axis=1))
        one.shell(np.array(rows[::-1]), 0.006, felt)
        turn = rotation("y", side * 4 + float(kit.rng.uniform(-14, 14)))
        kit.merge(one.build(), centre=(side * 0.065, 0.0, float(kit.rng.uniform(-0.03, 0.03))), rotate=turn)


def _sole(length: float, width: float, points: int = 14) -> Array:
    """(N, 2: x, z) outline of a shoe's sole, counter-clockwise from above, its toe towards +Z."""
    t = np.linspace(0, 2 * np.pi, points, endpoint=False)
    z = length / 2 * np.cos(t)
    x = width / 2 * np.sin(t) * (0.86 + 0.14 * np.cos(t - 0.4))
    return np.stack([x, z], axis=1)


def shoes(kit: Kit) -> None:
    """A pair of laced shoes or trainers."""
    upper = kit.m(kit.pick("leather", "tone_0", "plastic_black", "cushion_2", "sheet"))
    sole = kit.m(kit.pick("plastic_white", "plastic_black", "stem"))
    scale = float(kit.rng.uniform(0.85, 1.05))
    for side in (-1, 1):
        one = Kit(kit.palette, kit.rng)
        base = _sole(0.28, 0.1)
        one.loft(np.stack([np.insert(base, 1, y, axis=1) for y in (0.0, 0.022)]), sole)
        loops = []
        for y, shrink, back, front in (
            (0.022, 0.94, 1.0, 1.0),
            (0.05, 0.86, 1.0, 0.9),
            (0.075, 0.66, 1.0, 0.35),
            (0.09, 0.58, 1.0, 0.1),
        ):
            z = np.where(base[:, 1] > 0, base[:, 1] * front, base[:, 1] * back * 0.95)
            loops.append(np.stack([base[:, 0] * shrink, np.full(len(base), y), z], axis=1))
        low = loops[-1] * (0.86, 1.0, 0.86)
        loops += [low, low - (0.0, 0.03, 0.0)]
        one.loft(np.array(loops), upper, crease=50.0)
        turn = rotation("y", side * 3 + float(kit.rng.uniform(-9, 9)))
        moved = one.build().transformed(turn, np.array([side * 0.062, 0.0, float(kit.rng.uniform(-0.02, 0.02))]))
        kit.merge(moved.transformed(np.eye(3), np.zeros(3), scale))


def rucksack(kit: Kit) -> None:
    """A rucksack that stands against something, with a pocket and two straps."""
    cloth = kit.m(kit.pick("tone_0", "tone_3", "cushion_2", "plastic_black"))
    trim = kit.m("leather")
    lean = rotation("x", -7)
    kit.soft(
        (kit.near(0.3, 0.08), 0.42, 0.16),
        (0.0, 0.21, 0.0),
        cloth,
        radius=0.06,
        puff=(0.0, 0.0, 0.02),
        cells=3,
        rotate=lean,
    )
    kit.soft((0.23, 0.17, 0.07), (0.0, 0.12, 0.1), cloth, radius=0.03, cells=2, rotate=lean)
    kit.box((0.16, 0.006, 0.005), (0.0, 0.19, 0.131), trim)
    t = np.linspace(0, np.pi, 7)
    loop = np.stack([0.03 * np.cos(t), 0.415 + 0.03 * np.sin(t), np.full(7, -0.06)], axis=1)
    kit.tube(loop, 0.007, trim, segments=5)
    kit.sound((-0.14, 0.0, -0.08), (0.14, 0.4, 0.08), kit.m("throw"))


def tote_bag(kit: Kit) -> None:
    """A soft bag with two handles, standing slumped."""
    cloth = kit.m(kit.pick("leather", "curtain", "tone_1", "cushion_0"))
    kit.soft((0.34, 0.26, 0.13), (0.0, 0.13, 0.0), cloth, radius=0.05, puff=(0.0, 0.0, 0.015), cells=3)
    for z, bend in ((0.03, 0.03), (-0.03, -0.05)):
        t = np.linspace(0, np.pi, 8)
        bow = np.stack([0.07 * np.cos(t), 0.25 + 0.11 * np.sin(t), z + bend * np.sin(t)], axis=1)
        kit.tube(bow, 0.006, cloth, segments=5)


def garment_on_hook(kit: Kit) -> None:
    """A dressing gown or a shirt on a wall hook: gathered at the top, long folds."""
    kit.mount = "wall"
    long = float(kit.rng.uniform(0.75, 1.05))
    cloth = kit.m(kit.pick("sheet", "cushion_1", "throw", "tone_0", "bedding"))
    metal = kit.m("metal")
    kit.panel((-0.02, 0.0, 0.0), (0.02, 0.06, 0.008), metal, bevel=0.002)
    kit.tube([(0, 0.03, 0.008), (0, 0.02, 0.04), (0, 0.035, 0.055), (0, 0.055, 0.056)], 0.005, metal, segments=5)
    u = np.linspace(-1, 1, 15)
    phase = float(kit.rng.uniform(0, 6))
    rows = []
    for t in np.linspace(0, 1, 7):
        half = 0.02 + 0.19 * min(1.0, 2.2 * t) * (1 + 0.12 * t)
        fold = (0.004 + 0.022 * min(1.0, 1.5 * t)) * np.sin(8.5 * u + phase)
        hem = 0.012 * np.sin(5 * u + phase) if t == 1 else 0.0
        rows.append(np.stack([half * u, 0.035 - long * t + hem + 0 * u, 0.058 - 0.012 * t + fold], axis=1))
    kit.shell(np.array(rows), 0.008, cloth)
    kit.sound((-0.18, 0.05 - long, 0.03), (0.18, 0.02, 0.08), kit.m("throw"))


def hanger_with_shirt(kit: Kit) -> None:
    """A shirt on a clothes hanger, hooked over a rail or a nail at the wall."""
    kit.mount = "wall"
    wood, metal = kit.m("wood"), kit.m("chrome")
    cloth = kit.m(kit.pick("sheet", "tone_2", "print_1", "cushion_3"))
    kit.tube(
        [(0, 0.0, 0.045), (0.0, 0.05, 0.045), (0.016, 0.068, 0.045), (0.0, 0.085, 0.03), (0, 0.085, 0.0)],
        0.0022,
        metal,
        segments=4,
    )
    for side in (-1, 1):
        kit.rod((0.0, 0.0, 0.045), (side * 0.21, -0.06, 0.045), 0.009, wood, sides=5)
    u = np.linspace(-1, 1, 13)
    phase = float(kit.rng.uniform(0, 6))
    rows = []
    for t in np.linspace(0, 1, 6):
        half = 0.225 + 0.012 * t
        top = -0.008 - 0.062 * np.abs(u)
        y = top * (1 - t) - 0.68 * t
        z = 0.047 + (0.004 + 0.014 * t) * np.sin(7 * u + phase)
        rows.append(np.stack([half * u, y, z], axis=1))
    kit.shell(np.array(rows), 0.024, cloth)
    for side in (-1, 1):
        sleeve = [(side * 0.21, -0.07, 0.045), (side * 0.245, -0.2, 0.05), (side * 0.24, -0.42, 0.05)]
        kit.tube(sleeve, [0.035, 0.042, 0.036], cloth, segments=7)
    kit.sound((-0.22, -0.68, 0.03), (0.22, 0.0, 0.07), kit.m("throw"))
