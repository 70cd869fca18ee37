"""Direct light of emitters on texels.

The light of an emitter on a texel is its unoccluded form factor, in closed form or summed over fine cells, times the
visible share of it, estimated with stratified shadow rays. Where an emitter is fully visible or fully hidden the
result therefore has no sampling noise at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import njit
from generators.core.scene import F32, I32
from generators.lighting.emitters import Emitters
from generators.lighting.form_factors import unoccluded_light

#: An emitter that could give less than this part of a texel's direct light gets fewer shadow rays.
_FAINT = 0.08


@njit
def _shadow_rays(
    texel: Any,
    light: Any,
    pattern: Any,
    position: Any,
    normal: Any,
    points: Any,
    first: Any,
    last: Any,
    origins: Any,
    directions: Any,
    far: Any,
    weight: Any,
) -> Any:
    row = 0
    for i in range(len(texel)):
        t, e = texel[i], light[i]
        p = pattern[t]
        for k in range(first, last):
            here = there = square = 0.0
            for c in range(3):
                d = points[e, p, k, c] - position[t, c]
                origins[row, c] = position[t, c]
                directions[row, c] = d
                here += d * normal[t, c]
                there -= d * points[e, p, k, 3 + c]
                square += d * d
            if here > 0.0 and there > 0.0:
                glow = points[e, p, k, 6] + points[e, p, k, 7] + points[e, p, k, 8]
                weight[row] = glow * here * there / (square * (square + 1e-4))
                # The ray ends 2 mm before the emitter, which would stop it.
                far[row] = max(1.0 - 0.002 / np.sqrt(square), 0.5)
            else:
                weight[row] = 0.0
                far[row] = 0.0
            row += 1


def shadow_rays(
    emitters: Emitters,
    texel: NDArray[np.int64],
    light: NDArray[np.int64],
    pattern: I32,
    position: F32,
    normal: F32,
    first: int,
    last: int,
) -> tuple[F32, F32, F32, F32]:
    """Rays from texels to emitters: origins, directions (to the target), far limits, weights; last − first per pair."""
    count = len(texel) * (last - first)
    origins, directions = np.empty((count, 3), dtype=np.float32), np.empty((count, 3), dtype=np.float32)
    far, weight = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    _shadow_rays(
        texel, light, pattern, position, normal, emitters.points, first, last, origins, directions, far, weight
    )
    return origins, directions, far, weight


#: Says for N rays (origins, directions, far) which of them meet something.
Occlusion = Callable[[F32, F32, F32], NDArray[np.bool_]]


def direct_light(
    emitters: Emitters,
    reach: NDArray[np.bool_],
    pattern: I32,
    position: F32,
    normal: F32,
    gloss: F32,
    hidden: Occlusion,
    besides: F32 | None = None,
    rays: int | None = None,
) -> tuple[F32, F32]:
    """Light of all emitters on some texels.

    Args:
        emitters: the lights.
        reach: (N, L) whether the emitter may be seen from the texel.
        pattern: (N,) int32.
        position: (N, 3).
        normal: (N, 3).
        gloss: (N,).
        hidden: says which of a number of rays do not count.
        besides: (N, 3) light from elsewhere, against which an emitter may be faint.
        rays: shadow rays per texel and emitter; as many as the emitters have targets if missing.

    Returns:
        (N, 3) light and (N,) the variance of its luminance.
    """
    texel, light = np.nonzero(reach)
    factor = unoccluded_light(emitters, texel, light, position, normal, gloss)
    strength = factor.max(axis=1, initial=0.0)
    arrived = np.zeros((len(position), 3), dtype=np.float32)
    variance = np.zeros(len(position), dtype=np.float32)
    if not len(texel):
        return arrived, variance
    total = np.bincount(texel, strength, minlength=len(position))
    if besides is not None:
        total += besides.max(axis=1)
    share = strength / np.maximum(total, 1e-20)[texel]
    samples = emitters.points.shape[2] if rays is None else rays
    # What adds little is worth few rays; the first quarter of the targets is stratified in itself.
    for pairs, number in ((share >= _FAINT, samples), ((share < _FAINT) & (share > 0), max(samples // 4, 1))):
        own, lamp, bare = texel[pairs], light[pairs], factor[pairs]
        origins, directions, far, weight = shadow_rays(emitters, own, lamp, pattern, position, normal, 0, number)
        weight = weight.reshape(-1, number)
        free = ~hidden(origins, directions, far).reshape(-1, number)
        whole = weight.sum(axis=1)
        # An emitter of which only a sliver looks over the horizon may have no target there: it counts as visible.
        visible = np.where(whole > 0, (weight * free).sum(axis=1) / np.maximum(whole, 1e-30), 1.0)
        for channel in range(3):
            arrived[:, channel] += np.bincount(own, bare[:, channel] * visible, minlength=len(position))
        # Unequal weights are worth fewer rays (Kish's effective sample size).
        worth = np.maximum(whole**2 / np.maximum((weight**2).sum(axis=1), 1e-30), 1.0)
        spread = bare.mean(axis=1) ** 2 * visible * (1 - visible) / worth
        variance += np.bincount(own, spread, minlength=len(position)).astype(np.float32)
    return arrived, variance
