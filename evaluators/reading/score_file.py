"""Reading a file of scores that anybody may have written."""

from __future__ import annotations

from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import read_bytes
from avs3d_bench.schema import parse_record
from avs3d_bench.scores import Scores

#: Largest file of scores (bytes): an observation takes about one KB.
MAX_SCORES_BYTES = 64 * 2**20


def read_scores(path: Path) -> Scores:
    """Read what ``avs3d-eval --json`` wrote.

    Raises:
        Avs3dError: if it is missing, too large, no file of scores, or contradicts itself; the field is named.
    """
    scores = parse_record(read_bytes(path, MAX_SCORES_BYTES), Scores, path)
    if len(scores.observations) != scores.dataset.scored:
        raise Avs3dError(
            f"{path}: observations: {len(scores.observations)} in the list, but dataset.scored is "
            f"{scores.dataset.scored}; score the submission again"
        )
    if not scores.avs3d_eval.protocols:
        raise Avs3dError(f"{path}: avs3d_eval.protocols: empty, expected official, strict or listen; score it again")
    for protocol in scores.avs3d_eval.protocols:
        if getattr(scores.overall, protocol) is None:
            raise Avs3dError(
                f"{path}: overall.{protocol}: null, though avs3d_eval.protocols lists it; score the submission again"
            )
    return scores
