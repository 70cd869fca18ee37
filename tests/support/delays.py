"""Sound whose delay between the ears is that of a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Frame
from baselines.echosegnet.binaural import lateral_angle, woodworth_itd


def delayed(place: NDArray[np.float64], frame: Frame) -> NDArray[np.float32]:
    """A second of noise (2, n) from ``place`` as a sphere hears it from a frame's pose: delay and distance."""
    here = frame.pose.to_camera(place)
    spectrum = np.fft.rfft(np.random.default_rng(int(frame.index)).standard_normal(44_100))
    turn = -2j * np.pi * np.fft.rfftfreq(44_100, 1 / 44_100) * woodworth_itd(lateral_angle(here))
    both = np.stack([np.fft.irfft(spectrum * np.exp(turn)), np.fft.irfft(spectrum)]) / np.linalg.norm(here)
    return both.astype(np.float32)
