"""Tasks of a run: build and light a home, make an observation. They run in any process, on any machine."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import missing_extra
from avs3d_bench.scheduling.errors import UnfitError
from avs3d_bench.scheduling.lock import holder_of
from avs3d_bench.scheduling.software import check_software
from avs3d_bench.scheduling.tasks import Context
from generators.backends import backend_versions, warm_up
from generators.options import EngineOptions
from generators.plan import ObservationPlan
from generators.run.formats import FOLDERS, DatasetFormat, find_finished

#: What this process has loaded.
_warm: set[EngineOptions] = set()
#: How often a worker looks for the run's folder before it says that it cannot see it, and seconds in between.
_LOOKS, _PAUSE = 5, 1.0


@dataclass(frozen=True)
class RunTarget:
    """Where a run writes.

    Attributes:
        root: the dataset's folder.
        cache: folder of baked homes.
        token: of the run that holds ``root``, where workers may be on other machines; None: this machine.
        form: of what is written.
        replaces: whether the observation takes the place of a finished one.
    """

    root: Path
    cache: Path
    token: str | None = None
    form: DatasetFormat = FOLDERS
    replaces: bool = False


def prepare(context: Context, plan: ObservationPlan, place: RunTarget, threads: int) -> None:
    """Build and light the plan's home into the cache, unless it lies there; compile what is slow the first time."""
    with _fit(plan, place):
        from generators.homes.store import prepare_home

        context.report("home", plan.spec.scan)
        prepare_home(plan, place.cache, workers=threads)
        _warm_up(plan.options)


def warm_up_worker(_: Context, options: EngineOptions) -> None:
    """Import and compile what observations need, while their homes are built elsewhere."""
    _warm_up(options)


def make_observation(context: Context, plan: ObservationPlan, place: RunTarget) -> str:
    """Make one observation; the last ones of a run share the cores that have nothing else to do.

    Returns:
        a line about it.
    """
    with _fit(plan, place):
        from avs3d_bench.inspector.listing import describe_sound
        from generators.observation.generate import generate_observation

        _warm_up(plan.options)
        started = time.perf_counter()
        context.report("start", str(plan.camera.frames))

        def on_frame(index: int) -> None:
            context.report("frame", str(index))

        record = generate_observation(
            plan,
            place.root,
            place.cache,
            on_frame,
            cores=context.cores,
            pictures=_pictures(plan, place),
            output=partial(place.form.output, place.root, replaces=place.replaces),
        )
    what = describe_sound(record) or record.category
    t30 = f"T30 {record.acoustics.t30:.2f} s, " if record.acoustics.t30 else ""
    visible = sum(frame.visible_pixels > 0 for frame in record.frames)
    return (
        f"{what}, {len(record.instances)} objects, visible in {visible} of {len(record.frames)} frames, "
        f"{t30}{time.perf_counter() - started:.0f} s"
    )


def _pictures(plan: ObservationPlan, place: RunTarget) -> Path | None:
    """The sibling or original whose pictures ``plan`` can have; None if it is not there, or not whole."""
    if plan.first is None:
        return None
    try:
        record = find_finished(place.form, place.root, plan.first)
        whole = record is not None and not place.form.find_damage(place.root, record)
    except Avs3dError:
        return None
    return place.root / plan.first.key if whole else None


def _warm_up(options: EngineOptions) -> None:
    """Load what is slow the first time, once in a process: heads of one family need the same."""
    kind = replace(options, receivers=replace(options.receivers, drawn=None))
    if kind not in _warm:
        warm_up(options)
        _warm.add(kind)


@contextmanager
def _fit(plan: ObservationPlan, place: RunTarget) -> Iterator[None]:
    """Do the work in this only where it leads to the run's own bytes in the run's own folder.

    Raises:
        UnfitError: if this process has other versions than the run, lacks a package, or sees another folder.
    """
    try:
        if place.token is not None:
            check_software(_versions(plan.options), plan.backends)
            _check_folder(place)
        yield
    except ModuleNotFoundError as error:
        where = "" if place.token is None else f"{socket.gethostname()}: "
        raise UnfitError(where + missing_extra(error, "generators")) from error


@lru_cache(maxsize=4)
def _versions(options: EngineOptions) -> dict[str, str]:
    return backend_versions(options)


def _check_folder(place: RunTarget) -> None:
    for _ in range(_LOOKS):
        holder = holder_of(place.root)
        if holder is not None and holder.token == place.token:
            return
        time.sleep(_PAUSE)
    raise UnfitError(
        f"{place.root}: on {socket.gethostname()} this is another folder, or none; choose one with -o that every "
        "machine of the cluster shares"
    )
