"""Reads mesh files from others in spite of their faults: a missing file becomes a finding, not an error.

The reader of `generators.assets.meshfile` refuses a file if its MTL or a texture is missing. Here the part gets a
neutral colour and a warning, because a person checks the findings and the thumbnail before an asset is used.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from avs3d_bench.errors import Avs3dError
from generators.assets.gltf import read_tree
from generators.assets.gltf_materials import gltf_look, known_extras
from generators.assets.meshfile import open_scene, world_vertices
from generators.assets.mtl import mtl_look, statements
from generators.assets.objects.finishes import to_linear
from generators.library.objfile import SiblingFileResolver, cut_polygons, decoded

Array = NDArray[np.float64]
Severity = Literal["note", "mended", "warning"]

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae")
#: Linear albedo of a part without a colour.
NEUTRAL = (0.5, 0.5, 0.5)
#: Largest number of faces that is read.
MAX_FACES = 5_000_000


@dataclass(frozen=True, order=True)
class MeshFinding:
    """One line about a mesh: a note, a repair, or a warning after which a person should check the result."""

    severity: Severity
    text: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.text}"


@dataclass(frozen=True, eq=False)
class PartSurface:
    """The surface of a part.

    Attributes:
        name: of its material.
        colour: linear albedo (3,), multiplied with the texture.
        pixels: (H, W, 3 or 4) uint8 sRGB, the fourth channel is the opacity; row 0 is the top.
        alpha: opacity of the whole surface.
        metallic: as the file declares it; None if it does not.
        roughness: likewise.
        clearcoat: see `generators.core.scene.Material`.
        emission: radiance in the scene's light unit.
        normals: (h, w, 3) uint8 normal map of glTF.
        rough: (h, w, 3) uint8 map, green × ``roughness``, blue × ``metallic``.
    """

    name: str
    colour: tuple[float, float, float]
    pixels: NDArray[np.uint8] | None = None
    alpha: float = 1.0
    metallic: float | None = None
    roughness: float | None = None
    clearcoat: float = 0.0
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normals: NDArray[np.uint8] | None = None
    rough: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class RawPart:
    """Triangles of one material.

    Attributes:
        triangles: (F, 3, 3).
        surface: their material.
        normals: (F, 3, 3) from the file, if it has normals.
        uv: (F, 3, 2), v up, if the file has texture coordinates.
    """

    triangles: Array
    surface: PartSurface
    normals: Array | None = None
    uv: Array | None = None

    def take(self, keep: NDArray[Any]) -> RawPart:
        """The part with some of its faces (a mask or indices)."""
        return RawPart(
            self.triangles[keep],
            self.surface,
            None if self.normals is None else self.normals[keep],
            None if self.uv is None else self.uv[keep],
        )


@dataclass(eq=False)
class _Reading:
    findings: list[MeshFinding] = field(default_factory=list)
    surfaces: dict[int, PartSurface] = field(default_factory=dict)

    def note(self, severity: Severity, text: str) -> None:
        finding = MeshFinding(severity, text)
        if finding not in self.findings:
            self.findings.append(finding)


def read_raw(file: Path) -> tuple[tuple[RawPart, ...], tuple[MeshFinding, ...]]:
    """The parts of a mesh file in its own axes and units, and the faults found.

    Raises:
        Avs3dError: if the file is missing, of an unknown kind, truncated or unreadable, or has no faces or too many.
    """
    reading = _Reading()
    scene = _open(file, reading)
    parts = []
    # Sorted by the names of geometries, because the reader invents random names for nodes.
    nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
    for matrix, name in sorted(nodes, key=lambda node: (str(node[1]), np.asarray(node[0], dtype=np.float64).tolist())):
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh) and len(part.faces):
            parts.append(_part(file, str(name), part, np.asarray(matrix, dtype=np.float64), reading))
        else:
            reading.note("note", f"{str(name)!r} has no triangles (only points or lines); left out")
    total = sum(len(part.triangles) for part in parts)
    if not total:
        raise Avs3dError(f"{file}: has no faces (an empty scene, or points and lines only); expected triangles")
    if total > MAX_FACES:
        raise Avs3dError(f"{file}: has {total} faces; expected at most {MAX_FACES}, simplify it first")
    return tuple(parts), tuple(reading.findings)


def _open(file: Path, reading: _Reading) -> Any:
    suffix = file.suffix.lower()
    if not file.is_file():
        raise Avs3dError(f"{file}: no such file; expected a mesh ({', '.join(SUFFIXES)})")
    if suffix not in SUFFIXES:
        raise Avs3dError(f"{file}: unknown kind of mesh {file.suffix!r}; expected one of {', '.join(SUFFIXES)}")
    if suffix in (".glb", ".gltf"):
        tree = read_tree(file)
        for item in (*tree.get("buffers", ()), *tree.get("images", ())):
            uri = unquote(str(item.get("uri", "data:")))
            if not uri.startswith("data:") and not (file.parent / uri).resolve().is_relative_to(file.parent.resolve()):
                raise Avs3dError(f"{file}: refers to {uri!r}, outside of its folder; refused")
        return open_scene(file)
    beside = SiblingFileResolver(file.parent)
    try:
        if suffix == ".obj":
            text, cut = cut_polygons(decoded(file.read_bytes()))
            _report(text, cut, beside, reading)
            data = io.BytesIO(text.encode())
            return trimesh.load_scene(data, file_type="obj", resolver=beside, process=False)
        return trimesh.load_scene(file, resolver=beside, process=False)
    except ImportError as error:
        raise Avs3dError(f"{file}: {suffix} needs a package that is not installed ({error}); save it as GLB") from error
    except Exception as error:  # each format's reader raises its own exceptions
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise Avs3dError(
            f"{file}: cannot be read as {suffix[1:]} ({reason}); check that the file is complete"
        ) from error


def _report(text: str, cut: int, beside: SiblingFileResolver, reading: _Reading) -> None:
    """Faults of an OBJ that the reader ignores."""
    if cut:
        reading.note("note", f"{cut} concave polygons were cut into triangles")
    libraries = re.findall(r"^\s*mtllib\s+(.+?)\s*$", text, re.MULTILINE)
    used = dict.fromkeys(re.findall(r"^\s*usemtl\s+(.+?)\s*$", text, re.MULTILINE))
    known: set[str] = set()
    for library in libraries:
        path = beside.find(library)
        if path is None:
            reading.note("warning", f"its material library {library!r} is missing; its parts become grey")
        else:
            known |= _report_textures(decoded(path.read_bytes()), beside, reading)
    if not libraries and used:
        reading.note("warning", "it names materials but no material library; its parts become grey")
    elif known and (lost := [name for name in used if name not in known]):
        reading.note("warning", f"its material library lacks {', '.join(map(repr, lost[:3]))}; those parts become grey")


def _report_textures(mtl: str, beside: SiblingFileResolver, reading: _Reading) -> set[str]:
    """Report missing and broken textures of a material library, and return its materials' names."""
    title, known = "", set()
    for line in mtl.splitlines():
        head, rest = (*line.split(None, 1), "", "")[:2]
        if head == "newmtl":
            title = " ".join(rest.split())[:80]
            known.add(rest.strip())
        elif head.lower() == "map_kd" and rest.strip():
            name = rest.split()[-1] if rest.startswith("-") else rest.strip()
            found = beside.find(name)
            try:
                if found is None:
                    raise FileNotFoundError("missing")
                Image.open(found).verify()
            except Exception as error:  # each codec raises its own exceptions
                what = "missing" if found is None else f"broken ({' '.join(str(error).split())[:80]})"
                reading.note("warning", f"texture {name!r} of {title!r} is {what}: its parts get a plain colour")
    return known


