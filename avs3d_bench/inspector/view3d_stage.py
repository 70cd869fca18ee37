"""The scene of `avs3d view-3d` as nodes of a viser server; viser itself is handed in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.contract.schema import InstanceRecord, Vector3
from avs3d_bench.formats.ply import Ply
from avs3d_bench.geometry import Pose
from avs3d_bench.inspector.pictures import shrunk
from avs3d_bench.inspector.sources import ShownSound
from avs3d_bench.inspector.view3d_data import Cloud, Scene3D
from avs3d_bench.inspector.view3d_surfaces import VisibleSurface
from avs3d_bench.text.templates import words

#: Pictures on the frusta, pixels a side: in the scene, and of the frame that is shown now.
THUMB_SIDE, CURRENT_SIDE = 96, 320
#: Distance of a frustum's picture plane from its camera, metres: 105 of the 120 frames are train frames.
_TRAIN_DEPTH, _TEST_DEPTH, _NOW_DEPTH = 0.05, 0.1, 0.3
_TRAIN, _TEST, _NOW = (70, 110, 160), (0, 158, 115), (0, 114, 178)
#: Radius of a source (m), and its share of that while it is not audible.
_SOURCE_RADIUS, _NOT_AUDIBLE = 0.06, 0.5
_TRUTH, _SILENT = (228, 87, 46), (120, 126, 134)
#: Of submissions, in their order (Okabe & Ito 2008).
PREDICTED = ((86, 180, 233), (204, 121, 167), (240, 228, 66), (0, 158, 115))


Colour = tuple[int, int, int]


def legend(scene: Scene3D) -> list[tuple[Colour, str]]:
    """Meanings of the colours in the scene: (RGB, text), the objects first."""
    rows: list[tuple[Colour, str]] = []
    if scene.lanes is not None:
        rows += [(s.colour, f"{s.name} (off-screen)" if s.off_screen else s.name) for s in scene.lanes.sources]
    elif scene.category is not None or scene.mesh is not None:
        rows.append((_TRUTH, f"{words(scene.category)} (sounding)" if scene.category else "sounding object"))
    if any(not instance.sounding for instance in scene.instances):
        rows.append((_SILENT, "silent objects"))
    rows += [(PREDICTED[n % len(PREDICTED)], f"predicted: {p.method}") for n, p in enumerate(scene.predictions)]
    rows += [(_NOW, "camera now"), (_TRAIN, "path"), (_TEST, "test cameras")]
    return rows


class ViserScene:
    """The scene in a viser server.

    Attributes:
        server: viser's.
        scene: what is shown.
        layers: what can be switched on and off: name → viser's handles.
    """

    def __init__(self, server: Any, scene: Scene3D) -> None:
        """Nothing is drawn yet."""
        self.server, self.scene = server, scene
        self.layers: dict[str, list[Any]] = {}
        self._now: dict[str, Any] = {}
        self._moving: dict[int, list[Any]] = {}
        self._pictures: dict[int, NDArray[np.uint8]] = {}

    def build(self) -> None:
        """Draw everything that does not move, and the first frame."""
        self.server.scene.set_up_direction("+y")
        self._look()
        self._surfaces()
        self._points()
        self._objects()
        self._path()
        for number, prediction in enumerate(self.scene.predictions):
            colour = PREDICTED[number % len(PREDICTED)]
            colours = np.tile(np.array(colour, dtype=np.uint8), (len(prediction.points), 1))
            cloud = Cloud(prediction.points, colours)
            # Methods of one name stay two: the node is named after its place.
            self._cloud(f"predicted: {prediction.method}", f"/predicted/{number}", cloud, size=0.014)
        self.show(0)

    def show(self, number: int) -> None:
        """Move the camera, the sources and the objects to frame ``number`` of those with a pose."""
        moment = self.scene.frames[number]
        picture = self._picture(number)
        camera = self._now.get("camera")
        if camera is None:
            self._now["camera"] = self._frustum("/now/camera", moment.pose, _NOW, _NOW_DEPTH, picture)
            self._add("camera now", self._now["camera"])
        else:
            camera.image, camera.position, camera.wxyz = picture, moment.pose.position, opencv_rotation(moment.pose)
        for name, handle in self._now.items():
            if name in moment.sources:
                handle.position = moment.sources[name]
            if name in (moment.audible or ()):
                handle.scale = 1.0
            elif moment.audible is not None and name.startswith("source_"):
                handle.scale = _NOT_AUDIBLE
        for instance, moved in moment.moved.items():
            for handle in self._moving.get(instance, ()):
                handle.position, handle.wxyz = moved.position, moved.rotation

    def _picture(self, number: int) -> NDArray[np.uint8]:
        """The frame, small; decoded once."""
        if number not in self._pictures:
            self._pictures[number] = shrunk(self.scene.frames[number].frame.rgb(), CURRENT_SIDE)
        return self._pictures[number]

    def _add(self, layer: str, *handles: Any) -> None:
        self.layers.setdefault(layer, []).extend(handles)

    def _look(self) -> None:
        """The first view: from above, across the path onto the source (onto the path where it is unknown)."""
        path = np.array([moment.pose.position for moment in self.scene.frames])
        middle = path.mean(axis=0)
        away_from_here = {s.record.id for s in self.scene.lanes.sources if s.off_screen} if self.scene.lanes else set()
        here = [place for name, place in self.scene.frames[0].sources.items() if name not in away_from_here]
        source = here[0] if here else None
        away = (middle - np.array(source)) * (1, 0, 1) if source is not None else np.array([1.0, 0.0, 1.0])
        length = float(np.linalg.norm(away))
        away = away / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
        reach = max(2.0, float(np.ptp(path, axis=0).max()) + length)
        where = self.server.initial_camera
        where.up = (0.0, 1.0, 0.0)
        where.look_at = tuple(float(c) for c in middle - 0.4 * length * away - (0.0, 0.9, 0.0))
        where.position = tuple(float(c) for c in middle + 0.7 * reach * away + (0.0, 0.8 * reach, 0.0))

    def _surfaces(self) -> None:
        for surface in self.scene.surfaces:
            handle = self.server.scene.add_glb(f"/room/surfaces/{surface.name}", textured_glb(surface))
            self._add("surfaces of the room", handle)

    def _points(self) -> None:
        scene = self.scene
        bare = not scene.surfaces
        if scene.dense is not None:
            self._cloud("points of depth", "/room/dense", scene.dense, size=0.012, visible=bare)
        self._cloud("sparse points", "/room/sparse", scene.room, size=0.025, visible=bare and scene.dense is None)
        self._cloud("ceiling", "/room/ceiling", scene.ceiling, size=0.025, visible=False)

    def _cloud(self, layer: str, node: str, cloud: Cloud, *, size: float, visible: bool = True) -> None:
        if not len(cloud.points):
            return
        handle = self.server.scene.add_point_cloud(
            node,
            cloud.points,
            cloud.colours,
            point_size=size,
            point_shape="circle",
            precision="float32",
            point_shading="flat",
            visible=visible,
        )
        self._add(layer, handle)

    def _objects(self) -> None:
        add = self.server.scene
        if self.scene.lanes is not None:
            self._sources(self.scene.lanes)
        elif self.scene.mesh is not None:
            mesh = self.scene.mesh
            handle = add.add_mesh_simple(
                "/object/mesh", mesh.vertices, mesh.faces, color=_TRUTH, flat_shading=True, side="double", opacity=0.85
            )
            self._add("sounding object", handle)
            for number in self.scene.moving:
                self._moving.setdefault(number, []).append(handle)
        for instance in self.scene.instances:
            self._box(instance)
        spots = [place for moment in self.scene.frames for place in moment.sources.values()]
        if spots and self.scene.lanes is None:
            ball = add.add_icosphere("/source", radius=_SOURCE_RADIUS, color=_TRUTH, position=spots[0])
            self._now["source_1"] = ball
            self._add("source", ball)
            if self.scene.moving:
                self._add("source", self._polyline("/source_path", spots, _TRUTH))

    def _sources(self, scene: ShownSound) -> None:
        """The sources of a part_3 observation, and the meshes of its sounding instances, each in its colour."""
        add = self.server.scene
        for source in scene.sources:
            node, position = f"/sources/{source.record.id}", source.record.position
            ball = add.add_icosphere(node, radius=_SOURCE_RADIUS, color=source.colour, position=position)
            self._now[source.record.id] = ball
            self._add("sources", ball)
            if source.off_screen:
                # One that is in the room is named by its box.
                text = f"{source.name} (off-screen)"
                self._add(
                    "sources", add.add_label(f"{node}/name", text, anchor="bottom-center", position=(0.0, 0.1, 0.0))
                )
        for instance in self.scene.instances:
            faces = faces_of(self.scene.mesh, instance) if instance.sounding and self.scene.mesh else None
            if self.scene.mesh is not None and faces is not None and len(faces):
                handle = add.add_mesh_simple(
                    f"/object/mesh/{instance.id}", self.scene.mesh.vertices, faces, color=scene.colours[instance.id],
                    flat_shading=True, side="double", opacity=0.85,
                )  # fmt: skip
                self._add("sounding objects", handle)
                self._moving.setdefault(instance.id, []).append(handle)
        for source in scene.sources:
            if source.record.instance in self.scene.moving:
                spots = [moment.sources[source.record.id] for moment in self.scene.frames]
                self._add("sources", self._polyline(f"/source_path/{source.record.id}", spots, source.colour))

    def _box(self, instance: InstanceRecord) -> None:
        low, high = (np.array(corner, dtype=np.float32) for corner in instance.bounds)
        colour, name = _TRUTH if instance.sounding else _SILENT, words(instance.category)
        if self.scene.lanes is not None:
            name = self.scene.lanes.names[instance.id]
            colour = self.scene.lanes.colours[instance.id] if instance.sounding else _SILENT
        node = f"/instances/{instance.id}"
        lines = self.server.scene.add_line_segments(
            f"{node}/box", box_edges(low, high), np.full((12, 2, 3), colour, np.uint8), thickness=0.012
        )
        text = name + (" (sounding)" if instance.sounding else "")
        top = ((low + high) / 2 * (1, 0, 1) + high * (0, 1, 0)).astype(float)
        label = self.server.scene.add_label(f"{node}/box/name", text, position=tuple(top), anchor="bottom-center")
        self._add("objects", lines, label)
        self._moving.setdefault(instance.id, []).append(lines)  # its name with it

    def _path(self) -> None:
        frames = self.scene.frames
        self._add("path", self._polyline("/path/line", [moment.pose.position for moment in frames], _TRAIN))
        for number, moment in enumerate(frames):
            test = moment.frame.split == "test"
            handle = self._frustum(
                f"/path/{moment.frame.name}",
                moment.pose,
                _TEST if test else _TRAIN,
                _TEST_DEPTH if test else _TRAIN_DEPTH,
                shrunk(self._picture(number), THUMB_SIDE),
            )
            # 105 pictures of train frames hide the room: they can be switched on.
            handle.visible = test
            self._add("test cameras" if test else "train cameras", handle)

    def _polyline(self, node: str, spots: Sequence[Any], colour: tuple[int, int, int]) -> Any:
        line = np.asarray(spots, dtype=np.float32)
        segments = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.stack([line, line], axis=1)
        colours = np.full((len(segments), 2, 3), colour, dtype=np.uint8)
        return self.server.scene.add_line_segments(node, segments, colours, thickness=0.02)

    def _frustum(
        self, node: str, pose: Pose, colour: tuple[int, int, int], scale: float, picture: NDArray[np.uint8]
    ) -> Any:
        camera = self.scene.camera
        return self.server.scene.add_camera_frustum(
            node,
            fov=self.scene.vertical_fov,
            aspect=camera.width / camera.height,
            scale=scale,
            thickness=0.004,
            color=colour,
            image=picture,
            format="jpeg",
            jpeg_quality=75,
            wxyz=opencv_rotation(pose),
            position=pose.position,
            cast_shadow=False,
        )


def opencv_rotation(pose: Pose) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a camera whose axes are OpenCV's: half a turn about our camera's X axis."""
    w, x, y, z = pose.rotation
    turned = Rotation.from_quat([x, y, z, w]) * Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
    x, y, z, w = (float(c) for c in turned.as_quat())
    return w, x, y, z


