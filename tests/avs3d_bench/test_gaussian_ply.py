"""PLY files of splats: those of other tools are read, and what is none is refused in one line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.gaussian_ply import GaussianTable, property_names, read_gaussians, write_gaussians
from avs3d_bench.formats.media import write_ply_mesh, write_ply_points

NAMES = ("means", "log_scales", "rotations", "opacities", "sh")


def some(count: int = 5, bands: int = 16) -> GaussianTable:
    rng = np.random.default_rng(3)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, bands, 3))
    return GaussianTable(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))


def same(one: GaussianTable, other: GaussianTable) -> None:
    for name in NAMES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def columns(table: GaussianTable) -> dict[str, np.ndarray]:
    """Property → numbers, by the definition of the layout."""
    found = {name: table.means[:, i] for i, name in enumerate("xyz")}
    found |= {f"f_dc_{i}": table.sh[:, 0, i] for i in range(3)}
    rest = table.sh.shape[1] - 1
    found |= {f"f_rest_{c * rest + k}": table.sh[:, 1 + k, c] for c in range(3) for k in range(rest)}
    found |= {"opacity": table.opacities} | {f"scale_{i}": table.log_scales[:, i] for i in range(3)}
    return found | {f"rot_{i}": table.rotations[:, i] for i in range(4)}


def write(path: Path, table: dict[str, np.ndarray], form: str = "binary_little_endian", kind: str = "float") -> Path:
    """As another tool would: these columns in this order, then an element of another name."""
    size = len(table["x"])
    header = [f"ply\nformat {form} 1.0\ncomment by another tool\nelement vertex {size}"]
    header += [f"property {'uchar' if name == 'class' else kind} {name}" for name in table]
    header += ["element camera 1\nproperty float focal\nend_header\n"]
    order = ">" if form == "binary_big_endian" else "<"
    number = {"float": "f4", "double": "f8"}[kind]
    types = [(name, "u1" if name == "class" else order + number) for name in table]
    rows = np.empty(size, dtype=types)
    for name, values in table.items():
        rows[name] = values
    if form == "ascii":
        lines = [
            " ".join(f"{float(value):.9g}" if value.dtype.kind == "f" else str(value) for value in row) for row in rows
        ]
        body = ("\n".join(lines) + "\n500\n").encode()
    else:
        body = rows.tobytes() + np.array([500], dtype=order + "f4").tobytes()
    path.write_bytes("\n".join(header).encode() + body)
    return path


@pytest.mark.parametrize("bands", [1, 4, 9, 16])
def test_what_is_written_is_read(tmp_path: Path, bands: int) -> None:
    table = some(bands=bands)
    write_gaussians(tmp_path / "a.ply", table)
    same(read_gaussians(tmp_path / "a.ply"), table)


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian", "ascii"])
@pytest.mark.parametrize("bands", [1, 4, 16])
def test_files_without_normals_with_more_columns_and_elements_are_read(tmp_path: Path, form: str, bands: int) -> None:
    table = some(bands=bands)
    found = columns(table)
    found = {"class": np.arange(5, dtype=np.uint8)} | dict(reversed(found.items())) | {"confidence": table.opacities}
    same(read_gaussians(write(tmp_path / "a.ply", found, form)), table)


def test_double_precision_is_read(tmp_path: Path) -> None:
    same(read_gaussians(write(tmp_path / "a.ply", columns(some()), kind="double")), some())


def test_the_properties_of_the_reference_in_its_order() -> None:
    names = property_names(16)
    assert len(names) == 62
    assert names[:10] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0"]
    assert names[53:] == ["f_rest_44", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


@pytest.mark.parametrize("name", ["room.splat", "room.spz", "room.ksplat", "room.sog"])
def test_other_formats_are_refused_with_the_command_that_converts_them(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\x1f\x8b")
    with pytest.raises(Avs3dError, match=rf"splat-transform {name} room\.ply"):
        read_gaussians(tmp_path / name)


def test_a_compressed_ply_is_refused_with_the_command_that_converts_it(tmp_path: Path) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\n"
    (tmp_path / "a.ply").write_bytes((head + "property uint packed_position\nend_header\n").encode() + bytes(8))
    with pytest.raises(Avs3dError, match=r"a compressed PLY; .*splat-transform a\.ply a_plain\.ply"):
        read_gaussians(tmp_path / "a.ply")


def test_meshes_and_clouds_are_told_from_splats(tmp_path: Path) -> None:
    write_ply_mesh(tmp_path / "mesh.ply", np.eye(3), [[0, 1, 2]])
    with pytest.raises(Avs3dError, match=r"a mesh of 1 faces, not splats .* a mesh belongs to `file`"):
        read_gaussians(tmp_path / "mesh.ply")
    write_ply_points(tmp_path / "points.ply", np.eye(3))
    with pytest.raises(Avs3dError, match="a point cloud, not splats"):
        read_gaussians(tmp_path / "points.ply")


@pytest.mark.parametrize(
    ("without", "message"),
    [("opacity", "no property opacity"), ("rot_3", "no property rot_3"), ("f_rest_7", r"8 properties f_rest_\*"),
     ("scale_2", "no property scale_2")],
)  # fmt: skip
def test_a_missing_property_is_named(tmp_path: Path, without: str, message: str) -> None:
    found = columns(some(bands=4))
    del found[without]
    with pytest.raises(Avs3dError, match=message):
        read_gaussians(write(tmp_path / "a.ply", found))


def test_no_gaussians_are_refused(tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.ply", some(0))
    with pytest.raises(Avs3dError, match="holds no Gaussians"):
        read_gaussians(tmp_path / "a.ply")


def test_too_many_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "big.ply"
    write_gaussians(path, some(1, 1))
    data = path.read_bytes()
    head = data[: data.index(b"end_header\n") + 11].replace(b"element vertex 1\n", b"element vertex 10000000\n")
    path.write_bytes(head)
    os.truncate(path, len(head) + 10_000_000 * 17 * 4)  # a hole: it takes no space on the disk
    with pytest.raises(Avs3dError, match=r"10,000,000 Gaussians, expected at most 8,000,000; crop the scene"):
        read_gaussians(path, 8_000_000)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.ply", some())
    (tmp_path / "a.ply").write_bytes((tmp_path / "a.ply").read_bytes()[:-3])
    with pytest.raises(Avs3dError, match="truncated"):
        read_gaussians(tmp_path / "a.ply")


def test_numbers_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    table = some()
    table.log_scales[2, 1] = np.inf
    with pytest.raises(Avs3dError, match="scale_1 holds NaN or infinite numbers; why"):
        write_gaussians(tmp_path / "a.ply", table, cause="; why")
    assert not (tmp_path / "a.ply").exists()
