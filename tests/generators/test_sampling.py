"""Sampled manifests: unseen homes and models, balance, groups of siblings, the same bytes again, errors in one line."""

from __future__ import annotations

import itertools
import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Collection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS, OFF_SCREEN_CATEGORIES, PARTS, ROOMS
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose, rotation_angle
from generators.assets import catalogue
from generators.assets.sounds import voices
from generators.manifest.reading import read_manifest
from generators.manifest.schema import Manifest, ObservationSpec
from generators.options import GenerateOptions
from generators.paths.standing import TURN_RATE, stay
from generators.plan import make_plans
from generators.sampling import excluded as excluded_module
from generators.sampling import sample as sample_module
from generators.sampling.cli import GROUPS, PURPOSES, SPLITS
from generators.sampling.cli import manifest as command
from generators.sampling.compositions import COMPOSITIONS, LEVELS, OF_MORE, OF_TWO
from generators.sampling.document import manifest_text
from generators.sampling.excluded import Excluded, what_they_use
from generators.sampling.fitting import SampleFitting
from generators.sampling.rooms import DISTRACTORS_IN, LOOK_ALIKES, MADE_BY, MOST
from generators.sampling.sample import MOST_INDEX, SEEDS, SampledGroup, Wanted, sample, shares
from generators.sampling.siblings import GROUP, siblings
from generators.sampling.statistics import sounding
from generators.sampling.sweep_cli import sweep

MANIFESTS = Path(__file__).parents[2] / "scenes_manifest"
TRAIN, LISTEN, TUNE = (MANIFESTS / f"{name}.yaml" for name in ("train", "listen", "listen-tune"))
#: Version of all manifests.
VERSION_OF = {"train": "8.0.0"}
"""Manifests of another version than "4.0.0"."""
#: Manifests on which networks are trained, and on which settings are chosen; all others test.
SPLIT_OF = {"train": "train"} | dict.fromkeys(("listen-tune", "marks-tune", "cue-weights"), "validation")
NOTHING = Excluded({}, {}, {})
HEARD = (*CATEGORIES, *OFF_SCREEN_CATEGORIES)


def drawn(wanted: Wanted, excluded: Excluded = NOTHING, **options: Any) -> tuple[Manifest, tuple[SampledGroup, ...]]:
    document, units = sample(wanted, excluded, **options)
    return Manifest.model_validate(document), units


@pytest.fixture(scope="module")
def large() -> tuple[Manifest, tuple[SampledGroup, ...]]:
    return drawn(Wanted(homes=60, observations=600, seed=5))


def groups(manifest: Manifest) -> list[list[ObservationSpec]]:
    """The siblings of each group."""
    found: dict[str, list[ObservationSpec]] = {}
    for spec in manifest.observations:
        if spec.is_part_3:
            found.setdefault(spec.like or spec.key, []).append(spec)
    return list(found.values())


def run(tmp_path: Path, *words: object, homes: int = 3, observations: int = 30, seed: int = 1) -> Any:
    """`avs3d manifest sample` into a file."""
    usual = ["sample", "-o", tmp_path / "out.yaml", "--homes", homes, "--observations", observations, "--seed", seed]
    return CliRunner().invoke(command, [str(word) for word in (*usual, *words)])


def message(result: Any) -> str:
    """The error of a command, which is one line."""
    assert isinstance(result.exception, Avs3dError | SystemExit), result.output
    text = str(result.exception) if isinstance(result.exception, Avs3dError) else result.output.splitlines()[-1]
    assert "\n" not in text
    return text


@pytest.mark.parametrize("name", ["../x", "\x1b[31mred", "", "a b", "a" * 201])
def test_a_name_that_no_manifest_may_have_is_refused_before_anything_is_written(tmp_path: Path, name: str) -> None:
    for words, group in ((("--name", name), command), ((tmp_path / "m.yaml", "--name", name), None)):
        if group is not None:
            result = run(tmp_path, *words)
        else:
            shutil.copy(MANIFESTS / "demo.yaml", tmp_path / "m.yaml")
            over = ["--over", "acoustics.absorption_scale=1,2", "-o", tmp_path / "out.yaml"]
            result = CliRunner().invoke(sweep, [str(word) for word in (*words, *over)])
        assert result.exit_code != 0
        text = message(result)
        assert text.startswith("--name: ")
        assert "is no name; expected 1 to 200 letters" in text
        assert text.isprintable()
        assert not (tmp_path / "out.yaml").exists()


@pytest.mark.parametrize("levels", [(5, -5), (0, 50), (-41, 0), ("nan", 0)])
def test_levels_that_no_manifest_may_have_are_one_line(tmp_path: Path, levels: tuple[object, object]) -> None:
    result = run(tmp_path, "--levels", *levels)
    assert isinstance(result.exception, UsageError)
    text = message(result)
    assert text == f"--levels {levels[0]} {levels[1]}: expected the lower level first, both from -40 to 20 dB"
    assert not (tmp_path / "out.yaml").exists()


@pytest.mark.parametrize("digits", [20, 400, 5000])
def test_a_seed_beyond_64_bits_is_a_usage_error(tmp_path: Path, digits: int) -> None:
    result = run(tmp_path, seed="9" * digits)  # type: ignore[arg-type]  # the words of a command
    assert result.exit_code == UsageError.exit_code
    assert "--seed" in message(result)
    assert not (tmp_path / "out.yaml").exists()


def test_every_home_is_new_and_has_about_as_many_observations_as_any_other(large) -> None:
    manifest, units = large
    assert len(manifest.observations) == 600
    assert len(manifest.scans) == 60
    seeds = [scan.seed for scan in manifest.scans.values()]
    assert len(set(seeds)) == 60
    assert all(seed is not None and SEEDS[0] <= seed < SEEDS[1] for seed in seeds)
    assert all(name == f"home_{scan.seed}" for name, scan in manifest.scans.items())
    per_home = Counter(unit.entries[0]["scan"] for unit in units)
    assert set(per_home) == set(manifest.scans)
    assert max(per_home.values()) - min(per_home.values()) <= 1


