"""Writes one observation: everything into a temporary folder beside its place, renamed when it is whole.

Every attempt has a temporary folder of its own, since an attempt that a scheduler thinks lost may still be at work on
another machine. Who is second finds the place taken by the same bytes, and throws its copy away.
"""

from __future__ import annotations

import os
import secrets
import shutil
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import colmap, files, layout, media, ply
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.schema import CameraSplits, ObservationRecord
from generators.core.scene import Mesh
from generators.recording.hearing import Recording
from generators.recording.surface_points import SurfacePoints
from generators.vision.base import Frame


def sweep(root: Path) -> None:
    """Remove what interrupted attempts left below a dataset's folder.

    Each is renamed before it is deleted: an attempt that still runs somewhere can then no longer give its name to a
    folder that is half gone.
    """
    for partial in root.glob("part_*/*/*/.*.partial"):
        doomed = hidden_name(partial, "swept")
        with suppress(OSError):
            partial.rename(doomed)
        shutil.rmtree(doomed, ignore_errors=True)


def hidden_name(folder: Path, what: str) -> Path:
    """A name beside ``folder`` that no other process or attempt uses."""
    stem = folder.name.strip(".").partition(".")[0]
    host = socket.gethostname().partition(".")[0]
    return folder.with_name(f".{stem}.{what}-{host}-{os.getpid()}-{secrets.token_hex(4)}.partial")


class ObservationWriter:
    """A context: inside it the observation lies in ``.<index>.<attempt>.partial``; `finish` gives it its name.

    Leaving the context without `finish` (an error, an interrupt) removes the temporary folder.

    Args:
        folder: the observation's final folder.
        depth: write ``depth/``.
        rirs: write ``rirs/``.
        receivers: those beside the two ears whose clips (and responses) are written → number of their channels.
    """

    def __init__(
        self, folder: Path, *, depth: bool = False, rirs: bool = False, receivers: Mapping[str, int] | None = None
    ) -> None:
        self._final = folder
        self._partial = hidden_name(folder, "new")
        self._depth = depth
        self._rirs = rirs
        self._channels = dict(receivers or {})
        self._frames = 0

    @property
    def folder(self) -> Path:
        """Where the files lie until `finish`."""
        return self._partial

    def __enter__(self) -> Self:
        try:
            self._partial.mkdir(parents=True)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, self._final, "write")) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._partial, ignore_errors=True)

    def add_pictures(self, index: int, frame: Frame, mask: NDArray[np.bool_] | None = None) -> None:
        """Write the pictures of frame ``index``, and its mask (H, W); several threads may write different frames."""
        here = self._partial
        picture = here / layout.image_path(layout.INPUT, index)
        media.write_png_rgb(picture, frame.rgb)
        files.link_or_copy(picture, here / layout.image_path(layout.IMAGES, index))
        if mask is not None:
            media.write_png_mask(here / layout.image_path(layout.SEMANTIC_MASKS, index), mask)
        media.write_png_ids(here / layout.image_path(layout.INSTANCE_MASKS, index), frame.instance_ids)
        if self._depth:
            media.write_png_depth_mm(here / layout.image_path(layout.DEPTH, index), frame.depth)

    def add_sound(self, index: int, clip: NDArray[np.float32], response: NDArray[np.float32]) -> None:
        """Write the binaural clip (2, 44100) of frame ``index``, and its impulse response (2, n) if it is kept."""
        self.add_clip(index, clip)
        if self._rirs:
            media.write_rir(self._partial / layout.rir_path(index), response)

    def add_recordings(self, index: int, others: Mapping[str, Recording]) -> None:
        """Write what the other receivers hear in frame ``index``: clips, and impulse responses if they are kept."""
        for name, one in others.items():
            media.write_wav(self._partial / layout.audio_path(layout.clips_folder(name), index), one.clip)
            if self._rirs:
                path = self._partial / layout.rir_path(index, receiver=name)
                media.write_rir(path, one.response, channels=self._channels[name])

    def add_clip(self, index: int, clip: NDArray[np.float32]) -> None:
        """Write the binaural clip (2, 44100) of frame ``index``."""
        media.write_wav(self._partial / layout.audio_path(layout.BINAURAL, index), clip)
        self._frames = max(self._frames, index + 1)

    def add_mono(self, index: int, clip: NDArray[np.float32]) -> None:
        """Write the 2 s mono clip (88200,) of frame ``index``."""
        media.write_wav(self._partial / layout.audio_path(layout.MONO, index), clip)

    def add_model(self, intrinsics: Intrinsics, poses: Sequence[Pose], points: SurfacePoints) -> None:
        """Write ``sparse/0``: the true cameras and the surface points with their tracks, Y down."""
        names = [f"{layout.frame_name(index)}.png" for index in range(len(poses))]
        colmap.write_model(
            self._partial / layout.COLMAP,
            colmap.ColmapModel.from_poses(
                intrinsics,
                names,
                poses,
                points.positions,
                points.colours,
                points.track_point,
                points.track_frame,
                points.track_pixel,
            ),
        )

    def add_sounding_mesh(self, *meshes: Mesh) -> None:
        """Write ``gt_3d/sounding_object.ply``: the instances' meshes in world coordinates, equal corners welded."""
        corners = np.concatenate([mesh.positions.reshape(-1, 3) for mesh in meshes])
        vertices, index = np.unique(corners, axis=0, return_inverse=True)
        ply.write_ply_mesh(self._partial / layout.SOUNDING_OBJECT, vertices, index.reshape(-1, 3).astype(np.int32))

    def finish(self, record: ObservationRecord) -> ObservationRecord:
        """Write the split and observation.json with sha256 and size of every file, and give the folder its name."""
        files.write_json(self._partial / layout.SPLITS_JSON, CameraSplits.of(self._frames))
        digests = self._known_digests()
        sizes: dict[str, int] = {}
        paths = self._paths()
        for path in paths:
            sizes[path] = (self._partial / path).stat().st_size
            if path not in digests and not path.startswith(f"{layout.IMAGES}/"):
                digests[path] = files.sha256_file(self._partial / path)
        for path in set(paths) - set(digests):
            # images/ holds the pictures of input/ under a second name.
            digests[path] = digests[path.replace(layout.IMAGES, layout.INPUT, 1)]
        whole = record.model_copy(update={"files": digests, "sizes": sizes})
        files.write_json(self._partial / layout.OBSERVATION_JSON, whole)
        try:
            self._partial.rename(self._final)
        except OSError as error:
            if not self._is_there(whole):
                raise Avs3dError(files.os_error_line(error, self._final, "write")) from error
        return whole

    def _paths(self) -> tuple[str, ...]:
        """Every file that the observation must have, relative to its folder."""
        return layout.expected_files(self._frames, depth=self._depth, rirs=self._rirs, receivers=self._channels)

    def _known_digests(self) -> dict[str, str]:
        """Path → sha256 of the files whose contents need not be read again."""
        return {}

    def _is_there(self, record: ObservationRecord) -> bool:
        """Whether another attempt at the same plan has come first."""
        path = self._final / layout.OBSERVATION_JSON
        try:
            return files.read_record(path, ObservationRecord) == record
        except Avs3dError:
            return False
