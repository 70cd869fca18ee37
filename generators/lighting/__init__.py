"""Light baked into homes, and light of inserted objects."""
