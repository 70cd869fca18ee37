"""Directivities of files with tables: what they say, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators.acoustics.directivity import Directivity, unit_vectors
from generators.acoustics.tracer.arrivals import BANDS

AZIMUTHS, ELEVATIONS = np.arange(-180.0, 180.0, 45.0), np.array([-45.0, 0.0, 45.0])
#: Louder to the right, and the more so the higher the octave: (6, 8, 3).
AMPLITUDES = np.array(
    [
        [[1 + octave * np.sin(np.radians(a)) * np.cos(np.radians(e)) / 8 for e in ELEVATIONS] for a in AZIMUTHS]
        for octave in range(1, 7)
    ]
)
HEADER = "azimuth,elevation,125,250,500,1000,2000,4000"


def rows() -> list[str]:
    return [
        f"{a},{e}," + ",".join(repr(float(value)) for value in AMPLITUDES[:, i, j])
        for i, a in enumerate(AZIMUTHS)
        for j, e in enumerate(ELEVATIONS)
    ]


def written(folder: Path, lines: list[str]) -> Path:
    path = folder / "speaker.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_csv_and_npz_in_any_order_are_the_table_of_python(tmp_path: Path) -> None:
    expected = Directivity.table(AMPLITUDES, AZIMUTHS, ELEVATIONS)
    shuffled = [rows()[i] for i in np.random.default_rng(0).permutation(len(rows()))]
    of_csv = Directivity.file(written(tmp_path, ["# a speaker", HEADER, "", *shuffled]))
    arrays = {"amplitudes": AMPLITUDES, "azimuths": AZIMUTHS, "elevations": ELEVATIONS}
    np.savez(tmp_path / "speaker.npz", **arrays)
    directions = np.random.default_rng(1).normal(size=(50, 3))
    for found in (of_csv, Directivity.file(tmp_path / "speaker.npz")):
        np.testing.assert_allclose(found.amplitudes(directions), expected.amplitudes(directions), rtol=1e-12)
    right = unit_vectors(np.array([90.0]), np.array([0.0]))
    assert of_csv.amplitudes(right)[0, BANDS.index(4000)] == pytest.approx(1 + 6 / 8)
    assert of_csv.name.startswith("table speaker.csv, sha256 ")


def test_the_name_tells_files_of_one_name_apart(tmp_path: Path) -> None:
    first = Directivity.file(written(tmp_path, [HEADER, *rows()])).name
    assert Directivity.file(written(tmp_path, [HEADER, *rows(), "# changed"])).name != first


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "header is '', expected azimuth,elevation,125"),
        (["angle,125", "0,1"], "header is 'angle,125'"),
        ([HEADER], "has no rows"),
        ([HEADER, *rows()[:-1]], "azimuth 135° has 2 elevations, -180° has 3"),
        ([HEADER, *rows(), rows()[0]], "azimuth -180°, elevation -45° is listed 2 times"),
        ([HEADER, "0,0,1,1,1"], "line 2 has 5 cells, expected 8"),
        ([HEADER, "0,0,1,1,1,1,1,loud"], "line 2 has 'loud', expected a finite number"),
        ([HEADER, "0,0,1,1,1,1,1,nan"], "line 2 has 'nan', expected a finite number"),
        ([HEADER.replace("250", "300"), *rows()], "octave 250 Hz is missing"),
        ([HEADER.replace("125", "125.5"), *rows()], "octave 125 Hz is missing"),
        ([HEADER, *rows()[:3]], "azimuths from -180° to -180° leave a gap"),
    ],
)
def test_a_wrong_csv_is_one_line_with_the_file(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(Avs3dError, match=message) as caught:
        Directivity.file(written(tmp_path, lines))
    assert str(caught.value).startswith(str(tmp_path / "speaker.csv"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"azimuths": AZIMUTHS}, "has no array amplitudes"),
        ({"amplitudes": AMPLITUDES[:2], "azimuths": AZIMUTHS, "elevations": ELEVATIONS}, "have shape"),
        ({"amplitudes": np.array([None]), "azimuths": AZIMUTHS, "elevations": ELEVATIONS}, "no NPZ file of numbers"),
        (
            {
                "amplitudes": AMPLITUDES,
                "azimuths": AZIMUTHS,
                "elevations": ELEVATIONS,
                "frequencies": np.full(6, np.nan),
            },
            "frequencies have NaN",
        ),
        ({"amplitudes": AMPLITUDES * np.nan, "azimuths": AZIMUTHS, "elevations": ELEVATIONS}, "NaN or infinite"),
    ],
)
def test_a_wrong_npz_is_one_line_with_the_file(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(Avs3dError, match=message) as caught:
        Directivity.file(tmp_path / "a.npz")
    assert str(caught.value).startswith(str(tmp_path / "a.npz"))


def test_a_packed_npz_with_changed_bytes_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, amplitudes=AMPLITUDES, azimuths=AZIMUTHS, elevations=ELEVATIONS)
    whole = path.read_bytes()
    for place in range(72, 232, 8):  # of the first array
        path.write_bytes(whole[:place] + b"\xff" * 8 + whole[place + 8 :])
        with pytest.raises(Avs3dError, match="no NPZ file of numbers") as caught:
            Directivity.file(path)
        assert "\n" not in str(caught.value)


def test_what_is_no_table_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"PK nonsense")
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    for name, message in (("a.npz", "no NPZ file"), ("a.csv", "no UTF-8 text"), ("b.csv", "missing")):
        with pytest.raises(Avs3dError, match=message):
            Directivity.file(tmp_path / name)
