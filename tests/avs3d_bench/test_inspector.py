"""`avs3d view`: pages agree with the data, picture and sound are synchronous, the server shares only the site."""

from __future__ import annotations

import hashlib
import http.client
import io
import json
import math
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import soundfile
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.inspector import pictures, sound
from avs3d_bench.inspector.build import Built, build_site
from avs3d_bench.inspector.cli import view
from avs3d_bench.inspector.facts import read_facts
from avs3d_bench.inspector.server import ViewServer
from avs3d_bench.inspector.site import ObservationSite
from avs3d_bench.inspector.submissions import ShownSubmission, open_submissions
from avs3d_bench.submission import SubmissionWriter
from tests.support import tiny
from tests.support.browser import launch, visit
from tests.support.viewing import served

KEY = tiny.SINGLE
#: Frame k of `toned` sounds at this frequency, Hz.
TONES = [400 + 160 * k for k in range(tiny.FRAMES)]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Our two tiny observations; every clip is a tone of its own, so that what is heard tells the frame."""
    folder = tiny.write_dataset(tmp_path_factory.mktemp("view") / "tiny")
    seconds = np.arange(layout.SAMPLE_RATE) / layout.SAMPLE_RATE
    for key in (tiny.SINGLE, tiny.MULTI):
        for k, tone in enumerate(TONES):
            clip = 0.05 * np.sin(2 * np.pi * tone * seconds)
            (folder / key / layout.audio_path(layout.BINAURAL, k)).unlink()
            media.write_wav(folder / key / layout.audio_path(layout.BINAURAL, k), np.stack([clip, 0.5 * clip]))
    return folder


@pytest.fixture(scope="module")
def submissions(root: Path) -> tuple[ShownSubmission, ...]:
    """One that marks the left half of every test frame, and one that is right."""
    dataset = Dataset(root)
    masks: dict[str, Callable[[Any], Any]] = {"left half": lambda truth: np.arange(64)[None] + 0 * truth < 32,
                                              "right": lambda truth: truth}  # fmt: skip
    folders = []
    for name, predict in masks.items():
        folder = root.parent / name.replace(" ", "-")
        with SubmissionWriter(folder, dataset, method=name) as writer:
            for observation in writer.observations:
                for frame in observation.test:
                    writer.write_mask(frame, predict(frame.mask()))
        folders.append(folder)
    return open_submissions(dataset, folders)


@pytest.fixture(scope="module")
def site(root: Path, submissions: tuple[ShownSubmission, ...]) -> Path:
    dataset = Dataset(root)
    return build_site(dataset, dataset.keys, submissions, root.parent / "site", workers=1).folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launch() as found:
        yield found


def tree(folder: Path) -> dict[str, str]:
    """sha256 of every file."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def data_of(page: bytes) -> Any:
    """What the scripts of an observation's page are given."""
    match = re.search(r'id="data">(.*?)</script>', page.decode(), re.DOTALL)
    assert match
    return json.loads(match.group(1))


# ---- sound -----------------------------------------------------------------------------------------------------


def test_clips_meet_without_a_step_and_are_untouched_elsewhere() -> None:
    fade = round(sound.FADE_SECONDS * layout.SAMPLE_RATE)
    low, high = (np.full((2, layout.SAMPLE_RATE), value, dtype=np.float32) for value in (-0.5, 0.5))
    joined = sound.joined([low, high])
    steps = np.diff(joined[0])
    assert np.all(steps >= 0)
    assert steps.max() < 1.0 * np.pi / 2 / fade * 1.01  # the steepest slope of a raised cosine over the fade
    np.testing.assert_array_equal(joined[:, : layout.SAMPLE_RATE], low)
    np.testing.assert_array_equal(joined[:, layout.SAMPLE_RATE + fade :], high[:, fade:])


def test_the_track_is_the_clips_rounded_to_sixteen_bits_and_raised_by_whole_bits(root: Path) -> None:
    observation = Observation(root, KEY)
    track = sound.read_track(observation)
    samples, rate = soundfile.read(io.BytesIO(track.data), dtype="float64", always_2d=True)
    assert (rate, len(samples), track.bits) == (layout.SAMPLE_RATE, tiny.FRAMES * layout.SAMPLE_RATE, 16)
    assert track.gain == pytest.approx(24.08, abs=0.01)  # 0.05 could be raised by four bits
    fade = round(sound.FADE_SECONDS * rate)
    for index, frame in enumerate(observation.frames):
        heard = samples[index * rate + fade : (index + 1) * rate].T / 2**4
        np.testing.assert_allclose(heard, frame.audio()[:, fade:], atol=0.501 / 2**15)


@given(st.floats(1e-6, 1.0))
def test_raising_never_clips(peak: float) -> None:
    shift = sound.shift_for(peak)
    assert 0 <= shift <= sound.MAX_SHIFT
    assert peak * 2**shift <= 1.0 or shift == 0
    assert shift == sound.MAX_SHIFT or peak * 2 ** (shift + 1) > 1.0


