"""Dataset and submission to scores and report.

    evaluation = evaluate("submission", "open-s34-o7")
    evaluation.scores.parts["part_2"].strict.IoU

The story is in `evaluators.score`; the figures are pure functions in `evaluators.metrics`, `evaluators.contour` and
`evaluators.volume`; docs/metrics.md defines them. Importing this package imports nothing: names are fetched when used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evaluators.reading.checks import check_submission as check_submission
    from evaluators.reading.submission import open_submission as open_submission
    from evaluators.records import InvalidSubmission as InvalidSubmission
    from evaluators.reporting.leaderboard import write_leaderboard as write_leaderboard
    from evaluators.reporting.report import write_report as write_report
    from evaluators.score import evaluate as evaluate

_HOMES = {
    "InvalidSubmission": "records",
    "check_submission": "reading.checks",
    "evaluate": "score",
    "open_submission": "reading.submission",
    "write_leaderboard": "reporting.leaderboard",
    "write_report": "reporting.report",
}
__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'evaluators' has no attribute {name!r}")
    return getattr(import_module(f"evaluators.{_HOMES[name]}"), name)