def faces_of(mesh: Ply, instance: InstanceRecord) -> NDArray[np.integer[Any]]:
    """The faces (M, 3) of an instance: vertices name it where something moves, else they lie in its bounds."""
    if mesh.instances is None:
        return faces_within(mesh, instance.bounds)
    return np.asarray(mesh.faces[mesh.instances[mesh.faces[:, 0]] == instance.id])


def faces_within(mesh: Ply, bounds: tuple[Vector3, Vector3], slack: float = 0.01) -> NDArray[np.integer[Any]]:
    """The faces (M, 3) of a mesh that lie in a box, or at most ``slack`` metres outside of it."""
    low, high = np.array(bounds[0]) - slack, np.array(bounds[1]) + slack
    inside = np.all((mesh.vertices >= low) & (mesh.vertices <= high), axis=1)
    return np.asarray(mesh.faces[inside[mesh.faces].all(axis=1)])


def box_edges(low: NDArray[np.float32], high: NDArray[np.float32]) -> NDArray[np.float32]:
    """The twelve edges (12, 2, 3) of an upright box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float32)
    pairs = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
    return np.asarray((corners * (high - low) + low)[np.array(pairs)], dtype=np.float32)


def textured_glb(surface: VisibleSurface) -> bytes:
    """A surface as binary glTF, in the colours of its picture whatever lights the viewer has."""
    import trimesh
    from PIL import Image

    # The picture glows on a black surface: the viewer's lights add nothing to it. From behind nothing is drawn, so that
    # a wall does not hide the room from a viewer outside.
    material = trimesh.visual.material.PBRMaterial(  # type: ignore[no-untyped-call]
        emissiveTexture=Image.fromarray(surface.picture), emissiveFactor=(1.0, 1.0, 1.0),
        baseColorFactor=(0, 0, 0, 255), metallicFactor=0.0, roughnessFactor=1.0, doubleSided=False,
    )  # fmt: skip
    # trimesh counts v from the bottom of the picture.
    uv = surface.pixels * (1, -1) + (0, 1)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)  # type: ignore[no-untyped-call]
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, visual=visual, process=False)
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    return data
