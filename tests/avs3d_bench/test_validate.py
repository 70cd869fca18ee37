"""`validate`: a valid tree passes; every kind of damage is named by its file. Each case breaks one thing."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from avs3d_bench.commands.report import SHOWN, Problem, Report, print_report
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import ColmapImage, ColmapModel, read_model, write_model
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.measures.silhouette import silhouette
from avs3d_bench.validate import check_observation, validate
from tests.support import tiny
from tests.support.shared import SharedDataset

KEY = tiny.SINGLE
Change = Callable[[Path], None]


@pytest.fixture(scope="module")
def pristine(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(extras=True)


@pytest.fixture(scope="module")
def pristine_release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write_release(tmp_path_factory.mktemp("tiny") / "data", style="files")


def errors(report: Report) -> list[tuple[str, str]]:
    return [(p.path, p.message) for p in report.problems if p.severity == "error"]


@pytest.mark.parametrize("deep", [False, True])
def test_a_valid_tree_has_no_problem(pristine: Path, deep: bool):
    report = validate(pristine, deep=deep)
    assert report.problems == ()
    assert report.valid
    assert report.observations == 2
    assert report.files == 1 + 2 * (8 * tiny.FRAMES + 6)


@pytest.mark.parametrize("deep", [False, True])
def test_the_release_is_not_asked_for_what_is_ours(pristine_release: Path, deep: bool):
    report = validate(pristine_release, deep=deep)
    assert {p.severity for p in report.problems} == {"note"}
    assert report.valid


# --- ways to break a tree ---------------------------------------------------------------------------------------


def remove(path: str) -> Change:
    return lambda root: (root / path).unlink()


def put(path: str, data: bytes) -> Change:
    return lambda root: tiny.replace(root / path, data)


def cut(path: str) -> Change:
    return lambda root: tiny.replace(root / path, (root / path).read_bytes()[:-20])


def picture(path: str, pixels: Any, writer: Callable[[Path, Any], None]) -> Change:
    return lambda root: writer(root / path, pixels)


def record(change: Callable[[dict[str, Any]], None], *, rehash: bool = True) -> Change:
    return lambda root: tiny.edit_record(root, KEY, change, rehash=rehash)


def then_rehash(change: Change) -> Change:
    """The damage of someone who has the hashes computed again: only the contents can give it away."""

    def both(root: Path) -> None:
        change(root)
        tiny.edit_record(root, KEY, lambda data: None)

    return both


def wav(path: str, samples: Any, rate: int = 44100) -> Change:
    def change(root: Path) -> None:
        stream = io.BytesIO()
        soundfile.write(stream, np.asarray(samples).T, rate, format="WAV", subtype="FLOAT")
        tiny.replace(root / path, stream.getvalue())

    return change


def each_clip(change: Callable[[np.ndarray], Any]) -> Change:
    """Change every binaural clip; levels and hashes follow, the mono clips (their mix) stay."""

    def apply(root: Path) -> None:
        levels = []
        for index in range(tiny.FRAMES):
            path = root / KEY / f"audio_clips_binaural/frame_{index}.wav"
            samples = change(media.read_wav(path).samples)
            media.write_wav(path, samples)
            levels.append(np.sqrt(np.mean(np.asarray(samples, dtype=float) ** 2, axis=1)))

        def follow(data: dict[str, Any]) -> None:
            for frame, (left, right) in zip(data["frames"], levels, strict=True):
                frame.update(rms_left=left, rms_right=right)

        tiny.edit_record(root, KEY, follow)

    return apply


def mono_of_frame(index: int, change: Callable[[Path], Any]) -> Change:
    def apply(root: Path) -> None:
        media.write_wav(root / KEY / f"audio_clips_mono/frame_{index}.wav", change(root / KEY))

    return then_rehash(apply)


def mix(folder: Path, index: int) -> Any:
    return media.read_wav(folder / f"audio_clips_binaural/frame_{index}.wav").samples.mean(axis=0)


def shift_mask(root: Path) -> None:
    """Both masks of a frame moved by 20 pixels: they agree with each other and with visible_pixels."""
    for folder, read, write in (
        ("semantic_masks", media.read_png_mask, media.write_png_mask),
        ("instance_masks", media.read_png_ids, media.write_png_ids),
    ):
        path = root / KEY / folder / "frame_003.png"
        write(path, np.roll(read(path), 20, axis=0))
    tiny.edit_record(root, KEY, lambda data: None)


def model(change: Callable[[ColmapModel], ColmapModel]) -> Change:
    def apply(root: Path) -> None:
        folder = root / KEY / "sparse/0"
        write_model(folder, change(read_model(folder)))
        tiny.edit_record(root, KEY, lambda data: None)

    return apply


def mirrored(image: ColmapImage) -> ColmapImage:
    """The pose as it would be written without turning the world: Y up."""
    x, y, z = image.pose.position
    return ColmapImage(image.id, image.name, 1, Pose((x, -y, -z), image.pose.rotation), image.pixels, image.point_ids)


def without_last(m: ColmapModel) -> ColmapModel:
    return ColmapModel(m.cameras, m.images[:-1], m.points)


def swap_splits(data: dict[str, Any]) -> dict[str, Any]:
    return {"train": data["test"], "test": data["train"]}


def splits(change: Callable[[dict[str, Any]], Any]) -> Change:
    def apply(root: Path) -> None:
        path = root / KEY / "camera_splits.json"
        media.write_json(path, change(media.read_json(path)))
        tiny.edit_record(root, KEY, lambda data: None)

    return apply


def dataset(change: Callable[[dict[str, Any]], None]) -> Change:
    def apply(root: Path) -> None:
        data = media.read_json(root / "dataset.json")
        change(data)
        tiny.replace(root / "dataset.json", json.dumps(data).encode())

    return apply


SIZE = (tiny.SIZE, tiny.SIZE)
NOISE = 0.1 * np.random.default_rng(5).normal(size=(2, 44100))
MASK3, IDS3 = f"{KEY}/semantic_masks/frame_003.png", f"{KEY}/instance_masks/frame_003.png"
CLIP3, MONO3 = f"{KEY}/audio_clips_binaural/frame_3.wav", f"{KEY}/audio_clips_mono/frame_3.wav"
INPUT3, IMAGE3 = f"{KEY}/input/frame_003.png", f"{KEY}/images/frame_003.png"
JSON, SPLIT = f"{KEY}/observation.json", f"{KEY}/camera_splits.json"

#: name → (change, file that must be named, words of the message). Found without decoding anything.
SHALLOW: dict[str, tuple[Change, str, str]] = {
    "picture missing": (remove(INPUT3), INPUT3, "missing"),
    "clip missing": (remove(CLIP3), CLIP3, "missing file"),
    "mesh missing": (remove(f"{KEY}/gt_3d/sounding_object.ply"), f"{KEY}/gt_3d/sounding_object.ply", "missing"),
    "model missing": (remove(f"{KEY}/sparse/0/images.bin"), f"{KEY}/sparse/0/images.bin", "missing"),
    "splits missing": (remove(SPLIT), SPLIT, "missing"),
    "observation.json missing": (remove(JSON), JSON, "missing"),
    "dataset.json missing": (remove("dataset.json"), "dataset.json", "missing"),
    "surplus picture": (put(f"{KEY}/input/frame_010.png", b"x"), f"{KEY}/input/frame_010.png", "surplus"),
    "padded audio name": (put(f"{KEY}/audio_clips_mono/frame_003.wav", b"x"), f"{KEY}/audio_clips_mono/frame_003.wav",
                          "surplus"),
    "surplus folder": (put(f"{KEY}/notes/a.txt", b"x"), f"{KEY}/notes/a.txt", "surplus"),
    "temporary file": (put(f"{KEY}/input/.frame_003.png.1-2.tmp", b"x"), f"{KEY}/input/.frame_003.png.1-2.tmp",
                       "interrupted"),
    "half an observation": (put("part_1/tiny/kitchen/.2.partial/x", b""), "part_1/tiny/kitchen/.2.partial",
                            "interrupted"),
    "unknown room": (put("part_1/tiny/garage/1/x", b""), "part_1/tiny/garage", "unknown room 'garage'"),
    "index 0": (put("part_1/tiny/kitchen/0/x", b""), "part_1/tiny/kitchen/0", "no observation key"),
    "stray file": (put("part_1/tiny/notes.txt", b""), "part_1/tiny/notes.txt", "surplus"),
    "wrong size": (picture(MASK3, np.zeros((32, 32)), media.write_png_mask), MASK3, "32×32 pixels, expected 64×64"),
    "mask in 16 bits": (picture(MASK3, np.full(SIZE, 300), media.write_png_ids), MASK3, "grey, 16 bit, expected grey"),
    "grey picture": (picture(INPUT3, np.zeros(SIZE), media.write_png_mask), INPUT3, "grey, 8 bit, expected RGB"),
    "truncated clip": (cut(CLIP3), CLIP3, "truncated"),
    "no picture": (put(INPUT3, b"hello"), INPUT3, "not a PNG"),
    "short clip": (wav(CLIP3, NOISE[:, :-1]), CLIP3, "44099 samples, expected 44100"),
    "mono clip of 1 s": (wav(MONO3, NOISE[:1]), MONO3, "44100 samples, expected 88200"),
    "wrong rate": (wav(CLIP3, NOISE, 48000), CLIP3, "48000 Hz, expected 44100 Hz"),
    "one channel": (wav(CLIP3, NOISE[:1]), CLIP3, "1 channel(s), expected 2"),
    "images differ": (picture(IMAGE3, np.zeros((*SIZE, 3), np.uint8), media.write_png_rgb), IMAGE3, "differs from"),
    "splits swapped": (splits(swap_splits), SPLIT, "every 8th sorted name"),
    "splits overlap": (splits(lambda d: {**d, "test": [*d["test"], "frame_001"]}), SPLIT, "listed twice"),
    "a frame in no split": (splits(lambda d: {**d, "train": d["train"][1:]}), SPLIT, "frame_001"),
    "splits with extensions": (splits(lambda d: {k: [f"{n}.png" for n in v] for k, v in d.items()}), SPLIT,
                               "frame_001.png"),
    "splits unsorted": (splits(lambda d: {**d, "train": d["train"][::-1]}), SPLIT, "not sorted"),
    "no JSON": (put(JSON, b"{"), JSON, "Invalid JSON"),
    "unknown field": (record(lambda d: d.update(colour="red")), JSON, "colour"),
    "wrong key": (record(lambda d: d.update(index=2, key="part_1/tiny/kitchen/2")), JSON, "folder is"),
    "quaternion": (record(lambda d: d["frames"][2].update(rotation=[2, 0, 0, 0])), JSON, "frames.2.rotation"),
    "azimuth mirrored": (record(lambda d: d["frames"][0].update(azimuth=-45)), JSON, "frames[0].azimuth"),
    "distance": (record(lambda d: d["frames"][0].update(distance=1)), JSON, "frames[0].distance"),
    "source elsewhere": (record(lambda d: d.update(source_position=[0, 0, 0])), JSON, "outside the bounds"),
    "file without hash": (record(lambda d: d["files"].pop("camera_splits.json"), rehash=False), SPLIT, "no sha256"),
    "record edited": (record(lambda d: d.update(seed=2), rehash=False), JSON, "sha256 differs from the digest"),
    "entry missing": (dataset(lambda d: d["observations"].pop()), tiny.MULTI, "not listed"),
    "entry too many": (dataset(lambda d: d["observations"].insert(1, {**d["observations"][0],
                       "key": "part_1/tiny/kitchen/2"})), "part_1/tiny/kitchen/2", "listed in dataset.json, but"),
    "category of an entry": (dataset(lambda d: d["observations"][0].update(category="clock")), "dataset.json", "clock"),
    "manifest edited": (dataset(lambda d: d.update(manifest="x")), "dataset.json", "manifest_sha256"),
}  # fmt: skip

#: The same for what only contents give away.
DEEP: dict[str, tuple[Change, str, str]] = {
    "a bit flipped": (lambda root: tiny.replace(root / INPUT3, (root / INPUT3).read_bytes()[:-30] + b"x" * 30), INPUT3,
                      "sha256"),
    "truncated picture": (then_rehash(cut(INPUT3)), INPUT3, "truncated"),
    "grey level in a mask": (then_rehash(picture(MASK3, np.full(SIZE, 7), media.write_png_ids)), MASK3, "found 7"),
    "mask and ids differ": (then_rehash(picture(MASK3, np.ones(SIZE), media.write_png_mask)), MASK3, "from id 1"),
    "mask and area differ": (record(lambda d: d["frames"][3].update(visible_pixels=5)), MASK3, "visible_pixels"),
    "unknown id": (then_rehash(picture(IDS3, np.full(SIZE, 9), media.write_png_ids)), IDS3, "ids [9]"),
    "mask beside the object": (shift_mask, MASK3, "outside the projected sounding object"),
    "depth beside the object": (then_rehash(picture(f"{KEY}/depth/frame_003.png", np.full(SIZE, 9.0),
                                media.write_png_depth_mm)), f"{KEY}/depth/frame_003.png", "nearer or farther"),
    "clip swapped for noise": (then_rehash(wav(CLIP3, NOISE)), CLIP3, "rms_left"),
    "silent clip": (then_rehash(wav(CLIP3, NOISE * 0)), CLIP3, "silent"),
    "silent ear": (then_rehash(wav(CLIP3, NOISE * [[1], [0]])), CLIP3, "silent in channel 1"),
    "clipped": (then_rehash(wav(CLIP3, NOISE * 20)), CLIP3, "clipped"),
    "NaN in a clip": (then_rehash(wav(CLIP3, NOISE * np.where(np.arange(44100) == 3, np.nan, 1))), CLIP3, "NaN"),
    "channels swapped": (each_clip(lambda s: s[::-1]), f"{KEY}/audio_clips_binaural", "channels swapped?"),
    "level difference gone": (each_clip(lambda s: s.mean(axis=0) * [[1.01], [1]]), f"{KEY}/audio_clips_binaural",
                              "both ears hear the same"),
    "mono of another frame": (mono_of_frame(3, lambda f: np.concatenate([mix(f, 5), mix(f, 6)])), MONO3,
                              "does not hold the mix of audio_clips_binaural/frame_3.wav"),
    "mono leaks the test frame": (mono_of_frame(7, lambda f: np.concatenate([mix(f, 6)[22050:], mix(f, 7),
                                  mix(f, 8)[:22050]])), f"{KEY}/audio_clips_mono/frame_7.wav", "frame_008"),
    "mesh elsewhere": (then_rehash(lambda root: media.write_ply_mesh(root / KEY / "gt_3d/sounding_object.ply",
                       np.eye(3), [[0, 1, 2]])), f"{KEY}/gt_3d/sounding_object.ply", "bounds differ"),
    "no mesh": (then_rehash(put(f"{KEY}/gt_3d/sounding_object.ply", b"solid")), f"{KEY}/gt_3d/sounding_object.ply",
                "not a PLY"),
    "impulse response": (then_rehash(put(f"{KEY}/rirs/frame_3.npz", b"x")), f"{KEY}/rirs/frame_3.npz", "rir"),
    "model with Y up": (model(lambda m: ColmapModel(m.cameras, tuple(map(mirrored, m.images)), m.points)),
                        f"{KEY}/sparse/0/images.bin", "10 poses differ"),
    "model of another camera": (model(lambda m: ColmapModel({1: Intrinsics.from_fov(65)}, m.images, m.points)),
                                f"{KEY}/sparse/0/cameras.bin", "intrinsics"),
    "a frame not registered": (model(without_last), f"{KEY}/sparse/0/images.bin", "frame_009.png"),
    "truncated model": (then_rehash(cut(f"{KEY}/sparse/0/points3D.bin")), f"{KEY}/sparse/0/points3D.bin", "truncated"),
}  # fmt: skip


def check(root: Path, named: str, words: str, *, deep: bool) -> None:
    report = validate(root, deep=deep)
    found = errors(report)
    assert any(path == named and words in message for path, message in found), found
    assert not report.valid
    assert all("\n" not in message and str(root) not in message for _, message in found)


@pytest.mark.parametrize("name", SHALLOW)
def test_shallow_damage_is_named(pristine: Path, tmp_path: Path, name: str):
    change, named, words = SHALLOW[name]
    root = tiny.clone(pristine, tmp_path / "data")
    change(root)
    check(root, named, words, deep=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", DEEP)
def test_deep_damage_is_named(pristine: Path, tmp_path: Path, name: str):
    change, named, words = DEEP[name]
    root = tiny.clone(pristine, tmp_path / "data")
    change(root)
    check(root, named, words, deep=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["no JSON", "no picture", "truncated clip", "splits swapped", "observation.json missing", "splits overlap"]
)
def test_deep_goes_on_after_shallow_damage(pristine: Path, tmp_path: Path, name: str):
    change, named, words = SHALLOW[name]
    root = tiny.clone(pristine, tmp_path / "data")
    change(root)
    check(root, named, words, deep=True)


def test_one_fault_is_one_problem(pristine: Path, tmp_path: Path):
    root = tiny.clone(pristine, tmp_path / "data")
    SHALLOW["short clip"][0](root)
    assert [path for path, _ in errors(validate(root))] == [CLIP3]


def test_a_missing_folder_is_one_problem_and_its_frames_are_not_listed(pristine_release: Path, tmp_path: Path):
    root = tiny.clone(pristine_release, tmp_path / "data")
    for path in (root / KEY / "semantic_masks").iterdir():
        path.unlink()
    assert errors(validate(root)) == [(f"{KEY}/semantic_masks", "missing folder; expected 10 files in it")]


def test_several_faults_are_all_named(pristine: Path, tmp_path: Path):
    root = tiny.clone(pristine, tmp_path / "data")
    for name in ("picture missing", "wrong rate", "unknown room"):
        SHALLOW[name][0](root)
    paths = {path for path, _ in errors(validate(root))}
    assert {INPUT3, CLIP3, "part_1/tiny/garage"} <= paths


@pytest.mark.slow
def test_workers_find_the_same(pristine: Path, tmp_path: Path):
    root = tiny.clone(pristine, tmp_path / "data")
    DEEP["clipped"][0](root)
    assert validate(root, deep=True, workers=2).problems == validate(root, deep=True, workers=1).problems


def test_a_single_observation_can_be_checked(pristine: Path):
    assert check_observation(pristine, tiny.MULTI, deep=True) == ()


def test_the_release_with_damage_is_not_valid(pristine_release: Path, tmp_path: Path):
    root = tiny.clone(pristine_release, tmp_path / "data")
    wav(CLIP3, NOISE[:1])(root)
    picture(MASK3, np.full(SIZE, 7), media.write_png_ids)(root)
    found = dict(errors(validate(root, deep=True)))
    assert "1 channel(s)" in found[CLIP3]
    assert "found 7" in found[MASK3]


@pytest.mark.parametrize("name", ["name", "version", "licence", "toolkit_version"])
def test_one_bit_of_the_free_text_of_the_dataset_is_noticed(pristine: Path, tmp_path: Path, name: str):
    root = tiny.clone(pristine, tmp_path / "data")
    data = media.read_json(root / "dataset.json")
    data[name] = chr(ord(data[name][0]) ^ 1) + data[name][1:]
    tiny.replace(root / "dataset.json", json.dumps(data).encode())
    assert ("dataset.json", "digest is not that of the other fields: the file was changed after it was written") in (
        errors(validate(root))
    )


def test_a_tree_of_an_older_version_has_no_digest(pristine: Path, tmp_path: Path):
    root = tiny.clone(pristine, tmp_path / "data")
    dataset(lambda data: data.pop("digest"))(root)
    report = validate(root)
    assert report.valid
    assert [(p.severity, p.path) for p in report.problems] == [("note", "dataset.json")]


def test_the_digest_does_not_depend_on_the_layout_of_the_text(pristine: Path, tmp_path: Path):
    root = tiny.clone(pristine, tmp_path / "data")
    data = media.read_json(root / "dataset.json")
    tiny.replace(root / "dataset.json", json.dumps(dict(reversed(data.items())), indent=7).encode())
    assert validate(root).problems == ()


def test_recorded_sizes_are_compared_without_reading(pristine: Path, tmp_path: Path):
    root = tiny.clone(pristine, tmp_path / "data")
    tiny.edit_record(root, KEY, lambda data: data.update(sizes={}))
    assert validate(root).problems == ()
    place = root / KEY / "gt_3d/sounding_object.ply"
    tiny.replace(place, place.read_bytes() + b"x")
    found = errors(validate(root))
    assert len(found) == 1
    assert found[0][0] == f"{KEY}/gt_3d/sounding_object.ply"
    assert "bytes, expected" in found[0][1]


@pytest.mark.parametrize(
    "text",
    ["[" * 20000, "a: &x [1]\nb: [*x, *x]", "- {", "\x00", "{? {a: b} : c}", "a: {<<: {b: 1}}", "1", ""],
    ids=["deep", "aliases", "broken", "control", "odd key", "merge", "scalar", "empty"],
)
def test_any_text_may_stand_as_manifest(pristine: Path, tmp_path: Path, text: str):
    """It is looked into, never built: whatever it holds, the check ends with a report."""
    root = tiny.clone(pristine, tmp_path / "data")
    digest = hashlib.sha256(text.encode()).hexdigest()
    dataset(lambda data: data.update(manifest=text, manifest_sha256=digest))(root)
    assert [path for path, _ in errors(validate(root))] == ["dataset.json"]  # its digest


def test_the_silhouette_of_a_box_is_its_outline():
    """A 1 m square face 2 m ahead spans 252 px of the benchmark camera; the box behind it projects inside."""
    box = tiny.Box(1, "clock", True, (-0.5, -0.5, -3.0), (0.5, 0.5, -2.0))
    vertices, faces = box.mesh()
    args = (Pose((0, 0, 0), (1, 0, 0, 0)), vertices.astype(np.float32), faces.astype(np.int32))
    covered = silhouette(Intrinsics.from_fov(1008), *args)
    rows, columns = np.nonzero(covered)
    assert (rows.min(), rows.max()) == pytest.approx((504 - 126, 504 + 125), abs=1)
    assert (columns.min(), columns.max()) == pytest.approx((504 - 126, 504 + 125), abs=1)
    wider = silhouette(Intrinsics.from_fov(1008), *args, margin=2)
    assert np.nonzero(wider)[0].min() == rows.min() - 2


def test_the_silhouette_reaches_round_the_camera():
    """Standing between two ends of a long box: the faces that pass behind the camera must not vanish or flip."""
    floor = tiny.Box(1, "clock", True, (-5.0, -1.0, -5.0), (5.0, -0.5, 5.0))
    vertices, faces = floor.mesh()
    covered = silhouette(
        Intrinsics.from_fov(64), Pose((0, 0, 0), (1, 0, 0, 0)), vertices.astype(np.float32), faces.astype(np.int32)
    )
    assert covered[37:].all()  # the edge, 0.5 m below and 5 m ahead, is 3.2 px below the middle
    assert not covered[:34].any()


def test_the_report_is_grouped_by_observation_and_ends_with_a_count(tmp_path: Path):
    problems = (
        Problem("warning", "notes", "not part of a dataset"),
        Problem("error", CLIP3, "silent [RMS]"),
        Problem("note", KEY, "official"),
    )
    report = Report(tmp_path, True, 1, 7, problems)
    stream = io.StringIO()
    print_report(report, Console(file=stream, width=60))
    lines = stream.getvalue().splitlines()
    assert lines[-1] == f"{tmp_path}: 1 error, 1 warning, 1 note in 1 observation (7 files, deep): not valid"
    at = lines.index(KEY)
    assert lines[at + 1] == "  error   audio_clips_binaural/frame_3.wav: silent [RMS]"
    assert lines[at + 2] == "  note    .: official"
    assert "  warning notes: not part of a dataset" in lines


def test_a_long_report_is_cut_with_a_count(tmp_path: Path):
    problems = tuple(Problem("note", f"{KEY}/{i}", "x") for i in range(SHOWN)) + (Problem("error", "z", "grave"),) * 1
    stream = io.StringIO()
    print_report(Report(tmp_path, False, 1, 1, problems), Console(file=stream, width=60))
    text = stream.getvalue()
    assert "… and 1 more note" in text
    assert "grave" in text  # errors are never what is cut first


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", ["ours", "release"])
@settings(max_examples=80, derandomize=True)
@given(drawn=st.data())
def test_no_damage_makes_it_stumble(tmp_path_factory: pytest.TempPathFactory, kind: str, drawn: st.DataObject):
    """Any file deleted, cut, flipped or replaced: a report comes back, and in a tree of ours it is not valid."""
    source = _small(tmp_path_factory, kind)
    root = tiny.clone(source, tmp_path_factory.mktemp("fuzz") / "data")
    path = root / drawn.draw(st.sampled_from(sorted(p.relative_to(root).as_posix() for p in root.rglob("*.*[a-z]"))))
    whole = path.read_bytes()
    damage = drawn.draw(st.sampled_from(["delete", "cut", "flip", "replace"]))
    if damage == "delete":
        path.unlink()
    elif damage == "cut":
        tiny.replace(path, whole[: drawn.draw(st.integers(0, len(whole) - 1))])
    elif damage == "flip":
        at, bits = drawn.draw(st.integers(0, len(whole) - 1)), drawn.draw(st.integers(1, 255))
        tiny.replace(path, whole[:at] + bytes([whole[at] ^ bits]) + whole[at + 1 :])
    else:
        tiny.replace(path, drawn.draw(st.binary(max_size=100)))
    report = validate(root, deep=True)
    changed = not path.exists() or path.read_bytes() != whole
    if kind == "ours" and changed and not (path.name == "dataset.json" and _same_json(path, whole)):
        assert not report.valid, (path, damage)


def _same_json(path: Path, whole: bytes) -> bool:
    """Whether only the layout of the text was changed."""
    try:
        return bool(json.loads(path.read_bytes()) == json.loads(whole))
    except (OSError, ValueError):
        return False


_SMALL: dict[str, Path] = {}


def _small(factory: pytest.TempPathFactory, kind: str) -> Path:
    if kind not in _SMALL:
        write = tiny.write_dataset if kind == "ours" else tiny.write_release
        _SMALL[kind] = write(factory.mktemp("small") / kind, frames=3, size=24)
    return _SMALL[kind]


BYPRODUCTS = (
    "3dgs_scene/point_cloud/iteration_30000/point_cloud.ply", "3dgs_scene/cfg_args", "points3D.ply",
    "sparse/0/points3D.ply", "owod_bind_train_frames/frame_001.png", "distorted/database.db", "stereo/fusion.cfg",
    "3d_segmentation_use_aisrm_True/masks/test/frame_000.png", "3d_segmentation_use_aisrm_False/renders/test/a.png",
    "3d_segmentation_use_aisrm_True/metrics_x.json", "metrics_x.json", "renders/test/frame_000.png",
)  # fmt: skip


@pytest.mark.parametrize("kind", ["ours", "release"])
def test_what_the_released_pipeline_wrote_is_a_note(tmp_path: Path, kind: str):
    write = tiny.write_dataset if kind == "ours" else tiny.write_release
    root = write(tmp_path / kind)
    for path in BYPRODUCTS:
        tiny.replace(root / tiny.SINGLE / path, b"theirs")
    report = validate(root, deep=True)
    assert report.valid
    assert {problem.severity for problem in report.problems} == {"note"}
    notes = {p.path.removeprefix(f"{tiny.SINGLE}/"): p.message for p in report.problems if "by-product" in p.message}
    files = {"points3D.ply", "sparse/0/points3D.ply", "metrics_x.json"}
    assert set(notes) == files | {path.split("/")[0] for path in BYPRODUCTS if path not in files}
    assert notes["3dgs_scene"] == "2 files, by-product of the released pipeline; no part of the dataset"
    tiny.replace(root / tiny.SINGLE / "mine/frame_001.png", b"mine")
    assert validate(root).valid == (kind == "release"), "anything else in a tree of ours is still an error"
