"""Training: losses against their definitions, density control by hand, and whole trainings of a tiny room."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from torch import Tensor

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from baselines.echosegnet import memory, pictures
from baselines.echosegnet import train as training
from baselines.echosegnet.densify import PARAMETERS, DensityControl, GradientStats, densify, parameters, reset_opacities
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.default import TorchRasteriser
from baselines.echosegnet.rasteriser.projection import rotation_matrices
from baselines.echosegnet.rasteriser.rendering import Splat
from baselines.echosegnet.similarity import psnr, ssim
from baselines.echosegnet.train import (
    Checkpoint,
    Pace,
    TrainingSettings,
    TrainingState,
    load_pictures,
    train,
    view_psnr,
)
from baselines.echosegnet.views import RegisteredView, load_points, load_views, test_views, train_views
from tests.support import tiny

torch.set_num_threads(1)
CPU = TorchRasteriser("cpu")
SHORT = TrainingSettings(iterations=60, density=DensityControl(max_gaussians=600))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    root = tiny.write_dataset(tmp_path_factory.mktemp("tiny"), frames=16, size=48)
    observation = Dataset(root)[tiny.SINGLE]
    xyz, rgb = load_points(observation)
    return SimpleNamespace(root=root, views=load_views(observation), xyz=xyz, rgb=rgb)


# --- likeness


def test_psnr_is_ten_log_of_the_mean_square() -> None:
    a = torch.zeros(4, 4, 3)
    assert psnr(a, a + 0.1) == pytest.approx(20.0, abs=1e-5)
    assert psnr(a, a) == math.inf


def test_ssim_is_the_published_formula() -> None:
    """Wang et al. 2004 with scipy's Gaussian of the same width; black beyond the border."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1, (2, 20, 24, 3))

    def blur(values: np.ndarray) -> np.ndarray:
        return gaussian_filter(values, (1.5, 1.5, 0), mode="constant", truncate=5 / 1.5)

    mx, my = blur(x), blur(y)
    vx, vy, vxy = blur(x * x) - mx**2, blur(y * y) - my**2, blur(x * y) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    expected = ((2 * mx * my + c1) * (2 * vxy + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))).mean()
    assert float(ssim(torch.tensor(x), torch.tensor(y))) == pytest.approx(expected, abs=1e-12)
    assert float(ssim(torch.tensor(x), torch.tensor(x))) == pytest.approx(1.0)


def test_gradient_of_ssim_is_the_finite_difference() -> None:
    rng = np.random.default_rng(1)
    x, y = (torch.tensor(v) for v in rng.uniform(0, 1, (2, 13, 15, 2)))
    assert torch.autograd.gradcheck(lambda p: 3.0 * ssim(p, y), x.requires_grad_(), eps=1e-6, atol=1e-8)


# --- density control


def _optimiser(values: dict[str, Tensor]) -> torch.optim.Adam:
    groups = [{"params": [torch.nn.Parameter(values[n].clone())], "lr": 0.0, "name": n} for n in PARAMETERS]
    optimiser = torch.optim.Adam(groups)
    sum(p.square().sum() for p in parameters(optimiser).values()).backward()
    optimiser.step()
    return optimiser


def _values(sizes: list[float], alphas: list[float]) -> dict[str, Tensor]:
    n = len(sizes)
    rng = np.random.default_rng(0)
    t = {"means": (n, 3), "rotations": (n, 4), "sh0": (n, 1, 3), "sh_rest": (n, 15, 3)}
    out = {name: torch.tensor(rng.normal(size=shape), dtype=torch.float32) for name, shape in t.items()}
    out["log_scales"] = torch.tensor(sizes).log()[:, None] + torch.tensor([0.0, -1.0, -2.0])
    out["opacities"] = torch.logit(torch.tensor(alphas))
    return out


def _pull(gradients: list[float]) -> GradientStats:
    """As if seen in four views each, with a radius of 5 pixels."""
    return GradientStats(
        torch.tensor(gradients) * 4, torch.full((len(gradients),), 4.0), torch.full((len(gradients),), 5.0)
    )


