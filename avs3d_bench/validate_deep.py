"""The deep checks of one observation: every file is decoded and held against its record, its twin files and physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.colmap import ColmapModel
from avs3d_bench.dataset import Frame, Observation, Split
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import rotation_angle
from avs3d_bench.ply import Ply
from avs3d_bench.report import Severity
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.silhouette import silhouette
from avs3d_bench.validate_motion import moving_points
from avs3d_bench.validate_structure import Findings

#: A channel whose RMS is below this is silent (−120 dB of full scale).
SILENCE = 1e-6
#: Sound that reaches full scale counts as clipped.
FULL_SCALE = 1.0
#: Levels in observation.json: relative, and absolute for 16-bit files.
RMS_TOLERANCE = (1e-3, 2e-5)
#: The louder ear is on the source's side: over frames with line of sight and |azimuth| between these, degrees …
ILD_AZIMUTHS = (20.0, 160.0)
#: … in at least this share of them.
ILD_SHARE = 0.95
#: Below this share the sound is wrong, and not merely reflected.
ILD_LEAST = 0.8
#: Pixels by which the projected mesh is widened before the mask must lie inside it.
SILHOUETTE_MARGIN = 2
#: COLMAP's poses against observation.json: metres, degrees; sightings against projections: pixels.
POSE_TOLERANCE = (1e-4, 0.01)
REPROJECTION = 0.5
#: Sightings within the mask of an object that moves: a ray may pass a slit between pixels that all meet the object.
MOVING_SHARE = 1e-3
#: gt_3d against the bounds of the record, and depth/ against gt_3d: metres.
BOUNDS_TOLERANCE = 5e-3

_T = TypeVar("_T", covariant=True)


class _Reader(Protocol[_T]):
    def __call__(self) -> _T: ...


def _read(findings: Findings, files: set[str], path: str, reader: _Reader[_T]) -> _T | None:
    """What ``reader`` gives for a file that is there; its complaint becomes a problem."""
    if path not in files:
        return None  # already named as missing
    try:
        return reader()
    except Avs3dError as error:
        findings.take(path, error)
        return None


def check_contents(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings, *, ours: bool
) -> None:
    """All deep checks; problems go to ``findings``.

    Args:
        observation: what to check.
        record: its observation.json, None for the official release (or where it cannot be read).
        files: the files found, relative.
        findings: where problems go.
        ours: a tree of this toolkit; else what we ask beyond the release is not asked.
    """
    if record:
        _check_hashes(observation, record, files, findings)
    try:
        frames = observation.frames
    except Avs3dError:
        return  # no or odd pictures: already named
    mesh = _check_mesh(observation, record, files, findings)
    for frame in frames:
        _check_pictures(frame, record, mesh, files, findings)
        if ours:
            _check_twin(frame, files, findings)
    _check_visibility(observation, record, files, findings)
    clips = [_check_clip(frame, files, findings) for frame in frames]
    _check_levels(frames, clips, findings)
    try:
        splits = observation.splits
    except Avs3dError:
        splits = {}  # already named
    for position, frame in enumerate(frames):
        _check_mono(frames, clips, splits, position, files, findings, severity="error" if ours else "warning")
        path = layout.rir_path(frame.index)
        _read(findings, files, path, frame.impulse_response)
    _check_colmap(observation, record, files, findings, ours=ours)


def _check_hashes(observation: Observation, record: ObservationRecord, files: set[str], findings: Findings) -> None:
    known: dict[tuple[int, int], str] = {}  # images/ are hard links to input/: hash them once
    for path, expected in record.files.items():
        if path not in files:
            continue
        status = (observation.path / path).stat()
        inode = (status.st_dev, status.st_ino)
        if inode not in known:
            try:
                known[inode] = media.sha256_file(observation.path / path)
            except Avs3dError as error:
                findings.take(path, error)
                continue
        if known[inode] != expected:
            text = (
                f"sha256 {known[inode][:12]}… differs from {layout.OBSERVATION_JSON} ({expected[:12]}…): file changed"
            )
            findings.add(path, text)


def _check_mesh(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings
) -> Ply | None:
    mesh = _read(findings, files, layout.SOUNDING_OBJECT, observation.mesh)
    if mesh is None:
        return None
    if len(mesh.faces) == 0:
        findings.add(layout.SOUNDING_OBJECT, "no faces; expected a triangle mesh")
        return None
    if record:
        found = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
        off = float(np.abs(found - np.asarray(record.sounding.bounds)).max())
        if off > BOUNDS_TOLERANCE:
            text = f"bounds differ from those of instance {record.sounding.id} in the record by {off:.3f} m"
            findings.add(layout.SOUNDING_OBJECT, text)
            return None  # one wrong mesh would make every mask look wrong
    return mesh


def _check_pictures(
    frame: Frame, record: ObservationRecord | None, mesh: Ply | None, files: set[str], findings: Findings
) -> None:
    paths = {
        folder: f"{folder}/{frame.name}.png"
        for folder in (layout.INPUT, layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS, layout.DEPTH)
    }
    rgb = _read(findings, files, paths[layout.INPUT], frame.rgb)
    if rgb is not None and int(rgb.max()) == int(rgb.min()):
        findings.add(paths[layout.INPUT], f"every value is {int(rgb.min())}: an empty picture", "warning")
    mask = _read(findings, files, paths[layout.SEMANTIC_MASKS], frame.mask)
    ids = _read(findings, files, paths[layout.INSTANCE_MASKS], frame.instance_ids)
    depth = _read(findings, files, paths[layout.DEPTH], frame.depth)
    if record is None:
        return
    size = (record.intrinsics.height, record.intrinsics.width)
    if ids is not None:
        strange = sorted(set(np.unique(ids).tolist()) - {0} - {instance.id for instance in record.instances})
        if strange:
            text = f"ids {strange} are no instances of {layout.OBSERVATION_JSON}"
            findings.add(paths[layout.INSTANCE_MASKS], text)
    if mask is None or mask.shape != size:
        return
    if ids is not None and ids.shape == size:
        differ = int((mask != (ids == record.sounding.id)).sum())
        if differ:
            text = f"{differ} pixels differ from id {record.sounding.id} in {paths[layout.INSTANCE_MASKS]}"
            findings.add(paths[layout.SEMANTIC_MASKS], text)
    area, entry = int(mask.sum()), frame.record
    if entry and entry.visible_pixels != area:
        text = f"{area} pixels are marked, visible_pixels of {frame.name} is {entry.visible_pixels}"
        findings.add(paths[layout.SEMANTIC_MASKS], text)
    if entry and mesh is not None and area:
        vertices = record.to_frame(entry, mesh.vertices).astype(np.float32)
        reach = silhouette(frame.observation.intrinsics, entry.pose, vertices, mesh.faces, SILHOUETTE_MARGIN)
        outside = int((mask & ~reach).sum())
        if outside:
            text = f"{outside} of {area} marked pixels lie outside the projected sounding object"
            findings.add(paths[layout.SEMANTIC_MASKS], text)
        elif depth is not None and depth.shape == size:
            z = -entry.pose.to_camera(vertices)[:, 2]
            seen = depth[mask]
            wrong = int(((seen < z.min() - BOUNDS_TOLERANCE) | (seen > z.max() + BOUNDS_TOLERANCE)).sum())
            if wrong:
                text = f"{wrong} of {area} pixels of the sounding object are nearer or farther than its mesh"
                findings.add(paths[layout.DEPTH], text)


def _check_visibility(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings
) -> None:
    """Where the line to the source is free and ends well inside the picture, something of the object should show."""
    if record is None:
        return
    camera, cases, empty = observation.intrinsics, 0, list[str]()
    for frame in record.frames:
        (pixel,), (depth,) = camera.project(frame.pose, np.asarray([record.source_at(frame)]))
        border = 0.02 * camera.width
        inside = depth > 0 and border <= pixel[0] <= camera.width - border
        if inside and border <= pixel[1] <= camera.height - border and frame.line_of_sight:
            cases += 1
            if frame.visible_pixels == 0:
                empty.append(frame.name)
    if len(empty) > max(1, 0.1 * cases):
        text = f"the source is in view and in line of sight in {cases} frames, but the mask is empty in {len(empty)}"
        findings.add(layout.SEMANTIC_MASKS, f"{text} of them: {', '.join(empty[:5])}", "warning")


def _check_twin(frame: Frame, files: set[str], findings: Findings) -> None:
    """images/ are bit for bit the pictures of input/."""
    first, second = f"{layout.INPUT}/{frame.name}.png", f"{layout.IMAGES}/{frame.name}.png"
    if first not in files or second not in files:
        return
    a, b = frame.observation.path / first, frame.observation.path / second
    if not a.samefile(b) and media.read_bytes(a) != media.read_bytes(b):
        findings.add(second, f"is not the same picture as {first}")


@dataclass(frozen=True, eq=False)
class _Sound:
    samples: NDArray[np.float32]
    rms: NDArray[np.float64]


def _sound_problems(path: str, samples: NDArray[np.float32], findings: Findings) -> NDArray[np.float64]:
    """Clipping and silence; returns the RMS of each channel."""
    peak = float(np.abs(samples).max(initial=0.0))
    if peak >= FULL_SCALE:
        findings.add(path, f"clipped: the peak is {peak:.3f} of full scale")
    rms = np.sqrt(np.mean(np.square(samples.astype(np.float64)), axis=1))
    quiet = [f"channel {channel}" for channel, level in enumerate(rms) if level < SILENCE]
    if quiet:
        where = "silent" if len(quiet) == len(rms) else f"silent in {', '.join(quiet)}"
        findings.add(path, f"{where} (RMS below {SILENCE:g})")
    return np.asarray(rms)


def _check_clip(frame: Frame, files: set[str], findings: Findings) -> _Sound | None:
    path = layout.audio_path(layout.BINAURAL, frame.index)
    clip = _read(findings, files, path, lambda: media.read_wav(frame.observation.path / path))
    if clip is None or clip.samples.shape != (2, layout.BINAURAL_SAMPLES):
        return None  # format: named by the shallow check
    rms = _sound_problems(path, clip.samples, findings)
    entry = frame.record
    if entry:
        relative, absolute = RMS_TOLERANCE
        for side, found, noted in zip(("left", "right"), rms, (entry.rms_left, entry.rms_right), strict=True):
            if abs(found - noted) > relative * noted + absolute:
                findings.add(path, f"RMS {side} is {found:.6f}, rms_{side} of {frame.name} is {noted:.6f}")
    return _Sound(clip.samples, rms)


def _check_levels(frames: tuple[Frame, ...], clips: list[_Sound | None], findings: Findings) -> None:
    """The louder ear is on the source's side: a statement about the observation, single frames may differ."""
    low, high = ILD_AZIMUTHS
    judged, wrong = 0, list[str]()
    for frame, clip in zip(frames, clips, strict=True):
        entry = frame.record
        if entry is None or clip is None or not entry.line_of_sight or not low < abs(entry.azimuth) < high:
            continue
        judged += 1
        if (clip.rms[1] - clip.rms[0]) * entry.azimuth <= 0:
            wrong.append(layout.audio_name(frame.index))
    if len(wrong) > max(2.0, (1 - ILD_SHARE) * judged):
        text = (
            f"the louder ear is on the wrong side of the source in {len(wrong)} of {judged} frames with line of sight "
            f"({', '.join(wrong[:5])}…); expected it right in {ILD_SHARE:.0%}"
        )
        # Reflections of a live room may win in some frames; they do not in many.
        if len(wrong) > (1 - ILD_LEAST) * judged:
            findings.add(layout.BINAURAL, f"{text}: are the channels swapped?")
        else:
            findings.add(layout.BINAURAL, text, severity="warning")


