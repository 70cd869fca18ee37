"""One `ObservationPlan` per observation of a manifest: all that the observation's bytes depend on.

All random numbers come from generators derived from (manifest seed, observation key, purpose), so that an
observation's bytes depend only on its own plan.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np

from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean
from avs3d_bench.formats import files
from avs3d_bench.runtime.user_path import user_path
from generators.core.scene import Licence
from generators.library.lock import LOCK_NAME
from generators.library.references import asset_digests, check_assets
from generators.library.store import Store, check_asset, find_entry
from generators.manifest.categories import CategorySpec
from generators.manifest.reading import ManifestFile, select
from generators.manifest.reading import read_manifest as read_manifest
from generators.manifest.schema import AssetSpec, CameraSpec, Manifest, ObjectSpec, ObservationSpec, ScanSpec, SoundSpec
from generators.options import EngineOptions, GenerateOptions
from generators.scans.files import ScanFiles, digest, find_scan_files, scan_files_of

#: Seeds from here on are secrets: no stream of theirs tells another.
SECRET_SEEDS = 2**64
#: Number of seeds of an acoustic engine: a word, which every reader of JSON keeps.
ENGINE_SEEDS = 2**32
#: What a home needs to be drawn by splats.
_NO_SPLATS = (
    "captured scenes; add `splats: FILE.ply` to a scan of the manifest (docs/splats.md), or choose another --vision"
)


class OptionalFiles(TypedDict):
    """The optional files of an observation, as the arguments of its writer."""

    depth: bool
    rirs: bool
    receivers: dict[str, int]


class Takes(NamedTuple):
    """Which takes of a category's recordings an observation of part_3 plays.

    Attributes:
        first: number of its first take, from 0; its other sources of the category have the next ones.
        of: number of takes of its group.
    """

    first: int
    of: int


@dataclass(frozen=True)
class ObservationPlan:
    """All that an observation's bytes depend on.

    Attributes:
        spec: its entry in the manifest.
        scan: the home it takes place in.
        camera: frames, size, field of view.
        light: quality of the baked light.
        seed: the manifest's seed.
        base: folder that relative file names refer to.
        objects, sounds: files that replace the procedural assets.
        categories: the categories that the manifest adds, in its order.
        models: category → the procedural variants from which its objects are drawn; a category that is not listed
            has those of `generators.assets.catalogue.variants`.
        voices: category → the voices by which its sounds are synthesised; a category that is not listed has the one of
            versions 1 and 2 (see `generators.assets.sounds.synthesise`).
        options: engines, and what they are asked for.
        backends: name → version of all software that the bytes depend on.
        first: the plan of the observation whose pictures this one has, if it has those of another. Its bytes do not
            depend on it: where the pictures are not there, they are rendered again.
        takes: category that sounds from recordings → its takes; see `takes_of`.
    """

    spec: ObservationSpec
    scan: ScanSpec
    camera: CameraSpec
    light: str
    seed: int
    base: Path
    objects: dict[str, tuple[ObjectSpec, ...]]
    sounds: dict[str, tuple[SoundSpec, ...]]
    options: EngineOptions
    backends: dict[str, str]
    first: ObservationPlan | None = None
    categories: dict[str, CategorySpec] = field(default_factory=dict)
    models: dict[str, tuple[str, ...]] = field(default_factory=dict)
    voices: dict[str, tuple[str, ...]] = field(default_factory=dict)
    levels: tuple[float, float] | None = None
    takes: dict[str, Takes] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """``part/scan/room/index``."""
        return self.spec.key

    @property
    def own_categories(self) -> tuple[str, ...] | None:
        """The names of the categories that the manifest adds, in its order; None if there are none."""
        return tuple(self.categories) or None

    @property
    def moves(self) -> bool:
        """Whether objects move: in part_1 and part_2 the one that sounds, in part_3 those that the manifest names."""
        return self.spec.source_motion == "path" or bool(self.spec.moving)

    def rng(self, purpose: str) -> np.random.Generator:
        """The random number generator for one purpose, such as ``placement``, ``ids``, ``path`` or ``sound``.

        An acoustic variant uses its original's generators: no random draw depends on the acoustics.
        """
        return derive_rng(self.seed, self.spec.like or self.key, purpose)

    def own_rng(self, purpose: str) -> np.random.Generator:
        """As `rng`, but a sibling has generators of its own; a variant has those of its original.

        All that is heard is drawn from these, so that siblings never share a take.
        """
        return derive_rng(self.seed, self.own_key, purpose)

    @property
    def own_key(self) -> str:
        """The key from which `own_rng` derives."""
        return self.spec.variant_of or (self.key if self.spec.is_part_3 else self.spec.like or self.key)

    @property
    def acoustic_seed(self) -> int | None:
        """Seed of the acoustic engine: that of a sibling is its own; None, the engine's usual one, in other parts."""
        return int(self.own_rng("acoustics").integers(ENGINE_SEEDS)) if self.spec.is_part_3 else None

    @property
    def keeps_stems(self) -> bool:
        """Whether it writes stems; only in part_3, where something can be heard, there are some."""
        return "stems" in self.options.extras and bool(self.spec.sources or self.spec.background)

    @property
    def optional_files(self) -> OptionalFiles:
        """The optional files that its writer writes."""
        extras = self.options.extras
        return {"depth": "depth" in extras, "rirs": "rirs" in extras, "receivers": self.options.receivers.channels}

    @cached_property
    def pictures_digest(self) -> str:
        """sha256 of all that the pictures depend on; observations with the same value have the same pictures."""
        spec = self.spec
        document = {
            "key": spec.like or self.key,
            "room": spec.room,
            "objects": [spec.objects, spec.variant, spec.source_motion],
            "home": self.home_digest,
            "camera": self.camera.model_dump(),
            "seed": self.seed,
            "models": _identities(self.objects, spec.objects),
            "categories": self._declarations(spec.objects),
            "options": self.options.identity(),
            "backends": self.backends,
            "files": self._file_digests(sounds=False),
        }
        if spec.twins != "apart":
            document["twins"] = spec.twins
        if spec.agent != "walking":
            document["agent"] = spec.agent
        if spec.moving:
            document["moving"] = sorted(spec.moving)
        if self._variants:
            document["variants"] = self._variants
        return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()

    @cached_property
    def digest(self) -> str:
        """sha256 of all that the bytes depend on; a finished observation with another digest is not reused.

        Of the manifest it covers what this observation uses: the entries of other categories may change.
        """
        document = {
            "spec": self.spec.identity(),
            "scan": self.scan.identity(),
            "camera": self.camera.model_dump(),
            "light": self.light,
            "seed": self.seed,
            "objects": _identities(self.objects, self.spec.objects),
            "sounds": _identities(self.sounds, self.spec.heard),
            "options": self.options.identity(),
            "extras": sorted({*self.options.extras} - (set() if self.keeps_stems else {"stems"})),
            "backends": self.backends,
            "files": self._file_digests(),
        }
        if self.categories:
            # The names decide the class ids; where the objects stand matters for those of this observation only.
            used = (*self.spec.objects, *self.spec.heard)
            document["categories"] = [list(self.categories), self._declarations(used)]
        if self._variants:
            document["variants"] = self._variants
        voices = {name: self.voices[name] for name in self.spec.heard if name in self.voices}
        if voices:
            document["voices"] = voices
        if self.levels is not None:
            document["levels"] = self.levels
        if self.takes:
            document["takes"] = self.takes
        return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()

    @property
    def object_items(self) -> tuple[tuple[str, ObjectSpec], ...]:
        """(category, entry) of all files and assets from which its objects are drawn."""
        return tuple((name, item) for name in self.spec.objects for item in self.objects.get(name, ()))

    @property
    def sound_items(self) -> tuple[tuple[str, SoundSpec], ...]:
        """(category, entry) of all files and assets from which its sounds are drawn."""
        return tuple((name, item) for name in self.spec.heard for item in self.sounds.get(name, ()))

    @property
    def directivity_files(self) -> list[str]:
        """The SOFA files of its sources' directivities, as the manifest names them."""
        chosen = [self.spec.directivity_of(source).file for source in self.spec.sounding]
        return sorted({name for name in chosen if name is not None})

    @property
    def _variants(self) -> dict[str, tuple[str, ...]]:
        """The entries of ``models`` that this observation draws from."""
        return {name: self.models[name] for name in self.spec.objects if name in self.models}

    def _declarations(self, used: Iterable[str]) -> dict[str, Any]:
        """The manifest's declarations of the categories ``used``, for digests."""
        return {name: self.categories[name].identity() for name in used if name in self.categories}

    def _file_digests(self, *, sounds: bool = True) -> dict[str, str]:
        """sha256 of every file that this observation may read; a missing file is reported when it is opened."""
        items = [item for _, item in (*self.object_items, *(self.sound_items if sounds else ()))]
        names = [item.file for item in items if item.file is not None] + (self.directivity_files if sounds else [])
        named = {name: locate(self.base, name) for name in names}
        found = {name: files.sha256_file(path) for name, path in named.items() if path.is_file()}
        assets = [name for name in (*(item.asset for item in items), self.scan.asset) if name is not None]
        if assets:
            found |= asset_digests(self.lock, assets)
        return self._scan_digests() | found

    @property
    def lock(self) -> Path:
        """The lock file of its assets, beside the manifest."""
        return self.base / LOCK_NAME

    @property
    def scan_files(self) -> ScanFiles:
        """The files of its scan.

        Raises:
            Avs3dError: if a file that the manifest names is missing, no scan of that id is found, or it has no splats
                and they are to be drawn.
        """
        root, name = scans_root(self.base, self.options.scans), self.scan.file
        if self.scan.asset:
            found = scan_files_of(self._stored_scan(self.scan.asset))
        elif name:
            found = scan_files_of(resolve_file(root, name, f"scan {self.spec.scan}"))
        else:
            found = find_scan_files(self.spec.scan, root)
        if self.options.renderer != "splats":
            return found
        if not self.scan.splats:
            raise Avs3dError(f"scan {self.spec.scan}: --vision splats draws {_NO_SPLATS}")
        return replace(found, splats=resolve_file(root, self.scan.splats, f"splats of scan {self.spec.scan}"))

    def _stored_scan(self, asset: str) -> Path:
        """The file of a scan of the store."""
        entry = find_entry(self.lock, asset)
        path = Store.default().path(entry)
        if not path.is_file() or digest(path) != entry.sha256:
            check_asset(self.lock, asset)  # says what is wrong
        return path

    @property
    def scan_licence(self) -> Licence | None:
        """The terms of its scan: those of the lock file, or of the manifest; None: they are not known."""
        if self.scan.asset:
            return find_entry(self.lock, self.scan.asset).terms
        own = self.scan.licence
        return Licence(own.name, own.author, own.source) if own else None

    @property
    def material_file(self) -> Path | None:
        """The SoundSpaces material file that its scan names.

        Raises:
            Avs3dError: if it does not exist.
        """
        name = self.scan.materials
        return resolve_file(self.base, name, f"material file of scan {self.spec.scan}") if name else None

    def check_home(self) -> None:
        """See whether the files of its scan are there, and whether the renderer can draw such a home.

        Raises:
            Avs3dError: naming what is missing.
        """
        if self.scan.source == "scan":
            _ = self.scan_files, self.material_file
        elif self.options.renderer == "splats":
            raise Avs3dError(f"{self.spec.scan} is a procedural home; --vision splats draws {_NO_SPLATS}")

    def check_files(self) -> None:
        """See whether all files that the observation may use are there; what they hold is not looked at.

        Raises:
            Avs3dError: naming the first one that is missing.
        """
        self.check_home()
        for kind, items in (("mesh", self.object_items), ("sound", self.sound_items)):
            for category, item in items:
                if item.file is not None:
                    resolve_file(self.base, item.file, f"{kind} for {category}")
        for name in self.directivity_files:
            resolve_file(self.base, name, "directivity")

    def _scan_digests(self) -> dict[str, str]:
        """sha256 of the files of its scan; a missing file is reported when it is opened."""
        if self.scan.source != "scan":
            return {}
        try:
            found = self.scan_files.digests()
            materials = self.material_file
        except Avs3dError:
            return {}
        return found | ({self.scan.materials or "": digest(materials)} if materials else {})

    @property
    def home_digest(self) -> str:
        """sha256 of all that the lit home depends on; observations with the same value share one entry of the cache."""
        further: tuple[Any, ...] = ()
        if self.scan.source == "scan":
            further = (self.options.renderer, self._scan_digests())
        elif self.options.device != "cpu":
            # Rays differ by rounding: the bytes are those of this kind of device.
            further = (self.backends[f"device {self.options.device}"],)
        return home_digest(self.spec.scan, self.scan, self.light, *further)


