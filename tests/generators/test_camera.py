"""The camera model: closed forms of vignette, exposure and noise, and what it may not touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.tone import srgb_decode, srgb_encode
from generators.vision.camera import RANGES, CameraBackend, PhoneCamera
from generators.vision.embree import EmbreeBackend
from generators.vision.views import trial_scene

PLAIN = PhoneCamera(exposure=0.0, warmth=0.0, vignette=0.0, shot=0.0, read=0.0, sharpening=0.0)


def grey(light: float, size: int = 201) -> np.ndarray:
    return np.full((size, size, 3), np.rint(255 * srgb_encode(light)), dtype=np.uint8)


def light_of(rgb: np.ndarray) -> np.ndarray:
    return srgb_decode(rgb / 255.0)


def test_a_camera_without_faults_changes_nothing() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (40, 30, 3), dtype=np.uint8)
    assert np.array_equal(PLAIN.photograph(picture, np.random.default_rng(0)), picture)


def test_exposure_counts_in_stops_and_the_vignette_in_the_corners() -> None:
    lit = replace(PLAIN, exposure=-1.0, vignette=0.2).photograph(grey(0.5), np.random.default_rng(0))
    assert light_of(lit[100, 100]) == pytest.approx(0.25, rel=0.01)
    assert light_of(lit[0, 0]) == pytest.approx(0.25 * 0.8, rel=0.015)
    assert light_of(lit[0, 100]) == pytest.approx(0.25 * 0.9, rel=0.015)
    warm = light_of(replace(PLAIN, warmth=0.04).photograph(grey(0.5), np.random.default_rng(0))[100, 100])
    assert warm / warm[1] == pytest.approx([1.04, 1.0, 0.96], rel=0.015)


@pytest.mark.parametrize("light", [0.05, 0.3])
def test_noise_has_the_variance_of_photons_and_electronics(light: float) -> None:
    camera = replace(PLAIN, shot=6e-4, read=0.003)
    found = light_of(camera.photograph(grey(light), np.random.default_rng(4)))
    assert found.mean() == pytest.approx(light_of(grey(light)).mean(), rel=0.01)
    assert found.std() == pytest.approx(np.sqrt(6e-4 * light + 0.003**2), rel=0.05)


def test_sharpening_steepens_an_edge_and_leaves_plains() -> None:
    picture = np.full((20, 20, 3), 100, dtype=np.uint8)
    picture[:, 10:] = 150
    found = replace(PLAIN, sharpening=0.4).photograph(picture, np.random.default_rng(0)).astype(int)
    assert (found[:, :9] == 100).all()
    assert (found[:, 11:] == 150).all()
    # The blur takes a quarter of the step from each side; 0.4 of that is added again.
    assert (found[:, 9] == 95).all()
    assert (found[:, 10] == 155).all()


@pytest.mark.parametrize("kind", RANGES)
def test_cameras_stay_within_their_ranges_and_differ(kind: str) -> None:
    cameras = [PhoneCamera.drawn(np.random.default_rng(seed), kind) for seed in range(50)]
    for name, (low, high) in RANGES[kind].items():
        values = [getattr(camera, name) for camera in cameras]
        assert low <= min(values) < max(values) <= high
        assert max(values) - min(values) > 0.8 * (high - low)


@pytest.mark.slow
def test_labels_stay_and_noise_depends_on_the_pose_alone() -> None:
    scene, intrinsics, pose = trial_scene()
    other = Pose.from_yaw((0.2, 0.1, 2.0), 0.05)
    plain = EmbreeBackend().open(scene, intrinsics).render(pose)
    session = CameraBackend(EmbreeBackend(), np.random.default_rng(3), "mild").open(scene, intrinsics)
    first, moved, again = (session.render(p) for p in (pose, other, pose))
    shared = session.share()
    assert shared is not None
    for view in (first, again, shared.render(pose)):
        assert np.array_equal(view.rgb, first.rgb)
        assert np.array_equal(view.depth, plain.depth)
        assert np.array_equal(view.instance_ids, plain.instance_ids)
    assert not np.array_equal(first.rgb, plain.rgb)
    empty = Intrinsics.from_fov(16)
    noise = [
        CameraBackend(EmbreeBackend(), np.random.default_rng(3), "mild").open(scene, empty).render(p).rgb
        for p in (pose, other)
    ]
    assert not np.array_equal(noise[0], noise[1])
    assert not np.array_equal(moved.rgb, first.rgb)
