"""EchoSegnet (Sokolov, Bhosale, Zhu, 2024), as in its Figure 2; only the splats are trained.

    pictures, poses ──▶ 3D Gaussians                                train
    2D masks ─────────▶ votes ──▶ labelled Gaussians                lift
    binaural sound ───▶ which of them sound: the chosen ones        aisrm (official) or spatial
    2D masks ─────────▶ the chosen ones, cut back at mask edges     decompose (official)
    test poses ───────▶ masks                                       render

``official`` is what the released code does, in its order: the choice is made on the undecomposed centres, and only the
chosen Gaussians are decomposed. ``spatial`` is what we think it should do, and differs in four stages: votes weighted
by the splats' own transmittance, so that hidden points do not vote; fragments merged (those of the listener's marks
by other rules: `clusters.marked_candidates`) and the cluster chosen by the
likelihood of what both ears heard; no decomposition; masks visible-only. Both share the training.

On part_3 observations (part_3, `part_3`) ``official`` runs as it is. ``spatial`` infers which clusters sound in which
frames, and draws the active ones of each test frame: nothing where none is.

Training reads `images/` with the cameras of `sparse/0`. Masks, given and made, belong to `input/`: they meet the
Gaussians through the camera of `input/` (`views.input_views`), at its own size, so that no mask is ever resampled.
Test frames give their pose (and split), in part_3 their clip as well; neither their truth nor their pictures are read.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from avs3d_bench.contract.schema import Scalar
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import flip_world
from avs3d_bench.runtime.file_lock import wait_for_lock
from baselines.echosegnet import aisrm, clusters, spatial
from baselines.echosegnet.cache import Stages, digest
from baselines.echosegnet.decompose import decompose
from baselines.echosegnet.gaussians import Gaussians, write_ply
from baselines.echosegnet.heard_categories import Categories, class_votes, cluster_activity
from baselines.echosegnet.lift import marked_share
from baselines.echosegnet.network_masks import AnySource, KeptMasks, NetworkMasks
from baselines.echosegnet.rasteriser.default import Rasteriser
from baselines.echosegnet.render import amodal_mask, visible_mask
from baselines.echosegnet.sources import Mask, MaskSource
from baselines.echosegnet.train import Progress, TrainingSettings
from baselines.echosegnet.training_stage import trained
from baselines.echosegnet.views import RegisteredView, input_views, load_views, test_views, train_views
from baselines.echosegnet.voting_stage import Variant, count_votes
from baselines.sound_control import SoundControl, sounds_of

#: Successive train views whose votes are counted together in part_3 observations: programmes last for some seconds.
MASK_RUN = 8


#: A Gaussian is labelled if more than this share of its votes is for it: the paper's value.
VOTING_THRESHOLD = 0.3
#: The same for ``spatial`` where the listener made the masks (`is_relative`).
MARKED_THRESHOLD = 0.5


@dataclass(frozen=True)
class Settings:
    """The settings of the pipeline.

    Attributes:
        variant: ``official`` or ``spatial``.
        refine: choose among clusters by sound (AISRM); without it every labelled Gaussian stays.
        sound: what is heard when it chooses; a network that makes the masks is told by itself what it hears.
        voting_threshold: a Gaussian is labelled if more than this share of its votes is for it (`default_threshold`).
        decompose_every: decomposition looks at every so many train views.
        training: of the Gaussians.

    Examples:
        >>> Settings(variant="spatial", voting_threshold=0.4).training.iterations
        30000
    """

    variant: Variant = "official"
    refine: bool = True
    sound: SoundControl = "own"
    voting_threshold: float = VOTING_THRESHOLD
    decompose_every: int = 4
    training: TrainingSettings = field(default_factory=TrainingSettings)

    def __post_init__(self) -> None:
        if not 0.0 <= self.voting_threshold < 1.0:
            raise Avs3dError(f"voting threshold {self.voting_threshold}: expected 0 to below 1")


def default_threshold(variant: Variant, source: AnySource) -> float:
    """The voting threshold where none is asked for."""
    return MARKED_THRESHOLD if is_relative(variant, source) else VOTING_THRESHOLD


def is_relative(variant: Variant, source: AnySource) -> bool:
    """Whether the voting threshold is a share of what well-marked Gaussians have (`lift.marked_share`), not of 1.

    A network may recognise an object in a few frames only, so that no Gaussian of it has most of its votes. This holds
    where one object sounds all the time; in part_3 none may sound, and the threshold is a share of all votes.
    """
    return variant == "spatial" and isinstance(source, NetworkMasks)


@dataclass(frozen=True, eq=False)
class Prediction:
    """The outcome for one observation.

    Attributes:
        masks: name of a test frame → (H, W) bool.
        points: (N, 3) float64 centres of the chosen Gaussians, metres, world of the dataset (Y up).
        figures: seconds per stage, numbers of Gaussians and clusters.
        categories: name of a test frame of part_3 → (H, W) class ids; None elsewhere, and if the masks have no classes.

    Examples:
        >>> mask = np.zeros((48, 64), bool)
        >>> found = Prediction({"frame_000": mask}, points=np.zeros((0, 3)), figures={"gaussians": 0})
        >>> found.masks["frame_000"].shape, len(found.points), found.categories
        ((48, 64), 0, None)
    """

    masks: dict[str, Mask]
    points: NDArray[np.float64]
    figures: dict[str, Scalar]
    categories: dict[str, Categories] | None = None


def predict(
    observation: Observation,
    source: AnySource,
    rasteriser: Rasteriser,
    settings: Settings,
    folder: Path,
    *,
    progress: Progress | None = None,
) -> Prediction:
    """Run EchoSegnet on one observation; every stage's result is kept in ``folder`` and found there the next time.

    Args:
        observation: what to look at.
        source: of the train frames' 2D masks.
        rasteriser: draws Gaussians; its device is that of the training.
        settings: of the pipeline.
        folder: of intermediate results.
        progress: called while the Gaussians are trained.

    Raises:
        Avs3dError: if the observation lacks a sparse model, sound or masks, or training diverges or runs out of memory.

    Examples:
        >>> from pathlib import Path
        >>> from avs3d_bench import Dataset
        >>> from baselines.echosegnet.rasteriser.default import default_rasteriser
        >>> from baselines.echosegnet.train import DensityControl, TrainingSettings
        >>> few = TrainingSettings(iterations=20, density=DensityControl(pixels_per_gaussian=20))
        >>> observation = Dataset("data/demo")["part_1/apartment_1/bathroom/1"]
        >>> found = predict(observation, OracleMasks(), default_rasteriser("cpu"), Settings(training=few), Path("work"))
        >>> sorted(found.masks), found.points.shape[1]
        (['frame_000', 'frame_008'], 3)
    """
    stages, clock = Stages(folder), _Clock()
    views = load_views(observation)
    scene = observation.is_part_3
    # In part_3, and in what a network says, it may be that nothing is marked: then there is nothing to lift.
    may_be_empty = scene or isinstance(source, NetworkMasks)
    relative = is_relative(settings.variant, source) and not scene
    if isinstance(source, NetworkMasks):
        with clock("network"):
            source = source.found(observation, rasteriser.device, stages)
    with clock("masks"):
        masks = _masks(observation, train_views(input_views(views)), source) if may_be_empty else []
    if may_be_empty and not any(mask.any() for mask in masks):
        return _nothing(observation, source, clock)
    with clock("train"), wait_for_lock(stages.folder / "training.lock"):
        gaussians, key, full_at = trained(observation, views, rasteriser, settings.training, stages, progress)
    views = input_views(views)
    seen = train_views(views)
    if not may_be_empty:
        with clock("masks"):
            masks = _marked(observation, seen, source)
    by_frame = scene and settings.variant == "spatial" and settings.refine
    with clock("lift"):
        run = MASK_RUN if by_frame else None
        votes = count_votes(gaussians, seen, masks, rasteriser, settings.variant, stages, key, run=run)
        full = marked_share(votes.share, votes.total) if relative else 1.0
        labelled = votes.share > settings.voting_threshold * full
    lifted = _Lifted(gaussians, np.flatnonzero(labelled), views, seen, masks, source, settings.sound)
    if by_frame:
        answer = _by_frame(lifted, rasteriser, clock)
    elif settings.variant == "official":
        answer = _official(lifted, rasteriser, settings, stages, key, clock)
    else:
        answer = _one_cluster(lifted, rasteriser, settings, clock)
    if scene and not by_frame:
        answer = replace(answer, named=_one_class(answer.part, seen, source, answer.drawn))
    figures: dict[str, Scalar] = {
        "gaussians": len(gaussians),
        "memory_full_at": full_at,
        "labelled": int(labelled.sum()),
        "chosen": len(answer.part),
        "clusters": answer.clusters,
        **{f"{stage}_seconds": round(seconds, 2) for stage, seconds in clock.seconds.items()},
    }
    return Prediction(
        _complete(observation, answer.drawn), flip_world(_numpy(answer.part.means)), figures,
        _complete_classes(observation, answer.named),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Lifted:
    """Input of the stages after the lifting.

    Attributes:
        gaussians: of the whole scene.
        index: (n,) the labelled ones among them.
        views: all views, in the order of time.
        seen: the train views among them.
        masks: of the train views.
        source: of the masks.
        sound: what is heard.
    """

    gaussians: Gaussians
    index: NDArray[np.intp]
    views: Sequence[RegisteredView]
    seen: Sequence[RegisteredView]
    masks: list[Mask]
    source: MaskSource
    sound: SoundControl = "own"

    @cached_property
    def clips(self) -> NDArray[np.float32]:
        """(T, 2, n) what is heard in the train views."""
        return sounds_of([view.frame for view in self.seen], self.sound)

    @cached_property
    def part(self) -> Gaussians:
        """The labelled Gaussians."""
        return self.gaussians.select(torch.as_tensor(self.index))

    def selection(self, index: NDArray[np.intp]) -> torch.Tensor:
        """(N,) bool: the scene's Gaussians at ``index``."""
        which = torch.zeros(len(self.gaussians), dtype=torch.bool, device=self.gaussians.device)
        which[torch.as_tensor(index, device=self.gaussians.device)] = True
        return which


