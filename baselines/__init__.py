"""Dataset to submission: the trivial baselines, the oracle, which bounds what any method can reach, and three methods.

    from avs3d_bench import Dataset
    from baselines import oracle, trivial

    trivial.write_trivial("centre-box", Dataset("data/demo"), "submissions/centre-box")

`baselines.cli` has the command of each, `avs3d_bench.SubmissionWriter` is what they write with. The public names are
listed in `__init__.pyi`; importing this package imports nothing: modules are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
