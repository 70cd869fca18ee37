"""The pages with the listener's figures are what the recorded scores say: nothing on them is typed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from avs3d_bench.scores import Scores
from benchmarks import listener_page
from benchmarks.listener_page import main
from benchmarks.listener_summary import pair_accuracy_of, settings_lines, settings_text, twin_pairs
from evaluators.comparison import compare_figure, metric_of

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
#: Pages that show the summary, besides the overview.
SUMMARIES = ("README.md", "docs/results.md")


def scores(name: str) -> Scores:
    return Scores.model_validate_json((DOCS / f"results/listener-{name}.json").read_bytes())


def text_of(page: str) -> str:
    """A page on one line."""
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_every_table_is_that_of_the_recorded_scores(tmp_path: Path) -> None:
    """Written again beside copies, all pages stay as they are."""
    docs = tmp_path / "docs"
    (docs / "images").mkdir(parents=True)
    for picture in (DOCS / "images").glob("listener-*-failures.jpg"):
        (docs / "images" / picture.name).touch()
    pages = ("docs/listener-results.md", *SUMMARIES)
    for page in pages:
        text = (ROOT / page).read_text(encoding="utf-8")
        for begin, end in (
            (listener_page.BEGIN, listener_page.END),
            (listener_page.BEGIN_SUMMARY, listener_page.END_SUMMARY),
        ):
            text = re.sub(f"{begin}.*{end}", f"{begin}\n{end}", text, flags=re.S)
        (tmp_path / page).write_text(text, encoding="utf-8")
    arguments = [str(DOCS / "results"), "--page", str(docs / "listener-results.md")]
    for page in SUMMARIES:
        arguments += ["--summary", str(tmp_path / page)]
    done = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    written = sorted((docs / "results").glob("*.md"))
    assert len(written) == 4
    for path in [*written, *(tmp_path / page for page in pages)]:
        assert path.read_bytes() == (ROOT / path.relative_to(tmp_path)).read_bytes(), (
            f"{path.relative_to(tmp_path)}: run python -m benchmarks.listener_page, as docs/listener-results.md says"
        )


def test_figures_in_the_text_are_those_of_the_scores() -> None:
    twins = twin_pairs("listen")
    found = {name: scores(f"listen-{name}") for name in ("2d", "category", "spatial")}
    frames = [
        (pair.frames, frozenset((pair.first, pair.second)) in twins)
        for group in found["2d"].siblings or ()
        for pair in group.pairs
    ]
    share = f"{sum(n for n, apart in frames if apart)} of {sum(n for n, _ in frames):,} pair-frames"
    assert share in text_of("docs/listener-results.md")
    shown = {name: [] for name in found}
    for name, one in found.items():
        assert one.overall.listen is not None
        for value in (one.overall.listen.pair_accuracy, pair_accuracy_of(one, twins)):
            assert value is not None
            shown[name].append(f"{value:.3f}".removeprefix("0"))
    assert shown["category"][1] == ".000"
    for page in ("docs/listener.md", "docs/listener-results.md", "docs/results.md"):
        text = text_of(page)
        assert {shown["2d"][0], shown["2d"][1], shown["category"][0]} <= set(re.findall(r"\.\d{3}\b", text)), page
    for page in ("docs/listener-results.md", "docs/results.md"):
        assert f"{shown['spatial'][1]} " in text_of(page), page
    compared = compare_figure(found, metric_of("listen.pair_accuracy"), "part_3", pairs=[("2d", "category")])
    assert compared is not None
    (one,) = compared.differences
    assert one.verdict == "undecided"
    assert one.p is not None
    assert f"p = {one.p:.2f}".replace("0.", ".") in text_of("docs/listener-results.md")


def test_strict_iou_in_the_text_is_that_of_the_scores() -> None:
    def of(label: str, row: str, digits: int) -> list[str]:
        found = []
        for part in ("part_1", "part_2"):
            group = scores(f"{label}-{row}").parts[part]  # type: ignore[index]
            assert group.strict is not None
            found.append(f"{group.strict.IoU:.{digits}f}".removeprefix("0"))
        return found

    text = text_of("docs/listener.md")
    own, other = of("open-s34-o7", "2d", 2), of("open-s34-o7-sh3d", "2d", 2)
    assert f"strict IoU {own[0]} and {own[1]} (part_1 and part_2 of `open-s34-o7`), {other[0]} and {other[1]} (" in text
    own, other = of("open-s34-o7", "spatial", 2), of("open-s34-o7-sh3d", "spatial", 2)
    assert f"strict IoU {own[0]} and {own[1]}, {other[0]} and {other[1]} |" in text
    text = text_of("docs/results.md")
    own, other = of("open-s34-o7", "spatial", 3), of("open-s34-o7-sh3d", "spatial", 3)
    assert f"| {own[0]} (`open-s34-o7`), {other[0]} (`open-s34-o7-sh3d`;" in text
    assert f"| {own[1]}, {other[1]} | met" in text


def test_pairs_of_twins_are_siblings_in_which_one_object_of_a_category_sounds_alone() -> None:
    pairs = twin_pairs("listen")
    assert pairs
    assert all(len({key.rpartition("/")[0] for key in pair}) == 1 for pair in pairs)
    assert twin_pairs("nowhere") == frozenset()


def test_the_pair_accuracy_of_some_pairs_is_a_mean_over_groups() -> None:
    found = scores("listen-2d")
    every = {frozenset((pair.first, pair.second)) for group in found.siblings or () for pair in group.pairs}
    assert found.overall.listen is not None
    assert pair_accuracy_of(found, every) == pytest.approx(found.overall.listen.pair_accuracy, abs=1e-8)
    assert pair_accuracy_of(found, ()) is None


def test_settings_that_differ_between_rows_are_said() -> None:
    one = {"looks": "one", "weights": "x", "only": []}
    many = {"looks": "several", "iterations": 800, "max_gaussians": 300_000, "voting_threshold": 0.3}
    assert settings_text({"only": []}) == ""
    assert settings_text(one) == "one look"
    votes = "at most 300,000 Gaussians, votes above .3 of all votes"
    assert settings_text(many) == f"several looks, 800 iterations, {votes}"
    lines = settings_lines({"2d": {"a": one, "b": one}, "spatial": {"a": many, "b": {**many, "iterations": 900}}})
    assert lines[2:-1] == [
        "- listener, 2D: one look",
        f"- listener + EchoSegnet spatial (a): several looks, 800 iterations, {votes}",
        f"- listener + EchoSegnet spatial (b): several looks, 900 iterations, {votes}",
    ]


def test_rows_of_tables_say_how_often_the_network_looked() -> None:
    text = (DOCS / "results/listener-open-s34-o7.md").read_text(encoding="utf-8")
    assert "| listener, 2D (several looks, n = 25) |" in text
    assert "| listener, 2D, with wrong sound (one look, n = 25) |" in text
