"""Asking over HTTP: patient when told to wait, bounded, and never carrying a token to another host.

On urllib of the standard library: it knows proxies and the system's certificates, and what is left to do (waiting and
redirects here, ranges in `download`) is the same on any client. RFC 9110: Retry-After (§10.2.3: seconds or a date),
redirects (§15.4).
"""

from __future__ import annotations

import contextlib
import email.utils
import http.client
import ipaddress
import json
import socket
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urljoin, urlsplit

from avs3d_bench import __version__
from avs3d_bench.errors import Avs3dError

MEGABYTE = 1_000_000
#: Answers of an API that are larger than this are none.
_JSON_LIMIT = 8 * MEGABYTE
_CHUNK = 1 << 16
_REDIRECTS = (301, 302, 303, 307, 308)
_MAX_REDIRECTS = 5
#: No pause that a server asks for counts as longer than this: ten years, seconds.
_LONGEST = 3.2e8
#: Answers worth another try: too many requests, and servers that are out of breath.
_PASSING = (429, 500, 502, 503, 504)

Say = Callable[[str], None]


class HttpError(Avs3dError):
    """A server's refusal, with its ``status``."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status


class CutError(Avs3dError):
    """The connection was cut, timed out or could not be made; what has come is kept for the next run."""


@dataclass(frozen=True)
class Limits:
    """How long and how much.

    Attributes:
        timeout: seconds without a byte (and for connecting).
        total: seconds for one file, pauses included.
        max_bytes: of one file.
        max_wait: longest pause that a server's Retry-After may ask for, seconds.
        attempts: of one request, the first included.
        backoff: first pause after a passing failure without Retry-After, seconds; doubled each time.
    """

    timeout: float = 30.0
    total: float = 3600.0
    max_bytes: int = 500 * MEGABYTE
    max_wait: float = 120.0
    attempts: int = 5
    backoff: float = 1.0


@dataclass(frozen=True)
class Request:
    """What to ask for, and how to speak of it.

    Attributes:
        url: https, or http on this machine's own loopback.
        what: the asset, as messages name it (``freesound/1234``).
        service: who answers (``Freesound``).
        token: value of the Authorization header; goes to this address's own origin only, and into no message.
        body: JSON to POST; GET without it.
        advice: status → what the user can do about it.
    """

    url: str
    what: str
    service: str
    token: str | None = field(default=None, repr=False)
    body: Any = None
    advice: Mapping[int, str] = field(default_factory=dict)


def get_json(request: Request, limits: Limits, say: Say = lambda _: None) -> Any:
    """The JSON that an API answers.

    Raises:
        HttpError: for a refusal (401, 403, 404, 429 beyond `Limits.max_wait`, …), with the advice for its status.
        CutError: if no whole answer came.
        Avs3dError: if the answer is no JSON or too large.
    """
    deadline = time.monotonic() + limits.total
    for attempt in attempts(request, limits, say, deadline):
        with attempt, open_answer(request, {"Accept": "application/json"}, limits, deadline) as answer:
            data = bytearray()
            while block := read_block(answer, request, deadline):
                data += block
                if len(data) > _JSON_LIMIT:
                    raise Avs3dError(
                        f"{request.what}: {request.service} answered more than 8 MB where JSON was expected"
                    )
            promised = content_length(answer)
            if promised is not None and len(data) < promised:
                raise interrupted(request, f"the connection was cut after {len(data)} of {promised} bytes")
            try:
                return json.loads(bytes(data))
            except (ValueError, RecursionError):  # also what is nested a thousand times
                raise Avs3dError(
                    f"{request.what}: {request.service} answered no JSON ({_shown(request.url)}); is the address right?"
                ) from None
    raise AssertionError("the last attempt returns or raises")


def check_url(url: str, what: str, *, loopback: bool = True) -> None:
    """Refuse an address that is neither https nor http on the loopback interface.

    Raises:
        Avs3dError: naming the asset and the address.
    """
    with contextlib.suppress(ValueError):  # an unclosed bracket, a port of a million
        parts = urlsplit(url)
        host, _ = parts.hostname or "", parts.port
        if parts.scheme == "https" and host:
            return
        if parts.scheme == "http" and loopback and _is_loopback(host):
            return
    raise Avs3dError(f"{what}: {_shown(url)} is no https address; expected https (http only on this machine)")


def content_length(answer: Any) -> int | None:
    """Bytes that an answer promises, if it says so in plain digits."""
    text = str(answer.headers.get("Content-Length") or "").strip()
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 18 else None


def interrupted(request: Request, cause: str) -> CutError:
    """The error of a transfer that ended early because of ``cause``."""
    return CutError(f"{request.what}: {cause} ({urlsplit(request.url).hostname}); run the same command again to go on")


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Hands redirects back, so that each step's address is looked at and the token stays at home."""

    def redirect_request(self, *_args: Any, **_kwargs: Any) -> None:
        return None