def test_small_ones_are_cloned_large_ones_split_transparent_ones_removed() -> None:
    #              calm  small  large  transparent  transparent, pulled
    values = _values([0.5, 0.005, 0.05, 0.005, 0.005], [0.5, 0.5, 0.5, 0.001, 0.001])
    optimiser = _optimiser(values)
    before = {name: value.detach().clone() for name, value in parameters(optimiser).items()}
    moments = optimiser.state[parameters(optimiser)["means"]]["exp_avg"].clone()
    pull = densify(optimiser, _pull([0, 1, 1, 0, 1]), DensityControl(gradient=0.5), 1.0, torch.Generator()).pull
    after = parameters(optimiser)
    assert {len(value) for value in after.values()} == {5}  # 0 and 1 stay, a clone of 1, two halves of 2
    assert len(pull.total) == 5
    assert not pull.total.any()
    for name in PARAMETERS:
        torch.testing.assert_close(after[name][:3].detach(), before[name][[0, 1, 1]])
    torch.testing.assert_close(after["log_scales"][3:].detach(), before["log_scales"][[2, 2]] - math.log(1.6))
    assert (after["means"][3] != after["means"][4]).all()
    state = optimiser.state[after["means"]]
    torch.testing.assert_close(state["exp_avg"][:2], moments[:2])
    assert not state["exp_avg"][2:].any()
    assert not state["exp_avg_sq"][2:].any()
    assert len(optimiser.state) == len(PARAMETERS)


def test_halves_are_drawn_from_the_gaussian_that_was_split() -> None:
    """5,000 times the same one, long along its own x: the halves' covariance is R diag(s²) Rᵀ."""
    n = 5000
    half = math.sqrt(0.5)
    values = _values([0.3] * n, [0.5] * n)
    values["means"][:] = torch.tensor([1.0, 2.0, 3.0])
    values["rotations"][:] = 2 * torch.tensor([half, 0.0, 0.0, half])  # about z by 90°: own x is the world's y
    optimiser = _optimiser(values)
    densify(optimiser, _pull([1.0] * n), DensityControl(), 1.0, torch.Generator().manual_seed(0))
    spread = parameters(optimiser)["means"].detach().double().numpy()
    assert spread.shape == (2 * n, 3)
    np.testing.assert_allclose(spread.mean(axis=0), [1, 2, 3], atol=0.01)
    s = 0.3 * np.exp([-1.0, 0.0, -2.0])
    np.testing.assert_allclose(np.cov(spread.T), np.diag(s**2), rtol=0.06, atol=4e-4)


def test_large_ones_are_pruned_after_the_first_reset() -> None:
    """More than 20 pixels on screen, or more than a tenth of the extent: 2 m here, so 0.2 m."""
    sizes = [0.01, 0.01, 0.01, 0.21, 0.19, 0.4, 0.3]  # the last two are split: halves of 0.25 m and of 0.1875 m
    pull = _pull([0, 0, 0, 0, 0, 1, 1])
    pull.radius = torch.tensor([5.0, 20.0, 20.5, 5.0, 5.0, 5.0, 5.0])
    control = DensityControl(gradient=0.5, max_screen=20.0)
    assert control.max_size == 0.1
    for prune, expected in ((True, [0, 1, 4, 6, 6]), (False, [0, 1, 2, 3, 4, 5, 5, 6, 6])):
        optimiser = _optimiser(_values(sizes, [0.5] * 7))
        mark = parameters(optimiser)["sh0"][:, 0, 0].tolist()
        densify(optimiser, pull, control, 2.0, torch.Generator(), prune_large=prune)
        found = [mark.index(value) for value in parameters(optimiser)["sh0"][:, 0, 0].tolist()]
        assert sorted(found) == expected
    optimiser = _optimiser(_values(sizes, [0.5] * 7))
    assert DensityControl().max_screen is None  # the reference's own limit never acts
    densify(optimiser, pull, replace(control, max_screen=None), 2.0, torch.Generator(), prune_large=True)
    assert len(parameters(optimiser)["means"]) == 6


