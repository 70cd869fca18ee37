"""Checks of a dataset: `validate` for all of it, `check_observation` for one observation."""

from avs3d_bench.validation.tree import check_observation, validate

__all__ = ["check_observation", "validate"]
