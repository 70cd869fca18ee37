"""Every voice beside the recordings of its category: spectrum, modulation, crest factor; a sheet of spectrograms.

    python -m benchmarks.voices --recordings FOLDER -o OUT [--category clock]

``FOLDER`` has a folder of sound files per category. A figure of a voice is within the spread if it lies between the
least and the largest of the recordings, widened by `MARGIN`; each recording is held to the others in the same way.
Octaves that a sample rate does not reach are left out.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy.signal import spectrogram

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES, OFF_SCREEN_CATEGORIES
from generators.assets.sounds import synthesise, voices

Array = NDArray[np.float64]

#: Centres of octave bands and of bands of modulation (Hz).
OCTAVES = (63, 125, 250, 500, 1000, 2000, 4000, 8000)
MODULATIONS = (1, 2, 4, 8, 16, 32)
#: By how much (dB) a figure may lie beyond those of the recordings: they are few.
MARGIN = 6.0
#: Seconds of each voice, and units of it.
SECONDS, UNITS = 12, 3


def figures(signal: Array, rate: int) -> dict[str, float]:
    """Figures of a sound, in dB: octave levels re the whole, modulation re the mean, crest factor, quiet moments."""
    spectrum = np.abs(np.fft.rfft(signal)) ** 2
    frequencies = np.fft.rfftfreq(len(signal), 1 / rate)
    total = spectrum[frequencies > 40].sum()
    out: dict[str, float] = {}
    for centre in OCTAVES:
        if centre * np.sqrt(2) <= 0.45 * rate:
            band = (frequencies >= centre / np.sqrt(2)) & (frequencies < centre * np.sqrt(2))
            out[f"octave {centre}"] = _db(spectrum[band].sum() / total)
    step = rate // 200
    whole = len(signal) // step * step
    envelope = np.sqrt(np.mean(np.square(signal[:whole].reshape(-1, step)), axis=1))
    swing = np.abs(np.fft.rfft((envelope - envelope.mean()) * np.hanning(len(envelope)))) ** 2
    rates = np.fft.rfftfreq(len(envelope), step / rate)
    unit = (envelope.mean() * len(envelope) / 2) ** 2
    for centre in MODULATIONS:
        band = (rates >= centre / np.sqrt(2)) & (rates < centre * np.sqrt(2))
        if band.any():
            out[f"modulation {centre}"] = _db(swing[band].sum() / unit)
    out["crest"] = 20 * float(np.log10(np.abs(signal).max() / np.sqrt(np.mean(np.square(signal)))))
    out["quiet"] = 20 * float(np.log10(np.percentile(envelope, 10) / np.sqrt(np.mean(np.square(envelope))) + 1e-6))
    return out


def _db(share: float) -> float:
    return 10 * float(np.log10(share + 1e-9))


def recordings(folder: Path, category: str) -> dict[str, tuple[Array, int]]:
    """Name → (n,) mono samples and sample rate."""
    found = {}
    for file in sorted((folder / category).glob("*")):
        samples, rate = soundfile.read(file, always_2d=True)
        found[file.stem] = (samples.mean(axis=1), rate)
    return found


def compare(category: str, folder: Path) -> tuple[dict[str, dict[str, float]], dict[str, list[str]]]:
    """Name → figures of all sounds, and name → what lies outside the spread of the (other) recordings."""
    known = {f"recording {name}": figures(*sound) for name, sound in recordings(folder, category).items()}
    table = dict(known)
    for voice in voices(category):
        units = [figures(_unit(category, voice.name, seed), SAMPLE_RATE) for seed in range(UNITS)]
        table[voice.name] = {key: float(np.mean([unit[key] for unit in units])) for key in units[0]}
    return table, {
        name: _outside(row, [other for key, other in known.items() if key != name]) for name, row in table.items()
    }


def _outside(row: dict[str, float], others: Sequence[dict[str, float]]) -> list[str]:
    found = []
    for key, value in row.items():
        spread = [other[key] for other in others if key in other]
        if spread and not min(spread) - MARGIN <= value <= max(spread) + MARGIN:
            found.append(f"{key}: {value:.1f} dB, recordings {min(spread):.1f} to {max(spread):.1f}")
    return found


def _unit(category: str, name: str, seed: int) -> Array:
    return np.asarray(synthesise(category, SECONDS, np.random.default_rng([seed, 33]), voice=name), dtype=np.float64)


def draw(category: str, folder: Path, out: Path) -> None:
    """A sheet of spectrograms (0–20 kHz, mel-like axis, 70 dB): recordings first, then the voices."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    sounds = [(f"recording {name}", *sound) for name, sound in recordings(folder, category).items()]
    sounds += [(f"{v.name} ({v.split})", _unit(category, v.name, 0), SAMPLE_RATE) for v in voices(category)]
    columns = 4
    rows = max(1, -(-len(sounds) // columns))
    figure = Figure(figsize=(4.2 * columns, 2.7 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    for number, (name, samples, rate) in enumerate(sounds):
        axes = figure.add_subplot(rows, columns, number + 1)
        frequencies, times, power = spectrogram(samples[: 12 * rate], rate, nperseg=1024, noverlap=512)
        level = 10 * np.log10(power + 1e-14)
        axes.pcolormesh(times, frequencies / 1000, level, vmin=level.max() - 70, vmax=level.max(), cmap="magma")
        axes.set_yscale("function", functions=(_mel, _from_mel))
        axes.set_yticks([0.25, 0.5, 1, 2, 4, 8, 16])
        axes.set_ylim(0.05, 20)
        axes.set_title(name, fontsize=9)
    figure.savefig(out / f"{category}.png", dpi=80)


def _mel(kilohertz: Array) -> Array:
    return np.log1p(np.asarray(kilohertz) / 0.7)


def _from_mel(value: Array) -> Array:
    return 0.7 * np.expm1(np.asarray(value))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--category", action="append", choices=CATEGORIES + OFF_SCREEN_CATEGORIES)
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    report = {}
    for category in options.category or CATEGORIES:
        table, outside = compare(category, options.recordings)
        draw(category, options.recordings, options.output)
        report[category] = {"figures": table, "outside": outside}
        for name, faults in outside.items():
            print(f"{category}/{name}: {'; '.join(faults) or 'within the spread'}")
        for what in (True, False):
            ours = [not faults for name, faults in outside.items() if name.startswith("recording ") is what]
            print(f"{category}: {sum(ours)} of {len(ours)} {'recordings' if what else 'voices'} within the spread")
    (options.output / "voices.json").write_text(json.dumps(report, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
