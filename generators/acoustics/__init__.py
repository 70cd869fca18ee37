"""Acoustic backends."""
