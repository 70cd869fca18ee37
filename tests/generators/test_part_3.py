"""Part_3 observations from end to end in a small room: what siblings share, what the stems say, what the masks mark."""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import yaml
from click.testing import CliRunner
from scipy.signal import fftconvolve

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB, AUDIBLE_SNR_DB
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.formats import media
from avs3d_bench.validate import validate
from generators.acoustics.clips import GAIN
from generators.cli import generate
from generators.core.scene import Scene
from generators.lighting.bake import insert
from generators.observation.arrangement import Arrangement
from generators.observation.regenerate import regenerate
from generators.observation.sources import SoundSource, choose_sources
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from tests.support.flats import plain_flat
from tests.support.here import forget_arrangements
from tests.support.homes import tree_digest, write_manifest
from tests.support.tiny import clone, replace

pytestmark = pytest.mark.slow

FIRST = "part_3/box/kitchen/1"
RATE = layout.SAMPLE_RATE
FRAMES = 12
FIRST_ENTRY = {
    "part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 2, "clock": 1},
    "sources": [{"category": "microwave", "instance": 1}],
}  # fmt: skip
#: Index → sources and background of the siblings.
SIBLINGS: dict[int, dict[str, Any]] = {
    2: {"sources": [{"category": "microwave", "instance": 2}]},
    3: {"sources": [{"category": "clock", "programme": [[2, 4.5], [8, 10]]}]},
    4: {"sources": []},
    5: {
        "sources": [
            {"category": "microwave", "instance": 1, "programme": {"turn": {"number": 1, "of": 2, "seconds": 2}}},
            {"category": "microwave", "instance": 2, "programme": {"turn": {"number": 2, "of": 2, "seconds": 2}}},
            {"category": "clock", "gain_db": -12},
        ],
        "background": {"kind": "noise", "snr_db": 12},
    },
    6: {"sources": [], "background": {"kind": "room_tone", "snr_db": 5}},
}
ENTRIES = [FIRST_ENTRY, *({"like": FIRST, "index": number} | sibling for number, sibling in SIBLINGS.items())]
SHARED = (layout.INPUT, layout.IMAGES, layout.INSTANCE_MASKS, layout.DEPTH, "sparse")


def _run(manifest: Path, root: Path, *options: str) -> None:
    one = ("--workers", "1")  # unless an option says otherwise
    outcome = CliRunner().invoke(
        generate,
        [str(manifest), "-o", str(root), "--audio", "analytic", "--with", "stems", "--with", "depth", *one, *options],
    )
    assert outcome.exit_code == 0, outcome.output


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("scenes"), observations=ENTRIES)


