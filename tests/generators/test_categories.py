"""Categories that a manifest adds: what it may declare, what is refused, which models and digests follow."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import trimesh
import yaml
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from avs3d_bench.contract.taxonomy import CATEGORIES, MOST_OWN_CATEGORIES, OVEN, check_category, class_ids
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.validation.tree import validate
from generators.library.cli import assets
from generators.library.lock import LOCK_NAME
from generators.manifest.categories import SUPPORTS, CategorySpec, check_name, declared
from generators.manifest.schema import Manifest
from generators.observation.arrangement import choose_models, placement_rules
from generators.options import GenerateOptions
from generators.placement.placement import RULES
from generators.plan import ObservationPlan, make_plans, read_manifest
from generators.run.generation import generate
from tests.support.homes import write_manifest

LICENCE = {"name": "CC0-1.0", "author": "Jane Doe"}
DRYER: dict[str, Any] = {"stands_on": ["table", "worktop"], "height": [0.15, 0.3]}
ENTRY = {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "hair_dryer", "silent": ["oven"]}


def document(category: dict[str, Any] | None = None, **changes: Any) -> dict[str, Any]:
    return {
        "name": "tiny",
        "seed": 1,
        "scans": {"flat": {"source": "apartment", "seed": 3}},
        "categories": {"hair_dryer": DRYER if category is None else category},
        "objects": {"hair_dryer": [{"file": "dryer.glb", "licence": LICENCE}]},
        "sounds": {"hair_dryer": [{"file": "dryer.wav", "licence": LICENCE}]},
        "observations": [ENTRY],
    } | changes


def plans(folder: Path, content: dict[str, Any]) -> tuple[ObservationPlan, ...]:
    """The plans of a manifest beside the two files that it names; the object is 2 × 1 × 1 m."""
    trimesh.creation.box(extents=(1.0, 2.0, 1.0)).export(folder / "dryer.glb")
    soundfile.write(folder / "dryer.wav", np.random.default_rng(0).normal(0, 0.1, 44_100), 44_100)
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return make_plans(read_manifest(path), GenerateOptions(audio="analytic"))


def refusal(folder: Path, content: dict[str, Any]) -> str:
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(UsageError) as caught:
        read_manifest(path)
    line = caught.value.args[0]
    where = re.match(rf"{re.escape(str(path))}(, line \d+)?: ", line)
    assert where is not None
    assert line.isprintable()
    assert len(line) < 1000
    return line.removeprefix(where.group())


# ---- what is declared -----------------------------------------------------------------------------------------------


def test_a_declared_category_is_used_like_the_seven() -> None:
    twins = ENTRY | {"part": "part_2", "instances": 2}
    beside = ENTRY | {"index": 2, "category": "clock", "silent": ["hair_dryer", "oven"]}
    scene = {"part": "part_3", "scan": "flat", "room": "kitchen", "index": 1}
    scene |= {"instances": {"hair_dryer": 2}, "sources": [{"category": "hair_dryer", "instance": 2}]}
    manifest = Manifest.model_validate(document(observations=[ENTRY, twins, beside, scene]))
    assert [entry.heard for entry in manifest.observations] == [("hair_dryer",)] * 2 + [("clock",), ("hair_dryer",)]
    assert [entry.objects.get("hair_dryer") for entry in manifest.observations] == [1, 2, 1, 2]
    spec = manifest.categories["hair_dryer"]
    assert spec.stands_on == ("side_table", "worktop")
    assert spec.height == (0.15, 0.3)


def test_the_names_are_known_while_their_manifest_is_validated_and_not_afterwards() -> None:
    Manifest.model_validate(document())
    with pytest.raises(ValueError, match="unknown category 'hair_dryer'"):
        check_name("hair_dryer")
    with pytest.raises(ValidationError):
        Manifest.model_validate(document(observations=[]))
    with pytest.raises(ValueError, match="unknown category 'hair_dryer'"):
        check_name("hair_dryer")
    with declared(["hair_dryer"]):
        assert check_name("hair_dryer") == "hair_dryer"
        with pytest.raises(ValueError, match="oven never sounds: expected one of washing_machine"):
            check_name("oven")
        assert check_name("oven", silent=True) == "oven"


def test_a_manifest_without_the_field_knows_the_seven_alone(tmp_path: Path) -> None:
    line = refusal(tmp_path, document(categories={}))
    assert line.startswith("objects.hair_dryer: unknown category 'hair_dryer': expected one of washing_machine")


@pytest.mark.parametrize(
    ("category", "words"),
    [
        ({}, "categories.hair_dryer.stands_on: is missing"),
        ({"stands_on": ["table"]}, "categories.hair_dryer.height: is missing"),
        (5, "categories.hair_dryer: expected a mapping, found 5"),
        (
            DRYER | {"stands_on": "table"},
            "stands_on: expected a list of supports like [table, worktop], found 'table'",
        ),
        (DRYER | {"stands_on": []}, "stands_on: expected a list of supports like [table, worktop], found []"),
        (
            DRYER | {"stands_on": ["tabel"]},
            "stands_on.0: unknown support 'tabel': expected one of floor, worktop, shelf, side_table, wall, table; "
            "did you mean 'table'?",
        ),
        (DRYER | {"stands_on": [["table"]]}, "stands_on.0: unknown support ['table']"),
        (DRYER | {"stands_on": ["table", "side_table"]}, "side_table is listed twice (table is another word"),
        (DRYER | {"height": 0.2}, "height: expected [lowest, highest] in metres, found 0.2"),
        (DRYER | {"height": [0.1, 0.2, 0.3]}, "height: expected [lowest, highest] in metres, found [0.1, 0.2, 0.3]"),
        (DRYER | {"height": [0.3, 0.2]}, "height: expected [lowest, highest], found [0.3, 0.2]"),
        (DRYER | {"height": [0.3, 15]}, "height.1: Input should be less than 5 (found 15)"),
        (DRYER | {"height": [float("nan"), 1]}, "height.0: Input should be a finite number (found nan)"),
        (DRYER | {"free": True}, "free is for objects on the floor; add floor to stands_on, or leave it out"),
        (DRYER | {"wall_gap": [0, 0]}, "wall_gap is for objects on the floor"),
        (DRYER | {"wall_height": [1, 1.5]}, "wall_height is for objects on the wall"),
        (
            DRYER | {"stands_on": ["floor"], "free": True, "wall_gap": [0, 0.1]},
            "wall_gap is for objects with their back to a wall",
        ),
        (DRYER | {"turn": 200}, "turn: Input should be less than or equal to 180 (found 200)"),
        (DRYER | {"source_height": 2}, "source_height: Input should be less than or equal to 1 (found 2)"),
        (DRYER | {"wall_heigt": [1, 2]}, "wall_heigt: unknown field; did you mean 'wall_height'?"),
    ],
)
def test_a_wrong_declaration_is_refused_in_one_line(tmp_path: Path, category: Any, words: str) -> None:
    line = refusal(tmp_path, document(categories={"hair_dryer": category}))
    assert line.startswith("categories.hair_dryer")
    assert words in line


@pytest.mark.parametrize("name", ["Hair dryer", "hair-dryer", "", "1st", "a" * 65, "dryer\n", 5, "föhn"])
def test_a_name_that_is_no_name_is_refused(tmp_path: Path, name: Any) -> None:
    line = refusal(tmp_path, document(categories={name: DRYER}))
    assert line.startswith("categories.")
    assert "expected lower-case letters, digits and underscores, a letter first, at most 64 characters" in line


@pytest.mark.parametrize("name", [*CATEGORIES, OVEN])
def test_a_name_of_the_benchmark_is_refused(tmp_path: Path, name: str) -> None:
    line = refusal(tmp_path, document(categories={name: DRYER}))
    assert line.startswith(f"categories.{name}: {name} is ")
    assert "another name" in line


def test_a_category_mask_has_room_for_all(tmp_path: Path) -> None:
    names = [f"thing_{number}" for number in range(MOST_OWN_CATEGORIES)]
    most = document(categories=dict.fromkeys(names, DRYER), objects={}, sounds={})
    manifest = Manifest.model_validate(most | {"observations": [ENTRY | {"category": "clock"}]})
    assert max(class_ids(tuple(manifest.categories)).values()) == 255
    line = refusal(tmp_path, document(categories=dict.fromkeys([*names, "hair_dryer"], DRYER)))
    assert "too many entries; expected at most 248" in line


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"observations": [ENTRY | {"category": "hairdryer"}]},
            "observations.0.category: unknown category 'hairdryer'",
        ),
        (
            {"observations": [ENTRY | {"category": "clock", "silent": ["hair_dryr"]}]},
            "observations.0.silent.0: unknown category 'hair_dryr'",
        ),
        ({"objects": {"hair_drier": []}}, "objects.hair_drier: unknown category 'hair_drier'"),
        ({"sounds": {"hair_drier": []}}, "sounds.hair_drier: unknown category 'hair_drier'"),
    ],
)
def test_a_slip_in_a_name_gets_the_nearest_one(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    line = refusal(tmp_path, document(**changes))
    assert line.startswith(words)
    assert "hair_dryer" in line.split("expected one of ")[1].split(";")[0]
    assert "did you mean 'hair_dryer'?" in line


@pytest.mark.parametrize(
    ("changes", "missing"),
    [
        ({"objects": {}}, "objects"),
        ({"objects": {"hair_dryer": []}}, "objects"),
        ({"sounds": {}}, "sounds"),
        ({"objects": {}, "observations": [ENTRY | {"category": "clock", "silent": ["hair_dryer"]}]}, "objects"),
    ],
)
def test_a_category_without_the_files_that_it_needs_is_refused(
    tmp_path: Path, changes: dict[str, Any], missing: str
) -> None:
    line = refusal(tmp_path, document(**changes))
    assert f"part_1/flat/kitchen/1: category hair_dryer has no {missing}" in line
    assert f"add {missing}: {{hair_dryer: [{{file: hair_dryer." in line


def test_what_is_silent_needs_no_sounds_and_what_is_not_used_needs_nothing() -> None:
    silent = ENTRY | {"category": "clock", "silent": ["hair_dryer"]}
    assert Manifest.model_validate(document(sounds={}, observations=[silent])).categories
    assert Manifest.model_validate(document(objects={}, sounds={}, observations=[ENTRY | {"category": "clock"}]))


def test_messages_name_a_dozen_of_many_names() -> None:
    own = tuple(f"thing_{number}" for number in range(200))
    with pytest.raises(UsageError) as caught:
        check_category("thing_x", own=own)
    assert "thing_4 and 195 more; did you mean 'thing_" in str(caught.value)


# ---- where its objects stand ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stands_on", "mount"),
    [
        (["floor"], "floor"),
        (["table", "shelf", "worktop"], "surface"),
        (["table", "floor"], "surface"),
        (["wall"], "wall"),
        (["wall", "shelf"], "wall_or_surface"),
        (["floor", "wall"], "wall_or_surface"),
    ],
)
def test_the_supports_decide_the_mount(stands_on: list[str], mount: str) -> None:
    assert CategorySpec.model_validate({"stands_on": stands_on, "height": [0.1, 0.2]}).mount == mount


def test_every_kind_of_support_can_be_named() -> None:
    spec = CategorySpec.model_validate({"stands_on": [name for name in SUPPORTS if name != "table"], "height": [1, 1]})
    assert set(spec.stands_on) == set(SUPPORTS.values())


def test_the_rules_of_the_seven_stay_beside_those_of_the_manifest(tmp_path: Path) -> None:
    chosen = {"stands_on": ["floor", "wall"], "height": [1, 1], "wall_gap": [0.1, 0.2], "wall_height": [1, 1.2]}
    (plan,) = plans(tmp_path, document(chosen | {"turn": 8}))
    rules = placement_rules(plan)
    assert {name: rule for name, rule in rules.items() if name != "hair_dryer"} == RULES
    own = rules["hair_dryer"]
    assert (own.stands_on, own.gap, own.wall_heights) == (("floor", "wall"), (0.1, 0.2), (1, 1.2))
    assert (own.jitter, own.free) == (8.0, False)


# ---- its models -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 1.0), st.floats(0.0, 1.0))
def test_a_model_is_as_tall_as_is_drawn(
    tmp_path_factory: pytest.TempPathFactory, seed: int, low: float, span: float
) -> None:
    folder = tmp_path_factory.mktemp("own")
    content = document(DRYER | {"height": [low, low + span]}, seed=seed)
    (plan,) = plans(folder, content)
    (model,) = [model for model in choose_models(plan) if model.category == "hair_dryer"]
    x, y, z = model.size
    assert low * (1 - 1e-6) <= y <= (low + span) * (1 + 1e-6)
    assert (x, z) == pytest.approx((y / 2, y / 2), rel=1e-5)  # the shape of the file stays
    rng = plan.rng("models/hair_dryer")
    rng.integers(1)
    assert y == pytest.approx(rng.uniform(low, low + span), rel=1e-5)


def test_twins_are_equal_and_observations_differ(tmp_path: Path) -> None:
    twins = [ENTRY | {"part": "part_2", "instances": 3, "index": index} for index in range(1, 9)]
    heights = []
    for plan in plans(tmp_path, document(observations=twins)):
        models = [model for model in choose_models(plan) if model.category == "hair_dryer"]
        assert len(models) == 3
        assert models[0] is models[1] is models[2]
        heights.append(models[0].size[1])
    assert len(set(heights)) == 8
    assert np.ptp(heights) > 0.03  # of a range of 0.15 m


def test_a_model_is_the_same_whether_it_sounds_or_not(tmp_path: Path) -> None:
    """Else its height would tell what sounds."""
    entries = (ENTRY, ENTRY | {"category": "clock", "silent": ["oven", "hair_dryer"]})
    heights = []
    for entry in entries:
        (plan,) = plans(tmp_path, document(observations=[entry]))
        heights += [model.size for model in choose_models(plan) if model.category == "hair_dryer"]
    assert heights[0] == heights[1]


def test_the_height_of_a_file_goes_before_the_range(tmp_path: Path) -> None:
    objects = {"hair_dryer": [{"file": "dryer.glb", "height": 0.9, "licence": LICENCE}]}
    (plan,) = plans(tmp_path, document(objects=objects))
    (model,) = [model for model in choose_models(plan) if model.category == "hair_dryer"]
    assert model.size[1] == pytest.approx(0.9, rel=1e-6)


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_the_source_is_in_front_at_its_share_of_the_height(tmp_path: Path, share: float) -> None:
    (plan,) = plans(tmp_path, document(DRYER | {"height": [0.2, 0.2], "source_height": share}))
    (model,) = [model for model in choose_models(plan) if model.category == "hair_dryer"]
    assert model.mount == "surface"
    assert model.source_point == pytest.approx((0.0, 0.2 * share, 0.05 + 0.03), abs=1e-6)


@pytest.mark.parametrize(
    ("stance", "mount"),
    [((), "surface"), (("--height", "0.5"), "surface"), (("--mount", "floor"), "floor"), (("--mount", "wall"), "wall")],
)
def test_an_asset_of_the_lock_file_has_its_own_height_and_mount_or_those_declared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stance: tuple[str, ...], mount: str
) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    content = document(
        objects={"hair_dryer": [{"asset": "folder/mine/dryer"}]},
        sounds={"hair_dryer": [{"asset": "folder/mine/noise"}]},
    )
    (tmp_path / "mine").mkdir()
    trimesh.creation.box(extents=(1.0, 2.0, 1.0)).export(tmp_path / "mine/dryer.glb")
    soundfile.write(tmp_path / "mine/noise.wav", np.random.default_rng(0).normal(0, 0.1, 44_100), 44_100)
    options = ("--licence", "CC0-1.0", "--author", "me", "--category", "hair_dryer", "--lock", tmp_path / LOCK_NAME)
    for kind in ("object", "sound"):
        more = stance if kind == "object" else ()
        command = ["import", "folder", tmp_path / "mine", "--kind", kind, *options, *more]
        done = CliRunner().invoke(assets, [str(word) for word in command])
        assert done.exit_code == 0, done.output
    (plan,) = plans(tmp_path, content)
    (model,) = [model for model in choose_models(plan) if model.category == "hair_dryer"]
    assert (model.name, model.mount) == ("folder/mine/dryer", mount)
    if "--height" in stance:
        assert model.size[1] == pytest.approx(0.5, rel=1e-5)
    else:
        assert 0.15 <= model.size[1] <= 0.3
    wrong = content | {"sounds": {"hair_dryer": [{"asset": "folder/mine/dryer"}]}}
    with pytest.raises(
        UsageError, match=r"is the object of a hair_dryer, but the manifest needs the sound of a hair_dryer"
    ):
        plans(tmp_path, wrong)


# ---- what an observation's bytes depend on --------------------------------------------------------------------------


def test_the_digest_follows_the_declarations_that_an_observation_uses(tmp_path: Path) -> None:
    other = ENTRY | {"index": 2, "category": "clock"}
    both = document(observations=[ENTRY, other])
    uses, ignores = (plan.digest for plan in plans(tmp_path, both))

    def digests(**changes: Any) -> tuple[str, str]:
        one, two = plans(tmp_path, both | {"categories": {"hair_dryer": DRYER | changes}})
        return one.digest, two.digest

    assert digests() == (uses, ignores)
    for changes in ({"height": [0.15, 0.31]}, {"stands_on": ["worktop", "table"]}, {"turn": 6}, {"source_height": 0.4}):
        assert digests(**changes)[0] != uses
        assert digests(**changes)[1] == ignores
    # Another word for the same, and a default that is written out, change nothing.
    assert digests(stands_on=["side_table", "worktop"], turn=5.0) == (uses, ignores)
    assert plans(tmp_path, both)[0].pictures_digest != plans(tmp_path, document(DRYER | {"turn": 6}))[0].pictures_digest
    # One more name changes the class ids that observation.json lists.
    one, two = plans(tmp_path, both | {"categories": {"kettle": DRYER, "hair_dryer": DRYER}})
    assert one.digest != uses
    assert two.digest != ignores


def test_a_manifest_without_categories_has_the_digests_that_it_had(tmp_path: Path) -> None:
    """An empty field counts as none."""
    content = document(categories={}, objects={}, sounds={}, observations=[ENTRY | {"category": "clock"}])
    (empty,) = plans(tmp_path, content)
    del content["categories"]
    (none,) = plans(tmp_path, content)
    assert empty.digest == none.digest


def test_a_missing_file_of_a_declared_category_is_named(tmp_path: Path) -> None:
    (plan,) = plans(tmp_path, document())
    (tmp_path / "dryer.glb").unlink()
    with pytest.raises(Avs3dError, match=r"dryer\.glb: mesh for hair_dryer not found"):
        choose_models(plan)


# ---- a dataset ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_declared_categories_on_the_wall_on_the_floor_and_on_their_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fan hangs on the wall, or moves about on the floor, where it cannot hang; beside it stands a silent twin."""
    monkeypatch.setenv("AVS3D_CACHE", str(tmp_path / "cache"))
    fan = {"stands_on": ["wall", "floor"], "height": [0.2, 0.3], "free": True, "wall_height": [1.4, 1.7]}
    place = {"scan": "box", "room": "kitchen", "category": "fan"}
    write_manifest(
        tmp_path,
        camera={"size": 64, "frames": 9},
        light="preview",
        categories={"fan": fan},
        objects={"fan": [{"file": "dryer.glb", "licence": LICENCE}]},
        sounds={"fan": [{"file": "dryer.wav", "licence": LICENCE}]},
        observations=[
            place | {"part": "part_2", "index": 1, "instances": 2, "silent": ["oven"]},
            place | {"part": "part_1", "index": 1, "source_motion": "path"},
        ],
    )
    plans(tmp_path, document())  # writes the two files
    root = tmp_path / "data"
    outcome = generate(tmp_path / "tiny.yaml", root, audio="analytic", workers=1)
    assert len(outcome.made) == 2, outcome
    assert validate(root, deep=True).valid
    moving, hanging = Dataset(root)
    assert hanging.record is not None
    assert moving.record is not None
    assert hanging.record.class_ids["fan"] == 8
    for instance in hanging.record.instances:
        low, high = instance.bounds
        if instance.category == "fan":
            assert 1.4 - 1e-3 <= (low[1] + high[1]) / 2 <= 1.7 + 1e-3
            assert 0.2 - 1e-6 <= high[1] - low[1] <= 0.3 + 1e-6
    assert moving.record.moves
    assert moving.record.sounding.bounds[0][1] == pytest.approx(0.0, abs=0.005)
    assert len({frame.source_position for frame in moving.record.frames}) > 1
