"""Random changes of sounds that keep their direction: times and levels between the ears stay, what is heard differs.

Microphones and rooms change a recording's spectrum and its decay, never the direction of its source. So the gains here
are without phase and, but for the small differences between heads, the same for both ears. `timing` moves what is heard
above some hundred hertz, as engines do whose heads have natural delays below it alone; the delay below and the levels
still say where the sound is. Each change has a name (`SOUND_CHANGES`) with which a run leaves it out.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
import torch
from torch import Tensor

from avs3d_bench.contract.layout import SAMPLE_RATE
from baselines.listener.features import HIGHEST, LOWEST, WINDOW, stft

#: Names of the changes; see the functions.
SOUND_CHANGES = ("gain", "noise", "eq", "ears", "timing", "band", "decay")
#: Range of gains (dB).
GAIN_DB = 6.0
#: Points of the spectrum with a random gain, log-spaced, and its standard deviation (dB): of both ears together, as
#: rooms and engines differ, and of each ear, as heads differ.
EQUALISED, TOGETHER_DB, APART_DB = 10, 3.0, 1.0
#: Share of sounds with another delay between the ears at high frequencies, by how much at most (s), and where the
#: octave ends within which it rises (Hz).
MISTIMED, DELAY_S, TIMED_HZ = 0.25, 3e-4, (400.0, 2000.0)
#: Share of sounds with a strong response, its largest tilt from end to end, and depth and number of its notches (dB).
COLOURED, TILT_DB, NOTCH_DB, NOTCHES = 0.6, 12.0, 12.0, 3
#: Share of sounds whose spectrum ends early, where (Hz), and the same of its beginning.
LIMITED, LOWPASS_HZ, HIGHPASSED, HIGHPASS_HZ = 0.5, (3000.0, 20_000.0), 0.3, (40.0, 400.0)
#: Order of the slope at the end; at the beginning it is half of such a number.
SLOPES = (2.0, 10.0)
#: Noise under a sound, below its level (dB); noise instead of a sound, level re full scale (dB).
NOISE_BELOW_DB, NOISE_ALONE_DB = (15.0, 50.0), (-90.0, -40.0)
#: Probabilities: noise under a sound, noise instead of silence.
NOISY, NOISE_ALONE = 0.5, 0.7
#: One sound in so many has less decay.
DRIED = 5
#: Share of sounds with more decay, its reverberation time (s), level below the sound (dB) and beginning (s).
LIVELY, DECAY_S, TAIL_DB, TAIL_AT = 0.3, (0.15, 0.8), (4.0, 20.0), 0.02
#: The least gain of what decays faster, and how fast its past is forgotten (s).
_LEAST_GAIN, _PAST_S = 0.25, 0.12
#: Bands of a disguise, its largest change of a band of a window (dB).
DISGUISE_BANDS, DISGUISE_DB = 24, 40.0


def uniform(generator: torch.Generator, count: int, low: float = 0.0, high: float = 1.0) -> Tensor:
    """(count,) uniform numbers."""
    return low + (high - low) * torch.rand(count, generator=generator, device=generator.device)


def level(sound: Tensor) -> Tensor:
    """(B,) RMS over both ears, never 0."""
    return sound.square().mean(dim=(1, 2)).sqrt().clamp(min=1e-7)


def changed_sounds(sounds: Tensor, generator: torch.Generator, without: Collection[str] = ()) -> Tensor:
    """Sounds (B, 2, n) as other microphones, rooms, heads and codecs would give them.

    Args:
        sounds: channel 0 left.
        generator: of random numbers, on the sounds' device.
        without: names of `SOUND_CHANGES` that are left out.
    """
    count = len(sounds)
    out = sounds if "decay" in without else drier(livelier(sounds, generator), generator)
    out = filtered(out, generator, without)
    if "gain" not in without:
        out = out * (10 ** (uniform(generator, count, -GAIN_DB, GAIN_DB) / 20))[:, None, None]
    return out if "noise" in without else noisy(out, generator)


def noisy(sounds: Tensor, generator: torch.Generator) -> Tensor:
    """The noise of a microphone, under a sound or instead of digital silence; white, or falling by the octave."""
    count = len(sounds)
    mine = level(sounds)
    silent = mine < 1e-6
    below = mine * 10 ** (-uniform(generator, count, *NOISE_BELOW_DB) / 20)
    alone = 10 ** (uniform(generator, count, *NOISE_ALONE_DB) / 20)
    chance = uniform(generator, count)
    amount = torch.where(silent, alone * (chance < NOISE_ALONE), below * (chance < NOISY))
    noise = torch.randn(sounds.shape, generator=generator, device=sounds.device)
    spectrum = torch.fft.rfft(noise)
    fall = uniform(generator, count, 0.0, 1.0)[:, None, None]
    frequency = _frequencies(sounds)
    noise = torch.fft.irfft(spectrum * (frequency / 1000.0) ** -fall, sounds.shape[-1])
    noise = noise / level(noise)[:, None, None]
    # In half of them both ears share most of the noise, as in a small room.
    shared = (uniform(generator, count) < 0.5)[:, None, None] * 0.7
    noise = (1 - shared) * noise + shared * noise.mean(dim=1, keepdim=True)
    out: Tensor = sounds + noise * amount[:, None, None]
    return out


def filtered(sounds: Tensor, generator: torch.Generator, without: Collection[str] = ()) -> Tensor:
    """Sounds through a random filter: another room, engine, head, microphone. It has no phase, but for `timing`."""
    frequency = _frequencies(sounds)
    decibels = torch.zeros(len(sounds), sounds.shape[1], len(frequency), device=sounds.device)
    together = 0.0 if "eq" in without else TOGETHER_DB
    apart = 0.0 if "ears" in without else APART_DB
    decibels = decibels + _curves(len(sounds), sounds.shape[1], frequency, (together, apart), generator)
    if "eq" not in without:
        decibels = decibels + _response(len(sounds), frequency, generator)[:, None]
    if "band" not in without:
        decibels = decibels + _limits(len(sounds), frequency, generator)[:, None]
    gain = torch.exp(decibels * (math.log(10) / 20))
    if "timing" not in without:
        phase = _timing(len(sounds), frequency, SAMPLE_RATE / sounds.shape[-1], generator)
        gain = torch.polar(gain, torch.stack([phase, -phase], dim=1))
    out: Tensor = torch.fft.irfft(torch.fft.rfft(sounds) * gain, sounds.shape[-1])
    return out


def _timing(count: int, frequency: Tensor, step: float, generator: torch.Generator) -> Tensor:
    """(B, F) phases (rad) of the left ear, with the other sign of the right one: in some, a delay above a corner.

    Args:
        count: B.
        frequency: (F,) of the bins (Hz).
        step: from one bin to the next (Hz).
        generator: of random numbers.
    """
    low, high = TIMED_HZ
    corner = low * (high / low) ** uniform(generator, count)[:, None]
    chosen = (uniform(generator, count) < MISTIMED)[:, None]
    rise = (1 + torch.log2(frequency / corner)).clamp(0, 1)
    delay = rise * chosen * uniform(generator, count, -DELAY_S, DELAY_S)[:, None]
    # The phase whose slope is the delay, half of it at each ear.
    return torch.cumsum(delay, dim=-1) * (math.pi * step)


def _frequencies(sounds: Tensor) -> Tensor:
    """(F,) Hz of the bins of a whole sound, within what the network hears."""
    out: Tensor = torch.fft.rfftfreq(sounds.shape[-1], 1 / SAMPLE_RATE, device=sounds.device).clamp(LOWEST, HIGHEST)
    return out


def _curves(
    count: int, ears: int, frequency: Tensor, spread: tuple[float, float], generator: torch.Generator
) -> Tensor:
    """(B, ears, F) dB, linear between random points over the logarithm of the frequency; together and apart."""

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator, device=frequency.device)

    together, apart = spread
    points = together * normal(count, 1, EQUALISED) + apart * normal(count, ears, EQUALISED)
    place = torch.log(frequency / LOWEST) / math.log(HIGHEST / LOWEST) * (EQUALISED - 1)
    below = place.floor().clamp(max=EQUALISED - 2).long()
    share = place - below
    out: Tensor = points[..., below] * (1 - share) + points[..., below + 1] * share
    return out


def _response(count: int, frequency: Tensor, generator: torch.Generator) -> Tensor:
    """(B, F) dB of some strong responses: a tilt from end to end, and notches or peaks."""
    place = torch.log(frequency / LOWEST) / math.log(HIGHEST / LOWEST)
    out = uniform(generator, count, -TILT_DB, TILT_DB)[:, None] * (2 * place - 1)
    for _ in range(NOTCHES):
        middle, width = uniform(generator, count)[:, None], uniform(generator, count, 0.02, 0.1)[:, None]
        depth = uniform(generator, count, -NOTCH_DB, NOTCH_DB)[:, None]
        out = out + depth * torch.exp(-0.5 * ((place - middle) / width).square())
    return out * (uniform(generator, count) < COLOURED)[:, None]


def _limits(count: int, frequency: Tensor, generator: torch.Generator) -> Tensor:
    """(B, F) dB of the ends of a spectrum: the magnitude of Butterworth's filters."""

    def edge(hertz: tuple[float, float]) -> Tensor:
        low, high = hertz
        return low * (high / low) ** uniform(generator, count)[:, None]

    def order() -> Tensor:
        return uniform(generator, count, *SLOPES)[:, None]

    above = (frequency / edge(LOWPASS_HZ)).log() * 2 * order()
    under = (edge(HIGHPASS_HZ) / frequency).log() * order()
    out = torch.zeros_like(above)
    for odds, share in ((above, LIMITED), (under, HIGHPASSED)):
        chosen = (uniform(generator, count) < share)[:, None]
        # 10·log10(1 + x), for x as large as e^80.
        out = out - chosen * torch.nn.functional.softplus(odds) * (10 / math.log(10))
    return out.clamp(min=-90.0)


