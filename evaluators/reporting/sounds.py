"""Sources in a frame of part_3, for reports: in words, and the instances that are taken for them most easily."""

from __future__ import annotations

from collections import Counter

from avs3d_bench.dataset import Frame


def sounds_in(frame: Frame) -> str:
    """Audible sources of a frame in words: ``microwave and telephone``, ``clock in the living room``, ``silence``."""
    record, entry = frame.observation.record, frame.record
    if record is None or entry is None or entry.audible is None:
        return "not known"
    found: Counter[str] = Counter()
    for one in entry.audible:
        source = record.source(one.source)
        name = source.category.replace("_", " ")
        found[name if source.instance is not None else f"{name} in the {source.room.replace('_', ' ')}"] += 1
    words = [name if count == 1 else f"{count} × {name}" for name, count in found.items()]
    if record.background is not None:
        words.append(f"background ({record.background.kind.replace('_', ' ')})")
    if not words:
        return "silence"
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else last


def silent_twins(frame: Frame) -> tuple[int, ...]:
    """Ids of the instances of the categories that sound, without those that sound themselves.

    What is audible in the frame counts, sources in other rooms included. Nothing where the data do not say what sounds.
    """
    record, entry = frame.observation.record, frame.record
    if record is None or entry is None:
        return ()
    categories = {source.category for source in record.audible_sources(entry)}
    heard = record.audible_instances(entry)
    return tuple(one.id for one in record.instances if one.category in categories and one.id not in heard)
