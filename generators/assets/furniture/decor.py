"""Rug, pictures, curtains, radiator and door leaf."""

from __future__ import annotations

import numpy as np

from generators.assets.forms import Array, cap_faces, outward, skin_faces
from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import picture_frame
from generators.assets.materials import PICTURES, RUGS
from generators.assets.shapes import rotation
from generators.assets.styles import STYLES


def rug(kit: Kit, *, length: float | None = None, width: float | None = None) -> None:
    """A rug, 3 : 2, with its pattern over the whole of it, an uneven soft border, and sometimes fringes."""
    k = int(kit.rng.integers(RUGS))
    w = float(length or kit.near(2.3, 0.08))
    d, thick = float(width or w / 1.5), STYLES[kit.palette.style].pile
    material = kit.m(f"rug_{k}")
    x, z = w / 2, d / 2
    fringe = kit.rng.random() < 0.6
    # Twelve points to a side: hems are never quite straight, and the pile bends outwards over them.
    t = np.linspace(-1, 1, 13)[:-1]
    side = np.ones(12)
    outline = np.concatenate([np.stack(p, 1) for p in ((t, side), (side, -t), (-t, -side), (-side, t))])
    phase = kit.rng.uniform(0, 2 * np.pi, 4)
    angle = np.linspace(0, 2 * np.pi, len(outline), endpoint=False)
    sway = 0.0025 * np.sin(9 * angle + phase[0]) + 0.0015 * np.sin(23 * angle + phase[1])

    def ring(out: float, y: float) -> Array:
        return np.stack(
            [outline[:, 0] * (x - out + sway), np.full(len(outline), y), outline[:, 1] * (z - out + sway)], 1
        )

    bend = min(0.5 * thick, 0.006)
    loops = np.array(
        [
            ring(0.006, 0.0),
            ring(0.004, 0.5 * thick),
            ring(0.004 + 0.4 * bend, thick - 0.4 * bend),
            ring(0.004 + 1.6 * bend, thick),
        ]
    )
    count = len(outline)
    points = np.concatenate([loops.reshape(-1, 3), [[0.0, 0.0, 0.0], [0.0, thick, 0.0]]])
    bottom, top = cap_faces(len(loops), count)
    faces = np.concatenate([skin_faces(len(loops), count), bottom, top])
    chart = np.stack([0.5 + 0.497 * points[:, 0] / x, 0.5 - 0.497 * points[:, 2] / z], axis=1)
    kit.add(points, outward(points, faces), material, uv=chart[outward(points, faces)], crease=50.0)
    if fringe:
        _fringe(kit, x, z)
    kit.sound((-x, 0.0, -z), (x, 0.01, z), material)


def _fringe(kit: Kit, x: float, z: float) -> None:
    """Knotted threads of different lengths at the two short sides of a rug of 2·``x`` by 2·``z`` metres."""
    yarn = kit.m("sheer")
    for side in (-1, 1):
        for pz in np.arange(-z + 0.012, z - 0.005, 0.025):
            long, drift = float(kit.rng.uniform(0.035, 0.052)), float(kit.rng.uniform(-0.012, 0.012))
            tip = (side * (x + long), 0.002, pz + drift)
            index = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
            root = side * (x - 0.008)
            points = np.array([(root, 0.001, pz - 0.007), (root, 0.001, pz + 0.007), tip, (root, 0.007, pz)])
            kit.add(points, index if side < 0 else index[:, ::-1], yarn)


