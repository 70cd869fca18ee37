"""What a path-traced frame costs, whether its bytes repeat, and how much noise is left.

    python -m benchmarks.pathtraced_cost part_2/apartment_2/kitchen/1 -o build/cost --json build/cost.json

Renders frames of an observation of the open benchmark as `generators.vision.pathtraced` does, and measures the seconds
of opening the scene, of the first frame (which records and compiles the programs) and of each other frame: of the
clock and of this process's CPU, of which `labels` is what the ids, depth and windows take while the device follows the
paths. From these follow the hours of 34 observations of 120 frames. Noise is what differs between two pictures with
other random numbers: the camera is moved by a thousandth of a millimetre. The first frame is rendered once more in a
session of its own: it must have the same bytes. A picture is cut out at full size, to look at.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.light_reference import prepared_room
from generators.core.folders import default_cache
from generators.vision.embree import EmbreeBackend
from generators.vision.pathtraced import SAMPLES, PathtracedBackend

#: Of the open benchmark.
OBSERVATIONS, FRAMES = 34, 120
#: How far a camera is moved for other random numbers (m): far less than a pixel.
_ASIDE = 1e-6


class Clock:
    """Seconds since its start: of the clock, and of the CPU in this process."""

    def __init__(self) -> None:
        self._start = time.perf_counter(), time.process_time()

    def seconds(self) -> dict[str, float]:
        """Both."""
        wall, cpu = time.perf_counter() - self._start[0], time.process_time() - self._start[1]
        return {"wall": round(wall, 3), "cpu": round(cpu, 3)}


def noise(first: np.ndarray, second: np.ndarray) -> dict[str, float]:
    """Noise of one of two pictures (H, W, 3) uint8 that differ by noise alone, in steps of 8 bits.

    Returns:
        ``rms`` over all pixels and channels, its ``median`` over squares of 16 × 16 pixels, and the ``p99`` of these.
    """
    difference = (first.astype(np.float64) - second.astype(np.float64)) / np.sqrt(2)
    rows, columns = (side // 16 for side in first.shape[:2])
    squares = difference[: rows * 16, : columns * 16].reshape(rows, 16, columns, 16, 3)
    each = np.sqrt((squares**2).mean(axis=(1, 3, 4)))
    return {
        "rms": round(float(np.sqrt((difference**2).mean())), 3),
        "median": round(float(np.median(each)), 3),
        "p99": round(float(np.quantile(each, 0.99)), 3),
    }


def measure(key: str, frames: int, size: int, crop: Path) -> dict[str, Any]:
    """Render ``frames`` frames of an observation, and what they cost."""
    scene, room, poses = prepared_room(key, default_cache(), matte=False)
    scene, camera, backend = scene.for_room(room), Intrinsics.from_fov(size), PathtracedBackend()
    backend.warm_up()
    chosen = [poses[index] for index in np.linspace(0, len(poses) - 1, frames + 1).astype(int)]
    clock = Clock()
    session = backend.open(scene, camera)
    opened, clock = clock.seconds(), Clock()
    first = session.render(chosen[0])
    compiled, each = clock.seconds(), []
    for pose in chosen[1:]:
        clock = Clock()
        session.render(pose)
        each.append(clock.seconds())
    place = chosen[0].position
    aside = session.render(Pose((place[0] + _ASIDE, *place[1:]), chosen[0].rotation))
    session.close()
    again = backend.open(scene, camera).render(chosen[0])
    middle, half = size // 2, min(504, size) // 2
    part = slice(middle - half, middle + half)
    cv2.imwrite(str(crop), np.ascontiguousarray(first.rgb[part, part, ::-1]))
    labels = EmbreeBackend().open(scene, camera)
    clock = Clock()
    for pose in chosen[1:5]:
        labels.render(pose)
    shot = clock.seconds()
    frame = {kind: float(np.median([one[kind] for one in each])) for kind in ("wall", "cpu")}
    once = {kind: opened[kind] + compiled[kind] - frame[kind] for kind in frame}
    return {
        "observation": key, "renderer": backend.version, "size": size, "samples": SAMPLES,
        "open": opened, "first frame": compiled, "frame": frame, "frames": each,
        "labels": {kind: round(value / len(chosen[1:5]), 3) for kind, value in shot.items()},
        "hours of 34 observations": {
            kind: round(OBSERVATIONS * (once[kind] + FRAMES * frame[kind]) / 3600, 2) for kind in frame
        },
        "same bytes": bool(np.array_equal(first.rgb, again.rgb)),
        "noise": noise(first.rgb, aside.rgb),
    }  # fmt: skip


@click.command()
@click.argument("observation", default="part_2/apartment_2/kitchen/1")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the picture.")
@click.option("--json", "record", type=click.Path(path_type=Path), required=True, help="File of the figures.")
@click.option("--frames", type=click.IntRange(4), default=12, show_default=True)
@click.option("--size", type=click.IntRange(32), default=1008, show_default=True, help="Side of the pictures (pixels).")
def main(observation: str, output: Path, record: Path, frames: int, size: int) -> None:
    """Measure path-traced frames of an OBSERVATION of the open benchmark."""
    try:
        output.mkdir(parents=True, exist_ok=True)
        found = measure(observation, frames, size, output / f"{observation.replace('/', '-')}.png")
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    write_bytes(record, (json.dumps(found, indent=1) + "\n").encode())
    click.echo(json.dumps({name: value for name, value in found.items() if name != "frames"}, indent=1))


if __name__ == "__main__":
    main()
