"""The record of one scored frame: a row of the table that `avs3d-eval --frames FILE` writes.

A row has what was scored, the counts and figures of the mask, and the factors on which they may depend: how large and
where the object is, how reverberant and noisy the sound, which silent objects of the category stand about. A value that
the data cannot give is null, with the reason in `unavailable`; no value is guessed.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from avs3d_bench.contract.schema import FrameName, NonNegative, Record, Room, Scan, Sha256, Text
from avs3d_bench.contract.scores import Count, PartName, ProtocolVersion, Share

#: Version of the columns. It changes when one is added, removed or means something else.
FRAMES_VERSION: Final = "1.0"


class FrameRow(Record):
    """One test frame of one observation under ``strict`` (part_1, part_2) or ``listen`` (part_3).

    The source of a frame is the sounding object; in part_3, it is the loudest audible source of the frame.
    """

    frames_version: Literal["1.0"] = Field(default="1.0", description="version of the columns")
    method: Text = Field(description="name of the method, from submission.json")
    dataset: Text = Field(description="name of the dataset")
    dataset_sha256: Sha256 | None = Field(description="sha256 of dataset.json; null in the official release")
    protocol: Literal["strict", "listen"]
    protocol_version: ProtocolVersion
    key: Text = Field(description="key of the observation")
    part: PartName
    scan: Scan
    room: Room
    group: Text | None = Field(description="in part_3 key of the observation whose pictures this one has, else null")
    frame: FrameName

    pixels: Annotated[int, Field(ge=1)] = Field(description="pixels of the picture")
    truth_pixels: Count = Field(description="pixels of the true mask")
    predicted_pixels: Count = Field(description="marked pixels")
    overlap_pixels: Count = Field(description="pixels of both")
    IoU: Share | None = Field(description="of mask and truth; null where there is nothing to mark")
    F: Share | None = Field(description="F (β² = 0.3) of the mask; null where there is nothing to mark")
    boundary_F: Share | None = Field(  # noqa: N815 - the key of the figure in a file of scores
        description="F of the outlines; null where there is nothing to mark, and in part_3"
    )
    twins_visible: Count | None = Field(description="silent twins in view; null in part_1 and part_3, and if unknown")
    twins_marked: Count | None = Field(description="of these, how many are marked for more than half; null likewise")
    pairs: Count | None = Field(description="siblings whose truth differs in this frame; null but in part_3")
    pairs_right: Count | None = Field(description="of these pairs, how many are right; null but in part_3")

    category: Text | None = Field(description="category of the source")
    visible_share: Share = Field(description="truth_pixels / pixels")
    distance_m: NonNegative | None = Field(description="distance to the source, metres")
    azimuth_deg: Annotated[float, Field(ge=-180, le=180)] | None = Field(
        description="azimuth of the source, degrees; 0 ahead, positive to the right"
    )
    elevation_deg: Annotated[float, Field(ge=-90, le=90)] | None = Field(
        description="elevation of the source, degrees; positive up"
    )
    t30_s: NonNegative | None = Field(description="reverberation time of the room, seconds")
    drr_db: float | None = Field(description="direct sound over reverberation, dB")
    snr_db: float | None = Field(description="level of the source over the rest of the clip, dB; only in part_3")
    twins: Count | None = Field(description="objects of the source's category in the room that are silent")
    twin_distance_m: NonNegative | None = Field(
        description="distance from the source to the middle of the nearest of them, metres"
    )
    unavailable: dict[str, Text] = Field(default_factory=dict, description="factor that is null → reason")


#: The columns of the table, in order.
COLUMNS: tuple[str, ...] = tuple(FrameRow.model_fields)
