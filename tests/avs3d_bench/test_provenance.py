"""The digest of the software behind a result: its contents, its exceptions, and no reuse of outdated results."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.contract.schema import (
    DatasetRecord,
    ObservationRecord,
    ProvenanceRecord,
    SubmissionRecord,
    parse_record,
)
from avs3d_bench.contract.scores import Scores
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import dump_json
from avs3d_bench.runtime.provenance import (
    BACKENDS,
    CONTRACT,
    LEFT_OUT,
    PACKAGES,
    RESULTS,
    SOFTWARE,
    Provenance,
    folders_of,
    provenance,
    read_provenance,
    source_files,
)
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.software import check_software
from avs3d_bench.scheduling.tasks import Context
from baselines.trivial import write_trivial
from evaluators import evaluate, open_submission, write_report
from generators.backends import ACOUSTIC, BUILT_ON, VISION, observation_provenance, unused_backends
from generators.manifest.reading import read_manifest
from generators.options import EngineOptions, GenerateOptions
from generators.plan import make_plans
from generators.run.dataset_record import read_observation
from generators.run.finished import find_damage
from generators.run.worker import RunTarget, make_observation, prepare
from tests.support.homes import tree_digest, write_manifest
from tests.test_architecture import MODULES, edges

ROOT = Path(__file__).parents[2]
#: What is certain not to run for an observation with Embree and the analytic engine.
UNUSED = {"observation": unused_backends(EngineOptions(audio="analytic"))}
#: Modules that listed folders import and that change no result: processes, memory, progress, locks, messages, and
#: packages that only pass names on.
NOT_COUNTED = {
    "avs3d_bench",
    "avs3d_bench.runtime.ahead",
    "avs3d_bench.cli",
    "avs3d_bench.runtime.file_lock",
    "avs3d_bench.runtime.freed_memory",
    "avs3d_bench.runtime.imports",
    "avs3d_bench.runtime.one_thread",
    "avs3d_bench.commands.outputs",
    "avs3d_bench.runtime.parallel",
    "avs3d_bench.runtime.provenance",
    "avs3d_bench.commands.report",
    "avs3d_bench.scheduling",
    "avs3d_bench.formats.staging",
    "generators.library",
}
#: The same of one result. The listener reads shards for its training; its masks come from datasets.
_SHARDS = {
    "avs3d_bench.exports",
    "avs3d_bench.exports.observation_tar",
    "avs3d_bench.exports.shard_files",
    "avs3d_bench.exports.shards",
}
ALSO_NOT_COUNTED = {
    "home": {"avs3d_bench.runtime.user_path"},
    "scores": {"avs3d_bench.contract.score_frames"},
    "baselines.direction_alone": _SHARDS,
    "baselines.listener": _SHARDS,
}


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages, to edit."""
    folder = tmp_path_factory.mktemp("packages")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def files_in(folder: Path) -> Callable[[str], Path]:
    return lambda package: folder / package


def found_in(folder: Path, result: str) -> Provenance:
    return read_provenance(files_in(folder), [result], without=UNUSED.get(result, ()))


def digest(folder: Path, result: str) -> str:
    return found_in(folder, result).digest


@contextmanager
def appended(path: Path, text: str) -> Iterator[None]:
    """A file with more text at its end, for a while."""
    before = path.read_text()
    path.write_text(before + text)
    try:
        yield
    finally:
        path.write_text(before)


@pytest.mark.slow
@pytest.mark.parametrize("result", RESULTS)
def test_an_edit_in_each_folder_changes_the_result_and_one_elsewhere_does_not(packages: Path, result: str) -> None:
    before = found_in(packages, result)
    listed = folders_of(result)
    assert len(set(listed)) == len(listed)
    inside = {}
    for name in listed:
        counted = (path for path, _ in source_files(name, files_in(packages)) if path in before.sources)
        inside[name] = next(path for path in counted if path.endswith(".py"))
    outside = {}
    for package in PACKAGES:
        for file in sorted((packages / package).rglob("*.py")):
            if (path := file.relative_to(packages).as_posix()) not in before.sources:
                outside.setdefault(file.parent, path)
    assert len(outside) > 5
    for name, path in inside.items():
        with appended(packages / path, "\n# A comment.\n"):
            assert digest(packages, result) == before.digest, path
        with appended(packages / path, "\nEDITED = 1\n"):
            assert digest(packages, result) != before.digest, name
    for path in outside.values():
        with appended(packages / path, "\nEDITED = 1\n"):
            assert digest(packages, result) == before.digest, path


