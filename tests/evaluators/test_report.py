"""The report: one file, reproducible bytes, no network requests, no code from a method's name."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from avs3d_bench.contract.scores import METRICS
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from evaluators.reading.records import Evaluation, FrameScore, Submission
from evaluators.reporting import pages
from evaluators.reporting.leaderboard import write_leaderboard
from evaluators.reporting.pages import write_page
from evaluators.reporting.pictures import FALSE, HIT, MISSED, draw_triple, error_picture, percent
from evaluators.reporting.report import best_reference, cards, chart, report_values, scale_end, write_report
from tests.support.browser import column, launch, visit
from tests.support.score_examples import example_scores, write_masks
from tests.support.tiny import MULTI, SINGLE, write_dataset, write_release

HOSTILE = '"><img src=x onerror=alert(1)><script>alert(2)</script>'
TEMPLATES = Path(pages.__file__).parent / "templates"


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, Submission, list[FrameScore]]:
    root = tmp_path_factory.mktemp("tree")
    dataset = Dataset(write_dataset(root / "data", frames=24))
    submission, frames = write_masks(root / "submission", dataset, seed=1)
    return dataset, submission, frames


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launch() as found:
        yield found


def evaluation(frames: list[FrameScore], **options: Any) -> Evaluation:
    ranked = sorted(frames, key=lambda frame: -frame.badness)
    options = {"categories": {SINGLE: "microwave", MULTI: "microwave"}} | options
    scores = example_scores(options.pop("observations", [SINGLE, MULTI]), **options)
    return Evaluation(scores, tuple(ranked[:2]), tuple(ranked[-2:]))


@pytest.fixture(scope="module")
def report(tree: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    dataset, submission, frames = tree
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, evaluation(frames, observations=34), dataset, submission)
    return path


def test_same_input_same_bytes_and_nothing_half_written(tree: Any, tmp_path: Path) -> None:
    dataset, submission, frames = tree
    first, second = tmp_path / "a" / "report.html", tmp_path / "b.html"
    for path in (first, second):
        write_report(path, evaluation(frames), dataset, submission)
    assert first.read_bytes() == second.read_bytes()
    kept = first.read_bytes()
    (missing,) = [FrameScore(SINGLE, "frame_001", True, 0.5, 0.1)]  # a train frame: it has no mask
    with pytest.raises(Avs3dError, match="frame_001"):
        write_report(first, Evaluation(example_scores(2), (missing,)), dataset, submission)
    assert first.read_bytes() == kept
    assert [p.name for p in first.parent.iterdir()] == ["report.html"]


def test_a_report_says_what_was_scored_with_what(report: Path) -> None:
    text = report.read_text()
    scores = example_scores(34)
    assert scores.dataset.sha256 is not None
    for fact in (
        scores.dataset.sha256, "open-s34-o7", "official 1.0", "strict 1.0", "10,000 resamples", "seed 0",
        "34 observations", "the mIoU of an all-black submission is", "never below the F of an all-white mask",
    ):  # fmt: skip
        assert fact in text
    strict = scores.overall.strict
    assert strict is not None
    assert strict.IoU is not None
    assert f"{strict.IoU:.3f}" in text
    assert "{:.3f}–{:.3f}".format(*strict.intervals["IoU"]) in text
    assert "strict 3D IoU</strong> is not available: the submission has no points.ply" in text


@pytest.mark.parametrize(
    ("options", "said", "unsaid"),
    [
        ({"observations": 1}, ["no interval: fewer than 6 observations"], ["Part 2"]),
        ({"protocols": ("official",)}, ["official mIoU"], ["strict IoU</", "visible</button>"]),
        ({"release": True}, ["the official release", "no instance masks"], [">category<"]),
        ({"dataset": {"observations": 60}, "observations": 34}, ["34 of 60 observations were scored"], []),
    ],
)
def test_what_is_missing_is_said(tree: Any, tmp_path: Path, options: Any, said: list[str], unsaid: list[str]) -> None:
    dataset, submission, frames = tree
    write_report(tmp_path / "r.html", evaluation(frames, **options), dataset, submission)
    text = (tmp_path / "r.html").read_text()
    assert all(words in text for words in said)
    assert not any(words in text for words in unsaid)
    assert ">None<" not in text
    assert "nan" not in re.sub(r"data:[^\"]*", "", text).split()


def test_the_official_release_gets_pictures_too(tmp_path: Path) -> None:
    dataset = Dataset(write_release(tmp_path / "release"))
    submission, frames = write_masks(tmp_path / "submission", dataset)
    write_report(tmp_path / "r.html", evaluation(frames, release=True), dataset, submission)
    assert (tmp_path / "r.html").read_text().count("data:image/jpeg") == 3 * 4


def test_references_stand_beside_every_part() -> None:
    scores = example_scores(34)
    iou = next(metric for metric in METRICS if (metric.protocol, metric.name) == ("strict", "IoU"))
    bars = dict(chart(scores, iou).blocks)
    assert list(bars) == ["Overall", "Part 1", "Part 2", "Categories", "Rooms"]
    for part in ("Overall", "Part 1", "Part 2"):
        assert [bar.label for bar in bars[part]] == [
            "submission", "all black", "all white", "centre box", "deaf: every instance", "deaf: most seen",
        ]  # fmt: skip
        assert bars[part][3].width == pytest.approx(5.5)
    own = bars["Overall"][0]
    assert own.pair is not None
    assert (own.low, own.high) == (100 * own.pair[0], 100 * own.pair[1])
    assert best_reference(scores, "overall", iou) == ("centre box", 0.055)
    by_title = {card.title: card for card in cards(scores, METRICS[2:])}
    assert by_title["Part 2"].best == ("centre box", 0.055), "what neither looks nor listens"
    assert by_title["Part 2"].deaf == ("deaf: every instance", 0.94)
    assert by_title["Part 1"].deaf is by_title["Overall"].deaf is None, "one instance: the truth"
    rate = next(metric for metric in METRICS if metric.name == "FP_rate")
    assert best_reference(scores, "overall", rate) is None, "the least false marks of all: none"


def test_a_scale_in_metres_ends_on_a_round_number() -> None:
    metres = next(metric for metric in METRICS if metric.unit == "m")
    share = METRICS[0]
    assert scale_end(share, [0.1], []) == 1.0
    assert scale_end(metres, [0.37, None], [(0.3, 0.52)]) == pytest.approx(0.8)
    assert scale_end(metres, [3.0], [(2.0, 4.0)]) == pytest.approx(4.0)
    assert scale_end(metres, [0.0], []) > 0


@pytest.mark.parametrize(
    ("url", "kept"),
    [
        ("https://example.org/a?b=1&c", True), ("http://example.org", True), ("javascript:alert(1)", False),
        (" JavaScript:alert(1)", False), ("data:text/html,x", False), ("//example.org", False), ("https://[", False),
        ("file:///etc/hosts", False), ("https:", False), (None, False),
    ],
)  # fmt: skip
def test_only_web_addresses_become_links(url: str | None, kept: bool) -> None:
    assert pages.web_address(url) == (url if kept else None)


def test_picture_colours_are_where_the_errors_are() -> None:
    rgb = np.full((100, 100, 3), 128, np.uint8)
    truth, prediction = np.zeros((100, 100), bool), np.zeros((100, 100), bool)
    truth[10:50, 10:90] = True
    prediction[10:50, 50:90] = True  # hit
    prediction[60:95, 10:90] = True  # false
    out = error_picture(rgb, truth, prediction, [], 100).astype(int)

    def near(region: Any, colour: tuple[int, int, int]) -> float:
        return float(np.abs(region.reshape(-1, 3).mean(axis=0) - colour).max())

    hit, false, missed = out[15:45, 55:85], out[65:90, 15:85], out[15:45, 15:45]
    assert near(hit, HIT) < 40
    assert near(false, FALSE) < 40
    assert near(missed, MISSED) < 80
    assert missed.std(axis=(0, 1)).max() > 20 > hit.std(axis=(0, 1)).max(), "missed is hatched, hit is not"
    background = out[97, 50]
    assert np.ptp(background) == 0, "the frame is grey"


def test_a_tiny_object_is_ringed_and_a_twin_outlined(tree: Any) -> None:
    truth = np.zeros((400, 400), bool)
    truth[200, 200] = True
    rgb, empty = np.full((400, 400, 3), 60, np.uint8), np.zeros((400, 400), bool)
    plain = error_picture(rgb, empty, empty, [], 200)
    ringed = error_picture(rgb, truth, empty, [], 200)
    assert (np.abs(ringed.astype(int) - plain).max(axis=2) > 60).sum() > 50
    twin = np.zeros((400, 400), bool)
    twin[50:150, 50:150] = True
    outlined = error_picture(rgb, empty, empty, [twin], 200).astype(int)
    assert outlined[20:80, 20:80].max() > 230
    assert np.array_equal(outlined[30:70, 30:70], plain[30:70, 30:70]), "only the outline"


def test_triples_say_what_they_show(tree: Any) -> None:
    dataset, submission, frames = tree
    frame = next(frame for frame in frames if frame.key == MULTI and frame.visible)
    triple = draw_triple(frame, dataset, submission)
    assert triple.twins == 1
    assert "microwave covers" in triple.truth.alt
    assert "1 silent twin" in triple.truth.alt
    for picture in (triple.frame, triple.truth, triple.prediction):
        data = base64.b64decode(picture.data.removeprefix("data:image/jpeg;base64,"))
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert pixels.shape[:2] == (picture.height, picture.width)
        assert f"{frame.name} of {MULTI}" in picture.alt


def test_a_mask_of_another_size_is_named(tree: Any, tmp_path: Path) -> None:
    from avs3d_bench.formats import media

    dataset, submission, _ = tree
    wrong = Submission(tmp_path, "avs3d", "masks", submission.record)
    media.write_png_mask(wrong.mask_path(SINGLE, "frame_000"), np.zeros((8, 9)))
    with pytest.raises(Avs3dError, match=r"frame_000\.png: 9×8 pixels, expected the frame's 64×64"):
        draw_triple(FrameScore(SINGLE, "frame_000", True, 0.5, 0.1), dataset, wrong)


def test_a_note_says_how_much_is_hit_and_how_much_is_false(tree: Any, tmp_path: Path) -> None:
    from avs3d_bench.formats import media

    dataset, submission, _ = tree
    mine = Submission(tmp_path, "avs3d", "masks", submission.record)
    truth = next(frame for frame in dataset[SINGLE].frames if frame.name == "frame_008").mask()
    doubled = truth | np.roll(truth, truth.shape[0] // 2, axis=0)
    for marked, note in (
        (truth, "100 % hit, 0 % of marks false"),
        (doubled, "100 % hit, 50 % of marks false"),
        (doubled & ~truth, "no overlap with the object"),
        (truth & ~truth, "nothing marked"),
    ):
        media.write_png_mask(mine.mask_path(SINGLE, "frame_008"), marked)
        assert draw_triple(FrameScore(SINGLE, "frame_008", True, 0.5, 0.1), dataset, mine).note == note
    twin = FrameScore(SINGLE, "frame_008", True, 0.0, 0.1, twins_marked=2)
    assert draw_triple(twin, dataset, mine).note == "marks 2 silent twins"


@pytest.mark.parametrize(("share", "text"), [(0, "0 %"), (1e-5, "< 0.1 %"), (0.031, "3.1 %"), (0.42, "42 %"),
                                             (0.9999, "> 99 %"), (1, "100 %")])  # fmt: skip
def test_percentages_never_claim_all_or_nothing_wrongly(share: float, text: str) -> None:
    assert percent(share) == text


def _luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def test_text_contrast_is_at_least_4_5_in_both_themes() -> None:
    style = (TEMPLATES / "page.css").read_text()
    blocks = re.findall(r":root[^{]*\{([^}]*--paper[^}]*)\}", style)
    assert len(blocks) == 4  # light, dark by the system, dark by choice, print
    themes = [dict(re.findall(r"(--[\w-]+): (#[0-9a-f]{6})", block)) for block in blocks[:3]]
    assert themes[1] == themes[2]
    for theme in themes:
        pairs = [
            (ink, ground) for ink in ("--ink", "--soft", "--accent") for ground in ("--paper", "--raised", "--well")
        ]
        for ink, ground in [*pairs, ("--notice-ink", "--notice")]:
            light, dark = sorted((_luminance(theme[ink]), _luminance(theme[ground])), reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (ink, ground)


# In a browser ---------------------------------------------------------------------------------------------------------


def test_it_loads_without_a_word_or_a_request_and_pictures_decode(report: Path, browser: Any) -> None:
    with visit(browser, report) as opened:
        assert (opened.said, opened.asked) == ([], [])
        widths = opened.page.eval_on_selector_all("img", "all => all.map(img => [img.naturalWidth, img.alt.length])")
        assert len(widths) == 12
        assert all(width > 0 and alt > 10 for width, alt in widths)


def test_the_bars_of_a_block_have_no_gaps(report: Path, browser: Any) -> None:
    with visit(browser, report) as opened:
        gaps = opened.page.evaluate(
            "[...document.querySelectorAll('.chart .row + .row')].map((e) =>"
            " e.getBoundingClientRect().top - e.previousElementSibling.getBoundingClientRect().bottom)"
        )
        assert len(gaps) > 20
        assert max(map(abs, gaps)) < 1


@pytest.mark.slow
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (390, False), (390, True)])
def test_the_page_never_scrolls_sideways(report: Path, browser: Any, width: int, dark: bool) -> None:
    with visit(browser, report, width=width, dark=dark) as opened:
        assert opened.overflow == 0
        ground = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
        brightness = sum(map(int, re.findall(r"\d+", ground)[:3])) / 3
        assert (brightness < 60) == dark
        opened.page.click("[data-theme-toggle]")
        assert opened.page.evaluate("getComputedStyle(document.body).backgroundColor") != ground
        assert opened.overflow == 0


@pytest.mark.parametrize("width", [1280, 1400])
def test_every_table_fits_a_laptop(tmp_path: Path, browser: Any, width: int) -> None:
    scores = example_scores(34, seed=1, points=True)
    write_page(
        tmp_path / "report.html",
        "report.html.j2",
        report_values(scores) | {"frames": {"worst": (), "best": ()}, "has_twins": False},
    )
    file = tmp_path / "scores.json"
    media.write_json(file, scores.model_copy(update={"report": None}))
    write_leaderboard(tmp_path / "board", [file])
    for page in (tmp_path / "report.html", tmp_path / "board/index.html"):
        with visit(browser, page, width=width) as opened:
            cut = opened.page.evaluate(
                "[...document.querySelectorAll('.scroll')].filter((e) => e.scrollWidth > e.clientWidth)"
                ".map((e) => `${e.ariaLabel}: ${e.scrollWidth} > ${e.clientWidth}`)"
            )
            assert cut == []


def test_columns_sort_both_ways_with_what_is_missing_last(report: Path, browser: Any) -> None:
    table = "table[data-filterable=observations]"
    with visit(browser, report) as opened:
        page = opened.page
        for name, first in (("strict IoU", "descending"), ("strict FP rate", "ascending")):
            button = page.get_by_role("button", name=name, exact=True)
            for direction in (first, "ascending" if first == "descending" else "descending"):
                button.click()
                head = page.locator("th", has=button)
                assert head.get_attribute("aria-sort") == direction
                assert page.locator(f"{table} th[aria-sort=ascending], {table} th[aria-sort=descending]").count() == 1
                texts = column(page, table, name)
                numbers = [float(text) for text in texts if text != "–"]
                assert texts[len(numbers) :] == ["–"] * (len(texts) - len(numbers)), "missing ones are last"
                assert numbers == sorted(numbers, reverse=direction == "descending")
                assert {len(text) for text in texts[: len(numbers)]} == {5}, "the same digits in every row"
        assert "–" in texts
        page.get_by_role("button", name="category").focus()
        page.keyboard.press("Enter")
        texts = column(page, table, "category")
        assert texts == sorted(texts)
        page.keyboard.press("Space")
        assert column(page, table, "category") == sorted(texts, reverse=True)


def test_filtering_keeps_rows_with_every_word(report: Path, browser: Any) -> None:
    with visit(browser, report) as opened:
        opened.page.fill("input[type=search]", "PART_2 kitchen")
        keys = column(opened.page, "table[data-filterable=observations]", "observation")
        assert keys
        assert all(key.startswith("part_2/") and "/kitchen/" in key for key in keys)
        assert opened.page.text_content("output") == f"{len(keys)} of 34"
        opened.page.fill("input[type=search]", "")
        assert opened.page.text_content("output") == "34 of 34"


def test_one_chart_at_a_time(report: Path, browser: Any) -> None:
    with visit(browser, report) as opened:
        shown = "all => all.filter(c => !c.hidden).map(c => c.dataset.chart)"
        assert opened.page.eval_on_selector_all(".chart", shown) == ["strict-IoU"]
        opened.page.check("input[value=official-F]")
        assert opened.page.eval_on_selector_all(".chart", shown) == ["official-F"]


def test_without_scripts_all_is_there(report: Path, browser: Any) -> None:
    with visit(browser, report, scripts=False) as opened:
        assert opened.page.locator(".chart:visible").count() == opened.page.locator(".chart").count() > 5
        assert opened.page.locator(".theme:visible").count() == 0


def test_no_text_of_a_submission_runs(tree: Any, tmp_path: Path, browser: Any) -> None:
    dataset, submission, frames = tree
    told = evaluation(
        frames, method=HOSTILE * 40, notes=HOSTILE, authors=(HOSTILE, "b"), url="javascript:alert(3)",
        runtime={HOSTILE: HOSTILE}, dataset={"name": HOSTILE},
    )  # fmt: skip
    path = tmp_path / "r.html"
    write_report(path, told, dataset, submission)
    for width in (1280, 390):
        with visit(browser, path, width=width) as opened:
            dialogs: list[str] = []
            opened.page.on("dialog", lambda dialog, seen=dialogs: seen.append(dialog.message))
            opened.page.reload(wait_until="load")
            assert (opened.said, opened.asked, dialogs) == ([], [], [])
            assert opened.page.locator("script").count() == 1
            assert opened.page.locator("[onerror], a[href^=javascript]").count() == 0
            assert HOSTILE in opened.page.text_content("main")
            assert opened.overflow == 0


def test_every_heading_level_follows_the_one_above(report: Path, browser: Any) -> None:
    with visit(browser, report) as opened:
        levels = opened.page.eval_on_selector_all("h1,h2,h3,h4", "all => all.map(h => Number(h.tagName[1]))")
        assert levels[0] == 1
        assert levels.count(1) == 1
        assert all(after <= before + 1 for before, after in pairwise(levels))
