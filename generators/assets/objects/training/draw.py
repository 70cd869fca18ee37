"""Random choices that all families share: lengths, colours, names, the order of parts on a panel."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from generators.assets.objects.finishes import (
    brushed_steel,
    ceramic,
    chrome,
    enamel,
    hex_rgb,
    lamp,
    plastic,
    wood,
)
from generators.core.scene import Material

#: Colours of household goods with their shares: white, greys, black, steel, cream, then the rarer saturated ones.
APPLIANCE = (
    ("#efefec", 0.30),
    ("#e4e3dd", 0.08),
    ("#c3c6c8", 0.10),
    ("#8d9195", 0.06),
    ("#4b4e52", 0.08),
    ("#232427", 0.16),
    ("#e9dfc4", 0.05),
    ("#b1302c", 0.06),
    ("#3b6b8f", 0.04),
    ("#8fb9a8", 0.04),
    ("#d99aa0", 0.015),
    ("#d9a32f", 0.015),
)
#: Colours of small plastic goods, saturated ones included.
VIVID = ("#b4282c", "#1f5c9e", "#d4772c", "#5c3b84", "#2f7d52", "#d8b02d", "#2a8c8c", "#232427", "#8f9397", "#e8e6e0")
#: Tints of polished metal; few, because each has a texture of its own.
METALS = ("#dcdee0", "#dcdee0", "#dcdee0", "#c9cbcd", "#e2b35c", "#d39a6a", "#5b5d60")
WOODS = ("#7a4a28", "#53301c", "#a8794a", "#c49a62", "#3d2417", "#8a6a4c", "#6b2f1c")
#: Colours of lit displays.
GLOWS = ("#6fe3ff", "#ffffff", "#ff9c4a", "#5ff0a8", "#ff4a3d", "#56c8ff", "#d8ff7a")
_STARTS = (
    "ba",
    "ve",
    "lo",
    "mi",
    "tor",
    "na",
    "kel",
    "fi",
    "zu",
    "ar",
    "el",
    "do",
    "sen",
    "pra",
    "ho",
    "wi",
    "cu",
    "xa",
)
_ENDS = ("ra", "lux", "na", "mat", "tek", "co", "dor", "lia", "vent", "x", "ro", "ster", "mo", "ty", "lex", "nor", "sa")


def between(rng: Generator, low: float, high: float) -> float:
    """A number between ``low`` and ``high``."""
    return float(rng.uniform(low, high))


def chance(rng: Generator, share: float) -> bool:
    """True in that share of the calls."""
    return bool(rng.random() < share)


def pick(rng: Generator, *options: float) -> float:
    """One of the numbers ``options``."""
    return options[int(rng.integers(len(options)))]


def shade(rng: Generator, srgb: str, spread: float = 0.05) -> str:
    """A colour near ``srgb``: hue, saturation and value each moved by up to ``spread``, in steps of an 8-bit level."""
    h, s, v = colorsys.rgb_to_hsv(*(hex_rgb(srgb) / 255))
    h = (h + rng.uniform(-spread, spread) * 0.6) % 1.0
    s = float(np.clip(s * (1 + rng.uniform(-3, 3) * spread), 0, 1))
    v = float(np.clip(v + rng.uniform(-spread, spread), 0.06, 0.955))
    return "#" + "".join(f"{round(255 * c):02x}" for c in colorsys.hsv_to_rgb(h, s, v))


def tone(rng: Generator, *palette: str, spread: float = 0.05) -> str:
    """A colour near one of ``palette``; without a palette, near one of `APPLIANCE`."""
    if palette:
        return shade(rng, palette[int(rng.integers(len(palette)))], spread)
    shares = np.array([share for _, share in APPLIANCE])
    at = int(rng.choice(len(APPLIANCE), p=shares / shares.sum()))
    return shade(rng, APPLIANCE[at][0], spread)


def brightness(srgb: str) -> float:
    """Luma of ``srgb`` from 0 to 1 (ITU-R BT.601 weights)."""
    return float(hex_rgb(srgb) @ [0.299, 0.587, 0.114] / 255)


def ink_on(srgb: str) -> str:
    """A colour that can be read on ``srgb``."""
    return "#25282b" if brightness(srgb) > 0.5 else "#e6e8ea"


def metal(rng: Generator, name: str) -> Material:
    """Polished metal."""
    return chrome(name, METALS[int(rng.integers(len(METALS)))])


def shell(rng: Generator, name: str, srgb: str, *, steel: float = 0.15) -> Material:
    """The main material of a case: enamel or plastic of the colour ``srgb``, or in a share ``steel`` brushed steel.

    A builder needs the tile ``{name: 0.25}`` for the streaks of the steel.
    """
    if chance(rng, steel):
        return brushed_steel(name, rng, tone(rng, "#b9bcbe", "#a3a6a8", "#c6c2ba", "#77797c", spread=0.02))
    return enamel(name, srgb) if chance(rng, 0.5) else plastic(name, srgb, roughness=between(rng, 0.16, 0.64))


def trim(rng: Generator, name: str) -> Material:
    """The material of a knob, a handle or a rim: metal, black, white, grey or a colour."""
    kind = rng.random()
    if kind < 0.35:
        return metal(rng, name)
    return plastic(name, tone(rng, "#1c1d1f", "#e9eaec", "#8d9195", "#c9cccf", "#2f3236"), roughness=0.25)


def timber(rng: Generator, name: str) -> Material:
    """Polished wood."""
    return wood(name, rng, tone(rng, *WOODS, spread=0.03))


def china(rng: Generator, name: str) -> Material:
    """White or, seldom, coloured glazed ceramic."""
    if chance(rng, 0.85):
        return ceramic(name, tone(rng, "#f2f2ee", "#ecebe6", "#f0ede4", spread=0.012))
    return ceramic(name, tone(rng, "#d8c9a6", "#a9bfae", "#c7a3a0", "#9db4c4", "#2b2d30", "#7b7f83"))


def pilot(rng: Generator, name: str) -> Material:
    """A small lamp, lit or not."""
    colour = tone(rng, "#ff6a2a", "#44d05a", "#e23a30", "#4aa8ff", spread=0.02)
    return lamp(name, colour, between(rng, 0.2, 0.6) if chance(rng, 0.7) else 0.0)


def word(rng: Generator, upper: float = 0.5) -> str:
    """An invented name."""
    text = _STARTS[int(rng.integers(len(_STARTS)))] + _ENDS[int(rng.integers(len(_ENDS)))]
    return text.upper() if chance(rng, upper) else text.capitalize()


def clock_time(rng: Generator) -> str:
    """A time of the day, for a display."""
    return f"{int(rng.integers(24)):02d}:{int(rng.integers(60)):02d}"


def spread_out(rng: Generator, widths: Sequence[float], room: float) -> list[float]:
    """Centres of parts of ``widths`` (m), in a random order and with random gaps, within ``room`` metres about 0.

    Parts that need more than ``room`` overlap a little at their edges.
    """
    order = rng.permutation(len(widths))
    free = room - sum(widths)
    gaps = rng.dirichlet(np.full(len(widths) + 1, 4.0)) * free
    centres = [0.0] * len(widths)
    x = -room / 2
    for gap, at in zip(gaps, order, strict=False):
        x += float(gap)
        centres[int(at)] = x + widths[int(at)] / 2
        x += widths[int(at)]
    return centres
