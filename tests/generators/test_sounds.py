"""The sources: equal loudness, never silent, different by seed; recordings; BS.1770."""

import itertools

import numpy as np
import pytest
import soundfile

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.sounds import (
    CEILING_DB,
    SECOND_FLOOR_DB,
    TARGET_LUFS,
    load_sound,
    loop,
    synthesise,
)
from generators.assets.sounds.loudness import integrated_loudness, k_weighting, limit, true_peak_envelope
from tests.support.tiers import some

SR = 44_100
SECONDS = 26


@pytest.fixture(scope="module")
def sources():
    return {category: synthesise(category, SECONDS, np.random.default_rng(3)) for category in CATEGORIES}


def second_levels(signal):
    """(whole seconds,) RMS level of each second in dBFS."""
    whole = len(signal) // SR
    return 10 * np.log10(np.mean(np.square(np.float64(signal[: whole * SR]).reshape(whole, SR)), axis=1))


def true_peak(signal):
    return float(true_peak_envelope(signal).max())


def sine(frequency, seconds, rate, level_db=0.0):
    return 10 ** (level_db / 20) * np.sin(2 * np.pi * frequency * np.arange(int(seconds * rate)) / rate)


@pytest.mark.parametrize("rate", [44_100, 48_000])
def test_bs1770_reference_a_full_scale_997_hz_sine_reads_minus_3_01(rate):
    assert integrated_loudness(sine(997, 5, rate), rate) == pytest.approx(-3.01, abs=0.02)


def test_k_weighting_has_the_published_coefficients_at_48_khz():
    """ITU-R BS.1770-4, tables 1 and 2."""
    shelf, high_pass = k_weighting(48_000)
    published = [1.53512485958697, -2.69169618940638, 1.19839281085285, 1.0, -1.69065929318241, 0.73248077421585]
    np.testing.assert_allclose(shelf, published, atol=1e-8)
    np.testing.assert_allclose(high_pass, [1, -2, 1, 1, -1.99004745483398, 0.99007225036621], atol=1e-8)


def test_gate_ignores_silence_and_knows_nothing_of_too_little():
    tone = sine(997, 4, SR, -20)
    padded = np.concatenate([tone, np.zeros(8 * SR)])
    assert integrated_loudness(padded, SR) == pytest.approx(integrated_loudness(tone, SR), abs=0.2)
    assert integrated_loudness(np.zeros(SR), SR) == -np.inf
    assert integrated_loudness(tone[:1000], SR) == -np.inf


def test_limiter_holds_the_true_peak_between_samples():
    # A quarter-rate sine at 45°: every sample is at 0.71 of the peak between them.
    tone = np.sin(np.pi / 2 * np.arange(SR) + np.pi / 4)
    assert np.abs(tone).max() == pytest.approx(0.7071, abs=1e-3)
    assert true_peak(tone[100:-100]) == pytest.approx(1.0, abs=0.05)
    assert true_peak(limit(3 * tone, SR, 0.8)) <= 0.8 * 1.02


@pytest.mark.slow
@pytest.mark.parametrize("category", CATEGORIES)
def test_source_has_the_target_loudness_no_silent_second_and_a_limited_peak(sources, category):
    source = sources[category]
    assert source.dtype == np.float32
    assert source.shape == (SECONDS * SR,)
    assert integrated_loudness(source, SR) == pytest.approx(TARGET_LUFS, abs=0.1)
    assert second_levels(source).min() > SECOND_FLOOR_DB
    assert 20 * np.log10(true_peak(source)) <= CEILING_DB + 0.05


