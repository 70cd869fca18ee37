"""The record of the acoustic simulation against the sound: reverberation time and gain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.measures.decay import eyring, reverberation_time
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.interaural import Hearing

#: Responses from which T30 is measured, and how much that may differ from the recorded value (share): the generator
#: measures it on others.
_RESPONSES, T30_TOLERANCE = 8, 0.25
#: Mean absorption of the barest room (share of the energy), for the longest T30 that is plausible without responses.
LEAST_ABSORPTION = 0.03
#: Name of the setting that scales the absorption of all surfaces.
_SCALE = "absorption_scale"
#: What sources have at 1 m without a gain: loudness (LUFS), or, where peaks limit it, true peak (dB re full scale).
SOURCE_LUFS, SOURCE_PEAK_DB = -18.0, -1.0
#: Levels of the clips re that, with room, head and weighting (dB): 2 to 16 in furnished and bare rooms of 16 to 430 m³.
GAIN_RANGE_DB = (-3.0, 25.0)
#: The loudest of this share of the clips are judged: sounds have pauses. Fewer clips are no sample.
_LOUDEST, _LEAST_CLIPS = 0.25, 4
#: Nearer than this, sound grows no louder (m).
_NEAREST = 0.3


def check_reverberation(
    observation: Observation, record: ObservationRecord, files: set[str], findings: Findings
) -> None:
    """The recorded T30 is that of the responses, or where there are none, plausible for a room of this size.

    Args:
        observation: its responses, and its sparse points, which tell the size of the room.
        record: its observation.json.
        files: the files found.
        findings: where problems go.
    """
    said = record.acoustics.t30
    if said is None:
        return
    found = _measured(observation, record, files)
    if found is not None:
        if abs(said - found) > T30_TOLERANCE * found:
            text = f"acoustics.t30 is {said:.3g} s, the responses have {found:.3g} s"
            findings.add(layout.OBSERVATION_JSON, text)
        return
    if not files.issuperset(layout.COLMAP_FILES):
        return
    try:
        points = observation.colmap.points.positions
    except Avs3dError:
        return  # already named
    places = np.concatenate([points, [frame.position for frame in record.frames]])
    x, y, z = (places.max(axis=0) - places.min(axis=0)).tolist()
    scale = record.acoustics.settings.get(_SCALE, 1.0)
    if min(x, y, z) <= 0 or not isinstance(scale, int | float) or not scale > 0:
        return
    absorption = -math.expm1(float(scale) * math.log1p(-LEAST_ABSORPTION))
    longest = eyring(x * y * z, 2 * (x * y + y * z + z * x), absorption)
    if said > longest:
        text = (
            f"acoustics.t30 is {said:.3g} s; a room of {x:.1f} × {z:.1f} × {y:.1f} m, as large as all that is seen, "
            f"rings for {longest:.2g} s at most (absorption {absorption:.1%})"
        )
        findings.add(layout.OBSERVATION_JSON, text)


def _measured(observation: Observation, record: ObservationRecord, files: set[str]) -> float | None:
    """T30 of the responses of the first source in the room; None without them."""
    source = None if record.sources is None else next((one.id for one in record.sources if one.instance), None)
    frames = observation.frames[:: max(1, len(observation.frames) // _RESPONSES)]
    responses = []
    for frame in frames:
        if layout.rir_path(frame.index, source) in files:
            with suppress(Avs3dError):  # damaged: already named
                responses.append(frame.impulse_response(source))
    return reverberation_time(responses, layout.SAMPLE_RATE) if responses else None


def check_gain(record: ObservationRecord, heard: Sequence[Hearing], findings: Findings) -> None:
    """With the recorded gain, sources have the level at 1 m that all sources have."""
    if len(heard) < _LEAST_CLIPS:
        return
    levels = []
    for one in heard:
        rms, peak = float(np.sqrt(np.mean(np.square(one.sound.rms)))), float(np.abs(one.sound.samples).max())
        near = max(one.distance, _NEAREST) / record.acoustics.gain / 10 ** (one.gain_db / 20)
        levels.append(max(rms * near / 10 ** (SOURCE_LUFS / 20), peak * near / 10 ** (SOURCE_PEAK_DB / 20)))
    loudest = np.sort(levels)[-max(1, round(_LOUDEST * len(levels))) :]
    above = 10 * math.log10(max(float(np.mean(np.square(loudest))), 1e-30))
    # A source sends less power into the room by its directivity index than one that is alike in all directions.
    indices = [index for one in record.sound_sources if one.directivity for index in one.directivity.index_db.values()]
    low, high = GAIN_RANGE_DB[0] - max(indices, default=0.0), GAIN_RANGE_DB[1]
    if not low <= above <= high:
        text = (
            f"acoustics.gain is {record.acoustics.gain:g}: with it, the source is {above:+.1f} dB re all sources "
            f"({SOURCE_LUFS:g} LUFS or a peak of {SOURCE_PEAK_DB:g} dB at 1 m), expected {low:g} to {high:g} dB"
        )
        findings.add(layout.OBSERVATION_JSON, text)
