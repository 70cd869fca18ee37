"""Mesh cleaning: converts any model to one clean, upright GLB, and reports the findings.

    read → axes → metres → broken and double faces → transparency → winding → normals → textures → GLB

The clean GLB is in metres, Y up, front towards +Z, with its footprint's centre at the origin; every face has normals,
and either an opaque colour or texture coordinates in a texture of at most 2048 pixels. It is read with
`generators.assets.meshfile.load_model`, like any other mesh.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from avs3d_bench.errors import Avs3dError
from generators.assets.modelframe import upright
from generators.assets.mtl import ROUGHNESS
from generators.assets.objects.finishes import to_linear
from generators.assets.shapes import corner_normals
from generators.library import glazing, simplify
from generators.library.cleanglb import write_clean_glb
from generators.library.orientation import WELD, find_winding
from generators.library.rawmesh import NEUTRAL, MeshFinding, RawPart, corners, read_raw

__all__ = ["MAX_PIXELS", "MeshFinding", "clean", "version"]

Array = NDArray[np.float64]

_VERSION = "2"
#: Longest side of a texture, pixels.
MAX_PIXELS = 2048
#: Roughness of metal that is told by its name alone: between brushed and polished.
_BARE_METAL = 0.4
#: Range of a household object's longest side (m); a file outside this range is in another unit.
_PLAUSIBLE = (0.04, 3.0)
_UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254, "feet": 0.3048}
#: Distance of a sheet's back from its front (m).
_THICKNESS = 0.0006
#: Words in material names that identify a material, in several languages.
_GLOSSARY = {
    "metal": "chrom crom inox steel acier stahl alumin iron metal",
    "ceramic": "fayence faience porcel ceram keram",
    "glass": "glass vidro verre vetro vidrio",
    "wood": "wood bois madeira madera legno holz",
    "plastic": "plastic plastik plastique grisplas",
    "fabric": "tela tissu stoff tecido",
}


def version() -> str:
    """Version of the cleaning; it changes whenever the same file could give another GLB."""
    return _VERSION


def clean(
    file: Path,
    *,
    up: str = "y",
    front: str = "+z",
    height: float | None = None,
    yaw: float = 0.0,
    size: tuple[float, float, float] | None = None,
) -> tuple[bytes, tuple[MeshFinding, ...]]:
    """Make a clean GLB of a mesh file.

    Args:
        file: .glb, .gltf, .obj (its MTL and textures beside it), .ply, .stl or .dae.
        up: the file's axis that points up: ``x``, ``y``, ``z``, with or without sign.
        front: the file's axis that points to the front.
        height: height to which it is scaled, metres; without it the unit is guessed from its size.
        yaw: turn about the vertical afterwards, degrees, positive to the left.
        size: width, height and depth (metres) from its catalogue, to find the unit and to check the result.

    Returns:
        The bytes of the GLB, and the findings, the most severe first.

    Raises:
        UsageError: for axes that are not valid or not perpendicular.
        Avs3dError: if the file has no usable mesh, or a fault cannot be repaired.
    """
    parts, read = read_raw(Path(file))
    findings = list(read)
    parts = _turned(parts, upright(up, front), yaw)
    parts = _in_metres(file, parts, height, size, findings)
    parts = _sound_faces(file, parts, findings)
    parts, settled = glazing.settle(parts)
    findings += settled
    if (total := sum(len(part.triangles) for part in parts)) > simplify.MAX_FACES:
        try:
            parts = simplify.simplified(parts, simplify.MAX_FACES)
        except Avs3dError as error:
            raise Avs3dError(f"{file}: {error}") from None
        parts = _sound_faces(file, parts, [])
        left = sum(len(part.triangles) for part in parts)
        findings.append(MeshFinding("warning", f"{total} faces were simplified to {left}: check the result"))
    parts = _outward(parts, findings)
    parts = tuple(_dressed(part, findings) for part in parts)
    parts = _centred(parts)
    order = {"warning": 0, "mended": 1, "note": 2}
    unique = dict.fromkeys(findings)
    return (
        write_clean_glb(parts, f"avs3d-bench hygiene {version()}"),
        tuple(sorted(unique, key=lambda finding: order[finding.severity])),
    )


def _turned(parts: tuple[RawPart, ...], rotation: Array, yaw: float) -> tuple[RawPart, ...]:
    if not np.isfinite(yaw):
        raise Avs3dError(f"yaw {yaw} is not finite; expected degrees")
    s, c = np.sin(np.radians(yaw)), np.cos(np.radians(yaw))
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ rotation
    return tuple(
        replace(
            part, triangles=part.triangles @ turn.T, normals=None if part.normals is None else part.normals @ turn.T
        )
        for part in parts
    )


def _in_metres(
    file: Path,
    parts: tuple[RawPart, ...],
    height: float | None,
    size: tuple[float, float, float] | None,
    findings: list[MeshFinding],
) -> tuple[RawPart, ...]:
    points = corners(parts).reshape(-1, 3)
    extent = np.ptp(points, axis=0)
    longest = float(extent.max())
    if not longest > 0:
        raise Avs3dError(f"{file}: all its vertices are one point; expected a solid object")
    if height is not None:
        if not (np.isfinite(height) and 0.005 <= height <= 5):
            raise Avs3dError(f"{file}: height {height} is not between 0.005 and 5 m")
        if extent[1] < 1e-6 * longest:
            raise Avs3dError(f"{file}: is flat along its up axis; name another axis, or leave out the height")
        factor = height / float(extent[1])
        unit = next((name for name, scale in _UNITS.items() if abs(factor / scale - 1) < 0.03), "")
        if unit != "metres":
            what = f"its unit was {unit}" if unit else f"scaled by {factor:.4g} to a height of {height:g} m"
            findings.append(MeshFinding("mended" if unit else "note", what))
    else:
        factor = _guessed(file, extent, size, findings)
    if size is not None:
        off = extent * factor / np.asarray(size) - 1
        if np.abs(off).max() > 0.05:
            found = " × ".join(f"{v:.3f}" for v in extent * factor)
            wanted = " × ".join(f"{v:.3f}" for v in size)
            findings.append(
                MeshFinding("warning", f"is {found} m (width × height × depth), its catalogue says {wanted} m")
            )
    return tuple(replace(part, triangles=part.triangles * factor) for part in parts)


def _guessed(file: Path, extent: Array, size: tuple[float, float, float] | None, findings: list[MeshFinding]) -> float:
    longest = float(extent.max())
    if size is not None:
        ratio = float(np.median(np.asarray(size)[extent > 0] / extent[extent > 0]))
        unit = min(_UNITS, key=lambda name: abs(np.log(ratio / _UNITS[name])))
        if abs(np.log(ratio / _UNITS[unit])) < 0.1:
            if unit != "metres":
                findings.append(MeshFinding("mended", f"its unit was {unit}, according to its size in the catalogue"))
            return _UNITS[unit]
        findings.append(MeshFinding("note", f"scaled by {ratio:.4g} to its size in the catalogue"))
        return ratio
    for unit, scale in _UNITS.items():
        if _PLAUSIBLE[0] <= longest * scale <= _PLAUSIBLE[1]:
            if unit != "metres":
                text = f"is {longest:.4g} units long: assumed to be {unit} ({longest * scale:.3g} m); name its height"
                findings.append(MeshFinding("warning", text))
            return scale
    raise Avs3dError(f"{file}: is {longest:.4g} units long: no household object in any usual unit; name its height")


def _sound_faces(file: Path, parts: tuple[RawPart, ...], findings: list[MeshFinding]) -> tuple[RawPart, ...]:
    """The parts without faces of zero area and without duplicate faces (the same three corners)."""
    triangles = corners(parts)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    keep = (
        np.linalg.norm(cross, axis=1) > 2e-10
    )  # aspect ratio or area too small: a tenth of a square millimetre in a thousand
    if thin := int((~keep).sum()):
        findings.append(MeshFinding("mended", f"{thin} faces without area were left out"))
    grid = np.round(triangles / WELD).astype(np.int64)
    _, vertex = np.unique(grid.reshape(-1, 3), axis=0, return_inverse=True)
    names = np.sort(vertex.reshape(-1, 3), axis=1)
    candidates = np.flatnonzero(keep)
    _, first = np.unique(names[candidates], axis=0, return_index=True)
    once = np.zeros(len(triangles), dtype=bool)
    once[candidates[first]] = True
    if double := int(keep.sum() - once.sum()):
        findings.append(MeshFinding("mended", f"{double} duplicate faces were left out"))
    out, start = [], 0
    for part in parts:
        mask = once[start : start + len(part.triangles)]
        start += len(part.triangles)
        if mask.any():
            out.append(part.take(mask))
    if not out:
        raise Avs3dError(f"{file}: every face is degenerate (no area); repair the mesh")
    return tuple(out)


def _outward(parts: tuple[RawPart, ...], findings: list[MeshFinding]) -> tuple[RawPart, ...]:
    """Wind faces counter-clockwise from outside, add a back to sheets, and compute normals."""
    triangles = corners(parts)
    winding = find_winding(triangles)
    if winding.inconsistent:
        findings.append(
            MeshFinding("mended", f"{winding.inconsistent} faces were wound in the opposite sense to their neighbours")
        )
    if winding.inverted:
        findings.append(MeshFinding("mended", f"{winding.inverted} faces of parts that were inside out were reversed"))
    if winding.shared:
        findings.append(MeshFinding("note", f"non-manifold: more than two faces meet at {winding.shared} edges"))
    if winding.sheet.any():
        count = int(winding.sheet.sum())
        findings.append(
            MeshFinding("mended", f"{count} faces of thin sheets that are visible from both sides were given a back")
        )
    wound = np.where(winding.flip[:, None, None], triangles[:, [0, 2, 1]], triangles)
    smooth = corner_normals(wound)
    out, start = [], 0
    for part in parts:
        span = slice(start, start + len(part.triangles))
        start = span.stop
        flip, sheet = winding.flip[span], winding.sheet[span]
        normals = _normals(part, wound[span], smooth[span], flip)
        uv = None if part.uv is None else np.where(flip[:, None, None], part.uv[:, [0, 2, 1]], part.uv)
        outward = RawPart(wound[span], part.surface, normals, uv)
        if sheet.any():
            front = outward.take(sheet)
            assert front.normals is not None
            behind = front.triangles - _THICKNESS * front.normals
            back = RawPart(
                behind[:, [0, 2, 1]],
                part.surface,
                -front.normals[:, [0, 2, 1]],
                None if front.uv is None else front.uv[:, [0, 2, 1]],
            )
            outward = _joined(outward, back)
        out.append(outward)
    return tuple(out)


def _joined(a: RawPart, b: RawPart) -> RawPart:
    assert a.normals is not None
    assert b.normals is not None
    uv = None if a.uv is None or b.uv is None else np.concatenate([a.uv, b.uv])
    return RawPart(np.concatenate([a.triangles, b.triangles]), a.surface, np.concatenate([a.normals, b.normals]), uv)


def _normals(part: RawPart, wound: Array, smooth: Array, flip: NDArray[np.bool_]) -> Array:
    """The file's own shading normals if they are usable and on the outer side, else smoothed ones."""
    if part.normals is None:
        return smooth
    given = np.where(flip[:, None, None], part.normals[:, [0, 2, 1]], part.normals)
    with np.errstate(invalid="ignore", divide="ignore"):
        given = given / np.linalg.norm(given, axis=2, keepdims=True)
    cross = np.cross(wound[:, 1] - wound[:, 0], wound[:, 2] - wound[:, 0])
    face = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    side = np.einsum("fkc,fc->fk", np.nan_to_num(given), face)
    given = np.where(side[..., None] < 0, -given, given)
    usable = np.isfinite(given).all(axis=2) & (np.abs(side) > 0.2)
    return np.where(usable[..., None], given, smooth)


