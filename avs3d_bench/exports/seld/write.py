"""Write a dataset as recordings with labels, as data sets of sound event localisation and detection have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from avs3d_bench import __version__
from avs3d_bench.contract.schema import AttributionRecord, Record, RelativePath, Sha256, Text
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset, Observation, by_pictures
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.samples import select
from avs3d_bench.exports.seld.events import (
    LABELS_PER_SECOND,
    SeldEvent,
    TurningHead,
    event_classes,
    events_of,
    record_of,
    seconds_of,
)
from avs3d_bench.exports.seld.labels import foa_csv, stereo_csv
from avs3d_bench.exports.seld.maps import energy_maps, write_maps
from avs3d_bench.exports.seld.panorama import (
    USUAL_WIDTH,
    FaceRequest,
    Faces,
    check_width,
    clip_pictures,
    face_camera,
    face_side,
    find_renderer,
    panorama_rays,
    perspective_rays,
    write_film,
)
from avs3d_bench.exports.seld.recordings import (
    CLIP_SECONDS,
    FORMATS,
    SeldClip,
    SeldFormat,
    SeldScene,
    SeldSplit,
    plan_scenes,
)
from avs3d_bench.exports.seld.sound import SELD_RATE, ambisonics_track, check_ambisonics, ears_track, mid_side
from avs3d_bench.formats import media
from avs3d_bench.formats.files import link_or_copy
from avs3d_bench.formats.staging import staged_folder
from avs3d_bench.runtime.parallel import process_each

#: Provenance of an export, in its folder.
SELD_JSON = "seld.json"
Count = Annotated[int, Field(ge=0)]


class SeldFileRecord(Record):
    """One recording, or one clip of it."""

    left_out: ClassVar[frozenset[str]] = frozenset({"view_deg"})

    name: Text = Field(description="of its files, without a suffix")
    split: SeldSplit
    observation: Text = Field(description="key of the observation")
    group: Text = Field(description="key of the observation whose pictures this one has; its own if it is the first")
    start: Count = Field(description="its first second in the observation")
    label_frames: Count = Field(description="of 100 ms")
    events: Count = Field(description="rows of its labels")
    view_deg: Count | None = Field(
        default=None, description="direction in which a stereo clip looks, degrees to the right; absent in foa"
    )
    files: dict[RelativePath, Sha256] = Field(description="its files below the folder")


class SeldIndex(Record):
    """`seld.json`: what an export holds, and of what dataset."""

    format: SeldFormat
    toolkit_version: Text
    dataset: Text
    dataset_version: Text | None
    dataset_digest: Sha256 | None = Field(description="digest of dataset.json; null if it has none")
    licence: Text | None
    attributions: tuple[AttributionRecord, ...]
    sample_rate: Count
    channels: tuple[Text, ...]
    gain_db: float
    classes: dict[str, int] = Field(description="category → class index of the labels")
    recordings: tuple[SeldFileRecord, ...]


@dataclass(frozen=True)
class SeldSettings:
    """What is exported, and how.

    Attributes:
        form: ``foa``: ambisonics, the layout of STARSS23; ``stereo``: a coincident pair that looks in a drawn
            direction, the layout of DCASE 2025; ``binaural``: the same layout, the two ears, looking ahead.
        only: patterns of keys of observations; none: all.
        test: patterns of the names of homes for testing, see `plan_scenes`.
        gain_db: by which all sound is raised.
        maps: also write acoustic energy maps.
        video: also write films.
        video_width: pixels; None: `USUAL_WIDTH`.
        manifest: for ``video``: the manifest's file, if it names files beside it.
        hrtf: for ``video``: the SOFA file of the head with which the dataset was made, if it was made with one.

    Examples:
        >>> settings = SeldSettings(form="binaural", only=("part_3/*",), gain_db=6.0)
        >>> settings.form, settings.maps
        ('binaural', False)
    """

    form: SeldFormat = "foa"
    only: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    gain_db: float = 0.0
    maps: bool = False
    video: bool = False
    video_width: int | None = None
    manifest: Path | None = None
    hrtf: Path | None = None

    @property
    def width(self) -> int:
        """Width of a film (pixels)."""
        return USUAL_WIDTH[self.form] if self.video_width is None else self.video_width

    @property
    def sound_folder(self) -> str:
        """Folder of the sound."""
        return "foa_dev" if self.form == "foa" else "stereo_dev"

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Of the WAV files."""
        return ("W", "Y", "Z", "X") if self.form == "foa" else ("left", "right")

    def check(self) -> None:
        """Refuse what cannot be exported.

        Raises:
            UsageError: one line.
        """
        if self.form not in FORMATS:
            raise UsageError(f"format {self.form!r}: expected one of {', '.join(FORMATS)}")
        if self.maps and self.form != "foa":
            raise UsageError(f"--maps belongs to --format foa: a clip of {self.form} has a view of its own")
        if self.video:
            check_width(self.width)
            return
        for option in ("video_width", "manifest", "hrtf"):
            if getattr(self, option) is not None:
                raise UsageError(f"--{option.replace('_', '-')} belongs to --video; give both, or neither")


