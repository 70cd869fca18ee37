"""Where everything lies in a dataset and in a submission: every folder and file name of the contract, in one place.

    <root>/dataset.json
    <root>/part_1|part_2|part_3/<scan>/<room>/<index>/   one observation; its path is its key
        input/frame_000.png …  audio_clips_binaural/frame_0.wav …                 (`expected_files` lists all)

Image folders pad the frame number to three digits, audio folders do not pad it: the official tools look them up so.

Examples:
    >>> key = layout.parse_key("part_2/apartment_1/kitchen/1")
    >>> key.part, key.room
    ('part_2', 'kitchen')
    >>> layout.image_path(layout.INPUT, 7), layout.audio_path(layout.BINAURAL, 7)
    ('input/frame_007.png', 'audio_clips_binaural/frame_7.wav')
    >>> [layout.is_test(index) for index in (0, 1, 8)]
    [True, False, True]
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase

from avs3d_bench.contract.taxonomy import PART_3, PARTS, check_room
from avs3d_bench.errors import Avs3dError, UsageError

DATASET_JSON = "dataset.json"
OBSERVATION_JSON = "observation.json"
SPLITS_JSON = "camera_splits.json"
SUBMISSION_JSON = "submission.json"
SCORES_JSON = "scores.json"
COMPARISON_JSON = "comparison.json"
#: Beside the shards of an export, and of `avs3d generate --format webdataset`.
SHARDS_JSON = "shards.json"
#: Of a sealed test: the commitments at the root, and in each observation what observation.json may tell of it.
SEAL_JSON = "seal.json"
POSES_JSON = "poses.json"
#: Beside dataset.json while `avs3d generate` is at work, and after it gave something up; no part of the dataset.
LOCK = ".avs3d-lock"
FAILURES_JSONL = "failures.jsonl"

INPUT = "input"
IMAGES = "images"
BINAURAL = "audio_clips_binaural"
MONO = "audio_clips_mono"
SEMANTIC_MASKS = "semantic_masks"
INSTANCE_MASKS = "instance_masks"
#: Of part_3 only; stems are optional.
CATEGORY_MASKS = "category_masks"
STEMS = "stems"
BACKGROUND = "background"
DEPTH = "depth"
RIRS = "rirs"
#: Receivers that may hear an observation beside the two ears, in the order in which they are listed; the clips, impulse
#: responses and stems of each are in folders of its own (`clips_folder`, `rirs_folder`, `stems_folder`).
AMBISONICS, ARRAY = "ambisonics", "array"
RECEIVERS = (AMBISONICS, ARRAY)
GT_3D = "gt_3d"
SOUNDING_OBJECT = f"{GT_3D}/sounding_object.ply"
#: A scan from above, without placed objects; of observations in scans only. For people who look at a dataset.
TOP_VIEW = "top_view.png"
COLMAP = "sparse/0"
COLMAP_FILES = tuple(f"{COLMAP}/{name}.bin" for name in ("cameras", "images", "points3D"))

#: What `avs3d seal` publishes of an observation: these folders and files, and every `audio_clips_*` folder. All others
#: are truth.
PUBLIC_FOLDERS = (INPUT, IMAGES, DEPTH, COLMAP)
PUBLIC_FILES = (SPLITS_JSON, POSES_JSON)

#: Folders that have the same bytes in all siblings of a group of part_3.
SIBLING_FOLDERS = (INPUT, IMAGES, INSTANCE_MASKS, DEPTH, COLMAP)

#: Folders of a submission's observation.
SUBMISSION_MASKS = "masks"
SUBMISSION_CATEGORIES = "categories"
SUBMISSION_POINTS = "points.ply"
#: Where the released pipeline leaves its masks, with and without its refinement, below an observation's folder.
RELEASED_MASKS = ("3d_segmentation_use_aisrm_True/masks/test", "3d_segmentation_use_aisrm_False/masks/test")
#: Folders (with "/") and files that the released pipeline writes into an observation: neither data nor an error.
RELEASED_BYPRODUCTS = (
    "3d_segmentation_*/",  # run_lifting_aisrm.py: masks, renders, metrics
    "3dgs_scene/",  # the trained Gaussians
    "owod_bind_train_frames/",  # masks of OWOD-BIND
    "distorted/",  # COLMAP, before undistortion
    "stereo/",  # COLMAP's undistorter
    "renders/",
    "points3D.ply",  # the loader's copy of the sparse points
    "sparse/0/points3D.ply",
    "metrics_*.json",
    "run-colmap-*.sh",  # COLMAP's undistorter
)

#: The benchmark's numbers: frames per observation, image side, clip rate and lengths (samples), frames per second.
FRAME_COUNT = 120
IMAGE_SIZE = 1008
SAMPLE_RATE = 44_100
#: Clips stay below this peak of full scale, −1 dB: what encodes or resamples them may clip what is louder.
PEAK_CEILING = 10 ** (-1 / 20)
BINAURAL_SAMPLES = SAMPLE_RATE
MONO_SAMPLES = 2 * SAMPLE_RATE
FRAME_RATE = 1.0
#: Most channels of a clip, which are those of a large array of microphones.
MOST_CHANNELS = 256
#: Most points of a predicted cloud: a larger one is no object any more.
MAX_POINTS = 2_000_000
#: Every eighth frame of the sorted names is a test frame.
TEST_EVERY = 8
#: Three digits keep the order of names and of time the same.
MAX_FRAMES = 1000
#: Depth pictures hold millimetres in 16 bits; 0 means that the ray met nothing.
DEPTH_UNITS_PER_METRE = 1000

#: Scan ids end up in paths: letters, digits, ``_``, ``-``, ``.``; they start with a letter or a digit.
SCAN_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.\-]*$"
FRAME_PATTERN = r"^frame_[0-9]{3}$"
_SCAN = re.compile(SCAN_PATTERN)
#: Beginning of the name of every folder of clips.
_CLIPS = "audio_clips_"
_INDEX = re.compile(r"[1-9][0-9]*")
_FRAME = re.compile(r"frame_([0-9]+)")


@dataclass(frozen=True, order=True)
class ObservationKey:
    """An observation's place: ``str(key)`` is ``part_1/<scan>/<room>/<index>``, also its folder below the root.

    Examples:
        >>> key = ObservationKey("part_3", "home_1", "kitchen", 2)
        >>> str(key), key.is_part_3
        ('part_3/home_1/kitchen/2', True)
    """

    part: str
    scan: str
    room: str
    index: int

    def __str__(self) -> str:
        return f"{self.part}/{self.scan}/{self.room}/{self.index}"

    @property
    def is_part_3(self) -> bool:
        """Whether it belongs to part_3."""
        return self.part == PART_3


def observation_key(part: str, scan: str, room: str, index: int) -> str:
    """The key (and relative folder) of an observation.

    Raises:
        UsageError: if the part or the room is unknown, the scan id cannot be a folder name or the index is below 1.

    Examples:
        >>> observation_key("part_1", "home_1", "kitchen", 2)
        'part_1/home_1/kitchen/2'
    """
    if part not in PARTS:
        raise UsageError(f"unknown part {part!r}: expected one of {', '.join(PARTS)}")
    if not _SCAN.fullmatch(scan):
        raise UsageError(f"scan id {scan!r} cannot be a folder name: expected letters, digits, '_', '-' or '.'")
    check_room(room)
    if not isinstance(index, int) or isinstance(index, bool) or index < 1:
        raise UsageError(f"observation index {index!r}: expected a whole number from 1 on")
    return str(ObservationKey(part, scan, room, index))


def parse_key(key: str) -> ObservationKey:
    """Split ``part_1/<scan>/<room>/<index>`` into its parts.

    Raises:
        UsageError: if it has another form or a name in it is unknown.

    Examples:
        >>> key = parse_key("part_2/apartment_1/kitchen/1")
        >>> key.part, key.scan, key.room, key.index
        ('part_2', 'apartment_1', 'kitchen', 1)
    """
    pieces = key.split("/")
    if len(pieces) != 4 or not _INDEX.fullmatch(pieces[3]):
        raise UsageError(f"observation key {key!r}: expected {'|'.join(PARTS)}/<scan>/<room>/<index>")
    part, scan, room, index = pieces[0], pieces[1], pieces[2], int(pieces[3])
    observation_key(part, scan, room, index)
    return ObservationKey(part, scan, room, index)


def frame_name(index: int) -> str:
    """``frame_000``: the stem of frame ``index`` in every image folder.

    Raises:
        Avs3dError: if ``index`` is outside [0, 1000), where names would no longer sort in time.

    Examples:
        >>> frame_name(7)
        'frame_007'
    """
    if not 0 <= index < MAX_FRAMES:
        raise Avs3dError(f"frame {index} has no name: an observation holds frames 0 to {MAX_FRAMES - 1}")
    return f"frame_{index:03d}"


def audio_name(index: int) -> str:
    """``frame_0``: the stem of frame ``index`` in the two audio folders and in ``rirs/`` (no padding).

    Examples:
        >>> audio_name(7)
        'frame_7'
    """
    frame_name(index)
    return f"frame_{index}"


def frame_index(name: str) -> int:
    """The number in ``frame_007`` or ``frame_7``.

    Raises:
        Avs3dError: if ``name`` has another form.

    Examples:
        >>> frame_index("frame_007"), frame_index("frame_7")
        (7, 7)
    """
    match = _FRAME.fullmatch(name)
    if not match:
        raise Avs3dError(f"frame name {name!r}: expected frame_000 (images) or frame_0 (audio)")
    return int(match.group(1))


def is_test(index: int) -> bool:
    """Whether the frame at ``index`` of the sorted names belongs to the test split.

    Examples:
        >>> [index for index in range(20) if is_test(index)]
        [0, 8, 16]
    """
    return index % TEST_EVERY == 0


def split_names(names: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(train, test) of frame names: sorted as strings, every eighth is test.

    Examples:
        >>> train, test = split_names(frame_name(index) for index in range(10))
        >>> len(train), test
        (8, ('frame_000', 'frame_008'))
    """
    ordered = sorted(names)
    train = tuple(name for position, name in enumerate(ordered) if not is_test(position))
    test = tuple(name for position, name in enumerate(ordered) if is_test(position))
    return train, test


