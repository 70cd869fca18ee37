"""What random changes, homes and voices are worth: the data of the trainings, how they are scored and collected."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_json
from baselines.listener.shards import VERSION, ShardStore, ShardTable
from benchmarks import ablation_tables
from benchmarks import listener_ablation as ablation

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")

SIDE = 252


# ---- data


def store(keys: list[str], views: list[int]) -> ShardStore:
    """Sounds whose numbers are their values, of pictures whose numbers are theirs."""
    count, shown = len(keys), max(views) + 1
    table = ShardTable(
        version=VERSION, side=SIDE, digest="d", keys=keys, view=views, audible=[[f"{n}"] for n in range(count)],
        others=[False] * count, lateral=[float(n) for n in range(count)], groups=[f"g{n}" for n in range(shown)],
        homes=[f"h{n}" for n in range(shown)], cameras=[[0.5] * 4] * shown, present=[[]] * shown,
        has_response=[n > 2 for n in range(count)],
    )  # fmt: skip
    each: dict[str, Any] = {name: np.arange(shown)[:, None] for name in ("pictures", "classes", "extents")}
    each |= {name: np.arange(count)[:, None] for name in ("sounds", "coded", "masks", "marked", "responses")}
    return ShardStore(table, **each)


def test_a_part_of_a_store_has_the_pictures_of_its_sounds() -> None:
    whole = store([f"part_1/h/kitchen/1/frame_{n:03d}" for n in range(5)], [2, 0, 2, 1, 0])
    part = ablation.part_of(whole, [0, 1, 4])
    assert part.table.view == [1, 0, 0]
    assert part.table.homes == ["h0", "h2"]
    assert part.table.lateral == [0.0, 1.0, 4.0]
    assert (part.sounds[:, 0].tolist(), part.pictures[:, 0].tolist()) == ([0, 1, 4], [0, 2])
    assert (part.responses[:, 0].tolist(), part.table.has_response) == ([0, 1, 4], [False, False, True])
    assert part.table.digest == whole.table.digest


def test_every_nth_frame_of_all_observations_is_taken() -> None:
    keys = [f"part_3/h/kitchen/{n}/frame_{frame:03d}" for n in range(3) for frame in range(12)]
    table = store(keys, list(range(36))).table
    assert [keys[n][-3:] for n in ablation.thinned(table, 10)] == ["000", "004", "008"] * 3
    assert len(ablation.thinned(table, 36)) == 36
    assert len(ablation.thinned(table, 1)) == 3  # one frame of each


def observations() -> dict[str, list[tuple[str, str]]]:
    """Eight clocks and two kettles, each alone, each pair of neighbouring clocks, a dog, and silence."""
    clocks = [("clock", f"procedural:clock/{n}") for n in range(8)]
    return {
        **{f"one/{n}": [each] for n, each in enumerate(clocks)},
        **{f"two/{n}": [clocks[n], clocks[n + 1]] for n in range(7)},
        "kettle": [("kettle", "procedural:kettle/jug")], "dog": [("dog", "procedural:dog/bark")], "silence": [],
    }  # fmt: skip


def test_a_share_of_the_voices_is_that_of_each_category() -> None:
    played = observations()
    found = ablation.with_voices(played, ablation.Arm(voices=0.5), 0)
    heard = {voice for key in found for category, voice in played[key] if category == "clock"}
    assert len(heard) == 4
    assert {key for key in played if key.startswith("one") and played[key][0][1] in heard} <= found
    # What has no class is not what is learnt.
    assert {"kettle", "dog", "silence"} <= found
    assert found != ablation.with_voices(played, ablation.Arm(voices=0.5), 1)


def test_beside_it_are_as_many_observations_of_each_kind_with_all_voices() -> None:
    played = observations()
    for seed in range(5):
        few, other = (
            ablation.with_voices(played, ablation.Arm(voices=0.5, every_voice=way), seed) for way in (False, True)
        )
        for kind in ("one", "two", "kettle", "dog", "silence"):
            assert sum(key.startswith(kind) for key in few) == sum(key.startswith(kind) for key in other)


def test_arms_that_see_the_same_pictures_begin_as_one() -> None:
    assert ablation.beginning_of("eq") == ablation.beginning_of("half of the voices") == "nothing"
    assert ablation.beginning_of("jpeg") == "jpeg"
    assert ablation.beginning_of("half of the homes") == "half of the homes"
    assert ablation.beginning_of("all changes") == "all changes"


def test_every_change_is_left_out_by_itself() -> None:
    from baselines.listener.augment import CHANGES

    alone = [arm.without for title, arm in ablation.ARMS.items() if arm.without and title != "all changes"]
    assert sorted(alone) == sorted((name,) for name in CHANGES)
    assert ablation.ARMS["all changes"].without == tuple(sorted(CHANGES))


# ---- steps


def test_steps_fill_the_time_that_is_planned_for() -> None:
    pictures, sounds = ablation.steps_for(700, (0.03, 0.06), 3, 8)
    firsts = len({ablation.beginning_of(title) for title in ablation.ARMS})
    taken = 3 * (firsts * pictures * 0.03 + len(ablation.ARMS) * (sounds * 0.06 + ablation.BESIDES))
    assert taken == pytest.approx(0.8 * 8 * 700, rel=0.01)
    assert pictures == pytest.approx(1.5 * sounds, abs=1)
    with pytest.raises(Avs3dError, match="30 s do not suffice for 3 seeds"):
        ablation.steps_for(30, (0.03, 0.06), 3, 8)


def test_arms_that_are_named_are_trained_alone_and_have_more_steps(tmp_path: Path) -> None:
    arms = ("nothing", "codec")
    plan = ablation.Trainings(
        Path("cache"), {}, tmp_path, frames=1, batch=4, size="small", accelerator="cpu", arms=arms
    )
    assert ablation._jobs(plan, 0) == [("pictures", "nothing", 0), ("sounds", "nothing", 0), ("sounds", "codec", 0)]
    assert ablation.steps_for(700, (0.03, 0.06), 3, 8, arms)[1] > 5 * ablation.steps_for(700, (0.03, 0.06), 3, 8)[1]


# ---- scores


def columns(*each: slice | None) -> Any:
    """Masks in each of which some columns are marked."""
    masks = torch.zeros(len(each), SIDE, SIDE, dtype=torch.bool)
    for mask, where in zip(masks, each, strict=True):
        if where is not None:
            mask[:, where] = True
    return masks


def test_the_surest_pixel_may_lie_a_little_beside_what_sounds() -> None:
    truth = columns(slice(126, 160), slice(126, 160), slice(126, 160), None)
    odds = columns(slice(118, 120), slice(90, 92), slice(140, 150), slice(0, 9)).float()
    # A pixel of 252 over 90 degrees is half of a degree in the middle.
    batch = SimpleNamespace(masks=truth, cameras=torch.full((4, 4), 0.5))
    assert ablation.surest_is_near(odds, batch).tolist() == [True, False, True, False]


def saying(marked: Any, loudest: list[int]) -> Any:
    """A network whose answers are known: masks at stride 2, and loudest categories."""
    return lambda *_: SimpleNamespace(mask=12.0 * marked[:, ::2, ::2].float() - 6, audible=torch.eye(8)[loudest])


def test_figures_are_those_of_the_mask_of_the_surest_pixel_and_of_the_loudest_category(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from contextlib import nullcontext

    truth = columns(slice(0, 64), slice(0, 64), slice(0, 64), None)
    heard = torch.zeros(4, 8)
    heard[:3, 0] = 1
    heard[2, 1] = 1
    batch = SimpleNamespace(
        pictures=torch.zeros(4, 3, SIDE, SIDE), sounds=torch.zeros(4, 2, 8), cameras=torch.full((4, 4), 0.5),
        masks=truth, audible=heard,
    )  # fmt: skip
    monkeypatch.setattr("baselines.listener.model.hear", lambda *_: None)
    bank, fabric = SimpleNamespace(gather=lambda *_: batch), SimpleNamespace(autocast=nullcontext)
    table: Any = SimpleNamespace(view=[0, 1, 2, 3], heard=lambda sounds: np.zeros((len(sounds), 8), np.bool_))
    network = saying(columns(slice(0, 64), slice(0, 128), slice(188, 252), slice(0, 9)), [0, 1, 1, 3])
    found = ablation.look_at(network, bank, table, np.arange(4), fabric)
    figures = ablation.figures_of(found, 0.5, 0.5)
    # Right; twice as wide, its surest pixel within the object; elsewhere. The fourth marks what is silent.
    assert figures["strict_IoU"] == pytest.approx((1 + 0.5 + 0) / 3, abs=0.01)
    assert figures["direction"] == pytest.approx(2 / 3, abs=1e-4)
    assert (figures["FP_rate"], figures["category"]) == (1.0, 0.5)


def test_the_rule_weighs_marks_against_false_ones() -> None:
    from baselines.listener.calibration import SHARES

    peak = np.array([0.9, 0.9, 0.55, 0.65])  # two that show what sounds, two that do not
    iou = np.zeros((4, len(SHARES)))
    iou[:2, SHARES.index(0.4)] = 0.3
    yes, no = np.ones(4, bool), np.zeros(4, bool)
    found = ablation.ScoredFrames(peak, iou, np.array([True, True, False, False]), no, yes, no)
    assert ablation.rule_for(found) == (0.7, 0.4)
    assert ablation.figures_of(found, 0.7, 0.4) == {
        "strict_IoU": 0.3, "FP_rate": 0.0, "direction": 0.0, "category": 0.0,
    }  # fmt: skip
    assert ablation.figures_of(found, 0.6, 0.4)["FP_rate"] == 0.5


# ---- results


def test_changes_are_those_of_the_same_seeds(tmp_path: Path) -> None:
    def trained(title: str, seed: int, iou: float | None) -> None:
        row = {"strict_IoU": iou, "direction": 0.5, "category": 0.6, "FP_rate": 0.1}
        data = {"homes": 44, "pictures": 1000, "sounds": 4000}
        name = f"{title.replace(' ', '-')}-{seed}.json"
        write_json(tmp_path / ablation.RESULTS / name, {"figures": {"a": row, "b": row}, "data": data})

    (tmp_path / ablation.RESULTS).mkdir()
    write_json(tmp_path / ablation.PLAN, {"sound_steps": 5})
    trained("nothing", 0, 0.30)
    trained("nothing", 1, 0.40)
    trained("half of the homes", 1, 0.35)
    trained("half of the homes", 2, 0.90)
    trained("decay", 0, None)  # no frame shows what sounds
    trained("half of the voices", 0, 0.2)
    trained("as many sounds as with half of the voices", 0, 0.25)
    found = ablation.collected(tmp_path)
    arms = found["arms"]
    assert found["trainings"] == {"sound_steps": 5}
    few, many = "half of the voices", "as many sounds as with half of the voices"
    assert list(arms) == ["nothing", "half of the homes", few, many, "decay"]
    assert (arms[few]["a"]["change"]["mean"], arms[many]["a"]["change"]["mean"]) == (-0.05, -0.05)
    assert (arms["decay"]["a"]["strict_IoU"], arms["decay"]["a"]["change"]) == (None, None)
    assert arms["half of the homes"]["a"]["strict_IoU"]["values"] == [0.35, 0.9]
    assert arms["half of the homes"]["b"]["change"]["values"] == [-0.05]
    titles = {name: name for name in ("nothing", "half of the homes", "eq")}
    rows = ablation_tables.table_rows(dict(sorted(arms.items())), titles)
    assert [row[0] for row in rows] == ["nothing", "half of the homes"]
    assert rows[1][:5] == ["half of the homes", "44, 4,000", "2", ".625 (.350–.900)", "−.050 (−.050 to −.050)"]
    assert len(rows[1]) == 3 + 2 * 4
    document = {"arms": arms, "trainings": {"picture_steps": 1500, "sound_steps": 900, "batch": 64}}
    shown = ablation_tables.summary(document)
    assert "| a: strict IoU | a: change |" in shown
    assert [line.split(" | ")[0] for line in shown.splitlines()[2:4]] == ["| nothing", "| decay"]
    assert shown.endswith("1,500 steps with 64 parts of pictures, then 900 with 64 sounds.")
    said = [line.split(" | ")[0] for line in ablation_tables.curves(document).splitlines()[2:]]
    assert said == ["| half of the homes", f"| {few}", "| … all voices, as many sounds", "| all homes and voices"]
    pytest.importorskip("matplotlib", reason="pictures need the [plot] extra")
    assert ablation_tables.draw(document).startswith(b"\x89PNG")
