"""Facts for the page of an observation, gathered from a dataset of ours or from the official release as it is.

What the data does not tell is None here, and a line in `PageFacts.missing` says so on the page. Time runs at one frame
a second: frame k (in the order of names) is shown during [k, k + 1) s, while its clip is heard.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AttributionRecord, InstanceRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.inspector.details import list_details, list_licences
from avs3d_bench.inspector.moments import Moment
from avs3d_bench.inspector.sound import read_clip
from avs3d_bench.inspector.sources import ShownSound, read_sound
from avs3d_bench.measures.levels import ild_db, level_db

#: The object fills at most this share of a thumbnail, so that something of the room is seen.
_BEST_SHARE = 0.2
#: Degrees to either side within which the object is not at the edge of the picture.
_AHEAD = 25.0
#: Messages about single files before a page only counts them.
NAMED = 5


@dataclass(frozen=True)
class PageFacts:
    """All that a page says about an observation but its submissions.

    Attributes:
        key: of the observation.
        place: the key's pieces.
        category: of the sounding object; None in the official release.
        moments: the frames in the order of time.
        instances: placed objects, sorted by id; empty in the official release.
        moving: ids of the instances that move.
        t30: reverberation time, seconds.
        details: (term, text) pairs for the list of facts.
        notes: the generator's remarks.
        licences: of every asset that this observation holds.
        missing: one line for each thing that the data does not have.
        problems: one line, with its path, for each file that cannot be read.
        hfov: horizontal field of view, degrees; None where no camera can be read.
        has_masks: there are masks of the sounding object.
        has_instances: there are instance masks.
        has_sound: there are binaural clips.
        has_map: there is a sparse model or a path to draw.
        has_ambisonics: there are ambisonic clips.
        sound: its sources; None in the official release.
    """

    key: str
    place: layout.ObservationKey
    category: str | None
    moments: tuple[Moment, ...]
    instances: tuple[InstanceRecord, ...]
    moving: tuple[int, ...]
    t30: float | None
    details: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    licences: tuple[AttributionRecord, ...]
    missing: tuple[str, ...]
    problems: tuple[str, ...]
    hfov: float | None
    has_masks: bool
    has_instances: bool
    has_sound: bool
    has_map: bool
    sound: ShownSound | None = None
    has_ambisonics: bool = False

    @property
    def moves(self) -> bool:
        """Whether any object moves."""
        return bool(self.moving)

    @property
    def ways(self) -> tuple[tuple[tuple[float, float, float], ...], ...]:
        """The places of each source that moves, in each frame."""
        if self.sound is None:
            return ()
        return tuple(source.places for source in self.sound.sources if source.record.instance in self.moving)

    @property
    def lanes(self) -> ShownSound | None:
        """The sound where each source is shown for itself; None where one always sounds, or nothing is known."""
        return None if self.sound is None or self.sound.always else self.sound

    def is_twin(self, instance: InstanceRecord) -> bool:
        """Whether an instance is silent and has the category of one that sounds."""
        return not instance.sounding and any(i.sounding and i.category == instance.category for i in self.instances)


def read_facts(dataset: Dataset, observation: Observation) -> PageFacts:
    """Gather what the page shows; the sound is measured where no record says how loud it is.

    Raises:
        Avs3dError: if the observation has no frames, or observation.json or camera_splits.json is damaged.
    """
    record, folder = observation.record, observation.path
    missing: list[str] = []
    problems: list[str] = []
    if record is None:
        missing.append(
            "No observation.json (as in the official release): category, source, azimuth, distance, T30 and licences "
            "are not known."
        )
    has_masks = _has(folder / layout.SEMANTIC_MASKS, "*.png", "No semantic_masks/: no overlay of the truth.", missing)
    has_instances = _has(folder / layout.INSTANCE_MASKS, "*.png", "No instance_masks/: no overlay of them.", missing)
    has_sound = _has(folder / layout.BINAURAL, "*.wav", "No audio_clips_binaural/: the player is silent.", missing)
    hfov = _field_of_view(observation, missing, problems)
    moments = tuple(_measured(observation, hfov is not None, has_sound, has_masks, problems))
    sound = read_sound(observation)
    return PageFacts(
        key=observation.key,
        place=observation.place,
        category=observation.category,
        moments=moments,
        instances=tuple(sorted(record.instances, key=lambda i: i.id)) if record else (),
        moving=record.moving_instances if record else (),
        t30=record.acoustics.t30 if record else None,
        details=list_details(dataset, observation, moments, hfov, sound),
        notes=tuple(n for n in (*record.notes, record.acoustics.notes) if n) if record else (),
        licences=list_licences(dataset, observation),
        missing=tuple(missing),
        problems=tuple(problems),
        hfov=hfov,
        has_masks=has_masks,
        has_instances=has_instances,
        has_sound=has_sound,
        has_ambisonics=record is not None and record.acoustics.ambisonics is not None,
        has_map=any(moment.position for moment in moments),
        sound=sound,
    )


def _has(folder: Path, pattern: str, line: str, missing: list[str]) -> bool:
    found = any(folder.glob(pattern))
    if not found:
        missing.append(line)
    return found


def _field_of_view(observation: Observation, missing: list[str], problems: list[str]) -> float | None:
    """Horizontal, degrees; None where there is no camera, and hence no pose: no record and no sparse model."""
    if observation.record is None and not (observation.path / layout.COLMAP).is_dir():
        missing.append(f"No {layout.COLMAP}/: no poses, hence no map.")
        return None
    try:
        camera = observation.intrinsics
    except Avs3dError as error:
        problems.append(str(error))
        return None
    return 2 * math.degrees(math.atan2(camera.width / 2, camera.fx))


def few(observation: Observation, problems: Iterable[str]) -> list[str]:
    """Each problem once; where they are many, the first `NAMED` and how many more."""
    lines = list(dict.fromkeys(problems))
    if len(lines) > NAMED + 1:
        lines[NAMED:] = [f"{observation.path}: {len(lines) - NAMED} more files cannot be shown"]
    return lines


def without_path(observation: Observation, line: str) -> str:
    """A message without the path down to the observation: pages say nothing of the disk they were made on."""
    return line.replace(f"{observation.path}/", "").replace(str(observation.path), observation.key)


def _measured(
    observation: Observation, poses: bool, has_sound: bool, has_masks: bool, problems: list[str]
) -> Iterable[Moment]:
    whole = observation.record
    always = whole is not None and whole.sources is None
    # Direction and distance are those of the first source, which says little where there are several.
    alone = whole is not None and len(whole.sound_sources) == 1
    for frame in observation.frames:
        record = frame.record
        first = record if alone else None
        sound, visible = None, None
        if record is not None:
            sound, visible = (record.rms_left, record.rms_right), record.visible_pixels
            if not always and not any(sound):
                sound = None  # silence has no level
        else:
            try:
                sound = _rms(read_clip(frame)) if has_sound else None
            except Avs3dError as error:
                problems.append(str(error))
            try:
                visible = int(frame.mask().sum()) if has_masks else None
            except Avs3dError as error:
                problems.append(str(error))
        pose = frame.pose if poses and frame.has_pose else None
        ahead = pose.rotation_matrix @ np.array([0.0, 0.0, -1.0]) if pose else None
        yield Moment(
            name=frame.name,
            split=frame.split,
            position=pose.position if pose else None,
            heading=_flat(ahead) if ahead is not None else None,
            source=whole.source_at(record) if whole and record and always else None,
            azimuth=first.azimuth if first else None,
            distance=first.distance if first else None,
            line_of_sight=first.line_of_sight if first else None,
            ild=ild_db(*sound) if sound else None,
            level=level_db(*sound) if sound else None,
            visible=visible,
        )


def _rms(clip: NDArray[np.float32]) -> tuple[float, float]:
    left, right = np.sqrt(np.mean(np.square(clip.astype(np.float64)), axis=1))
    return float(left), float(right)


def _flat(ahead: NDArray[np.float64]) -> tuple[float, float]:
    """The horizontal direction of a vector, of unit length."""
    length = math.hypot(ahead[0], ahead[2])
    return (float(ahead[0] / length), float(ahead[2] / length)) if length > 1e-9 else (0.0, -1.0)


def best_frames(observation: Observation) -> list[Frame]:
    """All frames, the one that shows the object best first: ahead, and as large as it gets up to a fifth of the frame.

    Without a record the test frames' masks are looked at; without masks the middle frame is first.

    Raises:
        Avs3dError: if there are no frames.
    """
    frames = observation.frames
    middle = len(frames) // 2
    limit, sizes, aside = math.inf, {}, set()
    if observation.record is not None:
        camera = observation.record.intrinsics
        limit = _BEST_SHARE * camera.width * camera.height
        sizes = {frame.name: frame.visible_pixels for frame in observation.record.frames}
        aside = {f.name for f in observation.record.frames if f.azimuth is not None and abs(f.azimuth) > _AHEAD}
    elif (observation.path / layout.SEMANTIC_MASKS).is_dir():
        for frame in observation.test or frames:
            with suppress(Avs3dError):
                mask = frame.mask()
                limit, sizes[frame.name] = _BEST_SHARE * mask.size, int(mask.sum())

    def rank(entry: tuple[int, Frame]) -> tuple[int, int, int]:
        at, frame = entry
        size = sizes.get(frame.name, 0)
        if 0 < size <= limit:
            return int(frame.name in aside), -size, at
        # Rather too large than out of view; and the same order on every run.
        return (2, size, at) if size > 0 else (3, abs(at - middle), at)

    return [frame for _, frame in sorted(enumerate(frames), key=rank)]
