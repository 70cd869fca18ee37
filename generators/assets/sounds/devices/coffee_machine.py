"""The voices of coffee machines: pumps, grinders, boiling water, steam.

Each voice repeats its programme with other durations each time and begins somewhere in it. Levels are peaks or RMS re
the loudest part. The pauses are shorter than in a kitchen; in them stays what stands there: a boiler that simmers, a
flame, a transformer, a fan.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.devices.coffee_machine_parts import (
    BOILING,
    CONDENSING,
    JET,
    SPITTING,
    STANDBY,
    Housing,
    VibrationPump,
    cracks,
    drips,
    first_start,
    motor,
    run_up,
    slugs,
    unrest,
)
from generators.assets.sounds.devices.coffee_machine_small import geared_conical_grinder, pod_air_pump
from generators.assets.sounds.devices.coffee_machine_spinning import centrifugal_pod
from generators.assets.sounds.devices.coffee_machine_steam import instant_whipper, steam_espresso
from generators.assets.sounds.signals import Array, band_noise, harmonics, phase_of, time_axis
from generators.assets.sounds.voice import Voice
from generators.assets.sounds.water import (
    HOP,
    Spectrum,
    Take,
    frame_drift,
    gulps,
    knock,
    moving_peak,
    spectrum,
    whistle,
)


def vibration_pump_espresso(count: int, rng: Generator) -> Array:
    """Espresso machine with a vibration pump in a sheet-metal case: prime, build-up to 9 bar, shot, release.

    Unit: mains 50 or 60 Hz, case modes from 180 Hz, shot of 16 to 26 s. The pressure rises over 3 to 7 s as the puck
    is soaked: the pump is loud and rattles first, then grows duller (`VibrationPump`). At the end a three-way valve
    lets the pressure out with a hiss into the tray. Between shots the boiler simmers and its thermostat clicks.
    """
    take = Take(count, rng)
    housing, mains = Housing(rng, 180, 5200, 14, 0.07), float(rng.choice([50.0, 60.0]))
    pump = VibrationPump(mains, housing, rng.uniform(0.2, 0.5), rng.uniform(0.1, 0.25), rng.uniform(0.06, 0.14))
    shot, soak = rng.uniform(16.0, 26.0), rng.uniform(3.0, 7.0)
    now = first_start(rng, shot)
    while now < take.line.seconds:
        length = shot * rng.uniform(0.88, 1.12)
        full = rng.uniform(0.7, 0.95)
        course = [(0.0, 0.0), (0.25 * soak, 0.1), (soak, full), (0.7 * length, 0.93 * full), (length, 0.8 * full)]
        take.at(now - 0.03, 0.8, knock(rng, 600, 5000, 0.03, click=0.8))
        take.at(now, 1.0, pump.runs(rng, length, course))
        end = now + length
        drips(take, "cup", now + soak * 0.8, end, 1.0, 6.0)
        take.at(end, 0.9, knock(rng, 500, 4500, 0.04, click=0.8))
        take.at(end + 0.05, 0.6, knock(rng, 900, 6000, 0.03, click=1.0))
        take.line.add("release", (end + 0.04, 0.0), (end + 0.08, 0.55), (end + 0.35, 0.22))
        take.line.add("release", (end + rng.uniform(0.8, 1.6), 0.0))
        pause = rng.uniform(4.0, 11.0)
        tick = end + rng.uniform(0.3, 0.8) * pause
        take.at(tick, 0.35, knock(rng, 1200, 7000, 0.02, click=1.0))
        take.line.add("simmer", (end, 0.09), (tick, 0.09), (tick + 2.5, 0.16), (end + pause, 0.09))
        if rng.random() < 0.35:
            take.at(tick + 0.3, 0.9, pump.runs(rng, rng.uniform(0.8, 2.2), [(0.0, 0.0), (3.0, 0.1)]))
            pause += 2.0
        now = end + pause
    power = take.power("release", spectrum(SPITTING, rng), 3.0, 20.0)
    power += take.power("simmer", spectrum(BOILING, rng), 3.0, 14.0, least=0.09)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.05)
    water = 0.3 * take.bubbles("cup", 55, (0.7, 2.6), 1.0) + 0.15 * take.splashes("cup", 40, 1.0)
    return take.heard(power, water)


def capsule_machine(count: int, rng: Generator) -> Array:
    """Capsule machine: lever and piercing, pre-wetting, a pump at 15 bar and more with skipped half waves, ejection.

    The pump is that of `vibration_pump_espresso` in a small plastic case (modes from 260 Hz, short decays), kept at a
    high pressure from the first second; burst control leaves out every third to sixth stroke, which adds
    subharmonics of the mains. Unit: shot of 9 to 16 s, lever, drop of the capsule into the bin.
    """
    take = Take(count, rng)
    housing, mains = Housing(rng, 260, 4200, 9, 0.03, 0.2), float(rng.choice([50.0, 60.0]))
    hard, hum, chatter = rng.uniform(0.5, 1.0), rng.uniform(0.12, 0.3), rng.uniform(0.12, 0.25)
    pump = VibrationPump(mains, housing, hard, hum, chatter, int(rng.integers(3, 7)))
    shot, wet = rng.uniform(9.0, 16.0), rng.uniform(0.8, 1.8)
    now = first_start(rng, shot)
    while now < take.line.seconds:
        length = shot * rng.uniform(0.9, 1.1)
        take.at(now - 2.2, 0.9, knock(rng, 220, 2600, 0.07, 9))
        take.at(now - 2.2 + rng.uniform(0.15, 0.4), 1.6, knock(rng, 160, 2000, 0.09, 9, 0.6))
        take.at(now, 0.9, pump.runs(rng, wet, [(0.0, 0.1), (wet, 0.4)]))
        begin = now + wet + rng.uniform(0.8, 2.0)
        course = [(0.0, 0.4), (0.8, 0.8), (0.6 * length, 0.95), (length, 0.75)]
        take.at(begin, 1.0, pump.runs(rng, length, course))
        end = begin + length
        drips(take, "cup", begin + 1.0, end, 1.0, 3.5)
        take.line.add("puff", (end, 0.0), (end + 0.05, 0.3), (end + 0.5, 0.05), (end + 0.9, 0.0))
        throw = end + rng.uniform(2.0, 4.0)
        take.at(throw, 1.3, knock(rng, 180, 2200, 0.08, 9, 0.5))
        take.at(throw + rng.uniform(0.12, 0.25), 1.0, knock(rng, 250, 1800, 0.06, 7, 0.4))
        take.line.add("heat", (end, 0.1), (throw, 0.16), (throw + 3.0, 0.1))
        now = throw + rng.uniform(3.2, 8.0)
    power = take.power("puff", spectrum(SPITTING, rng), 4.0, 20.0)
    power += take.power("heat", spectrum(BOILING, rng, 1.5), 2.0, 10.0, least=0.09)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.06)
    water = 0.35 * take.bubbles("cup", 70, (0.6, 2.2), 0.5) + 0.2 * take.splashes("cup", 60, 0.5)
    return take.heard(power, water, 1.2)


def _vane_orders(rng: Generator, vanes: int) -> Array:
    """Levels of the multiples of a vane pump's speed: the passing of its vanes and what unevenness adds."""
    numbers = np.arange(1, 12 * vanes + 1)
    orders = np.where(numbers % vanes == 0, 0.8, 0.07) * (numbers / vanes) ** -1.1
    orders[:4] = 0.5, 0.35, 0.12, 0.2
    orders[vanes - 1] = 1.0
    return np.asarray(orders * rng.uniform(0.6, 1.4, len(orders)))


