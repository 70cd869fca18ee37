"""The reader of users' YAML: the same values as PyYAML, and one line for input that would hang or crash PyYAML."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.formats.yamlfile import YamlLimits, parse_yaml, read_yaml

MANIFESTS = Path(__file__).parents[2] / "scenes_manifest"
TEXT = st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=20)
LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXT
DOCUMENTS = st.recursive(LEAVES, lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner), max_leaves=20)


@pytest.mark.parametrize("path", sorted(MANIFESTS.glob("*.yaml")), ids=lambda path: path.name)
def test_the_files_of_the_project_read_as_with_pyyaml(path: Path) -> None:
    data = path.read_bytes()
    assert parse_yaml(data, path) == yaml.safe_load(data)
    assert read_yaml(path)[1] == data


@settings(max_examples=100)
@given(DOCUMENTS)
def test_any_document_reads_as_with_pyyaml(document: object) -> None:
    for text in (yaml.safe_dump(document), yaml.safe_dump(document, default_flow_style=True, allow_unicode=True)):
        assert repr(parse_yaml(text, "it")) == repr(yaml.safe_load(text))


@pytest.mark.parametrize(
    "text",
    [
        "[1, 0x1f, 0o17, 017, 1_000, -3, +4, 12:30:45, 1.5, .5, 1e3, 1.0e+3, -.inf, yes, No, on, ~, null, '', '1']",
        "base: &b {x: 1, y: {z: 2}}\none: {<<: *b, x: 3}\ntwo: {<<: [{x: 5}, *b], w: *b}\nthree: [*b, *b]",
        "a: |\n  two\n  lines\nb: >-\n  folded\n  text\nc: 'it''s'\nd: !!str 5\n# e: 1\n",
        '{"json": [true, false, null, 1.5, "\\u00e9"]}',
        "\ufeffname: with a mark of byte order",
        "",
        "# nothing but a comment",
        "{= : 1}",
    ],
)
def test_numbers_words_merges_and_blocks_read_as_with_pyyaml(text: str) -> None:
    if "= " in text:
        assert parse_yaml(text, "it") == {"=": 1}  # PyYAML fails here
    else:
        assert parse_yaml(text, "it") == yaml.safe_load(text)


def test_a_date_stays_text() -> None:
    assert parse_yaml("version: 2024-11-30\nother: 2024-99-99", "it") == {
        "version": "2024-11-30",
        "other": "2024-99-99",
    }


def levels(kind: str) -> str:
    """Nine aliases in each of 30 levels: 9^30 values."""
    lines = ["a0: &a0 {x: 1}"]
    for level in range(1, 30):
        nine = ", ".join([f"*a{level - 1}"] * 9)
        lines.append(f"a{level}: &a{level} " + (f"[{nine}]" if kind == "alias" else f"{{<<: [{nine}]}}"))
    return "\n".join(lines)


HOSTILE = {
    "alias bomb": (levels("alias"), ["a7.", "line 8", "more than 2,000,000 values"]),
    "merge bomb": (levels("merge"), ["a6.<<", "more than 2,000,000 values"]),
    "brackets": ("a: " + "[" * 100_000, ["a", "line 1", "more than 20 levels"]),
    "braces": ("{a: " * 5000, ["a.a.a", "more than 20 levels"]),
    "dashes": ("- " * 100_000, ["more than 20 levels"]),
    "question marks": ("? " * 100_000, ["as a key", "plain text"]),
    "circle": ("a: &a [1, *a]", ["a.1", "*a inside of what it stands for"]),
    "digits": ("seed: 1" + "0" * 5000, ["seed, line 1", "5,001 digits", "at most 60"]),
    "hexadecimal": ("seed: 0x" + "f" * 50_000, ["seed", "digits"]),
    "sexagesimal": ("seed: 1" + ":59" * 50_000, ["seed", "digits"]),
    "float": ("seed: -1." + "0" * 5000, ["seed", "digits"]),
    "directives": ("".join(f"%TAG !a{n}! b\n" for n in range(200_000)) + "---\na: 1", ["%TAG"]),
    "surrogate": ('a: {b: "\\ud800"}', ["line 1"]),
    "bell": ('a: [x, "\\a"]', ["a.1, line 1", "'\\x07'", "no control characters"]),
    "nul": ('a: "\\0"', ["a, line 1", "'\\x00'"]),
    "control": ("a: \x1b[31m", ["control characters"]),
    "control key": ('"\\e": 1', ["'\\x1b'"]),
    "list as key": ("{[1]: 2}", ["as a key"]),
    "alias as key": ("a: &a x\n*a : 2", ["*a as a key"]),
    "unknown alias": ("a: [*b]", ["a.0", "*b of nothing"]),
    "duplicate": ("a: 1\nb: {c: 1, c: 2}", ["b, line 2", "'c', which is listed twice"]),
    "two merges": ("{<<: {a: 1}, <<: {b: 1}}", ["'<<', which is listed twice"]),
    "merge of a number": ("a: {<<: 5}", ["<<: 5", "mapping"]),
    "python": ("a: !!python/object/apply:os.system [x]", ["tag", "python"]),
    "binary": ("a: !!binary aaaa", ["tag"]),
    "set": ("a: !!set {x, y}", ["tag"]),
    "no bool": ("a: !!bool x", ["tag"]),
    "two documents": ("a: 1\n---\nb: 1", ["second document"]),
    "tabs": ("a:\n\t- b", ["line 2 is indented with a tab; indent with spaces"]),
    "a tab after spaces": ("a:\n  b: 1\n  \tc: 2", ["line 3", "tab"]),
    "a tab before an entry": ("a:\n- c: 1\n\td: 2", ["line 3 is indented with a tab"]),
    "quoted brackets": ("a: '" + "[" * 100 + "'\nb: x: y", ["not valid YAML at line 2"]),
    "open quote": ("a: 'x", ["not valid YAML at line 1"]),
    "Latin-1": (b"name: caf\xe9", ["byte 9", "UTF-8"]),
    "UTF-16": ("a: 1".encode("utf-16"), ["UTF-8"]),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_would_hang_or_crash_is_one_line(name: str) -> None:
    text, words = HOSTILE[name]
    with pytest.raises(UsageError) as caught:
        parse_yaml(text, "my.yaml")
    message = str(caught.value)
    assert message.startswith("my.yaml: ")
    assert message.isprintable()
    assert len(message) < 300
    for word in words:
        assert word in message


def test_a_file_of_too_many_bytes_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    with path.open("wb") as stream:
        stream.truncate(2**40)
    with pytest.raises(UsageError, match=r"more than 16,000,000 bytes"):
        read_yaml(path)
    with pytest.raises(UsageError, match=r"more than 4 bytes"):
        parse_yaml("a: 12", "it", YamlLimits(bytes=4))
    with pytest.raises(UsageError, match=r"a\.97, line 1: found more than 100 values"):
        parse_yaml("a: [" + "1," * 1000 + "]", "it", YamlLimits(nodes=100))


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(Avs3dError, match="FIFO"):
        read_yaml(tmp_path / "pipe.yaml")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("x" * 10**6, "xxx"),
        ({"a": [list(range(10**5))] * 100}, "'a'"),
        (10**5000, "a number of about 5,000 digits"),
        ("\x1b[31m\n\u202e\ud800", "\\x1b"),
    ],
    ids=["long", "deep", "digits", "unprintable"],
)
def test_an_excerpt_is_short_and_printable(value: object, words: str) -> None:
    text = excerpt(value)
    assert len(text) < 100
    assert text.isprintable()
    assert words in text
