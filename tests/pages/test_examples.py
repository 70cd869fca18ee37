"""Each example of examples/ runs as a user runs it, and does what its docstring says."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest
import soundfile

from avs3d_bench.dataset import Dataset
from baselines.trivial import write_trivial
from evaluators.score import evaluate
from tests.support import warm
from tests.support.one_core import keep_to_one_core
from tests.support.shared import SharedDataset

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=17)


def run(name: str, *arguments: object, folder: Path, code: int = 0) -> str:
    """What an example prints, run in ``folder``."""
    done = subprocess.run(
        [*warm.python(), str(EXAMPLES / name), *map(str, arguments)],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
        timeout=600, preexec_fn=keep_to_one_core,
    )  # fmt: skip
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


def test_score_a_method(tmp_path: Path, data: Path) -> None:
    write_trivial("centre-box", Dataset(data), tmp_path / "box")
    said = run("score_a_method.py", data, "box", folder=tmp_path)
    scores = evaluate(tmp_path / "box", data).scores
    for part in ("part_1", "part_2"):
        group = scores.parts[part]
        assert group.official is not None
        assert group.strict is not None
        line = re.search(rf"^{part} .*$", said, re.M)
        assert line
        assert f"official mIoU {group.official.mIoU:.3f}" in line[0]
        assert f"strict IoU {group.strict.IoU:.3f}" in line[0]
    (tmp_path / "box/part_1/tiny/kitchen/1/masks/frame_000.png").write_bytes(b"no picture")
    assert "frame_000.png: " in run("score_a_method.py", data, "box", folder=tmp_path, code=1)


def test_write_a_method_is_short_and_finds_something(tmp_path: Path, data: Path) -> None:
    run("write_a_method.py", data, "mine", folder=tmp_path)
    overall = evaluate(tmp_path / "mine", data).scores.overall.strict
    assert overall is not None
    assert overall.IoU is not None
    assert overall.IoU > 0.01
    tree = ast.parse((EXAMPLES / "write_a_method.py").read_text(encoding="utf-8"))
    (method,) = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert method.end_lineno is not None
    assert method.end_lineno - method.lineno < 20


@pytest.mark.slow
def test_generate_own(tmp_path: Path) -> None:
    pytest.importorskip("trimesh", reason="the generator needs the [generate] extra")
    said = run("generate_own.py", "own", folder=tmp_path)
    assert "own: valid" in said
    (observation,) = Dataset(tmp_path / "own")
    record = observation.record
    assert record is not None
    assert (record.sounding.asset, record.sound.asset) == ("machine.glb", "drum.flac")
    low, high = np.array(record.sounding.bounds)
    assert high[1] - low[1] == pytest.approx(0.85, abs=1e-3)
    assert any(frame.visible_pixels for frame in record.frames)


@pytest.mark.slow
def test_moving_source(tmp_path: Path) -> None:
    pytest.importorskip("numba", reason="the tracer needs the [acoustics] extra")
    said = run("moving_source.py", "moving.wav", "--seconds", 0.5, folder=tmp_path)
    first, last = (float(value) for value in re.findall(r"left ear (\S+) dB", said))
    assert first > 2 > -2 > last  # from the left to the right
    samples, rate = soundfile.read(tmp_path / "moving.wav")
    assert (samples.shape, rate) == ((22_050, 2), 44_100)


@pytest.mark.slow
def test_own_room(tmp_path: Path) -> None:
    pytest.importorskip("trimesh", reason="meshes need the [acoustics] extra")
    said = run("own_room.py", folder=tmp_path)
    assert re.search(r"^floor\* +my_carpet +20.0 m²  floor_1$", said, re.M)
    assert float(re.search(r"1000 Hz: T30 (\S+) s", said)[1]) == pytest.approx(0.6, abs=0.3)  # type: ignore[index]
    assert (tmp_path / "own_room.wav").is_file()
    (tmp_path / "wrong.yaml").write_text("'flor*': parquet\n")
    trimesh = pytest.importorskip("trimesh")
    trimesh.Scene({"floor": trimesh.creation.box((5, 2.5, 4))}).export(tmp_path / "flat.glb")
    run("own_room.py", "flat.glb", "wrong.yaml", folder=tmp_path, code=1)


@pytest.mark.slow
def test_many_responses(tmp_path: Path) -> None:
    pytest.importorskip("numba", reason="the tracer needs the [acoustics] extra")
    run("many_responses.py", "rirs", "--rooms", 1, "--sources", 2, "--listeners", 2, folder=tmp_path)
    with tarfile.open(tmp_path / "rirs/rir-000000.tar") as tar:
        assert tar.getnames() == [f"{n:08d}.{ending}" for n in range(4) for ending in ("npy", "json")]


@pytest.mark.slow
def test_habitat_sensor(tmp_path: Path) -> None:
    pytest.importorskip("numba", reason="the tracer needs the [acoustics] extra")
    said = run("habitat_sensor.py", folder=tmp_path)
    ahead, turned = (float(value) for value in re.findall(r"left − right (\S+) dB", said))
    assert ahead > 1 > -1 > turned


@pytest.mark.slow
def test_hello_home(tmp_path: Path) -> None:
    pytest.importorskip("trimesh", reason="the generator needs the [generate] extra")
    said = run("hello_home.py", "hello", "--light", "preview", "--size", 96, folder=tmp_path)
    share = re.search(r"the microwave fills (\S+)% of the picture", said)
    assert share
    assert 2 < float(share[1]) < 60
    picture = cv2.imread(str(tmp_path / "hello/picture.png"))
    assert picture is not None
    assert picture.shape == (96, 96, 3)
    assert 50 < picture.mean() < 220
    samples, rate = soundfile.read(tmp_path / "hello/sound.wav")
    assert (samples.shape, rate) == ((4 * 44_100, 2), 44_100)
    assert 0.003 < np.abs(samples).max() < 1


@pytest.mark.slow
def test_the_notebook_of_a_home_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("trimesh", reason="the generator needs the [generate] extra")
    nbformat = pytest.importorskip("nbformat", reason="notebooks are run with nbclient, of the [dev] extra")
    nbclient = pytest.importorskip("nbclient", reason="notebooks are run with nbclient, of the [dev] extra")
    pytest.importorskip("ipykernel", reason="notebooks are run in ipykernel, of the [dev] extra")
    monkeypatch.setenv("AVS3D_LIGHT", "preview")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(EXAMPLES / "hello_home.ipynb", as_version=4)
    for cell in notebook.cells:
        cell.source = cell.source.replace("(384)", "(96)").replace('("home.glb")', '("home.glb", texel=0.03)')
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    data = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/jpeg" in each for each in data) == 3
    assert sum("<audio" in each.get("text/html", "") for each in data) == 1
    assert (tmp_path / "home.glb").stat().st_size > 1_000_000


@pytest.mark.slow
def test_train_on_it(tmp_path: Path, data: Path) -> None:
    pytest.importorskip("torch", reason="training needs torch, of the [baselines] extra")
    said = run("train_on_it.py", data, "trained", "--steps", 20, folder=tmp_path)
    found = re.search(r"^loss (\S+) → (\S+) in 20 steps$", said, re.M)
    assert found
    assert float(found[2]) < 0.9 * float(found[1])
    assert evaluate(tmp_path / "trained", data).scores.dataset.scored == 2


@pytest.mark.slow
def test_metrics_in_training(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="training needs torch, of the [baselines] extra")
    said = run("metrics_in_training.py", "--epochs", 3, folder=tmp_path)
    ious = [float(value) for value in re.findall(r"^epoch \d: IoU (\S+),", said, re.M)]
    assert len(ious) == 3
    assert ious[-1] > max(0.5, ious[0])
    by_clip, by_four = (float(value) for value in re.findall(r"with batches of \d: (\S+)$", said, re.M))
    assert by_clip < 0.6 * by_four  # half of the clips have no object
    assert re.search(r"^the same without batches: 0\.\d{4}$", said, re.M)


def executed(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict]:
    """The outputs of a notebook that is run in ``folder``."""
    pytest.importorskip("matplotlib", reason="the plots need matplotlib, of the [plot] extra")
    nbformat = pytest.importorskip("nbformat", reason="notebooks are run with nbclient, of the [dev] extra")
    nbclient = pytest.importorskip("nbclient", reason="notebooks are run with nbclient, of the [dev] extra")
    pytest.importorskip("ipykernel", reason="notebooks are run in ipykernel, of the [dev] extra")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def printed_in(outputs: list[dict]) -> str:
    """What cells print; a kernel sends it in pieces that differ from run to run."""
    return "".join("".join(o["text"]) for o in outputs if o["output_type"] == "stream" and o["name"] == "stdout")


@pytest.mark.slow
def test_the_notebook_on_metrics_is_committed_with_what_it_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = json.loads((EXAMPLES / "metrics.ipynb").read_text(encoding="utf-8"))["cells"]
    committed = printed_in([output for cell in cells for output in cell.get("outputs", [])])
    outputs = executed("metrics.ipynb", tmp_path, monkeypatch)
    assert printed_in(outputs) == committed
    assert sum("image/jpeg" in output.get("data", {}) for output in outputs) == 2
    by_clip, single = map(float, re.findall(r"0\.\d{3}", re.search("batches of one.*", committed)[0]))
    assert by_clip < 0.8 * single


@pytest.mark.slow
def test_the_notebook_on_acoustics_is_committed_with_what_it_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("trimesh", reason="the generator needs the [generate] extra")
    cells = json.loads((EXAMPLES / "acoustics.ipynb").read_text(encoding="utf-8"))["cells"]
    committed = printed_in([output for cell in cells for output in cell.get("outputs", [])])
    outputs = executed("acoustics.ipynb", tmp_path, monkeypatch)
    assert printed_in(outputs) == committed
    assert sum("image/jpeg" in output.get("data", {}) for output in outputs) == 2
    first, last = map(float, re.findall(r"([+-][\d.]+) dB at", committed))
    assert first > 1
    assert last < -1


@pytest.mark.slow
def test_the_tour_runs(tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_DATASET", str(data))
    outputs = executed("tour.ipynb", tmp_path, monkeypatch)
    assert sum("image/jpeg" in output.get("data", {}) for output in outputs) == 3
    printed = "".join(output.get("text", "") for output in outputs)
    overall = evaluate(write_trivial("all-white", Dataset(data), tmp_path / "white").path, data).scores.overall.strict
    assert overall is not None
    assert f"all_white     strict IoU {overall.IoU:.3f}" in printed


def test_the_tour_is_committed_with_its_pictures() -> None:
    file = EXAMPLES / "tour.ipynb"
    assert file.stat().st_size < 300_000
    cells = [cell for cell in json.loads(file.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert all(output["output_type"] in ("stream", "display_data", "execute_result") for output in outputs)
    assert sum("image/jpeg" in output.get("data", {}) for output in outputs) == 3
    (last,) = cells[-1]["outputs"]
    values = [float(line.split()[-1]) for line in last["text"]]
    assert values[0] > max(values[1:])  # the method of the tour beats those that do not listen
    assert not re.search(r"/(home|tmp|root|work)/", "".join(str(output.get("text", "")) for output in outputs))


def test_the_examples_are_listed() -> None:
    """Every script is run by a test of this module and named in the README's section on examples."""
    here = Path(__file__).read_text(encoding="utf-8")
    names = [path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb")]
    assert len(names) >= 4
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    for name in names:
        assert f'"{name}"' in here
        assert f"({name})" in page
