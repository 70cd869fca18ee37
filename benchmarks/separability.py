"""How well a mono recogniser tells the categories apart on voices and recordings that it never heard.

    python -m benchmarks.separability --recordings FOLDER -o FILE.json [--cnn] [--left-out]
    python -m benchmarks.separability --learn-recordings -o FILE.json [--cnn] [--left-out]

A nearest neighbour on spectral and modulation features, and with ``--cnn`` small convolutional networks on log-mel
spectrograms (`separability_network`), are trained on seconds of *train* voices and asked about seconds of
*validation* and *test* voices and of recordings, each dry and reverberant: as they are, and low-passed at 4, 8 and 16
kHz. In brackets: takes of ten seconds, over which the answers are averaged. A benchmark whose sounds a fingerprint
solves would be near 100 % on test voices; one whose sounds say nothing of real ones would be at chance, 14 %, on
recordings. A third recogniser has nothing but the mean spectrum from 10 to 20 kHz. The nearest neighbour's training
seconds pass the same filter as those that are asked about; networks are trained once, on spectra that are changed at
random. With ``--left-out`` the neighbour is also asked about each training voice after training on the others, which
says how much of a miss is the distance between any two voices. ``--learn-recordings`` takes the recordings for
training in the lock file as further training voices, and asks about those for tests, both from the store (`avs3d
assets fetch`).
FILE.json holds one run, so that all its rows have one size; it is written after each recogniser.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, rfft
from scipy.signal import butter, fftconvolve, sosfilt, stft
from scipy.signal.windows import blackmanharris

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_json
from avs3d_bench.runtime.parallel import process_each
from benchmarks.recorded_manifests import MANIFESTS
from benchmarks.separability_network import MELS, RANGE, Mels, Network, Training, log_mel
from benchmarks.voices import recordings
from generators.assets.sounds import synthesise, voices
from generators.assets.sounds.recordings import load_sound, recorded_seconds, resampled
from generators.library.lock import LOCK_NAME, read_lock
from generators.library.store import Store

Array = NDArray[np.float64]
Second = tuple[NDArray[np.float32], int, str]
Filter = Callable[[Array], Array]
#: Set → change → verdict.
Verdicts = dict[str, dict[str, dict[str, Any]]]

#: Seconds of each unit of a voice.
SECONDS = 10
#: Networks whose answers are averaged.
NETWORKS = 5
#: Bands whose modulation is a feature, and edges of the bands of modulation (in bins of about 1 Hz).
MODULATED, MODULATION_BINS = 8, (1, 2, 3, 5, 9, 17, 33, 48)
#: Bands of the coarse spectrum, coefficients of cosine transforms over the bands, longest lag (hops).
COARSE, CEPSTRUM, LAGS = 16, 12, 58
#: What lies further below the loudest (powers of ten) counts as silence: some recordings are gated to nothing.
DEPTH = 6.0
#: Windows (samples) and edges of the bands (Hz) of the statistics of a texture, and lags (bands) of its correlations.
WINDOWS, TEXTURE_EDGES, APART = (128, 512, 2048), np.geomspace(100.0, 16_000.0, 25), (2, 4, 8)
#: A deviation below this part of the mean is none: a filtered band has numerical noise alone.
STEADY = 1e-3
#: Neighbours that are asked.
NEIGHBOURS = 15
#: Random subspaces, the share of the features in each, axes of the devices, share by which covariances are shrunk.
SUBSPACES, SHARE, AXES, SHRINKAGE = 16, 0.3, 20, 0.3
#: Added to the modulation before its logarithm is taken: what steady noise has.
MODULATION_FLOOR = 0.3
#: Decay times (s) and direct-to-reverberant ratios (dB) of seconds with reverberation.
T60, DIRECT_DB = (0.25, 0.9), (-9.0, 6.0)
#: Seeds of the voices of each split, of the recordings that are asked about and of those that are learnt.
SEEDS = {"train": 0, "validation": 1, "test": 2, "asked": 3, "learnt": 4}
#: What clips are without and with reverberation; the end of their names.
STATES = ("dry", "reverberant")


@dataclass(frozen=True)
class Clips:
    """Seconds of sound.

    Attributes:
        samples: (n, 44100) float32.
        labels: (n,) number of the category.
        names: (n,) ``category/voice/unit/state`` or ``category/recording/0/state``, with one of `STATES`.
    """

    samples: NDArray[np.float32]
    labels: NDArray[np.int64]
    names: list[str]

    @property
    def voices(self) -> NDArray[np.str_]:
        """(n,) ``category/voice`` of each clip."""
        return np.array([name.rsplit("/", 2)[0] for name in self.names])

    @property
    def states(self) -> NDArray[np.str_]:
        """(n,) one of `STATES` of each clip."""
        return np.array([name.rsplit("/", 1)[1] for name in self.names])


def prepared(of: Callable[[Array], Any], samples: NDArray[np.floating], change: str, workers: int | None = None) -> Any:
    """`features` or `log_mel` of clips (n, 44100) after one of `CHANGES`, in processes (None: one per core)."""
    from sklearn.utils.parallel import Parallel, delayed

    # Without `max_nbytes` joblib would copy all parts into shared memory before the first is done.
    ask = Parallel(n_jobs=workers or -1, max_nbytes=None)
    parts = ask(delayed(_prepared)(of, part, change) for part in _chunks(samples))
    return np.concatenate(parts)


def _prepared(of: Callable[[Array], Any], part: NDArray[np.floating], change: str) -> Any:
    return of(np.stack([CHANGES[change](clip) for clip in part]))


def of_voices(split: str, seed: int, units: int, workers: int | None) -> list[Clips]:
    """Seconds of each voice of a split, dry and reverberant; every unit is another one."""
    tasks = [
        (number, voice.name, (seed, number, place), units)
        for number, category in enumerate(CATEGORIES)
        for place, voice in enumerate(voices(category))
        if voice.split == split
    ]
    found = dict(process_each(_of_voice, tasks, workers=workers, label=f"{split} voices"))
    return [found[task] for task in tasks]


def _of_voice(task: tuple[int, str, tuple[int, ...], int]) -> Clips:
    number, name, seed, units = task
    rng, category = np.random.default_rng(seed), CATEGORIES[number]
    found = []
    for unit in range(units):
        signal = np.asarray(synthesise(category, SECONDS, rng, name), dtype=np.float64)
        found += _seconds(signal, rng, f"{category}/{name}/{unit}")
    return _clips(found)


def of_recordings(folder: Path, seed: int) -> Clips:
    """Seconds of all recordings, dry and reverberant; one that is shorter is repeated."""
    rng = np.random.default_rng(seed)
    found: list[Second] = []
    for category in CATEGORIES:
        for name, (signal, rate) in recordings(folder, category).items():
            whole = resampled(signal, rate)
            whole = np.tile(whole, -(-SAMPLE_RATE // len(whole)))
            found += _seconds(whole, rng, f"{category}/{name}/0")
    return _clips(found)


def of_lock(split: str, seed: int, units: int | None = None) -> Clips:
    """Seconds of the recordings of a split in the lock file that are in the store, dry and reverberant.

    Args:
        split: train, validation or test.
        seed: of excerpts and reverberation.
        units: excerpts of `SECONDS` of each, as a voice has units; None: each once, as a whole.

    Raises:
        Avs3dError: if there is none, or one is damaged.
    """
    store, lock = Store.default(), read_lock(MANIFESTS / LOCK_NAME)
    mine = store.recordings(lock, split)
    if not mine:
        raise Avs3dError(f"{store.root}: no recording of the split {split}; bring them: avs3d assets fetch")
    found: list[Second] = []
    for place, entry in enumerate(mine):
        rng, path = np.random.default_rng((seed, place)), store.path(entry)
        whole = max(1.0, recorded_seconds(path, entry.trim))
        for unit in range(units or 1):
            length, start = (SECONDS, float(rng.random())) if units else (whole, 0.0)
            samples = load_sound(path, length, start=start, trim=entry.trim).astype(np.float64)
            found += _seconds(samples, rng, f"{entry.category}/{entry.id}/{unit}")
    return _clips(found)


def joined(clips: list[Clips]) -> Clips:
    """Several sets of clips as one. Each leaves the list as it is copied: two copies of all would take 23 GB."""
    samples = np.empty((sum(len(one.names) for one in clips), SAMPLE_RATE), np.float32)
    labels: list[NDArray[np.int64]] = []
    names: list[str] = []
    while clips:
        one = clips.pop(0)
        samples[len(names) : len(names) + len(one.names)] = one.samples
        labels.append(one.labels)
        names += one.names
    return Clips(samples, np.concatenate(labels), names)


def _clips(found: Sequence[Second]) -> Clips:
    samples, labels, names = zip(*found, strict=True)
    return Clips(np.stack(samples), np.array(labels), list(names))


def _seconds(signal: Array, rng: np.random.Generator, name: str) -> list[Second]:
    """The whole seconds of a signal at the same level, silent ones left out: dry and reverberant."""
    found, number = [], CATEGORIES.index(name.split("/")[0])
    for state in STATES:
        heard = signal if state == "dry" else fftconvolve(signal, _response(rng))[: len(signal)]
        whole = heard[: len(heard) // SAMPLE_RATE * SAMPLE_RATE].reshape(-1, SAMPLE_RATE)
        levels = np.sqrt(np.mean(np.square(whole), axis=1))
        loud = levels > 0.05 * levels.max()
        seconds = (whole[loud] / levels[loud, None]).astype(np.float32)
        found += [(second, number, f"{name}/{state}") for second in seconds]
    return found


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


def features(clips: Array) -> Array:
    """(n, 580) features of clips (n, 44100) that depend on no level.

    The coarse spectrum re its mean; spread, fast change and unevenness of the mel bands; modulation spectra of eight
    wide bands and of the whole; the autocorrelation of the envelope up to .6 s; lines that stand out of their third of
    an octave (as the prominence of tones in ISO 7779); statistics of a texture (J. H. McDermott and E. P. Simoncelli,
    "Sound texture perception via statistics of the auditory periphery", Neuron 71 (2011) 926–940), which tell falling
    water, with its bubbles and drops, from air that rushes alike in the mean.
    """
    rows = []
    for part in _chunks(clips):
        mel = _of_spectrogram(log_mel(part).astype(np.float64))
        rows.append(np.concatenate([mel, _lines(part), *(_texture(part, window) for window in WINDOWS)], axis=1))
    return np.concatenate(rows)


def _chunks(clips: NDArray[np.floating]) -> list[NDArray[np.floating]]:
    return np.array_split(clips, -(-len(clips) // 256))


def _of_spectrogram(mel: Array) -> Array:
    mel = np.maximum(mel, mel.max(axis=(1, 2), keepdims=True) - DEPTH)
    mean = mel.reshape(len(mel), COARSE, -1, mel.shape[2]).mean(axis=(2, 3))
    spread = dct(mel.std(axis=2), axis=1, norm="ortho")[:, :CEPSTRUM]
    change = dct(np.abs(np.diff(mel, axis=2)).mean(axis=2), axis=1, norm="ortho")[:, :CEPSTRUM]
    uneven = np.abs(np.diff(mel, 2, axis=1)).mean(axis=2)[:, :60].reshape(len(mel), 12, 5).mean(axis=2)
    wide = mel.reshape(len(mel), MODULATED, -1, mel.shape[2]).mean(axis=2)
    whole = np.log10((10**mel).sum(axis=1, keepdims=True))
    modulation = [_modulation(course) for course in (wide, whole)]
    course = (whole - whole.mean(axis=2, keepdims=True))[:, 0]
    repeated = np.fft.irfft(np.abs(np.fft.rfft(course, 256, axis=1)) ** 2)[:, : LAGS + 2]
    repeated = (repeated / (repeated[:, :1] + 0.05))[:, 2::2]
    centred = mean - mean.mean(axis=1, keepdims=True)
    return np.concatenate([centred, spread, change, uneven, *modulation, repeated], axis=1)


def _modulation(course: Array) -> Array:
    """(n, bands · modulations) logarithms of the modulation spectrum of levels (n, bands, frames)."""
    frames = course.shape[2]
    swing = np.abs(np.fft.rfft((course - course.mean(axis=2, keepdims=True)) * np.hanning(frames), axis=2))
    bands = [swing[:, :, low:high].mean(axis=2) for low, high in pairwise(MODULATION_BINS)]
    return np.log(np.stack(bands, axis=2) + MODULATION_FLOOR).reshape(len(course), -1)


def _lines(clips: NDArray[np.floating]) -> Array:
    """(n, 46) per third of an octave: level of the highest line (dB re the median) and share of bins 14 dB above it."""
    window = blackmanharris(clips.shape[1]).astype(np.float32)
    power = np.abs(rfft(clips.astype(np.float32) * window, axis=1)) ** 2
    frequencies = np.fft.rfftfreq(clips.shape[1], 1 / SAMPLE_RATE)
    highest, share = [], []
    for low, high in pairwise(np.geomspace(45.0, 9000.0, 24)):
        band = 10 * np.log10(power[:, (frequencies >= low) & (frequencies < high)] + 1e-9)
        above = band - np.median(band, axis=1, keepdims=True)
        highest.append(above.max(axis=1))
        share.append((above > 14.0).mean(axis=1))
    return np.stack(highest + share, axis=1)


def _texture(clips: NDArray[np.floating], window: int) -> Array:
    """(n, 130) of 24 bands' envelopes: variation, skewness, kurtosis, and correlations of bands that lie apart."""
    spectrum = stft(clips.astype(np.float32), SAMPLE_RATE, nperseg=window, boundary=None, padded=False)[2]
    edges = TEXTURE_EDGES * window / SAMPLE_RATE
    spans = [(max(1, int(low)), max(int(low) + 2, int(np.ceil(high)))) for low, high in pairwise(edges)]
    power = np.stack([(np.abs(spectrum[:, low:high]) ** 2).sum(axis=1) for low, high in spans], axis=1)
    envelope = np.sqrt(power + 10**-DEPTH * power.mean(axis=(1, 2), keepdims=True))
    mean, deviation = (each(envelope, axis=2, keepdims=True) for each in (np.mean, np.std))
    score = (envelope - mean) / (deviation + STEADY * mean)
    columns = [np.log(deviation[..., 0] / mean[..., 0] + 0.02), np.arcsinh((score**3).mean(axis=2))]
    columns += [np.log1p((score**4).mean(axis=2))]
    columns += [(score[:, lag:] * score[:, :-lag]).mean(axis=2) for lag in APART]
    return np.concatenate(columns, axis=1).astype(np.float64)


