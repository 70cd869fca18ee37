"""Every output of every command: nothing that is read, and nothing that the command has not written, is lost by it.

`OUTPUTS` has a case for each option with an output; an option without a case, or a path that is not said to be an
input, fails `test_every_path_is_an_input_or_has_a_case`.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import pytest

from avs3d_bench.cli import avs3d, main
from avs3d_bench.commands.outputs import NamedPath, OutputFile, OutputPath
from avs3d_bench.dataset import Dataset
from avs3d_bench.exports.qa.write import QaOptions, write_qa
from avs3d_bench.exports.release.write import write_release
from avs3d_bench.exports.webdataset import write_webdataset
from avs3d_bench.runtime.doctor import core_checks
from baselines.questions import write_answers
from baselines.trivial import write_trivial
from evaluators import cli as evaluator
from tests.evaluators.test_score import submit, true_mask
from tests.evaluators.test_sweep_curve import rows_of_part_2, saved
from tests.support import made_rooms, sealed_trees, tiny, tiny_listener, tiny_scenes
from tests.support.homes import write_manifest

MINE = b"somebody's only copy"


@dataclass(frozen=True)
class Case:
    """A call of a command with a place for its output.

    Attributes:
        words: the call; ``OUT`` is the output, names of the inputs stand for their paths.
        takes: of a folder, names of files in it that the command would like to write; () if the first call tells.
        reruns: whether the same call works again, and replaces what the first one wrote.
        alone: whether no call succeeds here: the command lacks a network.
        suffix: of a file.
        beside: name of the input beside or in which the output has to lie.
    """

    words: str
    takes: tuple[str, ...] = ()
    reruns: bool = True
    alone: bool = False
    suffix: str = ".json"
    beside: str = ""


_BASELINE = "--dataset data -o OUT --only part_1/*"
#: (command, option) → its case.
OUTPUTS = {
    ("validate", "json_file"): Case("validate data --json OUT"),
    ("list", "json_file"): Case("list data --json OUT"),
    ("doctor", "json_file"): Case("doctor --json OUT"),
    ("schema", "folder"): Case("schema -o OUT"),
    ("eval", "json_file"): Case("eval sub --dataset data --workers 1 --json OUT"),
    ("eval", "html_file"): Case("eval sub --dataset data --workers 1 --html OUT", suffix=".html"),
    ("eval", "frames_file"): Case("eval sub --dataset data --workers 1 --frames OUT", suffix=".csv"),
    ("check", "json_file"): Case("check sub --dataset data --workers 1 --json OUT"),
    ("verify", "json_file"): Case("verify scores.json --submission sub --dataset data --workers 1 --json OUT"),
    ("compare", "json_file"): Case("compare scores.json black.json --json OUT"),
    ("factors", "html_file"): Case("factors frames.csv --html OUT", suffix=".html"),
    ("factors", "csv_file"): Case("factors frames.csv --csv OUT", suffix=".csv"),
    ("metrics", "json_file"): Case("metrics sub sub --json OUT"),
    ("leaderboard", "folder"): Case("leaderboard scores.json black.json -o OUT"),
    ("leaderboard", "json_file"): Case("leaderboard scores.json black.json -o board --json OUT"),
    ("tables", "folder"): Case(
        "tables scores.json -o OUT", takes=("table2.md", "table2.csv", "table2.png", "table2.svg")
    ),
    ("sweep-curve", "folder"): Case("sweep-curve swept.json -o OUT"),
    ("view", "folder"): Case(
        "view data -o OUT --only part_1/* --workers 1",
        takes=("index.html", "avs3d-view.json", "assets/style.css", f"{tiny.SINGLE}/index.html", "thesis.tex"),
    ),
    ("video", "path"): Case(f"video {tiny.SINGLE} --dataset data -o OUT --size 128", suffix=".mp4"),
    ("view-3d", "path"): Case(f"view-3d {tiny.SINGLE} --dataset data --save OUT", suffix=".html"),
    ("contact-sheet", "output"): Case(
        "contact-sheet data -o OUT --only part_1/* --frames 2", takes=("part_1_tiny_kitchen_1.png",)
    ),
    ("export webdataset", "folder"): Case("export webdataset data -o OUT --workers 1"),
    ("export huggingface", "folder"): Case("export huggingface data -o OUT --workers 1"),
    ("export acoustics", "folder"): Case(
        "export acoustics manifest.yaml -o OUT --spacing 2 --sources 1 --absorption 1 --pictures 0 --workers 1"
    ),
    ("export croissant", "output"): Case("export croissant data -o OUT", beside="data"),
    ("export card", "output"): Case("export card data -o OUT", suffix=".md"),
    ("export qa", "folder"): Case("export qa scenes -o OUT"),
    ("export seld", "folder"): Case("export seld data -o OUT --format binaural --workers 1", reruns=False),
    ("export codabench", "output"): Case("export codabench seal/public seal/private -o OUT", suffix=".zip"),
    ("release", "folder"): Case("release data -o OUT --workers 1"),
    ("get", "folder"): Case("get tiny --from archives -o OUT", reruns=False),
    ("manifest sample", "output"): Case(
        "manifest sample -o OUT --homes 1 --observations 1 --seed 9 --exclude manifest.yaml", suffix=".yaml"
    ),
    ("scan", "output"): Case("scan room.glb -o OUT", suffix=".yaml", reruns=False),
    ("sweep", "output"): Case(
        "sweep manifest.yaml --over acoustics.absorption_scale=0.5,2 -o OUT", suffix=".yaml", beside="."
    ),
    ("generate", "root"): Case(
        "generate manifest.yaml -o OUT --audio analytic --workers 1",
        takes=("thesis.tex", "dataset.json", "failures.jsonl"),
    ),
    ("seal", "folder"): Case("seal manifest.yaml -o OUT", takes=("public/a", "private/b", "secret"), alone=True),
    ("assets list", "html"): Case("assets list --lock assets.lock.yaml --html OUT"),
    ("train listener", "folder"): Case(
        "train listener --data shards -o OUT --steps 1 --size small --accelerator cpu --workers 1",
        takes=("cache/a", "listener.safetensors", "model_card.json", "model_card.md", "checkpoint.pt"), alone=True,
    ),
    ("train listener", "cache"): Case(
        "train listener --data shards -o run --cache OUT --steps 1 --size small --accelerator cpu --workers 1",
        takes=("table.json", "a"), alone=True,
    ),
    ("baseline all-black", "path"): Case(f"baseline all-black {_BASELINE}", reruns=False),
    ("baseline all-white", "path"): Case(f"baseline all-white {_BASELINE}", reruns=False),
    ("baseline centre-box", "path"): Case(f"baseline centre-box {_BASELINE}", reruns=False),
    ("baseline oracle", "path"): Case(f"baseline oracle {_BASELINE} --workers 1", reruns=False),
    ("baseline references", "path"): Case(
        "baseline references --dataset scenes -o OUT --workers 1", takes=("level/submission.json", "ild.json"),
        reruns=False,
    ),
    ("baseline references", "json_file"): Case(
        "baseline references --dataset scenes -o refs --overwrite --workers 1 --json OUT"
    ),
    ("baseline listener", "path"): Case(
        f"baseline listener {_BASELINE} --weights listener.safetensors --looks one --device cpu", reruns=False
    ),
    ("baseline listener", "soft"): Case(
        "baseline listener --dataset data -o marked --overwrite --only part_1/* --weights listener.safetensors "
        "--looks one --device cpu --soft-masks OUT",
        reruns=False,
    ),
    ("baseline owod-bind", "path"): Case(f"baseline owod-bind {_BASELINE}", takes=("submission.json",), alone=True),
    ("baseline denseav", "path"): Case(f"baseline denseav {_BASELINE}", takes=("submission.json",), alone=True),
    ("baseline foundation", "path"): Case(f"baseline foundation {_BASELINE}", takes=("submission.json",), alone=True),
    ("baseline questions", "output"): Case("baseline questions --questions asked -o OUT", suffix=".jsonl"),
    ("qa-score", "json_file"): Case("qa-score answers.jsonl --questions asked --json OUT"),
    ("baseline echosegnet", "path"): Case(
        f"baseline echosegnet {_BASELINE} --masks oracle --device cpu --iterations 1", takes=("submission.json",),
        reruns=False, alone=True,
    ),
    ("baseline echosegnet", "work"): Case(
        "baseline echosegnet --dataset data -o sub --masks oracle --device cpu --iterations 1 --work OUT",
        takes=("a",), reruns=False, alone=True,
    ),
}  # fmt: skip
#: Paths that are read, or kept for the next run: no command replaces a file that it did not write there.
INPUTS = {
    "root", "manifest", "hrtf", "scans", "habitat_python", "cache", "jobqueue_options", "submission", "submissions",
    "prediction",
    "truth", "score_file", "scores", "tables", "public", "private", "image", "terms", "exclude", "secret_file", "files",
    "array", "lock", "path", "data", "weights", "listener_weights", "checkpoint", "boxes_checkpoint", "sam_checkpoint",
    "similarity_checkpoint", "folder", "verified", "index", "file", "splats", "source",
    "questions", "answers", "practice", "clap_checkpoint", "sam3_checkpoint", "grounding_dino_checkpoint",
    "sam2_checkpoint", "calibrate_on", "soft_masks", "dry",
}  # fmt: skip


def commands(group: click.Group, prefix: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, (*prefix, name))
        else:
            yield " ".join((*prefix, name)), command


def test_every_path_is_an_input_or_has_a_case() -> None:
    found = set()
    for name, command in commands(avs3d):
        for parameter in command.params:
            if isinstance(parameter.type, OutputPath):
                found.add((name, parameter.name))
            elif isinstance(parameter.type, click.Path | click.File):
                assert isinstance(parameter.type, NamedPath), f"{name}: {parameter.name} is not compared with outputs"
                assert parameter.name in INPUTS, f"{name}: say whether {parameter.name} is read or written"
                named = {*parameter.opts} & {"-o", "--output", "--json", "--html", "--csv", "--frames", "--save"}
                assert not named, f"{name}: {named} is an output by its name"
    assert found == OUTPUTS.keys()


# --- the calls


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an input of each kind."""
    place = tmp_path_factory.mktemp("inputs")
    data = tiny.write_dataset(place / "data", frames=9, size=48)
    submit(place / "sub", data, true_mask)
    tiny_scenes.write_part_3(place / "scenes", frames=9, size=48)
    write_qa(place / "scenes", place / "asked", QaOptions(kinds=("side",), per_group=1))
    write_answers("deaf", place / "asked", place / "answers.jsonl")
    write_trivial("all-black", Dataset(data), place / "black")
    for name in ("sub", "black"):
        words = [place / name, "--dataset", data, "--workers", 1, "--json", place / f"{name}.json"]
        words += ["--frames", place / "frames.csv"] if name == "sub" else []
        with pytest.raises(SystemExit) as end:
            evaluator.main([str(word) for word in words])
        assert end.value.code == 0
    (place / "sub.json").rename(place / "scores.json")
    saved(place, swept=rows_of_part_2(lambda n, scale: 0.05 * n / scale))
    write_manifest(place, camera={"size": 32, "frames": 2}).rename(place / "manifest.yaml")
    write_webdataset(data, place / "shards", workers=1)
    write_release(data, place / "archives", workers=1)
    sealed_trees.write_seal(place / "seal")
    tiny_listener.write_weights(place)
    made_rooms.write_mesh(made_rooms.flat(("living_room",)), place / "room.glb")
    (place / "assets.lock.yaml").write_text("version: 1\nassets: []\n")
    return place


