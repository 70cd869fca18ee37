"""Front-loading washing machines: a round port with a glass bowl in a ring, drawer, programme knob, display."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from generators.assets.forms import housing_loops
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import chrome, enamel, plastic, printed, rubber
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material, Texture


@dataclass(frozen=True)
class _Style:
    """Parameters in which washing machines differ; sizes in metres, colours sRGB."""

    body: str
    panel: str
    ink: str
    ring: str
    brand: str
    depth: float
    port_radius: float
    port_height: float
    knob_x: float
    knob: str
    drawer_x: float | None
    display: str


WIDTH, HEIGHT = 0.60, 0.85
PANEL = 0.125


def _bowl_texture(rng: Generator) -> Material:
    """The glass bowl in polar coordinates (u round, v from the rim to the middle): the drum's holes, a sheen."""
    width, height = 512, 160
    v, u = np.mgrid[0:height, 0:width]
    inwards = 1 - v / height  # 0 at the rim
    angle = 2 * np.pi * u / width
    shade = 20 + 34 * np.exp(-(((inwards - 0.62) / 0.25) ** 2))
    pixels = np.repeat(shade[..., None], 3, axis=2)
    canvas = decals.DecalCanvas(width, height, "#000000")
    for ring, at in enumerate(np.linspace(0.42, 0.86, 6)):
        count = round(64 * (1 - at * 0.75))
        for k in range(count):
            x = (k + 0.5 * (ring % 2)) * width / count
            canvas.disc((x, (1 - at) * height), 2.6, "#ffffff")
    start = float(rng.uniform(20, 150))
    for k in range(3):  # the lifters
        x = k * width / 3 + start
        canvas.box((x - 13, 0.16 * height), (x + 13, 0.56 * height), "#bbbbbb", radius=6)
    holes = canvas.pixels().astype(np.float64) / 255
    pixels = pixels * (1 - 0.75 * holes) + 12 * (holes > 0.6) * (holes < 0.85)
    # Reflection of a bright window, upper left (u = 0 is at the bottom of the port), and a weak one opposite.
    for centre, spread, depth, amount in ((0.63, 0.055, 0.30, 150), (0.16, 0.05, 0.22, 60)):
        near = np.exp(-((((u / width) - centre) / spread) ** 4)) * np.exp(-(((inwards - depth) / 0.13) ** 4))
        pixels += (amount * near)[..., None] * np.array([0.93, 0.98, 1.05])
    pixels += (10 * (1 + np.cos(angle - np.pi)))[..., None] * 0.6
    return Material("port_glass", "glass", texture=Texture("port_glass", _bytes(pixels)), roughness=0.02)


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _panel(style: _Style, minutes: int) -> np.ndarray:
    """The print of the control panel, 1024 px for its 0.6 m."""
    height = round(1024 * PANEL / WIDTH)
    canvas = decals.DecalCanvas(1024, height, style.panel)
    scale = 1024 / WIDTH
    x = (style.knob_x + WIDTH / 2) * scale
    y = height / 2
    labels = ("COTTON", "ECO", "SYNTH", "WOOL", "RINSE", "SPIN", "QUICK", "SPORT", "JEANS", "BABY")
    for k, label in enumerate(labels):
        angle = 2 * np.pi * (k + 0.5) / len(labels)
        canvas.ray((x, y), np.degrees(angle), 68, 76, style.ink, 3)
        side = 1 if np.sin(angle) > 0 else -1
        canvas.text((x + 112 * side, y - 80 * np.cos(angle)), label, 15, style.ink)
    canvas.disc((x, y), 62, None, outline=style.ink, width=1.5)
    left = x + 190 if style.knob_x < 0.1 else x - 440
    canvas.box((left, y - 36), (left + 170, y + 30), "#05090b", radius=8)
    canvas.digits((left + 85, y - 3), f"{minutes // 60}:{minutes % 60:02d}", 42, style.display, "#10191b")
    for k in range(4):
        canvas.text((left + 24 + 41 * k, y + 80), ("TEMP", "RPM", "DELAY", "START")[k], 12, style.ink)
    if style.drawer_x is None:
        canvas.text((118, y), style.brand, 30, style.ink, bold=0.6)
    return canvas.pixels()


def _drawer(style: _Style) -> np.ndarray:
    canvas = decals.DecalCanvas(360, 220, style.panel)
    canvas.text((180, 66), style.brand, 40, style.ink, bold=0.8)
    canvas.text((180, 186), "I   II   *", 18, style.ink)
    return canvas.pixels()


