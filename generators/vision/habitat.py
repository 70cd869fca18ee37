"""habitat-sim as a vision backend: it renders in an interpreter of its own.

Its wheels and conda builds need another Python than this package, and it ends the whole process where it finds no EGL
device: so it works in a child process that is spoken to over pipes (generators/vision/habitat_process.py). The scene
goes there as files: a scan as the file that it was read from, unless objects shade it; everything else exported with
its light baked into textures (generators/vision/glb.py). Colour is supersampled; depth and ids are those at the pixels'
centres.

In a scan's own file habitat-sim does not draw the backs of faces: through a hole in a cupboard's door one looks past
its inside, which the CPU renderer shows. The exported meshes have both sides.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from socket import gethostname
from tempfile import TemporaryDirectory, gettempdir

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import os_error_line
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.modelframe import upright
from generators.core.boxes import yaw_matrix
from generators.core.freespace import AGENT_RADIUS, CELL, SENSOR_HEIGHT, Navigable
from generators.core.scene import Material, Part, Scene, StageFile
from generators.core.tone import srgb_encode
from generators.vision.base import RenderedView
from generators.vision.glb import write_glb
from generators.vision.habitat_process import (
    Client,
    Header,
    WorkerTimeouts,
    as_points,
    find_interpreter,
    graphics_device,
    start,
)

#: Colour samples per pixel along each axis.
SUPERSAMPLING = 3
#: Largest picture side: with all samples it must fit a texture of 16384 texels, which every driver has.
MAX_SIDE = 16384 // SUPERSAMPLING
#: Linear display light where nothing is hit, as the CPU renderer shows it.
BACKGROUND = 0.82
#: Metres from the camera between which things are seen.
NEAR, FAR = 0.02, 1000.0
#: Texel size of exports: what a pixel covers at this distance (m), within these limits (m).
HOME_DISTANCE, HOME_TEXELS = 0.6, (0.004, 0.01)
OBJECT_DISTANCE, OBJECT_TEXELS = 0.3, (0.0015, 0.006)
#: Largest height above or below the navigation mesh at which a point still counts as on it, metres.
LEVEL = 0.25
#: What habitat-sim computes its navigation mesh for: the agent that `FreeSpace` knows.
NAVIGATION = {
    "agent_radius": AGENT_RADIUS,
    "agent_height": SENSOR_HEIGHT + AGENT_RADIUS,
    "agent_max_climb": 0.1,
    "cell_size": CELL / 2,
    "cell_height": CELL / 2,
}
_BARE = Material("bare", "plaster")


class HabitatBackend:
    """Renders with the habitat-sim of another interpreter."""

    name = "habitat"

    def __init__(self, interpreter: str | None = None, limits: WorkerTimeouts | None = None) -> None:
        """Choose the interpreter: by default what ``$AVS3D_HABITAT_PYTHON`` names."""
        self._interpreter, self._limits = interpreter, limits or WorkerTimeouts()

    @property
    def version(self) -> str:
        """Version of habitat_sim; asked once per process.

        Raises:
            Avs3dError: if no interpreter is named, or it has no habitat_sim that works.
        """
        return _version(find_interpreter(self._interpreter), self._limits)

    def warm_up(self) -> None:
        """Compile the kernels that bake textures, and see that the interpreter is there.

        Raises:
            Avs3dError: see `version`.
        """
        from generators.vision.embree import warm_up

        _ = self.version
        warm_up()

    def open(self, scene: Scene, intrinsics: Intrinsics) -> HabitatSession:
        """Load ``scene`` for a camera with ``intrinsics``.

        Raises:
            Avs3dError: for a scene or camera that cannot be rendered, or a habitat-sim that does not start.
        """
        return HabitatSession(scene, intrinsics, find_interpreter(self._interpreter), self._limits)

    def navigable(self, home: Scene) -> Navigable:
        """Where the agent can stand by habitat-sim's navigation mesh of ``home``, computed for this agent.

        The worker behind it ends when the answer is no longer referred to.

        Raises:
            Avs3dError: if habitat-sim does not start, or computes no mesh.
        """
        return _NavigationMesh(home, find_interpreter(self._interpreter), self._limits)


class HabitatSession:
    """An open scene. Not for several threads at once."""

    def __init__(self, scene: Scene, intrinsics: Intrinsics, interpreter: str, limits: WorkerTimeouts) -> None:
        hfov = _field_of_view(intrinsics)
        self._shape = (intrinsics.height, intrinsics.width)
        self._limits = limits
        self._folder, self._clean = _folder(self)
        try:
            request = _open_request(scene, self._folder, intrinsics, hfov)
            self._client = Client(interpreter, scene.name, [(request, limits.open)], limits)
        except BaseException:
            self._clean()
            raise

    @property
    def worker_pid(self) -> int | None:
        """The number of the process that renders; None when closed."""
        return self._client.worker.pid if self._client.worker is not None else None

    @property
    def about(self) -> Header:
        """The worker's description of itself: ``version`` of habitat_sim, ``python``, ``cuda``."""
        return self._client.about

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes, from any worker.

        Raises:
            Avs3dError: if the worker dies for the second time, habitat-sim fails, or the session is closed.
        """
        request = {"command": "render", "position": list(pose.position), "rotation": list(pose.rotation)}
        _, arrays = self._client.ask(request, self._limits.render)
        rgb, depth, ids = arrays["rgb"], arrays["depth"], arrays["ids"]
        if rgb.shape != (*self._shape, 3) or depth.shape != self._shape or ids.shape != self._shape:
            raise Avs3dError(f"habitat-sim rendered {rgb.shape}, {depth.shape}, {ids.shape}; expected {self._shape}")
        return RenderedView(rgb=rgb, depth=depth, instance_ids=ids)

    def share(self) -> None:
        """None: habitat-sim draws one frame at a time."""
        return

    def close(self) -> None:
        """End the worker and remove its files; closing twice is fine."""
        self._client.close()
        self._clean()


class _NavigationMesh:
    """Answers which points lie on habitat-sim's navigation mesh."""

    def __init__(self, home: Scene, interpreter: str, limits: WorkerTimeouts) -> None:
        self._limits = limits
        folder, _ = _folder(self)
        camera = Intrinsics.from_fov(8)
        prepare: Sequence[tuple[Header, float]] = [
            (_open_request(_bare(home), folder, camera, 90.0), limits.open),
            ({"command": "navmesh", "settings": NAVIGATION}, limits.navmesh),
        ]
        self._client = Client(interpreter, home.name, prepare, limits)
        area = float(self._client.answers[1]["area"])
        if not area > 0:
            self._client.close()
            raise Avs3dError(
                f"{home.name}: habitat-sim finds no floor to walk on; is the scan's up axis right, is it in metres?"
            )

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        request = {"command": "navigable", "tolerance": LEVEL}
        _, arrays = self._client.ask(request, self._limits.navmesh, [("points", as_points(points))])
        return arrays["navigable"].astype(bool)


