"""`avs3d video`: pictures and sound of the decoded film."""

from __future__ import annotations

import itertools
import math
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.formats.film import RATE
from avs3d_bench.inspector.facts import read_facts
from avs3d_bench.inspector.floor_map import MapInset
from avs3d_bench.inspector.video import film_sound, gain_for, write_video
from avs3d_bench.inspector.video_drawing import PREDICTED, TRUTH, Canvas, Shown
from tests.support.shared import SharedDataset
from tests.support.tiny import MULTI, SINGLE, edit_record, replace, write_dataset, write_release

av = pytest.importorskip("av", reason="the package av is not installed: pip install 'avs3d-bench[inspect]'")
FRAMES = 9


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=FRAMES, size=96)


def film(root: Path, path: Path, key: str = SINGLE, **options: object) -> Path:
    return write_video(Dataset(root), key, path, size=options.pop("size", 96), **options).path  # type: ignore[arg-type]


def pictures(path: Path) -> list[tuple[float, np.ndarray]]:
    with av.open(str(path)) as container:
        return [(float(f.pts * f.time_base), f.to_ndarray(format="rgb24")) for f in container.decode(video=0)]


def sound(path: Path) -> tuple[float, np.ndarray]:
    """(time of the first sample, samples (2, n)) as a player hears them."""
    with av.open(str(path)) as container:
        frames = list(container.decode(audio=0))
    return float(frames[0].pts * frames[0].time_base), np.concatenate([f.to_ndarray() for f in frames], axis=1)


# ---------------------------------------------------------------------------------------------------- seen and heard


