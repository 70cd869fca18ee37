"""`python -m benchmarks.sealed_attacks PUBLIC PRIVATE [--json FILE]`: does anything but the sound tell the truth?

Each attack of `benchmarks.sealed_channels` answers each question of `benchmarks.sealed_cases` from the public folder,
and those of `benchmarks.sealed_takes` answer the question *take*; the private folder tells who was right. Where nothing
is told, every answer is right with probability 1 / (number of candidates), whatever the attack does: the number of
right answers has a Poisson binomial distribution, whose tail is computed exactly. Each attack is tried in both
directions (largest and smallest score), ties are broken at random. An attack succeeds if its p-value times the number
of all attacks on the question is below `LEVEL` (Bonferroni).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import binom

from avs3d_bench.formats.files import write_json
from benchmarks.sealed_cases import QUESTIONS, Array, Case, load_cases
from benchmarks.sealed_channels import ATTACKS, Scores
from benchmarks.sealed_seeds import SEEDS_TRIED, guess_seeds, public_homes, recognise
from benchmarks.sealed_takes import TAKE_ATTACKS, load_takes

#: Probability that any attack of a run is said to succeed where nothing is told.
LEVEL = 0.01
#: Probability with which the least share of `Verdict.detects` is found.
POWER = 0.9
DIRECTIONS = ("largest", "smallest")


@dataclass(frozen=True)
class Verdict:
    """How often an attack was right.

    Attributes:
        question, attack, direction: what was tried.
        cases: number of questions that it could answer; 0: the public folder has nothing of this kind.
        equal: number of those in which the thing was the same for all candidates: it says nothing.
        right: number of right answers.
        chance: expected number without knowledge.
        p: probability of as many right answers, or more, without knowledge.
        bound: number of right answers from which the attack succeeds; more than ``cases`` if none is enough.
        detects: least share of right answers that is found with probability `POWER`; 1.0 if none is.
    """

    question: str
    attack: str
    direction: str
    cases: int
    equal: int
    right: int
    chance: float
    p: float
    bound: int
    detects: float

    @property
    def succeeds(self) -> bool:
        """Whether the attack is better than chance."""
        return self.cases > 0 and self.right >= self.bound


def tail(chances: Sequence[float]) -> Array:
    """(n + 1,) probability of at least k right answers, k = 0 … n, of independent answers with these chances.

    Examples:
        >>> tail([0.5, 0.5]).tolist()
        [1.0, 0.75, 0.25]
    """
    mass = np.ones(1)
    for chance in chances:
        mass = np.convolve(mass, [1 - chance, chance])
    return np.asarray(mass[::-1].cumsum()[::-1].clip(0.0, 1.0))


def judge(cases: Sequence[Case], *, seeds: int = SEEDS_TRIED, names: Iterable[str] | None = None) -> list[Verdict]:
    """The verdicts on all attacks, question by question.

    Args:
        cases: the questions.
        seeds: number of seeds that are tried as that of the manifest.
        names: the attacks to try; None: all.
    """
    silent = ATTACKS | {"seed of the manifest, tried one by one": lambda found: guess_seeds(found, seeds)}
    chosen = None if names is None else set(names)
    out = []
    for question in QUESTIONS:
        attacks = TAKE_ATTACKS if question == "take" else silent
        mine = [case for case in cases if case.question == question]
        for name in (name for name in attacks if mine and (chosen is None or name in chosen)):
            scores = attacks[name](mine)
            out += [_verdict(question, name, way, mine, scores, len(DIRECTIONS) * len(attacks)) for way in DIRECTIONS]
    return out


def _verdict(
    question: str, name: str, way: str, cases: Sequence[Case], scores: Sequence[Scores], attacks: int
) -> Verdict:
    answered = [(case, own) for case, own in zip(cases, scores, strict=True) if own is not None]
    chances = [1 / case.count for case, _ in answered]
    right = sum(
        _choice(own if way == DIRECTIONS[0] else -own, f"{name}/{way}/{case.keys}") == case.truth
        for case, own in answered
    )
    at_least = tail(chances)
    enough = np.flatnonzero(at_least * attacks <= LEVEL)
    bound = int(enough[0]) if len(enough) else len(chances) + 1
    return Verdict(
        question=question,
        attack=name,
        direction=way,
        cases=len(answered),
        equal=sum(bool(np.ptp(own) == 0) for _, own in answered),
        right=right,
        chance=sum(chances),
        p=float(at_least[right]),
        bound=bound,
        detects=_least_share(len(chances), bound),
    )


def _choice(scores: Array, tag: str) -> int:
    """The candidate with the largest score; one of several is chosen at random, always the same."""
    best = np.flatnonzero(scores >= scores.max() - 1e-12)
    draw = int.from_bytes(hashlib.sha256(tag.encode()).digest()[:8], "big")
    return int(best[draw % len(best)])


def _least_share(count: int, bound: int) -> float:
    shares = np.linspace(0, 1, 1001)
    enough = np.flatnonzero(binom.sf(bound - 1, count, shares) >= POWER) if count else np.zeros(0)
    return float(shares[enough[0]]) if len(enough) else 1.0


def summary(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """The contents of the JSON file."""
    return {"level": LEVEL, "attacks": [vars(v) | {"succeeds": v.succeeds} for v in verdicts]}


def table(verdicts: Sequence[Verdict]) -> Table:
    """One row per question and attack, the better direction of each."""
    out = Table("question", "attack", "cases", "says nothing in", "right", "chance", "p", "bound", "detects")
    for question in QUESTIONS:
        for name in dict.fromkeys(v.attack for v in verdicts if v.question == question):
            best = min((v for v in verdicts if (v.question, v.attack) == (question, name)), key=lambda v: v.p)
            if not best.cases:
                out.add_row(question, name, "0", "-", "-", "-", "-", "-", "-")
                continue
            mark = " SUCCEEDS" if best.succeeds else ""
            out.add_row(
                question, name, str(best.cases), str(best.equal), f"{best.right}{mark}", f"{best.chance:.1f}",
                f"{best.p:.2g}", str(best.bound), f"{best.detects:.2f}",
            )  # fmt: skip
    return out


@click.command()
@click.argument("public", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("private", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--seeds", default=SEEDS_TRIED, show_default=True, type=click.IntRange(0), help="Seeds to try.")
@click.option("--homes", is_flag=True, help="Also compare with every home of the benchmarks (seconds each).")
@click.option("--json", "output", type=click.Path(path_type=Path), default=None, help="Also write the figures here.")
def main(public: Path, private: Path, seeds: int, homes: bool, output: Path | None) -> None:
    """Attack a sealed test; exit 1 if an attack succeeds."""
    recognised = recognise(public, public_homes()) if homes else {}
    for home, found in recognised.items():
        print(f"{home}: {f'is the home of seed {found[0]}' if found else 'is none of those tried'}")
    verdicts = judge([*load_cases(public, private), *load_takes(public, private)], seeds=seeds)
    Console(width=130).print(table(verdicts))
    if output:
        write_json(output, summary(verdicts))
    if any(v.succeeds for v in verdicts) or any(recognised.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