def nearest(
    known: Array, labels: NDArray[np.int64], devices: NDArray[np.str_], asked: Array, workers: int | None = None
) -> Array:
    """(n, categories) shares of the categories among the nearest training seconds, a mean over random subspaces.

    Each of `SUBSPACES` sees `SHARE` of the features (T. K. Ho, "Nearest neighbors in random subspaces", SSPR 1998), so
    that no few of them decide: recordings lie far outside of what voices have in some. In each, neighbours are sought
    twice, in the axes that tell the categories apart and in those that tell the devices apart.

    Args:
        known: (m, features) of the training seconds.
        labels: (m,) numbers of their categories.
        devices: (m,) their voices.
        asked: (n, features).
        workers: processes; None: one per core.
    """
    from sklearn.utils.parallel import Parallel, delayed

    rng = np.random.default_rng(0)
    width = max(1, round(SHARE * known.shape[1]))
    chosen = [rng.permutation(known.shape[1])[:width] for _ in range(SUBSPACES)]
    ask = delayed(_in_subspace)
    jobs = (ask(known[:, one], labels, devices, asked[:, one]) for one in chosen)
    return np.asarray(np.mean(Parallel(n_jobs=workers or -1)(jobs), axis=0))


def _in_subspace(known: Array, labels: NDArray[np.int64], devices: NDArray[np.str_], asked: Array) -> Array:
    """(n, categories): a linear discriminant analysis of standardised features, covariances shrunk, then neighbours."""
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.preprocessing import StandardScaler

    scaler = StandardScaler().fit(known)
    known, asked = scaler.transform(known), scaler.transform(asked)
    out = np.zeros((len(asked), len(CATEGORIES)))
    for groups in (labels, devices):
        most = min(AXES, known.shape[1], len(np.unique(groups)) - 1)
        axes = LinearDiscriminantAnalysis(solver="eigen", shrinkage=SHRINKAGE, n_components=most).fit(known, groups)
        neighbours = KNeighborsClassifier(min(NEIGHBOURS, len(known)), weights="distance")
        neighbours.fit(axes.transform(known), labels)
        out[:, neighbours.classes_] += neighbours.predict_proba(axes.transform(asked)) / 2
    return out


