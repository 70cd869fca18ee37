"""The process that renders with habitat-sim, in an interpreter of its own; run by generators/vision/habitat.py.

This file needs Python 3.8 or newer, numpy and habitat_sim, nothing of this package. It is spoken to over its
standard input and output. A message is the length of its header (4 bytes, little-endian), the header (JSON, UTF-8), and
the raw bytes of the arrays that the header's ``arrays`` list describes (name, dtype, shape; C order), one after the
other. Every request has a ``command`` and gets one answer, which has ``ok``: true, or false with an ``error``.

    hello       version of habitat_sim and of Python
    open        load a stage and objects, set up the camera
    render      colour, depth and ids from a pose
    navmesh     compute the navigation mesh of the stage
    navigable   which points (N, 3) lie on it
    close       drop the scene

The process ends with its input. The folder that a request names goes with it: a parent that was killed cannot remove
it.

habitat-sim and the graphics driver print to file descriptor 1 as they please; it is made a copy of standard error
before either is loaded, and answers go out through a duplicate of the original.
"""

from __future__ import annotations

import importlib
import json
import os
import shutil
import signal
import struct
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from types import ModuleType
from typing import IO, Any

import numpy as np

PROTOCOL = 1
#: Seconds between two looks at whether the parent is still there.
WATCH = 0.5
#: Longest header that is believed, bytes.
MAX_HEADER = 1 << 24


class Channel:
    """Messages over two binary streams."""

    def __init__(self, reader: IO[bytes], writer: IO[bytes]) -> None:
        self.reader, self.writer = reader, writer

    def receive(self) -> tuple[dict[str, Any] | None, dict[str, Any]]:
        """The next header and its arrays by name; (None, {}) when the other side has gone."""
        prefix = self.reader.read(4)
        if not prefix:
            return None, {}
        (length,) = struct.unpack("<I", prefix + self._exactly(4 - len(prefix)))
        if length > MAX_HEADER:
            raise ValueError(f"a header of {length} bytes: this is no message")
        header = json.loads(self._exactly(length).decode("utf-8"))
        arrays = {}
        for item in header.get("arrays", ()):
            kind = np.dtype(item["dtype"])
            count = int(np.prod(item["shape"], dtype=np.int64))
            data = np.frombuffer(self._exactly(count * kind.itemsize), dtype=kind)
            arrays[item["name"]] = data.reshape(item["shape"]).copy()
        return header, arrays

    def _exactly(self, count: int) -> bytes:
        data = self.reader.read(count)
        if len(data) < count:
            raise ValueError(f"the other side broke off after {len(data)} of {count} bytes")
        return data

    def send(self, header: dict[str, Any], arrays: Sequence[tuple[str, Any]] = ()) -> None:
        """Send a header and (name, array) pairs."""
        whole = [(name, np.ascontiguousarray(array)) for name, array in arrays]
        header = dict(header)
        header["arrays"] = [
            {"name": name, "dtype": array.dtype.str, "shape": list(array.shape)} for name, array in whole
        ]
        text = json.dumps(header).encode("utf-8")
        self.writer.write(struct.pack("<I", len(text)) + text)
        for _, array in whole:
            self.writer.write(array.tobytes())
        self.writer.flush()


def _habitat_sim() -> ModuleType:
    """habitat_sim, loaded when it is first needed: that it is missing is an answer, too."""
    return importlib.import_module("habitat_sim")


def _set_known(thing: Any, values: dict[str, Any]) -> None:
    """Set those attributes that this version of habitat-sim has."""
    for name, value in values.items():
        if hasattr(thing, name):
            setattr(thing, name, value)