@dataclass(frozen=True, eq=False)
class _Answer:
    """Masks of the test views that have a pose, the chosen Gaussians, the number of clusters, and class ids."""

    drawn: dict[str, Mask]
    part: Gaussians
    clusters: int
    named: dict[str, Categories] | None = None


def _official(
    lifted: _Lifted, rasteriser: Rasteriser, settings: Settings, stages: Stages, key: str, clock: _Clock
) -> _Answer:
    with clock("refine"):
        chosen, kept = _refine_official(lifted, settings.refine, stages, key)
        part = lifted.part.select(chosen)
    with clock("decompose"):
        part = decompose(part, lifted.seen, lifted.masks, every=settings.decompose_every)
    with clock("render"):
        drawn = {view.name: amodal_mask(rasteriser, part, view) for view in test_views(lifted.views)}
    return _Answer(drawn, part, kept)


def _one_cluster(lifted: _Lifted, rasteriser: Rasteriser, settings: Settings, clock: _Clock) -> _Answer:
    with clock("refine"):
        chosen, count = _refine_spatial(lifted, settings.refine)
    with clock("render"):
        which = lifted.selection(lifted.index[chosen])
        drawn = {
            view.name: visible_mask(rasteriser, lifted.gaussians, which, view) for view in test_views(lifted.views)
        }
    return _Answer(drawn, lifted.part.select(chosen), count)


