"""Dataset to submission: the trivial baselines, and the oracle, which bounds what any method can reach.

`baselines.cli` has the command of each, `avs3d_bench.submission.SubmissionWriter` is what they write with.
"""
