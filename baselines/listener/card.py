"""The model card: what was trained on what, with which command, on which machine, and how well; JSON and Markdown."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from avs3d_bench import __version__
from avs3d_bench.commands.outputs import Signature, check_replaceable
from avs3d_bench.contract.schema import unique_attributions
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.observation_tar import read_head
from avs3d_bench.exports.shard_files import list_shards
from avs3d_bench.exports.shards import SHARDS_JSON
from avs3d_bench.formats import media
from avs3d_bench.formats.files import atomic_path, read_json, write_json
from avs3d_bench.runtime.parallel import process_each
from baselines.listener.batches import split_homes
from baselines.listener.checkpoint import Settings
from baselines.listener.dry import DrySounds
from baselines.listener.lite import PACKAGE
from baselines.listener.masks import marked_where
from baselines.listener.model import parameter_count
from baselines.listener.steps import Result
from baselines.listener.weights import NETWORK_VERSION, WEIGHTS_FORMAT, Calibration, digest_path, save_weights

WEIGHTS, CARD_JSON, CARD_MD = "listener.safetensors", "model_card.json", "model_card.md"
#: What the files of a finished run say about themselves.
_OWN = {
    WEIGHTS: Signature(marks=(WEIGHTS_FORMAT.encode(),)),
    digest_path(Path(WEIGHTS)).name: Signature(marks=(f"  {WEIGHTS}\n".encode(),)),
    CARD_JSON: Signature(values=(("name", "avs3d listener"),)),
    CARD_MD: Signature(start=b"# avs3d listener, version "),
}
LICENCE = "Apache-2.0"
#: Author of what is synthesised or procedural.
OWN_AUTHOR = "avs3d-bench"


@dataclass(frozen=True)
class RunMachine:
    """The machine of a training run.

    Attributes:
        devices: names of the devices.
        precision: of the computation.
    """

    devices: tuple[str, ...]
    precision: str

    @classmethod
    def of(cls, fabric: Any, precision: str) -> RunMachine:
        """The machine of a launched Fabric."""
        cuda = fabric.device.type == "cuda"
        name = torch.cuda.get_device_name(fabric.device) if cuda else f"CPU ({platform.machine()})"
        return cls((name,) * fabric.world_size, precision)


def write_result(
    folder: Path,
    result: Result,
    settings: Settings,
    machine: RunMachine,
    calibrated: tuple[Calibration, dict[str, Any]],
    *,
    data: Path | None = None,
    manifest: Path | None = None,
    before: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Write the averaged weights of a finished run and its card.

    Args:
        folder: of the run.
        result: of `training.train`.
        settings: of the run.
        machine: what it ran on.
        calibrated: of `calibration.calibrate`.
        data: folder of the shards, whose shards.json may name dataset and manifest.
        manifest: of the training data, whose sha256 the card shall name.
        before: `data_before` of the weights that the run began with.

    Returns:
        The card.
    """
    calibration, figures = calibrated
    digest = save_weights(result.network, folder / WEIGHTS, calibration)
    table, state = result.store.table, result.state
    training, kept = split_homes(table.homes, settings.homes)
    total = sum(state.shares.values())
    card = {
        "name": "avs3d listener",
        "network_version": NETWORK_VERSION,
        "toolkit_version": __version__,
        "licence": LICENCE,
        "weights": {"file": WEIGHTS, "sha256": digest, "parameters": parameter_count(result.network)},
        "categories": list(CATEGORIES),
        "data": {
            "shards_sha256": table.digest,
            **_origin(data, manifest),
            "pictures": len(table.groups),
            "sounds": len(table.keys),
            "training_homes": len(training),
            "homes": sorted(training),
            "validation_homes": sorted(kept),
            "assets": _assets_of_others(data, result.store.dry),
            "before": [*before],
        },
        "training": {
            "command": " ".join(["avs3d", *sys.argv[1:]]),
            "seed": settings.seed,
            "began_with": settings.weights,
            "dry_sounds": settings.dry,
            "encoder": settings.widths.encoder,
            "steps": settings.steps,
            "picture_steps": settings.picture_steps,
            "batch_per_device": settings.batch,
            "highest_rate": settings.rate,
            "minutes": round(state.seconds / 60, 1),
            "devices": list(machine.devices),
            "precision": machine.precision,
            "without": list(settings.without),
            "torch": torch.__version__,
            "shares_of_sounds": {name: round(count / total, 4) for name, count in sorted(state.shares.items())},
        },
        "validation": result.validation,
        "calibration": {**asdict(calibration), "figures": figures},
    }
    write_card(folder, card)
    return card


def data_before(weights: Path, digest: str) -> list[dict[str, Any]]:
    """What weights that a run begins with had learnt from, the oldest first; none where no card of theirs is beside.

    Args:
        weights: their file.
        digest: their sha256.
    """
    path = weights.parent / CARD_JSON
    card = read_json(path) if path.exists() else {}
    if card.get("weights", {}).get("sha256") != digest:
        return []
    data = {**card["data"]}
    return [*data.pop("before", []), data]


def write_card(folder: Path, card: dict[str, Any]) -> None:
    """Write a card into a folder, for programs and for readers."""
    write_json(folder / CARD_JSON, card)
    with atomic_path(folder / CARD_MD) as temporary:
        temporary.write_text(markdown(card))


