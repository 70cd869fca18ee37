"""The listener: its data, its batches, its training and its weights, on a dataset of twenty sounds."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tarfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import write_webdataset
from tests.support.needs import need

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")
need("lightning_fabric", reason="lightning-fabric is not installed: the listener cannot be trained")

from baselines.listener import augment, losses, shards, sound_changes, steps, training, validation, weights  # noqa: E402
from baselines.listener.batches import COUNTERFACTUAL, SOUNDS, UNKNOWN, Sampler, SoundKind, split_homes  # noqa: E402
from baselines.listener.checkpoint import CHECKPOINT, Settings, new_state  # noqa: E402
from baselines.listener.model import CLASSES, Listener, hear, match_map, parameter_count  # noqa: E402
from baselines.listener.steps import Schedule  # noqa: E402
from tests.support import tiny, tiny_scenes  # noqa: E402
from tests.support.tiny_listener import SMALL  # noqa: E402

torch.set_num_threads(1)
RARELY = Schedule(validate_every=1_000_000)
CAMERA = torch.tensor([[0.5, 0.5, 0.5, 0.5]])


def settings(**changed: Any) -> Settings:
    """Of a small network and few steps."""
    return replace(Settings(steps=4, batch=SOUNDS, rate=2e-3, average=0.5, widths=SMALL), **changed)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shards of two pictures with five sounds each."""
    folder = tmp_path_factory.mktemp("listener")
    tiny_scenes.write_part_3(folder / "set", frames=2, size=64)
    write_webdataset(folder / "set", folder / "shards", workers=1)
    return folder / "shards"


@pytest.fixture(scope="module")
def store(data: Path) -> shards.ShardStore:
    return shards.read_store(data, data.parent / "store", workers=1)


@pytest.fixture(scope="module")
def fabric() -> Any:
    from lightning_fabric import Fabric

    made = Fabric(accelerator="cpu", devices=1, precision="32-true")
    made.launch()
    return made


