"""The paper's tables from files of scores: exact text, the paper's figures in their cells, no mixed datasets."""

from __future__ import annotations

import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pandas as pd
import pytest

from avs3d_bench import cli
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.contract.scores import REFERENCES, Scores
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from evaluators.reporting import paper
from evaluators.reporting.leaderboard import read_entries
from evaluators.reporting.pages import REFERENCE_TITLES
from evaluators.reporting.table_contents import csv, records, table_2, table_3
from evaluators.reporting.tables import write_tables
from evaluators.statistics.bootstrap import FEWEST
from tests.support.score_examples import example_scores, with_means

#: Six of each part, so that means have intervals.
KEYS = [f"part_1/flat/{room}/{i}" for room in ("bathroom", "kitchen") for i in (1, 2, 3)]
KEYS += [f"part_2/flat/kitchen/{i}" for i in range(1, 7)]
PARTIAL = {"observations": 34, "sha256": None}
COMPLETE = {"sha256": None}


def runtime(**changes: Any) -> dict[str, Any]:
    """What EchoSegnet writes into submission.json, as the paper would have it."""
    paper_setting: dict[str, Any] = {
        "method": "echosegnet", "variant": "official", "aisrm": True, "masks": "owod-bind", "voting_threshold": 0.3,
        "iterations": 30_000,
    }  # fmt: skip
    return {key: value for key, value in (paper_setting | changes).items() if value is not ...}


def made(name: str, figures: tuple[float, float], keys: list[str] = KEYS, **options: Any) -> Scores:
    """Scores whose figures are those given: (single-instance, multi-instance); intervals ± 0.02."""
    data = example_scores(keys, **({"method": name, "dataset": COMPLETE} | options)).model_dump(mode="json")
    names = {"official": ("mIoU", "F"), "strict": ("IoU", "F", "wrong_instance_rate")}
    values = dict(zip(("part_1", "part_2"), figures, strict=True))
    for row in data["observations"]:
        for protocol, metrics in names.items():
            for offset, metric in enumerate(metrics):
                if row[protocol] and row[protocol][metric] is not None:
                    row[protocol][metric] = round(values[row["part"]] - 0.01 * offset, 3)
    with_means(data)
    for scores in (data["overall"], *data["parts"].values()):
        for protocol, metrics in names.items():
            for metric in metrics:
                summary = scores[protocol]
                if summary and summary[metric] is not None and scores["observations"] >= FEWEST:
                    low = round(summary[metric] - 0.02, 3)
                    summary["intervals"][metric] = (low, round(low + 0.04, 3))
    return Scores.model_validate(data)


def save(folder: Path, *scores: Scores) -> list[Path]:
    """One file each."""
    paths = [folder / f"{index}.json" for index in range(len(scores))]
    for path, one in zip(paths, scores, strict=True):
        media.write_json(path, one)
    return paths


def sweep(keys: list[str] = KEYS[:1], name: str = "EchoSegnet", **changes: Any) -> list[Scores]:
    """A score file per threshold of the paper."""
    return [
        made(
            name, (round(1 - threshold, 2),) * 2, keys,
            dataset=PARTIAL, runtime=runtime(voting_threshold=threshold, seconds=7 * threshold, **changes),
        )
        for threshold in paper.TABLE_3
    ]  # fmt: skip


