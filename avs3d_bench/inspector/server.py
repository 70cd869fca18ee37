"""The site on demand: a server for this computer alone that makes each file when it is asked for.

It listens on the loopback address and answers only requests that name it as their host, so that no page of the web
can read from it under a name of its own (DNS rebinding). The dataset is never written to.
"""

from __future__ import annotations

import re
import socket
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self
from urllib.parse import unquote, urlsplit

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import os_error_line
from avs3d_bench.inspector.live import LiveSite
from avs3d_bench.inspector.site import PAGE, DamagedError, NotThereError, media_type
from avs3d_bench.inspector.submissions import ShownSubmission

HOST = "127.0.0.1"
#: The port that is tried first, so that an address can be bookmarked.
DEFAULT_PORT = 8737
POLICY = (
    "default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
#: Headers of every answer, for any status.
HEADERS = (
    # The next server on this port may show another dataset, or a new version of the same submission.
    ("Cache-Control", "no-cache"),
    ("Content-Security-Policy", POLICY),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
)
#: Most connections at a time, each with a thread: browsers open six to a server.
MOST_CONNECTIONS = 64
#: Longest time that a connection waits for the whole head of its next request, or for its answer to be taken (s).
WAITING_SECONDS = 60.0
#: Time that a waiting connection gets to end when its place is needed (s).
_ENDING_SECONDS = 1.0
_FULL_TEXT = "too many connections\n"
_FULL = "\r\n".join(
    [
        "HTTP/1.1 503 Service Unavailable",
        "Content-Type: text/plain; charset=utf-8",
        f"Content-Length: {len(_FULL_TEXT)}",
        "Retry-After: 1",
        "Connection: close",
        *(f"{name}: {value}" for name, value in HEADERS),
        "",
        _FULL_TEXT,
    ]
).encode()
#: More digits than any file has bytes are no range.
_RANGE = re.compile(r"bytes=([0-9]{0,18})-([0-9]{0,18})")


@dataclass
class _Connection:
    """A connection's thread, and since when it has waited for a request (s); None while one is answered."""

    thread: threading.Thread
    waiting: float | None


class _Server(ThreadingHTTPServer):
    # Two servers on one port would share its requests.
    allow_reuse_port = False
    #: How often `serve` looks whether it shall end (s).
    timeout = 0.1

    def __init__(self, port: int, site: LiveSite) -> None:
        self.site = site
        self.ending = False
        self._lock = threading.Lock()
        self._open: dict[socket.socket, _Connection] = {}
        super().__init__((HOST, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, which is remembered with its connection: browsers keep theirs open.

        With `MOST_CONNECTIONS` the one that has waited longest is closed; if all are being answered, the new one is
        refused.
        """
        if not self._make_room():
            with suppress(OSError):
                request.settimeout(_ENDING_SECONDS)
                request.sendall(_FULL)
            super().shutdown_request(request)
            return
        # No daemon: the interpreter aborts when it ends beneath OpenCV's C++.
        thread = threading.Thread(target=self.process_request_thread, args=(request, client_address), daemon=False)
        with self._lock:
            self._open[request] = _Connection(thread, time.monotonic())
        thread.start()

    def _make_room(self) -> bool:
        with self._lock:
            if len(self._open) < MOST_CONNECTIONS:
                return True
            waiting = [(one.waiting, request) for request, one in self._open.items() if one.waiting is not None]
            if not waiting:
                return False
            _, request = min(waiting, key=lambda pair: pair[0])
            thread = self._open[request].thread
        _cut(request)
        thread.join(_ENDING_SECONDS)
        return not thread.is_alive()

    def note(self, request: Any, *, waiting: bool) -> None:
        """Remember whether a connection waits for a request, or one is being answered."""
        with self._lock:
            if request in self._open:
                self._open[request].waiting = time.monotonic() if waiting else None

    def drop_slow(self) -> None:
        """Close the connections that have waited too long for the whole head of a request."""
        with self._lock:
            end = time.monotonic() - WAITING_SECONDS
            late = [request for request, one in self._open.items() if one.waiting is not None and one.waiting < end]
        for request in late:
            _cut(request)

    def shutdown_request(self, request: Any) -> None:
        """The connection has ended."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def hang_up(self, seconds: float | None) -> bool:
        """Close the port and every connection, and wait for requests in progress.

        Args:
            seconds: how long; None waits for as long as it takes.

        Returns:
            Whether all of them ended.
        """
        self.ending = True
        # Before the others, so that none can follow.
        self.socket.close()
        with self._lock:
            threads = {request: one.thread for request, one in self._open.items()}
        for request in threads:
            _cut(request)
        end = None if seconds is None else time.monotonic() + seconds
        for thread in threads.values():
            with suppress(RuntimeError):  # never started: there was no memory for it
                thread.join(None if end is None else max(0.0, end - time.monotonic()))
        return not any(thread.is_alive() for thread in threads.values())

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle of an answer is no error, nor is one that was cut off."""
        if not self.ending and not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


def _cut(request: socket.socket) -> None:
    """End a connection; its thread closes it."""
    with suppress(OSError):
        request.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "avs3d-view", ""
    timeout = WAITING_SECONDS
    server: _Server

    def handle_one_request(self) -> None:
        """Wait for a request and answer it."""
        self.server.note(self.connection, waiting=True)
        super().handle_one_request()

    def parse_request(self) -> bool:
        """Read the head of a request; nothing here can be changed."""
        if not super().parse_request():
            return False
        self.server.note(self.connection, waiting=False)
        if self.command in ("GET", "HEAD"):
            return True
        # What the request brings is not read: it must not be taken for the next one.
        self.close_connection = True
        self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, "expected GET or HEAD")
        return False

    def do_GET(self) -> None:
        """Answer with a file of the site."""
        port = self.server.server_address[1]
        if self.headers.get_all("Host", []) not in ([f"{HOST}:{port}"], [f"localhost:{port}"]):
            self._refuse(HTTPStatus.FORBIDDEN, f"this server answers to http://{HOST}:{port}/ only")
            return
        try:
            path = unquote(urlsplit(self.path).path)
        except ValueError:  # http://[/
            path = ""
        if not path.startswith("/"):
            self._refuse(HTTPStatus.BAD_REQUEST, "expected a path")
            return
        address = path[1:] + (PAGE if path.endswith("/") else "")
        try:
            data = self.server.site.read(address)
        except NotThereError as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))
        except DamagedError as error:
            if error.page is None:
                self._refuse(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
            else:
                self._answer(HTTPStatus.UNPROCESSABLE_ENTITY, media_type(PAGE), error.page, None)
        except Exception as error:
            line = str(error) if isinstance(error, Avs3dError) else "internal error; the terminal has more"
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, line)
            if not isinstance(error, Avs3dError):
                raise
        else:
            self._send(address, data)

    def do_HEAD(self) -> None:
        """The same without the file."""
        self.do_GET()

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer a broken request with a line of plain text."""
        self.close_connection = True
        self._refuse(HTTPStatus(code), message or HTTPStatus(code).phrase)

    def _send(self, address: str, data: bytes) -> None:
        first, last, status = 0, len(data) - 1, HTTPStatus.OK
        asked = self.headers.get("Range")
        # Several ranges at once may be answered with the whole.
        match = _RANGE.fullmatch(asked.strip()) if asked else None
        if match and any(match.groups()):
            begin, end = match.groups()
            first = int(begin) if begin else max(0, len(data) - int(end))
            last = min(len(data) - 1, int(end)) if begin and end else len(data) - 1
            if first >= len(data) or (begin and end and int(end) < first) or (not begin and int(end) == 0):
                self._answer(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, "text/plain", b"", f"bytes */{len(data)}")
                return
            status = HTTPStatus.PARTIAL_CONTENT
        where = f"bytes {first}-{last}/{len(data)}" if status is HTTPStatus.PARTIAL_CONTENT else None
        self._answer(status, media_type(address), data[first : last + 1], where)

    def _refuse(self, status: HTTPStatus, line: str) -> None:
        self._answer(status, "text/plain; charset=utf-8", f"{line}\n".encode("utf-8", "replace"), None)

    def _answer(self, status: HTTPStatus, kind: str, body: bytes, content_range: str | None) -> None:
        if self.request_version == "HTTP/0.9":  # also that of a line without a version: it would have no headers
            self.request_version = "HTTP/1.0"
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        if content_range:
            self.send_header("Content-Range", content_range)
        if status in (HTTPStatus.OK, HTTPStatus.PARTIAL_CONTENT):
            self.send_header("Accept-Ranges", "bytes")
        if status is HTTPStatus.METHOD_NOT_ALLOWED:
            self.send_header("Allow", "GET, HEAD")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def end_headers(self) -> None:
        """No answer is without these."""
        for name, value in HEADERS:
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not worth a line each."""


class ViewServer:
    """A context in which the site is served; `url` is its address.

    with ViewServer(dataset, dataset.keys) as server:
        server.serve()
    """

    def __init__(
        self,
        dataset: Dataset,
        keys: Sequence[str],
        submissions: tuple[ShownSubmission, ...] = (),
        *,
        port: int | None = None,
    ) -> None:
        """Nothing is opened yet; without ``port`` the usual one, or any that is free."""
        self._dataset, self._keys, self._submissions, self._port = dataset, keys, submissions, port
        self._site: LiveSite | None = None
        self._server: _Server | None = None

    def __enter__(self) -> Self:
        """Open the port.

        Raises:
            UsageError: if it is taken.
        """
        self._site = LiveSite(self._dataset, self._keys, self._submissions)
        try:
            try:
                self._server = _Server(DEFAULT_PORT if self._port is None else self._port, self._site)
            except OSError:
                if self._port is not None:
                    raise
                self._server = _Server(0, self._site)
        except OSError as error:
            self._site.close()
            line = os_error_line(error, f"{HOST}:{self._port}", "listen there")
            raise UsageError(f"{line}; choose another --port") from None
        return self

    @property
    def server(self) -> _Server:
        """The server; open inside of the ``with`` block only."""
        if self._server is None:
            raise UsageError("the server is not open; use `with ViewServer(…) as server:`")
        return self._server

    @property
    def url(self) -> str:
        """Its address."""
        return f"http://{HOST}:{self.server.server_address[1]}/"

    def serve(self) -> None:
        """Answer until `stop` is called."""
        while not self.server.ending:
            self.server.handle_request()
            self.server.drop_slow()

    def stop(self) -> None:
        """End `serve` within `_Server.timeout`; may be called from any thread and from a signal handler."""
        self.server.ending = True

    def close(self, seconds: float | None = None) -> bool:
        """Close the connections, and wait for requests in progress, for ``seconds`` or as long as it takes.

        Returns:
            Whether all of them ended. Of those that did not, threads go on.
        """
        ended = self._server is None or self._server.hang_up(seconds)
        if self._site is not None and ended:
            self._site.close()
        return ended

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