def probe(interpreter: str | None = None) -> tuple[bool, str]:
    """Whether habitat-sim works here, seen by rendering a box with it, and one line about it.

    Args:
        interpreter: path of the other Python; without it what ``$AVS3D_HABITAT_PYTHON`` names.
    """
    from generators.assets.shapes import MeshBuilder

    mesh = MeshBuilder().box((1, 1, 1), (0, 0, -2), Material("grey", "plaster", colour=(0.5, 0.5, 0.5))).build()
    try:
        backend = HabitatBackend(interpreter)
        session = backend.open(Scene("probe", (Part("box", mesh, instance_id=1),), (), ()), Intrinsics.from_fov(16))
        try:
            frame, found = session.render(Pose.from_yaw((0, 0, 0), 0.0)), session.about
        finally:
            session.close()
    except Avs3dError as error:
        return False, str(error)
    depth = float(frame.depth[8, 8])
    if frame.instance_ids[8, 8] != 1 or abs(depth - 1.5) > 1e-3:
        return (
            False,
            f"habitat-sim {found['version']} shows id {frame.instance_ids[8, 8]} at {depth:.3f} m; expected 1 at 1.5",
        )
    cuda = "with CUDA" if found["cuda"] else "without CUDA"
    return True, f"habitat-sim {found['version']} renders ({cuda}, Python {found['python']})"


@lru_cache(maxsize=8)
def _version(interpreter: str, limits: WorkerTimeouts) -> str:
    worker, about = start(interpreter, limits)
    worker.close()
    return str(about["version"])


def _field_of_view(camera: Intrinsics) -> float:
    """The horizontal field of view in degrees.

    Raises:
        Avs3dError: for a camera that habitat-sim has no sensor for.
    """
    numbers = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    close = np.allclose([camera.fy, camera.cx, camera.cy], [camera.fx, camera.width / 2, camera.height / 2], rtol=1e-6)
    if not (np.isfinite(numbers).all() and min(numbers) > 0 and max(numbers[:2]) <= MAX_SIDE and close):
        raise Avs3dError(
            f"camera {numbers}: habitat-sim knows square pixels and an axis in the middle, up to {MAX_SIDE} pixels a"
            " side; expected fx = fy, cx = width / 2, cy = height / 2"
        )
    return math.degrees(2.0 * math.atan(camera.width / 2.0 / camera.fx))


