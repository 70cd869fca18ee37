"""Differences between a finished observation and a run's options, for the message that refuses it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AcousticsRecord, ArrayRecord, DatasetRecord, HeadRecord, ObservationRecord
from avs3d_bench.errors import Avs3dError
from avs3d_bench.text.printable import readable
from generators.acoustics.receivers import Receivers
from generators.backends import observation_provenance
from generators.plan import ObservationPlan


def describe_mismatch(plan: ObservationPlan, record: ObservationRecord, read_index: Callable[[], DatasetRecord]) -> str:
    """How an observation that is not the plan's was made, and what to do: the end of the message that refuses it.

    Args:
        plan: what the run asks for.
        record: of the finished observation.
        read_index: reads the record of the dataset.

    Raises:
        Avs3dError: if a file that the plan names is missing: then this is the difference.
    """
    plan.check_files()
    known = describe_differences(plan, record)
    how = f"with other options or versions: {known}" if known else _other_source(plan, read_index)
    return f"was generated {how}; choose another folder with -o, or regenerate it with --remake {plan.key!r}"


def _other_source(plan: ObservationPlan, read_index: Callable[[], DatasetRecord]) -> str:
    """Whether the software is another one or the manifest is, if the dataset's index tells."""
    try:
        index = read_index()
    except Avs3dError:  # of a run that was interrupted
        return "from another manifest or by another version"
    there, here = index.provenance, observation_provenance(plan.options)
    if there is None or there.digest != here.digest:
        other = index.toolkit_version != __version__
        which = f"version {index.toolkit_version}, not {__version__}" if other else "its sources or libraries differ"
        return f"by other software ({which})"
    return "from another manifest, or with other contents of the files that it names"


def describe_differences(plan: ObservationPlan, record: ObservationRecord) -> str:
    """The options and versions that differ: ``--frames (recorded 120, asked 8), --audio (…)``; empty if none is known.

    Known is what observation.json records. Not all that the bytes depend on is there: the manifest's homes and files,
    for example, are only in the digest of the plan.

    Args:
        plan: what the run asks for.
        record: of the finished observation.
    """
    pairs = [*_options(plan, record), *_versions(plan, record)]
    return ", ".join(f"{name} (recorded {then}, asked {now})" for name, then, now in pairs if then != now)


def _options(plan: ObservationPlan, record: ObservationRecord) -> Iterator[tuple[str, str, str]]:
    """(option, recorded, asked) of every option."""
    acoustics, asked = record.acoustics, plan.options.receivers
    yield "--audio", acoustics.backend, plan.options.engine
    yield "--vision", record.vision.backend, plan.options.renderer
    yield "--device", record.device.name if record.device else "cpu", plan.options.device
    yield "--frames", str(len(record.frames)), str(plan.camera.frames)
    yield "--size", str(record.intrinsics.width), str(plan.camera.size)
    then, now = _head(acoustics), _chosen_head(asked)
    measured = acoustics.hrtf.sha256 if acoustics.hrtf else ""
    if (measured, acoustics.head) != (asked.hrtf_sha256, asked.drawn):
        yield "--hrtf", then, now
    order = acoustics.ambisonics.order if acoustics.ambisonics else 0
    yield "--with ambisonics", _order(order), _order(asked.ambisonics)
    if acoustics.array != asked.array:
        yield "--with array", *_arrays(acoustics.array, asked.array)
    folders = {path.partition("/")[0] for path in record.files}
    yield f"--with {layout.DEPTH}", _given(layout.DEPTH in folders), _given("depth" in plan.options.extras)
    if plan.spec.sources or not plan.spec.is_part_3:  # a silent scene has no responses, whatever was asked
        yield f"--with {layout.RIRS}", _given(layout.RIRS in folders), _given("rirs" in plan.options.extras)
    yield f"--with {layout.STEMS}", _given(layout.STEMS in folders), _given(plan.keeps_stems)
    yield "seed of the manifest", str(record.seed), str(plan.seed)


def _versions(plan: ObservationPlan, record: ObservationRecord) -> Iterator[tuple[str, str, str]]:
    """(name, recorded, installed) of the engines that both were made with."""
    for name, version in record.made_with:
        if name in plan.backends:
            yield f"version of {name}", version, plan.backends[name]


def _given(flag: bool) -> str:
    return "with" if flag else "without"


def _order(order: int) -> str:
    return f"order {order}" if order else "none"


def _head(acoustics: AcousticsRecord) -> str:
    head = acoustics.hrtf
    if head is None:
        return _of_family(acoustics.head)
    return f"{head.asset.removeprefix('hrtf:')}, sha256 {head.sha256[:12]}…"


def _chosen_head(receivers: Receivers) -> str:
    if receivers.hrtf is None:
        return _of_family(receivers.drawn)
    return f"{readable(receivers.hrtf.name)}, sha256 {receivers.hrtf_sha256[:12]}…"


def _of_family(head: HeadRecord | None) -> str:
    return "none" if head is None else f"a head of the family for {head.family}, radius {head.radius:g} m"


def _arrays(then: ArrayRecord | None, now: ArrayRecord | None) -> tuple[str, str]:
    """Both arrays in words that differ: the number of microphones, or the first one that is another."""
    counts = [f"{array.channels} microphones" if array else "none" for array in (then, now)]
    if then is None or now is None or counts[0] != counts[1]:
        return counts[0], counts[1]
    pairs = zip(then.microphones, now.microphones, strict=True)
    old, new = next((old, new) for old, new in pairs if old != new)
    return f"{old.name} at {list(old.position)}", f"{new.name} at {list(new.position)}"
