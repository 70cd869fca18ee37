"""Errors of predicted room impulse responses, as papers on acoustic fields report them.

| figure | error | definition |
|---|---|---|
| ``T60`` | mean of abs(difference) / truth, % | line through the decay from −5 to −25 dB (T20 of ISO 3382-1) |
| ``T30`` | the same | line through the decay from −5 to −35 dB |
| ``EDT`` | mean of abs(difference), s | line through the decay from 0 to −10 dB (ISO 3382-1) |
| ``C50`` | mean of abs(difference), dB | energy of the first 50 ms over that of the rest |

Decays are Schroeder's backward integration (1965) over all frequencies; every channel counts as a response of its own.
T60 in percent, EDT in seconds and C50 in decibels are the columns of INRAS (Su, Chen and Shlizerman 2022), AV-NeRF
(Liang et al. 2023), the benchmark of Real Acoustic Fields (Chen et al. 2024) and AVR (Lan et al. 2024). Released code
differs in the decay that is called T60: a line through −5 to −25 dB in AVR, as here; −5 to −35 dB in NeRAF (Brunetto et
al. 2025) on SoundSpaces, which is `T30` here, and −5 to −15 dB above 200 Hz on Real Acoustic Fields. AVR begins EDT and
C50 with the first sample of the file, so that the way of the direct sound counts, and reads EDT off the sample that is
nearest to −10 dB: ``from_start=True`` does the former.

    >>> import numpy as np
    >>> time = np.arange(16_000) / 16_000
    >>> found = evaluate(np.exp(-6.9 * time / 0.5), np.exp(-6.9 * time / 0.6), 16_000)
    >>> round(found["T60"], 1), round(found["EDT"], 2)
    (20.0, 0.1)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.measures.decay import decay_figures
from evaluators.metrics.inputs import as_array

#: Figures whose error is a share of the truth, in percent, and those whose error is a difference.
RELATIVE, ABSOLUTE = ("T60", "T30"), ("EDT", "C50")


def evaluate(truth: object, prediction: object, rate: float, *, from_start: bool = False) -> dict[str, float]:
    """Errors of predicted responses, means over all responses and channels.

    Args:
        truth: (..., n), amplitude over time: one response, or any number of them.
        prediction: (..., m) of the same leading shape; it may be longer or shorter.
        rate: samples per second, Hz.
        from_start: begin EDT and C50 with the first sample; else with the direct sound of each response (the first
            sample within 20 dB of its peak, ISO 3382-1).

    Returns:
        ``T60`` and ``T30`` (%), ``EDT`` (s), ``C50`` (dB): mean errors over the responses in which both truth and
        prediction can be measured, NaN if there are none; ``invalid``: the share of the figures that can be measured in
        the truth, but not in the prediction (silence, a decay that ends too early).

    Raises:
        UsageError: if the rate cannot be one.
        Avs3dError: if there is no response, a value is not finite, or the shapes do not fit together.
    """
    if isinstance(rate, bool) or not isinstance(rate, int | float | np.number) or not 0 < float(rate) < np.inf:
        raise UsageError(f"rate: {excerpt(rate)}, expected samples per second")
    true, found = _responses(truth, "truth"), _responses(prediction, "prediction")
    if true.shape[:-1] != found.shape[:-1]:
        raise Avs3dError(f"prediction: shape {found.shape}, expected {true.shape[:-1]} responses, as the truth has")
    first = 0 if from_start else None
    pairs = [
        (decay_figures(one, float(rate), first), decay_figures(other, float(rate), first))
        for one, other in zip(_rows(true), _rows(found), strict=True)
    ]
    errors: dict[str, list[float]] = {name: [] for name in (*RELATIVE, *ABSOLUTE)}
    known = lost = 0
    for one, other in pairs:
        for name, some in errors.items():
            expected, got = one[name], other[name]
            if expected is None:
                continue
            known += 1
            if got is None:
                lost += 1
            else:
                some.append(abs(got - expected) * (100 / expected if name in RELATIVE else 1.0))
    means = {name: float(np.mean(some)) if some else float("nan") for name, some in errors.items()}
    return {**means, "invalid": lost / known if known else float("nan")}


def _responses(values: object, where: str) -> NDArray[np.floating]:
    array = as_array(values, where)
    if array.ndim == 0 or array.size == 0:
        raise Avs3dError(f"{where}: shape {array.shape}, expected (..., n) with at least one response and sample")
    bad = int((~np.isfinite(array)).sum())
    if bad:
        raise Avs3dError(f"{where}: {bad:,} of {array.size:,} samples are NaN or infinite; expected finite numbers")
    return np.asarray(array, dtype=np.float64)


def _rows(array: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N, n): every channel of every response."""
    return array.reshape(-1, array.shape[-1])