def _nothing(observation: Observation, source: MaskSource, clock: _Clock) -> Prediction:
    """Empty masks for every test frame, and no points."""
    figures: dict[str, Scalar] = dict.fromkeys(("gaussians", "labelled", "chosen", "clusters"), 0)
    figures |= {"memory_full_at": None, **{f"{stage}_seconds": round(s, 2) for stage, s in clock.seconds.items()}}
    classes = observation.is_part_3 and source.categories(observation.train[0]) is not None
    named: dict[str, Categories] | None = {} if classes else None
    return Prediction(_complete(observation, {}), np.zeros((0, 3)), figures, _complete_classes(observation, named))


@dataclass(frozen=True, eq=False)
class _Sounding:
    """Which clusters of Gaussians sound in each view.

    Attributes:
        labels: (n,) cluster of each labelled Gaussian; −1 for none.
        active: (T, K) whether a cluster sounds in each view.
        classes: (K,) class ids; None if the masks have none.
    """

    labels: NDArray[np.int64]
    active: NDArray[np.bool_]
    classes: NDArray[np.int64] | None

    @property
    def count(self) -> int:
        """Number of clusters."""
        return int(self.active.shape[1])

    @property
    def ever(self) -> NDArray[np.bool_]:
        """(n,) whether a labelled Gaussian's cluster sounds in any view."""
        return np.isin(self.labels, np.flatnonzero(self.active.any(axis=0)))


