"""Pictures on the screen: in a notebook, or in the viewer of the desktop."""

from __future__ import annotations

import re
import sys
import tempfile
import webbrowser
from pathlib import Path

from avs3d_bench.formats.media import write_png_rgb
from generators.vision.base import RenderedView


def in_notebook() -> bool:
    """Whether this runs in a Jupyter kernel."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")


def show(view: RenderedView, name: str) -> None:
    """Show a picture below the cell of a notebook; elsewhere write it to a file, print its name and open it."""
    if in_notebook():
        from IPython.display import display

        display(view)  # type: ignore[no-untyped-call]
        return
    folder = Path(tempfile.mkdtemp(prefix="avs3d-"))
    path = folder / f"{re.sub(r'[^A-Za-z0-9_.-]+', '_', name)}.png"
    write_png_rgb(path, view.rgb)
    print(path)
    webbrowser.open(path.as_uri())
