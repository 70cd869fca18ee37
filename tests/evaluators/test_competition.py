"""A competition bundle: valid by the platform's rules, scored as the platform would, and every error named."""

from __future__ import annotations

import io
import json
import os
import re
import runpy
import shutil
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from avs3d_bench import __version__
from avs3d_bench.contract.competition import MAIN_WITHOUT_TWINS, CompetitionTask, columns_of, task_protocols
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.cli import export
from avs3d_bench.exports.codabench import CompetitionSettings, has_twins, write_codabench
from avs3d_bench.exports.codabench_files import scoring_program
from avs3d_bench.exports.codabench_format import KNOWN, MOST_COLUMN, MOST_KEY, check_bundle
from avs3d_bench.formats import media
from avs3d_bench.submission import SubmissionWriter
from evaluators import check
from evaluators.competition.program import main, run
from evaluators.score import evaluate
from tests.support import codabench_worker, sealed_trees, tiny, tiny_scenes

ROOT = Path(__file__).parents[2]
TRUTH = ("semantic_masks", "instance_masks", "category_masks", "gt_3d", "stems", "observation.json")
SETTINGS = CompetitionSettings(
    title="Tiny <competition> & more",
    docker_image="someone/avs3d-evaluator:0.1.0",
    start=datetime(2027, 1, 1),
    data_url="https://example.org/data",
)


def split(full: Path, public: Path) -> Path:
    """The public tree of a dataset: all files but the truth."""
    for path in sorted(full.rglob("*")):
        relative = path.relative_to(full)
        if path.is_file() and not set(TRUTH) & set(relative.parts):
            (public / relative).parent.mkdir(parents=True, exist_ok=True)
            os.link(path, public / relative)
    return public


