"""The head that turns on a page of the viewer: ambisonics as the ears of a rigid sphere hear them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from avs3d_bench.inspector.build import build_site
from avs3d_bench.inspector.live import LiveSite
from avs3d_bench.inspector.sound import read_ambisonics_track, read_track
from benchmarks import head_filters
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS
from tests.avs3d_bench.test_inspector import player, until
from tests.support import tiny, tiny_scenes
from tests.support.browser import launch
from tests.support.tiny_receivers import add_receivers, add_waves, plane_wave

KEY = tiny.SINGLE
RATE = layout.SAMPLE_RATE


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Noise from 90° to the left in the ambisonics of every frame, whatever the binaural clips say."""
    root = add_receivers(tiny.write_dataset(tmp_path_factory.mktemp("head") / "tiny", frames=9, keys=(KEY,)))
    for frame in Dataset(root)[KEY].frames:
        noise = np.random.default_rng(frame.index).uniform(-0.2, 0.2, RATE)
        path = root / KEY / layout.audio_path(layout.clips_folder(layout.AMBISONICS), frame.index)
        media.write_wav(path, plane_wave(noise, -90.0, 0.0))
    return root


@pytest.fixture(scope="module")
def site(root: Path) -> Path:
    return build_site(Dataset(root), [KEY], (), root.parent / "site", workers=1).folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launch() as found:
        yield found


# --- the filters -----------------------------------------------------------------------------------------------------


def ears(azimuth: float, frequency: float) -> np.ndarray:
    """(2,) left and right of the page's filters at a frequency for a plane wave from an azimuth (positive right)."""
    taps = np.array([[float(value) for value in row.split(",")] for row in re.findall(r"\[([-0-9., e]+)\]", _script())])
    pressure, left = taps @ np.exp(-2j * np.pi * frequency / RATE * np.arange(taps.shape[1]))
    y = np.sin(np.radians(-azimuth))
    return np.array([pressure + y * left, pressure - y * left])


def _script() -> str:
    return head_filters.TARGET.read_text(encoding="utf-8")


def test_the_filters_of_the_page_are_those_of_the_closed_form() -> None:
    assert _script() == head_filters.script()


@pytest.mark.parametrize("azimuth", [-90, -40, -10, 10, 40, 90])
def test_delays_at_low_frequencies_are_those_of_a_sphere(azimuth: float) -> None:
    """3(a/c)·sin φ: Kuhn (1977)."""
    left, right = ears(azimuth, 250.0)
    delay = np.angle(left * np.conj(right)) / (2 * np.pi * 250.0)
    assert delay == pytest.approx(3 * HEAD_RADIUS / SPEED_OF_SOUND * np.sin(np.radians(-azimuth)), rel=0.08)


def test_the_ear_at_the_side_of_the_source_is_louder_at_high_frequencies() -> None:
    for frequency in (2000.0, 4000.0, 8000.0):
        left, right = np.abs(ears(-90, frequency))
        assert 20 * np.log10(left) == pytest.approx(6.0, abs=1.2), "pressure doubles at a rigid wall"
        assert left > 2 * right
        ahead = np.abs(ears(0, frequency))
        assert ahead[0] == pytest.approx(ahead[1], rel=1e-6)


# --- the track -------------------------------------------------------------------------------------------------------


def test_the_track_has_the_four_channels_of_the_first_order(root: Path, tmp_path: Path) -> None:
    import io

    import soundfile

    observation = Dataset(root)[KEY]
    track = read_ambisonics_track(observation)
    samples, rate = soundfile.read(io.BytesIO(track.data), always_2d=True)
    assert rate == RATE
    assert samples.shape == (9 * RATE, 4)
    np.testing.assert_allclose(
        samples[1000:RATE].T * 10 ** (-track.gain / 20), observation.frames[0].ambisonics()[:, 1000:], atol=2 / 2**15
    )
    third = add_receivers(tiny.write_dataset(tmp_path / "third", frames=1, keys=(KEY,)), order=3)
    found, _ = soundfile.read(io.BytesIO(read_ambisonics_track(Dataset(third)[KEY]).data), always_2d=True)
    assert found.shape[1] == 4


def test_a_clip_that_cannot_be_read_is_a_second_of_silence(root: Path, tmp_path: Path) -> None:
    copy = add_receivers(tiny.write_dataset(tmp_path / "copy", frames=3, keys=(KEY,)))
    (copy / KEY / "audio_clips_ambisonics/frame_1.wav").unlink()
    track = read_ambisonics_track(Dataset(copy)[KEY])
    assert len(track.problems) == 1
    assert "audio_clips_ambisonics/frame_1.wav" in track.problems[0]


def test_only_an_observation_with_ambisonics_has_the_control(site: Path, tmp_path: Path) -> None:
    page = (site / KEY / "index.html").read_text()
    assert 'id="look"' in page
    assert (site / KEY / "ambisonics.js").read_bytes().startswith(b'window.AVS3D.stem("part_1/')
    plain = build_site(
        Dataset(tiny.write_dataset(tmp_path / "plain", frames=2, keys=(KEY,))), [KEY], (), tmp_path / "site", workers=1
    ).folder
    page = (plain / KEY / "index.html").read_text()
    assert 'id="look"' not in page
    assert "head.js" not in page
    assert not (plain / KEY / "ambisonics.js").exists()