def rotary_pump_bar(count: int, rng: Generator) -> Array:
    """Bar machine with a rotary vane pump on a four-pole induction motor, steam for milk, and the knock box.

    Unit: mains 50 or 60 Hz, slip of 1 to 6 % (it follows the load), so 23.6 to 29.6 revolutions per second; 5 to 8
    vanes; a hum at twice the mains. Under pressure the pump deepens. Steam (holes of 2 mm, 1 bar) condenses in the
    milk; portafilters are knocked out two or three times.
    """
    take = Take(count, rng)
    mains, slip, vanes = float(rng.choice([50.0, 60.0])), rng.uniform(0.02, 0.045), int(rng.integers(5, 9))
    shot, steam = rng.uniform(18.0, 27.0), rng.uniform(6.0, 12.0)
    box, orders = Housing(rng, 90, 1600, 9, 0.16), _vane_orders(rng, vanes)
    now = first_start(rng, shot)
    while now < take.line.seconds:
        length = shot * rng.uniform(0.9, 1.1)
        end = now + length
        speed = run_up(length, 0.06, 0.25, 1.2)
        t = time_axis(len(speed))
        load = np.interp(t, [0.0, 1.0, 4.0, length, length + 0.3], [0.3, 0.5, 1.0, 0.9, 0.2])
        pitch = mains / 2.0 * (1.0 - slip * (0.6 + 0.6 * load)) * speed + 0.3
        hum = harmonics(phase_of(2 * mains, len(t)), [1.0, 0.3, 0.2, 0.08], rng) * (speed > 0.3) * (t < length)
        take.at(now, 0.32, motor(rng, pitch, orders, rng.uniform(0.5, 0.9)) * (0.8 + 0.3 * load) + 0.4 * hum)
        take.at(now - 0.02, 0.8, knock(rng, 300, 3500, 0.05, click=0.6))
        drips(take, "cup", now + 5.0, end, 1.0, 5.0)
        take.line.add("release", (end, 0.0), (end + 0.05, 0.5), (end + 0.5, 0.1), (end + 1.2, 0.0))
        begin = now + rng.uniform(0.5, 0.8) * length
        stop = begin + steam * rng.uniform(0.8, 1.2)
        take.line.add("purge", (begin - 1.2, 0.0), (begin - 1.1, 0.35), (begin - 0.5, 0.3), (begin - 0.4, 0.0))
        take.line.add("steam", (begin, 0.0), (begin + 0.4, 0.55), (stop - 0.5, 0.45), (stop, 0.0))
        take.line.add("purge", (stop + 1.0, 0.0), (stop + 1.1, 0.4), (stop + 1.5, 0.3), (stop + 1.6, 0.0))
        late = max(end, stop) + rng.uniform(2.0, 4.0)
        for k in range(int(rng.integers(2, 4))):
            take.at(late + 0.33 * k + rng.normal(0, 0.03), rng.uniform(1.4, 2.4), box.blow(0.3, 0.3))
        now = late + rng.uniform(2.5, 7.0)
    power = take.power("release", spectrum(SPITTING, rng), 3.0, 20.0)
    power += take.power("purge", spectrum(JET, rng), 1.5, 20.0)
    power += take.power("steam", spectrum(CONDENSING, rng) + 4.0, 3.0, 25.0)
    power += 0.25 * take.power("steam", spectrum(JET, rng), 3.0, 25.0)
    power += take.power("-", spectrum(BOILING, rng), 2.0, least=0.06)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.06)
    return take.heard(power, 0.25 * take.bubbles("cup", 50, (0.7, 2.4), 0.5) + 0.3 * take.splashes("steam", 60))


