"""The scores of the listener's tables: every row of every dataset, what is there already left out.

    python -m benchmarks.listener_tables data/open-s34-o7 data/open-s34-o7-sh3d data/listen \\
        -o docs/results --work work/listener --device cuda:0 --device cuda:1
    python -m benchmarks.listener_tables … --rows echosegnet --only 'part_2/*' --iterations 7000
    python -m benchmarks.listener_page docs/results --page docs/listener.md

Writes ``listener-<dataset>-<row>.json`` for each row, and ``listener-run.json`` with seconds, hardware and settings.
The label of a dataset is the name of its folder; ``LABEL=FOLDER`` gives another one, for example for the same
observations with the sound of another engine. A row is computed again if its file belongs to other weights, another
dataset, or other settings. Trained Gaussians and masks of train frames are kept below
``--work``: a stopped run goes on.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import click
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ProvenanceRecord
from avs3d_bench.contract.scores import Scores
from avs3d_bench.dataset import Dataset, Frame, Observation, by_pictures
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import read_json, sha256_file, write_json
from avs3d_bench.formats.media import read_record
from avs3d_bench.runtime.file_lock import wait_for_lock
from avs3d_bench.runtime.parallel import available_cores, process_each
from avs3d_bench.runtime.provenance import provenance
from avs3d_bench.submission import SubmissionFolder, SubmissionWriter
from baselines import sound_control
from baselines.direction_alone import DirectionMethod, load_direction_marker
from baselines.listener.marks import MARKING_LOOKS, ListenerMarker, load_marker
from baselines.listener.predict import ListenerMethod, Look
from baselines.sound_control import SoundControl

if TYPE_CHECKING:
    from baselines.echosegnet.network_masks import NetworkMasks
    from baselines.echosegnet.pipeline import Settings
    from baselines.echosegnet.voting_stage import Variant

Kind = Literal["truth", "listener", "controls", "echosegnet", "controls-3d"]
#: File with what was run, beside the scores.
RUN_JSON = "listener-run.json"
#: Kinds of rows that are the network's answers in 2D.
HEARD = ("listener", "controls")
#: Kinds of rows of EchoSegnet. Controls share the trained Gaussians.
LIFTED = ("echosegnet", "controls-3d")
#: What rows hear from another observation, which the data may lack: such rows are left out.
OTHER_OBSERVATION = ("same-category", "other-category")
#: Processes that share the GPUs for the rows in 2D, at most: decoding and writing pictures takes most of the time.
MOST_WORKERS = 24


@dataclass(frozen=True)
class Row:
    """One row of the tables.

    Attributes:
        name: in file names.
        title: in tables.
        kind: what computes it; ``--rows`` takes kinds and names.
        setting: of what computes it: instance or deaf oracle, or variant; none of the network's answers in 2D.
        scenes: whether it is for part_3 alone.
        answer: of ``avs3d baseline listener --answer``; of rows of EchoSegnet, ``direction`` marks the train frames in
            place of the run's answer.
        sound: what is heard, by the network and where EchoSegnet chooses.
    """

    name: str
    title: str
    kind: Kind
    setting: str = ""
    scenes: bool = False
    answer: Literal["sounding", "direction", "both"] = "sounding"
    sound: SoundControl = "own"


#: What other sound a row hears: name of the row → name of the control, title.
_OTHER_SOUND: dict[str, tuple[SoundControl, str]] = {
    "no-sound": ("none", "without sound"),
    "wrong-sound": ("other-category", "with wrong sound"),
    "same-category": ("same-category", "with the same category in another home"),
    "swapped-ears": ("swapped-ears", "with swapped ears"),
    "both-ears-mean": ("both-ears-mean", "with the mean of both ears"),
}


def _others(kind: Kind, *rows: Row) -> Iterator[Row]:
    """Each row with each other sound."""
    for own in rows:
        for name, (sound, title) in _OTHER_SOUND.items():
            yield replace(own, name=f"{own.name}-{name}", title=f"{own.title}, {title}", kind=kind, sound=sound)


_BY_PLACE = (
    Row("direction", "direction alone, no category", "listener", answer="direction"),
    Row("both", "listener, name and direction", "listener", answer="both"),
)
_SPATIAL = (
    Row("spatial", "listener + EchoSegnet spatial", "echosegnet", "spatial"),
    Row("spatial-direction", "direction alone + EchoSegnet spatial", "echosegnet", "spatial", answer="direction"),
)
ROWS = {
    row.name: row
    for row in (
        Row("category", "true masks of the category that is heard", "truth", "category"),
        Row("deaf-all", "deaf oracle: every instance", "truth", "all", scenes=True),
        Row("deaf-single", "deaf oracle: best single instance", "truth", "single", scenes=True),
        Row("2d", "listener, 2D", "listener"),
        *(
            Row(name, f"listener, 2D, {title}", "listener", sound=sound)
            for name, (sound, title) in _OTHER_SOUND.items()
        ),
        *_BY_PLACE,
        *_others("controls", *_BY_PLACE),
        Row("no-aisrm", "listener + EchoSegnet without AISRM", "echosegnet", "no-aisrm"),
        Row("official", "listener + EchoSegnet official", "echosegnet", "official"),
        *_SPATIAL,
        *_others("controls-3d", *_SPATIAL),
    )
}
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Plan:
    """The settings of a run.

    Attributes:
        output: folder of the scores.
        work: folder of submissions and intermediate results.
        weights: file of the listener's weights; None: those of the package.
        digest: sha256 of the weights; empty where no row needs them.
        answer: which of the network's answers marks train frames.
        devices: of this machine.
        workers: processes of the rows in 2D, and of the scoring.
        iterations: of the training of Gaussians.
        max_gaussians: cap on their number.
        only: shell patterns of observation keys.
        refine: how masks of the rows in 2D are refined.
        looks: how often the network looks at a picture in the rows in 2D.
    """

    output: Path
    work: Path
    weights: Path | None
    digest: str
    answer: Any
    devices: tuple[str, ...]
    workers: int
    iterations: int
    max_gaussians: int | None
    only: tuple[str, ...]
    refine: Any = "edges"
    looks: Any = "several"

    def scores(self, label: str, row: Row) -> Path:
        """File of a row's scores."""
        return self.output / f"listener-{label}-{row.name}.json"

    def submission(self, label: str, row: Row) -> Path:
        """Folder of a row's submission."""
        return self.work / "submissions" / label / row.name

    @property
    def stages(self) -> Path:
        """Folder of what the rows of EchoSegnet keep and share."""
        return self.work / "stages"

    def said(self, row: Row) -> dict[str, Any]:
        """What decides a row, besides the dataset and the software."""
        found: dict[str, Any] = {"only": list(self.only)}
        if row.kind != "truth":
            found["weights"] = self.digest
        if row.kind in HEARD:
            found |= {"refine": self.refine, "looks": self.looks}
            if row.answer != "sounding":
                found["answer"] = row.answer
        if row.kind in LIFTED:
            from baselines.echosegnet.pipeline import is_relative

            found |= {
                "answer": lifted_answer(row, self),
                "iterations": self.iterations,
                "max_gaussians": self.max_gaussians,
            } | ({} if row.sound == "own" else {"sound": row.sound})
            source, settings = lifting(row, self)
            found |= {"looks": MARKING_LOOKS, "voting_threshold": settings.voting_threshold}
            if is_relative(settings.variant, source):
                found["voting_threshold_of"] = "well-marked Gaussians; in part_3 all votes"
        return found