def test_a_clone_of_one_that_is_large_on_screen_stays() -> None:
    """Its own radius has not been seen yet, as in the reference."""
    optimiser = _optimiser(_values([0.005], [0.5]))
    pull = _pull([1.0])
    pull.radius[:] = 30.0
    densify(optimiser, pull, DensityControl(max_screen=20.0), 1.0, torch.Generator(), prune_large=True)
    assert len(parameters(optimiser)["means"]) == 1


def test_there_is_no_cap_unless_one_is_asked_for() -> None:
    assert DensityControl().max_gaussians is None
    assert DensityControl().limited(1).max_gaussians is None
    assert DensityControl(pixels_per_gaussian=20).limited(20_000).max_gaussians == 1_000
    assert DensityControl(max_gaussians=600, pixels_per_gaussian=20).limited(105 * 1008**2).max_gaussians == 600
    optimiser = _optimiser(_values([0.005] * 500, [0.5] * 500))
    done = densify(optimiser, _pull([1.0] * 500), DensityControl(), 1.0, torch.Generator())
    assert (len(parameters(optimiser)["means"]), done.refused) == (1000, 0)


@pytest.mark.parametrize("limit", ["cap", "memory"])
def test_growth_ends_at_the_limit_and_the_strongest_go_first(limit: str) -> None:
    values = _values([0.005] * 4, [0.5] * 4)
    optimiser = _optimiser(values)
    before = parameters(optimiser)["means"].detach().clone()
    control = DensityControl(gradient=0.1, max_gaussians=6 if limit == "cap" else None)
    room = None if limit == "cap" else 2
    done = densify(optimiser, _pull([0.2, 0.9, 0.4, 0.8]), control, 1.0, torch.Generator(), room=room)
    torch.testing.assert_close(parameters(optimiser)["means"].detach(), before[[0, 1, 2, 3, 1, 3]])
    assert done.refused == 2


def test_reset_lowers_opacities_and_forgets_their_moments() -> None:
    optimiser = _optimiser(_values([0.1] * 3, [0.9, 0.5, 0.004]))
    low = parameters(optimiser)["opacities"][2].item()
    reset_opacities(optimiser, 0.01)
    opacities = parameters(optimiser)["opacities"]
    torch.testing.assert_close(opacities.sigmoid()[:2].detach(), torch.tensor([0.01, 0.01]))
    assert opacities[2].item() == low
    assert not optimiser.state[opacities]["exp_avg_sq"].any()


def test_pull_is_measured_in_half_widths_of_the_picture() -> None:
    """As the reference measures it: a gradient per pixel times half the picture's pixels, in views that saw it."""
    means = torch.zeros(2, 2, requires_grad=True)
    means.grad = torch.tensor([[3e-4, 0.0], [0.0, 1e-4]])
    seen, conics = torch.tensor([True, False]), torch.tensor([[0.25, 0.0, 1.0], [0.01, 0.0, 0.01]])
    splat = Splat(torch.zeros(10, 20, 3), torch.zeros(10, 20), means, seen, conics)
    pull = GradientStats.zeros(torch.zeros(2, 3))
    pull.add(splat)
    pull.add(replace(splat, conics=4 * conics))
    torch.testing.assert_close(pull.total, torch.tensor([6e-3, 1e-3]))
    torch.testing.assert_close(pull.count, torch.tensor([2.0, 0.0]))
    # σ is 2 px in the first view and 1 px in the second; what is not visible has no radius.
    torch.testing.assert_close(pull.radius, torch.tensor([6.0, 0.0]))


