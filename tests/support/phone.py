"""What a phone with a depth sensor and a scanning app makes of a home: one textured mesh with an app's faults.

    walk → pictures and poses with drift → which pieces of the surface are seen → fused, noisy, decimated mesh
         → each face shows the picture that sees it best

Faults: noise of a few mm that grows with distance, melted detail, drift (a loop that does not close), holes where
nothing looked, where glass is and at random, floating fragments, and pictures whose exposure and white balance wander.

A scan's file has its origin at the phone's first position and any heading. What is known of the home is in the
*aligned* frame: the home's axes, and the same origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import fast_simplification
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.spatial import cKDTree

from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.shapes import rotation
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from generators.placement.site import Site
from generators.vision.embree import EmbreeBackend
from tests.support.scan_like import Fused, split_edges

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

#: A phone held upright: 53° across, 67° high.
CAMERA = Intrinsics(480, 640, 481.0, 481.0, 240.0, 320.0)
#: Range of the depth sensor (m) and the least cosine between its ray and the surface's normal.
RANGE, GRAZING = (0.25, 4.5), 0.1
#: Height at which the phone is held (m).
HELD = 1.35
#: Pitches (rad) through which the phone is swept, with and without looking up to the ceiling.
PITCHES, LOW_PITCHES = (-0.5, 0.2, -0.15, 0.45), (-0.6, -0.35, -0.5, -0.25)
#: Views from each place.
TURNS = 8
#: Longest edge of the fine mesh, and side of the voxels in which detail melts (m).
EDGE, VOXEL = 0.045, 0.015
#: The surface is continued this far into what was not seen (m).
BRIDGED = 0.1
#: White noise of the vertices (m), and waves of the surface: at 1 m, and what each further metre adds.
WHITE, WAVES, WAVES_PER_METRE = 0.001, 0.002, 0.0015
#: Length of the waves (m).
WAVE_LENGTH = 0.12
#: What the pose has drifted by at the end of the walk: metres, degrees about the vertical.
DRIFT, DRIFT_TURN = 0.03, 0.25


@dataclass(frozen=True)
class PhoneWalk:
    """How a home is scanned.

    Attributes:
        rooms: in which the phone is carried around, in this order.
        faces: of the decimated mesh.
        heading: of the file: the aligned frame turned about +Y, degrees.
        ceiling: whether the phone is also pointed upwards.
        holes: number of random holes of 3–12 cm.
        fragments: number of floating fragments.
    """

    rooms: tuple[str, ...]
    faces: int = 100_000
    heading: float = 0.0
    ceiling: bool = True
    holes: int = 25
    fragments: int = 10


@dataclass(frozen=True, eq=False)
class PhoneScan:
    """A scan and how it lies in its home.

    Attributes:
        mesh: vertices as in the file.
        origin: (3,) the file's origin in the home, metres.
        heading: the file's axes are the home's, turned by this about +Y, degrees.
        poses: true poses of the pictures, in the home.
        seen: m² of the home's surface that was seen at least twice.
    """

    mesh: Fused
    origin: Array
    heading: float
    poses: tuple[Pose, ...]
    seen: float


def scan_by_phone(scene: Scene, walk: PhoneWalk, rng: Generator) -> PhoneScan:
    """Scan a lit home.

    Args:
        scene: with light maps.
        walk: how.
        rng: the only source of randomness.
    """
    poses, room_of = _walk(scene, walk, rng)
    pictures = _pictures(scene, poses, room_of, rng)
    drift = _drift(poses, rng)
    corners, owner = _surface(scene, walk, rng)
    weight, first, last, toward, distance = _sight(scene, corners, poses, rng)
    shift = _shift(corners.mean(axis=1), weight, drift)
    keep = np.asarray((weight > 0).sum(axis=1)).reshape(-1) >= 2
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    torn = _doubled(corners.mean(axis=1), keep & first & last, rng)
    nearest = _bridged(corners, keep)
    keep |= nearest >= 0
    shift, toward, distance = (np.where(_column(nearest, v), v[nearest], v) for v in (shift, toward, distance))
    vertices, faces = _fused(corners[keep], shift[keep], toward[keep], distance[keep], rng)
    seen = float(area[keep].sum())
    middle = corners[keep].mean(axis=1)
    if torn.any():
        # The loop does not close: this piece of the surface exists a second time, where the drifted phone saw it last.
        end = _shift(corners[torn].mean(axis=1), _only_last(weight[torn]), drift)
        again, extra = _fused(corners[torn], end, toward[torn], distance[torn], rng)
        faces = np.concatenate([faces, extra + len(vertices)])
        vertices = np.concatenate([vertices, again])
    vertices, faces = _with_fragments(scene, walk, vertices, faces, rng)
    vertices, faces = _decimated(vertices, faces, walk.faces)
    own = owner[keep][cKDTree(middle).query(vertices[faces].mean(axis=1))[1]]
    guessed = [_moved(pose, drift[number]) for number, pose in enumerate(poses)]
    uv, index, atlas = _textured(vertices, faces, guessed, pictures)
    origin = np.asarray(poses[0].position)
    turned = (vertices - origin) @ rotation("y", walk.heading).T
    names = tuple(part.name for part in scene.parts)
    mesh = Fused(turned[index[0]], uv, index[1], own, names, atlas)
    return PhoneScan(mesh, origin, walk.heading, tuple(poses), seen)


# ---- the walk -----------------------------------------------------------------------------------------------------


def _walk(scene: Scene, walk: PhoneWalk, rng: Generator) -> tuple[list[Pose], list[str]]:
    """Poses of the pictures, and the room of each: round each room, turning on the spot at every stop."""
    poses: list[Pose] = []
    rooms: list[str] = []
    pitches = PITCHES if walk.ceiling else LOW_PITCHES
    for room in walk.rooms:
        points = Site.of(scene, room).space.points
        box = scene.room(room)
        stops = max(4, min(8, round((box.high[0] - box.low[0]) * (box.high[2] - box.low[2]) / 2)))
        chosen = [points[int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))]]
        for _ in range(stops - 1):
            gap = np.min([np.linalg.norm(points - place, axis=1) for place in chosen], axis=0)
            chosen.append(points[int(np.argmax(gap))])
        around = np.array(chosen) - np.mean(chosen, axis=0)
        for number, stop in enumerate(np.argsort(np.arctan2(around[:, 1], around[:, 0]))):
            for turn in range(TURNS):
                yaw = 2 * math.pi * (turn + 0.5 * (number % 2)) / TURNS + rng.normal(0, 0.1)
                pitch = pitches[(turn + number) % 4] + rng.normal(0, 0.05)
                x, z = chosen[int(stop)]
                height = box.low[1] + HELD + rng.normal(0, 0.06)
                poses.append(Pose.from_yaw((float(x), float(height), float(z)), yaw, pitch))
                rooms.append(room)
    return poses, rooms


def _pictures(scene: Scene, poses: list[Pose], rooms: list[str], rng: Generator) -> list[NDArray[np.uint8]]:
    """What the phone's camera writes: automatic exposure and white balance that lag, vignetting, noise."""
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
    off = np.hypot(columns - CAMERA.cx, rows - CAMERA.cy) / CAMERA.cy
    vignette = (1 - 0.1 * off**2)[..., None]
    out: list[NDArray[np.uint8]] = []
    exposure, warmth = 0.0, 0.0
    session, room_now = None, ""
    for pose, room in zip(poses, rooms, strict=True):
        if session is None or room != room_now:
            session, room_now = EmbreeBackend().open(scene.for_room(room), CAMERA), room
        linear = (session.render(pose).rgb / 255.0) ** 2.2
        wanted = float(np.clip(math.log(0.22 / max(float(linear.mean()), 1e-3)), -0.5, 0.5))
        exposure += 0.5 * (0.5 * wanted - exposure) + rng.normal(0, 0.03)
        warmth += 0.3 * (0 - warmth) + rng.normal(0, 0.015)
        linear = linear * vignette * math.exp(exposure) * [1 + warmth, 1.0, 1 - warmth]
        shown = np.clip(linear, 0, 1) ** (1 / 2.2) + rng.normal(0, 0.008, linear.shape)
        out.append(np.round(255 * np.clip(shown, 0, 1)).astype(np.uint8))
    return out