TABLE_2 = """\
# Table 2: methods and parts

## open-s34-o7 1.0.0, 12 observations

Protocols official 1.0 and strict 1.0.

![Table 2: methods and parts](table2.svg)

### Part 1, single-instance (n = 6)

| method | official mIoU | paper | official F | paper | strict IoU | strict F | strict wrong instance |
| :-- | --: | --: | --: | --: | --: | --: | --: |
| EchoSegnet, spatial | 0.900 (0.880–0.920) | – | 0.890 (0.870–0.910) | – | 0.900 (0.880–0.920) | 0.890 (0.870–0.910) | – |
| EchoSegnet | 0.800 (0.780–0.820) | 0.823 | 0.790 (0.770–0.810) | 0.730 | 0.800 (0.780–0.820) | 0.790 (0.770–0.810) | – |
| EchoSegnet without AISRM | 0.700 (0.680–0.720) | 0.761 <sup>1</sup> | 0.690 (0.670–0.710) | 0.628 <sup>1</sup> | 0.700 (0.680–0.720) | 0.690 (0.670–0.710) | – |
| DenseAV | 0.400 (0.380–0.420) | 0.426 | 0.390 (0.370–0.410) | 0.023 | 0.400 (0.380–0.420) | 0.390 (0.370–0.410) | – |
| *all black* | 0.310 | – | 0.031 | – | 0.000 | 0.000 | – |
| *all white* | 0.016 | – | 0.031 | – | 0.024 | 0.031 | – |
| *centre box* | 0.270 | – | 0.072 | – | 0.055 | 0.072 | – |
| *deaf: every instance* | 0.930 | – | 0.950 | – | 0.940 | 0.950 | – |
| *deaf: most seen* | 0.840 | – | 0.830 | – | 0.830 | 0.840 | – |

In the paper, and not among these files (mIoU / F): OWOD-BIND 0.693 / 0.523.

### Part 2, multi-instance (n = 6)

| method | official mIoU | paper | official F | paper | strict IoU | strict F | strict wrong instance |
| :-- | --: | --: | --: | --: | --: | --: | --: |
| EchoSegnet, spatial | 0.850 (0.830–0.870) | – | 0.840 (0.820–0.860) | – | 0.850 (0.830–0.870) | 0.840 (0.820–0.860) | 0.830 (0.810–0.850) |
| EchoSegnet | 0.750 (0.730–0.770) | 0.801 | 0.740 (0.720–0.760) | 0.714 | 0.750 (0.730–0.770) | 0.740 (0.720–0.760) | 0.730 (0.710–0.750) |
| EchoSegnet without AISRM | 0.650 (0.630–0.670) | 0.757 <sup>1</sup> | 0.640 (0.620–0.660) | 0.609 <sup>1</sup> | 0.650 (0.630–0.670) | 0.640 (0.620–0.660) | 0.630 (0.610–0.650) |
| DenseAV | 0.350 (0.330–0.370) | 0.436 | 0.340 (0.320–0.360) | 0.023 | 0.350 (0.330–0.370) | 0.340 (0.320–0.360) | 0.330 (0.310–0.350) |
| *all black* | 0.310 | – | 0.031 | – | 0.000 | 0.000 | 0.000 |
| *all white* | 0.016 | – | 0.031 | – | 0.024 | 0.031 | 1.000 |
| *centre box* | 0.270 | – | 0.072 | – | 0.055 | 0.072 | 0.280 |
| *deaf: every instance* | 0.930 | – | 0.950 | – | 0.940 | 0.950 | 1.000 |
| *deaf: most seen* | 0.840 | – | 0.830 | – | 0.830 | 0.840 | 0.480 |

In the paper, and not among these files (mIoU / F): OWOD-BIND 0.696 / 0.502.

- Higher is better, except strict wrong instance. In brackets: 95 % interval, bootstrap over observations. *Slanted*: reference rows; deaf: true masks chosen without sound.
- paper: Sokolov, Bhosale, Zhu: 3D Audio-Visual Segmentation, 2024, arXiv:2411.02236; measured on 3DAVS-S34-O7.
- <sup>1</sup> masks oracle (category), in the paper OWOD-BIND; iterations 7,000, in the paper 30,000.
- No row of the paper for EchoSegnet, spatial: variant spatial is not the paper's.
"""  # noqa: E501 - a line of a table is a line