@dataclass(frozen=True)
class SharedLooks(ListenerMethod):
    """A listener that looks at each picture of observations with the same pictures once, whatever its copies hear.

    Attributes:
        kept: name of a frame → classes of its pixels.
        before: look and pictures → what the network takes from them (`Seen`).
    """

    kept: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    before: dict[Any, Any] = field(default_factory=dict)

    def encoded(self, look: Look, pictures: Sequence[NDArray[np.uint8]], *, again: bool = True) -> Any:
        """See `ListenerMethod.encoded`."""
        key = look, *(picture.tobytes() for picture in pictures)
        if key not in self.before:
            if not again:
                return super().encoded(look, pictures)
            self.before[key] = self.network.see(self._shown(look, pictures))
        return self.before[key]

    def class_maps(self, frames: Sequence[Frame]) -> list[NDArray[np.float32]]:
        """See `ListenerMethod.class_maps`."""
        new = [frame for frame in frames if frame.name not in self.kept]
        self.kept.update(zip([frame.name for frame in new], super().class_maps(new), strict=True))
        return [self.kept[frame.name] for frame in frames]


@lru_cache(maxsize=1)
def _network(weights: Path | None, device: str, refine: Any, looks: Any) -> ListenerMethod:
    import torch

    from baselines.listener.predict import load_method

    if device != "cpu":
        torch.set_num_threads(1)  # many processes share the cores
    return load_method(weights, device=device, refine=refine, looks=looks)


def _shared(plan: Plan, refine: Any, looks: Any) -> SharedLooks:
    """What a worker process has for observations with the same pictures, on one of the devices."""
    device = plan.devices[os.getpid() % len(plan.devices)]
    return SharedLooks(**vars(_network(plan.weights, device, refine, looks)))


