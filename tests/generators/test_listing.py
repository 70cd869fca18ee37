"""The listing: its contents for each asset, no network requests, and no code from the assets' texts."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import soundfile
from PIL import Image

from avs3d_bench.errors import Avs3dError
from generators.assets.meshfile import load_mesh
from generators.library.archive import bundle
from generators.library.listing import write_listing
from generators.library.lock import AssetEntry
from generators.library.store import Store
from generators.library.thumbnails import render_views, thumbnail
from tests.support.browser import launch, visit

OBJ = "mtllib a.mtl\n" + "".join(
    f"v {x} {y} {z}\n" for x in (-20, 20) for y in (0, 60) for z in (-15, 15)
) + "usemtl side\nf 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nusemtl front\nf 2 6 8 4\n"  # fmt: skip
MTL = "newmtl side\nKd 0.8 0.8 0.8\nnewmtl front\nKd 0.9 0 0\n"


def box(store: Store, **changes: object) -> AssetEntry:
    sha256, size = store.put("folder/box", "model.zip", bundle({"a.obj": OBJ.encode(), "a.mtl": MTL.encode()}))
    fields: dict[str, object] = {
        "id": "folder/box", "kind": "object", "category": "washing_machine", "source": "folder", "ref": "box",
        "url": "https://example.org/box", "title": "Box", "author": "Ann", "licence": "CC0-1.0", "file": "model.zip",
        "sha256": sha256, "bytes": size, "up": "y", "front": "+z", "height": 0.6,
    }  # fmt: skip
    return AssetEntry.model_validate(fields | changes)


def tone(store: Store, **changes: object) -> AssetEntry:
    buffer = io.BytesIO()
    samples = np.sin(np.arange(22050) / 20) * np.linspace(0, 0.5, 22050)
    soundfile.write(buffer, samples, 22050, format="WAV")
    sha256, size = store.put("folder/tone", "tone.wav", buffer.getvalue())
    fields: dict[str, object] = {
        "id": "folder/tone", "kind": "sound", "category": "clock", "source": "folder", "ref": "tone",
        "title": "Tone", "author": "Bob", "licence": "CC-BY-SA-4.0", "file": "tone.wav",
        "sha256": sha256, "bytes": size,
    }  # fmt: skip
    return AssetEntry.model_validate(fields | changes)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return Store(tmp_path_factory.mktemp("store"))


@pytest.mark.slow
def test_a_page_shows_objects_and_sounds(store: Store, tmp_path: Path) -> None:
    page = write_listing([tone(store), box(store)], store, tmp_path / "out")
    html = page.read_text()
    assert page == tmp_path / "out" / "index.html"
    for text in (
        "folder/box", "by Ann", "CC0-1.0", 'href="https://example.org/box"', "0.40 × 0.60 × 0.30 m", "12 faces",
        "its unit was centimetres", "data:image/png;base64,", "folder/tone", "CC-BY-SA-4.0", "1.0 s",
        "asks that what is made from it is shared under the same terms", '<section id="clock">',
    ):  # fmt: skip
        assert text in html, text
    (sound,) = (tmp_path / "out" / "sounds").iterdir()
    assert f'src="sounds/{sound.name}"' in html
    assert sound.read_bytes() == store.path(tone(store)).read_bytes()
    heights = [float(bar.split("V")[1]) for bar in html.split('<path d="M')[1].split('"')[0].split("M")]
    assert heights == sorted(heights)  # the tone swells
    assert heights[-1] == 1


def test_the_same_assets_give_the_same_page(store: Store, tmp_path: Path) -> None:
    entries = [box(store), tone(store)]
    first = write_listing(entries, store, tmp_path / "one").read_bytes()
    assert write_listing(entries[::-1], store, tmp_path / "two").read_bytes() == first
    assert write_listing(entries, store, tmp_path / "one").read_bytes() == first


def test_missing_and_broken_assets_get_a_card_that_says_so(store: Store, tmp_path: Path) -> None:
    missing = box(store, id="folder/gone", category="toilet")
    sha256, size = store.put("folder/bad", "model.zip", bundle({"a.obj": b"v 0 0 0\n"}))
    bad = box(store, id="folder/bad", category="oven", sha256=sha256, bytes=size)
    html = write_listing([missing, bad, box(store)], store, tmp_path / "out").read_text()
    assert "not in the store" in html
    assert "has no faces" in html
    assert "2 cannot be shown" in html
    assert html.count("data:image/png") == 1


def test_what_others_write_stays_text(store: Store, tmp_path: Path) -> None:
    hostile = box(store, title="<script>alert(1)</script>", author='"><img src=x>', url="javascript:alert(1)")
    html = write_listing([hostile], store, tmp_path / "out").read_text()
    assert "<script" not in html
    assert "<img src=x" not in html
    assert "javascript:" not in html


def test_an_empty_lock_gives_a_page_and_a_file_in_the_way_is_refused(store: Store, tmp_path: Path) -> None:
    assert "has no assets" in write_listing([], store, tmp_path / "out").read_text()
    (tmp_path / "file").write_text("x")
    with pytest.raises(Avs3dError, match="is a file; expected a folder"):
        write_listing([], store, tmp_path / "file")


@pytest.mark.slow
def test_a_thumbnail_shows_the_front_in_its_colour(store: Store) -> None:
    mesh_file = store.mesh(box(store))
    picture = thumbnail(mesh_file)
    assert thumbnail(mesh_file) == picture
    pixels = np.asarray(Image.open(io.BytesIO(picture)))
    assert pixels.shape == (256, 256, 3)
    red = (pixels[..., 0] > 90) & (pixels[..., 1] < 60)
    assert 0.1 < red.mean() < 0.5
    front, back, left = render_views(load_mesh(mesh_file), [(0, 10), (180, 10), (-90, 10)], 64)
    amount = [int(((view[..., 0] > 90) & (view[..., 1] < 60)).sum()) for view in (front, back, left)]
    assert amount[0] > 400
    assert amount[1] == amount[2] == 0
    # The object fills most of the picture and touches no edge.
    rows = np.flatnonzero(red.any(axis=1))
    assert 10 < rows.min() < rows.max() < 246


@pytest.mark.slow
def test_the_page_is_quiet_in_a_browser_on_a_phone_and_in_the_dark(store: Store, tmp_path: Path) -> None:
    page = write_listing([box(store), tone(store)], store, tmp_path / "out")
    with launch() as browser:
        backgrounds = []
        for width, dark in ((1280, False), (360, True)):
            with visit(browser, page, width=width, dark=dark) as seen:
                assert seen.overflow == 0
                assert seen.page.locator("article").count() == 2
                assert seen.page.evaluate("[...document.images].every(image => image.naturalWidth === 256)")
                backgrounds.append(seen.page.evaluate("getComputedStyle(document.body).backgroundColor"))
                # (The page's policy forbids the polling that Playwright's wait_for_function does.)
                loaded = """new Promise((done, failed) => {
                    const audio = document.querySelector('audio');
                    audio.onloadedmetadata = () => done(audio.duration);
                    audio.onerror = () => failed(audio.error.message);
                    audio.preload = 'metadata';
                    audio.load();
                })"""
                assert seen.page.evaluate(loaded) == pytest.approx(1, abs=0.01)
                assert seen.said == []
                assert [one for one in seen.asked if not one.startswith(page.parent.as_uri())] == []
        assert backgrounds[0] != backgrounds[1]
