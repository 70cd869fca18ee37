"""A dataset card: contents, origin, licence, known limits, and how to load it.

The front matter is the one of Hugging Face's cards, with the files of each configuration where the card stands in an
export. All numbers come from the observations' records; nothing is decoded.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from avs3d_bench.contract.schema import DatasetRecord, ObservationRecord
from avs3d_bench.contract.taxonomy import CATEGORIES, PARTS, ROOMS
from avs3d_bench.dataset import Dataset
from avs3d_bench.exports.citation import ARXIV, BIBTEX, PAPER
from avs3d_bench.exports.samples import ALL_KINDS, check_output, file_kinds, select
from avs3d_bench.exports.signatures import CARD
from avs3d_bench.formats import media

#: Licence names as the Hub knows them.
_HUB_LICENCES = {
    "Apache-2.0": "apache-2.0",
    "MIT": "mit",
    "CC0-1.0": "cc0-1.0",
    "CC-BY-4.0": "cc-by-4.0",
    "CC-BY-SA-4.0": "cc-by-sa-4.0",
    "CC-BY-NC-4.0": "cc-by-nc-4.0",
    "CC-BY-NC-SA-4.0": "cc-by-nc-sa-4.0",
}
_ONE_LICENCE = re.compile(r"(\S+)( \([^()]*\))?")
#: The Hub's classes of size: most frames, name.
_SIZES = (
    (10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"), (10**7, "1M<n<10M"),
    (10**8, "10M<n<100M"), (10**9, "100M<n<1B"),
)  # fmt: skip


@dataclass(frozen=True)
class Part3Facts:
    """Facts that only a part_3 observation has.

    Attributes:
        group: key of the observation whose pictures it shares.
        categories: of its sources, off-screen ones too.
        off_screen: number of sources in other rooms.
        programmes: number of sources that do not sound all the time.
        background: its kind and SNR (dB); None if there is none.
        audible: number of audible sources of each frame.
        snr: SNRs of the audible entries of all frames (dB), those alone in their clip left out.
    """

    group: str
    categories: tuple[str, ...]
    off_screen: int
    programmes: int
    background: tuple[str, float] | None
    audible: tuple[int, ...]
    snr: tuple[float, ...]

    @classmethod
    def of(cls, record: ObservationRecord) -> Part3Facts | None:
        """The facts of a record; None in the other parts."""
        if record.sources is None or record.group is None:
            return None
        heard = [frame.audible or () for frame in record.frames]
        return cls(
            group=record.group,
            categories=tuple(source.category for source in record.sources),
            off_screen=sum(source.instance is None for source in record.sources),
            programmes=sum(len(s.programme) != 1 or s.programme[0][0] >= 0 for s in record.sources),
            background=(record.background.kind, record.background.snr_db) if record.background else None,
            audible=tuple(len(entries) for entries in heard),
            snr=tuple(entry.snr_db for entries in heard for entry in entries if entry.snr_db is not None),
        )


@dataclass(frozen=True)
class ObservationFacts:
    """The facts of an observation on the card; None for those that the official release lacks."""

    key: str
    part: str
    scan: str
    room: str
    category: str | None
    frames: int
    train: int
    test: int
    visible: int | None
    width: int
    height: int
    t30: float | None
    distances: tuple[float, float] | None
    moves: bool
    variant_of: str | None
    silent: tuple[str, ...]
    acoustics: str | None
    vision: str | None
    scene: Part3Facts | None = None


@dataclass(frozen=True)
class CardFacts:
    """The facts of the dataset on the card; ``sizes``: kind → (files, bytes)."""

    name: str
    record: DatasetRecord | None
    observations: tuple[ObservationFacts, ...]
    sizes: dict[str, tuple[int, int]]


def gather(dataset: Dataset, keys: Sequence[str]) -> CardFacts:
    """Read the records of the observations and the sizes of their files.

    Raises:
        Avs3dError: if a record does not fit the schema.
    """
    observations = []
    sizes: dict[str, tuple[int, int]] = {}
    for key in keys:
        observation = dataset[key]
        place, record, camera = observation.place, observation.record, observation.intrinsics
        frames = record.frames if record else ()
        distances = [frame.distance for frame in frames if frame.distance is not None]
        observations.append(
            ObservationFacts(
                key=key, part=place.part, scan=place.scan, room=place.room, category=observation.category,
                frames=len(observation.frames), train=len(observation.train), test=len(observation.test),
                visible=sum(f.visible_pixels > 0 for f in frames) if record else None,
                width=camera.width, height=camera.height, t30=record.acoustics.t30 if record else None,
                distances=(min(distances), max(distances)) if distances else None,
                moves=bool(record and record.moves), variant_of=record.variant_of if record else None,
                silent=tuple(sorted(i.category for i in record.instances if not i.sounding)) if record else (),
                acoustics=f"{record.acoustics.backend} {record.acoustics.version}" if record else None,
                vision=f"{record.vision.backend} {record.vision.version}" if record else None,
                scene=Part3Facts.of(record) if record else None,
            )
        )  # fmt: skip
        for name, kind in file_kinds(observation, tuple(ALL_KINDS)).items():
            found = [kind.files(observation.path, frame.name, frame.index) for frame in observation.frames]
            known = [path.stat().st_size for paths in found for path in paths.values() if path.is_file()]
            files, size = sizes.get(name, (0, 0))
            sizes[name] = (files + len(known), size + sum(known))
    return CardFacts(dataset.name, dataset.record, tuple(observations), sizes)


def write_card(root: str | Path, output: str | Path) -> None:
    """Write the card of the dataset at ``root``.

    Raises:
        UsageError: if there is no dataset, or ``output`` is another file.
        Avs3dError: if a record does not fit the schema, or the system refuses.

    Examples:
        >>> from pathlib import Path
        >>> write_card("data/demo", "card.md")
        >>> [line for line in Path("card.md").read_text("utf-8").splitlines() if line.startswith("#")][:3]
        ['# demo 1', '## Contents', '## Rooms and sound']
    """
    dataset, keys = select(root)
    check_output(dataset, output, CARD)
    media.write_bytes(output, card_text(gather(dataset, keys)).encode())


def card_text(facts: CardFacts, *, configs: Mapping[str, Mapping[str, str]] | None = None) -> str:
    """The card in Markdown.

    Args:
        facts: of `gather`.
        configs: configuration → split → files, for a card that stands in an export; the first is the default.
    """
    sections = [
        _front_matter(facts, configs),
        _opening(facts),
        _contents(facts),
        _part_3(facts),
        _rooms_and_sound(facts),
        _files(facts),
        _loading(facts, configs),
        _limits(facts),
        _licences(facts),
        f"## Citation\n\n```bibtex\n{BIBTEX}\n```\n",
    ]
    return "\n".join(section.rstrip() + "\n" for section in sections if section)


def hub_licence(licence: str | None) -> str:
    """The Hub's identifier of a licence; ``other`` where it has none, and where several sets of terms hold.

    Args:
        licence: an SPDX name, a remark in parentheses behind it or not; several are joined by ``;``, ``AND``, ….
    """
    single = _ONE_LICENCE.fullmatch(licence or "")
    return _HUB_LICENCES.get(single[1], "other") if single else "other"


def _front_matter(facts: CardFacts, configs: Mapping[str, Mapping[str, str]] | None) -> str:
    frames = sum(o.frames for o in facts.observations)
    licence = facts.record.licence if facts.record else None
    head: dict[str, Any] = {
        "pretty_name": facts.name,
        "license": hub_licence(licence),
        "task_categories": ["image-segmentation"],
        "tags": ["audio-visual-segmentation", "3d", "binaural", "spatial-audio", "synthetic", "multi-view"],
        "size_categories": [next((name for most, name in _SIZES if frames < most), "1B<n<10B")],
    }
    if head["license"] == "other":
        head |= {"license_name": "other", "license_details": licence or "see the publisher of the release"}
    if configs:
        head["configs"] = [
            {"config_name": name, "data_files": [{"split": split, "path": path} for split, path in files.items()]}
            | ({"default": True} if number == 0 else {})
            for number, (name, files) in enumerate(configs.items())
        ]
    return f"---\n{yaml.safe_dump(head, sort_keys=False, allow_unicode=True, width=110)}---"


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table; the first column is text, the others are aligned right."""
    lines = [f"| {' | '.join(header)} |", f"|{'|'.join(['---', *['---:'] * (len(header) - 1)])}|"]
    return "\n".join(lines + [f"| {' | '.join(str(cell).replace('|', '/') for cell in row)} |" for row in rows])