def _part(file: Path, name: str, part: Any, matrix: Array, reading: _Reading) -> RawPart:
    vertices, faces = world_vertices(file, name, part, matrix), np.asarray(part.faces, dtype=np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise Avs3dError(f"{file}: a face of {name!r} refers to a vertex that does not exist; repair the mesh")
    kept: NDArray[np.int64] = np.arange(len(faces))
    order = np.array([0, 1, 2])
    if np.linalg.det(matrix[:3, :3]) < 0:  # a mirrored node reverses the winding of its faces
        order = np.array([0, 2, 1])
    faces = faces[:, order]
    triangles = vertices[faces]
    normals = None
    if "vertex_normals" in part._cache:  # only in this case the normals come from the file
        given = np.asarray(part.vertex_normals, dtype=np.float64)
        with np.errstate(all="ignore"):
            normals = (given @ np.linalg.pinv(matrix[:3, :3]))[faces]
    surface = _surface(file, name, part, reading)
    uv = getattr(part.visual, "uv", None) if surface.pixels is not None else None
    if uv is not None and len(uv) == len(vertices):
        uv = np.asarray(uv, dtype=np.float64)[faces]
        if not np.isfinite(uv).all():
            reading.note("mended", f"texture coordinates of {surface.name!r} that were not finite were set to 0")
            uv = np.nan_to_num(uv, nan=0.0, posinf=0.0, neginf=0.0)
    else:
        uv = None
    if getattr(part.visual, "kind", None) in ("vertex", "face"):
        surface, uv = _painted(file, name, part.visual, faces, kept)
    return RawPart(triangles, surface, normals, uv)


def _surface(file: Path, name: str, part: Any, reading: _Reading) -> PartSurface:
    source = getattr(part.visual, "material", None)
    if source is None:
        return PartSurface(name, NEUTRAL)
    known = reading.surfaces.get(id(source))
    if known is None:
        known = reading.surfaces[id(source)] = _material(file, name, source, reading)
    return known


def _material(file: Path, name: str, source: Any, reading: _Reading) -> PartSurface:
    title = " ".join(str(getattr(source, "name", None) or name).split())[:80]
    physical = hasattr(source, "baseColorFactor")
    image = getattr(source, "baseColorTexture" if physical else "image", None)
    factor = getattr(source, "baseColorFactor" if physical else "diffuse", None)
    values = np.ones(4) if factor is None else np.asarray(factor, dtype=np.float64) / 255
    values = np.append(values, np.ones(4))[:4] if len(values) < 4 else values[:4]
    options = getattr(source, "kwargs", None) or {}
    alpha = float(values[3])
    if physical:
        if getattr(source, "alphaMode", None) not in ("BLEND", "MASK"):
            alpha = 1.0
        colour = values[:3]
    else:
        plain = _numbers(options.get("kd"))
        colour = to_linear(255 * np.clip(plain if len(plain) == 3 else values[:3], 0, 1))
        opacity, transparency = _numbers(options.get("d")), _numbers(options.get("tr"))
        if len(opacity):
            alpha = float(np.clip(opacity[-1], 0, 1))
        elif len(transparency):
            alpha = float(np.clip(1 - transparency[-1], 0, 1))
    pixels = None
    if image is not None:
        try:
            transparent = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
            pixels = np.asarray(image.convert("RGBA" if transparent else "RGB")).copy()
        except Exception as error:  # each codec raises its own exceptions
            reading.note(
                "warning", f"the texture of {title!r} cannot be decoded ({error}); its parts get a plain colour"
            )
    if physical and pixels is not None and getattr(source, "alphaMode", None) not in ("BLEND", "MASK"):
        pixels = pixels[..., :3]
    r, g, b = (float(v) for v in colour)
    plain_surface = PartSurface(title, (r, g, b), pixels, alpha)
    return _look(file, source, plain_surface, reading) if physical or options else plain_surface


def _look(file: Path, source: Any, surface: PartSurface, reading: _Reading) -> PartSurface:
    """``surface`` with what its material says about light besides the colour; without it, after a fault."""
    try:
        physical = hasattr(source, "baseColorFactor")
        look = gltf_look(file, source, surface.name) if physical else mtl_look(file, source, surface.name)
    except Avs3dError as error:
        reading.note("warning", f"{str(error).removeprefix(f'{file}: ')}; its parts get the usual reflection")
        return surface
    if physical:
        extras = known_extras(source)
        for name in extras.ignored:
            reading.note("note", f"{surface.name!r}: the extension {name} is not read and changes nothing")
        for name in extras.foreign:
            reading.note("note", f"{surface.name!r}: its {name} has texture coordinates of its own; left out")
        if source.emissiveTexture is not None:
            reading.note("note", f"{surface.name!r}: its emissive texture is left out")
    normals, rough = look.get("normal_map"), look.get("roughness_map")
    # Without Pr, Pm or Ns an MTL says nothing; glTF always has a value.
    said = physical or {"pr", "pm", "ns"} & statements(source).keys()
    return replace(
        surface,
        metallic=look.get("metallic", 0.0) if said else None,
        roughness=look.get("roughness", 1.0) if said else None,
        clearcoat=look.get("clearcoat", 0.0),
        emission=look.get("emission", (0.0, 0.0, 0.0)),
        normals=None if normals is None else normals.pixels,
        rough=None if rough is None else rough.pixels,
    )


def _numbers(value: Any) -> Array:
    """The numbers of an MTL's statement; empty if there is no such statement or its values are not numbers."""
    try:
        return np.asarray(np.atleast_1d(value), dtype=np.float64) if value is not None else np.zeros(0)
    except (TypeError, ValueError):
        return np.zeros(0)


def _painted(
    file: Path, name: str, visual: Any, faces: NDArray[np.int64], kept: NDArray[np.int64]
) -> tuple[PartSurface, Array]:
    """Vertex or face colours as a texture with one texel per colour (see `generators.assets.meshfile`)."""
    from generators.assets.meshfile import _palette

    texture, centre = _palette(visual, name, faces, kept, file.suffix.lower() in (".glb", ".gltf"))
    return PartSurface(name, (1.0, 1.0, 1.0), texture.pixels), np.repeat(centre[:, None], 3, axis=1)


def corners(parts: tuple[RawPart, ...]) -> Array:
    """(F, 3, 3) triangles of all parts, in their order."""
    return np.concatenate([part.triangles for part in parts])