def image_path(folder: str, index: int) -> str:
    """``<folder>/frame_000.png`` relative to the observation.

    Examples:
        >>> image_path(INPUT, 7)
        'input/frame_007.png'
    """
    return f"{folder}/{frame_name(index)}.png"


def audio_path(folder: str, index: int) -> str:
    """``<folder>/frame_0.wav`` relative to the observation.

    Examples:
        >>> audio_path(MONO, 7)
        'audio_clips_mono/frame_7.wav'
    """
    return f"{folder}/{audio_name(index)}.wav"


def clips_folder(receiver: str | None = None) -> str:
    """Folder of the clips of a receiver: ``audio_clips_ambisonics``; of the two ears without one.

    Examples:
        >>> clips_folder(), clips_folder(AMBISONICS)
        ('audio_clips_binaural', 'audio_clips_ambisonics')
    """
    return BINAURAL if receiver is None else f"audio_clips_{receiver}"


def rirs_folder(receiver: str | None = None) -> str:
    """Folder of the impulse responses of a receiver: ``rirs_ambisonics``; of the two ears without one.

    Examples:
        >>> rirs_folder(), rirs_folder(ARRAY)
        ('rirs', 'rirs_array')
    """
    return RIRS if receiver is None else f"{RIRS}_{receiver}"


