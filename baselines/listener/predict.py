"""The listener as a method: masks of frames of any size, and class ids in part_3.

1. The network looks at the picture several times (`looks_at`): resized to the two sizes that its calibration names, the
   field of view stays, and mirrored with the ears swapped. The sound goes in as it is. Its probabilities are averaged.
2. They have cells of two pixels; their log-odds are resized to the frame bilinearly and follow the picture's edges
   after a guided filter (He, Sun, Tang, "Guided image filtering", ECCV 2010).
3. Where the likeliest pixels of the frame are below a threshold, nothing is marked; else what is around them, down to a
   share of their probability (`masks.marked`). Components smaller than `LEAST_AREA` of the picture are dropped.
4. The class of a component is the category that the picture shows there, weighted by how audible it is.

Nothing of the truth is read: pictures, binaural sound and the camera's intrinsics alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.media import write_png_categories
from avs3d_bench.formats.staging import staged_folder
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionFolder, SubmissionWriter
from baselines.listener.masks import (
    LEAST_AREA,
    MOST_LOGIT,
    Answer,
    agreed,
    class_map,
    guided,
    heard_of,
    logit,
    marked,
    marked_where,
)
from baselines.listener.shards import LOOK_SIDES, SIDE
from baselines.networks.device import inference, pick_device
from baselines.sound_control import SoundControl, named, noted, sound_of

#: Probability above which a pixel is marked; chosen on validation homes (docs/listener-training.md).
THRESHOLD = 0.5
#: By how much a picture is enlarged at most, if it is not smaller than the network's own size.
ENLARGED = 1.5


class Look(NamedTuple):
    """One look at a picture.

    Attributes:
        side: to which the picture is resized (pixels); a multiple of 4.
        mirrored: left and right swapped, and the ears.
    """

    side: int
    mirrored: bool

    def cells_of(self, answered: Any) -> Any:
        """(…, side / 2, side / 2) float32, as the picture lies: what the network answers, which pads the picture."""
        found = answered[..., : self.side // 2, : self.side // 2].float()
        return found.flip(-1) if self.mirrored else found


#: How often the network looks.
Looks = Literal["one", "several"]


def looks_at(width: int, looks: Looks, finest: int = max(LOOK_SIDES)) -> list[Look]:
    """The looks at a picture of some width (pixels).

    Of several, these are the two largest sides that the picture allows, each also mirrored.

    Args:
        width: of the picture (pixels).
        looks: one or several.
        finest: largest side of several looks (pixels).

    Examples:
        >>> [[look.side for look in looks_at(width, "several")] for width in (1008, 504, 400, 252)]
        [[504, 504, 756, 756], [504, 504, 756, 756], [252, 252, 504, 504], [252, 252]]
        >>> looks_at(1008, "one")
        [Look(side=252, mirrored=False)]
    """
    if looks == "one":
        return [Look(SIDE, False)]
    sides = [side for side in LOOK_SIDES if side <= min(finest, max(ENLARGED * width, SIDE))][-2:]
    return [Look(side, mirrored) for side in sides for mirrored in (False, True)]


#: Frames that go through the network at a time.
BATCH = 8
#: How masks are refined: not, or along the picture's edges.
Refine = Literal["none", "edges"]


@dataclass(frozen=True)
class ListenerMethod:
    """The network and the settings of the rule.

    Attributes:
        network: of `weights.load_listener`.
        device: where it runs.
        digest: sha256 of its weights.
        threshold, share: of `masks.marked`.
        refine: see `Refine`.
        hearing: what it hears, to see whether and how it listens.
        looks: one or several, see `looks_at`.
        calibration: `weights.Calibration` by whose temperatures log-odds are divided; None: they stay.
    """

    network: Any
    device: Any
    digest: str
    threshold: float = THRESHOLD
    refine: Refine = "edges"
    hearing: SoundControl = "own"
    looks: Looks = "several"
    calibration: Any = None
    share: float | None = None

    @property
    def finest(self) -> int:
        """Side of the finest of several looks (pixels)."""
        return self.calibration.finest if self.calibration else max(LOOK_SIDES)

    def answers(
        self, pictures: Sequence[NDArray[np.uint8]], sounds: Any, cameras: Any, *, looks: Looks | None = None
    ) -> list[Answer]:
        """The mean of several looks.

        Args:
            pictures: B of the same size (H, W, 3).
            sounds: (B, 2, n) float32.
            cameras: (B, 4), see `direction.pixel_angles`.
            looks: others than the method's.
        """
        found = self.every_look(pictures, sounds, cameras, looks or self.looks)
        return [each[0] if len(each) == 1 else agreed(each) for each in found]

    def every_look(
        self, pictures: Sequence[NDArray[np.uint8]], sounds: Any, cameras: Any, looks: Looks
    ) -> list[tuple[Answer, ...]]:
        """Of each picture the answers of several looks, see `answers`."""
        taken = looks_at(pictures[0].shape[1], looks, self.finest)
        return list(zip(*(self.look(look, pictures, sounds, cameras) for look in taken), strict=True))

    def look(self, look: Look, pictures: Sequence[NDArray[np.uint8]], sounds: Any, cameras: Any) -> list[Answer]:
        """One look, see `answers`."""
        import torch

        from baselines.listener.model import hear

        clips, views = torch.as_tensor(sounds).to(self.device), torch.as_tensor(cameras).to(self.device)
        if look.mirrored:
            clips, views = clips.flip(1), views.clone()
            views[:, 2] = 1 - views[:, 2]
        found = self.network(self.encoded(look, pictures), hear(clips, views, (look.side, look.side)))
        masks, classes = look.cells_of(found.mask), look.cells_of(found.classes)
        said = self.calibration
        by_mask, bias = (said.mask, said.bias) if said else (1.0, 0.0)
        numbers = (
            self._finite((masks - bias) / by_mask),
            self._finite(classes.softmax(dim=1)),
            self._finite(self._names(found.audible)),
        )
        named = len(CATEGORIES)
        return [
            Answer(mask, what, names[:named], float(names[named]) if len(names) > named else 0.0)
            for mask, what, names in zip(*numbers, strict=True)
        ]

    def encoded(self, look: Look, pictures: Sequence[NDArray[np.uint8]], *, again: bool = True) -> Any:
        """What goes into the network for one look at pictures: these, or what it saw of them before.

        Args:
            look: at the pictures.
            pictures: of the same size.
            again: whether they may be looked at again, with another sound.
        """
        return self._shown(look, pictures)

    def class_maps(self, frames: Sequence[Frame]) -> list[NDArray[np.float32]]:
        """(8, n, n) of each frame: the probability of each class at each pixel, from the picture alone, as in `seen`.

        Args:
            frames: of any observations; their sound is not read.

        Raises:
            Avs3dError: if a picture is missing or damaged, or memory runs out.
        """
        from torch.nn import functional

        out: list[NDArray[np.float32]] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            with inference(self.device, _where(part[0])):
                pictures = [frame.rgb() for frame in part]
                looks = looks_at(pictures[0].shape[1], self.looks, self.finest)
                size, maps = max(look.side for look in looks) // 2, []
                for look in looks:
                    classes = self.network(self.encoded(look, pictures, again=False)).classes
                    found = look.cells_of(classes).softmax(dim=1)
                    maps.append(functional.interpolate(found, (size, size), mode="bilinear", align_corners=False))
                out += list(self._finite(sum(maps) / len(maps)))
        return out

    def heard(self, frames: Sequence[Frame]) -> NDArray[np.float32]:
        """(T, 7) how probable it is that each category is what is heard in each frame, see `masks.Answer.heard`.

        Args:
            frames: of any observations; their pictures are not read.

        Raises:
            Avs3dError: if a sound is missing or damaged, or memory runs out.
        """
        import torch

        from baselines.listener.features import band_features, broadband_levels, spectra

        with inference(self.device, _where(frames[0])):
            clips = torch.as_tensor(np.stack([clip_of(frame, self.hearing) for frame in frames])).to(self.device)
            sides = [clips, clips.flip(1)] if self.looks == "several" else [clips]
            names = [
                self._names(self.network.sound_encoder(band_features(spectra(each)), broadband_levels(each))[1])
                for each in sides
            ]
            found = self._finite(sum(names) / len(names))
        named, unknown = np.split(found, [len(CATEGORIES)], axis=1)
        return heard_of(named, unknown if unknown.size else 0.0)

    def _shown(self, look: Look, pictures: Sequence[NDArray[np.uint8]]) -> Any:
        """(B, 3, side, side) float, 0 to 1: the network's input."""
        import torch

        stack = torch.from_numpy(np.stack([_resized(picture, look.side) for picture in pictures])).to(self.device)
        stack = stack.permute(0, 3, 1, 2).float() / 255
        return stack.flip(-1) if look.mirrored else stack

    def _names(self, audible: Any) -> Any:
        """Probabilities of the network's logits of names, by the calibration's temperature."""
        return (audible.float() / (self.calibration.audible if self.calibration else 1.0)).sigmoid()

    def _finite(self, values: Any) -> NDArray[np.float32]:
        """Numbers of the network as an array; Avs3dError if one is NaN or infinite."""
        found = np.asarray(values.cpu().numpy(), np.float32)
        if not np.isfinite(found).all():
            raise Avs3dError(
                f"weights {self.digest[:12]}: the listener answers with NaN or infinite numbers; train it again, "
                "or name other weights"
            )
        return found

    def seen(self, frames: Sequence[Frame], pictures: Sequence[NDArray[np.uint8]] | None = None) -> list[Answer]:
        """The answers for frames of any observations; errors as of `predictions`.

        Args:
            frames: with sound.
            pictures: of the frames, if they are decoded.
        """
        out: list[Answer] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            sounds = np.stack([clip_of(frame, self.hearing) for frame in part])
            cameras = np.asarray([camera_of(frame) for frame in part], np.float32)
            with inference(self.device, _where(part[0])):
                shown = pictures[start : start + BATCH] if pictures is not None else [frame.rgb() for frame in part]
                out += self.answers(shown, sounds, cameras)
        return out

    def predictions(self, frames: Sequence[Frame], soft: Path | None = None) -> list[Prediction]:
        """Masks of frames, with class ids in part_3.

        Args:
            frames: of any observations.
            soft: folder to which the probabilities of their pixels go as well; see `write_listener`.

        Raises:
            Avs3dError: if a frame has no sound, a file is damaged, or memory runs out.
        """
        out: list[Prediction] = []
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            pictures = [frame.rgb() for frame in part]
            for frame, picture, answer in zip(part, pictures, self.seen(part, pictures), strict=True):
                odds = self.odds(answer.mask, picture)
                mask = self.marked(odds)
                if soft is not None:
                    write_soft_mask(soft, frame, odds)
                out.append(Prediction(mask, class_map(mask, answer) if frame.observation.is_part_3 else None))
        return out

    def mask(self, cells: NDArray[np.float32], picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(H, W) of log-odds (n, n) and a picture (H, W, 3), rules 2 and 3."""
        return self.marked(self.odds(cells, picture))

    def odds(self, cells: NDArray[np.float32], picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(H, W) log-odds of a picture's pixels (H, W, 3) from those of cells (n, n), rule 2."""
        cells = np.clip(cells, -MOST_LOGIT, MOST_LOGIT)
        large = np.asarray(cv2.resize(cells, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        # Nothing that is far below the threshold rises above it by a filter that averages.
        if self.refine == "edges" and large.max() > logit(self.threshold):
            large = guided(large, picture)
        return large

    def marked(self, odds: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(H, W) of log-odds, rule 3."""
        return marked(odds, self.threshold, self.share)

    @property
    def notes(self) -> str:
        """The settings, for submission.json."""
        edges = {"none": "no refinement", "edges": "guided filter at edges"}
        looked = looks_at(self.finest, self.looks, self.finest)
        sides = " and ".join(f"{look.side}²" for look in looked if not look.mirrored)
        looks = f"one look at {sides}" if self.looks == "one" else f"looks at {sides}, also mirrored"
        said = self.calibration
        warm = (
            f"; log-odds of masks less {said.bias:g} divided by {said.mask:g}, of names by {said.audible:g}"
            if said
            else ""
        )
        return noted(
            f"2D, from the picture and the binaural second of test frames; weights {self.digest[:12]}; "
            f"{looks}; {marked_where(self.threshold, self.share)}; {edges[self.refine]}; "
            f"components below {LEAST_AREA:g} of the picture dropped{warm}",
            self.hearing,
        )


def _resized(picture: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """A picture as a square of some side; its field of view stays."""
    if picture.shape[:2] == (side, side):
        return picture
    how = cv2.INTER_AREA if side < picture.shape[1] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, (side, side), interpolation=how), np.uint8)


def write_soft_mask(folder: Path, frame: Frame, odds: NDArray[np.float32]) -> None:
    """Write the probabilities of a frame's pixels as 8 bits of grey (255 is 1), named as the mask in a submission.

    Args:
        folder: of the soft masks of a dataset.
        frame: whose they are.
        odds: (H, W) log-odds.
    """
    path = SubmissionFolder(folder, ()).mask_path(frame.observation.key, frame.name)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png_categories(path, np.round(255 * expit(odds)).astype(np.uint8))


def _check_soft(folder: Path) -> None:
    """Refuse a folder for soft masks that holds anything: whose they are, no file of it says."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: exists; soft masks are written into a new or an empty folder, choose another name")


def _where(frame: Frame) -> str:
    return f"{frame.observation.path}/{frame.name}"


def clip_of(frame: Frame, control: SoundControl = "own") -> NDArray[np.float32]:
    """(2, 44100) float32: the frame's sound; shorter or longer files of other releases are cut or filled with zeros.

    Raises:
        UsageError: if the dataset lacks what the control asks for.
        Avs3dError: if it is missing, has another number of channels, or holds no numbers.
    """
    sound = np.asarray(sound_of(frame, control), np.float32)
    if sound.ndim != 2 or sound.shape[0] != 2:
        raise Avs3dError(f"{_where(frame)}: sound of shape {sound.shape}, expected two ears (2, n)")
    if not np.isfinite(sound).all():
        raise Avs3dError(f"{_where(frame)}: the sound holds NaN or infinite samples; regenerate the dataset")
    out = np.zeros((2, layout.SAMPLE_RATE), np.float32)
    length = min(sound.shape[1], layout.SAMPLE_RATE)
    out[:, :length] = sound[:, :length]
    return out


def camera_of(frame: Frame) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy as shares of the picture's width and height."""
    camera = frame.observation.intrinsics
    return (
        camera.fx / camera.width,
        camera.fy / camera.height,
        camera.cx / camera.width,
        camera.cy / camera.height,
    )


def load_method(
    weights: str | Path | None = None,
    *,
    device: str | None = None,
    threshold: float | None = None,
    refine: Refine = "edges",
    hearing: SoundControl = "own",
    looks: Looks = "several",
    calibrated: bool = True,
) -> ListenerMethod:
    """The listener, ready to predict.

    Args:
        weights: file; None: those of the package.
        device: cpu, cuda or cuda:<number>; None: a GPU where there is one.
        threshold: probability above which a pixel is marked; None: the rule of the weights, else `THRESHOLD`.
        refine: see `Refine`.
        hearing: what it hears.
        looks: one or several, see `looks_at`.
        calibrated: take the temperatures and the rule that the weights name, if they do.

    Raises:
        UsageError: if there is no such device.
        Avs3dError: if the weights are missing, damaged, or of another version.

    Examples:
        >>> from avs3d_bench import Dataset
        >>> method = load_method("weights/listener.safetensors", device="cpu", looks="one")  # no file: the package's
        >>> frames = Dataset("data/demo")["part_1/apartment_1/bathroom/1"].test
        >>> [np.asarray(found.mask).shape for found in method.predictions(frames)]
        [(64, 64), (64, 64)]
    """
    from baselines.listener.weights import read_weights

    where = pick_device(device)
    found = read_weights(weights, device=where)
    calibration = found.calibration if calibrated else None
    share = None
    if threshold is None:
        threshold, share = (calibration.threshold, calibration.share) if calibration else (THRESHOLD, None)
    return ListenerMethod(
        found.network, where, found.digest, threshold=threshold, refine=refine, hearing=hearing, looks=looks,
        calibration=calibration, share=share,
    )  # fmt: skip


def write_listener(
    dataset: Dataset,
    path: str | Path,
    model: ListenerMethod,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
    soft: str | Path | None = None,
) -> SubmissionWriter:
    """Write the masks of the test frames as a submission, and in part_3 the class ids.

    Args:
        dataset: what to look at; of test frames only pictures, sound and intrinsics are read.
        path: the submission's folder.
        model: of `load_method`.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: show a bar on stderr.
        soft: new or empty folder for soft masks, which are no part of the submission: ``KEY/masks/frame_000.png`` with
            the probability of each pixel of each test frame as 8 bits of grey; None: none are written.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or a target is not free.
        Avs3dError: if a file is missing or damaged, memory runs out, or the system refuses.

    Examples:
        >>> from avs3d_bench import Dataset
        >>> method = load_method("weights/listener.safetensors", device="cpu", looks="one")
        >>> writer = write_listener(Dataset("data/demo"), "listener", method, only=["part_2/*"], overwrite=True)
        >>> [observation.key for observation in writer.observations]
        ['part_2/apartment_1/kitchen/1']
    """
    name = named("Listener", model.hearing)
    with ExitStack() as stack:
        root = None if soft is None else stack.enter_context(staged_folder(soft, _check_soft))
        predict = partial(model.predictions, soft=root)
        method = Method(name, predict, notes=model.notes, entry="baselines.listener.predict:write_listener")
        return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress)
