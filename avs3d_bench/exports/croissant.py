"""A Croissant 1.1 description: JSON-LD that says which files make the dataset and how they become records.

Paths are relative to the dataset's root, so the file belongs there. Records:

| record set                              | from                   | one record per                                   |
|-----------------------------------------|------------------------|--------------------------------------------------|
| `observations`                          | dataset.json           | observation (of the release: listed in the file) |
| `frames` (not of the release)           | observation.json       | frame: pose, azimuth, distance, level, …         |
| `groups` (of part_3)                    | this description       | first of a group, whose pictures it shares       |
| `sources` (of part_3)                   | observation.json       | source of a part_3 observation                   |
| `rgb`, `masks`, `instance_masks`, `depth` | the folder of pictures | picture, with its observation and frame        |
| `category_masks` (of part_3)            | the same               | the same                                         |
| `binaural`, `mono`                      | the folder of clips    | clip, with its observation and frame             |

The chain of hashes: the description holds the sha256 of dataset.json, that one the sha256 of every observation.json,
and those the sha256 of every other file.

Format: https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html and its responsible-AI vocabulary.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AttributionRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.card import hub_licence
from avs3d_bench.exports.citation import ARXIV, AUTHORS, BIBTEX, PAPER
from avs3d_bench.exports.samples import ALL_KINDS, check_output, file_kinds, has_part_3, select
from avs3d_bench.exports.signatures import CROISSANT
from avs3d_bench.formats import media

Json = dict[str, Any]
_CR = "cr:"
_CONTEXT: Json = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
} | {
    name: _CR + name
    for name in (
        "arrayShape", "citeAs", "column", "equivalentProperty", "extract", "field", "fileObject", "fileProperty",
        "fileSet", "format", "includes", "isArray", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path",
        "recordSet", "references", "regex", "repeated", "replace", "samplingRate", "separator", "source", "subField",
        "transform",
    )
}  # fmt: skip
_TEXT, _INTEGER, _FLOAT, _BOOLEAN = "sc:Text", "sc:Integer", "sc:Float", "sc:Boolean"
_OBSERVATION = "part_*/*/*/*"
_WEB = re.compile(r"https?://\S+")

#: Facts of a frame in observation.json: name, type, shape (of arrays), what it is.
_FRAME_FIELDS: tuple[tuple[str, str, int | None, str], ...] = (
    ("name", _TEXT, None, "Name of the frame, e.g. frame_007"),
    ("time", _FLOAT, None, "Seconds from the start; the clip covers [time, time + 1)"),
    ("position", _FLOAT, 3, "Sensor in the world, metres, Y up"),
    ("rotation", _FLOAT, 4, "Camera-to-world unit quaternion (w, x, y, z); the camera looks down −Z"),
    ("visible_pixels", _INTEGER, None, "Pixels of the sounding instance in this frame"),
    ("azimuth", _FLOAT, None, "Of the source, degrees; 0 ahead, positive to the right"),
    ("elevation", _FLOAT, None, "Of the source, degrees; positive up"),
    ("distance", _FLOAT, None, "To the source, metres"),
    ("line_of_sight", _BOOLEAN, None, "Nothing stands between sensor and source"),
    ("rms_left", _FLOAT, None, "Root mean square of the left channel"),
    ("rms_right", _FLOAT, None, "Root mean square of the right channel"),
)
_ENTRY_FIELDS = {
    "key": "The observation's path below the root",
    "category": "Category of the sounding object",
    "part": "part_1: one instance of the category; part_2: several, one sounds",
    "scan": "The home",
    "room": "The room",
    "digest": "sha256 of the observation's observation.json",
}
#: The same of a dataset with part_3.
_SCENE_ENTRY_FIELDS = {
    "category": "Category of the sounding object; in part_3 that of the first source, null if there is none",
    "part": "part_1: one instance of the category; part_2: several, one sounds; part_3: several sources, or none",
}
_SETS = {"rgb": "rgb", "mask": "masks", "instances": "instance_masks", "categories": "category_masks",
         "depth": "depth", "binaural": "binaural", "mono": "mono", "stems": "stems",
         "rirs": "impulse_responses", "ambisonics": "ambisonics", "array": "array"}  # fmt: skip
#: Facts of a source of part_3 in observation.json: name, type, shape (of arrays), what it is.
_SOURCE_FIELDS: tuple[tuple[str, str, int | None, str], ...] = (
    ("id", _TEXT, None, "source_1, source_2, …"),
    ("category", _TEXT, None, "What it is"),
    ("room", _TEXT, None, "Where it is; another room than the observation's if it is off-screen"),
    ("position", _FLOAT, 3, "In the world, metres, Y up"),
    ("gain_db", _FLOAT, None, "Level re the common loudness of all sources, dB"),
    ("asset", _TEXT, None, "The recording or synthesis that it plays"),
)
_FORMATS = {"png": "image/png", "wav": "audio/wav", "npz": "application/octet-stream"}


def write_croissant(
    root: str | Path, output: str | Path, *, url: str | None = None, published: str | None = None
) -> None:
    """Write the description of the dataset at ``root``.

    Args:
        root: the dataset (ours or the official release).
        output: the file; its paths are relative to ``root``.
        url: the dataset's home page; the paper's where there is none.
        published: date of publication, YYYY-MM-DD.

    Raises:
        UsageError: if there is no dataset, ``output`` is not in its root, or ``url`` or ``published`` cannot be one.
        Avs3dError: if dataset.json is damaged or the system refuses.

    Examples:
        >>> import json
        >>> import shutil
        >>> from pathlib import Path
        >>> root = Path(shutil.copytree("data/demo", "published", dirs_exist_ok=True))
        >>> write_croissant(root, root / "croissant.json", url="https://example.org/demo", published="2026-01-31")
        >>> [record["name"] for record in json.loads((root / "croissant.json").read_text("utf-8"))["recordSet"]]
        ['observations', 'frames', 'rgb', 'masks', 'instance_masks', 'binaural', 'mono']
    """
    dataset, keys = select(root)
    check_output(dataset, output, CROISSANT)
    root, output = Path(root), Path(output)
    if output.resolve().parent != root.resolve():
        raise UsageError(
            f"{output}: readers look for the dataset's files beside the description; write it into the dataset's root: "
            f"{root / 'croissant.json'}"
        )
    text = json.dumps(description(dataset, keys, url=url, published=published), indent=1, ensure_ascii=False)
    media.write_bytes(output, f"{text}\n".encode())


def description(dataset: Dataset, keys: Sequence[str], *, url: str | None = None, published: str | None = None) -> Json:
    """The description as JSON types; see `write_croissant`."""
    if url is not None and not _WEB.fullmatch(url):
        raise UsageError(f"--url {url!r}: expected http://… or https://…")
    if published is not None and not _is_date(published):
        raise UsageError(f"--date {published!r}: expected YYYY-MM-DD")
    record = dataset.record
    kinds = sorted({name for key in keys for name in file_kinds(dataset[key], tuple(ALL_KINDS))}, key=list(_SETS).index)
    ours = any(dataset[key].record is not None for key in keys)
    files: list[Json] = []
    if record is not None:
        files.append(_file(dataset.root / layout.DATASET_JSON))
    if ours:
        pattern = f"{_OBSERVATION}/{layout.OBSERVATION_JSON}"
        files.append(_file_set("observation-files", pattern, "application/json", "Record of each observation"))
    files += [_pictures(name, dataset, keys) for name in kinds if name != "stems"]
    if ours:
        meshes = f"{_OBSERVATION}/{layout.SOUNDING_OBJECT}"
        files.append(_file_set("mesh-files", meshes, "application/octet-stream", "Mesh of the sounding instance, PLY"))
    colmap = f"{_OBSERVATION}/{layout.COLMAP}/*.bin"
    files.append(_file_set("colmap-files", colmap, "application/octet-stream", "COLMAP model from the true poses"))
    scenes = has_part_3(keys)
    if scenes:
        # A set of its own: readers expect all lists that they take from one set of files to be of one length.
        pattern = f"part_3/*/*/*/{layout.OBSERVATION_JSON}"
        files.append(_file_set("scene-files", pattern, "application/json", "Record of each part_3 observation"))
    if "stems" in kinds:
        pattern = f"part_3/*/*/*/{layout.STEMS}/*/frame_*.wav"
        files.append(_file_set("stems-files", pattern, _FORMATS["wav"], ALL_KINDS["stems"].what))
    sets = [_entries(scenes=scenes) if record is not None else _listed(keys)]
    sets += [_frames()] if ours else []
    sets += [_groups(dataset, keys), _sources()] if scenes else []
    sets += [_file_records(name) for name in kinds if name not in ("rirs", "stems")]
    created = [{"@type": "sc:Person", "name": name} for name in AUTHORS]
    makers = [{"@type": "sc:Organization", "name": (record.created_by if record else None) or "avs3d-bench developers"}]
    out: Json = {
        "@context": dict(sorted(_CONTEXT.items())),
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": dataset.name,
        "description": (
            "3D audio-visual segmentation: posed RGB pictures, one second of binaural sound per picture and a mask of "
            f"the object that sounds. {len(keys)} observations in the layout of 3DAVS-S34-O7 ({PAPER}, arXiv:{ARXIV})."
        ),
        "url": url or f"https://arxiv.org/abs/{ARXIV}",
        "version": _semantic(record.version) if record else "1.0.0",
        "license": _licences(record.licence) if record else "Not stated in the release: ask its publisher",
        "creator": makers if record else created,
        "citeAs": BIBTEX,
        "keywords": ["audio-visual segmentation", "3D", "binaural", "spatial audio", "multi-view", "synthetic"],
        "inLanguage": "en",
        "isLiveDataset": False,
    }
    if published is not None:
        out["datePublished"] = published
    if record is not None and record.attributions:
        out["isBasedOn"] = [_based_on(asset) for asset in record.attributions]
    return out | _responsible(dataset, scenes=scenes) | {"distribution": files, "recordSet": sets}


def _based_on(asset: AttributionRecord) -> Json:
    work: Json = {
        "@type": "sc:CreativeWork",
        "name": asset.asset,
        "license": _licences(asset.name)[0],
        "creator": {"@type": "sc:Organization", "name": asset.author},
        "description": asset.source,
    }
    return work | ({"url": asset.source} if _WEB.fullmatch(asset.source) else {})


def _licences(licence: str) -> list[str]:
    """The licence's page at SPDX, where the text starts with an SPDX identifier, and the text itself."""
    name = licence.split(" ")[0]
    return ([f"https://spdx.org/licenses/{name}.html"] if hub_licence(licence) != "other" else []) + [licence]


