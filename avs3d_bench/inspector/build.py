"""The site on disk: every page and every file it shows, in a folder that can be opened or served from anywhere."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

from avs3d_bench import __version__
from avs3d_bench.commands.outputs import Signature, check_replaceable
from avs3d_bench.contract import layout
from avs3d_bench.contract.layout import parse_key
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import link_or_copy, sha256_file, write_bytes, write_json
from avs3d_bench.formats.staging import staged_folder
from avs3d_bench.inspector.cards import GalleryCard
from avs3d_bench.inspector.facts import few
from avs3d_bench.inspector.pages import PageOf, gallery_page, observation_page, problem_page, sibling_script
from avs3d_bench.inspector.site import (
    PAGE,
    SCENE,
    SCRIPTS,
    SOUND,
    STYLES,
    DamagedError,
    ObservationSite,
    static_asset,
)
from avs3d_bench.inspector.submissions import ShownSubmission
from avs3d_bench.runtime.parallel import advance, process_each

#: Marks a folder as ours, so that it may be replaced.
MARKER = "avs3d-view.json"
_MARKED = Signature(keys=("made_by", "dataset"))
_OWN = re.compile(
    rf"{re.escape(MARKER)}|index\.html|assets/[a-z]+\.(js|css)|"
    r"part_[123]/[^/]+/[^/]+/[0-9]+/(index\.html|thumbnail\.webp|floor\.png|sound\.flac|scene\.js|ambisonics\.js|"
    r"stems/(source_[0-9]+|background)\.js|"
    r"(frames|masks|instances|predictions/[1-9])/frame_[0-9]+\.(webp|png))"
)


@dataclass(frozen=True)
class Built:
    """The pages and files that were written.

    Attributes:
        folder: the site.
        pages: observations with a page.
        size: bytes of all files.
        problems: one line for each file or observation that could not be shown.
    """

    folder: Path
    pages: int
    size: int
    problems: tuple[str, ...]


@dataclass(frozen=True)
class _Task:
    root: Path
    key: str
    before: str | None
    after: str | None
    keys: tuple[str, ...]
    submissions: tuple[ShownSubmission, ...]
    folder: Path


def build_site(
    dataset: Dataset,
    keys: Sequence[str],
    submissions: tuple[ShownSubmission, ...],
    folder: str | Path,
    *,
    workers: int | None = None,
    progress: bool = False,
) -> Built:
    """Write the site into ``folder``, as a whole or not at all; an older site there is replaced.

    What cannot be read is left out, with a line on the page and in the result.

    Raises:
        UsageError: if ``folder`` lies in the dataset or a submission (or around one), or holds anything but a site.
        Avs3dError: if the system refuses, or no observation can be shown.
    """
    sources = [dataset.root, *(submission.root for submission in submissions)]
    with staged_folder(folder, lambda final: _check_target(final, Path(folder), sources)) as fresh:
        neighbours = zip([None, *keys[:-1]], keys, [*keys[1:], None], strict=True)
        tasks = [
            _Task(dataset.root, key, before, after, tuple(keys), submissions, fresh)
            for before, key, after in neighbours
        ]
        rooms = [tuple(group) for _, group in groupby(tasks, _room_of_siblings)]
        sizes = [sum(len(dataset[task.key]) for task in room) for room in rooms]
        made = process_each(_build_room, rooms, workers=workers, label="frames", progress=progress, sizes=sizes)
        done = {task: built for room, each in made for task, built in zip(room, each, strict=True)}
        cards = [done[task][0] for task in tasks]
        problems = tuple(line for task in tasks for line in done[task][1])
        shown = sum(card.problem is None for card in cards)
        if not shown:
            first = problems[0] if problems else "no observations"
            raise Avs3dError(f"{dataset.root}: nothing to show: {first}")
        write_bytes(fresh / PAGE, gallery_page(dataset, cards, [submission.name for submission in submissions]))
        for name in (*SCRIPTS, *STYLES):
            write_bytes(fresh / "assets" / name, static_asset(name))
        write_json(fresh / MARKER, {"made_by": f"avs3d-bench {__version__}", "dataset": dataset.name})
        size = sum(path.stat().st_size for path in fresh.rglob("*") if path.is_file())
    return Built(Path(folder), shown, size, problems)


def _room_of_siblings(task: _Task) -> str:
    """The same for observations that may share their pictures, which one process makes: siblings are of one room."""
    return task.key.rpartition("/")[0] if parse_key(task.key).is_part_3 else task.key


def _build_room(tasks: tuple[_Task, ...]) -> list[tuple[GalleryCard, tuple[str, ...]]]:
    """Write the files and pages of observations that may share pictures (in a worker process)."""
    frames: dict[str, Path] = {}
    built = []
    for number, task in enumerate(tasks):
        built.append(_build_observation(task, frames, partial(_reach, number, len(tasks))))
    return built


def _reach(number: int, tasks: int, done: int, files: int) -> None:
    """So many files of the observation ``number`` of a room are done."""
    advance(number * files + done, tasks * files)


def _build_observation(
    task: _Task, frames: dict[str, Path], reach: Callable[[int, int], None]
) -> tuple[GalleryCard, tuple[str, ...]]:
    """Write one observation's files and page; ``frames``: sha256 of a picture → the file that shows it."""
    site = ObservationSite(Dataset(task.root), task.key, task.submissions, task.keys)
    card = site.card()
    if card.problem is None:
        try:
            with site.reading():
                names = list(site.names())
            problems = _write_files(site, names, task.folder / task.key, frames, reach)
            with site.reading():
                shown = PageOf(site, task.before, task.after, linked=False, problems=tuple(problems))
                page = observation_page(shown)
                if site.facts.lanes is not None:
                    write_bytes(task.folder / task.key / SCENE, sibling_script(shown))
                problems = few(site.observation, [*problems, *site.mask_problems, *site.stem_problems])
        except DamagedError as error:
            card = GalleryCard(site.observation.place, problem=site.without_paths(str(error)))
    if card.problem is not None:
        page = problem_page(task.key, card.problem, before=task.before, after=task.after)
        problems = [f"{task.root / task.key}: {card.problem}"]
    write_bytes(task.folder / task.key / PAGE, page)
    return card, tuple(problems)


