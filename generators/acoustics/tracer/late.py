"""The late part: stochastic rays from the source, detected at all listeners of a trace, and diffuse rain.

One trace serves any number of listeners. The rays do not know of them: what a listener hears depends on the scene, the
source and its own position alone, not on the other listeners, nor on threads (blocks of rays, joined in order).

A listener detects the rays that pass through a disc about it that faces them. Its radius is 0.9 of the distance to the
nearest surface, so that no surface cuts it, within the limits of `TraceSettings.radius` and `_LEAST_RADIUS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.directivity import Emission
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.clearance import clearance
from generators.acoustics.tracer.early import Images
from generators.acoustics.tracer.kernels import LATE, RAIN, trace_late, trace_rain
from generators.acoustics.tracer.rays import key_of, ray_directions
from generators.acoustics.tracer.settings import TraceSettings
from generators.acoustics.tracer.surfaces import AcousticSurfaces, scratch
from generators.acoustics.tracer.tables import Listeners, Records, TraceLimits

F64 = NDArray[np.float64]

#: Rays per block; blocks are spread over threads.
_BLOCK = 500
#: Share of the distance to the nearest surface that a disc may take.
_CLEAR = 0.9
#: Smallest disc (m). A listener nearer to a surface hears up to 3 dB less of the late sound than there is.
_LEAST_RADIUS = 0.05


def trace(
    surfaces: AcousticSurfaces,
    images: Images,
    listeners: F64,
    settings: TraceSettings,
    rays: int,
    threads: int = 1,
) -> list[Arrivals]:
    """Trace ``rays`` rays from the source of ``images`` and detect them at ``listeners`` (L, 3).

    Returns:
        the late arrivals of each listener: diffuse rain, then the rays, each in the order of (ray, reflections).
    """
    around = discs(surfaces, listeners, settings.radius)
    air = energy_exponents()
    key = key_of(settings.seed)
    limits = limits_of(settings, surfaces.planes)

    def late(first: int, last: int, records: Records) -> int:
        near, energy = np.empty(len(listeners), dtype=np.bool_), np.empty(8)
        return trace_late(
            surfaces.mesh, images.source, directions, emitted, first, last, key, around, images.keys, air, limits,
            records, near, energy, *scratch(),
        )  # fmt: skip

    def rain(first: int, last: int, records: Records) -> int:
        return trace_rain(
            surfaces.mesh, images.source, rain_directions, rain_emitted, first, last, key, around, air, limits, records,
            np.empty(8), np.empty(8), *scratch(),
        )  # fmt: skip

    directions = ray_directions(rays, settings.seed, LATE)
    rain_directions = ray_directions(max(settings.rain_rays, 1), settings.seed, RAIN)
    emitted, rain_emitted = (emitted_energy(images.emission, each) for each in (directions, rain_directions))
    parts = _in_blocks(rain, settings.rain_rays if settings.rain_order else 0, len(listeners), threads)
    parts += _in_blocks(late, rays, len(listeners), threads)
    return by_listener(parts, len(listeners))


def emitted_energy(emission: Emission, directions: F64) -> F64:
    """(N, 8) energy that rays carry along ``directions`` (N, 3), 1 without a directivity."""
    if emission is None:
        return np.ones((len(directions), 8))
    return np.ascontiguousarray(emission(directions) ** 2)


def limits_of(settings: TraceSettings, planes: int) -> TraceLimits:
    """Where the rays end in a scene of so many mirror planes."""
    return TraceLimits(
        settings.most_reflections,
        settings.seconds * SPEED_OF_SOUND,
        10 ** (-settings.decay_db / 10),
        settings.exact_scattering,
        settings.rain_order if settings.rain_rays else 0,
        planes,
        settings.early_order,
    )


def discs(surfaces: AcousticSurfaces, listeners: F64, radius: float) -> Listeners:
    """The discs about ``listeners`` (L, 3)."""
    free = _CLEAR * clearance(surfaces.mesh.corners, listeners, radius / _CLEAR)
    size = np.clip(free, _LEAST_RADIUS, radius)
    bounds = np.concatenate([(listeners - size[:, None]).min(axis=0), (listeners + size[:, None]).max(axis=0)])
    x, y, z = (np.ascontiguousarray(column) for column in listeners.T)
    return Listeners(x, y, z, size * size, bounds)


def _in_blocks(
    trace_block: Callable[[int, int, Records], int], rays: int, listeners: int, threads: int
) -> list[Records]:
    """The records of all rays, block by block in order."""

    def block(first: int) -> Records:
        last = min(first + _BLOCK, rays)
        room = 50 * _BLOCK + 100 * listeners
        while True:
            records = Records(
                np.empty(room, dtype=np.int32),
                np.empty(room),
                np.empty((room, 3), dtype=np.float32),
                np.empty((room, 8), dtype=np.float32),
            )
            count = trace_block(first, last, records)
            if count <= room:
                return Records(
                    records.listener[:count].copy(),
                    records.path[:count].copy(),
                    records.direction[:count].copy(),
                    records.pressure[:count].copy(),
                )
            room = count  # the block is traced again: it is the same one

    starts = range(0, rays, _BLOCK)
    if threads == 1:
        return [block(first) for first in starts]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(block, starts))


def by_listener(parts: list[Records], listeners: int) -> list[Arrivals]:
    """Sort the records by listener, each listener's in their order; empties ``parts``."""
    if not parts:
        return [Arrivals.none()] * listeners
    listener = np.concatenate([part.listener for part in parts])
    count = len(listener)
    place = np.empty(count, dtype=np.int64)
    place[np.argsort(listener, kind="stable")] = np.arange(count)
    ends = np.cumsum(np.bincount(listener, minlength=listeners))
    time, first = np.empty(count), 0
    direction, pressure = np.empty((count, 3), dtype=np.float32), np.empty((count, 8), dtype=np.float32)
    while parts:
        part = parts.pop(0)  # its memory is free for the next ones
        there = place[first : first + len(part.path)]
        time[there], direction[there], pressure[there] = part.path / SPEED_OF_SOUND, part.direction, part.pressure
        first += len(part.path)
    spans = [slice(first, last) for first, last in zip([0, *ends[:-1]], ends, strict=True)]
    return [Arrivals(time[span], direction[span], pressure[span]) for span in spans]


def rays_for(surface_area: float, reflections: int, settings: TraceSettings) -> int:
    """Rays that give a listener the wanted number of arrivals in a room.

    N rays have N·reflections segments of 4V/S each; a disc of radius R meets N·reflections·(4V/S)·πR²/V of them.

    Args:
        surface_area: m², furniture included.
        reflections: of a ray.
        settings: the wanted arrivals, the radius, the limits.
    """
    per_ray = reflections * 4 * math.pi * settings.radius**2 / surface_area
    return int(min(max(math.ceil(settings.arrivals / per_ray), settings.least_rays), settings.most_rays))
