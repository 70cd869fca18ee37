"""Files of scores say where they come from; `avs3d verify` finds every value that scoring again does not confirm."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.cli import run
from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import Scores
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import dump_json, read_json, sha256_bytes, write_json
from evaluators.cli import verify as verify_command
from evaluators.reading import origin
from evaluators.reading.submission import open_submission
from evaluators.reporting.leaderboard import write_leaderboard
from evaluators.reporting.report import write_report
from evaluators.reporting.report_check import read_report
from evaluators.score import evaluate
from evaluators.verify import Verification, compare_scores, compare_values, verify
from tests.support import tiny, tiny_scenes
from tests.support.score_examples import example_scores
from tests.support.shared import SharedDataset

FRAMES = 17  # three test frames: 0, 8 and 16
OTHER = "0" * 64


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=FRAMES, size=32)


def submit(folder: Path, root: Path, *, masks: str = layout.SUBMISSION_MASKS, points: bool = False) -> Path:
    """The truth, moved by two pixels."""
    dataset = Dataset(root)
    if masks == layout.SUBMISSION_MASKS:
        said = {"method": "test", "dataset": dataset.name, "dataset_version": "1"}
        media.write_json(folder / layout.SUBMISSION_JSON, said)
    for observation in dataset:
        for frame in observation.test:
            mask = np.roll(frame.mask(), 2, axis=1)
            media.write_png_mask(folder / observation.key / masks / f"{frame.name}.png", mask)
        if points:
            media.write_ply_points(folder / observation.key / layout.SUBMISSION_POINTS, observation.mesh().vertices)
    return folder


@pytest.fixture(scope="module")
def submission(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return submit(tmp_path_factory.mktemp("submission") / "s", data, points=True)


@pytest.fixture(scope="module")
def scores(data: Path, submission: Path) -> Scores:
    return evaluate(submission, data).scores


@pytest.fixture
def score_file(scores: Scores, tmp_path: Path) -> Path:
    write_json(tmp_path / "scores.json", scores)
    return tmp_path / "scores.json"


def places(value: Any, *path: str | int) -> Iterator[tuple[str | int, ...]]:
    """The path to every value of a JSON document that is neither object nor list."""
    if isinstance(value, dict | list):
        for step, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(inner, *path, step)
    else:
        yield path


def change(document: Any, path: tuple[str | int, ...], value: Any) -> Any:
    """Replace a value; returns what it was."""
    *steps, last = path
    for step in steps:
        document = document[step]
    before, document[last] = document[last], value
    return before


def another(value: Any) -> Any:
    """A value that differs a little."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + (1 if isinstance(value, int) else 1e-6)
    return 0.5 if value is None else f"{value}0"


def where_of(found: Verification) -> list[str]:
    return [difference.where for difference in found.differences]


def test_the_scores_themselves_are_confirmed(score_file: Path, submission: Path, data: Path) -> None:
    found = verify(score_file, submission, data)
    assert found.same
    assert found.notes == ()
    assert found.values > 200
    assert found.summary == f"same: {found.values:,} values of 2 observations confirmed"


def test_every_value_of_a_file_is_compared(scores: Scores) -> None:
    """Each value of the file in turn is replaced: software and machine become a note, anything else a difference."""
    document, altered = json.loads(dump_json(scores)), json.loads(dump_json(scores))
    free = ("avs3d_eval.version", "avs3d_eval.provenance", "avs3d_eval.machine", "report")
    paths = list(places(document))
    assert len(paths) > 200
    for path in paths:
        name = ".".join(map(str, path))
        value = change(altered, path, None)
        change(altered, path, another(value))
        found = [one for one in compare_values(altered, document, free) if one is not None]
        assert bool(found) != name.startswith(free), name
        change(altered, path, value)
    assert altered == document


def test_every_value_that_is_missing_or_added_is_found(scores: Scores) -> None:
    document, altered = json.loads(dump_json(scores)), json.loads(dump_json(scores))
    del altered["parts"]["part_1"]["strict"]["IoU"], altered["observations"][1]
    found = [str(one) for one in compare_values(altered, document, ()) if one is not None]
    assert found == [
        f"observations[{tiny.MULTI}]: missing in the file, present when scored again",
        f"parts.part_1.strict.IoU: missing in the file, {document['parts']['part_1']['strict']['IoU']:.9g} when scored "
        "again",
    ]
    twice = {**document, "observations": [*document["observations"], document["observations"][0]]}
    assert [one.where for one in compare_values(twice, document, ()) if one is not None] == [
        f"observations[{tiny.SINGLE}, entry 2]"
    ]


