"""What the published files of an observation's frames show as files: one number, or several, for each frame.

Every function gets the folder of an observation and its number of frames, and returns (n,) or (n, m) numbers.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import read_images
from benchmarks.sealed_cases import Array
from generators.acoustics.clips import mono_clip

#: Folders whose files are looked at as files.
_PICTURES, _CLIPS = (layout.INPUT, layout.IMAGES, layout.DEPTH), (layout.BINAURAL, layout.MONO)


def frame_count(folder: Path) -> int:
    """Number of frames of an observation."""
    return len(list((folder / layout.INPUT).glob("*.png")))


def files_of(folder: Path, frames: int) -> list[list[Path]]:
    """For each frame, its published files in a fixed order."""
    pictures = [name for name in _PICTURES if (folder / name).is_dir()]
    clips = [name for name in _CLIPS if (folder / name).is_dir()]
    return [
        [folder / layout.image_path(name, index) for name in pictures]
        + [folder / layout.audio_path(name, index) for name in clips]
        for index in range(frames)
    ]


def sizes(folder: Path, frames: int) -> Array:
    """Bytes of each file."""
    return np.array([[path.stat().st_size for path in paths] for paths in files_of(folder, frames)], dtype=np.float64)


def times(folder: Path, frames: int) -> Array:
    """When each file was changed, nanoseconds from the first picture on."""
    stats = [[path.stat() for path in paths] for paths in files_of(folder, frames)]
    first = stats[0][0].st_mtime_ns
    return np.array([[one.st_mtime_ns - first for one in row] for row in stats], dtype=np.float64)


def modes(folder: Path, frames: int) -> Array:
    """Type and permissions of each file."""
    return np.array([[path.stat().st_mode for path in paths] for paths in files_of(folder, frames)], dtype=np.float64)


def links(folder: Path, frames: int) -> Array:
    """Number of names of each file."""
    return np.array([[path.stat().st_nlink for path in paths] for paths in files_of(folder, frames)], dtype=np.float64)


def inodes(folder: Path, frames: int) -> Array:
    """Order in which the files of each folder were made, against the order of their names."""
    numbers = np.array([[path.stat().st_ino for path in paths] for paths in files_of(folder, frames)])
    return (numbers.argsort(axis=0).argsort(axis=0) - np.arange(frames)[:, None]).astype(np.float64)


def png_surplus(folder: Path, frames: int) -> Array:
    """Bytes of a picture beyond those that the usual encoder needs for its pixels, and whether they are others."""
    out = []
    for index in range(frames):
        row: list[float] = []
        for name in (layout.INPUT, layout.IMAGES):
            path = folder / layout.image_path(name, index)
            data, usual = path.read_bytes(), media.encode_png_rgb(path, media.read_png_rgb(path))
            row += [len(data) - len(usual), data != usual]
        out.append(row)
    return np.array(out, dtype=np.float64)


def png_settings(folder: Path, frames: int) -> Array:
    """Kinds and number of the chunks, the compressor's header, and the mean filter of a picture's rows."""
    out = []
    for index in range(frames):
        data = (folder / layout.image_path(layout.INPUT, index)).read_bytes()
        kinds, pixels, at = b"", b"", 8
        while at + 12 <= len(data):
            (length,) = struct.unpack_from(">I", data, at)
            kinds += data[at + 4 : at + 8]
            if data[at + 4 : at + 8] == b"IDAT":
                pixels += data[at + 8 : at + 8 + length]
            at += 12 + length
        width, height = struct.unpack_from(">II", data, 16)
        rows = zlib.decompress(pixels)
        filters = np.frombuffer(rows, np.uint8)[:: len(rows) // height][:height]
        out.append([zlib.crc32(kinds), len(kinds), pixels[1], float(filters.mean()), width])
    return np.array(out, dtype=np.float64)


def second_name(folder: Path, frames: int) -> Array:
    """Pixels that differ between ``images/`` and ``input/``."""
    names = [[folder / layout.image_path(name, i) for name in (layout.INPUT, layout.IMAGES)] for i in range(frames)]
    return np.array([(media.read_png_rgb(a) != media.read_png_rgb(b)).sum() for a, b in names], dtype=np.float64)


def wav_heads(folder: Path, frames: int) -> Array:
    """Everything before and after the samples of the clips."""
    out = []
    for index in range(frames):
        row = []
        for name in _CLIPS:
            data = (folder / layout.audio_path(name, index)).read_bytes()
            at = data.find(b"data") + 4
            (length,) = struct.unpack_from("<I", data, at)
            row += [zlib.crc32(data[8 : at - 4] + data[at + 4 + length :]), at]
        out.append(row)
    return np.array(out, dtype=np.float64)


def mono_levels(folder: Path, frames: int) -> Array:
    """What the mono clips have beyond the binaural ones: level (dB), largest difference."""
    clips = [media.read_wav(folder / layout.audio_path(layout.BINAURAL, i)).samples for i in range(frames)]
    out = []
    for index in range(frames):
        mono = media.read_wav(folder / layout.audio_path(layout.MONO, index)).samples.mean(axis=0)
        usual = mono_clip(clips, index)
        level = 10 * np.log10((np.mean(mono**2) + 1e-20) / (np.mean(usual**2) + 1e-20))
        out.append([level, float(np.abs(mono - usual).max())])
    return np.array(out, dtype=np.float64)


def sightings(folder: Path, frames: int) -> Array:
    """Number of points of the sparse model that each picture shows, and its ids."""
    images = read_images(folder / layout.COLMAP / "images.bin")
    return np.array([[len(one.pixels), one.id, one.camera] for one in images], dtype=np.float64)
