"""`generators.Home`, `objects` and `Renderer` by themselves, in a bare room that is read from a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators import Home, HomeScene, Renderer, acoustics, objects
from generators.core.scene import Scene
from generators.core.seeds import random_numbers
from generators.scenes.showing import show
from generators.vision.views import room_at
from tests.support.homes import ROOM, write_room

CAMERA = Intrinsics.from_fov(64)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_room(tmp_path_factory.mktemp("scan") / "room.glb")


@pytest.fixture(scope="module")
def home(room: Path) -> Home:
    return Home.from_scan(room, rooms={"kitchen": ROOM})


@pytest.fixture(scope="module")
def scene(home: Home) -> HomeScene:
    return home.place(objects.build("microwave", seed=3), on="worktop", rng=1)


@pytest.fixture(scope="module")
def renderer(scene: HomeScene) -> Renderer:
    return Renderer(scene)


def test_the_names_of_a_home_are_public() -> None:
    import generators

    assert {"Home", "HomeScene", "Renderer", "RenderedView", "objects"} <= set(dir(generators))


def test_a_model_is_the_one_that_datasets_draw_with_the_same_numbers() -> None:
    from generators.assets.catalogue import build_model, variants

    rng = np.random.default_rng(3)
    known = variants("kettle")
    drawn = build_model("kettle", known[int(rng.integers(len(known)))], rng)
    built = objects.build("kettle", seed=3)
    assert built.name == drawn.name
    assert np.array_equal(built.mesh.positions, drawn.mesh.positions)
    assert objects.build("kettle", known[0], seed=3).name == f"kettle/{known[0]}"
    assert {objects.build("kettle", seed=seed, among=known[:1]).name for seed in range(4)} == {f"kettle/{known[0]}"}


def test_an_object_stands_where_it_is_asked_for(scene: HomeScene, home: Home) -> None:
    (placed,) = scene.placements
    top = home.site("kitchen").supports("worktop")[0].origin[1]
    assert placed.support.kind == "worktop"
    assert abs(placed.bounds[0, 1] - top) < 0.005
    assert home.placements == ()


def test_the_same_seed_gives_the_same_place_and_another_seed_another(home: Home) -> None:
    clock = objects.build("clock", "station")
    places = [
        home.place(clock, on="wall", rng=rng).placements[0].position for rng in (1, 1, np.random.default_rng(1), 2)
    ]
    assert places[0] == places[1] == places[2] != places[3]


@pytest.mark.slow
def test_objects_that_are_there_stay_and_are_not_hit(scene: HomeScene) -> None:
    both = scene.place([objects.build("kettle"), objects.build("clock", "station")], rng=2)
    assert [each.model.category for each in both.placements] == ["microwave", "kettle", "clock"]
    assert both.placements[0] is scene.placements[0]
    boxes = [each.box for each in both.placements]
    for number, one in enumerate(boxes):
        for other in boxes[:number]:
            low, high = np.maximum(one.bounds[0], other.bounds[0]), np.minimum(one.bounds[1], other.bounds[1])
            assert (high <= low + 1e-3).any()
    assert {part.instance_id for part in both.scene().parts} == {0, 1, 2, 3}


@pytest.mark.slow
def test_a_pose_looks_at_the_object_from_the_free_floor(scene: HomeScene, renderer: Renderer) -> None:
    pose = scene.look_at(1)
    assert pose == scene.look_at(1, rng=0) != scene.look_at(1, rng=1)
    x, y, z = pose.position
    assert y == pytest.approx(1.5)
    assert scene.site("kitchen").space.contains([[x, z]]).all()
    frame = renderer.frame(pose, CAMERA)
    rows, columns = np.nonzero(frame.instance_ids == 1)
    assert len(rows) > 0.02 * frame.instance_ids.size
    assert abs(columns.mean() - 32) < 8
    assert scene.look_at(1, height=1.2).position[1] == pytest.approx(1.2)


def test_depth_and_ids_are_those_of_the_object(scene: HomeScene, renderer: Renderer) -> None:
    pose = scene.look_at(1)
    frame = renderer.frame(pose, CAMERA)
    assert frame.rgb.shape == (64, 64, 3)
    assert [frame.depth.dtype.name, frame.instance_ids.dtype.name] == ["float32", "uint16"]
    rows, columns = np.nonzero(frame.instance_ids == 1)
    pixels = np.stack([columns, rows], axis=1) + 0.5
    points = CAMERA.unproject(pose, pixels, frame.depth[rows, columns])
    low, high = scene.placements[0].bounds
    assert ((points > low - 0.01) & (points < high + 0.01)).all()


def test_a_walk_is_that_of_datasets(scene: HomeScene) -> None:
    from generators.paths.trajectory import WalkTask, plan_walk

    task = WalkTask(scene.site("kitchen"), scene.placements, frames=9)
    assert scene.walk(9, rng=4) == list(plan_walk(task, np.random.default_rng(4)).poses)


def test_a_frame_follows_the_camera_and_several_at_once_are_the_same(scene: HomeScene, renderer: Renderer) -> None:
    poses = dict(enumerate(scene.walk(5, rng=4)))
    one_by_one = [renderer.frame(pose, CAMERA).rgb for pose in poses.values()]
    assert renderer.frame(poses[0], Intrinsics.from_fov(32)).rgb.shape == (32, 32, 3)
    together = [view.rgb for view in renderer.frames(poses, CAMERA, cores=lambda: 3)]
    assert np.array_equal(one_by_one, together)


def test_the_ears_hear_the_source_on_its_side(scene: HomeScene) -> None:
    placed = scene.placement(1)
    x, _, z = np.asarray(placed.source_position) + 1.2 * placed.front
    click = np.zeros(4410, dtype=np.float32)
    click[0] = 1.0
    for turn, louder in ((90, 1), (-90, 0)):
        # The object is ahead of whoever looks against its front; turned to the left, it is on the right.
        pose = Pose.from_yaw((x, 1.5, z), placed.yaw + math.radians(turn))
        sound = scene.hear(pose, signal=click, audio="analytic")
        energy = (sound.samples.astype(np.float64) ** 2).sum(axis=1)
        assert sound.samples.shape == (2, 4410)
        assert energy[louder] > 2 * energy[1 - louder]


def test_the_sound_is_the_clip_of_a_dataset(scene: HomeScene, tmp_path: Path) -> None:
    import soundfile

    from generators.acoustics.clips import receiver_clip
    from generators.assets.sounds import synthesise

    sound = scene.hear(scene.look_at(1), seconds=2, audio="analytic", rng=5)
    signal = synthesise("microwave", 2, np.random.default_rng(5))
    assert sound.samples.shape == (2, 88200)
    for second in (0, 1):
        expected = receiver_clip(signal, sound.response, second)
        assert np.allclose(sound.samples[:, second * 44100 :][:, :44100], expected, atol=1e-7)
    read, rate = soundfile.read(sound.save(tmp_path / "sound.wav"), dtype="float32")
    assert rate == 44100
    assert np.array_equal(read.T, sound.samples)
    assert sound._repr_html_().startswith('<audio controls src="data:audio/flac;base64,')


def test_the_acoustic_mesh_is_what_engines_take(scene: HomeScene) -> None:
    with_all, without = scene.acoustic_mesh(), scene.acoustic_mesh(sounding=1)
    body = len(scene.placements[0].mesh.acoustic_positions)
    assert with_all.triangles.shape == (len(with_all.labels), 3, 3)
    assert 0 < len(with_all.labels) - len(without.labels) <= body


def test_engines_hear_the_home_as_a_room(scene: HomeScene) -> None:
    """The room has the triangles that engines take, and the first sound comes straight from the object."""
    room = scene.acoustics(sounding=1)
    mesh = scene.acoustic_mesh(sounding=1)
    assert np.array_equal(room.triangles, mesh.triangles)
    assert room.labels == mesh.labels
    source, listener = np.array(scene.placements[0].source_position), scene.look_at(1)
    response = acoustics.Tracer().response(room, source, listener, acoustics.Omni())
    first = int(np.argmax(np.abs(response.samples[0]) > 0.1 * np.abs(response.samples).max())) / response.sample_rate
    assert first == pytest.approx(np.linalg.norm(source - listener.position) / 343.0, abs=5e-4)


def test_a_room_is_found_in_a_scan_without_boxes(room: Path) -> None:
    found = Home.from_scan(room).rooms
    assert [each.name for each in found] == ["living_room"]
    assert np.allclose([found[0].low, found[0].high], ROOM, atol=0.15)


@pytest.mark.slow
def test_an_exported_home_is_read_again_as_a_scan(scene: HomeScene, tmp_path: Path) -> None:
    file = scene.export(tmp_path / "home.glb")
    assert scene.export(tmp_path / "coarse.glb", texel=0.05).stat().st_size < file.stat().st_size / 2
    again = Home.from_scan(file, rooms={"kitchen": ROOM})
    pose = scene.look_at(1)
    one, other = (Renderer(each).frame(pose, CAMERA) for each in (scene, again))
    assert np.abs(one.depth - other.depth).max() < 0.02
    assert np.median(np.abs(one.rgb.astype(int) - other.rgb)) < 6


def test_exposure_is_that_of_the_room_that_the_camera_is_in(home: Home) -> None:
    from dataclasses import replace

    kitchen = home.room("kitchen")
    hall = replace(kitchen, name="hall", low=(4.2, 0.0, 0.0), high=(6.0, 2.6, 3.6))
    two = replace(home.scene(), rooms=(kitchen, hall))
    assert [room_at(two, Pose.from_yaw((x, 1.5, 1.0), 0.0)) for x in (1.0, 5.0, 9.0)] == ["kitchen", "hall", "hall"]


def test_a_picture_is_shown_as_a_file_outside_of_notebooks(
    scene: HomeScene, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import cv2

    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    show(scene.picture(48), "a room/7")
    path = Path(capsys.readouterr().out.strip())
    assert opened == [path.as_uri()]
    assert path.name == "a_room_7.png"
    written = cv2.imread(str(path))
    assert written is not None
    assert np.array_equal(written[..., ::-1], scene.picture(48).rgb)


def test_a_home_without_objects_shows_its_room(home: Home) -> None:
    frame = home.picture(32)
    assert (frame.instance_ids == 0).all()
    assert np.median(frame.depth) > 1.0
    assert "kitchen; no objects placed" in repr(home)
    assert repr(frame).startswith("<RenderedView 32×32, depth up to ")
    assert frame._repr_jpeg_()[:2] == b"\xff\xd8"


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda h, s, r: objects.build("microwve"), "unknown category 'microwve'.*did you mean 'microwave'"),
        (lambda h, s, r: objects.build("microwave", "blak"), "unknown variant 'blak'.*did you mean 'black'"),
        (lambda h, s, r: objects.build("microwave", seed=-1), "seed: found -1; expected a whole number"),
        (lambda h, s, r: objects.load("no.glb", "kettle"), "no.glb: no such file"),
        (lambda h, s, r: h.place("microwave"), "place: found 'microwave'; expected an object"),
        (lambda h, s, r: h.place(objects.build("kettle"), room="kitchn"), "no room 'kitchn'.*did you mean 'kitchen'"),
        (lambda h, s, r: h.place(objects.build("kettle"), on="workstop"), "'workstop'.*did you mean 'worktop'"),
        (lambda h, s, r: h.place(objects.build("toilet"), on="shelf"), "no place for toilet"),
        (lambda h, s, r: h.place(objects.build("kettle"), rng="x"), "rng: found 'x'; expected a whole number"),
        (lambda h, s, r: s.look_at(2), r"no instance 2; placed objects: 1 \(microwave\)"),
        (lambda h, s, r: h.look_at(1), "no instance 1; placed objects: none"),
        (lambda h, s, r: h.walk(5), "0 objects"),
        (lambda h, s, r: s.hear((0, 0, 0)), "listener .0, 0, 0.; expected avs3d_bench.geometry.Pose"),
        (lambda h, s, r: s.hear(s.look_at(1), signal=np.zeros((2, 9))), r"shape \(2, 9\); expected mono"),
        (lambda h, s, r: r.frame(s.look_at(1), Intrinsics.from_fov(0)), "camera: 0×0 pixels"),
        (lambda h, s, r: r.frame(s.look_at(1), 512), "intrinsics 512; expected .*from_fov"),
        (lambda h, s, r: r.frame((0, 0, 0)), "pose .0, 0, 0.; expected .*look_at"),
        (lambda h, s, r: Renderer(s, vision="embre"), "'embre'.*did you mean 'embree'"),
        (lambda h, s, r: s.export("home.gltf"), "ends in .glb"),
        (lambda h, s, r: Home.apartment(-1), "seed -1; expected a whole number"),
        (lambda h, s, r: Home.apartment(1, light="preveiw"), "'preveiw'.*did you mean 'preview'"),
        (lambda h, s, r: Home.apartment(1, device="gpu"), "device 'gpu'; expected one of cpu, cuda"),
        (lambda h, s, r: Home.from_scan(__file__, rooms=cast(Any, ["hall"])), "rooms .'hall'.; expected boxes by name"),
        (lambda h, s, r: Home.from_scan("no.glb"), "no.glb: does not exist; expected a mesh"),
        (lambda h, s, r: Home.from_scan(__file__), r"test_home_by_itself.py: "),
    ],
)  # fmt: skip
def test_bad_input_is_told_in_one_line(
    home: Home, scene: HomeScene, renderer: Renderer, wrong: Callable[[Home, HomeScene, Renderer], object], says: str
) -> None:
    with pytest.raises(Avs3dError, match=says) as caught:
        wrong(home, scene, renderer)
    assert "\n" not in str(caught.value)


def test_a_flat_is_the_one_that_a_manifest_caches(home: Home, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from generators.homes.store import open_home
    from generators.options import GenerateOptions
    from generators.plan import make_plans, read_manifest
    from tests.support.homes import write_manifest

    asked: list[tuple[object, ...]] = []

    def cached(folder: Path, key: str, build: object, device: str) -> Scene:
        asked.append((folder, key, device))
        return home.scene()

    monkeypatch.setattr("generators.homes.store.cached_scene", cached)
    manifest = write_manifest(tmp_path, scans={"home_7": {"seed": 7}}, light="preview")
    manifest.write_text(manifest.read_text().replace("scan: box", "scan: home_7"))
    plan = make_plans(read_manifest(manifest), GenerateOptions(audio="analytic"))[0]
    open_home(plan, tmp_path)
    Home.apartment(7, light="preview", cache=tmp_path)
    Home.apartment(7, light="high", cache=tmp_path)
    assert asked[0] == asked[1] != asked[2]


def test_a_scan_whose_folder_has_moved_is_not_read_again_and_a_changed_one_is(tmp_path: Path) -> None:
    from generators.homes.store import open_home
    from generators.options import GenerateOptions
    from generators.plan import make_plans, read_manifest
    from tests.support.homes import write_manifest

    def opened(folder: Path, *, changed: bool = False) -> Scene:
        manifest = write_manifest(folder)
        if changed:
            data = (folder / "room.glb").read_bytes()
            (folder / "room.glb").write_bytes(data.replace(b"mikedh", b"nobody", 1))
        plan = make_plans(read_manifest(manifest), GenerateOptions(audio="analytic"))[0]
        return open_home(plan, tmp_path)

    first, moved, changed = opened(tmp_path / "a"), opened(tmp_path / "b"), opened(tmp_path / "c", changed=True)
    assert [scene.stage and scene.stage.path.parent.name for scene in (first, moved, changed)] == ["a", "b", "c"]
    assert moved.parts is first.parts
    assert changed.parts is not first.parts


def test_a_home_with_several_rooms_asks_for_one(home: Home) -> None:
    from dataclasses import replace

    kitchen = home.room("kitchen")
    two = HomeScene(replace(home.scene(), rooms=(kitchen, replace(kitchen, name="bathroom"))))
    with pytest.raises(Avs3dError, match="name the room, room=…: kitchen, bathroom"):
        two.place(objects.build("kettle"))


def test_a_generator_goes_on_and_a_seed_starts_again() -> None:
    rng = np.random.default_rng(1)
    assert random_numbers(rng) is rng
    assert random_numbers(1).integers(100) == np.random.default_rng(1).integers(100)


def test_the_notebook_is_committed_with_its_outputs() -> None:
    file = Path(__file__).parents[2] / "examples/hello_home.ipynb"
    cells = [cell for cell in json.loads(file.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    outputs = [output["data"] for cell in cells for output in cell["outputs"] if "data" in output]
    assert any("image/jpeg" in data for data in outputs)
    assert any("<audio" in "".join(data.get("text/html", "")) for data in outputs)
    assert file.stat().st_size < 600_000
