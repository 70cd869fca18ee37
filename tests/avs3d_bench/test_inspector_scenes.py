"""The viewer on part_3 observations: lanes, stems, siblings, colours; gallery, contact sheet, film and 3D view."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import soundfile

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import BackgroundRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.geometry import direction_to
from avs3d_bench.inspector import pictures, sound
from avs3d_bench.inspector.build import build_site
from avs3d_bench.inspector.contact_sheet import draw_contact_sheet
from avs3d_bench.inspector.facts import read_facts
from avs3d_bench.inspector.live import LiveSite
from avs3d_bench.inspector.site import NotThereError, ObservationSite
from avs3d_bench.inspector.sources import (
    SOURCE_COLOURS,
    find_siblings,
    instance_colours,
    read_sound,
    sound_kinds,
    sound_title,
    source_colours,
    stem_levels,
)
from avs3d_bench.inspector.submissions import ShownSubmission, open_submissions
from avs3d_bench.submission import SubmissionWriter
from tests.avs3d_bench.test_inspector import drawn, layers, player, until
from tests.support import tiny, tiny_scenes
from tests.support.browser import launch, visit
from tests.support.shared import SharedDataset
from tests.support.tiers import some
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, GROUP, SECOND, SILENT
from tests.support.viewing import served

TITLES = {
    FIRST: "microwave #1",
    SECOND: "microwave #3",
    BOTH: "3 sources",
    SILENT: "silence",
    AWAY: "telephone, off-screen",
}


@pytest.fixture(scope="module")
def root(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(stems=True)


@pytest.fixture(scope="module")
def site(root: Path) -> Path:
    dataset = Dataset(root)
    return build_site(dataset, dataset.keys, (), root.parent / "site", workers=1).folder


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launch() as found:
        yield found


def data_of(page: bytes) -> Any:
    match = re.search(r'id="data">(.*?)</script>', page.decode(), re.DOTALL)
    assert match
    return json.loads(match.group(1))


def copied(root: Path, target: Path) -> Path:
    return Path(shutil.copytree(root, target))


# ---- what is shown ----------------------------------------------------------------------------------------------


def test_titles_say_what_sounds(root: Path) -> None:
    records = {observation.key: observation.record for observation in Dataset(root)}
    assert {key: sound_title(record) for key, record in records.items() if record} == TITLES
    kinds = {key: sound_kinds(record) for key, record in records.items() if record}
    assert kinds[FIRST] == ("one",)
    assert kinds[BOTH] == ("several", "background")
    assert kinds[SILENT] == ("silence",)
    assert kinds[AWAY] == ("one", "off-screen", "background")


def test_room_tone_is_silence_and_noise_is_not(root: Path) -> None:
    record = Dataset(root)[SILENT].record
    assert record is not None
    for kind, title in (("room_tone", "silence, room tone"), ("noise", "noise alone")):
        background = BackgroundRecord(kind=kind, snr_db=20.0, level_db=-50.0)
        assert sound_title(record.model_copy(update={"background": background})) == title


def test_an_instance_has_one_colour_in_all_siblings_and_no_two_sources_share_one(root: Path) -> None:
    records = [observation.record for observation in Dataset(root)]
    colours = [instance_colours(record) for record in records if record]
    assert all(each == colours[0] for each in colours)
    for record in records:
        assert record is not None
        of_sources = source_colours(record)
        assert len(set(of_sources.values())) == len(of_sources) <= len(SOURCE_COLOURS)
        for source in record.sources or ():
            if source.instance is not None:
                assert of_sources[source.id] == colours[0][source.instance]
            else:
                assert of_sources[source.id] not in colours[0].values()


def test_lanes_are_those_of_the_record(root: Path) -> None:
    observation = Dataset(root)[BOTH]
    scene, record = read_sound(observation), observation.record
    assert scene is not None
    assert record is not None
    first, second, third = scene.sources
    assert (first.name, second.name, third.name) == ("microwave #1", "microwave #3", "telephone")
    assert (first.programme, third.programme) == ("0–2 s, 4.5–6 s", "always")
    assert third.spans == ((0.0, 10.0),)
    for number, (frame, entry) in enumerate(zip(observation.frames, record.frames, strict=True)):
        assert [s.record.id for s in scene.audible(number)] == [heard.source for heard in entry.audible or ()]
        for source in scene.sources:
            direction = direction_to(frame.pose, source.record.position)
            assert source.azimuth[number] == pytest.approx(direction.azimuth)
            assert source.distance[number] == pytest.approx(direction.distance)


def test_levels_of_stems_are_those_of_the_record_and_silence_has_none(root: Path) -> None:
    observation = Dataset(root)[BOTH]
    scene = read_sound(observation)
    assert scene is not None
    levels, problems = stem_levels(observation, scene)
    assert list(levels) == ["source_1", "source_2", "source_3", "background"]
    for source in scene.sources:
        for number, heard in enumerate(source.heard):
            if heard is not None:
                assert levels[source.record.id][number] == pytest.approx(heard.level_db, abs=0.01)
    assert levels["source_1"][3] is None, "its programme has a gap there"
    assert levels["background"][5] == pytest.approx(observation.record.background.level_db, abs=0.2)
    assert not problems


def test_tracks_of_the_stems_add_up_to_the_track(root: Path) -> None:
    observation = Dataset(root)[BOTH]

    def heard(track: sound.Track) -> Any:
        samples, _ = soundfile.read(io.BytesIO(track.data), dtype="float64", always_2d=True)
        return samples / 10 ** (track.gain / 20)

    scene = read_sound(observation)
    assert scene is not None
    total = sum(heard(sound.read_stem_track(observation, name)) for name in scene.stem_names)
    np.testing.assert_allclose(total, heard(sound.read_track(observation)), atol=5 * 0.51 / 2**15)


def test_a_mask_of_several_instances_has_their_colours() -> None:
    ids = np.array([[0, 1, 2], [3, 1, 9]], dtype=np.uint16)
    mask = np.array([[False, True, False], [True, True, True]])
    colours = {1: (10, 20, 30), 2: (40, 50, 60), 3: (70, 80, 90)}
    picture = cv2.imdecode(np.frombuffer(pictures.audible_png(mask, ids, colours), np.uint8), cv2.IMREAD_UNCHANGED)
    assert (picture[..., 3] > 0).tolist() == mask.tolist()
    assert [tuple(picture[at][2::-1]) for at in ((0, 1), (1, 0), (1, 1))] == [colours[1], colours[3], colours[1]]
    assert tuple(picture[1, 2][:3]) == (255, 255, 255), "an unknown instance is not hidden"
    with pytest.raises(Avs3dError, match=r"\(1, 3\)"):
        pictures.audible_png(mask[:1], ids, colours)


def test_siblings_are_those_of_the_group_that_the_site_has(root: Path, tmp_path: Path) -> None:
    dataset = Dataset(root)
    found = find_siblings(dataset, dataset.keys, dataset[BOTH])
    assert [(sibling.key, sibling.title) for sibling in found] == list(TITLES.items())
    assert [s.key for s in find_siblings(dataset, [FIRST, BOTH], dataset[BOTH])] == [FIRST, BOTH]
    assert find_siblings(dataset, [BOTH], dataset[BOTH]) == ()
    copy = copied(root, tmp_path / "copy")
    (copy / SECOND / layout.OBSERVATION_JSON).write_text("{}")
    dataset = Dataset(copy)
    assert [s.key for s in find_siblings(dataset, dataset.keys, dataset[BOTH])] == [k for k in GROUP if k != SECOND]


def test_a_sibling_that_is_a_link_out_of_the_dataset_is_not_read(root: Path, tmp_path: Path) -> None:
    copy = copied(root, tmp_path / "copy")
    path = copy / SECOND / layout.OBSERVATION_JSON
    path.rename(tmp_path / "elsewhere.json")
    path.symlink_to(tmp_path / "elsewhere.json")
    dataset = Dataset(copy)
    assert SECOND not in [sibling.key for sibling in find_siblings(dataset, dataset.keys, dataset[BOTH])]


def test_a_stem_that_is_a_link_out_of_the_dataset_is_refused(root: Path, tmp_path: Path) -> None:
    copy = copied(root, tmp_path / "copy")
    path = copy / BOTH / layout.stem_path("source_2", 1)
    path.rename(tmp_path / "elsewhere.wav")
    path.symlink_to(tmp_path / "elsewhere.wav")
    card = ObservationSite(Dataset(copy), BOTH, ()).card()
    assert "stems/source_2/frame_1.wav: a symbolic link" in (card.problem or "")


# ---- pages ------------------------------------------------------------------------------------------------------


def test_the_page_gives_the_scripts_what_the_lanes_show(site: Path, root: Path) -> None:
    data = data_of((site / BOTH / "index.html").read_bytes())
    scene = data["scene"]
    assert [source["name"] for source in scene["sources"]] == ["microwave #1", "microwave #3", "telephone"]
    record = Dataset(root)[BOTH].record
    assert record is not None
    for source in scene["sources"]:
        audible = [int(source["id"] in [e.source for e in frame.audible or ()]) for frame in record.frames]
        assert source["audible"] == audible
        assert len(source["levels"]) == len(source["azimuth"]) == len(record.frames)
    assert scene["background"]["snr"] == 20.0
    assert scene["siblings"] == [{"key": key, "folder": f"../{key[-1]}/"} for key in GROUP]
    away = data_of((site / AWAY / "index.html").read_bytes())["scene"]["sources"][0]
    assert (away["room"], away["instance"]) == ("living room", None)
    silent = data_of((site / SILENT / "index.html").read_bytes())
    assert silent["scene"]["sources"] == []
    assert not any("level" in frame or "azimuth" in frame for frame in silent["frames"]), "silence has no level"


def test_licences_of_the_sources_are_listed(root: Path) -> None:
    dataset = Dataset(root)
    assert [entry.asset for entry in read_facts(dataset, dataset[FIRST]).licences] == ["box", "noise"]
    assert [entry.asset for entry in read_facts(dataset, dataset[SILENT]).licences] == ["box"]


def test_the_script_of_a_sibling_holds_its_own_page(site: Path) -> None:
    for key in GROUP:
        text = (site / key / "scene.js").read_text(encoding="utf-8")
        payload = json.loads(text.removeprefix("window.AVS3D.sibling(").removesuffix(");\n"))
        assert payload["data"] == data_of((site / key / "index.html").read_bytes())
        assert payload["heading"].lower() == TITLES[key]
        assert payload["facts"].strip() in (site / key / "index.html").read_text(encoding="utf-8")
    assert "<" not in text.partition("(")[2], "nothing in it can end a script element"


def test_the_server_makes_the_files_of_the_site_on_disk(root: Path, site: Path) -> None:
    dataset = Dataset(root)
    live = LiveSite(dataset, dataset.keys, ())
    files = sorted(path.relative_to(site / BOTH).as_posix() for path in (site / BOTH).rglob("*") if path.is_file())
    assert {"scene.js", "stems/source_1.js", "stems/background.js"} <= set(files)
    for name in files:
        if name not in ("index.html", "scene.js"):  # the served ones link to the dataset's own pictures
            assert live.read(f"{BOTH}/{name}") == (site / BOTH / name).read_bytes(), name
    for name in ("stems/source_9.js", "stems/background.wav", "stems/../observation.json"):
        with pytest.raises(NotThereError):
            live.read(f"{BOTH}/{name}")
    with pytest.raises(NotThereError):
        live.read(f"{FIRST}/stems/background.js")


def test_an_older_site_of_part_3_is_replaced(root: Path, site: Path, tmp_path: Path) -> None:
    shutil.copytree(site, tmp_path / "site")
    built = build_site(Dataset(root), [SILENT], (), tmp_path / "site", workers=1)
    assert (built.pages, built.problems) == (1, ())
    assert not (tmp_path / "site" / BOTH).exists()


def test_a_damaged_stem_is_named_and_the_rest_is_shown(root: Path, tmp_path: Path) -> None:
    copy = copied(root, tmp_path / "copy")
    tiny.replace(copy / BOTH / layout.stem_path("source_2", 4), b"RIFF")
    built = build_site(Dataset(copy), [BOTH], (), tmp_path / "site", workers=1)
    assert len(built.problems) == 1
    assert "stems/source_2/frame_4.wav" in built.problems[0]
    page = (tmp_path / "site" / BOTH / "index.html").read_text(encoding="utf-8")
    assert "stems/source_2/frame_4.wav" in page
    assert str(copy) not in page


def test_a_fifo_among_the_stems_does_not_hang_the_server(root: Path, tmp_path: Path) -> None:
    copy = copied(root, tmp_path / "copy")
    path = copy / BOTH / layout.stem_path("background", 0)
    path.unlink()
    os.mkfifo(path)
    dataset = Dataset(copy)
    live = LiveSite(dataset, dataset.keys, ())
    assert "stems/background/frame_0.wav" in live.read(f"{BOTH}/index.html").decode()
    assert live.read(f"{BOTH}/stems/background.js").startswith(b"window.AVS3D.stem(")


def test_a_file_in_the_place_of_the_stems_is_as_if_there_were_none(root: Path, tmp_path: Path) -> None:
    copy = copied(root, tmp_path / "copy")
    shutil.rmtree(copy / BOTH / layout.STEMS)
    (copy / BOTH / layout.STEMS).write_bytes(b"")
    site = ObservationSite(Dataset(copy), BOTH, ())
    assert site.card().problem is None
    assert site.stem_files == ()


@pytest.fixture(scope="module")
def right(root: Path) -> tuple[ShownSubmission, ...]:
    """A submission that is right everywhere."""
    dataset, folder = Dataset(root), root.parent / "right"
    with SubmissionWriter(folder, dataset, method="right") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    return open_submissions(dataset, [folder])


def test_submissions_agree_with_the_union_of_the_audible_instances(
    root: Path, right: tuple[ShownSubmission, ...]
) -> None:
    (agreements,) = ObservationSite(Dataset(root), BOTH, right).agreements.values()
    assert len(agreements) == 2
    assert {agreement.iou for agreement in agreements.values()} <= {1.0, None}


# ---- the other views --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", some([BOTH, SILENT, AWAY], every=3))
def test_a_contact_sheet_says_who_is_audible(root: Path, key: str) -> None:
    figure = draw_contact_sheet(Dataset(root), key, columns=4)
    texts = [
        text.get_text()
        for half in figure.subfigs
        for axes in half.get_axes() or [a for sub in half.subfigs for a in sub.get_axes()]
        for text in (
            *axes.texts,
            *axes.get_yticklabels(),
            *(axes.get_legend().get_texts() if axes.get_legend() else ()),
        )
    ]
    if key == SILENT:
        assert texts.count("silence") == 4
    elif key == AWAY:
        assert "telephone, living room (off-screen)" in texts
        assert texts.count("\N{BLACK CIRCLE} telephone, living room") == 4
    else:
        assert "\N{BLACK CIRCLE} microwave #3" in texts
        assert {"microwave #1", "microwave #3", "telephone"} <= set(texts)


def near(picture: Any, colour: tuple[int, int, int]) -> Any:
    return np.abs(picture.astype(int) - colour).max(axis=2) < 12


def test_a_film_marks_each_audible_source_in_its_colour(root: Path) -> None:
    pytest.importorskip("av")
    from avs3d_bench.inspector.video import _audible
    from avs3d_bench.inspector.video_drawing import TRUTH, Canvas, Shown

    dataset = Dataset(root)
    observation = dataset[BOTH]
    facts = read_facts(dataset, observation)
    assert facts.lanes is not None
    for number in (0, 3):
        frame = observation.frames[number]
        audible = _audible(frame, facts, number, marked=True)
        assert audible is not None
        names = [source.name for source in audible]
        assert names == [source.name for source in facts.lanes.audible(number)]
        union = np.any([source.mask for source in audible if source.mask is not None], axis=0)
        assert (union == frame.mask()).all()
        canvas = Canvas.of(frame.rgb().shape, 960)
        shown = Shown(
            rgb=np.zeros_like(frame.rgb()), truth=None, predicted=None, moment=facts.moments[number], title=BOTH,
            what="", loudness=None, audible=audible,
        )  # fmt: skip
        picture = canvas.draw(shown, "outline")[: canvas.picture]
        picture[:170, :400] = 0  # the legend
        for source in facts.lanes.sources:
            visible = source.record.instance in np.unique(frame.instance_ids()[frame.mask()])
            assert near(picture, source.colour).any() == visible
        assert near(canvas.draw(shown, "none")[:170, :400], facts.lanes.sources[2].colour).any(), "the legend"
    silent = canvas.draw(Shown(**{**shown.__dict__, "audible": ()}), "tint")
    assert not any(near(silent, colour).any() for colour in (*SOURCE_COLOURS, TRUTH))


@pytest.mark.parametrize("key", some([BOTH, SILENT, AWAY], every=3))
def test_a_film_of_a_part_3_is_written(root: Path, tmp_path: Path, key: str) -> None:
    pytest.importorskip("av")
    from avs3d_bench.inspector.video import write_video

    film = write_video(Dataset(root), key, tmp_path / "f.mp4", size=64, with_map=True)
    assert film.frames == tiny.FRAMES


def test_the_map_of_a_film_shows_a_source_of_another_room_at_its_border(root: Path) -> None:
    from avs3d_bench.inspector.floor_map import MapInset

    dataset = Dataset(root)
    facts = read_facts(dataset, dataset[AWAY])
    inset = MapInset.of(dataset[AWAY], facts, 720)
    assert inset is not None
    assert facts.lanes is not None
    marked = np.argwhere(near(inset.draw(0), facts.lanes.sources[0].colour))
    assert len(marked)
    assert marked[:, 1].mean() < 0.2 * inset.draw(0).shape[1], "it is to the left of the room"
    both = read_facts(dataset, dataset[BOTH])
    assert MapInset.of(dataset[BOTH], both, 720).drawing.bounds == inset.drawing.bounds, "siblings have one map"  # type: ignore[union-attr]


def test_the_3d_view_has_all_sources_and_says_which_are_audible(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    from avs3d_bench.inspector.view3d import save_view
    from avs3d_bench.inspector.view3d_data import read_scene
    from tests.avs3d_bench.test_view3d import contents

    dataset = Dataset(root)
    data = contents(save_view(dataset, BOTH, tmp_path / "v.viser"))
    nodes = {message["name"] for _, message in data["messages"] if "name" in message}
    assert {f"/sources/source_{number}" for number in (1, 2, 3)} <= nodes
    assert {f"/object/mesh/{number}" for number in (1, 2, 3)} <= nodes
    captions = [moment.caption for moment in read_scene(dataset[BOTH]).frames]
    assert captions[0].endswith("microwave #1, telephone")
    assert captions[3].endswith("microwave #3, telephone")
    assert read_scene(dataset[SILENT]).frames[0].caption.endswith("silence")
    away = contents(save_view(dataset, AWAY, tmp_path / "a.viser"))
    texts = {message["props"]["text"] for _, message in away["messages"] if "text" in message.get("props", {})}
    assert "telephone, living room (off-screen)" in texts
    save_view(dataset, SILENT, tmp_path / "s.viser")


# ---- in the browser ---------------------------------------------------------------------------------------------


def cards(page: Any) -> list[str]:
    found: list[str] = page.eval_on_selector_all("#gallery > li:not([hidden]) b", "all => all.map(e => e.textContent)")
    return found


def test_the_gallery_says_what_sounds_and_filters_by_it(site: Path, browser: Any) -> None:
    with visit(browser, site / "index.html") as opened:
        page = opened.page
        assert cards(page) == ["Microwave #1", "Microwave #3", "3 sources", "Silence", "Telephone, off-screen"]
        assert page.locator(".tag", has_text="group of 5").count() == 5
        assert "Part 3, several sources" in page.text_content("#filters")
        for value, expected in (
            ("category=telephone", ["3 sources", "Telephone, off-screen"]),
            ("category=_nothing", ["Silence"]),
            ("scene=off-screen", ["Telephone, off-screen"]),
            ("scene=several,silence", ["3 sources", "Silence"]),
            ("q=off-screen", ["Telephone, off-screen"]),
        ):
            page.evaluate("hash => { location.hash = hash; }", value)
            page.wait_for_timeout(80)
            assert cards(page) == expected, value
        assert not opened.said


def test_a_category_of_the_manifest_is_a_filter(root: Path, tmp_path: Path, browser: Any) -> None:
    copy = copied(root, tmp_path / "copy")
    path = copy / FIRST / layout.OBSERVATION_JSON
    data = json.loads(path.read_text())
    data |= {"categories": ["hair_dryer"], "category": "hair_dryer"}
    data["instances"][0]["category"] = data["sources"][0]["category"] = "hair_dryer"
    path.write_text(json.dumps(data))
    site = build_site(Dataset(copy), GROUP, (), tmp_path / "site", workers=1).folder
    with visit(browser, site / "index.html") as opened:
        opened.page.check("input[value=hair_dryer]", force=True)
        assert cards(opened.page) == ["Hair dryer"]


@pytest.mark.slow
def test_lanes_have_buttons_only_where_there_are_stems_and_a_reason_elsewhere(
    site: Path, tmp_path: Path, browser: Any
) -> None:
    with player(browser, (site / BOTH / "index.html").as_uri()) as (page, said, asked):
        assert page.locator(".lane").count() == 4
        assert page.locator(".lane button").count() == 8
        assert page.locator(".lane svg .span").count() == 2 + 2 + 1 + 1
        labels = page.eval_on_selector_all(".lane svg", "all => all.map(e => e.getAttribute('aria-label'))")
        assert labels[0].startswith("microwave #1: 0–2 s, 4.5–6 s; audible in ")
        assert page.locator("[data-lane=source_1] .heard").count() == 4
        assert not any("stems/" in address for address in asked), "stems are loaded when they are asked for"
        page.locator("[data-lane=source_2] svg").click(position={"x": 5, "y": 5})
        drawn(page, 0)
        assert not said
    plain = tiny_scenes.write_part_3(tmp_path / "plain")
    folder = build_site(Dataset(plain), [FIRST, SILENT], (), tmp_path / "site", workers=1).folder
    with player(browser, (folder / FIRST / "index.html").as_uri()) as (page, said, _):
        assert page.locator(".lane").count() == 1
        assert page.locator(".lane button").count() == 0
        assert "--with stems" in page.get_attribute(".why", "title")
        assert not said
    with player(browser, (folder / SILENT / "index.html").as_uri()) as (page, said, _):
        assert page.locator(".lane").count() == 0
        assert "nothing sounds" in page.text_content("#lanes")
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 0.3")
        assert not said


TAP = """() => {
  const connect = AudioNode.prototype.connect;
  AudioNode.prototype.connect = function (to, ...rest) {
    if (to === this.context.destination) {
      window.tap = this.context.createAnalyser();
      window.tap.fftSize = 8192;
      window.tap.smoothingTimeConstant = 0;
      connect.call(this, window.tap);
    }
    return connect.call(this, to, ...rest);
  };
}"""
#: RMS of what the page plays now, averaged over a few looks.
LOUD = """async () => {
  const samples = new Float32Array(8192);
  let power = 0;
  for (let k = 0; k < 4; k += 1) {
    await new Promise((done) => setTimeout(done, 60));
    window.tap.getFloatTimeDomainData(samples);
    power += samples.reduce((sum, v) => sum + v * v, 0) / samples.length / 4;
  }
  return Math.sqrt(power);
}"""


@pytest.fixture(scope="module")
def opposed(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site whose first two stems are noise and the same noise negated; the third is a quiet tone.

    Played together, the first two cancel, if and only if both are at the same sample.
    """
    copy = copied(root, tmp_path_factory.mktemp("opposed") / "tiny")
    seconds = np.arange(layout.SAMPLE_RATE) / layout.SAMPLE_RATE
    tone = np.tile(0.01 * np.sin(2 * np.pi * 441 * seconds), (2, 1))
    for k in range(tiny.FRAMES):
        noise = np.tile(np.random.default_rng(k).uniform(-0.4, 0.4, layout.SAMPLE_RATE), (2, 1))
        for name, clip in (("source_1", noise), ("source_2", -noise), ("source_3", tone), ("background", 0 * noise)):
            path = copy / BOTH / layout.stem_path(name, k)
            path.unlink()
            media.write_wav(path, clip.astype(np.float32))
    return build_site(Dataset(copy), GROUP, (), copy.parent / "site", workers=1).folder


