"""The differences between the parts of the benchmark; all else about an observation is one story.

An observation has a tuple of sources. In part_1 and part_2 it is one source that always sounds and is always marked. In
part_3 there may be none or several, each with a programme, and observations come in groups of siblings.
"""

from __future__ import annotations

from dataclasses import dataclass

from avs3d_bench.contract.taxonomy import PART_3


@dataclass(frozen=True)
class PartRules:
    """The rules of a part.

    Attributes:
        marked_while_audible: a frame's masks mark the sources that are audible in it; else, the source in every frame.
        may_be_silent: a clip may be silent; else, silence is an error of the engine.
        named_sources: files and records name the sources: ``rirs/source_1/…``, stems, category masks, ``sources`` in
            observation.json; else, the one source needs no name.
        in_takes: no two sources of a group play the same stretch of a recording; else, each recording is played from
            its beginning.
        instance_stream: name of the random stream that draws the instance of source ``{number}``.
        signal_stream: name of the random stream of the signal of the ``{nth}`` source of a ``{category}``.
    """

    marked_while_audible: bool
    may_be_silent: bool
    named_sources: bool
    in_takes: bool
    instance_stream: str
    signal_stream: str


_ONE_SOURCE = PartRules(
    marked_while_audible=False,
    may_be_silent=False,
    named_sources=False,
    in_takes=False,
    instance_stream="sounding",
    signal_stream="sound",
)
_SOURCES = PartRules(
    marked_while_audible=True,
    may_be_silent=True,
    named_sources=True,
    in_takes=True,
    instance_stream="sounding/{number}",
    signal_stream="sound/{category}/{nth}",
)


def rules_of(part: str) -> PartRules:
    """The rules of ``part_1``, ``part_2`` or ``part_3``."""
    return _SOURCES if part == PART_3 else _ONE_SOURCE