@dataclass(frozen=True)
class Unreached:
    """In place of a network: what a command reads of it before the check of the output."""

    hearing: str = "own"
    masks_of: None = None
    masks: None = None
    method: str = "network"
    notes: str = ""


@pytest.fixture
def place(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """A copy of the inputs, or of those that the case names. Of networks without weights here, only the check of the
    output is reached.

    What else the doctor looks at, in processes of their own, is another test's matter.
    """
    copy_inputs(inputs, tmp_path / "in", getattr(request.node, "callspec", None))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("avs3d_bench.runtime.doctor.all_checks", core_checks)
    network = Unreached()
    monkeypatch.setattr("baselines.owod_bind.run.load_owod_bind", lambda **_: network)
    monkeypatch.setattr("baselines.denseav.load_denseav", lambda *_, **__: network)
    monkeypatch.setattr("baselines.foundation.run.load_foundation", lambda *_, **__: network)
    return tmp_path / "in"


def copy_inputs(inputs: Path, place: Path, callspec: Any) -> None:
    case = callspec.params.get("case") if callspec else None
    if case is None:
        shutil.copytree(inputs, place)
        return
    place.mkdir()
    words = {word.partition("/")[0] for word in case.words.split()}
    for path in inputs.iterdir():
        if path.name in words or (path.name == "room.glb" and "manifest.yaml" in words):
            (shutil.copytree if path.is_dir() else shutil.copy2)(path, place / path.name)


def words_of(case: Case, place: Path, out: Path) -> list[str]:
    named = {path.name: str(path) for path in place.iterdir()} | {"OUT": str(out)}
    named |= {f"seal/{side}": str(place / "seal" / side) for side in ("public", "private")}
    return [named.get(word, word) for word in case.words.split()]


def call(case: Case, place: Path, out: Path) -> int:
    """Exit code of the command; anything but an exit is a failure."""
    with pytest.raises(SystemExit) as end:
        main(words_of(case, place, out))
    return int(end.value.code or 0)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def read_by(case: Case, place: Path) -> list[Path]:
    """The inputs of a call, files and folders."""
    return [path for word in words_of(case, place, Path("OUT")) if (path := Path(word)).is_relative_to(place)]


def cases(folder: bool) -> list[object]:
    """The cases of files or of folders."""
    table = {
        (name, parameter.name): isinstance(parameter.type, OutputFile)
        for name, command in commands(avs3d)
        for parameter in command.params
        if isinstance(parameter.type, OutputPath)
    }
    return [pytest.param(OUTPUTS[one], id=" ".join(map(str, one))) for one in OUTPUTS if table[one] is not folder]


def checked(places: list[Path], case: Case, place: Path, top: Path) -> None:
    """A call with each of these outputs is refused, and every file below ``top`` has its bytes."""
    before = contents(top)
    for out in places:
        code = call(case, place, out)
        after = contents(top)
        assert {name: after.get(name) for name in before} == before, f"{case.words} with {out} lost something"
        assert code, f"{case.words} with {out} was not refused"
        assert not after.keys() - before.keys(), f"{case.words} with {out} left something"


@pytest.mark.slow
@pytest.mark.parametrize("case", cases(folder=False))
def test_a_file_takes_the_place_of_nothing_else(case: Case, place: Path, tmp_path: Path) -> None:
    outside = tmp_path / "out"
    outside.mkdir()
    targets = [path for path in read_by(case, place) if path.is_file()]
    for number, folder in enumerate(path for path in read_by(case, place) if path.is_dir()):
        targets += [folder, *[path for path in folder.iterdir() if path.is_file()]]
        if (folder / "part_1").is_dir():
            deep = next(path for path in (folder / "part_1").rglob("*") if path.is_file())
            targets += [deep, deep.with_name(f"new{case.suffix}"), folder / "part_1" / f"new{case.suffix}"]
        if (folder / "dataset.json").is_file():
            (outside / f"linked-{number}{case.suffix}").symlink_to(folder / "dataset.json")
            os.link(folder / "dataset.json", outside / f"hard-{number}{case.suffix}")
    for number, target in enumerate(path for path in read_by(case, place) if path.is_file()):
        (outside / f"link-{number}{case.suffix}").symlink_to(target)
        os.link(target, outside / f"same-{number}{case.suffix}")
    (outside / f"mine{case.suffix}").write_bytes(MINE)
    (outside / f"object{case.suffix}").write_bytes(b'{"name": "tiny", "observations": []}')
    checked([*targets, *outside.iterdir()], case, place, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("case", cases(folder=True))
def test_a_folder_of_somebody_else_keeps_its_files(case: Case, place: Path, tmp_path: Path) -> None:
    takes = case.takes
    if not takes:
        assert call(case, place, tmp_path / "first") == 0
        takes = tuple(contents(tmp_path / "first"))
        shutil.rmtree(tmp_path / "first")
    assert takes
    for name in takes:  # one at a time: the first file that is refused must not hide the second
        mine = tmp_path / "mine" / name
        mine.parent.mkdir(parents=True)
        mine.write_bytes(MINE)
        call(case, place, tmp_path / "mine")
        assert mine.read_bytes() == MINE, f"{case.words} lost {name}"
        shutil.rmtree(tmp_path / "mine")


@pytest.mark.slow
@pytest.mark.parametrize("case", cases(folder=True))
def test_a_folder_takes_the_place_of_no_input(case: Case, place: Path, tmp_path: Path) -> None:
    folders = [path for path in read_by(case, place) if path.is_dir()]
    files = [path for path in read_by(case, place) if path.is_file()]
    (tmp_path / "link").symlink_to(place / "data")
    targets = [*folders, *files, *[path / "part_1" for path in folders if (path / "part_1").is_dir()]]
    if place / "data" in folders:
        targets.append(tmp_path / "link")
    checked(targets, case, place, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [pytest.param(case, id=" ".join(name)) for name, case in OUTPUTS.items() if not case.alone]
)
def test_what_the_command_wrote_it_replaces(case: Case, place: Path, tmp_path: Path) -> None:
    out = (place / case.beside if case.beside else tmp_path) / f"new{case.suffix}"
    assert call(case, place, out) == 0
    assert out.exists()
    made = contents(tmp_path)
    again = call(case, place, out)
    assert (again == 0) is case.reruns
    if not case.reruns:
        assert contents(tmp_path) == made


# --- what the parametrised test cannot see


def other_dataset(folder: Path) -> Path:
    """Another dataset, by its name."""
    data = tiny.write_dataset(folder, frames=9, size=48, keys=(tiny.SINGLE,))
    text = (data / "dataset.json").read_text()
    (data / "dataset.json").write_text(text.replace('"name": "tiny"', '"name": "other"', 1))
    return data


@pytest.mark.parametrize("form", ["webdataset", "huggingface"])
@pytest.mark.parametrize("interrupted", [False, True])
def test_an_export_leaves_the_shards_of_another_dataset(
    form: str, interrupted: bool, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    other = other_dataset(tmp_path / "other")
    out = tmp_path / "out"
    export = Case(f"export {form} data -o OUT --workers 1")
    if interrupted:
        with monkeypatch.context() as patch:
            patch.setattr("avs3d_bench.exports.shards._index", _fail)
            with pytest.raises(RuntimeError):
                main(["export", form, str(other), "-o", str(out), "--workers", "1"])
    else:
        call(Case(f"export {form} {other} -o OUT --workers 1"), place, out)
    capsys.readouterr()
    before = contents(out)
    assert call(export, place, out) == 2
    assert {n: d for n, d in contents(out).items() if "lock" not in n} == {
        n: d for n, d in before.items() if "lock" not in n
    }
    assert f"holds an export of kind {form} of the dataset other 1; choose another folder" in capsys.readouterr().err
    assert call(Case(f"export {form} {other} -o OUT --workers 1"), place, out) == 0, "its own is completed"


def _fail(*_: object) -> None:
    raise RuntimeError


def test_a_shards_name_that_is_taken_is_refused(place: Path, tmp_path: Path) -> None:
    """An export of test frames, to which somebody added a file that an export of train frames would write."""
    out = tmp_path / "out"
    assert call(Case("export webdataset data -o OUT --split test --workers 1"), place, out) == 0
    (out / "train-000000.tar").write_bytes(MINE)
    assert call(Case("export webdataset data -o OUT --workers 1"), place, out) == 2
    assert (out / "train-000000.tar").read_bytes() == MINE


def test_two_outputs_of_one_name_are_refused(place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = Case(f"eval sub --dataset data --json OUT --html {tmp_path}/in/../out.json")
    assert call(case, place, tmp_path / "out.json") == 2
    assert "named twice" in capsys.readouterr().err
    assert not (tmp_path / "out.json").exists()


def test_files_of_scores_beside_no_leaderboard_stay(place: Path, tmp_path: Path) -> None:
    """A leaderboard's folder is recognised by its page: elsewhere reports/ may hold the only files of scores."""
    reports = tmp_path / "out" / "reports"
    reports.mkdir(parents=True)
    shutil.copy(place / "black.json", reports / "test.json")  # the name that the copy of scores.json gets
    before = contents(reports)
    assert call(Case("leaderboard scores.json -o OUT"), place, tmp_path / "out") == 2
    assert contents(reports) == before


def test_a_dataset_of_another_manifest_keeps_its_record(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The manifest has no observation of the other dataset: none would be regenerated, but dataset.json be replaced."""
    other = other_dataset(tmp_path / "other")
    before = contents(other)
    assert call(Case("generate manifest.yaml -o OUT --audio analytic --workers 1"), place, other) == 2
    assert contents(other) == before
    assert "holds the dataset 'other', the manifest is that of tiny; choose another folder" in capsys.readouterr().err


def test_a_table_of_frames_in_parquet_is_replaced_too(place: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    case = Case("eval sub --dataset data --workers 1 --frames OUT")
    assert [call(case, place, tmp_path / "frames.parquet") for _ in range(2)] == [0, 0]
