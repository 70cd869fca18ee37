"""Rays against triangles: the project's one wrapper of Embree (through embreex).

`Tracer` passes arrays to Embree unchecked. `RayCaster` checks them first and has the two queries that placement,
trajectory and line-of-sight tests need: the first surface that a ray hits, and whether it hits any. Results have the
same bytes for any chunking and in any process, because each ray is traced by itself.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import import_by_name, needing
from avs3d_bench.runtime.one_thread import one_core
from generators.core.scene import F32, I32, Scene

#: Number of rays per call of Embree; its result arrays (32 bytes a ray) then fit into a core's cache.
CHUNK = 1 << 16
#: The tracer of each device. A text: what runs on the CPU does not depend on the sources of the other one.
TRACERS = {"cpu": "generators.core.rays:Tracer", "cuda": "generators.core.device_rays:DeviceTracer"}
#: embreex's value for "no limit"; a ray without a hit returns it unchanged.
_FAR = np.float32(1e37)
#: Digest of the triangles of the last scene that was built, and that scene: a home with objects is opened to be drawn,
#: for lines of sight, and again by each sibling.
_last: tuple[bytes, Any] | None = None


class Tracer:
    """Embree over a set of triangles; safe to call from several threads at once.

    The scene is built in Embree's robust mode, whose edge test is watertight: no ray slips between two triangles that
    share an edge.

    Queries check nothing: for a ray that is not finite, or whose direction is 0, the result is arbitrary.

    Args:
        triangles: (F, 3, 3) metres; a hit's ``primID`` is the row number.

    Raises:
        Avs3dError: if embreex is not installed, there is no triangle, or a coordinate is not finite.
    """

    #: How many pieces of a job a caller best puts into one call; here a call costs next to nothing.
    calls_together = 1

    def __init__(self, triangles: F32) -> None:
        with needing("ray casting", "pip install 'avs3d-bench[generate]'"):
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        triangles = np.ascontiguousarray(triangles, dtype=np.float32)
        if triangles.ndim != 3 or triangles.shape[1:] != (3, 3) or len(triangles) == 0:
            raise Avs3dError(f"ray casting: triangles have shape {triangles.shape}, expected (F, 3, 3) with F ≥ 1")
        bad = int((~np.isfinite(triangles)).any(axis=(1, 2)).sum())
        if bad:
            raise Avs3dError(f"ray casting: {bad} of {len(triangles)} triangles are not finite; repair the mesh")
        global _last
        digest = hashlib.blake2b(triangles.data).digest()
        last = _last  # read once: another thread may set it
        if last is not None and last[0] == digest:
            self._scene = last[1]
            return
        _last = last = None  # frees the memory before the next is built
        with one_core():  # else each process begins as many threads as there are cores
            self._scene = EmbreeScene(robust=True)
            TriangleMesh(self._scene, triangles)
            # The first query commits (builds) the scene: done here, so that later ones only read and may share threads.
            self._scene.run(np.zeros((1, 3), dtype=np.float32), np.ones((1, 3), dtype=np.float32))
        _last = digest, self._scene

    def intersect(self, origins: F32, directions: F32, far: F32 | None = None) -> dict[str, Any]:
        """First hits: ``primID`` (-1 where none), barycentric ``u`` and ``v``, distance ``tfar`` in direction lengths.

        Args:
            origins: (N, 3) float32.
            directions: (N, 3) float32, any length.
            far: (N,) float32, largest distance in direction lengths; no limit if missing. It is not changed.
        """
        # Embree writes the distances of the hits into the array of the limits.
        limit = None if far is None else far.copy()
        hits: dict[str, Any] = self._scene.run(origins, directions, limit, query="INTERSECT", output=True)
        return hits

    def occluded(self, origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        """(N,) whether each ray hits anything nearer than ``far`` (N,) direction lengths."""
        found = self._scene.run(origins, directions, far, query="OCCLUDED")
        return np.asarray(found >= 0)


def open_tracer(triangles: F32, device: str = "cpu") -> Tracer:
    """A tracer over (F, 3, 3) triangles on ``device``, one of `TRACERS`.

    Raises:
        Avs3dError: see `Tracer`, or if CUDA cannot be used.
    """
    tracer: Tracer = import_by_name(TRACERS[device])(triangles)
    return tracer


def repeated(point: ArrayLike, count: int) -> F32:
    """``point`` (3,) as a read-only (count, 3) float32 array without copies (stride 0)."""
    row = np.array(point, dtype=np.float32).reshape(1, 3)
    return as_strided(row, shape=(count, 3), strides=(0, row.strides[1]))


class RayCaster:
    """Ray queries with checked arguments against all surfaces of a scene, or against an array of triangles.

    Faces are numbered part after part: the faces of part p begin at ``first_face[p]``; ``face_part[f]`` is the part of
    face f. A ray may start anywhere; one that starts on a surface can hit this surface at a distance of 0, so move its
    origin along the normal by about a millimetre.

    Args:
        geometry: a `Scene`, or triangles (F, 3, 3) in metres.

    Raises:
        Avs3dError: for an empty scene, numbers that are not finite, or a missing embreex.
    """

    def __init__(self, geometry: Scene | ArrayLike) -> None:
        if isinstance(geometry, Scene):
            if not geometry.parts:
                raise Avs3dError(f"{geometry.name}: the scene has no parts; expected at least one mesh")
            counts = [len(part.mesh.positions) for part in geometry.parts]
            triangles = np.concatenate([part.mesh.positions for part in geometry.parts])
        else:
            triangles = np.asarray(geometry, dtype=np.float32)
            counts = [len(triangles)] if triangles.ndim else [0]
        self._tracer = Tracer(triangles)
        #: (P + 1,) int64: index of each part's first face, then the number of faces.
        self.first_face: NDArray[np.int64] = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        #: (F,) int32: the part each face belongs to.
        self.face_part: I32 = np.repeat(np.arange(len(counts), dtype=np.int32), counts)

    def closest(self, origins: ArrayLike, directions: ArrayLike) -> tuple[F32, I32]:
        """Find the first surface that each ray hits.

        Args:
            origins: (N, 3), or (3,) for a common origin; metres.
            directions: (N, 3), not necessarily of unit length.

        Returns:
            distance (N,) float32 in lengths of the direction (metres for unit vectors; the depth for directions with a
            depth of 1 along the optical axis), inf without a hit; face (N,) int32, −1 without a hit.

        Raises:
            Avs3dError: for numbers that are not finite, or directions of length 0.
        """
        start, along = _rays(origins, directions)
        distance = np.full(len(along), np.inf, dtype=np.float32)
        face = np.full(len(along), -1, dtype=np.int32)
        for first in range(0, len(along), CHUNK):
            chunk = slice(first, first + CHUNK)
            hit = self._tracer.intersect(start[chunk], along[chunk])
            found = hit["primID"] >= 0
            face[chunk] = hit["primID"]
            distance[chunk][found] = hit["tfar"][found]
        return distance, face

    def occluded(self, origins: ArrayLike, directions: ArrayLike, distance: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether each ray hits any surface, from either side, nearer than ``distance``.

        Args:
            origins: (N, 3), or (3,) for a common origin; metres.
            directions: (N, 3), not necessarily of unit length.
            distance: (N,) or a number, in lengths of the direction. To test whether a segment p → q is free, pass the
                direction q − p and a distance a little below 1, so that the surface on which q lies does not count.

        Returns:
            (N,) bool.

        Raises:
            Avs3dError: for numbers that are not finite (an infinite distance is allowed), or directions of length 0.
        """
        start, along = _rays(origins, directions)
        limit = np.array(np.broadcast_to(np.asarray(distance, dtype=np.float32), len(along)))
        if np.isnan(limit).any():
            raise Avs3dError("ray casting: a distance is NaN; expected numbers ≥ 0 or inf")
        np.minimum(limit, _FAR, out=limit)
        out = np.empty(len(along), dtype=np.bool_)
        for first in range(0, len(along), CHUNK):
            chunk = slice(first, first + CHUNK)
            out[chunk] = self._tracer.occluded(start[chunk], along[chunk], limit[chunk])
        return out


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[F32, F32]:
    along = np.ascontiguousarray(directions, dtype=np.float32)
    if along.ndim != 2 or along.shape[1] != 3:
        raise Avs3dError(f"ray casting: directions have shape {along.shape}, expected (N, 3)")
    start = np.asarray(origins, dtype=np.float32)
    if start.shape == (3,):
        start = repeated(start, len(along))
    if start.shape != along.shape:
        raise Avs3dError(f"ray casting: origins have shape {start.shape}, expected {along.shape} or (3,)")
    if not (np.isfinite(start).all() and np.isfinite(along).all()):
        raise Avs3dError("ray casting: an origin or a direction is not finite; correct the pose or the mesh")
    if len(along) and not along.any(axis=1).all():
        raise Avs3dError("ray casting: a direction has length 0")
    return np.ascontiguousarray(start) if start.strides[0] else start, along
