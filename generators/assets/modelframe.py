"""Moves a mesh from a file into the model frame: axes, sound source, and an acoustic twin that leaves it free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError
from generators.assets.acoustic_twin import box_faces
from generators.assets.objects.design import Point
from generators.core.scene import Mesh

Array = NDArray[np.float64]


def _axis(text: str, what: str) -> Array:
    sign, letter = (text[0], text[1:]) if text[:1] in ("+", "-") else ("+", text)
    if letter.lower() not in ("x", "y", "z"):
        raise UsageError(f"{what} axis {text!r}: expected one of x, y, z, +x … -z")
    vector = np.zeros(3)
    vector["xyz".index(letter.lower())] = -1.0 if sign == "-" else 1.0
    return vector


def upright(up: str, front: str) -> Array:
    """(3, 3) rotation that takes the axis ``up`` of a file to +Y and ``front`` to +Z.

    Raises:
        UsageError: if one is not an axis, or they are not perpendicular.
    """
    y, z = _axis(up, "up"), _axis(front, "front")
    if abs(float(y @ z)) > 0:
        raise UsageError(f"up axis {up!r} and front axis {front!r}: expected two perpendicular axes")
    return np.stack([np.cross(y, z), y, z])


def before_front(mesh: Mesh, level: float, gap: float = 0.03) -> Point:
    """The point ``gap`` metres in front of the surface, at the share ``level`` of the height, nearest the middle."""
    low, high = mesh.bounds.astype(np.float64)
    size = high - low
    best: tuple[float, Point] | None = None
    a, b, c = (mesh.positions[:, k].astype(np.float64) for k in range(3))
    for dx in (0.0, -0.15, 0.15, -0.3, 0.3):
        for dy in (0.0, -0.1, 0.1, -0.2, 0.2):
            x = float(low[0] + size[0] * (0.5 + dx))
            y = float(low[1] + size[1] * min(max(level + dy, 0.05), 0.95))
            # Barycentric coordinates, in the xy plane, of the line along z through (x, y) in each triangle.
            det = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
            safe = np.where(np.abs(det) > 1e-12, det, np.inf)
            u = ((x - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (y - a[:, 1])) / safe
            v = ((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (x - a[:, 0]) * (b[:, 1] - a[:, 1])) / safe
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & np.isfinite(safe)
            if hit.any():
                z = float((a[:, 2] + u * (b[:, 2] - a[:, 2]) + v * (c[:, 2] - a[:, 2]))[hit].max()) + gap
                miss = float(np.hypot(dx, dy))
                if best is None or miss < best[0]:
                    best = (miss, (x, y, z))
    if best is not None:
        return best[1]
    corners = mesh.positions.reshape(-1, 3).astype(np.float64)
    x, y, z = (float(v) for v in corners[np.argmax(corners[:, 2])])
    return x, y, z + gap


def clear_of_twin(mesh: Mesh, point: Point) -> Mesh:
    """Move back the fronts of acoustic boxes that contain ``point``; else the source would be inside a box."""
    boxes = mesh.acoustic_positions.reshape(-1, 12, 3, 3).astype(np.float64)
    labels = np.array(mesh.acoustic_labels).reshape(-1, 12)
    at = np.asarray(point)
    out, names = [], []
    for box, label in zip(boxes, labels, strict=True):
        low, high = box.reshape(-1, 3).min(axis=0), box.reshape(-1, 3).max(axis=0)
        if (at >= low - 0.005).all() and (at <= high + 0.005).all():
            high[2] = at[2] - 0.01
            if high[2] - low[2] < 0.01:
                continue
        out.append(box_faces(low, high))
        names += list(label)
    positions = np.concatenate(out) if out else np.zeros((0, 3, 3))
    return replace(mesh, acoustic_positions=positions.astype(np.float32), acoustic_labels=tuple(str(n) for n in names))
