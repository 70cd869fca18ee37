"""README.md, CONTRIBUTING.md and docs/: blocks of Python and shell run, on a small dataset like that of `make demo`.

The worked examples of docs/extending.md and docs/own-objects.md run in test_extending.py; test_metrics_doc.py computes
the examples of docs/metrics.md and of the pages of its topics.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import yaml

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.scheduling import jobqueue
from baselines.oracle import write_oracle
from baselines.trivial import write_trivial
from generators.core.folders import default_cache
from generators.manifest.reading import read_manifest
from generators.manifest.schema import Manifest
from tests.support import tiny, tiny_scenes
from tests.support.markdown_code import ROOT, RUN, Block, blocks, calls, indented, run, unknown

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: Info strings of blocks that are neither run nor calls of commands.
SHOWN = ("text", "yaml", "diff")
#: Those of docs/metrics.md and its topics: drawn examples, which test_metrics_doc.py reads.
DRAWN = ("masks", "scenes", "sources", "figures", "voxels", "values", "methods")
DRAWN_ON = ("metrics.md", "protocol-official.md", "protocol-strict.md", "protocol-listen.md", "comparing.md")
#: Pages of worked examples, which test_extending.py runs.
WORKED = ("extending.md", "extending-generator.md", "own-objects.md")
BLOCKS = [block for page in PAGES for block in blocks(page)]
#: Blocks that are run here.
CODE = [block for block in BLOCKS if block.language in RUN and block.page.name not in WORKED]
#: Page → its blocks that are run.
RUNNING = {page: own for page in PAGES if (own := [block for block in CODE if block.page == page and not block.reason])}
YAML = [block for block in BLOCKS if block.language == "yaml"]
#: Blocks on job queues and on Dask's configuration; all other YAML is a manifest, or a part of one.
CLUSTER = [block for block in YAML if block.page.name == "cluster.md"]
#: A workflow of GitHub.
WORKFLOWS = [block for block in YAML if block.page.name == "competition.md"]
MANIFESTS = [block for block in YAML if block not in (*CLUSTER, *WORKFLOWS)]


def name_of(block: Block) -> str:
    return block.name


def path_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `make demo` writes into data/, small, and the files that pages take for granted."""
    folder = tmp_path_factory.mktemp("pages")
    tiny.write_dataset(folder / "data/demo", frames=11, keys=tiny.DEMO)
    dataset = Dataset(folder / "data/demo")
    write_oracle(dataset, folder / "data/demo-submissions/oracle")
    write_trivial("centre-box", dataset, folder / "data/demo-submissions/centre-box")
    tiny_scenes.write_part_3(folder / "data/listen", frames=9, stems=True)
    shutil.copytree(ROOT / "scenes_manifest", folder / "scenes_manifest")
    for path in (folder / "scenes_manifest").glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        if "\nobservations:" in text:  # full light takes minutes
            text = re.sub(r"^light: \w+\n", "", text, flags=re.M)
            path.write_text(f"{text}light: preview\n", encoding="utf-8")
    manifest = next(block for block in YAML if block.page.name == "part-3.md")
    small = manifest.code.replace("size: 252", "size: 126").replace("seed: 3}", "seed: 11}")  # the home of the demo
    assert "seed: 11}" in small
    (folder / "scenes.yaml").write_text(small, encoding="utf-8")
    (folder / "models").mkdir()
    soundfile.write(folder / "models/ring.wav", np.random.default_rng(0).normal(0, 0.1, 44_100), 44_100)
    for variable in ("HOME", "AVS3D_ASSETS"):
        (folder / variable).mkdir()
    return folder


