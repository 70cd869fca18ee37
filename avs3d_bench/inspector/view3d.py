"""An observation in three dimensions, in the browser: `avs3d view-3d`, drawn with viser.

viser and not rerun, after serving and recording with both (viser 1.1, rerun-sdk 0.41; see docs/inspector.md):

- viser listens on a given address, here the loopback address only; rerun's `serve_grpc` and `serve_web_viewer`
  listen on all interfaces, and take no address.
- A recording of viser is one HTML file with its viewer inside, which any browser opens from disk, without a network
  and without viser; its bytes are the same on every run. A .rrd needs rerun's viewer, and differs every time.
- A fresh environment takes 180 MB with viser and 790 MB with rerun, which brings Arrow and a native viewer.

rerun has timelines in its data model. Here a slider and a play button move the camera and the source; in a
recording, which has no controls but viser's own bar, they move by themselves.

The world is the dataset's: metres, Y up. viser's cameras look along +Z with Y down, as OpenCV's do.
"""

from __future__ import annotations

import contextlib
import errno
import io
import re
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from avs3d_bench.commands.outputs import DRAWN_BY
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.files import atomic_path
from avs3d_bench.inspector.view3d_data import Scene3D, read_scene
from avs3d_bench.inspector.view3d_stage import ViserScene, legend
from avs3d_bench.runtime.imports import needing
from avs3d_bench.text.templates import words

if TYPE_CHECKING:
    from types import ModuleType

HOST = "127.0.0.1"
#: Seconds that a frame of a recording lasts: quicker than it was walked.
STEP_SECONDS = 0.4
_TITLE = re.compile(r"<title>[^<]*</title>")


def load_viser() -> ModuleType:
    """Viser.

    Raises:
        Avs3dError: if it is not installed.
    """
    with needing("avs3d view-3d", "pip install 'avs3d-bench[inspect]'"):
        import viser
    return viser


