"""Opening a sealed test: is the truth what was committed to, and do the secret and the manifest make it again?"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from avs3d_bench import files, layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.report import Problem, ordered
from avs3d_bench.schema import ObservationRecord, ProvenanceRecord
from avs3d_bench.sealed import (
    DRAWS,
    MANIFEST,
    OPENING,
    PRIVATE,
    PUBLIC,
    TEMPLATE,
    DrawsRecord,
    SealRecord,
    check_belonging,
    check_public,
    check_secret,
    check_truth,
    derive,
    read_seal,
)
from avs3d_bench.yamlfile import read_yaml
from generators.sealing.draw import draw_document
from generators.sealing.texts import sealed_text


@dataclass(frozen=True)
class Opening:
    """What was found when a sealed test was opened.

    Attributes:
        seal: its commitments.
        problems: everything that is not as committed to, sorted by file.
        made_again: keys of the observations that were generated again.
        notes: why observations that were generated again may differ.
    """

    seal: SealRecord
    problems: tuple[Problem, ...]
    made_again: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Again:
    """How observations are generated again.

    Attributes:
        only: shell patterns of observation keys; none: all observations.
        files: folder with the files that the manifest names; None: ``private/``.
        options: workers and cache, and the files of a measured head or an array if the test was made with them.
    """

    only: Sequence[str] = ()
    files: Path | None = None
    options: dict[str, Any] = field(default_factory=dict)


def unseal(folder: Path, secret: bytes, again: Again | None = None) -> Opening:
    """Check a sealed test whose truth and secret are published.

    By sha256: the secret, the manifest, every published file and every truth file. From the secret: the seeds, homes
    and numbers in the manifest. With ``again``: the observations themselves, generated again.

    Args:
        folder: has ``public/`` and ``private/``.
        secret: 32 bytes.
        again: which observations to generate again; None: none.

    Raises:
        UsageError: if the folders are not there, or of different seals.
        Avs3dError: if a record is damaged, or observations cannot be generated.
    """
    public, private = folder / PUBLIC, folder / PRIVATE
    seal = read_seal(public)
    problems = list(check_belonging(public, private, seal))
    wrong = list(check_secret(secret, seal, private))
    problems += wrong or _check_manifest(private, secret)
    problems += check_public(public, seal)
    # With a wrong secret, the private folder's own key still shows which files were changed.
    problems += check_truth(private, seal, opening=None if wrong else derive(secret, OPENING))
    problems += _check_rest(private, seal)
    if again is None or problems:
        return Opening(seal, tuple(ordered(problems)))
    made, differences = _make_again(private, seal, again)
    return Opening(seal, tuple(ordered(differences)), made, tuple(other_software(seal)))


def other_software(seal: SealRecord) -> Iterator[str]:
    """What is said if the software is not that of the seal."""
    from generators.backends import observation_provenance

    made: dict[str, Any] = dict(seal.settings)
    here = observation_provenance(made["vision"], made["audio"], made["device"])
    if here.digest == seal.provenance.digest:
        return
    then = ProvenanceRecord.of(here).model_dump()
    before = seal.provenance.model_dump()
    libraries = {*then["libraries"], *before["libraries"]}
    other = [
        f"{name} {before['libraries'].get(name, 'none')} (here {then['libraries'].get(name, 'none')})"
        for name in sorted(libraries)
        if before["libraries"].get(name) != then["libraries"].get(name)
    ]
    if before["python"] != then["python"]:
        other.insert(0, f"Python {before['python']} (here {then['python']})")
    what = ", ".join(other) or "another version of the toolkit's sources"
    yield f"sealed with other software, so that bytes may differ: {what}"


def _check_manifest(private: Path, secret: bytes) -> Iterator[Problem]:
    """Whether the manifest is the one that the secret draws from the template."""
    template, _ = read_yaml(private / TEMPLATE)
    draws = files.read_record(private / DRAWS, DrawsRecord).draws
    document, _ = draw_document(template, secret, draws)
    if sealed_text(document).encode() != files.read_bytes(private / MANIFEST):
        yield Problem("error", MANIFEST, f"not what the secret draws from {TEMPLATE}: its seeds do not come from it")


def _check_rest(private: Path, seal: SealRecord) -> Iterator[Problem]:
    """Stems and impulse responses: observation.json has their sha256."""
    for key, committed in seal.commitments.truth.items():
        folder = private / key
        if not (folder / layout.OBSERVATION_JSON).is_file():
            continue  # named already
        record = files.read_record(folder / layout.OBSERVATION_JSON, ObservationRecord)
        for name, digest in record.files.items():
            if name in committed or layout.is_public(name):
                continue
            if not (folder / name).exists():
                yield Problem("error", f"{key}/{name}", "missing; observation.json names it")
            elif files.sha256_file(folder / name) != digest:
                yield Problem("error", f"{key}/{name}", "not the file that observation.json names: it was changed")


def _make_again(private: Path, seal: SealRecord, again: Again) -> tuple[tuple[str, ...], list[Problem]]:
    """Generate observations into a temporary folder, and compare them; returns their keys and what differs."""
    from generators.manifest import ManifestFile, read_manifest
    from generators.run.generation import generate_plans, plans_of

    manifest = read_manifest(private / MANIFEST)
    base = (again.files or private).resolve()
    source = ManifestFile(manifest.manifest, base / MANIFEST, manifest.text, manifest.sha256)
    options = _options(seal, again)
    with tempfile.TemporaryDirectory(prefix="avs3d-unseal-") as place:
        root = Path(place) / "again"
        outcome = generate_plans(source, plans_of(source, options), root, options)
        if outcome.failed:
            key, message = outcome.failed[0]
            raise Avs3dError(f"{key}: cannot be generated again: {message}")
        return outcome.made, [found for key in outcome.made for found in _compare(private, root, key)]


def _options(seal: SealRecord, again: Again) -> Any:
    """The options with which the test was made.

    Raises:
        UsageError: if a file that it was made with is not given, or another one is.
    """
    from generators.run.options import GenerateOptions

    made: dict[str, Any] = dict(seal.settings)
    hrtf, array = again.options.get("hrtf"), again.options.get("array")
    wanted = made["hrtf_sha256"]
    if (hrtf and files.sha256_file(hrtf)) != wanted:
        expected = f"--hrtf FILE with the sha256 {wanted}" if wanted else "no --hrtf"
        raise UsageError(f"the test was sealed with another head; expected {expected}")
    if (array is not None) != made["array"]:
        raise UsageError(f"the test was sealed {'with' if made['array'] else 'without'} an array; see --array")
    return GenerateOptions(
        only=again.only,
        vision=made["vision"],
        audio=made["audio"],
        device=made["device"],
        extras=tuple(name for name in made["with"].split(",") if name),
        ambisonics=made["ambisonics"],
        **again.options,
    )


def _compare(private: Path, root: Path, key: str) -> Iterator[Problem]:
    """What differs between an observation and the one that was generated again."""
    name = layout.OBSERVATION_JSON
    if files.sha256_file(private / key / name) == files.sha256_file(root / key / name):
        return  # it has the sha256 of every other file
    old, new = (files.read_record(folder / key / name, ObservationRecord) for folder in (private, root))
    other = sorted(path for path in {*old.files, *new.files} if old.files.get(path) != new.files.get(path))
    for path in other or [name]:
        yield Problem("error", f"{key}/{path}", "differs from the file that was generated again")
