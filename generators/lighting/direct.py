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


@njit
def _pairs(
    reach: NDArray[np.bool_], position: F32, normal: F32, centre: F32, radius: F32
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs (texel, emitter), ordered by emitter, of those in ``reach`` whose emitter is not all below the horizon."""
    texels, lights = reach.shape
    most = 0
    for t in range(texels):
        for e in range(lights):
            most += reach[t, e]
    texel, light = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    count = 0
    for e in range(lights):
        for t in range(texels):
            if not reach[t, e]:
                continue
            height = 0.0
            for c in range(3):
                height += (centre[e, c] - position[t, c]) * normal[t, c]
            if height > -1.001 * radius[e] - 1e-4:
                texel[count], light[count] = t, e
                count += 1
    return texel[:count], light[:count]


def emitter_pairs(
    emitters: Emitters, reach: NDArray[np.bool_], position: F32, normal: F32
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The pairs (texel, emitter) in ``reach`` (N, L), without emitters that are all below a texel's horizon.

    They are ordered by emitter, then by texel.
    """
    return _pairs(reach, position, normal, emitters.centre, emitters.radius)


@njit
def _sorted_by_share(
    texel: NDArray[np.int64], factor: F32, total: NDArray[np.float64], faint: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which of the pairs give at least the part ``faint`` of their texel's light, and which less, but something.

    ``total`` (N,) is the light from elsewhere; that of the pairs is added.
    """
    strength = np.empty(len(texel), dtype=np.float32)
    for i in range(len(texel)):
        strength[i] = max(factor[i, 0], factor[i, 1], factor[i, 2])
        total[texel[i]] += strength[i]
    more, less = np.empty(len(texel), dtype=np.int64), np.empty(len(texel), dtype=np.int64)
    many = few = 0
    for i in range(len(texel)):
        if strength[i] >= faint * max(total[texel[i]], 1e-20):
            more[many] = i
            many += 1
        elif strength[i] > 0.0:
            less[few] = i
            few += 1
    return more[:many], less[:few]


@njit
def _shadow_rays(
    texel: NDArray[np.int64],
    light: NDArray[np.int64],
    pattern: I32,
    position: F32,
    normal: F32,
    points: F32,
    first: int,
    last: int,
    origins: F32,
    directions: F32,
    far: F32,
    weight: F32,
) -> None:
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


@njit
def _add_rays(
    rows: NDArray[np.int64], weight: F32, is_hidden: NDArray[np.bool_], count: int, sums: NDArray[np.float64]
) -> None:
    """Add ``count`` rays of each of some pairs to `Shadow.sums`."""
    ray = 0
    for i in range(len(rows)):
        row = rows[i]
        for _ in range(count):
            w = np.float64(weight[ray])
            sums[row, 0] += w
            sums[row, 2] += w * w
            if not is_hidden[ray]:
                sums[row, 1] += w
            ray += 1


@njit
def _mixed(
    pair: NDArray[np.int64], group: NDArray[np.intp], sums: NDArray[np.float64], number: int
) -> NDArray[np.int64]:
    """Which of the pairs ``pair`` are in a group of which some rays were free and others not.

    ``group`` is for all pairs; ``number`` is how many groups there are.
    """
    kind = np.zeros(number, dtype=np.uint8)
    for i in pair:
        if sums[i, 1] > 0.0:
            kind[group[i]] |= 1
        if sums[i, 1] < sums[i, 0]:
            kind[group[i]] |= 2
    out = np.empty(len(pair), dtype=np.int64)
    count = 0
    for i in pair:
        if kind[group[i]] == 3:
            out[count] = i
            count += 1
    return out[:count]


@njit
def _add_light(
    texel: NDArray[np.int64],
    factor: F32,
    sums: NDArray[np.float64],
    shot: NDArray[np.int64],
    group: NDArray[np.intp],
    number: int,
    arrived: NDArray[np.float64],
    variance: NDArray[np.float64],
) -> None:
    """Add the visible part of ``factor`` (P, 3) to the light of texels, and its variance.

    ``shot`` (P,) is the number of rays of each pair. The visible share of a group is the ratio of its sums (combined
    ratio estimator: Cochran, "Sampling Techniques", 1977, section 6.11), and a texel's deviation from it is in
    proportion to its own rays. A mean of the texels' own ratios would be biased: of a lamp, which shines to all sides,
    the few targets that face a texel weigh more at one texel than at the next.
    """
    together = np.zeros((number, 3))
    for i in range(len(texel)):
        if shot[i] > 0:
            together[group[i], 0] += sums[i, 0] / shot[i]
            together[group[i], 1] += sums[i, 1] / shot[i]
            together[group[i], 2] += 1.0
    for i in range(len(texel)):
        t = texel[i]
        whole, free = sums[i, 0], sums[i, 1]
        all_whole, all_free = together[group[i], 0], together[group[i], 1]
        # An emitter of which only a sliver looks over the horizon may have no target there: it counts as visible.
        visible = 1.0
        if all_whole > 0.0:
            share = all_free / all_whole
            own = (free - share * whole) / max(shot[i], 1) * together[group[i], 2] / all_whole
            visible = min(max(share + own, 0.0), 1.0)
        mean = 0.0
        for c in range(3):
            arrived[t, c] += factor[i, c] * visible
            mean += factor[i, c] / 3.0
        if 0.0 < visible < 1.0:
            # Unequal weights are worth fewer rays (Kish's effective sample size).
            worth = max(whole * whole / sums[i, 2], 1.0) if sums[i, 2] > 0.0 else 1.0
            variance[t] += mean * mean * visible * (1.0 - visible) / worth


def direct_light(
    emitters: Emitters,
    reach: NDArray[np.bool_],
    pattern: I32,
    position: F32,
    normal: F32,
    hidden: Occlusion,
    besides: F32 | None = None,
    rays: int | None = None,
    block: NDArray[np.integer[Any]] | None = None,
    sparing: bool = True,
    faint: float = 0.08,
) -> tuple[F32, F32]:
    """Light of all emitters on some texels.

    Args:
        emitters: the lights.
        reach: (N, L) whether the emitter may be seen from the texel.
        pattern: (N,) int32.
        position: (N, 3).
        normal: (N, 3).
        hidden: says which of a number of rays do not count.
        besides: (N, 3) light from elsewhere, against which an emitter may be faint.
        rays: shadow rays per texel and emitter; as many as the emitters have targets if missing.
        block: (N,) ascending numbers of groups of neighbouring texels.
        sparing: shoot a quarter of the shadow rays first, and the rest only in blocks where some of these were free and
            others not. Without blocks all rays are shot.
        faint: an emitter that could give less than this part of a texel's light gets a quarter of the rays.

    Returns:
        (N, 3) light and (N,) the variance of its luminance.
    """
    texel, light = emitter_pairs(emitters, reach, position, normal)
    arrived = np.zeros((len(position), 3), dtype=np.float64)
    variance = np.zeros(len(position), dtype=np.float64)
    if not len(texel):
        return arrived.astype(np.float32), variance.astype(np.float32)
    factor = unoccluded_light(emitters, texel, light, position, normal)
    total = np.zeros(len(position)) if besides is None else besides.max(axis=1).astype(np.float64)
    # What adds little is worth few rays; the first quarter of the targets is stratified in itself.
    strong, weak = _sorted_by_share(texel, factor, total, faint)
    samples = emitters.points.shape[2] if rays is None else rays
    # Of all rays of a pair (texel, emitter): their weights, the weights of those that met nothing, squared weights.
    sums = np.zeros((len(texel), 3))
    shot = np.zeros(len(texel), dtype=np.int64)

    def shoot(pairs: NDArray[np.int64], first: int, last: int) -> None:
        origins, directions, far, weight = shadow_rays(
            emitters, texel[pairs], light[pairs], pattern, position, normal, first, last
        )
        _add_rays(pairs, weight, hidden(origins, directions, far), last - first, sums)
        shot[pairs] += last - first

    if block is None:
        group, number_of_groups = np.arange(len(texel)), len(texel)
    else:
        group = (block - block[0]).astype(np.int64)[texel] * len(emitters) + light
        number_of_groups = int(block[-1] - block[0] + 1) * len(emitters)
    for pairs, number in ((strong, samples), (weak, max(samples // 4, 1))):
        if block is None or not sparing or number < 4:
            shoot(pairs, 0, number)
            continue
        shoot(pairs, 0, number // 4)
        shoot(_mixed(pairs, group, sums, number_of_groups), number // 4, number)
    _add_light(texel, factor, sums, shot, group, number_of_groups, arrived, variance)
    return arrived.astype(np.float32), variance.astype(np.float32)
