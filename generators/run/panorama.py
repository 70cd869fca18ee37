"""The six faces of a cube about the listener of a finished observation, rendered from the manifest in its dataset.

`avs3d export seld --video` finds `render_faces` through an entry point.
"""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.seld.panorama import U8, FaceRequest, Faces, face_poses
from generators.backends import vision_backend
from generators.core.folders import default_cache
from generators.observation.prepare import arranged, staged
from generators.observation.regenerate import stored_manifest, stored_plan
from generators.scenes.renderer import Renderer


def render_faces(request: FaceRequest) -> Faces:
    """Prepare the scene of an observation: what it gives renders the faces at the listener's place in a second.

    A camera's exposure and noise are left out: the faces are those of an ideal camera. Nothing is rendered again while
    neither the listener nor an object moves.

    Raises:
        UsageError: if the dataset has no manifest, or was made by other versions of the software.
    """
    dataset = Dataset(request.root)
    record = dataset.record
    if record is None:
        raise UsageError(f"{request.root}: no {layout.DATASET_JSON}, and so no manifest to render the home from")
    with tempfile.TemporaryDirectory(prefix="avs3d-panorama-") as folder:
        source = stored_manifest(record, request.manifest, Path(folder))
        plan = stored_plan(source, dataset[request.key], record, request.hrtf)
    backend = vision_backend(plan.options.renderer, plan.options.device)
    home, arrangement = arranged(plan, default_cache(), backend)
    stage = staged(home, arrangement)
    renderer = Renderer(stage, backend, room=plan.spec.room)

    @lru_cache(maxsize=4)
    def at(position: tuple[float, float, float], second: int) -> U8:
        views = [renderer.frame(pose, request.camera, second).rgb for pose in face_poses(position)]
        return np.stack(views)

    return lambda second: at(arrangement.poses[second].position, second if stage.moves else 0)
