"""The early part: direct sound, sound through walls, and specular reflections by image sources.

Which sequences of planes can reflect the source is found by tracing: specular rays leave the source, and every
sequence of mirror planes that one of them meets is a candidate, for all listeners. The first order has all planes, the
second and third all sequences of the largest ones: a box is complete. (The energy of sequences that are missed is not
lost: the late part detects their rays.) For each listener, a candidate counts if its path exists: the points of
reflection lie on surfaces of the right planes, and nothing is in the way (J. Borish, "Extension of the image model to
arbitrary polyhedra", JASA 75 (1984) 1827–1836).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.directivity import Emission
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.image_paths import visible_images
from generators.acoustics.tracer.kernels import NEAREST, crossings, specular_planes
from generators.acoustics.tracer.rays import ray_directions
from generators.acoustics.tracer.surfaces import AcousticSurfaces, scratch
from generators.acoustics.tracer.transmission import MOST_WALLS, WallTable, wall_gain

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
Search = Callable[[F64, F64, int], I32]

#: Rays that look for sequences of mirror planes.
_SEARCH_RAYS = 20_000
#: Purpose of random numbers: the search for sequences.
_SEARCH = 2
#: Largest planes of which all sequences of each order are candidates, whether rays find them or not.
_COMPLETE = {2: 24, 3: 8}
#: Images of one position to within this distance (m) are one sound: a path along the edge of two planes.
_SAME_IMAGE = 1e-6
#: Surfaces on a blocked line of sight are counted up to this number: beyond it, nothing is heard through them.
MOST_CROSSINGS = 2 * MOST_WALLS + 1


@dataclass(frozen=True, eq=False)
class Images:
    """Candidates for image sources of one source.

    Attributes:
        source: (3,) metres.
        sequences: (S, K) int32 planes in the order in which the sound meets them, −1 behind the last.
        positions: (S, K, 3) image of the source after each reflection.
        gain: (S, 8) amplitude that the reflections leave, per octave.
        keys: (S,) sorted int64 keys of the sequences (see `trace_late`).
        group: (S,) number of the image's position; images of one position are one sound.
        mirror: (S, 3, 3) the reflections of directions at the planes of each sequence, the last one first: what leaves
            the image along d left the source along mirror·d. Empty without an emission.
        emission: what the source sends out in each direction; None: 1 in all.
        walls: transmission coefficients, if a material of the scene gives its own.
    """

    source: F64
    sequences: I32
    positions: F64
    gain: F64
    keys: NDArray[np.int64]
    group: NDArray[np.int64]
    mirror: F64
    emission: Emission = None
    walls: WallTable | None = None

    @property
    def last(self) -> F64:
        """(S, 3) position of the image source."""
        order = (self.sequences >= 0).sum(axis=1)
        return np.asarray(self.positions[np.arange(len(order)), order - 1])


def images_of(
    surfaces: AcousticSurfaces,
    source: F64,
    order: int,
    seed: int,
    search: Search | None = None,
    emission: Emission = None,
) -> Images:
    """All candidates of up to ``order`` reflections.

    Args:
        surfaces: of the scene.
        source: (3,) metres.
        order: most reflections.
        seed: of the rays that look for sequences.
        search: of source, directions (R, 3) and order: the planes (R, order) that specular rays meet, if not by the
            CPU's kernel.
        emission: what the source sends out in each direction; None: 1 in all.
    """
    sequences = _candidates(surfaces, source, order, seed, search)
    positions = np.zeros((*sequences.shape, 3))
    gain = np.ones((len(sequences), 8))
    at = np.broadcast_to(source, (len(sequences), 3)).copy()
    amplitude = np.sqrt(surfaces.mesh.reflection * (1.0 - surfaces.mesh.scattering))
    for k in range(order):
        has = sequences[:, k] >= 0
        plane = sequences[has, k]
        equation = surfaces.plane_equation[plane]
        height = np.einsum("ij,ij->i", equation[:, :3], at[has]) - equation[:, 3]
        at[has] -= 2 * height[:, None] * equation[:, :3]
        positions[has, k] = at[has]
        gain[has] *= amplitude[surfaces.plane_material[plane]]
    keys = np.sort(_keys(sequences, surfaces.planes))
    group = _groups(np.round(at / _SAME_IMAGE).astype(np.int64))
    mirror = np.zeros((0, 3, 3)) if emission is None else _mirrors(surfaces, sequences)
    return Images(source, sequences, positions, gain, keys, group, mirror, emission, surfaces.walls)


def _mirrors(surfaces: AcousticSurfaces, sequences: I32) -> F64:
    """(S, 3, 3) the reflections of directions at the planes of each sequence, the last one first."""
    found = np.broadcast_to(np.eye(3), (len(sequences), 3, 3)).copy()
    for column in sequences.T:
        has = column >= 0
        normal = surfaces.plane_equation[column[has], :3]
        # Times I − 2·n·nᵀ on the right.
        along = np.einsum("sij,sj->si", found[has], normal)
        found[has] -= 2 * along[:, :, None] * normal[:, None, :]
    return found


def _groups(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(R,) a number for each of ``rows`` (R, K), the same for equal rows."""
    order = np.lexsort(rows.T)
    ordered = rows[order]
    group = np.empty(len(rows), dtype=np.int64)
    is_new = np.ones(len(rows), dtype=np.int64)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group[order] = np.cumsum(is_new)
    return group