def _drift(poses: list[Pose], rng: Generator) -> Array:
    """(K, 4, 4) where the phone believes to be, from where it is: a random walk."""
    steps = rng.normal(0, 1, (len(poses), 4))
    steps[0] = 0
    path = np.cumsum(steps, axis=0)
    path /= np.maximum(np.abs(path[-1:]), 0.5 * np.sqrt(len(poses)))
    out = np.tile(np.eye(4), (len(poses), 1, 1))
    start = np.asarray(poses[0].position)
    for number, (x, y, z, turn) in enumerate(path):
        spin = rotation("y", DRIFT_TURN * turn)
        out[number, :3, :3] = spin
        out[number, :3, 3] = start - spin @ start + DRIFT * np.array([x, 0.3 * y, z])
    return out


def _moved(pose: Pose, drift: Array) -> Pose:
    matrix = drift @ pose.matrix
    backward = matrix[:3, 2]
    x, y, z = (float(v) for v in matrix[:3, 3])
    return Pose.from_yaw((x, y, z), math.atan2(backward[0], backward[2]), math.asin(-float(backward[1])))


# ---- the surface --------------------------------------------------------------------------------------------------


def _surface(scene: Scene, walk: PhoneWalk, rng: Generator) -> tuple[Array, NDArray[np.int64]]:
    """(F, 3, 3) small pieces of the home's surface that a depth sensor can measure, and the part of each."""
    low = np.min([scene.room(room).low for room in walk.rooms], axis=0) - RANGE[1]
    high = np.max([scene.room(room).high for room in walk.rooms], axis=0) + RANGE[1]
    pieces, owner = [], []
    for number, part in enumerate(scene.parts):
        corners = part.mesh.positions.astype(np.float64)
        glass = np.array([m.name.startswith("sky") for m in part.mesh.materials])[part.mesh.face_material]
        near = ((corners.min(axis=1) < high) & (corners.max(axis=1) > low)).all(axis=1)
        pieces.append(corners[near & ~glass])
        owner.append(np.full(int((near & ~glass).sum()), number))
    whole = np.concatenate(pieces)
    corners, _, origin = split_edges(whole, np.zeros((*whole.shape[:2], 2)), EDGE)
    middle = corners.mean(axis=1)
    keep = np.ones(len(corners), dtype=bool)
    for centre in middle[rng.choice(len(corners), walk.holes)]:
        keep &= np.linalg.norm(middle - centre, axis=1) > rng.uniform(0.03, 0.12)
    return corners[keep], np.concatenate(owner)[origin][keep]


