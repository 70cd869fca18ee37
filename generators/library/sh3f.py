"""Sweet Home 3D furniture libraries (``*.sh3f``): a ZIP of models with a Java properties file that describes them.

`read_library` lists the pieces with author, licence, size and orientation; `deliver` extracts one model with all files
it refers to, as a plain ZIP whose bytes depend only on those files: the sha256 in the lock file is that of this ZIP.
Format: http://www.sweethome3d.com/importModels.jsp and the Furniture Library Editor's documentation. After
``modelRotation``, a piece's front faces +Z and its top +Y.
"""

from __future__ import annotations

import io
import posixpath
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from avs3d_bench.errors import Avs3dError, did_you_mean
from avs3d_bench.formats import files
from generators.library.archive import LIBRARY_LIMITS, ZipLimits, bundle, opened, read_member, vetted
from generators.library.licences import spdx

#: Folder in which Debian's package sweethome3d-furniture installs its libraries.
DEBIAN_FOLDER = Path("/usr/share/sweethome3d/furniture")
CATALOGUE = "PluginFurnitureCatalog.properties"
#: Accepted formats of a model; `generators.library.mesh_cleaning` reads the same.
SUFFIXES = (".obj", ".glb", ".gltf", ".ply", ".stl", ".dae")
#: Limits of one model: number of its files, and their total size (bytes).
MAX_FILES, MAX_TOTAL = 200, 512 << 20
_MAPS = re.compile(r"^\s*(?:map_\w+|bump|disp|decal|refl|norm)\s+(.+?)\s*$", re.IGNORECASE | re.MULTILINE)
_MTLLIB = re.compile(r"^\s*mtllib\s+(.+?)\s*$", re.IGNORECASE | re.MULTILINE)
_NOTICE = re.compile(r"licen[cs]e|copying", re.IGNORECASE)
_PAGE = re.compile(r"https?://(?:www\.)?blendswap\.com/blends?/\w*/?\d+")
_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

Axes = tuple[str, str, float]


@dataclass(frozen=True)
class Piece:
    """One model of a library.

    Attributes:
        number: its number in the properties file.
        id: its id in the library, e.g. ``Scopia#phone``.
        name, category, tags: in English, as given by the library.
        author: its author.
        licence: SPDX identifier if there is one.
        model: name of its file in the library.
        size: width, height and depth, metres.
        elevation: usual height above the floor, metres.
        rotation: row-major 3 × 3 matrix from the model's axes to Y up, front +Z.
        url: page of the original, if the notice beside the model names one.
    """

    number: int
    id: str
    name: str
    category: str
    tags: str
    author: str
    licence: str
    model: str
    size: tuple[float, float, float]
    elevation: float = 0.0
    rotation: tuple[float, ...] = _IDENTITY
    url: str = ""

    @property
    def axes(self) -> Axes:
        """The model's axes that point up and to the front, and the degrees of yaw that remain.

        Raises:
            Avs3dError: if the rotation tilts it: no axis of the model points up.
        """
        matrix = np.array(self.rotation).reshape(3, 3)
        up, tilt = _axis(matrix[1])
        front, _ = _axis(matrix[2])
        if up.lstrip("+-") == front.lstrip("+-"):
            raise Avs3dError(f"{self.id}: modelRotation {self.rotation} is not a rotation; correct the library")
        if tilt > np.radians(0.5):
            raise Avs3dError(
                f"{self.id}: modelRotation tilts it by {np.degrees(tilt):.1f}°; rotate the mesh itself instead"
            )
        y, z = _vector(up), _vector(front)
        turn = matrix @ np.stack([np.cross(y, z), y, z]).T
        yaw = float(np.degrees(np.arctan2(turn[0, 2], turn[2, 2])))
        return up.lstrip("+"), front, round(yaw, 3) + 0.0


@dataclass(frozen=True)
class Library:
    """The catalogue of an .sh3f file."""

    path: Path
    id: str
    name: str
    licence: str
    pieces: tuple[Piece, ...]

    def find(self, name: str) -> Piece:
        """The piece whose id is ``name``, with or without the part before ``#``.

        Raises:
            Avs3dError: if there is none, or more than one.
        """
        found = [piece for piece in self.pieces if name in (piece.id, piece.id.partition("#")[2])]
        if len(found) != 1:
            many = f"{len(found)} models" if found else "no model"
            hint = "" if found else did_you_mean(name, [piece.id.partition("#")[2] for piece in self.pieces])
            raise Avs3dError(f"{self.path}: has {many} {name!r} among its {len(self.pieces)}{hint}")
        return found[0]


