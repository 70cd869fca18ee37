"""Manifests: what they may say, what is refused in one line, and what an observation's bytes depend on."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.random import SeedSequence

from avs3d_bench.contract.taxonomy import CATEGORIES, ROOMS
from avs3d_bench.errors import Avs3dError, UsageError
from generators.options import GenerateOptions
from generators.plan import SECRET_SEEDS, derive_rng, make_plans, read_manifest, resolve_file
from tests.support.seed_mixing import exchanged_pool

MANIFESTS = Path(__file__).parents[2] / "scenes_manifest"


def document() -> dict:
    return {
        "name": "tiny",
        "seed": 1,
        "scans": {"flat": {"source": "apartment", "seed": 3}},
        "observations": [
            {
                "part": "part_1",
                "scan": "flat",
                "room": "kitchen",
                "index": 1,
                "category": "microwave",
                "silent": ["oven"],
            },
            {"part": "part_2", "scan": "flat", "room": "kitchen", "index": 1, "category": "clock", "instances": 3},
        ],
    }


def written(tmp_path: Path, content: dict) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_open_benchmark_has_the_papers_numbers() -> None:
    manifest = read_manifest(MANIFESTS / "open-s34-o7.yaml").manifest
    parts = Counter(entry.part for entry in manifest.observations)
    assert parts == {"part_1": 25, "part_2": 9}
    assert len(manifest.scans) == 4
    assert {entry.category for entry in manifest.observations} == set(CATEGORIES)
    assert {entry.room for entry in manifest.observations} == set(ROOMS)
    assert (manifest.camera.frames, manifest.camera.size, manifest.camera.hfov) == (120, 1008, 90.0)
    assert all(scan.source == "apartment" for scan in manifest.scans.values())
    beside = [entry for entry in manifest.observations if entry.category == "microwave" and "oven" in entry.silent]
    assert len(beside) >= 3
    assert all(2 <= entry.copies <= 4 for entry in manifest.observations if entry.part == "part_2")


def test_the_papers_benchmark_names_its_scans() -> None:
    manifest = read_manifest(MANIFESTS / "3davs-s34-o7.yaml").manifest
    assert set(manifest.scans) == {"5ZKStnWn8Zo", "q9vSo1VnCiC", "sT4fr6TAbpF", "wc2JMjhGNzB"}
    assert len(manifest.observations) == 34


@pytest.mark.parametrize("name", ["demo.yaml", "open-s34-o7.yaml", "3davs-s34-o7.yaml"])
def test_every_shipped_manifest_reads(name: str) -> None:
    assert read_manifest(MANIFESTS / name).manifest.observations


def change(content: dict, **fields: object) -> None:
    content["observations"][0].update(fields)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: change(d, category="microwve"), ["observations.0", "'microwve'", "did you mean 'microwave'"]),
        (lambda d: change(d, room="kichen"), ["observations.0", "did you mean 'kitchen'"]),
        (lambda d: change(d, silent=["ovn"]), ["observations.0", "did you mean 'oven'"]),
        (lambda d: change(d, scan="house"), ["unknown scan 'house'", "flat"]),
        (lambda d: change(d, instances=2), ["observations.0", "part_1 is single-instance"]),
        (lambda d: change(d, instances=9), ["observations.0.instances", "less than or equal to 4"]),
        (lambda d: change(d, silent=["microwave"]), ["is both category and silent"]),
        (lambda d: change(d, volume=3), ["observations.0.volume"]),
        (lambda d: d["observations"].append(d["observations"][0]), ["listed twice"]),
        (lambda d: d.update(observations=[]), ["observations"]),
        (lambda d: d.update(camera={"hfov": float("nan")}), ["camera.hfov"]),
        (lambda d: d.update(camera={"size": 4}), ["camera.size"]),
        (lambda d: d.update(scans={"flat": {"source": "apartment"}}), ["scans.flat", "needs a seed"]),
        (
            lambda d: d.update(scans={"flat": {"source": "scan", "up": "z"}}),
            ["scans.flat", "up and front belong together"],
        ),
        (lambda d: d.pop("seed"), ["seed"]),
    ],
)
def test_a_wrong_manifest_is_refused_in_one_line(tmp_path: Path, spoil, words: list[str]) -> None:
    content = document()
    spoil(content)
    with pytest.raises(UsageError) as caught:
        read_manifest(written(tmp_path, content))
    message = str(caught.value)
    assert "\n" not in message
    assert "tiny.yaml" in message
    for word in words:
        assert word in message


def test_files_that_are_no_manifest(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read the manifest"):
        read_manifest(tmp_path / "missing.yaml")
    broken = tmp_path / "broken.yaml"
    broken.write_text("name: [unclosed\nseed: 1")
    with pytest.raises(UsageError, match=r"not valid YAML at line \d"):
        read_manifest(broken)
    broken.write_text("just words")
    with pytest.raises(UsageError, match="expected a mapping"):
        read_manifest(broken)


def test_only_selects_by_pattern_and_refuses_one_that_matches_nothing(tmp_path: Path) -> None:
    source = read_manifest(written(tmp_path, document()))
    assert [plan.key for plan in make_plans(source, GenerateOptions(only=["part_2/*"], audio="analytic"))] == [
        "part_2/flat/kitchen/1"
    ]
    assert len(make_plans(source, GenerateOptions(audio="analytic"))) == 2
    with pytest.raises(UsageError, match="matches no observation"):
        make_plans(source, GenerateOptions(only=["part_3/*"], audio="analytic"))


def test_a_plan_digest_changes_with_everything_that_decides_bytes_and_nothing_else(tmp_path: Path) -> None:
    source = read_manifest(written(tmp_path, document()))
    plan = make_plans(source, GenerateOptions(audio="analytic"))[0]
    assert plan.digest == make_plans(source, GenerateOptions(audio="analytic", only=["part_1/*"]))[0].digest
    others = [
        make_plans(source, GenerateOptions(audio="analytic", frames=16))[0],
        make_plans(source, GenerateOptions(audio="analytic", size=64))[0],
        make_plans(source, GenerateOptions(audio="analytic", extras=("depth",)))[0],
        make_plans(source, GenerateOptions(audio="analytic", extras=("rirs",)))[0],
        make_plans(source, GenerateOptions(audio="analytic"))[1],
    ]
    for changed in ({"seed": 2}, {"light": "preview"}, {"scans": {"flat": {"source": "apartment", "seed": 4}}}):
        others.append(
            make_plans(read_manifest(written(tmp_path, document() | changed)), GenerateOptions(audio="analytic"))[0]
        )
    digests = [plan.digest, *(other.digest for other in others)]
    assert len(set(digests)) == len(digests)


def test_random_generators_differ_by_purpose_and_key_and_repeat() -> None:
    draws = [derive_rng(*args).random(4) for args in [(1, "a", "x"), (1, "a", "y"), (1, "b", "x"), (2, "a", "x")]]
    for first in range(4):
        for second in range(first):
            assert not np.array_equal(draws[first], draws[second])
    assert np.array_equal(draws[0], derive_rng(1, "a", "x").random(4))
    # Pinned: another value here means that every dataset changes.
    assert derive_rng(7, "part_1/flat/kitchen/1", "placement").integers(0, 1_000_000) == 89892


def _words(text: str) -> list[int]:
    return [int(word) for word in np.frombuffer(hashlib.sha256(text.encode()).digest(), dtype="<u4")]


def test_the_state_of_one_stream_of_a_secret_seed_does_not_tell_another() -> None:
    """The attack is granted the state of the stream of the points; on a seed outside the hash it succeeds."""
    seed, key = 2**200 + 12345, "part_2/home_1/kitchen/1"
    known, wanted = _words(f"{key}\0points"), _words(f"{key}\0sounding")

    def told(state_of: Callable[[list[int], str], SeedSequence]) -> bool:
        """Whether the stream ``points`` tells the stream ``sounding``; the seed has seven words."""
        pools = [state_of(words, purpose).pool.tolist() for words, purpose in ((known, "points"), (wanted, "sounding"))]
        return exchanged_pool(pools[0], 7, known, wanted) == pools[1]

    assert not told(lambda _, purpose: derive_rng(seed, key, purpose).bit_generator.seed_seq)
    assert told(lambda words, _: SeedSequence([seed, *words]))


def test_secret_seeds_have_streams_of_their_own() -> None:
    draws = [tuple(derive_rng(*args).integers(0, 2**63, 2)) for args in [
        (SECRET_SEEDS, "a", "x"), (SECRET_SEEDS + 1, "a", "x"), (SECRET_SEEDS, "b", "x"), (SECRET_SEEDS, "a", "y"),
        (SECRET_SEEDS - 1, "a", "x"),
    ]]  # fmt: skip
    assert len(set(draws)) == len(draws)
    assert derive_rng(SECRET_SEEDS, "part_1/flat/kitchen/1", "placement").integers(0, 1_000_000) == 371273


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"bell\.wav: sound for clock not found"):
        resolve_file(tmp_path, "bell.wav", "sound for clock")


def test_stems_count_only_where_something_can_be_heard(tmp_path: Path) -> None:
    """A silent scene has no stems, so that a reader of its files cannot tell whether they were asked for."""
    content = document()
    scene = {"part": "part_3", "scan": "flat", "room": "kitchen", "index": 1, "instances": {"clock": 1}}
    content["observations"] = [scene | {"sources": [{"category": "clock"}]}]
    first = "part_3/flat/kitchen/1"
    content["observations"] += [
        {"like": first, "index": 2, "sources": []},
        {"like": first, "index": 3, "sources": [], "background": {"kind": "noise", "snr_db": 20}},
    ]
    source = read_manifest(written(tmp_path, content))
    plain, stems = (make_plans(source, GenerateOptions(audio="analytic", extras=extras)) for extras in ((), ("stems",)))
    assert [a.digest == b.digest for a, b in zip(plain, stems, strict=True)] == [False, True, False]
    assert [plan.keeps_stems for plan in stems] == [True, False, True]


@pytest.mark.parametrize(
    ("named", "asked", "expected"),
    [(None, None, "tracer"), ("analytic", None, "analytic"), ("soundspaces", "analytic", "analytic")],
)
def test_the_engine_is_the_one_asked_for_else_the_manifests_else_the_tracer(tmp_path, named, asked, expected) -> None:
    content = document() | ({} if named is None else {"audio": named})
    assert (
        make_plans(read_manifest(written(tmp_path, content)), GenerateOptions(audio=asked))[0].options.engine
        == expected
    )


def test_published_manifests_name_the_engine_they_were_made_with() -> None:
    named = {
        path.name: read_manifest(path).manifest.audio for path in MANIFESTS.glob("*.yaml") if "lock" not in path.name
    }
    assert named.pop("demo.yaml") is None
    assert {named.pop(f"{name}.yaml") for name in ("train", "robustness", "marks-tune", "open-scans")} == {"tracer"}
    assert set(named.values()) == {"soundspaces"}


def test_an_engine_that_there_is_not_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown acoustic backend 'loud': expected soundspaces, tracer or analytic"):
        make_plans(read_manifest(written(tmp_path, document() | {"audio": "loud"})))