def open_answer(
    request: Request, headers: Mapping[str, str], limits: Limits, deadline: float, passed: tuple[int, ...] = ()
) -> Any:
    """The answer (2xx, or a status in ``passed``), redirects followed.

    Raises:
        HttpError: any other status.
        CutError: no connection, or no answer in time.
    """
    url, posting = request.url, True
    check_url(url, request.what)
    origin = _origin(url)
    loopback = _is_loopback(urlsplit(url).hostname or "")
    # A proxy cannot reach this machine's own loopback.
    opener = urllib.request.build_opener(_NoRedirect, *([urllib.request.ProxyHandler({})] if loopback else []))
    for _ in range(_MAX_REDIRECTS + 1):
        timeout = max(0.01, min(limits.timeout, deadline - time.monotonic()))
        sent = {"User-Agent": f"avs3d-bench/{__version__}", "Accept": "*/*", "Accept-Encoding": "identity", **headers}
        body = None
        if request.body is not None and posting:
            body = json.dumps(request.body).encode()
            sent["Content-Type"] = "application/json"
        if request.token is not None and _origin(url) == origin:
            sent["Authorization"] = request.token
        try:
            return opener.open(urllib.request.Request(url, data=body, headers=sent), timeout=timeout)
        except urllib.error.HTTPError as error:
            status, location = error.code, error.headers.get("Location")
            if status in passed:
                return error
            error.close()
            if status not in _REDIRECTS:
                raise _refusal(request, error) from None
            if not location:
                raise HttpError(
                    f"{request.what}: {request.service} redirects to nowhere (HTTP {status})", status
                ) from None
            url, posting = _joined(url, location), posting and status in (307, 308)
            check_url(url, request.what, loopback=loopback)
        except (http.client.InvalidURL, ValueError):  # their text may quote what is sent
            raise Avs3dError(
                f"{request.what}: {_shown(url)} is no valid address; report it to {request.service}"
            ) from None
        except (OSError, http.client.HTTPException) as error:
            raise _no_answer(request, url, error, timeout) from None
    raise HttpError(
        f"{request.what}: {request.service} redirects more than {_MAX_REDIRECTS} times; report it there", 310
    )


def read_block(answer: Any, request: Request, deadline: float) -> bytes:
    """The next bytes; empty at the end."""
    if time.monotonic() > deadline:
        raise interrupted(request, "the transfer took longer than allowed (see --max-time)")
    try:
        return bytes(answer.read1(_CHUNK))
    except http.client.IncompleteRead as error:
        raise interrupted(request, f"the connection was cut ({len(error.partial)} bytes into a block)") from None
    except TimeoutError:
        raise interrupted(request, f"{request.service} sent nothing for too long (see --timeout)") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise interrupted(request, f"the connection was cut ({_words(error)})") from None


class _BusyError(HttpError):
    """A refusal that may pass; ``wait`` in seconds if the server says."""

    def __init__(self, message: str, status: int, wait: float | None) -> None:
        super().__init__(message, status)
        self.wait = wait