def home_digest(name: str, scan: ScanSpec, light: str, *further: Any) -> str:
    """sha256 of what a lit home depends on.

    Args:
        name: of the home.
        scan: its entry in a manifest.
        light: quality of its light.
        further: what else it depends on: the digests of a scan's files, the version of a device.
    """
    document = [name, scan.identity(), light, "", *further]
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def _identities(table: Mapping[str, Sequence[AssetSpec]], used: Iterable[str]) -> dict[str, list[dict[str, Any]]]:
    """The entries of ``objects`` or ``sounds`` of the categories ``used``, for digests."""
    return {name: [item.identity() for item in table[name]] for name in used if table.get(name)}


def derive_rng(seed: int, key: str, purpose: str) -> np.random.Generator:
    """A random number generator seeded by a stable hash of (seed, key, purpose), independent of any global state.

    A seed of more than 64 bits is a secret (see docs/sealed.md). `SeedSequence` mixes its words by steps that can be
    undone: who finds the state of a published stream, such as ``points``, could compute every other stream of that
    seed. A secret seed therefore goes into the hash itself.
    """
    words = np.frombuffer(hashlib.sha256(f"{key}\0{purpose}".encode()).digest(), dtype="<u4")
    if seed >= SECRET_SEEDS:
        words = np.frombuffer(hashlib.sha256(f"{seed}\0{key}\0{purpose}".encode()).digest(), dtype="<u4")
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([int(word) for word in words])))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *(int(word) for word in words)])))


