"""One observation, from its plan to its files; start reading at `generators.observation.generate`."""
