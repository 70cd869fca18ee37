"""Sound through walls: what a light interior wall lets through.

The direct sound of a blocked line passes the walls in its way with the sound reduction index of the mass law for a
field incident from all sides, R = 20·lg(m″·f) − 47 dB, m″ in kg/m², f in Hz (F. Fahy, P. Gardonio, *Sound and
Structural Vibration*, 2nd edition, Academic Press 2007, § 5.2), at each octave's centre. The wall: two leaves of gypsum
board of 12.5 mm (8.5 kg/m² each). At and above the coincidence of the boards (2.5 kHz), measured indices of such walls
stop growing: R is limited to 40 dB.

Every pair of surfaces that the line crosses is one such wall, a single surface too. Through more than `MOST_WALLS`
nothing is heard: other ways (doors, reflections) are louder then.

Materials may give another transmission coefficient τ; a wall with two of them lets through their geometric mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.geometry import crossed
from generators.acoustics.materials import AcousticMaterial
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


#: Surfaces as near to each other along a path (m) are one: both triangles of a quadrilateral on its diagonal.
_SAME = 1e-4


@dataclass(frozen=True, eq=False)
class WallTable:
    """Walls of which some have a transmission coefficient of their own.

    Attributes:
        triangles: (T, 3, 3) metres.
        material: (T,) int32.
        passing: (M, 8) energy transmission coefficient τ per material and octave of `BANDS`.
    """

    triangles: NDArray[np.float64]
    material: NDArray[np.int32]
    passing: NDArray[np.float64]

    @classmethod
    def of(
        cls, triangles: NDArray[np.float64], material: NDArray[np.int32], materials: Sequence[AcousticMaterial]
    ) -> WallTable | None:
        """The table of a mesh; None if none of its materials gives a coefficient."""
        if all(one.transmission is None for one in materials):
            return None
        usual = 10 ** (-wall_loss_db() / 10)
        own = [one.transmission for one in materials]
        passing = [usual if six is None else np.array([six[0], *six, six[-1]]) for six in own]
        return cls(triangles, material, np.array(passing))

    def gain(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        """(8,) amplitude factor of the direct sound from ``a`` to ``b`` (3,); see `wall_gain`."""
        share = crossed(self.triangles, a, b)
        order = np.argsort(share, kind="stable")[: int(np.isfinite(share).sum())]
        apart = np.diff(share[order], prepend=-np.inf) * float(np.linalg.norm(b - a))
        tau = self.passing[self.material[order[apart > _SAME]]]
        if (len(tau) + 1) // 2 > MOST_WALLS:
            return np.zeros(len(BANDS))
        walls = [tau[first : first + 2] for first in range(0, len(tau), 2)]
        pairs = [wall.prod(axis=0) ** (1 / len(wall)) for wall in walls]
        return np.asarray(np.sqrt(np.prod(pairs, axis=0))) if pairs else np.ones(len(BANDS))
