"""What the listener of the package takes for a frame of the benchmark's size on a CPU, in all."""

from __future__ import annotations

import statistics
import time

import numpy as np


def run_all(repeats: int) -> dict[str, float]:
    """Measure.

    Args:
        repeats: number of frames for the median.

    Returns:
        Figure → value.
    """
    import torch

    from baselines.listener import masks
    from baselines.listener.predict import load_method

    torch.set_num_threads(1)  # several wait for each other busily, which would count
    method = load_method(device="cpu")
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (1008, 1008, 3), dtype=np.uint8)
    sound = rng.normal(0, 0.1, (1, 2, 44_100)).astype(np.float32)
    camera = np.full((1, 4), 0.5, np.float32)

    def once() -> float:
        start = time.process_time()
        with torch.inference_mode():
            (found,) = method.answers([picture], sound, camera)
            # In noise nothing is found: a peak makes the mask pass all of its rule.
            found.mask[100:150, 100:150] = 5
            masks.class_map(method.mask(found.mask, picture), found)
        return time.process_time() - start

    once()
    return {"listener, frame of 1008² (CPU s)": statistics.median(once() for _ in range(repeats))}