def head_rng(seed: int, spec: ObservationSpec) -> np.random.Generator:
    """The generator from which the head of an observation is drawn: that of all its variants and siblings."""
    return derive_rng(seed, spec.like or spec.key, "head")


def takes_of(manifest: Manifest) -> dict[str, dict[str, Takes]]:
    """Key of an observation of part_3 → category that sounds from recordings → its takes.

    The takes of a category are numbered over all siblings of a group, by their index; variants have those of their
    original. So a sibling that is made alone plays what it plays among the others.
    """
    found: dict[str, dict[str, Takes]] = {}
    groups: dict[str, list[ObservationSpec]] = {}
    for spec in sorted(manifest.observations, key=lambda spec: spec.index):
        if spec.is_part_3 and spec.variant_of is None:
            groups.setdefault(spec.like or spec.key, []).append(spec)
    for group in groups.values():
        names = {spec.key: [source.category for source in spec.sources or ()] for spec in group}
        heard = {key: [name for name in each if manifest.sounds.get(name)] for key, each in names.items()}
        counts = Counter(name for each in heard.values() for name in each)
        given: Counter[str] = Counter()
        for key, each in heard.items():
            found[key] = {name: Takes(given[name], counts[name]) for name in dict.fromkeys(each)}
            given.update(each)
    return found


