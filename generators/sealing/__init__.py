"""Sealed tests: manifests whose seeds come from a secret. Start reading at `generators.sealing.seal`."""