def libraries(folder: Path = DEBIAN_FOLDER) -> tuple[Path, ...]:
    """The .sh3f files in a folder, sorted by name."""
    return tuple(sorted(path for path in folder.glob("*.sh3f") if path.is_file()))


def read_library(path: Path) -> Library:
    """Read the catalogue of an .sh3f file; no model is unpacked.

    Raises:
        Avs3dError: one line: no such file, not a ZIP, no catalogue, a field that is missing or not a number.
    """
    with _opened(path, str(path), LIBRARY_LIMITS) as archive:
        reader = _ArchiveReader(str(path), archive, LIBRARY_LIMITS)
        if CATALOGUE.lower() not in reader.members:
            raise Avs3dError(f"{path}: has no {CATALOGUE}; expected a Sweet Home 3D furniture library")
        table = parse_properties(reader.read(CATALOGUE))
        notice = reader.text("LICENSE.TXT")
        pages = {folder: reader.page(folder) for folder in _folders(table)}
    numbers = sorted(int(key[3:]) for key in table if re.fullmatch(r"id#\d{1,6}", key))
    # The catalogue's licence names are imprecise ("Public domain" for CC0); the address in LICENSE.TXT is precise.
    address = re.search(r"creativecommons\.org/\S+", notice)
    licence = _licence(address[0] if address else table.get("license", ""))
    holders = _holders(notice)
    pieces = tuple(_credited(_piece(path, table, number, licence), holders, pages) for number in numbers)
    return Library(path, table.get("id", path.stem), table.get("name", path.stem), licence, pieces)


def deliver(path: Path, piece: Piece) -> bytes:
    """The model of ``piece`` with its materials, textures and licence notes as one bundle (a ZIP of stored files).

    Its bytes depend only on the names and contents of those files, not on how the library packs them.

    Raises:
        Avs3dError: if the model is missing from the library, unreadable, too large, or not in an accepted format.
    """
    return bundle(extract(path, piece))


def extract(path: Path, piece: Piece) -> dict[str, bytes]:
    """File names, relative to the model's folder, and contents of a model and of all files it refers to.

    References to missing files are left out; `generators.library.mesh_cleaning` reports them.

    Raises:
        Avs3dError: see `deliver`.
    """
    with _opened(path, str(path), LIBRARY_LIMITS) as archive:
        reader = _ArchiveReader(str(path), archive, LIBRARY_LIMITS)
        suffix = posixpath.splitext(piece.model)[1].lower()
        if suffix == ".zip":
            what = f"{path}: {piece.model}"
            with _opened(io.BytesIO(reader.read(piece.model)), what, ZipLimits()) as nested:
                reader = _ArchiveReader(what, nested, ZipLimits())
                models = sorted(n for n in reader.names.values() if posixpath.splitext(n)[1].lower() in SUFFIXES)
                if len(models) != 1:
                    raise Avs3dError(f"{what}: holds {len(models)} models; expected one of {_KINDS}")
                return reader.collect(models[0])
        if suffix not in SUFFIXES:
            raise Avs3dError(f"{path}: {piece.id} is a {suffix or 'nameless'} file; expected one of {_KINDS}")
        return reader.collect(piece.model)


_KINDS = ", ".join(SUFFIXES)


