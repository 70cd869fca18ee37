"""`avs3d release` and `avs3d get`: what is in the archives, and what is refused on the way back."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import subprocess
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.cli import main
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.release import get as get_module
from avs3d_bench.exports.release.files import ReleasedFile, cut
from avs3d_bench.exports.release.get import KNOWN, HostedRelease, find_release, get_release
from avs3d_bench.exports.release.record import RELEASE_JSON
from avs3d_bench.exports.release.write import ReleaseSettings, write_release
from avs3d_bench.formats.files import sha256_file
from tests.support import sealed_trees, tiny
from tests.support.library_server import Reply, Server
from tests.support.shared import SharedDataset

pooch = pytest.importorskip("pooch", reason="not installed: pip install 'avs3d-bench[get]'")

#: Both observations of `tiny` fit into one archive each.
SETTINGS = ReleaseSettings(archive_mb=2)


@pytest.fixture(scope="module")
def dataset(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=2)


@pytest.fixture(scope="module")
def released(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("release") / "release"
    write_release(dataset, folder, SETTINGS, workers=1)
    return folder


def files_of(folder: Path) -> dict[str, str]:
    """sha256 of every file below a folder."""
    return {p.relative_to(folder).as_posix(): sha256_file(p) for p in sorted(folder.rglob("*")) if p.is_file()}


def members(folder: Path) -> dict[str, dict[str, str]]:
    """Archive → name → sha256, as Python's tarfile reads them."""
    found: dict[str, dict[str, str]] = {}
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as archive:
            found[path.name] = {}
            for info in archive:
                assert (info.mtime, info.uid, info.gid, info.mode) == (0, 0, 0, 0o644)
                stream = archive.extractfile(info)
                assert stream is not None
                found[path.name][info.name] = hashlib.sha256(stream.read()).hexdigest()
    return found


# ---- a release ------------------------------------------------------------------------------------------------------


def test_the_archives_hold_the_dataset_and_each_observation_is_in_one(dataset: Path, released: Path) -> None:
    found = members(released)
    assert len(found) == 2
    assert {name: digest for archive in found.values() for name, digest in archive.items()} == files_of(dataset)
    homes = [{name.rpartition("/")[0].split("/", 4)[0] for name in archive} - {""} for archive in found.values()]
    assert homes == [{"part_1"}, {"part_2"}]
    assert all((released / name).stat().st_size <= 2e6 for name in found)


def test_sums_and_registry_name_every_other_file(released: Path) -> None:
    there = files_of(released)
    lines = (released / "SHA256SUMS").read_text().splitlines()
    listed = {name: digest for digest, name in (line.split("  ") for line in lines)}
    assert listed == {name: digest for name, digest in there.items() if name not in ("SHA256SUMS", "registry.txt")}
    store = pooch.create(released, released.as_uri())
    store.load_registry(released / "registry.txt")
    assert store.registry == {name: f"sha256:{digest}" for name, digest in listed.items()}
    for name in store.registry:
        assert Path(store.fetch(name)) == released / name  # pooch: there already, with this hash


def test_the_same_dataset_gives_the_same_bytes(dataset: Path, released: Path, tmp_path: Path) -> None:
    # A copy has other times and no hard links.
    shutil.copytree(dataset, tmp_path / "copy", copy_function=shutil.copyfile)
    write_release(tmp_path / "copy", tmp_path / "again", SETTINGS, workers=2)
    assert files_of(tmp_path / "again") == files_of(released)


@pytest.mark.slow
def test_equal_pictures_are_in_an_archive_once(shared_part_3: SharedDataset, tmp_path: Path) -> None:
    root = shared_part_3()
    release = write_release(root, tmp_path / "release", workers=1)
    (archive,) = release.archives
    whole = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    distinct = {sha256_file(path): path.stat().st_size for path in root.rglob("*") if path.is_file()}
    assert archive.unpacked == sum(distinct.values()) < whole
    (found,) = members(tmp_path / "release").values()
    assert found == files_of(root)


def test_only_files_that_the_records_name_are_released(dataset: Path, tmp_path: Path) -> None:
    root = tiny.clone(dataset, tmp_path / "data")
    for name in ("notes.txt", "answers.csv", "part_1/tiny/kitchen/1/guess.png", "failures.jsonl"):
        (root / name).write_text("mine")
    write_release(root, tmp_path / "release", SETTINGS, workers=1)
    assert {n for archive in members(tmp_path / "release").values() for n in archive} == set(files_of(dataset))