def _sight(scene: Scene, corners: Array, poses: list[Pose], rng: Generator) -> tuple[sparse.csr_array, ...]:
    """By which poses each piece is seen, and how well.

    Returns:
        (F, K) weights; (F,) whether an early and a late pose see it; (F, 3) mean direction to the phone; (F,) mean
        distance.
    """
    caster = RayCaster(scene)
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    rows, columns, values = [], [], []
    toward, distance, total = np.zeros_like(middle), np.zeros(len(middle)), np.zeros(len(middle))
    for number, pose in enumerate(poses):
        pixels, depth = _projected(pose, middle)
        near = np.flatnonzero(_inside(pixels, 0) & (depth > RANGE[0]) & (depth < RANGE[1]))
        away = np.asarray(pose.position) - middle[near]
        far = np.sqrt(np.einsum("ij,ij->i", away, away))
        cosine = np.einsum("ij,ij->i", normal[near], away) / far
        seen = (cosine > GRAZING) & (far < RANGE[1])
        near, away, far, cosine = near[seen], away[seen], far[seen], cosine[seen]
        seen = ~caster.occluded(middle[near] + 0.004 * normal[near], away, 0.999)
        near, away, far = near[seen], away[seen], far[seen]
        weight = cosine[seen] / far**2
        rows.append(near)
        columns.append(np.full(len(near), number))
        values.append(weight)
        toward[near] += (weight / far)[:, None] * away
        distance[near] += weight * far
        total[near] += weight
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    table = sparse.csr_array(entries, shape=(len(middle), len(poses)))
    edge = max(1, len(poses) // 4)
    first = np.asarray(table[:, :edge].sum(axis=1)).reshape(-1) > 0
    last = np.asarray(table[:, -edge:].sum(axis=1)).reshape(-1) > 0
    toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    return table, first, last, toward, distance / np.maximum(total, 1e-12)


def _projected(pose: Pose, points: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Pixels (N, 2) and depths (N,): `Intrinsics.project`, but faster and rounded."""
    away = (points - pose.position).astype(np.float32).T
    # Not a product of matrices: its threads wait for one another, and the matrix is tiny.
    x, y, z = (a * away[0] + b * away[1] + c * away[2] for a, b, c in pose.rotation_matrix.T.astype(np.float32))
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.stack([CAMERA.cx - CAMERA.fx * x / z, CAMERA.cy + CAMERA.fy * y / z], axis=1)
    return pixels, -z


def _inside(pixels: NDArray[np.float32], margin: float) -> NDArray[np.bool_]:
    """(N,) whether pixels lie in the picture, this far from its border."""
    high = np.float32([CAMERA.width - margin, CAMERA.height - margin])
    return np.asarray(((pixels > margin) & (pixels < high)).all(axis=1))


def _only_last(weight: sparse.csr_array) -> sparse.csr_array:
    late = np.arange(weight.shape[1]) >= weight.shape[1] - max(1, weight.shape[1] // 4)
    return sparse.csr_array(weight * late[None, :])


def _shift(points: Array, weight: sparse.csr_array, drift: Array) -> Array:
    """(F, 3) how far the mean over its views moves each point."""
    share = sparse.csr_array(weight / np.maximum(weight.sum(axis=1), 1e-12)[:, None])
    turn = (share @ drift[:, :3, :3].reshape(len(drift), 9)).reshape(-1, 3, 3)
    moved = np.einsum("nij,nj->ni", turn, points) + share @ drift[:, :3, 3]
    seen = np.asarray(share.sum(axis=1)).reshape(-1, 1) > 0
    return np.where(seen, moved - points, 0.0)


def _column(nearest: NDArray[np.int64], values: Array) -> NDArray[np.bool_]:
    return (nearest >= 0).reshape(-1, *(1,) * (values.ndim - 1))


def _bridged(corners: Array, seen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(F,) the seen piece beside an unseen one that an app closes its surface over, else −1."""
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    known, unseen = np.flatnonzero(seen), np.flatnonzero(~seen)
    distance, index = cKDTree(middle[known]).query(middle[unseen], distance_upper_bound=BRIDGED)
    near = np.isfinite(distance)
    unseen, index = unseen[near], known[index[near]]
    alike = np.einsum("ij,ij->i", normal[unseen], normal[index]) > 0.3
    out = np.full(len(corners), -1, dtype=np.int64)
    out[unseen[alike]] = index[alike]
    return out


def _doubled(middle: Array, candidates: NDArray[np.bool_], rng: Generator) -> NDArray[np.bool_]:
    """Which pieces exist twice: those near two random points that the first and the last pictures see."""
    out = np.zeros(len(middle), dtype=bool)
    if candidates.any():
        for centre in middle[rng.choice(np.flatnonzero(candidates), 2)]:
            out |= candidates & (np.linalg.norm(middle - centre, axis=1) < rng.uniform(0.3, 0.6))
    return out


def _fused(corners: Array, shift: Array, toward: Array, distance: Array, rng: Generator) -> tuple[Array, Faces]:
    """Vertices and faces of the pieces, welded in voxels, smoothed, and moved by drift and noise."""
    flat = corners.reshape(-1, 3)
    _, inverse = np.unique(np.floor(flat / VOXEL + 0.5).astype(np.int64), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    count = np.bincount(inverse).astype(np.float64)

    def mean(values: Array) -> Array:
        each = np.repeat(values, 3, axis=0) if len(values) != len(flat) else values
        return np.stack([np.bincount(inverse, weights=each[:, k]) / count for k in range(each.shape[1])], axis=1)

    vertices, faces = mean(flat), inverse.reshape(-1, 3)
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])]
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(once)]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both = np.concatenate([edges, edges[:, ::-1]])
    link = sparse.csr_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(len(vertices),) * 2)
    link.data[:] = 1
    degree = np.maximum(np.asarray(link.sum(axis=1)).reshape(-1, 1), 1)
    for _ in range(2):
        vertices = 0.5 * vertices + 0.5 * np.where(degree > 1, (link @ vertices) / degree, vertices)
    size = WAVES + WAVES_PER_METRE * np.maximum(mean(distance[:, None]) - 1, 0)
    moved = vertices + mean(shift) + mean(toward) * size * _waves(vertices, rng)[:, None]
    return moved + rng.normal(0, WHITE, moved.shape), faces