def _plural(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def _opening(facts: CardFacts) -> str:
    observations = facts.observations
    frames = sum(o.frames for o in observations)
    sizes = sorted({f"{o.width}×{o.height}" for o in observations})
    version = f" {facts.record.version}" if facts.record else ""
    moving = sum(o.moves and o.scene is None for o in observations)
    extra = f" In {_plural(moving, 'observation')} the source moves." if moving else ""
    moving = sum(o.moves and o.scene is not None for o in observations)
    extra += f" In {_plural(moving, 'observation')} objects move, whether they sound or not." if moving else ""
    made = ""
    if facts.record:
        engines = ", ".join(f"{name} {version}" for name, version in sorted(facts.record.backends.items()))
        made = f"\nRendered with {engines} by avs3d-bench {facts.record.toolkit_version}; "
        made += (
            "a sealed test: manifest and truth are published when it ends, and `seal.json` commits to them."
            if facts.record.sealed_test
            else "the manifest "
            f"(sha256 `{facts.record.manifest_sha256[:16]}…`) is stored verbatim in the dataset's `dataset.json`, "
            "and the same manifest and engines give the same bytes."
        )
    if any(o.scene for o in observations):
        extra += (
            " `part_3` holds groups of observations with the same pictures that differ in what sounds, "
            "several sources, sound from the next room, background and silence included."
        )
    return (
        f"# {facts.name}{version}\n\n"
        "3D audio-visual segmentation: posed RGB pictures and one second of binaural sound per picture, along the path "
        "of an agent that passes an object that sounds. The task: mark that object, in every view and in 3D.\n\n"
        f"{_plural(len(observations), 'observation')} with {_plural(frames, 'frame')} of {', '.join(sizes)} pixels, "
        f"44.1 kHz; every eighth frame is a test frame.{extra} It follows the benchmark 3DAVS-S34-O7 of “{PAPER}” "
        f"([arXiv:{ARXIV}](https://arxiv.org/abs/{ARXIV})).{made}"
    )


def _contents(facts: CardFacts) -> str:
    rows = []
    what = {
        "part_1": "one instance of the category",
        "part_2": "several identical instances, one sounds",
        "part_3": "several sources, off-screen sound, silence",
    }
    for part in PARTS:
        mine = [o for o in facts.observations if o.part == part]
        if mine:
            visible = "–" if any(o.visible is None for o in mine) else f"{sum(o.visible or 0 for o in mine):,}"
            rows.append(
                (f"`{part}`: {what[part]}", len(mine), f"{sum(o.frames for o in mine):,}",
                 f"{sum(o.train for o in mine):,}", f"{sum(o.test for o in mine):,}", visible)
            )  # fmt: skip
    text = "## Contents\n\n" + table(("part", "observations", "frames", "train", "test", "object visible"), rows)
    scenes = any(o.scene for o in facts.observations)
    parts = PARTS if scenes else tuple(part for part in PARTS if part != "part_3")
    known = Counter((c, o.part) for o in facts.observations for c in _sounding(o))
    if known:
        own = facts.record.categories if facts.record else None
        lines = [
            (c, *(known[(c, part)] for part in parts), sum(known[(c, part)] for part in parts))
            for c in dict.fromkeys((*CATEGORIES, *(own or ()), *sorted(c for c, _ in known)))
        ]
        text += "\n\n" + table(("sounding category", *parts, "all"), lines)
    if known and scenes:
        text += "\n\nAn observation of `part_3` counts under the category of each of its sources."
    silent = Counter(category for o in facts.observations for category in o.silent)
    if silent:
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(silent.items()))
        text += f"\n\nSilent objects that stand by: {listed}."
    return text