def burr_grinder(count: int, rng: Generator) -> Array:
    """Flat-burr grinder on an induction or geared motor: doses of 6 to 14 s, beans that break, a doser's lever.

    Unit: burrs at 1,260 to 1,740 per minute (21 to 29 Hz), 8 to 20 large teeth, whose passing tone is modulated by the
    eccentric carrier; 250 to 600 fractures a second while beans feed, fewer as the throat runs empty. A fan and the
    coasting disc remain for a second or two.
    """
    take = Take(count, rng)
    turns, teeth, dose = rng.uniform(21.0, 29.0), int(rng.integers(8, 21)), rng.uniform(6.0, 14.0)
    rate, lever = rng.uniform(250.0, 600.0), rng.uniform(220.0, 420.0)
    orders = np.full(3 * teeth, 0.05)
    orders[:4] = 0.8, 0.5, 0.2, 0.15
    orders[teeth - 2], orders[teeth - 1], orders[teeth], orders[2 * teeth - 1], orders[-1] = 0.35, 1.0, 0.3, 0.4, 0.2
    now = first_start(rng, dose)
    while now < take.line.seconds:
        length = dose * rng.uniform(0.85, 1.15)
        speed = run_up(length, 0.12, rng.uniform(0.5, 0.9), 2.5)
        t = time_axis(len(speed))
        stages = [0.0, 0.25, 0.6, 0.75 * length, 0.97 * length, length, length + 0.5]
        feed = np.interp(t, stages, [0.0, 0.5, 1.0, 0.9, 0.4, 0.3, 0.0])
        feed = np.clip(feed * (1.0 + unrest(len(t), rng, 3.0, 0.25)), 0.0, None)
        voice = motor(rng, turns * speed * (1.0 - 0.04 * feed) + 0.2, 0.35 * orders, rng.uniform(0.2, 0.4))
        crush = band_noise(len(t), rng, 500, 6500, 1) * feed * (1 + 0.4 * np.sin(phase_of(turns * speed, len(t))))
        take.at(now, 1.0, 0.7 * voice + 0.35 * crush + 1.6 * cracks(rng, rate * feed, 500, 8000, 0.012))
        take.at(now - 0.02, 0.8, knock(rng, 500, 4500, 0.04, click=0.9))
        take.at(now + length, 0.6, knock(rng, 500, 4500, 0.04, click=0.9))
        clack = now + length + rng.uniform(1.0, 2.2)
        for k in range(int(rng.integers(2, 6))):
            pull = clack + 0.36 * k + rng.normal(0, 0.03)
            take.at(pull, rng.uniform(0.6, 1.3), knock(rng, lever, 4200, 0.07, 9, 0.6))
        if rng.random() < 0.4:
            pour = clack + 2.2
            take.line.add("beans", (pour, 0.0), (pour + 0.3, 1.0), (pour + 1.3, 0.8), (pour + 1.9, 0.0))
        now = clack + rng.uniform(2.5, 7.0)
    power = take.power("-", spectrum(STANDBY, rng), 1.5, least=0.09)
    return take.heard(power, 0.9 * take.splashes("beans", 140), 1.2)


