"""The listener's ears: features and direction map against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")

from avs3d_bench.contract.layout import SAMPLE_RATE  # noqa: E402
from baselines.listener import direction, features  # noqa: E402

torch.set_num_threads(1)
#: 90° field of view, centred.
CAMERA = torch.tensor([[0.5, 0.5, 0.5, 0.5]])


def noise(seed: int = 0, level: float = 0.1) -> torch.Tensor:
    """(n,) white noise."""
    return level * torch.randn(SAMPLE_RATE, generator=torch.Generator().manual_seed(seed))


def delayed(sound: torch.Tensor, seconds: float) -> torch.Tensor:
    """The sound later by any time, circularly."""
    at = torch.fft.rfftfreq(len(sound), 1 / SAMPLE_RATE)
    turn = torch.polar(torch.ones_like(at), -2 * math.pi * at * seconds)
    return torch.fft.irfft(torch.fft.rfft(sound) * turn, len(sound))


def heard_from(lateral: float, sound: torch.Tensor) -> torch.Tensor:
    """(1, 2, n): both ears, with Woodworth's delay alone; lateral angle in degrees, positive right."""
    delay = float(direction.woodworth_delay(torch.tensor(math.radians(lateral))))
    return torch.stack([delayed(sound, delay), sound])[None]


# ---- features


def test_a_full_scale_sine_has_the_level_of_its_band_and_no_other() -> None:
    time = torch.arange(SAMPLE_RATE) / SAMPLE_RATE
    frequency = float(features.frequencies()[100])
    both = features.spectra(torch.sin(2 * math.pi * frequency * time).expand(1, 2, -1))
    assert both.left.abs()[0, 100, 20].item() == pytest.approx(1.0, abs=1e-3)
    bands = features.band_features(both)[0, :, :, 20]
    loudest = int(bands[0].argmax())
    assert features.mel_filters()[loudest, 100] > 0
    quiet = (features.mel_filters()[:, 95:106] == 0).all(dim=1)
    assert (bands[0, quiet] < bands[0, loudest] - 40 / features.LEVEL_SCALE_DB).all()


