"""The first stage: an observation's Gaussians, trained once and kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from avs3d_bench.dataset import Observation
from avs3d_bench.formats.files import read_json, write_json
from baselines.echosegnet.cache import Stages, digest, inputs_digest, software_digest
from baselines.echosegnet.gaussians import Gaussians, read_ply, write_ply
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.train import Checkpoint, Pace, Progress, TrainingSettings, TrainingState, train
from baselines.echosegnet.views import RegisteredView, load_points, train_views

#: On a CPU, a hundred iterations may take an hour: then a report comes after this time (s).
_REPORT_SECONDS = 5.0


def trained(
    observation: Observation,
    views: Sequence[RegisteredView],
    rasteriser: Rasteriser,
    settings: TrainingSettings,
    stages: Stages,
    progress: Progress | None = None,
) -> tuple[Gaussians, str, int | None]:
    """Train an observation's Gaussians, or find them on disk.

    Returns:
        The Gaussians on the rasteriser's device, the key of their file, and the iteration at which memory ended their
        growth (None: it did not).
    """
    software = software_digest(rasteriser)
    key = digest({"inputs": inputs_digest(observation), "training": asdict(settings), "software": software})
    path, record = stages.path("gaussians", key, ".ply"), stages.path("gaussians", key, ".json")
    if path.exists():
        full_at = read_json(record).get("memory_full_at") if record.exists() else None
        return read_ply(path).to(rasteriser.device), key, full_at
    points, colours = load_points(observation)
    checkpoint = stages.path("training", key, ".pt")
    last: list[TrainingState] = []

    def note(report: TrainingState) -> None:
        last[:] = [report]
        if progress is not None:
            progress(report)

    gaussians = train(
        train_views(views), points, colours, rasteriser, settings,
        checkpoint=Checkpoint(checkpoint), progress=note, pace=Pace(seconds=_REPORT_SECONDS),
    )  # fmt: skip
    full_at = last[0].full_at if last else None
    write_json(record, {"gaussians": len(gaussians), "memory_full_at": full_at})
    write_ply(path, gaussians)
    checkpoint.unlink(missing_ok=True)
    return gaussians.to(rasteriser.device), key, full_at