def _check_variants(manifest: Manifest) -> None:
    """Check the names of procedural variants, in ``models`` and in observations.

    Raises:
        UsageError: naming the first one that does not exist.
    """
    named = [("models", name, variant) for name, variants in manifest.models.items() for variant in variants]
    for spec in manifest.observations:
        if spec.variant is not None and spec.category is not None and spec.category not in manifest.objects:
            named.append((spec.key, spec.category, spec.variant))
    if not named:
        return
    from generators.assets.catalogue import training_variants, variants

    for where, category, variant in named:
        known = (*variants(category), *training_variants(category))
        if variant not in known:
            hint = did_you_mean(variant, known)
            raise UsageError(
                f"{manifest.name}: {where}: unknown variant {variant!r} of {category}; "
                f"expected one of {', '.join(known)}{hint}"
            )


def _check_surfaces(manifest: Manifest) -> None:
    """Check the surfaces of scans.

    Raises:
        UsageError: naming the first place or material that does not exist.
    """
    for name, scan in manifest.scans.items():
        if scan.surfaces:
            from generators.scans.sound import check_surfaces

            check_surfaces(scan.surfaces, f"{manifest.name}: scans: {name}: surfaces")


def _check_voices(manifest: Manifest) -> None:
    """Check the names of ``voices``.

    Raises:
        UsageError: naming the first one that does not exist.
    """
    if not manifest.voices:
        return
    from generators.assets.sounds import find_voice

    for category, names in manifest.voices.items():
        for name in names:
            try:
                find_voice(category, name)
            except UsageError as error:
                raise UsageError(f"{manifest.name}: voices: {error}") from None


