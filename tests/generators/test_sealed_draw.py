"""The manifest that a secret draws from a template: seeds, homes and numbers; what is refused."""

from __future__ import annotations

from collections import Counter
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError, UsageError
from generators.manifest.reading import read_manifest
from generators.manifest.schema import Manifest
from generators.options import GenerateOptions
from generators.sealing import draw
from generators.sealing.draw import check_template, draw_document, fit_homes, home_seed
from generators.sealing.seal import PUBLIC_MANIFESTS, seal
from generators.sealing.texts import sealed_text

SECRET = bytes(range(32))
CATEGORIES = ("clock", "telephone", "vacuum_cleaner")


def template(homes: int = 6, groups: int = 2) -> dict[str, Any]:
    """Homes with two observations of part_1 and groups of three siblings in one room, in a telling order."""
    observations: list[dict[str, Any]] = []
    for home in range(homes):
        place = {"scan": f"flat_{home}", "room": "living_room"}
        observations += [
            {"part": "part_1", **place, "index": 1 + n, "category": CATEGORIES[(home + n) % 3]} for n in range(2)
        ]
        for group in range(groups):
            first = 1 + 3 * group
            things = {"clock": 2, "telephone": 1}
            source = {"category": "clock", "instance": 1}
            observations.append({"part": "part_3", **place, "index": first, "instances": things, "sources": [source]})
            like = f"part_3/flat_{home}/living_room/{first}"
            observations.append({"like": like, "index": first + 1, "sources": [{"category": "telephone"}]})
            observations.append({"like": like, "index": first + 2, "sources": []})
    scans = {f"flat_{home}": {"seed": home} for home in range(homes)}
    return {"name": "t", "version": "1", "seed": 3, "scans": scans, "observations": observations}


def write(folder: Path, document: dict[str, Any]) -> Path:
    path = folder / "template.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def content(spec: Any) -> tuple[Any, ...]:
    """What an observation is asked for, without where it is."""
    sources = None if spec.sources is None else tuple((one.category, one.instance) for one in spec.sources)
    return spec.part, spec.room, spec.category, tuple(spec.objects.items()), sources


@given(st.binary(min_size=32, max_size=32))
def test_a_draw_keeps_what_is_asked_for_and_nothing_else(secret: bytes) -> None:
    before = template()
    kept = deepcopy(before)
    document, homes = draw_document(before, secret, {})
    assert before == kept
    old, new = Manifest.model_validate(before), Manifest.model_validate(document)
    assert Counter(map(content, old.observations)) == Counter(map(content, new.observations))
    assert sorted(homes.values()) == sorted(new.scans) == [f"home_{n}" for n in range(1, 7)]
    for home, name in homes.items():
        rooms = (
            Counter((s.part, s.room) for s in m.observations if s.scan == n) for m, n in ((old, home), (new, name))
        )
        assert next(rooms) == next(rooms)
    by_room: dict[tuple[str, ...], list[int]] = {}
    for spec in new.observations:
        by_room.setdefault((spec.part, spec.scan, spec.room), []).append(spec.index)
    assert all(sorted(found) == list(range(1, len(found) + 1)) for found in by_room.values())
    # Siblings stay with their original.
    for spec in new.observations:
        if spec.like is not None:
            assert spec.like.rpartition("/")[0] == spec.key.rpartition("/")[0]


def test_the_same_secret_draws_the_same_text_and_another_one_another() -> None:
    texts = [sealed_text(draw_document(template(), secret, {})[0]) for secret in (SECRET, SECRET, bytes(32))]
    assert texts[0] == texts[1] != texts[2]


def test_the_order_of_the_template_does_not_name_homes() -> None:
    """The names of homes are drawn by their sorted names."""
    other = template()
    other["scans"] = dict(reversed(other["scans"].items()))
    assert draw_document(other, SECRET, {})[0]["scans"] == draw_document(template(), SECRET, {})[0]["scans"]


def test_seeds_have_128_bits_and_do_not_repeat() -> None:
    seeds = []
    for number in range(200):
        document, _ = draw_document(template(homes=3), bytes([number]) * 32, {})
        seeds += [document["seed"], *(scan["seed"] for scan in document["scans"].values())]
    assert len(set(seeds)) == len(seeds) == 800
    assert max(seeds) < 2**128
    # A number of 128 random bits has 120 or less with a probability of 1/256: 3 of 800 are expected.
    assert sum(seed < 2**120 for seed in seeds) < 15


def test_numbers_tell_nothing_of_siblings() -> None:
    """In the template the first sibling has the clock, the second the telephone, the third silence."""
    roles: Counter[tuple[int, str]] = Counter()
    trials = 300
    for number in range(trials):
        secret = number.to_bytes(32, "big")
        document, _ = draw_document(template(homes=1, groups=1), secret, {})
        for spec in Manifest.model_validate(document).observations:
            if spec.part == "part_3":
                roles[spec.index, spec.sources[0].category if spec.sources else "silence"] += 1
    # 9 counts, each binomial (300, 1/3): 100 ± 8.2; 5 sigma.
    assert len(roles) == 9
    assert all(abs(count - 100) < 41 for count in roles.values()), roles


