"""`python -m benchmarks.instance_selection ROOT`: how often is the sounding one of several identical objects chosen?

Three experiments, each with `official` (the published AISRM), `centre` (the candidate nearest to the published audio
centre: AISRM without its size rule) and `spatial` with all its cues and with each alone:

- *twins*: the candidates are the sounding instance and all silent twins of an observation of part_2.
- *invented*: in every observation, one invented twin at a time, 0.5, 1 and 2 m from the sounding instance (centre to
  centre), in 16 directions. A twin inside a wall, in another room or inside the original is not used.
- *simulated*: box rooms with 2 to 4 candidates, at least 0.5 or 1 m apart, with sound from the analytic renderer.

`official` keeps only clusters larger than mean + ½ standard deviation. Of two equal clusters it keeps none and
therefore uses both, which is not a choice: it scores 0 with an invented twin. `centre` is shown for this reason.

The true boxes are used only to make candidates: points on the faces that the train cameras can see. Every case is run
with all train frames and with random subsets of them.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.files import write_bytes
from avs3d_bench.geometry import Intrinsics, Pose, flip_world
from avs3d_bench.yamlfile import parse_yaml
from baselines.echosegnet import binaural, spatial
from baselines.echosegnet.spatial import CueWeights
from baselines.echosegnet.views import RegisteredView, load_points, load_views, train_views
from generators.acoustics.analytic import AnalyticBackend
from generators.acoustics.clips import binaural_clip
from generators.assets.shapes import MeshBuilder
from generators.assets.sounds import synthesise
from generators.core.scene import Material, Part, Room, Scene

Array = NDArray[np.float64]

METHODS: dict[str, CueWeights] = {
    "spatial": CueWeights(),
    "phase alone": CueWeights(ild=0.0, level=0.0),
    "ILD alone": CueWeights(phase=0.0, level=0.0),
    "loudness alone": CueWeights(phase=0.0, ild=0.0, level=0.05),
}
DISTANCES = (0.5, 1.0, 2.0)
DIRECTIONS = 16
POINTS = 400
CATEGORIES = ("washing_machine", "toilet", "vacuum_cleaner", "microwave", "coffee_machine", "clock", "telephone")


@dataclass
class Heard:
    """The inputs in one place: train views, their sound and cues, and points of the scene for `official`."""

    key: str
    views: list[RegisteredView]
    clips: NDArray[np.float32]
    scene: Array
    cues: binaural.Cues = field(init=False)

    def __post_init__(self) -> None:
        self.cues = binaural.observe(self.clips)
        self.rotation = np.stack([v.rotation for v in self.views])
        self.position = np.stack([v.position for v in self.views])

    def subset(self, share: float, seed: int) -> NDArray[np.intp]:
        """Indices of a random share of the views, in order."""
        count = max(1, round(share * len(self.views)))
        return np.sort(np.random.default_rng(seed).choice(len(self.views), count, replace=False))


@dataclass(frozen=True)
class Case:
    """Candidates (the first is the right one), each (n, 3) in the Y-down world."""

    experiment: str
    candidates: list[Array]


def verdicts(heard: Heard, cases: list[Case], index: NDArray[np.intp]) -> Iterator[tuple[Case, str, float, float]]:
    """(case, method, right: 0 or 1, posterior of the choice) for each case and method."""
    centre = _audio_centre(heard, index)
    cues = heard.cues.select(index)
    for case in cases:
        points = np.concatenate(case.candidates)
        labels = np.repeat(np.arange(len(case.candidates)), [len(c) for c in case.candidates])
        for method, weights in METHODS.items():
            choice = spatial.judge(points, labels, heard.rotation[index], heard.position[index], cues, weights=weights)
            yield case, method, float(choice.best == 0), float(choice.posterior[choice.best])
        if centre is not None:
            gap = [np.linalg.norm((c.mean(axis=0) - centre)[[0, 2]]) for c in case.candidates]
            yield case, "centre", float(np.argmin(gap) == 0), np.nan
            yield case, "official", _official(points, labels, centre), np.nan


def _official(points: Array, labels: NDArray[np.int64], centre: Array) -> float:
    """Whether the published refinement keeps the right candidate and nothing else."""
    from baselines.echosegnet import aisrm

    chosen = aisrm.refine(
        points, centre, eps=0.3
    ).chosen  # the points are sparser than splats: a larger radius makes the same clusters
    kept = labels[chosen]
    return float(len(kept) > 0 and np.mean(kept == 0) > 0.99 and np.mean(chosen[labels == 0]) > 0.5)


def _audio_centre(heard: Heard, index: NDArray[np.intp]) -> Array | None:
    from baselines.echosegnet import aisrm

    intensity = aisrm.audio_intensity_map([heard.views[i] for i in index], heard.clips[index], heard.scene)
    return aisrm.audio_centre(heard.scene, intensity)


def visible_faces(box: Array, cameras: Array, rng: np.random.Generator) -> Array:
    """(n, 3) Y-down points on the faces of ``box`` (2, 3) by their area and the share of ``cameras`` (V, 3) in front.

    Box and cameras are in our world (Y up).
    """
    low, high = box
    size = high - low
    out = []
    total = 2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    for axis in range(3):
        for plane, sign in ((low, -1.0), (high, 1.0)):
            seen = float(np.mean((cameras[:, axis] - plane[axis]) * sign > 0))
            area = float(np.prod(np.delete(size, axis)))
            face = rng.uniform(low, high, (round(POINTS * area / total * seen), 3))
            face[:, axis] = plane[axis]
            out.append(face)
    return flip_world(np.concatenate(out))


def observed(observation: Observation) -> Heard:
    """The train views of an observation of the dataset."""
    views = list(train_views(load_views(observation)))
    scene, _ = load_points(observation)
    return Heard(observation.key, views, np.stack([v.frame.audio() for v in views]), scene)


def cases_of(observation: Observation, heard: Heard, room: Array | None) -> list[Case]:
    """The real twins and the invented ones; the latter are inside ``room`` (2, 3)."""
    record = observation.record
    assert record is not None
    cameras = flip_world(heard.position)
    boxes = [np.array(i.bounds) for i in record.instances if i.category == record.category and not i.sounding]
    box = np.array(record.sounding.bounds)
    points = visible_faces(box, cameras, np.random.default_rng(0))
    cases = []
    if boxes:
        others = [visible_faces(b, cameras, np.random.default_rng(0)) for b in boxes]
        cases.append(Case("twins", [points, *others]))
    for distance in DISTANCES:
        for turn in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            shift = distance * np.array([np.cos(turn), 0.0, np.sin(turn)])
            if _stands(box, shift, room):
                cases.append(Case(f"invented {distance:g} m", [points, points + flip_world(shift)]))
    return cases


def _stands(box: Array, shift: Array, room: Array | None) -> bool:
    apart = (np.abs(shift) >= np.ptp(box, axis=0))[[0, 2]].any()
    moved = (box + shift)[:, [0, 2]]
    inside = room is None or ((moved[0] >= room[0, [0, 2]] - 0.05) & (moved[1] <= room[1, [0, 2]] + 0.05)).all()
    return bool(apart and inside)


@cache
def rooms_of(scan: str, seed: int) -> dict[str, Array]:
    """Rooms of a procedural apartment: name → (2, 3) lowest and highest corner."""
    from generators.apartments.apartment import build_apartment

    return {room.name: np.array([room.low, room.high]) for room in build_apartment(scan, seed).rooms}


def room_of(dataset: Dataset, observation: Observation) -> Array | None:
    """Bounds of the observation's room, if its home is procedural."""
    manifest = parse_yaml(dataset.record.manifest, dataset.root) if dataset.record else {}
    spec = manifest.get("scans", {}).get(observation.place.scan, {})
    if spec.get("source") != "apartment":
        return None
    return rooms_of(observation.place.scan, spec["seed"])[observation.place.room]