TABLE_3 = """\
# Table 3: voting thresholds

## open-s34-o7 1.0.0, 1 of 34 observations

Protocol official 1.0.

A part of the dataset, so no score of the benchmark: `part_1/flat/bathroom/1`.

![Table 3: voting thresholds](table3.svg)

### EchoSegnet (n = 1)

| threshold | official mIoU | paper | official F | paper |
| :-- | --: | --: | --: | --: |
| 0.7 | 0.300 | 0.335 <sup>1</sup> | 0.290 | 0.028 <sup>1</sup> |
| 0.45 | 0.600 | – | 0.590 | – |
| 0.3 | 0.900 | 0.901 <sup>1</sup> | 0.890 | 0.949 <sup>1</sup> |
| *all black* | 0.310 | – | 0.031 | – |
| *all white* | 0.016 | – | 0.031 | – |
| *centre box* | 0.270 | – | 0.072 | – |

- Higher is better. In brackets: 95 % interval, bootstrap over observations. *Slanted*: reference rows; deaf: true masks chosen without sound.
- paper: Sokolov, Bhosale, Zhu: 3D Audio-Visual Segmentation, 2024, arXiv:2411.02236; measured on 3DAVS-S34-O7 (sT4fr6TAbpF, bathroom, vacuum cleaner alone).
- <sup>1</sup> masks oracle (sounding), in the paper OWOD-BIND.
"""  # noqa: E501


def four_methods() -> list[Scores]:
    return [
        made("DenseAV", (0.4, 0.35)),
        made("EchoSegnet", (0.8, 0.75), runtime=runtime()),
        made("EchoSegnet, spatial", (0.9, 0.85), runtime=runtime(variant="spatial")),
        made(
            "EchoSegnet without AISRM", (0.7, 0.65),
            runtime=runtime(aisrm=False, masks="oracle (category)", iterations=7000),
        ),
    ]  # fmt: skip


def three_thresholds() -> list[Scores]:
    return [
        made(
            "EchoSegnet", (value, value), KEYS[:1], protocols=("official",), dataset=PARTIAL,
            runtime=runtime(voting_threshold=threshold, masks="oracle (sounding)"),
        )
        for threshold, value in ((0.3, 0.9), (0.7, 0.3), (0.45, 0.6))
    ]  # fmt: skip


@pytest.mark.slow
def test_table_2_is_this_text(tmp_path: Path) -> None:
    written = write_tables(tmp_path / "out", save(tmp_path, *four_methods()))
    assert [path.name for path in written] == ["table2.md", "table2.csv", "table2.png", "table2.svg"]
    assert written[0].read_text(encoding="utf-8") == TABLE_2


def test_table_3_is_this_text(tmp_path: Path) -> None:
    written = write_tables(tmp_path / "out", save(tmp_path, *three_thresholds()), which="3")
    assert [path.name for path in written] == ["table3.md", "table3.csv", "table3.png", "table3.svg"]
    assert written[0].read_text(encoding="utf-8") == TABLE_3


