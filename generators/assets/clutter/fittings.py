"""What electricians and fitters leave on walls and ceilings: switches, sockets with plugs and cables, grilles."""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.forms import PLASTICS, coloured
from generators.assets.clutter.record import ClutterKind
from generators.assets.forms import smooth_path
from generators.assets.furniture.common import Kit
from generators.core.scene import Material

#: Side of a plate, how far it stands out (less than a skirting board), and radius of its edge (m).
_PLATE, _THICK, _BEVEL = 0.082, 0.009, 0.003
#: Height of the middle of switches, of sockets near the floor and of those over worktops (m), as electricians set them.
_SWITCH, _SOCKET, _OVER_WORKTOP = (1.05, 1.05), (0.3, 0.3), (1.08, 1.12)


def _plate_material(kit: Kit) -> Material:
    """All plates of a home are alike: white, cream or black plastic."""
    code = str(kit.palette.choose("plates", ("#e8e7e3", "#e8e7e3", "#ddd6c6", "#3a3a3b")))
    return kit.palette.tinted("plastic_white", code)


def _plate(kit: Kit, gangs: int, y: float = 0.0) -> Material:
    material = _plate_material(kit)
    half = gangs * _PLATE / 2
    kit.panel((-half, y - _PLATE / 2, 0.0), (half, y + _PLATE / 2, _THICK), material, bevel=_BEVEL)
    return material


def switch(kit: Kit) -> None:
    """One or two rockers on a plate."""
    kit.mount = "wall"
    gangs = int(kit.rng.choice([1, 1, 2]))
    material = _plate(kit, gangs)
    for k in range(gangs):
        x = (k - (gangs - 1) / 2) * _PLATE
        kit.panel((x - 0.029, -0.029, _THICK), (x + 0.029, 0.029, _THICK + 0.004), material, bevel=0.0015)


def _outlet(kit: Kit, x: float, y: float, material: Material) -> None:
    """The round well of an outlet with its two holes."""
    kit.lathe(
        [(0.0225, 0.0005), (0.021, 0.0025), (0.0185, 0.0005), (0.0, 0.0005)],
        kit.palette.tinted(material.name.split()[0], "#bdbbb5"),
        centre=(x, y, _THICK),
        segments=12,
        rotate=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    )
    for side in (-1, 1):
        kit.box((0.005, 0.005, 0.001), (x + side * 0.0095, y, _THICK + 0.001), kit.m("plastic_black"), acoustic=False)


def _plug(kit: Kit, x: float, y: float, drop: float, sway: float) -> None:
    """A plug whose cable hangs down by ``drop`` metres to the floor or worktop and then runs along it."""
    material = kit.m(kit.pick("plastic_white", "plastic_black"))
    kit.cylinder(0.018, 0.032, (x, y, _THICK + 0.016), material, axis="z", segments=10, bevel=0.004)
    low = y - drop + 0.005
    path = smooth_path(
        [
            (x, y - 0.012, _THICK + 0.028),
            (x, y - 0.05, _THICK + 0.027),
            (x + 0.25 * sway, low + 0.35 * drop, 0.024),
            (x + 0.5 * sway, low + 0.02, 0.026),
            (x + sway, low, 0.03),
        ],
        12,
    )
    kit.tube(path, 0.0033, material, segments=5)


def _sockets(kit: Kit, gangs: int, drop: float, likely: float) -> None:
    kit.mount = "wall"
    material = _plate(kit, gangs)
    for k in range(gangs):
        x = (k - (gangs - 1) / 2) * _PLATE
        if drop and kit.rng.random() < likely:
            _plug(kit, x, 0.0, drop, float(kit.rng.choice([-1, 1])) * float(kit.rng.uniform(0.05, 0.16)))
        else:
            _outlet(kit, x, 0.0, material)


def socket(kit: Kit) -> None:
    """One to three outlets near the floor."""
    _sockets(kit, int(kit.rng.choice([1, 2, 2, 3])), 0.0, 0.0)


def plugged_socket(kit: Kit) -> None:
    """Outlets near the floor, at least one with a plug; its cable reaches the floor."""
    _sockets(kit, int(kit.rng.choice([1, 2])), _SOCKET[0] - 0.002, 1.0)


def worktop_socket(kit: Kit) -> None:
    """Two or three outlets over a worktop."""
    _sockets(kit, int(kit.rng.choice([2, 3])), 0.0, 0.0)


def thermostat(kit: Kit) -> None:
    """A room thermostat: a small box with a wheel on its side."""
    kit.mount = "wall"
    material = _plate_material(kit)
    kit.panel((-0.04, -0.055, 0.0), (0.04, 0.055, 0.026), material, bevel=0.006)
    kit.panel((-0.026, 0.005, 0.026), (0.026, 0.036, 0.0268), kit.m("black_glass"), bevel=0.0)
    for k in (-1, 1):
        kit.panel((0.018 * k - 0.009, -0.03, 0.026), (0.018 * k + 0.009, -0.018, 0.029), material, bevel=0.002)


