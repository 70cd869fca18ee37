"""What is seen from a window: sky, skyline, a row of houses, trees and the ground.

The picture is a plane `PLANE_DISTANCE` behind the panes. What stands at another distance d is drawn in perspective, as
it is seen from the window: smaller by `PLANE_DISTANCE` / d, and with its foot lower by the eye's height over the ground
times that. Values are linear radiance; 1 is a white cloud in the sun. The ratios are those of a clear day with the sun
at 35°: blue sky 0.25, horizon 0.6, a light wall in the sun 0.5, the same in shade 0.15, leaves 0.1 (E. Reinhard et al.,
"High Dynamic Range Imaging", 2nd edition, 2010, table 1.1 gives such luminances).
"""

from __future__ import annotations

import numpy as np

from generators.assets.textures.noise import Field, Image, blur, grid, mix, smoothstep, spectral, to_image, to_srgb

#: Distance of the plane behind the window panes (m).
PLANE_DISTANCE = 30.0
#: Width and height of the plane that the picture covers (m); its sides meet.
PLANE_SIZE = (96.0, 48.0)
#: Share of the height, from below, at which the horizon lies.
HORIZON = 0.5
#: Height of the eye over its floor, of a storey, and of the lowest floor over the ground (m).
EYE, _STOREY, _PLINTH = 1.5, 3.0, 0.4
#: Highest storey from which one looks.
_TOP_STOREY = 4

_ZENITH, _HAZE = np.array([0.15, 0.27, 0.52]), np.array([0.52, 0.60, 0.68])
_CLOUD, _CLOUD_BASE = np.array([0.95, 0.95, 0.94]), np.array([0.50, 0.54, 0.60])
_GRASS, _PAVING, _ASPHALT = (np.array(c) for c in ((0.10, 0.15, 0.05), (0.34, 0.33, 0.31), (0.15, 0.15, 0.16)))
_LEAVES = tuple(np.array(c) for c in ((0.09, 0.15, 0.035), (0.13, 0.18, 0.05), (0.06, 0.11, 0.03)))
_BARK = np.array([0.07, 0.055, 0.04])
#: Albedo of façades and of roofs (linear RGB).
_WALLS = tuple(
    np.array(c)
    for c in (
        (0.62, 0.58, 0.50),
        (0.66, 0.65, 0.62),
        (0.58, 0.46, 0.30),
        (0.36, 0.17, 0.11),
        (0.45, 0.47, 0.48),
        (0.58, 0.38, 0.28),
    )
)
_ROOFS = tuple(np.array(c) for c in ((0.24, 0.10, 0.06), (0.11, 0.11, 0.12), (0.18, 0.13, 0.10)))
#: Light on a façade in the sun and in the shade, over that on a white cloud.
_SUNLIT, _SHADED = 0.85, 0.26


class _Canvas:
    """A picture in linear light that is painted in metres on the plane; x wraps, y is up from the horizon."""

    def __init__(self, size: int) -> None:
        self.width, self.height = size, size // 2
        self.scale = self.width / PLANE_SIZE[0]
        self.horizon = (1 - HORIZON) * self.height
        self.light = np.zeros((self.height, self.width, 3))

    def row(self, y: float) -> int:
        """The row at the height ``y``."""
        return min(max(round(self.horizon - y * self.scale), 0), self.height)

    def fill(self, x: tuple[float, float], y: tuple[float, float], colour: Field) -> None:
        """A rectangle of one colour (3,), at least a pixel wide and high."""
        first = round(x[0] * self.scale)
        columns = np.arange(first, max(round(x[1] * self.scale), first + 1)) % self.width
        top = self.row(y[1])
        self.light[top : max(self.row(y[0]), top + 1), columns] = colour


