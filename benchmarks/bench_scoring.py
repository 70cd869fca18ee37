"""Time of scoring 510 masks of 1008², compared with decoding the same files in the same number of processes.

The goal is a ratio of at most 1.5 in user CPU time, in one process. Scoring does not use numba.

Also with a table of frames (`avs3d-eval --frames`): compared by CPU time, because what it adds is less than what two
runs differ by on a busy machine.
"""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    AcousticsRecord,
    CameraSplits,
    FrameRecord,
    InstanceRecord,
    IntrinsicsRecord,
    LicenceRecord,
    ObservationRecord,
    SubmissionRecord,
    VisionRecord,
)
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from evaluators.score import evaluate
from evaluators.statistics.frame_rows import frame_rows, write_rows

_LICENCE = LicenceRecord(name="CC0-1.0", author="avs3d-bench", source="procedural")
_SIZE = layout.IMAGE_SIZE


def _keys(single: int, multiple: int) -> list[str]:
    singles = [
        f"part_1/scan{i // 9}/{('bathroom', 'kitchen', 'living_room')[i % 3]}/{i // 3 % 3 + 1}" for i in range(single)
    ]
    return singles + [f"part_2/scan{i // 3}/kitchen/{i % 3 + 1}" for i in range(multiple)]


def _blob(rng: np.random.Generator) -> np.ndarray:
    """An object's outline: a rotated box with rounded, slightly ragged edges, 0.5 to 10 % of the image."""
    mask = np.zeros((_SIZE, _SIZE), np.uint8)
    centre = rng.uniform(150, _SIZE - 150, 2)
    sides = rng.uniform(70, 320, 2)
    corners = cv2.boxPoints(((centre[0], centre[1]), (sides[0], sides[1]), rng.uniform(0, 90)))
    cv2.fillPoly(mask, [corners.astype(np.int32)], 255)
    rough = cv2.GaussianBlur(rng.normal(0, 60, mask.shape).astype(np.float32) + mask, (0, 0), 4)
    return (rough > 127).astype(np.uint8) * 255


def _record(key: str, frames: int) -> ObservationRecord:
    place = layout.parse_key(key)
    instances = [
        InstanceRecord(
            id=number, category="microwave", sounding=number == 1, position=(number, 1, -2), rotation=(1, 0, 0, 0),
            bounds=((number, 1, -2.5), (number + 0.5, 1.4, -2)), asset="box", licence=_LICENCE,
        )
        for number in ((1,) if place.part == "part_1" else (1, 2, 3))
    ]  # fmt: skip
    pose = Pose.from_yaw((0, 1.5, 0), 0.0)
    where = direction_to(pose, (1, 1.2, -2))
    names = [layout.frame_name(i) for i in range(frames)]
    return ObservationRecord(
        key=key, part=place.part, scan=place.scan, room=place.room,  # type: ignore[arg-type]
        index=place.index, category="microwave", seed=0,
        source_position=(1, 1.2, -2), intrinsics=IntrinsicsRecord.of(Intrinsics.from_fov(_SIZE)),
        instances=tuple(instances), acoustics=AcousticsRecord(backend="none", version="0", sample_rate=44100, gain=1),
        vision=VisionRecord(backend="none", version="0"), files={},
        frames=tuple(
            FrameRecord(
                name=name, time=i, position=pose.position, rotation=pose.rotation, visible_pixels=1, rms_left=0,
                rms_right=0, azimuth=where.azimuth, elevation=where.elevation, distance=where.distance,
                line_of_sight=True,
            )
            for i, name in enumerate(names)
        ),
    )  # fmt: skip


def write_example(root: Path, submission: Path, single: int = 25, multiple: int = 9, frames: int = 120) -> list[Path]:
    """A benchmark's truths and a plausible submission: outlines wrong by a few pixels, twins, a third of frames empty.

    Only the files that scoring opens are written: no sound, and empty files in place of the pictures.

    Returns:
        every PNG file that scoring decodes.
    """
    rng = np.random.default_rng(7)
    files = []
    method = SubmissionRecord(method="bench", dataset=root.name, dataset_version="0")
    media.write_json(submission / layout.SUBMISSION_JSON, method)
    for key in _keys(single, multiple):
        here, there = root / key, submission / key / layout.SUBMISSION_MASKS
        media.write_json(here / layout.OBSERVATION_JSON, _record(key, frames))
        splits = CameraSplits.of(frames)
        media.write_json(here / layout.SPLITS_JSON, splits)
        (here / layout.INPUT).mkdir()
        for index in range(frames):
            (here / layout.image_path(layout.INPUT, index)).touch()
        for name in splits.test:
            truth, twin = _blob(rng), _blob(rng)
            if rng.uniform() < 0.35:
                truth[:] = 0
            prediction = np.roll(truth, rng.integers(-6, 7, 2), axis=(0, 1))
            files += [here / layout.SEMANTIC_MASKS / f"{name}.png", there / f"{name}.png"]
            media.write_png_mask(files[-2], truth)
            media.write_png_mask(files[-1], prediction)
            if key.startswith("part_2"):
                ids = np.where(truth, 1, np.where(twin, 2, 0)).astype(np.uint8)
                files.append(here / layout.INSTANCE_MASKS / f"{name}.png")
                media.write_png_ids(files[-1], ids)
    return files


