"""Placement of objects in a room."""
