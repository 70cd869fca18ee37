"""The cards of the gallery."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector import pictures
from avs3d_bench.inspector.sources import sound_kinds, sound_title


@dataclass(frozen=True)
class GalleryCard:
    """An observation in the gallery.

    Attributes:
        place: the key's pieces.
        category: of the sounding object; None if unknown or if there is none.
        frames: how many.
        seen: in how many of them the object is in view; None if unknown.
        twins: silent instances of the same category.
        t30: reverberation time, seconds.
        moves: whether the source moves.
        outline: SVG path of the object in the thumbnail, in a square of 1000 × 1000.
        problem: why the observation cannot be shown; None where it can.
        scene: what sounds, in part_3; None in the other parts.
        kinds: of the scene, see `sources.SOUND_KINDS`.
        categories: of everything that sounds.
        group: key of the observation of part_3 whose pictures this one has.
    """

    place: layout.ObservationKey
    category: str | None = None
    frames: int = 0
    seen: int | None = None
    twins: int = 0
    t30: float | None = None
    moves: bool = False
    outline: str = ""
    problem: str | None = None
    scene: str | None = None
    kinds: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()
    group: str | None = None


def read_card(observation: Observation, poster: Frame) -> GalleryCard:
    """The card of an observation.

    Args:
        observation: of a dataset of ours, or of the official release.
        poster: the frame of the thumbnail.

    Raises:
        Avs3dError: if observation.json or camera_splits.json is damaged.
    """
    place, frames, record = observation.place, observation.frames, observation.record
    _ = observation.splits
    outline = ""
    with suppress(Avs3dError):
        outline = pictures.outline_path(poster.mask())
    if record is None:
        return GalleryCard(place, frames=len(frames), outline=outline)
    seen = sum(frame.visible_pixels > 0 for frame in record.frames)
    if record.is_part_3:
        return GalleryCard(
            place,
            record.category,
            frames=len(frames),
            seen=seen,
            t30=record.acoustics.t30,
            outline=outline,
            scene=sound_title(record),
            kinds=sound_kinds(record),
            categories=tuple(sorted({source.category for source in record.sources or ()})),
            group=record.group,
        )
    twins = sum(i.category == record.category and not i.sounding for i in record.instances)
    return GalleryCard(
        place, record.category, len(frames), seen, twins, record.acoustics.t30, record.moves, outline
    )  # fmt: skip