def test_an_observation_is_cut_only_if_it_is_larger_than_an_archive() -> None:
    def unit(name: str, *sizes: int) -> list[ReleasedFile]:
        return [ReleasedFile(f"{name}/{i}", size, f"{name}{i}") for i, size in enumerate(sizes)]

    units = [unit("a", 30_000), unit("b", 40_000, 50_000), unit("c", 90_000, 90_000), unit("d", 9_000)]
    cuts = [[file.path for file in archive.files] for archive in cut(iter(units), 102_400)]
    assert cuts == [["a/0"], ["b/0", "b/1"], ["c/0"], ["c/1"], ["d/0"]] or cuts == [
        ["a/0"], ["b/0", "b/1"], ["c/0"], ["c/1", "d/0"]
    ]  # fmt: skip
    assert all(archive.size <= 102_400 for archive in cut(iter(units), 102_400))
    with pytest.raises(UsageError, match=r"e/0: 200,000 bytes do not fit .* --archive-size"):
        cut(iter([unit("e", 200_000)]), 102_400)


def test_a_release_says_licences_doi_and_address(dataset: Path, tmp_path: Path) -> None:
    settings = ReleaseSettings(doi="10.5281/zenodo.42", url="https://example.org/tiny")
    write_release(dataset, tmp_path / "release", settings, workers=1)
    readme = (tmp_path / "release/README.md").read_text()
    assert "avs3d get tiny --from https://example.org/tiny" in readme
    assert "DOI: 10.5281/zenodo.42." in readme
    assert "\nviewer: false\n---\n" in readme
    licences = (tmp_path / "release/LICENCES.md").read_text()
    assert "| box | CC0-1.0 | avs3d-bench | procedural |" in licences
    described = json.loads((tmp_path / "release/croissant.json").read_text())
    assert described["identifier"] == "https://doi.org/10.5281/zenodo.42"


