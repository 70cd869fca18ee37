"""Signatures of the files that the evaluator's commands write: a rerun replaces only files that carry one."""

from __future__ import annotations

from avs3d_bench.commands.outputs import PNG_OF_OURS, SVG_OF_OURS, Signature


def _page(template: str) -> Signature:
    return Signature(
        start=b"<!doctype html>", marks=(f'<meta name="generator" content="{GENERATORS[template]}">'.encode(),)
    )


#: Template → what its pages say that they are (``<meta name="generator">``).
GENERATORS = {
    "report.html.j2": "avs3d-bench score report", "leaderboard.html.j2": "avs3d-bench leaderboard",
    "factors.html.j2": "avs3d-bench figures by factor",
}  # fmt: skip
REPORT = _page("report.html.j2")
LEADERBOARD = _page("leaderboard.html.j2")
FACTORS = _page("factors.html.j2")

SCORES = Signature(keys=("avs3d_eval",), exactly=False)
COMPARISON = Signature(keys=("avs3d_compare",), exactly=False)
BOARD = Signature(keys=("avs3d_leaderboard", "entries", "tables"), exactly=False)
VERIFICATION = Signature(keys=("same", "values", "differences", "notes", "scores", "dataset", "evaluator"))
MASK_METRICS = Signature(keys=("avs3d_metrics", "convention", "clips", "frames", "figures", "order_free"))

FRAMES_CSV = Signature(start=b"frames_version,method,dataset,dataset_sha256,protocol,")
FRAMES_PARQUET = Signature(start=b"PAR1", marks=(b"frames_version", b"dataset_sha256", b"predicted_pixels"))
FACTORS_CSV = Signature(start=b"protocol,figure,factor,unit,bin,from,to,method,value,")

#: Suffix → files of `avs3d tables`.
TABLES = {
    ".md": (Signature(start=b"# Table 2: methods and parts\n"), Signature(start=b"# Table 3: voting thresholds\n")),
    ".csv": (Signature(start=b"section,dataset,dataset_version,dataset_sha256,"),),
    ".png": (PNG_OF_OURS,),
    ".svg": (SVG_OF_OURS,),
}
#: Suffix → files of `avs3d sweep-curve`.
CURVES = {
    ".md": (
        Signature(start=b"# ", marks=(b"\nMean over observations (pair accuracy: over groups) and its 95 % interval",)),
    ),
    ".csv": (Signature(start=b"method,", marks=(b",t30,figure,n,mean,low,high,change,change_low,change_high\n",)),),
    ".png": (PNG_OF_OURS,),
}
