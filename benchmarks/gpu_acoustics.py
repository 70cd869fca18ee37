"""Compares the tracer's responses on a CUDA device with those of the CPU: directivities, heads and other receivers.

    python -m benchmarks.gpu_acoustics [--device cuda] [--json FILE]

Two rooms (a box, and one with a partition and a table), sources without a directivity, with a cardioid that is turned,
and with a table, and every kind of receiver. Prints one line per case: the energy of the difference relative to the
response (dB) and the largest difference of the level of a channel (dB). Exits with 1 if one is beyond `MOST_DB` or
`MOST_LEVEL_DB`. ``--device cpu`` compares the CPU with itself, which tries the script where there is no device. Needs
numpy, scipy, numba, trimesh and numba-cuda, no torch.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from avs3d_bench.errors import Avs3dError
from generators import acoustics
from generators.acoustics.heads import draw_head
from generators.acoustics.tracer.receivers.parametric import parametric_head

#: Largest energy of the difference relative to the response (dB): operations are fused on a device, and an arrival on
#: the border between two directions of a tabulated head may take the other one.
MOST_DB = -60.0
#: Largest difference of the level of a channel (dB).
MOST_LEVEL_DB = 0.01
RATE = 16_000
SOURCE, YAW = (-1.5, 0.1, 0.3), 0.7
LISTENERS = (
    acoustics.Pose.from_yaw((1.5, -0.2, -1.1), 0.4),
    acoustics.Pose.from_yaw((1.2, 0.3, 1.4), -2.0),
    acoustics.Pose.from_yaw((-1.2, 0.1, 0.4), 1.0),
)


def rooms() -> dict[str, acoustics.Room]:
    """A box, and one with a partition and a table, both about the origin."""
    box: Any = trimesh.creation.box((5.0, 2.5, 4.0))
    table, partition = trimesh.creation.box((1.0, 0.05, 1.5)), trimesh.creation.box((0.1, 2.5, 2.4))
    table.apply_translation((0.4, -0.4, 0.2))
    partition.apply_translation((0.9, 0.0, -0.8))
    furnished: Any = trimesh.util.concatenate([box, table, partition])
    return {
        name: acoustics.Room.from_mesh(mesh, {"*": "plaster"}, labels=["wall"] * len(mesh.faces))
        for name, mesh in (("box", box), ("furnished", furnished))
    }


def directivities() -> dict[str, acoustics.Directivity | None]:
    """None, a cardioid upwards, and a table whose octaves differ."""
    azimuths, elevations = np.arange(-180.0, 180.0, 30.0), np.array([-45.0, 0.0, 45.0])
    ahead = np.cos(np.radians(azimuths))[:, None] * np.cos(np.radians(elevations))
    table = [(0.6 + 0.4 * ahead) ** order for order in range(6)]
    return {
        "omni": None,
        "cardioid": acoustics.Directivity.cardioid(2, (0.0, 1.0, 1.0)),
        "table": acoustics.Directivity.table(table, azimuths, elevations),
    }


def receivers() -> dict[str, Any]:
    """Every kind of receiver that a CUDA device hears; spheres of other sizes are refused there."""
    family = parametric_head(draw_head("train", np.random.default_rng(1)))
    return {
        "sphere": acoustics.SphericalHead(),
        "head of the family": family,
        "ambisonics 1": acoustics.Ambisonics(1),
        "ambisonics 3": acoustics.Ambisonics(3),
        "omni": acoustics.Omni(),
        "array": acoustics.Array([(0.0, 0.0, 0.0), (0.08, 0.0, 0.0)]),
    }


def compared(device: str) -> Iterator[dict[str, Any]]:
    """One record per room, directivity and receiver; the worst of all listeners."""
    cpu, other = acoustics.Tracer(seed=1), acoustics.Tracer(seed=1, device=device)
    for (place, room), (kind, directivity), (name, receiver) in (
        (r, d, h) for r in rooms().items() for d in directivities().items() for h in receivers().items()
    ):
        asked: dict[str, Any] = {"receiver": receiver, "directivity": directivity, "sample_rate": RATE}
        sources = [acoustics.Pose.from_yaw(SOURCE, YAW)]
        pairs = zip(*(engine.responses(room, sources, LISTENERS, **asked) for engine in (cpu, other)), strict=True)
        worst, level = -np.inf, 0.0
        for expected, found in pairs:
            length = min(expected.samples.shape[1], found.samples.shape[1])
            a, b = (each.samples[:, :length].astype(np.float64) for each in (expected, found))
            lost = sum(float(np.square(each.samples[:, length:]).sum()) for each in (expected, found))
            difference = float(np.square(a - b).sum()) + lost
            worst = max(worst, 10 * float(np.log10(max(difference, 1e-300) / np.square(a).sum())))
            level = max(level, float(np.abs(10 * np.log10(np.square(b).sum(axis=1) / np.square(a).sum(axis=1))).max()))
        yield {
            "room": place,
            "directivity": kind,
            "receiver": name,
            "difference_db": round(worst, 1),
            "level_db": round(level, 5),
            "agrees": worst <= MOST_DB and level <= MOST_LEVEL_DB,
        }


def main() -> int:
    """Compare, print, and say whether all agree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda", choices=("cuda", "cpu"))
    parser.add_argument("--json", type=Path, help="also write the records here")
    given = parser.parse_args()
    records = []
    try:
        for record in compared(given.device):
            records.append(record)
            case = f"{record['room']:10} {record['directivity']:9} {record['receiver']:19}"
            figures = f"{record['difference_db']:8.1f} dB {record['level_db']:9.5f} dB"
            print(case, figures, "" if record["agrees"] else "DIFFERS", flush=True)
    except Avs3dError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    if given.json is not None:
        given.json.write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    wrong = sum(not record["agrees"] for record in records)
    print(f"{len(records)} cases, {wrong} beyond {MOST_DB:g} dB or {MOST_LEVEL_DB:g} dB of level")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
