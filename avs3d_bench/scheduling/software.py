"""Do workers run the same software as the one who started the run?"""

from __future__ import annotations

import socket
from collections.abc import Mapping

from avs3d_bench.runtime.provenance import SOFTWARE
from avs3d_bench.scheduling.errors import UnfitError

#: Digits of a digest in a message.
_DIGITS = 12
#: Differences in a message before it only counts.
_NAMED = 3


def check_software(own: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    """Refuse the work of a run on a machine whose software would give other bytes.

    Args:
        own: name → version of what this process has; `avs3d_bench.runtime.provenance.Provenance.versions` and more.
        wanted: the same of the process that started the run.

    Raises:
        UnfitError: one line that names both digests and what differs.
    """
    differing = [name for name in sorted(own.keys() | wanted.keys()) if own.get(name) != wanted.get(name)]
    if not differing:
        return
    said = [
        f"{name} {own.get(name, 'none')} instead of {wanted.get(name, 'none')}"
        for name in differing
        if name != SOFTWARE
    ]
    if SOFTWARE in differing and not said:
        said = ["the sources differ"]
    details = ", ".join(said[:_NAMED]) + (f" and {len(said) - _NAMED} more" if len(said) > _NAMED else "")
    here, there = (versions.get(SOFTWARE, "none")[:_DIGITS] for versions in (own, wanted))
    raise UnfitError(
        f"{socket.gethostname()} has the software {here}, the run {there} ({details}); results would differ: install "
        "the same avs3d-bench and libraries on every machine"
    )
