"""Two folders of PNG masks, of truth and of predictions, scored by the convention of a benchmark: `avs3d metrics`.

Files belong together by their path below the folder. A subfolder is a clip; without subfolders all files are of one
clip, or of clips of a given length. Names are read with their numbers: `frame_10` comes after `frame_9`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.mask_values import as_mask
from avs3d_bench.formats.media import png_header
from evaluators.metrics.accumulator import Accumulator
from evaluators.metrics.conventions import avsbench, avss, combo, ref_avs
from evaluators.reading.convention_names import Convention
from evaluators.reading.grey_pictures import read_grey, read_probability

Figures = dict[str, float | None]
#: Values of a released test script: frames of a clip, clips of a batch.
_RELEASED = {"avsbench-s4": (5, 1), "avsbench-ms3": (5, 1), "combo": (5, 1), "ref-avs": (10, 4)}
#: Files that a message names before it only counts.
_NAMED = 3


@dataclass(frozen=True)
class FolderOptions:
    """How `score_folders` reads and scores.

    Attributes:
        convention: whose figures.
        soft: take the grey levels of predictions as probabilities: 255, or 65535 with 16 bits, is 1.
        frames_per_clip: length of a clip; None: that of the subfolders, else that of the released test script.
        clips_per_batch: batch size; None: that of the released test script.
        classes: number of class ids, of ``avss``.
        by_order: pair the files of each subfolder by their order; else by name.
    """

    convention: Convention = "avs3d"
    soft: bool = False
    frames_per_clip: int | None = None
    clips_per_batch: int | None = None
    classes: int | None = None
    by_order: bool = False


@dataclass(frozen=True)
class MaskPair:
    """The files of one frame.

    Attributes:
        truth: the true mask, or class ids.
        prediction: the predicted one.
    """

    truth: Path
    prediction: Path


Clip = Sequence[MaskPair]


@dataclass(frozen=True)
class FolderScores:
    """The figures of two folders.

    Attributes:
        figures: those of the convention.
        order_free: the figures of these names that depend neither on batches nor on order; empty of this toolkit's own,
            which never do.
        clips: number of clips.
        frames: number of frames.
        surplus: predictions without a truth, which are not looked at.
    """

    figures: Figures
    order_free: Figures
    clips: int
    frames: int
    surplus: tuple[str, ...]


def score_folders(truth: Path, prediction: Path, options: FolderOptions) -> FolderScores:
    """Score the PNG files below two folders.

    Raises:
        UsageError: if a folder holds no PNG, clips differ in length where the convention needs one length, or an
            option does not fit the convention.
        Avs3dError: if a prediction is missing, or a file is damaged or has another size, format or other values.
    """
    _check(options)
    folders, surplus = (_by_order if options.by_order else _by_name)(truth, prediction)
    clips = _clips(folders, options.frames_per_clip)
    if options.convention == "avs3d":
        figures = Accumulator()
        for clip in clips:
            figures.add_clip(_truths(clip, _mask), _predictions(clip, read_probability if options.soft else _mask))
        scored: tuple[Figures, Figures] = figures.compute(), {}
    else:
        scored = (_classes if options.convention == "avss" else _masks)(clips, options)
    return FolderScores(*scored, len(clips), sum(map(len, clips)), surplus)


def _check(options: FolderOptions) -> None:
    if (options.convention == "avss") != (options.classes is not None):
        how = "expected --classes 71 of AVSBench-semantic" if options.classes is None else "leave out --classes"
        raise UsageError(f"--convention {options.convention}: {how}; avss alone scores classes")
    if options.soft and options.convention in ("avss", "3d-avs"):
        raise UsageError(f"--convention {options.convention}: has no soft masks; leave out --soft")
    if options.clips_per_batch is not None and options.convention not in _RELEASED:
        raise UsageError(f"--convention {options.convention}: has no batches; leave out --clips-per-batch")


def _classes(clips: Sequence[Clip], options: FolderOptions) -> tuple[Figures, Figures]:
    """The figures of class ids as released, and those beside them."""
    pairs = list(chain.from_iterable(clips))

    def score(how: Callable[[object, object, int | None], dict[str, float]]) -> Figures:
        return {**how(_truths(pairs, _ids), _predictions(pairs, _ids), options.classes)}

    return score(avss.evaluate), score(avss.order_free)


def _masks(clips: Sequence[Clip], options: FolderOptions) -> tuple[Figures, Figures]:
    """The figures of masks as released, and those beside them."""
    pairs, convention = list(chain.from_iterable(clips)), options.convention

    def given() -> tuple[Iterator[NDArray[Any]], Iterator[NDArray[Any]]]:
        found = _predictions(pairs, read_probability if options.soft else _mask)
        return _truths(pairs, _mask), (_values_for(convention, frame) for frame in found)

    module: Any = {"combo": combo, "ref-avs": ref_avs}.get(convention, avsbench)
    frames, batch = _RELEASED.get(convention, (len(clips[0]), 1))
    if len(clips) > 1:  # else the files of all clips lie in one folder
        lengths = sorted({len(clip) for clip in clips})
        if len(lengths) > 1:
            some = " and ".join(map(str, lengths[:_NAMED]))
            raise UsageError(f"clips of {some} frames; {convention} needs one length: --frames-per-clip N")
        frames = lengths[0]
    frames = options.frames_per_clip or frames
    return module.evaluate(*given(), options.clips_per_batch or batch, frames), module.order_free(*given())


def _values_for(convention: Convention, frame: NDArray[Any]) -> NDArray[np.float32]:
    """A predicted mask or soft mask as the numbers that a convention's code expects."""
    probability = frame.astype(np.float32)
    if convention in ("combo", "3d-avs"):  # the latter takes 0 and 1 for logits, as the released pipeline does
        return probability
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(probability) - np.log1p(-probability))