class _ArchiveReader:
    """Members of a vetted archive by name, with limits; case is ignored in names, as on Windows."""

    def __init__(self, what: str, archive: zipfile.ZipFile, limits: ZipLimits) -> None:
        self.what, self.archive = what, archive
        self.members = {m.filename.replace("\\", "/").lower(): m for m in vetted(archive, what, limits)}
        self.names = {key: member.filename for key, member in self.members.items()}
        self.total = 0

    def read(self, name: str) -> bytes:
        member = self.members.get(name.lower())
        if member is None:
            raise Avs3dError(f"{self.what}: its catalogue names {name!r}, which is missing; fetch the library again")
        self.total += member.file_size
        if self.total > MAX_TOTAL:
            raise Avs3dError(f"{self.what}: {name}: the model holds more than {MAX_TOTAL >> 20} MiB; refused")
        return read_member(self.archive, member, self.what)

    def text(self, name: str) -> str:
        """A member as text; empty if there is none."""
        return self.read(name).decode("utf-8", "replace") if name.lower() in self.members else ""

    def page(self, folder: str) -> str:
        """The address of the original, from the licence notices in a model's folder."""
        for name in self._beside(folder, everything=False):
            if name.count("/") == 0 and (found := _PAGE.search(self.text(f"{folder}/{name}"))):
                return found[0].rstrip(".,;)")
        return ""

    def collect(self, model: str) -> dict[str, bytes]:
        """The model and all files it refers to, by their names relative to the model's folder."""
        folder, base = posixpath.split(model)
        table = {base: self.read(model)}
        wanted = list(self._beside(folder, everything=base.lower().endswith((".dae", ".gltf"))))
        if base.lower().endswith(".obj"):
            wanted += self._materials(folder, table[base])
        for name in wanted:
            inside = _inside(folder, name)
            if inside is None or inside.lower() not in self.members:
                continue
            relative = posixpath.relpath(inside, folder or ".")
            if relative.lower() not in {known.lower() for known in table}:
                table[relative] = self.read(inside)
            if len(table) > MAX_FILES:
                raise Avs3dError(f"{self.what}: {model} refers to more than {MAX_FILES} files; refused")
        return table

    def _materials(self, folder: str, obj: bytes) -> Iterator[str]:
        """Material libraries of an OBJ and the textures that they name."""
        for library in _MTLLIB.findall(obj.decode("utf-8", "replace")):
            yield library
            inside = _inside(folder, library)
            if inside is not None and inside.lower() in self.members:
                for value in _MAPS.findall(self.read(inside).decode("latin-1")):
                    yield value.split()[-1] if value.startswith("-") else value

    def _beside(self, folder: str, *, everything: bool) -> Iterator[str]:
        """Files in the model's folder and below: only those with its licence, or all."""
        start = f"{folder}/" if folder else ""
        for name in sorted(self.names.values()):
            if name.startswith(start) and (everything or _NOTICE.search(posixpath.basename(name))):
                yield name[len(start) :]


def _inside(folder: str, relative: str) -> str | None:
    """A reference from a file in ``folder`` as the name of a member; empty if it points out of that folder."""
    name = posixpath.normpath(relative.replace("\\", "/"))
    if name.startswith(("/", "../")) or name in ("..", ".") or re.match(r"[A-Za-z]:", name):
        return None
    return f"{folder}/{name}" if folder else name


def _opened(file: Path | io.BytesIO, what: str, limits: ZipLimits) -> zipfile.ZipFile:
    try:
        return opened(file, what, limits)
    except OSError as error:
        raise Avs3dError(files.os_error_line(error, what, "read")) from error
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise Avs3dError(f"{what}: is not a complete ZIP ({error}); fetch the .sh3f file again") from error


# ---- the catalogue -------------------------------------------------------------------------------------------------


def parse_properties(data: bytes) -> dict[str, str]:
    r"""Parse a Java properties file: ISO-8859-1 with escapes such as ``\u00e9`` (java.util.Properties.load)."""
    table: dict[str, str] = {}
    pending = ""
    for raw in re.split(r"\r\n|\r|\n", data.decode("latin-1")):
        line = pending + raw.lstrip(" \t\f")
        if not pending and line[:1] in ("", "#", "!"):
            continue
        ending = len(line) - len(line.rstrip("\\"))
        if ending % 2:
            pending = line[:-1]
            continue
        pending = ""
        found = re.match(r"((?:\\.|[^\\=: \t\f])*)[ \t\f]*[=:]?[ \t\f]*(.*)", line, re.DOTALL)
        if found:
            table[_unescape(found[1])] = _unescape(found[2])
    return table


