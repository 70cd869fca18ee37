"""Reads the YAML files that users hand in: manifests, lock files, options of job queues. JSON is YAML, too.

A few hundred bytes of YAML can stand for gigabytes (an alias to a list of aliases to lists of aliases, …), and readers
of any YAML there is recurse into whatever depth a file has. Here one pass over the parser's events builds the
document and refuses, with the field and the line, what no file of ours needs before any of it is built: too many
bytes, levels, values (an alias counts as everything that it stands for), digits of a number; keys that are listed
twice or are no plain text; tags, control characters and surrogates.

Values are resolved as `yaml.safe_load` does, but dates stay text.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

import yaml

from avs3d_bench.errors import UsageError, excerpt

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CONSTRUCTOR = yaml.constructor.SafeConstructor()
_TAG = "tag:yaml.org,2002:"
#: Tags for plain text.
_TEXT_TAGS = ("!", f"{_TAG}str")
#: Control characters and surrogates, which no text of ours has; tabs and line ends remain.
_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
#: The parser compares each of these lines with all before it: enough of them take hours.
_DIRECTIVE = re.compile(r"^%TAG\b", re.MULTILINE)


@dataclass(frozen=True)
class YamlLimits:
    """The largest document that is read.

    Attributes:
        bytes: of the file; a manifest of 100,000 observations has 8 million.
        depth: mappings and lists within one another.
        nodes: keys, values, mappings and lists; an alias counts as all that it stands for.
        digits: characters of a number.
    """

    bytes: int = 16_000_000
    depth: int = 20
    nodes: int = 2_000_000
    digits: int = 60


LIMITS = YamlLimits()


def read_yaml(path: str | Path, limits: YamlLimits = LIMITS) -> tuple[Any, bytes]:
    """Read a YAML file.

    Returns:
        the document (None, bool, int, float, str, list, dict) and the bytes of the file.

    Raises:
        Avs3dError: if the file is missing, no regular file or cannot be read.
        UsageError: see `parse_yaml`.
    """
    data = read_data(path, limits)
    return parse_yaml(data, path, limits), data


def read_data(path: str | Path, limits: YamlLimits = LIMITS) -> bytes:
    """The bytes of a YAML file, for `parse_yaml`: no more of them than it needs to see that they are too many.

    Raises:
        Avs3dError: if the file is missing, no regular file or cannot be read.
    """
    from avs3d_bench.formats.files import open_regular  # brings the schema, which `--help` can do without

    with open_regular(path) as stream:
        return stream.read(limits.bytes + 1)


def parse_yaml(data: bytes | str, where: str | Path, limits: YamlLimits = LIMITS) -> Any:
    """The document in the YAML text of the file ``where``; None if there is none.

    Raises:
        UsageError: one line with the file, the field, the line, what was found and what was expected.
    """
    if len(data) > limits.bytes:
        raise UsageError(f"{where}: more than {limits.bytes:,} bytes; expected a YAML file of at most so many")
    try:
        text = data if isinstance(data, str) else data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(f"{where}: byte {error.start} is no UTF-8; expected a YAML file in UTF-8") from None
    if _DIRECTIVE.search(text):
        raise UsageError(f"{where}: has a %TAG directive; expected YAML without tags")
    builder = _Builder(str(where), limits)
    try:
        for event in yaml.parse(text, Loader=_Loader):
            builder.take(event)
    except (yaml.YAMLError, UnicodeError) as error:
        mark = getattr(error, "problem_mark", None)
        if mark is not None and _ends_in_brackets(text[: mark.index], limits.depth):
            # Newer parsers have a limit of their own, which they meet while they look ahead of the builder.
            builder.refuse_depth(mark)
        line = f" at line {mark.line + 1}" if mark is not None else ""
        if mark is not None and _indented_with_a_tab(text, mark):
            raise UsageError(f"{where}: line {mark.line + 1} is indented with a tab; indent with spaces") from None
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        raise UsageError(f"{where}: not valid YAML{line}: {' '.join(str(problem).split())[:200]}") from None
    return builder.document


def _ends_in_brackets(text: str, depth: int) -> bool:
    """Whether more than ``depth`` opening brackets in a row end the text."""
    ending = "".join(text[-2000 - 2 * depth :].split())
    return len(ending) - len(ending.rstrip("[{")) > depth


def _indented_with_a_tab(text: str, mark: Any) -> bool:
    """Whether a tab is where the parser stops, or before the first character of that line."""
    line = next(itertools.islice(io.StringIO(text), mark.line, None), "")
    return "\t" in line[: len(line) - len(line.lstrip())] or line[mark.column : mark.column + 1] == "\t"


def lines_of(text: str, places: Iterable[Sequence[str | int]]) -> list[int | None]:
    r"""The line, from 1, of each of some fields of a document that `parse_yaml` has read.

    Args:
        text: of the file.
        places: keys and indices from the top. Of a field that the text lacks (it is missing, or taken over by ``<<``),
            the line is that of the record that it belongs to.

    Returns:
        None for a place of which nothing is there.

    Examples:
        >>> lines_of("seed: 1\nscans:\n  home: {seed: x}", [("scans", "home", "seed"), ("version",)])
        [3, None]
    """
    root = yaml.compose(text, Loader=_Loader)
    return [_line_of(root, place) for place in places]


def _line_of(node: yaml.Node | None, place: Sequence[str | int]) -> int | None:
    line = None
    for each in place:
        below: Any = None
        if isinstance(node, yaml.MappingNode):
            below = next((pair for pair in node.value if pair[0].value == str(each)), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(each, int) and each < len(node.value):
            below = (node.value[each], node.value[each])
        if below is None:
            break
        line, node = below[0].start_mark.line + 1, below[1]
    return line


@lru_cache(maxsize=4096)
def _resolve(text: str) -> tuple[str, Any]:
    """Kind (``int``, ``str``, ``merge``, …) and value of a plain scalar."""
    known: Mapping[Any, list[tuple[str, re.Pattern[str]]]] = yaml.SafeLoader.yaml_implicit_resolvers
    for tag, pattern in (*known.get(text[:1], ()), *known.get(None, ())):
        if pattern.match(text):
            kind = tag.removeprefix(_TAG)
            convert = getattr(_CONSTRUCTOR, f"construct_yaml_{kind}", None)
            if kind in ("null", "bool", "int", "float") and convert is not None:
                return kind, convert(yaml.ScalarNode(tag, text))
            return kind, text
    return "str", text


@dataclass
class _Open:
    """A mapping or list whose end has not come.

    Attributes:
        content: what it holds so far.
        anchor: its name for aliases.
        before: number of nodes before it.
        key: of a mapping: the key whose value is next, in a list; empty where a key is next.
        merged: of a mapping: what ``<<`` takes over.
    """

    content: dict[Any, Any] | list[Any]
    anchor: str | None
    before: int
    key: list[Any] = field(default_factory=list)
    merged: Any = None


_MERGE = object()


class _Builder:
    """Builds the document from events, in the order in which they come."""

    def __init__(self, where: str, limits: YamlLimits) -> None:
        self.document: Any = None
        self._where = where
        self._limits = limits
        self._nodes = 0
        self._documents = 0
        self._stack: list[_Open] = []
        #: Anchor → value and number of nodes that it stands for; None while it is still open.
        self._anchors: dict[str, tuple[Any, int] | None] = {}

    def take(self, event: yaml.Event) -> None:
        """Go on by one event."""
        if isinstance(event, yaml.ScalarEvent):
            self._count(event, 1)
            value, merge = self._scalar(event)
            if event.anchor:
                self._anchors[event.anchor] = (value, 1)
            self._add(event, _MERGE if merge and self._key_is_next else value)
        elif isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            self._open(event)
        elif isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            self._close(event)
        elif isinstance(event, yaml.AliasEvent):
            self._alias(event)
        elif isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                self._refuse(event, "a second document begins (---)", "one document")

    @property
    def _key_is_next(self) -> bool:
        return bool(self._stack) and isinstance(self._stack[-1].content, dict) and not self._stack[-1].key

    def _scalar(self, event: yaml.ScalarEvent) -> tuple[Any, bool]:
        """The value, and whether it is the key ``<<``."""
        text: str = event.value
        if event.tag is not None and event.tag not in _TEXT_TAGS:
            self._refuse(event, f"the tag {excerpt(event.tag)}", "a value without a tag")
        unfit = _UNFIT.search(text)
        if unfit:
            self._refuse(event, f"the character {unfit.group()!a} in a text", "no control characters and no surrogates")
        if not event.implicit[0]:  # in quotes, a block, or tagged as text
            return text, False
        if len(text) > self._limits.digits and text.lstrip("+-")[:1].isdigit():
            # Conversion takes quadratic time, and Python refuses to print what comes out.
            if _looks_like_a_number(text):
                self._refuse(event, f"a number of {len(text):,} digits", f"at most {self._limits.digits}")
            return text, False
        kind, value = _resolve(text)
        return value, kind == "merge"

    def _open(self, event: yaml.CollectionStartEvent) -> None:
        if self._key_is_next:
            self._refuse(event, "a mapping or a list as a key", "keys that are plain text")
        if event.tag not in (None, "!"):
            self._refuse(event, f"the tag {excerpt(event.tag)}", "a value without a tag")
        if len(self._stack) >= self._limits.depth:
            self.refuse_depth(event.start_mark)
        if event.anchor:
            self._anchors[event.anchor] = None
        content: dict[Any, Any] | list[Any] = {} if isinstance(event, yaml.MappingStartEvent) else []
        self._stack.append(_Open(content, event.anchor, self._nodes))
        self._count(event, 1)

    def _close(self, event: yaml.Event) -> None:
        done = self._stack.pop()
        content = done.content
        if isinstance(content, dict) and done.merged is not None:
            content = self._merge(event, done.merged) | content
        if done.anchor:
            self._anchors[done.anchor] = (content, self._nodes - done.before)
        self._add(event, content)

    def _merge(self, event: yaml.Event, merged: Any) -> dict[Any, Any]:
        """The fields that ``<<: merged`` adds: of several mappings the first one wins."""
        found: dict[Any, Any] = {}
        for each in merged if isinstance(merged, list) else [merged]:
            if not isinstance(each, dict):
                self._refuse(event, f"<<: {excerpt(each)}", "<< with a mapping or a list of mappings")
            for key, value in each.items():
                found.setdefault(key, value)
        return found

    def _alias(self, event: yaml.AliasEvent) -> None:
        name = event.anchor
        if self._key_is_next:
            self._refuse(event, f"the alias *{name:.40} as a key", "keys that are plain text")
        if name not in self._anchors:
            self._refuse(event, f"the alias *{name:.40} of nothing", f"&{name:.40} before it")
        known = self._anchors[name]
        if known is None:
            self._refuse(event, f"the alias *{name:.40} inside of what it stands for", "no such circle")
        self._count(event, known[1])
        self._add(event, known[0])

    def _add(self, event: yaml.Event, value: Any) -> None:
        if not self._stack:
            self.document = value
            return
        last = self._stack[-1]
        if isinstance(last.content, list):
            last.content.append(value)
        elif last.key:
            key = last.key.pop()
            if key is _MERGE:
                last.merged = value
            else:
                last.content[key] = value
        else:
            if value in last.content or (value is _MERGE and last.merged is not None):
                name = "<<" if value is _MERGE else value
                self._refuse(event, f"the key {excerpt(name)}, which is listed twice", "each key once")
            last.key.append(value)

    def _count(self, event: yaml.Event, more: int) -> None:
        self._nodes += more
        if self._nodes > self._limits.nodes:
            self._refuse(event, f"more than {self._limits.nodes:,} values, aliases counted in full", "fewer")

    def refuse_depth(self, mark: Any) -> NoReturn:
        """Raise the error for too many levels at a place in the text."""
        self._refuse_at(mark, f"more than {self._limits.depth} levels of mappings and lists", "fewer")

    def _refuse(self, event: yaml.Event, found: str, expected: str) -> NoReturn:
        self._refuse_at(event.start_mark, found, expected)

    def _refuse_at(self, mark: Any, found: str, expected: str) -> NoReturn:
        line = f", line {mark.line + 1}" if mark is not None else ""
        raise UsageError(f"{self._where}: {self._place()}{line}: found {found}; expected {expected}")

    def _place(self) -> str:
        """``observations.3.category``: the field that is being read."""
        steps = []
        for each in self._stack:
            if isinstance(each.content, list):
                steps.append(str(len(each.content)))
            elif each.key:
                steps.append(step("<<" if each.key[0] is _MERGE else each.key[0]))
        return ".".join(steps) or "the document"


def _looks_like_a_number(text: str) -> bool:
    kinds = ("int", "float")
    known: Mapping[Any, list[tuple[str, re.Pattern[str]]]] = yaml.SafeLoader.yaml_implicit_resolvers
    return any(tag.removeprefix(_TAG) in kinds and pattern.match(text) for tag, pattern in known.get(text[0], ()))


def step(key: object) -> str:
    """A key or an index as part of the name of a field, in one short printable line."""
    text = str(key) if isinstance(key, str | int) and not isinstance(key, bool) else excerpt(key)
    return text if text.isprintable() and 0 < len(text) <= 80 else excerpt(text)
