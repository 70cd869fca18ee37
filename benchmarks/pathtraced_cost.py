"""What a path-traced frame costs, whether its bytes repeat, and how much noise is left.

    python -m benchmarks.pathtraced_cost frame part_2/apartment_2/kitchen/1 -o build/cost --json build/cost.json
    python -m benchmarks.pathtraced_cost many --json build/many.json

Both render frames of observations of the open benchmark as `generators.vision.pathtraced` does.

``frame`` measures the seconds of opening the scene, of the first frame (which records and compiles the programs) and
of each other frame, of the clock and of this process's CPU, and where they go: ``trace`` is what the device takes, its
sums fetched; ``labels`` the ids, depth and windows; ``finish`` denoising and tone curve; ``encode`` the PNG files.
Noise is what differs between two pictures with other random numbers: the camera is moved by a thousandth of a
millimetre. With ``--reference`` the error of the first frame is measured, too, against a picture of so many paths a
pixel, not denoised. The first frame is rendered once more in a session of its own: it must have the same bytes. A
picture is cut out at full size, to look at.

``many`` measures frames per second of the clock, PNG files encoded, when one or several processes share a device and
each works on one or several frames at a time, as `generators.scenes.renderer.Renderer.frames` does. From these follow
the hours of 34 observations of 120 frames.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.light_reference import prepared_room
from generators.core.folders import default_cache
from generators.scenes.renderer import Renderer
from generators.vision.base import RenderedView
from generators.vision.pathtraced import SAMPLES, PathtracedBackend, PathtracedSession

#: Of the open benchmark.
OBSERVATIONS, FRAMES = 34, 120
#: Whose frames several processes render.
TOGETHER = ("part_2/apartment_2/kitchen/1", "part_2/apartment_1/living_room/1", "part_2/apartment_2/living_room/1")
#: Processes on a device, and frames that each works on at a time.
PACES = ((1, 1), (1, 2), (1, 3), (2, 1), (2, 3), (3, 1), (3, 2))
#: How long a process waits for the others (s).
_PATIENCE = 300.0
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


def stages(session: PathtracedSession, poses: Sequence[Pose]) -> dict[str, dict[str, float]]:
    """Median seconds of what one frame after another takes, each stage by itself."""
    found: dict[str, list[dict[str, float]]] = {"trace": [], "labels": [], "finish": [], "encode": []}
    for pose in poses:
        clock = Clock()
        sums = session.begin(pose).result()
        found["trace"].append(clock.seconds())
        clock = Clock()
        labels = session.labels(pose)
        found["labels"].append(clock.seconds())
        clock = Clock()
        frame = replace(labels, rgb=session.finish(sums, labels))
        found["finish"].append(clock.seconds())
        clock = Clock()
        encode(0, frame)
        found["encode"].append(clock.seconds())
    return {stage: median(times) for stage, times in found.items()}


def median(times: Sequence[dict[str, float]]) -> dict[str, float]:
    """Of the clock's and the CPU's seconds."""
    return {kind: round(float(np.median([one[kind] for one in times])), 3) for kind in ("wall", "cpu")}


def encode(_: int, frame: RenderedView) -> None:
    """Make the PNG files of a frame."""
    media.encode_png_rgb(Path("rgb.png"), frame.rgb)
    media.encode_png_ids(Path("ids.png"), frame.instance_ids)


def error(session: PathtracedSession, pose: Pose, shown: NDArray[np.uint8], paths: int) -> dict[str, float]:
    """How far a picture is from the mean of so many paths a pixel, not denoised, in steps of 8 bits.

    Args:
        session: an open scene.
        pose: of the camera.
        shown: the picture (H, W, 3).
        paths: of the reference, a multiple of 2 · `SAMPLES`.

    Returns:
        ``paths``, ``rms`` and ``median`` of the difference, and the rms noise ``of the reference``, from its halves.
    """
    place, labels, halves = pose.position, session.labels(pose), []
    count = paths // SAMPLES // 2
    for first in (0, count):
        # A camera that is moved by less than it can tell has other random numbers.
        steps = _ASIDE / 1000 * np.arange(first + 1, first + count + 1)
        moved = [Pose((place[0] + float(step), *place[1:]), pose.rotation) for step in steps]
        halves.append(np.sum([session.begin(each).result() for each in moved], axis=0) / count)
    one, other, whole = (
        session.finish(each.astype(np.float32), labels, denoise=False).astype(np.float64)
        for each in (*halves, (halves[0] + halves[1]) / 2)
    )
    off = shown - whole
    return {
        "paths": 2 * count * SAMPLES,
        "rms": round(float(np.sqrt((off**2).mean())), 3),
        "median": round(float(np.median(np.abs(off))), 3),
        "of the reference": round(float(np.sqrt(((one - other) ** 2).mean())) / 2, 3),
    }  # fmt: skip


def measure(key: str, frames: int, camera: Intrinsics, crop: Path, paths: int) -> dict[str, Any]:
    """Render ``frames`` frames of an observation, and what they cost; ``paths``: of the reference, 0 for none."""
    scene, room, poses = prepared_room(key, default_cache(), matte=False)
    scene, backend = scene.for_room(room), PathtracedBackend()
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
    parts = stages(session, chosen[1:])
    off = error(session, chosen[0], first.rgb, paths) if paths else None
    session.close()
    again = backend.open(scene, camera).render(chosen[0])
    middle, half = camera.width // 2, min(504, camera.width) // 2
    part = slice(middle - half, middle + half)
    cv2.imwrite(str(crop), np.ascontiguousarray(first.rgb[part, part, ::-1]))
    return {
        "observation": key, "renderer": backend.version, "size": camera.width, "samples": SAMPLES,
        "open": opened, "first frame": compiled, "frame": median(each), "frames": each, "stages": parts,
        "same bytes": bool(np.array_equal(first.rgb, again.rgb)), "noise": noise(first.rgb, aside.rgb),
        "error": off,
    }  # fmt: skip


@dataclass(frozen=True)
class Pace:
    """What one of several processes has rendered.

    Attributes:
        once: seconds of the clock for opening the scene and its first frames.
        frames: finished after that.
        seconds: that they took.
    """

    once: float
    frames: int
    seconds: float


def render_for(job: tuple[str, int, int, float], start: Any) -> Pace:
    """Render frames of an observation for some seconds, from when all processes have their first frames.

    Args:
        job: observation, side of the pictures (pixels), frames at a time, seconds.
        start: a barrier of all processes.
    """
    key, size, at_once, seconds = job
    scene, room, poses = prepared_room(key, default_cache(), matte=False)
    backend, camera = PathtracedBackend(), Intrinsics.from_fov(size)
    backend.warm_up()
    order = {number: poses[number * 37 % len(poses)] for number in range(FRAMES * 50)}
    began = time.perf_counter()
    with Renderer(scene, backend, room=room) as camera_of, closing(
        camera_of.frames(order, camera, then=encode, cores=lambda: at_once)
    ) as frames:  # fmt: skip
        for _ in range(2 * at_once):
            next(frames)
        once = time.perf_counter() - began
        start.wait(_PATIENCE)
        began, done = time.perf_counter(), 0
        while time.perf_counter() - began < seconds or done < 2:
            next(frames)
            done += 1
        return Pace(once, done, time.perf_counter() - began)


def together(processes: int, at_once: int, size: int, seconds: float) -> dict[str, Any]:
    """Frames per second of several processes, and the hours of all observations that follow from them."""
    context = multiprocessing.get_context("spawn")
    with context.Manager() as manager, ProcessPoolExecutor(processes, mp_context=context) as pool:
        start = manager.Barrier(processes)
        jobs = [(TOGETHER[number % len(TOGETHER)], size, at_once, seconds) for number in range(processes)]
        paces = list(pool.map(render_for, jobs, [start] * processes))
    rate = sum(pace.frames / pace.seconds for pace in paces)
    once = float(np.mean([pace.once for pace in paces]))
    hours = (OBSERVATIONS * once / processes + OBSERVATIONS * FRAMES / rate) / 3600
    return {
        "processes": processes, "frames at a time": at_once, "frames per second": round(rate, 3),
        "seconds of a frame": round(1 / rate, 3), "opening and first frames (s)": round(once, 1),
        "hours of 34 observations": {"one device": round(hours, 2), "two devices": round(hours / 2, 2)},
    }  # fmt: skip


@click.group()
def main() -> None:
    """Measure path-traced frames of the open benchmark."""


_SIZE = click.option(
    "--size", type=click.IntRange(32), default=1008, show_default=True, help="Side of the pictures (pixels)."
)
_JSON = click.option("--json", "record", type=click.Path(path_type=Path), required=True, help="File of the figures.")


@main.command("frame")
@click.argument("observation", default=TOGETHER[0])
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the picture.")
@_JSON
@click.option("--frames", type=click.IntRange(4), default=12, show_default=True)
@_SIZE
@click.option("--reference", "paths", type=click.IntRange(0), default=0, show_default=True, help="Its paths a pixel.")
def frame_command(observation: str, output: Path, record: Path, frames: int, size: int, paths: int) -> None:
    """What a frame of an OBSERVATION costs, and its noise."""
    try:
        output.mkdir(parents=True, exist_ok=True)
        crop = output / f"{observation.replace('/', '-')}.png"
        found = measure(observation, frames, Intrinsics.from_fov(size), crop, paths)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    write_bytes(record, (json.dumps(found, indent=1) + "\n").encode())
    click.echo(json.dumps({name: value for name, value in found.items() if name != "frames"}, indent=1))


@main.command("many")
@_JSON
@click.option("--pace", "paces", type=(int, int), multiple=True, help="Processes, frames at a time. [default: several]")
@click.option("--seconds", type=float, default=15.0, show_default=True, help="Of each pace, after the first frames.")
@_SIZE
def many_command(record: Path, paces: tuple[tuple[int, int], ...], seconds: float, size: int) -> None:
    """Frames per second of several processes on one device."""
    found = []
    for processes, at_once in paces or PACES:
        try:
            found.append(together(processes, at_once, size, seconds))
        except Avs3dError as error:
            raise click.ClickException(str(error)) from None
        click.echo(json.dumps(found[-1]))
        write_bytes(record, (json.dumps({"size": size, "samples": SAMPLES, "paces": found}, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