def test_the_figures_of_the_paper() -> None:
    assert {row: [(f["mIoU"], f["F"]) for f in parts.values()] for row, parts in paper.TABLE_2.items()} == {
        "EchoSegnet without AISRM": [(0.761, 0.628), (0.757, 0.609)],
        "EchoSegnet with AISRM": [(0.823, 0.730), (0.801, 0.714)],
        "DenseAV": [(0.426, 0.023), (0.436, 0.023)],
        "OWOD-BIND": [(0.693, 0.523), (0.696, 0.502)],
    }
    assert all(list(parts) == ["part_1", "part_2"] for parts in paper.TABLE_2.values())
    assert {threshold: (f["mIoU"], f["F"]) for threshold, f in paper.TABLE_3.items()} == {
        0.9: (0.333, 0.028), 0.8: (0.333, 0.028), 0.7: (0.335, 0.028), 0.6: (0.352, 0.104), 0.5: (0.396, 0.241),
        0.4: (0.897, 0.948), 0.3: (0.901, 0.949), 0.2: (0.901, 0.949), 0.1: (0.901, 0.948),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("method", "said", "row", "remark"),
    [
        ("EchoSegnet", runtime(), "EchoSegnet with AISRM", None),
        ("anything at all", runtime(aisrm=False), "EchoSegnet without AISRM", None),
        ("EchoSegnet, official, masks: oracle", runtime(method=...), "EchoSegnet with AISRM", None),
        ("EchoSegnet", runtime(masks="owod_bind"), "EchoSegnet with AISRM", None),
        ("EchoSegnet", runtime(masks="oracle"), "EchoSegnet with AISRM", "masks oracle, in the paper OWOD-BIND"),
        ("EchoSegnet", runtime(masks=...), "EchoSegnet with AISRM", "masks not said, in the paper OWOD-BIND"),
        ("EchoSegnet", runtime(voting_threshold=0.5), "EchoSegnet with AISRM",
         "voting threshold 0.5, in the paper 0.3"),
        ("EchoSegnet", runtime(iterations=7000), "EchoSegnet with AISRM", "iterations 7,000, in the paper 30,000"),
        ("EchoSegnet", runtime(variant="spatial"), None, "variant spatial is not the paper's"),
        ("EchoSegnet", runtime(aisrm=1), None, "aisrm 1 in submission.json: expected true or false"),
        ("EchoSegnet", None, None, "the runtime in submission.json does not say variant and aisrm"),
        ("EchoSegnet", "12 s", None, "the runtime in submission.json does not say variant and aisrm"),
        ("EchoSegnet", {"variant": "official"}, None, "the runtime in submission.json does not say aisrm"),
        ("denseav", None, "DenseAV", None),
        ("DenseAV, same masks", None, "DenseAV", None),
        ("OWOD-BIND (MAVL, SAM, ImageBind)", None, "OWOD-BIND", None),
        ("OWOD-BIND (OWLv2, SAM, PE-AV)", None, "OWOD-BIND",
         "networks OWLv2, SAM, PE-AV, in the paper MAVL, SAM, ImageBind"),
        ("mine", {"method": "owod-bind"}, "OWOD-BIND", "networks not said, in the paper MAVL, SAM, ImageBind"),
        ("EchoSegnet2", runtime(method=...), None, "not one of the paper's methods"),
        ("Not EchoSegnet", None, None, "not one of the paper's methods"),
        ("DenseAV", {"method": "mine"}, None, "not one of the paper's methods"),
        ("(DenseAV)", None, None, "not one of the paper's methods"),
    ],
)  # fmt: skip
def test_a_row_of_the_paper_is_matched_by_what_submission_json_says(
    method: str, said: Any, row: str | None, remark: str | None
) -> None:
    found = paper.match(SubmissionRecord(method=method, dataset="d", dataset_version="1", runtime=said))
    assert found.row == row
    assert bool(found.why) == (row is None)
    assert (found.why if row is None else "; ".join(found.differs) or None) == remark


def test_the_paper_swept_echosegnet_and_nothing_else() -> None:
    def record(method: str, said: Any) -> SubmissionRecord:
        return SubmissionRecord(method=method, dataset="d", dataset_version="1", runtime=said)

    assert paper.match_sweep(record("EchoSegnet", runtime(voting_threshold=0.9))) == paper.Match(paper.SWEEP)
    spatial = paper.match_sweep(record("EchoSegnet", runtime(variant="spatial", aisrm=False)))
    assert spatial.differs == ("variant spatial, in the paper official", "AISRM off")
    assert paper.match_sweep(record("mine", {"voting_threshold": 0.9})).row is None


def test_pandas_reads_the_csv_back(tmp_path: Path) -> None:
    entries = read_entries(save(tmp_path, *four_methods(), *sweep(), example_scores(34, seed=5, method='a, "b"\nc')))
    for table in (table_2(entries), table_3(entries)):
        assert table is not None
        (tmp_path / "table.csv").write_text(csv(table), encoding="utf-8")
        read = pd.read_csv(tmp_path / "table.csv")
        pd.testing.assert_frame_equal(
            read, pd.DataFrame(records(table)).astype(read.dtypes.to_dict()), check_exact=True
        )


