"""`python -m benchmarks.acoustic_agreement`: the tracer beside SoundSpaces' engine in all rooms of the open benchmark.

    python -m benchmarks.acoustic_agreement [--poses 12] [--workers 2] [--only '*/apartment_1/*'] [-o build/agreement]

Homes, objects, source positions and listeners are those of scenes_manifest/open-s34-o7.yaml; the poses are evenly
spread over each walk. Both engines compute the same poses, with a head and with an omnidirectional listener, which
leaves out that the two have different heads. One file per observation below the output folder: a run that was stopped
continues, and a run with other settings starts again. Prints the tables and writes agreement.json and agreement.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__
from avs3d_bench.formats.files import read_json, write_bytes, write_json
from avs3d_bench.geometry import direction_to
from benchmarks.acoustic_measures import ENGINES, OCTAVES, decibels, head_levels, measure, responses
from benchmarks.unseen_homes import home_of
from generators.acoustics.direct import DirectPath
from generators.acoustics.materials import material_for, spectral_label
from generators.core.scene import Part, Scene
from generators.observation.arrangement import arrange, draw_sounding
from generators.options import GenerateOptions
from generators.paths.watcher import line_of_sight
from generators.plan import ObservationPlan, make_plans, read_manifest
from generators.scenes.placed import PlacedScene

F64 = NDArray[np.float64]

MANIFEST = Path(__file__).parent.parent / "scenes_manifest" / "open-s34-o7.yaml"
#: The bars: mean over a room's poses of the difference of levels and of direct-to-reverberant ratios (dB), of T30 (%);
#: share of poses in line of sight whose interaural level difference has the same sign (%).
LEVEL, DRR, T30, SIGN = 1.0, 1.5, 10.0, 99.0
#: Interaural level differences below this (dB) have no sign that could be heard: the just noticeable difference.
AUDIBLE_ILD = 1.0


def even_surfaces(scene: Scene) -> Scene:
    """The scene with surfaces that scatter all that they reflect and absorb alike in all octaves, as on their mean."""

    def label(name: str) -> str:
        mean = float(np.mean(material_for(name).in_situ))
        return spectral_label((mean,) * len(OCTAVES), (1.0,) * len(OCTAVES))  # type: ignore[arg-type]

    def part(one: Part) -> Part:
        known = {name: label(name) for name in set(one.mesh.acoustic_labels)}
        return replace(one, mesh=replace(one.mesh, acoustic_labels=tuple(known[n] for n in one.mesh.acoustic_labels)))

    return replace(scene, parts=tuple(part(one) for one in scene.parts))


def observe(plan: ObservationPlan, poses: int, even: bool) -> dict[str, Any]:
    """Both engines at ``poses`` poses of one observation; ``even``: with `even_surfaces`."""
    home = home_of(plan).for_room(plan.spec.room)
    seen = arrange(plan, home)
    stage = PlacedScene(home, seen.placements, seen.motions)
    source = stage.placement(draw_sounding(plan, seen.placements), 0)
    scene = even_surfaces(stage.scene(0)) if even else stage.scene(0)
    chosen = [seen.poses[k] for k in np.unique(np.linspace(0, len(seen.poses) - 1, poses).round().astype(int))]
    path = DirectPath(scene, source.source_position)
    rows: list[dict[str, Any]] = []
    for pose in chosen:
        metres = math.dist(pose.position, source.source_position)
        row: dict[str, Any] = {"distance": metres, "azimuth": direction_to(pose, source.source_position).azimuth}
        sight = line_of_sight(stage.caster, pose, source)
        rows.append(row | {"free": path.is_free(pose), "sight": sight})
    for engine in ENGINES:
        found = responses(engine, scene, source.source_position, plan.spec.room, chosen)
        for row, (head, omni) in zip(rows, found, strict=True):
            distance: float | None = row["distance"] if row["free"] else None
            assert head is not None
            row[engine] = {"head": asdict(measure(head, distance)), "omni": asdict(measure(omni, distance))}
    return {"key": plan.key, "room": f"{plan.spec.scan}/{plan.spec.room}", "poses": rows}


class Rows:
    """The poses of a room, or of all.

    Args:
        poses: as `observe` returns them.
        heads: `head_levels` per engine.
    """

    def __init__(self, poses: Sequence[dict[str, Any]], heads: dict[str, dict[str, list[float]]]) -> None:
        self._poses, self._heads = poses, heads

    def _both(self, value: Callable[[dict[str, Any]], Any], what: str, keep: str | None = None) -> F64:
        """(2, poses, …) a value of each engine's figures, for the poses that have the mark ``keep``."""
        chosen = [pose for pose in self._poses if keep is None or pose[keep]]
        return np.array([[value(pose[engine][what]) for pose in chosen] for engine in ENGINES], dtype=np.float64)

    def _difference(self, name: str, what: str, keep: str | None = None) -> F64:
        """(poses, 6) difference of the level of ``energy``, ``direct`` or ``late`` sound in each octave, dB."""
        tracer, other = decibels(self._both(lambda found: np.mean(found[name], axis=0), what, keep))
        return np.asarray(tracer - other)

    def levels(self, what: str) -> F64:
        """(poses, 6) difference of the level in each octave, dB; ``head``: without the levels of the two heads."""
        difference = self._difference("energy", what)
        if what == "head":
            own = [np.array(self._heads[engine]["octaves"]) for engine in ENGINES]
            difference -= own[0] - own[1]
        return difference

    def white_levels(self) -> F64:
        """(poses,) difference of the level of white noise at the ears, as it is, dB."""
        tracer, other = decibels(self._both(lambda found: np.mean(found["white"]), "head"))
        return np.asarray(tracer - other)

    def ratios(self, what: str) -> F64:
        """(poses, 6) difference of the direct-to-reverberant ratio in each octave, dB; poses with a free path."""
        return self._difference("direct", what, "free") - self._difference("late", what, "free")

    def part(self, name: str) -> F64:
        """(poses, 6) difference of the level of ``direct`` or ``late`` sound per octave, dB; poses with a free path."""
        return self._difference(name, "omni", "free")

    def decay(self, what: str) -> F64:
        """(2, 6) mean T30 in each octave, s."""
        return np.asarray(np.nanmean(self._both(lambda found: np.array(found["t30"], dtype=float), what), axis=(1, 2)))

    def _ild(self) -> F64:
        """(2, poses) interaural level difference, left over right, dB; poses in line of sight."""
        left, right = np.moveaxis(self._both(lambda found: found["white"], "head", "sight"), 2, 0)
        return decibels(left / right)

    def signs(self, least: float = 0.0) -> tuple[int, int]:
        """Poses in line of sight where one engine has an ILD of ``least`` dB or more; those with the same sign."""
        ild = self._ild()
        clear = np.any(np.abs(ild) >= least, axis=0)
        return int(clear.sum()), int((np.sign(ild[0]) == np.sign(ild[1]))[clear].sum())

    def sides(self) -> tuple[int, int, int]:
        """Of the poses where the signs differ: their number, and those where each engine has the source's side."""
        ild = self._ild()
        azimuth = np.array([pose["azimuth"] for pose in self._poses if pose["sight"]])
        differ = np.sign(ild[0]) != np.sign(ild[1])
        right = [int((np.sign(-azimuth) == np.sign(one))[differ].sum()) for one in ild]
        return int(differ.sum()), right[0], right[1]

    def largest_opposite(self) -> float:
        """The largest ILD (dB) of either engine at a pose in line of sight where the other has another sign."""
        ild = self._ild()
        differ = np.sign(ild[0]) != np.sign(ild[1])
        return float(np.abs(ild[:, differ]).max(initial=0.0))


