"""Where generation keeps what it can make again."""

from __future__ import annotations

import os
from pathlib import Path

from avs3d_bench.files import user_path


def default_cache() -> Path:
    """``$AVS3D_CACHE``, else ``avs3d-bench`` in the user's cache folder."""
    named = os.environ.get("AVS3D_CACHE")
    if named:
        return user_path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "avs3d-bench"
