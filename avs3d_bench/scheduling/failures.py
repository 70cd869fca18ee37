"""failures.jsonl: the tasks that a run has given up, with every attempt; it exists only while there are any.

One JSON object a line: key, seed, and attempts, each with worker, cause, message and traceback. A line is appended the
moment a task is given up, so that nothing is lost when the run is killed.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes, write_bytes
from avs3d_bench.scheduling.tasks import Attempt


class FailureLog:
    """The file in ``root``.

    Args:
        root: folder of the dataset.
        seeds: key → seed of everything that belongs to the dataset; lines about anything else are dropped.
    """

    def __init__(self, root: Path, seeds: Mapping[str, int]) -> None:
        self._path = root / layout.FAILURES_JSONL
        self._seeds = seeds

    def add(self, key: str, attempts: Collection[Attempt]) -> None:
        """Append one; if the disk is full or read-only, only the terminal reports it."""
        line = {"key": key, "seed": self._seeds.get(key), "attempts": [asdict(attempt) for attempt in attempts]}
        with suppress(OSError), self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(line, ensure_ascii=False) + "\n")

    def tidy(self, done: Collection[str]) -> None:
        """Keep the newest line of everything that is not ``done``; remove the file when none is left."""
        lines = {line["key"]: line for line in read_failures(self._path)}
        kept = [line for key, line in sorted(lines.items()) if key in self._seeds and key not in done]
        if not kept:
            self._path.unlink(missing_ok=True)
            return
        write_bytes(self._path, "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in kept).encode())


def read_failures(path: Path) -> list[dict[str, Any]]:
    """Every line of a failures.jsonl that can be read; a process that was killed may have cut off the last one."""
    try:
        text = read_bytes(path).decode("utf-8", "replace")
    except Avs3dError:
        return []
    found = []
    for line in text.splitlines():
        with suppress(ValueError):
            value = json.loads(line)
            if isinstance(value, dict) and isinstance(value.get("key"), str):
                found.append(value)
    return found