def simulated(seed: int, spacing: float, count: int = 105) -> tuple[Heard, list[Case]]:
    """A box room, a walk through it and 2 to 4 candidates at least ``spacing`` metres apart."""
    rng = np.random.default_rng(seed)
    size = np.array([rng.uniform(3, 7), 2.6, rng.uniform(3, 7)])
    builder = MeshBuilder()
    builder.box(tuple(size), size / 2, Material("wall", "plaster"), acoustic="exact")
    scene = Scene("box", (Part("shell", builder.build()),), (Room("kitchen", (0.0, 0.0, 0.0), tuple(size)),), ())
    spots: list[Array] = []
    while len(spots) < 2 + seed % 3:
        spot = np.array([rng.uniform(0.3, size[0] - 0.3), rng.uniform(0.3, 1.8), rng.uniform(0.3, size[2] - 0.3)])
        if all(np.linalg.norm((spot - s)[[0, 2]]) >= spacing for s in spots):
            spots.append(spot)
    # A loop through the room with a varying gaze.
    t = np.arange(count) / count * 2 * np.pi
    reach = size[[0, 2]] / 2 - 0.8
    path = size[[0, 2]] / 2 + reach * np.stack([np.cos(t), np.sin(2 * t + rng.uniform(0, 6))], axis=1) * 0.9
    yaw = np.cumsum(rng.normal(0, 0.35, count)) + rng.uniform(0, 6)
    source = synthesise(CATEGORIES[seed % 7], count + 1.0, rng)
    backend = AnalyticBackend(absorption=float(rng.uniform(0.15, 0.45)), images=400)
    x, y, z = (float(c) for c in spots[0])
    session = backend.open(scene, (x, y, z), room="kitchen")
    views, clips = [], []
    for i in range(count):
        pose = Pose.from_yaw((path[i, 0], 1.5, path[i, 1]), yaw[i])
        flip = np.diag([1.0, -1.0, -1.0])
        position = flip_world(np.array(pose.position))
        camera = Intrinsics.from_fov(64)
        rotation = flip @ pose.rotation_matrix @ flip
        views.append(RegisteredView(f"frame_{i:03d}", "train", camera, rotation, position, None))  # type: ignore[arg-type]
        clips.append(binaural_clip(source, session.impulse_response(pose), i))
    grid = rng.uniform((0, 0, 0), size, (20000, 3))
    heard = Heard(f"room {seed}", views, np.stack(clips), flip_world(grid))
    half = np.array([0.12, 0.12, 0.12])
    boxes = [visible_faces(np.stack([s - half, s + half]), flip_world(heard.position), rng) for s in spots]
    return heard, [Case(f"simulated ≥ {spacing:g} m", boxes)]