def test_the_server_makes_the_track_too(root: Path, site: Path) -> None:
    dataset = Dataset(root)
    live = LiveSite(dataset, dataset.keys, ())
    try:
        assert live.read(f"{KEY}/ambisonics.js") == (site / KEY / "ambisonics.js").read_bytes()
    finally:
        live.close()


# --- in a browser ----------------------------------------------------------------------------------------------------

#: Two analysers behind whatever is connected to the loudspeakers.
TAP = """() => {
  const connect = AudioNode.prototype.connect;
  AudioNode.prototype.connect = function (to, ...rest) {
    if (to === this.context.destination) {
      const split = this.context.createChannelSplitter(2);
      connect.call(this, split);
      window.ears = [0, 1].map((channel) => {
        const ear = new AnalyserNode(this.context, { fftSize: 8192 });
        connect.call(split, ear, channel);
        return ear;
      });
    }
    return connect.call(this, to, ...rest);
  };
}"""
#: RMS of both ears over a few looks.
LOUD = """async () => {
  const power = [0, 0], samples = new Float32Array(8192);
  for (let k = 0; k < 4; k += 1) {
    await new Promise((done) => setTimeout(done, 80));
    window.ears.forEach((ear, i) => {
      ear.getFloatTimeDomainData(samples);
      power[i] += samples.reduce((sum, v) => sum + v * v, 0) / samples.length / 4;
    });
  }
  return power.map(Math.sqrt);
}"""
LOOK = "(e, value) => { e.value = value; e.dispatchEvent(new Event('input')); }"


def test_a_turn_mixes_x_and_y_as_the_closed_form_says(site: Path, browser: Any) -> None:
    """The new Y is the pressure gradient to the left of the turned head; checked for plane waves from all around."""
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, _):
        for look in (-180, -90, -35, 0, 20, 90, 145):
            found = page.evaluate(f"window.AVS3D.turned({look})")
            for azimuth in range(-180, 180, 15):
                _, y, _, x = plane_wave(np.ones(1), azimuth, 0.0)[:, 0]
                expected = plane_wave(np.ones(1), azimuth - look, 0.0)[1, 0]
                assert found["x"] * x + found["y"] * y == pytest.approx(expected, abs=1e-6)
        assert not said


@pytest.mark.slow
def test_a_source_at_the_left_is_ahead_after_a_turn_to_the_left(site: Path, root: Path, browser: Any) -> None:
    gain = 10 ** (read_track(Dataset(root)[KEY]).gain / 20)
    with player(browser, (site / KEY / "index.html").as_uri()) as (page, said, asked):
        page.evaluate(TAP)
        assert page.is_disabled("#look")
        assert not any("ambisonics.js" in address for address in asked), "the track is loaded when it is asked for"
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 0.2")
        page.click("#head")
        until(page, "document.getElementById('stage').dataset.head === '0'")
        assert page.get_attribute("#head", "aria-pressed") == "true"
        assert page.evaluate("document.getElementById('sound').paused")

        def level(look: int) -> tuple[float, float]:
            """Levels of both ears (dB) re those of the wave itself."""
            page.eval_on_selector("#look", LOOK, look)
            page.wait_for_timeout(250)
            left, right = page.evaluate(LOUD)
            return tuple(20 * np.log10(ear / (gain * 0.2 / np.sqrt(3))) for ear in (left, right))

        left, right = level(0)
        assert left == pytest.approx(6.0, abs=2.0), "the noise is at the left ear"
        assert left - right > 6
        left, right = level(-90)
        assert left == pytest.approx(right, abs=0.3), "the head looks at it"
        assert page.text_content("#look-value") == "90° left"
        left, right = level(180)
        assert right - left > 6, "it is at the right of a head that looks back"
        # The whole track again, at the same time.
        page.click("#head")
        until(page, "!document.getElementById('sound').paused")
        assert page.get_attribute("#stage", "data-head") == ""
        assert page.evaluate("document.getElementById('sound').currentTime") > 1
        assert not said


@pytest.mark.slow
def test_stems_head_and_siblings_of_a_part_3_take_turns(tmp_path: Path, browser: Any) -> None:
    root = tiny_scenes.write_part_3(tmp_path / "scenes", stems=True)
    add_waves(root)
    site = build_site(Dataset(root), tiny_scenes.GROUP, (), tmp_path / "site", workers=1).folder
    with player(browser, (site / tiny_scenes.BOTH / "index.html").as_uri()) as (page, said, _):
        stems, head = (f"document.getElementById('stage').dataset.{name}" for name in ("stems", "head"))
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 0.1")
        page.click("[data-lane=background] [data-kind=mute]")
        until(page, f"Boolean({stems})")
        page.keyboard.press("h")
        until(page, f"{head} === '0'")
        assert page.get_attribute("[data-lane=background] [data-kind=mute]", "aria-pressed") == "false"
        assert page.evaluate(stems) is None
        page.click("[data-lane=source_1] [data-kind=solo]")
        until(page, f"Boolean({stems})")
        assert page.get_attribute("#head", "aria-pressed") == "false"
        assert page.is_disabled("#look")
        page.keyboard.press("h")
        until(page, f"{head} === '0'")
        # A sibling is heard as it is, from its own track.
        page.keyboard.press("g")
        until(page, f"document.getElementById('key').textContent !== '{tiny_scenes.BOTH}' && {head} === ''")
        until(page, "!document.getElementById('sound').paused")
        page.keyboard.press("h")
        until(page, f"{head} === '0'")
        assert not said
