"""Attacks that compare the clips of siblings: which of two plays the same take as a third?

An attacker who finds one take in several siblings need not listen: equal samples tell which siblings share a source,
and subtraction isolates the other ones. The question *take* has a reference and two candidates, siblings of one group
in which the same category sounds. One of the candidates has the very object that sounds in the reference; the other has
a twin, or a source in another room.

All attacks look for what belongs to the take alone. They whiten what they compare (Knapp and Carter, "The generalized
correlation method for estimation of time delay", IEEE TASSP 24 (1976) 320-327), since spectra, levels and reverberation
tell the category and the place, which is what whoever listens may know.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.linalg import solve_toeplitz
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal import stft, welch

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.formats import files, media
from benchmarks.sealed_cases import Array, Case

Clips = NDArray[np.float32]
#: Compares what two observations sound like, clips (frames, 2, 44100) each: the larger, the more alike.
Likeness = Callable[[Clips, Clips], float]

RATE = layout.SAMPLE_RATE
#: Frequencies that are compared (Hz).
LOWEST, HIGHEST = 100.0, 16_000.0
#: Bands of `band_correlation` (Hz).
BANDS = ((100.0, 800.0), (800.0, 3200.0), (3200.0, 16_000.0))
#: Largest lag within a clip (s): more than the paths through a home differ by.
LONGEST_LAG = 0.1
#: Largest lag of two clips that the same source makes at the same place (samples).
NO_LAG = 1
#: Coefficients of the filter of `explained`, from as many samples before the moment as after it.
TAPS = 33
#: Hop and number of bands of the spectral envelope (samples).
HOP, ENVELOPE_BANDS = 441, 16
#: What is this far below the loudest moment of a band is no sound (dB).
FLOOR_DB = 60.0
#: Spectral lines are this far above the median over this width (dB, Hz), in a spectrum of this resolution (samples).
LINE_DB, LINE_WIDTH, LINE_BLOCK = 9.0, 50.0, 32_768
#: Seed of the order of the candidates.
ORDER_SEED = 17
_TINY = 1e-20


@dataclass(frozen=True)
class Sibling:
    """What sounds in an observation of part_3.

    Attributes:
        key: of the observation.
        group: key of the first of its group.
        sources: (category, instance) of each source; instance None: in another room.
    """

    key: str
    group: str
    sources: tuple[tuple[str, int | None], ...]

    @classmethod
    def of(cls, record: ObservationRecord) -> Sibling:
        """From the observation's record."""
        sources = tuple((source.category, source.instance) for source in record.sources or ())
        return cls(record.key, record.group or record.key, sources)


def load_takes(public: Path, private: Path) -> list[Case]:
    """The questions *take* about a sealed test, or about any tree and its truth."""
    paths = sorted(private.glob(f"part_3/*/*/*/{layout.OBSERVATION_JSON}"))
    return take_cases(public, [Sibling.of(files.read_record(path, ObservationRecord)) for path in paths])


def take_cases(public: Path, siblings: Iterable[Sibling]) -> list[Case]:
    """The questions *take* about the siblings of all groups; no observation is in two of them."""
    groups: dict[str, list[Sibling]] = {}
    for one in sorted(siblings, key=lambda one: one.key):
        groups.setdefault(one.group, []).append(one)
    rng = np.random.default_rng(ORDER_SEED)
    cases = []
    for group in groups.values():
        left = [group[number] for number in rng.permutation(len(group))]
        while found := next(_triples(left), None):
            left = [one for one in left if one not in found]
            reference, same, other = found
            truth = int(rng.integers(2))
            keys = (other.key, same.key) if truth else (same.key, other.key)
            cases.append(
                Case("take", public, keys, ("", ""), (), np.zeros((0, 0, 0), np.uint16), truth, reference=reference.key)
            )
    return cases


def _triples(group: Sequence[Sibling]) -> Iterator[tuple[Sibling, Sibling, Sibling]]:
    """Reference, the sibling with the same object, and one with another source of its category."""
    for reference in group:
        for category, instance in reference.sources:
            if instance is None:
                continue
            for same in group:
                if same is reference or (category, instance) not in same.sources:
                    continue
                for other in group:
                    mine = {source for source in other.sources if source[0] == category}
                    if mine and (category, instance) not in mine and not mine & set(reference.sources):
                        yield reference, same, other


