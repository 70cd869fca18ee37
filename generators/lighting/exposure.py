"""The exposure of each room: how a photographer would set the camera."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from generators.core.arrays import dot_rows
from generators.core.scene import Room, Scene
from generators.core.tone import LUMINANCE, inverse_tone_curve
from generators.lighting.lit_scene import LitScene

#: Display light (linear) at which a room's mean tone is shown.
MEAN_TONE = 0.31
#: At most this part of a room's pictures, windows and lamps apart, may be brighter than `HIGHLIGHT`.
_BRIGHT_PART = 0.03
HIGHLIGHT = 0.93
_EYE_HEIGHT = 1.5
_GRID = 4
_TURNS = 8
_SIDE = 24


def expose(scene: Scene, lit: LitScene | None = None, workers: int = 1) -> Scene:
    """The scene whose rooms have the exposure that suits their light; ``lit`` is the same scene, if it is loaded.

    Pictures of 90° are taken from a grid of places in each room, at eye height, all round. Their log-average (the key
    of the scene: Reinhard et al. 2002) is shown at `MEAN_TONE`, darker if too much of the room would burn out. Rooms
    from which nothing lit is seen keep their exposure.
    """
    if not scene.rooms:
        return scene
    loaded = lit or LitScene.of(scene.parts)
    with ThreadPoolExecutor(workers) as pool:
        exposures = list(pool.map(lambda room: _exposure(loaded, room), scene.rooms))
    rooms = tuple(replace(room, exposure=own) for room, own in zip(scene.rooms, exposures, strict=True))
    return replace(scene, rooms=rooms)


def _exposure(lit: LitScene, room: Room) -> float:
    low, high = np.array(room.low), np.array(room.high)
    share = (np.arange(_GRID) + 0.5) / _GRID
    x, z = np.meshgrid(low[0] + share * (high[0] - low[0]), low[2] + share * (high[2] - low[2]), indexing="ij")
    eyes = np.stack([x.ravel(), np.full(x.size, min(low[1] + _EYE_HEIGHT, high[1] - 0.1)), z.ravel()], axis=1)
    plane = (np.arange(_SIDE) + 0.5) / _SIDE * 2 - 1
    right, up = np.meshgrid(plane, plane, indexing="ij")
    yaw = np.arange(_TURNS) * 2 * np.pi / _TURNS
    ahead = np.stack([np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)], axis=1)
    side = np.stack([np.cos(yaw), np.zeros_like(yaw), -np.sin(yaw)], axis=1)
    rays = ahead[:, None] + right.ravel()[None, :, None] * side[:, None]
    rays[..., 1] = up.ravel()[None]
    directions = np.tile(rays.reshape(-1, 3), (len(eyes), 1)).astype(np.float32)
    origins = np.repeat(eyes, rays.shape[0] * rays.shape[1], axis=0).astype(np.float32)
    hits = lit.tracer.intersect(origins, directions)
    luminance = dot_rows(lit.reflected(hits["primID"], hits["u"], hits["v"]), LUMINANCE)
    # What glows is left out: a window is bright whatever one does. So is what a camera inside of a cupboard sees.
    shows = lit.front(hits, directions) & (lit.emitted(hits).max(axis=1) <= 0) & (luminance > 0)
    if not shows.any():
        return room.exposure
    seen = luminance[shows].astype(np.float64)
    floor = 1e-3 * np.median(seen)
    mean = float(np.exp(np.mean(np.log(np.maximum(seen, floor)))))
    bright = float(np.quantile(seen, 1 - _BRIGHT_PART))
    return min(float(inverse_tone_curve(MEAN_TONE)) / mean, float(inverse_tone_curve(HIGHLIGHT)) / bright)
