"""The public names of the packages: seen by dir(), help() and completion, imported on first use and not before."""

from __future__ import annotations

import ast
import importlib
import inspect
import pydoc
import subprocess
import sys
from pathlib import Path

import pytest

import avs3d_bench
import evaluators
from avs3d_bench import UsageError, cli
from avs3d_bench.errors import did_you_mean, near_names
from avs3d_bench.runtime.provenance import provenance

ROOT = Path(__file__).parents[2]
#: Package → names that must be public; there may be more.
PUBLIC = {
    "avs3d_bench": {"Dataset", "Observation", "Frame", "SubmissionWriter", "validate", "UsageError", "geometry"},
    "evaluators": {"evaluate", "check", "metrics", "check_submission", "open_submission", "write_report"}
    | {"InvalidSubmission", "write_leaderboard"},
    "evaluators.metrics": {"evaluate", "Accumulator", "avsbench", "ref_avs", "avss", "combo", "pointing"},
    "generators.acoustics": {"Room", "Tracer", "SoundSpaces", "Analytic", "Rir", "SphericalHead", "SofaHead", "Omni"}
    | {"Ambisonics", "Array", "Arrivals", "Directivity", "habitat"},
    "generators": {
        "read_manifest",
        "generate",
        "acoustics",
        "Home",
        "HomeScene",
        "Renderer",
        "RenderedView",
        "objects",
    },
    "baselines": {"echosegnet", "oracle", "trivial", "owod_bind", "denseav", "foundation", "listener"},
    "baselines.echosegnet": {"write_echosegnet", "Settings", "predict"},
    "baselines.owod_bind": {"write_owod_bind", "load_owod_bind"},
    "baselines.foundation": {"write_foundation", "load_foundation"},
    "baselines.listener": {"Listener", "train", "load_listener", "load_method", "write_listener"},
    "avs3d_bench.exports": {"AVS3DDataset", "write_webdataset", "write_croissant", "waveform"},
}
#: Public names whose module needs an extra.
NEEDS = {
    "baselines.echosegnet": "torch",
    "baselines.owod_bind": "torch",
    "baselines.foundation": "torch",
    "baselines.listener": "lightning_fabric",
    "avs3d_bench.exports": "torch",
    "generators": "trimesh",
}


def stub_names(package: str) -> list[str]:
    """The names that a package's stub imports."""
    stub = Path(str(importlib.import_module(package).__file__)).with_suffix(".pyi")
    tree = ast.parse(stub.read_text())
    return [alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names]


@pytest.mark.parametrize("package", PUBLIC)
def test_dir_lists_what_the_stub_declares_and_nothing_else(package: str) -> None:
    module = importlib.import_module(package)
    names = stub_names(package)
    assert len(names) == len(set(names))
    assert set(dir(module)) == set(module.__all__) == set(names)
    assert set(names) >= PUBLIC[package]


@pytest.mark.parametrize("package", PUBLIC)
def test_every_public_name_can_be_had_and_has_a_docstring(package: str) -> None:
    if package in NEEDS:
        pytest.importorskip(NEEDS[package])
    module = importlib.import_module(package)
    for name in dir(module):
        assert inspect.getdoc(getattr(module, name)), f"{package}.{name} has no docstring"
    with pytest.raises(AttributeError, match="no_such_name"):
        module.no_such_name  # noqa: B018


def test_every_package_with_public_names_is_in_the_table() -> None:
    stubs = {path.parent.relative_to(ROOT).as_posix().replace("/", ".") for path in ROOT.glob("*/**/__init__.pyi")}
    packages = ("avs3d_bench", "evaluators", "generators", "baselines")
    assert {stub for stub in stubs if stub.split(".")[0] in packages} == set(PUBLIC)


def test_importing_the_packages_imports_none_of_their_modules_and_no_library_but_the_loader() -> None:
    code = "import sys; before = set(sys.modules)\n"
    code += "import avs3d_bench, baselines, evaluators, generators, baselines.echosegnet, avs3d_bench.exports\n"
    code += "print(*{m for m in set(sys.modules) - before if m.partition('.')[0] not in sys.stdlib_module_names})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert set(done.stdout.split()) == {
        *("avs3d_bench", "baselines", "evaluators", "generators", "baselines.echosegnet", "avs3d_bench.exports"),
        "lazy_loader",
    }


def test_a_function_is_not_replaced_by_the_module_of_its_name() -> None:
    code = "import avs3d_bench.validate, avs3d_bench; print(callable(avs3d_bench.validate))\n"
    code += "from avs3d_bench import validate; print(callable(validate))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["True", "True"]


def test_help_shows_the_public_functions_with_their_signatures() -> None:
    # Since Python 3.13 each parameter of a long signature has a line of its own.
    text = "".join(pydoc.plain(pydoc.render_doc(evaluators)).split())
    assert "evaluate(submission:'str|Path|Predictions|Method',dataset:'str|Path|Dataset'" in text
    assert "check_submission(path:'str|Path'" in text
    assert "classInvalidSubmission" in text


def test_names_that_existed_keep_their_meaning() -> None:
    from evaluators import check, check_submission, evaluate
    from evaluators.score import evaluate as defined

    assert evaluate is defined
    assert check is check_submission
    assert cli.__version__ == avs3d_bench.__version__ == "0.1.0"


def test_the_loader_of_names_is_no_part_of_a_digest() -> None:
    assert "lazy_loader" not in {name.replace("-", "_") for name in provenance("scores").libraries}


@pytest.mark.parametrize(
    ("value", "known", "end"),
    [
        ("microwve", ["clock", "microwave"], "; did you mean 'microwave'?"),
        ("kitchen", ["part_1/a/bathroom/1", "part_1/a/kitchen/1"], "; did you mean 'part_1/a/kitchen/1'?"),
        ("a/kitchen/", ["part_1/a/bathroom/1", "part_1/a/kitchen/1"], "; did you mean 'part_1/a/kitchen/1'?"),
        ("kit", ["part_1/a/kitchen/1"], ""),
        ("gen", ["eval", "generate"], "; did you mean 'generate'?"),
        ("hf", ["card", "huggingface"], "; did you mean 'huggingface'?"),
        ("fh", ["card", "huggingface"], ""),
        ("", ["a"], ""),
        ("m" * 100, ["m" * 100 + "n"], ""),
        (7, ["7"], ""),
        ("x", [], ""),
    ],
)
def test_unknown_names_are_told_with_the_nearest_known_one(value: object, known: list[str], end: str) -> None:
    assert did_you_mean(value, known) == end
    assert did_you_mean(value, known, otherwise="; none") == (end or "; none")


def test_as_many_near_names_as_asked_for_are_named() -> None:
    known = ["part_1/a/kitchen/1", "part_1/a/kitchen/2", "part_2/b/kitchen/1", "part_2/b/bathroom/1"]
    assert near_names("kitchen", known, 2) == known[:2]
    assert near_names("part_1/a/kitchen/3", known, 2)[0] in known[:2]
    assert did_you_mean("kitchen", known, count=2) == f"; did you mean '{known[0]}' or '{known[1]}'?"
    assert isinstance(UsageError("a"), avs3d_bench.Avs3dError)
