"""Making a sealed test, from a manifest and a secret to two folders: read `seal` top to bottom for the whole story."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import Scalar, SealRecord, SecretCommitment
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import files
from avs3d_bench.formats.staging import staged_folder
from avs3d_bench.formats.yamlfile import read_yaml
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.scheduling.options import Options as Scheduling
from avs3d_bench.sealing.seal import COMMITMENT, DRAWS, MANIFEST, OPENING_KEY, PRIVATE, PUBLIC, SECRET
from avs3d_bench.sealing.secret import SECRET_BYTES, CommittedSecret, commit, read_secret, working_key
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest
from generators.observation.sources import check_takes
from generators.options import GenerateOptions, head_identity
from generators.plan import make_plans
from generators.run.generation import generate_plans
from generators.sampling.excluded import what_they_use
from generators.sealing.draw import Document, check_template, fit_homes
from generators.sealing.fitting import HomeFitting
from generators.sealing.publish import Sealing, write_private, write_public
from generators.sealing.strength import require_strong
from generators.sealing.texts import sealed_text, template_text

#: Where the whole dataset lies while it is generated; a second call goes on with it.
WORK = ".generated"
#: The manifests of the repository, whose homes are public; absent where only the package is installed.
PUBLIC_MANIFESTS = Path(__file__).resolve().parents[2] / "scenes_manifest"


@dataclass(frozen=True)
class SealedTest:
    """A sealed test on disk.

    Attributes:
        public, private: its folders.
        secret: the file of its secret.
        record: its commitments.
        digest: sha256 of seal.json: whoever publishes it is bound to all commitments.
    """

    public: Path
    private: Path
    secret: Path
    record: SealRecord
    digest: str


def seal(
    template: ManifestFile,
    folder: Path,
    *,
    secret_file: Path | None = None,
    options: GenerateOptions,
    train_truth: bool = False,
    exclude: Sequence[Path] = (),
    scheduling: Scheduling | None = None,
    progress: bool = False,
) -> SealedTest:
    """Make a sealed test of the observations that a manifest describes.

    The same manifest, secret, commitment, options and versions give the same bytes. After an interruption the same call
    goes on.

    Args:
        template: the manifest; its seeds are not used.
        folder: gets ``public/``, ``private/``, ``commitment.json`` and, without ``secret_file``, ``secret``.
        secret_file: the secret, 64 hexadecimal digits; None: 32 random bytes are drawn and written.
        options: as of `avs3d generate`.
        train_truth: publish the masks of train frames.
        exclude: manifests, or folders of them, whose homes must not be used, beside those of the repository.
        scheduling: where it runs; None: on this machine.
        progress: report on stderr.

    Raises:
        UsageError: if the manifest cannot be sealed, the secret is wrong, or ``folder`` holds a sealed test.
        Avs3dError: if no home has room for the observations, or some cannot be made.
    """
    check_template(template)
    _check_place(folder, secret_file)
    _refuse_seal(folder / PUBLIC)
    _refuse_others(folder / PRIVATE)
    check_takes(make_plans(template, options))
    taken = _taken_homes(template, exclude)
    bound = bind_secret(folder, secret_file)
    secret = bound.secret.key
    document = settled(template, options)
    fitting = HomeFitting(template.path, options.workers or available_cores())
    sealed_document, draws = fit_homes(document, secret, fitting, taken)
    drawn = as_manifest(sealed_document, template)
    options = replace(options, audio=None, frames=None, size=None)
    work = folder / WORK
    _make_folder(work, 0o700)
    outcome = generate_plans(drawn, make_plans(drawn, options), work, options, scheduling, progress=progress)
    if outcome.failed:
        key, message = outcome.failed[0]
        raise Avs3dError(
            f"{folder}: {len(outcome.failed)} observations could not be made, first {key}: {message}; nothing is "
            "sealed; run the same command again, or ask for fewer objects in its room"
        )
    generated = Dataset(work)
    sealing = Sealing(template_text(document), drawn, draws, bound.secret, train_truth, settings_of(drawn, options))
    # The public folder comes last: with it, the test is sealed.
    with (
        staged_folder(folder / PUBLIC, _refuse_seal) as public,
        staged_folder(folder / PRIVATE, _refuse_others) as private,
    ):
        private.chmod(0o700)
        record = write_public(generated, public, sealing)
        write_private(generated, public, private, sealing)
    digest = files.sha256_file(folder / PUBLIC / layout.SEAL_JSON)
    shutil.rmtree(work, ignore_errors=True)
    return SealedTest(folder / PUBLIC, folder / PRIVATE, bound.file, record, digest)


@dataclass(frozen=True)
class BoundSecret:
    """A secret and the commitment to it, on disk.

    Attributes:
        file: of the secret.
        commitment_file: of the commitment.
        secret: both.
    """

    file: Path
    commitment_file: Path
    secret: CommittedSecret


def bind_secret(folder: Path, secret_file: Path | None) -> BoundSecret:
    """Commit to a secret, once: the first call draws what is missing, later ones find it.

    Args:
        folder: of the sealed test; has or gets ``commitment.json`` and, without ``secret_file``, ``secret``.
        secret_file: the secret; None: that of the folder.

    Raises:
        UsageError: if the secret can be guessed or is wrong, lies in a folder that is to be published, or is not the
            one that the folder's commitment is to.
    """
    _check_place(folder, secret_file)
    path, secret = _secret_of(folder, secret_file)
    require_strong(secret, path)
    place = folder / COMMITMENT
    if not place.exists():
        committed = commit(secret)
        _make_folder(folder)
        files.write_json(place, committed.commitment)
        return BoundSecret(path, place, committed)
    record = files.read_record(place, SecretCommitment)
    key = working_key(secret, record)
    if key is None:
        raise UsageError(
            f"{place}: the commitment to another secret than {path}; name that secret with --secret, or choose another "
            "folder with -o"
        )
    return BoundSecret(path, place, CommittedSecret(key, record))


def settled(template: ManifestFile, options: GenerateOptions) -> Document:
    """The template's document with the options that a manifest can hold: engine, frames, size of the pictures."""
    document, _ = read_yaml(template.path)
    document = dict(document)
    camera = {"frames": options.frames, "size": options.size}
    document["camera"] = (document.get("camera") or {}) | {k: v for k, v in camera.items() if v is not None}
    document["audio"] = template.manifest.engine(options.audio)
    return document


