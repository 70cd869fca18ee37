"""A sealed test over the hand-made trees of `tiny` and `tiny_scenes`; nothing is generated.

The trees are made what the secret draws: keys, seeds, digests of plans, sparse points and sounding objects.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ProvenanceRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import files
from avs3d_bench.formats.colmap import write_model
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.sealing.seal import commitment, opening_key
from avs3d_bench.sealing.secret import CommittedSecret, commit
from generators.backends import observation_provenance
from generators.manifest.reading import ManifestFile, read_manifest
from generators.observation.arrangement import draw_instances
from generators.observation.surface_points import draw_pixels
from generators.options import EngineOptions, GenerateOptions
from generators.plan import ObservationPlan, make_plans
from generators.sealing.draw import draw_document
from generators.sealing.publish import Sealing, write_private, write_public
from generators.sealing.seal import settings_of
from generators.sealing.texts import sealed_text, template_text
from tests.support import tiny, tiny_scenes

#: Keys of the sealed observations that were `tiny.SINGLE` and `tiny.MULTI`.
SINGLE, MULTI = "part_1/home_1/kitchen/1", "part_2/home_1/kitchen/1"
SECRET = bytes.fromhex("9c2f5e0b71d84a63c8f01e97ab3d562449e86f0dd7b15a3c02fe94c16b7d8835")
#: scrypt for tests: no cost.
CHEAP = {"n": 2, "r": 1, "p": 1}
#: Sparse points that are taken from each frame.
_POINTS = 12
#: What the hand-made tree is said to come from.
TEMPLATE: dict[str, Any] = {
    "name": "tiny",
    "version": "1",
    "seed": 1,
    "audio": "analytic",
    "scans": {"flat": {"seed": 5}},
    "observations": [
        {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "microwave", "silent": ["oven"]},
        {"part": "part_2", "scan": "flat", "room": "kitchen", "index": 1, "category": "microwave"},
    ],
}
_BOTH = [
    {"category": "microwave", "instance": 1},
    {"category": "microwave", "instance": 2},
    {"category": "telephone", "instance": 1, "gain_db": -6.0},
]
_SCENE = {"part": "part_3", "scan": "flat", "room": "kitchen", "instances": {"microwave": 2, "telephone": 1}}
_LIKE = {"like": "part_3/flat/kitchen/1"}
SCENES_TEMPLATE: dict[str, Any] = TEMPLATE | {
    "name": "tiny-scenes",
    "observations": [
        {**_SCENE, "index": 1, "sources": _BOTH[:1]},
        {**_LIKE, "index": 2, "sources": _BOTH[1:2]},
        {**_LIKE, "index": 3, "sources": _BOTH, "background": {"kind": "noise", "snr_db": 20.0}},
        {**_LIKE, "index": 4, "sources": []},
        {
            **_LIKE,
            "index": 5,
            "sources": [{"category": "telephone", "room": "living_room"}],
            "background": {"kind": "noise", "snr_db": 10.0},
        },
    ],
}


@dataclass(frozen=True)
class Drawn:
    """What the secret draws for the hand-made tree.

    Attributes:
        manifest: with its seeds.
        options: as of `avs3d seal`.
        plans: key → plan.
        names: key in the hand-made tree → drawn key.
    """

    manifest: ManifestFile
    options: GenerateOptions
    plans: Mapping[str, ObservationPlan]
    names: Mapping[str, str]


def write_seal(
    folder: Path,
    secret: bytes = SECRET,
    *,
    train_truth: bool = False,
    scenes: bool = False,
    frames: int = 9,
    change: Callable[[Path], None] = lambda _: None,
    old: bool = False,
) -> Path:
    """Write ``public/``, ``private/`` and ``secret`` into a folder.

    Args:
        folder: gets them.
        secret: 32 bytes.
        train_truth: publish the masks of train frames.
        scenes: of the tree of part_3.
        frames: of each observation.
        change: what a forger does to the whole dataset before it is sealed.
        old: a seal as schema 1.0 had it, of another secret.
    """
    work = folder / "generated"
    if scenes:
        tiny_scenes.write_part_3(work, stems=True)
    else:
        tiny.write_dataset(work, frames=frames, extras=True)
    template = (SCENES_TEMPLATE if scenes else TEMPLATE) | {"camera": {"frames": 10 if scenes else frames, "size": 64}}
    bound, drawn = _draw(folder, template, secret, scenes, old)
    _adopt(work, drawn, scenes)
    change(work)
    settings = settings_of(drawn.manifest, drawn.options)
    sealing = Sealing(template_text(template), drawn.manifest, {}, bound, train_truth, settings)
    for name in ("public", "private"):
        (folder / name).mkdir()
    write_public(Dataset(work), folder / "public", sealing)
    write_private(Dataset(work), folder / "public", folder / "private", sealing)
    if old:
        data = files.read_json(folder / "public" / layout.SEAL_JSON)
        data |= {"schema_version": "1.0"}
        data["commitments"] |= {"secret": hashlib.sha256(bound.key).hexdigest()}
        del data["commitments"]["private"]
        for name in ("public", "private"):
            tiny.replace(folder / name / layout.SEAL_JSON, files.dump_json(data).encode())
    return folder


def recommit(folder: Path) -> None:
    """Compute all commitments again from the private folder, as a forger does who changed it before the seal.

    The sha256 of the public files that poses.json and dataset.json have follow, too; observation.json is left as it is.
    """
    public, private = folder / "public", folder / "private"
    data = files.read_json(public / layout.SEAL_JSON)
    whole, published = (files.read_json(root / layout.DATASET_JSON) for root in (private, public))
    for entry in published["observations"]:
        path = public / entry["key"] / layout.POSES_JSON
        poses = files.read_json(path)
        poses["files"] = {name: files.sha256_file(path.parent / name) for name in poses["files"]}
        tiny.replace(path, files.dump_json(poses).encode())
        entry["digest"] = files.sha256_file(path)
    for entry in whole["observations"]:
        entry["digest"] = files.sha256_file(private / entry["key"] / layout.OBSERVATION_JSON)
    tiny.write_sealed(public, published)
    tiny.write_sealed(private, whole)
    data["dataset_sha256"] = files.sha256_file(public / layout.DATASET_JSON)
    opening = opening_key(private)
    commitments = data["commitments"]
    for key, named in commitments["truth"].items():
        named |= {name: _commitment(private, opening, f"{key}/{name}") for name in named}
    if "private" in commitments:
        commitments["private"] = {name: _commitment(private, opening, name) for name in commitments["private"]}
    for root in (public, private):
        tiny.replace(root / layout.SEAL_JSON, files.dump_json(data).encode())


def _commitment(private: Path, opening: bytes, path: str) -> str:
    file = private / path
    return commitment(opening, path, file.read_bytes() if file.exists() else None)


def _draw(
    folder: Path, template: dict[str, Any], secret: bytes, scenes: bool, old: bool
) -> tuple[CommittedSecret, Drawn]:
    """The first salt whose draws say of the hand-made tree what it has: that the second twin sounds."""
    (folder / "secret").write_text(f"{secret.hex()}\n")
    options = GenerateOptions(extras=("stems",) if scenes else ("depth", "rirs"))
    for number in count():
        bound = commit(secret, cost=CHEAP, salt=number.to_bytes(16, "big"))
        if old:
            secret = hashlib.sha256(b"%d" % number).digest()
            bound = CommittedSecret(secret, bound.commitment)
            (folder / "secret").write_text(f"{secret.hex()}\n")
        document, _ = draw_document(template, bound.key, {})
        path = folder / "drawn.yaml"
        path.write_text(sealed_text(document))
        manifest = read_manifest(path)
        plans = {plan.key: plan for plan in make_plans(manifest, options)}
        if scenes:
            spoken = {repr((s.sources, s.background)): key for key, plan in plans.items() for s in [plan.spec]}
            wanted = [read_manifest(_written(folder, template)).manifest.observations[n] for n in range(5)]
            names = {
                key: spoken[repr((spec.sources, spec.background))]
                for key, spec in zip(tiny_scenes.GROUP, wanted, strict=True)
            }
            return bound, Drawn(manifest, options, plans, names)
        if draw_instances(plans[MULTI], ["microwave", "microwave"]) == (2,):
            return bound, Drawn(manifest, options, plans, {tiny.SINGLE: SINGLE, tiny.MULTI: MULTI})
    raise AssertionError


def _written(folder: Path, template: dict[str, Any]) -> Path:
    path = folder / "template.yaml"
    path.write_text(template_text(template))
    return path


def _adopt(work: Path, drawn: Drawn, scenes: bool) -> None:
    """Make the hand-made tree the one that the secret draws."""
    for old, new in drawn.names.items():
        (work / new).parent.mkdir(parents=True, exist_ok=True)
        (work / old).rename(work / new)
    for part in {old.split("/")[0] for old in drawn.names}:
        shutil.rmtree(work / part / "tiny")
    data = files.read_json(work / "dataset.json")
    for entry in data["observations"]:
        entry |= {"key": drawn.names[entry["key"]], "scan": "home_1"}
    data["observations"].sort(key=lambda entry: entry["key"])
    data |= {"manifest": drawn.manifest.text, "manifest_sha256": drawn.manifest.sha256}
    data["provenance"] = ProvenanceRecord.of(observation_provenance(EngineOptions(audio="analytic"))).model_dump()
    tiny.write_sealed(work, data)
    for old, new in drawn.names.items():
        plan = drawn.plans[new]
        boxes = tiny_scenes.BOXES if scenes else tiny.BOXES[old]
        size, frames = plan.camera.size, plan.camera.frames
        draw = partial(_some_pixels, plan.rng("points"), size)
        model = tiny.colmap_model(Intrinsics.from_fov(size), tiny.path_of(frames), boxes, draw=draw)
        write_model(work / new / layout.COLMAP, model)
        tiny.edit_record(work, new, partial(_rename, plan))


def _some_pixels(rng: Any, size: int) -> tuple[Any, Any]:
    rows, columns = draw_pixels(rng, size, size)
    return rows[:_POINTS], columns[:_POINTS]


def _rename(plan: ObservationPlan, data: dict[str, Any]) -> None:
    spec = plan.spec
    data |= {"key": plan.key, "scan": spec.scan, "index": spec.index, "seed": plan.seed, "plan_sha256": plan.digest}
    if data.get("group"):
        data["group"] = spec.like or plan.key
