"""Opening a sealed test: is the truth what was committed to, and do the secret and the manifest make it again?"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from avs3d_bench.commands.report import Problem, ordered
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DrawsRecord, ObservationRecord, ProvenanceRecord, SealRecord, SecretCommitment
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.formats.yamlfile import read_yaml
from avs3d_bench.sealing.seal import (
    COMMITMENT,
    DRAWS,
    MANIFEST,
    OPENING,
    PRIVATE,
    PUBLIC,
    TEMPLATE,
    check_belonging,
    check_public,
    check_secret,
    check_truth,
    read_seal,
)
from avs3d_bench.sealing.secret import derive
from generators.backends import observation_provenance
from generators.manifest.reading import ManifestFile, read_manifest
from generators.options import WORDS, EngineOptions, GenerateOptions, further_options, head_identity
from generators.plan import ObservationPlan, make_plans
from generators.run.generation import generate_plans
from generators.sealing.consistency import Opened, check_consistency
from generators.sealing.draw import draw_document
from generators.sealing.texts import sealed_text


@dataclass(frozen=True)
class UnsealResult:
    """Result of opening a sealed test.

    Attributes:
        seal: its commitments.
        problems: everything that is not as committed to, sorted by file.
        made_again: keys of the observations that were generated again.
        notes: what could not be compared, and why observations that were generated again may differ.
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


def unseal(folder: Path, secret: bytes, again: Again | None = None) -> UnsealResult:
    """Check a sealed test whose truth and secret are published.

    By hashes: the secret, the manifest, every published file and every private file. From the secret: the seeds, homes
    and numbers in the manifest, the observations that there are, the sparse points, and what sounds. Of the records and
    masks: that they do not contradict one another (`generators.sealing.consistency`). With ``again``: the observations
    themselves, generated again.

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
    foreign = list(check_belonging(public, private, seal))
    problems = [*foreign]
    problems += _check_commitment(folder, seal)
    key, wrong = check_secret(secret, seal, private)
    problems += wrong
    if key is not None:
        problems += _check_manifest(private, key)
    problems += check_public(public, seal)
    # With a wrong secret, the private folder's own key still shows which files were changed.
    problems += check_truth(private, seal, opening=None if key is None else derive(key, OPENING))
    notes: tuple[str, ...] = ()
    if not foreign:
        opened, notes = _opened(public, private, seal, again or Again())
        problems += check_consistency(opened)
    if again is None or problems:
        return UnsealResult(seal, tuple(ordered(problems)), notes=notes)
    made, differences = _make_again(private, seal, again)
    return UnsealResult(seal, tuple(ordered(differences)), made, notes)


def other_software(seal: SealRecord) -> Iterator[str]:
    """Yield the lines to print if the software is not that of the seal."""
    made: dict[str, Any] = dict(seal.settings)
    here = observation_provenance(EngineOptions(vision=made["vision"], audio=made["audio"], device=made["device"]))
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


def _check_commitment(folder: Path, seal: SealRecord) -> Iterator[Problem]:
    """The commitment that lies beside the test, published before the template, is that of the seal."""
    path = folder / COMMITMENT
    if path.exists() and files.read_record(path, SecretCommitment) != seal.commitments.secret:
        yield Problem("error", COMMITMENT, "not the commitment in seal.json: the test was made with another secret")


def _check_manifest(private: Path, key: bytes) -> Iterator[Problem]:
    """Whether the manifest is the one that the secret draws from the template."""
    template, _ = read_yaml(private / TEMPLATE)
    draws = files.read_record(private / DRAWS, DrawsRecord).draws
    document, _ = draw_document(template, key, draws)
    if sealed_text(document).encode() != files.read_bytes(private / MANIFEST):
        yield Problem("error", MANIFEST, f"not what the secret draws from {TEMPLATE}: its seeds do not come from it")


def _opened(public: Path, private: Path, seal: SealRecord, again: Again) -> tuple[Opened, tuple[str, ...]]:
    """The opened test, with the plans of its observations if this software makes the same draws; and what is not."""
    source = _source(private, again)
    notes = list(other_software(seal))
    plans: dict[str, ObservationPlan] = {}
    digests: dict[str, str] = {}
    if notes:
        notes.append("not compared with the draws of the secret: which objects sound, and the sparse points")
    else:
        plans = {plan.key: plan for plan in make_plans(source, GenerateOptions(audio="analytic"))}
        try:
            made = make_plans(source, replace(_options(seal, again), only=()))
            for plan in made:
                plan.check_files()  # a missing one counts in the digest, too
            digests = {plan.key: plan.digest for plan in made}
        except Avs3dError as error:
            notes.append(f"plan_sha256 not compared: {error}")
    return Opened(public, private, seal, source.manifest, plans, digests), tuple(notes)


def _source(private: Path, again: Again) -> ManifestFile:
    """The manifest; files that it names lie in the folder of ``again``."""
    manifest = read_manifest(private / MANIFEST)
    base = (again.files or private).resolve()
    return ManifestFile(manifest.manifest, base / MANIFEST, manifest.text, manifest.sha256)


def _make_again(private: Path, seal: SealRecord, again: Again) -> tuple[tuple[str, ...], list[Problem]]:
    """Generate observations into a temporary folder, and compare them; returns their keys and what differs."""
    source = _source(private, again)
    options = _options(seal, again)
    with tempfile.TemporaryDirectory(prefix="avs3d-unseal-") as place:
        root = Path(place) / "again"
        outcome = generate_plans(source, make_plans(source, options), root, options)
        if outcome.failed:
            key, message = outcome.failed[0]
            raise Avs3dError(f"{key}: cannot be generated again: {message}")
        return outcome.made, [found for key in outcome.made for found in _compare(private, root, key)]


def _options(seal: SealRecord, again: Again) -> GenerateOptions:
    """The options with which the test was made.

    Raises:
        UsageError: if a file that it was made with is not given, or another one is.
    """
    made: dict[str, Any] = dict(seal.settings)
    hrtf, array = again.options.get("hrtf"), again.options.get("array")
    wanted = made["hrtf_sha256"]
    if head_identity(hrtf or None) != wanted:
        expected = f"--hrtf FILE with the sha256 {wanted}" if wanted else "no --hrtf"
        expected = f"--hrtf {wanted}" if wanted in WORDS else expected
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
        **further_options(seal.settings),
        **again.options,
    )


def _compare(private: Path, root: Path, key: str) -> Iterator[Problem]:
    """Differences between an observation and its regeneration."""
    name = layout.OBSERVATION_JSON
    if files.sha256_file(private / key / name) == files.sha256_file(root / key / name):
        return  # it has the sha256 of every other file
    old, new = (files.read_record(folder / key / name, ObservationRecord) for folder in (private, root))
    other = sorted(path for path in {*old.files, *new.files} if old.files.get(path) != new.files.get(path))
    for path in other or [name]:
        yield Problem("error", f"{key}/{path}", "differs from the file that was generated again")
