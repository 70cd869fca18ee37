"""Materials of OBJ files (MTL) in terms of glTF's model.

- ``Ns`` is the exponent n of Blinn and Phong: α = √(2/(n + 2)) (Walter et al., "Microfacet models for refraction
  through rough surfaces", EGSR 2007, section 5.2), and glTF's roughness is √α. ``Pr`` states the roughness itself.
- ``Ks`` of 0, or ``illum`` 0 or 1, is a matte surface. Else its value is not read: all dielectrics reflect 4 %.
- ``Pm`` is the metallic, ``Pc`` the clearcoat, ``Ke`` the emission in the scene's light unit.
- ``d``, or 1 − ``Tr``, is the opacity: the rest of the light is transmitted, as by a pane.
- ``norm`` and ``map_Bump`` are not read.

The statements that begin with P, and ``Ke``, are the usual extension of MTL for physically based materials.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError

#: Roughness of a material that says nothing about it: satin paint.
ROUGHNESS = 0.64
_MATTE_MODELS = (0, 1)
#: Statements that are written in lower case.
_LOWER = ("d", "illum")


def mtl_look(file: Path, source: Any, title: str) -> dict[str, Any]:
    """Attributes of a `Material`, besides its colour, of one of the reader's materials.

    Raises:
        Avs3dError: if a statement has no number in its range.
    """
    said = statements(source)

    def number(key: str, default: float, most: float = 1.0) -> float:
        values = said.get(key)
        if values is None:
            return default
        if not len(values) or not 0 <= values[-1] <= most:
            name = key if key in _LOWER else key.capitalize()
            raise Avs3dError(
                f"{file}: material {title!r}: its {name} is {source.kwargs.get(key)}; expected a number "
                f"{'≥ 0' if most == math.inf else f'from 0 to {most:g}'}; correct the material library"
            )
        return float(values[-1])

    glow = said.get("ke", np.zeros(3))
    if len(glow) != 3 or not (np.isfinite(glow) & (glow >= 0)).all():
        raise Avs3dError(f"{file}: material {title!r}: its Ke is {glow}; expected three numbers ≥ 0")
    exponent = number("ns", math.nan, math.inf)
    matte = ("ks" in said and not said["ks"].any()) or number("illum", 2, 10) in _MATTE_MODELS
    rough = 1.0 if matte else ROUGHNESS if math.isnan(exponent) else roughness_of(exponent)
    opacity = number("d", 1.0 - number("tr", 0.0))
    return {
        "roughness": number("pr", rough),
        "metallic": number("pm", 0.0),
        "clearcoat": number("pc", 0.0),
        "emission": tuple(glow.tolist()),
        "transmission": 1.0 - opacity,
    }


def roughness_of(exponent: float) -> float:
    """GlTF's roughness of the exponent (≥ 0) of a Blinn–Phong highlight."""
    return float((2.0 / (exponent + 2.0)) ** 0.25)


def statements(source: Any) -> dict[str, NDArray[np.float64]]:
    """The numbers of each statement of a material, by its name in lower case; none if they are no numbers."""
    out = {}
    for key, value in (getattr(source, "kwargs", None) or {}).items():
        try:
            out[key] = np.atleast_1d(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError):
            out[key] = np.zeros(0)
    return out