def test_noise_is_rounded_further_until_the_track_is_small_enough(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tiny.clone(root, tmp_path / "noise")
    noise = np.random.default_rng(1)
    for index in range(tiny.FRAMES):
        path = copy / KEY / layout.audio_path(layout.BINAURAL, index)
        path.unlink()
        media.write_wav(path, noise.uniform(-0.9, 0.9, (2, layout.SAMPLE_RATE)))
    monkeypatch.setattr(sound, "MOST_BYTES", 1_600_000)
    track = sound.read_track(Observation(copy, KEY))
    assert (track.bits, track.gain) == (14, 0.0)
    assert len(track.data) <= 1_600_000


# ---- pictures --------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=19)))
def test_a_mask_comes_back_as_the_alpha_of_its_png(mask: Any) -> None:
    pixels = cv2.imdecode(np.frombuffer(pictures.mask_png(mask), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(pixels[..., 3] == 255, mask)
    assert set(np.unique(pixels[..., 3])) <= {0, 255}


def test_instances_have_their_colours_and_the_scan_has_none() -> None:
    ids = np.array([[0, 1, 300], [7, 1, 0]], dtype=np.uint16)
    colours = pictures.instance_colours([1, 300], sounding=300)
    data = pictures.instances_png(ids, colours)
    pixels = cv2.cvtColor(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)
    assert tuple(pixels[0, 1]) == (*pictures.INSTANCE_COLOURS[0], 255)
    assert tuple(pixels[0, 2]) == (*pictures.SOUNDING, 255)
    assert pixels[0, 0, 3] == pixels[1, 0, 3] == 0  # the scan, and an id that no record knows


def test_a_thumbnail_is_small_whatever_the_picture() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (1008, 1008, 3), dtype=np.uint8)
    fine = cv2.resize(noise, (384, 384), interpolation=cv2.INTER_NEAREST)
    assert len(pictures.thumbnail(fine)) <= pictures.THUMB_BYTES


def test_the_outline_encloses_the_mask() -> None:
    rows, columns = np.mgrid[:200, :200]
    ring = (np.hypot(rows - 90, columns - 110) < 60) & (np.hypot(rows - 90, columns - 110) > 25)
    path = pictures.outline_path(ring)
    contours = [np.array([p.split(",") for p in piece.split("L")], float) for piece in re.findall(r"M([^Z]+)Z", path)]
    drawn = np.zeros((1000, 1000), np.uint8)
    cv2.fillPoly(drawn, [np.rint(contour).astype(np.int32) for contour in contours], 1)
    truth = cv2.resize(ring.astype(np.uint8), (1000, 1000), interpolation=cv2.INTER_NEAREST)
    assert len(contours) == 2  # the hole is one
    assert (drawn & truth).sum() / (drawn | truth).sum() > 0.94


# ---- facts -----------------------------------------------------------------------------------------------------


def test_the_release_tells_less_and_what_is_measured_there_is_what_we_recorded(tmp_path: Path) -> None:
    ours, release = Dataset(tiny.write_dataset(tmp_path / "ours")), Dataset(tiny.write_release(tmp_path / "release"))
    known, found = (read_facts(dataset, dataset[KEY]) for dataset in (ours, release))
    assert not known.missing
    assert (found.category, found.t30, found.instances, found.licences) == (None, None, (), ())
    assert len([line for line in found.missing if "observation.json" in line or "instance_masks" in line]) == 2
    for ours_at, theirs_at in zip(known.moments, found.moments, strict=True):
        assert theirs_at.azimuth is None
        assert ours_at.visible == theirs_at.visible
        assert ours_at.ild == pytest.approx(theirs_at.ild, abs=0.02)  # 16 bits there
        assert ours_at.level == pytest.approx(theirs_at.level, abs=0.02)
        np.testing.assert_allclose(ours_at.heading, theirs_at.heading, atol=1e-6)
        np.testing.assert_allclose(ours_at.position, theirs_at.position, atol=1e-6)


def test_licences_are_those_of_the_instances_the_sound_and_the_scan(root: Path) -> None:
    dataset = Dataset(root)
    assert {entry.asset for entry in read_facts(dataset, dataset[KEY]).licences} == {"box", "noise"}


# ---- the site on disk ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_site_has_the_same_bytes_for_any_number_of_workers_and_leaves_the_dataset_alone(
    root: Path, submissions: tuple[ShownSubmission, ...], site: Path, tmp_path: Path
) -> None:
    before, dataset = tree(root), Dataset(root)
    built = build_site(dataset, dataset.keys, submissions, tmp_path / "again", workers=2)
    assert tree(tmp_path / "again") == tree(site)
    assert tree(root) == before
    assert built == Built(tmp_path / "again", 2, sum(p.stat().st_size for p in site.rglob("*") if p.is_file()), ())


def test_no_page_tells_where_it_was_made(site: Path, root: Path) -> None:
    for page in site.rglob("*.html"):
        assert str(root.parent).encode() not in page.read_bytes()


def test_an_older_site_is_replaced_and_nothing_else_is(root: Path, tmp_path: Path) -> None:
    dataset = Dataset(root)
    target = build_site(dataset, dataset.keys, (), tmp_path / "site", workers=1).folder
    build_site(dataset, [tiny.SINGLE], (), target, workers=1)
    assert not (target / tiny.MULTI).exists()
    (target / "thesis.tex").write_text("mine")
    with pytest.raises(UsageError, match=r"thesis\.tex is no part of it"):
        build_site(dataset, [tiny.SINGLE], (), target, workers=1)
    for folder, why in ((root / "site", "inside of"), (root.parent, "around"), (root / tiny.SINGLE, "inside of")):
        with pytest.raises(UsageError, match=why):
            build_site(dataset, dataset.keys, (), folder, workers=1)


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(view, [str(a) for a in arguments], catch_exceptions=True)
    if isinstance(result.exception, Avs3dError):
        return result.exception.exit_code, "", str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


def test_what_cannot_be_read_is_one_line_each_and_the_rest_is_shown(root: Path, tmp_path: Path) -> None:
    copy = tiny.clone(root, tmp_path / "copy")
    tiny.replace(copy / tiny.SINGLE / "observation.json", b'{"key": ')
    tiny.replace(copy / tiny.MULTI / "input/frame_003.png", b"\x89PNG\r\n\x1a\n")
    tiny.replace(copy / tiny.MULTI / "audio_clips_binaural/frame_5.wav", b"RIFF")
    status, _, errors = run(copy, "-o", tmp_path / "site", "--workers", 1)
    assert status == 1
    lines = errors.splitlines()
    assert [Path(line.split(": ")[0]).name for line in lines] == ["1", "frame_5.wav", "frame_003.png"]
    gallery = (tmp_path / "site/index.html").read_text()
    assert "Cannot be shown" in gallery
    assert f"{tiny.MULTI}/index.html" in gallery
    # No thumbnail of it; the page that it leads to says what is wrong.
    assert f"{tiny.SINGLE}/thumbnail.webp" not in gallery
    assert "observation.json" in (tmp_path / "site" / tiny.SINGLE / "index.html").read_text()
    page = (tmp_path / "site" / tiny.MULTI / "index.html").read_text()
    assert "input/frame_003.png" in page
    assert "audio_clips_binaural/frame_5.wav" in page
    assert str(tmp_path) not in page


def test_a_damaged_file_that_no_card_shows_does_not_keep_the_others_from_the_site(root: Path, tmp_path: Path) -> None:
    copy = tiny.clone(root, tmp_path / "copy")
    tiny.replace(copy / tiny.SINGLE / "camera_splits.json", b"[]")
    status, _, errors = run(copy, "-o", tmp_path / "site", "--workers", 1)
    assert status == 1
    assert "camera_splits.json: no list of frame names" in errors
    assert (tmp_path / "site" / tiny.MULTI / "index.html").is_file()


@pytest.mark.parametrize("channels", [(1, layout.SAMPLE_RATE), (2, 0), (4, layout.SAMPLE_RATE)])
def test_a_clip_of_another_shape_is_named_once_and_the_rest_of_the_release_is_shown(
    channels: tuple[int, int], tmp_path: Path
) -> None:
    release = tiny.write_release(tmp_path / "release")
    clip = release / KEY / layout.audio_path(layout.BINAURAL, 3)
    clip.unlink()
    soundfile.write(clip, np.full(channels, 0.1).T, layout.SAMPLE_RATE)
    status, _, errors = run(release, "-o", tmp_path / "site", "--workers", 1, "--only", KEY)
    assert (status, len(errors.splitlines())) == (1, 1)
    assert errors.startswith(f"{clip}: {channels[0]} channel(s) of {channels[1]} samples")
    page = (tmp_path / "site" / KEY / "index.html").read_bytes()
    assert page.count(f"{layout.audio_path(layout.BINAURAL, 3)}: {channels[0]} channel(s)".encode()) == 1
    assert "ild" in data_of(page)["frames"][2]
    assert "ild" not in data_of(page)["frames"][3]


def test_a_damaged_sparse_model_of_the_release_is_said_on_the_terminal_too(tmp_path: Path) -> None:
    release = tiny.write_release(tmp_path / "release")
    tiny.replace(release / KEY / "sparse/0/cameras.bin", b"")
    status, _, errors = run(release, "-o", tmp_path / "site", "--workers", 1, "--only", KEY)
    assert status == 1
    assert re.fullmatch(r".*/sparse/0/cameras\.bin: truncated.*\n", errors)
    assert b"sparse/0/cameras.bin: truncated" in (tmp_path / "site" / KEY / "index.html").read_bytes()


def test_the_release_s_camera_is_that_of_its_sparse_model(root: Path, tmp_path: Path) -> None:
    dataset = Dataset(tiny.write_release(tmp_path / "release"))
    observation = dataset[KEY]
    expected = 2 * math.degrees(math.atan(observation.intrinsics.width / 2 / observation.intrinsics.fx))
    assert read_facts(dataset, observation).hfov == pytest.approx(expected)
    narrow = dataset[KEY]
    narrow.intrinsics = replace(narrow.intrinsics, fx=narrow.intrinsics.width)
    assert read_facts(dataset, narrow).hfov == pytest.approx(53.13, abs=0.01)


@pytest.mark.parametrize(
    ("spoil", "arguments", "status", "line"),
    [
        (lambda root: None, ["--only", "part_9/*"], 2, "no observation matches part_9/*"),
        (lambda root: None, ["--submission", "nowhere"], 2, "nowhere: no such folder"),
        (lambda root: tiny.replace(root / "dataset.json", b"{}"), [], 1, "dataset.json: schema_version|name: Field"),
        (lambda root: [tiny.replace(root / key / "observation.json", b"") for key in (tiny.SINGLE, tiny.MULTI)], [],
         1, "nothing to show"),
    ],
)  # fmt: skip
def test_what_cannot_be_shown_at_all_is_one_line(
    root: Path, tmp_path: Path, spoil: Callable[[Path], Any], arguments: list[str], status: int, line: str
) -> None:
    copy = tiny.clone(root, tmp_path / "copy")
    spoil(copy)
    found, _, error = run(copy, "-o", tmp_path / "site", "--workers", 1, *arguments)
    assert found == status
    assert re.search(line.replace("*", r"\*"), error)
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "site").exists()