def livelier(sounds: Tensor, generator: torch.Generator) -> Tensor:
    """Some sounds with a tail of decaying noise behind them, another one at each ear, as in a larger room.

    A clip is a piece of something longer: what runs over its end begins it, as if it had come from before.
    """
    count, ears, length = sounds.shape
    chosen = uniform(generator, count) < LIVELY
    time = torch.arange(length, device=sounds.device) / SAMPLE_RATE
    low, high = DECAY_S
    decay = low * (high / low) ** uniform(generator, count)[:, None, None]
    envelope = torch.exp(-6.91 * time / decay) * (time >= TAIL_AT)
    tail = torch.randn(count, ears, length, generator=generator, device=sounds.device) * envelope
    tail = tail / tail.square().sum(dim=-1, keepdim=True).sqrt().clamp(min=1e-6)
    wet = torch.fft.irfft(torch.fft.rfft(sounds) * torch.fft.rfft(tail), length)
    amount = 10 ** (-uniform(generator, count, *TAIL_DB) / 20) * chosen
    out: Tensor = sounds + wet * amount[:, None, None]
    return out


def drier(sounds: Tensor, generator: torch.Generator) -> Tensor:
    """One sound in `DRIED` with less decay: a bin that falls after something louder falls faster.

    The gains change from window to window (spectral subtraction of what the past leaves), the same for both ears.
    """
    count = len(sounds) // DRIED
    if not count:
        return sounds
    rows = torch.randperm(len(sounds), generator=generator, device=sounds.device)[:count]
    spectrum = stft(sounds[rows])
    power = spectrum.abs().square().mean(dim=1).clamp(min=1e-12)
    hop = WINDOW // 2 / SAMPLE_RATE
    length = max(1, round(3 * _PAST_S / hop))
    forget = math.exp(-hop / _PAST_S)
    kernel = forget ** torch.arange(length, 0, -1, device=power.device, dtype=power.dtype)
    past = torch.nn.functional.pad(power.flatten(0, 1)[:, None], (length, 0))[..., :-1]
    late = torch.nn.functional.conv1d(past, (kernel / kernel.sum())[None, None])[:, 0].view_as(power)
    strength = uniform(generator, count, 0.3, 1.0)[:, None, None]
    gain = (1 - strength * late / power).clamp(min=_LEAST_GAIN**2).sqrt()
    out = sounds.clone()
    out[rows] = _istft(spectrum * gain[:, None], sounds.shape)
    return out


