"""The command `avs3d baseline`: one subcommand for each baseline, imported when it is called."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from avs3d_bench.commands.click_options import PATH, WORKERS, Group, dataset_option, only_option
from avs3d_bench.commands.outputs import OUTPUT_FOLDER, OutputFile, Signature
from avs3d_bench.errors import UsageError
from avs3d_bench.scheduling.options import Options, scheduling_options

if TYPE_CHECKING:
    from avs3d_bench.submission import SubmissionWriter
    from baselines.echosegnet.network_masks import AnySource
    from baselines.echosegnet.pipeline import Settings

_RATE = click.FloatRange(0.0, 1.0)
#: `baselines.sound_control.SOUND_CONTROLS`, without the time that its import takes.
_SOUND_CONTROLS = ("own", "none", "swapped-ears", "both-ears-mean", "same-category", "other-category")
_SOUND_HELP = "What it hears in place of the frame's own sound, to see what it takes from the sound."


def _sound_option(name: str) -> Callable[[_F], _F]:
    """``--sound`` as the parameter ``name``."""
    return click.option(
        "--sound", name, type=click.Choice(_SOUND_CONTROLS), default="own", show_default=True, help=_SOUND_HELP
    )


#: Of a file of answers.
_ANSWERS = Signature(start=b'{"id":"q', marks=(b'","answer":"',))
_F = TypeVar("_F", bound=Callable[..., Any])
#: Options of `load_owod_bind`; the last one is shown first.
_NETWORKS: dict[str, Callable[[Any], Any]] = {
    "boxes": click.option("--boxes", type=click.Choice(["owlv2", "mavl"]), default="owlv2", show_default=True),
    "boxes_checkpoint": click.option("--boxes-checkpoint", type=PATH, help="Folder of OWLv2 or MAVL."),
    "sam_checkpoint": click.option("--sam-checkpoint", type=PATH, help="Folder of SAM."),
    "similarity": click.option(
        "--similarity", type=click.Choice(["imagebind", "pe-av"]), help="[imagebind where installed, else pe-av]"
    ),
    "similarity_checkpoint": click.option("--similarity-checkpoint", type=PATH, help="Folder of ImageBind or PE-AV."),
}


@click.group(cls=Group, noun="baseline")
def baseline() -> None:
    """Run a baseline on a dataset and write its submission.

    The same dataset and options give the same bytes.
    """


def _common(command: _F) -> _F:
    """The options that every baseline has."""
    return _with_common(command, "SUBMISSION", "Folder of the submission.", "Replace an existing submission.")


def _with_common(command: _F, metavar: str, output_help: str, overwrite_help: str) -> _F:
    for option in (
        click.option("--overwrite", is_flag=True, help=overwrite_help),
        only_option,
        click.option("-o", "--output", "path", type=OUTPUT_FOLDER, metavar=metavar, required=True, help=output_help),
        dataset_option,
    ):
        command = option(command)
    return command


def _common_of_several(command: _F) -> _F:
    """The same options of a command that writes several submissions."""
    return _with_common(
        command, "DIR", "Folder of the submissions, one below it for each row.", "Replace existing submissions."
    )


def _done(writer: SubmissionWriter) -> None:
    count = len(writer.observations)
    masks = sum(len(observation.test) for observation in writer.observations)
    plural = "" if count == 1 else "s"
    click.echo(f"{writer.path}: {masks} masks of {count} observation{plural}: {writer.record.method}")


def _trivial(name: str, root: Path, path: Path, only: tuple[str, ...], overwrite: bool) -> None:
    from avs3d_bench.dataset import Dataset
    from baselines.trivial import write_trivial

    progress = sys.stderr.isatty()
    _done(write_trivial(name, Dataset(root), path, only=only, overwrite=overwrite, progress=progress))


@baseline.command("all-black", short_help="Nothing sounds: every mask is black.")
@_common
def all_black(**options: Any) -> None:
    """Write black masks, of the size of the input pictures. No truth is read."""
    _trivial("all-black", **options)


@baseline.command("all-white", short_help="Everything sounds: every mask is white.")
@_common
def all_white(**options: Any) -> None:
    """Write white masks, of the size of the input pictures. No truth is read."""
    _trivial("all-white", **options)


@baseline.command("centre-box", short_help="The central quarter of every picture.")
@_common
def centre_box(**options: Any) -> None:
    """Write masks whose middle half of rows and columns is white. No truth is read."""
    _trivial("centre-box", **options)


@baseline.command(short_help="The ground truth of test frames, perfect or with errors.")
@_common
@click.option(
    "--instance",
    type=click.Choice(["category", "sounding"]),
    default="category",
    show_default=True,
    help="The visible pixels of every instance of the sounding category, or of the sounding one alone.",
)
@click.option("--drop", type=_RATE, default=0.0, metavar="P", help="Probability that a frame's mask is all black.")
@click.option(
    "--swap", type=_RATE, default=0.0, metavar="P",
    help="Probability that in an observation a silent twin is marked instead (with --instance sounding).",
)  # fmt: skip
@click.option(
    "--dilate", type=float, default=0.0, metavar="PX",
    help="Grow masks by a disc of this radius in pixels at 1008 pixels; below 0: shrink them.",
)  # fmt: skip
@click.option(
    "--confuse", type=_RATE, default=0.0, metavar="P",
    help="Probability that in an observation a similar object is marked as well.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of every random decision.")
@click.option("--points", is_flag=True, help="Write points on the true mesh as well (with --instance sounding).")
@click.option(
    "--deaf", type=click.Choice(["all", "single"]), is_flag=False, flag_value="all", default=None,
    help="Of part_3: mark the same instances for all siblings: all that can sound, or the best single one.",
)  # fmt: skip
@click.option("--workers", type=WORKERS, default=None, help="Processes [one per core].")
def oracle(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    instance: Any,
    points: bool,
    deaf: Any,
    workers: int | None,
    **errors: Any,
) -> None:
    """Write the ground truth of the test frames as a submission, perfect or with errors.

    This USES THE GROUND TRUTH OF TEST FRAMES, as submission.json records: its scores are bounds, not results. With
    --instance category it is the result of a perfect detector that ignores the sound.
    --instance sounding also works on the official release. In part_3 the audible instances are marked, frame by frame,
    and categories/ is written as well.
    """
    from avs3d_bench.dataset import Dataset
    from baselines.deaf import write_deaf
    from baselines.oracle import write_oracle
    from baselines.oracle_errors import ErrorModel

    common: dict[str, Any] = {
        "only": only, "overwrite": overwrite, "workers": workers, "progress": sys.stderr.isatty(),
    }  # fmt: skip
    if deaf is None:
        model = ErrorModel(**errors)
        _done(write_oracle(Dataset(root), path, instance=instance, errors=model, points=points, **common))
        return
    context = click.get_current_context()
    for name in ("instance", "points", *errors):
        if context.get_parameter_source(name) is not click.core.ParameterSource.DEFAULT:
            raise UsageError(f"--deaf cannot be had with --{name}: a deaf oracle has one answer for all siblings")
    _done(write_deaf(Dataset(root), path, deaf, **common))


@baseline.command(short_help="Rules of place with true masks, and their scores by kind of pair.")
@_common_of_several
@click.option("--workers", type=WORKERS, default=None, help="Processes [one per core].")
@click.option("--json", "json_file", type=OutputFile(Signature(keys=("dataset", "version", "scored", "references"))),
              metavar="FILE", help="Write the table to this file as well.")  # fmt: skip
def references(
    root: Path, path: Path, only: tuple[str, ...], overwrite: bool, workers: int | None, json_file: Path | None
) -> None:
    """Write the reference rows of part_3 as submissions below the folder, score them, and print one table.

    All have true masks and know which categories are heard, so that only the place is left: category marks all
    instances, level follows the loudness over the walk, ild the louder ear, gcc-phat the interaural delay. This USES
    THE GROUND TRUTH OF TEST FRAMES: the scores are bounds of what place is worth, not results.
    """
    from avs3d_bench.dataset import Dataset
    from avs3d_bench.formats.files import write_json
    from baselines.reference_scores import print_table, score_all, summary
    from baselines.references import write_references

    options: dict[str, Any] = {
        "only": only, "overwrite": overwrite, "workers": workers, "progress": sys.stderr.isatty(),
    }  # fmt: skip
    written = write_references(Dataset(root), path, **options)
    for writer in written.values():
        _done(writer)
    found = score_all(path, written, root, only=only, workers=workers)
    print_table(found)
    if json_file is not None:
        write_json(json_file, summary(found))


def _owod_bind_options(command: _F) -> _F:
    """Which networks, and where their checkpoints lie; the command gets them as one, ``networks``."""

    @wraps(command)
    def gathered(*args: Any, **kwargs: Any) -> Any:
        own = {name: kwargs.pop(name) for name in _NETWORKS}
        return command(*args, networks=own, **kwargs)

    decorated: Any = gathered
    for option in _NETWORKS.values():
        decorated = option(decorated)
    return decorated  # type: ignore[no-any-return]


@baseline.command("owod-bind", short_help="Boxes, masks, and similarity to the sound.")
@_common
@_owod_bind_options
@click.option("--threshold", type=_RATE, default=0.2, show_default=True, help="Of the softmax over proposals.")
@click.option("--device", default=None, help="cpu, cuda:0, … [CUDA where there is one].")
@click.option(
    "--split", type=click.Choice(["test", "train"]), default="test", show_default=True,
    help="test writes a submission, train a folder of masks for `echosegnet --masks`.",
)  # fmt: skip
@_sound_option("hearing")
def owod_bind(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    split: Any,
    hearing: Any,
    networks: dict[str, Any],
    **settings: Any,
) -> None:
    """Run OWOD-BIND, frame by frame: class-agnostic boxes, SAM, audio-visual similarity.

    Checkpoints are local folders; nothing is downloaded. One that is missing is named, with its licence and size.
    """
    from avs3d_bench.dataset import Dataset
    from baselines.owod_bind.run import load_owod_bind, write_mask_folder, write_owod_bind

    model = replace(load_owod_bind(**settings, **networks), hearing=hearing)
    progress = sys.stderr.isatty()
    if split == "train":
        count = write_mask_folder(Dataset(root), path, model, only=only, progress=progress)
        click.echo(f"{path}: {count} masks of train frames: {model.method}")
    else:
        _done(write_owod_bind(Dataset(root), path, model, only=only, overwrite=overwrite, progress=progress))


#: Networks of `foundation`, in the order in which help shows them.
_FOUNDATION = {"clap": "CLAP", "sam3": "SAM 3", "grounding-dino": "Grounding DINO", "sam2": "SAM 2"}


def _foundation_options(command: _F) -> _F:
    """A folder for each network; the command gets them as one, ``folders``."""

    @wraps(command)
    def gathered(*args: Any, **kwargs: Any) -> Any:
        folders = {kind: kwargs.pop(f"{kind.replace('-', '_')}_checkpoint") for kind in _FOUNDATION}
        return command(*args, folders=folders, **kwargs)

    decorated: Any = gathered
    for kind, name in reversed(_FOUNDATION.items()):
        decorated = click.option(f"--{kind}-checkpoint", type=PATH, help=f"Folder of {name}.")(decorated)
    return decorated  # type: ignore[no-any-return]


@baseline.command(short_help="A sound is named, its name segmented, and both ears choose.")
@_common
@_foundation_options
@click.option(
    "--segmenter", type=click.Choice(["sam3", "grounded-sam2"]), default="sam3", show_default=True,
    help="grounded-sam2 is Grounding DINO with SAM 2, whose weights need no licence to be accepted.",
)  # fmt: skip
@click.option("--device", default=None, help="cpu, cuda:0, … [CUDA where there is one].")
@click.option("--dry-run", is_flag=True, help="Print what would be loaded, and stop.")
@_sound_option("hearing")
def foundation(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    folders: dict[str, Any],
    dry_run: bool,
    hearing: Any,
    **settings: Any,
) -> None:
    """Run foundation models: CLAP names the sound, SAM 3 segments the name, poses join, both ears choose.

    Checkpoints are local folders; nothing is downloaded. In part_3 categories/ is written as well.
    """
    from avs3d_bench.dataset import Dataset
    from baselines.foundation import run

    if dry_run:
        for line in run.dry_run(settings["segmenter"], folders):
            click.echo(line)
        return
    model = replace(run.load_foundation(folders=folders, **settings), hearing=hearing)
    progress = sys.stderr.isatty()
    _done(run.write_foundation(Dataset(root), path, model, only=only, overwrite=overwrite, progress=progress))


@baseline.command(short_help="Where self-supervised features of picture and sound agree.")
@_common
@click.option("--checkpoint", type=PATH, help="Folder of DenseAV.")
@click.option("--threshold", type=_RATE, default=0.5, show_default=True, help="Of the normalised similarity.")
@click.option(
    "--normalise", type=click.Choice(["observation", "frame"]), default="observation", show_default=True,
    help="Scope of the minimum and maximum of the similarity.",
)  # fmt: skip
@click.option("--device", default=None, help="cpu, cuda:0, … [CUDA where there is one].")
@_sound_option("hearing")
def denseav(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    checkpoint: Path | None,
    hearing: Any,
    **settings: Any,
) -> None:
    """Run DenseAV (Hamilton et al. 2024), frame by frame, through its own package and a local checkpoint."""
    from avs3d_bench.dataset import Dataset
    from baselines.denseav import load_denseav, write_denseav

    model = replace(load_denseav(checkpoint, **settings), hearing=hearing)
    _done(write_denseav(Dataset(root), path, model, only=only, overwrite=overwrite, progress=sys.stderr.isatty()))


@baseline.command(short_help="The network of this package that looks and listens.")
@_common
@click.option("--weights", type=PATH, metavar="FILE", help="Weights of `avs3d train listener` [the package's].")
@click.option("--device", default=None, help="cpu, cuda:0, … [CUDA where there is one].")
@click.option(
    "--refine", type=click.Choice(["none", "edges"]), default="edges", show_default=True,
    help="Whether masks follow the picture's edges.",
)  # fmt: skip
@click.option(
    "--looks", type=click.Choice(["one", "several"]), default="several", show_default=True,
    help="Whether the mean of looks at two sizes, also mirrored, decides, or one look, ten times as fast.",
)  # fmt: skip
@click.option(
    "--answer", type=click.Choice(["sounding", "direction", "both"]), default="sounding", show_default=True,
    help="What the network says sounds, frame by frame; or, of all objects that it sees, the one from whose place the "
    "sound of the walk comes (direction), or from whose place it comes and whose name is heard (both).",
)  # fmt: skip
@click.option(
    "--calibrated/--uncalibrated", default=True, show_default=True,
    help="Whether probabilities and threshold are those that the weights name, if they name some.",
)  # fmt: skip
@_sound_option("hearing")
@click.option(
    "--soft-masks", "soft", type=OUTPUT_FOLDER, default=None, metavar="FOLDER",
    help="Also write the probability of each pixel, as PNG with 8 bits of grey, for `avs3d metrics --soft`.",
)  # fmt: skip
def listener(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    answer: str,
    soft: Path | None,
    **how: Any,
) -> None:
    """Run the listener, frame by frame: the picture and one second of binaural sound give the mask of what sounds.

    It was trained on datasets of this package's generator alone. In part_3 categories/ is written as well.
    """
    from avs3d_bench.dataset import Dataset
    from baselines.direction_alone import write_direction
    from baselines.listener.packages import require
    from baselines.listener.predict import load_method, write_listener

    require("baselines")
    if soft is not None and answer != "sounding":
        raise UsageError(
            f"--soft-masks: belongs to --answer sounding; --answer {answer} has no probabilities of pixels"
        )
    model = load_method(**how)
    how = {"only": only, "overwrite": overwrite, "progress": sys.stderr.isatty()}
    if answer == "sounding":
        _done(write_listener(Dataset(root), path, model, soft=soft, **how))
    else:
        _done(write_direction(Dataset(root), path, model, cues=answer, **how))  # type: ignore[arg-type]


@baseline.command(short_help="3D Gaussian splatting, lifted masks, refined by sound.")
@_common
@click.option("--masks", required=True, metavar="oracle|owod-bind|listener|DIR", help="2D masks of the train frames.")
@click.option(
    "--instance",
    type=click.Choice(["category", "sounding"]),
    default="category",
    show_default=True,
    help="Of --masks oracle: every instance of the sounding category, or the sounding one.",
)
@click.option("--listener-weights", type=PATH, metavar="FILE", help="Of --masks listener: weights [the package's].")
@click.option(
    "--listener-answer", type=click.Choice(["category", "sounding", "direction"]), default=None,
    help="Of --masks listener: every object of the category that is heard, what it says sounds, or the object from "
    "whose place the sound comes, whatever it is called [official: category; spatial: direction].",
)  # fmt: skip
@click.option(
    "--variant", type=click.Choice(["official", "spatial"]), default="official", show_default=True,
    help="As released, or with occlusion-aware votes and the likelihood of what both ears heard; the training is one.",
)  # fmt: skip
@click.option("--no-aisrm", is_flag=True, help="Keep every labelled Gaussian, ignoring the sound.")
@_sound_option("sound")
@click.option(
    "--voting-threshold", type=click.FloatRange(0.0, 1.0, max_open=True), default=None, metavar="SHARE",
    help="A Gaussian is labelled above this share of its votes [0.3]; with --variant spatial --masks listener, above "
    "this share of what well-marked Gaussians have [0.5].",
)  # fmt: skip
@click.option("--iterations", type=click.IntRange(1), default=30_000, show_default=True, help="Of the training.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the training.")
@click.option(
    "--max-gaussians", type=click.IntRange(2), default=None, metavar="N",
    help="Cap on the number of Gaussians [none, as in 3D-GS; growth ends where memory is nearly used].",
)  # fmt: skip
@click.option(
    "--sweep", type=click.Choice(["voting-threshold"]), default=None,
    help="Write one submission for each threshold of the paper's Table 3 into the output folder.",
)  # fmt: skip
@_owod_bind_options
@click.option("--work", type=OUTPUT_FOLDER, default=None, help="Folder of intermediate results [OUTPUT.work].")
@click.option(
    "--device",
    "devices",
    multiple=True,
    help="cpu, cuda:0, …; repeat it to use several, or one of them for several observations at a time [all].",
)
@scheduling_options
def echosegnet(
    root: Path,
    path: Path,
    only: tuple[str, ...],
    overwrite: bool,
    networks: dict[str, Any],
    scheduling: Options,
    **chosen: Any,
) -> None:
    """Run EchoSegnet (Sokolov, Bhosale, Zhu, 2024).

    What does not change between two runs is not computed again: another voting threshold trains nothing. With --masks
    oracle the truth of TRAIN frames is used, which submission.json says. With --scheduler dask every observation takes
    one GPU of a worker that offers it (docs/cluster.md).
    """
    from avs3d_bench.dataset import Dataset
    from baselines.echosegnet.run import all_devices, write_echosegnet, write_sweep

    options = _EchosegnetOptions(**chosen)
    if options.sweep and options.voting_threshold is not None:
        raise UsageError(
            "--sweep voting-threshold runs every threshold of the paper's Table 3: leave out --voting-threshold"
        )
    shared: dict[str, Any] = {
        "work": options.work or path.with_name(path.name + ".work"),
        "devices": options.devices or all_devices(),
        "only": only,
        "overwrite": overwrite,
        "progress": sys.stderr.isatty(),
        "scheduling": scheduling,
    }
    if options.masks == "owod-bind":
        from baselines.owod_bind.run import load_owod_bind, write_mask_folder

        # Runs with several controls can have one folder for their work; the masks' name is that of the last part.
        folder = Path(shared["work"]) / ("" if options.sound == "own" else options.sound) / "owod-bind"
        model = replace(load_owod_bind(device=shared["devices"][0], **networks), hearing=options.sound)
        write_mask_folder(Dataset(root), folder, model, only=only, progress=shared["progress"])
        options = replace(options, masks=str(folder))
    source = options.source()
    settings = options.settings(source)
    if options.sweep:
        for writer in write_sweep(Dataset(root), path, source, settings, **shared):
            _done(writer)
    else:
        _done(write_echosegnet(Dataset(root), path, source, settings, **shared))


@baseline.command(short_help="Answers to the questions of `avs3d export qa`, by ear.")
@click.option("--questions", type=PATH, metavar="DIR", required=True, help="What `avs3d export qa` wrote.")
@click.option("-o", "--output", type=OutputFile(_ANSWERS), metavar="FILE", required=True, help="Answers, JSON lines.")
@click.option(
    "--solver", type=click.Choice(["spatial", "blind", "deaf"]), default="spatial", show_default=True,
    help="Ears that know where marked objects are, the same without eyes, or eyes without ears.",
)  # fmt: skip
def questions(questions: Path, output: Path, solver: str) -> None:
    """Answer questions about what is heard from interaural delay and coherence. No model is asked.

    `avs3d qa-score` scores the answers. The same questions give the same bytes.
    """
    from baselines.questions import write_answers

    count = write_answers(solver, questions, output, progress=sys.stderr.isatty())
    click.echo(f"{output}: {count:,} answers of {solver}")


@dataclass(frozen=True)
class _EchosegnetOptions:
    """The options of `echosegnet` alone, as the command line names them."""

    masks: str
    instance: Any
    listener_weights: Path | None
    listener_answer: Any
    variant: Any
    no_aisrm: bool
    sound: Any
    voting_threshold: float | None
    iterations: int
    seed: int
    max_gaussians: int | None
    sweep: str | None
    work: Path | None
    devices: tuple[str, ...]

    def source(self) -> AnySource:
        """Of the train frames' masks.

        Raises:
            UsageError: if there is none of that name, or options of the listener are given for another one.
        """
        from baselines.echosegnet.sources import mask_source
        from baselines.oracle_errors import ErrorModel

        if self.masks != "listener":
            if self.listener_weights is not None or self.listener_answer is not None:
                raise UsageError("--listener-weights and --listener-answer need --masks listener")
            return mask_source(self.masks, instance=self.instance, errors=ErrorModel())
        from baselines.listener.packages import require

        require("baselines")
        from baselines.echosegnet.network_masks import NetworkMasks

        # Where a sound is misnamed, `category` has the wrong objects; AISRM chooses among all objects of a category.
        which: Any = self.listener_answer or ("direction" if self.variant == "spatial" else "category")
        if which == "direction":
            from baselines.direction_alone import load_direction_marker

            return NetworkMasks(load_direction_marker(self.listener_weights, hearing=self.sound))
        from baselines.listener.marks import load_marker

        return NetworkMasks(load_marker(self.listener_weights, which=which, hearing=self.sound))

    def settings(self, source: AnySource) -> Settings:
        """Of the pipeline, for these masks."""
        from baselines.echosegnet.densify import DensityControl
        from baselines.echosegnet.pipeline import Settings, default_threshold
        from baselines.echosegnet.train import TrainingSettings

        threshold = self.voting_threshold
        density = DensityControl(max_gaussians=self.max_gaussians)
        return Settings(
            variant=self.variant,
            refine=not self.no_aisrm,
            sound=self.sound,
            voting_threshold=default_threshold(self.variant, source) if threshold is None else threshold,
            training=TrainingSettings(iterations=self.iterations, seed=self.seed, density=density),
        )
