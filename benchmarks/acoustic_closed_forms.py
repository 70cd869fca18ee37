"""`python -m benchmarks.acoustic_closed_forms`: the tracer and SoundSpaces' engine in boxes whose acoustics are known.

    python -m benchmarks.acoustic_closed_forms [-o build/agreement]

Both engines get the same boxes and an omnidirectional listener. Prints tables and writes closed_forms.json and
closed_forms.md, from which `benchmarks.acoustic_pictures` draws. Takes about a minute on one core.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.formats.files import write_bytes, write_json
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import decay_curve, octave_filtered
from benchmarks.acoustic_measures import ENGINES, OCTAVES, decibels, measure, octave_energies, responses
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.materials import MATERIALS, spectral_label
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.receivers.bands import band_weights
from generators.acoustics.tracer.receivers.microphones import Array
from generators.acoustics.tracer.settings import TraceSettings
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Room, Scene

F64 = NDArray[np.float64]

SIZE = np.array([6.0, 4.0, 3.0])
VOLUME, SURFACE = 72.0, 108.0
SOURCE = (1.5, 1.2, 1.3)
LISTENERS = ((4.2, 2.1, 1.9), (2.9, 2.9, 1.0), (5.1, 1.0, 1.2), (3.4, 1.9, 2.2), (4.7, 3.1, 0.8), (2.2, 2.6, 2.3))
#: Variance of the free path in this box with walls that scatter all (Kuttruff, *Room Acoustics*, § 5.2, table 5.1).
PATH_VARIANCE = 0.36
#: Octaves whose mean is quoted where the absorption is the same in all (Hz).
MIDDLE = (500, 1000, 2000)
#: Boxes of mirrors: absorption of the floor, the ceiling and the walls.
MIRRORS = {"all 0.2": (0.2, 0.2, 0.2), "carpet": (0.6, 0.3, 0.2), "hard floor": (0.1, 0.1, 0.4)}
#: A source beside a hard floor, and listeners that are far from the other, soft surfaces: within 2 ms of the direct
#: sound, only the floor's reflection arrives.
LOW_SOURCE, FLOOR, SOFT = (2.4, 0.3, 1.5), 0.05, 0.9
LOW_LISTENERS = ((4.2, 1.2, 1.5), (4.0, 1.5, 1.2), (4.6, 1.0, 1.8))
#: Decay that is shown (s), and the step of the curves (s).
SHOWN, STEP = 0.8, 0.004
#: Rays and draws of the noise.
RAYS, DRAWS = (250, 1000, 4000, 16_000), 12
#: Distance of two microphones (m), poses, and the time from which the field counts as diffuse (s).
APART, FIELDS, DIFFUSE_FROM = 0.2, 24, 0.06

#: The row of the box of plaster that the tracer should have: see `filtered_t30`.
FILTERED = "closed form, the tracer's octaves, as measured"
#: Length of the transform in which the measure's filter is sampled (0.7 Hz).
_TRANSFORM = 1 << 16

Spectrum = Sequence[float]


def box(floor: Spectrum, ceiling: Spectrum, walls: Spectrum, scattering: float) -> Scene:
    """A box of `SIZE` from the origin; absorption in each of `OCTAVES`."""
    builder = MeshBuilder()
    builder.box(tuple(SIZE), SIZE / 2, Material("wall", "wall"), acoustic="exact")
    mesh = builder.build()
    height = np.asarray(mesh.acoustic_positions)[:, :, 1]
    given = [spectral_label(tuple(a), (scattering,) * len(OCTAVES)) for a in (floor, ceiling, walls)]  # type: ignore[arg-type]
    labels = tuple(
        given[0] if (h < 1e-6).all() else given[1] if (h > SIZE[1] - 1e-6).all() else given[2] for h in height
    )
    object.__setattr__(mesh, "acoustic_labels", labels)
    return Scene("box", (Part("box", mesh),), (Room("box", (0.0, 0.0, 0.0), (6.0, 4.0, 3.0)),), ())


def even(absorption: float) -> list[float]:
    """The same absorption in all octaves."""
    return [absorption] * len(OCTAVES)


def uniform(absorption: Spectrum) -> Scene:
    """The box with walls of one material, which scatter all."""
    return box(absorption, absorption, absorption, 1.0)


def exponent(band: int) -> float:
    """Absorption of energy in the air (1/m) at an octave of `OCTAVES`."""
    return float(energy_exponents()[BANDS.index(band)])


def kuttruff(absorption: float, band: int) -> float:
    """T (s) of the box with walls that scatter all (Kuttruff, eq. 5.21) and air."""
    logarithm = math.log(1 - absorption)
    area = SURFACE * -logarithm * (1 + PATH_VARIANCE / 2 * logarithm)
    return 24 * math.log(10) * VOLUME / (SPEED_OF_SOUND * (area + 4 * exponent(band) * VOLUME))


def diffuse_level(absorption: float, band: int) -> float:
    """Energy of all but the direct sound in a diffuse field: 16π(1 − α)/(Sα + 4mV)."""
    return 16 * math.pi * (1 - absorption) / (SURFACE * absorption + 4 * exponent(band) * VOLUME)


def mirrored(listener: Sequence[float], absorption: Sequence[Sequence[float]], seconds: float, band: int) -> F64:
    """Energy of the image sources of a box of mirrors in bins of `STEP`, the direct sound included.

    Args:
        listener: metres.
        absorption: (3, 2) of the walls at 0 and at the far end of each axis.
        seconds: up to which images are summed.
        band: the octave, for the air.
    """
    axes: list[tuple[F64, F64]] = []
    for k, length in enumerate(SIZE):
        most = int(seconds * SPEED_OF_SOUND / length) + 2
        cell = np.arange(-most, most + 1)
        place = cell * length + np.where(cell % 2 == 0, SOURCE[k], length - SOURCE[k]) - listener[k]
        near = np.where(cell >= 0, cell // 2, (1 - cell) // 2)
        far = np.where(cell >= 0, (cell + 1) // 2, -cell // 2)
        axes.append((place, near * math.log(1 - absorption[k][0]) + far * math.log(1 - absorption[k][1])))
    energy = np.zeros(math.ceil(seconds / STEP) + 1)
    plane = np.square(axes[1][0])[:, None] + np.square(axes[2][0])[None]
    gain = axes[1][1][:, None] + axes[2][1][None]
    for place, reflected in zip(*axes[0], strict=True):
        distance = np.sqrt(plane + place * place)
        heard = distance < seconds * SPEED_OF_SOUND
        d = distance[heard]
        bins = (d / (SPEED_OF_SOUND * STEP)).astype(int)
        weight = np.exp(gain[heard] + reflected - exponent(band) * d) / (d * d)
        energy += np.bincount(bins, weight, minlength=len(energy))[: len(energy)]
    return energy


def _t30(energy: F64) -> float:
    curve = decibels(np.cumsum(energy[::-1])[::-1] / energy.sum())
    inside = np.flatnonzero((curve <= -5) & (curve >= -35))
    return float(-60 / np.polyfit(inside * STEP, curve[inside], 1)[0])


def filtered_t30(times: Sequence[float], *, sharp_octaves: bool = False, sharp_measure: bool = False) -> list[float]:
    """T30 (6,) s that `measure` reads in `OCTAVES` of noise whose octaves decay with known times.

    The expected energy behind the measure's filter, without noise. The ringing of the filters is left out: decays are
    slow beside it.

    Args:
        times: (8,) T of each octave of `BANDS` (s).
        sharp_octaves: octaves that end abruptly at their edges, instead of those of the tracer, which overlap.
        sharp_measure: a measure whose filter passes the octave alone, instead of `octave_filtered`.
    """
    seconds = np.arange(0, 2 * max(times), STEP)
    amplitude = 10 ** (-3 * seconds[:, None] / np.asarray(times))
    frequency = np.fft.rfftfreq(_TRANSFORM, 1 / SAMPLE_RATE)
    weights = band_weights(frequency)
    if sharp_octaves:
        weights = (weights > 0.5).astype(float)
    impulse = np.zeros(_TRANSFORM // 8)
    impulse[len(impulse) // 2] = 1.0
    read = []
    for band in OCTAVES:
        passed = np.abs(np.fft.rfft(octave_filtered(impulse, SAMPLE_RATE, band), _TRANSFORM)) ** 2
        if sharp_measure:
            passed = np.abs(np.log2(np.maximum(frequency, 1) / band)) < 0.5
        # One arrival has one sign in all octaves, so that its amplitudes add up where octaves overlap.
        shared = (weights * passed) @ weights.T
        read.append(_t30(np.einsum("ti,ij,tj->t", amplitude, shared, amplitude)))
    return read


def _direct() -> float:
    """Mean energy of the direct sound."""
    return float(np.mean([1 / math.dist(SOURCE, listener) ** 2 for listener in LISTENERS]))


def simulate(engine: str, scene: Scene) -> dict[str, Any]:
    """T30 (6,) s and energy (6,) without the direct sound: means over `LISTENERS`; Schroeder's curve at 1 kHz."""
    poses = [Pose.from_yaw(listener, 0.0) for listener in LISTENERS]
    times, energies, curves = [], [], []
    for _, omni in responses(engine, scene, SOURCE, "box", poses, head=False):
        found = measure(omni, None)
        times.append(found.t30[0])
        energies.append(found.energy[0])
        curve = decay_curve(octave_filtered(omni, SAMPLE_RATE, 1000.0)[0])
        start = int(4 * SAMPLE_RATE / (1000 / math.sqrt(2)))  # the filter's margin
        at = start + (np.arange(0, SHOWN, STEP) * SAMPLE_RATE).astype(int)
        curves.append(np.where(at < len(curve), curve[np.minimum(at, len(curve) - 1)], -np.inf))
    with np.errstate(over="ignore"):
        mean = decibels(np.mean(10 ** (np.array(curves) / 10), axis=0))
    return {
        "t30": np.nanmean(np.array(times, dtype=float), axis=0),
        "energy": np.mean(energies, axis=0) - _direct(),
        "curve": np.maximum(mean, -99.0),
    }


