"""How much of a specular path a surface of finite size carries: its share of the path's first Fresnel zone.

A reflection does not end at the rim of its surface. What reaches the listener comes from a zone about the point of
reflection, whose half-width in octave f is √(c/f·d₁·d₂/(d₁ + d₂)) across the path, d₁ and d₂ metres along it to both
ends. The factor of the amplitude is the integral over the surface of a normal distribution about that point: ½ at a
straight rim, with the slope that Fresnel's knife edge has there (J. H. Rindel, "Attenuation of sound reflections due to
diffraction", Nordic Acoustical Meeting 1986, 257–260, for the panel and its zones), 1 well inside, 0 well outside, and
without the ripples of the integral of one frequency. Factors of surfaces that continue each other in one plane add up
to 1. A surface that stands in the way of a path hides as much of it as it would carry (Babinet's principle).

In the plane across the path, the integral over a polygon is that over its rim,
1/(2π)·∮ (1 − exp(−ρ²/2σ²)) dφ, with polar coordinates about the path: rims that do not end the surface (a corner of
the room, from inside) are left out of the second term, as if the surface went on behind them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.tables import Rims
from generators.core.jit import inline

F64 = NDArray[np.float64]

#: Octave bands, how many of them have a zone as wide as the last of these, and its centre (Hz); the others have twice
#: the frequency of the one before. Below, a room has modes, and zones are wider than its furniture.
_BANDS, _WIDE, _LOWEST = 8, 3, 250.0
#: A rim farther away than this many standard deviations, in the lowest octave, changes nothing.
#: There its share is 1 %.
_REACH = 2.33
#: Amplitude below which a path is left out (−26 dB of what it has on a large surface).
LEAST_SHARE = 0.05
#: Within this distance (m) of the end of a leg a surface is the one that it ends on.
_END = 1e-3
#: The faces of a body as thin as this (m) along a path are one obstacle.
_THIN = 0.1
#: Nodes and weights of the integral along a rim (Gauss and Legendre), over (−1, 1).
_NODES = tuple(float(each) for each in np.polynomial.legendre.leggauss(8)[0])
_WEIGHTS = tuple(float(each) for each in np.polynomial.legendre.leggauss(8)[1])
#: Sides of a surface from which a rim may end it: that of the normal, the other one, any.
FRONT, BACK, ANY = 0, 1, 2


@inline
def zone_variance(before: float, behind: float) -> float:
    """Variance (m²) of the zone in the lowest octave; metres of the path to both ends.

    With v = x·√(2·(d₁ + d₂)/(λ·d₁·d₂)), the knife edge's amplitude falls by ½ per unit of v at the rim: σ_v = √(2/π).
    """
    # On the end of a path the zone is a point; the least keeps numbers finite.
    return max(SPEED_OF_SOUND / _LOWEST / math.pi * before * behind / max(before + behind, 1e-12), 1e-12)


@inline
def carried(
    rims: Rims,
    plane: int,
    side: int,
    x: float,
    y: float,
    z: float,
    dx: float,
    dy: float,
    dz: float,
    variance: float,
    share: F64,
) -> bool:
    """Write into ``share`` (8,) how much of a path through (x, y, z) along d the surface of a plane carries.

    Args:
        rims: of all planes.
        plane: its number.
        side: that the rims must end: `FRONT`, `BACK` or `ANY`.
        x: where the path meets the plane, m.
        y: the same.
        z: the same.
        dx: unit direction of the path.
        dy: the same.
        dz: the same.
        variance: of the zone in the lowest octave, m².
        share: filled in.

    Returns:
        whether a rim is near enough to matter; without one, all shares are 1 or 0.
    """
    # Two axes across the path (T. Duff et al., JCGT 6 (2017)).
    sign = math.copysign(1.0, dz)
    a = -1.0 / (sign + dz)
    b = dx * dy * a
    ux, uy, uz = 1.0 + sign * dx * dx * a, sign * b, -sign * dx
    vx, vy, vz = b, sign + dy * dy * a, -dy
    for k in range(_BANDS):
        share[k] = 0.0
    turns, near = 0, False
    reach2 = _REACH * _REACH * variance
    for e in range(rims.first[plane], rims.first[plane + 1]):
        rx, ry, rz = rims.ends[e, 0] - x, rims.ends[e, 1] - y, rims.ends[e, 2] - z
        px, py = rx * ux + ry * uy + rz * uz, rx * vx + ry * vy + rz * vz
        rx, ry, rz = rims.ends[e, 3] - x, rims.ends[e, 4] - y, rims.ends[e, 5] - z
        qx, qy = rx * ux + ry * uy + rz * uz, rx * vx + ry * vy + rz * vz
        cross = px * qy - py * qx
        # On which side of the edge the path is; on the edge, the side for which the number of turns counts it.
        left = cross > 0.0 or (cross == 0.0 and (qy <= 0.0 < py or (qx > px and (py <= 0.0) == (qy <= 0.0))))
        if py <= 0.0 < qy and left:
            turns += 1
        elif qy <= 0.0 < py and not left:
            turns -= 1
        if not rims.ends_surface[e, side]:
            continue
        ex, ey = qx - px, qy - py
        length = math.sqrt(ex * ex + ey * ey)
        if length < 1e-9:
            continue
        ex, ey = ex / length, ey / length
        low, high = px * ex + py * ey, qx * ex + qy * ey
        height = abs(cross) / length
        beside = max(max(low, -high), 0.0)
        if height * height + beside * beside >= reach2:
            continue
        near = True
        first, last = math.atan2(low, height), math.atan2(high, height)
        middle, half = 0.5 * (first + last), 0.5 * (last - first)
        exponent = -0.5 * height * height / variance
        scale = (-half if left else half) / (2.0 * math.pi)
        for i in range(len(_NODES)):
            cosine = math.cos(middle + half * _NODES[i])
            value = math.exp(exponent / (cosine * cosine))
            for k in range(_BANDS):
                if k >= _WIDE:
                    value *= value
                share[k] += scale * _WEIGHTS[i] * value
    # A surface seen from behind has its rims the other way round.
    inside = 1.0 if turns != 0 else 0.0
    facing = rims.normal[plane, 0] * dx + rims.normal[plane, 1] * dy + rims.normal[plane, 2] * dz
    turned = 1.0 if facing > 0.0 else -1.0
    for k in range(_BANDS):
        share[k] = min(max(inside + turned * share[k], 0.0), 1.0)
    return near


@inline
def most_left(factor: F64, passing: F64) -> float:
    """The largest product of two factors (8,) of the octaves."""
    most = 0.0
    for k in range(_BANDS):
        most = max(most, factor[k] * passing[k])
    return most


@inline
def may_touch(rims: Rims, plane: int, x: float, y: float, z: float, cosine: float, variance: float) -> bool:
    """Whether the zone about (x, y, z) of a path at this angle (cosine to the normal) may reach a plane's surface."""
    reach = _REACH * math.sqrt(variance) / max(abs(cosine), 1e-3) if rims.is_open[plane] else 0.0
    reach += _END
    return bool(
        rims.bounds[plane, 0] - reach <= x <= rims.bounds[plane, 3] + reach
        and rims.bounds[plane, 1] - reach <= y <= rims.bounds[plane, 4] + reach
        and rims.bounds[plane, 2] - reach <= z <= rims.bounds[plane, 5] + reach
    )