def test_many_unreadable_files_of_an_observation_are_counted(root: Path, tmp_path: Path) -> None:
    copy = tiny.clone(root, tmp_path / "copy")
    for mask in (copy / KEY / layout.SEMANTIC_MASKS).iterdir():
        tiny.replace(mask, b"")
    status, _, errors = run(copy, "-o", tmp_path / "site", "--workers", 1, "--only", KEY)
    lines = errors.splitlines()
    assert (status, len(lines)) == (1, 6)
    assert lines[-1] == f"{copy / KEY}: 5 more files cannot be shown"


def test_text_of_the_data_is_text_on_the_page(root: Path, tmp_path: Path) -> None:
    copy = tiny.clone(root, tmp_path / "copy")
    nasty = '</script><img src=x onerror="alert(1)">'

    def spoil(record: dict[str, Any]) -> None:
        record["notes"] = [nasty]
        for thing in (*record["instances"], record["sound"]):
            thing["asset"] = nasty
            thing["licence"].update(name=nasty, author=nasty, source=nasty)

    tiny.edit_record(copy, KEY, spoil, rehash=False)
    dataset = Dataset(copy)
    folder = tmp_path / nasty.split("/")[0].replace("<", "s")
    with SubmissionWriter(folder, dataset, method=nasty) as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    built = build_site(dataset, [KEY], open_submissions(dataset, [folder]), tmp_path / "site", workers=1)
    page = (built.folder / KEY / "index.html").read_bytes()
    assert b"<img src=x" not in page
    assert data_of(page)["submissions"][0]["name"] == nasty