def _sounding(observation: ObservationFacts) -> set[str]:
    """The categories that sound in an observation."""
    if observation.scene is not None:
        return set(observation.scene.categories)
    return {observation.category} if observation.category else set()


def _part_3(facts: CardFacts) -> str:
    """Statistics of part_3; empty where there is none."""
    scenes = [o.scene for o in facts.observations if o.scene is not None]
    if not scenes:
        return ""
    siblings = list(Counter(scene.group for scene in scenes).values())
    audible = Counter(count for scene in scenes for count in scene.audible)
    frames = sum(audible.values())
    rows: list[tuple[str, object]] = [
        ("groups (same pictures, other sound)", len(siblings)),
        ("observations of a group, least – median – most", _spread(siblings, "g")),
        ("without a source", sum(not scene.categories for scene in scenes)),
        ("with one source", sum(len(scene.categories) == 1 for scene in scenes)),
        ("with several sources", sum(len(scene.categories) > 1 for scene in scenes)),
        ("with an off-screen source", sum(scene.off_screen > 0 for scene in scenes)),
        ("with a source that pauses", sum(scene.programmes > 0 for scene in scenes)),
    ]
    for kind in sorted({scene.background[0] for scene in scenes if scene.background}):
        levels = [scene.background[1] for scene in scenes if scene.background and scene.background[0] == kind]
        what = f"with {kind.replace('_', ' ')}"
        span = f"{min(levels):g}" if min(levels) == max(levels) else f"{min(levels):g} to {max(levels):g}"
        rows.append((what, f"{len(levels)} (SNR {span} dB)"))
    for count in sorted(audible):
        what = "nothing audible" if not count else f"{_plural(count, 'audible source')}"
        rows.append((f"frames with {what}", f"{audible[count]:,} ({audible[count] / frames:.0%})"))
    snr = [level for scene in scenes for level in scene.snr]
    if snr:
        rows.append(("SNR of audible sources, least – median – most (dB)", _spread(snr, ".1f")))
    return "## Part 3\n\n" + table(("of `part_3`", "number"), rows)


