"""Procedural apartments: floor plan, shell and furniture from a seed."""