def _candidates(surfaces: AcousticSurfaces, source: F64, order: int, seed: int, search: Search | None) -> I32:
    """(S, K) unique sequences, sorted."""
    if not surfaces.planes or not order:
        return np.zeros((0, order), dtype=np.int32)
    directions = _search_directions(seed)
    if search is None:
        met = np.empty((len(directions), order), dtype=np.int32)
        specular_planes(surfaces.mesh, source, directions, 0, len(directions), met, *scratch())
    else:
        met = search(source, directions, order)
    # One number per sequence, in the order of its rows: far faster to sort than rows are.
    base = surfaces.planes + 1
    numbers = [np.unique(_numbers(met, base))]
    for k in range(1, order):  # the beginnings of all sequences
        numbers.append(np.unique(numbers[0] // base**k * base**k))
    by_area = np.argsort(-surfaces.plane_area, kind="stable")
    for k in range(1, order + 1):
        chosen = by_area[: _COMPLETE.get(k, 0) if k > 1 else None]
        rows = np.stack(np.meshgrid(*[chosen] * k, indexing="ij"), axis=-1).reshape(-1, k)
        rows = rows[(rows[:, 1:] != rows[:, :-1]).all(axis=1)]
        numbers.append(_numbers(rows, base) * base ** (order - k))
    found = np.unique(np.concatenate(numbers))
    found = found[found > 0]
    places = base ** np.arange(order - 1, -1, -1)
    return np.ascontiguousarray(found[:, None] // places % base - 1, dtype=np.int32)


@lru_cache(maxsize=4)
def _search_directions(seed: int) -> F64:
    return ray_directions(_SEARCH_RAYS, seed, _SEARCH)


def _numbers(rows: NDArray[np.integer], base: int) -> NDArray[np.int64]:
    """(R,) the rows (R, K) as numbers of K digits: plane + 1, 0 behind the last."""
    number = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T.astype(np.int64):
        number = number * base + column + 1
    return number


def _keys(sequences: I32, planes: int) -> NDArray[np.int64]:
    keys = np.zeros(len(sequences), dtype=np.int64)
    for column in sequences.T.astype(np.int64):
        keys = np.where(column >= 0, keys * (planes + 1) + column + 1, keys)
    return keys


def early_arrivals(surfaces: AcousticSurfaces, images: Images, listener: F64) -> Arrivals:
    """Direct sound (or what walls let through of it) and specular reflections at ``listener`` (3,)."""
    nodes, entries = scratch()
    hidden, shares = np.empty(8), np.empty((3, 8))
    between = crossings(
        surfaces.mesh, surfaces.rims, listener, images.source, MOST_CROSSINGS, hidden, shares[0], nodes, entries
    )
    visible = np.zeros(len(images.sequences), dtype=np.bool_)
    weight = np.zeros((len(visible), 8), dtype=np.float32)
    if len(visible):
        visible_images(
            surfaces.mesh,
            surfaces.rims,
            surfaces.plane_equation,
            listener,
            images.source,
            images.sequences,
            images.positions,
            0,
            len(visible),
            visible,
            weight,
            np.empty((images.sequences.shape[1], 4)),
            shares,
            nodes,
            entries,
        )
    return heard_images(images, listener[None], visible[None], weight[None], np.array([between]), hidden[None])[0]


def _through(images: Images, listener: F64, surfaces: int) -> F64:
    """(8,) amplitude factor of the direct sound through so many surfaces."""
    return wall_gain(surfaces) if images.walls is None else images.walls.gain(listener, images.source)


def heard_images(
    images: Images,
    listeners: F64,
    visible: NDArray[np.bool_],
    weight: NDArray[np.float32],
    between: NDArray[np.int64],
    hidden: F64,
) -> list[Arrivals]:
    """The early arrivals of each listener.

    Args:
        images: candidates.
        listeners: (L, 3) metres.
        visible: (L, S) whether the path of each image source exists.
        weight: (L, S, 8) how much of it, per octave.
        between: (L,) number of surfaces between source and listener, counted up to `MOST_CROSSINGS`.
        hidden: (L, 8) how far the source is behind them (see `crossings`).
    """
    count = len(listeners)
    owner, image = np.nonzero(visible)
    groups = int(images.group.max(initial=0)) + 1
    _, once, number = np.unique(owner * groups + images.group[image], return_index=True, return_inverse=True)
    # Images of one position are one sound, of which their surfaces carry one part each; on an edge, all of it each.
    carried = weight[owner, image].astype(np.float64)
    parts, whole = np.zeros((2, len(once), 8))
    np.add.at(parts, number.reshape(-1), carried * images.gain[image])
    np.add.at(whole, number.reshape(-1), carried)
    parts /= np.maximum(whole, 1.0)
    order = np.argsort(once)
    once, parts = once[order], parts[order]
    owner, image = owner[once], image[once]
    through = [
        np.ones(8) if surfaces == 0 else _through(images, listener, int(surfaces)) * depth
        for listener, surfaces, depth in zip(listeners, between, hidden, strict=True)
    ]
    direct = np.array(through)
    owner = np.concatenate([np.arange(count), owner])
    gain = np.concatenate([direct.reshape(-1, 8), parts])
    positions = np.concatenate([np.broadcast_to(images.source, (count, 3)), images.last[image]])
    used = gain.any(axis=1)
    owner, gain = owner[used], gain[used]
    offset = positions[used] - listeners[owner]
    distance = np.linalg.norm(offset, axis=1)
    # Source and listener in one point: the sound comes from somewhere, by convention from −Z.
    direction = np.where(distance[:, None] > 0, offset / np.maximum(distance, 1e-30)[:, None], [0.0, 0.0, -1.0])
    pressure = gain * np.exp(-0.5 * np.outer(distance, energy_exponents())) / np.maximum(distance, NEAREST)[:, None]
    if images.emission is not None:
        mirror = np.concatenate([np.broadcast_to(np.eye(3), (count, 3, 3)), images.mirror[image]])[used]
        pressure *= images.emission(-np.einsum("sij,sj->si", mirror, direction))
    order = np.lexsort((distance, owner))
    time = distance[order] / SPEED_OF_SOUND
    direction, pressure = direction[order].astype(np.float32), pressure[order].astype(np.float32)
    ends = np.cumsum(np.bincount(owner, minlength=count))
    spans = [slice(first, last) for first, last in zip([0, *ends[:-1]], ends, strict=True)]
    spherical = np.ones(len(time), dtype=np.bool_)
    return [Arrivals(time[span], direction[span], pressure[span], spherical[span]) for span in spans]
