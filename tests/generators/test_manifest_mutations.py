"""Manifests and lock files damaged on purpose: each one reads, or ends in one clear line within seconds."""

from __future__ import annotations

import copy
import os
import random
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from avs3d_bench.errors import Avs3dError, UsageError
from generators.library.lock import LOCK_NAME, parse_lock
from generators.manifest.reading import read_manifest
from generators.options import GenerateOptions
from generators.plan import check_scans, make_plans
from generators.run.dataset_record import check

MANIFESTS = Path(__file__).parents[2] / "scenes_manifest"
#: The manifest for training has the same fields as the others and takes seconds to read.
SEEDS = sorted(path.name for path in MANIFESTS.glob("*.yaml") if path.name != "train.yaml")
#: Mutants of each committed file, and the seconds that one may take.
EACH, LIMIT = 100, 5

#: A manifest with categories of its own, which none of the committed files has.
OWN_CATEGORIES = """\
name: own
seed: 7
scans: {flat: {source: apartment, seed: 3}}
categories:
  hair_dryer: {stands_on: [table, worktop], height: [0.15, 0.3], turn: 10}
  kettle: {stands_on: [worktop], height: [0.2, 0.25], source_height: 0.9}
  fan: {stands_on: [floor, wall], height: [0.4, 1.2], wall_gap: [0.1, 0.3], wall_height: [1.2, 1.8]}
objects:
  hair_dryer: [{file: dryer.glb, licence: {name: CC0-1.0, author: Jane Doe}}]
  kettle: [{file: kettle.glb, height: 0.24, licence: {name: CC0-1.0, author: Jane Doe}}]
  fan: [{file: fan.glb, licence: {name: CC0-1.0, author: Jane Doe}}]
sounds:
  hair_dryer: [{file: dryer.wav, licence: {name: CC0-1.0, author: Jane Doe}}]
  fan: [{file: fan.flac, licence: {name: CC0-1.0, author: Jane Doe}}]
observations:
  - {part: part_1, scan: flat, room: kitchen, index: 1, category: hair_dryer, silent: [kettle]}
  - {part: part_2, scan: flat, room: kitchen, index: 1, category: fan, instances: 2}
  - {part: part_3, scan: flat, room: kitchen, index: 1, instances: {hair_dryer: 2, clock: 1},
     sources: [{category: hair_dryer, instance: 1}, {category: fan, room: living_room}]}
  - {like: part_3/flat/kitchen/1, index: 2, sources: [{category: clock}]}
"""

