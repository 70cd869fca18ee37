"""What a scan without annotations sounds like: guessed places, closed holes, the reverberation that was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.signal import fftconvolve

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose, direction_to
from avs3d_bench.measures.decay import eyring, reverberation_time
from avs3d_bench.validation.interaural import SURE, SideFit, side_level
from generators.acoustics.materials import MATERIALS, material_for, scaled_label, spectral_label
from generators.acoustics.tracer.backend import TracerBackend
from generators.core.low_discrepancy import fibonacci_directions
from generators.core.rays import RayCaster
from generators.core.scene import Material, Mesh, Room, Scene, Texture
from generators.manifest.schema import ScanAcousticsSpec, ScanSpec
from generators.plan import make_plans, read_manifest
from generators.scans.backing import backing_of, rectangles_of
from generators.scans.places import PLACES, REASONS, places_of
from generators.scans.ray_walk import escaped_share
from generators.scans.reverberation import furnished_range, match_rooms, scale_for, trace_room
from generators.scans.scan import ScanAcoustics, load_scan, read_scan
from generators.scans.sound import MATERIAL_OF, check_surfaces
from tests.support.tiers import some

ROOM = Room("living_room", (0.0, 0.0, 0.0), (4.0, 2.5, 5.0))
REAL = Path(__file__).parents[3] / "shared" / "scans" / "tatami_room.glb"
REAL_ROOMS = {"living_room": [[-1.38, -1.65, -2.0], [1.29, 0.95, 1.74]]}
BEIGE, WHITE = (200, 190, 170), (255, 255, 255)


def box(low, high, *, edge: float = 0.1, inside: bool = False) -> np.ndarray:
    """(F, 3, 3) triangles of a box."""
    mesh = trimesh.creation.box(np.subtract(high, low))
    mesh.apply_translation(np.add(low, high) / 2)
    if inside:
        mesh.invert()
    return np.asarray(mesh.subdivide_to_size(edge).triangles)


def heap(centre, radius: float, seed: int) -> np.ndarray:
    """A lumpy dome: cushions, clothes."""
    ball = trimesh.creation.icosphere(3, radius)
    bumps = np.random.default_rng(seed).uniform(0.85, 1.15, (len(ball.vertices), 1))
    return np.asarray(trimesh.Trimesh(ball.vertices * bumps + centre, ball.faces, process=False).triangles)


def books(low, high) -> np.ndarray:
    """Spines along the wall x = low[0], melted by the scanner: strips at different depths that lean."""
    rng, pieces = np.random.default_rng(5), []
    for y in np.arange(low[1], high[1] - 0.2, 0.3):
        for z in np.arange(low[2], high[2] - 0.03, 0.04):
            lean, tall = np.radians(rng.uniform(-45, 45)), rng.uniform(0.18, 0.28)
            one = trimesh.creation.box([rng.uniform(0.12, 0.25), tall, 0.03])
            one.apply_transform(trimesh.transformations.rotation_matrix(lean, [0, 1, 0]))
            one.apply_transform(trimesh.transformations.rotation_matrix(lean, [0, 0, 1]))
            one.apply_translation([low[0] + 0.15, y + tall / 2, z])
            pieces.append(np.asarray(one.subdivide_to_size(0.1).triangles))
    return np.concatenate(pieces)


def curtain(x: float, low: float, high: float, top: float) -> np.ndarray:
    """Folds of 12 cm before the wall at ``x``."""
    z = np.arange(low, high, 0.02)
    depth = x - 0.12 + 0.05 * np.sin(2 * np.pi * z / 0.12)
    y = np.linspace(0.05, top, 24)
    points = np.stack([np.broadcast_to(depth, (len(y), len(z))), *np.meshgrid(y, z, indexing="ij")], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack(t, axis=-2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


def coloured(pieces: dict[str, np.ndarray], colours: dict[str, tuple], seed: int = 0) -> Mesh:
    """One mesh of pieces with one colour each; ``None``: every face has another one."""
    corners = np.concatenate(list(pieces.values()))
    rng = np.random.default_rng(seed)
    texels = np.concatenate(
        [
            np.tile(np.array(colours.get(name, BEIGE), dtype=np.uint8), (len(piece), 1))
            if colours.get(name, BEIGE) is not None
            else rng.choice([20, 235], (len(piece), 1)).repeat(3, axis=1).astype(np.uint8)
            for name, piece in pieces.items()
        ]
    )
    uv = np.zeros((len(corners), 3, 2))
    uv[..., 0], uv[..., 1] = ((np.arange(len(corners)) + 0.5) / len(corners))[:, None], 0.5
    material = Material("scan", "plaster", texture=Texture("scan", texels[None]))
    f32 = corners.astype(np.float32)
    return Mesh(
        f32,
        np.zeros_like(f32),
        uv.astype(np.float64),
        np.zeros(len(f32), dtype=np.int32),
        (material,),
        f32,
        ("plaster",) * len(f32),
    )


def furnished() -> tuple[Mesh, np.ndarray]:
    """A room with one of each place, and (F,) what each face is."""
    shell = box(ROOM.low, ROOM.high, inside=True)
    middle = shell.mean(axis=1)
    pane = (middle[:, 2] > 4.999) & (np.abs(middle[:, 0] - 2) < 0.6) & (np.abs(middle[:, 1] - 1.5) < 0.5)
    floor, ceiling = middle[:, 1] < 0.001, middle[:, 1] > 2.499
    pieces = {
        "floor": shell[floor],
        "ceiling": shell[ceiling],
        "window": shell[pane],
        "wall": shell[~(floor | ceiling | pane)],
        "soft": heap([2.0, 0.35, 1.5], 0.5, 1),
        "shelves": books([0.0, 0.3, 1.0], [0.3, 2.0, 2.6]),
        "curtain": curtain(4.0, 1.0, 3.0, 2.2),
        "furniture": box([1.4, 0.0, 3.4], [2.4, 0.75, 4.0]),
    }
    mesh = coloured(pieces, {"window": WHITE, "shelves": None})
    return mesh, np.repeat(list(pieces), [len(piece) for piece in pieces.values()])


def confusion(places: np.ndarray, truth: np.ndarray, mesh: Mesh, kind: str) -> float:
    """Share of the area of ``kind`` that was recognised."""
    corners = mesh.acoustic_positions.astype(float)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return float(area[(places == kind) & (truth == kind)].sum() / area[truth == kind].sum())


# ---- places -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def guessed() -> tuple[Mesh, np.ndarray, np.ndarray]:
    mesh, truth = furnished()
    return mesh, truth, places_of(mesh, [(ROOM, 0.0)])


@pytest.mark.parametrize(
    ("kind", "least"),
    [("floor", 0.95), ("ceiling", 0.95), ("wall", 0.8), ("window", 0.85), ("soft", 0.8), ("shelves", 0.7),
     ("curtain", 0.7), ("furniture", 0.7)],
)  # fmt: skip
def test_each_place_is_recognised(guessed: tuple, kind: str, least: float) -> None:
    mesh, truth, places = guessed
    assert confusion(places, truth, mesh, kind) >= least, {k: int((places[truth == kind] == k).sum()) for k in PLACES}


def test_a_white_wall_is_no_window() -> None:
    """White is clipped, but nothing around it is darker."""
    shell = box(ROOM.low, ROOM.high, inside=True)
    places = places_of(coloured({"wall": shell}, {"wall": WHITE}), [(ROOM, 0.0)])
    assert "window" not in set(places)


@pytest.mark.slow
def test_noise_of_a_scanner_makes_no_flat_surface_soft() -> None:
    mesh, truth = furnished()
    keys, index = np.unique(np.round(mesh.positions.reshape(-1, 3), 4), axis=0, return_inverse=True)
    moved = (keys + np.random.default_rng(3).normal(0, 0.006, keys.shape))[index.reshape(-1)].reshape(-1, 3, 3)
    noisy = replace(mesh, positions=moved.astype(np.float32), acoustic_positions=moved.astype(np.float32))
    places = places_of(noisy, [(ROOM, 0.0)])
    for kind in ("floor", "wall", "ceiling"):
        assert confusion(places, truth, mesh, kind) >= 0.75, kind


def test_every_place_has_a_material_and_a_reason() -> None:
    assert set(MATERIAL_OF) == set(REASONS) == set(PLACES)
    assert set(MATERIAL_OF.values()) <= set(MATERIALS)


# ---- holes --------------------------------------------------------------------------------------------------------


def without(triangles: np.ndarray, low, high) -> np.ndarray:
    middle = triangles.mean(axis=1)
    return triangles[~((middle >= low) & (middle <= high)).all(axis=1)]


@pytest.mark.parametrize(
    "hole",
    some(
        [
            (([-0.1, 2.4, -0.1], [4.1, 2.6, 5.1]),),  # no ceiling at all
            (([-0.1, -0.1, -0.1], [4.1, 0.1, 5.1]),),  # no floor
            (([-0.1, 0.0, 1.0], [0.1, 2.0, 1.9]),),  # a doorway
            (([1.0, 0.5, 4.9], [2.4, 2.0, 5.1]),),  # a window
        ],
        every=4,
    ),
)
def test_no_sound_leaves_a_room_that_is_closed(hole: tuple) -> None:
    scan = without(box(ROOM.low, ROOM.high, inside=True), *hole)
    before = escaped_share(RayCaster(scan), scan, [ROOM])
    backing = backing_of(scan, [ROOM])
    closed = np.concatenate([scan, backing.triangles])
    assert before > 0.01
    assert backing.escaped == pytest.approx(before)
    assert escaped_share(RayCaster(closed), closed, [ROOM]) <= 1e-3
    _, face = RayCaster(closed).closest(np.tile([2.0, 1.2, 2.5], (5000, 1)), fibonacci_directions(5000))
    assert (face >= 0).all()


def test_a_missing_ceiling_is_closed_at_its_height() -> None:
    backing = backing_of(without(box(ROOM.low, ROOM.high), [-1, 2.4, -1], [5, 2.6, 6]), [ROOM])
    _, face = RayCaster(backing.triangles).closest([[2.0, 1.2, 2.5]], [[0.0, 1.0, 0.0]])
    assert backing.places[face[0]] == "ceiling"
    assert backing.triangles[face[0], :, 1] == pytest.approx(2.5, abs=0.02)


def test_a_closed_scan_gets_no_shell() -> None:
    assert not len(backing_of(box(ROOM.low, ROOM.high), [ROOM]).triangles)


@pytest.mark.slow
def test_doorways_between_rooms_stay_open() -> None:
    """Two rooms side by side with a doorway, and a hole in an outer wall."""
    other = Room("kitchen", (4.2, 0.0, 0.0), (7.0, 2.5, 5.0))
    walls = [without(box(room.low, room.high), [3.9, -0.1, 2.0], [4.3, 2.0, 3.0]) for room in (ROOM, other)]
    scan = without(np.concatenate(walls), [-0.1, 0.5, 1.0], [0.1, 1.5, 2.0])
    backing = backing_of(scan, [ROOM, other])
    through = RayCaster(backing.triangles).closest([[3.0, 1.0, 2.5]], [[1.0, 0.0, 0.0]])[0][0]
    assert through > 4.0
    closed = np.concatenate([scan, backing.triangles])
    assert escaped_share(RayCaster(closed), closed, [ROOM, other]) == 0


def test_rectangles_cover_a_mask_exactly() -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        mask = rng.random((8, 11)) < 0.6
        count = np.zeros(mask.shape, dtype=int)
        for r, e, c, d in rectangles_of(mask):
            count[r:e, c:d] += 1
        assert (count == mask).all()


# ---- reverberation ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [0.08, 0.15, 0.3])
def test_the_prediction_follows_eyring_in_a_room_of_one_material(alpha: float) -> None:
    label = spectral_label((alpha,) * 6, (0.5,) * 6)
    shell = box(ROOM.low, ROOM.high, edge=1.0)
    found = trace_room(shell, [label] * len(shell), ROOM).decay_time()
    assert found == pytest.approx(eyring(50.0, 2 * (4 * 2.5 + 4 * 5 + 2.5 * 5), alpha), rel=0.08)


def test_a_scaled_decay_is_that_of_scaled_materials() -> None:
    shell = box(ROOM.low, ROOM.high, edge=1.0)
    labels = ["parquet" if y < 0.1 else "plaster" for y in shell[..., 1].max(axis=1)]
    scaled = [scaled_label(label, 1.7) for label in labels]
    one, two = trace_room(shell, labels, ROOM).decay_time(1.7), trace_room(shell, scaled, ROOM).decay_time()
    assert one == pytest.approx(two, rel=0.01)
    assert np.allclose(material_for(scaled[0]).in_situ, material_for(labels[0]).scaled(1.7).in_situ, atol=1e-4)
    assert scaled_label("wood", 1.0) == "wood"


def test_ranges_are_those_of_the_measurements() -> None:
    assert furnished_range("living_room", 44.0) == pytest.approx((0.33, 0.51))
    assert furnished_range("kitchen", 44.0) == pytest.approx((0.33, 0.68))
    assert furnished_range("bathroom", 12.0) is None
    low, high = furnished_range("living_room", 88.0)
    assert (low, high) == pytest.approx((0.33 * 2 ** (1 / 3), 0.51 * 2 ** (1 / 3)))


def bare(t30: dict[str, float], *, usual: bool, name: str = "living_room"):
    shell = box(ROOM.low, ROOM.high, edge=0.5)
    return match_rooms(shell, ["concrete"] * len(shell), [replace(ROOM, name=name)], t30, usual=usual)


@pytest.mark.slow
def test_an_unmeasured_room_is_brought_to_the_nearer_end_of_the_range() -> None:
    labels, (decay,) = bare({}, usual=True)
    assert decay.usual is not None
    assert decay.guessed > 1.2 * decay.usual[1]
    assert decay.t30 == pytest.approx(decay.usual[1], rel=0.02)
    assert set(labels) == {scaled_label("concrete", decay.scale)}
    labels, (decay,) = bare({}, usual=False)
    assert (decay.scale, set(labels)) == (1.0, {"concrete"})
    assert bare({}, usual=True, name="bathroom")[1][0].scale == 1.0


def test_a_measured_time_is_kept_whatever_is_usual() -> None:
    _, (decay,) = bare({"living_room": 1.1}, usual=True)
    assert decay.t30 == pytest.approx(1.1, rel=0.02)
    assert decay.wanted == 1.1


def test_a_time_out_of_reach_is_an_error() -> None:
    wide = spectral_label((0.8,) * 6, (0.3,) * 6)
    shell = box(ROOM.low, ROOM.high, edge=0.5)
    with pytest.raises(
        Avs3dError, match=r"room living_room: acoustics\.t30 is 3 s, but with 0\.05 times .* is \d\.\d+ s;"
    ):
        match_rooms(shell, [wide] * len(shell), [ROOM], {"living_room": 3.0}, usual=False)


@pytest.mark.slow
def test_the_factor_is_found_for_any_time() -> None:
    shell = box(ROOM.low, ROOM.high, edge=0.5)
    history = trace_room(shell, ["plaster"] * len(shell), ROOM)
    for seconds in (0.2, 0.45, 0.9):
        assert history.decay_time(scale_for(history, seconds)) == pytest.approx(seconds, rel=0.01)


# ---- manifest -----------------------------------------------------------------------------------------------------


def test_new_fields_count_in_digests_only_where_they_are_set() -> None:
    plain = ScanSpec(source="scan", file="a.glb")
    assert not {"surfaces", "acoustics"} & set(plain.identity())
    changed = ScanSpec(source="scan", file="a.glb", surfaces={"wall": "brick"}, acoustics=ScanAcousticsSpec(t30=0.4))
    assert changed.identity()["surfaces"] == {"wall": "brick"}
    assert changed.identity()["acoustics"] == {"t30": 0.4, "furnished": True}


@pytest.mark.parametrize("t30", [0.05, 4.0, {"attic": 0.4}, {"kitchen": 9.0}])
def test_times_that_no_room_has_are_refused(t30: object) -> None:
    with pytest.raises(ValueError, match="t30"):
        ScanAcousticsSpec(t30=t30)


def test_unknown_rooms_and_surfaces_are_one_line_with_their_place(tmp_path: Path) -> None:
    def read(field: str) -> None:
        path = tmp_path / "room.yaml"
        path.write_text(
            "name: room\nversion: 1.0.0\nseed: 1\nscans:\n  mine: {source: scan, file: a.glb, rooms: {kitchen: "
            f"[[0, 0, 0], [3, 2, 3]]}}, {field}}}\nobservations:\n"
            "  - {part: part_1, scan: mine, room: kitchen, index: 1, category: microwave}\n"
        )
        make_plans(read_manifest(path))

    with pytest.raises(UsageError, match=r"scans\.mine\.acoustics\.t30\.kitchen: .* less than or equal to 3"):
        read("acoustics: {t30: {kitchen: 9}}")
    with pytest.raises(UsageError, match=r"room: scans: mine: surfaces: unknown place 'walls'"):
        read("surfaces: {walls: brick}")
    read("surfaces: {wall: brick}, acoustics: {t30: 0.4}")


def test_apartments_have_no_surfaces_to_correct() -> None:
    with pytest.raises(ValueError, match="an apartment has no surfaces: only a scan has"):
        ScanSpec(seed=1, surfaces={"wall": "brick"})


def test_unknown_places_and_materials_are_named_with_the_nearest() -> None:
    check_surfaces({"wall": "brick", "floor": "carpet"}, "here")
    with pytest.raises(UsageError, match=r"here: unknown place 'walls'; .*did you mean 'wall'"):
        check_surfaces({"walls": "brick"}, "here")
    with pytest.raises(UsageError, match=r"unknown acoustic material 'carpett'; .*did you mean 'carpet'"):
        check_surfaces({"floor": "carpett"}, "here")


# ---- a scan as a whole --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A room without a ceiling, with a heap and a table."""
    mesh, truth = furnished()
    path = tmp_path_factory.mktemp("scan") / "room.glb"
    corners = mesh.positions[(truth != "ceiling") & (truth != "shelves")].reshape(-1, 3)
    trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3)).export(path)
    return path


