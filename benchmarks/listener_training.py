"""Train the listener from a checkout, without installing it: the same options as `avs3d train listener`.

    python -m benchmarks.listener_training --data SHARDS -o runs/listener --devices 2 --epochs 30

Prints one line of JSON per report. Run it again to go on after an interruption.
"""

from __future__ import annotations

import sys

from avs3d_bench.errors import Avs3dError
from baselines.listener.cli import listener


def main() -> None:
    try:
        options = sys.argv[1:]
        # The model card names the command by `sys.argv`.
        sys.argv = ["avs3d", "train", "listener", *options]
        listener.main(options, prog_name="listener_training")
    except Avs3dError as error:
        print(f"listener_training: error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