@lru_cache(maxsize=3)
def clips_of(folder: Path) -> Clips:
    """(frames, 2, 44100) the binaural clips of an observation."""
    paths = sorted((folder / layout.BINAURAL).glob("*.wav"), key=lambda path: layout.frame_index(path.stem))
    return np.stack([media.read_wav(path).samples for path in paths]).astype(np.float32)


def whitened(spectrum: NDArray[np.complexfloating], used: NDArray[np.bool_]) -> NDArray[np.complex128]:
    """A spectrum with magnitudes of 1 at the frequencies ``used``, else 0."""
    size = np.abs(spectrum)
    keep = used & (size > _TINY)
    return np.asarray(np.where(keep, spectrum / np.where(keep, size, 1.0), 0.0))


def correlation(one: Array, other: Array, used: NDArray[np.bool_], length: int) -> Array:
    """(..., length) correlation of whitened signals (..., n) over all lags, 1 where they are equal."""
    a, b = (whitened(rfft(signal, length), used) for signal in (one, other))
    return np.asarray(irfft(a * b.conj(), length) * length / (2 * max(int(used.sum()), 1)))


def _band(length: int, low: float = LOWEST, high: float = HIGHEST) -> NDArray[np.bool_]:
    frequency = rfftfreq(length, 1 / RATE)
    return np.asarray((frequency >= low) & (frequency <= high))


def _largest(found: Array, lags: int) -> float:
    """Mean over signals of the largest absolute correlation at lags up to ``lags``."""
    near = np.abs(np.concatenate([found[..., : lags + 1], found[..., -lags:]], axis=-1))
    return float(near.max(axis=-1).mean())


def _both_sound(one: Clips, other: Clips) -> Iterator[tuple[Array, Array]]:
    """The clips (2, 44100) of the frames in which both can be heard."""
    for a, b in zip(one, other, strict=True):
        if a.any() and b.any():
            yield a.astype(np.float64), b.astype(np.float64)


def equal_samples(one: Clips, other: Clips) -> float:
    """Share of the samples that are equal, to the bit, and not 0."""
    return float(((one == other) & (one != 0)).mean())


def correlation_in_step(one: Clips, other: Clips) -> float:
    """Correlation of the clips of the same frames without a lag: the same take from the same place."""
    return _correlation_in(one, other, ((LOWEST, HIGHEST),), NO_LAG)


def band_correlation_in_step(one: Clips, other: Clips) -> float:
    """The same in the band in which it is largest: another sound may hide the take in the others."""
    return _correlation_in(one, other, BANDS, NO_LAG)


def clip_correlation(one: Clips, other: Clips) -> float:
    """Correlation of the clips of the same frames at any lag: the same take, perhaps from another place."""
    return _correlation_in(one, other, ((LOWEST, HIGHEST),), round(LONGEST_LAG * RATE))


def _correlation_in(one: Clips, other: Clips, bands: Sequence[tuple[float, float]], lags: int) -> float:
    length = 2 * one.shape[2]
    used = [_band(length, *band) for band in bands]
    found = [[_largest(correlation(a, b, u, length), lags) for u in used] for a, b in _both_sound(one, other)]
    return float(np.mean(found, axis=0).max()) if found else 0.0


def correlation_at_any_time(one: Clips, other: Clips) -> float:
    """Correlation over the whole observation: another stretch of the same take is as good."""
    a, b = (clips.transpose(1, 0, 2).reshape(2, -1).astype(np.float64) for clips in (one, other))
    if not (a.any() and b.any()):
        return 0.0
    length = next_fast_len(2 * a.shape[1], real=True)
    found = correlation(a, b, _band(length), length)
    return _largest(found, a.shape[1] - 1)


