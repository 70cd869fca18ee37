"""The `Scene`: input of every renderer and every acoustic engine.

World frame: right-handed, metres, Y up. A mesh is stored as face corners (no index buffer), because faces seldom share
texture coordinates, normals or light-map coordinates, and because all users of a mesh read them per face.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, did_you_mean, excerpt

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]

#: Faces that are moved at a time: in double precision, without such a copy of a whole scan.
_BLOCK = 1 << 16
#: White balance that changes nothing.
NEUTRAL = (1.0, 1.0, 1.0)

SupportKind = Literal["floor", "worktop", "shelf", "side_table", "wall"]


@dataclass(frozen=True, eq=False)
class Texture:
    """An sRGB image that repeats; ``pixels`` (H, W, 3) uint8, row 0 at v = 1 (the image's top)."""

    name: str
    pixels: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Material:
    """Optical and acoustic properties of a face; the optical ones are glTF 2.0's metallic–roughness model.

    Attributes:
        name: e.g. ``oak``, ``white_tiles``.
        acoustic: label of an acoustic material (see generators/acoustics/materials.py).
        colour: base colour in linear light, [0, 1], multiplied with the texture: the albedo, or of metals what they
            reflect at normal incidence.
        texture: optional; sampled at the mesh's uv.
        emission: radiance (3,) in the scene's light unit; lamps and window panes.
        shown: if set, radiance (3,) that multiplies the texture: what is seen here in place of colour × light +
            emission, namely the view behind a window pane. ``emission``, its mean, is what lights the room.
        view_distance: distance (m) behind the face of the plane on which ``texture`` × ``shown`` is seen through the
            face. ``uv`` is that of the face; it goes on along the plane, in v up to the texture's edges. The middle
            of the texture's height is level with the eye.
        roughness: glTF's, the root of the microfacet model's α (GGX); 1 = matte.
        metallic: 1 = metal, 0 = dielectric with an index of refraction of 1.5.
        normal_map: optional; tangent space of ``uv``, green up, not sRGB (glTF 2.0, 3.9.3).
        roughness_map: optional; green × ``roughness``, blue × ``metallic``, not sRGB.
        transmission: share of the light that enters and goes through, as through a thin pane
            (KHR_materials_transmission).
        clearcoat: strength of a clear layer over the material, of roughness 0 (KHR_materials_clearcoat).
    """

    name: str
    acoustic: str
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shown: tuple[float, float, float] | None = None
    view_distance: float = 0.0
    roughness: float = 1.0
    metallic: float = 0.0
    normal_map: Texture | None = None
    roughness_map: Texture | None = None
    transmission: float = 0.0
    clearcoat: float = 0.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """A textured triangle mesh, stored as face corners.

    Attributes:
        positions: (F, 3, 3) float32, metres; counter-clockwise seen from outside.
        normals: (F, 3, 3) float32 unit shading normals.
        uv: (F, 3, 2) float32 texture coordinates in repeats (v up).
        face_material: (F,) int32 index into ``materials``.
        materials: the materials.
        acoustic_positions: (A, 3, 3) float32, the same surface with the detail that matters for sound (boxes for
            furniture, eight-sided cylinders, no detail below about 10 cm).
        acoustic_labels: one acoustic material label per acoustic face.
    """

    positions: F32
    normals: F32
    uv: F32
    face_material: I32
    materials: tuple[Material, ...]
    acoustic_positions: F32
    acoustic_labels: tuple[str, ...]

    @cached_property
    def bounds(self) -> F32:
        """(2, 3) lowest and highest corner; read-only, since every caller gets the same array."""
        flat = self.positions.reshape(-1, 3)
        corners = np.stack([flat.min(axis=0), flat.max(axis=0)])
        corners.flags.writeable = False
        return corners

    def transformed(self, rotation: NDArray[np.float64], translation: NDArray[np.float64], scale: float = 1.0) -> Mesh:
        """The mesh after p → rotation · (scale · p) + translation."""
        r = np.asarray(rotation, dtype=np.float64)

        def turned(vectors: F32, factor: float = 1.0, by: NDArray[np.float64] | None = None) -> F32:
            out = np.empty(vectors.shape, dtype=np.float32)
            for first in range(0, len(vectors), _BLOCK):
                block = (vectors[first : first + _BLOCK].astype(np.float64) * factor) @ r.T
                out[first : first + _BLOCK] = block if by is None else block + by
            return out

        positions = turned(self.positions, scale, translation)
        same = self.acoustic_positions is self.positions
        return replace(
            self,
            positions=positions,
            acoustic_positions=positions if same else turned(self.acoustic_positions, scale, translation),
            normals=turned(self.normals),
        )

    def check(self, name: str) -> None:
        """Check the arrays: invalid values make the engines hang, crash or return wrong results.

        Raises:
            Avs3dError: if a coordinate is not finite, the mesh is empty, or the arrays' shapes do not match.
        """
        count = len(self.positions)
        if count == 0:
            raise Avs3dError(f"{name}: the mesh has no faces; expected at least one triangle")
        shapes = {
            "positions": (self.positions.shape, (count, 3, 3)),
            "normals": (self.normals.shape, (count, 3, 3)),
            "uv": (self.uv.shape, (count, 3, 2)),
            "face_material": (self.face_material.shape, (count,)),
            "acoustic_labels": ((len(self.acoustic_labels),), (len(self.acoustic_positions),)),
        }
        for field_name, (found, expected) in shapes.items():
            if found != expected:
                raise Avs3dError(f"{name}: {field_name} has shape {found}, expected {expected}")
        for field_name in ("positions", "normals", "uv", "acoustic_positions"):
            bad = int((~np.isfinite(getattr(self, field_name))).sum())
            if bad:
                raise Avs3dError(f"{name}: {field_name} has {bad} values that are NaN or infinite; repair the mesh")
        wrong = (self.face_material < 0) | (self.face_material >= len(self.materials))
        if wrong.any():
            index = int(self.face_material[wrong][0])
            raise Avs3dError(f"{name}: a face has material index {index}; expected 0 to {len(self.materials) - 1}")


@dataclass(frozen=True, eq=False)
class LightMap:
    """Light baked per texel.

    Attributes:
        uv: (F, 3, 2) float32 in [0, 1], (0, 0) = the outer corner of texel [0, 0] (row 0 at v = 0).
        texels: (H, W, 3) float16, reflected radiance of a white diffuse surface (irradiance / π) in scene light units.
    """

    uv: F32
    texels: NDArray[np.float16]


@dataclass(frozen=True, eq=False)
class DenseMesh:
    """The faces of a scan that pictures show where there are too many of them for all else.

    Attributes:
        mesh: without acoustic faces.
        light_uv: (F, 3, 2) as `LightMap.uv`, in the light map of the part, if it has one.
    """

    mesh: Mesh
    light_uv: F32 | None = None


@dataclass(frozen=True)
class Licence:
    """Licence, author and source of a part."""

    name: str = "Apache-2.0"
    author: str = "avs3d-bench"
    source: str = "procedural"


@dataclass(frozen=True, eq=False)
class Part:
    """One mesh of a scene: the shell of a flat, a piece of furniture, or a placed instance.

    ``instance_id`` is 0 for parts of the home, 1… for placed instances. ``light`` is None if the texture already
    contains the light (a scan, or a material that only emits): the colour is then texture × material colour. In a scan
    ``light`` is the factor by which objects change what is displayed (`Scene.is_scan`). ``dense``: what pictures show
    if ``mesh`` is a decimated copy of it.
    """

    name: str
    mesh: Mesh
    instance_id: int = 0
    category: str | None = None
    light: LightMap | None = None
    licence: Licence = field(default_factory=Licence)
    dense: DenseMesh | None = None

    @property
    def shown(self) -> Part:
        """The part as pictures show it."""
        dense = self.dense
        if dense is None:
            return self
        light = None
        if self.light is not None and dense.light_uv is not None:
            light = replace(self.light, uv=dense.light_uv)
        return replace(self, mesh=dense.mesh, light=light, dense=None)


@dataclass(frozen=True)
class Room:
    """A room: its type, its inner box (metres), and the exposure and white balance (`Scene.white`) for its light.

    ``is_whole_mesh``: the box is that of a whole mesh, which may hold any number of rooms.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    exposure: float = 1.0
    white: tuple[float, float, float] = NEUTRAL
    is_whole_mesh: bool = False


@dataclass(frozen=True)
class Support:
    """A rectangle on which an object can stand (or hang): ``origin`` + a·``u`` + b·``v``, a, b in [0, 1].

    ``normal`` is up for horizontal supports and points into the room for walls; ``front`` is the horizontal direction
    in which an object on it faces. ``clearance`` is the free height above (or depth in front of) the surface, metres.
    """

    kind: SupportKind
    room: str
    origin: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]
    normal: tuple[float, float, float]
    front: tuple[float, float, float]
    clearance: float = 1.0


@dataclass(frozen=True)
class StageFile:
    """The file of a scan: a renderer that reads scans itself loads it instead of the scan's parts.

    ``up`` and ``front`` are the file's axes that become +Y and +Z of the world (``z``, ``-y``, …); ``turn`` (degrees)
    then turns it about +Y, and ``scale`` is the number of metres in a unit of the file.
    """

    path: Path
    up: str = "y"
    front: str = "+z"
    turn: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class SplatFile:
    """The file of a scan's splats; ``to_world`` (4, 4) is a similarity from the file's frame to the world's, metres."""

    path: Path
    to_world: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScanSun:
    """The sun that shines into a scanned room.

    Attributes:
        direction: (3,) float64 unit vector towards it.
        radiance: (3,) float32, reflected radiance of a white surface that faces it.
    """

    direction: NDArray[np.float64]
    radiance: F32


@dataclass(frozen=True, eq=False)
class ScanLight:
    """The light of a scan that its pictures do not show (generators/lighting/scan_light.py estimates it).

    Attributes:
        position: (N, 3) float32 points that are spread over what shines: the brightest texels (lamps, windows), and
            holes in walls (windows, whose glass scanners do not see).
        normal: (N, 3) float32.
        area: (N,) float32 that each stands for, square metres.
        radiance: (N, 3) float32 with what the pictures do not show of it.
        limit: radiance of its brightest channel from which a texel belongs to what shines.
        beyond: (3,) float32 radiance from where rays leave the scan.
        ceiling: height (world Y, metres) from which on faces that look down belong to the ceiling.
        glow: (3,) float32 radiance that the ceiling has beyond what is shown of it.
        sun: the sun, if its patches were found.
        black: (3,) float32 radiance that the pictures show where no light comes from: flare, fog, a lifted tone curve.
            What this record says of the scan's radiance is without it.
    """

    position: F32
    normal: F32
    area: F32
    radiance: F32
    limit: float
    beyond: F32
    ceiling: float
    glow: F32
    sun: ScanSun | None = None
    black: F32 = field(default_factory=lambda: np.zeros(3, dtype=np.float32))


@dataclass(frozen=True, eq=False)
class Scene:
    """A home with its rooms and objects: all that a renderer and an acoustic engine need.

    ``exposure`` multiplies linear light before the tone curve, ``white`` its channels (R, G, B): the white balance
    (`Scene.for_room` sets the room's own; the pictures of a scan have theirs already). ``stage`` is the
    file of the parts with instance id 0, if they are one scan, and ``splats`` that of the same place in 3D Gaussians;
    ``scan_light`` is there once objects are placed in the scan.
    """

    name: str
    parts: tuple[Part, ...]
    rooms: tuple[Room, ...]
    supports: tuple[Support, ...]
    exposure: float = 1.0
    stage: StageFile | None = None
    splats: SplatFile | None = None
    scan_light: ScanLight | None = None
    white: tuple[float, float, float] = NEUTRAL

    @property
    def gains(self) -> NDArray[np.float64]:
        """(3,) factors of red, green and blue light before the tone curve: exposure × white balance."""
        return self.exposure * np.array(self.white)

    def room(self, name: str) -> Room:
        """The first room called ``name``.

        Raises:
            Avs3dError: if there is none.
        """
        for room in self.rooms:
            if room.name == name:
                return room
        known = [room.name for room in self.rooms]
        hint = did_you_mean(name, known)
        raise Avs3dError(f"{self.name}: no room {excerpt(name)}; it has {', '.join(known) or 'none'}{hint}")

    @property
    def black(self) -> F32:
        """(3,) float32 radiance that lies over everything, as in the pictures of the scan (`ScanLight.black`)."""
        return np.zeros(3, dtype=np.float32) if self.scan_light is None else self.scan_light.black

    def is_scan(self, part: Part) -> bool:
        """Whether the textures of ``part`` are pictures of a scan: their light is in them, developed for display."""
        return self.stage is not None and part.instance_id == 0

    @property
    def shown(self) -> Scene:
        """The scene as pictures show it: with all faces of dense scans."""
        return replace(self, parts=tuple(part.shown for part in self.parts))

    def for_room(self, name: str) -> Scene:
        """The same scene with the exposure and white balance of one room."""
        room = self.room(name)
        return replace(self, exposure=room.exposure, white=room.white)

    def with_parts(self, parts: tuple[Part, ...]) -> Scene:
        """The scene with further parts (placed instances)."""
        return replace(self, parts=self.parts + parts)
