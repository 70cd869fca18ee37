"""A run: its workers, what they write, the cache of homes, progress."""
