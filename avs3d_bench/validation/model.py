"""The COLMAP model: against the record and against itself."""

from __future__ import annotations

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.colmap import ColmapModel
from avs3d_bench.geometry import rotation_angle
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.motion import moving_points

#: COLMAP's poses against observation.json: metres, degrees; sightings against projections: pixels.
POSE_TOLERANCE = (1e-4, 0.01)
REPROJECTION = 0.5
#: Sightings within the mask of an object that moves: a ray may pass a slit between pixels that all meet the object.
MOVING_SHARE = 1e-3


def check_model(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings, *, ours: bool
) -> None:
    """Hold `sparse/0` to itself, to the frames and to the poses of the record."""
    if not files.issuperset(layout.COLMAP_FILES):
        return  # already named as missing
    try:
        model = observation.colmap
    except Avs3dError as error:
        findings.take(layout.COLMAP, error)
        return
    cameras, images, points = layout.COLMAP_FILES
    expected = {f"{name}.png" for name in observation.frame_names}
    found = {image.name for image in model.images}
    if found - expected:
        text = f"{len(found - expected)} images are not in {layout.INPUT}/: {', '.join(sorted(found - expected)[:5])}"
        findings.add(images, text)
    if expected - found:
        text = f"{len(expected - found)} frames are not registered: {', '.join(sorted(expected - found)[:5])}"
        findings.add(images, text, "error" if ours else "note")
    try:
        errors = model.reprojection_errors()
    except Avs3dError as error:
        findings.take(points, error)
        return
    if not ours:
        return
    if record and record.moves:
        wrong, total = moving_points(observation, model)
        if wrong > max(2, MOVING_SHARE * total):
            text = f"{wrong} of {total} sightings lie on what moves; expected points on what stands still alone"
            findings.add(points, text)
    if len(model.points.ids) == 0:
        findings.add(points, "no points; 3D Gaussians start from them")
    far = errors[errors > REPROJECTION]
    if far.size:
        text = f"{far.size} of {errors.size} sightings are up to {far.max():.2f} px off the projection of their point"
        findings.add(points, f"{text}, expected at most {REPROJECTION} px")
    if record:
        _compare_model(model, record, cameras, images, findings)


def _compare_model(
    model: ColmapModel, record: ObservationRecord, cameras: str, images: str, findings: Findings
) -> None:
    for camera in model.cameras.values():
        if not _close(camera, record):
            findings.add(cameras, f"{camera} differs from the intrinsics of {layout.OBSERVATION_JSON}")
    poses = {f"{frame.name}.png": frame.pose for frame in record.frames}
    metres, degrees = POSE_TOLERANCE
    off: list[str] = []
    for image in model.images:
        pose = poses.get(image.name)
        if pose is None:
            continue
        shift = float(np.linalg.norm(np.subtract(image.pose.position, pose.position)))
        turn = rotation_angle(image.pose, pose)
        if shift > metres or turn > degrees:
            off.append(f"{image.name} ({shift:.3f} m, {turn:.2f}°)")
    if off:
        text = f"{len(off)} poses differ from {layout.OBSERVATION_JSON}: {', '.join(off[:4])}"
        findings.add(images, f"{text}; expected OpenCV cameras in a world with Y down")


def _close(camera: object, record: ObservationRecord) -> bool:
    names = ("width", "height", "fx", "fy", "cx", "cy")
    return all(abs(getattr(camera, name) - getattr(record.intrinsics, name)) <= 1e-6 for name in names)
