"""Of all objects that the network sees, the one from whose place the sound comes: by direction alone, or named too.

With ``direction`` what a sound is called takes no part: it shows what two ears and a walk say by themselves. With
``both`` the candidate's category counts as well, by how probable it is that it is heard. In part_1 and part_2:

1. The network marks objects of any category in the train frames, from the pictures alone.
2. A voxel is part of an object if the frames that look at it agree that its pixel is one: a visual hull (A. Laurentini,
   "The visual hull concept for silhouette-based image understanding", IEEE Trans. PAMI 16 (1994) 150-162), softened,
   since furniture hides objects from some of the frames. Voxels of one category that touch are a candidate.
3. The likelihood of what both ears heard along the walk (`echosegnet.spatial`), times the probability that the
   candidate's category is heard to the power of `NAMES`, chooses among the candidates.
4. In a test frame, those marked components are kept that the chosen voxels are seen in.

In part_3 sources come and go, and some are in no picture. There `echosegnet.activity` says which candidates sound in
which second: each is on or off for some seconds, and places without a candidate explain what none of them does.
Twins stand side by side there and share a hull behind them, so voxels that touch are divided where the agreement of the
frames has several peaks: the high leaves of a component tree (R. Jones, "Connected filtering and segmentation using
component trees", Computer Vision and Image Understanding 75 (1999) 215-228).

`DirectionMarker` marks train frames for a method that lifts masks into 3D (`--masks listener --listener-answer
direction`): in part_1 and part_2 the chosen object, in part_3 every object, among which that method chooses by sound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, find_objects, label

from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter
from baselines.echosegnet import spatial, views
from baselines.echosegnet.heard_categories import cluster_activity
from baselines.listener.marks import ListenerMarker, load_marker
from baselines.listener.masks import log_odds, logit
from baselines.listener.predict import ListenerMethod, clip_of
from baselines.sound_control import SoundControl, named

if TYPE_CHECKING:
    import torch

#: Most train frames that are looked at, evenly over the walk.
MOST_VIEWS = 40
#: Side of a voxel, how far beyond the walk voxels reach, and how far above and below the ears (m).
VOXEL, REACH, ABOVE, BELOW = 0.1, 4.0, 1.2, 1.7
#: A voxel is part of an object if at least so many frames look at it, and of these this share sees an object.
LEAST_VIEWS, AGREED = 3, 0.45
#: In part_3, objects that touch are divided by levels of this step, into parts of at least so many voxels; a part is an
#: object if its peak has this share of the highest one, and from this share of its own peak on a voxel is its core.
STEP, LEAST_PART, HIGH = 0.05, 4, 0.85
#: Probability above which a pixel is an object of a category, and where the object is known to be.
OBJECT, OBJECT_INSIDE = 0.4, 0.2
#: A candidate is likelier than another by its number of voxels, which tells an object from crumbs, but no object is
#: likelier than another for being larger than this (voxels).
LARGE = 30
#: Whether what a sound is called counts.
Cues = Literal["direction", "both"]
#: What names count beside directions: effective number of independent frames of a walk; weight in a second of part_3,
#: and the probability of a category there at which its name says nothing.
NAMES, NAMES_OF_A_SECOND, HEARD_PRIOR = 4.0, 0.5, 0.3
#: Probabilities that a category is heard are cut here: the network is never that sure.
LEAST_HEARD = 0.02
#: Probability from which on a candidate is marked in a second of part_3.
DECIDED = 0.5
#: How far around its core a candidate of part_3 may be seen (share of a picture's side), and the share of a component
#: that must lie there for all of it to be marked; of others what lies there is.
NEAR, MOSTLY = 3 / 378, 0.6


@dataclass(frozen=True)
class DirectionMethod:
    """What marks test frames.

    Attributes:
        model: of `listener.predict.load_method`.
        cues: see `Cues`.
        kept: candidates of the last pictures, and what was found for the last sound; shared with copies that have
            other cues or hear something else.
    """

    model: ListenerMethod
    cues: Cues = "direction"
    kept: dict[str, Any] = field(default_factory=dict, repr=False)

    def predictions(self, frames: Sequence[Frame]) -> list[Prediction]:
        """Masks of the test frames of one observation, with class ids in part_3."""
        walk = views.input_views(views.load_views(frames[0].observation))
        if frames[0].observation.is_part_3:
            return self._scenes(frames, walk)
        train = some_of(views.train_views(walk))
        found = self._chosen(train, self._classes(train))
        if found is None:
            return [Prediction(np.zeros(frame.rgb().shape[:2], np.bool_)) for frame in frames]
        return [Prediction(mask) for mask in self._masks(frames, self.model.class_maps(frames), walk, *found)]

    def train_masks(self, frames: Sequence[Frame]) -> Iterator[NDArray[np.uint8]]:
        """(H, W) class ids of what sounds in each of the train frames of one observation of part_1 or part_2."""
        walk = views.input_views(views.load_views(frames[0].observation))
        maps = self.model.class_maps(frames)
        by_name = dict(zip([frame.name for frame in frames], maps, strict=True))
        train = some_of(views.train_views(walk))
        found = self._chosen(train, [by_name[view.name] for view in train])
        if found is None:
            return (np.zeros(frame.rgb().shape[:2], np.uint8) for frame in frames)
        masks = self._masks(frames, maps, walk, *found)
        return (np.where(mask, np.uint8(1 + found[1]), np.uint8(0)) for mask in masks)

    def _classes(self, walk: Sequence[views.RegisteredView]) -> list[NDArray[np.float32]]:
        """What the pictures of views show, see `ListenerMethod.class_maps`."""
        return self.model.class_maps([view.frame for view in walk])

    def _names(self, walk: Sequence[views.RegisteredView]) -> NDArray[np.float64]:
        """(T, categories) logarithm of the probability that each is heard in views, by name or as what has no name."""
        return np.log(np.maximum(self.model.heard([view.frame for view in walk]).astype(np.float64), LEAST_HEARD))

    def _masks(
        self,
        frames: Sequence[Frame],
        maps: Sequence[NDArray[np.float32]],
        walk: Sequence[views.RegisteredView],
        points: NDArray[np.float64],
        category: int,
    ) -> Iterator[NDArray[np.bool_]]:
        """(H, W) of each frame, of the candidate that `_chosen` returned."""
        poses = {view.name: view for view in walk}
        for frame, classes in zip(frames, maps, strict=True):
            yield self._of_points(frame, classes, points, category, poses.get(frame.name))

    def _chosen(
        self, walk: Sequence[views.RegisteredView], maps: Sequence[NDArray[np.float32]]
    ) -> tuple[NDArray[np.float64], int] | None:
        """(N, 3) voxels of the candidate that sounds, and its category (0-based); None without any candidate or sound.

        Args:
            walk: train views.
            maps: classes of their pixels.
        """
        points, labels, categories, _, choice = self._by_sound(walk, lambda: self._choice(walk, maps))
        if choice is None or not choice.heard:
            return None
        size = np.array([(labels == label).sum() for label in choice.labels])
        score = choice.scores + np.log(np.minimum(size, LARGE))
        if self.cues == "both":
            named = category_of_each(labels, categories)[choice.labels]
            score = score + NAMES * self._names(walk).mean(axis=0)[named]
        chosen = labels == choice.labels[score.argmax()]
        return points[chosen], int(categories[chosen][0])

    def _once(self, name: str, which: tuple[str, ...], found: Callable[[], Any]) -> Any:
        """What ``found`` returns for the observation, and more, that ``which`` says; computed once."""
        if self.kept.get(name, ((),))[0] != which:
            self.kept[name] = which, found()
        return self.kept[name][1]

    def _by_sound(self, walk: Sequence[views.RegisteredView], found: Callable[[], Any]) -> Any:
        """What ``found`` returns for the sound of a walk."""
        return self._once("sound", (str(walk[0].frame.observation.path), self.model.hearing), found)

    def _candidates(self, walk: Sequence[views.RegisteredView], maps: Sequence[NDArray[np.float32]]) -> tuple[Any, ...]:
        """`candidates` of a walk; siblings, which have the same pictures, have the same."""
        of = walk[0].frame.observation
        found: tuple[Any, ...] = self._once(
            "pictures", (str(of.root), of.group_key), lambda: candidates(walk, maps, divided=of.is_part_3)
        )
        return found

    def _choice(self, walk: Sequence[views.RegisteredView], maps: Sequence[NDArray[np.float32]]) -> tuple[Any, ...]:
        """The candidates and the choice among them by place; None without any."""
        points, labels, *rest = self._candidates(walk, maps)
        choice = spatial.choose(points, labels, walk, self._clips(walk)) if len(points) else None
        return points, labels, *rest, choice

    def _clips(self, walk: Sequence[views.RegisteredView]) -> NDArray[np.float32]:
        """(T, 2, n) the sound of views."""
        return np.stack([clip_of(view.frame, self.model.hearing) for view in walk])

    def _scenes(self, frames: Sequence[Frame], walk: Sequence[views.RegisteredView]) -> list[Prediction]:
        """Frames of part_3: the candidates that sound in each second."""
        train = some_of(views.train_views(walk))
        used = sorted([*train, *views.test_views(walk)], key=lambda view: view.name)
        maps = dict(zip([view.name for view in used], self._classes(used), strict=True))
        points, labels, categories, core, odds = self._by_sound(
            walk, lambda: self._odds(train, used, [maps[view.name] for view in train])
        )
        sounding = self._sounding(labels, categories, odds, used)
        named, place = category_of_each(labels, categories), {view.name: number for number, view in enumerate(used)}
        out = []
        for frame in frames:
            ids = np.zeros(frame.rgb().shape[:2], np.uint8)
            for number in np.flatnonzero(sounding[place[frame.name]]) if frame.name in place else ():
                category, view = int(named[number]), used[place[frame.name]]
                one = points[(labels == number) & core]
                ids[self._of_core(frame, maps[frame.name][1 + category], one, view)] = 1 + category
            out.append(Prediction(ids > 0, ids))
        return out

    def _odds(
        self,
        train: Sequence[views.RegisteredView],
        used: Sequence[views.RegisteredView],
        maps: Sequence[NDArray[np.float32]],
    ) -> tuple[Any, ...]:
        """The candidates of part_3 and (T, K) log-odds by place that each sounds in each of the T views ``used``.

        Args:
            train: views that candidates are made of.
            used: in the order of time.
            maps: classes of the pixels of ``train``.
        """
        points, labels, *rest = self._candidates(train, maps)
        if not len(points):
            return points, labels, *rest, np.zeros((len(used), 0), np.float32)
        posterior = cluster_activity(points, labels, used, self._clips(used), largest=LARGE).posterior
        return points, labels, *rest, log_odds(posterior.astype(np.float32))

    def _sounding(
        self,
        labels: NDArray[np.int64],
        categories: NDArray[np.int64],
        odds: NDArray[np.float32],
        used: Sequence[views.RegisteredView],
    ) -> NDArray[np.bool_]:
        """(T, K) whether each candidate sounds in each view; arguments from `_odds`, and its views."""
        if self.cues == "both" and len(labels):
            heard = log_odds(np.exp(self._names(used)).astype(np.float32), LEAST_HEARD)
            heard = heard[:, category_of_each(labels, categories)]
            odds = odds + NAMES_OF_A_SECOND * (heard - logit(HEARD_PRIOR))
        return np.asarray(odds > logit(DECIDED))

    def _of_points(
        self, frame: Frame, classes: NDArray[np.float32], points: NDArray[np.float64], category: int, view: Any
    ) -> NDArray[np.bool_]:
        """(H, W) the components of a category that points are seen in; without any, where it is likely among them."""
        likely = classes[1 + category]
        count, number = cv2.connectedComponents((likely > OBJECT).astype(np.uint8), connectivity=8)
        touched, inside = np.zeros(count, np.bool_), np.zeros(likely.shape, np.bool_)
        if view is not None:
            cells, ahead = projected(points, view, likely.shape)
            hit, times = np.unique(number[cells[ahead, 1], cells[ahead, 0]], return_counts=True)
            touched[hit[times >= max(1, times.sum() // 20)]] = True
            inside = silhouette(points, view, likely.shape)
        touched[0] = False
        # One cell more, so that edges lie between cells where the probabilities say.
        near = dilated(touched[number], 1)
        kept, threshold = np.where(near, likely, 1e-6).astype(np.float32), OBJECT
        if not touched.any():
            kept, threshold = np.where(inside, likely, 1e-6).astype(np.float32), OBJECT_INSIDE
        return replace(self.model, threshold=threshold).mask(log_odds(kept), frame.rgb())

    def _of_core(
        self, frame: Frame, likely: NDArray[np.float32], points: NDArray[np.float64], view: Any
    ) -> NDArray[np.bool_]:
        """(H, W) what the picture shows of a category where points are seen: objects that touch share a component."""
        inside = dilated(silhouette(points, view, likely.shape), max(1, round(NEAR * likely.shape[1])))
        count, number = cv2.connectedComponents((likely > OBJECT_INSIDE).astype(np.uint8), connectivity=8)
        area, within = (np.bincount(each.reshape(-1), minlength=count) for each in (number, number[inside]))
        whole = within >= MOSTLY * area
        near = dilated((number > 0) & (inside | whole[number]), 1)
        kept = log_odds(np.where(near, likely, 1e-6).astype(np.float32))
        return replace(self.model, threshold=OBJECT_INSIDE).mask(kept, frame.rgb())


@dataclass(frozen=True)
class DirectionMarker(ListenerMarker):
    """Marks objects of train frames whatever they are called: a `ListenerMarker` with the answer ``direction``."""

    @property
    def entry(self) -> str:
        """The module that computes the masks (see `avs3d_bench.runtime.provenance`)."""
        return "baselines.direction_alone:DirectionMarker"

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        return f"answer {self.which}, weights {self.digest[:12]}"

    def mark(self, frames: Sequence[Frame], device: torch.device) -> Iterator[NDArray[np.uint8]]:
        """(H, W) class ids of each of the train frames of one observation, in their order.

        Raises:
            Avs3dError: if the weights are others than those of ``digest``, or a frame's files are missing or damaged.
        """
        method = self.method(device)
        if not frames[0].observation.is_part_3:
            return DirectionMethod(method).train_masks(frames)
        every = replace(method, share=None)
        return (_objects(every, *each) for each in zip(frames, method.class_maps(frames), strict=True))


def _objects(method: ListenerMethod, frame: Frame, classes: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(H, W) class ids of all objects: of each marked pixel the most probable one, since objects may touch."""
    mask = method.mask(log_odds(1 - classes[0]), frame.rgb())
    ids = (1 + classes[1:].argmax(axis=0)).astype(np.uint8)
    return np.where(mask, cv2.resize(ids, mask.shape[::-1], interpolation=cv2.INTER_NEAREST), np.uint8(0))


