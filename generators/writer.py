"""Writes one observation: everything into a temporary folder beside its place, renamed when it is whole."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import colmap, files, layout, media, ply
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.schema import CameraSplits, ObservationRecord
from generators.scenes.scene import Mesh
from generators.surface_points import SurfacePoints
from generators.vision.base import Frame


class ObservationWriter:
    """A context: inside it the observation lies in ``.<index>.partial``; `finish` gives it its name.

    Leaving the context without `finish` (an error, an interrupt) removes the temporary folder.

    Args:
        folder: the observation's final folder; must not exist.
        depth: write ``depth/``.
        rirs: write ``rirs/``.
    """

    def __init__(self, folder: Path, *, depth: bool = False, rirs: bool = False) -> None:
        self._final = folder
        self._partial = folder.parent / f".{folder.name}.partial"
        self._depth = depth
        self._rirs = rirs
        self._frames = 0

    def __enter__(self) -> Self:
        try:
            shutil.rmtree(self._partial, ignore_errors=True)
            self._partial.mkdir(parents=True)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, self._final, "write")) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._partial, ignore_errors=True)

    def add_frame(
        self,
        index: int,
        frame: Frame,
        mask: NDArray[np.bool_],
        clip: NDArray[np.float32],
        response: NDArray[np.float32],
    ) -> None:
        """Write everything of frame ``index`` but its mono clip: ``clip`` is (2, 44100), ``response`` (2, n)."""
        here = self._partial
        picture = here / layout.image_path(layout.INPUT, index)
        media.write_png_rgb(picture, frame.rgb)
        files.link_or_copy(picture, here / layout.image_path(layout.IMAGES, index))
        media.write_png_mask(here / layout.image_path(layout.SEMANTIC_MASKS, index), mask)
        media.write_png_ids(here / layout.image_path(layout.INSTANCE_MASKS, index), frame.instance_ids)
        media.write_wav(here / layout.audio_path(layout.BINAURAL, index), clip)
        if self._depth:
            media.write_png_depth_mm(here / layout.image_path(layout.DEPTH, index), frame.depth)
        if self._rirs:
            media.write_rir(here / layout.rir_path(index), response)
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

    def add_sounding_mesh(self, mesh: Mesh) -> None:
        """Write ``gt_3d/sounding_object.ply``: the instance's mesh in world coordinates, equal corners welded."""
        corners = mesh.positions.reshape(-1, 3)
        vertices, index = np.unique(corners, axis=0, return_inverse=True)
        ply.write_ply_mesh(self._partial / layout.SOUNDING_OBJECT, vertices, index.reshape(-1, 3).astype(np.int32))

    def finish(self, record: ObservationRecord) -> ObservationRecord:
        """Write the split and observation.json with the sha256 of every file, and give the folder its name."""
        files.write_json(self._partial / layout.SPLITS_JSON, CameraSplits.of(self._frames))
        digests: dict[str, str] = {}
        paths = layout.expected_files(self._frames, depth=self._depth, rirs=self._rirs)
        for path in paths:
            if not path.startswith(f"{layout.IMAGES}/"):
                digests[path] = files.sha256_file(self._partial / path)
        for path in set(paths) - set(digests):
            # images/ holds the pictures of input/ under a second name.
            digests[path] = digests[path.replace(layout.IMAGES, layout.INPUT, 1)]
        whole = record.model_copy(update={"files": digests})
        files.write_json(self._partial / layout.OBSERVATION_JSON, whole)
        try:
            self._partial.rename(self._final)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, self._final, "write")) from error
        return whole
