"""A manifest's file: reading it, and choosing observations by patterns."""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.formats.yamlfile import read_yaml
from generators.manifest.messages import Fault, in_lines, messages
from generators.manifest.schema import Manifest, ObservationSpec


@dataclass(frozen=True)
class ManifestFile:
    """A manifest with its file.

    Attributes:
        manifest: what it says.
        path: of the file, absolute.
        text: of the file.
        sha256: of its bytes.

    Examples:
        >>> source = read_manifest("room.yaml")
        >>> source.path.name, source.base == source.path.parent, len(source.sha256)
        ('room.yaml', True, 64)
        >>> source.manifest.name, len(source.manifest.observations)
        ('room', 2)
    """

    manifest: Manifest
    path: Path
    text: str
    sha256: str

    @property
    def base(self) -> Path:
        """Folder that relative file names in the manifest refer to."""
        return self.path.parent

    def refusal(self, faults: Sequence[Fault]) -> tuple[str, ...]:
        """A message for each problem, with the manifest, the field and its line."""
        return in_lines(faults, self.path, self.text)


def read_manifest(path: str | Path) -> ManifestFile:
    """Read and check a manifest.

    Args:
        path: of the YAML file.

    Raises:
        UsageError: for each problem a line with the file, the field, its line, what was found and what was expected.

    Examples:
        >>> manifest = read_manifest("room.yaml").manifest
        >>> [entry.key for entry in manifest.observations]
        ['part_1/box/kitchen/1', 'part_2/box/kitchen/1']
        >>> from pathlib import Path
        >>> text = Path("room.yaml").read_text("utf-8").replace("frames: 12", "frames: 0").replace("seed: ", "sed: ")
        >>> _ = Path("wrong.yaml").write_text(text, "utf-8")
        >>> from avs3d_bench import Avs3dError
        >>> try:
        ...     read_manifest("wrong.yaml")
        ... except Avs3dError as error:
        ...     print(error)
        wrong.yaml: seed: is missing
        wrong.yaml, line 5: camera.frames: Input should be greater than or equal to 1 (found 0)
        wrong.yaml, line 2: sed: unknown field; did you mean 'seed'?
    """
    path = Path(path)
    try:
        document, raw = read_yaml(path)
    except UsageError:
        raise
    except Avs3dError as error:
        raise UsageError(f"cannot read the manifest: {error}") from error
    if not isinstance(document, dict):
        raise UsageError(
            f"{path}: expected a mapping with name, seed, scans and observations, found {excerpt(document)}"
        )
    try:
        manifest = Manifest.model_validate(document)
    except ValidationError as error:
        raise UsageError(*messages(error, path, raw.decode("utf-8"), Manifest)) from None
    return ManifestFile(manifest, path.resolve(), raw.decode("utf-8"), hashlib.sha256(raw).hexdigest())


def select(manifest: Manifest, patterns: Sequence[str], option: str = "--only") -> tuple[ObservationSpec, ...]:
    """The observations whose key matches one of the shell patterns (all without patterns), in the manifest's order.

    Args:
        manifest: with the observations.
        patterns: as the user gave them.
        option: that takes the patterns, for the message.

    Raises:
        UsageError: if a pattern matches nothing.
    """
    for pattern in patterns:
        if not any(fnmatch.fnmatchcase(entry.key, pattern) for entry in manifest.observations):
            raise UsageError(
                f"{option} {excerpt(pattern)} matches no observation of {manifest.name}; "
                f"keys look like {manifest.observations[0].key!r}"
            )
    return tuple(
        entry
        for entry in manifest.observations
        if not patterns or any(fnmatch.fnmatchcase(entry.key, pattern) for pattern in patterns)
    )
