"""`--vision cuda` against the CPU renderer: in numba's simulator on a few pixels, on a device at full size."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from generators.core.cuda import OutOfDeviceMemoryError, cuda_problem
from generators.vision import cuda as gpu
from generators.vision.base import RenderedView

TRIAL = Path(__file__).parents[1] / "support" / "cuda_vision_trial.py"
#: What the GPU renderer is held to: share of equal ids, depth (m), PSNR (dB).
IDS, DEPTH, PSNR = 0.9999, 1e-4, 45.0


def trial(mode: str, **env: str) -> tuple[float, float, float]:
    """Worst agreement of the trial's frames: share of equal ids, depth (m), PSNR (dB)."""
    done = subprocess.run(
        [sys.executable, str(TRIAL), mode],
        env={**os.environ, "PYTHONWARNINGS": "ignore", **env},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
    equal, apart, psnr = map(float, done.stdout.split()[-3:])
    return equal, apart, psnr


@pytest.mark.slow
def test_frames_are_those_of_the_cpu_in_the_simulator() -> None:
    equal, apart, psnr = trial("simulator", NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")
    assert equal >= IDS
    assert apart <= DEPTH
    assert psnr >= PSNR


@pytest.mark.slow
def test_frames_are_those_of_the_cpu_on_a_device() -> None:
    if cuda_problem() is not None:
        pytest.skip(f"no CUDA device: {cuda_problem()}")
    equal, apart, psnr = trial("device")
    assert equal >= IDS
    assert apart <= DEPTH
    assert psnr >= PSNR


def test_agreement_counts_ids_metres_and_decibels() -> None:
    rgb = np.zeros((10, 10, 3), np.uint8)
    depth, ids = np.ones((10, 10), np.float32), np.zeros((10, 10), np.uint16)
    other = RenderedView(rgb.copy(), depth.copy(), ids.copy())
    other.rgb[...] = 1
    other.depth[...] += np.float32(0.5)
    other.instance_ids[0, :5] = 3
    equal, apart, psnr = gpu.agreement(RenderedView(rgb, depth, ids), other)
    assert equal == 0.95
    assert apart == 0.5
    assert psnr == pytest.approx(10 * np.log10(255**2))


def test_too_little_memory_for_all_rays_takes_fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    class Rays:
        def __init__(self, count: int) -> None:
            tried.append(count)
            if count > 300_000:
                raise OutOfDeviceMemoryError("full")
            self.count = count

    most = gpu._Rays.most
    monkeypatch.setattr(gpu, "_Rays", Rays)
    assert most(1 << 20).count == 1 << 18
    assert tried == [1 << 20, 1 << 19, 1 << 18]
    monkeypatch.setattr(gpu, "LEAST_RAYS", 1 << 19)
    with pytest.raises(OutOfDeviceMemoryError):
        most(1 << 20)
