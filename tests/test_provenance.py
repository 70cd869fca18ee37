"""The digest of the software behind a result: its contents, its exceptions, and no reuse of outdated results."""

from __future__ import annotations

import copy
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import dump_json
from avs3d_bench.provenance import PACKAGES, SOFTWARE, Provenance, Sources, provenance
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.software import check_software
from avs3d_bench.scheduling.tasks import Context
from avs3d_bench.schema import DatasetRecord, ObservationRecord, ProvenanceRecord, SubmissionRecord, parse_record
from avs3d_bench.scores import Scores
from baselines.echosegnet.training_stage import TRAINING
from baselines.echosegnet.voting_stage import LIFTING
from baselines.trivial import write_trivial
from evaluators import evaluate, open_submission, write_report
from evaluators.score import SCORING
from generators.backends import OBSERVATION, observation_provenance, unused_backends
from generators.homes.cache import BUILDER
from generators.library.store import CLEANING
from generators.manifest import read_manifest
from generators.observation.tar_output import WRITER
from generators.options import EngineOptions, GenerateOptions
from generators.plan import make_plans
from generators.receivers import PARTS
from generators.run.dataset_record import read_observation
from generators.run.finished import find_damage
from generators.run.worker import RunTarget, make_observation, prepare
from tests.homes import tree_digest, write_manifest

ROOT = Path(__file__).parent.parent
TORCH = "baselines.echosegnet.rasteriser.torch_rasteriser:TorchRasteriser"
#: Result → the functions that make it, and what is certain not to run.
RESULTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "observation": (OBSERVATION, unused_backends(EngineOptions(audio="analytic"))),
    "tar": ((WRITER,), ()),
    "home": (BUILDER, ()),
    "training": ((*TRAINING, TORCH), ()),
    "lifting": ((*LIFTING, TORCH), ()),
    "cleaning": ((CLEANING,), ()),
}
#: Edited file → the results that depend on it; nothing else may change.
TABLE: dict[str, str] = {
    "avs3d_bench/__init__.py": "observation tar home training lifting cleaning",
    "avs3d_bench/errors.py": "observation tar home training lifting cleaning",
    "avs3d_bench/schema.py": "observation tar training lifting cleaning",
    "avs3d_bench/ply.py": "observation tar training lifting",
    "avs3d_bench/colmap.py": "observation tar training lifting",
    "avs3d_bench/cli.py": "",
    "avs3d_bench/parallel.py": "",
    "avs3d_bench/report.py": "",
    "avs3d_bench/exports/observation_tar.py": "tar",
    "avs3d_bench/exports/samples.py": "tar",
    "avs3d_bench/exports/shards.py": "",
    "avs3d_bench/exports/tar_format.py": "tar",
    "avs3d_bench/inspector/site.py": "",
    "avs3d_bench/scheduling/local.py": "",
    "avs3d_bench/validation/structure.py": "",
    "generators/paths/trajectory.py": "observation",
    "generators/placement/placement.py": "observation",
    "generators/observation.py": "observation",
    "generators/programme.py": "observation",
    "generators/sound_scene.py": "observation",
    "generators/recording/output.py": "observation tar",
    "generators/recording/tar_output.py": "tar",
    "generators/recording/scene_writer.py": "observation",
    "generators/recording/stems.py": "observation",
    "generators/recording/writer.py": "observation",
    "generators/sampling/sample.py": "",
    "generators/sealing/seal.py": "",
    "generators/run/runner.py": "",
    "generators/run/worker.py": "",
    "generators/run/progress.py": "",
    "generators/cli.py": "",
    "generators/acoustics/clips.py": "observation",
    "generators/acoustics/analytic.py": "observation",
    "generators/acoustics/soundspaces.py": "",
    "generators/acoustics/tracer/arrivals.py": "",
    "generators/acoustics/tracer/receivers/synthesis.py": "",
    "generators/acoustics/tracer/device/trace.py": "",
    "generators/vision/kernels.py": "observation",
    "generators/vision/embree.py": "observation",
    "generators/vision/habitat.py": "",
    "generators/core/tone.py": "observation home",
    "generators/lighting/bake.py": "observation home",
    "generators/scans/scan.py": "observation",
    "generators/apartments/floorplan.py": "observation home",
    "generators/apartments/interior/kitchen.py": "observation home",
    "generators/homes/store.py": "observation",
    "generators/homes/cache.py": "observation home",
    "generators/assets/textures/wood.py": "observation home",
    "generators/assets/furniture/seating.py": "observation home",
    "generators/assets/objects/clock.py": "observation",
    "generators/assets/objects/training/clocks.py": "observation",
    "generators/assets/synthesis/voices.py": "observation",
    "generators/assets/shapes.py": "observation home cleaning",
    "generators/library/mesh_cleaning.py": "observation cleaning",
    "generators/library/simplify.py": "observation cleaning",
    "generators/library/http.py": "",
    "baselines/oracle_errors.py": "",
    "baselines/networks/pixels.py": "",
    "baselines/trivial.py": "",
    "baselines/owod_bind/select.py": "",
    "baselines/listener/shards.py": "",
    "baselines/echosegnet/cache.py": "training lifting",
    "baselines/echosegnet/training_stage.py": "training",
    "baselines/echosegnet/voting_stage.py": "lifting",
    "baselines/echosegnet/pipeline.py": "",
    "baselines/echosegnet/train.py": "training",
    "baselines/echosegnet/densify.py": "training",
    "baselines/echosegnet/lift.py": "lifting",
    "baselines/echosegnet/rasteriser/contributions.py": "lifting",
    "baselines/echosegnet/gaussians.py": "training lifting",
    "baselines/echosegnet/rasteriser/torch_rasteriser.py": "training lifting",
    "baselines/echosegnet/rasteriser/gsplat_rasteriser.py": "",
    "baselines/echosegnet/aisrm.py": "",
    "evaluators/metrics.py": "",
    "evaluators/reading/structure.py": "",
    "evaluators/reporting/report.py": "",
}