def _folder(owner: object) -> tuple[Path, Callable[[], object]]:
    """A temporary folder that goes with its ``owner``, and what removes it before.

    Its name says whose it is: what processes left behind that were killed together with their worker goes now.
    """
    prefix = f"avs3d-habitat-{gethostname()}-"
    for left in Path(gettempdir()).glob(f"{prefix}*-*"):
        owner_id = left.name.removeprefix(prefix).partition("-")[0]
        if owner_id.isdigit() and not _is_alive(int(owner_id)):
            shutil.rmtree(left, ignore_errors=True)
    try:
        folder = TemporaryDirectory(prefix=f"{prefix}{os.getpid()}-", ignore_cleanup_errors=True)
    except OSError as error:
        raise Avs3dError(os_error_line(error, action="make a temporary folder")) from error
    return Path(folder.name), weakref.finalize(owner, folder.cleanup)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's
        return True
    return True


def _open_request(scene: Scene, folder: Path, camera: Intrinsics, hfov: float) -> Header:
    """Write what habitat-sim is to load into ``folder``; returns the request that makes it do so."""
    home = [part for part in scene.parts if part.instance_id == 0]
    stage = "NONE"  # habitat-sim's word for an empty scene
    # habitat-sim 0.2.2 reads neither the scale nor the unit of a stage: a scan that is not in metres is written anew.
    if scene.stage is not None and scene.stage.scale == 1.0 and all(part.light is None for part in home):
        stage = _write_stage(folder, scene.stage)
    elif home:
        _export(scene, home, folder / "stage.glb", _texel(camera, HOME_DISTANCE, HOME_TEXELS))
        stage = _write_stage(folder, StageFile(folder / "stage.glb"))
    objects = []
    for number in sorted({part.instance_id for part in scene.parts} - {0}):
        path = folder / f"instance_{number}.glb"
        own = [part for part in scene.parts if part.instance_id == number]
        _export(scene, own, path, _texel(camera, OBJECT_DISTANCE, OBJECT_TEXELS))
        objects.append({"id": number, "path": str(path)})
    return {
        "command": "open",
        "folder": str(folder),
        "stage": stage,
        "objects": objects,
        "width": camera.width,
        "height": camera.height,
        "hfov": hfov,
        "near": NEAR,
        "far": FAR,
        "supersampling": SUPERSAMPLING,
        "background": float(srgb_encode(BACKGROUND)),
        "gpu": graphics_device(),
    }


def _export(scene: Scene, parts: Sequence[Part], path: Path, texel: float) -> None:
    """Write parts for habitat-sim, which does not draw the backs of faces whatever their material says."""
    write_glb(scene, path, parts=parts, texel=texel, both_sides=True)


def _write_stage(folder: Path, stage: StageFile) -> str:
    """A stage's configuration: without one habitat-sim takes the z axis of a file for up, and lights it.

    Raises:
        Avs3dError: if the stage's file is not there.
    """
    if not stage.path.is_file():
        raise Avs3dError(f"{stage.path}: no such file; habitat-sim is to load the scan from there")
    # Rows: the directions of the file that become X, Y and Z.
    turn = yaw_matrix(np.radians(stage.turn)) @ upright(stage.up, stage.front)
    # habitat-sim's front looks along −Z.
    config = {
        "render_asset": str(stage.path.absolute()),
        "up": [float(c) for c in turn[1]],
        "front": [float(-c) for c in turn[2]],
        "force_flat_shading": True,
    }
    path = folder / "scene.stage_config.json"
    path.write_text(json.dumps(config))
    return str(path)


def _texel(camera: Intrinsics, distance: float, limits: tuple[float, float]) -> float:
    return min(max(distance / camera.fx, limits[0]), limits[1])


def _bare(home: Scene) -> Scene:
    """The home without colours, for what only looks at its shape."""
    if home.stage is not None:
        return replace(home, parts=tuple(part for part in home.parts if part.instance_id == 0))
    parts = []
    for part in home.parts:
        mesh = replace(part.mesh, materials=(_BARE,) * len(part.mesh.materials))
        parts.append(replace(part, light=None, mesh=mesh))
    return replace(home, parts=tuple(parts))
