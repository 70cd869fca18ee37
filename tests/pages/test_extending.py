"""The examples of docs/extending.md and own-objects.md work as they are printed, the entries of their tables exist."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats.media import read_png_categories, read_png_mask
from avs3d_bench.geometry import direction_to
from tests.support.markdown_code import ROOT, Block, blocks, section
from tests.support.printed import Desk
from tests.support.shared import SharedDataset

DOCUMENT = ROOT / "docs/extending.md"
PAGE = DOCUMENT.read_text(encoding="utf-8")
GENERATOR = ROOT / "docs/extending-generator.md"
OBJECTS = ROOT / "docs/own-objects.md"
#: A test to be sealed, in the room of the first example, whose light is in the cache by then.
TEMPLATE = """\
name: small
seed: 7
camera: {size: 64, frames: 2}
light: preview
scans:
  flat:
    source: scan
    file: room.glb
    rooms: {kitchen: [[0, 0, 0], [4, 2.6, 3.6]]}
    licence: {name: CC0-1.0, author: Jane Doe}
observations:
  - {part: part_1, scan: flat, room: kitchen, index: 4, category: coffee_machine}
"""


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=17)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> tuple[Desk, str]:
    """The first example, whose files and lit room the last one uses again."""
    pytest.importorskip("trimesh", reason="the generator needs the [generate] extra")
    desk = Desk(tmp_path_factory.mktemp("home"))
    return desk, desk.follow(OBJECTS, OBJECTS.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_own_object_and_sound(home: tuple[Desk, str]) -> None:
    desk, _ = home
    dataset = Dataset(desk.folder / "data/mine")
    (observation,) = dataset
    record = observation.record
    assert record is not None
    assert record.sounding.asset == "machine.glb"
    assert record.sound.asset == "steam.flac"
    low, high = record.sounding.bounds
    assert high[1] - low[1] == pytest.approx(0.34, abs=1e-3)
    assert low[1] == pytest.approx(0.9, abs=0.02)  # it stands on the worktop
    assert dataset.record is not None
    named = {attribution.asset: attribution.author for attribution in dataset.record.attributions}
    assert named["machine.glb"] == named["steam.flac"] == "Jane Doe"


@pytest.mark.slow
def test_own_category(home: tuple[Desk, str]) -> None:
    desk, said = home
    dataset = Dataset(desk.folder / "data/dryer")
    assert dataset.record is not None
    assert (dataset.record.schema_version, dataset.record.categories) == ("1.1", ("hair_dryer",))
    assert {a.asset for a in dataset.record.attributions} >= {"dryer.glb", "dryer.wav"}
    assert [observation.key.split("/")[0] for observation in dataset] == ["part_1", "part_2", "part_3", "part_3"]
    # Placement, models and ids.
    for observation in dataset:
        record = observation.record
        assert record is not None
        assert record.categories == ("hair_dryer",)
        assert record.class_ids == {name: number for number, name in enumerate((*CATEGORIES, "hair_dryer"), start=1)}
        heights = set()
        for instance in record.instances:
            low, high = instance.bounds
            assert low[1] == pytest.approx(0.9, abs=0.02)  # on the worktop: the room has no table
            if instance.category == "hair_dryer":
                assert instance.asset == "dryer.glb"
                heights.add(round(high[1] - low[1], 5))
        assert len(heights) == 1
        assert 0.15 <= heights.pop() <= 0.3
    # Masks: what sounds is marked with its class.
    single, twins, alone, both = dataset
    assert alone.group == both.group == alone.key
    for observation, classes in ((alone, {8}), (both, {5, 8})):
        record = observation.record
        assert record is not None
        seen = set()
        for frame in observation.frames:
            kinds, ids = frame.category_mask(), frame.instance_ids()
            assert np.array_equal(kinds > 0, frame.mask())
            for instance in record.instances:
                expected = record.class_ids[instance.category] if instance.sounding else 0
                assert set(np.unique(kinds[ids == instance.id])) <= {expected}
            seen |= set(np.unique(kinds).tolist())
        assert seen == classes | {0}
    assert any(frame.mask().any() for frame in single.frames)
    assert twins.record is not None
    assert [i.category for i in twins.record.instances] == ["hair_dryer"] * 2
    submitted = read_png_categories(desk.folder / "dryer-oracle" / both.key / "categories/frame_000.png")
    assert np.array_equal(submitted, both.test[0].category_mask())
    # Scores.
    assert "class ids {'coffee_machine': 5, 'hair_dryer': 8}" in said
    scores = json.loads((desk.folder / "dryer.json").read_text())
    assert scores["categories"]["hair_dryer"]["observations"] == 3
    printed = re.search(r"^strict IoU of hair dryers (\S+)$", said, re.M)
    assert printed
    assert 0 < float(printed[1]) <= 1


@pytest.mark.parametrize(
    "change",
    [block for page in (DOCUMENT, GENERATOR) for block in blocks(page) if block.language == "diff"],
    ids=lambda block: str(block.line),
)
def test_each_diff_applies(change: Block, tmp_path: Path) -> None:
    """The examples themselves are slow tests; what they change must not move away unnoticed."""
    named = re.findall(r"^--- a/(\S+)$", change.code, re.M)
    assert named
    for file in named:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, tmp_path / file)
    done = subprocess.run(
        ["git", "apply", "--check", "-"], cwd=tmp_path, input=change.code, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, (
        f"a change moved or altered these lines; renew the diff of the page\n{done.stderr}{change.code}"
    )


def test_the_list_of_edits_for_a_category_names_what_exists() -> None:
    rows = re.findall(r"^\| `([\w/]+\.py)` \| (.*?) \|", OBJECTS.read_text(encoding="utf-8"), re.M)
    assert len(rows) == 12
    for file, names in rows:
        module = import_module(file.removesuffix(".py").replace("/", "."))
        for name in re.findall(r"`(\w+)`", names):
            assert hasattr(module, name), f"{file} has no {name}"


def test_the_list_of_edits_for_a_category_is_whole() -> None:
    """Every file of code that names three categories or more as text is in the list."""
    listed = set(re.findall(r"^\| `([\w/]+\.py)`", OBJECTS.read_text(encoding="utf-8"), re.M))
    for package in ("avs3d_bench", "generators", "evaluators", "baselines"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            named = [category for category in CATEGORIES if f'"{category}"' in text]
            if len(named) >= 3:
                assert path.relative_to(ROOT).as_posix() in listed


@pytest.mark.slow
def test_metric(tmp_path: Path, data: Path) -> None:
    desk = Desk(tmp_path, data)
    said = desk.follow(DOCUMENT, section(PAGE, "## A metric"))
    desk.lint()
    values, by_observation = [], []
    for observation in Dataset(data):
        mine = []
        for frame in observation.test:
            truth = frame.mask()
            mask = read_png_mask(tmp_path / "box" / observation.key / f"masks/{frame.name}.png")
            if truth.any():
                mine.append((truth & mask).sum() / mask.sum())
        values += mine
        by_observation.append(np.mean(mine))
    printed = re.search(r"^precision (\S+)$", said, re.M)
    assert printed
    assert float(printed[1]) == pytest.approx(np.mean(values))
    assert 0 < np.mean(values) < 1
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert scores["overall"]["strict"]["precision"] == pytest.approx(np.mean(by_observation))
    assert scores["references"]["centre_box"]["overall"]["strict"]["precision"] == pytest.approx(
        np.mean(by_observation)
    )
    assert scores["overall"]["strict"]["counts"]["precision"] == 2
    desk.run("avs3d", "leaderboard", "scores.json", "-o", "board")
    assert "precision" in (tmp_path / "board/index.html").read_text()


@pytest.mark.slow
def test_chart(tmp_path: Path, data: Path) -> None:
    desk = Desk(tmp_path, data)
    desk.follow(DOCUMENT, section(PAGE, "## A chart in the report"))
    desk.lint()
    counts = [0] * 10
    for observation in Dataset(data):
        for frame in observation.test:
            truth = frame.mask()
            mask = read_png_mask(tmp_path / "box" / observation.key / f"masks/{frame.name}.png")
            if truth.any():
                counts[min(int(10 * (truth & mask).sum() / (truth | mask).sum()), 9)] += 1
    shown = (tmp_path / "report.html").read_text().partition('<section id="histogram">')[2].partition("</section>")[0]
    assert list(map(int, re.findall(r'<span class="value">(\d+)</span>', shown))) == counts
    # A leaderboard copies the report.
    desk.run("avs3d-eval", "box", "--dataset", "data/demo", "--json", "scores.json", "--html", "report.html")
    desk.run("avs3d", "leaderboard", "scores.json", "-o", "board")
    assert any('id="histogram"' in page.read_text() for page in (tmp_path / "board").rglob("*.html"))


@pytest.mark.slow
def test_baseline(tmp_path: Path, data: Path) -> None:
    desk = Desk(tmp_path, data)
    desk.follow(DOCUMENT, section(PAGE, "## A baseline"))
    desk.lint()
    scores = json.loads((tmp_path / "ear-side.json").read_text())
    assert scores["submission"]["method"] == "ear-side"
    digest = desk.run(
        "python", "-c", "from avs3d_bench.runtime.provenance import provenance as p; "
        "found = p('baselines.ear_side:write_ear_side'); assert 'baselines/ear_side.py' in found.sources; "
        "print(found.digest)",
    )  # fmt: skip
    assert scores["submission"]["provenance"]["digest"] == digest.strip()
    assert scores["overall"]["strict"]["IoU"] > scores["references"]["all_white"]["overall"]["strict"]["IoU"]
    # The page says how the table of the architecture changes.
    table = tmp_path / "tests/test_architecture.py"
    text = table.read_text()
    start = text.index('"baselines": {', text.index("HOUSE = {"))
    at = text.index('        "cli": "', start)
    end = text.index('",\n', at)
    table.write_text(f'{text[:at]}        "ear_side": "",\n{text[at:end]} ear_side{text[end:]}')
    # The packages that are changed, and what concerns all of them.
    desk.run(
        "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "not [generators]", "tests/test_architecture.py"
    )


@pytest.mark.slow
def test_option(home: tuple[Desk, str]) -> None:
    desk, _ = home
    assert "1 made" in desk.follow(GENERATOR, section(GENERATOR.read_text(encoding="utf-8"), "## An option"))
    desk.lint()
    (coloured,), (grey,) = Dataset(desk.folder / "data/mine"), Dataset(desk.folder / "data/grey")
    picture = grey.frames[0].rgb().astype(int)
    assert (picture == picture[:, :, :1]).all()
    luma = coloured.frames[0].rgb() @ np.array([0.2126, 0.7152, 0.0722])
    assert np.abs(picture[:, :, 0] - luma).max() <= 0.5 + 1e-9
    assert grey.record is not None
    assert grey.record.options == {"camera": "mild", "grey": True}
    assert coloured.record is not None
    assert coloured.record.options == {"camera": "mild"}
    # The digest of the plan covers the option: a rerun without it keeps nothing.
    again = desk.run("bash", "-c", "! avs3d generate mine.yaml -o data/grey --audio analytic")
    assert "part_1" in again
    assert "--remake" in again
    # A sealed test can be opened.
    (desk.folder / "template.yaml").write_text(TEMPLATE)
    sealing = "avs3d seal template.yaml -o sealed --grey --audio analytic"
    opening = "avs3d unseal sealed --secret sealed/secret --regenerate"
    opened = desk.run("bash", "-ec", f"export AVS3D_SCANS=$PWD; {sealing}; {opening}")
    assert "1 generated again: all as committed to" in opened
    without = desk.run("avs3d", "unseal", "sealed", "--secret", "sealed/secret")
    assert re.search(r"plan_sha256 not compared: \S+room.glb: scan home_1 not", without)
    pycolmap = pytest.importorskip("pycolmap", reason="reads the sparse model back; it is in the dev extra")
    model = pycolmap.Reconstruction(grey.path / "sparse/0")
    assert len(model.points3D) > 20
    assert all(len(set(point.color)) == 1 for point in model.points3D.values())


@pytest.mark.slow
def test_backend(home: tuple[Desk, str]) -> None:
    desk, _ = home
    said = desk.follow(GENERATOR, section(GENERATOR.read_text(encoding="utf-8"), "## An engine"))
    desk.lint()
    assert "1 made" in said
    (observation,) = Dataset(desk.folder / "data/free-field")
    record = observation.record
    assert record is not None
    assert record.acoustics.backend == "free-field"
    desk.run(
        "python", "-c", "from generators.backends import observation_provenance as made_by; "
        "from generators.options import EngineOptions as Engines; "
        "assert 'generators/acoustics/free_field.py' in made_by(Engines(audio='free-field')).sources; "
        "assert 'generators/acoustics/free_field.py' not in made_by(Engines(audio='analytic')).sources",
    )  # fmt: skip
    # Louder at the ear that the source is nearer to.
    lateral = 0
    for frame in observation.frames:
        azimuth = direction_to(frame.pose, record.source_position).azimuth
        if 20 < abs(azimuth) < 160:
            left, right = np.sqrt(np.mean(np.square(frame.audio()), axis=1))
            assert (right > left) == (azimuth > 0)
            lateral += 1
    assert lateral


@pytest.mark.slow
def test_field(home: tuple[Desk, str]) -> None:
    desk, _ = home
    said = desk.follow(GENERATOR, section(GENERATOR.read_text(encoding="utf-8"), "## A field in `observation.json`"))
    desk.lint()
    assert "1 made" in said
    (path,) = (desk.folder / "data/walk").glob("part_*/*/*/*/observation.json")
    positions = np.array([frame["position"] for frame in json.loads(path.read_text())["frames"]])
    length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    printed = re.search(r"^walked (\S+)$", said, re.M)
    assert printed
    assert float(printed[1]) == pytest.approx(length)
    changed = path.read_text().replace('"walk_length": ', '"walk_length": 1')
    path.unlink()
    path.write_text(changed)
    code = "! avs3d validate data/walk --regenerate 1 --manifest mine.yaml"
    assert "walk_length differs from the regenerated value" in desk.run("bash", "-c", code)
    # A dataset that was made before the field keeps its bytes.
    code = "from avs3d_bench.formats import files; from avs3d_bench.contract.schema import ObservationRecord as R; "
    path = next((desk.folder / "data/mine").glob("part_*/*/*/*/observation.json"))
    desk.run("python", "-c", f"{code}p = r'{path}'; assert files.dump_json(files.read_record(p, R)) == open(p).read()")
