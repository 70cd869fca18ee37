"""The direction map: how well each pixel's direction explains what the two ears heard.

Camera and ears share their pose, and two ears tell the lateral angle alone: the angle between a direction and the
median plane. So for a grid of lateral angles the sound is held against what a spherical head would hear from there, and
every pixel looks up the value of its own lateral angle:

- below 1.6 kHz, by the *steered response* of each group of frequencies: the generalised cross-correlation with
  phase transform (Knapp & Carter, "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP
  24 (1976) 320-327) at the delay of the angle, (a/c)(φ + sin φ) (Woodworth, *Experimental Psychology*, Holt 1938);
- up to 3 kHz, by the *votes* of the bins that follow an onset, since direct sound arrives before its reflections (the
  precedence effect: Blauert, *Spatial Hearing*, MIT Press 1997, §3.1): each bin votes for the angles whose phase it
  has, by a von Mises density, so that bins with the phase of a reflection do little harm;
- above 1.6 kHz, by the *level difference*: the likelihood of the measured one given that of the head-shadow filter of
  Brown & Duda ("A structural model for binaural sound synthesis", IEEE Trans. SAP 6 (1998) 476-488, equations 1 and 3).

Lateral angles are radians, 0 ahead and positive to the right. Silence gives 0 everywhere.
"""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from scipy.special import ive
from torch import Tensor
from torch.nn.functional import conv1d

from avs3d_bench.contract.layout import SAMPLE_RATE
from baselines.listener.features import FLOOR_DB, HOP, WINDOW, Spectra, decibels, frequencies

#: Radius of the head (m) and speed of sound (m/s).
HEAD_RADIUS, SPEED_OF_SOUND = 0.0875, 343.0
#: Lateral angles of the grid: −90° to 90° in steps of 3°.
ANGLES = 61
#: Edges of the groups of frequencies (Hz): by phase, by votes of onsets, by level difference.
PHASE_GROUPS = (100.0, 350.0, 700.0, 1100.0, 1600.0)
VOTE_GROUPS = (150.0, 700.0, 1500.0, 3000.0)
LEVEL_GROUPS = (1600.0, 3000.0, 6000.0, 12_000.0)
#: Spread of the level difference around the model's (dB): reverberation, and heads that are no spheres.
LEVEL_SPREAD_DB = 4.0
#: Concentration of a vote around the phase of an angle.
CONCENTRATION = 5.0
#: A bin is an onset if it has this many times the mean power of its past, which is forgotten in this time (s).
ONSET, MEMORY = 2.0, 0.05
#: Weight of a bin that is no onset, so that a steady sound votes as well.
STEADY = 0.02
#: Channels of the map: phase groups and their mean, vote groups, their mean and that relative to its spread over the
#: angles, level groups.
CHANNELS = len(PHASE_GROUPS) + len(VOTE_GROUPS) + 1 + len(LEVEL_GROUPS) - 1
#: Coefficients of the Fourier series of a vote; what is left out is below 1e-5.
_HARMONICS = [(1 if n == 0 else 2) * float(ive(n, CONCENTRATION)) for n in range(13)]
#: Least incidence of Brown & Duda's α, and the angle at which it is reached.
_LEAST_ALPHA, _LEAST_AT = 0.1, math.radians(150.0)


def angle_grid(device: torch.device | None = None) -> Tensor:
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

    Phase groups lie between −1 and 1 (1: every bin of every window has the phase of that angle), votes and level groups
    between 0 and 1. In phase and level groups windows count by the root of their energy, so that pauses between bursts
    do not matter.
    """
    phases = torch.stack(_phase_groups(both), dim=1)
    votes = torch.stack(_vote_groups(both), dim=1)
    vote = votes.mean(dim=1, keepdim=True)
    relative = (vote - vote.mean(dim=-1, keepdim=True)) / (vote.std(dim=-1, keepdim=True) + 0.01)
    levels = torch.stack(_level_groups(both), dim=1)
    return torch.cat([phases, phases.mean(dim=1, keepdim=True), votes, vote, relative, levels], dim=1)


def _bins(low: float, high: float) -> slice:
    """The bins from a frequency up to another (Hz); a mask of the same would make the host wait for the device."""
    return slice(math.ceil(low * WINDOW / SAMPLE_RATE), math.ceil(high * WINDOW / SAMPLE_RATE))


def _phase_groups(both: Spectra) -> list[Tensor]:
    """(B, ANGLES) of each group: the mean over bins of the cosine of the phase that is left at each angle's delay."""
    at, angles = frequencies(both.left.device), angle_grid(both.left.device)
    out = []
    for low, high in pairwise(PHASE_GROUPS):
        chosen = _bins(low, high)
        cross = both.left[:, chosen] * both.right[:, chosen].conj()
        magnitude = cross.abs()
        weight = _window_weights(magnitude.sum(dim=1))
        phase = (cross / magnitude.clamp(min=1e-20) * weight[:, None]).sum(dim=-1)
        turn = 2 * math.pi * at[chosen, None] * woodworth_delay(angles)
        out.append(torch.real(phase @ torch.polar(torch.ones_like(turn), turn)) / len(turn))
    return out


