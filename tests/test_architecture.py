"""Imports flow one way: the contract imports none of the others; the others import it, and never one another."""

from __future__ import annotations

import ast
import graphlib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")
FORBIDDEN = {
    package: set(PACKAGES) - {package} - ({"avs3d_bench"} if package != "avs3d_bench" else set())
    for package in PACKAGES
}


@cache
def statements(path: Path) -> list[ast.stmt]:
    """The imports and classes of a file, anywhere in it; those inside functions and for type checkers, too."""
    # Not by `ast.walk`: most nodes of a file are in expressions, which have neither.
    found, left = [], [*ast.parse(path.read_text(encoding="utf-8")).body]
    while left:
        node = left.pop()
        if isinstance(node, ast.Import | ast.ImportFrom | ast.ClassDef):
            found.append(node)
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            left += getattr(node, block, [])
    return found


def imported(path: Path) -> set[str]:
    """Top-level packages that a file imports, anywhere in it; relative imports stay inside their package."""
    found: set[str] = set()
    for node in statements(path):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
    return found


def test_the_rule_is_the_one_of_the_design():
    assert FORBIDDEN["avs3d_bench"] == {"generators", "evaluators", "baselines"}
    assert FORBIDDEN["generators"] == {"evaluators", "baselines"}


@pytest.mark.parametrize("package", [p for p in PACKAGES if (ROOT / p / "__init__.py").exists()])
def test_imports_flow_one_way(package: str):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        wrong = imported(path) & FORBIDDEN[package]
        assert not wrong, f"{path.relative_to(ROOT)} imports {', '.join(sorted(wrong))}"


#: What the core install has (pyproject, `dependencies`); everything else belongs to an extra.
CORE = {"numpy", "scipy", "pydantic", "click", "soundfile", "cv2", "yaml", "rich", "jinja2", "lazy_loader"}
CORE |= {"avs3d_bench"}


def at_the_top(path: Path) -> set[str]:
    """Top-level packages that importing a file imports: what stands outside of functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [ast.Pass()]
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
    return found


#: Packages of the contract that may use extras, but only inside functions: importing them needs the core alone.
LAZY = ("exports", "inspector", "scheduling")
#: Modules that may, too, and what they use.
LAZY_MODULES = {"contract/score_frames.py": {"pandas"}}


def imported_at_once(tree: ast.AST) -> set[str]:
    """Top-level packages imported as soon as the module is; what stands in functions or is for type checkers is not."""
    found: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            for other in node.orelse:
                found |= imported_at_once(ast.Module([other], []))
        elif isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module.split(".")[0]} if node.level == 0 and node.module else set()
        else:
            found |= imported_at_once(node)
    return found


def test_the_contract_needs_the_core_install_only():
    import sys

    for path in sorted((ROOT / "avs3d_bench").rglob("*.py")):
        inside = path.relative_to(ROOT / "avs3d_bench")
        at_once = imported_at_once(ast.parse(path.read_text(encoding="utf-8")))
        found = at_once if inside.parts[0] in LAZY else imported(path)
        found -= LAZY_MODULES.get(inside.as_posix(), set()) - at_once
        foreign = found - CORE - set(sys.stdlib_module_names)
        assert not foreign, f"{path.relative_to(ROOT)} imports {', '.join(sorted(foreign))}, which the core lacks"


def test_imports_inside_functions_are_told_from_the_others():
    code = """
import numpy
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    import torch
else:
    import yaml
try:
    import av
except ImportError:
    pass
class A:
    import viser
    def f(self):
        import datasets
