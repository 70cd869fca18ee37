"""Furnished flats in the real acoustic engine: the louder ear is on the source's side, and rooms ring as rooms do."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.geometry import direction_to
from generators.acoustics.clips import binaural_clip, rms
from generators.acoustics.decay import reverberation_time
from generators.apartments.apartment import build_apartment
from generators.arrangement import arrange, draw_sounding
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from generators.observation import PRE_ROLL, choose_sound
from generators.paths.watcher import line_of_sight
from generators.plan import make_plans, read_manifest

pytest.importorskip(
    "rlr_audio_propagation", reason="the SoundSpaces engine is not installed: pip install 'avs3d-bench[soundspaces]'"
)
from generators.acoustics.soundspaces import SoundSpacesBackend

MANIFESTS = Path(__file__).parent.parent / "scenes_manifest"


@cache
def home(name: str, seed: int) -> Scene:
    """The flat without its light, which sound does not need."""
    return build_apartment(name, seed)


@pytest.mark.parametrize(
    ("manifest", "key"),
    [
        ("demo", "part_1/apartment_1/bathroom/1"),
        ("demo", "part_2/apartment_1/kitchen/1"),
        ("open-s34-o7", "part_1/apartment_1/living_room/2"),
    ],
)
def test_the_louder_ear_is_on_the_sources_side(manifest: str, key: str) -> None:
    (plan,) = make_plans(read_manifest(MANIFESTS / f"{manifest}.yaml"), only=[key])
    assert plan.scan.seed is not None
    flat = home(plan.spec.scan, plan.scan.seed)
    seen = arrange(plan, flat)
    placed, poses = seen.placements, seen.poses
    source = placed[draw_sounding(plan, placed) - 1]
    scene = flat.with_parts(tuple(p.part(number) for number, p in enumerate(placed, start=1)))
    caster, sound = RayCaster(scene), choose_sound(plan).samples
    session = SoundSpacesBackend().open(scene, source.source_position, room=plan.spec.room)
    right = judged = 0
    responses = []
    for index in range(0, len(poses), 2):
        pose = poses[index]
        azimuth = direction_to(pose, source.source_position).azimuth
        if not (20 < abs(azimuth) < 160 and line_of_sight(caster, pose, source)):
            continue
        responses.append(session.impulse_response(pose))
        left_level, right_level = rms(binaural_clip(sound, responses[-1], index + PRE_ROLL))
        judged += 1
        right += np.sign(right_level - left_level) == np.sign(azimuth)
    session.close()
    assert judged >= 20
    # In a small bathroom, reflections win in some frames: `validate --deep` warns below 90 % and fails below 80 %.
    assert right / judged >= 0.90
    decay = reverberation_time(responses[:4], 44_100)
    assert decay is not None
    assert 0.2 <= decay <= 1.2
