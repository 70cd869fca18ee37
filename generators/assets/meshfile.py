"""Reads GLB, glTF, OBJ and PLY files as a `Mesh`, or as a `Model` of one of the categories.

Colours follow each format: glTF's factors and vertex colours are linear light, those of OBJ and PLY are sRGB. An OBJ's
``Kd`` is ignored if it has ``map_Kd``, which is the intention of most writers. Vertex colours become a texture of 4 × 4
texels per face; beside a texture they are ignored. So is the alpha of glTF. What is read of materials is told by
`generators.assets.gltf_materials` and `generators.assets.mtl`.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from avs3d_bench.contract.taxonomy import check_category
from avs3d_bench.errors import Avs3dError
from generators.assets.acoustic_twin import clustered, component_boxes
from generators.assets.gltf import LARGEST_TEXTURE, check_images, read_tree, rewritten
from generators.assets.gltf_materials import attach_extras, decoded, emission_of, gltf_look, map_of
from generators.assets.meshcheck import check_file, check_obj_sizes
from generators.assets.model import Model, framed
from generators.assets.modelframe import before_front, clear_of_twin, upright
from generators.assets.mtl import ROUGHNESS, mtl_look
from generators.assets.objects.design import Design, Mount, Point
from generators.assets.objects.finishes import to_linear, to_srgb
from generators.assets.shapes import corner_normals
from generators.core.scene import F32, Licence, Material, Mesh, Texture

Array = NDArray[np.float64]

#: Range of a model's longest side (m); a file outside this range is not in metres.
PLAUSIBLE = (0.02, 5.0)
#: Largest coordinate (the file's own units); products of larger ones exceed the range of single precision.
FARTHEST = 1e12


class CategoryDefaults(NamedTuple):
    """Defaults of a category: height (m), mount, and height of the sound source as a share of the object's."""

    height: float
    mount: Mount
    source_height: float


#: The height is for files whose units are wrong.
_DEFAULTS = {
    "washing_machine": CategoryDefaults(0.85, "floor", 0.5),
    "toilet": CategoryDefaults(0.78, "floor", 0.45),
    "vacuum_cleaner": CategoryDefaults(0.90, "floor", 0.25),
    "microwave": CategoryDefaults(0.29, "surface", 0.5),
    "coffee_machine": CategoryDefaults(0.35, "surface", 0.7),
    "clock": CategoryDefaults(0.34, "wall", 0.5),
    "telephone": CategoryDefaults(0.14, "surface", 0.5),
    "oven": CategoryDefaults(0.29, "surface", 0.5),
    "dishwasher": CategoryDefaults(0.85, "floor", 0.5),
    "kettle": CategoryDefaults(0.24, "surface", 0.5),
    "fan": CategoryDefaults(0.42, "surface", 0.65),
    "radio": CategoryDefaults(0.19, "surface", 0.5),
}
#: Points of a triangle (barycentric) at which an emissive texture is looked up, and the least light that counts.
_POINTS = np.array([(4, 1, 1), (1, 4, 1), (1, 1, 4), (2, 2, 2), (2.9, 2.9, 0.2), (0.2, 2.9, 2.9), (2.9, 0.2, 2.9)]) / 6
_LEAST_GLOW = 2.0**-6
#: Words in a material's name that determine its acoustic label.
_WORDS = {
    "wood": "wood oak walnut pine timber parquet laminate mdf",
    "metal": "metal steel chrome iron alumin brass copper",
    "glass": "glass window mirror",
    "ceramic": "ceramic porcelain enamel toilet sink",
    "tile": "tile",
    "fabric": "fabric cloth textile",
    "curtain": "curtain drape",
    "carpet": "carpet rug",
    "upholstery": "leather cushion sofa upholst",
    "plastic": "plastic rubber abs",
    "brick": "brick",
    "concrete": "concrete cement",
    "plaster": "plaster drywall ceiling",
    "paper": "paper book cardboard",
    "foliage": "plant leaf foliage",
}
#: Meshes of more faces have one colour per face: faces are then smaller than pixels, whose averages would mix texels
#: of distant faces.
_SHADED_MOST = 300_000
#: Side of a tile of faces in the texture of vertex colours.
_TILE = 64
#: Above this number of faces, plain face normals replace the slow `corner_normals` (a loop over vertices).
_SMOOTH_LIMIT = 60_000
#: Faces that are worked on at a time in double precision: of a whole scan, that would be gigabytes.
_BLOCK = 1 << 16


