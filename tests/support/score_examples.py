"""Plausible files of scores from a seeded generator: any number of observations, any gaps; no picture is scored."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from avs3d_bench import __version__
from avs3d_bench.contract.scores import (
    BLIND_REFERENCES,
    METRICS,
    REFERENCES,
    ObservationScores,
    Scores,
    SiblingScores,
    metrics_of,
)
from avs3d_bench.contract.taxonomy import CATEGORIES, PARTS, ROOMS
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from evaluators.reading.records import FrameScore, Submission
from evaluators.statistics.bootstrap import FEWEST
from evaluators.summary import summarise

#: What the references get, by figure.
REFERENCE_FIGURES = {
    "all_black": {"mIoU": 0.31, "F": 0.031, "IoU": 0.0, "F_strict": 0.0, "boundary_F": 0.0, "FP_rate": 0.0,
                  "FP_area": 0.0, "wrong_instance_rate": 0.0},
    "all_white": {"mIoU": 0.016, "F": 0.031, "IoU": 0.024, "F_strict": 0.031, "boundary_F": 0.0, "FP_rate": 1.0,
                  "FP_area": 1.0, "wrong_instance_rate": 1.0},
    "centre_box": {"mIoU": 0.27, "F": 0.072, "IoU": 0.055, "F_strict": 0.072, "boundary_F": 0.021, "FP_rate": 1.0,
                   "FP_area": 0.25, "wrong_instance_rate": 0.28},
    "deaf_category": {"mIoU": 0.93, "F": 0.95, "IoU": 0.94, "F_strict": 0.95, "boundary_F": 0.96, "FP_rate": 0.06,
                      "FP_area": 0.002, "wrong_instance_rate": 1.0},
    "deaf_most_seen": {"mIoU": 0.84, "F": 0.83, "IoU": 0.83, "F_strict": 0.84, "boundary_F": 0.83, "FP_rate": 0.04,
                       "FP_area": 0.001, "wrong_instance_rate": 0.48},
}  # fmt: skip
NO_POINTS = "the submission has no points.ply"


def keys_of(count: int) -> list[str]:
    """So many observation keys, about a quarter of them in part_2, sorted."""
    multi = count // 4
    places = {"part_1": count - multi, "part_2": multi}
    return sorted(
        f"{part}/apartment_{1 + i // 9}/{ROOMS[i % 3]}/{1 + i // 3 % 3}" for part in places for i in range(places[part])
    )


def example_scores(
    observations: int | Sequence[str] = 34,
    *,
    seed: int = 0,
    skill: float = 0.75,
    protocols: Iterable[str] = ("official", "strict"),
    release: bool = False,
    points: bool = False,
    dataset: dict[str, Any] | None = None,
    evaluator: dict[str, Any] | None = None,
    categories: dict[str, str] | None = None,
    report: str | None = None,
    **submission: Any,
) -> Scores:
    """Scores of a method of that ``skill`` (its mean IoU, about).

    Args:
        observations: how many, or which keys.
        seed: of the generator.
        skill: in [0, 1].
        protocols: which the file holds.
        release: as of the official release: no category, no twins, no mesh, no version, no deaf rows.
        points: whether the submission holds clouds.
        dataset: fields of the dataset's record to replace.
        evaluator: likewise.
        categories: key → category; drawn by the position where it does not say.
        report: where the report lies.
        submission: fields of submission.json to replace.
    """
    rng = np.random.default_rng(seed)
    keys = keys_of(observations) if isinstance(observations, int) else list(observations)
    chosen = [name for name in ("official", "strict") if name in set(protocols)]
    rows = [
        _observation(rng, key, index, skill, chosen, release, points, categories or {})
        for index, key in enumerate(keys)
    ]
    groups = {name: [row for row in rows if row["part"] == name] for name in PARTS}
    references = {
        name: {
            part: _reference(group, name, chosen, release)
            for part, group in (groups | {"overall": rows}).items()
            if group
        }
        for name in (REFERENCES if "strict" in chosen and not release else BLIND_REFERENCES)
    }
    missing = [name for name in REFERENCES if name not in references] if "strict" in chosen else []
    record = {
        "avs3d_eval": {
            "version": __version__, "protocols": dict.fromkeys(chosen, "1.0"), "bootstrap_resamples": 10_000,
            "bootstrap_seed": 0, "voxel_size": 0.05,
        } | (evaluator or {}),
        "submission": {
            "method": "EchoSegnet", "dataset": "open-s34-o7", "dataset_version": "1.0.0", "layout": "avs3d",
            "points": points,
        } | submission,
        "dataset": {
            "name": "3DAVS-S34-O7" if release else "open-s34-o7", "version": None if release else "1.0.0",
            "sha256": None if release else hashlib.sha256(b"open").hexdigest(), "observations": len(keys),
            "scored": len(keys),
        } | (dataset or {}),
        "report": report,
        "observations": rows,
        "overall": _summary(rows, chosen),
        "parts": {name: _summary(group, chosen) for name, group in groups.items() if group},
        "categories": _grouped(rows, "category", CATEGORIES, chosen),
        "rooms": _grouped(rows, "room", ROOMS, chosen),
        "references": references,
        "references_unavailable": dict.fromkeys(missing, "the dataset has no instance masks"),
    }  # fmt: skip
    return Scores.model_validate(record)


def with_means(data: dict[str, Any]) -> dict[str, Any]:
    """A dumped file of scores whose observations or reference parts were changed, with the means that follow."""
    rows = [ObservationScores.model_validate(row) for row in data["observations"]]
    siblings = [SiblingScores.model_validate(one) for one in data.get("siblings") or ()]

    def grouped(field: str) -> dict[str, Any]:
        names = dict.fromkeys(getattr(row, field) for row in rows if getattr(row, field) is not None)
        return {name: of([row for row in rows if getattr(row, field) == name]) for name in names}

    def of(chosen: Sequence[ObservationScores]) -> dict[str, Any]:
        return summarise(chosen, siblings, intervals=False).model_dump(mode="json")

    data |= {"overall": of(rows), "parts": grouped("part"), "categories": grouped("category"), "rooms": grouped("room")}
    data["references"] = {name: _whole(groups, data["parts"]) for name, groups in data["references"].items()}
    data["references"] = {name: groups for name, groups in data["references"].items() if groups}
    return data


def _whole(groups: dict[str, Any], parts: dict[str, Any]) -> dict[str, Any]:
    """A reference with the counts of the file's parts, and the overall means that follow from its parts."""
    kept = {name: group for name, group in groups.items() if name in parts}
    if not kept:
        return {}
    overall = groups["overall"] | {"observations": 0, "frames": 0}
    for name, group in kept.items():
        group |= {key: parts[name][key] for key in ("observations", "frames")}
        overall |= {key: overall[key] + group[key] for key in ("observations", "frames")}
        if group["strict"]:
            group["strict"]["counts"] = parts[name]["strict"]["counts"]
    for metric in METRICS:
        found = [(group, group[metric.protocol]) for group in kept.values() if group.get(metric.protocol)]
        known = [
            (scores["counts"][metric.name] if "counts" in scores else group["observations"], scores[metric.name])
            for group, scores in found
            if scores[metric.name] is not None
        ]
        total = sum(weight for weight, _ in known)
        if overall.get(metric.protocol):
            value = math.fsum(weight * value for weight, value in known) / total if total else None
            overall[metric.protocol][metric.name] = value
    return kept | {"overall": overall}