def test_the_csv_holds_the_figures_of_the_files(tmp_path: Path) -> None:
    scores = example_scores(34, seed=4, method="mine")
    data = pd.DataFrame(records(table_2(read_entries(save(tmp_path, scores)))))
    mine = data[data["kind"] == "method"].set_index("part")
    for part, group in scores.parts.items():
        row = mine.loc[part]
        assert group.official is not None
        assert group.strict is not None
        written = (row["official_mIoU"], row["official_F"], row["strict_IoU"], row["observations"])
        assert written == pytest.approx(
            (group.official.mIoU, group.official.F, group.strict.IoU, group.observations), rel=1e-8
        )
        low, high = group.official.intervals["F"]
        assert (row["official_F_low"], row["official_F_high"]) == pytest.approx((low, high), rel=1e-8)
    assert mine["strict_wrong_instance_rate"].isna().to_dict() == {"part_1": True, "part_2": False}
    assert list(data[data["kind"] == "reference"]["method"].unique()) == [REFERENCE_TITLES[name] for name in REFERENCES]


@pytest.mark.slow
def test_pictures_decode_and_are_the_same_bytes_again(tmp_path: Path) -> None:
    files = save(tmp_path, *four_methods(), *sweep())
    first = write_tables(tmp_path / "one", files)
    script = (
        "import sys, matplotlib as mpl; from pathlib import Path\n"
        "from evaluators.reporting.tables import write_tables\n"
        "mpl.rcParams['font.size'] = 30\n"  # as a user's matplotlibrc might
        "write_tables(Path(sys.argv[1]), [Path(a) for a in sys.argv[2:]])"
    )
    environment = os.environ | {"PYTHONHASHSEED": "7", "SOURCE_DATE_EPOCH": "1"}
    again = [sys.executable, "-c", script, str(tmp_path / "two"), *map(str, reversed(files))]
    subprocess.run(again, check=True, env=environment)
    assert {path.name: path.read_bytes() for path in first} == {
        path.name: path.read_bytes() for path in (tmp_path / "two").iterdir()
    }
    for path in first:
        if path.suffix == ".png":
            picture = cv2.imread(str(path))
            assert picture is not None
            assert min(picture.shape[:2]) > 500
            assert (picture[0] == 255).all()
            assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
        if path.suffix == ".svg":
            root = ElementTree.fromstring(path.read_bytes())
            assert root.tag == "{http://www.w3.org/2000/svg}svg"
            assert b"dc:date" not in path.read_bytes()


def marks(panel: Any, marker: str) -> list[tuple[float, float]]:
    lines = [line for line in panel.lines if line.get_marker() == marker]
    return [(float(x), float(y)) for line in lines for x, y in line.get_xydata()]


def test_table_2_draws_what_it_says(tmp_path: Path) -> None:
    from evaluators.reporting.tables_plot import methods_figure

    (section,) = table_2(read_entries(save(tmp_path, *four_methods()))).sections
    panels = methods_figure(section).axes
    assert [panel.get_title(loc="left") for panel in panels] == ["mIoU", "F", "IoU", "F", "wrong instance"]
    assert sorted(x for x, _ in marks(panels[0], "o")) == [0.35, 0.4, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9]
    assert sorted(x for x, _ in marks(panels[0], "D")) == [0.426, 0.436, 0.757, 0.761, 0.801, 0.823]
    assert not marks(panels[2], "D")  # the paper has no strict figures
    # A hollow mark stands in the row of its method and part.
    rows = {y: x for x, y in marks(panels[0], "o")}
    assert {rows[y]: x for x, y in marks(panels[0], "D")} == {
        0.8: 0.823, 0.75: 0.801, 0.7: 0.761, 0.65: 0.757, 0.4: 0.426, 0.35: 0.436,
    }  # fmt: skip
    whiskers = [xy[:, 0].tolist() for line in panels[0].lines if len(xy := np.asarray(line.get_xydata())) == 2]
    assert [0.78, 0.82] in whiskers
    assert len(whiskers) == 8


