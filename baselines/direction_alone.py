"""Direction alone, no category: of all objects that the network sees, the one from whose place the sound comes.

What a sound is called takes no part: the row shows what two ears and a walk say by themselves. In part_1 and part_2:

1. The network marks objects of any category in the train frames, from the pictures alone.
2. A voxel is part of an object if the frames that look at it agree that its pixel is one: a visual hull (A. Laurentini,
   "The visual hull concept for silhouette-based image understanding", IEEE Trans. PAMI 16 (1994) 150-162), softened,
   since furniture hides objects from some of the frames. Voxels of one category that touch are a candidate.
3. The likelihood of what both ears heard along the walk chooses among the candidates (`echosegnet.spatial`).
4. In a test frame, those marked components are kept that the chosen voxels are seen in.

In part_3 sources come and go, so that each test frame is judged by its own second: the component whose lateral angle
has most votes of the onsets (`listener.direction`), if it has nearly as many as the best angle of all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter
from baselines.echosegnet import spatial, views
from baselines.listener.masks import Answer, class_map, log_odds
from baselines.listener.predict import BATCH, ListenerMethod, camera_of, clip_of
from baselines.networks.device import inference
from baselines.sound_control import SAID

#: Most train frames that are looked at, evenly over the walk.
MOST_VIEWS = 40
#: Side of a voxel, how far beyond the walk voxels reach, and how far above and below the ears (m).
VOXEL, REACH, ABOVE, BELOW = 0.1, 4.0, 1.2, 1.7
#: A voxel is part of an object if at least so many frames look at it, and of these this share sees an object.
LEAST_VIEWS, AGREED = 3, 0.45
#: Probability above which a pixel is an object of a category.
OBJECT = 0.4
#: In part_3, votes of a component re those of the best angle.
NEARLY = 0.8


@dataclass(frozen=True)
class DirectionMethod:
    """What marks test frames.

    Attributes:
        model: of `listener.predict.load_method`.
    """

    model: ListenerMethod

    def predictions(self, frames: Sequence[Frame]) -> list[Prediction]:
        """Masks of the test frames of one observation."""
        if frames[0].observation.is_part_3:
            return [self._by_itself(frame, answer) for frame, answer in zip(frames, self._seen(frames), strict=True)]
        found = self._chosen(frames)
        answers = self._seen(frames)
        if found is None:
            return [Prediction(np.zeros(frame.rgb().shape[:2], np.bool_)) for frame in frames]
        points, category = found
        poses = {view.name: view for view in views.input_views(views.load_views(frames[0].observation))}
        return [
            Prediction(self._of_points(frame, answer, points, category, poses.get(frame.name)))
            for frame, answer in zip(frames, answers, strict=True)
        ]

    def _seen(self, frames: Sequence[Frame]) -> list[Answer]:
        """The network's answers; what it hears is not used."""
        out: list[Answer] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            sounds = np.stack([clip_of(frame, self.model.hearing) for frame in part])
            cameras = np.asarray([camera_of(frame) for frame in part], np.float32)
            with inference(self.model.device, f"{part[0].observation.path}/{part[0].name}"):
                out += self.model.answers([frame.rgb() for frame in part], sounds, cameras)
        return out

    def _chosen(self, frames: Sequence[Frame]) -> tuple[NDArray[np.float64], int] | None:
        """(N, 3) voxels of the candidate that sounds, and its category (0-based); None without any candidate."""
        walk = views.train_views(views.input_views(views.load_views(frames[0].observation)))
        walk = tuple(walk[i] for i in np.linspace(0, len(walk) - 1, min(len(walk), MOST_VIEWS)).round().astype(int))
        points, labels, categories = candidates(walk, self._seen([view.frame for view in walk]))
        if not len(points):
            return None
        clips = np.stack([clip_of(view.frame, self.model.hearing) for view in walk])
        choice = spatial.choose(points, labels, walk, clips)
        return points[choice.chosen], int(categories[choice.chosen][0])

    def _of_points(
        self, frame: Frame, answer: Answer, points: NDArray[np.float64], category: int, view: Any
    ) -> NDArray[np.bool_]:
        """(H, W) the components of a category that points are seen in."""
        likely = answer.classes[1 + category]
        count, number = cv2.connectedComponents((likely > OBJECT).astype(np.uint8), connectivity=8)
        touched = np.zeros(count, np.bool_)
        if view is not None:
            cells, ahead = projected(points, view, likely.shape)
            hit, times = np.unique(number[cells[ahead, 1], cells[ahead, 0]], return_counts=True)
            touched[hit[times >= max(1, times.sum() // 20)]] = True
        touched[0] = False
        kept = np.where(touched[number], likely, 1e-6).astype(np.float32)
        marker = replace(self.model, threshold=OBJECT)
        return marker.mask(replace(answer, mask=log_odds(kept)), frame.rgb())

    def _by_itself(self, frame: Frame, answer: Answer) -> Prediction:
        """A frame of part_3 by its own second."""
        import torch

        from baselines.listener import direction, features

        picture, clip = frame.rgb(), clip_of(frame, self.model.hearing)
        empty = np.zeros(picture.shape[:2], np.bool_)
        objects = (1 - answer.classes[0]).astype(np.float32)
        count, number = cv2.connectedComponents((objects > OBJECT).astype(np.uint8), connectivity=8)
        audible = 10 * np.log10(np.square(clip).mean(axis=1).max() + 1e-20) > AUDIBLE_LEVEL_DB
        if count < 2 or not audible:
            return Prediction(empty, np.zeros_like(empty, np.uint8))
        response = direction.steered_response(features.spectra(torch.from_numpy(clip)[None]))[0, direction.VOTES]
        votes = response.numpy()
        angles = direction.pixel_angles(torch.tensor([camera_of(frame)]), objects.shape)[0].numpy()
        at = np.interp(angles, direction.angle_grid().numpy(), votes)
        mean = np.array([at[number == each].mean() for each in range(1, count)])
        best = int(mean.argmax())
        if mean[best] < NEARLY * votes.max():
            return Prediction(empty, np.zeros_like(empty, np.uint8))
        kept = np.where(number == 1 + best, objects, 1e-6).astype(np.float32)
        mask = replace(self.model, threshold=OBJECT).mask(replace(answer, mask=log_odds(kept)), picture)
        every = replace(answer, audible=np.ones_like(answer.audible))
        return Prediction(mask, class_map(mask, every))


def candidates(
    walk: Sequence[views.RegisteredView], answers: Sequence[Answer]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Voxels of objects: points (N, 3), label of the candidate (N,), category (N,), 0-based.

    Args:
        walk: views of train frames.
        answers: of the network for them.
    """
    positions = np.stack([view.position for view in walk])
    low, high = positions.min(axis=0) - REACH, positions.max(axis=0) + REACH
    low[1], high[1] = positions[:, 1].min() - ABOVE, positions[:, 1].max() + BELOW
    axes = [np.arange(a, b, VOXEL) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points = grid.reshape(-1, 3)
    seen = np.zeros(len(points))
    likely = np.zeros((len(points), len(answers[0].classes) - 1), np.float32)
    for view, answer in zip(walk, answers, strict=True):
        cells, ahead = projected(points, view, answer.classes.shape[1:])
        seen += ahead
        likely[ahead] += answer.classes[1:, cells[ahead, 1], cells[ahead, 0]].T
    share = likely / np.maximum(seen, 1)[:, None]
    category = share.argmax(axis=1)
    inside = (share.max(axis=1) > AGREED) & (seen >= LEAST_VIEWS)
    labels, count = np.full(len(points), -1, np.int64), 0
    for each in np.unique(category[inside]):
        volume = (inside & (category == each)).reshape(grid.shape[:3])
        number, found = label(volume, np.ones((3, 3, 3)))
        number = number.reshape(-1)
        labels[number > 0] = number[number > 0] + count - 1
        count += found
    chosen = labels >= 0
    return points[chosen], labels[chosen], category[chosen]


def projected(
    points: NDArray[np.float64], view: views.RegisteredView, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Cells (N, 2) (column, row) of an answer of some shape in which points are seen, and (N,) whether they are."""
    camera, (height, width) = view.camera, shape
    at = (points - view.position) @ view.rotation
    ahead = at[:, 2] > 0.2
    depth = np.where(ahead, at[:, 2], 1.0)
    x = (camera.fx * at[:, 0] / depth + camera.cx) / camera.width * width
    y = (camera.fy * at[:, 1] / depth + camera.cy) / camera.height * height
    ahead &= (x >= 0) & (x < width) & (y >= 0) & (y < height)
    cells = np.stack([np.where(ahead, x, 0), np.where(ahead, y, 0)], axis=1).astype(np.int64)
    return cells, ahead


def write_direction(
    dataset: Dataset,
    path: str | Path,
    model: ListenerMethod,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
    workers: int | None = 1,
) -> SubmissionWriter:
    """Write the masks of the test frames by direction alone; see `listener.predict.write_listener`."""
    method = Method(
        ", ".join(filter(None, ("Direction alone, no category", SAID[model.hearing]))),
        DirectionMethod(model).predictions,
        notes=f"objects by the picture alone, chosen by both ears; weights {model.digest[:12]}",
        entry="baselines.direction_alone:write_direction",
    )
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress, workers=workers)
