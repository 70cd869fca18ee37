"""What to generate: the manifest, and one `ObservationPlan` per observation.

A manifest is data only (YAML). Everything random is drawn from generators derived from (manifest seed, observation
key, purpose), so that an observation's bytes depend on nothing but its own plan.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator, model_validator

from avs3d_bench import files
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.layout import observation_key
from avs3d_bench.schema import Category, Part, Room
from avs3d_bench.taxonomy import check_category, check_room

Finite = Annotated[float, Field(allow_inf_nan=False)]
Slug = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CameraSpec(_Model):
    """The camera: square frames of ``size`` pixels, ``hfov`` degrees wide, ``height`` metres above the floor."""

    size: Annotated[int, Field(ge=16, le=8192)] = 1008
    hfov: Annotated[Finite, Field(gt=10.0, lt=170.0)] = 90.0
    height: Annotated[Finite, Field(gt=0.2, lt=2.4)] = 1.5
    frames: Annotated[int, Field(ge=1, le=999)] = 120


class LicenceSpec(_Model):
    """Licence and author of a file the manifest brings in."""

    name: str
    author: str
    source: str = ""


class ScanSpec(_Model):
    """A home: a procedural ``apartment`` from a seed, or a ``scan`` from a GLB/OBJ file.

    ``rooms`` of a scan: room name → [[x, y, z], [x, y, z]], the lowest and highest corner of its inside (Y up, metres).
    """

    source: Literal["apartment", "scan"] = "apartment"
    seed: int | None = Field(None, ge=0)
    file: str | None = None
    rooms: dict[str, tuple[tuple[Finite, Finite, Finite], tuple[Finite, Finite, Finite]]] = {}
    licence: LicenceSpec | None = None

    @model_validator(mode="after")
    def _complete(self) -> ScanSpec:
        if self.source == "apartment" and self.seed is None:
            raise ValueError("an apartment needs a seed")
        if self.source == "scan" and not self.file:
            raise ValueError("a scan needs a file (GLB or OBJ)")
        for room in self.rooms:
            check_room(room)
        return self


class ObjectSpec(_Model):
    """A mesh file (GLB/OBJ) that takes the place of a category's procedural models; ``height`` in metres."""

    file: str
    height: Finite | None = Field(None, gt=0.02, lt=5)
    licence: LicenceSpec


class SoundSpec(_Model):
    """A recording (WAV/FLAC) that takes the place of a category's synthesised sound."""

    file: str
    licence: LicenceSpec