def _front_loader(style: _Style, rng: Generator) -> Design:
    b = MeshBuilder()
    body = enamel("body_enamel", style.body)
    face = style.depth / 2
    shell = HEIGHT - 0.028
    port = (0.0, style.port_height - (0.02 + shell) / 2)
    radius = style.port_radius
    b.loft(
        housing_loops((WIDTH, shell - 0.02, style.depth), port, radius, 0.02),
        body,
        caps="first",
        centre=(0, (0.02 + shell) / 2, 0),
    )
    _frame(b, style, body, shell)
    gap = plastic("gap_line", "#3a3c3f")
    panel_y = shell - PANEL / 2 - 0.004
    b.box((WIDTH - 0.012, 0.003, 0.002), (0, panel_y - PANEL / 2, face), gap, acoustic=False)
    b.box((WIDTH - 0.012, 0.003, 0.002), (0, 0.115, face), gap, acoustic=False)
    b.slab((0.085, 0.07, 0.006), (0.21, 0.066, face + 0.002), body, corner=0.012, bevel=0.003)
    b.box((0.05, 0.008, 0.004), (0.21, 0.092, face + 0.004), gap, acoustic=False)

    _controls(b, style, rng, panel_y)
    if style.drawer_x is not None:
        _detergent_drawer(b, style, style.drawer_x, panel_y, gap)
    _door(b, style, rng)
    # In front of the lower edge of the door, where the drum is loudest through its gasket.
    return Design(b.build(), "floor", (0.0, style.port_height - radius - 0.01, face + 0.055))


def _door(b: MeshBuilder, style: _Style, rng: Generator) -> None:
    """Ring, gasket, bowl, hinge on the left and grip on the right."""
    face, radius = style.depth / 2, style.port_radius
    # Lathe profiles run (radius, towards the room); u starts at the port's bottom.
    centre = (0.0, style.port_height, face)
    turn_z = rotation("x", 90)
    ring = chrome("door_ring") if style.ring == "chrome" else plastic("door_ring", style.ring, roughness=0.25)
    outer = radius + 0.052
    b.lathe(
        [(outer, -0.001), (outer, 0.016), (outer - 0.006, 0.026), (outer - 0.020, 0.034), (radius - 0.002, 0.037)],
        ring,
        centre=centre,
        rotate=turn_z,
        segments=64,
        acoustic=False,
    )
    trim = plastic("door_trim", "#2a2c2f", roughness=0.25)
    b.lathe(
        [(radius - 0.002, 0.037), (radius - 0.008, 0.039), (radius - 0.020, 0.034), (radius - 0.026, 0.020)],
        trim,
        centre=centre,
        rotate=turn_z,
        segments=64,
        acoustic=False,
    )
    depth = 0.095
    t = np.linspace(0, 1, 11)
    bowl_radius = (radius - 0.026) * np.cos(t * np.pi / 2) ** 0.6
    bowl_z = 0.020 - depth * np.sin(t * np.pi / 2) ** 1.2
    profile = np.stack([np.maximum(bowl_radius, 0.0), bowl_z], axis=1)
    bowl_material = _bowl_texture(rng)
    length = float(np.linalg.norm(np.diff(profile, axis=0), axis=1).sum())
    _polar_lathe(b, profile, bowl_material, centre, turn_z, length)
    b.lathe(
        [(radius + 0.001, -0.021), (radius - 0.030, -0.020), (radius - 0.030, 0.021)],
        rubber("gasket", "#55585c"),
        centre=centre,
        rotate=turn_z,
        segments=48,
        acoustic=False,
    )
    # Hinge on the left, grip on the right.
    b.box((0.03, 0.11, 0.02), (-outer + 0.004, style.port_height, face + 0.009), ring, bevel=0.005, acoustic=False)
    grip = plastic("grip", "#1f2022", roughness=0.25)
    b.slab((0.028, 0.13, 0.012), (radius + 0.026, style.port_height, face + 0.034), grip, corner=0.013, bevel=0.004)


