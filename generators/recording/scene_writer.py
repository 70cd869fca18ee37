"""Writes one observation of part_3: pictures of its own or those of a sibling, and what its sound adds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from generators.acoustics.clips import check_clip
from generators.recording.hearing import Recording
from generators.recording.output import ObservationOutput
from generators.recording.stems import mixture
from generators.recording.writer import ObservationWriter


class SceneWriter(ObservationWriter):
    """See `ObservationWriter`.

    Args:
        output: where the files go.
        contents: what decides which files it has.
        depth: write ``depth/``.
        rirs: write ``rirs/``.
        receivers: see `ObservationWriter`.
    """

    def __init__(
        self,
        output: ObservationOutput,
        contents: layout.SoundScene,
        *,
        depth: bool = False,
        rirs: bool = False,
        receivers: Mapping[str, int] | None = None,
    ) -> None:
        super().__init__(output, depth=depth, rirs=rirs, receivers=receivers)
        self._contents = contents

    def add_response(self, index: int, source: str, response: NDArray[np.float32]) -> None:
        """Write the impulse response (2, n) from a source to frame ``index``, if responses are kept."""
        if self._rirs:
            self._put_response(layout.rir_path(index, source), response)

    def add_others(self, index: int, sources: Mapping[str, Mapping[str, Recording]], where: str) -> None:
        """Write what the receivers beside the two ears hear of all sources in frame ``index``, without the background.

        Args:
            index: of the frame.
            sources: id of each source → name of a receiver → what it hears of the source.
            where: names the frame in messages.

        Raises:
            Avs3dError: if a clip exceeds full scale or is not finite.
        """
        for name, channels in self._channels.items():
            heard = {source: recordings[name] for source, recordings in sources.items()}
            clip = mixture([one.clip for one in heard.values()], channels)
            self._write_other(name, index, clip, where)
            for source, one in heard.items():
                if self._rirs:
                    self._put_response(layout.rir_path(index, source, name), one.response, channels)
                if source in self._contents.stem_names:
                    self._put_clip(layout.stem_path(source, index, name), one.clip)

    def add_other_background(self, index: int, noise: Mapping[str, NDArray[np.float32]], where: str) -> None:
        """Add the background of a frame to the clips that `add_others` wrote.

        Args:
            index: of the frame.
            noise: name of a receiver → (channels, 44100).
            where: names the frame in messages.
        """
        for name, samples in noise.items():
            path = layout.audio_path(layout.clips_folder(name), index)
            clip = media.read_wav(self._output.where(path), self._output.get(path)).samples
            self._write_other(name, index, mixture([clip, samples], len(samples)), where)
            if layout.BACKGROUND in self._contents.stem_names:
                self._put_clip(layout.stem_path(layout.BACKGROUND, index, name), samples)

    def _write_other(self, name: str, index: int, clip: NDArray[np.float32], where: str) -> None:
        check_clip(clip, f"{where}, {name}", silence=True)
        self._put_clip(layout.audio_path(layout.clips_folder(name), index), clip)

    def add_stems(self, index: int, stems: Mapping[str, NDArray[np.float32]]) -> None:
        """Write the stems (2, 44100) of frame ``index``, by their name, if stems are kept."""
        for name in self._contents.stem_names:
            self._put_clip(layout.stem_path(name, index), stems[name])

    def add_masks(self, index: int, table: NDArray[np.uint8]) -> int:
        """Write the masks of frame ``index``, whose instance mask is there already.

        Args:
            index: of the frame.
            table: (instances + 1,) instance id → class id if the instance is audible in this frame, else 0.

        Returns:
            The number of marked pixels.
        """
        out, name = self._output, layout.image_path(layout.INSTANCE_MASKS, index)
        ids = media.read_png_ids(out.where(name), out.get(name))
        kinds = table[ids]
        mask = kinds > 0
        name = layout.image_path(layout.SEMANTIC_MASKS, index)
        out.put(name, media.encode_png_mask(out.where(name), mask))
        name = layout.image_path(layout.CATEGORY_MASKS, index)
        out.put(name, media.encode_png_categories(out.where(name), kinds))
        return int(np.count_nonzero(mask))

    def _paths(self) -> tuple[str, ...]:
        return layout.expected_files(
            self._frames,
            depth=self._depth,
            rirs=self._rirs,
            sound_scene=self._contents,
            receivers=self._channels,
        )