def summarise(observations: Sequence[dict[str, Any]], heads: dict[str, Any]) -> dict[str, Any]:
    """The table: one row per room, and the bars over all rooms."""
    rooms: dict[str, list[dict[str, Any]]] = {}
    for observation in observations:
        rooms.setdefault(observation["room"], []).extend(observation["poses"])
    table = {}
    for name, poses in sorted(rooms.items()):
        rows = Rows(poses, heads)
        decay, ears = rows.decay("omni"), rows.decay("head")
        table[name] = {
            "poses": len(poses),
            "level, white noise at the ears (dB)": float(rows.white_levels().mean()),
            "level at the ears without the heads' own (dB)": float(rows.levels("head").mean()),
            "level (dB)": float(rows.levels("omni").mean()),
            "level per octave (dB)": rows.levels("omni").mean(axis=0).tolist(),
            "DRR at the ears (dB)": float(rows.ratios("head").mean()),
            "DRR (dB)": float(rows.ratios("omni").mean()),
            "DRR per octave (dB)": rows.ratios("omni").mean(axis=0).tolist(),
            "up to 2 ms per octave (dB)": rows.part("direct").mean(axis=0).tolist(),
            "after 2 ms (dB)": float(rows.part("late").mean()),
            "T30 of the tracer (s)": decay[0].tolist(),
            "T30 of SoundSpaces (s)": decay[1].tolist(),
            "T30 (%)": (100 * (decay[0] / decay[1] - 1)).tolist(),
            "T30 at the ears (%)": (100 * (ears[0] / ears[1] - 1)).tolist(),
            "in line of sight, same sign of ILD": rows.signs(),
            "of these, audible": rows.signs(AUDIBLE_ILD),
        }
    every = Rows([pose for poses in rooms.values() for pose in poses], heads)
    values = list(table.values())
    return {
        "version": __version__,
        "heads (dB)": heads,
        "rooms": table,
        "all": {
            "poses": sum(row["poses"] for row in values),
            "level (dB)": _spread([row["level (dB)"] for row in values]),
            "level at the ears without the heads' own (dB)": _spread(
                [row["level at the ears without the heads' own (dB)"] for row in values]
            ),
            "level, white noise at the ears (dB)": _spread(
                [row["level, white noise at the ears (dB)"] for row in values]
            ),
            "DRR (dB)": _spread([row["DRR (dB)"] for row in values]),
            "DRR at the ears (dB)": _spread([row["DRR at the ears (dB)"] for row in values]),
            "up to 2 ms (dB)": _per_octave([row["up to 2 ms per octave (dB)"] for row in values]),
            "after 2 ms (dB)": _spread([row["after 2 ms (dB)"] for row in values]),
            "T30 (%)": _per_octave([row["T30 (%)"] for row in values]),
            "in line of sight, same sign of ILD": every.signs(),
            "of these, audible": every.signs(AUDIBLE_ILD),
            "signs that differ; the source's side in the tracer, in SoundSpaces": every.sides(),
            "largest ILD with the other sign (dB)": every.largest_opposite(),
        },
        "rooms within the bars": {
            f"level ±{LEVEL:g} dB": sum(abs(row["level (dB)"]) <= LEVEL for row in values),
            f"DRR ±{DRR:g} dB": sum(abs(row["DRR (dB)"]) <= DRR for row in values),
            f"T30 ±{T30:g} % in every octave": sum(max(map(abs, row["T30 (%)"])) <= T30 for row in values),
            "of": len(values),
        },
    }