def smoke_detector(kit: Kit) -> None:
    """A flat round housing with slots on the ceiling."""
    kit.mount = "ceiling"
    white = kit.m("plastic_white")
    kit.lathe([(0.0, -0.036), (0.032, -0.036), (0.05, -0.026), (0.054, -0.012), (0.054, 0.0)], white, segments=20)
    kit.lathe([(0.0505, -0.022), (0.0535, -0.016)], kit.m("plastic_black"), segments=20)
    kit.cylinder(0.003, 0.002, (0.02, -0.036, 0.0), kit.m("fruit_red"), segments=8)


def vent(kit: Kit) -> None:
    """A ventilation grille with slanting slats."""
    kit.mount = "wall"
    half = float(kit.rng.choice([0.07, 0.09, 0.11]))
    white = kit.m(kit.pick("plastic_white", "radiator", "steel"))
    rim = 0.012
    kit.panel((-half + rim, -half + rim, 0.0), (half - rim, half - rim, 0.001), kit.m("plastic_black"), bevel=0.0)
    for a, b in (
        ((-half, -half), (half, -half + rim)),
        ((-half, half - rim), (half, half)),
        ((-half, -half + rim), (-half + rim, half - rim)),
        ((half - rim, -half + rim), (half, half - rim)),
    ):
        kit.panel((*a, 0.0), (*b, 0.01), white, bevel=0.0)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
    for y in np.arange(-half + rim + 0.006, half - rim, 0.014):
        kit.box((2 * (half - rim), 0.0095, 0.0015), (0.0, float(y), 0.005), white, rotate=tilt, acoustic=False)


def fuse_box(kit: Kit) -> None:
    """The flat door of a distribution board."""
    kit.mount = "wall"
    white = kit.m("radiator")
    w, h = kit.near(0.34, 0.1), kit.near(0.46, 0.15)
    kit.panel((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.008), white, bevel=0.002)
    kit.panel((-w / 2 + 0.022, -h / 2 + 0.022, 0.008), (w / 2 - 0.022, h / 2 - 0.022, 0.014), white, bevel=0.002)
    kit.panel((w / 2 - 0.05, -0.02, 0.014), (w / 2 - 0.035, 0.02, 0.018), kit.m("plastic_black"), bevel=0.001)


def hook(kit: Kit) -> None:
    """A bare wall hook."""
    kit.mount = "wall"
    metal = coloured(kit, "plastic_white", PLASTICS) if kit.rng.random() < 0.4 else kit.m("metal")
    kit.panel((-0.014, -0.022, 0.0), (0.014, 0.022, 0.006), metal, bevel=0.002)
    kit.tube([(0, 0.006, 0.006), (0, -0.004, 0.026), (0, 0.004, 0.036), (0, 0.02, 0.038)], 0.0045, metal, segments=6)


_EVERYWHERE = ("kitchen", "bathroom", "hall", "living_room", "bedroom")

KINDS = (
    ClutterKind("switch", switch, ("door_side",), dict.fromkeys(_EVERYWHERE, (1, 2)), height=_SWITCH),
    ClutterKind("worktop_socket", worktop_socket, ("worktop_wall",), {"kitchen": (2, 3)}, height=_OVER_WORKTOP),
    ClutterKind(
        "plugged_socket",
        plugged_socket,
        ("wall",),
        {"kitchen": (1, 1), "living_room": (1, 2), "bedroom": (1, 2), "hall": (1, 1)},
        height=(0.18, 0.18),
    ),
    ClutterKind(
        "socket",
        socket,
        ("wall",),
        {"kitchen": (1, 2), "living_room": (2, 3), "bedroom": (2, 3), "hall": (2, 3)},
        height=_SOCKET,
    ),
    ClutterKind("shaver_socket", socket, ("basin_wall",), {"bathroom": (1, 1)}, height=(1.1, 1.2)),
    ClutterKind(
        "thermostat", thermostat, ("door_side", "wall"), {"hall": (1, 1), "living_room": (1, 1)}, height=(1.3, 1.35)
    ),
    ClutterKind(
        "smoke_detector", smoke_detector, ("ceiling",), dict.fromkeys(("hall", "living_room", "bedroom"), (1, 1))
    ),
    ClutterKind("vent", vent, ("wall",), {"bathroom": (1, 1), "kitchen": (1, 1)}, height=(2.2, 2.28)),
    ClutterKind("fuse_box", fuse_box, ("wall",), {"hall": (1, 1)}, height=(1.7, 2.2)),
    ClutterKind("hook", hook, ("door_side", "tub_wall"), {"hall": (0, 2), "bathroom": (1, 2)}, height=(1.5, 1.6)),
)
