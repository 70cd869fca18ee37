"""The reference of `generators.acoustics`: every public name is described, and its examples run."""

from __future__ import annotations

import ast
import doctest
import inspect
from pathlib import Path
from types import ModuleType

import pytest

from generators import acoustics

#: Names of the face: `from .x import Name as Name`.
NAMES = sorted(
    alias.asname or alias.name
    for node in ast.parse(Path(str(acoustics.__file__)).with_name("__init__.pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
)


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_has_an_example_that_runs(name: str) -> None:
    thing = getattr(acoustics, name)
    described = thing if isinstance(thing, ModuleType) else inspect.getmodule(thing)
    found = doctest.DocTestFinder().find(thing, name, module=described, globs=dict(vars(described)))
    assert inspect.getdoc(thing)
    assert any(test.examples for test in found), f"{name}: no example"
    runner = doctest.DocTestRunner(verbose=False)
    for test in found:
        runner.run(test)
    assert not runner.failures
    for part in vars(thing).values() if inspect.isclass(thing) else ():
        if inspect.isfunction(part) and not part.__name__.startswith("_"):
            assert inspect.getdoc(getattr(thing, part.__name__)), f"{name}.{part.__name__}: not described"
