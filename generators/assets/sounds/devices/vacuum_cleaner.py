"""The voices of vacuum cleaners.

Levels inside a voice are dB re the broadband noise of its fan at full speed. Airborne noise of a fan grows with about
the fifth power of its speed (dipole sources): amplitudes follow speed^2.5.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.vacuum_cleaner_battery import car_plug_in, hand_brushed, robot, stick
from generators.assets.sounds.devices.vacuum_cleaner_canisters import bagless_canister, straight_through
from generators.assets.sounds.devices.vacuum_cleaner_parts import (
    Habit,
    brush_roll,
    debris,
    hose,
    housing,
    scraping,
    surroundings,
    switch,
    universal_motor,
    work,
)
from generators.assets.sounds.devices.vacuum_cleaner_pipes import central, stretch_hose, wet_dry
from generators.assets.sounds.devices.vacuum_cleaner_quiet import backpack, corded_handheld, quiet_canister
from generators.assets.sounds.devices.vacuum_cleaner_rolls import (
    carpet_extractor,
    low_power_canister,
    robot_mapping,
    stick_brushed,
    upright_bagged,
)
from generators.assets.sounds.fans import (
    GRID,
    Signal,
    cosine,
    decibels,
    expand,
    impacts,
    noise,
    radiated,
    ripple,
    rotor,
    slopes,
    slow,
    spells,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array
from generators.assets.sounds.voice import Voice


def canister_hard_floor(count: int, rng: Generator) -> Array:
    """A canister of the strong kind over tiles or parquet: bare air, tonal motor, hard wheels, grit.

    Model: universal motor with one centrifugal impeller at 16 to 22 thousand rpm before a vaned diffuser (Čudina and
    Prezelj 2007), hose and tube as a pipe of 2.6 to 3.4 m. Units: blades, speed, hum, resonances, hard wheels.
    """
    take = work(count, rng, Habit(seal=(30.0, 90.0)))
    shaft = rng.uniform(265.0, 370.0) * take.speed
    motor = universal_motor(count, rng, shaft, int(rng.integers(6, 9)), rng.uniform(0.15, 0.5), rng.uniform(-9.0, 0.0))
    motor = radiated(motor, housing(rng, 250.0, 3500.0, 9.0))
    loud = take.flow**2.5
    air = noise(count, rng, turbulence(rng, rng.uniform(450.0, 1000.0), rng.uniform(3.5, 5.5)) + hose(rng, 3.0, 7.0))
    gap = noise(count, rng, turbulence(rng, rng.uniform(2200.0, 4200.0), rng.uniform(4.0, 6.0)))
    wheels = scraping(count, rng, take.motion * take.contact, rng.uniform(180.0, 420.0), 5.0, 3.0)
    joints = impacts(
        count, rng, 2.2 * take.motion * take.contact, slopes([(140.0, -6.0), (700.0, 0.0), (5000.0, -16.0)]), 0.5, 0.05
    )
    grit = debris(count, rng, take.motion * take.contact * np.minimum(take.speed, 1.0), 25.0, 1600.0, 6000.0)
    return np.asarray(
        air * expand(loud, count)
        + decibels(rng.uniform(-9.0, -1.0)) * motor
        + decibels(rng.uniform(-12.0, -6.0)) * gap * expand(loud * (0.5 + take.contact + 1.5 * take.sealed), count)
        + decibels(rng.uniform(-12.0, -6.0)) * wheels
        + 1.2 * joints
        + 0.7 * grit
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.5),
        dtype=np.float64,
    )


def canister_turbo_carpet(count: int, rng: Generator) -> Array:
    """A canister with an air-turbine brush on carpet: the turbine howls in the air and labours in the pile.

    Model: a turbine of 12 to 18 buckets that turns 180 to 320 times a second when free; its speed follows the flow and
    the torque of the pile (a first-order lag). The brush, geared 1 to 5, beats the pile twice a turn. The motor runs
    at 30 to 36 thousand rpm. Units: turbine, brush, damping of the carpet, motor.
    """
    take = work(count, rng, Habit(lift=(3.0, 9.0), seal=(8.0, 25.0), load=(0.008, 0.02), strokes=(0.25, 0.5)))
    shaft = rng.uniform(440.0, 590.0) * take.speed
    motor = universal_motor(count, rng, shaft, int(rng.integers(8, 10)), rng.uniform(0.2, 0.5), rng.uniform(-6.0, 2.0))
    motor = radiated(motor, housing(rng, 180.0, 2000.0, 7.0) + slopes([(800.0, 0.0), (8000.0, -9.0)]))
    free = take.flow * (1.0 - take.contact * (0.35 + 0.3 * np.abs(take.push)) - 0.25 * take.sealed)
    spin = np.maximum(rng.uniform(180.0, 320.0) * free * (1.0 + slow(count, rng, 4.0, 0.015)), 0.3)
    buckets = int(rng.integers(12, 19))
    turns = turns_of(spin, count, rng.random())
    howl = rotor(turns, {1: 0.25, 2: 0.12, buckets: 1.0, 2 * buckets: 0.35}, rng, 330.0, 0.3, 0.2)
    beat = 0.5 + 0.5 * cosine(2.0 * turns / rng.uniform(4.0, 6.0))
    pile = scraping(count, rng, 0.35 + take.motion * take.contact, rng.uniform(350.0, 800.0), 6.0, 2.0)
    thump = noise(count, rng, slopes([(60.0, -3.0), (150.0, 0.0), (700.0, -16.0), (3000.0, -34.0)]) + ripple(rng, 2.0))
    air = noise(count, rng, turbulence(rng, rng.uniform(350.0, 650.0), rng.uniform(5.0, 7.0)) + hose(rng, 2.6, 8.0))
    loud = expand(take.flow**2.5, count)
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-8.0, -2.0)) * motor
        + decibels(rng.uniform(-12.0, -4.0)) * howl * expand((spin / 250.0) ** 2, count)
        + decibels(rng.uniform(-9.0, -3.0)) * pile * (0.5 + beat) * expand(np.minimum(take.speed, 1.0), count)
        + decibels(rng.uniform(-12.0, -5.0)) * thump * beat**2 * loud
        + 0.25 * debris(count, rng, take.motion * np.minimum(take.speed, 1.0), 10.0, 800.0, 3000.0)
        + surroundings(count, rng, take.speed),
        dtype=np.float64,
    )


def bagged_dimmed(count: int, rng: Generator) -> Array:
    """A quiet bagged canister whose power a triac sets: soft air, and a buzz of the mains at reduced power.

    Model: phase control: the current flows from the firing angle to the next zero, so the torque is a train of cut
    half waves with many harmonics of 100 or 120 Hz that grow as the power is reduced; the rest as a canister at 13 to
    17 thousand rpm in a lined housing. Units: speed, firing angles, lining, hose.
    """
    powers = tuple(rng.choice([0.55, 0.7, 0.85, 1.0], 3, replace=False))
    take = work(count, rng, Habit(powers=powers, rise=(0.5, 1.1), strokes=(0.35, 0.75), seal=(15.0, 50.0)))
    shaft = rng.uniform(215.0, 260.0) * take.speed
    lining = slopes([(300.0, 0.0), (1200.0, -5.0), (5000.0, -14.0), (16_000.0, -24.0)])
    motor = universal_motor(
        count, rng, shaft, int(rng.integers(9, 12)), rng.uniform(0.4, 0.8), rng.uniform(-10.0, -4.0)
    )
    mains = float(rng.choice([50.0, 60.0])) * (1.0 + slow(count, rng, 0.3, 4e-4))
    cycle = turns_of(2.0 * mains, count, rng.random())
    angle = np.clip(1.05 - take.speed, 0.05, 0.7) * (1.0 + slow(count, rng, 8.0, 0.02))
    place = np.mod(cycle, 1.0)
    fired = np.sin(np.pi * place.astype(np.float32)) * (place > expand(angle, count))
    buzz = radiated(
        np.diff(fired, prepend=0.0), housing(rng, 300.0, 2500.0, 12.0) + slopes([(400.0, 0.0), (6400.0, -30.0)])
    )
    buzz /= np.sqrt(np.mean(np.square(buzz))) + 1e-9
    air = noise(count, rng, turbulence(rng, rng.uniform(260.0, 480.0), rng.uniform(4.0, 5.5)) + hose(rng, 2.8, 6.0))
    brush = scraping(count, rng, take.motion * take.contact, rng.uniform(600.0, 1500.0), 4.0, 2.0)
    loud = expand(take.flow**2.5, count)
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-8.0, -3.0)) * radiated(motor, housing(rng, 150.0, 1200.0, 9.0) + lining)
        + decibels(rng.uniform(-16.0, -9.0)) * buzz * expand(np.minimum(take.speed, 1.0), count)
        + decibels(rng.uniform(-12.0, -6.0)) * brush
        + 0.3 * debris(count, rng, take.motion * np.minimum(take.speed, 1.0), 8.0, 1000.0, 4000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 0.8),
        dtype=np.float64,
    )


def upright_carpet(count: int, rng: Generator) -> Array:
    """An upright on carpet: dirty-air fan of few blades, a belt, and a beater bar that drums on the pile.

    Model: universal motor at 12 to 16 thousand rpm whose shaft drives a roll 3.5 to 5 times slower through a flat
    belt; strips of bristles or beater bars strike the pile 2 times a turn; the motor's cooling fan sings at its blade
    rate (T. A. Brungart, G. C. Lauchle and R. K. Ramanujam, "Installation effects on fan acoustic and aerodynamic
    performance", Noise Control Eng. J. 47(1) (1999) 3–7). Units: speed, ratio, fans, carpet, slipping belt.
    """
    take = work(count, rng, Habit(strokes=(0.22, 0.42), lift=(15.0, 45.0), seal=(25.0, 80.0), load=(0.015, 0.04)))
    shaft = rng.uniform(200.0, 265.0) * take.speed
    motor = universal_motor(count, rng, shaft, int(rng.integers(4, 7)), rng.uniform(0.5, 1.0), rng.uniform(-4.0, 3.0))
    slip = 1.0 - 0.03 * take.contact * np.abs(take.push) + slow(count, rng, 3.0, 0.004)
    bristles, knocks = brush_roll(count, rng, shaft * slip / rng.uniform(3.5, 5.0), 2, rng.uniform(250.0, 500.0))
    cooling = int(rng.integers(9, 13))
    sing = rotor(turns_of(shaft, count), {cooling: 1.0, 2 * cooling: 0.5, 3 * cooling: 0.2}, rng, 270.0, 0.2, 0.1)
    air = noise(count, rng, turbulence(rng, rng.uniform(220.0, 420.0), rng.uniform(3.5, 5.0)))
    loud = expand(take.flow**2.5, count)
    pile = expand(take.speed * (0.35 + 0.65 * take.contact) * (0.8 + 0.4 * take.motion), count)
    return np.asarray(
        air * loud
        + radiated(
            decibels(rng.uniform(-7.0, -2.0)) * motor
            + decibels(rng.uniform(-8.0, -2.0)) * knocks * pile
            + decibels(rng.uniform(-14.0, -6.0)) * sing * loud,
            housing(rng, 120.0, 1800.0, 10.0),
        )
        + decibels(rng.uniform(-3.0, 2.0)) * bristles * pile
        + 0.5 * debris(count, rng, np.minimum(take.speed, 1.0) * take.motion, 14.0, 700.0, 3500.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 2.0),
        dtype=np.float64,
    )


#: Level of the leak re the noise of the fan (dB), and where its noise is loudest (Hz): wear of the bin's lip seal.
_LEAK_DB, _LEAK_PEAK = (-24.0, -13.0), (25_000.0, 60_000.0)


def _leak(count: int, rng: Generator) -> Signal:
    """Air that hisses past the lip seal of a bin that is taken off every day: noise of unit RMS.

    Model: the noise of a jet, IEC 60534-8-3 (control valves): loudest at .2·speed/diameter, which for 100 to 150 m/s
    (a suction of some 10 kPa) and a gap of .5 to 1 mm lies above hearing, so the density rises by 2 dB per octave up to
    its end; no filter and no lining is in its way.
    """
    peak = rng.uniform(*_LEAK_PEAK)
    frequency = np.maximum(GRID, 20.0)
    thirds = -10.0 * np.log10((1.0 + (frequency / (2 * peak)) ** 2.5) * (1.0 + (peak / (2 * frequency)) ** 1.7))
    return noise(count, rng, thirds - 10.0 * np.log10(frequency) + ripple(rng, 1.5))


def upright_cyclone(count: int, rng: Generator) -> Array:
    """A bagless upright: the cyclone's swirl over the motor, crumbs that circle in the bin, a roll that is declutched.

    Model: the core of a swirling flow precesses at a frequency proportional to the flow and modulates the noise
    (T. A. Grimble and M. P. Juniper, "Local linear stability analysis of cyclone separators", J. Fluid Mech. (2017)):
    a broad peak at 300 to 700 Hz that wanders with the flow; crumbs rattle round the bin's wall; its seal leaks
    (`_leak`), the more the higher the suction. The motor, of 26 to 31 thousand rpm, runs between two filters in a shell
    whose mass holds back 5.5 dB per octave (mass law), so its brushes are faint. The roll of 4 rows is stopped over
    hard floor. Units: cyclone, bin, seal, roll, motor.
    """
    take = work(count, rng, Habit(strokes=(0.3, 0.55), lift=(8.0, 30.0), seal=(20.0, 60.0), fall=(1.2, 2.2)))
    shaft = rng.uniform(430.0, 520.0) * take.speed
    motor = universal_motor(
        count, rng, shaft, int(rng.integers(11, 14)), rng.uniform(0.3, 0.7), rng.uniform(-8.0, -2.0)
    )
    motor = radiated(motor, slopes([(500.0, 0.0), (1000.0, 0.0), (16_000.0, -22.0)]))
    rolling = spells(count, rng, (6.0, 20.0), (10.0, 40.0), 0.7) * np.minimum(take.speed, 1.0)
    spin = np.maximum(rng.uniform(62.0, 85.0) * rolling * (1.0 - 0.04 * take.contact * np.abs(take.push)), 0.3)
    bristles, knocks = brush_roll(count, rng, spin, 4, rng.uniform(900.0, 1800.0))
    swirl = turns_of(
        np.maximum(rng.uniform(300.0, 700.0) * take.flow * (1.0 + slow(count, rng, 30.0, 0.05)), 1.0), count
    )
    core = rotor(swirl, {1: 1.0, 2: 0.3}, rng, 800.0, 0.4, 0.5)
    busy = take.motion * take.contact * np.minimum(take.speed, 1.0)
    circling = np.maximum(0.0, slow(count, rng, 0.25, 1.0)) * np.minimum(take.speed, 1.0)
    bin_body = slopes([(600.0, -8.0), (1400.0, 0.0), (4200.0, -3.0), (12_000.0, -18.0)]) + ripple(rng, 6.0, 5.0)
    air = noise(count, rng, turbulence(rng, rng.uniform(800.0, 1500.0), rng.uniform(4.0, 6.0)))
    loud = expand(take.flow**2.5, count)
    return np.asarray(
        air * loud
        + radiated(
            decibels(rng.uniform(-7.0, -2.0)) * motor + decibels(-5.0) * knocks * expand(rolling, count),
            housing(rng, 200.0, 2600.0, 9.0),
        )
        + decibels(rng.uniform(-8.0, -3.0)) * core * loud
        + decibels(rng.uniform(-6.0, -1.0)) * bristles * expand(rolling * (0.3 + 0.7 * take.contact), count)
        + 0.5 * impacts(count, rng, 90.0 * circling, bin_body, 0.6, 0.02)
        + decibels(rng.uniform(*_LEAK_DB)) * _leak(count, rng) * expand(take.speed**2 * (1.0 + take.sealed), count)
        + 0.6 * debris(count, rng, busy, 20.0, 1200.0, 5000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.2),
        dtype=np.float64,
    )


_SUCTION_UNITS = (
    "M. Čudina and J. Prezelj, Noise generation by vacuum cleaner suction units, Applied Acoustics 68 (2007)"
)
_CANISTERS = "S. Atamer and M. E. Altinsoy, Vacuum cleaner noise annoyance, Applied Sciences 13 (2023) 6136"
_UPRIGHTS = "T. A. Brungart, G. C. Lauchle and R. K. Ramanujam, Noise Control Eng. J. 47(1) (1999) 3–7"
_HANDHELDS = "T. A. Brungart and G. C. Lauchle, Noise Control Eng. J. 49(2) (2001) 73–78"
_HOSES = "B. Rajavel and M. G. Prasad, Acoustics of corrugated pipes: a review, Applied Mechanics Reviews 65 (2013)"
_CYCLONES = "T. A. Grimble and M. P. Juniper, Local linear stability analysis of cyclone separators, JFM (2017)"
_COGGING = "N. Bianchi and S. Bolognani, IEEE Trans. Industry Applications 38 (2002) 1259–1265"
_GEARS = (
    "J. D. Smith, Gear Noise and Vibration (2nd ed. 2003), on tooth meshing; D. A. Bies, C. H. Hansen, Engineering "
    "Noise Control (4th ed. 2009), on fans"
)
_C = "vacuum_cleaner"

VOICES: tuple[Voice, ...] = (
    Voice(_C, "canister_hard_floor", "train", "universal motor with impeller", _SUCTION_UNITS, canister_hard_floor),
    Voice(_C, "canister_turbo_carpet", "train", "universal motor with air turbine", _CANISTERS, canister_turbo_carpet),
    Voice(_C, "upright_carpet", "train", "universal motor with brush roll", _UPRIGHTS, upright_carpet),
    Voice(
        _C,
        "stick_brushless",
        "train",
        "high-speed brushless motor",
        "maker's data: Dyson digital motor V2, 104,000 rpm (2009)",
        stick,
    ),
    Voice(_C, "robot", "train", "small fan, side brush and gears", _GEARS, robot),
    Voice(_C, "wet_dry_drum", "train", "bypass motor over a drum", _SUCTION_UNITS, wet_dry),
    Voice(_C, "bagged_dimmed", "validation", "universal motor with phase control", _CANISTERS, bagged_dimmed),
    Voice(_C, "upright_cyclone", "test", "universal motor with brush roll", _UPRIGHTS, upright_cyclone),
    Voice(_C, "hand_brushed", "test", "direct-current motor with working fan", _HANDHELDS, hand_brushed),
    Voice(_C, "central_inlet", "test", "corrugated hose on a distant motor", _HOSES, central),
    Voice(_C, "bagless_canister", "train", "universal motor with cyclones", _CYCLONES, bagless_canister),
    Voice(_C, "straight_through", "train", "two-stage motor in a cloth bag's air", _SUCTION_UNITS, straight_through),
    Voice(_C, "car_plug_in", "train", "direct-current motor with working fan", _COGGING, car_plug_in),
    Voice(_C, "stretch_hose", "train", "corrugated hose beside its motor", _HOSES, stretch_hose),
    Voice(_C, "quiet_canister", "train", "air at a nozzle, lined motor", _SUCTION_UNITS, quiet_canister),
    Voice(_C, "backpack", "train", "two-stage fan in foam", _SUCTION_UNITS, backpack),
    Voice(_C, "corded_handheld", "train", "universal motor with working fan", _HANDHELDS, corded_handheld),
    Voice(_C, "stick_brushed", "train", "direct-current motor, roll with its own", _COGGING, stick_brushed),
    Voice(_C, "upright_bagged", "train", "bypass motor with brush roll", _UPRIGHTS, upright_bagged),
    Voice(_C, "robot_mapping", "train", "fan, two rubber rolls and gears", _GEARS, robot_mapping),
    Voice(_C, "low_power_canister", "train", "large impeller, chopped current", _SUCTION_UNITS, low_power_canister),
    Voice(_C, "carpet_extractor", "train", "bypass motor, spray pump, wet nozzle", _SUCTION_UNITS, carpet_extractor),
)
