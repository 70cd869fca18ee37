"""Accuracy and CPU time of the tracer's receivers, without a room.

    python -m benchmarks.receivers [--hrtf FILE.sofa]

prints five tables: CPU time of a response; errors of the spherical head against the closed form of a plane wave; its
level differences near a source beside the closed form; ringing of the octave filters before an arrival; and, with a
SOFA file, errors of its head beside those of ambisonics of order 3 decoded with a magnitude-least-squares decoder.
"""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median

import click
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import eval_legendre, spherical_jn, spherical_yn

from avs3d_bench.geometry import ambisonic_axes, spherical_harmonics
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.ambisonics import Ambisonics
from generators.acoustics.tracer.receivers.base import Receiver
from generators.acoustics.tracer.receivers.measured import SofaHead
from generators.acoustics.tracer.receivers.sofa import read_hrirs
from generators.acoustics.tracer.receivers.sphere import sphere_response
from generators.acoustics.tracer.receivers.sphere_mesh import SphereMesh
from generators.acoustics.tracer.receivers.spherical import SphericalHead

F64 = NDArray[np.float64]
C128 = NDArray[np.complex128]

RATE = 44_100
UPRIGHT = np.eye(3)
#: A response of a furnished room: arrivals, and their decay (s to -60 dB).
ARRIVALS, DECAY = 30_000, 0.6
#: Amplitudes per octave whose ringing is shown.
CASES = {
    "equal octaves": np.ones(8),
    "thick carpet": np.sqrt(1 - np.array([0.05, 0.05, 0.06, 0.10, 0.20, 0.35, 0.45, 0.45])),
    "thin panel": np.sqrt(1 - np.array([0.40, 0.40, 0.20, 0.10, 0.07, 0.05, 0.05, 0.05])),
    "behind an edge, −3 dB per octave": 2.0 ** (-np.arange(8) / 2),
    "through a wall, −6 dB per octave": 2.0 ** -np.arange(8.0),
}
#: Sources whose level differences are shown: azimuths (degrees), distances (m), octaves (Hz).
NEAR_AZIMUTHS, NEAR_DISTANCES, NEAR_BANDS = (
    (30, 60, 90),
    (6.0, 3.0, 2.0, 1.0, 0.5, 0.3),
    (250, 500, 1000, 2000, 4000, 8000),
)
#: Terms of the series beyond ka; those of a source at 0.2 m fall by 2.3 each.
NEAR_TERMS = 50
#: Samples of the transforms by which responses are compared.
RESOLUTION = 4096
#: Frequency above which the magnitude-least-squares decoder gives up the phase (Hz).
CUT_ON = 2000.0


