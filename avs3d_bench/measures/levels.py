"""Levels of binaural sound in dB, from the RMS of each ear."""

from __future__ import annotations

import math

#: Added to an RMS, so that silence has a level: −240 dB re full scale.
TINY = 1e-12


def ild_db(left: float, right: float) -> float:
    """Interaural level difference of two RMS values, dB: positive where the right ear is louder; 0 for silence.

    >>> ild_db(0.1, 0.2)
    6.0205...
    """
    return 20 * math.log10((right + TINY) / (left + TINY))


def level_db(left: float, right: float) -> float:
    """Level of both ears together, dB re full scale."""
    return 10 * math.log10((left**2 + right**2) / 2 + TINY**2)