BOX = {"living_room": [ROOM.low, ROOM.high]}


def times(scene: Scene) -> float:
    session = TracerBackend().open(scene, (3.0, 1.2, 4.2), room="living_room")
    poses = [Pose.from_yaw(at, 0.0) for at in ((1.0, 1.5, 1.0), (3.0, 1.5, 1.0), (1.0, 1.5, 4.0))]
    session.prepare(poses)
    time = reverberation_time([session.impulse_response(pose) for pose in poses], session.sample_rate)
    session.close()
    assert time is not None
    return time


@pytest.mark.slow
@pytest.mark.parametrize("t30", [0.35, 0.6])
def test_the_tracer_gives_the_measured_time(file: Path, t30: float) -> None:
    assert times(load_scan("room", file, BOX, acoustics=ScanAcoustics(t30=t30))) == pytest.approx(t30, rel=0.1)


@pytest.mark.slow
def test_what_is_seen_does_not_change(file: Path) -> None:
    scene, report = read_scan("room", file, BOX)
    again, same = read_scan("room", file, BOX)
    plain, _ = read_scan("room", file, BOX, acoustics=ScanAcoustics(surfaces={"wall": "brick"}, t30=0.4))
    mesh = scene.parts[0].mesh
    assert report.escaped > 0.01
    assert mesh.positions[..., 1].max() < ROOM.high[1] + 0.001
    assert mesh.acoustic_positions[..., 1].max() > ROOM.high[1]
    assert mesh.positions.tobytes() == plain.parts[0].mesh.positions.tobytes()
    assert again.parts[0].mesh.acoustic_labels == mesh.acoustic_labels
    assert same == report


