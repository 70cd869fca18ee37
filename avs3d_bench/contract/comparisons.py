"""The record behind the file that `avs3d compare --json` writes: paired differences between methods.

docs/comparing.md has the formulas.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from avs3d_bench.contract.schema import Record, Sha256, Text
from avs3d_bench.contract.scores import Count, Interval, Protocol, ProtocolVersion, Share
from avs3d_bench.text.printable import printable

PartOrOverall = Literal["part_1", "part_2", "part_3", "overall"]
#: Of the first of two methods.
Verdict = Literal["better", "worse", "equal", "undecided"]


class PairedDifference(Record):
    """One figure of two methods over the observations for which both have it: first minus second."""

    first: Text = Field(description="name of one method")
    second: Text = Field(description="name of the other")
    units: Count = Field(description="observations, or groups of siblings, that change sign as a whole")
    observations: Count = Field(description="values in the mean: observations, or groups for pair_accuracy")
    mean: float = Field(description="mean of the differences, in the figure's unit")
    interval: Interval | None = Field(description="95 % bootstrap interval; null for fewer than six units")
    interval_method: Literal["BCa", "percentile"] | None = Field(description="BCa from twenty units on")
    p: Share = Field(description="two-sided p-value of the sign-flip permutation test")
    p_holm: Share = Field(description="the same, corrected for all pairs of methods of this part and figure")
    verdict: Verdict = Field(
        description="better or worse: p_holm is below the level; equal: every difference is 0; else undecided"
    )


class ComparedMethod(Record):
    """One figure of one method."""

    name: Text
    mean: float = Field(description="mean over all values that the method has")
    observations: Count = Field(description="number of these values")
    place: Count = Field(description="from 1; shared by methods that no test separates")


class FigureComparison(Record):
    """All methods and all pairs of them, for one part and one figure."""

    part: PartOrOverall
    protocol: Protocol
    figure: Text
    higher_is_better: bool
    methods: tuple[ComparedMethod, ...] = Field(description="the best first")
    differences: tuple[PairedDifference, ...] = Field(description="every pair, in the order in which files were given")


class ComparedFile(Record):
    """One file of scores."""

    name: Text = Field(description="of the method, in this file: the file's name without suffix, or its path")
    method: Text = Field(description="of submission.json")
    sha256: Sha256 = Field(description="of the scores, wherever their report lies")
    scored: Count = Field(description="observations that were scored")


class ComparedDataset(Record):
    """The dataset of all files."""

    name: Text
    version: str | None = Field(description="null in the official release")
    sha256: Sha256 | None = Field(description="sha256 of dataset.json; null in the official release")
    observations: Count = Field(description="number of observations in the dataset")


class Comparer(Record):
    """The software and settings that computed the comparison."""

    version: Text
    protocols: dict[Protocol, ProtocolVersion] = Field(description="each compared protocol → its version")
    bootstrap_resamples: Count
    sign_flips: Count = Field(description="sign patterns of a test; all 2ⁿ of n units if there are no more")
    seed: Count
    level: Share = Field(description="corrected p-values below it separate two methods")


class Comparison(Record):
    """The file that `avs3d compare --json` writes."""

    avs3d_compare: Comparer
    dataset: ComparedDataset
    files: tuple[ComparedFile, ...]
    figures: tuple[FigureComparison, ...]
    warnings: tuple[Text, ...] = Field(
        description="few observations, observations that some files lack, masks made from the truth"
    )

    def __repr__(self) -> str:
        names = ", ".join(file.name for file in self.files)
        return printable(f"Comparison({names} on {self.dataset.name}: {len(self.figures)} figures)")

    __str__ = __repr__
