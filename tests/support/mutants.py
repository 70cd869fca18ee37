"""Submissions broken on purpose; every mutation lists the files that it broke."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from avs3d_bench.contract import layout
from tests.support import tiny

Rng = np.random.Generator
#: A mutation changes the submission and returns the paths (relative) that must be named.
Mutation = Callable[[Path, Rng], list[str]]
MUTATIONS: dict[str, Mutation] = {}


def mutation(function: Mutation) -> Mutation:
    MUTATIONS[function.__name__] = function
    return function


def masks(root: Path) -> list[Path]:
    found = (p for p in root.rglob("*.png") if p.parent.name == "masks" or p.parts[-3:-1] == ("masks", "test"))
    return sorted(p for p in found if p.is_file() and not p.is_symlink())


def one(root: Path, rng: Rng) -> Path:
    """A mask that no mutation has touched yet."""
    untouched = [p for p in masks(root) if p.name != TRAIN_MASK and sane(p)]
    return untouched[int(rng.integers(len(untouched)))]


def sane(path: Path) -> bool:
    if path.stat().st_size > 2**20:
        return False
    data = path.read_bytes()
    if data[:8] != b"\x89PNG\r\n\x1a\n" or len(data) < 40:
        return False
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    known = pixels is not None and pixels.shape == (tiny.SIZE, tiny.SIZE) and pixels.dtype == np.uint8
    return bool(known and set(np.unique(pixels)) <= {0, 255})


def name(root: Path, path: Path) -> str:
    return path.relative_to(root).as_posix()


def rewrite(path: Path, pixels: np.ndarray) -> None:
    tiny.replace(path, cv2.imencode(".png", pixels)[1].tobytes())


def chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], 8
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    return found


def png(parts: list[tuple[bytes, bytes]]) -> bytes:
    out = b"\x89PNG\r\n\x1a\n"
    for kind, body in parts:
        out += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return out


def with_header(data: bytes, **fields: int) -> bytes:
    """The same picture under another IHDR, its checksum right."""
    parts = chunks(data)
    width, height, bits, colour, *rest = struct.unpack(">IIBBBBB", parts[0][1])
    width, height = fields.get("width", width), fields.get("height", height)
    bits, colour = fields.get("bits", bits), fields.get("colour", colour)
    return png([(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, *rest)), *parts[1:]])


#: What `train_mask` makes: no later mutation touches it, so that it stays to be named.
TRAIN_MASK = "frame_001.png"


@mutation
def flip_bytes(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    data = bytearray(path.read_bytes())
    for at in rng.integers(0, len(data), int(rng.integers(1, 5))):
        data[at] ^= int(rng.integers(1, 256))
    if bytes(data) == path.read_bytes():  # two flips undid each other
        data[20] ^= 1
    tiny.replace(path, bytes(data))
    return [name(root, path)]


@mutation
def truncate(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    data = path.read_bytes()
    tiny.replace(path, data[: int(rng.integers(1, len(data)))])
    return [name(root, path)]


@mutation
def empty(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    tiny.replace(path, b"")
    return [name(root, path)]


@mutation
def delete(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    path.unlink()
    return [name(root, path)]


@mutation
def rename(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    number = int(path.stem[-3:])
    other = path.with_name(
        str(rng.choice([f"frame_{number}.png", f"frame_{number:04d}.png", f"FRAME_{number:03d}.png", f"{number}.png",
                        f"frame_{number:03d}.PNG", f"frame_{number:03d}.jpg", f" {path.name}", f"{path.name}.bak"]))
    )  # fmt: skip
    path.rename(other)
    return [name(root, path), name(root, other)]


@mutation
def resize(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    height, width = (int(x) for x in rng.integers(1, 3 * tiny.SIZE, 2))
    width += width == tiny.SIZE
    rewrite(path, np.zeros((height, width), np.uint8))
    return [name(root, path)]


@mutation
def wrong_mode(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    grey = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    rewrite(path, [cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA),
                   grey.astype(np.uint16) * 257][int(rng.integers(3))])  # fmt: skip
    return [name(root, path)]


@mutation
def grey_and_alpha(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    row = b"\0" + bytes(rng.integers(0, 2, 2 * tiny.SIZE, dtype=np.uint8) * 255)
    parts = chunks(with_header(path.read_bytes(), colour=4))
    tiny.replace(path, png([parts[0], (b"IDAT", zlib.compress(row * tiny.SIZE)), (b"IEND", b"")]))
    return [name(root, path)]


@mutation
def transparent(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    header, *rest = chunks(path.read_bytes())
    tiny.replace(path, png([header, (b"tRNS", b"\0" + bytes([255 * int(rng.integers(2))])), *rest]))
    return [name(root, path)]


@mutation
def animated(root: Path, rng: Rng) -> list[str]:
    """A second frame, as APNG has it: programs disagree about which of the two is the picture."""
    path = one(root, rng)
    header, *pixels, end = chunks(path.read_bytes())
    black = zlib.compress(bytes(tiny.SIZE * (tiny.SIZE + 1)))
    frames = [(b"fcTL", struct.pack(">5I2H2B", n, tiny.SIZE, tiny.SIZE, 0, 0, 1, 1, 0, 0)) for n in (0, 1)]
    second = (b"fdAT", struct.pack(">I", 2) + black)
    tiny.replace(path, png([header, (b"acTL", struct.pack(">2I", 2, 0)), frames[0], *pixels, frames[1], second, end]))
    return [name(root, path)]


@mutation
def after_the_end(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    data = path.read_bytes()
    tiny.replace(path, data + [b"\0", b"garbage" * 9, data][int(rng.integers(3))])
    return [name(root, path)]


@mutation
def pixels_cut(root: Path, rng: Rng) -> list[str]:
    """Too few rows in a stream that ends well, every checksum right."""
    path = one(root, rng)
    header = chunks(path.read_bytes())[0]
    rows = bytes(int(rng.integers(0, tiny.SIZE)) * (tiny.SIZE + 1))
    tiny.replace(path, png([header, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]))
    return [name(root, path)]


@mutation
def pixels_surplus(root: Path, rng: Rng) -> list[str]:
    """Rows, a stream or rubbish after the last row, or a wrong Adler-32; every checksum of a chunk is right."""
    path = one(root, rng)
    header = chunks(path.read_bytes())[0]
    rows = bytes(tiny.SIZE * (tiny.SIZE + 1))
    good = zlib.compress(rows)
    wrong = good[:-1] + bytes([good[-1] ^ 1])
    data = [zlib.compress(rows + bytes(int(rng.integers(1, 200)))), good + b"rubbish", good + good, wrong, good[:-2]]
    chosen = data[int(rng.integers(len(data)))]
    cut = int(rng.integers(0, len(chosen)))
    parts = [(b"IDAT", chosen[:cut]), (b"IDAT", chosen[cut:])] if rng.integers(2) else [(b"IDAT", chosen)]
    tiny.replace(path, png([header, *parts, (b"IEND", b"")]))
    return [name(root, path)]


@mutation
def palette(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    data = with_header(path.read_bytes(), colour=3)
    parts = chunks(data)
    colours = bytes(rng.integers(0, 256, 768, dtype=np.uint8))
    tiny.replace(path, png([parts[0], (b"PLTE", colours), *parts[1:]]))
    return [name(root, path)]


@mutation
def colour(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    rewrite(path, rng.integers(0, 256, (tiny.SIZE, tiny.SIZE, 3)).astype(np.uint8))
    return [name(root, path)]


@mutation
def grey_values(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    grey = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    for _ in range(int(rng.integers(1, 20))):
        row, column = rng.integers(0, tiny.SIZE, 2)
        grey[row, column] = rng.integers(1, 255)
    rewrite(path, grey)
    return [name(root, path)]


@mutation
def zero_and_one(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    rewrite(path, np.eye(tiny.SIZE, dtype=np.uint8))
    return [name(root, path)]


@mutation
def gigantic(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    sizes = {"width": int(rng.integers(2**16, 2**31)), "height": int(rng.integers(2**16, 2**31))}
    tiny.replace(path, with_header(path.read_bytes(), **sizes))
    return [name(root, path)]


@mutation
def no_pixels(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    tiny.replace(path, with_header(path.read_bytes(), width=0, height=0))
    return [name(root, path)]


@mutation
def not_a_picture(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    tiny.replace(path, [b"GIF89a", b"\xff\xd8\xff\xe0JFIF", b"{}", bytes(rng.integers(0, 256, 500, dtype=np.uint8))][
        int(rng.integers(4))
    ])  # fmt: skip
    return [name(root, path)]


@mutation
def enormous_file(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    data = path.read_bytes()
    path.unlink()
    with path.open("wb") as stream:  # sparse: it takes no room
        stream.write(data)
        stream.truncate(int(rng.integers(2**30, 2**36)))
    return [name(root, path)]


@mutation
def fifo(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    path.unlink()
    os.mkfifo(path)
    return [name(root, path)]


@mutation
def folder(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    path.unlink()
    path.mkdir()
    return [name(root, path)]


@mutation
def link_out(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    outside = root.parent / f"outside_{path.relative_to(root).parts[0]}_{path.name}"
    path.rename(outside)
    path.symlink_to([outside, os.path.relpath(outside, path.parent)][int(rng.integers(2))])
    return [name(root, path)]


@mutation
def link_broken(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    path.unlink()
    path.symlink_to(["nowhere.png", path.name, "/dev/zero", "/dev/null", "."][int(rng.integers(5))])
    return [name(root, path)]


@mutation
def folder_link_out(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng).parent
    outside = root.parent / f"outside_{path.relative_to(root).parts[0]}_masks"
    if outside.exists():
        return []
    path.rename(outside)
    path.symlink_to(outside)
    return [name(root, path)]


@mutation
def folder_link_inside(root: Path, rng: Rng) -> list[str]:
    """A folder that is the link to another: each link to a file would be fine."""
    path = one(root, rng).parent
    aside = root / f"aside_{path.relative_to(root).parts[0]}_masks"
    if aside.exists():
        return []
    path.rename(aside)
    path.symlink_to(os.path.relpath(aside, path.parent))
    return [name(root, path)]


@mutation
def deeper(root: Path, rng: Rng) -> list[str]:
    """A mask in a folder of its own, or below hundreds of them."""
    path = one(root, rng)
    other = path.parent.joinpath(*["deeper"] * int(rng.choice([1, 2, 300])), path.name)
    other.parent.mkdir(parents=True, exist_ok=True)
    path.rename(other)
    return [name(root, path), name(root, path.parent / "deeper")]


@mutation
def train_mask(root: Path, rng: Rng) -> list[str]:
    path = one(root, rng)
    other = path.with_name(TRAIN_MASK)
    other.write_bytes(path.read_bytes())
    return [name(root, other)]


@mutation
def surplus(root: Path, rng: Rng) -> list[str]:
    parent = one(root, rng).parent
    strange = ["Thumbs.db", "frame_999.png", "name\nwith line.png", "mask\x1b[31m.png"][int(rng.integers(4))]
    path = [parent, parent.parent][int(rng.integers(2))] / strange
    path.write_bytes(b"x")
    return [name(root, path).encode("unicode_escape").decode()]


@mutation
def undecodable_name(root: Path, rng: Rng) -> list[str]:
    parent = one(root, rng).parent
    with open(os.fsencode(parent) + b"/caf\xe9.png", "wb"):
        pass
    return [f"{name(root, parent)}/caf\\udce9.png"]


@mutation
def other_observation(root: Path, rng: Rng) -> list[str]:
    path = root / "part_1" / "elsewhere" / "kitchen" / "1" / "masks" / "frame_000.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(one(root, rng).read_bytes())
    return [name(root, path), name(root, path.parent.parent)]


@mutation
def bad_record(root: Path, rng: Rng) -> list[str]:
    path = root / layout.SUBMISSION_JSON
    said = {"method": "m", "dataset": "tiny", "dataset_version": "1"}
    choice = int(rng.integers(11))
    text = [
        "{", "", "[]", "null", json.dumps(said | {"dataset": "other"}), json.dumps(said | {"dataset_version": "2"}),
        json.dumps(said | {"surprise": 1}), json.dumps({"method": "m"}), "[" * 100_000,
        json.dumps(said | {"two\nlines\x1b[31m": 1}), " " * 2**21,
    ][choice]  # fmt: skip
    tiny.replace(path, text.encode())
    return [layout.SUBMISSION_JSON]


@mutation
def no_record(root: Path, rng: Rng) -> list[str]:
    (root / layout.SUBMISSION_JSON).unlink(missing_ok=True)
    return [layout.SUBMISSION_JSON]


def _cloud(root: Path, rng: Rng) -> Path:
    clouds = sorted(root.glob("part_*/*/*/*/points.ply"))
    return clouds[int(rng.integers(len(clouds)))]


@mutation
def bad_cloud(root: Path, rng: Rng) -> list[str]:
    path = _cloud(root, rng)
    head = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
    head += "property float z\nend_header\n"
    point = struct.pack("<3f", 1, 2, 3)
    tiny.replace(path, [
        head.format(1).encode() + struct.pack("<3f", 1, float("nan"), 3),
        head.format(1).encode() + struct.pack("<3f", 1, float("inf"), 3),
        head.format(2).encode() + point,
        head.format(2_000_000_000).encode() + point,
        head.format(-1).encode() + point,
        head.replace("property float z\n", "").format(1).encode() + point,
        head.format(1).replace("binary_little_endian", "ascii").encode() + b"1 2 nan\n",
        head.format(1).replace("binary_little_endian", "ascii").encode() + b"1 2 three\n",
        head.format(1).replace("vertex", "face").encode() + point,
        b"",
        b"ply\n",
        b"not a ply at all",
        head.format(1).replace("float y", "float x").encode() + point,
        head.format(1).replace("float x", "list uchar float x").encode() + b"\3" + bytes(20),
        head.format(1).replace("element", f"element nothing {10**30}\nelement", 1).encode() + point,
        head.format(1).replace("format", f"comment {'x' * 70_000}\nformat").encode() + point,
        head.format(1).replace("float", "double").encode() + struct.pack("<3d", 1, 1e300, 3),
        head.format(1).replace("float", "list uchar float").encode() + (b"\3" + struct.pack("<3f", 1, 2, 3)) * 3,
        head.format(1).encode() + point + b"\0",
        *(head.format(1).replace("binary_little_endian", "ascii").encode() + text for text in (
            b"1 2 3_0\n", b"1 2 +3\n", b"1 2\r3\n", b"1 2 3\r4\n", b"1 2 3\njunk\n", b"1 2 3 4\n", b"1\n2\n3\n",
        )),
    ][int(rng.integers(26))])  # fmt: skip
    return [name(root, path)]


@mutation
def one_cloud_missing(root: Path, rng: Rng) -> list[str]:
    path = _cloud(root, rng)
    if len(list(root.glob("part_*/*/*/*/points.ply"))) < 2:
        return []
    path.unlink()
    return [name(root, path)]


#: What the released pipeline's own folders can have: there is no record, no cloud, and only masks/test/ is looked at.
IN_RELEASED = (
    "flip_bytes", "truncate", "empty", "delete", "rename", "resize", "grey_and_alpha", "transparent", "animated",
    "after_the_end", "pixels_cut", "pixels_surplus", "palette", "colour", "grey_values", "zero_and_one", "gigantic",
    "no_pixels", "not_a_picture", "enormous_file", "fifo", "folder", "link_out", "link_broken", "folder_link_out",
    "deeper", "train_mask", "undecodable_name",
)  # fmt: skip


def broken(root: Path, seed: int, kinds: Sequence[str] = ()) -> tuple[list[str], list[str]]:
    """Break the submission at ``root`` with one to three mutations: (their names, the files that must be named)."""
    rng = np.random.default_rng(seed)
    kinds = list(kinds or MUTATIONS)
    # Every kind comes in turn, so that 300 seeds try each many times.
    chosen = [kinds[seed % len(kinds)], *rng.choice(kinds, int(rng.integers(0, 3)))]
    named: list[str] = []
    for kind in chosen:
        named += [path for path in MUTATIONS[kind](root, rng) if path not in named]
    # What lay in a folder that a later mutation turned into a link is not there to be named any more but through it.
    links = [path for path in named if (root / path).is_symlink() and not (root / path).suffix]
    gone = {path for path in named for link in links if path.startswith(f"{link}/")}
    return [str(kind) for kind in chosen], [path for path in named if path not in gone]
