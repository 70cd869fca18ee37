"""Preparation of OBJ files for the reader: polygons are cut into triangles, references stay in the file's folder.

Readers cut a polygon into a fan about its first corner, which covers concave parts and holes (a washing machine's front
around its door). Here, polygons that are not convex are first cut by ear clipping (mapbox_earcut).
"""

from __future__ import annotations

import re
from pathlib import Path

import mapbox_earcut
import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SiblingFileResolver(trimesh.resolvers.Resolver):
    """Files in the folder of a mesh or below; if no name matches exactly, case is ignored.

    A name that points elsewhere (``../../secret.mtl``, an absolute path) counts as missing.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()

    def find(self, name: str) -> Path | None:
        """The file to which a reference points, if it exists."""
        try:
            return self._find(name.strip().strip('"').replace("\\", "/"))
        except (OSError, ValueError, RuntimeError):  # a name that is too long, a zero byte, circular links
            return None

    def _find(self, plain: str) -> Path | None:
        for wanted in (plain, plain.rsplit("/", 1)[-1]):  # some programs write absolute paths of their own machine
            path = (self.folder / wanted).resolve()
            if not path.is_relative_to(self.folder) or not wanted:
                continue
            if path.is_file():
                return path
            if path.parent.is_dir():
                same = [p for p in sorted(path.parent.iterdir()) if p.name.lower() == path.name.lower()]
                if same and same[0].is_file() and same[0].resolve().is_relative_to(self.folder):
                    return same[0]
        return None

    def get(self, name: str) -> bytes:
        """The bytes of a reference (the reader's interface)."""
        path = self.find(str(name))
        if path is None:
            raise ValueError(f"{name!r} is not in the folder of the mesh")
        data = path.read_bytes()
        return decoded(data).encode() if path.suffix.lower() == ".mtl" else data

    def keys(self) -> list[str]:
        """Names of the files in the folder (the reader's interface)."""
        return sorted(path.name for path in self.folder.iterdir() if path.is_file())

    def write(self, name: str, data: object) -> None:
        """Not allowed (the reader's interface)."""
        raise PermissionError(f"{name!r}: files cannot be written while a mesh is read")

    def namespaced(self, namespace: str) -> SiblingFileResolver:
        """The same for a folder below (the reader's interface)."""
        return SiblingFileResolver(self.folder / namespace)


def decoded(data: bytes) -> str:
    """Text of an OBJ or MTL: UTF-8, else Latin-1, so that names of materials agree in both."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def cut_polygons(text: str) -> tuple[str, int]:
    """The text of an OBJ with its concave polygons cut into triangles, and their number."""
    lines = text.replace("\\\n", " ").splitlines()
    vertices: list[tuple[float, float, float]] = []
    cut = 0
    for number, line in enumerate(lines):
        head = line.lstrip()[:2]
        if head in ("v ", "v\t"):
            vertices.append(_point(line))
        elif head in ("f ", "f\t"):
            corners = line.split("#")[0].split()[1:]
            if len(corners) > 3:
                triangles = _cut(corners, vertices)
                if triangles is not None:
                    cut += 1
                    lines[number] = "\n".join("f " + " ".join(corners[k] for k in one) for one in triangles)
    return "\n".join(lines) + "\n", cut


def _point(line: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(word) for word in line.split()[1:4])
    except ValueError:
        return float("nan"), float("nan"), float("nan")
    return x, y, z


def _cut(corners: list[str], vertices: list[tuple[float, float, float]]) -> NDArray[np.int64] | None:
    """(T, 3) corners of the triangles of a concave polygon; None for a convex one, or if it cannot be decided."""
    index = []
    for corner in corners:
        found = re.match(r"-?\d+", corner)
        if not found or int(found[0]) == 0:
            return None
        number = int(found[0])
        index.append(number - 1 if number > 0 else len(vertices) + number)
    if min(index) < 0 or max(index) >= len(vertices):
        return None
    points = np.array([vertices[k] for k in index])
    if not (
        np.abs(points) < 1e100
    ).all():  # the mesh will be refused later; here, squares of these values would overflow
        return None
    following = np.roll(points, -1, axis=0)
    normal = np.cross(points, following).sum(axis=0)  # normal by Newell's method
    length = np.linalg.norm(normal)
    if length <= 1e-14:
        return None
    normal = normal / length
    turn = np.cross(following - points, np.roll(points, -2, axis=0) - following) @ normal
    if turn.min() >= -1e-6 * np.abs(turn).max():
        return None
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    u = np.cross(helper, normal)
    u /= np.linalg.norm(u)
    flat = np.stack([points @ u, points @ np.cross(normal, u)], axis=1)
    triangles = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32)).reshape(-1, 3)
    if not len(triangles):
        return None
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    out = triangles.astype(np.int64)
    return np.where(area.sum() < 0, out[:, ::-1], out)
