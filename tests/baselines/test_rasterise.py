"""The rasteriser in plain torch against closed forms, a brute-force composition and finite differences.

Where there is a CUDA device, gsplat is held to it.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Intrinsics
from baselines.echosegnet.gaussians import SH_C0, Gaussians
from baselines.echosegnet.rasteriser import compositing, projection
from baselines.echosegnet.rasteriser.default import GsplatRasteriser, TorchRasteriser, contributions, default_rasteriser
from baselines.echosegnet.rasteriser.rendering import BLUR, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, Camera
from baselines.echosegnet.views import RegisteredView

torch.set_num_threads(1)
SIZE = 33  # odd, so that the axis passes through a pixel's centre
R = TorchRasteriser()


def _view(
    size: int = SIZE, position: tuple[float, float, float] = (0, 0, 0), rotation: object = None
) -> RegisteredView:
    camera = Intrinsics(size, size, size / 2, size / 2, size / 2, size / 2)
    turn = np.eye(3) if rotation is None else np.asarray(rotation)
    return RegisteredView("frame_001", "train", camera, turn, np.array(position, dtype=float), None)  # type: ignore[arg-type]


def _logit(p: float) -> float:
    return math.log(p / (1 - p))


def _make(rows: list[dict], dtype: torch.dtype = torch.float64) -> Gaussians:
    """Gaussians from rows of mean, scale (number or three), alpha, rgb, rotation."""
    sh = torch.zeros(len(rows), 16, 3, dtype=dtype)
    for i, row in enumerate(rows):
        sh[i, 0] = (torch.tensor(row.get("rgb", (1.0, 1.0, 1.0)), dtype=dtype) - 0.5) / SH_C0
    return Gaussians(
        torch.tensor([row["mean"] for row in rows], dtype=dtype),
        torch.tensor([np.broadcast_to(np.log(row.get("scale", 0.1)), 3).tolist() for row in rows], dtype=dtype),
        torch.tensor([row.get("rotation", (1.0, 0.0, 0.0, 0.0)) for row in rows], dtype=dtype),
        torch.tensor([_logit(row.get("alpha", 0.8)) for row in rows], dtype=dtype),
        sh,
    )


def _random(count: int, seed: int = 0, dtype: torch.dtype = torch.float64, scale: float = 0.12) -> Gaussians:
    rng = np.random.default_rng(seed)

    def t(values: np.ndarray) -> Tensor:
        return torch.tensor(values, dtype=dtype)

    depth = rng.uniform(1.0, 4.0, count)
    xy = rng.uniform(-1.1, 1.1, (count, 2)) * depth[:, None]
    return Gaussians(
        t(np.column_stack([xy, depth])),
        t(np.log(scale) + 0.5 * rng.normal(size=(count, 3))),
        t(rng.normal(size=(count, 4))),
        t(rng.normal(0.5, 1.5, count)),
        t(0.4 * rng.normal(size=(count, 16, 3))),
    )


def _brute_force(gaussians: Gaussians, view: RegisteredView, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Pixel by pixel, Gaussian by Gaussian: image (H, W, C), alpha (H, W), weights (H, W, N). Loops only."""
    camera = Camera.of(view, gaussians.means)
    p = projection.project(gaussians, camera)
    order = sorted(range(len(gaussians)), key=lambda i: float(p.depths[i]))
    weights = torch.zeros(camera.height, camera.width, len(gaussians), dtype=torch.float64)
    for row in range(camera.height):
        for column in range(camera.width):
            through = 1.0
            for i in order:
                if not p.visible[i]:
                    continue
                dx, dy = float(p.means[i, 0]) - column - 0.5, float(p.means[i, 1]) - row - 0.5
                a, b, c = p.conics[i].tolist()
                sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
                alpha = min(MAX_ALPHA, float(gaussians.alphas[i]) * math.exp(-sigma))
                if alpha < MIN_ALPHA:
                    continue
                if through * (1 - alpha) <= MIN_TRANSMITTANCE:
                    break
                weights[row, column, i] = through * alpha
                through *= 1 - alpha
    return weights @ features, weights.sum(-1), weights