def diffuse_boxes() -> dict[str, Any]:
    """Walls that scatter all: Kuttruff's reverberation time and the level of the diffuse field."""
    middle = [OCTAVES.index(band) for band in MIDDLE]
    table = {}
    for absorption in (0.05, 0.1, 0.2, 0.4):
        row: dict[str, Any] = {
            "T30 (s)": {"closed form": float(np.mean([kuttruff(absorption, band) for band in MIDDLE]))},
            "level (dB)": {
                "closed form": float(decibels(np.mean([diffuse_level(absorption, band) for band in MIDDLE])))
            },
        }
        for engine in ENGINES:
            found = simulate(engine, uniform(even(absorption)))
            row["T30 (s)"][engine] = float(found["t30"][middle].mean())
            row["level (dB)"][engine] = float(decibels(found["energy"][middle].mean()))
        table[str(absorption)] = row
    return table


def plaster_box() -> dict[str, Any]:
    """A diffuse box of plaster as dwellings have it: T30 (s) in each octave.

    The octaves decay so differently that no filter reads each by itself: `filtered_t30` of the closed form is what an
    exact engine would show.
    """
    absorption = MATERIALS["plaster"].in_situ
    outer = (absorption[0], *absorption, absorption[-1])
    closed = [kuttruff(a, band) for a, band in zip(outer, BANDS, strict=True)]
    found = {engine: simulate(engine, uniform(absorption))["t30"].tolist() for engine in ENGINES}
    return {
        "closed form": closed[1:-1],
        "closed form, sharp octaves, as measured": filtered_t30(closed, sharp_octaves=True),
        "closed form, the tracer's octaves, sharp measure": filtered_t30(closed, sharp_measure=True),
        FILTERED: filtered_t30(closed),
    } | found


