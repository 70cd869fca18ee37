"""How pages look in a browser: nothing is cut off on a phone, text is legible, and grey buttons say why they are grey."""  # noqa: E501

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from avs3d_bench.dataset import Dataset
from avs3d_bench.inspector.build import build_site
from avs3d_bench.inspector.site import ObservationSite
from avs3d_bench.inspector.submissions import open_submissions
from avs3d_bench.submission import SubmissionWriter
from evaluators.cli import main
from evaluators.reporting.leaderboard import write_leaderboard
from tests.avs3d_bench.test_inspector import drawn, until
from tests.support import tiny, tiny_scenes
from tests.support.browser import launch, visit
from tests.support.shared import SharedDataset

PHONE = 390
#: Elements whose content is cut off at the right, or hidden behind a scroll bar.
CUT_OFF = """
[...document.querySelectorAll('main *')].filter((e) => {
  const style = getComputedStyle(e), box = e.getBoundingClientRect();
  if (!box.width || box.height < 2 || style.clipPath !== 'none' || e.closest('svg, [hidden], .pictures, .visually-hidden')) return false;
  // Table rows and headings that are there for screen readers alone.
  for (let up = e; up; up = up.parentElement) if (getComputedStyle(up).clipPath !== 'none') return false;
  const scrolls = !['visible', 'clip'].includes(style.overflowX) && e.scrollWidth > e.clientWidth + 1;
  return scrolls || box.right > document.documentElement.clientWidth + 1;
}).map((e) => `${e.tagName}.${e.className} ${e.textContent.trim().slice(0, 40)}`)
"""  # noqa: E501
#: A number and its unit in two lines: the rectangles of a range over both are then not on one line.
TORN_UNITS = r"""
(() => {
  const walk = document.createTreeWalker(document.querySelector('main'), NodeFilter.SHOW_TEXT), torn = [];
  while (walk.nextNode()) {
    const node = walk.currentNode;
    if (node.parentElement.closest('script, style, svg, [hidden], thead, p, li')) continue;
    for (const match of node.data.matchAll(/\d[\s\u00a0](?:%|dB|k?Hz|ms?|s|px|bits|pixels|frames)(?![a-z])/g)) {
      const range = document.createRange();
      range.setStart(node, match.index);
      range.setEnd(node, match.index + match[0].length);
      const tops = [...range.getClientRects()].filter((r) => r.width > 0).map((r) => r.top);
      if (tops.length && Math.max(...tops) - Math.min(...tops) > 4) torn.push(node.data.trim());
    }
  }
  return torn;
})()
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launch() as found:
        yield found


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    """Two observations of parts 1 and 2."""
    return shared_dataset()


@pytest.fixture(scope="module")
def submission(root: Path) -> Path:
    folder = root.parent / "submission"
    with SubmissionWriter(folder, Dataset(root), method="a method with a rather long name, 2 variants") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, frame.mask())
    return folder


@pytest.fixture(scope="module")
def pages(root: Path, submission: Path) -> dict[str, Path]:
    """Every kind of page."""
    dataset = Dataset(root)
    site = build_site(dataset, dataset.keys, open_submissions(dataset, [submission]), root.parent / "site", workers=1)
    scenes = Dataset(tiny_scenes.write_part_3(root.parent / "scenes", stems=True))
    heard = build_site(scenes, scenes.keys, (), root.parent / "heard", workers=1)
    report, scores, board = root.parent / "s.html", root.parent / "s.json", root.parent / "board"
    with pytest.raises(SystemExit) as end:
        main([str(submission), "--dataset", str(root), "--workers", "1", "--json", str(scores), "--html", str(report)])
    assert not end.value.code
    write_leaderboard(board, [scores])
    return {
        "gallery": site.folder / "index.html",
        "gallery of scenes": heard.folder / "index.html",
        "player": site.folder / tiny.MULTI / "index.html",
        "player of a scene": heard.folder / tiny_scenes.BOTH / "index.html",
        "report": report,
        "leaderboard": board / "index.html",
    }


PAGES = ("gallery", "gallery of scenes", "player", "player of a scene", "report", "leaderboard")


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_on_a_phone_no_column_is_cut_off_and_units_stay_with_their_numbers(
    pages: dict[str, Path], browser: Any, name: str
) -> None:
    with visit(browser, pages[name], width=PHONE) as opened:
        assert opened.overflow <= 0
        assert opened.page.evaluate(CUT_OFF) == []
        assert opened.page.evaluate(TORN_UNITS) == []
        assert not opened.said


@pytest.mark.slow
def test_on_a_phone_every_figure_of_a_table_has_its_name(pages: dict[str, Path], browser: Any) -> None:
    for name in ("report", "leaderboard", "player of a scene"):
        with visit(browser, pages[name], width=PHONE) as opened:
            cells = opened.page.evaluate(
                """[...document.querySelectorAll('table tbody tr:not(.band) td:not([colspan])')]
                  .filter((e) => e.getBoundingClientRect().width && !e.matches('.plot-column'))
                  .map((e) => getComputedStyle(e, '::before').content)"""
            )
            assert len(cells) > 3
            assert all(re.fullmatch(r'"[^"]+"', text) for text in cells), name
            roles = opened.page.evaluate(
                "[...document.querySelectorAll('table td')].map((e) => e.getAttribute('role'))"
            )
            assert set(roles) == {"cell"}, "a grid is no table for screen readers without its roles"


@pytest.mark.slow
def test_a_wide_table_stays_a_table(pages: dict[str, Path], browser: Any) -> None:
    with visit(browser, pages["leaderboard"]) as opened:
        assert (
            opened.page.evaluate("getComputedStyle(document.querySelector('.ranking tbody tr')).display") == "table-row"
        )


@pytest.fixture(scope="module")
def crowded(root: Path) -> Path:
    """A page whose map has ten objects side by side, all of one category."""
    copy = tiny.clone(root, root.parent / "crowded")

    def side_by_side(record: dict[str, Any]) -> None:
        sounding, silent = sorted(record["instances"], key=lambda instance: not instance["sounding"])
        for number in range(10):
            low = [0.25 * number - 1.2, 0.8, -1.0]
            box = {"bounds": [low, [low[0] + 0.2, 1.0, -0.8]], "position": low, "id": number + 1}
            record["instances"] += [{**(silent if number else sounding), **box, "category": record["category"]}]
        del record["instances"][:2]

    tiny.edit_record(copy, tiny.MULTI, side_by_side, rehash=False)
    return build_site(Dataset(copy), [tiny.MULTI], (), root.parent / "crowded-site", workers=1).folder / tiny.MULTI


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, PHONE])
@pytest.mark.parametrize("name", ["player", "player of a scene", "crowded"])
def test_labels_of_the_map_do_not_overlap_and_lie_in_it(
    pages: dict[str, Path], crowded: Path, browser: Any, name: str, width: int
) -> None:
    with visit(browser, (pages | {"crowded": crowded / "index.html"})[name], width=width) as opened:
        until(opened.page, "Boolean(document.querySelector('.map .label'))")
        boxes = opened.page.evaluate(
            """(() => { const map = document.querySelector('.map svg').getBoundingClientRect();
              return [...document.querySelectorAll('.map .label, .map .scale')].map((e) => e.getBoundingClientRect())
                .map((b) => [b.left - map.left, b.top - map.top, map.right - b.right, map.bottom - b.bottom,
                             b.left, b.top, b.right, b.bottom]); })()"""
        )
        assert len(boxes) > (10 if name == "crowded" else 2)
        assert all(min(box[:4]) > -1 for box in boxes)
        for (*_, l0, t0, r0, b0), (*_, l1, t1, r1, b1) in itertools.combinations(boxes, 2):
            assert min(r0, r1) - max(l0, l1) <= 1 or min(b0, b1) - max(t0, t1) <= 2


def test_the_player_opens_on_a_frame_that_shows_something_audible(root: Path, tmp_path: Path) -> None:
    for key in Dataset(root).keys:
        site = ObservationSite(Dataset(root), key, ())
        assert site.facts.moments[site.opening].visible
        assert site.facts.moments[site.opening].name == site.poster.name, "the picture of the gallery"
    scenes = Dataset(tiny_scenes.write_part_3(tmp_path / "scenes"))
    for key in scenes.keys:
        site = ObservationSite(scenes, key, ())
        if any(moment.visible for moment in site.facts.moments):
            assert site.facts.moments[site.opening].visible
        else:
            assert site.opening == 0
    assert ObservationSite(scenes, tiny_scenes.SILENT, ()).opening == 0


@pytest.mark.slow
def test_the_first_picture_in_the_browser_is_that_frame_and_the_sound_starts_there(
    root: Path, browser: Any, tmp_path: Path
) -> None:
    copy = tiny.clone(root, tmp_path / "copy")

    def late(record: dict[str, Any]) -> None:
        for number, frame in enumerate(record["frames"]):
            frame["visible_pixels"] = 300 if number == 6 else 0

    tiny.edit_record(copy, tiny.SINGLE, late, rehash=False)
    built = build_site(Dataset(copy), [tiny.SINGLE], (), tmp_path / "site", workers=1)
    with visit(browser, built.folder / tiny.SINGLE / "index.html") as opened:
        drawn(opened.page, 6)
        until(opened.page, "document.getElementById('sound').readyState >= 1")
        assert opened.page.evaluate("document.getElementById('sound').currentTime") == pytest.approx(6, abs=0.1)
        opened.page.keyboard.press("Home")
        drawn(opened.page, 0)
        assert not opened.said


@pytest.mark.slow
def test_grey_buttons_say_why_and_lead_to_a_test_frame(pages: dict[str, Path], browser: Any) -> None:
    page_file = pages["player"]
    with visit(browser, page_file) as opened:
        page = opened.page
        page.evaluate("location.hash = '#frame_003'")
        drawn(page, 3)
        assert page.text_content("#frame-split") == "train"
        button = page.locator(".submission")
        note = page.locator(f"#{button.get_attribute('aria-describedby')}")
        assert note.is_visible()
        assert "train frame" in note.inner_text()
        assert "test frames" in button.get_attribute("title")
        height = page.evaluate("document.documentElement.scrollHeight")
        page.click("#next-test")
        until(page, "document.getElementById('frame-split').textContent === 'test'")
        assert not note.is_visible()
        assert button.get_attribute("aria-describedby") is None
        assert button.get_attribute("title") is None
        assert page.evaluate("document.documentElement.scrollHeight") == height, "nothing jumps while it plays"
        assert not opened.said


@pytest.mark.slow
def test_a_layer_that_the_data_does_not_have_says_so(browser: Any, tmp_path: Path) -> None:
    release = Dataset(tiny.write_release(tmp_path / "release"))
    built = build_site(release, release.keys[:1], (), tmp_path / "site", workers=1)
    with visit(browser, built.folder / release.keys[0] / "index.html") as opened:
        button = opened.page.locator("#instances")
        if button.is_enabled():
            pytest.fail("the release has no instance masks")
        assert "no instance masks" in opened.page.locator(f"#{button.get_attribute('aria-describedby')}").inner_text()
        assert "no instance masks" in button.get_attribute("title")


#: Contrast ratio (WCAG 2) of every text with its background, the least first.
CONTRAST = r"""
(selector) => {
  const parse = (text) => { const m = text.match(/[\d.]+/g).map(Number); return [m[0], m[1], m[2], m[3] ?? 1]; };
  const lum = (c) => { const [r, g, b] = c.map((v) => { const s = v / 255; return s <= 0.03928 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4; }); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const over = (top, below) => [0, 1, 2].map((i) => top[i] * top[3] + below[i] * (1 - top[3]));
  const back = (e) => { const layers = []; for (let up = e; up; up = up.parentElement) layers.push(parse(getComputedStyle(up).backgroundColor)); return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255]); };
  const found = [];
  for (const e of document.querySelectorAll(selector)) {
    if (![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim()) || !e.getBoundingClientRect().width) continue;
    const ground = back(e), ink = over(parse(getComputedStyle(e).color), ground), [a, b] = [lum(ink), lum(ground)];
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), e.textContent.trim().slice(0, 30)]);
  }
  return found.sort((a, b) => a[0] - b[0]);
}
"""  # noqa: E501


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
def test_text_of_buttons_and_notes_is_legible(pages: dict[str, Path], browser: Any, dark: bool) -> None:
    with visit(browser, pages["player"], dark=dark) as opened:
        opened.page.evaluate("location.hash = '#frame_003'")
        drawn(opened.page, 3)
        found = opened.page.evaluate(f"({CONTRAST})('.layers button *, .layers button, .grey, .grey *, .readout *')")
        assert len(found) > 8
        assert found[0][0] >= 4.5, found[0]


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
def test_the_plan_follows_the_theme(pages: dict[str, Path], browser: Any, dark: bool) -> None:
    with visit(browser, pages["player"], dark=dark) as opened:
        until(opened.page, "Boolean(document.querySelector('.map .floor'))")
        filtered = opened.page.evaluate("getComputedStyle(document.querySelector('.map .floor')).filter")
        assert ("invert" in filtered) == dark