def write_seld(
    root: str | Path,
    folder: str | Path,
    settings: SeldSettings | None = None,
    *,
    workers: int | None = None,
    progress: bool = False,
) -> SeldIndex:
    """Write a dataset for sound event localisation and detection, all of it or nothing.

    The same dataset and settings give the same bytes, with any number of workers.

    Args:
        root: the dataset.
        folder: where; it must not exist, or be empty.
        settings: what is exported, and how; None: ambisonics of all observations.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if there is no dataset, its truth is not published, it has no ambisonics that are asked for, the
            folder is not empty, or an option does not fit.
        Avs3dError: if a file is missing or damaged, sound would clip, or the system refuses.

    Examples:
        >>> index = write_seld("data/listen", "seld", SeldSettings(form="binaural"), workers=1)
        >>> len(index.recordings), index.recordings[0].name
        (5, 'fold3_room1_mix001_deg000_start0000')
        >>> from pathlib import Path
        >>> labels = sorted(Path("seld").rglob("metadata_dev/**/*.csv"))
        >>> print("".join(labels[0].read_text().splitlines(keepends=True)[:2]), end="")
        frame,class,source,azimuth,distance,onscreen
        0,3,0,-21,230,1
    """
    settings = settings or SeldSettings()
    settings.check()
    dataset, keys = select(root, settings.only)
    scenes = plan_scenes(keys, settings.test)
    classes = _check_dataset(dataset, scenes, settings)
    with staged_folder(folder, _check_empty) as fresh:
        work = partial(_write_group, dataset.root, fresh, settings)
        of, films = {scene.key: scene for scene in scenes}, by_pictures(dataset[scene.key] for scene in scenes).values()
        groups = [tuple(of[observation.key] for observation in film) for film in films]
        sizes = [sum(len(observation.frame_names) for observation in film) for film in films]
        done = process_each(work, groups, workers=workers, label="recordings", progress=progress, sizes=sizes)
        records = {record.name: record for _, written in done for record in written}
        index = _index(dataset, settings, classes, tuple(records[name] for name in sorted(records)))
        media.write_json(fresh / SELD_JSON, index)
    return index


def _check_empty(folder: Path) -> None:
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise UsageError(f"{folder}: exists already; choose another folder, or move that one away")


def _check_dataset(dataset: Dataset, scenes: Sequence[SeldScene], settings: SeldSettings) -> dict[str, int]:
    """Check all observations before anything is written.

    Returns:
        category → class index.

    Raises:
        UsageError: one line.
    """
    own: dict[str, tuple[str, ...]] = {}
    for scene in scenes:
        observation = dataset[scene.key]
        record = record_of(observation)
        if settings.form != "binaural":
            check_ambisonics(observation)
        if not scene.clips(seconds_of(record), settings.form):
            raise UsageError(
                f"{observation.path}: {seconds_of(record)} s, expected at least {CLIP_SECONDS} s for a clip of "
                f"{settings.form}; generate more frames, or choose observations with --only"
            )
        own[scene.key] = tuple(record.categories or ())
    first = own[scenes[0].key]
    for key, names in own.items():
        if names != first:
            raise UsageError(
                f"{dataset.root / key}: adds the categories {names or 'none'}, but {scenes[0].key} {first or 'none'}; "
                "one export has one list of classes: choose observations with --only"
            )
    return event_classes(first, CATEGORIES)