def _waves(points: Array, rng: Generator) -> Array:
    """(N,) smooth noise of unit variance at points."""
    low = points.min(axis=0)
    at = (points - low) / WAVE_LENGTH + 1
    lattice = rng.normal(0, 1, tuple(np.ceil(at.max(axis=0)).astype(int) + 3))
    values = ndimage.map_coordinates(lattice, at.T, order=2, mode="nearest")
    return np.asarray(values / max(float(values.std()), 1e-9))


def _with_fragments(
    scene: Scene, walk: PhoneWalk, vertices: Array, faces: Faces, rng: Generator
) -> tuple[Array, Faces]:
    """The mesh with fragments that float in the rooms, and patches of ghosts behind the windows."""
    boxes = [scene.room(room) for room in walk.rooms]
    every, all_faces = [vertices], [faces]
    number = len(vertices)
    for _ in range(walk.fragments):
        box = boxes[int(rng.integers(len(boxes)))]
        patch, own = _patch(rng.uniform(0.04, 0.15), 3, rng)
        every.append(patch + rng.uniform(box.low, np.array(box.high) - 0.3))
        all_faces.append(own + number)
        number += len(patch)
    for part in scene.parts:
        glass = np.array([m.name.startswith("sky") for m in part.mesh.materials])[part.mesh.face_material]
        room = part.name.removeprefix("shell_")
        if not glass.any() or room not in walk.rooms:
            continue
        pane = part.mesh.positions[glass].astype(np.float64)
        outward = -part.mesh.normals[glass].mean(axis=(0, 1)).astype(np.float64)
        outward /= max(float(np.linalg.norm(outward)), 1e-9)
        patch, own = _patch(rng.uniform(0.3, 0.7), 10, rng)
        every.append(patch + pane.reshape(-1, 3).mean(axis=0) + rng.uniform(0.3, 1.2) * outward)
        all_faces.append(own + number)
        number += len(patch)
    return np.concatenate(every), np.concatenate(all_faces)


