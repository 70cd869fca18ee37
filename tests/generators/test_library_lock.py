"""The lock file: stable bytes, every wrong field named, writers that take turns; licences; the store."""

from __future__ import annotations

import errno
import fcntl
import multiprocessing
import os
import random
import stat
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError, UsageError
from generators.library.licences import check_licence, conditions, from_sketchfab, spdx, terms
from generators.library.lock import AssetEntry, Lock, dump_lock, parse_lock, read_lock, slug, update_lock
from generators.library.store import Store, open_asset
from tests.support.library_server import wav

BASE = {
    "id": "freesound/1234",
    "kind": "sound",
    "category": "clock",
    "source": "freesound",
    "ref": "1234",
    "url": "https://freesound.org/s/1234/",
    "title": "old clock: tick “tock” — 12 o'clock",
    "author": "Zoë",
    "licence": "CC-BY-4.0",
    "file": "preview.ogg",
    "sha256": "ab" * 32,
    "bytes": 1000,
}
OBJECT = BASE | {
    "id": "sh3d/scopia/phone", "kind": "object", "category": "telephone", "source": "sh3d", "ref": "Scopia#phone",
    "file": "model.zip", "up": "y", "front": "+z", "height": 0.073,
}  # fmt: skip


def entry(**changes: object) -> AssetEntry:
    return AssetEntry.model_validate(BASE | changes)


def test_the_file_reads_as_it_was_meant_to_be_read() -> None:
    text = dump_lock(Lock(assets=(AssetEntry.model_validate(OBJECT), entry()))).decode()
    assert text.startswith("# Written by `avs3d assets`.")
    document = yaml.safe_load(text)
    assert document == {"version": 1, "assets": [BASE, OBJECT]}
    assert list(document["assets"][1]) == list(OBJECT)
    assert "Zoë" in text
    assert "height: 0.073\n" in text


@given(st.permutations(range(6)))
def test_the_bytes_do_not_depend_on_the_order(order: list[int]) -> None:
    entries = [entry(id=f"freesound/{number}") for number in range(6)]
    whole = Lock(assets=tuple(entries))
    shuffled = Lock().merged(entries[number] for number in order)
    assert dump_lock(shuffled) == dump_lock(whole)
    assert parse_lock(dump_lock(whole), "x") == whole


@given(st.text(alphabet=st.characters(exclude_categories=["Cc", "Cs"]), min_size=1, max_size=40), st.floats(0.02, 4.9))
def test_any_text_and_number_comes_back(title: str, height: float) -> None:
    height = float(f"{height:.9g}")
    one = AssetEntry.model_validate(OBJECT | {"title": title, "height": height, "yaw": -90.0})
    assert parse_lock(dump_lock(Lock(assets=(one,))), "x").assets == (one,)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"licence_url": "x"}, "assets.0 (freesound/1234).licence_url: unknown field"),
        ({"sha256": "abc"}, "assets.0 (freesound/1234).sha256: "),
        (
            {"category": "Small dog"},
            "assets.0 (freesound/1234).category: category 'Small dog': expected lower-case letters",
        ),
        ({"id": "freesound/../../etc"}, "assets.0 (freesound/../../etc).id: "),
        ({"id": "freesound"}, ".id: "),
        ({"file": "../x.ogg"}, ".file: "),
        ({"bytes": 0}, ".bytes: "),
        ({"kind": "object"}, "an object needs up and front"),
        ({"height": 0.3}, "is given, but belongs to objects only"),
        ({"title": "two\nlines"}, ".title: "),
        ({"source": "napster"}, ".source: "),
    ],
)
def test_a_wrong_field_is_named(change: dict[str, object], words: str) -> None:
    data = yaml.safe_dump({"version": 1, "assets": [BASE | change]}).encode()
    with pytest.raises(Avs3dError) as caught:
        parse_lock(data, "my.lock.yaml")
    assert str(caught.value).startswith("my.lock.yaml: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [b"[1, 2]", b"version: 2", b"version: 1\nassets: [}", b"\xff\xfe", b"assets: [3]"])
def test_a_file_that_is_no_lock_is_refused(data: bytes) -> None:
    with pytest.raises(Avs3dError, match=r"^my\.lock\.yaml: [^\n]+$"):
        parse_lock(data, "my.lock.yaml")


def test_two_entries_of_one_id_are_refused() -> None:
    with pytest.raises(Avs3dError, match=r"freesound/1234 is listed twice"):
        parse_lock(yaml.safe_dump({"version": 1, "assets": [BASE, BASE]}).encode(), "x")


def _add(path: Path, worker: int, count: int) -> None:
    for number in range(count):
        update_lock(path, (entry(id=f"freesound/{worker}-{number}"),))


def test_processes_that_write_at_once_lose_nothing(tmp_path: Path) -> None:
    path = tmp_path / "assets.lock.yaml"
    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=_add, args=(path, number, 8)) for number in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert {one.id for one in read_lock(path).assets} == {f"freesound/{a}-{b}" for a in range(4) for b in range(8)}
    assert [file.name for file in tmp_path.iterdir()] == ["assets.lock.yaml"]


