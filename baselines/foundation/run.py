"""The foundation baseline from an observation to its masks, and from a dataset to a submission."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter
from baselines.echosegnet import binaural, spatial
from baselines.foundation.protocols import SoundTagger, TextMasks, TextSegmenter
from baselines.foundation.tracks import ObjectTrack, join, sighting
from baselines.networks.checkpoints import CHECKPOINTS, file_digest, find_checkpoint, require_packages
from baselines.networks.device import enough_memory, inference, pick_device
from baselines.networks.sound import check_clip
from baselines.sound_control import SoundControl, mono_of, named, noted, sounds_of

if TYPE_CHECKING:
    import torch

    from avs3d_bench.dataset import Observation

Array = NDArray[np.float64]
Segmenter = Literal["sam3", "grounded-sam2"]

#: How a category becomes a sentence (Wu et al. 2023, §4.2).
SENTENCE = "This is a sound of {}."
#: Silence and sounds of none of the categories, which compete with them.
OTHER_SOUNDS = (
    "silence", "speech", "music", "a fan", "a dishwasher", "a kettle", "a dog", "traffic", "wind", "footsteps", "noise",
)  # fmt: skip
#: In part_3, where several may sound: a category is heard in a frame from this share of the posterior on.
HEARD = 0.3
#: Which networks each way of segmenting needs.
_NEEDS: dict[str, tuple[str, ...]] = {"sam3": ("sam3",), "grounded-sam2": ("grounding-dino", "sam2")}


@dataclass(frozen=True)
class Foundation:
    """The networks; called with the test frames of an observation, it gives their masks.

    Attributes:
        tagger: names sounds.
        segmenter: segments what a text names.
        device: the `torch.device` they run on.
        checkpoints: name and sha256 of the weights, for submission.json.
        hearing: what is heard in place of a frame's own sound.

    Examples:
        >>> model = load_foundation(folders={"clap": "weights/clap", "sam3": "weights/sam3"}, device="cpu")
        >>> from avs3d_bench import Dataset
        >>> found = model(Dataset("data/demo")["part_1/apartment_1/bathroom/1"].test)  # of one observation
        >>> [prediction.mask.shape for prediction in found], found[0].categories
        ([(64, 64), (64, 64)], None)
    """

    tagger: SoundTagger
    segmenter: TextSegmenter
    device: torch.device
    checkpoints: tuple[str, ...] = ()
    hearing: SoundControl = "own"

    def __call__(self, frames: Sequence[Frame]) -> list[Prediction]:
        """The masks of test frames of one observation; in part_3 with the categories.

        The sound of all its frames is heard, the pictures of the given ones alone are looked at.

        Raises:
            Avs3dError: if a frame has no sound or pose, a file is damaged, or memory runs out.
        """
        observation = frames[0].observation
        ids, together = categories_of(observation), not observation.is_part_3
        names = list(ids)
        events = heard_events(self._posterior(observation.frames, names), together=together)
        wanted = sorted({member for members, _ in events for member in members})
        found = self._instances(frames, [names[member] for member in wanted])
        camera = observation.intrinsics
        marked = [np.zeros((camera.height, camera.width), np.uint8) for _ in frames]
        place_of = {frame.name: place for place, frame in enumerate(observation.frames)}
        for members, listened in events:
            chosen = self._choose(frames, listened, [(m, found[names[m]]) for m in members])
            for number, category, mask in chosen:
                if listened[place_of[frames[number].name]]:
                    marked[number][mask] = ids[names[category]]
        return [Prediction(one > 0, None if together else one) for one in marked]

    def _posterior(self, frames: Sequence[Frame], names: Sequence[str]) -> Array:
        """(frames, categories + 1) posterior of each category and of all other sounds; zeros where nothing is heard."""
        clips = [check_clip(mono_of(frame, self.hearing), _where(frame)) for frame in frames]
        texts = [SENTENCE.format(f"a {words(name)}") for name in names] + [SENTENCE.format(one) for one in OTHER_SOUNDS]
        loud = [k for k, clip in enumerate(clips) if clip.any()]
        out = np.zeros((len(frames), len(names) + 1))
        if loud:
            with inference(self.device, _where(frames[0])):
                found = self.tagger.posterior([clips[k] for k in loud], layout.SAMPLE_RATE, texts)
            if found.shape != (len(loud), len(texts)) or not np.isfinite(found).all():
                raise Avs3dError(f"{_where(frames[0])}: {self.tagger.name} gave no probabilities; check its weights")
            out[loud, : len(names)] = found[:, : len(names)]
            out[loud, len(names)] = found[:, len(names) :].sum(axis=1)
        return out

    def _instances(self, frames: Sequence[Frame], names: Sequence[str]) -> dict[str, list[TextMasks]]:
        """The instances of each category in each frame; a picture is looked at once for all of them."""
        found: dict[str, list[TextMasks]] = {name: [] for name in names}
        for frame in frames if names else ():
            with inference(self.device, _where(frame)):
                answers = self.segmenter.segment(frame.rgb(), [words(name) for name in names])
            for name, answer in zip(names, answers, strict=True):
                found[name].append(answer)
        return found

    def _choose(
        self, frames: Sequence[Frame], listened: NDArray[np.bool_], found: Sequence[tuple[int, list[TextMasks]]]
    ) -> list[tuple[int, int, NDArray[np.bool_]]]:
        """(index in ``frames``, category, mask) of the track that fits best what both ears heard.

        ``listened`` says in which frames of the whole observation the sound is that of these categories.
        """
        observation, poses = frames[0].observation, [frame.pose for frame in frames]
        tracks: list[tuple[int, list[TextMasks], ObjectTrack]] = []
        for category, masks in found:
            seen = [sighting(f, k, mask) for f, one in enumerate(masks) for k, mask in enumerate(one.masks)]
            tracks += [(category, masks, track) for track in join(seen, poses, observation.intrinsics)]
        if not tracks:
            return []
        best = 0
        if len(tracks) > 1:
            ears = [frame for frame, used in zip(observation.frames, listened, strict=True) if used]
            points = np.stack([track.point for _, _, track in tracks])
            rotation = np.stack([frame.pose.rotation_matrix for frame in ears])
            position = np.array([frame.pose.position for frame in ears])
            cues = binaural.observe(sounds_of(ears, self.hearing))
            best = spatial.judge(points, np.arange(len(points)), rotation, position, cues).best
        category, masks, track = tracks[best]
        return [(one.frame, category, masks[one.frame].masks[one.index]) for one in track.sightings]

    @property
    def method(self) -> str:
        """As tables name it."""
        return named(f"foundation ({self.tagger.name}, {self.segmenter.name})", self.hearing)

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        return noted(
            "2D, training-free: the sound is named, what has the name is segmented in all test frames, instances are "
            "joined by their rays, the likelihood of what both ears heard chooses"
            + (f"; checkpoints {', '.join(self.checkpoints)}" if self.checkpoints else ""),
            self.hearing,
        )


def categories_of(observation: Observation) -> dict[str, int]:
    """Name → class id of the categories that may sound; a dataset may add its own."""
    return dict(observation.record.class_ids) if observation.record is not None else class_ids()


def words(category: str) -> str:
    """A category as it is said."""
    return category.replace("_", " ")


def heard_events(posterior: Array, *, together: bool) -> list[tuple[list[int], NDArray[np.bool_]]]:
    """What is heard: (categories that compete to be its object, (frames,) in which frames it is heard).

    Args:
        posterior: (frames, categories + 1), the last column is for sounds of none of them; rows of zeros are silent.
        together: whether one object sounds all the time (part_1, part_2), so that the frames decide together, by the
            sum of their log probabilities.

    Returns:
        One event of the category that wins (part_1, part_2); of all categories if the last column wins: it has no name,
        but an object sounds, and the direction decides which. Or one event for each category that has a share of at
        least `HEARD` in some frame (part_3, where silence and sounds of no class are no objects).
    """
    loud: NDArray[np.bool_] = np.any(posterior, axis=1)
    categories = posterior.shape[1] - 1
    if together:
        if not loud.any():
            return []
        winner = int(np.log(np.maximum(posterior[loud], 1e-9)).sum(axis=0).argmax())
        return [(list(range(categories)) if winner == categories else [winner], loud)]
    return [([k], posterior[:, k] >= HEARD) for k in range(categories) if (posterior[:, k] >= HEARD).any()]


def _where(frame: Frame) -> str:
    return f"{frame.observation.path}/{frame.name}"


def needed(segmenter: Segmenter, folders: dict[str, str | Path | None]) -> dict[str, str | Path | None]:
    """The networks of a way of segmenting, CLAP first, with the folder of each.

    Raises:
        UsageError: if there is no such way.
    """
    if segmenter not in _NEEDS:
        raise UsageError(f"segmenter {segmenter!r}: expected one of {', '.join(_NEEDS)}")
    return {kind: folders.get(kind) for kind in ("clap", *_NEEDS[segmenter])}


def dry_run(segmenter: Segmenter, folders: dict[str, str | Path | None]) -> list[str]:
    """One line for each network: what would be loaded from where, or what is missing. Nothing is loaded.

    Raises:
        UsageError: if there is no such way of segmenting.
    """
    lines = []
    for kind, folder in needed(segmenter, folders).items():
        name = CHECKPOINTS[kind].name
        try:
            require_packages(kind)
            found = find_checkpoint(kind, folder)
        except Avs3dError as error:
            lines.append(f"{name}: {error}")
        else:
            size = sum(path.stat().st_size for path in found.values()) / 1e6
            lines.append(f"{name}: {folder}, {size:,.1f} MB, {CHECKPOINTS[kind].licence}")
    return lines


def load_foundation(
    *, segmenter: Segmenter = "sam3", folders: dict[str, str | Path | None], device: str | None = None
) -> Foundation:
    """Load the networks from local folders; see `baselines.networks.checkpoints.CHECKPOINTS` for the required files.

    Args:
        segmenter: ``sam3``, or ``grounded-sam2``, whose weights need no licence to be accepted.
        folders: network (``clap``, ``sam3``, ``grounding-dino``, ``sam2``) → its folder.
        device: cpu, cuda or cuda:<number>; None: a GPU where there is one.

    Raises:
        UsageError: if a folder is not named, a package or the device is missing.
        Avs3dError: if a checkpoint is missing or broken.

    Examples:
        >>> model = load_foundation(folders={"clap": "weights/clap", "sam3": "weights/sam3"}, device="cpu")
        >>> model.method
        'foundation (CLAP, SAM 3)'
    """
    from baselines.foundation.clap import ClapTagger

    # Report missing files before the first network is loaded for minutes.
    files = {}
    for kind, folder in needed(segmenter, folders).items():
        require_packages(kind)
        files[kind] = find_checkpoint(kind, folder)
    where = pick_device(device)
    with enough_memory(where, "loading the networks"):
        masks: TextSegmenter
        if segmenter == "sam3":
            from baselines.foundation.sam3 import Sam3Segmenter

            masks = Sam3Segmenter(str(folders["sam3"]), where)
        else:
            from baselines.foundation.grounded import GroundedSam2

            masks = GroundedSam2(str(folders["grounding-dino"]), str(folders["sam2"]), where)
        return Foundation(
            tagger=ClapTagger(str(folders["clap"]), where),
            segmenter=masks,
            device=where,
            checkpoints=tuple(f"{kind} {_digest(found)}" for kind, found in files.items()),
        )


def _digest(files: dict[str, Path]) -> str:
    """The first digits of the sha256 of the weights: of the file, or of the index of several."""
    (weights,) = [path for path in files.values() if ".safetensors" in path.name or path.suffix == ".bin"] or [
        next(path for path in files.values() if "index" in path.name)
    ]
    return file_digest(weights)[:12]


def write_foundation(
    dataset: Dataset,
    path: str | Path,
    model: Foundation,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the masks of the test frames as a submission.

    Args:
        dataset: what to look at; pictures of test frames, sounds and poses of all frames are read, no truth.
        path: the submission's folder.
        model: from `load_foundation`.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or the target is not free.
        Avs3dError: if a file is missing or damaged, memory runs out, or the system refuses.

    Examples:
        >>> model = load_foundation(folders={"clap": "weights/clap", "sam3": "weights/sam3"}, device="cpu")
        >>> from avs3d_bench import Dataset
        >>> writer = write_foundation(Dataset("data/demo"), "foundation", model, only=["part_1/*"], overwrite=True)
        >>> len(writer.observations), writer.record.method
        (1, 'foundation (CLAP, SAM 3)')
    """
    method = Method(model.method, model, notes=model.notes, entry="baselines.foundation.run:write_foundation")
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress)