def _write_siblings(root: Path, folders: dict[Row, SubmissionFolder], plan: Plan, keys: Sequence[str]) -> None:
    """Write the masks of several rows for observations with the same pictures, in a worker process."""
    shared = _shared(plan, plan.refine, plan.looks)
    places: dict[str, Any] = {}
    for key in keys:
        frames = Observation(root, key).test
        # One sound after another: what is found by place is kept for the last one.
        for row in sorted(folders, key=lambda row: row.sound):
            network = replace(shared, hearing=row.sound)
            method = network if row.answer == "sounding" else DirectionMethod(network, row.answer, places)
            for frame, one in zip(frames, method.predictions(frames), strict=True):
                folders[row].write_mask(frame, one.mask, one.categories)


def _write_heard(dataset: Dataset, label: str, rows: Sequence[Row], plan: Plan) -> None:
    """Write the submissions of rows in 2D; siblings are together, see `_write_siblings`."""
    with ExitStack() as stack:
        folders: dict[Row, SubmissionFolder] = {}
        for row in rows:
            entry = "listener.predict:write_listener" if row.answer == "sounding" else "direction_alone:write_direction"
            network = replace(_network(plan.weights, "cpu", plan.refine, plan.looks), hearing=row.sound)
            writer = SubmissionWriter(
                plan.submission(label, row),
                dataset,
                method=row.title,
                notes="; only ".join(filter(None, (network.notes, " ".join(plan.only)))),
                provenance=ProvenanceRecord.of(provenance(f"baselines.{entry}")),
                only=plan.only,
                overwrite=True,
            )
            folders[row] = stack.enter_context(writer).folder
        _each_siblings(partial(_write_siblings, dataset.root, folders, plan), dataset, plan, "rows in 2D")


def _each_siblings(work: Callable[[list[str]], None], dataset: Dataset, plan: Plan, label: str) -> None:
    """Call ``work`` with the keys of observations that have the same pictures, in worker processes."""
    groups = by_pictures(dataset.select(*plan.only)).values()
    keys = [[each.key for each in group] for group in groups]
    sizes = [sum(len(each.test) for each in group) for group in groups]
    for _ in process_each(work, keys, workers=plan.workers, label=label, progress=True, sizes=sizes):
        pass


def _mark_siblings(root: Path, rows: Sequence[Row], plan: Plan, keys: Sequence[str]) -> None:
    """Keep the masks of train frames, of rows of EchoSegnet, of observations with the same pictures."""
    from baselines.echosegnet.cache import Stages
    from baselines.echosegnet.heard_categories import work_folder
    from baselines.echosegnet.network_masks import NetworkMasks

    shared = _shared(plan, "edges", MARKING_LOOKS)
    sources = [NetworkMasks(replace(marker_of(row, plan), loaded=shared)) for row in rows]
    for key in keys:
        observation = Observation(root, key)
        stages = Stages(work_folder(plan.stages, observation))
        for source in sources:
            source.found(observation, shared.device, stages)


def write_rows(dataset: Dataset, label: str, rows: Sequence[Row], plan: Plan) -> None:
    """Write the submissions of rows that are computed together; see `together`."""
    row, path = rows[0], plan.submission(label, rows[0])
    common: dict[str, Any] = {"only": plan.only, "overwrite": True, "progress": True}
    if row.kind == "truth":
        from baselines.deaf import write_deaf
        from baselines.oracle import write_oracle

        if row.scenes:
            write_deaf(dataset, path, row.setting, workers=plan.workers, **common)  # type: ignore[arg-type]
        else:
            write_oracle(dataset, path, instance="category", workers=plan.workers, **common)
    elif row.kind in HEARD:
        _write_heard(dataset, label, rows, plan)
    else:
        _write_lifted(dataset, path, row, plan, common)


def together(rows: Iterable[Row]) -> list[list[Row]]:
    """Rows that share what the network sees: all in 2D, written together, and all of EchoSegnet, for their marks."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault("in 2D" if row.kind in HEARD else "lifted" if row.kind in LIFTED else row.name, []).append(row)
    return list(found.values())


def lacking(dataset: Dataset, row: Row, only: Sequence[str]) -> str:
    """Why a row cannot hear the sound of another observation: what the dataset lacks; empty if it can."""
    if row.sound in OTHER_OBSERVATION:
        try:
            for observation in dataset.select(*only):
                sound_control.other_frame(observation.frames[0], same_category=row.sound == "same-category")
        except UsageError as error:
            return str(error)
    return ""


def lifted_answer(row: Row, plan: Plan) -> Any:
    """Which of the network's answers marks train frames in a row of EchoSegnet."""
    return plan.answer if row.answer == "sounding" else row.answer