@pytest.mark.slow
def test_stems_are_played_at_the_same_sample_also_from_disk(opposed: Path, browser: Any) -> None:
    with player(browser, (opposed / BOTH / "index.html").as_uri()) as (page, said, _):
        page.evaluate(TAP)
        gain = 10 ** (data_of((opposed / BOTH / "index.html").read_bytes())["scene"]["gain"] / 20)
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 0.2")
        page.click("[data-lane=background] [data-kind=mute]")
        until(page, "Boolean(document.getElementById('stage').dataset.stems)")
        assert page.evaluate("document.getElementById('sound').paused")
        page.wait_for_timeout(200)
        assert page.evaluate(LOUD) == pytest.approx(gain * 0.01 / np.sqrt(2), rel=0.1), "noise and its negative cancel"
        page.click("[data-lane=source_2] [data-kind=mute]")
        page.wait_for_timeout(200)
        assert page.evaluate(LOUD) == pytest.approx(gain * 0.4 / np.sqrt(3), rel=0.1)
        page.click("[data-lane=source_3] [data-kind=solo]")
        page.wait_for_timeout(200)
        assert page.evaluate(LOUD) == pytest.approx(gain * 0.01 / np.sqrt(2), rel=0.1)
        assert page.get_attribute("[data-lane=source_3] [data-kind=solo]", "aria-pressed") == "true"
        assert "off" in page.get_attribute("[data-lane=source_1]", "class")
        # The picture follows the stems; a jump moves them, and the end stops them.
        page.eval_on_selector("#scrub", "e => { e.value = 8.5; e.dispatchEvent(new Event('input')); }")
        until(page, "document.getElementById('stage').dataset.index === '9'")
        until(page, "!document.getElementById('stage').classList.contains('playing')")
        assert not said