def _is_date(text: str) -> bool:
    try:
        return datetime.date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def _semantic(version: str) -> str:
    """MAJOR.MINOR.PATCH, as Croissant asks for; missing numbers are 0."""
    if not re.fullmatch(r"[0-9]+(\.[0-9]+){0,2}", version):
        return version
    return ".".join([*version.split("."), "0", "0"][:3])


def _file(path: Path) -> Json:
    return {
        "@type": "cr:FileObject",
        "@id": "dataset.json",
        "name": "dataset.json",
        "description": "Manifest, engines, licence, attributions, and the sha256 of every observation.json",
        "contentUrl": layout.DATASET_JSON,
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": "application/json",
        "sha256": media.sha256_file(path),
    }


def _file_set(name: str, pattern: str, encoding: str, what: str) -> Json:
    return {
        "@type": "cr:FileSet",
        "@id": name,
        "name": name,
        "description": what,
        "encodingFormat": encoding,
        "includes": pattern,
    }


def _pictures(name: str, dataset: Dataset, keys: Sequence[str]) -> Json:
    """The file set of a kind; a release may keep its pictures in `images/`."""
    kind = next(found[name] for key in keys if name in (found := file_kinds(dataset[key], (name,))))
    suffix = kind.member.rpartition(".")[2]
    pattern = f"{_OBSERVATION}/{kind.folder}/frame_*.{suffix}"
    return _file_set(f"{_SETS[name]}-files", pattern, _FORMATS[suffix], kind.what)


