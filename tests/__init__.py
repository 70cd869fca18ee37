"""Tests, in the folders of the packages that they test; helpers are in `tests.support`."""
