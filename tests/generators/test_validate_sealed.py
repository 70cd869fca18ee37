"""`validate` on the folders of a sealed test: the public side is a dataset, the private side and the parent are not."""

from __future__ import annotations

from pathlib import Path

import pytest

from avs3d_bench.errors import UsageError
from avs3d_bench.validate import validate
from tests.support.sealed_trees import write_seal


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seal(tmp_path_factory.mktemp("sealed"))


@pytest.mark.parametrize("deep", [False, True])
def test_the_private_side_is_sent_to_unseal_in_one_line(made: Path, deep: bool):
    with pytest.raises(UsageError, match=r"private side of a sealed test.*avs3d unseal") as error:
        validate(made / "private", deep=deep)
    assert "\n" not in str(error.value)


def test_the_parent_folder_says_what_checks_each_side(made: Path):
    with pytest.raises(UsageError) as error:
        validate(made)
    assert f"validate {made / 'public'}" in str(error.value)
    assert f"avs3d unseal {made} --secret FILE" in str(error.value)


def test_the_public_side_and_an_ordinary_dataset_are_checked_as_before(made: Path):
    assert validate(made / "public").valid
    # Generated in the same folder: dataset.json, and no opening key.
    assert validate(made / "generated").observations == 2
