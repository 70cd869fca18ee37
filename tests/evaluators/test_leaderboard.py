"""The leaderboard: only comparable scores are ranked together, ties share a rank, links work, one line per fault."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.contract.questions import KindScore, QaScores, QuestionSource
from avs3d_bench.contract.scores import DEAF_REFERENCES, REFERENCES, Scores, metrics_of
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from evaluators.reporting import standings
from evaluators.reporting.board import Board
from evaluators.reporting.leaderboard import read_entries, write_leaderboard
from evaluators.reporting.pages import interval
from evaluators.reporting.ranking import ScoresEntry, leaderboard_values
from tests.support.browser import column, launch, visit
from tests.support.score_examples import example_scores, report_page, with_means

VISIBLE = ".dataset > div:not([hidden]) table.ranking"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launch() as found:
        yield found


def save(folder: Path, scores: Scores, *, report: str | None = None) -> Path:
    """A file of scores, with a report beside it that says ``report``."""
    if report is not None:
        folder.mkdir(parents=True)
        (folder / "report.html").write_text(report_page(report), encoding="utf-8")
        scores = scores.model_copy(update={"report": "report.html"})
    media.write_json(folder / "scores.json", scores)
    return folder / "scores.json"


def tables(files: list[Path], part: str = "overall", protocol: str = "strict") -> list[list[tuple[int | None, str]]]:
    """(rank, title) of the rows of every table of a view, the references left out."""
    values = leaderboard_values(read_entries(files))
    views = [v for s in values["sections"] for v in s.views if (v.part, v.ruler.protocol) == (part, protocol)]
    found = [table for view in views for table in view.tables]
    return [[(row.rank, row.title) for row in (*table.rows, *table.partial) if row.entry] for table in found]


def test_the_higher_iou_is_first_and_references_have_no_rank(tmp_path: Path) -> None:
    files = [save(tmp_path / str(i), example_scores(seed=i, skill=skill, method=name), report=name)
             for i, (name, skill) in enumerate([("low", 0.3), ("high", 0.9), ("middle", 0.6)])]  # fmt: skip
    assert tables(files) == [[(1, "high"), (2, "middle"), (3, "low")]]
    assert tables(files, "part_2", "official") == [[(1, "high"), (2, "middle"), (3, "low")]]
    (section,) = leaderboard_values(read_entries(files))["sections"]
    rows = section.views[0].tables[0].rows
    assert [row.title for row in rows if row.entry is None] == [
        "deaf: every instance", "deaf: most seen", "centre box", "all white", "all black",
    ]  # fmt: skip
    assert all(row.rank is None for row in rows if row.entry is None)


def test_an_oracle_is_marked_and_takes_no_rank(tmp_path: Path) -> None:
    files = [save(tmp_path / name, example_scores(seed=1, skill=skill, method=name, truth=truth))
             for name, skill, truth in [("low", 0.3, None), ("oracle", 0.95, "masks of test frames"),
                                        ("high", 0.8, None)]]  # fmt: skip
    assert tables(files) == [[(None, "oracle"), (1, "high"), (2, "low")]]
    assert tables(files, "part_2", "official") == [[(None, "oracle"), (1, "high"), (2, "low")]]
    write_leaderboard(tmp_path / "board", files)
    page = (tmp_path / "board/index.html").read_text(encoding="utf-8")
    rows = [row for row in re.findall(r"<tr class.*?</tr>", page, re.S) if ">oracle<" in row]
    assert rows
    assert all("uses the truth" in row and "data-ranked" not in row for row in rows)
    assert "uses the truth" not in "".join(set(re.findall(r"<tr class.*?</tr>", page, re.S)) - set(rows))


@pytest.mark.parametrize(("observations", "shown"), [(5, False), (6, True)])
def test_no_interval_of_few_observations_is_shown_whatever_a_file_holds(observations: int, shown: bool) -> None:
    """Files of scores of earlier versions hold intervals of two observations."""
    group = example_scores(observations).overall
    metric = metrics_of("strict")[0]
    old = group.strict.model_copy(update={"intervals": {"IoU": (0.1, 0.9)}, "counts": {"IoU": observations}})
    pair = interval(group.model_copy(update={"strict": old}), metric)
    assert pair == ((0.1, 0.9) if shown else None)


def test_a_dash_stands_for_the_interval_of_few_observations(tmp_path: Path) -> None:
    write_leaderboard(tmp_path / "board", [save(tmp_path / "a", example_scores(3, seed=1, method="mine"))])
    page = (tmp_path / "board/index.html").read_text(encoding="utf-8")
    assert '<small title="fewer than 6 observations: no interval">–</small>' in page


def test_a_link_to_a_file_of_scores_keeps_its_report(tmp_path: Path) -> None:
    file = save(tmp_path / "away", example_scores(seed=1, method="mine"), report="mine")
    link = tmp_path / "scores.json"
    link.symlink_to(file)
    write_leaderboard(tmp_path / "board", [link])
    assert "<title>mine</title>" in (tmp_path / "board" / "reports" / "mine.html").read_text()


def test_the_json_has_the_rows_of_the_page_with_their_digests(tmp_path: Path) -> None:
    files = [save(tmp_path / name, example_scores(seed=1, skill=skill, method=name, truth=truth))
             for name, skill, truth in [("low", 0.3, None), ("oracle", 0.95, "masks of test frames"),
                                        ("high", 0.8, None)]]  # fmt: skip
    write_leaderboard(tmp_path / "board", files, json_file=tmp_path / "board.json")
    board = media.read_record(tmp_path / "board.json", Board)
    digests = {entry.scores.submission.method: entry.digest for entry in read_entries(files)}
    assert {entry.method: entry.digest for entry in board.entries} == digests
    for part, protocol in (("overall", "strict"), ("part_2", "official")):
        (table,) = (one for one in board.tables if (one.part, one.protocol) == (part, protocol))
        assert [[(row.place, row.title) for row in table.rows if row.digest]] == tables(files, part, protocol)
        assert all(row.digest == digests[row.title] for row in table.rows if row.digest)
        order = [row.figures[table.ranked_by] for row in table.rows]
        assert order == sorted(order, reverse=True)
    write_leaderboard(tmp_path / "board", files[::-1], json_file=tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "board.json").read_bytes()


def answered(path: Path, method: str, pairs: float, sha256: str = "0" * 64) -> Path:
    """A file of `avs3d qa-score --json`."""
    score = KindScore(lines=6, groups=2, accuracy=0.5, chance=0.3, pair_accuracy=pairs, pairs=4, outside=0,
                      accuracy_interval=None, pair_interval=(0.2, 0.9))  # fmt: skip
    source = QuestionSource(dataset="listen", dataset_version="4.0.0", sha256=sha256)
    row = QaScores(toolkit_version="1", method=method, questions=source, overall=score, kinds={"side": score})
    media.write_json(path, row)
    return path


def test_scores_of_questions_have_tables_of_their_own_without_places(tmp_path: Path) -> None:
    rows = [answered(tmp_path / "a.json", "low", 0.25), answered(tmp_path / "b.json", "<b>high", 0.75)]
    rows += [rows[0], answered(tmp_path / "c.json", "others", 0.5, "1" * 64)]
    masks = [save(tmp_path / "masks", example_scores(8, method='"format": "avs3d qa scores 1"'))]
    for files in (rows, [*rows, *masks]):
        write_leaderboard(tmp_path / "board", files, json_file=tmp_path / "board.json")
        page = (tmp_path / "board/index.html").read_text(encoding="utf-8")
        section = page[page.index('<section id="questions">') :]
        assert re.findall(r"<b><bdi>(.*?)</bdi></b>", section) == ["&lt;b&gt;high", "low", "others"]
        values = [float(value) for value in re.findall(r'data-v="([\d.]+)"', section)]
        assert values == [0.75, 0.5, 0.3, 0.75, 0.25, 0.5, 0.3, 0.25, 0.5, 0.5, 0.3, 0.5]
        assert ('<section id="ranking">' in page) == (len(files) > len(rows))
        board = media.read_record(tmp_path / "board.json", Board)
        assert [[(row.file, row.digest) for row in table.rows] for table in board.questions or ()] == [
            [(path.name, media.sha256_file(path)) for path in some] for some in ((rows[1], rows[0]), rows[3:])
        ]
        assert len(board.entries) == len(files) - len(rows)
    (tmp_path / "a.json").write_text((tmp_path / "a.json").read_text().replace('"groups": 2', '"groups": "two"'))
    with pytest.raises(Avs3dError, match=r"a\.json: overall\.groups"):
        write_leaderboard(tmp_path / "board", rows)


def test_equal_methods_share_a_rank(tmp_path: Path) -> None:
    files = [save(tmp_path / name, example_scores(seed=seed, skill=skill, method=name))
             for name, seed, skill in [("a", 1, 0.9), ("b", 2, 0.6), ("c", 2, 0.6), ("d", 3, 0.3)]]  # fmt: skip
    assert tables(files) == [[(1, "a"), (2, "b"), (2, "c"), (4, "d")]]


def test_methods_that_no_test_separates_share_a_rank(tmp_path: Path) -> None:
    files = [save(tmp_path / name, example_scores(seed=seed, skill=skill, method=name))
             for name, seed, skill in [("a", 1, 0.6), ("b", 2, 0.62), ("c", 3, 0.2)]]  # fmt: skip
    (ranks,) = tables(files)
    assert sorted(ranks) == [(1, "a"), (1, "b"), (3, "c")]
    (section,) = leaderboard_values(read_entries(files))["sections"]
    (table,) = section.views[0].tables
    assert [metric.name for metric in table.standings.columns] == [metric.name for metric in table.metrics]
    first, *_ = table.standings.pairs
    named = {table.titles[first.first], table.titles[first.second]}
    assert named == {"a", "b"}
    iou = first.differences[[metric.name for metric in table.metrics].index("IoU")]
    assert iou is not None
    assert (iou.verdict, iou.units) == ("undecided", 34)
    assert iou.mean >= 0, "the better mean is first"
    assert iou.interval is not None
    assert iou.interval[0] < iou.mean < iou.interval[1]


def test_every_figure_has_its_own_places(tmp_path: Path) -> None:
    """A method can lead by IoU and share a place by another figure."""
    made = {name: example_scores(seed=1, skill=skill, method=name).model_dump(mode="json")
            for name, skill in (("a", 0.9), ("b", 0.4))}  # fmt: skip
    for row, other in zip(made["a"]["observations"], made["b"]["observations"], strict=True):
        row["strict"]["boundary_F"] = other["strict"]["boundary_F"]
    files = [save(tmp_path / name, Scores.model_validate(with_means(data))) for name, data in made.items()]
    (section,) = leaderboard_values(read_entries(files))["sections"]
    (table,) = section.views[0].tables
    rows = {row.title: row for row in table.rows}
    metrics = {metric.name: metric for metric in table.metrics}
    assert [table.place(rows[name], metrics["IoU"]) for name in "ab"] == [1, 2]
    assert [table.place(rows[name], metrics["boundary_F"]) for name in "ab"] == [1, 1]
    assert all(table.place(row, metrics["IoU"]) is None for row in table.rows if row.entry is None)


def test_the_page_shows_pairs_and_says_when_there_are_few_observations(tmp_path: Path) -> None:
    files = [save(tmp_path / name, example_scores(seed=seed, skill=skill, method=name))
             for name, seed, skill in [("mine", 1, 0.9), ("<b>theirs</b>", 2, 0.4)]]  # fmt: skip
    write_leaderboard(tmp_path / "board", files)
    page = (tmp_path / "board/index.html").read_text(encoding="utf-8")
    assert "Paired differences of 1 pair</summary>" in page
    assert "<bdi>mine</bdi> − <bdi>&lt;b&gt;theirs&lt;/b&gt;</bdi>" in page
    assert 'class="number separated"' in page
    overall, *parts = re.split(r'<div data-part="', page)[1:]
    assert "Few observations." not in overall, "34 observations"
    assert any("Differences of 8 observations: fewer than 10, so that only large" in part for part in parts)


def test_more_methods_than_can_be_tested_are_ranked_by_their_means(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(standings, "MOST_METHODS", 2)
    files = [
        save(tmp_path / name, example_scores(8, seed=seed, skill=0.5, method=name)) for seed, name in enumerate("abc")
    ]
    (ranks,) = tables(files)
    assert sorted(rank for rank, _ in ranks if rank) == [1, 2, 3]
    write_leaderboard(tmp_path / "board", files)
    assert "the ranks are those of the means" in (tmp_path / "board/index.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("methods", "shown"), [(2, "every figure"), (6, "the ranking figure"), (21, "none")])
def test_many_pairs_are_shown_for_fewer_figures(methods: int, shown: str) -> None:
    scores = {str(i): example_scores(3, seed=i, skill=0.5) for i in range(methods)}
    metrics = metrics_of("strict")
    found = standings.standings(scores, metrics, metrics[0], "overall")
    pairs = methods * (methods - 1) // 2
    assert len(found.pairs) == (0 if shown == "none" else pairs)
    assert len(found.columns) == {"none": 0, "the ranking figure": 1}.get(shown, len(found.figures))
    assert found.tested
    assert found.few


def test_what_does_not_compare_is_ranked_apart(tmp_path: Path) -> None:
    other = "0" * 64
    made = {
        "ours": example_scores(seed=1, method="ours"),
        "other_bytes": example_scores(seed=2, method="other bytes", dataset={"sha256": other}),
        "other_version": example_scores(seed=3, method="other version", dataset={"version": "2.0.0"}),
        "release": example_scores(seed=4, method="release", release=True),
        "newer": example_scores(seed=5, method="newer", evaluator={"protocols": {"strict": "2.0", "official": "1.0"}}),
        "partial": example_scores(12, seed=6, method="partial", skill=0.99, dataset={"observations": 34}),
        "official": example_scores(seed=7, method="official", protocols=("official",)),
    }
    files = [save(tmp_path / name, scores) for name, scores in made.items()]
    strict = tables(files)
    assert len(strict) == 5
    for name in ("other bytes", "other version", "release", "newer"):
        assert [(1, name)] in strict
    assert [(1, "ours"), (None, "partial")] in strict
    (released,) = [table for table in tables(files, protocol="official") if len(table) > 1]
    assert {name for _, name in released} == {"ours", "newer", "official", "partial"}
    assert (None, "partial") in released
    values = leaderboard_values(read_entries(files))
    assert [label for _, label in values["rulers"]] == ["strict 2.0", "strict 1.0", "official 1.0"]
    view = next(v for v in values["sections"][0].views if v.ruler.version == "1.0" and v.ruler.protocol == "strict")
    assert view.left_out == ("newer", "official")


def test_files_of_another_truth_are_ranked_apart(tmp_path: Path) -> None:
    # Two official releases have neither version nor sha256: only the reference rows show that their masks differ.
    one = example_scores(seed=1, method="one", release=True)
    data = one.model_dump(mode="json")
    data["submission"]["method"] = "two"
    data["references"]["centre_box"]["part_1"]["strict"]["IoU"] += 0.01
    files = [save(tmp_path / "one", one), save(tmp_path / "two", Scores.model_validate(with_means(data)))]
    assert sorted(tables(files)) == [[(1, "one")], [(1, "two")]]
    assert len(tables(files, protocol="official")) == 1
    write_leaderboard(tmp_path / "board", files)
    assert "Different ground truth." in (tmp_path / "board" / "index.html").read_text()


def test_files_without_deaf_rows_rank_with_files_that_have_them(tmp_path: Path) -> None:
    """Earlier versions wrote three reference rows; the truth is the same."""
    earlier = example_scores(seed=1, method="earlier").model_dump(mode="json")
    for name in DEAF_REFERENCES:
        del earlier["references"][name]
    del earlier["references_unavailable"]
    files = [save(tmp_path / "a", Scores.model_validate(earlier)), save(tmp_path / "b", example_scores(seed=1))]
    assert len(tables(files)) == 1
    (section,) = leaderboard_values(read_entries(files))["sections"]
    titles = [row.title for row in section.views[0].tables[0].rows if row.entry is None]
    assert "deaf: most seen" in titles


def test_one_method_twice_is_told_apart_and_one_file_twice_counts_once(tmp_path: Path) -> None:
    files = [save(tmp_path / str(seed), example_scores(seed=seed), report=f"report {seed}") for seed in (1, 2)]
    entries = read_entries([*files, files[0]])
    assert len(entries) == 2
    assert all(entry.twin for entry in entries)
    assert len({entry.name for entry in entries}) == len({entry.short_digest for entry in entries}) == 2
    write_leaderboard(tmp_path / "board", files)
    reports = {path.read_text() for path in (tmp_path / "board" / "reports").glob("*.html")}
    assert reports == {report_page(f"report {seed}") for seed in (1, 2)}


@pytest.mark.slow
@given(st.permutations(range(5)))
@settings(max_examples=5)
def test_the_order_of_the_files_changes_nothing(order: list[int]) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [
            save(folder / str(i), example_scores(8, seed=i // 2, method=f"m{i % 3}"), report=str(i)) for i in range(5)
        ]
        pages = []
        for number, chosen in enumerate((files, [files[i] for i in order])):
            write_leaderboard(folder / f"board{number}", chosen)
            written = sorted(p for p in (folder / f"board{number}").rglob("*") if p.is_file())
            pages.append([(p.relative_to(folder / f"board{number}"), p.read_bytes()) for p in written])
        assert pages[0] == pages[1]


def test_a_board_can_be_made_from_a_board(tmp_path: Path) -> None:
    files = [
        save(tmp_path / str(i), example_scores(8, seed=i, method="same" if i else "other"), report=str(i))
        for i in range(3)
    ]
    board = tmp_path / "board"
    write_leaderboard(board, files)
    before = {path: path.read_bytes() for path in board.rglob("*") if path.is_file()}
    write_leaderboard(board, sorted((board / "reports").glob("*.json")))
    assert {path: path.read_bytes() for path in board.rglob("*") if path.is_file()} == before


def test_no_copy_takes_the_place_of_another_file(tmp_path: Path) -> None:
    taken = tmp_path / "reports" / "other.json"
    media.write_json(taken, example_scores(8, seed=1, method="one"))
    files = [taken, save(tmp_path / "x", example_scores(8, seed=2, method="other"))]
    before = taken.read_bytes()
    with pytest.raises(UsageError, match=r"other\.json: the leaderboard would overwrite"):
        write_leaderboard(tmp_path, files)
    assert taken.read_bytes() == before


def test_a_report_that_is_gone_or_lies_elsewhere_is_no_link(tmp_path: Path) -> None:
    secret = tmp_path / "secret.html"
    secret.write_text("secret")
    gone = save(tmp_path / "gone", example_scores(8, seed=1, method="gone", report="nowhere.html"))
    linked = save(tmp_path / "linked", example_scores(8, seed=2, method="linked", report="report.html"))
    (linked.parent / "report.html").symlink_to(secret)
    assert [entry.report for entry in read_entries([gone, linked])] == [None, None]
    write_leaderboard(tmp_path / "board", [gone, linked])
    assert sorted(path.name for path in (tmp_path / "board" / "reports").iterdir()) == ["gone.json", "linked.json"]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda data: data["overall"]["strict"].update(IoU=1.5), "overall.strict.IoU"),
        (lambda data: data.pop("submission"), "submission"),
        (lambda data: data["dataset"].update(scored=3), "dataset.scored"),
        (lambda data: data["overall"].update(strict=None), "overall.strict"),
        (lambda data: data["avs3d_eval"].update(protocols={}), "avs3d_eval.protocols"),
    ],
)
def test_a_broken_file_is_one_line_with_file_and_field(tmp_path: Path, change: Any, named: str) -> None:
    data = example_scores(8).model_dump(mode="json")
    change(data)
    media.write_json(tmp_path / "bad.json", data)
    with pytest.raises(Avs3dError) as error:
        write_leaderboard(tmp_path / "board", [save(tmp_path / "good", example_scores(8)), tmp_path / "bad.json"])
    said = str(error.value)
    assert "bad.json" in said
    assert named in said
    assert "\n" not in said
    assert not (tmp_path / "board").exists()


def test_nothing_to_rank_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no file of scores"):
        write_leaderboard(tmp_path, [])
    with pytest.raises(Avs3dError, match=r"nowhere\.json: missing"):
        write_leaderboard(tmp_path, [tmp_path / "nowhere.json"])


def test_an_entry_is_whole_only_with_every_observation() -> None:
    scores = example_scores(8, dataset={"observations": 9})
    assert not ScoresEntry(scores, Path("x"), "0", None).whole


# In a browser ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("scores")
    hostile = '"><img src=x onerror=alert(1)>'
    made = [
        example_scores(seed=1, skill=0.8, points=True, method="precise", url="https://example.org"),
        example_scores(seed=2, skill=0.6, method="Ärger & Söhne", authors="x"),
        example_scores(seed=2, skill=0.6, method="same masks"),
        example_scores(seed=4, skill=0.4, points=True, method=hostile * 8, url="javascript:alert(1)"),
        example_scores(12, seed=5, method="partial", dataset={"observations": 34}),
        example_scores(seed=6, release=True, method="on the release"),
    ]
    files = [save(root / str(i), scores, report=scores.submission.method) for i, scores in enumerate(made)]
    write_leaderboard(root / "board", files)
    return root / "board" / "index.html"


@pytest.mark.slow
def test_it_loads_from_disk_without_a_word_or_a_request(board: Path, browser: Any) -> None:
    for width in (1280, 390):
        for dark in (False, True):
            with visit(browser, board, width=width, dark=dark) as opened:
                assert (opened.said, opened.asked, opened.overflow) == ([], [], 0)
                assert opened.page.locator("[onerror], a[href^=javascript]").count() == 0


def test_every_link_leads_to_a_file(board: Path, browser: Any) -> None:
    with visit(browser, board) as opened:
        links = opened.page.eval_on_selector_all("a[href^='reports/']", "all => all.map(a => a.getAttribute('href'))")
    assert {Path(link).suffix for link in links} == {".html", ".json"}
    assert all((board.parent / link).is_file() for link in links)
    assert {Path(link).stem for link in links} == {path.stem for path in (board.parent / "reports").iterdir()}
    report = next(link for link in links if link.endswith("precise.html"))
    with visit(browser, board.parent / report) as opened:
        assert opened.page.title() == "precise"
    copied = media.read_record(board.parent / report.replace(".html", ".json"), Scores)
    assert copied.report == "precise.html"


def test_part_and_protocol_switch(board: Path, browser: Any) -> None:
    with visit(browser, board) as opened:
        page = opened.page
        assert page.locator(VISIBLE).count() == 2  # one per dataset
        page.check("input[value=part_2]")
        page.check("input[value='official-1.0']")
        shown = page.eval_on_selector_all(
            ".dataset > div:not([hidden])", "all => all.map(d => [d.dataset.part, d.dataset.ruler])"
        )
        assert shown == [["part_2", "official-1.0"]] * 2
        assert "mIoU" in page.locator(VISIBLE).first.text_content()


def test_a_heading_sorts_and_ranks(board: Path, browser: Any) -> None:
    with visit(browser, board) as opened:
        page = opened.page
        ranks = column(page, VISIBLE, "rank")
        assert [rank for rank in ranks if rank != "–"] == ["1", "2", "2", "4"]
        assert ranks.count("–") == len(REFERENCES) + 1, "the references, and what was scored over a part"
        table = page.locator(VISIBLE).first
        for direction in ("descending", "ascending"):
            table.get_by_role("button", name="3D IoU").click()
            assert (
                table.locator("th[aria-sort=ascending], th[aria-sort=descending]").get_attribute("aria-sort")
                == direction
            )
            ranks, values = column(page, VISIBLE, "rank"), column(page, VISIBLE, "3D IoU")
            assert ranks[:2] == (["1", "2"] if direction == "descending" else ["2", "1"])
            assert values[2:] == ["–"] * 8, "missing ones are last both ways"
        assert page.locator("[data-ranked-by]:visible").first.text_content() == "3D IoU"
        table.get_by_role("button", name="FP rate").click()
        body = table.locator("tbody").first.locator("tr")
        assert "all black" in body.first.text_content(), "a reference takes its place by value, without a rank"
        assert column(page, VISIBLE, "rank")[0] == "–"
        table.get_by_role("button", name="method").click()
        titles = [title.split("reference")[0].split("report")[0] for title in column(page, VISIBLE, "method")]
        assert titles[-1].startswith("partial"), "what is not ranked stays below"
        assert titles.index("all black") < titles.index("all white") < titles.index("centre box")


def test_without_scripts_every_table_is_there(board: Path, browser: Any) -> None:
    with visit(browser, board, scripts=False) as opened:
        assert opened.page.locator("table:visible").count() == 2 * 3 * 2


@pytest.mark.slow
def test_a_thousand_files(tmp_path: Path, browser: Any) -> None:
    scores = example_scores(2, seed=0)
    files = []
    for i in range(1000):
        said = scores.submission.model_copy(update={"method": f"method {i}"})
        path = tmp_path / f"{i}.json"
        path.write_text(scores.model_copy(update={"submission": said}).model_dump_json())
        files.append(path)
    write_leaderboard(tmp_path / "board", files)
    with visit(browser, tmp_path / "board" / "index.html") as opened:
        assert (opened.said, opened.overflow) == ([], 0)
        opened.page.fill("input[type=search]", "method 99")
        names = column(opened.page, VISIBLE, "method")
        assert len(names) == 19  # 99, 199 … 899, 990 … 999
        assert opened.page.locator(VISIBLE).first.locator("tr[data-ranked]").count() == 1000
