"""The synthesised voices: one module per category, each with a tuple ``VOICES``."""
