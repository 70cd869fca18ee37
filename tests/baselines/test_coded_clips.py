"""benchmarks/coded_clips.py: the same dataset with clips that a codec changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract.layout import BINAURAL
from avs3d_bench.formats.media import read_wav
from baselines.listener.codecs import CODECS, coded, drawn
from benchmarks.coded_clips import main
from tests.support.shared import SharedDataset

RATE = 44_100


@pytest.mark.parametrize("codec", CODECS)
def test_a_tone_keeps_its_place_and_a_smaller_stream_is_worse(codec: str) -> None:
    """Both ears keep level and delay (0.3 ms, 6 dB); more loss costs fewer bits and leaves a larger error."""
    time = np.arange(RATE) / RATE
    noise = np.random.default_rng(1).standard_normal(RATE) * 0.02
    left = (np.sin(2 * np.pi * 440 * time) * 0.2 + noise).astype(np.float32)
    ears = np.stack([left, 0.5 * np.roll(left, 13)])
    (fine, most), (coarse, fewest) = (coded(ears, RATE, codec, level) for level in (0.1, 0.95))
    assert most > fewest > 16
    errors = [float(np.square(each - ears).mean() / np.square(ears).mean()) for each in (fine, coarse)]
    assert errors[0] < errors[1] < 0.1
    for each in (fine, coarse):
        assert each.shape == ears.shape
        lags = np.fft.irfft(np.fft.rfft(each[1]) * np.conj(np.fft.rfft(each[0])))
        assert np.argmax(lags) == 13
        assert np.linalg.norm(each[1]) / np.linalg.norm(each[0]) == pytest.approx(0.5, rel=0.05)


def test_vorbis_at_low_rates_loses_the_phase_between_the_ears_and_keeps_it_at_high_ones() -> None:
    """Why training codes its sounds: above 1 kHz and at some 100 kbit/s a delay of 0.3 ms is heard no more."""
    left = np.random.default_rng(2).standard_normal(RATE).astype(np.float32) * 0.1
    ears = np.stack([left, 0.5 * np.roll(left, 13)])

    def lost(level: float) -> float:
        heard = np.fft.rfft(coded(ears, RATE, "ogg", level)[0])
        clean = np.fft.rfft(ears)
        high = slice(1000, 8000)
        turned = np.angle(heard[0] * heard[1].conj() * (clean[0] * clean[1].conj()).conj())[high]
        return float(np.degrees(np.sqrt(np.mean(turned**2))))

    assert lost(0.1) < 20
    assert lost(0.97) > 40


def test_what_is_learnt_from_has_a_codec_and_a_level_of_its_own_and_is_not_clipped() -> None:
    left = np.random.default_rng(3).standard_normal(RATE).astype(np.float32) * 0.1
    ears = np.stack([left, 0.5 * np.roll(left, 13)])
    found = [drawn(ears, np.random.default_rng(seed)) for seed in range(8)]
    errors = [float(np.square(each - ears).mean() / np.square(ears).mean()) for each in found]
    assert len({round(error, 4) for error in errors}) > 5
    assert all(0.01 < error < 1 for error in errors)
    np.testing.assert_array_equal(found[3], drawn(ears, np.random.default_rng(3)))
    assert np.abs(drawn(10 * ears, np.random.default_rng(0))).max() > 2


def test_only_the_clips_differ(shared_part_3: SharedDataset, tmp_path: Path) -> None:
    """Files are the same, by link or by content; clips have the same length and other samples."""
    root, copy = shared_part_3(frames=17), tmp_path / "copy"
    found = CliRunner().invoke(main, [str(root), "-o", str(copy), "--codec", "ogg"])
    assert found.exit_code == 0, found.output
    files = sorted(path.relative_to(root) for path in root.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(copy) for path in copy.rglob("*") if path.is_file())
    changed = {file for file in files if (root / file).read_bytes() != (copy / file).read_bytes()}
    assert changed
    assert all(file.parent.name == BINAURAL for file in changed)
    for file in changed:
        before, after = read_wav(root / file), read_wav(copy / file)
        assert (before.samples.shape, before.rate) == (after.samples.shape, after.rate)


def test_an_existing_folder_is_kept(shared_part_3: SharedDataset, tmp_path: Path) -> None:
    found = CliRunner().invoke(main, [str(shared_part_3(frames=17)), "-o", str(tmp_path)])
    assert found.exit_code == 1
    assert found.output == f"Error: {tmp_path} exists; name a folder that does not\n"


def test_a_copy_inside_its_original_is_refused(shared_part_3: SharedDataset) -> None:
    root = shared_part_3(frames=17)
    before = sorted(root.rglob("*"))
    found = CliRunner().invoke(main, [str(root), "-o", str(root / "copy")])
    assert found.exit_code == 1
    assert found.output == f"Error: {root / 'copy'} lies in {root}, which is copied; name a folder outside\n"
    assert sorted(root.rglob("*")) == before


def test_a_level_that_libsndfile_refuses_leaves_nothing(shared_part_3: SharedDataset, tmp_path: Path) -> None:
    """libsndfile writes no MP3 at its highest level."""
    root = shared_part_3(frames=17)
    found = CliRunner().invoke(main, [str(root), "-o", str(tmp_path / "copy"), "--codec", "mp3", "--level", "1"])
    assert found.exit_code == 1
    assert found.output.startswith("Error: mp3 at --level 1: ")
    assert not any(tmp_path.iterdir())
