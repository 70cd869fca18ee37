"""An apartment like a scanner's output (one noisy mesh with holes): reading, placement, walk and rendering.

The same mesh, laid out as HM3D and Matterport3D lay theirs out, gives its rooms and materials by annotations alone.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics
from generators.assets.catalogue import build_model, variants
from generators.core.scene import Scene
from generators.lighting.bake import insert
from generators.paths.trajectory import WalkTask, plan_walk
from generators.placement.contact import LEAN
from generators.placement.placement import Placement, place
from generators.placement.site import Site
from generators.placement.spots import _level
from generators.scans.reverberation import trace_room
from generators.scans.scan import (
    ACOUSTIC_FACES,
    ACOUSTIC_FACES_BEYOND,
    ScanAcoustics,
    SoundReport,
    load_scan,
    read_scan,
)
from generators.vision.embree import EmbreeBackend
from tests.support import scan_like
from tests.support.flats import textured_flat
from tests.support.resting import gaps_below

ROOMS = ("bathroom", "kitchen", "living_room")
NOISE = 0.004
#: Regions of the annotations; the first is no room of the benchmark.
REGIONS = ["hall", "bathroom", "kitchen", "living_room"]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def home() -> Scene:
    """The three rooms of an apartment, with a toilet (what else would make the bathroom one?)."""
    flat = textured_flat(11)
    rng = np.random.default_rng(2)
    toilet = place(Site.of(flat, "bathroom"), [build_model("toilet", variants("toilet")[0], rng)], rng=rng)[0]
    parts = [p for p in flat.parts if p.name.removeprefix("shell_").split("/")[0] in ROOMS]
    parts.append(replace(toilet.part(0), name="bathroom/toilet_0"))
    return replace(flat, parts=tuple(parts))


@pytest.fixture(scope="module")
def fused(home: Scene) -> scan_like.Fused:
    return scan_like.fuse(home, np.random.default_rng(0), noise=NOISE, edge=0.3, texel=0.03)


@pytest.fixture(scope="module")
def labels(fused: scan_like.Fused) -> list[scan_like.Label]:
    return scan_like.labels_of(fused, REGIONS)


@pytest.fixture(scope="module")
def boxes(home: Scene) -> dict[str, list[tuple[float, ...]]]:
    """Drawn by hand: a few centimetres off."""
    return {
        name: [
            tuple(np.add(home.room(name).low, (0.03, 0.04, -0.02))),
            tuple(np.add(home.room(name).high, (-0.02, -0.05, 0.03))),
        ]
        for name in ROOMS
    }


@pytest.fixture(scope="module")
def read(fused: scan_like.Fused, boxes: dict, tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, SoundReport]:
    return read_scan("flat", scan_like.write_glb(fused, tmp_path_factory.mktemp("scan") / "flat.glb"), boxes)


@pytest.fixture(scope="module")
def scan(read: tuple[Scene, SoundReport]) -> Scene:
    return read[0]


@pytest.fixture(scope="module")
def report(read: tuple[Scene, SoundReport]) -> SoundReport:
    return read[1]


@pytest.fixture(scope="module")
def root(fused: scan_like.Fused, labels: list, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """HM3D below ``val``, Matterport3D below ``v1/tasks/mp3d``."""
    folder = tmp_path_factory.mktemp("scans")
    scan_like.write_hm3d(fused, folder, labels)
    scan_like.write_mp3d(fused, folder, labels, ["h", "a", "k", "f"])
    return folder


@pytest.fixture(scope="module")
def hm3d(root: Path) -> Scene:
    return load_scan("00800-TEEsavR23oF", root, need=ROOMS)


@pytest.fixture(scope="module")
def mp3d(root: Path) -> Scene:
    return load_scan("17DRP5sb8fy", root, need=ROOMS)


def model(category: str, seed: int = 1):
    rng = np.random.default_rng(seed)
    return build_model(category, variants(category)[0], rng)


# ---- the geometry alone -------------------------------------------------------------------------------------------


def test_the_mesh_is_one_anonymous_piece_with_holes(fused: scan_like.Fused, scan: Scene) -> None:
    (part,) = scan.parts
    (material,) = part.mesh.materials
    assert material.texture is not None
    assert part.light is None
    assert scan.stage is not None
    assert len(part.mesh.positions) == len(fused.faces)
    kitchen = Site.of(scan, "kitchen")
    centres = kitchen.space.cell_centres()
    down = kitchen.caster.closest(np.insert(centres, 1, 0.02, axis=1), np.tile([0.0, -1.0, 0.0], (len(centres), 1)))[0]
    assert (down > 0.2).any(), "no hole in the floor: the test's mesh proves nothing"


@pytest.mark.parametrize("room", ROOMS)
def test_the_floor_is_found_whatever_the_box_says(scan: Scene, boxes: dict, room: str) -> None:
    assert boxes[room][0][1] == pytest.approx(0.04)
    assert scan.room(room).low[1] == pytest.approx(0.0, abs=0.003)
    (floor,) = (s for s in scan.supports if s.kind == "floor" and s.room == room)
    assert floor.origin[1] == pytest.approx(0.0, abs=0.003)


def test_noise_is_measured_on_the_floor(scan: Scene, home: Scene) -> None:
    # Between noisy corners a face lies nearer to the truth than they do.
    assert 0.3 * NOISE < Site.of(scan, "kitchen").noise < 1.1 * NOISE
    assert Site.of(home, "kitchen").noise == 0


def test_worktops_tables_and_walls_are_found(scan: Scene, home: Scene) -> None:
    tops = {round(s.origin[1], 1) for s in scan.supports if s.room == "kitchen" and s.kind == "worktop"}
    counter = next(s for s in home.supports if s.room == "kitchen" and s.kind == "worktop")
    assert round(counter.origin[1], 1) in tops
    for room in ROOMS:
        low, high = np.array(home.room(room).low), np.array(home.room(room).high)
        for wall in (s for s in scan.supports if s.room == room and s.kind == "wall"):
            normal, origin = np.array(wall.normal), np.array(wall.origin)
            axis = int(np.argmax(np.abs(normal)))
            side = low[axis] if normal[axis] > 0 else high[axis]
            # A wall, or a large thing that stands or hangs close to it.
            assert abs(origin[axis] - side) < 0.45
        assert len({s.normal for s in scan.supports if s.room == room and s.kind == "wall"}) >= 2


@pytest.mark.parametrize(
    ("room", "category", "copies"),
    [
        ("bathroom", "washing_machine", 2),
        ("bathroom", "vacuum_cleaner", 1),
        ("kitchen", "microwave", 2),
        ("kitchen", "coffee_machine", 1),
        ("kitchen", "clock", 2),
        ("living_room", "telephone", 1),
        ("living_room", "vacuum_cleaner", 3),
    ],
)
def test_objects_stand_and_hang_where_they_belong(scan: Scene, room: str, category: str, copies: int) -> None:
    for placed in place(Site.of(scan, room), [model(category)] * copies, rng=np.random.default_rng(4)):
        touches_its_support(scan, placed)
        low, high = placed.bounds
        box = scan.room(room)
        assert (low >= np.array(box.low) - 0.1).all()
        assert (high <= np.array(box.high) + 0.1).all()


def touches_its_support(scan: Scene, placed: Placement) -> None:
    """The object touches the scan's own triangles, cuts nowhere into them, and floats no more than they are rough."""
    site = Site.of(scan, placed.support.room)
    gap, height = gaps_below(placed.mesh, site.caster, placed.support.normal)
    assert len(gap) > 50
    assert -0.002 < gap.min() < 0.003
    assert (gap < -0.0005).mean() < 0.01
    assert np.median(gap[height <= 0.01]) < 3 * NOISE
    assert np.degrees(np.linalg.norm(placed.tilt)) <= LEAN + 1e-6


