"""Writes the responses, meshes and pictures of `avs3d export acoustics`. Start reading here.

Every room of the manifest is heard as it is furnished, without the objects that observations place in it. The folder
appears whole or not at all, and the same manifest and settings give the same bytes, with any number of workers.
"""

from __future__ import annotations

import csv
import glob
import io
import math
import os
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.acoustics import (
    ACOUSTICS_JSON,
    RESPONSES_CSV,
    SPLITS_BY,
    AcousticSpace,
    AcousticsSettings,
    ResponseSplit,
    ResponsesRecord,
)
from avs3d_bench.formats.files import read_record, write_bytes, write_json
from avs3d_bench.formats.media import write_png_rgb
from avs3d_bench.formats.ply import write_ply_mesh
from avs3d_bench.formats.staging import refuse_strange, staged_folder
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.measures.decay import decay_figures
from avs3d_bench.runtime.parallel import available_cores
from generators.acoustics.engines import Tracer
from generators.acoustics.geometry import AcousticMesh
from generators.acoustics.materials import OCTAVE_BANDS, material_for, scaled_label
from generators.acoustics.rir import Rir
from generators.acoustics.rooms import Room
from generators.acoustics.shards import write_webdataset
from generators.core.folders import default_cache
from generators.homes.store import open_home
from generators.plan import ENGINE_SEEDS, derive_rng
from generators.responses.spaces import Positions, SourceManifest, draw_positions, opened_manifest, split_names
from generators.run.dataset_record import manifest_attributions
from generators.scenes.home_scene import HomeScene
from generators.scenes.renderer import Renderer

#: Fewer responses than this are made in this process: starting others takes longer.
_FEW = 300
#: Files beside a mesh and beside pictures.
_MATERIALS, _TRANSFORMS = "materials.json", "transforms.json"
#: Responses of a shard.
_PER_SHARD = 1000
#: Angle between the headings of consecutive pictures (radians): the golden angle, which repeats no direction.
_TURN = math.pi * (3 - math.sqrt(5))
_COLUMNS = (
    "shard", "key", "home", "room", "material", "source", "listener", "source_x", "source_y", "source_z",
    "listener_x", "listener_y", "listener_z", "heading", "distance", *(f"split_by_{by}" for by in SPLITS_BY),
    "T60", "T30", "EDT", "C50",
)  # fmt: skip


def write_acoustics(source: Path, folder: Path, settings: AcousticsSettings) -> ResponsesRecord:
    """Write the responses of the rooms of a dataset or a manifest; an earlier export of the same is replaced.

    Args:
        source: a dataset or the file of a manifest.
        folder: where to.
        settings: see `AcousticsSettings`.

    Raises:
        UsageError: if there is nothing to export, a setting is out of range, or ``folder`` holds something else.
        Avs3dError: if a home cannot be opened or heard, or the system refuses.
    """
    settings.check()
    with opened_manifest(source, settings) as manifest:
        name = manifest.file.manifest.name
        with staged_folder(folder, partial(_check_folder, name=name)) as fresh:
            return _Export(manifest, settings, fresh).write()


def _check_folder(folder: Path, name: str) -> None:
    """Refuse to replace what is no earlier export of the same."""
    if not os.path.lexists(folder) or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not (folder / ACOUSTICS_JSON).is_file():
        raise UsageError(f"{folder}: exists and is no export of responses; choose another folder")
    found = read_record(folder / ACOUSTICS_JSON, ResponsesRecord)
    if found.dataset != name:
        raise UsageError(f"{folder}: holds the responses of {found.dataset}; choose another folder")
    refuse_strange(folder, (ACOUSTICS_JSON, RESPONSES_CSV, *_own_files(found)))


def _own_files(record: ResponsesRecord) -> Iterator[str]:
    """Shell patterns of the files that a record names."""
    for home, mesh in record.meshes.items():
        yield from (glob.escape(mesh), f"{glob.escape(home)}/{_MATERIALS}")
    for space in record.spaces:
        yield from map(glob.escape, space.shards)
        if space.pictures is not None:
            yield from (f"{glob.escape(space.pictures)}/{name}" for name in ("frame_*.png", _TRANSFORMS))


