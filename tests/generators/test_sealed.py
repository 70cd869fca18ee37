"""Sealed tests: what is published, what is committed to, who notices a change; on trees made by hand."""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import io
import shutil
import stat
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench import cli
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord, PosesRecord, ProvenanceRecord, SecretCommitment
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.sealing import seal as sealed
from avs3d_bench.sealing import secret
from avs3d_bench.submission import SubmissionWriter
from avs3d_bench.validate import validate
from baselines.oracle import write_oracle
from evaluators.cli import check, evaluate
from evaluators.score import evaluate as score
from generators.backends import observation_provenance
from generators.options import EngineOptions
from generators.sealing.cli import unseal
from generators.sealing.unseal import other_software
from generators.sealing.unseal import unseal as open_seal
from tests.support import tiny
from tests.support.sealed_trees import MULTI, SECRET, SINGLE, write_seal
from tests.support.tiers import some


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seal(tmp_path_factory.mktemp("sealed"))


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seal(tmp_path_factory.mktemp("scenes"), scenes=True)


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    """A sealed test whose files may be replaced."""
    return tiny.clone(made, tmp_path / "copy")


def names_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def write_submission(folder: Path, dataset: Dataset) -> Path:
    """The middle half of every picture."""
    with SubmissionWriter(folder, dataset, method="middle") as writer:
        for observation in dataset:
            for frame in observation.test:
                mask = np.zeros(frame.rgb().shape[:2], bool)
                mask[16:48, 16:48] = True
                writer.write_mask(frame, mask)
    return folder


# What is published


def test_public_and_private_have_every_file_once(made: Path) -> None:
    generated = names_below(made / "generated")
    public, private = names_below(made / "public"), names_below(made / "private")
    own = {"dataset.json", "seal.json"}
    assert public & private == own
    observations = {name for name in generated if name.startswith("part_")}
    assert {n for n in public | private if n.startswith("part_") and not n.endswith("poses.json")} == observations
    truth = {name for name in observations if not layout.is_public(name.split("/", 4)[4])}
    assert {name.split("/")[4] for name in truth} == {
        "observation.json", "semantic_masks", "instance_masks", "gt_3d", "rirs",
    }  # fmt: skip
    assert private - own - truth == {"manifest.yaml", "template.yaml", "draws.json", "opening.hex"}


def test_public_pictures_and_clips_have_the_generated_bytes(made: Path) -> None:
    for name in names_below(made / "public"):
        if name.startswith("part_") and not name.endswith("poses.json"):
            assert (made / "public" / name).read_bytes() == (made / "generated" / name).read_bytes()


def test_no_file_of_public_is_a_link_to_another_observation_or_to_truth(made: Path) -> None:
    outside = {path.stat().st_ino for name in ("private", "generated") for path in (made / name).rglob("*")}
    links = Counter(path.stat().st_ino for path in (made / "public").rglob("*") if path.is_file())
    assert not outside & set(links)
    for path in (made / "public").rglob("*"):
        if path.is_file():
            twice = path.parent.name in (layout.INPUT, layout.IMAGES)
            assert path.stat().st_nlink == links[path.stat().st_ino] == (2 if twice else 1), path


def test_all_published_files_have_one_time_and_one_mode(made: Path) -> None:
    found = [path.stat() for path in [made / "public", *(made / "public").rglob("*")]]
    assert {one.st_mtime_ns for one in found} == {315_532_800 * 10**9}
    assert {stat.S_IMODE(one.st_mode) for one in found if stat.S_ISREG(one.st_mode)} == {0o644}
    assert {stat.S_IMODE(one.st_mode) for one in found if stat.S_ISDIR(one.st_mode)} == {0o755}