def low_pass(corner: float) -> Filter:
    """A filter that leaves what lies below ``corner`` (Hz)."""
    sections = butter(8, corner, "lowpass", fs=SAMPLE_RATE, output="sos")
    return lambda clip: np.asarray(sosfilt(sections, clip))


def of_top_octave(train: Clips, mel: Mels, sets: Mapping[str, Clips], workers: int | None = None) -> Verdicts:
    """Verdicts of the nearest mean spectrum from 10 to 20 kHz: what a band edge would tell, without the course in time.

    Args:
        train: the training seconds.
        mel: (n, MELS, frames) their `log_mel`.
        sets: what is asked about.
        workers: processes; None: one per core.

    Returns:
        set → change → verdict.
    """
    from sklearn.neighbors import KNeighborsClassifier

    centres = np.geomspace(*RANGE, MELS + 2)[1:-1]

    def top(spectra: Mels) -> Array:
        bands = spectra.mean(axis=2)[:, centres > 10_000]
        return np.asarray(bands - bands.mean(axis=1, keepdims=True), dtype=np.float64)

    model = KNeighborsClassifier(5).fit(top(mel), train.labels)
    found: Verdicts = {}
    for which, asked in sets.items():
        answers = model.predict(top(prepared(log_mel, asked.samples, "whole", workers)))
        found[which] = {"whole": verdict(np.eye(len(CATEGORIES))[answers], asked)}
    return found


