"""Signatures of exported files: a rerun replaces only files that carry one."""

from __future__ import annotations

from avs3d_bench.commands.outputs import Signature

CROISSANT = Signature(
    start=b"{",
    marks=(b"http://mlcommons.org/croissant/", b"in the layout of 3DAVS-S34-O7 (", b'"recordSet"'),
)
CARD = Signature(start=b"---\npretty_name:", marks=(b"\ntask_categories:", b"avs3d-bench"))
BUNDLE = Signature(start=b"PK", marks=(b"competition.yaml", b"scoring_program", b"starting_kit"))
