"""Clips against where their source is: the side it is on, the order of the clips, the ear that hears it first.

Reflections and standing waves make the level difference of single clips point anywhere: that of a steady tone has as
many signs as frames, in a small hard room even broadband sound is wrong in one frame of five. So a clip's difference is
taken at onsets, which reflections have not reached yet (precedence), in bands that count alike however loud they are.
The clips are judged together: their differences are fitted to the sine of the azimuth. What errs is the fit, not a
clip: exchanged channels turn its slope to the other side by as many standard errors as correct ones have on theirs.
Where the slope is too uncertain for that, nothing is said: a steady tone
in a hard room does not tell its side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.dataset import Frame
from avs3d_bench.geometry import direction_to
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.sound import BinauralClip
from avs3d_bench.validation.sources import sounds_throughout

#: Windows in which levels are measured, and the step between them (samples): 11.6 and 2.9 ms.
_WINDOW, _HOP = 512, 128
#: Edges of the bands (Hz). Below, a head has hardly any shadow.
_EDGES = (250, 350, 500, 700, 1000, 1400, 2000, 2800, 4000, 5600, 8000, 11_000, 15_000, 20_000)
#: A band with less than this share of the power of the loudest is left out. The start and end of a beep splatter over
#: all bands, 60 to 100 dB below its tone; they are what tells its side.
_FLOOR = 1e-10
#: An onset is what exceeds all sound before it, each let fall by 60 dB in this time (s).
_FALL = 2.0
#: Level differences of bands are limited to this (dB), so that no notch outweighs the others.
_MOST_DB = 10.0
#: Standard deviation of the level difference of one band in a reverberant field (dB), and the number of frames as many
#: as which it counts in the variance of a fit: few frames that happen to agree are no proof.
_BAND_DB, _PRIOR_FRAMES = 7.0, 4
#: Frames that it takes to fit, and the least sum of the squares of their sines: sources ahead have no side.
LEAST_FRAMES, LEAST_SINES = 4, 0.5
#: Standard errors at which a slope of the wrong sign is an error. Of 210 observations of 32 frames (7 sounds with
#: noise, pulses or onsets, 10 paths in furnished and bare rooms, 3 engines) the least slope has +3.4, of 30 with a
#: steady tone −1.0.
SURE = 3.0
#: Steady tones and hums sound in so few bands (median over the clips). Their standing waves give a slope by chance,
#: which must be so many standard errors. Of 36 observations with tones of 110 Hz to 4 kHz and hums the least has −2.5,
#: as chance makes it: 3 would be wrong once in several hundred observations.
TONAL_BANDS, TONAL_SURE = 5, 5.0
#: A clip is exchanged if that explains it better by this log-likelihood ratio; 3.7 at most in 7,680 correct ones.
_ONE_SURE = 10.0
#: The order of the clips is judged where this share of the variance of their levels is common to all bands (intraclass
#: correlation), in this number of frames, with so many bands within 40 dB of the loudest; the least correlation of
#: level and sine (0.70 to 0.98 in those observations; 0.15 at most in reverse order).
_COMMON, ORDER_FRAMES, _ORDER_BANDS, ORDER_LEAST = 0.8, 8, 6, 0.4
#: A silent instance explains the levels better than the source if it leaves less than this share of their variance, by
#: this log-likelihood ratio. Twins that did not sound: 0.68 and 6.1 at best; those that did: 0.1 to 0.4, 15 to 37.
_ELSEWHERE_SHARE, _ELSEWHERE_SURE = 0.4, 6.0
#: Least standard deviation of the sines: sources that stay in one direction have no order.
_ORDER_SPREAD = 0.25
#: Ears whose levels differ by less than this in the mean (dB) hear the same.
_ALIKE_DB = 0.1
#: In part_3 a frame is judged by its source if everything else in the clip is this much quieter (dB).
ALONE_SNR_DB = 20.0
#: The source whose direction the frames of part_3 record.
_FIRST = "source_1"


@dataclass(frozen=True)
class SideLevel:
    """How much louder the right ear is at onsets.

    Attributes:
        db: mean over the bands, dB; positive where the right ear is louder.
        bands: number of bands that sound.
        variance: of the mean, from the scatter of the bands (dB²).
        broad: number of bands within 40 dB of the loudest.
    """

    db: float
    bands: int
    variance: float
    broad: int


@cache
def _hanning(count: int) -> NDArray[np.float64]:
    """(count,) the window; a dataset has thousands of clips of one length."""
    return np.hanning(count)


@cache
def _band_sums() -> NDArray[np.float64]:
    """(bins, bands) 1 where a bin of a window's spectrum is in a band."""
    bins = np.digitize(np.fft.rfftfreq(_WINDOW, 1 / layout.SAMPLE_RATE), _EDGES)
    return np.asarray(bins[:, None] == np.arange(1, len(_EDGES)), dtype=np.float64)


