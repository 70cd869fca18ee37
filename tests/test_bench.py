"""The stopwatch of `make bench` fits the generator that it measures."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from benchmarks.bench_pipeline import timed_engines
from generators import observation as story
from generators.plan import make_plans, read_manifest
from tests.homes import write_manifest


def test_the_engines_inside_an_observation_are_timed_and_then_left_alone(tmp_path: Path) -> None:
    plan = make_plans(read_manifest(write_manifest(tmp_path)), only=["part_1/*"], frames=8, audio="analytic")[0]
    spent: dict[str, float] = defaultdict(float)
    frames: list[int] = []
    with timed_engines(spent):
        assert story.vision_backend.__name__ == "made"
        story.generate_observation(plan, tmp_path / "data", tmp_path / "cache", frames.append)
    assert frames == list(range(8))
    assert set(spent) == {"render", "impulse response", "convolve", "encode"}
    assert all(seconds > 0 for seconds in spent.values())
    assert story.vision_backend.__name__ == "vision_backend"
