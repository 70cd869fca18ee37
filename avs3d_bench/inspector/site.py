"""Every address of the site and what lies there; the same for a site on disk and for the server.

    index.html                       the gallery
    assets/…                         style and scripts
    <key>/index.html                 the page of an observation
    <key>/thumbnail.webp  floor.png  sound.flac
    <key>/frames/frame_000.webp      what the player shows
    <key>/masks/frame_000.png        the truth, transparent where it is not set; in part_3 in the sources' colours
    <key>/instances/frame_000.png    instance ids in colours
    <key>/predictions/1/frame_000.png   masks of the first submission
    <key>/scene.js                   part_3: what the player of a sibling needs to show this observation instead
    <key>/stems/source_1.js          part_3 with stems: one source's track, as a script (pages opened from disk may load
                                     scripts, but may not read other files)
    <key>/ambisonics.js              its first-order ambisonics, as a script, if it has some
    <key>/full/frame_000.png         the dataset's own picture; served only, a site on disk does not hold it

No address is a path on disk: names are looked up among those that exist, so that none leads anywhere else.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from importlib.resources import files as package_files
from pathlib import Path

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import os_error_line, read_bytes
from avs3d_bench.inspector import pictures
from avs3d_bench.inspector.cards import GalleryCard, read_card
from avs3d_bench.inspector.facts import PageFacts, best_frames, read_facts, without_path
from avs3d_bench.inspector.floorplan import draw_floorplan
from avs3d_bench.inspector.links import check_links
from avs3d_bench.inspector.sound import (
    Track,
    read_ambisonics_track,
    read_stem_track,
    read_track,
    stem_script,
)
from avs3d_bench.inspector.sources import SiblingLink, find_siblings, stem_levels
from avs3d_bench.inspector.submissions import Agreement, ShownSubmission

THUMBNAIL, FLOOR, SOUND, PAGE = "thumbnail.webp", "floor.png", "sound.flac", "index.html"
SCENE, AMBISONICS = "scene.js", "ambisonics.js"
SCRIPTS = (
    "theme.js",
    "tables.js",
    "gallery.js",
    "map.js",
    "plots.js",
    "lanes.js",
    "stems.js",
    "filters.js",
    "head.js",
    "siblings.js",
    "player.js",
)
STYLES = ("style.css", "tables.css")
MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".webp": "image/webp",
    ".png": "image/png",
    ".flac": "audio/flac",
}
_STEM_FILE = re.compile(r"stems/([a-z_0-9]+)\.js")
_FRAME_FILE = re.compile(r"(frames|masks|instances|full|predictions/[1-9])/([A-Za-z0-9_]+)\.(webp|png)")


class NotThereError(Avs3dError):
    """The site has no such address."""


class DamagedError(Avs3dError):
    """An address of the site whose files cannot be read.

    Attributes:
        page: HTML that says so, where the address is that of a page.
    """

    def __init__(self, message: str, page: bytes | None = None) -> None:
        """Without ``page`` the message is all there is."""
        super().__init__(message)
        self.page = page


class ObservationSite:
    """The files of one observation's page, each made when it is asked for."""

    def __init__(
        self,
        dataset: Dataset,
        key: str,
        submissions: tuple[ShownSubmission, ...],
        keys: Sequence[str] | None = None,
    ) -> None:
        """Open the observation; nothing is read yet.

        Args:
            dataset: where it is.
            key: of the observation.
            submissions: whose masks are shown.
            keys: of all observations of the site; without them, those of the dataset.
        """
        self.dataset = dataset
        self.keys = dataset.keys if keys is None else tuple(keys)
        self.observation: Observation = dataset[key]
        self.submissions = submissions

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Around what is made of the observation's files.

        Raises:
            DamagedError: before anything is read, if one of them is a link out of the dataset; and in place of other
                errors of reading, and of the arithmetic errors that numbers beyond all bounds in the records lead to.
        """
        try:
            check_links(self.observation.path, self.dataset.root)
            yield
        except NotThereError:
            raise
        except Avs3dError as error:
            raise DamagedError(str(error)) from error
        except OSError as error:
            where = None if error.filename else self.observation.path
            raise DamagedError(os_error_line(error, where, "read")) from error
        except (ArithmeticError, ValueError) as error:
            raise DamagedError(
                f"{self.observation.path}: its records hold numbers that contradict each other ({error}); find them "
                "with `avs3d validate --deep`"
            ) from error

    def without_paths(self, line: str) -> str:
        """A message without the folders of this disk: pages say nothing of where they were made."""
        for submission in self.submissions:
            line = line.replace(f"{submission.root}/", f"{submission.name}: ")
        return without_path(self.observation, line)

    @cached_property
    def facts(self) -> PageFacts:
        """The facts on the page.

        Raises:
            Avs3dError: if the observation cannot be read.
        """
        return read_facts(self.dataset, self.observation)

    @cached_property
    def _frames(self) -> dict[str, Frame]:
        return {frame.name: frame for frame in self.observation.frames}

    @cached_property
    def poster(self) -> Frame:
        """The frame of the thumbnail: the best that has a picture.

        Raises:
            Avs3dError: if there are no frames, or none has a picture.
        """
        problem: Avs3dError | None = None
        for frame in best_frames(self.observation):
            try:
                media.png_header(self._picture(frame))
            except Avs3dError as error:
                problem = problem or error
            else:
                return frame
        raise problem or Avs3dError(f"{self.observation.path}: no frames")

    @cached_property
    def opening(self) -> int:
        """Number of the frame that the player opens on: that of the thumbnail if it shows the object, else the first.

        Raises:
            Avs3dError: as `poster`.
        """
        names = [moment.name for moment in self.facts.moments]
        at = names.index(self.poster.name)
        return at if self.facts.moments[at].visible else 0

    @cached_property
    def track(self) -> Track:
        """The sound."""
        return read_track(self.observation)

    def forget_sound(self) -> None:
        """Keep what the page says of the track, without its ten megabytes."""
        self.__dict__["track"] = replace(self.track, data=b"")

    @cached_property
    def colours(self) -> dict[int, tuple[int, int, int]]:
        """Instance id → RGB."""
        sound = self.facts.sound
        return {} if sound is None else sound.colours

    @cached_property
    def siblings(self) -> tuple[SiblingLink, ...]:
        """The observations of its group that the site has, itself included; none if there is no other."""
        return find_siblings(self.dataset, self.keys, self.observation)

    @property
    def stem_files(self) -> tuple[str, ...]:
        """The tracks of the stems, relative to the observation."""
        sound = self.facts.sound
        return tuple(f"stems/{name}.js" for name in sound.stem_names) if sound is not None else ()

    @property
    def stem_levels(self) -> dict[str, list[float | None]]:
        """Name of a stem → its level in each frame, dB re full scale; empty without stems."""
        return self._stems[0]

    @property
    def stem_problems(self) -> list[str]:
        """One line for each clip of a stem that cannot be read."""
        return self._stems[1]

    @cached_property
    def _stems(self) -> tuple[dict[str, list[float | None]], list[str]]:
        sound = self.facts.sound
        return stem_levels(self.observation, sound) if sound is not None else ({}, [])

    def names(self) -> Iterator[str]:
        """Every file of a site on disk, relative to the observation, but its page."""
        facts = self.facts
        yield THUMBNAIL
        if facts.has_map:
            yield FLOOR
        if facts.has_sound:
            yield SOUND
        if facts.has_ambisonics:
            yield AMBISONICS
        yield from self.stem_files
        for name, frame in self._frames.items():
            yield f"frames/{name}.webp"
            if facts.has_masks:
                yield f"masks/{name}.png"
            if facts.has_instances:
                yield f"instances/{name}.png"
            for submission in self.submissions:
                if submission.mask_path(frame) is not None:
                    yield f"predictions/{submission.number}/{name}.png"

    def make(self, name: str) -> bytes:
        """The file ``name``.

        Raises:
            NotThereError: if there is no such file.
            Avs3dError: if what it is made of is missing or damaged.
        """
        if name == THUMBNAIL:
            return pictures.thumbnail(self.poster.rgb())
        if name == FLOOR and self.facts.has_map:
            return draw_floorplan(self.observation, self.facts)
        if name == SOUND and self.facts.has_sound:
            if not self.track.data:
                del self.track
            return self.track.data
        if name == AMBISONICS and self.facts.has_ambisonics:
            return stem_script(self.observation.key, layout.AMBISONICS, read_ambisonics_track(self.observation))
        stem = _STEM_FILE.fullmatch(name)
        if stem and f"stems/{stem.group(1)}.js" in self.stem_files:
            return stem_script(self.observation.key, stem.group(1), read_stem_track(self.observation, stem.group(1)))
        match = _FRAME_FILE.fullmatch(name)
        frame = self._frames.get(match.group(2)) if match else None
        if match is None or frame is None:
            raise NotThereError(f"{self.observation.key}: the site has no {name}")
        kind, suffix = match.group(1), match.group(3)
        if kind == "frames" and suffix == "webp":
            return pictures.player_frame(frame.rgb())
        if suffix == "png":
            if kind == "full":
                media.png_header(self._picture(frame))
                return read_bytes(self._picture(frame))
            if kind == "masks":
                if self.facts.lanes is not None and self.facts.has_instances:
                    return pictures.audible_png(frame.mask(), frame.instance_ids(), self.colours)
                return pictures.mask_png(frame.mask())
            if kind == "instances" and self.colours:
                return pictures.instances_png(frame.instance_ids(), self.colours)
            if kind.startswith("predictions/"):
                return self._prediction(int(kind[-1]), frame)
        raise NotThereError(f"{self.observation.key}: the site has no {name}")

    def _picture(self, frame: Frame) -> Path:
        has_input = (self.observation.path / layout.INPUT).is_dir()
        return frame.path(layout.INPUT if has_input else layout.IMAGES)

    def _prediction(self, number: int, frame: Frame) -> bytes:
        for submission in self.submissions:
            mask = submission.mask(frame) if submission.number == number else None
            if mask is not None:
                return pictures.mask_png(mask)
        raise NotThereError(f"{self.observation.key}: no submission {number} has a mask of {frame.name}")

    @cached_property
    def size(self) -> tuple[int, int]:
        """(width, height) of the frames."""
        header = media.png_header(self._picture(self.poster))
        return header.width, header.height

    @property
    def agreements(self) -> dict[int, dict[str, Agreement]]:
        """Submission number → frame name → how it agrees with the truth; frames that cannot be compared are absent."""
        return self._comparison[0]

    @property
    def mask_problems(self) -> list[str]:
        """One line for each mask of a submission, and each true one beside it, that could not be read."""
        return self._comparison[1]

    @cached_property
    def _comparison(self) -> tuple[dict[int, dict[str, Agreement]], list[str]]:
        agreements: dict[int, dict[str, Agreement]] = {submission.number: {} for submission in self.submissions}
        problems: list[str] = []
        if not self.facts.has_masks or not self.submissions:
            return agreements, problems
        for frame in self.observation.test:
            try:
                truth = frame.mask()
            except Avs3dError as error:
                problems.append(str(error))
                continue
            for submission in self.submissions:
                try:
                    mask = submission.mask(frame)
                except Avs3dError as error:
                    problems.append(str(error))
                    continue
                if mask is not None and mask.shape == truth.shape:
                    agreements[submission.number][frame.name] = Agreement.of(truth, mask)
        return agreements, problems

    def card(self) -> GalleryCard:
        """The observation in the gallery; one that cannot be read says why."""
        try:
            with self.reading():
                return self._card()
        except Avs3dError as error:
            return GalleryCard(self.observation.place, problem=self.without_paths(str(error)))

    def _card(self) -> GalleryCard:
        return read_card(self.observation, self.poster)


def static_asset(name: str) -> bytes:
    """A script or the style.

    Raises:
        NotThereError: if there is no such file.
    """
    if name not in (*SCRIPTS, *STYLES):
        raise NotThereError(f"the site has no assets/{name}")
    return (package_files("avs3d_bench.inspector") / "templates" / name).read_bytes()


def media_type(name: str) -> str:
    """The media type of a file of the site."""
    return MEDIA_TYPES[Path(name).suffix]