class ObservationSpec(_Model):
    """One observation: where it stands in the tree, what sounds, how many instances of it, what stands by silently."""

    part: Part
    scan: Slug
    room: Annotated[Room, BeforeValidator(check_room)]
    index: int = Field(ge=1, le=99)
    category: Annotated[Category, BeforeValidator(check_category)]
    instances: int | None = Field(None, ge=1, le=4)
    silent: tuple[str, ...] = ()
    variant: str | None = None

    @field_validator("silent")
    @classmethod
    def _silent(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(check_category(name, silent=True) for name in value)

    @model_validator(mode="after")
    def _counts(self) -> ObservationSpec:
        if self.part == "part_1" and self.instances not in (None, 1):
            raise ValueError(f"part_1 is single-instance, found instances: {self.instances}; use part_2 or drop it")
        if self.part == "part_2" and (self.instances or 2) < 2:
            raise ValueError("part_2 is multi-instance, found instances: 1; expected 2, 3 or 4")
        if self.category in self.silent:
            raise ValueError(
                f"{self.category} sounds and stands by silently; for silent twins use part_2 and instances"
            )
        return self

    @property
    def key(self) -> str:
        """``part/scan/room/index``."""
        return observation_key(self.part, self.scan, self.room, self.index)

    @property
    def copies(self) -> int:
        """Number of instances of the sounding model."""
        return self.instances or (1 if self.part == "part_1" else 2)


class Manifest(_Model):
    """A benchmark: its homes, its observations, its camera, and the files that replace procedural assets."""

    name: Slug
    version: str = "1.0.0"
    seed: int = Field(ge=0)
    camera: CameraSpec = CameraSpec()
    light: Literal["preview", "standard", "high"] = "standard"
    scans: dict[Slug, ScanSpec]
    objects: dict[str, tuple[ObjectSpec, ...]] = {}
    sounds: dict[str, tuple[SoundSpec, ...]] = {}
    notes: str = ""
    observations: tuple[ObservationSpec, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _consistent(self) -> Manifest:
        for category in (*self.objects, *self.sounds):
            check_category(category, silent=True)
        seen: set[str] = set()
        for entry in self.observations:
            if entry.scan not in self.scans:
                raise ValueError(f"{entry.key}: unknown scan {entry.scan!r}; expected one of {', '.join(self.scans)}")
            if entry.key in seen:
                raise ValueError(f"{entry.key} is listed twice")
            seen.add(entry.key)
        return self


@dataclass(frozen=True)
class ManifestFile:
    """A manifest with where it was read and the sha256 of its bytes."""

    manifest: Manifest
    path: Path
    text: str
    sha256: str

    @property
    def base(self) -> Path:
        """Folder that relative file names in the manifest refer to."""
        return self.path.parent


def read_manifest(path: Path) -> ManifestFile:
    """Read and check a manifest.

    Raises:
        UsageError: one line with the file, the field and what was expected.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot read the manifest ({error.strerror}); expected a YAML file") from error
    try:
        document = yaml.safe_load(raw.decode("utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        where = getattr(error, "problem_mark", None)
        line = f" at line {where.line + 1}" if where is not None else ""
        raise UsageError(f"{path}: not valid YAML{line}: {getattr(error, 'problem', None) or error}") from error
    if not isinstance(document, dict):
        raise UsageError(f"{path}: expected a mapping with name, seed, scans and observations, found {document!r:.60}")
    try:
        manifest = Manifest.model_validate(document)
    except UsageError as error:
        raise UsageError(f"{path}: {_where(document, str(error))}{error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(step) for step in first["loc"]) or "manifest"
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise UsageError(f"{path}: {place}: {first['msg'].removeprefix('Value error, ')}{more}") from error
    return ManifestFile(manifest, path.resolve(), raw.decode("utf-8"), hashlib.sha256(raw).hexdigest())


def _where(document: dict[str, Any], message: str) -> str:
    """Position of the first observation that holds the value quoted in ``message`` (its taxonomy error has none)."""
    for index, entry in enumerate(document.get("observations") or []):
        if isinstance(entry, dict):
            values = [entry.get("category"), entry.get("room"), *(entry.get("silent") or [])]
            if any(repr(value) in message for value in values if value):
                return f"observations.{index}: "
    return ""


@dataclass(frozen=True)
class ObservationPlan:
    """Everything that decides an observation's bytes, and nothing else.

    Attributes:
        spec: its entry in the manifest.
        scan: the home it happens in.
        camera: frames, size, field of view.
        light: quality of the baked light.
        seed: the manifest's seed.
        base: folder that relative file names refer to.
        objects, sounds: files that replace the procedural assets.
        vision, audio: names of the backends.
        depth, rirs: whether the optional folders are written.
        backends: name → version of everything that computes bytes.
    """

    spec: ObservationSpec
    scan: ScanSpec
    camera: CameraSpec
    light: str
    seed: int
    base: Path
    objects: dict[str, tuple[ObjectSpec, ...]]
    sounds: dict[str, tuple[SoundSpec, ...]]
    vision: str
    audio: str
    depth: bool
    rirs: bool
    backends: dict[str, str]

    @property
    def key(self) -> str:
        """``part/scan/room/index``."""
        return self.spec.key

    def rng(self, purpose: str) -> np.random.Generator:
        """The generator for one purpose (``placement``, ``path``, ``sound``, …) of this observation."""
        return derive_rng(self.seed, self.key, purpose)

    @cached_property
    def digest(self) -> str:
        """sha256 of everything that decides the bytes; a finished observation with another digest is not reused."""
        document = {
            "spec": self.spec.model_dump(),
            "scan": self.scan.model_dump(),
            "camera": self.camera.model_dump(),
            "light": self.light,
            "seed": self.seed,
            "objects": {name: [o.model_dump() for o in items] for name, items in self.objects.items()},
            "sounds": {name: [s.model_dump() for s in items] for name, items in self.sounds.items()},
            "vision": self.vision,
            "audio": self.audio,
            "with": [self.depth, self.rirs],
            "backends": self.backends,
            "files": self._file_digests(),
        }
        return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()

    def _file_digests(self) -> dict[str, str]:
        """sha256 of every file this observation may take something from; a missing one is named when it is opened."""
        spec = self.spec
        places = [(sound.file, self.base) for sound in self.sounds.get(spec.category, ())]
        for category in (spec.category, *spec.silent):
            places += [(item.file, self.base) for item in self.objects.get(category, ())]
        if self.scan.file:
            places.append((self.scan.file, scans_root(self.base)))
        return {name: files.sha256_file(base / name) for name, base in places if (base / name).is_file()}

    @property
    def home_digest(self) -> str:
        """sha256 of what decides the lit home; observations that share it share the scene cache's entry."""
        document = [self.spec.scan, self.scan.model_dump(), self.light, str(self.base) if self.scan.file else ""]
        return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def derive_rng(seed: int, key: str, purpose: str) -> np.random.Generator:
    """A generator from a stable hash of (seed, key, purpose); never the global state."""
    words = np.frombuffer(hashlib.sha256(f"{key}\0{purpose}".encode()).digest(), dtype="<u4")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *(int(word) for word in words)])))