def report_page(title: str) -> str:
    """The least that is a report: head, title, style sheet and script of `evaluators.reporting.pages`."""
    from html import escape

    from evaluators.reporting.pages import page_script, report_head

    return (
        f"{report_head()}{escape(title)}</title>\n<style></style>\n<script>{page_script()}</script>\n</head>\n"
        f"<body><main><h1>{escape(title)}</h1></main></body>\n</html>\n"
    )


def _observation(
    rng: np.random.Generator, key: str, index: int, skill: float, protocols: list[str], release: bool, points: bool,
    categories: dict[str, str],
) -> dict[str, Any]:  # fmt: skip
    part, scan, room, _ = key.split("/")
    absent = int(rng.integers(0, 9)) if index % 5 else 0
    iou = float(rng.beta(8 * skill + 0.2, 8 * (1 - skill) + 0.2))
    multi = part == "part_2" and not release
    why = {} if multi else {"wrong_instance_rate": "the dataset has no instance masks" if release else "no twin"}
    if not absent:
        why |= dict.fromkeys(("FP_rate", "FP_area"), "the object is visible in every test frame")
    if not points or release:
        why |= dict.fromkeys(("IoU_3D", "centroid_error"), NO_POINTS)
    figures: dict[str, float] = {
        "IoU": iou, "F": min(1.0, iou**0.8), "boundary_F": iou**1.3,
        "FP_rate": round((1 - iou) * absent) / max(1, absent), "FP_area": 0.04 * (1 - iou),
        "wrong_instance_rate": float(rng.random() * (1 - iou)), "IoU_3D": 0.6 * iou, "centroid_error": 1.5 * (1 - iou),
    }  # fmt: skip
    row: dict[str, Any] = {
        "key": key, "part": part, "scan": scan, "room": room, "frames": 15,
        "category": None if release else categories.get(key, CATEGORIES[index % len(CATEGORIES)]),
    }  # fmt: skip
    if "official" in protocols:
        row["official"] = {"mIoU": (iou * (15 - absent) + 0.97 * absent) / 15, "F": max(0.03, min(1.0, iou**0.8))}
    if "strict" in protocols:
        row["strict"] = {name: None if name in why else value for name, value in figures.items()} | {
            "visible_frames": 15 - absent, "absent_frames": absent,
            "twin_frames": 6 if multi else None if release else 0, "unavailable": why,
        }  # fmt: skip
    return row