def test_siblings_change_the_sound_and_the_truth_and_keep_the_picture(root: Path, browser: Any) -> None:
    with served(root) as server, player(browser, f"{server.url}{FIRST}/index.html#frame_002") as (page, said, asked):
        drawn(page, 2)
        page.keyboard.press("m")
        layers(page, "frame mask")
        pixels = "document.getElementById('screen').toDataURL()"
        before, frames = page.evaluate(pixels), sum("/frames/" in address for address in asked)
        page.keyboard.press("g")
        until(page, "document.getElementById('key').textContent.endsWith('/2')")
        until(page, "document.getElementById('sound').readyState > 0")
        layers(page, "frame mask")
        assert page.url == f"{server.url}{SECOND}/index.html#frame_002"
        assert page.text_content("#heading") == "Microwave #3"
        assert page.text_content(".siblings [aria-current]").strip().endswith("microwave #3")
        assert page.get_attribute("#stage", "data-index") == "2"
        assert page.evaluate("document.getElementById('sound').currentTime") == pytest.approx(2.0, abs=0.02)
        assert f"{server.url}{SECOND}/masks/frame_002.png" in asked
        assert sum("/frames/" in address for address in asked) == frames, "no picture is loaded again"
        until(page, f"{pixels} !== {json.dumps(before)}")
        assert page.text_content(".lane b") == "microwave #3"
        assert "source_1" in page.text_content("#facts")
        assert "microwave #3" in page.text_content("#facts")
        page.keyboard.press("Shift+G")
        until(page, "document.getElementById('key').textContent.endsWith('/1')")
        until(page, f"{pixels} === {json.dumps(before)}")
        page.keyboard.press("Shift+G")
        until(page, "document.getElementById('key').textContent.endsWith('/5')")
        assert page.get_attribute("a[rel=prev]", "href").endswith(f"{SILENT}/index.html")
        assert page.locator("a[rel=next]").count() == 0
        page.reload()
        until(page, "Boolean(document.getElementById('screen').dataset.frame)")
        assert page.text_content("#heading") == "Telephone, off-screen"
        assert not said