def _write_files(
    site: ObservationSite,
    names: Sequence[str],
    folder: Path,
    frames: dict[str, Path],
    reach: Callable[[int, int], None],
) -> list[str]:
    """Write what the page shows; one line for each file that cannot be made.

    A frame whose picture has the bytes of a sibling's is the sibling's: encoding one takes most of the time.
    """
    problems = [*site.facts.problems]
    for number, name in enumerate(names):
        reach(number, len(names))
        try:
            with site.reading():
                picture = _shared_picture(site, name)
                digest = None if picture is None else sha256_file(picture)
                data = b"" if digest in frames else site.make(name)
        except Avs3dError as error:
            problems.append(str(error))
            continue
        if digest in frames:
            link_or_copy(frames[digest], folder / name)
        else:
            write_bytes(folder / name, data)
        if digest is not None:
            frames.setdefault(digest, folder / name)
        if name == SOUND:
            problems += site.track.problems
    return problems


def _shared_picture(site: ObservationSite, name: str) -> Path | None:
    """The picture of which the file ``name`` is made, where siblings may share it."""
    if site.facts.lanes is None or not name.startswith("frames/"):
        return None
    picture = site.observation.path / layout.INPUT / f"{Path(name).stem}.png"
    return picture if picture.is_file() else None


def _check_target(final: Path, named: Path, sources: Sequence[Path]) -> None:
    """Raise an error for a folder that this program has not written."""
    for source in sources:
        root = source.resolve()
        if final.is_relative_to(root) or root.is_relative_to(final):
            how = "inside of" if final.is_relative_to(root) else "around"
            raise UsageError(f"{named}: lies {how} {source}; choose another folder")
    if not final.exists():
        return
    if not final.is_dir():
        raise UsageError(f"{named}: found a file, expected a folder; choose another name")
    if not any(final.iterdir()):
        return
    if not (final / MARKER).is_file():
        raise UsageError(f"{named}: not empty and no site of avs3d view; choose another folder")
    check_replaceable(final / MARKER, (_MARKED,))
    # The old folder is deleted: only one that this program has written.
    files = (path.relative_to(final).as_posix() for path in sorted(final.rglob("*")) if not path.is_dir())
    foreign = next((name for name in files if not _OWN.fullmatch(name)), None)
    if foreign is not None:
        raise UsageError(f"{named}: cannot replace the site: {foreign} is no part of it; move it away")
