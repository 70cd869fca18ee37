"""Scans as assets: pinned like recordings, named by manifests, credited in datasets; those of open-scans.yaml."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner, Result
from pydantic import ValidationError

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from generators.library import AssetEntry, Store, read_lock, update_lock
from generators.library.cli import assets
from generators.library.licences import terms
from generators.library.references import named_assets
from generators.manifest.reading import read_manifest
from generators.manifest.schema import ScanSpec
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans
from generators.run.dataset_record import _of_scans
from tests.support.library_server import Reply, Server, glb, wav

MANIFESTS = Path(__file__).parents[2] / "scenes_manifest"
SHARED = Path(__file__).parents[3] / "shared" / "scans"
COMMIT = "0123456789abcdef0123456789abcdef01234567"
REF = f"ann/my-flat@{COMMIT}:scans/living room.glb"
ID = "github/ann/my-flat/scans/living-room"
CREDIT = ("--licence", "CC0", "--author", "Ann")
BOX = [[0.0, 0.0, 0.0], [3.0, 2.5, 4.0]]


@pytest.fixture
def server(github_server: Server) -> Server:
    github_server.on(f"/ann/my-flat/{COMMIT}/scans/living%20room.glb", Reply(glb()))
    return github_server


def run(*args: object) -> Result:
    return CliRunner().invoke(assets, [str(arg) for arg in args])


def pinned(folder: Path, **changes: Any) -> AssetEntry:
    """An entry of the lock file in ``folder`` whose file is in the store."""
    data = glb()
    values: dict[str, Any] = {
        "id": ID, "kind": "scan", "source": "github", "ref": REF, "url": "https://github.com/ann/my-flat",
        "title": "living room", "author": "Ann", "licence": "CC0-1.0", "file": "scan.glb",
        "sha256": files.sha256_bytes(data), "bytes": len(data),
    }  # fmt: skip
    entry = AssetEntry(**values | changes)
    update_lock(folder / "assets.lock.yaml", (entry,))
    Store.default().put(entry.id, entry.file, data)
    return entry


def plan_in(folder: Path, **scan: Any) -> ObservationPlan:
    document = {
        "name": "scanned", "version": "1.0.0", "seed": 5,
        "scans": {"flat": {"source": "scan", "asset": ID, "rooms": {"living_room": BOX}} | scan},
        "observations": [{"part": "part_1", "scan": "flat", "room": "living_room", "index": 1, "category": "clock"}],
    }  # fmt: skip
    (folder / "m.yaml").write_text(yaml.safe_dump(document))
    (plan,) = make_plans(read_manifest(folder / "m.yaml"), GenerateOptions(audio="analytic"))
    return plan


def test_a_scan_is_pinned_without_a_category_and_fetched_again(server: Server, tmp_path: Path) -> None:
    lock = tmp_path / "assets.lock.yaml"
    done = run("fetch", "github", REF, *CREDIT, "--lock", lock)
    assert done.exit_code == 0, done.output
    (entry,) = read_lock(lock).assets
    assert (entry.id, entry.kind, entry.category, entry.file) == (ID, "scan", "", "scan.glb")
    assert "category" not in lock.read_text()
    store = Store(tmp_path / "store")
    store.drop(entry)
    assert run("fetch", "--lock", lock).exit_code == 0
    assert store.path(entry).read_bytes() == glb()
    assert "scan" in run("list", "--kind", "scan", "--lock", lock).output


def test_a_machine_without_network_takes_it_from_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    entry = pinned(tmp_path)
    Store.default().drop(entry)
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "whatever.bin").write_bytes(glb())
    done = run("fetch", "--lock", tmp_path / "assets.lock.yaml", "--from", tmp_path / "disk")
    assert done.exit_code == 0, done.output
    assert Store.default().problem(entry) == ""


@pytest.mark.parametrize(
    ("more", "data", "words"),
    [
        ((*CREDIT, "--category", "clock"), glb(), "a scan has no category: leave --category out"),
        (("--licence", "CC BY-ND 4.0", "--author", "Ann"), glb(), "forbids adaptations"),
        (CREDIT, glb()[:300], "truncated"),
        ((), glb(), "does not say who made a file"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_is_not_pinned(
    server: Server, tmp_path: Path, more: tuple[str, ...], data: bytes, words: str
) -> None:
    server.on(f"/ann/my-flat/{COMMIT}/scans/living%20room.glb", Reply(data))
    done = run("fetch", "github", REF, *more, "--lock", tmp_path / "assets.lock.yaml")
    assert done.exit_code != 0
    assert sum(words in line for line in (done.output + str(done.exception)).splitlines()) == 1
    assert not (tmp_path / "assets.lock.yaml").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"category": "clock"}, "category belongs to objects and sounds only; leave it out for a scan"),
        ({"kind": "sound"}, "category is missing"),
        ({"up": "z", "front": "-y"}, "up is given, but belongs to objects only; leave it out for a scan"),
        ({"split": "test"}, "split is given, but belongs to sounds only; leave it out for a scan"),
    ],
)
def test_fields_that_a_kind_does_not_have(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        pinned(tmp_path, **changes)


@pytest.mark.parametrize(
    "fields",
    [
        {"source": "apartment", "seed": 1, "asset": ID},
        {"source": "scan", "asset": ID, "file": "a.glb"},
        {"source": "scan", "asset": ID, "licence": {"name": "CC0-1.0", "author": "Ann"}},
    ],
)
def test_an_asset_brings_file_and_licence(fields: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ScanSpec(**fields)


def test_homes_without_an_asset_keep_their_identity() -> None:
    assert "asset" not in ScanSpec(source="apartment", seed=1).identity()
    assert "asset" not in ScanSpec(source="scan", file="a.glb").identity()
    assert ScanSpec(source="scan", asset=ID).identity()["asset"] == ID


def test_a_plan_reads_the_pinned_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    entry = pinned(tmp_path)
    plan = plan_in(tmp_path)
    assert plan.scan_files.mesh == Store.default().path(entry)
    assert (plan.scan_files.up, plan.scan_files.front) == ("y", "+z")
    assert plan.scan_licence is not None
    assert (plan.scan_licence.name, plan.scan_licence.author) == ("CC0-1.0", "Ann")
    source = read_manifest(tmp_path / "m.yaml")
    assert named_assets(source.manifest.objects, source.manifest.sounds, source.manifest.scans.values()) == (ID,)
    (credit,) = _of_scans(source)
    assert (credit.asset, credit.name, credit.author) == ("scan:flat", "CC0-1.0", "Ann")
    assert credit.source == "https://github.com/ann/my-flat"
    # Another credit is another dataset.
    before = plan.digest
    pinned(tmp_path, author="Bo")
    assert plan_in(tmp_path).digest != before


def test_a_scan_that_is_not_the_pinned_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    entry = pinned(tmp_path)
    plan, path = plan_in(tmp_path), Store.default().path(entry)
    path.write_bytes(glb()[:-1] + b"x")
    with pytest.raises(Avs3dError, match=r"sha256.*run: avs3d assets fetch --lock"):
        _ = plan.scan_files
    path.unlink()
    with pytest.raises(Avs3dError, match="not in the store; run: avs3d assets fetch --lock"):
        plan_in(tmp_path)
    with pytest.raises(UsageError, match="no asset 'github/ann/none'"):
        plan_in(tmp_path, asset="github/ann/none")


def test_splats_of_an_asset_are_drawn_and_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    monkeypatch.setenv("AVS3D_SCANS", str(tmp_path))
    pinned(tmp_path)
    (tmp_path / "flat.ply").write_bytes(b"ply")
    with_splats, without = plan_in(tmp_path, splats="flat.ply"), plan_in(tmp_path)
    options = GenerateOptions(audio="analytic", vision="splats")
    assert replace(with_splats, options=options).scan_files.splats == tmp_path / "flat.ply"
    with pytest.raises(Avs3dError, match="scan flat: --vision splats draws captured scenes"):
        _ = replace(without, options=options).scan_files


def test_an_asset_that_is_no_scan_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    data = wav()
    pinned(tmp_path, kind="sound", category="clock", file="sound.wav", sha256=files.sha256_bytes(data), bytes=len(data))
    with pytest.raises(UsageError, match=r"is the sound of a clock, but scans\.flat needs a scan"):
        plan_in(tmp_path)


# ---- scenes_manifest/open-scans.yaml --------------------------------------------------------------------------------


def test_the_open_scans_are_pinned_and_free() -> None:
    manifest, lock = read_manifest(MANIFESTS / "open-scans.yaml").manifest, read_lock(MANIFESTS / "assets.lock.yaml")
    assert manifest.scans
    for name, scan in manifest.scans.items():
        entry = lock.find(scan.asset or "")
        assert entry is not None, name
        assert (entry.kind, terms(entry.licence).verdict) == ("scan", "free"), name
        assert entry.author != "unknown"
    assert {spec.part for spec in manifest.observations} == {"part_1", "part_2", "part_3"}
    assert {spec.scan for spec in manifest.observations} == set(manifest.scans)


def test_no_object_of_the_open_scans_always_sounds_beside_another() -> None:
    """Else a method without ears would be right in part_1."""
    manifest = read_manifest(MANIFESTS / "open-scans.yaml").manifest
    pairs = [(spec.category, name) for spec in manifest.observations if spec.part == "part_1" for name in spec.silent]
    assert sorted(pairs) == sorted((silent, sounding) for sounding, silent in pairs)


def test_the_open_scans_can_be_had_from_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not any(SHARED.glob("*.glb")):
        pytest.skip(f"no scans in {SHARED}")
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    path = MANIFESTS / "open-scans.yaml"
    done = run("fetch", "--manifest", path, "--from", SHARED)
    assert done.exit_code == 0, done.output
    plans = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    assert all(plan.scan_files.mesh.is_file() for plan in plans)
