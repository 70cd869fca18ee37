"""Streets: passing cars, traffic behind a window, a wet road, a tram."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import case_modes, resonator, turning, unsteady, wave
from generators.assets.sounds.room_tone import slow_curve, spectrum_noise
from generators.assets.sounds.signals import Array, add_at, phase_of, strike, unit, upsampled

_SOUND = 343.0
#: Values per second of the curves of level.
_CURVES = 100
#: Spectrum (Hz, dB) of rolling tyres: the peak between 700 and 1300 Hz, 7 dB/octave above; of engines and exhausts.
_TYRES = ((50, 200, 600, 1000, 2000, 4000, 8000, 16_000), (-22, -13, -5, 0, -6, -15, -26, -44))
_ENGINES = ((40, 70, 120, 250, 500, 1000, 2000, 5000, 16_000), (-6, 0, -1, -5, -9, -14, -20, -32, -55))


def _pass(t: Array, moment: float, distance: float, speed: float) -> tuple[Array, Array]:
    """(level, Doppler factor) of a vehicle that is nearest at ``moment``: 1/r, and 1/(1 + v·x/(r·c))."""
    x = speed * (t - moment)
    range_ = np.sqrt(distance**2 + x**2)
    return distance / range_, 1 / (1 + speed * x / (range_ * _SOUND))


def _engine(rng: Generator, doppler: Array, speed: float, cylinders: int) -> Array:
    """Firing of an engine: half orders of the shaft, stronger at the firing frequency, through an exhaust."""
    count = len(doppler)
    turns = rng.uniform(22.0, 30.0) + speed * rng.uniform(0.5, 1.2)
    phase = phase_of(0.5 * turns * doppler * unsteady(count, rng, 0.01, 0.004), count)
    orders = np.arange(1, 48)
    firing = orders % cylinders == 0
    level = np.where(firing, 1.0, rng.uniform(0.1, 0.35)) * orders**-0.8 * np.exp(rng.normal(0, 0.3, len(orders)))
    return unit(wave(phase, level, rng))


def _traffic(
    count: int, rng: Generator, gap: float, speeds: tuple[float, float], distance: tuple[float, float]
) -> tuple[Array, Array, Array]:
    """Levels of vehicles over time: (tyres, tyres near by (steeper), engines as sound); a Poisson stream.

    Args:
        count: samples.
        rng: the only source of randomness.
        gap: mean seconds between vehicles.
        speeds: range (m/s).
        distance: range of the nearest distance (m).
    """
    seconds = count / SAMPLE_RATE
    coarse = np.arange(0.0, seconds + 2 / _CURVES, 1 / _CURVES)
    tyres, near, engines = np.zeros(len(coarse)), np.zeros(len(coarse)), np.zeros(count)
    moment = -5.0
    while moment < seconds + 5:
        speed, away = rng.uniform(*speeds), rng.uniform(*distance)
        level, _ = _pass(coarse, moment, away, speed)
        loud = rng.lognormal(0.0, 0.3) * (speed / 12.0) ** 1.5 * distance[0] / away
        tyres += np.square(loud * level)
        near += np.square(loud * level**2)
        first, t = _window(count, moment, 2.5 * away / speed)
        # Of dense traffic only some engines stand out of the tyres.
        if len(t) and rng.random() < min(1.0, gap / 4.0):
            level, doppler = _pass(t, moment, away, speed)
            level *= np.clip(1 - np.abs(t - moment) * speed / (2.5 * away), 0.0, 1.0)
            cylinders = int(rng.choice([3, 4, 4, 6]))
            piece = rng.uniform(0.3, 1.5) * loud * level * _engine(rng, doppler, speed, cylinders)
            add_at(engines, first, piece)
        moment += rng.exponential(gap)
    step = SAMPLE_RATE // _CURVES
    return upsampled(np.sqrt(tyres), step, count), upsampled(np.sqrt(near), step, count), engines


def _window(count: int, moment: float, reach: float) -> tuple[int, Array]:
    """First sample and times of the samples within ``reach`` seconds of ``moment``."""
    first, last = max(0, int((moment - reach) * SAMPLE_RATE)), min(count, int((moment + reach) * SAMPLE_RATE))
    return first, np.arange(first, max(first, last)) / SAMPLE_RATE


def _motorcycle(rng: Generator, t: Array, moment: float, reach: float) -> Array:
    """A motorcycle that passes at ``moment`` and changes gear every second or two; heard for ``reach`` each way."""
    speed = rng.uniform(9.0, 20.0)
    level, doppler = _pass(t, moment, rng.uniform(6.0, 12.0), speed)
    level *= np.clip(1 - np.abs(t - moment) / reach, 0.0, 1.0)
    saw = np.mod(t / rng.uniform(1.2, 2.4) + rng.uniform(), 1.0)
    turns = rng.uniform(28.0, 45.0) * (1 + 0.7 * saw) * doppler * unsteady(len(t), rng, 0.005, 0.01)
    orders = np.arange(1, 60)
    firing = np.where(orders % int(rng.choice([1, 2, 4])) == 0, 1.0, 0.3) * orders**-0.55
    pulses = unit(wave(phase_of(turns, len(t)), firing, rng))
    exhaust = [(rng.uniform(180, 420), 2.5, 1.0), (rng.uniform(700, 1500), 3.0, 0.5)]
    return level * (0.5 + saw) * resonator(pulses, exhaust, 0.3)


def passing_cars(count: int, rng: Generator) -> Array:
    """A town street some metres away: cars pass one by one, each louder and brighter as it is near; a distant road.

    Unit: traffic (a car every 3–8 s), distance, speeds. Take: times, vehicles, a distant rumble. Model: rolling noise
    with its peak at 700–1300 Hz (Sandberg 2003) and 1/r, engines with Doppler shift.
    """
    tyres, near, engines = _traffic(count, rng, rng.uniform(3.0, 8.0), (7.0, 15.0), (5.0, 14.0))
    peak = rng.uniform(0.75, 1.25)
    rolling = spectrum_noise(count, rng, [f * peak for f in _TYRES[0]], _TYRES[1])
    sizzle = spectrum_noise(count, rng, [400, 1500, 4000, 9000, 16_000], [-22, -6, 0, -8, -30])
    far = spectrum_noise(count, rng, *_ENGINES) * np.exp(slow_curve(count, rng, 0.3, 0.25))
    return tyres * rolling + 0.3 * near * sizzle + 0.25 * engines + rng.uniform(0.12, 0.3) * far


def closed_window(count: int, rng: Generator) -> Array:
    """A busy road behind closed windows: the pane takes the high, and rings near its coincidence; a bus idles."""
    tyres, near, engines = _traffic(count, rng, rng.uniform(1.2, 2.5), (9.0, 18.0), (12.0, 30.0))
    rolling = spectrum_noise(count, rng, *_TYRES)
    far = spectrum_noise(count, rng, *_ENGINES) * np.exp(slow_curve(count, rng, 0.2, 0.3))
    outside = tyres * rolling + 0.6 * engines + 0.35 * far
    idle = wave(turning(count, rng, rng.uniform(9.0, 13.0), 0.01, 0.01), np.arange(1.0, 31.0) ** -0.5, rng)
    outside += 0.2 * unit(idle) * np.clip(0.3 + slow_curve(count, rng, 0.06, 0.7), 0.0, 1.0)
    # Mass law: 6 dB per octave; a leak at the frame lets a little of all pass.
    pane = sosfilt(butter(1, rng.uniform(120.0, 350.0), fs=SAMPLE_RATE, output="sos"), outside)
    coincidence = [(rng.uniform(2400.0, 3500.0), 1.5, 0.02), (rng.uniform(180.0, 320.0), 2.0, 0.2)]
    leak = resonator(outside, coincidence, rng.uniform(0.01, 0.04))
    return pane + leak + 0.02 * near * rolling


def wet_road_engines(count: int, rng: Generator) -> Array:
    """A wet road with motorcycles: spray hisses above 2 kHz behind each vehicle; engines that change gear; rain."""
    tyres, near, _ = _traffic(count, rng, rng.uniform(3.5, 7.0), (8.0, 17.0), (6.0, 15.0))
    out = np.zeros(count)
    moment = rng.uniform(0.0, 8.0)
    while moment < count / SAMPLE_RATE + 4:
        reach = rng.uniform(4.0, 8.0)
        first, t = _window(count, moment, reach)
        if len(t):
            add_at(out, first, _motorcycle(rng, t, moment, reach))
        moment += rng.exponential(14.0) + 3.0
    rolling = spectrum_noise(count, rng, *_TYRES)
    spray = spectrum_noise(count, rng, [300, 1200, 3000, 6500, 12_000, 16_000], [-18, -6, 0, -2, -10, -30])
    rain = spectrum_noise(count, rng, [200, 1000, 4000, 9000, 16_000], [-14, -6, 0, -3, -24])
    rain *= np.exp(slow_curve(count, rng, 0.4, 0.15) + slow_curve(count, rng, 40.0, 0.12))
    far = spectrum_noise(count, rng, *_ENGINES)
    wet = tyres * (0.6 * rolling + 0.8 * spray) + 0.4 * near * spray
    return wet + rng.uniform(0.4, 1.0) * out + rng.uniform(0.08, 0.25) * rain + 0.15 * far


def tram_line(count: int, rng: Generator) -> Array:
    """A street with a tram: steel wheels roar on rails, knock over joints, squeal in the bend; a bell, voices of cars.

    Unit: rails (roughness peak at 400–900 Hz), distance between axles and joints, pitch of the squeal and the bell.
    Take: when trams pass, their speed, how long they squeal. Model: rolling noise of wheel and rail with its peak below
    1 kHz and levels that rise with the speed; stick and slip of a wheel at one of its modes (Thompson 2009).
    """
    tyres, near, _ = _traffic(count, rng, rng.uniform(4.0, 9.0), (6.0, 12.0), (8.0, 18.0))
    peak = rng.uniform(400.0, 900.0)
    roar = spectrum_noise(
        count, rng, [60, 0.4 * peak, peak, 2 * peak, 4 * peak, 9000, 16_000], [-14, -6, 0, -4, -11, -26, -48]
    )
    far = spectrum_noise(count, rng, *_ENGINES) * np.exp(slow_curve(count, rng, 0.3, 0.25))
    rolling = spectrum_noise(count, rng, *_TYRES)
    out = tyres * rolling + 0.15 * near * rolling + rng.uniform(0.15, 0.35) * far
    wheel, joint = rng.uniform(900.0, 3800.0), case_modes(rng, 90.0, 900.0)
    bell, moment = _bell(rng.uniform(700.0, 1400.0), rng), rng.uniform(-3.0, 3.0)
    while moment < count / SAMPLE_RATE + 4:
        reach, speed, away = rng.uniform(4.0, 9.0), rng.uniform(4.0, 11.0), rng.uniform(5.0, 12.0)
        first, t = _window(count, moment, reach)
        if len(t):
            level, doppler = _pass(t, moment, away, speed)
            level *= np.clip(1 - np.abs(t - moment) / reach, 0.0, 1.0) * (speed / 8.0)
            slip = np.clip(slow_curve(len(t), rng, 1.2, 1.0) - 0.6, 0.0, 1.0)
            squeal = wave(phase_of(wheel * doppler * unsteady(len(t), rng, 0.001, 0.002), len(t)), [1.0, 0.3, 0.1], rng)
            passing = 2.2 * level * roar[first : first + len(t)] + rng.uniform(0.2, 1.2) * level * slip * squeal
            for axle in np.arange(t[0], t[-1], rng.uniform(1.6, 2.4) / speed * 4):
                for wheelset in (0.0, 1.8 / speed):
                    at = int((axle + wheelset - t[0]) * SAMPLE_RATE)
                    loud = float(np.interp(axle, t, level))
                    add_at(passing, at, loud * rng.uniform(0.8, 1.5) * strike(joint, 0.15, rng))
            if rng.random() < 0.5:
                for stroke in range(int(rng.integers(1, 4))):
                    add_at(passing, int((0.3 * reach + 0.35 * stroke) * SAMPLE_RATE), rng.uniform(0.3, 0.8) * bell)
            add_at(out, first, passing)
        moment += rng.uniform(6.0, 16.0)
    return out


def _bell(pitch: float, rng: Generator) -> Array:
    """One stroke on a bell of a tram: partials of a thin cup (ratios 1, 2.8, 5.2, 8.0)."""
    modes = [(pitch * r * rng.uniform(0.99, 1.01), 1.6 / r, 1 / r) for r in (1.0, 2.8, 5.2, 8.0) if pitch * r < 9000]
    return strike(modes, 1.2, rng)
