"""The acoustic materials and the material file of the engine."""

import json

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators.acoustics.materials import (
    DEFAULT_MATERIAL,
    MATERIALS,
    OCTAVE_BANDS,
    RESIDUAL,
    AcousticMaterial,
    material_for,
    mean_absorption,
    triangle_areas,
    write_engine_json,
)

LABELS = (
    *("plaster", "concrete", "brick", "wood", "parquet", "tile", "ceramic", "glass", "metal", "plastic", "fabric"),
    *("carpet", "curtain", "upholstery", "foliage", "paper", "water", "clutter"),
)
UNIT_SQUARE = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 1]], [[0, 0, 0], [1, 0, 1], [0, 0, 1]]], dtype=float)


def test_every_label_of_the_scenes_has_a_material():
    assert sorted(MATERIALS) == sorted(LABELS)


def test_soft_materials_absorb_more_than_hard_ones_above_500_hz():
    hard = max(MATERIALS[label].absorption[4] for label in ("plaster", "concrete", "tile", "ceramic", "metal", "glass"))
    soft = min(MATERIALS[label].absorption[4] for label in ("fabric", "carpet", "curtain", "upholstery"))
    assert soft > 2 * hard


def test_unknown_label_gets_the_documented_default():
    assert material_for("kryptonite") is DEFAULT_MATERIAL
    assert material_for(" Tile ") is MATERIALS["tile"]
    assert DEFAULT_MATERIAL.absorption == (0.1,) * 6


def test_no_label_is_part_of_another():
    """The engine matches a mesh's category by substring: `tile` would catch `textile`."""
    labels = [*LABELS, DEFAULT_MATERIAL.label]
    assert [(a, b) for a in labels for b in labels if a != b and a in b] == []


def test_residual_absorption_is_what_survives_the_surface():
    assert MATERIALS["tile"].in_situ[0] == pytest.approx(1 - 0.99 * (1 - RESIDUAL))
    assert AcousticMaterial("x", (1.0,) * 6, (0.1,) * 6, "all absorbed").in_situ == (1.0,) * 6


@pytest.mark.parametrize("bad", [(0.1,) * 5, (0.1,) * 5 + (1.2,), (-0.1,) + (0.1,) * 5, (float("nan"),) * 6])
def test_absorption_outside_its_range_is_refused(bad):
    with pytest.raises(Avs3dError, match=r"absorption .* expected 6 numbers in \[0, 1\]"):
        AcousticMaterial("x", bad, (0.1,) * 6, "")


def test_engine_file_has_every_key_and_no_transmission(tmp_path):
    write_engine_json(tmp_path / "materials.json")
    materials = json.loads((tmp_path / "materials.json").read_text())["materials"]
    assert len(materials) == len(LABELS) + 1
    keys = {"name", "labels", "absorption", "scattering", "transmission", "damping", "density", "speed"}
    for material in materials:
        assert set(material) == keys
        assert material["absorption"][::2] == list(OCTAVE_BANDS)
        assert material["transmission"][1::2] == [0.0] * 6
        assert material["absorption"][1::2] == list(material_for(material["name"]).in_situ)


def test_mean_absorption_weighs_by_area():
    triangles = np.concatenate([UNIT_SQUARE, 2 * UNIT_SQUARE])
    assert triangle_areas(triangles) == pytest.approx([0.5, 0.5, 2, 2])
    mean = mean_absorption(triangles, ("carpet", "carpet", "tile", "tile"))
    expected = np.array(MATERIALS["carpet"].in_situ) / 5 + np.array(MATERIALS["tile"].in_situ) * 4 / 5
    assert mean == pytest.approx(expected)
    assert mean_absorption(np.zeros((0, 3, 3)), ()) == pytest.approx(DEFAULT_MATERIAL.in_situ)