def stems_folder(receiver: str | None = None) -> str:
    """Folder of the stems of a receiver: ``stems_ambisonics``; of the two ears without one.

    Examples:
        >>> stems_folder(), stems_folder(AMBISONICS)
        ('stems', 'stems_ambisonics')
    """
    return STEMS if receiver is None else f"{STEMS}_{receiver}"


def rir_path(index: int, source: str | None = None, receiver: str | None = None) -> str:
    """``rirs/frame_0.npz`` relative to the observation; in part_3 ``rirs/source_1/frame_0.npz``.

    Examples:
        >>> rir_path(0, "source_1", "ambisonics")
        'rirs_ambisonics/source_1/frame_0.npz'
    """
    folder = rirs_folder(receiver)
    return f"{folder if source is None else f'{folder}/{source}'}/{audio_name(index)}.npz"


def stem_path(name: str, index: int, receiver: str | None = None) -> str:
    """``stems/source_1/frame_0.wav`` relative to the observation; ``name`` is a source's id or `BACKGROUND`.

    Examples:
        >>> stem_path("source_1", 0), stem_path(BACKGROUND, 0)
        ('stems/source_1/frame_0.wav', 'stems/background/frame_0.wav')
    """
    return f"{stems_folder(receiver)}/{name}/{audio_name(index)}.wav"


@dataclass(frozen=True)
class Part3Contents:
    """Facts that decide which files a part_3 observation has, beside its number of frames.

    Attributes:
        sources: ids of all sources.
        in_room: whether one of them is an instance of the room, whose mesh `gt_3d/` then holds.
        stems: whether the clips of each source (and of the background) are kept.
        background: whether there is a background.

    Examples:
        >>> Part3Contents(sources=("source_1", "source_2"), stems=True, background=True).stem_names
        ('source_1', 'source_2', 'background')
    """

    sources: tuple[str, ...] = ()
    in_room: bool = False
    stems: bool = False
    background: bool = False

    @property
    def stem_names(self) -> tuple[str, ...]:
        """Folders below `stems/`; none if the stems are not kept."""
        return (*self.sources, *((BACKGROUND,) if self.background else ())) if self.stems else ()


