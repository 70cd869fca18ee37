"""Collections over HTTP, with imitations of their interfaces: the fetched assets, and one line for each failure."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.meshfile import load_mesh
from generators.library import read_lock
from generators.library.cli import assets
from generators.library.folder import Told, mesh_files
from generators.library.http import FetchLimits
from generators.library.lock import AssetEntry
from generators.library.session import Session, Stance
from generators.library.sources import fetch_new, fetch_pinned
from generators.library.store import Store
from tests.support.library_server import (
    TOKEN,
    UID,
    Reply,
    Server,
    bbc,
    bomb,
    freesound,
    glb,
    gltf_zip,
    json_reply,
    sketchfab,
    wav,
)

FAST = FetchLimits(timeout=0.5, total=5.0, backoff=0.01, attempts=3, max_wait=0.5)


@pytest.fixture
def server(library_server: Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Server:
    library_server.routes.clear()
    library_server.calls.clear()
    for name in ("SKETCHFAB", "FREESOUND", "BBC_API", "BBC_MEDIA", "ESC50"):
        monkeypatch.setenv(f"AVS3D_{name}_URL", library_server.url)
    for name in ("SKETCHFAB_TOKEN", "FREESOUND_TOKEN"):
        monkeypatch.setenv(name, TOKEN)
    monkeypatch.delenv("FREESOUND_OAUTH_TOKEN", raising=False)
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    return library_server


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(Store(tmp_path / "store"), FAST)


def new(source: str, session: Session, form: str | None = None, category: str | None = None) -> AssetEntry:
    ref = {"sketchfab": UID, "freesound": "1234", "bbc": "07005210"}[source]
    kind = {"sketchfab": "microwave", "freesound": "clock", "bbc": "telephone"}[source]
    return fetch_new(source, ref, Told(category or kind), Stance(height=0.3), session, form)


def run(*args: object) -> Result:
    return CliRunner().invoke(assets, [str(arg) for arg in args], catch_exceptions=True)


def fails(call: Callable[[], object], session: Session, words: str, asset: str) -> None:
    """``call`` ends in one line that names the asset; nothing is left in the store, not even a folder."""
    with pytest.raises(Avs3dError) as caught:
        call()
    text = str(caught.value)
    assert words in text
    assert text.startswith(f"{asset}: ")
    assert "\n" not in text
    assert TOKEN not in text
    assert "signature=" not in text
    assert list(session.store.root.rglob("*")) == []


# ---- Sketchfab ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["glb", "gltf"])
def test_a_model_comes_with_everything_that_credits_it(server: Server, session: Session, form: str) -> None:
    sketchfab(server)
    entry = new("sketchfab", session, form)
    data = glb() if form == "glb" else gltf_zip()
    assert (entry.id, entry.title, entry.author, entry.licence) == (
        f"sketchfab/{UID}", "Red box", "A. Maker", "CC-BY-4.0",
    )  # fmt: skip
    assert entry.url == f"https://sketchfab.com/3d-models/red-box-{UID}"
    if form == "glb":
        assert entry.sha256 == hashlib.sha256(data).hexdigest()
        assert session.store.path(entry).read_bytes() == data
    mesh = load_mesh(session.store.mesh(entry))
    low, high = mesh.bounds
    assert high - low == pytest.approx((0.4, 0.3, 0.25), abs=1e-4)
    for call in server.calls:
        stored = call.path.startswith("/store/")
        assert ("authorization" in call.headers) == (not stored), "the token is for the interface, not for the storage"


def test_without_a_format_the_one_that_is_offered_is_taken(server: Server, session: Session) -> None:
    sketchfab(server)
    offered = {
        "gltf": {"url": f"{server.elsewhere}/store/model.zip?signature=abc", "size": 1, "expires": 300},
        "glb": None,
    }
    server.on(f"/v3/models/{UID}/download", json_reply(offered))
    assert new("sketchfab", session).file == "model.zip"
    server.on(f"/v3/models/{UID}/download", json_reply({"usdz": {"url": "x"}}))
    with pytest.raises(Avs3dError, match="Sketchfab offers it as usdz; expected glb or gltf"):
        new("sketchfab", session)


def test_a_page_is_as_good_as_a_uid(server: Server, session: Session) -> None:
    sketchfab(server)
    page = f"https://sketchfab.com/3d-models/red-box-{UID}"
    assert fetch_new("sketchfab", page, Told("microwave"), Stance(), session, None).ref == UID
    for text in ("red box", UID[:-1], f"../{UID}x", ""):
        with pytest.raises(UsageError, match="is no uid of Sketchfab; expected"):
            fetch_new("sketchfab", text, Told("microwave"), Stance(), session, None)


def test_an_address_that_ran_out_is_asked_for_again(server: Server, session: Session) -> None:
    sketchfab(server)
    server.on("/store/model.glb", Reply(b"<Error>expired</Error>", 403), Reply(glb()))
    entry = new("sketchfab", session)
    assert entry.sha256 == hashlib.sha256(glb()).hexdigest()
    assert len(server.to("/store/model.glb")) == 2
    server.on("/store/model.glb", Reply(b"<Error>expired</Error>", 403))
    with pytest.raises(Avs3dError, match=r"answered 403: .*check this machine's clock"):
        new("sketchfab", session)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"isDownloadable": False}, "does not offer it for download"),
        ({"slug": "by-nc", "label": "CC NonCommercial"}, "refused, its licence CC-BY-NC-4.0 forbids commercial use"),
        ({"slug": "ed", "label": "Editorial"}, "refused, its licence LicenseRef-Sketchfab-Editorial"),
        ({"slug": "st", "label": "Standard"}, "refused, its licence LicenseRef-Sketchfab-Standard"),
        ({"license": None}, "refused, its licence LicenseRef-Sketchfab-unknown"),
        ({"name": None}, "answered without 'name'"),
    ],
)
def test_models_that_may_not_be_used(server: Server, session: Session, changes: dict[str, str], words: str) -> None:
    sketchfab(server, **changes)
    fails(lambda: new("sketchfab", session), session, words, f"sketchfab/{UID}")
    assert server.to(f"/v3/models/{UID}/download") == [], "refused before anything is fetched"


def test_a_licence_that_is_allowed_by_name_is_taken_and_noted(server: Server, session: Session) -> None:
    sketchfab(server, slug="by-nc")
    said: list[str] = []
    allowing = replace(session, allowed=("CC-BY-NC-4.0",), say=said.append)
    assert new("sketchfab", allowing).licence == "CC-BY-NC-4.0"
    assert any("taken because it was allowed by name" in line for line in said)


@pytest.mark.parametrize(
    ("replies", "words"),
    [
        ((Reply(b"", 403),), "your account may not download this model"),
        ((Reply(b"", 404),), "check the uid"),
        ((Reply(b"", 429, {"Retry-After": "3600"}),), "asks to wait 3600 s"),
        ((Reply(b"<html>"),), "did not answer with JSON"),
        ((Reply(b"{}", hang=2.0),), "did not answer within 0.5 s"),
        ((json_reply([]),), "unexpected answer from Sketchfab"),
    ],
)
def test_an_interface_that_refuses(server: Server, session: Session, replies: tuple[Reply, ...], words: str) -> None:
    server.on(f"/v3/models/{UID}", *replies)
    fails(lambda: new("sketchfab", session), session, words, f"sketchfab/{UID}")


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (Reply(glb(), cut=300), "cut after 300 of"),
        (Reply(bytes(600_000)), "too large"),
        (Reply(b"<html>login</html>"), "model.glb"),
        (Reply(b""), "empty file"),
        (Reply(glb()[:-200]), "truncated"),
        (Reply(b"", 302, {"Location": "http://example.org/x?signature=abc"}), "is not an https address"),
    ],
    ids=["cut", "large", "html", "empty", "truncated", "http"],
)
def test_a_storage_that_fails(server: Server, session: Session, reply: Reply, words: str) -> None:
    sketchfab(server)
    server.on("/store/model.glb", reply)
    small = replace(session, limits=replace(FAST, max_bytes=500_000))
    fails(lambda: new("sketchfab", small), session, words, f"sketchfab/{UID}")


@pytest.mark.parametrize("evil", ["bomb", "traversal", "nothing"])
def test_hostile_archives_are_not_unpacked(server: Server, session: Session, tmp_path: Path, evil: str) -> None:
    import io
    import zipfile

    sketchfab(server)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("readme.txt" if evil == "nothing" else "../../scene.gltf", "{}")
    server.on("/store/model.zip", Reply(bomb() if evil == "bomb" else buffer.getvalue()))
    words = {"bomb": "unpacks to", "traversal": "points outside", "nothing": "no mesh in its archive"}[evil]
    fails(lambda: new("sketchfab", session, "gltf"), session, words, f"sketchfab/{UID}")


def test_tokens_that_are_missing_or_wrong(server: Server, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    sketchfab(server)
    for value, words in (
        (None, "SKETCHFAB_TOKEN is not set; get one at https://sketchfab.com/settings/password"),
        ("", "SKETCHFAB_TOKEN is not set"),
        ("two words", "SKETCHFAB_TOKEN contains spaces"),
        ("another-token", "answered 401: it requires a valid token; SKETCHFAB_TOKEN is not valid"),
    ):
        if value is None:
            monkeypatch.delenv("SKETCHFAB_TOKEN")
        else:
            monkeypatch.setenv("SKETCHFAB_TOKEN", value)
        fails(lambda: new("sketchfab", session), session, words, f"sketchfab/{UID}")


# ---- Freesound ------------------------------------------------------------------------------------------------------


def test_a_preview_comes_without_oauth(server: Server, session: Session) -> None:
    freesound(server)
    entry = new("freesound", session)
    assert (entry.file, entry.author, entry.licence, entry.title) == (
        "preview.ogg", "tester", "CC-BY-4.0", "old clock.wav",
    )  # fmt: skip
    assert session.store.problem(entry) == ""
    assert "authorization" not in server.to("/previews/1234-hq.ogg")[0].headers


def test_the_original_comes_with_oauth(server: Server, session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    freesound(server, md5=hashlib.md5(wav()).hexdigest())
    fails(lambda: new("freesound", session, "original"), session, "FREESOUND_OAUTH_TOKEN is not set", "freesound/1234")
    monkeypatch.setenv("FREESOUND_OAUTH_TOKEN", "stale")
    fails(lambda: new("freesound", session), session, "not valid or has expired", "freesound/1234")
    monkeypatch.setenv("FREESOUND_OAUTH_TOKEN", TOKEN)
    entry = new("freesound", session)
    assert (entry.file, session.store.path(entry).read_bytes()) == ("original.wav", wav())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"licence": "http://creativecommons.org/licenses/by-nc/3.0/"}, "CC-BY-NC-3.0 forbids commercial use"),
        ({"licence": "http://creativecommons.org/licenses/sampling+/1.0/"}, "CC-Sampling-Plus-1.0 forbids"),
        ({"previews": {}}, "answered without 'previews.preview-hq-ogg'"),
    ],
)
def test_sounds_that_may_not_be_used(server: Server, session: Session, changes: dict[str, object], words: str) -> None:
    freesound(server, **changes)  # type: ignore[arg-type]
    fails(lambda: new("freesound", session), session, words, "freesound/1234")


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (Reply(b"<html>" * 100), "cannot be decoded as a sound"),
        (Reply(wav(0.2)), "lasts 0.20 s; expected at least 0.5 s"),
        (Reply(wav(), 404), "not found; check the id"),
    ],
)
def test_files_that_are_no_sound(server: Server, session: Session, reply: Reply, words: str) -> None:
    freesound(server)
    server.on("/previews/1234-hq.ogg", reply)
    fails(lambda: new("freesound", session), session, words, "freesound/1234")


def test_an_original_with_another_md5_is_refused(
    server: Server, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    freesound(server, md5="0" * 32)
    monkeypatch.setenv("FREESOUND_OAUTH_TOKEN", TOKEN)
    fails(lambda: new("freesound", session), session, "is not the one that Freesound describes", "freesound/1234")
    freesound(server, type="m4a")
    fails(lambda: new("freesound", session, "original"), session, "use --format preview", "freesound/1234")
    assert new("freesound", session).file == "preview.ogg"


# ---- BBC ------------------------------------------------------------------------------------------------------------


def test_the_bbc_wants_its_licence_allowed(server: Server, session: Session) -> None:
    bbc(server)
    fails(lambda: new("bbc", session), session, "LicenseRef-RemArc is for personal, educational", "bbc/07005210")
    entry = new("bbc", replace(session, allowed=("LicenseRef-RemArc",)))
    assert (entry.title, entry.author, entry.file) == ("Telephone rings", "BBC Sound Effects", "sound.wav")
    with pytest.raises(Avs3dError, match=r"^bbc/07005211: BBC Sound Effects has no sound of that id"):
        fetch_new("bbc", "07005211", Told("telephone"), Stance(), session, None)
    with pytest.raises(Avs3dError, match=r"not every sound is available as WAV|not found"):
        fetch_new(
            "bbc",
            "07005210",
            Told("telephone"),
            Stance(),
            replace(session, allowed=("LicenseRef-RemArc",)),
            "mp3",
        )


# ---- pinned files again, and the command line -----------------------------------------------------------------------


@pytest.mark.parametrize("source", ["sketchfab", "freesound", "bbc"])
def test_a_pinned_file_is_fetched_again_and_compared(server: Server, session: Session, source: str) -> None:
    {"sketchfab": sketchfab, "freesound": freesound, "bbc": bbc}[source](server)
    allowing = replace(session, allowed=("LicenseRef-RemArc",))
    entry = new(source, allowing)
    assert not fetch_pinned(entry, allowing)
    data = session.store.path(entry).read_bytes()
    for damage in (data[:-1], b"x" * len(data)):
        session.store.path(entry).write_bytes(damage)
        assert fetch_pinned(entry, allowing)
        assert session.store.path(entry).read_bytes() == data
    session.store.drop(entry)
    changed = entry.model_copy(update={"sha256": "0" * 64})
    fails(lambda: fetch_pinned(changed, allowing), session, "not the file that was pinned", entry.id)


def test_the_commands_tell_one_story(server: Server, tmp_path: Path) -> None:
    sketchfab(server)
    freesound(server)
    lock = tmp_path / "assets.lock.yaml"
    done = run("fetch", "sketchfab", UID, "--category", "microwave", "--height", 0.3, "--lock", lock)
    assert done.exit_code == 0, done.output
    done = run("fetch", "freesound", 1234, 9999, "--category", "clock", "--lock", lock)
    assert done.exit_code == 1
    assert "freesound/9999: Freesound answered 404" in done.output
    assert "1 assets added or updated, 1 failed" in done.output
    assert [entry.id for entry in read_lock(lock).assets] == ["freesound/1234", f"sketchfab/{UID}"]
    assert TOKEN not in lock.read_text()

    first = lock.read_bytes()
    run("fetch", "freesound", 1234, "--category", "clock", "--lock", lock)
    assert lock.read_bytes() == first, "the same asset gives the same bytes"

    listed = run("list", "--lock", lock, "--kind", "sound")
    assert listed.exit_code == 0
    assert "freesound/1234" in listed.output
    assert "sketchfab" not in listed.output

    assert run("verify", "--lock", lock).exit_code == 0
    store = Store(tmp_path / "store")
    for entry in read_lock(lock).assets:
        store.path(entry).write_bytes(b"damaged")
    checked = run("verify", "--lock", lock)
    assert checked.exit_code == 1
    assert all(entry.id in checked.output for entry in read_lock(lock).assets)
    again = run("fetch", "--lock", lock)
    assert again.exit_code == 0, again.output
    assert "2 fetched, 0 already in the store, 0 failed" in again.output
    assert run("verify", "--lock", lock).exit_code == 0


def test_a_failure_of_one_does_not_stop_the_others(server: Server, tmp_path: Path) -> None:
    sketchfab(server)
    freesound(server)
    lock = tmp_path / "assets.lock.yaml"
    run("fetch", "sketchfab", UID, "--category", "microwave", "--lock", lock)
    run("fetch", "freesound", 1234, "--category", "clock", "--lock", lock)
    store = Store(tmp_path / "store")
    for entry in read_lock(lock).assets:
        store.drop(entry)
    server.on("/sounds/1234/", Reply(b"", 404))
    done = run("fetch", "--lock", lock)
    assert done.exit_code == 1
    assert "freesound/1234: Freesound answered 404" in done.output
    assert "1 fetched, 0 already in the store, 1 failed" in done.output


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("fetch", "freesound", "1234"), "expected an ID and --category"),
        (("fetch", "freesound", "--category", "clock"), "expected an ID and --category"),
        (("fetch", "freesound", "1234", "--category", "clock", "--format", "wav"), "offers preview and original"),
        (("fetch", "--category", "clock"), "are for new assets"),
        (("fetch", "--lock", "none.yaml"), "no such lock file"),
        (("import", "folder", "none", "--licence", "MIT", "--author", "x", "--category", "clock"), "no such folder"),
        (("import", "sh3f", "none.sh3f"), "none.sh3f: cannot"),
        (("import", "esc50", "none"), "expected a clone of"),
    ],
)
def test_usage_is_explained(server: Server, args: tuple[str, ...], words: str) -> None:
    done = run(*args)
    assert done.exit_code != 0
    assert words in f"{done.output} {done.exception}"


def test_what_is_written_down_holds_no_secret(server: Server, session: Session, tmp_path: Path) -> None:
    sketchfab(server)
    freesound(server)
    entries = [new("sketchfab", session), new("freesound", session)]
    text = json.dumps([entry.model_dump() for entry in entries])
    stored = b"".join(path.read_bytes() for path in session.store.root.rglob("*") if path.is_file())
    assert TOKEN not in text
    assert TOKEN.encode() not in stored
    assert b"signature=" not in stored


# ---- answers and files of another shape ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"license": "by"}, "refused, its licence LicenseRef-Sketchfab-unknown"),
        ({"license": {"slug": ["by"]}}, "refused, its licence LicenseRef-Sketchfab-unknown"),
        ({"user": ["x"]}, "answered without 'user.username'"),
        ({"name": 5}, "answered without 'name'"),
        ({"viewerUrl": "x" * 5000}, "url: "),
    ],
)
def test_a_description_of_another_shape_is_one_line(
    server: Server, session: Session, changes: dict[str, object], words: str
) -> None:
    sketchfab(server, **changes)  # type: ignore[arg-type]
    fails(lambda: new("sketchfab", session), session, words, f"sketchfab/{UID}")
    assert server.to("/store/model.glb") == [], "refused before a byte of it is fetched"


@pytest.mark.parametrize("changes", [{"licence": {}}, {"username": 7}, {"previews": []}])
def test_a_sounds_description_of_another_shape_too(
    server: Server, session: Session, changes: dict[str, object]
) -> None:
    freesound(server, **changes)  # type: ignore[arg-type]
    fails(lambda: new("freesound", session), session, "answered without", "freesound/1234")


def test_a_store_that_is_a_file_is_named(server: Server, tmp_path: Path) -> None:
    freesound(server)
    (tmp_path / "file").write_text("x")
    with pytest.raises(Avs3dError, match=r"^freesound/1234: .*cannot write: not a directory"):
        new("freesound", Session(Store(tmp_path / "file"), FAST))


def test_the_file_of_another_process_is_left_alone(server: Server, session: Session) -> None:
    """It has just come whole under its name there, and has yet to be given its place in the store."""
    freesound(server)
    staged = session.store.incoming("freesound/1234", "preview.ogg")
    staged.parent.mkdir(parents=True)
    staged.write_bytes(b"of another process")
    server.on("/previews/1234-hq.ogg", Reply(b"", 404))
    with pytest.raises(Avs3dError):
        new("freesound", session)
    assert staged.read_bytes() == b"of another process"


def imports(folder: Path, lock: Path, licence: str = "CC0-1.0") -> Result:
    return run(
        "import", "folder", folder, "--licence", licence, "--author", "me", "--category", "clock", "--lock", lock
    )


def test_files_of_like_names_do_not_take_each_others_place(server: Server, tmp_path: Path) -> None:
    folder, lock = tmp_path / "mine", tmp_path / "assets.lock.yaml"
    folder.mkdir()
    for number, name in enumerate(("clock.wav", "clock.ogg", "Zoë.wav", "時計.wav", "電話.wav", "a b.wav", "a-b.wav")):
        (folder / name).write_bytes(wav(1 + number / 10, "OGG" if name.endswith("ogg") else "WAV"))
    (folder / "clock.glb").write_bytes(glb())
    done = imports(folder, lock)
    assert done.exit_code == 0, done.output
    entries = read_lock(lock).assets
    assert len(entries) == 8
    assert len({entry.sha256 for entry in entries}) == 8
    ids = {entry.ref: entry.id for entry in entries}
    assert ids["clock.wav"] == "folder/mine/clock-wav"
    assert ids["clock.glb"] == "folder/mine/clock-glb"
    assert ids["Zoë.wav"] == "folder/mine/Zoe"
    first = lock.read_bytes()
    assert imports(folder, lock).exit_code == 0
    assert lock.read_bytes() == first


def test_one_hostile_file_does_not_end_an_import(server: Server, tmp_path: Path) -> None:
    folder, lock = tmp_path / "mine", tmp_path / "assets.lock.yaml"
    folder.mkdir()
    obj = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    (folder / "long.obj").write_text(obj.format("a" * 5000))
    (folder / "nul.obj").write_text(obj.format("a\0b.mtl"))
    deep = b'{"asset":{"version":"2.0"},"extras":' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    (folder / "deep.gltf").write_bytes(deep)
    (folder / "uri.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "\0"}]}))
    Path(folder, "name\udcff.obj").write_text(obj.format("x.mtl"))
    (folder / "zz.wav").write_bytes(wav())
    done = imports(folder, lock)
    assert done.exit_code == 1, done.exception
    assert isinstance(done.exception, SystemExit)
    assert "folder/mine/deep: " in done.output
    assert "rename the file" in done.output
    assert "folder/mine/zz" in {entry.id for entry in read_lock(lock).assets}


def test_textures_are_found_whatever_their_case_and_path(server: Server, session: Session, tmp_path: Path) -> None:
    folder = tmp_path / "m"
    folder.mkdir()
    (folder / "box.obj").write_text("mtllib C:\\work\\BOX.mtl\n")
    (folder / "box.MTL").write_text("newmtl a\nmap_Kd textures\\Wood.PNG\n")
    (folder / "textures").mkdir()
    (folder / "textures" / "wood.png").write_bytes(b"png")
    assert sorted(mesh_files(folder / "box.obj", folder)) == ["box.MTL", "box.obj", "textures/wood.png"]
    (folder / "box.dae").write_text("<image><init_from>textures/wood.png</init_from></image>")
    assert sorted(mesh_files(folder / "box.dae", folder)) == ["box.dae", "textures/wood.png"]


def test_a_condition_in_the_licences_name_is_heeded(server: Server, tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_bytes(wav())
    done = imports(tmp_path / "a.wav", tmp_path / "assets.lock.yaml", "Attribution, no commercial use")
    assert done.exit_code == 1
    assert "refused, its licence Attribution, no commercial use" in done.output


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("verify", "--lock", "none.yaml"), "none.yaml: no such lock file"),
        (("list", "--lock", "none.yaml"), "none.yaml: no such lock file"),
        (("fetch", "sketchfab", UID, "--category", "clock", "--height", "80"), "not in the range"),
        (("fetch", "sketchfab", UID, "--category", "clock", "--height", "nan"), "is not a number in the range"),
        (("fetch", "freesound", "1234", "--category", "clock", "--max-size", "nan"), "is not a number in the range"),
        (("fetch", "sketchfab", UID, "--category", "clock", "--up", "y", "--front", "-y"), "must be perpendicular"),
    ],
)
def test_slips_on_the_command_line_are_told_at_once(server: Server, args: tuple[str, ...], words: str) -> None:
    done = run(*args)
    assert done.exit_code == 2 or isinstance(done.exception, UsageError)
    assert words in f"{done.output} {done.exception}"
    assert server.calls == []
