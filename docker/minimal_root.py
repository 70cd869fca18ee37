"""Collect a root file system that runs Python and some packages, and nothing else: the evaluator's image.

    python docker/minimal_root.py OUT --site SITE_PACKAGES

copies the running interpreter with its standard library, the packages of SITE_PACKAGES, the shared libraries that both
need, and a shell to OUT. The same inputs give the same bytes and times: SOURCE_DATE_EPOCH (seconds, 0 if it is not set)
is the time of every file, and compiled modules hold no time. Prints the size and a digest of the tree.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import py_compile
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path

#: Parts of the standard library that need a screen, install packages or test Python.
LEFT_OUT = ("idlelib", "ensurepip", "lib2to3", "tkinter", "turtledemo", "test", "site-packages", "pydoc_data")
#: Modules whose libraries serve a screen or a terminal's line editor.
LEFT_OUT_MODULES = ("_tkinter", "readline", "_curses", "_curses_panel", "_dbm", "_gdbm", "_test", "_xx", "_ctypes_test")
#: Of packages: their tests, what compilers read, installers, weights. Stubs stay: names are imported by them.
LEFT_OUT_FILES = ("__pycache__", "tests", "pip", "pip-*", "*.pyx", "*.pxd", "*.h", "*.a", "*.safetensors")
#: What a run imports; these modules and all that they import are compiled, the others would only take up room.
IMPORTED = ("evaluators.competition", "evaluators.cli", "avs3d_bench.cli", "scipy.ndimage", "scipy.stats")
PREFIX = "usr/local"
#: User of the image: no right of root, no name on the host.
USER = 1000
SHELL = "/bin/sh"


def collect(out: Path, site: Path) -> None:
    """Write the tree.

    Args:
        out: a new folder.
        site: the folder of packages.
    """
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    library = out / PREFIX / "lib" / version
    binary = out / PREFIX / "bin" / version
    shutil.copytree(sysconfig.get_path("stdlib"), library, ignore=_unwanted, symlinks=False)
    shutil.copytree(site, library / "site-packages", ignore=shutil.ignore_patterns(*LEFT_OUT_FILES))
    binary.parent.mkdir(parents=True)
    shutil.copy2(os.path.realpath(sys.executable), binary)
    (binary.parent / "python3").symlink_to(binary.name)
    for script in sorted((site.parents[2] / "bin").glob("avs3d*")):
        body = script.read_text(encoding="utf-8").partition("\n")[2]
        (binary.parent / script.name).write_text(f"#!/{PREFIX}/bin/python3\n{body}", encoding="utf-8")
        (binary.parent / script.name).chmod(0o755)
    (out / "bin").mkdir()
    shutil.copy2(os.path.realpath(SHELL), out / "bin/sh")
    programs = [binary, out / "bin/sh", *library.rglob("*.so*")]
    for name, path in sorted(shared_libraries(programs, out).items()):
        target = out / name.lstrip("/") if name.startswith("/") else out / "usr/lib" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)
    _strip([*library.glob("lib-dynload/*.so"), *(out / "usr/lib").glob("libpython*")])
    _settle(out)
    _compile(out, site, library)
    moment = int(os.environ.get("SOURCE_DATE_EPOCH", "0"))
    for path in (*out.rglob("*"), out):
        os.utime(path, (moment, moment), follow_symlinks=False)


def _compile(out: Path, site: Path, library: Path) -> None:
    """Compile the modules that a run imports."""
    code = (
        f"import {', '.join(IMPORTED)}, sys\nfor m in list(sys.modules.values()): print(getattr(m, '__file__', None))"
    )
    environment = {**os.environ, "PYTHONPATH": str(site)}
    listed = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    standard = Path(sysconfig.get_path("stdlib"))
    for name in sorted(line for line in listed.stdout.splitlines() if line.endswith(".py")):
        for base, target in ((site, library / "site-packages"), (standard, library)):
            if Path(name).is_relative_to(base):
                file = target / Path(name).relative_to(base)
                shown = f"/{file.relative_to(out)}"
                mode = py_compile.PycInvalidationMode.UNCHECKED_HASH
                py_compile.compile(str(file), dfile=shown, doraise=True, invalidation_mode=mode)
                break


def _strip(files: Iterable[Path]) -> None:
    """Remove the debug symbols of the interpreter's own libraries; those of wheels do not survive it."""
    if program := shutil.which("strip"):
        for file in files:
            subprocess.run([program, "--strip-unneeded", str(file)], check=True)


def _unwanted(folder: str, names: list[str]) -> list[str]:
    modules = tuple(f"{name}." for name in LEFT_OUT_MODULES)
    return [
        name
        for name in names
        if name in ("__pycache__", *LEFT_OUT) or name.startswith(("config-", *modules)) or name.endswith(".a")
    ]


def _settle(out: Path) -> None:
    """What programs expect beside libraries: folders, and a name for the user."""
    for name in ("tmp", "dev", "proc", "app", "etc", "home/avs3d"):
        (out / name).mkdir(parents=True, exist_ok=True)
    (out / "tmp").chmod(0o1777)
    (out / "etc/passwd").write_text(
        f"root:x:0:0:root:/:{SHELL}\navs3d:x:{USER}:{USER}:avs3d:/home/avs3d:{SHELL}\n", encoding="utf-8"
    )
    (out / "etc/group").write_text(f"root:x:0:\navs3d:x:{USER}:\n", encoding="utf-8")


def shared_libraries(programs: Iterable[Path], inside: Path) -> dict[str, Path]:
    """Name → file of the system's libraries that programs load; the loader has its whole path as its name.

    Args:
        programs: executables and libraries.
        inside: libraries below this folder are there already.

    Raises:
        SystemExit: if a library is not found.
    """
    found: dict[str, Path] = {}
    for program in programs:
        listed = subprocess.run(["ldd", str(program)], capture_output=True, text=True, check=False).stdout
        for name, path in re.findall(r"^\s*(\S+)(?: => (\S.*?))? \(0x", listed, flags=re.MULTILINE):
            if path or name.startswith("/"):
                file = Path(path or name)
                if not file.resolve().is_relative_to(inside.resolve()):
                    found[name] = file.resolve()
        # A library beside the one that needs it is found once both are loaded.
        for name in re.findall(r"(\S+) => not found", listed):
            if not (program.parent / name).exists():
                sys.exit(f"{program}: {name} is not installed")
    return found


def _files(out: Path) -> Iterator[Path]:
    return (path for path in sorted(out.rglob("*")) if path.is_file() and not path.is_symlink())


def size(out: Path) -> int:
    """Bytes of all files."""
    return sum(path.stat().st_size for path in _files(out))


def digest(out: Path) -> str:
    """sha256 over the names, modes and contents of all files."""
    lines = (
        f"{hashlib.sha256(path.read_bytes()).hexdigest()} {path.stat().st_mode & 0o7777:o} {path.relative_to(out)}\n"
        for path in _files(out)
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--site", type=Path, required=True)
    chosen = parser.parse_args()
    collect(chosen.out, chosen.site)
    print(f"{size(chosen.out) / 1e6:.0f} MB, sha256 {digest(chosen.out)}")