@pytest.fixture(scope="module")
def group(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("group") / "tree"
    _run(manifest, root)
    return Dataset(root)


def sibling(group: Dataset, index: int) -> Observation:
    return group[f"part_3/box/kitchen/{index}"]


def stem(observation: Observation, name: str) -> np.ndarray:
    """(2, n) a stem over all frames."""
    return np.concatenate([frame.stem(name) for frame in observation.frames], axis=1)


def test_the_tree_is_valid(group: Dataset) -> None:
    report = validate(group.root, deep=True)
    assert not report.problems, [f"{p.path}: {p.message}" for p in report.problems]


def test_siblings_are_hard_links_to_the_pictures_of_the_first(group: Dataset) -> None:
    first = sibling(group, 1)
    for observation in group:
        assert observation.group == FIRST
        for path in (p for p in sorted(first.path.rglob("*")) if p.is_file()):
            name = path.relative_to(first.path)
            if name.parts[0] in SHARED:
                assert os.path.samefile(path, observation.path / name), name


def test_a_sibling_made_alone_has_the_same_bytes(group: Dataset, manifest: Path, tmp_path: Path) -> None:
    """Without the first, its pictures are rendered: nothing but time depends on that."""
    forget_arrangements()
    _run(manifest, tmp_path / "alone", "--only", "part_3/box/kitchen/5")
    key = "part_3/box/kitchen/5"
    assert tree_digest(tmp_path / "alone" / key) == tree_digest(group.root / key)


def test_two_workers_give_the_same_bytes_as_one(group: Dataset, manifest: Path, tmp_path: Path) -> None:
    _run(manifest, tmp_path / "two", "--workers", "2")
    assert tree_digest(tmp_path / "two" / "part_3") == tree_digest(group.root / "part_3")


def test_a_damaged_first_is_not_linked(manifest: Path, group: Dataset, tmp_path: Path) -> None:
    root = tmp_path / "tree"
    shutil.copytree(group.root, root)
    shutil.rmtree(root / "part_3/box/kitchen/2")
    (root / FIRST / layout.image_path(layout.INPUT, 3)).write_bytes(b"no picture")
    _run(manifest, root)
    assert tree_digest(root / "part_3") == tree_digest(group.root / "part_3")


def test_the_sum_of_the_stems_is_the_clip(group: Dataset) -> None:
    for observation in group:
        record = observation.record
        assert record is not None
        names = [s.id for s in record.sources or ()] + ([layout.BACKGROUND] if record.background else [])
        for frame in observation.frames:
            total = sum((frame.stem(name).astype(np.float64) for name in names), start=np.zeros((2, RATE)))
            np.testing.assert_allclose(frame.audio(), total, atol=1e-6)


@pytest.mark.parametrize(
    ("one", "other"), [((1, "source_1"), (5, "source_1")), ((1, "source_1"), (2, "source_1"))], ids=["itself", "twin"]
)
def test_no_source_of_a_sibling_plays_what_another_sibling_plays(
    group: Dataset, one: tuple[int, str], other: tuple[int, str]
) -> None:
    """The same microwave alone and in turns, and its twin: other samples, little correlated, at about one level."""
    second = slice(RATE, 2 * RATE)  # all of them sound
    a, b = (stem(sibling(group, index), name)[:, second].astype(np.float64) for index, name in (one, other))
    assert not np.any((a == b) & (a != 0))
    crossed = fftconvolve(a, b[:, ::-1], axes=1)
    # Both hum at the mains frequency, so that their stems are somewhat alike; one take from one place gives 1.
    assert np.abs(crossed).max() < 0.9 * np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1)).max()
    assert abs(10 * np.log10(np.mean(a**2) / np.mean(b**2))) < 6


def test_a_programme_starts_at_its_sample_and_ends_with_its_reverberation(group: Dataset) -> None:
    observation = sibling(group, 3)
    record = observation.record
    assert record is not None
    (source,) = record.sources or ()
    assert source.programme == ((2.0, 4.5), (8.0, 10.0))
    heard = np.abs(stem(observation, source.id)).max(axis=0)
    distance = record.frames[2].distance
    assert distance is not None
    arrival = 2 * RATE + distance / 343.0 * RATE
    loud = np.flatnonzero(heard > 1e-3 * heard.max())
    # The renderer spreads an arrival over 16 samples on both sides, and the nearer ear is up to 0.3 ms early; the ramp
    # of 5 ms hides the first samples.
    assert arrival - 32 <= loud[0] <= arrival + 220
    tail = record.acoustics.t30 or 1.0
    quiet = slice(round((4.5 + tail + 0.1) * RATE), 8 * RATE)
    assert heard[quiet].max() < 1e-3 * heard.max()
    assert heard[: round(arrival) - 32].max() < 1e-5 * heard.max()


def test_silence_is_silence(group: Dataset) -> None:
    observation = sibling(group, 4)
    record = observation.record
    assert record is not None
    assert (record.category, record.source_position, record.sources) == (None, None, ())
    for frame in observation.frames:
        assert not frame.audio().any()
        assert not frame.mono().any()
        assert not frame.mask().any()
    assert not (observation.path / layout.GT_3D).exists()


def test_audible_follows_from_the_stems(group: Dataset) -> None:
    def level(clip: np.ndarray) -> float:
        return 10 * float(np.log10(max(np.mean(np.square(clip, dtype=np.float64)), 1e-30)))

    both = 0
    for observation in group:
        record = observation.record
        assert record is not None
        for frame, entry in zip(observation.frames, record.frames, strict=True):
            expected = {}
            for source in record.sources or ():
                own = frame.stem(source.id)
                rest = level(frame.audio().astype(np.float64) - own)
                if level(own) >= AUDIBLE_LEVEL_DB and level(own) - rest >= AUDIBLE_SNR_DB:
                    expected[source.id] = (level(own), level(own) - rest)
            found = {one.source: one for one in entry.audible or ()}
            assert set(found) == set(expected)
            both += len(found) > 1
            for name, (own_level, snr) in expected.items():
                assert found[name].level_db == pytest.approx(own_level, abs=1e-3)
                if found[name].snr_db is not None:
                    assert found[name].snr_db == pytest.approx(snr, abs=1e-2)
    assert both > 3


