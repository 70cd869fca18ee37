"""The container images: pinned, without torch, not run by root, and their contents score a submission."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
from collections.abc import Sequence
from datetime import datetime
from importlib import metadata
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from avs3d_bench.exports.codabench import CompetitionSettings, write_codabench
from avs3d_bench.sealing.seal import open_sealed
from avs3d_bench.submission import SubmissionWriter
from evaluators.verify import verify
from tests.support import codabench_worker, sealed_trees

ROOT = Path(__file__).parents[2]
DOCKER = ROOT / "docker"
#: Most bytes of the evaluator's image.
MOST = 400e6


def load(name: str) -> ModuleType:
    """A program of docker/, which is no package."""
    import importlib.util

    spec = importlib.util.spec_from_file_location(name, DOCKER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


lock, minimal_root = load("lock"), load("minimal_root")


def instructions(name: str) -> list[tuple[str, str]]:
    """(instruction, rest) of a Dockerfile, lines that go on joined."""
    text = re.sub(r"\\\n", " ", (DOCKER / name).read_text())
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(line.partition(" ")[0], line.partition(" ")[2].strip()) for line in lines]


@pytest.mark.parametrize("path", lock.IMAGES)
def test_the_images_install_what_constraints_pin(path: str) -> None:
    blocks = lock.pinned((ROOT / path).read_text())
    assert blocks.items() <= lock.pinned((ROOT / "constraints.txt").read_text()).items(), "run make lock"
    assert all(re.match(r"\S+==\S+ \\\n    --hash=sha256:[0-9a-f]{64}", block) for block in blocks.values())
    assert not {"torch", "gsplat", "transformers", "rlr-audio-propagation"} & set(blocks)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = lock.IMAGES[path]
    if extras is None:
        wanted = project["build-system"]["requires"]
    else:
        optional = project["project"]["optional-dependencies"]
        wanted = project["project"]["dependencies"] + [line for extra in extras for line in optional[extra]]
    assert {canonicalize_name(Requirement(line).name) for line in wanted} <= set(blocks), "run make lock"


def test_a_new_set_is_listed_with_its_changes() -> None:
    text = "a==1 \\\n    --hash=sha256:0\nb-c==2.0.post1 \\\n    --hash=sha256:1\n    --hash=sha256:2\n"
    assert lock.versions(text) == {"a": "1", "b-c": "2.0.post1"}
    assert "".join(lock.pinned("# head\n" + text).values()) == text


@pytest.mark.parametrize("name", ["Dockerfile", "generator.Dockerfile"])
def test_images_run_as_a_user_and_take_whole_commands(name: str) -> None:
    steps = instructions(name)
    assert "ENTRYPOINT" not in dict(steps), "a platform gives the whole command"
    assert ("USER", "1000:1000") in steps
    for kind, rest in steps:
        if kind == "COPY" and "--from" not in rest:
            for source in rest.split()[:-1]:
                assert (ROOT / source).exists(), source
        if kind == "RUN" and re.search(r"pip .* -r \S+\.txt", rest):
            assert "--require-hashes" in rest
    ignore = (DOCKER / f"{name}.dockerignore").read_text().splitlines()
    copied = {source.split("/")[0] for k, r in steps if k == "COPY" and "--from" not in r for source in r.split()[:-1]}
    assert {f"!{source}" for source in copied} <= set(ignore)


@pytest.mark.parametrize("name", ["Dockerfile", "generator.Dockerfile"])
def test_images_start_from_a_digest(name: str) -> None:
    """A tag may be moved to other contents; a stage of the same file, or nothing, cannot."""
    steps = instructions(name)
    defaults = dict(rest.split("=", 1) for kind, rest in steps if kind == "ARG" and "=" in rest)
    own = {"scratch"}
    for rest in [rest for kind, rest in steps if kind == "FROM"]:
        image, *alias = re.sub(r"\$\{(\w+)\}", lambda found: defaults[found[1]], rest).split()
        assert image in own or re.fullmatch(r"[\w./:-]+@sha256:[0-9a-f]{64}", image), image
        own.update(alias[1:])


def _workflow_lines() -> list[str]:
    pages = [*(ROOT / ".github").rglob("*.yml"), *(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    return [line for page in pages for line in page.read_text().splitlines() if re.match(r"\s*(- )?uses:", line)]


def test_actions_are_pinned_by_commit() -> None:
    """A tag may be moved to another commit; the comment says which version the commit is."""
    lines = _workflow_lines()
    assert len(lines) >= 5
    for line in lines:
        assert re.fullmatch(r"\s*(- )?uses: [\w.-]+/[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line), line


def test_only_the_image_for_codabench_is_of_root() -> None:
    steps = instructions("Dockerfile")
    users = [rest for kind, rest in steps if kind in ("FROM", "USER")]
    assert users[-4:] == ["scratch AS evaluator", "1000:1000", "evaluator AS codabench", "0:0"]


# The evaluator's image, or its contents in a clean root


def site_packages(folder: Path) -> Path:
    """The packages of docker/evaluator.txt as they are installed here, and this toolkit's."""
    site = folder / "lib/python/site-packages"
    for name in lock.versions((DOCKER / "evaluator.txt").read_text()):
        files = metadata.files(name)
        assert files is not None, name
        for file in files:
            source = Path(str(file.locate()))
            if source.suffix != ".pyc" and ".." not in file.parts and source.is_file():
                target = site / file
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
    for name in ("avs3d_bench", "evaluators"):
        shutil.copytree(ROOT / name, site / name, ignore=shutil.ignore_patterns("__pycache__"))
    return site


