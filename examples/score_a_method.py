"""Score a submission and print the figures for a paper's table.

    python examples/score_a_method.py data/demo data/demo-submissions/oracle

The core install is enough: no torch, no simulator.
"""

import argparse

from evaluators import InvalidSubmission, evaluate


def main() -> None:
    """Read the two paths, check, score and print."""
    parser = argparse.ArgumentParser(description="Score a submission.")
    parser.add_argument("dataset", help="root of the dataset")
    parser.add_argument("submission", help="folder or .zip of the submission")
    options = parser.parse_args()
    try:
        scores = evaluate(options.submission, options.dataset).scores
    except InvalidSubmission as error:
        for problem in error.report.problems:
            print(f"{problem.path}: {problem.message}")
        raise SystemExit(1) from None
    print(f"{scores.submission.method} on {scores.dataset.name}: {scores.dataset.scored} observations")
    for part, group in scores.parts.items():
        print(f"{part}  official mIoU {group.official.mIoU:.3f}  F {group.official.F:.3f}", end="")
        if group.strict.IoU is None:  # the object is visible in no test frame
            print(f"  strict IoU: {group.strict.unavailable['IoU']}")
            continue
        print(f"  strict IoU {group.strict.IoU:.3f}", end="")
        # There is no interval if the part has too few observations.
        interval = group.strict.intervals.get("IoU")
        print(f" [{interval[0]:.3f}, {interval[1]:.3f}]" if interval else "")
    box = scores.references["centre_box"]["overall"].strict.IoU
    print(f"for comparison: a box in the centre has a strict IoU of {box:.3f}" if box is not None else "")


if __name__ == "__main__":
    main()
