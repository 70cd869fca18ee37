"""The synthesised voices: modules with a tuple ``VOICES``, one per category, and `off_screen` for all but the seven."""