def test_predictions_are_those_of_the_sibling(root: Path, right: tuple[ShownSubmission, ...], browser: Any) -> None:
    with served(root, right) as server, player(browser, f"{server.url}{FIRST}/index.html") as (page, said, asked):
        page.keyboard.press("1")
        page.keyboard.press("e")
        layers(page, "frame mask prediction")
        assert page.text_content(".submission small") == "IoU 1.00"
        page.keyboard.press("g")
        until(page, "document.getElementById('key').textContent.endsWith('/2')")
        layers(page, "frame mask prediction")
        assert f"{server.url}{SECOND}/predictions/1/frame_000.png" in asked
        page.click(f"a[data-key='{SILENT}']")
        until(page, "document.getElementById('key').textContent.endsWith('/4')")
        assert page.text_content(".submission small") == "", "where nothing is marked, there is no IoU"
        assert not said


def test_a_sibling_goes_on_playing_where_the_one_before_was(site: Path, browser: Any) -> None:
    with player(browser, (site / FIRST / "index.html").as_uri()) as (page, said, _):
        page.click("#play")
        until(page, "document.getElementById('sound').currentTime > 1.2")
        page.click(f"a[data-key='{BOTH}']")
        until(page, "document.getElementById('key').textContent.endsWith('/3')")
        until(page, "document.getElementById('sound').src.includes('/3/sound.flac')")
        until(page, "document.getElementById('sound').currentTime > 1.6")
        assert page.evaluate("document.getElementById('stage').classList.contains('playing')")
        assert page.locator(".lane").count() == 4
        # Its stems are its own: they are loaded from its folder.
        page.click("[data-lane=source_1] [data-kind=solo]")
        until(page, f"document.getElementById('stage').dataset.stems === '{BOTH}'")
        # And gone with it: the next sibling plays its whole track.
        page.click(f"a[data-key='{SECOND}']")
        until(page, "document.getElementById('sound').src.includes('/2/sound.flac')")
        until(page, "!document.getElementById('sound').paused && document.getElementById('sound').currentTime > 1.6")
        assert page.get_attribute("#stage", "data-stems") is None
        assert not said