def test_the_published_records_do_not_depend_on_what_sounds(made: Path) -> None:
    """The same observation with another sounding object gives the same poses.json and entry of dataset.json."""
    path = made / "generated" / MULTI / layout.OBSERVATION_JSON
    record = files.read_record(path, ObservationRecord)
    one, other = record.instances
    swapped = record.model_copy(
        update={
            "instances": (one.model_copy(update={"sounding": True}), other.model_copy(update={"sounding": False})),
            "source_position": (9.0, 9.0, 9.0),
            "notes": ("another",),
            "frames": tuple(
                f.model_copy(update={"visible_pixels": 7, "azimuth": 1.0, "distance": 2.0, "rms_left": 0.5})
                for f in record.frames
            ),
        }
    )
    assert swapped != record
    assert PosesRecord.of(swapped, {}) == PosesRecord.of(record, {})
    text = (made / "public" / "dataset.json").read_text()
    assert "microwave" not in text
    assert '"category": null' in text
    assert "seed" not in text


def test_commitments_list_the_same_files_of_silence_as_of_sound(scenes: Path) -> None:
    """The number of sources, and whether an object of the room sounds, must not show in a list of names."""
    seal = sealed.read_seal(scenes / "public")
    assert len(seal.commitments.truth) == 5
    lists = {tuple(sorted(found)) for found in seal.commitments.truth.values()}
    assert len(lists) == 1
    assert not any(name.startswith((layout.STEMS, layout.RIRS)) for name in next(iter(lists)))
    silent = [key for key in seal.commitments.truth if not (scenes / "private" / key / layout.SOUNDING_OBJECT).exists()]
    assert silent  # an absent mesh has a commitment, too
    assert all(layout.SOUNDING_OBJECT in seal.commitments.truth[key] for key in silent)


def test_equal_truth_files_have_different_commitments(scenes: Path) -> None:
    """Without salts, equal digests would tell frames without a visible source, and siblings with the same one."""
    seal = sealed.read_seal(scenes / "public")
    digests = [digest for found in seal.commitments.truth.values() for digest in found.values()]
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (scenes / "private").rglob("*.png")]
    assert len(set(contents)) < len(contents)  # there are equal masks
    assert len(set(digests)) == len(digests)
    assert not set(digests) & set(contents)


def test_siblings_of_public_are_not_links_of_one_another(scenes: Path) -> None:
    pictures = [path.stat() for path in (scenes / "public").rglob("input/*.png")]
    assert len({one.st_ino for one in pictures}) == len(pictures)


def test_siblings_are_found_by_their_pictures(scenes: Path) -> None:
    """Without the truth: methods that train on pictures train once for a group."""
    public, whole = Dataset(scenes / "public"), Dataset(scenes / "public", truth=scenes / "private")
    groups: dict[str, set[str]] = {}
    for observation in whole:
        groups.setdefault(observation.group_key, set()).add(observation.key)
    assert any(len(keys) > 1 for keys in groups.values())
    for keys in groups.values():
        assert {public[key].group for key in keys} == {min(keys)}


def test_train_truth_publishes_masks_of_train_frames_only(tmp_path: Path) -> None:
    folder = write_seal(tmp_path, train_truth=True)
    names = {name for name in names_below(folder / "public") if "masks" in name}
    assert {name.split("/")[4] for name in names} == {layout.SEMANTIC_MASKS}
    for observation in Dataset(folder / "public"):
        there = {name.split("/")[5][:-4] for name in names if name.startswith(observation.key)}
        assert there == {frame.name for frame in observation.train}
        assert observation.train[0].mask().shape == (64, 64)
    assert not list(sealed.check_public(folder / "public", sealed.read_seal(folder / "public")))


# Reading


def test_public_is_read_without_truth(made: Path) -> None:
    public, whole = Dataset(made / "public"), Dataset(made / "generated")
    assert public.is_sealed
    assert public.keys == whole.keys
    assert all(entry.category is None and entry.sounds is None for entry in public.record.observations)
    for observation, other in zip(public, whole, strict=True):
        assert observation.record is None
        assert observation.category is None
        assert observation.intrinsics == other.intrinsics
        assert [frame.split for frame in observation.frames] == [frame.split for frame in other.frames]
        for frame, true in zip(observation.frames, other.frames, strict=True):
            assert frame.pose == true.pose
            np.testing.assert_array_equal(frame.audio(), true.audio())
            np.testing.assert_array_equal(frame.depth(), true.depth())
        with pytest.raises(Avs3dError, match="the truth of this test is sealed"):
            observation.frames[0].mask()