def test_no_home_of_an_excluded_manifest_is_drawn_and_none_of_its_seeds() -> None:
    wanted = Wanted(homes=20, observations=40, seed=9)
    first = sample(wanted, NOTHING)[0]["scans"]
    taken = {scan["seed"]: "other" for scan in first.values()}
    second = sample(wanted, Excluded(taken, {}, {}))[0]["scans"]
    assert len(second) == 20
    assert not {scan["seed"] for scan in second.values()} & set(taken)
    with pytest.raises(UsageError, match=r"--seed 9 is the seed of the excluded manifest other; choose another"):
        sample(wanted, Excluded({}, {9: "other"}, {}))


def test_what_manifests_use_is_read_from_files_and_folders(tmp_path: Path) -> None:
    for name, seed, extra in (("a", 1, {}), ("b", 2, {"models": {"clock": ["station"]}})):
        content = {
            "name": name,
            "seed": seed,
            "scans": {"flat": {"source": "apartment", "seed": 10 + seed}},
            "observations": [
                {
                    "part": "part_1",
                    "scan": "flat",
                    "room": "kitchen",
                    "index": 1,
                    "category": "clock",
                    "silent": ["oven"],
                }
            ],
        }
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(content | extra))
    found = what_they_use([tmp_path], tmp_path / "out.yaml")
    assert (found.homes, found.seeds) == ({11: "a", 12: "b"}, {1: "a", 2: "b"})
    assert {v for c, v in found.variants if c == "clock"} == set(catalogue.variants("clock"))
    only = what_they_use([tmp_path / "b.yaml"], tmp_path / "out.yaml")
    assert {v for c, v in only.variants if c == "clock"} == {"station"}
    assert {v for c, v in only.variants if c == "oven"} == set(catalogue.variants("oven"))
    # The file that is written again does not exclude itself.
    assert what_they_use([tmp_path], tmp_path / "a.yaml").seeds == {2: "b"}


def test_parts_rooms_and_categories_are_balanced(large) -> None:
    manifest, units = large
    assert Counter(spec.part for spec in manifest.observations) == {"part_1": 60, "part_2": 60, "part_3": 480}
    rooms = Counter(unit.entries[0]["room"] for unit in units)
    assert set(rooms) == set(ROOMS)
    assert max(rooms.values()) - min(rooms.values()) <= 3
    counts = sounding(manifest)
    total = sum(counts.values())
    for category in CATEGORIES:
        share = sum(count for (name, _), count in counts.items() if name == category) / total
        assert 0.7 / 7 < share < 1.4 / 7, category
        for room in ROOMS:
            assert (counts[category, room] > 0) == (category in MOST[room])
        assert counts[category, "off-screen"] > 0


def test_rooms_have_no_more_objects_than_they_take(large) -> None:
    for spec in large[0].observations:
        for category, count in spec.objects.items():
            assert count <= MOST[spec.room].get(category, int(category in DISTRACTORS))
        assert sum(count > 1 for count in spec.objects.values()) <= 1
    numbers = Counter(max(unit.objects.values()) for unit in large[0].observations if unit.part == "part_2")
    assert set(numbers) == {2, 3, 4}


def test_every_group_has_twins_or_categories_that_take_turns_silence_and_a_source_elsewhere(large) -> None:
    kinds: Counter[str] = Counter()
    for group in groups(large[0]):
        assert len(group) == GROUP
        first = group[0]
        assert all(spec.like == first.key and spec.instances == first.instances for spec in group[1:])
        assert len({(spec.sources, spec.background) for spec in group}) == GROUP
        assert len({spec.background for spec in group}) == 1
        alone = [s[0] for spec in group if (s := spec.sources or ()) and len(s) == 1 and s[0].room is None]
        if sum(count for name, count in first.objects.items() if name not in DISTRACTORS) > 1:
            assert len({(source.category, source.instance) for source in alone}) >= 2
        if len({name for name in first.objects if name not in DISTRACTORS}) > 1:
            assert len({source.category for source in alone}) >= 2
        if max(first.objects.values()) > 1:
            assert max(Counter(source.category for source in alone).values()) >= 2
        assert sum(spec.sources == () for spec in group) == 1
        elsewhere = [s[0] for spec in group if (s := spec.sources or ()) and len(s) == 1 and s[0].room is not None]
        assert elsewhere
        kinds["hard"] += any(source.category in first.objects for source in elsewhere)
        kinds["easy"] += any(source.category not in first.objects for source in elsewhere)
        kinds["several"] += any(len(spec.sources or ()) > 1 for spec in group)
        kinds["background"] += first.background is not None
    whole = len(groups(large[0]))
    assert min(kinds["hard"], kinds["easy"]) >= 0.4 * whole
    assert kinds["several"] >= 0.9 * whole
    assert 0.3 * whole < kinds["background"] < 0.7 * whole


@pytest.mark.parametrize("frames", [8, 24, 120])
@pytest.mark.parametrize(
    "instances", [{"clock": 1}, {"clock": 3}, {"clock": 1, "oven": 1}, {"clock": 2, "telephone": 1, "microwave": 1}]
)
def test_a_group_of_any_size_has_six_valid_siblings(instances: dict[str, int], frames: int) -> None:
    import numpy as np

    for number in range(8):
        found = siblings("kitchen", instances, number, frames, np.random.default_rng(number))
        assert len(found) == GROUP
        entries: list[dict[str, Any]] = [
            {
                "part": "part_3",
                "scan": "a",
                "room": "kitchen",
                "index": index,
                "instances": instances,
                "sources": sources,
            }
            for index, (_, sources) in enumerate(found, start=1)
        ]
        scans = {"a": {"source": "apartment", "seed": 1}}
        content = {"name": "x", "seed": 1, "camera": {"frames": frames}, "scans": scans, "observations": entries}
        Manifest.model_validate(content)
        assert not any(source["category"] in DISTRACTORS for _, sources in found for source in sources)


