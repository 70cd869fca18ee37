"""Floor lamps and pendant lamps."""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.common import Kit
from generators.core.scene import Material


def floor_lamp(kit: Kit) -> None:
    """A lamp with a drum shade on a stem or a tripod, or an arc with a dome."""
    form = kit.pick("stem", "tripod", "arc")
    metal, shade = kit.m("metal"), kit.m("lamp_shade")
    tall = kit.near(1.55, 0.04)
    if form == "arc":
        kit.lathe(
            [(0.0, 0.0), (0.155, 0.0), (0.155, 0.03), (0.15, 0.035), (0.0, 0.035)],
            metal,
            centre=(-0.45, 0.0, 0.0),
            segments=30,
        )
        t = np.linspace(0, 1, 14)
        bow = np.stack([-0.45 + 0.8 * t**1.6, 0.03 + (tall + 0.1) * np.sin(np.pi * 0.56 * t) * 1.02, 0.0 * t], axis=1)
        kit.tube(bow, 0.011, metal, segments=8)
        x, y = float(bow[-1, 0]), float(bow[-1, 1])
        dome = [(0.15, -0.19), (0.145, -0.12), (0.11, -0.055), (0.05, -0.02), (0.0, -0.01)]
        inner = [(0.0, -0.02), (0.05, -0.03), (0.105, -0.065), (0.138, -0.125), (0.146, -0.19)]
        kit.lathe(inner + dome, metal, centre=(x, y, 0.0), segments=28)
        kit.sphere(0.05, (x, y - 0.11, 0.0), kit.m("bulb"), rings=8, segments=14)
        kit.sound((x - 0.12, y - 0.19, -0.12), (x + 0.12, y, 0.12), metal)
        return
    low = tall - 0.3
    if form == "tripod":
        wood = kit.m("wood")
        for k in range(3):
            a = np.pi / 2 + 2 * np.pi * k / 3
            kit.rod(
                (0.27 * np.cos(a), 0.0, 0.27 * np.sin(a)),
                (0.022 * np.cos(a), low - 0.02, 0.022 * np.sin(a)),
                0.011,
                wood,
                end_radius=0.014,
                sides=9,
            )
        kit.cylinder(0.04, 0.03, (0.0, low - 0.02, 0.0), metal, segments=14)
    else:
        kit.lathe([(0.0, 0.0), (0.14, 0.0), (0.14, 0.014), (0.03, 0.024), (0.0, 0.024)], metal, segments=30)
        kit.rod((0.0, 0.02, 0.0), (0.0, low + 0.02, 0.0), 0.010, metal, sides=10)
    kit.rod((0.0, low - 0.01, 0.0), (0.0, low + 0.1, 0.0), 0.013, metal, sides=8)
    _drum(kit, (0.0, low, 0.0), 0.2, 0.155, 0.29, shade)
    kit.sphere(0.035, (0.0, low + 0.14, 0.0), kit.m("bulb"), rings=7, segments=12)
    kit.sound((-0.15, low, -0.15), (0.15, low + 0.29, 0.15), shade)


def _drum(
    kit: Kit, at: tuple[float, float, float], bottom: float, top: float, height: float, material: Material
) -> None:
    """An open lamp shade: a thin-walled frustum."""
    wall = 0.004
    profile = [(bottom - wall, 0.0), (bottom, 0.0), (top, height), (top - wall, height), (bottom - wall, 0.0)]
    kit.lathe(profile, material, centre=at, segments=32)