def picture(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A framed picture with or without a mount, or a pair or triptych of small ones."""
    kit.mount = "wall"
    frame = kit.m(kit.pick("wood", "wood_alt", "metal", "white", "plastic_black"))
    first = int(kit.rng.integers(PICTURES))
    group = 1 if width is not None else int(kit.rng.choice([1, 1, 2, 3]))
    if group == 1:
        w = float(width or kit.rng.choice([0.5, 0.7, 0.9]))
        h = float(height or w * kit.rng.choice([0.7, 1.0, 1.35]))
    else:
        w, h = 0.4, 0.5
    gap = 0.07
    for k in range(group):
        x = (k - (group - 1) / 2) * (w + gap)
        inner = Kit(kit.palette, kit.rng)
        band = 0.022
        picture_frame(inner, w, h, band, 0.026, frame)
        mount = 0.0 if group == 1 and kit.rng.random() < 0.4 else 0.12 * min(w, h)
        inner.panel(
            (-w / 2 + 0.01, -h / 2 + 0.01, 0.0), (w / 2 - 0.01, h / 2 - 0.01, 0.012), kit.m("mount_board"), bevel=0.0
        )
        pw, ph = w / 2 - band - mount, h / 2 - band - mount
        # The square picture is cropped, not distorted.
        su, sv = min(1.0, pw / ph), min(1.0, ph / pw)
        corners = np.array([(-pw, -ph, 0.0135), (pw, -ph, 0.0135), (pw, ph, 0.0135), (-pw, ph, 0.0135)])
        chart = np.array(
            [
                (0.5 - su / 2, 0.5 - sv / 2),
                (0.5 + su / 2, 0.5 - sv / 2),
                (0.5 + su / 2, 0.5 + sv / 2),
                (0.5 - su / 2, 0.5 + sv / 2),
            ]
        )
        index = np.array([[0, 1, 2], [0, 2, 3]])
        inner.add(corners, index, kit.m(f"picture_{(first + k) % PICTURES}"), uv=chart[index])
        kit.merge(inner.build(), centre=(x, 0.0, 0.0))
        kit.sound((x - w / 2, -h / 2, 0.0), (x + w / 2, h / 2, 0.026), kit.m("mount_board"))


#: Kind of curtain → width of a fold at the rod and at the hem (m), and depth of the folds there (m).
_FOLDS = {
    "pleated": ((0.08, 0.12), (0.020, 0.036)),
    "eyelet": ((0.13, 0.13), (0.040, 0.040)),
    "gathered": ((0.055, 0.11), (0.016, 0.034)),
    "sheer": ((0.06, 0.09), (0.014, 0.026)),
}
#: Points per fold at the rod, and rows of points from rod to hem.
_FOLD_POINTS, _CURTAIN_ROWS = 6, 7
#: Largest depth of a fold to each side of the rod (m): the curtains' place is planned with it.
_DEEPEST_FOLD = 0.044


def curtains(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A pair of curtains drawn to the sides of a window, on a rod with finials.

    ``width`` is the rod's length; the window between the curtains is about half of it. The mount is the wall: the
    centre of the back face is the origin. The style chooses how the cloth falls.
    """
    kit.mount = "wall"
    w, h = float(width or 2.0), float(height or 2.4)
    kind = str(kit.palette.choose("curtains", STYLES[kit.palette.style].curtains))
    cloth, metal = kit.m("sheer" if kind == "sheer" else "curtain"), kit.m("metal")
    top = h / 2 - 0.03
    kit.rod((-w / 2, top, 0.085), (w / 2, top, 0.085), 0.0125, metal, sides=10)
    for side in (-1, 1):
        kit.sphere(0.026, (side * (w / 2 + 0.012), top, 0.085), metal, rings=8, segments=12)
        kit.panel(
            (side * (w / 2 - 0.1) - 0.012, top - 0.03, 0.0),
            (side * (w / 2 - 0.1) + 0.012, top + 0.03, 0.008),
            metal,
            bevel=0.002,
        )
        kit.rod((side * (w / 2 - 0.1), top, 0.004), (side * (w / 2 - 0.1), top, 0.085), 0.008, metal, sides=6)
        reach = min(0.28 * w, 0.62) * float(kit.rng.uniform(0.85, 1.0))
        fall = _fall(kind, reach, float(kit.rng.uniform(0, 6)))
        heights = np.linspace(top + (0.014 if kind == "eyelet" else -0.016), -h / 2 + 0.012, _CURTAIN_ROWS)
        rows = [
            np.stack([side * (w / 2 - 0.03 - x), np.full(len(x), y), 0.085 + z], axis=1)
            for y, (x, z) in zip(heights, fall, strict=True)
        ]
        kit.shell(np.array(rows), 0.003, cloth)
        x0, x1 = sorted((side * (w / 2 - 0.03), side * (w / 2 - 0.03 - reach)))
        kit.sound((x0, -h / 2 + 0.012, 0.06), (x1, top, 0.11), cloth)


def _fall(kind: str, reach: float, phase: float) -> list[tuple[Array, Array]]:
    """How a curtain falls: per row from rod to hem, distances (N,) along the rod and from its plane (m).

    Narrow folds at the rod merge into fewer, wider and deeper ones of different sizes at the hem.
    """
    (narrow, wide), (shallow, deep) = _FOLDS[kind]
    rng = np.random.default_rng(int(phase * 1e6))
    above, below = max(3, round(reach / narrow)), max(3, round(reach / wide))
    u = np.linspace(0, 1, above * _FOLD_POINTS + 1)
    # A monotone warp of the hem makes its folds unequal.
    uneven = np.concatenate([[0.0], np.cumsum(rng.uniform(0.6, 1.4, below))])
    warp = np.interp(u, uneven / uneven[-1], np.linspace(0, 1, below + 1))
    size = np.interp(u, np.linspace(0, 1, below), rng.uniform(0.65, 1.0, below))
    out = []
    for s in np.linspace(0, 1, _CURTAIN_ROWS):
        blend = s**0.7
        upper, lower = 2 * np.pi * above * u, 2 * np.pi * below * warp + phase * s
        z = (1 - blend) * shallow * np.cos(upper) + blend * deep * size * np.cos(lower)
        sway = 0.3 * ((1 - blend) * shallow * np.sin(upper) + blend * deep * size * np.sin(2 * lower))
        x = reach * (1 - 0.07 * np.sin(np.pi * s)) * u + sway * np.sin(np.pi * u)
        out.append((np.clip(x, 0.0, reach), np.clip(z, -_DEEPEST_FOLD, _DEEPEST_FOLD)))
    return out


def radiator(kit: Kit, *, length: float | None = None) -> None:
    """A panel radiator with ribs and a grille, or a column radiator; valve and pipes to the floor side."""
    kit.mount = "wall"
    w, h = float(length or kit.near(1.0, 0.2)), 0.6
    white = kit.m("radiator")
    if kit.rng.random() < 0.5 or w > 1.4:
        kit.panel((-w / 2, 0.0, 0.03), (w / 2, h, 0.1), white, bevel=0.006)
        count = int(w / 0.036)
        for k in range(count):
            x = -w / 2 + 0.02 + (w - 0.04) * (k + 0.5) / count
            kit.panel((x - 0.009, 0.035, 0.1), (x + 0.009, h - 0.035, 0.106), white, bevel=0.003)
        for x in np.linspace(-w / 2 + 0.02, w / 2 - 0.02, max(6, int(w / 0.05))):
            kit.panel(
                (float(x) - 0.004, h, 0.036), (float(x) + 0.004, h + 0.003, 0.094), kit.m("black_metal"), bevel=0.0
            )
    else:
        count = max(4, round(w / 0.06))
        step = w / count
        for k in range(count):
            x = -w / 2 + (k + 0.5) * step
            for z in (0.055, 0.1):
                kit.rod((x, 0.02, z), (x, h - 0.02, z), 0.014, white, sides=8)
            kit.soft((step * 0.92, 0.055, 0.085), (x, 0.027, 0.078), white, radius=0.02, cells=2)
            kit.soft((step * 0.92, 0.055, 0.085), (x, h - 0.027, 0.078), white, radius=0.02, cells=2)
    for x in (-w / 2 + 0.1, w / 2 - 0.1):
        kit.panel((x - 0.015, 0.1, 0.0), (x + 0.015, h - 0.1, 0.032), white, bevel=0.0)
    kit.rod((w / 2 - 0.01, 0.05, 0.065), (w / 2 + 0.035, 0.05, 0.065), 0.011, kit.m("chrome"))
    kit.lathe(
        [(0.0, 0.0), (0.02, 0.0), (0.021, 0.05), (0.017, 0.06), (0.0, 0.061)],
        kit.m("plastic_white"),
        centre=(w / 2 + 0.035, 0.05, 0.065),
        segments=14,
        rotate=rotation("z", -90),
    )
    kit.rod((w / 2 + 0.03, 0.05, 0.065), (w / 2 + 0.03, -0.1, 0.065), 0.0085, kit.m("chrome"))
    kit.sound((-w / 2, 0.0, 0.03), (w / 2, h, 0.105), white)


def door_leaf(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A room door's leaf with lever handles on both sides, centred on its thickness; hinges on the left."""
    w, h, t = float(width or 0.82), float(height or 2.02), 0.04
    form = str(kit.palette.choose("door form", ("plain", "panels", "two", "lines")))
    skin, metal = kit.m("door"), kit.m("metal")
    with kit.grained("y"):
        if form in ("plain", "lines"):
            kit.panel((-w / 2, 0.0, -t / 2), (w / 2, h, t / 2), skin, bevel=0.003)
            if form == "lines":
                for y in (0.3, 0.5, 0.7):
                    for side in (-1, 1):
                        z0, z1 = sorted((side * t / 2, side * (t / 2 + 0.002)))
                        kit.panel(
                            (-w / 2 + 0.004, y * h - 0.005, z0), (w / 2 - 0.004, y * h + 0.005, z1), metal, bevel=0.0
                        )
        else:
            rail = 0.115
            splits = (0.0, 0.42, 1.0) if form == "panels" else (0.0, 0.36, 0.64, 1.0)
            kit.panel((-w / 2 + 0.02, 0.02, -t / 2 + 0.011), (w / 2 - 0.02, h - 0.02, t / 2 - 0.011), skin, bevel=0.0)
            for x0, x1 in ((-w / 2, -w / 2 + rail), (w / 2 - rail, w / 2)):
                kit.panel((x0, 0.0, -t / 2), (x1, h, t / 2), skin, bevel=0.006)
            with kit.grained("x"):
                for s in splits:
                    middle = min(max(s * h, 0.09), h - 0.06)
                    low, high = (0.0, 0.18) if s == 0 else (middle - 0.06, h if s == 1 else middle + 0.06)
                    kit.panel((-w / 2 + rail, low, -t / 2), (w / 2 - rail, high, t / 2), skin, bevel=0.006)
    for side in (-1, 1):
        x, z = w / 2 - 0.065, side * t / 2
        kit.cylinder(0.026, 0.008, (x, 1.03, z + side * 0.004), metal, axis="z", segments=18)
        kit.cylinder(0.02, 0.006, (x, 0.94, z + side * 0.003), metal, axis="z", segments=14)
        kit.tube(
            [
                (x, 1.03, z),
                (x, 1.03, z + side * 0.05),
                (x - 0.02, 1.03, z + side * 0.058),
                (x - 0.125, 1.03, z + side * 0.058),
            ],
            0.0095,
            metal,
            segments=8,
        )
    for y in (0.22, h - 0.22):
        kit.rod((-w / 2 - 0.003, y - 0.045, t / 2), (-w / 2 - 0.003, y + 0.045, t / 2), 0.008, metal, sides=8)
    kit.sound((-w / 2, 0.0, -t / 2), (w / 2, h, t / 2), skin)
