"""HTTP requests with waiting times, limits, and tokens that are never sent to another host.

The package requests handles connections, proxies and redirects. This module decides which addresses are allowed and
which get a token, applies limits of time and size, and words the errors. RFC 9110: Retry-After (§10.2.3: seconds or a
date), redirects (§15.4). docs/decisions.md explains why the attempts are counted here and not by urllib3.
"""

from __future__ import annotations

import contextlib
import http.client
import ipaddress
import json
import socket
import ssl
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import requests
import urllib3
from urllib3.util import Retry

from avs3d_bench import __version__
from avs3d_bench.errors import Avs3dError

MEGABYTE = 1_000_000
#: Largest accepted answer of an API (bytes).
_JSON_LIMIT = 8 * MEGABYTE
_CHUNK = 1 << 16
_MAX_REDIRECTS = 5
#: Upper limit of a pause that a server asks for (s): ten years.
_LONGEST = 320_000_000
#: Statuses after which the request is repeated: too many requests, overloaded servers.
_PASSING = (429, 500, 502, 503, 504)

Say = Callable[[str], None]


class HttpError(Avs3dError):
    """A server's refusal, with its ``status``."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status


class CutError(Avs3dError):
    """The connection was cut, timed out or could not be made; the part file is kept for the next run."""


@dataclass(frozen=True)
class FetchLimits:
    """Limits of time and size.

    Attributes:
        timeout: seconds without a byte (and for connecting).
        total: seconds for one file, pauses included.
        max_bytes: bytes of one file.
        max_wait: longest pause that a server's Retry-After may ask for, seconds.
        attempts: attempts at one request, with the first.
        backoff: first pause after a temporary failure without Retry-After, seconds; doubled each time.
    """

    timeout: float = 30.0
    total: float = 3600.0
    max_bytes: int = 500 * MEGABYTE
    max_wait: float = 120.0
    attempts: int = 5
    backoff: float = 1.0


@dataclass(frozen=True)
class Request:
    """A request, and the texts that messages use for it.

    Attributes:
        url: https, or http on this machine's own loopback.
        what: the asset's name in messages (``freesound/1234``).
        service: the server's name in messages (``Freesound``).
        token: value of the Authorization header; it is sent only to the origin of ``url``, and is in no message.
        body: JSON to POST; without it the request is a GET.
        advice: status → advice for the user.
    """

    url: str
    what: str
    service: str
    token: str | None = field(default=None, repr=False)
    body: Any = None
    advice: Mapping[int, str] = field(default_factory=dict)


def get_json(request: Request, limits: FetchLimits, say: Say = lambda _: None) -> Any:
    """Request JSON from an API.

    Raises:
        HttpError: for a refusal (401, 403, 404, 429 beyond `FetchLimits.max_wait`, …), with the advice for its status.
        CutError: if no complete answer came.
        Avs3dError: if the answer is not JSON or too large.
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
            except (ValueError, RecursionError):  # RecursionError: JSON that is nested too deeply
                raise Avs3dError(
                    f"{request.what}: {request.service} did not answer with JSON: {_shown(request.url)}; check it"
                ) from None
    raise AssertionError("the last attempt returns or raises")


def check_url(url: str, what: str, *, loopback: bool = True) -> None:
    """Refuse an address that is neither https nor http on the loopback interface.

    Raises:
        Avs3dError: naming the asset and the address.
    """
    with contextlib.suppress(ValueError):  # for example an unclosed bracket, or a port of a million
        parts = urlsplit(url)
        host, _ = parts.hostname or "", parts.port
        if parts.scheme == "https" and host:
            return
        if parts.scheme == "http" and loopback and _is_loopback(host):
            return
    raise Avs3dError(f"{what}: {_shown(url)} is not an https address; expected https (http only on this machine)")


def content_length(answer: requests.Response) -> int | None:
    """Number of bytes in the answer's Content-Length, if that is a plain number."""
    text = str(answer.headers.get("Content-Length") or "").strip()
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 18 else None


