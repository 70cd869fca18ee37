"""Shows a run: a bar with the rate and the time left, and one line per finished observation."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from avs3d_bench.scheduling.tasks import Event, Listener
from generators.plan import ObservationPlan

#: Between two lines on how far the run is, where no bar is drawn, seconds.
_SUMMARY = 60.0


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("– frames/s" if speed is None else f"{speed:.1f} frames/s", style="progress.data.speed")


@contextmanager
def reporting(plans: tuple[ObservationPlan, ...]) -> Iterator[Listener]:
    """A listener for `generators.run.runner.run` that draws on stderr; lines only where stderr is not a terminal."""
    console = Console(file=sys.stderr, highlight=False)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        yield _Display(plans, console, bar).listen


class _Display:
    """Draws the events of a run."""

    def __init__(self, plans: tuple[ObservationPlan, ...], console: Console, bar: Progress) -> None:
        self._console = console
        self._bar = bar
        self._lock = threading.Lock()
        self._frames = {plan.key: plan.camera.frames for plan in plans}
        self._drawn: dict[str, int] = {}
        self._began = self._said = time.monotonic()
        self._ended = self._made = 0
        self._to_make = sum(self._frames.values())
        self._task = bar.add_task("generating", total=self._to_make)

    def listen(self, event: Event) -> None:
        """Draw one event; from any thread."""
        with self._lock:
            if event.kind == "home":
                self._bar.update(self._task, description=f"opening {event.name}")
                self._say(f"home {event.name}: read, or built and lit where it is not in the cache yet")
            elif event.kind == "start":
                self._bar.update(self._task, description="generating")
            elif event.kind == "frame":
                # The newest of several; one that is made a second time draws from the beginning again.
                drawn = self._drawn.get(event.name, 0)
                newest = max(drawn, int(event.text) + 1)
                self._bar.advance(self._task, newest - drawn)
                self._made += newest - drawn
                self._drawn[event.name] = newest
            elif event.kind in ("kept", "done", "failed"):
                self._end(event)
            elif event.kind in ("retry", "worker", "note"):
                self._say("  ".join(filter(None, (f"{event.kind:6}", event.name, event.text))))
            self._summarise()

    def _end(self, event: Event) -> None:
        """Count an observation that is kept, done or given up."""
        key = event.name
        self._ended += 1
        rest = self._frames[key] - self._drawn.get(key, 0)
        if event.kind == "done":
            self._made += rest
            self._bar.advance(self._task, rest)
        else:  # nobody makes these frames now: counted as progress, they would spoil rate and time left
            self._to_make -= rest
            self._bar.update(self._task, total=self._to_make)
        self._drawn[key] = self._frames[key]
        if event.kind == "failed":
            self._say(f"avs3d: error: {key}: {event.text}")
        else:
            self._say(f"{event.kind:6} {key}" + (f"  {event.text}" if event.text else ""))

    def _say(self, line: str) -> None:
        console = self._bar.console if self._console.is_terminal else self._console
        console.print(line, soft_wrap=True, markup=False)

    def _summarise(self) -> None:
        """Where no bar is drawn, say every now and then how far the run is."""
        now = time.monotonic()
        if self._console.is_terminal or now - self._said < _SUMMARY:
            return
        self._said = now
        rate = self._made / (now - self._began)
        frames = sum(self._frames.values()) - sum(self._drawn.values())
        left = str(timedelta(seconds=round(frames / rate))) if rate else "–"
        self._say(f"{self._ended} of {len(self._frames)} observations, {rate:.1f} frames/s, {left} left")