def drip_filter(count: int, rng: Generator) -> Array:
    """Filter machine: water boils in a heated tube, slugs of it are spat over the coffee, which drips into the jug.

    A bubble pump without moving parts but a check valve: 0.8 to 1.6 slugs per second, growing quicker, until the tank
    is empty and steam alone coughs through the tube. The jug's air resonates higher as it fills. Unit: tube of 190 to
    420 Hz, brew of 30 to 60 s (a cup or two), a click of the thermostat.
    """
    take = Take(count, rng)
    tube, brew, rate = rng.uniform(190.0, 420.0), rng.uniform(30.0, 60.0), rng.uniform(0.8, 1.6)
    jugs = [(0.0, 350.0)]
    now = first_start(rng, 0.8 * brew)
    while now < take.line.seconds:
        warm, length = rng.uniform(3.0, 6.0), brew * rng.uniform(0.9, 1.1)
        begin, end = now + warm, now + warm + length
        take.at(now, 0.6, knock(rng, 700, 5000, 0.03, click=0.8))
        take.line.add(
            "boil", (now, 0.06), (begin, 0.24), (end - 5.0, 0.2), (end, 0.34), (end + 3.0, 0.16), (end + 7.0, 0.07)
        )
        slugs(take, "spit", (begin, end - 7.0), (rate, 1.4 * rate), tube, 0.55)
        slugs(take, "cough", (end - 7.0, end + 1.5), (2.2 * rate, 5.0 * rate), 1.3 * tube, 1.0)
        drips(take, "jug", begin + 2.0, end + 1.0, 1.0, 6.0)
        jugs += [(begin, 280.0), (end, 620.0)]
        take.at(end + rng.uniform(2.0, 4.0), 0.5, knock(rng, 1500, 8000, 0.02, click=1.0))
        now = end + rng.uniform(5.0, 10.0)
    air = np.interp(take.line.times, *np.array(jugs).T)
    power = take.power("boil", spectrum(BOILING, rng), 3.0, 18.0, least=0.07)
    power += take.power("spit", spectrum(SPITTING, rng, 0.8), 4.0, 25.0)
    power += take.power("cough", spectrum(SPITTING, rng, 0.8, 2.0, 3), 5.0, 30.0)
    power += 0.02 * take.power("jug", spectrum(SPITTING, rng), 3.0, 16.0) * moving_peak(air, 5.0, 12.0)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.04)
    water = 0.45 * take.bubbles("jug", 26, (1.0, 4.5), 0.5) + 0.25 * take.splashes("jug", 16, 0.5)
    return take.heard(power, water + 0.25 * take.splashes("boil", 300), 1.8)


def moka_pot(count: int, rng: Generator) -> Array:
    """Moka pot on a gas flame: simmering, a quiet rise of coffee, then the gurgling of steam and water.

    Phases after L. Navarini et al., Appl. Therm. Eng. 29 (2009) 998 (the last is called strombolian) and C. Gianino,
    Am. J. Phys. 75 (2007) 43: as the boiler runs dry, steam breaks through the column; bursts of 4 to 12 a second grow
    until the pot is taken off. Unit: pot of 230 to 520 Hz, aluminium lid that rattles, a burner's roar.
    """
    take = Take(count, rng)
    pot, flame = rng.uniform(230.0, 520.0), rng.uniform(0.09, 0.15)
    heat, rise, boil = rng.uniform(8.0, 16.0), rng.uniform(6.0, 12.0), rng.uniform(9.0, 16.0)
    lid = Housing(rng, 900, 8000, 9, 0.12, 0.2)
    rattles = [lid.blow(0.15, 0.5) for _ in range(16)]
    now = first_start(rng, heat + rise)
    while now < take.line.seconds:
        up = now + heat * rng.uniform(0.85, 1.15)
        steam = up + rise * rng.uniform(0.85, 1.15)
        end = steam + boil * rng.uniform(0.85, 1.15)
        for k in range(int(rng.integers(3, 9))):
            take.at(now - 0.9 + 0.11 * k + rng.normal(0, 0.004), 0.35, knock(rng, 2500, 9000, 0.01, click=1.5))
        levels = ((now, 0.5), (now + 0.08, 1.8), (now + 0.4, 1.0), (end + 1.0, 1.0), (end + 1.5, 0.5))
        take.line.add("burner", *((moment, flame * level) for moment, level in levels))
        take.line.add("simmer", (now, 0.02), (up, 0.2), (steam, 0.14), (end, 0.2), (end + 2.0, 0.03))
        take.line.add(
            "trickle", (up, 0.0), (up + 1.0, 1.0), (steam, 1.0), (steam + 3.0, 0.4), (end, 0.1), (end + 1.0, 0.0)
        )
        slugs(take, "gurgle", (steam - 2.0, end), (3.5, rng.uniform(8.0, 12.0)), pot, 0.75)
        take.line.add("hiss", (steam - 1.0, 0.0), (steam + 2.0, 0.2), (end - 1.0, 0.5), (end + 1.5, 0.0))
        for moment in np.sort(rng.uniform(steam, end, int(3.0 * (end - steam)))):
            take.at(moment, 0.25 * rng.random() ** 2, rattles[rng.integers(16)])
        take.at(end + rng.uniform(0.4, 0.9), 1.2, lid.blow(0.4, 0.6))
        now = end + rng.uniform(5.0, 9.0)
    shape: Spectrum = {63: -14, 125: -7, 250: -3, 500: -1, 1000: -2, 2000: -3, 4000: -6, 8000: -11, 16_000: -25}
    power = take.power("burner", spectrum(shape, rng), 1.5, 12.0, least=0.05)
    power += take.power("simmer", spectrum(BOILING, rng), 2.5, 14.0)
    power += take.power("gurgle", spectrum(SPITTING, rng, 0.8, 2.0, 3), 5.0, 35.0)
    power += take.power("hiss", spectrum(JET, rng, 0.8), 3.5, 25.0)
    water = 0.35 * take.bubbles("trickle", 40, (0.8, 4.0)) + 0.8 * take.splashes("gurgle", 25)
    return take.heard(power, water + 0.25 * take.splashes("simmer", 150), 2.4)