def test_only_the_public_folder_is_a_sealed_dataset(made: Path) -> None:
    assert [Dataset(made / name).is_sealed for name in ("public", "private", "generated")] == [True, False, False]


def test_an_oracle_needs_the_truth(made: Path, tmp_path: Path) -> None:
    for instance, message in (("category", "which a sealed test does not publish"), ("sounding", "test is sealed")):
        with pytest.raises(Avs3dError, match=message):
            write_oracle(Dataset(made / "public"), tmp_path / instance, instance=instance)


def test_poses_come_from_poses_json(copy: Path) -> None:
    """They are those of observation.json to the last digit; the sparse model has them by way of a rotated world."""
    shutil.rmtree(copy / "public" / SINGLE / "sparse")
    assert Dataset(copy / "public")[SINGLE].frames[3].pose == Dataset(copy / "generated")[SINGLE].frames[3].pose


def test_with_the_truth_everything_is_read(made: Path) -> None:
    dataset, whole = sealed.open_sealed(made / "public", made / "private"), Dataset(made / "generated")
    for observation, other in zip(dataset, whole, strict=True):
        assert observation.record == other.record
        for frame, true in zip(observation.frames, other.frames, strict=True):
            np.testing.assert_array_equal(frame.mask(), true.mask())
            np.testing.assert_array_equal(frame.rgb(), true.rgb())
            np.testing.assert_array_equal(frame.impulse_response(), true.impulse_response())
        np.testing.assert_array_equal(observation.mesh().vertices, other.mesh().vertices)


@pytest.mark.parametrize("workers", some([1, 2], every=2))
def test_scores_are_those_of_the_whole_dataset(made: Path, tmp_path: Path, workers: int) -> None:
    submission = write_submission(tmp_path / "submission", Dataset(made / "public"))
    expected = score(submission, made / "generated").scores
    out = tmp_path / "scores.json"
    result = CliRunner().invoke(
        evaluate,
        [str(submission), "--dataset", str(made / "public"), "--truth", str(made / "private"), "--json", str(out)]
        + ["--html", str(tmp_path / "report.html"), "--workers", str(workers)],
    )
    assert result.exit_code == 0, result.output
    found = files.read_json(out)
    assert found["observations"] == files.read_json(_written(tmp_path, expected))["observations"]
    assert (tmp_path / "report.html").stat().st_size > 10_000


def _written(folder: Path, record: object) -> Path:
    files.write_json(folder / "expected.json", record)
    return folder / "expected.json"


def test_scores_of_part_3_are_those_of_the_whole_dataset(scenes: Path, tmp_path: Path) -> None:
    submission = write_submission(tmp_path / "submission", Dataset(scenes / "public"))
    expected = score(submission, scenes / "generated").scores
    result = CliRunner().invoke(
        evaluate,
        [str(submission), "--dataset", str(scenes / "public"), "--truth", str(scenes / "private")]
        + ["--json", str(tmp_path / "s.json"), "--workers", "1"],
    )
    assert result.exit_code == 0, result.output
    assert files.read_json(tmp_path / "s.json")["siblings"] == files.read_json(_written(tmp_path, expected))["siblings"]
    assert score(submission, scenes / "public", scenes / "private").scores.siblings == expected.siblings
    whole = Dataset(scenes / "public", truth=scenes / "private")
    assert score(submission, whole).scores.siblings == expected.siblings
    with pytest.raises(UsageError, match=r"public: a sealed test; .* truth=…"):
        score(submission, Dataset(scenes / "public"))