def test_every_mel_filter_has_a_bin_and_the_sum_1() -> None:
    filters = features.mel_filters()
    assert filters.shape == (features.BANDS, features.WINDOW // 2 + 1)
    np.testing.assert_allclose(filters.sum(dim=1), 1.0, atol=1e-5)


def test_silence_is_visible() -> None:
    silent = torch.zeros(1, 2, SAMPLE_RATE)
    bands = features.band_features(features.spectra(silent))
    assert (bands[:, :2] == -1).all()
    assert (bands[:, 2:] == 0).all()
    assert features.broadband_levels(silent).tolist() == [[-1.0, -1.0, -1.0, 0.0]]
    loud = features.band_features(features.spectra(noise().expand(1, 2, -1)))
    assert loud[:, :2].mean() > 0


@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_a_gain_moves_levels_and_nothing_else(gain: float) -> None:
    sound = torch.stack([noise(1), noise(2)])[None]
    before, after = (features.band_features(features.spectra(s)) for s in (sound, gain * sound))
    change = 20 * math.log10(gain) / features.LEVEL_SCALE_DB
    torch.testing.assert_close(after[:, :2], before[:, :2] + change, atol=1e-4, rtol=0)
    torch.testing.assert_close(after[:, 2:], before[:, 2:], atol=2e-3, rtol=0)


def test_level_difference_is_right_minus_left() -> None:
    sound = noise()
    pair = torch.stack([sound, 10 ** (6 / 20) * sound])[None]
    bands = features.band_features(features.spectra(pair))
    torch.testing.assert_close(bands[:, 2], torch.full_like(bands[:, 2], 6 / features.DIFFERENCE_SCALE_DB))
    assert features.broadband_levels(pair)[0, 3].item() == pytest.approx(6 / features.DIFFERENCE_SCALE_DB, abs=1e-4)


def test_phase_of_a_delay_and_coherence() -> None:
    delay = 0.0002
    sound = noise()
    bands = features.band_features(features.spectra(torch.stack([delayed(sound, delay), sound])[None]))[0]
    at = float((features.mel_filters()[10] * features.frequencies()).sum())
    mean = bands[3:6, 10, 2:-2].mean(dim=-1)
    # The left ear lags: its phase is −2πfτ.
    assert math.atan2(mean[1], mean[0]) == pytest.approx(-2 * math.pi * at * delay, abs=0.05)
    assert mean[2] > 0.98
    apart = features.band_features(features.spectra(torch.stack([noise(1), noise(2)])[None]))[0]
    assert apart[5, 30:, 2:-2].mean() < 0.7


# ---- direction


@pytest.mark.parametrize("lateral", [-60, -30, -9, 0, 9, 30, 60])
def test_a_pure_delay_peaks_at_its_lateral_angle(lateral: int) -> None:
    response = direction.steered_response(features.spectra(heard_from(lateral, noise())))[0]
    angles = torch.rad2deg(direction.angle_grid())
    phase = len(direction.PHASE_GROUPS) - 1
    for together in (response[phase], response[phase + len(direction.VOTE_GROUPS)]):
        assert angles[together.argmax()].item() == pytest.approx(lateral, abs=3.01)
        assert together.max() > 0.8


def test_a_source_on_the_left_marks_the_left_half() -> None:
    cells = direction.pixel_angles(CAMERA, (63, 63))
    response = direction.steered_response(features.spectra(heard_from(-25, noise())))
    found = direction.direction_map(response, cells)[0, len(direction.PHASE_GROUPS) - 1]
    middle = found[31]
    assert int(middle.argmax()) < 31
    # Column of a direction 25° to the left at the height of the eye: 31.5 · (1 − tan 25°).
    assert int(middle.argmax()) == pytest.approx(31.5 * (1 - math.tan(math.radians(25))) - 0.5, abs=2)
    assert middle[:20].max() > middle[40:].max() + 0.2


def test_swapped_ears_mirror_the_map() -> None:
    sound = torch.stack([delayed(noise(1), 0.0003) + 0.3 * noise(2), 0.7 * noise(1)])[None]
    cells = direction.pixel_angles(CAMERA, (21, 21))
    one, other = (
        direction.direction_map(direction.steered_response(features.spectra(s)), cells) for s in (sound, sound.flip(1))
    )
    torch.testing.assert_close(one, other.flip(-1), atol=1e-4, rtol=1e-4)


def test_votes_follow_the_onset_and_not_the_reflection() -> None:
    # Bursts from 40° on the left; 30 ms after each, a louder reflection from 40° on the right.
    bursts = torch.zeros(SAMPLE_RATE)
    for start in range(4000, 40_000, 9000):
        bursts[start : start + 2200] = noise(start)[:2200]
    later = torch.roll(bursts, round(0.03 * SAMPLE_RATE))
    heard = heard_from(-40, bursts) + 1.3 * heard_from(40, later)
    response = direction.steered_response(features.spectra(heard))[0]
    votes = response[len(direction.PHASE_GROUPS) - 1 + len(direction.VOTE_GROUPS)]
    assert torch.rad2deg(direction.angle_grid())[votes.argmax()].item() == pytest.approx(-40, abs=4)


def test_votes_by_series_are_those_of_the_density() -> None:
    generator = torch.Generator().manual_seed(0)
    cross = torch.polar(torch.rand(2, 5, 7, generator=generator), 6.3 * torch.rand(2, 5, 7, generator=generator))
    cross[0, 0, 0] = 0
    weight = torch.rand(2, 5, 7, generator=generator)
    turn = 20 * torch.rand(5, direction.ANGLES, generator=generator)
    left = cross.angle()[..., None] + turn[:, None]
    density = torch.exp(direction.CONCENTRATION * (torch.cos(left) - 1))
    expected = (weight[..., None] * density).sum(dim=(1, 2))
    torch.testing.assert_close(direction._votes(cross, weight, turn), expected, atol=1e-4, rtol=1e-5)


def test_the_beginning_of_a_steady_sound_is_no_onset() -> None:
    steady = torch.ones(1, 3, 40)
    assert (direction.onset_weights(steady) == direction.STEADY).all()
    steady[..., 20:] = 10
    weights = direction.onset_weights(steady)[0, 0]
    assert weights[20] == 1
    assert (weights[:20] == direction.STEADY).all()
    assert weights[35] == direction.STEADY


def test_silence_points_nowhere() -> None:
    assert not direction.steered_response(features.spectra(torch.zeros(2, 2, SAMPLE_RATE))).any()


def test_the_head_shadow_is_that_of_brown_and_duda() -> None:
    # Equation 3 at the ears: α(0°) = 2 and α(150°) = 0.1; at high frequencies the gain is α.
    high = torch.tensor(1e7)
    assert direction.head_shadow_db(torch.tensor(0.0), high).item() == pytest.approx(0, abs=1e-4)
    right = direction.head_shadow_db(torch.tensor(math.pi / 3), high).item()
    incidence = 30 / 150 * math.pi
    near, far = 1.05 + 0.95 * math.cos(incidence), 0.1
    assert right == pytest.approx(20 * math.log10(near / far), abs=1e-3)
    assert direction.head_shadow_db(torch.tensor(math.pi / 3), torch.tensor(10.0)).item() == pytest.approx(0, abs=0.05)


def test_a_level_difference_peaks_where_the_head_shadow_has_it() -> None:
    lateral = math.radians(30)
    first = direction.CHANNELS - len(direction.LEVEL_GROUPS) + 1
    centre = math.sqrt(direction.LEVEL_GROUPS[0] * direction.LEVEL_GROUPS[1])
    louder = float(direction.head_shadow_db(torch.tensor(lateral), torch.tensor(centre)))
    sound = noise()
    pair = torch.stack([sound, 10 ** (louder / 20) * sound])[None]
    response = direction.steered_response(features.spectra(pair))[0, first]
    assert direction.angle_grid()[response.argmax()].item() == pytest.approx(lateral, abs=math.radians(3.1))


def test_pixels_look_up_their_lateral_angle() -> None:
    angles = direction.pixel_angles(CAMERA, (4, 4))
    # The ray of the top left cell is (−0.75, 0.75, 1) in units of the focal length.
    assert angles[0, 0, 0].item() == pytest.approx(math.asin(-0.75 / math.sqrt(0.75**2 * 2 + 1)))
    ramp = torch.rad2deg(direction.angle_grid())[None, None]
    torch.testing.assert_close(direction.direction_map(ramp, angles)[0, 0], torch.rad2deg(angles[0]))
