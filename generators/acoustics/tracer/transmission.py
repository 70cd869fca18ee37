"""Sound through walls: what a light interior wall lets through.

The direct sound of a blocked line passes the walls in its way with the sound reduction index of the mass law for a
field incident from all sides, R = 20·lg(m″·f) − 47 dB, m″ in kg/m², f in Hz (F. Fahy, P. Gardonio, *Sound and
Structural Vibration*, 2nd edition, Academic Press 2007, § 5.2), at each octave's centre. The wall: two leaves of gypsum
board of 12.5 mm (8.5 kg/m² each). At and above the coincidence of the boards (2.5 kHz), measured indices of such walls
stop growing: R is limited to 40 dB.

Every pair of surfaces that the line crosses is one such wall, a single surface too. Through more than `MOST_WALLS`
nothing is heard: other ways (doors, reflections) are louder then.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.arrivals import BANDS

#: Mass per area of the wall (kg/m²): two gypsum boards of 12.5 mm.
SURFACE_MASS = 17.0
#: Highest sound reduction index (dB): leaks and the coincidence of the boards.
HIGHEST_LOSS = 40.0
#: Walls through which the direct sound is still heard.
MOST_WALLS = 2


def wall_loss_db() -> NDArray[np.float64]:
    """(8,) sound reduction index in dB of one wall per octave of `BANDS`."""
    mass_law = 20 * np.log10(SURFACE_MASS * np.array(BANDS, dtype=np.float64)) - 47
    return np.asarray(np.minimum(mass_law, HIGHEST_LOSS))


def wall_gain(surfaces: int) -> NDArray[np.float64]:
    """(8,) amplitude factor of the direct sound through this many surfaces; 0 through more than `MOST_WALLS` walls."""
    walls = (surfaces + 1) // 2
    if walls > MOST_WALLS:
        return np.zeros(len(BANDS))
    return np.asarray(10 ** (-walls * wall_loss_db() / 20))
