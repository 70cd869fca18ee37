"""The tables of the listener: rows that are there already, paired differences, the page and its pictures."""

from __future__ import annotations

import re
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.formats.files import read_json, write_json

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")

from avs3d_bench.dataset import Dataset  # noqa: E402
from baselines import sound_control  # noqa: E402
from baselines.echosegnet.cache import Stages  # noqa: E402
from baselines.echosegnet.heard_categories import work_folder  # noqa: E402
from baselines.echosegnet.network_masks import NetworkMasks  # noqa: E402
from baselines.listener import weights  # noqa: E402
from baselines.listener.marks import ListenerMarker  # noqa: E402
from baselines.listener.model import Listener  # noqa: E402
from baselines.listener.predict import ListenerMethod, looks_at  # noqa: E402
from benchmarks import listener_failures, listener_page, listener_tables  # noqa: E402
from benchmarks.listener_tables import ROWS, RUN_JSON, labelled, rows_of  # noqa: E402
from tests.support import score_examples, tiny_scenes  # noqa: E402
from tests.support.tiny_listener import SMALL  # noqa: E402

#: Rows of the listener beside its own answer to its own sound.
CONTROLS = ("no-sound", "wrong-sound", "same-category", "swapped-ears", "both-ears-mean", "direction", "both")
PAGE = "# Listener\n\nbefore\n\n<!-- tables -->\nold\n<!-- end of tables -->\n\nafter\n"


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the rows of a tiny dataset of part_3 observations, and what was said of them."""
    folder = tmp_path_factory.mktemp("tables")
    keys = (tiny_scenes.FIRST, tiny_scenes.SECOND)
    tiny_scenes.write_part_3(folder / "scenes", frames=9, size=32, keys=keys)
    torch.manual_seed(0)
    weights.save_weights(Listener(SMALL), folder / "weights")
    with pytest.MonkeyPatch.context() as patch:
        # Both siblings are of one group, which has no foreign sound: another frame's serves.
        patch.setattr(sound_control, "other_frame", lambda frame, same_category: frame.observation.frames[0])
        (folder / "first.txt").write_text(run(folder))
    return folder


def run(folder: Path, *extra: str) -> str:
    arguments = [str(folder / "scenes"), "-o", str(folder / "results"), "--work", str(folder / "work"), "--device",
                 "cpu", "--workers", "1", "--weights", str(folder / "weights"), *extra]  # fmt: skip
    found = CliRunner().invoke(listener_tables.main, arguments, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    return found.output


def test_the_rows_of_a_kind_or_a_name() -> None:
    assert [row.name for row in rows_of(["listener", "spatial"])] == ["2d", *CONTROLS, "spatial"]
    assert set(listener_tables.KINDS) == {row.kind for row in ROWS.values()}
    controls = rows_of(["controls"])
    assert len(controls) == 10
    assert {(row.name, row.answer, row.sound) for row in controls} > {
        ("both-no-sound", "both", "none"),
        ("direction-swapped-ears", "direction", "swapped-ears"),
    }
    lifted = [f"{row}-{name}" for row in ("spatial", "spatial-direction") for name in CONTROLS[:5]]
    assert [row.name for row in rows_of(["controls-3d"])] == lifted


def test_a_control_of_echosegnet_reaches_its_network_and_its_choice(tmp_path: Path) -> None:
    plan = listener_tables.Plan(tmp_path, tmp_path, None, "", "category", ("cpu",), 1, 10, None, ())
    for row in rows_of(["controls-3d"]):
        source, settings = listener_tables.lifting(row, plan)
        assert isinstance(source.marker, ListenerMarker)
        assert source.marker.hearing == settings.sound == row.sound == plan.said(row)["sound"] != "own"
    (row,) = rows_of(["spatial-direction"])
    assert plan.said(row)["answer"] == "direction"
    assert listener_tables.lifting(row, plan)[0].name == "listener (direction)"


def test_labels_are_names_of_folders_unless_they_are_given(tmp_path: Path) -> None:
    found = labelled([f"{tmp_path}/open", f"other={tmp_path}/open"])
    assert found == {"open": tmp_path / "open", "other": tmp_path / "open"}
    with pytest.raises(click.UsageError, match="another dataset has the label open"):
        labelled(["a/open", "b/open"])


def test_a_picture_is_seen_once_whatever_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    network, seen = Listener(SMALL).eval(), []
    see = network.see
    monkeypatch.setattr(network, "see", lambda picture: seen.append(picture) or see(picture))
    pictures = list(rng.integers(0, 256, (2, 64, 64, 3), np.uint8))
    cameras = np.asarray([(0.5, 0.5, 0.5, 0.5)] * 2, np.float32)
    first = rng.standard_normal((2, 2, 44_100)).astype(np.float32) * 0.1
    plain = ListenerMethod(network, torch.device("cpu"), "")
    shared = listener_tables.SharedLooks(**vars(plain))
    with torch.inference_mode():
        for sounds in (first, first[:, ::-1].copy(), np.zeros_like(first)):
            before = len(seen)
            alone = plain.answers(pictures, sounds, cameras)
            looks, before = len(seen) - before, len(seen)
            for one, other in zip(alone, shared.answers(pictures, sounds, cameras), strict=True):
                np.testing.assert_array_equal(one.mask, other.mask)
                np.testing.assert_array_equal(one.audible, other.audible)
            assert len(seen) - before == (looks if sounds is first else 0)
        shared.answers(pictures[::-1], first, cameras)
    assert len(seen) - before == looks, "other pictures are looked at"


@pytest.mark.slow
def test_marks_of_all_rows_of_echosegnet_are_made_from_one_look_at_each_picture(
    ran: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The masks are those that each row would make by itself, and the rows find them."""
    plan = listener_tables.Plan(
        tmp_path, tmp_path, ran / "weights", "", "category", ("cpu",), 1, 10, None, (tiny_scenes.FIRST,)
    )
    rows = rows_of(["spatial", "spatial-swapped-ears", "spatial-direction"])
    shown: list[int] = []
    see = Listener.see
    monkeypatch.setattr(Listener, "see", lambda self, picture: shown.append(len(picture)) or see(self, picture))
    dataset = Dataset(ran / "scenes")
    listener_tables._mark(dataset, rows, plan)
    (observation,) = dataset.select(tiny_scenes.FIRST)
    looks = looks_at(observation.intrinsics.width, "several")
    assert sum(shown) == len(observation.train) * len(looks)
    cpu = torch.device("cpu")
    for row in rows:
        masks = NetworkMasks(listener_tables.marker_of(row, plan))
        before = len(shown)
        kept = masks.found(observation, cpu, Stages(work_folder(plan.stages, observation)))
        assert len(shown) == before
        alone = masks.found(observation, cpu, Stages(tmp_path / "alone"))
        assert len(shown) > before
        assert kept.files.keys() == alone.files.keys() == {frame.name for frame in observation.train}
        assert all(np.array_equal(kept.files[name], alone.files[name]) for name in kept.files)


