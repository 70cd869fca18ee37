"""Predictions that are in no folder: written to a temporary one, and checked and scored as all others are."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from numpy.typing import ArrayLike

from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction

#: Masks of the test frames of an observation: in their order, or by name of the frame.
Masks = Sequence[ArrayLike | Prediction] | Mapping[str, ArrayLike | Prediction]
#: Key of an observation → its masks.
Predictions = Mapping[str, Masks | ArrayLike]
#: Name of the method in the scores of predictions that do not say theirs.
UNNAMED = "in memory"
#: Keys that a message names before it only counts.
_NAMED = 3


@contextmanager
def written(predictions: Predictions | Method, dataset: Dataset, only: Sequence[str] = ()) -> Iterator[Path]:
    """A submission with the predictions; it is removed when the block ends.

    Args:
        predictions: key → masks of its test frames, as `evaluators.evaluate` takes them; or a method, which is run.
        dataset: what they are for.
        only: shell patterns of observation keys.

    Raises:
        UsageError: if a key is unknown, or an observation or a frame has no prediction.
        Avs3dError: if there are more or fewer masks than test frames, or one has another size, type or values.
    """
    method = predictions if isinstance(predictions, Method) else _method(predictions, dataset, only)
    with tempfile.TemporaryDirectory(prefix="avs3d-submission-") as folder:
        path = Path(folder) / "submission"
        write_submission(dataset, path, method, only=only)
        yield path


def _method(predictions: Predictions, dataset: Dataset, only: Sequence[str]) -> Method:
    """A method that knows its answers, all of them checked to be there."""
    for key in predictions:
        if key not in dataset:
            hint = did_you_mean(key, dataset.keys)
            raise UsageError(f"submission: predictions of {excerpt(key)}, no observation of {dataset.root}{hint}")
    wanted = [observation.key for observation in dataset.select(*only)]
    missing = [key for key in wanted if key not in predictions]
    if missing:
        some = ", ".join(missing[:_NAMED]) + (f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else "")
        raise UsageError(
            f"submission: no predictions of {len(missing)} of {len(wanted)} observations: {some}; only=… scores a part"
        )
    return Method(UNNAMED, lambda frames: _masks(predictions[frames[0].observation.key], frames))


def _masks(found: Masks | ArrayLike, frames: Sequence[Frame]) -> Iterable[ArrayLike | Prediction]:
    """The masks of frames of one observation, in their order."""
    key = frames[0].observation.key
    if isinstance(found, Mapping):
        names = [frame.name for frame in frames]
        for name in found:
            if name not in names:
                raise UsageError(f"{key}: a mask of {excerpt(name)}, no test frame{did_you_mean(name, names)}")
        for name in names:
            if name not in found:
                raise UsageError(f"{key}: no mask of {name}; expected one for each of {len(names)} test frames")
        return [found[name] for name in names]
    if isinstance(found, str) or not isinstance(found, Iterable):
        raise UsageError(
            f"{key}: a {type(found).__name__}, expected masks (frames, height, width), or a mapping from frame names"
        )
    return found
