"""Running a method over a dataset: from a function that predicts masks to a whole submission.

    def predict(frames):
        return [mask_of(frame.rgb(), frame.audio()) for frame in frames]

    write_submission(Dataset("open-s34-o7"), "my-submission", Method("mine 1.0", predict))

For another order of work, use `avs3d_bench.submission.SubmissionWriter`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from numpy.typing import ArrayLike

from avs3d_bench.contract.schema import ProvenanceRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.parallel import advance, process_each
from avs3d_bench.runtime.provenance import provenance
from avs3d_bench.submission import Prediction, SubmissionFolder, SubmissionWriter


@dataclass(frozen=True)
class Method:
    """A method, as `write_submission` runs and describes it.

    Attributes:
        name: as tables will show it.
        predict: the masks of test frames, one per frame and in their order: (H, W) bool, or integers 0 and 255; or a
            `Prediction` with class ids, in part_3.
        points: the 3D prediction of an observation, (N, 3) metres; None if the method makes none.
        notes: settings and other remarks for readers.
        truth: what truth of the dataset it reads; None: none (see `SubmissionRecord`).
        entry: ``baselines.module:function`` that makes the masks; the digest of its sources is written, too.
        batch: frames that ``predict`` gets at a time, over all observations; None: the test frames of an observation.
    """

    name: str
    predict: Callable[[tuple[Frame, ...]], Iterable[ArrayLike | Prediction]]
    points: Callable[[Observation], ArrayLike] | None = None
    notes: str | None = None
    truth: str | None = None
    entry: str | None = None
    batch: int | None = None


def write_submission(
    dataset: Dataset,
    path: str | Path,
    method: Method,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    workers: int | None = 1,
    progress: bool = False,
) -> SubmissionWriter:
    """Predict every test frame and write the submission; the same bytes for any number of workers.

    Args:
        dataset: what to look at.
        path: the submission's folder.
        method: what predicts; with more than one worker its functions are sent to other processes by name.
        only: shell patterns of observation keys; the submission's notes name them.
        overwrite: replace an existing submission.
        workers: processes, one observation each at a time; None: one per core. A method with ``batch`` runs here.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or the target is not free.
        Avs3dError: if a file is missing or damaged, a mask has another form, or the system refuses.
    """
    only = tuple(only)
    notes = (method.notes or "") + (f"; only {' '.join(only)}" if only else "")
    writer = SubmissionWriter(
        path,
        dataset,
        method=method.name,
        notes=notes.removeprefix("; ") or None,
        provenance=ProvenanceRecord.of(provenance(method.entry)) if method.entry else None,
        truth=method.truth,
        only=only,
        overwrite=overwrite,
    )
    with writer:
        done: Iterable[object]
        if method.batch is not None:
            frames = [frame for observation in writer.observations for frame in observation.test]
            batches = [tuple(frames[start : start + method.batch]) for start in range(0, len(frames), method.batch)]
            job = partial(_write_masks, writer.folder, method)
            sizes = [len(batch) for batch in batches]
            done = process_each(job, batches, workers=1, label=method.name, progress=progress, sizes=sizes)
        else:
            keys = [observation.key for observation in writer.observations]
            sizes = [len(observation.test) for observation in writer.observations]
            each = partial(_write_observation, dataset.root, writer.folder, method)
            done = process_each(each, keys, workers=workers, label=method.name, progress=progress, sizes=sizes)
        for _ in done:
            pass
    return writer


def _write_observation(root: Path, folder: SubmissionFolder, method: Method, key: str) -> None:
    observation = Observation(root, key)
    _write_masks(folder, method, observation.test)
    if method.points is not None:
        folder.write_points(observation, method.points(observation))


def _write_masks(folder: SubmissionFolder, method: Method, frames: tuple[Frame, ...]) -> None:
    masks: Iterator[ArrayLike | Prediction | None] = iter(method.predict(frames))
    for number, frame in enumerate(frames):
        found = next(masks, None)
        if found is None:
            raise _miscounted(frames, f"{number}")
        prediction = found if isinstance(found, Prediction) else Prediction(found)
        folder.write_mask(frame, prediction.mask, prediction.categories)
        advance(number + 1, len(frames))
    if next(masks, None) is not None:
        raise _miscounted(frames, f"more than {len(frames)}")


def _miscounted(frames: Sequence[Frame], count: str) -> Avs3dError:
    return Avs3dError(f"{frames[0].observation.key}: {count} masks, expected one for each of {len(frames)} test frames")
