"""Work in several processes: results, errors, and a bar that moves with the parts of an item."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime import parallel
from avs3d_bench.runtime.parallel import advance, process_each


def square_by_parts(item: int) -> int:
    for part in range(item):
        advance(part + 1, item)
    return item * item


def wait_half_way(item: tuple[Path, int]) -> None:
    """Say that half is done, and go on when the folder holds a file of this name."""
    import time

    folder, number = item
    advance(1, 2)
    (folder / f"half-{number}").touch()
    while not (folder / "go").exists():
        time.sleep(0.01)


def half(item: int) -> None:
    advance(item, 2)
    if item == 2:
        raise Avs3dError("no more")


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the bar shows, in order."""
    seen: list[float] = []

    class Bar(parallel._Bar):
        def __init__(self, label: str, total: int, shown: bool) -> None:
            super().__init__(label, total, False)

        def set(self, done: float) -> None:
            super().set(done)
            seen.append(done)

    monkeypatch.setattr(parallel, "_Bar", Bar)
    return seen


def test_the_bar_moves_with_the_parts_of_an_item(shown: list[float]) -> None:
    found = list(process_each(square_by_parts, [4, 2], workers=1, progress=True, sizes=[8, 1]))
    assert found == [(4, 16), (2, 4)]
    assert shown == pytest.approx([2, 4, 6, 8, 8.5, 9])


def test_an_item_that_says_nothing_counts_when_it_is_done(shown: list[float]) -> None:
    assert dict(process_each(abs, [-1, -2], workers=1, progress=True, sizes=[3, 5])) == {-1: 1, -2: 2}
    assert shown == [3, 8]


def test_processes_move_the_bar_while_they_work(shown: list[float], tmp_path: Path) -> None:
    items = [(tmp_path, 1), (tmp_path, 2)]

    def watch(bar_set: Any) -> Any:
        def seen(self: Any, done: float) -> None:
            bar_set(self, done)
            if done == 6:  # both are half done, and neither ends before this was shown
                (tmp_path / "go").touch()

        return seen

    bar = parallel._Bar
    bar.set = watch(bar.set)  # type: ignore[method-assign]
    assert len(list(process_each(wait_half_way, items, workers=2, progress=True, sizes=[4, 8]))) == 2
    assert {2.0, 4.0, 6.0} & set(shown)
    assert shown == sorted(shown)


def test_results_of_processes_are_the_same_without_a_bar() -> None:
    assert dict(process_each(square_by_parts, [3, 1, 2], workers=2)) == {3: 9, 1: 1, 2: 4}


def test_what_work_raises_passes_and_the_next_run_starts_anew(shown: list[float]) -> None:
    with pytest.raises(Avs3dError, match="no more"):
        list(process_each(half, [1, 2], workers=1, progress=True))
    assert shown == [0.5, 1.0, 2.0]
    advance(1, 2)  # outside of an item: nothing
    assert shown == [0.5, 1.0, 2.0]


def test_sizes_belong_to_items() -> None:
    with pytest.raises(ValueError, match="shorter"):
        list(process_each(abs, [1, 2], sizes=[1]))