def _patch(size: float, cells: int, rng: Generator) -> tuple[Array, Faces]:
    """A crumpled square about the origin."""
    side = np.linspace(-size / 2, size / 2, cells + 1)
    points = np.stack([*(g.reshape(-1) for g in np.meshgrid(side, side)), np.zeros((cells + 1) ** 2)], axis=1)
    points = points @ rotation("y", rng.uniform(0, 360)).T + rng.normal(0, size / 12, points.shape)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    step = np.array([[0, 1, cells + 2], [0, cells + 2, cells + 1]])
    return points, (corner[:, None, None] + step[None]).reshape(-1, 3)


def _decimated(vertices: Array, faces: Faces, target: int) -> tuple[Array, Faces]:
    if len(faces) <= target:
        return vertices, faces
    points, triangles = fast_simplification.simplify(
        vertices.astype(np.float32), faces.astype(np.int32), target_count=target
    )[:2]
    triangles = triangles.astype(np.int64)
    used, index = np.unique(triangles, return_inverse=True)
    return points[used].astype(np.float64), index.reshape(-1, 3)


# ---- the texture --------------------------------------------------------------------------------------------------


def _textured(
    vertices: Array, faces: Faces, poses: list[Pose], pictures: list[NDArray[np.uint8]]
) -> tuple[Array, tuple[NDArray[np.int64], Faces], NDArray[np.uint8]]:
    """Texture coordinates that take each face from one picture.

    Returns:
        (V', 2) uv, v up; (V',) vertex of each and faces (F, 3) into them; the atlas, a mosaic of the pictures.
    """
    corners = vertices[faces]
    view = _best_views(corners, poses)
    columns = math.ceil(math.sqrt(len(pictures) * CAMERA.height / CAMERA.width))
    rows = math.ceil(len(pictures) / columns)
    atlas = np.zeros((rows * CAMERA.height, columns * CAMERA.width, 3), dtype=np.uint8)
    size = np.array([atlas.shape[1], atlas.shape[0]])
    uv = np.zeros((len(faces), 3, 2))
    for number, (pose, picture) in enumerate(zip(poses, pictures, strict=True)):
        corner = np.array([number % columns * CAMERA.width, number // columns * CAMERA.height])
        atlas[corner[1] : corner[1] + CAMERA.height, corner[0] : corner[0] + CAMERA.width] = picture
        own = view == number
        pixels, _ = _projected(pose, corners[own].reshape(-1, 3))
        uv[own] = (pixels + corner).reshape(-1, 3, 2) / size
    lost = view < 0
    if lost.any():
        # Apps paint what no picture shows with the colours around it.
        _, nearest = cKDTree(corners[~lost].mean(axis=1)).query(corners[lost].mean(axis=1))
        uv[lost] = uv[~lost][nearest].mean(axis=1, keepdims=True)
    uv[..., 1] = 1 - uv[..., 1]
    keys = np.stack([faces.reshape(-1), np.repeat(np.where(lost, np.arange(len(faces)) + len(poses), view), 3)], axis=1)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return uv.reshape(-1, 2)[first], (faces.reshape(-1)[first], index.reshape(-1, 3)), atlas


def _best_views(corners: Array, poses: list[Pose]) -> NDArray[np.int64]:
    """(F,) the pose that sees most of each face, −1 where none sees all of it."""
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    caster = RayCaster(corners)
    best, view = np.zeros(len(corners)), np.full(len(corners), -1, dtype=np.int64)
    for number, pose in enumerate(poses):
        pixels, depth = _projected(pose, corners.reshape(-1, 3))
        near = np.flatnonzero((_inside(pixels, 1) & (depth > 0.1)).reshape(-1, 3).all(axis=1))
        away = np.asarray(pose.position) - middle[near]
        far = np.sqrt(np.einsum("ij,ij->i", away, away))
        score = np.abs(np.einsum("ij,ij->i", normal[near], away)) / far**3
        better = score > best[near]
        near, away, far, score = near[better], away[better], far[better], score[better]
        seen = ~caster.occluded(middle[near] + away / far[:, None] * 0.02, away, 0.999)
        best[near[seen]], view[near[seen]] = score[seen], number
    return view


def encoded(atlas: NDArray[np.uint8], quality: int = 88) -> bytes:
    """The atlas as JPEG."""
    return cv2.imencode(".jpg", atlas[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