def test_masks_mark_what_is_audible_and_visible(group: Dataset) -> None:
    for observation in group:
        record = observation.record
        assert record is not None
        kinds = {instance.id: record.class_ids.get(instance.category, 0) for instance in record.instances}
        for frame, entry in zip(observation.frames, record.frames, strict=True):
            ids = frame.instance_ids()
            heard = record.audible_instances(entry)
            np.testing.assert_array_equal(frame.mask(), np.isin(ids, heard))
            expected = np.where(np.isin(ids, heard), np.vectorize(lambda n, k=kinds: k.get(n, 0))(ids), 0)
            np.testing.assert_array_equal(frame.category_mask(), expected)
            assert entry.visible_pixels == int(frame.mask().sum())


def test_the_background_has_its_snr(group: Dataset) -> None:
    observation = sibling(group, 5)
    record = observation.record
    assert record is not None
    assert record.background is not None
    sources = sum(stem(observation, s.id).astype(np.float64) for s in record.sources or ())
    noise = stem(observation, layout.BACKGROUND).astype(np.float64)
    snr = 10 * np.log10(np.mean(sources**2) / np.mean(noise**2))
    assert snr == pytest.approx(12, abs=0.01)
    assert record.background.level_db == pytest.approx(10 * np.log10(np.mean(noise**2)), abs=1e-3)


def test_gain_is_a_level(manifest: Path, group: Dataset, tmp_path: Path) -> None:
    """−12 dB of the clock in sibling 5 against the same sibling with 0 dB."""
    path = manifest.parent / "loud.yaml"
    document = yaml.safe_load(manifest.read_text())
    del document["observations"][4]["sources"][2]["gain_db"]
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    _run(path, tmp_path / "loud", "--only", "part_3/box/kitchen/5")
    full = stem(Dataset(tmp_path / "loud")["part_3/box/kitchen/5"], "source_3").astype(np.float64)
    soft = stem(sibling(group, 5), "source_3").astype(np.float64)
    np.testing.assert_allclose(soft, full * 10 ** (-12 / 20), atol=1e-7)


def test_what_sounds_changes_no_digest_of_the_pictures(manifest: Path) -> None:
    plans = make_plans(read_manifest(manifest), GenerateOptions(audio="analytic"))
    assert len({plan.pictures_digest for plan in plans}) == 1
    assert len({plan.digest for plan in plans}) == len(plans)


def test_frames_made_again_are_the_same_and_a_changed_stem_is_found(
    group: Dataset, manifest: Path, tmp_path: Path
) -> None:
    chosen = {f"part_3/box/kitchen/{index}": (0, 7) for index in (1, 4, 5)}
    assert not list(regenerate(group.root, chosen, manifest, lambda _: None))
    root = clone(group.root, tmp_path / "changed")
    changed = f"part_3/box/kitchen/5/{layout.stem_path('source_2', 7)}"
    replace(root / changed, (root / changed.replace("frame_7", "frame_3")).read_bytes())
    found = list(regenerate(root, {"part_3/box/kitchen/5": (7,)}, manifest, lambda _: None))
    assert [(p.path, p.message) for p in found] == [(changed, "differs from the regenerated file")]


def test_silence_with_responses_and_stems_can_be_regenerated(manifest: Path, tmp_path: Path) -> None:
    """Neither leaves a file in a silent observation, but both count in its plan."""
    key = "part_3/box/kitchen/4"
    _run(manifest, tmp_path / "tree", "--with", "rirs", "--only", key)
    assert list(regenerate(tmp_path / "tree", {key: (3,)}, manifest, lambda _: None)) == []


def test_the_mesh_of_a_scene_holds_every_sounding_object(group: Dataset) -> None:
    observation = sibling(group, 5)
    record = observation.record
    assert record is not None
    vertices = observation.mesh().vertices
    sounding = record.sounding_instances
    assert len(sounding) == 3
    bounds = np.array([instance.bounds for instance in sounding])
    np.testing.assert_allclose(vertices.min(axis=0), bounds[:, 0].min(axis=0), atol=1e-5)
    np.testing.assert_allclose(vertices.max(axis=0), bounds[:, 1].max(axis=0), atol=1e-5)