def mirror_boxes() -> dict[str, Any]:
    """Boxes of mirrors at 1 kHz: image sources, and the same box with walls that scatter all."""
    at = OCTAVES.index(1000)
    table: dict[str, Any] = {}
    for name, (floor, ceiling, walls) in MIRRORS.items():
        pairs = ((walls, walls), (floor, ceiling), (walls, walls))
        images = [mirrored(listener, pairs, 1.4, 1000) for listener in LISTENERS]
        mean = np.sum([energy / energy.sum() for energy in images], axis=0)
        curve = decibels(np.maximum(np.cumsum(mean[::-1])[::-1] / mean.sum(), 1e-12))
        row: dict[str, Any] = {
            "T30 (s)": {"image sources": float(np.mean([_t30(energy) for energy in images]))},
            "level (dB)": {"image sources": float(decibels(np.mean([e.sum() for e in images]) - _direct()))},
            "curve (dB)": {"image sources": curve[: round(SHOWN / STEP)].tolist()},
        }
        for engine in ENGINES:
            for scattering in (0.0, 1.0):
                title = engine if scattering == 0 else f"{engine}, all scattered"
                found = simulate(engine, box(even(floor), even(ceiling), even(walls), scattering))
                row["T30 (s)"][title] = float(found["t30"][at])
                row["level (dB)"][title] = float(decibels(found["energy"][at]))
                row["curve (dB)"][title] = found["curve"].tolist()
        table[name] = row
    return table