class Display:
    """Supersampled 8-bit sRGB to one value per pixel: the mean of the light, encoded again."""

    ENTRIES = 65536

    def __init__(self, factor: int) -> None:
        level = np.arange(256) / 255.0
        light = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
        self.decode = light.astype(np.float32)
        x = np.linspace(0.0, 1.0, self.ENTRIES)
        value = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
        self.encode = np.rint(255.0 * value).astype(np.uint8)
        self.factor = factor

    def shrink(self, pixels: Any) -> Any:
        """(H·f, W·f, 3) uint8 to (H, W, 3) uint8."""
        f = self.factor
        if f == 1:
            return np.ascontiguousarray(pixels)
        total = np.zeros((pixels.shape[0] // f, pixels.shape[1] // f, 3), dtype=np.float32)
        for row in range(f):
            for column in range(f):
                total += self.decode[pixels[row::f, column::f]]
        index = (total * np.float32((self.ENTRIES - 1) / (f * f)) + np.float32(0.5)).astype(np.int32)
        return self.encode[index]


class World:
    """A simulator with one scene."""

    def __init__(self, request: dict[str, Any]) -> None:
        habitat_sim = _habitat_sim()
        self.width, self.height = int(request["width"]), int(request["height"])
        factor = int(request["supersampling"])
        self.display = Display(factor)
        backend = habitat_sim.SimulatorConfiguration()
        backend.scene_id = request["stage"]
        backend.enable_physics = False
        backend.gpu_device_id = int(request["gpu"])
        _set_known(backend, {"load_semantic_mesh": False, "leave_context_with_background_renderer": False})
        types = habitat_sim.SensorType
        agent = habitat_sim.agent.AgentConfiguration()
        agent.sensor_specifications = [
            self._sensor("rgb", types.COLOR, factor, request),
            self._sensor("depth", types.DEPTH, 1, request),
            self._sensor("ids", types.SEMANTIC, 1, request),
        ]
        self.simulator = habitat_sim.Simulator(habitat_sim.Configuration(backend, [agent]))
        # Without physics an object cannot be found again unless a reference is kept.
        self.objects = [self._add(item) for item in request["objects"]]

    def _sensor(self, name: str, kind: Any, factor: int, request: dict[str, Any]) -> Any:
        habitat_sim = _habitat_sim()
        spec = habitat_sim.CameraSensorSpec()
        spec.uuid = name
        spec.sensor_type = kind
        spec.resolution = [self.height * factor, self.width * factor]
        spec.hfov = float(request["hfov"])
        spec.position = [0.0, 0.0, 0.0]
        spec.near, spec.far = float(request["near"]), float(request["far"])
        if kind == habitat_sim.SensorType.COLOR:
            _set_known(spec, {"clear_color": [float(request["background"])] * 3 + [1.0]})
        return spec

    def _add(self, item: dict[str, Any]) -> Any:
        habitat_sim = _habitat_sim()
        templates = self.simulator.get_object_template_manager()
        template = templates.create_new_template(f"instance_{item['id']}")
        template.render_asset_handle = item["path"]
        template.force_flat_shading = True
        # The file is in world coordinates: its origin is not to move to the centre of mass.
        template.com = [0.0, 0.0, 0.0]
        _set_known(template, {"compute_COM_from_shape": False})
        number = templates.register_template(template)
        thing = self.simulator.get_rigid_object_manager().add_object_by_template_id(
            number, light_setup_key=habitat_sim.gfx.NO_LIGHT_KEY
        )
        if thing is None:
            raise RuntimeError(f"habitat-sim could not load {item['path']}")
        thing.translation = [0.0, 0.0, 0.0]
        thing.semantic_id = int(item["id"])
        return thing

    def render(self, position: Sequence[float], rotation: Sequence[float]) -> tuple[Any, Any, Any]:
        """Colour (H, W, 3) uint8, depth (H, W) float32 and ids (H, W) uint16 from a pose; rotation is (w, x, y, z)."""
        habitat_sim = _habitat_sim()
        state = habitat_sim.AgentState()
        state.position = np.array(position, dtype=np.float32)
        w, x, y, z = rotation
        state.rotation = habitat_sim.utils.common.quat_from_coeffs([x, y, z, w])
        self.simulator.get_agent(0).set_state(state, reset_sensors=True)
        seen = self.simulator.get_sensor_observations()
        depth = np.asarray(seen["depth"], dtype=np.float32)
        return (
            self.display.shrink(np.asarray(seen["rgb"])[..., :3]),
            np.where(np.isfinite(depth), depth, np.float32(0.0)),
            np.asarray(seen["ids"]).astype(np.uint16),
        )

    def navmesh(self, request: dict[str, Any]) -> float:
        """Compute the navigation mesh; returns its area in square metres."""
        habitat_sim = _habitat_sim()
        settings = habitat_sim.NavMeshSettings()
        settings.set_defaults()
        _set_known(settings, request["settings"])
        if not self.simulator.recompute_navmesh(self.simulator.pathfinder, settings):
            return 0.0
        return float(self.simulator.pathfinder.navigable_area)

    def navigable(self, points: Any, tolerance: float) -> Any:
        """Which of the points (N, 3) lie on the navigation mesh, up to ``tolerance`` metres in height."""
        finder = self.simulator.pathfinder
        if not finder.is_loaded:
            return np.zeros(len(points), dtype=np.uint8)
        return np.array([finder.is_navigable(point, tolerance) for point in points], dtype=np.uint8)

    def close(self) -> None:
        """Free the simulator."""
        self.objects = []
        self.simulator.close()


class Service:
    """Commands of the worker; at most one scene is open."""

    def __init__(self) -> None:
        self.world: World | None = None
        self.folder: str | None = None

    def answer(self, request: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], list[tuple[str, Any]]]:
        """The answer to a request, and the arrays that go with it."""
        command = request.get("command")
        self.folder = request.get("folder", self.folder)
        if command == "hello":
            return self.hello(), []
        if command == "open":
            self.close()
            self.world = World(request)
            return {}, []
        if command == "close":
            self.close()
            return {}, []
        if self.world is None:
            raise RuntimeError(f"{command!r} before any scene was opened")
        if command == "render":
            rgb, depth, ids = self.world.render(request["position"], request["rotation"])
            return {}, [("rgb", rgb), ("depth", depth), ("ids", ids)]
        if command == "navmesh":
            return {"area": self.world.navmesh(request)}, []
        if command == "navigable":
            return {}, [("navigable", self.world.navigable(arrays["points"], request["tolerance"]))]
        raise ValueError(f"unknown command {command!r}")

    def hello(self) -> dict[str, Any]:
        """Versions of the software that runs here."""
        habitat_sim = _habitat_sim()
        return {
            "protocol": PROTOCOL,
            "version": str(habitat_sim.__version__),
            "python": ".".join(str(number) for number in sys.version_info[:3]),
            "cuda": bool(getattr(habitat_sim, "cuda_enabled", False)),
        }

    def close(self) -> None:
        """Drop the scene, if there is one."""
        if self.world is not None:
            self.world.close()
        self.world = None

    def remove_folder(self) -> None:
        """Remove the files of the parent for this process; not needed after the parent has released it."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def serve(channel: Channel, service: Service) -> None:
    """Answer requests until the other side goes."""
    try:
        while True:
            request, arrays = channel.receive()
            if request is None:
                break
            try:
                answer, results = service.answer(request, arrays)
                answer["ok"] = True
            except Exception as error:  # any error must be reported to the parent process
                traceback.print_exc()
                answer, results = {"ok": False, "error": f"{type(error).__name__}: {error}"}, []
            channel.send(answer, results)
    finally:  # it may have gone in the middle of a message
        service.remove_folder()
    service.close()


def watch(parent: int, service: Service) -> None:
    """End this process when its parent has ended, even in the middle of a frame."""
    while os.getppid() == parent:
        time.sleep(WATCH)
    service.remove_folder()
    os._exit(1)


def main() -> None:
    """Take over the standard streams, then serve."""
    # This folder holds modules of another package: none of them is to be found by a name that something else has.
    here = os.path.dirname(os.path.abspath(__file__))
    sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry or ".") != here]
    # Ctrl-C at the terminal is the parent's business, which ends this process by closing its input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    service = Service()
    threading.Thread(target=watch, args=(os.getppid(), service), daemon=True).start()
    reader, writer = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    os.environ.setdefault("HABITAT_SIM_LOG", "quiet")
    os.environ.setdefault("MAGNUM_LOG", "quiet")
    serve(Channel(reader, writer), service)


if __name__ == "__main__":
    main()