"""
    assert imported_at_once(ast.parse(code)) == {"numpy", "typing", "yaml", "av", "viser"}


#: Who may import whom inside a package: folder or module of the top → what it imports, each from above it in this
#: table. Read from top to bottom, it is the architecture.
HOUSE = {
    "avs3d_bench": {
        "errors": "",
        "geometry": "errors",
        "text": "",
        "runtime": "errors",
        "contract": "errors geometry text runtime",
        "formats": "errors geometry text runtime contract",
        "dataset": "errors geometry contract formats",
        "submission": "errors contract formats dataset",
        "method": "errors runtime contract dataset submission",
        "measures": "errors geometry contract dataset",
        "commands": "errors text contract formats",
        "sealing": "errors runtime contract formats dataset commands",
        "validation": "errors geometry runtime contract formats dataset measures commands sealing",
        "validate": "commands validation",
        "scheduling": "errors runtime contract formats commands",
        "exports": "errors geometry runtime contract formats dataset measures commands sealing",
        "inspector": "errors geometry text runtime contract formats dataset submission measures commands",
        "cli": "errors text runtime formats dataset commands validation validate exports inspector",
        "__main__": "cli",
    },
    "generators": {
        "core": "",
        "assets": "core",
        "lighting": "core",
        "vision": "core assets lighting",
        "acoustics": "core",
        "options": "core acoustics",
        "backends": "core vision acoustics options",
        "objects": "core assets",
        "apartments": "core assets",
        "scans": "core assets acoustics",
        "placement": "core assets",
        "paths": "core assets placement",
        "scenes": "core assets lighting vision acoustics options backends placement paths",
        "manifest": "core options",
        "library": "core assets lighting vision manifest",
        "plan": "core assets options backends scans manifest library",
        "homes": "core assets lighting apartments scans plan",
        "observation": "core assets vision acoustics options backends objects placement paths scenes manifest library "
        "plan homes",
        "run": "core assets vision acoustics options backends scans scenes manifest library plan homes observation",
        "sampling": "core assets options apartments placement paths manifest library plan observation",
        "surveying": "core assets scans vision options placement manifest library plan observation sampling",
        "cli": "core options manifest plan run",
        "sealing": "options backends manifest plan observation run sampling cli",
        "home": "core lighting options scans scenes manifest plan homes surveying",
        "responses": "core acoustics options scenes manifest plan homes observation run",
    },
    "evaluators": {
        "metrics": "",
        "reading": "metrics",
        "statistics": "metrics reading",
        "references": "metrics",
        "protocols": "metrics reading statistics references",
        "summary": "metrics reading statistics protocols",
        "score": "reading protocols summary",
        "reporting": "metrics reading statistics protocols summary",
        "verify": "reading score reporting",
        "competition": "reading score",
        "questions": "statistics",
        "cli": "reading statistics score reporting verify",
    },
    "baselines": {
        "networks": "",
        "doctor": "networks",
        "oracle_errors": "",
        "oracle": "oracle_errors",
        "deaf": "oracle",
        "trivial": "",
        "sound_control": "",
        "owod_bind": "networks sound_control",
        "denseav": "networks sound_control",
        "listener": "networks sound_control",
        "echosegnet": "oracle_errors oracle sound_control",
        "foundation": "networks owod_bind sound_control echosegnet",
        "direction_alone": "listener echosegnet sound_control",
        "references": "oracle echosegnet",
        "reference_scores": "",
        "questions": "echosegnet references",
        "questions_inspect": "questions",
        "cli": "oracle_errors oracle deaf trivial owod_bind denseav foundation listener echosegnet direction_alone "
        "references reference_scores questions",
    },
}
#: Folders of avs3d_bench that use each other: none.
FOLDERS = ("exports", "inspector", "scheduling", "validation")


def modules(package: str) -> dict[str, Path]:
    """Dotted name → file of every module of a package."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = {name: path for package in PACKAGES for name, path in modules(package).items()}


@cache
def edges(name: str) -> set[str]:
    """Modules of ours that a module imports, anywhere in it: inside functions and for type checkers, too."""
    found = set()
    for node in statements(MODULES[name]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in MODULES else node.module)
        elif isinstance(node, ast.ImportFrom):
            raise AssertionError(f"{name}: a relative import; this project writes them in full")
    return (found & MODULES.keys()) - {name}


def test_no_module_imports_itself_in_a_circle() -> None:
    order = graphlib.TopologicalSorter({name: edges(name) for name in MODULES})
    try:
        order.prepare()
    except graphlib.CycleError as error:
        pytest.fail("a circle of imports: " + " → ".join(reversed(error.args[1])))


@pytest.mark.parametrize("package", HOUSE)
def test_folders_import_what_the_table_says(package: str) -> None:
    table = {name: set(allowed.split()) for name, allowed in HOUSE[package].items()}
    found: dict[str, set[str]] = {name: set() for name in table}
    for name in modules(package):
        if name == package:
            continue  # its public names come from everywhere, lazily
        here = name.split(".")[1]
        assert here in table, f"{name} is in no folder of the table: where does it belong?"
        for other in edges(name):
            if other.startswith(f"{package}.") and (there := other.split(".")[1]) != here:
                assert there in table[here], f"{name} imports {other}: the table lets {here} import {table[here]}"
                found[here].add(there)
    assert found == table, "the table allows what nobody uses"


@pytest.mark.parametrize("package", HOUSE)
def test_the_table_reads_from_the_ground_floor_up(package: str) -> None:
    above: set[str] = set()
    for name, allowed in HOUSE[package].items():
        assert set(allowed.split()) <= above, f"{package}.{name} imports from below it in the table"
        above.add(name)


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_folders_of_the_contract_do_not_use_each_other(folder: str) -> None:
    for name in modules("avs3d_bench"):
        if name.startswith(f"avs3d_bench.{folder}"):
            others = {other for other in edges(name) for f in FOLDERS if other.startswith(f"avs3d_bench.{f}")}
            wrong = {other for other in others if not other.startswith(f"avs3d_bench.{folder}")}
            assert not wrong, f"{name} imports {wrong}"