def load_mesh(
    path: str | Path,
    *,
    acoustic: str = "plastic",
    twin: Literal["boxes", "surface"] = "boxes",
    max_acoustic_faces: int = 20_000,
    textures: bool = True,
) -> Mesh:
    """Read a mesh with its colours, textures and normals; a scene graph is flattened.

    Args:
        path: .glb, .gltf, .obj or .ply; an OBJ's MTL and textures must be beside it.
        acoustic: label of materials whose name does not determine one (``Material.003``, unlike ``oak_wood``).
        twin: the acoustic twin: a box per connected part, or the surface itself, decimated.
        max_acoustic_faces: largest number of faces of the decimated surface.
        textures: whether textures are read; without them a GLB's surfaces have their materials' plain colours.

    Raises:
        Avs3dError: if the file, its MTL or a texture is missing, unreadable or truncated, if it has no faces, if a
            coordinate is not finite, if its geometry is compressed, or if its textures need a decoder that is not
            installed.
    """
    file = Path(path)
    scene = open_scene(file, textures=textures)
    known = _Known()
    instances = list(_instances(file, scene))
    found = (_piece(file, name, part, matrix, acoustic, known) for name, part, matrix in instances)
    pieces = [own for piece in found if piece is not None for own in _shining(piece, known)]
    if not pieces:
        flat = ", ".join(repr(name) for name, _, _ in instances[:3])
        if flat:
            raise Avs3dError(f"{file}: every face of {flat} is degenerate (no area); repair the mesh")
        raise Avs3dError(f"{file}: has no faces (an empty scene, or points and lines only); expected triangles")
    positions = _joined([p.positions for p in pieces])
    materials = tuple({id(p.materials[0]): p.materials[0] for p in pieces}.values())
    order = {id(material): index for index, material in enumerate(materials)}
    face_material = np.concatenate([p.face_material + order[id(p.materials[0])] for p in pieces])
    labels = np.array([m.acoustic for m in materials], dtype=object)[face_material]
    sound: Array | F32
    if twin == "surface" and len(positions) <= max_acoustic_faces:
        sound, names = positions, tuple(labels)
    else:
        reduced = component_boxes if twin == "boxes" else partial(clustered, max_faces=max_acoustic_faces)
        sound, names = reduced(positions.astype(np.float64), labels.astype(str))
    mesh = Mesh(
        positions=positions,
        normals=_joined([p.normals for p in pieces]),
        uv=_joined([p.uv for p in pieces]),
        face_material=face_material.astype(np.int32),
        materials=materials,
        acoustic_positions=sound.astype(np.float32, copy=False),
        acoustic_labels=names,
    )
    mesh.check(str(file))
    return mesh


