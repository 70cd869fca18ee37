"""What a compute worker of Codabench does with a submission, step by step, without its container engine.

After `Run.prepare`, `_run_program_directory` and `push_scores` of `compute_worker/compute_worker.py` in
https://github.com/codalab/codabench: the masks are copied as they are in the first step, which adds a file
``metadata``; the scoring step unpacks program, truth and masks into ``program``, ``input/ref`` and ``input/res`` and
runs the command of metadata.yaml in ``/app/program``, without a shell. Here another folder stands for ``/app``.
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

#: Where the worker puts the program, and runs it.
PROGRAM = "/app/program"


@dataclass(frozen=True)
class Scored:
    """What the platform shows.

    Attributes:
        status: Finished or Failed.
        scores: what it puts on the leaderboard; None if the run failed.
        stdout: of the scoring program.
        stderr: of the scoring program, and the worker's own message at the end.
        exit_code: of the scoring program.
        output: the folder of output.
        details: the page of detailed results.
    """

    status: str
    scores: dict[str, float] | None
    stdout: str
    stderr: str
    exit_code: int
    output: Path
    details: str


def read_competition(bundle: Path) -> dict[str, Any]:
    """competition.yaml of a bundle."""
    with zipfile.ZipFile(bundle) as archive:
        return dict(yaml.safe_load(archive.read("competition.yaml")))


class NoResultsError(Exception):
    """The first step of the worker leaves no results for the scoring step."""


def prepare(bundle: Path, submission: Path, app: Path, task: int = 0) -> str:
    """Unpack all that a container sees below ``app``; the command that it runs."""
    record = next(each for each in read_competition(bundle)["tasks"] if each["index"] == task)
    first = app.parent / f"{app.name}-first"
    with zipfile.ZipFile(submission) as archive:
        archive.extractall(first)
    if any((first / name).exists() for name in ("metadata.yaml", "metadata")):
        # A program: without a command nothing is run, and with one it is run in a container without the masks' reader.
        raise NoResultsError("the submission has a file metadata.yaml or metadata: taken as a program, not as results")
    (first / "metadata").write_text(yaml.dump({"exitCode": None, "elapsedTime": None}))
    results = shutil.make_archive(str(app.parent / f"{app.name}-result"), "zip", first)
    with zipfile.ZipFile(bundle) as outer:
        for member, place in ((record["scoring_program"], "program"), (record["reference_data"], "input/ref")):
            with outer.open(member) as stream, zipfile.ZipFile(stream) as inner:
                inner.extractall(app / place)
    with zipfile.ZipFile(results) as archive:
        archive.extractall(app / "input/res")
    (app / "output").mkdir()
    (app / "shared").mkdir()
    return str(yaml.safe_load((app / "program/metadata.yaml").read_text())["command"])


def score(
    bundle: Path, submission: Path, app: Path, *, environment: Mapping[str, str], task: int = 0, limit: float = 600
) -> Scored:
    """Score a submission as the platform does.

    Args:
        bundle: the competition's.
        submission: a zip archive, as a participant uploads it.
        app: a new folder that stands for ``/app``.
        environment: that of the container: PATH finds its ``python3``.
        task: index of the task.
        limit: seconds.
    """
    command = prepare(bundle, submission, app, task).replace("/app", str(app))
    python, *arguments = shlex.split(command)
    found = shutil.which(python, path=environment["PATH"])
    assert found is not None, python
    done = subprocess.run(
        [found, *arguments], cwd=app / "program", env={"PYTHONUNBUFFERED": "1", **environment}, check=False,
        capture_output=True, text=True, timeout=limit,
    )  # fmt: skip
    output = app / "output"
    page = output / "detailed_results.html"
    file = output / "scores.json"
    scores = json.loads(file.read_text()) if file.exists() else None
    message = "" if file.exists() else "Could not find scores file, did the scoring program output it?"
    assert not (output / "metadata").exists()  # the worker refuses to overwrite it
    return Scored(
        "Failed" if scores is None else "Finished", scores, done.stdout, done.stderr + message, done.returncode, output,
        page.read_text() if page.exists() else "",
    )  # fmt: skip
