"""CPU time from the start of a program to its answer: help of the commands, and the import of the acoustics alone."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from collections.abc import Sequence


def run_all(repeats: int) -> dict[str, float]:
    """Measure.

    Args:
        repeats: number of runs for each median.

    Returns:
        Figure → value.
    """

    def seconds(*words: str) -> float:
        return statistics.median(_seconds(words) for _ in range(repeats))

    return {
        "avs3d --help (CPU s)": seconds("-m", "avs3d_bench", "--help"),
        "avs3d-eval --help (CPU s)": seconds("-c", "from evaluators.cli import main; main(['--help'])"),
        "import generators.acoustics, over Python alone (CPU s)": seconds("-c", "import generators.acoustics")
        - seconds("-c", ""),
    }


def _seconds(words: Sequence[str]) -> float:
    begin = os.times()
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    end = os.times()
    return end.children_user + end.children_system - begin.children_user - begin.children_system
