"""`python -m benchmarks.listen_chance ROOT`: the pair accuracy of guesses, to compare a method's with.

A guess has perfect masks and uses a part of what can be heard; the rest is drawn at random, independently for each
sibling. Nothing is sampled: the probability that both predictions of a frame are right is the product of two shares of
equally likely answers. Beside all pairs there is a column for each kind of pair (`avs3d_bench.measures.pair_kinds`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations, product
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.contract.scores import PAIR_FIGURES
from avs3d_bench.dataset import Dataset, Observation, by_pictures, sibling_frames
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.files import write_json
from avs3d_bench.measures.deaf_oracles import can_sound, instance_ids_of
from avs3d_bench.measures.pair_kinds import pair_kind
from avs3d_bench.runtime.parallel import process_each
from evaluators.metrics.masks import as_bytes, frame_counts, mean
from evaluators.metrics.pairs import ALL_PAIRS, agrees_better, differ, is_right

#: Ids of the instances that are marked.
Answer = tuple[int, ...]
#: The equally likely answers in a frame.
Guess = Callable[[ObservationRecord, FrameRecord], Sequence[Answer]]


def any_instance(record: ObservationRecord, _frame: FrameRecord) -> Sequence[Answer]:
    """Uses no sound: one instance that can sound."""
    return [(instance.id,) for instance in can_sound(record)]


def presence(record: ObservationRecord, frame: FrameRecord) -> Sequence[Answer]:
    """Knows whether a source is audible, here or in another room: nothing, or one instance that can sound."""
    return any_instance(record, frame) if frame.audible else [()]


def category(record: ObservationRecord, frame: FrameRecord) -> Sequence[Answer]:
    """Knows which categories are audible: one instance in the room of each of them."""
    heard = {record.source(one.source).category for one in frame.audible or ()}
    here = [[one.id for one in record.instances if one.category == name] for name in sorted(heard)]
    return list(product(*filter(None, here)))


def every_of_category(record: ObservationRecord, frame: FrameRecord) -> Sequence[Answer]:
    """Knows which categories are audible: all their instances in the room, as `--instance category` of the oracle."""
    heard = {record.source(one.source).category for one in frame.audible or ()}
    return [tuple(one.id for one in record.instances if one.category in heard)]


GUESSES: Mapping[str, Guess] = {
    "instance": any_instance,
    "presence, instance": presence,
    "category, one": category,
    "category, all": every_of_category,
}


def group_chance(root: Path, keys: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """Guess → figure (`PAIR_FIGURES`) → expected pair accuracy of a group; None without such a frame.

    Args:
        root: the dataset's.
        keys: of the siblings.

    Raises:
        UsageError: if an observation has no observation.json.
        Avs3dError: if the dataset is damaged.
    """
    siblings = [Observation(root, key) for key in keys]
    records = [sibling.record for sibling in siblings if sibling.record is not None]
    if len(records) < len(siblings):
        raise UsageError(f"{root}: an observation of the group {keys[0]} has no observation.json")
    right = {name: dict.fromkeys(PAIR_FIGURES, 0.0) for name in GUESSES}
    count = dict.fromkeys(PAIR_FIGURES, 0)
    for same in sibling_frames(siblings):
        masks = [as_bytes(frame.mask()) for frame in same]
        ids = instance_ids_of(same[0], masks[0].shape)
        entries = [frame.record for frame in same if frame.record is not None]
        answers = {n: [guess(r, e) for r, e in zip(records, entries, strict=True)] for n, guess in GUESSES.items()}
        for a, b in combinations(range(len(siblings)), 2):
            if not differ(frame_counts(masks[a], masks[b])):
                continue
            figures = (ALL_PAIRS, pair_kind(records[a], records[b]))
            for figure in figures:
                count[figure] += 1
            for name, of in answers.items():
                both = _share_right(ids, of[a], masks[a], masks[b]) * _share_right(ids, of[b], masks[b], masks[a])
                for figure in figures:
                    right[name][figure] += both
    return {
        name: {figure: found[figure] / count[figure] if count[figure] else None for figure in PAIR_FIGURES}
        for name, found in right.items()
    }


def _share_right(
    ids: NDArray[np.uint16], answers: Sequence[Answer], own: NDArray[np.uint8], other: NDArray[np.uint8]
) -> float:
    """Share of the answers that are right in a frame of a pair; ``own`` and ``other`` are its truths."""
    found = []
    for answer in answers:
        marked = np.isin(ids, answer)
        mine, theirs = frame_counts(own, marked), frame_counts(other, marked)
        found.append(is_right(mine) and agrees_better(mine, theirs))
    return sum(found) / len(found)


@click.command()
@click.argument("root", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--workers", type=int, default=None, help="Processes [one per core].")
@click.option("--json", "report", type=click.Path(path_type=Path), default=None, help="Also write the figures here.")
def main(root: Path, workers: int | None, report: Path | None) -> None:
    """Print what guesses reach on part_3 of ROOT: means over groups, as `pair_accuracy`."""
    dataset = Dataset(root)
    groups = by_pictures(observation for observation in dataset if observation.is_part_3)
    if not groups:
        raise click.UsageError(f"{root}: no observation of part_3")
    keys = [tuple(sibling.key for sibling in siblings) for siblings in groups.values()]
    found = [out for _, out in process_each(partial(group_chance, root), keys, workers=workers, label="groups")]
    table = Table("guess", *PAIR_FIGURES, title="chance under listen")
    document = {}
    for name in GUESSES:
        document[name] = {
            figure: mean(value for one in found if (value := one[name][figure]) is not None) for figure in PAIR_FIGURES
        }
        table.add_row(name, *("–" if value is None else f"{value:.3f}" for value in document[name].values()))
    Console().print(table)
    if report is not None:
        scored = sum(map(len, groups.values()))
        of = {
            "dataset": dataset.name,
            "version": dataset.record.version if dataset.record else None,
            "scored": scored,
            "groups": len(groups),
        }
        write_json(report, of | {"guesses": document})


if __name__ == "__main__":
    main()
