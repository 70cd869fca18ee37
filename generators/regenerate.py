"""Regenerates single frames of a finished dataset from the manifest stored in it, and compares their bytes.

Home, placement, path and source are made as for the whole observation. The pictures of a frame depend on nothing else,
so only the chosen frames are rendered. An acoustic engine may keep a random state between calls (SoundSpaces does), so
the impulse responses are computed in order from the first frame.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__, files, layout
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.provenance import SOFTWARE
from avs3d_bench.report import Problem
from avs3d_bench.schema import AcousticsRecord, DatasetRecord, ObservationRecord
from generators.acoustics.base import AcousticBackend
from generators.acoustics.clips import mono_clip
from generators.backends import observation_provenance
from generators.core.folders import default_cache
from generators.manifest import ManifestFile, read_manifest
from generators.observation import describe_frame, licence_record, prepare_observation
from generators.paths.stage import Stage, StageRenderer
from generators.plan import ObservationPlan, make_plans
from generators.receivers import Receivers, choose_receivers
from generators.recording.hearing import hear, hear_in_background
from generators.recording.output import FolderOutput
from generators.recording.scene_writer import SceneWriter
from generators.recording.stems import hear_sources
from generators.recording.writer import ObservationWriter
from generators.sound_scene import (
    contents_of,
    make_background,
    mix,
    next_second,
    other_backgrounds,
    prepare_scene,
    write_second,
)


def regenerate(
    root: Path,
    chosen: Mapping[str, Sequence[int]],
    manifest: Path | None,
    say: Callable[[str], None],
    hrtf: Path | None = None,
) -> Iterator[Problem]:
    """Regenerate frames and report every file and record that differs.

    Args:
        root: the dataset.
        chosen: key of each observation → indices of its frames.
        manifest: the manifest's file, needed if it names files relative to it; otherwise the text in dataset.json is
            used.
        say: called with a line about each observation before it is regenerated.
        hrtf: the SOFA file with which the dataset was made, if it was made with one.

    Raises:
        UsageError: if the dataset has no manifest, or was made by other versions of the software or with other options,
            or ``hrtf`` is missing or is another file.
        Avs3dError: if a file that the manifest names is missing.
    """
    dataset = Dataset(root)
    record = dataset.record
    if record is None:
        raise UsageError(f"{root}: no {layout.DATASET_JSON}, and so no manifest from which to regenerate frames")
    with tempfile.TemporaryDirectory(prefix="avs3d-regenerate-") as folder:
        source = _manifest(record, manifest, Path(folder))
        plans = {key: _plan(source, dataset[key], record, hrtf) for key in chosen}
        for key, indices in chosen.items():
            say(f"{key}: frames {', '.join(map(str, indices))}")
            compare = _compare_scene if plans[key].spec.is_sound_scene else _compare
            yield from compare(plans[key], dataset[key], tuple(indices), Path(folder))


def _manifest(record: DatasetRecord, manifest: Path | None, folder: Path) -> ManifestFile:
    if manifest is not None:
        source = read_manifest(manifest)
        if source.sha256 != record.manifest_sha256:
            raise UsageError(f"{manifest} is not the manifest from which the dataset was made (its sha256 differs)")
        return source
    path = folder / "manifest.yaml"
    files.write_bytes(path, record.manifest.encode())
    return read_manifest(path)


def _plan(source: ManifestFile, observation: Observation, dataset: DatasetRecord, hrtf: Path | None) -> ObservationPlan:
    """The plan of an observation as it was made.

    Raises:
        UsageError: if this version of the software would not make the same bytes.
    """
    record = observation.record
    if record is None or record.plan_sha256 is None:
        raise UsageError(
            f"{observation.path}: {layout.OBSERVATION_JSON} has no plan_sha256: it was not made by this toolkit"
        )
    camera = record.intrinsics
    plans = [
        make_plans(
            source,
            only=(observation.key,),
            vision=record.vision.backend,
            audio=record.acoustics.backend,
            frames=len(record.frames),
            size=camera.width,
            extras=extras,
            receivers=_receivers(observation.key, record.acoustics, hrtf),
            device=record.device.name if record.device else "cpu",
        )[0]
        for extras in _possible_extras(record)
    ]
    found = next((plan for plan in plans if plan.digest == record.plan_sha256), None)
    if found is None:
        raise UsageError(f"{observation.key}: {_difference(plans, record, dataset)}")
    return found


def _possible_extras(record: ObservationRecord) -> Iterator[set[str]]:
    """The options `--with` with which the observation may have been made; the likeliest first.

    The optional folders have the names of their options. Silence has neither responses nor stems, so that its files do
    not tell whether these were asked for.
    """
    found = {path.partition("/")[0] for path in record.files} & {layout.DEPTH, layout.RIRS, layout.STEMS}
    untold = (layout.RIRS, layout.STEMS) if record.is_sound_scene and not record.sources else ()
    for number in range(len(untold) + 1):
        yield from (found | set(more) for more in combinations(untold, number))


def _receivers(key: str, acoustics: AcousticsRecord, hrtf: Path | None) -> Receivers:
    """The receivers that heard an observation; the microphones of an array are in its record, a measured head is not.

    Raises:
        UsageError: if the file of the head is not given, or is another one.
    """
    head, order = acoustics.hrtf, acoustics.ambisonics.order if acoustics.ambisonics else None
    if head is None:
        return choose_receivers(acoustics.backend, ambisonics=order, array=acoustics.array)
    which = f"the head of {head.asset.removeprefix('hrtf:')} (sha256 {head.sha256[:12]}…)"
    if hrtf is None:
        raise UsageError(f"{key}: heard with {which}; name that file with --hrtf")
    found = choose_receivers(acoustics.backend, hrtf=hrtf, ambisonics=order, array=acoustics.array)
    if found.hrtf_sha256 != head.sha256:
        raise UsageError(f"{hrtf}: sha256 {found.hrtf_sha256[:12]}…, but {key} was heard with {which}; name that file")
    return found


def _difference(plans: Sequence[ObservationPlan], record: ObservationRecord, dataset: DatasetRecord) -> str:
    """Why none of the plans of this installation is the one that an observation was made from.

    With the recorded software in place of the installed one, a plan has the recorded digest if nothing else differs.
    """
    plan, said = plans[0], _other_versions(plans[0], record, dataset)
    software = f"by other software ({'; '.join(said)})" if said else ""
    then = _recorded_software(plan, record, dataset)
    if software and (then is None or any(replace(one, backends=then).digest == record.plan_sha256 for one in plans)):
        return f"was made {software}, so the bytes cannot be equal; use the versions that made the dataset"
    too = f", and {software}" if software else ""
    named = _named_files(plan)
    if named:
        return (
            f"was made with other files than those that the manifest names here ({', '.join(named)}){too}; "
            "restore them, beside the manifest or below --scans, and name it with --manifest"
        )
    return (
        f"was made from another manifest than the one in {layout.DATASET_JSON}, or with other options than "
        f"{layout.OBSERVATION_JSON} records{too}: one of them was changed"
    )


def _other_versions(plan: ObservationPlan, record: ObservationRecord, dataset: DatasetRecord) -> list[str]:
    """The software that differs from what is installed: ``name version, installed: version``."""
    there, here = dataset.provenance, observation_provenance(plan.vision, plan.audio, plan.device)
    pairs = [
        ("avs3d-bench", dataset.toolkit_version, __version__),
        *([("python", there.python, here.python)] if there else []),
        *(
            (name, version, here.libraries.get(name, "none"))
            for name, version in (there.libraries if there else {}).items()
        ),
        *((name, version, plan.backends.get(name, "none")) for name, version in record.made_with),
    ]
    said = [f"{name} {then}, installed: {now}" for name, then, now in dict.fromkeys(pairs) if then != now]
    if not said and (there is None or there.digest != here.digest):
        said = ["its sources differ" if there else "it does not record which"]
    return said


def _recorded_software(
    plan: ObservationPlan, record: ObservationRecord, dataset: DatasetRecord
) -> dict[str, str] | None:
    """The software of a plan (`backend_versions`) as dataset and observation record it; None: they do not."""
    there = dataset.provenance
    if there is None:
        return None
    settings = {name: value for name, value in plan.backends.items() if name.startswith("settings of ")}
    versions = {SOFTWARE: there.digest, "python": there.python, **there.libraries}
    return {"avs3d-bench": dataset.toolkit_version, **versions, **settings, **dict(record.made_with)}


def _named_files(plan: ObservationPlan) -> tuple[str, ...]:
    """The files and assets that the manifest names for an observation, sorted."""
    categories = {*plan.spec.heard, *plan.spec.objects}
    items = [item for table in (plan.sounds, plan.objects) for name in categories for item in table.get(name, ())]
    names = {item.file or item.asset for item in items}
    if plan.scan.source == "scan":
        names |= {plan.scan.file or f"scan {plan.spec.scan}", plan.scan.materials}
    return tuple(sorted(name for name in names if name))


def _compare(
    plan: ObservationPlan, observation: Observation, indices: tuple[int, ...], scratch: Path
) -> Iterator[Problem]:
    """Problems of one observation of part_1 or part_2."""
    record = observation.record
    assert record is not None
    ready = prepare_observation(plan, default_cache())
    seen, stage = ready.seen, ready.stage
    ready.sight.warm_up()
    said = {
        "notes": seen.notes,
        "source_position": stage.source(0).source_position,
        "instances": list(ready.instances),
        "sound": {"asset": ready.sound.asset, "licence": licence_record(ready.sound.licence)},
    }
    yield from _fields(observation.key, "", said, record)
    yield from _settings(observation.key, ready.engine, record)
    needed = {frame for index in indices for frame, _, _ in layout.mono_window(index, len(seen.poses))}
    clips: list[NDArray[np.float32]] = [np.zeros((2, layout.BINAURAL_SAMPLES), dtype=np.float32) for _ in seen.poses]
    made = FolderOutput(scratch / plan.key)
    with (
        ObservationWriter(made, **plan.optional_files) as writer,
        closing(StageRenderer(ready.sight, stage, ready.intrinsics)) as view,
        hear_in_background(hear(ready.listening), ready.listening.device) as sounds,
    ):
        for index, sound in zip(range(max(needed) + 1), sounds, strict=False):
            clip = clips[index] = sound.head.clip
            if index not in indices:
                continue
            pose = seen.poses[index]
            frame = view.render(index, pose)
            mask = frame.instance_ids == ready.sounding
            writer.add_pictures(index, frame, mask)
            writer.add_sound(index, clip, sound.head.response)
            writer.add_recordings(index, sound.others)
            described = describe_frame(index, pose, mask, clip, stage)
            yield from _fields(observation.key, f"frames[{index}]", {"frames": described}, record, index)
        for index in indices:
            writer.add_mono(index, mono_clip(clips, index))
        writer.add_sounding_mesh(stage.source(0).mesh)
        yield from _files(observation, made.folder)


def _compare_scene(
    plan: ObservationPlan, observation: Observation, indices: tuple[int, ...], scratch: Path
) -> Iterator[Problem]:
    """Problems of one observation of part_3.

    The level of the background follows from the sound of all frames, so that all of it is computed if there is one.
    """
    record = observation.record
    assert record is not None
    ready = prepare_scene(plan, default_cache())
    ready.sight.warm_up()
    poses = ready.seen.poses
    needed = {frame for index in indices for frame, _, _ in layout.mono_window(index, len(poses))}
    last = len(poses) if plan.spec.background else max(needed) + 1
    made = FolderOutput(scratch / plan.key)
    with (
        SceneWriter(made, contents_of(plan, ready), **plan.optional_files) as writer,
        closing(StageRenderer(ready.sight, Stage(ready.home, ready.seen.placements), ready.intrinsics)) as view,
        closing(hear_sources(ready.listenings(plan))) as seconds,
    ):
        heard = [next_second(plan, ready, writer, seconds, index) for index in range(last)]
        background, noise = make_background(plan, [[one.stem for one in second] for second in heard])
        said = {
            "notes": ready.seen.notes,
            "sources": [source.record for source in ready.sources],
            "background": background,
            "instances": list(ready.instances),
        }
        yield from _fields(observation.key, "", said, record)
        yield from _settings(observation.key, ready.engine, record)
        clips: list[NDArray[np.float32]] = [np.zeros((2, layout.BINAURAL_SAMPLES), dtype=np.float32) for _ in poses]
        for index in needed:
            clips[index], _ = mix(plan, ready, index, heard[index], noise)
        for index in indices:
            writer.add_pictures(index, view.render(index, poses[index]))
            _, described = write_second(plan, ready, writer, index, heard[index], noise)
            yield from _fields(observation.key, f"frames[{index}]", {"frames": described}, record, index)
            writer.add_mono(index, mono_clip(clips, index))
        if ready.sounding:
            writer.add_sounding_mesh(*(placement.mesh for placement in ready.sounding.values()))
        for index, others in enumerate(other_backgrounds(plan, background, last)):
            if index in indices:
                writer.add_other_background(index, others, f"{plan.key}, frame {index}")
        written = (layout.rirs_folder, layout.clips_folder, layout.stems_folder)
        for folder in {folder_of(receiver) for folder_of in written for receiver in (None, *plan.receivers.channels)}:
            for path in (made.folder / folder).rglob("frame_*"):
                if layout.frame_index(path.stem) not in indices:
                    path.unlink()  # of a frame that nobody asked for
        yield from _files(observation, made.folder)


def _settings(key: str, engine: AcousticBackend, record: ObservationRecord) -> Iterator[Problem]:
    """The settings of the engine that differ; what the SOFA file was called is not compared (`Receivers.identity`)."""
    there, here = record.acoustics.settings, engine.describe()
    names = sorted({*there, *here} - {"hrtf_file"})
    other = [name for name in names if name not in there or name not in here or there[name] != here[name]]
    if other:
        text = f"acoustics.settings differ from those of the engine: {', '.join(other)}"
        yield Problem("error", f"{key}/{layout.OBSERVATION_JSON}", text)


def _fields(
    key: str, where: str, made: Mapping[str, object], record: ObservationRecord, index: int | None = None
) -> Iterator[Problem]:
    """Fields of observation.json whose JSON differs from that of the regenerated values."""
    for name, value in made.items():
        there = getattr(record, name)
        if index is not None:
            there = there[index]
        if files.dump_json(value) != files.dump_json(there):
            text = f"{where or name} differs from the regenerated value"
            yield Problem("error", f"{key}/{layout.OBSERVATION_JSON}", text)


def _files(observation: Observation, made: Path) -> Iterator[Problem]:
    for path in sorted(path for path in made.rglob("*") if path.is_file()):
        name = path.relative_to(made).as_posix()
        try:
            same = files.read_bytes(observation.path / name) == files.read_bytes(path)
        except Avs3dError as error:
            text = str(error).removeprefix(f"{observation.path / name}: ")
            yield Problem("error", f"{observation.key}/{name}", text)
            continue
        if not same:
            yield Problem("error", f"{observation.key}/{name}", "differs from the regenerated file")
