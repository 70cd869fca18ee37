"""Views of homes that no manifest uses: chosen once, rendered by any version of the generator.

    python -m benchmarks.home_views choose -o docs/results/home-views.json
    python -m benchmarks.home_views render docs/results/home-views.json -o build/now
    python -m benchmarks.home_views render docs/results/home-views.json -o build/traced --vision pathtraced
    python -m benchmarks.home_views sheet build/before build/now build/traced -o docs/images/homes.jpg

``choose`` writes seeds and poses; ``render`` reads them, so that an older version of the project renders the same
views: put this file into its ``benchmarks`` and run it there. Pictures are what a dataset gets: the renderer, exposure
and camera are those that an observation has by default. The sheet has a block of rows for each home, a row for each
folder.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_bytes
from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.unseen_homes import plans_of, sample_manifest
from generators.core.folders import default_cache
from generators.core.freespace import SENSOR_HEIGHT
from generators.core.scene import Scene
from generators.homes.store import open_home
from generators.observation.prepare import prepare_observation
from generators.placement.site import Site
from generators.plan import ObservationPlan
from generators.vision.embree import EmbreeBackend

Picture = NDArray[np.uint8]

#: Number of homes, of views of each, and the seed that both are drawn from.
HOMES, VIEWS, SEED = 5, 5, 35
#: Rooms in the order in which they get a view; the rounds go on until there are enough.
ROOMS = ("kitchen", "living_room", "bathroom", "bedroom", "hall")
#: Poses that are tried for a view, the side of their pictures (pixels), and the range of the pitch (degrees).
TRIES, PREVIEW, PITCH = 24, 48, (-18.0, 0.0)
#: Least depth (m) at the tenth percentile of a view: nearer things fill the picture.
NEAREST = 0.7
#: Side of a picture in the sheet (pixels), width of the gaps, and the largest size of its file (bytes).
SIDE, GAP, LARGEST = 200, 4, 600_000


@dataclass(frozen=True)
class View:
    """A view of a home.

    Attributes:
        seed: of the home.
        room: that the camera stands in, and whose exposure the picture has.
        position: of the camera (m).
        yaw, pitch: of the camera (radians), see `Pose.from_yaw`.
    """

    seed: int
    room: str
    position: tuple[float, float, float]
    yaw: float
    pitch: float

    @property
    def pose(self) -> Pose:
        """The camera's pose."""
        return Pose.from_yaw(self.position, self.yaw, self.pitch)


def home_plans(homes: int = HOMES, seed: int = SEED) -> list[ObservationPlan]:
    """Plans of one observation in each of some homes that no manifest uses."""
    return plans_of(sample_manifest(homes, homes, seed, parts=("part_1",)))


def entropy(scene: Scene, face: NDArray[np.int32]) -> float:
    """How many things a picture of faces (H, W) shows: the entropy (bit) of the shares of its parts and materials.

    The outdoors, of many materials, is one thing.
    """
    own = [np.array([-1 if m.shown else 1000 * n + i for i, m in enumerate(part.mesh.materials)]) for n, part in
           enumerate(scene.parts)]  # fmt: skip
    kinds = np.concatenate([table[part.mesh.face_material] for table, part in zip(own, scene.parts, strict=True)])
    _, count = np.unique(kinds[face[face >= 0]], return_counts=True)
    share = count / count.sum()
    return float(-(share * np.log2(share)).sum())


def choose_view(scene: Scene, seed: int, room: str, rng: np.random.Generator) -> View:
    """Of `TRIES` poses on the room's free floor the one that sees most things, none of them close.

    Raises:
        Avs3dError: if the room has no free floor.
    """
    space = Site.of(scene, room).space
    session = EmbreeBackend().open(scene, Intrinsics.from_fov(PREVIEW))
    found: list[tuple[float, View]] = []
    for x, z in space.points[rng.integers(len(space.points), size=TRIES)]:
        yaw, pitch = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(*PITCH))
        position = (float(x), float(space.floor + SENSOR_HEIGHT), float(z))
        view = View(seed, room, position, float(yaw), float(pitch))
        depth = session.render(view.pose).depth
        far = float(np.quantile(depth, 0.1)) >= NEAREST
        found.append((entropy(scene, session.faces) * (1.0 if far else 0.5), view))
    session.close()
    return max(found, key=lambda pair: pair[0])[1]


def choose(plan: ObservationPlan, cache: Path, count: int = VIEWS) -> list[View]:
    """The views of a plan's home, room by room."""
    home, seed = open_home(plan, cache), plan.scan.seed
    assert seed is not None
    rooms = [name for name in ROOMS if name in {room.name for room in home.rooms}]
    rng = np.random.default_rng([SEED, seed])
    return [choose_view(home, seed, rooms[n % len(rooms)], rng) for n in range(count)]