def _vote_groups(both: Spectra) -> list[Tensor]:
    """(B, ANGLES) of each group: the mean vote of its bins, onsets first."""
    at, angles = frequencies(both.left.device), angle_grid(both.left.device)
    out = []
    for low, high in pairwise(VOTE_GROUPS):
        chosen = _bins(low, high)
        left, right = both.left[:, chosen], both.right[:, chosen]
        cross = left * right.conj()
        power = left.abs().square() + right.abs().square()
        # The fourth root: loud bins count more, but no tone outvotes all others.
        weight = (onset_weights(power) * power.sqrt().sqrt()).flatten(1)
        weight = weight / (weight.sum(dim=1, keepdim=True) + 10 ** (FLOOR_DB / 20))
        turn = 2 * math.pi * at[chosen, None] * woodworth_delay(angles)
        out.append(_votes(cross, weight.view_as(power), turn))
    return out


def _votes(cross: Tensor, weight: Tensor, turn: Tensor) -> Tensor:
    """(B, ANGLES): Σ weight · exp(κ (cos(phase of cross + turn) − 1)) over bins and windows, κ = `CONCENTRATION`.

    The density is taken as its Fourier series, Σ aₙ cos(n x) with aₙ = (2 − δ₀ₙ) e^−κ Iₙ(κ) (Mardia & Jupp,
    *Directional Statistics*, Wiley 2000, eq. 3.5.17): windows are added up before angles are looked at.

    Args:
        cross: (B, F, T) complex.
        weight: (B, F, T).
        turn: (F, ANGLES) phase of each angle, by which each bin is turned back.
    """
    magnitude = cross.abs()
    unit = torch.where(magnitude > 0, cross / magnitude.clamp(min=1e-30), torch.ones_like(cross))
    power: Tensor = weight.to(cross.dtype)
    out = _HARMONICS[0] * weight.sum(dim=(1, 2))[:, None].expand(-1, turn.shape[1])
    for number, share in enumerate(_HARMONICS[1:], start=1):
        power = power * unit
        turned = torch.polar(torch.full_like(turn, share), number * turn)
        out = out + torch.real(power.sum(dim=-1) @ turned)
    return out


def _level_groups(both: Spectra) -> list[Tensor]:
    """(B, ANGLES) of each group: the likelihood of its level difference."""
    angles = angle_grid(both.left.device)
    out = []
    for low, high in pairwise(LEVEL_GROUPS):
        chosen = _bins(low, high)
        powers = [ear[:, chosen].abs().square().sum(dim=1) for ear in (both.left, both.right)]
        weight = _window_weights(torch.sqrt(powers[0] * powers[1]))
        measured = ((decibels(powers[1]) - decibels(powers[0])) * weight).sum(dim=-1)
        expected = head_shadow_db(angles, torch.full_like(angles, math.sqrt(low * high)))
        likelihood = torch.exp(-0.5 * ((measured[:, None] - expected) / LEVEL_SPREAD_DB).square())
        out.append(likelihood * weight.sum(dim=-1, keepdim=True))
    return out


def onset_weights(power: Tensor) -> Tensor:
    """(B, F, T) 1 where a bin is an onset, else `STEADY`, from powers of the same shape."""
    forget = math.exp(-HOP / SAMPLE_RATE / MEMORY)
    length = math.ceil(5 * MEMORY * SAMPLE_RATE / HOP)
    kernel = (1 - forget) * forget ** torch.arange(length - 1, -1, -1, device=power.device)
    # Before the clip its first window goes on: the beginning of a clip is no onset.
    longer = torch.cat([power[..., :1].expand(*power.shape[:-1], length), power[..., :-1]], dim=-1)
    past = conv1d(longer.flatten(0, 1)[:, None], kernel[None, None] / kernel.sum())[:, 0]
    return torch.where(power > ONSET * past.view_as(power), 1.0, STEADY)


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
    return found.reshape(*found.shape[:2], *angles.shape[1:])
