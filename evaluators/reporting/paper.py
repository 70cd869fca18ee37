"""The paper's own figures, and the choice of the row that a submission is compared with.

    Artem Sokolov, Swapnil Bhosale, Xiatian Zhu: 3D Audio-Visual Segmentation. 2024, arXiv:2411.02236.

They were measured on the paper's dataset, 3DAVS-S34-O7, under the released scoring (our protocol ``official``): beside
scores of another dataset they say how large an effect the authors saw, not who is better.

A submission is matched by the fields of submission.json only:

1. The method is ``runtime.method`` where ``runtime`` has it (``echosegnet``, ``denseav``, ``owod-bind``), else the name
   in ``method`` up to its first comma or bracket, upper and lower case alike (``OWOD-BIND (MAVL, SAM, ImageBind)``).
2. EchoSegnet needs ``runtime.variant`` = ``official`` as well, and ``runtime.aisrm``, which tells its two rows apart.
3. What else is known to differ from the paper's setting (other masks, iterations, voting threshold, networks), or is
   not said, does not undo a match: it goes into a footnote.

A submission without a row gets the reason.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from avs3d_bench.contract.schema import Scalar, SubmissionRecord

CITATION: Final = "Sokolov, Bhosale, Zhu: 3D Audio-Visual Segmentation, 2024, arXiv:2411.02236"
DATASET: Final = "3DAVS-S34-O7"

ECHOSEGNET = "EchoSegnet with AISRM"
ECHOSEGNET_WITHOUT = "EchoSegnet without AISRM"
DENSEAV = "DenseAV"
OWOD_BIND = "OWOD-BIND"

#: Table 2: row → part → figure of the protocol ``official``.
TABLE_2: Final[Mapping[str, Mapping[str, Mapping[str, float]]]] = {
    ECHOSEGNET: {"part_1": {"mIoU": 0.823, "F": 0.730}, "part_2": {"mIoU": 0.801, "F": 0.714}},
    ECHOSEGNET_WITHOUT: {"part_1": {"mIoU": 0.761, "F": 0.628}, "part_2": {"mIoU": 0.757, "F": 0.609}},
    OWOD_BIND: {"part_1": {"mIoU": 0.693, "F": 0.523}, "part_2": {"mIoU": 0.696, "F": 0.502}},
    DENSEAV: {"part_1": {"mIoU": 0.426, "F": 0.023}, "part_2": {"mIoU": 0.436, "F": 0.023}},
}
#: Table 3: voting threshold → figures of EchoSegnet on one scene.
TABLE_3: Final[Mapping[float, Mapping[str, float]]] = {
    0.9: {"mIoU": 0.333, "F": 0.028},
    0.8: {"mIoU": 0.333, "F": 0.028},
    0.7: {"mIoU": 0.335, "F": 0.028},
    0.6: {"mIoU": 0.352, "F": 0.104},
    0.5: {"mIoU": 0.396, "F": 0.241},
    0.4: {"mIoU": 0.897, "F": 0.948},
    0.3: {"mIoU": 0.901, "F": 0.949},
    0.2: {"mIoU": 0.901, "F": 0.949},
    0.1: {"mIoU": 0.901, "F": 0.948},
}
TABLE_3_SCENE: Final = "sT4fr6TAbpF, bathroom, vacuum cleaner"
SWEEP: Final = f"EchoSegnet, one scene ({TABLE_3_SCENE})"
VOTING_THRESHOLD: Final = 0.3
ITERATIONS: Final = 30_000
#: Of OWOD-BIND: boxes, masks, audio-visual similarity.
NETWORKS: Final = "MAVL, SAM, ImageBind"

_METHODS = ("echosegnet", "denseav", "owod-bind")
_HEAD = re.compile(r"[^,(\[]*")


@dataclass(frozen=True)
class Match:
    """The figures of the paper for a submission.

    Attributes:
        row: of the paper's table; None where it has none.
        why: why there is none; empty where there is one.
        differs: the known differences from the paper.
    """

    row: str | None
    why: str = ""
    differs: tuple[str, ...] = ()


def settings(submission: SubmissionRecord) -> Mapping[str, Scalar]:
    """``runtime`` where it is a record of settings; else nothing."""
    return submission.runtime if isinstance(submission.runtime, dict) else {}


def match(submission: SubmissionRecord) -> Match:
    """The row of the paper's Table 2 that a submission is compared with."""
    method, said = _method(submission), settings(submission)
    if method is None:
        return Match(None, "not one of the paper's methods")
    if method == "denseav":
        return Match(DENSEAV)
    if method == "owod-bind":
        return Match(OWOD_BIND, differs=_networks(submission.method))
    missing = [name for name in ("variant", "aisrm") if name not in said]
    if missing:
        return Match(None, f"the runtime in submission.json does not say {' and '.join(missing)}")
    if said["variant"] != "official":
        return Match(None, f"variant {said['variant']} is not the paper's")
    if not isinstance(said["aisrm"], bool):
        return Match(None, f"aisrm {said['aisrm']!r} in submission.json: expected true or false")
    row = ECHOSEGNET if said["aisrm"] else ECHOSEGNET_WITHOUT
    return Match(row, differs=(*_setting(said), *_differs(said, "voting_threshold", VOTING_THRESHOLD)))


def match_sweep(submission: SubmissionRecord) -> Match:
    """Whether the paper's Table 3, a sweep of EchoSegnet's voting threshold, is comparable with a submission."""
    if _method(submission) != "echosegnet":
        return Match(None, "the paper's sweep is of EchoSegnet")
    said = settings(submission)
    refined = ("AISRM off",) if said.get("aisrm") is False else ()
    return Match(SWEEP, differs=(*_differs(said, "variant", "official"), *refined, *_setting(said)))


def _method(submission: SubmissionRecord) -> str | None:
    named = settings(submission).get("method")
    if named is None:
        head = _HEAD.match(submission.method)
        named = head.group() if head else ""
    name = str(named).strip().casefold()
    return name if name in _METHODS else None


def _setting(said: Mapping[str, Scalar]) -> tuple[str, ...]:
    masks = str(said.get("masks", "")).casefold().replace("_", "-")
    other = () if masks == "owod-bind" else _differs(said, "masks", OWOD_BIND)
    return (*other, *_differs(said, "iterations", ITERATIONS))


def _differs(said: Mapping[str, Scalar], name: str, expected: Scalar) -> tuple[str, ...]:
    """One remark, or none where the setting is the paper's."""
    value, title = said.get(name), name.replace("_", " ")
    if value == expected and not isinstance(value, bool):
        return ()
    found = "not said" if value is None else f"{value:,}" if isinstance(value, int) else str(value)
    paper = f"{expected:,}" if isinstance(expected, int) else str(expected)
    return (f"{title} {found}, in the paper {paper}",)


def _networks(name: str) -> tuple[str, ...]:
    found = re.search(r"\(([^()]*)\)", name)
    used = found.group(1).strip() if found else "not said"
    return () if used == NETWORKS else (f"networks {used}, in the paper {NETWORKS}",)
