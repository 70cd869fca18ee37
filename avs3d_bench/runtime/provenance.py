"""Digest of the software that a result depends on: it changes when the result may change.

    made_by = provenance("home")
    made_by.digest

A result depends on the sources in the folders and modules that `RESULTS` lists for it, on the versions of the libraries
that those import, and on Python's minor version. A Python file counts as its syntax tree without docstrings and
positions: comments, docstrings and line breaks may change; any other edit counts, also one that happens to change no
result. Every other file of a folder counts with all its bytes. Nothing is executed, and files are read from a checkout,
an installed wheel or a zip file. To parse the sources of an observation takes more than a second: what they come to is
kept by the bytes of each file, beside Python's compiled code of this module.
"""

from __future__ import annotations

import ast
import gc
import hashlib
import importlib.resources
import importlib.util
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError

#: Packages whose sources count; anything else that is imported counts by its version.
PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")
#: Name of the digest in `Provenance.versions`.
SOFTWARE = "software"
#: Version of the way a digest is computed; raise it when that changes.
FORMAT = 2

#: Records, file formats and geometry: what every reader and writer of a dataset or submission uses.
CONTRACT = (
    "avs3d_bench.contract",
    "avs3d_bench.dataset",
    "avs3d_bench.errors",
    "avs3d_bench.formats",
    "avs3d_bench.geometry",
    "avs3d_bench.measures.decay",
    "avs3d_bench.method",
    "avs3d_bench.runtime.user_path",
    "avs3d_bench.submission",
    "avs3d_bench.text",
)
#: What makes the cleaned mesh of an asset from the library.
_ASSET = (
    "generators.assets",
    "generators.core",
    "generators.library.archive",
    "generators.library.cleanglb",
    "generators.library.glazing",
    "generators.library.lock",
    "generators.library.mesh_cleaning",
    "generators.library.objfile",
    "generators.library.orientation",
    "generators.library.rawmesh",
    "generators.library.simplify",
    "generators.library.store",
)
#: What answers questions by rules.
_QUESTIONS = (
    "avs3d_bench.exports.qa.templates",
    "baselines.echosegnet.binaural",
    "baselines.oracle",
    "baselines.oracle_errors",
    "baselines.questions",
    "baselines.references",
)
#: Result → folders (with all that is below them) and modules whose sources it depends on. A method of `baselines` that
#: is not listed depends on its own folder or module and on `CONTRACT`.
RESULTS: Mapping[str, tuple[str, ...]] = {
    # A built and lit apartment, in the cache.
    "home": (
        "avs3d_bench.errors",
        "generators.apartments",
        "generators.assets.clutter",
        "generators.assets.finishes",
        "generators.assets.forms",
        "generators.assets.furniture",
        "generators.assets.materials",
        "generators.assets.shapes",
        "generators.assets.styles",
        "generators.assets.textures",
        "generators.core",
        "generators.homes.cache",
        "generators.lighting",
    ),
    "asset": (*CONTRACT, *_ASSET),
    # Of the backends, only those that are chosen count: see `generators.backends.observation_provenance`.
    "observation": (
        *CONTRACT,
        *_ASSET,
        "generators.acoustics",
        "generators.apartments",
        "generators.backends",
        "generators.homes",
        "generators.library.licences",
        "generators.library.references",
        "generators.lighting",
        "generators.manifest",
        "generators.objects",
        "generators.observation",
        "generators.options",
        "generators.paths",
        "generators.placement",
        "generators.plan",
        "generators.scans",
        "generators.scenes",
        "generators.vision",
    ),
    # The tar of an observation, besides the observation.
    "tar": (
        *CONTRACT,
        "avs3d_bench.exports.observation_tar",
        "avs3d_bench.exports.samples",
        "avs3d_bench.exports.tar_format",
        "generators.observation.output",
        "generators.observation.tar_output",
    ),
    "scores": (
        *CONTRACT,
        "avs3d_bench.measures.centre_box",
        "avs3d_bench.measures.deaf_oracles",
        "avs3d_bench.measures.pair_kinds",
        "avs3d_bench.formats.predictions",
        "avs3d_bench.contract.scores",
        "avs3d_bench.sealing.seal",
        "avs3d_bench.sealing.secret",
        "evaluators",
    ),
    "baselines.deaf": (
        *CONTRACT,
        "avs3d_bench.measures.deaf_oracles",
        "baselines.deaf",
        "baselines.oracle",
        "baselines.oracle_errors",
    ),
    "baselines.denseav": (*CONTRACT, "baselines.denseav", "baselines.networks", "baselines.sound_control"),
    "baselines.direction_alone": (
        *CONTRACT,
        "avs3d_bench.exports.samples",
        "baselines.direction_alone",
        "baselines.echosegnet",
        "baselines.listener",
        "baselines.networks",
        "baselines.oracle",
        "baselines.oracle_errors",
        "baselines.sound_control",
    ),
    "baselines.foundation": (
        *CONTRACT,
        "baselines.echosegnet",
        "baselines.foundation",
        "baselines.networks",
        "baselines.oracle",
        "baselines.oracle_errors",
        "baselines.owod_bind",
        "baselines.sound_control",
    ),
    "baselines.echosegnet": (
        *CONTRACT,
        "baselines.echosegnet",
        "baselines.oracle",
        "baselines.oracle_errors",
        "baselines.sound_control",
    ),
    "baselines.listener": (
        *CONTRACT,
        "avs3d_bench.exports.samples",
        "baselines.listener",
        "baselines.networks",
        "baselines.sound_control",
    ),
    "baselines.oracle": (*CONTRACT, "baselines.oracle", "baselines.oracle_errors"),
    "baselines.owod_bind": (*CONTRACT, "baselines.networks", "baselines.owod_bind", "baselines.sound_control"),
    "baselines.questions": (*CONTRACT, *_QUESTIONS),
    "baselines.questions_inspect": (*CONTRACT, *_QUESTIONS, "baselines.questions_inspect"),
    "baselines.references": (
        *CONTRACT,
        "baselines.echosegnet.binaural",
        "baselines.oracle",
        "baselines.oracle_errors",
        "baselines.references",
    ),
    "baselines.trivial": (*CONTRACT, "avs3d_bench.measures.centre_box", "baselines.trivial"),
}
#: Parts of listed folders that do not count, except where a row lists them by name: commands, pages, comparisons.
LEFT_OUT = frozenset(
    {
        "avs3d_bench.contract.comparisons",
        "avs3d_bench.contract.competition",
        "avs3d_bench.contract.frame_rows",
        "avs3d_bench.contract.schemas",
        "avs3d_bench.contract.score_frames",
        "avs3d_bench.contract.scores",
        "avs3d_bench.formats.predictions",
        "avs3d_bench.formats.staging",
        "avs3d_bench.text.templates",
        "baselines.listener.cli",
        "evaluators.cli",
        "evaluators.competition",
        "evaluators.metrics.accumulator",
        "evaluators.metrics.conventions",
        "evaluators.metrics.inputs",
        "evaluators.metrics.pointing",
        "evaluators.metrics.rir",
        "evaluators.reading.convention_names",
        "evaluators.questions",
        "evaluators.reading.mask_folders",
        "evaluators.statistics.comparison",
        "evaluators.statistics.curves",
        "evaluators.statistics.factors",
        "evaluators.statistics.frame_rows",
        "evaluators.reporting",
        "evaluators.statistics.sign_flips",
        "evaluators.verify",
        "generators.observation.tar_output",
        "generators.scenes.home_scene",
        "generators.scenes.showing",
        "generators.scenes.sound",
        "generators.scenes.viewpoints",
    }
)
#: Module of a backend → what else only this backend uses.
BACKENDS: Mapping[str, tuple[str, ...]] = {
    "generators.acoustics.tracer.backend": ("generators.acoustics.tracer",),
    "generators.vision.cuda": ("generators.vision.device_kernels",),
    "generators.vision.splats.backend": ("generators.vision.splats",),
    "generators.vision.habitat": ("generators.vision.habitat_process", "generators.vision.habitat_worker"),
    "generators.vision.pathtraced": ("generators.vision.mitsuba_materials", "generators.vision.mitsuba_scene"),
}

