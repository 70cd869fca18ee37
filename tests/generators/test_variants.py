"""Acoustic variants of an observation: absorption scaled as Eyring has it, and nothing else changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import eyring, reverberation_time
from avs3d_bench.validate import validate
from generators.acoustics.analytic import AnalyticBackend
from generators.acoustics.materials import MATERIALS, mean_absorption
from generators.cli import generate
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from tests.support.acoustic_rooms import box_scene, with_absorption
from tests.support.homes import tree_digest, write_manifest

ROOM = (5.0, 2.6, 4.0)
VOLUME, SURFACE = 52.0, 2 * (5 * 2.6 + 2.6 * 4 + 4 * 5)
SOURCE, LISTENER = (1.2, 1.0, 1.1), Pose.from_yaw((3.6, 1.5, 2.7), 0.4)
ORIGINAL = "part_1/box/kitchen/1"


@given(scale=st.floats(0.05, 20.0), label=st.sampled_from(sorted(MATERIALS)))
def test_a_scaled_material_has_scaled_exponents_and_stays_a_material(scale: float, label: str) -> None:
    plain, scaled = (np.array(MATERIALS[label].scaled(s).in_situ) for s in (1.0, scale))
    np.testing.assert_allclose(1 - scaled, (1 - plain) ** scale, rtol=1e-6, atol=1e-15)
    assert (scaled >= 0).all()
    assert (scaled < 1).all()
    assert ((scaled > plain) == (scale > 1)).all()


@pytest.mark.parametrize("label", sorted(MATERIALS))
def test_scale_one_is_the_material_itself_to_the_last_bit(label: str) -> None:
    assert MATERIALS[label].scaled(1.0).in_situ == MATERIALS[label].in_situ
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    assert (mean_absorption(triangle, (label,), 1.0) == mean_absorption(triangle, (label,))).all()


@pytest.mark.parametrize("scale", [0.25, 0.5, 2.0, 4.0])
def test_the_analytic_reverberation_time_is_eyrings_over_the_scale(
    scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_absorption(monkeypatch, 0.12)
    session = AnalyticBackend(absorption_scale=scale).open(box_scene(ROOM), SOURCE, room="kitchen")
    times = session.box_for((3.6, 1.5, 2.7)).reverberation_times()
    np.testing.assert_allclose(times, eyring(VOLUME, SURFACE, 0.12) / scale, rtol=1e-6)


def test_the_measured_t30_of_analytic_responses_falls_with_the_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    with_absorption(monkeypatch, 0.12)
    found = []
    for scale in (0.25, 0.5, 1.0, 2.0, 4.0):
        session = AnalyticBackend(absorption_scale=scale).open(box_scene(ROOM), SOURCE, room="kitchen")
        found.append(reverberation_time([session.impulse_response(LISTENER)], 44_100))
    assert None not in found
    live = np.array(found, dtype=float)
    assert (np.diff(live) < 0).all()
    np.testing.assert_allclose(live[:3], [eyring(VOLUME, SURFACE, 0.12) / s for s in (0.25, 0.5, 1.0)], rtol=0.15)


def test_t30_of_the_engine_rises_from_dry_to_live(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rlr_audio_propagation", reason="the acoustic engine (extra soundspaces) is not installed")
    from generators.acoustics.soundspaces import RaySettings, SoundSpacesBackend

    with_absorption(monkeypatch, 0.15)
    few = RaySettings(reflections=60_000, min_rays=500)
    found = []
    for scale in (4.0, 2.0, 1.0, 0.5, 0.25):
        backend = SoundSpacesBackend(few, absorption_scale=scale)
        session = backend.open(box_scene((3.0, 2.4, 2.5)), (0.9, 1.0, 0.8), room="kitchen")
        found.append(reverberation_time([session.impulse_response(Pose.from_yaw((2.1, 1.5, 1.7), 0.0))], 44_100))
        session.close()
    assert None not in found
    times = np.array(found, dtype=float)
    assert (np.diff(times) > 0).all(), times
    # The engine follows Eyring closely where surfaces absorb little.
    surface = 2 * (3 * 2.4 + 2.4 * 2.5 + 2.5 * 3)
    expected = [eyring(18.0, surface, 1 - 0.85**scale) for scale in (1.0, 0.5, 0.25)]
    np.testing.assert_allclose(times[2:], expected, rtol=0.15)


def test_settings_tell_a_scale_that_is_not_one() -> None:
    assert "absorption_scale" not in AnalyticBackend().describe()
    assert AnalyticBackend(absorption_scale=0.5).describe()["absorption_scale"] == 0.5


@pytest.mark.parametrize("scale", [0.0, 0.049, 20.1, -1.0, float("nan"), float("inf")])
def test_a_scale_out_of_range_is_refused(scale: float) -> None:
    with pytest.raises(Avs3dError, match=r"absorption_scale is .*, expected 0\.05 to 20"):
        AnalyticBackend(absorption_scale=scale)


def manifest(folder: Path, *entries: dict, **changes: object) -> Path:
    first = {
        "part": "part_1",
        "scan": "box",
        "room": "kitchen",
        "index": 1,
        "category": "microwave",
        "silent": ["oven"],
    }
    return write_manifest(
        folder, observations=[first | {"silent": ["oven"]}, *entries], camera={"size": 48, "frames": 4}, **changes
    )


def test_a_variant_takes_everything_but_index_and_acoustics(tmp_path: Path) -> None:
    path = manifest(tmp_path, {"like": ORIGINAL, "index": 2, "acoustics": {"absorption_scale": 0.5}})
    original, variant = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    assert variant.key == "part_1/box/kitchen/2"
    taken = {"index", "acoustics", "like"}
    assert original.spec.model_dump(exclude=taken) == variant.spec.model_dump(exclude=taken)
    assert (original.spec.acoustics.absorption_scale, variant.spec.acoustics.absorption_scale) == (1.0, 0.5)
    assert original.digest != variant.digest
    assert original.home_digest == variant.home_digest
    for purpose in ("models/clock", "placement", "ids", "motion", "path", "sounding", "sound", "points"):
        assert original.rng(purpose).integers(1 << 60) == variant.rng(purpose).integers(1 << 60)


def test_acoustics_of_the_manifest_hold_where_an_entry_says_nothing(tmp_path: Path) -> None:
    other = {"part": "part_1", "scan": "box", "room": "kitchen", "index": 3, "category": "clock"}
    path = manifest(
        tmp_path,
        other | {"acoustics": {"absorption_scale": 3.0}},
        {"like": ORIGINAL, "index": 2},
        {"like": "part_1/box/kitchen/3", "index": 4},
        acoustics={"absorption_scale": 2.0},
    )
    scales = [
        plan.spec.acoustics.absorption_scale
        for plan in make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    ]
    assert scales == [2.0, 3.0, 2.0, 3.0]


def test_the_options_left_alone_leave_the_digest_alone(tmp_path: Path) -> None:
    plain = make_plans(read_manifest(manifest(tmp_path / "a")), GenerateOptions(audio="analytic"))[0]
    said = manifest(tmp_path / "b", acoustics={"absorption_scale": 1.0}, source_motion="static")
    assert make_plans(read_manifest(said), GenerateOptions(audio="analytic"))[0].digest == plain.digest
    assert not {"acoustics", "source_motion", "like"} & set(plain.spec.identity())


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"like": "part_1/box/kitchen/9", "index": 2}, "like 'part_1/box/kitchen/9' names no observation"),
        ({"like": ORIGINAL, "index": 2, "category": "clock"}, "cannot have category;"),
        ({"like": ORIGINAL, "index": 2, "source_motion": "path"}, "cannot have source_motion;"),
        ({"like": ORIGINAL, "index": 1}, "part_1/box/kitchen/1 is listed twice"),
        ({"like": ORIGINAL, "index": 2, "acoustics": {"absorption_scale": 0.01}}, "greater than or equal to 0.05"),
        ({"like": ORIGINAL, "index": 2, "acoustics": {"absorption_scale": 21}}, "less than or equal to 20"),
        ({"like": ORIGINAL, "index": 2, "acoustics": {"absorbtion": 2}}, "acoustics.absorbtion"),
    ],
)
def test_a_wrong_variant_is_refused_in_one_line(tmp_path: Path, entry: dict, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_manifest(manifest(tmp_path, entry))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_variant_of_a_variant_is_refused(tmp_path: Path) -> None:
    first = {"like": ORIGINAL, "index": 2}
    with pytest.raises(UsageError, match="not a variant itself"):
        read_manifest(manifest(tmp_path, first, {"like": "part_1/box/kitchen/2", "index": 3}))


@pytest.mark.slow
def test_variants_differ_in_their_sound_alone(tmp_path: Path) -> None:
    scales = {2: 0.5, 3: 3.0}
    path = manifest(
        tmp_path,
        *({"like": ORIGINAL, "index": i, "acoustics": {"absorption_scale": scale}} for i, scale in scales.items()),
    )
    root = tmp_path / "out"
    args = [str(path), "-o", str(root), "--workers", "1", "--audio", "analytic", "--with", "depth"]
    done = CliRunner().invoke(generate, args, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert [str(p) for p in validate(root, deep=True).problems if p.severity == "error"] == []
    trees = [tree_digest(root / f"part_1/box/kitchen/{index}") for index in (1, 2, 3)]
    for tree in trees[1:]:
        assert tree.keys() == trees[0].keys()
        differ = {name.split("/")[0] for name in tree if tree[name] != trees[0][name]}
        assert differ == {"audio_clips_binaural", "audio_clips_mono", "observation.json"}
        assert all(tree[name] != trees[0][name] for name in tree if name.startswith("audio"))
    records = [observation.record for observation in Dataset(root)]
    assert [record.variant_of for record in records if record] == [None, ORIGINAL, ORIGINAL]
    said = [record.acoustics.settings.get("absorption_scale") for record in records if record]
    assert said == [None, 0.5, 3.0]
    t30 = [record.acoustics.t30 or 0.0 for record in records if record]
    assert t30[1] > t30[0] > t30[2] > 0
    assert '"variant_of"' not in (root / ORIGINAL / "observation.json").read_text()
    assert yaml.safe_load(path.read_text())["observations"][1]["like"] == ORIGINAL
