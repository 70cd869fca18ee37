"""Many tasks on many processes: this machine's, or those of a Dask cluster.

    tasks.py         the input: `Task`, `Policy`, and the results: `Event`, `Success`, `Failure`
    ledger.py        which task is next, which is tried again, which has failed; knows no processes
    supervised.py    a child process that runs one task at a time, with a time limit; replaced when it dies or hangs
    child.py         the program in that process
    local.py         a pool of supervised processes
    dask_backend.py  the same on dask.distributed; each Dask worker keeps a supervised process of its own
    jobqueue.py      starts a Dask cluster through Slurm, PBS or Kubernetes
    options.py       the options of the command line, and `start`, which picks the scheduler they ask for
    lock.py          who holds a folder
    failures.py      failures.jsonl

A task is a function of a module with arguments that can be pickled, so that any process can find it. Whatever a task
does to its process (a crash in a library, a kill because memory ran out, a loop without end) ends that process alone.
"""