def _joined(arrays: list[F32]) -> F32:
    """The rows of some arrays, one array as itself: of a large scan, a copy is hundreds of megabytes."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def open_scene(file: Path, *, textures: bool = True) -> Any:
    """The reader's scene graph of a mesh file, with its KTX2 textures decoded, or without any textures.

    Raises:
        Avs3dError: see `load_mesh`.
    """
    import trimesh

    check_file(file)
    with _large_images():
        try:
            data = None
            if file.suffix.lower() == ".obj":
                check_obj_sizes(file)
            if file.suffix.lower() in (".glb", ".gltf"):
                if textures:
                    check_images(file)
                data = rewritten(file, textures=textures)
            source = file if data is None else io.BytesIO(data)
            scene = trimesh.load_scene(source, file_type=None if data is None else "glb", process=False)
            if file.suffix.lower() in (".glb", ".gltf"):
                attach_extras(read_tree(file), scene)
            return scene
        except Avs3dError:
            raise
        except Exception as error:  # each format's reader raises its own exceptions
            reason = " ".join(str(error).split()) or type(error).__name__
            raise Avs3dError(
                f"{file}: cannot be read as {file.suffix[1:]} ({reason}); check that it is complete"
            ) from error


@contextmanager
def _large_images() -> Iterator[None]:
    """Let Pillow read the textures of scans, which are larger than what it takes for an attack."""
    before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, LARGEST_TEXTURE**2
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def world_triangles(file: Path, scene: Any) -> Iterator[tuple[Array, NDArray[np.int64], Any]]:
    """Per mesh: corners (F, 3, 3) in the file's world, vertex indices (F, 3) and the reader's own geometry.

    Raises:
        Avs3dError: see `world_vertices`.
    """
    for name, part, matrix in _instances(file, scene):
        vertices, faces = world_vertices(file, name, part, matrix), np.asarray(part.faces, dtype=np.int64)
        yield vertices[faces], faces, part


def world_vertices(file: Path, name: str, part: Any, matrix: Array) -> Array:
    """Vertices (V, 3) of the reader's geometry ``part`` in the file's world, in the file's units.

    Raises:
        Avs3dError: if one is not finite, or farther than `FARTHEST` from the origin.
    """
    vertices = np.asarray(part.vertices, dtype=np.float64)
    bad = int((~np.isfinite(vertices)).any(axis=1).sum()) + (0 if np.isfinite(matrix).all() else len(vertices))
    if bad:
        raise Avs3dError(f"{file}: {bad} vertices of {name!r} are NaN or infinite; repair the mesh")
    with np.errstate(over="ignore", invalid="ignore"):
        world: Array = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        reach = float(np.abs(world).max(initial=0.0))
    if not reach <= FARTHEST:
        raise Avs3dError(
            f"{file}: vertices of {name!r} have coordinates up to {reach:.3g}; expected at most {FARTHEST:.0e} of the "
            "file's units; repair or rescale the mesh"
        )
    return world


def usual_of(category: str) -> CategoryDefaults:
    """Defaults of a category of the benchmark, or of a distractor.

    Raises:
        UsageError: if there is no such category.
    """
    return _DEFAULTS[check_category(category, silent=True)]


def load_model(
    path: str | Path,
    category: str,
    *,
    licence: Licence,
    height: float | None = None,
    up: str = "y",
    front: str = "+z",
    source_point: Point | None = None,
    usual: CategoryDefaults | None = None,
) -> Model:
    """Read a mesh as a model of ``category``, in the model frame of `generators.assets.catalogue`.

    Args:
        path: see `load_mesh`.
        category: one of the categories or a distractor; with ``usual``, any name.
        licence: licence of the file.
        height: metres; without it the file's units are taken as metres, unless its longest side is then above 5 m or
            below 2 cm: in this case it gets the category's usual height.
        up: the file's axis that points up: ``x``, ``y``, ``z``, with or without sign.
        front: the file's axis that points to the front.
        source_point: position of the sound source in the model frame; default: 3 cm in front of the front surface, at
            a height typical of the category.
        usual: what is usual for the category; default: the values for the categories of the benchmark.

    Raises:
        UsageError: for an unknown category, or axes that are not valid or not perpendicular.
        Avs3dError: see `load_mesh`; or if the height is not a plausible number.
    """
    usual = usual or usual_of(category)
    turn = upright(up, front)
    mesh = load_mesh(path).transformed(turn, np.zeros(3))
    extent = np.diff(mesh.bounds.astype(np.float64), axis=0)[0]
    if height is None and not PLAUSIBLE[0] <= extent.max() <= PLAUSIBLE[1]:
        height = usual.height
    if height is not None:
        if not (np.isfinite(height) and 0.01 <= height <= PLAUSIBLE[1]):
            raise Avs3dError(f"{path}: height {height} is not between 0.01 and {PLAUSIBLE[1]} m")
        if extent[1] <= 0:
            raise Avs3dError(f"{path}: is flat along its up axis {up!r}; name another axis, or leave out the height")
        mesh = mesh.transformed(np.eye(3), np.zeros(3), height / float(extent[1]))
    design = framed(Design(mesh, usual.mount, (0.0, 0.0, 0.0)))
    point = source_point if source_point is not None else before_front(design.mesh, usual.source_height)
    clear = clear_of_twin(design.mesh, point)
    return Model(Path(path).name, category, clear, design.mount, licence, point)


@dataclass(eq=False)
class _Known:
    """Materials converted so far.

    Attributes:
        materials: by the identity of the reader's own.
        glows: emissive texture and factor of some, by their identity.
        shining: those with the light of some of their faces.
    """

    materials: dict[int, Material] = field(default_factory=dict)
    glows: dict[int, tuple[Texture, tuple[float, float, float]]] = field(default_factory=dict)
    shining: dict[tuple[Any, ...], Material] = field(default_factory=dict)


# ---- one geometry of the file -------------------------------------------------------------------------------------


def _instances(file: Path, scene: Any) -> Iterator[tuple[str, Any, Array]]:
    """Name, geometry and local-to-world matrix of every triangle mesh in the scene graph, sorted by name.

    The names are those of geometries, because the reader invents random names for the nodes of a mesh with several
    primitives.

    Raises:
        Avs3dError: if a face refers to a vertex that does not exist.
    """
    import trimesh

    nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
    for matrix, name in sorted(nodes, key=lambda node: (str(node[1]), np.asarray(node[0], dtype=np.float64).tolist())):
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh) and len(part.faces):
            if not 0 <= int(np.min(part.faces)) <= int(np.max(part.faces)) < len(part.vertices):
                raise Avs3dError(
                    f"{file}: faces of {str(name)!r} refer to vertex {int(np.max(part.faces))}, it has "
                    f"{len(part.vertices)}; check that the file is complete"
                )
            yield str(name), part, np.asarray(matrix, dtype=np.float64)


def _piece(file: Path, name: str, part: Any, matrix: Array, acoustic: str, known: _Known) -> Mesh | None:
    """One geometry as a mesh in the file's world, still without its acoustic twin; None if no face has an area.

    ``known`` has the materials converted so far, so that textures are decoded once.
    """
    vertices, faces = world_vertices(file, name, part, matrix), np.asarray(part.faces, dtype=np.int64)
    linear_part = matrix[:3, :3]
    if np.linalg.det(linear_part) < 0:  # a mirrored node reverses the winding of its faces
        faces = faces[:, ::-1]
    cross = _crosses(vertices, faces)
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.reshape(-1)] = True
    span = float(np.ptp(vertices[used], axis=0).max())
    keep = np.linalg.norm(cross, axis=1) > 1e-14 * max(span, 1e-12) ** 2
    if not keep.any():
        return None
    kept = np.flatnonzero(keep)
    if len(kept) < len(faces):
        faces, cross = faces[keep], cross[keep]
    if "vertex_normals" in part._cache:  # only in this case the normals come from the file
        given = np.asarray(part.vertex_normals, dtype=np.float64) @ np.linalg.inv(linear_part)
        normals = _unit(given[faces], cross)
    elif len(faces) <= _SMOOTH_LIMIT:
        normals = corner_normals(vertices[faces])
    else:
        flat = cross / np.linalg.norm(cross, axis=1, keepdims=True)
        normals = np.repeat(flat.astype(np.float32)[:, None], 3, axis=1)
        del flat
    del cross
    material, uv = _surface(file, name, part, vertices, faces, kept, acoustic, known)
    return Mesh(
        positions=vertices.astype(np.float32)[faces],
        normals=normals.astype(np.float32, copy=False),
        uv=uv.astype(np.float32, copy=False),
        face_material=np.zeros(len(faces), dtype=np.int32),
        materials=(material,),
        acoustic_positions=np.zeros((0, 3, 3), dtype=np.float32),
        acoustic_labels=(),
    )


def _crosses(vertices: Array, faces: NDArray[np.int64]) -> Array:
    """(F, 3) normals of the faces (F, 3), twice as long as the faces are large."""
    out = np.empty((len(faces), 3))
    for first in range(0, len(faces), _BLOCK):
        corner = vertices[faces[first : first + _BLOCK]]
        out[first : first + _BLOCK] = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return out


def _unit(normals: Array, cross: Array) -> Array:
    """(F, 3, 3) unit normals; a normal that is zero or not finite is replaced by that of the face."""
    face = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    good = np.isfinite(length) & (length > 1e-9)
    return np.where(good, normals / np.where(good, length, 1.0), face[:, None])


def _surface(
    file: Path,
    name: str,
    part: Any,
    vertices: Array,
    faces: NDArray[np.int64],
    kept: NDArray[np.int64],
    acoustic: str,
    known: _Known,
) -> tuple[Material, Array | F32]:
    """The material of a geometry and its (F, 3, 2) texture coordinates."""
    gltf = file.suffix.lower() in (".glb", ".gltf")
    visual = part.visual
    uv: Array | F32 = np.zeros((len(faces), 3, 2))
    kind = getattr(visual, "kind", None)
    if kind in ("vertex", "face"):
        if kind == "vertex" and len(faces) <= _SHADED_MOST:
            colours = np.asarray(visual.vertex_colors, dtype=np.float64)[faces, :3]
            texture, uv = _shaded(colours, vertices[faces], name, gltf)
        else:
            texture, centre = _palette(visual, name, faces, kept, gltf)
            uv = np.repeat(centre.astype(np.float32)[:, None], 3, axis=1)
        fresh = Material(name, _sounds_like(name, acoustic), texture=texture, roughness=ROUGHNESS)
        return known.materials.setdefault(id(visual), fresh), uv
    source = getattr(visual, "material", None)
    if source is None:
        fresh = Material(name, _sounds_like(name, acoustic), colour=(0.6, 0.6, 0.6), roughness=ROUGHNESS)
        return known.materials.setdefault(id(visual), fresh), uv
    painted = getattr(visual, "vertex_attributes", {}).get("color")
    if painted is not None and getattr(source, "baseColorTexture", None) is None:
        from trimesh.visual.color import to_rgba

        colours = np.asarray(to_rgba(painted), dtype=np.float64)[faces, :3]
        if len(faces) > _SHADED_MOST:
            colours[:] = colours.mean(axis=1, keepdims=True)
        plain = _material(file, source, name, gltf, acoustic, _Known())
        texture, uv = _shaded(colours, vertices[faces], name, gltf)
        plain = replace(plain, texture=texture, normal_map=None, roughness_map=None)
        return known.materials.setdefault(id(visual), plain), uv
    material = known.materials.get(id(source))
    if material is None:
        material = known.materials[id(source)] = _material(file, source, name, gltf, acoustic, known)
    maps = material.texture, material.normal_map, material.roughness_map, known.glows.get(id(material))
    if any(each is not None for each in maps):
        given = getattr(visual, "uv", None)
        if given is None:
            raise Avs3dError(
                f"{file}: {name!r} has a texture but no texture coordinates; unwrap it or drop the texture"
            )
        uv = np.asarray(given, dtype=np.float64)[faces]
        if not np.isfinite(uv).all():
            raise Avs3dError(f"{file}: texture coordinates of {name!r} are NaN or infinite; repair the mesh")
    return material, uv


def _material(file: Path, source: Any, name: str, gltf: bool, acoustic: str, known: _Known) -> Material:
    """Convert one of the reader's materials; ``name`` is that of the first geometry with it."""
    title = str(getattr(source, "name", None) or name)
    image = getattr(source, "baseColorTexture", None) if gltf else getattr(source, "image", None)
    factor = getattr(source, "baseColorFactor", None) if gltf else getattr(source, "diffuse", None)
    colour = (1.0, 1.0, 1.0)
    if factor is not None and (gltf or image is None):
        values = np.asarray(factor, dtype=np.float64)[:3]
        r, g, b = (float(v) for v in (values / 255 if gltf else to_linear(values)))
        colour = (r, g, b)
    texture = None if image is None else Texture(title, decoded(file, image, title))
    look = gltf_look(file, source, title) if gltf else mtl_look(file, source, title)
    material = Material(title, _sounds_like(f"{title} {name}", acoustic), colour=colour, texture=texture, **look)
    if gltf and (glow := map_of(file, source, "emissiveTexture", title)) is not None:
        known.glows[id(material)] = glow, emission_of(source)
    return material


