"""Digest of the software that a result depends on: it changes when the result may change.

    made_by = provenance("generators.apartments.apartment:build_apartment", "generators.lighting.bake:bake")
    made_by.digest

A result depends on the sources of the function's module and of everything in our packages that it imports, directly or
through others; on the versions of the libraries that those import; and on Python's minor version. What is imported is
read from the sources with `ast`. Nothing is executed, and no list is kept by hand:

- ``import`` and ``from … import``, absolute and relative, at the top and inside functions and classes, but not under
  ``if TYPE_CHECKING``; in ``from package import name`` the name is a module where there is one of that name;
- the ``__init__`` of every package on the way, since Python executes it. An ``__init__`` that resolves names on demand
  (it defines ``__getattr__``) counts with the name that is asked for, as its ``TYPE_CHECKING`` block or its ``.pyi``
  file declares it;
- a text ``"package.module"`` or ``"package.module:name"`` that names a module of ours (`importlib.import_module`, a
  table of backends), and the entry points of a group, in a module that names the group and calls ``entry_points``;
- a data file of the module's package whose name is a text of the module (``"materials.json"``).

A source counts as its syntax tree without docstrings and positions: comments, docstrings and line breaks may change;
any other edit counts, also one that happens to change no result. Sources are read through Python's import system, from
a checkout, an installed wheel or a zip file, and each one once per process.
"""

from __future__ import annotations

import ast
import gc
import hashlib
import importlib.util
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import metadata
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

from avs3d_bench.errors import Avs3dError

#: Packages whose sources count; anything else that is imported counts by its version.
PACKAGES = ("avs3d_bench", "generators", "evaluators", "baselines")
#: Name of the digest in `Provenance.versions`.
SOFTWARE = "software"
#: Name of the distribution whose entry points count.
DISTRIBUTION = "avs3d-bench"
#: Version of the way a digest is computed; raise it when that changes.
FORMAT = 1
#: Libraries that only import names of ours on demand: no result depends on their version.
_NAME_RESOLVERS = frozenset({"lazy_loader"})
#: Files of a package that are no data.
_CODE_SUFFIXES = (".py", ".pyi", ".pyc", ".so", ".typed")
_MODULE_TEXT = re.compile(rf"(?:{'|'.join(PACKAGES)})(?:\.\w+)+")


@dataclass(frozen=True)
class Module:
    """The imports and names of one source file.

    Attributes:
        name: dotted.
        digest: sha256 of the normalised source.
        imports: pairs (module, name or None) as the import statements have them, absolute.
        texts: the text constants, without docstrings.
        calls_entry_points: whether it looks up entry points.
        on_demand: of a package that resolves names on demand: name → (module, name) of what it stands for.
    """

    name: str
    digest: str
    imports: frozenset[tuple[str, str | None]]
    texts: frozenset[str]
    calls_entry_points: bool
    on_demand: Mapping[str, tuple[str, str | None]] | None


