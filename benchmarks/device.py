"""Pictures, light and whole observations on the CPU and on a CUDA device, side by side: agreement and time.

    python -m benchmarks.device                    # all tables
    python -m benchmarks.device pictures light     # some of them
    python -m benchmarks.device bake               # the stages of building and lighting a home
    python -m benchmarks.device dataset --output data/timed --audio tracer

Without a CUDA device it prints the CPU's columns and says why the others are missing.
"""

from __future__ import annotations

import argparse
import cProfile
import hashlib
import pstats
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.runtime.one_thread import ONE_THREAD
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.scheduling.tasks import Policy
from benchmarks.stages import StageClock
from generators.core.cuda import cuda_problem, require_device
from generators.core.scene import Scene
from generators.vision.base import VisionBackend, VisionSession

#: Headings from the middle of each room, degrees.
HEADINGS = (0.0, 75.0, 160.0, 250.0)
MANIFEST = Path("scenes_manifest/open-s34-o7.yaml")
#: What an observation's time is spent on: title and the functions (file, name) whose cumulative time it is.
SHARES = {
    "draw the pictures": (("generators/vision/cuda.py", "render"), ("generators/vision/embree.py", "render")),
    "open the renderer": (("generators/vision/cuda.py", "open"), ("generators/vision/embree.py", "open")),
    "encode pictures and masks": (("generators/observation/writer.py", "add_pictures"),),
    "sound": (("generators/observation/hearing.py", "hear_sources"), ("generators/observation/writer.py", "add_clip")),
    "light of the objects": (("generators/lighting/insertion.py", "insert"),),
    "place the objects, plan the walk": (("generators/observation/arrangement.py", "arrange"),),
    "points of the surfaces": (("generators/observation/surface_points.py", "add"),),
    "load the home": (("generators/homes/store.py", "open_home"),),
}
#: Stages of building a home: title and function.
BUILDING = {
    "floor plan": "generators.apartments.apartment:make_floor_plan",
    "shells of the rooms": "generators.apartments.apartment:build_shell",
    "furnish a room": "generators.apartments.apartment:furnish",
    "move a piece to its place": "generators.apartments.apartment:_part",
    "material": "generators.assets.materials:Palette.material",
    "piece of furniture": "generators.apartments.interior.arrange:build_furniture",
}
#: Stages of lighting it.
LIGHTING = {
    "gather the faces, reduce the textures": "generators.lighting.bake:LitSurfaces.of",
    "open the tracer": "generators.lighting.bake:open_tracer",
    "find the emitters": "generators.lighting.bake:find_emitters",
    "find the sun": "generators.lighting.bake:find_sun",
    "unwrap a part": "generators.lighting.bake:lay_out",
    "join the light maps": "generators.lighting.bake:Sheet.of",
    "find the texels": "generators.lighting.bake:rasterise",
    "group them in blocks": "generators.lighting.bake:make_blocks",
    "open texels": "generators.lighting.bake:open_texels",
    "direct light": "generators.lighting.bake:_direct",
    "emitters within reach": "generators.lighting.bake:_reach",
    "sunlight": "generators.lighting.bake:_sunlight",
    "bright patches": "generators.lighting.bake:_patches",
    "links": "generators.lighting.bake:LinkTracer.trace",
    "where light is slow": "generators.lighting.bake:Slow.of",
    "more links": "generators.lighting.bake:LinkTracer.complete",
    "interpolate": "generators.lighting.bake:Slow.interpolate",
    "smooth": "generators.lighting.bake:_smoothed",
    "bounces": "generators.lighting.bake:solve",
    "final gather": "generators.lighting.bake:final_gather",
    "fill covered texels": "generators.lighting.bake:fill",
    "spread to empty cells": "generators.lighting.bake:spread",
    "light maps of the parts": "generators.lighting.bake:with_light",
    "exposure": "generators.lighting.bake:expose",
}


def devices() -> tuple[str, ...]:
    """The devices that can be used here."""
    return ("cpu",) if cuda_problem() else ("cpu", "cuda")


def clock(work: Callable[[], object]) -> float:
    """Wall time of ``work`` (s)."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def views(scene: Scene) -> Iterator[tuple[Scene, Pose]]:
    """Poses at eye height in the middle of each room, with the room's exposure."""
    for room in scene.rooms:
        x, _, z = (np.array(room.low) + np.array(room.high)) / 2
        for heading in HEADINGS:
            yield replace(scene, exposure=room.exposure), Pose.from_yaw((float(x), 1.5, float(z)), np.radians(heading))


def unlit(seed: int = 1) -> Scene:
    """A furnished apartment without light."""
    from generators.apartments.apartment import build_apartment

    return build_apartment("bench", seed, available_cores())


