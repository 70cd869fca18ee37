"""A local web server that answers like each collection, and injects errors on request."""

from __future__ import annotations

import io
import json
import threading
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import soundfile
import trimesh

TOKEN = "s3cret-token-of-the-user"
UID = "0123456789abcdef0123456789abcdef"


@dataclass
class Call:
    """A request as it came."""

    method: str
    path: str
    query: str
    headers: dict[str, str]
    body: bytes


@dataclass
class Reply:
    """What to answer.

    ``cut``: bytes after which the connection is closed, though Content-Length promises more. ``ranges``: honour Range.
    ``hang``: seconds before anything is sent. ``drip``: seconds between blocks of ``block`` bytes.
    """

    body: bytes = b""
    status: int = 200
    headers: dict[str, str] = field(default_factory=dict)
    cut: int | None = None
    ranges: bool = False
    hang: float = 0.0
    drip: float = 0.0
    block: int = 1
    length: bool = True


Route = Callable[[Call], Reply]


class Server:
    """Routes by path; every request is written down in ``calls``."""

    def __init__(self) -> None:
        self.routes: dict[str, Route] = {}
        self.calls: list[Call] = []
        self.stopping = threading.Event()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_args: Any) -> None:
                pass

            def _serve(self) -> None:
                parts = urlsplit(self.path)
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                headers = {name.lower(): value for name, value in self.headers.items()}
                call = Call(self.command, parts.path, parts.query, headers, body)
                outer.calls.append(call)
                route = outer.routes.get(parts.path)
                outer._send(self, call, route(call) if route else Reply(b"{}", 404))

            do_GET = do_POST = _serve  # noqa: N815  # the names that http.server looks for

        self.httpd = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.httpd.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.httpd.server_port}"
        self.elsewhere = f"http://localhost:{self.httpd.server_port}"  # another host, as far as tokens are concerned

    def _send(self, handler: BaseHTTPRequestHandler, call: Call, reply: Reply) -> None:
        self.stopping.wait(reply.hang)
        body, status, headers = reply.body, reply.status, dict(reply.headers)
        asked = call.headers.get("range")
        if asked and reply.ranges and status == 200:
            validators = {headers.get("ETag"), headers.get("Last-Modified")}
            if call.headers.get("if-range") in validators:
                start = int(asked.removeprefix("bytes=").rstrip("-"))
                if start >= len(body):
                    status, headers["Content-Range"], body = 416, f"bytes */{len(body)}", b""
                else:
                    status, headers["Content-Range"] = 206, f"bytes {start}-{len(body) - 1}/{len(body)}"
                    body = body[start:]
        try:
            handler.send_response(status)
            for name, value in headers.items():
                handler.send_header(name, value)
            if reply.length:
                handler.send_header("Content-Length", str(len(body)))
            else:
                handler.close_connection = True
            handler.end_headers()
            if reply.drip:
                for index in range(0, len(body), reply.block):
                    handler.wfile.write(body[index : index + reply.block])
                    handler.wfile.flush()
                    if self.stopping.wait(reply.drip):
                        break
            else:
                handler.wfile.write(body if reply.cut is None else body[: reply.cut])
                handler.wfile.flush()
            if reply.cut is not None:
                handler.close_connection = True
        except OSError:
            handler.close_connection = True

    def on(self, path: str, *replies: Reply | Route) -> None:
        """Answer ``path`` with the replies in turn; the last one stays."""
        queue = list(replies)

        def route(call: Call) -> Reply:
            reply = queue.pop(0) if len(queue) > 1 else queue[0]
            return reply(call) if callable(reply) else reply

        self.routes[path] = route

    def to(self, path: str) -> list[Call]:
        """The requests for ``path``."""
        return [call for call in self.calls if call.path == path]


