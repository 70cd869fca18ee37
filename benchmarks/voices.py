"""Every voice beside the recordings of its category: spectrum, modulation, crest factor; a sheet of spectrograms.

    python -m benchmarks.voices [--recordings FOLDER] -o OUT [--category clock]

Recordings are those of the lock file, which must be in the store (`avs3d assets fetch`), each cut to its trim;
``FOLDER`` has further ones, in a folder of sound files per category. A figure of a voice is within the spread if it
lies between the least and the largest of the recordings, widened by `MARGIN`; each recording is held to the others in
the same way. Octaves that a sample rate, or the capture of a voice's unit, does not reach are left out. OUT gets
voices.json, and a sheet per category (voices-CATEGORY.jpg) on which recordings have their number in voices.json.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy.signal import spectrogram

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.formats.files import write_bytes, write_json
from benchmarks.recorded_manifests import MANIFESTS
from generators.assets.sounds import CEILING_DB, TARGET_LUFS, find_voice, voices
from generators.assets.sounds.capture import Capture
from generators.assets.sounds.loudness import normalised
from generators.library.lock import LOCK_NAME, read_lock
from generators.library.store import open_asset

Array = NDArray[np.float64]
#: Name → (n,) mono samples and their sample rate.
Sounds = dict[str, tuple[Array, int]]

#: Centres of octave bands and of bands of modulation (Hz).
OCTAVES = (63, 125, 250, 500, 1000, 2000, 4000, 8000)
MODULATIONS = (1, 2, 4, 8, 16, 32)
#: By how much (dB) a figure may lie beyond those of the recordings: they are few.
MARGIN = 6.0
#: Seconds of each voice, and units of it.
SECONDS, UNITS = 12, 3
#: Largest size of a sheet (bytes), and the qualities of JPEG that are tried.
SHEET_BYTES, QUALITIES = 150_000, range(80, 20, -5)


class Unit(NamedTuple):
    """A unit of a voice: (n,) samples at `SAMPLE_RATE`, and where the spectrum of its capture ends (Hz)."""

    signal: Array
    end: float


def figures(signal: Array, rate: int, end: float = np.inf) -> dict[str, float]:
    """Figures of a sound, in dB: octave levels re the whole, modulation re the mean, crest factor, quiet moments.

    Args:
        signal: (n,) mono samples.
        rate: their sample rate (Hz).
        end: where its spectrum ends by the capture (Hz).

    Returns:
        Name → figure; without the octaves that reach beyond 0.9 of half the sample rate, or of ``end``.
    """
    spectrum = np.abs(np.fft.rfft(signal)) ** 2
    frequencies = np.fft.rfftfreq(len(signal), 1 / rate)
    total = spectrum[frequencies > 40].sum()
    out: dict[str, float] = {}
    for centre in OCTAVES:
        if centre * np.sqrt(2) <= 0.9 * min(rate / 2, end):
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


def recordings(folder: Path, category: str) -> Sounds:
    """The sound files of a category in a folder of recordings."""
    found = {}
    for file in sorted((folder / category).glob("*")):
        samples, rate = soundfile.read(file, always_2d=True)
        found[file.stem] = (samples.mean(axis=1), rate)
    return found


def recordings_of_lock(category: str, lock: Path = MANIFESTS / LOCK_NAME) -> Sounds:
    """The recordings of a category in the lock file, each cut to its trim.

    Raises:
        Avs3dError: if one is not in the store.
    """
    found = {}
    for entry in read_lock(lock).assets:
        if entry.kind == "sound" and entry.category == category:
            samples, rate = soundfile.read(open_asset(lock, entry.id)[0], always_2d=True)
            begin, end = entry.trim or (0.0, len(samples) / rate)
            found[entry.id] = (samples[round(begin * rate) : round(end * rate)].mean(axis=1), rate)
    return found


def compare(ours: Mapping[str, Sequence[Unit]], known: Sounds) -> dict[str, Any]:
    """Figures of recordings and of voices, and what of each lies outside the spread of the (other) recordings.

    Args:
        ours: voice → its units.
        known: the recordings of its category.

    Returns:
        ``recordings`` and ``voices``: name → ``figures``, means over the units that have them, and ``outside``.
    """
    heard = {name: figures(*sound) for name, sound in known.items()}
    report: dict[str, Any] = {"recordings": {}, "voices": {}}
    for number, (name, row) in enumerate(heard.items(), 1):
        others = [other for key, other in heard.items() if key != name]
        report["recordings"][name] = {"number": number, "figures": row, "outside": _outside(row, others)}
    for name, drawn in ours.items():
        units = [figures(unit.signal, SAMPLE_RATE, unit.end) for unit in drawn]
        keys = dict.fromkeys(key for unit in units for key in unit)
        row = {key: float(np.mean([unit[key] for unit in units if key in unit])) for key in keys}
        report["voices"][name] = {"figures": row, "outside": _outside(row, list(heard.values()))}
    return report


def _outside(row: Mapping[str, float], others: Sequence[Mapping[str, float]]) -> dict[str, list[float]]:
    """Figure → the sound's, and the least and the largest of the others, where it lies outside of them."""
    found = {}
    for key, value in row.items():
        spread = [other[key] for other in others if key in other]
        if spread and not min(spread) - MARGIN <= value <= max(spread) + MARGIN:
            found[key] = [value, min(spread), max(spread)]
    return found


