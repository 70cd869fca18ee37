"""`avs3d sweep`: variants over a grid, what they share, and its messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.validate import validate
from generators.cli import generate
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from generators.sampling.sweep import MOST_VARIANTS
from generators.sampling.sweep_cli import sweep
from tests.support.homes import write_manifest

SCENE, SIBLING = "part_3/box/kitchen/1", "part_3/box/kitchen/2"
ENTRIES: list[dict[str, Any]] = [
    {"part": "part_1", "scan": "box", "room": "kitchen", "index": 1, "category": "microwave", "silent": ["oven"]},
    {
        "part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 2},
        "sources": [{"category": "microwave"}],
    },
    {
        "like": SCENE, "index": 2, "sources": [{"category": "microwave"}, {"category": "clock", "room": "bathroom"}],
        "background": {"kind": "room_tone", "snr_db": 10},
    },
]  # fmt: skip
SCALE, SNR = "acoustics.absorption_scale", "background.snr_db"


def write(folder: Path, **changes: object) -> Path:
    folder.mkdir(exist_ok=True)
    return write_manifest(folder, **{"observations": ENTRIES, "camera": {"size": 48, "frames": 4}} | changes)


def swept(path: Path, *over: str, only: str | None = None, output: Path | None = None) -> Path:
    target = output or path.with_name("swept.yaml")
    words = [str(path), "-o", str(target), *(word for one in over for word in ("--over", one))]
    sweep.main([*words, *(("--only", only) if only else ())], standalone_mode=False)
    return target


def refused(path: Path, *over: str, **options: Any) -> str:
    with pytest.raises(UsageError) as caught:
        swept(path, *over, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_grid_gives_every_combination_to_every_observation(tmp_path: Path) -> None:
    path = write(tmp_path)
    found = read_manifest(swept(path, f"{SCALE}=0.5,1", f"{SNR}=none,10", only="part_3/*")).manifest
    assert found.name == "tiny-sweep"
    said = [
        (spec.index, spec.like, spec.variant_of, spec.acoustics.absorption_scale, spec.background and
         (spec.background.kind, spec.background.snr_db))
        for spec in found.observations
    ]  # fmt: skip
    noise, tone = ("noise", 10.0), ("room_tone", 10.0)
    assert said == [
        # The first has no background and absorbs as it is: this combination of the grid keeps its key.
        (1, None, None, 1.0, None),
        (3, SCENE, SCENE, 0.5, None),
        (4, SCENE, SCENE, 0.5, noise),
        (5, SCENE, SCENE, 1.0, noise),
        # The sibling has a background of its own.
        (2, SCENE, None, 1.0, tone),
        (6, SCENE, SIBLING, 0.5, None),
        (7, SCENE, SIBLING, 0.5, tone),
        (8, SCENE, SIBLING, 1.0, None),
    ]
    sources = {spec.index: spec.sources for spec in found.observations}
    assert sources[3] == sources[4] == sources[5] == sources[1] != sources[2] == sources[6] == sources[7] == sources[8]


def test_part_1_varies_its_acoustics(tmp_path: Path) -> None:
    found = read_manifest(swept(write(tmp_path), f"{SCALE}=0.5,2", only="part_1/*")).manifest.observations
    # Its own scale, 1, is not in the grid: the first combination keeps the key.
    assert [(one.index, one.like, one.acoustics.absorption_scale) for one in found] == [
        (1, None, 0.5),
        (2, "part_1/box/kitchen/1", 2.0),
    ]


def test_variants_draw_what_their_original_draws(tmp_path: Path) -> None:
    plans = make_plans(
        read_manifest(swept(write(tmp_path), f"{SNR}=none,5", only="part_3/*")), GenerateOptions(audio="analytic")
    )
    first, variant, sibling, siblings_variant = plans
    assert {plan.pictures_digest for plan in plans} == {first.pictures_digest}
    assert [plan.first and plan.first.key for plan in plans] == [None, SCENE, SCENE, SCENE]

    def draws(purpose: str) -> list[int]:
        return [int(plan.own_rng(purpose).integers(1 << 60)) for plan in plans]

    seeds = [plan.acoustic_seed for plan in plans]
    for numbers in (*map(draws, ("sounding/1", "background", "sound/clock/1")), seeds):
        assert numbers[0] == numbers[1] != numbers[2] == numbers[3]
    assert len({plan.digest for plan in plans}) == 4
    assert siblings_variant.spec.sources == sibling.spec.sources
    assert variant.spec.variant_of == SCENE


def test_kinds_without_a_background_are_one_variant(tmp_path: Path) -> None:
    found = read_manifest(swept(write(tmp_path), f"{SNR}=none,5", "background.kind=noise,room_tone", only=f"{SCENE}"))
    said = [spec.background and (spec.background.kind, spec.background.snr_db) for spec in found.manifest.observations]
    assert said == [None, ("noise", 5.0), ("room_tone", 5.0)]


def test_the_same_options_write_the_same_file_with_its_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path)
    texts = [swept(path, f"{SCALE}=1,2", only="part_1/*", output=tmp_path / name).read_bytes() for name in "ab"]
    assert texts[0] == texts[1]
    assert capsys.readouterr().out.splitlines()[-1] == f"{tmp_path / 'b'}: 2 observations (originals: 1, variants: 1)"
    assert texts[0].startswith(b"# avs3d sweep tiny.yaml --over acoustics.absorption_scale=1,2 --only 'part_1/*'\n")


@pytest.mark.parametrize(
    ("over", "words"),
    [
        (
            "acoustics.absorbtion=1",
            "--over acoustics.absorbtion=1: unknown field 'acoustics.absorbtion'; expected one of "
            "acoustics.absorption_scale, background.snr_db, background.kind; did you mean "
            "'acoustics.absorption_scale'?",
        ),
        (f"{SCALE}=0.01", f"--over {SCALE}=0.01: '0.01' is out of range; expected 0.05 to 20"),
        (f"{SNR}=90", f"--over {SNR}=90: '90' is out of range; expected -30 to 80 (dB), or none"),
        (f"{SCALE}=loud", f"--over {SCALE}=loud: 'loud' is not a number; expected 0.05 to 20"),
        (f"{SCALE}=nan", f"--over {SCALE}=nan: 'nan' is not a number; expected 0.05 to 20"),
        (f"{SCALE}=", f"--over {SCALE}=: a value is missing; expected values separated by commas, e.g. "
         f"{SCALE}=0.5,1,2"),
        (f"{SCALE}=1,,2", f"--over {SCALE}=1,,2: a value is missing; expected values separated by commas, e.g. "
         f"{SCALE}=0.5,1,2"),
        (SCALE, f"--over {SCALE}: a value is missing; expected values separated by commas, e.g. {SCALE}=0.5,1,2"),
        (f"{SCALE}=1,1.0", f"--over {SCALE}=1,1.0: 1.0 is listed twice; give each value once"),
        ("background.kind=hum", "--over background.kind=hum: 'hum' is no background; expected room_tone or noise"),
    ],
)  # fmt: skip
def test_a_wrong_parameter_is_refused_in_one_line(tmp_path: Path, over: str, words: str) -> None:
    assert refused(write(tmp_path), over) == words


def test_an_empty_grid_is_refused(tmp_path: Path) -> None:
    assert refused(write(tmp_path)) == (
        "no parameter to sweep; give --over FIELD=VALUE,… with one of acoustics.absorption_scale, background.snr_db, "
        "background.kind"
    )


def test_a_parameter_given_twice_is_refused(tmp_path: Path) -> None:
    assert refused(write(tmp_path), f"{SCALE}=1", f"{SCALE}=2") == (
        f"--over {SCALE} is given twice; list all its values in one"
    )


def test_too_many_variants_are_refused(tmp_path: Path) -> None:
    values = ",".join(f"{0.1 + number / 1000:g}" for number in range(MOST_VARIANTS // 2 + 1))
    assert refused(write(tmp_path), f"{SCALE}={values}", only="part_3/*") == (
        "2 observations with 2,501 variants each are 5,002; expected at most 5,000: use fewer values, or choose "
        "observations with --only"
    )


def test_what_does_not_fit_the_observations_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert refused(path, f"{SNR}=10") == (
        f"part_1/box/kitchen/1: background belongs to part_3; sweep {SCALE} alone, or choose observations of part_3 "
        "with --only"
    )
    assert refused(path, "background.kind=noise", only=SCENE) == (
        f"{SCENE} has no background whose kind could be swept; give --over {SNR}=… as well"
    )
    assert refused(path, f"{SCALE}=1,2", only=SIBLING) == (
        f"{SIBLING} has the pictures of {SCENE}, which --only leaves out; choose both"
    )
    again = swept(path, f"{SCALE}=1,2", only="part_3/*")
    assert refused(again, f"{SNR}=10", output=tmp_path / "again.yaml") == (
        f"part_3/box/kitchen/3 is itself a variant of {SCENE}; choose the originals with --only"
    )


def test_files_beside_the_manifest_keep_it_in_its_folder(tmp_path: Path) -> None:
    path = write(tmp_path / "here")
    message = refused(path, f"{SCALE}=1,2", output=tmp_path / "there.yaml")
    assert message.endswith(f"tiny.yaml names files or assets relative to its folder; write the sweep to "
                            f"{tmp_path / 'here'} with -o")  # fmt: skip
    assert refused(path, f"{SCALE}=1,2", output=path).endswith(
        "exists, and this command has not written it; choose another name, or move the file away"
    )


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"variant_of": "part_3/box/kitchen/9", "index": 3}, "variant_of 'part_3/box/kitchen/9' names no observation"),
        ({"variant_of": "part_1/box/kitchen/1", "index": 3}, "in part_1 and part_2 write like"),
        ({"variant_of": SCENE, "index": 3, "sources": []}, "an entry with variant_of cannot have sources;"),
        ({"variant_of": SCENE, "like": SCENE, "index": 3}, "cannot have variant_of;"),
        ({"variant_of": SCENE, "index": 2}, f"{SIBLING} is listed twice"),
        ({"variant_of": SCENE, "index": 10_000}, "less than or equal to 9999"),
    ],
)  # fmt: skip
def test_a_wrong_variant_of_a_scene_is_refused(tmp_path: Path, entry: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_manifest(write(tmp_path, observations=[*ENTRIES, entry]))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def made(path: Path, root: Path, *options: str) -> Dataset:
    words = [str(path), "-o", str(root), "--workers", "1", "--audio", "analytic", *options]
    outcome = CliRunner().invoke(generate, words, catch_exceptions=False)
    assert outcome.exit_code == 0, outcome.output
    return Dataset(root)


@pytest.mark.slow
def test_variants_link_the_pictures_and_differ_in_sound(tmp_path: Path) -> None:
    entries = [entry if "like" not in entry else entry | {"sources": [{"category": "microwave"}]} for entry in ENTRIES]
    path = write(tmp_path, observations=entries)
    scenes = swept(path, f"{SCALE}=1,4", f"{SNR}=none,0", only="part_3/*")
    data = made(scenes, tmp_path / "scenes")
    assert len(data) == 8
    assert [str(p) for p in validate(data.root, deep=True).problems if p.severity == "error"] == []
    records = {o.key: o.record for o in data if o.record is not None}
    first = data.root / SCENE
    for key, record in records.items():
        for name in record.files:
            if name.startswith(layout.SIBLING_FOLDERS):
                assert (data.root / key / name).samefile(first / name)
    originals = {key: record.variant_of or key for key, record in records.items()}
    assert sorted(originals.values()) == [SCENE] * 4 + [SIBLING] * 4
    for key, original in originals.items():
        assert records[key].sources == records[original].sources
        assert records[key].instances == records[original].instances
    backgrounds = [record.background and record.background.snr_db for record in records.values()]
    assert sorted(map(str, backgrounds)) == ["0.0"] * 4 + ["None"] * 4


@pytest.mark.slow
def test_variants_of_part_1_are_those_that_are_rendered_alone(tmp_path: Path) -> None:
    path = swept(write(tmp_path), f"{SCALE}=1,4", only="part_1/*")
    data = made(path, tmp_path / "both", "--with", "depth")
    alone = made(path, tmp_path / "alone", "--with", "depth", "--only", "part_1/box/kitchen/2")
    variant, same = data.root / "part_1/box/kitchen/2", alone.root / "part_1/box/kitchen/2"
    first = data.root / "part_1/box/kitchen/1"
    for folder in (layout.INPUT, layout.INSTANCE_MASKS, layout.DEPTH):
        name = layout.image_path(folder, 3)
        assert (variant / name).samefile(first / name)  # linked, and not rendered again
    names = sorted(file.relative_to(variant) for file in variant.rglob("*") if file.is_file())
    assert names == sorted(file.relative_to(same) for file in same.rglob("*") if file.is_file())
    assert [name for name in names if (variant / name).read_bytes() != (same / name).read_bytes()] == []
    first_clip, second_clip = (Dataset(data.root)[f"part_1/box/kitchen/{index}"].frames[0].audio() for index in (1, 2))
    assert not np.array_equal(first_clip, second_clip)


@pytest.mark.slow
def test_tars_of_variants_are_those_that_are_rendered_alone(tmp_path: Path) -> None:
    path = swept(write(tmp_path), f"{SCALE}=1,4", only="part_1/*")
    words = [str(path), "--workers", "1", "--audio", "analytic", "--format", "webdataset"]
    tars = []
    for name, more in (("both", []), ("alone", ["--only", "part_1/box/kitchen/2"])):
        outcome = CliRunner().invoke(generate, [*words, "-o", str(tmp_path / name), *more], catch_exceptions=False)
        assert outcome.exit_code == 0, outcome.output
        tars.append((tmp_path / name / "train-000001.tar").read_bytes())
    assert tars[0] == tars[1]


def test_the_file_is_a_plain_manifest(tmp_path: Path) -> None:
    document = yaml.safe_load(swept(write(tmp_path), f"{SCALE}=1,2", only="part_1/*").read_text())
    assert list(document)[-1] == "observations"
    assert document["observations"][1] == {
        "like": "part_1/box/kitchen/1", "index": 2, "acoustics": {"absorption_scale": 2.0},
    }  # fmt: skip


def test_a_sealed_sweep_keeps_variants_with_their_originals(tmp_path: Path) -> None:
    from generators.manifest.schema import Manifest
    from generators.sealing.draw import draw_document

    path = swept(write(tmp_path), f"{SCALE}=1,4", f"{SNR}=none,5", only="part_3/*")
    before = read_manifest(path).manifest
    drawn, homes = draw_document(yaml.safe_load(path.read_text()), bytes(range(32)), {})
    after = Manifest.model_validate(drawn)

    def described(manifest: Manifest) -> list[str]:
        specs = {spec.key: spec for spec in manifest.observations}
        return sorted(
            repr((spec.sources, spec.acoustics, spec.background, specs[spec.variant_of or spec.key].background))
            for spec in manifest.observations
        )

    assert homes == {"box": "home_1"}
    assert described(after) == described(before)
    assert [spec.key for spec in after.observations] != [spec.key for spec in before.observations]
