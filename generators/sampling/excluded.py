"""Seeds of homes and of manifests, and variants of the procedural models, that other manifests use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS, OFF_SCREEN_CATEGORIES
from avs3d_bench.errors import UsageError
from generators.assets.catalogue import training_variants, variants
from generators.assets.sounds import usual_voices, voices
from generators.core.limits import SoundSplit
from generators.library.lock import LOCK_NAME
from generators.manifest.reading import read_manifest
from generators.manifest.schema import Manifest


@dataclass(frozen=True)
class Excluded:
    """Seeds and variants that a sampled manifest must not use.

    Attributes:
        homes: seed of a procedural home → name of a manifest that has it.
        seeds: seed of a manifest → its name.
        variants: (category, variant) that a manifest may draw → its name.
        voices: (category, voice) that a manifest may draw → its name.
        scans: id of a scan that a manifest finds by its name → its name.
    """

    homes: dict[int, str]
    seeds: dict[int, str]
    variants: dict[tuple[str, str], str]
    voices: dict[tuple[str, str], str] = field(default_factory=dict)
    scans: dict[str, str] = field(default_factory=dict)

    def check_seed(self, seed: int) -> None:
        """Refuse the seed of an excluded manifest: with it, random draws of both would be related.

        Raises:
            UsageError: naming the manifest.
        """
        if seed in self.seeds:
            raise UsageError(f"--seed {seed} is the seed of the excluded manifest {self.seeds[seed]}; choose another")

    def held_out_models(self) -> dict[str, list[str]]:
        """``models`` of a manifest that shares no variant with the excluded ones: training variants only.

        Raises:
            UsageError: naming the first category of which none is left.
        """
        known = {category: training_variants(category) for category in (*CATEGORIES, *DISTRACTORS)}
        return _left(known, self.variants, "--hold-out-models", "training variant")

    def held_out_voices(self, split: SoundSplit = "train") -> dict[str, list[str]]:
        """``voices`` of a manifest that shares none with the excluded ones: voices of one split only.

        Raises:
            UsageError: naming the first category of which none is left.
        """
        sounds = (*CATEGORIES, *OFF_SCREEN_CATEGORIES)
        known = {name: [voice.name for voice in voices(name) if voice.split == split] for name in sounds}
        return _left(known, self.voices, "--hold-out-sounds", f"{_WORDS[split]} voice")


_WORDS: dict[SoundSplit, str] = {"train": "training", "validation": "validation", "test": "test"}


def _left(
    known: Mapping[str, Sequence[str]], used: Mapping[tuple[str, str], str], option: str, kind: str
) -> dict[str, list[str]]:
    """Category → names that no excluded manifest uses."""
    left = {}
    for category, names in known.items():
        left[category] = [name for name in names if (category, name) not in used]
        if not left[category]:
            users = sorted({used[category, name] for name in names})
            why = f"{', '.join(users)} uses all of them" if users else "it has none"
            raise UsageError(
                f"{option}: no {kind} of {category} is left ({why}); exclude fewer manifests, or leave the option out"
            )
    return left


def what_they_use(manifests: Sequence[Path], output: Path) -> Excluded:
    """Read the manifests to exclude; a folder stands for those in it, except ``output``.

    Raises:
        UsageError: if one cannot be read.
    """
    found = Excluded({}, {}, {})
    for path in manifests:
        inside = [p for p in sorted(path.glob("*.yaml")) if p.name != LOCK_NAME and p.resolve() != output.resolve()]
        if path.is_dir() and not inside:
            raise UsageError(
                f"--exclude {path}: no manifest (*.yaml) is in this folder; name a file, or another folder"
            )
        for file in inside if path.is_dir() else [path]:
            _add(found, read_manifest(file).manifest)
    return found


def _add(found: Excluded, manifest: Manifest) -> None:
    found.seeds.setdefault(manifest.seed, manifest.name)
    for name, scan in manifest.scans.items():
        if scan.source == "scan":
            # A sealed test names the files of its scans; a public manifest that does so, too, names the same ones.
            found.scans.setdefault(scan.file or scan.asset or name, manifest.name)
        elif scan.seed is not None:
            found.homes.setdefault(scan.seed, manifest.name)
    for spec in manifest.observations:
        for category in spec.heard:
            # Own categories and categories with recordings draw no voice.
            synthetic = category not in manifest.categories and not manifest.sounds.get(category)
            for voice in manifest.voices.get(category) or (usual_voices(category) if synthetic else ()):
                found.voices.setdefault((category, voice), manifest.name)
        for category in spec.objects:
            # Files replace procedural models, and a category of the manifest's own has no others.
            if manifest.objects.get(category) or category in manifest.categories:
                continue
            for variant in manifest.models.get(category) or variants(category):
                found.variants.setdefault((category, variant), manifest.name)
        if spec.variant is not None and spec.category is not None:
            found.variants.setdefault((spec.category, spec.variant), manifest.name)
