"""Encodes the files of one observation and hands them to an output: a folder, or a tar file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import CameraSplits, ObservationRecord
from avs3d_bench.formats import colmap, files, media, ply
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.scene import Mesh
from generators.observation.output import ObservationOutput
from generators.observation.surface_points import SurfacePoints
from generators.vision.base import RenderedView


class ObservationWriter:
    """A context: inside it the observation has a temporary name; `finish` gives it its own.

    Leaving the context without `finish` (an error, an interrupt) removes what was written. Files that the output does
    not keep are not encoded.

    Args:
        output: where the files go.
        contents: the facts that decide which files a part_3 observation has; None in the other parts, whose source has
            no name.
        depth: write ``depth/``.
        rirs: write ``rirs/``.
        receivers: those beside the two ears whose clips (and responses) are written → number of their channels.
    """

    def __init__(
        self,
        output: ObservationOutput,
        contents: layout.Part3Contents | None = None,
        *,
        depth: bool = False,
        rirs: bool = False,
        receivers: Mapping[str, int] | None = None,
    ) -> None:
        self._output = output
        self._contents = contents
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

    def keeps_frame(self, index: int) -> bool:
        """Whether the picture of frame ``index`` is part of the output."""
        return self.keeps(layout.image_path(layout.INPUT, index))

    def share_pictures(self, sibling: Path) -> None:
        """Take over all that siblings and variants share from a finished one; ``sibling``: see `ObservationOutput`."""
        self._shared = self._output.share(sibling)

    def add_pictures(self, index: int, frame: RenderedView) -> None:
        """Write the pictures of frame ``index``; several threads may write different frames."""
        out, picture = self._output, layout.image_path(layout.INPUT, index)
        out.put(picture, media.encode_png_rgb(out.where(picture), frame.rgb))
        again = layout.image_path(layout.IMAGES, index)
        if out.keeps(again):
            out.repeat(picture, again)
        name = layout.image_path(layout.INSTANCE_MASKS, index)
        out.put(name, media.encode_png_ids(out.where(name), frame.instance_ids))
        if self._depth:
            name = layout.image_path(layout.DEPTH, index)
            out.put(name, media.encode_png_depth_mm(out.where(name), frame.depth))

    def add_masks(self, index: int, classes: NDArray[np.uint8]) -> int:
        """Write the masks of frame ``index``, whose instance mask is there already.

        Args:
            index: of the frame.
            classes: (instances + 1,) instance id → class id if the instance is marked in this frame, else 0.

        Returns:
            The number of marked pixels.
        """
        out, name = self._output, layout.image_path(layout.INSTANCE_MASKS, index)
        kinds = classes[media.read_png_ids(out.where(name), out.get(name))]
        mask = kinds > 0
        name = layout.image_path(layout.SEMANTIC_MASKS, index)
        out.put(name, media.encode_png_mask(out.where(name), mask))
        if self._contents is not None:
            name = layout.image_path(layout.CATEGORY_MASKS, index)
            out.put(name, media.encode_png_categories(out.where(name), kinds))
        return int(np.count_nonzero(mask))

    def add_response(self, index: int, source: str, response: NDArray[np.float32], receiver: str | None = None) -> None:
        """Write the response (channels, n) from a source to frame ``index``, if responses are kept.

        Args:
            index: of the frame.
            source: id of the source.
            response: what the receiver hears of an impulse.
            receiver: its name; None: the two ears.
        """
        name = layout.rir_path(index, source if self._contents else None, receiver)
        if self._rirs and self.keeps(name):
            channels = self._channels[receiver] if receiver else 2
            self._output.put(name, media.encode_rir(self._output.where(name), response, channels=channels))

    def add_clip(self, index: int, clip: NDArray[np.float32], receiver: str | None = None) -> None:
        """Write the clip (channels, 44100) of frame ``index``; ``receiver``: None: the two ears."""
        self._put_clip(layout.audio_path(layout.clips_folder(receiver), index), clip)
        self._frames = max(self._frames, index + 1)

    def read_clip(self, index: int, receiver: str) -> NDArray[np.float32]:
        """The clip (channels, 44100) that `add_clip` wrote."""
        name = layout.audio_path(layout.clips_folder(receiver), index)
        return media.read_wav(self._output.where(name), self._output.get(name)).samples

    def add_stems(self, index: int, stems: Mapping[str, NDArray[np.float32]], receiver: str | None = None) -> None:
        """Write those of the stems (channels, 44100) of frame ``index`` that are kept.

        Args:
            index: of the frame.
            stems: name of a stem → its samples.
            receiver: that hears them; None: the two ears.
        """
        kept = self._contents.stem_names if self._contents else ()
        for name, clip in stems.items():
            if name in kept:
                self._put_clip(layout.stem_path(name, index, receiver), clip)

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

    def add_sounding_mesh(self, meshes: Mapping[int, Mesh], *, named: bool = False) -> None:
        """Write ``gt_3d/sounding_object.ply``: the instances' meshes in world coordinates, equal corners welded.

        Args:
            meshes: id of an instance → its mesh at time 0; the file is not written if there are none.
            named: whether vertices name their instance, as readers need where something moves.
        """
        name, out = layout.SOUNDING_OBJECT, self._output
        if not meshes or not out.keeps(name):
            return
        corners = np.concatenate([mesh.positions.reshape(-1, 3) for mesh in meshes.values()]).astype(np.float64)
        ids = np.repeat([*meshes], [3 * len(mesh.positions) for mesh in meshes.values()])
        rows = np.column_stack([corners, ids]) if named else corners
        found, index = np.unique(rows, axis=0, return_inverse=True)
        faces = index.reshape(-1, 3).astype(np.int32)
        instances = found[:, 3].astype(np.int32) if named else None
        out.put(name, ply.encode_ply_mesh(out.where(name), found[:, :3], faces, instances=instances))

    def add_top_view(self, rgb: NDArray[np.uint8]) -> None:
        """Write ``top_view.png`` from (H, W, 3) RGB."""
        name, out = layout.TOP_VIEW, self._output
        if out.keeps(name):
            out.put(name, media.encode_png_rgb(out.where(name), rgb))

    def finish(self, record: ObservationRecord) -> ObservationRecord:
        """Write the split and observation.json with sha256 and size of every file, and give all of it its name."""
        if self._output.keeps(layout.SPLITS_JSON):
            self._output.put(layout.SPLITS_JSON, files.dump_json(CameraSplits.of(self._frames)).encode())
        digests = dict(self._shared)
        sizes: dict[str, int] = {}
        names = [name for name in self._paths(record) if self._output.keeps(name)]
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

    def _paths(self, record: ObservationRecord) -> tuple[str, ...]:
        """Every file that the observation must have, relative to its folder."""
        return layout.expected_files(
            self._frames,
            depth=self._depth,
            rirs=self._rirs,
            part_3=self._contents,
            receivers=self._channels,
            top_view=record.top_view is not None,
        )