def select(manifest: Manifest, patterns: Sequence[str]) -> tuple[ObservationSpec, ...]:
    """The observations whose key matches one of the shell patterns (all without patterns), in the manifest's order.

    Raises:
        UsageError: if a pattern matches nothing.
    """
    for pattern in patterns:
        if not any(fnmatch.fnmatchcase(entry.key, pattern) for entry in manifest.observations):
            raise UsageError(
                f"--only {pattern!r} matches no observation of {manifest.name}; "
                f"keys look like {manifest.observations[0].key!r}"
            )
    return tuple(
        entry
        for entry in manifest.observations
        if not patterns or any(fnmatch.fnmatchcase(entry.key, pattern) for pattern in patterns)
    )


def _check_variant(spec: ObservationSpec, manifest: Manifest) -> None:
    if spec.variant is None or spec.category in manifest.objects:
        return
    from generators.assets.catalogue import variants

    known = variants(spec.category)
    if spec.variant not in known:
        raise UsageError(
            f"{manifest.name}: {spec.key}: unknown variant {spec.variant!r} of {spec.category}; "
            f"expected one of {', '.join(known)}"
        )


def make_plans(
    source: ManifestFile,
    *,
    only: Sequence[str] = (),
    vision: str = "embree",
    audio: str = "soundspaces",
    frames: int | None = None,
    size: int | None = None,
    depth: bool = False,
    rirs: bool = False,
) -> tuple[ObservationPlan, ...]:
    """One plan per selected observation; ``frames`` and ``size`` override the manifest's camera.

    Raises:
        UsageError: if a pattern of ``only`` matches nothing.
        Avs3dError: if a backend is not installed.
    """
    from generators.backends import backend_versions

    manifest = source.manifest
    changes = {"frames": frames, "size": size}
    camera = manifest.camera.model_copy(update={name: value for name, value in changes.items() if value is not None})
    backends = backend_versions(vision, audio)
    for spec in manifest.observations:
        _check_variant(spec, manifest)
    return tuple(
        ObservationPlan(
            spec=spec,
            scan=manifest.scans[spec.scan],
            camera=camera,
            light=manifest.light,
            seed=manifest.seed,
            base=source.base,
            objects=manifest.objects,
            sounds=manifest.sounds,
            vision=vision,
            audio=audio,
            depth=depth,
            rirs=rirs,
            backends=backends,
        )
        for spec in select(manifest, only)
    )


def scans_root(base: Path) -> Path:
    """Where relative names of scan files start: ``$AVS3D_SCANS``, else the manifest's folder."""
    named = os.environ.get("AVS3D_SCANS")
    return Path(named) if named else base


def resolve_file(base: Path, name: str, what: str) -> Path:
    """A file named in a manifest: absolute, or relative to the manifest's folder.

    Raises:
        Avs3dError: if it does not exist.
    """
    path = Path(name).expanduser()
    path = path if path.is_absolute() else base / path
    if not path.is_file():
        raise Avs3dError(f"{path}: {what} not found; put the file there or correct its name in the manifest")
    return path
