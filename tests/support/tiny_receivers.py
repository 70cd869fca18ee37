"""Adds the clips of first-order ambisonics and of an array to a tiny dataset: plane waves from the source."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AmbisonicsRecord, ArrayRecord, MicrophoneRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from tests.support import tiny

ARRAY = ArrayRecord(
    microphones=(
        MicrophoneRecord(name="centre", position=(0, 0, 0)),
        MicrophoneRecord(name="right", position=(0.1, 0, 0)),
        MicrophoneRecord(name="ahead", position=(0, 0, -0.1)),
    )
)


def plane_wave(samples: np.ndarray, azimuth: float, elevation: float) -> np.ndarray:
    """(4, n) first-order ambisonics of a wave (n,) from a direction; degrees, azimuth positive right."""
    left, up = np.radians(-azimuth), np.radians(elevation)
    gains = [1.0, np.sin(left) * np.cos(up), np.sin(up), np.cos(left) * np.cos(up)]  # W, Y, Z, X
    return np.outer(gains, samples).astype(np.float32)


def add_waves(root: Path) -> None:
    """Write first-order ambisonics of a dataset of part_3: waves from ahead; its hashes are not renewed."""
    for observation in Dataset(root):
        record = observation.record
        assert record is not None
        for frame in observation.frames:
            path = observation.path / layout.audio_path(layout.clips_folder(layout.AMBISONICS), frame.index)
            media.write_wav(path, plane_wave(frame.audio().mean(axis=0), 0.0, 0.0))
        acoustics = record.acoustics.model_copy(update={"ambisonics": AmbisonicsRecord(order=1)})
        media.write_json(observation.path / layout.OBSERVATION_JSON, record.model_copy(update={"acoustics": acoustics}))


def add_receivers(root: Path, *, order: int = 1) -> Path:
    """Write the clips of both receivers, and renew the records; channels beyond the first order are silent."""
    records = []
    for observation in Dataset(root):
        record = observation.record
        assert record is not None
        files, sizes = dict(record.files), dict(record.sizes or {})
        for frame, entry in zip(observation.frames, record.frames, strict=True):
            assert entry.azimuth is not None
            assert entry.elevation is not None
            mono = frame.audio().mean(axis=0)
            first = plane_wave(mono, entry.azimuth, entry.elevation)
            silent = np.zeros(((order + 1) ** 2 - 4, len(mono)), dtype=np.float32)
            clips = {layout.AMBISONICS: np.concatenate([first, silent]), layout.ARRAY: np.stack([mono] * 3)}
            for name, clip in clips.items():
                path = layout.audio_path(layout.clips_folder(name), frame.index)
                media.write_wav(observation.path / path, clip)
                files[path] = media.sha256_file(observation.path / path)
                sizes[path] = (observation.path / path).stat().st_size
        acoustics = record.acoustics.model_copy(update={"ambisonics": AmbisonicsRecord(order=order), "array": ARRAY})
        renewed = {"acoustics": acoustics, "files": files, **({"sizes": sizes} if record.sizes else {})}
        records.append(record.model_copy(update=renewed))
        media.write_json(observation.path / layout.OBSERVATION_JSON, records[-1])
    tiny.write_dataset_json(root, records)
    return root