def render(views: Sequence[View], plan: ObservationPlan, cache: Path, size: int) -> Iterator[Picture]:
    """Pictures (size, size, 3) of views of the plan's home, as the plan's options draw and photograph them."""
    home, renderer = open_home(plan, cache), prepare_observation(plan, cache).renderer
    for view in views:
        session = renderer.open(home.for_room(view.room), Intrinsics.from_fov(size))
        yield session.render(view.pose).rgb
        session.close()


def write_jpeg(path: Path, picture: Picture, largest: int = LARGEST) -> None:
    """Write a picture (H, W, 3) with the highest quality that keeps the file within ``largest`` bytes.

    Raises:
        Avs3dError: if no quality does.
    """
    for quality in range(92, 40, -3):
        done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        if done and len(data) <= largest:
            write_bytes(path, data.tobytes())
            return
    raise Avs3dError(f"{path}: larger than {largest:,} bytes at any quality; show fewer or smaller pictures")


def sheet(folders: Sequence[Path], side: int = SIDE) -> Picture:
    """A block of rows for each home: its views, as each of the folders has them.

    Args:
        folders: of pictures that `render` wrote.
        side: of a picture (pixels).

    Raises:
        Avs3dError: if a folder lacks a picture that another one has.
    """
    names = sorted({path.name for folder in folders for path in folder.glob("home_*.png")})
    homes: dict[str, list[str]] = {}
    for name in names:
        homes.setdefault(name.rpartition("-")[0], []).append(name)
    blocks = []
    for shown in homes.values():
        rows = [np.concatenate([_framed(folder / name, side) for name in shown], axis=1) for folder in folders]
        blocks.append(np.concatenate([*rows, np.full((2 * GAP, rows[0].shape[1], 3), 255, np.uint8)]))
    if not blocks:
        raise Avs3dError(f"{folders[0]}: no home_*.png; expected a folder that `render` wrote")
    return np.concatenate(blocks)[: -2 * GAP]


def _framed(path: Path, side: int) -> Picture:
    picture = cv2.imread(str(path))
    if picture is None:
        raise Avs3dError(f"{path}: no picture; render the same views into each folder")
    small = cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA)[..., ::-1]
    return np.asarray(np.pad(small, ((0, GAP), (0, GAP), (0, 0)), constant_values=255), dtype=np.uint8)


@click.group()
def main() -> None:
    """Choose views of unseen homes, render them, and draw a sheet."""


@main.command("choose")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="File of the views.")
def choose_command(output: Path) -> None:
    """Choose the views of `HOMES` homes."""
    found = [choose(plan, default_cache()) for plan in home_plans()]
    write_bytes(output, (json.dumps([[asdict(view) for view in views] for views in found], indent=1) + "\n").encode())


@main.command("render")
@click.argument("views", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the pictures.")
@click.option("--vision", default=None, help="Renderer [embree].")
@click.option("--device", type=click.Choice(["cpu", "cuda"]), default="cpu", show_default=True)
@click.option("--size", default=336, show_default=True, help="Side of the pictures (pixels).")
@click.option("--home", "homes", multiple=True, type=click.IntRange(1), help="Number of a home; repeatable [all].")
def render_command(views: Path, output: Path, vision: Any, device: Any, size: int, homes: tuple[int, ...]) -> None:
    """Render VIEWS as home_N-M.png; pictures that are there already are kept."""
    output.mkdir(parents=True, exist_ok=True)
    for number, (plan, own) in enumerate(zip(home_plans(), read_json(views), strict=True), start=1):
        paths = [output / f"home_{number}-{index}.png" for index in range(1, len(own) + 1)]
        if (homes and number not in homes) or all(path.exists() for path in paths):
            continue
        asked = replace(plan, options=replace(plan.options, vision=vision, device=device))
        started = time.process_time()
        pictures = render([View(**view) for view in own], asked, default_cache(), size)
        for path, picture in zip(paths, pictures, strict=True):
            cv2.imwrite(str(path), picture[..., ::-1])
        click.echo(f"home_{number}: {time.process_time() - started:.0f} s CPU", err=True)


@main.command("sheet")
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="JPEG to write.")
@click.option("--largest", default=LARGEST, show_default=True, help="Size of the file (bytes).")
def sheet_command(folders: tuple[Path, ...], output: Path, largest: int) -> None:
    """Draw the sheet of FOLDERS."""
    try:
        write_jpeg(output, sheet(folders), largest)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None


if __name__ == "__main__":
    main()