def _sounding(lifted: _Lifted) -> _Sounding:
    points = _numpy(lifted.part.means)
    labels = _candidates(lifted)
    classes = class_votes(points, labels, lifted.seen, lifted.source)
    if not len(labels) or labels.max() < 0:
        return _Sounding(labels, np.zeros((len(lifted.views), 0), np.bool_), classes)
    clips = sounds_of([view.frame for view in lifted.views], lifted.sound)
    return _Sounding(labels, cluster_activity(points, labels, lifted.views, clips).active, classes)


def _by_frame(lifted: _Lifted, rasteriser: Rasteriser, clock: _Clock) -> _Answer:
    """The clusters that sound in each test view, and their class ids if they are known."""
    with clock("refine"):
        sounding = _sounding(lifted)
    drawn: dict[str, Mask] = {}
    named: dict[str, Categories] = {}

    def draw(some: NDArray[np.intp], view: RegisteredView) -> Mask:
        which = lifted.selection(lifted.index[np.isin(sounding.labels, some)])
        return visible_mask(rasteriser, lifted.gaussians, which, view)

    with clock("render"):
        for number, view in enumerate(lifted.views):
            if view.split != "test":
                continue
            active = np.flatnonzero(sounding.active[number])
            drawn[view.name] = draw(active, view)
            if sounding.classes is not None:
                ids = np.zeros(drawn[view.name].shape, np.uint8)
                for value in np.unique(sounding.classes[active]):
                    ids[draw(active[sounding.classes[active] == value], view) & drawn[view.name]] = value
                named[view.name] = ids
    part = lifted.part.select(sounding.ever)
    return _Answer(drawn, part, sounding.count, None if sounding.classes is None else named)


def _one_class(
    part: Gaussians, seen: Sequence[RegisteredView], source: MaskSource, drawn: dict[str, Mask]
) -> dict[str, Categories] | None:
    """The masks with the class of the chosen Gaussians as a whole."""
    value = class_votes(_numpy(part.means), np.zeros(len(part), np.int64), seen, source)
    if value is None:
        return None
    return {name: (mask * int(value[0] if len(value) else 0)).astype(np.uint8) for name, mask in drawn.items()}


def _masks(observation: Observation, views: Sequence[RegisteredView], source: MaskSource) -> list[Mask]:
    masks = []
    for view in views:
        mask = source.mask(view.frame)
        if mask.shape != (view.camera.height, view.camera.width):
            raise Avs3dError(
                f"{observation.key}/{view.name}: a mask of {mask.shape[1]}×{mask.shape[0]} pixels from {source.name}, "
                f"expected {view.camera.width}×{view.camera.height}"
            )
        masks.append(mask)
    return masks