#: Training voices, each asked about after training on the others.
LEFT_OUT = "training, each left out"
#: What is done to the clips that are asked about.
CHANGES: dict[str, Filter] = {
    "whole": lambda clip: clip,
    "below 16 kHz": low_pass(16_000),
    "below 8 kHz": low_pass(8000),
    "below 4 kHz": low_pass(4000),
}


def left_out(train: Clips, known: Array, workers: int | None = None) -> Array:
    """(n, categories) answers of the nearest neighbour about each training voice, after training on the others.

    One voice of each category that has one left is left out at a time.

    Args:
        train: the training seconds.
        known: (n, features) their features.
        workers: processes; None: one per core.
    """
    of_category: dict[str, list[str]] = {}
    names = train.voices
    for voice in dict.fromkeys(names):
        of_category.setdefault(voice.split("/")[0], []).append(voice)
    out = np.zeros((len(known), len(CATEGORIES)))
    for held in zip_longest(*of_category.values()):
        asked = np.isin(names, [voice for voice in held if voice])
        out[asked] = nearest(known[~asked], train.labels[~asked], names[~asked], known[asked], workers)
    return out


def verdict(probabilities: Array, asked: Clips) -> dict[str, Any]:
    """Shares of right seconds and of right takes (the mean over a take's seconds decides), and the confusions.

    ``seconds`` and ``takes`` are means over the categories that are there, also of each of `STATES` alone.

    Args:
        probabilities: (n, categories) answers of a recogniser.
        asked: the clips that it was asked about.
    """
    found, voice = probabilities.argmax(axis=1), asked.voices
    right = found == asked.labels
    confusions = np.zeros((len(CATEGORIES),) * 2, dtype=int)
    np.add.at(confusions, (asked.labels, found), 1)
    return {
        "count": len(right),
        **_shares(probabilities, asked, np.full(len(right), True)),
        **{state: _shares(probabilities, asked, asked.states == state) for state in STATES},
        "by_category": {name: float(right[asked.labels == n].mean()) for n, name in _present(asked.labels)},
        "by_voice": {str(name): float(right[voice == name].mean()) for name in dict.fromkeys(voice)},
        "confusions": confusions.tolist(),
    }


