"""Small things: books, papers and post.

Each builder adds one thing to an empty `Kit`: standing or lying on y = 0 about the origin, its front towards +Z.
"""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import book, book_pile
from generators.assets.materials import PICTURES
from generators.assets.shapes import rotation
from generators.assets.textures.pictures import SPINES
from generators.core.scene import Material

#: Width and height of a sheet of paper (ISO 216 A4) and of a page of a book (m).
A4 = (0.21, 0.297)
PAGE = (0.15, 0.215)


def sheet(
    kit: Kit,
    size: tuple[float, float],
    thick: float,
    side: Material,
    top: Material,
    *,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    turn: float = 0.0,
) -> None:
    """A flat box lying at ``at``, turned by ``turn`` degrees, whose upper face shows the whole texture of ``top``."""
    w, d = size[0] / 2, size[1] / 2
    yaw = rotation("y", turn)
    place = np.asarray(at, dtype=np.float64)
    low = np.array([(-w, 0.0, d), (w, 0.0, d), (w, 0.0, -d), (-w, 0.0, -d)])
    high = low + (0.0, thick, 0.0)
    ring = np.concatenate([low, high]) @ yaw.T + place
    sides = [
        [0, 1, 5],
        [0, 5, 4],
        [1, 2, 6],
        [1, 6, 5],
        [2, 3, 7],
        [2, 7, 6],
        [3, 0, 4],
        [3, 4, 7],
        [3, 2, 1],
        [3, 1, 0],
    ]
    kit.add(ring, np.array(sides), side, uv=None if side.texture is None else np.zeros((len(sides), 3, 2)))
    kit.cloth_quad(ring[4:], top)


def standing_books(kit: Kit) -> None:
    """Three to seven books side by side; the last one leans against the others."""
    x = -0.11
    count = int(kit.rng.integers(3, 8))
    tall = 0.2
    for _ in range(count):
        thick, tall = float(kit.rng.uniform(0.014, 0.042)), float(kit.rng.uniform(0.17, 0.26))
        deep = float(kit.rng.uniform(0.12, 0.165))
        cell = int(kit.rng.integers(SPINES[0] * SPINES[1]))
        book(kit, (x, 0.0, 0.08 - deep), (x + thick - 0.0006, tall, 0.08), cell)
        x += thick
    lean = float(kit.rng.uniform(9, 17))
    thick, high = float(kit.rng.uniform(0.014, 0.03)), tall * float(kit.rng.uniform(0.85, 1.0))
    leaning = Kit(kit.palette, kit.rng)
    cell = int(kit.rng.integers(SPINES[0] * SPINES[1]))
    book(leaning, (0.0, 0.0, -0.14), (thick, high, 0.0), cell)
    # It touches the row with its upper left edge and the board with its lower left edge.
    shift = x + high * np.sin(np.radians(lean)) + 0.0005
    kit.merge(leaning.build(), centre=(shift, 0.0, 0.075), rotate=rotation("z", lean))


def lying_books(kit: Kit) -> None:
    """Two to five books lying on each other, each turned a little."""
    book_pile(kit, 0.0, 0.0, 0.0, int(kit.rng.integers(2, 6)))


def open_book(kit: Kit) -> None:
    """A book lying open: two blocks of pages that bend into the spine, on its covers."""
    w, d = PAGE
    cover, paper, page = kit.m(kit.pick("tone_0", "tone_1", "tone_2")), kit.m("paper"), kit.m("page")
    kit.panel((-w - 0.004, 0.0, -d / 2 - 0.003), (w + 0.004, 0.003, d / 2 + 0.003), cover, bevel=0.0)
    u = np.linspace(0.0, 1.0, 7)
    share = float(kit.rng.uniform(0.3, 0.7))
    for side, thick in ((-1, 0.024 * share), (1, 0.024 * (1 - share))):
        rise = 0.0032 + (0.004 + thick) * np.sin(np.pi * np.clip(u * 0.9 + 0.06, 0, 1)) ** 0.5 * (1 - 0.35 * u)
        x = side * u * w
        rim = np.concatenate([np.stack([x, rise], axis=1), np.stack([x[::-1], np.full(7, 0.0031)], axis=1)])
        loops = np.stack([np.concatenate([rim, np.full((14, 1), z)], axis=1) for z in (-d / 2, d / 2)])
        kit.loft(loops if side > 0 else loops[::-1], paper, crease=25.0)
        top = np.stack([np.stack([x, rise + 0.0006, np.full(7, z)], axis=1) for z in (d / 2, -d / 2)])
        if side < 0:
            top = top[:, ::-1]
        _fitted(kit, top, page)


