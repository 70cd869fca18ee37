"""How well predicted points fill the true object: IoU over voxels, and the error of the centroid.

A voxel is half open, [k·size, (k + 1)·size) along each axis of the world, so that every point of space lies in exactly
one. Coordinates are first rounded to 10 µm, the resolution of float32 some ten metres from the origin: a face that lies
on a plane between voxels then belongs to the upper one, whatever the last bit of its coordinates. From there on all
arithmetic is on integers and exact.

    S  voxels that hold a point of the true mesh's surface
    I  voxels that S encloses
    Q  voxels that hold a predicted point

    IoU_3D = |Q ∩ S| / |S ∪ (Q ∖ I)|

A prediction of the surface and one of the filled solid can both reach 1; points inside are neither right nor wrong.
docs/protocol-strict.md has a worked example.

Triangle and voxel are tested with separating axes (Akenine-Möller, "Fast 3D triangle-box overlap testing", Journal of
Graphics Tools, 2001), here for half-open boxes. On integers, a half-open box is a closed box as far as an axis can
tell, with the ends of its projection that only its open sides reach moved in by one (see `_overlaps`). A closed mesh
gives a closed S: of two voxels that share a side, one on either side of the surface, at least one holds a point of it.
So no path of such neighbours leads from inside to outside, and filling holes finds exactly what is enclosed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from avs3d_bench.errors import Avs3dError

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

#: Edge of the voxels of protocol ``strict``, metres.
VOXEL_SIZE = 0.05
#: Coordinates are whole numbers of 1 / this many metres: 10 µm.
_PER_METRE = 100_000
#: Largest extent of a mesh along an axis, metres. Up to 8 m, no product of the overlap test leaves 63 bits.
MAX_EXTENT = 6.0
#: Largest grid laid over a mesh; 6 m at 5 cm are 1.8 million voxels.
_MAX_VOXELS = 10_000_000
#: Vertices beyond this are in a wrong unit, metres.
_MAX_COORDINATE = 50_000.0
#: A voxel's three indices share 63 bits; points beyond (52 km at 5 cm) count as if they lay on the limit.
_BITS = 21
_MAX_INDEX = 2 ** (_BITS - 1) - 1
#: Pairs of triangle and cube, or points, that are worked on at a time.
_CHUNK = 1 << 17
#: A cube's eighths, as offsets.
_EIGHTHS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)


@dataclass(frozen=True, eq=False)
class TrueVolume:
    """The voxels of a true object.

    Attributes:
        size: edge of a voxel, metres.
        origin: world index of the grid's first voxel along (x, y, z).
        surface: (X, Y, Z) bool, S: voxels that hold a point of the mesh's surface.
        interior: (X, Y, Z) bool, I: voxels enclosed by them; none of S.
        centroid: (x, y, z) mean of the centres of ``surface``, metres.
    """

    size: float
    origin: tuple[int, int, int]
    surface: Bools
    interior: Bools
    centroid: tuple[float, float, float]


@dataclass(frozen=True)
class VolumeScore:
    """The 3D figures of one observation.

    Attributes:
        iou: IoU_3D, in [0, 1].
        centroid_error: metres; None of an empty prediction.
    """

    iou: float
    centroid_error: float | None


def true_volume(vertices: ArrayLike, faces: ArrayLike, *, size: float = VOXEL_SIZE) -> TrueVolume:
    """The voxels of a mesh.

    The mesh may be open (then nothing need be enclosed), intersect itself, or hold triangles without area, which count
    as the segment or point they are. Vertices that no face names are not looked at.

    Args:
        vertices: (V, 3) metres, world coordinates.
        faces: (F, 3) vertex indices.
        size: edge of a voxel, metres; a multiple of 10 µm.

    Raises:
        Avs3dError: if the mesh has no area, is larger than 6 m along an axis, or holds numbers that are not finite or
            out of range.
    """
    step = _step(size)
    corners = _triangles(vertices, faces)
    units = np.rint(corners * _PER_METRE).astype(np.int64)
    low, high = units.min(axis=(0, 1)), units.max(axis=(0, 1))
    first, last = low // step, high // step
    shape = last - first + 1
    voxels = math.prod(int(n) for n in shape)
    if max(high - low) > MAX_EXTENT * _PER_METRE or voxels > _MAX_VOXELS:
        extent = " × ".join(f"{length / _PER_METRE:.6g}" for length in high - low)
        raise Avs3dError(
            f"the true mesh measures {extent} m: expected at most {MAX_EXTENT:g} m along each axis and "
            f"{_MAX_VOXELS // 1_000_000} million voxels; check its unit (metres)"
        )
    surface = _surface_voxels(units - first * step, step, shape)
    # Filled on a padded grid, so that the outside is in one piece and reaches every border voxel of the object.
    interior = ndimage.binary_fill_holes(np.pad(surface, 1))[1:-1, 1:-1, 1:-1] & ~surface
    x, y, z = (int(index) for index in first)
    centroid = ((np.argwhere(surface).mean(axis=0) + (x, y, z) + 0.5) * size).tolist()
    return TrueVolume(size, (x, y, z), surface, np.ascontiguousarray(interior), tuple(centroid))


def score_points(points: ArrayLike, truth: TrueVolume) -> VolumeScore:
    """Hold a predicted cloud against the true object.

    Neither the order of the points nor how many lie in a voxel matters.

    Args:
        points: (N, 3) metres, world coordinates; N may be 0.
        truth: from `true_volume`.

    Raises:
        Avs3dError: if the points have another shape or a number is not finite.
    """
    keys = _occupied(np.asarray(points), _step(truth.size))
    if len(keys) == 0:
        return VolumeScore(0.0, None)
    shape = np.array(truth.surface.shape)
    hits = inside = 0
    total = np.zeros(3, dtype=np.int64)
    for start in range(0, len(keys), _CHUNK):
        index = _unpack(keys[start : start + _CHUNK])
        total += index.sum(axis=0)
        local = index - np.array(truth.origin)
        x, y, z = local[((local >= 0) & (local < shape)).all(axis=1)].T
        hits += int(np.count_nonzero(truth.surface[x, y, z]))
        inside += int(np.count_nonzero(truth.interior[x, y, z]))
    union = int(np.count_nonzero(truth.surface)) + len(keys) - hits - inside
    centre = (total / len(keys) + 0.5) * truth.size
    return VolumeScore(hits / union, float(math.dist(centre.tolist(), truth.centroid)))


def _step(size: float) -> int:
    """Edge of a voxel in units of 10 µm."""
    step = round(size * _PER_METRE) if math.isfinite(size) else 0
    if not 1e-3 <= size <= 1.0 or abs(step - size * _PER_METRE) > 1e-6:
        raise Avs3dError(f"voxel size {size} m: expected 0.001 to 1 m, in whole multiples of 0.00001 m")
    return step


def _triangles(vertices: ArrayLike, faces: ArrayLike) -> Floats:
    """(F, 3 corners, 3 axes) metres, checked."""
    points, index = np.asarray(vertices), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3 or index.ndim != 2 or index.shape[1] != 3:
        raise Avs3dError(f"the true mesh has vertices {points.shape}, faces {index.shape}: expected (V, 3) and (F, 3)")
    if len(index) == 0:
        raise Avs3dError("the true mesh has no face: expected triangles; regenerate the dataset")
    if not np.issubdtype(index.dtype, np.integer) or index.min() < 0 or index.max() >= len(points):
        raise Avs3dError(f"the true mesh names vertices outside of its {len(points)}; regenerate the dataset")
    corners: Floats = points[index].astype(np.float64)
    # NaN compares false as well.
    if not np.all(np.abs(corners) <= _MAX_COORDINATE):
        raise Avs3dError(
            f"the true mesh has coordinates that are not finite or beyond {_MAX_COORDINATE / 1000:g} km: "
            "expected world coordinates in metres"
        )
    sides = corners[:, 1:] - corners[:, :1]
    if not np.cross(sides[:, 0], sides[:, 1]).any():
        raise Avs3dError("the true mesh has no area: expected the surface of an object; regenerate the dataset")
    return corners


def _surface_voxels(units: Ints, step: int, shape: Ints) -> Bools:
    """(X, Y, Z) bool: voxels of the grid that hold a point of a triangle.

    Coarse to fine: a triangle is tested against cubes of 2ⁿ voxels, and then against the eighths of those that it
    meets, so that the work goes with its area and not with the volume of its box.

    Args:
        units: (F, 3, 3) corners in 10 µm, from the grid's corner on.
        step: edge of a voxel in 10 µm.
        shape: of the grid.
    """
    marked = np.zeros(tuple(shape.tolist()), dtype=np.bool_)
    first, last = units.min(axis=1) // step, units.max(axis=1) // step
    reach = (last - first).max(axis=1)
    # Triangles within one voxel, most of a finely made mesh, need no test.
    x, y, z = first[reach == 0].T
    marked[x, y, z] = True
    # Cubes of 2ⁿ ≥ reach voxels: two of them along each axis hold the triangle.
    levels = np.ceil(np.log2(reach.clip(min=1))).astype(np.int64)
    todo = []
    for level in range(int(levels.max()) + 1):
        triangle = np.flatnonzero((levels == level) & (reach > 0))
        todo.append((level, triangle, first[triangle] >> level))
    while todo:
        level, triangle, corner = todo.pop()
        if len(triangle) > _CHUNK // 8:
            todo += [(level, triangle[half], corner[half]) for half in (slice(0, None, 2), slice(1, None, 2))]
            continue
        triangle, cube = np.repeat(triangle, 8), (corner[:, None] + _EIGHTHS).reshape(-1, 3)
        near = ((cube >= first[triangle] >> level) & (cube <= last[triangle] >> level)).all(axis=1)
        triangle, cube = triangle[near], cube[near]
        edge = step << level
        met = _overlaps(units[triangle] - (cube * edge)[:, None], edge)
        triangle, cube = triangle[met], cube[met]
        if level:
            todo.append((level - 1, triangle, 2 * cube))
        else:
            x, y, z = cube.T
            marked[x, y, z] = True
    return marked


def _overlaps(triangles: Ints, step: int) -> Bools:
    """Whether triangles hold a point of the half-open box [0, step)³.

    The half-open box is the union of the closed boxes [0, step − ε]³. A triangle misses it if it misses all of these,
    and then one of the 13 axes separates it from all of them. Along an axis a, their projections tend to
    [step · Σ min(aᵢ, 0), step · Σ max(aᵢ, 0)] as ε goes to 0, and never reach an end that is not 0. Of integers: each
    end that is not 0 moves in by one. An axis that vanishes (a triangle without area) separates nothing.

    Args:
        triangles: (n, 3 corners, 3 axes) in 10 µm, from the box's corner on.
        step: edge of the box in 10 µm.
    """
    # Sides of the box.
    out: Bools = ((triangles.min(axis=1) < step) & (triangles.max(axis=1) >= 0)).all(axis=1)
    edges = np.roll(triangles, -1, axis=1) - triangles
    # The triangle's plane: all corners project to one number.
    normal = np.cross(edges[:, 0], edges[:, 1])
    level = (normal * triangles[:, 0]).sum(axis=1)
    out &= _meets(level, level, normal.clip(max=0).sum(axis=1), normal.clip(min=0).sum(axis=1), step)
    # An edge of the triangle crossed with each axis of the box.
    for number in range(3):
        edge = edges[:, number]
        for u, v in ((1, 2), (2, 0), (0, 1)):
            # The axis has the components −edge[v] along u and edge[u] along v.
            a, b = -edge[:, v], edge[:, u]
            along = a[:, None] * triangles[:, :, u] + b[:, None] * triangles[:, :, v]
            low, high = np.minimum(a, 0) + np.minimum(b, 0), np.maximum(a, 0) + np.maximum(b, 0)
            out &= _meets(along.min(axis=1), along.max(axis=1), low, high, step)
    return out


def _meets(first: Ints, last: Ints, low: Ints, high: Ints, step: int) -> Bools:
    """Whether [first, last] meets the box's projection, given as sums of negative and of positive components."""
    met: Bools = (first <= high * step - (high > 0)) & (last >= low * step + (low < 0))
    return met


