"""A home like the output of a scanner: one textured mesh with noise and holes, without names or labels.

`fuse` turns any scene into such a mesh; `write_hm3d` and `write_mp3d` lay it out on disk as the two data sets do, with
annotations made from the names that the fused mesh no longer has.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.core.scene import Scene
from generators.core.tone import srgb_encode, tone_curve
from generators.lighting.gather import cells_at
from generators.lighting.lit_scene import LitScene
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, rasterise
from generators.lighting.unwrap import unwrap

Array = NDArray[np.float64]
#: World (Y up) → file (Z up), as in HM3D and MP3D: their reader turns (x, y, z) to (x, z, −y).
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Fused:
    """One mesh.

    Attributes:
        vertices: (V, 3) metres, Y up.
        uv: (V, 2) v up.
        faces: (F, 3).
        owner: (F,) index of the part that a face comes from.
        names: of the parts.
        atlas: (H, W, 3) uint8 sRGB.
    """

    vertices: Array
    uv: Array
    faces: NDArray[np.int64]
    owner: NDArray[np.int64]
    names: tuple[str, ...]
    atlas: NDArray[np.uint8]

    def bounds_of(self, owner: int) -> Array:
        """(2, 3) bounds of what is left of one part."""
        points = self.vertices[self.faces[self.owner == owner]].reshape(-1, 3)
        return np.stack([points.min(axis=0), points.max(axis=0)])


def fuse(
    scene: Scene,
    rng: Generator,
    *,
    noise: float = 0.004,
    edge: float = 0.12,
    texel: float = 0.02,
    holes: int = 120,
) -> Fused:
    """Fuse a scene.

    Args:
        scene: with light maps, which go into the texture, or without: it is then lit from above by a white sky.
        rng: the only source of randomness.
        noise: standard deviation of each vertex along each axis, metres; vertices that coincide move together.
        edge: triangles are split until no edge is longer, metres.
        texel: of the atlas, metres.
        holes: number of places where the faces within 4–15 cm of a random point of the surface are missing.
    """
    meshes = [part.mesh for part in scene.parts]
    corners = np.concatenate([m.positions for m in meshes])
    owner = np.repeat(np.arange(len(meshes)), [len(m.positions) for m in meshes])
    layout = unwrap(corners, texel)
    atlas = _atlas(scene, layout)
    uv = layout.uv.astype(np.float64) / [layout.width, layout.height]
    uv[..., 1] = 1.0 - uv[..., 1]
    soup, uv, origin = split_edges(corners.astype(np.float64), uv, edge)
    owner = owner[origin]
    keys, vertex = np.unique(np.round(soup.reshape(-1, 3) * 1e4).astype(np.int64), axis=0, return_inverse=True)
    moved = keys / 1e4 + rng.normal(0.0, noise, keys.shape)
    soup = moved[vertex.reshape(-1)].reshape(-1, 3, 3)
    keep = np.ones(len(soup), dtype=bool)
    middle = soup.mean(axis=1)
    area = np.linalg.norm(np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0]), axis=1)
    for centre in middle[rng.choice(len(soup), holes, p=area / area.sum())]:
        keep &= np.linalg.norm(middle - centre, axis=1) > rng.uniform(0.04, 0.15)
    soup, uv, owner = soup[keep], uv[keep], owner[keep]
    joined = np.concatenate([soup.reshape(-1, 3), uv.reshape(-1, 2)], axis=1).astype(np.float32)
    unique, faces = np.unique(joined, axis=0, return_inverse=True)
    names = tuple(part.name for part in scene.parts)
    vertices = unique.astype(np.float64)
    return Fused(vertices[:, :3], vertices[:, 3:], faces.reshape(-1, 3), owner, names, atlas)


def split_edges(corners: Array, uv: Array, edge: float) -> tuple[Array, Array, NDArray[np.int64]]:
    """Halve edges longer than ``edge``, the same way on both sides of each, until there are none (red-green)."""
    origin = np.arange(len(corners))
    whole = np.concatenate([corners, uv], axis=2)
    done, done_origin = [], []
    while len(whole):
        side = np.roll(whole[..., :3], -1, axis=1) - whole[..., :3]
        # Rounded, so that both faces at an edge judge it alike.
        long = np.round(np.linalg.norm(side, axis=2), 6) > edge
        count = long.sum(axis=1)
        done.append(whole[count == 0])
        done_origin.append(origin[count == 0])
        pieces, origins = [], []
        for number in (1, 2, 3):
            own, split, from_ = whole[count == number], long[count == number], origin[count == number]
            if not len(own):
                continue
            # Turn the corners so that the first edge is split, and of two the other is the second.
            first = np.argmax(split & ~np.roll(split, 1, axis=1), axis=1) if number < 3 else np.zeros(len(own), int)
            own = np.take_along_axis(own, ((first[:, None] + np.arange(3)) % 3)[..., None], axis=1)
            a, b, c = own[:, 0], own[:, 1], own[:, 2]
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            parts = {
                1: [(a, ab, c), (ab, b, c)],
                2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
                3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
            }[number]
            pieces += [np.stack(piece, axis=1) for piece in parts]
            origins += [from_] * len(parts)
        whole = np.concatenate(pieces) if pieces else whole[:0]
        origin = np.concatenate(origins) if origins else origin[:0]
    out = np.concatenate(done)
    return out[..., :3], out[..., 3:], np.concatenate(done_origin)


def _atlas(scene: Scene, layout) -> NDArray[np.uint8]:
    """What the camera would see of every texel."""
    surfaces = replace(LitSurfaces.of(scene.parts, 1024), part=np.zeros(0, dtype=np.int32))
    surfaces = replace(surfaces, part=np.zeros(len(surfaces.triangles), dtype=np.int32))
    sheet = Sheet.of([layout])
    texels = rasterise(surfaces, sheet)
    emission = surfaces.emission[surfaces.material[texels.face]]
    if all(part.light is not None for part in scene.parts):
        lit = LitScene.of(scene.parts)
        v, w = _weights(surfaces.triangles[texels.face].astype(np.float64), texels.position.astype(np.float64))
        light = lit.light[np.maximum(cells_at(lit.surfaces, lit.sheet, texels.face, v, w), 0)]
        exposure = np.full(len(texels), scene.rooms[0].exposure)
        for room in scene.rooms:
            inside = (
                (texels.position >= np.array(room.low) - 0.1) & (texels.position <= np.array(room.high) + 0.1)
            ).all(1)
            exposure[inside] = room.exposure
    else:
        light = (0.55 + 0.25 * texels.normal[:, 1] + 0.15 * texels.normal[:, 0])[:, None]
        exposure = np.full(len(texels), 1.2)
        emission = np.minimum(emission, 1.0)
    radiance = (texels.albedo * light + emission) * exposure[:, None]
    image = np.zeros((layout.height * layout.width, 3), dtype=np.uint8)
    image[texels.cell] = np.round(255 * srgb_encode(tone_curve(radiance))).astype(np.uint8)
    known = np.zeros(len(image), dtype=np.uint8)
    known[texels.cell] = 1
    # Texels of no chart take the colour of the nearest one, or dark seams would show.
    shape = (layout.height, layout.width)
    _, nearest = cv2.distanceTransformWithLabels(
        1 - known.reshape(shape), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    source = np.zeros(int(nearest.max()) + 1, dtype=np.int64)
    source[nearest.reshape(-1)[known.astype(bool)]] = np.flatnonzero(known)
    return image[source[nearest.reshape(-1)]].reshape(*shape, 3)


def _weights(triangles: Array, points: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = points - triangles[:, 0]
    aa, ab, bb, pa, pb = (np.einsum("ij,ij->i", x, y) for x, y in ((a, a), (a, b), (b, b), (p, a), (p, b)))
    det = np.maximum(aa * bb - ab * ab, 1e-20)
    v, w = np.clip((bb * pa - ab * pb) / det, 0, 1), np.clip((aa * pb - ab * pa) / det, 0, 1)
    return v.astype(np.float32), np.minimum(w, 1 - v).astype(np.float32)


# ---- files --------------------------------------------------------------------------------------------------------


def glb(tree: dict, blobs: list[bytes]) -> bytes:
    """A binary glTF; ``blobs`` become the buffer views 0, 1, …"""
    binary, views = b"", []
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(blob)})
        binary += blob + b"\0" * (-len(blob) % 4)
    tree = {"asset": {"version": "2.0"}, **tree, "buffers": [{"byteLength": len(binary)}], "bufferViews": views}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def mesh_glb(
    vertices: Array,
    faces: NDArray[np.int64],
    *,
    uv: Array | None = None,
    image: tuple[str, bytes] | None = None,
    colours: NDArray[np.uint8] | None = None,
    basisu: bool = False,
) -> bytes:
    """A GLB of one primitive: textured by ``image`` (media type, bytes), or with (V, 3) vertex ``colours``."""
    positions = vertices.astype("<f4")
    blobs = [positions.tobytes(), faces.astype("<u4").tobytes()]
    accessors: list[dict] = [
        {
            "bufferView": 0,
            "componentType": 5126,
            "count": len(vertices),
            "type": "VEC3",
            "min": positions.min(axis=0).tolist(),
            "max": positions.max(axis=0).tolist(),
        },
        {"bufferView": 1, "componentType": 5125, "count": int(faces.size), "type": "SCALAR"},
    ]
    attributes = {"POSITION": 0}
    primitive: dict = {"attributes": attributes, "indices": 1}
    tree: dict = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
    }
    if uv is not None and image is not None:
        flipped = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1).astype("<f4")
        accessors.append({"bufferView": 2, "componentType": 5126, "count": len(uv), "type": "VEC2"})
        attributes["TEXCOORD_0"] = 2
        blobs += [flipped.tobytes(), image[1]]
        tree["images"] = [{"bufferView": 3, "mimeType": image[0]}]
        tree["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}} if basisu else {"source": 0}]
        tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}]
        primitive["material"] = 0
        if basisu:
            tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_texture_basisu"]
    elif colours is not None:
        rgba = np.concatenate([colours, np.full((len(colours), 1), 255, np.uint8)], axis=1)
        accessors.append(
            {"bufferView": 2, "componentType": 5121, "normalized": True, "count": len(colours), "type": "VEC4"}
        )
        attributes["COLOR_0"] = 2
        blobs.append(rgba.astype(np.uint8).tobytes())
    return glb(tree, blobs)


def png(image: NDArray[np.uint8]) -> bytes:
    """RGB as PNG."""
    return cv2.imencode(".png", image[..., ::-1])[1].tobytes()


def write_glb(fused: Fused, path: Path, *, z_up: bool = False) -> Path:
    """The fused mesh as a GLB of one primitive with one texture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    vertices = fused.vertices @ Z_UP.T if z_up else fused.vertices
    jpeg = cv2.imencode(".jpg", fused.atlas[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()
    path.write_bytes(mesh_glb(vertices, fused.faces, uv=fused.uv, image=("image/jpeg", jpeg)))
    return path


#: What the parts of an apartment are called by annotators: a word of the part's name → HM3D's word, mpcat40.
WORDS: dict[str, tuple[str, str]] = {
    "fridge": ("refrigerator", "appliances"),
    "oven_unit": ("oven and stove", "appliances"),
    "kitchen_counter": ("kitchen counter", "counter"),
    "washbasin": ("sink", "sink"),
    "toilet": ("toilet", "toilet"),
    "sofa": ("couch", "sofa"),
    "armchair": ("armchair", "chair"),
    "rug": ("rug", "misc"),
    "bath_mat": ("bath mat", "misc"),
    "curtains": ("curtain", "curtain"),
    "bed": ("bed", "bed"),
    "wardrobe": ("wardrobe", "furniture"),
    "tv_stand": ("tv", "tv_monitor"),
    "plant": ("plant", "plant"),
    "door_leaf": ("door", "door"),
    "bookshelf": ("bookshelf", "shelving"),
}


@dataclass(frozen=True, eq=False)
class Label:
    """One annotated object: its words and region, and which faces of the fused mesh it has."""

    word: str
    group: str
    region: int
    faces: NDArray[np.bool_]


def labels_of(fused: Fused, rooms: list[str]) -> list[Label]:
    """Annotations of a fused apartment: parts by name, the shell of each room as floor, ceiling and walls."""
    corners = fused.vertices[fused.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = np.abs(normal[:, 1]) > 0.7 * np.linalg.norm(normal, axis=1)
    height = corners[:, :, 1].mean(axis=1)
    out = []
    for number, name in enumerate(fused.names):
        own = fused.owner == number
        room = name.removeprefix("shell_").split("/")[0]
        if not own.any() or room not in rooms:
            continue
        region = rooms.index(room)
        if name.startswith("shell_"):
            out.append(Label("floor", "floor", region, own & level & (height < 0.2)))
            out.append(Label("ceiling", "ceiling", region, own & level & (height > 2.2)))
            out.append(Label("wall", "wall", region, own & ~level))
            continue
        kind = name.split("/")[1].rstrip("_0123456789")
        word, group = WORDS.get(kind, (kind.replace("_", " "), "misc"))
        out.append(Label(word, group, region, own))
    return out


def write_hm3d(
    fused: Fused, root: Path, labels: list[Label], *, number: str = "00800", name: str = "TEEsavR23oF"
) -> Path:
    """The fused mesh and its annotations as HM3D has them, Z up, below ``root/val``."""
    folder = root / "val" / f"00800-{name}"
    write_glb(fused, folder / f"{name}.glb", z_up=True)
    lines = ["HM3D Semantic Annotations"]
    colours = np.zeros((len(fused.faces), 3), dtype=np.uint8)
    for index, label in enumerate(labels, start=1):
        code = (index * 0x3D1F7B) & 0xFFFFFF
        colours[label.faces] = [code >> 16, (code >> 8) & 255, code & 255]
        lines.append(f'{index},{code:06X},"{label.word}",{label.region}')
    (folder / f"{name}.semantic.txt").write_text("\n".join(lines) + "\n")
    # Annotated meshes are coloured by a texture: a texel block for every face.
    side = int(np.ceil(np.sqrt(len(colours))))
    image = np.zeros((side * side, 3), dtype=np.uint8)
    image[: len(colours)] = colours
    index = np.arange(len(colours))
    uv = np.stack([(index % side + 0.5) / side, 1 - (index // side + 0.5) / side], axis=1).repeat(3, axis=0)
    corners = fused.vertices[fused.faces].reshape(-1, 3) @ Z_UP.T
    faces = np.arange(len(corners)).reshape(-1, 3)
    image_png = png(image.reshape(side, side, 3))
    (folder / f"{name}.semantic.glb").write_bytes(mesh_glb(corners, faces, uv=uv, image=("image/png", image_png)))
    return folder


def write_mp3d(
    fused: Fused,
    root: Path,
    labels: list[Label],
    region_labels: list[str],
    *,
    name: str = "17DRP5sb8fy",
    ply: bool = False,
) -> Path:
    """The fused mesh and its house file as Matterport3D has them, Z up, below ``root/v1/tasks/mp3d``."""
    folder = root / "v1" / "tasks" / "mp3d" / name
    write_glb(fused, folder / f"{name}.glb", z_up=True)
    corners = fused.vertices[fused.faces] @ Z_UP.T
    kinds = sorted({(label.word, label.group) for label in labels})
    lines = ["ASCII 1.1", f"H {name} - 0 0 0 0 0 {len(labels)} {len(kinds)} {len(region_labels)} 0 1" + " 0" * 16]
    for region, letter in enumerate(region_labels):
        own = [corners[label.faces].reshape(-1, 3) for label in labels if label.region == region]
        points = np.concatenate([np.zeros((1, 3)), *own])[bool(own) :]
        low, high = np.percentile(points, [1, 99], axis=0)
        numbers = " ".join(f"{v:.4f}" for v in (*((low + high) / 2), *low, *high))
        lines.append(f"R {region} 0 0 0 {letter} {numbers} 2.6 0 0 0 0")
    for index, (word, group) in enumerate(kinds):
        lines.append(f"C {index} {index + 1} {word.replace(' ', '#')} {index + 1} {group} 0 0 0 0 0")
    for index, label in enumerate(labels):
        own = corners[label.faces].reshape(-1, 3)
        low, high = (own.min(axis=0), own.max(axis=0)) if len(own) else (np.zeros(3), np.zeros(3))
        # An oriented box may name its axes in any order.
        numbers = (*((low + high) / 2), 0, 1, 0, 0, 0, 1, *((high - low) / 2)[[1, 2, 0]])
        text = " ".join(f"{v:.4f}" for v in numbers)
        lines.append(f"O {index} {label.region} {kinds.index((label.word, label.group))} {text} 0 0 0 0 0 0 0 0")
    (folder / f"{name}.house").write_text("\n".join(lines) + "\n")
    return folder