#: What stands where something else should.
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 7, 10**39, 1e300, -1e300, float("nan"), float("inf"), "", " ", "\n", "a\nb", "\t", "\x07",
    "\x00", "\x1b[2J", "\x85", "\u2028", "\u202e", "\ud800", "\udfff", "~", "~/x", "~nobody-here/x", "../../etc/passwd",
    "/", ".", "a" * 300, "a" * 5000, "é" * 200, "kitchen ", "Kitchen", "1", "1e3", "2024-11-30", "=", "<<", [], {},
    [[]], [None], [1, 2], {"a": 1}, {1: 2}, {"": ""}, {"a": {"b": {"c": []}}}, ["clock"] * 40, "*",
    "part_1/a/kitchen/1",
)  # fmt: skip
#: What a slip of the hand, or a hostile one, puts into a text.
TOKENS = (
    "\t", "\n", "\n---\n", "\n...\n", "- ", ": ", "? ", "#", "&a ", "*a", "*b ", "<<: *a\n", "[", "]", "{", "}", '"',
    "'", "|", ">", "!", "!!python/object:os.system ", "!!binary ", "%TAG ! x\n", "%", "@", "`", "\0", "\x07", "\ud7ff",
    "\ufeff", "\ufffe", '"\\ud800"', '"\\x07"', '"\\0"', "9" * 5000, "0x" + "f" * 5000, "1:1:1", "1e999", ".inf", "~",
    "null", "é", "[" * 99,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _loaded_modules() -> None:
    """What is loaded once in a process is no matter of a manifest."""
    assert make_plans(read_manifest(MANIFESTS / SEEDS[0]), GenerateOptions(audio="analytic"))


@contextmanager
def at_most(seconds: int) -> Iterator[None]:
    """Fail where the block takes longer."""

    def ring(*_: object) -> None:
        pytest.fail(f"takes longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every collection in a document with each of its keys or indices."""
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from places(value[key])


def of_document(text: str, rng: random.Random) -> bytes:
    """Another value, key or order somewhere in the document."""
    document = copy.deepcopy(_loaded(text))
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        found = list(places(document))
        if not found:
            break
        parent, key = rng.choice(found)
        what = rng.randrange(6)
        if what <= 2:
            parent[key] = copy.deepcopy(rng.choice(VALUES))
        elif what == 3:
            del parent[key]
        elif what == 4:
            other, at = rng.choice(found)
            parent[key] = copy.deepcopy(other[at])
        elif isinstance(parent, dict):
            parent[rng.choice(["", "x", 5, None, "\x07", "name", "like", "file", "a" * 300])] = rng.choice(VALUES)
        else:
            parent.append(rng.choice(VALUES))
    style = rng.choice([None, True])
    options: dict[str, Any] = {
        "sort_keys": False, "allow_unicode": rng.random() < 0.5, "default_flow_style": style,
    }  # fmt: skip
    try:
        text = yaml.dump(document, Dumper=_DUMPER, **options)
    except UnicodeEncodeError:  # half a character, which libyaml does not write
        text = yaml.safe_dump(document, **options)
    return text.encode()


#: That of libyaml takes a fifth of the time.
_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


@lru_cache(maxsize=1)
def _loaded(text: str) -> Any:
    return yaml.safe_load(text)


def of_text(text: str, rng: random.Random) -> bytes:
    """Letters, lines and bytes that were put in, left out or changed."""
    for _ in range(rng.choice([1, 1, 2, 5])):
        at, until = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        what = rng.randrange(5)
        if what <= 1:
            text = text[:at] + rng.choice(TOKENS) + text[at:]
        elif what == 2:
            text = text[:at] + text[min(until, at + rng.randrange(1, 40)) :]
        elif what == 3:
            text = text[:at] + text[at : at + 200] * 2 + text[at:]
        else:
            lines = text.splitlines(keepends=True)
            rng.shuffle(lines)
            text = "".join(lines)
    data = bytearray(text.encode())
    if data and rng.random() < 0.3:
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def outcome(path: Path) -> str:
    """``valid``, or the line that says what is wrong; everything else is a failure of the test."""
    try:
        with at_most(LIMIT):
            if path.name.endswith(LOCK_NAME):
                parse_lock(path.read_bytes(), path)
            else:
                source = read_manifest(path)
                check(source)
                plans = make_plans(source, GenerateOptions(audio="analytic"))
                check_scans(plans)
                for plan in plans[:3]:
                    assert plan.digest
                    assert plan.home_digest
                    assert plan.rng("path").random() < 1
    except Avs3dError as error:
        for line in error.args:
            assert line.isprintable(), repr(line)
            assert len(line) < 1000, line
        return "\n".join(error.args)
    return "valid"


@pytest.mark.slow
@pytest.mark.parametrize("mutate", [of_document, of_text])
@pytest.mark.parametrize("name", [*SEEDS, "own.yaml"])
def test_a_damaged_file_reads_or_is_refused_in_one_line(
    name: str, mutate: Callable[[str, random.Random], bytes], tmp_path: Path
) -> None:
    text = OWN_CATEGORIES if name == "own.yaml" else (MANIFESTS / name).read_text()
    refused = 0
    for number in range(EACH // 2):
        rng = random.Random(f"{name} {mutate.__name__} {number}")
        path = tmp_path / f"{number}-{name}"
        path.write_bytes(mutate(text, rng))
        try:
            refused += outcome(path) != "valid"
        except Exception as error:
            pytest.fail(f"{name}, {mutate.__name__} {number}: {type(error).__name__}: {error!r:.300}")
    assert refused > EACH // 4  # most damages are seen; few are harmless


def document(**changes: Any) -> dict[str, Any]:
    observation = {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "clock"}
    return {"name": "tiny", "seed": 1, "scans": {"flat": {"seed": 3}}, "observations": [observation]} | changes


def observation(**changes: Any) -> dict[str, Any]:
    return document(observations=[document()["observations"][0] | changes])


def sound(**changes: Any) -> dict[str, Any]:
    entry = {"file": "bell.wav", "licence": {"name": "CC0-1.0", "author": "somebody"}}
    return document(sounds={"clock": [entry | changes]})


def scan(**changes: Any) -> dict[str, Any]:
    return document(scans={"flat": {"source": "scan", "file": "flat.glb"} | changes})


def own(name: Any = "hair_dryer", **changes: Any) -> dict[str, Any]:
    return document(categories={name: {"stands_on": ["table"], "height": [0.1, 0.3]} | changes})


HOSTILE: dict[str, tuple[Any, list[str]]] = {
    "empty name": (document(name=""), ["name: '' is no name"]),
    "name of several lines": (document(name="a\n"), ["name: ", "is no name; expected 1 to 200 letters"]),
    "empty version": (document(version=""), ["version: is empty (found '')"]),
    "blank version": (document(version=" \t"), ["version: is empty"]),
    "version of two lines": (document(version="1\n2"), ["version: has several lines", "'1\\n2'"]),
    "version as a number": (document(version=1.0), ["version: ", "valid string", "found 1.0"]),
    "bell in the notes": (document(notes="ding \x07"), ["notes, line", "'\\x07'"]),
    "surrogate in the notes": (document(notes="\ud800"), ["line"]),
    "surrogate in a licence": (sound(licence={"name": "MIT", "author": "\udc00"}), ["line"]),
    "nul in a file": (sound(file="bell\0.wav"), ["sounds.clock.0.file, line", "'\\x00'"]),
    "category as a number": (
        observation(category=5),
        ["observations.0.category: unknown category 5", "expected one of"],
    ),
    "category as a list": (observation(category=["clock"]), ["observations.0.category: unknown category ['clock']"]),
    "category as null": (observation(category=None), ["observations.0: category is missing"]),
    "category as a mapping": (observation(category={"a": 1}), ["observations.0.category: unknown category {'a': 1}"]),
    "room as a number": (observation(room=5), ["observations.0.room: unknown room 5"]),
    "room as a list": (observation(room=[]), ["observations.0.room: unknown room []"]),
    "room as null": (observation(room=None), ["observations.0.room: unknown room None"]),
    "silent number": (observation(silent=[3]), ["observations.0.silent.0: unknown category 3"]),
    "a crowd": (observation(silent=["oven"] * 500), ["observations.0.silent", "at most 16"]),
    "room of the scan": (
        scan(rooms={"attic": [[0, 0, 0], [1, 1, 1]]}),
        ["scans.flat.rooms.attic", "unknown room 'attic'"],
    ),
    "a box of 1e300 m": (
        scan(rooms={"kitchen": [[0, 0, 0], [1e300, 1, 1]]}),
        ["scans.flat.rooms.kitchen.1.0", "10000"],
    ),
    "empty licence": (sound(licence={}), ["sounds.clock.0.licence.name: is missing"]),
    "licence without a name": (sound(licence={"name": "", "author": "x"}), ["sounds.clock.0.licence.name: is empty"]),
    "licence as text": (sound(licence="MIT"), ["sounds.clock.0.licence", "found 'MIT'"]),
    "empty licence of a scan": (scan(licence={"name": "", "author": ""}), ["scans.flat.licence.name: is empty"]),
    "no file": (sound(file=""), ["sounds.clock.0.file: is empty"]),
    "somebody's home": (
        sound(file="~nobody-here/x.wav"),
        ["~nobody-here/x.wav: no home folder", "write the whole path"],
    ),
    "long file": (sound(file="a" * 300), ["too long"]),
    "seed that is a truth value": (document(seed=True), ["seed", "integer", "True"]),
    "index that is a truth value": (observation(index=True), ["index", "integer", "True"]),
    "seed of 5,000 digits": ("seed: 1" + "0" * 5000, ["seed, line 1", "5,001 digits"]),
    "field of another part": (
        document(licence="MIT"),
        ["licence: unknown field; licence belongs in scans.NAME or objects.NAME.N or sounds.NAME.N"],
    ),
    "unknown field": (document(sedd=1), ["sedd: unknown field"]),
    "field of nine lines": (document(**{"a\n" * 9: 1}), ["'a\\na\\n", "unknown field"]),
    "observations as a number": (document(observations=5), ["observations: ", "found 5"]),
    "observations of null": (document(observations=[None]), ["observations.0", "found None"]),
    "like as a list": (observation(like=[1]), ["observations.0: like [1] names no observation"]),
    "mixed keys beside like": (
        document(observations=[*document()["observations"], {"like": "part_1/flat/kitchen/1", 5: 1, "y": 2}]),
        ["observations.1: an entry with like cannot have 5, y;"],
    ),
    "alias bomb": (
        "k0: &k0 [x, x]\n" + "".join(f"k{n}: &k{n} [*k{n - 1}, *k{n - 1}]\n" for n in range(1, 60)),
        ["aliases counted in full"],
    ),
    "categories as a list": (document(categories=["hair_dryer"]), ["categories: ", "found ['hair_dryer']"]),
    "categories of null": (document(categories=None), ["categories: ", "found None"]),
    "category that is a number": (own(5), ["categories.5: category 5: expected lower-case letters"]),
    "category that is nothing": (own(None), ["categories.", "category None: expected lower-case letters"]),
    "category of two lines": (own("a\nb"), ["category 'a\\nb': expected lower-case letters"]),
    "category of the benchmark": (own("clock"), ["categories.clock: clock is a category of the benchmark already"]),
    "category without anything": (document(categories={"dog": None}), ["categories.dog: ", "found None"]),
    "a table that is a mapping": (own(stands_on={"table": 1}), ["stands_on: expected a list of supports", "{'table'"]),
    "a support of null": (own(stands_on=[None]), ["stands_on.0: unknown support None"]),
    "a height of nan": (own(height=[float("nan"), 0.3]), ["height.0: ", "finite", "nan"]),
    "a height of 1e300 m": (own(height=[0.1, 1e300]), ["height.1: ", "less than 5"]),
    "free as a number": (own(free=1), ["free: ", "found 1"]),
    "declared and without objects": (
        own() | {"observations": observation(category="hair_dryer")["observations"]},
        ["part_1/flat/kitchen/1: category hair_dryer has no objects", "add objects: {hair_dryer: "],
    ),
    "a list": ([1, 2], ["expected a mapping", "[1, 2]"]),
    "nothing": ("", ["expected a mapping", "None"]),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_file_field_what_was_found_and_what_was_expected(name: str, tmp_path: Path) -> None:
    content, words = HOSTILE[name]
    path = tmp_path / "mine.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    line = outcome(path)
    if "home folder" not in line and "too long" not in line:
        assert line.startswith((f"{path}: ", f"{path}, line "))
    for word in words:
        assert word in line


def test_the_folder_of_the_manifest_and_a_pipe_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    for path, words in ((tmp_path, "folder"), (tmp_path / "pipe.yaml", "FIFO"), (tmp_path / "none.yaml", "missing")):
        with pytest.raises(UsageError, match=rf"cannot read the manifest: .*{words}"), at_most(LIMIT):
            read_manifest(path)


def test_the_manifest_with_categories_of_its_own_is_valid(tmp_path: Path) -> None:
    """Before it is damaged."""
    path = tmp_path / "own.yaml"
    path.write_text(OWN_CATEGORIES)
    assert outcome(path) == "valid"
