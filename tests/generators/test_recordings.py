"""Recordings as assets: pinned, trimmed, each of one split; a poor one has one line, or a meaning."""

from __future__ import annotations

import re
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import soundfile
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from benchmarks.recorded_manifests import SOURCES, recorded, write_training
from generators.assets.sounds import load_sound, recorded_seconds, survey
from generators.assets.sounds.recordings import resampled
from generators.library import AssetEntry, read_lock, update_lock
from generators.library.cli import assets
from generators.library.recorded import recorded_voices
from generators.library.references import asset_digests
from generators.library.store import Store
from generators.manifest.reading import read_manifest
from generators.observation.sources import SoundFile
from tests.support.library_server import Reply, Server, wav

SR = 44_100
MANIFESTS = Path(__file__).parents[2] / "scenes_manifest"
COMMIT = "0123456789abcdef0123456789abcdef01234567"
REF = f"ann/house-sounds@{COMMIT}:kitchen/old clock (1).wav"


def run(*args: object) -> Result:
    return CliRunner().invoke(assets, [str(arg) for arg in args])


def noise(seconds: float, rate: int = SR, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(0, 0.1, round(seconds * rate)).clip(-0.9, 0.9)


@pytest.mark.parametrize("rate", [8000, 16_000, 24_000])
def test_what_is_resampled_has_no_image_above_half_its_sample_rate(rate: int) -> None:
    """A tone at 0.97 of it, and noise: what lies above is 80 dB lower; a tone at 0.9 keeps its level and place."""
    half, time = rate / 2, np.arange(2 * rate) / rate
    for sound in (np.sin(2 * np.pi * 0.97 * half * time), noise(2.0, rate)):
        heard = resampled(sound * np.hanning(len(sound)), rate)
        assert len(heard) == 2 * SR
        images = np.abs(np.fft.rfft(heard))[round(2 * half) + 20 :]
        spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound)))) * SR / rate
        assert 20 * np.log10(images.max() / spectrum.max()) < -80
    tone = resampled(np.sin(2 * np.pi * 0.9 * half * time), rate)
    expected = np.sin(2 * np.pi * 0.9 * half * np.arange(2 * SR) / SR)
    assert np.abs(tone - expected)[SR // 10 : -SR // 10].max() < 1e-3


def fetch(lock: Path, *more: str, ref: str = REF) -> Result:
    return run("fetch", "github", ref, "--category", "clock", "--lock", lock, *more)


CREDIT = ("--licence", "CC0", "--author", "Ann")


def test_a_file_of_a_commit_is_pinned_and_fetched_again(github_server: Server, tmp_path: Path) -> None:
    data, lock = wav(), tmp_path / "assets.lock.yaml"
    github_server.on(f"/ann/house-sounds/{COMMIT}/kitchen/old%20clock%20%281%29.wav", Reply(data))
    done = fetch(lock, *CREDIT, "--url", "https://freesound.org/s/1/")
    assert done.exit_code == 0, done.output
    (entry,) = read_lock(lock).assets
    assert entry.id == "github/ann/house-sounds/kitchen/old-clock-1"
    assert (entry.licence, entry.author, entry.ref) == ("CC0-1.0", "Ann", REF)
    assert (entry.url, entry.bytes) == ("https://freesound.org/s/1/", len(data))
    store = Store(tmp_path / "store")
    store.drop(entry)
    assert run("fetch", "--lock", lock).exit_code == 0
    assert store.path(entry).read_bytes() == data


def test_ogg_audio_has_a_suffix_of_its_own(github_server: Server, tmp_path: Path) -> None:
    """RFC 5334: .oga is Ogg with sound alone; ring tones of phones are often such files."""
    soundfile.write(tmp_path / "ring.ogg", noise(2), SR)
    github_server.on(f"/ann/house-sounds/{COMMIT}/ring.oga", Reply((tmp_path / "ring.ogg").read_bytes()))
    done = fetch(tmp_path / "assets.lock.yaml", *CREDIT, ref=f"ann/house-sounds@{COMMIT}:ring.oga")
    assert done.exit_code == 0, done.output
    (entry,) = read_lock(tmp_path / "assets.lock.yaml").assets
    assert (entry.kind, entry.file) == ("sound", "sound.oga")
    assert len(load_sound(Store(tmp_path / "store").path(entry), 2)) == 2 * SR


@pytest.mark.parametrize(
    ("ref", "more", "words"),
    [
        ("ann/house-sounds:clock.wav", CREDIT, "names no file of a commit; expected OWNER/REPOSITORY@COMMIT:PATH"),
        (f"ann/house-sounds@{COMMIT}:clock.mid", CREDIT, "is no sound and no scan; expected .wav"),
        (REF, (), "GitHub does not say who made a file; name --licence and --author"),
        (REF, ("--licence", "CC BY-ND 4.0", "--author", "Ann"), "forbids adaptations"),
        (REF, CREDIT, "look for the commit and the path"),
        (REF, (*CREDIT, "--format", "wav"), "github offers each file in its own format only"),
    ],
)
def test_a_file_that_cannot_be_had_is_one_line(
    github_server: Server, tmp_path: Path, ref: str, more: tuple[str, ...], words: str
) -> None:
    done = fetch(tmp_path / "assets.lock.yaml", *more, ref=ref)
    assert done.exit_code != 0
    assert sum(words in line for line in (done.output + str(done.exception)).splitlines()) == 1
    assert not (tmp_path / "assets.lock.yaml").exists()


# ---- a folder -------------------------------------------------------------------------------------------------------

INDEX = """file,category,licence,author,title,url,split,begin,end,remark
a/tick.wav,clock,CC BY-SA 4.0,Bo,Tick,https://example.org/1,test,0.5,1.75,x
hum.flac,microwave,https://creativecommons.org/publicdomain/zero/1.0/,Cy,,,train,,,
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    place = tmp_path / "mine"
    (place / "a").mkdir(parents=True)
    soundfile.write(place / "a" / "tick.wav", noise(2), SR)
    soundfile.write(place / "hum.flac", noise(3), SR)
    soundfile.write(place / "unlisted.wav", noise(1), SR)
    (tmp_path / "index.csv").write_text(INDEX)
    return place


def test_an_index_says_what_each_file_is(folder: Path, tmp_path: Path) -> None:
    lock = tmp_path / "assets.lock.yaml"
    done = run("import", "folder", folder, "--index", tmp_path / "index.csv", "--lock", lock)
    assert done.exit_code == 0, done.output
    tick, hum = read_lock(lock).assets
    assert (tick.id, tick.category, tick.licence, tick.author) == ("folder/mine/a/tick", "clock", "CC-BY-SA-4.0", "Bo")
    assert (tick.title, tick.trim, tick.split) == ("Tick", (0.5, 1.75), "test")
    assert (hum.title, hum.licence, hum.trim, hum.split) == ("hum", "CC0-1.0", None, "train")
    assert "trim: [0.5, 1.75]\n" in lock.read_text()

    # The store is lost; the pinned files are found by their hash, under whatever name.
    for entry in (tick, hum):
        Store(tmp_path / "store").drop(entry)
    moved = tmp_path / "elsewhere"
    folder.rename(moved)
    (moved / "hum.flac").rename(moved / "renamed.bin")
    assert run("fetch", "--lock", lock).exit_code == 1
    done = run("fetch", "--from", moved, "--lock", lock)
    assert done.exit_code == 0, done.output
    assert "2 fetched" in done.output
    assert all(not Store(tmp_path / "store").problem(entry) for entry in (tick, hum))
    assert run("fetch", "--from", tmp_path / "none", "--lock", lock).exit_code != 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("licence,", "license,"), "has no column 'licence'; expected file, category, licence, author"),
        (("Bo,", ","), "line 2: column 'author' is empty"),
        (("a/tick", "a/tock"), "line 2: no file 'a/tock.wav'"),
        ((",test,", ",eval,"), "line 2: split 'eval'; expected train, validation, test"),
        (("0.5,1.75", "0.5,late"), "line 2: begin '0.5', end 'late'; expected seconds"),
        (("0.5,1.75", "0.5,9"), "folder/mine/a/tick: lasts 2.00 s, but its trim ends at 9 s; correct the trim"),
        ((",clock,", ",A Clock,"), "category 'A Clock': expected lower-case letters"),
        (("0.5,1.75", "0.5,0.6"), "trim is [0.5, 0.6]; expected [begin, end], 0.5 s or more"),
    ],
)
def test_an_index_with_a_fault_is_one_line(folder: Path, tmp_path: Path, change: tuple[str, str], words: str) -> None:
    index = tmp_path / "index.csv"
    index.write_text(INDEX.replace(*change))
    done = run("import", "folder", folder, "--index", index, "--lock", tmp_path / "assets.lock.yaml")
    assert done.exit_code != 0
    assert words in done.output + str(done.exception)


def test_an_index_of_a_spreadsheet_and_a_slip_in_a_category(folder: Path, tmp_path: Path) -> None:
    index, lock = tmp_path / "index.csv", tmp_path / "assets.lock.yaml"
    index.write_text(INDEX.replace(",clock,", ",clok,"), encoding="utf-8-sig")
    done = run("import", "folder", folder, "--index", index, "--lock", lock)
    assert done.exit_code == 0, done.output
    assert "note: clok is no category of the benchmark" in done.output
    assert "did you mean 'clock'?" in done.output


# ---- trim and split -------------------------------------------------------------------------------------------------


def entry_of(**changes: object) -> AssetEntry:
    fields = {
        "id": "folder/mine/tick", "kind": "sound", "category": "clock", "source": "folder", "ref": "tick.wav",
        "title": "Tick", "author": "Bo", "licence": "CC0-1.0", "file": "sound.wav", "sha256": "0" * 64, "bytes": 9,
    }  # fmt: skip
    return AssetEntry.model_validate(fields | changes)


def test_what_was_said_of_the_same_bytes_is_kept(tmp_path: Path) -> None:
    lock = tmp_path / "assets.lock.yaml"
    update_lock(lock, [entry_of(trim=(1, 2), split="train")])
    (kept,) = update_lock(lock, [entry_of(title="Tock")]).assets
    assert (kept.title, kept.trim, kept.split) == ("Tock", (1.0, 2.0), "train")
    (changed,) = update_lock(lock, [entry_of(sha256="1" * 64)]).assets
    assert (changed.trim, changed.split) == (None, None)


def test_a_trim_changes_what_is_heard_and_a_split_does_not(tmp_path: Path) -> None:
    digests = []
    cases: list[dict[str, object]] = [{}, {"split": "test"}, {"trim": (0, 1)}]
    for number, more in enumerate(cases):
        lock = tmp_path / str(number) / "assets.lock.yaml"
        update_lock(lock, [entry_of(**more)])
        digests.append(asset_digests(lock, ["folder/mine/tick"]))
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("field", [{"trim": (0, 1)}, {"split": "test"}])
def test_an_object_has_neither(field: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="belongs to sounds only"):
        entry_of(kind="object", up="y", front="+z", **field)


def test_only_what_is_inside_the_trim_is_heard(tmp_path: Path) -> None:
    loud, path = noise(4), tmp_path / "a.wav"
    loud[:SR] = 0.9
    loud[2 * SR :] = -0.9
    soundfile.write(path, loud, SR, subtype="FLOAT")
    assert recorded_seconds(path, (1.0, 2.0)) == 1.0
    source = load_sound(path, 6, trim=(1.0, 2.0))
    assert source.shape == (6 * SR,)
    assert np.corrcoef(source[: SR // 2], loud[SR : SR + SR // 2])[0, 1] > 0.999
    # The loop is cross-faded: no step is larger than those of the noise itself.
    assert np.abs(np.diff(source)).max() <= 1.5 * np.abs(np.diff(source[: SR // 2])).max()
    file = SoundFile(path, "x", None, (1.0, 2.0))  # type: ignore[arg-type]  # its licence is not looked at
    assert file.seconds == 1.0
    np.testing.assert_array_equal(file.signal(6).samples, source)
    with pytest.raises(Avs3dError, match=r"lasts 4\.00 s, but its trim ends at 5 s; correct the trim"):
        load_sound(path, 2, trim=(1.0, 5.0))


def test_recordings_are_voices(folder: Path, tmp_path: Path) -> None:
    lock = tmp_path / "assets.lock.yaml"
    run("import", "folder", folder, "--index", tmp_path / "index.csv", "--lock", lock)
    (voice,) = recorded_voices(lock, "clock")
    assert (voice.name, voice.split, voice.kind) == ("folder/mine/a/tick", "test", "recorded")
    assert "by Bo, CC-BY-SA-4.0" in voice.source
    first, again, other = (voice.play(3 * SR, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (3 * SR,)
    assert first.dtype == np.float64
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert [one.name for one in recorded_voices(lock, "microwave")] == ["folder/mine/hum"]
    assert recorded_voices(lock, "toilet") == ()


def test_committed_manifests_play_recordings_of_their_own_split() -> None:
    """Recordings of train.yaml are for training, of the *-tune manifests for validation, of all others for tests; no
    recording in the lock file lacks a split or is of two. tests/generators/test_sampling.py has the same of voices."""
    lock = read_lock(MANIFESTS / "assets.lock.yaml")
    assert all((entry.split is not None) == (entry.kind == "sound") for entry in lock.assets)
    named = 0
    for path in sorted(MANIFESTS.glob("*.yaml")):
        if path.name == "assets.lock.yaml":
            continue
        manifest = read_manifest(path).manifest
        split = "train" if path.stem == "train" else "validation" if path.stem.endswith("-tune") else "test"
        for category, items in manifest.sounds.items():
            for item in items:
                entry = lock.find(item.asset or "")
                assert entry is not None, f"{path.name}: {item.asset}"
                assert (entry.category, entry.split) == (category, split), f"{path.name}: {entry.id}"
                named += 1
    assert named >= 20


def test_every_category_has_six_recordings_some_for_training_and_two_have_all_splits() -> None:
    sounds = [entry for entry in read_lock(MANIFESTS / "assets.lock.yaml").assets if entry.kind == "sound"]
    splits = {name: [entry.split for entry in sounds if entry.category == name] for name in CATEGORIES}
    assert all("train" in found and len(found) >= 6 for found in splits.values()), splits
    for found in (splits["clock"], splits["telephone"]):
        assert set(found) == {"train", "validation", "test"}
    # Whoever made one for tests made none for training.
    makers = {split: {entry.author for entry in sounds if entry.split == split} for split in ("train", "test")}
    assert not makers["train"] & makers["test"]
    assert len({entry.sha256 for entry in sounds}) == len(sounds), "the same file under two names"


@pytest.mark.parametrize("name", SOURCES)
def test_the_recorded_manifests_follow_from_the_others(name: str) -> None:
    """If this fails, run: python -m benchmarks.recorded_manifests"""
    text = (MANIFESTS / f"{name}.yaml").read_text()
    made = recorded(text, read_lock(MANIFESTS / "assets.lock.yaml").assets)
    path = MANIFESTS / f"{name}-recorded.yaml"
    assert path.read_text() == made
    own, other = (read_manifest(MANIFESTS / f"{one}.yaml").manifest for one in (name, f"{name}-recorded"))
    assert own.observations == other.observations
    assert own.scans == other.scans
    heard = {category for entry in other.observations for category in entry.heard}
    assert heard <= {*other.sounds, *other.voices, *other.categories}
    assert not re.search(r"(?m)^(voices|sounds):(.|\n)*^(voices|sounds):(.|\n)*^(voices|sounds):", made)


def test_the_training_manifest_plays_the_recordings_of_the_store_and_its_voices_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    own = read_manifest(MANIFESTS / "train.yaml").manifest
    without = read_manifest(write_training(tmp_path)).manifest
    assert (without.voices, without.sounds) == (own.voices, {})
    monkeypatch.setattr(Store, "problem", lambda _, entry: "" if entry.category == "clock" else "missing")
    played = read_manifest(write_training(tmp_path)).manifest
    lock = read_lock(MANIFESTS / "assets.lock.yaml")
    found = [lock.find(item.asset or "") for item in played.sounds["clock"]]
    assert {entry.split for entry in found if entry is not None} == {"train"}
    assert set(played.sounds) == {"clock"}
    assert played.voices == {name: names for name, names in own.voices.items() if name != "clock"}
    assert (played.observations, played.scans, played.seed) == (own.observations, own.scans, own.seed)


# ---- poor recordings ------------------------------------------------------------------------------------------------


def poor(kind: str, path: Path) -> None:
    """Write a recording of the table in docs/assets.md."""
    if kind == "8 kHz":
        soundfile.write(path, noise(2, 8000), 8000)
    elif kind == "24 bit":
        soundfile.write(path, noise(2), SR, subtype="PCM_24")
    elif kind == "stereo":
        soundfile.write(path, np.stack([noise(2), 0 * noise(2)], axis=1), SR)
    elif kind == "0.2 s":
        soundfile.write(path, noise(0.2), SR)
    elif kind == "silence":
        soundfile.write(path, np.zeros(2 * SR), SR)
    elif kind == "opposite channels":
        soundfile.write(path, np.stack([noise(2), -noise(2)], axis=1), SR)
    elif kind == "truncated":
        soundfile.write(path, noise(2), SR)
        path.write_bytes(path.read_bytes()[:-2000])
    elif kind == "NaN":
        soundfile.write(path, np.append(noise(2), np.nan), SR, subtype="FLOAT")
    else:
        soundfile.write(path, np.clip(20 * noise(2), -1, 1), SR)


@pytest.mark.parametrize(
    ("kind", "words", "kept"),
    [
        ("8 kHz", "its 8000 Hz hold nothing above 4 kHz", True),
        ("24 bit", "", True),
        ("stereo", "", True),
        ("0.2 s", "lasts 0.20 s; expected at least 0.5 s; choose another recording", False),
        ("silence", "is silent (peak 0 in the mean of its channels); choose another recording", False),
        ("opposite channels", "e-05 in the mean of its channels); choose another recording", False),
        ("truncated", "truncated, 2000 bytes of its samples are missing; fetch or copy it again", False),
        ("NaN", "has samples that are NaN or infinite", False),
        ("clipped", "of its samples are clipped, and will sound so", True),
    ],
)
def test_a_poor_recording_has_one_line_or_a_meaning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, words: str, kept: bool
) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    path, lock = tmp_path / "a.wav", tmp_path / "assets.lock.yaml"
    poor(kind, path)
    done = run("import", "folder", path, "--category", "clock", *CREDIT, "--lock", lock)
    lines = [line for line in done.output.splitlines() if "folder/" in line and "by Ann" not in line]
    assert len(lines) == bool(words), done.output
    assert all(words in line for line in lines)
    assert (done.exit_code == 0, lock.exists()) == (kept, kept)
    if kept:
        assert load_sound(path, 3).shape == (3 * SR,)


def test_a_licence_against_derivatives_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    soundfile.write(tmp_path / "a.wav", noise(1), SR)
    words = ("--category", "clock", "--licence", "CC BY-ND 4.0", "--author", "Ann")
    done = run("import", "folder", tmp_path / "a.wav", *words, "--lock", tmp_path / "l.yaml")
    assert done.exit_code == 1
    assert "CC-BY-ND-4.0 forbids adaptations, and a rendered or mixed asset is one" in done.output


@pytest.mark.slow
def test_three_hours_are_read_where_they_are_needed(tmp_path: Path) -> None:
    rate, length, path = 8000, 3 * 3600, tmp_path / "long.wav"
    size = 2 * length * rate
    riff = struct.pack(
        "<4sI8sIHHIIHH4sI", b"RIFF", 36 + size, b"WAVEfmt ", 16, 1, 1, rate, 2 * rate, 2, 16, b"data", size
    )
    with path.open("w+b") as file:
        file.write(riff)
        file.truncate(44 + size)  # zeros that take no room on the disk
        file.seek(44 + length * rate)
        file.write((noise(20, rate) * 32767).astype("<i2").tobytes())
    soundfile.write(tmp_path / "half.flac", noise(1800, rate), rate)
    assert recorded_seconds(path) == length
    tracemalloc.start()
    try:
        source = load_sound(path, 10, start=0.5)
        half = survey(tmp_path / "half.flac")
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert source.shape == (10 * SR,)
    assert half.seconds == 1800
    assert most < 50e6, "the samples are 170 MB, those of half an hour 58 MB"
    with pytest.raises(Avs3dError, match=r"loops are of at most 900 s: give it a trim"):
        load_sound(path, 10, start=0.9999)
    assert load_sound(path, 10, start=0.9999, trim=(5399, 5699)).shape == (10 * SR,)
