"""The exposure and the white balance of each room: how a photographer would set the camera."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from generators.core.arrays import dot_rows
from generators.core.scene import Room, Scene
from generators.core.tone import LUMINANCE, inverse_tone_curve
from generators.lighting.lit_scene import LitScene

#: Display light (linear) at which a room's mean tone is shown.
MEAN_TONE = 0.26
#: At most this part of a room's pictures, windows and lamps apart, may be brighter than `HIGHLIGHT`.
_BRIGHT_PART = 0.03
HIGHLIGHT = 0.9
_EYE_HEIGHT = 1.5
_GRID = 4
_TURNS = 8
_SIDE = 24
#: Where in a room its light is balanced: shares of its width and depth.
_MIDDLE = np.array([0.375, 0.625])
#: Rays in all directions from each of these places.
_RAYS = 8192
#: Bounds of the ratio of two gains of the white balance; those of cameras reach from about 2500 K to 10000 K.
_MOST_GAIN = 3.0


def expose(scene: Scene, lit: LitScene | None = None, workers: int = 1) -> Scene:
    """The scene whose rooms have the exposure and white balance for their light; ``lit``: the same scene, if loaded.

    Pictures of 90° are taken from a grid of places in each room, at eye height, all round. Their log-average (the key
    of the scene: Reinhard et al. 2002) is shown at `MEAN_TONE`, darker if too much of the room would burn out. Rooms
    from which nothing lit is seen keep their exposure.

    The white balance makes a grey card neutral that turns to all sides in the middle of the room: its gains are the
    inverse of the mean radiance that arrives there from everywhere, windows and lamps included, scaled together so that
    the luminance of this light stays.
    """
    if not scene.rooms:
        return scene
    loaded = lit or LitScene.of(scene.parts)
    with ThreadPoolExecutor(workers) as pool:
        rooms = tuple(pool.map(lambda room: _balanced(loaded, _exposed(loaded, room)), scene.rooms))
    return replace(scene, rooms=rooms)


def _eyes(room: Room, share: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n², 3) places in a room at eye height, at the shares (n,) of its width and depth."""
    low, high = np.array(room.low), np.array(room.high)
    x, z = np.meshgrid(low[0] + share * (high[0] - low[0]), low[2] + share * (high[2] - low[2]), indexing="ij")
    return np.stack([x.ravel(), np.full(x.size, min(low[1] + _EYE_HEIGHT, high[1] - 0.1)), z.ravel()], axis=1)


def _balanced(lit: LitScene, room: Room) -> Room:
    """The room with its white balance."""
    eyes = _eyes(room, _MIDDLE)
    # A spiral over the sphere (A. González, "Measurement of areas on a sphere using Fibonacci and latitude-longitude
    # lattices", Mathematical Geosciences 42, 2010).
    up = 1 - (2 * np.arange(_RAYS) + 1) / _RAYS
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(_RAYS)
    ring = np.sqrt(1 - up * up)
    sphere = np.stack([ring * np.cos(turn), up, ring * np.sin(turn)], axis=1)
    directions = np.tile(sphere, (len(eyes), 1)).astype(np.float32)
    hits = lit.tracer.intersect(np.repeat(eyes, _RAYS, axis=0).astype(np.float32), directions)
    radiance = lit.reflected(hits["primID"], hits["u"], hits["v"]) + lit.emitted(hits)
    arrives = radiance[lit.front(hits, directions)].mean(axis=0, dtype=np.float64)
    if not arrives.min() > 0:
        return room
    gains = 1 / arrives
    gains = np.clip(gains / gains[1], 1 / _MOST_GAIN, _MOST_GAIN)
    gains *= float(LUMINANCE @ arrives) / float(LUMINANCE @ (gains * arrives))
    return replace(room, white=(float(gains[0]), float(gains[1]), float(gains[2])))


def _exposed(lit: LitScene, room: Room) -> Room:
    """The room with its exposure."""
    eyes = _eyes(room, (np.arange(_GRID) + 0.5) / _GRID)
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
        return room
    seen = luminance[shows].astype(np.float64)
    floor = 1e-3 * np.median(seen)
    mean = float(np.exp(np.mean(np.log(np.maximum(seen, floor)))))
    bright = float(np.quantile(seen, 1 - _BRIGHT_PART))
    exposure = min(float(inverse_tone_curve(MEAN_TONE)) / mean, float(inverse_tone_curve(HIGHLIGHT)) / bright)
    return replace(room, exposure=exposure)