def test_sources_are_read_once_and_again_if_that_changes_what_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Processes remember the normal form of a source by its bytes; this test takes the steps of four processes."""
    module = "avs3d_bench.runtime.provenance"
    memory = tmp_path / "memory.json"
    monkeypatch.setattr(f"{module}._memory", lambda: memory)
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    parse, parsed = sys.modules[module]._parse_source, []
    monkeypatch.setattr(f"{module}._parse_source", lambda source: parsed.append(source) or parse(source))

    def by_another_process() -> tuple[Provenance, int]:
        parsed.clear()
        sys.modules[module]._remembered.cache_clear()
        provenance.cache_clear()
        return provenance("tar"), len(parsed)

    first, count = by_another_process()
    assert count >= 10
    assert by_another_process() == (first, 0)
    memory.write_text(memory.read_text()[:-9])
    assert by_another_process() == (first, count)
    monkeypatch.setattr(f"{module}._own_digest", lambda: "of a later version")
    assert by_another_process() == (first, count)
    monkeypatch.undo()
    sys.modules[module]._remembered.cache_clear()
    provenance.cache_clear()


METHODS = sorted(
    {f"baselines.{name.split('.')[1]}" for name in MODULES if name.startswith("baselines.")}
    - {f"baselines.{name}" for name in ("cli", "doctor", "networks", "oracle_errors", "reference_scores")}
)


@pytest.mark.slow
@pytest.mark.parametrize("result", sorted({*RESULTS, *METHODS}))
def test_listed_folders_import_nothing_that_is_not_listed(result: str) -> None:
    modules = {module_of(path) for path in provenance(result).sources if path.endswith(".py")}
    exceptions = NOT_COUNTED | ALSO_NOT_COUNTED.get(result, set())
    missing = {
        f"{name} imports {other}"
        for name in modules
        for other in edges(name) - modules
        if other not in exceptions and not other.startswith("avs3d_bench.scheduling.")
    }
    assert not missing


def module_of(path: str) -> str:
    return path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")


def test_what_is_left_out_exists() -> None:
    backends = {*BACKENDS, *(name for names in BACKENDS.values() for name in names)}
    named = {*LEFT_OUT, *backends, *NOT_COUNTED} - MODULES.keys()
    assert {name for name in named if not (ROOT / name.replace(".", "/")).is_dir()} == set()


def test_only_the_backends_that_are_chosen_count() -> None:
    for vision in VISION:
        for audio in ACOUSTIC:
            found = set(observation_provenance(EngineOptions(vision=vision, audio=audio)).sources)
            for name, entry in (VISION | ACOUSTIC).items():
                path = entry.partition(":")[0].replace(".", "/") + ".py"
                chosen = (vision, audio, *BUILT_ON.get(vision, ()))
                assert (path in found) == (name in chosen), (vision, audio, path)


@pytest.mark.parametrize("audio", ["soundspaces", "analytic"])
def test_sound_of_other_engines_does_not_depend_on_the_tracer_and_its_receivers(audio: str) -> None:
    def parts_of_tracer(engine: str) -> set[str]:
        return {name for name in observation_provenance(EngineOptions(audio=engine)).sources if "/tracer/" in name}

    assert parts_of_tracer(audio) == set()
    folder = "generators/acoustics/tracer"
    assert {f"{folder}/receivers/sofa.py", f"{folder}/late.py"} <= parts_of_tracer("tracer")


def test_libraries_are_found_from_the_imports() -> None:
    found = observation_provenance(EngineOptions(audio="analytic"))
    assert {"numpy", "scipy", "numba", "embreex", "xatlas", "soundfile"} <= set(found.libraries)
    assert {"pillow", "PyYAML", "opengl_basisu"} <= set(found.libraries)
    others = {"torch", "rich", "click", "distributed", "pytest", "habitat_sim", "rlr_audio_propagation"}
    assert not others & set(found.libraries)
    assert "rlr_audio_propagation" in observation_provenance(EngineOptions(audio="soundspaces")).libraries
    assert "torch" in provenance("baselines.echosegnet").libraries
    assert "torch" not in provenance("baselines.trivial:write_trivial").libraries
    record = ProvenanceRecord.of(found)
    assert record.digest == found.digest
    assert record.libraries == dict(found.libraries)


def test_versions_of_libraries_and_python_are_part_of_the_digest() -> None:
    one = Provenance({"a": "1"}, {"numpy": "2.0"}, "3.11")
    assert len({one.digest, Provenance({"a": "1"}, {"numpy": "2.1"}, "3.11").digest}) == 2
    assert len({one.digest, Provenance({"a": "1"}, {"numpy": "2.0"}, "3.12").digest}) == 2
    assert one.digest == Provenance({"a": "1"}, {"numpy": "2.0"}, "3.11").digest


# ---- a method of its own ---------------------------------------------------------------------------------------------


@pytest.fixture
def method(packages: Path) -> Any:
    """The provenance of a method with this source."""
    path = packages / "baselines/mine.py"

    def read(code: str) -> Provenance:
        path.write_text(code)
        return read_provenance(files_in(packages), ["baselines.mine:write_mine"])

    yield read
    path.unlink(missing_ok=True)


def test_a_method_that_is_not_listed_depends_on_its_module_and_the_contract(method: Any) -> None:
    assert folders_of("baselines.mine:write_mine") == (*CONTRACT, "baselines.mine")
    found = method("")
    assert {name for name in found.sources if not name.startswith("avs3d_bench/")} == {"baselines/mine.py"}
    assert "avs3d_bench/contract/schema/observation.py" in found.sources


def test_libraries_that_are_imported_by_name_or_missing_count(method: Any) -> None:
    before = set(method("").libraries)
    found = method(
        "import os, json, rich.table\nfrom importlib import import_module\nfrom . import oracle\n"
        "def f():\n    import_module('torch.hub')\n    try:\n        import no_such_library\n"
        "    except ImportError: ..."
    )
    assert set(found.libraries) == before | {"rich", "torch", "no_such_library"}
    assert found.libraries["no_such_library"] == "none"


def test_comments_docstrings_and_line_breaks_do_not_count_and_all_else_does(method: Any) -> None:
    plain = method("def f(a, b):\n    return a + b\n").digest
    assert method("'''A.'''\n\ndef f(a,\n      b):  # why\n    '''B.'''\n    return (a + b)\n").digest == plain
    others = [
        "def f(a, b):\n    return a - b\n",
        "def f(a, b=1):\n    return a + b\n",
        "def f(a, b):\n    return a + b + 0\n",
        "def g(a, b):\n    return a + b\n",
        "async def f(a, b):\n    return a + b\n",
        "def f(a, b):\n    return a + b\nX = 'b'\n",
        "def f(a, b):\n    return a + b\nX = b'b'\n",
        "@cache\ndef f(a, b):\n    return a + b\n",
        "def f(a, *b):\n    return a + b\n",
    ]
    assert len({plain, *(method(code).digest for code in others)}) == 1 + len(others)


def test_data_files_count(packages: Path) -> None:
    before = digest(packages, "baselines.listener")
    (packages / "baselines/listener/weights/table.json").write_text("{}")
    one = digest(packages, "baselines.listener")
    (packages / "baselines/listener/weights/table.json").write_text("[]")
    assert len({before, one, digest(packages, "baselines.listener")}) == 3
    (packages / "baselines/listener/weights/table.json").unlink()
    assert digest(packages, "baselines.listener") == before


def test_an_installation_a_copy_and_a_zip_file_have_the_same_digest(packages: Path, tmp_path: Path) -> None:
    archive = tmp_path / "wheel.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in sorted(packages.rglob("*.*")):
            file.write(path, path.relative_to(packages).as_posix())
    zipped = read_provenance(zipfile.Path(archive).joinpath, ["home"])
    assert zipped == read_provenance(files_in(packages), ["home"]) == provenance("home")


def test_what_does_not_exist_or_cannot_be_read_is_one_line(packages: Path, method: Any) -> None:
    for unknown in ("generators.observation.generate:generate_observation", "numpy", "baselines"):
        with pytest.raises(Avs3dError, match=rf"provenance of {unknown}: expected one of home, .*"):
            provenance(unknown)
    with pytest.raises(Avs3dError, match=r"baselines/gone: no such folder or module"):
        provenance("baselines.gone:f")
    with pytest.raises(Avs3dError, match=r"baselines/mine\.py: cannot be read as Python"):
        method("def f(:")


# ---- what is done with it --------------------------------------------------------------------------------------------


def test_workers_with_other_software_are_refused_in_one_line() -> None:
    run = {SOFTWARE: "a" * 64, "numpy": "2.4.6", "python": "3.11"}
    check_software(dict(run), run)
    with pytest.raises(UnfitError) as refused:
        check_software(run | {SOFTWARE: "b" * 64}, run)
    assert "bbbbbbbbbbbb, the run aaaaaaaaaaaa (the sources differ)" in str(refused.value)
    with pytest.raises(UnfitError) as refused:
        check_software(run | {SOFTWARE: "b" * 64, "numpy": "2.4.5"}, run)
    assert "bbbbbbbbbbbb, the run aaaaaaaaaaaa (numpy 2.4.5 instead of 2.4.6)" in str(refused.value)
    assert "\n" not in str(refused.value)
    with pytest.raises(UnfitError, match="numpy none instead of"):
        check_software({SOFTWARE: "a" * 64, "python": "3.11"}, run)


def generate(packages: Path, manifest: Path, out: Path, *more: str) -> tuple[int, str]:
    """Exit code and output of ``avs3d generate`` with the sources in ``packages``."""
    arguments = [str(manifest), "-o", str(out), "--audio", "analytic", "--frames", "3", "--size", "32", *more]
    command = [sys.executable, "-c", "from avs3d_bench.cli import main; main()", "generate", *arguments]
    command += ["--workers", "1", "--only", "part_1/*"]
    environment = os.environ | {"PYTHONPATH": str(packages), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=240, env=environment, cwd=out.parent
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A manifest, and a dataset of one small observation made from it."""
    folder = tmp_path_factory.mktemp("made")
    manifest, out = write_manifest(folder), folder / "out"
    code, output = generate(ROOT, manifest, out)
    assert code == 0, output
    assert "1 made, 0 kept, 0 failed" in output
    return manifest, out


