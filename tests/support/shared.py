"""Datasets that many tests read and none changes: each is made once in a process."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path

#: Takes the options of `tiny.write_dataset` or `tiny_scenes.write_part_3`; returns the folder.
SharedDataset = Callable[..., Path]


class SharedDatasets:
    """Makes a dataset when it is first asked for.

    Args:
        write: takes a folder and options, and returns the folder.
        folder: makes an empty folder.
    """

    def __init__(self, write: Callable[..., Path], folder: Callable[[], Path]) -> None:
        self._write, self._folder = write, folder
        self._made: dict[str, tuple[Path, dict[str, int]]] = {}

    def __call__(self, **options: object) -> Path:
        """The folder of the dataset with these options; a test that changes one takes a copy."""
        bound = inspect.signature(self._write).bind(Path(), **options)
        bound.apply_defaults()
        key = repr(bound.arguments)
        if key not in self._made:
            root = self._write(self._folder() / "tiny", **options)
            self._made[key] = root, _state(root)
        return self._made[key][0]

    def check(self) -> None:
        """Fail if a test has changed a dataset that others read."""
        for root, state in self._made.values():
            now = _state(root)
            changed = sorted(name for name in {*state, *now} if state.get(name) != now.get(name))
            assert not changed, f"a test changed a shared dataset: {changed[:5]}; let it take a copy"


def _state(root: Path) -> dict[str, int]:
    """Name of each file → its time of change (ns)."""
    return {str(path.relative_to(root)): path.stat().st_mtime_ns for path in root.rglob("*") if path.is_file()}
