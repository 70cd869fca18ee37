"""Scenes: procedural apartments, scans, light."""