def _spread(values: list[float]) -> dict[str, float]:
    return {"least": min(values), "median": float(np.median(values)), "most": max(values)}


def _per_octave(rooms: list[list[float]]) -> dict[str, dict[str, float]]:
    return {str(band): _spread([room[k] for room in rooms]) for k, band in enumerate(OCTAVES)}


def markdown(summary: dict[str, Any]) -> str:
    """The summary as two tables: tracer minus SoundSpaces."""
    head = ["room", "poses", "level, dB", "DRR, dB", *(f"T30 {band} Hz, %" for band in OCTAVES), "ILD sign"]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for name, row in summary["rooms"].items():
        seen, same = row["in line of sight, same sign of ILD"]
        cells = [name, str(row["poses"]), f"{row['level (dB)']:+.1f}", f"{row['DRR (dB)']:+.1f}"]
        cells += [f"{value:+.0f}" for value in row["T30 (%)"]]
        lines.append(f"| {' | '.join([*cells, f'{same} of {seen}'])} |")
    lines += ["", "| all rooms | least | median | most |", "|---|---|---|---|"]
    for name, value in summary["all"].items():
        if not isinstance(value, dict):
            continue
        rows = [("", value)] if "median" in value else value.items()
        for band, spread in rows:
            title = f"{name}{f', {band} Hz' if band else ''}"
            lines.append(f"| {title} | {spread['least']:+.1f} | {spread['median']:+.1f} | {spread['most']:+.1f} |")
    seen, same = summary["all"]["in line of sight, same sign of ILD"]
    audible, alike = summary["all"]["of these, audible"]
    lines += ["", f"Same sign of ILD in line of sight: {same} of {seen} poses ({100 * same / max(seen, 1):.1f} %)"]
    lines += [f"{AUDIBLE_ILD:g} dB or more in either: {alike} of {audible} ({100 * alike / max(audible, 1):.1f} %)"]
    number, mine, other = summary["all"]["signs that differ; the source's side in the tracer, in SoundSpaces"]
    lines += [
        f"Where signs differ ({number}), it is the source's side in the tracer {mine}, in SoundSpaces {other} times"
    ]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Settings:
    """Settings of a run; files of other settings are regenerated.

    Attributes:
        poses: of each observation.
        even: whether `even_surfaces` replace those of the home.
        version: of the package.
    """

    poses: int
    even: bool
    version: str = __version__