def _shares(probabilities: Array, asked: Clips, these: NDArray[np.bool_]) -> dict[str, float]:
    """``seconds`` and ``takes`` of a `verdict` over some of the clips; nothing without clips."""
    if not these.any():
        return {}
    names = np.array(asked.names)
    takes = [these & (names == name) for name in dict.fromkeys(names[these])]
    of_takes = np.array([asked.labels[take][0] for take in takes])
    right_takes = np.array([probabilities[take].mean(axis=0).argmax() for take in takes]) == of_takes
    right, labels = probabilities[these].argmax(axis=1) == asked.labels[these], asked.labels[these]
    return {
        "seconds": share_of(right, labels),
        "takes": share_of(right_takes, of_takes),
    }


def share_of(right: NDArray[np.bool_], labels: NDArray[np.int64]) -> float:
    """The share of right answers (n,), as a mean over the categories that are among the labels (n,)."""
    return float(np.mean([right[labels == number].mean() for number, _ in _present(labels)]))


def _present(labels: NDArray[np.int64]) -> list[tuple[int, str]]:
    return [(number, name) for number, name in enumerate(CATEGORIES) if (labels == number).any()]


def of_neighbours(
    train: Clips, sets: Mapping[str, Clips], workers: int | None = None, leave_out: bool = False
) -> Verdicts:
    """Verdicts of the nearest neighbour: set → change → verdict; ``leave_out``: also of each training voice."""
    found: Verdicts = {which: {} for which in sets}
    for name in CHANGES:
        known = prepared(features, train.samples, name, workers)
        if leave_out:
            found.setdefault(LEFT_OUT, {})[name] = verdict(left_out(train, known, workers), train)
        for which, asked in sets.items():
            unknown = prepared(features, asked.samples, name, workers)
            found[which][name] = verdict(nearest(known, train.labels, train.voices, unknown, workers), asked)
    return found