def direct_levels() -> dict[str, Any]:
    """Level of the direct sound in the free field relative to 1/r, dB, at some distances (m)."""
    free = Scene("free field", (), (Room("box", (0.0, 0.0, 0.0), (6.0, 4.0, 3.0)),), ())
    table = {}
    for distance in (0.25, 0.5, 1.0, 2.0, 4.0):
        here = [Pose.from_yaw((0.0, 0.0, distance), 0.0)]
        row = {}
        for engine in ENGINES:
            ((_, omni),) = responses(engine, free, (0.0, 0.0, 0.0), "box", here, head=False)
            row[engine] = float(decibels(octave_energies(omni)[0, OCTAVES.index(1000)] * distance**2))
        table[str(distance)] = row
    return table


def low_source() -> dict[str, list[float]]:
    """Energy up to 2 ms after the direct sound beside a hard floor relative to 1/r², dB, in each of `OCTAVES`.

    The floor's image source is 1/r + R·δ/r' with R = √(1 − α): pressures add, and the octaves have dips and peaks.
    Adding energies instead would give the same level in all octaves.
    """
    scene = box(even(FLOOR), even(SOFT), even(SOFT), 0.0)
    found = {"closed form": [], "closed form, energies added": []} | {engine: [] for engine in ENGINES}  # type: ignore[var-annotated]
    for listener in LOW_LISTENERS:
        direct = math.dist(LOW_SOURCE, listener)
        image = math.dist((LOW_SOURCE[0], -LOW_SOURCE[1], LOW_SOURCE[2]), listener)
        gain, delay = math.sqrt(1 - FLOOR) * direct / image, (image - direct) / SPEED_OF_SOUND
        bands = [np.linspace(band / math.sqrt(2), band * math.sqrt(2), 400) for band in OCTAVES]
        crossed = np.array([np.cos(2 * np.pi * band * delay).mean() for band in bands])
        found["closed form"].append(1 + gain**2 + 2 * gain * crossed)
        found["closed form, energies added"].append(np.full(len(OCTAVES), 1 + gain**2))
    poses = [Pose.from_yaw(listener, 0.0) for listener in LOW_LISTENERS]
    for engine in ENGINES:
        for listener, (_, omni) in zip(
            LOW_LISTENERS, responses(engine, scene, LOW_SOURCE, "box", poses, head=False), strict=True
        ):
            distance = math.dist(LOW_SOURCE, listener)
            found[engine].append(np.array(measure(omni, distance).direct[0]) * distance**2)
    return {name: decibels(np.mean(values, axis=0)).tolist() for name, values in found.items()}


def noise() -> dict[str, Any]:
    """Standard deviation over seeds of the energy at 1 kHz against the number of rays, rain and images left out."""
    scene = box(even(0.2), even(0.1), even(0.1), 0.3)
    here = Pose.from_yaw(LISTENERS[0], 0.0)
    table = {}
    for rays in RAYS:
        levels = []
        for seed in range(DRAWS):
            settings = TraceSettings(least_rays=rays, most_rays=rays, rain_rays=0, seed=seed)
            session = TracerBackend(settings=settings).open(scene, SOURCE, room="box")
            arrivals = session.arrivals(here)
            traced = np.square(arrivals.pressure[arrivals.time > DIFFUSE_FROM, BANDS.index(1000)], dtype=float)
            levels.append(float(decibels(traced.sum())))
        table[str(rays)] = float(np.std(levels, ddof=1))
    return table


def coherence(folder: Path) -> dict[str, Any]:
    """Coherence of two microphones in the late field of a diffuse box, and sin(kd)/(kd)."""
    path = folder / "pair.json"
    write_json(path, {"microphones": [{"position": [-APART / 2, 0, 0]}, {"position": [APART / 2, 0, 0]}]})
    session = TracerBackend(Array(path)).open(uniform(even(0.1)), SOURCE, room="box")
    rng = np.random.default_rng(0)
    places = rng.uniform(0.6, SIZE - 0.6, (FIELDS, 3))
    poses = [
        Pose.from_yaw(tuple(place), float(turn)) for place, turn in zip(places, rng.uniform(0, 6, FIELDS), strict=True)
    ]
    session.prepare(poses)
    cut = int(DIFFUSE_FROM * SAMPLE_RATE)
    spectra = np.array([np.fft.rfft(session.impulse_response(pose)[:, cut : cut + 32_768], 32_768) for pose in poses])
    frequency = np.fft.rfftfreq(32_768, 1 / SAMPLE_RATE)
    cross = np.mean(spectra[:, 0] * np.conj(spectra[:, 1]), axis=0).real
    power = np.mean(np.abs(spectra) ** 2, axis=0)
    edges = np.arange(50.0, 3050.0, 100.0)
    parts = [(frequency >= low) & (frequency < low + 100) for low in edges]
    measured = [float(cross[p].sum() / np.sqrt(power[0, p].sum() * power[1, p].sum())) for p in parts]
    closed = [float(np.sinc(2 * frequency[p] * APART / SPEED_OF_SOUND).mean()) for p in parts]
    return {"frequency (Hz)": (edges + 50).tolist(), "measured": measured, "closed form": closed}


