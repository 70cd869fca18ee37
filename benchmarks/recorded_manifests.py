"""Write the manifests that have recordings in place of synthesised sounds, each from the manifest of its name.

``python -m benchmarks.recorded_manifests`` writes ``NAME-recorded.yaml`` beside each of `SOURCES`: the same lines, but
for the name, the version, the notes on sounds, and with ``sounds`` and ``voices``. A category sounds by the recordings
in the lock file that are for tests; one that has none there, by its voices for tests.

``python -m benchmarks.recorded_manifests --train DIR`` writes ``DIR/train-recorded.yaml``, the training manifest with
the recordings for training that are in the store (`avs3d assets fetch` brings them); categories of which it has none
keep their voices. The lock file is copied beside it.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import click
import yaml

from avs3d_bench.contract.taxonomy import CATEGORIES
from generators.assets.sounds import voices
from generators.core.limits import SoundSplit
from generators.library.lock import LOCK_NAME, AssetEntry, read_lock
from generators.library.store import Store

#: The training manifest has thousands of lines.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
MANIFESTS = Path(__file__).parents[1] / "scenes_manifest"
#: Manifests that have a recorded counterpart.
SOURCES = ("open-s34-o7", "listen")
#: Version of the recorded counterparts.
VERSION = "4.0.0"
_HEADER = """\
# The observations of {name}.yaml with recordings instead of synthesised sounds, where the lock file has some
# for {what}; the other categories have their voices for {what}. Written by `python -m benchmarks.recorded_manifests`.
"""
_FETCH = """\
# Before the first run:
#   avs3d assets fetch --manifest scenes_manifest/{name}-recorded.yaml
"""


_WORDS: dict[SoundSplit, str] = {"train": "training", "validation": "validation", "test": "tests"}


def recorded(text: str, assets: Iterable[AssetEntry], split: SoundSplit = "test", version: str = VERSION) -> str:
    """The recorded counterpart of a manifest.

    Args:
        text: the manifest.
        assets: whose recordings of the split are taken.
        split: of the recordings and voices.
        version: of the counterpart.

    Raises:
        KeyError: if the manifest has no name or no observations.
    """
    document = yaml.load(text, Loader=_LOADER)
    heard = _heard(document)
    sounds: dict[str, list[dict[str, str]]] = {}
    for entry in assets:
        if entry.kind == "sound" and entry.split == split and entry.category in heard:
            sounds.setdefault(entry.category, []).append({"asset": entry.id})
    played = {name: [voice.name for voice in voices(name) if voice.split == split] for name in CATEGORIES}
    spoken = (played | document.get("voices", {})).items()
    left = {name: names for name, names in spoken if name in heard and name not in sounds}
    name = document["name"]
    body = re.sub(r"(?m)^(voices|sounds):.*\n(?:[ \t]+.*\n)*", "", re.sub(r"\A(#.*\n)+", "", text))
    body = re.sub(r"(?m)^name:.*$", f"name: {name}-recorded", body)
    body = re.sub(r"(?m)^version:.*$", f"version: {version}", body)
    body = body.replace("synthesised sounds", "recorded and synthesised sounds")
    head, observations = re.split(r"(?m)^(?=observations:)", body)
    lines = ["sounds:"] if sounds else []
    for category in sorted(sounds):
        lines += [f"  {category}:", *(f"    - {{asset: {item['asset']}}}" for item in sounds[category])]
    if left:
        lines += ["voices:", *(f"  {category}: [{', '.join(left[category])}]" for category in sorted(left))]
    header = _HEADER.format(name=name, what=_WORDS[split]) + (_FETCH.format(name=name) if split == "test" else "")
    return header + head + "\n".join(lines) + "\n" + observations


def _heard(document: dict[str, object]) -> set[str]:
    """Every category that sounds in some observation."""
    found: set[str] = set()
    observations = document["observations"]
    assert isinstance(observations, list)
    for entry in observations:
        sources = entry.get("sources")
        found |= {entry["category"]} if "category" in entry else set()
        found |= {source["category"] for source in sources or ()}
    return found


def write_training(folder: Path) -> Path:
    """Write the training manifest with the recordings of the store into a folder, and the lock file beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    lock = read_lock(MANIFESTS / LOCK_NAME)
    text = (MANIFESTS / "train.yaml").read_text(encoding="utf-8")
    (version,) = re.findall(r"(?m)^version: (.*)$", text)
    made = recorded(text, Store.default().recordings(lock, "train"), "train", version)
    shutil.copyfile(MANIFESTS / LOCK_NAME, folder / LOCK_NAME)
    target = folder / "train-recorded.yaml"
    target.write_text(made, encoding="utf-8")
    return target


@click.command()
@click.option(
    "--train", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="That of train.yaml, into DIR."
)
def main(train: Path | None) -> None:
    """Write the recorded counterparts of the tests, or that of train.yaml."""
    if train is not None:
        target = write_training(train)
        click.echo(f"{target}: {target.read_text(encoding='utf-8').count('{asset: ')} recordings")
        return
    assets = read_lock(MANIFESTS / LOCK_NAME).assets
    for name in SOURCES:
        target = MANIFESTS / f"{name}-recorded.yaml"
        target.write_text(recorded((MANIFESTS / f"{name}.yaml").read_text(encoding="utf-8"), assets), encoding="utf-8")
        click.echo(f"scenes_manifest/{target.name}")


if __name__ == "__main__":
    main()
