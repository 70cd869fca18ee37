"""PLY files of 3D Gaussians ("splats") in the layout of 3D-GS, which every tool that makes splats can write.

One element, vertex: x y z nx ny nz, f_dc_0…2, f_rest_* (0, 9, 24 or 45 of them, channel-major: all of red, then green,
then blue), opacity, scale_0…2, rot_0…3. The values are the parameters before activation (Kerbl, Kopanas, Leimkühler,
Drettakis, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", SIGGRAPH 2023): opacities are logits, scales
natural logarithms, rotations quaternions (w, x, y, z) of any norm, colour real spherical harmonics about 0.5. Writers
differ in what they add (class numbers, confidence) and leave out (normals, f_rest_*); what is not listed is ignored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import open_regular
from avs3d_bench.formats.ply import write_tables
from avs3d_bench.formats.ply_reader import HEADER_BYTES, read_header, read_tables

F32 = NDArray[np.float32]

#: Numbers of properties f_rest_* that a file can have: those of spherical harmonics of degree 0 to 3.
REST = (0, 9, 24, 45)
_NORMALS = ("nx", "ny", "nz")
_PLAIN = "expected the splats as an uncompressed PLY of 3D-GS"
#: Suffixes of other formats of splats.
_OTHER_FORMATS = (".splat", ".spz", ".ksplat", ".sog", ".lcc", ".spx")
_CONVERT = "convert it: `npx @playcanvas/splat-transform {name} {stem}.ply`, or open it in SuperSplat and export a PLY"


@dataclass(frozen=True, eq=False)
class GaussianTable:
    """N Gaussians as a file has them; all arrays are float32.

    Attributes:
        means: (N, 3) centres, in the file's frame and unit.
        log_scales: (N, 3) natural logarithm of the standard deviations along the own axes.
        rotations: (N, 4) quaternions (w, x, y, z), own axes to the file's frame, of any norm.
        opacities: (N,) logits.
        sh: (N, K, 3) spherical harmonics, K = (degree + 1)², RGB.
    """

    means: F32
    log_scales: F32
    rotations: F32
    opacities: F32
    sh: F32

    def __len__(self) -> int:
        return len(self.means)


def property_names(bands: int) -> list[str]:
    """The properties of a file with ``bands`` spherical harmonics (1, 4, 9 or 16), in the order of the reference."""
    rest = [f"f_rest_{i}" for i in range(3 * (bands - 1))]
    return [
        *("x", "y", "z", *_NORMALS, "f_dc_0", "f_dc_1", "f_dc_2"), *rest, "opacity",
        *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
    ]  # fmt: skip


def table_of(columns: Mapping[str, NDArray[Any]], path: str | Path) -> GaussianTable:
    """The Gaussians in the columns of a file.

    Args:
        columns: property → (N,) numbers.
        path: of the file, for messages.

    Raises:
        Avs3dError: if a property is missing, or there is another number of f_rest_*.
    """
    rest = sum(name.startswith("f_rest_") for name in columns)
    names = property_names(rest // 3 + 1)
    missing = [name for name in names if name not in columns and name not in _NORMALS]
    if missing or rest not in REST:
        what = f"no property {missing[0]}" if missing else f"{rest} properties f_rest_*"
        raise Avs3dError(f"{path}: {what}; expected the layout of 3D-GS")

    def take(*wanted: str) -> F32:
        return np.stack([columns[name] for name in wanted], axis=1).astype(np.float32)

    count = len(columns["x"])
    sh = take("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    if rest:
        tail = take(*(f"f_rest_{i}" for i in range(rest)))
        sh = np.concatenate([sh, tail.reshape(count, 3, rest // 3).transpose(0, 2, 1)], axis=1)
    return GaussianTable(
        means=take("x", "y", "z"),
        log_scales=take("scale_0", "scale_1", "scale_2"),
        rotations=take("rot_0", "rot_1", "rot_2", "rot_3"),
        opacities=take("opacity")[:, 0],
        sh=np.ascontiguousarray(sh),
    )


def write_gaussians(
    path: str | Path, gaussians: GaussianTable, further: Mapping[str, NDArray[Any]] | None = None, cause: str = ""
) -> None:
    """Write a binary little-endian PLY in the reference layout, atomically.

    Args:
        path: the file.
        gaussians: what to write.
        further: name → (N,) more properties, at the end.
        cause: follows the message about numbers that are not finite.

    Raises:
        Avs3dError: if a number is not finite, or the system refuses.
    """
    count, bands = gaussians.sh.shape[:2]
    further = further or {}
    table = np.concatenate(
        [
            gaussians.means, np.zeros((count, 3)), gaussians.sh[:, 0],
            gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(count, 3 * (bands - 1)), gaussians.opacities[:, None],
            gaussians.log_scales, gaussians.rotations, *(values[:, None] for values in further.values()),
        ],
        axis=1,
    )  # fmt: skip
    names = [*property_names(bands), *further]
    if not np.isfinite(table).all():
        bad = names[int(np.argwhere(~np.isfinite(table))[0, 1])]
        raise Avs3dError(f"{path}: {bad} holds NaN or infinite numbers{cause}")
    rows = np.ascontiguousarray(table, dtype="<f4").view([(name, "<f4") for name in names])
    write_tables(path, {"vertex": rows.reshape(count)})


def read_gaussians(path: str | Path, most: int | None = None) -> GaussianTable:
    """Read the splats that any tool wrote, binary or ASCII; numbers are not checked.

    Args:
        path: the file.
        most: Gaussians that it may announce; None: any number. It is looked at before the body is read.

    Raises:
        Avs3dError: if the file is missing, truncated, of another format, a mesh, or lacks a property.
    """
    path = Path(path)
    check_gaussians(path, most)
    table = read_tables(path)[1]["vertex"]
    return table_of({name: table[name] for name in table.dtype.names or ()}, path)


def check_gaussians(path: Path, most: int | None = None) -> None:
    """See by its header whether a file holds splats that `read_gaussians` can read.

    Raises:
        Avs3dError: as `read_gaussians`.
    """
    _refuse_other_formats(path)
    header = read_header(path)
    names = {prop.name for element in header.elements if element.name == "vertex" for prop in element.properties}
    if "opacity" not in names and "f_dc_0" not in names:
        faces = sum(element.size for element in header.elements if element.name == "face")
        found = f"a mesh of {faces:,} faces" if faces else "a point cloud"
        raise Avs3dError(f"{path}: {found}, not splats (no property opacity); {_PLAIN}; a mesh belongs to `file`")
    if most is not None and header.vertices > most:
        raise Avs3dError(
            f"{path}: {header.vertices:,} Gaussians, expected at most {most:,}; crop the scene to the rooms that are "
            "used, or prune faint Gaussians (SuperSplat does both)"
        )
    if not header.vertices:
        raise Avs3dError(f"{path}: holds no Gaussians; {_PLAIN}")
    table_of(dict.fromkeys(names, np.empty(0)), path)


def _refuse_other_formats(path: Path) -> None:
    """Say how to convert what is no plain PLY.

    Raises:
        Avs3dError: if it is a compressed format.
    """
    name, stem = path.name, path.name.partition(".")[0]
    if path.suffix.lower() in _OTHER_FORMATS:
        raise Avs3dError(f"{path}: a {path.suffix.lower()} file; {_PLAIN}; {_CONVERT.format(name=name, stem=stem)}")
    with open_regular(path) as stream:
        head = stream.read(HEADER_BYTES)
    if head.startswith(b"ply") and b"packed_position" in head:
        raise Avs3dError(f"{path}: a compressed PLY; {_PLAIN}; {_CONVERT.format(name=name, stem=f'{stem}_plain')}")