def test_the_page_knows_how_submissions_agree_with_the_truth(site: Path, root: Path) -> None:
    data = data_of((site / KEY / "index.html").read_bytes())
    left, right = data["submissions"]
    assert left["frames"] == right["frames"] == ["frame_000", "frame_008"]
    frame = Observation(root, KEY).test[0]
    truth, half = frame.mask(), np.arange(64)[None] < 32
    assert right["iou"]["frame_000"] == 1.0
    assert left["iou"]["frame_000"] == pytest.approx((truth & half).sum() / (truth | half).sum(), abs=1e-4)


def test_a_moving_source_has_its_own_way_on_the_map(root: Path, tmp_path: Path) -> None:
    copy = tiny.clone(root, tmp_path / "copy")

    def move(record: dict[str, Any]) -> None:
        record["source_motion"] = "path"
        for index, frame in enumerate(record["frames"]):
            frame["source_position"] = [0.1 * index, 1.2, -2.2]
            frame["instance_position"], frame["instance_rotation"] = [0.1 * index, 1.0, -2.4], [1, 0, 0, 0]

    tiny.edit_record(copy, KEY, move, rehash=False)
    built = build_site(Dataset(copy), [KEY], (), tmp_path / "site", workers=1)
    data = data_of((built.folder / KEY / "index.html").read_bytes())
    assert data["moves"] is True
    assert [frame["source"] for frame in data["frames"]] == [[pytest.approx(0.1 * i), -2.2] for i in range(10)]


# ---- the server ------------------------------------------------------------------------------------------------


def ask(server: ViewServer, path: str, *, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], bytes]:
    """A request as written: nothing is normalised."""
    host, port = server.server.server_address[:2]
    connection = http.client.HTTPConnection(str(host), int(port), timeout=10)
    try:
        connection.putrequest(method, path, skip_host=True)
        for name, value in ({"Host": f"127.0.0.1:{port}"} | headers).items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def suppressed(call: Callable[..., Any]) -> Callable[..., None]:
    """The call, whose connection may be cut."""

    def quiet(*arguments: Any) -> None:
        with suppress(OSError, http.client.HTTPException):
            call(*arguments)

    return quiet


def test_the_server_makes_the_files_of_the_site_on_disk_and_writes_nothing(
    root: Path, submissions: tuple[ShownSubmission, ...], site: Path
) -> None:
    before = tree(root)
    with served(root, submissions) as server:
        for name in sorted(tree(site)):
            if name == "avs3d-view.json" or name.endswith("1/index.html"):
                continue
            status, headers, body = ask(server, f"/{name}")
            assert (status, body) == (200, (site / name).read_bytes()), name
            assert int(headers["Content-Length"]) == len(body)
        status, _, page = ask(server, f"/{KEY}/")
        there, here = data_of(page), data_of((site / KEY / "index.html").read_bytes())
        assert there.pop("has")["full"] is True
        here.pop("has")
        assert there == here
        # What a site on disk leaves out: the dataset's own pictures.
        assert ask(server, f"/{KEY}/full/frame_002.png")[2] == (root / KEY / "input/frame_002.png").read_bytes()
        assert ask(server, f"/{KEY}/sound.flac", method="HEAD")[2] == b""
    assert tree(root) == before


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil.example:{port}", ""]
)
def test_a_request_under_another_name_is_refused(root: Path, host: str) -> None:
    with served(root) as server:
        port = server.server.server_address[1]
        status, _, body = ask(server, "/index.html", Host=host.format(port=port))
        assert status == 403
        assert b"observation" not in body
        assert ask(server, "/index.html", Host=f"localhost:{port}")[0] == 200
        assert server.server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "path",
    [
        "/../dataset.json", "/dataset.json", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/assets/../../cli.py",
        "/assets/gallery.html.j2", f"/{KEY}/observation.json", f"/{KEY}/../1/observation.json", f"/{KEY}/full/../x.png",
        f"/{KEY}/full/..%2fobservation.png", f"/{KEY}/frames/frame_000.png", f"/{KEY}/frames/frame_999.webp",
        f"/{KEY}/predictions/1/frame_000.png", f"/{KEY}", "/part_1/nobody/kitchen/1/index.html", "/\x00",
    ],
)  # fmt: skip
def test_no_address_leads_out_of_the_site(root: Path, path: str) -> None:
    with served(root) as server:
        try:
            status, _, body = ask(server, path.replace("\x00", "%00"))
        except http.client.RemoteDisconnected:  # pragma: no cover
            pytest.fail("the server gave no answer")
        assert status == 404
        assert b"root:" not in body
        assert str(root).encode() not in body