def _shining(piece: Mesh, known: _Known) -> list[Mesh]:
    """A piece of one material as itself; with an emissive texture, one piece for each stop of light of its faces.

    A face shines as the mean of the texture at seven points of it (its corners, its middle, and between them).
    """
    material = piece.materials[0]
    if id(material) not in known.glows:
        return [piece]
    texture, factor = known.glows[id(material)]
    height, width = texture.pixels.shape[:2]
    u, v = np.moveaxis(np.mod(_POINTS @ piece.uv.astype(np.float64), 1.0), -1, 0)
    rows, columns = ((1 - v) * height).astype(int).clip(0, height - 1), (u * width).astype(int).clip(0, width - 1)
    light = to_linear(texture.pixels[rows, columns]).mean(axis=1) * factor
    light[light.max(axis=1) < _LEAST_GLOW] = 0
    steps = np.round(np.log2(np.maximum(light, _LEAST_GLOW))).astype(int)
    kinds, kind = np.unique(steps, axis=0, return_inverse=True)
    out = []
    for number in range(len(kinds)):
        faces = np.flatnonzero(kind.reshape(-1) == number)
        red, green, blue = light[faces].mean(axis=0).tolist()
        key = id(material), number, red, green, blue
        own = known.shining.setdefault(key, replace(material, emission=(red, green, blue)))
        arrays = {name: getattr(piece, name)[faces] for name in ("positions", "normals", "uv", "face_material")}
        out.append(replace(piece, **arrays, materials=(own,)))
    return out