def test_a_radius_is_three_deviations_along_the_long_axis_with_the_low_pass(room: SimpleNamespace) -> None:
    view = train_views(room.views)[0]
    focal, ahead = view.camera.fx, torch.tensor(view.position + 2 * view.rotation[:, 2], dtype=torch.float32)
    scene = Gaussians(
        ahead[None], torch.log(torch.tensor([[0.1, 0.3, 0.1]])), torch.tensor([[0.9, 0.2, 0.0, 0.1]]),
        torch.zeros(1), torch.zeros(1, 1, 3),
    )  # fmt: skip
    (radius,) = CPU.splat(scene, view, sh_degree=0).radii().tolist()
    turn = rotation_matrices(scene.rotations)[0].double().numpy()
    across = view.rotation[:, :2].T @ turn @ np.diag([0.1, 0.3, 0.1]) * focal / 2
    expected = 3 * math.sqrt(np.linalg.eigvalsh(across @ across.T + 0.3 * np.eye(2))[1])
    assert radius == pytest.approx(expected, rel=1e-5)


# --- schedule


def test_the_reference_schedule() -> None:
    s = TrainingSettings()
    times = [i for i in range(1, 30_001) if s.densifies(i)]
    assert (times[0], times[-1], len(times)) == (600, 14_900, 144)
    assert (s.prunes_large(3_000), s.prunes_large(3_100)) == (False, True)
    assert (s.grows(14_999), s.grows(15_000)) == (True, False)
    d = s.density
    assert (d.gradient, d.size, d.min_opacity, d.reset_opacity) == (0.0002, 0.01, 0.005, 0.01)
    assert [i for i in range(1, 30_001) if s.resets(i)] == [3_000, 6_000, 9_000, 12_000]
    assert s.means_rate(0, 2.0) == pytest.approx(3.2e-4)
    assert s.means_rate(15_000, 2.0) == pytest.approx(3.2e-5)  # the geometric mean
    assert s.means_rate(30_000, 2.0) == pytest.approx(3.2e-6)


