"""EchoSegnet on part_3 observations: any number of objects sound, each from time to time, or none does.

The released method keeps one cluster for all frames, and `official` does so here too. `spatial` infers for each frame
which of the clusters sound (`activity`), from the sound of all frames: a test frame's clip is an input of the task. A
mask that is drawn in some frames only, because its object is silent in the others, is lifted by runs of frames
(`voting_stage`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Observation
from baselines.echosegnet import activity, clusters
from baselines.echosegnet.activity import Activity
from baselines.echosegnet.lift import pixels_of
from baselines.echosegnet.sources import MaskSource
from baselines.echosegnet.views import RegisteredView

Categories = NDArray[np.uint8]


def work_folder(work: Path, observation: Observation) -> Path:
    """Where an observation's intermediate results lie: siblings, which share their pictures, share them, too."""
    return work / (observation.group_key)


def cluster_activity(
    points: NDArray[np.float64],
    labels: NDArray[np.int64],
    views: Sequence[RegisteredView],
    clips: NDArray[np.floating],
    *,
    largest: float = np.inf,
) -> Activity:
    """Which clusters sound in which of the views.

    Args:
        points: (N, 3) metres, the views' world.
        labels: (N,) clusters from 0 on; negative ones are no candidates.
        views: T of them, train and test, in the order of time.
        clips: (T, 2, n) their sound.
        largest: number of points beyond which a cluster is no likelier for being larger.
    """
    count = int(labels.max(initial=-1)) + 1
    places = [clusters.representatives(points[labels == k]) for k in range(count)]
    size = np.bincount(labels[labels >= 0], minlength=count).clip(max=largest).astype(np.float64)
    rotation = np.stack([view.rotation for view in views])
    position = np.stack([view.position for view in views])
    return activity.infer(places, rotation, position, clips, size=size)


def class_votes(
    points: NDArray[np.float64], labels: NDArray[np.int64], views: Sequence[RegisteredView], source: MaskSource
) -> NDArray[np.int64] | None:
    """(K,) the class id of each cluster, by the pixels that its points meet in the masks; 0 where none is marked.

    Args:
        points: (N, 3) metres, the views' world.
        labels: (N,) clusters from 0 on; negative ones are none.
        views: train views.
        source: of the masks.

    Returns:
        None if the source of the masks names no classes.
    """
    count = int(labels.max(initial=-1)) + 1
    votes = np.zeros((count, 256), np.int64)
    member = labels >= 0
    for view in views:
        named = source.categories(view.frame)
        if named is None:
            return None
        u, v, seen = pixels_of(points[member], view)
        np.add.at(votes, (labels[member][seen], named[v[seen], u[seen]]), 1)
    votes[:, 0] = 0
    return np.asarray(votes.argmax(axis=1), np.int64)