@pytest.mark.slow
def test_every_row_is_scored_once(ran: Path) -> None:
    names = {"category", "deaf-all", "deaf-single", "2d", *CONTROLS}
    assert {path.name for path in (ran / "results").glob("listener-scenes-*.json")} == {
        f"listener-scenes-{name}.json" for name in names
    }
    assert "there already" not in (ran / "first.txt").read_text()
    assert run(ran).count("there already") == len(names)
    said = read_json(ran / "results" / RUN_JSON)
    digest = weights.load_listener(ran / "weights")[1]
    assert said["weights"] == said["rows"]["scenes-2d"]["settings"]["weights"] == digest
    assert said["rows"]["scenes-2d"]["frames"] == 4
    scores = read_json(ran / "results/listener-scenes-no-sound.json")
    assert scores["submission"]["method"] == "listener, 2D, without sound"
    assert "heard nothing" in scores["submission"]["notes"]


@pytest.mark.slow
def test_other_settings_are_computed_again(ran: Path) -> None:
    path = ran / "results" / RUN_JSON
    before = path.read_bytes()
    document = read_json(path)
    document["rows"]["scenes-2d"]["settings"]["weights"] = "0" * 64
    write_json(path, document)
    output = run(ran)
    assert output.count("there already") == 3 + len(CONTROLS)
    assert "scenes-2d: there already" not in output
    path.write_bytes(before)


