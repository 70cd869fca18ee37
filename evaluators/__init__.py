"""Dataset and submission to scores and report.

    from evaluators import check, evaluate

    evaluation = evaluate("submission", "open-s34-o7")
    evaluation.scores.parts["part_2"].strict.IoU

`check` names every bad file of a submission, `evaluate` scores it, `compare` says which of several methods a test
separates, `write_report` and `write_leaderboard` show the scores. The story is in `evaluators.score`; the figures are
pure functions in `evaluators.metrics`; docs/metrics.md defines them. The
public names are listed in `__init__.pyi`; importing this package imports nothing: names are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
