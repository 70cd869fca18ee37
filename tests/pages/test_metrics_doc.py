"""docs/metrics.md and the pages of its topics: every number of the worked examples, recomputed twice from the drawings.

Blocks whose info string begins with `masks`, `scenes`, `voxels` or `values` draw an example; `figures NAME` blocks hold
chains like ``strict.IoU = (6/9 + 0)/2 ≈ 0.3333``. Of each chain, what names something is looked up in the evaluator and
in a second implementation below (sets of pixels and fractions, nothing shared), and all that is arithmetic is worked
out.
All must agree: after ``=`` to 1e-6 (the released IoU has an epsilon), after ``≈`` to half a unit of the last digit.
"""

from __future__ import annotations

import ast
import itertools
import math
import re
import statistics
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from avs3d_bench.contract.layout import MAX_POINTS
from avs3d_bench.contract.scores import (
    ALL_REFERENCES,
    BLIND_REFERENCES,
    DEAF_REFERENCES,
    METRICS,
    PAIR_FIGURES,
    REFERENCES,
    ListenScore,
    ObservationScores,
    Scores,
    metrics_of,
)
from avs3d_bench.contract.taxonomy import OFF_SCREEN_CATEGORIES
from avs3d_bench.geometry import flip_world
from avs3d_bench.measures.pair_kinds import pair_kind
from evaluators.metrics.classes import confusion
from evaluators.metrics.contour import contour, found, tolerance
from evaluators.metrics.frames import Truth, frame_figures, reference_figures
from evaluators.metrics.masks import f_measure, frame_counts, iou
from evaluators.metrics.pairs import differ, sibling_scores
from evaluators.metrics.volume import VolumeScore, score_points, true_volume
from evaluators.protocols import listen
from evaluators.protocols import strict as protocols
from evaluators.protocols.listen import listen_observation
from evaluators.protocols.official import official_observation
from evaluators.protocols.strict import strict_observation
from evaluators.references.deaf import DeafOracles, deaf_frame, deaf_references
from evaluators.statistics import bootstrap, comparison, sign_flips
from evaluators.summary import summarise
from generators.manifest.reading import read_manifest
from tests.evaluators.test_compare import scores_of
from tests.support.markdown_code import blocks
from tests.support.score_examples import example_scores

DOCS = Path(__file__).parents[2] / "docs"
#: What the figures mean, in the order in which a reader meets it.
PAGES = tuple(
    DOCS / f"{name}.md"
    for name in (
        "metrics", "protocol-official", "protocol-strict", "protocol-listen", "comparing", "scores-file", "factors",
    )
)  # fmt: skip
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)

Pixels = set[tuple[int, int]]
Values = dict[str, float | None]

# --- Reading the document ---------------------------------------------------------------------------------------------


@dataclass
class Picture:
    """One frame: its size, and the marked pixels of each drawing, by its heading."""

    height: int
    width: int
    drawings: dict[str, list[str]]

    def pixels(self, name: str, marks: str = "#") -> Pixels:
        rows = self.drawings.get(name, [])
        return {(y, x) for y, row in enumerate(rows) for x, mark in enumerate(row) if mark in marks}

    def array(self, pixels: Pixels) -> np.ndarray:
        mask = np.zeros((self.height, self.width), np.uint8)
        for y, x in pixels:
            mask[y, x] = 255
        return mask

    @property
    def twins(self) -> dict[str, Pixels]:
        letters = {mark for row in self.drawings.get("twins", []) for mark in row} - {"."}
        return {letter: self.pixels("twins", letter) for letter in sorted(letters)}


@dataclass
class Example:
    frames: dict[str, Picture] = field(default_factory=dict)
    cube: tuple[float, float] | None = None
    voxels: list[tuple[int, int, int]] = field(default_factory=list)
    values: list[float | None] = field(default_factory=list)
    methods: dict[str, list[float]] = field(default_factory=dict)
    scenes: bool = False
    sources: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    chains: list[tuple[str, str]] = field(default_factory=list)


def drawings() -> Iterator[tuple[list[str], list[str]]]:
    """Info string in words, and lines, of every fenced block that is ours."""
    for block in itertools.chain.from_iterable(map(blocks, PAGES)):
        if block.language in ("masks", "scenes", "sources", "voxels", "values", "methods", "figures"):
            yield block.info.split(), [line for line in block.code.splitlines() if line.strip()]


def columns(lines: list[str]) -> dict[str, list[str]]:
    """Drawings side by side below their titles."""
    titles, *rows = (line.split() for line in lines)
    assert all(len(row) == len(titles) for row in rows), lines
    return {title: [row[i] for row in rows] for i, title in enumerate(titles)}