def test_table_3_draws_the_curve_and_the_papers(tmp_path: Path) -> None:
    from evaluators.reporting.tables_plot import thresholds_figure

    table = table_3(read_entries(save(tmp_path, *sweep())))
    assert table is not None
    for panel, metric, offset in zip(
        thresholds_figure(table.sections[0]).axes, ("mIoU", "F"), (0.0, 0.01), strict=True
    ):
        ours = dict(marks(panel, "o"))
        assert ours == pytest.approx({t: 1 - t - offset for t in paper.TABLE_3}, abs=1e-9)
        assert dict(marks(panel, "D")) == {t: figures[metric] for t, figures in paper.TABLE_3.items()}
        (dashed,) = [line for line in panel.lines if line.get_marker() == "D"]
        assert dashed.is_dashed()


DIFFERENT: dict[str, dict[str, Any]] = {
    "bytes": {"dataset": {"sha256": "0" * 64}},
    "version": {"dataset": {"version": "2.0.0", "sha256": None}},
    "name": {"dataset": {"name": "another", "sha256": None}},
    "protocol": {"evaluator": {"protocols": {"official": "1.0", "strict": "2.0"}}},
    "protocols": {"protocols": ("official",)},
    "part of the dataset": {"keys": KEYS[:9], "dataset": {"observations": 12, "sha256": None}},
    "another part": {"keys": KEYS[3:], "dataset": {"observations": 12, "sha256": None}},
}


@pytest.mark.slow
def test_what_does_not_compare_gets_a_section_of_its_own(tmp_path: Path) -> None:
    scores = [made("ours", (0.6, 0.5)), made("also ours", (0.5, 0.5))]
    scores += [made(name, (0.99, 0.99), **options) for name, options in DIFFERENT.items()]
    table = table_2(read_entries(save(tmp_path, *scores)))
    groups = [{row.title for row in section.rows if row.entry} for section in table.sections]
    assert groups[0] == {"ours", "also ours"}
    assert sorted(map(sorted, groups[1:])) == sorted([name] for name in DIFFERENT)
    written = write_tables(tmp_path / "out", sorted(tmp_path.glob("*.json")), which="2")
    text = written[0].read_text(encoding="utf-8")
    assert "8 sections: what stands in different ones was scored on other data" in text
    assert text.count("9 of 12 observations") == 2
    pictures = [path.name for path in written if path.suffix == ".svg"]
    assert pictures == ["table2.svg"] + [f"table2-{number}.svg" for number in range(2, 9)]
    assert re.findall(r"\((table2.*?\.svg)\)", text) == pictures


def test_another_truth_under_the_same_name_gets_a_section_of_its_own(tmp_path: Path) -> None:
    # Two official releases have neither version nor sha256: only the reference rows show that their masks differ.
    one, two = (example_scores(KEYS, seed=1, method=name, release=True) for name in ("one", "two"))
    data = two.model_dump(mode="json")
    data["references"]["all_black"]["part_1"]["official"]["mIoU"] += 0.01
    table = table_2(read_entries(save(tmp_path, one, Scores.model_validate(with_means(data)))))
    titles = [[row.title for row in s.rows if row.entry and row.part == "part_1"] for s in table.sections]
    assert sorted(titles) == [["one"], ["two"]]  # their order is that of the files' digests


