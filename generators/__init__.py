"""Manifest and assets to dataset."""