def _write_group(
    root: Path, folder: Path, settings: SeldSettings, group: tuple[SeldScene, ...]
) -> list[SeldFileRecord]:
    """Write the recordings of observations that share their pictures."""
    dataset = Dataset(root)
    records: list[SeldFileRecord] = []
    faces: Faces | None = None
    if settings.video:
        camera = face_camera(face_side(settings.width, settings.form))
        request = FaceRequest(root, group[0].key, camera, settings.manifest, settings.hrtf)
        faces = find_renderer()(request)
    films: dict[tuple[int, int], Path] = {}
    for scene in group:
        observation = dataset[scene.key]
        record = record_of(observation)
        head = TurningHead.of(record.frames, turns=settings.form != "binaural")
        classes = event_classes(record.categories or (), CATEGORIES)
        events, seconds = events_of(record, classes, head), seconds_of(record)
        track = _track(observation, seconds, head, settings)
        for clip in scene.clips(seconds, settings.form):
            files = _write_clip(folder, settings, scene, clip, _cut(track, clip), events)
            if settings.maps:
                path = f"maps_dev/{scene.split}/{clip.name}.npz"
                write_maps(folder / path, energy_maps(observation, seconds, head))
                files.append(path)
            if faces is not None:
                path = f"video_dev/{scene.split}/{clip.name}.mp4"
                # A view is drawn for each recording, so that only those of whole panoramas are alike in a group.
                same = films.setdefault((clip.start, clip.view), folder / path)
                if same == folder / path:
                    _write_clip_film(folder / path, settings, clip, faces, head)
                else:
                    (folder / path).parent.mkdir(parents=True, exist_ok=True)
                    link_or_copy(same, folder / path)
                files.append(path)
            records.append(_describe(folder, observation, scene, clip, files, settings))
    return records


def _track(observation: Observation, seconds: int, head: TurningHead, settings: SeldSettings) -> NDArray[np.float32]:
    """(channels, 24000 · seconds) the sound of a recording; ambisonics of a stereo clip before it looks anywhere."""
    binaural = settings.form == "binaural"
    track = ears_track(observation, seconds) if binaural else ambisonics_track(observation, seconds, head)
    return track * np.float32(10 ** (settings.gain_db / 20))


def _cut(track: NDArray[np.float32], clip: SeldClip) -> NDArray[np.float32]:
    return track[:, clip.start * SELD_RATE : (clip.start + clip.seconds) * SELD_RATE]


def _write_clip(
    folder: Path,
    settings: SeldSettings,
    scene: SeldScene,
    clip: SeldClip,
    sound: NDArray[np.float32],
    events: Sequence[SeldEvent],
) -> list[str]:
    """Write sound and labels; returns their paths below the folder."""
    wav = f"{settings.sound_folder}/{scene.split}/{clip.name}.wav"
    csv = f"metadata_dev/{scene.split}/{clip.name}.csv"
    samples = mid_side(sound, clip.view) if settings.form == "stereo" else sound
    peak = float(np.abs(samples).max(initial=0.0))
    if peak > 1.0:
        raise UsageError(
            f"{scene.key}: the sound reaches {peak:.2f} of full scale; export all of it with "
            f"--gain-db {settings.gain_db - np.ceil(20 * np.log10(peak)):g}"
        )
    media.write_wav(folder / wav, samples, SELD_RATE, "pcm16")
    text = foa_csv(events) if settings.form == "foa" else stereo_csv(events, clip)
    media.write_bytes(folder / csv, text.encode())
    return [wav, csv]


def _write_clip_film(path: Path, settings: SeldSettings, clip: SeldClip, faces: Faces, head: TurningHead) -> None:
    """Write the film of a clip: a panorama beside ambisonics, else what is in view."""
    width = settings.width
    rays = panorama_rays(width) if settings.form == "foa" else perspective_rays(width, clip.view)
    camera = face_camera(face_side(width, settings.form))
    write_film(path, clip_pictures(clip, rays, faces, head, camera), (width, rays.shape[0]))


def _describe(
    folder: Path,
    observation: Observation,
    scene: SeldScene,
    clip: SeldClip,
    files: Sequence[str],
    settings: SeldSettings,
) -> SeldFileRecord:
    csv = next(name for name in files if name.endswith(".csv"))
    rows = (folder / csv).read_text(encoding="utf-8").count("\n") - (settings.form != "foa")
    return SeldFileRecord(
        name=clip.name,
        split=scene.split,
        observation=scene.key,
        group=observation.group_key,
        start=clip.start,
        label_frames=clip.seconds * LABELS_PER_SECOND,
        events=rows,
        view_deg=None if settings.form == "foa" else clip.view,
        files={name: media.sha256_file(folder / name) for name in files},
    )


def _index(
    dataset: Dataset, settings: SeldSettings, classes: dict[str, int], records: tuple[SeldFileRecord, ...]
) -> SeldIndex:
    record = dataset.record
    return SeldIndex(
        format=settings.form,
        toolkit_version=__version__,
        dataset=dataset.name,
        dataset_version=dataset.version,
        dataset_digest=None if record is None else record.digest,
        licence=record.licence if record else None,
        attributions=record.attributions if record else (),
        sample_rate=SELD_RATE,
        channels=settings.channel_names,
        gain_db=settings.gain_db,
        classes=classes,
        recordings=records,
    )