def test_participants_check_a_submission_without_the_truth(made: Path, tmp_path: Path) -> None:
    submission = write_submission(tmp_path / "submission", Dataset(made / "public"))
    arguments = [str(submission), "--dataset", str(made / "public"), "--workers", "1"]
    assert CliRunner().invoke(check, arguments).exit_code == 0
    (submission / SINGLE / "masks" / "frame_008.png").unlink()
    result = CliRunner().invoke(check, arguments)
    assert result.exit_code == 1
    assert "frame_008.png" in result.output


def test_validate_knows_a_sealed_test(copy: Path) -> None:
    report = validate(copy / "public")
    assert report.valid, report.problems
    tiny.replace(copy / "public" / SINGLE / "input" / "frame_001.png", b"other")
    (copy / "public" / SINGLE / layout.OBSERVATION_JSON).write_text("{}")
    assert {problem.path for problem in validate(copy / "public").problems} == {
        f"{SINGLE}/input/frame_001.png", f"{SINGLE}/observation.json",
    }  # fmt: skip


# Commitments


def test_a_commitment_is_a_salted_sha256() -> None:
    """Computed here as docs/sealed.md says it."""
    opening = hmac.new(SECRET, b"avs3d-bench sealed test 1.0: opening key", "sha256").digest()
    assert secret.derive(SECRET, sealed.OPENING) == opening
    salt = hmac.new(opening, b"part_1/a/kitchen/1/observation.json", "sha256").digest()
    path = "part_1/a/kitchen/1/observation.json"
    assert sealed.commitment(opening, path, b"abc") == hashlib.sha256(salt + b"\x01abc").hexdigest()
    assert sealed.commitment(opening, path, None) == hashlib.sha256(salt + b"\x00").hexdigest()


def test_the_whole_chain_of_commitments(made: Path) -> None:
    seal = sealed.read_seal(made / "public")
    record = seal.commitments.secret
    assert isinstance(record, SecretCommitment)
    both = hashlib.scrypt(SECRET, salt=bytes.fromhex(record.salt), n=record.n, r=record.r, p=record.p, dklen=64)
    assert record.digest == both[32:].hex()
    opening = hmac.new(both[:32], b"avs3d-bench sealed test 1.0: opening key", "sha256").hexdigest()
    assert (made / "private" / "opening.hex").read_text() == f"{opening}\n"
    manifest = (made / "private" / "manifest.yaml").read_bytes()
    assert seal.commitments.manifest == hashlib.sha256(manifest).hexdigest()
    assert seal.dataset_sha256 == hashlib.sha256((made / "public" / "dataset.json").read_bytes()).hexdigest()
    assert (made / "private" / "seal.json").read_bytes() == (made / "public" / "seal.json").read_bytes()


def test_the_secret_opens_the_test(made: Path) -> None:
    assert open_seal(made, SECRET).problems == ()


