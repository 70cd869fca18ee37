"""The environment variables that bound numerical libraries to one thread a process.

They must be set before numpy is imported, so this module imports nothing.
"""

#: Variable → value: OpenMP, OpenBLAS and numba use one thread. Parallel work is spread over processes, and results are
#: the same on any machine.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
