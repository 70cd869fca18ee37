"""Pictures: against their second name and the colours of the sparse points."""

from __future__ import annotations

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.validation.findings import Findings, read


def check_twin(frame: Frame, files: set[str], findings: Findings) -> None:
    """images/ are bit for bit the pictures of input/."""
    first, second = f"{layout.INPUT}/{frame.name}.png", f"{layout.IMAGES}/{frame.name}.png"
    if first not in files or second not in files:
        return
    a, b = frame.observation.path / first, frame.observation.path / second
    if a.samefile(b):
        return
    copy = read(findings, files, second, lambda: media.read_bytes(b))
    try:
        original = media.read_bytes(a)
    except Avs3dError:
        return  # already named
    if copy is not None and copy != original:
        findings.add(second, f"is not the same picture as {first}")