def test_a_choice_made_while_other_stems_are_loading_is_kept(site: Path, browser: Any) -> None:
    with player(browser, (site / BOTH / "index.html").as_uri()) as (page, said, _):
        page.hover(f"a[data-key='{AWAY}']")
        until(page, "document.scripts.length > 0")
        page.wait_for_timeout(300)
        page.evaluate(
            """(key) => {
              document.querySelector('[data-lane=source_1] [data-kind=solo]').click();
              document.querySelector(`a[data-key='${key}']`).click();
            }""",
            AWAY,
        )
        until(page, "document.getElementById('key').textContent.endsWith('/5')")
        page.click("[data-lane=background] [data-kind=mute]")
        until(page, f"document.getElementById('stage').dataset.stems === '{AWAY}'")
        assert page.get_attribute("[data-lane=background] [data-kind=mute]", "aria-pressed") == "true"
        assert not said


def test_text_of_a_sibling_is_text(root: Path, tmp_path: Path, browser: Any) -> None:
    copy = copied(root, tmp_path / "copy")
    path = copy / SECOND / layout.OBSERVATION_JSON
    evil = "</script><img src=x onerror=alert(1)>"
    data = json.loads(path.read_text())
    data["sources"][0]["asset"] = evil
    path.write_text(json.dumps(data))
    folder = build_site(Dataset(copy), [FIRST, SECOND], (), tmp_path / "site", workers=1).folder
    with player(browser, (folder / FIRST / "index.html").as_uri()) as (page, said, _):
        page.keyboard.press("g")
        until(page, "document.getElementById('key').textContent.endsWith('/2')")
        assert evil in page.text_content("#facts")
        assert page.locator("#facts img").count() == 0
        assert not said