def digests(sources: Sources) -> dict[str, str]:
    return {name: sources.provenance(roots, without=without).digest for name, (roots, without) in RESULTS.items()}


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages, to edit."""
    folder = tmp_path_factory.mktemp("packages")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture(scope="module")
def known(packages: Path) -> Sources:
    sources = Sources([str(packages)])
    digests(sources)
    return sources


def reread(known: Sources, module: str) -> Sources:
    """The sources with one of them read again."""
    fresh = copy.copy(known)
    fresh._modules = {name: content for name, content in known._modules.items() if name != module}
    return fresh


@pytest.mark.slow
def test_an_edit_changes_every_result_that_depends_on_it_and_no_other(packages: Path, known: Sources) -> None:
    before = digests(known)
    assert len(set(before.values())) == len(before)
    found = {}
    for file in TABLE:
        path = packages / file
        text = path.read_text()
        module = file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        path.write_text(text + "\nEDITED = 1\n")
        after = digests(reread(known, module))
        path.write_text(text + "\n# A comment.\n")
        assert digests(reread(known, module)) == before, file
        path.write_text(text)
        found[file] = " ".join(name for name in RESULTS if after[name] != before[name])
    assert found == TABLE
    assert digests(Sources([str(packages)])) == before


@pytest.mark.parametrize("audio", ["soundspaces", "analytic"])
def test_sound_of_other_engines_does_not_depend_on_the_tracer_and_its_receivers(audio: str) -> None:
    def parts_of_tracer(engine: str) -> set[str]:
        return {name for name in observation_provenance(EngineOptions(audio=engine)).sources if ".tracer" in name}

    assert parts_of_tracer(audio) == set()
    named = {part.partition(":")[0] for part in PARTS.values()}
    assert {*named, "generators.acoustics.tracer.receivers.sofa", "generators.acoustics.tracer.late"} <= (
        parts_of_tracer("tracer")
    )


def test_the_table_has_a_file_of_every_folder() -> None:
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if path.name != "__init__.py"
    }
    assert folders == {file.rpartition("/")[0] for file in TABLE}


def test_the_installation_has_the_digests_of_its_sources(packages: Path, known: Sources) -> None:
    roots, without = RESULTS["home"]
    assert provenance(*roots, without=without).digest == known.provenance(roots, without=without).digest


def test_libraries_are_found_from_the_imports() -> None:
    roots, without = RESULTS["observation"]
    found = provenance(*roots, without=without)
    assert {"numpy", "scipy", "numba", "embreex", "xatlas", "soundfile"} <= set(found.libraries)
    assert {"opencv-python-headless", "pillow", "PyYAML"} & set(found.libraries)
    assert not {"torch", "rich", "click", "distributed", "pytest"} & set(found.libraries)
    assert "torch" in provenance(*TRAINING).libraries
    record = ProvenanceRecord.of(found)
    assert record.digest == found.digest
    assert record.libraries == dict(found.libraries)


def test_versions_of_libraries_and_python_are_part_of_the_digest() -> None:
    one = Provenance({"a": "1"}, {"numpy": "2.0"}, "3.11")
    assert len({one.digest, Provenance({"a": "1"}, {"numpy": "2.1"}, "3.11").digest}) == 2
    assert len({one.digest, Provenance({"a": "1"}, {"numpy": "2.0"}, "3.12").digest}) == 2
    assert one.digest == Provenance({"a": "1"}, {"numpy": "2.0"}, "3.11").digest


# ---- what is imported ------------------------------------------------------------------------------------------------

TREE = {
    "generators/__init__.py": "tar",
    "generators/main.py": "",
    "generators/a/__init__.py": "from generators.a import inside",
    "generators/a/inside.py": "",
    "generators/a/b.py": "NAME = 1",
    "generators/a/c.py": "",
    "generators/lazy/__init__.py": """
        from typing import TYPE_CHECKING
        if TYPE_CHECKING:
            from generators.lazy.one import first
            from generators.lazy.two import second
        def __getattr__(name): ...
    """,
    "generators/lazy/one.py": "first = 1",
    "generators/lazy/two.py": "second = 2",
    "generators/stub/__init__.py": "import lazy_loader\n__getattr__, _ = lazy_loader.attach_stub(__name__, __file__)",
    "generators/stub/__init__.pyi": "from .one import first\nfrom .two import second",
    "generators/stub/one.py": "first = 1",
    "generators/stub/two.py": "second = 2",
}
PACKAGE_A = {"generators.a", "generators.a.inside"}


def write_tree(folder: Path, files: Mapping[str, str]) -> Path:
    for name, text in (TREE | dict(files)).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = text.split("\n")
        indent = min((len(line) - len(line.lstrip()) for line in lines if line.strip()), default=0)
        path.write_text("\n".join(line[indent:] for line in lines))
    return folder


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("import generators.a.b", PACKAGE_A | {"generators.a.b"}),
        ("from generators.a.b import NAME", PACKAGE_A | {"generators.a.b"}),
        ("from generators.a import b", PACKAGE_A | {"generators.a.b"}),
        ("from .a import b as other", PACKAGE_A | {"generators.a.b"}),
        ("from . import a", PACKAGE_A),
        ("from .a.b import *", PACKAGE_A | {"generators.a.b"}),
        ("def f():\n    from generators.a import b", PACKAGE_A | {"generators.a.b"}),
        ("class A:\n    def f(self):\n        if f():\n            from .a import c", PACKAGE_A | {"generators.a.c"}),
        ("try:\n    import generators.a.c\nexcept ImportError: pass", PACKAGE_A | {"generators.a.c"}),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import generators.a.b", set()),
        ("import typing\nif typing.TYPE_CHECKING:\n    import generators.a.b\nelse:\n    import generators.a.c",
         PACKAGE_A | {"generators.a.c"}),
        ("from importlib import import_module\nimport_module('generators.a.b')", PACKAGE_A | {"generators.a.b"}),
        ("TABLE = {'b': 'generators.a.b:NAME'}", PACKAGE_A | {"generators.a.b"}),
        ("'''It is like generators.a.b.'''\n'generators.nowhere'", set()),
        ("from generators.lazy import first", {"generators.lazy", "generators.lazy.one"}),
        ("from generators.stub import second", {"generators.stub", "generators.stub.two"}),
        ("from generators import stub", {"generators.stub", "generators.stub.one", "generators.stub.two"}),
        ("import generators.lazy.two", {"generators.lazy", "generators.lazy.two"}),
        ("import numpy", set()),
    ],
)  # fmt: skip
def test_what_a_module_imports_is_found_from_its_source(tmp_path: Path, statement: str, expected: set[str]) -> None:
    write_tree(tmp_path, {"generators/main.py": statement})
    found = Sources([str(tmp_path)]).provenance(["generators.main:f"])
    assert set(found.sources) == expected | {"generators", "generators.main"}


def test_libraries_that_are_imported_by_name_or_missing_count(tmp_path: Path) -> None:
    code = "import os, json, yaml\nfrom importlib import import_module\n_NAME = 'numpy'\n"
    code += (
        "import_module(_NAME)\nimport_module('scipy.signal')\ntry:\n    import no_such_library\nexcept ImportError: ..."
    )
    write_tree(tmp_path, {"generators/main.py": code})
    found = Sources([str(tmp_path)]).provenance(["generators.main"])
    assert set(found.libraries) == {"PyYAML", "numpy", "scipy", "no_such_library"}
    assert found.libraries["no_such_library"] == "none"


def test_entry_points_of_a_group_count_where_they_are_looked_up(tmp_path: Path) -> None:
    code = "from importlib.metadata import entry_points\nentry_points(group='avs3d.doctor')"
    write_tree(tmp_path, {"generators/main.py": code, "generators/run/__init__.py": "", "generators/run/doctor.py": ""})
    assert "generators.run.doctor" in Sources([str(tmp_path)]).provenance(["generators.main"]).sources


def test_data_files_that_a_module_names_count(tmp_path: Path) -> None:
    code = "from importlib.resources import files\nfiles('generators').joinpath('templates', 'materials.json')"
    write_tree(tmp_path, {"generators/main.py": code, "generators/templates/materials.json": "{}"})
    (tmp_path / "generators" / "other.json").write_text("{}")
    before = Sources([str(tmp_path)]).provenance(["generators.main"])
    assert set(before.sources) == {"generators", "generators.main", "generators/templates/materials.json"}
    (tmp_path / "generators" / "other.json").write_text("[]")
    assert Sources([str(tmp_path)]).provenance(["generators.main"]).digest == before.digest
    (tmp_path / "generators" / "templates" / "materials.json").write_text("[]")
    assert Sources([str(tmp_path)]).provenance(["generators.main"]).digest != before.digest


def test_comments_docstrings_and_line_breaks_do_not_count_and_all_else_does(tmp_path: Path) -> None:
    def digest(code: str) -> str:
        write_tree(tmp_path, {"generators/main.py": code})
        return Sources([str(tmp_path)]).provenance(["generators.main"]).digest

    plain = digest("def f(a, b):\n    return a + b\n")
    assert digest("'''A.'''\n\ndef f(a,\n      b):  # why\n    '''B.'''\n    return (a + b)\n") == plain
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
    assert len({plain, *map(digest, others)}) == 1 + len(others)


def test_a_zip_file_and_a_folder_have_the_same_digest(tmp_path: Path) -> None:
    code = "from generators.a import b\nfrom generators.stub import first\nOPEN = 'materials.json'"
    folder = write_tree(tmp_path / "folder", {"generators/main.py": code, "generators/materials.json": "{}"})
    archive = tmp_path / "wheel.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in sorted(folder.rglob("*.*")):
            file.write(path, path.relative_to(folder).as_posix())
    zipped, plain = (Sources([str(path)]).provenance(["generators.main"]) for path in (archive, folder))
    assert "generators/materials.json" in plain.sources
    assert "generators.stub.one" in plain.sources
    assert zipped == plain


def test_what_does_not_exist_or_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    write_tree(tmp_path, {"generators/main.py": "def f(:"})
    sources = Sources([str(tmp_path)])
    with pytest.raises(Avs3dError, match=r"no module generators\.gone"):
        sources.provenance(["generators.gone:f"])
    with pytest.raises(Avs3dError, match=r"generators\.main: its source cannot be read"):
        sources.provenance(["generators.main"])


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
    assert f"made again: input/frame_002.png has 0 bytes, expected {size:,} (and 1 more files)" in output
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


def test_files_say_which_software_made_them(made: tuple[Path, Path], tmp_path: Path) -> None:
    dataset = Dataset(made[1])
    assert dataset.record is not None
    said = dataset.record.provenance
    assert said == ProvenanceRecord.of(observation_provenance(EngineOptions(audio="analytic")))
    write_trivial("all-black", dataset, tmp_path / "black")
    evaluation = evaluate(tmp_path / "black", made[1])
    scores = Scores.model_validate_json(evaluation.scores.model_dump_json())
    assert scores.avs3d_eval.provenance == ProvenanceRecord.of(provenance(SCORING))
    assert scores.dataset.provenance == said
    assert scores.submission.provenance == ProvenanceRecord.of(provenance("baselines.trivial:write_trivial"))
    with open_submission(tmp_path / "black") as submission:
        write_report(tmp_path / "report.html", evaluation, dataset, submission)
    page = (tmp_path / "report.html").read_text()
    for record in (scores.avs3d_eval.provenance, scores.dataset.provenance, scores.submission.provenance):
        assert record is not None
        assert f"<code>{record.digest[:12]}</code>" in page


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
