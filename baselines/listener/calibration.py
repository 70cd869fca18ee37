"""Temperatures and the rule of a trained network, from homes that it has not seen.

A network that is trained to the end is too sure of itself. One number for the mask and one for what is heard, by which
log-odds are divided (Guo et al., "On calibration of modern neural networks", ICML 2017, §4.2), and a bias of the mask
(J. Platt, "Probabilistic outputs for support vector machines", 1999) make the probabilities mean what they say; they
minimise the negative log-likelihood. The network answers as it does when it predicts: to pictures with sounds that they
really have, with several looks. The frames that show what sounds count as much, all together, as those that do not.
Those of part_3, with twins in most pictures, are of another kind: for the mask they count only where there are no
others, and then without a bias.

The rule of the mask (`masks.marked`) is the one with the largest IoU less false marks; the threshold of a category is
that with the largest IoU. All are written into the file of weights, so that no test set takes part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from cv2 import INTER_LINEAR, resize
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit
from torch import Tensor
from torch.nn.functional import avg_pool2d, binary_cross_entropy_with_logits

from avs3d_bench.runtime.parallel import available_cores
from baselines.listener.augment import Bank, unpack
from baselines.listener.masks import highest, log_odds, marked
from baselines.listener.predict import BATCH, ListenerMethod
from baselines.listener.shards import ShardStore
from baselines.listener.validation import spread, validate, validation_views
from baselines.listener.weights import Calibration

#: Thresholds to choose from, of the frame's peak and of a category; shares of the peak.
CHOICES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
#: Shares of the peak to choose from, and one that no log-odds of a mask are below.
SHARES, _LEAST = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8), 1e-9
#: Most frames that are looked at, half of them with something that sounds in view, if there are enough.
MOST_FRAMES = 1536
#: Cells on a side of a mask by which temperatures are fitted.
MOST_CELLS = 126
#: Log-odds are counted in bins of this width, up to this on both sides.
_WIDTH, _MOST = 0.05, 25.0
#: Temperatures that are tried lie within this factor of 1, biases within this of 0.
_FACTOR, _MOST_BIAS = 12.0, 10.0
#: Calibration error counts what has at least this probability, in bins of this width.
LEAST_PROBABILITY, ERROR_BIN = 0.1, 0.05


@dataclass
class OddsHistogram:
    """Log-odds and how often they were true, counted in bins.

    Attributes:
        count: (bins,) float64 how many there are.
        true: (bins,) float64 the sum of their truths, each between 0 and 1.
    """

    count: Tensor
    true: Tensor

    @classmethod
    def empty(cls, device: Any) -> OddsHistogram:
        """Without anything in it."""
        bins = round(2 * _MOST / _WIDTH)
        zeros = torch.zeros(bins, dtype=torch.float64, device=device)
        return cls(zeros, zeros.clone())

    def add(self, odds: Tensor, truth: Tensor, weights: Tensor | None = None) -> None:
        """Count log-odds and their truths, of one shape, each as often as its weight says (None: once)."""
        bins = ((odds.flatten().double() + _MOST) / _WIDTH).floor().clamp(0, len(self.count) - 1).long()
        each = torch.ones_like(bins, dtype=torch.float64) if weights is None else weights.flatten().double()
        self.count.index_add_(0, bins, each)
        self.true.index_add_(0, bins, each * truth.flatten().double())

    @property
    def odds(self) -> Tensor:
        """(bins,) the middle of each bin."""
        return (torch.arange(len(self.count), dtype=torch.float64, device=self.count.device) + 0.5) * _WIDTH - _MOST

    def error(self) -> float:
        """Expected calibration error of what has a probability of at least `LEAST_PROBABILITY`."""
        probability = torch.sigmoid(self.odds)
        chosen = probability >= LEAST_PROBABILITY
        bins = (probability / ERROR_BIN).long()
        size = int(1 / ERROR_BIN) + 1
        sums = [
            torch.zeros(size, dtype=torch.float64, device=bins.device).index_add_(0, bins, values * chosen)
            for values in (self.count, self.true, self.count * probability)
        ]
        gap = (sums[2] - sums[1]).abs().sum()
        return round(float(gap / sums[0].sum().clamp(min=1e-9)), 4)


@dataclass
class LookedAt:
    """What a network says to N frames with their own sounds, look by look, and the truth.

    Attributes:
        sounds: (N,) their numbers in the store.
        weights: (N,) for the mask; with the same sum over frames that show what sounds and over those that do not.
        masks, shares: (N, looks, n, n) log-odds of the mask; (N, n, n) its truth, as shares of the same cells.
        names, audible: (N, looks, categories + 1) log-odds of what is heard; (N, categories + 1) its truth.
    """

    sounds: NDArray[np.int64]
    weights: Tensor
    masks: Tensor
    shares: Tensor
    names: Tensor
    audible: Tensor

    def error(self, warm: float, bias: float = 0.0) -> float:
        """Expected calibration error of the mask at a temperature, see `OddsHistogram.error`."""
        histogram = OddsHistogram.empty(self.masks.device)
        odds = mean_of_looks(self.masks, warm, bias)
        histogram.add(odds, self.shares, self.weights[:, None, None].expand_as(odds))
        return histogram.error()


def calibrate(
    network: Any, store: ShardStore, fabric: Any, *, every_home: bool = False
) -> tuple[Calibration, dict[str, Any]]:
    """Temperatures and the rule, and the figures that they were chosen by.

    Args:
        network: the (averaged) `Listener`.
        store: what is stored.
        fabric: a launched `lightning.fabric.Fabric`.
        every_home: of the store; else those that training keeps for validation.
    """
    views = list(range(len(store.table.homes))) if every_home else validation_views(store.table)
    training, method = network.training, ListenerMethod(network.eval(), fabric.device, "")
    seen = look_at(method, store, balanced(store, views))
    # The bias of pictures with twins is far from that of others (docs/listener-trials.md).
    biased = any(not store.table.keys[sound].startswith("part_3/") for sound in seen.sounds)
    every = max(1, seen.masks.shape[-1] // MOST_CELLS)
    few, true = seen.masks[..., ::every, ::every], seen.shares[..., ::every, ::every]
    warm, bias = temperature(few, true, seen.weights, biased=biased)
    named, _ = temperature(seen.names, seen.audible, torch.ones_like(seen.weights), biased=False)
    by_rule = rule_figures(method, store, seen, mean_of_looks(seen.masks, warm, bias).cpu().numpy())
    network.train(training)
    threshold, share = best_rule(by_rule)
    by_class = validate(network, store, Bank(store, fabric.device), fabric, CHOICES, spread(views))
    category = _best([row["category_iou"] for row in by_class], Calibration().category)
    calibration = Calibration(warm, named, threshold, category, share, bias, method.finest)
    figures = {
        "pictures": len(seen.sounds), "error_before": seen.error(1.0), "error": seen.error(warm, bias),
        "by_rule": by_rule,
        "category_iou": {str(choice): row["category_iou"] for choice, row in zip(CHOICES, by_class, strict=True)},
    }  # fmt: skip
    return calibration, figures


def balanced(store: ShardStore, views: Sequence[int]) -> NDArray[np.int64]:
    """Sounds of pictures, `MOST_FRAMES` at most, spread evenly; half of them show what sounds, if there are enough."""
    all_of_them = np.flatnonzero(np.isin(store.table.view, views))
    shown = store.marked[all_of_them] > 0
    kinds = [spread(all_of_them[where].tolist(), MOST_FRAMES // 2) for where in (shown, ~shown)]
    return np.sort(np.concatenate(kinds).astype(np.int64))


def look_at(method: ListenerMethod, store: ShardStore, sounds: NDArray[np.int64]) -> LookedAt:
    """What a method without calibration says to frames of a store.

    Args:
        method: whose looks.
        store: what is stored.
        sounds: numbers of the frames' sounds.
    """
    table, masks, names = store.table, [], []
    # Those of the truth: the finest look has more, which would take gigabytes.
    cells = (store.table.side // 2,) * 2
    for start in range(0, len(sounds), BATCH):
        part = sounds[start : start + BATCH]
        views = [table.view[sound] for sound in part]
        cameras = np.asarray([table.cameras[view] for view in views], np.float32)
        clips = np.asarray(store.sounds[part], np.float32)
        with torch.inference_mode():
            found = method.every_look([store.pictures[view] for view in views], clips, cameras, "several")
        for each in found:
            masks.append(np.stack([resize(answer.mask, cells, interpolation=INTER_LINEAR) for answer in each]))
            names.append(log_odds(np.stack([[*answer.audible, answer.unknown] for answer in each])))
    truth = unpack(torch.from_numpy(store.masks[sounds]))
    weights = equal_weights(store.marked[sounds] > 0, [table.keys[sound] for sound in sounds])
    arrays = (weights, np.stack(masks), avg_pool2d(truth.float(), 2), np.stack(names), table.heard(sounds))
    return LookedAt(sounds, *(torch.as_tensor(each, dtype=torch.float32, device=method.device) for each in arrays))


def equal_weights(shown: NDArray[np.bool_], keys: Sequence[str]) -> NDArray[np.float64]:
    """(N,) weights of frames; see `LookedAt`. Frames of part_3 have none where there are others.

    Examples:
        >>> shown = np.array([True, False, False, True])
        >>> equal_weights(shown, ["part_1/a/b/1/f", "part_1/a/b/1/g", "part_2/a/b/1/f", "part_3/a/b/1/f"]).tolist()
        [1.0, 0.5, 0.5, 0.0]
    """
    used = np.array([not key.startswith("part_3/") for key in keys])
    used |= not used.any()
    counts = np.where(shown, (used & shown).sum(), (used & ~shown).sum())
    return np.asarray(used / np.maximum(counts, 1))


def mean_of_looks(odds: Tensor, warm: float, bias: float = 0.0) -> Tensor:
    """(N, …) log-odds of the mean of the probabilities of several looks (N, looks, …), as `masks.agreed` takes it."""
    # Look by look: all at once are several GiB of some thousand frames.
    total = torch.zeros_like(odds[:, 0])
    for look in odds.unbind(1):
        total += ((look - bias) / warm).sigmoid_()
    return (total / odds.shape[1]).logit_(eps=1e-6)


def temperature(odds: Tensor, truth: Tensor, weights: Tensor, *, biased: bool = True) -> tuple[float, float]:
    """Temperature and bias of each look with which the looks' mean has the smallest negative log-likelihood.

    Args:
        odds: (N, looks, …) log-odds of each look.
        truth: (N, …) between 0 and 1.
        weights: (N,).
        biased: else the bias is 0.

    Examples:
        >>> odds = torch.randn(1000, 1, 50, generator=torch.Generator().manual_seed(0))
        >>> truth = torch.bernoulli(odds[:, 0].sigmoid(), generator=torch.Generator().manual_seed(1))
        >>> warm, bias = temperature(3 * odds + 2, truth, torch.ones(1000))
        >>> round(warm), round(bias)
        (3, 2)
    """

    def loss(found: Any) -> float:
        mean = mean_of_looks(odds, math.exp(found[0]), found[1] if biased else 0.0)
        each = binary_cross_entropy_with_logits(mean, truth, reduction="none").flatten(1).mean(dim=1)
        return float((each * weights).sum() / weights.sum())

    bounds = [(-math.log(_FACTOR), math.log(_FACTOR)), (-_MOST_BIAS, _MOST_BIAS)]
    start = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 1.0]])
    how: Any = {"initial_simplex": start if biased else start[:2, :1], "xatol": 1e-3, "fatol": 1e-9, "maxiter": 120}
    found = minimize(loss, start[0, : 1 + biased], method="Nelder-Mead", bounds=bounds[: 1 + biased], options=how)
    return round(math.exp(found.x[0]), 3), round(float(found.x[1]), 3) if biased else 0.0


def rule_figures(
    method: ListenerMethod, store: ShardStore, seen: LookedAt, odds: NDArray[np.float32]
) -> list[dict[str, float]]:
    """Of each rule the mean IoU of frames that show what sounds, and the share of the others with something marked.

    Args:
        method: without calibration.
        store: what is stored.
        seen: frames of it.
        odds: (N, n, n) calibrated log-odds of the mask.
    """
    truths: NDArray[np.bool_] = unpack(torch.from_numpy(store.masks[seen.sounds])).numpy()
    pictures = (store.pictures[store.table.view[sound]] for sound in seen.sounds)

    def one(frame: tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.bool_]]) -> Any:
        cells, picture, truth = frame
        return peaks_and_ious([method.odds(cells, picture)], truth[None])

    # Most of the time passes in OpenCV, which lets other threads run.
    with ThreadPoolExecutor(available_cores()) as pool:
        found = list(pool.map(one, zip(odds, pictures, truths, strict=True)))
    peaks, ious = map(np.concatenate, zip(*found, strict=True))
    return figures_of_rules(peaks, ious, np.asarray(truths.any(axis=(1, 2))))


def peaks_and_ious(
    odds: Iterable[NDArray[np.float32]], truths: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of N frames the probability of the peak (N,), and the IoU of the mask with each of `SHARES` (N, shares).

    Args:
        odds: (H, W) log-odds of each frame's pixels.
        truths: (N, H, W) the true masks.
    """
    peaks, ious = np.zeros(len(truths)), np.zeros((len(truths), len(SHARES)))
    for number, (large, truth) in enumerate(zip(odds, truths, strict=True)):
        peaks[number] = expit(highest(large))
        for place, share in enumerate(SHARES):
            mask = marked(large, _LEAST, share)
            ious[number, place] = np.sum(mask & truth) / max(int(np.sum(mask | truth)), 1)
    return peaks, ious