def evenly(count: int) -> F64:
    """(count, 3) unit vectors."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def room_like() -> Arrivals:
    """Arrivals from everywhere with random signs and a decay."""
    rng = np.random.default_rng(1)
    times = 0.005 + (DECAY - 0.005) * rng.random(ARRIVALS)
    directions = rng.standard_normal((ARRIVALS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    level = rng.choice([-1.0, 1.0], ARRIVALS) * 10 ** (-3 * times / DECAY)
    pressure = level[:, None] * rng.uniform(0.5, 1.0, (ARRIVALS, 8))
    return Arrivals(times, directions.astype(np.float32), pressure.astype(np.float32))


def print_cost(receivers: dict[str, Receiver]) -> None:
    """CPU time of a response, compiled and with its tables made."""
    arrivals = room_like()
    print(f"CPU time of a response: {ARRIVALS:,} arrivals within {DECAY} s, {RATE} Hz, one thread")
    for name, receiver in receivers.items():
        receiver.response(arrivals, UPRIGHT, RATE)
        seconds = []
        for _ in range(25):
            start = time.process_time()
            receiver.response(arrivals, UPRIGHT, RATE)
            seconds.append(time.process_time() - start)
        print(f"  {name:24} {receiver.channels:2} channels   {median(seconds) * 1000:5.1f} ms")


def print_sphere() -> None:
    """Errors of single arrivals at the spherical head, octave by octave."""
    head = SphericalHead()
    levels, ilds, itds = [], [], []
    for direction in evenly(400):
        one = Arrivals(np.array([0.05]), direction[None].astype(np.float32), np.ones((1, 8), dtype=np.float32))
        response = head.response(one, UPRIGHT, RATE).astype(np.float64)
        n = np.arange(response.shape[1]) / RATE - 0.05
        rows = []
        for middle in BANDS:
            frequencies = octave(middle)
            found = response @ np.exp(-2j * np.pi * np.outer(n, frequencies))
            ka = 2 * np.pi * frequencies * HEAD_RADIUS / SPEED_OF_SOUND
            exact = sphere_response(np.arccos([-direction[0], direction[0]]), ka)
            level = 10 * np.log10(np.mean(np.abs(found) ** 2, axis=1) / np.mean(np.abs(exact) ** 2, axis=1))
            cross = np.sum(found[0] * np.conj(found[1]) * np.conj(exact[0] * np.conj(exact[1])))
            rows.append((np.abs(level).max(), abs(level[1] - level[0]), abs(np.angle(cross)) / (2 * np.pi * middle)))
        level_row, ild_row, itd_row = zip(*rows, strict=True)
        levels.append(level_row)
        ilds.append(ild_row)
        itds.append(itd_row)
    print("Spherical head against the closed form, 400 directions: largest (mean) error per octave")
    print(f"  {'':10}" + "".join(f"{band:>15}" for band in BANDS))
    for name, values, scale in (("level, dB", levels, 1), ("ILD, dB", ilds, 1), ("ITD, µs", itds, 1e6)):
        table = np.array(values) * scale
        cells = (f"{worst:.2f} ({mean:.2f})" for worst, mean in zip(table.max(0), table.mean(0), strict=True))
        print(f"  {name:10}" + "".join(f"{cell:>15}" for cell in cells))


def near_pressure(distance: float, azimuth: float, frequency: ArrayLike) -> C128:
    """(2, K) pressure at the ears of a rigid sphere, left first, for a point source of amplitude 1 at any distance.

    Duda and Martens (1998), eq. (3), with μ = ka and the distance ρ in radii, relative to 1 m from the source in the
    free field: p = −1/(aμ)·Σ (2m + 1)·Pₘ(cos θ)·hₘ(μρ)/h′ₘ(μ), with their time dependence exp(−iωt).

    Args:
        distance: from the centre of the sphere (m), larger than its radius.
        azimuth: of the source, in the plane of the ears, positive to the right (degrees).
        frequency: (K,) Hz.
    """
    mu = 2 * np.pi * np.asarray(frequency, dtype=np.float64) * HEAD_RADIUS / SPEED_OF_SOUND
    orders = np.arange(int(np.ceil(1.1 * mu.max())) + NEAR_TERMS)[:, None]
    far = mu * distance / HEAD_RADIUS
    slope = spherical_jn(orders, mu, derivative=True) + 1j * spherical_yn(orders, mu, derivative=True)
    terms = (2 * orders + 1) * (spherical_jn(orders, far) + 1j * spherical_yn(orders, far)) / slope
    # The left ear is at −90°, the right one at +90°.
    cosine = np.cos(np.radians([90 + azimuth, 90 - azimuth]))
    return np.array([(eval_legendre(orders, ear) * terms).sum(axis=0) / (-mu * HEAD_RADIUS) for ear in cosine])


def head_pressure(distance: float, azimuth: float, frequency: F64) -> C128:
    """(2, K) pressure at the ears of the tracer's spherical head, left first, for a point source of amplitude 1."""
    direction = np.array([[np.sin(np.radians(azimuth)), 0, -np.cos(np.radians(azimuth))]], dtype=np.float32)
    pressure = np.full((1, 8), 1 / distance, dtype=np.float32)
    one = Arrivals(np.array([distance / SPEED_OF_SOUND]), direction, pressure, np.array([True]))
    response = SphericalHead().response(one, UPRIGHT, RATE).astype(np.float64)
    return np.asarray(response @ np.exp(-2j * np.pi * np.outer(np.arange(response.shape[1]) / RATE, frequency)))


def level_difference(pressure: C128) -> float:
    """dB, right minus left, of the energies of a band."""
    left, right = np.mean(np.abs(pressure) ** 2, axis=1)
    return float(10 * np.log10(right / left))


def octave(middle: float) -> F64:
    """(24,) frequencies of an octave, up to 16 kHz."""
    return np.linspace(middle / np.sqrt(2), min(middle * np.sqrt(2), 16_000), 24)


def near_field() -> list[list[str]]:
    """Rows of the table of level differences, by octave, of the head beside the closed form, for each azimuth."""
    rows = []
    for azimuth in NEAR_AZIMUTHS:
        for distance in NEAR_DISTANCES:
            cells = []
            for band in NEAR_BANDS:
                found = level_difference(head_pressure(distance, azimuth, octave(band)))
                exact = level_difference(near_pressure(distance, azimuth, octave(band)))
                cells.append(f"{found:.1f} ({exact:.1f})")
            rows.append([f"{azimuth}°", f"{distance:g} m", *cells])
    return rows


def print_near_field() -> None:
    """The spherical head near a source."""
    print("Level difference of the spherical head, dB (of the closed form)")
    for row in [["azimuth", "distance", *(f"{band} Hz" for band in NEAR_BANDS)], *near_field()]:
        print(f"  {row[0]:8} {row[1]:10}" + "".join(f"{cell:>14}" for cell in row[2:]))


