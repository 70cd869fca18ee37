"""Reads every file that a run's observations may use, before the first home is built: what is broken stops the run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.gaussian_ply import check_gaussians
from generators.acoustics.materialfile import read_material_file
from generators.assets.meshcheck import check_file
from generators.library.store import check_asset
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import AssetSpec, ObjectSpec, SoundSpec
from generators.plan import ObservationPlan

#: (field of the manifest, what is wrong with it)
_Fault = tuple[tuple[str | int, ...], Avs3dError]


def check_files(source: ManifestFile, plans: Sequence[ObservationPlan]) -> None:
    """Read the objects and sounds of ``plans`` as generation does; of a scan, its materials and the heads of its files.

    Assets of the store were read when they were imported: their hash is compared. A scan that is not there at all is
    no fault here (see `generators.plan.check_scans`).

    Args:
        source: the manifest.
        plans: the observations to make; files that none of them uses are not looked at.

    Raises:
        UsageError: if no name of a file that is at fault can be resolved.
        Avs3dError: one message for each file that is missing or broken.
    """
    faults = [*_scans(plans), *_assets("objects", plans), *_assets("sounds", plans)]
    if faults:
        kind = UsageError if all(isinstance(error, UsageError) for _, error in faults) else Avs3dError
        raise kind(*source.refusal([(place, str(error)) for place, error in faults]))


def _scans(plans: Sequence[ObservationPlan]) -> Iterator[_Fault]:
    for name, plan in {plan.spec.scan: plan for plan in plans if plan.scan.source == "scan"}.items():
        yield from _faults(("scans", name, "materials"), _read_materials, plan)
        try:
            found = plan.scan_files
        except Avs3dError:
            continue
        yield from _faults(("scans", name), check_file, found.mesh)
        if found.splats is not None:
            from generators.vision.splats.cloud import MOST_GAUSSIANS

            yield from _faults(("scans", name, "splats"), check_gaussians, found.splats, MOST_GAUSSIANS)


def _read_materials(plan: ObservationPlan) -> None:
    path = plan.material_file
    if path is not None:
        read_material_file(path)


def _assets(field: str, plans: Sequence[ObservationPlan]) -> Iterator[_Fault]:
    """The faults of the entries of ``objects`` or ``sounds``, each entry looked at once."""
    seen: set[tuple[str, AssetSpec]] = set()
    for plan in plans:
        table: dict[str, tuple[AssetSpec, ...]] = dict(getattr(plan, field))
        for category in plan.spec.objects if field == "objects" else plan.spec.heard:
            for number, item in enumerate(table.get(category, ())):
                if (category, item) in seen:
                    continue
                seen.add((category, item))
                yield from _faults((field, category, number), _read, plan, category, item)


def _read(plan: ObservationPlan, category: str, item: AssetSpec) -> None:
    if item.asset is not None:
        check_asset(plan.lock, item.asset)
    elif isinstance(item, ObjectSpec):
        from generators.observation.arrangement import load_object

        load_object(plan, category, item)
    elif isinstance(item, SoundSpec):
        from generators.observation.hearing import PRE_ROLL
        from generators.observation.sources import sound_file

        sound_file(plan, category, item).signal(plan.camera.frames + PRE_ROLL)


def _faults(place: tuple[str | int, ...], read: Callable[..., object], *args: object) -> Iterator[_Fault]:
    """Yield the fault of the file that ``read`` reads, if there is one."""
    try:
        read(*args)
    except Avs3dError as error:
        yield place, error
    except MemoryError:
        raise
    except Exception as error:  # an unforeseen fault of one file must not hide those of the others
        text = " ".join(str(error).split())[:200]
        yield place, Avs3dError(f"cannot be read ({type(error).__name__}: {text}); repair or replace the file")