def of_networks(
    train: Clips, mel: Mels, sets: Mapping[str, Clips], training: Training, workers: int | None = None
) -> Verdicts:
    """Verdicts of the mean answer of networks that differ by their seeds: one alone varies by some points.

    Args:
        train: what they are trained on.
        mel: (n, MELS, frames) its `log_mel`.
        sets: what they are asked about.
        training: how they are trained.
        workers: processes; None: one per core.

    Returns:
        set → change → verdict.
    """
    trained = [Network(mel, train.labels, training, seed) for seed in range(NETWORKS)]
    found: Verdicts = {which: {} for which in sets}
    for which, asked in sets.items():
        for name in CHANGES:
            unknown = prepared(log_mel, asked.samples, name, workers)
            found[which][name] = verdict(np.mean([one.probabilities(unknown) for one in trained], axis=0), asked)
    return found


def measured(
    train: Clips,
    sets: Mapping[str, Clips],
    *,
    training: Training | None = None,
    workers: int | None = None,
    leave_out: bool = False,
) -> Iterator[tuple[str, Verdicts]]:
    """Recognisers and their verdicts, those first that take least time.

    Args:
        train: what the recognisers are trained on.
        sets: what they are asked about.
        training: how the networks are trained; None: there are none.
        workers: processes; None: one per core.
        leave_out: whether neighbours are also asked about each training voice after training on the others.
    """
    mel = prepared(log_mel, train.samples, "whole", workers)
    yield "10 to 20 kHz alone", of_top_octave(train, mel, sets, workers)
    if training is not None:
        yield "network", of_networks(train, mel, sets, training, workers)
    yield "nearest neighbour", of_neighbours(train, sets, workers, leave_out)


