"""Sweet Home 3D libraries: catalogue, authors and licences, orientation, and the extracted files of a model."""

from __future__ import annotations

import io
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import sha256_bytes
from generators.assets.modelframe import upright
from generators.library.lock import AssetEntry, read_lock
from generators.library.sh3f import (
    CATALOGUE,
    DEBIAN_FOLDER,
    Library,
    Piece,
    deliver,
    libraries,
    parse_properties,
    read_library,
)

OBJ = "mtllib box.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
MTL = (
    "newmtl red\nKd 1 0 0\nmap_Kd -s 1 1 1 Wood.JPG\n"
    "newmtl other\nmap_Kd pictures\\dial.png\nmap_d ..\\..\\secret.png\n"
)
PROPERTIES = """# a comment
id=Demo
name=Demo models
license=Creative Commons Attribution 3.0 Unported license  \\u00a9 Somebody
id#1=Demo#box
name#1=Caf\xe9 \\u65f6\\u949f
category#1=Kitchen
creator#1=Ann
model#1=/demo/box/box.obj
width#1=60
depth#1=51.5
height#1=108.9
elevation#1=20
id#2=Demo#vase
name#2=Vase
creator#2=Bob
model#2=/demo/vase/vase.3ds
width#2=10
depth#2=10
height#2=30
"""
MEMBERS = {
    "demo/box.png": b"icon",
    "demo/box/box.obj": OBJ.encode(),
    "demo/box/box.mtl": MTL.encode(),
    "demo/box/wood.jpg": b"wood",
    "demo/box/pictures/dial.png": b"dial",
    "demo/box/unused.png": b"unused",
    "demo/box/BLENDSWAP_LICENSE.txt": b"from http://www.blendswap.com/blends/view/51645 .",
    "demo/vase/vase.3ds": b"M",
    "secret.png": b"secret",
}


def library(
    path: Path, members: dict[str, bytes] = MEMBERS, properties: str | None = PROPERTIES, **packing: int
) -> Path:
    with zipfile.ZipFile(path, "w", packing.get("compression", zipfile.ZIP_DEFLATED)) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
        if properties is not None:
            archive.writestr(CATALOGUE, properties.encode("latin-1"))
    return path


# ---- the catalogue -------------------------------------------------------------------------------------------------


def test_properties_are_read_as_java_reads_them() -> None:
    text = (
        "# no\n! no\na=1\n b : two words \nc\\=d=e\\\n   f\ng\nh=\\u00e9\\t\\\\\ni=\\ud83d\\ude00\nj=\xe9\r\nk#1=#v\n"
    )
    assert parse_properties(text.encode("latin-1")) == {
        "a": "1", "b": "two words ", "c=d": "ef", "g": "", "h": "é\t\\", "i": "😀", "j": "é", "k#1": "#v",
    }  # fmt: skip


@given(st.binary(max_size=300))
def test_any_bytes_can_be_properties(data: bytes) -> None:
    for key, value in parse_properties(data).items():
        (key + value).encode("utf-8")


def test_a_catalogue_gives_sizes_in_metres_author_and_licence(tmp_path: Path) -> None:
    box, vase = read_library(library(tmp_path / "demo.sh3f")).pieces
    assert (box.id, box.name, box.author, box.licence) == ("Demo#box", "Café 时钟", "Ann", "CC-BY-3.0")
    assert box.size == pytest.approx((0.6, 1.089, 0.515))
    assert (box.elevation, box.axes) == (0.2, ("y", "+z", 0.0))
    assert (box.url, vase.url) == ("http://www.blendswap.com/blends/view/51645", "")