def _work(plan: ObservationPlan, settings: Settings, path: Path) -> str:
    write_json(path, {"settings": asdict(settings)} | observe(plan, settings.poses, settings.even))
    return plan.key


def _is_made(path: Path, settings: Settings) -> bool:
    return path.exists() and read_json(path)["settings"] == asdict(settings)


def run(plans: Sequence[ObservationPlan], settings: Settings, workers: int, folder: Path) -> Iterator[dict[str, Any]]:
    """Measure what is missing, ``workers`` at a time, and return all in the order of ``plans``."""
    files = {plan.key: folder / "observations" / f"{plan.key.replace('/', '_')}.json" for plan in plans}
    missing = [plan for plan in plans if not _is_made(files[plan.key], settings)]
    missing.sort(key=lambda plan: plan.spec.scan)  # a process keeps its last home
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(_work, plan, settings, files[plan.key]) for plan in missing]
        for number, job in enumerate(as_completed(jobs), start=1):
            click.echo(f"{number}/{len(jobs)} {job.result()}", err=True)
    for plan in plans:
        yield read_json(files[plan.key])


@click.command()
@click.option("--poses", default=12, show_default=True, type=click.IntRange(1), help="Poses of each observation.")
@click.option("--workers", default=2, show_default=True, type=click.IntRange(1), help="Number of processes.")
@click.option("--only", multiple=True, help="Shell pattern of observation keys.")
@click.option("--even", is_flag=True, help="Surfaces that scatter all and absorb alike in all octaves: an experiment.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("build/agreement"), show_default=True)
def main(poses: int, workers: int, only: tuple[str, ...], even: bool, output: Path) -> None:
    """Compare the engines, print the tables, and write them below OUTPUT."""
    plans = make_plans(read_manifest(MANIFEST), GenerateOptions(audio="analytic", only=only))
    found = list(run(plans, Settings(poses, even), workers, output))
    summary = summarise(found, {engine: head_levels(engine) for engine in ENGINES})
    write_json(output / "agreement.json", summary)
    write_bytes(output / "agreement.md", markdown(summary).encode())
    click.echo(markdown(summary))
    click.echo(json.dumps(summary["rooms within the bars"]))


if __name__ == "__main__":
    main()