def test_homes_tell_nothing_of_categories() -> None:
    """In the template flat_0 has a clock and a telephone; afterwards any observation may be in any home."""
    found: Counter[tuple[str, str]] = Counter()
    for number in range(300):
        document, homes = draw_document(template(homes=3, groups=0), number.to_bytes(32, "big"), {})
        back = {new: old for old, new in homes.items()}
        for spec in Manifest.model_validate(document).observations:
            if spec.index == 1:
                found[back[spec.scan], str(spec.category)] += 1
    # 9 counts, each binomial (300, 1/3).
    assert len(found) == 9
    assert all(abs(count - 100) < 41 for count in found.values()), found


def test_a_seed_of_another_manifest_is_passed_over() -> None:
    first = home_seed(SECRET, "flat", 1, {})
    second = home_seed(SECRET, "flat", 1, {first: "public"})
    assert second != first
    assert home_seed(SECRET, "flat", 1, {second: "public"}) == first


def test_homes_without_room_are_drawn_again() -> None:
    asked: list[set[str]] = []

    def misfits(manifest: Manifest, homes: set[str]) -> set[str]:
        asked.append(set(homes))
        return {"home_2"} if len(asked) < 4 else set()

    before, homes = draw_document(template(homes=3), SECRET, {})
    document, draws = fit_homes(template(homes=3), SECRET, misfits, {})
    again = next(old for old, new in homes.items() if new == "home_2")
    assert draws == {f"flat_{n}": 4 if f"flat_{n}" == again else 1 for n in range(3)}
    assert asked == [{"home_1", "home_2", "home_3"}] + 3 * [{"home_2"}]
    changed = {name for name in before["scans"] if before["scans"][name] != document["scans"][name]}
    assert changed == {"home_2"}
    assert document["observations"] == before["observations"]
    assert draw_document(template(homes=3), SECRET, draws)[0] == document


def test_homes_that_are_never_large_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draw, "MOST_DRAWS", 3)
    with pytest.raises(Avs3dError, match=r"none of 3 homes has room .*ask for fewer objects in a room"):
        fit_homes(template(homes=1), SECRET, lambda _, homes: homes, {})


def test_a_moving_source_is_refused(tmp_path: Path) -> None:
    document = template(homes=1, groups=0)
    document["observations"][1]["source_motion"] = "path"
    with pytest.raises(UsageError, match=r"part_1/flat_0/living_room/2: source_motion: path: the object that moves"):
        check_template(read_manifest(write(tmp_path, document)))


def test_a_scan_without_its_file_is_refused(tmp_path: Path) -> None:
    document = template(homes=1, groups=0)
    document["scans"]["flat_0"] = {"source": "scan"}
    with pytest.raises(UsageError, match=r"scans.flat_0: a sealed test hides the names of scans; name the file"):
        check_template(read_manifest(write(tmp_path, document)))


def test_a_scan_of_a_public_manifest_is_refused(tmp_path: Path) -> None:
    """The scans of the paper are named by their ids; a path with such an id is the same home."""
    public = read_manifest(PUBLIC_MANIFESTS / "3davs-s34-o7.yaml").manifest
    name = next(name for name, scan in public.scans.items() if scan.source == "scan")
    document = template(homes=1, groups=0)
    document["scans"]["flat_0"] = {"source": "scan", "file": f"hm3d/{name}/{name}.glb"}
    source = read_manifest(write(tmp_path, document))
    with pytest.raises(UsageError, match="3davs-s34-o7, which is public, uses the scan of"):
        seal(source, tmp_path / "out", options=GenerateOptions())
    assert not (tmp_path / "out").exists()


def test_a_folder_with_a_seal_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out" / "public").mkdir(parents=True)
    (tmp_path / "out" / "public" / "seal.json").write_text("{}")
    source = read_manifest(write(tmp_path, template(homes=1, groups=0)))
    with pytest.raises(UsageError, match=r"this test is sealed already; choose another folder"):
        seal(source, tmp_path / "out", options=GenerateOptions())


def test_a_secret_in_a_folder_that_is_published_is_refused(tmp_path: Path) -> None:
    place = tmp_path / "out" / "public" / "secret"
    place.parent.mkdir(parents=True)
    place.write_text(SECRET.hex())
    source = read_manifest(write(tmp_path, template(homes=1, groups=0)))
    with pytest.raises(UsageError, match="the secret must not lie in"):
        seal(source, tmp_path / "out", secret_file=place, options=GenerateOptions())
