"""Simplifies meshes with too many faces by quadric error (Garland & Heckbert 1997; package fast-simplification)."""

from __future__ import annotations

import numpy as np

from avs3d_bench.errors import Avs3dError
from generators.library.rawmesh import RawPart

#: Largest number of faces of an object; more faces cost time in every frame and are not visible at a usual distance.
MAX_FACES = 150_000


def simplified(parts: tuple[RawPart, ...], target: int) -> tuple[RawPart, ...]:
    """The parts with about ``target`` faces in all; their normals are dropped, texture coordinates kept.

    Vertices are split at texture seams, so that each vertex has one pair of texture coordinates; for the simplification
    seams are open edges, which stay in place.

    Raises:
        Avs3dError: if the package is not installed, or the mesh cannot be reduced to so few faces.
    """
    total = sum(len(part.triangles) for part in parts)
    try:
        import fast_simplification  # type: ignore[import-untyped]
    except ImportError:
        raise Avs3dError(
            f"it has {total} faces, more than {target}; pip install fast-simplification, or simplify it yourself"
        ) from None
    out = []
    for part in parts:
        wanted = max(4, int(len(part.triangles) * target / total))
        position = part.triangles.reshape(-1, 3)
        uv = np.zeros((len(position), 2)) if part.uv is None else part.uv.reshape(-1, 2)
        span = max(float(np.ptp(position, axis=0).max()), 1e-9)
        keys = np.concatenate([np.round(position / (1e-6 * span)), np.round(uv * 1e6)], axis=1)
        _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        faces = inverse.reshape(-1, 3)
        proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
        faces = faces[proper].astype(np.int32)
        if len(faces) <= wanted:
            out.append(
                RawPart(position[first][faces], part.surface, None, uv[first][faces] if part.uv is not None else None)
            )
            continue
        points, _, collapses = fast_simplification.simplify(
            position[first].astype(np.float64), faces, target_count=wanted, return_collapses=True
        )
        points, kept, mapping = fast_simplification.replay_simplification(position[first], faces, collapses)
        coordinates = None
        if part.uv is not None:
            # The texture coordinates of the original vertex that is nearest to the new position of its group.
            mapping = np.asarray(mapping)
            distance = np.linalg.norm(position[first] - points[mapping], axis=1)
            order = np.lexsort((distance, mapping))
            groups, where = np.unique(mapping[order], return_index=True)
            nearest = np.zeros(len(points), dtype=np.int64)
            nearest[groups] = order[where]
            coordinates = uv[first][nearest][kept]
        out.append(RawPart(np.asarray(points, dtype=np.float64)[kept], part.surface, None, coordinates))
    left = sum(len(part.triangles) for part in out)
    if left > 1.5 * target:
        raise Avs3dError(f"it has {total} faces, simplified {left}; expected at most {target}, simplify it by hand")
    return tuple(out)