#: What is changed → what is said about which file.
CHANGES = {
    "private/part_1/home_1/kitchen/1/semantic_masks/frame_003.png": "semantic_masks/frame_003.png: not what seal.json",
    "private/part_2/home_1/kitchen/1/gt_3d/sounding_object.ply": "sounding_object.ply: not what seal.json commits to",
    "private/part_2/home_1/kitchen/1/observation.json": "observation.json: ",
    "private/part_1/home_1/kitchen/1/rirs/frame_2.npz": "rirs/frame_2.npz: not the file that observation.json names",
    "private/manifest.yaml": "manifest.yaml: not the manifest that seal.json commits to",
    "private/template.yaml": "",
    "private/opening.hex": "opening.hex",
    "public/part_1/home_1/kitchen/1/input/frame_001.png": "input/frame_001.png: not the file that poses.json names",
    "public/part_1/home_1/kitchen/1/poses.json": "poses.json: missing, or not the file that dataset.json names",
    "public/dataset.json": "dataset.json: missing, or not the file that seal.json names",
    "public/seal.json": "seal.json",
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_changed_file_is_noticed(copy: Path, name: str) -> None:
    data = bytearray((copy / name).read_bytes())
    place = data.rfind(b"0") if name.endswith((".json", ".yaml", ".hex")) else len(data) // 2
    data[place] = ord("1") if data[place] == ord("0") else data[place] ^ 1
    tiny.replace(copy / name, bytes(data))
    result = CliRunner().invoke(unseal, [str(copy), "--secret", str(copy / "secret")])
    assert result.exit_code != 0
    assert CHANGES[name] in result.output + str(result.exception)


@pytest.mark.parametrize("name", ["semantic_masks/frame_008.png", "instance_masks/frame_000.png", "observation.json"])
def test_missing_truth_is_noticed_by_the_evaluator(copy: Path, name: str) -> None:
    (copy / "private" / MULTI / name).unlink()
    with pytest.raises(Avs3dError, match=f"{name}: missing; seal.json commits to such a file"):
        sealed.open_sealed(copy / "public", copy / "private")


def test_the_evaluator_reads_the_chosen_observations_only(copy: Path) -> None:
    (copy / "private" / MULTI / "semantic_masks/frame_008.png").unlink()
    sealed.open_sealed(copy / "public", copy / "private", only=("part_1/*",))


def test_a_tampered_commitment_is_noticed_by_the_evaluator(copy: Path) -> None:
    """Also where both copies of seal.json are changed."""
    data = files.read_json(copy / "public" / "seal.json")
    found = data["commitments"]["truth"][SINGLE]
    found["semantic_masks/frame_008.png"] = "0" * 64
    for folder in ("public", "private"):
        tiny.replace(copy / folder / "seal.json", files.dump_json(data).encode())
    with pytest.raises(Avs3dError, match=r"frame_008.png: not what seal.json commits to"):
        sealed.open_sealed(copy / "public", copy / "private")


def test_an_observation_without_commitments_is_not_scored(copy: Path) -> None:
    """Else the organiser could add observations after the seal."""
    for folder in ("public", "private"):
        shutil.copytree(copy / folder / SINGLE, copy / folder / "part_1/home_1/kitchen/2")
    with pytest.raises(Avs3dError, match=r"kitchen/2: seal.json has no commitments to this observation"):
        sealed.open_sealed(copy / "public", copy / "private")
    found = {problem.message.partition(":")[0] for problem in open_seal(copy, SECRET).problems}
    assert found == {"not listed in the public dataset.json", "surplus folder in private/ with 29 files"}


def test_commitments_name_observations_only(copy: Path) -> None:
    """A path out of the folder must not be read."""
    data = files.read_json(copy / "public" / "seal.json")
    data["commitments"]["truth"]["../../part_1"] = {}
    tiny.replace(copy / "public" / "seal.json", files.dump_json(data).encode())
    with pytest.raises(Avs3dError, match=r"commitments: observation key '../../part_1': expected part_1"):
        sealed.read_seal(copy / "public")


# Bad input


def error_of(command: object, *arguments: object) -> str:
    """The one line that a command prints, through the program."""
    with contextlib.redirect_stderr(io.StringIO()) as err, pytest.raises(SystemExit) as caught:
        cli.run(command, [str(one) for one in arguments], program="avs3d")  # type: ignore[arg-type]
    text = err.getvalue()
    assert caught.value.code == 2, text
    assert text.count("\n") == 1, text
    return text


def test_truth_of_another_seal(made: Path, tmp_path: Path) -> None:
    other = write_seal(tmp_path, secret=bytes(32))
    submission = write_submission(tmp_path / "submission", Dataset(made / "public"))
    text = error_of(evaluate, submission, "--dataset", made / "public", "--truth", other / "private")
    assert "the truth of another seal" in text
    assert str(other / "private") in text
    assert "expected the private folder that was written with it" in text


def test_a_sealed_test_is_not_scored_without_truth(made: Path, tmp_path: Path) -> None:
    submission = write_submission(tmp_path / "submission", Dataset(made / "public"))
    assert "--truth PRIVATE" in error_of(evaluate, submission, "--dataset", made / "public")


def test_truth_of_a_dataset_that_is_not_sealed(made: Path, tmp_path: Path) -> None:
    submission = write_submission(tmp_path / "submission", Dataset(made / "generated"))
    text = error_of(evaluate, submission, "--dataset", made / "generated", "--truth", made / "private")
    assert "seal.json: missing; expected the public folder" in text


def test_a_private_folder_that_is_none(made: Path, tmp_path: Path) -> None:
    submission = write_submission(tmp_path / "submission", Dataset(made / "public"))
    text = error_of(evaluate, submission, "--dataset", made / "public", "--truth", tmp_path)
    assert "seal.json: missing; expected the private folder" in text
    text = error_of(evaluate, submission, "--dataset", made / "public", "--truth", made / "public")
    assert "a public folder: no manifest.yaml; expected the private folder" in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a secret of 0 characters; expected 64 hexadecimal digits (32 bytes)"),
        ("ab" * 31, "a secret of 62 characters; expected 64 hexadecimal digits (32 bytes)"),
        ("ab" * 33, "a secret of 66 characters; expected 64 hexadecimal digits (32 bytes)"),
        ("xy" * 32, "other characters than digits and a to f"),
        ("é" * 32, "other characters than digits and a to f"),
        ("ab" * 3000, "6,000 bytes, expected at most 1,024"),
    ],
)
def test_a_secret_of_the_wrong_length_or_kind(made: Path, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "secret").write_text(text, encoding="utf-8")
    line = error_of(unseal, made, "--secret", tmp_path / "secret")
    assert message in line
    assert not text or text not in line