def test_the_same_options_give_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    texts = []
    for seed in (1, 1, 2):
        result = run(tmp_path, "--exclude", MANIFESTS / "demo.yaml", seed=seed)
        assert result.exit_code == 0, result.output
        texts.append((tmp_path / "out.yaml").read_bytes())
    assert texts[0] == texts[1] != texts[2]
    manifest = read_manifest(tmp_path / "out.yaml").manifest
    assert (manifest.name, manifest.seed, manifest.camera.frames, manifest.camera.size) == ("sampled-2", 2, 24, 252)
    assert (manifest.light, manifest.audio) == ("standard", "tracer")


def test_more_observations_leave_the_homes_as_they_are() -> None:
    few, many = (sample(Wanted(homes=4, observations=n, seed=3), NOTHING)[0]["scans"] for n in (8, 80))
    assert few == many


def test_parts_are_chosen_by_name(tmp_path: Path) -> None:
    result = run(tmp_path, "--parts", "part_3,part_1", observations=27)
    assert result.exit_code == 0, result.output
    parts = Counter(spec.part for spec in read_manifest(tmp_path / "out.yaml").manifest.observations)
    assert parts == {"part_1": 3, "part_3": 24}
    assert "part_4" in message(run(tmp_path, "--parts", "part_4"))
    assert shares(7, ("part_2",)) == {"part_2": 7}
    assert sum(shares(601, PARTS).values()) == 601


def test_the_statistics_are_printed(tmp_path: Path) -> None:
    result = run(tmp_path)
    for words in ("Sources by category and room", "off-screen", "silence", "Totals", "groups", "30 observations in 3"):
        assert words in result.output


def test_more_observations_than_the_rooms_take_is_one_line(tmp_path: Path) -> None:
    text = message(run(tmp_path, "--parts", "part_1", homes=1, observations=3 * MOST_INDEX + 1))
    assert "1 homes take at most 297 observations of part_1, found 298" in text
    full, _ = drawn(Wanted(homes=1, observations=3 * MOST_INDEX, seed=1, parts=("part_1",)))
    assert max(spec.index for spec in full.observations) == MOST_INDEX
    most = 3 * 10 * GROUP
    scenes, _ = drawn(Wanted(homes=1, observations=most, seed=1, parts=("part_3",)))
    assert max(spec.index for spec in scenes.observations) <= MOST_INDEX
    assert f"at most {most}" in message(run(tmp_path, "--parts", "part_3", homes=1, observations=most + 1))


def test_too_few_seeds_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample_module, "SEEDS", (100, 105))
    with pytest.raises(UsageError, match=r"--homes 4: only 3 seeds are not used by the excluded manifests"):
        sample(Wanted(homes=4, observations=8, seed=1), Excluded({100: "a", 104: "b", 7: "c"}, {}, {}))


def test_a_folder_without_manifests_and_a_missing_manifest_are_one_line(tmp_path: Path) -> None:
    assert "no manifest (*.yaml) is in this folder" in message(run(tmp_path, "--exclude", tmp_path))
    assert "missing.yaml" in message(run(tmp_path, "--exclude", tmp_path / "missing.yaml"))


def test_held_out_models_are_training_variants_that_no_excluded_manifest_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    families = dict.fromkeys((*CATEGORIES, *DISTRACTORS), ("one", "two"))
    monkeypatch.setattr(excluded_module, "training_variants", families.__getitem__)
    used = {("clock", "one"): "other", ("toilet", "round"): "another"}
    document, _ = sample(Wanted(homes=2, observations=4, seed=1, hold_out_models=True), Excluded({}, {}, used))
    assert document["models"]["clock"] == ["two"]
    assert document["models"]["toilet"] == ["one", "two"]
    assert set(document["models"]) == {*CATEGORIES, *DISTRACTORS}
    with pytest.raises(UsageError, match=r"no training variant of clock is left \(other uses all of them\)"):
        Excluded({}, {}, used | {("clock", "two"): "other"}).held_out_models()


def test_held_out_voices_are_training_voices_that_no_excluded_manifest_draws(tmp_path: Path) -> None:
    training = {name: [voice.name for voice in voices(name) if voice.split == "train"] for name in HEARD}
    first, _ = sample(Wanted(homes=2, observations=4, seed=1, hold_out_sounds=True), Excluded({}, {}, {}))
    assert first["voices"] == training
    heard = {name for entry in Manifest.model_validate(first).observations for name in entry.heard}
    path = tmp_path / "first.yaml"

    def left() -> dict[str, list[str]]:
        path.write_text(manifest_text(first, "the command"))
        return what_they_use([path], tmp_path / "out.yaml").held_out_voices()

    with pytest.raises(UsageError, match=rf"no training voice of .* is left \({first['name']} uses all of them\)"):
        left()
    first["voices"] = {name: names[:2] for name, names in training.items()}
    assert left() == {name: names[2:] if name in heard else names for name, names in training.items()}


def test_what_does_not_fit_is_drawn_again_in_the_same_place() -> None:
    wanted = Wanted(homes=3, observations=30, seed=2)
    plain, units = drawn(wanted)
    asked: list[int] = []

    def misfits(manifest: Manifest) -> list[int]:
        asked.append(len(manifest.observations))
        return {1: [0, 7], 2: [1]}.get(len(asked), [])

    checked, again = drawn(wanted, misfits=misfits)
    assert asked == [len(units), 2, 1]
    assert [spec.key for spec in checked.observations] == [spec.key for spec in plain.observations]
    differ = [number for number, (one, two) in enumerate(zip(units, again, strict=True)) if one != two]
    assert set(differ) <= {0, 7}
    assert 7 in differ
    assert drawn(wanted, misfits=lambda _: ())[0] == plain
    with pytest.raises(Avs3dError, match=r"part_1/home_\d+/\w+/1: no place in 20 draws; use another --seed"):
        sample(wanted, NOTHING, lambda _: [0])