def test_the_table_says_what_was_guessed_and_follows_the_manifest(file: Path) -> None:
    rows = {row.place: row for row in read_scan("room", file, BOX)[1].surfaces}
    assert rows["floor"].material == "parquet"
    assert rows["floor"].area == pytest.approx(20.0, rel=0.05)
    assert rows["wall"].why
    assert sum(row.share for row in rows.values()) == pytest.approx(1.0)
    given = ScanAcoustics(surfaces={"wall": "brick", "soft": "upholstery"})
    changed = {row.place: row.material for row in read_scan("room", file, BOX, acoustics=given)[1].surfaces}
    assert (changed["wall"], changed["soft"], changed["floor"]) == ("brick", "upholstery", "parquet")


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL.name} is not beside the project: a scan for measuring only")
def test_a_real_room_rings_like_a_furnished_one() -> None:
    scene, report = read_scan("room", REAL, REAL_ROOMS)
    (decay,) = report.rooms
    low, high = furnished_range("living_room", decay.volume)
    assert low <= decay.t30 <= high
    assert report.escaped > 0.004
    corners = scene.parts[0].mesh.acoustic_positions.astype(np.float64)
    assert escaped_share(RayCaster(corners), corners, list(scene.rooms)) <= 1e-3
    areas = {row.place: row.area for row in report.surfaces}
    assert areas["soft"] > 5
    assert areas["shelves"] > 2


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL.name} is not beside the project: a scan for measuring only")
def test_exchanged_channels_are_caught_in_a_real_room() -> None:
    """Noise at a fixed place, heard from 16 places: the sides are right, and wrong by as much if exchanged."""
    session = TracerBackend().open(load_scan("room", REAL, REAL_ROOMS), (0.6, -0.6, 0.9), room="living_room")
    rng, noise = np.random.default_rng(1), np.random.default_rng(2).normal(size=layout.BINAURAL_SAMPLES)
    levels, sines, exchanged = [], [], []
    poses = [
        Pose.from_yaw((rng.uniform(-0.6, 0.4), -0.15, rng.uniform(-0.8, 0.6)), rng.uniform(-np.pi, np.pi))
        for _ in range(16)
    ]
    session.prepare(poses)
    for pose in poses:
        response = session.impulse_response(pose)
        clip = np.stack([fftconvolve(noise, channel)[: len(noise)] for channel in response])
        levels.append(side_level(clip))
        exchanged.append(side_level(clip[::-1]))
        sines.append(np.sin(np.radians(direction_to(pose, (0.6, -0.6, 0.9)).azimuth)))
    session.close()
    assert SideFit.of(levels, np.array(sines)).certainty > SURE
    assert SideFit.of(exchanged, np.array(sines)).certainty < -SURE
