"""The direction map: how well each pixel's direction explains what the two ears heard.

Camera and ears share their pose, and two ears tell the lateral angle alone: the angle between a direction and the
median plane. So for a grid of lateral angles the sound is held against what a spherical head would hear from there, and
every pixel looks up the value of its own lateral angle:

- below `PHASE_LIMIT`, by the *steered response* of each group of frequencies: the generalised cross-correlation with
  phase transform (Knapp & Carter, "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP
  24 (1976) 320-327) at the delay of the angle, (a/c)(φ + sin φ) (Woodworth, *Experimental Psychology*, Holt 1938);
- above, by the *level difference*: the likelihood of the measured one given that of the head-shadow filter of Brown &
  Duda ("A structural model for binaural sound synthesis", IEEE Trans. SAP 6 (1998) 476-488, equations 1 and 3).

Lateral angles are radians, 0 ahead and positive to the right. Silence gives 0 everywhere.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from baselines.listener.features import FLOOR_DB, Spectra, decibels, frequencies

#: Radius of the head (m) and speed of sound (m/s).
HEAD_RADIUS, SPEED_OF_SOUND = 0.0875, 343.0
#: Lateral angles of the grid: −90° to 90° in steps of 3°.
ANGLES = 61
#: Above this the phase difference is ambiguous and head shadow is large (Hz).
PHASE_LIMIT = 1600.0
#: Edges of the groups of frequencies (Hz): first by phase, the rest by level difference.
PHASE_GROUPS = (100.0, 350.0, 700.0, 1100.0, 1600.0)
LEVEL_GROUPS = (1600.0, 3000.0, 6000.0, 12_000.0)
#: Spread of the level difference around the model's (dB): reverberation, and heads that are no spheres.
LEVEL_SPREAD_DB = 4.0
#: Channels of the map: the groups, and the mean of all phase groups.
CHANNELS = len(PHASE_GROUPS) - 1 + len(LEVEL_GROUPS) - 1 + 1
#: Least incidence of Brown & Duda's α, and the angle at which it is reached.
_LEAST_ALPHA, _LEAST_AT = 0.1, math.radians(150.0)


def angle_grid(device: Any = None) -> Tensor:
    """(ANGLES,) lateral angles."""
    return torch.linspace(-math.pi / 2, math.pi / 2, ANGLES, device=device)


def woodworth_delay(lateral: Tensor) -> Tensor:
    """Seconds by which the left ear hears a far source at a lateral angle later than the right one."""
    return HEAD_RADIUS / SPEED_OF_SOUND * (lateral + torch.sin(lateral))


def head_shadow_db(lateral: Tensor, frequency: Tensor) -> Tensor:
    """Level right minus level left of a far source, by the head-shadow filter; dB, in the broadcast shape."""

    def gain(incidence: Tensor) -> Tensor:
        least = _LEAST_ALPHA / 2
        alpha = 1 + least + (1 - least) * torch.cos(incidence / _LEAST_AT * math.pi)
        ratio = math.pi * HEAD_RADIUS / SPEED_OF_SOUND * frequency  # ω / 2ω0 with ω0 = c / a
        return (1 + (alpha * ratio).square()) / (1 + ratio.square())

    return 10 * torch.log10(gain(math.pi / 2 - lateral) / gain(math.pi / 2 + lateral))


def steered_response(both: Spectra) -> Tensor:
    """(B, CHANNELS, ANGLES) float32: how well each lateral angle explains the sound, group by group.

    Phase groups lie between −1 and 1 (1: every bin of every window has the phase of that angle), level groups between
    0 and 1. Windows count by the root of their energy, so that pauses between bursts do not matter.
    """
    device = both.left.device
    at, angles = frequencies(device), angle_grid(device)
    cross = both.cross
    magnitude = cross.abs()
    transform = cross / magnitude.clamp(min=1e-20)
    out = []
    for low, high in pairwise(PHASE_GROUPS):
        chosen = (at >= low) & (at < high)
        weight = _window_weights(magnitude[:, chosen].sum(dim=1))
        phase = (transform[:, chosen] * weight[:, None]).sum(dim=-1)  # (B, f)
        turn = torch.polar(torch.ones(1, device=device), 2 * math.pi * at[chosen, None] * woodworth_delay(angles))
        out.append(torch.real(phase @ turn) / int(chosen.sum()))
    out.append(torch.stack(out).mean(dim=0))
    for low, high in pairwise(LEVEL_GROUPS):
        chosen = (at >= low) & (at < high)
        powers = [ear[:, chosen].abs().square().sum(dim=1) for ear in (both.left, both.right)]
        weight = _window_weights(torch.sqrt(powers[0] * powers[1]))
        measured = ((decibels(powers[1]) - decibels(powers[0])) * weight).sum(dim=-1)
        expected = head_shadow_db(angles, torch.tensor(math.sqrt(low * high), device=device))
        likelihood = torch.exp(-0.5 * ((measured[:, None] - expected) / LEVEL_SPREAD_DB).square())
        out.append(likelihood * weight.sum(dim=-1, keepdim=True))
    return torch.stack(out, dim=1)


def _window_weights(power: Tensor) -> Tensor:
    """(B, T) weights of windows, with sum 1; with sum near 0 where all are silent."""
    root = torch.sqrt(power)
    return root / (root.sum(dim=-1, keepdim=True) + 10 ** (FLOOR_DB / 20))


def pixel_angles(camera: Tensor, size: tuple[int, int]) -> Tensor:
    """(B, h, w) lateral angles of the cells of a picture that is cut into h × w cells.

    Args:
        camera: (B, 4) fx, fy, cx, cy as shares of the picture's width (x) and height (y).
        size: (h, w).
    """
    height, width = size
    fx, fy, cx, cy = camera.float().T[..., None, None]
    across = (torch.arange(width, device=camera.device) + 0.5) / width
    down = (torch.arange(height, device=camera.device) + 0.5) / height
    x, y = (across - cx) / fx, ((down[:, None] - cy) / fy)
    return torch.asin(x / torch.sqrt(x.square() + y.square() + 1))


def direction_map(response: Tensor, angles: Tensor) -> Tensor:
    """(B, CHANNELS, h, w): the response at the lateral angle of every cell, linear between the angles of the grid.

    Args:
        response: (B, CHANNELS, ANGLES), of `steered_response`.
        angles: (B, h, w), of `pixel_angles`.
    """
    place = (angles.flatten(1) / math.pi + 0.5) * (ANGLES - 1)
    below = place.floor().clamp(0, ANGLES - 2)
    share = (place - below)[:, None]
    index = below.long()[:, None].expand(-1, response.shape[1], -1)
    found = response.gather(2, index) * (1 - share) + response.gather(2, index + 1) * share
    return found.unflatten(-1, angles.shape[1:])