def test_an_update_that_changes_nothing_leaves_the_file_alone(tmp_path: Path) -> None:
    path = tmp_path / "assets.lock.yaml"
    update_lock(path, (entry(),))
    before = path.stat()
    update_lock(path, (entry(),))
    assert path.stat().st_ino == before.st_ino
    assert update_lock(path, (entry(author="someone else"),)).assets[0].author == "someone else"


# ---- licences -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("http://creativecommons.org/publicdomain/zero/1.0/", "CC0-1.0"),
        ("https://creativecommons.org/licenses/by/4.0/", "CC-BY-4.0"),
        ("http://creativecommons.org/licenses/by-nc/3.0/", "CC-BY-NC-3.0"),
        ("http://creativecommons.org/licenses/sampling+/1.0/", "CC-Sampling-Plus-1.0"),
        ("https://creativecommons.org/licenses/by-nc-sa/2.5/it/", "CC-BY-NC-SA-2.5"),
        ("CC0", "CC0-1.0"),
        ("CC-BY", "CC-BY"),
        ("CC BY-SA 4.0", "CC-BY-SA-4.0"),
        ("CC-BY-NC", "CC-BY-NC"),
        ("CC-Sampling+", "CC-Sampling-Plus-1.0"),
        ("Creative Commons Attribution 3.0 Unported license", "CC-BY-3.0"),
        ("Pixabay Content License", "LicenseRef-Pixabay"),
        ("Creative Commons Attribution-NonCommercial-ShareAlike 4.0", "CC-BY-NC-SA-4.0"),
        ("Creative Commons Attribution-NoDerivs 3.0", "CC-BY-ND-3.0"),
        ("Public Domain", "LicenseRef-PublicDomain"),
        ("Free Art License 1.3", "LAL-1.3"),
        ("mit", "MIT"),
        ("GPL-2.0-or-later", "GPL-2.0-or-later"),
        ("My own terms", "My own terms"),
    ],
)
def test_licences_have_one_spelling(text: str, name: str) -> None:
    assert spdx(text) == name
    assert spdx(name) == name


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("CC0-1.0", "free"),
        ("CC-BY-4.0", "free"),
        ("CC-BY-3.0-US", "free"),
        ("CC-BY", "free"),
        ("MIT", "free"),
        ("LicenseRef-PublicDomain", "free"),
        ("CC-BY-SA-4.0", "share-alike"),
        ("LAL-1.3", "share-alike"),
        ("GPL-2.0-or-later", "share-alike"),
        ("CC-BY-NC-4.0", "refused"),
        ("CC-BY-NC-SA-4.0", "refused"),
        ("CC-BY-ND-4.0", "refused"),
        ("CC-Sampling-Plus-1.0", "refused"),
        ("LicenseRef-RemArc", "refused"),
        (from_sketchfab("st", "Standard"), "refused"),
        (from_sketchfab("free-st", "Free Standard"), "refused"),
        (from_sketchfab("ed", "Editorial"), "refused"),
        (from_sketchfab("new", "Something New"), "refused"),
        (from_sketchfab("by-sa", ""), "share-alike"),
        ("unknown", "refused"),
        ("CC-BY-4.0 AND CC-BY-NC-4.0", "refused"),
        ("CC-BY-4.0 OR CC-BY-NC-4.0", "free"),
        ("CC-BY-NC-4.0extra", "refused"),
    ],
)
def test_what_a_licence_allows(name: str, verdict: str) -> None:
    assert terms(name).verdict == verdict


def test_a_licence_that_forbids_the_use_is_refused_unless_allowed_by_name() -> None:
    with pytest.raises(
        Avs3dError, match=r"^x/1: refused, its licence CC-BY-NC-4\.0 forbids commercial use; .*--allow-licence"
    ):
        check_licence("x/1", "CC-BY-NC-4.0", ("CC-BY-NC-3.0",))
    assert "allowed by name" in check_licence("x/1", "CC-BY-NC-4.0", ("cc by-nc 4.0",))
    assert check_licence("x/1", "CC-BY-4.0") == ""
    assert check_licence("x/1", "CC0") == ""
    assert conditions([("x/1", "CC0"), ("x/2", "CC BY 4.0")]) == ()
    assert "same terms" in check_licence("x/1", "CC-BY-SA-4.0")
    assets = [("d", "CC-BY-SA-4.0"), ("a", "CC0-1.0"), ("c", "CC-BY-NC-4.0"), ("b", "CC-BY-SA-4.0"), ("x", "unknown")]
    assert conditions([*assets, *assets]) == (
        "c: licence CC-BY-NC-4.0 forbids commercial use",
        "b and 1 more: licence CC-BY-SA-4.0 asks that what is made from it is shared under the same terms",
        "x: licence unknown is not known to allow adaptation and sharing",
    )


# ---- the store ------------------------------------------------------------------------------------------------------