def percolator(count: int, rng: Generator) -> Array:
    """Electric percolator: the rumble of a kettle, and perks that strike the glass knob, quicker as the water heats.

    The same pump by bubbles as in filter machines, in a single tube within the pot: perks at 0.7 per second when they
    begin, up to 3 or 4 per second at the boil; the pot of steel rings, the water falls back through the basket.
    Unit: tube of 420 to 900 Hz, pot's modes from 500 Hz, a run of 30 to 55 s, then keeping warm with a rare perk.
    """
    take = Take(count, rng)
    tube, run = rng.uniform(420.0, 900.0), rng.uniform(30.0, 55.0)
    knob = Housing(rng, 500, 7000, 11, 0.2, 0.25)
    now = first_start(rng, 0.8 * run)
    while now < take.line.seconds:
        warm, end = now + rng.uniform(6.0, 10.0), now + run * rng.uniform(0.9, 1.1)
        take.at(now, 0.6, knock(rng, 800, 6000, 0.02, click=1.0))
        moment = warm
        while moment < end + 8.0:
            share = min(1.0, (moment - warm) / (0.7 * (end - warm)))
            pace = (0.7 + 2.7 * share) if moment < end else rng.uniform(0.3, 0.7)
            force = float(np.exp(rng.normal(-0.3, 0.35)))
            perk = gulps(rng, int(rng.integers(1, 3)), tube * np.exp(rng.normal(0, 0.1)), 14.0, 0.4)
            take.at(moment, 0.9 * force, perk)
            take.at(moment + rng.uniform(0.03, 0.07), 0.5 * force, knob.blow(0.25, 0.3))
            take.line.add(
                "spray", (moment, 0.0), (moment + 0.06, 0.5 * force), (moment + 0.22, 0.1), (moment + 0.25, 0.03)
            )
            moment += max(0.27, np.exp(rng.normal(0.0, 0.18)) / pace)
        take.line.add("kettle", (now, 0.08), (warm, 0.42), (warm + 6.0, 0.25), (end, 0.22), (end + 4.0, 0.1))
        take.line.add("fall", (warm, 0.0), (warm + 4.0, 1.0), (end, 1.0), (end + 6.0, 0.1))
        take.at(end, 0.6, knock(rng, 1200, 7000, 0.02, click=1.0))
        now = end + 8.0 + rng.uniform(2.0, 5.0)
    power = take.power("kettle", spectrum(BOILING, rng), 2.5, 14.0, least=0.08)
    power += take.power("spray", spectrum(SPITTING, rng), 3.5, 25.0)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.05)
    water = 0.4 * take.bubbles("fall", 60, (1.0, 5.0), 1.0) + 0.2 * take.splashes("kettle", 200)
    return take.heard(power, water + 0.4 * take.splashes("fall", 10), 2.2)


def _drive(rng: Generator, length: float, gear: float, load: float) -> Array:
    """The geared motor of a brewing unit: its pitch sinks by the share ``load`` as the piston meets the coffee."""
    speed = run_up(length, 0.05, 0.06, 0.3)
    t = time_axis(len(speed)) / length
    pitch = gear * speed * (1.0 - load * np.clip(t, 0.0, 1.0) ** 3) + 1.0
    return motor(rng, pitch, [0.5, 0.8, 0.3, 0.2, 0.5, 0.1, 0.1, 0.25, 0.05, 0.05, 0.15], 0.35)


