"""The sparse points as witnesses: what each frame must show where a point of `sparse/0` is seen.

A point was taken from one pixel of one frame, with that pixel's colour and depth. Where it projects to a pixel's centre
to within a millionth of a pixel, that frame is (almost surely) its origin, and the pixel must have its colour exactly.
In the other frames of its track the surface is the same one, so the instance is the same, and the colour is similar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.formats.colmap import ColmapModel
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.validation.findings import Findings

#: Distance from the pixel's centre below which a sighting counts as the point's origin (pixels).
AT_CENTRE = 1e-6


@dataclass(frozen=True, eq=False)
class Sightings:
    """The points of `sparse/0` that one frame sees, those inside the picture only.

    Attributes:
        point: (n,) int64 row of each point in the model's list.
        position: (n, 3) float64 its place, world, metres.
        colour: (n, 3) uint8 its colour.
        row, column: (n,) int64 the pixel that shows it.
        origin: (n,) bool whether the point was taken from this very pixel.
    """

    point: NDArray[np.int64]
    position: NDArray[np.float64]
    colour: NDArray[np.uint8]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    origin: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.point)


def sightings_by_frame(model: ColmapModel, camera: Intrinsics) -> dict[str, Sightings]:
    """The sightings of every image, by the name of the image's file without its extension.

    Where a point has several origins (frames with equal poses), none counts: the pictures may differ.
    """
    order = np.argsort(model.points.ids)
    ids = model.points.ids[order]
    out: dict[str, Sightings] = {}
    times = np.zeros(len(ids), dtype=np.int64)
    for image in model.images:
        found = np.searchsorted(ids, image.point_ids)
        known = found < len(ids)
        known[known] = ids[found[known]] == image.point_ids[known]
        pixels = image.pixels
        with np.errstate(invalid="ignore"):
            known &= (pixels >= 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1)
        point, pixels = order[found[known]], pixels[known]
        column, row = np.floor(pixels).astype(np.int64).T
        origin = np.asarray((np.abs(pixels - np.floor(pixels) - 0.5) < AT_CENTRE).all(axis=1), dtype=np.bool_)
        np.add.at(times, point[origin], 1)
        stem = image.name.rpartition(".")[0]
        out[stem] = Sightings(point, model.points.positions[point], model.points.colours[point], row, column, origin)
    return {
        name: Sightings(s.point, s.position, s.colour, s.row, s.column, s.origin & (times[s.point] == 1))
        for name, s in out.items()
    }


class Labels:
    """Collects which instance every sighting shows, to hold the frames to each other at the end."""

    #: Sightings of one instance that one frame may contradict: a number, and a share.
    ALLOWED = (1, 0.02)

    def __init__(self) -> None:
        self._frames: list[str] = []
        self._rows: list[tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.uint16]]] = []

    def add(self, frame: str, sightings: Sightings, ids: NDArray[np.uint16]) -> None:
        """Note the ids (H, W) of a frame around its sightings."""
        padded = np.pad(ids, 1, mode="edge")
        around = np.stack(
            [padded[sightings.row + dy, sightings.column + dx] for dy in range(3) for dx in range(3)], axis=1
        )
        self._frames.append(frame)
        self._rows.append((sightings.point, sightings.origin, around.reshape(len(sightings), 9)))

    def contradictions(self) -> list[tuple[str, int, int, int]]:
        """(frame, instance, contradicted, seen) where a frame does not show an instance that the others show there.

        A point's instance is that of its origin; else the one that most frames show. The frame's pixel or one beside
        it must belong to it.
        """
        if not self._rows:
            return []
        point, origin, around = (np.concatenate(parts) for parts in zip(*self._rows, strict=True))
        frame = np.repeat(np.arange(len(self._frames)), [len(row[0]) for row in self._rows])
        label = _labels(point, origin, around[:, 4])
        wrong = (around != label[point][:, None]).all(axis=1)
        out = []
        least, share = self.ALLOWED
        for number, name in enumerate(self._frames):
            mine = frame == number
            for instance in np.unique(label[point[mine & wrong]]).tolist():
                same = mine & (label[point] == instance)
                seen, bad = int(same.sum()), int((same & wrong).sum())
                if bad > max(least, share * seen):
                    out.append((name, int(instance), bad, seen))
        return out


def _labels(point: NDArray[np.int64], origin: NDArray[np.bool_], ids: NDArray[np.uint16]) -> NDArray[np.int64]:
    """The instance of every point, by its row in the model."""
    size = int(point.max(initial=-1)) + 1
    best = np.zeros(size, dtype=np.int64)
    label = np.zeros(size, dtype=np.int64)
    for instance in np.unique(ids).tolist():
        # The word of the origin outweighs that of all others.
        votes = np.bincount(point[ids == instance], minlength=size)
        votes += 1_000_000 * np.bincount(point[origin & (ids == instance)], minlength=size)
        better = votes > best
        best[better], label[better] = votes[better], instance
    return label


def check_labels(labels: Labels, findings: Findings) -> None:
    """Name the frames whose instance ids contradict those that other frames have on the same sparse points."""
    for name, instance, wrong, seen in labels.contradictions():
        what = f"instance {instance}" if instance else "no instance"
        text = f"{wrong} of {seen} sparse points are on {what} in other frames, but not here"
        findings.add(f"{layout.INSTANCE_MASKS}/{name}.png", text)


def colour_problem(rgb: NDArray[np.uint8], sightings: Sightings) -> str | None:
    """The problem of a picture (H, W, 3), told by the colours of the points that it shows."""
    seen = rgb[sightings.row, sightings.column].astype(np.int16)
    off = np.abs(seen - sightings.colour).max(axis=1, initial=0)
    wrong, total = int((off[sightings.origin] > 0).sum()), int(sightings.origin.sum())
    if wrong:
        return f"{wrong} of {total} sparse points that were taken from it have another colour than its pixels"
    far = int((off > SIMILAR).sum())
    if len(sightings) >= LEAST_SIGHTINGS and far > MOST_UNLIKE * len(sightings):
        return f"{far} of {len(sightings)} sparse points have a colour more than {SIMILAR} levels from its pixels"
    return None


#: Levels of a channel by which a point may look different in another frame (texture filtering, edges) …
SIMILAR = 40
#: … and the share of a frame's sightings that may differ by more; measured: 5 % at most.
MOST_UNLIKE = 0.3
#: Fewer sightings are no sample.
LEAST_SIGHTINGS = 20


def depth_problem(depth: NDArray[np.float32], z: NDArray[np.float64], sightings: Sightings) -> str | None:
    """The problem of a depth map (H, W), told by the points that were taken from it; ``z`` (n,) is theirs."""
    mine = sightings.origin & (z < MOST_DEPTH)
    found = depth[sightings.row, sightings.column]
    wrong = int((np.abs(found - z)[mine] > DEPTH_STEP).sum())
    return f"{wrong} of {int(mine.sum())} sparse points taken from the frame have another depth" if wrong else None


#: Depth is stored in millimetres, rounded; depth beyond the range of 16 bits is stored as 0 (metres).
DEPTH_STEP, MOST_DEPTH = 1.1e-3, 65.0


def sample(rng_seed: Sequence[int], items: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """At most ``count`` of ``items``, the same ones on every run."""
    if len(items) <= count:
        return items
    return np.sort(np.random.default_rng(rng_seed).choice(items, count, replace=False))
