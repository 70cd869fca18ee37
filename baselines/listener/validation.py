"""Validation: homes that training never sees, every picture with all of its own sounds, unchanged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

from baselines.listener.augment import Bank, Batch
from baselines.listener.batches import BatchPlan, SoundKind, split_homes
from baselines.listener.losses import SUMS, figures, measure
from baselines.listener.model import Listener, ListenerOutput, hear
from baselines.listener.predict import THRESHOLD
from baselines.listener.shards import ShardStore, ShardTable

#: Most pictures that are looked at; they are spread evenly over all.
MOST_PICTURES = 512


def validation_views(table: ShardTable) -> list[int]:
    """Pictures of the homes kept for validation; of the only home, where there is one alone."""
    training, kept = split_homes(table.homes)
    return spread([view for view, home in enumerate(table.homes) if home in (kept or training)])


def spread(numbers: Sequence[int], most: int = MOST_PICTURES) -> list[int]:
    """At most so many of them, evenly."""
    return [numbers[i] for i in np.linspace(0, len(numbers) - 1, min(len(numbers), most)).round().astype(int)]


def own_plan(table: ShardTable, views: Sequence[int], sounds: Sequence[int]) -> BatchPlan:
    """Pictures with their own sounds, as many each, as they are.

    Args:
        table: of the store.
        views: (B,) pictures.
        sounds: (B·K,) sounds, K of the first picture first.
    """
    column = np.asarray(sounds, np.int64)[:, None]
    none = np.full_like(column, -1)
    pair, no_dubs = np.concatenate([column, none], axis=1), np.concatenate([none, none], axis=1)
    own = np.full(len(sounds), SoundKind.OWN, np.int64)
    return BatchPlan(
        np.asarray(views, np.int64), pair, no_dubs, np.zeros(pair.shape, np.bool_), pair, table.heard(sounds), own
    )


@contextmanager
def _no_search() -> Iterator[None]:
    """A block without search for the fastest convolution of each shape: the number of sounds differs by picture."""
    before = torch.backends.cudnn.benchmark
    torch.backends.cudnn.benchmark = False
    try:
        yield
    finally:
        torch.backends.cudnn.benchmark = before


def answers(
    network: Any, store: ShardStore, bank: Bank, fabric: Any, views: Sequence[int]
) -> Iterator[tuple[ListenerOutput, Batch]]:
    """What a network says to pictures with all of their own sounds, unchanged; each device looks at its share.

    Args:
        network: the (averaged) `Listener`.
        store: what is stored.
        bank: the same on the device.
        fabric: a launched `lightning.fabric.Fabric`.
        views: numbers of pictures.
    """
    assert isinstance(network, Listener)
    of_view: dict[int, list[int]] = {}
    for sound, view in enumerate(store.table.view):
        of_view.setdefault(view, []).append(sound)
    training = network.training
    network.eval()
    try:
        with torch.inference_mode(), fabric.autocast(), _no_search():
            for view in views[fabric.global_rank :: fabric.world_size]:
                batch = bank.gather(own_plan(store.table, [view], of_view[view]), None)
                cameras = batch.cameras.expand(len(batch.sounds), -1)
                heard = hear(batch.sounds, cameras, (batch.pictures.shape[-2], batch.pictures.shape[-1]))
                yield network(batch.pictures, heard), batch
    finally:
        network.train(training)


def validate(
    network: Any,
    store: ShardStore,
    bank: Bank,
    fabric: Any,
    thresholds: tuple[float, ...] = (THRESHOLD,),
    views: Sequence[int] | None = None,
) -> list[dict[str, float | None]]:
    """Figures of a network over the validation homes.

    Args:
        network: the (averaged) `Listener`.
        store: what is stored.
        bank: the same on the device.
        fabric: a launched `lightning.fabric.Fabric`.
        thresholds: probabilities above which a pixel is marked.
        views: other pictures than those of the validation homes.

    Returns:
        The figures for each threshold, see `losses.figures`.
    """
    sums = torch.zeros(len(thresholds), len(SUMS), dtype=torch.float64, device=fabric.device)
    chosen = validation_views(store.table) if views is None else views
    for output, batch in answers(network, store, bank, fabric, chosen):
        found = [measure(output, batch, threshold) for threshold in thresholds]
        rows = [[each[name] for name in SUMS] for each in found]
        sums += torch.tensor(rows, dtype=torch.float64, device=fabric.device)
    total = fabric.all_reduce(sums, reduce_op="sum")
    return [figures(dict(zip(SUMS, row, strict=True))) for row in total.tolist()]