def _field(record_set: str, name: str, kind: str, what: str, source: Json) -> Json:
    return {
        "@type": "cr:Field",
        "@id": f"{record_set}/{name}",
        "name": name,
        "description": what,
        "dataType": kind,
        "source": source,
    }


def _record_set(name: str, what: str, key: Sequence[str], fields: Sequence[Json], **more: Any) -> Json:
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": what,
        "key": [{"@id": f"{name}/{field}"} for field in key],
        "field": list(fields),
        **more,
    }


def _entries(*, scenes: bool) -> Json:
    fields = [
        _field(
            "observations", name, _TEXT, what,
            {"fileObject": {"@id": "dataset.json"}, "extract": {"jsonPath": f"$.observations[*].{name}"}},
        )
        for name, what in (_ENTRY_FIELDS | (_SCENE_ENTRY_FIELDS if scenes else {})).items()
    ]  # fmt: skip
    return _record_set("observations", "One record per observation", ["key"], fields)


def _listed(keys: Sequence[str]) -> Json:
    rows, fields = [], []
    for name in ("key", "part", "scan", "room"):
        made = _field("observations", name, _TEXT, _ENTRY_FIELDS[name], {})
        del made["source"]
        fields.append(made)
    for key in keys:
        place = layout.parse_key(key)
        rows.append({f"observations/{n}": v for n, v in
                     (("key", key), ("part", place.part), ("scan", place.scan), ("room", place.room))})  # fmt: skip
    return _record_set("observations", "One record per observation", ["key"], fields, data=rows)


