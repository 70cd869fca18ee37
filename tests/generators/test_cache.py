"""Scenes on disk: bit-exact, shared, atomic, and built again if they are damaged."""

from __future__ import annotations

import multiprocessing
import os
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Licence, LightMap, Material, Part, Room, Scene, Support, Texture
from generators.homes import cache as cache
from generators.homes.cache import cached_scene


def small_scene() -> Scene:
    rng = np.random.default_rng(1)
    wood = Texture("wood", rng.integers(0, 256, (7, 5, 3), dtype=np.uint8))
    oak = Material("oak", "wood", (0.1, 1 / 3, 0.7), texture=wood)
    small, rough = (Texture(n, rng.integers(0, 256, (4, 6, 3), dtype=np.uint8)) for n in ("wood_normal", "wood_rough"))
    pine = Material(
        *("pine", "parquet"),
        texture=wood,
        roughness=0.56,
        metallic=0.25,
        normal_map=small,
        roughness_map=rough,
        transmission=0.125,
        clearcoat=0.75,
    )
    lamp = Material("lamp", "glass", emission=(1e-3, 2.5, 1e4))
    one = MeshBuilder().box((1, 2, 3), (0, 0, 0), oak).sphere(0.3, (1, 1, 1), lamp, rings=4, segments=6).build()
    two = MeshBuilder().box((1, 1, 1), (4, 0, 0), pine).disc(0.2, (0, 0, 0), "y", oak, segments=5).build()
    light = LightMap(rng.random((len(one.positions), 3, 2), dtype=np.float32), rng.random((4, 6, 3)).astype(np.float16))
    parts = (
        Part("one", one, light=light),
        Part("two", two, instance_id=3, category="clock", licence=Licence("CC-BY-4.0", "Zoë", "https://example.org")),
    )
    support = Support("shelf", "kitchen", (0, 1, 2), (1, 0, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), 0.4)
    return Scene("flat", parts, (Room("kitchen", (0, 0, 0), (1, 2.5, 1 / 7), 0.123456789),), (support,), 1.5)


def assert_same(one: Any, other: Any, where: str = "scene") -> None:
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, where
        assert one.shape == other.shape, where
        assert one.tobytes() == other.tobytes(), where
    elif is_dataclass(one):
        assert type(one) is type(other), where
        for entry in fields(one):
            assert_same(getattr(one, entry.name), getattr(other, entry.name), f"{where}.{entry.name}")
    elif isinstance(one, tuple):
        assert len(one) == len(other), where
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{where}[{k}]")
    else:
        assert one == other, where


class Builder:
    """Counts how often it is called."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> Scene:
        self.calls += 1
        return small_scene()


def refuse() -> Scene:
    raise AssertionError("the scene should have come from the cache")


def folder_of(directory: Path) -> Path:
    (folder,) = directory.iterdir()
    return folder


def test_round_trip_is_bit_exact(tmp_path: Path) -> None:
    original = small_scene()
    assert_same(original, cached_scene(tmp_path, "flat/1 standard", lambda: original))
    assert_same(original, cached_scene(tmp_path, "flat/1 standard", refuse))


def test_shared_records_stay_shared_and_arrays_are_mapped_read_only(tmp_path: Path) -> None:
    scene = cached_scene(tmp_path, "a", small_scene)
    one, two = scene.parts
    assert one.mesh.materials[0] is two.mesh.materials[1]
    assert one.mesh.materials[0].texture is two.mesh.materials[0].texture
    assert not one.mesh.positions.flags.writeable
    base: Any = one.mesh.positions
    while isinstance(base, np.ndarray) and not isinstance(base, np.memmap):
        base = base.base
    assert isinstance(base, np.memmap)


def test_built_once_per_key(tmp_path: Path) -> None:
    build = Builder()
    for key in ("a", "a", "b", "a"):
        cached_scene(tmp_path, key, build)
    assert build.calls == 2


def test_new_code_builds_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build = Builder()
    cached_scene(tmp_path, "a", build)
    monkeypatch.setattr(cache, "builder_version", lambda device: "another")
    cached_scene(tmp_path, "a", build)
    assert build.calls == 2


@pytest.mark.parametrize("name", ["positions.npy", "light_texels.npy", "textures.npy", "index.json"])
@pytest.mark.parametrize("damage", ["cut", "flip", "missing"])
def test_damage_is_noticed_and_repaired(tmp_path: Path, name: str, damage: str) -> None:
    cached_scene(tmp_path, "a", small_scene)
    path = folder_of(tmp_path) / name
    content = bytearray(path.read_bytes())
    if damage == "missing":
        path.unlink()
    else:
        content[-9] ^= 0x10
        path.write_bytes(content if damage == "flip" else content[:-1])
    build = Builder()
    assert_same(small_scene(), cached_scene(tmp_path, "a", build))
    assert build.calls == 1
    cached_scene(tmp_path, "a", refuse)


def test_nothing_is_left_of_a_failed_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> Scene:
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError):
        cached_scene(tmp_path, "a", fail)
    saved = np.save

    def full_disk(path: Path, array: np.ndarray, **more: Any) -> None:
        if path.name == "uv.npy":
            raise OSError(28, "No space left on device")
        saved(path, array, **more)

    monkeypatch.setattr(np, "save", full_disk)
    with pytest.raises(Avs3dError, match=r"cannot store 'a' \(No space left on device\)"):
        cached_scene(tmp_path, "a", small_scene)
    assert list(tmp_path.iterdir()) == []


def test_half_written_folder_of_a_killed_process_is_not_taken_for_a_scene(tmp_path: Path) -> None:
    cached_scene(tmp_path, "a", small_scene)
    whole = folder_of(tmp_path)
    half = tmp_path / f".{whole.name}.1.dead.tmp"
    whole.rename(half)
    (half / "uv.npy").unlink()
    os.utime(half, (0, 0))
    build = Builder()
    cached_scene(tmp_path, "a", build)
    assert build.calls == 1
    # It is old enough to be swept away.
    assert not half.exists()


def test_the_first_of_two_builders_wins(tmp_path: Path) -> None:
    def slow() -> Scene:
        cached_scene(tmp_path, "a", small_scene)
        folder_of(tmp_path).joinpath("mark").touch()
        return small_scene()

    assert_same(small_scene(), cached_scene(tmp_path, "a", slow))
    assert (folder_of(tmp_path) / "mark").exists()


def _ask(directory: str) -> int:
    return len(cached_scene(Path(directory), "a", small_scene).parts)


@pytest.mark.slow
def test_processes_may_ask_at_once(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        assert pool.map(_ask, [str(tmp_path)] * 6) == [2] * 6
    assert len(list(tmp_path.iterdir())) == 1


def test_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(Avs3dError, match="cannot store 'a'"):
        cached_scene(blocked, "a", small_scene)