def test_an_observation_goes_through(scan: Scene) -> None:
    rng = np.random.default_rng(7)
    placements = place(Site.of(scan, "kitchen"), [model("microwave"), model("coffee_machine")], rng=rng)
    poses = plan_walk(WalkTask(Site.of(scan, "kitchen"), placements, frames=24, height=1.5, hfov=90.0), rng).poses
    # Nobody walks over a hole, or through a wall by one.
    space = Site.of(scan, "kitchen").space
    assert space.contains(np.array([pose.position for pose in poses])[:, [0, 2]]).all()
    lit = insert(scan, tuple(p.part(n) for n, p in enumerate(placements, start=1)))
    view = EmbreeBackend().open(lit, Intrinsics.from_fov(96, 90.0))
    frames = [view.render(pose) for pose in poses]
    view.close()
    sharpest = max(frames, key=lambda frame: int((frame.instance_ids == 1).sum()))
    assert (sharpest.instance_ids == 1).sum() > 60
    assert {0, 1, 2} >= set(np.unique([frame.instance_ids for frame in frames]).tolist())
    # The objects are lit by the scan's own texture: neither black nor burnt out.
    brightness = sharpest.rgb[sharpest.instance_ids == 1].mean()
    assert 12 < brightness < 240


def test_levels_allow_for_noise_and_holes_only_on_scans() -> None:
    tidy = np.zeros((1, 25))
    rough = np.random.default_rng(0).normal(0, NOISE, (1, 25))
    holed = rough.copy()
    holed[0, :3] = -1e3
    torn = rough.copy()
    torn[0, :8] = -1e3
    assert _level(tidy, 0.0)[1][0]
    assert not _level(holed, 0.0)[1][0]
    assert [bool(_level(h, NOISE)[1][0]) for h in (rough, holed, torn)] == [True, True, False]
    # An object on a scan is tilted with the surface.
    tilted = rough + 0.02 * np.indices((5, 5))[0].reshape(1, -1) / 4
    assert not _level(tilted, 0.0)[1][0]
    assert _level(tilted, NOISE)[1][0]
    # It is lowered to the highest point; what went through holes does not count.
    assert [_level(h, NOISE)[0][0] for h in (rough, holed)] == [rough.max(), holed.max()]