class _Export:
    """An export that is being written into a folder."""

    def __init__(self, source: SourceManifest, settings: AcousticsSettings, folder: Path) -> None:
        self.source, self.settings, self.folder = source, settings, folder
        self.seed = source.file.manifest.seed
        self.engine = Tracer(self.seed % ENGINE_SEEDS, settings.device)
        self.workers = settings.workers or available_cores()
        self.materials = {f"absorption_{scale:g}": scale for scale in settings.absorption}
        self.rows: list[tuple[object, ...]] = []
        self.spaces: list[AcousticSpace] = []
        self.meshes: dict[str, str] = {}

    def write(self) -> ResponsesRecord:
        """All homes, the table and, last, the record."""
        homes = self.source.homes
        home_splits = split_names(list(homes), derive_rng(self.seed, "", "responses: homes"))
        for name, rooms in homes.items():
            for room, plan in rooms.items():
                # A scan is opened with the rooms that its observations name.
                home = HomeScene(open_home(plan, default_cache(), workers=self.workers))
                mesh = home.acoustic_mesh()
                if name not in self.meshes:
                    self.meshes[name] = self._write_mesh(name, mesh)
                self._write_room(name, room, home, mesh, home_splits[name])
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([_COLUMNS, *self.rows])
        write_bytes(self.folder / RESPONSES_CSV, text.getvalue().encode())
        manifest, receiver = self.source.file.manifest, self._receiver()
        record = ResponsesRecord(
            dataset=manifest.name, version=manifest.version, toolkit_version=__version__,
            manifest_sha256=self.source.file.sha256, sample_rate=self.settings.sample_rate,
            channels=tuple(receiver.channel_names), engine=self.engine.backend(receiver).describe(),
            attributions=tuple(a for a in manifest_attributions(self.source.file) if a.asset.startswith("scan:")),
            meshes=self.meshes, spaces=tuple(self.spaces),
        )  # fmt: skip
        write_json(self.folder / ACOUSTICS_JSON, record)
        return record

    def _receiver(self) -> Any:
        from generators.acoustics.tracer.receivers.ambisonics import Ambisonics
        from generators.acoustics.tracer.receivers.microphones import Omni
        from generators.acoustics.tracer.receivers.spherical import SphericalHead

        makers: dict[str, Callable[[], Any]] = {"omni": Omni, "binaural": SphericalHead, "foa": partial(Ambisonics, 1)}
        return makers[self.settings.receiver]()

    def _write_mesh(self, home: str, mesh: AcousticMesh) -> str:
        """The surfaces that sound meets, and the materials of their faces."""
        path = f"{home}/mesh.ply"
        faces = np.concatenate(list(mesh.groups.values()))
        write_ply_mesh(self.folder / path, mesh.vertices.astype(np.float32), faces.astype(np.int32))
        found, first = [], 0
        for label, some in mesh.groups.items():
            spectra = {name: material_for(scaled_label(label, scale)) for name, scale in self.materials.items()}
            found.append(
                {"material": label, "first_face": first, "faces": len(some),
                 "scattering": list(material_for(label).scattering),
                 "absorption": {name: list(one.in_situ) for name, one in spectra.items()}}
            )  # fmt: skip
            first += len(some)
        octaves = [int(octave) for octave in OCTAVE_BANDS]
        write_json(self.folder / home / _MATERIALS, {"octaves": octaves, "faces": found})
        return path

    def _write_room(self, name: str, room: str, home: HomeScene, mesh: AcousticMesh, home_split: ResponseSplit) -> None:
        where = f"{name}/{room}"
        rng = derive_rng(self.seed, where, "responses: positions")
        positions = draw_positions(home.site(room).space, where, self.settings, rng)
        pictures = self._write_pictures(where, room, home, positions) if self.settings.pictures else None
        for number, (material, scale) in enumerate(self.materials.items()):
            labels = tuple(scaled_label(label, scale) for label in mesh.labels)
            responses = self._responses(Room(where, mesh.triangles, labels), positions)
            folder = self.folder / where / material
            space = AcousticSpace(
                home=name, room=room, material=material, absorption=scale, sources=_points(positions.sources),
                listeners=_points(positions.listeners), headings=tuple(positions.headings.tolist()),
                test_listeners=tuple(np.flatnonzero(positions.test).tolist()), home_split=home_split,
                material_split="test" if 0 < number == len(self.materials) - 1 else "train", shards=(),
                pictures=pictures,
            )  # fmt: skip
            figures: list[dict[str, float | None]] = []
            shards = write_webdataset(_measured(responses, figures), folder, per_shard=_PER_SHARD)
            names = tuple(shard.relative_to(self.folder).as_posix() for shard in shards)
            self.spaces.append(space.model_copy(update={"shards": names}))
            self.rows += _rows(self.spaces[-1], figures)

    def _responses(self, room: Room, positions: Positions) -> Iterator[Rir]:
        count = len(positions.sources) * len(positions.listeners)
        poses = [
            Pose.from_yaw(place, math.radians(heading))
            for place, heading in zip(positions.listeners, positions.headings, strict=True)
        ]
        return self.engine.responses(
            room, list(positions.sources), poses, receiver=self._receiver(), sample_rate=self.settings.sample_rate,
            processes=self.workers if count >= _FEW else 1, progress=self.settings.progress,
        )  # fmt: skip

    def _write_pictures(self, where: str, room: str, home: HomeScene, positions: Positions) -> str:
        """Pictures from listeners spread over the room, and their cameras in the form of NeRF's transforms.json."""
        folder, size = f"{where}/pictures", self.settings.size
        camera = Intrinsics.from_fov(size)
        chosen = np.linspace(0, len(positions.listeners) - 1, self.settings.pictures).round().astype(int)
        frames = []
        with Renderer(home, room=room) as renderer:
            for number, listener in enumerate(chosen):
                pose = Pose.from_yaw(positions.listeners[listener], number * _TURN % (2 * math.pi))
                name = f"frame_{number:03d}.png"
                write_png_rgb(self.folder / folder / name, renderer.frame(pose, camera).rgb)
                frames.append({"file_path": name, "transform_matrix": pose.matrix, "listener": int(listener)})
        write_json(
            self.folder / folder / _TRANSFORMS,
            {"camera_model": "PINHOLE", "w": size, "h": size, "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx,
             "cy": camera.cy, "frames": frames},
        )  # fmt: skip
        return folder


def _points(points: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in points)


def _measured(responses: Iterable[Rir], figures: list[dict[str, float | None]]) -> Iterator[Rir]:
    """The responses as they come; their figures are appended to a list, of the energy of all channels."""
    for rir in responses:
        energy = np.square(rir.samples.astype(np.float64)).sum(axis=0)
        figures.append(decay_figures(np.sqrt(energy), rir.sample_rate))
        yield rir


def _rows(space: AcousticSpace, figures: list[dict[str, float | None]]) -> Iterator[tuple[object, ...]]:
    """Rows of the table, in the order of the responses."""
    count = len(space.listeners)
    for number, found in enumerate(figures):
        source, listener = divmod(number, count)
        places = space.sources[source], space.listeners[listener]
        values = ("" if found[name] is None else f"{found[name]:.4f}" for name in ("T60", "T30", "EDT", "C50"))
        yield (
            space.shards[number // _PER_SHARD], f"{number:08d}", space.home, space.room, space.material, source,
            listener, *places[0], *places[1], space.headings[listener], f"{math.dist(*places):.4f}",
            *(space.split(by, listener) for by in SPLITS_BY), *values,
        )  # fmt: skip
