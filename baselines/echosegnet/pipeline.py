"""EchoSegnet (Sokolov, Bhosale, Zhu, 2024), as in its Figure 2; only the splats are trained.

    pictures, poses ──▶ 3D Gaussians                                train
    2D masks ─────────▶ votes ──▶ labelled Gaussians                lift
    binaural sound ───▶ which of them sound: the chosen ones        aisrm (official) or spatial
    2D masks ─────────▶ the chosen ones, cut back at mask edges     decompose (official)
    test poses ───────▶ masks                                       render

``official`` is what the released code does, in its order: the choice is made on the undecomposed centres, and only the
chosen Gaussians are decomposed. ``spatial`` is what we think it should do, and differs in four stages: votes weighted
by the splats' own transmittance, so that hidden points do not vote; fragments merged and the cluster chosen by the
likelihood of what both ears heard; no decomposition; masks visible-only. Both share the training.

Training reads `images/` with the cameras of `sparse/0`. Masks, given and made, belong to `input/`: they meet the
Gaussians through the camera of `input/` (`views.input_views`), at its own size, so that no mask is ever resampled.
Test frames give their pose (and split); neither their truth nor their pictures are read.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import flip_world
from avs3d_bench.schema import Scalar
from baselines.echosegnet import aisrm, clusters, spatial
from baselines.echosegnet.cache import Stages, digest
from baselines.echosegnet.decompose import decompose
from baselines.echosegnet.gaussians import Gaussians, write_ply
from baselines.echosegnet.rasteriser.default import Rasteriser
from baselines.echosegnet.render import amodal_mask, visible_mask
from baselines.echosegnet.sources import Mask, MaskSource
from baselines.echosegnet.train import Progress, TrainingSettings
from baselines.echosegnet.training_stage import trained
from baselines.echosegnet.views import View, input_views, load_views, test_views, train_views
from baselines.echosegnet.voting_stage import Variant, vote_share


@dataclass(frozen=True)
class Settings:
    """The settings of the pipeline.

    Attributes:
        variant: ``official`` or ``spatial``.
        refine: choose among clusters by sound (AISRM); without it every labelled Gaussian stays.
        voting_threshold: a Gaussian is labelled if more than this share of its votes is for it.
        decompose_every: decomposition looks at every so many train views.
        training: of the Gaussians.
    """

    variant: Variant = "official"
    refine: bool = True
    voting_threshold: float = 0.3
    decompose_every: int = 4
    training: TrainingSettings = field(default_factory=TrainingSettings)

    def __post_init__(self) -> None:
        if not 0.0 <= self.voting_threshold < 1.0:
            raise Avs3dError(f"voting threshold {self.voting_threshold}: expected 0 to below 1")


@dataclass(frozen=True, eq=False)
class Prediction:
    """The outcome for one observation.

    Attributes:
        masks: name of a test frame → (H, W) bool.
        points: (N, 3) float64 centres of the chosen Gaussians, metres, world of the dataset (Y up).
        figures: seconds per stage, numbers of Gaussians and clusters.
    """

    masks: dict[str, Mask]
    points: NDArray[np.float64]
    figures: dict[str, Scalar]


def predict(
    observation: Observation,
    source: MaskSource,
    rasteriser: Rasteriser,
    settings: Settings,
    folder: Path,
    *,
    progress: Progress | None = None,
) -> Prediction:
    """Run EchoSegnet on one observation; every stage's result is kept in ``folder`` and found there the next time.

    Raises:
        Avs3dError: if the observation lacks a sparse model, sound or masks, or training diverges or runs out of memory.
    """
    stages, clock = Stages(folder), _Clock()
    views = load_views(observation)
    with clock("train"):
        gaussians, key, full_at = trained(observation, views, rasteriser, settings.training, stages, progress)
    views = input_views(views)
    seen = train_views(views)
    with clock("masks"):
        masks = _masks(observation, seen, source)
    with clock("lift"):
        share = vote_share(gaussians, seen, masks, rasteriser, settings.variant, stages, key)
        labelled = share > settings.voting_threshold
        part = gaussians.select(torch.as_tensor(np.flatnonzero(labelled)))
    if settings.variant == "official":
        with clock("refine"):
            chosen, clusters = _refine_official(gaussians, part, seen, settings.refine, stages, key)
            part = part.select(chosen)
        with clock("decompose"):
            part = decompose(part, seen, masks, every=settings.decompose_every)
        with clock("render"):
            drawn = {view.name: amodal_mask(rasteriser, part, view) for view in test_views(views)}
    else:
        with clock("refine"):
            chosen, clusters = _refine_spatial(part, seen, settings.refine)
            part = part.select(chosen)
            index = np.flatnonzero(labelled)[chosen]
        with clock("render"):
            which = torch.zeros(len(gaussians), dtype=torch.bool, device=gaussians.device)
            which[torch.as_tensor(index, device=gaussians.device)] = True
            drawn = {view.name: visible_mask(rasteriser, gaussians, which, view) for view in test_views(views)}
    figures: dict[str, Scalar] = {
        "gaussians": len(gaussians),
        "memory_full_at": full_at,
        "labelled": int(labelled.sum()),
        "chosen": len(part),
        "clusters": clusters,
        **{f"{stage}_seconds": round(seconds, 2) for stage, seconds in clock.seconds.items()},
    }
    return Prediction(_complete(observation, drawn), flip_world(_numpy(part.means)), figures)


def _masks(observation: Observation, views: Sequence[View], source: MaskSource) -> list[Mask]:
    masks = []
    for view in views:
        mask = source.mask(view.frame)
        if mask.shape != (view.camera.height, view.camera.width):
            raise Avs3dError(
                f"{observation.key}/{view.name}: a mask of {mask.shape[1]}×{mask.shape[0]} pixels from {source.name}, "
                f"expected {view.camera.width}×{view.camera.height}"
            )
        masks.append(mask)
    if not any(mask.any() for mask in masks):
        raise Avs3dError(f"{observation.key}: {source.name} marks nothing in any train frame; nothing can be lifted")
    return masks


def clips_of(views: Sequence[View]) -> NDArray[np.float32]:
    """(T, 2, n) the binaural clips of the views.

    Raises:
        Avs3dError: if a frame has no clip, or another length than the first.
    """
    clips = [view.frame.audio() for view in views]
    for view, clip in zip(views, clips, strict=True):
        if clip.shape != clips[0].shape or clip.shape[0] != 2:
            where = f"{view.frame.observation.key}/{view.name}"
            raise Avs3dError(f"{where}: a clip of shape {clip.shape}, expected {clips[0].shape}, two ears")
    return np.stack(clips)


def _refine_official(
    scene: Gaussians, part: Gaussians, views: Sequence[View], refine: bool, stages: Stages, key: str
) -> tuple[NDArray[np.bool_], int]:
    """(n,) which of the labelled Gaussians stay, and how many clusters were kept.

    The audio intensity map and its centre are made of all Gaussians of the scene; the map is kept as a PLY file.
    """
    if not refine or not len(part):
        return np.ones(len(part), np.bool_), 0
    means = _numpy(scene.means)
    intensity = aisrm.audio_intensity_map(views, clips_of(views), means)
    ply = stages.path("audio", digest({"gaussians": key, "intensity": sha256(intensity.tobytes()).hexdigest()}), ".ply")
    if not ply.exists():
        write_ply(ply, scene, intensity)
    centre = aisrm.audio_centre(means, intensity)
    if centre is None:
        return np.ones(len(part), np.bool_), 0
    found = aisrm.refine(_numpy(part.means), centre)
    return found.staying, found.kept


def _refine_spatial(part: Gaussians, views: Sequence[View], refine: bool) -> tuple[NDArray[np.bool_], int]:
    if not refine or not len(part):
        return np.ones(len(part), np.bool_), 0
    points = _numpy(part.means)
    labels = clusters.candidates(points, eps=_reach(points))
    choice = spatial.choose(points, labels, views, clips_of(views))
    return (choice.chosen if choice.best >= 0 else np.ones(len(part), np.bool_)), len(choice.scores)


def _reach(points: NDArray[np.float64]) -> float:
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