def _spread(values: Sequence[float], style: str) -> str:
    return " – ".join(format(float(value), style) for value in (min(values), np.median(values), max(values)))


def _rooms_and_sound(facts: CardFacts) -> str:
    rows = []
    for room in ROOMS:
        mine = [o for o in facts.observations if o.room == room]
        if not mine:
            continue
        t30 = [o.t30 for o in mine if o.t30 is not None]
        reach = [o.distances for o in mine if o.distances is not None]
        rows.append(
            (room, len(mine), len({o.scan for o in mine}),
             f"{min(t30):.2f} – {np.median(t30):.2f} – {max(t30):.2f}" if t30 else "–",
             f"{min(a for a, _ in reach):.1f} – {max(b for _, b in reach):.1f}" if reach else "–")
        )  # fmt: skip
    head = ("room", "observations", "homes", "T30, least – median – most (s)", "distance to the source (m)")
    return "## Rooms and sound\n\n" + table(head, rows)


def _files(facts: CardFacts) -> str:
    rows = [
        (f"`{ALL_KINDS[name].folder}/`: {ALL_KINDS[name].what}", f"{files:,}", f"{size / 1e6:,.1f}")
        for name, (files, size) in facts.sizes.items()
    ]
    rows.append(("together", f"{sum(n for n, _ in facts.sizes.values()):,}",
                 f"{sum(size for _, size in facts.sizes.values()) / 1e6:,.1f}"))  # fmt: skip
    return "## Files of the frames\n\n" + table(("folder", "files", "MB"), rows)