def test_a_sweep_over_other_observations_is_in_table_3_alone(tmp_path: Path) -> None:
    written = write_tables(tmp_path / "out", save(tmp_path, *four_methods(), *sweep()), plot=False)
    second, _, third, _ = (path.read_text(encoding="utf-8") for path in written)
    assert second.endswith(
        "Series of voting thresholds are in Table 3 alone: open-s34-o7 1.0.0, 1 of 34 observations.\n"
    )
    assert len(re.findall("^## ", second, re.M)) == 1
    assert re.findall(r"^\| (0\.\d) ", third, re.M) == [f"0.{n}" for n in range(9, 0, -1)]


def test_of_a_sweep_table_2_has_the_run_at_the_papers_threshold(tmp_path: Path) -> None:
    entries = read_entries(save(tmp_path, *sweep(), made("other", (0.1, 0.1), KEYS[:1], dataset=PARTIAL)))
    (section,) = table_2(entries).sections
    assert section.swept == 8
    shown = [row.entry.scores.submission.runtime for row in section.rows if row.entry]
    assert [said["voting_threshold"] if isinstance(said, dict) else None for said in shown] == [0.3, None]


def test_series_are_told_apart_by_their_settings(tmp_path: Path) -> None:
    scores = [*sweep(), *sweep(variant="spatial"), *sweep(name="mine", method="mine")]
    table = table_3(read_entries(save(tmp_path, *scores)))
    assert table is not None
    rows = [row for row in table.sections[0].rows if row.entry]
    assert {title: len(list(group)) for title, group in itertools.groupby(rows, lambda row: row.title)} == {
        "EchoSegnet (variant official)": 9, "EchoSegnet (variant spatial)": 9, "mine": 9,
    }  # fmt: skip
    assert {row.title for row in rows if row.paper} == {"EchoSegnet (variant official)", "EchoSegnet (variant spatial)"}


def test_one_name_twice_is_told_apart(tmp_path: Path) -> None:
    scores = [made("mine", (0.5, 0.5), runtime={"iterations": n, "seed": s}) for n, s in ((10, 0), (20, 0))]
    scores += [made("same", (value, value)) for value in (0.3, 0.2)]
    (section,) = table_2(read_entries(save(tmp_path, *scores))).sections
    titles = [row.title for row in section.rows if row.entry and row.part == "part_1"]
    assert sorted(titles[:2]) == ["mine (iterations 10)", "mine (iterations 20)"]
    assert all(re.fullmatch(r"same \[[0-9a-f]{7}\]", title) for title in titles[2:])
    assert len(set(titles)) == 4


def test_the_same_threshold_twice_is_refused(tmp_path: Path) -> None:
    files = save(tmp_path, *sweep(), made("EchoSegnet", (0.1, 0.1), KEYS[:1], dataset=PARTIAL, runtime=runtime()))
    with pytest.raises(Avs3dError, match=r"6\.json, .*9\.json: both have voting threshold 0\.3 and the same method"):
        write_tables(tmp_path / "out", files)
    assert not (tmp_path / "out").exists()


def test_hostile_names_stay_in_their_cell(tmp_path: Path) -> None:
    name = "a|b\n| c | <script>alert(1)</script> $x_1$ [l](http://x) `t` \x1b[31m"
    (path, *_) = write_tables(tmp_path / "out", save(tmp_path, made(name, (0.5, 0.5))))
    text = path.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {7}  # a name and five figures
    assert "<script>" not in text
    assert "\x1b" not in text
    assert not re.search(r"(?<!\\)[<$`\[]", next(line for line in lines if "alert" in line))


@pytest.mark.filterwarnings("error")
def test_a_version_of_thousands_of_digits_leaves_the_axes_their_room(tmp_path: Path) -> None:
    (file,) = save(tmp_path, made("a", (0.5, 0.5)))
    content = json.loads(file.read_text())
    content["dataset"]["version"] = "9" * 5000
    file.write_text(json.dumps(content))
    assert write_tables(tmp_path / "out", [file])


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[Any, str, list[str]]:
    """(exit code, stdout, lines of stderr)."""
    with pytest.raises(SystemExit) as caught:
        cli.run(cli.avs3d, ["tables", *map(str, arguments)])
    out = capsys.readouterr()
    return caught.value.code, out.out, out.err.splitlines()