@pytest.fixture(scope="module")
def trees(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """(public, private) of a dataset of two observations."""
    folder = tmp_path_factory.mktemp("competition")
    private = tiny.write_dataset(folder / "private", frames=9, size=32)
    return split(private, folder / "public"), private


@pytest.fixture(scope="module")
def scene_trees(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """(public, private) of a group of part_3 observations."""
    folder = tmp_path_factory.mktemp("scenes")
    private = tiny_scenes.write_part_3(folder / "private")
    return split(private, folder / "public"), private


@pytest.fixture(scope="module")
def bundle(trees: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bundle") / "bundle.zip"
    write_codabench(*trees, path, SETTINGS)
    return path


@pytest.fixture(scope="module")
def oracle(trees: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A submission with the true masks, as an archive."""
    folder = tmp_path_factory.mktemp("oracle") / "oracle"
    write_oracle(trees[1], folder)
    return Path(shutil.make_archive(str(folder), "zip", folder))


def write_oracle(private: Path, folder: Path) -> None:
    with SubmissionWriter(folder, Dataset(private), method="oracle") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())


def environment() -> dict[str, str]:
    """Of a container that has this toolkit: its own Python first, and nothing of the caller's."""
    return {"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "PYTHONPATH": str(ROOT)}


def members(bundle: Path, name: str) -> list[str]:
    with zipfile.ZipFile(bundle) as outer, outer.open(name) as stream, zipfile.ZipFile(stream) as inner:
        return inner.namelist()


def edited(bundle: Path, target: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """A bundle whose competition.yaml was changed by hand."""
    with zipfile.ZipFile(bundle) as source, zipfile.ZipFile(target, "w") as out:
        for name in source.namelist():
            data = source.read(name)
            if name == "competition.yaml":
                form = yaml.safe_load(data)
                change(form)
                data = yaml.safe_dump(form).encode()
            out.writestr(name, data)
    return target


# The bundle


def test_a_bundle_breaks_no_rule_of_the_platform(bundle: Path) -> None:
    assert check_bundle(bundle) == ()


def test_the_rules_find_what_they_are_for(bundle: Path, tmp_path: Path) -> None:
    def column(form: dict[str, Any]) -> dict[str, Any]:
        return dict(form["leaderboards"][0]["columns"][0])

    later = {"name": "Later", "start": "2026-01-01 00:00:00", "tasks": [0], "index": 1}
    faults: list[tuple[str, Callable[[dict[str, Any]], Any]]] = [
        ("version: None, expected 2", lambda f: f.pop("version")),
        ("competition: title ''", lambda f: f.update(title="")),
        ("image 'gone.png' is not in the bundle", lambda f: f.update(image="gone.png")),
        ("image 'terms.md', expected .png", lambda f: f.update(image="terms.md")),
        ("competition: terms None is not in the bundle", lambda f: f.pop("terms")),
        ("docker_image: 'a b'", lambda f: f.update(docker_image="a b")),
        ("contact_email: 'me'", lambda f: f.update(contact_email="me")),
        ("competition.yaml: the platform ignores the key 'leaderboard'", lambda f: f.update(leaderboard=[])),
        ("pages: missing", lambda f: f.pop("pages")),
        ("pages[0]: file 'x.md' is not in the bundle", lambda f: f["pages"][0].update(file="x.md")),
        ("tasks: missing", lambda f: f.pop("tasks")),
        ("tasks: index 0 twice", lambda f: f["tasks"].append(f["tasks"][0])),
        ("tasks[0]: scoring_program None", lambda f: f["tasks"][0].pop("scoring_program")),
        ("example_submission.zip: no metadata.yaml",
         lambda f: f["tasks"][0].update(scoring_program="example_submission.zip")),
        ("tasks[0]: reference_data 'x.zip'", lambda f: f["tasks"][0].update(reference_data="x.zip")),
        ("solutions[0]: no task has the index 7", lambda f: f["solutions"][0].update(tasks=[7])),
        ("phases: missing", lambda f: f.pop("phases")),
        ("phases[0]: no tasks", lambda f: f["phases"][0].pop("tasks")),
        ("phases[0]: no task has the index 3", lambda f: f["phases"][0].update(tasks=[3])),
        ("phases[0]: start 'soon'", lambda f: f["phases"][0].update(start="soon")),
        ("phases[0]: ends 2020-01-01", lambda f: f["phases"][0].update(end="2020-01-01")),
        ("phases[0]: no end, but a phase comes after it", lambda f: f["phases"].append(later)),
        ("phases[0]: auto_migrate_to_this_phase", lambda f: f["phases"][0].update(auto_migrate_to_this_phase=True)),
        ("phases[0]: max_submissions 0", lambda f: f["phases"][0].update(max_submissions=0)),
        ("phases[0]: the platform ignores the key 'execution_time_limit_ms'",
         lambda f: f["phases"][0].update(execution_time_limit_ms=1)),
        ("leaderboards: 0, expected one", lambda f: f.pop("leaderboards")),
        ("leaderboards[0]: submission_rule 'Best'", lambda f: f["leaderboards"][0].update(submission_rule="Best")),
        ("leaderboards[0]: no columns", lambda f: f["leaderboards"][0].update(columns=[])),
        ("leaderboards[0]: key 'strict_IoU' twice", lambda f: f["leaderboards"][0]["columns"].append(column(f))),
        ("columns[0]: title", lambda f: f["leaderboards"][0]["columns"][0].update(title="x" * 37)),
        ("columns[0]: sorting 'up'", lambda f: f["leaderboards"][0]["columns"][0].update(sorting="up")),
        ("columns[0]: computation 'mode'", lambda f: f["leaderboards"][0]["columns"][0].update(computation="mode")),
        ("columns[0]: precision 11", lambda f: f["leaderboards"][0]["columns"][0].update(precision=11)),
    ]  # fmt: skip
    for expected, change in faults:
        found = check_bundle(edited(bundle, tmp_path / "edited.zip", change))
        assert any(expected in line for line in found), (expected, found)


def test_phases_that_touch_are_refused(bundle: Path, tmp_path: Path) -> None:
    def touch(form: dict[str, Any]) -> None:
        form["phases"][0]["end"] = "2027-02-01 00:00:00"
        form["phases"].append({"index": 1, "name": "Next", "start": "2027-02-01 00:00:00", "tasks": [0]})

    (line,) = check_bundle(edited(bundle, tmp_path / "edited.zip", touch))
    assert line.startswith("phases[1]: starts 2027-02-01 00:00:00, expected later than the end")


def test_what_is_no_bundle_is_named(tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no archive")
    with pytest.raises(UsageError, match="no zip archive; expected a competition bundle"):
        check_bundle(tmp_path / "text.zip")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as archive:
        archive.writestr("inside/competition.yaml", "version: 2")
    assert check_bundle(tmp_path / "empty.zip") == ("competition.yaml: missing; expected it at the root of the bundle",)


def test_the_same_trees_give_the_same_bytes(trees: tuple[Path, Path], bundle: Path, tmp_path: Path) -> None:
    write_codabench(*trees, tmp_path / "again.zip", SETTINGS)
    assert (tmp_path / "again.zip").read_bytes() == bundle.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["again.zip"]


def test_participants_get_no_truth_and_the_platform_no_pictures(trees: tuple[Path, Path], tmp_path: Path) -> None:
    public, private = trees
    bundle = tmp_path / "bundle.zip"
    write_codabench(*trees, bundle, replace(SETTINGS, data_url=None))
    assert check_bundle(bundle) == ()
    assert sorted(members(bundle, "public_data.zip")) == sorted(
        path.relative_to(public).as_posix() for path in public.rglob("*") if path.is_file()
    )
    for name in ("public_data.zip", "starting_kit.zip", "example_submission.zip"):
        assert not [member for member in members(bundle, name) if set(TRUTH) & set(member.split("/"))]
    reference = members(bundle, "reference_data.zip")
    assert not [member for member in reference if "audio" in member or "sparse" in member]
    with zipfile.ZipFile(bundle) as outer, outer.open("reference_data.zip") as stream, zipfile.ZipFile(stream) as inner:
        for key in (tiny.SINGLE, tiny.MULTI):
            picture = inner.read(f"public/{key}/input/frame_008.png")
            (tmp_path / "picture.png").write_bytes(picture)
            assert not media.read_png_mask(tmp_path / "picture.png").any()
            masks = [member for member in reference if member.startswith(f"private/{key}/semantic_masks/")]
            assert masks == [f"private/{key}/semantic_masks/frame_{i:03d}.png" for i in (0, 8)]
            assert inner.read(masks[0]) == (private / key / "semantic_masks/frame_000.png").read_bytes()


def test_columns_are_unique_short_and_ranked_by_the_main_figure() -> None:
    for parts, first in (({"part_1"}, "strict_IoU"), ({"part_3"}, "listen_twins"),
                         ({"part_2", "part_3"}, "listen_twins")):  # fmt: skip
        columns = columns_of(tuple(task_protocols(parts)))
        assert columns[0].key == first
        assert [column.key for column in columns[1:3]] == [f"{first}_low", f"{first}_high"]
        assert len({column.key for column in columns}) == len(columns)
        assert max(len(column.key) for column in columns) <= MOST_KEY
        assert max(len(column.title) for column in columns) <= MOST_COLUMN
        hidden = [column.hidden for column in columns]
        assert hidden == sorted(hidden), "hidden columns break ties after all that are shown"


def test_part_3_without_twins_are_ranked_by_all_pairs(tmp_path: Path) -> None:
    truth = Dataset(tiny_scenes.write_part_3(tmp_path, frames=9))
    first, second, both, silent, away = tiny_scenes.GROUP
    assert has_twins(truth, (first, second))
    assert not has_twins(truth, (first, silent, away, both)), "both microwaves take turns in one observation"
    assert columns_of(("listen",), MAIN_WITHOUT_TWINS)[0].key == "listen_pair_accuracy"


# Scoring


@pytest.mark.slow
def test_scored_by_the_platform_as_by_the_evaluator(
    trees: tuple[Path, Path], bundle: Path, oracle: Path, tmp_path: Path
) -> None:
    done = codabench_worker.score(bundle, oracle, tmp_path / "app", environment=environment())
    assert (done.status, done.exit_code, done.stderr) == ("Finished", 0, "")
    direct = evaluate(oracle, trees[1]).scores
    assert direct.overall.strict is not None
    assert done.scores is not None
    assert done.scores["strict_IoU"] == direct.overall.strict.IoU == 1.0
    assert direct.overall.official is not None
    assert done.scores["official_mIoU"] == pytest.approx(direct.overall.official.mIoU, abs=5e-4)
    record = json.loads((done.output / "avs3d_scores.json").read_text())
    assert record["overall"]["frames"] == 4
    assert record["dataset"]["sha256"] == direct.dataset.sha256
    keys = {c["key"] for c in codabench_worker.read_competition(bundle)["leaderboards"][0]["columns"]}
    assert set(done.scores) < keys
    assert "strict_IoU_3D" not in done.scores  # no points: a number that is not there is not sent
    assert "strict IoU: 1.000\n" in done.stdout
    assert "metadata" not in done.stdout, "the platform's own file is no finding"
    assert "Tiny &lt;competition&gt; &amp; more: Test" in done.details
    assert not [key for key in Dataset(trees[0]).keys if key in done.details + done.stdout]


def write_partial(private: Path, folder: Path) -> Path:
    """True masks without some of their pixels: figures that have many digits."""
    with SubmissionWriter(folder, Dataset(private), method="partial") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                mask = frame.mask().copy()
                mask[np.nonzero(mask)[0][:7], np.nonzero(mask)[1][:7]] = False
                writer.write_mask(frame, mask)
    return folder


def scored(bundle: Path, submission: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[int, Path]:
    """Exit status and output of the scoring program, run here on what the worker unpacks."""
    archive = Path(shutil.make_archive(str(place / "submission"), "zip", submission))
    codabench_worker.prepare(bundle, archive, place / "app")
    monkeypatch.chdir(place / "app/program")
    return run(place / "app/input", place / "app/output", place / "app/program"), place / "app/output"


def test_participants_see_three_decimals_and_organisers_all(
    trees: tuple[Path, Path], bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With ten decimals, scores that differ by one pixel would tell whether it is marked."""
    code, output = scored(bundle, write_partial(trees[1], tmp_path / "partial"), tmp_path, monkeypatch)
    assert code == 0
    shown = json.loads((output / "scores.json").read_text())
    record = json.loads((output / "avs3d_scores.json").read_text())
    exact = record["overall"]["strict"]["IoU"]
    assert shown["strict_IoU"] == round(exact, 3) != exact
    assert all(value == round(value, 3) for value in shown.values())
    assert str(exact)[:7] not in (output / "detailed_results.html").read_text()


def test_thousands_of_surplus_names_do_not_fill_the_log(
    trees: tuple[Path, Path], bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = write_partial(trees[1], tmp_path / "partial")
    for number in range(3_000):
        (folder / tiny.SINGLE / f"masks/{'surplus' * 10}_{number}.png").touch()
    code, output = scored(bundle, folder, tmp_path, monkeypatch)
    log = capsys.readouterr().err
    assert code == 1
    assert "\n… and 2,900 more errors\n" in log
    assert "3,000 errors in the submission, the first ones named above" in log
    assert len(log) < 30_000
    page = (output / "detailed_results.html").read_text()
    assert "and 2,900 more errors" in page
    assert len(page) < 50_000


@pytest.mark.slow
def test_the_example_is_a_submission_that_marks_something(
    trees: tuple[Path, Path], bundle: Path, tmp_path: Path
) -> None:
    with zipfile.ZipFile(bundle) as archive:
        (tmp_path / "sample.zip").write_bytes(archive.read("example_submission.zip"))
        with archive.open("starting_kit.zip") as stream, zipfile.ZipFile(stream) as kit:
            kit.extractall(tmp_path / "kit")
    done = codabench_worker.score(bundle, tmp_path / "sample.zip", tmp_path / "app", environment=environment())
    assert done.status == "Finished"
    assert done.scores is not None
    reference = evaluate(tmp_path / "kit/example", trees[1]).scores.references["centre_box"]["overall"].strict
    assert reference is not None
    assert reference.IoU is not None
    assert done.scores["strict_IoU"] == round(reference.IoU, 3)
    assert media.read_png_mask(tmp_path / "kit/example" / tiny.MULTI / "masks/frame_008.png").mean() == 0.25


def test_the_kit_says_how_to_install_and_where_axes_point(bundle: Path) -> None:
    with zipfile.ZipFile(bundle) as archive:
        data, evaluation = (" ".join(archive.read(name).decode().split()) for name in ("data.md", "evaluation.md"))
        with archive.open("starting_kit.zip") as stream, zipfile.ZipFile(stream) as kit:
            readme = kit.read("README.md").decode()
            names = kit.namelist()
            assert kit.read("pages/data.md") == archive.read("data.md")
    assert f"pip install avs3d-bench=={__version__}" in evaluation
    assert f"pip install avs3d-bench[baselines]=={__version__}" in readme
    for said in (
        "**Y up**",
        "positive to the **right**",
        "Channel 0 of a clip is the **left** ear",
        "(x, −y, −z) here",
    ):
        assert said in data
    assert "`points.ply` beside `masks/` is an optional 3D prediction" in evaluation
    assert "at most 2,000,000" in evaluation
    assert {"listener.ipynb", "example/submission.json"} <= {*names}
    assert not [name for name in names if name.startswith("practice/")]
    assert "practice" not in readme


@pytest.fixture(scope="module")
def practice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of other pictures, with its truth."""
    root = tmp_path_factory.mktemp("practice") / "practice"
    return tiny.write_dataset(root, frames=9, size=48)


def test_practice_data_keep_their_truth_and_share_no_picture_with_the_test(
    trees: tuple[Path, Path], practice: Path, tmp_path: Path
) -> None:
    bundle = tmp_path / "bundle.zip"
    arguments = ["codabench", *map(str, trees), "-o", str(bundle), "--practice", str(practice), "--approval"]
    arguments += ["--data-url", "https://example.org", "--install", "pip install git+https://example.org/mine"]
    result = CliRunner().invoke(export, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert codabench_worker.read_competition(bundle)["registration_auto_approve"] is False
    with zipfile.ZipFile(bundle) as archive:
        assert "pip install git+https://example.org/mine" in archive.read("evaluation.md").decode()
        with archive.open("starting_kit.zip") as stream, zipfile.ZipFile(stream) as kit:
            kit.extractall(tmp_path / "kit")
    assert evaluate(tmp_path / "kit/example", trees[1]).scores.overall.strict is not None
    assert len(Dataset(tmp_path / "kit/practice").keys) == 2
    assert evaluate_practice(tmp_path / "kit/practice", tmp_path / "oracle") == 1.0
    with pytest.raises(Avs3dError, match=r"frame_000\.png: also a picture of the test; practice on other homes"):
        write_codabench(*trees, tmp_path / "other.zip", replace(SETTINGS, practice=trees[1]))
    with pytest.raises(Avs3dError, match=r"semantic_masks.*missing; expected a practice dataset with the truth"):
        write_codabench(*trees, tmp_path / "other.zip", replace(SETTINGS, practice=trees[0]))
    with pytest.raises(UsageError, match="--install: '', expected one command line"):
        write_codabench(*trees, tmp_path / "other.zip", replace(SETTINGS, install=""))
    assert not (tmp_path / "other.zip").exists()


def evaluate_practice(root: Path, folder: Path) -> float | None:
    write_oracle(root, folder)
    overall = evaluate(folder, root).scores.overall.strict
    return None if overall is None else overall.IoU


@pytest.mark.slow
def test_the_notebook_of_the_kit_makes_a_submission_that_is_scored(
    trees: tuple[Path, Path], practice: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="the listener needs torch, of the [baselines] extra")
    nbformat = pytest.importorskip("nbformat", reason="notebooks are run with nbclient, of the [dev] extra")
    nbclient = pytest.importorskip("nbclient", reason="notebooks are run with nbclient, of the [dev] extra")
    pytest.importorskip("ipykernel", reason="notebooks are run in ipykernel, of the [dev] extra")
    bundle, kit = tmp_path / "bundle.zip", tmp_path / "kit"
    write_codabench(*trees, bundle, replace(SETTINGS, practice=practice))
    with zipfile.ZipFile(bundle) as archive, archive.open("starting_kit.zip") as stream:
        zipfile.ZipFile(stream).extractall(kit)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("AVS3D_DATA", str(trees[0]))
    notebook = nbformat.read(kit / "listener.ipynb", as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(kit)}}
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    said = "".join(output["text"] for output in outputs if output.get("name") == "stdout")
    assert re.search(r"the ear on the side of the source is the louder one in (\d+) of \1 frames", said), said
    assert "upload my-submission.zip" in said
    done = codabench_worker.score(bundle, kit / "my-submission.zip", tmp_path / "app", environment=environment())
    assert done.status == "Finished"


def test_participants_check_without_the_truth(trees: tuple[Path, Path], oracle: Path) -> None:
    report = check(oracle, trees[0], workers=1)
    assert (report.valid, report.problems) == (True, ())


# Hostile submissions


def hostile(folder: Path, name: str, content: bytes, *, link: bool = False) -> Path:
    """An archive with one strange member, which the worker unpacks before the scoring program sees it."""
    path = folder / "hostile.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("submission.json", json.dumps({"method": "m", "dataset": "tiny", "dataset_version": "1"}))
        info = zipfile.ZipInfo(name)
        info.compress_type = zipfile.ZIP_DEFLATED
        info.external_attr = (0o120777 if link else 0o644) << 16
        archive.writestr(info, content)
    return path


def png_bomb(side: int) -> bytes:
    """A grey PNG of side² pixels in a few kilobytes."""
    import struct
    import zlib

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(side + 1)) for _ in range(side)) + packer.flush()

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def refused(bundle: Path, archive: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scoring program finds errors in what the worker unpacks, scores nothing, and takes little time and memory."""
    codabench_worker.prepare(bundle, archive, place / "app")
    monkeypatch.chdir(place / "app/program")
    tracemalloc.start()
    try:
        code = run(place / "app/input", place / "app/output", place / "app/program")
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()
    assert code == 1
    assert not (place / "app/output/scores.json").exists()


MASK = f"{tiny.SINGLE}/masks/frame_000.png"
TRUTH_BESIDE = f"../../../../../../ref/private/{tiny.SINGLE}/semantic_masks/frame_000.png"


def test_a_link_in_an_archive_is_a_damaged_mask(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The worker unpacks a link as a file that holds its target."""
    refused(bundle, hostile(tmp_path, MASK, TRUTH_BESIDE.encode(), link=True), tmp_path, monkeypatch)
    assert f"error: {MASK}: " in capsys.readouterr().err
    assert not (tmp_path / "app/input/res" / MASK).is_symlink()


@pytest.mark.parametrize("where", ["mask", "folder", "submission"])
def test_links_that_another_platform_unpacks_lead_nowhere(
    trees: tuple[Path, Path], bundle: Path, oracle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], where: str,
) -> None:  # fmt: skip
    codabench_worker.prepare(bundle, oracle, tmp_path / "app")
    res = tmp_path / "app/input/res"
    target = {"mask": res / MASK, "folder": (res / MASK).parent, "submission": res}[where]
    if where == "mask":
        target.unlink()
        target.symlink_to(os.path.relpath(trees[1] / tiny.SINGLE / "semantic_masks/frame_000.png", target.parent))
    elif where == "folder":
        shutil.rmtree(target)
        target.symlink_to(trees[1] / tiny.SINGLE / "semantic_masks")
    else:
        shutil.move(res, tmp_path / "elsewhere")
        res.mkdir()
        (res / "mine").symlink_to(tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path / "app/program")
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path / "app/input"), str(tmp_path / "app/output")])
    assert ended.value.code in (1, 2)
    said = capsys.readouterr().err
    assert "a link" in said or "no submission" in said
    assert not (tmp_path / "app/output/scores.json").exists()


def test_a_picture_bomb_is_refused_by_its_header(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(bundle, hostile(tmp_path, MASK, png_bomb(8_000)), tmp_path, monkeypatch)
    assert re.search(rf"error: {MASK}: .*8000.*", capsys.readouterr().err.replace(",", ""))


def test_an_archive_bomb_in_an_archive_is_not_unpacked(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The worker unpacks the outer archive, the scoring program the inner one, after a look at its list."""
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("submission.json", "{}")
        with archive.open(MASK, "w") as out:
            for _ in range(30):
                out.write(bytes(10**6))
    outer = tmp_path / "outer.zip"
    with zipfile.ZipFile(outer, "w") as archive:
        archive.writestr("inner.zip", inner.getvalue())
    refused(bundle, outer, tmp_path, monkeypatch)
    assert "an archive bomb" in capsys.readouterr().err


def test_paths_out_of_the_archive_stay_in_it(bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refused(bundle, hostile(tmp_path, "../../output/scores.json", b'{"strict_IoU": 1.0}'), tmp_path, monkeypatch)


def test_a_submission_with_a_program_is_not_taken_as_results(bundle: Path, oracle: Path, tmp_path: Path) -> None:
    """The worker looks for a command in metadata.yaml: without one it hands on nothing."""
    shutil.unpack_archive(oracle, tmp_path / "mine")
    (tmp_path / "mine/metadata.yaml").write_text("description: my masks\n")
    mine = Path(shutil.make_archive(str(tmp_path / "mine"), "zip", tmp_path / "mine"))
    with pytest.raises(codabench_worker.NoResultsError, match="metadata"):
        codabench_worker.prepare(bundle, mine, tmp_path / "app")


@pytest.mark.slow
def test_every_bad_file_is_named_and_nothing_is_scored(bundle: Path, oracle: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bad"
    shutil.unpack_archive(oracle, folder)
    missing, broken = (f"{key}/masks/frame_008.png" for key in (tiny.SINGLE, tiny.MULTI))
    (folder / missing).unlink()
    (folder / broken).write_bytes(b"no picture")
    media.write_png_mask(folder / tiny.SINGLE / "masks/frame_000.png", [[True]])
    (folder / "part_1/tiny/kitchen/9/masks").mkdir(parents=True)
    bad = Path(shutil.make_archive(str(folder), "zip", folder))
    done = codabench_worker.score(bundle, bad, tmp_path / "app", environment=environment())
    assert (done.status, done.exit_code, done.scores) == ("Failed", 1, None)
    for name in (missing, broken, f"{tiny.SINGLE}/masks/frame_000.png", "part_1/tiny/kitchen/9"):
        assert f"error: {name}: " in done.stderr
        assert name in done.details
    assert "scoring: error: 4 errors in the submission, named above; no score" in done.stderr


@pytest.mark.slow
def test_a_submission_one_folder_down_is_found(bundle: Path, oracle: Path, tmp_path: Path) -> None:
    shutil.unpack_archive(oracle, tmp_path / "outer/mine")
    down = Path(shutil.make_archive(str(tmp_path / "down"), "zip", tmp_path / "outer"))
    done = codabench_worker.score(bundle, down, tmp_path / "app", environment=environment())
    assert (done.status, "the submission lies in mine" in done.stdout) == ("Finished", True)


@pytest.mark.slow
def test_causes_are_named_in_one_line(bundle: Path, oracle: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "text.zip", "w") as archive:
        archive.writestr("notes.txt", "hello")
    done = codabench_worker.score(bundle, tmp_path / "text.zip", tmp_path / "a", environment=environment())
    line = done.stderr.splitlines()[0]
    assert line.startswith("scoring: error: ")
    assert "no submission; expected submission.json and part_1" in line
    assert done.exit_code == 2
    # An image without the toolkit: another interpreter that sees no packages.
    bare = tmp_path / "bin"
    bare.mkdir()
    (bare / "python3").write_text(f'#!/bin/sh\nexec "{os.path.realpath(sys.executable)}" -I -S "$@"\n')
    (bare / "python3").chmod(0o755)
    done = codabench_worker.score(bundle, oracle, tmp_path / "b", environment={"PATH": f"{bare}:/usr/bin:/bin"})
    assert done.exit_code == 1
    assert "No module named 'evaluators'; expected avs3d-bench " in done.stderr


@pytest.mark.slow
def test_another_protocol_version_is_refused(bundle: Path, oracle: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(bundle) as outer, outer.open("scoring_program_0.zip") as stream:
        task = CompetitionTask.model_validate_json(zipfile.ZipFile(io.BytesIO(stream.read())).read("competition.json"))
    old = scoring_program(task.model_copy(update={"protocols": {**task.protocols, "strict": "9.9"}}))
    with zipfile.ZipFile(bundle) as source, zipfile.ZipFile(tmp_path / "old.zip", "w") as out:
        for name in source.namelist():
            out.writestr(name, old if name == "scoring_program_0.zip" else source.read(name))
    done = codabench_worker.score(tmp_path / "old.zip", oracle, tmp_path / "app", environment=environment())
    assert "scoring: error: protocol strict 1.0 in this image, expected 9.9" in done.stderr
    assert done.scores is None


@pytest.mark.slow
def test_part_3_are_ranked_by_pairs(scene_trees: tuple[Path, Path], tmp_path: Path) -> None:
    write_codabench(*scene_trees, tmp_path / "bundle.zip", SETTINGS)
    assert check_bundle(tmp_path / "bundle.zip") == ()
    write_oracle(scene_trees[1], tmp_path / "oracle")
    oracle = Path(shutil.make_archive(str(tmp_path / "oracle"), "zip", tmp_path / "oracle"))
    done = codabench_worker.score(tmp_path / "bundle.zip", oracle, tmp_path / "app", environment=environment())
    assert done.scores is not None
    assert done.scores["listen_pair_accuracy"] == 1.0
    assert done.scores["listen_twins"] == 1.0
    assert "part_3" in zipfile.ZipFile(tmp_path / "bundle.zip").read("overview.md").decode()


def test_processes_that_import_the_scoring_program_start_nothing(bundle: Path, tmp_path: Path) -> None:
    with (
        zipfile.ZipFile(bundle) as outer,
        outer.open("scoring_program_0.zip") as stream,
        zipfile.ZipFile(stream) as inner,
    ):
        inner.extractall(tmp_path)
    found = runpy.run_path(str(tmp_path / "scoring.py"), run_name="__mp_main__")
    assert "main" not in found


# Phases


@pytest.fixture(scope="module")
def two_phases(trees: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("phases") / "bundle.zip"
    arguments = [
        "codabench", *map(str, trees), "-o", str(path), "--title", "Two", "--docker-image", "a/b:1",
        "--start", "2027-01-01", "--development", "part_1/*", "--final-start", "2027-03-01 12:00:00",
        "--end", "2027-04-01", "--data-url", "https://example.org/data", "--contact", "me@example.org",
        "--max-submissions", "3",
    ]  # fmt: skip
    result = CliRunner().invoke(export, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[:4] == [
        "Development: 1 observations, 2 masks",
        "  from 2027-01-01 00:00:00 UTC to 2027-03-01 11:59:59 UTC",
        "Final: 1 observations, 2 masks",
        "  from 2027-03-01 12:00:00 UTC to 2027-04-01 23:59:59 UTC",
    ]
    return path


@pytest.mark.slow
def test_phases_follow_each_other_and_score_their_own(two_phases: Path, oracle: Path, tmp_path: Path) -> None:
    assert check_bundle(two_phases) == ()
    form = codabench_worker.read_competition(two_phases)
    first, final = form["phases"]
    assert (first["end"], final["start"]) == ("2027-03-01 11:59:59", "2027-03-01 12:00:00")
    assert (first["tasks"], final["tasks"], final["max_submissions"]) == ([0], [1], 3)
    assert "public_data" not in final
    assert "https://example.org/data" in zipfile.ZipFile(two_phases).read("data.md").decode()
    for task, key in ((0, tiny.SINGLE), (1, tiny.MULTI)):
        app = tmp_path / f"app{task}"
        done = codabench_worker.score(two_phases, oracle, app, environment=environment(), task=task)
        assert done.scores is not None
        record = json.loads((done.output / "avs3d_scores.json").read_text())
        assert [one["key"] for one in record["observations"]] == [key]


@pytest.mark.parametrize(
    ("given", "end"),
    [
        ("2027-12-24", "2027-12-24 23:59:59"),
        ("2027-12-24 00:00:00", "2027-12-24 00:00:00"),
        ("2027-12-24 18:00:00Z", "2027-12-24 18:00:00"),
        ("2027-12-24 18:00:00+02:00", "2027-12-24 16:00:00"),
    ],
)
def test_an_end_without_a_time_is_the_end_of_that_day(
    trees: tuple[Path, Path], tmp_path: Path, given: str, end: str
) -> None:
    path = tmp_path / "bundle.zip"
    dates = ["--start", "2027-12-01", "--end", given]
    result = CliRunner().invoke(export, ["codabench", *map(str, trees), "-o", str(path), *dates])
    assert result.exit_code == 0, result.output
    assert f"from 2027-12-01 00:00:00 UTC to {end} UTC" in result.output
    assert codabench_worker.read_competition(path)["phases"][0]["end"] == end
    with zipfile.ZipFile(path) as archive:
        assert f"| 2027-12-01 00:00 | {end[:-3]} |" in archive.read("overview.md").decode()


def test_the_pages_say_of_intervals_what_the_leaderboard_says(bundle: Path) -> None:
    """Methods are compared in pairs: overlapping intervals do not make their order meaningless."""
    with zipfile.ZipFile(bundle) as archive:
        page = " ".join(archive.read("evaluation.md").decode().split())
    assert "belongs to one method and does not compare two" in page
    assert "the order of their rows says little" not in page


def test_a_bundle_needs_no_more_than_two_trees(trees: tuple[Path, Path], tmp_path: Path) -> None:
    path = tmp_path / "bundle.zip"
    result = CliRunner().invoke(export, ["codabench", *map(str, trees), "-o", str(path)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert f"image: avs3d-evaluator:{__version__}, which" in result.output
    form = codabench_worker.read_competition(path)
    assert form["title"] == Dataset(trees[0]).name
    start = datetime.fromisoformat(form["phases"][0]["start"])
    assert (start.hour, start.minute) == (0, 0)
    assert abs((datetime.now(UTC).replace(tzinfo=None) - start).total_seconds()) < 2 * 86400


# Bad input


def test_bad_settings_are_named(trees: tuple[Path, Path], tmp_path: Path) -> None:
    def fails(message: str, **changes: Any) -> None:
        with pytest.raises(Avs3dError, match=message):
            write_codabench(*trees, tmp_path / "bundle.zip", replace(SETTINGS, **changes))
        assert not list(tmp_path.iterdir())

    fails("--title: 257 characters", title="x" * 257)
    fails("--docker-image: 'python', expected name:tag", docker_image="python")
    fails("belong together", development=("part_1/*",))
    fails("in this order", end=datetime(2026, 1, 1))
    final = {"final_start": datetime(2027, 2, 1)}
    fails("matches no observation", development=("part_9/*",), **final)
    fails("matches every observation", development=("*",), **final)
    fails("in this order", development=("part_1/*",), final_start=datetime(2026, 2, 1))
    fails("--image: logo.gif, expected one of .png", image=Path("logo.gif"))
    fails("terms.md: missing", terms=tmp_path / "terms.md")
    fails("contact_email: 'nobody', expected an address", contact="nobody")


def test_a_group_stays_in_one_phase(scene_trees: tuple[Path, Path], tmp_path: Path) -> None:
    settings = replace(SETTINGS, development=(tiny_scenes.FIRST,), final_start=datetime(2027, 2, 1))
    with pytest.raises(UsageError, match="the siblings of part_3/tiny/kitchen/1 would be in two phases"):
        write_codabench(*scene_trees, tmp_path / "bundle.zip", settings)


def test_truth_in_the_public_tree_is_refused(trees: tuple[Path, Path], tmp_path: Path) -> None:
    public, private = trees
    with pytest.raises(Avs3dError, match=r"observation\.json: tells the truth; expected none in the public tree"):
        write_codabench(private, private, tmp_path / "bundle.zip", SETTINGS)
    leaky = tiny.clone(public, tmp_path / "leaky")
    mask = leaky / tiny.SINGLE / "semantic_masks/frame_001.png"
    tiny.replace(mask, (private / tiny.SINGLE / "semantic_masks/frame_001.png").read_bytes())
    write_codabench(leaky, private, tmp_path / "train.zip", SETTINGS)  # the truth of a train frame may be published
    mask.rename(mask.with_name("frame_008.png"))
    with pytest.raises(Avs3dError, match=r"frame_008.png: the truth of a test frame"):
        write_codabench(leaky, private, tmp_path / "bundle.zip", SETTINGS)


@pytest.mark.slow
def test_the_truth_of_another_seal_is_refused(tmp_path: Path) -> None:
    first = sealed_trees.write_seal(tmp_path / "first")
    second = sealed_trees.write_seal(tmp_path / "second", bytes(32))
    with pytest.raises(UsageError, match="private: the truth of another seal"):
        write_codabench(first / "public", second / "private", tmp_path / "bundle.zip", SETTINGS)
    write_codabench(first / "public", first / "private", tmp_path / "bundle.zip", replace(SETTINGS, data_url=None))
    with zipfile.ZipFile(tmp_path / "bundle.zip") as archive:
        assert "`seal.json` commits the organisers" in archive.read("data.md").decode()
    assert "public/seal.json" in members(tmp_path / "bundle.zip", "reference_data.zip")
    published = members(tmp_path / "bundle.zip", "public_data.zip")
    assert not [name for name in published if "opening" in name or "manifest" in name or "secret" in name]
    key = Dataset(first / "public").keys[0]
    mask = first / "private" / key / "semantic_masks/frame_008.png"
    tiny.replace(mask, (first / "private" / key / "semantic_masks/frame_000.png").read_bytes() + b" ")
    with pytest.raises(Avs3dError, match=r"frame_008\.png: not what seal.json commits to"):
        write_codabench(first / "public", first / "private", tmp_path / "other.zip", SETTINGS)
    assert not (tmp_path / "other.zip").exists()


def test_truth_that_is_missing_or_of_another_dataset_is_named(trees: tuple[Path, Path], tmp_path: Path) -> None:
    public, private = trees
    other = tiny.clone(private, tmp_path / "other")
    (other / tiny.MULTI / "semantic_masks/frame_008.png").unlink()
    with pytest.raises(Avs3dError, match=r"semantic_masks/frame_008.png: missing; expected the truth of every test"):
        write_codabench(public, other, tmp_path / "bundle.zip", SETTINGS)
    data = media.read_json(private / "dataset.json")
    tiny.write_sealed(other, {**data, "version": "2"})
    with pytest.raises(Avs3dError, match="truth of tiny 2, expected that of tiny 1"):
        write_codabench(public, other, tmp_path / "bundle.zip", SETTINGS)


def test_the_keys_that_the_rules_know_are_written_once() -> None:
    for kind, text in KNOWN.items():
        keys = text.split()
        assert len(set(keys)) == len(keys), kind
