"""Undo the mixing of numpy's `SeedSequence`: from the pool of one random stream to the pool of another.

`SeedSequence` is made for independent streams, not for secrets: each word of entropy is mixed into a pool of four words
by steps that can be undone if the word is known (numpy/random/bit_generator.pyx). Streams whose entropy begins with the
same secret words and ends with known ones can therefore be computed from each other.
"""

from __future__ import annotations

from collections.abc import Sequence

#: The constants of numpy's SeedSequence.
_INIT, _MULTIPLIER = 0x43B0D7E5, 0x931E8875
_LEFT, _RIGHT = 0xCA01F9DD, 0x4973F715
_SHIFT, _POOL = 16, 4
_WORD = 2**32
_LEFT_INVERSE = pow(_LEFT, -1, _WORD)

Words = Sequence[int]


def exchanged_pool(pool: Words, first: int, known: Words, wanted: Words) -> list[int]:
    """The pool of a stream that differs from another in its last words.

    Args:
        pool: (4,) of the stream whose state is known.
        first: number of secret words, at least 4, in front of the known ones.
        known: the last words of the entropy of that stream.
        wanted: the same words of the other stream.
    """
    steps = _constants(_POOL * first, _POOL * len(known))
    pool = list(pool)
    for number in reversed(range(len(known))):
        for place in range(_POOL):
            pool[place] = _unmixed(pool[place], _hashed(known[number], steps[_POOL * number + place]))
    for number, word in enumerate(wanted):
        for place in range(_POOL):
            pool[place] = _mixed(pool[place], _hashed(word, steps[_POOL * number + place]))
    return pool


def _constants(skipped: int, count: int) -> list[int]:
    """The constant of each call of the hash, after the first ``skipped`` calls."""
    value = _INIT * pow(_MULTIPLIER, skipped, _WORD) % _WORD
    out = []
    for _ in range(count):
        out.append(value)
        value = value * _MULTIPLIER % _WORD
    return out


def _hashed(word: int, constant: int) -> int:
    value = (word ^ constant) * (constant * _MULTIPLIER % _WORD) % _WORD
    return value ^ (value >> _SHIFT)


def _mixed(place: int, hashed: int) -> int:
    value = (_LEFT * place - _RIGHT * hashed) % _WORD
    return value ^ (value >> _SHIFT)


def _unmixed(place: int, hashed: int) -> int:
    value = place ^ (place >> _SHIFT)
    return (value + _RIGHT * hashed) * _LEFT_INVERSE % _WORD
