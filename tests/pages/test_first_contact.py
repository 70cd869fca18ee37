"""Frequent mistakes of newcomers: each gives an immediate one-line message that says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from avs3d_bench.cli import avs3d
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.inspector.submissions import open_submissions
from baselines.doctor import OPTIONS, checks
from baselines.networks.checkpoints import CHECKPOINTS
from baselines.trivial import write_trivial
from evaluators import cli as evaluator
from generators.manifest.reading import read_manifest
from generators.run.runner import refuse_foreign
from tests.support import tiny
from tests.support.homes import tree_digest, write_manifest
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset()


def test_a_dataset_is_no_submission(data: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="a dataset, expected a submission"):
        open_submissions(Dataset(data), [data])
    write_trivial("centre-box", Dataset(data), tmp_path / "box")
    assert [shown.name for shown in open_submissions(Dataset(data), [tmp_path / "box"])] == ["centre-box"]


def test_a_dataset_with_the_released_pipelines_masks_is_a_submission(tmp_path: Path) -> None:
    root = tiny.write_dataset(tmp_path / "data", frames=2)
    (root / tiny.SINGLE / "3d_segmentation_use_aisrm_True/masks/test").mkdir(parents=True)
    assert len(open_submissions(Dataset(root), [root])) == 1


@pytest.mark.parametrize("command", ["evaluate", "check"])
@pytest.mark.parametrize("target", ["/proc/avs3d/scores.json", "{file}/scores.json"])
def test_an_output_that_cannot_be_written_is_told_before_scoring(
    command: str, target: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    write_trivial("centre-box", Dataset(data), tmp_path / "box")
    worked = []
    monkeypatch.setattr("evaluators.score.score", lambda *_, **__: worked.append("score"))
    monkeypatch.setattr("evaluators.reading.checks.check_submission", lambda *_, **__: worked.append("check"))
    arguments = [tmp_path / "box", "--dataset", data, "--json", target.format(file=tmp_path / "file")]
    done = CliRunner().invoke(getattr(evaluator, command), [str(word) for word in arguments])
    assert isinstance(done.exception, Avs3dError)
    assert "scores.json: cannot write" in str(done.exception)
    assert not worked


def test_looking_whether_a_file_can_be_written_leaves_nothing(data: Path, tmp_path: Path) -> None:
    from avs3d_bench.formats.files import check_writable

    (tmp_path / "scores.json").write_text("kept")
    before = tree_digest(tmp_path)
    check_writable(tmp_path / "scores.json")
    check_writable(tmp_path / "new/folder/scores.json")
    assert tree_digest(tmp_path) == before
    assert not (tmp_path / "new").exists()


def test_nothing_is_generated_into_a_foreign_folder(tmp_path: Path) -> None:
    manifest = write_manifest(tmp_path / "manifest")
    home = tmp_path / "home"
    home.mkdir()
    (home / "thesis.tex").write_text("mine")
    done = CliRunner().invoke(avs3d, ["generate", str(manifest), "-o", str(home), "--audio", "analytic"])
    assert isinstance(done.exception, UsageError)
    assert str(done.exception) == (
        f"{home}: not empty and no dataset (holds 'thesis.tex'); choose another folder with -o"
    )
    assert [path.name for path in home.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("own", [(), ("dataset.json",), ("part_2",), (".avs3d-lock",), ("failures.jsonl", "README.md")])
def test_an_empty_folder_and_an_unfinished_dataset_are_taken(own: tuple[str, ...], tmp_path: Path) -> None:
    for name in own:
        (tmp_path / name).touch()
    refuse_foreign(tmp_path)
    refuse_foreign(tmp_path / "absent")


@pytest.mark.parametrize(("wrong", "meant"), [("silnt", "silent"), ("catgory", "category"), ("instnaces", "instances")])
def test_a_misspelt_field_of_an_observation_is_named_with_the_one_meant(wrong: str, meant: str, tmp_path: Path) -> None:
    import yaml

    path = write_manifest(tmp_path)
    document = yaml.safe_load(path.read_text())
    document["observations"][0][wrong] = ["oven"]
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(UsageError, match=rf"{wrong}: unknown field; did you mean '{meant}'\?"):
        read_manifest(path)


def test_assets_list_says_where_it_looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(avs3d, ["assets", "list"])
    assert isinstance(done.exception, UsageError)
    assert f"looked in {tmp_path}" in str(done.exception)
    assert "--lock FILE" in str(done.exception)


def test_doctor_says_which_option_takes_which_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AVS3D_CHECKPOINTS", raising=False)
    (finding,) = next(check for check in checks() if check.name == "checkpoints").run()
    assert set(OPTIONS) == set(CHECKPOINTS)
    runner = CliRunner()
    for kind, words in OPTIONS.items():
        assert f"{kind}/ with {words}" in (finding.fix or "")
        baseline, option = words.split()
        assert option in runner.invoke(avs3d, ["baseline", baseline, "--help"]).output.split()


def test_the_older_name_of_the_tars_is_taken_with_a_note(tmp_path: Path) -> None:
    words = ["generate", str(tmp_path / "none.yaml"), "-o", str(tmp_path / "out"), "--format", "tar"]
    done = CliRunner().invoke(avs3d, words)
    assert "--format tar is called --format webdataset" in done.output
    assert isinstance(done.exception, Avs3dError), "the option is no error, the missing manifest is"
    assert "none.yaml" in str(done.exception)