# ---- rooms without coordinates ------------------------------------------------------------------------------------


@pytest.mark.parametrize("data_set", ["hm3d", "mp3d"])
@pytest.mark.parametrize("room", ROOMS)
def test_rooms_are_found_by_their_annotations(
    data_set: str, room: str, home: Scene, request: pytest.FixtureRequest
) -> None:
    found, truth = request.getfixturevalue(data_set).room(room), home.room(room)
    # To a reveal of a window or door.
    assert np.abs(np.subtract(found.low, truth.low)).max() < 0.2
    assert np.abs(np.subtract(found.high, truth.high)).max() < 0.2
    assert found.low[1] == pytest.approx(0, abs=0.01)


def test_both_ids_of_hm3d_name_the_same_scan(root: Path, hm3d: Scene) -> None:
    short = load_scan("TEEsavR23oF", root)
    assert short.rooms == hm3d.rooms
    assert short.supports == hm3d.supports
    assert short.stage == hm3d.stage
    assert hm3d.stage is not None
    assert (hm3d.stage.up, hm3d.stage.front) == ("z", "-y")


def test_boxes_of_the_manifest_win(root: Path, hm3d: Scene) -> None:
    low, high = hm3d.room("kitchen").low, hm3d.room("kitchen").high
    mine = [[low[0] + 0.1, low[1], low[2] + 0.1], list(high)]
    scan = load_scan("TEEsavR23oF", root, {"kitchen": mine})
    assert scan.room("kitchen").low[0] == pytest.approx(low[0] + 0.1)
    assert scan.room("bathroom") == hm3d.room("bathroom")


def test_nothing_is_put_on_seats_and_basins(hm3d: Scene, fused: scan_like.Fused) -> None:
    sofa = fused.bounds_of(fused.names.index("living_room/sofa_0"))
    for top in (s for s in hm3d.supports if s.kind not in ("floor", "wall")):
        middle = np.array(top.origin) + np.array(top.u) / 2 + np.array(top.v) / 2
        assert not ((middle > sofa[0]) & (middle < sofa[1])).all(), top


# ---- materials by annotations -------------------------------------------------------------------------------------


def most_common_label(scan: Scene, fused: scan_like.Fused, part: str, inset: float = 0.02) -> str:
    low, high = fused.bounds_of(fused.names.index(part))
    mesh = scan.parts[0].mesh
    middle = mesh.acoustic_positions.mean(axis=1)
    inside = ((middle > low - inset) & (middle < high + inset)).all(axis=1)
    values, counts = np.unique(np.array(mesh.acoustic_labels)[inside], return_counts=True)
    return str(values[np.argmax(counts)])


@pytest.mark.parametrize("data_set", ["hm3d", "mp3d"])
def test_objects_sound_like_what_they_are(data_set: str, fused: scan_like.Fused, request) -> None:
    scan = request.getfixturevalue(data_set)
    assert most_common_label(scan, fused, "living_room/sofa_0") == "upholstery"
    assert most_common_label(scan, fused, "kitchen/fridge_0") == "metal"
    assert most_common_label(scan, fused, "bathroom/toilet_0") == "ceramic"