def test_the_licence_text_has_the_last_word_on_licence_and_authors(tmp_path: Path) -> None:
    zero = {**MEMBERS, "LICENSE.TXT": b"under http://creativecommons.org/choose/zero/ for any use"}
    assert {p.licence for p in read_library(library(tmp_path / "a.sh3f", zero)).pieces} == {"CC0-1.0"}
    us = {**MEMBERS, "LICENSE.TXT": b"(C) Copyright Kay & Lee\n\nat http://creativecommons.org/licenses/by/3.0/us/\n"}
    assert [(p.licence, p.author) for p in read_library(library(tmp_path / "b.sh3f", us)).pieces] == [
        ("CC-BY-3.0-US", "Kay & Lee")
    ] * 2
    listed = (
        b"http://creativecommons.org/licenses/by/3.0/\n"
        b"(C) Copyrights 2014-2020 Eve <eve@x.org> and Firm, s.l. (http://f.es) \n\n"
        b"for the icons and the 2 following models:\n- vase\n- lamp\n\n"
        b"(C) Copyrights 2006-2020 Firm, s.l. \n\nfor all the other models\n"
    )
    pieces = read_library(library(tmp_path / "c.sh3f", {**MEMBERS, "LICENSE.TXT": listed})).pieces
    assert [p.author for p in pieces] == ["Firm, s.l.", "Eve and Firm, s.l."]


@given(st.sampled_from("xyz"), st.sampled_from("xyz"), st.booleans(), st.booleans(), st.floats(-44, 44))
def test_a_rotation_becomes_axes_and_yaw(up: str, front: str, down: bool, back: bool, yaw: float) -> None:
    if up == front:
        return
    base = upright(f"{'-' if down else '+'}{up}", f"{'-' if back else '+'}{front}")
    s, c = np.sin(np.radians(yaw)), np.cos(np.radians(yaw))
    matrix = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ base
    piece = Piece(1, "a#b", "b", "", "", "", "", "b.obj", (1, 1, 1), rotation=tuple(matrix.ravel()))
    found_up, found_front, rest = piece.axes
    s, c = np.sin(np.radians(rest)), np.cos(np.radians(rest))
    again = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ upright(found_up, found_front)
    np.testing.assert_allclose(again, matrix, atol=2e-5)


def test_a_tilted_model_is_refused() -> None:
    s, c = np.sin(0.2), np.cos(0.2)
    piece = Piece(1, "a#b", "b", "", "", "", "", "b.obj", (1, 1, 1), rotation=(1, 0, 0, 0, c, -s, 0, s, c))
    with pytest.raises(Avs3dError, match=r"a#b: modelRotation tilts it by 11\.5°"):
        _ = piece.axes


# ---- what is delivered ---------------------------------------------------------------------------------------------


def test_a_model_comes_with_all_it_refers_to_and_nothing_else(tmp_path: Path) -> None:
    path = library(tmp_path / "demo.sh3f")
    with zipfile.ZipFile(io.BytesIO(deliver(path, read_library(path).find("box")))) as archive:
        assert archive.namelist() == [
            "BLENDSWAP_LICENSE.txt", "Wood.JPG", "box.mtl", "box.obj", "pictures/dial.png",
        ]  # fmt: skip
        assert archive.read("Wood.JPG") == b"wood"


def test_delivered_bytes_do_not_depend_on_how_the_library_is_packed(tmp_path: Path) -> None:
    one = library(tmp_path / "one.sh3f")
    two = library(tmp_path / "two.sh3f", dict(reversed(MEMBERS.items())), compression=zipfile.ZIP_STORED)
    first, second = (deliver(path, read_library(path).find("Demo#box")) for path in (one, two))
    assert first == second
    changed = library(tmp_path / "three.sh3f", {**MEMBERS, "demo/box/wood.jpg": b"oak"})
    assert deliver(changed, read_library(changed).find("box")) != first


def test_a_model_may_be_a_zip_of_its_own(tmp_path: Path) -> None:
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("in/box.obj", OBJ)
        archive.writestr("in/box.mtl", "newmtl red\n")
    members = {"demo/box.zip": inner.getvalue()}
    path = library(tmp_path / "a.sh3f", members, PROPERTIES.replace("/demo/box/box.obj", "demo/box.zip"))
    with zipfile.ZipFile(io.BytesIO(deliver(path, read_library(path).find("box")))) as archive:
        assert archive.namelist() == ["box.mtl", "box.obj"]


# ---- refusals: one line each ---------------------------------------------------------------------------------------