@click.command()
@click.argument("root", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--only", multiple=True, help="Shell pattern of observation keys.")
@click.option("--rooms", default=60, show_default=True, help="Simulated rooms per spacing.")
@click.option("--subsets", default=8, show_default=True, help="Random subsets per share of the frames.")
@click.option("--json", "output", type=click.Path(path_type=Path), default=None, help="Also write the figures here.")
def main(root: Path, only: tuple[str, ...], rooms: int, subsets: int, output: Path | None) -> None:
    """Print how often each method chooses the right instance in the dataset ROOT and in simulated rooms."""
    tally: dict[tuple[str, str, str], list[tuple[str, float, float]]] = {}
    seconds: list[float] = []

    def run(make: Callable[[], tuple[Heard, list[Case]]]) -> None:
        heard, cases = make()
        start = time.perf_counter()
        case = cases[0]
        labels = np.repeat(np.arange(len(case.candidates)), [len(c) for c in case.candidates])
        spatial.choose(np.concatenate(case.candidates), labels, heard.views, heard.clips)
        seconds.append(time.perf_counter() - start)
        for share in (1.0, 0.5, 0.25):
            for seed in range(1 if share == 1.0 else subsets):
                # The results differ little between subsets, so the many invented twins are run with only two.
                some = [c for c in cases if seed < 2 or not c.experiment.startswith("invented")]
                for case, method, right, posterior in verdicts(heard, some, heard.subset(share, seed)):
                    key = (case.experiment, f"{share:.0%}", method)
                    tally.setdefault(key, []).append((heard.key, right, posterior))

    dataset = Dataset(root)
    for observation in dataset.select(*only):
        if observation.record is not None:

            def of_dataset(observation: Observation = observation) -> tuple[Heard, list[Case]]:
                heard = observed(observation)
                return heard, cases_of(observation, heard, room_of(dataset, observation))

            run(of_dataset)
    for spacing in (0.5, 1.0):
        for seed in range(rooms):
            run(lambda seed=seed, spacing=spacing: simulated(seed, spacing))  # type: ignore[misc]
    report(tally, seconds, output)


def report(
    tally: dict[tuple[str, str, str], list[tuple[str, float, float]]], seconds: list[float], output: Path | None
) -> None:
    """Print the tables; write the JSON."""
    methods = [m for m in ("official", "centre", *METHODS) if any(key[2] == m for key in tally)]
    table = Table("experiment", "frames", "cases", *methods, title="right instance chosen (%)")
    for experiment, share in sorted({key[:2] for key in tally}, key=lambda k: (k[0], -float(k[1][:-1]))):
        cells = [[right for _, right, _ in tally.get((experiment, share, m), [])] for m in methods]
        figures = [f"{100 * np.mean(cell):.1f}" if cell else "" for cell in cells]
        table.add_row(experiment, share, str(len(tally[experiment, share, "spatial"])), *figures)
    Console(width=150).print(table)
    sure = [(p, r) for key, rows in tally.items() if key[2] == "spatial" for _, r, p in rows]
    for low, high in ((0.0, 0.7), (0.7, 0.9), (0.9, 0.99), (0.99, 1.01)):
        part = [r for p, r in sure if low <= p < high]
        if part:
            print(f"posterior {low:.2f} to {min(high, 1):.2f}: right in {100 * np.mean(part):.1f} % of {len(part)}")
    wrong: dict[str, int] = {}
    for (experiment, share, method), rows in tally.items():
        if method == "spatial" and share == "100%":
            for place, right, _ in rows:
                if not right:
                    wrong[f"{experiment}, {place}"] = wrong.get(f"{experiment}, {place}", 0) + 1
    for name, count in sorted(wrong.items()):
        print(f"wrong with all frames: {name}: {count}")
    print(f"spatial.choose: median {np.median(seconds):.2f} s, at most {max(seconds):.2f} s")
    if output:
        rates = {
            " | ".join(key): {"cases": len(rows), "right": float(np.mean([r for _, r, _ in rows]))}
            for key, rows in tally.items()
        }
        document = {
            "rates": rates,
            "wrong": wrong,
            "seconds": {"median": float(np.median(seconds)), "max": max(seconds)},
        }
        write_bytes(output, f"{json.dumps(document, indent=1)}\n".encode())


if __name__ == "__main__":
    main()