# --- closed forms


def test_one_isotropic_gaussian_on_the_axis() -> None:
    """α(r) = opacity · exp(−r² / 2s²) with s² = (f·scale/z)² + 0.3 px²; outside α < 1/255 exactly nothing."""
    depth, scale, opacity = 2.0, 0.25, 0.7
    alpha = R.render(_make([{"mean": (0, 0, depth), "scale": scale, "alpha": opacity}]), _view()).alpha.numpy()
    middle = SIZE // 2
    assert alpha[middle, middle] == pytest.approx(opacity, rel=1e-12)
    s2 = (SIZE / 2 * scale / depth) ** 2 + BLUR
    v, u = np.mgrid[:SIZE, :SIZE] - middle
    expected = opacity * np.exp(-(u**2 + v**2) / (2 * s2))
    np.testing.assert_allclose(alpha, np.where(expected >= MIN_ALPHA, expected, 0.0), atol=1e-12)


def test_a_long_gaussian_lies_along_its_turned_axis() -> None:
    """Long along x, turned by 90° about the optical axis: its variances in the image change places."""
    half = math.sqrt(0.5)
    turned = _make([{"mean": (0, 0, 2), "scale": (0.4, 0.05, 0.05), "rotation": (half, 0, 0, half)}])
    camera = Camera.of(_view(), turned.means)
    variances = projection.project(turned, camera).variances[0].numpy()
    focal = SIZE / 2 / 2.0
    np.testing.assert_allclose(variances, [(0.05 * focal) ** 2 + BLUR, (0.4 * focal) ** 2 + BLUR], rtol=1e-12)


def test_pixel_centres_lie_at_a_half() -> None:
    """A point that projects to (10.5, 20.5) peaks in column 10, row 20."""
    x, y = ((10.5 - SIZE / 2) / (SIZE / 2), (20.5 - SIZE / 2) / (SIZE / 2))
    alpha = R.render(_make([{"mean": (2 * x, 2 * y, 2.0), "scale": 0.02}]), _view()).alpha
    assert divmod(int(alpha.argmax()), SIZE) == (20, 10)
    np.testing.assert_allclose(alpha[20, 9], alpha[20, 11], rtol=1e-12)


def test_the_nearer_one_hides_the_farther_whatever_their_order() -> None:
    red = {"mean": (0, 0, 1.5), "scale": 0.3, "alpha": 0.6, "rgb": (1, 0, 0)}
    blue = {"mean": (0, 0, 3.0), "scale": 0.6, "alpha": 0.9, "rgb": (0, 0, 1)}
    middle = SIZE // 2
    for rows in ([red, blue], [blue, red]):
        r = R.render(_make(rows), _view(), background=torch.ones(3))
        left = 0.4 * 0.1
        expected = [0.6 + left, left, 0.4 * 0.9 + left]
        np.testing.assert_allclose(r.rgb[middle, middle].numpy(), expected, rtol=1e-9)
        assert float(r.alpha[middle, middle]) == pytest.approx(1 - left)
        depth = (0.6 * 1.5 + 0.36 * 3.0) / 0.96
        assert float(r.depth[middle, middle]) == pytest.approx(depth)


