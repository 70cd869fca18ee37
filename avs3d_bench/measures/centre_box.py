"""The box in the middle of a picture: a prediction that looks at nothing."""

from __future__ import annotations


def centre_box(height: int, width: int) -> tuple[slice, slice]:
    """Rows and columns of the middle half of each, a quarter of the area.

    Rows H // 4 to H − H // 4 and columns W // 4 to W − W // 4 (the end not included): a side of odd length, or of no
    multiple of four, gets a box that is centred and up to two pixels longer than its half (5 of 7, 4 of 6, 3 of 5).
    """
    return slice(height // 4, height - height // 4), slice(width // 4, width - width // 4)