def test_parts_of_the_sound_can_be_asked_for(root: Path) -> None:
    with served(root) as server:
        path = f"/{KEY}/sound.flac"
        whole = ask(server, path)[2]
        size = len(whole)
        for asked, first, last in (("0-99", 0, 99), ("100-", 100, size - 1), ("-50", size - 50, size - 1),
                                   (f"{size - 1}-{size + 5}", size - 1, size - 1)):  # fmt: skip
            status, headers, body = ask(server, path, Range=f"bytes={asked}")
            assert (status, body) == (206, whole[first : last + 1])
            assert headers["Content-Range"] == f"bytes {first}-{last}/{size}"
        for asked in (f"{size}-", "-0", "9-3"):
            status, headers, _ = ask(server, path, Range=f"bytes={asked}")
            assert (status, headers["Content-Range"]) == (416, f"bytes */{size}")
        for ignored in ("items=0-5", "bytes=0-1,4-5", "bytes=-"):
            assert ask(server, path, Range=ignored)[0::2] == (200, whole)


def test_the_server_only_answers_questions_and_forbids_what_pages_do_not_need(root: Path) -> None:
    with served(root) as server:
        assert ask(server, "/index.html", method="POST")[0] == 405
        headers = ask(server, "/")[1]
        assert "default-src 'self'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"


def test_a_request_that_is_none_is_answered_without_a_word_on_the_terminal(
    root: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with served(root) as server:
        assert ask(server, "http://[/")[0] == 400
        assert ask(server, "/index.html", Range=f"bytes={'9' * 5000}-")[0] == 200
        time.sleep(0.05)
    assert capfd.readouterr() == ("", "")


def test_the_server_ends_after_answers_in_the_making_and_waits_for_no_idle_browser(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, done = threading.Event(), threading.Event()

    def slow(self: ObservationSite, name: str) -> bytes:
        begun.set()
        time.sleep(0.4)
        done.set()
        return b""

    monkeypatch.setattr(ObservationSite, "make", slow)
    with served(root) as server:
        idle = http.client.HTTPConnection("127.0.0.1", int(server.server.server_address[1]), timeout=10)
        idle.request("GET", "/assets/style.css")
        idle.getresponse().read()
        threading.Thread(target=suppressed(ask), args=[server, f"/{KEY}/frames/frame_000.webp"]).start()
        assert begun.wait(5)
        start = time.monotonic()
    assert done.is_set()
    assert time.monotonic() - start < 5
    idle.close()


def test_a_browser_that_does_not_return_is_answered(root: Path, tmp_path: Path) -> None:
    """As those of a terminal do, and a first start of any other."""
    import signal
    import subprocess
    import sys

    script, got = tmp_path / "browser.py", tmp_path / "got"
    script.write_text(
        "import sys\nfrom urllib.request import ProxyHandler, build_opener\n"
        "page = build_opener(ProxyHandler({})).open(sys.argv[1], timeout=15).read()\n"
        f"open({str(got)!r}, 'wb').write(page)\n"
    )
    command = "from avs3d_bench.inspector.cli import view; view()"
    process = subprocess.Popen(
        [sys.executable, "-c", command, str(root), "--port", "0"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env={**os.environ, "BROWSER": f"{sys.executable} {script} %s"},
    )  # fmt: skip
    try:
        end = time.monotonic() + 20
        while not (got.exists() and b"2 of 2" in got.read_bytes()):
            assert time.monotonic() < end
            time.sleep(0.05)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=20)


def test_a_port_that_is_taken_is_one_line(root: Path) -> None:
    with served(root) as server:
        second = ViewServer(Dataset(root), [KEY], port=server.server.server_address[1])
        with pytest.raises(UsageError, match="choose another --port"):
            second.__enter__()


# ---- in a browser ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def many(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gallery of 34 observations of seven homes."""
    folder = tmp_path_factory.mktemp("many")
    rooms = ("bathroom", "kitchen", "living_room")
    keys = [f"part_1/home_{i // 4}/{rooms[i % 3]}/{1 + i}" for i in range(25)]
    keys += [f"part_2/home_{i}/{rooms[i % 3]}/1" for i in range(9)]
    for key in keys:
        source = root / (tiny.SINGLE if key.startswith("part_1") else tiny.MULTI)
        tiny.clone(source, folder / "data" / key)
        for audio in (folder / "data" / key / layout.BINAURAL).iterdir():
            audio.unlink()
        place = layout.parse_key(key)
        tiny.edit_record(
            folder / "data", key, rehash=False,
            change=lambda r, k=key, p=place: r.update(key=k, part=p.part, scan=p.scan, room=p.room, index=p.index),
        )  # fmt: skip
    dataset = Dataset(folder / "data")
    assert len(dataset) == 34
    return build_site(dataset, dataset.keys, (), folder / "site", workers=1).folder


def shown(page: Any) -> list[str]:
    return page.eval_on_selector_all("#gallery > li:not([hidden]) a", "all => all.map(a => a.getAttribute('href'))")


@pytest.mark.slow
def test_the_gallery_loads_thumbnails_and_no_frames(many: Path, browser: Any) -> None:
    with visit(browser, many / "index.html", width=1280) as opened:
        opened.page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
        until(opened.page, "[...document.images].every(i => i.complete && i.naturalWidth)")
        assert len(shown(opened.page)) == 34
        assert {Path(address).name for address in opened.asked} <= {
            "thumbnail.webp", "style.css", "tables.css", "theme.js", "tables.js", "gallery.js"
        }  # fmt: skip
        assert sum(address.endswith("thumbnail.webp") for address in opened.asked) == 34
        assert not opened.said


@pytest.mark.slow
def test_filters_narrow_the_gallery_and_live_in_the_address(many: Path, browser: Any) -> None:
    with visit(browser, many / "index.html") as opened:
        page = opened.page
        page.check("input[value=part_2]", force=True)
        assert len(shown(page)) == 9
        assert page.evaluate("location.hash") == "#part=part_2"
        counts = page.eval_on_selector_all("[data-facet=room] small", "all => all.map(e => Number(e.textContent))")
        assert counts == [3, 3, 3]
        page.check("input[value=kitchen]", force=True)
        page.check("input[value=bathroom]", force=True)
        assert len(shown(page)) == 6
        page.fill("input[type=search]", "HOME_4")
        assert shown(page) == ["part_2/home_4/kitchen/1/index.html"]
        assert page.evaluate("location.hash") == "#part=part_2&room=bathroom,kitchen&q=HOME_4"
        assert page.text_content("#count") == "1 of 34"
        page.fill("input[type=search]", "nowhere")
        assert page.is_visible("#none")
        page.click("[data-clear]")
        assert len(shown(page)) == 34
        page.go_back()
        assert page.is_visible("#none")
        page.evaluate("location.hash = 'part=part_1&room=living_room'")
        until(page, "document.querySelector('#count').textContent === '8 of 34'")
        page.evaluate("document.querySelector('.skip').click()")
        page.wait_for_timeout(100)
        assert len(shown(page)) == 8
        assert page.is_checked("input[value=part_1]")
        assert not opened.said


def until(page: Any, condition: str, seconds: float = 10.0) -> None:
    """Wait for a condition; playwright's own waiting evaluates text in the page, which its policy forbids."""
    end = time.monotonic() + seconds
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"not within {seconds} s: {condition}"
        page.wait_for_timeout(20)


@contextmanager
def player(browser: Any, address: str, **options: Any) -> Iterator[tuple[Any, list[str], list[str]]]:
    """(page, what the console said, what was asked for); the first frame is shown, where the address names none."""
    context = browser.new_context(viewport={"width": options.pop("width", 1280), "height": 900}, **options)
    page = context.new_page()
    said: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    try:
        page.goto(address if "#" in address else f"{address}#frame_000", wait_until="load")
        until(page, "Boolean(document.getElementById('screen').dataset.frame)")
        yield page, said, asked
    finally:
        context.close()


def drawn(page: Any, index: int) -> None:
    """Wait until this frame is on the screen."""
    until(page, f"document.getElementById('screen').dataset.frame === 'frame_{index:03d}'")


def layers(page: Any, expected: str) -> None:
    until(page, f"document.getElementById('screen').dataset.layers === '{expected}'")


@pytest.mark.slow
def test_the_player_plays_from_disk_and_pictures_follow_the_sound(site: Path, browser: Any) -> None:
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, asked):
        assert page.evaluate("document.getElementById('sound').duration") == pytest.approx(tiny.FRAMES)
        # Only what is shown and the next frame: no prefetching of a whole sequence.
        assert sum("/frames/" in address for address in asked) <= 3
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 2.2")
        for _ in range(3):
            at, index = page.evaluate(
                """new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done([
                  document.getElementById('sound').currentTime, Number(document.getElementById('stage').dataset.index),
                ]))))"""
            )
            assert at - 1.1 <= index <= at  # the picture is that of the second which is heard
            page.wait_for_timeout(300)
        page.keyboard.press("Space")
        until(page, "document.getElementById('sound').paused")
        drawn(page, int(page.evaluate("document.getElementById('sound').currentTime")))
        assert not said
        assert all(address.startswith(("file:", "data:")) for address in asked)


def test_a_scrub_moves_sound_picture_map_and_plots_together(site: Path, browser: Any) -> None:
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, _):
        before = page.get_attribute(".wedge", "transform")
        page.eval_on_selector("#scrub", "e => { e.value = 6.4; e.dispatchEvent(new Event('input')); }")
        drawn(page, 6)
        assert page.evaluate("document.getElementById('sound').currentTime") == pytest.approx(6.4, abs=0.02)
        assert page.get_attribute(".wedge", "transform") != before
        assert page.text_content("#frame-name") == "frame_006"
        box = page.locator(".series").first.bounding_box()
        page.locator(".series").first.click(position={"x": 46 + (box["width"] - 60) * 0.35, "y": 60})
        drawn(page, 3)
        assert float(page.get_attribute(".cursor", "x1")) == pytest.approx(46 + (box["width"] - 60) * 0.3, abs=1)
        page.click("#map svg", position={"x": 5, "y": 5})  # far from the path: nothing happens
        drawn(page, 3)
        assert not said