def test_an_asset_opens_only_if_it_is_the_pinned_one(tmp_path: Path) -> None:
    store, lock = Store(tmp_path / "store"), tmp_path / "assets.lock.yaml"
    sha256, size = store.put("freesound/1234", "preview.ogg", wav())
    update_lock(lock, (entry(sha256=sha256, bytes=size),))
    path, found = open_asset(lock, "freesound/1234", store)
    assert path.read_bytes() == wav()
    assert found.author == "Zoë"

    with pytest.raises(UsageError, match=r"no asset 'freesound/1243'; did you mean 'freesound/1234'\?"):
        open_asset(lock, "freesound/1243", store)

    data = bytearray(wav())
    data[random.Random(0).randrange(100, len(data))] ^= 1
    path.write_bytes(data)
    with pytest.raises(
        Avs3dError, match=r"^freesound/1234: .* has the sha256 .*; run: avs3d assets fetch --lock .* --id"
    ):
        open_asset(lock, "freesound/1234", store)
    path.write_bytes(data[:-1])
    with pytest.raises(Avs3dError, match=rf"has {size - 1} bytes, the lock file says {size}"):
        open_asset(lock, "freesound/1234", store)
    path.unlink()
    with pytest.raises(Avs3dError, match=r"not in the store .*run: avs3d assets fetch"):
        open_asset(lock, "freesound/1234", store)


# ---- edited by hand -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("version: 1\nassets: []\nassets: []", "line 3: found the key 'assets', which is listed twice"),
        (
            "version: 1\nassets:\n- {id: a/b, licence: MIT, licence: CC0-1.0}",
            "assets.0, line 3: found the key 'licence'",
        ),
        ("[" * 100_000 + "]" * 100_000, "more than 20 levels"),
        ("- " * 5000 + "a", "more than 20 levels"),
        ("version: 1\nassets: !!set {a, b}", "assets, line 2: found the tag"),
        ("a: 2024-99-99", "unknown field"),
        (f"version: 1{'0' * 5000}", "version, line 1: found a number of 5,001 digits"),
        ('version: 1\nassets: [{"id": "a\\nb"}]', r"assets.0 ('a\nb').id: "),
        ("&a [*a]", "inside of what it stands for"),
        ("", "expected a mapping with version and assets, found None"),
    ],
    ids=["doubled table", "doubled field", "brackets", "dashes", "set", "date", "digits", "newline", "circle", "empty"],
)
def test_slips_of_the_hand_end_in_one_line(text: str, words: str) -> None:
    with pytest.raises(Avs3dError) as caught:
        parse_lock(text.encode(), "my.lock.yaml")
    assert words in str(caught.value)
    assert str(caught.value).startswith("my.lock.yaml: ")
    assert "\n" not in str(caught.value)


def test_where_folders_cannot_be_held_a_file_beside_the_lock_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = fcntl.flock

    def nfs(handle: int, how: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(errno.EBADF, "Bad file descriptor")
        real(handle, how)

    monkeypatch.setattr(fcntl, "flock", nfs)
    path = tmp_path / "assets.lock.yaml"
    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=_add, args=(path, number, 5)) for number in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(read_lock(path).assets) == 15


def test_names_in_any_letters_give_steps_that_differ() -> None:
    assert slug("Zoë's clock") == "Zoe-s-clock"
    assert slug("washing machine (2)") == "washing-machine-2"
    assert len({slug(name) for name in ("時計", "電話", "時計1", "電話1", "...", "\udcff")}) == 6
    assert all(entry(id=f"folder/{slug(name)}") for name in ("時計", "x" * 300, "-.-", "\udcff"))


@pytest.mark.parametrize(
    "text",
    [
        "Attribution required, no commercial use",
        "Free for personal use with attribution",
        "CC BY, educational use only",
        "CC-BY-4.0 with additional restrictions",
        "CC-BY-NCSA-4.0",
        "CC-BY NonCom",
        "not CC0",
        "All rights reserved (not public domain)",
        "CC0 AND CC-BY-NC-4.0",
        "see https://creativecommons.org/licenses/by/4.0/ and do not sell it",
        "CC BY-NC 4.0 (https://creativecommons.org/licenses/by/4.0/)",
        "Attribution–Non\u2011Commercial 4.0",
    ],
)
def test_a_condition_in_plain_words_is_never_taken_for_a_free_licence(text: str) -> None:
    assert terms(spdx(text)).verdict == "refused"
    with pytest.raises(Avs3dError, match="refused, its licence"):
        check_licence("x/1", spdx(text))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("CC BY 4.0 (https://creativecommons.org/licenses/by/4.0/)", "CC-BY-4.0"),
        ("Creative Commons Attribution 4.0 International Public License", "CC-BY-4.0"),
        ("CC0 1.0 Universal (CC0 1.0) Public Domain Dedication", "CC0-1.0"),
        ("cc_by_sa_4.0", "CC-BY-SA-4.0"),
        ("CC BY 4.0 OR MIT", "CC-BY-4.0 OR MIT"),
        ("creativecommons.org/licenses/by/3.0/deed.de", "CC-BY-3.0"),
    ],
)
def test_more_spellings_of_licences(text: str, name: str) -> None:
    assert spdx(text) == name