def _marked(observation: Observation, views: Sequence[RegisteredView], source: MaskSource) -> list[Mask]:
    masks = _masks(observation, views, source)
    if not any(mask.any() for mask in masks):
        raise Avs3dError(f"{observation.key}: {source.name} marks nothing in any train frame; nothing can be lifted")
    return masks


def _refine_official(lifted: _Lifted, refine: bool, stages: Stages, key: str) -> tuple[NDArray[np.bool_], int]:
    """(n,) which of the labelled Gaussians stay, and how many clusters were kept.

    The audio intensity map and its centre are made of all Gaussians of the scene; the map is kept as a PLY file.
    """
    scene, part = lifted.gaussians, lifted.part
    if not refine or not len(part):
        return np.ones(len(part), np.bool_), 0
    means = _numpy(scene.means)
    intensity = aisrm.audio_intensity_map(lifted.seen, lifted.clips, means)
    ply = stages.path("audio", digest({"gaussians": key, "intensity": sha256(intensity.tobytes()).hexdigest()}), ".ply")
    if not ply.exists():
        write_ply(ply, scene, intensity)
    centre = aisrm.audio_centre(means, intensity)
    if centre is None:
        return np.ones(len(part), np.bool_), 0
    found = aisrm.refine(_numpy(part.means), centre)
    return found.staying, found.kept


def _refine_spatial(lifted: _Lifted, refine: bool) -> tuple[NDArray[np.bool_], int]:
    """(n,) which of the labelled Gaussians stay, and the number of clusters."""
    points = _numpy(lifted.part.means)
    if not refine or not len(points):
        return np.ones(len(points), np.bool_), 0
    choice = spatial.choose(points, _candidates(lifted), lifted.seen, lifted.clips)
    return (choice.chosen if choice.best >= 0 else np.ones(len(points), np.bool_)), len(choice.scores)


def _candidates(lifted: _Lifted) -> NDArray[np.int64]:
    """(n,) the candidate objects among the labelled Gaussians."""
    points, marks = _numpy(lifted.part.means), lifted.source
    if not len(points):
        return np.zeros(0, np.int64)
    if not isinstance(marks, KeptMasks):
        return clusters.candidates(points, eps=reach(points))
    if lifted.seen[0].frame.observation.is_part_3:
        classes = class_votes(points, np.arange(len(points)), lifted.seen, marks)
        assert classes is not None, "a network names the class of what it marks"
    else:
        classes = np.full(len(points), marks.category(view.frame for view in lifted.seen))
    return clusters.marked_candidates(points, classes, eps=reach(points))


def reach(points: NDArray[np.float64]) -> float:
    """DBSCAN's radius, metres: the published 4 cm, or more where the splats are farther apart."""
    if len(points) <= aisrm.MIN_POINTS:
        return aisrm.EPS
    distance, _ = cKDTree(points).query(points, k=[aisrm.MIN_POINTS])
    return max(aisrm.EPS, float(np.median(distance)))


def _complete(observation: Observation, drawn: dict[str, Mask]) -> dict[str, Mask]:
    """A mask for every test frame: an empty one where COLMAP did not register the frame, so that it has no pose."""
    camera = observation.intrinsics
    return {
        frame.name: drawn.get(frame.name, np.zeros((camera.height, camera.width), np.bool_))
        for frame in observation.test
    }


def _complete_classes(observation: Observation, named: dict[str, Categories] | None) -> dict[str, Categories] | None:
    """The same for class ids."""
    camera = observation.intrinsics
    nothing = np.zeros((camera.height, camera.width), np.uint8)
    return None if named is None else {frame.name: named.get(frame.name, nothing) for frame in observation.test}


def _numpy(tensor: torch.Tensor) -> NDArray[np.float64]:
    return tensor.detach().cpu().numpy().astype(np.float64)


class _Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str) -> _Clock:
        self._stage, self._start = stage, time.perf_counter()
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        self.seconds[self._stage] = time.perf_counter() - self._start
