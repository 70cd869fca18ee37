"""How many bits a secret has, by a simple estimate: secrets that a person makes up are refused."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from avs3d_bench.errors import UsageError
from avs3d_bench.sealing.secret import SECRET_BYTES

#: Fewest bits of a secret.
FEWEST_BITS = 100
#: Bits of a character of a text that a person writes: 0.6 to 1.3 in English prose (Shannon, Prediction and Entropy of
#: Printed English, Bell System Technical Journal 30, 1951), more in passwords.
_TEXT_BITS = 3.0
#: Longest period of repeated blocks that is looked for (hexadecimal digits): longer ones have `FEWEST_BITS` anyway.
_LONGEST_PERIOD = FEWEST_BITS // 4


def require_strong(secret: bytes, path: Path) -> None:
    """Refuse a secret that can be guessed.

    Raises:
        UsageError: naming the file and what makes the secret weak; the message does not quote it.
    """
    bits, why = estimate_bits(secret)
    if bits < FEWEST_BITS:
        raise UsageError(
            f"{path}: a secret of about {bits:.0f} bits ({why}), expected at least {FEWEST_BITS}: whoever guesses it "
            f"has the truth; draw one with `openssl rand -hex {SECRET_BYTES}`"
        )


def estimate_bits(secret: bytes) -> tuple[float, str]:
    r"""The bits of a secret under the model that describes it best, and that model.

    The models: bytes or hexadecimal digits that are drawn from their own frequencies (entropy of order 0); the same of
    the differences of neighbours, once and twice (runs, arithmetic sequences), and of digits one period apart (repeated
    blocks, counters); DEFLATE; text. Of random secrets, fewer than 1 in 10^11 is below `FEWEST_BITS` (docs/sealed.md).
    A secret that a program computed from something guessable, such as the sha256 of a word, looks random.

    Args:
        secret: 32 bytes.

    Examples:
        >>> estimate_bits(bytes(31) + b"\x10")[1]
        'few different bytes or digits'
        >>> estimate_bits(bytes(range(32)))
        (8.0, 'an arithmetic sequence')
    """
    return min(_models(secret), key=lambda model: model[0])


def _models(secret: bytes) -> Iterator[tuple[float, str]]:
    digits = [int(digit, 16) for digit in secret.hex()]
    yield min(_bits(list(secret)), _bits(digits)), "few different bytes or digits"
    steps = _differences(list(secret), 1, 256)
    yield 8 + _bits(steps), "an arithmetic sequence"
    yield 16 + _bits(_differences(steps, 1, 256)), "steps that grow evenly"
    for period in range(1, _LONGEST_PERIOD + 1):
        bits = 4 * period + _bits(_differences(digits, period, 16))
        yield bits, "runs or steps of digits" if period == 1 else f"blocks of {period} digits that resemble each other"
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    yield 8.0 * len(packer.compress(secret.hex().encode()) + packer.flush()), "compressible"
    if all(32 <= byte < 127 for byte in secret):
        yield _TEXT_BITS * len(secret), "the digits of a text"


def _bits(values: Sequence[int]) -> float:
    """Entropy of order 0 of a sequence (bits): its length under the code that its own frequencies give."""
    total = len(values)
    return abs(sum(count * math.log2(count / total) for count in Counter(values).values()))


def _differences(values: Sequence[int], lag: int, size: int) -> list[int]:
    return [(later - earlier) % size for earlier, later in zip(values, values[lag:], strict=False)]
