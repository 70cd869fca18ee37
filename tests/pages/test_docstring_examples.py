"""Every public name has an example in its docstring, where the API reference shows it; all of them run.

They see what a reader sees: the public names of the package, numpy as ``np``, and a folder with what `make demo` writes
into data/, small.
"""

from __future__ import annotations

import doctest
import importlib
import importlib.util
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from avs3d_bench.dataset import Dataset
from avs3d_bench.formats.files import read_json, sha256_bytes, write_json
from baselines.oracle import write_oracle
from baselines.trivial import write_trivial
from evaluators import evaluate
from generators import objects
from tests.pages.test_public_face import NEEDS, PUBLIC, stub_names
from tests.support import homes, sofa_files, tiny, tiny_scenes
from tests.support.here import generated_here

ROOT = Path(__file__).parents[2]
NAMES = [
    *((package, name) for package in PUBLIC for name in stub_names(package)),
    *(("generators.objects", name) for name in objects.__all__),
]
#: Names that need an extra, beside those of `NEEDS`.
NEEDED = NEEDS | {"generators.acoustics.SoundSpaces": "rlr_audio_propagation"}
#: Packages and names whose examples take long, or need networks.
SLOW = {
    "baselines.echosegnet", "baselines.foundation", "baselines.listener", "baselines.owod_bind",
    ("baselines", "echosegnet"), ("baselines", "foundation"), ("baselines", "listener"), ("baselines", "owod_bind"),
    ("avs3d_bench.exports", "write_huggingface"),
    ("generators", "Outcome"),
}  # fmt: skip
#: Packages of whose modules every function has an example, but those that begin so, which other functions use.
WHOLE = ("avs3d_bench", "evaluators.metrics", "generators", "generators.acoustics")
UNDER_THE_HOOD = ("encode_", "decode_", "check_", "is_binary")
#: Package → what its examples may use without a word.
FACES: dict[str, dict[str, Any]] = {}


def face(package: str) -> dict[str, Any]:
    """The public names of a package, and numpy."""
    if package not in FACES:
        module = importlib.import_module(package)
        FACES[package] = {name: getattr(module, name) for name in module.__all__} | {"np": np}
    return FACES[package]


def is_installed(package: str, name: str) -> bool:
    """Whether the extra that a name needs is there."""
    needed = [NEEDED[above] for above in (package, f"{package}.{name}") if above in NEEDED]
    return all(importlib.util.find_spec(one) is not None for one in needed)


INSTALLED = [each for each in NAMES if is_installed(*each)]


def described(package: str, name: str) -> Any:
    """The thing of that name."""
    return getattr(importlib.import_module(package), name)


def examples(thing: Any, name: str, globs: dict[str, Any]) -> list[doctest.DocTest]:
    """Of its docstring and those of its parts; of a module those of what is defined there."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    module = thing if isinstance(thing, ModuleType) else inspect.getmodule(thing)
    own = globs | ({n: v for n, v in vars(thing).items() if not n.startswith("_")} if module is thing else {})
    return [test for test in finder.find(thing, name, module=module, globs=own) if test.examples]


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the examples run."""
    folder = tmp_path_factory.mktemp("desk")
    root = tiny.write_dataset(folder / "data/demo", frames=9, keys=tiny.DEMO)
    record = read_json(root / "dataset.json")
    manifest = record["manifest"].replace("name: tiny", "name: demo")
    changed = {"name": "demo", "manifest": manifest, "manifest_sha256": sha256_bytes(manifest.encode())}
    tiny.write_sealed(root, record | changed)
    dataset = Dataset(root)
    (folder / "data/demo-scores").mkdir()
    for name in ("oracle", "centre-box"):
        path = folder / "data/demo-submissions" / name
        write_oracle(dataset, path) if name == "oracle" else write_trivial(name, dataset, path)
        write_json(folder / f"data/demo-scores/{name}.json", evaluate(path, dataset).scores)
    tiny_scenes.write_part_3(folder / "data/listen", frames=6, stems=True)
    homes.write_manifest(folder, name="room").rename(folder / "room.yaml")
    points = sofa_files.fibonacci(64)
    sofa_files.write(folder / "head.sofa", points, sofa_files.sphere_impulses(points, sofa_files.RATE))
    return folder


