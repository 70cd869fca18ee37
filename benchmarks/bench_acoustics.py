"""CPU time and variance of impulse responses in a furnished flat, and CPU time of source signals and clips.

As a script, it prints the figures as JSON; with the argument ``cuda``, those of the tracer on the CUDA device alone;
with the argument ``rooms``, the standard deviation of the level in every room of the open benchmark.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import reverberation_time
from benchmarks.unseen_homes import home_of
from generators.acoustics.analytic import AnalyticBackend
from generators.acoustics.base import AcousticBackend, AcousticSession
from generators.acoustics.clips import binaural_clip
from generators.acoustics.soundspaces import SoundSpacesBackend
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.settings import TraceSettings
from generators.apartments.apartment import build_apartment
from generators.assets.sounds import synthesise
from generators.core.cuda import cuda_problem
from generators.core.scene import Scene
from generators.observation.arrangement import arrange, draw_sounding
from generators.plan import ObservationPlan, make_plans, read_manifest
from generators.scenes.placed import PlacedScene

Position = tuple[float, float, float]

#: The open benchmark.
MANIFEST = Path(__file__).parent.parent / "scenes_manifest" / "open-s34-o7.yaml"
ROOMS = ("bathroom", "kitchen", "living_room")
#: Source and listener as shares of the room's box (x, z); heights in metres.
SOURCE, LISTENER = (0.5, 0.15), (0.6, 0.55)
SOURCE_HEIGHT, EAR_HEIGHT = 1.2, 1.5
#: Poses of an observation, which share a trace of the tracer.
POSES = 120
#: Sources whose responses are timed on a CUDA device.
CUDA_SOURCES = 16
#: Number of draws for a standard deviation; with fewer, 0.15 dB and 0.2 dB could not be distinguished.
DRAWS = 12


def _cpu(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _place(scene: Scene, room: str, share: tuple[float, float], height: float) -> Position:
    box = scene.room(room)
    return (
        box.low[0] + share[0] * (box.high[0] - box.low[0]),
        height,
        box.low[2] + share[1] * (box.high[2] - box.low[2]),
    )


def _sessions(backend: AcousticBackend, scene: Scene) -> list[tuple[AcousticSession, Pose]]:
    return [
        (
            backend.open(scene, _place(scene, room, SOURCE, SOURCE_HEIGHT), room=room),
            Pose.from_yaw(_place(scene, room, LISTENER, EAR_HEIGHT), 0.7),
        )
        for room in ROOMS
    ]


def run_all(repeats: int = 5) -> dict[str, float]:
    """Medians over the rooms of the median of ``repeats`` runs; ``worst``: the slowest or most variable room."""
    scene = build_apartment("bench", 1)
    figures: dict[str, float] = {"acoustic faces": float(sum(len(p.mesh.acoustic_positions) for p in scene.parts))}

    engine = SoundSpacesBackend()
    times, spreads, decays = [], [], []
    for session, pose in _sessions(engine, scene):
        responses: list[NDArray[np.float32]] = []
        spent: list[float] = []
        for _ in range(max(repeats, DRAWS)):
            start = time.process_time()
            responses.append(session.impulse_response(pose))
            spent.append(time.process_time() - start)
        times.append(median(spent))
        spreads.append(_deviation(responses))
        decays.append(reverberation_time(responses[:2], SAMPLE_RATE) or float("nan"))
        session.close()
    figures["impulse response (CPU s)"] = median(times)
    figures["impulse response, worst room (CPU s)"] = max(times)
    figures["broadband level, SD over draws (dB)"] = median(spreads)
    figures["broadband level, SD, worst room (dB)"] = max(spreads)
    for room, decay in zip(ROOMS, decays, strict=True):
        figures[f"T30, {room} (s)"] = decay

    figures |= _tracer(scene)
    if cuda_problem() is None:
        figures |= tracer_on_cuda(scene)

    times = []
    for session, pose in _sessions(AnalyticBackend(), scene):
        response = session.impulse_response(pose)  # the first one builds the diffuse tail
        times.append(median(_cpu(partial(session.impulse_response, pose)) for _ in range(repeats)))
    figures["analytic impulse response (CPU s)"] = median(times)

    source = synthesise("washing_machine", 10, np.random.default_rng(0))
    figures["binaural clip (CPU s)"] = median(_cpu(lambda: binaural_clip(source, response, 5)) for _ in range(repeats))
    figures["synthesised source, per 120 s (CPU s)"] = median(
        _cpu(lambda: synthesise("toilet", 120, np.random.default_rng(0))) for _ in range(repeats)
    )
    return figures


def _tracer(scene: Scene) -> dict[str, float]:
    """The tracer in the same rooms: an observation's poses share a trace; its draws are seeds."""
    TracerBackend().warm_up()
    traces, responses, spreads = [], [], []
    for room in ROOMS:
        poses = _circle(scene, room)
        session = TracerBackend().open(scene, _place(scene, room, SOURCE, SOURCE_HEIGHT), room=room)
        # The first one builds the receiver's tables.
        session.impulse_response(Pose.from_yaw(_place(scene, room, LISTENER, EAR_HEIGHT), 0.7))
        session.prepare(poses)
        traces.append(_cpu(partial(session.arrivals, poses[0])) / POSES)
        responses.append(median(_cpu(partial(session.impulse_response, pose)) for pose in poses[:10]))
        session.close()
        spreads.append(_spread(TracerBackend, scene, room))
    both = [trace + response for trace, response in zip(traces, responses, strict=True)]
    return {
        f"tracer, share of a trace for {POSES} poses (CPU s)": median(traces),
        "tracer, receiver (CPU s)": median(responses),
        "tracer, impulse response (CPU s)": median(both),
        "tracer, impulse response, worst room (CPU s)": max(both),
        "tracer, broadband level, SD over draws (dB)": median(spreads),
        "tracer, broadband level, SD, worst room (dB)": max(spreads),
    }