def _loading(facts: CardFacts, configs: Mapping[str, Mapping[str, str]] | None) -> str:
    split = next(iter(next(iter(configs.values())))) if configs else "train"
    if configs:
        code = (
            "from datasets import load_dataset\n"
            "from avs3d_bench.exports import waveform\n\n"
            f'frames = load_dataset(".", split="{split}")      # this folder\n'
            'row = frames[0]                                # row["rgb"], row["mask"]: PIL pictures\n'
            'samples, rate = waveform(row["binaural"])      # (2, 44100) float32; no torchcodec needed\n'
            'observations = load_dataset(".", "observations", split="observations")'
        )
    else:
        code = (
            "from avs3d_bench.exports import AVS3DDataset    # a torch.utils.data.Dataset\n\n"
            'frames = AVS3DDataset(".", split="train")       # this folder\n'
            'item = frames[0]                                # item["rgb"], item["binaural"], item["mask"], …'
        )
    return (
        f"## Loading\n\n```python\n{code}\n```\n\n"
        "World: right-handed, metres, Y up. The camera looks down −Z; poses are camera-to-world, quaternions "
        "(w, x, y, z). Azimuth: 0 ahead, positive to the right. Channel 0 is left."
    )


_LIMITS = """## Known limits

- Synthetic: procedural or scanned homes, rendered pictures and computed sound. No sensor noise, no motion blur, no
  second sound, no speech. A method that does well here has not been shown to do so on recordings.
- One object sounds in every frame, whether it is in view or not; many frames show none of it (see the table).
- Masks hold visible pixels only; what glass and mirrors do to them depends on the renderer.
- The path was chosen so that the object comes into view; azimuths and distances are not uniform.
- Seven household categories, three kinds of rooms: not a sample of the homes of the world.{variants}{engine}
- No person was recorded or shown; there is no personal data."""


#: What the card says instead where there is part_3.
_SCENE_LIMITS = {
    "no\n  second sound, no speech.": "no\n  speech.",
    "- One object sounds in every frame, whether it is in view or not; many frames show none of it (see the table).": (
        "- In part_1 and part_2 one object sounds in every frame, in view or not; in part_3 none, one or several.\n"
        "  Many frames show nothing that sounds (see the table).\n"
        "- Off-screen sources are points in the next room, heard through the door opening; a background is diffuse\n"
        "  noise, not the sound of a real place."
    ),
}


def _limits(facts: CardFacts) -> str:
    text = _LIMITS
    if any(o.scene for o in facts.observations):
        for usual, instead in _SCENE_LIMITS.items():
            text = text.replace(usual, instead)
    return text.format(variants=_variants(facts), engine=_engine(facts))


def _variants(facts: CardFacts) -> str:
    count = sum(o.variant_of is not None for o in facts.observations)
    return (
        f"\n- {_plural(count, 'observation')} differ from another in their acoustics or background alone."
        if count
        else ""
    )


def _engine(facts: CardFacts) -> str:
    engines = sorted({o.acoustics for o in facts.observations if o.acoustics})
    return f"\n- The sound is that of {', '.join(engines)} with the HRTF of one head." if engines else ""


def _licences(facts: CardFacts) -> str:
    if facts.record is None:
        return (
            "## Licence\n\nThe release states no licence in its files: ask its publisher. Scans and assets keep the "
            "licences of their sources."
        )
    rows = [(a.asset, a.name, a.author, a.source) for a in facts.record.attributions]
    text = f"## Licence\n\n{facts.record.licence}"
    if rows:
        head = ("asset", "licence", "author", "source")
        text += "\n\n" + table(head, rows).replace("---:", "---")
    return text