def pictures(lines: list[str]) -> dict[str, Picture]:
    """Frames side by side, their drawings below one another; a drawing's first line begins with its name.

    Or one frame, whose name begins the first line, with its drawings side by side.
    """
    names = lines[0].split()
    if len(names) > 1 and not names[1].startswith("frame_"):
        name = names.pop(0)
        drawings = columns([" ".join(names), *lines[1:]])
        return {name: Picture(len(lines) - 1, len(drawings[names[0]][0]), drawings)}
    out = {name: Picture(0, 0, {}) for name in names}
    title = ""
    for line in lines[1:]:
        words = line.split()
        if len(words) > len(names):
            title = words.pop(0)
        assert len(words) == len(names), line
        for name, row in zip(names, words, strict=True):
            out[name].drawings.setdefault(title, []).append(row)
    for name, frame in out.items():
        sizes = {(len(rows), len(row)) for rows in frame.drawings.values() for row in rows}
        assert len(sizes) == 1, f"{name}: drawings of different sizes"
        frame.height, frame.width = sizes.pop()
    return out


def read_examples() -> dict[str, Example]:
    out: dict[str, Example] = {}
    for (kind, name, *rest), lines in drawings():
        example = out.setdefault(name, Example())
        if kind in ("masks", "scenes"):
            drawn = pictures(lines)
            for frame in drawn.keys() & example.frames.keys():
                assert drawn[frame] == example.frames[frame], f"{name}: drawn again on another page, and differently"
            example.frames |= drawn
            example.scenes = kind == "scenes"
        elif kind == "voxels":
            example.cube = (float(rest[0]), float(rest[1]))
            for title, rows in columns(lines).items():
                y = int(title.removeprefix("y="))
                example.voxels += [(x, y, z) for z, row in enumerate(rows) for x, mark in enumerate(row) if mark == "#"]
        elif kind == "values":
            example.values = [None if word == "null" else float(word) for line in lines for word in line.split()]
        elif kind == "sources":
            for line in lines:
                sibling, _, said = line.removeprefix("sibling_").partition(": ")
                sounding = [] if said == "nothing" else [one.split() for one in said.split(", ")]
                example.sources[sibling] = [(category, letter) for category, letter in sounding]
        elif kind == "methods":
            example.methods = {method: [*map(float, values)] for method, *values in map(str.split, lines)}
        else:
            for line in lines:
                prefix, _, rest_of_line = line.rpartition(": ")
                example.chains += [(prefix, chain.strip()) for chain in rest_of_line.split(";")]
    return out


EXAMPLES = read_examples()
CHAINS = [(name, prefix, chain) for name, example in EXAMPLES.items() for prefix, chain in example.chains]

# --- Arithmetic as it is written --------------------------------------------------------------------------------------

_SIGNS = {"Φ⁻¹": "quantile", "Φ": "share", "·": "*", "−": "-", "^": "**", "²": "**2", "³": "**3", "√": "sqrt"}
_NORMAL = statistics.NormalDist()
_FUNCTIONS: dict[str, Callable[..., float]] = {
    "sqrt": math.sqrt, "ceil": math.ceil, "max": max, "min": min, "quantile": _NORMAL.inv_cdf, "share": _NORMAL.cdf,
}  # fmt: skip
_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b, ast.Pow: lambda a, b: a**b,
}  # fmt: skip


def work_out(text: str) -> float:
    """A sum as a person writes it: ``0.05·√105/11``."""
    for sign, python in _SIGNS.items():
        text = text.replace(sign, python)
    text = re.sub(r"sqrt\s*([\d.]+)", r"sqrt(\1)", text)

    def value(node: ast.AST) -> float:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return node.value
        if isinstance(node, ast.BinOp):
            return _OPERATORS[type(node.op)](value(node.left), value(node.right))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return _FUNCTIONS[node.func.id](*map(value, node.args))
        raise AssertionError(f"not arithmetic: {text}")

    return value(ast.parse(text.strip(), mode="eval").body)


def test_sums_are_worked_out():
    assert work_out("0.05·√((13/11 − 1)² + 2)") == 0.05 * math.sqrt((13 / 11 - 1) ** 2 + 2)
    assert work_out("0.05·√105/11") == 0.05 * math.sqrt(105) / 11
    assert work_out("max(1, ceil(2.1)) − 3³") == -24
    assert work_out("2^3/2 + Φ(Φ⁻¹(0.25))") == pytest.approx(4.25)


# --- The evaluator ----------------------------------------------------------------------------------------------------


def _scores(example: Example, reference: str | None, volume: VolumeScore | None) -> Values:
    """The figures of an observation, by the evaluator."""
    frames, deaf = [], []
    for frame in example.frames.values():
        twins = frame.twins
        ids = np.zeros((frame.height, frame.width), np.uint16)
        for number, pixels in enumerate(twins.values(), start=2):
            ids[frame.array(pixels) > 0] = number
        known = any("twins" in other.drawings for other in example.frames.values())
        truth = Truth.of(
            frame.array(frame.pixels("truth")), ids if known else None, range(2, 2 + len(twins)), outlines=True
        )
        prediction = frame.array(frame.pixels("prediction"))
        deaf.append(deaf_frame(truth, sounding=1))
        blind = reference if reference in BLIND_REFERENCES else None
        frames.append(reference_figures(truth)[blind] if blind else frame_figures(truth, prediction))
    if frames and reference in DEAF_REFERENCES:
        frames = deaf_references(deaf)[reference]
    strict = strict_observation(frames, volume, {})
    out: Values = {f"strict.{metric.name}": getattr(strict, metric.name) for metric in metrics_of("strict")}
    if frames:
        official = official_observation(frames)
        out |= {"official.mIoU": official.mIoU, "official.F": official.F}
    return out