@pytest.mark.slow
def test_an_observation_is_kept_while_its_software_is_the_same_and_refused_after_an_edit(
    packages: Path, made: tuple[Path, Path]
) -> None:
    manifest, out = made
    before = tree_digest(out)
    clips, runner = packages / "generators/acoustics/clips.py", packages / "generators/run/runner.py"
    texts = {path: path.read_text() for path in (clips, runner)}
    try:
        clips.write_text(texts[clips] + "\n# A comment.\n")
        runner.write_text(texts[runner] + "\nEDITED = 1\n")
        code, output = generate(packages, manifest, out)
        assert code == 0, output
        assert "0 made, 1 kept, 0 failed" in output
        clips.write_text(texts[clips] + "\nEDITED = 1\n")
        code, output = generate(packages, manifest, out)
        assert code == 2, output
        assert "its sources or libraries differ); choose another folder" in output
        assert "Traceback" not in output
        assert tree_digest(out) == before
    finally:
        for path, text in texts.items():
            path.write_text(text)


@pytest.mark.slow
def test_a_finished_observation_with_a_missing_or_cut_off_file_is_made_again(
    made: tuple[Path, Path], tmp_path: Path
) -> None:
    manifest, out = made[0], tmp_path / "out"
    shutil.copytree(made[1], out)
    before = tree_digest(out)
    observation = out / "part_1/box/kitchen/1"
    picture, size = observation / "input/frame_002.png", (observation / "input/frame_002.png").stat().st_size
    picture.write_bytes(b"")
    (observation / "sparse/0/points3D.bin").unlink()
    code, output = generate(ROOT, manifest, out)
    assert code == 0, output
    assert f"regenerated: input/frame_002.png has 0 bytes, expected {size:,} (and 1 more files)" in output
    assert "1 made, 0 kept, 0 failed" in output
    assert tree_digest(out) == before


