"""The starting kit of a competition: how to begin, a baseline as a notebook, practice data, an example submission."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from avs3d_bench.dataset import Dataset
from avs3d_bench.exports.codabench_files import public_files
from avs3d_bench.exports.codabench_pages import CompetitionFacts, kit_readme, pages
from avs3d_bench.formats.files import read_bytes

#: The listener on practice data, on the test, and packed: from this package, run by the tests.
NOTEBOOK = "listener.ipynb"
README, EXAMPLE, PRACTICE = "README.md", "example", "practice"


def starting_kit(
    facts: CompetitionFacts, example: Mapping[str, bytes], practice: Dataset | None
) -> Iterator[tuple[str, bytes | Path]]:
    """(member, contents) of the starting kit.

    Args:
        facts: on the pages.
        example: a submission, member → contents.
        practice: a dataset with its truth; None: the kit has none.
    """
    yield README, kit_readme(facts).encode()
    for name, text in pages(facts).items():
        yield f"pages/{name}", text.encode()
    yield NOTEBOOK, read_bytes(Path(__file__).parent / NOTEBOOK)
    for name, contents in example.items():
        yield f"{EXAMPLE}/{name}", contents
    if practice is not None:
        for name, path in public_files(practice):
            yield f"{PRACTICE}/{name}", path
