"""Distractors and sounds of no class: silent where they are seen, heard from other rooms, never marked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from click.testing import CliRunner

from avs3d_bench.cli import avs3d
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.contract.taxonomy import (
    CATEGORIES,
    DISTRACTORS,
    OFF_SCREEN_CATEGORIES,
    ROOMS,
    check_category,
    class_ids,
)
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.formats import media
from avs3d_bench.inspector.sources import SILENT_COLOUR, instance_colours, source_names
from avs3d_bench.measures.deaf_oracles import can_sound
from avs3d_bench.validate import validate
from generators.assets.sounds import synthesise, usual_voices, voices
from generators.cli import generate
from generators.manifest.reading import read_manifest
from generators.observation.sources import choose_signal
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans
from generators.sampling.excluded import what_they_use
from generators.sampling.rooms import DISTRACTORS_IN, LOOK_ALIKES, MADE_BY
from generators.sealing.draw import draw_document
from tests.support.homes import ROOM, write_manifest, write_room
from tests.support.tiers import some

FIRST = "part_3/box/kitchen/1"
ENTRY: dict[str, Any] = {
    "part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 2, "kettle": 1},
    "sources": [{"category": "microwave", "instance": 1}],
}  # fmt: skip
PART_1: dict[str, Any] = {"part": "part_1", "scan": "box", "room": "kitchen", "index": 1, "category": "clock"}
LICENCE = {"name": "CC0-1.0", "author": "avs3d-bench"}


def away(*categories: str) -> list[dict[str, str]]:
    return [{"category": name, "room": "living_room"} for name in categories]


def plan_of(folder: Path, entry: dict[str, Any], **changes: object) -> ObservationPlan:
    path = write_manifest(folder, observations=[entry], **changes)
    (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    return plan


def refusal(folder: Path, entry: dict[str, Any], **changes: object) -> str:
    with pytest.raises(UsageError) as caught:
        plan_of(folder, entry, **changes)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_class_ids_are_those_of_the_seven() -> None:
    assert class_ids() == {name: number for number, name in enumerate(CATEGORIES, start=1)}
    assert not set(CATEGORIES) & {*DISTRACTORS, *OFF_SCREEN_CATEGORIES}


def test_tables_of_the_sampler_name_what_exists_and_fit_one_another() -> None:
    assert set(DISTRACTORS_IN) == set(ROOMS)
    others = {name for names in DISTRACTORS_IN.values() for name in names}
    assert others | set(LOOK_ALIKES.values()) == set(DISTRACTORS)
    assert not others & set(LOOK_ALIKES.values())
    assert set(MADE_BY) == set(OFF_SCREEN_CATEGORIES) - {"dog", "street"}
    assert set(MADE_BY.values()) == others


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sources": [{"category": "kettle"}]}, "sources.0.category: kettle is silent where it is seen"),
        ({"sources": [{"category": "kettle", "instance": 1}]}, "kettle is silent where it is seen"),
        ({"sources": [{"category": "oven"}]}, "sources.0.category: oven never sounds: expected one of washing_machine"),
        ({"sources": away("oven")}, "sources.0.category: oven never sounds"),
        ({"sources": away("radio")}, "radio never sounds: expected one of"),
        ({"sources": away("streat")}, "unknown category 'streat'"),
        ({"sources": [{"category": "street", "room": "kitchen"}]}, "room kitchen is the observation's own"),
        ({"instances": {"street": 1}, "sources": []}, "instances.street: street is no object, but heard from"),
        ({"instances": {"dog": 1}, "sources": []}, "dog is no object"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    assert words in refusal(tmp_path, ENTRY | change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"category": "dog"}, "category: dog is heard from other rooms alone"),
        ({"category": "dishwasher"}, "category: dishwasher is silent where it is seen"),
        ({"silent": ["music"]}, "silent.0: music is no object"),
    ],
)
def test_parts_1_and_2_have_silent_distractors_alone(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    assert words in refusal(tmp_path, PART_1 | change)
    plan = plan_of(tmp_path, PART_1 | {"silent": ["dishwasher", "kettle"]})
    assert plan.spec.objects == {"clock": 1, "dishwasher": 1, "kettle": 1}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"voices": {"kettle": ["jug"]}}, "voices: kettle has no voice 'jug'; expected one of electric_jug"),
        ({"voices": {"radio": ["portable"]}}, "voices.radio: radio never sounds"),
        ({"models": {"street": ["wet"]}}, "models.street: street is no object"),
        ({"sounds": {"oven": [{"file": "a.wav", "licence": LICENCE}]}}, "sounds.oven: oven never sounds"),
    ],
)
def test_tables_of_a_manifest_know_them(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    assert words in refusal(tmp_path, ENTRY, **change)


def test_a_declared_category_takes_the_place_of_a_distractor(tmp_path: Path) -> None:
    kettle = {"stands_on": ["worktop"], "height": [0.2, 0.25]}
    files: dict[str, Any] = {
        "categories": {"kettle": kettle},
        "objects": {"kettle": [{"file": "kettle.glb", "licence": LICENCE}]},
    }
    sounding = ENTRY | {"sources": [{"category": "kettle", "instance": 1}]}
    assert "category kettle has no sounds" in refusal(tmp_path, sounding, **files)
    plan = plan_of(tmp_path, sounding, sounds={"kettle": [{"file": "kettle.wav", "licence": LICENCE}]}, **files)
    assert plan.own_categories == ("kettle",)
    assert check_category("kettle", silent=True, own=("kettle",)) == "kettle"


@pytest.mark.parametrize("category", some(OFF_SCREEN_CATEGORIES, every=3))
def test_the_voice_of_a_sound_is_drawn_and_named(tmp_path: Path, category: str) -> None:
    known = [voice.name for voice in voices(category)]
    training = [voice.name for voice in voices(category) if voice.split == "train"]
    assert usual_voices(category) == tuple(training)
    assert len(training) >= 2
    camera = {"size": 96, "frames": 2}
    plan = plan_of(tmp_path, ENTRY | {"sources": away(category)}, camera=camera)
    drawn = choose_signal(plan, category).asset
    assert drawn in {f"procedural:{category}/{name}" for name in training}
    one = plan_of(tmp_path, ENTRY | {"sources": away(category)}, camera=camera, voices={category: [known[-1]]})
    assert choose_signal(one, category).asset == f"procedural:{category}/{known[-1]}"
    assert one.digest != plan.digest


def test_without_a_voice_one_is_drawn_for_a_sound_of_no_class_alone() -> None:
    assert usual_voices("clock") == ()
    drawn = {synthesise("street", 1, np.random.default_rng(seed)).tobytes() for seed in range(3)}
    assert len(drawn) == 3
    for name in ("oven", "radio"):
        with pytest.raises(UsageError, match=f"{name} never sounds"):
            synthesise(name, 1, np.random.default_rng(0))


def test_a_manifest_that_names_no_voices_draws_those_for_training_of_a_sound_of_no_class(tmp_path: Path) -> None:
    entry = ENTRY | {"sources": [*away("kettle", "dog"), *ENTRY["sources"]]}
    path = write_manifest(tmp_path, observations=[entry], voices={"dog": ["small_yap"]})
    used = set(what_they_use([path], tmp_path / "out.yaml").voices)
    assert used == {
        ("dog", "small_yap"),
        *(("kettle", voice.name) for voice in voices("kettle") if voice.split == "train"),
    }


def test_a_sealed_test_never_draws_a_distractor_with_recordings(tmp_path: Path) -> None:
    entry = PART_1 | {"silent": ["kettle"]}
    path = write_manifest(tmp_path, observations=[entry], sounds={"kettle": [{"file": "a.wav", "licence": LICENCE}]})
    template = yaml.safe_load(path.read_text())
    for number in range(8):
        document, _ = draw_document(template, number.to_bytes(32, "big"), {})
        assert document["observations"][0]["category"] == "clock"


# ---- from end to end -------------------------------------------------------------------------------------------------


def two_rooms(folder: Path) -> dict[str, Any]:
    """The kitchen of `write_room`, and an empty room beside it behind a gap: ``scans`` of a manifest."""
    write_room(folder / "room.glb")
    scene = trimesh.load_scene(folder / "room.glb")
    low, high = (5.0, 0.0, 0.0), (8.0, 2.6, 3.6)
    shell = trimesh.creation.box(extents=np.subtract(high, low))
    shell.apply_translation(np.mean([low, high], axis=0))
    shell.invert()
    shell.visual.face_colors = np.tile((180, 170, 150, 255), (12, 1))
    scene.add_geometry(shell)
    scene.export(folder / "rooms.glb")  # type: ignore[no-untyped-call]
    rooms = {"kitchen": [list(corner) for corner in ROOM], "living_room": [list(low), list(high)]}
    return {"box": {"source": "scan", "file": "rooms.glb", "rooms": rooms, "licence": LICENCE}}


@pytest.fixture(scope="module")
def group(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("distractors")
    entries = [
        ENTRY,
        {"like": FIRST, "index": 2, "sources": away("kettle")},
        {"like": FIRST, "index": 3, "sources": [*away("dishwasher"), {"category": "microwave", "instance": 2}]},
    ]
    path = write_manifest(
        folder, observations=entries, scans=two_rooms(folder), camera={"size": 96, "frames": 9}, light="preview"
    )
    options = [str(path), "-o", str(folder / "tree"), "--audio", "analytic", "--with", "stems", "--workers", "1"]
    outcome = CliRunner().invoke(generate, options)
    assert outcome.exit_code == 0, outcome.output
    return Dataset(folder / "tree")


@pytest.mark.slow
def test_a_group_with_distractors_is_valid_and_says_what_sounds(group: Dataset) -> None:
    report = validate(group.root, deep=True)
    assert not report.problems, [f"{p.path}: {p.message}" for p in report.problems]
    record = group["part_3/box/kitchen/3"].record
    assert record is not None
    assert [(s.category, s.instance is None) for s in record.sound_sources] == [
        ("dishwasher", True),
        ("microwave", False),
    ]
    assert record.category == "dishwasher"
    assert record.sound_sources[0].asset.removeprefix("procedural:dishwasher/") in usual_voices("dishwasher")
    (kettle,) = (one for one in record.instances if one.category == "kettle")
    assert not kettle.sounding
    assert kettle.id not in {one.id for one in can_sound(record)}
    assert instance_colours(record)[kettle.id] == SILENT_COLOUR
    assert source_names(record)["source_1"] == "dishwasher, living room"


@pytest.mark.slow
def test_a_distractor_is_seen_and_never_marked(group: Dataset) -> None:
    seen = 0
    for observation in group:
        record = observation.record
        assert record is not None
        (kettle,) = (one.id for one in record.instances if one.category == "kettle")
        for frame in observation.frames:
            here = frame.instance_ids() == kettle
            seen += int(here.sum())
            assert not frame.mask()[here].any()
            assert not frame.category_mask()[here].any()
            if observation.key.endswith("/2"):
                assert not frame.mask().any()
                assert np.abs(frame.stem("source_1")).max() > 0
    assert seen > 0


@pytest.mark.slow
@pytest.mark.parametrize("instance", ["sounding", "category"])
def test_scores_of_oracles(group: Dataset, tmp_path: Path, instance: str) -> None:
    """The category oracle marks both microwaves, and no kettle while one is heard from the other room."""
    out, scores = tmp_path / "submission", tmp_path / "scores.json"
    options = ["baseline", "oracle", "--dataset", str(group.root), "-o", str(out), "--instance", instance]
    done = CliRunner().invoke(avs3d, options)
    assert done.exit_code == 0, done.output
    scored = CliRunner().invoke(avs3d, ["eval", str(out), "--dataset", str(group.root), "--json", str(scores)])
    assert scored.exit_code == 0, scored.output
    black = media.read_png_mask(out / "part_3/box/kitchen/2" / layout.SUBMISSION_MASKS / "frame_000.png")
    assert not black.any()
    found = media.read_json(scores)
    assert {row["category"] for row in found["observations"]} == {"microwave", "kettle", "dishwasher"}
    listen = found["overall"]["listen"]
    assert listen["FP_rate"] == listen["FP_area"] == 0.0
    assert (listen["pair_accuracy"] == 1.0) is (instance == "sounding")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "change"),
    [(0, {"category": "oven"}), (0, {"category": "street", "instance": 1}), (1, {"category": "dishwasher"})],
)
def test_a_record_says_that_a_sound_of_no_class_is_elsewhere(
    group: Dataset, number: int, change: dict[str, Any]
) -> None:
    document = media.read_json(group.root / "part_3/box/kitchen/3" / layout.OBSERVATION_JSON)
    ObservationRecord.model_validate_json(json.dumps(document))
    document["sources"][number].update(change)
    with pytest.raises(ValueError, match=f"unknown category '{change['category']}'"):
        ObservationRecord.model_validate_json(json.dumps(document))
