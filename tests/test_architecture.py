"""Imports flow one way: the contract imports none of the others; the others import it, and never one another."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")
FORBIDDEN = {
    package: set(PACKAGES) - {package} - ({"avs3d_bench"} if package != "avs3d_bench" else set())
    for package in PACKAGES
}


def imported(path: Path) -> set[str]:
    """Top-level packages that a file imports, anywhere in it; relative imports stay inside their package."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
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
CORE = {"numpy", "scipy", "pandas", "pydantic", "click", "soundfile", "cv2", "yaml", "rich", "jinja2", "avs3d_bench"}


#: Parts of the contract's package that import more, inside functions only: the core is used without it.
EXTRAS = {"scheduling": {"dask", "distributed"}}


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
        lazy = path.relative_to(ROOT / "avs3d_bench").parts[0] in LAZY
        found = imported_at_once(ast.parse(path.read_text(encoding="utf-8"))) if lazy else imported(path)
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