def _detergent_drawer(b: MeshBuilder, style: _Style, x: float, panel_y: float, gap: Material) -> None:
    """The front of the detergent drawer about (``x``, ``panel_y``), with its print and grip."""
    face = style.depth / 2
    drawer = plastic("drawer", style.panel)
    size = (0.165, PANEL - 0.022)
    b.slab((*size, 0.012), (x, panel_y, face + 0.004), drawer, corner=0.008, bevel=0.004)
    dx, dy = size[0] / 2 - 0.006, size[1] / 2 - 0.006
    at = [(x + sx * dx, panel_y + sy * dy, face + 0.0112) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(at, printed("drawer_print", _drawer(style)), fit=True, acoustic=False)
    b.slab((0.11, 0.020, 0.004), (x, panel_y - 0.012, face + 0.0105), gap, corner=0.009, bevel=0.001)


def _controls(b: MeshBuilder, style: _Style, rng: Generator, panel_y: float) -> None:
    """The printed control panel at height ``panel_y`` (m), the programme knob and four buttons."""
    face = style.depth / 2
    minutes = int(rng.integers(35, 170))
    print_ = printed("control_panel", _panel(style, minutes), acoustic="plastic")
    w, h = (WIDTH - 0.026) / 2, PANEL / 2 - 0.006
    corners = [(-w, panel_y - h, 0), (w, panel_y - h, 0), (w, panel_y + h, 0), (-w, panel_y + h, 0)]
    b.quad([(x, y, face + 0.0025) for x, y, _ in corners], print_, fit=True, acoustic=False)
    knob = chrome("knob_chrome") if style.knob == "chrome" else plastic("knob", style.knob)
    b.cylinder(0.034, 0.012, (style.knob_x, panel_y, face + 0.008), chrome(), axis="z", bevel=0.003, acoustic=False)
    b.cylinder(
        0.029,
        0.026,
        (style.knob_x, panel_y, face + 0.018),
        knob,
        axis="z",
        top_radius=0.026,
        bevel=0.004,
        acoustic=False,
    )
    turn = rotation("z", float(rng.integers(10)) * 36 - 18)
    pointer = plastic("pointer", "#d0342c")
    b.box(
        (0.004, 0.017, 0.002),
        np.array([style.knob_x, panel_y, face + 0.0315]) + turn @ np.array([0, 0.014, 0]),
        pointer,
        rotate=turn,
        acoustic=False,
    )
    buttons = plastic("buttons", "#e9eaec" if style.panel < "#8" else "#c9cccf")
    start = style.knob_x + (190 / 1024 * WIDTH if style.knob_x < 0.1 else -440 / 1024 * WIDTH)
    for k in range(4):
        b.cylinder(
            0.0085,
            0.008,
            (start + (24 + 41 * k) / 1024 * WIDTH, panel_y - 0.031, face + 0.004),
            buttons,
            axis="z",
            segments=20,
            bevel=0.002,
            acoustic=False,
        )


def _frame(b: MeshBuilder, style: _Style, body: Material, shell: float) -> None:
    """Worktop, feet, and the shadow gap below the worktop; ``shell``: height of the case (m)."""
    face = style.depth / 2
    b.box((WIDTH, 0.026, style.depth + 0.012), (0, HEIGHT - 0.013, 0.0), body, bevel=0.008, acoustic=False)
    b.box((WIDTH - 0.006, 0.006, style.depth - 0.004), (0, shell + 0.001, 0), rubber("gap"), acoustic=False)
    foot = rubber("foot")
    for x in (-0.25, 0.25):
        for z in (-face + 0.06, face - 0.06):
            b.cylinder(0.022, 0.022, (x, 0.011, z), foot, segments=16, acoustic=False)


def _polar_lathe(
    b: MeshBuilder,
    profile: np.ndarray,
    material: Material,
    centre: tuple[float, float, float],
    turn: np.ndarray,
    length: float,
) -> None:
    """A lathe whose texture covers it once: u round the axis, v along the profile from 1 (start) to 0 (end)."""
    segments = 64
    line = np.asarray(profile)
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    vertices = np.stack(
        [line[:, :1] * np.sin(angle), np.repeat(line[:, 1:], segments, axis=1), line[:, :1] * np.cos(angle)], axis=2
    ).reshape(-1, 3)
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(len(line) - 1), np.arange(segments), indexing="ij"))
    n = (j + 1) % segments
    a, c, d, e = i * segments + j, i * segments + n, (i + 1) * segments + n, (i + 1) * segments + j
    along = 1 - np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]) / length
    faces = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, e], axis=1)])
    cu = np.stack([j, j + 1, j + 1, j], axis=1) / segments
    cv = along[np.stack([i, i, i + 1, i + 1], axis=1)]
    corner = np.stack([cu, cv], axis=2)
    uv = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]])
    b.add(vertices, faces, material, centre=centre, rotate=turn, uv=uv, acoustic=False)


WHITE = _Style(
    "#f2f3f2", "#f2f3f2", "#3c4044", "chrome", "LAVANDA", 0.56, 0.165, 0.43, 0.0, "#dfe1e3", -0.20, "#6fe3ff"
)
GRAPHITE = _Style(
    "#4a4d52", "#2b2d31", "#d7dadd", "#1a1b1d", "NORDEN", 0.58, 0.18, 0.42, 0.0, "chrome", -0.20, "#ffffff"
)
SLIM = _Style("#b3b8bc", "#d9dcde", "#22262a", "#26282b", "ondina", 0.45, 0.17, 0.44, 0.19, "chrome", -0.20, "#ff9c4a")

VARIANTS: dict[str, Build] = {
    "white": lambda rng: _front_loader(WHITE, rng),
    "graphite": lambda rng: _front_loader(GRAPHITE, rng),
    "slim": lambda rng: _front_loader(SLIM, rng),
}