@pytest.mark.slow
def test_damage_is_found_by_existence_size_and_kind(made: tuple[Path, Path], tmp_path: Path) -> None:
    folder = tmp_path / "1"
    shutil.copytree(made[1] / "part_1/box/kitchen/1", folder)
    record = read_observation(folder)
    assert record.sizes is not None
    assert set(record.sizes) == set(record.files)
    older = record.model_copy(update={"sizes": None})
    assert find_damage(folder, record) == find_damage(folder, older) == ""
    clip = folder / "audio_clips_mono/frame_0.wav"
    content = clip.read_bytes()
    clip.write_bytes(content[:-2])
    name = "audio_clips_mono/frame_0.wav"
    assert find_damage(folder, record) == f"{name} has {len(content) - 2:,} bytes, expected {len(content):,}"
    assert find_damage(folder, older) == ""
    clip.write_bytes(b"")
    assert find_damage(folder, older) == f"{name} is empty"
    clip.unlink()
    assert find_damage(folder, record) == find_damage(folder, older) == f"{name} is missing"
    clip.mkdir()
    assert find_damage(folder, record) == f"{name} is no regular file"


@pytest.mark.slow
def test_files_say_which_software_made_them(made: tuple[Path, Path], tmp_path: Path) -> None:
    dataset = Dataset(made[1])
    assert dataset.record is not None
    said = dataset.record.provenance
    assert said == ProvenanceRecord.of(observation_provenance(EngineOptions(audio="analytic")))
    write_trivial("all-black", dataset, tmp_path / "black")
    evaluation = evaluate(tmp_path / "black", made[1])
    scores = Scores.model_validate_json(evaluation.scores.model_dump_json())
    assert scores.avs3d_eval.provenance == ProvenanceRecord.of(provenance("scores"))
    assert scores.dataset.provenance == said
    assert scores.submission.provenance == ProvenanceRecord.of(provenance("baselines.trivial:write_trivial"))
    with open_submission(tmp_path / "black") as submission:
        write_report(tmp_path / "report.html", evaluation, dataset, submission)
    page = (tmp_path / "report.html").read_text()
    for record in (scores.avs3d_eval.provenance, scores.dataset.provenance, scores.submission.provenance):
        assert record is not None
        assert f"<code>{record.digest[:12]}</code>" in page


