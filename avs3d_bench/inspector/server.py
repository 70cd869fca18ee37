"""The site on demand: a server for this computer alone that makes each file when it is asked for.

It listens on the loopback address and answers only requests that name it as their host, so that no page of the web
can read from it under a name of its own (DNS rebinding). The dataset is never written to; what takes time to make is
kept in a temporary folder that goes with the server.
"""

from __future__ import annotations

import re
import socket
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import unquote, urlsplit

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.files import os_error_line, read_bytes, sha256_bytes, write_bytes
from avs3d_bench.inspector.pages import gallery_page, observation_page
from avs3d_bench.inspector.site import FLOOR, PAGE, SOUND, THUMBNAIL, NotThereError, ObservationSite, media_type
from avs3d_bench.inspector.site import static_asset as asset
from avs3d_bench.inspector.submissions import ShownSubmission

HOST = "127.0.0.1"
#: What is tried first, so that an address can be bookmarked.
DEFAULT_PORT = 8737
POLICY = (
    "default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
#: Slow to make, or asked for all at once.
_KEPT = (THUMBNAIL, FLOOR, SOUND)
#: More digits than any file has bytes are no range.
_RANGE = re.compile(r"bytes=([0-9]{0,18})-([0-9]{0,18})")


class LiveSite:
    """The files of a site, made when they are asked for; safe to use from several threads."""

    def __init__(
        self, dataset: Dataset, keys: Sequence[str], submissions: tuple[ShownSubmission, ...], cache: Path
    ) -> None:
        """Nothing is read yet; ``cache`` is a folder for what takes time to make."""
        self._dataset, self._keys, self._submissions, self._cache = dataset, list(keys), submissions, cache
        self._sites: dict[str, ObservationSite] = {}
        self._gallery: bytes | None = None
        self._lock = threading.Lock()
        self._busy: dict[str, threading.Lock] = {}

    def read(self, address: str) -> bytes:
        """The file at ``address``, relative to the site.

        Raises:
            NotThereError: if there is none.
            Avs3dError: if it cannot be made.
        """
        if address == PAGE:
            with self._one_at_a_time(PAGE):
                return self._read_gallery()
        folder, _, name = address.partition("/")
        if folder == "assets":
            return asset(name)
        pieces = address.split("/", 4)
        key, name = "/".join(pieces[:4]), pieces[4] if len(pieces) == 5 else ""
        if key not in self._keys or not name:
            raise NotThereError(f"the site has no {address}")
        site = self._site(key)
        if name == PAGE:
            with self._one_at_a_time(key):
                return self._page(key, site)
        if name in _KEPT:
            with self._one_at_a_time(address):
                return self._kept(address, site, name)
        return site.make(name)

    def _one_at_a_time(self, what: str) -> threading.Lock:
        """Two that ask for the same thing at once must not both make it."""
        with self._lock:
            return self._busy.setdefault(what, threading.Lock())

    def _site(self, key: str) -> ObservationSite:
        with self._lock:
            return self._sites.setdefault(key, ObservationSite(self._dataset, key, self._submissions))

    def _read_gallery(self) -> bytes:
        if self._gallery is None:
            cards = [self._site(key).card() for key in self._keys]
            self._gallery = gallery_page(self._dataset, cards, [s.name for s in self._submissions])
        return self._gallery

    def _page(self, key: str, site: ObservationSite) -> bytes:
        at = self._keys.index(key)
        before = self._keys[at - 1] if at else None
        after = self._keys[at + 1] if at + 1 < len(self._keys) else None
        problems = site.facts.problems
        if site.facts.has_sound:
            # The page names the gain of the track, so it has been read: the player's request finds it made.
            self._kept(f"{key}/{SOUND}", site, SOUND)
            problems += site.track.problems
        return observation_page(site, before=before, after=after, linked=True, problems=problems)

    def _kept(self, address: str, site: ObservationSite, name: str) -> bytes:
        path = self._cache / sha256_bytes(address.encode())
        if path.exists():
            return read_bytes(path)
        data = site.make(name)
        write_bytes(path, data)
        if name == SOUND:
            site.forget_sound()
        return data


class _Server(ThreadingHTTPServer):
    # Joined when the server closes: the interpreter aborts when it ends beneath OpenCV's C++.
    daemon_threads = False
    # Two servers on one port would share its requests.
    allow_reuse_port = False

    def __init__(self, port: int, site: LiveSite) -> None:
        self.site = site
        self._open: set[socket.socket] = set()
        super().__init__((HOST, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Remember the connection; browsers keep theirs open."""
        self._open.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """The connection has ended."""
        self._open.discard(request)
        super().shutdown_request(request)

    def server_close(self) -> None:
        """Hang up, and wait for answers in the making."""
        for request in list(self._open):
            with suppress(OSError):
                request.shutdown(socket.SHUT_RDWR)
        super().server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle of an answer is no error."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "avs3d-view", ""
    timeout = 60
    server: _Server

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
        except Avs3dError as error:
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))
        else:
            self._send(address, data)

    def do_HEAD(self) -> None:
        """The same without the file."""
        self.do_GET()

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
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        if content_range:
            self.send_header("Content-Range", content_range)
        self.send_header("Accept-Ranges", "bytes")
        # The next server on this port may show another dataset, or the same submission made anew.
        self.send_header("Cache-Control", "no-cache")
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
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
        self._cache: tempfile.TemporaryDirectory[str] | None = None
        self._server: _Server | None = None

    def __enter__(self) -> Self:
        """Open the port.

        Raises:
            UsageError: if it is taken.
        """
        self._cache = tempfile.TemporaryDirectory(prefix="avs3d-view-")
        site = LiveSite(self._dataset, self._keys, self._submissions, Path(self._cache.name))
        try:
            try:
                self._server = _Server(DEFAULT_PORT if self._port is None else self._port, site)
            except OSError:
                if self._port is not None:
                    raise
                self._server = _Server(0, site)
        except OSError as error:
            self._cache.cleanup()
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
        """Answer until `stop` is called (from another thread) or the process is interrupted."""
        self.server.serve_forever(poll_interval=0.2)

    def stop(self) -> None:
        """End `serve`."""
        self.server.shutdown()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.server_close()
        if self._cache is not None:
            self._cache.cleanup()
