"""Forms that many small things share: printed labels and cartons, vessels from a profile, folded cloth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from generators.assets.forms import Array
from generators.assets.furniture.common import Kit, Point
from generators.assets.shapes import BOX_FACES
from generators.assets.textures.labels import LABEL_COLUMNS, LABEL_ROWS
from generators.core.scene import Material

#: Colours of small things (sRGB): glazed and painted things, plastic, glass, cloth, wood, leather.
GLAZES = ("#e4e0d6", "#c9b79c", "#7f9aa6", "#4f6d7a", "#b5654a", "#8a9a6b", "#d8b25a", "#3f4447")
PLASTICS = ("#e6e4df", "#d8d3c6", "#7fb3c8", "#3f7fa3", "#c65d4a", "#e0b94f", "#6f9b5c", "#b58fb0", "#404347")
GLASSES = ("#b9c8ca", "#6f8a5a", "#7a4a22", "#c9d6cf")
CLOTHS = ("#ded8cb", "#8c9ba5", "#7d3b35", "#4d5d52", "#c8a46a", "#35405a", "#b8b1a4", "#5a5148")
WOODS = ("#b98a56", "#8a5a34", "#d2b184", "#5f412b")
LEATHERS = ("#6f462e", "#2c2a29", "#8c6a45", "#4a3324")

#: Rows of the sheet of labels (`labels.label_sheet`): labels and cartons, papers.
_PRINTS, _PAPERS = range(LABEL_ROWS - 1), LABEL_ROWS - 1


def coloured(kit: Kit, role: str, codes: Sequence[str]) -> Material:
    """The plain material of a role in one of some colours."""
    return kit.palette.tinted(role, kit.pick(*codes))


def label_cell(kit: Kit, *, paper: bool = False) -> Array:
    """(2, 2) lower and upper corner (u, v) of one print on the sheet of labels."""
    row = _PAPERS if paper else int(kit.rng.integers(len(_PRINTS)))
    column = int(kit.rng.integers(LABEL_COLUMNS))
    low = np.array([column / LABEL_COLUMNS, 1 - (row + 1) / LABEL_ROWS])
    return np.stack([low, low + (1 / LABEL_COLUMNS, 1 / LABEL_ROWS)])


def carton(kit: Kit, low: Point, high: Point, *, cell: Array | None = None, rotate: Array | None = None) -> None:
    """A printed box between two corners (12 triangles): the print on its sides, the ground's colour above."""
    p, q = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    printed = label_cell(kit) if cell is None else cell
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
    triangles = corners[BOX_FACES]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    uv = np.empty((len(BOX_FACES), 3, 2))
    for k, (triangle, n) in enumerate(zip(triangles, normal, strict=True)):
        axis = int(np.argmax(np.abs(n)))
        across = triangle[:, 2 if axis == 0 else 0]
        if n[axis] * (-1 if axis == 0 else 1) < 0:
            across = 1 - across
        chart = np.stack([across, triangle[:, 1]], axis=1)
        # Lids show the plain rim of the print.
        uv[k] = printed[0] + (chart if axis != 1 else 0.02 + 0.01 * triangle[:, [0, 2]]) * (printed[1] - printed[0])
    size = q - p
    kit.add((corners - 0.5) * size, BOX_FACES, kit.m("labels"), uv=uv, centre=(p + q) / 2, rotate=rotate, crease=1.0)


def sheet(kit: Kit, corners: ArrayLike, *, paper: bool = True) -> None:
    """A printed or written sheet: ``corners`` (4, 3) counter-clockwise from its lower left."""
    cell = label_cell(kit, paper=paper)
    chart = np.array([cell[0], (cell[1, 0], cell[0, 1]), cell[1], (cell[0, 0], cell[1, 1])])
    index = np.array([[0, 1, 2], [0, 2, 3]])
    kit.add(np.asarray(corners, dtype=np.float64), index, kit.m("labels"), uv=chart[index])


def banded(kit: Kit, radius: float, low: float, high: float, at: Point = (0.0, 0.0, 0.0), segments: int = 14) -> None:
    """A label round a vessel: an open cylinder that shows one print twice."""
    cell = label_cell(kit)
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.stack([radius * np.sin(angle), np.zeros_like(angle), radius * np.cos(angle)], axis=1)
    vertices = np.concatenate([ring + (0.0, low, 0.0), ring + (0.0, high, 0.0)])
    k = np.arange(segments)
    faces = np.concatenate(
        [np.stack([k, k + 1, k + segments + 2], axis=1), np.stack([k, k + segments + 2, k + segments + 1], axis=1)]
    )
    # Each half turn shows the whole print, mirrored at the seam so that it does not jump.
    half = 1 - np.abs(np.linspace(-1, 1, segments + 1))
    chart = np.concatenate([np.stack([half, np.zeros_like(half)], 1), np.stack([half, np.ones_like(half)], 1)])
    kit.add(vertices, faces, kit.m("labels"), uv=(cell[0] + chart * (cell[1] - cell[0]))[faces], centre=at)


def vessel(
    kit: Kit,
    outline: ArrayLike,
    radius: float,
    height: float,
    material: Material,
    *,
    at: Point = (0.0, 0.0, 0.0),
    segments: int = 14,
) -> None:
    """A turned body: ``outline`` (N, 2) of radius and height as shares of ``radius`` and ``height``, bottom to top."""
    kit.lathe(np.asarray(outline) * (radius, height), material, centre=at, segments=segments)