def evaluated(example: Example) -> dict[str, Values]:
    """Prefix → name → value, by the evaluator."""
    if example.scenes:
        return evaluated_scenes(example)
    if example.methods:
        return evaluated_methods(example.methods)
    volume, out = None, dict[str, Values]()
    plain: Values = {}
    if example.cube is not None:
        low, high = example.cube
        corners = np.array(list(itertools.product((low, high), repeat=3)))
        sides = [np.flatnonzero(corners[:, axis] == end) for axis in range(3) for end in (low, high)]
        faces = np.array([side[three] for side in sides for three in ([0, 1, 2], [1, 2, 3])])
        truth = true_volume(corners, faces)
        points = (np.array(example.voxels) + 0.5) * truth.size
        index = np.array(example.voxels) - truth.origin
        inside = index[((index >= 0) & (index < truth.surface.shape)).all(axis=1)]
        volume = score_points(points, truth)
        plain |= {
            "|S|": truth.surface.sum(), "|I|": truth.interior.sum(), "|Q|": len(points),
            "|Q∩S|": truth.surface[tuple(inside.T)].sum(), "|Q∩I|": truth.interior[tuple(inside.T)].sum(),
        }  # fmt: skip
    if example.values:
        numbers = [value for value in example.values if value is not None]
        group = summarise([_observation(value, index) for index, value in enumerate(example.values)]).strict
        assert group is not None
        low, high = group.intervals["IoU"]
        assert (low, high) == bootstrap.interval(numbers)
        plain |= {"count": group.counts["IoU"], "mean": group.IoU, "low": low, "high": high}
    plain |= _scores(example, None, volume)
    out[""] = plain
    if example.frames:
        out |= {reference: _scores(example, reference, None) for reference in REFERENCES}
    for name, frame in example.frames.items():
        g, p = frame.array(frame.pixels("truth")), frame.array(frame.pixels("prediction"))
        counts = frame_counts(g, p)
        values: Values = {
            "|G|": counts.truth, "|P|": counts.predicted, "|P∩G|": counts.overlap, "|P∪G|": counts.union,
            "F": f_measure(counts),
        }  # fmt: skip
        plain |= {"N": counts.pixels, "τ": tolerance(frame.height, frame.width)}
        if counts.truth:
            values["IoU"] = iou(counts)
        if counts.truth and counts.predicted:
            dg, dp = contour(g), contour(p)
            values |= {
                "p": counts.overlap / counts.predicted, "r": counts.overlap / counts.truth,
                "|∂G|": dg.length, "|∂P|": dp.length,
                "precision": found(dp, dg) / dp.length if dp.length else None,
                "recall": found(dg, dp) / dg.length if dg.length else None,
                "boundary_F": frame_figures(Truth.of(g, None, (), outlines=True), p).boundary_f,
            }  # fmt: skip
        for letter, pixels in frame.twins.items():
            of_twin = frame_counts(frame.array(pixels), p)
            values |= {f"|{letter}|": of_twin.truth, f"|P∩{letter}|": of_twin.overlap}
        out[name] = values
    return out


def _observation(value: float | None, index: int) -> ObservationScores:
    """An observation whose strict IoU is known."""
    strict = strict_observation([], None, {}).model_copy(update={"IoU": value})
    return ObservationScores(
        key=f"part_1/apartment_{index}/kitchen/1", part="part_1", scan=f"apartment_{index}", room="kitchen",
        category="clock", frames=1, strict=strict,
    )  # fmt: skip


# --- The second implementation: sets of pixels and fractions, by the document's text ----------------------------------


def _average(values: list[Fraction]) -> Fraction | None:
    return sum(values, Fraction(0)) / len(values) if values else None


def _f(p: Pixels, g: Pixels) -> Fraction:
    both = len(p & g)
    return Fraction(13, 10) * both / (Fraction(3, 10) * len(g) + len(p)) if both else Fraction(0)


def _boundary(mask: Pixels, frame: Picture) -> Pixels:
    image = set(itertools.product(range(frame.height), range(frame.width)))
    steps = ((-1, 0), (1, 0), (0, -1), (0, 1))
    return {(y, x) for y, x in mask if any((y + a, x + b) in image - mask for a, b in steps)}


def _near(pixels: Pixels, others: Pixels, reach: int) -> Fraction:
    close = [(y, x) for y, x in pixels if any((y - a) ** 2 + (x - b) ** 2 <= reach**2 for a, b in others)]
    return Fraction(len(close), len(pixels))


