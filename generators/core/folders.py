"""The folder of generation's caches."""

from __future__ import annotations

import os
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.user_path import user_path


def user_cache() -> Path:
    """``avs3d-bench`` in the user's cache folder: on Linux ``$XDG_CACHE_HOME``, else ``~/.cache``.

    Raises:
        Avs3dError: if the user has no home folder.
    """
    from platformdirs import user_cache_path  # part of an extra; not needed with AVS3D_CACHE

    try:
        folder = user_cache_path("avs3d-bench", appauthor=False)
    except RuntimeError:  # earlier versions of platformdirs return a path that begins with ~
        folder = Path("~")
    if folder.parts[0].startswith("~"):
        raise Avs3dError("no home folder for caches is known; set AVS3D_CACHE or XDG_CACHE_HOME")
    return folder


def default_cache() -> Path:
    """``$AVS3D_CACHE``, else `user_cache`."""
    named = os.environ.get("AVS3D_CACHE")
    if named:
        return user_path(named)
    return user_cache()
