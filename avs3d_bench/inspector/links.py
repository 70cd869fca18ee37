"""Only files inside the dataset or submission are shown: a symbolic link that leads out of it is an error.

Otherwise a link in the place of a frame could show a private file of the person who views the dataset. Hard
links and links within the root are plain parts of a dataset, and the root itself may be a link.
"""

from __future__ import annotations

import os
from pathlib import Path

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError

#: What the pages are made of, relative to an observation.
_FILES = (layout.OBSERVATION_JSON, layout.SPLITS_JSON)
_FOLDERS = (
    layout.INPUT,
    layout.IMAGES,
    layout.SEMANTIC_MASKS,
    layout.INSTANCE_MASKS,
    layout.BINAURAL,
    layout.clips_folder(layout.AMBISONICS),
    layout.COLMAP,
)


def check_link(path: Path, root: Path, what: str = "the dataset") -> None:
    """Refuse a path that leads out of ``root``, whichever of its folders is the link.

    Raises:
        Avs3dError: naming it.
    """
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(root)):
        raise Avs3dError(
            f"{path}: a symbolic link that leads out of {what}; expected a file inside of it: put a copy in its place"
        )


def check_links(observation: Path, root: Path) -> None:
    """Refuse an observation with a link out of the dataset ``root`` among the files that its page shows.

    Raises:
        Avs3dError: naming the first.
    """
    check_link(observation, root)
    stems = observation / layout.STEMS
    for name in (*_FILES, layout.STEMS):
        _check_child(observation / name, root)
    for folder in (*(observation / name for name in _FOLDERS), *sorted(stems.glob("*"))):
        if folder.parent in (observation, stems):
            _check_child(folder, root)
        else:
            check_link(folder, root)
        try:
            with os.scandir(folder) as entries:
                links = sorted(entry.path for entry in entries if entry.is_symlink())
        except OSError:  # missing, or no folder: its reader reports that
            continue
        for link in links:
            check_link(Path(link), root)


def _check_child(path: Path, root: Path) -> None:
    """The same as `check_link` for what lies in a folder that has been checked: only a link leads out of it."""
    if path.is_symlink():
        check_link(path, root)
