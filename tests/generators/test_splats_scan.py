"""Splats of a scan in a manifest: what is read, what is refused, and a dataset that is drawn by them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.gaussian_ply import GaussianTable, write_gaussians
from generators import generate
from generators.assets.modelframe import upright
from generators.core.scene import SplatFile
from generators.manifest.schema import ScanSpec
from generators.options import EngineOptions, GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest
from generators.scans.files import scan_files_of
from generators.scans.scan import Axes, load_scan
from generators.vision.splats.cloud import load_cloud
from tests.support import homes
from tests.support.captured import gaussians, write_captured


def write(path: Path, table: GaussianTable) -> SplatFile:
    """Numbers that are not finite are written, too."""
    finite = GaussianTable(*(np.nan_to_num(part, nan=7.5, posinf=8.5, neginf=9.5) for part in vars(table).values()))
    write_gaussians(path, finite)
    data = path.read_bytes()
    for stands_for, number in ((7.5, np.nan), (8.5, np.inf), (9.5, -np.inf)):
        data = data.replace(np.float32(stands_for).tobytes(), np.float32(number).tobytes())
    path.write_bytes(data)
    return SplatFile(path, np.eye(4))


def ball(count: int) -> GaussianTable:
    return gaussians(np.random.default_rng(1).uniform(0, 1, (count, 3)), 0.1, 0.6)


def test_a_few_broken_gaussians_are_left_out(tmp_path: Path) -> None:
    table = ball(400)
    table.means[3, 1] = np.nan
    table.sh[5, 0, 2] = np.inf
    table.rotations[7] = 0.0
    cloud = load_cloud(write(tmp_path / "a.ply", table))
    assert len(cloud) == 397
    assert all(np.isfinite(part).all() for part in vars(cloud).values())


def test_infinite_logits_and_flat_discs_are_no_faults(tmp_path: Path) -> None:
    table = ball(4)
    table.opacities[0], table.opacities[1], table.log_scales[2, 2] = np.inf, -np.inf, -np.inf
    cloud = load_cloud(write(tmp_path / "a.ply", table))
    np.testing.assert_allclose(cloud.opacities, [1.0, 0.6, 0.6], atol=1e-6)  # opacity 0 is never seen
    assert cloud.covariances[1, 5] == 0


def test_many_broken_gaussians_are_refused(tmp_path: Path) -> None:
    table = ball(100)
    table.log_scales[:2] = np.nan
    with pytest.raises(Avs3dError, match=r"2 of 100 Gaussians hold NaN or infinite numbers; expected at most 1%"):
        load_cloud(write(tmp_path / "a.ply", table))


def test_gaussians_that_nobody_sees_are_refused(tmp_path: Path) -> None:
    table = ball(10)
    table.opacities[:] = -20
    with pytest.raises(Avs3dError, match="none of its 10 Gaussians is opaque enough"):
        load_cloud(write(tmp_path / "a.ply", table))


@pytest.mark.slow
def test_splats_are_turned_as_the_mesh_is(tmp_path: Path) -> None:
    mesh = homes.write_room(tmp_path / "room.glb")
    flat = load_scan("box", mesh, {"kitchen": homes.ROOM})
    splats = write_captured(tmp_path / "room.ply", flat.parts[0].mesh, 500)
    # The file's +X is declared to be the front: mesh and splats are turned by the same rotation.
    corners = np.array(homes.ROOM) @ upright("y", "x").T
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    files = replace(scan_files_of(mesh), splats=splats)
    scene = load_scan("box", files, {"kitchen": box}, axes=Axes("y", "x"))
    assert scene.splats is not None
    cloud = load_cloud(scene.splats)
    bounds = scene.parts[0].mesh.bounds
    np.testing.assert_allclose([cloud.means.min(axis=0), cloud.means.max(axis=0)], bounds, atol=0.2)
    plain = load_cloud(SplatFile(splats, np.eye(4)))
    np.testing.assert_allclose(cloud.means, plain.means @ scene.splats.to_world[:3, :3].T, atol=1e-5)


def planned(folder: Path, vision: str = "splats", **scan: object) -> ObservationPlan:
    manifest = homes.write_manifest(folder)
    document = yaml.safe_load(manifest.read_text())
    document["scans"]["box"] |= scan
    manifest.write_text(yaml.safe_dump(document, sort_keys=False))
    options = GenerateOptions(vision=vision, audio="analytic")  # type: ignore[arg-type]
    return make_plans(read_manifest(manifest), options)[0]


def test_a_scan_without_splats_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"scan box: --vision splats draws captured scenes; add `splats: FILE\.ply`"):
        planned(tmp_path).check_files()


def test_a_missing_file_of_splats_is_named(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"room\.ply: splats of scan box not found"):
        planned(tmp_path, splats="room.ply").check_files()


def test_a_procedural_home_has_no_splats(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    home = replace(plan, scan=ScanSpec(seed=3))
    with pytest.raises(Avs3dError, match="box is a procedural home; --vision splats draws captured scenes"):
        home.check_files()


def test_splats_belong_to_scans() -> None:
    with pytest.raises(ValueError, match="an apartment has no splats: only a scan has"):
        ScanSpec(seed=3, splats="room.ply")


def test_the_digest_covers_the_splats_where_they_are_drawn(tmp_path: Path) -> None:
    def digests(vision: str) -> tuple[str, str]:
        found = []
        for content in (ball(10), ball(11)):
            write_gaussians(tmp_path / "room.ply", content)
            found.append(planned(tmp_path, vision, splats="room.ply").digest)
        return found[0], found[1]

    one, other = digests("splats")
    assert one != other
    one, other = digests("embree")
    assert one == other


def test_manifests_without_splats_keep_their_digests() -> None:
    assert "splats" not in ScanSpec(source="scan", file="a.glb").identity()
    assert ScanSpec(source="scan", file="a.glb", splats="a.ply").identity()["splats"] == "a.ply"


def test_embree_counts_as_part_of_the_renderer() -> None:
    from generators.backends import observation_provenance

    drawn = observation_provenance(EngineOptions(vision="splats")).sources
    plain = observation_provenance(EngineOptions(vision="embree")).sources
    assert {"generators/vision/embree.py", "generators/vision/splats/kernels.py"} <= drawn.keys()
    assert not any("splats" in path for path in plain)


def test_faults_of_the_file_are_found_before_the_first_home(tmp_path: Path) -> None:
    manifest = homes.write_manifest(tmp_path)
    document = yaml.safe_load(manifest.read_text())
    document["scans"]["box"]["splats"] = "room.splat"
    manifest.write_text(yaml.safe_dump(document, sort_keys=False))
    (tmp_path / "room.splat").write_bytes(b"0")
    with pytest.raises(Avs3dError, match=r"scans\.box\.splats: .*a \.splat file; .*splat-transform"):
        generate(manifest, tmp_path / "out", vision="splats", audio="analytic", workers=1)


@pytest.mark.slow
def test_a_dataset_of_splats_has_the_labels_and_sounds_of_the_mesh(tmp_path: Path) -> None:
    manifest = homes.write_manifest(tmp_path)
    mesh = load_scan("box", tmp_path / "room.glb", {"kitchen": homes.ROOM}).parts[0].mesh
    write_captured(tmp_path / "room.ply", mesh, 20_000)
    document = yaml.safe_load(manifest.read_text())
    document["scans"]["box"]["splats"] = "room.ply"
    manifest.write_text(yaml.safe_dump(document, sort_keys=False))
    roots = {name: tmp_path / name for name in ("embree", "splats", "again")}
    for name, root in roots.items():
        vision, workers = ("embree", 1) if name == "embree" else ("splats", 2 if name == "again" else 1)
        generate(manifest, root, vision=vision, audio="analytic", frames=4, workers=workers)  # type: ignore[arg-type]
    mine, theirs = (homes.tree_digest(roots[name]) for name in ("splats", "embree"))
    for path in mine:
        if "masks/" in path or path.endswith(".wav"):
            assert mine[path] == theirs[path], path
    assert any(mine[path] != theirs[path] for path in mine if "/input/" in path)
    assert homes.tree_digest(roots["again"]) == mine
