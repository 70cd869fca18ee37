"""Temperatures and thresholds of a trained network, from homes that it has not seen.

A network that is trained to the end is too sure of itself. One number for the mask and one for what is heard, by which
log-odds are divided, make the probabilities mean what they say (Guo et al., "On calibration of modern neural
networks", ICML 2017, §4.2); they minimise the negative log-likelihood. Then the threshold of the mask is the one with
the largest sum of IoU and pair accuracy less false marks, that of a category the one with the largest IoU. All are
written into the file of weights, so that no test set takes part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from scipy.optimize import minimize_scalar
from torch import Tensor
from torch.nn.functional import avg_pool2d

from baselines.listener.augment import Bank
from baselines.listener.shards import ShardStore
from baselines.listener.validation import answers, spread, validate, validation_views
from baselines.listener.weights import Calibration

#: Thresholds to choose from.
CHOICES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
#: Log-odds are counted in bins of this width, up to this on both sides.
_WIDTH, _MOST = 0.05, 25.0
#: Temperatures that are tried lie within this factor of 1.
_FACTOR = 12.0
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

    def add(self, odds: Tensor, truth: Tensor) -> None:
        """Count log-odds and their truths, of one shape."""
        bins = ((odds.flatten().double() + _MOST) / _WIDTH).floor().clamp(0, len(self.count) - 1).long()
        self.count.index_add_(0, bins, torch.ones_like(bins, dtype=torch.float64))
        self.true.index_add_(0, bins, truth.flatten().double())

    @property
    def odds(self) -> Tensor:
        """(bins,) the middle of each bin."""
        return (torch.arange(len(self.count), dtype=torch.float64, device=self.count.device) + 0.5) * _WIDTH - _MOST

    def loss(self, temperature: float) -> float:
        """Mean negative log-likelihood at a temperature."""
        odds = self.odds / temperature
        false = self.count - self.true
        total = (self.true * torch.nn.functional.softplus(-odds) + false * torch.nn.functional.softplus(odds)).sum()
        return float(total / self.count.sum().clamp(min=1))

    def temperature(self) -> float:
        """The one with the smallest loss; 1 where nothing was counted."""
        if not float(self.count.sum()):
            return 1.0
        bounds = (-math.log(_FACTOR), math.log(_FACTOR))
        found = minimize_scalar(lambda x: self.loss(math.exp(x)), bounds=bounds, method="bounded")
        return round(math.exp(float(found.x)), 3)

    def error(self, temperature: float = 1.0) -> float:
        """Expected calibration error of what has a probability of at least `LEAST_PROBABILITY`."""
        probability = torch.sigmoid(self.odds / temperature)
        chosen = probability >= LEAST_PROBABILITY
        bins = (probability / ERROR_BIN).long()
        size = int(1 / ERROR_BIN) + 1
        sums = [
            torch.zeros(size, dtype=torch.float64, device=bins.device).index_add_(0, bins, values * chosen)
            for values in (self.count, self.true, self.count * probability)
        ]
        gap = (sums[2] - sums[1]).abs().sum()
        return round(float(gap / sums[0].sum().clamp(min=1)), 4)


def calibrate(
    network: Any, store: ShardStore, bank: Bank, fabric: Any, *, every_home: bool = False
) -> tuple[Calibration, dict[str, Any]]:
    """Temperatures and thresholds, and the figures that they were chosen by.

    Args:
        network: the (averaged) `Listener`.
        store: what is stored.
        bank: the same on the device.
        fabric: a launched `lightning.fabric.Fabric`.
        every_home: of the store; else those that training keeps for validation.
    """
    views = spread(range(len(store.table.homes))) if every_home else validation_views(store.table)
    masks, names = OddsHistogram.empty(fabric.device), OddsHistogram.empty(fabric.device)
    for output, batch in answers(network, store, bank, fabric, views):
        shares = avg_pool2d(batch.masks.float(), 2)
        masks.add(output.mask.float()[..., : shares.shape[-2], : shares.shape[-1]], shares)
        names.add(output.audible.float(), batch.audible[:, : output.audible.shape[1]])
    for histogram in (masks, names):
        histogram.count = fabric.all_reduce(histogram.count, reduce_op="sum")
        histogram.true = fabric.all_reduce(histogram.true, reduce_op="sum")
    warm, named = masks.temperature(), names.temperature()
    raw = tuple(_sigmoid(warm * _logit(choice)) for choice in CHOICES)
    found = validate(network, store, bank, fabric, (*raw, *CHOICES), views)
    by_mask, by_class = found[: len(CHOICES)], found[len(CHOICES) :]
    usual = Calibration()
    threshold = _best([_worth(row) for row in by_mask], usual.threshold)
    category = _best([row["category_iou"] for row in by_class], usual.category)
    calibration = Calibration(warm, named, threshold, category)
    figures = {
        "pictures": len(views), "error_before": masks.error(), "error": masks.error(warm),
        "names_error_before": names.error(), "names_error": names.error(named),
        "by_threshold": dict(zip(map(str, CHOICES), by_mask, strict=True)),
        "category_iou": {str(choice): row["category_iou"] for choice, row in zip(CHOICES, by_class, strict=True)},
    }  # fmt: skip
    return calibration, figures


def _worth(figures: dict[str, float | None]) -> float | None:
    """None where nothing is to be marked."""
    iou, pairs, false = (figures[name] for name in ("iou", "pair_accuracy", "fp_rate"))
    return None if iou is None else iou + (pairs or 0.0) - (false or 0.0)


def _best(worth: Sequence[float | None], otherwise: float) -> float:
    """The first of `CHOICES` that is worth most; ``otherwise`` where there is nothing to choose by."""
    known = [(value, -place) for place, value in enumerate(worth) if value is not None]
    return CHOICES[-max(known)[1]] if known else otherwise


def _logit(share: float) -> float:
    return math.log(share / (1 - share))


def _sigmoid(odds: float) -> float:
    return 1 / (1 + math.exp(-odds))