def figures_of_rules(
    peaks: NDArray[np.float64], ious: NDArray[np.float64], shown: NDArray[np.bool_]
) -> list[dict[str, float]]:
    """Of each rule the mean IoU of frames that show what sounds, and the share of the others with something marked.

    Args:
        peaks: (N,) of `peaks_and_ious`.
        ious: (N, shares) of the same.
        shown: (N,) whether something that sounds is in view.
    """
    return [
        {"threshold": threshold, "share": share, "iou": _mean((ious[:, place] * (peaks > threshold))[shown]),
         "false": _mean((peaks > threshold)[~shown])}
        for threshold in CHOICES for place, share in enumerate(SHARES)
    ]  # fmt: skip


def best_rule(figures: Sequence[dict[str, float]]) -> tuple[float, float]:
    """Threshold and share of the rule with the largest IoU less false marks; the first of the best.

    Args:
        figures: of `rule_figures`.
    """
    best = max(figures, key=worth)
    return best["threshold"], best["share"]


def worth(figures: Mapping[str, float]) -> float:
    """What a rule is chosen by: IoU less the share of frames that show nothing that sounds and are marked.

    Args:
        figures: of one rule, of `rule_figures`.
    """
    return figures["iou"] - figures["false"]


def _mean(values: NDArray[Any]) -> float:
    """0 without any."""
    return round(float(values.mean()), 4) if len(values) else 0.0


def _best(worth: Sequence[float | None], otherwise: float) -> float:
    """The first of `CHOICES` that is worth most; ``otherwise`` where there is nothing to choose by."""
    known = [(value, -place) for place, value in enumerate(worth) if value is not None]
    return CHOICES[-max(known)[1]] if known else otherwise
