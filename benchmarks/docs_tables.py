"""`make docs-tables`: every table of recorded figures in README.md and docs/, from docs/results/ and docs/bench.json.

    python -m benchmarks.docs_tables            # write the pages
    python -m benchmarks.docs_tables --check    # name those that are not current

A table stands between ``<!-- NAME -->`` and ``<!-- end of NAME -->``; `blocks` says which page has which. The pages of
the listener's datasets (`benchmarks.listener_page`), the leaderboard (`benchmarks.leaderboard_page`) and the paper's
tables (`avs3d tables`) are written as a whole.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import click

from avs3d_bench.contract.questions import KindScore, QaScores
from avs3d_bench.contract.scores import PAIR_KINDS, GroupScores, Scores
from avs3d_bench.contract.taxonomy import CATEGORIES, OFF_SCREEN_CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_bytes
from avs3d_bench.formats.media import read_record
from baselines.references import REFERENCES
from baselines.sound_control import SOUND_CONTROLS
from benchmarks import (
    ablation_tables,
    bandwidths,
    comparison_power,
    home_coverage,
    leaderboard_page,
    leaks,
    listener_aims,
    listener_best,
    listener_page,
    listener_seeds,
    picture_statistics,
    receivers,
    separability,
    sound_rows,
    voices,
)
from benchmarks.listener_summary import MISSING, share, table
from benchmarks.recorded_manifests import MANIFESTS
from benchmarks.run import TARGETS
from evaluators.reporting import table_contents, tables_markdown
from evaluators.reporting.leaderboard import read_entries
from evaluators.reporting.pages import REFERENCE_TITLES
from evaluators.reporting.paper import TABLE_2, TABLE_3
from generators.assets import sounds
from generators.library.lock import LOCK_NAME, read_lock

ROOT = Path(__file__).parent.parent
#: In place of a table of rows that the present weights do not have.
UNMEASURED = "Not measured with the present weights."
#: Masks of train frames by the oracle, in the names of files and in tables.
MASKS = {"ambiguous": "category", "sounding": "sounding"}
#: EchoSegnet, in the names of files and in tables.
VARIANTS = {"no-aisrm": "official, no AISRM", "official": "official", "spatial": "**spatial**"}
#: Version of the pictures that docs/light.md has tables of, and the kinds of material and of surface in them.
LIGHT, LIGHT_KINDS = "4.0.0", ("diffuse", "glossy", "metal", "all")
LIGHT_SURFACES = ("walls", "floor", "ceiling", "furniture", "objects")
#: Figures of ``listen`` in tables.
LISTEN = ("pair_accuracy", "IoU", "class_mIoU", "FP_rate")


def figures(group: GroupScores | None, protocol: str, *names: str) -> list[str]:
    """Figures of a group, in a protocol, as text."""
    found: Any = getattr(group, protocol, None)
    return [share(getattr(found, name, None)) for name in names]


def text(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    return "\n".join(table(head, rows)).rstrip()


def scored_text(document: Mapping[str, Any]) -> str:
    """Which dataset and version figures are of, and how many observations."""
    return f"Measured on {document['scored']} observations of `{document['dataset']}` {document['version']}."


class Results:
    """The tables whose figures are in a folder of results.

    Args:
        folder: docs/results.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def scores(self, name: str) -> Scores:
        """A file of scores."""
        return read_record(self.folder / f"{name}.json", Scores)

    def json(self, name: str) -> Any:
        """Another file."""
        return read_json(self.folder / f"{name}.json")

    def power(self) -> str:
        """Errors of `avs3d compare` in a simulation."""
        return "\n".join(comparison_power.tables(self.json("comparison-power")))

    def light(self) -> str:
        """Agreement with the path tracer, by kind of material."""
        found = self.json("light-reference")[LIGHT]
        rows = []
        for room, kinds in found["rooms"].items():
            for kind in LIGHT_KINDS:
                one = kinds[kind]
                shares = [f"{one[name]:.1%}" for name in ("median", "p90")]
                rows.append([room, kind, f"{one['pixels']:,}", *shares, f"{one['ratio']:.3f}", f"{one['noise']:.1%}"])
        rows += [["all rooms", kind, "", f"{found['median'][kind]:.1%}", "", "", ""] for kind in LIGHT_KINDS]
        head = ["room", "surfaces", "pixels", "median difference", "90th percentile", "ours over reference", "noise"]
        return text(head, rows)

    def light_surfaces(self) -> str:
        """Agreement with the path tracer, by class of surface: median difference and ratio of the means."""
        rows = []
        for room, kinds in self.json("light-reference")[LIGHT]["rooms"].items():
            found = [kinds[name] for name in LIGHT_SURFACES]
            rows.append([room, *(f"{one['median']:.1%}, {one['ratio']:.3f}" for one in found)])
        return text(["room", *LIGHT_SURFACES], rows)

    def scans(self) -> str:
        """Simulated phone scans as they are read, beside their truth."""
        rows = []
        for scan, found in self.json("scan-truth").items():
            for name, room in found["rooms"].items():
                head = [scan, f"{found['faces']:,}", name.replace("_", " ")]
                if room is None:
                    rows.append([*head, "not found", *[MISSING] * 4])
                    continue
                tops, t30, light = room["tops"], room["T30 (s)"], room["light"]
                rows.append(
                    [
                        *head,
                        f"{100 * room['largest error of the box (m)']:.0f} cm",
                        f"{tops['true']}; {tops['found']}",
                        f"{t30['true']:.2f} s; {t30['scan']:.2f} s"
                        if t30["scan"]
                        else f"{t30['true']:.2f} s; {MISSING}",
                        f"{light['bias (stops)']:+.1f} stops".replace("-", "−"),
                        f"{light['angle (degrees)']:.0f}°",
                    ]
                )
        head = ["scan", "faces", "room", "box", "tops: true; found", "T30: true; scan", "light", "its direction"]
        return text(head, rows)

    def guesses(self) -> str:
        """Guesses with perfect masks under ``listen``."""
        document = self.json("listen-chance")
        found = document["guesses"]
        known = {
            "instance": ("nothing", "one instance at random"),
            "presence, instance": ("whether a source is audible", "nothing, or one instance at random"),
            "category, one": ("which categories are audible", "one instance at random of each"),
            "category, all": ("which categories are audible", "all their instances"),
        }
        figures = ("twins", "pair_accuracy", *PAIR_KINDS[1:])
        rows = [[*said, *(share(found[n].get(name)) for name in figures)] for n, said in known.items()]
        return f"{text(['known from the sound', 'marked', *figures], rows)}\n\n{scored_text(document)}"

    def references(self) -> str:
        """The reference rows of place under ``listen``."""
        names = ("twins", "pair_accuracy", *PAIR_KINDS[1:], "IoU")
        document = self.json("listen-references")
        rows = [[row, *(share(document["references"][row][name]) for name in names)] for row in REFERENCES]
        return f"{text(['row', *names], rows)}\n\n{scored_text(document)}"

    def qa(self) -> str:
        """Answers to questions without a language model."""
        rows = {name: read_record(self.folder / f"qa-{name}.json", QaScores) for name in ("spatial", "blind", "deaf")}
        first = rows["spatial"]
        found: dict[str, dict[str, KindScore]] = {
            **{kind: {name: row.kinds[kind] for name, row in rows.items()} for kind in first.kinds},
            "all": {name: row.overall for name, row in rows.items()},
        }
        lines = [
            [kind, str(by["spatial"].lines), share(by["spatial"].chance),
             *(f"{share(one.accuracy)} / {share(one.pair_accuracy)}" for one in by.values())]
            for kind, by in found.items()
        ]  # fmt: skip
        source = f"Accuracy / pair accuracy on {first.overall.groups} groups of `{first.questions.dataset}` "
        return f"{text(['kind', 'lines', 'chance', *rows], lines)}\n\n{source}{first.questions.dataset_version}."

    def states(self) -> str:
        """What recognisers know of dry and of reverberant seconds."""
        rows = separability.states_table(self.json("separability"))
        return text(["recogniser", "asked about", *separability.STATES], rows)

    def separability(self) -> str:
        """Seconds and takes that recognisers assign to the right category."""
        head = ["recogniser", "asked about", *separability.CHANGES]
        return text(head, separability.shares_table(self.json("separability")))

    def confusions(self, asked: str) -> str:
        """What the network, or the nearest neighbour where none was trained, takes the seconds of a set for."""
        report = self.json("separability")
        found = report.get("network", report["nearest neighbour"])[asked]["whole"]
        return text(["sounds \\ taken for", *CATEGORIES], separability.confusions_table(found))

    def spread(self) -> str:
        """Voices and recordings within the spread of the recordings."""
        head = ["category", "recordings", "of them within the spread of the others", "voices within it", "outside, dB"]
        return text(head, voices.spread_table(self.json("voices")))

    def leaks(self, part: str) -> str:
        """How often rules without access to the sound choose what sounds."""
        return text(*leaks.table(self.json("leaks"), self.json("leaks-control"), part))

    def bandwidths(self) -> str:
        """Bandwidth and floor of recordings and of voices."""
        figures = ("takes", "bandwidth (kHz)", "floor (dB)")
        head = ["category", *(f"{whose}: {one}" for whose in ("recordings", "voices") for one in figures)]
        return text(head, bandwidths.table(self.json("bandwidths")))

    def seeds(self) -> dict[str, Any]:
        """Figures of the listener's runs, by names of `listener_seeds.RUNS`."""
        return {run: self.json("-".join(["listener-seeds", *filter(None, [run])])) for run in listener_seeds.RUNS}

    def listener_summary(self) -> str:
        """The listener's answers on voices and recordings, beside what needs no network under ``listen``."""
        rows = listener_seeds.summary_rows(self.seeds()["package"])
        guess = self.json("listen-chance")["guesses"]["category, one"]
        delay = self.json("listen-references")["references"]["gcc-phat"]
        for title, found in (("guess", guess), ("delay between the ears", delay)):
            figures = [share(found[name]) for name in ("pair_accuracy", "twins")]
            rows.append([f"{title}, with perfect masks", *[MISSING] * 4, *figures])
        return text(["method", *listener_seeds.SUMMARY], rows)

    def listener_aims(self) -> str:
        """The aims of the listener beside what was measured."""
        runs = self.seeds()
        rows = listener_aims.aim_rows(runs["package"], runs[""])
        return text(["aim", "package", listener_seeds.RUNS[""], ""], rows)

    def seeds_strict(self) -> str:
        """Strict IoU of the listener's training seeds."""
        columns = [f"{part}, {title}" for part in listener_seeds.PARTS for title in listener_seeds.RUNS.values()]
        head = ["sounds, heads, models", "answer", *columns]
        return text(head, listener_seeds.strict_rows(self.seeds()))

    def seeds_listen(self) -> str:
        """Figures of the listener's training seeds under ``listen``."""
        names = [name.replace("_", " ") for name in sound_rows.LISTEN_FIGURES]
        rows = listener_seeds.listen_rows(self.seeds())
        return text(["sounds", "answer", "weights", *names], rows) if rows else UNMEASURED

    def seeds_categories(self) -> str:
        """Strict IoU of the package by category."""
        head = ["answer", *(name.replace("_", " ") for name in CATEGORIES)]
        return text(head, listener_seeds.category_rows(self.seeds()["package"]))

    def seeds_classes(self) -> str:
        """What the listener sees, by category, and how sure it is."""
        runs = self.seeds()
        columns = listener_seeds.class_columns(runs)
        titles = [f"{listener_seeds.TESTS[data]}, {listener_seeds.RUNS[run]}" for data, run in columns]
        return text(["figure", *titles], listener_seeds.class_rows(runs))

    def runs(self) -> str:
        """Validation and calibration of the training seeds."""
        found = self.json("listener-runs")
        return text(["figure", *(name.replace("seed", "seed ") for name in found)], listener_best.rows(found))

    def sound_controls(self) -> str:
        """The package's answers with another sound in place of their own."""
        rows = listener_seeds.control_rows(self.seeds()["package"])
        return text(["sounds, heads, models", "answer", *SOUND_CONTROLS], rows) if rows else UNMEASURED

    def echosegnet_sounds(self) -> str:
        """EchoSegnet with another sound in place of its own, part_2."""
        rows = self.json("echosegnet-sounds")
        found = [[name, sound_rows.with_interval(row["part_2"]["strict_IoU"])] for name, row in rows.items()]
        return text(["`--sound`", "strict IoU, part_2"], found)

    def paper_methods(self) -> str:
        """Table 2 of the paper, beside our figures."""
        commands = {
            "DenseAV": ("`avs3d baseline denseav` with a folder of weights", None),
            "OWOD-BIND": ("`avs3d baseline owod-bind` with folders of weights", None),
            "EchoSegnet without AISRM": ("`avs3d baseline echosegnet --variant official --no-aisrm`", "no-aisrm"),
            "EchoSegnet with AISRM": ("`avs3d baseline echosegnet --variant official`", "official"),
        }
        rows = []
        for method, (command, run) in commands.items():
            paper = [f"{share(one['mIoU'])} / {share(one['F'])}" for one in TABLE_2[method].values()]
            ours, verdict = [MISSING, MISSING], "not measured: weights are not shipped"
            if run is not None:
                verdict = "not the same: other data, masks of the oracle"
                found = [self.scores(f"{masks}-{run}").parts for masks in MASKS]
                ours = [
                    "; ".join(" / ".join(figures(parts.get(part), "official", "mIoU", "F")) for parts in found)
                    for part in ("part_1", "part_2")
                ]  # fmt: skip
            rows.append([method, *paper, *ours, command, verdict])
        head = ["method", "single-instance (part_1)", "multi-instance (part_2)", "ours, part_1", "ours, part_2", "command", "verdict"]  # fmt: skip # noqa: E501
        return text(head, rows)

    def paper_thresholds(self) -> str:
        """Table 3 of the paper, beside our figures."""
        rows = []
        for threshold, paper in TABLE_3.items():
            ours = self.scores(f"voting-threshold-{threshold}").overall
            rows.append([share(threshold, 1), share(paper["mIoU"]), share(paper["F"]),
                         *figures(ours, "official", "mIoU", "F")])  # fmt: skip
        return text(["voting threshold", "mIoU", "F", "ours: mIoU", "ours: F"], rows)

    def training(self) -> str:
        """Trainings without a cap."""
        rows = [
            [one["key"], f"{one['seconds'] / 60:.1f}", f"{one['gaussians']:,}", f"{median(one['test_psnr']):.1f} dB",
             f"{min(one['test_psnr']):.1f} dB", f"{one['peak_gib']:.1f} GiB"]
            for one in self.json("training")["observations"]
        ]  # fmt: skip
        head = ["observation", "minutes, three at a time", "Gaussians", "PSNR of test views, median", "lowest", "memory of the GPU"]  # fmt: skip # noqa: E501
        return text(head, rows)

    def caps(self) -> str:
        """A cap on the number of Gaussians, and pruning by size on the screen."""
        rows = []
        runs = {"none": "no cap", "600k": "`--max-gaussians 600000`", "screen": "`--screen-pruning`"}
        for name, title in runs.items():
            (one,) = self.json(f"cap-{name}")["trainings"]
            psnr = [f"{one[key]:.1f} dB" for key in ("psnr_test_median", "psnr_train_median")]
            rows.append(
                [title, f"{one['gaussians']:,}", *psnr, f"{one['minutes']:.1f}", f"{one['peak_memory_gib']:.1f} GiB"]
            )
        head = ["", "Gaussians", "PSNR of test views, median", "of train views, median", "minutes", "memory of the GPU"]
        return text(head, rows)

    def methods(self) -> str:
        """Methods and parts, with masks of the oracle."""

        def row(masks: str, title: str, parts: dict[Any, GroupScores]) -> list[str]:
            one, several = parts["part_1"], parts["part_2"]
            return [masks, title, " / ".join(figures(one, "official", "mIoU", "F")), *figures(one, "strict", "IoU"),
                    " / ".join(figures(several, "official", "mIoU", "F")),
                    *figures(several, "strict", "IoU", "wrong_instance_rate")]  # fmt: skip

        rows = [
            row(said, title, self.scores(f"{masks}-{run}").parts)
            for masks, said in MASKS.items()
            for run, title in VARIANTS.items()
        ]
        first = self.scores("ambiguous-official")
        rows += [row(MISSING, REFERENCE_TITLES[name], dict(groups)) for name, groups in first.references.items()]
        counts = [first.parts[part].observations for part in ("part_1", "part_2")]
        head = ["masks", "variant", f"part_1 ({counts[0]})", "strict IoU", f"part_2 ({counts[1]})", "strict IoU", "wrong instance"]  # fmt: skip # noqa: E501
        return text(head, rows)

    def twins(self, name: str) -> str:
        """The choice between true and invented twins."""
        found = self.json(name)["rates"]
        titles = {"twins": "the existing twins"}
        titles |= {f"invented {d} m": f"one invented twin {d} m apart" for d in ("2", "1", "0.5")}

        def pair(kind: str, form: Callable[[Any], str]) -> str:
            return " / ".join(form(found[f"{kind} | {frames}"]) for frames in ("100%", "25%"))

        rows = [
            [title, pair(kind, lambda one: f"{one['cases']:,}"), pair(kind, lambda one: f"{100 * one['right']:.1f}")]
            for kind, title in titles.items()
        ]
        return text(["candidates", "cases, all train frames / a quarter", "right (%)"], rows)

    def calibration(self) -> str:
        """Posteriors of the choice between twins."""
        rows = [
            [f"{one['from']:g}–{one['to']:g}", f"{one['cases']:,}", f"{one['posterior']:.1f}", f"{one['right']:.1f}"]
            for one in self.json("cue-weights-unseen")["calibration"]
        ]
        return text(["posterior of the choice", "cases", "mean posterior (%)", "right (%)"], rows)

    def engines(self) -> str:
        """Both acoustic engines."""
        rows = []
        for part in ("part_1", "part_2"):
            for variant in ("official", "spatial"):
                for engine in ("tracer", "soundspaces"):
                    group = self.scores(f"engines-{engine}-{variant}").parts[part]
                    strict = figures(group, "strict", "IoU", "boundary_F", "wrong_instance_rate", "IoU_3D", "centroid_error")  # fmt: skip # noqa: E501
                    official = " / ".join(figures(group, "official", "mIoU", "F"))
                    rows.append([part, VARIANTS[variant], f"`{engine}`", official, *strict])
        head = ["part", "variant", "sound", "mIoU / F", "strict IoU", "boundary F", "wrong instance", "3D IoU", "centroid error, m"]  # fmt: skip # noqa: E501
        return text(head, rows)

    def choice(self) -> str:
        """The choice by sound in part_3, with true candidates."""
        kinds = ("silence", "off-screen", "one source", "several")
        sounding, rows = self.scores("listen-oracle-sounding"), []
        names = ("pair_accuracy", "IoU", "class_mIoU", "FP_rate")

        def row(title: str, group: GroupScores | None) -> list[str]:
            first, *rest = figures(group, "listen", *names)
            return [title, first, MISSING, *rest, *[MISSING] * len(kinds)]

        rows = [row(REFERENCE_TITLES[name], groups.get("part_3")) for name, groups in sounding.references.items()]
        rows += [row(f"oracle, {name}", self.scores(f"listen-oracle-{name}").overall) for name in ("category", "sounding")]  # fmt: skip # noqa: E501
        for name in ("official", "spatial"):
            one = self.json("listen-choice")[name]
            values = [one[key] for key in ("pair_accuracy", "pair_accuracy_one_source", *names[1:])]
            values += [one["FP_rate_by_kind"][kind] for kind in kinds]
            rows.append([VARIANTS[name], *map(share, values)])
        head = ["choice", names[0], "at most one source", *names[1:], "silence or noise", *kinds[1:]]
        return text(head, rows)

    def posteriors(self) -> str:
        """Posteriors of the choice by sound in part_3."""
        rows = [
            [f"{one['from']:g}–{one['to']:g}", f"{one['cases']:,}", f"{100 * one['posterior']:.1f}", f"{100 * one['sounds']:.1f}"]  # noqa: E501
            for one in self.json("listen-choice")["choice"]["reliability"]
        ]  # fmt: skip
        return text(["posterior", "cases (candidate and test frame)", "mean posterior (%)", "sounds (%)"], rows)

    def pipeline(self) -> str:
        """The whole pipeline on part_3."""
        found = {name: self.scores(f"listen-pipeline-{name}") for name in ("official", "spatial")}
        references = found["official"].references
        rows = [
            [REFERENCE_TITLES[name], *figures(references[name].get("part_3"), "listen", *LISTEN)]
            for name in ("all_white", "deaf_all", "deaf_single")
        ]
        rows += [[VARIANTS[name], *figures(scores.overall, "listen", *LISTEN)] for name, scores in found.items()]
        return text(["method", *LISTEN], rows)

    def sweep(self, name: str, column: str, shown: Callable[[str], str]) -> str:
        """Pair accuracy over the values of a sweep, from its CSV file."""
        with (self.folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
            found = [line for line in csv.DictReader(stream) if line["figure"] == "listen.pair_accuracy"]
        values = sorted({line[column] for line in found}, key=lambda value: -float("inf" if value == "none" else value))
        if column != "background.snr_db":
            values.reverse()
        rows = []
        if len({line["t30"] for line in found}) > 1:
            seconds = {line[column]: float(line["t30"]) for line in found}
            rows.append(["mean T30", *(f"{seconds[value]:.2f} s" for value in values)])
        for method in ("official", "centre", "spatial"):
            own = {line[column]: line for line in found if line["method"].endswith(f" {method}")}
            cells = []
            for value in values:
                low, high = float(own[value]["low"]), float(own[value]["high"])
                spread = f" ({low:.3f}–{high:.3f})" if low < high else ""
                cells.append(share(float(own[value]["mean"])) + spread)
            rows.append([VARIANTS.get(method, method), *cells])
        return text([f"pair_accuracy: {'SNR' if column == 'background.snr_db' else 'absorption scale'}",
                     *map(shown, values)], rows)  # fmt: skip

    def ablation(self, name: str) -> str:
        """What random changes are worth to small networks, from one file of `benchmarks.listener_ablation`."""
        return ablation_tables.summary(self.json(name))

    def curves(self) -> str:
        """Learning curves of small networks over homes and voices."""
        return ablation_tables.curves(self.json("listener-ablation"))


def speed(bench: Path) -> str:
    """Speed and memory of the generator, from the file of `make bench`."""
    found = {name: value for suite in read_json(bench)["figures"].values() for name, value in suite.items()}
    titles = {
        "RGB + ids + depth, 1008² (CPU s)": "RGB + ids + depth of a 1008² frame, CPU s",
        "RGB + ids + depth, slowest view (CPU s)": "… of the slowest of 20 views",
        "impulse response (CPU s)": "binaural impulse response of `soundspaces`, 1,888 acoustic faces, CPU s",
        "impulse response, worst room (CPU s)": "… in the worst room",
        "broadband level, SD over draws (dB)": "standard deviation of its broadband level, dB",
        "broadband level, SD, worst room (dB)": "… in the worst room",
        "frame of a 120-frame observation, all in (CPU s)":
            "a frame of a 120-frame observation with everything, encoded and on disk, CPU s",
        "overhead over the sum of the engines (%)":
            "share of that time not spent on rendering, impulse response, convolution or encoding, %",
        "two workers over one": "frames per second of two workers, relative to one worker",
        "peak memory of a worker (MB)": "peak memory of a worker, its home in the cache, MB",
    }  # fmt: skip
    rows = []
    for name, title in titles.items():
        most, least = TARGETS.get(name, (None, None))
        target = f"≤ {most:g}" if most is not None else f"≥ {least:g}" if least is not None else ""
        rows.append([title, f"{found[name]:.3g}", target])
    return text(["what", "median", "promised"], rows)


def all_voices() -> str:
    """The voices of all categories, with their sources."""
    rows = [
        [category.replace("_", " "), f"`{voice.name}`", voice.split, voice.mechanism, voice.source]
        for category in CATEGORIES + OFF_SCREEN_CATEGORIES
        for voice in sounds.voices(category)
    ]
    return text(["category", "voice", "split", "mechanism", "source of its model"], rows)


def credits(category: str) -> str:
    """Author and licence of the recordings of a category in the lock file, by their numbers on its sheet."""
    found = [one for one in read_lock(MANIFESTS / LOCK_NAME).assets if one.kind == "sound" and one.category == category]
    return "; ".join(f"{number} {one.author} ({one.licence})" for number, one in enumerate(found, 1))


def near_sources() -> str:
    """Level differences of the head and of a rigid sphere near a source."""
    return text(["azimuth", "distance", *(f"{band} Hz" for band in receivers.NEAR_BANDS)], receivers.near_field())


def blocks(docs: Path) -> dict[str, list[tuple[str, Callable[[], str]]]]:
    """Page, from the root → its tables in order: name of the block, and what makes it."""
    own = Results(docs / "results")
    return {
        "README.md": [("results", own.listener_summary)],
        "docs/comparing.md": [("power", own.power), ("homes", lambda: home_coverage.table(own.json("home-coverage")))],
        "docs/generator.md": [
            ("statistics", lambda: picture_statistics.table(own.json("picture-statistics"))),
            ("speed", lambda: speed(docs / "bench.json")),
        ],
        "docs/leaks.md": [(part, partial(own.leaks, part)) for part in ("part_2", "part_1")],
        "docs/light.md": [("rooms", own.light), ("surfaces", own.light_surfaces)],
        "docs/listener-training.md": [("runs", own.runs), ("curves", own.curves)],
        "docs/listener-trials.md": [
            (name, partial(own.ablation, f"listener-{name}")) for name in ("ablation", "ablation-files")
        ],
        "docs/official.md": [("table 2", own.paper_methods), ("table 3", own.paper_thresholds)],
        "docs/export-qa.md": [("qa", own.qa)],
        "docs/protocol-listen.md": [("guesses", own.guesses), ("references", own.references)],
        "docs/receivers.md": [("near sources", near_sources)],
        "docs/results.md": [
            ("results", own.listener_summary), ("training", own.training), ("caps", own.caps), ("methods", own.methods),
        ],
        "docs/listener.md": [
            ("strict", own.seeds_strict), ("listen", own.seeds_listen), ("classes", own.seeds_classes),
            ("categories", own.seeds_categories), ("controls", own.sound_controls), ("aims", own.listener_aims),
        ],
        "docs/scans.md": [("scans", own.scans)],
        "docs/sounds.md": [
            ("separability", own.separability), ("states", own.states), ("confusions", lambda: own.confusions("test")),
            ("confusions of recordings", lambda: own.confusions("recordings")), ("bandwidths", own.bandwidths),
            ("spread", own.spread),
        ],
        "docs/voices.md": [
            *((f"recordings of {name}", partial(credits, name)) for name in CATEGORIES), ("voices", all_voices),
        ],
        "docs/results-choice.md": [
            ("unseen twins", lambda: own.twins("cue-weights-unseen")), ("calibration", own.calibration),
            ("open twins", lambda: own.twins("cue-weights-open")), ("engines", own.engines), ("choice", own.choice),
            ("posteriors", own.posteriors), ("pipeline", own.pipeline), ("other sounds", own.echosegnet_sounds),
            ("noise", lambda: own.sweep("robustness-noise", "background.snr_db",
                                        lambda value: value if value == "none" else f"{value} dB".replace("-", "−"))),
            ("reverberation", lambda: own.sweep("robustness-reverberation", "acoustics.absorption_scale", str)),
        ],
    }  # fmt: skip


def paper_tables(results: Path) -> dict[Path, str]:
    """The paper's tables with our figures, as `avs3d tables` writes them without drawing."""
    files = sorted(path for kind in ("ambiguous", "sounding", "voting") for path in results.glob(f"{kind}-*.json"))
    entries = read_entries(files, reports=False)
    found: dict[Path, str] = {}
    for one in (table_contents.table_2(entries), table_contents.table_3(entries)):
        if one is not None:
            found[results / f"{one.name}.md"] = tables_markdown.markdown(one)
            found[results / f"{one.name}.csv"] = table_contents.csv(one)
    return found


def texts(root: Path = ROOT) -> dict[Path, str]:
    """Every file with recorded figures, as it is to be.

    Args:
        root: folder of README.md and docs/.

    Returns:
        File → its text.

    Raises:
        Avs3dError: if a file of results is missing or broken, or a page has no place for a table.
    """
    docs = root / "docs"
    found = listener_page.pages(docs / "results", docs / "listener.md", docs / "images")
    found |= paper_tables(docs / "results") | leaderboard_page.pages(docs)
    for name, made in blocks(docs).items():
        page = found.get(root / name) or (root / name).read_text(encoding="utf-8")
        for block, make in made:
            page = listener_page.insert(root / name, page, block, make())
        found[root / name] = page
    return found


def outdated(root: Path = ROOT) -> dict[Path, str]:
    """The files of `texts` that say something else, or do not exist."""
    return {path: text for path, text in texts(root).items() if not path.exists() or path.read_bytes() != text.encode()}


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 if a page is not current.")
def main(check: bool) -> None:
    """Write the tables of recorded figures into README.md and docs/."""
    try:
        found = outdated()
        for path, text in found.items():
            click.echo(path.relative_to(ROOT))
            if not check:
                write_bytes(path, text.encode())
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    if check and found:
        raise click.ClickException("these pages differ from docs/results/ and docs/bench.json: run make docs-tables")


if __name__ == "__main__":
    main()
