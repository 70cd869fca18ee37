"""Shoeboxes: our engines and pyroomacoustics beside Eyring's formula and exact image sources.

    python -m benchmarks.shoeboxes [--acoustic-spaces PROGRAM]

pyroomacoustics is measured if it is installed (pip install pyroomacoustics); it is no dependency. acoustic-spaces
(GPL-3.0) is measured if its program is given: install it in an environment of its own (python -m venv E; E/bin/pip
install acoustic-spaces) and pass E/bin/acoustic-spaces. It runs as a separate program: a scene file goes in, WAV files
come out; its CPU time is that of the whole program, for four listeners, divided by four. All walls of a box
have one absorption and a scattering of 0.1. "Early" is the largest error of the level (dB) of the first 20 image
sources (of `Analytic` these are the closed form itself), against 1/r·(1 − α)^(n/2)·(1 − s)^(n/2), the engine's
scattering taken off. Of acoustic-spaces only waveforms are known: a run without scattering is fitted from 0.2 to
3 kHz, images that arrive within 0.1 m of each other with one level, which a waveform resolves to about 0.02 dB. "T30"
is the mean of 500 Hz and 1 kHz over four listeners; "CPU" the seconds of one response after the first, compilation
left out.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import eyring
from generators import acoustics
from generators.acoustics.analytic import Box, image_sources
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS

F64 = NDArray[np.float64]

RATE, SCATTERING = 44_100, 0.1
#: Rays of the other programs (acoustic-spaces: in each octave); our tracer's own number follows from the room.
RAYS = 10_000
#: Speed of sound in acoustic-spaces at 20 °C (m/s), and the distance (m) from which two images are told apart.
_SPEED_AT_20, _APART = 343.21, 0.1
BOXES = (((6.0, 2.7, 4.0), 0.1), ((6.0, 2.7, 4.0), 0.3), ((3.0, 2.4, 2.5), 0.2), ((12.0, 4.0, 9.0), 0.15))
SOURCE_SHARE = (0.25, 0.55, 0.4)
LISTENER_SHARES = ((0.7, 0.5, 0.6), (0.55, 0.6, 0.8), (0.8, 0.45, 0.3), (0.4, 0.5, 0.75))


def t30_of(samples: F64) -> float:
    """Mean T30 of 500 Hz and 1 kHz in s."""
    rir = acoustics.Rir(
        samples.astype(np.float32), RATE, ("omni",), (0.0, 0.0, 0.0), Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    )
    found = rir.t30()
    return float(np.mean([found[octave] or np.nan for octave in (500, 1000)]))


def nearest_images(box: Box, source: F64, listener: F64) -> tuple[F64, F64]:
    """Distances (m) and exact amplitudes at 1 kHz of the 20 nearest image sources, up to the third order; no air."""
    positions, bounces = image_sources(box, source, listener, 3.0 * float(box.size.max()))
    distance = np.linalg.norm(positions - listener, axis=1)
    order = np.argsort(distance)[:20]
    order = order[bounces[order] <= 3]
    alpha = box.absorption[3]
    wanted = ((1 - alpha) * (1 - SCATTERING)) ** (bounces[order] / 2) / distance[order]
    return distance[order], wanted


def largest_error(found: ArrayLike, wanted: F64) -> float:
    """Largest error (dB) of amplitudes."""
    return float(np.abs(20 * np.log10(np.maximum(np.asarray(found), 1e-9) / wanted)).max())


def early_error(arrivals: acoustics.Arrivals, box: Box, source: F64, listener: F64) -> float:
    """Largest error (dB) at 1 kHz of the specular arrivals among the nearest image sources."""
    distances, wanted = nearest_images(box, source, listener)
    wanted = wanted * np.exp(-0.5 * energy_exponents()[4] * distances)
    early = np.flatnonzero(arrivals.is_spherical)
    found = []
    for far in distances:
        near = early[np.abs(arrivals.time[early] * SPEED_OF_SOUND - far) < 1e-3]
        found.append(float(arrivals.pressure[near, 4].sum()) / max(len(near), 1))
    return largest_error(found, wanted)


def early_error_of_pyroomacoustics(box: Box, alpha: float, source: F64, listener: F64) -> float:
    """The same of its images: each with its distance and the damping of its walls."""
    import pyroomacoustics

    material = pyroomacoustics.Material(alpha, SCATTERING)
    room: Any = pyroomacoustics.ShoeBox(box.size, fs=RATE, materials=material, max_order=3, ray_tracing=True)
    room.add_source(source)
    room.add_microphone(listener)
    room.image_source_model()
    far = np.linalg.norm(room.sources[0].images.T - listener, axis=1)
    distances, wanted = nearest_images(box, source, listener)
    place = np.abs(far - distances[:, None]).argmin(axis=1)
    return largest_error(room.sources[0].damping[0, place] / far[place], wanted)


def measured(respond: Callable[[F64], F64], listeners: list[F64]) -> tuple[float, float]:
    """CPU seconds of a response, and the mean T30 in s."""
    respond(listeners[0])
    start = time.process_time()
    responses = [respond(listener) for listener in listeners]
    return (time.process_time() - start) / len(listeners), float(np.mean([t30_of(each) for each in responses]))


def of_engine(engine: acoustics.Engine, room: acoustics.Room, source: F64, receiver: Any, listener: F64) -> F64:
    """The response of one of our engines."""
    return np.asarray(engine.response(room, source, listener, receiver).samples, dtype=np.float64)


def of_pyroomacoustics(size: F64, alpha: float, source: F64) -> Callable[[F64], F64]:
    """Responses of pyroomacoustics: images to the third order, then rays, as our tracer does."""
    import pyroomacoustics

    def respond(listener: F64) -> F64:
        material = pyroomacoustics.Material(alpha, SCATTERING)
        room: Any = pyroomacoustics.ShoeBox(
            size, fs=RATE, materials=material, max_order=3, ray_tracing=True, air_absorption=True
        )
        room.set_ray_tracing(receiver_radius=0.35, n_rays=RAYS)
        room.add_source(source)
        room.add_microphone(listener)
        room.compute_rir()
        return np.asarray(room.rir[0][0])[None]

    return respond


def run_acoustic_spaces(
    program: Path, size: F64, coefficients: tuple[float, float], places: list[F64], simulation: dict[str, Any]
) -> tuple[float, list[F64]]:
    """CPU seconds of acoustic-spaces and its responses (1, n), from the first of ``places`` to the others.

    Its axes have Z up; all walls being alike, height and depth change places.

    Args:
        program: the command.
        size: of the box, m.
        coefficients: absorption and scattering of all walls.
        places: source, listeners.
        simulation: options of its scene file.
    """
    import soundfile
    import yaml

    def placed(point: F64) -> list[float]:
        return [float(point[axis]) for axis in (0, 2, 1)]

    box = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], placed(size)])
    box.invert()  # its normals point into the room
    absorption, scattering = coefficients
    listeners = [{"name": f"l{number}", "position": placed(each)} for number, each in enumerate(places[1:])]
    document = {
        "name": "box",
        "geometry": {"file": "box.obj", "units": "m"},
        "materials": {"wall": {"absorption": [absorption] * 8, "scattering": [scattering] * 8}},
        "assignments": {"walls": "wall"},
        "sources": [{"name": "s", "position": placed(places[0]), "directivity": "omni"}],
        "listeners": listeners,
        "air": {"temperature_c": 20, "humidity_percent": 50},
        "simulation": {"sample_rate": RATE, "seed": 1, "performance": {"threads": 1}, **simulation},
        "outputs": ["mono"],
    }
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        faces = "\n".join(f"f {a} {b} {c}" for a, b, c in box.faces + 1)
        corners = "\n".join(f"v {x!r} {y!r} {z!r}" for x, y, z in box.vertices.tolist())
        (place / "box.obj").write_text(f"{corners}\ng walls\n{faces}\n", encoding="utf-8")
        (place / "scene.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [str(program), "simulate", str(place / "scene.yaml"), "--out", str(place / "out")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{program}: {(done.stderr or done.stdout).strip()[-300:]}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = [soundfile.read(path, always_2d=True)[0].T for path in sorted((place / "out").rglob("*.wav"))]
    if len(found) != len(listeners):
        raise SystemExit(f"{program}: wrote {len(found)} WAV files, expected {len(listeners)}; its layout has changed")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, found


def of_acoustic_spaces(
    program: Path, size: F64, alpha: float, source: F64, listeners: list[F64]
) -> tuple[float, float]:
    """CPU seconds per response and mean T30 in s of acoustic-spaces: images to the third order, then rays."""
    simulation = {
        "early": {"method": "ray_tracing", "max_order": 3},
        "late": {"method": "stochastic_ray_tracing", "rays": RAYS},
        "ir_length_s": 2.5,
    }
    seconds, found = run_acoustic_spaces(program, size, (alpha, SCATTERING), [source, *listeners], simulation)
    return seconds / len(listeners), float(np.mean([t30_of(each) for each in found]))


def early_error_of_acoustic_spaces(program: Path, box: Box, alpha: float, source: F64, listener: F64) -> float:
    """Largest error (dB) of the levels of the nearest images: those of exact pulses, fitted to its waveform."""
    positions, bounces = image_sources(box, source, listener, 3.0 * float(box.size.max()))
    distance = np.linalg.norm(positions - listener, axis=1)
    order = np.argsort(distance)
    distance, bounces = distance[order], bounces[order]
    end = distance[bounces > 3].min()  # from here on, the rays add what is not known
    distance, bounces = distance[distance < end], bounces[distance < end]
    simulation = {
        "early": {"method": "ray_tracing", "max_order": 3, "diffraction": "none", "coherent_max_band_hz": None},
        "late": {"method": "stochastic_ray_tracing", "rays": 1},
        "ir_length_s": 0.3,
    }
    _, responses = run_acoustic_spaces(program, box.size, (alpha, 0.0), [source, listener], simulation)
    response = responses[0][0]
    frequency = np.fft.rfftfreq(len(response), 1 / RATE)
    band = np.clip((frequency - 200) / 200, 0, 1) * np.clip((3000 - frequency) / 1500, 0, 1)
    air = np.interp(np.log(np.maximum(frequency, 1)), np.log(BANDS), energy_exponents())
    spectra = (
        (1 - alpha) ** (bounces / 2)
        / distance
        * np.exp(np.multiply.outer(-2j * np.pi * frequency / _SPEED_AT_20 - 0.5 * air, distance))
    )
    group = np.cumsum(np.diff(distance, prepend=-1.0) > _APART) - 1
    pulses = np.fft.irfft(band[:, None] * spectra, len(response), axis=0)
    together = np.stack([pulses[:, group == number].sum(axis=1) for number in range(group.max() + 1)], axis=1)
    heard = np.fft.irfft(band * np.fft.rfft(response), len(response))
    last = int(end / _SPEED_AT_20 * RATE) - 20
    gain = np.linalg.lstsq(together[:last], heard[:last], rcond=None)[0][: group[:20].max() + 1]
    return largest_error(gain, np.ones(len(gain)))


def main() -> None:
    """Print one line per box and engine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--acoustic-spaces", type=Path, help="the program of acoustic-spaces, in its own environment")
    parser.add_argument("--boxes", type=int, default=len(BOXES), help="the first so many boxes alone")
    given = parser.parse_args()
    print(f"{'box (m)':16} {'α':>5} {'engine':16} {'CPU (s)':>8} {'T30 (s)':>8} {'Eyring':>7} {'early (dB)':>10}")
    for edges, alpha in BOXES[: given.boxes]:
        size = np.array(edges)
        source, listeners = size * SOURCE_SHARE, [size * share for share in LISTENER_SHARES]
        room = acoustics.Room.shoebox(size, {"*": {"absorption": alpha, "scattering": SCATTERING}})
        box = Box((0.0, 0.0, 0.0), (edges[0], edges[1], edges[2]), (alpha,) * 6)
        closed = eyring(box.volume, box.surface, alpha)
        tracer = acoustics.Tracer(seed=1)
        engines: dict[str, Callable[[F64], F64]] = {
            "Tracer": partial(of_engine, tracer, room, source, acoustics.Omni()),
            "Analytic": partial(of_engine, acoustics.Analytic(), room, source, None),
        }
        if find_spec("pyroomacoustics"):
            engines["pyroomacoustics"] = of_pyroomacoustics(size, alpha, source)
        arrivals = tracer.response(room, source, listeners[0], acoustics.Omni()).arrivals
        assert arrivals is not None
        early = {"Tracer": early_error(arrivals, box, source, listeners[0])}
        if "pyroomacoustics" in engines:
            early["pyroomacoustics"] = early_error_of_pyroomacoustics(box, alpha, source, listeners[0])
        results = {name: measured(respond, listeners) for name, respond in engines.items()}
        if given.acoustic_spaces is not None:
            program = given.acoustic_spaces
            results["acoustic-spaces"] = of_acoustic_spaces(program, size, alpha, source, listeners)
            early["acoustic-spaces"] = early_error_of_acoustic_spaces(program, box, alpha, source, listeners[0])
        for name, (seconds, time_60) in results.items():
            error = f"{early[name]:10.3f}" if name in early else " " * 10
            place = "×".join(f"{edge:g}" for edge in edges)
            print(f"{place:16} {alpha:5.2f} {name:16} {seconds:8.2f} {time_60:8.3f} {closed:7.3f} {error}", flush=True)


if __name__ == "__main__":
    main()
