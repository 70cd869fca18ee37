"""Reference rows of ``listen``: simple rules that choose among perfect candidates by one property of the sound.

    category   every instance of a category that is heard: no rule, no place
    level      monaural: the instance whose distance over the walk explains the level of the mono sum best
    ild        interaural level: an instance on the side of the louder ear
    gcc-phat   interaural delay: the instance nearest to the direction that the delay gives

All of them know from the truth which categories are audible in a frame, and how many sources of each (so silence, too);
their masks are the true ones. So they say what *place* alone is worth: what each adds to ``category`` comes from the
named property of the sound. A rule reads the binaural clips, the poses, and where the instances of the heard categories
stand (the middle of their bounds); it marks as many of them as sources of the category are audible, the best first, the
lower id of equals. A source in another room counts as well, for the rule cannot know better: it costs a mark where an
instance of its category stands in the room. Nothing is marked where nothing is heard.

The rules take a clip as a whole: where several sources sound at a time, a rule hears their mixture.

References:
    C. H. Knapp, G. C. Carter, "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP 24
    (1976) 320–327.
    R. S. Woodworth, *Experimental Psychology*, Holt 1938, pp. 520–523.
    J. Blauert, *Spatial Hearing*, MIT Press 1997, §2.4 (interaural cues), §2.3.1 (level and distance).

Examples:
    >>> from avs3d_bench import Dataset
    >>> writers = references.write_references(Dataset("data/listen"), "references", overwrite=True)
    >>> list(writers)
    ['category', 'level', 'ild', 'gcc-phat']
    >>> references.level_difference(np.array([[0.1, 0.1], [0.2, 0.2]])) > 0  # the right ear is louder
    True
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfftfreq

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import InstanceRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter
from baselines.echosegnet.binaural import WINDOW, lateral_angle, spectrogram, woodworth_itd
from baselines.oracle import oracle_prediction, paint

Array = NDArray[np.float64]
#: How well each candidate fits what is heard in a frame, higher is better.
Score = Callable[[Frame, Sequence[InstanceRecord]], Array]

#: `truth` of submission.json: leaderboards do not rank such submissions.
TRUTH = "masks of test frames, and which categories are audible in each"
#: Least number of frames whose levels say something of a distance profile.
_FEWEST_FRAMES = 3
#: Where the delay is read (Hz): below, a room's modes rule; above, a steady tone's phase is ambiguous many times over.
PHAT_BAND = (200.0, 8000.0)
#: Lateral angles (radians) whose delays are tried.
_LATERALS = np.radians(np.arange(-90.0, 90.5, 0.5))


def write_references(
    dataset: Dataset,
    folder: str | Path,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    workers: int | None = 1,
    progress: bool = False,
) -> dict[str, SubmissionWriter]:
    """Write every reference as a submission in a folder of its own name; the same bytes for any number of workers.

    Args:
        dataset: what to look at; it must have instances and their masks.
        folder: the folder of all submissions.
        only: shell patterns of observation keys.
        overwrite: replace existing submissions.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Returns:
        Name → writer, in the order of `REFERENCES`.

    Raises:
        UsageError: if no observation is of part_3, the data lacks what this needs, or a target is not free.
        Avs3dError: if the dataset is damaged or the system refuses.
    """
    only = tuple(only)
    chosen = dataset.select(*only)
    if not any(observation.is_part_3 for observation in chosen):
        raise UsageError(f"{dataset.root}: no observation of part_3; expected some: the references compare siblings")
    for observation in chosen:
        if observation.record is None or not (observation.path / layout.INSTANCE_MASKS).is_dir():
            raise UsageError(
                f"{observation.path}: the references need {layout.OBSERVATION_JSON} and {layout.INSTANCE_MASKS}/; "
                "expected a dataset with its truth (a sealed test does not publish it)"
            )
    written = {}
    for name, what in REFERENCES.items():
        method = Method(
            f"reference ({name})",
            partial(reference_masks, name),
            notes=f"uses the ground truth of test frames and which categories are audible in them; marks {what}",
            truth=TRUTH,
            entry="baselines.references:write_references",
        )
        written[name] = write_submission(
            dataset, Path(folder) / name, method, only=only, overwrite=overwrite, workers=workers, progress=progress
        )
    return written


#: Name → what it marks.
REFERENCES: Mapping[str, str] = {
    "category": "every instance of the categories that are heard",
    "level": "of these, those whose distances explain the levels of the mono sum best",
    "ild": "of these, those on the side of the louder ear",
    "gcc-phat": "of these, those nearest to the direction of the interaural delay",
}


def reference_masks(name: str, frames: Sequence[Frame]) -> Iterator[Prediction]:
    """The predictions of a reference for frames of one observation.

    Raises:
        UsageError: if there is no reference of that name.
        Avs3dError: if a file of the dataset is damaged.
    """
    if name not in REFERENCES:
        raise UsageError(f"reference {name!r}: expected one of {', '.join(REFERENCES)}")
    if name == "category":
        return (oracle_prediction(frame, instance="category") for frame in frames)
    score = _SCORES[name](frames[0].observation)
    return (_prediction(frame, score) for frame in frames)


def _prediction(frame: Frame, score: Score) -> Prediction:
    observation, record, entry = frame.observation, frame.observation.record, frame.record
    assert record is not None, "checked by write_references"
    assert entry is not None, "it comes with the record"
    # What has no class id is never marked: a distractor is silent, even while one is heard from another room.
    heard = Counter(one.category for one in record.audible_sources(entry) if one.category in record.class_ids)
    chosen: list[InstanceRecord] = []
    for category, count in sorted(heard.items()):
        candidates = sorted((one for one in record.instances if one.category == category), key=lambda one: one.id)
        if len(candidates) > count:
            best = np.argsort(-score(frame, candidates), kind="stable")[:count]
            candidates = [candidates[place] for place in best]
        chosen += candidates
    marked = paint(frame.instance_ids(), {one.id: record.class_ids[one.category] for one in chosen})
    return Prediction(marked > 0, marked if observation.is_part_3 else None)


# --- The rules --------------------------------------------------------------------------------------------------------


def level_score(observation: Observation) -> Score:
    """The monaural rule: correlation of level (dB) and −20·log₁₀(distance) over the frames with the category.

    A free field has this law; reverberation flattens it, which leaves a correlation as it is. The choice
    is one for the whole walk: a source that takes turns with its twin is beyond it.
    """
    record = observation.record
    assert record is not None, "checked by write_references"
    frames = observation.frames
    entries = [frame.record for frame in frames]
    heard = [{source.category for source in record.audible_sources(entry)} if entry else set() for entry in entries]
    levels = np.array([mono_level(frame.audio()) for frame in frames])
    places = np.array([frame.pose.position for frame in frames])

    def score(_frame: Frame, candidates: Sequence[InstanceRecord]) -> Array:
        used = np.array([candidates[0].category in some for some in heard]) & np.isfinite(levels)
        middles = np.array([[middle(one, frame) for one in candidates] for frame in frames])
        distances = np.linalg.norm(places[used, None] - middles[used], axis=-1)
        return np.array([correlation(levels[used], -20 * np.log10(column)) for column in distances.T])

    return score


def ild_score(_observation: Observation) -> Score:
    """The rule of the louder ear: candidates on its side first, of these the middle one, by lateral angle.

    The sign of the level difference names a side and no more, so that among several candidates on that side nothing is
    known: the one nearest to their median is taken. If there is none on that side, the one nearest to the middle.
    """

    def score(frame: Frame, candidates: Sequence[InstanceRecord]) -> Array:
        lateral = lateral_angles(frame, candidates)
        beside = np.sign(lateral) == np.sign(level_difference(frame.audio()))
        centre = np.median(lateral[beside]) if beside.any() else 0.0
        return np.where(beside, np.pi, 0.0) - np.abs(lateral - centre)

    return score


def delay_score(_observation: Observation) -> Score:
    """The rule of the interaural delay: the candidate whose lateral angle is nearest to that of the delay."""

    def score(frame: Frame, candidates: Sequence[InstanceRecord]) -> Array:
        heard = delay_angle(frame.audio())
        return np.zeros(len(candidates)) if heard is None else -np.abs(lateral_angles(frame, candidates) - heard)

    return score


_SCORES: Mapping[str, Callable[[Observation], Score]] = {
    "level": level_score,
    "ild": ild_score,
    "gcc-phat": delay_score,
}


# --- What is heard ----------------------------------------------------------------------------------------------------


def mono_level(clip: NDArray[np.floating]) -> float:
    """RMS of the sum of both ears of a clip (2, n), dB re full scale; −inf for silence."""
    power = float(np.mean(np.square(clip.mean(axis=0, dtype=np.float64))))
    return 10 * float(np.log10(power)) if power > 0 else -np.inf


def level_difference(clip: NDArray[np.floating]) -> float:
    """Energy of the right ear of a clip (2, n) minus that of the left one; its sign is the side of the louder ear."""
    left, right = np.square(clip, dtype=np.float64).sum(axis=1)
    return float(right - left)


def delay_angle(clip: NDArray[np.floating]) -> float | None:
    """Lateral angle (radians, positive right) of the interaural delay of a clip (2, n) at 44.1 kHz; None of silence.

    The generalised cross-correlation with the phase transform: every time–frequency bin of `PHAT_BAND` counts with its
    phase alone. Its maximum is looked for at the delays of Woodworth's sphere, so that its place is an angle at once.
    """
    if clip.shape[1] < WINDOW or not clip.any(axis=1).all():
        return None
    spectrum = spectrogram(clip)
    frequencies = rfftfreq(WINDOW, 1 / layout.SAMPLE_RATE)
    used = (frequencies >= PHAT_BAND[0]) & (frequencies < PHAT_BAND[1])
    cross = (spectrum[1] * np.conj(spectrum[0]))[:, used]
    phase = (cross / np.maximum(np.abs(cross), np.finfo(float).tiny)).sum(axis=0)
    # The left ear lags by the delay of a source on the right: the right ear's phase is ahead by 2πfτ.
    steering = np.exp(-2j * np.pi * frequencies[used] * woodworth_itd(_LATERALS)[:, None])
    return float(_LATERALS[np.argmax((steering @ phase).real)])


def correlation(first: Array, second: Array) -> float:
    """Pearson's, of two profiles (n,); 0 where one is constant or there are fewer than `_FEWEST_FRAMES` values."""
    if len(first) < _FEWEST_FRAMES:
        return 0.0
    one, other = first - first.mean(), second - second.mean()
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 1e-9 else 0.0


def lateral_angles(frame: Frame, candidates: Sequence[InstanceRecord]) -> Array:
    """(candidates,) lateral angle of each from the pose of a frame, radians, positive right."""
    return lateral_angle(frame.pose.to_camera(np.stack([middle(one, frame) for one in candidates])))


def middle(instance: InstanceRecord, frame: Frame) -> Array:
    """(3,) the middle of an instance's bounds at the time of a frame, metres, world coordinates."""
    record, entry = frame.observation.record, frame.record
    if record is None or entry is None:
        return np.asarray(np.mean(instance.bounds, axis=0))
    return np.asarray(record.middle_at(entry, instance))