@contextmanager
def serving() -> Iterator[Server]:
    server = Server()
    thread = threading.Thread(target=server.httpd.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stopping.set()
        server.httpd.shutdown()
        server.httpd.server_close()
        thread.join()


def json_reply(document: Any, **changes: Any) -> Reply:
    return Reply(json.dumps(document).encode(), headers={"Content-Type": "application/json"}, **changes)


# ---- files worth fetching -------------------------------------------------------------------------------------------


def wav(seconds: float = 1.0, kind: str = "WAV") -> bytes:
    """A chirp."""
    t = np.arange(round(seconds * 22050)) / 22050
    buffer = io.BytesIO()
    soundfile.write(buffer, 0.3 * np.sin(2 * np.pi * (200 + 300 * t) * t), 22050, format=kind)
    return buffer.getvalue()


def box(colour: tuple[int, int, int] = (200, 60, 40)) -> trimesh.Trimesh:
    """A box of 0.4 × 0.3 × 0.25 m."""
    mesh = trimesh.creation.box(extents=(0.4, 0.3, 0.25))
    mesh.visual.face_colors = np.tile((*colour, 255), (len(mesh.faces), 1))
    return mesh


def glb() -> bytes:
    return bytes(trimesh.Scene([box()]).export(file_type="glb"))


def gltf_zip() -> bytes:
    """What Sketchfab delivers as ``gltf``."""
    files = trimesh.Scene([box()]).export(file_type="gltf")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr("scene.gltf" if name == "model.gltf" else name, data)
        archive.writestr("license.txt", "CC-BY-4.0")
    return buffer.getvalue()


def bomb(megabytes: int = 40) -> bytes:
    """A zip archive of zeros: a thousandth of what it unpacks to."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("scene.gltf", "{}")
        archive.writestr("scene.bin", bytes(megabytes * 1_000_000))
    return buffer.getvalue()


# ---- collections ----------------------------------------------------------------------------------------------------


def sketchfab(server: Server, *, slug: str = "by", label: str = "CC Attribution", **changes: Any) -> None:
    """Sketchfab with one model; its storage lies on another host and wants the signature of the address."""
    about = {
        "uid": UID,
        "name": "Red box",
        "user": {"displayName": "A. Maker", "username": "maker"},
        "license": {"slug": slug, "label": label, "url": "http://creativecommons.org/licenses/by/4.0/"},
        "viewerUrl": f"https://sketchfab.com/3d-models/red-box-{UID}",
        "isDownloadable": True,
    } | changes
    server.on(f"/v3/models/{UID}", _guarded(json_reply(about)))
    offered = {
        "gltf": {"url": f"{server.elsewhere}/store/model.zip?signature=abc", "size": 1, "expires": 300},
        "glb": {"url": f"{server.elsewhere}/store/model.glb?signature=abc", "size": 1, "expires": 300},
    }
    server.on(f"/v3/models/{UID}/download", _guarded(json_reply(offered)))
    server.on("/store/model.glb", Reply(glb(), headers={"ETag": '"1"'}, ranges=True))
    server.on("/store/model.zip", Reply(gltf_zip(), headers={"ETag": '"2"'}, ranges=True))


def _guarded(reply: Reply) -> Route:
    def route(call: Call) -> Reply:
        return reply if call.headers.get("authorization") == f"Token {TOKEN}" else json_reply({}, status=401)

    return route


def freesound(server: Server, licence: str = "https://creativecommons.org/licenses/by/4.0/", **changes: Any) -> None:
    """Freesound with sound 1234."""
    about = {
        "id": 1234,
        "url": "https://freesound.org/people/tester/sounds/1234/",
        "name": "old clock.wav",
        "username": "tester",
        "license": licence,
        "type": "wav",
        "filesize": 1,
        "previews": {
            "preview-hq-ogg": f"{server.elsewhere}/previews/1234-hq.ogg",
            "preview-hq-mp3": f"{server.elsewhere}/previews/1234-hq.mp3",
        },
    } | changes
    server.on("/sounds/1234/", _guarded(json_reply(about)))
    server.on("/previews/1234-hq.ogg", Reply(wav(kind="OGG"), headers={"ETag": '"o"'}, ranges=True))

    def original(call: Call) -> Reply:
        return Reply(wav()) if call.headers.get("authorization") == f"Bearer {TOKEN}" else json_reply({}, status=401)

    server.on("/sounds/1234/download/", original)


def bbc(server: Server) -> None:
    """BBC Sound Effects with sound 07005210."""

    def search(call: Call) -> Reply:
        query = json.loads(call.body)["criteria"]["query"]
        results = [{"id": "07005210", "description": "Telephone rings", "duration": 1000.0}]
        return json_reply({"total": 1, "results": results if query == "07005210" else []})

    server.on("/api/sfx/search", search)
    server.on("/wav/07005210.wav", Reply(wav()))
