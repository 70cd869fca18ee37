"""`python -m avs3d_bench` is `avs3d`."""

from avs3d_bench.cli import main

main()