def save_view(
    dataset: Dataset,
    key: str,
    path: str | Path,
    submissions: Sequence[str | Path] = (),
    *,
    tell: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write a recording: ``.html`` (one file that any browser opens) or ``.viser`` (for a viser server).

    No browser is opened. viser builds scenes in a server; it listens on a free port of the loopback address for the
    seconds that this takes. ``tell`` is called with what is being done.

    Raises:
        UsageError: if there is no such observation or submission, or the name ends otherwise.
        Avs3dError: if viser is missing, a file is damaged, or the system refuses.
    """
    target = Path(path)
    if target.suffix not in (".html", ".viser"):
        raise UsageError(f"{target}: expected a name that ends with .html (opens in any browser) or .viser")
    if target.is_dir():
        raise UsageError(f"{target}: found a folder, expected the name of a file")
    viser = load_viser()
    tell("reading the scene")
    scene = read_scene(dataset[key], submissions)
    tell("building the scene")
    with atomic_path(target) as temporary, _serving(viser, 0) as server:
        stage = ViserScene(server, scene)
        stage.build()
        recorder = server.get_scene_serializer()
        for number in range(len(scene.frames)):
            tell(f"recording frame {number + 1} of {len(scene.frames)}")
            stage.show(number)
            recorder.insert_sleep(STEP_SECONDS)
        tell("compressing the recording")
        if target.suffix == ".html":
            temporary.write_text(_titled(recorder.as_html(), scene), encoding="utf-8")
        else:
            temporary.write_bytes(recorder.serialize())
    return target


def serve_view(
    dataset: Dataset,
    key: str,
    submissions: Sequence[str | Path] = (),
    *,
    port: int = 8080,
    ready: Callable[[str], None] | None = None,
) -> NoReturn:
    """Serve the scene on the loopback address until the process is interrupted.

    Args:
        dataset: where the observation is.
        key: of the observation.
        submissions: folders of predictions with points.
        port: 0 takes a free one.
        ready: called with the address once it can be opened.

    Raises:
        UsageError: if there is no such observation or submission, or the port is taken.
        Avs3dError: if viser is missing, or a file is damaged.
    """
    viser = load_viser()
    scene = read_scene(dataset[key], submissions)
    with _serving(viser, port) as server:
        stage = ViserScene(server, scene)
        stage.build()
        controls = Controls(server, stage)
        stage.show(0)
        if ready is not None:
            ready(f"http://{HOST}:{server.get_port()}")
        while True:
            time.sleep(1.0)
            controls.tick()


@contextlib.contextmanager
def _serving(viser: ModuleType, port: int) -> Iterator[Any]:
    """A viser server on the loopback address, without its banner and its tunnel to the outside."""
    if port:
        # viser would quietly take the next free port.
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError as error:
                why = "is taken" if error.errno == errno.EADDRINUSE else f"cannot be used: {error.strerror}"
                raise UsageError(f"port {port} {why}; choose another with --port, or 0 for any free one") from None
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=HOST, port=port, verbose=False)
    server.request_share_url = _no_sharing
    try:
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _no_sharing(*_: object, **__: object) -> None:
    """Replaces viser's tunnel to an external server: nothing leaves this computer."""


def room_note(scene: Scene3D, *, recorded: bool = False) -> str:
    """One or two sentences for the page: what the room is drawn from.

    Args:
        scene: what is shown.
        recorded: the page has no switches.
    """
    if scene.surfaces:
        note = "The room: pictures of some frames on patches around sparse points; the dataset holds no mesh of it."
        points = " Points from the depth of some frames can be switched on."
        return note + (points if scene.dense is not None and not recorded else "")
    if scene.dense is not None:
        return "The room: points from the depth of some frames; the dataset holds no mesh of it."
    return "The room: sparse points. A dataset generated with `--with depth` has dense ones."


def scene_title(scene: Scene3D) -> str:
    """The sounding sources in words, and the observation's key."""
    what = scene.lanes.title if scene.lanes is not None else words(scene.category) if scene.category else ""
    return f"{what[:1].upper()}{what[1:]} · {scene.key}" if what else scene.key


def legend_html(scene: Scene3D) -> str:
    """The legend as a list."""
    rows = "".join(
        f'<li style="display:flex;gap:.5em;align-items:baseline"><i style="flex:none;width:.7em;height:.7em;'
        f'border-radius:50%;background:rgb{colour};outline:1px solid #0006"></i>{escape(text)}</li>'
        for colour, text in legend(scene)
    )
    return f'<ul style="list-style:none;margin:0;padding:0;overflow-wrap:anywhere">{rows}</ul>'


def _titled(page: str, scene: Scene3D) -> str:
    """A recording with its title, and a panel that says what it shows: viser's own has neither."""
    title = escape(scene_title(scene))
    panel = (
        '<details open style="position:fixed;left:12px;top:12px;z-index:9;width:19em;max-width:calc(100vw - 24px);'
        "box-sizing:border-box;padding:.7em .9em;border-radius:6px;background:#fffffff0;color:#1c1b19;"
        "box-shadow:0 1px 6px #0003;font:14px/1.45 'Helvetica Neue','Segoe UI',Roboto,Arial,sans-serif\">"
        f'<summary style="cursor:pointer;font-weight:600;overflow-wrap:anywhere">{title}</summary>'
        f'<p style="margin:.5em 0">{escape(room_note(scene, recorded=True))}</p>{legend_html(scene)}</details>'
    )
    # The generator is what a rerun knows its own recording by.
    heading = f'<meta name="generator" content="{DRAWN_BY} view-3d"><title>{title}</title>'
    page, named = _TITLE.subn(lambda _: heading, page, count=1)
    head, body, rest = page.rpartition("<body>")
    return f"{'' if named else heading}{head}{body}{panel}{rest}"


class Controls:
    """Slider, play button and switches of the layers, for a scene that is served."""

    def __init__(self, server: Any, stage: ViserScene) -> None:
        """Add them to the page."""
        server.gui.configure_theme(show_share_button=False, show_logo=False)
        server.gui.set_panel_label("avs3d view-3d")
        frames = stage.scene.frames
        server.gui.add_html(f'<p style="margin:0 1em;font-weight:600">{escape(scene_title(stage.scene))}</p>')
        server.gui.add_markdown(room_note(stage.scene))
        server.gui.add_html(f'<div style="margin:0 1em;font-size:.875em">{legend_html(stage.scene)}</div>')
        caption = server.gui.add_markdown(frames[0].caption)
        self._slider = server.gui.add_slider("frame", 0, max(1, len(frames) - 1), 1, 0)
        self._playing = server.gui.add_checkbox("play", False)
        self._last = len(frames) - 1

        @self._slider.on_update  # type: ignore[untyped-decorator]
        def _(_: object) -> None:
            number = min(int(self._slider.value), self._last)
            caption.content = frames[number].caption
            stage.show(number)

        with server.gui.add_folder("shown"):
            for name, handles in stage.layers.items():
                self._switch(server, name, handles)

    def tick(self) -> None:
        """A second has passed."""
        if self._playing.value:
            self._slider.value = (int(self._slider.value) + 1) % (self._last + 1)

    @staticmethod
    def _switch(server: Any, name: str, handles: list[Any]) -> None:
        box = server.gui.add_checkbox(name, handles[0].visible)

        @box.on_update  # type: ignore[untyped-decorator]
        def _(_: object) -> None:
            for handle in handles:
                handle.visible = box.value
