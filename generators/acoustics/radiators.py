"""Modelled directivities of the seven categories: a part of a rigid body radiates, in many small patches.

The body of a product is a rigid sphere of its volume (as of a head, `generators.acoustics.tracer.receivers.sphere`).
The part of its surface that radiates is a cap about the axis, of the part's area. Its patches move without relation to
one another, as those of a panel with many modes do, or of an opening that lets out noise: their energies add up. The
far field of a patch is, by reciprocity, the pressure that a plane wave has at its place on the sphere (Duda and Martens
1998, eq. 4; P. M. Morse, K. U. Ingard, *Theoretical Acoustics*, McGraw-Hill 1968, § 7.2, for the point source on a
sphere). So the energy of an octave at the angle θ is the mean over the cap, and over the octave's frequencies, of the
squared pressure on the sphere.

These are models, not measurements: low octaves go all round the body, high ones are shadowed behind it. The sizes are
those of usual products; every product of a category has the same directivity, whatever its own size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.directivity import Directivity, direction_grid
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.receivers.sphere import sphere_response
from generators.core.low_discrepancy import fibonacci_directions

F64 = NDArray[np.float64]

#: Step of the angles from the axis, and of the table (degrees).
_STEP, _TABLE_STEP = 1.0, 5.0
#: Frequencies of an octave, and points on the sphere among which the patches of the cap are.
_FREQUENCIES, _POINTS = 9, 2000


@dataclass(frozen=True)
class Radiator:
    """A body, and the part of it that radiates.

    Attributes:
        part: what radiates, in words.
        body: width, height and depth of the body (m).
        area: of the part that radiates (m²).
        axis: direction that the part faces, in the object's frame (y up, z to the front).
    """

    part: str
    body: tuple[float, float, float]
    area: float
    axis: tuple[float, float, float]

    @property
    def radius(self) -> float:
        """Radius of the sphere of the body's volume (m)."""
        return float((3 * math.prod(self.body) / (4 * math.pi)) ** (1 / 3))

    @property
    def half_angle(self) -> float:
        """Half angle of the cap of the part's area (radians)."""
        return math.acos(max(1 - self.area / (2 * math.pi * self.radius**2), -1.0))

    def profile(self, angles: F64) -> F64:
        """(n, 8) energy in the octaves of `BANDS` at ``angles`` (n,) from the axis (radians), not normalised."""
        fine = np.radians(np.arange(0.0, 180.0 + _STEP, _STEP))
        octave = 2.0 ** (np.linspace(-0.5, 0.5, 2 * _FREQUENCIES + 1)[1::2])
        frequencies = np.outer(BANDS, octave).ravel()
        patch = np.abs(sphere_response(fine, 2 * np.pi * frequencies * self.radius / SPEED_OF_SOUND)) ** 2
        patch = patch.reshape(len(fine), len(BANDS), _FREQUENCIES).mean(axis=2)
        points = fibonacci_directions(_POINTS)
        cap = points[points[:, 2] >= math.cos(self.half_angle)]
        cosine = np.outer(np.sin(angles), cap[:, 0]) + np.outer(np.cos(angles), cap[:, 2])
        between = np.arccos(np.clip(cosine, -1.0, 1.0))
        return np.stack([np.interp(between, fine, column).mean(axis=1) for column in patch.T], axis=1)


#: The radiating part of each category.
RADIATORS = {
    "washing_machine": Radiator("the front with its door", (0.60, 0.85, 0.60), 0.50, (0.0, 0.0, 1.0)),
    "toilet": Radiator("the opening of the bowl", (0.38, 0.42, 0.55), 0.09, (0.0, 1.0, 0.0)),
    "vacuum_cleaner": Radiator("the upper half of the motor's housing", (0.32, 0.30, 0.40), 0.28, (0.0, 1.0, 0.0)),
    "microwave": Radiator("the front with its door", (0.48, 0.28, 0.38), 0.13, (0.0, 0.0, 1.0)),
    "coffee_machine": Radiator("the front", (0.24, 0.36, 0.35), 0.09, (0.0, 0.0, 1.0)),
    "clock": Radiator("the dial", (0.30, 0.30, 0.06), 0.07, (0.0, 0.0, 1.0)),
    "telephone": Radiator("the cover above bell or loudspeaker", (0.24, 0.14, 0.22), 0.02, (0.0, 1.0, 1.0)),
}


@lru_cache(maxsize=len(RADIATORS))
def modelled(category: str) -> Directivity | None:
    """The directivity of a category's model; None where there is none (the category is no appliance of the seven)."""
    radiator = RADIATORS.get(category)
    if radiator is None:
        return None
    azimuths, elevations, directions = direction_grid(_TABLE_STEP)
    axis = np.asarray(radiator.axis) / math.hypot(*radiator.axis)
    angles = np.arccos(np.clip((directions * axis).sum(axis=-1), -1.0, 1.0))
    fine = np.radians(np.arange(0.0, 180.0 + _STEP, _STEP))
    profile = np.sqrt(radiator.profile(fine))
    amplitudes = np.stack([np.interp(angles, fine, column) for column in profile.T])
    name = f"model of {category}: {radiator.part}"
    return Directivity.table(amplitudes, azimuths, elevations, BANDS, axis=radiator.axis, name=name)