def _own_power(samples: NDArray[np.floating]) -> NDArray[np.float64]:
    """(bands,) power of a whole clip.

    In short windows a steady tone leaks into its neighbour bands, which then seem to agree with it; in one as long as
    the clip it does not.
    """
    count = samples.shape[1]
    spectrum = np.square(np.abs(np.fft.rfft(samples * _hanning(count)))).sum(axis=0)
    edges = np.searchsorted(np.fft.rfftfreq(count, 1 / layout.SAMPLE_RATE), _EDGES)
    return np.asarray(np.add.reduceat(spectrum, edges)[:-1])


def side_level(samples: NDArray[np.floating]) -> SideLevel | None:
    """The level difference at onsets of a clip (2, n) at 44.1 kHz, channel 0 left; None for silence.

    Onset: the part of a band's power in a window that exceeds what is left of the loudest power before it.
    """
    windows = np.lib.stride_tricks.sliding_window_view(samples, _WINDOW, axis=1)[:, ::_HOP]
    spectra = np.fft.rfft(windows * _hanning(_WINDOW), axis=-1)
    power = (np.square(spectra.real) + np.square(spectra.imag)) @ _band_sums()  # (2, windows, bands)
    total = power.sum(axis=0)
    fall = 10.0 ** (-6.0 * np.arange(len(total)) * _HOP / layout.SAMPLE_RATE / _FALL)[:, None]
    left = np.maximum.accumulate(total / fall, axis=0) * fall
    onset = np.maximum(total[1:] - left[:-1] * fall[1], 0.0) / np.maximum(total[1:], 1e-30)
    ears = (power[:, 1:] * onset).sum(axis=1)
    whole = total.sum(axis=0)
    own = _own_power(samples)
    sounds = (own > own.max() * _FLOOR) & (ears.max(axis=0) > 0)
    if not sounds.any():
        return None
    ears = np.maximum(ears[:, sounds], 1e-30)  # one side may be digital silence
    bands = np.clip(10 * np.log10(ears[1] / ears[0]), -_MOST_DB, _MOST_DB)
    count = len(bands)
    scatter = float(bands.var(ddof=1)) if count > 1 else _BAND_DB**2
    return SideLevel(float(bands.mean()), count, scatter / count, int((whole > whole.max() * 1e-4).sum()))


@dataclass(frozen=True, eq=False)
class Hearing:
    """A clip in which one source is heard that is in line of sight.

    Attributes:
        frame: the frame.
        sound: its clip.
        azimuth: of the source, degrees, positive right.
        distance: of the source, metres.
        gain_db: level of the source above what sources have, dB.
    """

    frame: Frame
    sound: BinauralClip
    azimuth: float
    distance: float
    gain_db: float = 0.0

    @cached_property
    def level(self) -> SideLevel | None:
        """The level difference of its ears."""
        return side_level(self.sound.samples)


def hearings(
    record: ObservationRecord | None,
    frames: tuple[Frame, ...],
    clips: Sequence[BinauralClip | None],
    visible: Mapping[str, frozenset[int]],
) -> tuple[Hearing, ...]:
    """The clips that can be held against the place of a source.

    Args:
        record: the observation's; without it nothing is known of a source.
        frames: all frames.
        clips: the clip of each frame; None where it is missing or damaged.
        visible: frame name → ids of the instances that its picture shows.
    """
    if record is None:
        return ()
    found = []
    for frame, clip in zip(frames, clips, strict=True):
        entry = frame.record
        if clip is None or entry is None:
            continue
        if (heard := _hearing(record, entry, frame, clip, visible.get(frame.name, frozenset()))) is not None:
            found.append(heard)
    return tuple(found)


def _hearing(
    record: ObservationRecord, entry: FrameRecord, frame: Frame, clip: BinauralClip, visible: frozenset[int]
) -> Hearing | None:
    """A clip with its only source, if that is in line of sight.

    In part_3 it must be an instance of the room, sound during the whole clip, and everything else must be
    `ALONE_SNR_DB` quieter. Whether a source other than the first is in line of sight is not recorded: its instance
    must be in view.
    """
    if entry.audible is None:
        if not entry.line_of_sight or entry.azimuth is None or entry.distance is None:
            return None
        return Hearing(frame, clip, entry.azimuth, entry.distance)
    if len(entry.audible) != 1:
        return None
    (heard,) = entry.audible
    source = record.source(heard.source)
    if source.instance is None or (heard.snr_db is not None and heard.snr_db < ALONE_SNR_DB):
        return None
    if not sounds_throughout(source, entry):
        return None  # its reverberation comes from everywhere
    if not (entry.line_of_sight if source.id == _FIRST else source.instance in visible):
        return None
    where = direction_to(entry.pose, record.source_at(entry, source))
    return Hearing(frame, clip, where.azimuth, where.distance, source.gain_db)