def test_alpha_is_capped_and_a_pixel_ends_before_its_transmittance_does() -> None:
    """Three walls of opacity ~1: 0.999 of light stops at the first; the second would leave 1e-6, so it is not drawn."""
    rows = [{"mean": (0, 0, z), "scale": 1.0, "alpha": 1 - 1e-9} for z in (1.0, 2.0, 3.0)]
    alpha = R.render(_make(rows), _view()).alpha
    assert float(alpha[SIZE // 2, SIZE // 2]) == pytest.approx(MAX_ALPHA, rel=1e-12)


def test_what_is_behind_or_at_the_lens_is_not_drawn() -> None:
    for z in (-2.0, 0.0, 0.01):
        assert not R.render(_make([{"mean": (0, 0, z), "scale": 0.3}]), _view()).alpha.any()


def test_empty_scenes_are_black() -> None:
    none = _random(3).select(torch.zeros(3, dtype=torch.bool))
    r = R.render(none, _view(), background=torch.tensor([0.2, 0.3, 0.4]))
    np.testing.assert_allclose(r.rgb[4, 4].numpy(), [0.2, 0.3, 0.4])
    assert not r.alpha.any()
    assert not r.depth.any()
    assert contributions(R, none, _view(), torch.ones(SIZE, SIZE)).shape == (0,)


def test_moving_the_camera_is_moving_the_world() -> None:
    angle = 0.3
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    position = np.array([0.2, -0.1, -0.4])
    scene = _random(20, seed=4)
    camera_frame = Gaussians(
        (scene.means - torch.tensor(position)) @ torch.tensor(turn),
        scene.log_scales,
        _compose([math.cos(angle / 2), 0, -math.sin(angle / 2), 0], scene.rotations),
        scene.opacities,
        scene.sh,
    )
    moved = R.render(scene, _view(position=tuple(position), rotation=turn), sh_degree=0)
    still = R.render(camera_frame, _view(), sh_degree=0)
    np.testing.assert_allclose(moved.rgb.numpy(), still.rgb.numpy(), atol=1e-10)


def _compose(first: list[float], second: Tensor) -> Tensor:
    w, x, y, z = first
    matrix = torch.tensor([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]], dtype=second.dtype)
    return second @ matrix.T


def test_size_scales_the_picture_about_its_edges() -> None:
    scene = _make([{"mean": (0.3, -0.2, 2.0), "scale": 0.3}])
    small, large = (R.render(scene, _view(32), size=(n, n)).alpha for n in (32, 64))
    for axis in (0, 1):
        centres = [float((a.sum(1 - axis) * (torch.arange(len(a)) + 0.5)).sum() / a.sum()) for a in (small, large)]
        assert centres[1] == pytest.approx(2 * centres[0], rel=2e-3)


# --- spherical harmonics


def test_spherical_harmonics_are_orthonormal() -> None:
    """Gauss–Legendre × uniform quadrature is exact up to degree 6."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    phi = np.arange(16) * 2 * np.pi / 16
    z, p = np.meshgrid(nodes, phi, indexing="ij")
    s = np.sqrt(1 - z**2)
    directions = torch.tensor(np.stack([s * np.cos(p), s * np.sin(p), z], axis=-1).reshape(-1, 3))
    basis = projection.harmonics(directions, 3).numpy()
    area = np.repeat(weights, 16) * 2 * np.pi / 16
    np.testing.assert_allclose((basis * area[:, None]).T @ basis, np.eye(16), atol=1e-12)


def test_bands_above_the_degree_are_left_out() -> None:
    scene = _random(10)
    flat = Gaussians(scene.means, scene.log_scales, scene.rotations, scene.opacities, scene.sh[:, :4])
    np.testing.assert_array_equal(R.render(scene, _view(), sh_degree=1).rgb, R.render(flat, _view(), sh_degree=3).rgb)
    assert (R.render(scene, _view(), sh_degree=0).rgb - R.render(scene, _view(), sh_degree=3).rgb).abs().max() > 0.01


# --- against brute force


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_composition_is_the_brute_force_one(seed: int) -> None:
    scene, view = _random(60, seed, scale=0.4), _view(24)
    features = torch.tensor(np.random.default_rng(seed).normal(size=(60, 5)))
    image, alpha, weights = _brute_force(scene, view, features)
    splat = R.splat(scene, view, features=features)
    np.testing.assert_allclose(splat.image.numpy(), image.numpy(), atol=1e-9)
    np.testing.assert_allclose(splat.alpha.numpy(), alpha.numpy(), atol=1e-9)
    assert splat.visible.numpy()[weights.sum((0, 1)).numpy() > 0].all()
    assert (weights > 0).sum() > 2000  # the scene is no trivial one


def test_what_lies_behind_the_end_of_a_pixel_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forty opaque layers: most pairs come too late. Packing them away changes neither picture nor gradient."""
    rng = np.random.default_rng(0)
    rows = [
        {"mean": (*rng.uniform(-0.5, 0.5, 2), z), "scale": 1.5 * z, "alpha": 0.9, "rgb": rng.uniform(0, 1, 3).tolist()}
        for z in np.linspace(1.0, 4.0, 40)
    ]
    scene, view = _make(rows), _view(16)
    image, alpha, weights = _brute_force(scene, view, scene.sh[:, 0])
    splat = R.splat(scene, view, features=scene.sh[:, 0])
    np.testing.assert_allclose(splat.image.numpy(), image.numpy(), atol=1e-9)
    np.testing.assert_allclose(splat.alpha.numpy(), alpha.numpy(), atol=1e-9)
    assert float((weights > 0).double().mean()) < 0.5
    gradients = []
    for share in (2.0, 0.0):  # always, never
        monkeypatch.setattr(compositing, "_WORTH_PACKING", share)
        means = scene.means.clone().requires_grad_()
        moved = Gaussians(means, scene.log_scales, scene.rotations, scene.opacities, scene.sh)
        R.render(moved, view).rgb.square().sum().backward()
        gradients.append(means.grad)
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-10, atol=1e-12)
    assert gradients[0].abs().max() > 0.1


