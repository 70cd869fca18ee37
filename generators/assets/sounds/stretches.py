"""Takes of recordings that have no sample in common."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import Generator


def stretches(lengths: Sequence[float], seconds: float, count: int, rng: Generator) -> list[tuple[int, float]]:
    """Where each of several takes begins, so that no two have a sample in common if the recordings reach for that.

    Each recording is divided into stretches, which are dealt in random order. If they are too few, the takes are spread
    over all recordings, as far apart in each as its length allows: takes of one recording overlap then.

    Args:
        lengths: of the recordings (s).
        seconds: length of a take.
        count: number of takes.
        rng: the only source of randomness.

    Returns:
        For each take the number of its recording, and its begin as a share of that recording, in [0, 1).

    Examples:
        >>> found = stretches([31.0, 10.0], 10.0, 4, np.random.default_rng(0))
        >>> sorted((number, int(start * [31, 10][number]) // 10) for number, start in found)
        [(0, 0), (0, 1), (0, 2), (1, 0)]
    """
    offsets = rng.random(len(lengths))
    order = rng.permutation(len(lengths))
    if enough(lengths, seconds, count):
        slots = []
        for number, length in enumerate(lengths):
            whole = int(length / seconds)
            spare = float(offsets[number]) * (length - whole * seconds)
            slots += [(number, (spare + place * seconds) / length) for place in range(whole)]
        return [slots[int(chosen)] for chosen in rng.permutation(len(slots))[:count]]
    owners = [int(order[take % len(lengths)]) for take in range(count)]
    shares = [owners.count(number) for number in range(len(lengths))]
    dealt = [(number, place) for number in range(len(lengths)) for place in range(shares[number])]
    dealt = [dealt[int(chosen)] for chosen in rng.permutation(count)]
    return [(number, float((offsets[number] + place / shares[number]) % 1.0)) for number, place in dealt]


def enough(lengths: Sequence[float], seconds: float, count: int) -> bool:
    """Whether recordings of these lengths (s) have ``count`` stretches without a common sample."""
    return stretches_in(lengths, seconds) >= count


def stretches_in(lengths: Sequence[float], seconds: float) -> int:
    """Number of stretches without a common sample that recordings of these lengths (s) have."""
    return sum(int(length / seconds) for length in lengths)