def released_byproduct(path: str) -> str | None:
    """The folder (ending in a slash) or file of `RELEASED_BYPRODUCTS` that a path below an observation is part of.

    Examples:
        >>> released_byproduct("3dgs_scene/point_cloud/iteration_30000/point_cloud.ply")
        '3dgs_scene/'
        >>> released_byproduct("points3D.ply")
        'points3D.ply'
        >>> released_byproduct("input/frame_000.png") is None
        True
    """
    top, slash, _ = path.partition("/")
    for pattern in RELEASED_BYPRODUCTS:
        if pattern.endswith("/"):
            if slash and fnmatchcase(top, pattern[:-1]):
                return f"{top}/"
        elif path.count("/") == pattern.count("/") and fnmatchcase(path, pattern):
            return path
    return None


def is_public(path: str) -> bool:
    """Whether a sealed test publishes this file of an observation; ``path`` is relative to its folder.

    Examples:
        >>> is_public("audio_clips_mono/frame_0.wav"), is_public("sparse/0/images.bin")
        (True, True)
        >>> is_public("observation.json"), is_public("rirs/frame_0.npz"), is_public("stems/source_1/frame_0.wav")
        (False, False, False)
    """
    folder = path.rpartition("/")[0]
    return path in PUBLIC_FILES or folder in PUBLIC_FOLDERS or ("/" not in folder and folder.startswith(_CLIPS))


def expected_files(
    frames: int,
    *,
    depth: bool = False,
    rirs: bool = False,
    part_3: Part3Contents | None = None,
    receivers: Iterable[str] = (),
    top_view: bool = False,
) -> tuple[str, ...]:
    """Every file of an observation with ``frames`` frames, relative, sorted; ``observation.json`` excluded.

    Args:
        frames: number of frames.
        depth: whether depth pictures are kept.
        rirs: whether impulse responses are kept.
        part_3: of an observation of part_3; None for the other parts.
        receivers: those of `RECEIVERS` that hear it, beside the two ears.
        top_view: whether there is a picture from above.

    Examples:
        >>> files = expected_files(9, depth=True)
        >>> len(files), files[0]
        (68, 'audio_clips_binaural/frame_0.wav')
    """
    files = [SPLITS_JSON, *COLMAP_FILES]
    if part_3 is None or part_3.in_room:
        files.append(SOUNDING_OBJECT)
    if top_view:
        files.append(TOP_VIEW)
    folders = [INPUT, IMAGES, SEMANTIC_MASKS, INSTANCE_MASKS] + ([DEPTH] if depth else [])
    if part_3 is not None:
        folders.append(CATEGORY_MASKS)
    responses: tuple[str | None, ...] = () if not rirs else (None,) if part_3 is None else part_3.sources
    stems = part_3.stem_names if part_3 else ()
    for index in range(frames):
        files += [image_path(folder, index) for folder in folders]
        files.append(audio_path(MONO, index))
        for receiver in (None, *receivers):
            files.append(audio_path(clips_folder(receiver), index))
            files += [rir_path(index, source, receiver) for source in responses]
            files += [stem_path(name, index, receiver) for name in stems]
    return tuple(sorted(files))


def mono_window(index: int, count: int) -> list[tuple[int, int, int]]:
    """Which samples of which clips make the 2 s mono clip of frame ``index`` of ``count``.

    The frame's own second with the half second before and after it. A train frame never borrows from a test frame; it
    takes the missing half from its other neighbour, which then gives its whole second. So does the first and the last
    frame of a sequence. A frame that may borrow from nobody (one frame; or frames 0 and 1 alone, for frame 1) is
    repeated: its second half, itself, its first half, as if it were played in a loop.

    Returns:
        pieces (frame, start, stop) in the order in which they are joined; their lengths add up to 88,200 samples.

    Raises:
        Avs3dError: if ``index`` is not in 0 … count − 1.

    Examples:
        >>> mono_window(4, 9)  # (frame, start, stop): half a second of both neighbours
        [(3, 22050, 44100), (4, 0, 44100), (5, 0, 22050)]
    """
    if not 0 <= index < count:
        raise Avs3dError(f"mono clip: frame {index} of {count} does not exist; expected 0 to {count - 1}")
    half, whole = BINAURAL_SAMPLES // 2, BINAURAL_SAMPLES

    def lends(frame: int) -> bool:
        return 0 <= frame < count and (is_test(index) or not is_test(frame))

    before, after = index - 1, index + 1
    own = (index, 0, whole)
    if lends(before) and lends(after):
        return [(before, half, whole), own, (after, 0, half)]
    if lends(before):
        return [(before, 0, whole), own]
    if lends(after):
        return [own, (after, 0, whole)]
    return [(index, half, whole), own, (index, 0, half)]