def test_a_sibling_whose_data_is_missing_is_opened_as_a_page(site: Path, tmp_path: Path, browser: Any) -> None:
    copy = copied(site, tmp_path / "site")
    (copy / SECOND / "scene.js").unlink()
    with player(browser, (copy / FIRST / "index.html").as_uri()) as (page, _, _):
        page.keyboard.press("g")
        page.wait_for_url("**/2/index.html#frame_000")
        assert page.text_content("#heading") == "Microwave #3"


def test_the_map_shows_all_sources_and_those_of_other_rooms_at_its_border(site: Path, browser: Any) -> None:
    with player(browser, (site / BOTH / "index.html").as_uri() + "#frame_003") as (page, said, _):
        drawn(page, 3)
        assert page.locator(".map .source:not([hidden])").count() == 3
        assert page.locator(".map .source.hollow").count() == 1, "one is not audible in this frame"
        page.goto((site / AWAY / "index.html").as_uri())
        until(page, "Boolean(document.getElementById('screen').dataset.frame)")
        assert page.text_content(".map .label.away") == "telephone, living room"
        inside = page.evaluate(
            """() => {
              const map = document.querySelector('.map svg').getBoundingClientRect();
              return [...document.querySelectorAll('.map .source, .map .label.away')]
                .map((e) => e.getBoundingClientRect())
                .every((b) => b.left >= map.left && b.right <= map.right && b.top >= map.top && b.bottom <= map.bottom);
            }"""
        )
        assert inside
        assert not said


