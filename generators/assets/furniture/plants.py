"""Pot plants: on the floor and on a shelf."""

from __future__ import annotations

import numpy as np

from generators.assets.forms import Array
from generators.assets.furniture.common import Kit
from generators.core.scene import Material


def _leaf(
    kit: Kit,
    root: Array,
    direction: Array,
    length: float,
    width: float,
    droop: float,
    material: Material,
    segments: int = 4,
) -> None:
    """A leaf from ``root`` along ``direction``, bending down by ``droop`` metres at its tip: a thin closed lens."""
    forward = direction / np.linalg.norm(direction)
    side = np.cross(forward, [0.0, 1.0, 0.0])
    norm = np.linalg.norm(side)
    side = np.array([1.0, 0.0, 0.0]) if norm < 1e-3 else side / norm
    up = np.cross(side, forward)
    t = np.linspace(0, 1, segments + 1)
    half = width / 2 * np.sin(np.pi * t**0.75) ** 0.9
    half[0], half[-1] = 0.0015, 0.0008
    spine = root + forward * (length * t)[:, None] - np.array([0.0, droop, 0.0]) * (t**2)[:, None]
    dish = up * (0.16 * half)[:, None]
    left, right = spine - side * half[:, None] + dish, spine + side * half[:, None] + dish
    low = spine - up * 0.0016
    count = segments + 1
    vertices = np.concatenate([left, spine, right, low])
    a, faces, chart = np.arange(segments), [], np.zeros((4 * count, 2))
    chart[:, 0] = np.tile(t, 4)
    chart[:, 1] = np.repeat([0.04, 0.5, 0.96, 0.5], count)
    for p, q in ((0, 1), (1, 2), (2, 3), (3, 0)):
        i, j = a + p * count, a + q * count
        faces += [np.stack([i, j, j + 1], axis=1), np.stack([i, j + 1, i + 1], axis=1)]
    index = np.concatenate(faces)[:, ::-1]
    p3 = vertices[index] - vertices.mean(axis=0)
    if np.einsum("ij,ij->i", p3[:, 0], np.cross(p3[:, 1], p3[:, 2])).sum() < 0:
        index = index[:, ::-1]
    kit.add(vertices, index, material, uv=chart[index], crease=35.0)


def small_plant(kit: Kit, at: tuple[float, float, float], height: float) -> None:
    """A pot plant for a shelf: rosette, upright blades or a little bush."""
    x, y, z = at
    pot = min(0.4 * height, 0.12)
    r = pot * 0.52
    _pot(kit, at, r, pot)
    form = kit.pick("rosette", "blades", "bush")
    leaf = kit.m(kit.pick("leaf", "leaf_alt"))
    root = np.array([x, y + pot * 0.88, z])
    reach = height - pot
    if form == "blades":
        for k in range(9):
            a = 2.4 * k
            out = np.array([0.28 * np.cos(a), 1.0, 0.28 * np.sin(a)])
            _leaf(
                kit,
                root + 0.3 * r * np.array([np.cos(a), 0, np.sin(a)]),
                out,
                reach * float(kit.rng.uniform(0.7, 1.0)),
                0.03,
                0.0,
                leaf,
                3,
            )
    elif form == "rosette":
        for k in range(16):
            a, s = 2.399963 * k, 0.35 + 0.65 * k / 16
            out = np.array([np.cos(a) * s, 1.1 - 0.75 * s, np.sin(a) * s])
            _leaf(kit, root, out, reach * float(kit.rng.uniform(0.75, 1.0)), 0.045, 0.03 * s, leaf, 3)
    else:
        for k in range(26):
            a = 2.399963 * k
            s = np.sqrt((k + 0.5) / 26)
            top = root + np.array([0.09 * s * np.cos(a), reach * (0.85 - 0.5 * s**2), 0.09 * s * np.sin(a)]) * float(
                kit.rng.uniform(0.8, 1.05)
            )
            out = np.array([np.cos(a), float(kit.rng.uniform(0.0, 0.9)), np.sin(a)])
            _leaf(kit, top - 0.02 * out, out, 0.065, 0.04, 0.012, leaf, 2)
            if k % 3 == 0:
                kit.rod(root, top, 0.0018, kit.m("leaf_alt"), sides=4)


def _pot(kit: Kit, at: tuple[float, float, float], radius: float, height: float) -> None:
    """A flower pot with soil."""
    form = kit.pick("tapered", "cylinder", "rimmed")
    role = kit.pick("pot", "pot_white", "ceramic_accent", "wicker" if radius > 0.1 else "pot_white")
    r, h = radius, height
    outer = {
        "tapered": [(0.0, 0.0), (0.7 * r, 0.0), (r, h)],
        "cylinder": [(0.0, 0.0), (0.88 * r, 0.0), (0.93 * r, 0.06 * h), (0.95 * r, h)],
        "rimmed": [(0.0, 0.0), (0.68 * r, 0.0), (0.9 * r, 0.78 * h), (r, 0.78 * h), (1.02 * r, h)],
    }[form]
    lip = outer[-1][0]
    inner = [(0.9 * lip, h), (0.86 * lip, 0.86 * h), (0.0, 0.86 * h)]
    kit.lathe(outer + inner, kit.m(role), centre=at, segments=16)
    kit.lathe(
        [(0.0, 0.8 * h), (0.84 * lip, 0.8 * h), (0.84 * lip, 0.89 * h), (0.0, 0.9 * h)],
        kit.m("soil"),
        centre=at,
        segments=14,
    )