def test_floors_sound_like_their_room_and_walls_like_walls(hm3d: Scene) -> None:
    """By area: mats of many small faces lie on the floor of a bathroom."""
    mesh = hm3d.parts[0].mesh
    middle, labels = mesh.acoustic_positions.mean(axis=1), np.array(mesh.acoustic_labels)
    edges = mesh.acoustic_positions[:, 1:] - mesh.acoustic_positions[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    for room, floor in (("bathroom", "tile"), ("kitchen", "parquet")):
        box = hm3d.room(room)
        over = ((middle >= box.low) & (middle <= box.high))[:, [0, 2]].all(axis=1)
        ground = over & (np.abs(middle[:, 1]) < 0.03)
        assert area[ground & (labels == floor)].sum() > 0.6 * area[ground].sum()
        assert (labels[over & (middle[:, 1] > 2.5)] == "plaster").mean() > 0.8


def test_the_acoustic_mesh_is_finest_in_the_rooms(scan: Scene, boxes: dict, tmp_path: Path, fused) -> None:
    mesh = scan.parts[0].mesh
    assert len(mesh.acoustic_positions) <= ACOUSTIC_FACES + ACOUSTIC_FACES_BEYOND
    path = scan_like.write_glb(fused, tmp_path / "flat.glb")
    alone = load_scan("flat", path, {"bathroom": boxes["bathroom"]})
    low, high = boxes["bathroom"]

    def inside(scan: Scene) -> int:
        middle = scan.parts[0].mesh.acoustic_positions.mean(axis=1)
        return int(((middle > low) & (middle < high)).all(axis=1).sum())

    assert inside(alone) > 1.5 * inside(scan)


def test_without_annotations_rooms_sound_like_the_home(report: SoundReport, home: Scene) -> None:
    """Guessed materials and closed holes: the reverberation of the home that was scanned."""
    assert {row.material for row in report.surfaces} >= {"plaster", "parquet", "tile", "wood", "clutter"}
    triangles = np.concatenate([part.mesh.acoustic_positions for part in home.parts]).astype(np.float64)
    labels = [label for part in home.parts for label in part.mesh.acoustic_labels]
    for decay in report.rooms:
        true = trace_room(triangles, labels, home.room(decay.room)).decay_time()
        assert decay.t30 == pytest.approx(true, rel=0.15), decay


def test_a_material_file_decides_for_the_categories_it_names(
    root: Path, fused: scan_like.Fused, tmp_path: Path
) -> None:
    file = tmp_path / "materials.json"
    file.write_text('{"materials": [{"name": "felt", "labels": ["Couch"], "absorption": [100, 0.5, 8000, 0.5]}]}')
    scan = load_scan("TEEsavR23oF", root, acoustics=ScanAcoustics(materials=file))
    assert most_common_label(scan, fused, "living_room/sofa_0").startswith("given:0.5000,")
    assert most_common_label(scan, fused, "kitchen/fridge_0") == "metal"


# ---- what is not there --------------------------------------------------------------------------------------------


def annotated(tmp_path: Path, fused: scan_like.Fused, labels: list[scan_like.Label]) -> Path:
    scan_like.write_hm3d(fused, tmp_path, labels)
    return tmp_path


def test_a_room_that_nobody_annotated_is_named_with_what_there_is(tmp_path: Path, fused, labels) -> None:
    root = annotated(tmp_path, fused, [label for label in labels if label.word != "toilet"])
    with pytest.raises(Avs3dError, match="no room 'bathroom'") as caught:
        load_scan("TEEsavR23oF", root, need=("bathroom",))
    message = str(caught.value)
    assert "kitchen, living_room by TEEsavR23oF.semantic.txt" in message
    assert "one with a toilet" in message
    assert "scans.TEEsavR23oF.rooms.bathroom" in message
    assert "\n" not in message


def test_annotations_without_their_mesh_are_named(tmp_path: Path, fused, labels) -> None:
    root = annotated(tmp_path, fused, labels)
    next(root.rglob("*.semantic.glb")).unlink()
    with pytest.raises(Avs3dError, match=re.escape(".semantic.glb is not there")):
        load_scan("TEEsavR23oF", root, need=("kitchen",))
