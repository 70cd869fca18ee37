"""Write the requirements of the container images: what `constraints.txt` pins, for the packages that an image needs.

    python docker/lock.py

reads which packages the core install and each extra need, through others too, from the installed distributions. Run it
after a change of `pyproject.toml` or `constraints.txt`, in an environment that has the extra `generate`.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
FOLDER = Path(__file__).resolve().parent
#: File of requirements → what it has: the core install and the extras, or what builds this project.
IMAGES: dict[str, tuple[str, ...]] = {"build.txt": ("build",), "evaluator.txt": (), "generator.txt": ("generate",)}
_HEAD = "# Written by docker/lock.py from constraints.txt: {what}.\n"


def pinned(text: str) -> dict[str, str]:
    """Name → its block of a hashed requirements file: ``name==version`` and the lines of its hashes."""
    blocks = re.findall(r"^([A-Za-z0-9_.\-]+)==[^\n]*\n(?:    [^\n]*\n?)+", text, flags=re.MULTILINE)
    starts = re.finditer(r"^[A-Za-z0-9_.\-]+==[^\n]*\n(?:    [^\n]*\n?)+", text, flags=re.MULTILINE)
    return {canonicalize_name(name): block.group() for name, block in zip(blocks, starts, strict=True)}


def closure(lines: Iterable[str]) -> set[str]:
    """Names of all distributions that requirements need on this machine, through others too.

    Raises:
        PackageNotFoundError: if one is not installed here.
    """
    found: set[str] = set()
    seen: set[tuple[str, str]] = set()
    todo = [(Requirement(line), "") for line in lines]
    while todo:
        requirement, extra = todo.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(requirement.name)
        found.add(name)
        for wanted in ("", *requirement.extras):
            if (name, wanted) not in seen:
                seen.add((name, wanted))
                todo += [(Requirement(line), wanted) for line in metadata.requires(name) or ()]
    return found


def requirements(name: str) -> str:
    """The text of a file of requirements.

    Args:
        name: a key of `IMAGES`.

    Raises:
        KeyError: if `constraints.txt` does not pin a package.
    """
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, extras = settings["project"], IMAGES[name]
    if extras == ("build",):
        lines, what = settings["build-system"]["requires"], "what builds this project"
    else:
        lines = [*project["dependencies"], *(line for e in extras for line in project["optional-dependencies"][e])]
        what = " and ".join(["the core install", *(f"the extra {extra}" for extra in extras)])
    blocks = pinned((ROOT / "constraints.txt").read_text(encoding="utf-8"))
    return _HEAD.format(what=what) + "".join(blocks[each] for each in sorted(closure(lines)))


if __name__ == "__main__":
    for name in IMAGES:
        (FOLDER / name).write_text(requirements(name), encoding="utf-8")
        print(FOLDER / name)
