"""Boxes with one acoustic material, for the acoustic tests."""

import numpy as np

from generators.acoustics import materials
from generators.acoustics.materials import AcousticMaterial
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Room, Scene


def with_absorption(monkeypatch, alpha):
    """Give the label ``uniform`` the absorption ``alpha`` in situ in all octaves."""
    table = 1 - (1 - alpha) / (1 - materials.RESIDUAL)
    uniform = AcousticMaterial("uniform", (table,) * 6, (0.3,) * 6, "test")
    monkeypatch.setitem(materials.MATERIALS, "uniform", uniform)


def box_scene(size, *, label="uniform", extra=()):
    """A box of ``size`` metres from the origin, one room called kitchen."""
    builder = MeshBuilder()
    builder.box(size, np.asarray(size) / 2, Material("wall", label), acoustic="exact")
    parts = (Part("shell", builder.build()), *extra)
    return Scene("box", parts, (Room("kitchen", (0.0, 0.0, 0.0), tuple(float(s) for s in size)),), ())


def solid(name, size, centre, *, label="wood", instance_id=0):
    """A solid box standing in the room."""
    builder = MeshBuilder()
    builder.box(size, centre, Material(name, label), acoustic="exact")
    return Part(name, builder.build(), instance_id=instance_id)