def as_manifest(document: Document, template: ManifestFile) -> ManifestFile:
    """The manifest of a document; files that it names lie beside the template."""
    text = sealed_text(document)
    digest = files.sha256_bytes(text.encode())
    return ManifestFile(Manifest.model_validate(document), template.path, text, digest)


def settings_of(drawn: ManifestFile, options: GenerateOptions) -> dict[str, Scalar]:
    """The options on which the bytes depend, for seal.json."""
    return {
        "vision": options.renderer,
        "audio": drawn.manifest.engine(options.audio),
        "device": options.device,
        "frames": drawn.manifest.camera.frames,
        "size": drawn.manifest.camera.size,
        "with": ",".join(sorted(options.extras)),
        "ambisonics": options.ambisonics,
        "array": options.array is not None,
        "hrtf_sha256": head_identity(options.hrtf),
        **options.further(),
    }


def _refuse_seal(public: Path) -> None:
    """Refuse a folder whose test is sealed already, as its commitments may be published, or that holds others' files.

    Raises:
        UsageError: naming the file.
    """
    path = public / layout.SEAL_JSON
    if path.exists():
        raise UsageError(f"{path}: this test is sealed already; choose another folder with -o")
    if public.exists() and (not public.is_dir() or any(public.iterdir())):
        raise UsageError(f"{public}: exists and holds no sealed test; choose another folder with -o")


def _refuse_others(private: Path) -> None:
    """Refuse a private folder unless it is missing, empty, or what an interrupted `seal` left.

    Raises:
        UsageError: naming the folder.
    """
    if not private.exists():
        return
    own = private.is_dir() and all((private / name).is_file() for name in (layout.SEAL_JSON, DRAWS, OPENING_KEY))
    if not own and (not private.is_dir() or any(private.iterdir())):
        raise UsageError(f"{private}: exists and holds no truth of a sealed test; choose another folder with -o")


def _make_folder(path: Path, mode: int = 0o777) -> None:
    """Make a folder; 0o700: one that only its owner can read.

    Raises:
        Avs3dError: if the system refuses.
    """
    try:
        path.mkdir(mode=mode, parents=True, exist_ok=True)
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, path, "write")) from error


def _taken_homes(template: ManifestFile, exclude: Sequence[Path]) -> dict[int, str]:
    """Seeds of homes that may not be used → name of a manifest that has it.

    Raises:
        UsageError: if a scan of the template is in a public manifest.
    """
    manifests = [*([PUBLIC_MANIFESTS] if PUBLIC_MANIFESTS.is_dir() else []), *exclude]
    used = what_they_use(manifests, Path(MANIFEST))
    for name, scan in template.manifest.scans.items():
        owner = next((used.scans[known] for known in used.scans if known in (scan.file or "")), None)
        if owner is not None:
            raise UsageError(
                f"{template.path}: scans.{name}: the manifest {owner}, which is public, uses the scan of {scan.file}; "
                "a sealed test needs other homes"
            )
    own = {scan.seed: template.manifest.name for scan in template.manifest.scans.values() if scan.seed is not None}
    return own | used.homes


def _check_place(folder: Path, secret_file: Path | None) -> None:
    """Refuse a secret that lies in a folder which is made, and may be published.

    Raises:
        UsageError: naming both.
    """
    for name in (PUBLIC, PRIVATE):
        if secret_file is not None and Path(os.path.realpath(secret_file)).is_relative_to(
            os.path.realpath(folder / name)
        ):
            raise UsageError(f"{secret_file}: the secret must not lie in {folder / name}; move it elsewhere")


def _secret_of(folder: Path, secret_file: Path | None) -> tuple[Path, bytes]:
    """The file of the secret, and its 32 bytes; without a file, they are drawn at the first call.

    Raises:
        UsageError: if the secret is wrong.
    """
    if secret_file is not None:
        return secret_file, read_secret(secret_file)
    path = folder / SECRET
    if not path.exists():
        try:
            _make_folder(folder)
            with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
                stream.write(secrets.token_bytes(SECRET_BYTES).hex().encode() + b"\n")
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, path, "write")) from error
    return path, read_secret(path)