def make_plans(source: ManifestFile, options: GenerateOptions | None = None) -> tuple[ObservationPlan, ...]:
    """One plan per selected observation.

    Args:
        source: the manifest.
        options: of the run; None: the defaults.

    Raises:
        UsageError: if a pattern of ``only`` matches nothing, the engine lacks a receiver or directivities, or the lock
            file lacks an asset.
        Avs3dError: if a backend is not installed, the device cannot be used, an asset is not in the store, or the file
            of a receiver is missing or wrong.
    """
    from generators.backends import backend_versions, check_directed

    manifest, asked = source.manifest, options or GenerateOptions()
    changes = {"frames": asked.frames, "size": asked.size}
    camera = manifest.camera.model_copy(update={name: value for name, value in changes.items() if value is not None})
    engines = asked.engine_options(manifest.engine(), manifest.hrtf)
    selected = select(manifest, asked.only)
    for spec in selected:
        if spec.directed:
            check_directed(engines.engine, f"{manifest.name}: {spec.key}")
    backends = backend_versions(engines)
    _check_variants(manifest)
    _check_voices(manifest)
    _check_surfaces(manifest)
    check_assets(
        source.base / LOCK_NAME,
        manifest.objects,
        manifest.sounds,
        {category for spec in selected for category in (*spec.heard, *spec.objects)},
        {spec.scan: manifest.scans[spec.scan] for spec in selected},
    )

    takes = takes_of(manifest)

    def planned(spec: ObservationSpec) -> ObservationPlan:
        return ObservationPlan(
            spec=spec,
            scan=manifest.scans[spec.scan],
            camera=camera,
            light=manifest.light,
            seed=manifest.seed,
            base=source.base,
            objects=manifest.objects,
            sounds=manifest.sounds,
            options=replace(engines, receivers=engines.receivers.for_observation(head_rng(manifest.seed, spec))),
            backends=backends,
            categories=manifest.categories,
            models=manifest.models,
            voices=manifest.voices,
            levels=manifest.levels,
            takes=takes.get(spec.variant_of or spec.key, {}),
        )

    named = {spec.like for spec in selected}
    firsts = {spec.key: planned(spec) for spec in manifest.observations if spec.key in named}
    return tuple(replace(planned(spec), first=firsts.get(spec.like or "")) for spec in selected)


def scans_root(base: Path, chosen: Path | None = None) -> Path:
    """Where relative names of scan files start: the folder that was chosen, ``$AVS3D_SCANS``, or the manifest's."""
    named = chosen or os.environ.get("AVS3D_SCANS")
    return user_path(named) if named else base


def check_scans(plans: Sequence[ObservationPlan]) -> None:
    """Look for the scans before anything slow happens; some may be missing, but not all.

    Raises:
        Avs3dError: one line, if the scan of every observation of ``plans`` is missing.
    """
    missing: dict[str, Avs3dError] = {}
    for plan in {plan.spec.scan: plan for plan in plans}.values():
        try:
            plan.check_home()
            return
        except Avs3dError as error:
            missing[plan.spec.scan] = error
    if not missing:
        return
    first = next(iter(missing.values()))
    if len(missing) == 1:
        raise first
    raise Avs3dError(f"none of the scans {', '.join(missing)} was found: {first}")


def locate(base: Path, name: str) -> Path:
    """The path of a file that a manifest names: absolute, below a home folder (``~/…``), or relative to ``base``.

    Raises:
        UsageError: if the name begins with ``~`` and that home folder is unknown, or the name is too long.
    """
    path = base / user_path(name)
    try:
        path.is_file()
    except OSError as error:
        raise UsageError(files.os_error_line(error, path, "look for it")) from None
    return path


def resolve_file(base: Path, name: str, what: str) -> Path:
    """A file that a manifest names; see `locate`.

    Raises:
        Avs3dError: if it does not exist.
    """
    path = locate(base, name)
    if not path.is_file():
        raise Avs3dError(f"{path}: {what} not found; put the file there or correct its name in the manifest")
    return path