def _decode(paths: list[Path]) -> int:
    total = 0
    for path in paths:
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        total += picture.size
    return total


def peak_mb() -> float:
    """Peak resident memory of this process (MB).

    Linux hands a parent's `ru_maxrss` on to its children, so that a benchmark that was large would be measured instead.
    """
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise Avs3dError("/proc/self/status: no line VmHWM; expected Linux")


def decode_all(files: list[Path], workers: int) -> float:
    """Seconds to decode every file with OpenCV and discard the result."""
    start = time.perf_counter()
    if workers == 1:
        _decode(files)
    else:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            list(pool.map(_decode, [files[i : i + 30] for i in range(0, len(files), 30)]))
    return time.perf_counter() - start


def score_all(root: Path, submission: Path, workers: int, table: Path | None = None) -> float:
    """Seconds to score with both protocols and all checks, and to write the table of frames if one is given."""
    start = time.perf_counter()
    evaluation = evaluate(submission, root, workers=workers)
    if table is not None:
        write_rows(table, frame_rows(evaluation, Dataset(root)))
    return time.perf_counter() - start


def user_seconds(job: Callable[[], object]) -> float:
    """User CPU time of a job in this process (s): other programs on a busy machine change it least."""
    start = os.times().user
    job()
    return os.times().user - start


def cpu_figures(files: list[Path], root: Path, submission: Path, repeats: int) -> dict[str, float]:
    """User CPU time of decoding and of scoring in one process, which alternate, and the median of their ratios."""
    score_all(root, submission, 1)  # the sources of the evaluator are hashed once per process
    pairs = [
        (user_seconds(partial(decode_all, files, 1)), user_seconds(partial(score_all, root, submission, 1)))
        for _ in range(repeats)
    ]
    return {
        f"decoding {len(files)} PNG files, user CPU (s)": float(np.median([d for d, _ in pairs])),
        "scoring 510 masks, user CPU (s)": float(np.median([s for _, s in pairs])),
        "scoring over decoding, user CPU (at most 1.5)": float(np.median([s / d for d, s in pairs])),
    }


def table_share(root: Path, submission: Path, table: Path) -> float:
    """CPU time of the table of frames over that of scoring, in percent, in this process."""
    start = time.process_time()
    evaluation = evaluate(submission, root, workers=1)
    scored = time.process_time()
    write_rows(table, frame_rows(evaluation, Dataset(root)))
    return 100 * (time.process_time() - scored) / (scored - start)


def peak_memory(root: Path, submission: Path) -> float:
    """Peak resident memory (MB) of a new process that scores everything by itself."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        pool.submit(partial(evaluate, submission, root, workers=1)).result()
        return pool.submit(peak_mb).result()


def run_all(repeats: int = 5) -> dict[str, float]:
    """Figures for `make bench`; decoding and scoring alternate."""
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        root, submission = Path(folder) / "data", Path(folder) / "submission"
        files = write_example(root, submission)
        small, small_submission = Path(folder) / "small", Path(folder) / "small_submission"
        write_example(small, small_submission, single=2, multiple=1)
        decode_all(files, 1)
        figures |= cpu_figures(files, root, submission, repeats)
        for workers in (1, 2):
            pairs = [(decode_all(files, workers), score_all(root, submission, workers)) for _ in range(repeats)]
            label = f"{workers} process{'' if workers == 1 else 'es'}"
            figures[f"decoding {len(files)} PNG files, {label} (s)"] = float(np.median([d for d, _ in pairs]))
            figures[f"scoring 510 masks, {label} (s)"] = float(np.median([s for _, s in pairs]))
            figures[f"scoring over decoding, {label}"] = float(np.median([s / d for d, s in pairs]))
            table = Path(folder) / "frames.csv"
            pairs = [(decode_all(files, workers), score_all(root, submission, workers, table)) for _ in range(repeats)]
            figures[f"scoring with --frames over decoding, {label}"] = float(np.median([s / d for d, s in pairs]))
        shares = [table_share(root, submission, Path(folder) / "frames.csv") for _ in range(repeats)]
        figures["table of frames over scoring (% of CPU time)"] = float(np.median(shares))
        figures["peak memory of scoring, 34 observations (MB)"] = peak_memory(root, submission)
        figures["peak memory of scoring, 3 observations (MB)"] = peak_memory(small, small_submission)
    return figures