def interrupted(request: Request, cause: str) -> CutError:
    """The error of a transfer that ended early because of ``cause``."""
    return CutError(
        f"{request.what}: {cause} ({urlsplit(request.url).hostname}); run the same command again to continue"
    )


class _Session(requests.Session):
    """One request and its redirects: checks every address, and sends the token only to the origin of the first."""

    def __init__(self, request: Request, limits: FetchLimits, deadline: float) -> None:
        super().__init__()
        self.asked, self.limits, self.deadline = request, limits, deadline
        self.url = request.url
        self.timeout = limits.timeout
        self.loopback = _is_loopback(urlsplit(request.url).hostname or "")
        self.max_redirects = _MAX_REDIRECTS
        # A proxy cannot reach the loopback interface of this machine.
        self.trust_env = not self.loopback
        # The system's certificates (SSL_CERT_FILE first) if there are any, else those of certifi.
        known = ssl.get_default_verify_paths()
        self.verify = known.cafile or known.capath or True
        self.auth = self._authorise

    def _authorise(self, prepared: requests.PreparedRequest) -> requests.PreparedRequest:
        """Adds only the token. Without an `auth` argument, requests would read ~/.netrc."""
        if self.asked.token is not None:
            prepared.headers["Authorization"] = self.asked.token
        return prepared

    def send(self, request: requests.PreparedRequest, **settings: Any) -> requests.Response:
        """Called once for every address of the chain of redirects."""
        self.url = str(request.url)
        check_url(self.url, self.asked.what, loopback=self.loopback)
        self.timeout = max(0.01, min(self.limits.timeout, self.deadline - time.monotonic()))
        return super().send(request, **{**settings, "timeout": self.timeout})

    def get_redirect_target(self, resp: requests.Response) -> str | None:
        if resp.is_redirect:
            resp.close()  # otherwise requests would read the whole body, without a limit
        return super().get_redirect_target(resp)

    def rebuild_auth(self, prepared_request: requests.PreparedRequest, response: requests.Response) -> None:
        if _origin(str(prepared_request.url)) != _origin(self.asked.url):
            prepared_request.headers.pop("Authorization", None)


@contextlib.contextmanager
def open_answer(
    request: Request, headers: Mapping[str, str], limits: FetchLimits, deadline: float, passed: tuple[int, ...] = ()
) -> Iterator[requests.Response]:
    """The answer (2xx, or a status in ``passed``) after all redirects; its body is not read yet.

    Raises:
        HttpError: any other status.
        CutError: no connection, or no answer in time.
    """
    check_url(request.url, request.what)
    sent = {"User-Agent": f"avs3d-bench/{__version__}", "Accept": "*/*", "Accept-Encoding": "identity", **headers}
    with _Session(request, limits, deadline) as session:
        try:
            method = "GET" if request.body is None else "POST"
            answer = session.request(method, request.url, headers=sent, json=request.body, stream=True)
        except requests.TooManyRedirects:
            raise HttpError(
                f"{request.what}: {request.service} redirects more than {_MAX_REDIRECTS} times; report it there", 310
            ) from None
        except ValueError:  # requests' InvalidURL, InvalidHeader, …: their text may quote the token
            raise Avs3dError(
                f"{request.what}: {_shown(session.url)} is not a valid address; report it to {request.service}"
            ) from None
        except (OSError, urllib3.exceptions.HTTPError) as error:  # the exceptions of requests are OSErrors
            raise _no_answer(request, session.url, error, session.timeout) from None
        with answer:
            if not (200 <= answer.status_code < 300 or answer.status_code in passed):
                raise _refusal(request, answer)
            yield answer


def read_block(answer: requests.Response, request: Request, deadline: float) -> bytes:
    """The next bytes, as they were sent; empty at the end."""
    if time.monotonic() > deadline:
        raise interrupted(request, "the transfer took longer than allowed (see --max-time)")
    try:
        return bytes(answer.raw.read1(_CHUNK, decode_content=False))
    except urllib3.exceptions.ReadTimeoutError:
        raise interrupted(request, f"{request.service} sent nothing for too long (see --timeout)") from None
    except (OSError, urllib3.exceptions.HTTPError, ValueError) as error:
        cause = _cause(error)
        if isinstance(cause, urllib3.exceptions.IncompleteRead):
            return b""  # fewer bytes than Content-Length: reported by the callers, which know the bytes received before
        raise interrupted(request, f"the connection was cut ({_words(cause)})") from None