def test_another_secret_is_named_and_nothing_else(made: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("ab" * 32)
    result = CliRunner().invoke(unseal, [str(made), "--secret", str(tmp_path / "secret")])
    assert result.exit_code == 1
    errors = [line for line in result.output.splitlines() if line.startswith("error")]
    assert errors == ["error: secret: not the secret that seal.json commits to"]


def test_a_missing_secret(made: Path, tmp_path: Path) -> None:
    assert "cannot read the secret" in error_of(unseal, made, "--secret", tmp_path / "none")


def test_unseal_needs_both_folders(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("ab" * 32)
    assert "seal.json: missing; expected the public folder" in error_of(
        unseal, tmp_path, "--secret", tmp_path / "secret"
    )


def test_only_belongs_to_regenerate(made: Path) -> None:
    text = error_of(unseal, made, "--secret", made / "secret", "--only", "part_1/*")
    assert "--only chooses what --regenerate generates" in text


def test_a_seal_of_another_form(copy: Path) -> None:
    tiny.replace(copy / "public" / "seal.json", b'{"schema_version": "1.0"}\n')
    with pytest.raises(Avs3dError, match=r"seal.json: .*; expected a SealRecord"):
        sealed.read_seal(copy / "public")


def test_a_secret_with_a_line_feed_or_capitals_is_read(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(f" {SECRET.hex().upper()}\r\n")
    assert secret.read_secret(tmp_path / "secret") == SECRET


def test_messages_of_usage_are_usage_errors(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        sealed.read_seal(tmp_path)


def test_other_software_is_named_before_bytes_are_compared(made: Path) -> None:
    """Observations that are generated again by other versions may differ without anyone's fault."""
    seal = sealed.read_seal(made / "public")
    here = ProvenanceRecord.of(observation_provenance(EngineOptions(audio="analytic")))
    same = seal.model_copy(
        update={"provenance": here, "settings": {"vision": "embree", "audio": "analytic", "device": "cpu"}}
    )
    assert list(other_software(same)) == []
    sources = same.model_copy(update={"provenance": here.model_copy(update={"digest": "0" * 64})})
    assert [note.partition(": ")[2] for note in other_software(sources)] == ["another version of the toolkit's sources"]
    libraries = dict(here.libraries) | {"numpy": "1.0"}
    older = here.model_copy(update={"digest": "0" * 64, "python": "3.10", "libraries": libraries})
    (note,) = other_software(same.model_copy(update={"provenance": older}))
    assert note.startswith("sealed with other software, so that bytes may differ: Python 3.10 (here 3.")
    assert f"numpy 1.0 (here {here.libraries['numpy']})" in note