def bean_to_cup(count: int, rng: Generator) -> Array:
    """Fully automatic machine: conical grinder, brewing unit driven by a geared motor, pump, waste, rinse.

    The sequence is that of such machines: 4 to 8 s of grinding at low speed (a geared motor, 5 to 14 Hz at the cone), a
    worm drive that presses (its motor 70 to 130 Hz, deeper under load), pre-brewing and a pause, the shot at 9 bar,
    the drive back and the puck's fall, a short rinse. Unit: all speeds, plastic case with modes from 130 Hz.
    """
    take = Take(count, rng)
    housing, mains = Housing(rng, 130, 3000, 12, 0.05, 0.5), float(rng.choice([50.0, 60.0]))
    pump = VibrationPump(mains, housing, rng.uniform(0.1, 0.25), rng.uniform(0.2, 0.35), rng.uniform(0.04, 0.09))
    grind, cone, gear = rng.uniform(4.0, 8.0), rng.uniform(5.0, 14.0), rng.uniform(70.0, 130.0)
    ratio = int(rng.integers(12, 22))
    orders = np.full(2 * ratio, 0.04)
    orders[:2], orders[ratio - 1], orders[-1] = (0.15, 0.1), 0.5, 0.3
    now = first_start(rng, 30.0)
    while now < take.line.seconds:
        length = grind * rng.uniform(0.9, 1.1)
        speed = run_up(length, 0.1, 0.12, 0.6)
        feed = np.clip(speed * (1.0 + unrest(len(speed), rng, 4.0, 0.2)), 0.0, None)
        milling = motor(rng, cone * speed * (1.0 - 0.05 * feed) + 0.1, orders, rng.uniform(0.3, 0.5))
        take.at(now, 0.75, milling + 1.4 * cracks(rng, 330.0 * feed, 300, 4500, 0.02))
        press, back = rng.uniform(1.4, 2.4), rng.uniform(1.6, 2.6)
        at = now + length + rng.uniform(0.4, 1.0)
        take.at(at, 0.35, _drive(rng, press, gear, 0.35))
        take.at(at + press, 0.7, knock(rng, 120, 1500, 0.08))
        at += press + rng.uniform(0.3, 0.9)
        take.at(at, 0.9, pump.runs(rng, 1.6, [(0.0, 0.0), (1.6, 0.5)]))
        at += 1.6 + rng.uniform(1.5, 2.8)
        shot = rng.uniform(11.0, 19.0)
        end = at + shot
        take.at(at, 1.0, pump.runs(rng, shot, [(0.0, 0.4), (2.0, 0.85), (shot, 0.65)]))
        drips(take, "cup", at + 1.5, end, 1.0, 4.0)
        take.line.add("valve", (end, 0.0), (end + 0.05, 0.35), (end + 0.7, 0.06), (end + 1.0, 0.0))
        take.at(end + 1.2, 0.35, _drive(rng, back, gear, -0.1))
        take.at(end + 1.2 + back, 1.3, knock(rng, 90, 1200, 0.12, 9, 0.2))
        rinse = end + back + rng.uniform(2.0, 3.0)
        take.at(rinse, 0.8, pump.runs(rng, 2.0, [(0.0, 0.0), (2.0, 0.15)]))
        take.line.add("rinse", (rinse + 0.4, 0.0), (rinse + 0.7, 0.3), (rinse + 2.2, 0.25), (rinse + 3.0, 0.0))
        now = rinse + 3.0 + rng.uniform(2.0, 7.0)
    power = take.power("valve", spectrum(SPITTING, rng), 3.0, 18.0)
    power += take.power("rinse", spectrum(SPITTING, rng), 3.0, 18.0)
    power += take.power("-", spectrum(STANDBY, rng), 1.5, least=0.08)
    return take.heard(power, 0.3 * take.bubbles("cup", 60, (0.7, 3.0), 0.5) + 0.6 * take.splashes("rinse", 90), 1.3)


