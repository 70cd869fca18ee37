"""Where scores come from: digests of the files that were scored and of the truth, and the machine.

A digest is the sha256 of a list of files in the format of ``sha256sum``, so that it can be computed without this
toolkit; docs/scores-file.md has the commands.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable, Iterator, Mapping

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import Machine, ObservationDigests, ObservationScores
from avs3d_bench.dataset import Observation
from avs3d_bench.formats.files import sha256_file

#: Folders with one file of the truth for each frame.
_TRUTH_FOLDERS = (layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS, layout.CATEGORY_MASKS)


def list_digest(digests: Mapping[str, str]) -> str:
    r"""Hexadecimal sha256 of a list of digests with names: one line each, sorted by name.

    Args:
        digests: name → hexadecimal sha256. A line is the digest, two spaces, the name, a line break, in UTF-8.

    Examples:
        >>> list_digest({"b": "22", "a": "11"}) == hashlib.sha256(b"11  a\n22  b\n").hexdigest()
        True
    """
    lines = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    return hashlib.sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()


def truth_files(observation: Observation) -> Iterator[str]:
    """Names, relative to the observation, of the files with its truth; some may not exist.

    They do not depend on the protocol or the submission: files that this score does not need are among them.
    """
    yield layout.OBSERVATION_JSON
    yield layout.SOUNDING_OBJECT
    for frame in observation.test:
        for folder in _TRUTH_FOLDERS:
            yield f"{folder}/{frame.name}.png"


def truth_digest(observation: Observation) -> str:
    """The digest of the list of the files with the truth of an observation, as far as they exist.

    Raises:
        Avs3dError: if one cannot be read.
    """
    found = {}
    for name in truth_files(observation):
        path = observation.where(name)
        if path.exists():
            found[f"{observation.key}/{name}"] = sha256_file(path)
    return list_digest(found)


def observation_digests(observation: Observation, predictions: Mapping[str, str]) -> ObservationDigests:
    """The digests of an observation.

    Args:
        observation: of the dataset.
        predictions: path relative to the submission → sha256, of the files that were scored.

    Raises:
        Avs3dError: if a file of the dataset cannot be read.
    """
    return ObservationDigests(predictions=list_digest(predictions), truth=truth_digest(observation))


def totals(scored: Iterable[ObservationScores]) -> tuple[str, str] | tuple[None, None]:
    """The digests of all scored files and of all truth; None, None if an observation has none."""
    predictions, truth = {}, {}
    for scores in scored:
        if scores.digests is None:
            return None, None
        predictions[scores.key], truth[scores.key] = scores.digests.predictions, scores.digests.truth
    return list_digest(predictions), list_digest(truth)


def this_machine() -> Machine:
    """The machine of this process."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Machine(
        platform=f"{platform.system()} {platform.machine()}".strip() or "unknown",
        python=f"{platform.python_implementation()} {platform.python_version()}",
        cores=usable or 1,
    )