def _by_name(truth: Path, prediction: Path) -> tuple[list[Clip], tuple[str, ...]]:
    """The pairs of each subfolder, by their path below the folders, and predictions without a truth."""
    true, found = _pngs(truth), _pngs(prediction)
    missing = [name for name in true if name not in found]
    if missing:
        some = ", ".join(missing[:_NAMED]) + (f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else "")
        raise Avs3dError(
            f"{prediction}: {len(missing)} of {len(true)} masks are missing: {some}; expected the names of {truth}, or "
            "--by-order"
        )
    clips = [[MaskPair(truth / name, prediction / name) for name in clip] for clip in _by_folder(true).values()]
    return [*clips], tuple(name for name in found if name not in true)


def _by_order(truth: Path, prediction: Path) -> tuple[list[Clip], tuple[str, ...]]:
    """The pairs of each subfolder, the first of each folder together and so on; nothing is left over."""
    true, found = _by_folder(_pngs(truth)), _by_folder(_pngs(prediction))
    for folder in {**true, **found}:
        counts = [len(side.get(folder, ())) for side in (true, found)]
        if counts[0] != counts[1]:
            raise Avs3dError(f"{prediction / folder}: {counts[1]} masks, expected {counts[0]}, as in {truth / folder}")
    pairs = (zip(true[folder], found[folder], strict=True) for folder in true)
    return [[MaskPair(truth / a, prediction / b) for a, b in clip] for clip in pairs], ()


def _by_folder(names: Iterable[str]) -> dict[PurePosixPath, list[str]]:
    return {folder: list(some) for folder, some in groupby(names, key=lambda name: PurePosixPath(name).parent)}


def _pngs(folder: Path) -> dict[str, None]:
    """Paths of the PNG files below a folder, in natural order.

    Raises:
        UsageError: if it is no folder, or there is none.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; expected one with PNG masks")
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.suffix.lower() == ".png")
    names = [path.as_posix() for path in paths if not any(part.startswith(".") for part in path.parts)]
    if not names:
        raise UsageError(f"{folder}: no PNG file; expected masks, in it or in a subfolder for each clip")
    return dict.fromkeys(sorted(names, key=_natural))


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key of a path: folder by folder, numbers by value."""
    return [
        (int(piece), "") if piece.isdigit() else (-1, piece)
        for part in PurePosixPath(name).with_suffix("").parts
        for piece in [*re.split(r"([0-9]+)", part), "/"]
    ]


def _clips(folders: Sequence[Clip], length: int | None) -> list[Clip]:
    """The pairs of each clip: those of a subfolder, or of a given number of files."""
    if length is None:
        return [*folders]
    out: list[Clip] = []
    for pairs in folders:
        if len(pairs) % length:
            where = pairs[0].truth.parent
            raise UsageError(f"{where}: {len(pairs)} frames are no whole clips of {length}; --frames-per-clip")
        out += [pairs[start : start + length] for start in range(0, len(pairs), length)]
    return out


def _truths(pairs: Clip, read: Callable[[Path], NDArray[Any]]) -> Iterator[NDArray[Any]]:
    return (read(pair.truth) for pair in pairs)


def _predictions(pairs: Clip, read: Callable[[Path], NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """The predictions, each of the size of its truth."""
    for pair in pairs:
        found, header = read(pair.prediction), png_header(pair.truth)
        if found.shape != (header.height, header.width):
            size = f"{found.shape[1]}×{found.shape[0]}"
            wanted = f"{header.width}×{header.height}, those of its truth"
            raise Avs3dError(f"{pair.prediction}: {size} pixels, expected {wanted}")
        yield found


def _mask(path: Path) -> NDArray[np.bool_]:
    pixels = read_grey(path)
    try:
        return as_mask(pixels, (pixels.shape[0], pixels.shape[1]), str(path))
    except Avs3dError as error:
        raise Avs3dError(f"{error}; --soft reads the grey levels of predictions as probabilities") from None


def _ids(path: Path) -> NDArray[np.uint8]:
    pixels = read_grey(path)
    if pixels.dtype != np.uint8:
        raise Avs3dError(f"{path}: 16 bits, expected class ids in a grey PNG of 8 bits")
    return pixels
