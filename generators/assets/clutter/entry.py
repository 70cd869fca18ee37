"""x."""

KINDS: tuple = ()