def _boundary_f(p: Pixels, g: Pixels, frame: Picture) -> Fraction:
    dp, dg = _boundary(p, frame), _boundary(g, frame)
    if not dp or not dg:
        return Fraction(int(not dp and not dg))
    reach = math.ceil(0.008 * math.hypot(frame.height, frame.width))
    precision, recall = _near(dp, dg, reach), _near(dg, dp, reach)
    return 2 * precision * recall / (precision + recall) if precision + recall else Fraction(0)


def _witness_scores(example: Example, reference: str | None) -> dict[str, Fraction | None]:
    frames = []
    names = sorted({"", *(letter for frame in example.frames.values() for letter in frame.twins)})
    seen = {
        name: sum(len(f.twins.get(name, set()) if name else f.pixels("truth")) for f in example.frames.values())
        for name in names
    }
    most = max(names, key=lambda name: seen[name])
    for frame in example.frames.values():
        image = set(itertools.product(range(frame.height), range(frame.width)))
        h, w = frame.height, frame.width
        box = {(y, x) for y, x in image if h // 4 <= y < h - h // 4 and w // 4 <= x < w - w // 4}
        instances = {"": frame.pixels("truth")} | frame.twins
        made = {None: frame.pixels("prediction"), "all_black": set(), "all_white": image, "centre_box": box,
                "deaf_category": set[tuple[int, int]]().union(*instances.values()),
                "deaf_most_seen": instances.get(most, set())}  # fmt: skip
        frames.append((frame, image, made[reference], frame.pixels("truth")))
    visible = [(f, image, p, g) for f, image, p, g in frames if g]
    absent = [(f, image, p) for f, image, p, g in frames if not g]
    with_twins = [(f, p) for f, _, p, _ in frames if f.twins]
    share = [
        Fraction(len(p & g), len(p | g)) if g else Fraction(len(image - p), len(image)) for _, image, p, g in frames
    ]
    marked = [any(2 * len(p & twin) > len(twin) for twin in f.twins.values()) for f, p in with_twins]
    return {
        "official.mIoU": _average(share),
        "official.F": max(
            _average([_f(p, g) for _, _, p, g in visible]) or Fraction(0),
            _average([_f(image, g) for _, image, _, g in visible]) or Fraction(0),
        ),
        "strict.IoU": _average([Fraction(len(p & g), len(p | g)) for _, _, p, g in visible]),
        "strict.F": _average([_f(p, g) for _, _, p, g in visible]),
        "strict.boundary_F": _average([_boundary_f(p, g, f) for f, _, p, g in visible]),
        "strict.FP_rate": _average([Fraction(bool(p)) for _, _, p in absent]),
        "strict.FP_area": _average([Fraction(len(p), len(image)) for _, image, p in absent]),
        "strict.wrong_instance_rate": _average([Fraction(one) for one in marked]),
    }


def witnessed(example: Example) -> dict[str, dict[str, Fraction | float | None]]:
    """Prefix → name → value, by the second implementation."""
    if example.scenes:
        return witnessed_scenes(example)
    if example.methods:
        return witnessed_methods(example.methods)
    out: dict[str, dict[str, Fraction | float | None]] = {"": {}}
    if example.frames:
        out = {prefix: dict(_witness_scores(example, prefix or None)) for prefix in ("", *REFERENCES)}
    for name, frame in example.frames.items():
        p, g = frame.pixels("prediction"), frame.pixels("truth")
        values: dict[str, Fraction | float | None] = {
            "|G|": len(g), "|P|": len(p), "|P∩G|": len(p & g), "|P∪G|": len(p | g), "F": _f(p, g),
        }  # fmt: skip
        reach = math.ceil(0.008 * math.hypot(frame.height, frame.width))
        out[""] |= {"N": frame.height * frame.width, "τ": reach}
        if g:
            values["IoU"] = Fraction(len(p & g), len(p | g))
        if p and g:
            dp, dg = _boundary(p, frame), _boundary(g, frame)
            values |= {
                "p": Fraction(len(p & g), len(p)), "r": Fraction(len(p & g), len(g)),
                "|∂G|": len(dg), "|∂P|": len(dp), "precision": _near(dp, dg, reach), "recall": _near(dg, dp, reach),
                "boundary_F": _boundary_f(p, g, frame),
            }  # fmt: skip
        for letter, pixels in frame.twins.items():
            values |= {f"|{letter}|": len(pixels), f"|P∩{letter}|": len(p & pixels)}
        out[name] = values
    if example.cube is not None:
        low, high = (math.floor(Fraction(str(end)) / Fraction("0.05")) for end in example.cube)
        solid = set(itertools.product(range(low, high + 1), repeat=3))
        inside = {v for v in solid if all(low < c < high for c in v)}
        shell, q = solid - inside, set(example.voxels)
        centre = [sum((c + 0.5) * 0.05 for c in axis) / len(q) for axis in zip(*q, strict=True)]
        out[""] |= {
            "|S|": len(shell), "|I|": len(inside), "|Q|": len(q), "|Q∩S|": len(q & shell), "|Q∩I|": len(q & inside),
            "strict.IoU_3D": Fraction(len(q & shell), len(shell | (q - inside))),
            "strict.centroid_error": math.dist(centre, [sum(example.cube) / 2] * 3),
        }  # fmt: skip
    if example.values:
        out[""] |= _exact_interval([Fraction(str(value)) for value in example.values if value is not None])
    return out


def _exact_interval(values: list[Fraction]) -> dict[str, Fraction | float | None]:
    """All resamples there are, each as likely: no draws."""
    means = sorted(sum(drawn) / len(values) for drawn in itertools.product(values, repeat=len(values)))
    low, high = (means[math.ceil(share * len(means)) - 1] for share in (0.025, 0.975))
    return {"count": len(values), "mean": _average(values), "low": low, "high": high}


# --- Methods that are compared, by both -------------------------------------------------------------------------------


def evaluated_methods(methods: dict[str, list[float]]) -> dict[str, Values]:
    """Prefix → name → value, by the evaluator: ``a − b`` for a pair, ``a`` for a method."""
    scores = {name: scores_of(values) for name, values in methods.items()}
    found = comparison.compare_figure(scores, comparison.FIGURES["strict.IoU"], "part_2")
    assert found is not None
    out: dict[str, Values] = {"": {}}
    out |= {method.name: {"place": method.place, "mean": method.mean} for method in found.methods}
    for pair in found.differences:
        differences = [[a - b] for a, b in zip(methods[pair.first], methods[pair.second], strict=True)]
        assert pair.interval is not None
        plain = bootstrap.clustered_interval(differences)
        assert plain is not None
        out[f"{pair.first} − {pair.second}"] = {
            "n": pair.units, "mean": pair.mean, "p": pair.p, "p_holm": pair.p_holm,
            "low": pair.interval[0], "high": pair.interval[1], "percentile_high": plain[1],
        }  # fmt: skip
    return out


def witnessed_methods(methods: dict[str, list[float]]) -> dict[str, dict[str, Fraction | float | None]]:
    """Prefix → name → value, by fractions: every pattern of signs, and the distribution of all resamples."""
    exact = {name: [Fraction(str(value)) for value in values] for name, values in methods.items()}
    means = {name: sum(values) / len(values) for name, values in exact.items()}
    pairs = list(itertools.combinations(exact, 2))
    differences = {pair: [a - b for a, b in zip(*(exact[name] for name in pair), strict=True)] for pair in pairs}
    p = {pair: _share_of_patterns(values) for pair, values in differences.items()}
    ranked = sorted(pairs, key=p.__getitem__)
    holm = {
        pair: max((len(pairs) - r) * p[other] for r, other in enumerate(ranked[: ranked.index(pair) + 1]))
        for pair in pairs
    }
    out: dict[str, dict[str, Fraction | float | None]] = {"": {}}
    for (first, second), values in differences.items():
        out[f"{first} − {second}"] = {
            "n": len(values), "mean": sum(values) / len(values), "p": p[first, second],
            "p_holm": min(Fraction(1), holm[first, second]), **_exact_ends(values),
        }  # fmt: skip
    apart = {frozenset(pair) for pair in pairs if holm[pair] < Fraction(1, 20)}
    ordered = sorted(exact, key=lambda name: -means[name])
    place = 0
    for index, name in enumerate(ordered):
        split = all(frozenset((a, b)) in apart for a in ordered[:index] for b in ordered[index:])
        place = index + 1 if split else place
        out[name] = {"mean": means[name], "place": place}
    return out


def _share_of_patterns(values: list[Fraction]) -> Fraction:
    sums = Counter({Fraction(0): 1})
    for value in values:
        following: Counter[Fraction] = Counter()
        for total, count in sums.items():
            following[total + value] += count
            following[total - value] += count
        sums = following
    return Fraction(sum(c for k, c in sums.items() if abs(k) >= abs(sum(values))), 2 ** len(values))


def _exact_ends(values: list[Fraction]) -> dict[str, Fraction]:
    """BCa from twenty values on, percentiles of fewer: of the exact distribution of the mean of a resample."""
    n, sums = len(values), {Fraction(0): Fraction(1)}
    for _ in values:
        following: dict[Fraction, Fraction] = {}
        for total, probability in sums.items():
            for value, times in Counter(values).items():
                key = total + value
                following[key] = following.get(key, Fraction(0)) + probability * times / n
        sums = following

    def end(share: float) -> Fraction:
        reached = Fraction(0)
        for total in sorted(sums):
            reached += sums[total]
            if reached >= share:
                break
        return total / n

    percentiles = {"low": end(0.025), "high": end(0.975), "percentile_high": end(0.975)}
    if n < 20:
        return percentiles
    below = sum(p for total, p in sums.items() if total < sum(values)) + sums[sum(values)] / 2
    without = [(sum(values) - value) / (n - 1) for value in values]
    away = [float(sum(without) / n - mean) for mean in without]
    a = sum(u**3 for u in away) / (6 * sum(u**2 for u in away) ** 1.5)
    ends = []
    for z in (-1.959964, 1.959964):
        z0 = _NORMAL.inv_cdf(float(below))
        ends.append(end(_NORMAL.cdf(z0 + (z0 + z) / (1 - a * (z0 + z)))))
    return percentiles | {"low": ends[0], "high": ends[1]}


# --- part_3: groups of siblings, by both ----------------------------------------------------------------------------

LETTERS = "mtn"  # of the instances; class ids are their places, from 1 on


def siblings_in(example: Example) -> list[str]:
    """Numbers of the siblings that are drawn."""
    drawings = next(iter(example.frames.values())).drawings
    return sorted(name.removeprefix("truth_") for name in drawings if name.startswith("truth_"))


def letters(frame: Picture, name: str) -> np.ndarray:
    """(H, W) uint8: 0, or the place of the letter."""
    rows = [[LETTERS.find(mark) + 1 for mark in row] for row in frame.drawings[name]]
    return np.array(rows, np.uint8)


def evaluated_scenes(example: Example) -> dict[str, Values]:
    """Prefix → name → value, by the evaluator: the counts of `evaluators.protocols.sibling_counts` from arrays."""
    numbers, frames = siblings_in(example), list(example.frames.values())
    keys = [f"part_3/drawn/kitchen/{number}" for number in numbers]
    truths = [[letters(frame, f"truth_{n}") for n in numbers] for frame in frames]
    marked = [[letters(frame, f"prediction_{n}") for n in numbers] for frame in frames]
    pairs = list(itertools.combinations(range(len(keys)), 2))
    differing = [[(a, b) for a, b in pairs if differ(frame_counts(one[a], one[b]))] for one in truths]
    deaf = DeafOracles({place: place for place in range(1, len(LETTERS) + 1)}, len(LETTERS))
    heard = [
        SimpleNamespace(
            sound_sources=[
                SimpleNamespace(category=category, instance=LETTERS.find(letter) + 1 if letter in LETTERS else None)
                for category, letter in example.sources[n]
            ]
        )
        for n in numbers
        if n in example.sources
    ]
    kinds = {(a, b): pair_kind(heard[a], heard[b]) for a, b in pairs} if heard else None  # type: ignore[arg-type]
    for frame, true in zip(frames, truths, strict=True):
        deaf.add(letters(frame, "instances").astype(np.uint16), true)
    counts = {
        "": [[[frame_counts(g, p) for g in true] for p in shown] for true, shown in zip(truths, marked, strict=True)]
    }
    counts |= {name: [[one] * len(keys) for one in deaf.counts(rows)] for name, rows in deaf.rows().items()}
    out: dict[str, Values] = {}
    for prefix, frames_ in counts.items():
        siblings = sibling_scores(keys[0], keys, differing, frames_, kinds)
        observations = []
        for index, key in enumerate(keys):
            classes = sum(confusion(g[index], p[index], len(LETTERS)) for g, p in zip(truths, marked, strict=True))
            own = [frame[index][index] for frame in frames_]
            scores = listen_observation(key, own, siblings, np.asarray(classes), dict(enumerate(LETTERS, 1)))
            observations.append(
                ObservationScores(
                    key=key, part="part_3", scan="drawn", room="kitchen", category=None, group=keys[0],
                    frames=len(own), listen=scores,
                )
            )  # fmt: skip
            if not prefix:
                out[f"sibling_{numbers[index]}"] = _listen_values(scores)
                out[f"sibling_{numbers[index]}"] |= {f"class_IoU_{c}": v for c, v in scores.class_IoU.items()}
        group = summarise(observations, [siblings]).listen
        assert group is not None
        out[prefix] = _listen_values(group)
        if not prefix:
            for pair in (pair for pair in siblings.pairs if pair.frames):
                out[""][f"pair_{pair.first[-1]}_{pair.second[-1]}"] = pair.right / pair.frames
    return out


def _listen_values(scores: ListenScore) -> Values:
    return {f"listen.{metric.name}": getattr(scores, metric.name) for metric in metrics_of("listen")}


def _overlap(p: Pixels, g: Pixels) -> Fraction:
    return Fraction(len(p & g), len(p | g)) if p | g else Fraction(1)


def witnessed_scenes(example: Example) -> dict[str, dict[str, Fraction | float | None]]:
    """Prefix → name → value, by sets of pixels and fractions."""
    numbers, frames = siblings_in(example), list(example.frames.values())
    truth = {n: [frame.pixels(f"truth_{n}", LETTERS) for frame in frames] for n in numbers}
    seen = {letter: [frame.pixels("instances", letter) for frame in frames] for letter in LETTERS}
    visible = [(index, n) for n in numbers for index in range(len(frames)) if truth[n][index]]
    best = max(LETTERS, key=lambda one: sum(_overlap(seen[one][i], truth[n][i]) for i, n in visible))
    predictions = {
        "": {n: [frame.pixels(f"prediction_{n}", LETTERS) for frame in frames] for n in numbers},
        "deaf_all": {n: [frame.pixels("instances", LETTERS) for frame in frames] for n in numbers},
        "deaf_single": dict.fromkeys(numbers, seen[best]),
    }
    out: dict[str, dict[str, Fraction | float | None]] = {}
    size = frames[0].height * frames[0].width
    for prefix, marked in predictions.items():
        right: dict[tuple[str, str], list[Fraction]] = {}
        for a, b in itertools.combinations(numbers, 2):
            right[a, b] = [
                Fraction(
                    all(
                        (_overlap(p, own) > Fraction(1, 2) if own else not p) and _overlap(p, own) > _overlap(p, other)
                        for p, own, other in ((marked[a][i], ta, tb), (marked[b][i], tb, ta))
                    )
                )
                for i, (ta, tb) in enumerate(zip(truth[a], truth[b], strict=True))
                if _overlap(ta, tb) < Fraction(1, 2)
            ]
        each = {}
        for n in numbers:
            pairs = list(zip(marked[n], truth[n], strict=True))
            each[n] = {
                "listen.IoU": _average([_overlap(p, g) for p, g in pairs if g]),
                "listen.FP_rate": _average([Fraction(bool(p)) for p, g in pairs if not g]),
                "listen.FP_area": _average([Fraction(len(p), size) for p, g in pairs if not g]),
                **_by_kind({pair: all_ for pair, all_ in right.items() if n in pair}, example),
            }
            if not prefix:
                classes = _class_ious(frames, n)
                each[n] |= {f"class_IoU_{c}": value for c, value in classes.items()}
                each[n]["listen.class_mIoU"] = _average(list(classes.values()))
                out[f"sibling_{n}"] = dict(each[n])
        names = {name for values in each.values() for name in values if name.startswith("listen.")}
        means = {name: [v for n in numbers if (v := each[n][name]) is not None] for name in names}
        out[prefix] = {name: _average(values) for name, values in means.items()}
        out[prefix] |= _by_kind(right, example)
        if not prefix:
            out[""] |= {f"pair_{a}_{b}": _average(all_) for (a, b), all_ in right.items()}
    return out


def _by_kind(right: Mapping[tuple[str, str], list[Fraction]], example: Example) -> dict[str, Fraction | None]:
    """The pair accuracy over all pairs, and over those of each kind."""
    chosen: dict[str, list[Fraction]] = {f"listen.{name}": [] for name in PAIR_FIGURES}
    for (a, b), frames in right.items():
        chosen["listen.pair_accuracy"] += frames
        if a in example.sources:
            chosen[f"listen.{_kind(example.sources[a], example.sources[b])}"] += frames
    return {name: _average(values) for name, values in chosen.items()}


def _kind(one: list[tuple[str, str]], other: list[tuple[str, str]]) -> str:
    """By the numbers of sources, then by how many places, letters and categories there are."""
    counts = {len(one), len(other)}
    if max(counts) > 1:
        return "several"
    letters_ = {letter for _, letter in (*one, *other)}
    if 0 in counts or (len(letters_) == 1 and letters_ != {"elsewhere"}):
        return "silence"
    if "elsewhere" in letters_:
        return "off_screen"
    return "twins" if len({category for category, _ in (*one, *other)}) == 1 else "category"


def _class_ious(frames: list[Picture], number: str) -> dict[str, Fraction]:
    out = {}
    for letter in LETTERS:
        pairs = [(f.pixels(f"prediction_{number}", letter), f.pixels(f"truth_{number}", letter)) for f in frames]
        union = sum(len(p | g) for p, g in pairs)
        if union:
            out[letter] = Fraction(sum(len(p & g) for p, g in pairs), union)
    return out


# --- The document against both ----------------------------------------------------------------------------------------


@lru_cache
def reckoned(name: str) -> tuple[dict[str, Values], dict[str, dict[str, Fraction | float | None]]]:
    """The values of an example by the evaluator and by this file."""
    return evaluated(EXAMPLES[name]), witnessed(EXAMPLES[name])


@pytest.mark.parametrize(("example", "prefix", "chain"), CHAINS, ids=[f"{n} {p} {c}"[:70] for n, p, c in CHAINS])
def test_every_number_of_every_example(example: str, prefix: str, chain: str):
    if prefix in EXAMPLES:
        example, prefix = prefix, ""
    pieces = re.split(r"\s*([=≈])\s*", chain)
    assert len(pieces) >= 3, f"nothing is claimed: {chain}"
    name = re.sub(r"\s", "", pieces[0])
    evaluator, witness = reckoned(example)
    if name in evaluator[prefix] or name in witness[prefix]:
        values = [evaluator[prefix][name], witness[prefix][name]]
    else:
        values = [work_out(pieces[0])]
    for sign, text in zip(pieces[1::2], pieces[2::2], strict=True):
        if text == "null":
            assert values == [None, None]
            continue
        decimals = len(text.partition(".")[2])
        margin = 0.5 * 10**-decimals + 1e-9 if sign == "≈" else 1e-6
        for value in values:
            assert value is not None
            assert abs(work_out(text) - float(value)) <= margin, f"{text}, not {float(value)}"


def test_every_figure_has_an_example():
    claimed = {re.split(r"\s*[=≈]", chain)[0] for _, _, chain in CHAINS if not chain.endswith("null")}
    assert {f"{metric.protocol}.{metric.name}" for metric in METRICS} <= claimed
    assert {"low", "high", "mean", "count", "p", "p_holm", "place", "percentile_high"} <= claimed
    assert {prefix for _, prefix, _ in CHAINS} >= set(ALL_REFERENCES)
    # The drawings are used, and there are no chains of examples that nobody drew.
    assert all(e.chains and (e.frames or e.cube or e.values or e.methods) for e in EXAMPLES.values())


def test_the_drawn_boundaries_are_the_boundaries():
    frame = EXAMPLES["outline"].frames["frame_000"]
    for mask in ("truth", "prediction"):
        assert frame.pixels(f"∂{mask}", "o") == _boundary(frame.pixels(mask), frame)


def test_a_chain_that_is_wrong_is_found():
    with pytest.raises(AssertionError):
        test_every_number_of_every_example("walk", "", "strict.IoU = (6/9 + 0)/2 ≈ 0.3334")
    with pytest.raises(AssertionError):
        test_every_number_of_every_example("walk", "frame_000", "|P ∩ G| = 7")
    with pytest.raises(AssertionError):
        test_every_number_of_every_example("walk", "", "strict.IoU = null")


def first_column(heading: str) -> set[str]:
    """What stands in backticks in the first column of the first table below a heading."""
    section = TEXT.split(heading, 1)[1]
    table = re.search(r"(?:^\|.*\n)+", section, re.M)
    assert table
    cells = [line.split("|")[1] for line in table.group().splitlines()[2:]]
    return {key for cell in cells for key in re.findall(r"`([^`]+)`", cell)}


def test_the_table_at_the_top_lists_every_figure():
    rows = re.findall(r"^\| (official|strict|listen) \| `(\w+)` \| (high|low) \| (metres)?", TEXT, re.M)
    assert [(protocol, name, way == "high", unit == "metres") for protocol, name, way, unit in rows] == [
        (m.protocol, m.name, m.higher_is_better, m.unit == "m") for m in METRICS
    ]


def test_every_key_of_the_file_of_scores_is_explained():
    assert first_column("# A file of scores") == set(Scores.model_fields)


def test_every_reason_for_a_null_is_listed():
    everything = {**vars(listen), **vars(protocols)}
    constants = {name: value for name, value in everything.items() if name.isupper() and name[0] != "_"}
    reasons = [value for value in constants.values() if isinstance(value, str) and " " in value]
    assert reasons
    for reason in reasons:
        assert f"| {reason} |" in TEXT, reason


def test_constants_that_the_pages_explain():
    assert (bootstrap.CONFIDENCE, bootstrap.FEWEST, bootstrap.BCA_FEWEST) == (0.95, 6, 20)
    assert comparison.WARN_BELOW == 10
    assert sign_flips.is_exact(13, sign_flips.FLIPS)
    assert not sign_flips.is_exact(14, sign_flips.FLIPS)
    assert sign_flips.flips_for(20) == sign_flips.FLIPS
    assert sign_flips.LEVEL == 0.05
    assert MAX_POINTS == 2_000_000
    assert tolerance(1008, 1008) == 12
    assert 0.15 / 0.05 == 2.9999999999999996
    assert np.array_equal(flip_world([[1.0, 2.0, 3.0]]), [[1.0, -2.0, -3.0]])


def test_python_in_the_document_compiles():
    snippets = [block for page in PAGES for block in blocks(page) if block.language == "python"]
    assert snippets
    for snippet in snippets:
        compile(snippet.code, str(snippet.page), "exec")


def test_the_snippet_reads_a_file_of_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "scores.json").write_text(example_scores().model_dump_json())
    monkeypatch.chdir(tmp_path)
    page = DOCS / "scores-file.md"
    snippet = next(block.code for block in blocks(page) if block.code.startswith("import json"))
    exec(compile(snippet, str(page), "exec"), {})
    assert re.match(
        r"IoU 0\.\d{3} over \d+ observations\n95 % interval 0\.\d{3} to 0\.\d{3}\n", capsys.readouterr().out
    )


def test_sources_of_other_rooms_are_of_categories_that_stand_silent_in_the_room_or_of_no_class():
    for spec in read_manifest(DOCS.parent / "scenes_manifest" / "listen.yaml").manifest.observations:
        away = {one.category for one in spec.sources or () if one.room is not None}
        assert away <= {*spec.objects, *OFF_SCREEN_CATEGORIES}, spec.key
