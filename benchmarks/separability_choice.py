"""How the networks of `separability` are chosen, without the voices and recordings that they are tested on.

    python -m benchmarks.separability_choice -o FILE.json [--recordings FOLDER]

Each of `CANDIDATES` is trained with each of `SEEDS`, on the training voices but three of each category, which a seed
draws, and asked about those three, the validation voices and the recordings for training in the store (`avs3d assets
fetch`): shares of right seconds, the last two as means over the spectra of `separability.CHANGES`. Each cell of the
table has an aim, so the smallest of the three shares counts, as a mean over the seeds; the best is what `Training` has.
With ``--recordings``, networks with the best setting are then trained on all training voices and asked about validation
and test voices and the recordings in FOLDER: rows of the table of `separability`, in FILE as ``network``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_json
from benchmarks import separability
from benchmarks.separability import (
    CHANGES,
    Clips,
    joined,
    of_lock,
    of_networks,
    of_recordings,
    of_voices,
    prepared,
    share_of,
)
from benchmarks.separability_network import RANGE, Mels, Network, Training, log_mel

#: Name → setting. Those that differ in ``asked_hz`` alone are asked of the same networks.
CANDIDATES = {f"asked below {hz / 1000:g} kHz": Training(asked_hz=hz) for hz in (RANGE[1], 8000.0, 6000.0, 4000.0)}
#: Of the networks; training voices of each category that are held back.
SEEDS, HELD = (0, 1), 3
#: Set → labels (n,) of its seconds, and their spectra after one or all of `CHANGES`.
Asked = Mapping[str, tuple[NDArray[np.int64], Sequence[Mels]]]


def held_back(voices: NDArray[np.str_], seed: int) -> NDArray[np.bool_]:
    """(n,) whether the seconds of ``category/voice`` (n,) are of the `HELD` voices of a category that a seed draws."""
    rng, held, names = np.random.default_rng(100 + seed), [], list(dict.fromkeys(voices.tolist()))
    for category in CATEGORIES:
        held += rng.permutation([name for name in names if name.startswith(f"{category}/")])[:HELD].tolist()
    return np.isin(voices, held)


def shares(network: Network, asked: Asked, asked_hz: float) -> dict[str, float]:
    """Set → share of right seconds, a mean over its spectra."""
    return {
        which: float(
            np.mean(
                [share_of(network.probabilities(one, asked_hz).argmax(axis=1) == labels, labels) for one in spectra]
            )
        )
        for which, (labels, spectra) in asked.items()
    }


def measured(
    train: Clips, mel: Mels, asked: Asked, training: Training, asked_hz: Mapping[str, float], seed: int
) -> dict[str, dict[str, float]]:
    """Candidate → set → share, of candidates that ask the same network.

    Args:
        train: the seconds of all training voices.
        mel: (n, MELS, frames) their `log_mel`.
        asked: what is asked about, beside the voices held back.
        training: how the network is trained.
        asked_hz: of each candidate.
        seed: of the network and of the voices that are held back.
    """
    out = held_back(train.voices, seed)
    network = Network(mel[~out], train.labels[~out], training, seed)
    sets = {"held back": (train.labels[out], [mel[out]]), **asked}
    return {name: shares(network, sets, hz) for name, hz in asked_hz.items()}


def best(found: Mapping[str, Mapping[int, Mapping[str, float]]]) -> tuple[str, dict[str, float]]:
    """The chosen candidate, and of each the mean over the seeds of the smallest share.

    Args:
        found: candidate → seed → set → share.
    """
    scores = {name: float(np.mean([min(sets.values()) for sets in of.values()])) for name, of in found.items()}
    return max(scores, key=lambda name: scores[name]), scores


def asked_of(sets: Mapping[str, Clips], workers: int | None) -> Asked:
    """Sets that candidates are asked about, with the spectra of each of `CHANGES`."""
    return {
        which: (clips.labels, [prepared(log_mel, clips.samples, change, workers) for change in CHANGES])
        for which, clips in sets.items()
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="JSON")
    parser.add_argument("--recordings", type=Path, help="ask the best in the end: a folder with a folder per category")
    parser.add_argument("--units", type=int, default=40, help="of each training voice [40]")
    parser.add_argument("--asked", type=int, default=10, help="units of each voice that is asked about [10]")
    parser.add_argument("--workers", type=int, default=None, help="processes [one per core]")
    options = parser.parse_args(arguments)
    # Files first: where they are missing or damaged, that is said before minutes go into voices.
    tested = (
        {"recordings": of_recordings(options.recordings, separability.SEEDS["asked"])} if options.recordings else {}
    )
    learnt = of_lock("train", separability.SEEDS["learnt"])

    def of(split: str, units: int) -> Clips:
        return joined(of_voices(split, separability.SEEDS[split], units, options.workers))

    train, validation = of("train", options.units), of("validation", options.asked)
    mel = prepared(log_mel, train.samples, "whole", options.workers)
    asked = asked_of({"validation": validation, "recordings for training": learnt}, options.workers)
    found: dict[str, dict[int, dict[str, float]]] = {name: {} for name in CANDIDATES}
    trainings: dict[Training, dict[str, float]] = {}
    for name, one in CANDIDATES.items():
        trainings.setdefault(replace(one, asked_hz=RANGE[1]), {})[name] = one.asked_hz
    for training, asked_hz in trainings.items():
        for seed in SEEDS:
            for name, sets in measured(train, mel, asked, training, asked_hz, seed).items():
                found[name][seed] = sets
                said = ", ".join(f"{which} {share:.3f}" for which, share in sets.items())
                print(f"{name}, seed {seed}: {said}", flush=True)
    name, scores = best(found)
    report: dict[str, Any] = {"chosen": name, "scores": scores, "shares": found}
    write_json(options.output, report)
    print(f"{name}: {scores[name]:.3f}", flush=True)
    if tested:
        tested |= {"validation": validation, "test": of("test", options.asked)}
        report["network"] = of_networks(train, mel, tested, CANDIDATES[name], options.workers)
        write_json(options.output, report)


if __name__ == "__main__":
    try:
        main()
    except Avs3dError as error:
        sys.exit(f"separability_choice: error: {error}")
