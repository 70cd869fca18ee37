"""A small network that tells categories apart by log-mel spectrograms, and what its training spectra go through.

Voices were made by one program and recordings by as many microphones, rooms and codecs as there are recordings. What a
network learns of the response, the ends of the spectrum and the floor of voices is wrong for recordings. So each
training second passes another recording chain each time that it is seen (`Training`), and what lies far below the
loudest band of a second is not seen at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES

Array = NDArray[np.float64]
Mels = NDArray[np.float32]

#: Bands of the mel spectrogram, samples of a hop and of a window; the lowest and the highest frequency (Hz).
MELS, HOP, WINDOW, RANGE = 64, 441, 2048, (50.0, 20_000.0)
#: Clips of a step of the training; the level of what is hidden.
_BATCH, _HIDDEN = 128, -10.0
#: Knots of a random response over the bands, seconds of noise that floors are cut from.
_KNOTS, _NOISE = 9, 64


@dataclass(frozen=True)
class Training:
    """How the networks are trained: changes of the spectra, what is seen of them, and the size of the networks.

    Attributes:
        epochs: passes over the training seconds.
        width: channels of the first layer.
        dropout: share of the last layer's inputs.
        decay: weight decay.
        shift: standard deviation of a shift of all bands (bands of .13 octave): devices of another speed or size.
        response_db: standard deviation of the response at nine knots over the bands.
        tilt_db: standard deviation of a tilt from the lowest to the highest band.
        ends: share of the clips whose spectrum ends at a random band above ``end_hz``.
        end_hz: lowest frequency at which a spectrum ends.
        begins: share of the clips whose spectrum begins at a random band below 300 Hz.
        floors: share of the clips with a floor of noise, sloped by −9 to 3 dB per octave.
        floor_db: levels of the floor re the clip, lowest and highest.
        hidden_time: share of the frames that is hidden.
        depth_db: what lies further below the loudest band of a clip is not seen.
        asked_hz: of clips that are asked about, what lies above is hidden, as it is of the training clips that end.
    """

    epochs: int = 25
    width: int = 32
    dropout: float = 0.4
    decay: float = 2e-2
    shift: float = 1.5
    response_db: float = 7.5
    tilt_db: float = 0.0
    ends: float = 0.5
    end_hz: float = 3000.0
    begins: float = 0.0
    floors: float = 0.6
    floor_db: tuple[float, float] = (-50.0, -15.0)
    hidden_time: float = 0.15
    depth_db: float = 60.0
    asked_hz: float = 6000.0


def log_mel(clips: NDArray[np.floating]) -> Mels:
    """(n, MELS, frames) logarithms (base 10) of the mel power of clips (n, 44100), 50 Hz to 20 kHz."""
    bank = _mel_bank()
    frames = np.lib.stride_tricks.sliding_window_view(clips, WINDOW, axis=1)[:, ::HOP]
    out = [np.log10(bank @ (np.abs(np.fft.rfft(each * np.hanning(WINDOW))) ** 2).T + 1e-4) for each in frames]
    return np.asarray(out, dtype=np.float32)


def _mel_bank() -> Array:
    """(MELS, bins) triangular bands."""
    edges = np.geomspace(*RANGE, MELS + 2)
    bins = np.fft.rfftfreq(WINDOW, 1 / SAMPLE_RATE)
    rising = (bins - edges[:-2, None]) / (edges[1:-1] - edges[:-2])[:, None]
    falling = (edges[2:, None] - bins) / (edges[2:] - edges[1:-1])[:, None]
    return np.clip(np.minimum(rising, falling), 0, None)


def band_of(frequency: float) -> float:
    """The number of the band (a fraction) whose centre is ``frequency`` (Hz)."""
    return float(np.log(frequency / RANGE[0]) / np.log(RANGE[1] / RANGE[0]) * (MELS + 1) - 1)


class Network:
    """Four convolutions on log-mel spectrograms, trained with changed spectra, on a GPU where there is one.

    Args:
        mel: (n, MELS, frames) `log_mel` of the training seconds.
        numbers: (n,) of their categories.
        training: changes and size.
        seed: of weights and changes.
    """

    def __init__(self, mel: Mels, numbers: NDArray[np.int64], training: Training, seed: int = 0) -> None:
        import torch
        from torch import nn

        torch.manual_seed(seed)
        self._device = "cuda" if torch.cuda.is_available() else "cpu"
        self._training = training
        data, labels = self._tensor(mel), torch.from_numpy(numbers).to(self._device)
        noise = self._tensor(log_mel(np.random.default_rng(seed).standard_normal((_NOISE, SAMPLE_RATE))))
        self._model = self._layers()
        optimiser = torch.optim.AdamW(self._model.parameters(), 2e-3, weight_decay=training.decay)
        steps = training.epochs * (-(-len(data) // _BATCH))
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps)
        # Categories have different numbers of seconds that are not silent.
        weight = len(labels) / torch.bincount(labels, minlength=len(CATEGORIES)).clamp(1)
        self._model.train()
        for _ in range(training.epochs):
            for index in torch.split(torch.randperm(len(data), device=self._device), _BATCH):
                optimiser.zero_grad()
                answer = self._answer(changed(data[index], noise, training))
                loss: Any = nn.functional.cross_entropy(
                    answer, labels[index], weight=weight / weight.mean(), label_smoothing=0.1
                )
                loss.backward()
                optimiser.step()
                schedule.step()
        self._model.eval()

    def _layers(self) -> Any:
        from torch import nn

        wide = self._training.width
        layers: list[Any] = []
        for before, after in ((1, wide), (wide, 2 * wide), (2 * wide, 4 * wide), (4 * wide, 4 * wide)):
            layers += [nn.Conv2d(before, after, 3, padding=1), nn.BatchNorm2d(after), nn.ReLU(), nn.MaxPool2d(2)]
        layers += [nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(self._training.dropout)]
        return nn.Sequential(*layers, nn.Linear(4 * wide, len(CATEGORIES))).to(self._device)

    def _answer(self, spectra: Any) -> Any:
        import torch

        with torch.autocast(self._device, torch.bfloat16, enabled=self._device == "cuda"):
            return self._model(seen(spectra, self._training)).float()

    def _tensor(self, mel: Mels) -> Any:
        import torch

        # The narrowest bands have no bin of the spectrum: their neighbours' level.
        there = np.flatnonzero(_mel_bank().any(axis=1))
        nearest = there[np.abs(np.arange(MELS)[:, None] - there).argmin(axis=1)]
        return torch.from_numpy(mel[:, nearest])[:, None].to(self._device)

    def probabilities(self, mel: Mels, asked_hz: float | None = None) -> Array:
        """(n, categories) of clips whose `log_mel` is ``mel``; ``asked_hz`` in place of that of the training."""
        import torch

        data = self._tensor(mel)
        data[:, :, int(band_of(asked_hz or self._training.asked_hz)) + 1 :] = _HIDDEN
        with torch.no_grad():
            parts = [self._answer(part).softmax(dim=1) for part in torch.split(data, 256)]
        return np.asarray(torch.cat(parts).cpu().numpy(), dtype=np.float64)


def changed(batch: Any, noise: Any, training: Training) -> Any:
    """Spectrograms as other devices, rooms, microphones and formats would leave them.

    Args:
        batch: (n, 1, MELS, frames) tensor of logarithms of power.
        noise: (m, 1, MELS, frames), of white noise.
        training: what is changed.

    Returns:
        (n, 1, MELS, frames); what is hidden has `_HIDDEN`.
    """
    import torch

    n, _, bands, frames = batch.shape

    def normal() -> Any:
        return torch.randn(n, 1, 1, 1, device=batch.device)

    def uniform(low: float = 0.0, high: float = 1.0) -> Any:
        return low + (high - low) * torch.rand(n, 1, 1, 1, device=batch.device)

    band = torch.arange(bands, device=batch.device).view(1, 1, -1, 1)
    time = torch.arange(frames, device=batch.device).view(1, 1, 1, -1)
    if training.shift:
        batch = _between(batch, band + training.shift * normal())
    knots = training.response_db / 10 * torch.randn(n, 1, _KNOTS, 1, device=batch.device)
    response = torch.nn.functional.interpolate(knots, (bands, 1), mode="bilinear", align_corners=True)
    batch = batch + response + training.tilt_db / 10 * normal() * (band / (bands - 1) - 0.5)
    if training.floors:
        chosen = noise[torch.randint(len(noise), (n,), device=batch.device)]
        # Bands have .13 octave each.
        chosen = chosen + uniform(-0.9, 0.3) * (8.64 / (bands + 1)) * band
        below = uniform(training.floor_db[0] / 10, training.floor_db[1] / 10)
        chosen = chosen - _level(chosen) + _level(batch) + below
        batch = torch.where(uniform() < training.floors, _sum(batch, chosen), batch)
    last = torch.where(uniform() < training.ends, uniform(band_of(training.end_hz), bands), bands)
    first = torch.where(uniform() < training.begins, uniform(0.0, band_of(300.0)), 0.0)
    hidden = (band > last) | (band < first)
    start = uniform(0.0, frames)
    hidden = hidden | ((time >= start) & (time < start + training.hidden_time * frames))
    return torch.where(hidden, _HIDDEN, batch)


def _sum(one: Any, other: Any) -> Any:
    """Logarithms of the sum of the powers."""
    import torch

    return torch.logaddexp(one * np.log(10), other * np.log(10)) / np.log(10)


def _level(batch: Any) -> Any:
    return (batch * np.log(10)).logsumexp(dim=(2, 3), keepdim=True) / np.log(10)


def _between(batch: Any, places: Any) -> Any:
    """Spectrograms at fractions of bands, linear between; reflected at the ends."""
    import torch

    count = batch.shape[2]
    places = (count - 1) - (torch.remainder(places, 2 * (count - 1)) - (count - 1)).abs()
    low = places.floor().long().clamp(max=count - 2)
    part = places - low
    index = low.expand(*batch.shape[:2], -1, batch.shape[3])
    return (1 - part) * batch.gather(2, index) + part * batch.gather(2, index + 1)


def seen(batch: Any, training: Training) -> Any:
    """What a network sees of spectrograms (n, 1, MELS, frames): the level re the loudest band, a unit is 20 dB."""
    import torch

    power = (batch * np.log(10)).exp().mean(dim=3, keepdim=True).amax(dim=2, keepdim=True)
    depth = training.depth_db / 10
    level = (batch - torch.log10(power + 1e-10)).clamp(min=-depth)
    return level / 2 + depth / 4