def test_contributions_are_the_brute_force_sums() -> None:
    scene, view = _random(40, 3, scale=0.3), _view(24)
    rng = np.random.default_rng(0)
    votes = torch.tensor(rng.uniform(0, 1, (24, 24, 2)))
    _, alpha, weights = _brute_force(scene, view, torch.zeros(40, 1, dtype=torch.float64))
    both = contributions(R, scene, view, votes)
    np.testing.assert_allclose(both.numpy(), torch.einsum("hwn,hwc->nc", weights, votes).numpy(), atol=1e-9)
    one = contributions(R, scene, view, votes[..., 0])
    np.testing.assert_allclose(one.numpy(), both[:, 0].numpy(), atol=1e-12)
    assert float(contributions(R, scene, view, torch.ones(24, 24)).sum()) == pytest.approx(float(alpha.sum()))
    with pytest.raises(Avs3dError, match=r"weights have shape \(24,\)"):
        contributions(R, scene, view, torch.ones(24))


def test_contributions_leave_no_gradient_and_work_without_grad_mode() -> None:
    scene = _random(5)
    scene.means.requires_grad_()
    with torch.no_grad():
        sums = contributions(R, scene, _view(), torch.ones(SIZE, SIZE))
    assert not sums.requires_grad
    assert scene.means.grad is None


def test_bands_of_rows_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, view = _random(80, 5, scale=0.3), _view(40)

    def draw() -> tuple[Tensor, Tensor]:
        means = scene.means.clone().requires_grad_()
        moved = Gaussians(means, scene.log_scales, scene.rotations, scene.opacities, scene.sh)
        r = R.render(moved, view)
        (r.rgb.square().sum() + r.depth.sum()).backward()
        assert means.grad is not None
        return r.rgb.detach(), means.grad

    whole = draw()
    monkeypatch.setattr(compositing, "PAIRS_PER_BAND", 500)
    for a, b in zip(whole, draw(), strict=True):
        np.testing.assert_allclose(a.numpy(), b.numpy(), rtol=1e-9, atol=1e-9)


def test_single_precision_is_close_and_runs_agree_to_the_bit() -> None:
    scene = _random(500, 6)
    narrow = Gaussians(*(getattr(scene, n).float() for n in ("means", "log_scales", "rotations", "opacities", "sh")))
    first, again = (R.render(narrow, _view(64)) for _ in range(2))
    np.testing.assert_array_equal(first.rgb, again.rgb)
    exact = R.render(scene, _view(64)).rgb
    # A pair at the threshold of 1/255 may fall on either side.
    assert float((first.rgb - exact).abs().median()) < 1e-5
    assert float((first.rgb - exact).abs().max()) < 2.5 / 255


# --- gradients