def _part_of_path(files: str, regex: str) -> Json:
    return {"fileSet": {"@id": files}, "extract": {"fileProperty": "fullpath"}, "transform": {"regex": regex}}


def _frames() -> Json:
    key = _part_of_path("observation-files", r"^(.*)/observation\.json$")
    fields = [_field("frames", "observation", _TEXT, "Key of the observation", key)]
    for name, kind, length, what in _FRAME_FIELDS:
        source = {"fileSet": {"@id": "observation-files"}, "extract": {"jsonPath": f"$.frames[*].{name}"}}
        field = _field("frames", name, kind, what, source)
        if length is not None:
            field |= {"isArray": True, "arrayShape": str(length)}
        fields.append(field)
    return _record_set("frames", "One record per frame: pose, source, level", ["observation", "name"], fields)


def _groups(dataset: Dataset, keys: Sequence[str]) -> Json:
    """Which observations of part_3 have the same pictures; stands in the description itself."""
    what = {"observation": "Key of the observation", "group": "Key of the observation whose pictures it shares"}
    fields = []
    for name, text in what.items():
        field = _field("groups", name, _TEXT, text, {})
        del field["source"]
        fields.append(field)
    rows = [
        {"groups/observation": key, "groups/group": group} for key in keys if (group := dataset[key].group) is not None
    ]
    text = "One record per part_3 observation: those of a group differ in sound alone"
    return _record_set("groups", text, ["observation"], fields, data=rows)


def _sources() -> Json:
    """The sources of part_3; when each sounds, and what is audible in a frame, are lists inside observation.json."""
    key = _part_of_path("scene-files", r"^(.*)/observation\.json$")
    fields = [_field("sources", "observation", _TEXT, "Key of the observation", key)]
    for name, kind, length, what in _SOURCE_FIELDS:
        source = {"fileSet": {"@id": "scene-files"}, "extract": {"jsonPath": f"$.sources[*].{name}"}}
        field = _field("sources", name, kind, what, source)
        fields.append(field | ({} if length is None else {"isArray": True, "arrayShape": str(length)}))
    what = "One record per source of the part_3 observations"
    return _record_set("sources", what, ["observation", "id"], fields)


def _file_records(name: str) -> Json:
    kind, label = ALL_KINDS[name], _SETS[name]
    files, picture = f"{label}-files", kind.member.endswith(".png")
    fields = [
        _field(label, "observation", _TEXT, "Key of the observation",
               _part_of_path(files, r"^(.*)/[^/]+/frame_[0-9]+\.[a-z]+$")),
        _field(label, "frame", _TEXT, "Name of the frame" + ("" if picture else " (number without padding)"),
               _part_of_path(files, r"^.*/(frame_[0-9]+)\.[a-z]+$")),
        _field(label, "content", "sc:ImageObject" if picture else "sc:AudioObject", kind.what,
               {"fileSet": {"@id": files}, "extract": {"fileProperty": "content"}}
               | ({} if picture else {"samplingRate": layout.SAMPLE_RATE})),
    ]  # fmt: skip
    return _record_set(label, f"One record per file: {kind.what}", ["observation", "frame"], fields)


def _responsible(dataset: Dataset, *, scenes: bool) -> Json:
    record = dataset.record
    engines = ", ".join(f"{name} {version}" for name, version in sorted(record.backends.items())) if record else ""
    made = (
        f"Simulated with {engines} by avs3d-bench {record.toolkit_version}" if record else "Simulated (SoundSpaces 2.0)"
    )
    return {
        "rai:dataCollection": f"{made}: homes, objects and an agent's path are rendered, sound is computed along it.",
        "rai:dataCollectionType": "Simulation",
        "rai:dataAnnotationProtocol": "Masks, instance ids and poses come from the scene: they are exact.",
        "rai:dataUseCases": ["Training and evaluation of 3D audio-visual segmentation", "Sound source localisation"],
        "rai:dataLimitations": [
            f"Synthetic: no sensor noise, no motion blur{'' if scenes else ', no second sound'}; "
            "results need not hold on recordings.",
            f"One object sounds in every frame{' of part_1 and part_2' if scenes else ''}, in view or not; "
            "paths are chosen so that it comes into view.",
            "The sound is that of one head.",
        ],
        "rai:dataBiases": "Seven household categories in three kinds of rooms; not a sample of the homes of the world.",
        "rai:personalSensitiveInformation": "None: no person was recorded or shown.",
        "rai:dataReleaseMaintenancePlan": f"Regenerated from its manifest; checked by `avs3d validate` {__version__}.",
    }