@dataclass(frozen=True, eq=False)
class SideFit:
    """Level differences fitted to the sines of the azimuths, each weighted by its number of bands.

    Attributes:
        slope: dB of a source at the right, at 90°.
        variance: of a clip about the fit (dB²).
        error: standard error of the slope (dB).
    """

    slope: float
    variance: float
    error: float

    @classmethod
    def of(cls, levels: Sequence[SideLevel], sines: NDArray[np.float64]) -> SideFit:
        """Least squares through the origin; ``sines`` (n,)."""
        bands = np.array([level.bands for level in levels], dtype=np.float64)
        found, weight = np.array([level.db for level in levels]), bands / bands.mean()
        spread = float(np.sum(weight * sines**2))
        slope = float(np.sum(weight * found * sines)) / spread if spread else 0.0
        rest = float(np.sum(weight * (found - slope * sines) ** 2))
        prior = float(np.mean(_BAND_DB**2 / bands))
        variance = (rest + _PRIOR_FRAMES * prior) / (len(levels) - 1 + _PRIOR_FRAMES)
        return cls(slope, variance, (variance / spread) ** 0.5 if spread else np.inf)

    @property
    def certainty(self) -> float:
        """The slope in standard errors: positive if the ear on the source's side is louder."""
        return self.slope / self.error

    def log_ratio(self, level: SideLevel, sine: float) -> float:
        """Logarithm of how much likelier a level is with its ears exchanged."""
        return -2 * self.slope * sine * level.db / self.variance


def check_sides(record: ObservationRecord | None, heard: Sequence[Hearing], findings: Findings) -> None:
    """The level differences of the ears follow the azimuth of the source: statements about all clips together.

    Args:
        record: the observation's.
        heard: its clips; see `hearings`.
        findings: where problems go.
    """
    pairs = [(one, one.level) for one in heard if one.level is not None]
    levels = [level for _, level in pairs]
    sines = np.sin(np.radians([one.azimuth for one, _ in pairs]))
    if len(levels) < LEAST_FRAMES or float(np.sum(sines**2)) < LEAST_SINES:
        return
    clips = f"over {len(levels)} frames with line of sight"
    if float(np.mean([abs(level.db) for level in levels])) < _ALIKE_DB:
        findings.add(layout.BINAURAL, f"{clips}, both ears hear the same, wherever the source is")
        return
    fit = SideFit.of(levels, sines)
    sure = TONAL_SURE if tonal(levels) else SURE
    if fit.certainty < -sure:
        text = f"{clips}, the louder ear is on the wrong side of the source ({-fit.certainty:.1f} standard errors)"
        findings.add(layout.BINAURAL, f"{text}: are the channels swapped?")
        return
    for number, (one, level) in enumerate(pairs):
        if level.db * sines[number] < 0 and len(levels) > LEAST_FRAMES:
            rest = SideFit.of([*levels[:number], *levels[number + 1 :]], np.delete(sines, number))
            if rest.certainty > sure and rest.log_ratio(level, float(sines[number])) > _ONE_SURE:
                text = f"the ear away from the source is {abs(level.db):.1f} dB louder, at {one.azimuth:.0f}°"
                text = f"{text} in line of sight; other frames have it {rest.slope:.1f} dB quieter at 90°"
                findings.add(layout.audio_path(layout.BINAURAL, one.frame.index), f"{text}: are the channels swapped?")
    if problem := order_problem(levels, sines):
        findings.add(layout.BINAURAL, f"{clips}, {problem}: clips of other frames?")
    elsewhere = _elsewhere(record, pairs, fit) if record is not None else None
    if elsewhere is not None:
        findings.add(
            layout.BINAURAL, f"{clips}, level differences follow {elsewhere}, not the source: does that sound?"
        )


def tonal(levels: Sequence[SideLevel]) -> bool:
    """Whether clips hold a steady tone or a hum: sound in a few bands, without the onsets that splatter over all."""
    return bool(levels) and float(np.median([level.bands for level in levels])) <= TONAL_BANDS


