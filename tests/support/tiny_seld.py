"""Adds ambisonics that fit the truth to a tiny dataset of part_3, and reads recordings as the DCASE baselines do.

The reader is written from the descriptions of the formats (STARSS23, DCASE 2025 task 3), with nothing of ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AmbisonicsRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from avs3d_bench.geometry import direction_to
from tests.support.tiny_receivers import plane_wave

#: Classes of the baselines: no label may have a higher number.
CLASSES = 13
RATE, LABEL = 24_000, 2_400


def add_foa(root: Path) -> Path:
    """Write first-order ambisonics: of each stem a plane wave from its source, as the pose of the frame hears it."""
    for observation in Dataset(root):
        record = observation.record
        assert record is not None
        for frame in observation.frames:
            clip = np.zeros((4, layout.BINAURAL_SAMPLES), dtype=np.float32)
            for source in record.sound_sources:
                where = direction_to(frame.pose, source.position)
                clip += plane_wave(frame.stem(source.id).mean(axis=0), where.azimuth, where.elevation)
            path = observation.path / layout.audio_path(layout.clips_folder(layout.AMBISONICS), frame.index)
            media.write_wav(path, clip)
        acoustics = record.acoustics.model_copy(update={"ambisonics": AmbisonicsRecord(order=1)})
        media.write_json(observation.path / layout.OBSERVATION_JSON, record.model_copy(update={"acoustics": acoustics}))
    return root


def sound_of(path: Path) -> NDArray[np.float64]:
    """(n, channels) as the baselines read it: 16 bit, 24 kHz."""
    rate, samples = wavfile.read(path)
    assert rate == RATE
    assert samples.dtype == np.int16
    return np.asarray(samples / 32768.0)


def labels_of(path: Path, header: str = "") -> dict[int, list[list[float]]]:
    """Label frame → rows without the frame, as the baselines read them: whole numbers between commas."""
    lines = path.read_text().splitlines()
    if header:
        assert lines.pop(0) == header
    found: dict[int, list[list[float]]] = {}
    for line in lines:
        frame, *row = (int(word) for word in line.split(","))
        found.setdefault(frame, []).append([float(value) for value in row])
    return found


def vector(azimuth: float, elevation: float = 0.0) -> NDArray[np.float64]:
    """(3,) forward, left, up: how a baseline turns its labels into ACCDOA targets."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def accdoa(labels: dict[int, list[list[float]]], frames: int) -> NDArray[np.float64]:
    """(frames, 3, CLASSES) activity-coupled directions of STARSS23 labels."""
    out = np.zeros((frames, 3, CLASSES))
    for frame, rows in labels.items():
        for class_index, _, azimuth, elevation, _ in rows:
            out[frame, :, int(class_index)] = vector(azimuth, elevation)
    return out


def intensity(sound: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
    """(3,) unit vector of the active intensity of a label frame: W·X, W·Y, W·Z, channels W, Y, Z, X."""
    piece = sound[frame * LABEL : (frame + 1) * LABEL]
    found = np.array([np.mean(piece[:, 0] * piece[:, axis]) for axis in (3, 1, 2)])
    return np.asarray(found / np.linalg.norm(found))


def angle(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Degrees between unit vectors."""
    return float(np.degrees(np.arccos(np.clip(one @ other, -1, 1))))
