"""The scoring of other benchmarks as their released code does it: `avsbench`, `ref_avs`, `avss`, `combo`.

Every module has the same two functions with the same keys. `evaluate` equals the released code to 1e-6, quirks
included; `order_free` gives the figure of that name that depends neither on batches nor on the order of frames.
"""

from evaluators.metrics.conventions import avsbench as avsbench
from evaluators.metrics.conventions import avss as avss
from evaluators.metrics.conventions import combo as combo
from evaluators.metrics.conventions import ref_avs as ref_avs
