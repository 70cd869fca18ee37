"""The secret of a sealed test: weak ones are refused; its commitment is salted and stretched, and comes first."""

from __future__ import annotations

import hashlib
import math
import random
from pathlib import Path

import pytest

from avs3d_bench.cli import run
from avs3d_bench.contract.schema import SecretCommitment
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.sealing.secret import commit, working_key
from generators.sealing.cli import seal
from generators.sealing.seal import bind_secret
from generators.sealing.strength import FEWEST_BITS, estimate_bits
from tests.generators.test_sealed import error_of
from tests.support.sealed_trees import CHEAP, SECRET

_BLOCK = bytes.fromhex("8f3a1c7be05d9264c1f7a8")
#: Secrets that a person makes up.
WEAK = {
    "a small number": (16).to_bytes(32, "big"),
    "a large number": (10**29).to_bytes(32, "big"),
    "zero": bytes(32),
    "one byte": bytes([7]) * 32,
    "counting": bytes(range(32)),
    "counting down": bytes(range(255, 223, -1)),
    "sevens": bytes(7 * n % 256 for n in range(32)),
    "squares": bytes(n * n % 256 for n in range(32)),
    "digits": bytes.fromhex("0123456789" * 6 + "0123"),
    "words": bytes.fromhex("deadbeef" * 8),
    "a date": bytes.fromhex("20261124" * 8),
    "eight bytes": _BLOCK[:8] * 4,
    "eleven bytes": (_BLOCK * 3)[:32],
    "a counter": b"".join((1000 + n).to_bytes(4, "big") for n in range(8)),
    "padded": bytes(20) + _BLOCK + b"!",
    "runs": b"".join(bytes([value]) * 4 for value in _BLOCK[:8]),
    "text": b"correct horse battery staple 123",
}


@pytest.mark.parametrize("name", WEAK)
def test_secrets_that_can_be_guessed_are_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.txt").write_text(WEAK[name].hex())
    with pytest.raises(UsageError) as caught:
        bind_secret(tmp_path / "test", tmp_path / "secret.txt")
    text = str(caught.value)
    assert "expected at least 100" in text
    assert "openssl rand -hex 32" in text
    assert WEAK[name].hex() not in text
    assert not (tmp_path / "test").exists()


@pytest.mark.slow
def test_random_secrets_are_taken() -> None:
    rng = random.Random(5)
    least = min(estimate_bits(rng.randbytes(32))[0] for _ in range(4_000))
    assert least > FEWEST_BITS + 25


def test_the_probability_that_a_random_secret_is_refused() -> None:
    """The entropy of n values falls below a bound only if few of them are different, which is counted here.

    For m different values among n, the entropy is least if one of them has n − m + 1 places. The chance that n random
    bytes have m different values at most is below C(256, m) (m / 256)^n.
    """

    def chance(count: int, bits: float) -> float:
        def least(different: int) -> float:
            many = count - different + 1
            return many * math.log2(count / many) + (different - 1) * math.log2(count)

        most = max(m for m in range(1, count + 1) if least(m) < bits)
        return math.comb(256, most) * (most / 256) ** count

    text = (95 / 256) ** 32
    # 16 digits: fewer sequences than (number of frequencies) · 2^bits have that entropy (Cover and Thomas, 11.1).
    digits = sum(
        math.comb(64 - lag + 15, 15) * 2.0 ** (FEWEST_BITS - 4 * lag) / 2.0 ** (4 * (64 - lag)) for lag in range(26)
    )
    deflate = 2.0 ** (8 * (FEWEST_BITS // 8 + 1) - 256)
    total = chance(32, 100) + chance(31, 92) + chance(30, 84) + text + digits + deflate
    assert total < 1e-11


def test_a_commitment_is_salted_and_stretched() -> None:
    one, other = commit(SECRET, cost=CHEAP), commit(SECRET, cost=CHEAP)
    assert isinstance(one.commitment, SecretCommitment)
    assert isinstance(other.commitment, SecretCommitment)
    assert one.commitment.salt != other.commitment.salt
    assert one.key != other.key
    both = hashlib.scrypt(SECRET, salt=bytes.fromhex(one.commitment.salt), **CHEAP, dklen=64)
    assert (one.key, one.commitment.digest) == (both[:32], both[32:].hex())
    assert working_key(SECRET, one.commitment) == one.key
    assert working_key(SECRET[::-1], one.commitment) is None


def test_the_usual_cost_is_that_of_a_password(tmp_path: Path) -> None:
    record = files.read_record(bind_secret(tmp_path, None).commitment_file, SecretCommitment)
    assert record.n * record.r * 128 >= 2**27


@pytest.mark.parametrize("change", [{"n": 3}, {"n": 2**40}, {"r": 2**30}, {"p": 1000}, {"salt": "ab"}])
def test_a_record_that_asks_for_too_much_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    """Whoever opens a test must not be made to compute for days, or run out of memory."""
    data = {"n": 16, "r": 1, "p": 1, "salt": "0" * 32, "digest": "0" * 64} | change
    (tmp_path / "commitment.json").write_text(files.dump_json(data))
    with pytest.raises(Avs3dError, match=r"commitment\.json"):
        files.read_record(tmp_path / "commitment.json", SecretCommitment)


@pytest.mark.slow
def test_the_commitment_comes_before_the_template(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run(seal, ["--commit", "-o", str(tmp_path / "test")], program="avs3d")
    assert not caught.value.code
    assert sorted(path.name for path in (tmp_path / "test").iterdir()) == ["commitment.json", "secret"]
    assert "to be published now, before the template" in capsys.readouterr().out
    before = (tmp_path / "test/commitment.json").read_bytes()
    bound = bind_secret(tmp_path / "test", None)
    assert (tmp_path / "test/commitment.json").read_bytes() == before
    assert working_key(bytes.fromhex(bound.file.read_text().strip()), bound.secret.commitment) == bound.secret.key


def test_another_secret_than_the_committed_one_is_refused(tmp_path: Path) -> None:
    bind_secret(tmp_path / "test", None)
    (tmp_path / "other").write_text(SECRET.hex())
    with pytest.raises(UsageError, match=r"commitment\.json: the commitment to another secret than"):
        bind_secret(tmp_path / "test", tmp_path / "other")


def test_seal_needs_a_manifest_or_commit(tmp_path: Path) -> None:
    assert "expected MANIFEST" in error_of(seal, "-o", tmp_path / "test")
    assert "expected MANIFEST" in error_of(seal, tmp_path / "m.yaml", "--commit", "-o", tmp_path / "test")
    assert not (tmp_path / "test").exists()
