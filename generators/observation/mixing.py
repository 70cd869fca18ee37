"""The mix of an observation: stems and background become clips, and tell what is audible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import BackgroundRecord
from generators.acoustics.background import diffuse_noise, diffuse_seconds
from generators.acoustics.clips import check_clip
from generators.observation.prepare import PreparedObservation
from generators.observation.stems import Clip, Stem, decibels, mixture, power
from generators.plan import ObservationPlan

#: Without sources, a background's SNR refers to this level (dB re full scale): about the mean level of one source in a
#: room of the open benchmark (docs/part-3.md).
REFERENCE_LEVEL_DB = -35.0


def make_background(
    plan: ObservationPlan, stems: Sequence[Sequence[Stem]]
) -> tuple[BackgroundRecord | None, NDArray[np.float32]]:
    """The background of an observation at the level that gives its SNR.

    Args:
        plan: of the observation.
        stems: for every second, the stem of each source.

    Returns:
        Its record, and its samples (2, seconds · 44100); None and no samples without a background.
    """
    spec = plan.spec.background
    if spec is None:
        return None, np.zeros((2, 0), dtype=np.float32)
    noise = diffuse_noise(spec.kind, len(stems), plan.own_rng("background"))
    mean = float(np.mean([power(mixture([stem.clip for stem in second])) for second in stems]))
    level = (decibels(mean) if mean > 0 else REFERENCE_LEVEL_DB) - spec.snr_db
    noise *= np.float32(10 ** (level / 20))
    return BackgroundRecord(kind=spec.kind, snr_db=spec.snr_db, level_db=decibels(power(noise))), noise


def other_backgrounds(
    plan: ObservationPlan, background: BackgroundRecord | None, seconds: int
) -> Iterator[dict[str, Clip]]:
    """For every second: name of each receiver beside the two ears → its background (channels, 44100).

    Every receiver hears another draw of the same diffuse field. Its level is that of the sound pressure at a point,
    which is the level at each ear. There is none where there is no background, or no such receiver.
    """
    others = plan.options.receivers.others()
    if background is None or not others:
        return
    scale = np.float32(10 ** (background.level_db / 20))
    fields = {
        name: diffuse_seconds(background.kind, one.diffuse_covariance, seconds, plan.own_rng(f"background/{name}"))
        for name, one in others.items()
    }
    for _ in range(seconds):
        yield {name: next(field) * scale for name, field in fields.items()}


def stems_of(
    prepared: PreparedObservation, second: Sequence[Stem], noise: NDArray[np.float32], index: int
) -> dict[str, Clip]:
    """Name → stem (2, 44100) of second ``index``: every source, and the background if there is one."""
    stems = {source.id: stem.clip for source, stem in zip(prepared.sources, second, strict=True)}
    if noise.shape[1]:
        rate = layout.SAMPLE_RATE
        stems[layout.BACKGROUND] = noise[:, index * rate : (index + 1) * rate]
    return stems


def mix(prepared: PreparedObservation, stems: Sequence[Clip], index: int, receiver: str | None = None) -> Clip:
    """The clip (channels, 44100) of second ``index``: the sum of its stems.

    Args:
        prepared: the part that is fixed before the first frame.
        stems: (channels, 44100) of each source, and the background if there is one.
        index: of the second.
        receiver: that hears them; None: the two ears.

    Raises:
        Avs3dError: if the clip is not finite, exceeds full scale, or is silent where it must not be.
    """
    clip = mixture(stems, prepared.plan.options.receivers.channels[receiver] if receiver else 2)
    where = f"{prepared.plan.key}, frame {index}" + (f", {receiver}" if receiver else "")
    most = layout.PEAK_CEILING if prepared.lowered_db else 1.0
    check_clip(clip, where, silence=prepared.rules.may_be_silent, most=most)
    return clip