#: The longest function, its docstring not counted (lines), and the longest signature, without self.
MOST_LINES, MOST_PARAMETERS = 60, 8
#: What may have a longer signature, and why. Kernels (numba) and the light transport that feeds them take bare arrays:
#: compiled code has no records, and a kernel's loops stay in one function.
LONG_SIGNATURES = {
    "avs3d_bench.exports.shards.export_shards": "public: options by keyword, documented where they are used",
    "avs3d_bench.exports.torch_dataset.AVS3DDataset.__init__": "public: options by keyword",
    "avs3d_bench.submission.SubmissionWriter.__init__": "public: the fields of submission.json by keyword",
    "baselines.echosegnet.run.write_echosegnet": "public: options by keyword",
    "baselines.oracle.write_oracle": "public: options by keyword",
    "generators.acoustics.tracer.session.TracerSession.__init__": "internal: the arguments of its backend, by keyword",
    "generators.assets.furniture.common.Kit.add": "a primitive: its form, and by keyword place and finish",
    "generators.assets.shapes.MeshBuilder.add": "as Kit.add",
    "generators.assets.shapes.MeshBuilder.cylinder": "as Kit.add",
}
KERNELS = ("generators.lighting.",)


def functions(tree: ast.AST, inside: str) -> list[tuple[str, ast.FunctionDef]]:
    """Every function below a node with its dotted name, those inside of functions included."""
    found: list[tuple[str, ast.FunctionDef]] = []
    for node in ast.iter_child_nodes(tree):
        name = f"{inside}.{node.name}" if isinstance(node, ast.FunctionDef | ast.ClassDef) else inside
        if isinstance(node, ast.FunctionDef):
            found.append((name, node))
        found += functions(node, name)
    return found


def lines_of(function: ast.FunctionDef) -> int:
    """Lines from ``def`` to the end, without the docstring."""
    assert function.end_lineno is not None
    lines = function.end_lineno - function.lineno + 1
    if ast.get_docstring(function) is not None:
        docstring = function.body[0]
        assert docstring.end_lineno is not None
        lines -= docstring.end_lineno - docstring.lineno + 1
    return lines


def parameters_of(function: ast.FunctionDef) -> int:
    """Named parameters without ``self`` or ``cls``."""
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def is_kernel(name: str, function: ast.FunctionDef) -> bool:
    """Whether numba compiles a function, or it hands arrays to such."""
    compiled = {"njit", "inline", "kernel"} & {ast.unparse(each).partition("(")[0] for each in function.decorator_list}
    return bool(compiled) or name.startswith(KERNELS)


@pytest.mark.slow
def test_functions_and_signatures_are_short() -> None:
    long = {}
    for module, path in MODULES.items():
        for name, function in functions(ast.parse(path.read_text(encoding="utf-8")), module):
            if is_kernel(name, function):
                continue
            assert lines_of(function) <= MOST_LINES, f"{name} has {lines_of(function)} lines: split it"
            if parameters_of(function) > MOST_PARAMETERS:
                long[name] = parameters_of(function)
    assert not long.keys() - LONG_SIGNATURES.keys(), f"{long}: give them a record"
    assert not LONG_SIGNATURES.keys() - long.keys(), "an exception that nothing needs any more"


def test_lines_and_parameters_are_counted() -> None:
    code = '''
class A:
    @option("--x")
    def f(self, a, /, b, *rest, c, d=1, **more):
        """One.

        Two.
        """
        return (
            a
        )
'''
    ((name, function),) = functions(ast.parse(code), "m")
    assert (name, lines_of(function), parameters_of(function)) == ("m.A.f", 4, 4)


#: Class names with two meanings, and why they stay.
TWICE = {
    "Settings": "the public face of two methods: `baselines.echosegnet.Settings` and `baselines.listener.Settings`",
    "Room": "the public face: `acoustics.Room`, and the box of a room in `generators.core.scene`",
    "Tracer": "the public face: `acoustics.Tracer`, and the rays of light of `generators.core.rays`",
    "Prediction": "the public face: of a frame in `avs3d_bench`, of an observation in `baselines.echosegnet`",
}


def test_a_class_name_has_one_meaning() -> None:
    defined: dict[str, list[str]] = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in statements(path):
                if isinstance(node, ast.ClassDef):
                    defined.setdefault(node.name, []).append(path.relative_to(ROOT).as_posix())
    assert {name: places for name, places in defined.items() if len(places) > 1 and name not in TWICE} == {}
    assert all(len(defined[name]) == 2 for name in TWICE)
    assert len(TWICE) <= 5
