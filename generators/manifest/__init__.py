"""The manifest: what to generate, checked field by field before generation begins."""
