"""A running viewer, for tests."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from avs3d_bench.dataset import Dataset
from avs3d_bench.inspector.server import ViewServer
from avs3d_bench.inspector.submissions import ShownSubmission


@contextmanager
def served(root: Path, submissions: tuple[ShownSubmission, ...] = ()) -> Iterator[ViewServer]:
    dataset = Dataset(root)
    with ViewServer(dataset, dataset.keys, submissions, port=0) as server:
        thread = threading.Thread(target=server.serve)
        thread.start()
        try:
            yield server
        finally:
            server.stop()
            thread.join()