def ceiling_lamp(kit: Kit, *, drop: float | None = None) -> None:
    """A pendant (dome, globe, drum or a cluster), or a flat ceiling disc; ``drop`` is its length."""
    kit.mount = "ceiling"
    form = kit.pick("dome", "globe", "drum", "cluster") if drop != 0 else "disc"
    metal = kit.m("metal")
    if form == "disc":
        kit.lathe(
            [(0.0, -0.075), (0.14, -0.07), (0.175, -0.05), (0.18, -0.03), (0.0, -0.03)],
            kit.m("lamp_glass"),
            segments=36,
        )
        kit.cylinder(0.187, 0.03, (0.0, -0.015, 0.0), metal, segments=36)
        kit.sound((-0.15, -0.07, -0.15), (0.15, 0.0, 0.15), metal)
        return
    length = float(drop or 0.55 * kit.rng.uniform(0.9, 1.15))
    kit.lathe([(0.0, -0.028), (0.035, -0.026), (0.055, -0.008), (0.055, 0.0), (0.0, 0.0)], metal, segments=20)
    cable = kit.m("plastic_black")
    if form == "cluster":
        _cluster(kit, length, metal)
        kit.sound((-0.15, -length, -0.15), (0.15, -length * 0.6, 0.15), kit.m("lamp_glass"))
        return
    size = {"dome": 0.2, "globe": 0.15, "drum": 0.22}[form]
    y = -length
    if form == "dome":
        _dome(kit, size, y, metal)
        high = y + 0.235
    elif form == "globe":
        kit.sphere(size, (0.0, y + size, 0.0), kit.m("lamp_glass"), rings=18, segments=32)
        kit.cylinder(0.045, 0.05, (0.0, y + 2 * size + 0.012, 0.0), metal, segments=18)
        high = y + 2 * size + 0.03
    else:
        _drum(kit, (0.0, y, 0.0), size, size, 0.22, kit.m("lamp_shade"))
        kit.cylinder(size - 0.006, 0.006, (0.0, y + 0.008, 0.0), kit.m("lamp_glass"), segments=32)
        for a in (0.0, np.pi / 2):
            c, s = size * float(np.cos(a)), size * float(np.sin(a))
            kit.rod((-c, y + 0.2, -s), (c, y + 0.2, s), 0.003, metal, sides=5)
        high = y + 0.2
    kit.rod((0.0, -0.02, 0.0), (0.0, high, 0.0), 0.003, cable, sides=6)
    kit.sound((-size * 0.85, y, -size * 0.85), (size * 0.85, min(high, y + 0.26), size * 0.85), metal)


def _dome(kit: Kit, size: float, y: float, metal: Material) -> None:
    """An open dome of radius ``size`` whose rim is at height ``y``, with its bulb."""
    skin = kit.m(kit.pick("metal", "accent_paint", "white"))
    outer = [
        (size, 0.0),
        (0.96 * size, 0.07),
        (0.72 * size, 0.15),
        (0.3 * size, 0.2),
        (0.16 * size, 0.235),
        (0.0, 0.24),
    ]
    inner = [(0.0, 0.215), (0.28 * size, 0.19), (0.69 * size, 0.142), (0.935 * size, 0.068), (0.975 * size, 0.0)]
    kit.lathe(inner + outer, skin, centre=(0.0, y, 0.0), segments=36)
    kit.sphere(0.045, (0.0, y + 0.075, 0.0), kit.m("bulb"), rings=8, segments=14)
    kit.cylinder(0.02, 0.12, (0.0, y + 0.16, 0.0), metal, segments=10)


def _cluster(kit: Kit, length: float, metal: Material) -> None:
    """Three small globes on cables of different length."""
    cable = kit.m("plastic_black")
    for k in range(3):
        a = 2 * np.pi * k / 3 + 0.4
        x, z, y = 0.13 * np.cos(a), 0.13 * np.sin(a), -(length - 0.05) * (0.72 + 0.14 * k)
        kit.tube(
            [
                (0.02 * np.cos(a), -0.02, 0.02 * np.sin(a)),
                (0.09 * np.cos(a), -0.1, 0.09 * np.sin(a)),
                (x, -0.2, z),
                (x, y + 0.1, z),
            ],
            0.003,
            cable,
            segments=5,
        )
        kit.cylinder(0.022, 0.055, (x, y + 0.09, z), metal, segments=12)
        kit.sphere(0.06, (x, y + 0.01, z), kit.m("lamp_glass"), rings=10, segments=18)
