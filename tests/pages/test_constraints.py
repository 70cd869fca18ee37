"""The bounds of pyproject.toml, the pinned set of constraints.txt, and what is installed agree with one another."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[2]
#: Not pinned by hash: builds of torch differ by machine, the acoustic engine is compiled.
UNPINNED = {"torch", "rlr-audio-propagation"}
#: Extras outside of the tested set (docker/lock.py): nothing of them is pinned.
UNTESTED = ("qa",)
#: The newest version with a published vulnerability that has a fix, and the advisory.
VULNERABLE = {
    "click": ("8.3.2", "CVE-2026-7246"),
    "jinja2": ("3.1.5", "CVE-2025-27516"),
    "opencv-python-headless": ("4.11.0.86", "CVE-2025-53644"),
    "pyyaml": ("5.3.1", "CVE-2020-14343"),
    "pydantic": ("2.3.0", "CVE-2024-3772"),
    "scipy": ("1.9.3", "CVE-2023-25399"),
    "numpy": ("1.21.6", "CVE-2021-34141"),
    "pillow": ("12.2.0", "CVE-2026-55379"),
    "torch": ("2.12.0", "CVE-2025-3000"),
    "transformers": ("5.9.0", "CVE-2026-9856"),
    "scikit-learn": ("1.4.2", "CVE-2024-5206"),
    "distributed": ("2026.1.0", "CVE-2026-23528"),
    "requests": ("2.32.5", "CVE-2026-25645"),
    "urllib3": ("2.7.0", "CVE-2026-97687"),
    "bokeh": ("3.8.1", "CVE-2026-21883"),
    "datasets": ("5.0.0", "PYSEC-2026-3716"),
    "pyarrow": ("23.0.0", "CVE-2026-25087"),
    "pytest": ("9.0.2", "CVE-2025-71176"),
    "playwright": ("1.55.1", "CVE-2025-9611"),
    "setuptools": ("82.0.1", "CVE-2026-59890"),
}


def required() -> list[Requirement]:
    """Every requirement of the project, its extras (but those outside of the tested set) and its build."""
    document = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = document["project"]
    extras = [texts for name, texts in project["optional-dependencies"].items() if name not in UNTESTED]
    lists = [project["dependencies"], *extras, document["build-system"]["requires"]]
    return [Requirement(text) for texts in lists for text in texts]


def pinned(path: str = "constraints.txt") -> dict[str, Version]:
    """Name → version in a file of pinned requirements."""
    found = re.findall(r"^([A-Za-z0-9._-]+)==(\S+)", (ROOT / path).read_text(), re.MULTILINE)
    return {canonicalize_name(name): Version(version) for name, version in found}


@pytest.mark.parametrize("name", VULNERABLE)
def test_no_bound_admits_a_version_with_a_published_vulnerability(name: str) -> None:
    version, advisory = VULNERABLE[name]
    bounds = [each.specifier for each in required() if canonicalize_name(each.name) == name]
    assert bounds
    for bound in bounds:
        assert not bound.contains(version), f"{name} {version} has {advisory}; {bound} admits it"


def test_every_requirement_accepts_its_pinned_version() -> None:
    versions = pinned()
    for each in required():
        name = canonicalize_name(each.name)
        if name not in UNPINNED:
            assert name in versions, f"{name} is missing in constraints.txt: make lock"
            assert each.specifier.contains(versions[name], prereleases=True), f"{each} refuses {versions[name]}"


def test_what_pinned_packages_need_is_pinned_in_a_version_that_they_accept() -> None:
    versions = pinned()
    judged = 0
    for name in versions:
        try:
            installed = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue  # an extra that is not installed here
        if Version(installed.version) != versions[name]:
            continue  # another version may need other packages
        judged += 1
        for each in map(Requirement, installed.requires or ()):
            if each.marker is None or each.marker.evaluate({"extra": ""}):
                other = canonicalize_name(each.name)
                assert other in versions or other in UNPINNED, f"{name} needs {other}, which is not pinned"
                if other in versions:
                    assert each.specifier.contains(versions[other], prereleases=True), f"{name}: {each}"
    if not judged:
        pytest.skip("no installed package has its pinned version")


def test_the_set_without_hashes_and_the_images_have_the_same_versions() -> None:
    assert pinned("avs3d_bench/runtime/tested_versions.txt") == pinned()
    for image in ("build", "evaluator", "generator"):
        assert pinned(f"docker/{image}.txt").items() <= pinned().items()


def test_extras_outside_of_the_tested_set_are_named_once_and_left_out_of_setup() -> None:
    assert f"UNTESTED = {UNTESTED}".replace("'", '"') in (ROOT / "docker/lock.py").read_text()
    (line,) = [text for text in (ROOT / "Makefile").read_text().splitlines() if text.startswith("EXTRAS := ")]
    assert not {*UNTESTED} & {*line.removeprefix("EXTRAS := ").split(",")}
    assert "inspect-ai" not in pinned()


def test_every_pinned_file_has_a_hash_and_no_registry_is_named() -> None:
    text = (ROOT / "constraints.txt").read_text()
    entries = re.split(r"^(?=[A-Za-z])", text, flags=re.MULTILINE)[1:]
    assert len(entries) == len(pinned()) > 100
    for entry in entries:
        head, *hashes = entry.split(" \\\n")
        assert "==" in head
        assert hashes
        for line in hashes:
            assert re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}\n?", line), f"{head}: {line!r}"
    assert "://" not in text
    assert "--index" not in text
    assert not UNPINNED & set(pinned())


def test_the_supported_versions_of_python_are_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = [text.rpartition(" ")[2] for text in project["classifiers"] if "Python :: 3." in text]
    assert project["requires-python"] == f">={named[0]}"
    makefile = (ROOT / "Makefile").read_text()
    oldest, newest = (tuple(map(int, version.split("."))) for version in (named[0], named[-1]))
    assert f"v < {oldest}" in makefile
    assert f"v >= {(newest[0], newest[1] + 1)}" in makefile
    assert f"PYTHONS = {tuple(named)}".replace("'", '"') in (ROOT / "docker/lock.py").read_text()
    workflow = (ROOT / ".github/workflows/ci.yml").read_text()
    assert all(f'"{version}"' in workflow for version in named)