@pytest.fixture
def folder(desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it for a page; the homes of all pages and other tests are baked once."""
    shutil.copytree(desk, tmp_path / "page")
    monkeypatch.setenv("AVS3D_CACHE", str(default_cache()))
    if find_spec("numba") is not None:  # else kernels would be compiled again in each page's home folder
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(import_module("generators.core.jit").CACHE_FOLDER))
    for variable in ("HOME", "AVS3D_ASSETS"):
        monkeypatch.setenv(variable, str(tmp_path / "page" / variable))
    return tmp_path / "page"


def smaller(block: Block) -> Block:
    """The block with at most 2 frames, pictures of at most 126 pixels to a side, in Python 64, and coarse exports."""
    frames = 6 if "export seld" in block.code else 2  # a clip of stereo takes 5 s
    code = re.sub(r"\.export\((\"[^\"]*\")\)", r".export(\1, texel=0.05)", block.code)
    for option, most in (("--frames ", frames), ("--size ", 126), (r"from_fov\(", 64)):
        code = re.sub(rf"({option})(\d+)", lambda found, most=most: f"{found[1]}{min(int(found[2]), most)}", code)
    return replace(block, code=code)


@pytest.mark.slow
@pytest.mark.parametrize("page", RUNNING, ids=path_of)
def test_code_runs(page: Path, folder: Path) -> None:
    """The blocks of a page in its order: a reader saves those with a file's name, and runs the others."""
    said = []
    for block in RUNNING[page]:
        if block.file is not None:
            (folder / block.file).write_text(block.code, encoding="utf-8")
        else:
            said.append(run(smaller(block), folder))
    if page.name == "tutorial.md":
        found = re.search(r"^strict IoU in part_2: (\S+)$", "".join(said), re.M)
        assert found
        assert float(found[1]) > 0, "the method of the tutorial finds nothing"


@pytest.mark.slow
@pytest.mark.parametrize("block", [block for block in CODE if block.reason], ids=name_of)
def test_code_that_is_not_run_says_why(block: Block) -> None:
    pytest.skip(f"not run: {block.reason}")


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "usage"], ids=name_of)
def test_usage_names_commands_and_options_that_exist(block: Block) -> None:
    assert calls(block)
    for call in calls(block):
        assert not unknown(call), f"{block.name}: {' '.join(call)}"


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "bash" and b.reason], ids=name_of)
def test_a_block_that_is_not_run_names_commands_options_and_files_that_exist(block: Block) -> None:
    for call in calls(block):
        assert not unknown(call), f"{block.name}: {' '.join(call)}"
    for name in re.findall(r"(?:scenes_manifest|docs)/[\w./-]*\w", block.code):
        assert (ROOT / name).exists(), f"{block.name}: {name}"
    for module, rest in re.findall(r"python -m (benchmarks\.\w+)((?:\\\n|[^#|&\n])*)", block.code):
        source = (ROOT / module.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8")
        for option in re.findall(r"(?<!\S)--[a-z-]+", rest):
            assert f'"{option}"' in source, f"{block.name}: {module} {option}"


def test_a_reason_stands_only_before_a_block_that_would_run() -> None:
    assert all(block.language in RUN for block in BLOCKS if block.reason)


@pytest.mark.parametrize("page", PAGES, ids=path_of)
def test_every_block_says_what_it_is(page: Path) -> None:
    assert not indented(page), "indented blocks: fence them, so that a test knows what they are"
    drawn = DRAWN if page.name in DRAWN_ON else ()
    assert {block.language for block in blocks(page)} <= {*RUN, "usage", *SHOWN, *drawn}


def manifest_of(text: str) -> dict[str, Any]:
    """A part of a manifest with the rest that it needs: a name, a seed, an observation, a home for each scan."""
    part = yaml.safe_load(text)
    assert part
    assert set(part) <= set(Manifest.model_fields)
    entry = {"part": "part_1", "scan": next(iter(part.get("scans", ["home"]))), "room": "kitchen", "index": 1}
    whole = {"name": "part", "seed": 1, "observations": [entry | {"category": "microwave"}]} | part
    homes = {entry["scan"]: {"seed": 1} for entry in whole["observations"] if "scan" in entry}
    return whole | {"scans": homes | whole.get("scans", {})}


@pytest.mark.parametrize("block", WORKFLOWS, ids=name_of)
def test_workflows_run_commands_that_exist(block: Block) -> None:
    steps = yaml.safe_load(block.code)["jobs"]["score"]["steps"]
    commands = [step["run"] for step in steps if "run" in step]
    called = [call for command in commands for call in calls(replace(block, code=command))]
    assert [call[0] for call in called] == ["avs3d", "avs3d-eval"]
    for call in called:
        assert not unknown(call), " ".join(call)


@pytest.mark.parametrize("block", MANIFESTS, ids=name_of)
def test_manifests_are_read(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "manifest.yaml"
    file.write_text(yaml.safe_dump(manifest_of(block.code), allow_unicode=True), encoding="utf-8")
    read_manifest(file)


def test_the_error_of_the_page_on_manifests_is_the_one_that_is_printed(tmp_path: Path) -> None:
    whole, error, *_ = (block.code for block in blocks(ROOT / "docs/manifest.md"))
    (tmp_path / "mine.yaml").write_text(whole.replace("category: microwave", "category: microwve"), encoding="utf-8")
    with pytest.raises(UsageError) as raised:
        read_manifest(tmp_path / "mine.yaml")
    before, _, after = error.strip().removeprefix("avs3d: error: ").partition("…")
    said = str(raised.value).removeprefix(f"{tmp_path}/")
    assert said.startswith(before)
    assert said.endswith(after)


@pytest.mark.parametrize("block", CLUSTER, ids=name_of)
def test_options_of_job_queues_and_settings_of_dask_exist(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "options.yaml"
    file.write_text(block.code, encoding="utf-8")
    options = jobqueue.read_options(file)
    if "distributed" in options:
        distributed = pytest.importorskip("distributed", reason="Dask is in the [cluster] extra")
        known = yaml.safe_load((Path(distributed.__file__).parent / "distributed.yaml").read_text(encoding="utf-8"))
        assert leaves(options) <= leaves(known)
        return
    kind = "kubernetes" if "namespace" in options else "pbs" if "resource_spec" in options else "slurm"
    module, cluster, package = jobqueue.KINDS[kind]
    found = getattr(pytest.importorskip(module, reason=f"{package} is not installed"), cluster)
    assert set(options) <= jobqueue._parameters(found)


def leaves(tree: dict[str, Any], above: str = "") -> set[str]:
    """Paths of the values of nested mappings."""
    found: set[str] = set()
    for key, value in tree.items():
        found |= leaves(value, f"{above}{key}.") if isinstance(value, dict) else {f"{above}{key}"}
    return found


def test_the_submission_json_of_the_example_fits_the_open_benchmark() -> None:
    (shown,) = re.findall(r"^submission\.json +(\{.*\})$", (ROOT / "docs/score.md").read_text(encoding="utf-8"), re.M)
    said, manifest = json.loads(shown), read_manifest(ROOT / "scenes_manifest/open-s34-o7.yaml").manifest
    assert (said["dataset"], said["dataset_version"]) == (manifest.name, manifest.version)


# The tools of this test


def page_of(folder: Path, text: str) -> Path:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return page


def test_a_usage_block_with_a_wrong_name_is_found() -> None:
    assert unknown(["avs3d", "generate", "MANIFEST", "-o", "ROOT", "--wrokers", "N"]) == ["--wrokers"]
    assert unknown(["avs3d", "baseline", "all-black|all-withe", "-o", "DIR"]) == ["all-withe"]
    assert unknown(["avs3d-eval", "SUBMISSION", "--dataset", "ROOT", "--deep"]) == ["--deep"]
    assert not unknown(["avs3d", "export", "croissant|card", "ROOT", "-o", "FILE"])


def test_indented_code_is_found_and_lists_are_not_taken_for_it(tmp_path: Path) -> None:
    assert indented(page_of(tmp_path, "text\n\n    avs3d doctor\n")) == [3]
    assert not indented(page_of(tmp_path, "- point\n\n    more of it\n\n```text\n\n    inside\n```\n"))


def test_the_reason_stands_right_before_the_block(tmp_path: Path) -> None:
    page = page_of(tmp_path, "<!-- not run: network -->\n```bash\nfalse\n```\n\n```bash\nfalse\n```\n")
    assert [block.reason for block in blocks(page)] == ["network", None]


def test_a_failing_block_fails(tmp_path: Path) -> None:
    for language, code in (("bash", "false\ntrue\n"), ("python", "raise KeyError('IoU')\n")):
        with pytest.raises(AssertionError, match="ended with 1"):
            run(Block(ROOT / "README.md", 1, language, code, None), tmp_path)