@pytest.mark.parametrize("category", some(CATEGORIES, every=3))
def test_source_repeats_for_a_seed_and_differs_between_seeds(category):
    first, again, other = (synthesise(category, 4, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes()

    def third_octaves(signal):
        power = np.abs(np.fft.rfft(signal)) ** 2
        edges = np.geomspace(100, 10_000, 21)
        frequency = np.fft.rfftfreq(len(signal), 1 / SR)
        sums = [power[(frequency >= a) & (frequency < b)].sum() for a, b in itertools.pairwise(edges)]
        return 10 * np.log10(sums)

    assert np.abs(third_octaves(first) - third_octaves(other)).max() > 1.5, "variants must be audibly different"


def spectrum(source):
    power = np.abs(np.fft.rfft(source[: 16 * SR].astype(float))) ** 2
    return power, np.fft.rfftfreq(16 * SR, 1 / SR)


def share(source, low, high):
    power, frequency = spectrum(source)
    return power[(frequency >= low) & (frequency < high)].sum() / power.sum()


def modulation(source, rates):
    """Relative strength of the envelope's spectrum at ``rates`` Hz, over its median between 0.3 and 12 Hz."""
    envelope = np.abs(source[: 16 * SR].astype(float)).reshape(-1, 441).mean(axis=1)
    power = np.abs(np.fft.rfft(envelope - envelope.mean()))
    frequency = np.fft.rfftfreq(len(envelope), 0.01)
    floor = np.median(power[(frequency > 0.3) & (frequency < 12)])
    return max(power[np.abs(frequency - rate).argmin()] / floor for rate in rates)


@pytest.mark.slow
def test_each_category_has_its_character(sources):
    power, frequency = spectrum(sources["microwave"])
    peak = frequency[np.argmax(np.where((frequency > 90) & (frequency < 130), power, 0))]
    assert min(abs(peak - 100), abs(peak - 120)) < 1.0, "hum at twice the mains frequency"
    assert modulation(sources["telephone"], [1.0]) > 10, "a ring every second"
    assert modulation(sources["clock"], [2.0, 2.5, 3.0, 4.0]) > 10, "ticks"
    # Near-periodic lifting of the laundry between 0.7 and 1.0 turns per second, in several harmonics.
    assert modulation(sources["washing_machine"], np.arange(0.65, 3.1, 1 / 16)) > 5
    assert share(sources["washing_machine"], 30, 400) > 3 * share(sources["telephone"], 30, 400)
    assert share(sources["vacuum_cleaner"], 1000, 12_000) > 0.4, "air noise"
    levels = second_levels(sources["toilet"])
    assert np.ptp(levels) > 6, "flush, then the quieter refill"
    assert np.ptp(second_levels(sources["vacuum_cleaner"])) < 4, "steady"
    assert share(sources["telephone"], 600, 8000) > 0.95


@pytest.mark.parametrize("category", CATEGORIES)
def test_source_can_be_told_left_from_right(sources, category):
    """Below 700 Hz a head throws no shadow: a good part of the energy must lie above."""
    assert share(sources[category], 700, 20_000) > 0.3


def test_unknown_category_and_bad_length_are_refused():
    with pytest.raises(UsageError, match="did you mean 'toilet'"):
        synthesise("toilett", 2, np.random.default_rng(0))
    with pytest.raises(Avs3dError, match="expected 1 to 3600 s"):
        synthesise("toilet", 0.2, np.random.default_rng(0))


@pytest.mark.parametrize("suffix", ["wav", "flac"])
def test_recording_is_mixed_resampled_looped_and_levelled(tmp_path, suffix):
    stereo = np.stack([sine(1000, 2, 48_000, -12), sine(1000, 2, 48_000, -18)], axis=1)
    soundfile.write(tmp_path / f"tone.{suffix}", stereo, 48_000)
    source = load_sound(tmp_path / f"tone.{suffix}", 7)
    assert source.shape == (7 * SR,)
    assert integrated_loudness(source, SR) == pytest.approx(TARGET_LUFS, abs=0.1)
    power = np.abs(np.fft.rfft(source))
    assert np.fft.rfftfreq(len(source), 1 / SR)[power.argmax()] == pytest.approx(1000, abs=0.5)


def test_recording_may_begin_anywhere(tmp_path):
    noise = np.random.default_rng(0).normal(0, 0.1, 4 * SR)
    soundfile.write(tmp_path / "noise.wav", noise, SR, subtype="FLOAT")
    source = load_sound(tmp_path / "noise.wav", 2, start=0.25)
    assert np.corrcoef(source, noise[SR : 3 * SR])[0, 1] > 0.999
    assert load_sound(tmp_path / "noise.wav", 6, start=0.9).shape == (6 * SR,)


def test_loop_has_no_gap_and_no_jump():
    noise = np.random.default_rng(0).standard_normal(10_000)
    out = loop(noise, 45_000, 2000)
    assert len(out) == 45_000
    np.testing.assert_array_equal(out[:8000], noise[:8000])
    blocks = out.reshape(-1, 500).std(axis=1)
    assert blocks.min() > 0.85
    assert blocks.max() < 1.15
    np.testing.assert_array_equal(out[8000 + 2000 : 16_000], noise[2000:8000])
    ramp = loop(np.linspace(0, 1, 10_000), 30_000, 2000)
    assert np.abs(np.diff(ramp)).max() < 2e-3
    assert len(loop(noise, 300, 2000)) == 300


def broken_files(folder):
    good = sine(500, 2, SR, -10)
    soundfile.write(folder / "truncated.wav", good, SR)
    whole = (folder / "truncated.wav").read_bytes()
    (folder / "truncated.wav").write_bytes(whole[: len(whole) // 2])
    (folder / "text.wav").write_text("not a sound")
    holed = good.copy()
    holed[100] = np.nan
    soundfile.write(folder / "nan.wav", holed, SR, subtype="FLOAT")
    soundfile.write(folder / "silent.wav", np.zeros(SR), SR)
    soundfile.write(folder / "short.wav", good[:1000], SR)
    (folder / "folder.wav").mkdir()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing.wav", "no such sound file"),
        ("folder.wav", "no such sound file"),
        ("text.wav", "not a readable WAV or FLAC"),
        ("truncated.wav", "truncated"),
        ("nan.wav", "1 samples are NaN"),
        ("silent.wav", "silent"),
        ("short.wav", "lasts 0.02 s; expected at least 0.5 s"),
    ],
)
def test_bad_recording_is_named_in_one_line(tmp_path, name, message):
    broken_files(tmp_path)
    with pytest.raises(Avs3dError, match=message) as caught:
        load_sound(tmp_path / name, 3)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
