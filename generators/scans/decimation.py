"""Dense scans: a copy with fewer faces for all but pictures.

Above `DENSE` faces, sound, supports, the walkable floor and light use a copy of the scan with about `RAY_FACES` faces;
pictures show every face. The copy is simplified by quadric error (Garland and Heckbert 1997; package
fast-simplification): tops stay where they are, and thin boards stay two surfaces. Vertex clustering on a grid would be
as fast, but it merges the two sides of what is thinner than a cell. What is flat and plain collapses into large faces,
which are divided again, because a face of the copy has one colour: that of the scan in its middle.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import needing
from generators.assets.acoustic_twin import weld
from generators.core.scene import F32, I32, Mesh

#: Scans of more faces are decimated, to about so many: those of a room are then some 1 cm wide.
DENSE, RAY_FACES = 2_000_000, 1_000_000
#: Corners are welded within this share of the usual edge.
_WELD = 1e-3
#: Longest edge of the copy, in sides of the square that would be its mean face; how often a face is halved for it.
_LONGEST, _HALVINGS = 4.0, 20
#: What `_by_quadric_error` runs: its folder, the number of faces and the path of modules are the arguments.
_PROGRAM = """
import json, sys
folder, target, sys.path[:] = sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3])
import fast_simplification, numpy
arrays = (numpy.load(f"{folder}/{name}.npy") for name in ("points", "faces"))
points, faces = fast_simplification.simplify(*arrays, target_count=target)
numpy.save(f"{folder}/points_out.npy", points)
numpy.save(f"{folder}/faces_out.npy", faces)
"""
#: At most so many of the scan's faces, evenly chosen, are asked for the colour and the material of the copy's.
_ASKED = 2 * RAY_FACES


class ScanMesh(NamedTuple):
    """A scan's mesh for all but pictures, and the one that pictures show if that is another."""

    mesh: Mesh
    dense: Mesh | None


def for_rays(mesh: Mesh) -> ScanMesh:
    """Decimate a scan of more than `DENSE` faces to about `RAY_FACES`; any other stays as it is.

    Args:
        mesh: in any unit; its acoustic faces are its own.

    Returns:
        The copy, whose acoustic faces are its own, and ``mesh`` without any.

    Raises:
        Avs3dError: if fast-simplification is not installed, or fails.
    """
    if len(mesh.positions) <= DENSE:
        return ScanMesh(mesh, None)
    triangles = _simplified(mesh.positions, RAY_FACES)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    solid = length[:, 0] > 0
    triangles, normals = triangles[solid], (cross[solid] / length[solid]).astype(np.float32)
    asked = slice(None, None, -(-len(mesh.positions) // _ASKED))
    nearest = cKDTree(mesh.positions[asked].mean(axis=1)).query(triangles.mean(axis=1))[1]
    material = mesh.face_material[asked][nearest]
    uv = mesh.uv[asked][nearest].mean(axis=1)
    labels = np.array([each.acoustic for each in mesh.materials], dtype=object)[material]
    copy = replace(
        mesh,
        positions=triangles,
        normals=np.repeat(normals[:, None], 3, axis=1),
        uv=np.repeat(uv[:, None], 3, axis=1),
        face_material=material,
        acoustic_positions=triangles,
        acoustic_labels=tuple(labels),
    )
    return ScanMesh(copy, replace(mesh, acoustic_positions=mesh.acoustic_positions[:0], acoustic_labels=()))


def _simplified(triangles: NDArray[np.float32], target: int) -> NDArray[np.float32]:
    """About ``target`` faces (F, 3, 3) that stand for ``triangles`` (N, 3, 3)."""
    from trimesh.remesh import subdivide_to_size

    few = triangles[:: -(-len(triangles) // target)].astype(np.float64)
    usual = float(np.median(np.linalg.norm(few[:, 1] - few[:, 0], axis=1)))
    vertices, welded = weld(triangles, _WELD * usual)  # type: ignore[arg-type]  # half the memory of float64
    # The package's thresholds are lengths: in usual edges, they do not depend on the unit of the file.
    small = (vertices / np.float32(usual)).astype(np.float32)
    points, faces = _by_quadric_error(small, welded.astype(np.int32), target)
    corners = points[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    longest = _LONGEST * float(np.sqrt(area / len(faces)))
    divided, faces = subdivide_to_size(  # type: ignore[no-untyped-call]
        points.astype(np.float64), faces, longest, max_iter=_HALVINGS
    )
    return np.asarray((divided * usual)[faces].astype(np.float32))


def _by_quadric_error(points: F32, faces: I32, target: int) -> tuple[F32, I32]:
    """Vertices (V, 3) and about ``target`` faces (F, 3), by a process of its own.

    The package's arrays are global (250 bytes a face): in this process, they would stay until it ends.

    Raises:
        Avs3dError: if the package is missing or the process fails, e.g. because memory is short.
    """
    with needing("decimating a dense scan", "pip install fast-simplification"):
        import fast_simplification  # type: ignore[import-untyped]  # noqa: F401
    with TemporaryDirectory(prefix="avs3d-") as folder:
        np.save(f"{folder}/points.npy", points)
        np.save(f"{folder}/faces.npy", faces)
        words = [sys.executable, "-c", _PROGRAM, folder, str(target), json.dumps(sys.path)]
        done = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
        if done.returncode:
            last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
            raise Avs3dError(
                f"a scan of {len(faces):,} faces cannot be decimated ({last[0]}); give it more memory, or export the "
                "scan with fewer faces"
            )
        return np.load(f"{folder}/points_out.npy"), np.load(f"{folder}/faces_out.npy")