def _reduced(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image with at most `MAX_PIXELS` to a side."""
    height, width = pixels.shape[:2]
    scale = min(1.0, MAX_PIXELS / max(width, height))
    if scale == 1.0:
        return pixels
    new = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(Image.fromarray(pixels).resize(new, Image.Resampling.LANCZOS))


def _limited(pixels: NDArray[np.uint8] | None) -> NDArray[np.uint8] | None:
    return None if pixels is None else _reduced(pixels)


def _dressed(part: RawPart, findings: list[MeshFinding]) -> RawPart:
    """A part with texture coordinates for its texture, a texture of limited size, and its material in its name."""
    surface = part.surface
    name = surface.name
    if surface.pixels is not None and part.uv is None:
        # Without texture coordinates, the colour of a surface is unknown, in particular if the texture is an atlas.
        plain = surface.colour
        if min(plain) > 0.99:
            r, g, b = (float(v) for v in to_linear(surface.pixels.reshape(-1, 3).mean(axis=0)))
            plain = (r, g, b)
        findings.append(
            MeshFinding("warning", f"{name!r} has a texture but no texture coordinates: it gets a plain colour")
        )
        surface = replace(surface, pixels=None, colour=plain)
    elif surface.pixels is not None:
        height, width = surface.pixels.shape[:2]
        pixels = surface.pixels
        if max(width, height) > MAX_PIXELS:
            pixels = _reduced(pixels)
            new = pixels.shape[1::-1]
            text = f"the texture of {name!r} was reduced from {width} × {height} to {new[0]} × {new[1]} pixels"
            findings.append(MeshFinding("mended", text))
        # In OBJ files a texture replaces the colour beside it.
        surface = replace(surface, pixels=pixels, colour=(1.0, 1.0, 1.0))
        surface = replace(surface, normals=_limited(surface.normals), rough=_limited(surface.rough))
    if surface.pixels is None and (surface.normals is not None or surface.rough is not None):
        findings.append(MeshFinding("note", f"{name!r} has maps but no coloured texture: its maps are left out"))
        surface = replace(surface, normals=None, rough=None)
    if surface.colour == NEUTRAL and surface.pixels is None and name in ("", "None", "material_0"):
        findings.append(MeshFinding("note", "a part has no colour: it becomes grey"))
    lower = name.lower()
    label = next((kind for kind, words in _GLOSSARY.items() if any(word in lower for word in words.split())), "")
    if label and label not in lower:
        name = f"{name} {label}"
    # A file that says nothing about reflection may still say that it is metal, by its name.
    metallic = surface.metallic if surface.metallic is not None else float(label == "metal")
    if surface.roughness is None:
        surface = replace(surface, roughness=_BARE_METAL if metallic else ROUGHNESS)
    # Real surfaces do not reflect all light: white paper has an albedo below 0.9.
    r, g, b = (float(np.clip(v, 0.0, 1.0)) for v in surface.colour)
    limit = 1.0 if surface.pixels is not None else 0.86
    surface = replace(surface, name=name, colour=(min(r, limit), min(g, limit), min(b, limit)), metallic=metallic)
    return replace(part, surface=surface, uv=part.uv if surface.pixels is not None else None)


def _centred(parts: tuple[RawPart, ...]) -> tuple[RawPart, ...]:
    points = corners(parts).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    return tuple(replace(part, triangles=part.triangles - middle) for part in parts)