def outdoors(rng: np.random.Generator, *, size: int = 2048) -> Image:
    """The view from a window, (size / 2, size, 3); it repeats in x. Storey, weather, houses and trees are drawn."""
    canvas = _Canvas(size)
    eye = EYE + _PLINTH + _STOREY * int(rng.integers(0, _TOP_STOREY + 1))
    _sky(rng, canvas)
    _hills(rng, canvas)
    _ground(rng, canvas, eye)
    leaves = spectral(rng, canvas.light.shape[:2], 0.9, finest=2, coarsest=canvas.scale * 3)
    for distance, haze in ((420.0, 0.6), (230.0, 0.35), (120.0, 0.18)):
        _row_of_houses(rng, canvas, eye, distance, haze)
        for _ in range(30):
            _tree(rng, canvas, eye, leaves, float(rng.uniform(0.7, 0.95)) * distance, haze)
    _row_of_houses(rng, canvas, eye, float(rng.uniform(27.0, 40.0)), 0.03)
    for _ in range(int(rng.integers(6, 13))):
        _tree(rng, canvas, eye, leaves, float(rng.uniform(13.0, 26.0)), 0.0)
    return to_image(to_srgb(blur(canvas.light, 0.6 * size / 2048)))


def _sky(rng: np.random.Generator, canvas: _Canvas) -> None:
    """Blue above, pale over the horizon; clouds, brighter above than below, thinner towards the top of the picture."""
    shape = canvas.light.shape[:2]
    _, y = grid(*shape)
    up = np.clip((1 - HORIZON - y) / (1 - HORIZON), 0, 1)
    canvas.light[:] = mix(_HAZE, _ZENITH, smoothstep(-0.1, 0.9, up))
    heaps = spectral(rng, shape, 1.75, stretch=(1.0, 2.0), coarsest=shape[0] / 3)
    cover = float(rng.uniform(-0.3, 0.9))
    dense = smoothstep(cover, cover + 1.5, heaps) * (1 - smoothstep(0.75, 0.97, up))
    below = np.roll(heaps, -max(shape[0] // 40, 1), axis=0)
    body = mix(_CLOUD_BASE, _CLOUD, smoothstep(-0.9, 0.5, heaps - below))
    canvas.light[:] = mix(canvas.light, body, dense)


def _hills(rng: np.random.Generator, canvas: _Canvas) -> None:
    """Wooded hills on the horizon."""
    x = np.arange(canvas.width) / canvas.width
    high = sum(rng.uniform(0.4, 1.0) / f**0.8 * np.sin(2 * np.pi * (f * x + rng.random())) for f in (1, 2, 3, 5, 9, 17))
    top = canvas.horizon - canvas.scale * np.maximum(1.0 + 0.8 * high, 0.1)
    rows = np.arange(canvas.height)[:, None]
    colour = 0.35 * _LEAVES[0] + 0.55 * np.array([0.36, 0.44, 0.53])
    canvas.light[rows >= top] = colour


def _ground(rng: np.random.Generator, canvas: _Canvas, eye: float) -> None:
    """Lawn, a street with pavements across the view, and lawn again up to the horizon."""
    rows = np.arange(int(canvas.horizon) + 1, canvas.height)
    distance = eye * PLANE_DISTANCE * canvas.scale / (rows + 0.5 - canvas.horizon)
    near = float(rng.uniform(9.0, 13.0))
    colour = np.where((distance > 90.0)[:, None], 0.5 * _GRASS + 0.5 * _HAZE * 0.4, _GRASS)
    for low, high, own in ((near, near + 12.0, _PAVING), (near + 2.2, near + 9.8, _ASPHALT)):
        colour = np.where(((distance > low) & (distance < high))[:, None], own, colour)
    noise = spectral(rng, (len(rows), canvas.width), 0.7, stretch=(0.4, 1.0), finest=2)
    canvas.light[rows] = colour[:, None] * np.clip(1 + 0.10 * noise, 0.5, 1.5)[..., None]


def _row_of_houses(rng: np.random.Generator, canvas: _Canvas, eye: float, distance: float, haze: float) -> None:
    """Houses side by side at a distance (m), with gaps; ``haze`` is the share of the horizon's light over them."""
    scale = PLANE_DISTANCE / distance
    x, end = 0.0, PLANE_SIZE[0]
    while x < end - 6.0 * scale:
        width = min(float(rng.uniform(9.0, 20.0)) * scale, end - x)
        if rng.random() < 0.8:
            _house(rng, canvas, (x, x + width), -eye * scale, scale, haze)
        x += width + (float(rng.uniform(2.0, 9.0)) * scale if rng.random() < 0.35 else 0.0)


def _house(
    rng: np.random.Generator, canvas: _Canvas, x: tuple[float, float], foot: float, scale: float, haze: float
) -> None:
    storeys = int(rng.integers(2, 7))
    light = _SUNLIT if rng.random() < 0.55 else _SHADED

    def hazy(colour: Field) -> Field:
        return np.asarray((1 - haze) * colour + haze * _HAZE)

    wall = _WALLS[int(rng.integers(len(_WALLS)))] * float(rng.uniform(0.85, 1.1))
    roof = _ROOFS[int(rng.integers(len(_ROOFS)))] * light
    top = foot + (storeys * _STOREY + 0.6) * scale
    if rng.random() < 0.6:
        steps = 12
        for k in range(steps):
            inward = 0.12 * (x[1] - x[0]) * k / steps
            rise = 2.8 * scale * np.array([k, k + 1]) / steps
            canvas.fill((x[0] + inward, x[1] - inward), (top + rise[0], top + rise[1]), hazy(roof * (0.9 + 0.02 * k)))
        chimney = float(rng.uniform(x[0] + 0.2 * (x[1] - x[0]), x[1] - 0.25 * (x[1] - x[0])))
        canvas.fill((chimney, chimney + 0.8 * scale), (top + 2.2 * scale, top + 3.8 * scale), hazy(0.7 * wall * light))
    canvas.fill(x, (foot, top), hazy(wall * light))
    canvas.fill(x, (top - 0.35 * scale, top), hazy(np.minimum(1.15 * wall, 0.85) * light))
    canvas.fill(x, (foot, foot + 0.7 * scale), hazy(0.55 * wall * light))
    columns = max(2, int((x[1] - x[0]) / (float(rng.uniform(2.2, 3.2)) * scale)))
    pitch = (x[1] - x[0]) / columns
    wide, high = float(rng.uniform(0.9, 1.3)) * scale, float(rng.uniform(1.3, 1.7)) * scale
    with_balcony = rng.random(columns) < 0.25
    trim = np.array([0.72, 0.71, 0.68]) if rng.random() < 0.7 else np.array([0.16, 0.15, 0.14])
    for storey in range(storeys):
        low = foot + (storey * _STOREY + 0.95) * scale
        for column in range(columns):
            middle = x[0] + (column + 0.5) * pitch
            _window(rng, canvas, (middle, low), (wide, high), scale, (hazy(trim * light), hazy))
            if with_balcony[column] and storey:
                _balcony(canvas, middle, low, scale, (hazy(0.8 * wall * light), hazy(0.25 * wall * light)))


def _window(
    rng: np.random.Generator,
    canvas: _Canvas,
    at: tuple[float, float],
    size: tuple[float, float],
    scale: float,
    tones: tuple[Field, object],
) -> None:
    """A window: trim, panes that mirror some sky, and in some of them a curtain or a blind."""
    trim, hazy = tones
    assert callable(hazy)
    (middle, low), (wide, high) = at, size
    edge = 0.09 * scale
    canvas.fill((middle - wide / 2 - edge, middle + wide / 2 + edge), (low - edge, low + high + edge), trim)
    glass = np.array([0.035, 0.04, 0.045]) + float(rng.uniform(0.02, 0.22)) * _HAZE
    canvas.fill((middle - wide / 2, middle + wide / 2), (low, low + high), hazy(glass))
    kind = rng.random()
    if kind < 0.3:
        drop = float(rng.uniform(0.2, 0.9)) * high
        canvas.fill((middle - wide / 2, middle + wide / 2), (low + high - drop, low + high), hazy(glass + 0.16))
    elif kind < 0.6:
        canvas.fill((middle - wide / 2, middle - wide / 5), (low, low + high), hazy(glass + 0.12))
        canvas.fill((middle + wide / 5, middle + wide / 2), (low, low + high), hazy(glass + 0.12))
    canvas.fill((middle - edge / 2, middle + edge / 2), (low, low + high), trim)
    canvas.fill(
        (middle - wide / 2 - 2 * edge, middle + wide / 2 + 2 * edge),
        (low - 2 * edge, low - edge),
        1.1 * trim,
    )


def _balcony(canvas: _Canvas, middle: float, low: float, scale: float, tones: tuple[Field, Field]) -> None:
    """A slab with a railing of bars before a window."""
    slab, bars = tones
    half, floor = 1.15 * scale, low - 0.95 * scale
    canvas.fill((middle - half, middle + half), (floor - 0.45 * scale, floor - 0.2 * scale), bars)
    canvas.fill((middle - half, middle + half), (floor - 0.2 * scale, floor), slab)
    canvas.fill((middle - half, middle + half), (floor + 0.95 * scale, floor + 1.02 * scale), bars)
    for k in range(14):
        at = middle - half + 2 * half * k / 13
        canvas.fill((at - 0.012 * scale, at + 0.012 * scale), (floor, floor + 0.95 * scale), bars)


def _tree(rng: np.random.Generator, canvas: _Canvas, eye: float, leaves: Field, distance: float, haze: float) -> None:
    """A broad-leaved tree at a distance (m): a trunk and a crown of round clumps, light above and dark below."""
    scale = PLANE_DISTANCE / distance
    high, radius = float(rng.uniform(6.0, 12.0)) * scale, float(rng.uniform(2.0, 3.4)) * scale
    middle, foot = float(rng.uniform(0.0, PLANE_SIZE[0])), -eye * scale
    canvas.fill((middle - 0.14 * scale, middle + 0.14 * scale), (foot, foot + high - radius), _BARK)
    reach = 2.0 * radius
    columns = np.arange(int((middle - reach) * canvas.scale), int((middle + reach) * canvas.scale))
    rows = np.arange(canvas.row(foot + high + 0.3 * radius), canvas.row(foot + high - 2.6 * radius))
    x = (columns + 0.5) / canvas.scale - middle
    y = (canvas.horizon - rows - 0.5)[:, None] / canvas.scale - (foot + high - radius)
    grain = leaves[rows[:, None], columns % canvas.width]
    mask, shade = np.zeros(grain.shape), np.zeros(grain.shape)
    for _ in range(14):
        angle, out = float(rng.uniform(0, 2 * np.pi)), radius * float(np.sqrt(rng.random())) * 0.75
        own = radius * float(rng.uniform(0.35, 0.55))
        cx, cy = out * np.cos(angle), out * np.sin(angle)
        away = np.hypot(x - cx, y - cy) / own
        covers = smoothstep(-0.06, 0.06, 1.0 - away + 0.22 * grain)
        lit = 0.75 + 0.45 * (y - cy) / own - 0.25 * (x - cx) / own
        shade = shade * (1 - covers) + np.clip(lit, 0.25, 1.5) * covers
        mask = np.maximum(mask, covers)
    colour = _LEAVES[int(rng.integers(len(_LEAVES)))] * float(rng.uniform(0.8, 1.2))
    crown = colour * (np.clip(shade, 0.2, 1.6) * np.clip(1 + 0.35 * grain, 0.25, 2.2))[..., None]
    crown = (1 - haze) * crown + haze * _HAZE
    place = np.ix_(rows, columns % canvas.width)
    canvas.light[place] = mix(canvas.light[place], crown, mask)
