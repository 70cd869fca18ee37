"""First-order diffraction at edges: the exact impulse response of a rigid wedge, integrated along the edge.

Every point of an edge is a secondary source (U. P. Svensson, R. I. Fred, J. Vanderkooy, "An analytic secondary source
model of edge diffraction impulse responses", JASA 106 (1999) 2331–2344, eqs. 10 to 13; it agrees with the solution of
Biot and Tolstoy for infinite edges, as extended to finite ones by Medwin). A response is a sequence of short arrivals
in the order of their times; coarse ones, late after the onset, are heard in the low octaves alone.

What is computed: paths from the source over one edge to the listener where the edge hides the source, and a little
beyond, so that the level is continuous across the shadow's boundary: from 1/r in the light by half of it on the
boundary down into the shadow. Farther into the light an edge is left out, as are paths over two edges and over an edge
and a wall. Of the parallel edges of a thin body (a wall's end, a table top) only the loudest counts: each alone stands
for the whole body, and together they would be twice as loud.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.directivity import Emission
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.edges import Edges
from generators.acoustics.tracer.kernels import free_lines
from generators.acoustics.tracer.surfaces import AcousticSurfaces, scratch
from generators.core.jit import njit

F64 = NDArray[np.float64]

#: Angle from the shadow's boundary into the light (radians) up to which an edge counts in full, and from which not.
_FULL, _NONE = 0.25, 0.5
#: Spacing of the points of an edge that are tested for visibility (m).
_SPACING = 0.1
#: Shortest arrival (s): half a period at 12.5 kHz; doubled after every `_PER_OCTAVE` arrivals.
_SHORTEST, _PER_OCTAVE = 4e-5, 16
#: Most arrivals of an edge: the last ones are 5 ms long, and the whole lasts 160 ms.
_CELLS = 8 * _PER_OCTAVE
#: Share of a period that an arrival may last to be heard in an octave.
_COHERENT = 0.5
#: Steps of the integration along an edge: logarithmic near its apex up to this distance (m), even beyond it.
_NEAR, _STEP = 0.05, 0.01
#: Amplitude relative to the direct sound of a free path as long below which an edge is left out: −50 dB.
_FAINTEST = 10 ** (-50 / 20)
#: Parallel edges (cosine of the angle between them) nearer than this (m) are those of one thin body.
_PARALLEL, _THIN = 0.99, 0.3
#: Angle (radians) that rounding does not exceed.
_SLACK = 1e-6
#: Visible ends short of the surface that the edge lies on (m).
_SHORT = 2e-3


@dataclass(frozen=True, eq=False)
class LitEdges:
    """The edges as one source sees them.

    Attributes:
        edges: all of them.
        source: (3,).
        radius: (E,) distance of the source from each edge's line.
        angle: (E,) of the source from the first face.
        place: (E,) of the source along the edge.
        seen: per edge, whether each of its points is visible from the source; None: not asked yet.
        emission: what the source sends out in each direction; None: 1 in all.
    """

    edges: Edges
    source: F64
    radius: F64
    angle: F64
    place: F64
    seen: dict[int, NDArray[np.bool_]]
    emission: Emission = None


def lit_edges(edges: Edges, source: F64, emission: Emission = None) -> LitEdges:
    """Prepare the edges for a source."""
    return LitEdges(edges, source, *edges.cylindrical(source), {}, emission)


def _points(edges: Edges, e: int) -> F64:
    """(K, 3) the middles of the pieces of an edge that are visible or not."""
    count = max(1, round(float(edges.length[e]) / _SPACING))
    place = (np.arange(count) + 0.5) / count * edges.length[e]
    return np.asarray(edges.start[e] + place[:, None] * edges.along[e])


def diffracted(surfaces: AcousticSurfaces, lit: LitEdges, listener: F64) -> Arrivals:
    """The arrivals at ``listener`` (3,) over one edge each."""
    edges = lit.edges
    if not len(edges):
        return Arrivals.none()
    radius, angle, place = edges.cylindrical(listener)
    into_light = np.pi - np.abs(angle - lit.angle)
    exposed = (np.maximum(angle, lit.angle) < edges.opening) & (into_light < _NONE)
    exposed &= (np.minimum(radius, lit.radius) > _SHORT) & (np.minimum(angle, lit.angle) > 0)
    found: list[tuple[float, int, Arrivals]] = []
    for e in np.flatnonzero(exposed).tolist():
        seen = _visible(surfaces, lit, e, listener)
        if not seen.any():
            continue
        cells = np.zeros((_CELLS, 2))
        geometry = (lit.radius[e], lit.angle[e], lit.place[e], radius[e], angle[e], place[e])
        least = _integrate(*geometry, float(edges.length[e]), float(edges.opening[e]), seen, cells)
        taper = 0.5 + 0.5 * math.cos(math.pi * min(max((into_light[e] - _FULL) / (_NONE - _FULL), 0.0), 1.0))
        amplitude = taper * abs(float(cells[:, 0].sum()))
        if amplitude * least > _FAINTEST:
            found.append((-amplitude, e, _arrivals(lit, e, cells, least, taper, listener)))
    used: list[int] = []
    for _, e, _ in sorted(found, key=lambda each: each[:2]):
        if not any(_are_one(edges, e, other) for other in used):
            used.append(e)
    return Arrivals.joined([arrivals for _, e, arrivals in found if e in used])


def diffracted_at(surfaces: AcousticSurfaces, lit: LitEdges, listeners: F64) -> list[Arrivals]:
    """`diffracted` at each of ``listeners`` (L, 3): those that no edge can reach are found together."""
    edges = lit.edges
    if not len(edges):
        return [Arrivals.none()] * len(listeners)
    offset = [listeners[:, axis, None] - edges.start[:, axis] for axis in range(3)]
    x, y = (
        offset[0] * axes[:, 0] + offset[1] * axes[:, 1] + offset[2] * axes[:, 2] for axes in (edges.face, edges.side)
    )
    angle = np.mod(np.arctan2(y, x), 2 * np.pi)
    # With a little room for rounding: `diffracted` looks again.
    near = (angle < edges.opening + _SLACK) & (lit.angle < edges.opening + _SLACK)
    near &= np.pi - np.abs(angle - lit.angle) < _NONE + _SLACK
    near &= lit.radius > _SHORT
    return [
        diffracted(surfaces, lit, listener) if some else Arrivals.none()
        for listener, some in zip(listeners, np.asarray(near.any(axis=1)), strict=True)
    ]


def _are_one(edges: Edges, e: int, other: int) -> bool:
    """Whether two edges are those of one thin body and lie beside each other, or are the same edge of two meshes."""
    a, b = edges.along[e], edges.along[other]
    if abs(float(a @ b)) < _PARALLEL:
        return False
    offset = edges.start[other] - edges.start[e]
    place = np.sort([float(offset @ a), float(offset @ a + edges.length[other] * (b @ a))])
    across = float(np.linalg.norm(offset - (offset @ a) * a))
    return across < _THIN and bool(place[0] < edges.length[e] and place[1] > 0.0)


def _visible(surfaces: AcousticSurfaces, lit: LitEdges, e: int, listener: F64) -> NDArray[np.bool_]:
    """Whether each piece of an edge is visible from both ends of the path."""
    points = _points(lit.edges, e)
    if e not in lit.seen:
        lit.seen[e] = np.empty(len(points), dtype=np.bool_)
        free_lines(surfaces.mesh, lit.source, points, _SHORT, lit.seen[e], *scratch())
    seen = np.empty(len(points), dtype=np.bool_)
    if lit.seen[e].any():
        free_lines(surfaces.mesh, listener, points, _SHORT, seen, *scratch())
        seen &= lit.seen[e]
        return seen
    return lit.seen[e]


def _cell_starts() -> F64:
    """(C,) delay in s after the onset at which each arrival begins."""
    length = _SHORTEST * 2.0 ** (np.arange(_CELLS) // _PER_OCTAVE)
    return np.concatenate([[0.0], np.cumsum(length)[:-1]])


def _arrivals(lit: LitEdges, e: int, cells: F64, least: float, taper: float, listener: F64) -> Arrivals:
    """Arrivals from the integral of each cell: its amplitude, and its amplitude times the place on the edge."""
    edges, used = lit.edges, np.flatnonzero(np.abs(cells[:, 0]) > 0)
    starts, length = _cell_starts()[used], _SHORTEST * 2.0 ** (used // _PER_OCTAVE)
    amplitude = taper * cells[used, 0]
    place = np.clip(cells[used, 1] / cells[used, 0], 0.0, edges.length[e])
    point = edges.start[e] + place[:, None] * edges.along[e]
    offset = point - listener
    direction = offset / np.linalg.norm(offset, axis=1)[:, None]
    # The onset is sharp: its cell is heard at its beginning.
    distance = least + SPEED_OF_SOUND * (starts + np.where(used > 0, length / 2, 0.0))
    heard = length[:, None] * np.array(BANDS) < _COHERENT
    pressure = amplitude[:, None] * heard * np.exp(-0.5 * np.outer(distance, energy_exponents()))
    if lit.emission is not None:
        left = point - lit.source
        pressure *= lit.emission(left / np.linalg.norm(left, axis=1)[:, None])
    # On the shadow's boundary it continues the direct sound, whose wave front is a sphere about the source.
    spherical = np.ones(len(distance), dtype=np.bool_)
    return Arrivals(distance / SPEED_OF_SOUND, direction.astype(np.float32), pressure.astype(np.float32), spherical)


@njit
def _integrate(
    r_source: float,
    a_source: float,
    z_source: float,
    r_listener: float,
    a_listener: float,
    z_listener: float,
    length: float,
    opening: float,
    seen: NDArray[np.bool_],
    cells: F64,
) -> float:
    """Integrate −ν/(4π)·Σβ/(m·l) along an edge into ``cells`` (C, 2): amplitude, and amplitude times place.

    β = sin(νφ)/(cosh(νη) − cos(νφ)) for the four angles φ = π ± θ_S ± θ_R; ν = π over the opening of the wedge; m and l
    the distances of a point of the edge from source and listener; cosh η = (m·l + (z − z_S)·(z − z_R))/(r_S·r_R).

    Returns:
        the path of the onset in m: by way of the nearest point of the edge.
    """
    nu = np.pi / opening
    # The point of the shortest path: both ends in one plane, unfolded.
    apex = (z_source * r_listener + z_listener * r_source) / (r_source + r_listener)
    apex = min(max(apex, 0.0), length)
    least = math.sqrt(r_source**2 + (apex - z_source) ** 2) + math.sqrt(r_listener**2 + (apex - z_listener) ** 2)
    finest = 1e-6
    ratio = 1.06
    for side in (-1.0, 1.0):
        extent = apex if side < 0.0 else length - apex
        done, step = 0.0, finest
        while done < extent - 1e-12:
            width = min(step, extent - done)
            z = apex + side * (done + 0.5 * width)
            done += width
            step = min((ratio - 1.0) * done + finest, _STEP) if done < _NEAR else _STEP
            piece = min(int(z / length * len(seen)), len(seen) - 1)
            if not seen[piece]:
                continue
            m = math.sqrt(r_source**2 + (z - z_source) ** 2)
            l = math.sqrt(r_listener**2 + (z - z_listener) ** 2)  # noqa: E741 (the paper's letter)
            y = max((m * l + (z - z_source) * (z - z_listener)) / (r_source * r_listener), 1.0)
            eta = nu * math.log(y + math.sqrt(y * y - 1.0))
            cosh = 0.5 * (math.exp(eta) + math.exp(-eta))
            beta = 0.0
            for i in range(4):
                phi = np.pi + (a_source if i < 2 else -a_source) + (a_listener if i % 2 == 0 else -a_listener)
                below = cosh - math.cos(nu * phi)
                if below > 1e-15:
                    beta += math.sin(nu * phi) / below
            amount = -nu / (4.0 * np.pi) * beta / (m * l) * width
            delay = max(m + l - least, 0.0) / SPEED_OF_SOUND
            # Cells double in length after every _PER_OCTAVE of them.
            octave = int(math.log2(delay / (_SHORTEST * _PER_OCTAVE) + 1.0))
            start = _SHORTEST * _PER_OCTAVE * (2.0**octave - 1.0)
            cell = octave * _PER_OCTAVE + int((delay - start) / (_SHORTEST * 2.0**octave))
            if cell < len(cells):
                cells[cell, 0] += amount
                cells[cell, 1] += amount * z
    return least
