"""The voices of microwave ovens.

Levels inside a voice are amplitudes re the broadband noise of its cooling fan.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.devices.microwave_built_in import crossflow_built_in, drawer_oven, inverter_defrost
from generators.assets.sounds.devices.microwave_food import commercial_twin, inverter_quiet, popcorn, timer_bell
from generators.assets.sounds.devices.microwave_heaters import heavy_stirrer, quartz_grill
from generators.assets.sounds.devices.microwave_parts import (
    Moments,
    beeps,
    clicks,
    door,
    duty,
    inverter,
    kitchen,
    lamination_noise,
    louvres,
    mains,
    session,
    shaded_pole_fan,
    sheet_metal,
    since_change,
    spin_down,
    transformer,
    turntable,
)
from generators.assets.sounds.fans import (
    CONTROL_RATE,
    blades,
    cosine,
    decibels,
    expand,
    frames,
    impacts,
    modes,
    noise,
    radiated,
    ripple,
    rotor,
    slopes,
    slow,
    spells,
    struck,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array
from generators.assets.sounds.voice import Voice


def turntable_transformer(count: int, rng: Generator) -> Array:
    """A common oven with a transformer: deep hum, fan, plate on rollers; full or part power, beeps, door.

    Model: `transformer`, `shaded_pole_fan` (slip 5 to 12 %), `turntable` (2.5/3 rpm), duty cycle of 20 to 30 s. Units:
    core, cabinet, fan, plate, buzzer.
    """
    held = session(count, rng, (40.0, 150.0), (6.0, 10.0))
    nominal, cycle = mains(count, rng)
    share = 1.0 if rng.random() < 0.5 else rng.uniform(0.45, 0.85)
    power, relay = duty(count, rng, held.cooking, rng.uniform(20.0, 30.0), share)
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(250.0, 450.0))
    rub = lamination_noise(count, rng, cycle, power, rng.uniform(900.0, 1800.0))
    speed = spin_down(count, rng, held.cooking, 0.1)
    air, tones = shaded_pole_fan(count, rng, speed, nominal, (0.05, 0.12), rng.uniform(350.0, 700.0))
    plate = turntable(count, rng, held.cooking, nominal / 20.0)
    cabinet = sheet_metal(rng, 160.0, 2200.0, 8.0)
    pitch = rng.uniform(1950.0, 2100.0)
    return np.asarray(
        radiated(decibels(rng.uniform(4.0, 11.0)) * hum + decibels(rng.uniform(-7.0, 0.0)) * rub, cabinet)
        + air
        + decibels(rng.uniform(-12.0, -5.0)) * tones
        + decibels(rng.uniform(-14.0, -6.0)) * plate
        + 2.0 * clicks(count, rng, relay, 500.0, 4000.0)
        + 2.5 * door(count, rng, held)
        + rng.uniform(0.6, 1.4) * beeps(count, rng, held.ends + 9000, pitch, rng.uniform(0.4, 0.8), 1.2, 3)
        + 0.6 * beeps(count, rng, held.keys, pitch, 0.09, 1.0, 1)
        + 2.5 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def _chatter(count: int, rng: Generator, cycle: Array, power: Array, share: float) -> Moments:
    """Samples at which a loose part strikes: near each peak of the force, but for beats that it misses."""
    at = np.flatnonzero(np.diff(np.floor(2.0 * cycle + rng.random())))
    envelope = np.maximum(0.0, share + slow(count, rng, 1.5, 0.35)) * power
    kept = at[rng.random(len(at)) < envelope[at // int(SAMPLE_RATE / CONTROL_RATE)]]
    return np.asarray(kept + rng.normal(0.0, 25.0, len(kept)).astype(np.int64), dtype=np.int64)


def rattling_compact(count: int, rng: Generator) -> Array:
    """A worn small oven: its plate and a loose sheet chatter with the hum and drop out of it; short power cycles.

    Model: a vibro-impact: a part that lies loose is thrown by the force at twice the mains frequency and strikes at
    nearly each peak, with random omissions and forces; struck glass and sheet metal ring for 20 to 60 ms. The rest as
    `turntable_transformer`, with a turntable of 5/6 rpm and a cycle of 12 to 16 s. Units: what is loose, how much.
    """
    held = session(count, rng, (25.0, 90.0), (5.0, 8.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(count, rng, held.cooking, rng.uniform(12.0, 16.0), rng.uniform(0.55, 0.95))
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(500.0, 1000.0))
    speed = spin_down(count, rng, held.cooking, 0.1)
    air, tones = shaded_pole_fan(count, rng, speed, nominal, (0.14, 0.24), rng.uniform(700.0, 1200.0))
    strikes = _chatter(count, rng, cycle, power, rng.uniform(0.15, 0.6))
    force = np.exp(rng.normal(-0.5, 0.5, len(strikes)))
    glass = modes([(rng.uniform(1500.0, 6000.0), rng.uniform(20.0, 60.0), 18.0) for _ in range(7)])
    sheet = sheet_metal(rng, 300.0, 3000.0, 10.0)
    rattle = struck(count, rng, strikes, force, glass + slopes([(700.0, -9.0), (2500.0, 0.0), (9000.0, -14.0)]), 0.03)
    buzz = struck(
        count, rng, strikes, 0.7 * force, sheet + slopes([(300.0, -3.0), (900.0, 0.0), (6000.0, -22.0)]), 0.04
    )
    return np.asarray(
        radiated(decibels(rng.uniform(2.0, 7.0)) * hum, sheet)
        + decibels(rng.uniform(-4.0, 3.0)) * (rattle + buzz)
        + decibels(-3.0) * air
        + decibels(rng.uniform(-10.0, -4.0)) * tones
        + decibels(rng.uniform(-9.0, -3.0)) * turntable(count, rng, held.cooking, nominal / 10.0)
        + 2.5 * clicks(count, rng, relay, 700.0, 5000.0)
        + 2.0 * door(count, rng, held)
        + 0.9 * beeps(count, rng, held.ends + 5000, rng.uniform(2500.0, 2900.0), rng.uniform(0.9, 1.5), 2.0, 1)
        + 1.5 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def inverter_turntable(count: int, rng: Generator) -> Array:
    """An oven with an inverter: a thin buzz in the noise of a fast fan; power steps without a relay; five beeps.

    Model: `inverter` at a power that changes by steps every 5 to 40 s, and cycles of 22 s at the lowest ones (table of
    Panasonic's service manual of NN-H264: 17 s of 22 at 30 %, 11 of 22 at 20 %); fan slip 6 to 14 %; plate 5/6 rpm.
    """
    held = session(count, rng, (30.0, 120.0), (5.0, 9.0))
    nominal, cycle = mains(count, rng)
    step = int(rng.uniform(5.0, 20.0) * CONTROL_RATE)
    steps = np.repeat(rng.choice([0.45, 0.6, 0.8, 1.0], frames(count) // step + 1), step)
    power = held.cooking * steps[: frames(count)]
    if rng.random() < 0.3:
        power = power * duty(count, rng, held.cooking, 22.0, float(rng.choice([0.5, 0.77])))[0]
    power = np.convolve(np.pad(power, 30, mode="edge"), np.full(61, 1 / 61), mode="valid")
    buzz = inverter(count, rng, cycle, nominal, power)
    speed = spin_down(count, rng, held.cooking, rng.uniform(1.0, 3.0))
    air, tones = shaded_pole_fan(count, rng, speed, nominal, (0.06, 0.14), rng.uniform(400.0, 650.0))
    # The board lies in the fan's duct: what it sings leaves by the louvres, too.
    case = sheet_metal(rng, 250.0, 2500.0, 9.0) + louvres(rng)
    pitch = rng.uniform(3900.0, 4200.0)
    return np.asarray(
        1.2 * air
        + radiated(decibels(rng.uniform(-9.0, -2.0)) * buzz, case)
        + decibels(rng.uniform(-12.0, -6.0)) * tones
        + decibels(rng.uniform(-12.0, -5.0)) * turntable(count, rng, held.cooking, nominal / 10.0)
        + 1.5 * clicks(count, rng, held.starts, 900.0, 6000.0)
        + 2.0 * door(count, rng, held)
        + 0.8 * beeps(count, rng, held.ends + 12_000, pitch, 0.25, rng.uniform(0.5, 0.9), 5)
        + 0.5 * beeps(count, rng, held.keys, pitch, 0.06, 1.0, 1)
        + kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def flatbed_stirrer(count: int, rng: Generator) -> Array:
    """A flatbed oven: no plate, but a metal stirrer that flaps over the ceiling in the wind of two axial fans.

    Model: `inverter`; a stirrer of 4 to 6 vanes on plastic bearings turns 0.6 to 1.8 times a second, driven by air, so
    irregularly: each vane chops the flow and ticks at a worn place; two fans on four poles (slip 4 to 9 %) beat.
    """
    held = session(count, rng, (50.0, 180.0), (7.0, 11.0))
    nominal, cycle = mains(count, rng)
    power = held.cooking * np.clip(rng.uniform(0.6, 1.0) + slow(count, rng, 0.2, 0.03), 0.0, 1.0)
    buzz = inverter(count, rng, cycle, nominal, power)
    speed = spin_down(count, rng, held.cooking, rng.uniform(4.0, 9.0))
    first = shaded_pole_fan(count, rng, speed, nominal / 2.0, (0.04, 0.09), rng.uniform(250.0, 450.0))
    second = shaded_pole_fan(count, rng, speed, nominal / 2.0, (0.04, 0.09), rng.uniform(350.0, 600.0))
    vanes = int(rng.integers(4, 7))
    stir = rng.uniform(0.6, 1.8) * held.cooking * np.exp(slow(count, rng, 1.0, 0.06)) + 0.01
    turns = turns_of(stir, count, rng.random())
    chop = np.exp(1.2 * (cosine(vanes * turns) - 1.0))
    flutter = noise(count, rng, turbulence(rng, rng.uniform(500.0, 1000.0), 5.0)) * chop * expand(speed, count)
    ticks = np.flatnonzero(np.diff(np.floor(turns)))
    knock = struck(
        count, rng, ticks, np.exp(rng.normal(-0.2, 0.5, len(ticks))), sheet_metal(rng, 700.0, 4000.0, 12.0), 0.05
    )
    pitch = rng.uniform(2250.0, 2450.0)
    return np.asarray(
        0.7 * (first[0] + second[0])
        + radiated(
            decibels(rng.uniform(-9.0, -2.0)) * buzz
            + decibels(rng.uniform(-12.0, -6.0)) * (first[1] + second[1])
            + decibels(rng.uniform(-8.0, -1.0)) * flutter,
            sheet_metal(rng, 140.0, 1600.0, 8.0),
        )
        + 0.6 * knock
        + 2.0 * door(count, rng, held)
        + 0.7 * beeps(count, rng, held.ends + 8000, pitch, 0.15, 0.3, 4)
        + 0.4 * beeps(count, rng, held.keys, 1.25 * pitch, 0.05, 1.0, 1)
        + kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def convection_combination(count: int, rng: Generator) -> Array:
    """A combination oven: the hot fan at the back, heaters that tick, thermostat relays, magnetron now and then.

    Model: a radial wheel of 6 to 10 bent blades on a C-frame motor of four poles (slip 8 to 16 %) behind a perforated
    wall, with a dry bearing; heater and sheet metal expand in small slips, most of them after each switching (rate
    falls with a time constant of 4 to 9 s); the magnetron runs a third of each 30 s.
    """
    held = session(count, rng, (80.0, 240.0), (7.0, 12.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(count, rng, held.cooking, rng.uniform(26.0, 34.0), rng.uniform(0.2, 0.45))
    heater, thermostat = duty(count, rng, held.cooking, rng.uniform(14.0, 40.0), rng.uniform(0.4, 0.7))
    speed = spin_down(count, rng, held.cooking, 0.2)
    wheel = int(rng.integers(6, 11))
    turn = nominal / 2.0 * (1.0 - rng.uniform(0.08, 0.16))
    turns = turns_of(turn * speed * (1.0 + slow(count, rng, 0.6, 0.004)), count, rng.random())
    tones = rotor(turns, blades(wheel, rng, 0.5, 5, 0.6), rng, 30.0, 0.25, 0.2)
    squeal = rotor(turns, {k: rng.uniform(0.1, 1.0) for k in range(14, 60, 3)}, rng, 30.0, 0.5, 0.6)
    squeal = squeal * expand(np.maximum(0.0, slow(count, rng, 0.6, 0.7)) * speed, count)
    hot = noise(count, rng, turbulence(rng, rng.uniform(200.0, 360.0), rng.uniform(3.5, 5.0)) + ripple(rng, 3.0))
    cold, cold_tones = shaded_pole_fan(count, rng, speed, nominal, (0.08, 0.15), rng.uniform(600.0, 1000.0))
    lag = since_change(heater, rng.uniform(4.0, 9.0))
    ticking = impacts(count, rng, 0.3 + 7.0 * lag, sheet_metal(rng, 900.0, 6000.0, 14.0), 0.8, 0.05)
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(300.0, 600.0))
    return np.asarray(
        1.2 * hot * expand(speed**2.5 * np.exp(slow(count, rng, 5.0, 0.08)), count)
        + radiated(
            decibels(rng.uniform(-6.0, 0.0)) * tones
            + decibels(rng.uniform(-16.0, -8.0)) * squeal
            + decibels(rng.uniform(-3.0, 3.0)) * hum,
            sheet_metal(rng, 150.0, 1800.0, 7.0),
        )
        + 0.5 * cold
        + decibels(-14.0) * cold_tones
        + 0.35 * ticking
        + 2.0 * clicks(count, rng, np.sort(np.concatenate([relay, thermostat])), 600.0, 4500.0)
        + 2.5 * door(count, rng, held)
        + 0.8 * beeps(count, rng, held.ends + 9000, rng.uniform(2650.0, 2800.0), 0.5, 1.0, 4)
        + kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def over_range_vent(count: int, rng: Generator) -> Array:
    """An oven over the range with its extractor on: squirrel-cage blowers over the hum, two speeds, grease filters.

    Model: two cages of 32 to 44 short blades on a capacitor motor of two poles with speed windings (turns: 60 to 92 %
    of the mains frequency): the blade tone at 1 to 2.3 kHz is weak and wide; the noise falls by 2 to 3 dB per
    octave band, as that of forward-curved wheels does; mesh filters hum like a comb. The inlet is below the oven, so
    the blowers are heard round its edge. The oven as `turntable_transformer`. Units: cages, windings, filters, core.
    """
    held = session(count, rng, (35.0, 140.0), (6.0, 10.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(count, rng, held.cooking, rng.uniform(28.0, 36.0), rng.uniform(0.5, 1.0))
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(200.0, 380.0))
    high = spells(count, rng, (10.0, 40.0), (10.0, 40.0), 1.5)
    low, top = np.sort(rng.uniform(0.6, 0.92, 2))
    speed = (low + (top - low) * high) * (1.0 + slow(count, rng, 0.4, 0.004))
    cages = int(rng.integers(32, 45))
    turns = turns_of(nominal * speed, count, rng.random())
    orders = {1: 0.6, 2: 0.5, 3: 0.3, 4: 0.2, 5: 0.15, cages: 0.6, cages - 1: 0.25, cages + 1: 0.25, 2 * cages: 0.15}
    tones = rotor(turns, orders, rng, 60.0, 0.4, 0.5)
    comb = modes([(rng.uniform(700.0, 3200.0), rng.uniform(3.0, 8.0), 6.0) for _ in range(5)])
    blow = noise(
        count, rng, turbulence(rng, rng.uniform(280.0, 600.0), rng.uniform(5.0, 6.0), 5.0, 2.5) + comb + louvres(rng)
    )
    air, fan = shaded_pole_fan(count, rng, spin_down(count, rng, held.cooking, 0.2), nominal, (0.08, 0.14), 900.0)
    grease = impacts(count, rng, 0.7 * high + 0.1, slopes([(250.0, -4.0), (1100.0, 0.0), (6000.0, -15.0)]), 0.7, 0.08)
    return np.asarray(
        1.6 * blow * expand((speed / top) ** 2.5 * np.exp(slow(count, rng, 8.0, 0.08)), count)
        + decibels(rng.uniform(-9.0, -3.0)) * tones * expand((speed / top) ** 2.5, count)
        + radiated(decibels(rng.uniform(0.0, 6.0)) * hum, sheet_metal(rng, 130.0, 1400.0, 8.0))
        + 0.4 * air
        + decibels(-14.0) * fan
        + 0.4 * grease
        + decibels(rng.uniform(-14.0, -8.0)) * turntable(count, rng, held.cooking, nominal / 20.0)
        + 2.0 * clicks(count, rng, relay, 450.0, 3500.0)
        + 2.5 * door(count, rng, held)
        + 0.9 * beeps(count, rng, held.ends + 9000, rng.uniform(3000.0, 3400.0), 0.35, 0.7, 3)
        + kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


_TRANSFORMERS = "M. van der Veen et al., Measuring acoustic noise emitted by power transformers, AES 109th conv. (2000)"
_INVERTERS = "C. Bocchiola, Parametric design guidelines for MW oven inverter; Panasonic service manual NN-H264"
_POPCORN = "E. Virot and A. Ponomarenko, Popcorn: critical temperature, jump and sound, J. R. Soc. Interface 12 (2015)"
_FANS = "A. Guédel, Fan Acoustics: Noise Generation and Control Methods, AMCA (2007)"
_COILS = "J. D. Jackson, Classical Electrodynamics (3rd ed. 1998), chapter 5: force between currents"
_M = "microwave"

VOICES: tuple[Voice, ...] = (
    Voice(
        _M, "turntable_transformer", "train", "mains transformer and turntable", _TRANSFORMERS, turntable_transformer
    ),
    Voice(_M, "rattling_compact", "train", "mains transformer with loose parts", _TRANSFORMERS, rattling_compact),
    Voice(_M, "inverter_turntable", "train", "inverter", _INVERTERS, inverter_turntable),
    Voice(_M, "flatbed_stirrer", "train", "inverter with stirrer", _INVERTERS, flatbed_stirrer),
    Voice(_M, "convection_combination", "train", "convection fan and heaters", _FANS, convection_combination),
    Voice(_M, "over_range_vent", "train", "squirrel-cage blowers", _FANS, over_range_vent),
    Voice(_M, "popcorn", "validation", "mains transformer and bursting food", _POPCORN, popcorn),
    Voice(_M, "timer_bell", "test", "mains transformer with clockwork timer", _TRANSFORMERS, timer_bell),
    Voice(_M, "inverter_quiet", "test", "inverter", _INVERTERS, inverter_quiet),
    Voice(_M, "commercial_twin", "test", "two supplies and blowers", _TRANSFORMERS, commercial_twin),
    Voice(_M, "quartz_grill", "train", "heaters in quartz tubes", _COILS, quartz_grill),
    Voice(_M, "heavy_stirrer", "train", "mains transformer and stirrer on a belt", _TRANSFORMERS, heavy_stirrer),
    Voice(
        _M,
        "crossflow_built_in",
        "train",
        "mains transformer and cross-flow fan",
        "Y. Cho and Y. J. Moon, Discrete noise prediction of variable pitch cross-flow fans, J. Fluids Eng. 125 (2003)",
        crossflow_built_in,
    ),
    Voice(
        _M,
        "inverter_defrost",
        "train",
        "inverter in pulses and phase-controlled fan",
        "Panasonic service manual NN-H264; phase control: A. E. Fitzgerald, C. Kingsley, S. D. Umans, Electric "
        "Machinery (6th ed. 2003)",
        inverter_defrost,
    ),
    Voice(
        _M,
        "drawer_oven",
        "train",
        "mains transformer in a motor-driven drawer",
        f"{_TRANSFORMERS}; J. D. Smith, Gear Noise and Vibration (2nd ed. 2003)",
        drawer_oven,
    ),
)