def _occupied(points: NDArray[np.generic], step: int) -> Ints:
    """Packed indices of the voxels that hold a point, sorted, each once."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise Avs3dError(f"the predicted cloud has shape {points.shape}: expected (N, 3)")
    keys = np.empty(len(points), dtype=np.int64)
    limit = float(_MAX_INDEX * step)
    for start in range(0, len(points), _CHUNK):
        block = points[start : start + _CHUNK].astype(np.float64)
        if not np.isfinite(block).all():
            raise Avs3dError("the predicted cloud holds NaN or infinite coordinates: expected metres in the world")
        # Clipped before it is scaled, lest it overflow; and after, to whole voxels.
        block = np.rint(np.clip(block, -limit, limit) * _PER_METRE).clip(-limit, limit)
        index = block.astype(np.int64) // step + _MAX_INDEX
        keys[start : start + _CHUNK] = (index[:, 0] << 2 * _BITS) | (index[:, 1] << _BITS) | index[:, 2]
    keys.sort()
    return keys[np.concatenate([[True], keys[1:] != keys[:-1]])] if len(keys) else keys


def _unpack(keys: Ints) -> Ints:
    """(n, 3) world indices of packed voxels."""
    mask = 2**_BITS - 1
    index: Ints = np.stack([keys >> 2 * _BITS, keys >> _BITS & mask, keys & mask], axis=1) - _MAX_INDEX
    return index
