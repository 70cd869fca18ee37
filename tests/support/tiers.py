"""Which parameters of a dear test are in the fast tests: `make test`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def some(values: Iterable[Any], every: int) -> list[ParameterSet]:
    """Parameters for `pytest.mark.parametrize`: the first of each ``every``; the others are left to the slow tests.

    Args:
        values: of one name; a tuple has one value for each of several names.
        every: 1 marks none as slow.
    """
    parameters = [value if type(value) is tuple else (value,) for value in values]
    return [
        pytest.param(*each, marks=[pytest.mark.slow] if number % every else [])
        for number, each in enumerate(parameters)
    ]