@pytest.mark.slow
def test_the_page_has_every_method_the_differences_and_the_pictures(ran: Path) -> None:
    page = ran / "docs/page.md"
    page.parent.mkdir()
    page.write_text(PAGE)
    arguments = [str(ran / "results"), str(ran / "scenes"), "--work", str(ran / "work"), "--page", str(page)]
    found = CliRunner().invoke(listener_page.main, arguments, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    text = page.read_text()
    assert text.startswith("# Listener\n\nbefore\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "- [scenes](results/listener-scenes.md)" in text
    tables = (ran / "docs/results/listener-scenes.md").read_text()
    assert tables.startswith("# The listener on scenes\n")
    assert "(../page.md)" in tables
    for row in ("deaf-all", "deaf-single", "category"):
        assert f"| {ROWS[row].title} (n = 2) |" in tables
    for row in ("2d", *CONTROLS):
        assert f"- {ROWS[row].title}: several looks" in tables
        assert f"| {ROWS[row].title} (several looks, n = 2) |" in tables
        assert re.search(rf"^\| {ROWS[row].title} \| [\d.]+ \| \d+ ms \|", tables, re.MULTILINE)
    assert f"| part_3 | {ROWS['2d'].title} − {ROWS['wrong-sound'].title} | listen IoU |" in tables
    assert "| *deaf all* |" in tables
    assert "(../images/listener-scenes-failures.jpg)" in tables
    picture = cv2.imread(str(ran / "docs/images/listener-scenes-failures.jpg"))
    assert picture.shape[1] == 4 * listener_failures.SIDE + 5 * listener_failures.GAP


@pytest.mark.slow
def test_rows_of_former_weights_are_no_part_of_the_page(ran: Path) -> None:
    document = read_json(ran / "results" / RUN_JSON)
    document["rows"]["scenes-no-sound"]["settings"]["weights"] = "0" * 64
    tables = listener_page.dataset_page("scenes", document, ran / "results", None, "page.md")
    assert tables is not None
    title = ROWS["no-sound"].title
    assert f"Measured with former weights alone, and left out here: {title}." in tables
    assert f"| {title}" not in tables
    assert f"| {ROWS['2d'].title} (several looks, n = 2) |" in tables


@pytest.mark.slow
def test_a_control_whose_sound_the_data_lack_is_left_out(ran: Path, tmp_path: Path) -> None:
    """All observations are of one home."""
    output = run(
        ran, "--rows", "same-category", "--rows", "swapped-ears", "-o", str(tmp_path), "--only", tiny_scenes.FIRST
    )
    assert "scenes-same-category: left out: " in output
    assert "no observation of the same category in another home" in output
    assert [path.name for path in tmp_path.glob("listener-scenes-*.json")] == ["listener-scenes-swapped-ears.json"]
    assert list(read_json(tmp_path / RUN_JSON)["rows"]) == ["scenes-swapped-ears"]


def test_a_tone_is_a_line_at_its_octave_in_the_ear_that_hears_it() -> None:
    tone = 0.1 * np.sin(2 * np.pi * 1378.125 * np.arange(44_100) / 44_100)  # four octaves below half of the rate
    shown = listener_failures.spectrograms(np.stack([tone, 0 * tone]).astype(np.float32)).sum(axis=2)
    half = listener_failures.SIDE // 2
    assert abs(int(shown[:half].sum(axis=1).argmax()) - half / 2) <= 2
    assert shown[half:].max() < 60 < 300 < shown[:half].max()


def test_a_page_without_marks_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(
        listener_page.Avs3dError, match=r"page.md: expected the lines <!-- tables --> and <!-- end of tables -->"
    ):
        listener_page.insert(tmp_path / "page.md", "nothing", "tables", "text")


def test_the_paper_stands_beside_parts_1_and_2() -> None:
    scores = score_examples.example_scores(8, seed=1, method="mine")
    lines = listener_page.part_table("part_2", {"2d": scores})
    assert "| paper: EchoSegnet with AISRM | 0.801 | 0.714 | – | – | – | – |" in lines
    assert any(line.startswith("| listener, 2D (n = ") for line in lines)


def test_differences_are_those_of_common_observations() -> None:
    better, worse = (score_examples.example_scores(16, seed=1, skill=skill) for skill in (0.9, 0.2))
    lines = listener_page.difference_table({"2d": better, "no-sound": worse})
    (line,) = [line for line in lines if line.startswith("| part_1 ") and "strict IoU" in line]
    assert line.endswith("| better |")


def test_the_worst_and_the_median_observations_are_shown() -> None:
    scores = score_examples.example_scores(16, seed=1)
    ranked = sorted(one.strict.IoU for one in scores.observations if one.strict and one.strict.IoU is not None)
    found = listener_failures.chosen(scores)
    assert [iou for kind, _, iou in found if kind == "worst"] == ranked[:4]
    middle = [iou for kind, _, iou in found if kind == "median"]
    assert middle == ranked[len(ranked) // 2 - 1 : len(ranked) // 2 + 1]
