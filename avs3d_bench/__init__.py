"""The contract of avs3d-bench: schema, layout, geometry, reading, writing and validating datasets."""

__version__ = "0.1.0"