def disguised(sounds: Tensor, others: Tensor) -> Tensor:
    """Sounds with the spectrum and the rhythm of others, as a vocoder gives: nothing known, from where it came.

    Each band of each window gets the power that the other sound has there; the gain is the same for both ears, so that
    phases and levels between them stay.

    Args:
        sounds: (B, 2, n).
        others: (B, 2, n), whose bands are taken.
    """
    mine, theirs = stft(sounds), stft(others)
    edges = np.unique(np.geomspace(2, WINDOW // 2 + 1, DISGUISE_BANDS + 1).round())
    of_bin = np.searchsorted(edges[1:], np.arange(WINDOW // 2 + 1), side="right").clip(max=len(edges) - 2)
    number = torch.from_numpy(of_bin).to(sounds.device)
    hot = torch.nn.functional.one_hot(number, len(edges) - 1).T.float()
    hot = hot / hot.sum(dim=1, keepdim=True)
    bands = [hot @ each.abs().square().mean(dim=1) for each in (mine, theirs)]
    scale = level(sounds).square() / level(others).square()
    floor = bands[0].mean(dim=(1, 2), keepdim=True) * 1e-6 + 1e-12
    ratio = (bands[1] * scale[:, None, None] + floor) / (bands[0] + floor)
    gain = (10 * torch.log10(ratio)).clamp(-DISGUISE_DB, DISGUISE_DB)
    gain = 10 ** (gain[:, number] / 20)
    out = _istft(mine * gain[:, None], sounds.shape)
    return out * (level(sounds) / level(out))[:, None, None]


def _istft(spectrum: Tensor, shape: torch.Size) -> Tensor:
    """As `torch.istft`, which makes the host wait for the device: each window overlaps half of the next one."""
    half, window = WINDOW // 2, torch.hann_window(WINDOW, device=spectrum.device)
    pieces = torch.fft.irfft(spectrum, WINDOW, dim=-2) * window[:, None]
    out = pieces[..., half:, :].clone()
    out[..., :-1] += pieces[..., :half, 1:]
    weight = window[half:].square()[:, None].repeat(1, out.shape[-1])
    weight[:, :-1] += window[:half].square()[:, None]
    found: Tensor = (out / weight).transpose(-1, -2).flatten(-2)[..., : shape[-1]]
    return found
