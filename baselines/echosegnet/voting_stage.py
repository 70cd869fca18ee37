"""The second stage: the masks' votes for every Gaussian, counted once and kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.echosegnet import lift
from baselines.echosegnet.cache import Stages, arrays_digest, digest, software_digest
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.lift import Mask
from baselines.echosegnet.rasteriser.contributions import contributions
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.views import RegisteredView

Variant = Literal["official", "spatial"]


@dataclass(frozen=True, eq=False)
class Votes:
    """The votes of the masks.

    Attributes:
        share: (N,) share of each Gaussian's votes that are for it; 0 for Gaussians without votes.
        total: (N,) all votes of each Gaussian; of ``spatial``, how much it shows in the views.
    """

    share: NDArray[np.float64]
    total: NDArray[np.float64]


def count_votes(
    gaussians: Gaussians,
    views: Sequence[RegisteredView],
    masks: Sequence[Mask],
    rasteriser: Rasteriser,
    variant: Variant,
    stages: Stages,
    key: str,
    *,
    run: int | None = None,
) -> Votes:
    """Count the votes for N Gaussians, or take them from where they are kept.

    ``official``: one vote per train view that has the centre in its picture. ``spatial``: a view's vote weighs as much
    as the Gaussian contributes to its pixels, so that hidden points do not vote.

    Args:
        gaussians: N of them.
        views: train views in the order of time.
        masks: one for each.
        rasteriser: what draws.
        variant: of the votes.
        stages: where they are kept.
        key: of the Gaussians' file.
        run: where an object is marked in some frames only, the largest share over runs of so many successive views in
            which the Gaussian has votes enough, instead of that over all views. None: over all. Only ``spatial``.
    """
    software = software_digest(rasteriser)
    said = {"gaussians": key, "masks": arrays_digest(masks), "votes": variant, "software": software}
    if run is not None:
        return _largest_share(gaussians, views, masks, rasteriser, stages, said, run)
    name = digest(said)
    kept = stages.load_arrays("votes", name)
    if kept is None:
        if variant == "official":
            counts = lift.vote_counts(_numpy(gaussians.means), zip(views, masks, strict=True))
        else:
            counts = _weighted_votes(gaussians, views, masks, rasteriser)
        kept = dict(zip(("inside", "total"), counts, strict=True))
        stages.save_arrays("votes", name, kept)
    return Votes(lift.vote_share(kept["inside"], kept["total"]), kept["total"].astype(np.float64))


#: A run counts for a Gaussian if it has at least this share of the votes of the run in which it has most.
_ENOUGH_VOTES = 0.1


def _largest_share(
    gaussians: Gaussians,
    views: Sequence[RegisteredView],
    masks: Sequence[Mask],
    rasteriser: Rasteriser,
    stages: Stages,
    said: dict[str, str],
    run: int,
) -> Votes:
    name = digest(said | {"run": run})
    kept = stages.load_arrays("votes", name)
    if kept is None:
        counts = [
            _weighted_votes(gaussians, views[start : start + run], masks[start : start + run], rasteriser)
            for start in range(0, len(views), run)
        ]
        inside, total = (np.stack(column) for column in zip(*counts, strict=True))
        share = np.where(total >= _ENOUGH_VOTES * total.max(axis=0), lift.vote_share(inside, total), 0.0)
        kept = {"share": share.max(axis=0), "total": total.sum(axis=0)}
        stages.save_arrays("votes", name, kept)
    return Votes(kept["share"].astype(np.float64), kept["total"].astype(np.float64))


def _weighted_votes(
    gaussians: Gaussians, views: Sequence[RegisteredView], masks: Sequence[Mask], rasteriser: Rasteriser
) -> tuple[NDArray[Any], NDArray[Any]]:
    sums = torch.zeros(len(gaussians), 2, device=gaussians.device)
    for view, mask in zip(views, masks, strict=True):
        marked = torch.as_tensor(mask, device=gaussians.device).to(gaussians.means)
        sums += contributions(rasteriser, gaussians, view, torch.stack([marked, torch.ones_like(marked)], dim=-1))
    inside, total = _numpy(sums).T
    return inside, total


def _numpy(tensor: Tensor) -> NDArray[np.float64]:
    return tensor.detach().cpu().numpy().astype(np.float64)