def test_names_on_the_map_do_not_overlap(root: Path, browser: Any, tmp_path: Path) -> None:
    copy = tiny.clone(root, tmp_path / "copy")

    def side_by_side(record: dict[str, Any]) -> None:
        for number, instance in enumerate(record["instances"]):
            # So far apart that the names of both just overlap in one line.
            low, high = [1.35 * number - 1.0, 0.8, -1.0], [1.35 * number - 0.8, 1.0, -0.8]
            instance |= {"category": record["category"], "bounds": [low, high], "position": low}

    tiny.edit_record(copy, tiny.MULTI, side_by_side, rehash=False)
    built = build_site(Dataset(copy), [tiny.MULTI], (), tmp_path / "site", workers=1)
    with player(browser, (built.folder / tiny.MULTI / "index.html").as_uri()) as (page, said, _):
        boxes = page.evaluate(
            "[...document.querySelectorAll('.map .label')].map(e => e.getBoundingClientRect())"
            ".map(b => [b.left, b.right, (b.top + b.bottom) / 2])"
        )
        assert len(boxes) == 2
        for number, (left, right, middle) in enumerate(boxes):
            for other_left, other_right, other_middle in boxes[:number]:
                assert right <= other_left or other_right <= left or abs(middle - other_middle) > 10
        assert not said


