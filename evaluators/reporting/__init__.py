"""Scores as tables, pages and leaderboards."""
