"""The procedural models: one module per category, each with a table ``VARIANTS`` of functions that build a `Design`."""