def _unescape(text: str) -> str:
    plain = {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}

    def one(match: re.Match[str]) -> str:
        return chr(int(match[1], 16)) if match[1] else plain.get(match[2], match[2])

    joined = re.sub(r"\\(?:u([0-9a-fA-F]{4})|(.))", one, text, flags=re.DOTALL)
    return joined.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def _piece(path: Path, table: dict[str, str], number: int, licence: str) -> Piece:
    def text(key: str, default: str | None = None) -> str:
        value = " ".join(table.get(f"{key}#{number}", default or "").split())
        if not value and default is None:
            raise Avs3dError(f"{path}: model {number} of its catalogue has no {key}; correct the library")
        return value

    def value(key: str, default: str | None = None) -> float:
        written = text(key, default)
        try:
            result = float(written)
        except ValueError:
            result = float("nan")
        if not np.isfinite(result):
            raise Avs3dError(f"{path}: {key}#{number} is {written!r}; expected a number of centimetres")
        return result / 100

    words = text("modelRotation", "1 0 0 0 1 0 0 0 1").split()
    try:
        rotation = tuple(float(word) for word in words)
    except ValueError:
        rotation = ()
    matrix = np.array(rotation)
    if len(rotation) != 9 or not np.allclose(matrix.reshape(3, 3) @ matrix.reshape(3, 3).T, np.eye(3), atol=0.01):
        raise Avs3dError(f"{path}: modelRotation#{number} is {' '.join(words)!r}; expected nine numbers, a rotation")
    return Piece(
        number=number,
        id=text("id"),
        name=text("name"),
        category=text("category", " "),
        tags=text("tags", " "),
        author=text("creator", table.get("provider") or "unknown"),
        licence=_licence(text("license", " ")) or licence,
        model=text("model").lstrip("/"),
        size=(value("width"), value("height"), value("depth")),
        elevation=value("elevation", "0"),
        rotation=rotation,
    )


def _folders(table: dict[str, str]) -> tuple[str, ...]:
    """Folders of the models in a catalogue."""
    models = (value for key, value in table.items() if key.startswith("model#"))
    return tuple(sorted({posixpath.dirname(value.lstrip("/")) for value in models}))


def _credited(piece: Piece, holders: dict[str, str], pages: dict[str, str]) -> Piece:
    """The piece with the authors that its licence notice requires, and the page of its original."""
    folder = posixpath.dirname(piece.model)
    names = (posixpath.basename(folder), posixpath.splitext(posixpath.basename(piece.model))[0], "")
    author = next((holders[name] for name in names if name in holders), piece.author)
    return replace(piece, author=author, url=pages.get(folder, ""))


def _holders(notice: str) -> dict[str, str]:
    """Copyright holders by model, from a library's LICENSE.TXT; the key ``""`` is for all models not listed.

    "(C) Copyrights YEARS NAMES for the … following models: - name - name" and "(C) Copyrights NAMES for all the other
    models", or a single "(C) Copyright NAMES" for the whole.
    """
    table: dict[str, str] = {}
    for found in re.finditer(r"\(C\) Copyrights?:?[ \t]+(.+)((?:(?!\(C\) Copyright)[\s\S])*)", notice, re.IGNORECASE):
        names = re.sub(r"<[^>]*>|\(https?:[^)]*\)|^\d{4}(\s*-\s*\d{4})?", "", found[1])
        names = " ".join(names.split()).strip(" ,").replace(" ,", ",")
        models = re.findall(r"^-\s+(\S+)\s*$", found[2], re.MULTILINE) if "following models" in found[2] else [""]
        table.update(dict.fromkeys(models, names))
    return table


def _licence(text: str) -> str:
    """SPDX name for a licence's address, or for a catalogue's ``license``, which copyright holders may follow."""
    plain = re.split(r"\s{2,}|©|\(c\)|copyright", text, maxsplit=1, flags=re.IGNORECASE)[0].strip()
    if "creativecommons.org/choose/zero" in plain:
        return "CC0-1.0"
    name = spdx(plain) if plain else ""
    return f"{name}-US" if name == "CC-BY-3.0" and re.search(r"United States|/us\b", plain) else name


def _axis(row: np.ndarray) -> tuple[str, float]:
    """The model's axis nearest to a direction in its own coordinates, and the angle between them."""
    index = int(np.argmax(np.abs(row)))
    sign = "+" if row[index] > 0 else "-"
    return f"{sign}{'xyz'[index]}", float(np.arccos(np.clip(abs(row[index]) / np.linalg.norm(row), -1, 1)))


def _vector(axis: str) -> np.ndarray:
    vector = np.zeros(3)
    vector["xyz".index(axis[1])] = -1.0 if axis[0] == "-" else 1.0
    return vector
