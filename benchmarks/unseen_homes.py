"""`python -m benchmarks.unseen_homes -o FILE`: a manifest of plausible observations in homes that no manifest uses.

The random draws (homes, rooms, categories, counts, silent objects) depend only on the seed. In part_1, the sounding
category is drawn uniformly among those in the room; in part_2 the room has several instances of one model. With
``--check`` (the default of the command), an observation that does not fit into its room is replaced by another.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import click
import numpy as np
import yaml

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.yamlfile import read_yaml
from generators.apartments.apartment import build_apartment
from generators.core.folders import default_cache
from generators.core.scene import Scene
from generators.homes.store import open_home
from generators.observation.arrangement import arrange
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest

MANIFESTS = Path(__file__).parent.parent / "scenes_manifest"
PARTS = ("part_1", "part_2")
#: Categories of each room, with their largest number of instances in part_2.
ROOMS: dict[str, dict[str, int]] = {
    "bathroom": {"washing_machine": 2, "toilet": 2},
    "kitchen": {"microwave": 3, "coffee_machine": 3, "clock": 4},
    "living_room": {"telephone": 3, "clock": 4, "vacuum_cleaner": 3},
}
#: Distractors, which look similar and never sound, and the probability that one is in the room.
LOOK_ALIKES, LOOK_ALIKE_SHARE = {"kitchen": "oven"}, 0.5
#: Probability of a silent object of another category in part_2.
SILENT_SHARE = 0.4
#: Range of the seeds of homes; the seeds in committed manifests are smaller.
SEEDS = (1_000, 1_000_000)


@lru_cache(maxsize=1)
def used_seeds() -> frozenset[int]:
    """Seeds of the homes of all committed manifests."""
    documents = [read_yaml(path)[0] for path in MANIFESTS.glob("*.yaml")]
    return frozenset(scan["seed"] for d in documents for scan in (d.get("scans") or {}).values() if "seed" in scan)


def sample_homes(homes: int, seed: int) -> dict[str, dict[str, Any]]:
    """``scans`` of a manifest: home_1, home_2, … with seeds that no committed manifest uses."""
    rng, taken = np.random.default_rng([seed, 1]), set(used_seeds())
    scans: dict[str, dict[str, Any]] = {}
    while len(scans) < homes:
        drawn = int(rng.integers(*SEEDS))
        if drawn not in taken:
            taken.add(drawn)
            scans[f"home_{len(scans) + 1}"] = {"source": "apartment", "seed": drawn}
    return scans


def draw_entries(home: str, parts: Sequence[str], seed: int) -> Iterator[dict[str, Any]]:
    """Infinite sequence of a manifest's entries for one home, alternating the parts; indices increase within a room."""
    number = int(home.removeprefix("home_"))
    rng = np.random.default_rng([seed, 2, number])
    counts: dict[tuple[str, str], int] = {}
    turn = number
    while True:
        part = parts[turn % len(parts)]
        turn += 1
        room = str(rng.choice(list(ROOMS)))
        known = list(ROOMS[room])
        category = str(rng.choice(known))
        others = [str(name) for name in rng.permutation([name for name in known if name != category])]
        entry: dict[str, Any] = {"part": part, "scan": home, "room": room, "category": category}
        if part == "part_2":
            entry["instances"] = int(rng.integers(2, ROOMS[room][category] + 1))
            silent = others[: int(rng.uniform() < SILENT_SHARE)]
        else:
            silent = others[: int(rng.integers(1, len(others) + 1))]
        if room in LOOK_ALIKES and rng.uniform() < LOOK_ALIKE_SHARE:
            silent.append(LOOK_ALIKES[room])
        counts[part, room] = counts.get((part, room), 0) + 1
        yield entry | {"index": counts[part, room], "silent": silent}


def sample_manifest(
    homes: int, observations: int, seed: int, *, parts: Sequence[str] = PARTS, check: bool = False, **camera: Any
) -> dict[str, Any]:
    """A manifest document.

    Args:
        homes: number of homes.
        observations: number of observations, spread evenly over the homes.
        seed: seed of the random draws, and of the manifest.
        parts: the parts to use.
        check: replace observations for which placement or walk fails (takes seconds per observation).
        camera: fields of the manifest's ``camera`` that differ from the usual ones.
    """
    usual = {"size": 1008, "hfov": 90.0, "height": 1.5, "frames": 120}
    document: dict[str, Any] = {
        "name": f"unseen-homes-{seed}",
        "version": "2.0.0",
        "seed": seed,
        "camera": usual | camera,
        "scans": sample_homes(homes, seed),
        "observations": [],
    }
    for number, home in enumerate(document["scans"]):
        wanted = (number + 1) * observations // homes - number * observations // homes
        for entry in draw_entries(home, parts, seed):
            if wanted == 0:
                break
            if entry["index"] > 99:
                raise Avs3dError(f"{home}: no room for more observations; ask for more homes")
            if not check or is_plannable(document, entry):
                document["observations"].append(entry)
                wanted -= 1
    return document


def plans_of(document: dict[str, Any]) -> list[ObservationPlan]:
    """The plans of a manifest document."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "manifest.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return list(make_plans(read_manifest(path), GenerateOptions(audio="analytic")))


@lru_cache(maxsize=1)
def unlit_home(name: str, seed: int, plain: bool) -> Scene:
    """A home without its light, which placement and walk do not need; nor do they need its materials."""
    return build_apartment(name, seed, plain=plain)


def home_of(plan: ObservationPlan, *, plain: bool = False) -> Scene:
    """The plan's home without its light and, if ``plain``, without its materials; a scan as it is."""
    if plan.scan.source == "scan":
        return open_home(plan, default_cache())
    assert plan.scan.seed is not None
    return unlit_home(plan.spec.scan, plan.scan.seed, plain)


def is_plannable(document: dict[str, Any], entry: dict[str, Any]) -> bool:
    """Whether the room is large enough for an observation's objects and its walk."""
    (plan,) = plans_of(document | {"observations": [entry]})
    try:
        arrange(plan, home_of(plan, plain=True))
    except Avs3dError:
        return False
    return True


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="The manifest to write.")
@click.option("--homes", default=12, show_default=True, type=click.IntRange(1))
@click.option("--observations", default=36, show_default=True, type=click.IntRange(1))
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0))
@click.option("--parts", multiple=True, type=click.Choice(PARTS), default=PARTS, show_default=True)
@click.option(
    "--check/--no-check", default=True, show_default=True, help="Replace observations that do not fit into their room."
)
def main(output: Path, homes: int, observations: int, seed: int, parts: tuple[str, ...], check: bool) -> None:
    """Write a manifest of OBSERVATIONS observations in HOMES homes that no committed manifest uses."""
    document = sample_manifest(homes, observations, seed, parts=parts, check=check)
    command = f"python -m benchmarks.unseen_homes {' '.join(sys.argv[1:])}"
    output.write_text(f"# {command}\n{yaml.safe_dump(document, sort_keys=False)}")
    print(f"{output}: {len(document['observations'])} observations in {len(document['scans'])} homes")


if __name__ == "__main__":
    main()
