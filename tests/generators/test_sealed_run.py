"""A sealed test in one run: made, scored, opened, generated again; and truth that was changed before the seal."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from avs3d_bench import cli
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DrawsRecord, SecretCommitment
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import files
from avs3d_bench.sealing.seal import open_sealed
from avs3d_bench.sealing.secret import CommittedSecret, working_key
from avs3d_bench.submission import SubmissionWriter
from evaluators.reading.submission import open_submission
from evaluators.score import score
from generators.manifest.reading import read_manifest
from generators.sealing.cli import seal, unseal
from generators.sealing.publish import Sealing, write_private, write_public
from tests.generators.test_sealed import names_below
from tests.support import tiny

TEMPLATE = """\
name: small
seed: 7
camera: {size: 64, frames: 2}
light: preview
scans: {flat: {seed: 11}}
observations:
  - {part: part_1, scan: flat, room: bathroom, index: 4, category: washing_machine, silent: [toilet]}
  - part: part_3
    scan: flat
    room: bathroom
    index: 1
    instances: {washing_machine: 1, toilet: 1}
    sources: [{category: washing_machine}]
  - {like: part_3/flat/bathroom/1, index: 2, sources: []}
"""
SECRET = bytes.fromhex("1f7be3d05c9842a6f36d01e8b72a94cd5e86f107ac3b49d2706efd1985b3c24a")


def call(command: object, *arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        cli.run(command, [str(one) for one in arguments], program="avs3d")  # type: ignore[arg-type]
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sealed test with its home still in the cache."""
    place = tmp_path_factory.mktemp("run")
    (place / "template.yaml").write_text(TEMPLATE)
    (place / "key").write_text(SECRET.hex())
    code = call(seal, place / "template.yaml", "-o", place / "test", "--secret", place / "key", *making(place))
    assert code == 0
    return place


def making(place: Path) -> Sequence[object]:
    return ("--audio", "analytic", "--workers", 1, "--cache", place / "cache", "--with", "stems", "--with", "rirs")


def unsealed(place: Path, test: Path, *more: object) -> int:
    return call(unseal, test, "--secret", place / "key", "--workers", 1, "--cache", place / "cache", *more)


@pytest.mark.slow
def test_a_sealed_test_is_made_scored_and_opened(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    test = folder / "test"
    # Nothing else, and no secret.
    assert sorted(path.name for path in test.iterdir()) == ["commitment.json", "private", "public"]
    assert (test / "private").stat().st_mode & 0o77 == 0
    assert call(seal, folder / "template.yaml", "-o", test, "--secret", folder / "key", *making(folder)) == 2
    assert "this test is sealed already" in capsys.readouterr().err
    text = b"".join((test / "public" / name).read_bytes() for name in names_below(test / "public") if "json" in name)
    drawn = read_manifest(test / "private" / "manifest.yaml").manifest
    for hidden in ("washing_machine", "flat", str(drawn.seed), str(drawn.scans["home_1"].seed), SECRET.hex()):
        assert hidden.encode() not in text
    assert drawn.camera.frames == 2
    assert drawn.audio == "analytic"
    private = names_below(test / "private")
    assert any("stems/" in name for name in private)
    assert not any("stems/" in name or "rirs" in name for name in names_below(test / "public"))

    dataset = open_sealed(test / "public", test / "private")
    with SubmissionWriter(folder / "submission", dataset, method="truth") as writer:
        for observation in dataset:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    with open_submission(folder / "submission") as opened:
        scores = score(opened, dataset).scores
    assert [one.key for one in scores.observations] == list(dataset.keys)
    strict = next(one.strict for one in scores.observations if one.strict is not None)
    assert strict.IoU in (None, 1.0)

    assert unsealed(folder, test) == 0
    assert unsealed(folder, test, "--regenerate", "--only", "part_1/*") == 0
    assert "1 generated again: all as committed to" in capsys.readouterr().out


@pytest.mark.slow
def test_truth_that_was_changed_before_the_seal_is_noticed_when_it_is_generated_again(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hashes and records cannot know: the organiser committed to the changed clip, and nothing contradicts it."""
    whole, key = _merged(folder / "test", tmp_path / "whole"), "part_1/home_1/bathroom/1"
    name = layout.audio_path(layout.BINAURAL, 0)
    other = (whole / key / layout.audio_path(layout.BINAURAL, 1)).read_bytes()
    assert other != (whole / key / name).read_bytes()
    tiny.replace(whole / key / name, other)

    def change(data: dict[str, dict[str, object]]) -> None:
        data["files"][name] = hashlib.sha256(other).hexdigest()
        data["sizes"][name] = len(other)

    tiny.edit_record(whole, key, change, rehash=False)
    dataset = files.read_json(whole / "dataset.json")
    for entry in dataset["observations"]:
        entry["digest"] = files.sha256_file(whole / entry["key"] / layout.OBSERVATION_JSON)
    tiny.write_sealed(whole, dataset)
    private, test = folder / "test" / "private", tmp_path / "test"
    drawn = read_manifest(private / "manifest.yaml")
    draws = files.read_record(private / "draws.json", DrawsRecord).draws
    settings = files.read_json(folder / "test" / "public" / "seal.json")["settings"]
    record = files.read_record(folder / "test" / "commitment.json", SecretCommitment)
    working = working_key(SECRET, record)
    assert working is not None
    bound = CommittedSecret(working, record)
    sealing = Sealing((private / "template.yaml").read_text(), drawn, draws, bound, False, settings)
    for each in ("public", "private"):
        (test / each).mkdir(parents=True)
    write_public(Dataset(whole), test / "public", sealing)
    write_private(Dataset(whole), test / "public", test / "private", sealing)
    assert unsealed(folder, test) == 0
    assert unsealed(folder, test, "--regenerate", "--only", key) == 1
    out = capsys.readouterr().out
    assert f"error: {key}/{name}: differs from the file that was generated again" in out
    assert "1 generated again: 1 not as committed to" in out


def _merged(test: Path, whole: Path) -> Path:
    """Public and private in one folder, as they were generated."""
    shutil.copytree(test / "private", whole)
    shutil.copytree(test / "public", whole, dirs_exist_ok=True)
    shutil.copy(test / "private" / "dataset.json", whole / "dataset.json")
    for path in (whole / "seal.json", *whole.rglob("poses.json")):
        path.unlink()
    return whole