#: Libraries that only import names of ours on demand: no result depends on their version.
_NAME_RESOLVERS = frozenset({"lazy_loader"})
#: Suffixes of files that do not count: compiled code, and declarations for type checkers.
_IGNORED = (".pyc", ".pyi", ".so", ".typed")
#: Functions that import the module of their first argument.
_IMPORTERS = ("import_module", "__import__")
#: Kind of node of a syntax tree → its fields that count.
_FIELDS: Mapping[type, tuple[str, ...]] = {
    kind: tuple(field for field in kind._fields if field not in ("ctx", "kind", "type_comment", "type_ignores"))
    for kind in vars(ast).values()
    if isinstance(kind, type) and issubclass(kind, ast.AST)
}
#: Number of sources that are remembered: several times those of an installation, so that old ones are forgotten.
_REMEMBERED = 4096
#: Kinds of nodes that may begin with a docstring.
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
#: Kinds of nodes that may import.
_IMPORTING = (ast.Import, ast.ImportFrom, ast.Call)


@dataclass(frozen=True)
class Provenance:
    """The software behind a result.

    Attributes:
        sources: path (``generators/core/scene.py``) → sha256 of what counts of the file.
        libraries: distribution → version; ``none`` for what is imported but not installed.
        python: Python's minor version (``3.11``).
    """

    sources: Mapping[str, str]
    libraries: Mapping[str, str]
    python: str

    @cached_property
    def digest(self) -> str:
        """sha256 over all of it, 64 hexadecimal digits."""
        document = [FORMAT, sorted(self.sources.items()), sorted(self.libraries.items()), self.python]
        return hashlib.sha256(json.dumps(document).encode()).hexdigest()

    @property
    def versions(self) -> dict[str, str]:
        """Name → version: the digest as `SOFTWARE`, Python and the libraries."""
        return {SOFTWARE: self.digest, "python": self.python, **self.libraries}