def marker_of(row: Row, plan: Plan) -> ListenerMarker:
    """What marks train frames in a row of EchoSegnet."""
    answer = lifted_answer(row, plan)
    if answer == "direction":
        return load_direction_marker(plan.weights, hearing=row.sound)
    return load_marker(plan.weights, which=answer, hearing=row.sound)


def lifting(row: Row, plan: Plan) -> tuple[NetworkMasks, Settings]:
    """The source of the masks and the settings of a row of EchoSegnet."""
    from baselines.echosegnet.densify import DensityControl
    from baselines.echosegnet.network_masks import NetworkMasks
    from baselines.echosegnet.pipeline import Settings, default_threshold
    from baselines.echosegnet.train import TrainingSettings

    source = NetworkMasks(marker_of(row, plan))
    variant: Variant = "spatial" if row.setting == "spatial" else "official"
    density = DensityControl(max_gaussians=plan.max_gaussians)
    settings = Settings(
        variant=variant,
        voting_threshold=default_threshold(variant, source),
        refine=row.setting != "no-aisrm",
        sound=row.sound,
        training=TrainingSettings(iterations=plan.iterations, density=density),
    )
    return source, settings


def _write_lifted(dataset: Dataset, path: Path, row: Row, plan: Plan, common: dict[str, Any]) -> None:
    from baselines.echosegnet.run import write_echosegnet

    source, settings = lifting(row, plan)
    write_echosegnet(dataset, path, source, settings, work=plan.stages, devices=plan.devices, **common)


def _mark(dataset: Dataset, rows: Sequence[Row], plan: Plan) -> None:
    """Keep the masks of train frames of rows of EchoSegnet, made from one look at each picture; the rows find them."""
    with suppress(Avs3dError):  # the rows say it
        _each_siblings(partial(_mark_siblings, dataset.root, rows, plan), dataset, plan, "marks of train frames")


def is_current(path: Path, entry: dict[str, Any] | None, dataset: Dataset, said: dict[str, Any]) -> bool:
    """Whether a file of scores belongs to this dataset and these settings."""
    if entry is None or entry.get("settings") != said or not path.exists():
        return False
    record = dataset.root / layout.DATASET_JSON
    return read_record(path, Scores).dataset.sha256 == (sha256_file(record) if record.exists() else None)


def hardware() -> str:
    """Name of the GPUs, or of the processor."""
    import torch

    if not torch.cuda.is_available():
        return f"{platform.processor() or platform.machine()}, {available_cores()} cores"
    return f"{torch.cuda.device_count()} × {torch.cuda.get_device_name()}, {available_cores()} cores"


def run_rows(label: str, dataset: Dataset, rows: Sequence[Row], plan: Plan) -> dict[str, dict[str, Any]]:
    """Write and score rows that are computed together; row → what listener-run.json says of it."""
    from evaluators import evaluate

    start = time.perf_counter()
    write_rows(dataset, label, rows, plan)
    written, found = time.perf_counter(), {}
    for row in rows:
        begun = time.perf_counter()
        scores = evaluate(plan.submission(label, row), dataset.root, only=plan.only, workers=plan.workers).scores
        write_json(plan.scores(label, row), scores)
        found[f"{label}-{row.name}"] = {
            "settings": plan.said(row), "seconds": round((written - start) / len(rows), 1),
            "scoring_seconds": round(time.perf_counter() - begun, 1), "observations": scores.overall.observations,
            "frames": scores.overall.frames, "hardware": hardware(), "processes": plan.workers,
        }  # fmt: skip
    return found


def _read_run(plan: Plan) -> dict[str, Any]:
    """What listener-run.json says of rows that are there."""
    path = plan.output / RUN_JSON
    known: dict[str, Any] = read_json(path) if path.exists() else {}
    weights = plan.digest or known.get("weights", "")
    return {"weights": weights, "datasets": known.get("datasets", {}), "rows": known.get("rows", {})}


