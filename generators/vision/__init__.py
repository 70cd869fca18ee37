"""Vision backends."""
