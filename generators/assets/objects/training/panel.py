"""Control panels: a printed face with knobs, keys and displays, on a plane of any direction."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from generators.assets.modelframe import before_front, clear_of_twin
from generators.assets.objects import decals
from generators.assets.objects.design import Design, Mount, Point
from generators.assets.objects.finishes import Pixels, plastic, printed, rubber
from generators.assets.objects.training.draw import (
    GLOWS,
    between,
    brightness,
    clock_time,
    ink_on,
    pilot,
    tone,
    trim,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.rays import RayCaster
from generators.core.scene import Material, Mesh

Array = NDArray[np.float64]
XY = tuple[float, float]
#: Resolution of prints (pixels per metre), and the longest side of a print (pixels).
DENSITY, MOST_PIXELS = 1600.0, 900
#: Distance of a print from the surface under it (m).
LIFT = 0.0008
#: Distance of a sound source from the surface behind it (m).
GAP = 0.03


def paste(
    b: MeshBuilder,
    pixels: Pixels,
    centre: ArrayLike,
    size: XY,
    *,
    name: str,
    turn: Array | None = None,
    acoustic: str = "plastic",
) -> None:
    """A picture of ``size`` (m) about ``centre``, which faces +Z turned by ``turn``."""
    way = np.eye(3) if turn is None else turn
    w, h = size[0] / 2, size[1] / 2
    corners = [np.asarray(centre) + way @ [sx * w, sy * h, 0.0] for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    roughness = 0.04 if acoustic == "glass" else 0.49
    b.quad(corners, printed(name, pixels, acoustic=acoustic, roughness=roughness), fit=True, acoustic=False)


def finished(b: MeshBuilder, mount: Mount, level: float) -> Design:
    """The design of what ``b`` holds; its sound leaves in front of the share ``level`` of its height."""
    mesh = b.build()
    return _sounding(mesh, mount, before_front(mesh, level))


def finished_at(b: MeshBuilder, mount: Mount, x: float, y: float) -> Design:
    """The design of what ``b`` holds; its sound leaves in front of the first surface at (``x``, ``y``), in metres.

    For products whose middle is not the middle of their bounding box.
    """
    mesh = b.build()
    distance, _ = RayCaster(mesh.positions).closest([[x, y, 10.0]], [[0.0, 0.0, -1.0]])
    if not np.isfinite(distance[0]):
        raise ValueError(f"a family has no surface at x = {x:.3f}, y = {y:.3f}: choose a point on its front")
    return _sounding(mesh, mount, (x, y, 10.0 - float(distance[0]) + GAP))


def _sounding(mesh: Mesh, mount: Mount, point: Point) -> Design:
    return Design(clear_of_twin(mesh, point), mount, point)


class Panel:
    """A flat face of a product; local x to the right, y up, z out of it, metres from its centre.

    Args:
        b: receives the parts.
        rng: draws the style of the knobs and keys.
        centre: (3,) of the face.
        size: width and height (m).
        colour: of the print's ground (sRGB).
        turn: (3, 3) from local to model axes.
        name: of the print's material; begins the names of the others.
    """

    def __init__(
        self,
        b: MeshBuilder,
        rng: Generator,
        centre: ArrayLike,
        size: XY,
        colour: str,
        turn: Array | None = None,
        name: str = "panel",
    ) -> None:
        self.b, self.rng, self.size, self.colour, self.name = b, rng, size, colour, name
        self.centre = np.asarray(centre, dtype=np.float64)
        self.turn = np.eye(3) if turn is None else turn
        self.scale = min(DENSITY, MOST_PIXELS / max(size))
        pixels = [max(8, round(side * self.scale)) for side in size]
        self.canvas = decals.DecalCanvas(pixels[0], pixels[1], colour)
        self.ink = ink_on(colour)
        self.glow = tone(rng, *GLOWS, spread=0.02)
        self.knob_trim = trim(rng, f"{name}_knob")
        self.knob_ring = trim(rng, f"{name}_ring")
        self.mark = plastic(f"{name}_mark", tone(rng, "#d0342c", "#f0f0f0", "#1d1e20", "#e6a32a"))
        self.knob_kind = int(rng.integers(4))
        self.knob_taper = between(rng, 0.78, 1.0)
        pale = brightness(colour) > 0.5
        self.key_colour = tone(rng, *(("#d6d8d9", "#3c3f43", "#f4f4f2") if pale else ("#2f3236", "#e6e7e8", "#8b8f93")))

    def at(self, x: float, y: float, z: float = 0.0) -> Array:
        """A local point in the model's axes."""
        return np.asarray(self.centre + self.turn @ np.array([x, y, z]))

    def px(self, x: float, y: float) -> XY:
        """A local point on the print."""
        return self.canvas.width / 2 + x * self.scale, self.canvas.height / 2 - y * self.scale

    def text(self, x: float, y: float, text: str, height: float, ink: str | None = None) -> None:
        """``text`` of letters about ``height`` metres high."""
        self.canvas.text(self.px(x, y), text, height * self.scale, ink or self.ink, bold=0.3)

    def display(self, x: float, y: float, size: XY, text: str | None = None) -> None:
        """A lit display with a time or ``text``."""
        (cx, cy), w, h = self.px(x, y), size[0] * self.scale / 2, size[1] * self.scale / 2
        self.canvas.box((cx - w, cy - h), (cx + w, cy + h), "#06090b", radius=0.15 * h)
        digits = clock_time(self.rng) if text is None else text
        high = min(1.2 * h, 2 * w / (0.85 * len(digits)))
        self.canvas.digits((cx, cy), digits, high, self.glow, "#11181a")

    def knob(self, x: float, y: float, radius: float, height: float = 0.02, *, labels: int = 0) -> None:
        """A turning knob with ticks around it and a mark at a random angle."""
        axle = self.turn @ rotation("x", 90)
        ticks = int(self.rng.integers(5, 15))
        for k in range(ticks):
            angle = -135 + 270 * k / (ticks - 1)
            self.canvas.ray(self.px(x, y), angle, 1.2 * radius * self.scale, 1.38 * radius * self.scale, self.ink, 2.0)
        for k in range(labels):
            a = np.radians(-120 + 240 * k / max(1, labels - 1))
            self.text(x + 1.75 * radius * np.sin(a), y + 1.75 * radius * np.cos(a), str(k), 0.4 * radius)
        top = radius * self.knob_taper
        edge = 0.12 * radius
        if self.knob_kind in (1, 3):
            ring = [
                (1.16 * radius, -0.002),
                (1.16 * radius, 0.15 * height),
                (1.05 * radius, 0.25 * height),
                (0, 0.25 * height),
            ]
            self.b.lathe(ring, self.knob_ring, centre=self.at(x, y), rotate=axle, segments=28, acoustic=False)
        profile = [(radius, -0.002), (top, height - edge), (top - edge, height), (0.0, height)]
        self.b.lathe(profile, self.knob_trim, centre=self.at(x, y), rotate=axle, segments=28, acoustic=False)
        turn = self.turn @ rotation("z", between(self.rng, -135, 135))
        if self.knob_kind >= 2:
            middle = self.at(x, y, height + 0.1 * radius)
            size = (0.26 * radius, 1.8 * top, 0.35 * radius)
            self.b.box(size, middle, self.knob_trim, rotate=turn, bevel=0.05 * radius, acoustic=False)
            tip = self.at(x, y, height + 0.29 * radius) + turn @ [0.0, 0.5 * top, 0.0]
        else:
            tip = self.at(x, y, height + 0.0008) + turn @ [0.0, 0.55 * top, 0.0]
        self.b.box((0.12 * radius, 0.6 * top, 0.0015), tip, self.mark, rotate=turn, acoustic=False)

    def keys(
        self, x: float, y: float, grid: tuple[int, int], pitch: XY, labels: str = "", *, raised: bool = True
    ) -> None:
        """``grid`` columns × rows of keys, ``pitch`` metres apart, with one character each from ``labels``."""
        columns, rows = grid
        w, h = 0.8 * pitch[0], 0.8 * pitch[1]
        key = plastic(f"{self.name}_key", self.key_colour)
        ink = ink_on(self.key_colour)
        high = min(0.25 * min(w, h), 0.006)
        for k in range(columns * rows):
            kx, ky = x + (k % columns - (columns - 1) / 2) * pitch[0], y + ((rows - 1) / 2 - k // columns) * pitch[1]
            label = labels[k] if k < len(labels) else ""
            if raised:
                corner = 0.45 * min(w, h) if self.knob_kind % 2 else 0.2 * min(w, h)
                self.b.slab(
                    (w, h, 2 * high),
                    self.at(kx, ky),
                    key,
                    corner=corner,
                    bevel=0.4 * high,
                    steps=2,
                    rotate=self.turn,
                )
                if label:
                    picture = decals.DecalCanvas(36, 36, self.key_colour)
                    picture.text((18, 18), label, 30, ink, bold=0.4)
                    side = 0.62 * min(w, h)
                    paste(
                        self.b,
                        picture.pixels(),
                        self.at(kx, ky, high + 0.0005),
                        (side, side),
                        name=f"{self.name}_{k}",
                        turn=self.turn,
                    )
                continue
            cx, cy = self.px(kx, ky)
            a, c = w * self.scale / 2, h * self.scale / 2
            self.canvas.box((cx - a, cy - c), (cx + a, cy + c), self.key_colour, radius=0.25 * min(a, c))
            if label:
                self.canvas.text((cx, cy), label, 1.3 * c, ink)

    def lamp(self, x: float, y: float, radius: float = 0.004) -> None:
        """A pilot light."""
        profile = [(radius, -0.001), (radius, 0.001), (0.0, 0.6 * radius + 0.001)]
        material = pilot(self.rng, f"{self.name}_lamp")
        self.b.lathe(
            profile, material, centre=self.at(x, y), rotate=self.turn @ rotation("x", 90), segments=10, acoustic=False
        )

    def grille(self, x: float, y: float, size: XY, pitch: float = 0.006) -> None:
        """Printed rows of small dark holes."""
        for gx in np.arange(-size[0] / 2, size[0] / 2 + 1e-6, pitch):
            for gy in np.arange(-size[1] / 2, size[1] / 2 + 1e-6, pitch):
                self.canvas.disc(self.px(x + gx, y + gy), 0.28 * pitch * self.scale, "#101112")

    def close(self, acoustic: str = "plastic") -> None:
        """Add the print, after everything is drawn on it."""
        paste(
            self.b,
            self.canvas.pixels(),
            self.at(0, 0, LIFT),
            self.size,
            name=self.name,
            turn=self.turn,
            acoustic=acoustic,
        )


def grip(b: MeshBuilder, ends: tuple[ArrayLike, ArrayLike], reach: float, radius: float, material: Material) -> None:
    """A bar handle between two points of a front, standing off it by ``reach`` metres along +Z."""
    first, last = (np.asarray(end, dtype=np.float64) for end in ends)
    out = np.array([0.0, 0.0, reach])
    along = (last - first) * 0.06
    path = [first, first + 0.8 * out, first + along + out, last - along + out, last + 0.8 * out, last]
    b.tube(path, radius, material, segments=12)


def feet(b: MeshBuilder, size: XY, radius: float, height: float) -> None:
    """Four feet under a case of ``size`` (width, depth; m)."""
    foot = rubber("foot")
    for x in (-1, 1):
        for z in (-1, 1):
            at = (x * (size[0] / 2 - 1.8 * radius), height / 2, z * (size[1] / 2 - 1.8 * radius))
            b.cylinder(radius, height, at, foot, segments=12, acoustic=False)
