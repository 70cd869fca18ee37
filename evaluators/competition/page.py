"""The page that a participant of a competition sees: the figures of a submission, or its bad files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from avs3d_bench.commands.report import Problem, shorten
from avs3d_bench.contract.competition import DECIMALS
from avs3d_bench.text.templates import template_environment

#: Findings in a submission that the page and the log of a competition show.
SHOWN = 100


@dataclass(frozen=True)
class CompetitionRow:
    """A figure of the whole submission.

    Attributes:
        title: its name.
        value: the mean; None where the data cannot give it.
        interval: the bounds of its 95 % interval; None with too few observations.
        reason: why there is no value.
    """

    title: str
    value: float | None
    interval: tuple[float, float] | None
    reason: str | None = None

    @property
    def shown(self) -> str:
        """The value with its interval, as text.

        Examples:
            >>> Row("strict IoU", 0.5, (0.41, 0.6)).shown
            '0.500 [0.410, 0.600]'
        """
        if self.value is None:
            return f"not available ({self.reason})" if self.reason else "not available"
        interval = f" [{self.interval[0]:.{DECIMALS}f}, {self.interval[1]:.{DECIMALS}f}]" if self.interval else ""
        return f"{self.value:.{DECIMALS}f}{interval}"

    @property
    def text(self) -> str:
        """The line of the log."""
        return f"{self.title}: {self.shown}"


def results_page(title: str, rows: Sequence[CompetitionRow], problems: Sequence[Problem]) -> str:
    """The HTML page: a table of figures, then what was found in the submission's files.

    Args:
        title: of the task.
        rows: the figures; none for an invalid submission.
        problems: every finding; the page shows `SHOWN` of them.
    """
    page = template_environment("evaluators.reporting").get_template("competition.html.j2")
    first, rest = shorten(problems, SHOWN)
    return page.render(title=title, rows=rows, problems=first, rest=rest)