def test_the_truth_has_the_colours_of_the_sources(root: Path, browser: Any) -> None:
    observation = Dataset(root)[BOTH]
    scene = read_sound(observation)
    assert scene is not None
    read = """(at) => {
      const copy = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
      copy.drawImage(document.getElementById('screen'), -at[1], -at[0]);
      return [...copy.getImageData(0, 0, 1, 1).data].slice(0, 3);
    }"""
    with served(root) as server, player(browser, f"{server.url}{BOTH}/index.html") as (page, said, _):
        for index, number in ((1, 1), (3, 3)):
            page.evaluate("name => { location.hash = name; }", layout.frame_name(index))
            drawn(page, index)
            frame = observation.frames[index]
            inner = (frame.mask() & (frame.instance_ids() == number)).astype(np.uint8)
            inner = cv2.erode(inner, np.ones((5, 5), np.uint8), borderValue=0)
            row, column = (int(v) for v in np.argwhere(inner)[len(np.argwhere(inner)) // 2])
            base = np.array(page.evaluate(read, [row, column]), dtype=float)
            page.keyboard.press("m")
            layers(page, "frame mask")
            tinted = np.array(page.evaluate(read, [row, column]), dtype=float)
            assert tinted == pytest.approx(0.66 * base + 0.34 * np.array(scene.colours[number]), abs=8)
            page.keyboard.press("m")
            layers(page, "frame")
        assert not said


@pytest.mark.parametrize("key", [BOTH, AWAY, SILENT])
def test_pages_of_part_3_fit_a_phone_and_everything_to_press_has_a_name(site: Path, browser: Any, key: str) -> None:
    with visit(browser, site / key / "index.html", width=360) as opened:
        opened.page.wait_for_timeout(150)
        assert opened.overflow <= 0
        nameless = opened.page.eval_on_selector_all(
            "button, a, input, select, [role=img], [tabindex]",
            "all => all.filter(e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)",
        )
        assert nameless == []
        assert not opened.said


def test_without_scripts_siblings_are_links(site: Path, browser: Any) -> None:
    with visit(browser, site / FIRST / "index.html", scripts=False) as opened:
        opened.page.click(f"a[data-key='{SILENT}']")
        opened.page.wait_for_timeout(100)
        assert opened.page.text_content("h1") == "Silence"


def test_siblings_share_their_frames_and_each_picture_is_encoded_once(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server's files are those of the site on disk (above): sharing changes no byte."""
    encoded = []
    encode = pictures.player_frame
    monkeypatch.setattr(pictures, "player_frame", lambda rgb: encoded.append(rgb.tobytes()) or encode(rgb))
    dataset = Dataset(root)
    keys = dataset.keys[:2]
    build_site(dataset, keys, (), tmp_path / "site", workers=1)
    names = {frame.name for frame in dataset[keys[0]].frames}
    shown = [(tmp_path / "site" / key / "frames" / f"{name}.webp").read_bytes() for key in keys for name in names]
    assert len(shown) == 2 * len(names)
    assert len(encoded) == len(set(encoded)) == len(names)