@pytest.fixture(scope="module")
def weights(desk: Path) -> Iterator[Path]:
    """The same, with weights of small networks in weights/."""
    from tests.support import tiny_foundation, tiny_listener, tiny_models

    folder = desk / "weights"
    folder.mkdir()
    tiny_listener.write_weights(folder)
    with pytest.MonkeyPatch.context() as patch:
        tiny_models.use_vit_tower(patch)
        tiny_models.write_owlv2(folder / "owlv2")
        tiny_models.write_sam(folder / "sam")
        tiny_models.write_pe_av(folder / "pe-av")
        tiny_foundation.write_clap(folder / "clap")
        tiny_foundation.write_sam3(folder / "sam3")
        yield desk


def cases(slow: bool) -> list[Any]:
    """Names whose examples take long, or the others."""
    return [pytest.param(*each, id=".".join(each)) for each in NAMES if (each[0] in SLOW or each in SLOW) == slow]


def run(package: str, name: str) -> None:
    """Run the examples of a name in this folder."""
    if (package, name) not in INSTALLED:
        pytest.skip("an extra is not installed")
    found = examples(described(package, name), name, face(package))
    assert any(not one.options.get(doctest.SKIP) for test in found for one in test.examples), f"{name} has no example"
    said: list[str] = []
    runner = doctest.DocTestRunner(verbose=False)
    with generated_here():
        for test in found:
            runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)


@pytest.mark.parametrize(("package", "name"), cases(slow=False))
def test_a_public_name_has_an_example_that_runs(
    package: str, name: str, desk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(desk)
    run(package, name)


@pytest.mark.slow
@pytest.mark.parametrize(("package", "name"), cases(slow=True))
def test_a_public_name_has_an_example_that_takes_long(
    package: str, name: str, weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(weights)
    run(package, name)


def shown() -> set[str]:
    """What the pages of the reference show: modules, their members (all of them: ``module.*``), classes, functions."""
    found: set[str] = set()
    directive = re.compile(r"^::: (\S+)(?:\n    options:\n      members: (.+))?", re.M)
    for page in (ROOT / "docs/reference").glob("*.md"):
        for target, members in directive.findall(page.read_text(encoding="utf-8")):
            names = members.strip("[]").split(", ") if members else ["*"]
            found |= {target, *(f"{target}.{name}" for name in names)}
    return found


def test_the_reference_shows_every_public_name() -> None:
    pages = shown()
    for package, name in INSTALLED:
        thing = described(package, name)
        if isinstance(thing, ModuleType):
            assert thing.__name__ in pages, f"{thing.__name__} is on no page"
            continue
        module = thing.__module__
        assert {f"{module}.{thing.__qualname__}", f"{module}.*"} & pages, f"{module}.{thing.__qualname__} is on no page"


def test_every_function_of_a_public_module_is_used_in_an_example() -> None:
    modules = [each for each in INSTALLED if each[0] in WHOLE and isinstance(described(*each), ModuleType)]
    files = [each for each in modules if not hasattr(described(*each), "__path__")]  # a package has names of its own
    assert len(files) > 8
    for package, name in files:
        module = described(package, name)
        text = "".join(one.source + one.want for test in examples(module, name, {}) for one in test.examples)
        for part, thing in vars(module).items():
            own = (inspect.isfunction(thing) or inspect.isclass(thing)) and thing.__module__ == module.__name__
            if own and not part.startswith(("_", *UNDER_THE_HOOD)):
                assert re.search(rf"\b{part}\b", text), f"no example of {module.__name__} uses {part}"


def test_every_method_of_a_public_class_is_described() -> None:
    for package, name in INSTALLED:
        thing = described(package, name)
        for part in vars(thing) if inspect.isclass(thing) else ():
            if not part.startswith("_") and inspect.isfunction(inspect.getattr_static(thing, part)):
                assert inspect.getdoc(getattr(thing, part)), f"{package}.{name}.{part} is not described"
