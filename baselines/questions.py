"""Solvers of the questions of `avs3d export qa` without a language model: what two ears alone can answer.

    spatial   the direction of the interaural delay (GCC-PHAT) answers where a sound is and which marked object it is;
              interaural coherence tells a source from diffuse noise and silence
    deaf      knows the question and what the picture shows, and hears nothing
    blind     as `spatial`, but sees no picture: it guesses which letter is where

They know from scenes.json what eyes would tell: where the marked objects are. What direction does not tell (how far,
how many, which room), `spatial` answers with what is commonest: near, one, here. Nothing is tuned: the one threshold
is between the coherence of a diffuse field above 1 kHz, which is near 0, and that of a source in a room.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfftfreq

from avs3d_bench.contract import layout
from avs3d_bench.contract.questions import (
    SCENES_JSON,
    AnswerLine,
    QuestionLine,
    ScenesRecord,
    ShownObject,
)
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.qa.templates import NOTHING, Templates, templates
from avs3d_bench.formats.files import read_record, write_bytes
from avs3d_bench.formats.media import read_wav
from avs3d_bench.formats.questions import read_questions
from avs3d_bench.runtime.parallel import process_each
from baselines.echosegnet.binaural import WINDOW, lateral_angle, spectrogram
from baselines.references import delay_angle

#: Band in which the ears of a head are incoherent in a diffuse field (Hz): above c / 2d, d = 17.5 cm …
COHERENCE_BAND = (1000.0, 6000.0)
#: … and the coherence below which nothing but such a field, or nothing at all, is heard.
LEAST_COHERENCE = 0.2
#: Change of the lateral angle of a sound that has moved (degrees).
LEAST_MOVE = 10.0

Answer = Callable[[QuestionLine, Path, Sequence[ShownObject]], str]


def write_answers(solver: str, questions: str | Path, output: str | Path, *, progress: bool = False) -> int:
    """Answer every question of a folder and write JSON lines; the number of lines.

    Args:
        solver: of `SOLVERS`.
        questions: what `avs3d export qa` wrote.
        output: the file.
        progress: show a bar on stderr.

    Raises:
        UsageError: if there is no such solver, or the folder holds no questions.
        Avs3dError: if a file is damaged or missing.
    """
    if solver not in SOLVERS:
        raise UsageError(f"solver {solver!r}: expected one of {', '.join(SOLVERS)}")
    folder = Path(questions)
    lines = read_questions(folder)
    answers = dict(process_each(_Solver(solver, folder), lines, workers=1, label="answer", progress=progress))
    text = "".join(f"{AnswerLine(id=line.id, answer=answers[line]).model_dump_json()}\n" for line in lines)
    write_bytes(output, text.encode())
    return len(lines)


class _Solver:
    """A solver with the scenes of a folder."""

    def __init__(self, solver: str, folder: Path) -> None:
        self.answer, self.folder = SOLVERS[solver], folder
        self.scenes = read_record(folder / SCENES_JSON, ScenesRecord).scenes

    def __call__(self, line: QuestionLine) -> str:
        return self.answer(line, self.folder, self.scenes.get(line.pictures[0], ()))


def answer_one(solver: str, line: QuestionLine, folder: Path) -> str:
    """The answer to one question; see `write_answers`."""
    return _Solver(solver, folder)(line)


# --- Solvers ----------------------------------------------------------------------------------------------------------


def deaf_answer(line: QuestionLine, _folder: Path, shown: Sequence[ShownObject]) -> str:
    """The best guess from the picture: the first marked object; else the option that is met most often in a room."""
    texts, marks = templates(), [one.mark for one in shown if one.mark in line.options]
    if marks:
        return str(marks[0])
    return next(text for text in line.options if texts.meaning(line.kind, text) not in (NOTHING, "0", "no"))


def spatial_answer(line: QuestionLine, folder: Path, shown: Sequence[ShownObject]) -> str:
    """The answer that two ears give, and eyes that know where the marked objects are.

    Raises:
        Avs3dError: if a clip is missing or damaged.
    """
    angles = [_lateral_degrees(read_wav(folder / name).samples) for name in line.audio]
    return _answer(line, angles, {one.mark: one for one in shown if one.mark in line.options})


def blind_answer(line: QuestionLine, folder: Path, _shown: Sequence[ShownObject]) -> str:
    """The same without eyes: letters are taken to stand in their order from left to right, 30° apart."""
    angles = [_lateral_degrees(read_wav(folder / name).samples) for name in line.audio]
    letters = sorted(text for text in line.options if len(text) == 1)
    middle = (len(letters) - 1) / 2
    return _answer(line, angles, {
        letter: ShownObject(mark=letter, category="unknown", azimuth=30 * (n - middle), elevation=0, distance=2)
        for n, letter in enumerate(letters)
    })  # fmt: skip


#: Name → solver.
SOLVERS: Mapping[str, Answer] = {"spatial": spatial_answer, "blind": blind_answer, "deaf": deaf_answer}


def _answer(line: QuestionLine, angles: Sequence[float | None], marked: Mapping[str | None, ShownObject]) -> str:
    """The option that fits best what is heard.

    Args:
        line: the question.
        angles: lateral angle of each clip, degrees; None where no source is heard.
        marked: letter → where it is.
    """
    texts = templates()
    known = {texts.meaning(line.kind, text): text for text in line.options}
    heard = [angle for angle in angles if angle is not None]
    if len(heard) < len(angles) or not heard:
        return next(known[name] for name in (NOTHING, "0", "no", *known) if name in known)
    if line.kind == "which":
        return min((letter for letter in line.options if letter in marked),
                   key=lambda letter: abs(_lateral_of(marked[letter]) - heard[0]))  # fmt: skip
    ranked = _wanted(line, heard, texts)
    return next(known[name] for name in (*ranked, *known) if name in known)


def _wanted(line: QuestionLine, heard: Sequence[float], texts: Templates) -> Iterator[str]:
    """Meanings of options, the best first."""
    if line.kind == "side":
        yield "left" if heard[0] < 0 else "right"
    elif line.kind == "azimuth":
        edges = texts.kinds["azimuth"].bins or ()
        middles = {name: (low + high) / 2 for name, low, high in
                   zip(texts.kinds["azimuth"].options, edges, edges[1:], strict=False)}  # fmt: skip
        yield from sorted(middles, key=lambda name: abs(middles[name] - heard[0]))
    elif line.kind == "moved":
        change = heard[-1] - heard[0]
        moved = "right" if change > 0 else "left"
        yield from (moved, "stayed") if abs(change) >= LEAST_MOVE else ("stayed", moved)
    else:
        yield from {"distance": ("near", "middle"), "count": ("1",), "anything": ("yes",), "room": ("here",)}[line.kind]


def _lateral_of(one: ShownObject) -> float:
    """Lateral angle of an object in a picture, degrees, positive right."""
    azimuth, elevation = np.radians([one.azimuth, one.elevation])
    ahead, side = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    return float(np.degrees(lateral_angle(np.array([[side, np.sin(elevation), -ahead]]))[0]))


# --- What is heard ----------------------------------------------------------------------------------------------------


def _lateral_degrees(clip: NDArray[np.float32]) -> float | None:
    """Lateral angle of what is heard in a clip (2, n), degrees, positive right; None where no source is."""
    angle = delay_angle(clip)
    return None if angle is None or coherence(clip) < LEAST_COHERENCE else float(np.degrees(angle))


def coherence(clip: NDArray[np.float32]) -> float:
    """Interaural coherence of a clip (2, n) at 44.1 kHz: mean over the bins of `COHERENCE_BAND`, 0 to 1.

    |Σ R L*| / √(Σ |R|² Σ |L|²), sums over time (Faller and Merimaa, JASA 116, 2004, without its forgetting).
    """
    spectrum = spectrogram(clip)
    frequencies = rfftfreq(WINDOW, 1 / layout.SAMPLE_RATE)
    left, right = spectrum[:, :, (frequencies >= COHERENCE_BAND[0]) & (frequencies < COHERENCE_BAND[1])]
    cross = np.abs((right * np.conj(left)).sum(axis=0))
    power = np.sqrt((np.abs(left) ** 2).sum(axis=0) * (np.abs(right) ** 2).sum(axis=0))
    return float(np.mean(cross / np.maximum(power, np.finfo(float).tiny)))