def test_an_address_may_name_a_frame(site: Path, browser: Any) -> None:
    with player(browser, (site / KEY / "index.html").as_uri() + "#frame_004") as (page, said, _):
        drawn(page, 4)
        page.evaluate("location.hash = '#frame_007'")
        drawn(page, 7)
        assert not said


def test_the_keyboard(site: Path, browser: Any) -> None:
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, _):
        for key, index in (
            ("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", 9), ("Shift+ArrowLeft", 0),
            ("Shift+ArrowRight", 9), ("Home", 0), ("ArrowLeft", 0), ("t", 8), ("Shift+T", 0),
        ):  # fmt: skip
            page.keyboard.press(key)
            drawn(page, index)
        page.keyboard.press("m")
        layers(page, "frame mask")
        page.keyboard.press("i")
        layers(page, "frame mask instances")
        page.keyboard.press("m")
        page.keyboard.press("2")
        layers(page, "frame instances prediction")
        page.keyboard.press("0")
        layers(page, "frame instances")
        assert page.get_attribute("#instances", "aria-pressed") == "true"
        assert not said


def test_quick_fingers_leave_one_loop_and_the_sound_running(site: Path, browser: Any) -> None:
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, _):
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 0.3")
        page.evaluate(  # the event of the first pause comes when it plays again
            "[1, 2, 3, 4].forEach(() => document.getElementById('play').click())"
        )
        until(page, "document.getElementById('sound').currentTime > 1.2")
        assert page.evaluate("document.getElementById('stage').classList.contains('playing')")
        frames, calls = page.evaluate(
            """new Promise((done) => {
              const ask = window.requestAnimationFrame;
              let calls = 0, frames = 0;
              window.requestAnimationFrame = (f) => { calls += 1; return ask(f); };
              const count = () => {
                frames += 1;
                if (frames < 20) { ask(count); return; }
                window.requestAnimationFrame = ask;
                done([frames, calls]);
              };
              ask(count);
            })"""
        )
        assert calls <= frames + 1
        assert not said


def test_arrows_belong_to_what_they_scroll(site: Path, browser: Any) -> None:
    with player(browser, (site / KEY / "index.html").as_uri() + "#frame_004") as (page, _, _):
        drawn(page, 4)
        page.focus(".scroll")
        page.keyboard.press("ArrowRight")
        page.focus("#volume")
        page.keyboard.press("Home")
        assert page.input_value("#volume") == "0"
        page.wait_for_timeout(100)
        assert page.get_attribute("#stage", "data-index") == "4"


def test_submissions_are_switched_and_their_errors_coloured(
    root: Path, submissions: tuple[ShownSubmission, ...], browser: Any
) -> None:
    frame = Observation(root, KEY).test[0]
    truth, marked = frame.mask(), np.broadcast_to(np.arange(64)[None] < 32, (64, 64))

    def colour(page: Any, area: Any) -> Any:
        # Off every outline; the server's pictures may be read back, those of a page from disk may not.
        inner = cv2.erode(area.astype(np.uint8), np.ones((9, 9), np.uint8), borderValue=0)
        row, column = np.argwhere(inner)[len(np.argwhere(inner)) // 2]
        pixel = page.evaluate(f"""(() => {{
          const copy = document.createElement('canvas').getContext('2d', {{ willReadFrequently: true }});
          copy.drawImage(document.getElementById('screen'), {-column}, {-row});
          return [...copy.getImageData(0, 0, 1, 1).data];
        }})()""")
        return np.array(pixel[:3], dtype=float)

    with served(root, submissions) as server, player(browser, f"{server.url}{KEY}/") as (page, said, _):
        page.keyboard.press("1")
        layers(page, "frame prediction")
        assert page.text_content(".submission small").startswith("IoU")
        page.keyboard.press("e")
        layers(page, "frame mask prediction")
        false = colour(page, marked & ~truth)
        assert false[0] > 1.5 * false[1] > 4 * false[2]  # vermilion
        page.keyboard.press("2")
        layers(page, "frame mask prediction")
        page.wait_for_timeout(100)
        rest = colour(page, ~truth & marked)
        assert np.ptp(rest) < 12  # grey: nothing is marked there any more
        page.keyboard.press("ArrowRight")
        drawn(page, 1)
        assert "Train frame" in page.text_content("#say")
        layers(page, "frame")
        assert not said


def test_what_is_heard_after_a_jump_is_the_clip_of_the_frame_that_is_shown(root: Path, browser: Any) -> None:
    listen = """async (at) => {
      const sound = document.getElementById('sound');
      window.ears ??= (() => {
        const context = new AudioContext(), tap = context.createAnalyser();
        tap.fftSize = 8192;
        tap.smoothingTimeConstant = 0;
        context.createMediaElementSource(sound).connect(tap);
        tap.connect(context.destination);
        return { context, tap };
      })();
      await window.ears.context.resume();
      const scrub = document.getElementById('scrub');
      scrub.value = at;
      scrub.dispatchEvent(new Event('input'));
      await sound.play();
      const bins = new Float32Array(window.ears.tap.frequencyBinCount);
      while (sound.currentTime < at + 0.35) await new Promise(requestAnimationFrame);
      window.ears.tap.getFloatFrequencyData(bins);
      sound.pause();
      return bins.indexOf(Math.max(...bins)) * window.ears.context.sampleRate / 8192;
    }"""
    with served(root) as server, player(browser, f"{server.url}{KEY}/") as (page, said, _):
        page.mouse.click(640, 5)  # browsers let a page sound after a click only
        for index in (7, 2, 9):
            assert page.evaluate(listen, index + 0.2) == pytest.approx(TONES[index], abs=12)
            drawn(page, index)
        assert not said


@pytest.mark.parametrize("dark", [False, True])
def test_pages_fit_a_phone_and_follow_the_system_s_theme(site: Path, browser: Any, dark: bool) -> None:
    for name in ("index.html", f"{KEY}/index.html"):
        with visit(browser, site / name, width=360, dark=dark) as opened:
            assert opened.overflow <= 0
            paper = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
            assert paper == ("rgb(20, 21, 24)" if dark else "rgb(251, 250, 247)")
            opened.page.click("[data-theme-toggle]")
            assert opened.page.evaluate("getComputedStyle(document.body).backgroundColor") != paper
            assert not opened.said


def test_a_name_without_spaces_does_not_widen_the_page(root: Path, tmp_path: Path, browser: Any) -> None:
    dataset = Dataset(root)
    with SubmissionWriter(tmp_path / "long", dataset, method="x" * 300) as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    shown = open_submissions(dataset, [tmp_path / "long"])
    site = build_site(dataset, [KEY], shown, tmp_path / "site", workers=1).folder
    for name in ("index.html", f"{KEY}/index.html"):
        with visit(browser, site / name, width=360) as opened:
            opened.page.keyboard.press("1")  # its name stands in the legend, too
            assert opened.overflow <= 0


def test_everything_that_can_be_pressed_has_a_name(site: Path, browser: Any) -> None:
    for name in ("index.html", f"{KEY}/index.html"):
        with visit(browser, site / name) as opened:
            nameless = opened.page.eval_on_selector_all(
                "button, a, input, select, [role=img]",
                """all => all.filter(e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length))
                  .map(e => e.outerHTML)""",
            )
            assert nameless == []


def test_the_release_is_shown_as_it_is(tmp_path: Path, browser: Any) -> None:
    dataset = Dataset(tiny.write_release(tmp_path / "release"))
    site = build_site(dataset, dataset.keys, (), tmp_path / "site", workers=1).folder
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, _):
        assert "No observation.json" in page.text_content("#main")
        assert page.is_disabled("#instances")
        page.keyboard.press("m")
        layers(page, "frame mask")
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 1.1")
        assert page.locator(".wedge").is_visible()
        assert page.locator("text=not in the data").count() >= 2
        assert not said


