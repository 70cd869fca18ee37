"""Where one ray per pixel is not enough, and where within a pixel further rays go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.core.rays import CHUNK, Tracer
from generators.core.scene import F32

#: Solids and gaps narrower than this, in metres, can fall between two rays: a pixel of a 1008-pixel, 90° camera
#: covers 2 mm per metre of distance, so that 3 cm are a pixel and a half at 7.5 m.
THIN_SOLID = 0.03
THIN_GAP = 0.01
#: Where thickness is measured from, metres off the face, so that it does not meet itself.
_LIFT = 1e-5


#: (8, 2) rays of a pixel at an edge, in pixels right and down from its corner: Direct3D's standard pattern of eight
#: samples (D3D11_STANDARD_MULTISAMPLE_PATTERN). No two share a column or a row of the 8 × 8 grid, so that nearly
#: horizontal and vertical edges get all nine levels; and few lie on a common line in any other direction. (Probing with
#: four and adding four where those disagree saves a twentieth of a frame's time and loses parts of thin wires.)
SUB_PIXELS: NDArray[np.float64] = (
    np.array([[1, -3], [-1, 3], [5, 1], [-3, -5], [-5, 5], [-7, -1], [3, 7], [7, -7]], dtype=np.float64) + 8
) / 16

#: (4, 2) the same for faint edges, in Direct3D's standard pattern of four: a quarter of their contrast is hard to see.
FEW_SUB_PIXELS: NDArray[np.float64] = (np.array([[-2, -6], [6, -2], [-6, 2], [2, 6]], dtype=np.float64) + 8) / 16


def thin_faces(triangles: F32, normals: F32, tracer: Tracer) -> NDArray[np.bool_]:
    """Which faces bound a thin solid or a narrow gap: wires, rims, boards, joints.

    Measured with one ray from the middle of each face into the solid and one out of it. The rounded edge of a big box
    is a strip of narrow faces, too, but thick: nothing gets lost there.

    Args:
        triangles: (F, 3, 3) metres.
        normals: (F, 3) unit normals.
        tracer: over ``triangles``.

    Returns:
        (F,) bool.
    """
    out = np.zeros(len(triangles), dtype=np.bool_)
    for first in range(0, len(triangles), CHUNK):
        block = slice(first, first + CHUNK)
        normal = np.ascontiguousarray(normals[block])
        middle = triangles[block].mean(axis=1, dtype=np.float32)
        for sign, limit in ((-1.0, THIN_SOLID), (1.0, THIN_GAP)):
            along = np.float32(sign) * normal
            start = np.ascontiguousarray(middle + np.float32(_LIFT) * along)
            reach = np.full(len(along), limit, dtype=np.float32)
            out[block] |= tracer.occluded(start, along, reach)
    # A face without area has no normal, hence no direction to measure along.
    out &= normals.any(axis=1)
    return out