def order_problem(levels: Sequence[SideLevel], sines: NDArray[np.float64]) -> str | None:
    """The problem of levels that do not follow the sines (n,) although all bands agree on them."""
    found = np.array([level.db for level in levels])
    whole = float(found.var(ddof=1)) if len(found) >= ORDER_FRAMES else 0.0
    if not whole or float(sines.std()) < _ORDER_SPREAD:
        return None
    common = 1 - float(np.mean([level.variance for level in levels])) / whole
    if common < _COMMON or float(np.mean([level.broad for level in levels])) < _ORDER_BANDS:
        return None
    correlation = float(np.corrcoef(sines, found)[0, 1])
    if correlation >= ORDER_LEAST:
        return None
    return f"level differences do not follow the azimuth (r = {correlation:.2f}, expected {ORDER_LEAST} or more)"


def _elsewhere(record: ObservationRecord, pairs: Sequence[tuple[Hearing, SideLevel]], fit: SideFit) -> str | None:
    """The silent instance whose directions explain the levels much better than those of the source."""
    if record.is_part_3:
        return None  # its sources are held to their own stems
    levels = [level for _, level in pairs]
    sure = TONAL_SURE if tonal(levels) else SURE
    for instance in record.instances:
        if instance.sounding:
            continue
        middle = np.mean(instance.bounds, axis=0)
        towards = [direction_to(one.frame.pose, tuple(middle.tolist())).azimuth for one, _ in pairs]
        other = SideFit.of(levels, np.sin(np.radians(towards)))
        share = other.variance / fit.variance
        if share < _ELSEWHERE_SHARE and -len(levels) / 2 * np.log(share) > _ELSEWHERE_SURE and other.certainty > sure:
            return f"instance {instance.id} ({instance.category}, silent)"
    return None


def check_delays(heard: Sequence[Hearing], findings: Findings) -> None:
    """The ear on the source's side hears it first: for clips that are played backwards it is the other ear.

    Below 1.2 kHz, where the delay between the ears is less than half a period, their correlation is higher at the delay
    of the source (Woodworth's sphere) than at its opposite. Echoes mislead single frames, not their mean. Steady tones
    sound the same backwards: nothing is said of them.
    """
    low, high = DELAY_AZIMUTHS
    beside = [one for one in heard if low <= abs(one.azimuth) <= high]
    if len(beside) < DELAY_FRAMES or tonal([one.level for one in beside if one.level is not None]):
        return
    evidence = [delay_evidence(one.sound.samples, one.azimuth) for one in beside]
    count, prior = len(evidence), _PRIOR_FRAMES * _DELAY_SPREAD**2
    mean, scatter = float(np.mean(evidence)), float(np.var(evidence)) * count
    error = ((scatter + prior) / (count - 1 + _PRIOR_FRAMES) / count) ** 0.5
    if mean + DELAY_ERRORS * error < -DELAY_LEAST:
        text = f"over {len(evidence)} frames with line of sight the farther ear hears the source first ({mean:.2f})"
        findings.add(layout.BINAURAL, f"{text}: are the clips played backwards?")


#: Azimuths at which the delay between the ears is judged, degrees; fewer frames are no sample.
DELAY_AZIMUTHS, DELAY_FRAMES = (25.0, 155.0), 4
#: The mean must be so many standard errors below zero, and by more than rounding makes of two equal channels. Steady
#: tones reach −3.5.
DELAY_ERRORS, DELAY_LEAST = 4.0, 0.01
#: Standard deviation of the evidence of a clip, as if of `_PRIOR_FRAMES` more.
_DELAY_SPREAD = 0.3
#: Delay of a source at the side (s), and the band in which it is looked for (Hz).
_SIDE_DELAY, _BAND = 550e-6, (100.0, 1200.0)
#: Zeros that keep the end of a clip from its beginning (samples).
_LONGEST_LAG = 32


def delay_evidence(samples: NDArray[np.float32], azimuth: float) -> float:
    """Correlation of the ears at the delay of a source at ``azimuth`` (degrees), less that at the opposite delay.

    Args:
        samples: (2, n), channel 0 left, 44.1 kHz.
        azimuth: of the source, positive right.

    Returns:
        −2 to 2; positive if the ear on the source's side leads.
    """
    from scipy.fft import next_fast_len, rfft

    lag = round(_SIDE_DELAY * layout.SAMPLE_RATE * float(np.sin(np.radians(azimuth))))
    size = next_fast_len(samples.shape[1] + _LONGEST_LAG, real=True)
    low, high = (round(edge * size / layout.SAMPLE_RATE) for edge in _BAND)
    left, right = rfft(samples.astype(np.float64), size)[:, low : high + 1]
    # To the right, the left ear hears it later. Correlations at lag and −lag differ by the sine of the cross spectrum.
    phase = 2 * np.pi * lag / size * np.arange(low, high + 1)
    difference = -2 * float(np.sum((left * np.conj(right)).imag * np.sin(phase)))
    power = float(np.sqrt(np.sum(np.abs(left) ** 2) * np.sum(np.abs(right) ** 2)))
    return difference / max(power, 1e-30)