@pytest.mark.slow
def test_mlcroissant_reads_the_archives(released: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant", reason="not installed: pip install 'avs3d-bench[exports]'")
    described = mlcroissant.Dataset(str(released / "croissant.json"))
    assert not described.metadata.ctx.issues.errors
    keys = [one["observations/key"] for one in described.records("observations")]
    assert sorted(key.decode() for key in keys) == [tiny.SINGLE, tiny.MULTI]


def test_a_damaged_file_is_not_released(dataset: Path, tmp_path: Path) -> None:
    root = tiny.clone(dataset, tmp_path / "data")
    clip = root / tiny.SINGLE / "audio_clips_binaural/frame_1.wav"
    tiny.replace(clip, clip.read_bytes()[:-1] + b"x")
    with pytest.raises(Avs3dError, match=r"frame_1.wav: not the file that the dataset's records name"):
        write_release(root, tmp_path / "release", SETTINGS, workers=1)
    clip.unlink()
    with pytest.raises(Avs3dError, match=r"frame_1.wav: missing; the dataset's records name it"):
        write_release(root, tmp_path / "release", SETTINGS, workers=1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]


def test_a_folder_of_something_else_is_kept(dataset: Path, released: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("x")
    with pytest.raises(UsageError, match="not empty and no release"):
        write_release(dataset, tmp_path / "mine", workers=1)
    shutil.copytree(released, tmp_path / "release")
    (tmp_path / "release/thesis.tex").write_text("x")
    with pytest.raises(UsageError, match=r"thesis.tex: no file that this command writes"):
        write_release(dataset, tmp_path / "release", workers=1)
    (tmp_path / "release/thesis.tex").unlink()
    write_release(dataset, tmp_path / "release", workers=1)
    assert len(list((tmp_path / "release").glob("*.tar"))) == 1, "of the new limit; the old archives are gone"
    with pytest.raises(UsageError, match="lies inside the dataset"):
        write_release(dataset, dataset / "release", workers=1)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (ReleaseSettings(archive_mb=0), "--archive-size 0: expected megabytes"),
        (ReleaseSettings(archive_mb=float("nan")), "--archive-size nan"),
        (ReleaseSettings(doi="https://doi.org/10.1/x"), "expected a DOI without an address"),
        (ReleaseSettings(url="here"), "--url 'here'"),
        (ReleaseSettings(home="here"), "expected http"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    settings: ReleaseSettings, message: str, dataset: Path, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=message):
        write_release(dataset, tmp_path / "release", settings, workers=1)
    assert not (tmp_path / "release").exists()


def test_the_official_release_is_not_ours_to_release(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the official release is its authors' to publish"):
        write_release(tiny.write_release(tmp_path / "official"), tmp_path / "release")


# ---- a sealed test --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sealed_trees.write_seal(tmp_path_factory.mktemp("seal"), frames=2)


def test_a_release_of_a_sealed_test_has_no_file_of_its_private_side(sealed: Path, tmp_path: Path) -> None:
    write_release(sealed / "public", tmp_path / "release", workers=1)
    private, public = files_of(sealed / "private"), files_of(sealed / "public")
    (found,) = members(tmp_path / "release").values()
    assert found == public
    beside = [path.read_bytes() for path in (tmp_path / "release").iterdir() if path.suffix != ".tar"]
    for name, digest in private.items():
        if name not in public:
            assert digest not in found.values(), name
            assert not any(digest.encode() in data for data in beside), name
    readme = (tmp_path / "release/README.md").read_text()
    assert "a sealed test: manifest and truth are published when it ends" in readme
    assert "stored verbatim" not in readme
    secret = (sealed / "private/opening.hex").read_text().strip().encode()
    assert not any(secret in path.read_bytes() for path in (tmp_path / "release").iterdir())


@pytest.mark.parametrize("without", [(), ("seal.json",), ("seal.json", "opening.hex")])
def test_the_private_side_is_refused(without: tuple[str, ...], sealed: Path, tmp_path: Path) -> None:
    shutil.copytree(sealed / "private", tmp_path / "private")
    for name in without:
        (tmp_path / "private" / name).unlink()
    with pytest.raises(UsageError, match=r"private side of a sealed test, .* avs3d release .*public"):
        write_release(tmp_path / "private", tmp_path / "release")


def test_a_public_side_with_something_of_the_truth_is_refused(sealed: Path, tmp_path: Path) -> None:
    public = tmp_path / "public"
    shutil.copytree(sealed / "public", public)
    key = next(path.parent.relative_to(public) for path in sorted(public.rglob("poses.json")))
    shutil.copy(sealed / "private" / key / "observation.json", public / key)
    with pytest.raises(Avs3dError, match=r"observation.json: surplus file.*nothing is released"):
        write_release(public, tmp_path / "release")
    (public / key / "observation.json").unlink()
    (public / "seal.json").unlink()
    with pytest.raises(UsageError, match=r"seal.json: missing"):
        write_release(public, tmp_path / "release")


# ---- and back -------------------------------------------------------------------------------------------------------


@pytest.fixture
def host(library_server: Server, released: Path, monkeypatch: pytest.MonkeyPatch) -> Server:
    """A server that has the release and knows ranges; nobody waits between attempts."""
    library_server.routes.clear()
    library_server.calls.clear()
    for path in released.iterdir():
        library_server.on(f"/r/{path.name}", Reply(path.read_bytes(), ranges=True))
    monkeypatch.setattr("pooch.core.time.sleep", lambda _: None)
    return library_server


def get(server: Server, folder: Path, **options: Any) -> Any:
    return get_release("tiny", find_release("tiny", f"{server.url}/r", **options), folder)


def test_what_comes_back_is_the_dataset(host: Server, dataset: Path, released: Path, tmp_path: Path) -> None:
    release = get(host, tmp_path / "got", sha256=sha256_file(released / RELEASE_JSON))
    assert release.observations == 2
    assert files_of(tmp_path / "got") == files_of(dataset)
    assert [path.name for path in tmp_path.iterdir()] == ["got"]
    first = (tmp_path / "got" / tiny.SINGLE / "input/frame_000.png").stat()
    assert first.st_nlink == 2, "images/ is linked to input/"


def test_an_interrupted_download_continues(host: Server, released: Path, dataset: Path, tmp_path: Path) -> None:
    two = (released / "tiny-1-001.tar").read_bytes()
    broken = Reply(two, ranges=True, cut=300_000)
    host.on("/r/tiny-1-001.tar", broken)
    with pytest.raises(Avs3dError, match=r"no connection .* run the same command again, it continues"):
        get(host, tmp_path / "got")
    assert [path.name for path in tmp_path.iterdir()] == [".got.download"]
    host.on("/r/tiny-1-001.tar", Reply(two, ranges=True))
    get(host, tmp_path / "got")
    assert files_of(tmp_path / "got") == files_of(dataset)
    assert len(host.to("/r/tiny-1-000.tar")) == 1, "it was there already"
    asked = [call.headers.get("range") for call in host.to("/r/tiny-1-001.tar")]
    assert asked[0] is None
    assert all(one is not None for one in asked[1:]), "what had come was kept"
    assert [path.name for path in tmp_path.iterdir()] == ["got"]


def test_a_server_without_ranges_sends_it_again(host: Server, released: Path, dataset: Path, tmp_path: Path) -> None:
    two = (released / "tiny-1-001.tar").read_bytes()
    host.on("/r/tiny-1-001.tar", Reply(two, cut=500_000), Reply(two), Reply(two))
    get(host, tmp_path / "got")
    assert files_of(tmp_path / "got") == files_of(dataset)


def test_a_file_url_is_read_in_place(released: Path, dataset: Path, tmp_path: Path) -> None:
    place = tmp_path / "a place"
    shutil.copytree(released, place)
    for address, name in ((place.as_uri(), "got"), (str(place), "again")):
        get_release("tiny", find_release("tiny", address), tmp_path / name)
        assert files_of(tmp_path / name) == files_of(dataset)


def changed(data: bytes) -> bytes:
    return data[:700] + bytes([data[700] ^ 1]) + data[701:]


@pytest.mark.parametrize("change", [changed, lambda data: data[:-512], lambda data: data + bytes(512)])
def test_a_changed_archive_is_refused(
    change: Callable[[bytes], bytes], host: Server, released: Path, tmp_path: Path
) -> None:
    host.on("/r/tiny-1-001.tar", Reply(change((released / "tiny-1-001.tar").read_bytes())))
    with pytest.raises(Avs3dError, match=r"tiny-1-001.tar: not the archive that release.json names") as caught:
        get(host, tmp_path / "got")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "got").exists()


def test_another_release_json_is_refused_if_its_digest_is_known(host: Server, released: Path, tmp_path: Path) -> None:
    digest = sha256_file(released / RELEASE_JSON)
    host.on(f"/r/{RELEASE_JSON}", Reply((released / RELEASE_JSON).read_bytes() + b" "))
    with pytest.raises(Avs3dError, match=f"expected {digest}; this is another release, or it was changed"):
        get(host, tmp_path / "got", sha256=digest)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("data", "message"),
    [(b"<html>", "no valid JSON|JSON"), (b"{}", "release.json"), (b"[" * 100_000, "release.json")],
)
def test_a_page_in_place_of_the_record_is_one_line(data: bytes, message: str, host: Server, tmp_path: Path) -> None:
    host.on(f"/r/{RELEASE_JSON}", Reply(data))
    with pytest.raises(Avs3dError, match=message) as caught:
        get(host, tmp_path / "got")
    assert "\n" not in str(caught.value)


def test_what_is_not_there_is_one_line(host: Server, tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"answers 404 .*expected a folder that holds a release"):
        get_release("tiny", find_release("tiny", f"{host.url}/elsewhere"), tmp_path / "got")
    with pytest.raises(UsageError, match="has the release tiny, not 'listen'"):
        get_release("listen", find_release("listen", f"{host.url}/r"), tmp_path / "got")
    with pytest.raises(Avs3dError, match=r"release.json: missing"):
        get_release("tiny", find_release("tiny", (tmp_path / "nowhere").as_uri()), tmp_path / "got")
    with pytest.raises(UsageError, match=r"no release 'tiny': the package knows none yet; .*--from URL"):
        find_release("tiny", None)
    for url in ("ftp://a/b", "folder", "https:///x", "https://a/b?c=d"):
        with pytest.raises(UsageError, match=r"--from .*expected (a folder, or )?the address of"):
            find_release("tiny", url)
    with pytest.raises(UsageError, match="--sha256 'abc'"):
        find_release("tiny", "https://a/", "abc")
    assert list(tmp_path.iterdir()) == []


def test_names_are_looked_up_in_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    known = HostedRelease("https://example.org/tiny/", "0" * 64)
    monkeypatch.setitem(KNOWN, "tiny", known)
    assert find_release("tiny", None) is known
    assert find_release("tiny", None, "1" * 64) == HostedRelease(known.url, "1" * 64)
    with pytest.raises(UsageError, match="--sha256 'abc'"):
        find_release("tiny", None, "abc")
    with pytest.raises(UsageError, match="the package knows tiny; did you mean 'tiny'"):
        find_release("tinyy", None)
    assert all(len(one.sha256 or "") == 64 and one.url.endswith("/") for one in KNOWN.values())


def test_a_folder_that_is_there_is_kept(host: Server, tmp_path: Path) -> None:
    (tmp_path / "got").mkdir()
    (tmp_path / "got/mine").write_text("x")
    with pytest.raises(UsageError, match="exists; choose another folder"):
        get(host, tmp_path / "got")
    assert not host.calls
    (tmp_path / "got/mine").unlink()
    get(host, tmp_path / "got")


def test_a_full_disk_is_told_before_the_download(host: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(get_module.shutil, "disk_usage", lambda _: usage._replace(free=2_000_000))
    with pytest.raises(Avs3dError, match=r"needs 0.0 GB .* are free; choose a folder on another disk"):
        get(host, tmp_path / "got")
    assert not host.to("/r/tiny-1-000.tar")


def hostile(*infos: tuple[str, bytes, str]) -> bytes:
    """A tar with members (name, type, target or content)."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, kind, text in (("dataset.json", tarfile.REGTYPE, "{}"), *infos):
            info = tarfile.TarInfo(name)
            info.type = kind
            data = text.encode() if kind == tarfile.REGTYPE else b""
            info.size, info.linkname = len(data), "" if data else text
            archive.addfile(info, io.BytesIO(data))
    return buffer.getvalue()


FILE = tarfile.REGTYPE
HOSTILE = {
    "above": (("part_1/../../evil", FILE, "x"), "holds 'part_1/../../evil'"),
    "absolute": (("/tmp/evil", FILE, "x"), "holds '/tmp/evil'"),
    "backslash": (("part_1/..\\evil", FILE, "x"), "holds "),
    "drive": (("part_1/c:evil", FILE, "x"), "holds "),
    "elsewhere": ((".bashrc", FILE, "x"), "holds '.bashrc'"),
    "long": (("part_1/" + "a" * 300, FILE, "x"), "holds "),
    "symlink": (("part_1/evil", tarfile.SYMTYPE, "/etc"), "is a link, folder, device or sparse file"),
    "sparse": (("part_1/evil", tarfile.GNUTYPE_SPARSE, ""), "is a link, folder, device or sparse file"),
    "fifo": (("part_1/evil", tarfile.FIFOTYPE, ""), "is a link, folder, device or sparse file"),
    "link": (("part_1/evil", tarfile.LNKTYPE, "/etc/passwd"), "links to no earlier file"),
    "twice": (("dataset.json", FILE, "x"), "twice, or not announced"),
    "large": (("part_1/evil", FILE, "x" * 100), "more than the 12 bytes announced"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_archive_is_refused_and_nothing_is_left(
    case: str, host: Server, released: Path, tmp_path: Path
) -> None:
    member, message = HOSTILE[case]
    data = hostile(member)
    record = json.loads((released / RELEASE_JSON).read_text())
    archive = {"file": "evil.tar", "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest(), "unpacked": 12}
    record["archives"] = [{**archive, "files": 2, "first": "dataset.json", "last": "dataset.json"}]
    host.on(f"/r/{RELEASE_JSON}", Reply(json.dumps(record).encode()))
    host.on("/r/evil.tar", Reply(data))
    (tmp_path / "home").mkdir()
    with pytest.raises(Avs3dError, match=message) as caught:
        get(host, tmp_path / "home/got")
    assert "\n" not in str(caught.value)
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert left == {"home", "home/.got.download", "home/.got.download/evil.tar", "home/.got.download/lock"} or left == {
        "home", "home/.got.download", "home/.got.download/evil.tar"
    }  # fmt: skip


def test_without_pooch_one_line_says_what_to_install(
    released: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pooch", None)
    with pytest.raises(SystemExit) as ended:
        main(["get", "tiny", "--from", released.as_uri(), "-o", str(tmp_path / "got")])
    assert ended.value.code == 1
    assert capsys.readouterr().err.strip().endswith("avs3d get needs it: pip install 'avs3d-bench[get]'")


def test_the_commands_print_what_they_did(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["release", str(dataset), "-o", "release", "--workers", "1"])
    printed = capsys.readouterr().out.splitlines()
    digest = sha256_file(tmp_path / "release" / RELEASE_JSON)
    assert printed[-2:] == [f"sha256 of release.json, for avs3d get --sha256: {digest}", "release"]
    with pytest.raises(SystemExit):
        main(["get", "tiny", "--from", (tmp_path / "release").as_uri(), "--sha256", digest])
    assert capsys.readouterr().out.splitlines()[-2:] == ["licence: CC0-1.0", "data/tiny"]
    sums = subprocess.run(["sha256sum", "-c", "SHA256SUMS"], cwd="release", capture_output=True, check=False)
    assert sums.returncode == 0
