"""Downloaded archives: malicious ones are refused before unpacking; our own bundles have reproducible bytes."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from generators.library.archive import ZipLimits, bundle, read_zip, unpack
from tests.support.library_server import bomb


def write(path: Path, members: Mapping[str, bytes], **attributes: int) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            entry = zipfile.ZipInfo(name)
            entry.external_attr = attributes.get("mode", 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)
    return path


def refused(path: Path, folder: Path, **limits: int) -> str:
    with pytest.raises(Avs3dError) as caught:
        unpack(path, folder / "out", "asset/one", ZipLimits(**limits))  # type: ignore[arg-type]
    assert not (folder / "out").exists()
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("asset/one: ")
    return text


@pytest.mark.parametrize(
    "name",
    [
        "../evil.obj",
        "a/../../evil.obj",
        "/etc/evil",
        "\\\\server\\evil",
        "..\\evil.obj",
        "C:\\evil.obj",
        "C:evil",
        "a\nb",
        "",
    ],
)
def test_members_that_point_outside_are_refused(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "x.zip", {"scene.gltf": b"{}", name: b"evil"})
    assert "refused, the archive has a member" in refused(path, tmp_path)
    assert not (tmp_path / "evil.obj").exists()


@pytest.mark.parametrize("mode", [0o120777, 0o010644, 0o060644], ids=["link", "pipe", "device"])
def test_links_and_devices_are_refused(tmp_path: Path, mode: int) -> None:
    assert "is a link or a device" in refused(write(tmp_path / "x.zip", {"a": b"/etc/passwd"}, mode=mode), tmp_path)


def test_a_bomb_is_refused_by_what_it_says(tmp_path: Path) -> None:
    (tmp_path / "x.zip").write_bytes(bomb())
    assert "unpacks to" in refused(tmp_path / "x.zip", tmp_path)


def test_a_bomb_of_many_small_members_is_refused_too(tmp_path: Path) -> None:
    path = write(tmp_path / "x.zip", {f"{index}.bin": bytes(900_000) for index in range(20)})
    assert "times its size" in refused(path, tmp_path)


def test_counts_and_totals_have_limits(tmp_path: Path) -> None:
    path = write(tmp_path / "x.zip", {f"{index}.txt": b"%d" % index for index in range(30)})
    assert "holds 30 members (at most 29)" in refused(path, tmp_path, members=29)
    assert "MB (at most 0 MB)" in refused(path, tmp_path, total=40)
    assert len(unpack(path, tmp_path / "fine", "asset/one", ZipLimits(members=30, total=50))) == 30


def test_a_member_that_lies_about_its_size_is_not_unpacked_further(tmp_path: Path) -> None:
    data = bytearray(write(tmp_path / "x.zip", {"a.bin": bytes(100_000)}).read_bytes())
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):  # local header, central directory
        struct.pack_into("<I", data, data.index(signature) + offset, 10)
    (tmp_path / "x.zip").write_bytes(data)
    assert "damaged" in refused(tmp_path / "x.zip", tmp_path)


def test_damage_encryption_doubles_and_emptiness_are_named(tmp_path: Path) -> None:
    (tmp_path / "x.zip").write_bytes(b"<html>no zip</html>")
    assert "not a zip archive" in refused(tmp_path / "x.zip", tmp_path)
    data = bytearray(write(tmp_path / "y.zip", {"a.bin": bytes(range(256)) * 40}).read_bytes())
    data[45] ^= 0xFF
    (tmp_path / "y.zip").write_bytes(data)
    assert "damaged" in refused(tmp_path / "y.zip", tmp_path)
    (tmp_path / "y.zip").write_bytes(data[:-30])
    assert "not a zip archive" in refused(tmp_path / "y.zip", tmp_path)
    assert "two members named" in refused(write(tmp_path / "z.zip", {"a.PNG": b"1", "A.png": b"2"}), tmp_path)
    assert "is empty" in refused(write(tmp_path / "e.zip", {}), tmp_path)
    locked = bytearray(write(tmp_path / "l.zip", {"a": b"1"}).read_bytes())
    locked[locked.index(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "l.zip").write_bytes(locked)
    assert "encrypted" in refused(tmp_path / "l.zip", tmp_path)


@pytest.mark.slow
@given(
    st.dictionaries(
        st.from_regex(r"[a-z]{1,8}(/[a-z]{1,8})?\.[a-z]{3}", fullmatch=True), st.binary(max_size=50), min_size=1
    )
)
def test_a_bundle_depends_on_its_members_alone(members: dict[str, bytes]) -> None:
    data = bundle(members)
    assert data == bundle(dict(reversed(members.items())))
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == members


def test_a_bundle_comes_back(tmp_path: Path) -> None:
    members = {"a/b.obj": b"v 0 0 0", "a/t.png": b"\x89PNG"}
    (tmp_path / "x.zip").write_bytes(bundle(members))
    assert read_zip(tmp_path / "x.zip", "asset/one") == members


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damage_is_named_whatever_the_compression(tmp_path: Path, method: int) -> None:
    path, data = tmp_path / "x.zip", bytes(range(256)) * 40
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("a.bin", data)
    whole, refusals = path.read_bytes(), []
    for offset in range(35, 55):
        damaged = bytearray(whole)
        damaged[offset] ^= 0xFF
        path.write_bytes(damaged)
        try:
            assert read_zip(path, "asset/one") == {"a.bin": data}, "a byte that says nothing"
        except Avs3dError as error:
            refusals.append(str(error))
    assert len(refusals) >= 10
    assert all(text.startswith("asset/one: ") and "\n" not in text for text in refusals)


def test_a_second_name_in_an_extra_field_is_refused(tmp_path: Path) -> None:
    """Later versions of zipfile, and other programs, unpack the member under that name."""
    entry, name = zipfile.ZipInfo("a.obj"), b"../../evil.obj"
    body = struct.pack("<BI", 1, zlib.crc32(b"a.obj")) + name
    entry.extra = struct.pack("<HH", 0x7075, len(body)) + body
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr(entry, b"v 0 0 0")
    assert "a second name" in refused(tmp_path / "x.zip", tmp_path)


def test_a_list_of_members_without_end_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "x.zip", {f"{index}.txt": b"" for index in range(30)})
    assert "holds 30 members (at most 29)" in refused(path, tmp_path, members=29)
    monkeypatch.setattr(zipfile, "ZipFile", lambda *_: pytest.fail("opened"))
    assert "holds 30 members (at most 29)" in refused(path, tmp_path, members=29)
    assert "has a list of members of" in refused(path, tmp_path, directory=100)


def test_names_from_windows_are_taken_with_forward_slashes(tmp_path: Path) -> None:
    path = write(tmp_path / "x.zip", {"a\\b.obj": b"1", "./c//d.obj": b"2"})
    assert read_zip(path, "asset/one") == {"a/b.obj": b"1", "c/d.obj": b"2"}
    assert "two members named" in refused(write(path, {"a\\b.obj": b"1", "a/B.obj": b"2"}), tmp_path)


def test_a_bomb_that_lies_about_its_packed_size_is_refused(tmp_path: Path) -> None:
    data = bytearray(bomb())
    central = data.rindex(b"PK\x01\x02")
    struct.pack_into("<I", data, central + 20, 40_000_000)  # as if scene.bin were not packed at all
    (tmp_path / "x.zip").write_bytes(data)
    assert "packed bytes and holds" in refused(tmp_path / "x.zip", tmp_path)