def run_all(roots: dict[str, Path], rows: Sequence[Row], plan: Plan) -> list[str]:
    """Run the rows that are not there yet and whose sounds the datasets have; messages of those that failed."""
    failed = []
    for some in together(rows):
        for label, root in roots.items():
            dataset, known = Dataset(root), _read_run(plan)["rows"]
            wanted = []
            for row in some:
                name = f"{label}-{row.name}"
                if row.scenes and not all(observation.is_part_3 for observation in dataset):
                    continue
                if is_current(plan.scores(label, row), known.get(name), dataset, plan.said(row)):
                    click.echo(f"{name}: there already")
                elif missing := lacking(dataset, row, plan.only):
                    click.echo(f"{name}: left out: {missing}")
                else:
                    wanted.append(row)
            if not wanted:
                continue
            parts = [wanted]
            if wanted[0].kind in LIFTED:
                _mark(dataset, wanted, plan)
                parts = [[row] for row in wanted]
            for part in parts:
                try:
                    found = run_rows(label, dataset, part, plan)
                except Avs3dError as error:
                    failed += [f"{label}-{row.name}: {error}" for row in part]
                    click.echo(f"{label}: {', '.join(row.name for row in part)}: failed: {error}", err=True)
                else:
                    _record(label, dataset, found, plan)
    return failed


def _record(label: str, dataset: Dataset, found: dict[str, dict[str, Any]], plan: Plan) -> None:
    """Write down what `run_rows` found."""
    with wait_for_lock(plan.output / f".{RUN_JSON}.lock"):
        document = _read_run(plan)  # another run may score another dataset into the same folder
        document["datasets"][label] = {"name": dataset.name, "version": dataset.record and dataset.record.version}
        document["rows"] |= found
        write_json(plan.output / RUN_JSON, document)
    for name, entry in found.items():
        click.echo(f"{name}: {entry['seconds']} s")


def rows_of(names: Sequence[str]) -> list[Row]:
    """The rows that ``--rows`` names, in the tables' order."""
    return [row for row in ROWS.values() if row.name in names or row.kind in names]


def labelled(texts: Sequence[str]) -> dict[str, Path]:
    """Label → folder, of ``FOLDER`` and ``LABEL=FOLDER``.

    Raises:
        click.UsageError: if two folders have one label.
    """
    found: dict[str, Path] = {}
    for text in texts:
        label, equals, folder = text.partition("=")
        path = Path(folder if equals else text)
        label = label if equals else path.resolve().name
        if label in found:
            raise click.UsageError(f"{text}: another dataset has the label {label}; name it LABEL=FOLDER")
        found[label] = path
    return found


@click.command()
@click.argument("datasets", nargs=-1, required=True, metavar="[LABEL=]ROOT…")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the scores.")
@click.option("--work", type=click.Path(path_type=Path), required=True, help="Folder of what is kept between runs.")
@click.option("--weights", type=click.Path(path_type=Path), default=None, help="Of the listener [the package's].")
@click.option(
    "--rows", multiple=True, type=click.Choice([*KINDS, *ROWS]), default=("truth", "listener"), show_default=True,
    help="Kinds of rows, or single rows; repeatable.",
)  # fmt: skip
@click.option("--answer", type=click.Choice(["category", "sounding"]), default="category", show_default=True)
@click.option("--refine", type=click.Choice(["none", "edges"]), default="edges", show_default=True)
@click.option("--looks", type=click.Choice(["one", "several"]), default="several", show_default=True)
@click.option("--device", "devices", multiple=True, help="cpu, cuda:0, …; repeatable [all GPUs, else cpu].")
@click.option("--workers", type=click.IntRange(1), default=None, help="Processes of the rows in 2D and of scoring.")
@click.option("--iterations", default=30_000, show_default=True, help="Of the training of Gaussians.")
@click.option("--max-gaussians", type=int, default=None, help="Cap on the number of Gaussians [none].")
@click.option("--only", multiple=True, help="Shell pattern of observation keys; repeatable [all].")
def main(
    datasets: tuple[str, ...],
    output: Path,
    work: Path,
    weights: Path | None,
    rows: tuple[str, ...],
    devices: tuple[str, ...],
    workers: int | None,
    **chosen: Any,
) -> None:
    """Compute the scores of the listener's tables on the datasets."""
    from baselines.echosegnet.jobs import all_devices

    roots = labelled(datasets)
    devices = devices or all_devices()
    workers = workers or min(MOST_WORKERS, available_cores())
    # Worker processes share what one of them has compiled.
    os.environ.setdefault("NUMBA_CACHE_DIR", str(work.absolute() / "kernels"))
    try:
        weights, wanted = None if weights is None else weights.absolute(), rows_of(rows)
        digest = load_marker(weights).digest if any(row.kind != "truth" for row in wanted) else ""
        plan = Plan(output, work, weights, digest, devices=devices, workers=workers, **chosen)
        failed = run_all(roots, wanted, plan)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    if failed:
        raise click.ClickException(f"{len(failed)} rows failed, the first: {failed[0]}; run the same command again")


if __name__ == "__main__":
    # The module under its own name: worker processes find `_write_siblings` there.
    from benchmarks.listener_tables import main as _main

    _main()
