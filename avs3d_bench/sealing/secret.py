"""The secret of a sealed test: its file, the commitment to it, and the keys that follow from it.

    key = scrypt(secret, salt, n, r, p): 64 bytes. The first 32 are the working key, from which all is drawn; the last
    32 are published, with the salt and the parameters, as the commitment.

Who guesses secrets must pay for scrypt (RFC 7914) once per guess, whether the commitment or the published files are
tried: seeds and opening key are HMACs of the working key. The two halves are separate blocks of PBKDF2, so that one
tells nothing of the other.

Seals of schema 1.0 have the sha256 of the secret as their commitment, and the secret itself is their working key.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from pathlib import Path

from avs3d_bench.contract.schema import SecretCommitment
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files

#: Bytes of a secret, of a working key and of a commitment.
SECRET_BYTES = 32
#: Bytes of a salt.
_SALT_BYTES = 16
#: Cost of scrypt: 128 MiB, about half a second (OWASP Password Storage Cheat Sheet, 2024: n = 2^17, r = 8, p = 1).
_COST = {"n": 2**17, "r": 8, "p": 1}
#: Longest file of a secret or key (bytes); it has 64 digits and a line feed.
_MOST_SECRET = 1024


@dataclass(frozen=True)
class CommittedSecret:
    """A secret that is bound.

    Attributes:
        key: the working key (32 bytes), of which all draws are HMACs.
        commitment: what is published.
    """

    key: bytes
    commitment: SecretCommitment | str


def commit(secret: bytes, *, cost: dict[str, int] | None = None, salt: bytes | None = None) -> CommittedSecret:
    """Commit to a secret.

    Args:
        secret: 32 bytes.
        cost: n, r and p of scrypt; None: the usual ones.
        salt: 16 bytes; None: new random ones.
    """
    chosen = cost or _COST
    salt = secrets.token_bytes(_SALT_BYTES) if salt is None else salt
    both = _stretch(secret, salt, **chosen)
    record = SecretCommitment(
        n=chosen["n"], r=chosen["r"], p=chosen["p"], salt=salt.hex(), digest=both[SECRET_BYTES:].hex()
    )
    return CommittedSecret(both[:SECRET_BYTES], record)


def working_key(secret: bytes, commitment: SecretCommitment | str) -> bytes | None:
    """The working key of a secret; None if the commitment is to another secret.

    Args:
        secret: 32 bytes.
        commitment: of `seal.json`; a text is the sha256 of schema 1.0.
    """
    if isinstance(commitment, str):
        return secret if hashlib.sha256(secret).hexdigest() == commitment else None
    both = _stretch(secret, bytes.fromhex(commitment.salt), commitment.n, commitment.r, commitment.p)
    return both[:SECRET_BYTES] if both[SECRET_BYTES:].hex() == commitment.digest else None


def _stretch(secret: bytes, salt: bytes, n: int, r: int, p: int) -> bytes:
    # OpenSSL counts some blocks beside the 128·n·r bytes.
    memory = 128 * r * (n + p + 2) + 2**20
    return hashlib.scrypt(secret, salt=salt, n=n, r=r, p=p, maxmem=memory, dklen=2 * SECRET_BYTES)


def derive(key: bytes, purpose: str) -> bytes:
    """HMAC-SHA256(key, purpose): 32 bytes that tell nothing of the key or of other purposes."""
    return hmac.new(key, purpose.encode(), hashlib.sha256).digest()


def read_secret(path: str | Path) -> bytes:
    """The 32 bytes of a secret, from a file of 64 hexadecimal digits.

    Raises:
        UsageError: if the file cannot be read or holds something else. The message does not quote it.
    """
    return read_hex(path, "secret", "as `avs3d seal` writes it, or `openssl rand -hex 32`")


def read_hex(path: str | Path, what: str, hint: str) -> bytes:
    """32 bytes from a file of 64 hexadecimal digits.

    Args:
        path: the file.
        what: its name in messages.
        hint: where such a file comes from.

    Raises:
        UsageError: if the file cannot be read or holds something else. The message does not quote it.
    """
    try:
        text = files.read_bytes(path, _MOST_SECRET).strip()
    except Avs3dError as error:
        raise UsageError(f"cannot read the {what}: {error}") from error
    expected = f"expected {2 * SECRET_BYTES} hexadecimal digits ({SECRET_BYTES} bytes), {hint}"
    if len(text) != 2 * SECRET_BYTES:
        raise UsageError(f"{path}: a {what} of {len(text)} characters; {expected}")
    try:
        return bytes.fromhex(text.decode("ascii"))
    except ValueError:
        raise UsageError(f"{path}: a {what} with other characters than digits and a to f; {expected}") from None