def _refusal(request: Request, error: urllib.error.HTTPError) -> HttpError:
    status = error.code
    known = {
        401: "it wants a valid token",
        403: "it does not allow this",
        404: "there is no such thing",
        410: "it is gone",
        429: "too many requests",
    }
    cause = known.get(status) or ("it is out of order" if status >= 500 else http.client.responses.get(status, "?"))
    advice = request.advice.get(status)
    if advice is None:
        advice = "try again later" if status in _PASSING else "check the id and what your account may do"
    message = f"{request.what}: {request.service} answered {status}: {cause}; {advice}"
    if status in _PASSING:
        return _BusyError(message, status, retry_after(error.headers.get("Retry-After")))
    return HttpError(message, status)


def retry_after(value: str | None, now: float | None = None) -> float | None:
    """Seconds that a Retry-After header asks for (a number, or a date); None if it says nothing sensible."""
    if value is None:
        return None
    text = value.strip()
    if text.isascii() and text.isdigit():
        return min(float(text), _LONGEST)
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        moment = email.utils.parsedate_to_datetime(text).timestamp()
        return min(max(0.0, moment - (time.time() if now is None else now)), _LONGEST)
    return None


def attempts(
    request: Request, limits: Limits, say: Say, deadline: float
) -> Iterator[contextlib.AbstractContextManager[None]]:
    """Contexts to try in, one after the other: each swallows a passing failure and waits; the last one lets it out."""
    for number in range(1, limits.attempts + 1):
        yield _attempt(request, limits, say, deadline, number)


@contextlib.contextmanager
def _attempt(request: Request, limits: Limits, say: Say, deadline: float, number: int) -> Iterator[None]:
    try:
        yield
    except (_BusyError, CutError) as error:
        pause = limits.backoff * 2 ** (number - 1)
        if isinstance(error, _BusyError) and error.wait is not None:
            pause = error.wait
            if pause > limits.max_wait:
                again = time.strftime("%H:%M:%S UTC", time.gmtime(time.time() + pause))
                raise HttpError(
                    f"{request.what}: {request.service} answered {error.status} and asks to wait {pause:.0f} s (the "
                    f"limit is {limits.max_wait:g} s); run again after {again} or raise --max-wait",
                    error.status,
                ) from None
        if number == limits.attempts or time.monotonic() + pause > deadline:
            raise
        cause = f"HTTP {error.status}" if isinstance(error, HttpError) else "interrupted"
        say(f"{request.what}: {cause}, attempt {number + 1} of {limits.attempts} in {pause:.0f} s")
        time.sleep(pause)


def _no_answer(request: Request, url: str, error: Exception, timeout: float) -> Avs3dError:
    host = urlsplit(url).netloc.rpartition("@")[2]
    reason = getattr(error, "reason", error)
    if isinstance(reason, TimeoutError) or isinstance(error, TimeoutError):
        return CutError(f"{request.what}: {host} did not answer within {timeout:g} s; try again later (see --timeout)")
    if isinstance(reason, socket.gaierror):
        return Avs3dError(f"{request.what}: no address of {host} is known ({_words(reason)}); check the network")
    if isinstance(reason, ssl.SSLCertVerificationError):
        return Avs3dError(
            f"{request.what}: the certificate of {host} is not valid ({reason.verify_message}); not fetched"
        )
    return CutError(f"{request.what}: no connection to {host} ({_words(reason)}); check the network or the proxy")


def _words(error: Any) -> str:
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(text).split())[:120]


def _shown(url: str) -> str:
    """An address for messages: without its query, where signatures and keys are."""
    try:
        parts = urlsplit(url)
        shown = f"{parts.scheme}://{parts.hostname or ''}{f':{parts.port}' if parts.port else ''}{parts.path}"
    except ValueError:
        shown = url.partition("?")[0].rpartition("@")[2]
    return "".join(letter if letter.isprintable() else "?" for letter in shown)[:200]


def _joined(url: str, location: str) -> str:
    """The address that a redirect leads to; what is none is left to `check_url`."""
    try:
        return urljoin(url, location)
    except ValueError:
        return location


def _origin(url: str) -> tuple[str, str, int]:
    parts = urlsplit(url)
    return parts.scheme, (parts.hostname or "").lower(), parts.port or {"https": 443, "http": 80}.get(parts.scheme, 0)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False