@pytest.fixture(scope="module")
def clapper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Even frames are white and silent; odd ones are black, and start with a click, left and right in turn."""
    root = write_dataset(tmp_path_factory.mktemp("clapper"), frames=FRAMES, size=64)
    for i in range(FRAMES):
        picture = np.full((64, 64, 3), 0 if i % 2 else 255, dtype=np.uint8)
        clip = np.zeros((2, layout.BINAURAL_SAMPLES), dtype=np.float32)
        if i % 2:
            clip[(i // 2) % 2, 300:340] = 0.5
        for folder in (layout.INPUT, layout.IMAGES):
            path = root / SINGLE / layout.image_path(folder, i)
            path.unlink()
            media.write_png_rgb(path, picture)
        path = root / SINGLE / layout.audio_path(layout.BINAURAL, i)
        path.unlink()
        media.write_wav(path, clip)
    return root


def test_sound_and_pictures_switch_together(clapper: Path, tmp_path: Path) -> None:
    path = film(clapper, tmp_path / "f.mp4", overlay="none", size=64)
    shown = [(at, picture[8:40].mean() > 128) for at, picture in pictures(path)]
    switches = [at for (_, was), (at, now) in itertools.pairwise(shown) if was != now]
    assert switches == pytest.approx(range(1, FRAMES), abs=1e-6)
    start, samples = sound(path)
    for second in range(1, FRAMES, 2):
        ear = (second // 2) % 2
        first = round((second - start) * layout.SAMPLE_RATE)
        heard = np.abs(samples[:, first - 4000 : first + 4000])
        click_at = (int(np.argmax(heard[ear] > 0.5 * heard[ear].max())) - 4000) / layout.SAMPLE_RATE
        # The click starts 300 samples after its picture; an eighth of a picture is 4 ms.
        assert click_at == pytest.approx(300 / layout.SAMPLE_RATE, abs=0.002)
        assert heard[ear].max() > 5 * heard[1 - ear].max(), "the click is in the wrong ear"


def test_the_track_is_the_clips(root: Path, tmp_path: Path) -> None:
    # White noise is the worst case of AAC, which leaves out the highest octave's last third: levels lose about 1 dB.
    path = film(root, tmp_path / "f.mp4")
    _, samples = sound(path)
    track, gain = film_sound(Dataset(root)[SINGLE])
    assert track is not None
    assert gain is not None
    for i, frame in enumerate(Dataset(root)[SINGLE].frames):
        second = slice(i * 44_100 + 2000, (i + 1) * 44_100 - 2000)
        heard = 20 * np.log10(np.sqrt((samples[:, second].astype(float) ** 2).mean(axis=1)))
        given = 20 * np.log10(np.sqrt((frame.audio()[:, 2000:-2000].astype(float) ** 2).mean(axis=1)))
        assert heard == pytest.approx(given + gain, abs=2.0)
        assert heard[1] - heard[0] == pytest.approx(given[1] - given[0], abs=0.1), "level differences between the ears"


def test_lasts_a_second_a_frame_and_seeks_to_each(root: Path, tmp_path: Path) -> None:
    path = film(root, tmp_path / "f.mp4")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert float(stream.duration * stream.time_base) == FRAMES
        assert stream.average_rate == RATE
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.codec_context.color_primaries, stream.codec_context.colorspace) == (1, 1)
        assert container.streams.audio[0].codec_context.name == "aac"
        keys = [float(p.pts * p.time_base) for p in container.demux(stream) if p.is_keyframe]
        assert set(range(FRAMES)) <= set(keys)
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat"), "a browser has to load all of the film before it starts"
    assert 44_100 % RATE == 0, "the seconds of pictures and of samples drift apart"


def test_same_bytes_twice(root: Path, tmp_path: Path) -> None:
    first, second = (film(root, tmp_path / name, with_map=True).read_bytes() for name in ("a.mp4", "b.mp4"))
    assert first == second


def test_colours_survive(root: Path, tmp_path: Path) -> None:
    path = film(root, tmp_path / "f.mp4", overlay="none")
    _, picture = pictures(path)[RATE // 2]
    frame = Dataset(root)[SINGLE].frames[0].rgb()
    # BT.601 read as BT.709 would shift saturated colours by 10 to 20.
    assert np.abs(picture[:96].astype(float).mean(axis=(0, 1)) - frame.mean(axis=(0, 1))).max() < 2


# ---------------------------------------------------------------------------------------------------------- pictures


def shown(root: Path, number: int, **changes: object) -> tuple[Canvas, Shown]:
    dataset = Dataset(root)
    observation = dataset[SINGLE]
    frame = observation.frames[number]
    values = {
        "rgb": frame.rgb(), "truth": frame.mask(), "predicted": None, "title": SINGLE, "what": "microwave",
        "moment": read_facts(dataset, observation).moments[number], "loudness": None, **changes,
    }  # fmt: skip
    return Canvas.of(frame.rgb().shape, 960), Shown(**values)  # type: ignore[arg-type]


def near(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.asarray(np.abs(picture.astype(int) - colour).max(axis=2) < 12)


def test_the_outline_is_the_masks(root: Path) -> None:
    number = 5
    canvas, what = shown(root, number)
    assert what.truth is not None
    lines = near(canvas.draw(what, "outline")[:960], TRUTH)
    lines[:60, :300] = False  # the legend
    rows, columns = np.nonzero(lines)
    inside = np.nonzero(what.truth)
    # Ten pixels of the film a pixel of the frame: the line runs through the centres of the outermost pixels.
    for found, given in ((rows, inside[0]), (columns, inside[1])):
        assert found.min() == pytest.approx(10 * given.min() + 5, abs=4)
        assert found.max() == pytest.approx(10 * given.max() + 5, abs=4)


def test_what_each_overlay_does(root: Path) -> None:
    canvas, what = shown(root, 5)
    assert what.truth is not None
    lined, tinted = (canvas.draw(what, overlay)[:960].astype(int) for overlay in ("outline", "tint"))
    middle = tuple(10 * round(float(side.mean())) + 5 for side in np.nonzero(what.truth))
    base = what.rgb[middle[0] // 10, middle[1] // 10].astype(int)
    assert np.abs(lined[middle] - base).max() < 8, "an outline leaves the object's inside alone"
    assert np.abs(tinted[middle] - (0.65 * base + 0.35 * np.array(TRUTH))).max() < 8


def test_a_prediction_is_outlined_in_its_own_colour(root: Path) -> None:
    box = np.zeros((96, 96), dtype=bool)
    box[60:80, 10:30] = True
    canvas, what = shown(root, 0, predicted=box, method="mine")
    blue = near(canvas.draw(what, "tint")[:960], PREDICTED)
    blue[:100] = False  # the legend
    rows, columns = np.nonzero(blue)
    assert (rows.min(), rows.max()) == (pytest.approx(605, abs=4), pytest.approx(795, abs=4))
    assert (columns.min(), columns.max()) == (pytest.approx(105, abs=4), pytest.approx(295, abs=4))


@pytest.mark.parametrize("size", [301, 481, 720])
def test_what_is_said_of_a_long_name_is_not_cut_off(root: Path, size: int) -> None:
    nothing = np.zeros((96, 96), dtype=bool)
    _, what = shown(
        root, 0, rgb=np.zeros((96, 96, 3), np.uint8), truth=None, predicted=nothing, method="sounding " * 20
    )
    picture = Canvas.of((96, 96, 3), size).draw(what, "outline")[: size // 8].astype(int)
    panel = np.flatnonzero((picture.max(axis=2) > 8).any(axis=0))
    ink = np.flatnonzero((picture.min(axis=2) > 120).any(axis=0))
    assert panel.max() - ink.max() >= 4, "the line ends before the panel does"


def test_a_mask_of_another_size_is_refused(root: Path) -> None:
    canvas, what = shown(root, 0, truth=np.zeros((95, 96), dtype=bool))
    with pytest.raises(Avs3dError, match=r"a mask of \(95, 96\), expected \(96, 96\)"):
        canvas.draw(what, "tint")


@pytest.mark.parametrize("shape", [(96, 96, 3), (97, 131, 3), (480, 640, 3), (640, 480, 3)])
def test_all_sides_are_even(shape: tuple[int, int, int]) -> None:
    canvas = Canvas.of(shape, 501)
    assert canvas.width % 2 == canvas.picture % 2 == canvas.caption % 2 == canvas.height % 2 == 0
    assert max(canvas.width, canvas.picture) == pytest.approx(501, abs=1)
    assert canvas.width / canvas.picture == pytest.approx(shape[1] / shape[0], rel=0.01)


def test_the_map_shows_source_and_agent_where_they_are(root: Path) -> None:
    dataset = Dataset(root)
    observation = dataset[SINGLE]
    facts = read_facts(dataset, observation)
    inset = MapInset.of(observation, facts, 720)
    assert inset is not None
    for number in (0, FRAMES - 1):
        picture = inset.draw(number)
        moment = facts.moments[number]
        assert moment.source
        assert moment.position
        for (x, _, z), colour in ((moment.source, TRUTH), (moment.position, (0, 114, 178))):
            column = round((x - inset.drawing.bounds.left) * inset.scale)
            row = round((z - inset.drawing.bounds.top) * inset.scale)
            assert near(picture, colour)[row - 1 : row + 2, column - 1 : column + 2].any()


def test_the_map_has_no_line_at_its_border(root: Path) -> None:
    dataset = Dataset(root)
    inset = MapInset.of(dataset[SINGLE], read_facts(dataset, dataset[SINGLE]), 720)
    assert inset is not None
    picture = inset.draw(0)
    for border in (picture[0], picture[-1], picture[:, 0], picture[:, -1]):
        assert (border < 80).all(axis=-1).mean() < 0.3


def test_a_moving_source_moves_on_the_map(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "d", frames=4, size=32)
    move(root, SINGLE)
    dataset = Dataset(root)
    facts = read_facts(dataset, dataset[SINGLE])
    inset = MapInset.of(dataset[SINGLE], facts, 720)
    assert inset is not None
    first, last = (np.argwhere(near(inset.draw(number), TRUTH)).mean(axis=0) for number in (0, 3))
    assert last[1] > first[1] + 3, "the source goes to the right"
    assert film(root, tmp_path / "f.mp4", with_map=True, size=64).stat().st_size > 0


def move(root: Path, key: str) -> None:
    """Let the sounding object of a tiny dataset go to the right, 0.2 m a second."""

    def change(data: dict) -> None:
        data["source_motion"] = "path"
        start = next(i for i in data["instances"] if i["sounding"])
        for i, frame in enumerate(data["frames"]):
            frame["source_position"] = [data["source_position"][0] + 0.2 * i, *data["source_position"][1:]]
            frame["instance_position"] = [start["position"][0] + 0.2 * i, *start["position"][1:]]
            frame["instance_rotation"] = start["rotation"]

    edit_record(root, key, change)


# ------------------------------------------------------------------------------------------- other data, and the rest


def test_the_official_release(tmp_path: Path) -> None:
    root = write_release(tmp_path / "release", frames=3, size=64)
    path = film(root, tmp_path / "f.mp4", key=MULTI, with_map=True)
    assert len(pictures(path)) == 3 * RATE
    assert np.abs(sound(path)[1]).max() > 0.05


def test_without_clips_the_film_is_silent(tmp_path: Path) -> None:
    import shutil

    root = write_release(tmp_path / "release", frames=2, size=64)
    shutil.rmtree(root / SINGLE / layout.BINAURAL)
    written = write_video(Dataset(root), SINGLE, tmp_path / "f.mp4", size=64)
    assert written.gain_db is None
    with av.open(str(written.path)) as container:
        assert not container.streams.audio


@pytest.mark.slow
def test_a_submission(root: Path, tmp_path: Path) -> None:
    folder = tmp_path / "s"
    box = np.zeros((96, 96), dtype=bool)
    box[60:80, 10:30] = True
    media.write_png_mask(folder / SINGLE / "masks/frame_008.png", box)
    media.write_json(folder / "submission.json", SubmissionRecord(method="mine", dataset="tiny", dataset_version="1"))
    path = film(root, tmp_path / "f.mp4", submission=folder, size=480)
    bare = film(root, tmp_path / "bare.mp4", size=480)
    changed = []
    for at in (round(8.5 * RATE), round(7.5 * RATE)):
        with_it, without = (pictures(file)[at][1][290:410, 40:160].astype(int) for file in (path, bare))
        changed.append(int((np.abs(with_it - without).max(axis=2) > 30).sum()))
    test, train = changed
    assert test > 300, "outlined on its test frame"
    assert train < 20, "and not on the train frame before"
    with pytest.raises(UsageError, match=r"part_2/.*: no masks of its test frames"):
        film(root, tmp_path / "g.mp4", key=MULTI, submission=folder)


@pytest.mark.parametrize(("peak", "gain"), [(1.0, -3), (0.5, 3), (0.1, 17), (1e-4, 24), (0.0, 0), (2.0, -10)])
def test_gain_is_whole_and_never_clips(peak: float, gain: int) -> None:
    assert gain_for(peak) == gain
    if peak:
        assert 20 * math.log10(peak) + gain <= -3 + 1e-9


@pytest.mark.parametrize(
    ("name", "options", "line"),
    [
        ("f.avi", {}, "the film is an MP4"),
        ("f.mp4", {"size": 9000}, "size 9000: expected 64 to 2160"),
        ("f.mp4", {"key": "part_1/tiny/kitchen/7"}, "no observation"),
        ("f.mp4", {"submission": "/nowhere"}, "no such folder"),
    ],
)
def test_wrong_use_is_told_in_one_line(root: Path, tmp_path: Path, name: str, options: dict, line: str) -> None:
    with pytest.raises(UsageError, match=line):
        film(root, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_damaged_clip_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "d", frames=3, size=64)
    replace(root / SINGLE / "audio_clips_binaural/frame_1.wav", b"RIFF")
    with pytest.raises(Avs3dError, match=r"frame_1\.wav"):
        film(root, tmp_path / "out/f.mp4")
    assert not list(tmp_path.glob("out/*"))


def test_a_damaged_picture_in_the_middle_leaves_nothing(tmp_path: Path) -> None:
    root = write_dataset(tmp_path / "d", frames=3, size=64)
    replace(root / SINGLE / "input/frame_002.png", b"")
    with pytest.raises(Avs3dError, match=r"frame_002\.png"):
        film(root, tmp_path / "out/f.mp4")
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.slow
def test_a_system_that_refuses_is_told_in_one_line(root: Path, tmp_path: Path) -> None:
    target = tmp_path / "out/f.mp4"
    code = f"""
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, {resource.RLIM_INFINITY}))
from avs3d_bench.cli import run
from avs3d_bench.inspector.media_cli import video
run(video, [{SINGLE!r}, "--dataset", {str(root)!r}, "-o", {str(target)!r}])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    assert done.stderr.startswith("avs3d: error: ")
    assert done.stderr.count("\n") == 1
    assert "f.mp4: cannot write" in done.stderr
    assert not list(target.parent.iterdir())


@pytest.mark.slow
def test_an_interrupt_leaves_nothing(root: Path, tmp_path: Path) -> None:
    target = tmp_path / "f.mp4"
    code = (
        "from avs3d_bench.cli import run; from avs3d_bench.inspector.media_cli import video; "
        f"run(video, [{SINGLE!r}, '--dataset', {str(root)!r}, '-o', {str(target)!r}, '--size', '1400'])"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 30
    while not list(tmp_path.glob(".f.mp4.*")) and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    assert said.strip() == "avs3d: error: interrupted"
    assert not list(tmp_path.iterdir())


def test_without_the_package_the_line_says_what_to_install(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(Avs3dError, match=r"av is not installed.*pip install 'avs3d-bench\[inspect\]'"):
        film(root, tmp_path / "f.mp4")


def test_the_command_line_is_the_documented_one() -> None:
    from avs3d_bench.inspector.media_cli import video

    names = {option for parameter in video.params if isinstance(parameter, click.Option) for option in parameter.opts}
    assert names == {"--dataset", "-o", "--output", "--submission", "--size", "--overlay", "--map"}