def _shaded(colours: Array, triangles: Array, name: str, gltf: bool) -> tuple[Texture, Array]:
    """A texture in which the corners' colours run into one another, and its (F, 3, 2) coordinates.

    Each face has 4 × 4 texels: in the middle its corners' colours and, opposite to the first, the one that makes
    bilinear look-up linear over the face; around them the same gradient, for a renderer that averages texels where
    faces are as small as its pixels. Faces near to one another lie near in the texture, in tiles of 64 × 64 by Morton's
    order.

    Args:
        colours: (F, 3, 3) of each corner, 0 to 255; linear light in glTF.
        triangles: (F, 3, 3) corners.
        name: of the texture.
        gltf: whether the colours are linear light.
    """
    light = colours / 255 if gltf else to_linear(colours)
    # Any corner may be the first: take the one whose opposite texel is least outside of the range.
    opposite = light.sum(axis=1, keepdims=True) - 2 * light
    first = np.argmin(np.abs(opposite - np.clip(opposite, 0, 1)).sum(axis=2), axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    start, right, down = np.take_along_axis(light, order[..., None], axis=1).transpose(1, 0, 2)
    right, down = right - start, down - start
    middle = triangles.mean(axis=1)
    span = max(float(np.ptp(middle, axis=0).max()), 1e-12)
    place = np.empty(len(middle), dtype=np.int64)
    near = np.argsort(_morton(((middle - middle.min(axis=0)) / span * 1023).astype(np.int64)), kind="stable")
    place[near] = np.arange(len(middle))
    wide = max(1, math.isqrt(len(middle) // _TILE**2))
    tile, inside = np.divmod(place, _TILE**2)
    column, row = _TILE * (tile % wide) + _compact(inside), _TILE * (tile // wide) + _compact(inside >> 1)
    image = np.zeros((4 * _TILE * int(tile.max() // wide + 1), 4 * _TILE * wide, 3), dtype=np.uint8)
    for y in range(4):
        for x in range(4):
            image[4 * row + y, 4 * column + x] = to_srgb(start + (x - 1) * right + (y - 1) * down)
    height, width = image.shape[:2]
    corner = np.stack([(4 * column + 1.5) / width, 1 - (4 * row + 1.5) / height], axis=1)
    uv = np.empty((len(middle), 3, 2))
    step = np.array([[0, 0], [1 / width, 0], [0, -1 / height]])
    np.put_along_axis(uv, order[..., None], corner[:, None] + step, axis=1)
    return Texture(f"{name}_colours", image), uv


def _morton(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) the bits of three numbers below 1024 in turn: points near in space are near in this order."""
    out = np.zeros(len(cells), dtype=np.int64)
    for axis in range(3):
        bits = cells[:, axis]
        for bit in range(10):
            out |= ((bits >> bit) & 1) << (3 * bit + axis)
    return out


def _compact(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) every second bit of twelve."""
    out = np.zeros_like(number)
    for bit in range(6):
        out |= ((number >> (2 * bit)) & 1) << bit
    return out


def _palette(
    visual: Any, name: str, faces: NDArray[np.int64], kept: NDArray[np.int64], gltf: bool
) -> tuple[Texture, Array]:
    """Vertex or face colours as a texture with one texel per colour, and where (F, 2) that of each face is.

    A face gets the mean of its corners' colours.
    """
    if visual.kind == "vertex":
        given = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3]
    else:
        given, faces = np.asarray(visual.face_colors, dtype=np.float64)[:, :3], kept[:, None]
    pixels = np.empty((len(faces), 3), dtype=np.uint8)
    for first in range(0, len(faces), _BLOCK):
        colours = given[faces[first : first + _BLOCK]].mean(axis=1)
        pixels[first : first + _BLOCK] = to_srgb(colours / 255) if gltf else np.round(colours).astype(np.uint8)
    # One number for each colour: rows would be compared as records, thirty times as slowly.
    codes, index = np.unique(pixels @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32), return_inverse=True)
    side = int(np.ceil(np.sqrt(len(codes))))
    image = np.zeros((side * side, 3), dtype=np.uint8)
    image[: len(codes)] = codes[:, None] >> np.array([16, 8, 0]) & 255
    index = index.reshape(-1)
    centre = np.stack([(index % side + 0.5) / side, 1 - (index // side + 0.5) / side], axis=1)
    return Texture(f"{name}_colours", image.reshape(side, side, 3)), centre


def _sounds_like(name: str, default: str) -> str:
    lower = name.lower()
    for label, words in _WORDS.items():
        if any(word in lower for word in words.split()):
            return label
    return default
