"""Front loaders: drums on a horizontal axis with six kinds of drive."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.washing_machine_parts import (
    cabinet,
    gate,
    laundry,
    programme,
    residual,
    reversing,
    roar,
    slosh,
    spinning,
    thumps,
)
from generators.assets.sounds.machines import (
    bearing_defect,
    driven,
    drummed,
    expand,
    induction_motor,
    passages,
    permanent_magnet_motor,
    plate,
    read_at,
    rolling,
    sine,
    sloped,
    struck,
    switched,
    synchronous_pump,
    turned,
    unbalance,
    universal_motor,
    wander,
)
from generators.assets.sounds.signals import Array, bubbles


def universal_belt(count: int, rng: Generator) -> Array:
    """Front loader with a phase-controlled commutator motor and belt: washing, then a short spin.

    Everything follows from the drum's speed (turns per second): the motor turns 11–14 times as fast; laundry falls
    while gravity exceeds the centripetal force; the unbalanced tub passes its suspension's resonance.
    """
    spans = programme(count, rng, (("wash", 30, 60), ("spin", 14, 24)))
    top, ratio = rng.uniform(10.0, 15.0), rng.uniform(11.0, 14.0)
    wash = rng.uniform(0.75, 0.92) * reversing(count, rng, (8, 14), (1.2, 2.5)) * gate(count, spans, "wash")
    speed = np.abs(wash) + spinning(count, rng, spans, "spin", (1.6, 0.55 * top, top))
    body = cabinet(rng, 55, 1300, 0.06)
    motor = universal_motor(count, rng, ratio * speed, ratio * top, int(rng.choice([24, 26, 32])), 50.0)
    noise = roar(count, rng, rng.uniform(110, 170), -6.5)
    water = 0.3 * np.square(np.sin(2 * np.pi * turned(wash) + wander(count, rng, 0.7, 0.8))) * np.abs(wash)
    return np.asarray(
        0.16 * driven(motor, body)
        + 0.06 * motor
        + 1.6 * rolling(count, rng, speed, top, noise)
        + 1.0 * laundry(count, rng, wash, body, 3, 0.12)
        + 0.5 * thumps(count, rng, speed, body, rng.uniform(3.0, 4.5), 0.2)
        + 1.2 * slosh(count, rng, water, (1.5, 7.0), 60.0)
        + 0.16 * residual(count, rng)
    )


def direct_drive(count: int, rng: Generator) -> Array:
    """Front loader whose drum is driven by an outer-rotor motor of 24 pole pairs: magnetic whine, no belt.

    Washing at .6–.75 turns per second gives forces at twice and six times the electrical frequency (about 30–110 Hz);
    spinning moves them to .8–3 kHz, through the modes of tub and cabinet. The carrier of the inverter is faint.
    """
    spans = programme(count, rng, (("wash", 35, 70), ("spin", 18, 30)))
    top = rng.uniform(15.0, 22.0)
    wash = rng.uniform(0.58, 0.72) * reversing(count, rng, (14, 24), (0.8, 1.6), 1.2) * gate(count, spans, "wash")
    speed = np.abs(wash) + spinning(count, rng, spans, "spin", (1.4, 0.3 * top, 0.65 * top, top))
    body = plate(rng, 70, 3600, 40, 0.07, slope=-2.2)
    motor = permanent_magnet_motor(count, rng, speed, top, 24, 36, rng.uniform(7500, 9500))
    noise = roar(count, rng, rng.uniform(75, 110), -5.6, 4500)
    water = 0.5 * np.abs(wash) * (0.85 + 0.15 * np.sin(2 * np.pi * turned(wash)))
    return np.asarray(
        0.3 * driven(motor, body)
        + 0.06 * motor
        + 1.5 * rolling(count, rng, speed, top, noise)
        + 0.8 * laundry(count, rng, wash, cabinet(rng, 45, 800, 0.05), 3, 0.12)
        + 0.9 * slosh(count, rng, water, (2.5, 11.0), 35.0)
        + 0.2 * residual(count, rng, 70.0)
    )


def inverter_belt(count: int, rng: Generator) -> Array:
    """Spin programme of a front loader with an inverter motor of four or five pole pairs, a ribbed belt and a pump.

    The ramp stops at plateaus while water leaves; tones at orders of the motor sweep over resonances; the belt's joint
    and ribs modulate them; the pump runs in between. The speed never falls below a slow distribution of the load.
    """
    spans = programme(count, rng, (("spin", 22, 40), ("drain", 6, 12)))
    top, ratio = rng.uniform(16.0, 23.0), rng.uniform(9.0, 11.5)
    spin = spinning(count, rng, spans, "spin", (1.3, 0.2 * top, 0.4 * top, 0.75 * top, top))
    speed = np.maximum(spin, rng.uniform(1.2, 1.5))
    body = plate(rng, 90, 4200, 44, 0.025, slope=-2.0)
    pairs = int(rng.choice([4, 5]))
    motor = permanent_magnet_motor(count, rng, ratio * speed, ratio * top, pairs, 3 * pairs, None)
    belt = turned(speed * rng.uniform(0.55, 0.7))
    flap = 1.0 + 0.25 * np.sin(2 * np.pi * ratio * belt) * np.exp(wander(count, rng, 1.0, 0.3))
    meshing = sine(turned(speed) * rng.uniform(140, 190), count, 0.08 * np.exp(wander(count, rng, 3.0, 0.5)))
    air = np.clip(0.4 + wander(count, rng, 3.0, 0.3), 0.0, 1.0)
    pump = synchronous_pump(count, rng, 50.0, plate(rng, 180, 2600, 18, 0.05), air)
    noise = roar(count, rng, rng.uniform(80, 130), -5.5, 7000)
    return np.asarray(
        (0.35 * driven(motor, body) + 0.08 * motor + meshing) * expand(flap, count)
        + 1.5 * rolling(count, rng, speed, top, noise)
        + 0.5 * thumps(count, rng, speed, body, rng.uniform(3.5, 5.5), 0.15)
        + 0.5 * pump * expand(0.25 + 0.75 * gate(count, spans, "drain", 0.3), count)
        + 0.12 * residual(count, rng)
    )


def two_speed_filling(count: int, rng: Generator) -> Array:
    """Front loader of the 1970s with a two-speed induction motor, filled while it tumbles: valve, jet, splashing.

    The slow winding has 16 poles (50 Hz: 360 rpm less slip), the belt divides by 7–8. Hiss of the inlet valve as
    turbulence of an orifice (ISO 3822-1 measures such valves: broad, most energy at 1–4 kHz); mains pressure varies.
    """
    spans = programme(count, rng, (("fill", 18, 35), ("wash", 15, 30)))
    run = reversing(count, rng, (10, 18), (1.5, 2.5), 0.35)
    wash = rng.uniform(0.72, 0.85) * run
    filling = gate(count, spans, "fill", 0.15) * np.exp(wander(count, rng, 0.5, 0.08))
    body = cabinet(rng, 70, 1500, 0.045)
    motor = induction_motor(count, rng, 50.0, int(rng.choice([44, 52, 58])), 8)
    on = np.clip(1.6 * np.abs(run), 0.0, 1.0)
    hiss = sloped(count, rng, rng.uniform(700, 1300), 7000, -2.5, below=5.0, beyond=-8.0)
    pipe = driven(hiss, plate(rng, 300, 3000, 10, 0.08))
    splash = filling * (0.5 + 0.3 * np.sin(2 * np.pi * turned(wash)) ** 2)
    relay = switched(np.abs(run) > 0.3)
    return np.asarray(
        (0.12 * driven(motor, body) + 0.06 * motor) * expand(on, count)
        + 0.9 * rolling(count, rng, wash, 0.8, roar(count, rng, 85, -6.5))
        + 0.8 * laundry(count, rng, wash, body, 3, 0.15)
        + (0.3 * hiss + 0.22 * pipe) * expand(filling, count)
        + 0.6 * slosh(count, rng, splash + 0.2 * np.abs(run), (0.9, 6.0), 90.0)
        + 0.5 * struck(count, rng, plate(rng, 700, 5000, 14, 0.03), relay, 1.0, 2e-4)
        + 0.4 * residual(count, rng)
    )


def drain_pump(count: int, rng: Generator) -> Array:
    """Draining: a synchronous pump at mains frequency, full of water at first, then slurping air; the drum crawls.

    See `synchronous_pump`. Slurping: the water level at the inlet swings, so air enters in irregular gulps at 1–4 Hz.
    """
    spans = programme(count, rng, (("full", 14, 28), ("slurp", 10, 22)))
    slurping = gate(count, spans, "slurp", 1.5)
    gulps = np.clip(wander(count, rng, rng.uniform(2.5, 5.0), 0.6) + 0.3, 0.0, 1.2)
    air = 0.08 + slurping * gulps
    mains = float(rng.choice([50.0, 60.0]))
    pump = synchronous_pump(count, rng, mains, plate(rng, 160, 6500, 40, 0.045, slope=-0.7), air)
    crawl = rng.uniform(0.6, 0.8) * reversing(count, rng, (7, 12), (3.0, 6.0), 1.0)
    body = cabinet(rng, 60, 1200, 0.05)
    water = sloped(count, rng, 200, 6000, -4.5, beyond=-9.0)
    hose = 0.7 * driven(water, plate(rng, 120, 900, 6, 0.12)) + 0.5 * water
    flow = expand((1.0 - 0.4 * slurping) * np.exp(wander(count, rng, 2.0, 0.1)), count)
    return np.asarray(
        0.55 * pump
        + 0.2 * driven(pump, body)
        + 0.4 * hose * flow
        + 1.0 * bubbles(count, rng, 8.0 + 50.0 * expand(slurping * gulps, count), (2.5, 14.0))
        + 0.8 * rolling(count, rng, crawl, 0.8, roar(count, rng, 55, -5.5))
        + 0.35 * laundry(count, rng, crawl, body, 3, 0.1)
        + 0.12 * residual(count, rng)
    )


def walking_spin(count: int, rng: Generator) -> Array:
    """Small front loader that spins unbalanced on a hard floor: its feet lift and hit the floor, its panels chatter.

    Model: a foot bounces when the swing's acceleration exceeds gravity; landings come once per turn at first, then at
    every second turn or irregularly (the bouncing ball: P. J. Holmes, Journal of Sound and
    Vibration 84 (1982) 173–189).
    """
    spans = programme(count, rng, (("spin", 25, 45), ("tumble", 10, 18)))
    top, ratio = rng.uniform(7.0, 10.5), rng.uniform(14.5, 17.0)
    tumble = rng.uniform(0.92, 1.1) * reversing(count, rng, (5, 9), (1.0, 2.0), 0.5) * gate(count, spans, "tumble")
    speed = np.abs(tumble) + spinning(count, rng, spans, "spin", (2.0, 0.7 * top, top, 0.85 * top))
    turns = turned(speed)
    swing = unbalance(speed, rng.uniform(4.5, 6.0), rng.uniform(0.12, 0.25)) * np.exp(wander(count, rng, 0.6, 0.25))
    moments = passages(turns + 0.05 * wander(count, rng, 3.0, 1.0), 1)
    excess = read_at(swing, moments) - rng.uniform(0.7, 0.9)
    # Beyond a larger swing the flight lasts longer than a turn: every second landing is missed or weak.
    skips = (excess > 0.5) & (np.arange(len(moments)) % 2 == 1)
    force = np.clip(excess, 0.0, 2.0) ** 0.7 * np.where(skips, 0.25, 1.0) * np.exp(rng.normal(0, 0.4, len(moments)))
    landed = force > 0.02
    hits = moments[landed] + rng.uniform(0, 0.25, landed.sum()) / np.maximum(read_at(speed, moments)[landed], 1.0)
    feet = drummed(count, rng, plate(rng, 60, 1400, 22, 0.07, -1.5), hits, force[landed], 1.2e-3, 0.4)
    panel = drummed(count, rng, plate(rng, 500, 5200, 26, 0.02, -1.0), hits + 0.004, force[landed], 3e-4, 0.6)
    motor = universal_motor(count, rng, ratio * speed, ratio * top, int(rng.choice([20, 22])), 60.0)
    body = cabinet(rng, 85, 1700, 0.05)
    return np.asarray(
        0.12 * driven(motor, body)
        + 0.07 * motor
        + 1.3 * rolling(count, rng, speed, top, roar(count, rng, 150, -6.0))
        + 0.8 * feet
        + 0.4 * panel
        + 0.8 * laundry(count, rng, tumble, body, 2, 0.1)
        + 0.15 * residual(count, rng)
    )


#: Gain of the races of a drum bearing re the modes of the tub (dB), between units.
_RACES_DB = (-24.0, -8.0)


def worn_bearing(count: int, rng: Generator) -> Array:
    """Front loader with a pitted drum bearing: a growl that follows the spin, in and out of modes; a shower pump runs.

    Source: McFadden and Smith (1984), see `bearing_defect`: 7–9 balls, hits at about 3 per turn, modulated per turn.
    The hits are shorter than a period of the races' own modes, so these ring up to the end of hearing (R. B. Randall,
    J. Antoni, Rolling element bearing diagnostics: a tutorial, Mechanical Systems and Signal Processing 25 (2011)
    485–520: resonances of some kHz to tens of kHz); how much of it passes shaft and tub differs between machines.
    """
    spans = programme(count, rng, (("spin", 20, 36), ("rinse", 16, 30)))
    top = rng.uniform(12.0, 18.0)
    rinse = rng.uniform(0.8, 1.0) * reversing(count, rng, (6, 10), (1.5, 2.5)) * gate(count, spans, "rinse")
    speed = np.abs(rinse) + spinning(count, rng, spans, "spin", (1.5, 0.5 * top, top))
    body = plate(rng, 110, 2600, 30, 0.05, slope=-2.5)
    races = plate(rng, 3500, 19_000, 24, 0.006)
    ringing = body.joined(races, 10 ** (rng.uniform(*_RACES_DB) / 20))
    growl = bearing_defect(count, rng, speed, top, int(rng.integers(7, 10)), ringing)
    other = bearing_defect(count, rng, 1.02 * speed, top, int(rng.integers(7, 10)), cabinet(rng, 60, 900, 0.06))
    noise = roar(count, rng, 60, -5.2, rng.uniform(3500, 9000))
    noise = 1.3 * noise + 0.3 * driven(noise, body)
    pump = synchronous_pump(count, rng, 50.0, plate(rng, 240, 2200, 14, 0.06), np.full_like(speed, 0.1))
    shower = gate(count, spans, "rinse", 1.0)
    return np.asarray(
        90.0 * growl
        + 70.0 * other
        + rolling(count, rng, speed, top, noise)
        + 1.0 * laundry(count, rng, rinse, body, 4, 0.1)
        + 0.5 * pump * expand(0.1 + shower, count)
        + 0.9 * slosh(count, rng, 0.5 * shower, (0.8, 4.0), 70.0)
        + 0.15 * residual(count, rng)
    )
