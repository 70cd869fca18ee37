"""One second of binaural sound as the network hears it: level, level difference and phase difference per mel band.

Levels are in dB re full scale with a fixed reference: nothing is normalised, so that silence looks like silence.
All functions take batches and run where the sound lies, on a CPU or a GPU, in float32.

Sources: the mel scale as in HTK (Young et al., *The HTK Book*); the interaural phase of a band is that of its
cross-spectrum, and its coherence the magnitude of the normalised cross-spectrum (Faller & Merimaa, "Source localization
in complex listening situations: selection of binaural cues based on interaural coherence", JASA 116 (2004) 3075-3089).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from avs3d_bench.contract.layout import SAMPLE_RATE

#: Window of the short-time Fourier transform, and its step (samples): 23 ms and 12 ms.
WINDOW, HOP = 1024, 512
BANDS = 64
#: Lowest and highest frequency of the mel bands (Hz).
LOWEST, HIGHEST = 50.0, 20_000.0
#: Levels below this count as silence (dB re full scale); 30 dB below what the benchmark calls audible.
FLOOR_DB = -90.0
#: Divisors that bring levels and level differences to about ±1 (dB).
LEVEL_SCALE_DB, DIFFERENCE_SCALE_DB = 30.0, 15.0
#: Windows over which cross-spectra are averaged before phase and coherence are read off.
SMOOTHED = 3
#: Channels of the picture of the sound: level left, level right, level difference, cos and sin of the phase
#: difference, coherence.
CHANNELS = 6


@dataclass(frozen=True)
class Spectra:
    """The short-time spectra of both ears, which the features and the direction map share.

    Attributes:
        left: (B, F, T) complex64.
        right: (B, F, T) complex64.
    """

    left: Tensor
    right: Tensor


def spectra(sound: Tensor) -> Spectra:
    """Short-time Fourier transform of both ears; a full-scale sine has magnitude 1 in its bin.

    Args:
        sound: (B, 2, n) float, channel 0 left.
    """
    found = stft(sound.float())
    found = found * (2 / torch.hann_window(WINDOW, device=sound.device).sum())
    return Spectra(found[:, 0], found[:, 1])


def stft(sounds: Tensor) -> Tensor:
    """(B, ears, F, T) complex64, the short-time Fourier transform of (B, ears, n) float32."""
    window = torch.hann_window(WINDOW, device=sounds.device)
    found = torch.stft(sounds.flatten(0, 1), WINDOW, HOP, window=window, center=True, pad_mode="constant",
                       return_complex=True)  # fmt: skip
    return found.view(*sounds.shape[:2], *found.shape[1:])


def frequencies(device: torch.device | None = None) -> Tensor:
    """(F,) Hz of the bins."""
    return torch.arange(WINDOW // 2 + 1, device=device) * (SAMPLE_RATE / WINDOW)


@lru_cache(maxsize=8)
def mel_filters(device: torch.device | None = None) -> Tensor:
    """(BANDS, F) triangular filters, equally spaced on the mel scale; each sums to 1."""
    lowest, highest = (2595 * math.log10(1 + edge / 700) for edge in (LOWEST, HIGHEST))
    mel = torch.linspace(lowest, highest, BANDS + 2)
    edges = 700 * (10 ** (mel / 2595) - 1)
    at = frequencies()
    rising = (at - edges[:-2, None]) / (edges[1:-1] - edges[:-2])[:, None]
    falling = (edges[2:, None] - at) / (edges[2:] - edges[1:-1])[:, None]
    filters = torch.minimum(rising, falling).clamp(min=0)
    return (filters / filters.sum(dim=1, keepdim=True)).to(device)


def decibels(power: Tensor) -> Tensor:
    """10·log10 of a power, not below `FLOOR_DB`."""
    return 10 * torch.log10(power.clamp(min=10 ** (FLOOR_DB / 10)))


def band_features(both: Spectra) -> Tensor:
    """(B, CHANNELS, BANDS, T) float32: what each mel band of each window holds.

    Where both ears are silent the levels are −1 and everything else is 0.
    """
    filters = mel_filters(both.left.device)
    powers = [filters @ ear.abs().square() for ear in (both.left, both.right)]
    levels = [decibels(power) for power in powers]
    # Its phase is positive where the left ear leads.
    cross = both.left * both.right.conj()
    real, imaginary = (_smooth(filters @ part) for part in (cross.real, cross.imag))
    magnitude = torch.sqrt(real.square() + imaginary.square())
    loudness = torch.sqrt(_smooth(powers[0]) * _smooth(powers[1]))
    floor = 10 ** (FLOOR_DB / 10)
    heard = loudness / (loudness + floor)
    return torch.stack(
        [
            *((level - FLOOR_DB) / LEVEL_SCALE_DB - 1 for level in levels),
            (levels[1] - levels[0]) / DIFFERENCE_SCALE_DB,
            heard * real / magnitude.clamp(min=1e-20),
            heard * imaginary / magnitude.clamp(min=1e-20),
            heard * magnitude / loudness.clamp(min=1e-20),
        ],
        dim=1,
    )


def broadband_levels(sound: Tensor) -> Tensor:
    """(B, 4) float32: level left, level right, of their sum, scaled like the bands; difference right − left."""
    sound = sound.float()
    left, right, both = (decibels(part.square().mean(-1)) for part in (sound[:, 0], sound[:, 1], sound.mean(1)))
    levels = [(level - FLOOR_DB) / LEVEL_SCALE_DB - 1 for level in (left, right, both)]
    return torch.stack([*levels, (right - left) / DIFFERENCE_SCALE_DB], dim=1)


def _smooth(values: Tensor) -> Tensor:
    """Running mean over `SMOOTHED` windows."""
    return avg_pool2d(values[:, None], (1, SMOOTHED), 1, (0, SMOOTHED // 2), count_include_pad=False)[:, 0]