def test_a_shorter_run_does_everything_in_proportion_but_not_too_often() -> None:
    s = TrainingSettings(iterations=3_000)
    times = [i for i in range(1, 3_001) if s.densifies(i)]
    assert (times[0], times[-1], times[1] - times[0]) == (60, 1_490, 10)
    assert [i for i in range(1, 3_001) if s.resets(i)] == [1_000]
    assert s.means_rate(3_000, 1.0) == pytest.approx(1.6e-6)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"iterations": 0}, "iterations 0: expected at least 1"),
        ({"sh_degree": 4}, "sh_degree 4: expected 0, 1, 2 or 3"),
        ({"rate_scale": math.inf}, "rate_scale inf: expected a finite number above 0"),
        ({"ssim_weight": 1.5}, "ssim_weight 1.5: expected a share from 0 to 1"),
        ({"densify_every": 0}, "densify_every 0: expected at least 1"),
        ({"density": DensityControl(max_gaussians=1)}, "max_gaussians 1"),
    ],
)
def test_settings_that_mean_nothing_are_named(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        TrainingSettings(**settings)


# --- whole trainings


def _same(a: Gaussians, b: Gaussians) -> bool:
    return all(
        torch.equal(getattr(a, n), getattr(b, n)) for n in ("means", "log_scales", "rotations", "sh", "opacities")
    )


@pytest.mark.slow
def test_training_reaches_a_picture_of_views_it_never_saw(room: SimpleNamespace) -> None:
    """300 iterations: test views gain more than 8 dB, past 22 dB; reports count up and improve."""
    reports: list[TrainingState] = []
    first = train(room.views, room.xyz, room.rgb, CPU, replace(SHORT, iterations=1))
    settings = TrainingSettings(iterations=300, density=DensityControl(pixels_per_gaussian=20))
    trained = train(room.views, room.xyz, room.rgb, CPU, settings, progress=reports.append)
    unseen = test_views(room.views)
    before, after = (np.median(view_psnr(g, unseen, CPU)) for g in (first, trained))
    assert after > before + 8
    assert after > 22
    assert [r.iteration for r in reports] == [100, 200, 300]
    assert reports[-1].psnr > reports[0].psnr + 5
    assert reports[-1].loss < reports[0].loss
    assert len(room.xyz) < reports[-1].gaussians == len(trained) <= 14 * 48 * 48 // 20
    assert not trained.means.requires_grad


@pytest.mark.slow
def test_the_seed_decides_and_nothing_else(room: SimpleNamespace) -> None:
    a, b, c = (train(room.views, room.xyz, room.rgb, CPU, replace(SHORT, seed=seed)) for seed in (0, 0, 1))
    assert _same(a, b)
    assert not (len(a) == len(c) and _same(a, c))


def test_a_resumed_run_is_the_uninterrupted_one(room: SimpleNamespace, tmp_path: Path) -> None:
    """Stopped after 35 of 60 steps, between two densifications; its last checkpoint is of step 27."""
    path = tmp_path / "run/checkpoint.pt"

    class PowerCutError(Exception):
        pass

    def fail(report: TrainingState) -> None:
        if report.iteration == 35:
            raise PowerCutError

    whole = train(room.views, room.xyz, room.rgb, CPU, SHORT)
    with pytest.raises(PowerCutError):
        train(
            room.views, room.xyz, room.rgb, CPU, SHORT,
            checkpoint=Checkpoint(path, 27), progress=fail, pace=Pace(5),
        )  # fmt: skip
    seen: list[int] = []
    resumed = train(
        room.views, room.xyz, room.rgb, CPU, SHORT,
        checkpoint=Checkpoint(path), progress=lambda r: seen.append(r.iteration), pace=Pace(10),
    )  # fmt: skip
    assert seen == [30, 40, 50, 60]
    assert _same(whole, resumed)
    assert [p.name for p in path.parent.iterdir()] == ["checkpoint.pt"]
    again = train(
        room.views,
        room.xyz,
        room.rgb,
        CPU,
        SHORT,
        checkpoint=Checkpoint(path),
        progress=lambda r: seen.append(r.iteration),
    )
    assert _same(whole, again)
    assert len(seen) == 4  # nothing was left to do


@pytest.mark.slow
def test_where_memory_is_nearly_used_growth_ends_and_the_report_says_when(
    room: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    most = len(room.xyz) + 40
    monkeypatch.setattr(training, "room_for", lambda count, device: max(0, most - count))
    reports: list[TrainingState] = []
    settings = replace(SHORT, density=DensityControl())
    trained = train(room.views, room.xyz, room.rgb, CPU, settings, progress=reports.append, pace=Pace(5))
    assert len(trained) <= most
    first = next(report for report in reports if report.full_at is not None)
    assert first.iteration - 5 < first.full_at <= first.iteration
    assert reports[-1].full_at == first.full_at
    capped = replace(SHORT, density=DensityControl(max_gaussians=len(room.xyz) + 20))
    train(room.views, room.xyz, room.rgb, CPU, capped, progress=reports.append)
    assert reports[-1].full_at is None, "the cap ended growth, not memory"


def test_the_room_on_a_device_is_what_is_free_less_what_a_step_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    gib = 2**30
    figures: dict[str, Any] = {
        "mem_get_info": (60 * gib, 100 * gib), "memory_allocated": 4 * gib, "memory_reserved": 8 * gib,
        "max_memory_allocated": 6 * gib,
    }  # fmt: skip
    for name in figures:
        monkeypatch.setattr(torch.cuda, name, lambda *_, name=name: figures[name])
    device = torch.device("cuda:0")
    # Free: 60 and the 4 that the process holds back; a tenth of 100 and 1.25 × 2 for a step are taken off.
    per_gaussian = memory.BYTES + 2.5 * gib / 1_000_000
    assert memory.room_for(1_000_000, device) == int(51.5 * gib / per_gaussian)
    monkeypatch.setitem(memory._PARTS, device, 0.25)  # four trainings on the device
    assert memory.room_for(1_000_000, device) == int((25 - 4 - 2.5 - 2.5) * gib / per_gaussian)
    figures["mem_get_info"] = (gib, 100 * gib)
    assert memory.room_for(1_000_000, device) == 0
    assert memory.room_for(1_000_000, torch.device("cpu")) is None


def test_checkpoints_of_other_runs_and_damaged_ones_are_named(room: SimpleNamespace, tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    brief = replace(SHORT, iterations=3)
    train(room.views, room.xyz, room.rgb, CPU, brief, checkpoint=Checkpoint(path))
    with pytest.raises(Avs3dError, match="made from other pictures, points or settings; delete it"):
        train(room.views, room.xyz, room.rgb, CPU, replace(brief, seed=5), checkpoint=Checkpoint(path))
    whole = path.read_bytes()
    for content in (b"", b"not a checkpoint", whole[: len(whole) // 2]):
        path.write_bytes(content)
        with pytest.raises(Avs3dError, match="damaged checkpoint") as caught:
            train(room.views, room.xyz, room.rgb, CPU, brief, checkpoint=Checkpoint(path))
        assert "\n" not in str(caught.value)


def test_only_train_pictures_are_read(room: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    picture = pictures._picture
    monkeypatch.setattr(pictures, "_picture", lambda view: (read.append(view.name), picture(view))[1])
    train(room.views, room.xyz, room.rgb, CPU, replace(SHORT, iterations=1))
    assert sorted(read) == [view.name for view in train_views(room.views)]


# --- faults


def _with_picture(view: RegisteredView, pixels: np.ndarray) -> RegisteredView:
    frame = SimpleNamespace(undistorted_rgb=lambda: pixels, observation=view.frame.observation, name=view.name)
    return replace(view, frame=frame)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        (np.full((48, 48, 3), np.nan), r"frame_001\.png: float64 \(48, 48, 3\), expected uint8 \(48, 48, 3\)"),
        (np.zeros((32, 48, 3), np.uint8), r"uint8 \(32, 48, 3\), expected uint8 \(48, 48, 3\) as in sparse/0"),
    ],
)
def test_pictures_that_do_not_fit_are_named(room: SimpleNamespace, pixels: np.ndarray, words: str) -> None:
    view = _with_picture(train_views(room.views)[0], pixels)
    with pytest.raises(Avs3dError, match=words):
        load_pictures([view])


def test_no_view_no_points_and_numbers_gone_wild_are_named(room: SimpleNamespace) -> None:
    with pytest.raises(Avs3dError, match="no view to train on"):
        train(test_views(room.views), room.xyz, room.rgb, CPU, SHORT)
    with pytest.raises(Avs3dError, match="0 initial points"):
        train(room.views, room.xyz[:0], room.rgb[:0], CPU, SHORT)

    class Wild(TorchRasteriser):
        def splat(self, *args: Any, **options: Any) -> Splat:
            splat = super().splat(*args, **options)
            return replace(splat, image=splat.image * math.nan)

    with pytest.raises(Avs3dError, match="the loss is nan at iteration 60; lower the learning rates"):
        train(room.views, room.xyz, room.rgb, Wild(), SHORT)


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\nmore"),
        RuntimeError("[enforce fail at alloc_cpu.cpp:118] DefaultCPUAllocator: can't allocate memory"),
        MemoryError(),
    ],
)
def test_out_of_memory_says_what_to_lower(
    room: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    class Full(TorchRasteriser):
        def splat(self, *_: Any, **__: Any) -> Splat:
            raise error

    with pytest.raises(
        Avs3dError, match=r"^out of memory with \d+ Gaussians at 48 × 48: lower --max-gaussians"
    ) as caught:
        train(room.views, room.xyz, room.rgb, Full(), SHORT)
    assert "\n" not in str(caught.value)


def test_other_errors_pass_through(room: SimpleNamespace) -> None:
    class Broken(TorchRasteriser):
        def splat(self, *_: Any, **__: Any) -> Splat:
            raise RuntimeError("a fault of the program")

    with pytest.raises(RuntimeError, match="a fault of the program"):
        train(room.views, room.xyz, room.rgb, Broken(), SHORT)