TURN = {"of": 2, "seconds": 1}
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a programme outside the clip": (
        {"sources": [{"category": "clock", "programme": [[2, 13]]}]},
        r"sources.0.programme: .*kitchen/2: interval \[2, 13\] ends after the last frame; expected at most 12 s",
    ),
    "a negative start": ({"sources": [{"category": "clock", "programme": [[-1, 3]]}]}, r"sources.0.programme.*-1"),
    "overlapping intervals": (
        {"sources": [{"category": "clock", "programme": [[0, 3], [2, 5]]}]},
        r"interval \[2, 5\] begins before 3 s, where the one before ends",
    ),
    "an empty interval": ({"sources": [{"category": "clock", "programme": [[3, 3]]}]}, r"interval \[3, 3\] is empty"),
    "an interval that is too short": (
        {"sources": [{"category": "clock", "programme": [[3, 3.04]]}]},
        r"interval \[3, 3.04\] is too short; expected at least 0.05 s",
    ),
    "a turn that never comes": (
        {"sources": [{"category": "clock", "programme": {"turn": {"number": 3, "of": 3, "seconds": 5, "pause": 1}}}]},
        r"sources.0.programme: .*kitchen/2: programme begins at 12 s at the earliest; expected less than 12 s",
    ),
    "bursts that never come": (
        {"sources": [{"category": "clock", "programme": {"bursts": {"sound": [1, 2], "pause": [20, 30]}}}]},
        r"sources.0.programme: .*kitchen/2: programme begins at 20 s at the earliest; expected less than 12 s",
    ),
    "no interval": ({"sources": [{"category": "clock", "programme": []}]}, r"programme"),
    "a programme of another kind": (
        {"sources": [{"category": "clock", "programme": "sometimes"}]},
        r"sources.0.programme: found 'sometimes'; expected always",
    ),
    "two kinds of programme": (
        {"sources": [{"category": "clock", "programme": {"intervals": [[0, 1]], "turn": TURN | {"number": 1}}}]},
        r"found intervals and turn; expected exactly one",
    ),
    "a turn that does not exist": (
        {"sources": [{"category": "clock", "programme": {"turn": TURN | {"number": 3}}}]},
        r"turn 3 of 2 does not exist",
    ),
    "bursts from most to least": (
        {"sources": [{"category": "clock", "programme": {"bursts": {"sound": [3, 1], "pause": [1, 2]}}}]},
        r"sound is \[3, 1\]; expected \[least, most\]",
    ),
    "an instance that does not exist": (
        {"sources": [{"category": "microwave", "instance": 3}]},
        r"sources.0: instance 3 of microwave does not exist; expected 1 to 2",
    ),
    "an instance that sounds already": (
        {"sources": [{"category": "microwave", "instance": 2}] * 2},
        r"sources.1: instance 2 of microwave sounds already",
    ),
    "more sources than objects": (
        {"sources": [{"category": "clock"}, {"category": "clock"}]},
        r"sources.1: 2 sources, but there is only 1 × clock",
    ),
    "a category that is not in the room": (
        {"sources": [{"category": "telephone"}]},
        r"sources.0: no telephone stands in this kitchen; instances has microwave, clock",
    ),
    "an off-screen room that does not exist": (
        {"sources": [{"category": "clock", "room": "cellar"}]},
        r"sources.0.room: unknown room 'cellar'",
    ),
    "an off-screen source in the same room": (
        {"sources": [{"category": "clock", "room": "kitchen"}]},
        r"sources.0: room kitchen is the observation's own",
    ),
    "an off-screen source with an instance": (
        {"sources": [{"category": "clock", "room": "bathroom", "instance": 1}]},
        r"sources.0: instance 1 is an object of the observation's room",
    ),
    "an SNR of NaN": (
        {"sources": [], "background": {"kind": "noise", "snr_db": float("nan")}},
        r"background.snr_db.*nan",
    ),
    "a background of an unknown kind": (
        {"sources": [], "background": {"kind": "music", "snr_db": 3}},
        r"background.kind.*'music'",
    ),
    "an SNR that is no number": (
        {"sources": [], "background": {"kind": "noise", "snr_db": True}},
        r"background.snr_db: expected a number, found true$",
    ),
    "an interval of three times": (
        {"sources": [{"category": "clock", "programme": [[1, 2, 3]]}]},
        r"programme.intervals.0: too many entries; expected at most 2$",
    ),
    "a source that is a name": ({"sources": ["clock"]}, r"2.sources.0: expected a mapping, found 'clock'$"),
    "a like that is no key": ({"like": None, "sources": []}, r"observations.2: like None names no observation"),
    "a gain of 90 dB": ({"sources": [{"category": "clock", "gain_db": 90}]}, r"gain_db.*90"),
    "a chain of siblings": (
        {"like": "part_3/box/kitchen/9", "sources": []},
        r"like 'part_3/box/kitchen/9' names no observation of this manifest that is not a variant itself",
    ),
    "a sibling with other objects": (
        {"sources": [], "instances": {"clock": 2}},
        r"an entry with like cannot have instances; a variant takes everything except index, acoustics, sources",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_bad_scenes_are_one_line(case: str, tmp_path: Path) -> None:
    changes, message = REFUSED[case]
    chain = {"like": FIRST, "index": 9, "sources": []}
    entries = [FIRST_ENTRY, chain, {"like": FIRST, "index": 2} | changes]
    with pytest.raises(UsageError, match=message) as caught:
        read_manifest(write_manifest(tmp_path, observations=entries))
    assert "\n" not in str(caught.value)


def test_fields_of_the_other_parts_are_refused(tmp_path: Path) -> None:
    for change, message in (
        ({"category": "clock"}, "category does not belong to part_3"),
        ({"instances": {"microwave": 0}}, r"observations.0.instances.microwave: Input .* equal to 1 \(found 0\)$"),
        ({"instances": ["clock"]}, r"instances: expected a number, or in part_3 the objects of the room.*\['clock'\]"),
        ({"instances": 2}, r"instances: expected the objects of the room, e.g. \{microwave: 2"),
        ({"sources": None}, r"sources is missing; expected a list, \[\] for silence"),
        ({"source_motion": "path"}, "source_motion belongs to part_1 and part_2"),
        ({"twins": "alik"}, r"observations.0.twins: Input should be 'apart' or 'alike' \(found 'alik'\)"),
        (
            {"part": "part_1", "category": "clock", "instances": None, "sources": None, "twins": "alike"},
            "twins does not belong to part_1",
        ),
        ({"part": "part_1", "category": "clock", "instances": None}, "sources does not belong to part_1"),
        (
            {"part": "part_1", "category": "clock", "instances": None, "sources": []},
            "sources does not belong to part_1",
        ),
    ):
        with pytest.raises(UsageError, match=message):
            read_manifest(write_manifest(tmp_path, observations=[FIRST_ENTRY | change]))


def test_an_off_screen_room_that_this_home_lacks_is_one_line(tmp_path: Path) -> None:
    entry = FIRST_ENTRY | {"sources": [{"category": "clock", "room": "bathroom"}]}
    path = write_manifest(tmp_path, observations=[entry])
    arguments = [str(path), "-o", str(tmp_path / "out"), "--audio", "analytic", "--workers", "1"]
    outcome = CliRunner().invoke(generate, arguments)
    assert outcome.exit_code == 1
    assert "no room 'bathroom'; it has kitchen" in outcome.output
    assert not media_files(tmp_path / "out")


def media_files(root: Path) -> list[Path]:
    return [path for path in root.rglob("*") if path.suffix in (".png", ".wav")]


def test_siblings_of_one_that_fails_are_made(group: Dataset, tmp_path: Path) -> None:
    """The sound of the first cannot be made; that is no reason for its siblings, which sound of something else."""
    entry = FIRST_ENTRY | {"sources": [{"category": "clock", "room": "bathroom"}]}
    silent = {"like": FIRST, "index": 4, "sources": []}
    path = write_manifest(tmp_path, observations=[entry, silent])
    root = tmp_path / "out"
    arguments = [str(path), "-o", str(root), "--audio", "analytic", "--with", "depth", "--workers", "1"]
    outcome = CliRunner().invoke(generate, arguments)
    assert outcome.exit_code == 1
    lines = [line for line in outcome.output.splitlines() if line.startswith("avs3d: error: ")]
    assert len(lines) == 1
    assert lines[0].startswith(f"avs3d: error: {FIRST}: ")
    assert "no room 'bathroom'" in lines[0]
    made, expected = (tree_digest(each / "part_3/box/kitchen/4") for each in (root, group.root))
    del made[layout.OBSERVATION_JSON], expected[layout.OBSERVATION_JSON]  # its plan is of another manifest
    assert made == expected


def away(folder: Path, *categories: str, **changes: object) -> tuple[SoundSource, ...]:
    """Off-screen sources of these categories in the living room of an apartment."""
    entry = FIRST_ENTRY | {
        "scan": "flat",
        "sources": [{"category": name, "room": "living_room"} for name in categories],
    }
    scans = {"flat": {"source": "apartment", "seed": 11}}
    path = write_manifest(folder, scans=scans, observations=[entry], **changes)
    (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
    return choose_sources(plan, plain_flat(11), Arrangement((), (), ()))


def test_off_screen_sources_of_one_room_stand_apart(tmp_path: Path) -> None:
    both, alone = away(tmp_path, "clock", "telephone"), away(tmp_path, "telephone")
    assert math.dist(both[0].position, both[1].position) > 0.2
    assert both[0].position == alone[0].position, "the first of a room is at the same place in all siblings"


def test_twins_do_not_play_a_recording_in_step(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(0, 0.1, 3 * RATE)
    soundfile.write(tmp_path / "hum.wav", noise, RATE, subtype="FLOAT")
    licence = {"name": "CC0-1.0", "author": "avs3d-bench"}
    sounds = {"microwave": [{"file": "hum.wav", "licence": licence}]}
    first, second = (source.signal.samples for source in away(tmp_path, "microwave", "microwave", sounds=sounds))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05


def test_fewer_frames_cut_programmes_off(manifest: Path, tmp_path: Path) -> None:
    _run(manifest, tmp_path / "short", "--frames", "3", "--only", "part_3/box/kitchen/3")
    record = Dataset(tmp_path / "short")["part_3/box/kitchen/3"].record
    assert record is not None
    assert (record.sources or ())[0].programme == ((2.0, 3.0),)
    assert media.read_json(tmp_path / "short/dataset.json")["schema_version"] == "1.1"


def test_sources_that_reach_full_scale_together_are_lowered_as_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By whole decibels to less than −1 dB of full scale, which the gain in the record tells; so is a source alone."""
    lit: list[Scene] = []
    monkeypatch.setattr("generators.scenes.placed.insert", lambda *args: lit.append(insert(*args)) or lit[-1])

    def made(name: str, gain_db: float, *sources: int) -> Path:
        entry: dict[str, Any] = {
            "part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 2},
            "sources": [{"category": "microwave", "instance": one, "gain_db": gain_db} for one in sources],
        }  # fmt: skip
        alone = {"like": FIRST, "index": 2, "sources": [{**entry["sources"][-1], "gain_db": 20.0}]}
        (tmp_path / name).mkdir()
        return write_manifest(tmp_path / name, levels=[4, 4], observations=[entry, alone])

    def peak_and_clips(root: Path) -> tuple[float, list[Any]]:
        clips = [frame.audio() for frame in Dataset(root)[FIRST].frames]
        return max(float(np.abs(clip).max()) for clip in clips), clips

    _run(made("quiet", 0.0, 1, 2), tmp_path / "quiet/tree", "--frames", "3", "--size", "64")
    peak, quiet = peak_and_clips(tmp_path / "quiet/tree")
    gain_db = round(20 * math.log10(1.2 / peak), 3)
    loud_manifest = made("loud", gain_db, 1, 2)
    _run(loud_manifest, tmp_path / "loud/tree", "--frames", "3", "--size", "64")
    assert len(lit) <= 2, "what is made again with all sources lower was lit again, too"
    data = Dataset(tmp_path / "loud/tree")
    record = data[FIRST].record
    assert record is not None
    assert record.acoustics.gain == pytest.approx(GAIN * 10 ** (-3 / 20))
    alone = data[FIRST.replace("/1", "/2")]
    assert alone.record is not None
    assert alone.record.acoustics.gain < GAIN
    assert max(float(np.abs(frame.audio()).max()) for frame in alone.frames) < 10 ** (-1 / 20)
    found, loud = peak_and_clips(data.root)
    assert found == pytest.approx(1.2 * 10 ** (-3 / 20), rel=1e-3)
    for one, other in zip(loud, quiet, strict=True):
        np.testing.assert_allclose(one, other * 10 ** ((gain_db - 3) / 20), atol=2e-6)
    assert not validate(data.root, deep=True).problems
    assert not list(regenerate(data.root, {FIRST: (1,)}, loud_manifest, lambda _: None))