@lru_cache(maxsize=64)
def provenance(*results: str, without: tuple[str, ...] = ()) -> Provenance:
    """The software of this installation that results depend on.

    Args:
        results: rows of `RESULTS`, or ``module:function`` of a method of `baselines`.
        without: ``module`` or ``module:name`` of backends that were not chosen.

    Raises:
        Avs3dError: if there is no such result, or a source is missing or cannot be read.
    """
    known = _remembered()
    before = len(known)
    with _without_collection():
        found = read_provenance(importlib.resources.files, results, without=without)
    if len(known) > before:
        _remember(known)
    return found


@contextmanager
def _without_collection() -> Iterator[None]:
    """Collect no garbage: syntax trees are millions of objects and no cycles, and going over them doubles the time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def read_provenance(files: Callable[[str], Any], results: Iterable[str], *, without: Iterable[str] = ()) -> Provenance:
    """See `provenance`.

    Args:
        files: name of a package → its folder, a `pathlib.Path` or another ``Traversable``.
        results: as for `provenance`.
        without: as for `provenance`.
    """
    unused = {backend.partition(":")[0] for backend in without}
    unused = unused.union(*(BACKENDS.get(module, ()) for module in unused), LEFT_OUT)
    sources: dict[str, str] = {}
    libraries: set[str] = set()
    for name in dict.fromkeys(name for result in results for name in folders_of(result)):
        for path, file in source_files(name, files, unused):
            data = file.read_bytes()
            if not path.endswith(".py"):
                sources[path] = hashlib.sha256(data).hexdigest()
                continue
            try:
                sources[path], imported = _read_source(data)
            except (SyntaxError, ValueError) as error:
                raise Avs3dError(f"{path}: cannot be read as Python ({error}); reinstall avs3d-bench") from None
            libraries.update(imported)
    versions: dict[str, str] = {}
    for library in libraries:
        versions |= _versions(library)
    return Provenance(sources, dict(sorted(versions.items())), f"{sys.version_info[0]}.{sys.version_info[1]}")


def folders_of(result: str) -> tuple[str, ...]:
    """The folders and modules that a result depends on.

    Raises:
        Avs3dError: if there is no such result.
    """
    if result in RESULTS:
        return RESULTS[result]
    package, *below = result.partition(":")[0].split(".")
    if package != "baselines" or not below:
        raise Avs3dError(
            f"provenance of {result}: expected one of {', '.join(RESULTS)}, or module:function of a method of baselines"
        )
    method = f"{package}.{below[0]}"
    return RESULTS.get(method, (*CONTRACT, method))


def source_files(
    name: str, files: Callable[[str], Any] = importlib.resources.files, without: Iterable[str] = ()
) -> Iterator[tuple[str, Any]]:
    """The files of a folder, with all that is below it, or of a module.

    Args:
        name: dotted.
        files: as for `read_provenance`.
        without: dotted names of folders and modules below it to leave out.

    Yields:
        The path, from the package's name on, and the file, in the order of the paths' names.

    Raises:
        Avs3dError: if there is no such folder or module.
    """
    package, *below = name.split(".")
    place = files(package).joinpath(*below)
    path = name.replace(".", "/")
    if place.is_dir():
        yield from _files_below(place, path, frozenset(each.replace(".", "/") for each in without))
        return
    module = files(package).joinpath(*below[:-1], f"{below[-1]}.py") if below else place
    if not module.is_file():
        raise Avs3dError(f"{path}: no such folder or module of this installation; reinstall avs3d-bench with sources")
    yield f"{path}.py", module


def _files_below(folder: Any, path: str, without: frozenset[str]) -> Iterator[tuple[str, Any]]:
    for entry in sorted(folder.iterdir(), key=lambda entry: str(entry.name)):
        below = f"{path}/{entry.name}"
        if entry.name == "__pycache__" or entry.name.startswith(".") or below.removesuffix(".py") in without:
            continue
        if entry.is_dir():
            yield from _files_below(entry, below, without)
        elif not entry.name.endswith(_IGNORED):
            yield below, entry


def _read_source(source: bytes) -> tuple[str, Sequence[str]]:
    """sha256 of a Python file's normal form, and the libraries that it imports."""
    known, name = _remembered(), hashlib.sha256(source).hexdigest()
    if name not in known:
        known[name] = _parse_source(source)
    return known[name]