def _summary(rows: list[dict[str, Any]], protocols: Iterable[str]) -> dict[str, Any]:
    out: dict[str, Any] = {"observations": len(rows), "frames": sum(row["frames"] for row in rows)}
    for protocol in protocols:
        means: dict[str, float | None] = {}
        intervals, counts, why = {}, {}, {}
        for metric in metrics_of(protocol):
            values = [row[protocol][metric.name] for row in rows if row[protocol][metric.name] is not None]
            counts[metric.name] = len(values)
            means[metric.name] = math.fsum(values) / len(values) if values else None
            if not values:
                why[metric.name] = rows[0][protocol]["unavailable"][metric.name]
            if len(values) >= FEWEST:
                half = 1.96 * float(np.std(values, ddof=1)) / math.sqrt(len(values))
                middle = math.fsum(values) / len(values)
                intervals[metric.name] = (max(min(values), middle - half), min(max(values), middle + half))
        out[protocol] = means | {"intervals": intervals}
        if protocol == "strict":
            out[protocol] |= {"counts": counts, "unavailable": why}
    return out


def _reference(rows: list[dict[str, Any]], name: str, protocols: list[str], release: bool) -> dict[str, Any]:
    out = _summary(rows, protocols)
    multi = any(row["part"] == "part_2" for row in rows) and not release
    for metric in METRICS:
        if metric.protocol not in protocols:
            continue
        key = "F_strict" if (metric.protocol, metric.name) == ("strict", "F") else metric.name
        known = key in REFERENCE_FIGURES[name] and (multi or key != "wrong_instance_rate")
        out[metric.protocol][metric.name] = REFERENCE_FIGURES[name][key] if known else None
        out[metric.protocol]["intervals"] = {}
    return out


def _grouped(
    rows: list[dict[str, Any]], field: str, names: Iterable[str], protocols: Iterable[str]
) -> dict[str, dict[str, Any]]:
    groups = {name: [row for row in rows if row[field] == name] for name in names}
    return {name: _summary(group, protocols) for name, group in groups.items() if group}


def write_masks(
    root: Path, dataset: Dataset, *, seed: int = 0, only: Iterable[str] = ()
) -> tuple[Submission, list[FrameScore]]:
    """A submission of shifted, shrunk, grown, swapped and dropped true masks, and the figures of its frames."""
    import cv2

    from avs3d_bench.contract.schema import SubmissionRecord

    rng = np.random.default_rng(seed)
    record = SubmissionRecord(method="Example", dataset=dataset.name, dataset_version="1")
    submission = Submission(root, "avs3d", "masks", record)
    scores = []
    for observation in dataset.select(*only):
        ours = observation.record
        others = [i.id for i in ours.instances if not i.sounding] if ours else []
        twins = [i.id for i in ours.instances if not i.sounding and i.category == ours.category] if ours else []
        for frame in observation.test:
            truth = frame.mask()
            kind = rng.choice(
                ["good", "shifted", "grown", "shrunk", "other", "dropped"], p=[0.5, 0.15, 0.1, 0.1, 0.1, 0.05]
            )
            mask = truth.astype(np.uint8)
            reach = max(1, round(truth.shape[0] * float(rng.uniform(0.004, 0.04))))
            kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
            ids = frame.instance_ids() if others else None
            if kind == "good":
                mask = cv2.dilate(mask, kernel[reach // 2 : -(reach // 2) or None, reach // 2 : -(reach // 2) or None])
            if kind == "shifted":
                mask = np.roll(mask, (reach, -2 * reach), axis=(0, 1))
            if kind == "grown":
                mask = cv2.dilate(mask, kernel)
            if kind == "shrunk":
                mask = cv2.erode(mask, kernel)
            if kind == "other" and ids is not None:
                mask = cv2.dilate((ids == others[0]).astype(np.uint8), kernel)
            if kind == "dropped":
                mask = np.zeros_like(mask)
            marked = mask > 0
            media.write_png_mask(submission.mask_path(observation.key, frame.name), marked)
            union = int((truth | marked).sum())
            iou = int((truth & marked).sum()) / union if truth.any() else None
            hit = sum(
                bool(marked[ids == twin].mean() > 0.5) for twin in twins if ids is not None and (ids == twin).any()
            )
            scores.append(FrameScore(observation.key, frame.name, bool(truth.any()), iou, float(marked.mean()), hit))
    return submission, scores