def blade_grinder(count: int, rng: Generator) -> Array:
    """Chopper with a two-armed blade on a universal motor: bursts, beans flung at the lid, a rising pitch.

    The blade turns 170 to 290 times a second under load (10,000 to 17,000 per minute; 20,000 to 30,000 idle): slow
    among whole beans, quicker as they become powder. The torque pulses at twice the mains. Beans strike blade and lid
    250 to 500 times a second at first; what remains is the rush of powder. After each burst the blade coasts.
    """
    take = Take(count, rng)
    turns, mains, lid = rng.uniform(170.0, 290.0), float(rng.choice([50.0, 60.0])), rng.uniform(250.0, 450.0)
    orders = np.array([1.0, 0.9, 0.25, 0.5, 0.12, 0.2, 0.06, 0.15, 0.05, 0.08, 0.03, 0.06]) * rng.uniform(0.5, 1.5, 12)
    now, powder = first_start(rng, 6.0), rng.uniform(0.0, 0.6)
    while now < take.line.seconds:
        length = rng.uniform(1.5, 5.0)
        speed = run_up(length, rng.uniform(0.1, 0.2), rng.uniform(0.35, 0.7), 2.0)
        t = time_axis(len(speed))
        fine = powder + (1.0 - powder) * (1.0 - np.exp(-t / 4.0))
        pitch = turns * speed * (0.72 + 0.28 * fine + unrest(len(t), rng, 9.0, 0.02) * (1 - fine)) + 1.0
        pulse = 1.0 + 0.25 * np.sin(phase_of(2 * mains, len(t), rng.uniform(0, 6.28))) * (t < length)
        voice = motor(rng, pitch, orders, rng.uniform(0.5, 0.9)) * pulse
        hits = rng.uniform(250.0, 500.0) * speed * (1.0 - 0.85 * fine)
        rush = band_noise(len(t), rng, 1200, 9000, 1) * speed**2 * (0.2 + 0.6 * fine)
        blows = cracks(rng, hits, lid, 5000, 0.02) * (0.4 + 0.6 * speed) * (2.2 - 1.1 * fine)
        take.at(now, 1.0, 0.45 * voice + 0.3 * rush * (1 + unrest(len(t), rng, 8.0, 0.25)) + blows)
        take.at(now - 0.02, 0.7, knock(rng, 500, 4000, 0.03, click=0.8))
        powder = float(fine[int(length * SAMPLE_RATE) - 1])
        now += length + rng.uniform(0.8, 2.2)
        if powder > 0.85:
            for k in range(int(rng.integers(2, 5))):
                tap = now + 0.8 + 0.25 * k + rng.normal(0, 0.03)
                take.at(tap, rng.uniform(0.8, 1.6), knock(rng, lid, 3500, 0.06, 8, 0.5))
            take.line.add("beans", (now + 2.5, 0.0), (now + 2.8, 1.0), (now + 3.6, 0.7), (now + 4.0, 0.0))
            now, powder = now + rng.uniform(4.5, 7.0), 0.0
    power = take.power("-", spectrum(STANDBY, rng), 1.5, least=0.1)
    return take.heard(power, 0.9 * take.splashes("beans", 120), 1.0)


def steam_wand_milk(count: int, rng: Generator) -> Array:
    """Steam wand in a jug of milk: purge, tearing sounds while air is drawn in, the roll, a deeper end, knocks.

    In air the holes are choked jets. In the milk steam condenses; the oscillation's main frequency falls as the milk
    warms and falls quickly with the air in it (direct-contact condensation: Y. Li et al., Front. Energy Res. (2023)
    1027624; J. Wang et al., Nucl. Eng. Des. (2021) 111142). Without enough air it screeches at 900 to 2,600 Hz. Air is
    drawn in 4 to 9 times a second (tss, tss). Unit: holes, jug's resonance, 10 to 20 s of steaming.
    """
    take = Take(count, rng)
    cold, rolls, jug = rng.uniform(1400.0, 2800.0), rng.uniform(8.0, 16.0), rng.uniform(420.0, 800.0)
    pitch, sings = rng.uniform(900.0, 2600.0), rng.uniform(0.05, 0.5)
    note, steel = [(0.0, cold)], Housing(rng, 350, 7000, 11, 0.25, 0.2)
    now = first_start(rng, rolls)
    while now < take.line.seconds:
        take.line.add("purge", (now, 0.0), (now + 0.12, 0.5), (now + 0.8, 0.45), (now + 0.95, 0.0))
        begin = now + rng.uniform(1.5, 2.5)
        roll = begin + rng.uniform(3.0, 6.0)
        end = roll + rolls * rng.uniform(0.8, 1.2)
        take.line.add(
            "steam", (begin, 0.0), (begin + 0.3, 0.7), (roll, 0.6), (roll + 1.0, 0.95), (end - 1.0, 0.8), (end, 0.0)
        )
        moment = begin + 0.3
        while moment < roll:
            take.line.add("tear", (moment, 0.05), (moment + 0.03, rng.uniform(0.3, 1.0)))
            take.line.add("tear", (moment + rng.uniform(0.06, 0.1), 0.05))
            moment += rng.uniform(0.11, 0.25)
        take.line.add("tear", (roll + 0.3, 0.0))
        note += [(begin, cold), (roll, 0.75 * cold), (end, 0.3 * cold), (end + 0.5, cold)]
        size = int((end - roll) * SAMPLE_RATE)
        bend = np.linspace(0.0, 1.0, size)
        grip = np.clip(unrest(size, rng, 1.2, 0.8) + 0.2 - 0.5 * bend, 0.0, 1.0)
        take.at(roll, sings, whistle(rng, pitch * (1.0 - 0.35 * bend), grip, 0.05))
        take.at(end, 0.6, knock(rng, 400, 3000, 0.05, click=0.5))
        take.line.add("purge", (end + 1.2, 0.0), (end + 1.3, 0.4), (end + 1.7, 0.35), (end + 1.8, 0.0))
        for k in range(int(rng.integers(2, 5))):
            take.at(end + 2.6 + 0.4 * k + rng.normal(0, 0.05), rng.uniform(1.2, 2.2), steel.blow(0.4, 0.4))
        now = end + rng.uniform(4.5, 9.0)
    frames = len(take.line.times)
    main = np.interp(take.line.times, *np.array(note).T) * np.exp(frame_drift(frames, rng, 6.0, 0.08))
    turns = 2 * np.pi * np.cumsum(14.0 + frame_drift(frames, rng, 1.5, 3.0)) * (HOP / SAMPLE_RATE)
    chug = 1.0 + 0.35 * np.sin(turns)[:, None]
    power = take.power("purge", spectrum(JET, rng), 1.5, 25.0)
    power += 0.3 * take.power("steam", spectrum(SPITTING, rng), 2.5, 25.0) * moving_peak(main, 2.5, 11.0)
    pan = moving_peak(np.full(frames, jug), 4.0, 7.0)
    power += 0.35 * chug * pan * take.power("steam", spectrum(CONDENSING, rng), 3.0, 30.0)
    power += take.power("tear", spectrum(JET, rng, 1.5), 4.0, 50.0)
    power += take.power("-", spectrum(BOILING, rng), 2.5, 12.0, least=0.1)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.06)
    return take.heard(power, 0.4 * take.splashes("steam", 60) + 0.2 * take.bubbles("steam", 60, (0.6, 3.0)), 1.4)