def test_after_home_the_old_frame_is_gone_within_a_second(many: Path, browser: Any) -> None:
    """Every picture takes longer than a frame lasts at 4×: those that come late are shown all the same."""
    page_file = sorted(many.glob("part_2/*/*/1/index.html"))[0]
    with player(browser, page_file.as_uri() + "#frame_008") as (page, _, _):
        drawn(page, 8)
        page.evaluate(
            """() => {
              const decode = HTMLImageElement.prototype.decode;
              HTMLImageElement.prototype.decode = function () {
                return new Promise((done) => setTimeout(done, 1400)).then(() => decode.call(this));
              };
            }"""
        )
        page.select_option("#rate", "4")
        page.keyboard.press(" ")
        page.keyboard.press("Home")
        # Frames 0 and 1 were fetched when the page opened; those after them come late.
        until(page, "/frame_00[2-7]/.test(document.getElementById('screen').dataset.frame)")
        assert page.evaluate("Number(document.getElementById('stage').dataset.index)") < 9, "before the end"


def test_keys_on_the_page_can_be_read_and_all_is_in_a_landmark(site: Path, browser: Any) -> None:
    ratios = """[...document.querySelectorAll('kbd')].filter((k) => k.offsetParent).map((k) => {
      const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
      const lightness = (c) => c.slice(0, 3).map((v) => v / 255)
        .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
      let below = k, alpha = 1;
      while ((numbers(getComputedStyle(below).backgroundColor)[3] ?? 1) === 0) below = below.parentElement;
      const paper = numbers(getComputedStyle(below).backgroundColor);
      for (let e = k; e; e = e.parentElement) alpha *= Number(getComputedStyle(e).opacity);
      const ink = numbers(getComputedStyle(k).color).slice(0, 3).map((v, i) => alpha * v + (1 - alpha) * paper[i]);
      const [low, high] = [lightness(ink), lightness(paper)].sort((a, b) => a - b);
      return (high + 0.05) / (low + 0.05);
    })"""
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, _, _):
        found = page.evaluate(ratios)
        assert len(found) >= 8
        assert min(found) >= 4.5
        outside = "[...document.body.children].filter((e) => !e.matches('header, main, nav, footer, script, .skip'))"
        assert page.evaluate(f"{outside}.map((e) => e.outerHTML.slice(0, 60))") == []


def test_without_sound_the_pictures_run_on_a_clock_of_their_own(many: Path, browser: Any) -> None:
    page_file = sorted(many.glob("part_2/*/*/1/index.html"))[0]
    with player(browser, page_file.as_uri()) as (page, said, _):
        page.select_option("#rate", "4")
        page.click("#play")
        drawn(page, 9)
        until(page, "!document.getElementById('stage').classList.contains('playing')")
        assert page.text_content("#time") == "0:10"
        assert not said


def test_the_command_serves_until_it_is_interrupted(root: Path) -> None:
    import signal
    import subprocess
    import sys
    import urllib.request

    command = "from avs3d_bench.inspector.cli import view; view()"
    process = subprocess.Popen(
        [sys.executable, "-c", command, str(root), "--port", "0", "--no-browser"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        assert process.stdout
        address = re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())
        assert address
        with urllib.request.urlopen(address.group(0), timeout=20) as answer:
            assert b"2 of 2" in answer.read()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
    finally:
        process.kill()
        process.wait()
