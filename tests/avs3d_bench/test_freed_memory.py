"""`keep_freed_memory`: a process that frees large arrays gets them back without new pages."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

#: Page faults of ten arrays of 40 MiB, one after the other, once the first has been written and freed.
_FAULTS = """
import resource, sys
import numpy as np
from avs3d_bench.runtime.freed_memory import keep_freed_memory

if sys.argv[1] == "kept":
    assert keep_freed_memory()
np.ones(40 << 20, np.uint8)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    np.ones(40 << 20, np.uint8)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def _faults(what: str) -> int:
    done = subprocess.run([sys.executable, "-c", _FAULTS, what], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc's allocator")
def test_kept_memory_is_not_mapped_again() -> None:
    """Ten arrays of 40 MiB: each is fresh memory by default, and the same memory where it is kept."""
    # Pages of 4 KiB, or of 2 MiB where the system makes large ones by itself.
    assert _faults("default") >= 10 * 20
    assert _faults("kept") < 20