def test_the_command_names_what_it_wrote(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, errors = call(capsys, *save(tmp_path, *four_methods()), "-o", tmp_path / "out", "--no-plot")
    assert (code, errors) == (0, [])
    assert out.split() == [str(tmp_path / "out" / name) for name in ("table2.md", "table2.csv")]
    assert "table2.svg" not in (tmp_path / "out" / "table2.md").read_text(encoding="utf-8")


BROKEN: dict[str, tuple[str, str]] = {
    "truncated": ('{"avs3d_eval": {', "no valid JSON|Invalid JSON"),
    "empty": ("", "no valid JSON|Invalid JSON"),
    "not scores": ('{"method": "m"}', "avs3d_eval"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, said = BROKEN[name]
    (good,) = save(tmp_path, made("mine", (0.5, 0.5)))
    (tmp_path / "broken.json").write_text(text)
    code, out, errors = call(capsys, good, tmp_path / "broken.json", "-o", tmp_path / "out")
    assert (code, out, len(errors)) == (1, "", 1)
    assert "broken.json" in errors[0]
    assert re.search(said, errors[0])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("value", ["high", True, -0.1, 1.5])
def test_a_threshold_that_is_none_is_one_line(value: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = save(tmp_path, made("mine", (0.5, 0.5), runtime=runtime(voting_threshold=value)))
    code, _, errors = call(capsys, *files, "-o", tmp_path / "out")
    assert (code, len(errors)) == (1, 1)
    assert f"0.json: submission.runtime.voting_threshold: found {value!r}, expected a number from 0 to 1" in errors[0]


def test_missing_files_and_folders_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, tmp_path / "none.json", "-o", tmp_path / "out")[0] == 1
    assert call(capsys, tmp_path, "-o", tmp_path / "out")[0] == 1
    assert call(capsys, "-o", tmp_path / "out")[0] == 2
    data = made("mine", (0.5, 0.5)).model_dump(mode="json") | {"parts": {}}
    files = save(tmp_path, Scores.model_validate(data))
    code, _, errors = call(capsys, *files, "-o", tmp_path / "out")
    assert (code, len(errors)) == (1, 1)
    assert "0.json: parts: part_1 is missing" in errors[0]


def test_table_3_without_a_series(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = save(tmp_path, *four_methods())
    code, _, errors = call(capsys, *files, "-o", tmp_path / "out", "--table", "3")
    assert (code, len(errors)) == (2, 1)
    assert "no series for Table 3; expected two or more files that differ in runtime.voting_threshold" in errors[0]
    with pytest.raises(UsageError):
        write_tables(tmp_path / "out", [], which="2")


def test_without_matplotlib_a_line_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    files = save(tmp_path, *four_methods())
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, _, errors = call(capsys, *files, "-o", tmp_path / "out")
    assert (code, len(errors)) == (1, 1)
    assert "matplotlib is not installed; plotting needs it: pip install 'avs3d-bench[plot]'" in errors[0]
    assert call(capsys, *files, "-o", tmp_path / "out", "--no-plot")[0] == 0


def test_a_file_of_scores_is_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (file,) = save(tmp_path, made("mine", (0.5, 0.5)))
    named = file.rename(tmp_path / "table2.csv")
    before = named.read_bytes()
    code, _, errors = call(capsys, named, "-o", tmp_path)
    assert (code, len(errors)) == (2, 1)
    assert f"table2.csv: would overwrite {named}, which is read" in errors[0]
    assert named.read_bytes() == before


def test_the_tables_need_nothing_heavy_before_they_draw() -> None:
    modules = "evaluators.reporting.tables, evaluators.reporting.tables_markdown"
    code = f"import sys, {modules}; print({{'matplotlib', 'pandas'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
