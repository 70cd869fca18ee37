"""Sealed tests: the secret, and what a seal commits to."""
