"""A scan from above: it shows the home where it is and nothing that was placed in it; procedural homes have none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from click.testing import CliRunner

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import TopViewRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from avs3d_bench.validate import validate
from generators.cli import generate
from generators.core.scene import Room
from generators.observation.generate import generate_observation
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from generators.scans.scan import load_scan
from generators.vision.top_view import MARGIN, PIXELS_PER_METRE, TopView, render_top_view
from tests.support.homes import tree_digest
from tests.support.rooms import kitchen

#: Of the room, and RGB (0 or 255) of its four quarters: north-west, north-east, south-west, south-east.
WIDTH, DEPTH, HEIGHT = 4.0, 3.0, 2.5
QUARTERS = ((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0))
TABLE, CEILING = (0, 255, 255), (255, 0, 255)
#: Of the table's top: x and z of its corners, and its height.
TOP = ((-1.5, -1.2), (-0.5, -0.4), 0.75)
BOX = [[-WIDTH / 2, 0.0, -DEPTH / 2], [WIDTH / 2, HEIGHT, DEPTH / 2]]


def _rectangle(
    low: tuple[float, float], high: tuple[float, float], y: float, colour: tuple[int, ...]
) -> trimesh.Trimesh:
    """A level rectangle in squares of at most 20 cm, seen from above and below."""
    (x0, z0), (x1, z1) = low, high
    corners = [[x0, y, z0], [x0, y, z1], [x1, y, z1], [x1, y, z0]]
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False).subdivide_to_size(0.2)
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=[*colour, 255])
    return mesh


def coloured_room() -> trimesh.Trimesh:
    """A floor of four colours, a table, walls of grey and a ceiling."""
    x, z = WIDTH / 2, DEPTH / 2
    places = (((-x, -z), (0, 0)), ((0, -z), (x, 0)), ((-x, 0), (0, z)), ((0, 0), (x, z)))
    pieces = [_rectangle(low, high, 0.0, colour) for (low, high), colour in zip(places, QUARTERS, strict=True)]
    walls = trimesh.creation.box([WIDTH, HEIGHT, DEPTH])
    walls.update_faces(np.abs(walls.face_normals[:, 1]) < 0.5)
    walls.invert()
    walls = walls.subdivide_to_size(0.3)
    walls.apply_translation([0, HEIGHT / 2, 0])
    walls.visual = trimesh.visual.ColorVisuals(walls, face_colors=[128, 128, 128, 255])
    table = _rectangle(*TOP, TABLE)
    return trimesh.util.concatenate([*pieces, walls, table, _rectangle((-x, -z), (x, z), HEIGHT, CEILING)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("scans")
    coloured_room().export(root / "room.ply")
    return root


def view_of(folder: Path) -> TopView:
    scan = load_scan("room", folder, {"kitchen": BOX})
    view = render_top_view(scan, scan.rooms[0])
    assert view is not None
    return view


def colour_at(view: TopView, x: float, z: float) -> tuple[int, ...]:
    row, column = ((z - view.top) / view.height * len(view.rgb), (x - view.left) / view.width * view.rgb.shape[1])
    return tuple(int(c) for c in view.rgb[int(row), int(column)])


def alike(colour: tuple[int, ...], wanted: tuple[int, ...]) -> bool:
    return max(abs(a - b) for a, b in zip(colour, wanted, strict=True)) <= 2


def test_the_floor_is_where_the_record_says(folder: Path) -> None:
    view = view_of(folder)
    # As far as the scan reaches, which is less than the margin.
    assert (view.left, view.top) == (-WIDTH / 2, -DEPTH / 2)
    assert (view.width, view.height) == pytest.approx((WIDTH, DEPTH), abs=1.01 / PIXELS_PER_METRE)
    for x, z, colour in zip((-1.0, 1.0, -1.0, 1.0), (-0.1, -0.1, 0.1, 0.1), QUARTERS, strict=True):
        assert alike(colour_at(view, x, z), colour)
    # The quarters meet within a pixel of the middle.
    row = view.rgb[int(1.0 / view.height * len(view.rgb) + len(view.rgb) / 2)]
    blue = np.flatnonzero((row == (1, 1, 255)).all(axis=1))
    assert blue[-1] == pytest.approx(view.rgb.shape[1] / 2, abs=1.5)


def test_furniture_hides_the_floor_and_the_ceiling_is_cut_away(folder: Path) -> None:
    view = view_of(folder)
    (x0, z0), (x1, z1), _ = TOP
    assert alike(colour_at(view, (x0 + x1) / 2, (z0 + z1) / 2), TABLE)
    assert not (np.abs(view.rgb.astype(int) - CEILING).max(axis=2) <= 2).any()
    # Nothing leans: the table's area is that of its top, within a pixel all around.
    area = int((np.abs(view.rgb.astype(int) - TABLE).max(axis=2) <= 2).sum()) / PIXELS_PER_METRE**2
    assert area == pytest.approx((x1 - x0) * (z1 - z0), rel=0.06)


@pytest.mark.slow
def test_what_is_beyond_the_margin_is_left_out_and_what_is_not_there_is_black(folder: Path) -> None:
    scan = load_scan("room", folder, {"kitchen": BOX})
    corner = Room("corner", (1.5, 0.0, 1.0), (2.0, HEIGHT, 1.5))
    view = render_top_view(scan, corner)
    assert view is not None
    assert (view.left, view.top) == (1.5 - MARGIN, 1.0 - MARGIN)
    assert view.left + view.width == pytest.approx(2.0, abs=0.02)
    holed = coloured_room()
    middle = holed.triangles_center
    holed.update_faces(~((middle[:, 1] < 0.1) & (middle[:, 0] > 0.3) & (middle[:, 2] > 0.3)))
    holed.export(folder / "holed.ply")
    again = load_scan("holed", folder, {"kitchen": BOX})
    seen = render_top_view(again, again.rooms[0])
    assert seen is not None
    assert colour_at(seen, 1.2, 0.9) == (0, 0, 0)
    assert colour_at(seen, -1.0, 0.9) != (0, 0, 0)


def test_a_home_that_is_no_scan_has_no_picture() -> None:
    home = kitchen().scene
    assert render_top_view(home, home.rooms[0]) is None


def test_a_scan_without_colours_has_no_picture(folder: Path) -> None:
    scan = load_scan("room", folder, {"kitchen": BOX}, textures=False)
    assert render_top_view(scan, scan.rooms[0]) is None


def manifest(folder: Path, **entry: object) -> Path:
    usual = {"part": "part_1", "scan": "room", "room": "kitchen", "index": 1}
    document = {
        "name": "scanned", "version": "1.0.0", "seed": 5, "camera": {"size": 48, "frames": 9},
        "scans": {"room": {"source": "scan", "rooms": {"kitchen": BOX}}}, "observations": [usual | entry],
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "m.yaml").write_text(yaml.safe_dump(document))
    return folder / "m.yaml"


@pytest.mark.slow
def test_no_placed_object_is_seen_and_what_sounds_changes_nothing(folder: Path, tmp_path: Path) -> None:
    """Leak test on a scan: once the clock sounds beside a coffee machine, once the machine beside a clock."""
    trees, both = [], ("clock", "coffee_machine")
    for sounding in both:
        silent = [name for name in both if name != sounding]
        path = manifest(tmp_path / sounding, category=sounding, silent=silent)
        (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic", scans=folder))
        record = generate_observation(plan, tmp_path / sounding / "out", tmp_path / "cache")
        assert record.sounding.category == sounding
        trees.append(tree_digest(tmp_path / sounding / "out" / plan.key))
        rgb = media.read_png_rgb(tmp_path / sounding / "out" / plan.key / layout.TOP_VIEW)
        empty = view_of(folder)
        assert np.array_equal(rgb, empty.rgb)
        area = TopViewRecord(left=empty.left, top=empty.top, width=empty.width, height=empty.height)
        assert record.top_view == area
    differ = {name.split("/")[0] for name in trees[0] if trees[0][name] != trees[1][name]}
    assert layout.TOP_VIEW in trees[0]
    assert differ <= {"audio_clips_binaural", "audio_clips_mono", "semantic_masks", "gt_3d", "observation.json"}


@pytest.mark.slow
def test_a_dataset_in_a_scan_is_valid_and_misses_its_picture(folder: Path, tmp_path: Path) -> None:
    path = manifest(tmp_path, category="clock", silent=["coffee_machine"])
    out = tmp_path / "out"
    words = [path, "-o", out, "--audio", "analytic", "--scans", folder, "--cache", tmp_path / "cache"]
    words += ["--workers", "1"]
    made = CliRunner().invoke(generate, [str(word) for word in words])
    assert made.exit_code == 0, made.output

    def faults(deep: bool = False) -> list[str]:
        found = validate(out, deep=deep).problems
        return [problem.path.rpartition("/")[2] for problem in found if problem.severity == "error"]

    assert faults(deep=True) == []
    (observation,) = Dataset(out)
    picture = observation.path / layout.TOP_VIEW
    data = picture.read_bytes()
    picture.unlink()
    assert set(faults()) == {layout.TOP_VIEW}
    picture.write_bytes(data[:-20])
    assert set(faults(deep=True)) == {layout.TOP_VIEW}


def test_a_sealed_test_keeps_the_picture() -> None:
    assert not layout.is_public(layout.TOP_VIEW)
    assert layout.TOP_VIEW in layout.expected_files(1, top_view=True)
    assert layout.TOP_VIEW not in layout.expected_files(1)
