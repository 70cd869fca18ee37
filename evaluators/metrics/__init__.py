"""Figures of masks, volumes, classes and directions, as pure functions: of this toolkit and of other benchmarks.

    from evaluators import metrics

    metrics.evaluate(truth, prediction)                 # (N, H, W) masks or soft masks → dict
    metrics.Accumulator().update(truth, prediction)     # batch by batch, in any order
    metrics.avsbench.evaluate(truth, logits)            # as AVSBench's released code; ref_avs, avss, combo likewise
    metrics.pointing.evaluate(truth, prediction)        # for methods that only point
    metrics.rir.evaluate(truth, prediction, rate)       # errors of predicted impulse responses

The evaluator of submissions uses the same functions. docs/metrics-python.md shows their use, docs/which-number.md which
convention a published table has. The public names are listed in `__init__.pyi`; importing this package imports none of
its modules: names are imported on first use, and none of them needs torch.

Examples:
    >>> truth = np.zeros((2, 8, 8), bool)
    >>> truth[:, 2:6, 2:6] = True
    >>> prediction = np.roll(truth, 1, axis=2)  # one pixel too far to the right
    >>> found = metrics.evaluate(truth, prediction)
    >>> round(found["IoU"], 3), round(found["F"], 3)
    (0.6, 0.75)
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