@pytest.mark.slow
@pytest.mark.parametrize("group", ["means", "log_scales", "rotations", "opacities", "sh"])
def test_gradients_are_the_finite_differences(group: str) -> None:
    """Central differences in float64, through colour, alpha and depth with random weights."""
    scene, view = _random(8, seed=7, scale=0.35), _view(14)
    rng = np.random.default_rng(2)
    w_rgb, w_alpha, w_depth = (torch.tensor(rng.normal(size=s)) for s in ((14, 14, 3), (14, 14), (14, 14)))
    names = ("means", "log_scales", "rotations", "opacities", "sh")

    def loss(value: Tensor) -> Tensor:
        r = R.render(Gaussians(**{n: value if n == group else getattr(scene, n) for n in names}), view)
        return (r.rgb * w_rgb).sum() + (r.alpha * w_alpha).sum() + 0.1 * (r.depth * w_depth * (r.alpha > 0.05)).sum()

    assert torch.autograd.gradcheck(
        loss, getattr(scene, group).clone().requires_grad_(), eps=1e-7, atol=2e-5, rtol=1e-4
    )


def test_gradient_of_features_and_of_projected_centres() -> None:
    scene, view = _random(8, seed=9, scale=0.35), _view(14)
    features = torch.tensor(np.random.default_rng(3).normal(size=(8, 2)), requires_grad=True)
    weights = torch.tensor(np.random.default_rng(4).normal(size=(14, 14, 2)))
    assert torch.autograd.gradcheck(
        lambda f: (R.splat(scene, view, features=f).image * weights).sum(), features, eps=1e-6, atol=1e-6
    )
    # Moving a centre sideways moves its projection by f/z: the gradients differ by just that, the shape kept.
    means = scene.means.clone().requires_grad_()
    flat = Gaussians(means, torch.full_like(scene.log_scales, -9.0), scene.rotations, scene.opacities, scene.sh)
    splat = R.splat(flat, view, sh_degree=0)
    splat.means2d.retain_grad()
    (splat.image * weights[..., :1]).sum().backward()
    assert means.grad is not None
    assert splat.means2d.grad is not None
    by_centre = splat.means2d.grad * 7.0 / flat.means[:, 2:].detach()
    np.testing.assert_allclose(means.grad[:, :2].numpy(), by_centre.numpy(), rtol=1e-4, atol=1e-5)


def test_what_is_not_drawn_has_finite_zero_gradients() -> None:
    rows = [{"mean": m, "scale": 0.3} for m in ((0, 0, 2.0), (0, 0, -1.0), (50.0, 0, 1.0), (0, 0, 0.0))]
    scene = _make(rows)
    parts = [getattr(scene, n).requires_grad_() for n in ("means", "log_scales", "rotations", "opacities", "sh")]
    R.render(scene, _view()).rgb.sum().backward()
    for part in parts:
        assert part.grad is not None
        assert torch.isfinite(part.grad).all()
        assert not part.grad[1:].any()


# --- choosing


def test_devices_that_are_not_there_are_named() -> None:
    assert isinstance(default_rasteriser("cpu"), TorchRasteriser)
    with pytest.raises(UsageError, match=r"expected e\.g\. cpu"):
        default_rasteriser("gpu0")
    with pytest.raises(UsageError, match="CUDA devices; use --device cpu"):
        default_rasteriser("cuda:99")
    with pytest.raises(Avs3dError, match="gsplat draws on CUDA"):
        GsplatRasteriser("cpu")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device: gsplat is compared on a GPU machine")
@pytest.mark.parametrize("seed", [0, 1])
def test_gsplat_draws_the_same(seed: int) -> None:
    scene = _random(2000, seed, dtype=torch.float32, scale=0.05)
    out = []
    for rasteriser in (TorchRasteriser("cuda"), GsplatRasteriser("cuda")):
        names = ("means", "log_scales", "rotations", "opacities", "sh")
        parts = {n: getattr(scene, n).cuda().requires_grad_() for n in names}
        r = rasteriser.render(Gaussians(**parts), _view(96))
        (r.rgb.square().sum() + 0.1 * r.depth.sum()).backward()
        out.append([r.rgb, r.alpha, r.depth, *(p.grad for p in parts.values())])
    for a, b in zip(*out, strict=True):
        assert float((a - b).norm() / a.norm()) < 2e-3
