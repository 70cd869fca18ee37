"""How marks of a network become one object in 3D: what the choices of EchoSegnet's ``spatial`` are worth.

    python -m benchmarks.lifted_choice lift data/marks-tune -o work/clouds --work work/lifted   # trains Gaussians
    python -m benchmarks.lifted_choice lift data/marks-tune -o work/clouds --work work/lifted --points depth  # on a CPU
    python -m benchmarks.lifted_choice table work/clouds                                        # seconds, no GPU

``lift`` marks the train frames of every observation with the listener, trains the Gaussians, and keeps a file for each
observation: the Gaussians that are marked or belong to the object that sounds, and what was heard. ``--points depth``
takes points of the depth pictures in place of Gaussians (a dataset made `--with depth`), ``--weights`` another network:
one that recognises less shows what a choice is worth where models are strange to the network. ``table`` makes
candidates of them and chooses one by sound, with several settings. A figure is the mean over observations of the IoU of
two sets of Gaussians: the chosen ones, and those for which most votes of the true masks are. A Gaussian counts as much
as it shows in the train frames. ``right`` is the share of the observations with an IoU above .5.

`clusters.MARKED_GAP` and `pipeline.MARKED_THRESHOLD` were chosen by this table on scenes_manifest/marks-tune.yaml, in
homes that nothing else is measured on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch
from numpy.typing import NDArray

from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import atomic_path
from avs3d_bench.scheduling.tasks import Context
from baselines.echosegnet import binaural, clusters, lift, spatial
from baselines.echosegnet.binaural import Cues
from baselines.echosegnet.cache import Stages
from baselines.echosegnet.densify import DensityControl
from baselines.echosegnet.jobs import all_devices, device_of, run_each, spread
from baselines.echosegnet.network_masks import KeptMasks, NetworkMasks
from baselines.echosegnet.pipeline import clips_of, reach
from baselines.echosegnet.rasteriser.contributions import contributions
from baselines.echosegnet.rasteriser.default import Rasteriser
from baselines.echosegnet.sound_scenes import work_folder
from baselines.echosegnet.sources import OracleMasks
from baselines.echosegnet.train import TrainingSettings
from baselines.echosegnet.training_stage import trained
from baselines.echosegnet.views import RegisteredView, input_views, load_views, train_views
from baselines.listener.losses import RIGHT_IOU
from baselines.listener.marks import load_marker
from benchmarks.depth_points import surface_points, visible_votes

Array = NDArray[np.float64]

#: Gaussians with a larger share of votes than this, of the network's or of the truth's, are kept in a file.
KEPT_SHARE = lift.MARKED
#: Least share of the votes.
THRESHOLDS = (0.3, 0.4, 0.5, 0.6)
#: Of all votes for a Gaussian, or of the share that well-marked Gaussians have (`lift.marked_share`).
SHARES_OF = ("all votes", "well-marked")
GAPS = (0.12, 0.2, 0.25, 0.3, 0.4)
SIZES = ("any", "of the category")


@dataclass(frozen=True, eq=False)
class Cloud:
    """What was lifted of one observation, and what was heard.

    Attributes:
        key: of the observation.
        category: class id of what the network marked; 0: nothing.
        points: (N, 3) metres, Y down.
        share: (N,) share of the network's votes for each point.
        truth: (N,) share of the true masks' votes.
        seen: (N,) how much it shows in the train frames, pixels.
        rotation: (V, 3, 3) of the train views.
        position: (V, 3).
        cues: of their sound.
    """

    key: str
    category: int
    points: Array
    share: Array
    truth: Array
    seen: Array
    rotation: Array
    position: Array
    cues: Cues

    def save(self, folder: Path) -> None:
        """Write the file of the observation."""
        path = folder / f"{self.key.replace('/', '-')}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        of_points = {name: getattr(self, name).astype(np.float32) for name in ("points", "share", "truth", "seen")}
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(
                file, key=self.key, category=self.category, rotation=self.rotation, position=self.position,
                **of_points, **{f"cues_{name}": value for name, value in vars(self.cues).items()},
            )  # fmt: skip

    @staticmethod
    def load(path: Path) -> Cloud:
        """Read such a file."""
        with np.load(path) as file:
            found: dict[str, Any] = {name: file[name] for name in file.files}
        cues = Cues(**{name[5:]: found.pop(name) for name in list(found) if name.startswith("cues_")})
        places = {name: found.pop(name).astype(np.float64) for name in ("points", "share", "truth", "seen")}
        return Cloud(
            str(found["key"]), int(found["category"]), **places,
            rotation=found["rotation"], position=found["position"], cues=cues,
        )  # fmt: skip

    def iou(self, chosen: NDArray[np.bool_]) -> float:
        """Of the chosen points (N,) with the true ones."""
        true = self.truth > 0.5
        union = self.seen[chosen | true].sum()
        return float(self.seen[chosen & true].sum() / union) if union else 0.0


@dataclass(frozen=True)
class Setting:
    """What is compared: share of the votes, of which votes, largest candidate, and gap between fragments of one (m)."""

    threshold: float
    of: str
    size: str
    gap: float

    def chosen(self, cloud: Cloud) -> NDArray[np.bool_]:
        """(N,) the points of a cloud that are said to sound."""
        unit = lift.marked_share(cloud.share, cloud.seen) if self.of == "well-marked" else 1.0
        index = np.flatnonzero(cloud.share > self.threshold * unit)
        out = np.zeros(len(cloud.points), np.bool_)
        if len(index):
            points = cloud.points[index]
            largest = clusters.LARGEST if self.size == "any" else clusters.largest_of(cloud.category)
            labels = clusters.candidates(points, eps=reach(points), gap=self.gap, largest=largest)
            choice = spatial.judge(points, labels, cloud.rotation, cloud.position, cloud.cues)
            out[index[choice.chosen]] = True
        return out


SETTINGS = tuple(Setting(*values) for values in product(THRESHOLDS, SHARES_OF, SIZES, GAPS))


@dataclass(frozen=True)
class Job:
    """One observation to be lifted; see `baselines.echosegnet.run.Job`. Without training: points of depth pictures."""

    root: Path
    key: str
    source: NetworkMasks
    training: TrainingSettings | None
    work: Path
    output: Path
    devices: tuple[str, ...]


def lift_one(context: Context, job: Job) -> str:
    """Make the file of one observation."""
    cloud = lifted(Observation(job.root, job.key), job, device_of(context, job.devices))
    cloud.save(job.output)
    context.report("done", f"{job.key}: {len(cloud.points):,} points")
    return job.key


def lifted(observation: Observation, job: Job, rasteriser: Rasteriser) -> Cloud:
    """The Gaussians of an observation, or points of its depth pictures, with the votes of network and truth."""
    stages = Stages(work_folder(job.work, observation))
    views = load_views(observation)
    seen = train_views(input_views(views))
    marks = job.source.found(observation, rasteriser.device, stages)
    masks = ((view, _ballot(view, marks)) for view in seen)
    if job.training is None:
        points = surface_points(seen)
        sums = visible_votes(points, masks)
    else:
        gaussians = trained(observation, views, rasteriser, job.training, stages)[0]
        points = gaussians.means.cpu().numpy().astype(np.float64)
        counted = torch.zeros(len(gaussians), 3, device=gaussians.device)
        for view, ballot in masks:
            counted += contributions(rasteriser, gaussians, view, torch.as_tensor(ballot).to(gaussians.means))
        sums = counted.cpu().numpy().astype(np.float64)
    inside, inside_truth, total = sums.T
    share, right = lift.vote_share(inside, total), lift.vote_share(inside_truth, total)
    kept = np.maximum(share, right) > KEPT_SHARE
    rotation, position = (np.stack([getattr(view, name) for view in seen]) for name in ("rotation", "position"))
    return Cloud(
        observation.key, marks.category(view.frame for view in seen), points[kept], share[kept], right[kept],
        total[kept], rotation, position, binaural.observe(clips_of(seen)),
    )  # fmt: skip


def _ballot(view: RegisteredView, marks: KeptMasks) -> NDArray[np.float32]:
    """(H, W, 3) what the network marks in a train frame, what sounds there, and 1."""
    own, true = marks.mask(view.frame), OracleMasks("sounding").mask(view.frame)
    return np.stack([own, true, np.ones_like(own)], axis=-1).astype(np.float32)


def table(clouds: Sequence[Cloud]) -> list[str]:
    """Lines of a Markdown table: a row for each setting."""
    parts = sorted({cloud.key.partition("/")[0] for cloud in clouds})
    heads = " | ".join(f"{part}: IoU | right" for part in parts)
    lines = [
        f"| share above | of | largest candidate | gap (m) | {heads} | IoU |",
        f"|{'---|' * (5 + 2 * len(parts))}",
    ]
    for setting in SETTINGS:
        found = {cloud.key: cloud.iou(setting.chosen(cloud)) for cloud in clouds}
        of_part = [[value for key, value in found.items() if key.startswith(f"{part}/")] for part in parts]
        shown = [f"{np.mean(values):.3f} | {np.mean(np.array(values) > RIGHT_IOU):.2f}" for values in of_part]
        mean = np.mean(list(found.values()))
        said = f"{setting.threshold:g} | {setting.of} | {setting.size} | {setting.gap:g}"
        lines.append(f"| {said} | {' | '.join(shown)} | {mean:.3f} |")
    return lines


@click.group()
def main() -> None:
    """Compare ways to make one object of a network's marks."""