def tracer_on_cuda(scene: Scene) -> dict[str, float]:
    """The tracer on a CUDA device: wall-clock time of all poses of many sources, one after the other, in one thread."""
    backend = TracerBackend(device="cuda")
    backend.warm_up()
    rates: dict[str, list[float]] = {"poses on a circle of 20 cm": [], "poses all through the room": []}
    errors, spreads = [], []
    for room in ROOMS:
        x, y, z = _place(scene, room, SOURCE, SOURCE_HEIGHT)
        for poses, found in zip((_circle(scene, room), _walk(scene, room)), rates.values(), strict=True):
            session = backend.open(scene, (x, y, z), room=room)
            session.prepare(poses)
            first = session.impulse_response(poses[0])  # builds the receiver's tables
            start = time.perf_counter()
            for number in range(1, CUDA_SOURCES + 1):
                session.move_source((x + 0.01 * number, y, z))
                for pose in poses:
                    session.impulse_response(pose)
            found.append(CUDA_SOURCES * len(poses) / (time.perf_counter() - start))
            session.close()
            expected = TracerBackend().open(scene, (x, y, z), room=room).impulse_response(poses[0])
            errors.append(20 * float(np.log10(np.linalg.norm(first - expected) / np.linalg.norm(expected))))
        spreads.append(_spread(partial(TracerBackend, device="cuda"), scene, room))
    return {
        **{f"tracer on CUDA, {name} (responses/s)": median(found) for name, found in rates.items()},
        **{f"tracer on CUDA, {name}, worst room (responses/s)": min(found) for name, found in rates.items()},
        "tracer on CUDA, broadband level, SD over draws (dB)": median(spreads),
        "tracer on CUDA, broadband level, SD, worst room (dB)": max(spreads),
        "tracer on CUDA, difference from the CPU's responses, largest (dB)": max(errors),
    }


def _walk(scene: Scene, room: str) -> list[Pose]:
    """As many poses along the diagonal of the room."""
    share = np.linspace(0.15, 0.85, POSES)
    return [Pose.from_yaw(_place(scene, room, (a, a), EAR_HEIGHT), 7 * a) for a in share.tolist()]


def _circle(scene: Scene, room: str) -> list[Pose]:
    """The poses of an observation: on a circle of 20 cm."""
    x, y, z = _place(scene, room, LISTENER, EAR_HEIGHT)
    turn = np.linspace(0, 2 * np.pi, POSES, endpoint=False)
    return [Pose.from_yaw((x + 0.2 * np.cos(a), y, z + 0.2 * np.sin(a)), 0.7) for a in turn]


def _deviation(responses: Sequence[NDArray[np.float32]]) -> float:
    """Standard deviation of the broadband level of several draws of one response, dB."""
    return float(np.std([10 * np.log10(np.sum(np.square(r, dtype=np.float64))) for r in responses], ddof=1))


def _spread(backend: Callable[..., TracerBackend], scene: Scene, room: str) -> float:
    """Standard deviation of the broadband level of one response over seeds, dB."""
    listener = Pose.from_yaw(_place(scene, room, LISTENER, EAR_HEIGHT), 0.7)
    return _deviation(_draws(backend, scene, room, _place(scene, room, SOURCE, SOURCE_HEIGHT), listener))


def _draws(
    backend: Callable[..., TracerBackend], scene: Scene, room: str, source: Position, pose: Pose
) -> list[NDArray[np.float32]]:
    """The tracer's response of one pose with `DRAWS` seeds."""
    drawn = []
    for seed in range(DRAWS):
        session = backend(settings=TraceSettings(seed=seed)).open(scene, source, room=room)
        drawn.append(session.impulse_response(pose))
        session.close()
    return drawn


def spreads_of_rooms() -> dict[str, dict[str, float]]:
    """Standard deviation of the broadband level over draws in every room of the open benchmark, dB.

    The first observation of each room with its objects and its source, heard from the middle of its walk.
    """
    first: dict[str, ObservationPlan] = {}
    for plan in make_plans(read_manifest(MANIFEST)):
        first.setdefault(f"{plan.spec.scan}/{plan.spec.room}", plan)
    found = {}
    for name in sorted(first):
        plan = first[name]
        home = home_of(plan).for_room(plan.spec.room)
        seen = arrange(plan, home)
        stage = PlacedScene(home, seen.placements, seen.motions)
        scene, source = stage.scene(0), stage.placement(draw_sounding(plan, seen.placements), 0).source_position
        pose, room = seen.poses[len(seen.poses) // 2], plan.spec.room
        engine = SoundSpacesBackend().open(scene, source, room=room)
        found[name] = {
            "tracer": _deviation(_draws(TracerBackend, scene, room, source, pose)),
            "soundspaces": _deviation([engine.impulse_response(pose) for _ in range(DRAWS)]),
        }
        engine.close()
    return found


def main(arguments: list[str]) -> None:
    """Print the figures that the arguments of the command line ask for."""
    works: dict[tuple[str, ...], Callable[[], object]] = {
        (): run_all,
        ("cuda",): lambda: tracer_on_cuda(build_apartment("bench", 1)),
        ("rooms",): spreads_of_rooms,
    }
    if arguments in (["-h"], ["--help"]):
        print(__doc__)
        return
    if tuple(arguments) not in works:
        sys.exit(f"bench_acoustics: unknown argument {' '.join(arguments)!r}; expected none, cuda or rooms")
    print(json.dumps(works[tuple(arguments)](), indent=2))


if __name__ == "__main__":
    main(sys.argv[1:])