@dataclass(frozen=True)
class Provenance:
    """The software behind a result.

    Attributes:
        sources: module, or package and data file (``package/name``) → sha256 of what counts of it.
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
def provenance(*roots: str, without: tuple[str, ...] = ()) -> Provenance:
    """The software that the result of functions of this installation depends on.

    Args:
        roots: ``module:function`` (or ``module``) of each function that makes the result.
        without: texts ``module:name`` that are certain not to be followed, such as the backends in a table of all of
            them that were not chosen. An import statement for the same module still counts.

    Raises:
        Avs3dError: if a root does not exist.
    """
    return _installed().provenance(roots, without=without)


@lru_cache(maxsize=1)
def _installed() -> Sources:
    return Sources()


class Sources:
    """The sources of our packages, read on demand and kept.

    Args:
        path: folders and zip files in which the packages lie; None: where Python imports them from.
    """

    def __init__(self, path: Sequence[str] | None = None) -> None:
        self._path = None if path is None else list(path)
        self._specs: dict[str, ModuleSpec | None] = {}
        self._modules: dict[str, Module] = {}
        self._data: dict[str, dict[str, str]] = {}

    def provenance(self, roots: Sequence[str], *, without: Iterable[str] = ()) -> Provenance:
        """See `provenance`."""
        names = [root.partition(":")[0] for root in roots]
        for root, name in zip(roots, names, strict=True):
            if self._spec(name) is None:
                raise Avs3dError(f"provenance of {root}: no module {name}; expected module:function of {PACKAGES}")
        unused = frozenset(without)
        sources: dict[str, str] = {}
        libraries: set[str] = set()
        waiting = list(names)
        with _no_collection():
            while waiting:
                name = waiting.pop()
                if name in sources:
                    continue
                module = self.module(name)
                sources[name] = module.digest
                sources |= self._data_of(module)
                waiting += self._edges(module, unused)
                libraries |= {found for target, _ in module.imports if (found := _library(target))}
        versions: dict[str, str] = {}
        for library in libraries:
            versions |= _versions(library)
        return Provenance(sources, dict(sorted(versions.items())), f"{sys.version_info[0]}.{sys.version_info[1]}")

    def module(self, name: str) -> Module:
        """The imports and names of a module of ours.

        Raises:
            Avs3dError: if its source cannot be read.
        """
        if name not in self._modules:
            self._modules[name] = self._read(name)
        return self._modules[name]

    def _read(self, name: str) -> Module:
        spec = self._spec(name)
        loader: Any = spec.loader if spec else None
        try:
            source = loader.get_data(loader.get_filename(name))
            return read_module(name, self._package_of(name), source)
        except (AttributeError, ImportError, OSError, SyntaxError, ValueError) as error:
            raise Avs3dError(
                f"{name}: its source cannot be read ({error}); reinstall avs3d-bench with sources"
            ) from None

    def _spec(self, name: str) -> ModuleSpec | None:
        """Where a module of ours lies; found without importing its package."""
        if name not in self._specs:
            parent = name.rpartition(".")[0]
            self._specs[name] = self._find(name, parent)
        return self._specs[name]

    def _find(self, name: str, parent: str) -> ModuleSpec | None:
        if not parent:
            if name not in PACKAGES:
                return None
            return importlib.util.find_spec(name) if self._path is None else PathFinder.find_spec(name, self._path)
        above = self._spec(parent)
        if above is None or above.submodule_search_locations is None:
            return None
        return PathFinder.find_spec(name, list(above.submodule_search_locations))

    def _edges(self, module: Module, unused: frozenset[str]) -> Iterator[str]:
        """The modules of ours that a module has Python import, packages on the way included."""
        for target, name in module.imports:
            yield from self._targets(target, name)
        for text in module.texts - unused:
            named = text.partition(":")[0]
            if _MODULE_TEXT.fullmatch(named) and self._spec(named):
                yield from self._chain(named)
        if module.calls_entry_points:
            for group, target in _entry_points():
                if group in module.texts:
                    yield from self._chain(target)
        yield from self._chain(module.name.rpartition(".")[0])

    def _targets(self, target: str, name: str | None, seen: frozenset[str] = frozenset()) -> Iterator[str]:
        if target.partition(".")[0] not in PACKAGES:
            return
        yield from self._chain(target)
        if name is not None and self._spec(f"{target}.{name}") is not None:
            target, name = f"{target}.{name}", None
            yield target
        on_demand = self._on_demand(target)
        if on_demand is None or target in seen:
            return
        # Of a package that is imported as a whole, any name may be used.
        for each in on_demand if name in (None, "*") else (name,):
            if each in on_demand:
                yield from self._targets(*on_demand[each], seen | {target})

    def _on_demand(self, name: str) -> Mapping[str, tuple[str, str | None]] | None:
        """Names that a package resolves on demand, from its TYPE_CHECKING block and its stub file."""
        spec = self._spec(name)
        if spec is None or spec.submodule_search_locations is None:
            return None
        declared = self.module(name).on_demand
        if declared is None:
            return None
        loader: Any = spec.loader
        try:
            stub = loader.get_data(loader.get_filename(name) + "i")
        except OSError:
            return declared
        return {**declared, **_names(_imports(ast.parse(stub).body, name))}

    def _package_of(self, name: str) -> str:
        """The package that a module lies in; a package lies in itself."""
        spec = self._spec(name)
        return name if spec and spec.submodule_search_locations is not None else name.rpartition(".")[0]

    def _chain(self, name: str) -> Iterator[str]:
        """A module and the packages that it lies in, as far as they exist; nothing for ``''``."""
        while name:
            if self._spec(name) is not None:
                yield name
            name = name.rpartition(".")[0]

    def _data_of(self, module: Module) -> dict[str, str]:
        """Data files that the module names: ``package/name`` → sha256."""
        package = self._package_of(module.name)
        if package not in self._data:
            self._data[package] = {}
            owner: Any = self._spec(package)
            reader = owner.loader.get_resource_reader(package) if owner else None
            if reader is not None:
                self._data[package] = dict(_data_files(reader.files(), package))
        named = {text.rpartition("/")[2] for text in module.texts}
        return {path: digest for path, digest in self._data[package].items() if named & set(path.split("/")[1:])}


def _data_files(folder: Any, path: str) -> Iterator[tuple[str, str]]:
    """Files of a package that are no code: ``package/folder/name`` and sha256."""
    for entry in sorted(folder.iterdir(), key=lambda entry: str(entry.name)):
        if entry.is_dir():
            # A folder with an __init__ is a package of its own.
            if entry.name != "__pycache__" and not entry.joinpath("__init__.py").is_file():
                yield from _data_files(entry, f"{path}/{entry.name}")
        elif not entry.name.endswith(_CODE_SUFFIXES):
            yield f"{path}/{entry.name}", hashlib.sha256(entry.read_bytes()).hexdigest()


def read_module(name: str, package: str, source: bytes) -> Module:
    """Read what a module imports and names.

    Args:
        name: dotted name.
        package: the package that its relative imports start from.
        source: its text.

    Raises:
        SyntaxError, ValueError: if it is no Python.
    """
    tree = ast.parse(source)
    reader = _TreeReader()
    reader.read(tree)
    imports = set(_imports(reader.imports, package))
    constants = _constants(tree)
    for argument in reader.imported_by_text:
        text = argument.value if isinstance(argument, ast.Constant) else constants.get(getattr(argument, "id", ""))
        if isinstance(text, str) and text.strip("."):
            imports.add((importlib.util.resolve_name(text, package), None))
    return Module(
        name=name,
        digest=hashlib.sha256("".join(reader.form).encode(errors="surrogatepass")).hexdigest(),
        imports=frozenset(imports),
        texts=frozenset(reader.texts),
        calls_entry_points=reader.calls_entry_points,
        on_demand=_names(_imports(reader.for_checkers, package)) if reader.resolves_names else None,
    )


class _TreeReader:
    """Goes through a syntax tree once.

    Attributes:
        form: pieces of the normal form: node types and values in order, without docstrings, positions and what is for
            type checkers only.
        imports: the import statements.
        imported_by_text: first arguments of `importlib.import_module` and ``__import__``.
        texts: text constants.
        for_checkers: statements under ``if TYPE_CHECKING``.
        calls_entry_points: whether it calls ``entry_points``.
        resolves_names: whether it defines or assigns ``__getattr__``.
    """

    def __init__(self) -> None:
        self.form: list[str] = []
        self.imports: list[ast.AST] = []
        self.imported_by_text: list[ast.expr] = []
        self.texts: set[str] = set()
        self.for_checkers: list[ast.stmt] = []
        self.calls_entry_points = False
        self.resolves_names = False

    def read(self, value: Any) -> None:
        """Take in a node, a list of nodes or a plain value."""
        kind = value.__class__
        if kind is list:
            self.form.append("[")
            for each in value:
                self.read(each)
            self.form.append("]")
            return
        fields = _FIELDS.get(kind)
        if fields is None:
            self.form.append(repr(value))
            return
        if kind in _NOTED:
            if kind is ast.If and _is_type_checking(value.test):
                self.for_checkers += value.body
                for each in value.orelse:
                    self.read(each)
                return
            self._note(value)
        self.form.append(kind.__name__)
        self.form.append("(")
        for field in fields:
            self.read(getattr(value, field, None))
        self.form.append(")")

    def _note(self, node: Any) -> None:
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str):
                self.texts.add(node.value)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            self.imports.append(node)
        elif isinstance(node, ast.Call):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            self.calls_entry_points |= called == "entry_points"
            if called in ("import_module", "__import__"):
                self.imported_by_text += node.args[:1]
        elif isinstance(node, ast.Name):
            self.resolves_names |= node.id == "__getattr__"
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            self.resolves_names |= getattr(node, "name", "") == "__getattr__"
            first = node.body[0] if node.body else None
            value = first.value if isinstance(first, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                del node.body[0]  # the docstring


#: Kind of node → its fields that count.
_FIELDS: dict[type, tuple[str, ...]] = {
    kind: tuple(field for field in kind._fields if field not in ("ctx", "type_comment", "kind", "type_ignores"))
    for kind in vars(ast).values()
    if isinstance(kind, type) and issubclass(kind, ast.AST)
}
#: Kinds of nodes that `_TreeReader` looks into.
_NOTED = frozenset(
    (ast.Constant, ast.Import, ast.ImportFrom, ast.Call, ast.Name, ast.If)
    + (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
)


def _is_type_checking(test: ast.expr) -> bool:
    return getattr(test, "attr", getattr(test, "id", "")) == "TYPE_CHECKING"


def _imports(nodes: Iterable[ast.AST], package: str) -> Iterator[tuple[str, str | None]]:
    """(module, name or None) of the import statements among ``nodes``, relative names resolved."""
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, None
        elif isinstance(node, ast.ImportFrom):
            target = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                target = ".".join([*above, *filter(None, [target])])
            for alias in node.names:
                yield target, alias.name


def _names(imports: Iterable[tuple[str, str | None]]) -> dict[str, tuple[str, str | None]]:
    return {name or module: (module, name) for module, name in imports}


def _constants(tree: ast.Module) -> dict[str, str]:
    """The module's own names for texts: ``_DECODER = "opengl_basisu"``."""
    found: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            found |= {target.id: node.value.value for target in node.targets if isinstance(target, ast.Name)}
    return found


def _library(module: str) -> str:
    """The top-level package of a library; empty for Python's own, ours, and what only resolves names."""
    top = module.partition(".")[0]
    ignored = top in PACKAGES or top in sys.stdlib_module_names or top in _NAME_RESOLVERS
    return "" if ignored else top


@lru_cache(maxsize=1)
def _distributions() -> Mapping[str, list[str]]:
    return metadata.packages_distributions()


@lru_cache(maxsize=256)
def _versions(package: str) -> Mapping[str, str]:
    """Distribution → version of those that an imported package comes from."""
    names = sorted(set(_distributions().get(package, ()))) or [package]  # some do not say what they install
    try:
        return {name: metadata.version(name) for name in names}
    except metadata.PackageNotFoundError:
        return {package: "none"}


@lru_cache(maxsize=1)
def _entry_points() -> tuple[tuple[str, str], ...]:
    """(group, module) of our distribution's entry points."""
    try:
        points = metadata.distribution(DISTRIBUTION).entry_points
    except metadata.PackageNotFoundError:
        return ()
    return tuple((point.group, point.module) for point in points)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Pause the garbage collector: parsing makes many objects and no rubbish, and takes a third of the time so."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
