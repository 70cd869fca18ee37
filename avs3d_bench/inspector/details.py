"""The list of facts below the player, and the licences."""

from __future__ import annotations

from avs3d_bench.contract.schema import AttributionRecord, LicenceRecord, unique_attributions
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.inspector.moments import Moment
from avs3d_bench.inspector.sources import ShownSound


def list_details(
    dataset: Dataset,
    observation: Observation,
    moments: tuple[Moment, ...],
    hfov: float | None,
    sound: ShownSound | None,
) -> tuple[tuple[str, str], ...]:
    """(term, text) pairs of an observation: its frames, camera, backends, dataset, as far as they are known."""
    record = observation.record
    test = sum(moment.split == "test" for moment in moments)
    rows = [("Frames", f"{len(moments)}, of which {test} are test frames")]
    seen = [moment.visible for moment in moments if moment.visible is not None]
    if seen:
        rows.append(("In view", f"in {sum(v > 0 for v in seen)} of {len(seen)} frames"))
    sight = [moment.line_of_sight for moment in moments if moment.line_of_sight is not None]
    if sight:
        rows.append(("Line of sight", f"in {sum(sight)} of {len(sight)} frames"))
    if sound is not None and sound.background is not None:
        background = sound.background
        over = f", {background.snr_db:g} dB below the sources" if sound.sources else ""
        level = f"{background.level_db:.0f} dB".replace("-", "−")
        rows.append(("Background", f"{background.kind.replace('_', ' ')}, {level}{over}"))
    away = [moment.distance for moment in moments if moment.distance is not None]
    if away:
        rows.append(("Distance", f"{min(away):.1f} to {max(away):.1f} m"))
    if hfov is not None:
        camera = observation.intrinsics
        rows.append(("Camera", f"{camera.width} × {camera.height} pixels, {hfov:.0f}° wide"))
    if record is not None:
        if record.acoustics.t30:
            rows.append(("Reverberation", f"T30 {record.acoustics.t30:.2f} s"))
        rows.append(("Pictures", f"{record.vision.backend} {record.vision.version}"))
        rows.append(("Sound", f"{record.acoustics.backend} {record.acoustics.version}"))
        if record.sound:
            rows.append(("Recording", record.sound.asset))
        rows.append(("Seed", str(record.seed)))
        if record.variant_of:
            rows.append(("Variant of", record.variant_of))
        if record.group:
            rows.append(("Group", record.group))
    if dataset.record is not None:
        rows.append(("Dataset", f"{dataset.record.name} {dataset.record.version}"))
        rows.append(("Licence of the dataset", dataset.record.licence))
    return tuple(rows)


def list_licences(dataset: Dataset, observation: Observation) -> tuple[AttributionRecord, ...]:
    """Of every instance and of the sound, as observation.json says; of the scan, as dataset.json says."""
    found: list[AttributionRecord] = []
    record = observation.record
    if record is not None:
        assets: list[tuple[str, LicenceRecord]] = [(i.asset, i.licence) for i in record.instances]
        assets += [(record.sound.asset, record.sound.licence)] if record.sound else []
        assets += [(source.asset, source.licence) for source in record.sources or ()]
        for asset, licence in assets:
            found.append(AttributionRecord(asset=asset, **licence.model_dump()))
    if dataset.record is not None:
        scan = observation.place.scan
        pieces = (a for a in dataset.record.attributions if scan in a.asset.replace(":", "/").split("/"))
        found += pieces
    return unique_attributions(found)
