"""Geometric acoustics: exact early reflections, a stochastic late part, any receiver from one trace."""
