"""Errors that tasks raise for the schedulers to see."""

from __future__ import annotations

from avs3d_bench.errors import Avs3dError


class UnfitError(Avs3dError):
    """This worker cannot do the task (another version, a folder it does not see), but another one may."""
