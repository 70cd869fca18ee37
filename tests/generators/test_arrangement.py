"""The visible part does not depend on the sounding object: pictures, ids, points and notes have the same bytes."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.dataset import Dataset
from generators.observation import sources
from generators.observation.arrangement import Arrangement, arrange, choose_models, draw_sounding
from generators.observation.generate import generate_observation
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest
from tests.support.homes import tree_digest, write_manifest
from tests.support.rooms import kitchen

#: Files and folders that tell what sounds, and must.
TRUTH = {"audio_clips_binaural", "audio_clips_mono", "semantic_masks", "gt_3d", "observation.json"}
BOTH = ("clock", "telephone")


def plan_of(folder: Path, *, frames: int = 6, **entry: object) -> ObservationPlan:
    usual = {"part": "part_1", "scan": "box", "room": "kitchen", "index": 1}
    path = write_manifest(folder, observations=[usual | entry], camera={"size": 48, "frames": frames})
    (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    return plan


def visible(folder: Path) -> dict[str, str]:
    return {name: digest for name, digest in tree_digest(folder).items() if name.split("/")[0] not in TRUTH}


@pytest.mark.slow
def test_what_the_manifest_lets_sound_changes_no_picture(tmp_path: Path) -> None:
    """part_1, the same home and key: once the clock sounds beside a telephone, once the telephone beside a clock."""
    trees, ids, notes = [], [], []
    for sounding in BOTH:
        silent = [name for name in BOTH if name != sounding]
        plan = plan_of(tmp_path / sounding, category=sounding, silent=silent)
        record = generate_observation(plan, tmp_path / sounding / "out", tmp_path / "cache")
        trees.append(visible(tmp_path / sounding / "out" / plan.key))
        ids.append([(i.id, i.category, i.position, i.asset) for i in record.instances])
        notes.append(record.notes)
        assert record.sounding.category == sounding
    assert trees[0] == trees[1]
    assert len(trees[0]) >= 6 * 3 + 3 + 1
    assert ids[0] == ids[1]
    assert notes[0] == notes[1]


@pytest.mark.slow
def test_which_twin_sounds_changes_no_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of(tmp_path, part="part_2", category="clock", instances=2)
    trees = []
    for twin in (1, 2):
        monkeypatch.setattr(sources, "draw_instances", lambda *_, twin=twin: (twin,))
        record = generate_observation(plan, tmp_path / f"out{twin}", tmp_path / "cache")
        assert record.sounding.id == twin
        trees.append(tree_digest(tmp_path / f"out{twin}" / plan.key))
    differ = {name.split("/")[0] for name in trees[0] if trees[0][name] != trees[1][name]}
    assert {"audio_clips_binaural", "gt_3d", "observation.json"} <= differ <= TRUTH


@pytest.mark.slow
def test_sparse_points_of_a_moving_source_are_missing_on_every_object(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, frames=8, category="telephone", silent=["microwave"], source_motion="path")
    generate_observation(plan, tmp_path / "out", tmp_path / "cache")
    (seen,) = [o for o in Dataset(tmp_path / "out") if o.key == plan.key]
    points = seen.colmap.points.positions
    assert len(points) > 50
    assert seen.record is not None
    for instance in seen.record.instances:
        low, high = (np.asarray(corner) for corner in instance.bounds)
        if not instance.sounding:
            assert not ((points > low + (-0.003, 0.01, -0.003)) & (points < high + 0.003)).all(axis=1).any()
    shown = {int(number) for frame in seen.frames for number in np.unique(frame.instance_ids())}
    assert shown == {0, 1, 2}


@cache
def arranged(folder: Path, seed: int) -> tuple[ObservationPlan, Arrangement]:
    entry = {"part": "part_2", "scan": "box", "room": "kitchen", "index": 1, "category": "microwave", "instances": 2}
    path = write_manifest(
        folder / str(seed), observations=[entry | {"silent": ["oven", "clock"]}], seed=seed, camera={"frames": 2}
    )
    (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    return plan, arrange(plan, kitchen().scene)


@pytest.mark.slow
def test_ids_do_not_follow_the_manifest_and_every_twin_may_sound(tmp_path: Path) -> None:
    orders, sounding = set(), set()
    for seed in range(8):
        plan, seen = arranged(tmp_path, seed)
        categories = [placement.model.category for placement in seen.placements]
        assert sorted(categories) == ["clock", "microwave", "microwave", "oven"]
        orders.add(tuple(categories))
        number = draw_sounding(plan, seen.placements)
        assert categories[number - 1] == "microwave"
        sounding.add(categories[:number].count("microwave"))
    assert len(orders) >= 4
    assert sounding == {1, 2}


def test_copies_share_a_model_that_does_not_depend_on_what_sounds(tmp_path: Path) -> None:
    one = choose_models(plan_of(tmp_path / "a", part="part_2", category="clock", instances=3, silent=["telephone"]))
    assert one[0] is one[1] is one[2]
    other = choose_models(plan_of(tmp_path / "b", category="clock", silent=["telephone"]))
    swapped = choose_models(plan_of(tmp_path / "c", category="telephone", silent=["clock"]))
    assert [model.name for model in other] == [model.name for model in swapped]
    np.testing.assert_array_equal(other[1].mesh.positions, swapped[1].mesh.positions)
