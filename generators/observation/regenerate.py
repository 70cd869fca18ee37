"""Regenerates single frames of a finished dataset from the manifest stored in it, and compares their bytes.

Home, placement, path and source are made as for the whole observation. The pictures of a frame depend on nothing else,
so only the chosen frames are rendered. An acoustic engine may keep a random state between calls (SoundSpaces does), so
the impulse responses are computed in order from the first frame.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path, PurePath
from typing import cast

from avs3d_bench import __version__
from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AcousticsRecord, DatasetRecord, ObservationRecord
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.runtime.provenance import SOFTWARE
from generators.acoustics.clips import GAIN
from generators.acoustics.heads import FAMILIES
from generators.acoustics.receivers import Receivers, choose_receivers
from generators.backends import observation_provenance, vision_backend
from generators.core.folders import default_cache
from generators.library.lock import LOCK_NAME
from generators.manifest.reading import ManifestFile, read_manifest
from generators.observation.generate import generate_observation
from generators.observation.output import MemoryOutput
from generators.options import Audio, Extra, GenerateOptions, Vision, further_options
from generators.plan import ObservationPlan, make_plans

#: Fields of observation.json that are not compared as a whole: they depend on frames that are not made.
_OF_FRAMES = frozenset({"acoustics", "frames", "files", "sizes"})


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
            or ``hrtf`` is missing or is another file, or the manifest names files and is not given.
        Avs3dError: if a file that the manifest names is missing.
    """
    dataset = Dataset(root)
    record = dataset.record
    if record is None:
        raise UsageError(f"{root}: no {layout.DATASET_JSON}, and so no manifest from which to regenerate frames")
    with tempfile.TemporaryDirectory(prefix="avs3d-regenerate-") as folder:
        source = stored_manifest(record, manifest, Path(folder))
        try:
            plans = {key: stored_plan(source, dataset[key], record, hrtf) for key in chosen}
        except Avs3dError as error:
            if folder not in str(error):
                raise
            raise UsageError(
                f"{root}: its manifest names files beside it, or assets of the {LOCK_NAME} beside it; "
                "name the file of the manifest with --manifest"
            ) from error
        for key, indices in chosen.items():
            say(f"{key}: frames {', '.join(map(str, indices))}")
            yield from _compare(plans[key], dataset[key], tuple(indices))


def stored_manifest(record: DatasetRecord, manifest: Path | None, folder: Path) -> ManifestFile:
    """The manifest from which a dataset was made, as a file.

    Args:
        record: dataset.json.
        manifest: the manifest's file, if it names files beside it; None: the text in ``record``.
        folder: where that text is written.

    Raises:
        UsageError: if ``manifest`` is another one.
    """
    if manifest is not None:
        source = read_manifest(manifest)
        if source.sha256 != record.manifest_sha256:
            raise UsageError(f"{manifest} is not the manifest from which the dataset was made (its sha256 differs)")
        return source
    path = folder / "manifest.yaml"
    files.write_bytes(path, record.manifest.encode())
    return read_manifest(path)


def stored_plan(
    source: ManifestFile, observation: Observation, dataset: DatasetRecord, hrtf: Path | None
) -> ObservationPlan:
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
    options = GenerateOptions(
        only=(observation.key,),
        vision=cast(Vision, record.vision.backend),
        audio=cast(Audio, record.acoustics.backend),
        device=record.device.name if record.device else "cpu",
        receivers=_receivers(observation.key, record.acoustics, hrtf),
        frames=len(record.frames),
        size=camera.width,
        **further_options(record.options or {}),
    )
    plans = [
        make_plans(source, replace(options, extras=cast(tuple[Extra, ...], tuple(extras))))[0]
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
    untold = (layout.RIRS, layout.STEMS) if record.is_part_3 and not record.sources else ()
    for number in range(len(untold) + 1):
        yield from (found | set(more) for more in combinations(untold, number))


def _receivers(key: str, acoustics: AcousticsRecord, hrtf: Path | None) -> Receivers:
    """The receivers that heard an observation; the microphones of an array are in its record, a measured head is not.

    Raises:
        UsageError: if the file of the head is not given, or is another one.
    """
    head, order = acoustics.hrtf, acoustics.ambisonics.order if acoustics.ambisonics else None
    if head is None:
        found = choose_receivers(acoustics.backend, ambisonics=order, array=acoustics.array)
        word = next((word for word, split in FAMILIES.items() if acoustics.head and acoustics.head.family == split), "")
        return replace(found, family=word, chosen=True)
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
    there, here = dataset.provenance, observation_provenance(plan.options)
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
        names |= {plan.scan.file or plan.scan.asset or f"scan {plan.spec.scan}", plan.scan.materials}
    return tuple(sorted(name for name in names if name))


def _compare(plan: ObservationPlan, observation: Observation, indices: tuple[int, ...]) -> Iterator[Problem]:
    """Problems of one observation."""
    record = observation.record
    assert record is not None
    vision_backend(plan.options.renderer, plan.options.device).warm_up()
    made = ComparingOutput(observation.path, indices)
    lowered = round(20 * math.log10(GAIN / record.acoustics.gain))
    generate_observation(plan, observation.path.parent, default_cache(), output=lambda _: made, lowered_db=lowered)
    again = made.record
    compared = [name for name in ObservationRecord.model_fields if name not in _OF_FRAMES]
    yield from _fields(observation.key, "", {name: getattr(again, name) for name in compared}, record)
    yield from _settings(observation.key, again.acoustics.settings, record)
    for index in indices:
        yield from _fields(observation.key, f"frames[{index}]", {"frames": again.frames[index]}, record, index)
    for name, text in sorted(made.differences.items()):
        yield Problem("error", f"{observation.key}/{name}", text)


class ComparingOutput(MemoryOutput):
    """An output that keeps the files of some frames in memory and compares them with those of a finished observation.

    Args:
        folder: of the finished observation.
        indices: of the frames.

    Attributes:
        differences: name of each file that differs → how.
        record: of the regenerated observation; what follows from other frames is missing in it.
    """

    record: ObservationRecord

    def __init__(self, folder: Path, indices: Collection[int]) -> None:
        super().__init__()
        self._folder = folder
        self._chosen = {name for index in indices for name in (layout.frame_name(index), layout.audio_name(index))}
        self.differences: dict[str, str] = {}

    def keeps(self, name: str) -> bool:
        """Files of the chosen frames, the mesh and the picture from above; what follows from all frames is not made."""
        return PurePath(name).stem in self._chosen or name in (layout.SOUNDING_OBJECT, layout.TOP_VIEW)

    def where(self, name: str) -> Path:
        """The file of the finished observation."""
        return self._folder / name

    def share(self, sibling: Path) -> dict[str, str]:
        """Nothing is taken over: everything is made."""
        return {}

    def finish(self, record: ObservationRecord) -> None:
        """Compare the files."""
        self.record = record
        for name, data in self._files.items():
            try:
                same = files.read_bytes(self._folder / name) == data
            except Avs3dError as error:
                self.differences[name] = str(error).removeprefix(f"{self._folder / name}: ")
                continue
            if not same:
                self.differences[name] = "differs from the regenerated file"


def _settings(key: str, here: Mapping[str, object], record: ObservationRecord) -> Iterator[Problem]:
    """The settings of the engine that differ; what the SOFA file was called is not compared (`Receivers.identity`)."""
    there = record.acoustics.settings
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