def pictures(size: int) -> None:
    """Time of a frame, and how far the frames of both devices agree."""
    from generators.lighting.bake import bake
    from generators.vision.cuda import CudaBackend, agreement
    from generators.vision.embree import EmbreeBackend

    scene, camera = bake(unlit(), quality="preview", workers=available_cores()), Intrinsics.from_fov(size)
    backends: dict[str, VisionBackend] = {"cpu": EmbreeBackend(), "cuda": CudaBackend()}
    used: dict[str, VisionBackend] = {device: backends[device] for device in devices()}
    for backend in used.values():
        backend.warm_up()
    times: dict[str, list[float]] = {device: [] for device in used}
    opening: dict[str, list[float]] = {device: [] for device in used}
    found = []
    sessions: dict[str, VisionSession] = {}
    exposure = None
    for lit, pose in views(scene):
        if lit.exposure != exposure:
            exposure = lit.exposure
            for device, backend in used.items():
                begun = time.perf_counter()
                sessions[device] = backend.open(lit, camera)
                opening[device].append(time.perf_counter() - begun)
        frames = {}
        for device in used:
            session = sessions[device]
            frames[device] = session.render(pose)
            times[device] += [clock(partial(session.render, pose)) for _ in range(3)]
        if len(frames) == 2:
            found.append(agreement(frames["cuda"], frames["cpu"]))
    print(f"\nA frame of {size}² (RGB, ids, depth), {sum(len(p.mesh.positions) for p in scene.parts):,} triangles")
    for device in used:
        median, worst = 1e3 * np.median(times[device]), 1e3 * np.max(times[device])
        print(f"  {device:4s}  {median:8.1f} ms median, {worst:8.1f} ms worst; open {np.median(opening[device]):.2f} s")
    if found:
        equal, apart, psnr = np.array(found).T
        print(
            f"  cuda against cpu, {len(found)} views: ids equal {100 * equal.min():.4f} % (worst), depth within "
            f"{1e3 * apart.max():.4f} mm (99.99 % of the pixels, worst view), PSNR {psnr.min():.1f} dB worst, "
            f"{np.median(psnr):.1f} dB median"
        )


def light() -> None:
    """Time of a baked home, and how far pictures of homes baked on both devices agree."""
    from generators.lighting.bake import bake
    from generators.vision.cuda import agreement
    from generators.vision.embree import EmbreeBackend

    scene, cores = unlit(), available_cores()
    print(f"\nLight of a home, quality standard, {cores} threads")
    lit: dict[str, Scene] = {}
    for device in devices():
        bake(scene, quality="preview", workers=cores, device=device)  # compiles
        taken = []
        for _ in range(3):
            begun = time.perf_counter()
            lit[device] = bake(scene, quality="standard", workers=cores, device=device)
            taken.append(time.perf_counter() - begun)
        print(f"  {device:4s}  {min(taken):6.2f} s best of {len(taken)} ({', '.join(f'{t:.2f}' for t in taken)})")
    if len(lit) < 2:
        return
    camera, found = Intrinsics.from_fov(504), []
    for (one, pose), (other, _) in zip(views(lit["cpu"]), views(lit["cuda"]), strict=True):
        first, second = (EmbreeBackend().open(each, camera).render(pose) for each in (one, other))
        found.append(agreement(first, second)[2])
    print(f"  pictures of both: PSNR {min(found):.1f} dB worst, {np.median(found):.1f} dB median of {len(found)} views")


def baking(seed: int = 2) -> None:
    """Time of the stages of building and lighting a home, and a digest of its light."""
    from generators.lighting.bake import bake

    cores = available_cores()
    unlit()  # what is imported and made once
    with StageClock(BUILDING) as clock:
        scene = unlit(seed)
    faces = sum(len(part.mesh.positions) for part in scene.parts)
    print(f"\nBuilding a home of {faces:,} triangles\n{clock.table()}")
    for device in devices():
        bake(scene, quality="preview", workers=cores, device=device)  # compiles
        for _ in range(2):
            with StageClock(LIGHTING) as clock:
                lit = bake(scene, quality="standard", workers=cores, device=device)
        print(f"\nLighting it on {device}, quality standard, {cores} threads (second time)\n{clock.table()}")
        print(f"  digest of the light: {light_digest(lit)}")
    if "cuda" in devices():
        _pieces(scene, cores)


def _pieces(scene: Scene, cores: int) -> None:
    """Time of a bake on CUDA with other sizes of the pieces of work; its light is the same."""
    from generators.core.device_rays import DeviceTracer
    from generators.lighting.bake import bake

    used = DeviceTracer.calls_together
    for together in (1, 2, 4, 8, 16):
        DeviceTracer.calls_together = together
        start = time.perf_counter()
        lit = bake(scene, quality="standard", workers=cores, device="cuda")
        print(f"  {together:2d} pieces to a call: {time.perf_counter() - start:.2f} s, digest {light_digest(lit)}")
    DeviceTracer.calls_together = used


def light_digest(scene: Scene) -> str:
    """Digest of all light maps and exposures of a scene."""
    digest = hashlib.sha256(repr([room.exposure for room in scene.rooms]).encode())
    for part in scene.parts:
        if part.light is not None:
            digest.update(part.light.uv.tobytes() + np.ascontiguousarray(part.light.texels).tobytes())
    return digest.hexdigest()[:16]