def _origin(data: Path | None, manifest: Path | None) -> dict[str, str | None]:
    """Name of the dataset, and name and sha256 of its manifest: of the file, else as shards.json has them."""
    try:
        index: Any = media.read_json(data / SHARDS_JSON) if data else {}
    except Avs3dError:
        index = {}
    known: dict[str, Any] = index.get("generated") or {"name": index.get("dataset")}
    return {
        "dataset": known.get("name"),
        "manifest": manifest.name if manifest else known.get("name") and f"of {known['name']}",
        "manifest_sha256": media.sha256_file(manifest) if manifest else known.get("manifest_sha256"),
    }


def _assets_of_others(data: Path | None, dry: DrySounds | None) -> list[dict[str, str]] | None:
    """What others made of what is seen and heard in shards of `avs3d generate` and their dubs; None of other shards."""
    try:
        shards = list_shards(data) if data else ()
        # Both shards of an observation have its record.
        once = [shard.path for shard in shards if shard.split == "test"] or [shard.path for shard in shards]
        heads = process_each(read_head, once)
        found = [each for _, (record, _) in heads for each in record.attributions]
        found += dry.credits if dry else ()
    except Avs3dError:
        return None
    return [each.model_dump() for each in unique_attributions(found) if each.author != OWN_AUTHOR]


def check_folder(folder: Path) -> None:
    """Refuse a folder in which a finished run would replace files that no run has written.

    Raises:
        UsageError: naming the file.
    """
    for name, signature in _OWN.items():
        check_replaceable(folder / name, (signature,))


def check_manifest(path: Path | None) -> None:
    """Refuse a manifest that is not there, before training rather than after it.

    Raises:
        Avs3dError: if there is no such file.
    """
    if path is not None and not path.is_file():
        raise Avs3dError(f"{path}: no such file; --manifest names the manifest of the training data")


def markdown(card: dict[str, Any]) -> str:
    """The card for readers."""
    data, training, weights, warm = card["data"], card["training"], card["weights"], card["calibration"]
    manifest = f"{data['manifest']}, sha256 `{data['manifest_sha256']}`" if data["manifest_sha256"] else "not named"
    shares = ", ".join(f"{name} {value:.1%}" for name, value in training["shares_of_sounds"].items())
    before = data.get("before", [])
    figures = "\n".join(
        f"| {name} | {'-' if value is None else f'{value:.3f}'} |" for name, value in card["validation"].items()
    )
    return f"""# {card["name"]}, version {card["network_version"]}

Marks what sounds in a picture, given one second of binaural sound. Categories: {", ".join(card["categories"])}.

- Weights: `{weights["file"]}`, {weights["parameters"]:,} parameters, float16, {card["licence"]},
  sha256 `{weights["sha256"]}`.
- Data: {data["sounds"]:,} sounds of {data["pictures"]:,} pictures; {data["training_homes"]} homes were trained
  on, {len(data["validation_homes"])} kept for validation.
  Manifest: {manifest}. Shards: sha256 `{data["shards_sha256"]}`.
- Recordings and models by others in the data: {_credits(data, *before)}.
- Command: `{training["command"]}`
- Began with {_beginning(training)}{"".join(map(_learnt, before))}.
- Seed {training["seed"]}, {training["steps"]:,} steps of {training["batch_per_device"]} sounds a device; the first
  {training["picture_steps"]:,} of them were of as many parts of pictures, without sound.
- Hardware: {", ".join(training["devices"])}; {training["precision"]}; torch {training["torch"]};
  {training["minutes"]} minutes.
- Sounds in the batches: {shares}; {_dubbed(training)}.
  Random changes left out: {", ".join(training["without"]) or "none"}.
- Log-odds of the mask less {warm["bias"]:g} are divided by {warm["mask"]:g}, of what is heard by {warm["audible"]:g};
  {marked_where(warm["threshold"], warm["share"])}, as a category where > {warm["category"]:g}.
  Of {warm["figures"]["pictures"]:,} frames by which this was chosen, the calibration error above .1 is
  {warm["figures"]["error"]:.3f}, before {warm["figures"]["error_before"]:.3f}.{_afterwards(warm)}

Validation, on homes that were not trained on:

| figure | value |
|---|---|
{figures}

Trained on generated homes and objects. It marks the seven categories alone; how it does on recordings, models by
others and in a real room is measured in docs/listener.md of the project, for the weights of the package.
"""


def _afterwards(calibration: dict[str, Any]) -> str:
    command = calibration.get("command")
    return f"\n- Calibrated after the training: `{command}`" if command else ""


def _beginning(training: dict[str, Any]) -> str:
    if training.get("began_with"):
        return f"the weights of sha256 `{training['began_with']}`"
    if training.get("encoder") == "lite0":
        return f"random weights, but for an encoder of pictures that learnt from ImageNet ({PACKAGE}, Apache-2.0)"
    return "random weights"


def _dubbed(training: dict[str, Any]) -> str:
    if training.get("dry_sounds"):
        return f"dubbed with the dry sounds of sha256 `{training['dry_sounds']}`"
    return "none of them dubbed"


def _learnt(data: dict[str, Any]) -> str:
    return f"; before, {data['sounds']:,} sounds of {data['pictures']:,} pictures in {data['training_homes']} homes"


def _credits(*data: dict[str, Any]) -> str:
    known: list[list[dict[str, str]] | None] = [each.get("assets") for each in data]
    found = {credit: None for assets in known for credit in map(_credit, assets or [])}
    unknown = [] if all(assets is not None for assets in known) else ["not known"]
    return "; ".join([*found, *unknown]) or "none"


def _credit(asset: dict[str, str]) -> str:
    return f"{asset['asset']} by {asset['author']} ({asset['name']}, {asset['source']})"