def shares_table(report: Mapping[str, Any]) -> list[list[str]]:
    """Rows: recogniser, set, then for each change right seconds and, in brackets, right takes."""
    # By name: a file of results has its keys sorted.
    return _rows(report, lambda changes: map(changes.get, CHANGES))


def states_table(report: Mapping[str, Any]) -> list[list[str]]:
    """Rows: recogniser, set, then for each of `STATES` right seconds and, in brackets, right takes; whole spectra."""
    return _rows(report, lambda changes: map(changes["whole"].get, STATES))


def _rows(report: Mapping[str, Any], cells: Callable[[Mapping[str, Any]], Iterable[Any]]) -> list[list[str]]:
    return [
        [name, which, *(f"{v['seconds']:.2f} ({v['takes']:.2f})" if v else "" for v in cells(changes))]
        for name, sets in report.items()
        for which, changes in sets.items()
    ]


def confusions_table(verdict_: Mapping[str, Any]) -> list[list[str]]:
    """Rows: the true category, then the share of its seconds (%) that were taken for each."""
    rows = []
    for name, counts in zip(CATEGORIES, verdict_["confusions"], strict=True):
        whole = max(1, sum(counts))
        rows.append([name, *(f"{100 * count / whole:.0f}" for count in counts)])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked = parser.add_mutually_exclusive_group(required=True)
    asked.add_argument("--recordings", type=Path, help="a folder with a folder of files per category")
    asked.add_argument("--learn-recordings", action="store_true", help="learn from recordings for training, too")
    parser.add_argument("-o", "--output", type=Path, required=True, help="JSON")
    parser.add_argument("--units", type=int, default=40, help="of each training voice [40]")
    parser.add_argument("--asked", type=int, default=10, help="units of each voice that is asked about [10]")
    parser.add_argument("--workers", type=int, default=None, help="processes [one per core]")
    parser.add_argument("--cnn", action="store_true", help="train the network, too")
    parser.add_argument("--left-out", action="store_true", help="leave out each training voice in turn, too (slow)")
    options = parser.parse_args(arguments)
    # Recordings first: where they are missing, that is said before minutes go into voices.
    learnt = [of_lock("train", SEEDS["learnt"], options.units)] if options.learn_recordings else []
    heard = (
        of_lock("test", SEEDS["asked"])
        if options.learn_recordings
        else of_recordings(options.recordings, SEEDS["asked"])
    )
    train = joined([*of_voices("train", SEEDS["train"], options.units, options.workers), *learnt])
    sets = {
        split: joined(of_voices(split, SEEDS[split], options.asked, options.workers))
        for split in ("validation", "test")
    }
    sets["recordings"] = heard
    report: dict[str, Verdicts] = {}
    training = Training() if options.cnn else None
    for name, found in measured(train, sets, training=training, workers=options.workers, leave_out=options.left_out):
        report[name] = found
        write_json(options.output, report)
        for which, changes in found.items():
            shares = ", ".join(f"{change} {v['seconds']:.2f} ({v['takes']:.2f})" for change, v in changes.items())
            print(f"{name}, {which}: {shares}", flush=True)


if __name__ == "__main__":
    try:
        main()
    except Avs3dError as error:
        sys.exit(f"separability: error: {error}")
