"""Acoustic materials: octave-band absorption and scattering per label, and the engine's material file.

Absorption is the random-incidence energy coefficient α that a reverberation chamber gives (ISO 354), in the octaves
125 Hz … 4 kHz. The values follow the usual tables, rounded; they have not been collated with the printed editions:

- [V] M. Vorländer, *Auralization*, Springer 2008, appendix "Tables of random-incidence absorption coefficients".
- [K] V. O. Knudsen, C. M. Harris, *Acoustical Designing in Architecture*, Acoustical Society of America 1978.
- [B] L. L. Beranek, T. Hidaka, "Sound absorption in concert halls by seats …", JASA 104 (1998) 3169–3177.
- [E] Estimated for this project between neighbouring entries, because no table covers the object as it is in a flat.

The tables leave out everything that is too small for the acoustic twin: books, towels, clothes, shoes, gaps
under doors, pipes. Rooms built of table values alone ring twice as long as inhabited ones. `AcousticMaterial.in_situ`
adds one `RESIDUAL` absorption to every surface, chosen once so that furnished rooms come near the 0.5 s that
ISO 16283-1 and ISO 717-1 take as the reference for dwellings, because furnished rooms have it at all frequencies.

Scattering (ISO 17497-1) is tabulated for few surfaces; large smooth ones get 0.05–0.1, soft or structured ones more.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError

#: Octave-band centre frequencies in Hz.
OCTAVE_BANDS = (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0)
Spectrum = tuple[float, float, float, float, float, float]
#: Share of the sound that survives the surface itself and is lost in the small things on it.
RESIDUAL = 0.06


@dataclass(frozen=True)
class AcousticMaterial:
    """Acoustic properties of a surface.

    Attributes:
        label: `Material.acoustic` of the faces it belongs to.
        absorption: energy absorption coefficient per octave of `OCTAVE_BANDS`, in [0, 1].
        scattering: scattering coefficient per octave, in [0, 1].
        basis: the meaning of the values and their source ([V], [K], [B], [E] of the module's docstring).
        scale: factor of its Eyring exponent −ln(1 − α in situ): above 1 it absorbs more, below 1 less.
        residual: absorption that the small things on the surface add; 0 for given values that are used unchanged.
        transmission: energy transmission coefficient per octave of a wall with this surface, in [0, 1]; None: that of
            a light interior wall (see `generators.acoustics.tracer.transmission`).
    """

    label: str
    absorption: Spectrum
    scattering: Spectrum
    basis: str
    scale: float = 1.0
    residual: float = RESIDUAL
    transmission: Spectrum | None = None

    def __post_init__(self) -> None:
        """Refuse coefficients that the engine would take for silent nonsense.

        Raises:
            Avs3dError: if a coefficient is not a number in [0, 1] or a band is missing.
        """
        transmission = (0.0,) * len(OCTAVE_BANDS) if self.transmission is None else self.transmission
        spectra = {"absorption": self.absorption, "scattering": self.scattering, "transmission": transmission}
        for what, values in spectra.items():
            if len(values) != len(OCTAVE_BANDS) or not all(0.0 <= v <= 1.0 for v in values):
                raise Avs3dError(
                    f"acoustic material {self.label!r}: {what} is {values}, "
                    f"expected {len(OCTAVE_BANDS)} numbers in [0, 1]"
                )

    @property
    def in_situ(self) -> Spectrum:
        """Absorption in an inhabited room: 1 − [(1 − α)·(1 − `residual`)]^scale per octave; what both backends use."""
        a, b, c, d, e, f = (1.0 - ((1.0 - alpha) * (1.0 - self.residual)) ** self.scale for alpha in self.absorption)
        return a, b, c, d, e, f

    def scaled(self, scale: float) -> AcousticMaterial:
        """The material with `scale` times its Eyring exponent: α' = 1 − (1 − α)^scale stays in [0, 1)."""
        return replace(self, scale=self.scale * scale)


_SMOOTH: Spectrum = (0.05, 0.05, 0.05, 0.05, 0.08, 0.10)
_ROUGH: Spectrum = (0.10, 0.10, 0.12, 0.15, 0.20, 0.25)
_SOFT: Spectrum = (0.10, 0.15, 0.20, 0.30, 0.40, 0.50)
_BROKEN: Spectrum = (0.20, 0.30, 0.40, 0.50, 0.60, 0.60)

_TABLE = (
    AcousticMaterial("plaster", (0.29, 0.10, 0.05, 0.04, 0.07, 0.09), _SMOOTH, "gypsum board on studs [K]"),
    AcousticMaterial("concrete", (0.01, 0.01, 0.02, 0.02, 0.02, 0.03), _SMOOTH, "smooth unpainted concrete [V]"),
    AcousticMaterial("brick", (0.03, 0.03, 0.03, 0.04, 0.05, 0.07), _ROUGH, "unglazed brick [K]"),
    AcousticMaterial(
        "wood", (0.28, 0.22, 0.17, 0.09, 0.10, 0.11), _ROUGH, "wooden panels over a hollow: furniture, doors [K]"
    ),
    AcousticMaterial("parquet", (0.15, 0.11, 0.10, 0.07, 0.06, 0.07), _SMOOTH, "wooden floor on joists [K]"),
    AcousticMaterial("tile", (0.01, 0.01, 0.01, 0.02, 0.02, 0.02), _SMOOTH, "glazed tiles on a wall [V]"),
    AcousticMaterial("ceramic", (0.01, 0.01, 0.01, 0.02, 0.02, 0.02), _ROUGH, "as glazed tiles, curved [V]"),
    AcousticMaterial("glass", (0.35, 0.25, 0.18, 0.12, 0.07, 0.04), _SMOOTH, "ordinary window glass [K]"),
    AcousticMaterial("metal", (0.05, 0.10, 0.10, 0.10, 0.07, 0.02), _ROUGH, "thin sheet steel [E]"),
    AcousticMaterial("plastic", (0.02, 0.03, 0.03, 0.03, 0.03, 0.02), _ROUGH, "as vinyl on a hard base [V]"),
    AcousticMaterial("fabric", (0.03, 0.04, 0.11, 0.17, 0.24, 0.35), _SOFT, "light velour hung straight [K]"),
    AcousticMaterial("carpet", (0.02, 0.06, 0.14, 0.37, 0.60, 0.65), _SOFT, "heavy carpet on concrete [K]"),
    AcousticMaterial("curtain", (0.07, 0.31, 0.49, 0.75, 0.70, 0.60), _BROKEN, "velour draped to half its area [K]"),
    AcousticMaterial("upholstery", (0.36, 0.47, 0.57, 0.62, 0.62, 0.60), _BROKEN, "lightly upholstered seats [B]"),
    AcousticMaterial(
        "clutter", (0.32, 0.35, 0.37, 0.36, 0.36, 0.36), _BROKEN, "half upholstery, half wood: sofas and heaps [E]"
    ),
    AcousticMaterial("foliage", (0.03, 0.06, 0.11, 0.17, 0.27, 0.31), _BROKEN, "leaves of a potted plant [E]"),
    AcousticMaterial("paper", (0.15, 0.20, 0.25, 0.25, 0.25, 0.20), _BROKEN, "a row of books, backs outward [E]"),
    AcousticMaterial("water", (0.01, 0.01, 0.01, 0.02, 0.02, 0.03), _SMOOTH, "water surface of a pool [V]"),
)

#: The materials by label.
MATERIALS: dict[str, AcousticMaterial] = {material.label: material for material in _TABLE}
#: Absorption for an unknown label: 0.1 in every octave, the mean of a furnished room and the engine's own fallback.
DEFAULT_MATERIAL = AcousticMaterial("default", (0.1,) * 6, _ROUGH, "unknown surface [E]")


#: A label that carries its own coefficients. The engine takes a label for another one that it contains, so that no
#: such label may contain another: those of one prefix are of one length, and none holds the name of a material.
_SIX = r"([01]\.\d{4}(?:,[01]\.\d{4}){5})"
_SPECTRAL = re.compile(f"given:{_SIX}/{_SIX}|passing:{_SIX}/{_SIX}/{_SIX}")


def spectral_label(absorption: Spectrum, scattering: Spectrum, transmission: Spectrum | None = None) -> str:
    """A label that encodes these coefficients, rounded to four digits; `material_for` decodes it."""
    given = (absorption, scattering) if transmission is None else (absorption, scattering, transmission)
    spectra = "/".join(",".join(f"{v:.4f}" for v in values) for values in given)
    return f"{'given' if transmission is None else 'passing'}:{spectra}"


def scaled_label(label: str, scale: float) -> str:
    """The label of the material ``label`` with ``scale`` times its Eyring exponent; it stays as it is for 1."""
    if scale == 1.0:
        return label
    material = material_for(label)
    return spectral_label(material.scaled(scale).in_situ, material.scattering, material.transmission)


def _spectrum(text: str) -> Spectrum:
    a, b, c, d, e, f = (float(value) for value in text.split(","))
    return a, b, c, d, e, f


def material_for(label: str) -> AcousticMaterial:
    """The material of a label (case and outer blanks do not matter), or `DEFAULT_MATERIAL`."""
    key = label.strip().lower()
    found = _SPECTRAL.fullmatch(key)
    if found:
        spectra = [_spectrum(six) for six in found.groups() if six]
        passing = spectra[2] if len(spectra) > 2 else None
        return AcousticMaterial(key, spectra[0], spectra[1], "given coefficients", residual=0.0, transmission=passing)
    return MATERIALS.get(key, DEFAULT_MATERIAL)


def mean_absorption(
    triangles: NDArray[np.floating], labels: tuple[str, ...], scale: float = 1.0
) -> NDArray[np.float64]:
    """Area-weighted mean absorption.

    Args:
        triangles: (A, 3, 3) metres.
        labels: (A,) one label per triangle.
        scale: factor of every material's Eyring exponent (`AcousticMaterial.scaled`).

    Returns:
        (6,) mean absorption in situ per octave of `OCTAVE_BANDS`; the default material's where there is no area.
    """
    area = triangle_areas(triangles)
    if not area.sum() > 0:
        return np.array(DEFAULT_MATERIAL.scaled(scale).in_situ)
    # Sorted: the sum must not depend on the order in which a set of strings is walked.
    known = {label: material_for(label).scaled(scale).in_situ for label in sorted(set(labels))}
    alpha = np.array([known[label] for label in labels])
    # Not a product of BLAS, whose last bits depend on the processor.
    return np.asarray((area[:, None] * alpha).sum(axis=0) / area.sum())


def triangle_areas(triangles: NDArray[np.floating]) -> NDArray[np.float64]:
    """(A,) areas in m² of triangles (A, 3, 3)."""
    corners = np.asarray(triangles, dtype=np.float64).reshape(-1, 3, 3)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(np.linalg.norm(cross, axis=1) / 2)


def _interleaved(values: Iterable[float]) -> list[float]:
    return [number for pair in zip(OCTAVE_BANDS, values, strict=True) for number in pair]


def engine_json(materials: Iterable[AcousticMaterial]) -> str:
    """The material database of the rlr-audio-propagation engine as JSON text.

    Every key is mandatory there. Transmission is 0: with indirect sound on, the engine overcounts transmitted energy.
    """
    return json.dumps(
        {
            "materials": [
                {
                    "name": material.label,
                    "labels": [material.label],
                    "absorption": _interleaved(material.in_situ),
                    "scattering": _interleaved(material.scattering),
                    "transmission": _interleaved([0.0] * len(OCTAVE_BANDS)),
                    "damping": _interleaved([0.0] * len(OCTAVE_BANDS)),
                    "density": 1000.0,
                    "speed": 2000.0,
                }
                for material in materials
            ]
        },
        indent=1,
    )


def write_engine_json(path: Path, materials: Iterable[AcousticMaterial] | None = None) -> None:
    """Write `engine_json` of ``materials`` (all of `MATERIALS` and the default where None) to ``path``."""
    chosen = [*MATERIALS.values(), DEFAULT_MATERIAL] if materials is None else list(materials)
    path.write_text(engine_json(chosen) + "\n", encoding="utf-8")