def _memory() -> Path:
    """Beside Python's compiled code of this module, since what it holds also depends on nothing but sources."""
    return Path(importlib.util.cache_from_source(__file__)).with_suffix(".sources.json")


def _own_digest() -> str:
    return hashlib.sha256(importlib.resources.files(__package__).joinpath("provenance.py").read_bytes()).hexdigest()


@lru_cache(maxsize=1)
def _remembered() -> dict[str, tuple[str, Sequence[str]]]:
    """sha256 of a Python file → `_parse_source` of it, as processes before this one found; reading takes a second."""
    with suppress(OSError, ValueError):
        by, known = json.loads(_memory().read_bytes())
        if by == _own_digest():
            return {name: (form, libraries) for name, (form, libraries) in known.items()}
    return {}


def _remember(known: dict[str, tuple[str, Sequence[str]]]) -> None:
    """Keep what is known for other processes, where Python keeps compiled code."""
    if sys.dont_write_bytecode:
        return
    path = _memory()
    own = path.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        newest = dict(list(known.items())[-_REMEMBERED:])
        own.write_text(json.dumps([_own_digest(), newest]))
        own.replace(path)


def _parse_source(source: bytes) -> tuple[str, Sequence[str]]:
    imported: set[str] = set()
    form = repr(_normal(ast.parse(source), imported)).encode(errors="surrogatepass")
    tops = {module.partition(".")[0] for module in imported} - {"", *PACKAGES, *_NAME_RESOLVERS}
    return hashlib.sha256(form).hexdigest(), sorted(tops - sys.stdlib_module_names)


def _normal(node: Any, imported: set[str]) -> Any:
    """A syntax tree as nested lists, without docstrings and positions; the modules that it imports are added."""
    if isinstance(node, list):
        return [_normal(each, imported) for each in node]
    if not isinstance(node, ast.AST):
        return node
    kind = type(node)
    if kind in _IMPORTING:
        imported |= _imported_by(node)
    elif kind in _DOCUMENTED and ast.get_docstring(node, clean=False) is not None:  # type: ignore[arg-type]
        del node.body[0]  # type: ignore[attr-defined]
    return [kind.__name__, *[_normal(getattr(node, field, None), imported) for field in _FIELDS[kind]]]


def _imported_by(node: ast.AST) -> set[str]:
    """The modules that a statement or a call imports."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names}
    if isinstance(node, ast.ImportFrom):
        return set() if node.level else {node.module or ""}
    if isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in _IMPORTERS:
        return {str(argument.value) for argument in node.args[:1] if isinstance(argument, ast.Constant)}
    return set()


@lru_cache(maxsize=1)
def _distributions() -> Mapping[str, list[metadata.Distribution]]:
    """Imported package → the distributions that install it.

    `importlib.metadata.packages_distributions` says the same, but makes an object of each of their 30,000 files.
    """
    found: dict[str, list[metadata.Distribution]] = {}
    for each in metadata.distributions():
        record = (each.read_text("RECORD") or "").splitlines()
        inferred = {line.partition(",")[0].partition("/")[0].removesuffix(".py") for line in record if ".py," in line}
        for package in (each.read_text("top_level.txt") or "").split() or inferred:
            found.setdefault(package, []).append(each)
    return found


@lru_cache(maxsize=256)
def _versions(package: str) -> Mapping[str, str]:
    """Distribution → version of those that an imported package comes from."""
    # Some do not say what they install.
    names = sorted({each.metadata["Name"] for each in _distributions().get(package, ())}) or [package]
    try:
        return {name: metadata.version(name) for name in names}
    except metadata.PackageNotFoundError:
        return {package: "none"}
