"""Pictures and sound on disk: atomic writers with the same bytes on every run, readers that report damage.

Arrays: RGB (H, W, 3) uint8; masks (H, W) bool, on disk 0 or 255; instance ids (H, W) integers; depth (H, W) metres
along the optical axis, on disk 16-bit millimetres with 0 = nothing met; sound (channels, n) float32, channel 0 left.

Sound is stored as 32-bit float: a source behind two walls is 40–60 dB below a near one, and 16 bits would leave it
40 dB or less above the quantisation noise. The header has no PEAK chunk: libsndfile would put the time into it.

Examples:
    >>> mask = np.arange(12).reshape(3, 4) > 6  # (H, W) bool
    >>> media.write_png_mask("mask.png", mask)
    >>> bool((media.read_png_mask("mask.png") == mask).all())
    True
    >>> media.write_wav("tone.wav", 0.1 * np.sin(np.arange(4410) / 5), rate=44_100)  # (n,) or (channels, n)
    >>> media.wav_header("tone.wav")
    WavHeader(rate=44100, channels=1, samples=4410, subtype='FLOAT')
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.contract.layout import DEPTH_UNITS_PER_METRE, MOST_CHANNELS, SAMPLE_RATE
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import (
    atomic_path,
    dump_json,
    link_or_copy,
    open_regular,
    read_bytes,
    read_json,
    read_record,
    sha256_bytes,
    sha256_file,
    write_bytes,
    write_json,
)
from avs3d_bench.formats.ply import Ply, read_ply, write_ply_mesh, write_ply_points

__all__ = [
    "Clip",
    "Ply",
    "PngHeader",
    "WavHeader",
    "atomic_path",
    "check_png",
    "decode_png",
    "dump_json",
    "encode_png_categories",
    "encode_png_depth_mm",
    "encode_png_ids",
    "encode_png_mask",
    "encode_png_rgb",
    "encode_rir",
    "encode_wav",
    "link_or_copy",
    "png_header",
    "read_bytes",
    "read_json",
    "read_ply",
    "read_png_depth",
    "read_png_ids",
    "read_png_mask",
    "read_png_rgb",
    "read_record",
    "read_rir",
    "read_wav",
    "sha256_bytes",
    "sha256_file",
    "wav_header",
    "write_bytes",
    "write_json",
    "write_ply_mesh",
    "write_ply_points",
    "write_png_categories",
    "write_png_depth_mm",
    "write_png_ids",
    "write_png_mask",
    "write_png_rgb",
    "write_rir",
    "write_wav",
]

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: Chunks that change how some programs show a picture: transparency, animation.
_PNG_EXTRAS = {b"tRNS": "transparency", b"acTL": "an animation"}
_PNG_MODES = {0: "grey", 2: "RGB", 3: "palette", 4: "grey + alpha", 6: "RGBA"}
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
#: The passes of an interlaced picture: first column and row, steps (PNG, 8.1).
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
#: Place of the bytes in a file that name the methods of compression and filtering, and whether it is interlaced.
_METHODS = slice(26, 29)
#: Filters of a row (PNG, 9.2); the average filter is left to OpenCV.
_NO_FILTER, _SUB_FILTER, _UP_FILTER, _PAETH_FILTER = 0, 1, 2, 4
#: Rows without differences, in place of their filter.
_COPIES, _ZEROS = -2, -1
#: Rows with the Paeth filter up to which a picture is not decoded by OpenCV: each takes about 20 µs.
_MOST_GUESSES = 100
#: Deflate expands no more than 1:1032; a header that claims more belongs to a damaged file.
_MOST_EXPANSION = 1100
#: Bytes inflated at a time: they stay in the processor's cache.
_INFLATED = 2**18
# OpenCV resets the strategy when the level is set, and both when they come after the filter: the order matters.
# Measured at 1008², one core: photograph-like RGB 23 ms (default 25–60 ms, 5 % larger); masks 2 ms; depth 7 ms.
_LEVEL_1 = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_FILTER = getattr(cv2, "IMWRITE_PNG_FILTER", None)
_AVERAGE = [] if _FILTER is None else [_FILTER, cv2.IMWRITE_PNG_FILTER_AVG]
_UP = [] if _FILTER is None else [_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
_RGB_FLAGS = [*_LEVEL_1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY, *_AVERAGE]
_LABEL_FLAGS = [*_LEVEL_1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE, *_UP]
_DEPTH_FLAGS = [*_LEVEL_1, *_AVERAGE]


@dataclass(frozen=True)
class PngHeader:
    """Size and pixel format of a PNG file.

    Attributes:
        width: pixels.
        height: pixels.
        bits: of a channel.
        colour_type: 0 grey, 2 RGB, 3 palette, 4 grey with alpha, 6 RGB with alpha.

    Examples:
        >>> write_png_mask("header.png", np.eye(4, 6))
        >>> png_header("header.png").mode
        'grey, 8 bit'
    """

    width: int
    height: int
    bits: int
    colour_type: int

    @property
    def mode(self) -> str:
        """E.g. ``RGB, 8 bit``."""
        return f"{_PNG_MODES.get(self.colour_type, '?')}, {self.bits} bit"


@dataclass(frozen=True)
class WavHeader:
    """The header of a WAV file.

    Attributes:
        rate: Hz.
        channels: their number.
        samples: of each channel.
        subtype: sample format, e.g. ``FLOAT`` or ``PCM_16``.

    Examples:
        >>> write_wav("short.wav", np.zeros(441), subtype="pcm16")
        >>> wav_header("short.wav")
        WavHeader(rate=44100, channels=1, samples=441, subtype='PCM_16')
    """

    rate: int
    channels: int
    samples: int
    subtype: str


@dataclass(frozen=True, eq=False)
class Clip:
    """Sound: ``samples`` (channels, n) float32, ``rate`` in Hz.

    Examples:
        >>> clip = Clip(np.zeros((2, 44_100), np.float32), 44_100)
        >>> clip.samples.shape[1] / clip.rate  # seconds
        1.0
    """

    samples: F32
    rate: int


def _encode(path: str | Path, pixels: NDArray[Any], flags: list[int]) -> bytes:
    done, data = cv2.imencode(".png", pixels, flags)
    if not done:
        raise Avs3dError(f"{path}: OpenCV could not encode {pixels.shape} {pixels.dtype} as PNG")
    return data.tobytes()


def _image(path: str | Path, pixels: ArrayLike, ndim: int, what: str) -> NDArray[Any]:
    array = np.ascontiguousarray(pixels)
    if array.ndim != ndim or (ndim == 3 and array.shape[2] != 3) or 0 in array.shape:
        raise Avs3dError(f"{path}: {what} has shape {array.shape}, expected {'(H, W, 3)' if ndim == 3 else '(H, W)'}")
    return array


def encode_png_rgb(path: str | Path, pixels: U8) -> bytes:
    """The file that `write_png_rgb` writes; ``path`` names it in messages. So do the other ``encode_…`` functions.

    Raises:
        Avs3dError: if the array is no 8-bit RGB picture.
    """
    array = _image(path, pixels, 3, "the picture")
    if array.dtype != np.uint8:
        raise Avs3dError(f"{path}: the picture is {array.dtype}, expected uint8")
    return _encode(path, array[..., ::-1], _RGB_FLAGS)


def write_png_rgb(path: str | Path, pixels: U8) -> None:
    """Write (H, W, 3) uint8 RGB.

    Raises:
        Avs3dError: if the array is no 8-bit RGB picture or the system refuses.

    Examples:
        >>> picture = np.full((2, 3, 3), [255, 128, 0], np.uint8)
        >>> write_png_rgb("orange.png", picture)
        >>> read_png_rgb("orange.png")[0, 0].tolist()
        [255, 128, 0]
    """
    write_bytes(path, encode_png_rgb(path, pixels))


def encode_png_mask(path: str | Path, mask: ArrayLike) -> bytes:
    """The file that `write_png_mask` writes."""
    array = _image(path, mask, 2, "the mask")
    return _encode(path, (array != 0).astype(np.uint8) * np.uint8(255), _LABEL_FLAGS)


def write_png_mask(path: str | Path, mask: ArrayLike) -> None:
    """Write a (H, W) mask, boolean or of any number type (non-zero = marked), as 0 and 255.

    Raises:
        Avs3dError: if the array has another number of axes or no pixels, or the system refuses.

    Examples:
        >>> write_png_mask("marked.png", np.eye(3))
        >>> mask = read_png_mask("marked.png")
        >>> int(mask.sum()), mask.dtype.name
        (3, 'bool')
    """
    write_bytes(path, encode_png_mask(path, mask))


def encode_png_ids(path: str | Path, ids: ArrayLike) -> bytes:
    """The file that `write_png_ids` writes.

    Raises:
        Avs3dError: if the ids are no integers in [0, 65535].
    """
    array = _image(path, ids, 2, "the instance ids")
    if not np.issubdtype(array.dtype, np.integer) or array.min() < 0 or array.max() > 65535:
        raise Avs3dError(f"{path}: instance ids are {array.dtype}, expected integers from 0 to 65535")
    return _encode(path, array.astype(np.uint8 if array.max() < 256 else np.uint16), _LABEL_FLAGS)


def write_png_ids(path: str | Path, ids: ArrayLike) -> None:
    """Write (H, W) instance ids: 8 bit if all are below 256, else 16 bit.

    Raises:
        Avs3dError: if the ids are no integers in [0, 65535] or the system refuses.

    Examples:
        >>> write_png_ids("ids.png", np.array([[0, 1], [2, 300]]))
        >>> read_png_ids("ids.png").tolist(), png_header("ids.png").bits
        ([[0, 1], [2, 300]], 16)
    """
    write_bytes(path, encode_png_ids(path, ids))


def encode_png_categories(path: str | Path, categories: ArrayLike) -> bytes:
    """The file that `write_png_categories` writes.

    Raises:
        Avs3dError: if they are no integers in [0, 255].
    """
    array = _image(path, categories, 2, "the class ids")
    if not np.issubdtype(array.dtype, np.integer) or array.min() < 0 or array.max() > 255:
        raise Avs3dError(f"{path}: class ids are {array.dtype}, expected integers from 0 to 255")
    return _encode(path, array.astype(np.uint8), _LABEL_FLAGS)


def write_png_categories(path: str | Path, categories: ArrayLike) -> None:
    """Write (H, W) class ids (see `avs3d_bench.contract.taxonomy.class_ids`) in 8 bit, 0 where there is nothing.

    Raises:
        Avs3dError: if they are no integers in [0, 255] or the system refuses.

    Examples:
        >>> write_png_categories("classes.png", np.array([[0, 4]], np.uint8))
        >>> read_png_categories("classes.png").tolist()
        [[0, 4]]
    """
    write_bytes(path, encode_png_categories(path, categories))


def encode_png_depth_mm(path: str | Path, depth: ArrayLike) -> bytes:
    """The file that `write_png_depth_mm` writes."""
    metres = _image(path, np.asarray(depth, dtype=np.float64), 2, "the depth")
    with np.errstate(invalid="ignore"):
        millimetres = np.rint(metres * DEPTH_UNITS_PER_METRE)
        met = np.isfinite(millimetres) & (millimetres > 0) & (millimetres <= 65535)
    return _encode(path, np.where(met, millimetres, 0).astype(np.uint16), _DEPTH_FLAGS)


def write_png_depth_mm(path: str | Path, depth: ArrayLike) -> None:
    """Write (H, W) depth in metres as 16-bit millimetres; not finite, not positive or beyond 65.5 m becomes 0.

    Raises:
        Avs3dError: if the array has another number of axes or no pixels, or the system refuses.

    Examples:
        >>> write_png_depth_mm("depth.png", np.array([[1.2345, np.inf]]))  # metres
        >>> [round(metres, 4) for metres in read_png_depth("depth.png")[0].tolist()]
        [1.234, 0.0]
    """
    write_bytes(path, encode_png_depth_mm(path, depth))


def _parse_png_header(data: bytes, path: str | Path) -> PngHeader:
    if data[:8] != _PNG_SIGNATURE:
        raise Avs3dError(f"{path}: {'empty' if not data else 'not a PNG'} file; expected a PNG picture")
    if len(data) < 33 or data[12:16] != b"IHDR":
        raise Avs3dError(f"{path}: truncated after {len(data)} bytes; expected a whole PNG picture")
    width, height, bits, colour_type = struct.unpack(">IIBB", data[16:26])
    return PngHeader(width, height, bits, colour_type)


def png_header(path: str | Path) -> PngHeader:
    """Size and pixel format, from the first 33 bytes.

    Raises:
        Avs3dError: if the file is missing, is no PNG or ends there.

    Examples:
        >>> write_png_rgb("small.png", np.zeros((48, 64, 3), np.uint8))
        >>> png_header("small.png")
        PngHeader(width=64, height=48, bits=8, colour_type=2)
    """
    return _parse_png_header(_head(path, 33), path)


def _head(path: str | Path, count: int) -> bytes:
    with open_regular(path) as stream:
        return stream.read(count)


def _check_chunks(data: bytes, path: str | Path, *, plain: bool) -> tuple[list[memoryview], list[bytes]]:
    """Walk the chunks and their CRCs: OpenCV fills in the missing part of a truncated file without an error.

    A ``plain`` picture holds no transparency, no animation and nothing after its end.

    Returns:
        the compressed data of the pixels, in pieces, and the kinds of all chunks.
    """
    at, ended, pixels, kinds = len(_PNG_SIGNATURE), False, list[memoryview](), list[bytes]()
    while at < len(data) and not ended:
        if at + 12 > len(data):
            break
        length, kind = struct.unpack_from(">I4s", data, at)
        stop = at + 12 + length
        if stop > len(data):
            break
        (crc,) = struct.unpack_from(">I", data, stop - 4)
        if zlib.crc32(memoryview(data)[at + 4 : stop - 4]) != crc:
            raise Avs3dError(f"{path}: damaged PNG (checksum of chunk {kind.decode('latin-1')!r}); regenerate it")
        if kind == b"IDAT":
            pixels.append(memoryview(data)[at + 8 : stop - 4])
        if plain and kind in _PNG_EXTRAS:
            raise Avs3dError(f"{path}: a PNG with {_PNG_EXTRAS[kind]}; expected one plain picture")
        kinds.append(kind)
        ended = kind == b"IEND"
        at = stop
    if plain and ended and at < len(data):
        raise Avs3dError(f"{path}: {len(data) - at:,} bytes after the end of the picture; expected one plain picture")
    if not ended:
        raise Avs3dError(f"{path}: truncated after {len(data)} bytes; expected a whole PNG picture")
    return pixels, kinds


def check_png(path: str | Path) -> None:
    """Check a PNG file whole: signature, every checksum, and that the data holds every row and no more.

    Raises:
        Avs3dError: if the file is missing, truncated or damaged.
    """
    data = read_bytes(path)
    _parse_png_header(data, path)
    pixels, _ = _check_chunks(data, path, plain=False)
    for _ in _inflate(pixels, _raw_size(data), path):
        pass


def _raw_size(data: bytes) -> int:
    """Bytes of a picture's rows before compression: each has a byte for its filter before its pixels (PNG, 7.3)."""
    width, height, bits, colour_type, _, _, interlace = struct.unpack_from(">IIBBBBB", data, 16)
    depth = bits * _PNG_CHANNELS.get(colour_type, 1)
    passes = _ADAM7 if interlace else ((0, 0, 1, 1),)
    sizes = [(-(-(width - x) // dx), -(-(height - y) // dy)) for x, y, dx, dy in passes]
    return sum(rows * (1 + (columns * depth + 7) // 8) for columns, rows in sizes if columns > 0 and rows > 0)


def _inflate(pixels: list[memoryview], expected: int, path: str | Path, most: int = _INFLATED) -> Iterator[bytes]:
    """Inflate the picture's data: libpng stops after the last row; it sees neither what follows nor the checksum.

    Yields:
        blocks of at most ``most`` bytes of the picture's filtered rows. After the last block it is known that the rows
        are whole and that nothing follows them.
    """
    pixels = [piece for piece in pixels if len(piece)]
    inflate = zlib.decompressobj()
    found = 0
    try:
        for piece in pixels:
            rest: bytes | memoryview = piece
            while rest and not inflate.eof and found <= expected:
                block = inflate.decompress(rest, most)
                found += len(block)
                yield block
                rest = inflate.unconsumed_tail
            if inflate.eof and (inflate.unused_data or piece is not pixels[-1]):
                raise Avs3dError(f"{path}: damaged PNG (data after the end of its pixels); regenerate it")
        while not inflate.eof and found <= expected and (block := inflate.decompress(b"", most)):
            found += len(block)
            yield block
    except zlib.error as error:
        raise Avs3dError(f"{path}: damaged PNG ({error}); regenerate it") from None
    if found != expected or not inflate.eof:
        more = "more than" if found > expected else f"{found:,} bytes of pixels, not"
        raise Avs3dError(f"{path}: damaged PNG ({more} the {expected:,} of its size); regenerate it")


def _inflate_grey(pixels: list[memoryview], header: PngHeader, path: str | Path) -> U8 | None:
    """Inflate the data of an 8-bit grey picture that is not interlaced, and undo its filters (PNG, 9.2).

    OpenCV would have to inflate it once more. Rows are handled whole, which is as fast as compiled code where most
    rows equal the row above, as in masks.

    Returns:
        (H, W) uint8; None where OpenCV is faster, or a filter is unknown.

    Raises:
        Avs3dError: if the data is damaged.
    """
    width, height = header.width, header.height
    out = np.empty((height, width), np.uint8)
    above = np.zeros(width, np.uint8)
    done = guesses = 0
    decoded = True
    left = b""
    row_bytes = 1 + width
    most = max(1, _INFLATED // row_bytes) * row_bytes
    for block in _inflate(pixels, row_bytes * height, path, most):
        data = left + block if left else block
        count = min(len(data) // row_bytes, height - done) if decoded else 0
        left = data[count * row_bytes :] if decoded else b""
        rows = np.frombuffer(data, np.uint8, count * row_bytes).reshape(count, row_bytes)
        target = out[done : done + count]
        steps = _steps(rows)
        starts = np.flatnonzero((steps >= 0) | (np.diff(steps, prepend=0) != 0)).tolist()
        for kind, at, end in zip(steps[starts].tolist(), starts, [*starts[1:], count], strict=False):
            if kind == _COPIES:
                target[at:end] = above
            elif kind == _ZEROS:
                target[at:end] = 0
            elif kind == _NO_FILTER:
                target[at] = rows[at, 1:]
            elif kind == _UP_FILTER:
                np.add(rows[at, 1:], above, out=target[at])
            elif kind == _SUB_FILTER:
                np.add.accumulate(rows[at, 1:], dtype=np.uint8, out=target[at])
            elif kind == _PAETH_FILTER and guesses < _MOST_GUESSES:
                guesses += 1
                target[at] = _unfilter_paeth(rows[at, 1:], above)
            else:
                decoded = False
                break
            above = target[end - 1]
        done += count
    return out if decoded and (not guesses or is_binary(out)) else None


def _steps(rows: U8) -> NDArray[np.int16]:
    """Filter of each row, or `_COPIES`, `_ZEROS` for rows without differences: copies of the row above, or zeros.

    Args:
        rows: (n, 1 + W) filters and filtered pixels.
    """
    kinds = rows[:, 0].astype(np.int16)
    flat = rows[:, 1:].max(axis=1, initial=0) == 0
    kinds[flat & ((kinds == _UP_FILTER) | (kinds == _PAETH_FILTER))] = _COPIES
    kinds[flat & ((kinds == _NO_FILTER) | (kinds == _SUB_FILTER))] = _ZEROS
    return kinds


def _unfilter_paeth(row: U8, above: U8) -> U8:
    """Undo the Paeth filter of a row, if all pixels of it and of the row above are 0 or 255.

    Then the predictor is the pixel above where that differs from its left neighbour, else the pixel to the left: all of
    a stretch is the sum of differences since its start. A row that comes out as 0 and 255 alone is right, because
    every pixel has its one predictor.
    """
    starts = np.empty(len(row), np.bool_)
    starts[0] = True
    np.not_equal(above[1:], above[:-1], out=starts[1:])
    sums = np.add.accumulate(row, dtype=np.uint8)
    at = np.flatnonzero(starts)
    offsets = above[at] + row[at] - sums[at]
    return np.asarray(sums + np.repeat(offsets, np.diff(at, append=len(row))), np.uint8)


def is_binary(pixels: U8) -> bool:
    """Whether all pixels of a grey picture (H, W) are 0 or 255."""
    # No value exceeds 255, so the sum reaches 255 × the count of non-zero pixels only if all of them are 255.
    return bool(cv2.sumElems(pixels)[0] == 255.0 * cv2.countNonZero(pixels))


def _is_simple(data: bytes, header: PngHeader, kinds: list[bytes]) -> bool:
    """Whether a picture is one for `_inflate_grey`: about any other, OpenCV decides whether it is a PNG at all.

    Args:
        data: the file.
        header: its header.
        kinds: of its chunks. Simple is a header, then any chunks that decoders may skip (PNG, 5.4: their names begin
            with a small letter), with the pixels in one run between them.
    """
    if (header.colour_type, header.bits, data[_METHODS]) != (0, 8, b"\0\0\0"):
        return False
    if data[8:12] != struct.pack(">I", 13) or _raw_size(data) > _MOST_EXPANSION * len(data):
        return False
    between = kinds[1:-1]
    first, count = between.index(b"IDAT") if b"IDAT" in between else 0, between.count(b"IDAT")
    others = between[:first] + between[first + count :]
    return kinds[0] == b"IHDR" and count > 0 and all(kind.isalpha() and kind[:1].islower() for kind in others)


def decode_png(
    path: str | Path,
    flag: int,
    check: Callable[[PngHeader], None] | None = None,
    *,
    plain: bool = False,
    data: bytes | None = None,
) -> NDArray[Any]:
    """Read a PNG file and decode it with OpenCV, after every chunk's checksum was found right.

    Args:
        path: the file.
        flag: of ``cv2.imdecode``.
        check: called with the header before anything is decoded; it raises what is wrong with it.
        plain: refuse transparency, animation, data after the end of the picture or of its last row, and pixels that
            fail their own checksum (Adler-32).
        data: the file's bytes, if they are at hand; ``path`` only names it then.

    Raises:
        Avs3dError: if the file is missing, truncated or damaged.
    """
    data = read_bytes(path) if data is None else data
    header = _parse_png_header(data, path)
    if check is not None:
        check(header)
    pieces, kinds = _check_chunks(data, path, plain=plain)
    if plain and flag == cv2.IMREAD_UNCHANGED and _is_simple(data, header, kinds):
        found = _inflate_grey(pieces, header, path)
        if found is not None:
            return found
    elif plain:
        for _ in _inflate(pieces, _raw_size(data), path):
            pass
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flag)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise Avs3dError(f"{path}: damaged PNG (it cannot be decoded); regenerate it")
    return pixels


def _decode(path: str | Path, flag: int, data: bytes | None = None) -> tuple[NDArray[Any], PngHeader]:
    headers: list[PngHeader] = []
    return decode_png(path, flag, headers.append, data=data), headers[0]


def read_png_rgb(path: str | Path) -> U8:
    """Read an 8-bit RGB picture (an alpha channel is dropped) as (H, W, 3) uint8.

    Raises:
        Avs3dError: if the file is missing, truncated or has another pixel format.
    """
    pixels, header = _decode(path, cv2.IMREAD_COLOR)
    if header.bits != 8 or header.colour_type not in (2, 6):
        raise Avs3dError(f"{path}: {header.mode}, expected RGB, 8 bit")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)


def read_png_mask(path: str | Path) -> Mask:
    """Read a mask as (H, W) bool; grey or, as some tools save it, RGB with three equal channels.

    Raises:
        Avs3dError: if the file is missing or truncated, or holds values other than 0 and 255.
    """
    pixels, header = _decode(path, cv2.IMREAD_UNCHANGED)
    if header.bits not in (1, 8) or header.colour_type == 4:
        raise Avs3dError(f"{path}: {header.mode}, expected a mask: grey, 8 bit")
    if pixels.ndim == 3:
        if np.any(pixels[..., 0] != pixels[..., 1]) or np.any(pixels[..., 0] != pixels[..., 2]):
            raise Avs3dError(f"{path}: a coloured picture, expected a mask: grey, 8 bit, 0 or 255")
        pixels = pixels[..., 0]
    mask = pixels == 255
    if cv2.countNonZero(pixels) != cv2.countNonZero(mask.view(np.uint8)):
        odd = pixels[~mask & (pixels != 0)]
        values = ", ".join(str(v) for v in np.unique(odd)[:4])
        raise Avs3dError(f"{path}: {odd.size} mask pixels are neither 0 nor 255 (found {values}); threshold the mask")
    return np.asarray(mask, dtype=np.bool_)


def read_png_ids(path: str | Path, data: bytes | None = None) -> NDArray[np.uint16]:
    """Read instance ids (grey, 8 or 16 bit) as (H, W) uint16, from ``data`` if the file's bytes are at hand.

    Raises:
        Avs3dError: if the file is missing, truncated or has another pixel format.
    """
    pixels, header = _decode(path, cv2.IMREAD_UNCHANGED, data)
    if header.colour_type != 0 or header.bits not in (8, 16):
        raise Avs3dError(f"{path}: {header.mode}, expected instance ids: grey, 8 or 16 bit")
    return np.asarray(pixels, dtype=np.uint16)


def read_png_categories(path: str | Path) -> NDArray[np.uint8]:
    """Read class ids (grey, 8 bit) as (H, W) uint8.

    Raises:
        Avs3dError: if the file is missing, truncated or has another pixel format.
    """
    pixels, header = _decode(path, cv2.IMREAD_UNCHANGED)
    if header.colour_type != 0 or header.bits != 8:
        raise Avs3dError(f"{path}: {header.mode}, expected class ids: grey, 8 bit")
    return np.asarray(pixels, dtype=np.uint8)


def read_png_depth(path: str | Path) -> F32:
    """Read 16-bit millimetres as (H, W) float32 metres; 0 where the ray met nothing.

    Raises:
        Avs3dError: if the file is missing, truncated or has another pixel format.
    """
    pixels, header = _decode(path, cv2.IMREAD_UNCHANGED)
    if header.colour_type != 0 or header.bits != 16:
        raise Avs3dError(f"{path}: {header.mode}, expected depth: grey, 16 bit")
    return np.asarray(pixels, dtype=np.float32) / np.float32(DEPTH_UNITS_PER_METRE)


def write_wav(
    path: str | Path, samples: ArrayLike, rate: int = SAMPLE_RATE, subtype: Literal["float", "pcm16"] = "float"
) -> None:
    """Write sound.

    Args:
        path: the file.
        samples: (channels, n) or (n,), full scale ±1.
        rate: Hz.
        subtype: 32-bit float, or 16-bit integers.

    Raises:
        Avs3dError: if a sample is not finite, would clip in 16 bits, or the system refuses.

    Examples:
        >>> write_wav("stereo.wav", np.zeros((2, 4410)), rate=44_100)
        >>> clip = read_wav("stereo.wav")
        >>> clip.samples.shape, clip.samples.dtype.name, clip.rate
        ((2, 4410), 'float32', 44100)
    """
    write_bytes(path, encode_wav(path, samples, rate, subtype))


def encode_wav(
    path: str | Path, samples: ArrayLike, rate: int = SAMPLE_RATE, subtype: Literal["float", "pcm16"] = "float"
) -> bytes:
    """The file that `write_wav` writes.

    Raises:
        Avs3dError: if a sample is not finite, or would clip in 16 bits.
    """
    from scipy.io import wavfile  # writes neither PEAK chunk nor time

    array = np.atleast_2d(np.asarray(samples, dtype=np.float32))
    if array.ndim != 2 or array.shape[1] == 0 or not 1 <= array.shape[0] <= MOST_CHANNELS:
        raise Avs3dError(f"{path}: sound has shape {array.shape}, expected (channels, samples)")
    bad = int((~np.isfinite(array)).sum())
    if bad:
        raise Avs3dError(f"{path}: {bad} samples are NaN or infinite; check the impulse response")
    data: NDArray[Any] = array.T
    if subtype == "pcm16":
        if np.abs(data).max() > 1.0:
            raise Avs3dError(f"{path}: peak {np.abs(data).max():.3f} clips in 16 bits; lower the gain or write float")
        data = np.rint(np.minimum(data * 32768.0, 32767.0)).astype(np.int16)
    stream = io.BytesIO()
    wavfile.write(stream, rate, np.ascontiguousarray(data))
    return stream.getvalue()


def _check_riff(path: str | Path, stream: BinaryIO) -> None:
    """Detect a truncated file by the sizes in its header; libsndfile reads it as a shorter one."""
    head = stream.read(12)
    if head[:4] != b"RIFF" or head[8:12] != b"WAVE":
        raise Avs3dError(f"{path}: {'empty' if not head else 'not a WAV'} file; expected a WAV file")
    announced, found = struct.unpack("<I", head[4:8])[0] + 8, stream.seek(0, os.SEEK_END)
    if found < announced:
        raise Avs3dError(f"{path}: truncated: {found} of {announced} bytes; regenerate it")
    stream.seek(0)


def _cause(error: Exception) -> str:
    """The message of libsndfile, without the name of the stream object."""
    return str(getattr(error, "error_string", error))


def wav_header(path: str | Path) -> WavHeader:
    """Rate, channels and length without decoding.

    Raises:
        Avs3dError: if the file is missing, truncated or no WAV.
    """
    import soundfile

    with open_regular(path) as stream:
        _check_riff(path, stream)
        try:
            info = soundfile.info(stream)
        except soundfile.SoundFileError as error:
            raise Avs3dError(f"{path}: damaged WAV: {_cause(error)}") from None
    return WavHeader(info.samplerate, info.channels, info.frames, info.subtype)


def read_wav(path: str | Path, data: bytes | None = None) -> Clip:
    """Read a WAV file of any sample format, from ``data`` if its bytes are at hand.

    Raises:
        Avs3dError: if it is missing, truncated, no WAV, or a sample is not finite.
    """
    import soundfile

    with open_regular(path) if data is None else io.BytesIO(data) as stream:
        _check_riff(path, stream)
        try:
            samples, rate = soundfile.read(stream, dtype="float32", always_2d=True)
        except soundfile.SoundFileError as error:
            raise Avs3dError(f"{path}: damaged WAV: {_cause(error)}") from None
    bad = int((~np.isfinite(samples)).sum())
    if bad:
        raise Avs3dError(f"{path}: {bad} samples are NaN or infinite; regenerate it")
    return Clip(np.ascontiguousarray(samples.T), int(rate))


def write_rir(path: str | Path, response: ArrayLike, rate: int = SAMPLE_RATE, channels: int = 2) -> None:
    """Write a room impulse response (channels, n) as a compressed npz with ``rir`` float32 and ``sample_rate``.

    Args:
        path: the file.
        response: (channels, n).
        rate: Hz.
        channels: how many it must have; 2 are the ears.

    Raises:
        Avs3dError: if it has another number of channels, a sample is not finite or the system refuses.

    Examples:
        >>> write_rir("rir.npz", np.eye(2, 100), rate=48_000)
        >>> read_rir("rir.npz").samples.shape, read_rir("rir.npz").rate
        ((2, 100), 48000)
    """
    write_bytes(path, encode_rir(path, response, rate, channels))


def encode_rir(path: str | Path, response: ArrayLike, rate: int = SAMPLE_RATE, channels: int = 2) -> bytes:
    """The file that `write_rir` writes.

    Raises:
        Avs3dError: if it has another number of channels, or a sample is not finite.
    """
    array = np.asarray(response, dtype=np.float32)
    if array.ndim != 2 or array.shape[0] != channels or not np.isfinite(array).all():
        raise Avs3dError(f"{path}: impulse response of shape {array.shape}, expected ({channels}, n) finite samples")
    stream = io.BytesIO()
    np.savez_compressed(stream, rir=array, sample_rate=np.int64(rate))
    return stream.getvalue()


def read_rir(path: str | Path, channels: int = 2) -> Clip:
    """Read what `write_rir` wrote with the same number of channels.

    Raises:
        Avs3dError: if it is missing, damaged or has other contents.
    """
    data = read_bytes(path)
    try:
        with np.load(io.BytesIO(data)) as archive:
            response, rate = archive["rir"], int(archive["sample_rate"])
    except (OSError, ValueError, KeyError, EOFError, zlib.error) as error:
        raise Avs3dError(f"{path}: no impulse response ({error}); expected an npz with rir and sample_rate") from None
    except Exception as error:
        # zipfile raises its own BadZipFile, which the line above cannot name without importing zipfile.
        raise Avs3dError(f"{path}: damaged npz: {error}") from None
    if response.ndim != 2 or response.shape[0] != channels or not np.isfinite(response).all():
        raise Avs3dError(f"{path}: impulse response of shape {response.shape}, expected ({channels}, n) finite samples")
    return Clip(response.astype(np.float32), rate)