def test_the_text_of_a_manifest_is_read_as_it_was_drawn(tmp_path: Path, large) -> None:
    document, _ = sample(Wanted(homes=60, observations=600, seed=5), NOTHING)
    path = tmp_path / "large.yaml"
    path.write_text(manifest_text(document, "the command"))
    assert path.read_text().startswith("# the command\nname: sampled-5\n")
    assert read_manifest(path).manifest == large[0]


@pytest.mark.slow
def test_sampled_observations_fit_into_their_rooms() -> None:
    manifest, units = drawn(Wanted(homes=2, observations=20, seed=4))
    firsts = {unit.entries[0]["index"]: unit for unit in units}
    assert firsts
    specs = [spec for spec in manifest.observations if spec.like is None]
    alone = manifest.model_copy(update={"observations": tuple(specs)})
    # In rooms with small things about one in ten finds no place (docs/sampling.md); --check draws it again.
    assert len(SampleFitting()(alone)) <= 0.15 * len(specs)
    crowded = [specs[0].model_copy(update={"room": "bathroom", "part": "part_1", "category": "washing_machine",
                                           "instances": None, "sources": None, "background": None,
                                           "silent": ("toilet",) * 12})]  # fmt: skip
    assert SampleFitting()(manifest.model_copy(update={"observations": tuple(crowded)})) == (0,)


def test_a_source_elsewhere_of_a_category_in_the_room_marks_no_object() -> None:
    from generators.observation.generate import class_table
    from generators.observation.parts import rules_of

    def table(instance: int | None) -> list[int]:
        source = SimpleNamespace(id="source_1", instance=instance, category="clock")
        ready: Any = SimpleNamespace(
            plan=SimpleNamespace(own_categories=None),
            rules=rules_of("part_3"),
            sources=[source],
            arrangement=SimpleNamespace(placements=["clock", "clock"]),
        )
        audible: Any = [SimpleNamespace(source="source_1")]
        return class_table(ready, audible).tolist()

    clock = CATEGORIES.index("clock") + 1
    assert table(None) == [0, 0, 0]
    assert table(2) == [0, 0, clock]


# models: of a manifest


def tiny(**changes: Any) -> dict[str, Any]:
    return {
        "name": "tiny",
        "seed": 1,
        "scans": {"flat": {"source": "apartment", "seed": 3}},
        "observations": [
            {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "clock", "silent": ["oven"]},
            {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 2, "category": "microwave"},
        ],
    } | changes


def plans(tmp_path: Path, content: dict[str, Any]) -> tuple[Any, ...]:
    path = tmp_path / "tiny.yaml"
    path.write_text(yaml.safe_dump(content))
    return make_plans(read_manifest(path), GenerateOptions(audio="analytic"))


def test_models_restrict_what_is_drawn(tmp_path: Path) -> None:
    from generators.observation.arrangement import choose_models

    for variant in catalogue.variants("clock"):
        plan, other = plans(tmp_path, tiny(models={"clock": [variant]}))
        assert [model.name for model in choose_models(plan) if model.category == "clock"] == [f"clock/{variant}"]
        assert [model.category for model in choose_models(other)] == ["microwave"]
    usual, _ = plans(tmp_path, tiny())
    named, _ = plans(tmp_path, tiny(models={"clock": list(catalogue.variants("clock"))}))
    assert [m.name for m in choose_models(usual)] == [m.name for m in choose_models(named)]


