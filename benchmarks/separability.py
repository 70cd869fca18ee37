"""How well a mono recogniser tells the categories apart on voices and recordings that it never heard.

    python -m benchmarks.separability --recordings FOLDER -o FILE.json [--cnn]

A nearest neighbour on spectral and modulation features, and with ``--cnn`` a small convolutional network on log-mel
spectrograms, are trained on seconds of *train* voices, dry and reverberant, and asked about seconds of *validation* and
*test* voices and of recordings: as they are, low-passed at 4, 8 and 16 kHz, and with nothing below 8 kHz. A benchmark
whose sounds a fingerprint solves would be near 100 % on test voices; one whose sounds say nothing of real ones would be
at chance, 14 %, on recordings.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, fftconvolve, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from benchmarks.voices import recordings
from generators.assets.sounds import synthesise, voices
from generators.assets.sounds.recordings import resampled

Array = NDArray[np.float64]
Filter = Callable[[Array], Array]

#: Units of a voice, seconds of each, and where the seconds that are asked about begin.
UNITS, SECONDS = 5, 10
#: Bands of the mel spectrogram, samples of a hop and of a window.
MELS, HOP, WINDOW = 64, 441, 2048
#: Share of clips with reverberation, decay times (s) and direct-to-reverberant ratios (dB).
REVERBERANT, T60, DIRECT_DB = 0.5, (0.25, 0.9), (-9.0, 6.0)


@dataclass(frozen=True)
class Clips:
    """Seconds of sound.

    Attributes:
        samples: (n, 44100).
        labels: (n,) number of the category.
        names: (n,) ``category/voice`` or ``category/recording``.
    """

    samples: Array
    labels: NDArray[np.int64]
    names: list[str]

    def filtered(self, change: Filter) -> Clips:
        """The same clips through a filter."""
        return Clips(np.stack([change(clip) for clip in self.samples]), self.labels, self.names)


def of_voices(split: str, seed: int) -> Clips:
    """Seconds of all voices of a split; every unit is another one."""
    rng = np.random.default_rng(seed)
    found: list[tuple[Array, int, str]] = []
    for number, category in enumerate(CATEGORIES):
        for voice in voices(category):
            if voice.split != split:
                continue
            for _ in range(UNITS):
                signal = np.asarray(synthesise(category, SECONDS, rng, voice), dtype=np.float64)
                found += [(second, number, f"{category}/{voice.name}") for second in _seconds(signal, rng)]
    return _clips(found)


def of_recordings(folder: Path, seed: int) -> Clips:
    """Seconds of all recordings; one that is shorter is repeated."""
    rng = np.random.default_rng(seed)
    found: list[tuple[Array, int, str]] = []
    for number, category in enumerate(CATEGORIES):
        for name, (signal, rate) in recordings(folder, category).items():
            whole = resampled(signal, rate)
            whole = np.tile(whole, -(-SAMPLE_RATE // len(whole)))
            found += [(second, number, f"{category}/{name}") for second in _seconds(whole, rng)]
    return _clips(found)


def _clips(found: Sequence[tuple[Array, int, str]]) -> Clips:
    samples, labels, names = zip(*found, strict=True)
    return Clips(np.stack(samples), np.array(labels), list(names))


def _seconds(signal: Array, rng: np.random.Generator) -> list[Array]:
    """The whole seconds of a signal, some of them reverberant, at the same level; silent ones are left out."""
    wet = fftconvolve(signal, _response(rng))[: len(signal)] if rng.random() < REVERBERANT else signal
    whole = wet[: len(wet) // SAMPLE_RATE * SAMPLE_RATE].reshape(-1, SAMPLE_RATE)
    levels = np.sqrt(np.mean(np.square(whole), axis=1))
    loud = levels > 0.05 * levels.max()
    return list(whole[loud] / levels[loud, None])


def _response(rng: np.random.Generator) -> Array:
    """An impulse response: the direct sound and exponentially decaying noise, duller with time."""
    length = int(1.2 * SAMPLE_RATE)
    time = np.arange(length) / SAMPLE_RATE
    tail = rng.standard_normal(length) * np.exp(-6.91 * time / rng.uniform(*T60))
    dull = sosfilt(butter(1, 5000, "lowpass", fs=SAMPLE_RATE, output="sos"), tail)
    tail = dull / np.sqrt(np.sum(np.square(dull)))
    tail *= 10 ** (-rng.uniform(*DIRECT_DB) / 20)
    tail[0] += 1.0
    return np.asarray(tail)


def log_mel(clips: Array) -> NDArray[np.float32]:
    """(n, MELS, frames) log-mel power of clips (n, 44100), 50 Hz to 20 kHz."""
    bank = _mel_bank()
    frames = np.lib.stride_tricks.sliding_window_view(clips, WINDOW, axis=1)[:, ::HOP]
    out = [np.log10(bank @ (np.abs(np.fft.rfft(each * np.hanning(WINDOW))) ** 2).T + 1e-4) for each in frames]
    return np.asarray(out, dtype=np.float32)


def _mel_bank() -> Array:
    """(MELS, bins) triangular bands."""
    edges = np.geomspace(50, 20_000, MELS + 2)
    bins = np.fft.rfftfreq(WINDOW, 1 / SAMPLE_RATE)
    rising = (bins - edges[:-2, None]) / (edges[1:-1] - edges[:-2])[:, None]
    falling = (edges[2:, None] - bins) / (edges[2:] - edges[1:-1])[:, None]
    return np.clip(np.minimum(rising, falling), 0, None)


def features(clips: Array) -> Array:
    """(n, 3 · MELS) mean, spread and fast change of every mel band."""
    mel = log_mel(clips).astype(np.float64)
    return np.concatenate([mel.mean(axis=2), mel.std(axis=2), np.abs(np.diff(mel, axis=2)).mean(axis=2)], axis=1)


def nearest(train: Clips) -> Callable[[Array], NDArray[np.int64]]:
    """The label of the nearest training second, features standardised."""
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    model = make_pipeline(StandardScaler(), KNeighborsClassifier(1))
    model.fit(features(train.samples), train.labels)
    return lambda clips: np.asarray(model.predict(features(clips)))


def network(train: Clips, *, epochs: int = 12, seed: int = 0) -> Callable[[Array], NDArray[np.int64]]:
    """A network of four convolutions on log-mel spectrograms; training seconds are low-passed at random."""
    import torch
    from torch import nn

    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    cut = np.stack([low_pass(float(np.exp(rng.uniform(np.log(3000), np.log(21_000)))))(c) for c in train.samples])
    mel = np.concatenate([log_mel(train.samples), log_mel(cut)])
    mean, deviation = mel.mean(), mel.std()
    data = torch.from_numpy((mel - mean) / deviation)[:, None]
    labels = torch.from_numpy(np.tile(train.labels, 2))
    layers: list[Any] = []
    for before, after in ((1, 16), (16, 32), (32, 64), (64, 64)):
        layers += [nn.Conv2d(before, after, 3, padding=1), nn.BatchNorm2d(after), nn.ReLU(), nn.MaxPool2d(2)]
    layers += [nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(0.3), nn.Linear(64, len(CATEGORIES))]
    model = nn.Sequential(*layers)
    optimiser = torch.optim.AdamW(model.parameters(), 2e-3, weight_decay=1e-2)
    for _ in range(epochs):
        model.train()
        for index in torch.split(torch.randperm(len(data)), 64):
            optimiser.zero_grad()
            loss: Any = nn.functional.cross_entropy(model(data[index]), labels[index], label_smoothing=0.1)
            loss.backward()
            optimiser.step()
    model.eval()

    def ask(clips: Array) -> NDArray[np.int64]:
        with torch.no_grad():
            found = torch.from_numpy((log_mel(clips) - mean) / deviation)[:, None]
            return np.concatenate([model(part).argmax(dim=1).numpy() for part in torch.split(found, 256)])

    return ask


def low_pass(corner: float) -> Filter:
    """A filter that leaves what lies below ``corner`` (Hz)."""
    sections = butter(8, corner, "lowpass", fs=SAMPLE_RATE, output="sos")
    return lambda clip: np.asarray(sosfilt(sections, clip))


def top_alone(clip: Array) -> Array:
    """What lies above 8 kHz, at the level of the whole."""
    high = sosfilt(butter(8, 8000, "highpass", fs=SAMPLE_RATE, output="sos"), clip)
    return np.asarray(high / max(float(np.sqrt(np.mean(np.square(high)))), 1e-6))


#: What is done to the clips that are asked about.
CHANGES: dict[str, Filter] = {
    "whole": lambda clip: clip,
    "below 16 kHz": low_pass(16_000),
    "below 8 kHz": low_pass(8000),
    "below 4 kHz": low_pass(4000),
}


def verdict(ask: Callable[[Array], NDArray[np.int64]], asked: Clips) -> dict[str, Any]:
    """Share of right seconds, over all, by category and by voice, and the confusions."""
    found = ask(asked.samples)
    right = found == asked.labels
    names = np.array(asked.names)
    confusions = [[int(np.sum((asked.labels == a) & (found == b))) for b in range(len(CATEGORIES))]
                  for a in range(len(CATEGORIES))]  # fmt: skip
    present = [number for number in range(len(CATEGORIES)) if (asked.labels == number).any()]
    return {
        "seconds": len(right),
        "right": float(np.mean([right[asked.labels == number].mean() for number in present])),
        "by_category": {CATEGORIES[number]: float(right[asked.labels == number].mean()) for number in present},
        "by_name": {str(name): float(right[names == name].mean()) for name in dict.fromkeys(asked.names)},
        "confusions": confusions,
    }


def measure(folder: Path, *, cnn: bool, seed: int = 0) -> dict[str, Any]:
    """All verdicts: recogniser → set → change → verdict."""
    train = of_voices("train", seed)
    sets = {"validation": of_voices("validation", seed + 1), "test": of_voices("test", seed + 2)}
    sets["recordings"] = of_recordings(folder, seed + 3)
    recognisers = {"nearest neighbour": nearest(train)} | ({"network": network(train)} if cnn else {})
    report: dict[str, Any] = {
        name: {
            which: {change: verdict(ask, asked.filtered(CHANGES[change])) for change in CHANGES}
            for which, asked in sets.items()
        }
        for name, ask in recognisers.items()
    }
    top = nearest(train.filtered(top_alone))
    report["top octave alone"] = {"test": {"above 8 kHz": verdict(top, sets["test"].filtered(top_alone))}}
    return report


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--cnn", action="store_true")
    options = parser.parse_args(arguments)
    report = measure(options.recordings, cnn=options.cnn)
    options.output.write_text(json.dumps(report, indent=1), encoding="utf-8")
    for name, sets in report.items():
        for which, changes in sets.items():
            shares = ", ".join(f"{change} {each['right']:.2f}" for change, each in changes.items())
            print(f"{name}, {which}: {shares}")


if __name__ == "__main__":
    main()
