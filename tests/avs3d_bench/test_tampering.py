"""`validate --deep` finds every falsification of tests/support/tampering.py, or the table says why it cannot."""

from __future__ import annotations

from pathlib import Path

import pytest

from avs3d_bench.validate import validate
from tests.support import tampering, tampering_scenes, tiny
from tests.support.tampering import MUTATIONS, Mutation
from tests.support.tampering_scenes import SCENE_MUTATIONS, SceneMutation


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tampering.write_witness(tmp_path_factory.mktemp("witness") / "plain")


@pytest.fixture(scope="module")
def with_extras(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tampering.write_witness(tmp_path_factory.mktemp("witness") / "extras", extras=True)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With another observation, for files that are taken from it."""
    folder = tmp_path_factory.mktemp("witness") / "two"
    return tampering.write_witness(folder, keys=(tiny.SINGLE, tiny.MULTI))


@pytest.mark.slow
def test_the_witness_is_valid(plain: Path, with_extras: Path, two: Path):
    for root in (plain, with_extras, two):
        assert validate(root, deep=True).problems == ()


def test_the_table_has_each_falsification_once():
    names = [(one.group, one.name) for one in MUTATIONS]
    assert len(set(names)) == len(names)
    assert len(names) >= 100


def _name(one: Mutation | SceneMutation) -> str:
    return f"{one.group}: {one.name}"


@pytest.mark.slow
@pytest.mark.parametrize("one", [one for one in MUTATIONS if not one.unseen], ids=_name)
def test_what_can_be_seen_is_found(plain: Path, with_extras: Path, two: Path, tmp_path: Path, one: Mutation):
    root = with_extras if one.extras else two if "another observation" in one.name else plain
    problems = tampering.tampered(root, tmp_path / "data", one)
    assert problems
    # Of the observation that was falsified, or of dataset.json; nothing that the digests alone give away.
    assert {p.path for p in problems if p.path.startswith(tiny.MULTI) or p.path == "dataset.json"}
    assert not any("sha256" in p.message or "digest" in p.message for p in problems)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "extras", "said"),
    [
        ("the silent twin sounds, in all files but the clips", False, "follow instance 2 (microwave, silent)"),
        ("reverberation time of a cathedral", False, "acoustics.t30 is 9 s; a room of"),
        ("reverberation time, ten times that of the responses", True, "acoustics.t30 is 1.41 s, the responses have"),
        ("gain, ten times", False, "acoustics.gain is 10: with it, the source is -"),
    ],
)
def test_what_the_sound_contradicts(plain: Path, with_extras: Path, tmp_path: Path, name: str, extras: bool, said: str):
    one = next(one for one in MUTATIONS if one.name == name)
    problems = tampering.tampered(with_extras if extras else plain, tmp_path / "data", one)
    assert any(said in problem.message for problem in problems), problems


@pytest.mark.slow
@pytest.mark.parametrize("one", [one for one in MUTATIONS if one.unseen], ids=_name)
def test_what_the_table_calls_unseen_is_unseen(plain: Path, two: Path, tmp_path: Path, one: Mutation):
    """If this fails, a check has become better: the table and docs/validation.md should say so."""
    assert tampering.tampered(two if "another observation" in one.name else plain, tmp_path / "data", one) == ()


# --- part_3 observations ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The group of tests/support/tiny_scenes.py without stems (""), with them, and with responses, too."""
    folder = tmp_path_factory.mktemp("scenes")
    options = {"": {"stems": False}, "stems": {}, "rirs": {"rirs": True}}
    return {name: tampering_scenes.write_scenes(folder / f"data{name}", **more) for name, more in options.items()}


@pytest.mark.slow
@pytest.mark.parametrize("needs", ["", "stems", "rirs"])
def test_the_part_3_are_valid(scenes: dict[str, Path], needs: str):
    assert validate(scenes[needs], deep=True).problems == ()


def test_the_table_of_part_3_has_each_falsification_once():
    names = [(one.group, one.name) for one in SCENE_MUTATIONS]
    assert len(set(names)) == len(names)
    assert sum(not one.unseen for one in SCENE_MUTATIONS) >= 50


@pytest.mark.slow
@pytest.mark.parametrize("one", SCENE_MUTATIONS, ids=_name)
def test_a_falsified_part_3(scenes: dict[str, Path], tmp_path: Path, one: SceneMutation):
    problems = tampering_scenes.tampered(scenes[one.needs], tmp_path / "data", one)
    if one.unseen:
        assert problems == ()  # else a check has become better: the table and docs/validation.md should say so
        return
    path = one.path if one.path == "dataset.json" else f"{one.key}/{one.path}"
    assert any(p.path == path and one.words in p.message and p.severity == "error" for p in problems), problems
    # The digests were made again: nothing is found by them. One line each, and the path is said once.
    assert not any("sha256" in p.message or "digest" in p.message for p in problems)
    assert not any("\n" in p.message or str(tmp_path) in p.message for p in problems)
