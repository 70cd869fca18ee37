"""A method in 20 lines: mark a box around the column of the picture from which the sound comes.

python examples/write_a_method.py data/demo my-method
avs3d-eval my-method --dataset data/demo
"""

import sys

import numpy as np

from avs3d_bench.dataset import Dataset
from avs3d_bench.submission import SubmissionWriter


def main(root: str, path: str) -> None:
    """Write a submission for the dataset at ``root`` into the folder ``path``."""
    dataset = Dataset(root)
    with SubmissionWriter(path, dataset, method="louder side") as submission:
        for observation in dataset:
            for frame in observation.test:
                left, right = 10 * np.log10(np.mean(frame.audio() ** 2, axis=1) + 1e-12)
                height, width, _ = frame.rgb().shape
                # A level difference of ±3 dB corresponds to the picture's edge; positive means louder on the right.
                column = width / 2 * (1 + np.clip((right - left) / 3, -1, 1))
                mask = np.zeros((height, width), dtype=bool)
                low, high = max(int(column - width / 4), 0), int(column + width / 4)
                mask[int(0.35 * height) : int(0.75 * height), low:high] = True
                submission.write_mask(frame, mask)


if __name__ == "__main__":
    main(*sys.argv[1:3])
