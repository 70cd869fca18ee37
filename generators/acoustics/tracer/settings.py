"""How much work a trace is worth, and where its methods end."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from numbers import Integral
from typing import TYPE_CHECKING

from avs3d_bench.errors import Avs3dError
from generators.core.limits import check_ranges

if TYPE_CHECKING:
    from avs3d_bench.contract.schema import Scalar

#: Limits of `TraceSettings.most_reflections` and of `TraceSettings.seconds` (s).
MOST_REFLECTIONS, LONGEST = 10_000, 60.0


@dataclass(frozen=True)
class TraceSettings:
    """Settings of a trace; see `described` for what goes into observation.json.

    The number of rays follows from the room: as many as give the wanted arrivals at a listener, whatever the size of
    the room and its reverberation.

    Attributes:
        arrivals: late arrivals at a listener that is `radius`/0.9 or more from all surfaces, on average.
        least_rays: lower limit of the number of rays.
        most_rays: upper limit of the number of rays.
        rain_rays: rays whose first scattered sound is sent to every listener (diffuse rain).
        rain_order: reflections of these rays from which it is sent.
        early_order: most reflections of an image source.
        diffraction: whether sound bends round edges.
        exact_scattering: reflections of a ray whose scattering is right in each octave; later ones use the mean over
            the octaves, because weights that multiply without end would leave a few rays with all the energy.
        radius: largest radius of the disc by which a listener detects rays (m).
        decay_db: the sound is followed until it has fallen this far.
        most_reflections: upper limit of the reflections of a ray; divided by an absorption scale below 1.
        seconds: the longest response; divided by an absorption scale below 1.
        seed: of the random numbers.
        fixed_carriers: whether late sound has the same fine structure at all places, so that responses change smoothly
            with the place of source and listener; see `generators.acoustics.tracer.carriers`. The CPU only.

    Examples:
        >>> from generators.acoustics import Tracer
        >>> Tracer(seed=1, settings=TraceSettings(arrivals=5000, fixed_carriers=True)).settings.arrivals
        5000
    """

    arrivals: int = 20_000
    least_rays: int = 4000
    most_rays: int = 40_000
    rain_rays: int = 1000
    rain_order: int = 2
    early_order: int = 3
    diffraction: bool = True
    exact_scattering: int = 4
    radius: float = 0.35
    decay_db: float = 60.0
    most_reflections: int = 400
    seconds: float = 5.0
    seed: int = 0
    fixed_carriers: bool = False

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            Avs3dError: if a number is out of its range.
        """
        ranges: dict[str, tuple[float, float]] = {
            "arrivals": (1, 10_000_000),
            "least_rays": (1, 10_000_000),
            "most_rays": (self.least_rays, 10_000_000),
            "rain_rays": (0, 1_000_000),
            "rain_order": (0, self.exact_scattering),
            "early_order": (0, 4),
            "exact_scattering": (0, 1000),
            "radius": (0.05, 2.0),
            "decay_db": (1.0, 120.0),
            "most_reflections": (1, MOST_REFLECTIONS),
            "seconds": (0.01, LONGEST),
            "seed": (0, 2**64 - 1),
        }
        check_ranges("trace settings", self, ranges)
        if isinstance(self.seed, bool) or not isinstance(self.seed, Integral):
            raise Avs3dError(f"trace settings: seed is {self.seed!r}, expected a whole number")
        if not isinstance(self.fixed_carriers, bool):
            raise Avs3dError(f"trace settings: fixed_carriers is {self.fixed_carriers!r}, expected True or False")

    def described(self) -> dict[str, Scalar]:
        """The settings by name; one that changes nothing while it is off is named only where it is on."""
        return {name: value for name, value in asdict(self).items() if value is not False or name != "fixed_carriers"}