def spread_table(report: Mapping[str, Any]) -> list[list[str]]:
    """Rows: category, recordings, those within the spread of the others, voices within it, what lies outside."""
    rows = []
    for category in CATEGORIES:
        found = report[category]
        inside = {what: sum(not one["outside"] for one in found[what].values()) for what in ("recordings", "voices")}
        # By the order of the voices: a file of results has its keys sorted.
        outside = {voice.name: found["voices"][voice.name]["outside"] for voice in voices(category)}
        rows.append(
            [
                category.replace("_", " "),
                str(len(found["recordings"])),
                str(inside["recordings"]),
                f"{inside['voices']} of {len(found['voices'])}",
                _outliers(outside) or "–",
            ]
        )
    return rows


def _outliers(outside: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Figures with their spread, and the voices beyond it (dB)."""
    found: dict[str, list[str]] = {}
    for voice, faults in outside.items():
        for key, (value, least, most) in faults.items():
            title = f"{key}{' Hz' if ' ' in key else ''} ({least:.0f} to {most:.0f})"
            found.setdefault(title, []).append(f"`{voice}` {value:.0f}")
    return "; ".join(f"{title}: {', '.join(beyond)}" for title, beyond in found.items()).replace("-", "−")


def _faults(outside: Mapping[str, Sequence[float]]) -> str:
    return "; ".join(f"{key} {a:.1f} dB, recordings {b:.1f} to {c:.1f}" for key, (a, b, c) in outside.items())


def unit_of(category: str, name: str, seed: int) -> Unit:
    """A unit as `synthesise` makes it, and where its capture ends."""
    rng = np.random.default_rng([seed, 33])
    sound = find_voice(category, name).play(SECONDS * SAMPLE_RATE, rng)
    capture = Capture.drawn(rng)
    source = normalised(capture.heard(sound, rng), SAMPLE_RATE, TARGET_LUFS, CEILING_DB)
    return Unit(np.asarray(source, dtype=np.float64), capture.end)


def sheet(sounds: Sounds) -> bytes:
    """A JPEG of spectrograms (0–20 kHz, mel-like axis, 12 s, 70 dB), at most `SHEET_BYTES`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    columns = 5
    rows = max(1, -(-len(sounds) // columns))
    figure = Figure(figsize=(13.0, 1.75 * rows), layout="constrained", dpi=80)
    FigureCanvasAgg(figure)
    for number, (name, (samples, rate)) in enumerate(sounds.items()):
        axes = figure.add_subplot(rows, columns, number + 1)
        frequencies, times, power = spectrogram(samples[: SECONDS * rate], rate, nperseg=1024 * rate // 44_100 or 1)
        level = 10 * np.log10(power + 1e-14)
        axes.pcolormesh(times, frequencies / 1000, level, vmin=level.max() - 70, vmax=level.max(), cmap="magma")
        axes.set_yscale("function", functions=(_mel, _from_mel))
        axes.set_yticks([0.25, 1, 4, 16], ["¼", "1", "4", "16"])
        axes.set(xlim=(0, SECONDS), ylim=(0.05, 20))
        axes.tick_params(labelsize=7)
        axes.set_title(name, fontsize=8)
    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=80)
    picture = Image.open(drawn).convert("RGB")
    data = b""
    for quality in QUALITIES:
        stream = BytesIO()
        picture.save(stream, "JPEG", quality=quality, optimize=True)
        data = stream.getvalue()
        if len(data) <= SHEET_BYTES:
            break
    return data


def _mel(kilohertz: Array) -> Array:
    return np.log1p(np.asarray(kilohertz) / 0.7)


def _from_mel(value: Array) -> Array:
    return 0.7 * np.expm1(np.asarray(value))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=Path, help="a folder with further ones, in one per category")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--category", action="append", choices=CATEGORIES)
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    report = {}
    for category in options.category or CATEGORIES:
        known = recordings_of_lock(category)
        if options.recordings:
            known |= recordings(options.recordings, category)
        found = voices(category)
        ours = {voice.name: [unit_of(category, voice.name, seed) for seed in range(UNITS)] for voice in found}
        report[category] = compare(ours, known)
        shown = {f"recording {number}": sound for number, sound in enumerate(known.values(), 1)}
        shown |= {f"{voice.name} ({voice.split})": (ours[voice.name][0].signal, SAMPLE_RATE) for voice in found}
        write_bytes(options.output / f"voices-{category}.jpg", sheet(shown))
        write_json(options.output / "voices.json", report)
        for what, rows in report[category].items():
            for name, row in rows.items():
                print(f"{category}/{name}: {_faults(row['outside']) or 'within the spread'}")
            inside = sum(not row["outside"] for row in rows.values())
            print(f"{category}: {inside} of {len(rows)} {what} within the spread", flush=True)


if __name__ == "__main__":
    main()
