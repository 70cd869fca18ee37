"""Rooms and helpers for the tests of the tracer."""

import numpy as np

from generators.acoustics.geometry import SPEED_OF_SOUND, acoustic_mesh
from generators.acoustics.materials import spectral_label
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.early import images_of
from generators.acoustics.tracer.surfaces import surfaces_of
from tests.support.acoustic_rooms import box_scene

SIZE = (6.0, 4.0, 3.0)
VOLUME, SURFACE = 72.0, 108.0
SOURCE = np.array([1.0, 1.2, 1.3])
LISTENER = np.array([4.2, 2.1, 1.9])
#: Not used where the receiver matters.
KHZ = 4


def label(absorption, scattering=0.3):
    """A material whose coefficients are used as they are; numbers stand for all octaves."""
    six = [tuple(np.broadcast_to(np.asarray(value, dtype=float), 6).tolist()) for value in (absorption, scattering)]
    return spectral_label(*six)


def box(absorption=0.2, scattering=0.3, size=SIZE, **kwargs):
    return box_scene(size, label=label(absorption, scattering), **kwargs)


def surfaces(scene, source=SOURCE):
    return surfaces_of(acoustic_mesh(scene, tuple(float(c) for c in source)))


def images(scene, source=SOURCE, order=3):
    found = surfaces(scene, source)
    return found, images_of(found, np.asarray(source, dtype=float), order, 0)


class Omni:
    """A receiver that sums the energies of all octaves in bins of a millisecond."""

    channels = 1
    channel_names = ("omni",)

    def response(self, arrivals, rotation, sample_rate):
        bins = (arrivals.time * 1000).astype(int)
        return np.bincount(bins, np.square(arrivals.pressure).sum(axis=1))[None].astype(np.float32)

    def describe(self):
        return {"receiver": "omni"}


def backend(settings=None, **kwargs):
    return TracerBackend(Omni(), settings, **kwargs)


def diffuse_energy(absorption, volume=VOLUME, surface=SURFACE):
    """Energy of the field after the first reflection: 16π·(1 − α)/(S·α) for a source with p²·r² = 1."""
    return 16 * np.pi * (1 - absorption) / (surface * absorption)


def energies(arrivals, band=KHZ):
    return np.square(arrivals.pressure[:, band], dtype=float)


def decay_time(times, energy, step=0.002):
    """T30 in s from energies at arrival times: Schroeder's integral, −5 to −35 dB."""
    histogram = np.bincount((np.asarray(times) / step).astype(int), energy)
    curve = 10 * np.log10(np.maximum(np.cumsum(histogram[::-1])[::-1], 1e-300) / histogram.sum())
    inside = np.flatnonzero((curve <= -5) & (curve >= -35))
    return -60 / np.polyfit(inside * step, curve[inside], 1)[0]


def without_air(energy, times, band):
    """Energies as they would be without the absorption of the air."""
    from generators.acoustics.tracer.air import energy_exponents

    return energy * np.exp(energy_exponents()[band] * np.asarray(times) * SPEED_OF_SOUND)
