"""Processes, threads, locks and memory, and the software that runs: nothing here knows a dataset."""