@pytest.mark.slow
def test_files_without_provenance_are_read_and_keep_their_bytes(made: tuple[Path, Path]) -> None:
    dataset = Dataset(made[1])
    assert dataset.record is not None
    plain = dataset.record.model_copy(update={"provenance": None, "digest": None})
    text = dump_json(plain)
    assert "provenance" not in text
    assert parse_record(text, DatasetRecord, "dataset.json") == plain
    record = SubmissionRecord(method="a", dataset="b", dataset_version="1")
    assert "provenance" not in dump_json(record)
    observation = read_observation(made[1] / "part_1/box/kitchen/1").model_copy(update={"sizes": None})
    assert '"sizes"' not in dump_json(observation)
    assert parse_record(dump_json(observation), ObservationRecord, "observation.json") == observation


def test_a_worker_of_another_machine_compares_its_software_before_it_does_anything(tmp_path: Path) -> None:
    source = read_manifest(write_manifest(tmp_path))
    plan = make_plans(source, GenerateOptions(audio="analytic", only=["part_1/*"]))[0]
    mine = plan.backends[SOFTWARE]
    assert mine == observation_provenance(EngineOptions(audio="analytic")).digest
    other = replace(plan, backends=plan.backends | {SOFTWARE: "0" * 64})
    assert other.digest != plan.digest
    place = RunTarget(tmp_path / "out", tmp_path / "cache", token="run")
    for work, more in ((prepare, (1,)), (make_observation, ())):
        with pytest.raises(UnfitError, match=f"has the software {mine[:12]}, the run 000000000000"):
            work(Context(0, lambda *_: None), other, place, *more)
    assert not (tmp_path / "out").exists()