def envelope_correlation(one: Clips, other: Clips) -> float:
    """Correlation of the spectral envelopes over time, at any lag."""
    a, b = _envelope(one), _envelope(other)
    length = next_fast_len(2 * a.shape[1], real=True)
    used = np.ones(length // 2 + 1, dtype=bool)
    used[0] = False
    found = correlation(a, b, used, length).mean(axis=0)
    return float(np.abs(found).max())


def _envelope(clips: Clips) -> Array:
    """(bands, times) log power in bands of equal width in octaves, without its mean; 0 where it is silent."""
    signal = clips.transpose(1, 0, 2).reshape(2, -1).astype(np.float64)
    frequency, _, spectrum = stft(signal, RATE, nperseg=2 * HOP, noverlap=HOP, boundary=None)
    power = (np.abs(spectrum) ** 2).sum(axis=0)
    edges = np.geomspace(LOWEST, HIGHEST, ENVELOPE_BANDS + 1)
    inside = (frequency >= edges[:-1, None]) & (frequency < edges[1:, None])
    level = 10 * np.log10(inside.astype(np.float64) @ power + _TINY)
    heard = level > level.max(axis=1, keepdims=True) - FLOOR_DB
    mean = (level * heard).sum(axis=1, keepdims=True) / np.maximum(heard.sum(axis=1, keepdims=True), 1)
    return np.asarray(np.where(heard, level - mean, 0.0))


def explained(one: Clips, other: Clips) -> float:
    """Share of one signal that is the other one through a short filter (least squares): what subtraction removes."""
    length = 2 * one.shape[2]
    used, shares = _band(length), []
    delays = np.arange(TAPS) - TAPS // 2
    for a, b in _both_sound(one, other):
        for x, y in zip(a, b, strict=True):
            fx, fy = whitened(rfft(x, length), used), whitened(rfft(y, length), used)
            auto, against = irfft(np.abs(fy) ** 2, length), irfft(fx * fy.conj(), length)[delays]
            filter_ = solve_toeplitz(auto[:TAPS] + 1e-6 * auto[0] * (np.arange(TAPS) == 0), against)
            shares.append(float(filter_ @ against / irfft(np.abs(fx) ** 2, length)[0]))
    return float(np.mean(shares)) if shares else 0.0


def shared_lines(one: Clips, other: Clips) -> float:
    """Share of the spectral lines that both have: the hum and the partials of one device."""
    a, b = _lines(one), _lines(other)
    near_a, near_b = (maximum_filter1d(lines, 3) for lines in (a, b))
    return float(2 * ((a & near_b).sum() + (b & near_a).sum()) / max(2 * int(a.sum() + b.sum()), 1))


def _lines(clips: Clips) -> NDArray[np.bool_]:
    """(bins,) where the mean spectrum of the observation has a line."""
    signal = clips.transpose(1, 0, 2).reshape(2, -1).astype(np.float64)
    frequency, power = welch(signal, RATE, nperseg=LINE_BLOCK, scaling="spectrum")
    level = 10 * np.log10(power.sum(axis=0) + _TINY)
    width = round(LINE_WIDTH / (frequency[1] - frequency[0])) | 1
    stands_out = level - median_filter(level, width) > LINE_DB
    peak = level == maximum_filter1d(level, 3)
    return np.asarray(stands_out & peak & (frequency >= LOWEST) & (frequency <= HIGHEST / 2))


def _each(likeness: Likeness) -> Callable[[Sequence[Case]], list[Array | None]]:
    def score(case: Case) -> Array:
        reference = clips_of(case.root / case.reference)
        return np.array([likeness(reference, clips_of(folder)) for folder in case.folders])

    return lambda cases: [score(case) for case in cases]


#: Name → attack on the question *take*.
TAKE_ATTACKS: dict[str, Callable[[Sequence[Case]], list[Array | None]]] = {
    "clips: equal samples": _each(equal_samples),
    "clips: correlation in step": _each(correlation_in_step),
    "clips: correlation in step, in bands": _each(band_correlation_in_step),
    "clips: correlation": _each(clip_correlation),
    "clips: correlation at any time": _each(correlation_at_any_time),
    "clips: spectral envelope at any time": _each(envelope_correlation),
    "clips: residual after subtraction": _each(explained),
    "clips: spectral lines": _each(shared_lines),
}
