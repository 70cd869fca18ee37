"""A competition bundle for Codabench: the truth, the scoring program, the leaderboard, the pages, the starting kit.

    write_codabench("sealed/public", "sealed/private", "bundle.zip", Settings(title=…, docker_image=…, start=…, …))

The reference data hold what scoring reads and nothing else: the truth of the test frames, the records, the splits, and
a black picture in place of each test picture, whose name and size are all that scoring needs of it. The same trees and
settings give the same bytes. `avs3d_bench.exports.codabench_format` has the platform's rules; a bundle that breaks one
is never left under its name.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import yaml

from avs3d_bench import __version__
from avs3d_bench.commands.outputs import check_apart, check_replaceable
from avs3d_bench.contract.competition import (
    DECIMALS,
    MAIN_FIGURES,
    MAIN_WITHOUT_TWINS,
    Column,
    CompetitionTask,
    columns_of,
    task_protocols,
)
from avs3d_bench.dataset import Dataset, Observation, by_pictures
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.codabench_files import (
    Archive,
    check_practice,
    check_truth,
    example_submission,
    public_files,
    reference_files,
    require_no_truth,
    scoring_program,
)
from avs3d_bench.exports.codabench_format import BUNDLE_YAML, MOST_IMAGE, MOST_TITLE, PICTURES, check_bundle
from avs3d_bench.exports.codabench_kit import starting_kit
from avs3d_bench.exports.codabench_pages import INSTALL, CompetitionFacts, logo, pages, terms
from avs3d_bench.exports.signatures import BUNDLE
from avs3d_bench.formats.files import atomic_path, read_bytes
from avs3d_bench.measures.pair_kinds import pair_kind

#: Masks that the evaluator scores in a second, at least, on one core (docs/competition.md has the measurement).
_MASKS_PER_SECOND = 20
#: The platform's default time limit of a run (s).
_LEAST_LIMIT = 600
_STARTING_KIT, _SOLUTION, _REFERENCE, _DATA = (
    "starting_kit.zip", "example_submission.zip", "reference_data.zip", "public_data.zip"
)  # fmt: skip


@dataclass(frozen=True)
class CompetitionSettings:
    """Choices of the organiser.

    Attributes:
        title: of the competition.
        docker_image: name:tag of the evaluator's image, as the platform's workers pull it.
        start: when the first phase starts (UTC).
        end: when the last phase ends (UTC); None: never.
        development: shell patterns of the observations of a first phase, which the final phase does not score.
        final_start: when the final phase starts (UTC); with ``development`` only. The first one ends a second before.
        data_url: address of the public data; None: they are in the bundle.
        contact: e-mail address of the organisers.
        max_per_day: submissions of a participant a day, in every phase.
        max_submissions: submissions of a participant in the last phase.
        image: picture file of the competition; None: one is drawn.
        terms: Markdown file with the terms; None: a general text.
        approval: whether the organisers admit each participant; else all who register are admitted.
        practice: root of a dataset with its truth, of other homes, which the starting kit holds; None: none.
        install: how participants install this toolkit, as the pages say it.
    """

    title: str
    docker_image: str
    start: datetime
    end: datetime | None = None
    development: tuple[str, ...] = ()
    final_start: datetime | None = None
    data_url: str | None = None
    contact: str | None = None
    max_per_day: int = 5
    max_submissions: int = 100
    image: Path | None = None
    terms: Path | None = None
    approval: bool = False
    practice: Path | None = None
    install: str = INSTALL


@dataclass(frozen=True)
class Phase:
    """One phase and its task.

    Attributes:
        name: on the pages.
        observations: keys of those that it scores.
        masks: their number of test frames.
        start: UTC.
        end: UTC; None: never.
        max_submissions: of a participant.
    """

    name: str
    observations: tuple[str, ...]
    masks: int
    start: datetime
    end: datetime | None
    max_submissions: int


@dataclass(frozen=True)
class Written:
    """Files that `write_codabench` wrote.

    Attributes:
        phases: in order.
        columns: of the leaderboard.
        size: bytes of the bundle.
    """

    phases: tuple[Phase, ...]
    columns: tuple[Column, ...]
    size: int


def has_twins(truth: Dataset, keys: Sequence[str]) -> bool:
    """Whether some pair of siblings among the observations is one of twins; then twins rank."""
    found = (one for one in (truth[key] for key in keys) if one.is_part_3)
    groups = ([one.record for one in some if one.record] for some in by_pictures(found).values())
    return any(pair_kind(*pair) == "twins" for records in groups for pair in combinations(records, 2))


def write_codabench(
    public: str | Path, private: str | Path, output: str | Path, settings: CompetitionSettings
) -> Written:
    """Write a competition bundle in Codabench's format (version 2).

    Args:
        public: root of what participants get: pictures, sound, poses, splits; no truth of a test frame.
        private: root with the truth of the same observations.
        output: the bundle's file.
        settings: the organiser's decisions.

    Raises:
        UsageError: if a setting makes no sense, one of the roots is no dataset, or ``output`` is another file.
        Avs3dError: if ``public`` holds truth, ``private`` lacks some, or a file is damaged.

    Examples:
        >>> import shutil
        >>> from datetime import datetime
        >>> # The truth; `avs3d seal` takes it out of a new test.
        >>> truth = ("semantic_masks", "instance_masks", "gt_3d", "observation.json")
        >>> public = shutil.copytree("data/demo", "public", ignore=shutil.ignore_patterns(*truth), dirs_exist_ok=True)
        >>> from avs3d_bench.exports.codabench import CompetitionSettings
        >>> settings = CompetitionSettings(
        ...     "Demo", docker_image="someone/avs3d-evaluator:0.1.0", start=datetime(2027, 1, 1),
        ...     data_url="https://example.org/data",
        ... )
        >>> written = write_codabench(public, "data/demo", "bundle.zip", settings)
        >>> [(phase.name, phase.masks) for phase in written.phases]
        [('Test', 4)]
    """
    data, truth = Dataset(public), Dataset(private)
    read = (Path(public), Path(private), settings.image, settings.terms, settings.practice)
    check_apart(Path(output), [path for path in read if path is not None])
    check_replaceable(output, (BUNDLE,))
    _check_settings(settings)
    require_no_truth(data)
    check_truth(data, truth)
    practice = None if settings.practice is None else Dataset(settings.practice)
    if practice is not None:
        check_practice(practice, data)
    phases = _phases(data, truth, settings)
    protocols = task_protocols({key.split("/")[0] for phase in phases for key in phase.observations})
    twins = all(has_twins(truth, phase.observations) for phase in phases)
    columns = columns_of(tuple(protocols), MAIN_FIGURES if twins else MAIN_WITHOUT_TWINS)
    facts = _facts(data, phases, columns, settings)
    with atomic_path(output) as temporary:
        with Archive(temporary) as bundle:
            bundle.add(BUNDLE_YAML, _competition(phases, columns, settings).encode())
            for name, text in {**pages(facts), "terms.md": _terms(settings)}.items():
                bundle.add(name, text.encode())
            bundle.add(_image_name(settings), read_bytes(settings.image) if settings.image else logo())
            for number, phase in enumerate(phases):
                task = CompetitionTask(
                    title=f"{settings.title}: {phase.name}", toolkit_version=__version__, protocols=protocols,
                    observations=phase.observations, columns=columns,
                )  # fmt: skip
                bundle.add(_program_name(number), scoring_program(task))
            with bundle.nested(_REFERENCE) as inner:
                for name, source in reference_files(data, truth):
                    inner.add(name, source)
            sample = example_submission(data)
            with bundle.nested(_SOLUTION) as inner:
                for name, source in sample.items():
                    inner.add(name, source)
            with bundle.nested(_STARTING_KIT) as inner:
                for name, contents in starting_kit(facts, sample, practice):
                    inner.add(name, contents)
            if settings.data_url is None:
                with bundle.nested(_DATA) as inner:
                    for name, path in public_files(data):
                        inner.add(name, path)
        problems = check_bundle(temporary)
        if problems:
            raise Avs3dError(f"{output}: not written, because the platform would refuse it: {'; '.join(problems)}")
        size = temporary.stat().st_size
    return Written(phases, columns, size)


def _check_settings(settings: CompetitionSettings) -> None:
    if not 0 < len(settings.title.strip()) <= MOST_TITLE:
        raise UsageError(f"--title: {len(settings.title)} characters, expected 1 to {MOST_TITLE}")
    if not re.fullmatch(
        r"[a-z0-9][\w.\-/:]*:[\w.\-]+|[a-z0-9][\w.\-/:]*@sha256:[0-9a-f]{64}", settings.docker_image
    ) or (len(settings.docker_image) > MOST_IMAGE):
        raise UsageError(
            f"--docker-image: {settings.docker_image!r}, expected name:tag or name@sha256:… of at most {MOST_IMAGE} "
            "characters, e.g. yourname/avs3d-evaluator:0.1.0"
        )
    if bool(settings.development) != (settings.final_start is not None):
        raise UsageError("--development and --final-start belong together; give both or neither")
    if not settings.install.strip() or "\n" in settings.install:
        raise UsageError(f"--install: {settings.install!r}, expected one command line, such as {INSTALL}")
    moments = [settings.start, *filter(None, (settings.final_start, settings.end))]
    if any(later <= earlier for earlier, later in pairwise(moments)):
        raise UsageError(f"dates: {', '.join(map(str, moments))}; expected --start, --final-start, --end in this order")
    if settings.image and settings.image.suffix.lower() not in PICTURES:
        raise UsageError(f"--image: {settings.image}, expected one of {', '.join(PICTURES)}")


def _phases(public: Dataset, private: Dataset, settings: CompetitionSettings) -> tuple[Phase, ...]:
    masks = {observation.key: len(observation.test) for observation in public}
    total = sum(masks.values())
    if settings.final_start is None:
        return (Phase("Test", public.keys, total, settings.start, settings.end, settings.max_submissions),)
    first = tuple(k for k in public.keys if any(fnmatch.fnmatchcase(k, p) for p in settings.development))
    rest = tuple(key for key in public.keys if key not in first)
    if not first or not rest:
        matched = "every" if first else "no"
        raise UsageError(
            f"--development: {' '.join(settings.development)} matches {matched} observation; expected some of "
            f"{', '.join(public.keys[:3])}"
        )
    groups = {key: Observation(private.root, key).group_key for key in public.keys}
    split = {groups[key] for key in first} & {groups[key] for key in rest}
    if split:
        raise UsageError(
            f"--development: the siblings of {min(split)} would be in two phases, where no pair of them can be scored; "
            "choose whole groups"
        )
    count = sum(masks[key] for key in first)
    # The platform refuses a phase that starts when the one before it ends.
    ended = settings.final_start - timedelta(seconds=1)
    return (
        Phase("Development", first, count, settings.start, ended, 100),
        Phase("Final", rest, total - count, settings.final_start, settings.end, settings.max_submissions),
    )


def _competition(phases: Sequence[Phase], columns: Sequence[Column], settings: CompetitionSettings) -> str:
    """The text of competition.yaml."""
    form: dict[str, Any] = {
        "version": 2,
        "title": settings.title,
        "description": "3D audio-visual segmentation: mark the object that sounds.",
        "image": _image_name(settings),
        "terms": "terms.md",
        "registration_auto_approve": not settings.approval,
        "docker_image": settings.docker_image,
        "make_programs_available": True,
        "make_input_data_available": False,
        "enable_detailed_results": True,
        "show_detailed_results_in_submission_panel": True,
        "show_detailed_results_in_leaderboard": False,
        "auto_run_submissions": True,
        "competition_type": "competition",
        **({"contact_email": settings.contact} if settings.contact else {}),
        "pages": [{"title": name.removesuffix(".md").capitalize(), "file": name} for name in ("overview.md", *_PAGES)],
        "tasks": [
            {
                "index": number,
                "name": f"{phase.name} task",
                "description": f"{len(phase.observations)} observations, {phase.masks:,} masks",
                "scoring_program": _program_name(number),
                "reference_data": _REFERENCE,
            }
            for number, phase in enumerate(phases)
        ],
        "solutions": [
            {"index": 0, "name": "a box in the middle", "path": _SOLUTION, "tasks": list(range(len(phases)))},
        ],
        "phases": [_phase(number, phase, settings) for number, phase in enumerate(phases)],
        "leaderboards": [
            {
                "title": "Results",
                "key": "main",
                "submission_rule": "Force_Last",
                "columns": [
                    {
                        "title": column.title,
                        "key": column.key,
                        "index": number,
                        "sorting": "desc" if column.higher_is_better else "asc",
                        "precision": DECIMALS,
                        "hidden": column.hidden,
                    }
                    for number, column in enumerate(columns)
                ],
            }
        ],
    }
    return yaml.safe_dump(form, sort_keys=False, allow_unicode=True, width=120)


_PAGES = ("data.md", "evaluation.md")


def _phase(number: int, phase: Phase, settings: CompetitionSettings) -> dict[str, Any]:
    return {
        "index": number,
        "name": phase.name,
        "description": f"{len(phase.observations)} observations, {phase.masks:,} masks",
        "start": f"{phase.start:%Y-%m-%d %H:%M:%S}",
        **({"end": f"{phase.end:%Y-%m-%d %H:%M:%S}"} if phase.end else {}),
        "max_submissions_per_day": settings.max_per_day,
        "max_submissions": phase.max_submissions,
        "execution_time_limit": max(_LEAST_LIMIT, 60 + phase.masks // _MASKS_PER_SECOND),
        "accepts_only_result_submissions": True,
        # The scores of single observations are for the organisers; the log and detailed_results.html are for all.
        "hide_score_output": True,
        "starting_kit": _STARTING_KIT,
        **({"public_data": _DATA} if settings.data_url is None else {}),
        "tasks": [number],
    }


def _facts(
    data: Dataset, phases: Sequence[Phase], columns: Sequence[Column], settings: CompetitionSettings
) -> CompetitionFacts:
    record = data.record
    return CompetitionFacts(
        title=settings.title,
        dataset=data.name,
        version=data.version,
        licence=record.licence if record else None,
        phases=tuple((p.name, len(p.observations), p.masks, p.start, p.end, p.max_submissions) for p in phases),
        parts=tuple(sorted({key.split("/")[0] for key in data.keys})),
        columns=tuple(columns),
        example=data[0].key,
        data_url=settings.data_url,
        sealed=data.is_sealed,
        install=settings.install,
        practice=settings.practice is not None,
    )


def _terms(settings: CompetitionSettings) -> str:
    if settings.terms is None:
        return terms(settings.title, settings.contact)
    try:
        text = read_bytes(settings.terms).decode()
    except UnicodeDecodeError as error:
        raise Avs3dError(f"{settings.terms}: not UTF-8 ({error}); expected a Markdown file") from None
    if not text.strip():
        raise Avs3dError(f"{settings.terms}: empty; expected the terms of the competition")
    return text


def _image_name(settings: CompetitionSettings) -> str:
    return f"logo{settings.image.suffix.lower() if settings.image else '.png'}"


def _program_name(number: int) -> str:
    return f"scoring_program_{number}.zip"