def load_direction_marker(weights: Path | None = None, *, hearing: SoundControl = "own") -> DirectionMarker:
    """A marker with the digest of its weights; raises as `listener.marks.load_marker`."""
    return DirectionMarker(**vars(load_marker(weights, which="direction", hearing=hearing)))


def some_of(walk: Sequence[views.RegisteredView]) -> tuple[views.RegisteredView, ...]:
    """At most `MOST_VIEWS` of the views, evenly over the walk."""
    return tuple(walk[i] for i in np.linspace(0, len(walk) - 1, min(len(walk), MOST_VIEWS)).round().astype(int))


def category_of_each(labels: NDArray[np.int64], categories: NDArray[np.int64]) -> NDArray[np.int64]:
    """(K,) the category of each candidate 0 … K − 1, whose voxels all have it; arguments from `candidates`."""
    return np.asarray(categories[np.unique(labels, return_index=True)[1]])


def candidates(
    walk: Sequence[views.RegisteredView], maps: Sequence[NDArray[np.float32]], *, divided: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Voxels of objects: points (N, 3), label of the candidate (N,), category (N,), 0-based, whether in its core (N,).

    Args:
        walk: views of train frames.
        maps: classes of their pixels, (8, n, n) each.
        divided: whether voxels that touch may be several candidates (`objects`); else each is one, and all is core.
    """
    positions = np.stack([view.position for view in walk])
    low, high = positions.min(axis=0) - REACH, positions.max(axis=0) + REACH
    low[1], high[1] = positions[:, 1].min() - ABOVE, positions[:, 1].max() + BELOW
    axes = [np.arange(a, b, VOXEL) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points = grid.reshape(-1, 3)
    seen = np.zeros(len(points))
    likely = np.zeros((len(points), len(maps[0]) - 1), np.float32)
    for view, classes in zip(walk, maps, strict=True):
        cells, ahead = projected(points, view, classes.shape[1:])
        seen += ahead
        likely[ahead] += classes[1:, cells[ahead, 1], cells[ahead, 0]].T
    share = likely / np.maximum(seen, 1)[:, None]
    category, agreed = share.argmax(axis=1), np.where(seen >= LEAST_VIEWS, share.max(axis=1), 0)
    labels, inner, count = np.full(len(points), -1, np.int64), np.zeros(len(points), np.bool_), 0
    for each in np.unique(category[agreed > AGREED]):
        volume = np.where(category == each, agreed, 0).reshape(grid.shape[:3])
        for voxels, core in objects(volume) if divided else touching(volume):
            where = np.ravel_multi_index(tuple(voxels.T), volume.shape)
            labels[where], inner[where] = count, core
            count += 1
    chosen = labels >= 0
    return points[chosen], labels[chosen], category[chosen], inner[chosen]


def touching(volume: NDArray[np.floating]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Voxels above `AGREED` that touch, see `objects`: of each piece their indices (n, 3), and (n,) True."""
    for start, own in _pieces(volume):
        voxels = np.argwhere(own)
        yield voxels + start, np.ones(len(voxels), np.bool_)


def objects(volume: NDArray[np.floating]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Objects of one category: of each the indices (n, 3) of its voxels, and (n,) which are its core.

    Voxels above `AGREED` that touch (26 neighbours) are one object, or as many as `_peaks` has high parts: each voxel
    belongs to the nearest of these, whose voxels near its maximum are the core.

    Args:
        volume: (X, Y, Z) how far the frames agree on each voxel, 0 to 1.

    Examples:
        >>> volume = np.full((9, 3, 3), 0.5)  # a hull that two objects share
        >>> volume[:3], volume[6:] = 0.8, 0.9
        >>> [(len(voxels), int(core.sum())) for voxels, core in objects(volume)]
        [(45, 27), (36, 27)]
    """
    for start, own in _pieces(volume):
        peaks, part = list(_peaks(own, AGREED)), np.zeros(own.shape, np.int64)
        highest = max(own[peak].max() for peak in peaks)
        for count, peak in enumerate((peak for peak in peaks if own[peak].max() >= HIGH * highest), 1):
            part[peak] = count
        nearest = distance_transform_edt(part == 0, return_distances=False, return_indices=True)
        basin = np.where(own > 0, part[tuple(nearest)], 0)
        for one in range(1, part.max() + 1):
            core = (part == one) & (own >= HIGH * own[part == one].max())
            voxels = np.argwhere(basin == one)
            yield voxels + start, core[tuple(voxels.T)]


def _pieces(volume: NDArray[np.floating]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.floating]]]:
    """Of each piece of voxels above `AGREED` that touch: where its box begins, and the box, 0 outside of the piece."""
    number, _ = label(volume > AGREED, np.ones((3, 3, 3)))
    for each, box in enumerate(find_objects(number), 1):
        yield np.array([side.start for side in box]), np.where(number[box] == each, volume[box], 0)


def _peaks(volume: NDArray[np.floating], level: float) -> Iterator[NDArray[np.bool_]]:
    """The parts into which the voxels above a level that touch are divided: each is a mask of ``volume``.

    The level rises until there are two parts of `LEAST_PART` voxels or more, and each of these is divided in turn.
    """
    for higher in np.arange(level + STEP, 1, STEP):
        number, _ = label(volume > higher, np.ones((3, 3, 3)))
        large = np.flatnonzero(np.bincount(number.reshape(-1))[1:] >= LEAST_PART) + 1
        if len(large) > 1:
            for each in large:
                yield from _peaks(np.where(number == each, volume, 0), float(higher))
            return
    yield volume > level


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


def silhouette(points: NDArray[np.float64], view: views.RegisteredView, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Cells (h, w) of an answer of some shape that voxels around points (N, 3) cover, whatever stands before them."""
    half = VOXEL / 2
    corners = np.stack(np.meshgrid(*([-half, half],) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    out = np.zeros(shape, np.uint8)
    for eight in points[:, None] + corners:
        cells, ahead = projected(eight, view, shape)
        if ahead.any():
            cv2.fillConvexPoly(out, cv2.convexHull(cells[ahead].astype(np.int32)), 1)
    return out.astype(np.bool_)


def dilated(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """A mask (H, W) and what is at most ``reach`` pixels from it, along rows and columns."""
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0


def write_direction(
    dataset: Dataset,
    path: str | Path,
    model: ListenerMethod,
    *,
    cues: Cues = "direction",
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
    workers: int | None = 1,
) -> SubmissionWriter:
    """Write the masks of the test frames by direction, and by name with ``both``; see `predict.write_listener`."""
    name = {"direction": "Direction alone, no category", "both": "Listener, name and direction"}[cues]
    method = Method(
        named(name, model.hearing),
        DirectionMethod(model, cues).predictions,
        notes=f"objects by the picture alone, chosen by both ears{' and by name' * (cues == 'both')}; "
        f"weights {model.digest[:12]}",
        entry="baselines.direction_alone:write_direction",
    )
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress, workers=workers)
