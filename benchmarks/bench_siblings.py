"""Cost of a sibling's pictures against that of the first of its group, whose pictures are rendered."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

from generators.core.folders import default_cache
from generators.homes.store import prepare_home
from generators.observation.generate import generate_observation
from generators.observation.prepare import prepare_observation
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest

#: Number of frames, fewer than in an observation: the cost per frame does not depend on it.
FRAMES = 24
#: Two silent siblings: without a source, pictures and masks are all that costs anything.
MANIFEST = """
name: siblings
seed: 1
scans: {apartment_1: {source: apartment, seed: 11}}
observations:
  - part: part_3
    scan: apartment_1
    room: kitchen
    index: 1
    instances: {microwave: 2, oven: 1}
    sources: []
  - {like: part_3/apartment_1/kitchen/1, index: 2, sources: []}
"""


def run_all(repeats: int) -> dict[str, float]:
    """Measure.

    Args:
        repeats: number of runs for each median.

    Returns:
        Figure → value.
    """
    with tempfile.TemporaryDirectory(prefix="avs3d-bench-") as folder:
        path = Path(folder) / "siblings.yaml"
        path.write_text(MANIFEST)
        first, sibling = make_plans(read_manifest(path), GenerateOptions(frames=FRAMES))
        prepare_home(first, default_cache())
        prepare_observation(first, default_cache()).renderer.warm_up()  # both find the arrangement of the room
        costs: dict[str, list[float]] = {"first": [], "sibling": []}
        for number in range(repeats):
            root = Path(folder) / str(number)
            for name, plan, pictures in (("first", first, None), ("sibling", sibling, root / first.key)):
                started = time.process_time()
                generate_observation(plan, root, default_cache(), pictures=pictures)
                costs[name].append(time.process_time() - started)
    each = {name: statistics.median(found) / FRAMES for name, found in costs.items()}
    return {
        "pictures of a frame, rendered (CPU s)": each["first"],
        "pictures of a frame, linked (CPU s)": each["sibling"],
        "pictures of a sibling over rendering them (%)": 100 * each["sibling"] / each["first"],
    }
