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


def test_the_contract_needs_the_core_install_only():
    import sys

    for path in sorted((ROOT / "avs3d_bench").rglob("*.py")):
        foreign = imported(path) - CORE - set(sys.stdlib_module_names)
        assert not foreign, f"{path.relative_to(ROOT)} imports {', '.join(sorted(foreign))}, which the core lacks"
