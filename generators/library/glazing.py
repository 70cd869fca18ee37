"""Replaces transparent parts of imported models: masks take glass for opaque.

A pane close in front of a surface, such as the glass on a clock's dial, is removed, because one sees the surface behind
it. Glass with depth behind it, such as a washing machine's door or a jug, would leave a hole: it becomes opaque, in the
colour of glass in front of a dark inside.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from generators.core.rays import RayCaster
from generators.library.rawmesh import MeshFinding, PartSurface, RawPart, corners

Array = NDArray[np.float64]

#: Below this opacity a part counts as transparent.
OPAQUE = 0.9
#: Largest distance (m) from a pane to the surface behind it for which the pane is removed.
NEAR = 0.03
#: Linear albedo of an unlit inside behind glass.
_DIM = 0.03
_GRID = 96


def settle(parts: tuple[RawPart, ...]) -> tuple[tuple[RawPart, ...], tuple[MeshFinding, ...]]:
    """The parts (metres, Y up, front +Z) without transparency."""
    findings: list[MeshFinding] = []
    parts = tuple(_flat(part, findings) for part in parts)
    clear = [number for number, part in enumerate(parts) if part.surface.alpha < OPAQUE]
    if not clear:
        return parts, tuple(findings)
    gaps = _gaps(parts, clear)
    out = []
    for number, part in enumerate(parts):
        if number not in gaps:
            out.append(part)
            continue
        name, gap = part.surface.name, gaps[number]
        if part.surface.alpha < 0.02 or gap < NEAR:
            why = f"is {100 * gap:.1f} cm in front of a surface" if gap < NEAR else "is completely transparent"
            findings.append(MeshFinding("mended", f"{name!r} (opacity {part.surface.alpha:.2g}) {why}: left out"))
            continue
        findings.append(MeshFinding("mended", f"{name!r} (opacity {part.surface.alpha:.2g}) is made opaque and dark"))
        out.append(replace(part, surface=_darkened(part.surface)))
    return (tuple(out), tuple(findings)) if out else (parts, tuple(findings))


def _darkened(surface: PartSurface) -> PartSurface:
    """Opaque glass: a mixture of its own colour, in proportion to its opacity, and a dark inside."""
    keep = surface.alpha**2  # light passes through the pane twice, on its way in and out
    r, g, b = (keep * c + (1 - keep) * _DIM for c in surface.colour)
    name = surface.name if "glass" in surface.name.lower() else f"{surface.name} glass"
    return replace(surface, name=name, colour=(r, g, b), alpha=1.0)


def _flat(part: RawPart, findings: list[MeshFinding]) -> RawPart:
    """The part with a texture that has no alpha channel any more."""
    pixels = part.surface.pixels
    if pixels is None or pixels.shape[2] == 3:
        return part
    opacity = pixels[..., 3:].astype(np.float64) / 255
    plain = pixels[..., :3]
    if opacity.min() > 0.99:
        return replace(part, surface=replace(part.surface, pixels=plain.copy()))
    name = part.surface.name
    if part.uv is not None and opacity.mean() < 0.98:
        # Faces on transparent texels are removed; half-transparent texels are blended with the mean opaque colour.
        height, width = opacity.shape[:2]
        inside = part.uv.mean(axis=1)
        column = np.floor((inside[:, 0] % 1) * width).astype(int).clip(0, width - 1)
        row = np.floor(((1 - inside[:, 1]) % 1) * height).astype(int).clip(0, height - 1)
        corner_column = np.floor((part.uv[..., 0] % 1) * width).astype(int).clip(0, width - 1)
        corner_row = np.floor(((1 - part.uv[..., 1]) % 1) * height).astype(int).clip(0, height - 1)
        gone = (opacity[row, column, 0] < 0.5) & (opacity[corner_row, corner_column, 0] < 0.5).all(axis=1)
        large = _larger_than_a_texel(part.uv, width, height)
        gone &= ~large
        if gone.any() and not gone.all():
            findings.append(
                MeshFinding("mended", f"{int(gone.sum())} faces of {name!r} show only transparent texels: left out")
            )
            part = part.take(~gone)
    share = 1 - float(opacity.mean())
    if share > 0.5:
        # Lettering on transparent film is treated like a pane, by its distance to the surface behind it.
        surface = replace(part.surface, pixels=None, alpha=min(part.surface.alpha, 1 - share))
        findings.append(MeshFinding("note", f"the texture of {name!r} is {share:.0%} transparent: treated as a pane"))
        return replace(part, surface=surface, uv=None)
    solid = opacity[..., 0] > 0.5
    fill = plain[solid].mean(axis=0) if solid.any() else np.full(3, 188.0)
    mixed = np.round(plain * opacity + fill * (1 - opacity)).astype(np.uint8)
    findings.append(
        MeshFinding("mended", f"the texture of {name!r} was {share:.0%} transparent: filled with its mean colour")
    )
    return replace(part, surface=replace(part.surface, pixels=mixed))


def _larger_than_a_texel(uv: Array, width: int, height: int) -> NDArray[np.bool_]:
    """Faces that cover so much of the texture that the texels at their corners are not representative."""
    extent = np.ptp(uv, axis=1) * (width, height)
    return np.asarray(extent.max(axis=1) > 8)


def _gaps(parts: tuple[RawPart, ...], clear: list[int]) -> dict[int, float]:
    """Per transparent part, the median distance (m) to the surface behind it, along views from the front."""
    triangles = corners(parts)
    owner = np.concatenate([np.full(len(part.triangles), n) for n, part in enumerate(parts)])
    see_through = np.isin(owner, clear)
    caster = RayCaster(triangles.astype(np.float32))
    solid = RayCaster(triangles[~see_through].astype(np.float32)) if (~see_through).any() else None
    low, high = triangles.reshape(-1, 3).min(axis=0), triangles.reshape(-1, 3).max(axis=0)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 + 0.01
    met: dict[int, list[Array]] = {number: [] for number in clear}
    step = (np.arange(_GRID) + 0.5) / _GRID * 2 - 1
    grid = np.array(list(product(step, step))) * radius
    for yaw, pitch in product((-0.7, 0.0, 0.7), (0.0, 0.6)):
        toward = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
        above = np.cross(toward, right)
        origins = middle + toward * radius + grid @ np.stack([right, above])
        directions = np.repeat(-toward[None], len(origins), axis=0)
        distance, face = caster.closest(origins, directions)
        first = np.flatnonzero(face >= 0)
        first = first[see_through[face[first]]]
        if not len(first):
            continue
        behind = np.full(len(first), np.inf)
        if solid is not None:
            behind = solid.closest(origins[first], directions[first])[0] - distance[first]
        for number in clear:
            met[number].append(behind[owner[face[first]] == number])
    gaps = {}
    for number, found in met.items():
        values = np.concatenate(found) if found else np.zeros(0)
        gaps[number] = float(np.median(values)) if len(values) else np.inf
    return gaps