def enter(root: Path, command: Sequence[str]) -> list[str]:
    """The command line that runs a command with another root, in namespaces of its own, as any user may."""
    inside = "mount --rbind /dev {0}/dev && mount --rbind /proc {0}/proc && exec chroot {0} /usr/local/bin/python3 -c "
    start = f"import os, sys; os.chdir('{codabench_worker.PROGRAM}'); os.execvp(sys.argv[1], sys.argv[1:])"
    script = inside.format(root) + f'"{start}" "$@"'
    return ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script, "sh", *command]


def can_unshare() -> bool:
    if shutil.which("unshare") is None:
        return False
    tried = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", "mount --rbind /dev /mnt"]
    return subprocess.run(tried, capture_output=True, check=False).returncode == 0


def has_engine() -> bool:
    return shutil.which("docker") is not None and (
        subprocess.run(["docker", "info"], capture_output=True, check=False).returncode == 0
    )


@pytest.mark.slow
def test_a_sealed_test_is_scored_by_the_image_or_in_a_clean_root(tmp_path: Path) -> None:
    if not has_engine() and not can_unshare():
        pytest.skip("neither a container engine nor user namespaces")
    sealed = sealed_trees.write_seal(tmp_path / "sealed", frames=9)
    settings = CompetitionSettings(
        title="Sealed", docker_image="avs3d-evaluator:test", start=datetime(2027, 1, 1), data_url="https://example.org"
    )
    write_codabench(sealed / "public", sealed / "private", tmp_path / "bundle.zip", settings)
    data = open_sealed(sealed / "public", sealed / "private")
    with SubmissionWriter(tmp_path / "oracle", data, method="oracle") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    submission = Path(shutil.make_archive(str(tmp_path / "oracle"), "zip", tmp_path / "oracle"))
    run = in_container if has_engine() else in_clean_root
    done = run(tmp_path, submission)
    assert done.returncode == 0, done.stderr
    assert "strict IoU: 1.000\n" in done.stdout
    found = verify(tmp_path / "oracle.json", submission, data)
    assert not found.differences, "the platform's file of scores is about the files of the sealed test"


def in_clean_root(folder: Path, submission: Path) -> subprocess.CompletedProcess[str]:
    """The steps of docker/Dockerfile without an engine: the same files below a folder that becomes the root."""
    root = folder / "root"
    minimal_root.collect(root, site_packages(folder / "venv"))
    size = minimal_root.size(root)
    print(f"{size / 1e6:.0f} MB")
    assert size < MOST
    assert not list(root.rglob("site-packages/torch"))
    (root / "app").rmdir()
    command = codabench_worker.prepare(folder / "bundle.zip", submission, root / "app")
    environment = {"PATH": "/usr/local/bin:/bin:/usr/bin:/sbin:/usr/sbin", "PYTHONUNBUFFERED": "1"}
    done = subprocess.run(
        enter(root, command.split()), env=environment, capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    shutil.copy(root / "app/output/avs3d_scores.json", folder / "oracle.json")
    return done


def in_container(folder: Path, submission: Path) -> subprocess.CompletedProcess[str]:
    """docker/Dockerfile, built and run as the platform's worker runs it."""
    tag = "avs3d-evaluator:test"
    build = ["docker", "build", "-q", "-f", DOCKER / "Dockerfile", "--target", "codabench", "-t", tag, ROOT]
    built = subprocess.run(build, capture_output=True, text=True, check=False, timeout=600)
    assert built.returncode == 0, built.stderr
    inspect = ["docker", "image", "inspect", "--format", "{{.Size}}", tag]
    assert float(subprocess.run(inspect, capture_output=True, text=True, check=True).stdout) < MOST
    app = folder / "app"
    command = codabench_worker.prepare(folder / "bundle.zip", submission, app)
    binds = [f"--volume={app / name}:/app/{name}" for name in ("program", "output", "input", "shared")]
    limits = ["--security-opt=no-new-privileges", "--cap-drop=ALL", "--network=none", "--workdir=/app/program"]
    user = ["--user", f"{os.getuid()}:{os.getgid()}"]  # the folders' owner, as root is on the platform
    done = subprocess.run(
        ["docker", "run", "--rm", *limits, *user, *binds, tag, *command.split()],
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    shutil.copy(app / "output/avs3d_scores.json", folder / "oracle.json")
    return done
