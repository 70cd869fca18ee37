"""Names of the conventions that `avs3d metrics` knows; apart from what computes them, for the command's help."""

from __future__ import annotations

from typing import Literal, get_args

Convention = Literal["avs3d", "avsbench-s4", "avsbench-ms3", "ref-avs", "combo", "avss", "3d-avs"]
#: The first is this toolkit's own.
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