def plant(kit: Kit, *, height: float | None = None) -> None:
    """A floor plant: rubber tree, palm, snake plant or monstera-like fans."""
    form = kit.pick("rubber", "palm", "snake", "fan")
    tall = float(height or {"rubber": 1.5, "palm": 1.6, "snake": 0.85, "fan": 1.05}[form] * kit.rng.uniform(0.88, 1.1))
    r, pot = 0.15 + 0.03 * float(kit.rng.random()) + (0.03 if form in ("palm", "rubber") else 0.0), 0.3
    _pot(kit, (0.0, 0.0, 0.0), r, pot)
    # The foliage is built first and then scaled to the requested height.
    tree = Kit(kit.palette, kit.rng)
    leaf = tree.m(tree.pick("leaf", "leaf", "leaf_alt"))
    soil = np.array([0.0, 0.87 * pot, 0.0])
    if form == "rubber":
        _rubber(tree, soil, tall, pot, leaf)
    elif form == "palm":
        _palm(tree, soil, tall, pot, leaf)
    elif form == "snake":
        for k in range(13):
            a = 2.399963 * k
            s = np.sqrt((k + 0.5) / 13)
            root = soil + 0.62 * r * s * np.array([np.cos(a), 0.0, np.sin(a)])
            out = np.array([0.16 * s * np.cos(a), 1.0, 0.16 * s * np.sin(a)])
            _leaf(tree, root, out, (tall - pot) * float(tree.rng.uniform(0.72, 1.05)), 0.062, 0.0, leaf, 5)
    else:
        for k in range(14):
            a, s = 2.399963 * k, 0.25 + 0.75 * ((k * 5) % 14) / 13
            out = np.array([0.42 * s * np.cos(a), 1.0, 0.42 * s * np.sin(a)])
            length = (tall - pot) * (0.92 - 0.35 * s)
            tip = soil + out / np.linalg.norm(out) * length
            mid = (soil + tip) / 2 + np.array([0.0, 0.05, 0.0])
            tree.tube([soil, mid, tip], [0.006, 0.005, 0.004], tree.m("leaf_alt"), segments=5)
            spread = np.array([np.cos(a), 0.15 - 0.3 * s, np.sin(a)])
            _leaf(tree, tip, spread, 0.29, 0.24, 0.09, leaf, 6)
    grown = tree.build()
    scale = (tall - float(soil[1])) / (float(grown.bounds[1, 1]) - float(soil[1]))
    kit.merge(grown.transformed(np.eye(3), soil * (1 - scale), scale))
    low, high = grown.bounds.astype(np.float64) * scale
    reach = 0.45 * min(high[0] - low[0], high[2] - low[2])
    kit.sound((-r, 0.0, -r), (r, pot, r), kit.m("pot_white"))
    kit.sound((-reach, pot + 0.15, -reach), (reach, tall * 0.95, reach), leaf)


def _palm(tree: Kit, soil: Array, tall: float, pot: float, leaf: Material) -> None:
    """Arching ribs with a leaflet on both sides of each."""
    for k in range(13):
        a, s = 2.399963 * k, 0.35 + 0.65 * ((k * 7) % 13) / 12
        out = np.array([0.22 * s * np.cos(a), 1.0, 0.22 * s * np.sin(a)])
        length = (tall - pot) * (1.05 - 0.35 * s)
        t = np.linspace(0, 1, 7)
        drop = 0.38 * s * length
        rib = (
            soil
            + out / np.linalg.norm(out) * (length * t)[:, None]
            + np.array([np.cos(a), 0, np.sin(a)]) * (0.2 * s * length * t**2)[:, None]
        )
        rib[:, 1] -= drop * t**3
        tree.tube(rib, np.linspace(0.006, 0.002, 7), tree.m("leaf_alt"), segments=4)
        for at in np.linspace(0.42, 0.98, 6):
            i = min(5, int(at * 6))
            p = rib[i] + (rib[i + 1] - rib[i]) * (at * 6 - i)
            ahead = (rib[i + 1] - rib[i]) / np.linalg.norm(rib[i + 1] - rib[i])
            across = np.cross(ahead, [0.0, 1.0, 0.0])
            across /= max(float(np.linalg.norm(across)), 1e-6)
            for side in (-1, 1):
                _leaf(tree, p, ahead * 0.8 + side * across * 0.8, 0.25 * (1.15 - 0.6 * at), 0.036, 0.06, leaf, 2)


def _rubber(tree: Kit, soil: Array, tall: float, pot: float, leaf: Material) -> None:
    """Two leaning stems with leaves all the way up."""
    for stem in range(2):
        lean = np.array([0.09 * np.cos(2.2 * stem + 1), 1.0, 0.09 * np.sin(2.2 * stem + 1)])
        top = soil + lean * (tall - pot - 0.1) * (1 - 0.22 * stem)
        tree.tube([soil + 0.03 * stem, (soil + top) / 2 + 0.01, top], [0.013, 0.01, 0.006], tree.m("stem"), segments=6)
        for k in range(15):
            s = 0.28 + 0.72 * k / 14
            a = 2.399963 * k + stem
            out = np.array([np.cos(a), 0.35 + 0.9 * max(0.0, s - 0.7) / 0.3, np.sin(a)])
            _leaf(tree, soil + (top - soil) * s, out, 0.30 * (1.1 - 0.35 * s), 0.13, 0.06, leaf, 4)