#: Outlines of vessels, as shares of their greatest radius and their height.
BOTTLE = ((0, 0), (0.93, 0), (1, 0.02), (1, 0.58), (0.85, 0.68), (0.36, 0.78), (0.33, 0.97), (0, 0.97))
SQUAT_BOTTLE = ((0, 0), (0.92, 0), (1, 0.03), (1, 0.72), (0.7, 0.86), (0.4, 0.9), (0.4, 0.97), (0, 0.97))
CAN = ((0, 0), (0.94, 0), (0.97, 0.02), (0.97, 0.98), (0.94, 1), (0.9, 0.985), (0, 0.985))
JAR = ((0, 0), (0.9, 0), (1, 0.05), (1, 0.8), (0.86, 0.9), (0.86, 0.94), (0, 0.94))
CUP = ((0, 0), (0.72, 0), (0.86, 0.1), (1, 1), (0.9, 1), (0.76, 0.14), (0, 0.12))
MUG = ((0, 0), (0.88, 0), (0.95, 0.06), (1, 1), (0.9, 1), (0.86, 0.12), (0, 0.1))
BOWL = ((0, 0), (0.45, 0), (0.72, 0.22), (0.92, 0.62), (1, 1), (0.95, 1), (0.85, 0.6), (0.62, 0.26), (0, 0.14))
POT = ((0, 0), (0.92, 0), (1, 0.06), (1, 1), (0.95, 1), (0.93, 0.1), (0, 0.08))
TUMBLER = ((0, 0), (0.84, 0), (0.88, 0.03), (1, 1), (0.95, 1), (0.83, 0.08), (0, 0.07))


def lid(kit: Kit, radius: float, low: float, high: float, material: Material, at: Point = (0.0, 0.0, 0.0)) -> None:
    """A screw cap or lid."""
    x, y, z = (float(c) for c in at)
    kit.cylinder(radius, high - low, (x, y + (low + high) / 2, z), material, segments=12)


@dataclass(frozen=True)
class Turned:
    """Builder of a turned thing (bottle, jar, pot) as a row of numbers; lengths in metres.

    Attributes:
        outline: (N, 2) of radius and height, as shares of the two.
        radius, height: ranges of the greatest radius and of the height without the cap.
        role, codes: its material's role, and the colours to choose from.
        label: where on its height the label begins and ends (shares); None: it has none.
        cap: radius of the cap (share of the radius) and its height (m); None: open, or closed by the body itself.
        cap_role, cap_codes: as ``role`` and ``codes``, of the cap.
        squash: depth as a share of the width: below 1 for flat bottles.
    """

    outline: tuple[tuple[float, float], ...]
    radius: tuple[float, float]
    height: tuple[float, float]
    role: str
    codes: tuple[str, ...]
    label: tuple[float, float] | None = None
    cap: tuple[float, float] | None = None
    cap_role: str = "plastic_white"
    cap_codes: tuple[str, ...] = PLASTICS
    squash: float = 1.0

    def __call__(self, kit: Kit) -> None:
        """Build one."""
        r, h = float(kit.rng.uniform(*self.radius)), float(kit.rng.uniform(*self.height))
        flat = (1.0, 1.0, self.squash)
        kit.lathe(
            np.asarray(self.outline) * (r, h),
            coloured(kit, self.role, self.codes),
            segments=14,
            scale=flat,
            crease=50.0,
        )
        if self.label is not None:
            band = Kit(kit.palette, kit.rng)
            banded(band, r * 1.012, self.label[0] * h, self.label[1] * h)
            kit.merge(band.build(), rotate=np.diag(flat))
        if self.cap is not None:
            lid(kit, r * self.cap[0], 0.96 * h, h + self.cap[1], coloured(kit, self.cap_role, self.cap_codes))


def folded(kit: Kit, size: Point, at: Point, material: Material, *, rotate: Array | None = None) -> None:
    """A folded piece of cloth lying at ``at`` (middle of its lower side)."""
    x, y, z = (float(c) for c in at)
    w, h, d = (float(c) for c in size)
    kit.soft((w, h, d), (x, y + h / 2, z), material, radius=0.45 * h, cells=2, rotate=rotate)


def hanging(
    kit: Kit, width: float, top: float, drop: float, z: float, material: Material, *, pinch: float = 1.0
) -> None:
    """A cloth that hangs before the wall from ``top``; ``pinch`` is its width at the top as a share of ``width``."""
    u = np.linspace(-0.5, 0.5, 7)
    phase = float(kit.rng.uniform(0, 6))
    rows = []
    for t in np.linspace(0.0, 1.0, 5):
        wide = width * (pinch + (1 - pinch) * min(1.0, 1.6 * t))
        fold = (0.004 + 0.008 * (1 - pinch)) * np.sin(11 * u + phase + t) * (0.3 + t)
        depth = z + 0.4 * np.abs(fold) + 0.012 * (1 - pinch) * (1 - 2 * np.abs(u))
        rows.append(np.stack([wide * u, np.full(7, top - drop * t), depth], axis=1))
    kit.shell(np.array(rows), 0.006, material)
