"""Shared by all commands: options, guarded outputs and the findings that they print."""