@main.command("lift")
@click.argument("root", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the files.")
@click.option("--work", type=click.Path(path_type=Path), required=True, help="Folder of intermediate results.")
@click.option("--device", "devices", multiple=True, help="cpu, cuda:0, …; repeatable [all GPUs, else cpu].")
@click.option("--points", type=click.Choice(["gaussians", "depth"]), default="gaussians", show_default=True)
@click.option("--weights", type=click.Path(path_type=Path), default=None, help="Of the listener [the package's].")
@click.option("--iterations", default=800, show_default=True, help="Of the training of Gaussians.")
@click.option("--max-gaussians", default=300_000, show_default=True, help="Cap on the number of Gaussians.")
@click.option("--only", multiple=True, help="Shell pattern of observation keys; repeatable [all].")
def lift_command(
    root: Path,
    output: Path,
    work: Path,
    devices: tuple[str, ...],
    points: str,
    weights: Path | None,
    iterations: int,
    max_gaussians: int,
    only: tuple[str, ...],
) -> None:
    """Lift the marks of every observation of ROOT, and keep what `table` needs."""
    try:
        observations = Dataset(root).select(*only)
        scenes = next((one.key for one in observations if one.is_sound_scene), None)
        if scenes is not None:
            raise Avs3dError(f"{scenes}: a sound scene, which is lifted otherwise; leave it out (--only 'part_[12]/*')")
        keys = [observation.key for observation in observations]
        density = DensityControl(max_gaussians=max_gaussians)
        training = TrainingSettings(iterations=iterations, density=density) if points == "gaussians" else None
        workers = spread(devices or all_devices(), len(keys))
        source = NetworkMasks(load_marker(weights))
        jobs = [
            Job(root.absolute(), key, source, training, work.absolute(), output.absolute(), workers) for key in keys
        ]
        run_each(lift_one, jobs, workers, progress=True).check(work)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None


@main.command("table")
@click.argument("folder", type=click.Path(path_type=Path))
def table_command(folder: Path) -> None:
    """Print the figures of each setting."""
    clouds = [Cloud.load(path) for path in sorted(folder.glob("*.npz"))]
    if not clouds:
        raise click.ClickException(f"{folder}: no file .npz; make them with `python -m benchmarks.lifted_choice lift`")
    click.echo("\n".join(table(clouds)))


if __name__ == "__main__":
    # The module under its own name: worker processes find `lift_one` there.
    from benchmarks.lifted_choice import main as _main

    _main()
