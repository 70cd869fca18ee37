"""Encodes the files of one observation and hands them to an output: a folder, or a tar file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import colmap, files, layout, media, ply
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.schema import CameraSplits, ObservationRecord
from generators.core.scene import Mesh
from generators.recording.hearing import Recording
from generators.recording.output import ObservationOutput
from generators.recording.surface_points import SurfacePoints
from generators.vision.base import RenderedView


class ObservationWriter:
    """A context: inside it the observation has a temporary name; `finish` gives it its own.

    Leaving the context without `finish` (an error, an interrupt) removes what was written. Files that the output does
    not keep are not encoded.

    Args:
        output: where the files go.
        depth: write ``depth/``.
        rirs: write ``rirs/``.
        receivers: those beside the two ears whose clips (and responses) are written → number of their channels.
    """

    def __init__(
        self,
        output: ObservationOutput,
        *,
        depth: bool = False,
        rirs: bool = False,
        receivers: Mapping[str, int] | None = None,
    ) -> None:
        self._output = output
        self._depth = depth
        self._rirs = rirs
        self._channels = dict(receivers or {})
        self._frames = 0
        self._shared: dict[str, str] = {}

    def __enter__(self) -> Self:
        self._output.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._output.close()

    def keeps(self, name: str) -> bool:
        """Whether a file of that name is part of the output."""
        return self._output.keeps(name)

    def share_pictures(self, sibling: Path) -> None:
        """Take over all that siblings and variants share from a finished one; ``sibling``: see `ObservationOutput`."""
        self._shared = self._output.share(sibling)

    def add_mask_of(self, index: int, instance: int) -> NDArray[np.bool_]:
        """Write the mask of frame ``index``, whose instance mask is there already.

        Args:
            index: of the frame.
            instance: id of the instance that the mask marks.

        Returns:
            The mask (H, W).
        """
        out, name = self._output, layout.image_path(layout.INSTANCE_MASKS, index)
        mask = media.read_png_ids(out.where(name), out.get(name)) == instance
        name = layout.image_path(layout.SEMANTIC_MASKS, index)
        out.put(name, media.encode_png_mask(out.where(name), mask))
        return np.asarray(mask)

    def add_pictures(self, index: int, frame: RenderedView, mask: NDArray[np.bool_] | None = None) -> None:
        """Write the pictures of frame ``index``, and its mask (H, W); several threads may write different frames."""
        out, picture = self._output, layout.image_path(layout.INPUT, index)
        out.put(picture, media.encode_png_rgb(out.where(picture), frame.rgb))
        again = layout.image_path(layout.IMAGES, index)
        if out.keeps(again):
            out.repeat(picture, again)
        if mask is not None:
            name = layout.image_path(layout.SEMANTIC_MASKS, index)
            out.put(name, media.encode_png_mask(out.where(name), mask))
        name = layout.image_path(layout.INSTANCE_MASKS, index)
        out.put(name, media.encode_png_ids(out.where(name), frame.instance_ids))
        if self._depth:
            name = layout.image_path(layout.DEPTH, index)
            out.put(name, media.encode_png_depth_mm(out.where(name), frame.depth))

    def add_sound(self, index: int, clip: NDArray[np.float32], response: NDArray[np.float32]) -> None:
        """Write the binaural clip (2, 44100) of frame ``index``, and its impulse response (2, n) if it is kept."""
        self.add_clip(index, clip)
        if self._rirs:
            self._put_response(layout.rir_path(index), response)

    def add_recordings(self, index: int, others: Mapping[str, Recording]) -> None:
        """Write what the other receivers hear in frame ``index``: clips, and impulse responses if they are kept."""
        for name, one in others.items():
            self._put_clip(layout.audio_path(layout.clips_folder(name), index), one.clip)
            if self._rirs:
                self._put_response(layout.rir_path(index, receiver=name), one.response, self._channels[name])

    def add_clip(self, index: int, clip: NDArray[np.float32]) -> None:
        """Write the binaural clip (2, 44100) of frame ``index``."""
        self._put_clip(layout.audio_path(layout.BINAURAL, index), clip)
        self._frames = max(self._frames, index + 1)

    def add_mono(self, index: int, clip: NDArray[np.float32]) -> None:
        """Write the 2 s mono clip (88200,) of frame ``index``."""
        self._put_clip(layout.audio_path(layout.MONO, index), clip)

    def add_model(self, intrinsics: Intrinsics, poses: Sequence[Pose], points: SurfacePoints) -> None:
        """Write ``sparse/0``: the true cameras and the surface points with their tracks, Y down."""
        names = [f"{layout.frame_name(index)}.png" for index in range(len(poses))]
        model = colmap.ColmapModel.from_poses(
            intrinsics,
            names,
            poses,
            points.positions,
            points.colours,
            points.track_point,
            points.track_frame,
            points.track_pixel,
        )
        for name, data in colmap.encode_model(model).items():
            self._output.put(f"{layout.COLMAP}/{name}", data)

    def add_sounding_mesh(self, *meshes: Mesh) -> None:
        """Write ``gt_3d/sounding_object.ply``: the instances' meshes in world coordinates, equal corners welded."""
        name, out = layout.SOUNDING_OBJECT, self._output
        if not out.keeps(name):
            return
        corners = np.concatenate([mesh.positions.reshape(-1, 3) for mesh in meshes])
        vertices, index = np.unique(corners, axis=0, return_inverse=True)
        out.put(name, ply.encode_ply_mesh(out.where(name), vertices, index.reshape(-1, 3).astype(np.int32)))

    def finish(self, record: ObservationRecord) -> ObservationRecord:
        """Write the split and observation.json with sha256 and size of every file, and give all of it its name."""
        if self._output.keeps(layout.SPLITS_JSON):
            self._output.put(layout.SPLITS_JSON, files.dump_json(CameraSplits.of(self._frames)).encode())
        digests = dict(self._shared)
        sizes: dict[str, int] = {}
        names = [name for name in self._paths() if self._output.keeps(name)]
        for name in names:
            sizes[name] = self._output.size(name)
            if name not in digests and not name.startswith(f"{layout.IMAGES}/"):
                digests[name] = self._output.digest(name)
        for name in set(names) - set(digests):
            # images/ holds the pictures of input/ under a second name.
            digests[name] = digests[name.replace(layout.IMAGES, layout.INPUT, 1)]
        whole = record.model_copy(update={"files": digests, "sizes": sizes})
        self._output.finish(whole)
        return whole

    def _put_clip(self, name: str, clip: NDArray[np.float32]) -> None:
        if self._output.keeps(name):
            self._output.put(name, media.encode_wav(self._output.where(name), clip))

    def _put_response(self, name: str, response: NDArray[np.float32], channels: int = 2) -> None:
        if self._output.keeps(name):
            self._output.put(name, media.encode_rir(self._output.where(name), response, channels=channels))

    def _paths(self) -> tuple[str, ...]:
        """Every file that the observation must have, relative to its folder."""
        return layout.expected_files(self._frames, depth=self._depth, rirs=self._rirs, receivers=self._channels)