def _fitted(kit: Kit, grid: np.ndarray, material: Material) -> None:
    """A grid of points (2, C, 3), lower row first from left to right, that shows a texture once."""
    count = grid.shape[1]
    a = np.arange(count - 1)
    b = a + count
    faces = np.concatenate([np.stack([a, a + 1, b + 1], axis=1), np.stack([a, b + 1, b], axis=1)])
    t = np.linspace(0, 1, count)
    chart = np.concatenate([np.stack([t, np.zeros(count)], axis=1), np.stack([t, np.ones(count)], axis=1)])
    kit.add(grid.reshape(-1, 3), faces, material, uv=chart[faces])


def magazines(kit: Kit) -> None:
    """Two to five magazines, each turned a little; the uppermost shows its cover."""
    y, count = 0.0, int(kit.rng.integers(2, 6))
    heading = float(kit.rng.uniform(-12, 12))
    for k in range(count):
        thick = float(kit.rng.uniform(0.004, 0.008))
        cover = kit.m(f"picture_{int(kit.rng.integers(PICTURES))}") if k == count - 1 else kit.m("paper")
        at = (float(kit.rng.uniform(-0.012, 0.012)), y, float(kit.rng.uniform(-0.012, 0.012)))
        turn = heading + float(kit.rng.uniform(-9, 9))
        sheet(kit, (0.21, 0.275), thick, kit.m("paper"), cover, at=at, turn=turn)
        y += thick + 0.0004


def papers(kit: Kit) -> None:
    """Loose sheets of paper in an untidy pile."""
    for k in range(int(kit.rng.integers(2, 5))):
        at = (float(kit.rng.uniform(-0.03, 0.03)), 0.0016 * k, float(kit.rng.uniform(-0.03, 0.03)))
        sheet(kit, A4, 0.0012, kit.m("paper"), kit.m("page"), at=at, turn=float(kit.rng.uniform(-18, 18)))


def envelopes(kit: Kit) -> None:
    """Post: two to four envelopes fanned out."""
    start = float(kit.rng.uniform(-20, 20))
    for k in range(int(kit.rng.integers(2, 5))):
        at = (float(kit.rng.uniform(-0.02, 0.02)), 0.0022 * k, float(kit.rng.uniform(-0.01, 0.01)))
        turn = start + 14.0 * k
        sheet(kit, (0.22, 0.11), 0.0018, kit.m("paper"), kit.m("paper" if k % 2 else "mount_board"), at=at, turn=turn)


def newspaper(kit: Kit) -> None:
    """A newspaper, folded twice: a soft block with a printed upper side."""
    turn = float(kit.rng.uniform(-15, 15))
    kit.soft((0.2, 0.018, 0.29), (0.0, 0.009, 0.0), kit.m("paper"), radius=0.008, cells=2, rotate=rotation("y", turn))
    w, d, y = 0.094, 0.139, 0.0184
    corners = np.array([(-w, y, d), (w, y, d), (w, y, -d), (-w, y, -d)]) @ rotation("y", turn).T
    kit.cloth_quad(corners, kit.m("page"))


def notebook(kit: Kit) -> None:
    """A bound notebook with an elastic band and a pen on it."""
    w, d, t = 0.14, 0.21, 0.016
    cover, band = kit.m(kit.pick("tone_0", "tone_3", "plastic_black", "leather")), kit.m("plastic_black")
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, 0.002, d / 2), cover, bevel=0.0)
    kit.panel((-w / 2, 0.002, -d / 2 + 0.002), (w / 2 - 0.003, t - 0.002, d / 2 - 0.002), kit.m("paper"), bevel=0.0)
    kit.panel((-w / 2, t - 0.002, -d / 2), (w / 2, t, d / 2), cover, bevel=0.0)
    kit.panel((w / 2 - 0.03, t, -d / 2), (w / 2 - 0.024, t + 0.0008, d / 2), band, bevel=0.0)
    kit.rod((-0.04, t + 0.004, 0.05), (0.0, t + 0.004, -0.07), 0.004, kit.m(kit.pick("chrome", "tone_1")), sides=6)


def paper_ball(kit: Kit) -> None:
    """A crumpled sheet of paper."""
    crumpled_ball(kit, 0.032, kit.m("paper"))


def crumpled_ball(kit: Kit, radius: float, material: Material) -> None:
    """A ball with flat, uneven facets, resting on y = 0."""
    ball = Kit(kit.palette, kit.rng)
    ball.sphere(1.0, (0.0, 0.0, 0.0), material, rings=5, segments=7)
    mesh = ball.build()
    points = mesh.positions.reshape(-1, 3).astype(np.float64)
    # The same vertex gets the same radius in all of its triangles.
    wave = np.sin(points @ np.array([5.1, 8.3, 6.7]) + float(kit.rng.uniform(0, 6)))
    points *= (radius * (0.86 + 0.14 * wave))[:, None]
    points[:, 1] -= points[:, 1].min()
    kit.add(points, np.arange(len(points)).reshape(-1, 3), material, crease=5.0)
