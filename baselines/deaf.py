"""The deaf oracles as submissions: true instance masks, the same for all siblings of a group of part_3.

    all      every visible instance that can sound
    single   one instance, the same in all frames of all siblings: that with the highest mean IoU over the frames in
             which something audible is visible

Siblings differ in sound alone: these are answers of a perfect segmentation that does not use the sound, and their pair
accuracy is 0. Both use the instance masks of test frames, ``single`` the masks as well. See
`avs3d_bench.measures.deaf_oracles`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset, Frame, Observation, by_pictures, sibling_frames
from avs3d_bench.errors import UsageError
from avs3d_bench.measures.deaf_oracles import best_single, can_sound, instance_ids_of, instance_table
from avs3d_bench.method import Method, write_submission
from avs3d_bench.runtime.parallel import advance, process_each
from avs3d_bench.submission import Prediction, SubmissionWriter
from baselines.oracle import paint

Which = Literal["all", "single"]
#: `truth` of submission.json: leaderboards do not rank such submissions.
TRUTH: dict[Which, str] = {
    "all": "instance masks of test frames",
    "single": "instance masks and masks of test frames",
}


def write_deaf(
    dataset: Dataset,
    path: str | Path,
    which: Which = "all",
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    workers: int | None = 1,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the submission of a deaf oracle, with class ids; the same bytes for any number of workers.

    Args:
        dataset: what to look at.
        path: the submission's folder.
        which: see the module.
        only: shell patterns of observation keys; ``single`` is chosen among their siblings alone.
        overwrite: replace an existing submission.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if an observation is not of part_3 or has no instance masks, or the target is not free.
        Avs3dError: if the dataset is damaged or the system refuses.
    """
    only = tuple(only)
    observations = dataset.select(*only)
    for observation in observations:
        _check(observation)
    groups = by_pictures(observations)
    chosen: dict[str, int | None] | None = None
    if which == "single":
        keys = [tuple(sibling.key for sibling in siblings) for siblings in groups.values()]
        sizes = [sum(len(sibling.test) for sibling in siblings) for siblings in groups.values()]
        choose = partial(choose_single, dataset.root)
        done = process_each(choose, keys, workers=workers, label="choosing", progress=progress, sizes=sizes)
        chosen = {key: found for siblings, found in done for key in siblings}
    method = Method(
        f"deaf oracle ({which})",
        partial(_masks, chosen),
        notes=f"uses the ground truth of test frames and no sound; marks {_WHAT[which]}",
        truth=TRUTH[which],
        entry="baselines.deaf:write_deaf",
    )
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, workers=workers, progress=progress)


_WHAT: dict[Which, str] = {
    "all": "every visible instance that can sound",
    "single": "one instance, the same for all siblings of a group: the best for the group",
}


def choose_single(root: Path, keys: Sequence[str]) -> int | None:
    """Id of the instance that the deaf oracle ``single`` marks for the siblings ``keys``; None: none.

    Args:
        root: the dataset's.
        keys: of the siblings.

    Raises:
        Avs3dError: if the dataset is damaged.
    """
    siblings = [Observation(root, key) for key in keys]
    numbers = [instance.id for instance in can_sound(_record(siblings[0]))]
    tables = []
    frames = sibling_frames(siblings)
    for position, same in enumerate(frames):
        advance(position, len(frames))
        masks = [frame.mask() for frame in same]
        ids = instance_ids_of(same[0], masks[0].shape)
        tables += [instance_table(ids, numbers, mask.view(np.uint8), 1) for mask in masks]
    row = best_single(tables)
    return None if row is None else numbers[row - 1]


def _check(observation: Observation) -> None:
    """Raise `UsageError` if the observation is not of part_3, or has no instance masks."""
    if not observation.is_part_3:
        raise UsageError(
            f"{observation.key}: --deaf compares siblings, which only part_3 has; use --instance category, or --only "
            "'part_3/*'"
        )
    record = observation.record
    if record is None or not (observation.path / layout.INSTANCE_MASKS).is_dir():
        raise UsageError(f"{observation.path}: --deaf needs {layout.OBSERVATION_JSON} and {layout.INSTANCE_MASKS}/")


def _record(observation: Observation) -> ObservationRecord:
    record = observation.record
    assert record is not None, "checked by _check"
    return record


def _masks(chosen: Mapping[str, int | None] | None, frames: tuple[Frame, ...]) -> Iterator[Prediction]:
    """The predictions of test frames; ``chosen`` names one instance per observation, None marks all that can sound."""
    for frame in frames:
        record = _record(frame.observation)
        classes = {
            instance.id: record.class_ids[instance.category]
            for instance in can_sound(record)
            if chosen is None or instance.id == chosen[frame.observation.key]
        }
        ids = paint(frame.instance_ids(), classes)
        yield Prediction(ids > 0, ids)
