"""What the listener sees of the same objects in a home and in a scan, and what the background has to do with it.

    python -m benchmarks.listener_background SCAN.glb -o FILE.json

Ten objects are placed in the living room of apartment 1 of `open-s34-o7` and in the living room of the scan, and looked
at from the same heights and distances, off the middle of the picture, where walls allow it. IoU of the object with the
class map (one look, no sound), of the picture as it is and with all but the object blurred (`BLUR`). Deterministic.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.formats.files import write_json
from avs3d_bench.geometry import Intrinsics, Pose
from generators import Home, Renderer, objects
from generators.assets.catalogue import variants
from generators.core.scene import Room

Picture = NDArray[np.uint8]

#: Category → how many of its models.
MODELS = {"telephone": 3, "clock": 4, "vacuum_cleaner": 3}
#: Camera above the object (degrees), its distance (m), around the way to the middle of the room (degrees).
HEIGHTS, DISTANCES, SIDEWAYS = (5, 20, 35), (1.2, 1.8), (0, 25, -25, 50, -50, 75, -75)
#: Pictures from one height and distance; pixels that an object has at least; distance of the camera from walls (m).
EACH, LEAST, AWAY = 2, 60, 0.1
#: Side of a picture, standard deviations of the blur and of the edge between object and background (pixels).
SIDE, BLUR, EDGE = 252, 3.0, 0.7
#: IoU above which an object counts as found; pictures in a batch.
FOUND, BATCH = 0.3, 8


@dataclass(frozen=True)
class View:
    """A picture of an object.

    Attributes:
        category: of the object.
        height: of the camera above it (degrees).
        rgb: (H, W, 3).
        truth: (H, W) where the object is.
    """

    category: str
    height: int
    rgb: Picture
    truth: NDArray[np.bool_]


def eyes(middle: NDArray[np.float64], room: Room, height: int, distance: float) -> Iterator[NDArray[np.float64]]:
    """Places in the room from which the object at ``middle`` is seen at a height and distance."""
    to_centre = (np.asarray(room.low) + np.asarray(room.high)) / 2 - middle
    base, up = np.arctan2(to_centre[0], to_centre[2]), np.radians(height)
    for sideways in SIDEWAYS:
        around = base + np.radians(sideways)
        way = np.array([np.sin(around) * np.cos(up), np.sin(up), np.cos(around) * np.cos(up)])
        eye = middle + distance * way
        if (eye > np.asarray(room.low) + AWAY).all() and (eye < np.asarray(room.high) - AWAY).all():
            yield eye


def views(home: Home, room: Room, category: str, number: int) -> Iterator[View]:
    """Pictures of one object, placed in the room."""
    model = objects.build(category, variants(category)[number].rpartition("/")[2], seed=number + 1)
    scene = home.place(model, room=room.name, rng=number)
    renderer, camera, rng = Renderer(scene), Intrinsics.from_fov(SIDE), np.random.default_rng(number)
    middle = scene.placements[0].part(1).mesh.bounds.mean(axis=0)
    for height in HEIGHTS:
        for distance in DISTANCES:
            count = 0
            for eye in eyes(middle, room, height, distance):
                way = middle - eye
                yaw = np.arctan2(-way[0], -way[2]) + rng.uniform(-0.4, 0.4)
                pitch = np.arcsin(way[1] / distance) + rng.uniform(-0.2, 0.3)
                frame = renderer.frame(Pose.from_yaw(eye, yaw, pitch), camera)
                truth = frame.instance_ids > 0
                if truth.sum() >= LEAST and count < EACH:
                    count += 1
                    yield View(category, height, frame.rgb, truth)
                if count == EACH:
                    break


def background_blurred(view: View) -> Picture:
    """The picture with all but the object out of focus."""
    share = cv2.GaussianBlur(view.truth.astype(np.float32), (0, 0), EDGE)[..., None]
    return (view.rgb * share + cv2.GaussianBlur(view.rgb, (0, 0), BLUR) * (1 - share)).astype(np.uint8)


def overlaps(method: Any, seen: Sequence[View], pictures: Sequence[Picture]) -> list[float]:
    """IoU of each object with what the network's class map says is of its category."""
    from baselines.networks.device import inference

    found = []
    for first in range(0, len(seen), BATCH):
        part = pictures[first : first + BATCH]
        silence = np.zeros((len(part), 2, 44_100), np.float32)
        cameras = np.full((len(part), 4), 0.5, np.float32)  # 90°, see `direction.pixel_angles`
        with inference(method.device, "the views"):
            answers = method.answers(part, silence, cameras, looks="one")
        for view, answer in zip(seen[first : first + BATCH], answers, strict=True):
            classes = np.stack([cv2.resize(each, (SIDE, SIDE)) for each in answer.classes]).argmax(axis=0)
            marked = classes == CATEGORIES.index(view.category) + 1
            found.append(float((marked & view.truth).sum() / (marked | view.truth).sum()))
    return found


def summary(seen: Sequence[View], iou: Sequence[float]) -> dict[str, Any]:
    """Category → mean IoU, share found, by height; with the number of pictures and the mean share of them."""
    groups: dict[str, list[tuple[View, float]]] = defaultdict(list)
    for view, value in zip(seen, iou, strict=True):
        groups[view.category].append((view, value))
    return {
        category: {
            "pictures": len(some),
            "IoU": round(float(np.mean([value for _, value in some])), 3),
            "found": round(float(np.mean([value > FOUND for _, value in some])), 3),
            "IoU by height": {
                str(height): round(float(np.mean(these)), 3)
                for height in HEIGHTS
                if (these := [value for view, value in some if view.height == height])
            },
            "share of the picture": round(float(np.mean([view.truth.mean() for view, _ in some])), 5),
        }
        for category, some in groups.items()
    }


@click.command()
@click.argument("scan", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="File of the figures.")
@click.option("--models", type=click.IntRange(1), default=4, show_default=True, help="At most, of each category.")
def main(scan: Path, output: Path, models: int) -> None:
    """Measure both rooms."""
    from baselines.listener.predict import load_method

    method = load_method(None, device="cpu")
    homes = {"home": Home.apartment(11, name="apartment_1"), "scan": Home.from_scan(scan)}
    figures: dict[str, Any] = {"weights": method.digest}
    for name, home in homes.items():
        room = next(room for room in home.rooms if room.name == "living_room")
        wanted = [(category, n) for category, count in MODELS.items() for n in range(min(count, models))]
        seen = [view for category, n in wanted for view in views(home, room, category, n)]
        for label, pictures in {
            "as it is": [view.rgb for view in seen],
            "background blurred": [background_blurred(view) for view in seen],
        }.items():
            figures[f"{name}, {label}"] = found = summary(seen, overlaps(method, seen, pictures))
            click.echo(f"{name}, {label}: { {key: value['IoU'] for key, value in found.items()} }")
    write_json(output, figures)


if __name__ == "__main__":
    main()