@pytest.fixture(autouse=True)
def _few_settling_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Means and variances of the averaged network from two batches: a CPU takes long for more."""
    monkeypatch.setattr(steps, "SETTLING_STEPS", 2)


# ---- data


def test_siblings_share_one_picture_and_keep_their_own_sounds_and_masks(store: shards.ShardStore) -> None:
    table = store.table
    assert len(table.groups) == 2
    assert len(table.keys) == 10
    assert sorted(np.bincount(table.view)) == [5, 5]
    for sound, key in enumerate(table.keys):
        observation, frame = key.rsplit("/", 1)
        assert table.groups[table.view[sound]] == f"{tiny_scenes.FIRST}/{frame}"
        assert observation in (tiny_scenes.FIRST, tiny_scenes.SECOND, tiny_scenes.BOTH) or not store.marked[sound]
    assert np.count_nonzero(store.marked) >= 3
    assert table.present[0] == ["microwave", "telephone"]
    silent = [sound for sound, key in enumerate(table.keys) if key.startswith(tiny_scenes.SILENT)]
    assert not np.asarray(store.sounds[silent]).any()
    assert table.audible[silent[0]] == []


def test_pixels_and_samples_are_those_of_the_frames(data: Path, store: shards.ShardStore) -> None:
    from avs3d_bench.dataset import Dataset

    frame = Dataset(data.parent / "set")[tiny_scenes.SECOND].frames[1]
    sound = store.table.keys.index(f"{tiny_scenes.SECOND}/{frame.name}")
    view = store.table.view[sound]
    np.testing.assert_allclose(store.sounds[sound], frame.audio(), atol=1e-3)
    np.testing.assert_array_equal(store.pictures[view], shards.fit(frame.rgb(), shards.SIDE, cv2.INTER_AREA))
    mask = shards.fit(frame.mask().astype(np.uint8), shards.SIDE, cv2.INTER_NEAREST)
    np.testing.assert_array_equal(augment.unpack(torch.from_numpy(np.asarray(store.masks[sound][None])))[0], mask)
    classes = store.classes[view]
    assert set(np.unique(classes)) <= {0, 1 + CATEGORIES.index("microwave"), 1 + CATEGORIES.index("telephone")}
    assert (classes[mask == 1] == 1 + CATEGORIES.index("microwave")).all()


def test_frames_larger_than_the_network_s_pictures_are_stored_twice_as_fine(tmp_path: Path) -> None:
    tiny_scenes.write_part_3(tmp_path / "set", frames=2, size=600)
    write_webdataset(tmp_path / "set", tmp_path / "shards")
    store = shards.read_store(tmp_path / "shards", tmp_path / "cache", workers=1)
    assert store.pictures.shape[1:] == (shards.FINE, shards.FINE, 3)
    frame = Dataset(tmp_path / "set")[tiny_scenes.SECOND].frames[1]
    sound = store.table.keys.index(f"{tiny_scenes.SECOND}/{frame.name}")
    mask = augment.unpack(torch.from_numpy(np.asarray(store.masks[sound][None])))
    np.testing.assert_array_equal(mask[0], shards.fit(frame.mask().astype(np.uint8), shards.FINE, cv2.INTER_NEAREST))
    bank = augment.Bank(store, torch.device("cpu"))
    plan = validation.own_plan(store.table, [store.table.view[sound]], [sound])
    whole = bank.gather(plan, None)
    assert whole.pictures.shape[-1] == whole.classes.shape[-1] == whole.masks.shape[-1] == shards.SIDE
    expected = shards.fit(frame.rgb(), shards.SIDE, cv2.INTER_AREA).transpose(2, 0, 1)
    assert (255 * whole.pictures[0] - torch.from_numpy(expected)).abs().mean() < 0.5
    again = bank.gather(plan, torch.Generator().manual_seed(0), augment.CHANGES)
    assert again.pictures.shape[-1] == again.masks.shape[-1] == shards.SIDE


def test_parts_of_fine_pictures_are_sharp_and_whole_ones_are_means() -> None:
    # Columns that alternate: a part of a quarter shows them, a whole picture their mean.
    fine = (torch.arange(shards.FINE) % 2).float().expand(1, 3, shards.FINE, shards.FINE)
    nothing = torch.zeros(1, shards.FINE, shards.FINE)
    batch = augment.Batch(
        fine, nothing.long(), CAMERA, torch.zeros(1, 2, 8), nothing > 0, torch.zeros(1, 8),
        torch.ones(1, dtype=torch.bool), torch.zeros(1, dtype=torch.int64),
    )  # fmt: skip
    weights = torch.ones(1, shards.FINE**2)
    spread = []
    for part in (0.25, 1.0):
        shown = augment._shown(batch, torch.tensor([part]), weights, 126, torch.Generator().manual_seed(0))
        spread.append(float(shown.pictures.std()))
    assert spread[0] > 0.2
    assert spread[1] < 0.01


def test_the_lateral_angle_of_the_only_source_lies_on_its_mask(store: shards.ShardStore) -> None:
    found = 0
    for sound, lateral in enumerate(store.table.lateral):
        if lateral is not None and store.marked[sound]:
            low, high = store.extents[store.table.view[sound]][CATEGORIES.index("microwave")]
            assert low - 0.05 <= lateral <= high + 0.05
            found += 1
    assert found >= 2


def test_what_is_stored_is_read_once(data: Path, tmp_path: Path) -> None:
    first = shards.read_store(data, tmp_path / "cache", workers=1)
    before = (tmp_path / "cache" / "sounds.npy").stat().st_mtime_ns
    again = shards.read_store(data, tmp_path / "cache", workers=1)
    assert (tmp_path / "cache" / "sounds.npy").stat().st_mtime_ns == before
    assert again.table == first.table


@pytest.mark.parametrize("end", ["in a member", "after the last member"])
def test_a_shard_that_is_cut_short_is_one_line(data: Path, tmp_path: Path, end: str) -> None:
    whole = next(data.glob("*.tar"))
    content = whole.read_bytes()
    last = len(content.rstrip(b"\0"))
    kept = len(content) // 3 if end == "in a member" else last + -last % tarfile.BLOCKSIZE
    (tmp_path / whole.name).write_bytes(content[:kept])
    with pytest.raises(Avs3dError, match=rf"{whole.name}: .*cut short.*write it again") as caught:
        shards.read_store(tmp_path, tmp_path / "cache", workers=1)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize(("lost", "what"), [("binaural.wav", "sound"), ("instances.png", "instance ids")])
def test_a_dataset_without_sound_is_one_line(data: Path, tmp_path: Path, lost: str, what: str) -> None:
    whole = next(data.glob("*.tar"))
    with tarfile.open(whole) as old, tarfile.open(tmp_path / "train-000000.tar", "w") as new:
        for member in old:
            if not member.name.endswith(lost):
                new.addfile(member, old.extractfile(member))
    with pytest.raises(Avs3dError, match=rf"frame_\d+ has no {what} \({lost}\)"):
        shards.read_store(tmp_path, tmp_path / "cache", workers=1)


def test_a_folder_without_shards_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no shards \(\*\.tar\)"):
        shards.read_store(tmp_path, tmp_path / "cache")


# ---- batches


def test_the_mask_must_follow_the_sound_in_every_batch(store: shards.ShardStore) -> None:
    sampler = Sampler(store, batch=2, seed=3)
    kinds = set()
    for step in range(20):
        plan = sampler.plan(step)
        assert plan.counterfactual >= 1 / 3
        assert plan.views.shape == (2,)
        assert plan.sounds.shape == (2 * SOUNDS, 2)
        kinds |= set(plan.kinds.tolist())
        for row, kind in enumerate(plan.kinds):
            if kind in COUNTERFACTUAL and kind != SoundKind.SWAPPED:
                assert not any(store.marked[sound] for sound in plan.truths[row] if sound >= 0)
            if kind in (SoundKind.OWN, SoundKind.SWAPPED):
                assert store.table.view[plan.sounds[row, 0]] == plan.views[row // SOUNDS]
                assert plan.truths[row].tolist() == plan.sounds[row].tolist()
    assert {SoundKind.OWN, SoundKind.SWAPPED, SoundKind.SILENT, SoundKind.OFF_SCREEN, SoundKind.MIXED} <= kinds


def test_a_sound_of_no_class_is_heard_as_nothing_that_the_network_knows(store: shards.ShardStore) -> None:
    away = next(sound for sound, marked in enumerate(store.marked) if not marked and store.table.audible[sound])
    audible = [list(names) for names in store.table.audible]
    audible[away] = []
    others = [sound == away for sound in range(len(audible))]
    sampler = Sampler(replace(store, table=replace(store.table, audible=audible, others=others)), batch=2, seed=3)
    slot = sampler._real(away, away)
    assert (slot.audible, slot.kind) == ({UNKNOWN}, SoundKind.OFF_SCREEN)
    assert all(away not in sounds for sounds in sampler._of_category)
    for step in range(5):
        plan = sampler.plan(step)
        assert (plan.audible[:, UNKNOWN] == (plan.sounds == away).any(axis=1)).all()


def test_a_sound_from_elsewhere_comes_from_no_visible_instance(store: shards.ShardStore) -> None:
    sampler = Sampler(store, batch=2, seed=0)
    rng = np.random.default_rng(0)
    for view in sampler.visible:
        slot = sampler._elsewhere(int(view), rng)
        if slot is not None:
            (category,) = slot.audible
            low, high = store.extents[view][category]
            lateral = store.table.lateral[slot.sounds[0]]
            assert lateral is not None
            assert not low - 0.5 < lateral < high + 0.5


def test_plans_depend_on_seed_step_and_rank_alone(store: shards.ShardStore) -> None:
    one, other = Sampler(store, 1, 5, ranks=2), Sampler(store, 1, 5, ranks=2)
    one.plan(0)  # the order of calls does not matter
    for step, rank in ((7, 1), (3, 0), (7, 0)):
        first, second = one.plan(step, rank), other.plan(step, rank)
        np.testing.assert_array_equal(first.sounds, second.sounds)
        np.testing.assert_array_equal(first.views, second.views)
    assert one.plan(7, 0).views.tolist() != one.plan(7, 1).views.tolist()


def test_homes_are_split_by_their_names() -> None:
    names = [f"home_{number}" for number in range(50)]
    training_homes, kept = split_homes(names)
    assert len(kept) == 4
    assert not training_homes & kept
    assert split_homes(names[::-1] * 3) == (training_homes, kept)
    assert split_homes(["alone"]) == ({"alone"}, set())
    fewer, same = split_homes(names, 10)
    assert len(fewer) == 10
    assert fewer < split_homes(names, 20)[0] < training_homes
    assert same == kept


def test_a_mirrored_picture_has_its_ears_swapped(store: shards.ShardStore, monkeypatch: pytest.MonkeyPatch) -> None:
    bank = augment.Bank(store, "cpu")
    plan = Sampler(store, 1).plan(0)
    plain = bank.gather(plan, None)
    for name in ("MIX_DB", "ENLARGED"):
        monkeypatch.setattr(augment, name, 0.0)
    monkeypatch.setattr(augment, "MIRRORED", 1.1)
    turned = bank.gather(plan, torch.Generator().manual_seed(0), augment.CHANGES)
    torch.testing.assert_close(turned.pictures, plain.pictures.flip(-1))
    torch.testing.assert_close(turned.sounds, plain.sounds.flip(1), atol=1e-5, rtol=1e-4)
    assert (turned.masks == plain.masks.flip(-1)).all()
    assert (turned.classes == plain.classes.flip(-1)).all()
    np.testing.assert_allclose(turned.cameras[:, 2], 1 - plain.cameras[:, 2])


def test_an_enlarged_picture_keeps_the_direction_of_every_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    from baselines.listener.direction import pixel_angles

    monkeypatch.setattr(augment, "ENLARGED", 1.1)
    size = (64, 64)
    angles = pixel_angles(CAMERA, size)
    batch = replace(pair(), pictures=angles[:, None].expand(-1, 3, -1, -1))
    for seed in range(5):
        found = augment.enlarged(batch, torch.Generator().manual_seed(seed))
        expected = pixel_angles(found.cameras, size)
        torch.testing.assert_close(found.pictures[0, 0][1:-1, 1:-1], expected[0][1:-1, 1:-1], atol=2e-3, rtol=0)
        assert (found.masks.any(dim=0) == (found.classes[0] > 0)).all()
        assert found.cameras[0, 0] >= 0.5
    assert found.cameras[0, 0] > 0.51


def test_parts_show_each_category_in_view_equally_often_and_keep_their_classes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(augment, "AROUND_OBJECTS", 1.1)
    monkeypatch.setattr(augment, "OFF_CENTRE", 0.0)
    monkeypatch.setattr(augment, "PART_SIDE", 32)
    classes = torch.zeros(400, 64, 64, dtype=torch.int64)
    classes[:, 20:50, 34:64] = 2
    classes[:, 30:33, 10:13] = 5
    batch = augment.Batch(
        (classes[:, None] / 7).expand(-1, 3, -1, -1), classes, CAMERA.expand(400, -1), torch.zeros(0, 2, 44_100),
        torch.zeros(0, 64, 64, dtype=torch.bool), torch.zeros(0, 8), torch.zeros(0, dtype=torch.bool),
        torch.zeros(0, dtype=torch.int64),
    )  # fmt: skip
    found = augment.parts(batch, torch.Generator().manual_seed(0), augment.CHANGES)
    assert found.pictures.shape == (400, 3, 32, 32)
    # Where the picture is of one class alone, it is the class that the picture shows.
    shown = found.pictures[:, 0] * 7
    pure = (shown - shown.round()).abs() < 1e-3
    near = (shown - found.classes).abs() < 0.5
    assert near[pure].float().mean() > 0.99
    centre = found.classes[:, 16, 16]
    assert {2, 5} <= set(centre.tolist())
    # Of the two categories one has a hundred times the pixels of the other. Parts at the border are moved inwards.
    assert 0.35 < (found.classes == 5).flatten(1).any(dim=1).float().mean() < 0.75
    assert len({round(float(x), 2) for x in found.cameras[:, 0]}) > 20


def test_an_equalised_sound_keeps_its_times_and_changes_its_levels() -> None:
    sounds = torch.zeros(1, 2, 44_100)
    sounds[0, 0, 1000] = sounds[0, 1, 1030] = 1.0
    found = sound_changes.filtered(sounds, torch.Generator().manual_seed(1), ("band", "timing"))
    assert found[0].argmax(dim=1).tolist() == [1000, 1030]
    gains = 20 * torch.log10(torch.fft.rfft(found).abs()[0])
    assert gains.std() > 1
    apart = gains[1] - gains[0]
    assert 0.1 < apart.std() < gains.std()


# ---- network


def test_the_network_is_small_and_its_shapes_are_those_of_the_docstrings() -> None:
    assert parameter_count(Listener()) <= 7_000_000
    sound = hear(torch.zeros(3, 2, 44_100), CAMERA.expand(3, -1), (60, 60))
    found = Listener(SMALL).eval()(torch.rand(1, 3, 60, 60), sound)
    assert found.classes.shape == (1, CLASSES, 32, 32)
    assert found.audible.shape == (3, len(CATEGORIES))
    assert found.mask.shape == (3, 32, 32)


def test_what_is_seen_ignores_the_sound_and_what_is_heard_ignores_the_picture() -> None:
    network = Listener(SMALL).eval()
    generator = torch.Generator().manual_seed(0)
    pictures, sounds = (
        torch.rand(2, 3, 64, 64, generator=generator),
        0.1 * torch.randn(2, 2, 44_100, generator=generator),
    )
    with torch.no_grad():
        found = [network(pictures[[p]], hear(sounds[[s]], CAMERA, (64, 64))) for p, s in ((0, 0), (0, 1), (1, 0))]
    torch.testing.assert_close(found[0].classes, found[1].classes)
    torch.testing.assert_close(found[0].audible, found[2].audible)
    assert not torch.allclose(found[0].mask, found[1].mask)


def test_without_sound_the_network_says_what_is_seen_and_nothing_else() -> None:
    network, picture = Listener(SMALL).eval(), torch.rand(2, 3, 64, 64)
    with torch.no_grad():
        alone = network(picture)
        together = network(picture, hear(torch.zeros(2, 2, 44_100), CAMERA.expand(2, -1), (64, 64)))
    torch.testing.assert_close(alone.classes, together.classes)
    assert (alone.audible.shape, alone.mask.shape) == ((0, len(CATEGORIES)), (0, 32, 32))


def test_several_sounds_of_a_picture_are_answered_as_one_by_one() -> None:
    network = Listener(SMALL).eval()
    pictures, sounds = torch.rand(2, 3, 64, 64), 0.1 * torch.randn(4, 2, 44_100)
    cameras = CAMERA.expand(4, -1)
    with torch.no_grad():
        together = network(pictures, hear(sounds, cameras, (64, 64)))
        alone = network(pictures[[1]], hear(sounds[[2]], CAMERA, (64, 64)))
    torch.testing.assert_close(together.mask[2], alone.mask[0], atol=1e-4, rtol=1e-4)


@pytest.mark.slow
def test_the_network_compiles_as_one_graph_with_the_same_answers() -> None:
    """`--compile` would gain little if Python ran between the pieces."""
    network = Listener(SMALL).eval()
    picture, sound = torch.rand(2, 3, 64, 64), hear(0.1 * torch.randn(4, 2, 44_100), CAMERA.expand(4, -1), (64, 64))
    graphs: list[Any] = []

    def note(graph: Any, _: Any) -> Any:
        graphs.append(graph)
        return graph.forward

    with torch.no_grad():
        plain = network(picture, sound)
        network.compile(backend=note, fullgraph=True)
        compiled = network(picture, sound)
    assert len(graphs) == 1
    for one, other in zip(plain, compiled, strict=True):
        torch.testing.assert_close(one, other)


def test_the_match_map_is_the_probability_that_a_pixels_category_is_heard_and_passes_no_gradient() -> None:
    classes = torch.full((1, CLASSES, 1, 2), -30.0, requires_grad=True)
    audible = torch.full((1, len(CATEGORIES)), -30.0, requires_grad=True)
    with torch.no_grad():
        classes[0, 3, 0, 0] = classes[0, 0, 0, 1] = 30.0
        audible[0, 2] = 30.0
    found = match_map(classes, audible)
    assert found.flatten().tolist() == pytest.approx([1.0, 0.0], abs=1e-6)
    assert not found.requires_grad


def test_the_mask_begins_as_that_of_the_category_that_is_heard() -> None:
    network = Listener(SMALL).eval()
    with torch.no_grad():
        network.sounding_decoder.head.weight.zero_()
        found = network(torch.rand(1, 3, 64, 64), hear(torch.zeros(2, 2, 44_100), CAMERA.expand(2, -1), (64, 64)))
    expected = torch.logit(match_map(found.classes, found.audible)[:, 0])
    torch.testing.assert_close(found.mask, expected, atol=1e-4, rtol=1e-4)


def test_the_probability_of_a_class_is_that_without_the_losss_weight() -> None:
    """The minimum of the loss over pixels of which three in ten show a clock."""
    truth = torch.zeros(1, CLASSES, 1, 1)
    truth[0, 0], truth[0, 5] = 0.7, 0.3
    logits = torch.zeros(1, CLASSES, 1, 1, requires_grad=True)
    optimiser = torch.optim.LBFGS([logits], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        value = losses.class_loss(logits, truth)
        value.backward()
        return value

    optimiser.step(loss)
    found = logits.softmax(dim=1)[0, :, 0, 0].tolist()
    assert (found[0], found[5]) == pytest.approx((0.7, 0.3), abs=1e-3)


def test_cells_have_the_shares_of_their_pixels() -> None:
    classes = torch.tensor([[[0, 0, 5, 5], [0, 3, 5, 5]]])
    found = losses.class_shares(classes)
    assert found.shape == (1, CLASSES, 1, 2)
    assert (found[0, 0, 0].tolist(), found[0, 3, 0].tolist(), found[0, 5, 0].tolist()) == ([0.75, 0], [0.25, 0], [0, 1])


def test_the_dice_loss_of_classes_sees_a_small_object_as_well_as_a_large_one() -> None:
    truth = torch.zeros(1, CLASSES, 8, 8)
    truth[0, 1, :, :4] = truth[0, 2, 0, 4] = 1
    truth[0, 0] = 1 - truth[0].sum(dim=0)
    sure = 40 * truth - 20
    assert losses.class_dice(sure, truth).item() == pytest.approx(0.0, abs=1e-5)
    missed = {}
    for category in (1, 2):
        wrong = truth.clone()
        wrong[0, 0] += wrong[0, category]
        wrong[0, category] = 0
        missed[category] = losses.class_dice(40 * wrong - 20, truth).item()
    # 32 cells missed: 1 − 1/33; one cell missed: 1 − 1/2; each a seventh of the mean.
    assert (missed[1], missed[2]) == pytest.approx(((1 - 1 / 33) / 7, 0.5 / 7), abs=1e-4)


def test_the_dice_loss_counts_masks_that_are_not_empty() -> None:
    truth = torch.zeros(2, 4, 4)
    truth[0, :2] = 1
    sure = torch.where(truth > 0, 20.0, -20.0)
    assert losses.dice_loss(sure, truth).item() == pytest.approx(0.0, abs=1e-6)
    # 8 marked, 8 true, none in common: 1 − (0 + 1) / (16 + 1); the empty mask does not count.
    assert losses.dice_loss(-sure[[0]], truth[[0]]).item() == pytest.approx(1 - 1 / 17, abs=1e-6)
    assert losses.dice_loss(torch.full((1, 4, 4), 9.0), torch.zeros(1, 4, 4)).item() == 0.0


def pair() -> augment.Batch:
    """One picture of two equal objects, with the sound of the left one and that of the right one."""
    pictures = torch.zeros(1, 3, 64, 64)
    truth = torch.zeros(2, 64, 64, dtype=torch.bool)
    for number, left in enumerate((8, 44)):
        truth[number, 24:40, left : left + 12] = True
    pictures[0, 0][truth.any(dim=0)] = 1.0
    noise = 0.1 * torch.randn(44_100, generator=torch.Generator().manual_seed(0))
    sounds = torch.stack([torch.stack([noise, torch.roll(noise, 14)]), torch.stack([torch.roll(noise, 14), noise])])
    classes = torch.where(truth.any(dim=0), 4, 0)[None]
    audible = torch.zeros(2, len(CATEGORIES) + 1)
    audible[:, 3] = 1
    kinds = torch.tensor([SoundKind.OWN, SoundKind.SWAPPED])
    return augment.Batch(pictures, classes, CAMERA, sounds, truth, audible, torch.ones(2, dtype=torch.bool), kinds)


@pytest.mark.slow
def test_in_an_overfitted_pair_the_mask_follows_the_sound() -> None:
    """Seconds of training: one picture, two sounds; swapped ears swap the answer."""
    batch, state = pair(), new_state(settings(rate=5e-3))
    model = steps.SoundingModel(state.network)
    totals = []
    for _ in range(120):
        total = losses.losses(model(batch.pictures, batch.sounds, batch.cameras), batch).total
        state.optimiser.zero_grad()
        total.backward()
        state.optimiser.step()
        totals.append(float(total.detach()))
    assert totals[-1] < 0.25 * totals[0]
    state.network.eval()
    with torch.no_grad():
        output = model(batch.pictures, batch.sounds, batch.cameras)
        swapped = model(batch.pictures, batch.sounds.flip(1), batch.cameras)
    sums = losses.measure(output, batch)
    assert sums["iou"] / sums["seen"] > 0.7
    assert (sums["right_pairs"], sums["pairs"]) == (1.0, 1.0)
    assert sums["category_seen"] == 2
    assert sums["category_iou"] > 1.4
    other = losses.measure(swapped, replace(batch, masks=batch.masks.flip(0)))
    assert other["right_pairs"] == 1.0


def test_a_deaf_answer_is_never_a_right_pair() -> None:
    batch = pair()
    both = torch.where(batch.masks.any(dim=0), 9.0, -9.0)[::2, ::2].expand(2, -1, -1)
    classes = torch.zeros(1, CLASSES, 32, 32)
    output = losses.ListenerOutput(classes, torch.zeros(2, len(CATEGORIES)), both)
    sums = losses.measure(output, batch)
    assert sums["pairs"] == 1
    assert sums["right_pairs"] == 0


# ---- training


def run(
    store: shards.ShardStore, folder: Path, fabric: Any, wanted: Settings, schedule: Schedule = RARELY
) -> steps.Result:
    folder.mkdir(exist_ok=True)
    return training.train(store, folder, wanted, fabric=fabric, schedule=schedule)


def weights_of(result: steps.Result) -> list[Any]:
    return [*result.state.network.state_dict().values(), *result.network.state_dict().values()]


@pytest.mark.slow
@pytest.mark.parametrize("early", [0, 3])
def test_a_run_that_goes_on_gives_the_same_weights(
    early: int, store: shards.ShardStore, fabric: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = settings(picture_steps=early)
    whole = run(store, tmp_path / "whole", fabric, wanted)
    monkeypatch.setattr(steps, "REPORT_STEPS", 2)
    part = run(store, tmp_path / "parts", fabric, wanted, replace(RARELY, minutes=1e-9))
    assert (part.step, part.finished) == (2, False)
    rest = run(store, tmp_path / "parts", fabric, wanted)
    assert (rest.step, rest.finished) == (4, True)
    for one, other in zip(weights_of(whole), weights_of(rest), strict=True):
        assert torch.equal(one, other)
    assert whole.state.shares == rest.state.shares
    lines = [json.loads(line) for line in (tmp_path / "parts" / steps.PROGRESS).read_text().splitlines()]
    assert [line["event"] for line in lines].count("start") == 2
    assert {"iou", "fp_rate", "pair_accuracy"} <= lines[-1].keys()


@pytest.mark.slow
def test_pictures_alone_teach_what_is_seen_and_leave_the_rest_as_it_was(
    store: shards.ShardStore, fabric: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(steps, "REPORT_STEPS", 1)
    wanted = settings(steps=41, picture_steps=40, rate=1e-2, batch=2 * SOUNDS)
    before = {name: value.clone() for name, value in new_state(wanted).network.named_parameters()}
    part = run(store, tmp_path, fabric, wanted, replace(RARELY, minutes=1e-9))
    assert part.step == 1
    for name, value in part.state.network.named_parameters():
        # Weight decay alone changes what has no gradient: by less than 0.1 %.
        assert name.startswith("picture_") or torch.allclose(value, before[name], rtol=1e-3, atol=0), name
    run(store, tmp_path, fabric, wanted)
    lines = [json.loads(line) for line in (tmp_path / steps.PROGRESS).read_text().splitlines()]
    early = [line for line in lines if line["event"] == "step" and line["step"] <= 40]
    assert all((line["mask"], line["audible"], line["counterfactual"]) == (0, 0, None) for line in early)
    seen = [line["classes"] for line in early]
    assert sum(seen[-5:]) < 0.8 * sum(seen[:5])
    assert lines[-2]["counterfactual"] is not None


@pytest.mark.slow
def test_steps_to_come_may_change_while_pictures_alone_are_learnt(
    store: shards.ShardStore, fabric: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(steps, "REPORT_STEPS", 1)
    stopped = run(store, tmp_path, fabric, settings(steps=9, picture_steps=3), replace(RARELY, minutes=1e-9))
    assert stopped.step == 1
    longer = run(store, tmp_path, fabric, settings(steps=5, picture_steps=4))
    assert (longer.step, longer.finished) == (5, True)
    with pytest.raises(UsageError, match=r"a run with steps 5, asked for 6"):
        run(store, tmp_path, fabric, settings(steps=6, picture_steps=4))


@pytest.mark.slow
def test_runs_that_differ_in_changes_of_sounds_share_what_pictures_alone_teach(
    store: shards.ShardStore, fabric: Any, tmp_path: Path
) -> None:
    usual = settings(steps=3, picture_steps=2)
    shared = run(store, tmp_path / "shared", fabric, usual, replace(RARELY, stop_at=2))
    assert (shared.step, shared.finished) == (2, False)
    with pytest.raises(UsageError, match=r"a run with without \[\], asked for \['blur'\]"):
        run(store, tmp_path / "shared", fabric, replace(usual, without=("blur",)))
    other = replace(usual, without=("disguise", "eq"))
    forked = run(store, tmp_path / "shared", fabric, other)
    whole = run(store, tmp_path / "whole", fabric, other)
    assert forked.finished
    for one, another in zip(weights_of(whole), weights_of(forked), strict=True):
        assert torch.equal(one, another)
    with pytest.raises(UsageError, match=r"a run with without"):
        run(store, tmp_path / "shared", fabric, usual)


@pytest.mark.slow
def test_another_run_is_not_gone_on_with(store: shards.ShardStore, fabric: Any, tmp_path: Path) -> None:
    run(store, tmp_path, fabric, settings(steps=1))
    with pytest.raises(UsageError, match=r"a run with seed 0, asked for 1; use the same, or another folder"):
        run(store, tmp_path, fabric, settings(steps=1, seed=1))
    (tmp_path / CHECKPOINT).write_bytes(b"half")
    with pytest.raises(Avs3dError, match=r"cannot go on from this checkpoint"):
        run(store, tmp_path, fabric, settings(steps=1))


def test_a_loss_that_is_no_number_stops_with_step_and_batch(
    store: shards.ShardStore, fabric: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, calls = steps.losses, []

    def broken(output: Any, batch: augment.Batch) -> losses.Losses:
        calls.append(1)
        found = before(output, batch)
        return replace(found, mask=found.mask * math.nan) if len(calls) == 3 else found

    monkeypatch.setattr(steps, "losses", broken)
    with pytest.raises(
        Avs3dError, match=r"step 2: the loss is nan \(mask nan, .*part_3/tiny/kitchen/1/frame_"
    ) as error:
        run(store, tmp_path, fabric, settings(steps=6))
    assert "\n" not in str(error.value)
    assert not (tmp_path / CHECKPOINT).exists()


def test_too_little_memory_is_one_line(
    store: shards.ShardStore, fabric: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate …\nmore")

    monkeypatch.setattr(Listener, "forward", full)
    with pytest.raises(Avs3dError, match=r"step 0: too little memory on cpu for --batch-size 4; take a smaller one"):
        run(store, tmp_path, fabric, settings())


def test_validation_looks_at_homes_that_are_kept(store: shards.ShardStore) -> None:
    assert validation.validation_views(store.table) == [0, 1]  # one home alone
    homes = replace(store.table, homes=["a", "b"])
    _, kept = split_homes(homes.homes)
    assert [homes.homes[view] for view in validation.validation_views(homes)] == list(kept)


def test_the_average_soon_forgets_the_first_weights() -> None:
    state = new_state(settings())
    parameter = next(state.network.parameters())
    with torch.no_grad():
        parameter.fill_(0.0)
        state.follow(0.9)  # the first is taken as it is
        parameter.fill_(1.0)
        found = []
        for _ in range(8):
            state.follow(0.9)
            found.append(1 - float(next(state.average.module.parameters()).flatten()[0]))
    assert found[0] == pytest.approx(2 / 11, abs=1e-6)
    assert found[7] < 1e-3


def test_the_rate_rises_and_falls() -> None:
    wanted = Settings(steps=100, rate=1.0, warm_up=0.1)
    rates = [wanted.rate_at(step) for step in range(100)]
    assert rates[:10] == pytest.approx([0.1 * n for n in range(1, 11)])
    assert all(one > other for one, other in pairwise(rates[10:]))
    assert rates[-1] == pytest.approx(0.01, abs=1e-3)


def test_the_rate_stays_while_pictures_alone_are_learnt() -> None:
    wanted = Settings(steps=100, picture_steps=40, rate=1.0, warm_up=0.1)
    rates = [wanted.rate_at(step) for step in range(100)]
    assert rates[9:41] == pytest.approx([1.0] * 32)
    assert all(one > other for one, other in pairwise(rates[40:]))
    assert rates[-1] == pytest.approx(0.01, abs=1e-3)


@pytest.mark.parametrize("changed", [{"batch": 6}, {"batch": 0}, {"steps": 0}, {"picture_steps": 4}])
def test_settings_that_make_no_batch_are_refused(changed: dict[str, int]) -> None:
    with pytest.raises(UsageError, match=r"expected"):
        settings(**changed)


@pytest.mark.slow
def test_the_command_trains_and_writes_weights_and_card(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from baselines.listener import job
    from baselines.listener.cli import train

    monkeypatch.setitem(job.SIZES, "small", SMALL)
    arguments = ["listener", "--data", str(data), "-o", str(tmp_path / "run"), "--steps", "2", "--batch-size", "4",
                 "--precision", "fp32", "--accelerator", "cpu", "--workers", "1", "--size", "small"]  # fmt: skip
    found = CliRunner().invoke(train, arguments, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    card = json.loads((tmp_path / "run" / "model_card.json").read_text())
    assert card["weights"]["sha256"] == weights.load_listener(tmp_path / "run" / "listener.safetensors")[1]
    assert card["training"]["steps"] == 2
    # Those to begin other data with: a run that goes on from these weights may take other homes.
    assert len(card["data"]["homes"]) == card["data"]["training_homes"] > 0
    assert sum(card["training"]["shares_of_sounds"].values()) == pytest.approx(1, abs=1e-3)
    assert (card["data"]["dataset"], card["data"]["manifest_sha256"]) == ("tiny-scenes", None)
    text = (tmp_path / "run" / "model_card.md").read_text()
    assert card["data"]["shards_sha256"] in text
    assert "Apache-2.0" in text
    assert "by others in the data: not known" in text  # of shards that were exported


@pytest.mark.slow
def test_a_run_begins_with_trained_weights_and_says_so(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from baselines.listener import job
    from baselines.listener.card import data_before
    from baselines.listener.cli import train

    monkeypatch.setitem(job.SIZES, "small", SMALL)
    torch.manual_seed(8)
    digest = weights.save_weights(Listener(SMALL), tmp_path / "trained.safetensors")
    credit = {"asset": "recording:clock", "author": "Ann Example", "name": "CC-BY-4.0", "source": "https://example.org"}
    learnt = {"sounds": 1234, "pictures": 56, "training_homes": 7, "assets": [credit]}
    earlier = {**learnt, "training_homes": 3, "assets": []}
    former = {"weights": {"sha256": digest}, "data": {**learnt, "before": [earlier]}}
    (tmp_path / "model_card.json").write_text(json.dumps(former))
    options = ["listener", "--data", str(data), "-o", str(tmp_path / "run"), "--steps", "1", "--batch-size", "4",
               "--precision", "fp32", "--accelerator", "cpu", "--workers", "1", "--rate", "1e-9",
               "--weights", str(tmp_path / "trained.safetensors")]  # fmt: skip
    found = CliRunner().invoke(train, options, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    # A step of this rate changes nothing that float16 shows.
    before, after = (
        weights.load_listener(tmp_path / name)[0] for name in ("trained.safetensors", "run/listener.safetensors")
    )
    for (name, one), other in zip(before.named_parameters(), after.parameters(), strict=True):
        assert torch.allclose(one, other, atol=1e-4), name
    card = json.loads((tmp_path / "run" / "model_card.json").read_text())
    assert card["training"]["began_with"] == digest
    text = (tmp_path / "run" / "model_card.md").read_text()
    assert f"Began with the weights of sha256 `{digest}`" in text
    # What they had learnt from stays known, and its makers credited.
    assert card["data"]["before"] == [earlier, learnt]
    assert "before, 1,234 sounds of 56 pictures in 7 homes" in text
    assert "recording:clock by Ann Example (CC-BY-4.0" in text
    assert data_before(tmp_path / "trained.safetensors", "0" * 64) == []  # the card of other weights
    # Neither with random ones nor with others.
    with pytest.raises(UsageError, match=rf"a run with weights {digest}, asked for None"):
        CliRunner().invoke(train, [*options[:-2], "--size", "small"], catch_exceptions=False)
    with pytest.raises(UsageError, match=r"--size and --weights: the weights have a size; expected one of them"):
        CliRunner().invoke(train, [*options, "--size", "small"], catch_exceptions=False)


def test_the_card_credits_who_made_recordings_and_models(tmp_path: Path) -> None:
    from avs3d_bench.contract.schema import AttributionRecord
    from avs3d_bench.exports.observation_tar import RECORD_MEMBER
    from baselines.listener import card
    from baselines.listener.dry import EXCERPT, DrySounds

    root = tiny.write_dataset(tmp_path / "data", frames=2)
    keys = [observation.key for observation in Dataset(root)]
    for number, key in enumerate(keys):
        record = json.loads((root / key / "observation.json").read_text())
        if number == 0:
            licence = {"name": "CC-BY-4.0", "author": "Ann Example", "source": "https://example.org/clock"}
            record["sound"] |= {"asset": "recording:clock", "licence": licence}
        (tmp_path / "record").write_text(json.dumps(record))
        (tmp_path / "shards").mkdir(exist_ok=True)
        with tarfile.open(tmp_path / "shards" / f"test-{number}.tar", "w") as archive:
            archive.add(tmp_path / "record", RECORD_MEMBER)
        (tmp_path / "shards" / f"train-{number}.tar").touch()  # not read: the record is the same
    bell = {"asset": "recording:bell", "name": "CC0-1.0", "author": "Bo Example", "source": "https://example.org/bell"}
    dry = DrySounds(np.zeros((0, EXCERPT), np.float16), np.zeros(0, np.int64), "", (AttributionRecord(**bell),))
    found = card._assets_of_others(tmp_path / "shards", dry)
    assert found is not None
    assert bell in found
    assert {"asset": "recording:clock", **licence} in found
    assert "recording:clock by Ann Example (CC-BY-4.0, https://example.org/clock)" in map(card._credit, found)
    assert not [each for each in found if each["author"] == "avs3d-bench"]


def test_shards_for_the_calibration_are_read_before_the_first_step(data: Path, tmp_path: Path) -> None:
    from baselines.listener.cli import train

    command = ["listener", "--data", str(data), "-o", str(tmp_path / "run"), "--steps", "2", "--batch-size", "4",
               "--accelerator", "cpu", "--workers", "1", "--calibrate-on", str(tmp_path / "none")]  # fmt: skip
    with pytest.raises(Avs3dError, match="none"):
        CliRunner().invoke(train, command, catch_exceptions=False)
    assert not (tmp_path / "run" / CHECKPOINT).exists()


def test_tiny_numbers_are_0_while_it_trains_and_no_longer() -> None:
    from baselines.listener.job import flushed

    tiny = torch.full((64,), 1e-39)
    with flushed():
        assert not (tiny * 1).any()
        with flushed():
            assert not (tiny * 1).any()
        assert not (tiny * 1).any()
    assert (tiny * 1).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--epochs", "1", "--steps", "2"], "expected one of them"),
        (["--manifest", "none.yaml"], "none.yaml: no such file"),
        (["--steps", "5", "--picture-steps", "5"], "--picture-steps 5: expected fewer than the 5 steps of all"),
    ],
)
def test_options_that_make_no_run_are_refused(arguments: list[str], message: str, tmp_path: Path) -> None:
    from baselines.listener.cli import train

    command = ["listener", "--data", str(tmp_path), "-o", str(tmp_path / "run"), *arguments]
    with pytest.raises(Avs3dError, match=message):
        CliRunner().invoke(train, command, catch_exceptions=False)


_KILLED = """
import sys
sys.path.insert(0, "tests")
import torch
torch.set_num_threads(1)
from pathlib import Path
from lightning_fabric import Fabric
from baselines.listener import steps, training
from tests.baselines import test_listener
fabric = Fabric(accelerator="cpu", devices=1, precision="32-true")
folder = Path(sys.argv[2])
store = training.prepare(sys.argv[1], folder, fabric, workers=1)
schedule = steps.Schedule(validate_every=10**6, checkpoint_minutes=0.0)
training.train(store, folder, test_listener.settings(steps=6), fabric=fabric, schedule=schedule)
"""


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_weights(
    data: Path, store: shards.ShardStore, fabric: Any, tmp_path: Path
) -> None:
    import time

    folder = tmp_path / "killed"
    process = subprocess.Popen([sys.executable, "-c", _KILLED, str(data), str(folder)])
    deadline = time.monotonic() + 300
    while not (folder / CHECKPOINT).exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    process.wait()
    rest = run(store, folder, fabric, settings(steps=6))
    assert rest.finished
    whole = run(store, tmp_path / "whole", fabric, settings(steps=6))
    for one, other in zip(weights_of(whole), weights_of(rest), strict=True):
        assert torch.equal(one, other)


# ---- weights


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "listener.safetensors"
    torch.manual_seed(0)
    weights.save_weights(Listener(SMALL), path)
    return path


def test_weights_come_back_as_float16_numbers_with_their_digest(saved: Path) -> None:
    torch.manual_seed(0)
    first = Listener(SMALL)
    network, digest = weights.load_listener(saved)
    assert network.widths == SMALL
    assert weights.digest_path(saved).read_text() == f"{digest}  {saved.name}\n"
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(tensor.float(), first.state_dict()[name].half().float())
    assert not network.training


def test_the_same_weights_are_the_same_bytes(tmp_path: Path) -> None:
    network = Listener(SMALL)
    assert len({weights.save_weights(network, tmp_path / f"{number}.safetensors") for number in range(8)}) == 1


def test_a_variance_beyond_float16_is_kept(tmp_path: Path) -> None:
    network = Listener(SMALL)
    with torch.no_grad():
        network.picture_decoder.levels[0].norm.running_var.fill_(123_456.0)
    weights.save_weights(network, tmp_path / "wide.safetensors")
    found, _ = weights.load_listener(tmp_path / "wide.safetensors")
    assert found.picture_decoder.levels[0].norm.running_var.max() == 123_456.0


def test_the_packages_weights_are_those_of_its_card() -> None:
    network, digest = weights.load_listener()
    card = json.loads((weights.PACKAGED.parent / "model_card.json").read_text())
    assert card["weights"] == {
        "file": "listener.safetensors", "sha256": digest, "parameters": parameter_count(network),
    }  # fmt: skip
    assert card["network_version"] in weights.READABLE
    assert card["licence"] == "Apache-2.0"
    assert weights.PACKAGED.stat().st_size <= 16e6
    # No path of the machine that trained it.
    assert not [word for word in card["training"]["command"].split() if word.startswith("/")]


def test_weights_that_were_changed_cut_or_of_another_version_are_one_line(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = saved.read_bytes()
    saved.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(Avs3dError, match=r"listener.safetensors: sha256 .*, expected .*changed or cut"):
        weights.load_listener(saved)
    weights.digest_path(saved).unlink()
    saved.write_bytes(content[:1000])
    with pytest.raises(Avs3dError, match=r"no whole safetensors file") as caught:
        weights.load_listener(saved)
    assert "\n" not in str(caught.value)
    saved.write_bytes(content)
    monkeypatch.setattr(weights, "READABLE", (98, 99))
    with pytest.raises(Avs3dError, match=r"weights of version 3 of the listener, expected 98 or 99"):
        weights.load_listener(saved)


def test_weights_that_are_not_there_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Avs3dError, match=r"none.safetensors: no such file; expected weights"):
        weights.load_listener(tmp_path / "none.safetensors")
    monkeypatch.setattr(weights, "PACKAGED", tmp_path / "weights" / "listener.safetensors")
    with pytest.raises(Avs3dError, match=r"this package comes without weights; train some and name them"):
        weights.load_listener()


def test_the_packages_weights_need_their_digest(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(weights, "PACKAGED", saved)
    assert weights.load_listener()[0].widths == SMALL
    weights.digest_path(saved).unlink()
    with pytest.raises(Avs3dError, match=r"listener.safetensors.sha256: missing"):
        weights.load_listener()


def test_foreign_safetensors_are_refused(tmp_path: Path) -> None:
    from safetensors.torch import save_file

    save_file({"a": torch.zeros(1)}, tmp_path / "x.safetensors")
    with pytest.raises(Avs3dError, match=r"no weights of the listener"):
        weights.load_listener(tmp_path / "x.safetensors")