def test_figures_that_differ_by_rounding_are_the_same(scores: Scores) -> None:
    near = json.loads(dump_json(scores))
    value = near["overall"]["strict"]["IoU"]
    near["overall"]["strict"]["IoU"] = value * (1 + 1e-9)
    assert compare_scores(Scores.model_validate(near), scores).same
    near["overall"]["strict"]["IoU"] = value * (1 + 1e-7)
    assert where_of(compare_scores(Scores.model_validate(near), scores)) == ["overall.strict.IoU"]


def test_a_better_figure_is_named_with_both_values(scores: Scores, score_file: Path, submission: Path, data: Path):
    document = read_json(score_file)
    truth = document["observations"][1]["strict"]["IoU"]
    document["observations"][1]["strict"]["IoU"] = 0.99
    score_file.write_text(json.dumps(document))
    found = CliRunner().invoke(
        verify_command, [str(score_file), "--submission", str(submission), "--dataset", str(data)]
    )
    assert found.exit_code == 1
    assert found.output.splitlines() == [
        f"observations[{tiny.MULTI}].strict.IoU: 0.99 in the file, {truth:.9g} when scored again",
        f"{score_file}: {verify(score_file, submission, data).summary}",
    ]


def test_a_mask_that_changed_after_scoring_is_found_in_its_observation(
    score_file: Path, submission: Path, data: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(submission, tmp_path / "copy")
    path = copy / tiny.SINGLE / "masks" / "frame_000.png"
    mask = media.read_png_mask(path)
    mask[:2] = True
    media.write_png_mask(path, mask)
    found = where_of(verify(score_file, copy, data))
    assert found[0] == "submission.digest"
    assert found[1] == f"observations[{tiny.SINGLE}].digests.predictions"
    assert f"observations[{tiny.SINGLE}].strict.IoU" in found
    assert "overall.official.mIoU" in found
    assert not any(tiny.MULTI in where or "truth" in where for where in found)


def test_other_bytes_of_the_same_mask_have_another_digest_and_the_same_figures(
    score_file: Path, submission: Path, data: Path, tmp_path: Path
) -> None:
    import cv2

    copy = shutil.copytree(submission, tmp_path / "copy")
    path = copy / tiny.MULTI / "masks" / "frame_008.png"
    pixels = media.read_png_mask(path).astype(np.uint8) * 255
    before = path.read_bytes()
    path.write_bytes(cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())
    assert path.read_bytes() != before
    expected = ["submission.digest", f"observations[{tiny.MULTI}].digests.predictions"]
    assert where_of(verify(score_file, copy, data)) == expected


@pytest.mark.parametrize("folder", [layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS])
def test_another_truth_is_found(score_file: Path, submission: Path, data: Path, tmp_path: Path, folder: str) -> None:
    root = tiny.clone(data, tmp_path / "copy")
    path = root / tiny.MULTI / folder / "frame_000.png"
    pixels = media.read_png_ids(path)
    pixels[0, 0] = 255 if folder == layout.SEMANTIC_MASKS else 2
    tiny.replace(path, b"")
    media.write_png_ids(path, pixels.astype(np.uint8))
    found = where_of(verify(score_file, submission, root))
    assert found[:1] == ["dataset.truth_digest"]
    assert f"observations[{tiny.MULTI}].digests.truth" in found
    assert not any("predictions" in where or "submission" in where for where in found)


def test_another_dataset_json_is_found(score_file: Path, submission: Path, data: Path, tmp_path: Path) -> None:
    root = tiny.clone(data, tmp_path / "copy")
    path = root / layout.DATASET_JSON
    tiny.replace(path, path.read_bytes() + b"\n")
    assert where_of(verify(score_file, submission, root)) == ["dataset.sha256"]


def test_observations_that_the_dataset_lacks_are_named(
    score_file: Path, submission: Path, data: Path, tmp_path: Path
) -> None:
    root = tiny.clone(data, tmp_path / "copy")
    shutil.rmtree(root / "part_2")
    other = shutil.copytree(submission, tmp_path / "other")
    shutil.rmtree(other / "part_2")
    found = verify(score_file, other, root)
    assert str(found.differences[0]) == (
        f"observations[{tiny.MULTI}]: scored in the file, no such observation when scored again"
    )
    assert "parts.part_2" in where_of(found)
    write_json(tmp_path / "none.json", example_scores(4))
    assert len(verify(tmp_path / "none.json", other, root).differences) == 4


def test_a_part_of_the_observations_is_scored_again_as_a_part(submission: Path, data: Path, tmp_path: Path) -> None:
    part = evaluate(submission, data, only=["part_1/*"], protocols=["strict"]).scores
    write_json(tmp_path / "part.json", part)
    found = verify(tmp_path / "part.json", submission, data)
    assert found.same
    assert found.notes == ("1 of the 2 observations were scored",)


def test_intervals_of_older_versions_are_not_compared(
    score_file: Path, submission: Path, data: Path, tmp_path: Path
) -> None:
    document = media.read_json(score_file)
    document["overall"]["strict"]["intervals"] = {"IoU": [0.0, 1.0]}
    media.write_json(tmp_path / "edited.json", document)
    assert where_of(verify(tmp_path / "edited.json", submission, data)) == ["overall.strict.intervals.IoU"]
    del document["avs3d_eval"]["bootstrap_unit"]
    media.write_json(tmp_path / "older.json", document)
    found = verify(tmp_path / "older.json", submission, data)
    assert found.same
    assert any("do not resample homes: they are not compared" in note for note in found.notes)


def test_the_digest_is_that_of_sha256sum(scores: Scores, submission: Path) -> None:
    """The commands of docs/scores-file.md, on the folder of the submission."""
    script = (
        "export LC_ALL=C; for key in part_*/*/*/*; do "
        "echo \"$(find $key -type f | sort | xargs sha256sum | sha256sum | cut -d ' ' -f 1)  $key\"; done | sha256sum"
    )
    found = subprocess.run(["bash", "-c", script], cwd=submission, capture_output=True, text=True, check=True)
    assert found.stdout.split()[0] == scores.submission.digest


def test_the_digest_of_the_truth_is_over_every_file_that_tells_it(scores: Scores, data: Path) -> None:
    lines = []
    for key in (tiny.MULTI, tiny.SINGLE):
        names = [f"{f}/frame_0{n}.png" for f in ("instance_masks", "semantic_masks") for n in ("00", "08", "16")]
        names = sorted([*names, "gt_3d/sounding_object.ply", "observation.json"])
        text = "".join(f"{sha256_bytes((data / key / name).read_bytes())}  {key}/{name}\n" for name in names)
        lines.append(f"{hashlib.sha256(text.encode()).hexdigest()}  {key}\n")
    assert scores.dataset.truth_digest == sha256_bytes("".join(sorted(lines, key=lambda x: x[66:])).encode())


def test_digests_depend_on_neither_protocol_nor_packing_nor_workers(
    scores: Scores, submission: Path, data: Path, tmp_path: Path
) -> None:
    packed = tmp_path / "s.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for path in sorted(submission.rglob("*")):
            archive.write(path, path.relative_to(submission))
    found = evaluate(packed, data, protocols=["official"]).scores
    assert found.submission.digest == scores.submission.digest
    assert found.dataset.truth_digest == scores.dataset.truth_digest


def test_the_released_pipelines_folders_are_confirmed(data: Path, tmp_path: Path) -> None:
    release = tiny.write_release(tmp_path / "release", frames=FRAMES, size=32)
    folder = submit(tmp_path / "one", release, masks=layout.RELEASED_MASKS[1])
    submit(folder, release, masks=layout.RELEASED_MASKS[0])
    write_json(tmp_path / "scores.json", evaluate(folder, release, aisrm=False).scores)
    moved = folder.rename(tmp_path / "another name")
    assert verify(tmp_path / "scores.json", moved, release).same


def test_part_3_are_confirmed(tmp_path: Path) -> None:
    root = tiny_scenes.write_part_3(tmp_path / "data", frames=FRAMES, size=32)
    submission = submit(tmp_path / "s", root)
    write_json(tmp_path / "scores.json", evaluate(submission, root).scores)
    found = verify(tmp_path / "scores.json", submission, root)
    assert found.same
    document = read_json(tmp_path / "scores.json")
    assert document["siblings"][0]["pairs"]
    assert all("digests" in one for one in document["observations"])
    document["siblings"][0]["pairs"][0]["frames"] += 1
    write_json(tmp_path / "scores.json", document)
    (where,) = where_of(verify(tmp_path / "scores.json", submission, root))
    pair = document["siblings"][0]["pairs"][0]
    assert where == f"siblings[{document['siblings'][0]['group']}].pairs[{pair['first']} and {pair['second']}].frames"


def test_a_file_of_an_older_version_is_compared_by_its_figures(
    scores: Scores, submission: Path, data: Path, tmp_path: Path
) -> None:
    document = json.loads(dump_json(scores))
    for one in document["observations"]:
        del one["digests"]
    del document["submission"]["digest"], document["dataset"]["truth_digest"]
    del document["avs3d_eval"]["machine"], document["avs3d_eval"]["provenance"]
    path = tmp_path / "old.json"
    write_json(path, document)
    found = verify(path, submission, data)
    assert found.same
    assert [note.split(":")[0] for note in found.notes] == [
        "the file has no digests of submission and truth", "the file does not name the software that wrote it",
    ]  # fmt: skip
    assert json.loads(dump_json(Scores.model_validate(document))) == document


def test_other_software_and_another_machine_are_notes(scores: Scores) -> None:
    document = json.loads(dump_json(scores))
    machine = document["avs3d_eval"]["machine"]
    machine |= {"platform": "Plan9 sparc", "cores": 1}
    made_by = document["avs3d_eval"]["provenance"]
    libraries = made_by["libraries"] | {"numpy": "1.0"}
    sources = origin_sources()
    made_by["libraries"] = libraries
    made_by["digest"] = sources(libraries, made_by["python"])
    found = compare_scores(Scores.model_validate(document), scores)
    assert found.same
    installed = scores.avs3d_eval.provenance.libraries["numpy"]
    assert found.notes[0] == f"other versions: numpy 1.0 in the file, {installed} here"
    assert found.notes[1].startswith("scored on Plan9 sparc, CPython ")
    assert ", 1 core; again on " in found.notes[1]
    made_by["digest"] = OTHER
    first, *_ = compare_scores(Scores.model_validate(document), scores).notes
    assert first.startswith(f"the evaluator has other sources: digest {OTHER[:12]} (version ")


def origin_sources() -> Any:
    """Libraries, Python → the digest of this evaluator's sources with them."""
    from avs3d_bench.runtime.provenance import Provenance, provenance

    return lambda libraries, python: Provenance(provenance("scores").sources, libraries, python).digest


def test_the_machine_is_named_without_host_or_user(scores: Scores) -> None:
    import getpass
    import platform

    machine = scores.avs3d_eval.machine
    assert machine == origin.this_machine()
    assert machine.platform == f"{platform.system()} {platform.machine()}"
    assert machine.cores >= 1
    assert not {platform.node(), getpass.getuser()} & set(dump_json(machine).replace('"', " ").split())


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as end:
        run(verify_command, [str(a) for a in arguments])
    said = capsys.readouterr()
    return end.value.code, said.out, said.err


def test_bad_input_is_one_line(
    score_file: Path, submission: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = ("--submission", submission, "--dataset", data)
    missing = tmp_path / "missing.json"
    assert call(capsys, missing, *both) == (2, "", f"avs3d: error: {missing}: missing; expected a file\n")
    code, out, err = call(capsys, submission / layout.SUBMISSION_JSON, *both)
    assert (code, out, err.count("\n")) == (2, "", 1)
    code, out, err = call(capsys, score_file, *both, "--json", score_file)
    assert code == 2
    assert err.startswith(f"avs3d: error: {score_file}: exists, and this command has not written it; choose another")
    code, out, err = call(capsys, score_file, "--submission", tmp_path / "nowhere", "--dataset", data)
    assert (code, err.count("\n")) == (2, 1)
    code, out, err = call(capsys, score_file, "--dataset", data)
    assert (code, err) == (2, "avs3d: error: Missing option '--submission'.\n")


@pytest.mark.slow
def test_a_submission_that_cannot_be_scored_is_not_confirmed(
    score_file: Path, submission: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(submission, tmp_path / "copy")
    (copy / tiny.SINGLE / "masks" / "frame_000.png").unlink()
    code, out, _ = call(capsys, score_file, "--submission", copy, "--dataset", data)
    assert code == 1
    assert "frame_000.png" in out


def test_the_json_file_has_every_difference(
    submission: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_json(tmp_path / "other.json", example_scores([tiny.SINGLE, tiny.MULTI], seed=3))
    out = tmp_path / "out.json"
    code, said, _ = call(
        capsys, tmp_path / "other.json", "--submission", submission, "--dataset", data, "--json", out, "--workers", 1
    )
    assert code == 1
    found = read_json(out)
    assert found["same"] is False
    assert len(found["differences"]) > 40
    assert f"{len(found['differences']) - 40:,} more; --json FILE writes all of them" in said
    assert said.splitlines()[-1].endswith("values are not confirmed")
    assert found["notes"][0].startswith("the file has no digests")


def test_a_sealed_test_is_verified_with_its_truth(
    score_file: Path, submission: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the truth lies makes no difference to digests and figures."""
    public, private = tiny.clone(data, tmp_path / "public"), tmp_path / "private"
    for key in (tiny.SINGLE, tiny.MULTI):
        (private / key).mkdir(parents=True)
        for name in ("observation.json", "semantic_masks", "instance_masks", "gt_3d"):
            (public / key / name).rename(private / key / name)
    assert verify(score_file, submission, Dataset(public, private)).same
    with pytest.raises(Avs3dError):
        verify(score_file, submission, public)
    code, out, err = call(capsys, score_file, "--submission", submission, "--dataset", public, "--truth", private)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert str(public) in err  # no seal.json: no sealed test


def test_the_report_names_digests_and_machine(data: Path, submission: Path, tmp_path: Path) -> None:
    with open_submission(submission) as opened:
        evaluation = evaluate(submission, data)
        write_report(tmp_path / "report.html", evaluation, Dataset(data), opened)
    text = (tmp_path / "report.html").read_text()
    scores = evaluation.scores
    assert f"scored <code>{scores.submission.digest}</code>, truth <code>{scores.dataset.truth_digest}</code>" in text
    assert f"<dd>{scores.avs3d_eval.machine.platform}, {scores.avs3d_eval.machine.python}, " in text
    assert read_report(tmp_path / "report.html")


@pytest.mark.parametrize(
    ("contents", "says"),
    [
        (b"", "Invalid JSON"),
        (b"[" * 100_000, ""),
        (b'{"avs3d_eval": NaN}', ""),
        ("scored", "observations: 2 in the list, but dataset.scored is 7; score the submission again"),
        ("protocols", "avs3d_eval.protocols: empty, expected official, strict or listen; score it again"),
    ],
    ids=["empty", "deep", "NaN", "contradiction", "no protocol"],
)
def test_a_broken_file_of_scores_is_one_line(
    scores: Scores, submission: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    contents: bytes | str, says: str,
) -> None:  # fmt: skip
    path = tmp_path / "bad.json"
    document = json.loads(dump_json(scores))
    if contents == "scored":
        document["dataset"]["scored"] = 7
    elif contents == "protocols":
        document["avs3d_eval"]["protocols"] = {}
    path.write_bytes(contents if isinstance(contents, bytes) else json.dumps(document).encode())
    code, out, err = call(capsys, path, "--submission", submission, "--dataset", data)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"avs3d: error: {path}: ")
    assert says in err


@pytest.mark.slow
def test_a_leaderboard_marks_what_a_named_record_confirms(
    score_file: Path, submission: Path, data: Path, tmp_path: Path
) -> None:
    """A record beside the file of scores marks nothing; after an edit of the file its record marks nothing."""
    record = tmp_path / "verified.json"
    arguments = [score_file, "--submission", submission, "--dataset", data, "--json", record]
    assert CliRunner().invoke(verify_command, list(map(str, arguments))).exit_code == 0
    mark = '<span class="tag" title="avs3d verify'
    write_leaderboard(tmp_path / "plain", [score_file])
    assert mark not in (tmp_path / "plain" / "index.html").read_text()
    assert write_leaderboard(tmp_path / "marked", [score_file], [record]) == ()
    assert mark in (tmp_path / "marked" / "index.html").read_text()
    copy = next((tmp_path / "marked" / "reports").glob("*.json"))
    assert write_leaderboard(tmp_path / "again", [copy], [record]) == (), "a copy on a board is the same entry"
    edited = read_json(score_file)
    edited["submission"]["method"] = "another"
    write_json(score_file, edited)
    (note,) = write_leaderboard(tmp_path / "edited", [score_file], [record])
    assert "marks nothing: it is about other scores of test" in note
    assert mark not in (tmp_path / "edited" / "index.html").read_text()


def test_a_record_of_differences_marks_nothing(score_file: Path, submission: Path, data: Path, tmp_path: Path) -> None:
    changed = read_json(score_file)
    changed["submission"]["method"] = "another"
    write_json(score_file, changed)
    found = verify(score_file, submission, data)
    write_json(tmp_path / "record.json", found.record())
    (note,) = write_leaderboard(tmp_path / "board", [score_file], [tmp_path / "record.json"])
    assert "marks nothing: 1 of its values were not confirmed" in note
    (tmp_path / "record.json").write_text('{"same": true}')
    with pytest.raises(Avs3dError, match=r"record\.json: values: Field required"):
        write_leaderboard(tmp_path / "board", [score_file], [tmp_path / "record.json"])