@inline
def obstructed(
    rims: Rims,
    offsets: F64,
    own: int,
    other: int,
    x: float,
    y: float,
    z: float,
    dx: float,
    dy: float,
    dz: float,
    length: float,
    travelled: float,
    total: float,
    at: float,
    share: F64,
    factor: F64,
    passing: F64,
) -> bool:
    """Lower ``passing`` (8,) to what the surfaces whose rims are near a leg of a path let pass of it.

    Of several surfaces in the way the one that hides most counts: those of one body are behind each other.

    Args:
        rims: of all planes.
        offsets: (P, 4) equations of the planes.
        own: plane that the leg begins on, or −1.
        other: plane that the leg ends on, or −1.
        x: where the leg begins, m.
        y: the same.
        z: the same.
        dx: unit direction of the leg.
        dy: the same.
        dz: the same.
        length: of the leg, m.
        travelled: metres of the path before the leg.
        total: length of the path, m.
        at: only surfaces within `_THIN` of this place on the leg (m) count; below 0: all of the leg.
        share: (8,) scratch.
        factor: (8,) what the surfaces carry of the path: where nothing of it passes, no more is looked for.
        passing: changed.

    Returns:
        whether there is such a surface.
    """
    found = False
    for i in range(len(rims.open_planes)):
        p = rims.open_planes[i]
        # Not `p in (own, other)`, whose tuple takes a quarter of a second to compile.
        is_end = p == own
        if is_end or p == other:
            continue
        cosine = rims.normal[p, 0] * dx + rims.normal[p, 1] * dy + rims.normal[p, 2] * dz
        if abs(cosine) < 1e-9:
            continue
        height = rims.normal[p, 0] * x + rims.normal[p, 1] * y + rims.normal[p, 2] * z - offsets[p, 3]
        t = -height / cosine
        if t < _END or t > length - _END or (at >= 0.0 and abs(t - at) > _THIN):
            continue
        px, py, pz = x + t * dx, y + t * dy, z + t * dz
        variance = zone_variance(travelled + t, total - travelled - t)
        if not may_touch(rims, p, px, py, pz, cosine, variance):
            continue
        if carried(rims, p, ANY, px, py, pz, dx, dy, dz, variance, share):
            found = True
            for k in range(_BANDS):
                passing[k] = min(passing[k], 1.0 - share[k])
            if most_left(factor, passing) < LEAST_SHARE:
                return True
    return found
