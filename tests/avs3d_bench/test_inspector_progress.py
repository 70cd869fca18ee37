"""What draws for seconds says how far it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from avs3d_bench.dataset import Dataset
from avs3d_bench.inspector.contact_sheet import draw_contact_sheets
from avs3d_bench.inspector.view3d import save_view
from tests.support import tiny
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def data(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=3, size=32)


@pytest.mark.slow
def test_contact_sheets_are_counted_before_each_is_drawn(data: Path, tmp_path: Path) -> None:
    told = []

    def advance(done: int, total: int) -> None:
        told.append((done, total, len(list(tmp_path.glob("*.png")))))

    draw_contact_sheets(data, tmp_path, columns=2, advance=advance)
    assert told == [(0, 2, 0), (1, 2, 1)]


@pytest.mark.slow
def test_a_saved_scene_names_its_steps_and_frames(data: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    told: list[str] = []
    save_view(Dataset(data), tiny.SINGLE, tmp_path / "scene.html", tell=told.append)
    assert told[:2] == ["reading the scene", "building the scene"]
    assert told[2:-1] == [f"recording frame {number} of 3" for number in (1, 2, 3)]
    assert told[-1] == "compressing the recording"
