"""The foundation baseline: tracks by rays, what is heard, the choice by both ears; all of it from tiny checkpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.formats.files import read_json
from avs3d_bench.geometry import Intrinsics, Pose
from baselines import sound_control
from baselines.cli import baseline
from baselines.foundation.protocols import TextMasks
from baselines.foundation.tracks import ALONE, Sighting, join, sighting
from tests.support import tiny
from tests.support.delays import delayed
from tests.support.needs import need
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import BOTH, FIRST, SILENT

torch = pytest.importorskip("torch", reason="torch is not installed: the learned baselines cannot run")
need("transformers", reason="transformers is not installed: the learned baselines cannot run")

from baselines.foundation import run  # noqa: E402
from tests.support import tiny_foundation  # noqa: E402
from tests.support.tiers import some  # noqa: E402

torch.set_num_threads(1)
CPU = torch.device("cpu")
CAMERA = Intrinsics.from_fov(128)
#: Along a wall, looking at it and a little aside.
WALK = [Pose.from_yaw((-1.5 + 0.5 * k, 1.5, 0.2 * (k % 2)), np.radians(12 - 4 * k)) for k in range(7)]


@pytest.fixture(scope="module")
def scenes(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(frames=17)


# ---- tracks


def seen(points: np.ndarray[Any, Any], poses: Sequence[Pose] = WALK, side: float = 0.3) -> list[Sighting]:
    """The sightings of cubes of ``side`` metres: boxes round their projections, in front and inside of the picture."""
    found: list[Sighting] = []
    for frame, pose in enumerate(poses):
        pixels, depth = CAMERA.project(pose, points)
        index = 0
        for pixel, distance in zip(pixels, depth, strict=True):
            if distance <= 0.3 or not (pixel >= 0).all() or not (pixel < CAMERA.width).all():
                continue
            half = CAMERA.fx * side / distance / 2
            found.append(Sighting(frame, index, pixel, np.concatenate([pixel - half, pixel + half])))
            index += 1
    return found


def test_equal_objects_become_a_track_each_where_their_rays_meet() -> None:
    points = np.array([[-0.8, 1.2, -3.0], [0.1, 1.2, -3.0], [1.2, 1.9, -2.5]])
    tracks = join(seen(points), WALK, CAMERA)
    assert len(tracks) == 3
    for point in points:
        nearest = min(tracks, key=lambda track: float(np.linalg.norm(track.point - point)))
        np.testing.assert_allclose(nearest.point, point, atol=0.01)
        for one in nearest.sightings:
            np.testing.assert_allclose(one.centre, CAMERA.project(WALK[one.frame], point[None])[0][0], atol=0.01)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), missing=st.floats(0, 0.4), false=st.integers(0, 3))
def test_every_sighting_is_in_one_track_and_a_frame_has_one_of_each(seed: int, missing: float, false: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.array([[-1.0, 1.0, -3.0], [0.6, 1.4, -2.6]])
    kept = [one for one in seen(points) if rng.random() >= missing]
    for number in range(false):
        centre = rng.uniform(10, 118, 2)
        kept.append(Sighting(int(rng.integers(7)), 50 + number, centre, np.concatenate([centre - 4, centre + 4])))
    tracks = join(kept, WALK, CAMERA)
    members = [id(one) for track in tracks for one in track.sightings]
    assert sorted(members) == sorted(id(one) for one in kept)
    assert all(len({one.frame for one in track.sightings}) == len(track.sightings) for track in tracks)
    assert [len(t.sightings) for t in tracks] == sorted((len(t.sightings) for t in tracks), reverse=True)


def test_a_mask_seen_once_keeps_its_direction() -> None:
    (one,) = seen(np.array([[-1.2, 1.1, -2.0]]), WALK[:1])
    (track,) = join([one], WALK, CAMERA)
    assert np.linalg.norm(track.point - WALK[0].position) == pytest.approx(ALONE)
    np.testing.assert_allclose(CAMERA.project(WALK[0], track.point[None])[0][0], one.centre, atol=1e-6)


def test_a_camera_that_only_turns_gives_tracks_of_one_mask() -> None:
    still = [Pose.from_yaw((0, 1.5, 0), angle) for angle in (0.0, 0.2, -0.2)]
    tracks = join(seen(np.array([[0.0, 1.4, -2.0]]), still), still, CAMERA)
    assert [len(track.sightings) for track in tracks] == [1, 1, 1]


def test_the_middle_and_the_bounds_of_a_mask() -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[4:8, 10:16] = True
    found = sighting(3, 1, mask)
    assert (found.frame, found.index) == (3, 1)
    assert found.centre.tolist() == [13.0, 6.0]
    assert found.box.tolist() == [10, 4, 16, 8]


# ---- what is heard


def events(posterior: Any, together: bool) -> list[tuple[list[int], list[bool]]]:
    return [(members, frames.tolist()) for members, frames in run.heard_events(np.array(posterior), together=together)]


def test_one_category_wins_where_one_object_sounds_all_the_time() -> None:
    posterior = [[0.5, 0.4, 0.1], [0.2, 0.7, 0.1], [0, 0, 0], [0.45, 0.5, 0.05]]
    assert events(posterior, True) == [([1], [True, True, False, True])]
    assert events(np.zeros((2, 3)), True) == events(np.zeros((2, 3)), False) == []


def test_a_sound_without_a_name_is_one_of_all_objects_where_an_object_sounds_and_none_in_part_3() -> None:
    posterior = [[0.1, 0.2, 0.7], [0.1, 0.3, 0.6]]
    assert events(posterior, True) == [([0, 1], [True, True])]
    assert events(posterior, False) == [([1], [False, True])]


def test_in_part_3_each_frame_names_what_it_hears() -> None:
    posterior = [[0.6, 0.35, 0.05], [0.9, 0.05, 0.05], [0, 0, 0]]
    assert events(posterior, False) == [([0], [True, True, False]), ([1], [True, False, False])]


# ---- the choice, with networks that know


class Knows:
    """A tagger and a segmenter that know the truth: microwaves sound, and these are their masks."""

    name = "knows"

    def __init__(self, frames: Sequence[Frame], category: str = "microwave", other: bool = False) -> None:
        self.category, self.other, self.calls = category, other, [*frames]
        self.texts: set[str] = set()

    def posterior(self, clips: Any, rate: int, texts: Sequence[str]) -> Any:
        place = texts.index(run.SENTENCE.format(f"a {self.category}"))
        out = np.zeros((len(clips), len(texts)))
        out[:, len(texts) - 1 if self.other else place] = 1.0
        return out

    def segment(self, picture: Any, texts: Sequence[str]) -> list[TextMasks]:
        frame = next(f for f in self.calls if (f.rgb() == picture).all())
        ids, record = frame.instance_ids(), frame.observation.record
        assert record is not None
        found = []
        for text in texts:
            self.texts.add(text)
            wanted = [one.id for one in record.instances if one.category.replace("_", " ") == text]
            masks = np.array([ids == number for number in wanted if (ids == number).any()]).reshape(-1, *ids.shape)
            found.append(TextMasks(masks, np.ones(len(masks))))
        return found


def with_truth(root: Path, key: str, **how: Any) -> tuple[tuple[Frame, ...], run.Foundation, Knows]:
    frames = Dataset(root)[key].test
    knows = Knows(frames, **how)
    return frames, run.Foundation(knows, knows, CPU), knows


@pytest.mark.parametrize("sounding", [1, 3])
def test_the_ears_choose_between_twins(scenes: Path, monkeypatch: pytest.MonkeyPatch, sounding: int) -> None:
    """Two microwaves, the same pictures: only the delay between the ears tells which of them sounds."""
    frames, model, knows = with_truth(scenes, FIRST)
    record = frames[0].observation.record
    assert record is not None
    (place,) = [np.mean(one.bounds, axis=0) for one in record.instances if one.id == sounding]
    monkeypatch.setattr(Frame, "audio", lambda frame: delayed(place, frame))
    found = model(frames)
    assert knows.texts == {"microwave"}
    assert any(np.asarray(prediction.mask).any() for prediction in found)
    for frame, prediction in zip(frames, found, strict=True):
        assert (np.asarray(prediction.mask) == (frame.instance_ids() == sounding)).all()
        assert prediction.categories is not None
        assert set(np.unique(prediction.categories)) <= {0, record.class_ids["microwave"]}


def test_with_swapped_ears_something_else_is_chosen_and_in_silence_nothing(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, model, _ = with_truth(scenes, FIRST)
    record = frames[0].observation.record
    assert record is not None
    (place,) = [np.mean(one.bounds, axis=0) for one in record.instances if one.id == 1]
    monkeypatch.setattr(Frame, "audio", lambda frame: delayed(place, frame))
    own = model(frames)
    swapped = replace(model, hearing="swapped-ears")(frames)
    assert any((np.asarray(a.mask) != np.asarray(b.mask)).any() for a, b in zip(own, swapped, strict=True))
    silent = replace(model, hearing="none")
    assert not any(np.asarray(one.mask).any() for one in silent(frames))
    assert silent.method.endswith(", heard nothing")


def test_another_observation_is_heard_by_the_tagger_and_by_both_ears(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, model, knows = with_truth(scenes, FIRST)
    others = Dataset(scenes)[BOTH].frames
    tagged: list[Any] = []
    compared: list[Any] = []
    posterior, observe = knows.posterior, run.binaural.observe
    monkeypatch.setattr(sound_control, "other_frame", lambda frame, **_: others[frame.index])
    monkeypatch.setattr(knows, "posterior", lambda clips, *rest: (tagged.extend(clips), posterior(clips, *rest))[1])
    monkeypatch.setattr(run.binaural, "observe", lambda clips: (compared.extend(clips), observe(clips))[1])
    model = replace(model, hearing="other-category")
    model(frames)
    np.testing.assert_array_equal(tagged, [clip for clip in (frame.mono() for frame in others) if clip.any()])
    heard = [frame.audio() for frame in others if frame.mono().any()]
    np.testing.assert_array_equal(compared, heard)
    assert model.method.endswith(", heard another category")
    assert model.notes == f"{replace(model, hearing='own').notes}; heard another category"


def test_with_swapped_ears_the_command_says_so(scenes: Path, folders: dict[str, Any], tmp_path: Path) -> None:
    options = [f"--{kind}-checkpoint={folder}" for kind, folder in folders.items()]
    arguments = ["foundation", "--dataset", str(scenes), "--only", BOTH, "--device", "cpu", "--sound", "swapped-ears"]
    result = CliRunner().invoke(baseline, [*arguments, *options, "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    record = read_json(tmp_path / "out" / "submission.json")
    assert record["method"] == "foundation (CLAP, SAM 3), heard with swapped ears"
    assert "; heard with swapped ears; only " in record["notes"]


@pytest.mark.parametrize(("key", "other"), [(SILENT, False), (FIRST, True)])
def test_where_no_category_is_heard_nothing_is_looked_for(scenes: Path, key: str, other: bool) -> None:
    frames, model, knows = with_truth(scenes, key, other=other)
    assert not any(np.asarray(one.mask).any() for one in model(frames))
    assert not knows.texts


def test_a_sound_without_a_name_is_placed_by_the_ears_alone(shared_dataset: SharedDataset) -> None:
    """In part_1 and part_2 one object sounds: of all that is seen, whatever it is, the ears choose it."""
    root = shared_dataset()
    frames, model, knows = with_truth(root, tiny.SINGLE, other=True)
    found = model(frames)
    assert len(knows.texts) == 7
    record = frames[0].observation.record
    assert record is not None
    (sounding,) = [one.id for one in record.instances if one.sounding]
    truth = [frame.instance_ids() == sounding for frame in frames]
    assert all((np.asarray(one.mask) == mask).all() for one, mask in zip(found, truth, strict=True))


def test_clips_of_several_lengths_are_one_line(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames, model, _ = with_truth(scenes, FIRST)
    monkeypatch.setattr(Frame, "audio", lambda frame: np.ones((2, 44_100 - frame.index), np.float32))
    with pytest.raises(Avs3dError, match=r"frame_\d+: a clip of shape \(2, \d+\), expected \(2, \d+\), two ears"):
        model(frames)


def test_networks_that_give_no_probabilities_are_one_line(scenes: Path) -> None:
    frames, model, knows = with_truth(scenes, BOTH)
    knows.posterior = lambda clips, rate, texts: np.full((len(clips), len(texts)), np.nan)  # type: ignore[method-assign]
    with pytest.raises(Avs3dError, match="knows gave no probabilities; check its weights"):
        model(frames)


# ---- tiny networks of the real classes


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("checkpoints")
    return {
        "clap": tiny_foundation.write_clap(folder / "clap"),
        "sam3": tiny_foundation.write_sam3(folder / "sam3"),
        "grounding-dino": tiny_foundation.write_grounding_dino(folder / "grounding-dino"),
        "sam2": tiny_foundation.write_sam2(folder / "sam2"),
    }


def test_probabilities_of_texts_sum_to_one_and_depend_on_the_sound(folders: dict[str, Any]) -> None:
    model = run.load_foundation(segmenter="grounded-sam2", folders=folders, device="cpu")
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(44_100).astype(np.float32)
    tone = np.sin(2 * np.pi * 440 * np.arange(44_100) / 44_100).astype(np.float32)
    texts = ["This is a sound of a clock.", "This is a sound of music.", "This is a sound of a toilet."]
    found = model.tagger.posterior([noise, tone, noise], 44_100, texts)
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(found[0], found[2], atol=1e-6)
    assert np.abs(found[0] - found[1]).max() > 1e-4


@pytest.mark.parametrize("segmenter", ["sam3", "grounded-sam2"])
def test_masks_have_the_size_of_the_picture_the_likeliest_first(folders: dict[str, Any], segmenter: Any) -> None:
    model = run.load_foundation(segmenter=segmenter, folders=folders, device="cpu")
    picture = np.random.default_rng(3).integers(0, 255, (60, 90, 3), dtype=np.uint8)
    with torch.inference_mode():
        first, second = model.segmenter.segment(picture, ["clock", "washing machine"])
        (again,) = model.segmenter.segment(picture, ["washing machine"])
    assert len(second.scores)
    for one in (first, second):
        assert one.masks.shape == (len(one.scores), 60, 90)
        assert (np.diff(one.scores) <= 0).all()
        assert one.masks.reshape(len(one.scores), -1).any(axis=1).all()
    # A text's answer does not depend on which texts come with it.
    assert (again.masks == second.masks).all()
    np.testing.assert_allclose(again.scores, second.scores, rtol=1e-5)
    assert first.scores.tolist() != second.scores.tolist()


@pytest.mark.parametrize("segmenter", some(["sam3", "grounded-sam2"], every=2))
def test_the_command_writes_a_submission_with_the_same_bytes_each_time(
    scenes: Path, folders: dict[str, Any], tmp_path: Path, segmenter: str
) -> None:
    options = [f"--{kind}-checkpoint={folder}" for kind, folder in folders.items()]
    arguments = ["foundation", "--dataset", str(scenes), "--only", BOTH, "--segmenter", segmenter, "--device", "cpu"]
    for name in ("one", "two"):
        result = CliRunner().invoke(baseline, [*arguments, *options, "-o", str(tmp_path / name)])
        assert result.exit_code == 0, result.output
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert all((tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes() for file in files)
    frames = Dataset(scenes)[BOTH].test
    masks = [media.read_png_mask(tmp_path / "one" / BOTH / "masks" / f"{frame.name}.png") for frame in frames]
    assert masks[0].shape == frames[0].rgb().shape[:2]
    names = {"sam3": "SAM 3", "grounded-sam2": "Grounding DINO + SAM 2"}
    assert f'"foundation (CLAP, {names[segmenter]})"' in (tmp_path / "one" / "submission.json").read_text()


def test_a_dry_run_says_what_would_be_loaded_and_what_is_missing(
    scenes: Path, folders: dict[str, Any], tmp_path: Path
) -> None:
    arguments = ["foundation", "--dataset", str(scenes), "-o", str(tmp_path / "out"), "--dry-run"]
    result = CliRunner().invoke(baseline, [*arguments, f"--clap-checkpoint={folders['clap']}"])
    assert result.exit_code == 0, result.output
    clap, sam3 = result.output.strip().splitlines()
    assert clap == f"CLAP: {folders['clap']}, 0.2 MB, Apache-2.0"
    assert sam3.startswith("SAM 3: no folder with the checkpoint of SAM 3: make one and put config.json, ")
    assert "SAM License, to be accepted there" in sam3
    assert not (tmp_path / "out").exists()


def test_a_missing_checkpoint_is_one_line_before_any_network_is_loaded(folders: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no folder with the checkpoint of SAM 2: make one"):
        run.load_foundation(segmenter="grounded-sam2", folders={**folders, "sam2": None}, device="cpu")
    with pytest.raises(Avs3dError, match=r"no-such: no folder with the checkpoint of CLAP; put config\.json"):
        run.load_foundation(folders={**folders, "clap": tmp_path / "no-such"}, device="cpu")
    with pytest.raises(UsageError, match="segmenter 'sam4': expected one of sam3, grounded-sam2"):
        run.load_foundation(segmenter="sam4", folders=folders)  # type: ignore[arg-type]
