"""Packages that are missing: one line with the way to get them, wherever they are asked for."""

from __future__ import annotations

import math

import pytest

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime.imports import has_package, import_by_name, missing_extra, needing, require_package

ABSENT = "no_such_package"


def test_a_missing_package_is_named_with_its_user_and_the_way_to_get_it() -> None:
    line = f"^{ABSENT} is not installed; the film needs it: pip install {ABSENT}$"
    with pytest.raises(Avs3dError, match=line), needing("the film"):
        import no_such_package.part
    line = f"^{ABSENT} is not installed; --x needs it: choose another$"
    with pytest.raises(UsageError, match=line), needing("--x", "choose another", kind=UsageError):
        import no_such_package.part  # noqa: F401


def test_a_package_that_does_not_load_says_why() -> None:
    broken = ImportError("libcuda.so.1: cannot open shared object file", name="engine.core")
    line = r"^engine cannot be imported \(libcuda.*\); tracing needs it: pip install engine$"
    with pytest.raises(Avs3dError, match=line), needing("tracing"):
        raise broken


def test_other_errors_pass_through() -> None:
    with pytest.raises(ZeroDivisionError), needing("sums"):
        1 / 0  # noqa: B018


def test_a_package_is_looked_for_and_not_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    assert has_package("math")
    assert not has_package(ABSENT)
    assert not has_package(f"{ABSENT}.part")
    monkeypatch.setitem(__import__("sys").modules, "numpy", None)
    assert not has_package("numpy")
    require_package(ABSENT, "math", user="sums")
    with pytest.raises(UsageError, match=f"{ABSENT} is not installed; sums needs it: pip install {ABSENT}"):
        require_package(ABSENT, f"{ABSENT}2", user="sums", kind=UsageError)


def test_the_extra_is_that_of_the_package_that_asks() -> None:
    error = ModuleNotFoundError(name=ABSENT)
    assert missing_extra(error, "generators").endswith("needs it: pip install 'avs3d-bench[generate]'")
    assert missing_extra(error, "").endswith(f"needs it: pip install {ABSENT}")


def test_a_function_is_imported_by_name() -> None:
    assert import_by_name("math:sqrt") is math.sqrt
    with pytest.raises(ModuleNotFoundError):
        import_by_name(f"{ABSENT}:f")