def exchanged() -> float:
    """Largest difference of an octave's energy (dB) of the tracer when source and listener change places."""
    scene = box(even(0.4), even(0.1), even(0.2), 0.3)
    worst = 0.0
    for listener in LISTENERS:
        pair = []
        for seed, (source, place) in enumerate(((SOURCE, listener), (listener, SOURCE))):
            session = TracerBackend(settings=TraceSettings(seed=seed)).open(scene, source, room="box")
            pair.append(session.arrivals(Pose.from_yaw(place, 0.0)).energy)
        worst = max(worst, float(np.abs(decibels(pair[0] / pair[1])).max()))
    return worst


def _head(title: str, columns: Iterable[str]) -> list[str]:
    """A blank line, and the first two lines of a table."""
    names = [title, *columns]
    return ["", f"| {' | '.join(names)} |", "|---" * len(names) + "|"]


def markdown(found: dict[str, Any]) -> str:
    """The figures as tables."""
    lines = [
        "| absorption | T30, s: closed form | tracer | SoundSpaces | level, dB: closed form | tracer | SoundSpaces |"
    ]
    lines.append("|---" * 7 + "|")
    columns, octaves = ("closed form", *ENGINES), [f"{band} Hz" for band in OCTAVES]
    for absorption, row in found["diffuse"].items():
        cells = [f"{row['T30 (s)'][c]:.3f}" for c in columns] + [f"{row['level (dB)'][c]:+.1f}" for c in columns]
        lines.append(f"| {absorption} | {' | '.join(cells)} |")
    lines += _head("box of mirrors, 1 kHz", found["mirrors"]["all 0.2"]["T30 (s)"])
    for name, row in found["mirrors"].items():
        for what, form in (("T30 (s)", "{:.3f}"), ("level (dB)", "{:+.1f}")):
            lines.append(f"| {name}, {what} | " + " | ".join(form.format(value) for value in row[what].values()) + " |")
    lines += _head("diffuse box of plaster, T30, s", octaves)
    for name, values in found["plaster"].items():
        lines.append(f"| {name} | " + " | ".join(f"{value:.2f}" for value in values) + " |")
    lines += _head("direct sound re 1/r, dB", [f"{distance} m" for distance in found["direct"]])
    for engine in ENGINES:
        lines.append(f"| {engine} | " + " | ".join(f"{row[engine]:+.2f}" for row in found["direct"].values()) + " |")
    lines += _head("first 2 ms beside a hard floor re 1/r², dB", octaves)
    for name, values in found["low source"].items():
        lines.append(f"| {name} | " + " | ".join(f"{value:+.1f}" for value in values) + " |")
    lines += ["", f"Source and listener exchanged, largest difference of an octave, dB: {found['exchanged']:.2f}"]
    lines += [f"Standard deviation over seeds, dB, by number of rays: {found['noise']}"]
    off = np.abs(np.subtract(found["coherence"]["measured"], found["coherence"]["closed form"]))
    lines += [
        f"Coherence of two microphones against sin(kd)/(kd): largest difference {off.max():.2f}, mean {off.mean():.2f}"
    ]
    return "\n".join(lines) + "\n"


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("build/agreement"), show_default=True)
def main(output: Path) -> None:
    """Run all boxes, print the tables, and write them below OUTPUT."""
    output.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Callable[[], Any]] = {
        "diffuse": diffuse_boxes, "mirrors": mirror_boxes, "plaster": plaster_box, "direct": direct_levels,
        "low source": low_source, "noise": noise, "coherence": lambda: coherence(output), "exchanged": exchanged,
    }  # fmt: skip
    found = {}
    for name, part in parts.items():
        click.echo(name, err=True)
        found[name] = part()
    write_json(output / "closed_forms.json", found)
    write_bytes(output / "closed_forms.md", markdown(found).encode())
    click.echo(markdown(found))


if __name__ == "__main__":
    main()
