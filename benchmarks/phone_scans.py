"""`python -m benchmarks.phone_scans -o DIR`: five scans of our own homes by a simulated phone, with the truth beside.

    DIR/1/scan.glb      as an app writes it: Y up, metres, the origin at the phone's first position, any heading
    DIR/1/truth.json    `Truth`: rooms, supports, furniture, materials, lamps, windows, light, T30

Everything in the truth is in the *aligned* frame: the file turned by ``turn`` degrees about +Y (x → z for −90°).
`tests.support.phone` describes the faults of the scans.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.formats.files import write_json
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import reverberation_time
from generators.acoustics.tracer.backend import TracerBackend
from generators.apartments.apartment import build_apartment
from generators.core.scene import Room, Scene, Support
from generators.homes.cache import cached_scene
from generators.lighting.bake import bake
from generators.lighting.emitters import face_areas
from generators.lighting.lit_scene import LitScene
from generators.lighting.sun import find_sun
from generators.placement.site import Site
from tests.support.phone import PhoneWalk, scan_by_phone
from tests.support.scan_like import write_glb

Array = NDArray[np.float64]

#: Walks of the five scans: three of one room each, two of whole flats. "flat": all rooms but the hall.
FLAT = ("living_room", "kitchen", "bathroom")
WALKS: tuple[PhoneWalk, ...] = (
    PhoneWalk(("living_room",), faces=60_000),
    PhoneWalk(("kitchen",), faces=120_000),
    PhoneWalk(("bathroom",), faces=40_000, heading=24.0),
    PhoneWalk(FLAT, faces=250_000, holes=60, fragments=20),
    PhoneWalk(FLAT, faces=500_000, heading=-37.0, ceiling=False, holes=60, fragments=20),
)
#: Homes of the five scans; no manifest uses them.
SEEDS = (501, 502, 503, 504, 505)
#: Directions over the sphere for the light at a point.
RAYS = 4096
#: Probes stand this far above the middle of a support (m).
ABOVE = 0.05
#: Sources and listeners from which the reverberation time is read: shares of the walkable points.
SHARES = ((0.1, 0.6), (0.5, 0.95), (0.8, 0.2))
#: A part whose light is brighter than this is a lamp (scene units).
LAMP = 5.0


@dataclass(frozen=True)
class RoomTruth:
    """A room: inner box, volume (m³), T30 (s) of the furnished home, equivalent area (m²) of each acoustic label."""

    box: Any
    volume: float
    t30: float | None
    areas: dict[str, float]


@dataclass(frozen=True)
class LightProbe:
    """Light on a white matte surface at a point.

    Attributes:
        room: its room.
        at: metres.
        radiance: (6, 3) linear RGB of the surface facing +x, −x, +y, −y, +z, −z, times the room's exposure: what a
            picture shows before the tone curve.
    """

    room: str
    at: Any
    radiance: Any


@dataclass(frozen=True)
class Truth:
    """What is known of a scanned home, in the aligned frame.

    Attributes:
        seed: of the home.
        turn: degrees about +Y that turn the file to the aligned frame.
        rooms: the rooms that were scanned.
        supports: of these rooms, as in `generators.core.scene.Support`.
        furniture: name of each part → its box.
        lamps: name → centre and mean radiance of what shines.
        windows: per room, box of the panes and the direction into the room.
        sun: unit vector towards the sun, or None.
        probes: light at points.
        cameras: positions of the phone.
        seen: m² of surface that was seen.
    """

    seed: int
    turn: float
    rooms: dict[str, RoomTruth]
    supports: list[dict[str, Any]]
    furniture: dict[str, Any]
    lamps: dict[str, dict[str, Any]]
    windows: list[dict[str, Any]]
    sun: Any
    probes: list[LightProbe]
    cameras: list[Any]
    seen: float
    settings: dict[str, Any] = field(default_factory=dict)


def home_of(seed: int, quality: str = "preview") -> Scene:
    """The lit home of a scan, from the cache if it was made before."""
    from platformdirs import user_cache_path

    folder = user_cache_path("avs3d-bench") / "phone-homes"

    def build() -> Scene:
        return bake(build_apartment(f"home_{seed}", seed), quality=quality)

    return cached_scene(folder, f"{seed}-{quality}", build, "cpu")


def write_scan(folder: Path, seed: int, walk: PhoneWalk) -> Truth:
    """Scan the home of ``seed`` and write ``scan.glb`` and ``truth.json`` to ``folder``."""
    home = home_of(seed)
    scan = scan_by_phone(home, walk, np.random.default_rng([seed, 34]))
    write_glb(scan.mesh, folder / "scan.glb")
    truth = Truth(
        seed=seed,
        turn=-walk.heading,
        rooms={name: _room(home, home.room(name), scan.origin) for name in walk.rooms},
        supports=[_support(s, scan.origin) for s in home.supports if s.room in walk.rooms],
        furniture=_furniture(home, walk, scan.origin),
        lamps=_lamps(home, walk, scan.origin),
        windows=_windows(home, walk, scan.origin),
        sun=_sun(home),
        probes=_probes(home, walk, scan.origin),
        cameras=[_rounded(np.asarray(pose.position) - scan.origin) for pose in scan.poses],
        seen=round(scan.seen, 1),
        settings=asdict(walk),
    )
    write_json(folder / "truth.json", asdict(truth))
    return truth


def _rounded(values: Any) -> Any:
    return np.round(np.asarray(values, dtype=np.float64), 4).tolist()


def _room(home: Scene, room: Room, origin: Array) -> RoomTruth:
    box = np.array([room.low, room.high])
    sides = box[1] - box[0]
    areas: dict[str, float] = {}
    for part in home.parts:
        triangles = part.mesh.acoustic_positions
        middle = triangles.mean(axis=1)
        inside = ((middle >= box[0] - 0.05) & (middle <= box[1] + 0.05)).all(axis=1)
        for label, area in zip(part.mesh.acoustic_labels, np.where(inside, face_areas(triangles), 0), strict=True):
            areas[label] = areas.get(label, 0.0) + float(area)
    kept = {label: round(area, 2) for label, area in sorted(areas.items()) if area >= 0.01}
    return RoomTruth(_rounded(box - origin), round(float(sides.prod()), 2), _t30(home, room), kept)


def _t30(home: Scene, room: Room) -> float | None:
    """T30 by the tracer, over a few sources and listeners."""
    points = Site.of(home, room.name).space.points
    responses = []
    for source, listener in SHARES:
        (x, z), (u, w) = (points[int(share * (len(points) - 1))] for share in (source, listener))
        session = TracerBackend().open(home, (float(x), room.low[1] + 1.0, float(z)), room=room.name)
        pose = Pose.from_yaw((float(u), room.low[1] + 1.5, float(w)), 0.7)
        responses.append(session.impulse_response(pose))
        session.close()
    found = reverberation_time(responses, SAMPLE_RATE)
    return None if found is None else round(found, 3)


def _support(support: Support, origin: Array) -> dict[str, Any]:
    return asdict(support) | {"origin": _rounded(np.asarray(support.origin) - origin)}


def _furniture(home: Scene, walk: PhoneWalk, origin: Array) -> dict[str, Any]:
    return {
        part.name: _rounded(part.mesh.bounds.astype(np.float64) - origin)
        for part in home.parts
        if part.name.partition("/")[0] in walk.rooms
    }


def _lamps(home: Scene, walk: PhoneWalk, origin: Array) -> dict[str, dict[str, Any]]:
    out = {}
    for part in home.parts:
        if part.name.partition("/")[0] not in walk.rooms:
            continue
        emission = np.array([m.emission for m in part.mesh.materials])[part.mesh.face_material]
        bright = emission.max(axis=1) > LAMP
        if bright.any():
            corners = part.mesh.positions[bright]
            area = face_areas(corners)
            centre = (corners.mean(axis=1) * area[:, None]).sum(axis=0) / area.sum()
            radiance = (emission[bright] * area[:, None]).sum(axis=0) / area.sum()
            out[part.name] = {
                "centre": _rounded(centre - origin),
                "radiance": _rounded(radiance),
                "area": round(float(area.sum()), 4),
            }
    return out


def _windows(home: Scene, walk: PhoneWalk, origin: Array) -> list[dict[str, Any]]:
    """The panes of each wall of each room."""
    out = []
    for part in home.parts:
        room = part.name.removeprefix("shell_")
        sky = np.array([m.name.startswith("sky") for m in part.mesh.materials])[part.mesh.face_material]
        if room not in walk.rooms or not sky.any():
            continue
        inward = np.round(part.mesh.normals[sky].mean(axis=1)).astype(np.int64)
        emission = np.array([m.emission for m in part.mesh.materials])[part.mesh.face_material[sky]]
        for normal in np.unique(inward, axis=0):
            own = (inward == normal).all(axis=1)
            corners = part.mesh.positions[sky][own].reshape(-1, 3)
            weight = face_areas(part.mesh.positions[sky][own])
            out.append(
                {
                    "room": room,
                    "box": _rounded(np.stack([corners.min(axis=0), corners.max(axis=0)]) - origin),
                    "inward": normal.tolist(),
                    "radiance": _rounded((emission[own] * weight[:, None]).sum(axis=0) / weight.sum()),
                    "area": round(float(weight.sum()), 3),
                }
            )
    return out


def _sun(home: Scene) -> Any:
    lit = LitScene.of(home.parts)
    sun = find_sun(home.name, lit.surfaces, lit.tracer)
    return None if sun is None else _rounded(sun.direction)


def _probes(home: Scene, walk: PhoneWalk, origin: Array) -> list[LightProbe]:
    """Light above the supports on which things stand, and in the middle of each room."""
    lit = LitScene.of(home.parts)
    out = []
    for name in walk.rooms:
        room = home.room(name)
        places = [
            np.asarray(s.origin) + (np.asarray(s.u) + np.asarray(s.v)) / 2 + [0, ABOVE, 0]
            for s in home.supports
            if s.room == name and s.kind not in ("floor", "wall")
        ]
        places.append((np.asarray(room.low) + room.high) / 2)
        for place in places:
            radiance = room.exposure * white_cube(lit, place)
            out.append(LightProbe(name, _rounded(place - origin), _rounded(radiance)))
    return out


def white_cube(lit: LitScene, point: Array) -> Array:
    """(6, 3) radiance of a small white matte cube's faces (+x, −x, +y, −y, +z, −z) at a point."""
    index = np.arange(RAYS) + 0.5
    height = 1 - 2 * index / RAYS
    angle = np.pi * (1 + 5**0.5) * index
    ring = np.sqrt(1 - height**2)
    along = np.stack([ring * np.cos(angle), height, ring * np.sin(angle)], axis=1).astype(np.float32)
    hits = lit.tracer.intersect(np.tile(point.astype(np.float32), (RAYS, 1)), along)
    light = lit.reflected(hits["primID"], hits["u"], hits["v"]) + lit.emitted(hits)
    light = np.where(lit.front(hits, along)[:, None], light, 0.0).astype(np.float64)
    axes = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
    cosine = np.maximum(axes @ along.astype(np.float64).T, 0)
    return np.asarray(4 / RAYS * cosine @ light)


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--seeds", multiple=True, type=int, default=SEEDS, show_default=True)
@click.option("--only", multiple=True, type=int, help="Numbers of the scans to make [all].")
def main(output: Path, seeds: tuple[int, ...], only: tuple[int, ...]) -> None:
    """Write one folder per seed below OUTPUT."""
    for number, seed in enumerate(seeds, start=1):
        if only and number not in only:
            continue
        start = time.perf_counter()
        folder = output / str(number)
        folder.mkdir(parents=True, exist_ok=True)
        truth = write_scan(folder, seed, WALKS[(number - 1) % len(WALKS)])
        size = (folder / "scan.glb").stat().st_size / 1e6
        rooms = ", ".join(f"{name} T30 {room.t30} s" for name, room in truth.rooms.items())
        print(f"{folder}: home {seed}, {rooms}; {size:.1f} MB, {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
