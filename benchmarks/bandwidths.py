"""Bandwidth and floor of the voices beside those of recordings.

    python -m benchmarks.bandwidths --recordings FOLDER [--recordings FOLDER …] -o FILE.json

Of takes of ten seconds: the bandwidth is the upper edge of the highest sixth of an octave that lies less than 60 dB
below the loudest; the floor is the 5th percentile of the level in 25 ms, re its median. ``FOLDER`` has a folder of
sound files per category; of a long recording, three takes from its start count.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.formats.files import write_json
from avs3d_bench.runtime.parallel import process_each
from benchmarks.voices import recordings
from generators.assets.sounds import synthesise, voices
from generators.assets.sounds.recordings import resampled

Array = NDArray[np.float64]

#: Seconds of a take, takes of a recording at most.
SECONDS, TAKES = 10, 3
#: How far below the loudest band (dB) a spectrum ends; edges of the bands (Hz); length of a short-time level (s).
DEPTH_DB, EDGES, STEP = 60.0, 62.5 * 2.0 ** (np.arange(51) / 6), 0.025
FIGURES = ("bandwidth", "floor")
#: Least, quartiles and largest.
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


def bandwidth(signal: Array) -> float:
    """Where the spectrum of a signal (n,) at 44,100 Hz ends, in kHz: at most 20.2."""
    frequencies, density = welch(signal, SAMPLE_RATE, nperseg=4096)
    place = np.digitize(frequencies, EDGES)
    power = np.bincount(place, density, minlength=len(EDGES) + 1)[1 : len(EDGES)]
    inside = np.flatnonzero(power > power.max() * 10 ** (-DEPTH_DB / 10))
    return float(EDGES[inside[-1] + 1] / 1000)


def floor(signal: Array) -> float:
    """The level of the quiet moments of a signal (n,) at 44,100 Hz, in dB re its median level: at least −120."""
    step = round(STEP * SAMPLE_RATE)
    power = np.mean(np.square(signal[: len(signal) // step * step].reshape(-1, step)), axis=1)
    low, median = np.percentile(power, (5, 50))
    return float(10 * np.log10(low / max(median, 1e-12) + 1e-12))


def of_recordings(folders: Sequence[Path]) -> dict[str, list[list[float]]]:
    """Category → (takes, 2) `FIGURES` of its recordings, of the categories that have some."""
    found: dict[str, list[list[float]]] = {}
    for category in CATEGORIES:
        for folder in folders:
            for signal, rate in recordings(folder, category).values():
                takes = _takes(resampled(signal, rate))
                # Images of the spectrum, which resampling leaves 50 to 60 dB below, are not the recording's.
                found.setdefault(category, []).extend(_figures(take, rate / 2000) for take in takes)
    return found


def _takes(signal: Array) -> Iterator[Array]:
    length = SECONDS * SAMPLE_RATE
    for start in range(0, max(1, len(signal) - length + 1), length)[:TAKES]:
        yield signal[start : start + length]


def of_voices(units: int, workers: int | None = None) -> dict[str, list[list[float]]]:
    """Category → (takes, 2) `FIGURES` of all its voices, a take of each of so many units."""
    tasks = [
        (category, voice.name, unit) for category in CATEGORIES for voice in voices(category) for unit in range(units)
    ]
    known = dict(process_each(_of_voice, tasks, workers=workers, label="voices"))
    return {category: [known[task] for task in tasks if task[0] == category] for category in CATEGORIES}


def _of_voice(task: tuple[str, str, int]) -> list[float]:
    category, name, unit = task
    rng = np.random.default_rng([unit, CATEGORIES.index(category), 34])
    return _figures(np.asarray(synthesise(category, SECONDS, rng, name), dtype=np.float64))


def _figures(signal: Array, highest: float = np.inf) -> list[float]:
    return [min(bandwidth(signal), highest), floor(signal)]


def quartiles(found: Mapping[str, Sequence[Sequence[float]]]) -> dict[str, Any]:
    """Category, and ``all`` → takes and, of each of `FIGURES`, the least, the three quartiles and the largest.

    In ``all``, every category counts alike: its takes are weighted by the reciprocal of their number.
    """
    out: dict[str, Any] = {}
    for category, takes in found.items():
        table = np.array(takes)
        out[category] = {"takes": len(table)} | {
            name: np.quantile(table[:, place], SHARES).tolist() for place, name in enumerate(FIGURES)
        }
    weights = np.concatenate([np.full(len(takes), 1 / len(takes)) for takes in found.values()])
    table = np.concatenate([np.array(takes) for takes in found.values()])
    out["all"] = {"takes": len(table)} | {
        name: np.quantile(table[:, place], SHARES, weights=weights, method="inverted_cdf").tolist()
        for place, name in enumerate(FIGURES)
    }
    return out


def table(report: Mapping[str, Any]) -> list[list[str]]:
    """Rows: category, takes, bandwidth and floor of the recordings, then of the voices: median, and the quartiles."""
    rows = []
    # A file of results has its keys sorted.
    for category in (*CATEGORIES, "all"):
        found, row = report["voices"].get(category), [category]
        for one in (report["recordings"].get(category), found):
            row += [str(one["takes"]), *(_spread(one[name]) for name in FIGURES)] if one else ["0", "", ""]
        rows.append(row)
    return rows


def _spread(found: Sequence[float]) -> str:
    return f"{found[2]:.1f} ({found[1]:.1f} to {found[3]:.1f})"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--recordings", type=Path, action="append", required=True, help="a folder with one per category"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="JSON")
    parser.add_argument("--units", type=int, default=4, help="of each voice [4]")
    parser.add_argument("--workers", type=int, default=None, help="processes [one per core]")
    options = parser.parse_args(arguments)
    report = {
        "recordings": quartiles(of_recordings(options.recordings)),
        "voices": quartiles(of_voices(options.units, options.workers)),
    }
    write_json(options.output, report)
    for row in table(report):
        print(*row, sep=" | ")


if __name__ == "__main__":
    main()
