"""Packages beside the core install, and classes by name: imported when they are used, one line if they are missing."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from avs3d_bench.errors import Avs3dError

#: Package of this project → its extra, which installs what the core install lacks.
_EXTRA_OF = {"generators": "generate", "baselines": "baselines", "evaluators": "generate"}


@contextmanager
def needing(user: str, how: str = "", *, kind: type[Avs3dError] = Avs3dError) -> Iterator[None]:
    """A block that imports what ``user`` needs beside the core install.

        with needing("avs3d video", "pip install 'avs3d-bench[inspect]'"):
            import av

    Args:
        user: what needs it, as the message says it.
        how: what to do; empty: ``pip install PACKAGE``.
        kind: class of the error.

    Raises:
        Avs3dError: if a package is not installed, or cannot be loaded.
    """
    try:
        yield
    except ImportError as error:
        raise kind(missing_line(error, user, how)) from error


def missing_line(error: ImportError, user: str = "this command", how: str = "") -> str:
    """One line for a module that cannot be imported; arguments as for `needing`."""
    missing = (error.name or str(error)).partition(".")[0]
    if missing in sys.stdlib_module_names:
        return (
            f"{error.name} is a part of Python, but cannot be imported; check that the files below {sys.base_prefix} "
            "are complete and may be read"
        )
    if isinstance(error, ModuleNotFoundError):
        return _line(missing, user, how)
    return f"{missing} cannot be imported ({error}); {user} needs it: {how or f'pip install {missing}'}"


def missing_extra(error: ModuleNotFoundError, package: str) -> str:
    """`missing_line` for a module that the code of ``package``, one of this project's, has asked for."""
    extra = "soundspaces" if error.name == "rlr_audio_propagation" else _EXTRA_OF.get(package)
    return missing_line(error, how=f"pip install 'avs3d-bench[{extra}]'" if extra else "")


def package_asking(error: ModuleNotFoundError) -> str:
    """The package of this project whose code asked for the missing module; empty if none did."""
    trace, package = error.__traceback__, ""
    while trace is not None:
        name = str(trace.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        package = name if name in _EXTRA_OF else package
        trace = trace.tb_next
    return package


def has_package(module: str) -> bool:
    """Whether a module is installed; it is not imported."""
    if sys.modules.get(module) is not None:
        return True
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def require_package(*names: str, user: str, how: str = "", kind: type[Avs3dError] = Avs3dError) -> None:
    """Raise the error of `needing` if none of some modules is installed; nothing is imported."""
    if not any(map(has_package, names)):
        raise kind(_line(names[0], user, how))


def import_by_name(named: str) -> Any:
    """The class or function of a text ``module:name``."""
    module, _, name = named.partition(":")
    return getattr(import_module(module), name)


def _line(package: str, user: str, how: str) -> str:
    return f"{package} is not installed; {user} needs it: {how or f'pip install {package}'}"