def print_ringing() -> None:
    """Largest sample before an arrival, relative to its peak."""
    print("Ringing of the octave filters: largest sample earlier than … before the arrival, dB re its peak")
    steps = (0.5, 1, 2, 5, 10, 20)
    print(f"  {'':34}" + "".join(f"{f'{step:g} ms':>9}" for step in steps))
    start = round(0.1 * RATE)
    for name, pressure in CASES.items():
        one = Arrivals(np.array([0.1]), np.array([[0, 0, -1]], dtype=np.float32), pressure[None].astype(np.float32))
        response = np.abs(Ambisonics(1).response(one, UPRIGHT, RATE)[0])
        before = [response[: start - round(step * RATE / 1000)].max() / response.max() for step in steps]
        print(f"  {name:34}" + "".join(f"{20 * np.log10(value):9.0f}" for value in before))


def magnitude_least_squares(responses: C128, directions: F64, weights: F64, frequencies: F64, order: int) -> C128:
    """(M, F) responses of an ear after encoding and decoding in ambisonics (Schörkhuber, Zaunschirm, Höldrich 2018)."""
    harmonics = spherical_harmonics(ambisonic_axes(directions), order)
    root = np.sqrt(weights)[:, None]
    fit = np.linalg.pinv(root * harmonics) * root.T
    decoded = np.zeros_like(responses)
    for k, frequency in enumerate(frequencies):
        wanted = responses[:, k]
        if frequency > CUT_ON:
            wanted = np.abs(wanted) * np.exp(1j * np.angle(decoded[:, k - 1]))
        decoded[:, k] = harmonics @ (fit @ wanted)
    return decoded


def print_measured(path: Path) -> None:
    """Third-octave errors of the measured directions: the receiver, which has components, beside ambisonics."""
    hrirs, head = read_hrirs(path), SofaHead(path)
    directions, half = hrirs.directions, len(hrirs.directions)
    rate = round(hrirs.sample_rate)
    weights = SphereMesh.of(directions, path).solid_angles()
    gain = 10 ** (float(str(head.describe()["hrtf_gain_db"])) / 20)
    exact = np.asarray(np.concatenate(list(np.moveaxis(np.fft.rfft(hrirs.impulses, RESOLUTION), 1, 0)))) * (gain + 0j)
    frequencies: F64 = np.asarray(np.fft.rfftfreq(RESOLUTION, 1 / rate), dtype=np.float64)
    heard = []
    for direction in directions:
        one = Arrivals(np.array([0.01]), direction[None].astype(np.float32), np.ones((1, 8), dtype=np.float32))
        heard.append(np.fft.rfft(head.response(one, UPRIGHT, rate), RESOLUTION))
    fitted: C128 = np.concatenate(list(np.moveaxis(np.array(heard), 1, 0)))
    decoded = np.concatenate(
        [magnitude_least_squares(ear, directions, weights, frequencies, 3) for ear in (exact[:half], exact[half:])]
    )
    centres = 1000 * 2.0 ** (np.arange(-6, 13) / 3)

    def thirds(responses: C128) -> F64:
        inside = [np.abs(np.log2(np.maximum(frequencies, 1) / centre)) <= 1 / 6 for centre in centres]
        return np.array([10 * np.log10(np.mean(np.abs(responses[:, i]) ** 2, axis=1)) for i in inside])

    share = weights / weights.sum()
    print(f"{head.describe()['head']}, {half} directions: mean error of third-octave levels, dB (of their ILD)")
    print(f"  {'':34}" + "".join(f"{centre:>14.0f}" for centre in centres[::3]) + f"{'above 1 kHz':>14}")
    for name, responses in (("measured head (components)", fitted), ("ambisonics of order 3, MagLS", decoded)):
        off = thirds(responses) - thirds(exact)
        level = np.abs(off) @ np.tile(share / 2, 2)
        ild = np.abs(off[:, half:] - off[:, :half]) @ share
        high = centres >= 1000
        cells = [*zip(level[::3], ild[::3], strict=True), (level[high].mean(), ild[high].mean())]
        print(f"  {name:34}" + "".join(f"{f'{a:.2f} ({b:.2f})':>14}" for a, b in cells))


@click.command()
@click.option("--hrtf", type=click.Path(path_type=Path), help="SOFA file of a measured head")
def main(hrtf: Path | None) -> None:
    """Print the tables."""
    receivers: dict[str, Receiver] = {"spherical head": SphericalHead()}
    if hrtf is not None:
        receivers["measured head"] = SofaHead(hrtf)
    receivers.update({f"ambisonics of order {order}": Ambisonics(order) for order in (1, 2, 3)})
    print_cost(receivers)
    print_sphere()
    print_near_field()
    print_ringing()
    if hrtf is not None:
        print_measured(hrtf)


if __name__ == "__main__":
    main()
