"""Resolve the tested set of versions again: `make lock`.

    python docker/lock.py [--upgrade | --upgrade-package NAME]… [options of uv pip compile]

Writes, from the bounds of pyproject.toml:

- constraints.txt: every extra but `UNTESTED`, on Linux x86-64 with each of `PYTHONS`; each file with its sha256;
- avs3d_bench/runtime/tested_versions.txt: the same versions without hashes, for other platforms and for `avs3d doctor`;
- docker/*.txt: what a container image needs of it.

Needs uv. A version that is pinned already stays unless the options say otherwise. Prints what changed, for the commit.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HASHED = ROOT / "constraints.txt"
VERSIONS = ROOT / "avs3d_bench/runtime/tested_versions.txt"
#: Versions of Python that the set is resolved for; one set must serve all of them.
PYTHONS = ("3.11", "3.12", "3.13")
#: Extras that are no part of the tested set; pyproject.toml says why.
UNTESTED = ("qa",)
#: File of an image → the extras that it has; None: what builds this project.
IMAGES: dict[str, tuple[str, ...] | None] = {
    "docker/build.txt": None,
    "docker/evaluator.txt": (),
    "docker/generator.txt": ("generate",),
}
#: Builds of torch differ by machine, and the acoustic engine is compiled: the Makefile and pyproject.toml pin them.
NOT_HASHED = ("torch", "rlr-audio-propagation")
#: What every build of torch needs. Its CUDA builds also need gigabytes of libraries, which the set leaves out.
_TORCH = """
[[dependency-metadata]]
name = "torch"
requires-dist = ["filelock", "typing-extensions", "setuptools", "sympy", "networkx", "jinja2", "fsspec"]
"""
_HEADS = {
    HASHED: """\
# The tested set: the versions that the tests run with, for every extra, on Linux x86-64 with Python {pythons}.
# Each file is checked by its sha256. `make setup` installs it (docs/install.md); `make lock` writes it.
#
# Not in it: torch, whose builds differ by machine (the Makefile pins its version), and rlr-audio-propagation, which is
# compiled (pyproject.toml pins its version).
""",
    VERSIONS: "# The versions of constraints.txt without hashes, as constraints for pip: `make lock` writes them.\n",
}


def pinned(text: str) -> dict[str, str]:
    """Name → its block in a file of hashed requirements: the line ``name==version`` and the lines of its hashes."""
    blocks = re.finditer(r"^([A-Za-z0-9_.\-]+)==[^\n]*\n(?:    [^\n]*\n?)*", text, flags=re.MULTILINE)
    return {block.group(1): block.group() for block in blocks}


def versions(text: str) -> dict[str, str]:
    """Name → version in a file of pinned requirements, with hashes or without."""
    return dict(re.findall(r"^([A-Za-z0-9_.\-]+)==(\S+)", text, flags=re.MULTILINE))


def resolve(known: str, python: str, extras: Sequence[str] | None, options: Sequence[str] = ()) -> str:
    """Resolve requirements with uv.

    Args:
        known: requirements whose versions are kept where ``options`` do not say otherwise.
        python: ``3.11``.
        extras: of this project; ``("*",)`` for all but `UNTESTED`; None for what builds it.
        options: more options of ``uv pip compile``.

    Returns:
        The text of a file of hashed requirements, without a head.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        output, settings = Path(folder, "output.txt"), Path(folder, "uv.toml")
        output.write_text(known, encoding="utf-8")
        settings.write_text(_TORCH, encoding="utf-8")
        command = [sys.executable, "-m", "uv", "pip", "compile", "--config-file", str(settings), "-o", str(output)]
        command += ["--python-version", python, "--python-platform", "x86_64-manylinux_2_28", "--generate-hashes"]
        command += ["--no-header", "--no-annotate", "--no-emit-index-url", "--quiet", *options]
        for name in NOT_HASHED:
            command += ["--no-emit-package", name]
        if extras is None:
            build = Path(folder, "build.in")
            build.write_text("\n".join(project["build-system"]["requires"]), encoding="utf-8")
            command.append(str(build))
        else:
            command.append(str(ROOT / "pyproject.toml"))
            if "*" in extras:
                extras = [extra for extra in project["project"]["optional-dependencies"] if extra not in UNTESTED]
            command += [f"--extra={extra}" for extra in extras]
        subprocess.run(command, check=True)
        return output.read_text(encoding="utf-8")


def main(options: Sequence[str]) -> None:
    """Resolve and write all files, and print what changed.

    Raises:
        SystemExit: if no single set serves all of `PYTHONS`.
        subprocess.CalledProcessError: if uv finds no set.
    """
    before = HASHED.read_text(encoding="utf-8")
    first, *others = PYTHONS
    after = resolve(before, first, ("*",), options)
    for python in others:
        other = set(versions(resolve(after, python, ("*",))).items()) - set(versions(after).items())
        if other:
            raise SystemExit(f"Python {python} needs other versions than {first}: {dict(sorted(other))}")
    listed = f"{', '.join(PYTHONS[:-1])} and {PYTHONS[-1]}"
    HASHED.write_text(_HEADS[HASHED].format(pythons=listed) + after, encoding="utf-8")
    lines = [f"{name}=={version}\n" for name, version in versions(after).items()]
    VERSIONS.write_text(_HEADS[VERSIONS] + "".join(lines), encoding="utf-8")
    for name, extras in IMAGES.items():
        what = "what builds this project" if extras is None else " and ".join(["the core install", *extras])
        head = f"# The part of constraints.txt for a container image: {what}. `make lock` writes it.\n"
        (ROOT / name).write_text(head + resolve(after, first, extras), encoding="utf-8")
    was, now = versions(before), versions(after)
    for name in sorted(was.keys() | now.keys()):
        if was.get(name) != now.get(name):
            print(f"{name}: {was.get(name, 'new')} → {now.get(name, 'no longer needed')}")
    if was == now:
        print("no version changed")


if __name__ == "__main__":
    main(sys.argv[1:])