def observation(manifest: Path, audio: str, frames: int) -> None:
    """Where the time of one observation goes, in one process."""
    from generators.homes.store import prepare_home
    from generators.manifest.reading import read_manifest
    from generators.observation.generate import generate_observation
    from generators.options import GenerateOptions
    from generators.plan import make_plans

    source = read_manifest(manifest)
    for device in devices():
        options = GenerateOptions(device=device, audio=audio, frames=frames)  # type: ignore[arg-type]
        plan = make_plans(source, options)[0]
        with tempfile.TemporaryDirectory() as folder:
            cache = Path(folder) / "cache"
            home = clock(partial(prepare_home, plan, cache, workers=available_cores()))
            generate_observation(plan, Path(folder) / "first", cache)  # compiles
            profile = cProfile.Profile()
            profile.enable()
            taken = clock(partial(generate_observation, plan, Path(folder) / "second", cache))
            profile.disable()
        print(
            f"\nAn observation of {frames} frames on {device}, one process: {taken:.1f} s; its home, once: {home:.1f} s"
        )
        stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
        rest = taken
        for title, functions in SHARES.items():
            share = sum(
                value[3]
                for (file, _, name), value in stats.items()
                if any(file.endswith(path) and name == function for path, function in functions)
            )
            rest -= share
            print(f"  {title:34s} {share:6.2f} s")
        print(f"  {'other':34s} {rest:6.2f} s")


@dataclass
class _Times:
    """When events of a run happened (s after its start)."""

    start: float
    homes: list[float]
    begun: list[float]
    done: list[float]
    failed: list[str]


def dataset(manifest: Path, audio: str, output: Path | None, frames: int | None) -> None:
    """Time of the whole benchmark, on the best device that is there."""
    from generators.core.folders import default_cache
    from generators.manifest.reading import read_manifest
    from generators.options import GenerateOptions
    from generators.plan import make_plans
    from generators.run.runner import RunSettings, run

    device = devices()[-1]
    source = read_manifest(manifest)
    times = _Times(time.perf_counter(), [], [], [], [])
    plans = make_plans(source, GenerateOptions(device=device, audio=audio, frames=frames))  # type: ignore[arg-type]
    planned = time.perf_counter() - times.start

    def listen(event: object) -> None:
        now = time.perf_counter() - times.start
        kind, name, text = event.kind, event.name, event.text  # type: ignore[attr-defined]
        lists = {"home": times.homes, "start": times.begun, "done": times.done}
        if kind in lists:
            lists[kind].append(now)
        if kind in ("failed", "retry", "note", "worker"):
            times.failed.append(f"{kind} {name}: {text}")

    settings = RunSettings(
        cache=default_cache(),
        workers=available_cores(),
        policy=Policy(environment=tuple(sorted(ONE_THREAD.items()))),
    )
    with tempfile.TemporaryDirectory() as folder:
        root = output or Path(folder) / "data"
        outcome = run(source, plans, root, settings, listen)
        total = time.perf_counter() - times.start
        size = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"\n{len(plans)} observations on {device}, --audio {audio}, {available_cores()} processes: {total:.1f} s")
    print(f"  planned after {planned:.1f} s; first observation begun after {min(times.begun, default=0):.1f} s,")
    print(f"  first finished after {min(times.done, default=0):.1f} s, last after {max(times.done, default=0):.1f} s")
    print("  finished after", " ".join(f"{second:.0f}" for second in times.done), "s")
    print(f"  CPU time of the processes {used.ru_utime + used.ru_stime:.0f} s; {size / 1e9:.2f} GB written")
    print(f"  {len(outcome.made)} made, {len(outcome.failed)} failed", *times.failed[:8], sep="\n  ")


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", help="pictures, light, observation (the default); bake, dataset")
    parser.add_argument("--size", type=int, default=1008, help="side of the pictures, pixels")
    parser.add_argument("--audio", default="analytic", help="acoustic engine of observation and dataset")
    parser.add_argument("--manifest", type=Path, default=MANIFEST, help="of observation and dataset")
    parser.add_argument("--frames", type=int, default=None, help="frames per observation")
    parser.add_argument("--output", type=Path, default=None, help="folder that keeps the dataset")
    chosen = parser.parse_args()
    print(cuda_problem() or require_device())
    for table in chosen.tables or ("pictures", "light", "observation"):
        if table == "pictures":
            pictures(chosen.size)
        elif table == "light":
            light()
        elif table == "bake":
            baking()
        elif table == "observation":
            observation(chosen.manifest, chosen.audio, chosen.frames or 120)
        elif table == "dataset":
            if chosen.output is not None and chosen.output.exists():
                shutil.rmtree(chosen.output)
            dataset(chosen.manifest, chosen.audio, chosen.output, chosen.frames)
        else:
            parser.error(f"unknown table {table!r}")


if __name__ == "__main__":
    main()