def refused(action: object, *parts: str) -> None:
    with pytest.raises(Avs3dError) as caught:
        action()  # type: ignore[operator]
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("width#1=60", "width#1=wide", "width#1 is 'wide'"),
        ("height#1=108.9", "height#1=NaN", "height#1 is 'NaN'"),
        ("width#1=60\n", "", "model 1 of its catalogue has no width"),
        ("model#1=/demo/box/box.obj\n", "", "model 1 of its catalogue has no model"),
        ("elevation#1=20", "modelRotation#1=1 0 0", "modelRotation#1"),
        ("elevation#1=20", "modelRotation#1=2 0 0 0 1 0 0 0 1", "a rotation"),
    ],
)
def test_a_broken_catalogue_is_named(tmp_path: Path, old: str, new: str, part: str) -> None:
    path = library(tmp_path / "demo.sh3f", properties=PROPERTIES.replace(old, new))
    refused(lambda: read_library(path), "demo.sh3f", part)


def test_what_is_no_library_is_refused(tmp_path: Path) -> None:
    refused(lambda: read_library(tmp_path / "none.sh3f"), "none.sh3f")
    (tmp_path / "text.sh3f").write_text("hello")
    refused(lambda: read_library(tmp_path / "text.sh3f"), "text.sh3f", "ZIP")
    refused(lambda: read_library(library(tmp_path / "bare.sh3f", properties=None)), CATALOGUE)
    whole = library(tmp_path / "whole.sh3f").read_bytes()
    (tmp_path / "cut.sh3f").write_bytes(whole[: len(whole) // 2])
    refused(lambda: read_library(tmp_path / "cut.sh3f"), "cut.sh3f")


def test_models_that_cannot_be_taken_are_refused(tmp_path: Path) -> None:
    path = library(tmp_path / "demo.sh3f")
    table = read_library(path)
    refused(lambda: deliver(path, table.find("vase")), "Demo#vase", ".3ds", ".obj")
    refused(lambda: table.find("bax"), "no model 'bax'", "did you mean 'box'")
    less = library(tmp_path / "less.sh3f", {"demo/other": b"x"})
    refused(lambda: deliver(less, read_library(less).find("box")), "demo/box/box.obj", "which is missing")


@pytest.mark.parametrize(
    ("member", "data", "part"),
    [
        ("../escape.obj", b"x", "points outside"),
        ("/etc/passwd", b"x", "points outside"),
        ("demo/box/wood.png", bytes(40_000_000), "unpacks to"),
    ],
)
def test_hostile_archives_are_refused(tmp_path: Path, member: str, data: bytes, part: str) -> None:
    path = library(tmp_path / "bad.sh3f", {**MEMBERS, member: data})
    refused(lambda: read_library(path), "bad.sh3f", part)


# ---- the real ones -------------------------------------------------------------------------------------------------

INSTALLED = pytest.mark.skipif(
    not libraries(), reason=f"no *.sh3f in {DEBIAN_FOLDER}: apt install sweethome3d-furniture"
)
LOCK = Path(__file__).parents[2] / "scenes_manifest" / "assets.lock.yaml"


@cache
def debian() -> tuple[Library, ...]:
    return tuple(read_library(path) for path in libraries())


@INSTALLED
def test_the_libraries_of_debian_are_read_whole() -> None:
    found = debian()
    assert sum(len(one.pieces) for one in found) > 700
    for one in found:
        assert {piece.licence for piece in one.pieces} <= {"CC0-1.0", "CC-BY-3.0", "CC-BY-3.0-US"}
        for piece in one.pieces:
            assert all(0 < length < 50 for length in piece.size), piece.id
            assert piece.author != "unknown" or one.licence == "CC0-1.0", piece.id


@INSTALLED
@pytest.mark.parametrize("entry", [e for e in read_lock(LOCK).assets if e.source == "sh3d"], ids=lambda e: e.id)
def test_pinned_models_are_those_of_debian(entry: AssetEntry) -> None:
    library = next((one for one in debian() if one.path.stem.lower() == entry.id.split("/")[1]), None)
    assert library is not None
    piece = library.find(entry.ref)
    assert sha256_bytes(deliver(library.path, piece)) == entry.sha256
    assert (piece.author, piece.licence) == (entry.author, entry.licence)