def _check_mono(
    frames: tuple[Frame, ...],
    clips: list[_Sound | None],
    splits: Mapping[str, Split],
    position: int,
    files: set[str],
    findings: Findings,
    *,
    severity: Severity,
) -> None:
    """The clip's own mix stands at 0, 0.5 or 1 s; what is beside it in a train frame is not a test frame's."""
    frame, own = frames[position], clips[position]
    path = layout.audio_path(layout.MONO, frame.index)
    clip = _read(findings, files, path, lambda: media.read_wav(frame.observation.path / path))
    if clip is None or clip.samples.shape != (1, layout.MONO_SAMPLES):
        return
    _sound_problems(path, clip.samples, findings)
    if own is None:
        return
    mono, mix, n = clip.samples[0], own.samples.mean(axis=0), layout.BINAURAL_SAMPLES
    # 16-bit files are rounded, once here and once there.
    tolerance = 1e-4 * float(np.abs(mix).max()) + 6.2e-5

    def same(first: NDArray[np.float32], second: NDArray[np.float32]) -> bool:
        return bool(np.abs(first - second).max(initial=0.0) <= tolerance)

    offsets = [at for at in (0, n // 2, n) if same(mono[at : at + n], mix)]
    if not offsets:
        findings.add(path, f"does not hold the mix of {layout.audio_path(layout.BINAURAL, frame.index)}", severity)
        return
    if splits.get(frame.name) != "train":
        return
    leaks: list[str] = []
    for at in offsets:
        borrowed = []
        for step, part in ((-1, mono[:at]), (1, mono[at + n :])):
            other = position + step
            if not part.size or not 0 <= other < len(frames) or splits.get(frames[other].name) != "test":
                continue
            neighbour = clips[other]
            if neighbour is None:
                continue
            theirs = neighbour.samples.mean(axis=0)
            if same(part, theirs[-part.size :] if step < 0 else theirs[: part.size]):
                borrowed.append(frames[other].name)
        if not borrowed:
            return
        leaks = borrowed
    findings.add(path, f"a train clip borrows from the test frame {', '.join(leaks)}", severity)


def _check_colmap(
    observation: Observation, record: ObservationRecord | None, files: set[str], findings: Findings, *, ours: bool
) -> None:
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
            text = f"{wrong} of {total} sightings lie on the moving object; expected points on what stands still alone"
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
