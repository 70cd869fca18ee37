"""`--device cuda`: what it chooses, what tells its results from the CPU's, and one line where there is no device."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from avs3d_bench.contract.schema import DeviceRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.validation.catalogue import _backends
from generators import backends
from generators.cli import generate as command
from generators.core import cuda
from generators.homes import cache
from generators.manifest.reading import ManifestFile, read_manifest
from generators.observation.record import describe_device
from generators.options import EngineOptions, GenerateOptions
from generators.plan import ObservationPlan, make_plans
from generators.run import generation
from generators.vision import pathtraced

MANIFEST = Path(__file__).parents[2] / "scenes_manifest/demo.yaml"
RAYS = "generators/core/device_rays.py"


@pytest.fixture
def manifest() -> ManifestFile:
    return read_manifest(MANIFEST)


def planned(
    source: ManifestFile, monkeypatch: pytest.MonkeyPatch, kind: str = "H200", **chosen: str
) -> ObservationPlan:
    """The first plan on a machine with a device of some kind."""
    version = f"numba-cuda 0.30 on NVIDIA {kind}"
    monkeypatch.setattr(backends, "cuda_version", lambda: version)
    monkeypatch.setattr("generators.vision.cuda.cuda_version", lambda: version)
    return make_plans(source, GenerateOptions(audio="analytic", **chosen))[0]  # type: ignore[arg-type]


def test_the_device_chooses_the_renderer_unless_one_is_named(manifest, monkeypatch) -> None:
    assert planned(manifest, monkeypatch).options.renderer == "embree"
    on_device = planned(manifest, monkeypatch, device="cuda")
    assert (on_device.options.renderer, on_device.options.device) == ("cuda", "cuda")
    mixed = planned(manifest, monkeypatch, device="cuda", vision="embree")
    assert (mixed.options.renderer, mixed.options.device) == ("embree", "cuda")
    pictures = planned(manifest, monkeypatch, vision="cuda")
    assert (pictures.options.renderer, pictures.options.device) == ("cuda", "cpu")


def test_observations_and_homes_of_another_device_have_other_digests(manifest, monkeypatch) -> None:
    plans = [
        planned(manifest, monkeypatch),
        planned(manifest, monkeypatch, device="cuda"),
        planned(manifest, monkeypatch, device="cuda", vision="embree"),
        planned(manifest, monkeypatch, kind="A100", device="cuda"),
        planned(manifest, monkeypatch, vision="cuda"),
    ]
    assert len({plan.digest for plan in plans}) == len(plans)
    assert len({plan.pictures_digest for plan in plans}) == len(plans)
    cpu, h200, mixed, a100, pictures = (plan.home_digest for plan in plans)
    # The home depends on what baked it, not on what draws the pictures.
    assert cpu == pictures
    assert h200 == mixed
    assert len({cpu, h200, a100}) == 3


def test_what_runs_on_the_cpu_does_not_depend_on_the_sources_of_the_other_device() -> None:
    own = backends.observation_provenance(EngineOptions(audio="analytic"))
    assert RAYS not in own.sources
    assert "generators/vision/cuda.py" not in own.sources
    assert (
        RAYS in backends.observation_provenance(EngineOptions(vision="embree", audio="analytic", device="cuda")).sources
    )
    both = backends.observation_provenance(EngineOptions(audio="analytic", device="cuda"))
    assert {RAYS, "generators/vision/cuda.py", "generators/vision/device_kernels.py"} <= set(both.sources)
    assert cache.builder_version("cpu") != cache.builder_version("cuda")


def test_the_record_names_the_device(manifest, monkeypatch) -> None:
    assert describe_device(planned(manifest, monkeypatch)) is None
    record = describe_device(planned(manifest, monkeypatch, device="cuda"))
    assert record == DeviceRecord(name="cuda", version="numba-cuda 0.30 on NVIDIA H200")


def test_an_engine_that_can_choose_gets_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    got = {}
    monkeypatch.setattr(backends, "import_by_name", lambda entry: lambda **options: got.update({entry: options}))
    for name in backends.ACOUSTIC:
        backends.acoustic_backend(EngineOptions(audio=name, device="cuda"))
        backends.acoustic_backend(EngineOptions(audio=name))
    assert all("device" not in options for options in got.values())  # the last call was for the CPU
    backends.acoustic_backend(EngineOptions(audio="tracer", device="cuda"))
    backends.acoustic_backend(EngineOptions(audio="analytic", device="cuda"))
    assert got[backends.ACOUSTIC["tracer"]]["device"] == "cuda"
    assert "device" not in got[backends.ACOUSTIC["analytic"]]


@pytest.mark.parametrize(("free", "expected"), [(139 << 30, 16), (9 << 30, 4), (1 << 30, 1)])
def test_as_many_processes_as_the_device_has_memory_for(
    monkeypatch: pytest.MonkeyPatch, free: int, expected: int
) -> None:
    monkeypatch.setattr(cuda, "require_device", lambda: cuda.Device("T4", (7, 5), 1 << 40, free))
    monkeypatch.setattr(generation, "available_cores", lambda: 16)
    assert generation._workers(GenerateOptions(device="cuda"), 1) == expected
    assert generation._workers(GenerateOptions(vision="cuda"), 1) == expected
    assert generation._workers(GenerateOptions(device="cuda"), 2) == min(16, 2 * expected)
    assert generation._workers(GenerateOptions(), 1) == 16


@pytest.mark.parametrize(("variant", "expected"), [("cuda_ad_rgb", 2), ("llvm_ad_rgb", 16)])
def test_two_processes_share_a_device_that_follows_paths(
    monkeypatch: pytest.MonkeyPatch, variant: str, expected: int
) -> None:
    monkeypatch.setattr(pathtraced, "_mitsuba", lambda: SimpleNamespace(variant=lambda: variant))
    monkeypatch.setattr(generation, "available_cores", lambda: 16)
    assert generation._workers(GenerateOptions(vision="pathtraced"), 1) == expected
    assert generation._workers(GenerateOptions(vision="pathtraced"), 4) == min(16, 4 * expected)


@pytest.mark.parametrize(
    ("variable", "expected"), [(None, ("0", "2")), ("", ("0", "2")), ("3, GPU-a,5", ("3", "5")), ("1", ("1",))]
)
def test_devices_of_one_kind_are_shared(
    monkeypatch: pytest.MonkeyPatch, variable: str | None, expected: tuple[str, ...]
) -> None:
    kinds = [SimpleNamespace(name=name) for name in (b"NVIDIA H200", b"NVIDIA T4", b"NVIDIA H200")]
    monkeypatch.setattr(cuda, "require_device", lambda: cuda.Device("NVIDIA H200", (9, 0), 1 << 40, 1 << 40))
    monkeypatch.setattr(cuda, "_numba_cuda", lambda: SimpleNamespace(list_devices=lambda: kinds))
    monkeypatch.setattr(cuda, "is_simulated", lambda: False)
    if variable is None:
        monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    else:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", variable)
    assert cuda.visible_devices() == expected
    monkeypatch.setattr(generation, "cuda_problem", lambda: None)
    monkeypatch.setattr(generation, "_is_pathtraced_on_gpu", lambda options: options.vision == "pathtraced")
    assert generation._gpus(GenerateOptions(device="cuda")) == expected
    assert generation._gpus(GenerateOptions(vision="pathtraced")) == expected
    assert generation._gpus(GenerateOptions()) == ()
    # Mitsuba needs no numba-cuda.
    monkeypatch.setattr(generation, "cuda_problem", lambda: "numba-cuda is not installed")
    assert generation._gpus(GenerateOptions(vision="pathtraced")) == ()


@pytest.mark.parametrize("chosen", [("--device", "cuda"), ("--vision", "cuda")])
def test_without_a_device_the_command_ends_with_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, chosen: tuple[str, str]
) -> None:
    monkeypatch.setattr(cuda, "cuda_problem", lambda: "no NVIDIA driver is installed")
    result = CliRunner().invoke(
        command, [str(MANIFEST), "-o", str(tmp_path / "out"), "--audio", "analytic", *chosen], catch_exceptions=True
    )
    assert isinstance(result.exception, Avs3dError)
    assert str(result.exception) == "CUDA cannot be used: no NVIDIA driver is installed"
    assert not (tmp_path / "out").exists()


def test_a_plan_of_the_cpu_is_as_before(manifest, monkeypatch) -> None:
    plan = planned(manifest, monkeypatch)
    assert not [name for name in plan.backends if name.startswith("device")]
    assert plan.digest == replace(plan, options=replace(plan.options, device="cpu")).digest


def test_dataset_json_lists_the_device_of_its_observations(tmp_path: Path) -> None:
    from tests.support import tiny

    tiny.write_dataset(tmp_path, frames=1, size=16)
    data = Dataset(tmp_path)
    own = data[0].record
    assert own is not None
    made = own.model_copy(update={"device": DeviceRecord(name="cuda", version="numba-cuda 0.30 on NVIDIA H200")})
    assert made.made_with == (*own.made_with, ("device cuda", "numba-cuda 0.30 on NVIDIA H200"))
    there = data.record
    assert there is not None
    listed = there.model_copy(update={"backends": dict(made.made_with)})
    assert not list(_backends(listed, {own.key: made}))
    assert list(_backends(listed, {own.key: own})) == ["backend device cuda is listed, but no observation used it"]
    absent = there.model_copy(update={"backends": dict(own.made_with)})
    assert list(_backends(absent, {own.key: made})) == [
        "backend device cuda is absent, in the observations numba-cuda 0.30 on NVIDIA H200"
    ]
