"""`validate --deep` finds every falsification of tests/tampering.py, or the table says why it cannot."""

from __future__ import annotations

from pathlib import Path

import pytest
import tampering
import tiny
from tampering import MUTATIONS, Mutation

from avs3d_bench.validate import validate


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tampering.write_witness(tmp_path_factory.mktemp("witness") / "plain")


@pytest.fixture(scope="module")
def with_extras(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tampering.write_witness(tmp_path_factory.mktemp("witness") / "extras", extras=True)


@pytest.mark.slow
def test_the_witness_is_valid(plain: Path, with_extras: Path):
    for root in (plain, with_extras):
        assert validate(root, deep=True).problems == ()


def test_the_table_has_each_falsification_once():
    names = [(one.group, one.name) for one in MUTATIONS]
    assert len(set(names)) == len(names)
    assert len(names) >= 100


def _name(one: Mutation) -> str:
    return f"{one.group}: {one.name}"


@pytest.mark.slow
@pytest.mark.parametrize("one", [one for one in MUTATIONS if not one.unseen], ids=_name)
def test_what_can_be_seen_is_found(plain: Path, with_extras: Path, tmp_path: Path, one: Mutation):
    problems = tampering.tampered(with_extras if one.extras else plain, tmp_path / "data", one)
    assert problems
    # Of the observation that was falsified, or of dataset.json; nothing that the digests alone give away.
    assert {p.path for p in problems if p.path.startswith(tiny.MULTI) or p.path == "dataset.json"}
    assert not any("sha256" in p.message or "digest" in p.message for p in problems)


@pytest.mark.slow
@pytest.mark.parametrize("one", [one for one in MUTATIONS if one.unseen], ids=_name)
def test_what_the_table_calls_unseen_is_unseen(plain: Path, tmp_path: Path, one: Mutation):
    """If this fails, a check has become better: the table and docs/validation.md should say so."""
    assert tampering.tampered(plain, tmp_path / "data", one) == ()
