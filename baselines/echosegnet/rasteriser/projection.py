"""Gaussians in the image plane: EWA projection and spherical harmonics, in plain torch."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from baselines.echosegnet.gaussians import SH_C0, Gaussians
from baselines.echosegnet.rasteriser.rendering import BLUR, MIN_ALPHA, NEAR, Camera

#: The affine approximation is taken no further out than this many half fields of view beyond the image's edge.
MARGIN = 0.3


@dataclass(frozen=True, eq=False)
class Projected:
    """N Gaussians in the image.

    Attributes:
        means: (N, 2) pixels (column, row), continuous.
        conics: (N, 3) inverse covariance (xx, xy, yy), 1/px².
        depths: (N,) z along the optical axis, metres.
        variances: (N, 2) of column and row, px².
        visible: (N,) bool: in front of the camera and reaching α ≥ 1/255 somewhere in the image.
    """

    means: Tensor
    conics: Tensor
    depths: Tensor
    variances: Tensor
    visible: Tensor


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """(N, 3, 3) rotations of quaternions (N, 4) wxyz of any norm above 0."""
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=-1).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).reshape(-1, 3, 3)


def project(gaussians: Gaussians, camera: Camera) -> Projected:
    """Project Gaussians (Zwicker et al. 2002, EWA volume splatting, eq. 24–31)."""
    rotation, shift = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    x, y, z = (gaussians.means @ rotation.T + shift).unbind(-1)
    in_front = z > NEAR
    # What is not drawn still passes through the arithmetic: a depth of 1 keeps it, and its gradients, finite.
    safe = torch.where(in_front, z, torch.ones_like(z))
    u, v = x / safe, y / safe
    half_x, half_y = 0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy
    low_x, high_x = -camera.cx / camera.fx, (camera.width - camera.cx) / camera.fx
    low_y, high_y = -camera.cy / camera.fy, (camera.height - camera.cy) / camera.fy
    edge_u = u.clamp(low_x - MARGIN * half_x, high_x + MARGIN * half_x)
    edge_v = v.clamp(low_y - MARGIN * half_y, high_y + MARGIN * half_y)
    zero = torch.zeros_like(safe)
    jacobian = torch.stack(
        [camera.fx / safe, zero, -camera.fx * edge_u / safe, zero, camera.fy / safe, -camera.fy * edge_v / safe], dim=-1
    ).reshape(-1, 2, 3)
    axes = rotation @ rotation_matrices(gaussians.rotations) * gaussians.scales[:, None, :]
    spread = jacobian @ axes  # (N, 2, 3): a square root of the covariance in the image
    xx = (spread[:, 0] * spread[:, 0]).sum(-1) + BLUR
    xy = (spread[:, 0] * spread[:, 1]).sum(-1)
    yy = (spread[:, 1] * spread[:, 1]).sum(-1) + BLUR
    determinant = (xx * yy - xy * xy).clamp(min=1e-10)
    means = torch.stack([camera.fx * u + camera.cx, camera.fy * v + camera.cy], dim=-1)
    variances = torch.stack([xx, yy], dim=-1)
    with torch.no_grad():
        reach = footprint(gaussians.alphas)[:, None] * variances.sqrt()
        limits = means.new_tensor([camera.width, camera.height])
        visible = in_front & (gaussians.alphas >= MIN_ALPHA)
        visible &= ((means + reach > 0) & (means - reach < limits)).all(dim=-1)
    return Projected(means, torch.stack([yy, -xy, xx], dim=-1) / determinant[:, None], z, variances, visible)


def footprint(alphas: Tensor) -> Tensor:
    """(N,) standard deviations out to which a Gaussian of that opacity reaches 1/255."""
    return (2.0 * (alphas / MIN_ALPHA).clamp(min=1.0).log()).sqrt()


def colours(gaussians: Gaussians, camera: Camera, degree: int) -> Tensor:
    """(N, 3) RGB ≥ 0 as seen from the camera: spherical harmonics up to ``degree`` plus 0.5."""
    degree = min(degree, gaussians.sh_degree)
    if degree == 0:
        return (SH_C0 * gaussians.sh[:, 0] + 0.5).clamp(min=0.0)
    directions = torch.nn.functional.normalize(gaussians.means - camera.centre, dim=-1)
    basis = harmonics(directions, degree)
    return ((basis[:, :, None] * gaussians.sh[:, : basis.shape[1]]).sum(dim=1) + 0.5).clamp(min=0.0)


def harmonics(directions: Tensor, degree: int) -> Tensor:
    """(N, (degree + 1)²) real spherical harmonics of unit vectors (N, 3), in the order and signs of 3D-GS.

    Band l in the order m = −l … l with the Condon–Shortley phase (Sloan 2013, "Efficient spherical harmonic
    evaluation").
    """
    x, y, z = directions.unbind(-1)
    out = [torch.full_like(x, SH_C0)]
    if degree > 0:
        out += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree > 1:
        out += [
            1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (3 * z * z - 1),
            -1.0925484305920792 * x * z, 0.5462742152960396 * (x * x - y * y),
        ]  # fmt: skip
    if degree > 2:
        out += [
            -0.5900435899266435 * y * (3 * x * x - y * y), 2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5 * z * z - 1), 0.3731763325901154 * z * (5 * z * z - 3),
            -0.4570457994644658 * x * (5 * z * z - 1), 1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]  # fmt: skip
    return torch.stack(out, dim=-1)
