"""`python -m benchmarks.room_objects`: how many objects the rooms of apartments have.

An object is a part of the home that belongs to a room: a piece of furniture, a lamp, a towel, a mug. Things that are
modelled into a piece of furniture (the books on a shelf) count with it, as one. For comparison, SceneSmith (ICML 2026)
reports 71 objects a room.

    python -m benchmarks.room_objects --homes 6 -o docs/results/room-objects.json

Three seconds per home on one core: geometry does not depend on materials, which are not made.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np

from avs3d_bench.formats.files import write_json
from generators.apartments.apartment import build_apartment
from generators.core.scene import Scene

HOMES = 6


@dataclass(frozen=True)
class RoomObjects:
    """What a room has.

    Attributes:
        room: its type.
        objects: number of its parts, its shell aside.
        kinds: number of different kinds among them.
        triangles: of these parts.
        acoustic_triangles: of their acoustic twins.
    """

    room: str
    objects: int
    kinds: int
    triangles: int
    acoustic_triangles: int


def count_objects(home: Scene) -> list[RoomObjects]:
    """The objects of every room of a home, in the order of its rooms."""
    out = []
    for room in home.rooms:
        parts = [part for part in home.parts if part.name.startswith(f"{room.name}/")]
        kinds = {part.name.rpartition("_")[0] or part.name for part in parts}
        faces = sum(len(part.mesh.positions) for part in parts)
        heard = sum(len(part.mesh.acoustic_positions) for part in parts)
        out.append(RoomObjects(room.name, len(parts), len(kinds), faces, heard))
    return out


def table(counted: list[RoomObjects]) -> str:
    """A Markdown table: one line per type of room, means over the homes."""
    rooms: dict[str, list[RoomObjects]] = defaultdict(list)
    for one in counted:
        rooms[one.room].append(one)
    lines = ["| room | rooms | objects (least–most) | kinds | triangles | acoustic triangles |", "|---" * 6 + "|"]
    for name, own in rooms.items():
        objects = [one.objects for one in own]
        mean = {
            key: np.mean([getattr(one, key) for one in own]) for key in ("kinds", "triangles", "acoustic_triangles")
        }
        lines.append(
            f"| {name} | {len(own)} | {np.mean(objects):.1f} ({min(objects)}–{max(objects)}) | {mean['kinds']:.1f}"
            f" | {mean['triangles']:,.0f} | {mean['acoustic_triangles']:,.0f} |"
        )
    return "\n".join(lines)


@click.command()
@click.option("--homes", type=click.IntRange(min=1), default=HOMES, show_default=True, help="Seeds 0, 1, 2, …")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="A JSON file with the counts of every room.")
def main(homes: int, output: Path | None) -> None:
    """Count the objects of every room of some homes."""
    counted = [one for seed in range(homes) for one in count_objects(build_apartment(f"seed_{seed}", seed, plain=True))]
    if output is not None:
        write_json(output, {"homes": homes, "rooms": [asdict(one) for one in counted]})
    click.echo(table(counted))


if __name__ == "__main__":
    main()