def test_models_count_in_the_digests_of_the_observations_that_draw_them(tmp_path: Path) -> None:
    usual, empty, clocks = (plans(tmp_path, tiny(models=m)) for m in ({}, {}, {"clock": ["station"]}))
    absent = plans(tmp_path, tiny())
    for name in ("digest", "pictures_digest"):
        assert [getattr(plan, name) for plan in absent] == [getattr(plan, name) for plan in empty]
        assert getattr(usual[0], name) != getattr(clocks[0], name)
        assert getattr(usual[1], name) == getattr(clocks[1], name)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"models": {"clock": ["pink"]}}, ["tiny: models: unknown variant 'pink' of clock", "expected one of station"]),
        ({"models": {"clock": ["statoin"]}}, ["did you mean 'station'?"]),
        ({"models": {"cluck": ["station"]}}, ["models", "unknown category 'cluck'", "did you mean 'clock'?"]),
        ({"models": {"clock": []}}, ["models.clock: too few entries; expected at least 1"]),
        ({"models": {"clock": "station"}}, ["models.clock: expected a list"]),
        ({"models": {"clock": ["station", "station"]}}, ["models.clock: 'station' is listed twice"]),
        (
            {"models": {"fan": ["big"]}, "categories": {"fan": {"stands_on": ["floor"], "height": [0.4, 0.5]}}},
            ["models.fan: fan is a category of this manifest and has no procedural models"],
        ),
        (
            {"models": {"clock": ["station"]}, "objects": {"clock": [{"asset": "sketchfab/1"}]}},
            ["models.clock: the files in objects replace the models of clock"],
        ),
    ],
)
def test_wrong_models_are_one_line(tmp_path: Path, changes: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(UsageError) as caught:
        plans(tmp_path, tiny(**changes))
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_a_variant_of_an_observation_must_be_among_the_models(tmp_path: Path) -> None:
    content = tiny(models={"clock": ["station"]})
    content["observations"][0]["variant"] = "wooden"
    with pytest.raises(UsageError, match=r"variant 'wooden' is not among models of clock; expected one of station"):
        plans(tmp_path, content)


# scenes_manifest/train.yaml


def test_the_training_manifest_shares_no_home_no_seed_and_no_model_with_any_other() -> None:
    train = read_manifest(TRAIN).manifest
    others = what_they_use([MANIFESTS], TRAIN)
    assert {11, 101, 201, 501} <= set(others.homes)
    assert len(train.scans) >= 150
    assert len(train.observations) >= 1000
    assert not {scan.seed for scan in train.scans.values()} & set(others.homes)
    assert train.seed not in others.seeds
    for category in {name for spec in train.observations for name in spec.objects}:
        assert set(train.models[category]) <= set(catalogue.training_variants(category))
        assert not {(category, variant) for variant in train.models[category]} & set(others.variants)
    assert not train.objects
    assert (train.audio, train.camera.size, train.camera.frames) == ("tracer", 252, 24)


def made_by_its_command(path: Path, folder: Path, *more: str) -> tuple[Path, list[str]]:
    """A sampled manifest that the command in the first line of ``path`` makes, and the words of this command."""
    shutil.copytree(MANIFESTS, folder / "scenes_manifest")
    words = shlex.split(path.read_text().splitlines()[0])
    assert words[:4] == ["#", "avs3d", "manifest", "sample"]
    made = folder / "scenes_manifest" / path.name
    result = CliRunner().invoke(command, [*words[3:], *more, "-o", f"scenes_manifest/{path.name}"])
    assert result.exit_code == 0, result.output
    return made, words


def test_the_command_in_the_training_manifest_makes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert made_by_its_command(TRAIN, tmp_path)[0].read_bytes() == TRAIN.read_bytes()


# scenes_manifest/listen.yaml and listen-tune.yaml


def fitting_of(path: Path, tried: Collection[str] = ()) -> Callable[[Manifest], tuple[int, ...]]:
    """Which observations do not fit: in the homes ``tried`` as they are found, elsewhere those that ``path`` lacks."""
    there = {spec.key: spec.objects for spec in read_manifest(path).manifest.observations}

    def misfits(manifest: Manifest) -> tuple[int, ...]:
        specs = manifest.observations
        of_tried = [number for number, spec in enumerate(specs) if spec.scan in tried]
        own = manifest.model_copy(update={"observations": tuple(specs[number] for number in of_tried)})
        found = {of_tried[number] for number in SampleFitting()(own)} if of_tried else set()
        lacking = {n for n, spec in enumerate(specs) if spec.scan not in tried and there.get(spec.key) != spec.objects}
        return tuple(sorted(found | lacking))

    return misfits


@pytest.mark.parametrize("path", [LISTEN, TUNE], ids=["listen", "listen-tune"])
def test_the_command_in_a_manifest_of_listen_makes_it_if_the_same_groups_fit(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is drawn follows from the command, without the minutes that places and walks take."""
    monkeypatch.setattr("generators.sampling.fitting.SampleFitting", lambda _workers: fitting_of(path))
    monkeypatch.chdir(tmp_path)
    assert made_by_its_command(path, tmp_path)[0].read_bytes() == path.read_bytes()


@pytest.mark.slow
def test_the_same_groups_fit_as_the_manifest_of_listen_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Places and walks are tried in one of the eight homes."""
    tried = sorted(read_manifest(LISTEN).manifest.scans)[:1]
    monkeypatch.setattr("generators.sampling.fitting.SampleFitting", lambda _workers: fitting_of(LISTEN, tried))
    monkeypatch.chdir(tmp_path)
    made, words = made_by_its_command(LISTEN, tmp_path)
    assert "--check" in words
    assert made.read_bytes() == LISTEN.read_bytes()


@pytest.fixture(scope="module", params=["sampled", "listen", "listen-tune"])
def listening(request: pytest.FixtureRequest) -> Manifest:
    """Manifests whose groups are composed for `listen`."""
    if request.param == "sampled":
        return drawn(Wanted(homes=10, observations=160, seed=5, parts=("part_3",), groups="listen"))[0]
    return read_manifest(MANIFESTS / f"{request.param}.yaml").manifest


def test_a_group_of_listen_is_mostly_twins_that_sound_alone(listening: Manifest) -> None:
    several = 0
    for group in groups(listening):
        first, sounding = group[0], [spec.sources or () for spec in group]
        assert first.twins == "alike"
        (focus, twins), *_ = sorted(first.objects.items(), key=lambda item: -item[1])
        no_class = with_no_class(group)
        alone = Counter(s[0].instance for s in sounding if len(s) == 1 and not s[0].room and s[0].category == focus)
        assert set(alone) == set(range(1, twins + 1))
        assert max(alone.values()) - min(alone.values()) <= 1
        pairs = [a != b for n, a in enumerate(alone.elements()) for b in list(alone.elements())[n + 1 :]]
        assert sum(pairs) >= 0.2 * len(group) * (len(group) - 1) / 2
        away = [one.category for s in sounding for one in s if one.room]
        if no_class:
            # Heard alone, and once more with an object of the room: it does not tell that nothing is to be marked.
            assert away == [no_class] * 2
            assert sorted(len(s) > 1 for s in sounding if any(one.room for one in s)) == [False, True]
            continue
        # The category of what is off-screen stands silent in the room.
        assert [category in first.objects for category in away] == [True]
        for sources in sounding:
            if len(sources) > 1:
                several += twins > 2
                assert len(sources) == 2
                # Two of three or more twins, or one of two and something else: never all objects of the categories.
                assert len({one.category for one in sources}) == (1 if twins > 2 else 2)
                assert focus in {one.category for one in sources}
        if twins > 2:
            assert any(len(sources) != 1 for sources in sounding)
    assert several >= len(groups(listening)) / 10
    hard = [
        group[0].objects[one.category] for group in groups(listening) for spec in group for one in spec.sources or ()
        if one.room and one.category in CATEGORIES
    ]  # fmt: skip
    assert len(hard) == len(groups(listening)) / 2
    assert sum(count == 1 for count in hard) >= len(hard) / 5


def test_half_of_the_groups_of_listen_have_a_background(listening: Manifest) -> None:
    assert all(len({spec.background for spec in group}) == 1 for group in groups(listening))
    assert sum(group[0].background is not None for group in groups(listening)) == len(groups(listening)) // 2


def test_every_room_of_listen_has_a_silent_distractor_and_they_take_turns(listening: Manifest) -> None:
    found: Counter[str] = Counter()
    for group in groups(listening):
        first = group[0]
        (one,) = set(first.objects) & set(DISTRACTORS_IN[first.room])
        assert first.objects[one] == 1
        found[one] += 1
    assert set(found) == {name for names in DISTRACTORS_IN.values() for name in names}


def with_no_class(group: list[ObservationSpec]) -> str | None:
    """The sound of no class of a group."""
    heard = [one.category for spec in group for one in spec.sources or () if one.category in OFF_SCREEN_CATEGORIES]
    return heard[0] if heard else None


def test_half_of_the_groups_of_listen_have_a_sound_of_no_class_and_all_sounds_take_turns(listening: Manifest) -> None:
    heard = [with_no_class(group) for group in groups(listening)]
    counts = Counter(name for name in heard if name)
    assert sum(counts.values()) == len(heard) / 2
    assert set(counts) == set(OFF_SCREEN_CATEGORIES)
    assert max(counts.values()) - min(counts.values()) <= 1


@pytest.fixture(scope="module")
def many() -> list[list[ObservationSpec]]:
    """The groups of a large sample of `listen`."""
    wanted = Wanted(homes=160, observations=640 * 8, seed=11, parts=("part_3",), groups="listen")
    return groups(drawn(wanted)[0])


def test_what_stands_in_a_room_does_not_tell_that_a_sound_of_no_class_is_heard(many) -> None:
    """Nor which one, but for the turns in which it is one that a distractor of the room could make."""
    for room in ROOMS:
        of_room = [group for group in many if group[0].room == room]
        share = sum(with_no_class(group) is not None for group in of_room) / len(of_room)
        for name in (*DISTRACTORS_IN[room], *LOOK_ALIKES.values(), *MOST[room]):
            having = [group for group in of_room if name in group[0].objects]
            if not having:
                continue
            found = sum(with_no_class(group) is not None for group in having) / len(having)
            # Three standard errors.
            assert abs(found - share) < 3 * (0.25 / len(having)) ** 0.5, (room, name)


def test_a_sound_of_no_class_does_not_tell_whether_something_is_to_be_marked(many) -> None:
    heard = [
        any(one.room is None for one in spec.sources or ()) for group in many for spec in group
        if any(one.category in OFF_SCREEN_CATEGORIES for one in spec.sources or ())
    ]  # fmt: skip
    assert sum(heard) == len(heard) / 2
    # Nor do its level, the room that it comes from and its voice: they are drawn alike with and without an object.
    levels: dict[bool, list[float]] = {True: [], False: []}
    rooms: dict[bool, Counter[tuple[str, str]]] = {True: Counter(), False: Counter()}
    for group in many:
        for spec in group:
            here = any(one.room is None for one in spec.sources or ())
            for one in spec.sources or ():
                if one.category in OFF_SCREEN_CATEGORIES:
                    levels[here].append(one.gain_db)
                    rooms[here][spec.room, str(one.room)] += 1
    assert rooms[True] == rooms[False]
    means = [sum(values) / len(values) for values in levels.values()]
    error = (LEVELS[1] - LEVELS[0]) / 12**0.5 * (2 / len(levels[True])) ** 0.5
    assert abs(means[0] - means[1]) < 3 * error


def test_what_could_make_a_sound_of_no_class_sometimes_stands_silent_in_the_room(many) -> None:
    there = [MADE_BY.get(name) in group[0].objects for group in many if (name := with_no_class(group))]
    assert 0.1 < sum(there) / len(there) < 0.5


def test_a_maker_in_the_room_does_not_tell_where_the_sound_is(many) -> None:
    """Which twin sounds beside a sound of no class is as independent of what stands there as without it."""
    for maker in (True, False):
        first = Counter()
        for group in many:
            name = with_no_class(group)
            if name is None or (MADE_BY.get(name) in group[0].objects) is not maker:
                continue
            for spec in group:
                inside = [one for one in spec.sources or () if one.room is None]
                if len(inside) == 1 and len(spec.sources or ()) == 2 and spec.objects[inside[0].category] == 2:
                    first[inside[0].instance] += 1
        total = first.total()
        assert total >= 20
        assert abs(first[1] / total - 0.5) < 3 * 0.5 / total**0.5


def test_training_groups_hear_sounds_of_no_class_alone_and_beside_objects(large) -> None:
    alone, beside, others = Counter(), 0, 0
    for group in groups(large[0]):
        for spec in group:
            for one in spec.sources or ():
                if one.category in OFF_SCREEN_CATEGORIES:
                    assert one.room is not None
                    alone[one.category] += len(spec.sources or ()) == 1
                    beside += len(spec.sources or ()) > 1
                elif one.room is not None:
                    others += one.category not in spec.objects
    assert set(alone) == set(OFF_SCREEN_CATEGORIES)
    assert max(alone.values()) - min(alone.values()) <= 2
    assert beside > 0
    assert others > alone.total() / 2
    units = [spec for spec in large[0].observations if spec.like is None]
    there = sum(bool(set(DISTRACTORS_IN[spec.room]) & set(spec.objects)) for spec in units)
    assert 0.4 < there / len(units) < 0.6


def test_twins_are_two_fifths_of_the_pairs_and_an_oracle_of_categories_is_mostly_wrong(listening: Manifest) -> None:
    """As if all objects were in view in every frame; docs/protocol-listen.md has the figures of the frames."""
    kinds: Counter[str] = Counter()
    right = 0
    for group in groups(listening):
        objects = group[0].objects
        truths = [{(one.category, one.instance) for one in spec.sources or () if one.room is None} for spec in group]
        marked = [
            {(name, n) for one in spec.sources or () if (name := one.category) in CATEGORIES
             for n in range(1, objects.get(name, 0) + 1)} for spec in group
        ]  # fmt: skip
        for one, other in itertools.combinations(range(len(group)), 2):
            if truths[one] == truths[other]:
                continue
            both = [group[number].sources or () for number in (one, other)]
            twins = all(len(sources) == 1 and sources[0].room is None for sources in both)
            kinds["twins" if twins and both[0][0].category == both[1][0].category else "other"] += 1
            right += all(marked[number] == truths[number] for number in (one, other))
    assert kinds["twins"] >= 0.4 * kinds.total()
    assert right <= 0.1 * kinds.total()


def test_every_source_of_listen_has_a_level_of_its_own(listening: Manifest) -> None:
    levels = [one.gain_db for spec in listening.observations for one in spec.sources or ()]
    assert LEVELS[0] <= min(levels) < LEVELS[0] + 2
    assert LEVELS[1] - 2 < max(levels) <= LEVELS[1]
    for group in groups(listening):
        assert len({one.gain_db for spec in group for one in spec.sources or ()}) >= 5


def test_the_place_of_a_sibling_in_its_group_does_not_tell_what_sounds(many) -> None:
    specs = [spec for group in many for spec in group]
    silent = Counter(spec.index % 10 for spec in specs if not spec.sources)
    elsewhere = Counter(spec.index % 10 for spec in specs if any(one.room for one in spec.sources or ()))
    for counts in (silent, elsewhere):
        mean = counts.total() / 8
        assert all(abs(counts[place] - mean) < 4 * mean**0.5 for place in range(1, 9))


@pytest.mark.parametrize("path", [LISTEN, TUNE], ids=["listen", "listen-tune"])
def test_listen_has_homes_of_its_own_every_room_and_every_category(path: Path) -> None:
    manifest = read_manifest(path).manifest
    assert len(manifest.scans) >= 8
    assert 16 <= len(groups(manifest)) <= 24
    assert len(manifest.observations) <= 140
    assert {spec.room for spec in manifest.observations} == set(ROOMS)
    assert {one.category for spec in manifest.observations for one in spec.sources or ()} == set(HEARD)
    # listen-recorded.yaml has the observations of listen.yaml.
    own = {path.name, "listen-recorded.yaml"} if path == LISTEN else {path.name}
    found = [one for one in MANIFESTS.glob("*.yaml") if "lock" not in one.name and one.name not in own]
    others = what_they_use(found, path)
    assert not {scan.seed for scan in manifest.scans.values()} & set(others.homes)
    assert manifest.seed not in others.seeds


def test_all_patterns_of_listen_have_as_many_siblings() -> None:
    assert {pattern.size for pattern in (*OF_TWO, *OF_MORE)} == {COMPOSITIONS["listen"].size}
    assert tuple(COMPOSITIONS) == (*GROUPS, *PURPOSES)


def test_twins_that_do_not_fit_are_placed_anew_before_others_are_drawn() -> None:
    wanted = Wanted(homes=2, observations=16, seed=3, parts=("part_3",), groups="listen")
    plain, _ = drawn(wanted)
    again = COMPOSITIONS["listen"].same_again

    def moved(times: int) -> ObservationSpec:
        asked = iter([[0]] * times + [[]])
        return next(spec for spec in drawn(wanted, misfits=lambda _: next(asked))[0].observations)

    first = plain.observations[0]
    assert moved(1).index == first.index + 10
    assert moved(again).model_copy(update={"index": first.index}) == first
    assert moved(again + 1).model_copy(update={"index": first.index}) != first


def test_distractors_and_sounds_of_no_class_take_turns_though_most_groups_are_drawn_again() -> None:
    wanted = Wanted(homes=8, observations=128, seed=3, parts=("part_3",), groups="listen")
    asked = iter([range(16)] * 9 + [range(8)] * 5 + [()])
    found = groups(drawn(wanted, misfits=lambda _: next(asked))[0])
    assert {with_no_class(group) for group in found} == {None, *OFF_SCREEN_CATEGORIES}
    stood = Counter(name for group in found for name in group[0].objects if name in DISTRACTORS_IN[group[0].room])
    assert set(stood) == {name for names in DISTRACTORS_IN.values() for name in names}


def test_twins_that_are_not_alike_do_not_fit() -> None:
    import numpy as np

    from avs3d_bench.geometry import Pose
    from generators.sampling.fitting import are_alike

    def found(*sources: tuple[float, float, float], turns: tuple[float, ...]) -> Any:
        model = object()
        placed = [SimpleNamespace(model=model, source_position=source) for source in sources]
        poses = [
            Pose.from_yaw((0.0, 1.5, z), yaw, 0.0) for z, yaw in zip(np.linspace(0, 1, len(turns)), turns, strict=True)
        ]
        return SimpleNamespace(placements=placed, poses=poses)

    around = (0.0, 1.5, 3.0, 4.5, 0.7, 2.2)
    assert are_alike(found((-0.5, 1.5, 3.0), (0.5, 1.5, 3.0), turns=around))
    # Seen from the walk, one is in front and one behind: one grows louder while the other grows softer.
    assert not are_alike(found((0.0, 1.5, 2.0), (0.0, 1.5, -1.0), turns=around))
    # The head never turns: both stay on one side.
    assert not are_alike(found((0.5, 1.5, 3.0), (0.5, 1.0, 3.0), turns=(0.0,) * 6))
    assert are_alike(found((0.5, 1.5, 3.0), turns=(0.0,) * 6))


def test_no_committed_manifest_draws_voices_of_another_split() -> None:
    split_of = {(voice.category, voice.name): voice.split for name in HEARD for voice in voices(name)}
    for path in sorted(MANIFESTS.glob("*.yaml")):
        if "lock" in path.name:
            continue
        manifest = read_manifest(path).manifest
        assert manifest.version == VERSION_OF.get(path.stem, "4.0.0"), path.name
        heard = {name for entry in manifest.observations for name in entry.heard}
        assert heard <= {*manifest.voices, *manifest.sounds}, f"{path.name}: a category plays its old sound"
        for category, names in manifest.voices.items():
            for name in names:
                assert split_of[category, name] == SPLIT_OF.get(path.stem, "test"), (path.name, category, name)


@pytest.mark.parametrize("split", SPLITS)
def test_the_voices_of_a_split_are_drawn(split: str, tmp_path: Path) -> None:
    result = run(tmp_path, "--sounds", split, "--version", "3.0.0")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "out.yaml").read_text()
    assert f" --sounds {split} --version 3.0.0 " in text.splitlines()[0]
    found = read_manifest(tmp_path / "out.yaml").manifest
    assert found.version == "3.0.0"
    assert {category: list(names) for category, names in found.voices.items()} == {
        name: [voice.name for voice in voices(name) if voice.split == split] for name in HEARD
    }


def test_voices_of_another_split_can_be_held_out_too(tmp_path: Path) -> None:
    document, _ = sample(Wanted(homes=2, observations=4, seed=1, sounds="test"), NOTHING)
    used = {(name, document["voices"][name][0]): "other" for name in CATEGORIES}
    wanted = Wanted(homes=2, observations=4, seed=1, sounds="test", hold_out_sounds=True)
    left, _ = sample(wanted, Excluded({}, {}, {}, used))
    assert left["voices"] == {name: names[name in CATEGORIES :] for name, names in document["voices"].items()}


@pytest.mark.parametrize("text", ["3", "3.0", "v3.0.0", "", "3.0.0\n4"])
def test_a_version_that_is_none_is_one_line(text: str, tmp_path: Path) -> None:
    said = message(run(tmp_path, "--version", text))
    assert "is no version; expected three numbers, such as 3.0.0" in said
    assert not (tmp_path / "out.yaml").exists()


def test_scenes_for_seld_have_several_events_or_a_moving_one_and_three_kinds_of_agents(tmp_path: Path) -> None:
    options = ["--homes", "2", "--observations", "24", "--seed", "5", "--for", "seld"]
    done = CliRunner().invoke(command, ["sample", "-o", str(tmp_path / "a.yaml"), *options], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    text = (tmp_path / "a.yaml").read_text()
    line = shlex.split(text.splitlines()[0].removeprefix("# avs3d manifest "))
    assert "--for seld" in text.splitlines()[0]
    assert "--groups" not in line
    CliRunner().invoke(command, [*line, "-o", str(tmp_path / "b.yaml")], catch_exceptions=False)
    assert (tmp_path / "b.yaml").read_text() == text, "the command in its first line makes it"
    assert "&id" not in text
    manifest = read_manifest(tmp_path / "a.yaml").manifest
    assert manifest.camera.frames == 60
    assert Counter(one.part for one in manifest.observations) == {"part_1": 6, "part_3": 18}
    for home in manifest.scans:
        agents = Counter(one.agent for one in manifest.observations if one.scan == home)
        assert set(agents.values()) == {4}, agents
    for one in manifest.observations:
        if one.part == "part_1":
            assert one.source_motion == "path"
            assert one.room != "bathroom"
            continue
        heard = Counter(source.category for source in one.sounding if source.room is None)
        assert heard == {name: count for name, count in one.objects.items() if name not in DISTRACTORS}
        assert heard.total() >= 2
        moving = sum(count for name, count in heard.items() if name in one.moving)
        walks = one.agent == "walking"
        expected = one.room == "kitchen" or (one.room == "living_room" and walks)
        assert moving >= 2 if expected else not one.moving
        assert all(source.programme and source.programme.bursts for source in one.sounding)
    away = [one for one in manifest.observations if any(source.room for source in one.sounding)]
    assert len(away) == 6, "one in three of the scenes of part_3"


def test_agents_take_turns_though_units_are_drawn_again() -> None:
    draws = iter([range(0, 24, 5), range(0, 5, 2)])
    wanted = Wanted(homes=2, observations=24, seed=5, groups="seld", parts=("part_1", "part_3"))
    document, _ = sample(wanted, Excluded({}, {}, {}), lambda _: next(draws, ()))
    agents = Counter((one["scan"], one["agent"]) for one in document["observations"])
    assert set(agents.values()) == {4}


def test_what_does_not_go_with_seld_is_one_line(tmp_path: Path) -> None:
    for options, said in (
        (["--groups", "listen"], "--groups listen: --for seld has a composition of its own; leave it out"),
        (["--parts", "part_2"], "--parts part_2: seld has no part_2; expected some of part_1,part_3"),
    ):
        whole = ["sample", "-o", str(tmp_path / "a.yaml"), "--homes", "1", "--observations", "1", "--seed", "5"]
        done = CliRunner().invoke(command, [*whole, "--for", "seld", *options])
        assert isinstance(done.exception, UsageError)
        assert str(done.exception) == said


def test_an_agent_that_stays_is_at_a_place_of_the_walk() -> None:
    walk = tuple(Pose.from_yaw((0.3 * n, 1.5, 0.0), 0.2 * n, 0.1) for n in range(20))
    for turns in (False, True):
        poses = stay(walk, np.random.default_rng(3), turns=turns)
        assert len(poses) == len(walk)
        assert {pose.position for pose in poses} <= {pose.position for pose in walk}
        assert len({pose.position for pose in poses}) == 1
        assert all(abs(pose.rotation_matrix[1, 2]) < 1e-12 for pose in poses), "level"
        angles = [rotation_angle(*pair) for pair in itertools.pairwise(poses)]
        assert all(TURN_RATE[0] <= one <= TURN_RATE[1] for one in angles) if turns else max(angles) < 1e-9
