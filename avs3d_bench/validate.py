"""`validate` under its short name; see `avs3d_bench.validation`."""

from avs3d_bench.commands.report import Problem, Report
from avs3d_bench.validation import check_observation, validate

__all__ = ["Problem", "Report", "check_observation", "validate"]