class _BusyError(HttpError):
    """A temporary refusal; ``wait`` in seconds if the server gives it."""

    def __init__(self, message: str, status: int, wait: float | None) -> None:
        super().__init__(message, status)
        self.wait = wait


def _refusal(request: Request, answer: requests.Response) -> HttpError:
    status = answer.status_code
    if status in (301, 302, 303, 307, 308):
        return HttpError(f"{request.what}: {request.service} redirects without an address (HTTP {status})", status)
    known = {
        401: "it requires a valid token",
        403: "access is not allowed",
        404: "not found",
        410: "no longer available",
        429: "too many requests",
    }
    cause = known.get(status) or ("server error" if status >= 500 else http.client.responses.get(status, "?"))
    advice = request.advice.get(status)
    if advice is None:
        advice = "try again later" if status in _PASSING else "check the id and what your account may do"
    message = f"{request.what}: {request.service} answered {status}: {cause}; {advice}"
    if status in _PASSING:
        return _BusyError(message, status, retry_after(answer.headers.get("Retry-After")))
    return HttpError(message, status)


def retry_after(value: str | None) -> float | None:
    """Seconds that a Retry-After header asks for (a number, or a date); None if it is not valid."""
    with contextlib.suppress(urllib3.exceptions.InvalidHeader, ValueError, OverflowError):
        return None if value is None else float(Retry(retry_after_max=_LONGEST).parse_retry_after(value))
    return None


def attempts(
    request: Request, limits: FetchLimits, say: Say, deadline: float
) -> Iterator[contextlib.AbstractContextManager[None]]:
    """Yield one context per attempt: each catches a temporary failure and waits; the last one raises it."""
    for number in range(1, limits.attempts + 1):
        yield _attempt(request, limits, say, deadline, number)


@contextlib.contextmanager
def _attempt(request: Request, limits: FetchLimits, say: Say, deadline: float, number: int) -> Iterator[None]:
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
    cause = _cause(error)
    if isinstance(cause, TimeoutError):
        return CutError(f"{request.what}: {host} did not answer within {timeout:g} s; try again later (see --timeout)")
    if isinstance(cause, socket.gaierror):
        return Avs3dError(f"{request.what}: no address of {host} is known ({_words(cause)}); check the network")
    if isinstance(cause, ssl.SSLCertVerificationError):
        return Avs3dError(
            f"{request.what}: the certificate of {host} is not valid ({cause.verify_message}); not fetched"
        )
    return CutError(f"{request.what}: no connection to {host} ({_words(cause)}); check the network or the proxy")


def _cause(error: BaseException) -> BaseException:
    """The operating system's error, which requests and urllib3 wrap up to four times."""
    for _ in range(8):
        below = (error.__cause__, getattr(error, "reason", None), *error.args)
        inner = next((each for each in below if isinstance(each, BaseException)), None)
        if inner is None:
            break
        error = inner
    return error


def _words(error: BaseException) -> str:
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(text).split())[:120]


def _shown(url: str) -> str:
    """An address for messages: without its query, which may contain signatures and keys."""
    try:
        parts = urlsplit(url)
        shown = f"{parts.scheme}://{parts.hostname or ''}{f':{parts.port}' if parts.port else ''}{parts.path}"
    except ValueError:
        shown = url.partition("?")[0].rpartition("@")[2]
    return "".join(letter if letter.isprintable() else "?" for letter in shown)[:200]


def _origin(url: str) -> tuple[str, str, int]:
    parts = urlsplit(url)
    return parts.scheme, (parts.hostname or "").lower(), parts.port or {"https": 443, "http": 80}.get(parts.scheme, 0)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False