_PUMP = "vibration pump"
_BUBBLES = "boiling water in a tube"
_ULKA = "ULKA EP5 data sheet (half-wave drive)"
_RICE = "S. O. Rice, Bell System Technical Journal 23 (1944) 282–332"


_voice = partial(Voice.of, "coffee_machine")

VOICES: tuple[Voice, ...] = (
    _voice(vibration_pump_espresso, "train", _PUMP, _ULKA),
    _voice(capsule_machine, "train", _PUMP, f"{_ULKA}; burst control"),
    _voice(
        rotary_pump_bar, "train", "rotary vane pump, steam", "four-pole motor with slip; vane passing; Lighthill 1952"
    ),
    _voice(
        burr_grinder,
        "train",
        "burr grinder",
        "J. D. Smith, Gear Noise and Vibration (2nd ed. 2003), on tooth passing and its sidebands; "
        f"bursts at random moments: {_RICE}",
    ),
    _voice(drip_filter, "train", _BUBBLES, "bubble pump; Aljishi & Tatarkiewicz 1991; van den Doel 2005"),
    _voice(moka_pot, "train", "steam pressure", "Navarini et al. 2009; Gianino 2007"),
    _voice(percolator, "validation", _BUBBLES, "bubble pump; Aljishi & Tatarkiewicz 1991"),
    _voice(bean_to_cup, "test", _PUMP, f"{_ULKA}; geared motors; sequence of automatic machines"),
    _voice(
        blade_grinder,
        "test",
        "universal motor with blade",
        "A. E. Fitzgerald, C. Kingsley, S. D. Umans, Electric Machinery (6th ed. 2003), on series universal motors; "
        f"blows at random moments: {_RICE}",
    ),
    _voice(steam_wand_milk, "test", "steam condensing in milk", "Li et al. 2023; Wang et al. 2021; Lighthill 1952"),
    _voice(pod_air_pump, "train", "diaphragm air pump", "two valves a turn; Aljishi & Tatarkiewicz 1991"),
    _voice(
        geared_conical_grinder, "train", "grinder behind a planetary gear", "McFadden & Smith, Proc. IMechE 199 (1985)"
    ),
    _voice(steam_espresso, "train", "boiler's steam", "Aljishi & Tatarkiewicz 1991; Lighthill 1952; Li et al. 2023"),
    _voice(
        instant_whipper,
        "train",
        "whipper in a bowl",
        "A. E. Fitzgerald, C. Kingsley, S. D. Umans, Electric Machinery (6th ed. 2003), on direct-current motors; "
        "van den Doel 2005",
    ),
    _voice(
        centrifugal_pod,
        "train",
        "capsule spun by a brushless motor",
        "Nestec, US patent 8 813 634 (brewing centrifugal force); rotating unbalance: J. P. Den Hartog, Mechanical "
        "Vibrations (4th ed. 1956), chapter 2",
    ),
)
